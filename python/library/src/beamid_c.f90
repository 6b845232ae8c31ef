!> The interface of beamid for C, used by the Python package: a case and its records are opened,
!> fitted any number of times, and the results of a fit are copied out by name.
!>
!> Every routine returns a status: 0; 1, the computation failed; 2, bad input; 3, interrupted. If it
!> is not 0, `message` holds the error message, truncated to `room` characters and ended by a null
!> character. A text is passed as a pointer and a length. Every buffer is passed with its size, and
!> a routine rejects a buffer that is too small.
!>
!> Cases and fits are handles (`beamid_c_handles`). Several threads may use one case at the same
!> time, but only one thread may use a fit. Calls that compute are enclosed by `beamid_begin` and
!> `beamid_end` (`beamid_c_calls`). Procedures that work with text run in one critical section,
!> because gfortran keeps the lengths of such texts in static memory.
module beamid_c
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_int64_t
   use beamid_c_calls, only: beamid_begin, beamid_end, beamid_watch_forks, characters, &
      end_progress, progress_of_call, progress_t, told
   use beamid_c_handles, only: borrow_outcome, borrow_problem, close_handle, give_back, &
      new_handle, outcome_t, problem_t
   use beamid_c_responses, only: beamid_respond
   use beamid_c_results, only: beamid_array, beamid_groups, beamid_text
   use beamid_c_runs, only: beamid_run
   use beamid_c_tracking, only: beamid_track_begin, beamid_track_rows, beamid_track_take
   use beamid_case_checks, only: check_needs
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: add_mesh_shifts, add_score_tests, fit_case, judge_case, load_case
   use beamid_case_inferences, only: case_inference_t, infer
   use beamid_cases, only: needs_fit, needs_nothing, parse_case
   use beamid_errors, only: bad_input, error_t
   use beamid_files, only: read_text
   use beamid_fit_reports, only: report_fit
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_inference_outputs, only: report_inferences
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
   use beamid_parameter_names, only: name_length, name_of_parameter
   use beamid_parameters, only: parameters
   use beamid_strings, only: to_text
   implicit none
   private

   public :: beamid_watch_forks, beamid_begin, beamid_end, beamid_open, beamid_close, beamid_fit, &
      beamid_judge, beamid_set_methods, beamid_infer, beamid_respond, beamid_run, beamid_array, &
      beamid_text, beamid_groups, beamid_track_begin, beamid_track_take, beamid_track_rows

