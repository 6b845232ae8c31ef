!> Judges a fit: the share of each record that it explains, which modes the records show, and
!> whether a parameter is determined only by modes that no record shows.
module beamid_verdicts
   use beamid_decaying_lines, only: find_lines
   use beamid_equations, only: new_equations, equations_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_model_roots, only: belief_t, beliefs_about
   use beamid_responses, only: work_t
   use beamid_spectra, only: line_t, near_mains, noise_near
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: to_text
   use beamid_trials, only: is_multiple, least_gain, resting
   use beamid_unknowns, only: name_length, name_of
   use beamid_whiteness, only: effective_samples
   implicit none
   private

   public :: verdict_t, quality_t, sighting_t, new_verdict

   !> How well a fit explains one record.
   type :: quality_t
      integer :: samples = 0          !< number of samples
      real(wp) :: rms_signal = 0      !< rms of the record about its mean [length/time**2]
      real(wp) :: rms_residual = 0    !< rms of the residuals [length/time**2]
      real(wp) :: fit_percent = 0     !< 100 (1 - rms_residual/rms_signal)
      real(wp) :: noise_sd = 0        !< noise level, corrected for the degrees of freedom
      real(wp) :: effective = 0       !< effective number of samples, < samples if not white
   end type quality_t

   !> One mode of the model in one record.
   type :: sighting_t
      integer :: record = 1, mode = 1
      real(wp) :: model = 0           !< frequency of the model [1/time]
      real(wp) :: peak = 0            !< frequency of the spectral line beside it [1/time]; 0: none
      real(wp) :: share = 0           !< share of the record's variance
      !> 'seen', 'unseen', 'harmonic' (a multiple of the first mode) or 'mains' (of 50 or 60 Hz)
      character(len=8) :: verdict = 'unseen'
   end type sighting_t

   !> The verdict on a fit.
   type :: verdict_t
      type(quality_t), allocatable :: qualities(:)    !< (records)
      type(sighting_t), allocatable :: sightings(:)   !< every mode in every record
      character(len=:), allocatable :: no_fit         !< why the fit is rejected; '': it is accepted
   end type verdict_t

   !> A fit that explains less of a record, in percent, is rejected if its residuals are not white.
   real(wp), parameter :: least_percent = 50

   !> Largest number of spectral lines per record; number of modes to judge if fewer were fitted.
   integer, parameter :: most_lines = 12, usual_modes = 2
   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

