!> Columns of numbers from text whose fields are separated by commas, semicolons or tabs.
module beamid_csv
   use beamid_errors, only: error_t, bad_input
   use beamid_files, only: read_text
   use beamid_kinds, only: wp, ip
   use beamid_numbers, only: is_decimal, parse_number, shown, trim_blanks
   use beamid_rows, only: column_length, reader_t, tab
   use beamid_strings, only: to_text
   implicit none
   private

   public :: read_columns, open_table, read_row, column_length, parse_number

contains

   !> Reads the first columns of a text file whose fields are separated by commas (or by semicolons
   !> or tabs, throughout). A line of names may come first; blank lines and lines that begin with
   !> '#' are skipped.
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
      call open_table(path, n_columns, reader, error)
      rows = 0
      if (.not. allocated(error)) rows = 1 + reader%rows_behind()
      allocate (values(n_columns, rows))
      if (.not. allocated(error)) call fill(reader, ordered, values, error)
      if (allocated(error)) values = reshape([real(wp) ::], [n_columns, 0])
      call move_alloc(reader%header, header)
   end subroutine read_columns

   !> Reads a file and the names of its columns, and goes to the first row of numbers.
   !>
   !> error  no such file, no text, nothing in it, names of fewer than `n_columns` columns
   subroutine open_table(path, n_columns, reader, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: n_columns
      type(reader_t), intent(out) :: reader
      type(error_t), allocatable, intent(out) :: error

      reader%path = path
      allocate (reader%header(0))
      call read_text(path, reader%text, error)
      if (.not. allocated(error)) call refuse_binary(reader, error)
      if (.not. allocated(error)) call find_rows(reader, n_columns, error)
   end subroutine open_table

   !> Refuses a file that is not text.
   subroutine refuse_binary(reader, error)
      type(reader_t), intent(inout) :: reader
      type(error_t), allocatable, intent(out) :: error
      integer(ip) :: i, found

      found = control_character(reader%text)
      if (found == 0) return
      reader%line = 1 + count([(reader%text(i:i) == achar(10), i=1_ip, found)], kind=ip)
      call reader%problem(error, 'found a control character, expected a text file')
   end subroutine refuse_binary

   !> Where the first character stands that no text holds; 0: nowhere.
   pure integer(ip) function control_character(text) result(at)
      character(len=*), intent(in) :: text
      integer :: code

      do at = 1, len(text, ip)
         code = iachar(text(at:at))
         if (code >= 32 .and. code /= 127 .or. code == 10 .or. code == 13 .or. code == 9) cycle
         return
      end do
      at = 0
   end function control_character

   !> Reads the names above the rows of numbers, and goes to the first row.
   subroutine find_rows(reader, n_columns, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      type(error_t), allocatable, intent(out) :: error

      call reader%rewind()
      if (.not. reader%next_row()) then
         call bad_input(error, reader%path//': found no line of data, expected columns of numbers')
         return
      end if
      if (.not. is_header(reader, n_columns)) return
      call read_header(reader, n_columns, error)
      if (allocated(error)) return
      if (.not. reader%next_row()) call bad_input(error, reader%path// &
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
      if (n < n_columns) then
         call reader%problem(error, 'found '//shown(reader%row())//', expected '// &
            to_text(n_columns)//' columns separated by '','', '';'' or a tab')
         return
      end if
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
      integer, allocatable :: columns(:)
      integer(ip) :: row
      real(wp) :: previous
      integer :: k

      columns = [(k, k=1, size(values, 1))]
      previous = -huge(previous)
      do row = 1, size(values, 2, ip)
         if (ordered) then
            call read_row(reader, columns, values(:, row), error, previous)
            previous = values(1, row)
         else
            call read_row(reader, columns, values(:, row), error)
         end if
         if (allocated(error)) return
         if (.not. reader%next_row()) exit
      end do
   end subroutine fill

   !> Reads numbers of the current line.
   subroutine read_row(reader, columns, values, error, previous)
      type(reader_t), intent(inout) :: reader
      !> Which columns are wanted, in any order.
      integer, intent(in) :: columns(:)
      !> The numbers, in the order of `columns`.
      real(wp), intent(out) :: values(:)
      !> `path:line: ...`: a short row, a field that is no finite number, one that does not grow.
      type(error_t), allocatable, intent(out) :: error
      !> What the first of the numbers must exceed; default: nothing.
      real(wp), intent(in), optional :: previous
      integer :: column, k
      logical :: ok

      values = 0
      do column = 1, maxval(columns)
         if (.not. reader%next_field()) then
            call reader%problem(error, 'found the end of the line, expected a number', column)
            return
         end if
         do k = 1, size(columns)
            if (columns(k) /= column) cycle
            call parse_number(reader%text(reader%left:reader%right), values(k), ok)
            if (.not. ok) then
               call explain(reader, reader%text(reader%left:reader%right), column, error)
               return
            end if
            if (k > 1 .or. .not. present(previous)) cycle
            if (values(1) <= previous) then
               call reader%problem(error, 'found '//shown(reader%text(reader%left:reader%right))// &
                  ' after '//shown(reader%text(reader%mark(1):reader%mark(2)))// &
                  ', expected a larger number', column)
               return
            end if
            reader%mark = [reader%left, reader%right]
         end do
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
      character(len=:), allocatable :: bare

      bare = trim_blanks(field)
      if (index(bare, ';') > 0 .and. reader%count_of(',') > 0) then
         call reader%problem(error, 'found both '';'' and '','', expected one separator '// &
            '(a decimal point is ''.'')')
      else if (index(bare, ';') > 0) then
         call reader%problem(error, 'fields are separated by '';'', expected '// &
            separator_name(reader)//' as in the lines above')
      else if (index(bare, tab) > 0) then
         call reader%problem(error, 'found both tabs and '//separator_name(reader)// &
            ', expected one separator (a decimal point is ''.'')')
      else if (bare == '') then
         call reader%problem(error, 'found an empty field, expected a number', k)
      else if (index(bare, ',') > 0) then
         call reader%problem(error, 'found '//shown(bare)// &
            ', expected a number (a decimal point is ''.'')', k)
      else if (is_decimal(bare)) then
         call reader%problem(error, 'found '//shown(bare)// &
            ', expected a number of at most 1.79e308', k)
      else
         call reader%problem(error, 'found '//shown(bare)//', expected a number', k)
      end if
   end subroutine explain

   !> What separates the fields of the file, for a message.
   pure function separator_name(reader) result(name)
      type(reader_t), intent(in) :: reader
      character(len=:), allocatable :: name

      name = ''''//reader%separator//''''
      if (reader%separator == tab) name = 'a tab'
   end function separator_name

end module beamid_csv
