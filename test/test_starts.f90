!> Start values from a spectrum, several starts, intervals of modes.
program test_starts
   use beamid_cases, only: case_t, load_experiments, needs_fit, read_case
   use beamid_decaying_lines, only: find_lines
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_multistart, only: identify_from_many, minimum_t, multistart_t
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_observation, only: observation_t
   use beamid_records, only: note_length
   use beamid_spectra, only: line_t, strongest_peak
   use beamid_strings, only: to_text
   use beamid_structure, only: sensor_t, structure_t
   use beamid_unknowns, only: stage_t
   use checks, only: check, check_close, finish
   use models, only: model_of, stage_of
   implicit none

   !> An aluminium strip of half a metre with a sensor of 5 g near its tip, SI.
   type(structure_t), parameter :: strip = structure_t(length=0.5_wp, rho=0.27_wp, E=6.5e10_wp, &
                                   I=0.05_wp*0.002_wp**3/12, c_D=3e6_wp, gamma=0.07_wp, &
                                   sensor=sensor_t(m_S=0.005_wp, x_S=0.44_wp))
   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

   call test_lines()
   call test_automatic()
   call test_no_period()
   call test_wrong_units()
   call test_minima()
   call test_intervals_of_modes()
   call finish('starts')

contains

   !> Lines on uneven stamps, each with its decay, a multiple of the strongest, mains, and noise:
   !> frequencies far below the width of a line, 1/T.
   subroutine test_lines()
      integer, parameter :: m = 3000
      type(line_t), allocatable :: lines(:)
      real(wp) :: t(m), z(m), frequency, share
      integer :: k

      t = [(k*2e-3_wp, k=1, m)] + 5e-4_wp*uniform_noise(m, 3)
      z = 2*exp(-0.1_wp*t)*sin(two_pi*5.03_wp*t + 0.3_wp) &
         + 0.4_wp*exp(-3*t)*sin(two_pi*31.7_wp*t) + 7 + gaussian_noise(m, 0.02_wp, 5)
      call find_lines(t, z, 70.0_wp, 12, lines)
      call check('two lines, and none in the noise', size(lines) == 2, to_text(size(lines)))
      if (size(lines) /= 2) return
      ! Noise of .02 in 3000 samples: the frequency of a sine of 2 to some 1e-5, of a line that dies
      ! out at 3 per second to 3*.02/.4/sqrt(3000/6)/pi, .002, its decay to .01; four times that.
      call check_close('first frequency', lines(1)%frequency, 5.03_wp, 1e-4_wp)
      call check_close('its decay', lines(1)%decay, 0.1_wp, 1e-3_wp)
      call check_close('second frequency', lines(2)%frequency, 31.7_wp, 1e-2_wp)
      call check_close('its decay', lines(2)%decay, 3.0_wp, 5e-2_wp)
      call check('of nothing', lines(2)%harmonic == 0 .and. .not. lines(2)%mains)
      ! .4**2/6 against 2**2 (1 - exp(-1.2))/.2 is .0019, whatever the phases.
      call check_close('energy of the second', lines(2)%energy, 0.0019_wp, 2e-4_wp)

      z = z + 0.05_wp*sin(two_pi*35.21_wp*t) + 0.03_wp*sin(two_pi*50*t)
      call find_lines(t, z, 70.0_wp, 12, lines)
      call check('four lines', size(lines) == 4, to_text(size(lines)))
      call check('one seven times the first', count(lines%harmonic == 7) == 1)
      call check('one of the mains', count(lines%mains) == 1)

      call strongest_peak(t, z, 70.0_wp, frequency, share)
      ! Steps of a quarter of 1/T.
      call check_close('strongest peak', frequency, 5.03_wp, 0.03_wp)
      call check_close('all of the variance lies below 70', share, 1.0_wp, 0.1_wp)
      call strongest_peak(t, z, 2.0_wp, frequency, share)
      call check('hardly anything of it lies below 2', share < 0.01_wp, to_text(share))
      call find_lines(t(:5), z(:5), 60.0_wp, 4, lines)
      call check('five samples: no line', size(lines) == 0)
      call find_lines(t, z, 1e-6_wp, 4, lines)
      call check('less than a period: no line', size(lines) == 0)
      call strongest_peak(t, z, 1e-6_wp, frequency, share)
      call check('and no share', .not. share > 0)
   end subroutine test_lines

   !> A noisy record of the strip let go, with an offset, seen from a start that nobody knows.
   subroutine record_of_strip(experiment, model, error)
      type(experiment_t), intent(out) :: experiment
      type(model_t), intent(out) :: model
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: m = 2500
      type(simulation_t) :: simulation
      integer :: k

      model = model_of(strip, new_release(0.02_wp, 0.0_wp, .true.), observation_t())
      experiment%samples = [(0.3_wp + k*1e-3_wp, k=1, m)] + 3e-4_wp*uniform_noise(m, 8)
      call simulate(model, mesh_t(elements=8), experiment%samples, simulation, error)
      if (allocated(error)) return
      experiment%measured = simulation%acceleration + 0.4_wp + gaussian_noise(m, 0.1_wp, 21)
      experiment%excitation = new_free(2)
   end subroutine record_of_strip

   !> From values off by a factor of 1.5 in E, 3 in m_S, and more in damping, the automatic start
   !> leads to the minimum that the truth leads to.
   subroutine test_automatic()
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: known(:), found(:)
      type(error_t), allocatable :: error
      character(len=*), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']
      real(wp), parameter :: truth(4) = [6.5e10_wp, 0.005_wp, 3e6_wp, 0.07_wp]
      integer :: k

      call record_of_strip(experiment, model, error)
      call check('record of the strip', .not. allocated(error))
      if (allocated(error)) return
      stage = stage_of(names, truth, .true.)
      call identify(model, mesh_t(elements=8), [stage], [experiment], known, error)
      call check('from the truth', .not. allocated(error))
      if (allocated(error)) return
      deallocate (stage%start)
      stage%automatic = .true.
      model%structure%E = 4.5e10_wp
      model%structure%sensor(1)%m_S = 0.015_wp
      model%structure%c_D = 1e5_wp
      model%structure%gamma = 1
      call identify(model, mesh_t(elements=8), [stage], [experiment], found, error)
      call check('from the spectrum', .not. allocated(error))
      if (allocated(error)) return
      ! Both searches stop where J changes no more in ten digits.
      call check_close('the same J', found(1)%fit%J/known(1)%fit%J, 1.0_wp, 1e-9_wp)
      do k = 1, 4
         call check_close('the same '//trim(names(k)), found(1)%fit%estimate(k) &
            /known(1)%fit%estimate(k), 1.0_wp, 1e-5_wp)
         ! One record: the truth lies inside four standard errors but for one in 10^4.
         call check('the truth near '//trim(names(k)), abs(found(1)%fit%estimate(k) - truth(k)) &
            < 4*found(1)%statistics%std_error(k))
      end do
      ! The line's frequency is right to a few thousandths of 1/T, E to twice that.
      call check_close('the start is near', found(1)%quantities(1)%start/6.5e10_wp, 1.0_wp, 0.05_wp)
   end subroutine test_automatic

   !> A record of seconds holds no period of a strip as heavy as a mountain.
   subroutine test_no_period()
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      call record_of_strip(experiment, model, error)
      if (allocated(error)) return
      experiment%excitation = model%excitation
      model%structure%rho = 1e12_wp
      stage = stage_of(['E'], offset=.true.)
      stage%automatic = .true.
      call identify(model, mesh_t(elements=8), [stage], [experiment], fits, error)
      call check('no period: refused', allocated(error))
      if (allocated(error)) call check('and says so', &
         index(error%message, 'record 1 lasts ') > 0, error%message)
   end subroutine test_no_period

   !> A modulus in the wrong unit puts the first mode a hundred times off.
   subroutine test_wrong_units()
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      integer :: k

      do k = -1, 1, 2
         call record_of_strip(experiment, model, error)
         if (allocated(error)) return
         model%structure%c_D = 0
         model%structure%gamma = 0
         model%structure%E = strip%E*1e4_wp**k
         call identify(model, mesh_t(elements=8), [stage_of(['E'], [model%structure%E], .true.)], &
            [experiment], fits, error)
         call check('frequencies a hundred times off, '//to_text(k)//': refused', &
            allocated(error))
         if (.not. allocated(error)) cycle
         call check('and says so', index(error%message, 'units') > 0, error%message)
         deallocate (error)
      end do
   end subroutine test_wrong_units

   !> The reconstructed record of the RPL experiment has two minima by its making: several starts
   !> find both, each start is counted once, and the same seed finds the same.
   subroutine test_minima()
      type(case_t) :: case
      type(experiment_t), allocatable :: experiments(:)
      character(len=note_length), allocatable :: notes(:)
      type(minimum_t), allocatable :: minima(:), again(:)
      type(error_t), allocatable :: error
      integer :: failures, k

      call read_case('data/rpl_table_4_3.nml', needs_fit, case, error)
      if (.not. allocated(error)) call load_experiments(case, experiments, notes, error)
      call check('the case is read', .not. allocated(error))
      if (allocated(error)) return
      case%stages = case%stages(size(case%stages):)
      case%stages(1)%start = [0.06_wp, 0.006_wp, 0.39_wp]
      call identify_from_many(case%model, case%meshes(1), case%stages, experiments, &
         multistart_t(n=24, seed=2, spread=1.6_wp), minima, failures, error)
      call check('minima found', .not. allocated(error))
      if (allocated(error)) return
      call check('two or more', size(minima) >= 2, to_text(size(minima)))
      call check('every start is counted once', sum(minima%count) + failures == 24, &
         to_text(sum(minima%count)))
      do k = 2, size(minima)
         call check('ascending J', minima(k)%fits(1)%fit%J >= minima(k - 1)%fits(1)%fit%J)
      end do
      ! The lowest is the one of Table 4.3: m_H = .043431, to the 5 % that the record was made for.
      call check_close('the lowest minimum', minima(1)%fits(1)%fit%estimate(1)/0.043431_wp, &
         1.0_wp, 0.05_wp)
      call identify_from_many(case%model, case%meshes(1), case%stages, experiments, &
         multistart_t(n=24, seed=2, spread=1.6_wp), again, failures, error)
      call check('the same again', size(again) == size(minima))
      if (size(again) == size(minima)) call check('as often', all(again%count == minima%count))
   end subroutine test_minima

   !> Without damping a frequency goes like sqrt(E): half the relative width of E is its own, in
   !> every mode; and the damping ratio is 0 with certainty.
   subroutine test_intervals_of_modes()
      type(experiment_t) :: experiment
      type(model_t) :: model
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(fitted_mode_t), allocatable :: modes(:)
      type(error_t), allocatable :: error
      type(simulation_t) :: simulation
      real(wp) :: relative
      integer :: k

      call record_of_strip(experiment, model, error)
      if (allocated(error)) return
      model%structure%c_D = 0
      model%structure%gamma = 0
      call simulate(model, mesh_t(elements=8), experiment%samples, simulation, error)
      if (allocated(error)) return
      experiment%measured = simulation%acceleration + gaussian_noise(2500, 0.1_wp, 4)
      experiment%excitation = model%excitation
      stage = stage_of(['E'], [6.51e10_wp])
      call identify(model, mesh_t(elements=8), [stage], [experiment], fits, error)
      call check('E alone', .not. allocated(error))
      if (allocated(error)) return
      call fitted_modes(mesh_t(elements=8), fits(1), 4, modes, error)
      call check('four modes', .not. allocated(error) .and. size(modes) == 4)
      if (size(modes) /= 4) return
      relative = fits(1)%statistics%half_width(1)/fits(1)%fit%estimate(1)
      if (.not. fits(1)%check%white) relative = fits(1)%statistics%corrected_half_width(1) &
         /fits(1)%fit%estimate(1)
      do k = 1, 4
         ! Exact but for round-off in the derivative of a root.
         call check_close('mode '//to_text(k)//': half of E''s', modes(k)%frequency_half_width &
            /modes(k)%frequency/(relative/2), 1.0_wp, 1e-6_wp)
         call check_close('mode '//to_text(k)//': no damping', modes(k)%damping_ratio, 0.0_wp, &
            0.0_wp)
      end do
      ! A standard error that cannot be squared: modes without intervals, not with none of 0.
      fits(1)%statistics%std_error = 1e297_wp
      fits(1)%statistics%covariance = huge(1.0_wp)
      call fitted_modes(mesh_t(elements=8), fits(1), 4, modes, error)
      call check('no intervals', all(modes%frequency_half_width >= huge(1.0_wp)) .and. &
         all(modes%damping_half_width >= huge(1.0_wp)))
   end subroutine test_intervals_of_modes

end program test_starts
