!> Mistakes of a Fortran program: `simulate` and `identify` return an error that names them.
program test_model_checks
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid, only: error_t, excitation_t, experiment_t, free_index, identify, mesh_t, modal_t, &
      model_t, new_pulse, sensor_t, simulate, simulation_t, stage_fit_t, stage_t, structure_t, wp
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
      call simulate(wrong, mesh_t(elements=8), t(size(t):1:-1), simulation, error)
      call expect('descending times are simulated', 'expected times that increase')
   end subroutine test_models

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
