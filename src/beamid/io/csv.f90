!> Columns of numbers from comma-separated text.
module beamid_csv
   use beamid_errors, only: error_t, bad_input
   use beamid_files, only: read_text
   use beamid_kinds, only: wp, ip
   use beamid_numbers, only: is_decimal, parse_number, shown, trim_blanks
   use beamid_rows, only: column_length, reader_t, tab
   use beamid_strings, only: to_text
   implicit none
   private

   public :: read_columns, column_length, parse_number

contains

   !> Reads the first columns of a text file whose fields are separated by commas (or by tabs).
   !> A line of names may come first; blank lines and lines that begin with '#' are skipped.
   subroutine read_columns(path, n_columns, values, header, error, increasing)
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
      logical :: ordered
      integer(ip) :: rows

      ordered = .false.
      if (present(increasing)) ordered = increasing
      reader%path = path
      allocate (reader%header(0))
      rows = 0
      call read_text(path, reader%text, error)
      if (.not. allocated(error)) call refuse_binary(reader, error)
      if (.not. allocated(error)) call find_rows(reader, n_columns, rows, error)
      allocate (values(n_columns, rows))
      if (.not. allocated(error)) call fill(reader, ordered, values, error)
      if (allocated(error)) values = reshape([real(wp) ::], [n_columns, 0])
      call move_alloc(reader%header, header)
   end subroutine read_columns

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
   end subroutine refuse_binary

   !> Counts the rows of numbers, reads the names above them, and goes to the first.
   subroutine find_rows(reader, n_columns, rows, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      integer(ip), intent(out) :: rows
      type(error_t), allocatable, intent(out) :: error
      logical :: found

      rows = 0
      call reader%rewind()
      do while (reader%next_row())
         rows = rows + 1
      end do
      if (rows == 0) then
         call bad_input(error, reader%path// &
            ': found no line of data, expected columns of numbers')
         return
      end if
      call reader%rewind()
      found = reader%next_row()
      if (.not. is_header(reader, n_columns)) return
      call read_header(reader, n_columns, error)
      if (allocated(error)) return
      rows = rows - 1
      found = reader%next_row()
      if (.not. found) call bad_input(error, reader%path// &
         ': found names of columns only, expected numbers below')
   end subroutine find_rows

   !> Whether the current line holds names: none of its first fields begins like a number.
   logical function is_header(reader, n_columns) result(yes)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      character(len=2) :: start
      integer :: k

      yes = .false.
      do k = 1, n_columns
         if (.not. reader%next_field()) exit
         start = trim_blanks(reader%text(reader%left:reader%right))
         if (verify(start(:1), '+-.') == 0) start = start(2:)
         if (verify(start(:1), '0123456789') == 0) then
            yes = .false.
            exit
         end if
         yes = yes .or. start /= ''
      end do
      call reader%restart_row()
   end function is_header

   !> Reads the names of all columns, without blanks and quotes around them.
   subroutine read_header(reader, n_columns, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: name
      integer :: k, n

      n = reader%count_fields()
      if (n < n_columns .and. index(reader%row(), ';') > 0) then
         call reader%problem(error, 'fields are separated by '';'', expected '',''')
      else if (n < n_columns) then
         call reader%problem(error, 'found '//shown(reader%row())//', expected '// &
            to_text(n_columns)//' columns separated by '',''')
      end if
      if (allocated(error)) return
      deallocate (reader%header)
      allocate (reader%header(n))
      do k = 1, n
         if (.not. reader%next_field()) exit
         name = trim_blanks(reader%text(reader%left:reader%right))
         if (len(name) >= 2 .and. index(name, '"') == 1) name = name(2:len(name) - 1)
         reader%header(k) = name
      end do
   end subroutine read_header

   !> Reads the rows; the reader stands on the first of them.
   subroutine fill(reader, ordered, values, error)
      type(reader_t), intent(inout) :: reader
      !> Whether column 1 must increase.
      logical, intent(in) :: ordered
      !> The numbers, shape (columns, rows).
      real(wp), intent(out) :: values(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer(ip) :: row, this(2), before(2)
      real(wp) :: previous

      previous = 0
      before = 0
      do row = 1, size(values, 2, ip)
         call read_row(reader, values(:, row), this, error)
         if (allocated(error)) return
         if (ordered .and. row > 1 .and. values(1, row) <= previous) then
            call reader%problem(error, 'found '//shown(reader%text(this(1):this(2)))//' after '// &
               shown(reader%text(before(1):before(2)))//', expected a larger number', 1)
            return
         end if
         previous = values(1, row)
         before = this
         if (.not. reader%next_row()) exit
      end do
   end subroutine fill

   !> Reads the numbers of the current line.
   subroutine read_row(reader, values, first_field, error)
      type(reader_t), intent(inout) :: reader
      real(wp), intent(out) :: values(:)
      !> First and last byte of the first field.
      integer(ip), intent(out) :: first_field(2)
      type(error_t), allocatable, intent(out) :: error
      integer :: k
      logical :: ok

      values = 0
      first_field = [1, 0]
      do k = 1, size(values)
         if (.not. reader%next_field()) then
            call reader%problem(error, 'found the end of the line, expected a number', k)
            return
         end if
         if (k == 1) first_field = [reader%left, reader%right]
         call parse_number(reader%text(reader%left:reader%right), values(k), ok)
         if (ok) cycle
         call explain(reader, reader%text(reader%left:reader%right), k, error)
         return
      end do
      if (size(reader%header) == 0) return
      if (reader%count_fields() == 2*size(reader%header)) call reader%problem(error, &
         'found twice as many fields as names, expected as many (a decimal point is ''.'')')
   end subroutine read_row

   !> Says why a field is not a number.
   subroutine explain(reader, field, k, error)
      type(reader_t), intent(in) :: reader
      !> The field as it stands in the file, and its column.
      character(len=*), intent(in) :: field
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error

      if (index(field, ';') > 0) then
         call reader%problem(error, 'fields are separated by '';'', expected '',''')
      else if (index(trim_blanks(field), tab) > 0) then
         call reader%problem(error, 'found both tabs and commas, expected one separator '// &
            '(a decimal point is ''.'')')
      else if (trim_blanks(field) == '') then
         call reader%problem(error, 'found an empty field, expected a number', k)
      else if (is_decimal(trim_blanks(field))) then
         call reader%problem(error, 'found '//shown(field)// &
            ', expected a number of at most 1.79e308', k)
      else
         call reader%problem(error, 'found '//shown(field)//', expected a number', k)
      end if
   end subroutine explain

end module beamid_csv
