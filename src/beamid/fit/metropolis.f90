!> Markov chains by Metropolis' rule with a proposal that adapts, and a second, shorter step where
!> the first is refused (Haario, Laine, Mira and Saksman, Statistics and Computing 16, 2006, 339).
module beamid_metropolis
   use beamid_densities, only: coordinate_t, density_t, impossible
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_lapack, only: dpotrf
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_searches, only: monitor_t
   implicit none
   private

   public :: run_chains, factor_covariance

   !> Steps for one that is kept, and for one that only adapts.
   integer, parameter :: thin = 10, warm_up = 5000
   !> Steps between two adaptations, of which the random numbers are drawn at once.
   integer, parameter :: block = 250
   real(wp), parameter :: shorter = 0.2_wp

contains

   !> mode, axes   (n), (n, n) where the density is high, and how it falls off: a triangle, upper or
   !>              lower
   !> chains       each from a start of its own, farther out than most of the density
   !> length       draws kept of each
   !> q            (n, chains*length) parameters, chain by chain
   !> log_density  (chains*length) of the parameters
   !> error        no start where the density can be computed
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

   !> A chain with a copy of the density of its own, here: gfortran 12 calls through a wild pointer
   !> where a polymorphic variable is private to a thread without work.
   !>
   !> counted  evaluations; below 0: no start was found
   subroutine run_chain(density, coordinate, mode, axes, seed, q, log_density, counted, &
      finished, whole, monitor)
      class(density_t), intent(in) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(in) :: mode(:), axes(:, :)
      integer, intent(in) :: seed
      real(wp), intent(out) :: q(:, :), log_density(:)
      integer, intent(out) :: counted
      integer, intent(inout) :: finished   !< steps of all chains
      integer, intent(in) :: whole
      class(monitor_t), intent(inout), optional :: monitor
      integer, parameter :: tries = 50
      class(density_t), allocatable :: mine
      real(wp), dimension(size(mode)) :: x, first, second, mean
      real(wp), dimension(size(mode), size(mode)) :: factor, covariance
      real(wp) :: z(size(mode), 2*block), u(2*block), here, value, value2, accept, accept2
      real(wp) :: plain, plain1, plain2, scale
      integer :: step, place, n, kept, seen, total, i
      logical :: is_upper

      allocate (mine, source=density)
      n = size(mode)
      scale = 2.4_wp/sqrt(real(n, wp))
      counted = 0
      z(:, :tries) = reshape(gaussian_noise(n*tries, 1.0_wp, seed), [n, tries])
      do i = 1, tries
         x = mode + 2*matmul(axes, z(:, i))
         call evaluate(x, here, plain)
         if (here > impossible) exit
      end do
      if (i > tries) then
         counted = -counted
         return
      end if
      factor = scale*axes
      is_upper = all([(all(abs(axes(i + 1:, i)) <= 0), i=1, n)])
      mean = x
      covariance = 0
      seen = 0
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
            if (step > 1 .and. step <= warm_up) call adapt()
         end if
         first = x + matmul(factor, z(:, 2*place + 1))
         call evaluate(first, value, plain1)
         accept = min(1.0_wp, exp(min(0.0_wp, value - here)))
         if (u(2*place + 1) < accept) then
            x = first
            here = value
            plain = plain1
         else
            second = x + shorter*matmul(factor, z(:, 2*place + 2))
            call evaluate(second, value2, plain2)
            ! With the probability that the second would have refused the first as well.
            accept2 = 0
            if (value2 > impossible .and. accept < 1) accept2 = exp(value2 - here &
               + log_step(first - second) - log_step(first - x))*(1 - min(1.0_wp, &
               exp(min(0.0_wp, value - value2))))/(1 - accept)
            if (u(2*place + 2) < accept2) then
               x = second
               here = value2
               plain = plain2
            end if
         end if
         if (step <= warm_up) then
            seen = seen + 1
            covariance = covariance + (seen - 1.0_wp)/seen*spread(x - mean, 2, n) &
               *spread(x - mean, 1, n)
            mean = mean + (x - mean)/seen
         else if (modulo(step - warm_up, thin) == 0) then
            kept = kept + 1
            q(:, kept) = coordinate%value(x)
            log_density(kept) = plain
         end if
      end do

   contains

      !> value  log density of the coordinates
      !> plain  of the parameters
      subroutine evaluate(at, value, plain)
         real(wp), intent(in) :: at(:)
         real(wp), intent(out) :: value, plain

         counted = counted + 1
         call mine%evaluate(coordinate%value(at), plain)
         value = impossible
         if (plain > impossible) value = plain + sum(coordinate%log_slope(at))
      end subroutine evaluate

      !> Log density of a first step, up to a constant.
      real(wp) function log_step(d)
         real(wp), intent(in) :: d(:)
         real(wp) :: w(size(d))
         integer :: i

         w = d
         if (is_upper) then
            do i = n, 1, -1
               w(i) = (w(i) - dot_product(factor(i, i + 1:), w(i + 1:)))/factor(i, i)
            end do
         else
            do i = 1, n
               w(i) = (w(i) - dot_product(factor(i, :i - 1), w(:i - 1)))/factor(i, i)
            end do
         end if
         log_step = -sum(w**2)/2
      end function log_step

      !> A proposal shaped as the chain so far; what it began with is forgotten by halves.
      subroutine adapt()
         real(wp) :: trial(n, n)
         logical :: positive

         trial = covariance/(seen - 1)
         call factor_covariance(trial, positive)
         if (.not. positive) return
         factor = scale*trial
         is_upper = .false.
         if (step == warm_up/4 + 1 .or. step == warm_up/2 + 1) then
            seen = seen/2
            covariance = covariance/2
         end if
      end subroutine adapt

   end subroutine run_chain

   !> The lower triangle L of a covariance L L', with a diagonal larger by what round-off may take.
   !>
   !> positive  .false.: it is no covariance, and nothing can be said of the matrix on return
   subroutine factor_covariance(matrix, positive)
      real(wp), intent(inout) :: matrix(:, :)
      logical, intent(out) :: positive
      integer :: info, k, n

      n = size(matrix, 1)
      do k = 1, n
         matrix(k, k) = matrix(k, k)*(1 + 1e-8_wp) + tiny(1.0_wp)
      end do
      call dpotrf('L', n, matrix, n, info)
      positive = info == 0
      do k = 2, n
         matrix(:k - 1, k) = 0
      end do
   end subroutine factor_covariance

end module beamid_metropolis
