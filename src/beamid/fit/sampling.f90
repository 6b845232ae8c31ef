!> Draws from a probability density of several parameters: by importance sampling from a proposal
!> distribution that is fitted to the density (`beamid_proposals`), or by Markov chains if the
!> weights show that importance sampling fails. The posterior distribution of a fit is sampled here.
!>
!> The density takes nearly all the time. Near the mode, a polynomial (`beamid_surrogates`) stands
!> in for it, and the density p itself is computed only for a random share of the draws there. If
!> the weight by the polynomial is w, and by the density c w, a draw at which p is computed gets the
!> weight w (1 + (c - 1)/share), and the remaining draws there keep w. The mean of this random
!> weight is c w, so that the draws are still those of p (Fearnhead, Papaspiliopoulos and Roberts,
!> J. R. Statist. Soc. B 70, 2008, 755). The variance of these weights counts in the effective
!> sample size. If such a weight is not positive, the latest draws are repeated with shares four
!> times as large, until all weights are positive or p is computed at all draws.
module beamid_sampling
   use beamid_chains, only: diagnose_chains
   use beamid_densities, only: density_t, impossible
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_metropolis, only: run_chains
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_pareto, only: smooth_weights
   use beamid_proposals, only: new_proposal, proposal_t, refit_proposal
   use beamid_searches, only: monitor_t
   use beamid_strings, only: to_text
   use beamid_surrogates, only: new_surrogate, surrogate_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: plan_t, draws_t, sample

   !> Number of Markov chains; weighted draws are also divided into as many parts for the
   !> diagnostics.
   integer, parameter, public :: chains = 4

   !> Settings of the sampling.
   type :: plan_t
      integer :: draws = 10000         !< a multiple of `chains`
      integer :: seed = 1              !< any integer; the same seed gives the same draws
      logical :: importance = .true.   !< .false.: chains, without trying importance sampling
      logical :: coloured = .true.     !< whether the noise may be autoregressive
   end type plan_t

   !> Draws of equal weight, chain by chain, and their diagnostics.
   type :: draws_t
      real(wp), allocatable :: q(:, :)    !< (n, draws) parameters
      !> (draws) up to a constant; with weights, for most of the draws by the polynomial
      real(wp), allocatable :: log_density(:)
      logical :: weighted = .true.        !< by importance sampling; .false.: by chains
      real(wp) :: k = 0                   !< shape of the Pareto distribution of the largest weights
      real(wp) :: effective = 0           !< effective sample size
      integer :: evaluations = 0          !< of the density, by the draws
      real(wp), allocatable :: bulk(:), tail(:)   !< (n) effective sample sizes
      real(wp), allocatable :: reduction(:)   !< (n) potential scale reduction
   end type draws_t

   !> Degrees of freedom of the proposal, Student's t.
   real(wp), parameter :: t_freedom = 4
   !> Number of draws that share a stream of random numbers.
   integer, parameter :: block = 50
   !> Number of blocks that start from the same copy of the density, if a polynomial stands in for
   !> it at most draws.
   integer, parameter :: blocks_per_copy = 4
   !> Importance sampling has failed if the shape k of the weights is above `largest_k`, or the
   !> effective sample size below the share `min_efficiency` of the draws.
   real(wp), parameter :: largest_k = 0.7_wp, min_efficiency = 0.02_wp

