!> Tests whether the parameters of a fit are constant during the motion.
!>
!> The records are cut into consecutive windows of equal duration. In each window, one linear
!> least-squares step from the estimates of the whole record gives the changes of the parameters and
!> of the amplitudes that this window prefers. If the parameters are constant, these changes are
!> normal with errors that the window gives, even for a mode that has decayed, so that the test has
!> the level it claims. A window in which a parameter has no effect does not count. Fits of the
!> windows, if there are any, make a second test for changes that are too large for a linear step.
!> The test is corrected for the number of parameters by Holm's method (Scandinavian Journal of
!> Statistics 6, 1979, 65).
module beamid_drifts
   use beamid_distributions, only: chi_square_tail
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_structure, only: is_coefficient, of_x_D
   use beamid_window_fits, only: in_window, window_fit_t
   implicit none
   private

   public :: drift_t, find_drifts, default_windows

   !> The scatter of one parameter over windows.
   type :: scatter_t
      real(wp) :: spread = 0        !< standard deviation over the windows
      real(wp) :: expected = 0      !< root mean square of the standard errors
      real(wp) :: ratio = 0         !< scatter in units of the errors
      !> standard deviation of a variation that explains the scatter beyond the errors
      real(wp) :: variation = 0
      real(wp) :: probability = 1   !< of at least this scatter by chance
   end type scatter_t

   !> The scatter of n free parameters over windows.
   type :: drift_t
      integer :: windows = 0                      !< number of windows
      type(scatter_t), allocatable :: scatter(:)  !< (n)
      logical, allocatable :: is_significant(:)   !< (n) whether the parameter drifts
   end type drift_t

   !> Probability of at least one false alarm if every parameter is constant: of a test that the
   !> user has asked for, and of one that is made without being asked for.
   real(wp), parameter :: level_if_asked = 0.05_wp, level_otherwise = 0.01_wp

