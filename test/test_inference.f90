!> Profiles, posterior and bootstrap of Table 4.1's structure: where linear theory is right they
!> agree with it, where it is not with an independent sampler, and they cover the truth.
program test_inference
   use beamid_bootstraps, only: blocks, bootstrap_fit, bootstrap_plan_t, bootstrap_t, parametric
   use beamid_chains, only: quantile
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_inference, only: posterior_draws_t, profile_fit, sample_fit
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_profile_likelihood, only: at_bound, is_closed, is_open, side_t
   use beamid_sampling, only: plan_t
   use beamid_sorting, only: sort
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, in_long_run
   use models, only: model_of, stage_of
   use omp_lib, only: omp_set_num_threads, omp_get_max_threads
   use single_responses, only: truth => table_4_1
   implicit none

   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
   real(wp), parameter :: exact(4) = [truth%c_D, truth%hose(1)%m_H, truth%hose(1)%c_H, &
      truth%hose(1)%k_H]
   integer, parameter :: samples = 49
   integer :: k
   real(wp), parameter :: times(samples) = [(0.1_wp*k, k=2, samples + 1)]
   type(model_t) :: model
   type(stage_t) :: stage
   type(simulation_t) :: clean
   type(error_t), allocatable :: error

   model = model_of(truth, new_pulse(1.0_wp, 0.05_wp), observation_t(1, 0.1_wp))
   stage = stage_of(names, exact*[0.8_wp, 1.1_wp, 0.9_wp, 1.1_wp])
   call simulate(model, mesh, times, clean, error)
   call check('record made', .not. allocated(error))
   if (.not. allocated(error)) then
      call test_linear()
      call test_other_sampler()
      call test_threads()
      call test_colour()
      call test_no_limit()
      call test_bound()
      call test_tail()
      call test_coverage()
   end if
   call finish('inference')

