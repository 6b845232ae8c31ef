!> Several channels of one motion: sensors on one beam whose free decay starts anyhow.
program test_channels
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_parameters, only: free_index, offset
   use beamid_strings, only: to_text
   use beamid_structure, only: m_S_at, sensor_t, structure_t, x_S_at
   use beamid_variables, only: unbounded
   use checks, only: check, check_close, finish
   use free_decays, only: formulas, made, mesh, noise_of, noisy, stamps, truth
   use models, only: model_of
   implicit none

   integer, parameter :: samples(2) = [200, 150]
   type(structure_t) :: beam

   beam = truth
   beam%sensors = 2
   beam%sensor_name(:2) = ['tip ', 'root']
   beam%sensor(2) = sensor_t(m_S=0.006_wp, x_S=0.2_wp)
   call test_one_motion()
   call test_information()
   call test_start()
   call finish('channels')

contains

   !> Both channels of a release, the second on stamps of its own that begin later.
   function channels(seed, motions) result(two)
      integer, intent(in) :: seed, motions(2)
      type(experiment_t) :: two(2)
      integer :: k

      do k = 1, 2
         beam%observer = k
         two(k) = made(beam, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(samples(k), &
            0.5_wp + 0.1_wp*(k - 1), 20 + k))
         if (seed > 0) two(k) = noisy(two(k), gaussian_noise(samples(k), noise_of(two(k)), &
            seed + k))
         two(k)%sensor = k
         two(k)%motion = motions(k)
      end do
      beam%observer = 1
   end function channels

   !> E, both masses and the damping, with the offsets.
   function stage() result(all_of_it)
      type(stage_t) :: all_of_it

      all_of_it%free = [free_index('E'), m_S_at(1), free_index('c_D'), free_index('gamma')]
      all_of_it%start = [truth%E*1.002_wp, truth%sensor(1)%m_S*0.95_wp, truth%c_D*1.3_wp, &
         truth%gamma*0.7_wp]
      all_of_it%lower = spread(0.0_wp, 1, 4)
      all_of_it%upper = spread(unbounded, 1, 4)
      all_of_it%offset = .true.
   end function stage

   !> Without noise both channels fit to what the modes leave that are not fitted, 1e-5 of the
   !> record; with another place of the second sensor they do not, which two motions of their own
   !> would not see.
   subroutine test_one_motion()
      type(model_t) :: model
      type(experiment_t) :: two(2)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: share

      two = channels(0, [7, 7])
      model = model_of(beam, new_free(2), formulas(3))
      call identify(model, mesh, [stage()], two, fits, error)
      call check('one motion: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      associate (q => fits(1)%quantities)
         call check('one motion: 4 parameters, 2 modes, 2 offsets', size(q) == 10 .and. &
            count(q%name(:3) == 'cos') == 2 .and. count(q%parameter == offset) == 2, &
            to_text(size(q)))
         call check_close('one motion: E', q(1)%value/truth%E, 1.0_wp, 1e-5_wp)
         call check_close('one motion: m_S', q(2)%value/truth%sensor(1)%m_S, 1.0_wp, 1e-3_wp)
      end associate
      share = maxval(abs(fits(1)%residual))/maxval(abs(two(1)%measured))
      call check('one motion: nothing is left', share < 1e-3_wp, to_text(share))
      call check('one motion: exact derivatives', maxval(fits(1)%fit%derivative_check) < 1e-5_wp, &
         to_text(maxval(fits(1)%fit%derivative_check)))
      call model%structure%set(x_S_at(2), 0.25_wp)
      ! Of noise that is estimated the other channel would be given all that does not fit.
      two(1)%sd = 1
      two(2)%sd = 1
      call identify(model, mesh, [stage()], two, fits, error)
      if (allocated(error)) return
      share = sqrt(sum(fits(1)%residual(201:)**2)/sum((two(2)%measured &
         - sum(two(2)%measured)/150)**2))
      call check('one motion: another place is noticed', share > 0.05_wp, to_text(share))
   end subroutine test_one_motion

   !> What the channels have in common tells more than two motions do: of the amplitudes, and so of
   !> the place of a sensor, which these say nothing of.
   subroutine test_information()
      type(model_t) :: model
      type(stage_t) :: placed
      type(experiment_t) :: two(2)
      type(stage_fit_t), allocatable :: together(:), apart(:)
      type(error_t), allocatable :: error
      real(wp) :: ratio

      model = model_of(beam, new_free(2), formulas(3))
      placed = stage()
      placed%free(4) = x_S_at(2)
      placed%start(4) = 0.21_wp
      two = channels(50, [1, 1])
      call identify(model, mesh, [placed], two, together, error)
      if (.not. allocated(error)) then
         two%motion = 0
         call identify(model, mesh, [placed], two, apart, error)
      end if
      call check('information: both converge', .not. allocated(error))
      if (allocated(error)) return
      associate (s => together(1)%statistics, q => together(1)%quantities)
         call check('information: x_S', abs(q(4)%value - 0.2_wp) < 4*s%std_error(4), &
            to_text(q(4)%value))
         ratio = apart(1)%statistics%std_error(4)/s%std_error(4)
         call check('information: x_S by the amplitudes', ratio > 5, to_text(ratio))
         ratio = s%std_error(1)/apart(1)%statistics%std_error(1)
         call check('information: E no worse', ratio < 1.02_wp, to_text(ratio))
      end associate
   end subroutine test_information

   !> Start values are found from channels as from records.
   subroutine test_start()
      type(model_t) :: model
      type(stage_t) :: automatic
      type(experiment_t) :: two(2)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      model = model_of(beam, new_free(2), formulas(3))
      model%structure%E = 1.15_wp*truth%E
      automatic = stage()
      deallocate (automatic%start)
      automatic%automatic = .true.
      two = channels(60, [3, 3])
      call identify(model, mesh, [automatic], two, fits, error)
      call check('start: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      call check('start: E', abs(fits(1)%quantities(1)%value - truth%E) < 5*fits(1)%statistics% &
         std_error(1), to_text(fits(1)%quantities(1)%value))
   end subroutine test_start

end program test_channels
