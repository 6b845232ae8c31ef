!> Mistakes of a Fortran program: `simulate` and `identify` return an error that names them.
program test_model_checks
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use beamid, only: case_fit_t, case_t, error_t, excitation_t, experiment_t, free_index, &
      identify, load_case, mesh_t, modal_t, model_t, needs_fit, new_pulse, read_case, sensor_t, &
      simulate, simulation_t, stage_fit_t, stage_t, structure_t, wp
   use beamid_beam_values, only: E_at, n_parameters
   use checks, only: check, finish
   implicit none
   type(model_t) :: model
   type(simulation_t) :: simulation
   type(stage_fit_t), allocatable :: fits(:)
   type(error_t), allocatable :: error
   real(wp) :: t(60)
   real(wp), allocatable :: a(:)
   integer :: k

   t = [(0.01_wp*k, k=1, size(t))]
   model%structure = structure_t(length=0.5_wp, rho=0.47_wp, E=2.05e11_wp, &
      I=0.03_wp*0.002_wp**3/12, c_D=1e6_wp, sensor=sensor_t(m_S=0.01_wp, x_S=0.45_wp))
   model%excitation = new_pulse(1.0_wp, 0.01_wp)
   model%solver = modal_t()
   call simulate(model, mesh_t(elements=8), t, simulation, error)
   call check('the right model is simulated', .not. allocated(error))
   a = simulation%acceleration
   call try_fit('the right model', model, t, a, [free_index('E'), free_index('c_D')], '')

   call test_models()
   call test_cases()
   call try_fit('an unknown name', model, t, a, [free_index('mS')], 'free_index')
   call try_fit('no free parameter', model, t, a, [integer ::], 'no free parameter')
   call try_fit('E twice', model, t, a, [free_index('E'), free_index('E')], 'E twice')
   call try_fit('more samples than times', model, t(:59), a, [free_index('E')], &
      '59 times (samples) and 60 values')
   call try_fit('two times exchanged', model, [t(:30), t(32), t(31), t(33:)], a, &
      [free_index('E')], 'time 0.31 of sample 32, not after')
   call try_fit('a sample that is no number', model, t, [a(:8), ieee_value(t(1), &
      ieee_quiet_nan), a(10:)], [free_index('E')], 'in sample 9')
   call try_fit('two starts of one parameter', model, t, a, [free_index('E')], &
      'found 2 values in start', start=[2e11_wp, 1.0_wp])
   call try_fit('the third of one sensor', model, t, a, [free_index('E')], 'found sensor 3', &
      sensor=3)
   t(7) = ieee_value(t(7), ieee_quiet_nan)
   call try_fit('a time that is no number', model, t, a, [free_index('E')], 'time of sample 7')
   call finish('model_checks')

contains

   !> Models that both procedures refuse.
   subroutine test_models()
      type(model_t) :: wrong

      wrong = model
      deallocate (wrong%solver)
      call try('no solver', wrong, 'without a solver')
      wrong = model
      wrong%excitation = excitation_t()
      call try('no excitation', wrong, 'without times')
      wrong = model
      wrong%structure%sensor(1)%x_S = 0.7_wp
      call try('a sensor behind the tip', wrong, 'x_S: found 0.7')
      wrong = model
      wrong%excitation%x_F = 0.7_wp
      call try('a force behind the tip', wrong, 'x_F: found 0.7')
      wrong = model
      wrong%structure%rho = -1
      call try('a negative mass', wrong, 'rho: found -1')
      wrong = model
      call wrong%structure%set(free_index('mS'), 0.006_wp)
      call check('an unknown name changes no value', all(abs(values_of(wrong%structure) &
         - values_of(model%structure)) <= 0))
      call try('a value of an unknown name', wrong, 'a call of set with a number')
      wrong = model
      call wrong%structure%set(free_index('amplitude'), 3.0_wp)
      call check('the amplitude is no mass of the tip', abs(wrong%structure%m_T) <= 0)
      call try('an amplitude of the structure', wrong, 'a call of set with a number')
      wrong = model
      call wrong%structure%set(E_at(1), 2e11_wp)
      call try('a coefficient of E(x) without E(x)', wrong, 'a call of set with a number')
      call check('the value of an unknown name is NaN', &
         ieee_is_nan(model%structure%get(free_index('mS'))))
      wrong = model
      call wrong%structure%set(free_index('m_S'), 0.006_wp)
      call simulate(wrong, mesh_t(elements=8), t, simulation, error)
      call check('a value of a name is simulated', .not. allocated(error))
      wrong = model
      call simulate(wrong, mesh_t(elements=8), t(size(t):1:-1), simulation, error)
      call expect('descending times are simulated', 'expected times that increase')
   end subroutine test_models

   !> A program that changes a case between `read_case` and `load_case`.
   subroutine test_cases()
      character(len=*), parameter :: path = 'data/bench_fit.nml'
      type(case_t) :: case
      type(case_fit_t) :: right, wrong, unknown

      call read_case(path, needs_fit, case, error)
      if (.not. allocated(error)) call load_case(case, right, error)
      call check('a case is loaded', .not. allocated(error))
      call case%model%structure%set(free_index('mS'), 0.006_wp)
      call load_case(case, wrong, error)
      call expect('a case with a value of an unknown name', 'a call of set with a number')
      call read_case(path, needs_fit, case, error)
      case%stages(1)%free(1) = free_index('mS')
      call load_case(case, unknown, error)
      call expect('a case with an unknown free parameter', 'free_index')
   end subroutine test_cases

   !> Returns the values of all parameters of a structure.
   function values_of(structure) result(values)
      type(structure_t), intent(in) :: structure
      real(wp) :: values(n_parameters)
      integer :: p

      values = [(structure%get(p), p=1, n_parameters)]
   end function values_of

   !> Simulates and fits a wrong model.
   subroutine try(what, wrong, message)
      character(len=*), intent(in) :: what, message
      type(model_t), intent(in) :: wrong

      call simulate(wrong, mesh_t(elements=8), t, simulation, error)
      call expect(what//' is simulated', message)
      call try_fit(what, wrong, t, a, [free_index('E')], message)
   end subroutine try

   !> Fits a record; a part of the error's message, or '' where the fit is right.
   subroutine try_fit(what, wrong, times, measured, free, message, start, sensor)
      character(len=*), intent(in) :: what, message
      type(model_t), intent(in) :: wrong
      real(wp), intent(in) :: times(:), measured(:)
      integer, intent(in) :: free(:)
      real(wp), intent(in), optional :: start(:)
      integer, intent(in), optional :: sensor
      type(experiment_t) :: one(1)
      type(stage_t) :: stage

      one(1)%samples = times
      one(1)%measured = measured
      one(1)%excitation = wrong%excitation
      stage%free = free
      if (present(start)) stage%start = start
      if (present(sensor)) one(1)%sensor = sensor
      call identify(wrong, mesh_t(elements=8), [stage], one, fits, error)
      call expect(what//' is fitted', message)
   end subroutine try_fit

   !> The last call has an error with this text, or none where the text is empty.
   subroutine expect(what, message)
      character(len=*), intent(in) :: what, message

      if (message == '') then
         call check(what, .not. allocated(error))
      else if (allocated(error)) then
         call check(what//': refused', index(error%message, message) > 0, error%message)
      else
         call check(what//': refused', .false.)
      end if
   end subroutine expect

end program test_model_checks
