!> Reads columns of numbers from text whose fields are separated by commas, semicolons or tabs.
!> Tells the user the place of a mistake.
module beamid_csv
   use beamid_errors, only: error_t, bad_input
   use beamid_files, only: read_text
   use beamid_headers, only: find_rows
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp, ip
   use beamid_numbers, only: is_decimal, parse_number, shown, trim_blanks, with_point
   use beamid_rows, only: column_length, reader_t, tab
   use beamid_strings, only: to_text
   use beamid_time_stamps, only: is_stamp
   implicit none
   private

   public :: read_columns, open_table, read_rows, part_t, extent_t, column_length

   !> The rows to keep: those whose first number is in first .. last, and some rows on either side.
   type :: part_t
      real(wp) :: first = -huge(1.0_wp), last = huge(1.0_wp)   !< range of these numbers
      integer :: margin = 0                           !< smallest number of rows kept on either side
   end type part_t

   !> The extent of a table.
   type :: extent_t
      real(wp) :: first = 0, last = 0     !< first numbers of the first and the last row
      integer(ip) :: rows = 0             !< number of rows
   end type extent_t

contains

   !> Reads the first columns of a text file whose fields are separated throughout by commas,
   !> semicolons or tabs. A header and a line of names may come first. Blank lines and lines that
   !> begin with '#' are skipped.
   subroutine read_columns(path, n_columns, values, header, error, increasing)
      character(len=*), intent(in) :: path
      !> Number of columns to read; columns behind them are ignored.
      integer, intent(in) :: n_columns
      !> The numbers, shape (n_columns, rows of the file).
      real(wp), allocatable, intent(out) :: values(:, :)
      !> Names of all columns; size 0 if the file has no line of names.
      character(len=column_length), allocatable, intent(out) :: header(:)
      !> The file is not such a table: file, line, column, found, expected.
      type(error_t), allocatable, intent(out) :: error
      !> Whether the first column must increase from row to row; default .false.
      logical, intent(in), optional :: increasing
      type(reader_t) :: reader
      type(extent_t) :: extent
      integer :: k

      call open_table(path, n_columns, reader, error)
      if (present(increasing)) reader%ordered = increasing
      if (allocated(error)) then
         allocate (values(n_columns, 0))
      else
         call read_rows(reader, [(k, k=1, n_columns)], part_t(), values, extent, error)
      end if
      call move_alloc(reader%header, header)
   end subroutine read_columns

   !> Reads a file and the names of its columns, and goes to the first row of numbers.
   !>
   !> path       of the file
   !> n_columns  smallest number of columns
   !> reader     on return at the first row
   !> error      no such file, no text, no rows, or names for fewer than `n_columns` columns
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

   !> Refuses a file with control characters, which is not text, and text in UTF-16.
   subroutine refuse_binary(reader, error)
      type(reader_t), intent(inout) :: reader
      type(error_t), allocatable, intent(out) :: error
      character(len=4) :: start
      integer(ip) :: at
      integer :: code

      start = reader%text
      if (start(:2) == char(255)//char(254) .or. start(:2) == char(254)//char(255)) then
         call bad_input(error, reader%path//': found text in UTF-16, expected UTF-8 '// &
            '(scripts/to_csv.py converts it)')
      else if (start == 'PK'//achar(3)//achar(4)) then
         call bad_input(error, reader%path// &
            ': found a zip archive or a workbook, expected text '// &
            '(scripts/to_csv.py reads archives of text; export a sheet as CSV)')
      end if
      if (allocated(error)) return
      reader%line = 1
      do at = 1, len(reader%text, ip)
         code = iachar(reader%text(at:at))
         if (code == 10) reader%line = reader%line + 1
         if (code >= 32 .and. code /= 127 .or. code == 10 .or. code == 13 .or. code == 9) cycle
         call reader%problem(error, 'found a control character, expected a text file')
         return
      end do
   end subroutine refuse_binary

   !> Reads and checks all rows from the current row on, and keeps a part of them.
   !>
   !> columns  numbers of the columns to read, in any order; the first may be 0: times from the
   !>          reader's rate, starting at 0
   !> part     rows to keep
   !> values   (columns, rows kept); no rows after an error
   !> extent   of all rows
   !> error    `path:line: ...` of the first mistake, or an interrupt
   subroutine read_rows(reader, columns, part, values, extent, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: columns(:)
      type(part_t), intent(in) :: part
      real(wp), allocatable, intent(out) :: values(:, :)
      type(extent_t), intent(out) :: extent
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: row(size(columns))
      integer :: kept, rows_after

      allocate (values(size(columns), 1024))
      kept = 0
      rows_after = 0
      do
         call read_row()
         call check_interrupt(error)
         if (allocated(error)) then
            kept = 0
            exit
         end if
         if (extent%rows == 0) extent%first = row(1)
         extent%last = row(1)
         extent%rows = extent%rows + 1
         if (row(1) > part%last) rows_after = rows_after + 1
         if (rows_after <= part%margin) then
            if (row(1) < part%first .and. kept >= 2*part%margin + 1024) then
               values(:, :part%margin) = values(:, kept - part%margin + 1:kept)
               kept = part%margin
            end if
            if (kept == size(values, 2)) &
               values = reshape(values, [size(row), 2*kept], pad=[0.0_wp])
            kept = kept + 1
            values(:, kept) = row
         end if
         if (.not. reader%next_row()) exit
      end do
      if (.not. allocated(error)) call refuse_thousands()
      if (allocated(error)) kept = 0
      values = values(:, :kept)

   contains

      !> Refuses a table of which each number with a comma looks like thousands, as '1,234' does,
      !> because the comma may be no decimal sign. Semicolons between the fields are evidence that
      !> it is one.
      subroutine refuse_thousands()
         if (reader%thousands == 0 .or. reader%thousands < reader%commas) return
         if (reader%separator == ';') return
         call bad_input(error, reader%path//': found a comma before three digits in every '// &
            'number with a comma, expected clear decimal commas (1,5) or decimal points: '// &
            '''1,234'' may be 1.234 or 1234')
      end subroutine refuse_thousands

      !> Reads some numbers of the current line.
      subroutine read_row()
         integer :: column, k

         row = 0
         if (columns(1) == 0) then
            if (reader%rows > 0 .and. reader%line > reader%row_line + 1) then
               call reader%problem(error, 'found a line without numbers before this one, '// &
                  'expected none, where rate counts the lines')
               return
            end if
            row(1) = real(reader%rows, wp)/reader%rate
            reader%rows = reader%rows + 1
            reader%row_line = reader%line
         end if
         do column = 1, maxval(columns)
            if (.not. reader%next_field()) then
               call reader%problem(error, 'found the end of the line, expected a number', column)
               return
            end if
            do k = 1, size(columns)
               if (columns(k) /= column) cycle
               call take_number(column, k)
               if (allocated(error)) return
            end do
         end do
         if (size(reader%header) == 0) return
         if (reader%count_fields() /= 2*size(reader%header)) return
         if (reader%count_filled() == 2*size(reader%header)) call reader%problem(error, &
            'found twice as many fields as names, expected as many (with a decimal point, not '// &
            'a decimal comma)')
      end subroutine read_row

      !> Reads the number of the current field, and checks that the times increase.
      !>
      !> column  number of the column of the field
      !> k       place of the number in `row`; 1 is the time
      subroutine take_number(column, k)
         integer, intent(in) :: column, k
         logical :: ok

         if (k == 1 .and. reader%allows_stamps) then
            call parse_time(reader, reader%text(reader%left:reader%right), row(k), ok)
         else
            call parse_field(reader, reader%text(reader%left:reader%right), row(k), ok)
         end if
         if (.not. ok) then
            call report_number(reader%text(reader%left:reader%right), column, is_time=k == 1 .and. &
               reader%ordered)
            return
         end if
         if (k > 1 .or. .not. reader%ordered) return
         if (reader%previous_field(2) > 0 .and. row(1) <= reader%previous) then
            call report_order(column)
            return
         end if
         reader%previous_field = [reader%left, reader%right]
         reader%previous = row(1)
      end subroutine take_number

      !> Makes the error of a field that is not larger than the field of the row before.
      subroutine report_order(column)
         integer, intent(in) :: column
         character(len=:), allocatable :: expected

         expected = ', expected a larger number'
         if (reader%clock%is_running) expected = ', expected a later time (with all fractions '// &
            'of the second)'
         if (reader%has_decimal_comma()) expected = expected//' (or a decimal point in '// &
            shown(trim_blanks(reader%row()))//' in place of the decimal comma)'
         call reader%problem(error, 'found '//shown(reader%text(reader%left:reader%right))// &
            ' after '//shown(reader%text(reader%previous_field(1):reader%previous_field(2)))// &
            expected, column)
      end subroutine report_order

      !> Makes the error of a field that is no number, with the reason.
      subroutine report_number(field, k, is_time)
         !> The field as in the file, and the number of its column.
         character(len=*), intent(in) :: field
         integer, intent(in) :: k
         !> Whether the column contains times.
         logical, intent(in) :: is_time
         character(len=*), parameter :: one = ', expected one separator', &
            point = ' (a decimal point is ''.'')'
         character(len=:), allocatable :: trimmed, separator, expected

         trimmed = trim_blanks(field)
         separator = ''''//reader%separator//''''
         if (reader%separator == tab) separator = 'a tab'
         if (index(trimmed, ';') > 0 .and. reader%count_of(',') > 0) then
            call reader%problem(error, 'found both '';'' and '','''//one//point)
         else if (index(trimmed, ';') > 0) then
            call reader%problem(error, 'fields are separated by '';'', expected '//separator// &
               ' as in the lines above')
         else if (index(trimmed, tab) > 0) then
            call reader%problem(error, 'found both tabs and '//separator//one//point)
         else if (trimmed == '') then
            call reader%problem(error, 'found an empty field, expected a number', k)
         else
            expected = ', expected a number'
            if (is_time .and. (reader%clock%is_running .or. scan(trimmed, ':/') > 0 .or. &
               scan(trimmed(2:), '-') > 1)) then
               expected = expected_time(reader, trimmed)
            else if (reader%decimal == ',') then
               expected = expected//' (a decimal sign is '','' as in the lines above)'
            else if (index(trimmed, ',') > 0) then
               expected = expected//point
            else if (is_decimal(trimmed)) then
               expected = expected//' of at most 1.79e308'
            end if
            call reader%problem(error, 'found '//shown(trimmed)//expected, k)
         end if
      end subroutine report_number

   end subroutine read_rows

   !> Reads a time: a number, or a time stamp if the first time is one.
   !>
   !> value  the number, or the seconds since the first time stamp
   subroutine parse_time(reader, field, value, ok)
      type(reader_t), intent(inout) :: reader
      character(len=*), intent(in) :: field
      real(wp), intent(out) :: value
      logical, intent(out) :: ok

      if (.not. reader%clock%is_running) then
         call parse_field(reader, field, value, ok)
         if (ok .or. reader%previous_field(2) > 0) return
      end if
      call reader%clock%read(trim_blanks(field), value, ok)
   end subroutine parse_time

   !> Reads a number. Its decimal sign must be that of the numbers before. It can be a comma if
   !> commas do not separate fields, or if the field is in quotes.
   subroutine parse_field(reader, field, value, ok)
      type(reader_t), intent(inout) :: reader
      character(len=*), intent(in) :: field
      real(wp), intent(out) :: value
      logical, intent(out) :: ok
      integer :: comma
      character(len=1) :: sign

      comma = 0
      if (reader%separator /= ',' .or. reader%is_quoted) comma = index(field, ',')
      if (comma == 0) then
         call parse_number(field, value, ok)
         if (reader%separator == ',' .and. .not. reader%is_quoted) return
      else
         call parse_number(with_point(field), value, ok)
      end if
      if (comma == 0 .and. index(field, '.') == 0) return
      sign = merge('.', ',', comma == 0)
      ok = ok .and. (reader%decimal == ' ' .or. reader%decimal == sign)
      if (.not. ok) return
      reader%decimal = sign
      if (comma == 0) return
      reader%commas = reader%commas + 1
      if (looks_like_thousands(trim_blanks(field))) reader%thousands = reader%thousands + 1
   end subroutine parse_field

   !> Returns whether a number with a comma could have it between thousands and hundreds.
   pure logical function looks_like_thousands(number) result(yes)
      character(len=*), intent(in) :: number
      integer :: comma, first

      comma = index(number, ',')
      first = 1
      if (scan(number(:1), '+-') > 0) first = 2
      yes = comma - first >= 1 .and. comma - first <= 3 .and. len(number) == comma + 3
      if (yes) yes = verify(number(first:comma - 1)//number(comma + 1:), '0123456789') == 0 .and. &
         number(first:first) /= '0'
   end function looks_like_thousands

   !> Returns what a message expects in place of a text that looks like a date or a time of day.
   pure function expected_time(reader, text) result(expected)
      type(reader_t), intent(in) :: reader
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: expected

      if (reader%clock%is_running) then
         expected = ', expected a time stamp like '//shown(reader%clock%beginning)// &
            ', of the same or the next day'
      else if (reader%allows_stamps .and. reader%previous_field(2) == 0) then
         expected = ', expected a number or a time stamp (12:00:00.123, 2024-05-01T12:00:00.123)'
      else if (is_stamp(text) .and. .not. reader%allows_stamps) then
         expected = ', expected a number (scripts/to_csv.py turns time stamps into seconds)'
      else
         expected = ', expected a number'
      end if
   end function expected_time

end module beamid_csv
