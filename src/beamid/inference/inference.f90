!> What a record says of the parameters beyond linear theory around one fit: profiles, draws from
!> the posterior, and fits of resampled records.
module beamid_inference
   use beamid_distributions, only: student_quantile
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_noise, only: gaussian_noise
   use beamid_posteriors, only: new_posterior, posterior_t
   use beamid_priors, only: priors_of
   use beamid_profile_likelihood, only: follow_profile, is_open, side_t
   use beamid_resampling, only: acceleration, block_places, corrected_interval, &
      percentile_interval, usual_block
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_sampling, only: draws_t, plan_t, sample
   use beamid_simulation, only: model_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_structure, only: of_kappa_R
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: bootstrap_plan_t, bootstrap_t, posterior_draws_t, profile_fit, sample_fit, &
      bootstrap_fit

   integer, parameter, public :: by_judgement = 0, parametric = 1, blocks = 2

   type :: bootstrap_plan_t
      integer :: n = 1000
      integer :: seed = 1
      integer :: kind = by_judgement   !< blocks where the residuals are not white
      integer :: block = 0             !< samples; 0: as the residuals ask for
   end type bootstrap_plan_t

   !> Fits of resampled records.
   type :: bootstrap_t
      integer :: kind = parametric
      integer :: block = 0
      integer :: failures = 0
      real(wp), allocatable :: estimates(:, :)     !< (free, n - failures)
      integer, allocatable :: number(:)            !< (n - failures) which of them
      real(wp), allocatable :: percentile(:, :)    !< (2, free)
      real(wp), allocatable :: corrected(:, :)     !< (2, free) for bias and acceleration
      character(len=:), allocatable :: reason      !< why the first that failed did
   end type bootstrap_t

   !> Draws, and what the model does with some of them.
   type :: posterior_draws_t
      type(draws_t) :: draws
      integer, allocatable :: order(:)             !< (records) of the noise; 0: white
      !> (samples, some) accelerations
      real(wp), allocatable :: motion(:, :)
      integer, allocatable :: shown(:)             !< (some) of which draws
   end type posterior_draws_t