contains

   !> Samples a density.
   !>
   !> variables  (n) with their bounds
   !> start      (n) parameters near the mode
   !> error      no mode near the start, or chains that do not agree
   !> monitor    receives reports of the progress
   subroutine sample(density, variables, start, plan, draws, error, monitor)
      class(density_t), intent(in) :: density
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: start(:)
      type(plan_t), intent(in) :: plan
      type(draws_t), intent(out) :: draws
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(proposal_t) :: proposal
      logical :: is_reliable
      integer :: counted

      call new_proposal(density, variables, start, proposal, error, monitor)
      if (allocated(error)) return
      is_reliable = .false.
      if (plan%importance) call draw_weighted(density, proposal, plan, draws, is_reliable, monitor)
      if (.not. (is_reliable .or. interrupted())) then
         draws%weighted = .false.
         counted = draws%evaluations
         call run_chains(density, proposal%coordinate, proposal%mode, proposal%axes, chains, &
            plan%draws/chains, plan%seed, draws%q, draws%log_density, draws%evaluations, error, &
            monitor)
         draws%evaluations = draws%evaluations + counted
      end if
      call check_interrupt(error)
      if (allocated(error)) return
      call compute_diagnostics(draws, error)
   end subroutine sample

   !> Computes the effective sample sizes and the potential scale reduction; fails if chains do not
   !> agree, or have fewer than 100 effective draws.
   subroutine compute_diagnostics(draws, error)
      type(draws_t), intent(inout) :: draws
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: max_reduction = 1.05_wp, min_effective = 100
      integer :: k, n

      n = size(draws%q, 1)
      allocate (draws%bulk(n), draws%tail(n), draws%reduction(n))
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, n
         if (interrupted()) cycle
         associate (q => draws%q(k, :))
            call diagnose_chains(reshape(q, [size(q)/chains, chains]), draws%bulk(k), &
               draws%tail(k), draws%reduction(k))
         end associate
      end do
      !$omp end parallel do
      if (interrupted()) return
      if (draws%weighted) return
      draws%effective = minval(draws%bulk)
      if (all(draws%reduction <= max_reduction) .and. draws%effective >= min_effective) return
      call failure(error, 'sampling: the chains do not agree (potential scale reduction '// &
         to_text(maxval(draws%reduction))//', '//to_text(nint(draws%effective))// &
         ' effective draws); the posterior may have several maxima, or none')
   end subroutine compute_diagnostics

   !> Draws from the proposal until the effective sample size suffices, or 50 times the wanted
   !> number is drawn. If the weights are not reliable, fits the proposal to the draws and starts
   !> again, for at most five rounds in all.
   !>
   !> is_reliable  whether the weights can be trusted
   subroutine draw_weighted(density, proposal, plan, draws, is_reliable, monitor)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(inout) :: proposal
      type(plan_t), intent(in) :: plan
      type(draws_t), intent(inout) :: draws
      logical, intent(out) :: is_reliable
      class(monitor_t), intent(inout), optional :: monitor
      !> Numbers of draws to which the polynomial is fitted, and by which the weights are judged for
      !> the first time.
      integer, parameter :: fitted = 800, judged = 2000
      integer, parameter :: rounds = 5, max_ratio = 50
      real(wp), allocatable :: y(:, :), value(:), log_weight(:), weight(:)
      real(wp) :: efficiency
      integer :: n, round, wanted
      type(surrogate_t) :: surrogate

      is_reliable = .false.
      n = size(proposal%mode)
      draws%evaluations = 0
      do round = 1, rounds
         allocate (y(n, 0), value(0), log_weight(0))
         wanted = fitted
         do
            call draw_more(density, proposal, surrogate, plan%seed + 104729*round, wanted, y, &
               value, log_weight, draws%evaluations, monitor)
            if (interrupted() .or. .not. any(log_weight > impossible)) return
            if (wanted == fitted) then
               call fit_surrogate(proposal, y, value, density%power, surrogate)
               wanted = judged
               cycle
            end if
            if (allocated(weight)) deallocate (weight)
            allocate (weight(wanted))
            call smooth_weights(log_weight, weight, draws%k)
            draws%effective = 1/sum(weight**2)
            efficiency = draws%effective/wanted
            is_reliable = draws%k <= largest_k .and. efficiency >= min_efficiency
            if (.not. is_reliable .or. draws%effective >= plan%draws .or. &
               wanted >= max_ratio*plan%draws) exit
            wanted = min(max_ratio*plan%draws, max(wanted + 1000, &
               block*ceiling(1.04_wp*plan%draws/efficiency/block)))
         end do
         if (is_reliable) exit
         call refit_proposal(proposal, points(proposal, y), weight)
         surrogate = surrogate_t()
         deallocate (y, value, log_weight)
      end do
      if (is_reliable) call resample(proposal, plan, points(proposal, y), value, weight, draws)
   end subroutine draw_weighted

   !> Fits a polynomial to the density at the draws that are within the bounds.
   !>
   !> power  as in `density_t`
   subroutine fit_surrogate(proposal, y, value, power, surrogate)
      type(proposal_t), intent(in) :: proposal
      real(wp), intent(in) :: y(:, :), value(:), power
      type(surrogate_t), intent(inout) :: surrogate
      real(wp) :: x(size(y, 1), size(y, 2))
      integer, allocatable :: inside(:)
      integer :: i

      x = points(proposal, y)
      inside = pack([(i, i=1, size(value))], [(all(proposal%coordinate%allows( &
         proposal%coordinate%value(x(:, i)))), i=1, size(value))])
      call new_surrogate(y(:, inside), value(inside), proposal%width, power, surrogate)
   end subroutine fit_surrogate

   !> Returns the coordinates x, (n, draws), of draws y (n, draws) in units of the proposal's axes.
   pure function points(proposal, y) result(x)
      type(proposal_t), intent(in) :: proposal
      real(wp), intent(in) :: y(:, :)
      real(wp) :: x(size(y, 1), size(y, 2))
      integer :: i

      do i = 1, size(y, 2)
         x(:, i) = proposal%mode + matmul(proposal%axes, y(:, i))
      end do
   end function points

   !> Extends the list of draws. Each draw depends on its number only, not on the threads.
   !>
   !> surrogate    on return compared with the density more often if its error was too large for a
   !>              positive weight
   !> wanted       length of the list on return
   !> y            (n, wanted) coordinates in units of the axes, from the mode
   !> value        (wanted) log density of the parameters
   !> log_weight   (wanted) log of the density of the coordinates over that of the proposal
   !> evaluations  number of evaluations of the density, of which those of this call are added
   recursive subroutine draw_more(density, proposal, surrogate, seed, wanted, y, value, &
      log_weight, evaluations, monitor)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(in) :: proposal
      type(surrogate_t), intent(inout) :: surrogate
      integer, intent(in) :: seed, wanted
      real(wp), allocatable, intent(inout) :: y(:, :), value(:), log_weight(:)
      integer, intent(inout) :: evaluations
      class(monitor_t), intent(inout), optional :: monitor
      integer :: counted, each, finished, first, part, present_draws, last
      logical :: is_negative

      present_draws = size(value)
      y = reshape(y, [size(y, 1), wanted], pad=[0.0_wp])
      value = [value, spread(impossible, 1, wanted - present_draws)]
      log_weight = [log_weight, spread(impossible, 1, wanted - present_draws)]
      finished = present_draws
      counted = 0
      is_negative = .false.
      each = block*merge(blocks_per_copy, 1, surrogate%reach > 0)
      !$omp parallel do schedule(dynamic, 1) private(first, last) copyin(stop_flag) &
      !$omp& reduction(+:counted) reduction(.or.:is_negative)
      do part = present_draws/each + 1, (wanted + each - 1)/each
         if (interrupted()) cycle
         first = max((part - 1)*each, present_draws) + 1
         last = min(part*each, wanted)
         call draw_part(density, proposal, surrogate, seed, first, y(:, first:last), &
            value(first:last), log_weight(first:last), counted, is_negative)
         !$omp critical (one_block_done)
         finished = finished + last - first + 1
         if (present(monitor)) call monitor%advanced(finished, wanted, 'draws')
         !$omp end critical (one_block_done)
      end do
      !$omp end parallel do
      evaluations = evaluations + counted
      if (.not. is_negative) return
      call surrogate%distrust()
      y = y(:, :present_draws)
      value = value(:present_draws)
      log_weight = log_weight(:present_draws)
      call draw_more(density, proposal, surrogate, seed, wanted, y, value, log_weight, &
         evaluations, monitor)
   end subroutine draw_more

   !> Computes the draws first, first + 1, ... of one or several blocks. It copies the density here:
   !> a result must not depend on what another evaluation in the same thread has left, and gfortran
   !> 12 calls through a wild pointer if a polymorphic variable is private to a thread without work.
   !>
   !> seed         of all draws
   !> first        number of the first draw
   !> y            (n, draws) coordinates in units of the axes, from the mode
   !> value        (draws) log density of the parameters
   !> log_weight   (draws) as in `draw_more`
   !> counted      number of evaluations, of which those of these draws are added
   !> is_negative  becomes .true. if a random weight is not positive
   subroutine draw_part(density, proposal, surrogate, seed, first, y, value, log_weight, counted, &
      is_negative)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(in) :: proposal
      type(surrogate_t), intent(in) :: surrogate
      integer, intent(in) :: seed, first
      real(wp), intent(out) :: y(:, :)
      real(wp), intent(inout) :: value(:), log_weight(:)
      integer, intent(inout) :: counted
      logical, intent(inout) :: is_negative
      class(density_t), allocatable :: mine
      real(wp), dimension(size(y, 1)) :: q, x, width
      real(wp) :: z(size(y, 1), block), u(3, block), scale, share, guess, factor
      integer :: i, n, of_block, place

      allocate (mine, source=density)
      n = size(y, 1)
      do i = 1, size(y, 2)
         place = modulo(first + i - 2, block) + 1
         if (i == 1 .or. place == 1) then
            of_block = seed + 7919*((first + i - 2)/block + 1)
            z = reshape(gaussian_noise(n*block, 1.0_wp, of_block), [n, block])
            u(:2, :) = reshape(uniform_noise(2*block, of_block + 3), [2, block])
            u(3, :) = uniform_noise(block, of_block + 5)
         end if
         ! Sum of two exponential variables: chi-square with four degrees of freedom.
         scale = sqrt(t_freedom/(-2*log(u(1, place)*u(2, place))))
         associate (e => z(:, place))
            e = scale*e
            width = merge(proposal%width(:, 1), proposal%width(:, 2), e < 0)
            y(:, i) = width*e
            x = proposal%mode + matmul(proposal%axes, y(:, i))
            share = surrogate%share(y(:, i))
            factor = 1
            if (share < 1) guess = surrogate%at(y(:, i))
            if (share < 1 .and. .not. guess > impossible) share = 1
            q = proposal%coordinate%value(x)
            if (.not. all(proposal%coordinate%allows(q))) then
               value(i) = impossible
               cycle
            else if (u(3, place) > share) then
               value(i) = guess
            else
               call mine%evaluate(q, value(i))
               counted = counted + 1
               if (share < 1) then
                  factor = 1 + (exp(min(value(i) - guess, 700.0_wp)) - 1)/share
                  is_negative = is_negative .or. .not. factor > 0
               else
                  guess = value(i)
               end if
               if (.not. (value(i) > impossible .and. factor > 0)) cycle
            end if
            log_weight(i) = guess + log(factor) + sum(proposal%coordinate%log_slope(x)) &
               + sum(log(width)) + (t_freedom + n)/2*log(1 + sum(e**2)/t_freedom)
         end associate
      end do
   end subroutine draw_part

   !> Resamples weighted draws to draws of equal weight, in random order (systematic resampling).
   !>
   !> x       (n, m) coordinates of the weighted draws
   !> value   (m) log density of the parameters
   !> weight  (m), with the sum 1
   subroutine resample(proposal, plan, x, value, weight, draws)
      type(proposal_t), intent(in) :: proposal
      type(plan_t), intent(in) :: plan
      real(wp), intent(in) :: x(:, :), value(:), weight(:)
      type(draws_t), intent(inout) :: draws
      real(wp) :: u(plan%draws + 1), level, total
      integer :: from(plan%draws), i, j, k, swapped

      u = uniform_noise(size(u), plan%seed + 15485863)
      total = 0
      k = 0
      do i = 1, plan%draws
         level = (i - 1 + u(1))/plan%draws
         do while (total < level .and. k < size(weight))
            k = k + 1
            total = total + weight(k)
         end do
         from(i) = max(k, 1)
      end do
      do i = plan%draws, 2, -1
         j = 1 + int(u(i)*i)
         swapped = from(i)
         from(i) = from(j)
         from(j) = swapped
      end do
      allocate (draws%q(size(x, 1), plan%draws))
      do i = 1, plan%draws
         draws%q(:, i) = proposal%coordinate%value(x(:, from(i)))
      end do
      draws%log_density = value(from)
   end subroutine resample

end module beamid_sampling
