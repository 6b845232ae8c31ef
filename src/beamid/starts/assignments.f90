!> Which line of a record belongs to which mode of the model. A mode may stay unseen.
module beamid_assignments
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_model_roots, only: belief_t, damps, model_roots
   use beamid_projection, only: new_projection, projection_t
   use beamid_residuals, only: residual_t
   use beamid_spectra, only: line_t
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: assignment_t, lines_t, best_assignments

   !> The lines of one record.
   type :: lines_t
      type(line_t), allocatable :: line(:)
   end type lines_t

   !> One way to assign, and what it makes of the parameters.
   type :: assignment_t
      integer, allocatable :: place(:, :)   !< (modes, records) the line of each mode, 0: unseen
      real(wp), allocatable :: value(:)     !< (free) start values
      real(wp) :: price = 0                 !< of the lines and of the modes that have none
      real(wp) :: cost = 0                  !< with what the parameters and frequencies add
   end type assignment_t

   !> What speaks against an assignment, in squares of standard deviations: a frequency that the
   !> model does not meet, a mode without a line, a line that is a multiple of another.
   real(wp), parameter :: frequency_error = 4e-3_wp, unseen = 9, multiple = 6

   !> Assignments that are kept while records are added, and modes that are looked for.
   integer, parameter :: kept = 6, most_modes = 4

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

