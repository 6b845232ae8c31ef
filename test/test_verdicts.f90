!> Judges fits: of records that contain both modes, of one in which a multiple of the first mode
!> takes the place of the second, and of one that the model cannot describe.
program test_verdicts
   use beamid_decaying_lines, only: find_lines
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_free, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_spectra, only: line_t
   use beamid_strings, only: to_text
   use beamid_structure, only: sensor_t, structure_t
   use beamid_verdicts, only: new_verdict, verdict_t
   use beamid_whiteness, only: effective_samples
   use checks, only: check, check_close, finish
   use models, only: model_of, stage_of
   implicit none

   type(structure_t), parameter :: strip = structure_t(length=0.5_wp, rho=0.27_wp, E=6.5e10_wp, &
                                   I=0.05_wp*0.002_wp**3/12, c_D=2e6_wp, gamma=0.07_wp, &
                                   sensor=sensor_t(m_S=0.005_wp, x_S=0.44_wp))
   character(len=*), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']
   real(wp), parameter :: start(4) = [6.6e10_wp, 0.0055_wp, 2.2e6_wp, 0.065_wp]
   type(mesh_t), parameter :: mesh = mesh_t(elements=8)
   integer, parameter :: m = 2500
   real(wp), parameter :: two_pi = 2*acos(-1.0_wp), noise = 0.1_wp

   type(experiment_t) :: experiment
   type(model_t) :: model
   type(stage_fit_t), allocatable :: fits(:)
   type(verdict_t) :: verdict

   call make_record()
   call test_both_modes()
   call test_above_nyquist()
   call test_multiple()
   call test_nothing_like_it()
   call test_effective_samples()
   call test_repeated_blows()
   call finish('verdicts')

