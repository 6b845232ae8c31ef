!> Start values from the record: its lines are assigned to the modes of the model, and of the fits
!> that start from the best assignments, and from what the user said, that one counts against which
!> nothing speaks. Where there is none a fit with fewer modes and fewer parameters takes its place.
module beamid_starts
   use beamid_assignments, only: assignment_t, best_assignments, lines_t
   use beamid_decaying_lines, only: find_lines
   use beamid_errors, only: bad_input, error_t, failure
   use beamid_kinds, only: wp
   use beamid_least_squares, only: options_t
   use beamid_model_roots, only: belief_t, beliefs_about, damps, model_roots
   use beamid_parameters, only: as_named, get_free
   use beamid_residuals, only: residual_t
   use beamid_spectra, only: strongest_peak
   use beamid_strings, only: to_text
   use beamid_trials, only: gain_of_mode, is_multiple, least_gain, object, resting, &
      trial_t, try_start
   use beamid_unknowns, only: quantity_t, stage_t, variables_of
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: automatic_start, check_frequencies, set_free

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

   !> Assignments that are fitted, modes that are matched where the start of the motion is known,
   !> and lines of a record at most.
   integer, parameter :: most_starts = 3, usual_modes = 2, most_lines = 12

   !> Sums of squares that agree so well are those of one minimum.
   real(wp), parameter :: same_sum = 1e-6_wp

   !> The fits with one number of modes.
   type :: choice_t
      type(stage_t) :: stage
      integer :: modes = 0
      type(quantity_t), allocatable :: quantities(:)   !< that are free
      type(belief_t), allocatable :: beliefs(:)
      type(trial_t), allocatable :: trials(:)
      integer :: best = 0               !< against which nothing speaks; 0: there is none
   end type choice_t