contains

   !> Opens a case.
   !>
   !> path     name of the case in messages; files that the case names are relative to its folder.
   !>          If `text` is empty, this is the path of the case file
   !> text     text of a case file
   !> records  number of records whose samples are passed here, in the order of the groups &record;
   !>          0: the samples are in files
   !> sizes    (records) numbers of samples; 0 for a record of another kind than 'time', whose
   !>          values are in the file that its group names
   !> samples  sum of `sizes`
   !> t, z     (samples) times [time] and values of all records; they are copied
   !> fits     0: the case serves responses; 1: it serves fits
   !> handle   of the case, to be closed by `beamid_close`; 0 if there is an error
   integer(c_int) function beamid_open(path, path_length, text, text_length, records, sizes, &
      samples, t, z, fits, handle, message, room) result(status) bind(c)
      integer(c_int), value, intent(in) :: path_length, text_length, records, samples, fits, room
      character(kind=c_char), intent(in) :: path(path_length), text(text_length)
      integer(c_int), intent(in) :: sizes(records)
      real(c_double), intent(in) :: t(samples), z(samples)
      integer(c_int64_t), intent(out) :: handle
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(error_t), allocatable :: error

      handle = 0
      allocate (problem)
      !$omp critical (texts_of_beamid)
      if (any(sizes < 0) .or. sum(int(sizes, c_int64_t)) /= max(samples, 0)) then
         call bad_input(error, 'found buffers of '//to_text(int(samples))//' samples, expected '// &
            'the sum of the records'' sizes')
      else
         call open_case(characters(path), characters(text), sizes, t, z, fits == 1, problem, error)
      end if
      status = told(error, message)
      !$omp end critical (texts_of_beamid)
      if (status == 0) then
         handle = new_handle(problem)
      else
         deallocate (problem)
      end if
   end function beamid_open

   !> Reads a case and its records; arguments as `beamid_open`.
   subroutine open_case(path, text, sizes, t, z, fits, problem, error)
      character(len=*), intent(in) :: path, text
      integer, intent(in) :: sizes(:)
      real(wp), intent(in) :: t(:), z(:)
      logical, intent(in) :: fits
      type(problem_t), intent(inout) :: problem
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: content
      integer :: first, k

      content = text
      if (text == '') call read_text(path, content, error)
      if (.not. allocated(error)) call parse_case(path, content, needs_nothing, problem%case, error)
      if (allocated(error)) return
      problem%is_for_fits = fits
      associate (case => problem%case)
         if (size(sizes) > 0 .and. size(sizes) /= size(case%recordings)) then
            call bad_input(error, path//': found '//to_text(size(sizes))//' records for '// &
               to_text(size(case%recordings))//' groups &record, expected one for each')
            return
         end if
         first = 1
         do k = 1, size(sizes)
            associate (recording => case%recordings(k))
               if (recording%kind /= 'time' .and. sizes(k) == 0) cycle
               recording%path = 'record '//to_text(k)
               recording%t = t(first:first + sizes(k) - 1)
               recording%z = z(first:first + sizes(k) - 1)
               first = first + sizes(k)
            end associate
         end do
         if (fits) call check_needs(case, needs_fit, error)
         if (fits .and. .not. allocated(error)) call load_case(case, problem%loaded, error)
      end associate
      call check_interrupt(error)
   end subroutine open_case

   !> Closes the handle of a case or a fit. It is an error if the handle is closed already or in
   !> use.
   integer(c_int) function beamid_close(handle, message, room) result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: room
      character(kind=c_char), intent(inout) :: message(room)
      type(error_t), allocatable :: error

      call close_handle(handle, error)
      status = told(error, message)
   end function beamid_close

   !> Fits a case.
   !>
   !> of      handle of a case that was opened for fits
   !> check   1: compare exact derivatives with differences before the search
   !> starts  number of start values of the first stage; 0: start as the case says
   !> start   (starts) start values, finite and within the bounds
   !> handle  of the fit, to be closed by `beamid_close`; 0 if there is an error
   integer(c_int) function beamid_fit(of, check, starts, start, handle, message, room) &
      result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: of
      integer(c_int), value, intent(in) :: check, starts, room
      real(c_double), intent(in) :: start(starts)
      integer(c_int64_t), intent(out) :: handle
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(outcome_t), pointer :: outcome
      type(progress_t), pointer :: progress
      type(error_t), allocatable :: error

      handle = 0
      call borrow_problem(of, problem, error)
      if (.not. allocated(error)) then
         allocate (outcome)
         outcome%case = problem%case
         outcome%found = problem%loaded
         if (.not. problem%is_for_fits) call bad_input(error, &
            'found a case opened for responses, expected one opened for fits')
         call give_back(of)
         !$omp critical (texts_of_beamid)
         if (starts > 0 .and. .not. allocated(error)) call start_from(outcome%case, start, error)
         !$omp end critical (texts_of_beamid)
         progress => progress_of_call()
         if (.not. allocated(error)) call fit_case(outcome%case, outcome%found, error, progress, &
            check=check == 1)
         call end_progress(progress)
         if (allocated(error)) then
            deallocate (outcome)
         else
            handle = new_handle(outcome)
         end if
      end if
      status = told(error, message)
   end function beamid_fit

   !> Replaces the start values of the first stage.
   !>
   !> error  a value is not finite or outside its bounds, or their number is wrong
   subroutine start_from(case, start, error)
      type(case_t), intent(inout) :: case
      real(wp), intent(in) :: start(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=name_length) :: name
      integer :: k

      associate (stage => case%stages(1))
         if (size(start) /= size(stage%free)) then
            call bad_input(error, case%path//': found '//to_text(size(start))// &
               ' start values, expected '//to_text(size(stage%free)))
            return
         end if
         call stage%set_bounds()
         do k = 1, size(start)
            name = name_of_parameter(case%model%structure, stage%free(k))
            if (.not. ieee_is_finite(start(k))) then
               call bad_input(error, case%path//': found no finite start value for '//trim(name)// &
                  ', expected a finite number')
            else if (start(k) < stage%lower(k) .or. start(k) > stage%upper(k)) then
               call bad_input(error, case%path//': found start value '//to_text(start(k))// &
                  ' for '//trim(name)//', expected a value between its bounds '// &
                  to_text(stage%lower(k))//' and '//to_text(stage%upper(k)))
            else if (parameters(stage%free(k))%is_reciprocal .and. .not. start(k) > 0) then
               call bad_input(error, case%path//': found start value '//to_text(start(k))// &
                  ' for '//trim(name)//', expected a value above 0')
            end if
            if (allocated(error)) return
         end do
         stage%start = start
         stage%automatic = .false.
         stage%declared = .true.
      end associate
   end subroutine start_from

   !> Judges a fit: mesh refinement, verdict, natural modes, all tables and the summary. Does
   !> nothing if the fit was judged before.
   integer(c_int) function beamid_judge(handle, message, room) result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: room
      character(kind=c_char), intent(inout) :: message(room)
      type(outcome_t), pointer :: outcome
      type(fitted_mode_t), allocatable :: modes(:)
      type(output_t) :: tables
      character(len=:), allocatable :: summary
      type(progress_t), pointer :: progress
      type(error_t), allocatable :: error

      call borrow_outcome(handle, outcome, error)
      if (.not. allocated(error)) then
         if (.not. allocated(outcome%summary)) then
            ! Fits on finer meshes work without text, and may run beside other threads. The verdict
            ! and the score tests, which need it, write sentences.
            progress => progress_of_call()
            call add_mesh_shifts(outcome%case, outcome%found, error, progress)
            call end_progress(progress)
            !$omp critical (texts_of_beamid)
            if (.not. allocated(error)) call judge_case(outcome%case, outcome%found, error)
            if (.not. allocated(error)) call add_score_tests(outcome%case, outcome%found, error)
            if (.not. allocated(error)) call report_fit(outcome%case, outcome%found, tables, &
               summary, error, modes)
            call check_interrupt(error)
            ! An interrupted report is discarded.
            if (.not. allocated(error)) then
               call keep_modes(modes, outcome%modes)
               outcome%tables = tables
               call move_alloc(summary, outcome%summary)
            end if
            !$omp end critical (texts_of_beamid)
         end if
         call give_back(handle)
      end if
      status = told(error, message)
   end function beamid_judge

   !> Gives a fit the settings of `sample` and `bootstrap` that an open case has. They do not change
   !> the fit itself.
   !>
   !> handle  of the fit
   !> of      handle of the case
   integer(c_int) function beamid_set_methods(handle, of, message, room) result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle, of
      integer(c_int), value, intent(in) :: room
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(outcome_t), pointer :: outcome
      type(error_t), allocatable :: error

      call borrow_problem(of, problem, error)
      if (.not. allocated(error)) then
         call borrow_outcome(handle, outcome, error)
         if (.not. allocated(error)) then
            outcome%case%sampling = problem%case%sampling
            outcome%case%bootstrap = problem%case%bootstrap
            call give_back(handle)
         end if
         call give_back(of)
      end if
      status = told(error, message)
   end function beamid_set_methods

   !> Runs `profile`, `sample` or `bootstrap` from a judged fit. Adds the tables of the command to
   !> those of the fit, including intervals.csv with the rows of earlier calls, and sets the text
   !> 'intervals', which the program would print.
   integer(c_int) function beamid_infer(handle, command, command_length, message, room) &
      result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: command_length, room
      character(kind=c_char), intent(in) :: command(command_length)
      character(kind=c_char), intent(inout) :: message(room)
      type(outcome_t), pointer :: outcome
      type(case_inference_t), allocatable :: inferences(:)
      type(output_t) :: tables
      character(len=:), allocatable :: intervals
      type(progress_t), pointer :: progress
      type(error_t), allocatable :: error

      call borrow_outcome(handle, outcome, error)
      if (.not. allocated(error)) then
         if (.not. allocated(outcome%summary)) then
            call bad_input(error, 'found a fit without a verdict, expected one that was judged')
         else if (all(characters(command) /= [character(len=9) :: 'profile', 'sample', &
            'bootstrap'])) then
            call bad_input(error, 'found another command, expected profile, sample or bootstrap')
         end if
         progress => progress_of_call()
         if (.not. allocated(error)) call infer(characters(command), outcome%case, outcome%found, &
            inferences, error, progress)
         call end_progress(progress)
         !$omp critical (texts_of_beamid)
         if (.not. allocated(error)) then
            tables = outcome%tables
            call report_inferences(characters(command), outcome%case, outcome%found, inferences, &
               tables%text_of('intervals.csv'), tables, intervals, error)
         end if
         ! An interrupted report is discarded.
         if (.not. allocated(error)) then
            outcome%tables = tables
            call move_alloc(intervals, outcome%intervals)
         end if
         !$omp end critical (texts_of_beamid)
         call give_back(handle)
      end if
      status = told(error, message)
   end function beamid_infer

   !> Copies natural modes to a table with the columns of `beamid_array`.
   pure subroutine keep_modes(modes, table)
      type(fitted_mode_t), intent(in) :: modes(:)
      real(wp), allocatable, intent(out) :: table(:, :)
      integer :: k

      allocate (table(size(modes), 7))
      do k = 1, size(modes)
         associate (mode => modes(k))
            table(k, :) = [real(mode%record, wp), mode%s%re, mode%s%im, mode%frequency, &
               mode%damping_ratio, mode%frequency_half_width, mode%damping_half_width]
         end associate
      end do
   end subroutine keep_modes

end module beamid_c
