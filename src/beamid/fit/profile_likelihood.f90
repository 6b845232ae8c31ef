!> The profile of a sum of squares: the least J at each value of one parameter, all others fitted
!> again; where it has risen by as much as 95 % of all records let it, the interval ends.
!>
!> Where residuals are linear in the parameters these intervals are those of linear theory; where
!> they are not they may be lopsided, end at a bound, or have no end (Bates and Watts, Nonlinear
!> Regression Analysis, 1988, section 6.1).
module beamid_profile_likelihood
   use beamid_errors, only: error_t
   use beamid_gauss_newton, only: least_squares_step, scales_of
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_problems, only: smooth_problem_t
   use beamid_strings, only: to_text
   use beamid_variables, only: unbounded, variable_t
   implicit none
   private

   public :: side_t, follow_profile

   !> How a side of a profile ends: where J has risen so far; at a bound, before that; nowhere, J
   !> stays below whatever the value; or where a fit failed, and the end is not known.
   integer, parameter, public :: is_closed = 1, at_bound = 2, is_open = 3, is_lost = 4

   !> One side of the profile of a parameter, from the estimate outwards.
   type :: side_t
      integer :: state = is_lost
      real(wp) :: end = 0                       !< of the interval
      real(wp), allocatable :: value(:)         !< (points) of the parameter
      real(wp), allocatable :: J(:)             !< (points) least sum of squares there
      !> (points) sqrt((J - J_min)/rise): 1 at the end of the interval
      real(wp), allocatable :: distance(:)
      real(wp), allocatable :: parameters(:, :) !< (n, points)
      character(len=:), allocatable :: reason   !< why it is lost; else ''
   end type side_t

   !> The sum of squares with one parameter held.
   type, extends(smooth_problem_t) :: section_t
      class(smooth_problem_t), pointer :: whole => null()
      integer :: held = 0
      real(wp) :: value = 0
   contains
      procedure :: residuals
      procedure :: jacobian
   end type section_t

   !> Aimed at between two points, in `distance`.
   real(wp), parameter :: pace = 0.25_wp

   !> Beyond so many times what is moderate, or so near to a bound in parts of the estimate's own
   !> distance, nothing is asked any more.
   real(wp), parameter :: far = 1e8_wp, near = 1e-3_wp

