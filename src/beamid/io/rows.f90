!> The rows and fields of a text table, one after the other.
module beamid_rows
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: ip
   use beamid_numbers, only: shown
   use beamid_strings, only: to_text
   implicit none
   private

   public :: reader_t, column_length, tab

   character(len=*), parameter :: tab = achar(9), line_feed = achar(10), &
      carriage_return = achar(13), byte_order_mark = char(239)//char(187)//char(191)
   !> Names of columns are cut to this length.
   integer, parameter :: column_length = 100

   !> A text table, with a current row and a current field.
   type :: reader_t
      character(len=:), allocatable :: path, text
      !> Names of the columns, or size 0.
      character(len=column_length), allocatable :: header(:)
      !> Number of the current line in the file.
      integer(ip) :: line = 0
      !> First and last byte of the current field.
      integer(ip) :: left = 1, right = 0
      !> First and last byte of the current line without its end, and where the next one begins.
      integer(ip), private :: first = 1, last = 0, next = 1
      !> What separates the fields of the line: a tab when it has tabs and no comma.
      character(len=1), private :: separator = ','
   contains
      procedure :: rewind => go_to_start
      procedure :: next_row
      procedure :: row
      procedure :: restart_row
      procedure :: next_field
      procedure :: count_fields
      procedure :: problem
   end type reader_t

contains

   !> Goes before the first line, behind a byte order mark.
   subroutine go_to_start(self)
      class(reader_t), intent(inout) :: self

      self%line = 0
      self%next = 1
      if (len(self%text) < 3) return
      if (self%text(:3) == byte_order_mark) self%next = 4
   end subroutine go_to_start

   !> Goes to the next line that is neither blank nor a comment; .false. at the end.
   logical function next_row(self) result(found)
      class(reader_t), intent(inout) :: self
      integer(ip) :: length

      found = .false.
      do while (self%next <= len(self%text, ip) .and. .not. found)
         self%line = self%line + 1
         self%first = self%next
         length = index(self%text(self%first:), line_feed, kind=ip) - 1
         if (length < 0) length = len(self%text, ip) - self%first + 1
         self%last = self%first + length - 1
         self%next = self%last + 2
         if (length == 0) cycle
         if (self%text(self%last:self%last) == carriage_return) self%last = self%last - 1
         found = is_data(self%text(self%first:self%last))
      end do
      if (.not. found) return
      associate (line => self%text(self%first:self%last))
         self%separator = merge(tab, ',', scan(line, tab) > 0 .and. scan(line, ',') == 0)
      end associate
      call self%restart_row()
   end function next_row

   !> Whether a line is neither blank nor a comment.
   pure logical function is_data(line)
      character(len=*), intent(in) :: line
      integer(ip) :: start

      start = verify(line, ' '//tab, kind=ip)
      is_data = start > 0
      if (is_data) is_data = line(start:start) /= '#'
   end function is_data

   !> The current line.
   pure function row(self)
      class(reader_t), intent(in) :: self
      character(len=:), allocatable :: row

      row = self%text(self%first:self%last)
   end function row

   !> Goes before the first field of the line.
   subroutine restart_row(self)
      class(reader_t), intent(inout) :: self

      self%right = self%first - 2
   end subroutine restart_row

   !> Goes to the next field of the line; .false. behind the last.
   logical function next_field(self) result(found)
      class(reader_t), intent(inout) :: self
      integer(ip) :: length

      found = self%right < self%last
      if (.not. found) return
      self%left = self%right + 2
      length = scan(self%text(self%left:self%last), self%separator, kind=ip) - 1
      if (length < 0) length = self%last - self%left + 1
      self%right = self%left + length - 1
   end function next_field

   !> How many fields the current line has.
   pure integer function count_fields(self) result(n)
      class(reader_t), intent(in) :: self
      integer(ip) :: i

      n = 1
      do i = self%first, self%last
         if (self%text(i:i) == self%separator) n = n + 1
      end do
   end function count_fields

   !> An error at the current line: "path:line: column k ('name'): message".
   subroutine problem(self, error, message, k)
      class(reader_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      !> What was found and what was expected.
      character(len=*), intent(in) :: message
      !> The column, when the message is about one.
      integer, intent(in), optional :: k
      character(len=:), allocatable :: place

      place = self%path//':'//to_text(self%line)//': '
      if (present(k)) then
         place = place//'column '//to_text(k)
         if (k <= size(self%header)) place = place//' ('//shown(trim(self%header(k)))//')'
         place = place//': '
      end if
      call bad_input(error, place//message)
   end subroutine problem

end module beamid_rows
