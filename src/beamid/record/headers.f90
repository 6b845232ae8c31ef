!> Finds the first row of numbers and the names of the columns of a text table.
!>
!> A line of units, below the line of names and as wide, becomes part of the names: 't [s]'.
!>
!> The first row is the first line of numbers. The lines before it are a header, which is skipped;
!> the last header line with as many fields as the row contains the names of the columns. A line
!> between these two that begins like a number, or has as many fields, is not part of the header but
!> a row with a mistake.
module beamid_headers
   use beamid_column_units, only: are_units, column_unit_t, no_unit, &
      unit_of_column, without_brackets
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: ip
   use beamid_numbers, only: is_decimal, shown, trim_blanks, with_point
   use beamid_rows, only: column_length, reader_t, separators
   use beamid_strings, only: to_text
   use beamid_time_stamps, only: is_stamp
   implicit none
   private

   public :: find_rows

   !> The lines down to the first row of numbers.
   type :: header_t
      character(len=1) :: separator = ' '   !< of the fields of the first row
      integer(ip) :: row = 0         !< line number of the first row; 0: none
      integer :: fields = 0          !< number of its fields
      integer :: filled = 0          !< number of its fields up to the last that is not blank
      integer :: lines = 0           !< number of lines above it that are neither blank nor comments
      integer(ip) :: names = 0       !< number of the line of names; 0: there is none
      integer(ip) :: names_above = 0 !< number of such a line directly above it; 0: there is none
   end type header_t

