!> The commands simulate, modes, frf, design, compare and ensemble for C. Their results are a
!> summary and the tables that the program would write.
!>
!> The computations run outside the critical section of texts, because their progress calls back.
module beamid_c_runs
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid, only: version
   use beamid_c_calls, only: characters, end_progress, progress_of_call, progress_t, told
   use beamid_c_handles, only: borrow_problem, give_back, new_handle, outcome_t, problem_t
   use beamid_c_responses, only: check_times
   use beamid_candidates, only: candidate_t
   use beamid_case_checks, only: check_needs, needs_fit
   use beamid_case_files, only: case_t
   use beamid_comparison_reports, only: report_comparison
   use beamid_comparisons, only: check_samples, compare_damping, fit_candidates, new_candidate, &
      set_labels
   use beamid_damping_models, only: damping_models_t
   use beamid_ensemble_reports, only: report_ensemble, tally_t
   use beamid_ensembles, only: ensemble_maker_t, member_t, new_ensemble, run_members
   use beamid_errors, only: bad_input, error_t
   use beamid_fleet_reports, only: add_fleet
   use beamid_fleets, only: fleet_case_t, read_fleet, run_fleet
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: ip, wp
   use beamid_member_rows, only: members_header, rows_of
   use beamid_refusals, only: refuse
   use beamid_run_reports, only: run_case
   use beamid_strings, only: string_t, to_text
   use beamid_texts, only: next_line, text_t
   implicit none
   private

   public :: beamid_run

   !> Approximate time that a block of members takes [s]; interrupts and progress wait for its end.
   real(wp), parameter :: block_seconds = 0.3_wp

