!> Standard error: messages, and the progress of a search.
module beamid_terminal
   use, intrinsic :: iso_c_binding, only: c_int
   use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
   use beamid, only: monitor_t, to_text, wp
   implicit none
   private

   public :: progress_t, new_progress, print_text, tell, complain

   !> One line per iteration: overwritten in a terminal, plain lines elsewhere, none when quiet.
   type, extends(monitor_t) :: progress_t
      logical :: quiet = .false.
      logical, private :: overwrite = .false.
      integer, private :: last_length = 0
   contains
      procedure :: iteration
      procedure :: finish
   end type progress_t

   integer(c_int), parameter :: standard_error = 2

   interface
      integer(c_int) function isatty(descriptor) bind(c)
         import :: c_int
         integer(c_int), value :: descriptor
      end function isatty
   end interface

contains

   function new_progress(quiet) result(progress)
      logical, intent(in) :: quiet
      type(progress_t) :: progress

      progress%quiet = quiet
      progress%overwrite = isatty(standard_error) == 1
   end function new_progress

   subroutine iteration(self, label, number, evaluations, J, names, parameters)
      class(progress_t), intent(inout) :: self
      character(len=*), intent(in) :: label, names(:)
      integer, intent(in) :: number, evaluations
      real(wp), intent(in) :: J, parameters(:)
      character(len=:), allocatable :: line
      integer :: k

      if (self%quiet) return
      line = label//': iteration '//to_text(number)//', '//to_text(evaluations)// &
         ' evaluations, J = '// &
         to_text(J)
      do k = 1, size(parameters)
         line = line//', '//trim(names(k))//' = '//to_text(parameters(k))
      end do
      !$omp critical (standard_error_line)
      if (self%overwrite) then
         write (error_unit, '(3a)', advance='no') achar(13), line, &
            repeat(' ', max(0, self%last_length - len(line)))
         self%last_length = len(line)
      else
         write (error_unit, '(a)') line
      end if
      flush (error_unit)
      !$omp end critical (standard_error_line)
   end subroutine iteration

   !> Clears the overwritten line.
   subroutine finish(self)
      class(progress_t), intent(inout) :: self

      if (self%last_length == 0) return
      write (error_unit, '(3a)', advance='no') achar(13), repeat(' ', self%last_length), achar(13)
      self%last_length = 0
   end subroutine finish

   !> Text on standard output, as it is.
   subroutine print_text(text)
      character(len=*), intent(in) :: text

      write (output_unit, '(a)', advance='no') text
      flush (output_unit)
   end subroutine print_text

   !> A line on standard error.
   subroutine tell(line)
      character(len=*), intent(in) :: line

      write (error_unit, '(a)') line
   end subroutine tell

   !> An error's message on standard error.
   subroutine complain(message)
      character(len=*), intent(in) :: message

      integer :: first, last

      ! Several problems of one file come as several lines.
      first = 1
      do while (first <= len(message))
         last = index(message(first:), new_line('a'))
         last = merge(len(message), first + last - 2, last == 0)
         write (error_unit, '(2a)') 'beamid: ', message(first:last)
         first = last + 2
      end do
   end subroutine complain

end module beamid_terminal
