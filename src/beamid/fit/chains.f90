!> What draws of several chains are worth: effective sample sizes and the potential scale reduction,
!> rank-normalised (Vehtari, Gelman, Simpson, Carpenter and Bürkner, Bayesian Analysis 16, 2021,
!> 667; Geyer, Statistical Science 7, 1992, 473, for where sums of autocorrelations end).
module beamid_chains
   use beamid_distributions, only: normal_quantile
   use beamid_kinds, only: wp
   use beamid_sorting, only: sort
   implicit none
   private

   public :: bulk_size, tail_size, scale_reduction, quantile, mean_and_deviation

contains

   !> Effective number of draws for what lies in the middle of a distribution.
   !>
   !> draws  (length, chains)
   real(wp) function bulk_size(draws)
      real(wp), intent(in) :: draws(:, :)

      bulk_size = effective_size(normal_scores(halves(draws)))
   end function bulk_size

   !> The same for both of its 5 % tails, the smaller number.
   real(wp) function tail_size(draws)
      real(wp), intent(in) :: draws(:, :)
      real(wp), parameter :: tails(2) = [0.05_wp, 0.95_wp]
      real(wp) :: flat(size(draws))
      integer :: k

      flat = reshape(draws, [size(draws)])
      call sort(flat)
      tail_size = huge(tail_size)
      do k = 1, 2
         tail_size = min(tail_size, effective_size(halves(merge(1.0_wp, 0.0_wp, &
            draws <= quantile(flat, tails(k))))))
      end do
   end function tail_size

   !> 1 where chains agree in place and spread; above 1.01 they do not.
   real(wp) function scale_reduction(draws) result(r)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: flat(size(draws)), middle

      flat = reshape(draws, [size(draws)])
      call sort(flat)
      middle = quantile(flat, 0.5_wp)
      r = max(of_scores(draws), of_scores(abs(draws - middle)))

   contains

      real(wp) function of_scores(values)
         real(wp), intent(in) :: values(:, :)
         real(wp) :: within, between

         associate (z => normal_scores(halves(values)))
            call variances(z, within, between)
            of_scores = 1
            if (within > 0) then
               of_scores = sqrt((size(z, 1) - 1.0_wp)/size(z, 1) + between/within)
            else if (between > 0) then
               of_scores = huge(of_scores)
            end if
         end associate
      end function of_scores

   end function scale_reduction

   !> A quantile by linear interpolation between order statistics, the first of probability 0 and
   !> the last of probability 1.
   !>
   !> sorted  (n) ascending
   pure real(wp) function quantile(sorted, probability)
      real(wp), intent(in) :: sorted(:), probability
      real(wp) :: place
      integer :: k

      place = 1 + probability*(size(sorted) - 1)
      k = min(int(place), size(sorted) - 1)
      if (size(sorted) == 1) then
         quantile = sorted(1)
      else
         quantile = sorted(k) + (place - k)*(sorted(k + 1) - sorted(k))
      end if
   end function quantile

   !> deviation  the standard deviation, of n - 1
   pure subroutine mean_and_deviation(x, mean, deviation)
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: mean, deviation

      mean = sum(x)/size(x)
      deviation = sqrt(sum((x - mean)**2)/(size(x) - 1))
   end subroutine mean_and_deviation

   !> Each chain as two, without the draw in the middle where their number is odd.
   pure function halves(draws) result(split)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: split(size(draws, 1)/2, 2*size(draws, 2))
      integer :: k, n

      n = size(split, 1)
      do k = 1, size(draws, 2)
         split(:, 2*k - 1) = draws(:n, k)
         split(:, 2*k) = draws(size(draws, 1) - n + 1:, k)
      end do
   end function halves

   !> Normal scores of the ranks among all draws; equal draws have the mean of their ranks.
   function normal_scores(draws) result(scores)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: scores(size(draws, 1), size(draws, 2))
      real(wp) :: sorted(size(draws)), rank
      integer :: i, j

      sorted = reshape(draws, [size(draws)])
      call sort(sorted)
      do j = 1, size(draws, 2)
         do i = 1, size(draws, 1)
            rank = (below(draws(i, j), .false.) + below(draws(i, j), .true.) + 1)/2.0_wp
            scores(i, j) = normal_quantile((rank - 0.375_wp)/(size(sorted) + 0.25_wp))
         end do
      end do

   contains

      !> How many are smaller, or no larger, by bisection.
      pure integer function below(x, or_equal)
         real(wp), intent(in) :: x
         logical, intent(in) :: or_equal
         integer :: first, last, middle

         first = 0
         last = size(sorted) + 1
         do while (last - first > 1)
            middle = (first + last)/2
            if (sorted(middle) < x .or. (or_equal .and. .not. sorted(middle) > x)) then
               first = middle
            else
               last = middle
            end if
         end do
         below = first
      end function below

   end function normal_scores

   !> Mean variance in a chain, and variance of the chains' means.
   pure subroutine variances(draws, within, between)
      real(wp), intent(in) :: draws(:, :)
      real(wp), intent(out) :: within, between
      real(wp) :: means(size(draws, 2))
      integer :: n, k

      n = size(draws, 1)
      means = sum(draws, dim=1)/n
      within = 0
      do k = 1, size(means)
         within = within + sum((draws(:, k) - means(k))**2)/(n - 1)/size(means)
      end do
      between = sum((means - sum(means)/size(means))**2)/(size(means) - 1)
   end subroutine variances

   !> Number of independent draws of which the mean would be as uncertain: autocorrelations over
   !> all chains, summed in pairs while these are positive, and not above the pair before.
   real(wp) function effective_size(draws) result(effective)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: within, between, spread, total, pair, before, means(size(draws, 2))
      integer :: n, lag

      n = size(draws, 1)
      call variances(draws, within, between)
      spread = within*(n - 1)/n + between
      effective = size(draws)
      if (.not. spread > 0) return
      means = sum(draws, dim=1)/n
      ! The pair of lags 0 and 1 counts whatever it is.
      total = 1 + correlation(1)
      before = total
      lag = 2
      do while (lag < n - 2)
         pair = correlation(lag) + correlation(lag + 1)
         if (pair < 0 .or. lag >= n - 4) exit
         pair = min(pair, before)
         total = total + pair
         before = pair
         lag = lag + 2
      end do
      ! Of the last pair the first may be positive.
      if (lag < n - 2) total = total + max(0.0_wp, correlation(lag))/2
      effective = size(draws)/max(2*total - 1, 1/log10(real(size(draws), wp)))

   contains

      real(wp) function correlation(lag)
         integer, intent(in) :: lag
         real(wp) :: covariance
         integer :: k

         covariance = 0
         do k = 1, size(draws, 2)
            covariance = covariance + dot_product(draws(:n - lag, k) - means(k), &
               draws(lag + 1:, k) - means(k))/n/size(draws, 2)
         end do
         correlation = 1 - (within - covariance)/spread
         if (lag == 0) correlation = 1
      end function correlation

   end function effective_size

end module beamid_chains
