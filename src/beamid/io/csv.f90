!> Columns of numbers from comma-separated text, and the strict reading of one number.
!>
!> gfortran's list-directed `read` takes "1/2", "2*3", "nan" and a short row for good numbers, so
!> the characters are checked here before the C library converts them.
module beamid_csv
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_null_char, c_null_ptr, c_ptr
   use beamid_kinds, only: wp, ip
   use beamid_errors, only: error_t, bad_input
   use beamid_files, only: read_text
   implicit none
   private

   public :: read_columns, column_length, parse_number, is_decimal, shown

   character(len=*), parameter :: tab = achar(9), line_feed = achar(10), blanks = ' '//tab

   !> Names of columns are cut to this length.
   integer, parameter :: column_length = 100

   !> The text under the reader and the line it stands on.
   type :: reader_t
      character(len=:), allocatable :: path, text
      !> Where the next line begins.
      integer(ip) :: next = 1
      !> First and last byte of the current line, without its line end.
      integer(ip) :: first = 1, last = 0
      !> Number of the current line in the file.
      integer(ip) :: line = 0
      !> What separates its fields: a tab when it has tabs and no comma.
      character(len=1) :: separator = ','
   contains
      procedure :: rewind => go_to_start
      procedure :: next_row
      procedure :: problem
   end type reader_t

   interface
      real(c_double) function c_strtod(text, rest) bind(c, name='strtod')
         import :: c_char, c_double, c_ptr
         character(kind=c_char), intent(in) :: text(*)
         type(c_ptr), value :: rest
      end function c_strtod
   end interface

