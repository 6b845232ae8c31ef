!> Computes diagnostics of Markov chains: effective sample sizes and the potential scale reduction,
!> both rank-normalised (Vehtari, Gelman, Simpson, Carpenter and Bürkner, Bayesian Analysis 16,
!> 2021, 667). Sums of autocorrelations are truncated after Geyer (Statistical Science 7, 1992,
!> 473). `beamid_sampling` judges its draws with them.
module beamid_chains
   use beamid_distributions, only: normal_quantile
   use beamid_kinds, only: wp
   use beamid_sorting, only: sort
   implicit none
   private

   public :: diagnose_chains, quantile, mean_and_deviation

contains

   !> Computes the diagnostics of one parameter.
   !>
   !> draws      (length, chains)
   !> bulk       effective sample size for the middle of the distribution (bulk-ESS)
   !> tail       effective sample size for the tails (tail-ESS): the smaller of the sizes for the
   !>            5 % and the 95 % quantile
   !> reduction  potential scale reduction: about 1 if chains agree, otherwise larger
   subroutine diagnose_chains(draws, bulk, tail, reduction)
      real(wp), intent(in) :: draws(:, :)
      real(wp), intent(out) :: bulk, tail, reduction
      real(wp), parameter :: tails(2) = [0.05_wp, 0.95_wp]
      real(wp), dimension(size(draws, 1)/2, 2*size(draws, 2)) :: split, folded, scores
      real(wp), allocatable :: sorted(:)
      real(wp) :: known(size(split))
      integer :: k

      split = split_chains(draws)
      sorted = ascending(split)
      known = 0
      call find_normal_scores(split, sorted, known, scores)
      bulk = effective_size(scores)
      folded = abs(split - quantile(sorted, 0.5_wp))
      associate (lower => sorted((size(sorted) + 1)/2), upper => sorted(size(sorted)/2 + 1))
         ! The two draws beside the median of an even number are equally far from it; round-off
         ! must not give them different ranks.
         where (split >= lower .and. split <= upper) folded = (upper - lower)/2
      end associate
      reduction = reduction_of(scores)
      call find_normal_scores(folded, ascending(folded), known, scores)
      reduction = max(reduction, reduction_of(scores))
      if (size(split) < size(draws)) sorted = ascending(draws)
      tail = huge(tail)
      do k = 1, 2
         tail = min(tail, effective_size(split_chains(merge(1.0_wp, 0.0_wp, draws <= &
            quantile(sorted, tails(k))))))
      end do
   end subroutine diagnose_chains

   !> Returns all draws in ascending order.
   function ascending(draws) result(sorted)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: sorted(size(draws))

      sorted = reshape(draws, [size(draws)])
      call sort(sorted)
   end function ascending

   !> Returns the potential scale reduction of normal scores.
   real(wp) function reduction_of(scores)
      real(wp), intent(in) :: scores(:, :)
      real(wp) :: within, between

      call variances(scores, within, between)
      reduction_of = 1
      if (within > 0) then
         reduction_of = sqrt((size(scores, 1) - 1.0_wp)/size(scores, 1) + between/within)
      else if (between > 0) then
         reduction_of = huge(reduction_of)
      end if
   end function reduction_of

   !> Returns a quantile by linear interpolation between order statistics, of which the first has
   !> the probability 0 and the last the probability 1.
   !>
   !> sorted       (n) ascending
   !> probability  0 .. 1
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

   !> Computes mean and standard deviation (with n - 1) of x (n).
   pure subroutine mean_and_deviation(x, mean, deviation)
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: mean, deviation

      mean = sum(x)/size(x)
      deviation = sqrt(sum((x - mean)**2)/(size(x) - 1))
   end subroutine mean_and_deviation

   !> Splits each chain in two halves, without the draw in the middle if their number is odd.
   pure function split_chains(draws) result(split)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: split(size(draws, 1)/2, 2*size(draws, 2))
      integer :: k, n

      n = size(split, 1)
      do k = 1, size(draws, 2)
         split(:, 2*k - 1) = draws(:n, k)
         split(:, 2*k) = draws(size(draws, 1) - n + 1:, k)
      end do
   end function split_chains

   !> Computes the normal scores of the ranks among all draws; equal draws have their mean rank.
   !>
   !> sorted  (size of draws) the draws in ascending order
   !> known   (size of draws) scores by rank that are known from another call for as many draws, all
   !>         below 0; 0: not known yet
   !> scores  (shape of draws)
   subroutine find_normal_scores(draws, sorted, known, scores)
      real(wp), intent(in) :: draws(:, :), sorted(:)
      real(wp), intent(inout) :: known(:)
      real(wp), intent(out) :: scores(:, :)
      integer :: below, i, j, k, up_to

      do j = 1, size(draws, 2)
         do i = 1, size(draws, 1)
            below = count_below(draws(i, j), .false.)
            ! Most draws have no equal.
            up_to = below + 1
            if (.not. sorted(min(below + 2, size(sorted))) > draws(i, j)) &
               up_to = count_below(draws(i, j), .true.)
            ! The scores are symmetric: that of the middle is 0, and half of the others are known.
            scores(i, j) = 0
            if (below + up_to == size(sorted)) cycle
            k = min(below + up_to, 2*size(sorted) - below - up_to)
            if (.not. known(k) < 0) known(k) = normal_quantile(((k + 1)/2.0_wp - 0.375_wp) &
               /(size(sorted) + 0.25_wp))
            scores(i, j) = sign(known(k), below + up_to - real(size(sorted), wp))
         end do
      end do

   contains

      !> Returns, by bisection, how many draws are smaller than x, or not larger.
      pure integer function count_below(x, or_equal)
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
         count_below = first
      end function count_below

   end subroutine find_normal_scores

   !> Computes the mean variance within a chain, and the variance of the chains' means.
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

   !> Returns the number of independent draws whose mean would have the same variance.
   !> Autocorrelations over all chains are summed in pairs while the pairs are positive, and each
   !> pair counts at most as much as the pair before.
   real(wp) function effective_size(draws) result(effective)
      real(wp), intent(in) :: draws(:, :)
      real(wp) :: within, between, total_variance, total, pair, previous_pair, means(size(draws, 2))
      integer :: n, lag

      n = size(draws, 1)
      call variances(draws, within, between)
      total_variance = within*(n - 1)/n + between
      effective = size(draws)
      if (.not. total_variance > 0) return
      means = sum(draws, dim=1)/n
      ! The pair of lags 0 and 1 always counts.
      total = 1 + correlation(1)
      previous_pair = total
      lag = 2
      do while (lag < n - 2)
         pair = correlation(lag) + correlation(lag + 1)
         if (pair < 0 .or. lag >= n - 4) exit
         pair = min(pair, previous_pair)
         total = total + pair
         previous_pair = pair
         lag = lag + 2
      end do
      ! The first autocorrelation of the last pair may be positive.
      if (lag < n - 2) total = total + max(0.0_wp, correlation(lag))/2
      effective = size(draws)/max(2*total - 1, 1/log10(real(size(draws), wp)))

   contains

      !> Returns the autocorrelation at a lag above 0 over all chains.
      real(wp) function correlation(lag)
         integer, intent(in) :: lag
         real(wp) :: covariance
         integer :: k

         covariance = 0
         do k = 1, size(draws, 2)
            covariance = covariance + dot_product(draws(:n - lag, k) - means(k), &
               draws(lag + 1:, k) - means(k))/n/size(draws, 2)
         end do
         correlation = 1 - (within - covariance)/total_variance
      end function correlation

   end function effective_size

end module beamid_chains
