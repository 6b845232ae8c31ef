!> Draws from a probability density of several parameters: by importance sampling from a proposal
!> distribution that is fitted to the density (`beamid_proposals`), or by Markov chains if the
!> weights show that importance sampling fails. The posterior distribution of a fit is sampled here.
module beamid_sampling
   use beamid_chains, only: bulk_size, scale_reduction, tail_size
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
      real(wp), allocatable :: log_density(:)   !< (draws) up to a constant
      logical :: weighted = .true.        !< by importance sampling; .false.: by chains
      real(wp) :: k = 0                   !< shape of the Pareto distribution of the largest weights
      real(wp) :: effective = 0           !< effective sample size
      integer :: evaluations = 0          !< of the density
      real(wp), allocatable :: bulk(:), tail(:)   !< (n) effective sample sizes
      real(wp), allocatable :: reduction(:)   !< (n) potential scale reduction
   end type draws_t

   !> Degrees of freedom of the proposal, Student's t.
   real(wp), parameter :: t_freedom = 4
   !> Number of draws that start from the same copy of the density, whatever the number of threads.
   integer, parameter :: block = 50
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
   !> agree.
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
         call diagnose(k)
      end do
      !$omp end parallel do
      if (interrupted()) return
      if (draws%weighted) return
      draws%effective = minval(draws%bulk)
      if (all(draws%reduction <= max_reduction) .and. draws%effective >= min_effective) return
      call failure(error, 'sampling: the chains do not agree (potential scale reduction '// &
         to_text(maxval(draws%reduction))//', '//to_text(nint(draws%effective))// &
         ' effective draws); the posterior may have several maxima, or none')

   contains

      !> Computes the diagnostics of parameter k.
      subroutine diagnose(k)
         integer, intent(in) :: k
         real(wp) :: values(size(draws%q, 2)/chains, chains)

         values = reshape(draws%q(k, :), shape(values))
         draws%bulk(k) = bulk_size(values)
         draws%tail(k) = tail_size(values)
         draws%reduction(k) = scale_reduction(values)
      end subroutine diagnose

   end subroutine compute_diagnostics

   !> Draws from the proposal until the effective sample size suffices. If the weights are not
   !> reliable, fits the proposal to the draws and starts again, up to five times.
   !>
   !> is_reliable  whether the weights can be trusted
   subroutine draw_weighted(density, proposal, plan, draws, is_reliable, monitor)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(inout) :: proposal
      type(plan_t), intent(in) :: plan
      type(draws_t), intent(inout) :: draws
      logical, intent(out) :: is_reliable
      class(monitor_t), intent(inout), optional :: monitor
      integer, parameter :: pilot = 2000, rounds = 5, max_ratio = 50
      real(wp), allocatable :: x(:, :), value(:), log_weight(:), weight(:)
      real(wp) :: efficiency
      integer :: n, round, wanted

      is_reliable = .false.
      n = size(proposal%mode)
      draws%evaluations = 0
      do round = 1, rounds
         allocate (x(n, 0), value(0), log_weight(0))
         wanted = pilot
         do
            call draw_more(density, proposal, plan%seed + 104729*round, wanted, x, value, &
               log_weight, monitor)
            if (interrupted()) return
            if (.not. any(log_weight > impossible)) then
               draws%evaluations = draws%evaluations + wanted
               return
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
               block*ceiling(1.1_wp*plan%draws/efficiency/block)))
         end do
         draws%evaluations = draws%evaluations + wanted
         if (is_reliable) exit
         call refit_proposal(proposal, x, weight)
         deallocate (x, value, log_weight)
      end do
      if (is_reliable) call resample(proposal, plan, x, value, weight, draws)
   end subroutine draw_weighted

   !> Extends the list of draws. Each draw depends on its number only, not on the threads.
   !>
   !> wanted      length of the list on return
   !> x           (n, wanted) coordinates
   !> value       (wanted) log density of the parameters
   !> log_weight  (wanted) log of the density of the coordinates over that of the proposal
   subroutine draw_more(density, proposal, seed, wanted, x, value, log_weight, monitor)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(in) :: proposal
      integer, intent(in) :: seed, wanted
      real(wp), allocatable, intent(inout) :: x(:, :), value(:), log_weight(:)
      class(monitor_t), intent(inout), optional :: monitor
      integer :: b, finished, first, present_draws, last

      present_draws = size(value)
      x = reshape(x, [size(x, 1), wanted], pad=[0.0_wp])
      value = [value, spread(impossible, 1, wanted - present_draws)]
      log_weight = [log_weight, spread(impossible, 1, wanted - present_draws)]
      finished = present_draws
      !$omp parallel do schedule(dynamic, 1) private(first, last) copyin(stop_flag)
      do b = present_draws/block + 1, (wanted + block - 1)/block
         if (interrupted()) cycle
         first = max((b - 1)*block, present_draws) + 1
         last = min(b*block, wanted)
         call draw_block(density, proposal, seed + 7919*b, first - (b - 1)*block, &
            x(:, first:last), value(first:last), log_weight(first:last))
         !$omp critical (one_block_done)
         finished = finished + last - first + 1
         if (present(monitor)) call monitor%advanced(finished, wanted, 'draws')
         !$omp end critical (one_block_done)
      end do
      !$omp end parallel do
   end subroutine draw_more

   !> Draws the numbers `first` and following of one block. It copies the density here: a result
   !> must not depend on what another evaluation in the same thread has left, and gfortran 12 calls
   !> through a wild pointer if a polymorphic variable is private to a thread without work.
   !>
   !> seed        of the block
   !> first       number in the block of the first draw
   !> x           (n, draws) coordinates
   !> value       (draws) log density of the parameters
   !> log_weight  (draws) as in `draw_more`
   subroutine draw_block(density, proposal, seed, first, x, value, log_weight)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(in) :: proposal
      integer, intent(in) :: seed, first
      real(wp), intent(out) :: x(:, :)
      real(wp), intent(inout) :: value(:), log_weight(:)
      class(density_t), allocatable :: mine
      real(wp) :: z(size(x, 1), block), u(2, block), width(size(x, 1)), scale
      integer :: i, n, place

      allocate (mine, source=density)
      n = size(x, 1)
      z = reshape(gaussian_noise(n*block, 1.0_wp, seed), [n, block])
      u = reshape(uniform_noise(2*block, seed + 3), [2, block])
      do i = 1, size(x, 2)
         place = first + i - 1
         ! Sum of two exponential variables: chi-square with four degrees of freedom.
         scale = sqrt(t_freedom/(-2*log(u(1, place)*u(2, place))))
         associate (e => z(:, place))
            e = scale*e
            width = merge(proposal%width(:, 1), proposal%width(:, 2), e < 0)
            x(:, i) = proposal%mode + matmul(proposal%axes, width*e)
            call mine%evaluate(proposal%coordinate%value(x(:, i)), value(i))
            if (.not. value(i) > impossible) cycle
            log_weight(i) = value(i) + sum(proposal%coordinate%log_slope(x(:, i))) &
               + sum(log(width)) + (t_freedom + n)/2*log(1 + sum(e**2)/t_freedom)
         end associate
      end do
   end subroutine draw_block

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
