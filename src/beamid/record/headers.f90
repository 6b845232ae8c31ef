!> Where the rows of a text table begin, and what its columns are called.
!>
!> The first row is the first line of numbers. Lines before it are a header, which is skipped; the
!> last of them with as many fields as the row names the columns. A line between these two that
!> begins like a number, or has as many fields, is no header but a row with a mistake in it.
module beamid_headers
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: ip
   use beamid_numbers, only: is_decimal, shown, trim_blanks, with_point
   use beamid_rows, only: reader_t, separators
   use beamid_strings, only: to_text
   implicit none
   private

   public :: find_rows

   !> What is known of the lines down to the first row of numbers.
   type :: header_t
      character(len=1) :: separator = ' '
      integer(ip) :: row = 0              !< number of that line; 0: there is none
      integer :: fields = 0               !< of that row
      integer :: filled = 0               !< of that row, up to the last that is not blank
      integer :: lines = 0                !< above it, without blank ones and comments
      integer(ip) :: names = 0            !< number of the line of names; 0: there is none
   end type header_t

contains

   !> Reads the names above the rows of numbers, and goes to the first row.
   !>
   !> n_columns  how many columns the rows must have at least
   !> error      no line at all, or no row of numbers: what is wrong with the first lines
   subroutine find_rows(reader, n_columns, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      type(error_t), allocatable, intent(out) :: error
      type(header_t) :: header

      call find_numbers(reader, n_columns, header)
      if (header%row > 0) call find_names(reader, n_columns, header)
      if (header%row > 0) then
         if (header%names > 0) then
            call reader%go_to(header%names, header%separator)
            call read_header(reader, n_columns, error)
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
      if (.not. is_header(reader, n_columns)) return
      call read_header(reader, n_columns, error)
      if (allocated(error)) return
      if (.not. reader%next_row()) call bad_input(error, reader%path// &
         ': found names of columns only, expected numbers below')
   end subroutine find_rows

   !> Finds the first line of numbers.
   subroutine find_numbers(reader, n_columns, header)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      type(header_t), intent(out) :: header
      !> Fields of the line above where it is one of words, by each separator; else 0.
      integer :: above(len(separators))
      integer :: k

      above = 0
      call reader%rewind()
      do while (reader%next_row())
         if (is_row(reader, n_columns, above)) then
            header = header_t(reader%separator, reader%line, reader%count_fields(), &
               reader%count_filled(), header%lines)
            return
         end if
         do k = 1, len(separators)
            call reader%split_at(separators(k:k))
            above(k) = merge(reader%count_fields(), 0, is_header(reader, n_columns))
         end do
         header%lines = header%lines + 1
      end do
   end subroutine find_numbers

   !> Whether the current line is one of numbers; it is split at the separator with which it is:
   !> with decimal points rather than with commas. Below a line of words with as many fields it may
   !> hold stamps and remarks, if it begins like a number and one of its fields is one.
   logical function is_row(reader, n_columns, above) result(yes)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns, above(:)
      integer :: k, pass

      do pass = 1, 3
         do k = 1, len(separators)
            call reader%split_at(separators(k:k))
            yes = reader%count_fields() >= max(2, n_columns) .or. n_columns == 1 .and. k == 1
            if (yes .and. pass < 3) then
               yes = holds_numbers(reader, n_columns, comma=pass == 2)
            else if (yes) then
               yes = above(k) == reader%count_fields() .and. above(k) > 1 .and. &
                  begins_like_number(reader) .and. holds_a_number(reader)
            end if
            if (yes) return
         end do
      end do
   end function is_row

   !> Whether the first fields of the current line that are not blank are numbers: as many as are
   !> wanted, and two where there are two.
   !>
   !> comma  whether a decimal sign is a comma
   logical function holds_numbers(reader, n_columns, comma) result(yes)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      logical, intent(in) :: comma
      character(len=:), allocatable :: field
      integer :: found

      found = 0
      yes = .not. (comma .and. reader%separator == ',')
      do while (yes .and. found < max(2, n_columns))
         if (.not. reader%next_field()) exit
         field = trim_blanks(reader%text(reader%left:reader%right))
         if (field == '') cycle
         yes = is_decimal(field)
         if (comma) yes = is_decimal(with_point(field))
         found = found + 1
      end do
      yes = yes .and. found >= n_columns
      call reader%restart_row()
   end function holds_numbers

   !> Whether a field of the current line is a number, with either decimal sign.
   logical function holds_a_number(reader) result(yes)
      type(reader_t), intent(inout) :: reader

      yes = .false.
      do while (.not. yes)
         if (.not. reader%next_field()) exit
         yes = is_decimal(with_point(trim_blanks(reader%text(reader%left:reader%right))))
      end do
      call reader%restart_row()
   end function holds_a_number

   !> Finds the line of names, and a row with a mistake in it above that of numbers.
   subroutine find_names(reader, n_columns, header)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
      type(header_t), intent(inout) :: header
      integer(ip) :: row, wrong
      integer :: above, lines
      logical :: names, wide

      row = header%row
      wrong = 0
      above = 0
      lines = 0
      call reader%rewind()
      do while (reader%next_row())
         if (reader%line == row) exit
         call reader%split_at(header%separator)
         wide = is_as_wide(reader, header)
         ! A single line of words are names, and those above a row of twice as many fields: decimal
         ! commas between commas, which are refused with the row.
         names = wide .or. header%lines == 1 .or. lines + 1 == header%lines .and. &
            header%separator == ',' .and. header%fields == 2*reader%count_fields()
         if (names .and. is_header(reader, n_columns) .and. reader%count_fields() >= n_columns) then
            header%names = reader%line
            wrong = 0
         else if (wrong == 0 .and. (begins_like_number(reader) .and. (header%names > 0 .or. wide) &
            .or. header%names > 0 .and. wide)) then
            wrong = reader%line
            above = lines
         end if
         lines = lines + 1
      end do
      if (wrong > 0) then
         header%row = wrong
         header%lines = above
      else if (header%lines == 1 .and. header%names == 0) then
         ! A line of names with another separator than the rows is a mistake, not a header.
         call reader%rewind()
         if (.not. reader%next_row()) return
         if (is_header(reader, n_columns) .and. reader%count_fields() == header%fields .and. &
            header%fields > 1) header%row = 0
      end if
   end subroutine find_names

   !> Whether the current line has as many fields as the first row, in which the last may be left
   !> out when it is blank.
   logical function is_as_wide(reader, header) result(yes)
      type(reader_t), intent(inout) :: reader
      type(header_t), intent(in) :: header
      integer :: n

      n = reader%count_filled()
      yes = any(n == [header%filled, header%filled + 1, header%fields])
   end function is_as_wide

   !> Whether the first field of the current line begins like a number.
   logical function begins_like_number(reader) result(yes)
      type(reader_t), intent(inout) :: reader

      yes = reader%next_field()
      if (yes) yes = is_number_like(reader%text(reader%left:reader%right))
      call reader%restart_row()
   end function begins_like_number

   !> Whether a field begins like a number.
   pure logical function is_number_like(field) result(yes)
      character(len=*), intent(in) :: field
      character(len=2) :: start

      start = trim_blanks(field)
      if (verify(start(:1), '+-.') == 0) start = start(2:)
      yes = verify(start(:1), '0123456789') == 0
   end function is_number_like

   !> Whether the current line holds names: none of its first fields begins like a number.
   logical function is_header(reader, n_columns) result(yes)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: n_columns
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

end module beamid_headers
