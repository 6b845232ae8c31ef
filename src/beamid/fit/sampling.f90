!> Draws from a probability density of several parameters: by importance sampling from a
!> distribution fitted to its mode, and where the weights say that this fails by Markov chains.
!>
!> The proposal is Student's t with four degrees of freedom in coordinates without bounds, with its
!> own width on each side of every axis (Geweke, Econometrica 57, 1989, 1317).
module beamid_sampling
   use beamid_chains, only: bulk_size, scale_reduction, tail_size
   use beamid_densities, only: coordinate_t, density_t, impossible, new_coordinate
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_lapack, only: dpotrf, dtrtrs
   use beamid_metropolis, only: factor_covariance, run_chains
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_pareto, only: smooth_weights
   use beamid_searches, only: monitor_t
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: plan_t, draws_t, sample

   integer, parameter, public :: chains = 4

   type :: plan_t
      integer :: draws = 10000             !< a multiple of the chains
      integer :: seed = 1
      logical :: importance = .true.       !< .false.: chains, without trying
      logical :: coloured = .true.         !< noise may be autoregressive
   end type plan_t

   !> Equally probable draws, chain by chain.
   type :: draws_t
      real(wp), allocatable :: q(:, :)               !< (n, draws)
      real(wp), allocatable :: log_density(:)        !< (draws) up to a constant
      logical :: weighted = .true.                   !< by importance sampling, not by chains
      real(wp) :: k = 0                              !< of Pareto's distribution of the weights
      real(wp) :: effective = 0                      !< independent draws that are worth as much
      integer :: evaluations = 0
      real(wp), allocatable :: bulk(:), tail(:)      !< (n) effective numbers
      real(wp), allocatable :: reduction(:)          !< (n) potential scale reduction
   end type draws_t

   !> Where the density is highest in coordinates without bounds, and how it falls off from there.
   type :: proposal_t
      type(coordinate_t), allocatable :: coordinate(:)
      real(wp), allocatable :: mode(:)       !< (n)
      real(wp), allocatable :: axes(:, :)    !< (n, n) columns of unit drop by the curvature
      real(wp), allocatable :: width(:, :)   !< (n, 2) below and above, in axes
   end type proposal_t

   real(wp), parameter :: freedom = 4
   !> Draws that start from the same copy of the density, whatever the threads.
   integer, parameter :: block = 50
   !> Above, weights are not to be trusted; and draws of which fewer are worth anything.
   real(wp), parameter :: largest_k = 0.7_wp, least_worth = 0.02_wp

