!> Computes the statistics of a least-squares fit from its Jacobian and residuals: standard errors,
!> correlations and intervals. Independent of the model.
module beamid_statistics
   use beamid_condensation, only: factor_of, few_rows
   use beamid_distributions, only: chi_square_tail, normal_quantile, student_quantile
   use beamid_errors, only: error_t, failure
   use beamid_kernels, only: lagged_products
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgesvd
   use beamid_strings, only: to_text
   implicit none
   private

   public :: statistics_t, new_statistics, unlimited

   !> Value of the standard error of a parameter about which the data say nothing.
   real(wp), parameter :: unlimited = huge(1.0_wp)

   !> Largest lag of the autocorrelations of residuals.
   integer, parameter, public :: max_lags = 20

   !> Results of linear theory around the estimate. m is the number of residuals, n that of the
   !> parameters. Standard errors, intervals and covariances are in the units of the parameters.
   type :: statistics_t
      integer :: samples = 0                         !< residuals of data
      integer :: parameters = 0                      !< n
      !> degrees of freedom: number of all rows, including prior knowledge, less n
      integer :: freedom = 0
      !> of the noise, sigma**2 = J/freedom; 1 if it is known and agrees with the residuals
      real(wp) :: variance = 0
      !> half width of a 95 % interval in standard errors: by Student's t, or by the normal
      !> distribution if the noise is known and explains the residuals
      real(wp) :: quantile = 0
      logical :: noise_is_known = .false.   !< as the argument `is_known` of `new_statistics`
      !> whether the noise is known, but the residuals are larger than this noise explains
      logical :: is_exceeded = .false.
      real(wp), allocatable :: covariance(:, :)      !< (n, n) of the estimate
      !> (n) standard errors; `unlimited` if the data say nothing about a parameter
      real(wp), allocatable :: std_error(:)
      real(wp), allocatable :: half_width(:)   !< (n) of the 95 % interval: quantile*std_error
      real(wp), allocatable :: correlation(:, :)     !< (n, n) of the estimate
      !> (n) singular values, descending, of the Jacobian with respect to relative changes: column j
      !> times scale(j)
      real(wp), allocatable :: singular(:)
      real(wp), allocatable :: direction(:, :)       !< (n, n) right singular vectors, in columns
      real(wp) :: condition = 0                      !< singular(1)/singular(n)
      !> (n) whether the half width of the 95 % interval is less than the absolute value
      logical, allocatable :: determined(:)
      !> (n) standard error and half width of the 95 % interval for residuals that are not white,
      !> never smaller than those above: the autocovariances of the residuals replace sigma**2
      !> (estimate of Newey and West)
      real(wp), allocatable :: corrected_error(:), corrected_half_width(:)
      !> (n) whether the estimates that several groups of rows favour differ by more than the
      !> residuals explain; the corrected error then comes from these differences
      logical, allocatable :: disputed(:)
      !> number of independent samples with as much information as the m correlated samples;
      !> smallest over the parameters
      real(wp) :: effective = 0
      !> (n) whether a caller has found, beyond linear theory, that a parameter is not determined
      logical, allocatable :: withdrawn(:)
   contains
      procedure :: withdraw, is_withdrawn, cannot_reject
   end type statistics_t

