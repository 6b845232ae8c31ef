!> Runs Markov chains by Metropolis' rule, with a proposal that adapts to the chain and a second,
!> shorter step if the first is rejected (delayed rejection and adaptive Metropolis, DRAM: Haario,
!> Laine, Mira and Saksman, Statistics and Computing 16, 2006, 339). `beamid_sampling` uses the
!> chains if importance sampling fails.
module beamid_metropolis
   use beamid_densities, only: coordinate_t, density_t, evaluate_at, impossible
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_lapack, only: dtrtrs
   use beamid_matrices, only: outer
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_proposals, only: factor_covariance
   use beamid_searches, only: monitor_t
   implicit none
   private

   public :: run_chains

   !> Steps for each draw that is kept, and steps before the first draw, which adapt the proposal.
   integer, parameter :: thin = 10, warm_up = 5000
   !> Steps between two adaptations; their random numbers are generated together.
   integer, parameter :: block = 250
   !> Length of the second step relative to that of the first.
   real(wp), parameter :: shorter = 0.2_wp

   !> A point at which the density was evaluated.
   type :: point_t
      real(wp), allocatable :: x(:)    !< (n) coordinates without bounds
      real(wp) :: log_density = 0      !< of the parameters, up to a constant
      real(wp) :: log_density_x = 0    !< of the coordinates, up to a constant
   end type point_t

   !> A Markov chain with its adaptive proposal, a normal distribution around the current point.
   type :: chain_t
      class(density_t), allocatable :: density           !< the chain's own copy
      type(coordinate_t), allocatable :: coordinate(:)   !< (n)
      type(point_t) :: here                              !< the current point
      !> (n, n) triangle; its product with n standard normal numbers is a first step
      real(wp), allocatable :: factor(:, :)
      logical :: is_upper = .false.                      !< whether the triangle is the upper one
      !> standard deviation of a first step, in standard deviations of the chain
      real(wp) :: step_scale = 1
      integer :: seen = 0                                !< number of points in `mean`
      real(wp), allocatable :: mean(:)                   !< (n) of the points of the warm-up
      real(wp), allocatable :: scatter(:, :)             !< (n, n) their covariance times seen - 1
      integer :: evaluations = 0                         !< of the density
   end type chain_t