contains

   !> The best ways to assign, the best one first; at least one, which may be that of no line.
   !>
   !> problem  with what is free in place
   !> beliefs  (free)
   !> lines    (records)
   !> modes    of the model that are looked for, at most
   subroutine best_assignments(problem, beliefs, lines, modes, most, best, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: modes, most
      type(assignment_t), allocatable, intent(out) :: best(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(min(modes, most_modes)), ds(size(s), size(beliefs))
      type(assignment_t), allocatable :: before(:)
      type(assignment_t) :: tried
      integer, allocatable :: options(:, :)
      integer :: j, k, r

      allocate (tried%place(size(s), size(lines)), source=0)
      tried%value = beliefs%centre
      best = [tried]
      do r = 1, size(lines)
         call model_roots(problem, problem%scenario, r, s, ds, error)
         if (allocated(error)) return
         options = ways(lines(r)%line, aimag(s)/two_pi)
         call move_alloc(best, before)
         allocate (best(0))
         do j = 1, size(before)
            do k = 1, size(options, 2)
               tried = before(j)
               tried%place(:, r) = options(:, k)
               tried%price = before(j)%price + price_of(lines(r)%line, options(:, k))
               if (size(best) == kept) then
                  if (tried%price > best(kept)%cost) cycle
               end if
               call meet(problem, beliefs, lines(:r), tried, error)
               if (.not. allocated(error)) call insert(best, tried)
            end do
         end do
         if (size(best) == 0) return
         if (allocated(error)) deallocate (error)
      end do
      best = best(:min(most, size(best)))
      do k = 1, size(best)
         call set_damping(problem, beliefs, lines, best(k), error)
         if (allocated(error)) return
      end do
   end subroutine best_assignments

   !> Keeps the best assignments in order.
   subroutine insert(best, new)
      type(assignment_t), allocatable, intent(inout) :: best(:)
      type(assignment_t), intent(in) :: new
      integer :: k

      k = count(best%cost <= new%cost)
      best = [best(:k), new, best(k + 1:)]
      best = best(:min(kept, size(best)))
   end subroutine insert

   !> Every way to give lines to modes in ascending order, each within a factor 2 of the model's
   !> frequency; of many modes only the strongest lines count.
   !>
   !> lines        the strongest first
   !> frequencies  of the model, ascending
   !> options      (modes, ways)
   pure function ways(lines, frequencies) result(options)
      type(line_t), intent(in) :: lines(:)
      real(wp), intent(in) :: frequencies(:)
      integer, allocatable :: options(:, :), longer(:, :)
      real(wp) :: highest
      integer :: j, k, m, n, w

      allocate (options(size(frequencies), 1), source=0)
      do m = 1, size(frequencies)
         allocate (longer(size(frequencies), size(options, 2)*(1 + size(lines))))
         w = 0
         do j = 1, size(options, 2)
            highest = 0
            do k = 1, m - 1
               if (options(k, j) > 0) highest = lines(options(k, j))%frequency
            end do
            do n = 0, min(size(lines), merge(12, 7, size(frequencies) < 3))
               if (n > 0) then
                  if (lines(n)%frequency <= highest .or. &
                     abs(log(lines(n)%frequency/frequencies(m))) > log(2.0_wp)) cycle
               end if
               w = w + 1
               longer(:, w) = options(:, j)
               longer(m, w) = n
            end do
         end do
         options = longer(:, :w)
         deallocate (longer)
      end do
   end function ways

   !> What an assignment costs before the model is asked.
   pure real(wp) function price_of(lines, place) result(price)
      type(line_t), intent(in) :: lines(:)
      integer, intent(in) :: place(:)
      integer :: k

      price = unseen*count(place == 0)
      do k = 1, size(place)
         if (place(k) == 0) cycle
         associate (line => lines(place(k)))
            price = price - log(max(line%energy, tiny(price)))/2
            if (line%harmonic > 0 .or. line%mains) price = price + multiple
         end associate
      end do
   end function price_of

   !> The parameters but for damping that bring the model's frequencies nearest to the lines while
   !> they stay near what is believed, by Gauss-Newton steps.
   subroutine meet(problem, beliefs, lines, found, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      type(assignment_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 12
      real(wp) :: u(size(beliefs)), step(size(beliefs))
      real(wp), allocatable :: r(:), jac(:, :)
      type(projection_t) :: projection
      integer :: k

      u = (beliefs%x_of(found%value) - beliefs%x_of(beliefs%centre))/beliefs%width
      do k = 1, most
         call compare(problem, beliefs, lines, found, u, r, jac, error)
         if (allocated(error)) return
         found%cost = found%price + sum(r**2)
         call new_projection(jac, projection, error)
         if (allocated(error)) return
         call projection%coefficients(r, step)
         u = u + step*min(1.0_wp, 2/max(maxval(abs(step)), tiny(1.0_wp)))
         found%value = max(beliefs%value_of(beliefs%x_of(beliefs%centre) + beliefs%width*u), 0.0_wp)
         if (maxval(abs(step)) < 1e-4_wp) exit
      end do
   end subroutine meet

   !> Differences of the logarithms of frequencies, then of the parameters from what is believed.
   !>
   !> u    (free) in standard deviations
   !> r    (n)
   !> jac  (n, free) by u
   subroutine compare(problem, beliefs, lines, found, u, r, jac, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      type(assignment_t), intent(in) :: found
      real(wp), intent(in) :: u(:)
      real(wp), allocatable, intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(size(found%place, 1)), ds(size(s), size(u))
      type(scenario_t) :: scenario
      integer :: i, k, n

      n = size(lines)*size(s)
      allocate (r(n + size(u)), jac(n + size(u), size(u)), source=0.0_wp)
      scenario = problem%with(found%value)
      do i = 1, size(lines)
         call model_roots(problem, scenario, i, s, ds, error)
         if (allocated(error)) return
         do k = 1, size(u)
            if (damps(ds(:, k))) ds(:, k) = 0
         end do
         do k = 1, size(s)
            if (found%place(k, i) == 0) cycle
            associate (row => (i - 1)*size(s) + k, line => lines(i)%line(found%place(k, i)))
               r(row) = log(aimag(s(k))/(two_pi*line%frequency))/frequency_error
               jac(row, :) = aimag(ds(k, :))/aimag(s(k))*beliefs%slope(found%value) &
                  *beliefs%width/frequency_error
            end associate
         end do
      end do
      do k = 1, size(u)
         r(n + k) = u(k)
         jac(n + k, k) = 1
      end do
   end subroutine compare

   !> Parameters that move roots along the real axis take values that are not negative and bring the
   !> rates of decay nearest to those of the lines.
   subroutine set_damping(problem, beliefs, lines, found, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      type(assignment_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(size(found%place, 1)), ds(size(s), size(beliefs))
      real(wp), dimension(size(s)*size(lines) + size(beliefs), size(beliefs)) :: a
      real(wp) :: b(size(a, 1)), width(size(beliefs)), sd
      complex(wp) :: roots(size(s), size(lines), size(beliefs))
      logical :: free(size(beliefs))
      type(scenario_t) :: scenario
      integer :: i, k, row

      a = 0
      b = 0
      scenario = problem%with(found%value)
      do i = 1, size(lines)
         call model_roots(problem, scenario, i, s, ds, error)
         if (allocated(error)) return
         roots(:, i, :) = ds
         do k = 1, size(s)
            if (found%place(k, i) == 0) cycle
            row = (i - 1)*size(s) + k
            associate (line => lines(i)%line(found%place(k, i)))
               sd = 0.3_wp*line%decay + 3e-4_wp*aimag(s(k))
               a(row, :) = -real(ds(k, :))/sd
               b(row) = (line%decay + real(s(k)))/sd + dot_product(a(row, :), found%value)
            end associate
         end do
      end do
      width = 3*merge(beliefs%centre, beliefs%width, beliefs%logarithmic)
      do k = 1, size(beliefs)
         a(size(s)*size(lines) + k, k) = 1/width(k)
         b(size(s)*size(lines) + k) = found%value(k)/width(k)
      end do
      do k = 1, size(beliefs)
         free(k) = damps(reshape(roots(:, :, k), [size(s)*size(lines)]))
      end do
      call not_negative_least_squares(a, b, free, found%value)
   end subroutine set_damping

   !> Minimises |a x - b| over those x that are free, none of them negative, one at a time.
   pure subroutine not_negative_least_squares(a, b, free, x)
      real(wp), intent(in) :: a(:, :), b(:)
      logical, intent(in) :: free(:)
      real(wp), intent(inout) :: x(:)
      integer, parameter :: sweeps = 300
      real(wp) :: r(size(b)), next
      integer :: k, sweep

      r = b - matmul(a, x)
      do sweep = 1, sweeps
         do k = 1, size(x)
            if (.not. free(k)) cycle
            next = max(0.0_wp, x(k) + dot_product(a(:, k), r)/sum(a(:, k)**2))
            r = r - a(:, k)*(next - x(k))
            x(k) = next
         end do
      end do
   end subroutine not_negative_least_squares

end module beamid_assignments
