!> Tests whether residuals are white noise, and counts their effective number if they are not.
module beamid_whiteness
   use beamid_condensation, only: factor_of
   use beamid_distributions, only: chi_square_tail, normal_95
   use beamid_kernels, only: lagged_products
   use beamid_kinds, only: wp
   use beamid_lapack, only: dtrtrs
   use beamid_matrices, only: identity
   use beamid_statistics, only: max_lags
   implicit none
   private

   public :: residual_check_t, check_residuals, effective_samples

   !> Result of the test for white noise.
   type :: residual_check_t
      real(wp), allocatable :: autocorrelation(:)    !< (lags) at lags 1, 2, ...
      !> half width of the band that contains 95 % of the autocorrelations of white residuals
      real(wp) :: band = 0
      integer :: lags = 0                            !< number of lags in the Ljung-Box statistic
      real(wp) :: ljung_box = 0                      !< Ljung-Box statistic
      !> of a Ljung-Box statistic at least as large if the residuals are white
      real(wp) :: probability = 1
      logical :: white = .true.                      !< probability >= 0.05
   end type residual_check_t

contains

   !> Computes the autocorrelations of residuals, and performs the Ljung-Box test over the first
   !> lags, at most a tenth of the samples.
   !>
   !> The residuals of a fit are correlated even if the noise is white: with P the projection onto
   !> the columns of the Jacobian, white noise of variance sigma**2 leaves E r_t r_(t+k) = -sigma**2
   !> P_(t,t+k). The test subtracts this expectation.
   !>
   !> residual  (m) in order of time
   !> jacobian  (m, n) of the fit; absent: no parameter was fitted
   function check_residuals(residual, jacobian) result(found)
      real(wp), intent(in) :: residual(:)
      real(wp), intent(in), optional :: jacobian(:, :)
      type(residual_check_t) :: found
      real(wp), allocatable :: r(:), expected(:)
      integer :: m, lags, k

      m = size(residual)
      lags = min(max_lags, m/2)
      allocate (found%autocorrelation(lags), source=0.0_wp)
      if (lags < 1 .or. .not. any(abs(residual) > 0)) return
      r = residual - sum(residual)/m
      if (.not. any(abs(r) > 0)) return
      found%autocorrelation = lagged_products(r, lags)/sum(r**2)
      allocate (expected(lags), source=0.0_wp)
      if (present(jacobian)) call expected_autocorrelation(jacobian, expected)
      found%band = normal_95/sqrt(real(m, wp))
      found%lags = max(1, min(lags, m/10))
      found%ljung_box = m*(m + 2.0_wp)*sum((found%autocorrelation(:found%lags) &
         - expected(:found%lags))**2/[(m - k, k=1, found%lags)])
      found%probability = chi_square_tail(found%ljung_box, real(found%lags, wp))
      found%white = found%probability >= 0.05_wp
   end function check_residuals

   !> Returns the number of white samples whose sum of squares would have the same relative scatter,
   !> m/(1 + 2 sum of squared autocorrelations). It is the duration times the bandwidth of the
   !> residuals. Long lags are sampled, each standing for its neighbours.
   !>
   !> residual  (m) in order of time
   pure real(wp) function effective_samples(residual) result(effective)
      real(wp), intent(in) :: residual(:)
      real(wp) :: total, lagged
      integer :: k, m, stride

      m = size(residual)
      effective = m
      total = sum(residual**2)
      if (.not. total > 0) return
      lagged = 0
      k = 1
      do while (k <= m/4)
         stride = 1 + k/20
         ! The squared autocorrelation of white residuals is 1/m on average.
         lagged = lagged + stride*((dot_product(residual(:m - k), residual(k + 1:))/total)**2 &
            - 1.0_wp/m)
         k = k + stride
      end do
      effective = m/(1 + 2*max(0.0_wp, lagged))
   end function effective_samples

   !> Computes the expected autocorrelations of the residuals of a fit to white noise; 0 if the
   !> columns of the Jacobian are dependent or as many as the samples.
   !>
   !> jacobian         (m, n) of the fit
   !> autocorrelation  (lags) at lags 1, 2, ...
   subroutine expected_autocorrelation(jacobian, autocorrelation)
      real(wp), intent(in) :: jacobian(:, :)
      real(wp), intent(out) :: autocorrelation(:)
      real(wp) :: factor(size(jacobian, 2), size(jacobian, 2)), inverse(size(jacobian, 2), &
         size(jacobian, 2)), q(size(jacobian, 1))
      integer :: info, j, k, n

      autocorrelation = 0
      n = size(jacobian, 2)
      if (n == 0 .or. size(q) <= n) return
      factor = factor_of(jacobian)
      if (any([(.not. abs(factor(j, j)) > 1e-10_wp*norm2(factor(:, j)), j=1, n)])) return
      ! The columns of jacobian inverse are orthonormal.
      inverse = identity(n)
      call dtrtrs('U', 'N', 'N', n, n, factor, n, inverse, n, info)
      do j = 1, n
         q = 0
         do k = 1, j
            q = q + inverse(k, j)*jacobian(:, k)
         end do
         autocorrelation = autocorrelation - lagged_products(q, size(autocorrelation))/(size(q) - n)
      end do
   end subroutine expected_autocorrelation

end module beamid_whiteness