contains

   !> Reads the first columns of a text file whose fields are separated by commas (or by tabs).
   !> A line of names may come first; blank lines and lines that begin with '#' are skipped.
   subroutine read_columns(path, n_columns, values, header, error, increasing)
      !> The file's path.
      character(len=*), intent(in) :: path
      !> How many columns are wanted; the columns behind them are ignored.
      integer, intent(in) :: n_columns
      !> The numbers, shape (n_columns, rows of the file).
      real(wp), allocatable, intent(out) :: values(:, :)
      !> The names of all columns of the first line; size 0 when the file has no names.
      character(len=column_length), allocatable, intent(out) :: header(:)
      !> Allocated when the file is not such a table: file, line, column, found, expected.
      type(error_t), allocatable, intent(out) :: error
      !> Whether the first column must grow from row to row; default .false.
      logical, intent(in), optional :: increasing
      type(reader_t) :: reader
      logical :: ordered, ok
      integer(ip) :: rows

      ordered = .false.
      if (present(increasing)) ordered = increasing
      allocate (values(n_columns, 0))
      allocate (header(0))
      reader%path = path
      call read_text(path, reader%text, error)
      if (allocated(error)) return
      call refuse_binary(reader, error)
      if (allocated(error)) return

      call reader%rewind()
      rows = 0
      do while (reader%next_row())
         rows = rows + 1
      end do
      if (rows == 0) then
         call bad_input(error, path//': found no line of data, expected columns of numbers')
         return
      end if
      call reader%rewind()
      ok = reader%next_row()
      if (is_header(reader, n_columns)) then
         call read_header(reader, n_columns, header, error)
         if (allocated(error)) return
         rows = rows - 1
         ok = reader%next_row()
         if (.not. ok) then
            call bad_input(error, path//': found names of columns only, expected numbers below')
            return
         end if
      end if
      call fill(reader, rows, header, ordered, values, error)
   end subroutine read_columns

   !> Reads the rows; the reader stands on the first of them.
   subroutine fill(reader, rows, header, ordered, values, error)
      type(reader_t), intent(inout) :: reader
      !> How many rows there are.
      integer(ip), intent(in) :: rows
      !> Names of the columns, or size 0.
      character(len=*), intent(in) :: header(:)
      !> Whether column 1 must increase.
      logical, intent(in) :: ordered
      !> The numbers, shape (columns, rows).
      real(wp), allocatable, intent(inout) :: values(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer(ip) :: row, before(2)
      integer :: n

      n = size(values, 1)
      deallocate (values)
      allocate (values(n, rows))
      before = [1_ip, 0_ip]
      do row = 1, rows
         call read_row(reader, header, values(:, row), error)
         if (allocated(error)) exit
         associate (this => field_bounds(reader, reader%first))
            if (ordered .and. row > 1) then
               if (values(1, row) <= values(1, row - 1)) then
                  call reader%problem(error, 'found '//shown(reader%text(this(1):this(2))) &
                     //' after '//shown(reader%text(before(1):before(2)))// &
                     ', expected a larger number', 1, header)
                  exit
               end if
            end if
            before = this
         end associate
         if (.not. reader%next_row()) exit
      end do
      if (allocated(error)) values = reshape([real(wp) ::], [n, 0])
   end subroutine fill

   !> Reads the numbers of the current line.
   subroutine read_row(reader, header, values, error)
      type(reader_t), intent(in) :: reader
      !> Names of the columns, or size 0.
      character(len=*), intent(in) :: header(:)
      !> The numbers of the row.
      real(wp), intent(out) :: values(:)
      type(error_t), allocatable, intent(out) :: error
      integer(ip) :: bounds(2), next
      integer :: k
      logical :: ok

      next = reader%first
      values = 0
      do k = 1, size(values)
         if (next > reader%last + 1) then
            call reader%problem(error, 'found the end of the line, expected a number', k, header)
            return
         end if
         bounds = field_bounds(reader, next)
         call parse_number(reader%text(bounds(1):bounds(2)), values(k), ok)
         if (.not. ok) then
            call explain(reader, reader%text(bounds(1):bounds(2)), k, header, error)
            return
         end if
         next = bounds(2) + 2
      end do
      if (size(header) == 0) return
      if (count_fields(reader) == 2*size(header)) call reader%problem(error, &
         'found twice as many fields as names, expected as many (a decimal point is ''.'')')
   end subroutine read_row

   !> Says why a field is not a number.
   subroutine explain(reader, field, k, header, error)
      type(reader_t), intent(in) :: reader
      !> The field as it stands in the file.
      character(len=*), intent(in) :: field
      !> Its column.
      integer, intent(in) :: k
      !> Names of the columns, or size 0.
      character(len=*), intent(in) :: header(:)
      type(error_t), allocatable, intent(out) :: error

      if (index(field, ';') > 0) then
         call reader%problem(error, 'fields are separated by '';'', expected '',''')
      else if (index(trim_blanks(field), tab) > 0) then
         call reader%problem(error, 'found both tabs and commas, expected one separator '// &
            '(a decimal point is ''.'')')
      else if (len(trim_blanks(field)) == 0) then
         call reader%problem(error, 'found an empty field, expected a number', k, header)
      else if (is_decimal(trim_blanks(field))) then
         call reader%problem(error, 'found '//shown(field)// &
            ', expected a number of at most 1.79e308', k, header)
      else
         call reader%problem(error, 'found '//shown(field)//', expected a number', k, header)
      end if
   end subroutine explain

   !> Whether the current line holds names: none of its first fields begins like a number.
   logical function is_header(reader, n_columns) result(yes)
      type(reader_t), intent(in) :: reader
      !> How many fields are looked at.
      integer, intent(in) :: n_columns
      integer(ip) :: bounds(2), next
      character(len=2) :: start
      integer :: k

      yes = .false.
      next = reader%first
      do k = 1, n_columns
         if (next > reader%last + 1) exit
         bounds = field_bounds(reader, next)
         start = adjustl(trim_blanks(reader%text(bounds(1):bounds(2))))
         if (verify(start(:1), '+-.') == 0) start = start(2:)
         if (start(:1) >= '0' .and. start(:1) <= '9') then
            yes = .false.
            return
         end if
         yes = yes .or. start /= ''
         next = bounds(2) + 2
      end do
   end function is_header

   !> Reads the names of the columns.
   subroutine read_header(reader, n_columns, header, error)
      type(reader_t), intent(in) :: reader
      !> How many columns are wanted.
      integer, intent(in) :: n_columns
      !> All names of the line, without blanks and quotes around them.
      character(len=column_length), allocatable, intent(inout) :: header(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: name
      integer(ip) :: bounds(2), next
      integer :: k, n

      n = count_fields(reader)
      name = reader%text(reader%first:reader%last)
      if (n < n_columns .and. index(name, ';') > 0) then
         call reader%problem(error, 'fields are separated by '';'', expected '',''')
      else if (n < n_columns) then
         call reader%problem(error, 'found '//shown(name)//', expected '// &
            integer_text(int(n_columns, ip))//' columns separated by '',''')
      end if
      if (allocated(error)) return
      deallocate (header)
      allocate (header(n))
      next = reader%first
      do k = 1, n
         bounds = field_bounds(reader, next)
         name = trim_blanks(reader%text(bounds(1):bounds(2)))
         if (len(name) >= 2 .and. index(name, '"') == 1) name = name(2:len(name) - 1)
         header(k) = name
         next = bounds(2) + 2
      end do
   end subroutine read_header

   !> Goes before the first line, behind a byte order mark.
   subroutine go_to_start(self)
      class(reader_t), intent(inout) :: self

      self%line = 0
      self%next = 1
      if (len(self%text) < 3) return
      if (self%text(:3) == char(239)//char(187)//char(191)) self%next = 4
   end subroutine go_to_start

   !> Goes to the next line that is neither blank nor a comment; .false. at the end.
   logical function next_row(self) result(found)
      class(reader_t), intent(inout) :: self
      logical :: has_comma, has_tab
      integer(ip) :: i

      found = .false.
      do while (self%next <= len(self%text, ip) .and. .not. found)
         has_comma = .false.
         has_tab = .false.
         do i = self%next, len(self%text, ip)
            if (self%text(i:i) == line_feed) exit
            has_comma = has_comma .or. self%text(i:i) == ','
            has_tab = has_tab .or. self%text(i:i) == tab
         end do
         self%separator = merge(tab, ',', has_tab .and. .not. has_comma)
         self%line = self%line + 1
         self%first = self%next
         self%last = i - 1
         self%next = i + 1
         if (i > self%first) then
            if (self%text(i - 1:i - 1) == achar(13)) self%last = i - 2
         end if
         i = verify(self%text(self%first:self%last), blanks, kind=ip)
         if (i > 0) found = self%text(self%first + i - 1:self%first + i - 1) /= '#'
      end do
   end function next_row

   !> First and last byte of the field that begins at `start` in the current line.
   pure function field_bounds(reader, start) result(bounds)
      type(reader_t), intent(in) :: reader
      !> Where the field begins.
      integer(ip), intent(in) :: start
      integer(ip) :: bounds(2), i

      do i = start, reader%last
         if (reader%text(i:i) == reader%separator) exit
      end do
      bounds = [start, i - 1]
   end function field_bounds

   !> How many fields the current line has.
   pure integer function count_fields(reader) result(n)
      type(reader_t), intent(in) :: reader
      integer(ip) :: i

      n = 1
      do i = reader%first, reader%last
         if (reader%text(i:i) == reader%separator) n = n + 1
      end do
   end function count_fields

   !> An error at the current line: "path:line: column k ('name'): message".
   subroutine problem(self, error, message, k, header)
      class(reader_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      !> What was found and what was expected.
      character(len=*), intent(in) :: message
      !> The column, when the message is about one.
      integer, intent(in), optional :: k
      !> Names of the columns, or size 0.
      character(len=*), intent(in), optional :: header(:)
      character(len=:), allocatable :: place

      place = self%path//':'//integer_text(self%line)//': '
      if (present(k)) then
         place = place//'column '//integer_text(int(k, ip))
         if (k <= size(header)) place = place//' ('//shown(trim(header(k)))//')'
         place = place//': '
      end if
      call bad_input(error, place//message)
   end subroutine problem

   !> Refuses a file that is not text.
   subroutine refuse_binary(reader, error)
      type(reader_t), intent(inout) :: reader
      type(error_t), allocatable, intent(out) :: error
      integer(ip) :: i

      reader%line = 1
      do i = 1, len(reader%text, ip)
         select case (iachar(reader%text(i:i)))
         case (10)
            reader%line = reader%line + 1
         case (0:8, 11:12, 14:31, 127)
            call reader%problem(error, 'found a control character, expected a text file')
            return
         end select
      end do
      reader%line = 0
   end subroutine refuse_binary

   !> Reads one decimal number: blanks around, sign, digits, point, exponent by e, E, d or D.
   subroutine parse_number(token, value, ok)
      !> The characters.
      character(len=*), intent(in) :: token
      !> The number; 0 when there is none.
      real(wp), intent(out) :: value
      !> Whether the token is a number and finite.
      logical, intent(out) :: ok
      character(len=64) :: buffer
      integer :: first, last, exponent, letter

      value = 0
      first = max(verify(token, blanks), 1)
      last = verify(token, blanks, back=.true.)
      call examine(token(first:last), ok, letter)
      if (.not. ok) return
      if (last - first + 1 < len(buffer)) then
         buffer = token(first:last)//c_null_char
         exponent = 0
         if (letter > 0) then
            buffer(letter:letter) = 'e'
            exponent = last - first + 1 - letter
            if (is_sign(buffer(letter + 1:letter + 1))) exponent = exponent - 1
         end if
         ! With two digits of exponent at most there is no over- or underflow.
         if (exponent <= 2) then
            value = c_strtod(buffer, c_null_ptr)
         else
            value = convert_untrapped(buffer)
         end if
      else
         value = convert_untrapped(with_e(token(first:last))//c_null_char)
      end if
      ok = abs(value) <= huge(value)
      if (.not. ok) value = 0
   end subroutine parse_number

   !> The number in a text that may over- or underflow, which is no cause to halt.
   real(wp) function convert_untrapped(text) result(value)
      use, intrinsic :: ieee_exceptions, only: ieee_get_status, ieee_overflow, &
         ieee_set_halting_mode, ieee_set_status, ieee_status_type, ieee_underflow
      !> The characters, ending in a null character.
      character(len=*), intent(in) :: text
      type(ieee_status_type) :: before

      call ieee_get_status(before)
      call ieee_set_halting_mode([ieee_overflow, ieee_underflow], .false.)
      value = c_strtod(text, c_null_ptr)
      call ieee_set_status(before)
   end function convert_untrapped

   !> The same number with the exponent letter that C knows.
   pure function with_e(token) result(text)
      !> A number.
      character(len=*), intent(in) :: token
      character(len=len(token)) :: text
      integer :: exponent

      text = token
      exponent = scan(text, 'eEdD')
      if (exponent > 0) text(exponent:exponent) = 'e'
   end function with_e

   !> Whether a text is a decimal number and nothing else: [sign] digits [. digits] [exponent].
   pure logical function is_decimal(text) result(yes)
      !> The characters, no blanks around.
      character(len=*), intent(in) :: text
      integer :: letter

      call examine(text, yes, letter)
   end function is_decimal

   !> Goes through the parts of a decimal number.
   pure subroutine examine(text, yes, letter)
      !> The characters, no blanks around.
      character(len=*), intent(in) :: text
      !> Whether they are a decimal number and nothing else.
      logical, intent(out) :: yes
      !> The place of the exponent's letter; 0 when there is none.
      integer, intent(out) :: letter
      integer :: next, whole, part

      next = 1
      part = 0
      letter = 0
      if (len(text) > 0) then
         if (is_sign(text(1:1))) next = 2
      end if
      call pass_digits(text, next, whole)
      if (next <= len(text)) then
         if (text(next:next) == '.') then
            next = next + 1
            call pass_digits(text, next, part)
         end if
      end if
      yes = whole + part > 0
      if (next > len(text) .or. .not. yes) return
      letter = next
      yes = any(text(next:next) == ['e', 'E', 'd', 'D']) .and. next < len(text)
      if (.not. yes) return
      next = next + 1
      if (is_sign(text(next:next))) next = next + 1
      call pass_digits(text, next, part)
      yes = part > 0 .and. next > len(text)
   end subroutine examine

   !> Whether a character is a sign.
   pure logical function is_sign(letter)
      !> The character.
      character(len=1), intent(in) :: letter

      is_sign = letter == '+' .or. letter == '-'
   end function is_sign

   !> Moves `next` past digits.
   pure subroutine pass_digits(text, next, passed)
      !> The characters.
      character(len=*), intent(in) :: text
      !> The position, moved.
      integer, intent(inout) :: next
      !> How many were passed.
      integer, intent(out) :: passed
      integer :: first

      first = next
      do while (next <= len(text))
         if (text(next:next) < '0' .or. text(next:next) > '9') exit
         next = next + 1
      end do
      passed = next - first
   end subroutine pass_digits

   !> A text in quotes for a message: at most 40 characters, none of them a control character.
   pure function shown(text) result(quoted)
      !> What was found.
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: quoted
      integer :: i, n

      quoted = trim_blanks(text)
      n = len(quoted)
      if (n > 40) then
         n = 37
         ! Never cut inside a UTF-8 character: its later bytes are 10xxxxxx.
         do while (n > 1 .and. iand(iachar(quoted(n + 1:n + 1)), 192) == 128)
            n = n - 1
         end do
         quoted = quoted(:n)//'...'
      end if
      do i = 1, len(quoted)
         if (iachar(quoted(i:i)) < 32 .or. iachar(quoted(i:i)) == 127) quoted(i:i) = '?'
      end do
      quoted = "'"//quoted//"'"
   end function shown

   !> A text without the blanks and tabs around it.
   pure function trim_blanks(text) result(trimmed)
      !> The text.
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: trimmed

      trimmed = text(max(verify(text, blanks), 1):verify(text, blanks, back=.true.))
   end function trim_blanks

   !> An integer in digits.
   pure function integer_text(i) result(text)
      !> The integer.
      integer(ip), intent(in) :: i
      character(len=:), allocatable :: text
      character(len=20) :: buffer

      write (buffer, '(i0)') i
      text = trim(buffer)
   end function integer_text

end module beamid_csv
