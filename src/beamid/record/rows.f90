!> Goes through the rows and fields of a text table, one after the other. `beamid_headers` and
!> `beamid_csv` read tables with it.
!>
!> A field may be in double quotes, and may then contain separators. Quotation marks count only
!> where a field begins, and only if each of them is closed on the same line.
module beamid_rows
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: ip, wp
   use beamid_numbers, only: is_decimal, shown, trim_blanks, with_point
   use beamid_strings, only: to_text
   use beamid_time_stamps, only: clock_t
   implicit none
   private

   public :: reader_t, column_length, separators, tab

   character(len=*), parameter :: tab = achar(9), line_feed = achar(10), &
      carriage_return = achar(13), byte_order_mark = char(239)//char(187)//char(191)
   !> Possible separators of fields: a table uses the first of them that its first line contains, or
   !> else a comma.
   character(len=*), parameter :: separators = ',;'//tab
   !> Longest name of a column; longer names are cut.
   integer, parameter :: column_length = 100

   !> A text table with a current row and a current field.
   type :: reader_t
      !> Path of the file, and its content.
      character(len=:), allocatable :: path, text
      !> Names of the columns; size 0: none.
      character(len=column_length), allocatable :: header(:)
      !> Number of the current line in the file.
      integer(ip) :: line = 0
      !> Number of lines before the rows that are neither names of columns, nor blank, nor comments.
      integer :: skipped = 0
      !> Positions in `text` of the first and last byte of the current field, without its quotes.
      integer(ip) :: left = 1, right = 0
      !> Whether some fields of the current line are in quotes.
      logical :: is_quoted = .false.
      !> Whether the first of the columns that are read must increase from row to row.
      logical :: ordered = .false.
      real(wp) :: previous = 0               !< number in this column in the row before
      integer(ip) :: previous_field(2) = 0   !< positions of its first and last byte; 0: no row yet
      !> Separator of the fields; set by the first line that is neither blank nor a comment.
      character(len=1) :: separator = ' '
      !> Decimal sign, '.' or ',', as soon as a number shows it; a comma only if commas do not
      !> separate fields.
      character(len=1) :: decimal = ' '
      !> Number of numbers with a comma, and of those among them that look like thousands: '1,234'.
      integer(ip) :: commas = 0, thousands = 0
      !> Whether the first of the columns that are read may contain time stamps, and their clock.
      logical :: allows_stamps = .false.
      type(clock_t) :: clock
      real(wp) :: rate = 0            !< > 0: rows per unit of time of a table without times
      integer(ip) :: rows = 0         !< with a rate: number of rows read
      integer(ip) :: row_line = 0     !< with a rate: line of the last row
      !> Positions of the first and last byte of the current line without its end, of the next
      !> line, and of the last byte of the current field with its quotes.
      integer(ip), private :: first = 1, last = 0, next = 1, field_end = 0
      !> Number of each of the separators in the current line.
      integer, private :: counts(len(separators)) = 0
   contains
      procedure :: rewind => go_to_start
      procedure :: go_to, next_row, row, restart_row, next_field, count_fields, count_filled, &
         count_of, has_decimal_comma, split_at, problem
   end type reader_t

