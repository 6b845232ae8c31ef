!> Writes and reads the rows of members.csv, the table of all members of an ensemble.
module beamid_member_rows
   use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_value
   use beamid_ensemble_rows, only: row_t
   use beamid_ensembles, only: member_t
   use beamid_errors, only: bad_input, error_t
   use beamid_kinds, only: ip, wp
   use beamid_lines, only: split
   use beamid_numbers, only: parse_number, shown
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_texts, only: next_line, text_t
   implicit none
   private

   public :: read_members, read_row, rows_of, whole_number

   !> Header of members.csv.
   character(len=*), parameter, public :: members_header = 'member,status,message,elements,'// &
      'parameter,estimate,std_error,lower95,upper95,total_lower95,total_upper95,truth'
   character(len=*), parameter :: line_feed = achar(10)
   !> Number of columns, and number of them before the numbers.
   integer, parameter :: fields_before = 5, columns = 12

contains

   !> Appends the rows of one member.
   !>
   !> text  rows of the table
   !> k     number of the member
   subroutine add_member(text, k, member)
      character(len=:), allocatable, intent(inout) :: text
      integer, intent(in) :: k
      type(member_t), intent(in) :: member
      character(len=512) :: line
      integer :: i, j, n

      if (allocated(member%message)) then
         text = text//to_text(k)//',failed,"'
         do i = 1, len(member%message)
            ! A quote inside quotes is doubled. A line feed would end the row.
            if (member%message(i:i) == '"') text = text//'"'
            if (member%message(i:i) == line_feed) then
               text = text//'; '
            else
               text = text//member%message(i:i)
            end if
         end do
         text = text//'"'//repeat(',', columns - 3)//line_feed
         return
      end if
      do i = 1, size(member%rows)
         associate (row => member%rows(i))
            write (line, '(i0,a,i0,2a)') k, ',ok,,', row%elements, ',', row%parameter
            n = len_trim(line)
            call add_field(row%estimate)
            call add_field(row%std_error)
            do j = 1, 2
               call add_field(row%interval(j))
            end do
            do j = 1, 2
               call add_field(row%total(j))
            end do
            call add_field(row%truth)
            text = text//line(:n)//line_feed
         end associate
      end do

   contains

      !> Adds a field to the line; the field is empty if the value is `unlimited`.
      subroutine add_field(value)
         real(wp), intent(in) :: value
         character(len=24) :: digits
         integer :: first

         n = n + 1
         line(n:n) = ','
         if (value > huge(value)) then
            line(n + 1:n + 3) = 'inf'
            n = n + 3
         else if (value < unlimited) then
            write (digits, '(es24.16e3)') value
            first = verify(digits, ' ')
            line(n + 1:n + 25 - first) = digits(first:)
            n = n + 25 - first
         end if
      end subroutine add_field

   end subroutine add_member

   !> Returns the rows of several members.
   !>
   !> first  number of the first of them
   function rows_of(members, first) result(rows)
      type(member_t), intent(in) :: members(:)
      integer, intent(in) :: first
      character(len=:), allocatable :: rows
      type(text_t) :: text
      character(len=:), allocatable :: part
      integer :: k

      do k = 1, size(members)
         part = ''
         call add_member(part, first + k - 1, members(k))
         call text%add(part)
      end do
      rows = text%content()
   end function rows_of

   !> Reads one row.
   !>
   !> member  number of the member; 0: the row has none
   !> failed  .true.: the member failed, and `row` is empty
   !> sound   .false.: `add_member` cannot have written the row
   subroutine read_row(line, member, row, failed, sound)
      character(len=*), intent(in) :: line
      integer, intent(out) :: member
      type(row_t), intent(out) :: row
      logical, intent(out) :: failed, sound
      character(len=64) :: fields(columns)
      logical :: is_number(columns - fields_before)
      real(wp) :: values(columns - fields_before)
      integer :: k

      call split(line, fields)
      member = whole_number(trim(fields(1)))
      failed = fields(2) /= 'ok' .or. fields(3) /= ''
      sound = member > 0 .and. index(line, trim(fields(1))//',failed,"') == 1
      if (failed) return
      row%elements = whole_number(trim(fields(4)))
      row%parameter = fields(5)(:len(row%parameter))
      do k = 1, size(values)
         call read_number(trim(fields(fields_before + k)), values(k), is_number(k))
      end do
      sound = member > 0 .and. row%elements > 0 .and. all(is_number) .and. &
         count([(line(k:k) == ',', k=1, len(line))]) == columns - 1
      row%estimate = values(1)
      row%std_error = values(2)
      row%interval = values(3:4)
      row%total = values(5:6)
      row%truth = values(7)
   end subroutine read_row

   !> Returns the integer in a field of at most nine digits; 0 if the field is not such a number.
   pure integer function whole_number(field) result(n)
      character(len=*), intent(in) :: field
      integer :: k

      n = 0
      if (len(field) > 9 .or. verify(field, '0123456789') > 0) return
      do k = 1, len(field)
         n = 10*n + iachar(field(k:k)) - iachar('0')
      end do
   end function whole_number

   !> Reads a number; `unlimited` if the field is empty or not a number.
   !>
   !> ok  whether the field is a number or empty
   subroutine read_number(field, value, ok)
      character(len=*), intent(in) :: field
      real(wp), intent(out) :: value
      logical, intent(out) :: ok

      value = unlimited
      ok = field == '' .or. field == '-Infinity'
      if (ok) return
      if (field == 'inf') then
         value = ieee_value(value, ieee_positive_inf)
         ok = .true.
         return
      end if
      call parse_number(field, value, ok)
      if (.not. ok) value = unlimited
   end subroutine read_number

   !> Reads all members of a table.
   !>
   !> text     of the table
   !> path     of its file, for messages
   !> n        number of members
   !> members  (n) the members; a member without estimates has no rows
   !> error    the first row that does not belong to a member from 1 to n, in ascending order
   subroutine read_members(text, path, n, members, error)
      character(len=*), intent(in) :: text, path
      integer, intent(in) :: n
      type(member_t), allocatable, intent(out) :: members(:)
      type(error_t), allocatable, intent(out) :: error
      type(row_t) :: row
      character(len=:), allocatable :: line
      integer(ip) :: first
      integer :: k, last, number
      logical :: failed, sound

      allocate (members(n))
      do k = 1, n
         allocate (members(k)%rows(0))
      end do
      if (index(text, members_header//line_feed) /= 1) then
         call bad_input(error, path//':1: found another header, expected '//members_header)
         return
      end if
      first = len(members_header) + 2
      number = 1
      last = 1
      do while (next_line(text, first, line))
         number = number + 1
         call read_row(line, k, row, failed, sound)
         if (.not. sound .or. k < last .or. k > n) then
            call bad_input(error, path//':'//to_text(number)//': found '//shown(line)// &
               ', expected a row of one of members '//to_text(last)//' to '//to_text(n))
            return
         end if
         if (.not. failed) members(k)%rows = [members(k)%rows, row]
         last = k
      end do
   end subroutine read_members

end module beamid_member_rows
