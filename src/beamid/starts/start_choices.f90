!> Trial fits with a given number of modes, and the choice of the best one.
!>
!> `beamid_starts` compares the choice with all modes that the parameters need with the choice with
!> one mode fewer.
module beamid_start_choices
   use beamid_assignments, only: assignment_t, best_assignments, lines_t
   use beamid_equal_frequencies, only: find_equal_frequencies
   use beamid_errors, only: error_t
   use beamid_fit_setups, only: set_free
   use beamid_kinds, only: wp
   use beamid_least_squares, only: options_t
   use beamid_model_roots, only: belief_t, beliefs_about, damps, model_roots
   use beamid_parameters, only: as_named
   use beamid_residuals, only: residual_t
   use beamid_strings, only: to_text
   use beamid_trials, only: add_residual, gain_of_mode, is_multiple, least_gain, object, trial_t, &
      try_start
   use beamid_unknowns, only: quantity_t, stage_t, variables_of
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: choice_t, rival_t, choose, choose_with_fewer, compare, list_rivals, new_choice, &
      try_equal_frequencies

   !> Number of assignments from which fits start.
   integer, parameter :: most_starts = 3
   !> Largest number of evaluations of a trial fit, and of each if none has converged: if the record
   !> hardly tells some parameters apart, J has a long valley.
   integer, parameter :: usual_effort = 100, great_effort = 1000

   !> Relative difference of J up to which two fits have found the same minimum.
   real(wp), parameter :: same_sum = 1e-6_wp

   !> The trial fits with one number of modes.
   type :: choice_t
      type(stage_t) :: stage
      integer :: modes = 0                             !< number of modes
      type(quantity_t), allocatable :: quantities(:)   !< (free) free parameters
      type(belief_t), allocatable :: beliefs(:)        !< (free) their expected values
      type(trial_t), allocatable :: trials(:)
      integer :: best = 0   !< index of the best trial without an objection; 0: there is none
      !> one line for each start from which no fit converges
      character(len=:), allocatable :: failures
   contains
      procedure :: list_rejections
   end type choice_t

   !> Another minimum of J.
   type :: rival_t
      real(wp), allocatable :: shift(:)       !< (free) from the best trial
      real(wp) :: ratio = 1                   !< of its J to that of the best trial
      character(len=:), allocatable :: text   !< the same in words
   end type rival_t