contains

   !> Goes before the first line, after a byte order mark.
   subroutine go_to_start(self)
      class(reader_t), intent(inout) :: self

      self%line = 0
      self%next = 1
      self%separator = ' '
      if (len(self%text, ip) < 3) return
      if (self%text(:3) == byte_order_mark) self%next = 4
   end subroutine go_to_start

   !> Goes to a line that is neither blank nor a comment, and splits it at a separator.
   !>
   !> line  its number in the file
   subroutine go_to(self, line, separator)
      class(reader_t), intent(inout) :: self
      integer(ip), intent(in) :: line
      character(len=1), intent(in) :: separator

      call self%rewind()
      self%separator = separator
      do while (self%line < line)
         if (.not. self%next_row()) exit
      end do
   end subroutine go_to

   !> Goes to the next line that is neither blank nor a comment; .false. at the end of the text.
   logical function next_row(self) result(found)
      class(reader_t), intent(inout) :: self

      found = .false.
      do while (self%next <= len(self%text, ip) .and. .not. found)
         self%line = self%line + 1
         self%first = self%next
         call scan_line(self%text, self%first, self%last, self%next, self%counts, found, &
            self%is_quoted)
      end do
      if (.not. found) return
      if (self%is_quoted) call count_outside(self%text(self%first:self%last), self%counts, &
         self%is_quoted)
      if (self%separator == ' ') self%separator = separators(max(1, findloc(self%counts > 0, &
         .true., dim=1)):)
      call self%restart_row()
   end function next_row

   !> Finds the end of a line and its separators in one pass over its bytes.
   pure subroutine scan_line(text, first, last, next, counts, is_data, has_quotes)
      character(len=*), intent(in) :: text
      !> First byte of the line.
      integer(ip), intent(in) :: first
      !> Last byte of the line without its end, and first byte of the next line.
      integer(ip), intent(out) :: last, next
      !> Numbers of commas, semicolons and tabs.
      integer, intent(out) :: counts(:)
      !> Whether the line is neither blank nor a comment, and whether it contains double quotes.
      logical, intent(out) :: is_data, has_quotes
      integer(ip) :: at
      logical :: blank, comment

      counts = 0
      blank = .true.
      comment = .false.
      has_quotes = .false.
      do at = first, len(text, ip)
         select case (text(at:at))
         case (line_feed)
            exit
         case (' ', carriage_return)
            cycle
         case (tab)
            counts(3) = counts(3) + 1
            cycle
         case (',')
            counts(1) = counts(1) + 1
         case (';')
            counts(2) = counts(2) + 1
         case ('"')
            has_quotes = .true.
         case ('#')
            comment = comment .or. blank
         end select
         blank = .false.
      end do
      next = at + 1
      last = at - 1
      if (last >= first) then
         if (text(last:last) == carriage_return) last = last - 1
      end if
      is_data = .not. (blank .or. comment)
   end subroutine scan_line

   !> Counts the separators of a line outside quoted fields; leaves `counts` as they are if a
   !> quoted field has no end.
   !>
   !> counts      numbers of commas, semicolons and tabs
   !> is_quoted   whether all quoted fields have an end
   pure subroutine count_outside(line, counts, is_quoted)
      character(len=*), intent(in) :: line
      integer, intent(inout) :: counts(:)
      logical, intent(out) :: is_quoted
      integer :: at, k, found(size(counts))
      logical :: inside, begins

      found = 0
      inside = .false.
      begins = .true.
      do at = 1, len(line)
         if (.not. inside) then
            k = index(separators, line(at:at))
            if (k > 0) found(k) = found(k) + 1
         end if
         call follow_quotes(line(at:at), inside, begins)
      end do
      is_quoted = .not. inside
      if (is_quoted) counts = found
   end subroutine count_outside

   !> Goes past a character of a line with quoted fields.
   !>
   !> inside  whether the next character is inside quotes
   !> begins  whether a quotation mark that comes next would open a quoted field. It does behind
   !>         another one, because a doubled quotation mark is part of a field.
   pure subroutine follow_quotes(character, inside, begins)
      character(len=1), intent(in) :: character
      logical, intent(inout) :: inside, begins

      if (inside) then
         inside = character /= '"'
         begins = .not. inside
      else if (character == '"') then
         inside = begins
      else if (scan(character, separators) > 0) then
         begins = .true.
      else
         begins = begins .and. character == ' '
      end if
   end subroutine follow_quotes

   !> Returns the current line.
   pure function row(self)
      class(reader_t), intent(in) :: self
      character(len=:), allocatable :: row

      row = self%text(self%first:self%last)
   end function row

   !> Goes before the first field of the current line.
   subroutine restart_row(self)
      class(reader_t), intent(inout) :: self

      self%field_end = self%first - 2
   end subroutine restart_row

   !> Goes to the next field of the current line; .false. after the last field.
   logical function next_field(self) result(found)
      class(reader_t), intent(inout) :: self
      integer(ip) :: at
      logical :: inside, begins

      found = self%field_end < self%last
      if (.not. found) return
      self%left = self%field_end + 2
      inside = .false.
      begins = .true.
      do at = self%left, self%last
         if (self%text(at:at) == self%separator .and. .not. inside) exit
         if (self%is_quoted) call follow_quotes(self%text(at:at), inside, begins)
      end do
      self%right = at - 1
      self%field_end = self%right
      if (self%is_quoted) call take_off_quotes(self%text, self%left, self%right)
   end function next_field

   !> Moves the ends of a field inside its quotes, if it has quotes.
   !>
   !> left, right  positions in `text` of its first and last byte
   pure subroutine take_off_quotes(text, left, right)
      character(len=*), intent(in) :: text
      integer(ip), intent(inout) :: left, right
      integer(ip) :: first, last

      first = left + verify(text(left:right), ' '//tab, kind=ip) - 1
      last = left + verify(text(left:right), ' '//tab, back=.true., kind=ip) - 1
      if (first < left .or. first == last) return
      if (text(first:first) /= '"' .or. text(last:last) /= '"') return
      left = first + 1
      right = last - 1
   end subroutine take_off_quotes

   !> Returns the number of fields of the current line.
   pure integer function count_fields(self) result(n)
      class(reader_t), intent(in) :: self

      n = 1 + self%count_of(self%separator)
   end function count_fields

   !> Returns the number of fields of the current line up to the last that is not blank.
   integer function count_filled(self) result(n)
      class(reader_t), intent(inout) :: self
      integer :: k

      n = 0
      call self%restart_row()
      do k = 1, self%count_fields()
         if (.not. self%next_field()) exit
         if (verify(self%text(self%left:self%right), ' '//tab) > 0) n = k
      end do
      call self%restart_row()
   end function count_filled

   !> Changes the separator, and goes before the first field of the current line.
   subroutine split_at(self, separator)
      class(reader_t), intent(inout) :: self
      character(len=1), intent(in) :: separator

      self%separator = separator
      call self%restart_row()
   end subroutine split_at

   !> Returns the number of times that a separator occurs in the current line.
   pure integer function count_of(self, separator) result(n)
      class(reader_t), intent(in) :: self
      !> ',', ';' or a tab.
      character(len=1), intent(in) :: separator

      n = self%counts(index(separators, separator))
   end function count_of

   !> Returns whether the current line reads as one number with a decimal comma, as '-0,97' does,
   !> where commas separate the fields.
   logical function has_decimal_comma(self)
      class(reader_t), intent(in) :: self

      has_decimal_comma = self%separator == ',' .and. self%count_of(',') == 1 .and. &
         index(self%row(), '.') == 0
      if (has_decimal_comma) has_decimal_comma = is_decimal(with_point(trim_blanks(self%row())))
   end function has_decimal_comma

   !> Makes an error at the current line: "path:line: column k ('name'): message".
   subroutine problem(self, error, message, k)
      class(reader_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      !> States the mistake found, and the correct input expected.
      character(len=*), intent(in) :: message
      !> Number of the column that the message is about, if any.
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