contains

   !> Follows the profile of parameter k from the estimate to one side.
   !>
   !> problem    on return anywhere
   !> rows       of its residuals
   !> variables  (n) with their bounds
   !> estimate   (n) where J is least
   !> J_min      its sum of squares
   !> k          the parameter
   !> direction  -1 or 1
   !> rise       of J at the end of the interval, > 0
   !> first      length of a step by which J may rise by `rise`, > 0, as linear theory has it
   !> monitor    hears of each point
   subroutine follow_profile(problem, rows, variables, estimate, J_min, k, direction, rise, first, &
      side, monitor)
      class(smooth_problem_t), intent(inout), target :: problem
      integer, intent(in) :: rows, k, direction
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: estimate(:), J_min, rise, first
      type(side_t), intent(out) :: side
      class(monitor_t), intent(inout), optional :: monitor
      integer, parameter :: most = 200, most_halvings = 8
      type(section_t) :: section
      type(error_t), allocatable :: error
      real(wp) :: here(size(estimate)), there(size(estimate)), slopes(size(estimate))
      real(wp) :: bound, step, z, J, limit
      integer :: halvings, i

      section%whole => problem
      section%held = k
      section%exact = problem%exact
      bound = merge(variables(k)%lower, variables(k)%upper, direction < 0)
      limit = far*max(abs(estimate(k)), variables(k)%magnitude)
      side%reason = ''
      here = estimate
      allocate (side%value(0), side%J(0), side%distance(0), side%parameters(size(here), 0))
      call add_point(side, k, here, J_min, 0.0_wp)
      if (abs(bound) < unbounded .and. abs(estimate(k) - bound) <= near*variables(k)%magnitude) then
         side%state = at_bound
         side%end = bound
         return
      end if
      ! Only the first step has the estimate's own derivatives to go by.
      call directions(section, rows, variables, here, slopes)
      step = min(pace*first, limit/10)
      halvings = 0
      do i = 1, most
         there = ahead(here, slopes, direction*step)
         call minimise(section, rows, variables, there, J, error)
         if (allocated(error)) then
            halvings = halvings + 1
            step = abs(there(k) - here(k))/4
            if (halvings <= most_halvings .and. step > 0) cycle
            side%end = here(k)
            side%reason = error%message
            return
         end if
         z = sqrt(max(0.0_wp, J - J_min)/rise)
         if (z >= 1) then
            call find_end(section, rows, variables, here, there, side%distance(size(side%J)), z, &
               J, J_min, rise, side)
            return
         end if
         step = abs(there(k) - here(k))
         associate (gain => z - side%distance(size(side%J)))
            step = step*min(3.0_wp, pace/max(gain, pace/3))
         end associate
         here = there
         call add_point(side, k, here, J, z)
         if (present(monitor)) then
            !$omp critical (one_side_done)
            call monitor%advanced(size(side%J), 0, 'points of a profile')
            !$omp end critical (one_side_done)
         end if
         if (abs(here(k) - bound) <= near*abs(estimate(k) - bound)) then
            side%state = at_bound
            side%end = bound
            return
         end if
         if (abs(here(k)) >= limit) then
            side%state = is_open
            side%end = direction*unbounded
            return
         end if
         call directions(section, rows, variables, here, slopes)
      end do
      side%end = here(k)
      side%reason = 'the sum of squares neither rises nor stays'

   contains

      !> A step along the curve of minima, within the bounds. The model may have no value at a
      !> bound, and a curve of minima may lead all parameters to theirs: no step goes all the way.
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

   !> The value at which the distance is 1, between two points of which one is nearer and one is
   !> farther: by the chord of the distance, nearly a line, and where that is slow by halves.
   subroutine find_end(section, rows, variables, inside, outside, z_in, z_out, J_out, J_min, rise, &
      side)
      type(section_t), intent(inout) :: section
      integer, intent(in) :: rows
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: inside(:), outside(:), z_in, z_out, J_out, J_min, rise
      type(side_t), intent(inout) :: side
      integer, parameter :: most = 60
      real(wp), parameter :: close_enough = 1e-6_wp
      type(error_t), allocatable :: error
      real(wp), dimension(size(inside)) :: inner, outer, p
      real(wp) :: z(2), zp, share, J
      integer :: i

      inner = inside
      outer = outside
      z = [z_in, z_out]
      p = outer
      zp = z_out
      J = J_out
      do i = 1, most
         if (abs(zp - 1) <= close_enough) exit
         share = (1 - z(1))/(z(2) - z(1))
         if (modulo(i, 4) == 0) share = 0.5_wp
         p = inner + min(max(share, 0.02_wp), 0.98_wp)*(outer - inner)
         if (.not. abs(p(section%held) - inner(section%held)) > 0 .or. &
            .not. abs(p(section%held) - outer(section%held)) > 0) exit
         call minimise(section, rows, variables, p, J, error)
         if (allocated(error)) then
            side%end = inner(section%held)
            side%reason = error%message
            return
         end if
         zp = sqrt(max(0.0_wp, J - J_min)/rise)
         if (zp < 1) then
            inner = p
            z(1) = zp
         else
            outer = p
            z(2) = zp
         end if
      end do
      side%end = p(section%held)
      associate (k => section%held)
         if (abs(zp - 1) > 1e-2_wp .and. abs(outer(k) - inner(k)) > 1e-3_wp &
            *abs(outer(k) - side%value(1))) then
            side%reason = 'between '//to_text(inner(k))//' and '//to_text(outer(k))// &
               ' no value was found with J at the level of 95 %'
            return
         end if
         call add_point(side, k, p, J, zp)
      end associate
      side%state = is_closed
   end subroutine find_end

   !> Minimises over all other parameters.
   !>
   !> parameters  (n) on return where J is least
   subroutine minimise(section, rows, variables, parameters, J, error)
      type(section_t), intent(inout) :: section
      integer, intent(in) :: rows
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(inout) :: parameters(:)
      real(wp), intent(out) :: J
      type(error_t), allocatable, intent(out) :: error
      type(variable_t) :: others(size(variables) - 1)
      type(options_t) :: options
      type(fit_t) :: found

      section%value = parameters(section%held)
      others = without(variables, section%held)
      ! What has followed the one that is held to a thousandth of its size is at no bound yet.
      others%magnitude = max(1e-4_wp*others%magnitude, min(others%magnitude, &
         abs(pick(parameters, section%held))))
      others = others%from(pick(parameters, section%held))
      options%check = .false.
      options%tolerance = 1e-9_wp
      J = 0
      call fit(section, rows, others, options, found, error)
      if (allocated(error)) return
      parameters = all_of(section, found%estimate)
      J = found%J
   end subroutine minimise

   !> (n) how all parameters move along the curve of minima, for a unit of the one that is held: to
   !> first order, by the derivatives here; where these fail they stay.
   subroutine directions(section, rows, variables, parameters, slopes)
      type(section_t), intent(inout) :: section
      integer, intent(in) :: rows
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: slopes(:)
      real(wp) :: r(rows), jac(rows, size(parameters))
      type(error_t), allocatable :: error
      logical :: moves(size(parameters))
      integer :: rank, k

      slopes = 0
      slopes(section%held) = 1
      if (.not. section%exact) return
      call section%whole%jacobian(parameters, r, jac, error)
      if (allocated(error)) return
      moves = [(k /= section%held .and. .not. variables(k)%is_at_bound(parameters(k)), &
         k=1, size(parameters))]
      call least_squares_step(jac, jac(:, section%held), scales_of(variables, parameters), moves, &
         epsilon(1.0_wp)*rows, slopes, rank)
      slopes(section%held) = 1
   end subroutine directions

   subroutine add_point(side, k, parameters, J, z)
      type(side_t), intent(inout) :: side
      integer, intent(in) :: k
      real(wp), intent(in) :: parameters(:), J, z
      real(wp), allocatable :: longer(:, :)
      integer :: n

      n = size(side%J)
      side%value = [side%value, parameters(k)]
      side%J = [side%J, J]
      side%distance = [side%distance, z]
      allocate (longer(size(parameters), n + 1))
      longer(:, :n) = side%parameters
      longer(:, n + 1) = parameters
      call move_alloc(longer, side%parameters)
   end subroutine add_point

   subroutine residuals(self, parameters, r, error)
      class(section_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      call self%whole%residuals(all_of(self, parameters), r, error)
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(section_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: whole(size(jac, 1), size(jac, 2) + 1)

      call self%whole%jacobian(all_of(self, parameters), r, whole, error)
      if (allocated(error)) return
      jac(:, :self%held - 1) = whole(:, :self%held - 1)
      jac(:, self%held:) = whole(:, self%held + 1:)
   end subroutine jacobian

   !> (n) the held one in its place among the others.
   pure function all_of(self, others) result(parameters)
      class(section_t), intent(in) :: self
      real(wp), intent(in) :: others(:)
      real(wp) :: parameters(size(others) + 1)

      parameters = [others(:self%held - 1), self%value, others(self%held:)]
   end function all_of

   pure function without(variables, k) result(rest)
      type(variable_t), intent(in) :: variables(:)
      integer, intent(in) :: k
      type(variable_t) :: rest(size(variables) - 1)

      rest = [variables(:k - 1), variables(k + 1:)]
   end function without

   pure function pick(values, k) result(rest)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: k
      real(wp) :: rest(size(values) - 1)

      rest = [values(:k - 1), values(k + 1:)]
   end function pick

end module beamid_profile_likelihood
