!> Output to the terminal: text on standard output; messages and progress on standard error. Both
!> are written through the C library, because gfortran's runtime does not report a full device.
module beamid_terminal
   use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t, c_long, c_short
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid, only: error_t, failure, monitor_t, wp
   use beamid_kinds, only: ip
   use beamid_posix, only: c_signal, reason, sig_ign, sigpipe, write_bytes
   use beamid_strings, only: to_text
   use beamid_texts, only: next_line
   implicit none
   private

   public :: progress_t, new_progress, page_width, print_text, tell, complain

   !> Progress of a computation on standard error, one line for each report. In a terminal each line
   !> overwrites the one before.
   type, extends(monitor_t) :: progress_t
      logical :: quiet = .false.              !< no progress
      logical, private :: overwrite = .false.   !< standard error is a terminal
      integer, private :: last_length = 0     !< of the line that will be overwritten [characters]
      integer(int64), private :: begin = 0    !< start of the computation [clock counts]
      integer(int64), private :: told = 0     !< time of the last line [clock counts]
      real(wp), private :: left = -1          !< expected remaining time [s]; -1: not known
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

   !> Returns a progress that starts now.
   function new_progress(quiet) result(progress)
      logical, intent(in) :: quiet
      type(progress_t) :: progress

      progress%quiet = quiet
      progress%overwrite = isatty(standard_error) == 1
      call system_clock(progress%begin)
   end function new_progress

   !> Shows one iteration of a search.
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

   !> Writes a line over the line before, if standard error is a terminal.
   subroutine write_over(self, line)
      class(progress_t), intent(inout) :: self
      character(len=*), intent(in) :: line
      integer :: length

      if (.not. self%overwrite) then
         call tell(line)
         return
      end if
      ! A line as wide as the terminal would wrap.
      length = min(len(line), terminal_width(standard_error) - 1)
      call show(carriage_return//line(:length)//repeat(' ', max(0, self%last_length - length)))
      self%last_length = length
   end subroutine write_over

   !> Shows how many pieces are done: in a terminal five times a second, elsewhere every five
   !> seconds.
   !>
   !> part    number of pieces that are done
   !> whole   number of all pieces; 0: not known
   !> pieces  name of the pieces
   subroutine advanced(self, part, whole, pieces)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: pieces
      integer(int64) :: now, rate

      if (whole > 0) call self%done(part, whole)
      call system_clock(now, rate)
      if (self%quiet .or. part == whole) return
      if (now - max(self%told, self%begin) < merge(rate/5, 5*rate, self%overwrite)) return
      self%told = now
      if (whole == 0) then
         call write_over(self, to_text(part)//' '//pieces)
      else
         call write_over(self, to_text(part)//' of '//to_text(whole)//' '//pieces//', about '// &
            to_text(ceiling(self%left))//' s left')
      end if
   end subroutine advanced

   !> Updates the expected remaining time, in proportion to the time that the done part has taken.
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

   !> Returns the width of the terminal at a descriptor [characters]; 80 if it is not known.
   integer function terminal_width(descriptor) result(width)
      integer(c_int), intent(in) :: descriptor
      integer(c_long), parameter :: ask_size = int(z'5413', c_long)   ! TIOCGWINSZ of Linux
      integer(c_short) :: size(4)

      size = 0
      width = 80
      if (c_ioctl(descriptor, ask_size, size) /= 0) return
      if (size(2) > 20) width = size(2)
   end function terminal_width

   !> Returns the width of pages on standard output [characters]: that of the environment variable
   !> COLUMNS or of the terminal, but at least 40; 80 if neither is known.
   integer function page_width() result(width)
      integer, parameter :: least = 40, most = 10000
      character(len=6) :: columns
      integer :: length, status

      width = terminal_width(standard_output)
      call get_environment_variable('COLUMNS', columns, length, status)
      if (status == 0 .and. length > 0 .and. verify(trim(columns), '0123456789') == 0) &
         read (columns, *) width
      width = min(max(width, least), most)
   end function page_width

   !> Clears the line that would be overwritten.
   subroutine finish(self)
      class(progress_t), intent(inout) :: self

      if (self%last_length == 0) return
      call show(carriage_return//repeat(' ', min(self%last_length, &
         terminal_width(standard_error) - 1))//carriage_return)
      self%last_length = 0
   end subroutine finish

   !> Prints text on standard output; it is an error too if its reader has gone away (a closed
   !> pipe).
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

   !> Prints a line on standard error.
   subroutine tell(line)
      character(len=*), intent(in) :: line

      call show(line//line_feed)
   end subroutine tell

   !> Prints text on standard error; a failure is ignored, because nothing is left to report it.
   subroutine show(text)
      character(len=*), intent(in) :: text
      integer(c_int) :: ignored

      ignored = write_bytes(standard_error, text)
   end subroutine show

   !> Prints an error message on standard error; each line of it begins with the program's name.
   subroutine complain(message)
      character(len=*), intent(in) :: message
      character(len=:), allocatable :: line
      integer(ip) :: first

      first = 1
      do while (next_line(message, first, line))
         call tell('beamid: '//line)
      end do
   end subroutine complain

end module beamid_terminal