contains

   !> Runs a command on an open case, or `compare` on several.
   !>
   !> command  simulate, modes, frf, design, compare, compare --damping, compare --damping=ratios or
   !>          ensemble
   !> cases    number of cases
   !> of       (cases) their handles
   !> labels   for `compare`: names of the models in the tables, one in each line; '': the names of
   !>          the cases
   !> handle   of the results, whose texts `beamid_text` copies out; to be closed by `beamid_close`;
   !>          0 if there is an error
   integer(c_int) function beamid_run(command, command_length, cases, of, labels, labels_length, &
      handle, message, room) result(status) bind(c)
      integer(c_int), value, intent(in) :: command_length, cases, labels_length, room
      character(kind=c_char), intent(in) :: command(command_length), labels(labels_length)
      integer(c_int64_t), intent(in) :: of(cases)
      integer(c_int64_t), intent(out) :: handle
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(outcome_t), pointer :: outcome
      type(progress_t), pointer :: progress
      type(error_t), allocatable :: error

      handle = 0
      problem => null()
      if (cases < 1) then
         call bad_input(error, 'found no case, expected one or more')
      else
         call borrow_problem(of(1), problem, error)
      end if
      if (.not. allocated(error)) then
         allocate (outcome)
         outcome%case = problem%case
         call give_back(of(1))
         progress => progress_of_call()
         select case (characters(command))
         case ('simulate', 'modes', 'frf', 'design')
            if (characters(command) == 'simulate') call check_records(outcome%case, error)
            if (.not. allocated(error)) call run_case(characters(command), outcome%case, &
               outcome%tables, outcome%summary, error, progress)
         case ('ensemble'); call run_ensemble(outcome, error, progress)
         case ('compare'); call run_compare(of, characters(labels), outcome, error, progress)
         case ('compare --damping'); call run_damping(.false., outcome, error, progress)
         case ('compare --damping=ratios'); call run_damping(.true., outcome, error, progress)
         case default
            call bad_input(error, 'found another command, expected simulate, modes, frf, '// &
               'design, compare, compare --damping, compare --damping=ratios or ensemble')
         end select
         call end_progress(progress)
         call check_interrupt(error)
         if (allocated(error)) then
            deallocate (outcome)
         else
            handle = new_handle(outcome)
         end if
      end if
      status = told(error, message)
   end function beamid_run

   !> Refuses times of records in memory at which no response can be computed.
   subroutine check_records(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, size(case%recordings)
         if (allocated(case%recordings(k)%t)) call check_times(case, case%recordings(k)%t, error)
         if (allocated(error)) return
      end do
   end subroutine check_records

   !> Fits several models of the same records and ranks them; `of` and `labels` as in `beamid_run`.
   subroutine run_compare(of, labels, outcome, error, progress)
      integer(c_int64_t), intent(in) :: of(:)
      character(len=*), intent(in) :: labels
      type(outcome_t), intent(inout) :: outcome
      type(error_t), allocatable, intent(out) :: error
      type(progress_t), pointer, intent(in) :: progress
      type(candidate_t), allocatable :: models(:)
      type(string_t), allocatable :: names(:), paths(:), titles(:)
      integer :: k

      allocate (models(size(of)), names(size(of)), paths(size(of)))
      do k = 1, size(of)
         call add_model(k)
         if (allocated(error)) return
      end do
      call fit_candidates(models, paths, error, progress)
      call check_interrupt(error)
      if (allocated(error)) return
      !$omp critical (texts_of_beamid)
      call set_labels(names, paths, titles)
      call report_comparison(models, titles, outcome%tables, outcome%summary)
      call outcome%tables%check_finite(error)
      !$omp end critical (texts_of_beamid)

   contains

      !> Makes the candidate of case k.
      subroutine add_model(k)
         integer, intent(in) :: k
         type(problem_t), pointer :: problem
         type(case_t) :: case

         call borrow_problem(of(k), problem, error)
         if (allocated(error)) return
         case = problem%case
         call give_back(of(k))
         !$omp critical (texts_of_beamid)
         names(k)%text = case%name
         paths(k)%text = case%path
         call set_label(k, names(k)%text)
         if (labels /= '') paths(k) = names(k)
         call check_needs(case, needs_fit, error)
         if (.not. allocated(error)) call new_candidate(case, models(k), error)
         if (.not. allocated(error)) call check_samples(models(k), models(1), paths(k)%text, &
            paths(1)%text, error)
         !$omp end critical (texts_of_beamid)
      end subroutine add_model

      !> Replaces the name of model k by line k of `labels`, if there is one.
      subroutine set_label(k, name)
         integer, intent(in) :: k
         character(len=:), allocatable, intent(inout) :: name
         character(len=:), allocatable :: line
         integer(ip) :: first
         integer :: number

         first = 1
         number = 0
         do while (next_line(labels, first, line))
            number = number + 1
            if (number == k) name = line
         end do
      end subroutine set_label

   end subroutine run_compare

   !> Compares damping mechanisms; `by_ratios` as in `compare_damping`.
   subroutine run_damping(by_ratios, outcome, error, progress)
      logical, intent(in) :: by_ratios
      type(outcome_t), intent(inout) :: outcome
      type(error_t), allocatable, intent(out) :: error
      type(progress_t), pointer, intent(in) :: progress
      type(damping_models_t) :: found
      type(string_t), allocatable :: labels(:)

      call check_needs(outcome%case, needs_fit, error)
      if (.not. allocated(error)) call compare_damping(outcome%case, by_ratios, found, labels, &
         error, progress)
      call check_interrupt(error)
      if (allocated(error)) return
      !$omp critical (texts_of_beamid)
      call report_comparison(found%models, labels, outcome%tables, outcome%summary, found)
      call outcome%tables%check_finite(error)
      !$omp end critical (texts_of_beamid)
   end subroutine run_damping

   !> Runs the command of &ensemble on each of its members.
   subroutine run_ensemble(outcome, error, progress)
      type(outcome_t), intent(inout) :: outcome
      type(error_t), allocatable, intent(out) :: error
      type(progress_t), pointer, intent(in) :: progress
      type(ensemble_maker_t) :: maker
      type(fleet_case_t), allocatable :: fleet(:)
      type(member_t), allocatable :: members(:)
      type(tally_t) :: tally
      type(text_t) :: rows, summary
      integer(int64) :: begin, now, rate
      integer :: first, last, length, n

      !$omp critical (texts_of_beamid)
      call prepare_ensemble(outcome%case)
      !$omp end critical (texts_of_beamid)
      if (allocated(error)) return
      call rows%line(members_header)
      allocate (tally%sums(0))
      first = 1
      length = 16
      do while (first <= n)
         last = min(n, first + length - 1)
         call system_clock(begin, rate)
         allocate (members(last - first + 1))
         if (.not. allocated(fleet)) call run_members(maker, first, members)
         !$omp critical (texts_of_beamid)
         if (allocated(fleet)) call run_fleet(fleet(first:last), members, error)
         if (.not. allocated(error)) call add_rows(rows_of(members, first))
         !$omp end critical (texts_of_beamid)
         deallocate (members)
         call check_interrupt(error)
         if (allocated(error)) return
         call system_clock(now)
         if (associated(progress)) call progress%advanced(last, n, 'members')
         length = max(1, min(8*length, nint(block_seconds*rate*(last - first + 1) &
            /real(max(now - begin, 1_int64), wp))))
         first = last + 1
      end do
      !$omp critical (texts_of_beamid)
      call report_ensemble(outcome%case, tally, outcome%tables, summary, error)
      if (.not. allocated(error)) then
         call outcome%tables%add('members.csv', rows%content(), is_quoted=.true.)
         if (allocated(fleet)) call add_fleet(fleet, '', .false., outcome%tables, summary, error)
         outcome%summary = summary%content()
      end if
      !$omp end critical (texts_of_beamid)

   contains

      !> Adds rows to the table and to the statistics.
      subroutine add_rows(block)
         character(len=*), intent(in) :: block
         character(len=:), allocatable :: line
         integer(ip) :: at

         call rows%add(block)
         at = 1
         do while (next_line(block, at, line))
            call tally%take(line)
         end do
      end subroutine add_rows

      !> Prepares the members of an ensemble.
      subroutine prepare_ensemble(case)
         type(case_t), intent(inout) :: case
         integer :: k

         n = 0
         if (.not. allocated(case%ensemble%command)) then
            call refuse(case%path, 0, 'ensemble', 'no such group', 'one', error)
         else if (allocated(case%ensemble%cases)) then
            call read_fleet(case%ensemble%cases, version, fleet, error)
            if (.not. allocated(error)) n = size(fleet)
         else
            call check_records(case, error)
            do k = 1, size(case%recordings)
               ! The values are replaced by simulated ones.
               if (allocated(case%recordings(k)%t)) case%recordings(k)%z = case%recordings(k)%t
            end do
            if (.not. allocated(error)) call new_ensemble(case, maker, error)
            n = case%ensemble%members
         end if
      end subroutine prepare_ensemble

   end subroutine run_ensemble

end module beamid_c_runs