contains

   !> What is free in a stage is free in the problem.
   subroutine set_free(problem, stage)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage

      problem%free = stage%free
      problem%record = stage%owners()
      problem%offset = stage%offset
   end subroutine set_free

   !> Puts start values for a stage into the problem's scenario.
   !>
   !> problem  with `free` and `record` of the stage in place; on return perhaps with fewer modes
   !> stage    on return without the parameters that have to be held
   !> note     says which; '': none
   !> doubt    why no fit is to be trusted; ''
   !> other    another minimum of nearly the same J; ''
   !> error    no line stands out where the force is known, the model has too few modes, no fit
   !>          converges
   subroutine automatic_start(problem, stage, options, note, doubt, other, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(inout) :: stage
      type(options_t), intent(in) :: options
      character(len=:), allocatable, intent(out) :: note, doubt, other
      type(error_t), allocatable, intent(out) :: error
      type(choice_t) :: full, fewer
      type(lines_t), allocatable :: lines(:)
      logical, allocatable :: lost(:)
      character(len=:), allocatable :: held
      integer :: k, modes, needed
      logical :: is_free

      note = ''
      doubt = ''
      other = ''
      if (.not. problem%exact) then
         call failure(error, 'start values: from a record only the modal response finds them')
         return
      end if
      is_free = all(problem%scenario%excitations%modes > 0)
      modes = usual_modes
      if (is_free) modes = minval(problem%scenario%excitations%modes)
      call lines_of_records(problem, modes, lines, error)
      if (.not. allocated(error)) call new_choice(problem, stage, modes, full, error)
      if (.not. allocated(error)) call needed_modes(problem, full, needed, lost, error)
      if (.not. allocated(error)) call choose(problem, full, lines, needed, options, error)
      if (allocated(lost) .and. is_free) then
         call choose_with_fewer(problem, full, lines, needed, lost, options, fewer)
         call compare(problem, full, fewer, lines, needed)
      end if
      if (allocated(error) .and. .not. fewer%best > 0) then
         error%message = 'start values: '//error%message
         return
      end if
      if (allocated(error)) deallocate (error)
      if (full%best == 0 .and. fewer%best > 0) then
         stage = fewer%stage
         problem%scenario = fewer%trials(fewer%best)%start
         call tell_held(problem, full, lost, held)
         note = 'mode '//to_text(needed)//' is not in '//trim(merge('this record  ', &
            'these records', size(lines) == 1))//': '//held
      else
         k = full%best
         if (k == 0) then
            k = minloc([(full%trials(k)%fit%J, k=1, size(full%trials))], dim=1)
            if (is_free) doubt = full%trials(k)%objection
         end if
         problem%scenario = full%trials(k)%start
         if (doubt == '') call find_rival(full, k, other)
      end if
      call set_free(problem, stage)
   end subroutine automatic_start

   !> The lines of each record, up to twice the frequency of the model's highest mode.
   subroutine lines_of_records(problem, modes, lines, error)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: modes
      type(lines_t), allocatable, intent(out) :: lines(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(modes), ds(modes, size(problem%free))
      real(wp) :: highest
      integer :: r

      allocate (lines(size(problem%parts)))
      do r = 1, size(lines)
         call model_roots(problem, problem%scenario, r, s, ds, error)
         if (allocated(error)) return
         highest = 2*aimag(s(modes))/two_pi
         associate (t => problem%parts(r)%experiment%samples)
            call find_lines(t, problem%parts(r)%experiment%measured, highest, most_lines, &
               lines(r)%line)
            if (all(problem%scenario%excitations%modes > 0)) then
               cycle   ! Fits without any line tell by themselves what they are worth.
            else if (.not. (t(size(t)) - t(1))*highest > 1) then
               call failure(error, 'record '//to_text(r)//' holds no period of '// &
                  to_text(highest)//', twice the frequency of the model''s mode '// &
                  to_text(modes)//': it lasts '//to_text(t(size(t)) - t(1))// &
                  '; expected a longer one, or units that go together')
            else if (size(lines(r)%line) == 0) then
               call failure(error, 'found no line in the spectrum of record '//to_text(r))
            end if
         end associate
         if (allocated(error)) return
      end do
   end subroutine lines_of_records

   !> No fit yet, of what is free in the problem.
   subroutine new_choice(problem, stage, modes, choice, error)
      type(residual_t), intent(in) :: problem
      type(stage_t), intent(in) :: stage
      integer, intent(in) :: modes
      type(choice_t), intent(out) :: choice
      type(error_t), allocatable, intent(out) :: error
      type(variable_t), allocatable :: variables(:)

      choice%stage = stage
      choice%modes = modes
      allocate (choice%trials(0))
      call variables_of(stage, problem%scenario, variables, choice%quantities, error)
      if (.not. allocated(error)) choice%beliefs = beliefs_about(problem%scenario, &
         problem%free, problem%record, [variables%start], problem%priors)
   end subroutine new_choice

   !> How many modes it takes to determine what can be determined, and what one mode fewer leaves
   !> undetermined.
   subroutine needed_modes(problem, choice, needed, lost, error)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(in) :: choice
      integer, intent(out) :: needed
      logical, allocatable, intent(out) :: lost(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(choice%modes, size(problem%parts))
      complex(wp) :: ds(choice%modes, size(problem%parts), size(choice%beliefs))
      complex(wp) :: slopes(choice%modes, size(choice%beliefs))
      real(wp) :: values(size(choice%beliefs))
      integer :: r

      values = choice%beliefs%centre
      do r = 1, size(problem%parts)
         call model_roots(problem, problem%with(values), r, s(:, r), slopes, error)
         if (allocated(error)) return
         ds(:, r, :) = slopes
      end do
      needed = choice%modes
      do
         lost = left_by(needed - 1)
         if (needed == 1 .or. count(lost) > count(left_by(choice%modes))) exit
         needed = needed - 1
      end do

   contains

      !> What is not determined by the lowest modes.
      function left_by(lowest)
         integer, intent(in) :: lowest
         logical :: left_by(size(choice%beliefs)), visible(size(s, 1), size(s, 2))

         visible = .false.
         visible(:lowest, :) = .true.
         left_by = resting(s, ds, visible, choice%beliefs, values)
      end function left_by

   end subroutine needed_modes

   !> Fits from the best assignments and from where the parameters are, and which of them is best.
   !>
   !> error  none of them converges
   subroutine choose(problem, choice, lines, needed, options, error)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(inout) :: choice
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(assignment_t), allocatable :: found(:)
      type(error_t), allocatable :: reason
      type(trial_t) :: trial
      real(wp) :: values(size(choice%beliefs))
      integer :: k

      call best_assignments(problem, choice%beliefs, lines, choice%modes, most_starts, found, error)
      if (allocated(error)) return
      do k = 1, size(found) + 1
         values = choice%beliefs%centre
         if (k <= size(found)) values = found(k)%value
         call try_start(problem, choice%stage, values, choice%modes, options, trial, reason)
         if (allocated(reason)) cycle
         call object(trial, choice%beliefs, [choice%quantities%name], variation(problem), needed)
         choice%trials = [choice%trials, trial]
      end do
      if (size(choice%trials) == 0) call move_alloc(reason, error)
      call pick(choice)
   end subroutine choose

   !> The trial with the lowest J against which nothing speaks.
   subroutine pick(choice)
      type(choice_t), intent(inout) :: choice
      integer :: k

      choice%best = 0
      do k = 1, size(choice%trials)
         if (choice%trials(k)%objection /= '') cycle
         if (choice%best > 0) then
            if (choice%trials(k)%fit%J > choice%trials(choice%best)%fit%J*(1 - same_sum)) cycle
         end if
         choice%best = k
      end do
   end subroutine pick

   !> Another fit against which nothing speaks, with other parameters and nearly the same J.
   subroutine find_rival(choice, best, text)
      type(choice_t), intent(in) :: choice
      integer, intent(in) :: best
      character(len=:), allocatable, intent(out) :: text
      real(wp), parameter :: nearly = 1.02_wp, apart = 0.01_wp
      integer :: j, k

      text = ''
      associate (mine => choice%trials(best)%fit)
         do k = 1, size(choice%trials)
            associate (its => choice%trials(k)%fit)
               if (choice%trials(k)%objection /= '' .or. its%J > nearly*mine%J) cycle
               j = maxloc(abs(its%estimate - mine%estimate)/max(abs(mine%estimate), &
                  tiny(1.0_wp)), dim=1)
               if (abs(its%estimate(j) - mine%estimate(j)) <= apart*abs(mine%estimate(j))) cycle
               text = 'another minimum: J = '//to_text(its%J)//' with '// &
                  trim(choice%quantities(j)%name)//' = '//to_text(as_named( &
                  choice%quantities(j)%parameter, its%estimate(j)))
            end associate
         end do
      end associate
   end subroutine find_rival

   !> Weighted sum of squares of the records about their means.
   pure real(wp) function variation(problem)
      type(residual_t), intent(in) :: problem
      integer :: r

      variation = 0
      do r = 1, size(problem%parts)
         associate (z => problem%parts(r)%experiment%measured)
            variation = variation + (problem%weight(r)*norm2(z - sum(z)/size(z)))**2
         end associate
      end do
   end function variation

   !> The fits with one mode fewer than needed. What that leaves undetermined is held: damping at
   !> what goes with the lines, everything else where it is.
   subroutine choose_with_fewer(problem, full, lines, needed, lost, options, fewer)
      type(residual_t), intent(in) :: problem
      type(choice_t), intent(in) :: full
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      logical, intent(in) :: lost(:)
      type(options_t), intent(in) :: options
      type(choice_t), intent(out) :: fewer
      type(error_t), allocatable :: error
      type(assignment_t), allocatable :: found(:)
      type(residual_t) :: smaller
      complex(wp) :: s(needed - 1), ds(needed - 1, size(lost))
      integer :: k

      allocate (fewer%trials(0))
      if (needed == 1) return
      smaller = problem
      smaller%scenario%excitations%modes = needed - 1
      call best_assignments(smaller, full%beliefs, lines, needed - 1, 1, found, error)
      if (.not. allocated(error)) call model_roots(smaller, smaller%scenario, 1, s, ds, error)
      if (allocated(error)) return
      do k = 1, size(lost)
         if (lost(k) .and. damps(ds(:, k))) call smaller%scenario%set(smaller%free(k), &
            smaller%record(k), found(1)%value(k))
      end do
      fewer%stage = full%stage%without(lost)
      call set_free(smaller, fewer%stage)
      call new_choice(smaller, full%stage%without(lost), needed - 1, fewer, error)
      if (.not. allocated(error)) call choose(smaller, fewer, lines, needed - 1, options, error)
   end subroutine choose_with_fewer

   !> A fit does not count where the mode that is needed gains nothing beside the best one without
   !> it, or is a multiple of another.
   subroutine compare(problem, full, fewer, lines, needed)
      type(residual_t), intent(in) :: problem
      type(choice_t), intent(inout) :: full
      type(choice_t), intent(in) :: fewer
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      real(wp) :: gain(size(lines))
      logical :: multiple(size(lines))
      integer :: k, least, r

      if (size(fewer%trials) == 0) return
      least = minloc([(fewer%trials(k)%fit%J, k=1, size(fewer%trials))], dim=1)
      do k = 1, size(full%trials)
         associate (trial => full%trials(k))
            if (trial%objection /= '') cycle
            do r = 1, size(lines)
               gain(r) = gain_of_mode(problem, trial, needed, r, fewer%trials(least)%fit%residual)
               associate (t => problem%parts(r)%experiment%samples)
                  multiple(r) = is_multiple(trial%s(:, r), needed, gain(r), lines(r)%line, &
                     t(size(t)) - t(1))
               end associate
            end do
            if (.not. sum(gain) > least_gain) then
               trial%objection = 'mode '//to_text(needed)//' gains nothing'
            else if (sum(gain, mask=multiple) > sum(gain)/2) then
               trial%objection = 'mode '//to_text(needed)//' sits on a multiple of another line'
            end if
         end associate
      end do
      call pick(full)
   end subroutine compare

   !> Which parameters are held, and at what.
   subroutine tell_held(problem, choice, lost, text)
      type(residual_t), intent(in) :: problem
      type(choice_t), intent(in) :: choice
      logical, intent(in) :: lost(:)
      character(len=:), allocatable, intent(out) :: text
      integer :: k, r

      text = ''
      do k = 1, size(lost)
         if (.not. lost(k)) cycle
         associate (q => choice%quantities(k))
            if (text == '') then
               text = trim(q%name)//' is held at '
            else
               text = text//', '//trim(q%name)//' at '
            end if
            r = max(1, q%record)
            text = text//to_text(as_named(q%parameter, get_free(problem%scenario%structures(r), &
               problem%scenario%excitations(r), q%parameter)))
         end associate
      end do
   end subroutine tell_held

   !> Refuses a model whose frequencies have nothing to do with the record's: a slip in the units.
   subroutine check_frequencies(problem, error)
      type(residual_t), intent(inout) :: problem
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: too_far = 20
      complex(wp), allocatable :: s(:), none(:, :)
      real(wp) :: share, strongest, low, high
      integer :: r

      problem%free = [integer ::]
      problem%record = [integer ::]
      do r = 1, size(problem%parts)
         associate (experiment => problem%parts(r)%experiment)
            if (experiment%excitation%modes == 0 .or. size(experiment%samples) < 50) cycle
            s = spread((0.0_wp, 0.0_wp), 1, experiment%excitation%modes)
            allocate (none(size(s), 0))
            call model_roots(problem, problem%scenario, r, s, none, error)
            if (allocated(error)) return
            deallocate (none)
            low = aimag(s(1))/two_pi
            high = aimag(s(size(s)))/two_pi
            call strongest_peak(experiment%samples, experiment%measured, 5*high, strongest, share)
         end associate
         if (share > 0.05_wp .and. strongest*too_far > low) cycle
         call bad_input(error, 'record '//to_text(r)//': found next to nothing of it '// &
            'near the model''s frequencies, '//to_text(low)//' to '//to_text(high)// &
            '; expected units that go together')
         return
      end do
   end subroutine check_frequencies

end module beamid_starts
