!> Standard output, and standard error: messages, and the progress of a search. Both are written
!> through the C library, as gfortran's runtime does not report what a full device refuses.
module beamid_terminal
   use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_long, c_short
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid, only: error_t, failure, monitor_t, wp
   use beamid_posix, only: c_signal, reason, sig_ign, sigpipe, write_bytes
   use beamid_strings, only: to_text
   implicit none
   private

   public :: progress_t, new_progress, print_text, tell, complain

   !> One line per iteration: overwritten in a terminal, plain lines elsewhere, none when quiet.
   type, extends(monitor_t) :: progress_t
      logical :: quiet = .false.
      logical, private :: overwrite = .false.
      integer, private :: last_length = 0
      integer(int64), private :: begin = 0    !< by the system's clock
      integer(int64), private :: told = 0     !< when the last line was written
      real(wp), private :: left = -1          !< seconds; -1: not known
   contains
      procedure :: iteration
      procedure :: done
      procedure :: advanced
      procedure :: finish
   end type progress_t

   integer(c_int), parameter :: standard_output = 1, standard_error = 2
   character(len=*), parameter :: line_feed = new_line('a'), carriage_return = achar(13)

   interface
      integer(c_int) function isatty(descriptor) bind(c)
         import :: c_int
         integer(c_int), value :: descriptor
      end function isatty
      integer(c_int) function c_ioctl(descriptor, request, size) bind(c, name='ioctl')
         import :: c_int, c_long, c_short
         integer(c_int), value :: descriptor
         integer(c_long), value :: request
         integer(c_short), intent(inout) :: size(4)
      end function c_ioctl
   end interface

contains

   function new_progress(quiet) result(progress)
      logical, intent(in) :: quiet
      type(progress_t) :: progress

      progress%quiet = quiet
      progress%overwrite = isatty(standard_error) == 1
      call system_clock(progress%begin)
   end function new_progress

   subroutine iteration(self, label, number, evaluations, J, names, parameters)
      class(progress_t), intent(inout) :: self
      character(len=*), intent(in) :: label, names(:)
      integer, intent(in) :: number, evaluations
      real(wp), intent(in) :: J, parameters(:)
      character(len=:), allocatable :: line
      integer :: k

      if (self%quiet) return
      line = label//': iteration '//to_text(number)//', '//to_text(evaluations)//' evaluations, '
      if (self%left >= 0) line = line//'about '//to_text(ceiling(self%left))//' s left, '
      line = line//'J = '//to_text(J)
      do k = 1, size(parameters)
         line = line//', '//trim(names(k))//' = '//to_text(parameters(k))
      end do
      !$omp critical (standard_error_line)
      call write_over(self, line)
      !$omp end critical (standard_error_line)
   end subroutine iteration

   !> A line that the next one takes the place of, in a terminal.
   subroutine write_over(self, line)
      class(progress_t), intent(inout) :: self
      character(len=*), intent(in) :: line
      integer :: length

      if (.not. self%overwrite) then
         call tell(line)
         return
      end if
      ! A line as wide as the terminal would already go on in the next one.
      length = min(len(line), terminal_width() - 1)
      call show(carriage_return//line(:length)//repeat(' ', max(0, self%last_length - length)))
      self%last_length = length
   end subroutine write_over

   !> How many are done: in a terminal five times a second, elsewhere every ten seconds.
   subroutine advanced(self, part, whole, pieces)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: pieces
      integer(int64) :: now, rate

      if (whole > 0) call self%done(part, whole)
      call system_clock(now, rate)
      if (self%quiet .or. part == whole) return
      if (now - max(self%told, self%begin) < merge(rate/5, 10*rate, self%overwrite)) return
      self%told = now
      if (whole == 0) then
         call write_over(self, to_text(part)//' '//pieces)
      else
         call write_over(self, to_text(part)//' of '//to_text(whole)//' '//pieces//', about '// &
            to_text(ceiling(self%left))//' s left')
      end if
   end subroutine advanced

   !> What is left takes as long as what is done has taken, in proportion.
   subroutine done(self, part, whole)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      integer(int64) :: now, rate

      call system_clock(now, rate)
      self%left = real(now - self%begin, wp)/rate*(whole - part)/part
      if (part < whole) return
      self%left = -1
      self%begin = now
   end subroutine done

   !> Columns of the terminal behind standard error; 80 where it does not say.
   integer function terminal_width() result(width)
      integer(c_long), parameter :: ask_size = int(z'5413', c_long)   ! TIOCGWINSZ of Linux
      integer(c_short) :: size(4)

      size = 0
      width = 80
      if (c_ioctl(standard_error, ask_size, size) /= 0) return
      if (size(2) > 20) width = size(2)
   end function terminal_width

   !> Clears the overwritten line.
   subroutine finish(self)
      class(progress_t), intent(inout) :: self

      if (self%last_length == 0) return
      call show(carriage_return//repeat(' ', min(self%last_length, terminal_width() - 1))// &
         carriage_return)
      self%last_length = 0
   end subroutine finish

   !> Text on standard output, as it is; a reader that has gone away is a failure as well.
   subroutine print_text(text, error)
      character(len=*), intent(in) :: text
      type(error_t), allocatable, intent(out) :: error
      integer(c_intptr_t) :: action
      integer(c_int) :: code

      action = c_signal(sigpipe, sig_ign)
      code = write_bytes(standard_output, text)
      action = c_signal(sigpipe, action)
      if (code /= 0) call failure(error, 'standard output: cannot be written: '//reason(code))
   end subroutine print_text

   !> A line on standard error.
   subroutine tell(line)
      character(len=*), intent(in) :: line

      call show(line//line_feed)
   end subroutine tell

   !> Text on standard error; when that takes none, there is no place left to say so.
   subroutine show(text)
      character(len=*), intent(in) :: text
      integer(c_int) :: ignored

      ignored = write_bytes(standard_error, text)
   end subroutine show

   !> An error's message on standard error; several problems of one file come as several lines.
   subroutine complain(message)
      character(len=*), intent(in) :: message
      integer :: first, length

      first = 1
      do while (first <= len(message))
         length = scan(message(first:)//line_feed, line_feed)
         call tell('beamid: '//message(first:first + length - 2))
         first = first + length
      end do
   end subroutine complain

end module beamid_terminal
