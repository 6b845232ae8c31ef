!> Fits autoregressive noise, e_t = a_1 e_(t-1) + ... + a_p e_(t-p) + white noise, to residuals, and
!> filters the noise to white noise. The posterior uses it for coloured residuals.
!>
!> The coefficients solve Yule and Walker's equations by Levinson's recursion; the order has the
!> least AICc (Brockwell and Davis, Time Series: Theory and Methods, 1991, sections 8.1, 8.2 and
!> 9.3).
module beamid_autoregression
   use beamid_kernels, only: lagged_products
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   use beamid_statistics, only: max_lags
   implicit none
   private

   public :: autoregression_t, new_autoregression, predictor_of, take_prediction

   !> An autoregressive process, and the neighbours of each sample.
   type :: autoregression_t
      integer :: order = 0   !< p
      !> (order, 0:order) column k: coefficients that predict a value from the k values before, the
      !> latest first
      real(wp), allocatable :: predictor(:, :)
      !> (0:order) factors that give the error of the prediction from k values the same variance as
      !> that from p values
      real(wp), allocatable :: gain(:)
      !> (m) number of values before each row without a gap between them
      integer, allocatable :: before(:)
   contains
      procedure :: whiten
   end type autoregression_t

contains

   !> Fits an autoregressive process to residuals.
   !>
   !> residual  (m) in order of time, not all zero
   !> t         (m) their times, ascending [time]; a step of more than 1.5 median steps is a gap.
   !>           Empty: residuals without an order in time, whose noise is white
   !> white     .true.: assumes white noise, of order 0
   function new_autoregression(residual, t, white) result(self)
      real(wp), intent(in) :: residual(:), t(:)
      logical, intent(in) :: white
      type(autoregression_t) :: self
      real(wp), allocatable :: covariance(:), a(:, :), variance(:), criterion(:)
      real(wp) :: median_step
      integer :: k, m, max_order

      m = size(residual)
      max_order = merge(0, min(max_lags, m/4), white .or. size(t) == 0)
      allocate (self%before(m), covariance(0:max_order), a(max_order, 0:max_order), &
         variance(0:max_order), criterion(0:max_order))
      self%before = 0
      median_step = median(t(2:) - t(:size(t) - 1))
      do k = 2, size(t)
         if (t(k) - t(k - 1) <= 1.5_wp*median_step) self%before(k) = self%before(k - 1) + 1
      end do
      do k = 0, max_order
         covariance(k) = sum(residual(:m - k)*residual(k + 1:), mask=self%before(k + 1:) >= k)/m
      end do
      call solve_yule_walker(covariance, a, variance)
      criterion = [(m*log(variance(k)) + 2.0_wp*(k + 1)*m/max(1, m - k - 2), k=0, max_order)]
      self%order = minloc(criterion, dim=1) - 1
      allocate (self%predictor(self%order, 0:self%order), self%gain(0:self%order))
      self%predictor(:, :) = a(:self%order, :self%order)
      self%gain(:) = sqrt(variance(self%order)/variance(:self%order))
   end function new_autoregression

   !> Solves Yule and Walker's equations for every order by Levinson's recursion.
   !>
   !> covariance  (0:order) > 0 at 0
   !> a           (order, 0:order) column k: coefficients of order k, the latest first
   !> variance    (0:order) of the errors of the prediction
   pure subroutine solve_yule_walker(covariance, a, variance)
      real(wp), intent(in) :: covariance(0:)
      real(wp), intent(out) :: a(:, 0:), variance(0:)
      real(wp) :: reflection
      integer :: k

      a = 0
      variance(0) = covariance(0)
      do k = 1, size(a, 1)
         reflection = (covariance(k) - dot_product(a(:k - 1, k - 1), covariance(k - 1:1:-1))) &
            /variance(k - 1)
         a(:k - 1, k) = a(:k - 1, k - 1) - reflection*a(k - 1:1:-1, k - 1)
         a(k, k) = reflection
         variance(k) = variance(k - 1)*(1 - reflection**2)
      end do
   end subroutine solve_yule_walker

   !> Returns the coefficients that predict a residual from those before it, the latest first, for a
   !> process of given order without gaps. All are 0 if the residuals are 0.
   !>
   !> residual  (m) in order of time
   pure function predictor_of(residual, order) result(coefficients)
      real(wp), intent(in), contiguous :: residual(:)
      integer, intent(in) :: order
      real(wp) :: coefficients(order), a(order, 0:order), variance(0:order)

      coefficients = 0
      if (.not. sum(residual**2) > 0) return
      call solve_yule_walker([sum(residual**2), lagged_products(residual, order)], a, variance)
      coefficients = a(:, order)
   end function predictor_of

   !> Replaces values by the errors of their prediction. The first values, which have too few before
   !> them, become 0.
   !>
   !> coefficients  (order) as of `predictor_of`
   !> values        (m)
   pure subroutine take_prediction(coefficients, values)
      real(wp), intent(in) :: coefficients(:)
      real(wp), intent(inout), contiguous :: values(:)
      real(wp) :: errors(size(values))
      integer :: i, k, m, n

      m = size(values)
      n = size(coefficients)
      errors = values
      do k = 1, n
         !$omp simd
         do i = n + 1, m
            errors(i) = errors(i) - coefficients(k)*values(i - k)
         end do
      end do
      errors(:min(n, m)) = 0
      values = errors
   end subroutine take_prediction

   !> Replaces values, or derivatives of values, by the errors of their prediction from the values
   !> before.
   !>
   !> values  (m)
   pure subroutine whiten(self, values)
      class(autoregression_t), intent(in) :: self
      real(wp), intent(inout) :: values(:)
      integer :: i, k

      do i = size(values), 1, -1
         k = min(self%order, self%before(i))
         values(i) = self%gain(k)*(values(i) &
            - dot_product(self%predictor(:k, k), values(i - 1:i - k:-1)))
      end do
   end subroutine whiten

end module beamid_autoregression
