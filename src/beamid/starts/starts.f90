!> Start values from the record.
!>
!> The spectral lines of the record are assigned to the modes of the model. Fits start from the best
!> assignments and from the values of the case file. Of the fits to which there is no objection, the
!> one with the lowest J gives the start values. If there is none, a fit with one mode fewer and
!> with fewer free parameters takes its place.
module beamid_starts
   use beamid_assignments, only: lines_t
   use beamid_decaying_lines, only: find_lines
   use beamid_errors, only: error_t, failure
   use beamid_fit_setups, only: set_free
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: options_t
   use beamid_model_roots, only: damps, model_roots
   use beamid_residuals, only: kept_t, residual_t
   use beamid_start_choices, only: choice_t, choose, choose_with_fewer, compare, &
      list_rivals, new_choice, rival_t, try_equal_frequencies
   use beamid_start_notes, only: describe_fixed, describe_unknowable
   use beamid_strings, only: to_text
   use beamid_trials, only: inseparable, resting
   use beamid_unknowns, only: quantity_t, stage_t
   implicit none
   private

   public :: automatic_start, findings_t

   !> What the search for start values has found out beside start values; '': nothing.
   type :: findings_t
      !> why a mode does not count, and which parameters are fixed for that reason
      character(len=:), allocatable :: note
      character(len=:), allocatable :: doubt   !< why none of the fits is to be trusted
      type(rival_t), allocatable :: rivals(:)  !< other minima of J
      !> one line for each start whose fit is rejected, with the reason
      character(len=:), allocatable :: rejections
   end type findings_t

   !> Number of modes that are matched if the initial state of the motion is known, and largest
   !> number of spectral lines of a record.
   integer, parameter :: usual_modes = 2, most_lines = 12
   !> Number of samples of a record that trial fits use at most: runs of consecutive samples, spread
   !> over the record. The fit that follows uses all samples.
   integer, parameter :: most_samples = 32768

