!> Whether residuals are found white: noise that is, and noise that is not; errors of parameters
!> that allow for it; against what theory promises of many records.
program test_whiteness
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_whiteness, only: check_residuals, residual_check_t
   use checks, only: check, check_close, finish
   implicit none

   call test_white()
   call test_coloured()
   call test_corrected()
   call finish('whiteness')

contains

   !> White noise is found white in 95 of 100 records: 500 records, of which 475 are expected with a
   !> standard deviation of sqrt(500*.05*.95) = 4.9; four of these either way, and one per cent
   !> (5) for the chi-square law itself, which is that of long records. One long stream is cut
   !> into records. A regression of four parameters (constant, slope, cosine and sine) leaves
   !> correlations of the order of 4/m, which the test expects and takes off.
   subroutine test_white()
      integer, parameter :: records = 500
      integer, parameter :: lengths(3) = [49, 200, 1000], fitted(3) = [0, 1, 4]
      integer, parameter :: expected = 475, allowed = 25
      real(wp), allocatable :: stream(:), x(:), basis(:, :)
      type(residual_check_t) :: found
      real(wp) :: beyond
      integer :: i, k, r, m, passed

      do i = 1, size(lengths)
         m = lengths(i)
         stream = gaussian_noise(m*records, 0.3_wp, 1000 + m)
         basis = orthonormal_basis(m)
         do k = 1, size(fitted)
            passed = 0
            beyond = 0
            do r = 1, records
               x = stream((r - 1)*m + 1:r*m)
               x = x - matmul(basis(:, :fitted(k)), matmul(x, basis(:, :fitted(k))))
               found = whiteness(x, basis(:, :fitted(k)))
               if (found%white) passed = passed + 1
               beyond = beyond + count(abs(found%autocorrelation) > found%band)
            end do
            call check_close('white noise, m = '//to_text(m)//', '//to_text(fitted(k))// &
               ' parameters fitted: found white', real(passed, wp), real(expected, wp), &
               real(allowed, wp))
            ! Bands +-1.96/sqrt(m): 5 per cent of 20 lags beyond; the variance of r_k is (m -
            ! k)/(m(m+2)), so that for short records it is less. Lags of one record are nearly
            ! independent: 10000 of them, and fitted parameters move some.
            call check('white noise, m = '//to_text(m)//', '//to_text(fitted(k))// &
               ' parameters fitted: lags beyond the bands', beyond/(20*records) < 0.06_wp .and. &
               beyond/(20*records) > 0.02_wp, to_text(beyond/(20*records)))
         end do
      end do
      found = whiteness([0.0_wp, 0.0_wp, 0.0_wp])
      call check('residuals of zero: white, no NaN', found%white .and. &
         all(abs(found%autocorrelation) <= 0))
      found = whiteness([2.0_wp, 2.0_wp, 2.0_wp])
      call check('constant residuals: no NaN', all(abs(found%autocorrelation) <= 1))
      found = whiteness([1.0_wp])
      call check('one residual: no lags', size(found%autocorrelation) == 0 .and. found%white)
      ! By hand: residuals 1, -1, 1, -1 have mean 0; r_1 = -3/4, r_2 = 2/4; one lag for so
      ! few: Q = 4*6*9/16/3.
      found = whiteness([1.0_wp, -1.0_wp, 1.0_wp, -1.0_wp])
      call check_close('by hand, lag 1', found%autocorrelation(1), -0.75_wp, 1e-15_wp)
      call check_close('by hand, lag 2', found%autocorrelation(2), 0.5_wp, 1e-15_wp)
      call check_close('by hand, Ljung-Box', found%ljung_box, 24*0.1875_wp, 1e-13_wp)
      call check('by hand, a probability', found%probability > 0 .and. found%probability < 0.1_wp, &
         to_text(found%probability))
      call check_close('by hand, band', found%band, 1.95996398454_wp/2, 1e-11_wp)
   end subroutine test_white

   !> What the library says of residuals left by a fit whose derivatives span `basis`, (m, n).
   function whiteness(residual, basis) result(found)
      real(wp), intent(in) :: residual(:)
      real(wp), intent(in), optional :: basis(:, :)
      type(residual_check_t) :: found

      found = check_residuals(residual, basis)
   end function whiteness

   !> (m, 4) orthonormal columns that span 1, t, cos and sin of two and a half periods.
   function orthonormal_basis(m) result(basis)
      integer, intent(in) :: m
      real(wp), allocatable :: basis(:, :)
      real(wp) :: t(m)
      integer :: j, k

      t = [(k/real(m, wp), k=1, m)]
      basis = reshape([spread(1.0_wp, 1, m), t, cos(16*t), sin(16*t)], [m, 4])
      do k = 1, 4
         do j = 1, k - 1
            basis(:, k) = basis(:, k) - dot_product(basis(:, j), basis(:, k))*basis(:, j)
         end do
         basis(:, k) = basis(:, k)/norm2(basis(:, k))
      end do
   end function orthonormal_basis

   !> Autoregressive noise x_k = phi x_{k-1} + e_k of unit variance.
   function autoregressive(m, phi, seed) result(x)
      integer, intent(in) :: m, seed
      real(wp), intent(in) :: phi
      real(wp) :: x(m)
      integer :: k

      x = gaussian_noise(m, 1.0_wp, seed)
      do k = 2, m
         x(k) = phi*x(k - 1) + sqrt(1 - phi**2)*x(k)
      end do
   end function autoregressive

   !> With phi = .5 and 200 samples r_1 is .5 with an error of .06, and the Ljung-Box sum some 70
   !> against 31: a failure to see it is beyond four deviations.
   subroutine test_coloured()
      integer, parameter :: m = 200, records = 100
      type(residual_check_t) :: found
      real(wp) :: lag(3)
      integer :: k, seen

      seen = 0
      lag = 0
      do k = 1, records
         found = whiteness(autoregressive(m, 0.5_wp, 77*k))
         if (.not. found%white) seen = seen + 1
         lag = lag + found%autocorrelation(:3)/records
      end do
      call check('AR(1), phi = .5: found not white', seen == records, to_text(seen)//' of 100')
      do k = 1, 3
         ! Deviation sqrt(.75/m) to sqrt(1.6/m) a record, a tenth of it for the mean of 100, four of
         ! these; bias (1 + 3 phi)/m or so.
         call check_close('AR(1), phi = .5: mean autocorrelation at lag '//to_text(k), lag(k), &
            0.5_wp**k, 0.4_wp*sqrt(1.6_wp/m) + 3.0_wp/m)
      end do
      ! Alternating: the same the other way round.
      found = whiteness(autoregressive(m, -0.5_wp, 5))
      call check('AR(1), phi = -.5: found not white', .not. found%white, to_text(found%probability))
   end subroutine test_coloured

   !> A constant fitted to AR(1) noise: its variance is that of white noise times (1 + phi)/(1 -
   !> phi). With 20 lags, tapered linearly, the estimate aims at 1 + 2 sum (1 - k/21) phi**k, less
   !> what the mean taken off removes, (1 + phi)/(1 - phi)/m of each autocovariance.
   subroutine test_corrected()
      integer, parameter :: m = 2000, records = 200
      real(wp), parameter :: phis(3) = [0.0_wp, 0.6_wp, 0.8_wp]
      real(wp) :: jacobian(m, 1), x(m), full, tapered, mean_ratio, mean_effective, actual, plain
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=:), allocatable :: label
      integer :: i, k, r
      logical :: narrower

      jacobian = 1
      do i = 1, size(phis)
         associate (phi => phis(i))
            label = 'constant in AR(1) noise, phi = '//to_text(phi)//': '
            mean_ratio = 0
            mean_effective = 0
            actual = 0
            plain = 0
            narrower = .false.
            do r = 1, records
               x = autoregressive(m, phi, 1000*i + 13*r)
               actual = actual + (sum(x)/m)**2/records
               call new_statistics(jacobian, x - sum(x)/m, [1.0_wp], [1.0_wp], s, error)
               mean_ratio = mean_ratio + (s%corrected_error(1)/s%std_error(1))**2/records
               mean_effective = mean_effective + s%effective/records
               plain = plain + s%covariance(1, 1)/records
               narrower = narrower .or. s%corrected_error(1) < s%std_error(1) &
                  .or. s%corrected_half_width(1) < s%half_width(1)
            end do
            full = (1 + phi)/(1 - phi)
            tapered = 1 + 2*sum([((1 - k/21.0_wp)*(1 - real(k, wp)/m)*(phi**k - full/m), k=1, 20)])
            ! One estimate with a linear taper of 21 lags scatters by sqrt(4*21/(3 m)) = 12 % of
            ! itself; the mean of 200 by .8 %: four of these. White noise: never below 1, so that
            ! half of the scatter counts, .4*12 % = 5 %.
            if (phi > 0) then
               call check_close(label//'variance inflation', mean_ratio/tapered, 1.0_wp, 0.035_wp)
               call check_close(label//'effective number', mean_effective*tapered/m, 1.0_wp, &
                  0.05_wp)
               ! What the taper leaves out, by the formula above: 10 % of the variance for phi =
               ! .6, 22 % for .8; the error, its root, is then 5 and 12 % too small.
               call check(label//'against the exact inflation', mean_ratio > 0.75_wp*full .and. &
                  mean_ratio < 1.02_wp*full, to_text(mean_ratio)//' of '//to_text(full))
               ! The scatter of the estimates themselves: 200 records know a variance to 10 %,
               ! four of these; the plain error must be refuted by them.
               call check_close(label//'actual variance over plain', actual/plain, full, &
                  0.4_wp*full)
            else
               call check_close(label//'variance inflation', mean_ratio, 1.0_wp, 0.08_wp)
               call check(label//'effective number', mean_effective > 0.9_wp*m .and. &
                  mean_effective <= m, to_text(mean_effective))
            end if
            call check(label//'never below the plain errors', .not. narrower)
         end associate
      end do
   end subroutine test_corrected

end program test_whiteness
