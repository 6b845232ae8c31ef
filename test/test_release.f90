!> The release of a tip that was held aside: against a force that is taken away, against CVODE,
!> by force and by displacement, and with the amplitude free.
program test_release
   use beamid_cases, only: case_t, needs_fit, needs_response, read_case
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_release
   use beamid_experiments, only: prepared_experiment_t, experiment_t, prepare_experiment
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_observed_data, only: seen_modes_t
   use beamid_parameter_names, only: is_there
   use beamid_parameters, only: amplitude, free_index, free_names, get_free, set_free
   use beamid_responses, only: response_t, solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, end_t, free_end, at_tip, of_length, of_x_S, sensor_t, &
      structure_t
   use beamid_variables, only: unbounded
   use checks, only: check, check_close, finish, skip
   use shell, only: close_shell, in_scratch, open_shell, write_file
   implicit none

   !> A strip in a clamp, a sensor on it; the same with a clamp that gives way, a block at the tip
   !> and a hose.
   type(structure_t), parameter :: strip = structure_t(length=0.5_wp, rho=0.27_wp, E=6.4e10_wp, &
      I=0.05_wp*0.002_wp**3/12, c_D=6e6_wp, gamma=0.07_wp, &
      sensor=sensor_t(m_S=0.004_wp, x_S=0.44_wp))
   type(structure_t), parameter :: loaded = structure_t(length=0.5_wp, rho=0.27_wp, E=6.4e10_wp, &
      I=0.05_wp*0.002_wp**3/12, c_D=6e6_wp, m_T=0.02_wp, hose=hose_t(m_H=0.01_wp, &
      c_H=0.02_wp, k_H=3.0_wp), &
      gamma=0.07_wp, J_T=2e-5_wp, end=[end_t(kappa_R=1/60.0_wp), free_end], &
      sensor=sensor_t(m_S=0.004_wp, x_S=0.3_wp))
   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   type(observation_t), parameter :: by_equation = observation_t(3, 0.0_wp)
   integer :: k
   !> A window around most of the releases below; no sample hits one.
   real(wp), parameter :: times(60) = [(0.05_wp + 0.0137_wp*k, k=1, 60)]

   call test_stiffness()
   call test_force_taken_away()
   call test_settling('strip', strip)
   call test_settling('loaded', loaded)
   call test_two_ways('strip', strip)
   call test_two_ways('loaded', loaded)
   call test_time_of_release()
   call test_cvode('strip', strip)
   call test_cvode('loaded', loaded)
   call test_formulas()
   call test_derivatives('strip', strip)
   call test_derivatives('loaded', loaded)
   call test_amplitude_free(.true.)
   call test_amplitude_free(.false.)
   call test_case_files()
   call finish('release')

