!> Reading the tables that the program writes.
module tables
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_kinds, only: wp
   use beamid_numbers, only: parse_number
   use checks, only: check
   use shell, only: has_all, line_count
   implicit none
   private

   public :: line, field, part, number, lines_with, longest, check_table

   character(len=*), parameter :: nl = achar(10)

contains

   !> Line k of a text; '' when it has fewer.
   pure function line(text, k)
      character(len=*), intent(in) :: text
      integer, intent(in) :: k
      character(len=:), allocatable :: line

      line = part(text, k, nl)
   end function line

   !> A field of a table; rows are counted from 1 below the header.
   pure function field(table, row, column) result(text)
      character(len=*), intent(in) :: table
      integer, intent(in) :: row, column
      character(len=:), allocatable :: text

      text = part(line(table, row + 1), column, ',')
   end function field

   !> The k-th of the parts that a separator makes of a text; '' when there are fewer.
   pure function part(text, k, separator) result(piece)
      character(len=*), intent(in) :: text
      integer, intent(in) :: k
      character(len=1), intent(in) :: separator
      character(len=:), allocatable :: piece
      integer :: first, length, i

      first = 1
      do i = 1, k
         piece = ''
         if (first > len(text)) return
         length = index(text(first:), separator) - 1
         if (length < 0) length = len(text) - first + 1
         piece = text(first:first + length - 1)
         first = first + length + 1
      end do
   end function part

   !> The number in a text, or in one of its fields; NaN, which passes no check, where none is.
   real(wp) function number(text, column)
      character(len=*), intent(in) :: text
      integer, intent(in), optional :: column
      logical :: ok

      if (present(column)) then
         call parse_number(part(text, column, ','), number, ok)
      else
         call parse_number(text, number, ok)
      end if
      if (.not. ok) number = ieee_value(number, ieee_quiet_nan)
   end function number

   pure integer function count_commas(text) result(n)
      character(len=*), intent(in) :: text
      integer :: k

      n = count([(text(k:k) == ',', k=1, len(text))])
   end function count_commas

   !> How many lines contain all the words.
   pure integer function lines_with(text, words) result(n)
      character(len=*), intent(in) :: text, words
      integer :: k

      n = count([(has_all(line(text, k), words), k=1, line_count(text))])
   end function lines_with

   pure integer function longest(text)
      character(len=*), intent(in) :: text
      integer :: k

      longest = maxval([(len(line(text, k)), k=1, line_count(text))])
   end function longest

   !> The header, the number of rows, as many fields in each, and finite numbers throughout. Columns
   !> behind those of the contract are welcome.
   subroutine check_table(what, table, header, rows, texts)
      character(len=*), intent(in) :: what, table, header
      integer, intent(in) :: rows
      !> Columns that need not be numbers; the rest may be empty where there are such.
      integer, intent(in), optional :: texts(:)
      integer :: row, column, columns, faults
      character(len=:), allocatable :: text
      real(wp) :: value
      logical :: ok, empty

      call check(what//': header', index(line(table, 1)//',', header//',') == 1, line(table, 1))
      call check(what//': rows', line_count(table) == rows + 1)
      columns = count_commas(line(table, 1)) + 1
      faults = 0
      do row = 1, line_count(table) - 1
         if (count_commas(line(table, row + 1)) /= columns - 1) faults = faults + 1
         do column = 1, columns
            text = field(table, row, column)
            if (present(texts)) then
               empty = text == '' .and. column /= 6
               if (any(texts == column) .or. empty) cycle
            end if
            call parse_number(text, value, ok)
            if (.not. ok) faults = faults + 1
         end do
      end do
      call check(what//': fields are finite numbers', faults == 0)
   end subroutine check_table

end module tables