contains

   !> The problem of a fit as the fit has left it.
   !>
   !> variables  (n) of what it searched for
   subroutine problem_of(model, mesh, experiments, found, problem, variables, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(residual_t), intent(out) :: problem
      type(variable_t), allocatable, intent(out) :: variables(:)
      type(error_t), allocatable, intent(out) :: error
      type(quantity_t), allocatable :: quantities(:)

      if (size(found%free) == 0 .or. found%statistics%samples == 0) then
         call failure(error, 'found '//merge('nothing that is searched for      ', &
            'no degree of freedom for the noise', size(found%free) == 0)// &
            ', expected free parameters and more samples than unknowns')
         return
      end if
      if (.not. found%statistics%variance > 0) then
         call failure(error, 'found residuals of 0, expected a record with noise')
         return
      end if
      call new_residuals(model, mesh, experiments, problem, error, any(found%free == of_kappa_R))
      if (allocated(error)) return
      problem%scenario = found%scenario
      problem%weight = found%weight
      problem%noise = found%noise
      problem%strength = found%strength
      call set_free(problem, found%again())
      call variables_of(found%again(), problem%scenario, variables, quantities, error)
   end subroutine problem_of

   !> Both sides of the profile of every parameter that was searched for. J may rise by as much as
   !> it does at the end of the interval of linear theory, that of correlated residuals where they
   !> are.
   !>
   !> sides  (2, n) below and above, of what was searched for
   subroutine profile_fit(model, mesh, experiments, found, sides, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(side_t), allocatable, intent(out) :: sides(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      real(wp) :: t, rise(size(found%free)), first(size(found%free))
      integer :: finished, k, n, task

      call problem_of(model, mesh, experiments, found, problem, variables, error)
      if (allocated(error)) return
      n = size(found%free)
      associate (s => found%statistics)
         do k = 1, n
            t = student_quantile(0.95_wp, real(s%freedom, wp))
            first(k) = 0.1_wp*max(abs(found%fit%estimate(k)), variables(k)%magnitude)
            if (s%std_error(k) > 0 .and. s%corrected_half_width(k) < sqrt(unlimited)) then
               t = s%corrected_half_width(k)/s%std_error(k)
               first(k) = s%corrected_half_width(k)
            end if
            rise(k) = s%variance*t**2
         end do
      end associate
      allocate (sides(2, n))
      finished = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do task = 1, 2*n
         if (interrupted()) cycle
         call follow((task + 1)/2, 2 - modulo(task, 2))
         !$omp critical (one_side_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, 2*n, 'sides of profiles')
         !$omp end critical (one_side_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)

   contains

      subroutine follow(k, side)
         integer, intent(in) :: k, side
         type(residual_t) :: mine

         mine = problem
         call follow_profile(mine, mine%rows(), variables, found%fit%estimate, &
            sum(found%fit%residual**2), k, 2*side - 3, rise(k), first(k), sides(side, k), monitor)
      end subroutine follow

   end subroutine profile_fit

   !> Draws from the posterior.
   !>
   !> sides  (2, n) the profiles: where one has no end a flat prior has no finite weight
   !> error  such a parameter, or one of which the posterior leans on the end that its range is
   !>        given here; a density that has no mode; chains that do not agree
   subroutine sample_fit(model, mesh, experiments, found, sides, plan, posterior, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(side_t), intent(in) :: sides(:, :)
      type(plan_t), intent(in) :: plan
      type(posterior_draws_t), intent(out) :: posterior
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer, parameter :: shown = 200
      !> However large a parameter, J stays finite: somewhere a flat prior has to end. Without a
      !> bound it does at so many times the estimate, or what is moderate; and no more of the
      !> posterior may lie in the outer half of that range.
      real(wp), parameter :: widest = 100, leaning = 1e-3_wp
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(posterior_t) :: density
      real(wp) :: limit(size(found%free))
      integer :: k

      do k = 1, size(found%free)
         if (all(sides(:, k)%state /= is_open)) cycle
         call no_limit(k)
         return
      end do
      call problem_of(model, mesh, experiments, found, problem, variables, error)
      if (allocated(error)) return
      call new_posterior(problem, variables, found%fit%residual, found%jacobian, plan%coloured, &
         density)
      posterior%order = density%order
      do k = 1, size(variables)
         limit(k) = widest*max(abs(found%fit%estimate(k)), variables(k)%magnitude)
         if (variables(k)%upper <= limit(k) .and. variables(k)%lower >= -limit(k)) &
            limit(k) = 2*max(abs(variables(k)%upper), abs(variables(k)%lower))
         variables(k)%upper = min(variables(k)%upper, limit(k))
         variables(k)%lower = max(variables(k)%lower, -limit(k))
      end do
      call sample(density, variables, found%fit%estimate, plan, posterior%draws, error, monitor)
      call check_interrupt(error)
      if (allocated(error)) return
      do k = 1, size(variables)
         if (count(abs(posterior%draws%q(k, :)) > limit(k)/2) <= leaning &
            *size(posterior%draws%q, 2)) cycle
         call no_limit(k)
         return
      end do
      associate (draws => size(posterior%draws%q, 2))
         posterior%shown = [(1 + (k - 1)*(draws/min(shown, draws)), k=1, min(shown, draws))]
      end associate
      call predict(problem, posterior)
      call check_interrupt(error)

   contains

      subroutine no_limit(k)
         integer, intent(in) :: k

         call failure(error, 'posterior: the record sets '// &
            trim(found%quantities(k)%searched_name())//' no limit that counts, and all values '// &
            'up to infinity cannot be equally probable; expected a bound in its stage, or &prior')
      end subroutine no_limit

   end subroutine sample_fit

   !> The model's accelerations with some of the draws.
   subroutine predict(problem, posterior)
      type(residual_t), intent(inout) :: problem
      type(posterior_draws_t), intent(inout) :: posterior
      real(wp) :: r(problem%rows())
      real(wp), allocatable :: measured(:)
      type(error_t), allocatable :: error
      logical :: computed(size(posterior%shown))
      integer :: i, k

      measured = [(problem%parts(i)%experiment%measured, i=1, size(problem%parts))]
      allocate (posterior%motion(size(measured), size(posterior%shown)))
      do k = 1, size(posterior%shown)
         call problem%residuals(posterior%draws%q(:, posterior%shown(k)), r, error)
         computed(k) = .not. allocated(error)
         if (computed(k)) posterior%motion(:, k) = measured + problem%without_weights(r)
      end do
      posterior%shown = pack(posterior%shown, computed)
      posterior%motion = posterior%motion(:, pack([(k, k=1, size(computed))], computed))
   end subroutine predict

   !> Fits the model's own record again and again, each time with other residuals: noise of the
   !> standard deviation that was found or stated, or blocks of the residuals, put together anew.
   !> What is known of free parameters is drawn as well.
   !>
   !> error  too few of the fits succeed
   subroutine bootstrap_fit(model, mesh, experiments, found, plan, bootstrap, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(bootstrap_plan_t), intent(in) :: plan
      type(bootstrap_t), intent(out) :: bootstrap
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(error_t), allocatable :: failed
      type(options_t) :: options
      real(wp) :: estimates(size(found%free), plan%n)
      logical :: done(plan%n)
      integer :: finished, first_failed, k, number

      call problem_of(model, mesh, experiments, found, problem, variables, error)
      if (allocated(error)) return
      variables = variables%from(found%fit%estimate)
      options%relative_error = model%solver%relative_error()
      options%check = .false.
      bootstrap%kind = plan%kind
      if (plan%kind == by_judgement) bootstrap%kind = merge(parametric, blocks, found%check%white)
      if (bootstrap%kind == blocks) then
         bootstrap%block = plan%block
         if (plan%block == 0) bootstrap%block = usual_block(found%residual)
         bootstrap%block = min(bootstrap%block, minval([(size(experiments(k)%samples), &
            k=1, size(experiments))]))
      end if
      finished = 0
      first_failed = plan%n + 1
      bootstrap%reason = ''
      !$omp parallel do schedule(dynamic, 8) private(failed) copyin(stop_flag)
      do number = 1, plan%n
         if (interrupted()) cycle
         call fit_one(number, failed)
         done(number) = .not. allocated(failed)
         !$omp critical (one_replicate_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, plan%n, &
            'resampled records')
         if (allocated(failed)) then
            if (number < first_failed) then
               first_failed = number
               bootstrap%reason = failed%message
            end if
         end if
         !$omp end critical (one_replicate_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)
      if (allocated(error)) return
      bootstrap%number = pack([(k, k=1, plan%n)], done)
      bootstrap%estimates = estimates(:, bootstrap%number)
      bootstrap%failures = count(.not. done)
      if (2*bootstrap%failures > plan%n) then
         call failure(error, to_text(bootstrap%failures)//' of '//to_text(plan%n)// &
            ' fits of resampled records fail: '//bootstrap%reason)
         return
      end if
      call find_intervals(found, bootstrap)

   contains

      subroutine fit_one(number, failed)
         integer, intent(in) :: number
         type(error_t), allocatable, intent(out) :: failed
         type(residual_t) :: mine
         type(fit_t) :: fitted

         mine = problem
         call disturb(mine, found, bootstrap, plan%seed + 7919*number)
         call fit(mine, mine%rows(), variables, options, fitted, failed)
         if (.not. allocated(failed)) estimates(:, number) = fitted%estimate
      end subroutine fit_one

   end subroutine bootstrap_fit

   !> Puts another record in the place of each, and another value in that of what is known.
   subroutine disturb(problem, found, bootstrap, seed)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(in) :: found
      type(bootstrap_t), intent(in) :: bootstrap
      integer, intent(in) :: seed
      real(wp), allocatable :: noise(:)
      real(wp) :: z(size(found%free)), inflation
      integer :: which(size(found%free)), i, k, m, record, row

      ! Residuals are smaller than the noise by what the fit has taken.
      inflation = sqrt(real(found%statistics%samples, wp)/found%statistics%freedom)
      row = 0
      do i = 1, size(problem%parts)
         associate (experiment => problem%parts(i)%experiment)
            m = size(experiment%samples)
            associate (r => found%residual(row + 1:row + m))
               if (bootstrap%kind == blocks) then
                  noise = inflation*(r(block_places(m, bootstrap%block, seed + 101*i)) - sum(r)/m)
               else if (allocated(experiment%sd)) then
                  noise = gaussian_noise(m, experiment%sd, seed + 101*i)
               else
                  noise = gaussian_noise(m, inflation*norm2(r)/sqrt(real(m, wp)), seed + 101*i)
               end if
               experiment%measured = experiment%measured + r + noise
            end associate
         end associate
         row = row + m
      end do
      which = priors_of(problem%priors, problem%free, problem%record)
      z = gaussian_noise(size(z), 1.0_wp, seed + 57)
      do k = 1, size(which)
         if (which(k) == 0) cycle
         associate (prior => problem%priors(which(k)), q => found%quantities(k))
            record = problem%record(k)
            prior%centre(max(1, record, prior%record)) = q%searched &
               + z(k)*prior%width(prior%centre_in(record))
         end associate
      end do
   end subroutine disturb

   subroutine find_intervals(found, bootstrap)
      type(stage_fit_t), intent(in) :: found
      type(bootstrap_t), intent(inout) :: bootstrap
      real(wp) :: influence(size(found%residual))
      integer :: k, m, n

      n = size(found%free)
      m = size(influence)
      allocate (bootstrap%percentile(2, n), bootstrap%corrected(2, n))
      do k = 1, n
         influence = 0
         associate (s => found%statistics)
            if (all(s%std_error < sqrt(unlimited))) influence = -matmul(found%jacobian(:m, :), &
               s%covariance(:, k)/s%variance)*found%fit%residual(:m)
         end associate
         bootstrap%percentile(:, k) = percentile_interval(bootstrap%estimates(k, :))
         bootstrap%corrected(:, k) = corrected_interval(bootstrap%estimates(k, :), &
            found%fit%estimate(k), acceleration(influence))
      end do
   end subroutine find_intervals

end module beamid_inference