contains

   !> A fit of the clean record with noise of a standard deviation.
   subroutine fit_noisy(noise, found, experiments)
      real(wp), intent(in) :: noise(:)
      type(stage_fit_t), intent(out) :: found
      type(experiment_t), intent(out) :: experiments(1)
      type(stage_fit_t), allocatable :: fits(:)

      experiments(1) = experiment_t(times, clean%acceleration + noise, model%excitation)
      call identify(model, mesh, [stage], experiments, fits, error, check=.false.)
      if (.not. allocated(error)) found = fits(1)
   end subroutine fit_noisy

   !> Noise of 1e-5: nothing but linear theory is left. The profile to a thousandth of a half width
   !> (the intervals are 1e-3 of the values), the posterior's standard deviation to 3 % (10,000
   !> draws know it to .7 %), that of 2,000 resampled records to 6 % (1.6 %, and blocks of so few
   !> samples are smaller by some per cent).
   subroutine test_linear()
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      type(bootstrap_t) :: resampled
      integer :: p

      call fit_noisy(gaussian_noise(samples, 1e-5_wp, 5), found, experiments)
      call check('small noise: fit', .not. allocated(error))
      if (allocated(error)) return
      call profile_fit(model, mesh, experiments, found, sides, error)
      call check('small noise: profile', .not. allocated(error))
      if (allocated(error)) return
      call sample_fit(model, mesh, experiments, found, sides, plan_t(), posterior, error)
      call check('small noise: posterior', .not. allocated(error))
      if (allocated(error)) return
      call bootstrap_fit(model, mesh, experiments, found, bootstrap_plan_t(n=2000, &
         kind=parametric), resampled, error)
      call check('small noise: bootstrap', .not. allocated(error))
      if (allocated(error)) return
      associate (s => found%statistics, q => found%fit%estimate, x => posterior%draws)
         call check('small noise: weights', x%weighted .and. x%k < 0.5_wp)
         do p = 1, 4
            call check(names(p)//': both ends', all(sides(:, p)%state == is_closed))
            call check_close(names(p)//': profile below', (q(p) - sides(1, p)%end) &
               /s%corrected_half_width(p), 1.0_wp, 2e-3_wp)
            call check_close(names(p)//': profile above', (sides(2, p)%end - q(p)) &
               /s%corrected_half_width(p), 1.0_wp, 2e-3_wp)
            ! Student's t has a standard deviation larger by sqrt(freedom/(freedom - 2)).
            call check_close(names(p)//': posterior', deviation(x%q(p, :))/(s%std_error(p) &
               *sqrt(s%freedom/(s%freedom - 2.0_wp))), 1.0_wp, 0.03_wp)
            call check_close(names(p)//': bootstrap', deviation(resampled%estimates(p, :)) &
               /s%std_error(p), 1.0_wp, 0.06_wp)
         end do
      end associate
   end subroutine test_linear

   !> 2 % noise (.0176, seed 3), where c_D is known to a factor: against 600,000 draws by a program
   !> in NumPy (B-splines, numpy.linalg.eig, density J**(-49/2) for c_D, m_H, c_H, k_H > 0, weights
   !> from a t distribution), worth 440,000 independent ones. Its halves agree to .003 standard
   !> deviations in the means and to .12 % in the deviations: nothing beside the errors of draws.
   !> With n independent draws, means and deviations scatter by 1/sqrt(n) (c_D's deviation by 1.0 %
   !> over 24 seeds), and ends by 3/sqrt(n) standard deviations: four times these are allowed.
   subroutine test_other_sampler()
      real(wp), parameter :: mean(4) = [7.23725e-3_wp, 3.862321e-2_wp, 3.54469e-3_wp, &
         0.29560969_wp]
      real(wp), parameter :: sd(4) = [3.28337e-3_wp, 1.69275e-3_wp, 3.177e-4_wp, 4.11414e-3_wp]
      real(wp), parameter :: lower(4) = [1.94117e-3_wp, 3.560121e-2_wp, 2.94791e-3_wp, &
         0.28787588_wp]
      real(wp), parameter :: upper(4) = [1.472535e-2_wp, 4.226754e-2_wp, 4.20014e-3_wp, &
         0.30410819_wp]
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      type(plan_t) :: plan
      real(wp), allocatable :: x(:)
      real(wp) :: scatter
      character(len=:), allocatable :: way
      integer :: p, kind

      call fit_noisy(gaussian_noise(samples, 0.0176_wp, 3), found, experiments)
      if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
      call check('2 % noise: fit and profile', .not. allocated(error))
      if (allocated(error)) return
      do kind = 1, 2
         plan = plan_t(importance=kind == 1)
         way = 'weights: '
         if (kind == 2) way = 'chains: '
         call sample_fit(model, mesh, experiments, found, sides, plan, posterior, error)
         call check(way//'drawn', .not. allocated(error))
         if (allocated(error)) return
         call check(way//'as asked for', posterior%draws%weighted .eqv. kind == 1)
         call check(way//'worth', posterior%draws%effective > 4000)
         call check(way//'chains agree', all(posterior%draws%reduction < 1.01_wp))
         scatter = 1/sqrt(min(posterior%draws%effective, 10000.0_wp))
         do p = 1, 4
            x = posterior%draws%q(p, :)
            call sort(x)
            call check_close(way//names(p)//', mean', (sum(x)/size(x) - mean(p))/sd(p), 0.0_wp, &
               4*scatter)
            call check_close(way//names(p)//', deviation', deviation(x)/sd(p), 1.0_wp, 4*scatter)
            call check_close(way//names(p)//', lower end', (quantile(x, 0.025_wp) - lower(p)) &
               /sd(p), 0.0_wp, 12*scatter)
            call check_close(way//names(p)//', upper end', (quantile(x, 0.975_wp) - upper(p)) &
               /sd(p), 0.0_wp, 12*scatter)
         end do
      end do
   end subroutine test_other_sampler

   !> The same bits, however many threads there are.
   subroutine test_threads()
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      type(bootstrap_t) :: resampled
      real(wp), allocatable :: draws(:, :), estimates(:, :)
      integer :: before, threads

      before = omp_get_max_threads()
      do threads = 1, 3
         call omp_set_num_threads(threads)
         call fit_noisy(gaussian_noise(samples, 0.0176_wp, 3), found, experiments)
         if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
         if (.not. allocated(error)) call sample_fit(model, mesh, experiments, found, sides, &
            plan_t(draws=1000), posterior, error)
         if (.not. allocated(error)) call bootstrap_fit(model, mesh, experiments, found, &
            bootstrap_plan_t(n=100), resampled, error)
         call check(to_text(threads)//' threads', .not. allocated(error))
         if (allocated(error)) exit
         if (threads == 1) then
            draws = posterior%draws%q
            estimates = resampled%estimates
         else
            call check('as with one: draws', all(posterior%draws%q <= draws) .and. &
               all(posterior%draws%q >= draws))
            call check('as with one: bootstrap', all(resampled%estimates <= estimates) .and. &
               all(resampled%estimates >= estimates))
         end if
      end do
      call omp_set_num_threads(before)
   end subroutine test_threads

   !> Noise with a memory, e_t = .8 e_(t-1) + white: its order is found, and blocks are what a
   !> bootstrap takes; noise said to be white is taken for that.
   subroutine test_colour()
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      type(bootstrap_t) :: resampled
      real(wp) :: noise(samples)
      integer :: i

      noise = gaussian_noise(samples, 0.005_wp, 8)
      do i = 2, samples
         noise(i) = noise(i) + 0.8_wp*noise(i - 1)
      end do
      call fit_noisy(noise, found, experiments)
      if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
      if (.not. allocated(error)) call sample_fit(model, mesh, experiments, found, sides, &
         plan_t(draws=2000), posterior, error)
      call check('coloured noise: drawn', .not. allocated(error))
      if (allocated(error)) return
      call check('coloured noise: of an order', posterior%order(1) > 0, &
         to_text(posterior%order(1)))
      call sample_fit(model, mesh, experiments, found, sides, plan_t(draws=2000, &
         coloured=.false.), posterior, error)
      call check('coloured noise: white if told so', .not. allocated(error) .and. &
         posterior%order(1) == 0)
      call bootstrap_fit(model, mesh, experiments, found, bootstrap_plan_t(n=100), resampled, error)
      call check('coloured noise: blocks', .not. allocated(error) .and. &
         resampled%kind == blocks .and. resampled%block > 1, to_text(resampled%block))
   end subroutine test_colour

   !> Force and all that resists it may grow together: no parameter has limits, and there is no
   !> posterior without a prior.
   subroutine test_no_limit()
      character(len=9), parameter :: all_of_them(8) = [character(len=9) :: 'E', 'rho', 'm_T', &
         'm_H', 'c_H', 'k_H', 'c_D', 'amplitude']
      type(stage_t) :: before
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      integer :: i

      before = stage
      stage = stage_of(all_of_them, [80.0_wp, 0.03_wp, 0.15_wp, exact(2:), exact(1), 1.0_wp])
      call fit_noisy(gaussian_noise(samples, 0.0176_wp, 3), found, experiments)
      stage = before
      if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
      call check('no limit: profiles', .not. allocated(error))
      if (allocated(error)) return
      call check('no limit: above', all(sides(2, :)%state == is_open))
      do i = 1, size(all_of_them)
         call check('no limit: '//trim(all_of_them(i))//', below', sides(1, i)%state == at_bound, &
            to_text(sides(1, i)%state)//' '//sides(1, i)%reason)
      end do
      call sample_fit(model, mesh, experiments, found, sides, plan_t(draws=400), posterior, error)
      call check('no limit: no posterior', allocated(error))
      if (allocated(error)) call check('no limit: said', index(error%message, 'no limit') > 0, &
         error%message)
   end subroutine test_no_limit

   !> 9 % noise: c_D reaches its bound 0, and all parameters stay inside the bounds of the stage.
   subroutine test_bound()
      type(stage_t) :: before
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior

      before = stage
      stage%upper = [1.0_wp, 0.2_wp, 0.1_wp, 1.0_wp]
      call fit_noisy(gaussian_noise(samples, 0.08_wp, 3), found, experiments)
      stage = before
      if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
      call check('at a bound: profiles', .not. allocated(error))
      if (allocated(error)) return
      call check('at a bound: c_D', sides(1, 1)%state == at_bound)
      call check_close('at a bound: its end', sides(1, 1)%end, 0.0_wp, 0.0_wp)
      call sample_fit(model, mesh, experiments, found, sides, plan_t(draws=2000), posterior, error)
      call check('at a bound: draws', .not. allocated(error))
      if (allocated(error)) return
      call check('at a bound: inside', all(posterior%draws%q > 0) .and. &
         all(maxval(posterior%draws%q, dim=2) < [1.0_wp, 0.2_wp, 0.1_wp, 1.0_wp]))
   end subroutine test_bound

   !> The same record without an end of the range of m_H: J approaches a limit as m_H grows, and so
   !> much of a flat prior lies there that the posterior is refused before anything is drawn.
   subroutine test_tail()
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior

      call fit_noisy(gaussian_noise(samples, 0.08_wp, 3), found, experiments)
      if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
      call check('a long tail: profiles', .not. allocated(error))
      if (allocated(error)) return
      call check('a long tail: m_H has an interval', sides(2, 2)%state == is_closed)
      call sample_fit(model, mesh, experiments, found, sides, plan_t(draws=2000), posterior, error)
      call check('a long tail: refused', allocated(error))
      if (.not. allocated(error)) return
      call check('a long tail: the parameter and the remedy', index(error%message, 'm_H') > 0 &
         .and. index(error%message, 'expected a bound') > 0, error%message)
      call check('a long tail: nothing drawn', .not. allocated(posterior%draws%q))
   end subroutine test_tail

   !> Counts the records whose intervals hold the true value. In the long run 2,000 records know a
   !> coverage of 95 % with a standard deviation of .5 %, in the daily run 40 records with 3.4 %;
   !> three of these are allowed either way. c_D lies one or two standard errors above its bound 0,
   !> where a correct interval covers more than 95 %.
   subroutine test_coverage()
      type(experiment_t) :: experiments(1)
      type(stage_fit_t) :: found
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t) :: posterior
      real(wp) :: noise(samples), sd, x(2000), rate(4, 3), room
      integer :: inside(4, 3), p, r, records, used

      records = merge(2000, 40, in_long_run())
      sd = 0.02_wp*norm2(clean%acceleration)/sqrt(real(samples, wp))
      inside = 0
      used = 0
      do r = 1, records
         noise = gaussian_noise(samples, sd, 90000 + r)
         call fit_noisy(noise, found, experiments)
         if (.not. allocated(error)) call profile_fit(model, mesh, experiments, found, sides, error)
         if (.not. allocated(error)) call sample_fit(model, mesh, experiments, found, sides, &
            plan_t(draws=size(x)), posterior, error)
         if (allocated(error)) cycle
         used = used + 1
         do p = 1, 4
            x = posterior%draws%q(p, :)
            call sort(x)
            associate (q => found%fit%estimate(p), half => found%statistics%half_width(p))
               call count_one(inside(p, 1), p, q - half, q + half)
            end associate
            call count_one(inside(p, 2), p, sides(1, p)%end, sides(2, p)%end)
            call count_one(inside(p, 3), p, quantile(x, 0.025_wp), quantile(x, 0.975_wp))
         end do
      end do
      call check('coverage: every record', used == records, to_text(used))
      rate = real(inside, wp)/max(used, 1)
      room = merge(0.015_wp, 0.103_wp, in_long_run())
      do p = 2, 4
         call check_close(names(p)//': profile', rate(p, 2), 0.95_wp, room)
         call check_close(names(p)//': posterior', rate(p, 3), 0.95_wp, room)
      end do
      call check_close('c_D: profile', rate(1, 2), 0.96_wp, room + 0.01_wp)
      call check_close('c_D: posterior', rate(1, 3), 0.96_wp, room + 0.01_wp)
      call check('c_D: linear theory beside it', rate(1, 1) > 0.8_wp, to_text(rate(1, 1)))

   end subroutine test_coverage

   !> One more interval of parameter p that holds the truth.
   subroutine count_one(n, p, low, high)
      integer, intent(inout) :: n
      integer, intent(in) :: p
      real(wp), intent(in) :: low, high

      if (low <= exact(p) .and. exact(p) <= high) n = n + 1
   end subroutine count_one

   pure real(wp) function deviation(x)
      real(wp), intent(in) :: x(:)

      deviation = sqrt(sum((x - sum(x)/size(x))**2)/(size(x) - 1))
   end function deviation

end program test_inference
