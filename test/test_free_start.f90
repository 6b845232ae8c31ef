!> Fits from a start of which nothing is known: against one search for everything, and over several
!> records.
program test_free_start
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_bad_input, status_failed
   use beamid_excitation, only: excitation_t, new_free, new_pulse, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_t, new_galerkin
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index, offset, parameters
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_responses, only: work_t
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_structure, only: end_t, free_end, hose_t, no_spring, of_c_H, of_k_H, of_length, &
      of_m_H, of_x_F, &
      of_x_S, sensor_t, structure_t
   use beamid_unknowns, only: name_of
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use free_decays, only: first_offset, formulas, made, make_two, mesh, names, noise_of, noisy, &
      stage_for, stamps, true_offset, truth
   use models, only: model_of, stage_of
   use whole_problem, only: new_whole, whole_t
   implicit none

   call test_formulas()
   call test_iterations()
   call test_long_record()
   call test_two_records()
   call test_nothing_shared()
   call test_later_clock()
   call test_other_structures()
   call test_sensor_at_tip()
   call test_offset_alone()
   call test_trap()
   call test_refusals()
   call finish('free_start')

contains

   !> One record by each of the three formulas, after a release, a pulse, a release by force.
   subroutine test_formulas()
      type(experiment_t) :: experiment
      type(excitation_t) :: causes(3)
      integer :: k

      causes = [new_release(0.02_wp, 0.0_wp, .true.), new_pulse(20.0_wp, 0.004_wp), &
                new_release(1.0_wp, -0.1_wp, .false.)]
      do k = 1, 3
         experiment = made(truth, causes(k), formulas(k), stamps(200, 0.5_wp, k))
         experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 50 + k))
         call compare_with_whole('formula '//to_text(k), [experiment], formulas(k), &
            stage_for(names, 1))
      end do
   end subroutine test_formulas

   !> The trial fits of a record of 60,000 samples use a part of it. The fit that follows uses all,
   !> and ends where a fit from the stated start values does.
   subroutine test_long_record()
      integer, parameter :: m = 60000
      type(experiment_t) :: record
      type(stage_fit_t), allocatable :: stated(:), automatic(:)
      type(error_t), allocatable :: error
      type(stage_t) :: stage
      integer :: k

      record = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), &
         0.5_wp + 2e-4_wp*[(k, k=0, m - 1)])
      record = noisy(record, gaussian_noise(m, noise_of(record), 71))
      stage = stage_for(names, 1)
      call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage], [record], stated, &
         error)
      if (.not. allocated(error)) then
         deallocate (stage%start)
         stage%automatic = .true.
         call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage], [record], &
            automatic, error)
      end if
      call check('a long record: the fits converge', .not. allocated(error))
      if (allocated(error)) return
      call check('a long record: every sample counts', automatic(1)%statistics%samples == m)
      ! The searches end when a step is below 1e-8 of the estimates or better.
      call check_close('a long record: the estimates', maxval(abs(automatic(1)%fit%estimate &
         - stated(1)%fit%estimate)/stated(1)%statistics%std_error(:size(stage%free))), 0.0_wp, &
         1e-3_wp)
   end subroutine test_long_record

   !> Two beams cut from one strip, the sensors not quite alike: E, c_D and gamma in common.
   subroutine test_two_records()
      type(experiment_t) :: two(2)

      call make_two(two)
      two(1) = noisy(two(1), gaussian_noise(size(two(1)%samples), noise_of(two(1)), 61))
      two(2) = noisy(two(2), gaussian_noise(size(two(2)%samples), noise_of(two(2)), 62))
      call compare_with_whole('two records', two, formulas(3), stage_for([character(len=5) :: 'E', &
         'c_D', 'gamma'], 2))
   end subroutine test_two_records

   !> One search for everything has the same minimum and the same standard errors.
   subroutine compare_with_whole(what, experiments, formula, stage)
      character(len=*), intent(in) :: what
      type(experiment_t), intent(in) :: experiments(:)
      type(observation_t), intent(in) :: formula
      type(stage_t), intent(in) :: stage
      type(experiment_t), allocatable :: even(:)
      type(fit_t) :: long
      type(stage_fit_t), allocatable :: fits(:)
      type(statistics_t) :: statistics
      type(error_t), allocatable :: error
      real(wp), allocatable :: expected(:), found(:)
      real(wp) :: worst
      integer :: k, n, m, linear

      ! All records count alike.
      even = experiments
      do k = 1, size(even)
         even(k)%sd = 1
      end do
      call identify(model_of(truth, new_free(2), formula), mesh, [stage], even, fits, error)
      call check(what//': the fit converges', .not. allocated(error))
      if (allocated(error)) return
      n = size(stage%free)
      linear = 5*size(experiments)
      m = sum([(size(experiments(k)%samples), k=1, size(experiments))])
      call search_for_everything(experiments, formula, stage, long, error)
      call check(what//': the search for everything converges', .not. allocated(error))
      if (allocated(error)) return
      associate (short => fits(1)%fit, stated => fits(1)%statistics, q => fits(1)%quantities)
         call check(what//': unknowns', size(q) == n + linear .and. &
            stated%parameters == n + linear .and. stated%samples == m, to_text(size(q)))
         if (size(q) /= n + linear) return
         call new_statistics(long%jacobian, long%residual, long%estimate, q%scale, statistics, &
            error)
         call check_close(what//': J', short%J/long%J, 1.0_wp, 1e-10_wp)
         expected = long%estimate
         found = q%value
         do k = n + 5, n + linear, 5
            expected(k) = expected(k) + first_offset
         end do
         ! The differences of the first formula leave J digits of 3e-12 (seen from twelve starts,
         ! however the search ends): sqrt(3e-12 m), 2e-5 standard errors, by which E and rho go
         ! together.
         worst = maxval(abs(found - expected)/stated%std_error)
         call check_close(what//': estimates, largest difference over standard error', worst, &
            0.0_wp, 5e-5_wp)
         worst = maxval(abs(stated%std_error/statistics%std_error - 1))
         call check_close(what//': standard errors, largest relative difference', worst, 0.0_wp, &
            1e-6_wp)
         worst = maxval(abs(stated%correlation - statistics%correlation))
         call check_close(what//': correlations', worst, 0.0_wp, 1e-6_wp)
         call check_close(what//': variance is J by m - n - k', stated%variance*(m - n - linear) &
            /short%J, 1.0_wp, 1e-12_wp)
         call check(what//': exact derivatives', maxval(short%derivative_check) < 1e-6_wp .and. &
            minval(short%derivative_check) >= 0, to_text(maxval(short%derivative_check)))
      end associate
   end subroutine compare_with_whole

   !> The same start, and no motion at all.
   subroutine search_for_everything(experiments, formula, stage, found, error)
      type(experiment_t), intent(in) :: experiments(:)
      type(observation_t), intent(in) :: formula
      type(stage_t), intent(in) :: stage
      type(fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      type(whole_t) :: whole
      type(variable_t), allocatable :: variables(:)
      integer :: k, m

      whole = new_whole(experiments, truth, mesh, formula, stage%free, stage%owners())
      m = sum([(size(experiments(k)%samples), k=1, size(experiments))])
      variables = [(new_variable(stage%start(k), 0.0_wp, unbounded, stage%start(k)), &
                    k=1, size(stage%free)), &
                   (new_variable(0.0_wp, -unbounded, unbounded, 1.0_wp), k=1, 5*size(experiments))]
      call fit(whole, m, variables, options_t(), found, error)
   end subroutine search_for_everything

   !> From 21 starts, E up to 2 % off, c_D by factors up to 3: one minimum, and fewer iterations
   !> than for everything at once.
   subroutine test_iterations()
      type(experiment_t) :: experiment
      type(stage_t) :: stage
      type(fit_t) :: long
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), parameter :: factors_E(7) = [0.98_wp, 0.99_wp, 0.995_wp, 1.002_wp, 1.005_wp, &
                             1.01_wp, 1.02_wp], factors_c(3) = [0.4_wp, 1.3_wp, 3.0_wp]
      integer :: i, j, few, many, same
      real(wp) :: least

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 3))
      experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 53))
      few = 0
      many = 0
      same = 0
      least = -1
      do i = 1, size(factors_E)
         do j = 1, size(factors_c)
            stage = stage_for(names, 1)
            stage%start = stage%start*[factors_E(i), 1.0_wp, factors_c(j), 1.0_wp]
            call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage], [experiment], &
               fits, error)
            if (.not. allocated(error)) call search_for_everything([experiment], formulas(3), &
               stage, long, error)
            if (allocated(error)) cycle
            if (least < 0) least = fits(1)%fit%J
            if (abs(fits(1)%fit%J/least - 1) < 1e-10_wp .and. abs(long%J/least - 1) < 1e-10_wp) &
               same = same + 1
            few = few + fits(1)%fit%iterations
            many = many + long%iterations
         end do
      end do
      call check('one minimum from 21 starts by either search', same == 21, to_text(same))
      call check('fewer iterations than for everything', few < many, to_text(few)//' against '// &
         to_text(many))
   end subroutine test_iterations

   !> Two records that share nothing are two fits.
   subroutine test_nothing_shared()
      type(experiment_t) :: two(2)
      type(stage_fit_t), allocatable :: both(:), one(:)
      type(error_t), allocatable :: error
      type(model_t) :: model
      real(wp) :: worst, worst_error, J
      integer :: r, k, p, found

      call make_two(two)
      do r = 1, 2
         two(r) = noisy(two(r), gaussian_noise(size(two(r)%samples), noise_of(two(r)), 70 + r))
         two(r)%sd = 1
      end do
      model = model_of(truth, new_free(2), formulas(3))
      call identify(model, mesh, [stage_for([character(len=5) ::], 2)], two, both, error)
      call check('nothing shared: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      worst = 0
      worst_error = 0
      found = 0
      J = 0
      do r = 1, 2
         call identify(model, mesh, [stage_for(names, 1)], [two(r)], one, error)
         call check('record '//to_text(r)//' alone: the fit converges', .not. allocated(error))
         if (allocated(error)) return
         J = J + one(1)%fit%J
         do k = 1, size(one(1)%quantities)
            do p = 1, size(both(1)%quantities)
               if (both(1)%quantities(p)%name /= name_of(one(1)%quantities(k)%name, r)) cycle
               found = found + 1
               worst = max(worst, abs(both(1)%quantities(p)%value - one(1)%quantities(k)%value) &
                  /one(1)%statistics%std_error(k))
               ! In units of the noise, which the two have in common now.
               worst_error = max(worst_error, abs(both(1)%statistics%std_error(p) &
                  /sqrt(both(1)%statistics%variance)/(one(1)%statistics%std_error(k) &
                  /sqrt(one(1)%statistics%variance)) - 1))
            end do
         end do
      end do
      call check('nothing shared: 2 (4 + 5) quantities by name', found == 18, to_text(found))
      ! As above: where the searches stop, in standard errors.
      call check_close('nothing shared: estimates', worst, 0.0_wp, 1e-5_wp)
      call check_close('nothing shared: errors', worst_error, 0.0_wp, 1e-5_wp)
      call check_close('nothing shared: J', both(1)%fit%J/J, 1.0_wp, 1e-10_wp)
   end subroutine test_nothing_shared

   !> A clock that began long ago changes nothing but the last digits of the times: 1e-16 of 1e4 s
   !> are 1e-12 s, 4e-11 of the shorter period, and 1e-8 of the noise.
   subroutine test_later_clock()
      type(experiment_t) :: early, late
      type(stage_fit_t), allocatable :: before(:), after(:)
      type(error_t), allocatable :: error
      type(model_t) :: model

      early = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, 0.5_wp, &
         31))
      early = noisy(early, gaussian_noise(200, noise_of(early), 81))
      late = early
      late%samples = late%samples + 10000
      model = model_of(truth, new_free(2), formulas(3))
      call identify(model, mesh, [stage_for(names, 1)], [early], before, error)
      if (.not. allocated(error)) call identify(model, mesh, [stage_for(names, 1)], [late], after, &
         error)
      call check('a later clock: both converge', .not. allocated(error))
      if (allocated(error)) return
      call check_close('a later clock: estimates, in standard errors', maxval(abs( &
         after(1)%quantities%value - before(1)%quantities%value)/before(1)%statistics%std_error), &
         0.0_wp, 1e-5_wp)
   end subroutine test_later_clock

   !> Hose, soft root, inertia of the tip, a moving sensor: the derivative of what is left with
   !> respect to every parameter, one to four modes, every formula, against five-point differences.
   subroutine test_other_structures()
      type(structure_t) :: structure
      type(residual_t) :: problem
      type(experiment_t) :: experiment
      type(error_t), allocatable :: error
      real(wp), allocatable :: exact(:, :), difference(:), r(:), p(:), moved(:)
      real(wp), parameter :: weights(4) = [1, -8, 8, -1]/12.0_wp
      integer, parameter :: steps(4) = [-2, -1, 1, 2]
      real(wp) :: h, worst
      integer, allocatable :: free(:)
      integer :: formula, modes, j, k

      structure = structure_t(length=4.0_wp, rho=0.03_wp, E=80.0_wp, I=1.0_wp, c_D=0.3_wp, &
         m_T=0.15_wp, hose=hose_t(m_H=0.04_wp, c_H=0.01_wp, k_H=0.3_wp), gamma=0.02_wp, &
         J_T=0.01_wp, &
         end=[end_t(kappa_R=1/50.0_wp, c_R=0.3_wp), free_end], g=2.0_wp, T=0.5_wp, &
         sensor=sensor_t(0.02_wp, 0.005_wp, 3.1_wp))
      experiment%samples = 10*stamps(60, 0.05_wp, 41)
      experiment%measured = gaussian_noise(60, 1.0_wp, 91)
      ! Where a force acts means nothing here.
      free = pack([(k, k=1, of_x_S)], [(k /= of_x_F .and. &
         parameters(k)%group /= 'along', k=1, of_x_S)])
      free = [free, of_m_H, of_c_H, of_k_H]
      p = [(structure%get(free(k)), k=1, size(free))]
      ! Of the ends, only the rotation of the root has a spring that is neither rigid nor absent.
      free = pack(free, p > 0 .and. p < no_spring)
      p = [(structure%get(free(k)), k=1, size(free))]
      do modes = 1, 4
         do formula = 1, 3
            experiment%excitation = new_free(modes)
            call new_residuals(model_of(structure, experiment%excitation, observation_t(formula, &
               merge(0.0_wp, 0.02_wp, formula == 3))), mesh, [experiment], problem, error)
            if (allocated(error)) exit
            problem%free = free
            problem%record = spread(0, 1, size(free))
            problem%offset = .true.
            exact = spread(experiment%samples, 2, size(p))
            r = experiment%samples
            call problem%jacobian(p, r, exact, error)
            if (allocated(error)) exit
            worst = 0
            do k = 1, size(p)
               ! Frequencies go with l**-2, with the others' roots at most.
               h = merge(2.5e-4_wp, 1e-3_wp, problem%free(k) == of_length)*p(k)
               difference = 0*r
               do j = 1, 4
                  moved = p
                  moved(k) = p(k) + steps(j)*h
                  call problem%residuals(moved, r, error)
                  if (allocated(error)) exit
                  difference = difference + weights(j)/h*r
               end do
               worst = max(worst, norm2(exact(:, k) - difference)/norm2(difference))
            end do
            ! Truncation (1e-3)**4 times a power of phase, some tens of radians; round-off 1e-13
            ! of the residuals where a parameter hardly matters.
            call check_close('derivatives, '//to_text(modes)//' modes, formula '// &
               to_text(formula), worst, 0.0_wp, 1e-6_wp)
         end do
      end do
      call check('a model of everything', .not. allocated(error))
   end subroutine test_other_structures

   !> A sensor at the tip, with noise and with the same noise turned round: in one of the two the
   !> sum of squares is least with the sensor in the air; neither puts it there.
   subroutine test_sensor_at_tip()
      type(structure_t) :: at_the_tip
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k, at_bound

      at_the_tip = truth
      at_the_tip%sensor(1)%x_S = truth%length
      model = model_of(at_the_tip, new_pulse(20.0_wp, 0.004_wp), formulas(3))
      experiment = made(at_the_tip, model%excitation, formulas(3), stamps(200, 0.02_wp, 61))
      experiment%excitation = model%excitation
      stage%free = [free_index('x_S'), offset]
      stage%start = [0.49_wp, 0.0_wp]
      stage%lower = [0.0_wp, 0.0_wp]
      stage%upper = [unbounded, unbounded]
      stage%offset = .true.
      call stage%distribute([integer ::], 1)
      at_bound = 0
      do k = -1, 1, 2
         call identify(model, mesh, [stage], [noisy(experiment, k*gaussian_noise(200, &
            noise_of(experiment), 63))], fits, error)
         call check('place of a sensor at the tip: the fit converges', .not. allocated(error))
         if (allocated(error)) return
         associate (x => fits(1)%fit%estimate(1), l => truth%length)
            call check('the sensor is on the beam', x <= l .and. x > 0.9_wp*l, to_text(x))
            if (.not. x < l) at_bound = at_bound + 1
         end associate
      end do
      call check('once at its end', at_bound == 1, to_text(at_bound))
   end subroutine test_sensor_at_tip

   !> Nothing to search for: what enters linearly is known all the same.
   subroutine test_offset_alone()
      type(experiment_t) :: experiment
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 71))
      experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 73))
      allocate (stage%free(0), stage%lower(0), stage%upper(0))
      stage%offset = .true.
      call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage], [experiment], fits, &
         error)
      call check('offset alone: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      associate (q => fits(1)%quantities, s => fits(1)%statistics)
         call check('offset alone: five unknowns', size(q) == 5 .and. s%parameters == 5 .and. &
            s%samples == 200)
         call check('offset alone: within four standard errors', abs(q(5)%value - true_offset) &
            < 4*s%std_error(5), to_text(abs(q(5)%value - true_offset)/s%std_error(5)))
         ! 195 degrees of freedom: a deviation of 5 %, four of these.
         call check_close('offset alone: sd of the noise', sqrt(s%variance), noise_of(experiment), &
            0.2_wp*noise_of(experiment))
      end associate
   end subroutine test_offset_alone

   !> A steel bar in a vice with k_R l/(E I) = 55. A rigid clamp with a softer bar has the same
   !> first frequency, but mode 2 is a third of a cycle late at the end. A search for k_R that
   !> starts from there stays at the rigid clamp. The stage is repeated from the spectral lines
   !> then, and finds the truth, unless it has start='case'.
   subroutine test_trap()
      type(structure_t) :: bar, guess
      type(experiment_t) :: record(1)
      type(stage_t) :: stages(2)
      type(stage_fit_t), allocatable :: fits(:), trapped(:)
      type(error_t), allocatable :: error
      integer :: k

      bar = structure_t(length=0.42_wp, rho=0.58725_wp, E=2.05e11_wp, I=5.625e-11_wp, &
         c_D=2e6_wp, gamma=0.1_wp, sensor=sensor_t(m_S=0.012_wp, x_S=0.4_wp))
      guess = bar
      guess%E = 2.1e11_wp
      guess%gamma = 0.05_wp
      bar%end(1)%kappa_R = 1/1500.0_wp
      record(1) = made(bar, new_release(0.01_wp, 0.0_wp, .true.), formulas(3), &
         [(0.3_wp + 1e-3_wp*k, k=0, 3699)])
      record(1) = noisy(record(1), gaussian_noise(3700, 0.02_wp, 61))
      record(1)%excitation = new_free(4)
      stages(1) = stage_of([character(len=5) :: 'E', 'c_D', 'gamma'], offset=.true.)
      stages(2) = stage_of([character(len=5) :: 'E', 'c_D', 'gamma', 'k_R'], offset=.true.)
      stages(1)%automatic = .true.
      call identify(model_of(guess, new_free(4), formulas(3)), mesh, stages, record, fits, error)
      call check('clamp: fitted', .not. allocated(error))
      if (allocated(error)) return
      do k = 1, 4
         associate (q => fits(2)%quantities(k), s => fits(2)%statistics)
            call check_close('clamp: '//trim(q%name)//' in standard errors', &
               (q%searched - bar%get(q%parameter))/s%std_error(k), 0.0_wp, 5.0_wp)
         end associate
      end do
      stages(2)%declared = .true.
      call identify(model_of(guess, new_free(4), formulas(3)), mesh, stages, record, trapped, &
         error)
      call check('clamp, from the stage before: fitted', .not. allocated(error))
      if (allocated(error)) return
      call check('clamp, from the stage before: stays rigid', &
         .not. abs(trapped(2)%quantities(4)%searched) > 0 .and. trapped(2)%fit%J > &
         100*fits(2)%fit%J, to_text(trapped(2)%fit%J/fits(2)%fit%J))
   end subroutine test_trap

   !> What cannot be done ends with a message, never with numbers.
   subroutine test_refusals()
      type(experiment_t) :: experiment, few
      type(structure_t) :: undamped
      type(model_t) :: model
      type(stage_t) :: stage
      real(wp) :: period
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 51))
      stage = stage_for(names, 1)
      model = model_of(truth, new_free(2), formulas(3))

      few = experiment
      few%samples = few%samples(:4)
      few%measured = few%measured(:4)
      call refused('4 samples for 5 linear unknowns', model, stage_for(names, 2), &
         [experiment, few], status_failed, '4 samples for 5 linear unknowns')

      experiment%excitation = new_free(6)
      call refused('more modes than the mesh has', model, stage, [experiment], status_bad_input, &
         'found 6 modes, expected at most 5')
      experiment%excitation = new_free(2)

      deallocate (model%solver)
      allocate (cvode_t :: model%solver)
      call refused('a free start by cvode', model, stage, [experiment], status_bad_input, &
         'expected method=''modal''')

      ! Samples a whole period of the first mode apart, undamped: it looks like an offset.
      undamped = truth
      undamped%c_D = 0
      undamped%gamma = 0
      model = model_of(undamped, new_free(1), formulas(3))
      stage%free = [free_index('gamma')]
      stage%record = [0]
      stage%start = [0.07_wp]
      stage%lower = [0.0_wp]
      stage%upper = [unbounded]
      experiment%excitation = new_free(1)
      call identify(model, mesh, [stage], [experiment], fits, error)
      call check('one mode of an undamped beam can be fitted', .not. allocated(error))
      if (allocated(error)) return
      period = period_of(undamped)
      experiment%samples = [(k*period, k=0, 29)]
      experiment%measured = experiment%measured(:30)
      stage%free = [free_index('m_T')]
      stage%start = [1e-9_wp]
      stage%lower = [0.0_wp]
      stage%upper = [1e-8_wp]
      call refused('samples a period apart', model, stage, [experiment], status_failed, &
         'cannot tell the motions of the modes and the offset apart')
   end subroutine test_refusals

   !> Of the first mode of the mesh [s].
   real(wp) function period_of(structure) result(period)
      type(structure_t), intent(in) :: structure
      type(modal_t) :: solver
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(work_t) :: work
      type(error_t), allocatable :: error
      complex(wp) :: s(1), ds(1, 0)

      galerkin = new_galerkin(mesh, structure%length)
      equations = new_equations(galerkin, structure, new_free(1))
      call solver%prepare(galerkin, error)
      call solver%free_motion(equations, [integer ::], s, ds, work, error)
      period = 2*acos(-1.0_wp)/aimag(s(1))
   end function period_of

   subroutine refused(what, model, stage, experiments, status, words)
      character(len=*), intent(in) :: what, words
      type(model_t), intent(in) :: model
      type(stage_t), intent(in) :: stage
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: status
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      call identify(model, mesh, [stage], experiments, fits, error)
      if (.not. allocated(error)) then
         call check(what//' is refused', .false., 'accepted')
      else
         call check(what//' is refused', error%status == status .and. index(error%message, words) &
            > 0, error%message)
      end if
   end subroutine refused

end program test_free_start
