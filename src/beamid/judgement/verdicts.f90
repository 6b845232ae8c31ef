!> Whether a fit is one: how much of each record it explains, which modes are there, and whether a
!> parameter rests on modes that are not.
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

   !> How much of one record is explained.
   type :: quality_t
      integer :: samples = 0
      real(wp) :: rms_signal = 0      !< about its mean
      real(wp) :: rms_residual = 0
      real(wp) :: fit_percent = 0     !< 100 (1 - rms_residual/rms_signal)
      real(wp) :: noise_sd = 0        !< from the residuals and their degrees of freedom
      real(wp) :: effective = 0       !< samples
   end type quality_t

   !> One mode in one record.
   type :: sighting_t
      integer :: record = 1, mode = 1
      real(wp) :: model = 0           !< frequency [1/time]
      real(wp) :: peak = 0            !< of the record beside it; 0: none
      real(wp) :: share = 0           !< of the record's energy
      character(len=8) :: verdict = 'unseen'   !< or seen, harmonic, mains
   end type sighting_t

   type :: verdict_t
      type(quality_t), allocatable :: qualities(:)    !< (records)
      type(sighting_t), allocatable :: sightings(:)
      character(len=:), allocatable :: no_fit         !< why the fit is none; ''
   end type verdict_t

   !> Less than this is no fit where the residuals are not white.
   real(wp), parameter :: least_percent = 50

   integer, parameter :: most_lines = 12, usual_modes = 2
   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

