!> Computes the profile of a sum of squares J along one parameter: the least J at each value, with
!> all other parameters fitted again. The interval ends where J has risen to its 95 % level.
!>
!> If residuals are linear in the parameters, these intervals are those of linear theory. Otherwise
!> they may be asymmetric, end at a bound, or have no end (Bates and Watts, Nonlinear Regression
!> Analysis, 1988, section 6.1).
module beamid_profile_likelihood
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_problems, only: smooth_problem_t
   use beamid_sections, only: distance_of, find_slopes, minimise, new_section, section_t
   use beamid_strings, only: to_text
   use beamid_variables, only: unbounded, variable_t
   implicit none
   private

   public :: side_t, follow_profile, minimise_at

   !> How a side of a profile ends: J has risen to its 95 % level; the parameter has reached a bound
   !> before; J stays below this level for all values; or a fit failed, and the end is not known.
   integer, parameter, public :: is_closed = 1, at_bound = 2, is_open = 3, is_lost = 4

   !> One side of the profile of a parameter, from the estimate outwards.
   type :: side_t
      integer :: state = is_lost                !< how the side ends
      real(wp) :: end = 0                       !< end of the interval, a value of the parameter
      real(wp), allocatable :: value(:)         !< (points) values of the parameter
      real(wp), allocatable :: J(:)             !< (points) least sum of squares at each value
      !> (points) sqrt((J - J_min)/rise): 1 at the end of the interval
      real(wp), allocatable :: distance(:)
      real(wp), allocatable :: parameters(:, :) !< (n, points) all parameters at each value
      character(len=:), allocatable :: reason   !< why the end is not known; otherwise ''
   end type side_t

   !> Distance between two points that the steps aim at, as in `side_t`.
   real(wp), parameter :: target_gain = 0.25_wp

   !> The profile ends beyond `farthest` times the moderate value, and nearer to a bound than the
   !> share `nearest` of the estimate's distance.
   real(wp), parameter :: farthest = 1e8_wp, nearest = 1e-3_wp