contains

   !> Returns the number of windows of a test that the user has not asked for: 4 if every record is
   !> a free decay with at least 40 periods of the first mode and 40 samples for each unknown,
   !> otherwise 0. Fits of fields and dips are not tested, because their search chooses among
   !> several minima.
   !>
   !> frequency  of the lowest mode [1/time]
   pure integer function default_windows(experiments, fit, frequency) result(n)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: frequency
      integer, parameter :: usual = 4, least = 10
      integer :: r

      n = 0
      if (any(is_coefficient(fit%free) .or. fit%free == of_x_D) .or. size(fit%free) == 0) return
      do r = 1, size(experiments)
         associate (t => experiments(r)%samples, m => size(experiments(r)%samples))
            if (experiments(r)%excitation%modes == 0 .or. m < usual*least*size(fit%quantities)) &
               return
            if (.not. (t(m) - t(1))*frequency >= usual*least) return
         end associate
      end do
      n = usual
   end function default_windows

   !> Tests the free parameters of a fit.
   !>
   !> experiments  (records) that were fitted
   !> windows      number of windows
   !> fit          on return with `drift`, the standard deviation by which each drifting parameter
   !>              varies
   !> fits         (windows) fits of the windows, if the user has asked for the test: a second test,
   !>              which finds changes that are too large for linear theory. A parameter counts in
   !>              the windows that show its modes
   subroutine find_drifts(experiments, windows, fit, drift, fits)
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: windows
      type(stage_fit_t), intent(inout) :: fit
      type(drift_t), intent(out) :: drift
      type(window_fit_t), intent(in), optional :: fits(:)
      real(wp) :: change(size(fit%free), windows), sd(size(fit%free), windows)
      integer :: k, n

      n = size(fit%free)
      drift%windows = windows
      allocate (drift%scatter(n))
      do k = 1, windows
         call step_in_window(experiments, fit, k, windows, change(:, k), sd(:, k))
      end do
      do k = 1, n
         drift%scatter(k) = scatter_of(change(k, :), sd(k, :))
         if (present(fits)) call add_second_test(fits, k, drift%scatter(k))
      end do
      drift%is_significant = significant_by_holm([(drift%scatter(k)%probability, k=1, n)], &
         merge(level_if_asked, level_otherwise, present(fits)))
      fit%drift = merge([(drift%scatter(k)%variation, k=1, n)], 0.0_wp, drift%is_significant)
   end subroutine find_drifts

   !> Computes the changes of the parameters that one window prefers, and their standard errors.
   !>
   !> k, windows  number of the window, and of all windows
   !> change      (n)
   !> sd          (n) `unlimited` for parameters without an effect in the window
   subroutine step_in_window(experiments, fit, k, windows, change, sd)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k, windows
      real(wp), intent(out) :: change(:), sd(:)
      integer, allocatable :: rows(:)
      integer :: first, i, r

      allocate (rows(0))
      first = 0
      do r = 1, size(experiments)
         associate (t => experiments(r)%samples, m => size(experiments(r)%samples))
            rows = [rows, pack([(first + i, i=1, m)], in_window(t, k, windows))]
            first = first + size(experiments(r)%measured)
         end associate
      end do
      call fit%step_of_rows(rows, change, sd)
   end subroutine step_in_window

   !> Combines the test of parameter k with that of fits in the windows: the smaller probability
   !> counts, times two for two tests.
   subroutine add_second_test(fits, k, scatter)
      type(window_fit_t), intent(in) :: fits(:)
      integer, intent(in) :: k
      type(scatter_t), intent(inout) :: scatter
      type(scatter_t) :: second
      real(wp) :: x(size(fits)), sd(size(fits))
      integer :: i

      x = 0
      sd = unlimited
      do i = 1, size(fits)
         if (allocated(fits(i)%error)) cycle
         if (.not. fits(i)%is_shown(k)) cycle
         x(i) = fits(i)%shown_estimate(k)
         sd(i) = fits(i)%shown_error(k)
      end do
      second = scatter_of(x, sd)
      if (second%probability < scatter%probability) scatter = second
      scatter%probability = min(1.0_wp, 2*scatter%probability)
   end subroutine add_second_test

   !> Compares the scatter of estimates with their standard errors. Estimates without a useful
   !> standard error do not count; with fewer than two others, the result keeps
   !> its defaults.
   !>
   !> The variation is the moment estimate of a random effect, in which precise estimates weigh more
   !> (DerSimonian and Laird, Controlled Clinical Trials 7, 1986, 177).
   !>
   !> estimates, errors  (windows)
   pure function scatter_of(estimates, errors) result(scatter)
      real(wp), intent(in) :: estimates(:), errors(:)
      type(scatter_t) :: scatter
      logical :: is_useful(size(errors))
      real(wp), allocatable :: x(:), sd(:), weight(:)
      real(wp) :: mean, total
      integer :: n

      is_useful = errors > 0 .and. errors < sqrt(unlimited)
      x = pack(estimates, is_useful)
      sd = pack(errors, is_useful)
      n = size(x)
      if (n < 2) return
      weight = 1/sd**2
      mean = sum(weight*x)/sum(weight)
      total = sum(weight*(x - mean)**2)
      scatter%spread = sqrt(sum((x - sum(x)/n)**2)/(n - 1))
      scatter%expected = sqrt(sum(sd**2)/n)
      scatter%ratio = sqrt(total/(n - 1))
      scatter%variation = sqrt(max(0.0_wp, total - (n - 1)) &
         /(sum(weight) - sum(weight**2)/sum(weight)))
      scatter%probability = chi_square_tail(total, real(n - 1, wp))
   end function scatter_of

   !> Tells which of several tests are significant together, by Holm's method: the smallest
   !> probability is compared with level/n, the next with level/(n - 1), and so on until one fails.
   pure function significant_by_holm(probability, level) result(significant)
      real(wp), intent(in) :: probability(:), level
      logical :: significant(size(probability))
      integer :: k, tests

      significant = .false.
      do tests = size(probability), 1, -1
         k = minloc(probability, dim=1, mask=.not. significant)
         if (.not. probability(k) <= level/tests) return
         significant(k) = .true.
      end do
   end function significant_by_holm

end module beamid_drifts
