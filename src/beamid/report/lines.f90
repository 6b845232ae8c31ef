!> Building blocks of reports and tables: text with numbers in it, columns, comma-separated values.
module beamid_lines
   use beamid_kinds, only: wp
   use beamid_statistics, only: unlimited
   use beamid_strings, only: fixed, full, to_text
   use beamid_texts, only: right, text_t
   implicit none
   private

   public :: add_lines, columns, csv_row, filled, known, limit, split, unit_suffix

contains

   !> Appends lines with the values in place of the marks `#`, in their order, formatted by
   !> `filled`.
   !>
   !> values  as many as there are marks in all lines
   subroutine add_lines(text, lines, values)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: lines(:)
      real(wp), intent(in), optional :: values(:)
      integer :: k, j, first, last

      last = 0
      do k = 1, size(lines)
         first = last + 1
         last = last + count([(lines(k)(j:j) == '#', j=1, len(lines))])
         if (last < first) then
            call text%line(lines(k))
         else
            call text%line(filled(trim(lines(k)), values(first:last)))
         end if
      end do
   end subroutine add_lines

   !> Returns a line with a value in place of each mark: `#` is a number as short as possible, `#.2`
   !> a number with two decimals, `#%` a ratio in per cent.
   pure function filled(line, values) result(text)
      character(len=*), intent(in) :: line
      real(wp), intent(in) :: values(:)
      character(len=:), allocatable :: text
      character(len=2) :: form
      integer :: first, mark, k

      text = ''
      first = 1
      do k = 1, size(values)
         mark = first - 1 + index(line(first:), '#')
         text = text//line(first:mark - 1)
         form = line(mark + 1:)
         if (form(:1) == '%') then
            text = text//decimals(100*values(k), 1)//' %'
            first = mark + 2
         else if (form(:1) == '.' .and. index('0123456789', form(2:)) > 0) then
            text = text//decimals(values(k), index('123456789', form(2:)))
            first = mark + 3
         else
            text = text//to_text(values(k))
            first = mark + 1
         end if
      end do
      text = text//line(first:)
   end function filled

   !> Returns a value with a number of decimals; if it is too large for that, as short as possible.
   pure function decimals(value, digits) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      character(len=:), allocatable :: text

      text = trim(adjustl(fixed(value, 12, digits)))
      if (index(text, '*') > 0) text = to_text(value)
   end function decimals

   !> Returns values side by side, each at the right end of a column.
   !>
   !> width  of a column [characters]
   !> form   mark of `filled` that formats each value; default `#`
   pure function columns(values, width, form) result(line)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: width
      character(len=*), intent(in), optional :: form
      character(len=:), allocatable :: line
      integer :: k

      line = ''
      do k = 1, size(values)
         if (present(form)) then
            line = line//right(filled(form, values(k:k)), width)
         else
            line = line//right(to_text(values(k)), width)
         end if
      end do
   end function columns

   !> Returns a row of a table for other programs: labels, then numbers to full precision.
   !>
   !> labels  first fields of the row, separated by commas
   pure function csv_row(labels, values) result(row)
      character(len=*), intent(in) :: labels
      real(wp), intent(in) :: values(:)
      character(len=:), allocatable :: row
      integer :: k

      row = labels
      do k = 1, size(values)
         row = row//','//full(values(k))
      end do
   end function csv_row

   !> Splits a row of a table into its fields; fields that the row lacks are ''.
   pure subroutine split(row, fields)
      character(len=*), intent(in) :: row
      character(len=*), intent(out) :: fields(:)
      integer :: comma, first, k

      first = 1
      do k = 1, size(fields)
         comma = index(row(first:)//',', ',')
         fields(k) = row(first:min(len(row), first + comma - 2))
         first = min(len(row) + 1, first + comma)
      end do
   end subroutine split

   !> Returns a field of a table for other programs: a number, or `inf`.
   pure function limit(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = full(value)
      if (value > huge(value)) text = 'inf'
   end function limit

   !> Returns a field of a table for other programs: a number, or nothing if it is `unlimited`.
   pure function known(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = ''
      if (value < unlimited) text = full(value)
   end function known

   !> Returns a unit with a blank before it, to follow a number; '' if there is no unit.
   pure function unit_suffix(unit) result(text)
      character(len=*), intent(in) :: unit
      character(len=:), allocatable :: text

      text = ''
      if (unit /= '') text = ' '//trim(unit)
   end function unit_suffix

end module beamid_lines
