!> What a least-squares fit says about its parameters: errors, correlations, what is not determined,
!> and whether the residuals look like noise. Works on any Jacobian.
module beamid_statistics
   use beamid_distributions, only: chi_square_tail, student_quantile
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgesvd
   use beamid_strings, only: fixed, to_text
   implicit none
   private

   public :: statistics_t, new_statistics, undetermined, misfit_of_records
   public :: aicc, bic, nested_test, unlimited

   !> Stands for the error of a parameter that the record says nothing about.
   real(wp), parameter :: unlimited = huge(1.0_wp)

   !> Lags of the autocorrelation.
   integer, parameter, public :: max_lags = 20

   !> Linear theory around the estimate.
   type :: statistics_t
      integer :: samples = 0, parameters = 0
      integer :: freedom = 0                         !< rows, what else is known included, - n
      real(wp) :: variance = 0                       !< of the noise, J/freedom
      real(wp), allocatable :: covariance(:, :)      !< (n, n)
      !> (n); `unlimited` where the record says nothing about a parameter
      real(wp), allocatable :: std_error(:)
      real(wp), allocatable :: half_width(:)         !< (n) of the 95 % interval
      real(wp), allocatable :: correlation(:, :)     !< (n, n)
      !> Singular values, descending, of the Jacobian per relative change: column j times scale_j.
      real(wp), allocatable :: singular(:)
      real(wp), allocatable :: direction(:, :)       !< (n, n) column k belongs to singular(k)
      real(wp) :: condition = 0                      !< singular(1)/singular(n)
      !> (n) the 95 % interval is narrower than the value
      logical, allocatable :: determined(:)
      !> The same for residuals that are not white, never smaller: with their autocovariance in the
      !> place of sigma**2 (Newey and West's estimate), and the number of independent samples that
      !> would carry as much, the least over the parameters, in that of m.
      real(wp), allocatable :: corrected_error(:), corrected_half_width(:)
      !> (n) several records pull a parameter apart by more than their residuals explain; its
      !> corrected error is from that
      logical, allocatable :: disputed(:)
      real(wp) :: effective = 0
      !> (n) somebody knows better than linear theory that a parameter is not determined
      logical, allocatable :: withdrawn(:)
   contains
      procedure :: withdraw
      procedure :: is_withdrawn
   end type statistics_t

contains

   !> jacobian  (m, n) derivatives of the residuals with respect to the parameters
   !> residual  (m)
   !> estimate  (n)
   !> scale     (n) > 0, what a relative change of each parameter is relative to: its value, or
   !>           where that is zero something of its usual size
   !> error     no degrees of freedom left, or a singular value decomposition that fails
   !> samples   so many rows are data, the first ones; default all. The others are what else is
   !>           known, as uncertain as data of the standard deviation `noise`
   !> first     first rows of several records, and (n) what these have in common
   subroutine new_statistics(jacobian, residual, estimate, scale, statistics, error, samples, &
      noise, first, shared)
      real(wp), intent(in) :: jacobian(:, :), residual(:), estimate(:), scale(:)
      type(statistics_t), intent(out) :: statistics
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: samples
      real(wp), intent(in), optional :: noise
      integer, intent(in), optional :: first(:)
      logical, intent(in), optional :: shared(:)
      real(wp) :: t
      integer :: m, n

      m = size(jacobian, 1)
      if (present(samples)) m = samples
      n = size(jacobian, 2)
      statistics%samples = m
      statistics%parameters = n
      statistics%freedom = size(jacobian, 1) - n
      if (statistics%freedom < 1) then
         call failure(error, 'statistics: '//to_text(m)// &
            ' residuals leave no degree of freedom for '//to_text(n)//' parameters')
         return
      end if
      call decompose(jacobian, scale, statistics%singular, statistics%direction, error)
      if (allocated(error)) return
      statistics%variance = sum(residual(:m)**2)/statistics%freedom
      statistics%condition = unlimited
      if (statistics%singular(n) > statistics%singular(1)/unlimited) &
         statistics%condition = statistics%singular(1)/statistics%singular(n)

      call add_covariance(statistics, scale, epsilon(1.0_wp)*m*statistics%singular(1))
      t = student_quantile(0.95_wp, real(statistics%freedom, wp))
      statistics%half_width = merge(unlimited, t*min(statistics%std_error, unlimited/t), &
         statistics%std_error >= unlimited/t)
      statistics%determined = statistics%half_width < abs(estimate)
      allocate (statistics%withdrawn(n), source=.false.)
      call correct_errors(jacobian, residual(:m), statistics, noise, first, shared)
   end subroutine new_statistics

   !> Takes back what linear theory says of a parameter.
   pure subroutine withdraw(self, parameter)
      class(statistics_t), intent(inout) :: self
      integer, intent(in) :: parameter

      self%determined(parameter) = .false.
      self%withdrawn(parameter) = .true.
   end subroutine withdraw

   pure logical function is_withdrawn(self, parameter)
      class(statistics_t), intent(in) :: self
      integer, intent(in) :: parameter

      is_withdrawn = .false.
      if (allocated(self%withdrawn)) is_withdrawn = self%withdrawn(parameter)
   end function is_withdrawn

   !> What takes the place of J where the noise of several records is estimated from the fit itself,
   !> and J with it says nothing: m times the geometric mean of the variances of all m samples.
   !>
   !> residual  (m) without weights
   !> samples   (records) of each, one after the other
   pure real(wp) function misfit_of_records(residual, samples) result(J)
      real(wp), intent(in) :: residual(:)
      integer, intent(in) :: samples(:)
      real(wp) :: likelihood
      integer :: k, row

      likelihood = 0
      row = 0
      do k = 1, size(samples)
         associate (m => samples(k))
            likelihood = likelihood + m*log(max(tiny(J), sum(residual(row + 1:row + m)**2)/m))
            row = row + m
         end associate
      end do
      J = row*exp(likelihood/row)
   end function misfit_of_records

   !> Covariance sigma**2 V S**-2 V', undone for the scale. A parameter with a part in a direction
   !> whose singular value is round-off has no limits at all.
   !>
   !> smallest  singular values up to here are round-off
   pure subroutine add_covariance(statistics, scale, smallest)
      type(statistics_t), intent(inout) :: statistics
      real(wp), intent(in) :: scale(:), smallest
      real(wp) :: inverse(size(scale), size(scale)), root(size(scale))
      logical :: lost(size(scale))
      real(wp) :: largest
      integer :: j, k

      ! In units of the largest singular value, so that nothing over- or underflows on the way.
      inverse = 0
      lost = .false.
      largest = max(statistics%singular(1), tiny(1.0_wp))
      do k = 1, size(scale)
         associate (v => statistics%direction(:, k), s => statistics%singular(k)/largest)
            if (statistics%singular(k) <= smallest) then
               lost = lost .or. abs(v) > 1e-6_wp
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
            if (j /= k .and. .not. (lost(j) .or. lost(k))) statistics%correlation(k, j) = &
               inverse(k, j)/(root(k)*root(j))
         end do
      end do
      statistics%std_error = merge(unlimited, &
         min(unlimited, sqrt(statistics%variance)*(scale/largest)*root), lost)
   end subroutine add_covariance

   !> Errors with the autocovariances of the residuals up to `max_lags`, tapered linearly.
   !>
   !> residual  of the data
   subroutine correct_errors(jacobian, residual, statistics, noise, first, shared)
      real(wp), intent(in) :: jacobian(:, :), residual(:)
      type(statistics_t), intent(inout) :: statistics
      real(wp), intent(in), optional :: noise
      integer, intent(in), optional :: first(:)
      logical, intent(in), optional :: shared(:)
      real(wp), allocatable :: influence(:, :)
      real(wp) :: variance, gamma
      integer :: j, k, m, lags

      ! A row of `influence` is what a unit residual does to an estimate.
      m = size(residual)
      lags = min(max_lags, m/2)
      statistics%corrected_error = statistics%std_error
      statistics%disputed = spread(.false., 1, statistics%parameters)
      statistics%effective = m
      ! Nothing to correct, or nothing that could be squared.
      if (.not. statistics%variance > 0 .or. &
         any(statistics%std_error >= sqrt(unlimited)*epsilon(unlimited))) then
         statistics%corrected_half_width = statistics%half_width
         return
      end if
      influence = matmul(jacobian, statistics%covariance)/statistics%variance
      do j = 1, statistics%parameters
         variance = statistics%covariance(j, j)
         if (present(noise)) variance = variance &
            + max(0.0_wp, noise**2 - statistics%variance)*sum(influence(m + 1:, j)**2)
         do k = 1, lags
            gamma = dot_product(residual(:m - k), residual(k + 1:))/(m - statistics%parameters)
            variance = variance + 2*(1 - k/(lags + 1.0_wp))*gamma &
               *dot_product(influence(:m - k, j), influence(k + 1:m, j))
         end do
         if (variance <= statistics%covariance(j, j)) cycle
         statistics%corrected_error(j) = sqrt(variance)
         statistics%effective = min(statistics%effective, m*statistics%covariance(j, j)/variance)
      end do
      statistics%corrected_half_width = statistics%corrected_error*student_quantile(0.95_wp, &
         max(1.0_wp, statistics%effective - statistics%parameters))
      if (present(first)) call add_dispute(influence, residual, first, shared, statistics)
   end subroutine correct_errors

   !> Errors from how far apart records pull an estimate: e_r, the sum of influence times residual
   !> over record r, adds up to nothing over all of them, and R/(R - 1) sum e_r**2 is its variance
   !> whatever is wrong with the model in each. Taken where the sum is improbable for the variances
   !> that noise as coloured as it is gives these e_r; with R - 1 degrees of freedom.
   !>
   !> first   (R) first row of each record
   !> shared  (n)
   subroutine add_dispute(influence, residual, first, shared, statistics)
      real(wp), intent(in) :: influence(:, :), residual(:)
      integer, intent(in) :: first(:)
      logical, intent(in) :: shared(:)
      type(statistics_t), intent(inout) :: statistics
      real(wp), parameter :: improbable = 0.05_wp
      real(wp) :: pull(size(first)), variance(size(first)), total
      integer :: j, last, r, records

      records = size(first)
      if (records < 2) return
      do j = 1, statistics%parameters
         if (.not. (shared(j) .and. statistics%std_error(j) > 0)) cycle
         do r = 1, records
            last = size(residual)
            if (r < records) last = first(r + 1) - 1
            associate (g => influence(first(r):last, j))
               pull(r) = dot_product(g, residual(first(r):last))
               variance(r) = statistics%variance*sum(g**2)
            end associate
         end do
         variance = variance*(statistics%corrected_error(j)/statistics%std_error(j))**2
         where (variance > 0) pull = pull**2/variance
         if (chi_square_tail(sum(pull, mask=variance > 0), real(count(variance > 0) - 1, wp)) &
            >= improbable) cycle
         total = sqrt(records/(records - 1.0_wp)*sum(pull*variance, mask=variance > 0))
         if (total <= statistics%corrected_error(j)) cycle
         statistics%disputed(j) = .true.
         statistics%corrected_error(j) = total
         statistics%corrected_half_width(j) = total*student_quantile(0.95_wp, records - 1.0_wp)
      end do
   end subroutine add_dispute

   !> Singular values and right singular vectors of the Jacobian with its columns scaled.
   subroutine decompose(jacobian, scale, singular, direction, error)
      real(wp), intent(in) :: jacobian(:, :), scale(:)
      real(wp), allocatable, intent(out) :: singular(:), direction(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: a(:, :), vt(:, :), work(:)
      real(wp) :: unused(1, 1)
      integer :: m, n, info

      m = size(jacobian, 1)
      n = size(jacobian, 2)
      a = jacobian*spread(scale, 1, m)
      allocate (singular(n), vt(n, n), work(10*(m + n)))
      call dgesvd('N', 'A', m, n, a, m, singular, unused, 1, vt, n, work, size(work), info)
      direction = transpose(vt)
      if (info /= 0) call failure(error, &
         'statistics: the singular value decomposition did not converge')
   end subroutine decompose

   !> A sentence for each combination of parameters that the record does not determine: a relative
   !> change along it that the noise cannot tell from nothing is larger than one.
   !>
   !> names     (n)
   !> scale     (n) as in `new_statistics`
   !> jacobian  (m, n) for the change of J along a direction
   function undetermined(statistics, names, scale, jacobian) result(sentences)
      type(statistics_t), intent(in) :: statistics
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in) :: scale(:), jacobian(:, :)
      character(len=512), allocatable :: sentences(:)
      real(wp) :: t, threshold
      integer :: k, n

      n = statistics%parameters
      allocate (sentences(0))
      t = student_quantile(0.95_wp, real(statistics%freedom, wp))
      threshold = max(t*sqrt(statistics%variance), &
         epsilon(1.0_wp)*statistics%samples*statistics%singular(1))
      do k = n, 1, -1
         if (statistics%singular(k) > threshold) cycle
         sentences = [character(len=512) :: sentences, sentence(statistics, names, scale, &
            jacobian, k)]
      end do
   end function undetermined

   !> What direction k is, and how flat J lies along it.
   function sentence(statistics, names, scale, jacobian, k) result(text)
      type(statistics_t), intent(in) :: statistics
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in) :: scale(:), jacobian(:, :)
      integer, intent(in) :: k
      character(len=:), allocatable :: text
      real(wp), allocatable :: v(:)
      real(wp) :: J, change, along, least
      integer :: i, largest

      J = statistics%variance*statistics%freedom
      v = statistics%direction(:, k)
      largest = maxloc(abs(v), dim=1)
      v = v/v(largest)
      ! Alone, or together with others whose small changes have as much effect?
      change = sum((jacobian(:, largest)*scale(largest))**2)
      along = (statistics%singular(k)/statistics%direction(largest, k))**2
      least = 0.1_wp
      if (count(abs(v) > least) == 1 .and. change > 4*along) least = 1e-4_wp
      if (count(abs(v) > least) == 1) then
         text = trim(names(largest))// &
            ' is not determined by this record: doubling it changes J by '// &
            to_text(change)//' ('//to_text(100*(change/max(J, tiny(J))))//' % of J)'
         return
      end if
      text = ''
      do i = 1, size(v)
         if (abs(v(i)) <= least) cycle
         if (text /= '') text = text//', '
         text = text//trim(names(i))//' by '//signed(100*v(i))//' %'
      end do
      text = 'not determined together: changing '//text//' at once changes J by '//to_text(along)
   end function sentence

   !> Whole per cent, or two digits of less.
   pure function signed(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = trim(adjustl(fixed(value, 12, merge(0, 2, abs(value) >= 1))))
      text = text(:verify(text, '.', back=.true.))
      if (value > 0) text = '+'//text
   end function signed

   !> Akaike's criterion with the correction for few samples:
   !> m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), k = parameters + 1 with the noise variance.
   pure real(wp) function aicc(J, samples, parameters) result(value)
      real(wp), intent(in) :: J
      integer, intent(in) :: samples, parameters
      integer :: k

      k = parameters + 1
      value = samples*log(J/samples) + 2*k
      if (samples > k + 1) then
         value = value + 2.0_wp*k*(k + 1)/(samples - k - 1)
      else
         value = huge(value)
      end if
   end function aicc

   !> Schwarz's criterion: m ln(J/m) + k ln m.
   pure real(wp) function bic(J, samples, parameters) result(value)
      real(wp), intent(in) :: J
      integer, intent(in) :: samples, parameters

      value = samples*log(J/samples) + (parameters + 1)*log(real(samples, wp))
   end function bic

   !> Banks and Fitzpatrick: U = m (J_restricted - J_full)/J_full against chi-square with as many
   !> degrees of freedom as there are restrictions.
   !>
   !> probability  of so large a U if the restrictions hold
   pure subroutine nested_test(J_restricted, J_full, samples, restrictions, U, probability)
      real(wp), intent(in) :: J_restricted, J_full
      integer, intent(in) :: samples, restrictions
      real(wp), intent(out) :: U, probability

      U = samples*(J_restricted - J_full)/J_full
      probability = chi_square_tail(U, real(restrictions, wp))
   end subroutine nested_test

end module beamid_statistics
