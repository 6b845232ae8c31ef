!> Computes bootstrap intervals from estimates of resampled data, and the blocks for resampling
!> correlated residuals (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, sections 13.3
!> and 14.3; Künsch, Annals of Statistics 17, 1989, 1217, for blocks).
module beamid_resampling
   use beamid_chains, only: quantile
   use beamid_distributions, only: normal_probability, normal_quantile
   use beamid_kinds, only: wp
   use beamid_noise, only: uniform_noise
   use beamid_sorting, only: sort
   implicit none
   private

   public :: percentile_interval, corrected_interval, acceleration, block_places, usual_block

contains

   !> Returns the ends of the 95 % percentile interval.
   !>
   !> estimates  (n) of resampled data
   function percentile_interval(estimates) result(ends)
      real(wp), intent(in) :: estimates(:)
      real(wp) :: ends(2), sorted(size(estimates))

      sorted = estimates
      call sort(sorted)
      ends = [quantile(sorted, 0.025_wp), quantile(sorted, 0.975_wp)]
   end function percentile_interval

   !> Returns the ends of the 95 % interval with correction for bias and acceleration (BCa).
   !>
   !> estimates  (n) of resampled data
   !> estimate   from the data themselves
   !> a          acceleration
   function corrected_interval(estimates, estimate, a) result(ends)
      real(wp), intent(in) :: estimates(:), estimate, a
      real(wp) :: ends(2), sorted(size(estimates)), bias, level(2), share_below
      integer :: n

      n = size(estimates)
      sorted = estimates
      call sort(sorted)
      share_below = (count(estimates < estimate) + count(estimates <= estimate))/(2.0_wp*n)
      bias = normal_quantile(min(max(share_below, 0.5_wp/n), 1 - 0.5_wp/n))
      level = bias + normal_quantile([0.025_wp, 0.975_wp])
      level = normal_probability(bias + level/(1 - a*level))
      ends = [quantile(sorted, level(1)), quantile(sorted, level(2))]
   end function corrected_interval

   !> Returns the acceleration, the rate at which the standard error changes with the parameter,
   !> from the influence of each datum on the estimate.
   !>
   !> influence  (m), with a sum of 0 or nearly 0
   pure real(wp) function acceleration(influence) result(a)
      real(wp), intent(in) :: influence(:)

      a = 0
      if (any(abs(influence) > 0)) a = sum(influence**3)/(6*sum(influence**2)**1.5_wp)
   end function acceleration

   !> Returns m indices for a moving-block bootstrap: consecutive blocks of a length, each starting
   !> at a random index.
   !>
   !> m       number of values
   !> length  of a block
   !> seed    any integer
   function block_places(m, length, seed) result(places)
      integer, intent(in) :: m, length, seed
      integer :: places(m), first, k
      real(wp) :: u((m + length - 1)/length)

      u = uniform_noise(size(u), seed)
      do k = 1, m
         first = 1 + int(u((k - 1)/length + 1)*(m - length + 1))
         places(k) = first + modulo(k - 1, length)
      end do
   end function block_places

   !> Returns a block length that grows with the cube root of the number of samples and with the
   !> correlation time (Politis and White, Econometric Reviews 23, 2004, 53, with the constant of
   !> the circular bootstrap).
   !>
   !> r  (m) residuals in order of time
   pure integer function usual_block(r) result(length)
      real(wp), intent(in) :: r(:)
      real(wp), allocatable :: correlation(:)
      real(wp) :: g, spectrum, window, band
      integer :: k, m, insignificant_lags, last

      m = size(r)
      length = 1
      if (.not. any(abs(r) > 0) .or. m < 8) return
      insignificant_lags = max(5, int(sqrt(log10(real(m, wp)))))
      last = min(m - 1, int(sqrt(real(m, wp))) + insignificant_lags)
      allocate (correlation(0:last))
      do k = 0, last
         correlation(k) = dot_product(r(:m - k), r(k + 1:))/sum(r**2)
      end do
      band = 2*sqrt(log10(real(m, wp))/m)
      ! The sums extend to twice the lag after which several consecutive correlations are
      ! insignificant.
      do k = 0, last - insignificant_lags
         if (all(abs(correlation(k + 1:k + insignificant_lags)) < band)) exit
      end do
      last = min(last, max(2*k, 1))
      g = 0
      spectrum = correlation(0)
      do k = 1, last
         window = min(1.0_wp, 2*(1 - real(k, wp)/last))
         g = g + 2*window*k*correlation(k)
         spectrum = spectrum + 2*window*correlation(k)
      end do
      if (abs(spectrum) > 0) length = nint((2*g**2/(4*spectrum**2/3))**(1/3.0_wp) &
         *m**(1/3.0_wp))
      length = min(max(length, 1), max(1, int(3*sqrt(real(m, wp)))), m/3)
   end function usual_block

end module beamid_resampling
