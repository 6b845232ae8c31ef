!> Errors beside the noise of one record: of what is held, of what is known of free parameters, of
!> the mesh; and the noise of several records.
program test_error_sources
   use beamid_cvode, only: cvode_t
   use beamid_drifts, only: drift_t, find_drifts
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_free, new_pulse, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_parameters, only: free_index
   use beamid_priors, only: prior_t
   use beamid_refinement, only: add_mesh_shift, identify_refining
   use beamid_strings, only: to_text
   use beamid_structure, only: of_E, of_I, of_kappa_R, of_length, of_rho, of_x_S, structure_t
   use beamid_variables, only: unbounded
   use beamid_window_fits, only: fit_windows, window_fit_t
   use checks, only: check, check_close, finish, in_long_run
   use free_decays, only: formulas, made, make_two, mesh, names, noise_of, noisy, stage_for, &
      stamps, truth
   use models, only: model_of
   implicit none

   call test_held_by_refits()
   call test_free_or_held()
   call test_common_error()
   call test_cvode()
   call test_noise_of_records()
   call test_lengths()
   call test_dispute()
   call test_widths()
   call test_windows()
   call test_mesh()
   call test_coverage()
   call finish('error_sources')

contains

   !> A prior of one parameter.
   function prior(parameter, sd, record) result(one)
      integer, intent(in) :: parameter
      real(wp), intent(in) :: sd
      integer, intent(in), optional :: record
      type(prior_t) :: one

      one%name = 'p'//to_text(parameter)
      one%parameter = [parameter]
      one%slope = [1.0_wp]
      one%sd = sd
      if (present(record)) one%record = record
   end function prior

   !> Of the height of a rectangle.
   function of_height(structure, sd) result(one)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: sd
      type(prior_t) :: one
      real(wp), parameter :: height = 0.002_wp

      one = prior(of_I, sd)
      one%name = 'height'
      one%parameter = [of_I, of_rho]
      one%slope = [3*structure%I/height, structure%rho/height]
   end function of_height

   !> A noisy record of the free decay of the strip.
   function decay(m, seed) result(experiment)
      integer, intent(in) :: m, seed
      type(experiment_t) :: experiment

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(m, &
         0.5_wp, seed))
      experiment = noisy(experiment, gaussian_noise(m, noise_of(experiment), seed))
   end function decay

   !> What an error of a held parameter does is what a fit with another value finds.
   !>
   !> The fits differ by a twentieth of the error: to third order that is good to 1e-3, and what the
   !> searches leave, 1e-5 standard errors, is no more; the second order of what a residual of the
   !> size of the noise leaves out of J'J is 1e-3.
   subroutine test_held_by_refits()
      type(model_t) :: model, moved
      type(stage_fit_t), allocatable :: fits(:), above(:), below(:)
      type(error_t), allocatable :: error
      type(experiment_t) :: record
      real(wp), allocatable :: change(:)
      real(wp) :: step, worst
      integer :: k, p, source

      record = decay(200, 5)
      model = model_of(truth, new_free(2), formulas(3))
      model%priors = [prior(of_length, 1e-3_wp), prior(of_x_S, 2e-3_wp), prior(of_rho, 0.01_wp), &
         of_height(truth, 2e-5_wp)]
      call identify(model, mesh, [stage_for(names, 1)], [record], fits, error)
      call check('held: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      call check('held: four sources', size(fits(1)%held) == 4)
      do source = 1, 4
         associate (one => model%priors(source))
            do k = 1, 2
               moved = model
               deallocate (moved%priors)
               moved%structure = fits(1)%scenario%structures(1)
               step = 5e-2_wp*one%sd*(3 - 2*k)
               do p = 1, size(one%parameter)
                  call moved%structure%set(one%parameter(p), &
                     moved%structure%get(one%parameter(p)) + step*one%slope(p))
               end do
               call identify(moved, mesh, [going_on(stage_for(names, 1))], [record], above, error)
               if (allocated(error)) exit
               if (k == 1) below = above
            end do
            call check('held: fits with other values converge', .not. allocated(error))
            if (allocated(error)) return
            change = (below(1)%quantities%value - above(1)%quantities%value)/(1e-1_wp)
            ! Of the offset, which none of them moves, only noise is left.
            worst = maxval(abs(fits(1)%held(source)%effect - change)/max(abs(change), &
               1e-2_wp*fits(1)%statistics%std_error))
            call check_close('held: '//trim(one%name)//', what it does to all quantities', worst, &
               0.0_wp, 3e-3_wp)
         end associate
      end do
   end subroutine test_held_by_refits

   !> The stage from where the model is.
   function going_on(stage) result(same)
      type(stage_t), intent(in) :: stage
      type(stage_t) :: same

      same = stage
      if (allocated(same%start)) deallocate (same%start)
   end function going_on

   !> Whether a parameter that only its prior determines is held or free, the others are as
   !> uncertain, by two ways of computing it; and what is free is where prior and record pull alike.
   subroutine test_free_or_held()
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: held(:), free(:)
      type(error_t), allocatable :: error
      type(experiment_t) :: record
      real(wp) :: sd, pull, variance
      integer :: k, m

      record = decay(200, 6)
      sd = 1e-3_wp
      model = model_of(truth, new_free(2), formulas(3))
      model%priors = [prior(of_length, sd)]
      call identify(model, mesh, [stage_for(names, 1)], [record], held, error)
      stage = stage_for(names, 1)
      stage%free = [stage%free, of_length]
      stage%record = [stage%record, 0]
      stage%lower = [stage%lower, 0.0_wp]
      stage%upper = [stage%upper, unbounded]
      stage%start = [stage%start, truth%length]
      if (.not. allocated(error)) call identify(model, mesh, [stage], [record], free, error)
      call check('free or held: both converge', .not. allocated(error))
      if (allocated(error)) return
      k = findloc(free(1)%free, of_length, dim=1)
      m = size(record%samples)
      associate (s => free(1)%statistics, f => free(1)%fit, n => size(free(1)%quantities))
         ! The record by itself tells the length to far more than a millimetre.
         call check('free or held: the length is as uncertain as it was', &
            s%std_error(k) <= (1 + 1e-9_wp)*sd .and. s%std_error(k) > 0.9_wp*sd, &
            to_text(s%std_error(k)/sd))
         ! Both to first order, at points that differ by what the record knows of the length.
         call check_close('free or held: E is as uncertain', s%std_error(1), &
            hypot(held(1)%statistics%std_error(1), held(1)%from_held(1)), 0.02_wp*s%std_error(1))
         variance = sum(f%residual(:m)**2)/(m - n + 1)
         ! The residuals are orthogonal to the columns of the linear unknowns.
         pull = dot_product(free(1)%jacobian(:m, k), f%residual(:m))/free(1)%noise**2*sd &
            + (f%estimate(k) - truth%length)/sd
         ! In standard deviations: where the search stops.
         call check_close('free or held: the pulls are balanced', pull, 0.0_wp, 1e-4_wp)
         call check('free or held: noise of the record alone', free(1)%noise**2 >= variance* &
            (1 - 1e-3_wp) .and. free(1)%noise**2 <= 1.5_wp*variance, &
            to_text(free(1)%noise**2/variance))
         call check_close('free or held: J is the record''s', f%J, sum(f%residual(:m)**2), &
            1e-12_wp*f%J)
      end associate
   end subroutine test_free_or_held

   !> An error that two records have in common does what it does in each, added up.
   subroutine test_common_error()
      type(model_t) :: model
      type(experiment_t) :: two(2)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: r

      call make_two(two)
      do r = 1, 2
         two(r) = noisy(two(r), gaussian_noise(size(two(r)%samples), noise_of(two(r)), 90 + r))
         two(r)%sd = noise_of(two(r))
      end do
      model = model_of(truth, new_free(2), formulas(3))
      model%priors = [prior(of_length, 1e-3_wp), prior(of_length, 1e-3_wp, 1), &
         prior(of_length, 1e-3_wp, 2)]
      call identify(model, mesh, [stage_for([character(len=5) :: 'E', 'c_D', 'gamma'], 2)], two, &
         fits, error)
      call check('common error: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      associate (held => fits(1)%held)
         ! Sums of the same numbers.
         call check_close('common error: the sum of its parts', maxval(abs(held(1)%effect &
            - held(2)%effect - held(3)%effect)/abs(held(1)%effect)), 0.0_wp, 1e-6_wp)
         call check('common error: each record counts', minval(abs([held(2)%effect(1), &
            held(3)%effect(1)])) > 1e-3_wp*abs(held(1)%effect(1)))
      end associate
   end subroutine test_common_error

   !> By differences, where the integrator has no derivatives: steps of 1e-2 standard deviations
   !> change the record by 1e-4 of its size or less, its accelerations are good to some 1e-7: 1e-3,
   !> and as much of the derivatives by what is free.
   subroutine test_cvode()
      type(model_t) :: model
      type(excitation_t) :: pulse
      type(experiment_t) :: record
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: exact(:), stepped(:)
      type(error_t), allocatable :: error

      pulse = new_pulse(20.0_wp, 0.004_wp)
      record = made(truth, pulse, formulas(3), stamps(60, 0.05_wp, 8))
      record = noisy(record, gaussian_noise(60, noise_of(record), 8))
      record%excitation = pulse
      model = model_of(truth, pulse, formulas(3))
      model%priors = [prior(of_length, 1e-3_wp), prior(of_x_S, 2e-3_wp)]
      stage = stage_for(names, 1)
      stage%offset = .false.
      call identify(model, mesh, [stage], [record], exact, error)
      deallocate (model%solver)
      allocate (model%solver, source=cvode_t(rtol=1e-10_wp))
      if (.not. allocated(error)) call identify(model, mesh, [stage], [record], stepped, error)
      call check('cvode: both converge', .not. allocated(error))
      if (allocated(error)) return
      call check_close('cvode: what the length does', stepped(1)%held(1)%effect(1) &
         /exact(1)%held(1)%effect(1), 1.0_wp, 5e-3_wp)
      call check_close('cvode: what the place of the sensor does', stepped(1)%held(2)%effect(2) &
         /exact(1)%held(2)%effect(2), 1.0_wp, 5e-3_wp)
   end subroutine test_cvode

   !> The noise of each of two records, one ten times that of the other, is found, and a fit that
   !> knows it is better than one that does not.
   subroutine test_noise_of_records()
      type(model_t) :: model
      type(experiment_t) :: two(2), plain(2)
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: found(:), even(:)
      type(error_t), allocatable :: error
      real(wp) :: noise(2)
      integer :: r

      call make_two(two)
      do r = 1, 2
         noise(r) = noise_of(two(r))*10**(r - 1)
         two(r) = noisy(two(r), gaussian_noise(size(two(r)%samples), noise(r), 40 + r))
      end do
      plain = two
      plain(1)%sd = 1
      plain(2)%sd = 1
      model = model_of(truth, new_free(2), formulas(3))
      stage = stage_for([character(len=5) :: 'E', 'c_D', 'gamma'], 2)
      call identify(model, mesh, [stage], two, found, error)
      if (.not. allocated(error)) call identify(model, mesh, [stage], plain, even, error)
      call check('noise of records: both converge', .not. allocated(error))
      if (allocated(error)) return
      do r = 1, 2
         ! Four standard deviations of an estimate from 130 samples, 1/sqrt(260).
         call check_close('noise of record '//to_text(r), 1/found(1)%weight(r)/noise(r), 1.0_wp, &
            0.25_wp)
      end do
      call check('noise of records: known, it helps', found(1)%statistics%std_error(1) < &
         0.5_wp*even(1)%statistics%std_error(1), to_text(found(1)%statistics%std_error(1) &
         /even(1)%statistics%std_error(1)))
      ! J in units of the noise: m less what was fitted.
      call check_close('noise of records: J', found(1)%fit%J, 300.0_wp - 3 - 2 - 10, 1.0_wp)
   end subroutine test_noise_of_records

   !> One strip at three lengths, each known to 2 mm, in a clamp of unknown stiffness, by one search
   !> from the values of a table: nothing that a prior determines is held, and E is inside.
   subroutine test_lengths()
      real(wp), parameter :: length(3) = [0.6_wp, 0.5_wp, 0.4_wp], &
         wrong(3) = [1.5e-3_wp, -2e-3_wp, 1e-3_wp]
      type(model_t) :: model
      type(stage_t) :: stage
      type(experiment_t) :: records(3)
      type(structure_t) :: one
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: rest
      integer :: k, row

      do k = 1, 3
         one = truth
         one%length = length(k) + wrong(k)
         one%sensor(1)%x_S = length(k) - 0.06_wp
         one%end(1)%kappa_R = 1/2000.0_wp
         records(k) = made_of(one, 2100 + k)
         records(k)%length = length(k)
         records(k)%x_S = length(k) - 0.06_wp
      end do
      model = model_of(truth, new_free(2), formulas(3))
      model%structure%E = 7e10_wp
      model%structure%sensor(1)%m_S = 0.005_wp
      model%priors = [prior(of_length, 2e-3_wp)]
      stage%free = [(free_index(names(k)), k=1, 4), of_kappa_R, of_length]
      stage%automatic = .true.
      stage%offset = .true.
      call stage%distribute([(free_index(names(k)), k=1, 4), of_kappa_R], 3)
      call identify(model, mesh, [stage], records, fits, error)
      call check('lengths: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      call check('lengths: nothing is held', fits(1)%note == '' .and. fits(1)%doubt == '' .and. &
         size(fits(1)%free) == 8, fits(1)%note//fits(1)%doubt)
      row = 0
      do k = 1, 3
         associate (z => records(k)%measured)
            rest = norm2(fits(1)%residual(row + 1:row + size(z)))/norm2(z - sum(z)/size(z))
            row = row + size(z)
         end associate
         ! The noise is a hundredth.
         call check('lengths: fit of record '//to_text(k), rest < 0.02_wp, to_text(rest))
      end do
      call check('lengths: E inside, and known to 10 %', inside(fits(1), 1, truth%E) .and. &
         maxval(fits(1)%total(1)) < 0.2_wp*truth%E, to_text(fits(1)%quantities(1)%value))
   end subroutine test_lengths

   !> Records of beams that are not quite alike: the interval of what they are said to share is from
   !> how far they pull it apart; of one beam from noise, but in one record of twenty.
   subroutine test_dispute()
      integer, parameter :: records = 5, trials = 10
      type(model_t) :: model
      type(stage_t) :: stage
      type(experiment_t) :: all_of_them(records)
      type(structure_t) :: one
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: apart(records), spread
      integer :: disputed, held, k, n, unlike

      disputed = 0
      held = 0
      do unlike = 1, 2
         do n = 1, trials
            apart = 5e-3_wp*gaussian_noise(records, 1.0_wp, 1700 + n)*(unlike - 1)
            do k = 1, records
               one = truth
               one%E = truth%E*(1 + apart(k))
               all_of_them(k) = made_of(one, 1800 + records*n + k)
            end do
            model = model_of(truth, new_free(2), formulas(3))
            stage = stage_for([character(len=5) :: 'E', 'm_S', 'c_D', 'gamma'], records)
            call identify(model, mesh, [stage], all_of_them, fits, error)
            if (allocated(error)) cycle
            if (unlike == 1 .and. fits(1)%statistics%disputed(1)) disputed = disputed + 1
            if (unlike == 2 .and. inside(fits(1), 1, truth%E)) held = held + 1
            if (n > 1) cycle
            spread = fits(1)%statistics%corrected_error(1)/truth%E
            ! Their mean is that uncertain; the spread of five is within a factor of three of
            ! its own.
            if (unlike == 2) call check('dispute: the error is that of the mean of five beams', &
               spread > 5e-3_wp/sqrt(5.0_wp)/3 .and. spread < 5e-3_wp/sqrt(5.0_wp)*3, &
               to_text(spread))
         end do
      end do
      ! 5 % of 10, and three standard deviations of that.
      call check('dispute: none about one beam', disputed <= 2, to_text(disputed))
      call check('dispute: the interval holds their mean', held >= 8, to_text(held))
   end subroutine test_dispute

   !> Student's factor 12.7 of two records that disagree multiplies their scatter of 1, not the
   !> error of 10 that a fixed parameter causes. With it, the interval is wider than a value of 20;
   !> with an error of 1 it is not.
   subroutine test_widths()
      type(stage_fit_t) :: fit

      fit%free = [of_E]
      allocate (fit%quantities(1), fit%held(1))
      fit%quantities(1)%searched = 20
      fit%statistics%samples = 10
      fit%statistics%corrected_error = [1.0_wp]
      fit%statistics%corrected_half_width = [12.706_wp]
      fit%held(1)%effect = [10.0_wp]
      call check_close('widths: factors of their own', fit%half_width(1), &
         hypot(12.706_wp, 19.59964_wp), 1e-6_wp)
      call check('widths: wider than the value', fit%is_widened(1))
      fit%held(1)%effect = [1.0_wp]
      call check('widths: narrower than the value', .not. fit%is_widened(1))
   end subroutine test_widths

   !> Air damping that has changed halfway is found by windows, and nothing where nothing has.
   subroutine test_windows()
      type(model_t) :: model
      type(experiment_t) :: record, later
      type(structure_t) :: thinner
      type(stage_fit_t), allocatable :: fits(:)
      type(window_fit_t), allocatable :: windows(:)
      type(error_t), allocatable :: error
      type(drift_t) :: drift
      logical :: drifts(4, 2)
      integer :: changes, k, m

      m = 400
      thinner = truth
      thinner%gamma = truth%gamma*3
      do changes = 1, 2
         record = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(m, 0.5_wp, &
            77))
         later = made(thinner, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), record%samples)
         if (changes == 2) record%measured(m/2 + 1:) = later%measured(m/2 + 1:)
         record = noisy(record, gaussian_noise(m, noise_of(record), 78))
         model = model_of(truth, new_free(2), formulas(3))
         call identify(model, mesh, [stage_for(names, 1)], [record], fits, error)
         if (.not. allocated(error)) call fit_windows(model, mesh, [record], fits(1), 4, windows)
         call check('windows: a fit', .not. allocated(error))
         if (allocated(error)) return
         call check('windows: one behind the other', all([(windows(k)%last(1) < &
            windows(k + 1)%first(1), k=1, 3)]) .and. abs(windows(4)%last(1) &
            - record%samples(m)) <= 0)
         call check('windows: each is fitted', .not. any([(allocated(windows(k)%error), k=1, 4)]))
         call find_drifts([record], 4, fits(1), drift, windows)
         drifts(:, changes) = drift%is_significant
         call check('windows: a probability for each parameter', all(drift%scatter%probability &
            >= 0 .and. drift%scatter%probability <= 1) .and. size(drift%scatter) == 4)
         call check('windows: what drifts widens its interval', all((fits(1)%drift > 0) .eqv. &
            drift%is_significant))
      end do
      call check('windows: nothing changes', .not. any(drifts(:, 1)))
      call check('windows: gamma has changed', drifts(4, 2) .and. drift%scatter(4)%probability &
         < 1e-6_wp, to_text(drift%scatter(4)%probability))
      call fit_windows(model, mesh, [record], fits(1), 50, windows)
      call check('windows: too short for so many unknowns', all([(allocated(windows(k)%error), &
         k=1, 50)]))
   end subroutine test_windows

   !> Records of 16 elements, fits on few: the interval with every source of error holds the truth,
   !> or the mesh is named.
   subroutine test_mesh()
      type(model_t) :: model
      type(experiment_t) :: record
      type(mesh_t) :: coarse, automatic
      type(stage_fit_t), allocatable :: fits(:), refined(:, :)
      type(error_t), allocatable :: error
      integer :: n, k, records, held, warned, silent

      records = merge(100, 6, in_long_run())
      model = model_of(truth, new_free(2), formulas(3))
      do n = 2, 5
         coarse = mesh_t(3, merge(16, n, n == 5), 4, 1)
         held = 0
         warned = 0
         silent = 0
         do k = 1, records
            record = decay_of_fine(200, 700 + k)
            call identify(model, coarse, [stage_for(names, 1)], [record], fits, error)
            if (allocated(error)) cycle
            call add_mesh_shift(model, coarse, [record], fits(1))
            if (.not. allocated(fits(1)%mesh_shift)) cycle
            if (fits(1)%shifted()) warned = warned + 1
            if (inside(fits(1), 1, truth%E)) held = held + 1
            if (.not. (fits(1)%shifted() .or. inside(fits(1), 1, truth%E))) silent = silent + 1
         end do
         if (n < 5) then
            call check('mesh of '//to_text(n)//': named in every record', warned == records, &
               to_text(warned)//' of '//to_text(records)//', E inside in '//to_text(held))
         else
            call check('mesh of 16: not named', warned <= 0.05_wp*records + 1, to_text(warned))
         end if
         call check('mesh of '//to_text(coarse%elements)//': never wrong and silent', &
            silent <= 0.1_wp*records, to_text(silent))
      end do
      automatic = coarse
      call identify_refining(model, automatic, [stage_for(names, 1)], [record], refined, error)
      call check('refined until the mesh does not show', .not. allocated(error))
      if (allocated(error)) return
      call check('refined until the mesh does not show: N', .not. refined(1, 1)%shifted() .and. &
         any(automatic%elements == [8, 16, 32]), to_text(automatic%elements))
   end subroutine test_mesh

   !> A record of the strip on 16 elements.
   function decay_of_fine(m, seed) result(experiment)
      integer, intent(in) :: m, seed
      type(experiment_t) :: experiment
      type(simulation_t) :: clean
      type(error_t), allocatable :: error

      experiment%samples = stamps(m, 0.5_wp, seed)
      call simulate(model_of(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3)), &
         mesh_t(3, 16, 4, 1), experiment%samples, clean, error)
      experiment%excitation = new_free(2)
      experiment%measured = clean%acceleration + gaussian_noise(m, 0.01_wp*norm2( &
         clean%acceleration)/sqrt(real(m, wp)), seed)
   end function decay_of_fine

   !> Whether the interval with every source of error holds a value.
   logical function inside(fit, k, value)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      real(wp), intent(in) :: value
      real(wp) :: ends(2)

      ends = fit%quantities(k)%ends(fit%total(k))
      inside = ends(1) <= value .and. value <= ends(2)
   end function inside

   !> Length, thickness and place of the sensor are other than the case has them, by errors that it
   !> states: the intervals hold E and m_S as often as they say.
   subroutine test_coverage()
      type(model_t) :: model
      type(structure_t) :: real_one
      type(experiment_t) :: record
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: errors(3), share, slack
      integer :: held(2), k, records

      records = merge(300, 60, in_long_run())
      held = 0
      do k = 1, records
         errors = gaussian_noise(3, 1.0_wp, 900 + k)*[1e-3_wp, 0.01_wp, 2e-3_wp]
         real_one = truth
         real_one%length = truth%length + errors(1)
         real_one%I = truth%I*(1 + errors(2))**3
         real_one%rho = truth%rho*(1 + errors(2))
         real_one%sensor(1)%x_S = truth%sensor(1)%x_S + errors(3)
         record = made_of(real_one, 1300 + k)
         model = model_of(truth, new_free(2), formulas(3))
         model%priors = [prior(of_length, 1e-3_wp), of_height(truth, 2e-5_wp), &
            prior(of_x_S, 2e-3_wp)]
         call identify(model, mesh, [stage_for(names, 1)], [record], fits, error)
         if (allocated(error)) cycle
         if (inside(fits(1), 1, truth%E)) held(1) = held(1) + 1
         if (inside(fits(1), 2, truth%sensor(1)%m_S)) held(2) = held(2) + 1
      end do
      do k = 1, 2
         share = held(k)/real(records, wp)
         ! Three standard deviations of so many draws.
         slack = 3*sqrt(0.95_wp*0.05_wp/records)
         call check('coverage: '//trim(names(k)), abs(share - 0.95_wp) <= slack, &
            to_text(held(k))//' of '//to_text(records))
      end do
   end subroutine test_coverage

   !> A noisy record of another structure than the case has.
   function made_of(structure, seed) result(experiment)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: seed
      type(experiment_t) :: experiment

      experiment = made(structure, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, seed))
      experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), seed))
   end function made_of

end program test_error_sources
