!> Tests whether free decays contain harmonics of the first mode beside the higher modes.
!>
!> A spring, a clamp or a sensor that is not linear adds harmonics: oscillations at multiples of the
!> frequency of the first mode. A harmonic close to another mode shifts the estimates, even if both
!> merge into one spectral line.
!>
!> One harmonic is tested for each mode from the second on, in all records together: many small
!> harmonics may shift an estimate that none of them shifts alone. In each record it is any
!> combination of four oscillations of the same frequency: cosine and sine that decay at the rate of
!> the first mode, like an error of the sensor in proportion to the motion, and cosine and sine that
!> decay at n times this rate, like the n-th power of the motion. Residuals near a mode that have
!> another cause, such as a damping that changes, can look like a harmonic.
module beamid_harmonics
   use beamid_condensation, only: condense, condensed_t, rows_t
   use beamid_distributions, only: chi_square_tail, incomplete_beta
   use beamid_experiments, only: experiment_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kernels, only: block_rows
   use beamid_kinds, only: two_pi, wp
   use beamid_scores, only: chance, find_largest_shift, is_testable, large_shift, score_test_t
   use beamid_spectra, only: noise_near
   use beamid_stage_fits, only: stage_fit_t
   implicit none
   private

   public :: test_harmonics

   integer, parameter :: waves = 4   !< cosine and sine with either decay

   !> The rows of one record: the oscillation, if it is tested there, the estimates, the residuals.
   type, extends(rows_t) :: record_rows_t
      real(wp), pointer :: jacobian(:, :) => null(), residual(:) => null()
      real(wp), pointer :: t(:) => null()   !< (rows) sample times [time]
      integer :: order = 0                  !< of the harmonic; 0: none
      complex(wp) :: s = 0                  !< root of the first mode [1/time]
   contains
      procedure :: fill, oscillation
   end type record_rows_t