contains

   !> variables  (n) with their bounds
   !> start      (n) near the mode
   !> error      no mode, or chains that do not agree
   subroutine sample(density, variables, start, plan, draws, error, monitor)
      class(density_t), intent(in) :: density
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: start(:)
      type(plan_t), intent(in) :: plan
      type(draws_t), intent(out) :: draws
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(proposal_t) :: proposal
      logical :: good
      integer :: counted

      call new_proposal(density, variables, start, proposal, error)
      if (allocated(error)) return
      good = .false.
      if (plan%importance) call draw_weighted(density, proposal, plan, draws, good, monitor)
      if (.not. (good .or. interrupted())) then
         draws%weighted = .false.
         counted = draws%evaluations
         call run_chains(density, proposal%coordinate, proposal%mode, proposal%axes, chains, &
            plan%draws/chains, plan%seed, draws%q, draws%log_density, draws%evaluations, error, &
            monitor)
         draws%evaluations = draws%evaluations + counted
      end if
      call check_interrupt(error)
      if (allocated(error)) return
      call judge(draws, error)
   end subroutine sample

   !> Effective numbers of draws, and whether chains agree.
   subroutine judge(draws, error)
      type(draws_t), intent(inout) :: draws
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: agree = 1.05_wp, enough = 100
      real(wp), allocatable :: values(:, :)
      integer :: k, n

      n = size(draws%q, 1)
      allocate (draws%bulk(n), draws%tail(n), draws%reduction(n))
      do k = 1, n
         if (interrupted()) return
         values = reshape(draws%q(k, :), [size(draws%q, 2)/chains, chains])
         draws%bulk(k) = bulk_size(values)
         draws%tail(k) = tail_size(values)
         draws%reduction(k) = scale_reduction(values)
      end do
      if (draws%weighted) return
      draws%effective = minval(draws%bulk)
      if (all(draws%reduction <= agree) .and. draws%effective >= enough) return
      call failure(error, 'sampling: the chains do not agree (potential scale reduction '// &
         to_text(maxval(draws%reduction))//', '//to_text(nint(draws%effective))// &
         ' effective draws); the density may have several maxima, or none')
   end subroutine judge

   !> Climbs to the mode by damped Newton steps, and measures the density along its axes.
   subroutine new_proposal(density, variables, start, proposal, error)
      class(density_t), intent(in) :: density
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: start(:)
      type(proposal_t), intent(out) :: proposal
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 200
      !> No axis is longer than this: e**10 times as much.
      real(wp), parameter :: longest = 10
      class(density_t), allocatable :: mine
      real(wp), dimension(size(start), size(start)) :: H, R
      real(wp), dimension(size(start)) :: x, there, g, step
      real(wp) :: here, value, damping
      logical :: moved
      integer :: i, info, k, n

      allocate (mine, source=density)
      n = size(start)
      proposal%coordinate = new_coordinate(variables)
      x = proposal%coordinate%of(start)
      call in_coordinates(mine, proposal%coordinate, x, here, g, H)
      if (.not. here > impossible) then
         call failure(error, 'sampling: the density cannot be computed at the estimate')
         return
      end if
      damping = 1e-6_wp
      do i = 1, most
         R = H
         do k = 1, n
            R(k, k) = R(k, k) + damping*(1 + H(k, k)) + 1/longest**2
         end do
         call dpotrf('U', n, R, n, info)
         if (info /= 0) exit
         step = g
         call dtrtrs('U', 'T', 'N', n, 1, R, n, step, n, info)
         call dtrtrs('U', 'N', 'N', n, 1, R, n, step, n, info)
         there = x + step*min(1.0_wp, 2/max(maxval(abs(step)), tiny(here)))
         call in_coordinates(mine, proposal%coordinate, there, value)
         moved = value > here
         if (moved) then
            x = there
            call in_coordinates(mine, proposal%coordinate, x, here, g, H)
            damping = max(damping/10, 1e-12_wp)
            if (dot_product(step, g) < 1e-4_wp .and. maxval(abs(step)) < 1e-3_wp) exit
         else
            if (dot_product(step, g) < 1e-8_wp .or. damping > 1e12_wp) exit
            damping = 10*max(damping, 1e-3_wp)
         end if
      end do
      proposal%mode = x
      R = H
      do k = 1, n
         R(k, k) = R(k, k) + 1/longest**2
      end do
      call dpotrf('U', n, R, n, info)
      if (info /= 0) then
         call failure(error, 'sampling: the density has no mode near the estimate')
         return
      end if
      allocate (proposal%axes(n, n), source=0.0_wp)
      do k = 1, n
         proposal%axes(k, k) = 1
      end do
      call dtrtrs('U', 'N', 'N', n, n, R, n, proposal%axes, n, info)
      call measure_widths(mine, proposal, here)
   end subroutine new_proposal

   !> On each side the width of the normal distribution that is nowhere below the density, at steps
   !> of one to four of its own by the curvature.
   subroutine measure_widths(density, proposal, top)
      class(density_t), intent(inout) :: density
      type(proposal_t), intent(inout) :: proposal
      real(wp), intent(in) :: top
      real(wp), parameter :: steps(4) = [0.5_wp, 1.0_wp, 2.0_wp, 3.5_wp]
      real(wp), parameter :: narrowest = 0.3_wp, widest = 5
      real(wp) :: value, sign
      integer :: i, k, side

      allocate (proposal%width(size(proposal%mode), 2))
      do k = 1, size(proposal%mode)
         do side = 1, 2
            sign = 2*side - 3
            proposal%width(k, side) = narrowest
            do i = 1, size(steps)
               call in_coordinates(density, proposal%coordinate, &
                  proposal%mode + sign*steps(i)*proposal%axes(:, k), value)
               if (.not. value > impossible) cycle
               proposal%width(k, side) = max(proposal%width(k, side), &
                  steps(i)/sqrt(2*max(top - value, 1e-3_wp)))
            end do
         end do
      end do
      proposal%width = min(proposal%width, widest)
   end subroutine measure_widths

   !> The density of the coordinates, and its derivatives.
   subroutine in_coordinates(density, coordinate, x, value, gradient, curvature)
      class(density_t), intent(inout) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      real(wp) :: q(size(x)), slope(size(x)), from_bend
      integer :: k

      q = coordinate%value(x)
      call density%evaluate(q, value, gradient, curvature)
      if (.not. value > impossible) return
      value = value + sum(coordinate%log_slope(x))
      if (.not. present(gradient)) return
      slope = coordinate%slope(x)
      do k = 1, size(x)
         curvature(:, k) = slope*curvature(:, k)*slope(k)
      end do
      gradient = slope*gradient
      do k = 1, size(x)
         ! At the mode this is the bend squared and more; elsewhere it may not spoil the sign.
         from_bend = coordinate(k)%bend(x(k))
         curvature(k, k) = curvature(k, k) + max(0.0_wp, -gradient(k)*from_bend)
         gradient(k) = gradient(k) + from_bend
      end do
   end subroutine in_coordinates

   !> Draws from the proposal until enough of them are worth it; where that fails the proposal is
   !> fitted again to what was drawn.
   !>
   !> good  whether the weights can be trusted
   subroutine draw_weighted(density, proposal, plan, draws, good, monitor)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(inout) :: proposal
      type(plan_t), intent(in) :: plan
      type(draws_t), intent(inout) :: draws
      logical, intent(out) :: good
      class(monitor_t), intent(inout), optional :: monitor
      integer, parameter :: pilot = 2000, rounds = 5, most = 50
      real(wp), allocatable :: x(:, :), value(:), log_weight(:), weight(:)
      real(wp) :: worth
      integer :: n, round, wanted

      good = .false.
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
            worth = draws%effective/wanted
            good = draws%k <= largest_k .and. worth >= least_worth
            if (.not. good .or. draws%effective >= plan%draws .or. wanted >= most*plan%draws) exit
            wanted = min(most*plan%draws, max(wanted + 1000, &
               block*ceiling(1.1_wp*plan%draws/worth/block)))
         end do
         draws%evaluations = draws%evaluations + wanted
         if (good) exit
         call fit_again(proposal, x, weight)
         deallocate (x, value, log_weight)
      end do
      if (good) call resample(proposal, plan, x, value, weight, draws)
   end subroutine draw_weighted

   !> Lengthens the list of draws to a number; which draw it is decides what it is.
   !>
   !> x           (n, wanted) coordinates
   !> value       (wanted) log density of the parameters
   !> log_weight  (wanted) of the density of the coordinates over the proposal
   subroutine draw_more(density, proposal, seed, wanted, x, value, log_weight, monitor)
      class(density_t), intent(in) :: density
      type(proposal_t), intent(in) :: proposal
      integer, intent(in) :: seed, wanted
      real(wp), allocatable, intent(inout) :: x(:, :), value(:), log_weight(:)
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), allocatable :: longer(:, :)
      integer :: b, finished, first, had, last, n

      n = size(x, 1)
      had = size(value)
      allocate (longer(n, wanted))
      longer(:, :had) = x
      call move_alloc(longer, x)
      value = [value, spread(impossible, 1, wanted - had)]
      log_weight = [log_weight, spread(impossible, 1, wanted - had)]
      finished = had
      !$omp parallel do schedule(dynamic, 1) private(first, last) copyin(stop_flag)
      do b = had/block + 1, (wanted + block - 1)/block
         if (interrupted()) cycle
         first = max((b - 1)*block, had) + 1
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

   !> The draws of one block, from number `first` of it on. The copy of the density is its own: what
   !> one evaluation leaves for the next must not depend on which thread did which; and gfortran 12
   !> calls through a wild pointer where a polymorphic variable is private to a thread without work.
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
         ! Of chi square with four degrees of freedom.
         scale = sqrt(freedom/(-2*log(u(1, place)*u(2, place))))
         associate (e => z(:, place))
            e = scale*e
            width = merge(proposal%width(:, 1), proposal%width(:, 2), e < 0)
            x(:, i) = proposal%mode + matmul(proposal%axes, width*e)
            call mine%evaluate(proposal%coordinate%value(x(:, i)), value(i))
            if (.not. value(i) > impossible) cycle
            log_weight(i) = value(i) + sum(proposal%coordinate%log_slope(x(:, i))) &
               + sum(log(width)) + (freedom + n)/2*log(1 + sum(e**2)/freedom)
         end associate
      end do
   end subroutine draw_block

   !> A proposal with the mean and the covariance of weighted draws, somewhat wider.
   subroutine fit_again(proposal, x, weight)
      type(proposal_t), intent(inout) :: proposal
      real(wp), intent(in) :: x(:, :), weight(:)
      real(wp), parameter :: wider = 1.2_wp
      real(wp), dimension(size(x, 1), size(x, 1)) :: covariance
      real(wp) :: mean(size(x, 1)), apart(size(x, 1))
      logical :: positive
      integer :: i, k

      mean = matmul(x, weight)
      covariance = 0
      do i = 1, size(weight)
         apart = x(:, i) - mean
         do k = 1, size(apart)
            covariance(:, k) = covariance(:, k) + weight(i)*apart*apart(k)
         end do
      end do
      call factor_covariance(covariance, positive)
      if (.not. positive) return
      proposal%mode = mean
      proposal%axes = covariance
      proposal%width = wider
   end subroutine fit_again

   !> Equally probable draws in random order: as many of each as its weight asks for.
   subroutine resample(proposal, plan, x, value, weight, draws)
      type(proposal_t), intent(in) :: proposal
      type(plan_t), intent(in) :: plan
      real(wp), intent(in) :: x(:, :), value(:), weight(:)
      type(draws_t), intent(inout) :: draws
      real(wp) :: u(plan%draws + 1), level, total
      integer :: from(plan%draws), i, j, k, kept

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
         kept = from(i)
         from(i) = from(j)
         from(j) = kept
      end do
      allocate (draws%q(size(x, 1), plan%draws))
      do i = 1, plan%draws
         draws%q(:, i) = proposal%coordinate%value(x(:, from(i)))
      end do
      draws%log_density = value(from)
   end subroutine resample

end module beamid_sampling