contains

   !> Judges the fit of one stage.
   !>
   !> experiments  (records) that were fitted
   !> mesh         mesh of the fit
   !> fit          of the stage
   !> error        the roots of the structure cannot be found
   subroutine new_verdict(experiments, mesh, fit, verdict, error)
      type(experiment_t), intent(in) :: experiments(:)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      type(verdict_t), intent(out) :: verdict
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: s(:, :), ds(:, :, :)
      integer :: first, r

      call roots_of_fit(mesh, fit, s, ds, error)
      if (allocated(error)) return
      allocate (verdict%qualities(size(experiments)), verdict%sightings(0))
      first = 0
      do r = 1, size(experiments)
         associate (experiment => experiments(r), m => size(experiments(r)%measured))
            associate (residual => fit%residual(first + 1:first + m))
               verdict%qualities(r) = quality_of(experiment%measured, residual, fit)
               verdict%sightings = [verdict%sightings, modes_in_record(experiment, r, first, &
                  residual, fit, s(:, r))]
            end associate
            first = first + m
         end associate
      end do
      verdict%no_fit = fit%doubt
      if (verdict%no_fit == '') verdict%no_fit = describe_misfit(verdict%qualities, fit)
      if (verdict%no_fit == '' .and. all(experiments%excitation%modes > 0)) &
         verdict%no_fit = describe_undetermined(verdict%sightings, fit, s, ds)
   end subroutine new_verdict

   !> Computes the lowest oscillating roots of the fitted structures, as many as modes were fitted
   !> but at least `usual_modes`, and their derivatives.
   !>
   !> s      (modes, records) roots [1/time]; 0 where the mesh has fewer
   !> ds     (modes, records, free) derivatives with respect to the free parameters; 0 for
   !>        parameters of another record
   !> error  the roots cannot be found
   subroutine roots_of_fit(mesh, fit, s, ds, error)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      complex(wp), allocatable, intent(out) :: s(:, :), ds(:, :, :)
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(work_t) :: work
      complex(wp), allocatable :: found(:), slopes(:, :)
      logical, allocatable :: together(:)
      integer :: modes, n, p, r

      associate (structures => fit%scenario%structures)
         modes = max(usual_modes, maxval(fit%scenario%excitations%modes))
         allocate (s(modes, size(structures)), ds(modes, size(structures), size(fit%free)))
         s = 0
         ds = 0
         do r = 1, size(structures)
            galerkin = galerkin_of(mesh, structures(r))
            call solver%prepare(galerkin, error)
            if (allocated(error)) return
            equations = new_equations(galerkin, structures(r), new_pulse(0.0_wp, 1.0_wp))
            n = min(modes, galerkin%space%n)
            call solver%lowest_roots(equations, fit%free, n, found, slopes, together, work, error)
            if (allocated(error)) return
            s(:size(found), r) = found
            do p = 1, size(fit%free)
               if (any(fit%quantities(p)%record == [0, r])) ds(:size(found), r, p) = slopes(:, p)
            end do
         end do
      end associate
   end subroutine roots_of_fit

   !> Returns how well a fit explains one record.
   !>
   !> measured  (m) the record [length/time**2]
   !> residual  (m) its residuals [length/time**2]
   function quality_of(measured, residual, fit) result(quality)
      real(wp), intent(in) :: measured(:), residual(:)
      type(stage_fit_t), intent(in) :: fit
      type(quality_t) :: quality
      integer :: m

      m = size(measured)
      quality%samples = m
      quality%rms_signal = sqrt(sum((measured - sum(measured)/m)**2)/m)
      quality%rms_residual = sqrt(sum(residual**2)/m)
      if (quality%rms_signal > 0) quality%fit_percent = 100*(1 - quality%rms_residual &
         /quality%rms_signal)
      quality%noise_sd = quality%rms_residual
      associate (statistics => fit%statistics)
         if (statistics%freedom > 0) quality%noise_sd = quality%rms_residual &
            *sqrt(max(1.0_wp, statistics%samples/real(statistics%freedom, wp)))
      end associate
      quality%effective = effective_samples(residual)
   end function quality_of

   !> Returns what one record shows of each mode.
   !>
   !> A mode is seen if a spectral line stands beside it, or if it was fitted and reduces J by more
   !> than noise would. A mode on a multiple of the first mode's frequency or of the mains may be
   !> that multiple.
   !>
   !> r         number of the record
   !> row       number of residuals of the records before it
   !> residual  (m) residuals of this record [length/time**2]
   !> s         (modes) roots of its structure [1/time]
   function modes_in_record(experiment, r, row, residual, fit, s) result(found)
      type(experiment_t), intent(in) :: experiment
      integer, intent(in) :: r, row
      real(wp), intent(in) :: residual(:)
      type(stage_fit_t), intent(in) :: fit
      complex(wp), intent(in) :: s(:)
      type(sighting_t), allocatable :: found(:)
      type(line_t), allocatable :: lines(:)
      type(sighting_t) :: sighting
      real(wp) :: gain, span
      integer :: k

      allocate (found(0))
      associate (t => experiment%samples, z => experiment%measured)
         span = t(size(t)) - t(1)
         call find_lines(t, z, 2*maxval(aimag(s))/two_pi, most_lines, lines)
         do k = 1, size(s)
            if (.not. aimag(s(k)) > 0) cycle
            sighting = sighting_t(record=r, mode=k, model=aimag(s(k))/two_pi)
            associate (modes => fit%scenario%excitations(r)%modes)
               if (k <= modes .or. fit%note == '') call find_nearest_line(lines, span, sighting)
               gain = 0
               if (k <= modes) call weigh_mode(fit, r, k, row, experiment, residual, s(k), &
                  sighting%share, gain)
            end associate
            if (gain > least_gain .and. sighting%verdict == 'unseen') sighting%verdict = 'seen'
            if (sighting%verdict == 'seen' .and. is_multiple(s, k, gain, lines, span)) &
               sighting%verdict = merge('mains   ', 'harmonic', near_mains(sighting%model, span, &
               0.0_wp))
            if (sighting%verdict == 'seen' .and. k <= fit%scenario%excitations(r)%modes) then
               if (merges_with_harmonic(fit, r, row, t, residual, s, k)) &
                  sighting%verdict = 'harmonic'
            end if
            found = [found, sighting]
         end do
      end associate
   end function modes_in_record

   !> Returns whether a mode and a multiple of the first mode's frequency form one broad line.
   !>
   !> This is so if, with the multiple in the model as well, J would fall by more than noise
   !> explains and an estimate would move by more than the width of its interval. The multiple
   !> decays as the first mode does or as its power.
   !>
   !> r            number of the record
   !> row          number of residuals of the records before it
   !> t, residual  (m) sample times [time] and residuals of the record [length/time**2]
   !> s            (modes) roots of its structure [1/time]
   !> k            number of the mode
   logical function merges_with_harmonic(fit, r, row, t, residual, s, k) result(merges)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: r, row, k
      real(wp), intent(in) :: t(:), residual(:)
      complex(wp), intent(in) :: s(:)
      real(wp), parameter :: independent = 1e-10_wp   ! of a column that counts as independent
      integer, parameter :: highest = 12              ! order of a multiple
      !> Jacobian, followed by cosine and sine of the multiple with either decay
      real(wp) :: a(size(fit%jacobian, 1), size(fit%jacobian, 2) + 4), step(size(a, 2)), &
         column_norm(size(a, 2)), gain
      complex(wp) :: multiple(size(t))
      integer :: j, m, n, order, rank

      merges = .false.
      if (k < 2 .or. fit%statistics%samples == 0 .or. size(a, 1) <= size(a, 2)) return
      m = size(t)
      n = size(fit%jacobian, 2)
      order = nint(aimag(s(k))/aimag(s(1)))
      ! The lines must be no further apart than the sum of their widths.
      if (order < 2 .or. order > highest .or. abs(aimag(s(k)) - order*aimag(s(1))) > &
         2*abs(real(s(k))) + 2*order*abs(real(s(1))) + 2*two_pi/(t(m) - t(1))) return
      a(:, :n) = fit%jacobian
      a(:, n + 1:) = 0
      do j = 1, 2
         multiple = exp(cmplx(merge(1, order, j == 1)*real(s(1)), order*aimag(s(1)), wp)*(t - t(1)))
         a(row + 1:row + m, n + 2*j - 1) = real(multiple)
         a(row + 1:row + m, n + 2*j) = aimag(multiple)
      end do
      column_norm = norm2(a, dim=1)
      if (.not. all(column_norm > 0)) return
      call least_squares_step(a, fit%fit%residual, 1/column_norm, spread(.true., 1, size(step)), &
         independent, step, rank)
      gain = (sum(fit%fit%residual**2) - sum((fit%fit%residual + matmul(a, step))**2))/ &
         noise_near(t, residual, aimag(s(k))/two_pi, -real(s(k)))/fit%weight(r)**2
      if (gain > least_gain) merges = any(abs(step(:size(fit%free))) > &
         2*fit%statistics%corrected_half_width(:size(fit%free)))
   end function merges_with_harmonic

   !> Sets peak, share and verdict of a mode from the spectral line nearest to it, unless that is
   !> further away than both the resolution 1/span and 1 % of the frequency.
   !>
   !> lines  spectral lines of the record
   !> span   duration of the record [time]
   pure subroutine find_nearest_line(lines, span, sighting)
      type(line_t), intent(in) :: lines(:)
      real(wp), intent(in) :: span
      type(sighting_t), intent(inout) :: sighting
      integer :: n

      if (size(lines) == 0) return
      n = minloc(abs(lines%frequency - sighting%model), dim=1)
      if (abs(lines(n)%frequency - sighting%model) > max(1/span, 1e-2_wp*sighting%model)) return
      sighting%peak = lines(n)%frequency
      sighting%share = min(1.0_wp, lines(n)%energy)
      sighting%verdict = 'seen'
      if (lines(n)%harmonic > 0) sighting%verdict = 'harmonic'
      if (lines(n)%mains) sighting%verdict = 'mains'
   end subroutine find_nearest_line

   !> Computes the weight of a fitted free mode in a record.
   !>
   !> r           number of the record
   !> k           number of the mode
   !> row         number of residuals of the records before it
   !> experiment  the record
   !> residual    (m) its residuals [length/time**2]
   !> s           root of the mode [1/time]
   !> share       share of the record's variance; unchanged if it cannot be computed
   !> gain        by how much the mode reduces J, over the variance of the noise around its
   !>             frequency
   subroutine weigh_mode(fit, r, k, row, experiment, residual, s, share, gain)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: r, k, row
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: residual(:)
      complex(wp), intent(in) :: s
      real(wp), intent(inout) :: share
      real(wp), intent(out) :: gain
      real(wp) :: c(2), covariance(2, 2), determinant, total
      integer :: first

      gain = 0
      if (fit%statistics%samples == 0) return
      first = index_of_mode(fit, r, k)
      c = fit%quantities(first:first + 1)%value
      associate (z => experiment%measured, m => size(experiment%measured), &
         cosine => fit%jacobian(row + 1:row + size(residual), first), &
         sine => fit%jacobian(row + 1:row + size(residual), first + 1))
         total = sum((z - sum(z)/m)**2)
         if (total > 0) share = sum((c(1)*cosine + c(2)*sine)**2)/fit%weight(r)**2/total
      end associate
      covariance = fit%statistics%covariance(first:first + 1, first:first + 1)
      determinant = covariance(1, 1)*covariance(2, 2) - covariance(1, 2)**2
      if (.not. (determinant > 0 .and. determinant < huge(1.0_wp))) return
      gain = fit%statistics%variance*(c(1)**2*covariance(2, 2) - 2*c(1)*c(2)*covariance(1, 2) &
         + c(2)**2*covariance(1, 1))/determinant/fit%weight(r)**2/noise_near(experiment%samples, &
         residual, aimag(s)/two_pi, -real(s))
   end subroutine weigh_mode

   !> Returns the index in `quantities` of the first of the two amplitudes of mode k in record r.
   pure integer function index_of_mode(fit, r, k) result(first)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: r, k
      character(len=name_length) :: name
      integer :: i

      ! Further channels of a motion share the amplitudes of the first channel.
      first = 0
      do i = r, 1, -1
         name = name_of('cos_'//to_text(k), merge(0, i, size(fit%scenario%structures) == 1))
         do first = size(fit%quantities), 1, -1
            if (fit%quantities(first)%name == name) return
         end do
      end do
   end function index_of_mode

   !> Returns a sentence on the record that the fit explains least, if that is too little and the
   !> residuals are not white; else ''.
   function describe_misfit(qualities, fit) result(text)
      type(quality_t), intent(in) :: qualities(:)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: text
      integer :: r

      text = ''
      r = minloc(qualities%fit_percent, dim=1)
      if (fit%check%white .or. .not. qualities(r)%fit_percent < least_percent) return
      text = 'the model explains '//to_text(nint(qualities(r)%fit_percent))// &
         ' % of record '//to_text(r)//', and what is left is not noise'
   end function describe_misfit

   !> Returns a sentence on the parameters that all modes determine, but not the modes seen in the
   !> records; else ''.
   !>
   !> s   (modes, records) roots [1/time]
   !> ds  (modes, records, free) their derivatives
   function describe_undetermined(sightings, fit, s, ds) result(text)
      type(sighting_t), intent(in) :: sightings(:)
      type(stage_fit_t), intent(in) :: fit
      complex(wp), intent(in) :: s(:, :), ds(:, :, :)
      character(len=:), allocatable :: text
      type(belief_t) :: beliefs(size(fit%free))
      real(wp) :: values(size(fit%free))
      logical, dimension(size(s, 1), size(s, 2)) :: visible, there
      logical :: lost(size(fit%free))
      integer :: owners(size(fit%free))
      integer :: k

      text = ''
      there = .false.
      visible = .false.
      do k = 1, size(sightings)
         associate (mode => sightings(k)%mode, record => sightings(k)%record)
            there(mode, record) = .true.
            visible(mode, record) = sightings(k)%verdict == 'seen'
         end associate
      end do
      values = fit%fit%estimate
      owners = fit%quantities(:size(values))%record
      beliefs = beliefs_about(fit%scenario, fit%free, owners, values, fit%priors)
      lost = resting(s, ds, visible, beliefs, values) .and. &
         .not. resting(s, ds, there, beliefs, values)
      do k = 1, size(lost)
         if (.not. lost(k)) cycle
         text = text//trim(merge('  ', ', ', text == ''))//' '//trim(fit%quantities(k)%name)
      end do
      if (text == '') return
      text = text(2:)//': determined by modes alone that are not in the record'
   end function describe_undetermined

end module beamid_verdicts