contains

   subroutine make_record()
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error
      integer :: k

      model = model_of(strip, new_release(0.02_wp, 0.0_wp, .true.))
      experiment%samples = [(0.3_wp + k*1e-3_wp, k=1, m)]
      call simulate(model, mesh, experiment%samples, simulation, error)
      experiment%measured = simulation%acceleration + gaussian_noise(m, noise, 21)
      experiment%excitation = new_free(2)
   end subroutine make_record

   !> A known force that strikes the strip again and again: after each blow the modes begin anew, so
   !> that the line of mode 2 (39.035) splits into multiples of the blows' frequency. With the first
   !> period, one of them lies .15 from the mode; with the second period, no line is near. The mode
   !> is seen in either case, and not called a multiple of mode 1 (6.047).
   subroutine test_repeated_blows()
      integer, parameter :: samples = 4000
      real(wp), parameter :: period(2) = [0.72_wp, 0.7_wp], rise = 0.004_wp
      type(structure_t) :: damped
      type(excitation_t) :: force
      type(simulation_t) :: simulation
      type(experiment_t) :: record(1)
      type(error_t), allocatable :: error
      integer :: blows, j, k

      damped = strip
      damped%E = 6.4e10_wp
      damped%c_D = 6e6_wp
      damped%sensor(1)%m_S = 0.004_wp
      damped%x_F = 0.3_wp
      do k = 1, size(period)
         blows = int(19.5_wp/period(k))
         call new_force_table([((0.1_wp + (j/3)*period(k) + modulo(j, 3)*rise), j=0, &
            3*blows - 1)], [(merge(1.0_wp, 0.0_wp, modulo(j, 3) == 1), j=0, 3*blows - 1)], force, &
            error)
         record(1)%samples = [(0.005_wp*j, j=1, samples)]
         model = model_of(damped, force)
         call simulate(model, mesh, record(1)%samples, simulation, error)
         record(1)%measured = simulation%acceleration + gaussian_noise(samples, 0.05_wp, 31)
         record(1)%excitation = force
         call identify(model, mesh, [stage_of(names([1, 3]), [6.45e10_wp, 5.5e6_wp])], record, &
            fits, error)
         if (.not. allocated(error)) call new_verdict(record, mesh, fits(1), verdict, error)
         call check('force '//to_text(k)//': fitted', .not. allocated(error))
         if (allocated(error)) return
         associate (s => verdict%sightings(2))
            call check('force '//to_text(k)//': mode 2 is seen', s%verdict == 'seen' &
               .and. s%share > 0.5_wp .and. s%share <= 1, s%verdict//to_text(s%share))
            if (k == 1) call check('force 1: a line beside mode 2', &
               abs(abs(s%peak - s%model) - 0.15_wp) < 0.02_wp, to_text(s%peak))
            if (k == 2) call check('force 2: no line', .not. s%peak > 0, to_text(s%peak))
         end associate
      end do
   end subroutine test_repeated_blows

   !> A fit, automatic or from a start near the truth, and the verdict on it.
   subroutine judge(automatic, error)
      logical, intent(in) :: automatic
      type(error_t), allocatable, intent(out) :: error
      type(stage_t) :: stage

      stage = stage_of(names, start, .true.)
      stage%automatic = automatic
      if (automatic) deallocate (stage%start)
      call identify(model, mesh, [stage], [experiment], fits, error)
      if (.not. allocated(error)) call new_verdict([experiment], mesh, fits(1), verdict, error)
   end subroutine judge

   subroutine test_both_modes()
      type(error_t), allocatable :: error

      call judge(.true., error)
      call check('both modes: fitted', .not. allocated(error))
      if (allocated(error)) return
      associate (q => verdict%qualities(1), s => verdict%sightings)
         ! The noise's standard deviation from 2500 samples is right to 1.4 %; three times that.
         call check_close('noise', q%noise_sd/noise, 1.0_wp, 0.045_wp)
         call check_close('fit in per cent', q%fit_percent, &
            100*(1 - q%rms_residual/q%rms_signal), 1e-10_wp)
         call check('most is explained', q%fit_percent > 95, to_text(q%fit_percent))
         call check('both are seen', all(s%verdict == 'seen'), s(1)%verdict//s(2)%verdict)
         ! A line that decays within the record is found to hundredths of its width, 1/T = .4.
         call check('beside their peaks', all(abs(s%peak - s%model) < 0.02_wp))
         call check('shares of the energy', s(1)%share > s(2)%share .and. sum(s%share) <= 1.01_wp)
      end associate
      call check('a fit', verdict%no_fit == '' .and. fits(1)%note == '', verdict%no_fit)
   end subroutine test_both_modes

   !> A hundred samples a second contain modes 1 and 2 (6 and 39). Mode 3 (108) reduces J as well,
   !> because the simulated samples contain its alias, but no record shows that it is not another
   !> line: it is not seen.
   subroutine test_above_nyquist()
      type(experiment_t) :: record(1)
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error
      integer :: k

      record(1)%samples = [(0.1_wp + 0.01_wp*k, k=1, 500)]
      call simulate(model, mesh, record(1)%samples, simulation, error)
      record(1)%measured = simulation%acceleration + gaussian_noise(500, 0.01_wp*noise, 21)
      record(1)%excitation = new_free(3)
      call identify(model, mesh, [stage_of(names, start, .true.)], record, fits, error)
      if (.not. allocated(error)) call new_verdict(record, mesh, fits(1), verdict, error)
      call check('above the Nyquist frequency: fitted', .not. allocated(error))
      if (allocated(error)) return
      associate (s => verdict%sightings)
         call check('modes 1 and 2 are seen, mode 3 is not', all(s(:3)%verdict == ['seen  ', &
            'seen  ', 'unseen']) .and. s(3)%model > 50, s(3)%verdict//to_text(s(3)%model))
      end associate
   end subroutine test_above_nyquist

   !> Only the first mode, and a weak line at seven times its frequency.
   subroutine test_multiple()
      type(line_t), allocatable :: lines(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: kept(:)

      kept = experiment%measured
      call find_lines(experiment%samples, experiment%measured, 60.0_wp, 4, lines)
      associate (t => experiment%samples, f => lines(1)%frequency)
         experiment%measured = 10*exp(-lines(1)%decay*t)*sin(two_pi*f*t) &
            + 0.3_wp*exp(-0.3_wp*t)*sin(7*two_pi*f*t) + gaussian_noise(m, noise, 22)
      end associate
      call judge(.true., error)
      call check('a multiple: fitted', .not. allocated(error))
      if (allocated(error)) return
      call check('mode 2 is not there', index(fits(1)%note, 'mode 2 may be a multiple of '// &
         'another line or of the mains: m_S is held') == 1, fits(1)%note)
      call check('and E has hold', verdict%no_fit == '' .and. any(fits(1)%quantities%name == 'E') &
         .and. .not. any(fits(1)%quantities%name == 'm_S'), verdict%no_fit)
      ! From numbers near enough the search ends on the multiple.
      model%structure%sensor(1)%m_S = 0.001_wp
      call judge(.false., error)
      if (.not. allocated(error)) call check('from given numbers: no fit', &
         index(verdict%no_fit, 'm_S') > 0, verdict%no_fit)
      model%structure%sensor(1)%m_S = strip%sensor(1)%m_S
      experiment%measured = kept
   end subroutine test_multiple

   !> A line between the modes of the model, which E is not free to meet.
   subroutine test_nothing_like_it()
      type(error_t), allocatable :: error
      type(stage_t) :: stage

      experiment%measured = 5*sin(two_pi*15*experiment%samples) + gaussian_noise(m, noise, 23)
      stage = stage_of(['gamma'], [0.07_wp], .true.)
      call identify(model, mesh, [stage], [experiment], fits, error)
      if (.not. allocated(error)) call new_verdict([experiment], mesh, fits(1), verdict, error)
      call check('another record: judged', .not. allocated(error))
      if (allocated(error)) return
      call check('no fit', index(verdict%no_fit, 'the model explains') == 1, verdict%no_fit)
      call check('less than half', verdict%qualities(1)%fit_percent < 50)
   end subroutine test_nothing_like_it

   !> White noise is worth all of its samples; sums of two neighbours, of autocorrelation 1/2, are
   !> worth 1/(1 + 2/4) of theirs.
   subroutine test_effective_samples()
      real(wp) :: white(4000)

      white = gaussian_noise(size(white), 1.0_wp, 24)
      ! Squares of autocorrelations up to lag 1000, of which each stands for some k/20, scatter by
      ! sqrt(2)/m: their sum by .06, which moves the share by .1 and of sums of neighbours by .05.
      call check_close('white', effective_samples(white)/size(white), 1.0_wp, 0.25_wp)
      call check_close('sums of neighbours', effective_samples(white(2:) + white(:3999))/3999, &
         2/3.0_wp, 0.15_wp)
   end subroutine test_effective_samples

end program test_verdicts