contains

   !> A response, or zeros and a failed check.
   function respond(structure, excitation, t, solver, formula) result(simulation)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: t(:)
      class(solver_t), intent(in), optional :: solver
      type(observation_t), intent(in), optional :: formula
      type(simulation_t) :: simulation
      type(model_t) :: model
      type(error_t), allocatable :: error

      model%structure = structure
      model%excitation = excitation
      if (present(formula)) model%observation = formula
      if (present(solver)) then
         allocate (model%solver, source=solver)
      else
         allocate (modal_t :: model%solver)
      end if
      call simulate(model, mesh, t, simulation, error)
      if (.not. allocated(error)) return
      call check('a response', .false., error%message)
      simulation%acceleration = 0*t
      simulation%response = response_t(t, 0*t, 0*t, 0*t)
   end function respond

   pure real(wp) function distance(a, b)
      real(wp), intent(in) :: a(:), b(:)

      distance = norm2(a - b)/norm2(b)
   end function distance

   !> Stiffness of the tip by hand: a cantilever's deflection l**3/(3 E I) and the turn of the root,
   !> l by l/k_R.
   pure real(wp) function tip_stiffness(structure) result(stiffness)
      type(structure_t), intent(in) :: structure

      associate (s => structure)
         stiffness = s%length**3/(3*s%E*s%I)
         stiffness = stiffness + s%length**2*s%end(1)%kappa_R
         stiffness = 1/stiffness
      end associate
   end function tip_stiffness

   !> Deflection under a unit force at the tip, at the sensor.
   pure real(wp) function deflection(structure)
      type(structure_t), intent(in) :: structure
      real(wp) :: x

      associate (s => structure)
         x = s%length
         if (.not. s%sensor(1)%x_S < 0) x = s%sensor(1)%x_S
         deflection = x**2*(3*s%length - x)/(6*s%E*s%I)
         deflection = deflection + s%length*x*s%end(1)%kappa_R
      end associate
   end function deflection

   subroutine test_stiffness()
      type(excitation_t) :: release
      real(wp) :: force

      release = new_release(0.01_wp, 0.2_wp, .true.)
      call release%fit_to(tip_stiffness(loaded))
      ! Ten operations.
      force = release%force(0.3_wp)
      call check_close('force of a displacement', force/(-0.01_wp*tip_stiffness(loaded)), 1.0_wp, &
         1e-15_wp)
      call check_close('static stiffness, rigid root', strip%stiffness()/tip_stiffness(strip), &
         1.0_wp, 1e-14_wp)
      call check_close('static stiffness, soft root', loaded%stiffness()/tip_stiffness(loaded), &
         1.0_wp, 1e-14_wp)
      call check('the soft root matters', loaded%stiffness() < 0.9_wp*strip%stiffness(), &
         to_text(loaded%stiffness()/strip%stiffness()))
      call check('nothing before the release, the force for ever after', &
         all(abs(release%force([0.0_wp, 0.19999_wp])) <= 0) .and. &
         all(abs(release%force([0.2_wp, 0.3_wp, 1e6_wp]) - force) <= 0))
   end subroutine test_stiffness

   !> A force held until the beam is still, then taken away: before, the static deflection; behind,
   !> the same motion as that of a release. c_D and gamma are such that 20 s are e**-40 or less.
   subroutine test_force_taken_away()
      type(structure_t) :: damped
      type(excitation_t) :: held
      type(error_t), allocatable :: error
      type(simulation_t) :: pulled, released
      real(wp), parameter :: force = 0.3_wp, hold = 20
      real(wp) :: t(80), still

      damped = loaded
      damped%c_D = 3e7_wp
      damped%gamma = 1.0_wp
      damped%hose(1)%c_H = 0.5_wp
      t = [hold - 0.01_wp, hold + [(0.0137_wp*k, k=1, 79)]]
      call new_force_table([0.0_wp, hold], [force, force], held, error)
      pulled = respond(damped, held, t)
      released = respond(damped, new_release(force, hold, .false.), t)
      still = force*deflection(damped)
      ! Splines of degree 3 hold the static shape exactly; round-off of poles and residues, 1e-12 of
      ! the first mode, and its like in the velocity.
      call check_close('held: static deflection of the sensor', pulled%response%displacement(1) &
         /still, 1.0_wp, 1e-9_wp)
      call check_close('held: at rest', pulled%response%velocity(1)/(still*damped%omega()), &
         0.0_wp, 1e-9_wp)
      call check_close('released: displacement', distance(released%response%displacement, &
         pulled%response%displacement), 0.0_wp, 1e-9_wp)
      call check_close('released: velocity', distance(released%response%velocity(2:), &
         pulled%response%velocity(2:)), 0.0_wp, 1e-9_wp)
      call check_close('released: acceleration', distance(released%response%acceleration(2:), &
         pulled%response%acceleration(2:)), 0.0_wp, 1e-9_wp)
   end subroutine test_force_taken_away

   !> Before the release the tip is aside by what was said, and the sensor by its share; in the end
   !> they are back. The motion has no other way to know how far that is than its own stiffness.
   subroutine test_settling(what, structure)
      character(len=*), intent(in) :: what
      type(structure_t), intent(in) :: structure
      type(structure_t) :: damped
      type(simulation_t) :: found
      real(wp), parameter :: aside = 0.02_wp

      damped = structure
      damped%gamma = 1.0_wp
      damped%hose(1)%c_H = 0.5_wp
      found = respond(damped, new_release(aside, 0.1_wp, .true.), [0.05_wp, 40.0_wp])
      ! Twenty operations; poles and residues, as above.
      call check_close(what//': the sensor before', found%response%displacement(1), &
         aside*deflection(structure)*tip_stiffness(structure), 1e-14_wp*aside)
      call check_close(what//': the sensor in the end', found%response%displacement(2), 0.0_wp, &
         1e-9_wp*aside)
      call check_close(what//': the force before', found%force(1), &
         aside*tip_stiffness(structure), 1e-14_wp*found%force(1))
      call check_close(what//': no force in the end', found%force(2), 0.0_wp, 1e-14_wp)
      damped%sensor(1)%x_S = at_tip
      found = respond(damped, new_release(aside, 0.1_wp, .true.), [0.05_wp, 40.0_wp])
      call check_close(what//': the tip before', found%response%displacement(1), aside, &
         1e-14_wp*aside)
      call check_close(what//': the tip in the end', found%response%displacement(2), 0.0_wp, &
         1e-9_wp*aside)
   end subroutine test_settling

   !> By displacement d and by force k d: the same to round-off.
   subroutine test_two_ways(what, structure)
      character(len=*), intent(in) :: what
      type(structure_t), intent(in) :: structure
      type(simulation_t) :: d, f

      d = respond(structure, new_release(0.02_wp, 0.3_wp, .true.), times)
      f = respond(structure, new_release(0.02_wp*tip_stiffness(structure), 0.3_wp, .false.), times)
      call check_close(what//': by displacement and by force', distance(d%acceleration, &
         f%acceleration), 0.0_wp, 1e-14_wp)
      call check('at rest before, in motion behind', all(abs(d%acceleration(:18)) <= 0) .and. &
         all(abs(d%acceleration(19:)) > 0) .and. times(18) < 0.3_wp .and. times(19) > 0.3_wp)
   end subroutine test_two_ways

   !> Only the time since the release counts; a sample at the release sees the motion begin.
   subroutine test_time_of_release()
      type(simulation_t) :: at_0, other, wide
      real(wp), parameter :: moments(4) = [-3.0_wp, 0.01_wp, 0.2963_wp, 0.5_wp]
      real(wp) :: moment, held
      integer :: i, first

      held = 0.02_wp*tip_stiffness(strip)*deflection(strip)
      do i = 1, size(moments)
         moment = moments(i)
         other = respond(strip, new_release(0.02_wp, moment, .true.), times)
         first = findloc(times > moment, .true., dim=1)
         at_0 = respond(strip, new_release(0.02_wp, 0.0_wp, .true.), times(first:) - moment)
         ! Times of 3 s are rounded to 4e-16, 1e-12 of the phase of the highest mode that counts.
         call check_close('released at '//to_text(moment), distance(other%acceleration(first:), &
            at_0%acceleration), 0.0_wp, 1e-11_wp)
         call check('nothing before '//to_text(moment), all(abs(other%acceleration(:first - 1)) &
            <= 0) .and. all(abs(other%response%displacement(:first - 1) - held) <= 1e-16_wp), &
            to_text(first - 1)//' samples')
      end do
      ! The same samples among others.
      other = respond(strip, new_release(0.02_wp, 0.2_wp, .true.), times)
      first = findloc(times > 0.2_wp, .true., dim=1)
      wide = respond(strip, new_release(0.02_wp, 0.2_wp, .true.), [-1.0_wp, 0.0_wp, &
         times(:first - 1), 0.2_wp, times(first:)])
      call check_close('a sample at the release changes no other', &
         distance(wide%acceleration(first + 3:), other%acceleration(first:)), 0.0_wp, 1e-12_wp)
      wide = respond(strip, new_release(0.02_wp, 0.2_wp, .true.), [0.2_wp, 0.2_wp + 1e-9_wp])
      call check('no displacement at the release', all(abs(wide%response%displacement - held) &
         < 1e-15_wp))
      call check_close('but acceleration at once', wide%acceleration(1)/wide%acceleration(2), &
         1.0_wp, 1e-4_wp)
   end subroutine test_time_of_release

   !> CVODE at rtol 1e-11 is to reach 1e-6 of the acceleration: some 10**4 steps, and what the high
   !> modes, which it follows least, add to it at first. A release before the first sample, between
   !> two, at one.
   subroutine test_cvode(what, structure)
      character(len=*), intent(in) :: what
      type(structure_t), intent(in) :: structure
      real(wp), parameter :: moments(3) = [-0.2_wp, 0.2963_wp, 0.05_wp + 0.0137_wp*20]
      type(simulation_t) :: exact, integrated
      type(cvode_t) :: solver
      type(excitation_t) :: release
      integer :: i

      solver%rtol = 1e-11_wp
      do i = 1, size(moments)
         release = new_release(0.02_wp, moments(i), i /= 2)
         exact = respond(structure, release, times)
         integrated = respond(structure, release, times, solver)
         call check_close(what//', released at '//to_text(moments(i))//': acceleration by CVODE', &
            distance(integrated%acceleration, exact%acceleration), 0.0_wp, 1e-6_wp)
         call check_close(what//', released at '//to_text(moments(i))//': displacement by CVODE', &
            distance(integrated%response%displacement, exact%response%displacement), 0.0_wp, &
            1e-6_wp)
      end do
   end subroutine test_cvode

   !> The differences (4.1) and (4.2), across the release and behind it, from the motion itself.
   subroutine test_formulas()
      type(simulation_t) :: seen, before, at, behind
      type(excitation_t) :: release
      real(wp), parameter :: delta = 0.02_wp

      release = new_release(0.02_wp, 0.3_wp, .true.)
      at = respond(strip, release, times)
      before = respond(strip, release, times - delta)
      behind = respond(strip, release, times + delta)
      seen = respond(strip, release, times, formula=observation_t(1, delta))
      ! 1e-16 of u by Delta**2, of accelerations u omega**2: 1e-16/(38*.02)**2.
      call check_close('displacement_difference', distance(seen%acceleration, &
         (behind%response%displacement - 2*at%response%displacement &
         + before%response%displacement)/delta**2), 0.0_wp, 1e-11_wp)
      before = respond(strip, release, times - delta/2)
      behind = respond(strip, release, times + delta/2)
      seen = respond(strip, release, times, formula=observation_t(2, delta))
      call check_close('velocity_difference', distance(seen%acceleration, &
         (behind%response%velocity - before%response%velocity)/delta), 0.0_wp, 1e-11_wp)
      call check('the differences see the release early', abs(seen%acceleration(18)) > 0)
   end subroutine test_formulas

   !> Derivatives with respect to every parameter and the amplitude, by force and by displacement,
   !> against five-point differences of 3e-4: truncation h**4 = 8e-15 times the fourth power of the
   !> phases, up to 100, over 30; round-off 3e-13 of the response where a parameter hardly matters.
   subroutine test_derivatives(what, structure)
      character(len=*), intent(in) :: what
      type(structure_t), intent(in) :: structure
      real(wp), parameter :: weights(4) = [1, -8, 8, -1]/12.0_wp
      integer, parameter :: steps(4) = [-2, -1, 1, 2]
      type(prepared_experiment_t) :: prepared
      type(experiment_t) :: experiment
      type(excitation_t) :: excitation, moved_excitation
      type(structure_t) :: moved
      type(error_t), allocatable :: error
      type(linear_t) :: linear
      type(seen_modes_t) :: alone
      real(wp), allocatable :: exact(:, :)
      real(wp) :: y(size(times)), difference(size(times)), none(size(times), 0), value, h
      type(work_t) :: work
      integer, allocatable :: places(:)
      character(len=12) :: way
      integer :: kind, p, j

      places = pack([(p, p=1, amplitude)], [(matters(structure, p), p=1, amplitude)])
      allocate (exact(size(times), size(places)))
      experiment%samples = times
      experiment%measured = 0*times
      do kind = 1, 2
         way = merge('force       ', 'displacement', kind == 1)
         excitation = new_release(0.02_wp, 0.1_wp, kind == 2)
         experiment%excitation = excitation
         call prepare_experiment(experiment, structure, mesh, by_equation, modal_t(), prepared, &
            error)
         call prepared%evaluate(structure, excitation, .false., places, y, exact, linear, work, &
            error, alone)
         call check(what//', by '//trim(way)//': derivatives', .not. allocated(error))
         if (allocated(error)) return
         do p = 1, size(places)
            value = get_free(structure, excitation, places(p))
            ! Frequencies go with l**-2, with the roots of the others at most.
            h = merge(7.5e-5_wp, 3e-4_wp, places(p) == of_length)*value
            difference = 0
            do j = 1, 4
               moved = structure
               moved_excitation = excitation
               call set_free(moved, moved_excitation, places(p), value + steps(j)*h)
               call prepared%evaluate(moved, moved_excitation, .false., [integer ::], y, none, &
                  linear, work, error, alone)
               if (allocated(error)) y = huge(1.0_wp)
               difference = difference + weights(j)/h*y
            end do
            call check_close(what//', by '//trim(way)//': d/d '//trim(free_names(places(p))), &
               distance(exact(:, p), difference), 0.0_wp, 1e-7_wp)
         end do
      end do
   end subroutine test_derivatives

   !> Whether a structure has what a parameter belongs to.
   pure logical function matters(structure, p)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: p

      matters = p == amplitude
      if (p <= of_x_S) matters = is_there(structure, p) .and. structure%get(p) > 0
   end function matters

   !> The amplitude among the free parameters, with E and k_R, which act on the force of a
   !> displacement; without noise the truth comes back, with noise within four standard errors.
   subroutine test_amplitude_free(by_displacement)
      logical, intent(in) :: by_displacement
      type(model_t) :: model
      type(stage_t) :: stage
      type(simulation_t) :: clean
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      character(len=12) :: way
      real(wp) :: truth(3), searched(3), aside, sd

      way = merge('displacement', 'force       ', by_displacement)
      aside = merge(0.02_wp, 0.3_wp, by_displacement)
      model%structure = loaded
      model%excitation = new_release(aside, 0.1_wp, by_displacement)
      allocate (modal_t :: model%solver)
      truth = [loaded%E, 1/loaded%end(1)%kappa_R, aside]
      searched = [loaded%E, loaded%end(1)%kappa_R, aside]
      clean = respond(loaded, model%excitation, times)
      stage%free = [free_index('E'), free_index('k_R'), free_index('amplitude')]
      stage%start = truth*[1.01_wp, 0.95_wp, -0.5_wp]
      stage%lower = [0.0_wp, 0.0_wp, -unbounded]
      stage%upper = spread(unbounded, 1, 3)
      call identify(model, mesh, [stage], times, clean%acceleration, fits, error)
      call check('amplitude free, '//trim(way)//': the fit converges', .not. allocated(error))
      if (allocated(error)) return
      ! Where a search ends on a J of nothing: the last step is 1e-10 of the parameters.
      call check_close('amplitude free, '//trim(way)//': E, k_R and amplitude', &
         maxval(abs(fits(1)%quantities%value/truth - 1)), 0.0_wp, 1e-8_wp)
      call check('amplitude free, '//trim(way)//': exact derivatives', &
         maxval(fits(1)%fit%derivative_check) < 1e-6_wp .and. &
         minval(fits(1)%fit%derivative_check) >= 0, to_text(maxval(fits(1)%fit%derivative_check)))
      sd = 0.01_wp*norm2(clean%acceleration)/sqrt(real(size(times), wp))
      call identify(model, mesh, [stage], times, clean%acceleration + gaussian_noise(size(times), &
         sd, 17), fits, error)
      call check('amplitude free, '//trim(way)//', with noise: the fit converges', &
         .not. allocated(error))
      if (allocated(error)) return
      call check('amplitude free, '//trim(way)//', with noise: within four standard errors', &
         all(abs(fits(1)%fit%estimate - searched) < 4*fits(1)%statistics%std_error), &
         to_text(maxval(abs(fits(1)%fit%estimate - searched)/fits(1)%statistics%std_error)))
      call check_close('amplitude free, '//trim(way)//', with noise: sd', &
         sqrt(fits(1)%statistics%variance)/sd, 1.0_wp, 4/sqrt(2.0_wp*(size(times) - 3)))
   end subroutine test_amplitude_free

   !> Releases as a case file has them.
   subroutine test_case_files()
      character(len=:), allocatable :: reason

      call open_shell(reason)
      if (reason /= '') then
         call skip('releases in case files', reason)
         return
      end if
      call write_file('force.csv', 't,f'//new_line('a')//'0,1'//new_line('a')//'0.05,2'// &
         new_line('a'))
      call test_one_record()
      call test_tables_behind('kind=''free'', modes=3')
      call test_tables_behind('kind=''release'', displacement=0.02')
      call close_shell()
   end subroutine test_case_files

   !> A response is that of the beam as its record has it.
   subroutine test_one_record()
      type(case_t) :: case
      type(error_t), allocatable :: error

      call write_file('case.nml', '&beam length=0.5, rho=0.27, E=6.4e10, I=4e-11 / '// &
         '&excitation kind=''release'', displacement=0.02, time=0.1 / '// &
         '&record t_first=0, t_last=1, t_step=0.01, length=0.4, x_S=0.3 /'//new_line('a'))
      call read_case(in_scratch('case.nml'), needs_response, case, error)
      call check('a release with a length of its own', .not. allocated(error))
      if (allocated(error)) return
      associate (s => case%model%structure)
         call check_close('length of the record', s%length, 0.4_wp, 0.0_wp)
         call check_close('sensor of the record', s%sensor(1)%x_S, 0.3_wp, 0.0_wp)
      end associate
   end subroutine test_one_record

   !> What one record's excitation is does not rub off on a force table for the next.
   subroutine test_tables_behind(first)
      character(len=*), intent(in) :: first
      type(case_t) :: case
      type(error_t), allocatable :: error

      call write_file('case.nml', '&beam length=0.5, rho=0.27, E=6.4e10, I=4e-11 / '// &
         '&excitation '//first//' / &excitation kind=''table'', file=''force.csv'' / '// &
         '&record file=''a.csv'' / &record file=''b.csv'' / &stage free=''E'' /'//new_line('a'))
      call read_case(in_scratch('case.nml'), needs_fit, case, error)
      call check('a table behind '//first, .not. allocated(error))
      if (allocated(error)) return
      associate (table => case%excitations(2))
         call table%fit_to(120.0_wp)
         call check('the table is a table', table%modes == 0 .and. .not. table%is_release .and. &
            .not. table%by_displacement)
         call check_close('with its own force', table%force(0.05_wp), 2.0_wp, 0.0_wp)
      end associate
   end subroutine test_tables_behind

end program test_release
