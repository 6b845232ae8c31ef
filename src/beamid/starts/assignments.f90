!> Assignment of the spectral lines of a record to the modes of the model. A mode may be without a
!> line.
module beamid_assignments
   use beamid_errors, only: error_t
   use beamid_kinds, only: two_pi, wp
   use beamid_model_roots, only: belief_t, damps, model_roots
   use beamid_projection, only: new_projection, projection_t
   use beamid_residuals, only: residual_t
   use beamid_spectra, only: line_t
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: assignment_t, lines_t, best_assignments, fit_frequencies

   !> The spectral lines of one record.
   type :: lines_t
      type(line_t), allocatable :: line(:)
   end type lines_t

   !> One assignment, and the parameter values that suit it.
   type :: assignment_t
      !> (modes, records) number of the line of each mode; 0: the mode has no line
      integer, allocatable :: place(:, :)
      real(wp), allocatable :: value(:)     !< (free) start values of the searched variables
      real(wp) :: price = 0   !< penalty for the choice of lines and for modes without a line
      real(wp) :: cost = 0    !< price plus the misfit of frequencies and parameters
   end type assignment_t

   !> Terms of the cost of an assignment, which is in squares of standard deviations: relative
   !> standard deviation of the frequencies of the model, penalty for a mode without a line, and
   !> penalty for a line that is a multiple of another one.
   real(wp), parameter :: frequency_error = 4e-3_wp, unseen = 9, multiple = 6

   !> Number of assignments that are kept while records are added, and largest number of modes that
   !> are assigned.
   integer, parameter :: kept = 6, most_modes = 4

contains

   !> Returns the best assignments, the best one first. There is at least one, perhaps without any
   !> line.
   !>
   !> problem  the fit with its free parameters
   !> beliefs  (free) expected values
   !> lines    (records) spectral lines
   !> modes    number of modes of the model
   !> most     largest number of assignments to return
   !> error    the roots of the model cannot be computed
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
         options = assignments_of(lines(r)%line, aimag(s)/two_pi)
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
               call fit_frequencies(problem, beliefs, lines(:r), frequency_error, tried, error)
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

   !> Inserts an assignment into the list of the best ones, in ascending order of cost.
   subroutine insert(best, new)
      type(assignment_t), allocatable, intent(inout) :: best(:)
      type(assignment_t), intent(in) :: new
      integer :: k

      k = count(best%cost <= new%cost)
      best = [best(:k), new, best(k + 1:)]
      best = best(:min(kept, size(best)))
   end subroutine insert

   !> Returns every assignment of lines to modes in ascending order, each line within a factor 2 of
   !> the frequency of its mode. If the modes are many, only the strongest lines are used.
   !>
   !> lines        spectral lines, the strongest first
   !> frequencies  (modes) frequencies of the model, ascending [1/time]
   !> options      (modes, assignments) number of the line of each mode; 0: none
   pure function assignments_of(lines, frequencies) result(options)
      type(line_t), intent(in) :: lines(:)
      real(wp), intent(in) :: frequencies(:)
      integer, allocatable :: options(:, :), longer(:, :)
      real(wp) :: highest
      integer :: j, k, m, n, found

      allocate (options(size(frequencies), 1), source=0)
      do m = 1, size(frequencies)
         allocate (longer(size(frequencies), size(options, 2)*(1 + size(lines))))
         found = 0
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
               found = found + 1
               longer(:, found) = options(:, j)
               longer(m, found) = n
            end do
         end do
         options = longer(:, :found)
         deallocate (longer)
      end do
   end function assignments_of

   !> Returns the part of the cost that does not depend on the model.
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

   !> Fits the parameters, except damping, to the frequencies of the assigned lines and to their
   !> expected values, by Gauss-Newton steps.
   !>
   !> accuracy  relative standard deviation of the frequencies
   !> found     the assignment; on return with value and cost
   !> error     the roots cannot be computed
   subroutine fit_frequencies(problem, beliefs, lines, accuracy, found, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      real(wp), intent(in) :: accuracy
      type(assignment_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 12
      real(wp) :: u(size(beliefs)), step(size(beliefs))
      real(wp), allocatable :: r(:), jac(:, :)
      type(projection_t) :: projection
      integer :: k

      u = (beliefs%x_of(found%value) - beliefs%x_of(beliefs%centre))/beliefs%width
      do k = 1, most
         call frequency_residuals(problem, beliefs, lines, accuracy, found, u, r, jac, error)
         if (allocated(error)) return
         found%cost = found%price + sum(r**2)
         call new_projection(jac, projection, error)
         if (allocated(error)) return
         call projection%coefficients(r, step)
         u = u + step*min(1.0_wp, 2/max(maxval(abs(step)), tiny(1.0_wp)))
         found%value = max(beliefs%value_of(beliefs%x_of(beliefs%centre) + beliefs%width*u), 0.0_wp)
         if (maxval(abs(step)) < 1e-4_wp) exit
      end do
   end subroutine fit_frequencies

   !> Computes the residuals of an assignment: differences of the logarithms of frequencies, then
   !> distances of the parameters from their expected values.
   !>
   !> accuracy  relative standard deviation of the frequencies
   !> u         (free) distances from the expected values [standard deviations]
   !> r         (n) residuals [standard deviations]
   !> jac       (n, free) derivatives with respect to u
   subroutine frequency_residuals(problem, beliefs, lines, accuracy, found, u, r, jac, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      real(wp), intent(in) :: accuracy
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
               r(row) = log(aimag(s(k))/(two_pi*line%frequency))/accuracy
               jac(row, :) = aimag(ds(k, :))/aimag(s(k))*beliefs%slope(found%value) &
                  *beliefs%width/accuracy
            end associate
         end do
      end do
      do k = 1, size(u)
         r(n + k) = u(k)
         jac(n + k, k) = 1
      end do
   end subroutine frequency_residuals

   !> Sets the damping parameters to non-negative values that fit the decay rates of the assigned
   !> lines.
   !>
   !> found  the assignment; on return with the values of damping
   subroutine set_damping(problem, beliefs, lines, found, error)
      type(residual_t), intent(inout) :: problem
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      type(assignment_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(size(found%place, 1)), ds(size(s), size(beliefs))
      real(wp), dimension(size(s)*size(lines) + size(beliefs), size(beliefs)) :: matrix
      real(wp) :: rhs(size(matrix, 1)), width(size(beliefs)), sd
      complex(wp) :: roots(size(s), size(lines), size(beliefs))
      logical :: is_damping(size(beliefs))
      type(scenario_t) :: scenario
      integer :: i, k, row

      matrix = 0
      rhs = 0
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
               matrix(row, :) = -real(ds(k, :))/sd
               rhs(row) = (line%decay + real(s(k)))/sd + dot_product(matrix(row, :), found%value)
            end associate
         end do
      end do
      width = 3*merge(beliefs%centre, beliefs%width, beliefs%logarithmic)
      do k = 1, size(beliefs)
         matrix(size(s)*size(lines) + k, k) = 1/width(k)
         rhs(size(s)*size(lines) + k) = found%value(k)/width(k)
      end do
      do k = 1, size(beliefs)
         is_damping(k) = damps(reshape(roots(:, :, k), [size(s)*size(lines)]))
      end do
      call non_negative_least_squares(matrix, rhs, is_damping, found%value)
   end subroutine set_damping

   !> Minimises |a x - b| over the components of x that are free, under the condition x >= 0, by
   !> coordinate descent.
   pure subroutine non_negative_least_squares(a, b, free, x)
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
   end subroutine non_negative_least_squares

end module beamid_assignments
