!> Judges a fit: the share of each record that it explains, which modes the records show, and
!> whether a parameter is determined only by modes that no record shows.
module beamid_verdicts
   use beamid_early_residuals, only: find_early_residuals
   use beamid_equations, only: new_equations, equations_t
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: two_pi, wp
   use beamid_modal, only: modal_t
   use beamid_model_roots, only: belief_t, beliefs_about
   use beamid_parameters, only: offset, parameters
   use beamid_qualities, only: describe_misfit, describe_silence, quality_of, quality_of_lines, &
      quality_t
   use beamid_responses, only: work_t
   use beamid_sightings, only: find_lines_left, find_missed_modes, modes_in_record, sighting_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: is_coefficient, of_E, structure_t
   use beamid_trials, only: resting
   implicit none
   private

   public :: verdict_t, sighting_t, new_verdict, implausible, ratio_to_case

   !> The verdict on a fit.
   type :: verdict_t
      type(quality_t), allocatable :: qualities(:)    !< (records)
      type(sighting_t), allocatable :: sightings(:)   !< modes and lines without one
      character(len=:), allocatable :: no_fit         !< why the fit is rejected; '': it is accepted
      !> why no parameter counts as determined although the fit is accepted; '': no such reason
      character(len=:), allocatable :: caution
      !> until when a record contains more than the modes of the fit; '': no record does
      character(len=:), allocatable :: early
      !> (free) change of the searched variables if these early samples are left out
      real(wp), allocatable :: early_change(:)
      !> modes at whose frequencies the fit leaves a spectral line, as lists; '': none. missed: the
      !> record shows a decaying oscillation of another frequency or rate than the model.
      !> departures: all others
      character(len=:), allocatable :: departures, missed
      !> whether the fit starts from the spectral lines of the records, because it was rejected from
      !> the start values of the case
      logical :: starts_again = .false.
      !> largest ratio of the residuals of a record to the white noise in it
      real(wp) :: misfit = 1
      !> (free) parameters that are determined only by modes that are not 'seen'
      logical, allocatable :: lost(:)
      !> lowest mode that is not 'seen' in any record, if parameters are lost; otherwise 0
      integer :: missing_mode = 0
      character(len=:), allocatable :: lost_names   !< names of the lost parameters, as a list
      complex(wp), allocatable :: s(:, :)           !< (modes, records) roots [1/time]; 0: none
   end type verdict_t

   !> Share of the variance of a record above which a spectral line that the model cannot explain
   !> rejects the fit.
   real(wp), parameter :: most_unexplained = 0.05_wp
   !> Largest ratio of residuals to noise with which parameters may count as determined, and the
   !> largest for a record in time with a known excitation whose residuals exceed the noise around
   !> mode 1 or 2. A known excitation predicts the size of each mode as well: no free amplitude
   !> takes up what the model lacks, and the residuals do not show how far estimates are shifted.
   real(wp), parameter :: gross = 10, gross_if_driven = 2

   !> Number of modes to judge if fewer were fitted, and number of modes whose frequencies are
   !> compared with the lines that a fit leaves.
   integer, parameter :: usual_modes = 2, most_modes = 12

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
      complex(wp), allocatable :: s(:, :), ds(:, :, :), higher(:, :)
      type(sighting_t), allocatable :: modes(:), lines(:)
      logical, allocatable :: departing(:), missed(:)
      real(wp), allocatable :: limits(:), misfits(:), rest(:)
      integer :: first, fitted, k, r

      call roots_of_fit(mesh, fit, s, ds, higher, error)
      if (allocated(error)) return
      allocate (verdict%qualities(size(experiments)), verdict%sightings(0), &
         verdict%lost(size(fit%free)), departing(size(s, 1)))
      verdict%lost = .false.
      verdict%departures = ''
      verdict%missed = ''
      allocate (limits(size(experiments)), source=gross)
      first = 0
      do r = 1, size(experiments)
         associate (experiment => experiments(r), m => size(experiments(r)%measured))
            associate (residual => fit%residual(first + 1:first + m))
               if (size(experiment%samples) == 0) then
                  verdict%qualities(r) = quality_of_lines(experiment, residual)
               else
                  call judge_record()
               end if
            end associate
            first = first + m
         end associate
      end do
      verdict%no_fit = fit%doubt
      verdict%caution = ''
      if (fit%note /= '') verdict%caution = &
         'the program keeps a parameter fixed that was to be estimated'
      associate (q => verdict%qualities)
         misfits = merge(q%rms_rest/max(q%floor, tiny(1.0_wp)), 1.0_wp, &
            q%rms_rest > 0 .and. .not. q%is_exact)
      end associate
      verdict%misfit = maxval(misfits)
      r = maxloc(misfits/limits, dim=1)
      if (misfits(r) > limits(r)) then
         verdict%caution = 'the residuals are '//rounded(misfits(r), 2)//' times the noise of '
         if (size(limits) == 1) verdict%caution = verdict%caution//'the record'
         if (size(limits) > 1) verdict%caution = verdict%caution//'record '//to_text(r)
      end if
      verdict%early = ''
      if (verdict%departures == '' .and. verdict%missed == '') call find_early_residuals( &
         experiments, fit, s, verdict%early_change, verdict%early)
      if (verdict%no_fit == '') call describe_misfit(verdict%qualities, fit, verdict%no_fit)
      if (verdict%no_fit /= '') call add_mean(experiments, fit, verdict%no_fit)
      call judge_lines(verdict)
      if (verdict%no_fit == '' .and. all(experiments%excitation%modes > 0)) &
         call find_lost_parameters(fit, s, ds, verdict)
      if (verdict%no_fit == '') call describe_silence(verdict%qualities, fit, &
         any(fit%quantities%parameter == offset), verdict%no_fit)
      call move_alloc(s, verdict%s)

   contains

      !> Judges record r, a time record.
      subroutine judge_record()
         associate (experiment => experiments(r), residual => fit%residual(first + 1:first + &
            size(experiments(r)%measured)))
            modes = modes_in_record(experiment, r, first, residual, fit, s(:, r))
            ! A force may excite every mode; `modes` is 0 then.
            fitted = size(s, 1)
            if (experiment%excitation%modes > 0) fitted = fit%scenario%excitations(r)%modes
            call find_lines_left(experiment, r, residual, s(:, r), higher(:, r), &
               [(any(modes%mode == k .and. modes%verdict == 'unseen'), k=1, fitted)], &
               fit%note /= '', lines, departing(:fitted), rest)
            verdict%qualities(r) = quality_of(experiment, residual, rest, fit)
            verdict%sightings = [verdict%sightings, modes, lines]
            missed = departing(:fitted)
            if (experiment%excitation%modes == 0) then
               missed = .false.
               if (any(departing(:fitted))) limits(r) = gross_if_driven
            else if (any(missed)) then
               call find_missed_modes(experiment, s(:fitted, r), modes, missed)
            end if
            call add_departures(departing(:fitted) .and. .not. missed, s(:fitted, r), &
               merge(r, 0, size(experiments) > 1), verdict%departures)
            call add_departures(missed, s(:fitted, r), merge(r, 0, size(experiments) > 1), &
               verdict%missed)
         end associate
      end subroutine judge_record

   end subroutine new_verdict

   !> Names the first estimate that nobody would expect from the values of the case; '' if there is
   !> none. A wrong table or unit may be fitted well by such a value.
   !>
   !> given  structure with the values of the case
   function implausible(given, fit) result(text)
      type(structure_t), intent(in) :: given
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: text
      !> Largest factors between estimate and case: a wrong choice of the material explains less for
      !> E, and a poor guess less for a mass.
      real(wp), parameter :: most_modulus = 5, most_mass = 30
      real(wp) :: ratio
      integer :: k

      text = ''
      do k = 1, size(fit%free)
         ratio = ratio_to_case(given, fit, k)
         if (.not. abs(log(ratio)) > log(merge(most_modulus, most_mass, fit%free(k) == of_E))) cycle
         text = trim(fit%quantities(k)%name)//' is '//rounded(ratio, 2)//' times the value of '// &
            'the case; if the estimate is right, correct the case'
         return
      end do
   end function implausible

   !> Returns the ratio of an estimate of E or of a mass to the value of the case; 1 for other
   !> parameters, and without such a value.
   !>
   !> given  structure with the values of the case
   !> k      place of the parameter among the free ones
   pure real(wp) function ratio_to_case(given, fit, k) result(ratio)
      type(structure_t), intent(in) :: given
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k
      real(wp) :: value

      ratio = 1
      associate (q => fit%quantities(k), p => fit%free(k))
         if (is_coefficient(p)) return
         if (p /= of_E .and. .not. all(parameters(p)%unit == [1, 0, 0])) return
         value = given%get(p)
         if (value > 0 .and. q%value > 0) ratio = q%value/value
      end associate
   end function ratio_to_case

   !> Adds modes to a list, with their frequencies.
   !>
   !> departing   (modes) whether the residuals exceed the noise around the mode
   !> s           (modes) roots of the modes [1/time]
   !> record      number of the record; 0: there is only one
   !> departures  list so far
   subroutine add_departures(departing, s, record, departures)
      logical, intent(in) :: departing(:)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: record
      character(len=:), allocatable, intent(inout) :: departures
      integer :: k

      do k = 1, size(departing)
         if (.not. departing(k)) cycle
         if (departures /= '') departures = departures//', '
         departures = departures//'mode '//to_text(k)//' ('//to_text(aimag(s(k))/two_pi)//')'
         if (record > 0) departures = departures//' of record '//to_text(record)
      end do
   end subroutine add_departures

   !> Rejects a fit, or its claims, because of spectral lines that the model cannot explain.
   subroutine judge_lines(verdict)
      type(verdict_t), intent(inout) :: verdict
      character(len=:), allocatable :: text
      integer :: k

      k = maxloc(verdict%sightings%share, dim=1, mask=verdict%sightings%verdict == 'unexplained')
      if (k == 0) return
      associate (line => verdict%sightings(k))
         text = 'the model cannot explain a spectral line at '//to_text(line%peak)//' with '// &
            to_text(100*line%share)//' % of the energy of record '//to_text(line%record)
         if (line%share > most_unexplained) then
            if (verdict%no_fit /= '') verdict%no_fit = verdict%no_fit//'; '
            verdict%no_fit = verdict%no_fit//text
         end if
      end associate
      verdict%caution = text
   end subroutine judge_lines

   !> Computes the lowest oscillating roots of the fitted structures, as many as modes were fitted
   !> but at least `usual_modes`, and their derivatives.
   !>
   !> s       (modes, records) roots [1/time]; 0 where the mesh has fewer
   !> ds      (modes, records, free) derivatives with respect to the free parameters; 0 for
   !>         parameters of another record
   !> higher  (most_modes, records) the same roots and those that follow; 0 where the mesh has
   !>         fewer, or they cannot be found
   !> error   the roots cannot be found
   subroutine roots_of_fit(mesh, fit, s, ds, higher, error)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      complex(wp), allocatable, intent(out) :: s(:, :), ds(:, :, :), higher(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(work_t) :: work
      complex(wp), allocatable :: found(:), slopes(:, :)
      type(error_t), allocatable :: failed
      logical, allocatable :: together(:)
      integer :: modes, n, p, r

      associate (structures => fit%scenario%structures)
         modes = max(usual_modes, maxval(fit%scenario%excitations%modes))
         allocate (s(modes, size(structures)), ds(modes, size(structures), size(fit%free)))
         s = 0
         ds = 0
         allocate (higher(most_modes, size(structures)), source=(0.0_wp, 0.0_wp))
         do r = 1, size(structures)
            galerkin = galerkin_of(mesh, structures(r), moving=fit%free)
            call solver%prepare(galerkin, error)
            if (allocated(error)) return
            equations = new_equations(galerkin, structures(r))
            n = min(modes, galerkin%space%n)
            call solver%lowest_roots(equations, fit%free, n, found, slopes, together, work, error)
            if (allocated(error)) return
            s(:size(found), r) = found
            do p = 1, size(fit%free)
               if (any(fit%quantities(p)%record == [0, r])) ds(:size(found), r, p) = slopes(:, p)
            end do
            n = min(most_modes, galerkin%space%n/2)
            call solver%lowest_roots(equations, [integer ::], n, found, slopes, together, work, &
               failed)
            if (.not. allocated(failed)) higher(:size(found), r) = found
         end do
      end associate
   end subroutine roots_of_fit

   !> Adds to a rejection that most of the residuals of a time record is a constant.
   subroutine add_mean(experiments, fit, text)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable, intent(inout) :: text
      real(wp), allocatable :: residual(:)
      integer :: last, r

      last = 0
      do r = 1, size(experiments)
         residual = fit%residual(last + 1:last + size(experiments(r)%measured))
         last = last + size(residual)
         if (size(experiments(r)%samples) > 0 .and. sum(residual)**2 > 0.5_wp*size(residual) &
            *sum(residual**2)) exit
      end do
      if (r <= size(experiments)) text = text//'; the mean of the residuals is not 0: add '// &
         '''offset'' to free'
   end subroutine add_mean

   !> Finds the parameters that all modes determine, but not the modes seen in the records, and
   !> rejects the fit because of them.
   !>
   !> s        (modes, records) roots [1/time]
   !> ds       (modes, records, free) their derivatives
   !> verdict  with sightings; on return with `lost`, `missing_mode` and `no_fit`
   subroutine find_lost_parameters(fit, s, ds, verdict)
      type(stage_fit_t), intent(in) :: fit
      complex(wp), intent(in) :: s(:, :), ds(:, :, :)
      type(verdict_t), intent(inout) :: verdict
      type(belief_t) :: beliefs(size(fit%free))
      real(wp) :: values(size(fit%free))
      logical, dimension(size(s, 1), size(s, 2)) :: visible, there
      integer :: owners(size(fit%free))
      integer :: k

      there = .false.
      visible = .false.
      do k = 1, size(verdict%sightings)
         associate (mode => verdict%sightings(k)%mode, record => verdict%sightings(k)%record)
            if (mode == 0) cycle
            there(mode, record) = .true.
            visible(mode, record) = verdict%sightings(k)%verdict == 'seen'
         end associate
      end do
      values = fit%fit%estimate
      owners = fit%quantities(:size(values))%record
      beliefs = beliefs_about(fit%scenario, fit%free, owners, values, fit%priors)
      verdict%lost = resting(s, ds, visible, beliefs, values) .and. &
         .not. resting(s, ds, there, beliefs, values)
      if (.not. any(verdict%lost)) return
      verdict%missing_mode = findloc(any(visible, dim=2), .false., dim=1)
      verdict%lost_names = ''
      do k = 1, size(values)
         if (.not. verdict%lost(k)) cycle
         if (verdict%lost_names /= '') verdict%lost_names = verdict%lost_names//', '
         verdict%lost_names = verdict%lost_names//trim(fit%quantities(k)%name)
      end do
      verdict%no_fit = verdict%lost_names//': only modes that are not in the record determine '// &
         'them. Fix these parameters, or state a &prior'
   end subroutine find_lost_parameters

end module beamid_verdicts
