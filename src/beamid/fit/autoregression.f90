!> Noise that remembers: e_t = a_1 e_(t-1) + ... + a_p e_(t-p) + white noise, estimated from residuals,
!> and the filter that makes such noise white.
!>
!> Yule and Walker's equations by Levinson's recursion, the order by the least AICc (Brockwell and
!> Davis, Time Series: Theory and Methods, 1991, sections 8.1, 8.2 and 9.3).
module beamid_autoregression
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   use beamid_statistics, only: max_lags
   implicit none
   private

   public :: autoregression_t, new_autoregression

   type :: autoregression_t
      integer :: order = 0
      !> (order, 0:order) column k predicts from the k values before, the latest first
      real(wp), allocatable :: predictor(:, :)
      !> (0:order) what makes an error of that prediction as large as one of the last
      real(wp), allocatable :: gain(:)
      !> (m) values before a row that belong to it: none behind a gap
      integer, allocatable :: before(:)
   contains
      procedure :: whiten
   end type autoregression_t

contains

   !> residual  (m) in the order of time, some of them not 0
   !> t         (m) their times, ascending; more than 1.5 of the usual step apart is a gap
   !> white     .true.: of order 0, whatever they are
   function new_autoregression(residual, t, white) result(self)
      real(wp), intent(in) :: residual(:), t(:)
      logical, intent(in) :: white
      type(autoregression_t) :: self
      real(wp), allocatable :: covariance(:), a(:, :), variance(:), criterion(:)
      real(wp) :: reflection, usual
      integer :: k, m, most

      m = size(residual)
      most = merge(0, min(max_lags, m/4), white)
      allocate (self%before(m), covariance(0:most), a(most, 0:most), variance(0:most), &
         criterion(0:most))
      self%before = 0
      usual = median(t(2:) - t(:m - 1))
      do k = 2, m
         if (t(k) - t(k - 1) <= 1.5_wp*usual) self%before(k) = self%before(k - 1) + 1
      end do
      do k = 0, most
         covariance(k) = sum(residual(:m - k)*residual(k + 1:), mask=self%before(k + 1:) >= k)/m
      end do
      a = 0
      variance(0) = covariance(0)
      do k = 1, most
         reflection = (covariance(k) - dot_product(a(:k - 1, k - 1), covariance(k - 1:1:-1))) &
            /variance(k - 1)
         a(:k - 1, k) = a(:k - 1, k - 1) - reflection*a(k - 1:1:-1, k - 1)
         a(k, k) = reflection
         variance(k) = variance(k - 1)*(1 - reflection**2)
      end do
      criterion = [(m*log(variance(k)) + 2.0_wp*(k + 1)*m/max(1, m - k - 2), k=0, most)]
      self%order = minloc(criterion, dim=1) - 1
      allocate (self%predictor(self%order, 0:self%order), self%gain(0:self%order))
      self%predictor(:, :) = a(:self%order, :self%order)
      self%gain(:) = sqrt(variance(self%order)/variance(:self%order))
   end function new_autoregression

   !> What is left of values, or of a derivative of them, when each is predicted from those before.
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
