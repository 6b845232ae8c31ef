!> A real beam: an aluminium cantilever of .5 m whose tip was let go, with an accelerometer on it.
!> The record lies beside the checkout; without it nothing is tested.
program test_measured_beam
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: free_index, offset
   use beamid_records, only: load_recording, note_length, recording_t
   use beamid_strings, only: to_text
   use beamid_structure, only: sensor_t, structure_t
   use checks, only: check, check_close, finish, skip
   use models, only: model_of, stage_of
   implicit none

   character(len=*), parameter :: path = &
      '../shared/data/measured_beam/cantilever_50cm_release.csv'
   real(wp), parameter :: g = 9.80665_wp
   real(wp), parameter :: nominal(4) = [7e10_wp, 0.005_wp, 1e7_wp, 0.05_wp]
   character(len=5), parameter :: names(4) = [character(len=5) :: 'E', 'm_S', 'c_D', 'gamma']
   type(mesh_t), parameter :: mesh = mesh_t(3, 8, 4, 1)

   type(model_t) :: model
   type(experiment_t) :: experiment, fewer
   type(stage_fit_t), allocatable :: fits(:)
   type(error_t), allocatable :: error
   logical :: there

   inquire (file=path, exist=there)
   if (.not. there) then
      call skip('measured beam', 'there is no '//path)
   else
      call load(error)
      if (.not. allocated(error)) call identify(model, mesh, [stage_of(names, nominal, .true.)], &
         [experiment], fits, error)
      call check('the record is fitted', .not. allocated(error))
      if (.not. allocated(error)) then
         call test_estimates()
         call test_residuals()
         call test_frequencies()
         call test_elements()
         call test_starts()
      end if
   end if
   call finish('measured_beam')

contains

   !> From one to six seconds, when two modes are left; and every fourth sample of that.
   subroutine load(error)
      type(error_t), allocatable, intent(out) :: error
      type(recording_t) :: recording
      character(len=note_length), allocatable :: notes(:)

      model = model_of(structure_t(length=0.5_wp, rho=0.27_wp, E=nominal(1), &
         I=0.05_wp*0.002_wp**3/12, c_D=nominal(3), gamma=nominal(4), &
         sensor=sensor_t(m_S=nominal(2), x_S=0.44_wp)), new_free(2))
      recording%path = path
      recording%scale = g
      recording%window%t_first = 1
      recording%window%t_last = 6
      call load_recording(recording, experiment%samples, experiment%measured, notes, error)
      if (allocated(error)) return
      experiment%scale = g
      experiment%excitation = new_free(2)
      fewer = experiment
      fewer%samples = fewer%samples(::4)
      fewer%measured = fewer%measured(::4)
   end subroutine load

   !> An independent fit found 6.4e10, 4 g, 6.051 and 39.08 Hz, damping ratios .0039 and .0042.
   subroutine test_estimates()
      type(fitted_mode_t), allocatable :: modes(:)

      associate (q => fits(1)%quantities%value)
         call check_close('E', q(1), 6.5e10_wp, 0.3e10_wp)
         call check_close('mass of the sensor', q(2), 0.005_wp, 0.002_wp)
         call check('damping above nothing', all(q(3:4) > 0), to_text(q(3))//', '//to_text(q(4)))
         call check('the offset comes last, and is known', &
            fits(1)%quantities(size(q))%parameter == offset .and. &
            fits(1)%statistics%std_error(size(q)) < 1e-3_wp, to_text(q(size(q))))
      end associate
      call fitted_modes(mesh, fits(1), 2, modes, error)
      call check('modes of the fitted beam', .not. allocated(error))
      if (allocated(error)) return
      ! What was found there is given to three or four digits.
      call check_close('frequency 1', modes(1)%frequency, 6.051_wp, 0.002_wp)
      call check_close('frequency 2', modes(2)%frequency, 39.08_wp, 0.02_wp)
      call check_close('damping ratio 1', modes(1)%damping_ratio, 0.0039_wp, 0.0001_wp)
      call check_close('damping ratio 2', modes(2)%damping_ratio, 0.0042_wp, 0.0001_wp)
   end subroutine test_estimates

   !> Small, but not white: the air's drag depends on the amplitude, the model's does not.
   subroutine test_residuals()
      real(wp) :: deviation, share

      associate (z => experiment%measured, r => fits(1)%fit%residual, s => fits(1)%statistics)
         deviation = sqrt(sum((z - sum(z)/size(z))**2)/size(z))
         share = norm2(r)/sqrt(real(size(z), wp))/deviation
         call check('residual at most 2 % of the signal''s deviation', share < 0.02_wp, &
            to_text(100*share)//' %')
         call check('residuals are declared not white', .not. fits(1)%check%white .and. &
            fits(1)%check%probability < 1e-6_wp, to_text(fits(1)%check%probability))
         call check('every corrected interval is wider, some by half', &
            all(s%corrected_half_width > s%half_width) .and. &
            any(s%corrected_half_width > 1.5_wp*s%half_width), &
            to_text(minval(s%corrected_half_width/s%half_width))//' to '// &
            to_text(maxval(s%corrected_half_width/s%half_width)))
         call check('worth fewer samples', s%effective < size(z)/2, to_text(s%effective))
         call check('unknowns are counted', s%parameters == 9 .and. s%samples == size(z))
      end associate
   end subroutine test_residuals

   !> Peaks of the periodogram under a Hann window: 5 s part lines by .4 Hz, and the peak of a line
   !> a thousand times above the rest lies within a hundredth of that.
   subroutine test_frequencies()
      type(fitted_mode_t), allocatable :: modes(:)
      real(wp) :: peak
      real(wp), parameter :: middles(2) = [6.05_wp, 39.1_wp]
      integer :: k

      call fitted_modes(mesh, fits(1), 2, modes, error)
      if (allocated(error)) return
      do k = 1, 2
         peak = peak_near(middles(k))
         call check_close('peak of the spectrum near '//to_text(middles(k))//' Hz', &
            modes(k)%frequency, peak, 1e-3_wp*peak)
      end do
   end subroutine test_frequencies

   !> Two scans, the second between the neighbours of the highest point of the first [1/time].
   real(wp) function peak_near(middle) result(peak)
      real(wp), intent(in) :: middle
      integer, parameter :: points = 41
      real(wp) :: power(points), step
      integer :: scan, k

      peak = middle
      step = 0.02_wp
      do scan = 1, 2
         do k = 1, points
            power(k) = periodogram(peak + step*(k - (points + 1)/2))
         end do
         peak = peak + step*(maxloc(power, dim=1) - (points + 1)/2)
         step = step/20
      end do
   end function peak_near

   !> Each sample stands for half the time to its neighbours.
   real(wp) function periodogram(frequency) result(power)
      real(wp), intent(in) :: frequency
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
      real(wp), allocatable :: weight(:), z(:)
      integer :: m

      associate (t => fewer%samples)
         m = size(t)
         weight = [t(2) - t(1), (t(3:) - t(:m - 2))/2, t(m) - t(m - 1)] &
            *(1 - cos(two_pi*(t - t(1))/(t(m) - t(1))))
         z = weight*(fewer%measured - sum(weight*fewer%measured)/sum(weight))
         power = sum(z*cos(two_pi*frequency*t))**2 + sum(z*sin(two_pi*frequency*t))**2
      end associate
   end function periodogram

   !> Eight elements are enough for two modes.
   subroutine test_elements()
      type(stage_fit_t), allocatable :: finer(:)

      call identify(model, mesh_t(3, 12, 4, 1), [stage_of(names, fits(1)%fit%estimate, .true.)], &
         [experiment], finer, error)
      call check('twelve elements: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      ! The error of frequency 2, N**-4 or so of it; with two frequencies E and m_S take it up.
      call check_close('twelve elements: E', finer(1)%fit%estimate(1)/fits(1)%fit%estimate(1), &
         1.0_wp, 3e-4_wp)
      call check_close('twelve elements: J', finer(1)%fit%J/fits(1)%fit%J, 1.0_wp, 1e-3_wp)
   end subroutine test_elements

   !> One minimum from E 5 % off and the others off by factors of 3, all combinations; with starts
   !> from the record from twice and half of E.
   subroutine test_starts()
      real(wp), parameter :: factors(4) = [1.05_wp, 3.0_wp, 3.0_wp, 3.0_wp]
      type(stage_fit_t), allocatable :: best(:)
      real(wp) :: start(4)
      integer :: k, bits, reached

      call identify(model, mesh, [stage_of(names, fits(1)%fit%estimate, .true.)], [fewer], best, &
         error)
      call check('every fourth sample: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      call check('every fourth sample: the same parameters', all(abs(best(1)%fit%estimate - &
         fits(1)%fit%estimate) < fits(1)%statistics%corrected_error(:4)))
      reached = 0
      do bits = 0, 15
         start = best(1)%fit%estimate*merge(factors, 1/factors, btest(bits, [(k, k=0, 3)]))
         if (reaches(best(1), start, .false.)) reached = reached + 1
      end do
      call check('one minimum from 16 starts', reached == 16, to_text(reached))
      reached = 0
      do bits = 0, 15, 3
         start = best(1)%fit%estimate*merge([2.0_wp, factors(2:)], [0.5_wp, 1/factors(2:)], &
            btest(bits, [(k, k=0, 3)]))
         if (reaches(best(1), start, .true.)) reached = reached + 1
      end do
      call check('and from 6 starts that the record corrects', reached == 6, to_text(reached))
   end subroutine test_starts

   !> Whether a search ends where the best one did; a search stops where J is flat to 1e-14,
   !> some 1e-5 standard errors from the minimum.
   logical function reaches(best, start, automatic)
      type(stage_fit_t), intent(in) :: best
      real(wp), intent(in) :: start(:)
      logical, intent(in) :: automatic
      type(stage_fit_t), allocatable :: found(:)
      type(error_t), allocatable :: error
      type(model_t) :: there
      type(stage_t) :: stage
      integer :: k

      there = model
      do k = 1, size(start)
         call there%structure%set(free_index(names(k)), start(k))
      end do
      stage = stage_of(names, start, .true.)
      stage%automatic = automatic
      if (automatic) deallocate (stage%start)
      call identify(there, mesh, [stage], [fewer], found, error)
      reaches = .not. allocated(error)
      if (reaches) reaches = abs(found(1)%fit%J/best%fit%J - 1) < 1e-10_wp .and. &
         all(abs(found(1)%fit%estimate - best%fit%estimate) < 1e-4_wp*best%statistics%std_error(:4))
      if (.not. reaches) print '(a,4es12.4)', '      not from', start
   end function reaches

end program test_measured_beam
