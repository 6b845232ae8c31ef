!> beamid for C: a case and its records are opened, fitted as often as wanted, and what a fit has
!> found is asked for by name.
!>
!> Every routine returns 0, or 1 (the computation failed) or 2 (bad input) with the library's own
!> sentence in `message`. Texts come as a pointer with a length; `message` is as long as `room` says
!> and ends with a null character. Nothing is kept between calls but what the handles hold: each may
!> be used by one thread at a time, different ones by different threads, and one case by many fits.
!> What works with texts is done by one thread after the other.
module beamid_c
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_f_pointer, c_int, c_loc, &
      c_null_char, c_null_ptr, c_ptr
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_case_checks, only: check_needs, place_experiment
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t, fit_case, judge_case, load_case
   use beamid_case_inferences, only: case_inference_t, infer
   use beamid_cases, only: needs_fit, needs_nothing, needs_response, parse_case
   use beamid_errors, only: bad_input, error_t
   use beamid_experiments, only: experiment_t
   use beamid_files, only: read_text
   use beamid_fit_reports, only: report_fit
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_identification, only: simulate, simulation_t
   use beamid_inference_outputs, only: report_inferences
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
   use beamid_parameters, only: get_free, parameters
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_responses, only: is_exact
   use beamid_strings, only: to_text
   use beamid_statistics, only: unlimited
   use beamid_structure, only: of_kappa_R
   implicit none
   private

   public :: beamid_open, beamid_close, beamid_fit, beamid_judge, beamid_infer, beamid_forget, &
      beamid_respond, beamid_array, beamid_text

   !> A case, and its records where it is to be fitted.
   type :: problem_t
      type(case_t) :: case
      type(case_fit_t) :: loaded
   end type problem_t

   !> A fit.
   type :: outcome_t
      type(case_t) :: case
      type(case_fit_t) :: found
      type(output_t) :: tables
      character(len=:), allocatable :: summary, intervals
      real(wp), allocatable :: estimates(:, :), modes(:, :), t(:), measured(:), J(:)
   end type outcome_t

