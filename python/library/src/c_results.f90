!> The results of a fit for C: arrays and texts, copied out by name.
module beamid_c_results
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_int64_t
   use beamid_c_calls, only: characters, told
   use beamid_c_handles, only: borrow_outcome, give_back, outcome_t
   use beamid_case_files, only: groups
   use beamid_errors, only: bad_input, error_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_statistics, only: unlimited
   use beamid_texts, only: wrapped
   implicit none
   private

   public :: beamid_array, beamid_text, beamid_groups

contains

   !> Copies an array of a fit.
   !>
   !> name     estimates  (n, 11) start, estimate, lower and upper bound, standard error, and the
   !>          ends
   !>                     of three 95 % intervals: for white noise, for the noise as it is, and with
   !>                     every source of error
   !>          covariance, correlation  (n, n) of the searched variables
   !>          residual (m), jacobian (m, n), t (m), measured (m)
   !>          modes      (k, 7) record, real and imaginary part of s, |s|/(2 pi), damping ratio,
   !>          and
   !>                     the half widths of the last two; empty before the fit is judged
   !>          J          (2) sum of squares; sum of squares over the window of &score, or -1
   !> places         size of `data`
   !> data           (rows*columns) the array, column by column; unchanged if `places` is too small
   !> rows, columns  shape of the array
   integer(c_int) function beamid_array(handle, name, name_length, places, data, rows, columns, &
      message, room) result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: name_length, room
      integer(c_int64_t), value, intent(in) :: places
      character(kind=c_char), intent(in) :: name(name_length)
      real(c_double), intent(inout) :: data(places)
      integer(c_int), intent(out) :: rows, columns
      character(kind=c_char), intent(inout) :: message(room)
      type(outcome_t), pointer :: outcome
      type(stage_fit_t), pointer :: fit
      type(error_t), allocatable :: error
      integer :: k

      rows = 0
      columns = 0
      call borrow_outcome(handle, outcome, error)
      if (.not. allocated(error)) then
         fit => outcome%last_fit()
         associate (found => outcome%found)
            select case (characters(name))
            case ('estimates'); call give_matrix(estimates_of(fit))
            case ('covariance'); call give_matrix(fit%statistics%covariance)
            case ('correlation'); call give_matrix(fit%statistics%correlation)
            case ('jacobian'); call give_matrix(fit%jacobian)
            case ('modes')
               if (allocated(outcome%modes)) call give_matrix(outcome%modes)
            case ('residual'); call give_vector(fit%residual)
            case ('t')
               call give_vector([(found%experiments(k)%samples, k=1, size(found%experiments))])
            case ('measured')
               call give_vector([(found%experiments(k)%measured, k=1, size(found%experiments))])
            case ('J'); call give_vector([fit%fit%J, fit%score])
            case default
               call bad_input(error, 'found an unknown name of an array, expected one of '// &
                  'estimates, covariance, correlation, jacobian, modes, residual, t, measured, J')
            end select
         end associate
         call give_back(handle)
      end if
      status = told(error, message)

   contains

      !> Copies a vector to `data`.
      subroutine give_vector(values)
         real(wp), intent(in) :: values(:)

         rows = size(values)
         columns = 1
         if (places >= size(values)) data(:size(values)) = values
      end subroutine give_vector

      !> Copies a matrix to `data`, column by column.
      subroutine give_matrix(values)
         real(wp), intent(in) :: values(:, :)
         integer :: j

         rows = size(values, 1)
         columns = size(values, 2)
         if (places < size(values)) return
         do j = 1, size(values, 2)
            data((j - 1)*size(values, 1) + 1:j*size(values, 1)) = values(:, j)
         end do
      end subroutine give_matrix

   end function beamid_array

   !> Returns the array 'estimates' (n, 11); NaN: not determined.
   function estimates_of(fit) result(table)
      type(stage_fit_t), intent(in) :: fit
      real(wp) :: table(size(fit%quantities), 11)
      integer :: k

      table(:, :) = ieee_value(1.0_wp, ieee_quiet_nan)
      do k = 1, size(table, 1)
         associate (q => fit%quantities(k), s => fit%statistics, row => table(k, :))
            row(:4) = [q%start, q%value, q%lower, q%upper]
            if (s%samples == 0) cycle
            if (.not. s%std_error(k) < unlimited) cycle
            row(5:7) = q%limits(s%std_error(k), s%half_width(k))
            if (.not. fit%half_width(k) < unlimited) cycle
            row(8:9) = q%ends([1, 1]*s%corrected_half_width(k))
            row(10:11) = q%ends(fit%total(k))
         end associate
      end do
   end function estimates_of

   !> Copies a text of a fit, or of the results of `beamid_run`, as far as there is room.
   !>
   !> name    names       names of the estimates, one in each line
   !>         units       units of the estimates, one in each line
   !>         note        remark on a parameter held fixed because a mode is not in the record
   !>   and for a judged fit
   !>         summary     summary, as the program prints it
   !>         no_fit      why the verdict rejects the fit; '': it does not
   !>         intervals   text of the last `beamid_infer`
   !>         tables      names of the tables, one in each line; each name is the name of a text,
   !>         too
   !> places  size of `text`
   !> length  length of the whole text
   integer(c_int) function beamid_text(handle, name, name_length, text, places, length, message, &
      room) result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: name_length, places, room
      character(kind=c_char), intent(in) :: name(name_length)
      character(kind=c_char), intent(inout) :: text(places), message(room)
      integer(c_int), intent(out) :: length
      type(outcome_t), pointer :: outcome
      type(stage_fit_t), pointer :: fit
      character(len=:), allocatable :: content
      type(error_t), allocatable :: error

      length = 0
      call borrow_outcome(handle, outcome, error, or_results=.true.)
      if (.not. allocated(error)) then
         !$omp critical (texts_of_beamid)
         content = ''
         fit => outcome%last_fit()
         select case (characters(name))
         case ('names', 'units', 'note', 'no_fit')
            if (associated(fit)) call add_text_of_fit()
         case ('summary')
            if (allocated(outcome%summary)) content = wrapped(outcome%summary)
         case ('intervals')
            if (allocated(outcome%intervals)) content = wrapped(outcome%intervals)
         case ('tables'); content = outcome%tables%names()
         case default; content = outcome%tables%text_of(characters(name))
         end select
         call copy(content, text)
         length = len(content)
         !$omp end critical (texts_of_beamid)
         call give_back(handle)
      end if
      status = told(error, message)

   contains

      !> Sets a text that only a fit has.
      subroutine add_text_of_fit()
         integer :: k

         select case (characters(name))
         case ('names')
            do k = 1, size(fit%quantities)
               content = content//trim(fit%quantities(k)%name)//new_line('a')
            end do
         case ('units')
            do k = 1, size(fit%quantities)
               content = content//outcome%case%units%of_quantity(fit%quantities(k)%parameter, &
                  fit%scenario%excitations(1))//new_line('a')
            end do
         case ('note')
            if (allocated(fit%note)) content = fit%note
         case ('no_fit')
            if (allocated(outcome%found%verdict%no_fit)) content = outcome%found%verdict%no_fit
         end select
      end subroutine add_text_of_fit

   end function beamid_text

   !> Copies the names of the groups of a case file, one in each line, as far as there is room;
   !> returns the length of the whole text.
   integer(c_int) function beamid_groups(text, places) result(length) bind(c)
      integer(c_int), value, intent(in) :: places
      character(kind=c_char), intent(inout) :: text(places)
      character(len=:), allocatable :: content
      integer :: k

      !$omp critical (texts_of_beamid)
      content = ''
      do k = 1, size(groups)
         content = content//trim(groups(k)%name)//new_line('a')
      end do
      call copy(content, text)
      length = len(content)
      !$omp end critical (texts_of_beamid)
   end function beamid_groups

   !> Copies a text into characters of C, as far as there is room.
   subroutine copy(content, text)
      character(len=*), intent(in) :: content
      character(kind=c_char), intent(inout) :: text(:)
      integer :: k

      do k = 1, min(len(content), size(text))
         text(k) = content(k:k)
      end do
   end subroutine copy

end module beamid_c_results