contains

   !> Reads the names above the rows of numbers, and goes to the first row.
   !>
   !> n_columns  smallest number of columns of a row
   !> error      no line at all, or no row of numbers: the mistake in the first lines
   subroutine find_rows(reader, n_columns, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      type(error_t), allocatable, intent(out) :: error
      type(header_t) :: header

      call find_numbers()
      if (header%row > 0) call find_names()
      if (header%row > 0) then
         if (header%names > 0) then
            call reader%go_to(header%names, header%separator)
            call read_header()
            if (header%names_above > 0 .and. .not. allocated(error)) call join_units()
         end if
         call reader%go_to(header%row, header%separator)
         reader%skipped = header%lines - merge(1, 0, header%names > 0)
         return
      end if
      call reader%rewind()
      if (.not. reader%next_row()) then
         call bad_input(error, reader%path//': found no line of data, expected columns of numbers')
         return
      end if
      if (.not. is_header()) return
      call read_header()
      if (allocated(error)) return
      if (.not. reader%next_row()) call bad_input(error, reader%path// &
         ': found names of columns only, expected numbers below')

   contains

      !> Finds the first line of numbers, and counts the lines above it.
      subroutine find_numbers()
         !> Number of fields of the line above, split at each separator, if that line contains words
         !> only; otherwise 0.
         integer :: fields_above(len(separators))
         integer :: k

         fields_above = 0
         call reader%rewind()
         do while (reader%next_row())
            if (is_row(fields_above)) then
               header = header_t(reader%separator, reader%line, reader%count_fields(), &
                  reader%count_filled(), header%lines)
               return
            end if
            do k = 1, len(separators)
               call reader%split_at(separators(k:k))
               fields_above(k) = merge(reader%count_fields(), 0, is_header())
            end do
            header%lines = header%lines + 1
         end do
      end subroutine find_numbers

      !> Returns whether the current line is a row of numbers, and splits it at the separator for
      !> which it is one. Numbers with decimal points are tried before those with decimal commas. A
      !> line with as many fields as the line of words above it may contain time stamps and remarks,
      !> if it begins like a number and at least one field is a number.
      logical function is_row(fields_above) result(yes)
         integer, intent(in) :: fields_above(:)
         integer :: k, pass

         do pass = 1, 3
            do k = 1, len(separators)
               call reader%split_at(separators(k:k))
               yes = reader%count_fields() >= max(2, n_columns) .or. n_columns == 1 .and. k == 1
               if (yes .and. pass < 3) then
                  yes = begins_with_numbers(comma=pass == 2)
               else if (yes) then
                  yes = fields_above(k) == reader%count_fields() .and. fields_above(k) > 1 .and. &
                     begins_like_number(reader) .and. contains_number(reader)
               end if
               if (yes) return
            end do
         end do
      end function is_row

      !> Returns whether the first fields of the current line that are not blank are numbers: at
      !> least `n_columns`, and two if there are two. The first of them may be a time stamp instead.
      !>
      !> comma  whether the decimal sign is a comma
      logical function begins_with_numbers(comma) result(yes)
         logical, intent(in) :: comma
         character(len=:), allocatable :: field
         integer :: found

         found = 0
         yes = .not. comma .or. reader%separator /= ',' .or. reader%is_quoted
         do while (yes .and. found < max(2, n_columns))
            if (.not. reader%next_field()) exit
            field = trim_blanks(reader%text(reader%left:reader%right))
            if (field == '') cycle
            yes = is_decimal(field)
            if (comma) yes = is_decimal(with_point(field))
            if (found == 0 .and. .not. yes) yes = is_stamp(field)
            found = found + 1
         end do
         yes = yes .and. found >= n_columns
         call reader%restart_row()
      end function begins_with_numbers

      !> Finds the line of names, and a row with a mistake above the first row of numbers.
      subroutine find_names()
         integer(ip) :: row, mistaken_row
         integer :: lines_above, lines, line_of_names
         logical :: may_be_names, is_wide

         row = header%row
         line_of_names = -1
         mistaken_row = 0
         lines_above = 0
         lines = 0
         call reader%rewind()
         do while (reader%next_row())
            if (reader%line == row) exit
            call reader%split_at(header%separator)
            is_wide = is_as_wide()
            ! A single line of words contains the names. So does the last line above a row of twice
            ! as many fields: its numbers have decimal commas and are separated by commas; they are
            ! refused with the row.
            may_be_names = is_wide .or. header%lines == 1 .or. lines + 1 == header%lines .and. &
               header%separator == ',' .and. header%fields == 2*reader%count_fields()
            if (may_be_names .and. is_header() .and. reader%count_fields() >= n_columns) then
               header%names_above = merge(header%names, 0_ip, lines == line_of_names + 1)
               header%names = reader%line
               line_of_names = lines
               mistaken_row = 0
            else if (mistaken_row == 0 .and. (begins_like_number(reader) .and. &
               (header%names > 0 .or. is_wide) .or. header%names > 0 .and. is_wide)) then
               mistaken_row = reader%line
               lines_above = lines
            end if
            lines = lines + 1
         end do
         if (mistaken_row > 0) then
            header%row = mistaken_row
            header%lines = lines_above
         else if (header%lines == 1 .and. header%names == 0) then
            ! A line of names with another separator than that of the rows is a mistake, not a
            ! header.
            call reader%rewind()
            if (.not. reader%next_row()) return
            if (is_header() .and. reader%count_fields() == header%fields .and. header%fields > 1) &
               header%row = 0
         end if
      end subroutine find_names

      !> Returns whether the current line has as many fields as the first row; the last field may be
      !> missing if it is blank in that row.
      logical function is_as_wide() result(yes)
         integer :: n

         n = reader%count_filled()
         yes = any(n == [header%filled, header%filled + 1, header%fields])
      end function is_as_wide

      !> Returns whether the current line contains names: none of its first fields begins like a
      !> number.
      logical function is_header() result(yes)
         integer :: k

         yes = .false.
         do k = 1, n_columns
            if (.not. reader%next_field()) exit
            if (is_number_like(reader%text(reader%left:reader%right))) then
               yes = .false.
               exit
            end if
            yes = yes .or. trim_blanks(reader%text(reader%left:reader%right)) /= ''
         end do
         call reader%restart_row()
      end function is_header

      !> If the line that was taken for names contains units only, reads the line of names above it,
      !> and appends the units to the names.
      subroutine join_units()
         character(len=column_length), allocatable :: units(:)
         type(column_unit_t) :: unit
         integer :: k

         if (.not. are_units(reader%header)) return
         units = reader%header
         call reader%go_to(header%names_above, header%separator)
         call read_header()
         if (allocated(error)) return
         header%lines = header%lines - 1
         do k = 1, min(size(units), size(reader%header))
            unit = unit_of_column(reader%header(k))
            if (units(k) /= '' .and. unit%kind == no_unit) reader%header(k) = &
               trim(reader%header(k))//' ['//without_brackets(units(k))//']'
         end do
      end subroutine join_units

      !> Reads the names of all columns, without surrounding blanks and quotation marks.
      subroutine read_header()
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
            reader%header(k) = trim_blanks(reader%text(reader%left:reader%right))
         end do
      end subroutine read_header

   end subroutine find_rows

   !> Returns whether any field of the current line is a number, with either decimal sign.
   logical function contains_number(reader) result(yes)
      type(reader_t), intent(inout) :: reader

      yes = .false.
      do while (.not. yes)
         if (.not. reader%next_field()) exit
         yes = is_decimal(with_point(trim_blanks(reader%text(reader%left:reader%right))))
      end do
      call reader%restart_row()
   end function contains_number

   !> Returns whether the first field of the current line begins like a number.
   logical function begins_like_number(reader) result(yes)
      type(reader_t), intent(inout) :: reader

      yes = reader%next_field()
      if (yes) yes = is_number_like(reader%text(reader%left:reader%right))
      call reader%restart_row()
   end function begins_like_number

   !> Returns whether a field begins like a number.
   pure logical function is_number_like(field) result(yes)
      character(len=*), intent(in) :: field
      character(len=2) :: start

      start = trim_blanks(field)
      if (verify(start(:1), '+-.') == 0) start = start(2:)
      yes = verify(start(:1), '0123456789') == 0
   end function is_number_like

end module beamid_headers