contains

   !> Returns a choice without trials, for the free parameters of a fit.
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
      choice%failures = ''
      call variables_of(stage, problem%scenario, variables, choice%quantities, error)
      if (.not. allocated(error)) choice%beliefs = beliefs_about(problem%scenario, &
         problem%free, problem%record, [variables%start], problem%priors)
   end subroutine new_choice

   !> Runs trial fits from the best assignments and from the expected values, and picks the best
   !> trial.
   !>
   !> lines   (records) spectral lines
   !> needed  number of modes without which a parameter would not be determined
   !> error   no trial converges
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
      character(len=:), allocatable :: origin
      real(wp) :: values(size(choice%beliefs))
      integer :: effort, k

      call best_assignments(problem, choice%beliefs, lines, choice%modes, most_starts, found, error)
      if (allocated(error)) return
      effort = usual_effort
      do
         do k = 1, size(found) + 1
            values = choice%beliefs%centre
            if (k <= size(found)) values = found(k)%value
            call try_start(problem, choice%stage, values, choice%modes, options, effort, trial, &
               reason)
            call describe_origin(lines, found, k, origin)
            if (allocated(reason)) then
               choice%failures = choice%failures//origin//': '//reason%message//new_line('')
               cycle
            end if
            call add_trial(problem, choice, trial, origin, needed)
         end do
         if (size(choice%trials) > 0 .or. effort == great_effort) exit
         effort = great_effort
         choice%failures = ''
      end do
      if (size(choice%trials) == 0) call move_alloc(reason, error)
      call pick(choice)
   end subroutine choose

   !> Tries starts from other parameter values with the frequencies of the best trial, and picks the
   !> best trial again.
   !>
   !> needed  as for `choose`
   subroutine try_equal_frequencies(problem, choice, needed, options)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(inout) :: choice
      integer, intent(in) :: needed
      type(options_t), intent(in) :: options
      type(trial_t) :: trial
      type(error_t), allocatable :: error
      real(wp), allocatable :: values(:, :)
      integer :: k

      if (choice%best == 0) return
      call find_equal_frequencies(problem, choice%stage, choice%beliefs, &
         choice%trials(choice%best), needed, values)
      do k = 1, size(values, 2)
         call try_start(problem, choice%stage, values(:, k), choice%modes, options, &
            usual_effort, trial, error)
         if (allocated(error)) cycle
         call add_trial(problem, choice, trial, 'start with the same frequencies', needed)
      end do
      call pick(choice)
   end subroutine try_equal_frequencies

   !> Adds a trial to those of a choice, with its origin and the objection to it, if any.
   !>
   !> origin  where the trial starts, for reports
   !> needed  as for `choose`
   subroutine add_trial(problem, choice, trial, origin, needed)
      type(residual_t), intent(in) :: problem
      type(choice_t), intent(inout) :: choice
      type(trial_t), intent(inout) :: trial
      character(len=*), intent(in) :: origin
      integer, intent(in) :: needed

      trial%origin = origin
      call object(trial, choice%beliefs, [choice%quantities%name], variation(problem), needed)
      choice%trials = [choice%trials, trial]
   end subroutine add_trial

   !> Describes where the k-th trial starts: the frequencies that it assigns to the modes, or the
   !> values of the case.
   !>
   !> lines        (records) spectral lines
   !> assignments  the first trials start from these, the last one from the values of the case
   subroutine describe_origin(lines, assignments, k, text)
      type(lines_t), intent(in) :: lines(:)
      type(assignment_t), intent(in) :: assignments(:)
      integer, intent(in) :: k
      character(len=:), allocatable, intent(out) :: text
      integer :: mode, r

      text = 'start from the values of the case'
      if (k > size(assignments)) return
      text = 'start from the lines'
      do r = 1, size(lines)
         do mode = 1, size(assignments(k)%place, 1)
            associate (place => assignments(k)%place(mode, r))
               if (mode + r > 2) text = text//','
               if (place > 0) text = text//' '//to_text(lines(r)%line(place)%frequency)
               if (place == 0) text = text//' none'
            end associate
         end do
      end do
   end subroutine describe_origin

   !> Writes one line for each start whose fit is rejected, with the reason.
   pure subroutine list_rejections(self, text)
      class(choice_t), intent(in) :: self
      character(len=:), allocatable, intent(out) :: text
      integer :: k

      text = self%failures
      do k = 1, size(self%trials)
         if (self%trials(k)%objection /= '') text = text//self%trials(k)%origin//': '// &
            self%trials(k)%objection//new_line('')
      end do
   end subroutine list_rejections

   !> Picks the trial with the lowest J among those without an objection.
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

   !> Returns the weighted sum of squares of the records about their means.
   pure real(wp) function variation(problem)
      type(residual_t), intent(in) :: problem
      integer :: r

      variation = 0
      do r = 1, size(problem%parts)
         associate (z => problem%parts(r)%observed%measured)
            variation = variation + (problem%weight(r)*norm2(z - sum(z)/size(z)))**2
         end associate
      end do
   end function variation

   !> Runs trial fits with one mode fewer than needed.
   !>
   !> The parameters that this leaves undetermined are fixed: damping at the value that suits the
   !> spectral lines, all others at their current values.
   !>
   !> full          choice with all needed modes
   !> needed        number of modes that are needed
   !> undetermined  (free) parameters that are undetermined without the last of these modes
   !> fewer         choice with one mode fewer; without trials if there is no such choice
   subroutine choose_with_fewer(problem, full, lines, needed, undetermined, options, fewer)
      type(residual_t), intent(in) :: problem
      type(choice_t), intent(in) :: full
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      logical, intent(in) :: undetermined(:)
      type(options_t), intent(in) :: options
      type(choice_t), intent(out) :: fewer
      type(error_t), allocatable :: error
      type(assignment_t), allocatable :: found(:)
      type(residual_t) :: smaller
      complex(wp) :: s(needed - 1), ds(needed - 1, size(undetermined))
      integer :: k

      allocate (fewer%trials(0))
      if (needed == 1) return
      call problem%copy_to(smaller)
      smaller%scenario%excitations%modes = needed - 1
      call best_assignments(smaller, full%beliefs, lines, needed - 1, 1, found, error)
      if (.not. allocated(error)) call model_roots(smaller, smaller%scenario, 1, s, ds, error)
      if (allocated(error)) return
      do k = 1, size(undetermined)
         if (undetermined(k) .and. damps(ds(:, k))) call smaller%scenario%set(smaller%free(k), &
            smaller%record(k), found(1)%value(k))
      end do
      fewer%stage = full%stage%without(undetermined)
      call set_free(smaller, fewer%stage)
      call new_choice(smaller, full%stage%without(undetermined), needed - 1, fewer, error)
      if (.not. allocated(error)) call choose(smaller, fewer, lines, needed - 1, options, error)
      if (size(fewer%trials) > 0) call add_residual(smaller, fewer%trials(lowest(fewer)), error)
   end subroutine choose_with_fewer

   !> Returns the index of the trial with the lowest J, whether or not there is an objection to it.
   pure integer function lowest(choice)
      type(choice_t), intent(in) :: choice
      integer :: k

      lowest = minloc([(choice%trials(k)%fit%J, k=1, size(choice%trials))], dim=1)
   end function lowest

   !> Objects to trials in which the last needed mode is not real: it hardly reduces J beside the
   !> best fit without it, or it sits on a multiple of another line.
   subroutine compare(problem, full, fewer, lines, needed)
      type(residual_t), intent(inout) :: problem
      type(choice_t), intent(inout) :: full
      type(choice_t), intent(in) :: fewer
      type(lines_t), intent(in) :: lines(:)
      integer, intent(in) :: needed
      real(wp) :: gain(size(lines))
      real(wp), allocatable :: t(:)
      logical :: multiple(size(lines))
      type(error_t), allocatable :: error
      integer :: k, best, r

      if (size(fewer%trials) == 0) return
      best = lowest(fewer)
      if (size(fewer%trials(best)%fit%residual) == 0) return
      do k = 1, size(full%trials)
         associate (trial => full%trials(k))
            if (trial%objection /= '') cycle
            call add_residual(problem, trial, error)
            if (allocated(error)) then
               trial%objection = error%message
               cycle
            end if
            do r = 1, size(lines)
               gain(r) = gain_of_mode(problem, trial, needed, r, fewer%trials(best)%fit%residual)
               t = problem%parts(r)%observed%times()
               multiple(r) = is_multiple(trial%s(:, r), needed, gain(r), lines(r)%line, &
                  t(size(t)) - t(1))
            end do
            if (.not. sum(gain) > least_gain) then
               trial%objection = 'mode '//to_text(needed)//' does not improve the fit'
               trial%is_absent = .true.
            else if (sum(gain, mask=multiple) > sum(gain)/2) then
               trial%objection = 'mode '//to_text(needed)// &
                  ' may be a multiple of another line or of the mains'
            end if
         end associate
      end do
      call pick(full)
   end subroutine compare

   !> Lists the other minima of J: trials without an objection, with other parameters.
   !>
   !> best       index of the trial that was picked
   !> row_ratio  number of rows of the whole records for each row of the trials
   !> rivals     in the order of the trials
   subroutine list_rivals(choice, best, row_ratio, rivals)
      type(choice_t), intent(in) :: choice
      integer, intent(in) :: best
      real(wp), intent(in) :: row_ratio
      type(rival_t), allocatable, intent(out) :: rivals(:)
      type(rival_t) :: rival
      integer :: differs(size(choice%trials)), j, k

      allocate (rivals(0))
      do k = 1, size(choice%trials)
         differs(k) = largest_difference(choice%trials(k)%fit%estimate, &
            choice%trials(best)%fit%estimate)
         if (choice%trials(k)%objection /= '') differs(k) = 0
         if (differs(k) == 0) cycle
         ! Several starts may lead to the same minimum.
         if (any([(differs(j) > 0 .and. largest_difference(choice%trials(k)%fit%estimate, &
            choice%trials(j)%fit%estimate) == 0, j=1, k - 1)])) cycle
         associate (other => choice%trials(k)%fit, picked => choice%trials(best)%fit, &
            q => choice%quantities(differs(k)))
            rival%shift = other%estimate - picked%estimate
            rival%ratio = other%J/picked%J
            rival%text = 'another minimum: J = '//to_text(row_ratio*other%J)//' with '// &
               trim(q%name)//' = '//to_text(as_named(q%parameter, other%estimate(differs(k))))// &
               ' instead of '//to_text(as_named(q%parameter, picked%estimate(differs(k))))
         end associate
         rivals = [rivals, rival]
      end do
   end subroutine list_rivals

   !> Returns the index of the parameter with the largest relative difference between two estimates;
   !> 0 if the estimates are of the same minimum.
   pure integer function largest_difference(estimate, other) result(k)
      real(wp), intent(in) :: estimate(:), other(:)
      real(wp), parameter :: apart = 0.01_wp
      real(wp) :: difference(size(estimate))

      difference = abs(estimate - other)/max(abs(other), tiny(1.0_wp))
      k = maxloc(difference, dim=1)
      if (difference(k) <= apart) k = 0
   end function largest_difference

end module beamid_start_choices