contains

   !> Finds start values for a stage, and puts them into the scenario of the fit.
   !>
   !> A parameter that no mode determines beside the others, such as rho beside E, stays fixed.
   !>
   !> problem   the fit, with the free parameters of the stage; on return perhaps with fewer modes
   !> stage     on return without the parameters that have to be fixed
   !> options   settings of the search
   !> findings  on entry empty texts; on return what the search has found out about modes and other
   !>           minima
   !> error     no spectral line stands out although the force is known; the model has too few
   !>           modes; no fit converges
   subroutine automatic_start(problem, stage, options, findings, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(inout) :: stage
      type(options_t), intent(in) :: options
      type(findings_t), intent(inout) :: findings
      type(error_t), allocatable, intent(out) :: error
      type(lines_t), allocatable :: lines(:)
      type(kept_t), allocatable :: kept(:)
      integer :: modes, rows
      logical :: is_free_motion

      if (.not. problem%exact) then
         call failure(error, 'start values: from a record only the modal response finds them')
         return
      end if
      is_free_motion = all(problem%scenario%excitations%modes > 0)
      modes = usual_modes
      if (is_free_motion) modes = minval(problem%scenario%excitations%modes)
      call lines_of_records(problem, modes, lines, error)
      if (.not. allocated(error)) then
         rows = problem%rows()
         call problem%thin(most_samples, kept)
         call find_start(problem, stage, options, lines, modes, is_free_motion, rows, findings, &
            error)
         call problem%restore(kept)
         if (.not. allocated(error)) call set_free(problem, stage)
      end if
      if (allocated(error)) error%message = 'start values: '//error%message
   end subroutine automatic_start

   !> Finds the start values, once the spectral lines are known.
   !>
   !> lines   (records) spectral lines
   !> modes   number of modes of the model
   !> rows    number of rows of the problem before it was thinned
   !> others  as of `automatic_start`
   subroutine find_start(problem, stage, options, lines, modes, is_free_motion, rows, findings, &
      error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(inout) :: stage
      type(options_t), intent(in) :: options
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: modes, rows
      logical, intent(in) :: is_free_motion
      type(findings_t), intent(inout) :: findings
      type(error_t), allocatable, intent(out) :: error
      type(choice_t) :: full, fewer
      type(stage_t) :: searched
      type(quantity_t), allocatable :: asked(:)
      logical, allocatable :: undetermined(:), unknowable(:), is_damping(:)
      integer :: needed

      call new_choice(problem, stage, modes, full, error)
      if (.not. allocated(error)) call needed_modes(problem, full, stage%rejected_mode, needed, &
         undetermined, unknowable, is_damping, error)
      if (allocated(error)) return
      asked = full%quantities
      searched = stage
      if (is_free_motion) call leave_unknowable(problem, unknowable, modes, searched, &
         undetermined, is_damping, full, error)
      if (stage%rejected_mode == 0 .and. .not. allocated(error)) &
         call choose(problem, full, lines, needed, options, error)
      if (is_free_motion) call look_for_others(problem, full, lines, needed, undetermined, &
         is_damping, stage%is_whole, options, fewer)
      call full%list_rejections(findings%rejections)
      if (allocated(error) .and. .not. fewer%best > 0) return
      if (allocated(error)) deallocate (error)
      if (full%best == 0 .and. fewer%best > 0) then
         stage = fewer%stage
         problem%scenario = fewer%trials(fewer%best)%start
         call describe_fixed(problem, asked, full, fewer, needed, stage%rejected_mode, &
            findings%note)
      else if (size(full%trials) == 0) then
         call failure(error, 'no fit without mode '//to_text(needed)// &
            ' converges; give start values, or free fewer parameters')
         return
      else
         stage = searched
         call take_best(problem, full, is_free_motion, rows, asked, findings)
      end if
   end subroutine find_start

   !> Leaves out the parameters that no record tells anything about, if it tells of others.
   !>
   !> stage         on return without them
   !> undetermined  (free) on return without them
   !> is_damping    (free) on return without them
   !> choice        on return of the remaining parameters
   !> others        as of `new_choice` and `needed_modes`
   subroutine leave_unknowable(problem, unknowable, modes, stage, undetermined, is_damping, &
      choice, error)
      type(residual_t), intent(inout) :: problem
      logical, intent(in) :: unknowable(:)
      integer, intent(in) :: modes
      type(stage_t), intent(inout) :: stage
      logical, allocatable, intent(inout) :: undetermined(:), is_damping(:)
      type(choice_t), intent(inout) :: choice
      type(error_t), allocatable, intent(out) :: error

      if (.not. any(unknowable) .or. all(unknowable)) return
      stage = stage%without(unknowable)
      undetermined = pack(undetermined, .not. unknowable)
      is_damping = pack(is_damping, .not. unknowable)
      call set_free(problem, stage)
      call new_choice(problem, stage, modes, choice, error)
   end subroutine leave_unknowable

   !> Looks for fits beside the trial fits of a free motion: with two modes of equal frequency, with
   !> fewer modes and parameters, and if no fit is accepted, with another parameter fixed.
   !>
   !> full      trial fits with all parameters; loses its best one if a fit with fewer is better
   !> is_whole  whether no parameter may be exchanged
   !> fewer     trial fits with fewer parameters
   !> others    as of `choose` and `needed_modes`
   subroutine look_for_others(problem, full, lines, needed, undetermined, is_damping, is_whole, &
      options, fewer)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(inout) :: full
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      logical, intent(in) :: undetermined(:), is_damping(:), is_whole
      type(options_t), intent(in) :: options
      type(choice_t), intent(inout) :: fewer

      call try_equal_frequencies(problem, full, needed, options)
      call choose_with_fewer(problem, full, lines, needed, undetermined, options, fewer)
      call compare(problem, full, fewer, lines, needed)
      if (full%best == 0 .and. fewer%best == 0 .and. .not. is_whole) call exchange_fixed(problem, &
         full, lines, needed, undetermined, is_damping, options, fewer)
   end subroutine look_for_others

   !> Takes the start of the best trial fit that nothing speaks against; without one, that of the
   !> least J, with a doubt if the motion is free.
   !>
   !> choice  of trial fits with all parameters
   !> rows    as of `find_start`
   !> asked   quantities of the stage, before parameters were left out
   subroutine take_best(problem, choice, is_free_motion, rows, asked, findings)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(in) :: choice
      logical, intent(in) :: is_free_motion
      integer, intent(in) :: rows
      type(quantity_t), intent(in) :: asked(:)
      type(findings_t), intent(inout) :: findings
      integer :: k

      k = choice%best
      if (k == 0) then
         k = minloc([(choice%trials(k)%fit%J, k=1, size(choice%trials))], dim=1)
         if (is_free_motion) findings%doubt = choice%trials(k)%objection
      end if
      problem%scenario = choice%trials(k)%start
      call describe_unknowable(problem, asked, choice, findings%note)
      if (findings%doubt == '') call list_rivals(choice, k, &
         rows/real(problem%rows(), wp), findings%rivals)
   end subroutine take_best

   !> Repeats trial fits with one mode fewer, with another parameter fixed: one of those that the
   !> modes determine takes the place of one that they do not determine. An exchange applies to
   !> every record. The first one that leads to a fit without an objection counts.
   !>
   !> Where two parameters have nearly the same effect, the values of the case may allow only one of
   !> the two to be fixed. A sensor mass below 0, for example, cannot make up for a modulus that is
   !> too low.
   !>
   !> undetermined, is_damping  (free)
   !> fewer                     on return the choice of the exchange; unchanged if there is none
   subroutine exchange_fixed(problem, full, lines, needed, undetermined, is_damping, options, fewer)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(in) :: full
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      logical, intent(in) :: undetermined(:), is_damping(:)
      type(options_t), intent(in) :: options
      type(choice_t), intent(inout) :: fewer
      type(choice_t) :: tried
      logical :: fixed(size(undetermined))
      integer :: j, k

      do j = 1, size(fixed)
         if (any(problem%free(:j - 1) == problem%free(j))) cycle
         if (is_damping(j) .or. undetermined(j) .or. full%beliefs(j)%stated) cycle
         do k = 1, size(fixed)
            if (any(problem%free(:k - 1) == problem%free(k))) cycle
            if (is_damping(k) .or. .not. undetermined(k)) cycle
            fixed = undetermined
            where (problem%free == problem%free(j)) fixed = .true.
            where (problem%free == problem%free(k)) fixed = .false.
            call choose_with_fewer(problem, full, lines, needed, fixed, options, tried)
            if (tried%best == 0) cycle
            fewer = tried
            return
         end do
      end do
   end subroutine exchange_fixed

   !> Finds the spectral lines of each record, up to twice the frequency of the highest mode of the
   !> model.
   !>
   !> modes  number of modes of the model
   !> lines  (records)
   !> error  the roots cannot be computed; with a known force: a record has no line or is too short
   subroutine lines_of_records(problem, modes, lines, error)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: modes
      type(lines_t), allocatable, intent(out) :: lines(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(modes), ds(modes, size(problem%free))
      real(wp), allocatable :: t(:)
      real(wp) :: highest
      integer :: r

      allocate (lines(size(problem%parts)))
      do r = 1, size(lines)
         call model_roots(problem, problem%scenario, r, s, ds, error)
         if (allocated(error)) return
         highest = 2*aimag(s(modes))/two_pi
         t = problem%parts(r)%observed%times()
         call find_lines(t, problem%parts(r)%observed%measured, highest, most_lines, lines(r)%line)
         if (size(t) == 0 .or. all(problem%scenario%excitations%modes > 0)) then
            cycle   ! A fit of a free motion is judged by itself, with or without lines.
         else if (.not. (t(size(t)) - t(1))*highest > 1) then
            call failure(error, 'record '//to_text(r)//' lasts '// &
               to_text(t(size(t)) - t(1))//', less than a period of '//to_text(highest)// &
               ', twice the frequency of mode '//to_text(modes)//' of the model; expected a '// &
               'longer record, or consistent units in the case and the record')
         else if (size(lines(r)%line) == 0) then
            call failure(error, 'found no spectral line in record '//to_text(r)//', expected '// &
               'a vibration: check its columns, t_first and t_last, or use start=''case''')
         end if
         if (allocated(error)) return
      end do
   end subroutine lines_of_records

   !> Returns how many modes determine all parameters that can be determined.
   !>
   !> choice        parameters and their expected values
   !> rejected      mode that must not be used; 0: none
   !> needed        number of modes; `rejected` if that is not 0
   !> undetermined  (free) parameters that one mode fewer leaves undetermined
   !> unknowable    (free) parameters that cannot be told from others by any of the modes, neither
   !>               at their expected values nor one standard deviation away
   !> is_damping    (free) parameters that act as damping
   subroutine needed_modes(problem, choice, rejected, needed, undetermined, unknowable, &
      is_damping, error)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(in) :: choice
      integer, intent(in) :: rejected
      integer, intent(out) :: needed
      logical, allocatable, intent(out) :: undetermined(:), unknowable(:), is_damping(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(choice%modes, size(problem%parts))
      complex(wp) :: ds(choice%modes, size(problem%parts), size(choice%beliefs))
      real(wp) :: values(size(choice%beliefs))
      integer :: k

      values = choice%beliefs%centre
      call find_roots(values, s, ds, error)
      if (allocated(error)) return
      is_damping = [(damps(reshape(ds(:, :, k), [size(s)])), k=1, size(values))]
      needed = choice%modes
      unknowable = inseparable(s, ds, choice%beliefs, values)
      ! Two parameters may have the same effect at one point by chance.
      if (any(unknowable)) unknowable = unknowable .and. inseparable_nearby()
      do
         undetermined = undetermined_by(needed - 1)
         if (needed == 1 .or. count(undetermined) > count(undetermined_by(choice%modes))) exit
         needed = needed - 1
      end do
      if (rejected > 0) needed = rejected
      undetermined = undetermined_by(needed - 1, stated_are_known=.true.)

   contains

      !> Returns which parameters cannot be told from others one standard deviation away from the
      !> expected values, (free); all, if the model cannot be computed there.
      function inseparable_nearby()
         logical :: inseparable_nearby(size(choice%beliefs))
         complex(wp) :: s(choice%modes, size(problem%parts))
         complex(wp) :: ds(choice%modes, size(problem%parts), size(choice%beliefs))
         real(wp) :: values(size(choice%beliefs))
         type(error_t), allocatable :: error

         values = choice%beliefs%nearby_value()
         call find_roots(values, s, ds, error)
         inseparable_nearby = .true.
         if (.not. allocated(error)) inseparable_nearby = inseparable(s, ds, choice%beliefs, &
            values)
      end function inseparable_nearby

      !> Computes the roots of all records and their derivatives for given parameters, as
      !> `model_roots` does for one.
      subroutine find_roots(values, s, ds, error)
         real(wp), intent(in) :: values(:)
         complex(wp), intent(out) :: s(:, :), ds(:, :, :)
         type(error_t), allocatable, intent(out) :: error
         complex(wp) :: slopes(choice%modes, size(choice%beliefs))
         integer :: r

         do r = 1, size(problem%parts)
            call model_roots(problem, problem%with(values), r, s(:, r), slopes, error)
            if (allocated(error)) return
            ds(:, r, :) = slopes
         end do
      end subroutine find_roots

      !> Returns which parameters the lowest modes leave undetermined (free).
      function undetermined_by(lowest, stated_are_known)
         integer, intent(in) :: lowest
         logical, intent(in), optional :: stated_are_known
         logical :: undetermined_by(size(choice%beliefs)), visible(size(s, 1), size(s, 2))

         visible = .false.
         visible(:lowest, :) = .true.
         undetermined_by = resting(s, ds, visible, choice%beliefs, values, stated_are_known)
      end function undetermined_by

   end subroutine needed_modes

end module beamid_starts