contains

   !> Reads a case.
   !>
   !> path     what messages call it, and files in it are relative to; where `text` is of length 0
   !>          it is the case file
   !> text     of a case file
   !> records  how many come as samples in memory, in the order of its groups &record; 0: they are
   !>          on file
   !> sizes    (records) of samples
   !> t, z     (sum of sizes) times and values of all of them, copied
   !> fits     0: for responses, 1: for fits
   !> handle   to be given to `beamid_close`; null where there was an error
   integer(c_int) function beamid_open(path, path_length, text, text_length, records, sizes, t, z, &
      fits, handle, message, room) result(status) bind(c)
      integer(c_int), value, intent(in) :: path_length, text_length, records, fits, room
      character(kind=c_char), intent(in) :: path(path_length), text(text_length)
      integer(c_int), intent(in) :: sizes(records)
      real(c_double), intent(in) :: t(*), z(*)
      type(c_ptr), intent(out) :: handle
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(error_t), allocatable :: error

      handle = c_null_ptr
      allocate (problem)
      !$omp critical (texts_of_beamid)
      call open_case(characters(path), characters(text), sizes, t(:sum(sizes)), z(:sum(sizes)), &
         fits == 1, problem, error)
      status = told(error, message)
      !$omp end critical (texts_of_beamid)
      if (status == 0) handle = c_loc(problem)
      if (status /= 0) deallocate (problem)
   end function beamid_open

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
      associate (case => problem%case)
         if (size(sizes) > 0 .and. size(sizes) /= size(case%recordings)) then
            call bad_input(error, path//': found '//to_text(size(sizes))//' records for '// &
               to_text(size(case%recordings))//' groups &record, expected one for each')
            return
         end if
         first = 1
         do k = 1, size(sizes)
            associate (recording => case%recordings(k))
               recording%path = 'record '//to_text(k)
               recording%t = t(first:first + sizes(k) - 1)
               recording%z = z(first:first + sizes(k) - 1)
               first = first + sizes(k)
            end associate
         end do
         if (fits) call check_needs(case, needs_fit, error)
         if (fits .and. .not. allocated(error)) call load_case(case, problem%loaded, error)
      end associate
   end subroutine open_case

   subroutine beamid_close(handle) bind(c)
      type(c_ptr), value, intent(in) :: handle
      type(problem_t), pointer :: problem

      call c_f_pointer(handle, problem)
      deallocate (problem)
   end subroutine beamid_close

   !> Fits an open case.
   !>
   !> check   1: derivatives are compared with differences before the search
   !> starts  how many start values of the first stage follow; 0: those of the case
   !> start   (starts)
   !> handle  of the outcome, to be given to `beamid_forget`; null where the fit failed
   integer(c_int) function beamid_fit(of, check, starts, start, handle, message, room) &
      result(status) bind(c)
      type(c_ptr), value, intent(in) :: of
      integer(c_int), value, intent(in) :: check, starts, room
      real(c_double), intent(in) :: start(starts)
      type(c_ptr), intent(out) :: handle
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(outcome_t), pointer :: outcome
      type(error_t), allocatable :: error

      handle = c_null_ptr
      call c_f_pointer(of, problem)
      allocate (outcome)
      outcome%case = problem%case
      outcome%found = problem%loaded
      if (starts > 0) call start_from(outcome%case, start, error)
      if (.not. allocated(error)) call fit_case(outcome%case, outcome%found, error, &
         check=check == 1)
      status = told(error, message)
      if (status == 0) handle = c_loc(outcome)
      if (status /= 0) deallocate (outcome)
   end function beamid_fit

   subroutine start_from(case, start, error)
      type(case_t), intent(inout) :: case
      real(wp), intent(in) :: start(:)
      type(error_t), allocatable, intent(out) :: error

      associate (stage => case%stages(1))
         if (size(start) /= size(stage%free)) then
            call bad_input(error, case%path//': found '//to_text(size(start))// &
               ' start values, expected '//to_text(size(stage%free)))
            return
         end if
         stage%start = start
         stage%automatic = .false.
         stage%declared = .true.
      end associate
   end subroutine start_from

   !> What finer meshes do to the estimates, the verdict, the modes, all tables and the summary;
   !> once for a fit, however often it is asked for.
   integer(c_int) function beamid_judge(handle, message, room) result(status) bind(c)
      type(c_ptr), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: room
      character(kind=c_char), intent(inout) :: message(room)
      type(outcome_t), pointer :: outcome
      type(fitted_mode_t), allocatable :: modes(:)
      type(error_t), allocatable :: error

      call c_f_pointer(handle, outcome)
      !$omp critical (texts_of_beamid)
      if (.not. allocated(outcome%summary)) then
         call judge_case(outcome%case, outcome%found, error)
         if (.not. allocated(error)) call report_fit(outcome%case, outcome%found, outcome%tables, &
            outcome%summary, error, modes)
         if (.not. allocated(error)) call keep_modes(modes, outcome%modes)
         call add_estimates(outcome)
      end if
      status = told(error, message)
      !$omp end critical (texts_of_beamid)
   end function beamid_judge

   !> What profile, sample or bootstrap find out about a fit that was judged: tables, among them
   !> intervals.csv with those of earlier calls, and the text 'intervals', which the program prints.
   integer(c_int) function beamid_infer(handle, command, command_length, message, room) &
      result(status) bind(c)
      type(c_ptr), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: command_length, room
      character(kind=c_char), intent(in) :: command(command_length)
      character(kind=c_char), intent(inout) :: message(room)
      type(outcome_t), pointer :: outcome
      type(case_inference_t), allocatable :: inferences(:)
      type(error_t), allocatable :: error

      call c_f_pointer(handle, outcome)
      call infer(characters(command), outcome%case, outcome%found, inferences, error)
      !$omp critical (texts_of_beamid)
      if (.not. allocated(error)) call report_inferences(characters(command), outcome%case, &
         outcome%found, inferences, outcome%tables%text_of('intervals.csv'), outcome%tables, &
         outcome%intervals)
      status = told(error, message)
      !$omp end critical (texts_of_beamid)
   end function beamid_infer

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

   subroutine beamid_forget(handle) bind(c)
      type(c_ptr), value, intent(in) :: handle
      type(outcome_t), pointer :: outcome

      call c_f_pointer(handle, outcome)
      deallocate (outcome)
   end subroutine beamid_forget

   !> Response of the structure of an open case on the last of its meshes, with derivatives by what
   !> the first stage frees, where there is one: by a stiffness itself, also where a search would
   !> look for its reciprocal.
   !>
   !> t            (n) ascending [time]
   !> motion       (n, 3) acceleration as observed; displacement and velocity of the sensor
   !> derivatives  (n, k) of the acceleration; k = 0: none
   integer(c_int) function beamid_respond(of, n, t, k, motion, derivatives, message, room) &
      result(status) bind(c)
      type(c_ptr), value, intent(in) :: of
      integer(c_int), value, intent(in) :: n, k, room
      real(c_double), intent(in) :: t(n)
      real(c_double), intent(inout) :: motion(n, 3), derivatives(n, k)
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(case_t) :: case
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error

      call c_f_pointer(of, problem)
      case = problem%case
      !$omp critical (texts_of_beamid)
      call prepare_response(case, t, k, error)
      !$omp end critical (texts_of_beamid)
      if (.not. allocated(error)) call simulate(case%model, case%meshes(size(case%meshes)), t, &
         simulation, error)
      if (.not. allocated(error)) then
         motion(:, 1) = simulation%acceleration
         motion(:, 2) = simulation%response%displacement
         motion(:, 3) = simulation%response%velocity
         if (k > 0) call differentiate(case, t, derivatives, error)
      end if
      status = told(error, message)
   end function beamid_respond

   !> What the command line asks of a case whose response is wanted.
   subroutine prepare_response(case, t, k, error)
      type(case_t), intent(inout) :: case
      real(wp), intent(in) :: t(:)
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: experiment

      if (size(case%recordings) == 1) then
         associate (window => case%recordings(1)%window)
            window%t_first = t(1)
            window%t_last = t(size(t))
            window%t_step = 1.0_wp
         end associate
      end if
      call check_needs(case, needs_response, error)
      if (allocated(error)) return
      call place_experiment(case, 1, experiment, error)
      if (allocated(error)) return
      case%model%structure = experiment%structure_of(case%model%structure)
      if (k > 0 .and. .not. is_exact(case%model%solver)) call bad_input(error, case%path// &
         ': &integrator method: found ''cvode'', expected ''modal'' for exact derivatives')
   end subroutine prepare_response

   subroutine differentiate(case, t, derivatives, error)
      type(case_t), intent(in) :: case
      real(wp), intent(in) :: t(:)
      real(wp), intent(inout) :: derivatives(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: problem
      type(experiment_t) :: experiment
      real(wp), allocatable :: p(:), y(:)
      integer :: k

      experiment%samples = t
      experiment%measured = 0*t
      experiment%excitation = case%model%excitation
      associate (free => case%stages(1)%free)
         call new_residuals(case%model, case%meshes(size(case%meshes)), [experiment], problem, &
            error, turning=any(free == of_kappa_R))
         if (allocated(error)) return
         problem%free = free
         problem%record = 0*free
         p = [(get_free(problem%world%structures(1), problem%world%excitations(1), free(k)), &
            k=1, size(free))]
         allocate (y(size(t)))
         call problem%jacobian(p, y, derivatives, error)
         if (allocated(error)) return
         do k = 1, size(free)
            if (parameters(free(k))%is_reciprocal) derivatives(:, k) = -p(k)**2*derivatives(:, k)
         end do
      end associate
   end subroutine differentiate

   !> An array of an outcome, by its name; it stays where it is, as long as the outcome does.
   !>
   !> name     estimates  (n, 11) start, value, its bounds, standard error, and ends of the 95 %
   !>                     intervals by white noise, by the noise as it is, by every source of error
   !>          covariance, correlation  (n, n) of what was searched for
   !>          residual (m), jacobian (m, n), t (m), measured (m)
   !>          modes      (k, 7) record, s, |s|/(2 pi), damping ratio, half widths of both
   !>          J          (2) sum of squares, and over the window of the score or -1
   !> data     null where there is none of the name
   subroutine beamid_array(handle, name, name_length, data, rows, columns) bind(c)
      type(c_ptr), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: name_length
      character(kind=c_char), intent(in) :: name(name_length)
      type(c_ptr), intent(out) :: data
      integer(c_int), intent(out) :: rows, columns
      type(outcome_t), pointer :: outcome
      integer :: k

      call c_f_pointer(handle, outcome)
      data = c_null_ptr
      rows = 0
      columns = 0
      associate (found => outcome%found)
         associate (fit => found%fits(size(found%fits, 1), size(found%fits, 2)))
            select case (characters(name))
            case ('estimates')
               if (.not. allocated(outcome%estimates)) call add_estimates(outcome)
               call give_matrix(outcome%estimates)
            case ('covariance'); call give_matrix(fit%statistics%covariance)
            case ('correlation'); call give_matrix(fit%statistics%correlation)
            case ('jacobian'); call give_matrix(fit%jacobian)
            case ('modes'); call give_matrix(outcome%modes)
            case ('residual'); call give_vector(fit%residual)
            case ('t')
               if (.not. allocated(outcome%t)) outcome%t = &
                  [(found%experiments(k)%samples, k=1, size(found%experiments))]
               call give_vector(outcome%t)
            case ('measured')
               if (.not. allocated(outcome%measured)) outcome%measured = &
                  [(found%experiments(k)%measured, k=1, size(found%experiments))]
               call give_vector(outcome%measured)
            case ('J')
               outcome%J = [fit%fit%J, fit%score]
               call give_vector(outcome%J)
            end select
         end associate
      end associate

   contains

      subroutine give_vector(values)
         real(wp), allocatable, intent(in), target :: values(:)

         if (.not. allocated(values)) return
         rows = size(values)
         columns = 1
         if (rows > 0) data = c_loc(values)
      end subroutine give_vector

      subroutine give_matrix(values)
         real(wp), allocatable, intent(in), target :: values(:, :)

         if (.not. allocated(values)) return
         rows = size(values, 1)
         columns = size(values, 2)
         if (size(values) > 0) data = c_loc(values)
      end subroutine give_matrix

   end subroutine beamid_array

   !> Once allocated they stay where they are, as somebody may be looking at them.
   subroutine add_estimates(outcome)
      type(outcome_t), intent(inout) :: outcome
      integer :: k, n

      associate (fits => outcome%found%fits)
         associate (fit => fits(size(fits, 1), size(fits, 2)))
            n = size(fit%quantities)
            if (.not. allocated(outcome%estimates)) allocate (outcome%estimates(n, 11))
            outcome%estimates(:, :) = ieee_value(1.0_wp, ieee_quiet_nan)
            do k = 1, n
               associate (q => fit%quantities(k), s => fit%statistics, row => &
                  outcome%estimates(k, :))
                  row(:4) = [q%start, q%value, q%lower, q%upper]
                  if (s%samples == 0) cycle
                  if (.not. s%std_error(k) < unlimited) cycle
                  row(5:7) = q%limits(s%std_error(k), s%half_width(k))
                  if (.not. fit%half_width(k) < unlimited) cycle
                  row(8:9) = q%ends([1, 1]*s%corrected_half_width(k))
                  row(10:11) = q%ends(fit%total(k))
               end associate
            end do
         end associate
      end associate
   end subroutine add_estimates

   !> A text of an outcome; its length is returned, and as much as there is room for is copied.
   !>
   !> name  names       of what was estimated, each in a line
   !>       units       of these
   !>       note        which parameters are held because a mode is not in the record
   !>   and of one that was judged
   !>       summary     as the program prints it
   !>       no_fit      why the fit is none
   !>       intervals   what the last `beamid_infer` has to say
   !>       tables      names of the tables, each in a line; any of these is the text of that table
   integer(c_int) function beamid_text(handle, name, name_length, text, room) result(length) bind(c)
      type(c_ptr), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: name_length, room
      character(kind=c_char), intent(in) :: name(name_length)
      character(kind=c_char), intent(inout) :: text(room)
      type(outcome_t), pointer :: outcome
      character(len=:), allocatable :: content
      integer :: k

      call c_f_pointer(handle, outcome)
      content = ''
      !$omp critical (texts_of_beamid)
      associate (found => outcome%found)
         associate (fit => found%fits(size(found%fits, 1), size(found%fits, 2)))
            select case (characters(name))
            case ('names')
               do k = 1, size(fit%quantities)
                  content = content//trim(fit%quantities(k)%name)//new_line('a')
               end do
            case ('units')
               do k = 1, size(fit%quantities)
                  content = content//outcome%case%units%of_quantity(fit%quantities(k)%parameter, &
                     fit%excitation)//new_line('a')
               end do
            case ('note')
               if (allocated(fit%note)) content = fit%note
            case ('summary')
               if (allocated(outcome%summary)) content = outcome%summary
            case ('intervals')
               if (allocated(outcome%intervals)) content = outcome%intervals
            case ('no_fit')
               if (allocated(found%verdict%no_fit)) content = found%verdict%no_fit
            case ('tables'); content = outcome%tables%names()
            case default; content = outcome%tables%text_of(characters(name))
            end select
         end associate
      end associate
      !$omp end critical (texts_of_beamid)
      length = len(content)
      do k = 1, min(length, room)
         text(k) = content(k:k)
      end do
   end function beamid_text

   !> Characters of C as a text.
   pure function characters(letters) result(text)
      character(kind=c_char), intent(in) :: letters(:)
      character(len=size(letters)) :: text
      integer :: k

      do k = 1, size(letters)
         text(k:k) = letters(k)
      end do
   end function characters

   !> The status of an error, whose message goes into C's characters as far as there is room.
   integer(c_int) function told(error, message) result(status)
      type(error_t), allocatable, intent(in) :: error
      character(kind=c_char), intent(inout) :: message(:)
      integer :: k, length

      status = 0
      message(1) = c_null_char
      if (.not. allocated(error)) return
      status = error%status
      length = min(len(error%message), size(message) - 1)
      do k = 1, length
         message(k) = error%message(k:k)
      end do
      message(length + 1) = c_null_char
   end function told

end module beamid_c