contains

   !> The verdict on the fit of one stage.
   !>
   !> error  the structure's roots cannot be found
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
         associate (experiment => experiments(r), m => size(experiments(r)%samples))
            associate (rest => fit%residual(first + 1:first + m))
               verdict%qualities(r) = quality(experiment%measured, rest, fit)
               verdict%sightings = [verdict%sightings, sightings(experiment, r, first, &
                  rest, fit, s(:, r))]
            end associate
            first = first + m
         end associate
      end do
      verdict%no_fit = fit%doubt
      if (verdict%no_fit == '') verdict%no_fit = misfit(verdict%qualities, fit)
      if (verdict%no_fit == '' .and. all(experiments%excitation%modes > 0)) &
         verdict%no_fit = without_hold(verdict%sightings, fit, s, ds)
   end subroutine new_verdict

   !> Oscillating roots of the fitted structures: as many as were fitted, or two.
   !>
   !> s   (modes, records) [1/time]
   !> ds  (modes, records, free), 0 by what belongs to another record
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

   !> measured, rest  (m) of one record
   function quality(measured, rest, fit)
      real(wp), intent(in) :: measured(:), rest(:)
      type(stage_fit_t), intent(in) :: fit
      type(quality_t) :: quality
      integer :: m

      m = size(measured)
      quality%samples = m
      quality%rms_signal = sqrt(sum((measured - sum(measured)/m)**2)/m)
      quality%rms_residual = sqrt(sum(rest**2)/m)
      if (quality%rms_signal > 0) quality%fit_percent = 100*(1 - quality%rms_residual &
         /quality%rms_signal)
      quality%noise_sd = quality%rms_residual
      associate (statistics => fit%statistics)
         if (statistics%freedom > 0) quality%noise_sd = quality%rms_residual &
            *sqrt(max(1.0_wp, statistics%samples/real(statistics%freedom, wp)))
      end associate
      quality%effective = effective_samples(rest)
   end function quality

   !> What one record shows of each mode.
   !>
   !> row   of all residuals behind which its own begin
   !> rest  (m) these
   !> s     (modes) roots
   function sightings(experiment, r, row, rest, fit, s) result(found)
      type(experiment_t), intent(in) :: experiment
      integer, intent(in) :: r, row
      real(wp), intent(in) :: rest(:)
      type(stage_fit_t), intent(in) :: fit
      complex(wp), intent(in) :: s(:)
      type(sighting_t), allocatable :: found(:)
      type(line_t), allocatable :: lines(:)
      type(sighting_t) :: one
      real(wp) :: gain, span
      integer :: k

      allocate (found(0))
      associate (t => experiment%samples, z => experiment%measured)
         span = t(size(t)) - t(1)
         call find_lines(t, z, 2*maxval(aimag(s))/two_pi, most_lines, lines)
         do k = 1, size(s)
            if (.not. aimag(s(k)) > 0) cycle
            one = sighting_t(record=r, mode=k, model=aimag(s(k))/two_pi)
            associate (modes => fit%scenario%excitations(r)%modes)
               if (k <= modes .or. fit%note == '') call look_for(lines, span, one)
               gain = 0
               if (k <= modes) call look_into(fit, r, k, row, experiment, rest, s(k), one%share, &
                  gain)
            end associate
            if (gain > least_gain .and. one%verdict == 'unseen') one%verdict = 'seen'
            if (one%verdict == 'seen' .and. is_multiple(s, k, gain, lines, span)) &
               one%verdict = merge('mains   ', 'harmonic', near_mains(one%model, span, 0.0_wp))
            if (one%verdict == 'seen' .and. k <= fit%scenario%excitations(r)%modes) then
               if (blends(fit, r, row, t, rest, s, k)) one%verdict = 'harmonic'
            end if
            found = [found, one]
         end do
      end associate
   end function sightings

   !> Whether a mode and the multiple of the first one beside it are one broad line: with that
   !> multiple in the model as well J would be less by more than chance, and an estimate further
   !> away than its interval is wide. The multiple decays as the first mode does, or as its power.
   !>
   !> row      of all residuals behind which those of record r begin
   !> t, rest  (m) of that record
   !> s        (modes) roots
   logical function blends(fit, r, row, t, rest, s, k)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: r, row, k
      real(wp), intent(in) :: t(:), rest(:)
      complex(wp), intent(in) :: s(:)
      real(wp), parameter :: independent = 1e-10_wp
      integer, parameter :: highest = 12
      real(wp) :: a(size(fit%jacobian, 1), size(fit%jacobian, 2) + 4), step(size(a, 2)), &
         size_of(size(a, 2)), gain
      complex(wp) :: multiple(size(t))
      integer :: j, m, n, order, rank

      blends = .false.
      if (k < 2 .or. fit%statistics%samples == 0 .or. size(a, 1) <= size(a, 2)) return
      m = size(t)
      n = size(fit%jacobian, 2)
      order = nint(aimag(s(k))/aimag(s(1)))
      ! Beside each other: no further apart than both lines are wide together.
      if (order < 2 .or. order > highest .or. abs(aimag(s(k)) - order*aimag(s(1))) > &
         2*abs(real(s(k))) + 2*order*abs(real(s(1))) + 2*two_pi/(t(m) - t(1))) return
      a(:, :n) = fit%jacobian
      a(:, n + 1:) = 0
      do j = 1, 2
         multiple = exp(cmplx(merge(1, order, j == 1)*real(s(1)), order*aimag(s(1)), wp)*(t - t(1)))
         a(row + 1:row + m, n + 2*j - 1) = real(multiple)
         a(row + 1:row + m, n + 2*j) = aimag(multiple)
      end do
      size_of = norm2(a, dim=1)
      if (.not. all(size_of > 0)) return
      call least_squares_step(a, fit%fit%residual, 1/size_of, spread(.true., 1, size(step)), &
         independent, step, rank)
      gain = (sum(fit%fit%residual**2) - sum((fit%fit%residual + matmul(a, step))**2))/ &
         noise_near(t, rest, aimag(s(k))/two_pi, -real(s(k)))/fit%weight(r)**2
      if (gain > least_gain) blends = any(abs(step(:size(fit%free))) > &
         2*fit%statistics%corrected_half_width(:size(fit%free)))
   end function blends

   !> The line beside a mode.
   pure subroutine look_for(lines, span, one)
      type(line_t), intent(in) :: lines(:)
      real(wp), intent(in) :: span
      type(sighting_t), intent(inout) :: one
      integer :: n

      if (size(lines) == 0) return
      n = minloc(abs(lines%frequency - one%model), dim=1)
      if (abs(lines(n)%frequency - one%model) > max(1/span, 1e-2_wp*one%model)) return
      one%peak = lines(n)%frequency
      one%share = min(1.0_wp, lines(n)%energy)
      one%verdict = 'seen'
      if (lines(n)%harmonic > 0) one%verdict = 'harmonic'
      if (lines(n)%mains) one%verdict = 'mains'
   end subroutine look_for

   !> What a free mode has in a fit: its share of the energy, and what J falls by with it over the
   !> noise around its frequency.
   subroutine look_into(fit, r, k, row, experiment, rest, s, share, gain)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: r, k, row
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: rest(:)
      complex(wp), intent(in) :: s
      real(wp), intent(inout) :: share
      real(wp), intent(out) :: gain
      real(wp) :: c(2), covariance(2, 2), determinant, all_of_it
      integer :: first

      gain = 0
      if (fit%statistics%samples == 0) return
      first = place_of_mode(fit, r, k)
      c = fit%quantities(first:first + 1)%value
      associate (z => experiment%measured, m => size(experiment%measured), &
         cosine => fit%jacobian(row + 1:row + size(rest), first), &
         sine => fit%jacobian(row + 1:row + size(rest), first + 1))
         all_of_it = sum((z - sum(z)/m)**2)
         if (all_of_it > 0) share = sum((c(1)*cosine + c(2)*sine)**2)/fit%weight(r)**2/all_of_it
      end associate
      covariance = fit%statistics%covariance(first:first + 1, first:first + 1)
      determinant = covariance(1, 1)*covariance(2, 2) - covariance(1, 2)**2
      if (.not. (determinant > 0 .and. determinant < huge(1.0_wp))) return
      gain = fit%statistics%variance*(c(1)**2*covariance(2, 2) - 2*c(1)*c(2)*covariance(1, 2) &
         + c(2)**2*covariance(1, 1))/determinant/fit%weight(r)**2/noise_near(experiment%samples, &
         rest, aimag(s)/two_pi, -real(s))
   end subroutine look_into

   !> Where the first of the two amplitudes of mode k in record r is among the quantities.
   pure integer function place_of_mode(fit, r, k) result(first)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: r, k
      character(len=name_length) :: name
      integer :: i

      ! Of a further channel they are those of the first.
      first = 0
      do i = r, 1, -1
         name = name_of('cos_'//to_text(k), merge(0, i, size(fit%scenario%structures) == 1))
         do first = size(fit%quantities), 1, -1
            if (fit%quantities(first)%name == name) return
         end do
      end do
   end function place_of_mode

   !> Records of which too little is explained.
   function misfit(qualities, fit) result(text)
      type(quality_t), intent(in) :: qualities(:)
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable :: text
      integer :: r

      text = ''
      r = minloc(qualities%fit_percent, dim=1)
      if (fit%check%white .or. .not. qualities(r)%fit_percent < least_percent) return
      text = 'the model explains '//to_text(nint(qualities(r)%fit_percent))// &
         ' % of record '//to_text(r)//', and what is left is not noise'
   end function misfit

   !> Parameters that are determined by all modes, and not by those that were seen.
   function without_hold(sightings, fit, s, ds) result(text)
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
         associate (one => sightings(k))
            there(one%mode, one%record) = .true.
            visible(one%mode, one%record) = one%verdict == 'seen'
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
   end function without_hold

end module beamid_verdicts
