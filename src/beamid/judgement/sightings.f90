!> What a record shows of the modes of the fitted model, and which spectral lines of a record the
!> model leaves unexplained.
module beamid_sightings
   use beamid_decaying_lines, only: find_lines, refine_lines
   use beamid_driven_modes, only: weigh_driven_modes
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: two_pi, wp
   use beamid_spectra, only: line_t, near_mains, noise_near, order_of_multiple
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: to_text
   use beamid_trials, only: is_multiple, least_gain
   use beamid_unknowns, only: name_length, name_of
   implicit none
   private

   public :: sighting_t, modes_in_record, find_lines_left, find_missed_modes

   !> One mode of the model in one record, or a spectral line of the record that no mode explains.
   type :: sighting_t
      integer :: record = 1
      integer :: mode = 1             !< 0: a spectral line without a mode
      real(wp) :: model = 0           !< frequency of the model [1/time]; 0: a line without a mode
      real(wp) :: peak = 0            !< frequency of the spectral line [1/time]; 0: none
      real(wp) :: share = 0           !< share of the record's variance
      !> of a mode: 'seen', 'unseen', 'harmonic' (perhaps a multiple of a stronger line) or 'mains'
      !> (of 50 or 60 Hz); of a line without a mode: 'harmonic', 'mains' or 'unexplained'
      character(len=11) :: verdict = 'unseen'
   end type sighting_t

   !> Largest number of spectral lines per record.
   integer, parameter :: most_lines = 12