contains

   !> Tests the harmonics of the first mode, and extends the intervals of the estimates that one of
   !> them shifts.
   !>
   !> s      (modes, records) roots of the fitted structures [1/time]
   !> fit    with statistics; on return with extended intervals
   !> tests  one for each mode beside a harmonic, of size 0 if there is none
   subroutine test_harmonics(experiments, s, fit, tests)
      type(experiment_t), intent(in) :: experiments(:)
      complex(wp), intent(in) :: s(:, :)
      type(stage_fit_t), intent(inout) :: fit
      type(score_test_t), allocatable, intent(out) :: tests(:)
      integer :: orders(size(experiments)), k, r

      allocate (tests(0))
      if (.not. is_testable(experiments, fit)) return
      if (size(fit%jacobian, 2) /= size(fit%quantities)) return
      do k = 2, size(s, 1)
         orders = 0
         do r = 1, size(experiments)
            if (k <= experiments(r)%excitation%modes .and. size(experiments(r)%samples) > 0) &
               orders(r) = order_beside(s(:, r), k)
         end do
         if (any(orders > 0)) tests = [tests, test_of_mode(experiments, s, orders, k, fit)]
      end do
      do k = 1, size(tests)
         associate (one => tests(k))
            ! A harmonic that shifts nothing is a spectral line of its own, and residuals that
            ! vanish on a finer mesh are errors of the mesh.
            one%rejects = one%p_value < chance/size(tests) .and. one%moves > large_shift .and. &
               one%decrease > 2*fit%mesh_decrease
            one%matters = one%rejects
            if (one%matters) call fit%extend(one%shift(:size(fit%free)))
         end associate
      end do
   end subroutine test_harmonics

   !> Returns the order of the harmonic next to a mode; 0: the frequency of the mode is too low or
   !> too high, or the mode before it is next to the same harmonic.
   !>
   !> s  (modes) roots [1/time]
   !> k  number of the mode, from 2
   pure integer function order_beside(s, k) result(order)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: k
      integer, parameter :: highest = 12

      order = 0
      if (.not. aimag(s(1)) > 0) return
      if (aimag(s(k)) > (highest + 0.5_wp)*aimag(s(1))) return
      order = nint(aimag(s(k))/aimag(s(1)))
      if (order < 2 .or. order == nint(aimag(s(k - 1))/aimag(s(1)))) order = 0
   end function order_beside

   !> Tests the harmonics beside one mode by one Gauss-Newton step.
   !>
   !> The decrease of J in units of the variance of the noise around the frequency has a chi-square
   !> distribution. Other lines in the residuals do not count as noise. In short records this
   !> variance is uncertain: therefore the F test of the whole decrease must reject the model, too.
   !>
   !> s       (modes, records) roots [1/time]
   !> orders  (records) of the harmonic; 0: the record is not tested
   !> k       number of the mode
   function test_of_mode(experiments, s, orders, k, fit) result(one)
      type(experiment_t), intent(in) :: experiments(:)
      complex(wp), intent(in) :: s(:, :)
      integer, intent(in) :: orders(:), k
      type(stage_fit_t), intent(in) :: fit
      type(score_test_t) :: one
      real(wp), allocatable :: a(:, :), y(:)
      real(wp) :: scales(size(fit%quantities)), after(size(experiments)), gain, left
      integer :: ends(0:size(experiments)), freedom, n, r, rank, used

      n = size(scales)
      one = score_test_t(name='harmonic', mode=k, shift=spread(0.0_wp, 1, n))
      call eliminate_oscillations(experiments, s(1, :), orders, fit, a, y, ends, after, used)
      freedom = size(fit%jacobian, 1) - n - used
      if (used == 0 .or. freedom < 1) return
      scales = fit%quantities%scale
      call least_squares_step(a, y, scales, spread(.true., 1, n), &
         epsilon(scales)*size(fit%residual), one%shift, rank)
      y = y + matmul(a, one%shift)
      do r = 1, size(experiments)
         after(r) = after(r) + sum(y(ends(r - 1) + 1:ends(r))**2)
      end do
      left = (sum(after) + sum(y(ends(size(experiments)) + 1:)**2))/sum(fit%fit%residual**2)
      one%decrease = 1 - left
      call compare_with_noise(experiments, s(1, :), orders, fit, after, gain, one%record)
      one%order = orders(one%record)
      one%value = one%order*aimag(s(1, one%record))/two_pi
      one%fades = one%order*real(s(1, one%record)) < real(s(k, one%record))
      one%p_value = max(chi_square_tail(gain, real(used, wp)), &
         incomplete_beta(freedom/2.0_wp, used/2.0_wp, min(1.0_wp, left)))
      call find_largest_shift(fit, one)
   end function test_of_mode

   !> Condenses the rows of the fit, and removes those that the oscillations can make 0.
   !>
   !> s       (records) root of the first mode [1/time]
   !> orders  (records) of the harmonic; 0: none
   !> a, y    (rows, parameters), (rows) derivatives and residuals: those of the records, then those
   !>         of priors and penalties, then zeros
   !> ends    (0 .. records) last row of each record
   !> after   (records) sum of squares of a record that no parameter can change
   !> used    number of independent oscillations in all records
   subroutine eliminate_oscillations(experiments, s, orders, fit, a, y, ends, after, used)
      type(experiment_t), intent(in), target :: experiments(:)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: orders(:)
      type(stage_fit_t), intent(in), target :: fit
      real(wp), allocatable, intent(out) :: a(:, :), y(:)
      integer, intent(out) :: ends(0:), used
      real(wp), intent(out) :: after(:)
      type(record_rows_t) :: rows
      type(condensed_t) :: condensed
      integer :: first, last, m, n, others, r

      m = size(fit%residual)
      n = size(fit%jacobian, 2)
      others = size(fit%jacobian, 1) - m
      allocate (a(size(s)*(n + waves) + others, n), y(size(s)*(n + waves) + others), &
         source=0.0_wp)
      ends = 0
      used = 0
      last = 0
      do r = 1, size(experiments)
         first = last + 1
         last = last + size(experiments(r)%measured)
         rows%rows = last - first + 1
         rows%order = orders(r)
         rows%columns = n + merge(waves, 0, orders(r) > 0)
         rows%s = s(r)
         rows%t => experiments(r)%samples
         rows%jacobian => fit%jacobian(first:last, :)
         rows%residual => fit%fit%residual(first:last)
         call condense(rows, condensed)
         after(r) = condensed%left**2
         call add_rows(condensed, a, y, ends(r - 1), ends(r))
         used = used + rows%columns - (ends(r) - ends(r - 1))
      end do
      last = ends(size(experiments))
      a(last + 1:last + others, :) = fit%jacobian(m + 1:, :)
      y(last + 1:last + others) = fit%fit%residual(m + 1:)
   end subroutine eliminate_oscillations

   !> Computes by how much the sum of squares decreases, in units of the variance of the noise.
   !>
   !> s       (records) root of the first mode [1/time]
   !> orders  (records) of the harmonic; 0: the record is not tested
   !> after   (records) sum of squares with the harmonic
   !> gain    the decrease in all records
   !> record  tested record in which it is largest
   subroutine compare_with_noise(experiments, s, orders, fit, after, gain, record)
      type(experiment_t), intent(in) :: experiments(:)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: orders(:)
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: after(:)
      real(wp), intent(out) :: gain
      integer, intent(out) :: record
      real(wp) :: noise, gains(size(orders))
      integer :: first, last, r

      last = 0
      do r = 1, size(experiments)
         first = last + 1
         last = last + size(experiments(r)%measured)
         noise = fit%statistics%variance
         if (orders(r) > 0) noise = fit%weight(r)**2*noise_near(experiments(r)%samples, &
            fit%residual(first:last), orders(r)*aimag(s(r))/two_pi, -real(s(r)))
         gains(r) = (sum(fit%fit%residual(first:last)**2) - after(r))/max(noise, tiny(noise))
      end do
      gain = sum(gains)
      record = maxloc(gains, dim=1, mask=orders > 0)
   end subroutine compare_with_noise

   !> Adds the condensed rows of a record without those that the oscillation can make 0.
   !>
   !> a, y    rows so far, in the first `before` ones
   !> last    number of rows on return
   subroutine add_rows(condensed, a, y, before, last)
      type(condensed_t), intent(in) :: condensed
      real(wp), intent(inout) :: a(:, :), y(:)
      integer, intent(in) :: before
      integer, intent(out) :: last
      real(wp), parameter :: independent = 1e-10_wp   ! of a column that counts as independent
      integer :: j, w

      w = size(condensed%factor, 2) - size(a, 2)
      last = before
      do j = 1, size(condensed%factor, 1)
         if (j <= w) then
            if (abs(condensed%factor(j, j)) > independent*norm2(condensed%factor(:j, j))) cycle
         end if
         last = last + 1
         a(last, :) = condensed%factor(j, w + 1:)
         y(last) = condensed%y(j)
      end do
   end subroutine add_rows

   !> Computes a block of rows of one record.
   subroutine fill(self, first, x)
      class(record_rows_t), intent(in) :: self
      integer, intent(in) :: first
      real(wp), intent(inout), contiguous :: x(:, :)
      integer :: k, last, w

      last = min(first + block_rows - 1, self%rows)
      w = self%columns - size(self%jacobian, 2)
      if (w > 0) then
         do k = first, last
            x(k - first + 1, :w) = self%oscillation(k)
         end do
      end if
      x(:last - first + 1, w + 1:self%columns) = self%jacobian(first:last, :)
      x(:last - first + 1, self%columns + 1) = self%residual(first:last)
   end subroutine fill

   !> Returns cosine and sine of the harmonic at sample k, with either decay.
   pure function oscillation(self, k) result(values)
      class(record_rows_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: values(waves)
      real(wp) :: decay, time
      complex(wp) :: slow

      time = self%t(k) - self%t(1)
      decay = real(self%s)*time
      slow = exp(cmplx(decay, self%order*aimag(self%s)*time, wp))
      values(:2) = [slow%re, slow%im]
      values(3:) = values(:2)*exp((self%order - 1)*decay)
   end function oscillation

end module beamid_harmonics