contains

   !> Runs several chains in parallel, each from its own start, farther from the mode than most of
   !> the density.
   !>
   !> coordinate   (n) coordinates of the parameters, without bounds
   !> mode         (n) coordinates where the density is high
   !> axes         (n, n) triangle A, upper or lower; A A' is the covariance of a normal density
   !>              around the mode
   !> chains       number of chains
   !> length       draws of each chain that are kept
   !> seed         any integer; the same seed gives the same chains
   !> q            (n, chains*length) parameters, chain by chain
   !> log_density  (chains*length) of the parameters, up to a constant
   !> evaluations  of the density, by all chains
   !> error        a chain found no start at which the density can be computed
   !> monitor      receives reports of the progress
   subroutine run_chains(density, coordinate, mode, axes, chains, length, seed, q, log_density, &
      evaluations, error, monitor)
      class(density_t), intent(in) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(in) :: mode(:), axes(:, :)
      integer, intent(in) :: chains, length, seed
      real(wp), allocatable, intent(out) :: q(:, :), log_density(:)
      integer, intent(out) :: evaluations
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: c, counted(chains), finished

      finished = 0
      allocate (q(size(mode), chains*length), log_density(chains*length))
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do c = 1, chains
         call run_chain(density, coordinate, mode, axes, seed + 611953*c, &
            q(:, (c - 1)*length + 1:c*length), log_density((c - 1)*length + 1:c*length), &
            counted(c), finished, chains*(warm_up + thin*length), monitor)
      end do
      !$omp end parallel do
      evaluations = sum(abs(counted))
      if (any(counted < 0)) call failure(error, &
         'sampling: the density cannot be computed around the estimate')
   end subroutine run_chains

   !> Runs one chain. The chain copies the density here, because gfortran 12 calls through a wild
   !> pointer if a polymorphic variable is private to a thread without work.
   !>
   !> q            (n, length) parameters
   !> log_density  (length) of the parameters
   !> counted      evaluations of the density; negative: no start was found
   !> finished     steps of all chains so far
   !> whole        steps of all chains together
   subroutine run_chain(density, coordinate, mode, axes, seed, q, log_density, counted, &
      finished, whole, monitor)
      class(density_t), intent(in) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(in) :: mode(:), axes(:, :)
      integer, intent(in) :: seed, whole
      real(wp), intent(out) :: q(:, :), log_density(:)
      integer, intent(out) :: counted
      integer, intent(inout) :: finished
      class(monitor_t), intent(inout), optional :: monitor
      type(chain_t) :: chain
      real(wp) :: z(size(mode), 2*block), u(2*block)
      integer :: step, place, kept, total

      allocate (chain%density, source=density)
      chain%coordinate = coordinate
      call start_chain(chain, mode, axes, seed)
      counted = -chain%evaluations
      if (.not. chain%here%log_density_x > impossible) return
      kept = 0
      total = warm_up + thin*size(log_density)
      do step = 1, total
         place = modulo(step - 1, block)
         if (place == 0) then
            if (interrupted()) exit
            !$omp critical (one_block_done)
            finished = finished + min(block, total - step + 1)
            if (present(monitor)) call monitor%advanced(finished, whole, 'steps of chains')
            !$omp end critical (one_block_done)
            z = reshape(gaussian_noise(size(z), 1.0_wp, seed + 7919*(1 + step/block)), shape(z))
            u = uniform_noise(size(u), seed + 7919*(1 + step/block) + 5)
            if (step > 1 .and. step <= warm_up) call adapt(chain, step)
         end if
         call advance(chain, z(:, 2*place + 1:2*place + 2), u(2*place + 1:2*place + 2))
         if (step <= warm_up) then
            call add_to_scatter(chain)
         else if (modulo(step - warm_up, thin) == 0) then
            kept = kept + 1
            q(:, kept) = coordinate%value(chain%here%x)
            log_density(kept) = chain%here%log_density
         end if
      end do
      counted = chain%evaluations
   end subroutine run_chain

   !> Draws a start twice as widely scattered as the density; the last of 50 trials stays if the
   !> density can be computed at none of them.
   subroutine start_chain(chain, mode, axes, seed)
      type(chain_t), intent(inout) :: chain
      real(wp), intent(in) :: mode(:), axes(:, :)
      integer, intent(in) :: seed
      integer, parameter :: tries = 50
      type(point_t) :: start
      real(wp) :: z(size(mode), tries)
      integer :: i, n

      n = size(mode)
      z = reshape(gaussian_noise(n*tries, 1.0_wp, seed), [n, tries])
      do i = 1, tries
         start%x = mode + 2*matmul(axes, z(:, i))
         call compute_density(chain, start)
         if (start%log_density_x > impossible) exit
      end do
      chain%here = start
      chain%step_scale = 2.4_wp/sqrt(real(n, wp))
      chain%factor = chain%step_scale*axes
      chain%is_upper = all([(all(abs(axes(i + 1:, i)) <= 0), i=1, n)])
      chain%mean = start%x
      allocate (chain%scatter(n, n), source=0.0_wp)
   end subroutine start_chain

   !> Computes the density at a point.
   subroutine compute_density(chain, point)
      type(chain_t), intent(inout) :: chain
      type(point_t), intent(inout) :: point

      chain%evaluations = chain%evaluations + 1
      call evaluate_at(chain%density, chain%coordinate, point%x, point%log_density)
      point%log_density_x = impossible
      if (point%log_density > impossible) point%log_density_x = point%log_density &
         + sum(chain%coordinate%log_slope(point%x))
   end subroutine compute_density

   !> Takes one step of the chain.
   !>
   !> z  (n, 2) standard normal numbers for the first and the second proposed point
   !> u  (2) uniform numbers, which decide whether the points are accepted
   subroutine advance(chain, z, u)
      type(chain_t), intent(inout) :: chain
      real(wp), intent(in) :: z(:, :), u(:)
      type(point_t) :: first, second
      real(wp) :: accept, accept2

      first%x = chain%here%x + matmul(chain%factor, z(:, 1))
      call compute_density(chain, first)
      accept = min(1.0_wp, exp(min(0.0_wp, first%log_density_x - chain%here%log_density_x)))
      if (u(1) < accept) then
         chain%here = first
         return
      end if
      second%x = chain%here%x + shorter*matmul(chain%factor, z(:, 2))
      call compute_density(chain, second)
      ! Detailed balance: times the probability of rejecting the first point from the second, over
      ! that of rejecting it from the current point.
      accept2 = 0
      if (second%log_density_x > impossible .and. accept < 1) accept2 = exp(second%log_density_x &
         - chain%here%log_density_x + log_step(chain, first%x - second%x) &
         - log_step(chain, first%x - chain%here%x))*(1 - min(1.0_wp, exp(min(0.0_wp, &
         first%log_density_x - second%log_density_x))))/(1 - accept)
      if (u(2) < accept2) chain%here = second
   end subroutine advance

   !> Returns the log density of a first step d, (n), up to a constant.
   real(wp) function log_step(chain, d)
      type(chain_t), intent(in) :: chain
      real(wp), intent(in) :: d(:)
      real(wp) :: w(size(d))
      integer :: info

      w = d
      call dtrtrs(merge('U', 'L', chain%is_upper), 'N', 'N', size(d), 1, chain%factor, size(d), w, &
         size(d), info)
      log_step = -sum(w**2)/2
   end function log_step

   !> Adds the current point to the mean and the scatter of the chain.
   pure subroutine add_to_scatter(chain)
      type(chain_t), intent(inout) :: chain

      chain%seen = chain%seen + 1
      associate (apart => chain%here%x - chain%mean, seen => chain%seen)
         chain%scatter = chain%scatter + (seen - 1.0_wp)/seen*outer(apart, apart)
         chain%mean = chain%mean + apart/seen
      end associate
   end subroutine add_to_scatter

   !> Gives the proposal the covariance of the chain so far. After a quarter and after half of the
   !> warm-up, the points before get half their weight.
   subroutine adapt(chain, step)
      type(chain_t), intent(inout) :: chain
      integer, intent(in) :: step
      real(wp) :: trial(size(chain%mean), size(chain%mean))
      logical :: positive

      trial = chain%scatter/(chain%seen - 1)
      call factor_covariance(trial, positive)
      if (.not. positive) return
      chain%factor = chain%step_scale*trial
      chain%is_upper = .false.
      if (step == warm_up/4 + 1 .or. step == warm_up/2 + 1) then
         chain%seen = chain%seen/2
         chain%scatter = chain%scatter/2
      end if
   end subroutine adapt

end module beamid_metropolis