contains

   !> Returns what one record shows of each mode.
   !>
   !> A mode is seen if a spectral line stands beside it, or if it lies below the Nyquist frequency
   !> and reduces J by more than noise would. In a free motion, a mode on a multiple of the first
   !> mode's frequency or of the mains may be that multiple.
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
               if (gain > least_gain .and. sighting%verdict == 'unseen' .and. &
                  2*span*sighting%model < size(t)) sighting%verdict = 'seen'
               if (sighting%verdict == 'seen' .and. modes > 0 .and. is_multiple(s, k, gain, &
                  lines, span)) sighting%verdict = merge('mains   ', 'harmonic', &
                  near_mains(sighting%model, span, 0.0_wp))
            end associate
            found = [found, sighting]
         end do
      end associate
      if (fit%scenario%excitations(r)%modes == 0 .and. any(found%verdict == 'unseen')) &
         call see_driven_modes(experiment, fit%scenario%excitations(r), residual, s, found)
   end function modes_in_record

   !> In a record whose force is known, changes 'unseen' into 'seen' for modes that reduce J by more
   !> than noise would, and sets the share of all 'unseen' modes.
   !>
   !> residual  (m) residuals of this record [length/time**2]
   !> s         (all) roots of its structure [1/time]
   subroutine see_driven_modes(experiment, excitation, residual, s, modes)
      type(experiment_t), intent(in) :: experiment
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: residual(:)
      complex(wp), intent(in) :: s(:)
      type(sighting_t), intent(inout) :: modes(:)
      real(wp), dimension(size(modes)) :: share, gain

      call weigh_driven_modes(excitation, experiment%samples, experiment%measured, residual, &
         s(modes%mode), share, gain)
      where (modes%verdict == 'unseen') modes%share = share
      where (modes%verdict == 'unseen' .and. gain > least_gain) modes%verdict = 'seen'
   end subroutine see_driven_modes

   !> Finds the spectral lines that a fit leaves in the residuals of one record.
   !>
   !> A line near a mode belongs to this mode, whose amplitude or frequency then does not change as
   !> the model says. Any other line is one without a mode. It is reported if its amplitude is at
   !> least one per cent of that of the record, or if the nearest mode is unseen: then the line may
   !> be this mode. A weak line at a multiple of the first mode's frequency, and a line at a
   !> multiple of 50 or 60 Hz, are named as such, although each may still be a mode. If there
   !> are such named lines, the search is repeated without them, because they can mask others.
   !>
   !> r          number of the record
   !> residual   (m) its residuals [length/time**2]
   !> s          (modes) roots of its structure [1/time]
   !> higher     (any number) the same roots and those that follow; 0: none
   !> unseen     (fitted) whether a mode that the fit has used is 'unseen'
   !> rejected   whether the fit has rejected the modes beyond these
   !> found      lines without a mode
   !> departing  (fitted) whether a line belongs to the mode
   !> rest       (m) the residuals; if there are named lines, without these and without the mean
   subroutine find_lines_left(experiment, r, residual, s, higher, unseen, rejected, found, &
      departing, rest)
      type(experiment_t), intent(in) :: experiment
      integer, intent(in) :: r
      real(wp), intent(in) :: residual(:)
      complex(wp), intent(in) :: s(:), higher(:)
      logical, intent(in) :: unseen(:), rejected
      type(sighting_t), allocatable, intent(out) :: found(:)
      logical, intent(out) :: departing(:)
      real(wp), allocatable, intent(out) :: rest(:)
      type(line_t), allocatable :: named(:), again(:)
      type(sighting_t), allocatable :: others(:)

      rest = residual
      call search(residual, found, named, departing)
      if (size(named) == 0) return
      call refine_lines(experiment%samples, residual, named, rest)
      call search(rest, others, again, departing)
      found = [pack(found, found%verdict /= 'unexplained'), &
         pack(others, others%verdict == 'unexplained')]

   contains

      !> Searches some residuals.
      !>
      !> lines  as `found`
      !> named  lines at a multiple of the first mode's frequency or of the mains, of any size
      !> near   as `departing`
      subroutine search(values, lines, named, near)
         real(wp), intent(in) :: values(:)
         type(sighting_t), allocatable, intent(out) :: lines(:)
         type(line_t), allocatable, intent(out) :: named(:)
         logical, intent(out) :: near(:)
         !> Shares of the variance of the record: of a line that is reported, of a line that is
         !> taken for a multiple of another, and of residuals that may be errors of computation.
         real(wp), parameter :: least_share = 1e-4_wp, weak = 0.02_wp, negligible = 1e-8_wp
         type(line_t), allocatable :: left(:)
         type(sighting_t) :: sighting
         real(wp) :: first, highest, share, span
         logical :: is_fitted, is_near, is_unseen
         integer :: k, mode

         allocate (lines(0), named(0))
         near = .false.
         first = aimag(s(1))/two_pi
         associate (t => experiment%samples, z => experiment%measured, m => size(values))
            share = sum(values**2)/max(sum((z - sum(z)/m)**2), tiny(share))
            if (share < negligible) return
            span = t(m) - t(1)
            highest = 2*maxval(aimag(s))/two_pi
            call find_lines(t, values, highest, most_lines, left)
            call add_higher_lines(t, values, highest, higher, span, left)
         end associate
         do k = 1, size(left)
            associate (line => left(k))
               mode = minloc(abs(line%frequency - aimag(s)/two_pi), dim=1)
               is_fitted = mode <= size(unseen)
               is_unseen = .false.
               if (is_fitted) is_unseen = unseen(mode) .and. line%frequency <= highest
               is_near = belongs_to_mode(line, s(mode:mode), merge(0.05_wp, 0.01_wp, is_fitted &
                  .and. .not. is_unseen), span)
               if (is_near .and. is_fitted) near(mode) = .true.
               if (is_near .and. (is_fitted .or. .not. rejected)) cycle
               sighting = sighting_t(r, 0, 0.0_wp, line%frequency, min(1.0_wp, &
                  line%energy*share), 'unexplained')
               if (sighting%share < weak .and. order_of_multiple(line%frequency, first, &
                  1/(span*first)) >= 2) sighting%verdict = 'harmonic'
               if (near_mains(line%frequency, span, 0.0_wp)) sighting%verdict = 'mains'
               if (sighting%verdict /= 'unexplained') named = [named, line]
               if (line%energy*share >= least_share .or. is_unseen) lines = [lines, sighting]
            end associate
         end do
      end subroutine search

   end subroutine find_lines_left

   !> Adds the spectral lines above a frequency, except those of higher modes of the model.
   !>
   !> limit   frequency [1/time]
   !> higher  roots of the modes [1/time]; 0: none
   !> span    length of the record [time]
   subroutine add_higher_lines(t, residual, limit, higher, span, lines)
      real(wp), intent(in) :: t(:), residual(:), limit, span
      complex(wp), intent(in) :: higher(:)
      type(line_t), allocatable, intent(inout) :: lines(:)
      type(line_t), allocatable :: found(:)
      integer :: k

      call find_lines(t, residual, (size(t) - 1)/(2*span), most_lines, found)
      do k = 1, size(found)
         if (found(k)%frequency <= limit) cycle
         if (belongs_to_mode(found(k), higher, 0.05_wp, span)) cycle
         lines = [lines, found(k)]
      end do
   end subroutine add_higher_lines

   !> Finds the modes whose motion is a decaying oscillation that the model misses: the frequency or
   !> the decay rate of the model is wrong.
   !>
   !> Decaying oscillations of any frequencies and rates are fitted to the record, one for each
   !> mode. If no line is left near the mode, its motion is such an oscillation. Otherwise its
   !> frequency or its rate is not constant.
   !>
   !> s       (modes) roots of the fitted modes [1/time]
   !> modes   what the record shows of them
   !> missed  (modes) on entry the modes to test
   subroutine find_missed_modes(experiment, s, modes, missed)
      type(experiment_t), intent(in) :: experiment
      complex(wp), intent(in) :: s(:)
      type(sighting_t), intent(in) :: modes(:)
      logical, intent(inout) :: missed(:)
      type(line_t) :: motion(size(s))
      type(line_t), allocatable :: left(:)
      real(wp) :: rest(size(experiment%samples)), span
      integer :: k

      motion%frequency = aimag(s)/two_pi
      motion%decay = -real(s)
      do k = 1, size(modes)
         if (modes(k)%mode > size(s) .or. .not. modes(k)%peak > 0) cycle
         motion(modes(k)%mode)%frequency = modes(k)%peak
      end do
      associate (t => experiment%samples)
         span = t(size(t)) - t(1)
         call refine_lines(t, experiment%measured, motion, rest)
         call find_lines(t, rest, 2*maxval(motion%frequency), most_lines, left)
      end associate
      do k = 1, size(left)
         missed = missed .and. .not. abs(left(k)%frequency - motion%frequency) < max(3/span, &
            left(k)%decay/2, 0.01_wp*motion%frequency)
      end do
   end subroutine find_missed_modes

   !> Tells whether a spectral line is so close to one of some modes that it belongs to it.
   !>
   !> s          (k) roots of the modes [1/time]
   !> tolerance  relative difference of the frequencies that is allowed
   !> span       length of the record [time]
   pure logical function belongs_to_mode(line, s, tolerance, span)
      type(line_t), intent(in) :: line
      complex(wp), intent(in) :: s(:)
      real(wp), intent(in) :: tolerance, span

      belongs_to_mode = any(abs(line%frequency - aimag(s)/two_pi) < max(3/span, line%decay/2, &
         tolerance*aimag(s)/two_pi))
   end function belongs_to_mode

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

end module beamid_sightings