contains

   !> Follows the profile of parameter k from the estimate to one side.
   !>
   !> problem    on return at any parameters
   !> rows       m, number of its residuals
   !> variables  (n) with their bounds
   !> estimate   (n) where J is least
   !> J_min      J at the estimate
   !> k          index of the parameter
   !> direction  -1: towards smaller values; 1: towards larger values
   !> rise       of J at the end of the interval, > 0
   !> first      step, > 0, along which J rises by `rise` according to linear theory
   !> side       the profile; a failed fit is noted there
   !> monitor    receives a report of each point
   !> patience   largest number of evaluations, with a Jacobian each, in the search of one point;
   !>            default: that of a fit
   subroutine follow_profile(problem, rows, variables, estimate, J_min, k, direction, rise, first, &
      side, monitor, patience)
      class(smooth_problem_t), intent(inout), target :: problem
      integer, intent(in) :: rows, k, direction
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: estimate(:), J_min, rise, first
      type(side_t), intent(out) :: side
      class(monitor_t), intent(inout), optional :: monitor
      integer, intent(in), optional :: patience
      integer, parameter :: max_points = 200, max_failures = 8
      type(section_t) :: section
      type(error_t), allocatable :: error
      real(wp), dimension(size(estimate)) :: here, next, slopes
      real(wp) :: bound, step, distance, J, limit
      integer :: failures, i

      call new_section(section, problem, rows, variables, k, J_min, rise)
      if (present(patience)) section%max_evaluations = patience
      bound = merge(variables(k)%lower, variables(k)%upper, direction < 0)
      limit = farthest*max(abs(estimate(k)), variables(k)%magnitude)
      here = estimate
      side%reason = ''
      allocate (side%value(0), side%J(0), side%distance(0), side%parameters(size(estimate), 0))
      call add_point(side, k, here, J_min, 0.0_wp)
      if (has_ended(nearest*variables(k)%magnitude)) return
      call find_slopes(section, here, slopes)
      step = min(target_gain*first, limit/10)
      failures = 0
      do i = 1, max_points
         next = ahead(here, slopes, direction*step)
         call minimise(section, next, J, error)
         if (allocated(error)) then
            failures = failures + 1
            step = abs(next(k) - here(k))/4
            if (failures <= max_failures .and. step > 0) cycle
            call give_up(error%message)
            return
         end if
         distance = distance_of(section, J)
         if (distance >= 1) then
            call find_end(section, here, next, side%distance(size(side%J)), distance, J, side)
            return
         end if
         step = abs(next(k) - here(k))*min(3.0_wp, target_gain/max(target_gain/3, &
            distance - side%distance(size(side%J))))
         here = next
         call add_point(side, k, here, J, distance)
         ! The sides are followed in parallel.
         !$omp critical (one_side_done)
         if (present(monitor)) call monitor%advanced(size(side%J), 0, 'points of a profile')
         !$omp end critical (one_side_done)
         if (has_ended(nearest*abs(estimate(k) - bound))) return
         call find_slopes(section, here, slopes)
      end do
      call give_up('the sum of squares neither rises nor stays')

   contains

      !> Ends the side at the last point, for a reason.
      subroutine give_up(reason)
         character(len=*), intent(in) :: reason

         side%end = here(k)
         side%reason = reason
      end subroutine give_up

      !> Returns whether the profile has reached the bound, to within a distance, or the limit, and
      !> then ends the side there.
      logical function has_ended(near)
         real(wp), intent(in) :: near

         has_ended = abs(here(k) - bound) <= near
         if (has_ended) then
            side%state = at_bound
            side%end = bound
         else if (abs(here(k)) >= limit) then
            has_ended = .true.
            side%state = is_open
            side%end = direction*unbounded
         end if
      end function has_ended

      !> Returns the parameters, (n), after a step along the curve of minima, inside the bounds. A
      !> step covers at most 0.9 of the way to the bound, because the model may have no value there,
      !> and because the curve may lead all parameters to their bounds.
      function ahead(from, slopes, length) result(to)
         real(wp), intent(in) :: from(:), slopes(:), length
         real(wp) :: to(size(from)), moved

         to = from
         to(k) = from(k) + length
         if (abs(bound) < unbounded) to(k) = direction*min(direction*to(k), &
            direction*(from(k) + 0.9_wp*(bound - from(k))))
         moved = to(k) - from(k)
         to = min(max(from + slopes*moved, variables%lower), variables%upper)
         to(k) = from(k) + moved
      end function ahead

   end subroutine follow_profile

   !> Minimises J over all parameters except one, which is moved to a distant value in steps that
   !> at most double it. The searches are short: J is exact to a relative error of 1e-3 or, at the
   !> end of a curved valley, a little too large. On the way, a few evaluations suffice. Where J has
   !> risen at two steps in succession, and is above `hopeless`, the way ends.
   !>
   !> problem     on return at any parameters
   !> rows        m, number of its residuals
   !> variables   (n) with their bounds
   !> k           index of the parameter
   !> value       to which it is moved
   !> hopeless    a sum of squares
   !> parameters  (n) on entry a minimum for their k-th value, on return the minimum for `value`, or
   !>             for the value at which the way has ended
   !> error       a fit failed
   subroutine minimise_at(problem, rows, variables, k, value, hopeless, parameters, error)
      class(smooth_problem_t), intent(inout), target :: problem
      integer, intent(in) :: rows, k
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: value, hopeless
      real(wp), intent(inout) :: parameters(:)
      type(error_t), allocatable, intent(out) :: error
      type(section_t) :: section
      real(wp) :: J, before, step
      integer :: rises

      call new_section(section, problem, rows, variables, k, 0.0_wp, 1.0_wp)
      before = hopeless
      rises = 0
      do while (abs(value - parameters(k)) > 0 .and. rises < 2)
         step = max(abs(parameters(k)), variables(k)%magnitude)
         parameters(k) = parameters(k) + max(-step, min(step, value - parameters(k)))
         call minimise(section, parameters, J, error, &
            tolerance=merge(1e-2_wp, 1e-3_wp, abs(value - parameters(k)) > 0))
         if (allocated(error)) return
         rises = merge(rises + 1, 0, J > max(before, hopeless))
         before = J
      end do
   end subroutine minimise_at

   !> Finds the value at which the distance is 1, between a point inside the interval and one
   !> outside: by the secant of the distance, which is nearly linear, and by every fourth step a
   !> bisection.
   !>
   !> inside, outside            (n) parameters of the two points
   !> distance_in, distance_out  distances of the two points
   !> J_out                      sum of squares outside
   !> side                       on return with the end of the interval
   subroutine find_end(section, inside, outside, distance_in, distance_out, J_out, side)
      type(section_t), intent(inout) :: section
      real(wp), intent(in) :: inside(:), outside(:), distance_in, distance_out, J_out
      type(side_t), intent(inout) :: side
      integer, parameter :: max_steps = 60
      real(wp), parameter :: close_enough = 1e-6_wp
      type(error_t), allocatable :: error
      real(wp), dimension(size(inside)) :: inner, outer, p
      real(wp) :: z(2), distance, share, J
      integer :: i, k

      k = section%fixed
      inner = inside
      outer = outside
      z = [distance_in, distance_out]
      p = outer
      distance = distance_out
      J = J_out
      do i = 1, max_steps
         if (abs(distance - 1) <= close_enough) exit
         share = (1 - z(1))/(z(2) - z(1))
         if (modulo(i, 4) == 0) share = 0.5_wp
         p = inner + min(max(share, 0.02_wp), 0.98_wp)*(outer - inner)
         if (.not. abs(p(k) - inner(k)) > 0 .or. .not. abs(p(k) - outer(k)) > 0) exit
         call minimise(section, p, J, error)
         if (allocated(error)) then
            side%end = inner(k)
            side%reason = error%message
            return
         end if
         distance = distance_of(section, J)
         if (distance < 1) then
            inner = p
            z(1) = distance
         else
            outer = p
            z(2) = distance
         end if
      end do
      side%end = p(k)
      if (abs(distance - 1) > 1e-2_wp .and. abs(outer(k) - inner(k)) > 1e-3_wp &
         *abs(outer(k) - side%value(1))) then
         side%reason = 'between '//to_text(inner(k))//' and '//to_text(outer(k))// &
            ' no value was found with J at the 95 % level'
         return
      end if
      call add_point(side, k, p, J, distance)
      side%state = is_closed
   end subroutine find_end

   !> Appends a point to a side.
   subroutine add_point(side, k, parameters, J, distance)
      type(side_t), intent(inout) :: side
      integer, intent(in) :: k
      real(wp), intent(in) :: parameters(:), J, distance

      side%value = [side%value, parameters(k)]
      side%J = [side%J, J]
      side%distance = [side%distance, distance]
      side%parameters = reshape([side%parameters, parameters], [size(parameters), size(side%J)])
   end subroutine add_point

end module beamid_profile_likelihood
