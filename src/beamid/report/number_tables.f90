!> Tables of integers and real numbers whose rows become text only while the file is written.
module beamid_number_tables
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
   use beamid_row_tables, only: row_table_t
   use beamid_strings, only: full_length, put_full, to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: number_table_t, add_number_table

   !> A table; its rows begin with integers, which may be none.
   type, extends(row_table_t) :: number_table_t
      integer, allocatable :: labels(:, :)     !< (labels, rows)
      real(wp), allocatable :: numbers(:, :)   !< (numbers, rows)
   contains
      procedure :: append, add_rows, is_finite
   end type number_table_t

contains

   !> Adds a table to the files of a run.
   !>
   !> header  names of the columns
   !> table   not allocated on return
   subroutine add_number_table(output, name, header, table)
      type(output_t), intent(inout) :: output
      character(len=*), intent(in) :: name, header
      type(number_table_t), allocatable, intent(inout) :: table
      class(row_table_t), allocatable :: rows

      call move_alloc(table, rows)
      call output%add_table(name, header//new_line('a'), rows)
   end subroutine add_number_table

   !> Appends rows.
   !>
   !> labels   (labels, new rows)
   !> numbers  (numbers, new rows)
   pure subroutine append(self, labels, numbers)
      class(number_table_t), intent(inout) :: self
      integer, intent(in) :: labels(:, :)
      real(wp), intent(in) :: numbers(:, :)

      self%rows = self%rows + size(numbers, 2)
      if (.not. allocated(self%numbers)) then
         self%labels = labels
         self%numbers = numbers
      else
         self%labels = reshape([self%labels, labels], [size(labels, 1), self%rows])
         self%numbers = reshape([self%numbers, numbers], [size(numbers, 1), self%rows])
      end if
   end subroutine append

   !> Adds rows to a text. Arguments as of `row_table_t`.
   subroutine add_rows(self, first, last, text)
      class(number_table_t), intent(in) :: self
      integer, intent(in) :: first, last
      type(text_t), intent(inout) :: text
      character(len=(size(self%labels, 1) + size(self%numbers, 1))*(full_length + 1)) :: row
      character(len=:), allocatable :: label
      integer :: digits, i, k, length

      do i = first, last
         length = 0
         do k = 1, size(self%labels, 1)
            label = to_text(self%labels(k, i))//','
            row(length + 1:length + len(label)) = label
            length = length + len(label)
         end do
         do k = 1, size(self%numbers, 1)
            call put_full(self%numbers(k, i), row(length + 1:length + full_length), digits)
            length = length + digits + 1
            row(length:length) = merge(',', new_line('a'), k < size(self%numbers, 1))
         end do
         call text%add(row(:length))
      end do
   end subroutine add_rows

   !> Returns whether all numbers of the table are finite.
   pure logical function is_finite(self)
      class(number_table_t), intent(in) :: self

      is_finite = all(ieee_is_finite(self%numbers))
   end function is_finite

end module beamid_number_tables
