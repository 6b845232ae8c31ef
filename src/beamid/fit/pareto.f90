!> Smooths importance weights: replaces the largest by quantiles of a generalised Pareto
!> distribution fitted to them. Its shape k shows whether the weights can be trusted: below 0.7 they
!> can (Vehtari, Simpson, Gelman, Yao and Gabry, J. Mach. Learn. Res. 25, 2024, no. 72; the fit
!> after Zhang and Stephens, Technometrics 51, 2009, 316).
module beamid_pareto
   use beamid_kinds, only: wp
   use beamid_sorting, only: sort
   implicit none
   private

   public :: smooth_weights

contains

   !> Smooths and normalises importance weights.
   !>
   !> log_weight  (n) up to a constant
   !> weight      (n), with the sum 1
   !> k           shape of the tail; -1 if there are too few weights to fit a tail
   subroutine smooth_weights(log_weight, weight, k)
      real(wp), intent(in) :: log_weight(:)
      real(wp), intent(out) :: weight(:), k
      real(wp), allocatable :: sorted(:), tail(:)
      real(wp) :: cut, sigma, p
      integer :: i, m, n, rank

      n = size(log_weight)
      weight = exp(log_weight - maxval(log_weight))
      k = -1
      m = int(min(0.2_wp*n, 3*sqrt(real(n, wp))))
      if (m >= 5) then
         sorted = weight
         call sort(sorted)
         cut = sorted(n - m)
         ! Weights equal to the cut, especially zeros, do not belong to the tail.
         tail = pack(sorted(n - m + 1:), sorted(n - m + 1:) > cut)
         m = size(tail)
         if (m >= 5) then
            call fit_pareto(tail - cut, k, sigma)
            ! Each weight of the tail becomes the quantile of its rank, at most the largest weight
            ! drawn.
            do i = 1, n
               if (.not. weight(i) > cut) cycle
               rank = count(tail <= weight(i))
               p = (rank - 0.5_wp)/m
               if (abs(k) > 1e-12_wp) then
                  weight(i) = cut + sigma*((1 - p)**(-k) - 1)/k
               else
                  weight(i) = cut - sigma*log(1 - p)
               end if
               weight(i) = min(weight(i), 1.0_wp)
            end do
         end if
      end if
      weight = weight/sum(weight)
   end subroutine smooth_weights

   !> Estimates shape k and scale sigma of a generalised Pareto distribution as the mean of the
   !> profile likelihood over a grid. If there are few values, k is shrunk towards one half.
   !>
   !> x  (m) ascending, > 0
   pure subroutine fit_pareto(x, k, sigma)
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: k, sigma
      real(wp), allocatable :: theta(:), likelihood(:)
      real(wp) :: mean
      integer :: i, m, points

      m = size(x)
      points = 30 + int(sqrt(real(m, wp)))
      allocate (theta(points), likelihood(points))
      do i = 1, points
         theta(i) = 1/x(m) + (1 - sqrt(points/(i - 0.5_wp)))/(3*x(max(1, int(m/4.0_wp + 0.5_wp))))
         k = sum(log(1 - theta(i)*x))/m
         likelihood(i) = m*(log(-theta(i)/k) - k - 1)
      end do
      likelihood = exp(likelihood - maxval(likelihood))
      mean = sum(theta*likelihood)/sum(likelihood)
      k = sum(log(1 - mean*x))/m
      sigma = -k/mean
      k = (m*k + 10*0.5_wp)/(m + 10)
   end subroutine fit_pareto

end module beamid_pareto