contains

   !> Computes the statistics of a fit.
   !>
   !> jacobian  (m, n) derivatives of the residuals with respect to the parameters
   !> residual  (m) at the estimate
   !> estimate  (n)
   !> scale     (n) > 0, unit of relative changes of each parameter: its value, or a moderate value
   !>           if that is zero
   !> error     no degrees of freedom left, or a singular value decomposition that does not converge
   !> samples   number of data rows, which come first; default: all rows. The other rows are prior
   !>           knowledge, weighted like data of the standard deviation `noise`
   !> noise     standard deviation of the noise used in these weights
   !> group     (samples) number of the group of each row, such as a record: within a group, errors
   !>           of the model may have a common cause. Default: one group
   !> shared    (n) whether several groups determine a parameter; required with `group`
   !> ordered   (samples) rows whose noise may depend on that of the row before; default: all
   !> is_known  whether each row has been divided by the known standard deviation of its noise. The
   !>           variance is then 1, unless the residuals are improbable with it; default .false.
   subroutine new_statistics(jacobian, residual, estimate, scale, statistics, error, samples, &
      noise, group, shared, ordered, is_known)
      real(wp), intent(in) :: jacobian(:, :), residual(:), estimate(:), scale(:)
      type(statistics_t), intent(out) :: statistics
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: samples
      real(wp), intent(in), optional :: noise
      integer, intent(in), optional :: group(:)
      logical, intent(in), optional :: shared(:), ordered(:)
      logical, intent(in), optional :: is_known
      real(wp) :: t
      integer :: m, n
      logical :: known

      known = .false.
      if (present(is_known)) known = is_known
      m = size(jacobian, 1)
      if (present(samples)) m = samples
      n = size(jacobian, 2)
      statistics%samples = m
      statistics%parameters = n
      statistics%freedom = size(jacobian, 1) - n
      if (statistics%freedom < merge(0, 1, known)) then
         call failure(error, 'statistics: '//to_text(m)// &
            ' residuals leave no degree of freedom for '//to_text(n)//' parameters')
         return
      end if
      call decompose(jacobian, scale, statistics%singular, statistics%direction, error)
      if (allocated(error)) return
      call find_variance(sum(residual(:m)**2), sum(residual**2), known, statistics)
      statistics%condition = unlimited
      if (statistics%singular(n) > statistics%singular(1)/unlimited) &
         statistics%condition = statistics%singular(1)/statistics%singular(n)

      call add_covariance(statistics, scale, epsilon(1.0_wp)*m*statistics%singular(1))
      t = statistics%quantile
      statistics%half_width = merge(unlimited, t*min(statistics%std_error, unlimited/t), &
         statistics%std_error >= unlimited/t)
      statistics%determined = statistics%half_width < abs(estimate)
      allocate (statistics%withdrawn(n), source=.false.)
      call correct_errors(jacobian, residual(:m), statistics, noise, group, shared, ordered)
   end subroutine new_statistics

   !> Sets the variance of the noise and the quantile of the intervals.
   !>
   !> J      sum of squares of the data
   !> total  that of all rows
   !> known  whether the rows are in units of a known noise
   subroutine find_variance(J, total, known, statistics)
      real(wp), intent(in) :: J, total
      logical, intent(in) :: known
      type(statistics_t), intent(inout) :: statistics
      real(wp), parameter :: improbable = 0.01_wp
      real(wp) :: freedom

      freedom = statistics%freedom
      statistics%noise_is_known = known
      if (known) then
         statistics%variance = 1
         ! One-sided: 2.5 % on either side leave 95 % between. `student_quantile` is two-sided.
         statistics%quantile = normal_quantile(0.975_wp)
         if (freedom > 0) statistics%is_exceeded = chi_square_tail(total, freedom) < improbable
         if (.not. statistics%is_exceeded) return
      end if
      statistics%variance = J/freedom
      statistics%quantile = student_quantile(0.95_wp, freedom)
   end subroutine find_variance

   !> Marks a parameter as not determined, whatever linear theory says.
   pure subroutine withdraw(self, parameter)
      class(statistics_t), intent(inout) :: self
      integer, intent(in) :: parameter

      self%determined(parameter) = .false.
      self%withdrawn(parameter) = .true.
   end subroutine withdraw

   !> Returns whether a parameter has been marked as not determined.
   pure logical function is_withdrawn(self, parameter)
      class(statistics_t), intent(in) :: self
      integer, intent(in) :: parameter

      is_withdrawn = .false.
      if (allocated(self%withdrawn)) is_withdrawn = self%withdrawn(parameter)
   end function is_withdrawn

   !> Returns whether a fit with another sum of squares is not rejected by the likelihood ratio.
   !>
   !> ratio      of the other sum of squares to that of this fit
   !> parameter  whose errors show how much less information coloured residuals carry than white
   !>            ones; the logarithm of the likelihood ratio counts less by that factor
   !> level      of significance
   pure logical function cannot_reject(self, ratio, parameter, level)
      class(statistics_t), intent(in) :: self
      real(wp), intent(in) :: ratio, level
      integer, intent(in) :: parameter
      real(wp) :: inflation

      inflation = 1
      associate (k => parameter)
         if (self%std_error(k) > 0) inflation = (self%corrected_error(k)/self%std_error(k))**2
      end associate
      cannot_reject = self%samples*log(ratio) < inflation*normal_quantile(1 - level/2)**2
   end function cannot_reject

   !> Computes covariance, sigma**2 V S**-2 V' in the parameters' units, correlation and standard
   !> errors. A parameter with a component in a direction whose singular value is round-off has an
   !> unlimited error.
   !>
   !> scale      (n) as in `new_statistics`
   !> threshold  singular values up to this one are round-off
   pure subroutine add_covariance(statistics, scale, threshold)
      type(statistics_t), intent(inout) :: statistics
      real(wp), intent(in) :: scale(:), threshold
      real(wp) :: inverse(size(scale), size(scale)), root(size(scale))
      logical :: is_lost(size(scale))
      real(wp) :: largest
      integer :: j, k

      ! In units of the largest singular value, to prevent overflow and underflow.
      inverse = 0
      is_lost = .false.
      largest = max(statistics%singular(1), tiny(1.0_wp))
      do k = 1, size(scale)
         associate (v => statistics%direction(:, k), s => statistics%singular(k)/largest)
            if (statistics%singular(k) <= threshold) then
               is_lost = is_lost .or. abs(v) > 1e-6_wp
               cycle
            end if
            do j = 1, size(scale)
               inverse(:, j) = inverse(:, j) + (v/s)*(v(j)/s)
            end do
         end associate
      end do
      root = [(sqrt(inverse(k, k)), k=1, size(scale))]
      allocate (statistics%covariance(size(scale), size(scale)))
      allocate (statistics%correlation(size(scale), size(scale)), source=0.0_wp)
      do j = 1, size(scale)
         statistics%covariance(:, j) = (sqrt(statistics%variance)*(scale/largest))*inverse(:, j) &
            *(sqrt(statistics%variance)*(scale(j)/largest))
         do k = 1, size(scale)
            if (j == k) statistics%correlation(k, j) = 1
            if (j /= k .and. .not. (is_lost(j) .or. is_lost(k))) statistics%correlation(k, j) = &
               inverse(k, j)/(root(k)*root(j))
         end do
      end do
      statistics%std_error = merge(unlimited, &
         min(unlimited, sqrt(statistics%variance)*(scale/largest)*root), is_lost)
   end subroutine add_covariance

   !> Corrects standard errors for correlated residuals, with their autocovariances up to lag
   !> `max_lags`, tapered linearly.
   !>
   !> jacobian    (m, n) of all rows
   !> residual    (samples) of the data
   !> statistics  in: all but the corrected errors; out: with them
   !> noise, group, shared, ordered  as in `new_statistics`
   subroutine correct_errors(jacobian, residual, statistics, noise, group, shared, ordered)
      real(wp), intent(in) :: jacobian(:, :), residual(:)
      type(statistics_t), intent(inout) :: statistics
      real(wp), intent(in), optional :: noise
      integer, intent(in), optional :: group(:)
      logical, intent(in), optional :: shared(:), ordered(:)
      real(wp), allocatable :: influence(:), sequence(:), pull(:, :), share(:, :)
      real(wp) :: autocovariance(max_lags), products(max_lags), variance
      integer :: j, k, m, lags, length

      m = size(residual)
      lags = min(max_lags, m/2)
      statistics%corrected_error = statistics%std_error
      statistics%disputed = spread(.false., 1, statistics%parameters)
      statistics%effective = m
      ! Nothing to correct, or errors so large that their squares overflow.
      if (.not. statistics%variance > 0 .or. &
         any(statistics%std_error >= sqrt(unlimited)*epsilon(unlimited))) then
         statistics%corrected_half_width = statistics%half_width
         return
      end if
      sequence = residual
      length = m
      if (present(ordered)) then
         length = count(ordered)
         if (length < m) where (.not. ordered) sequence = 0
      end if
      if (length <= statistics%parameters) lags = 0
      autocovariance(:lags) = [(1 - k/(lags + 1.0_wp), k=1, lags)] &
         *lagged_products(sequence, lags)/max(1, length - statistics%parameters)
      k = 0
      if (present(group)) k = maxval(group)
      allocate (pull(k, statistics%parameters), share(k, statistics%parameters))
      allocate (influence(size(jacobian, 1)))
      do j = 1, statistics%parameters
         ! Change of the estimate per unit of each residual.
         influence = 0
         do k = 1, statistics%parameters
            influence = influence + (statistics%covariance(k, j)/statistics%variance)*jacobian(:, k)
         end do
         variance = statistics%covariance(j, j)
         if (present(noise)) variance = variance &
            + max(0.0_wp, noise**2 - statistics%variance)*sum(influence(m + 1:)**2)
         products(:lags) = lagged_products(influence(:m), lags)
         variance = variance + 2*sum(autocovariance(:lags)*products(:lags))
         if (present(group)) call find_pulls(influence, residual, group, pull(:, j), share(:, j))
         if (variance <= statistics%covariance(j, j)) cycle
         statistics%corrected_error(j) = sqrt(variance)
         statistics%effective = min(statistics%effective, m*statistics%covariance(j, j)/variance)
      end do
      if (length == 0) then
         statistics%corrected_half_width = statistics%corrected_error*statistics%quantile
      else
         statistics%corrected_half_width = statistics%corrected_error*student_quantile(0.95_wp, &
            max(1.0_wp, statistics%effective - statistics%parameters))
      end if
      if (present(group)) call add_disagreement(pull, share, shared, statistics)
   end subroutine correct_errors

   !> Computes the contribution of each group to the estimate of a parameter.
   !>
   !> influence  (m or more) change of the estimate per unit of residual
   !> residual   (m) of the data
   !> group      (m) number of the group of each row
   !> pull       (R) contributions of the groups
   !> share      (R) their variances for residuals of variance one
   pure subroutine find_pulls(influence, residual, group, pull, share)
      real(wp), intent(in) :: influence(:), residual(:)
      integer, intent(in) :: group(:)
      real(wp), intent(out) :: pull(:), share(:)
      integer :: k

      pull = 0
      share = 0
      do k = 1, size(residual)
         pull(group(k)) = pull(group(k)) + influence(k)*residual(k)
         share(group(k)) = share(group(k)) + influence(k)**2
      end do
   end subroutine find_pulls

   !> Corrects standard errors for disagreement between groups. The contribution of group r to the
   !> estimate, e_r = sum of influence times residual over the group, sums to zero over all R
   !> groups, and R/(R - 1) sum e_r**2 estimates the variance whatever is wrong with the model in
   !> each group. This estimate, with R - 1 degrees of freedom, is used if it is the larger one, and
   !> if the sum of e_r**2/var(e_r), with the variances that the (coloured) noise gives the e_r, is
   !> improbable. Groups that say almost nothing about a parameter do not count.
   !>
   !> pulls   (R, n) contributions of each group
   !> shares  (R, n) their variances for residuals of variance one
   !> shared  (n) whether several groups determine a parameter
   subroutine add_disagreement(pulls, shares, shared, statistics)
      real(wp), intent(in) :: pulls(:, :), shares(:, :)
      logical, intent(in) :: shared(:)
      type(statistics_t), intent(inout) :: statistics
      !> For all parameters together.
      real(wp), parameter :: improbable = 0.05_wp
      !> Share of the variance of an estimate below which a group does not count.
      real(wp), parameter :: negligible = 1e-4_wp
      real(wp) :: square(size(pulls, 1)), variance(size(pulls, 1)), total
      logical :: counts(size(pulls, 1))
      integer :: groups, j

      do j = 1, statistics%parameters
         if (.not. (shared(j) .and. statistics%std_error(j) > 0)) cycle
         counts = shares(:, j) > negligible*sum(shares(:, j))
         groups = count(counts)
         if (groups < 2) cycle
         variance = statistics%variance*shares(:, j) &
            *(statistics%corrected_error(j)/statistics%std_error(j))**2
         square = 0
         where (counts) square = pulls(:, j)**2/variance
         if (chi_square_tail(sum(square), real(groups - 1, wp)) >= improbable/count(shared)) cycle
         total = sqrt(groups/(groups - 1.0_wp)*sum(pulls(:, j)**2, mask=counts))
         if (total <= statistics%corrected_error(j)) cycle
         statistics%disputed(j) = .true.
         statistics%corrected_error(j) = total
         statistics%corrected_half_width(j) = total*student_quantile(0.95_wp, groups - 1.0_wp)
      end do
   end subroutine add_disagreement

   !> Computes singular values, (n), and right singular vectors, (n, n), of the Jacobian with scaled
   !> columns.
   subroutine decompose(jacobian, scale, singular, direction, error)
      real(wp), intent(in) :: jacobian(:, :), scale(:)
      real(wp), allocatable, intent(out) :: singular(:), direction(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: a(:, :), vt(:, :), work(:)
      real(wp) :: unused(1, 1)
      integer :: m, n, info

      n = size(jacobian, 2)
      if (size(jacobian, 1) < few_rows) then
         a = jacobian*spread(scale, 1, size(jacobian, 1))
      else
         ! The triangle has the same singular values and right singular vectors.
         a = factor_of(jacobian)*spread(scale, 1, n)
      end if
      m = size(a, 1)
      allocate (singular(n), vt(n, n), work(10*(m + n)))
      call dgesvd('N', 'A', m, n, a, m, singular, unused, 1, vt, n, work, size(work), info)
      direction = transpose(vt)
      if (info /= 0) call failure(error, &
         'statistics: the singular value decomposition did not converge')
   end subroutine decompose

end module beamid_statistics
