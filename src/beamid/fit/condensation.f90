!> Condenses the rows of a least-squares problem: an orthogonal transformation leaves as many rows
!> as there are columns, and one more for the length of what is orthogonal to all of them.
!>
!> With the decomposition A = Q R, |A x + y| = |R x + Q'y| + |y - Q Q'y| in squares, for every x. R
!> and Q'y need one pass over blocks of rows: R is Cholesky's factor of A'A with columns of length
!> one. A second pass forms y - A c with c = R**-1 Q'y and corrects Q'y, so that a small remainder
!> keeps its digits. Of a very long record, some blocks give a first c, and the only pass forms
!> y - A c as well. If the condition of A is poor, R is improved by a decomposition of A R**-1
!> (CholeskyQR2: Yamamoto et al., Electron. Trans. Numer. Anal. 44, 2015, 306). If that fails,
!> Householder reflections decompose the blocks one after the other.
!>
!> Long records are divided into parts, which threads share. The sums of the parts are added in
!> their order, so that the result does not depend on the number of threads.
module beamid_condensation
   use beamid_interrupts, only: stop_flag
   use beamid_kernels, only: add_products, block_rows, combine_columns, subtract_columns
   use beamid_kinds, only: wp
   use beamid_triangles, only: divide, divide_transposed, factorize, triangle_of
   implicit none
   private

   public :: condensed_t, condense, condense_matrix, factor_of, rows_of_part

   !> Rows of a matrix A and of a vector y, which are computed block by block.
   type, abstract, public :: rows_t
      integer :: rows = 0      !< of A and y
      integer :: columns = 0   !< of A
   contains
      procedure(fill), deferred :: fill
   end type rows_t

   abstract interface
      !> Computes a block of rows.
      !>
      !> first  index of the first row; rows beyond the last one may have any finite value
      !> x      (block_rows, columns + 1) rows of A and y
      subroutine fill(self, first, x)
         import :: block_rows, rows_t, wp
         class(rows_t), intent(in) :: self
         integer, intent(in) :: first
         real(wp), intent(inout), contiguous :: x(:, :)
      end subroutine fill
   end interface

   !> A matrix in memory and a vector.
   type, extends(rows_t) :: matrix_rows_t
      real(wp), pointer :: a(:, :) => null()   !< (m, k)
      real(wp), pointer :: y(:) => null()      !< (m); null: 0
   contains
      procedure :: fill => copy_rows
   end type matrix_rows_t

   !> What is left of A and y: |A x + y|**2 = |factor x + y|**2 + left**2 for every x.
   type :: condensed_t
      real(wp), allocatable :: factor(:, :)   !< (k, k) R; from `condense` an upper triangle
      real(wp), allocatable :: y(:)           !< (k) Q'y
      real(wp) :: left = 0                    !< |y - Q Q'y|
   end type condensed_t

   !> Condition above which Cholesky's factor is improved, and above which reflections are used.
   real(wp), parameter :: poor = 1e4_wp, very_poor = 1e8_wp

   !> One pass suffices up to this condition.
   real(wp), parameter :: good = 100
   !> Every so many blocks of a record give the first c, if there are as many of these.
   integer, parameter :: stride = 16

   !> Number of rows below which nothing is gained.
   integer, parameter, public :: few_rows = 4*block_rows

contains

   !> Condenses the rows of A and y.
   !>
   !> only_factor  whether only the factor is wanted; default .false.
   subroutine condense(rows, condensed, only_factor)
      class(rows_t), intent(in) :: rows
      type(condensed_t), intent(out) :: condensed
      logical, intent(in), optional :: only_factor
      real(wp), allocatable :: products(:, :), first(:, :), factor(:, :), c(:)
      real(wp) :: condition
      logical :: is_improved, keeps_digits
      integer :: columns, k

      k = rows%columns
      ! The kernel takes an even number of columns.
      columns = 2*((k + 2)/2)
      allocate (products(columns, columns), first(k, k), factor(k, k))
      is_improved = .false.
      allocate (c(k), source=0.0_wp)
      if (rows%rows >= stride**2*block_rows .and. .not. present(only_factor)) then
         call multiply(rows, products, every=stride)
         call factorize(products, k, first, condition)
         if (condition <= good) then
            c = products(:k, k + 1)
            call divide_transposed(first, c)
            call divide(first, c)
         end if
      end if
      call multiply(rows, products, c=c)
      call factorize(products, k, first, condition)
      if (condition > poor .and. condition <= very_poor) then
         is_improved = .true.
         call multiply(rows, products, first)
         call factorize(products, k, factor, condition)
      end if
      if (.not. condition <= very_poor) then
         call reflect(rows, condensed)
         return
      end if
      condensed%factor = first
      if (is_improved) condensed%factor = matmul(factor, first)
      if (present(only_factor)) then
         if (only_factor) return
      end if
      condensed%y = products(:k, k + 1)
      if (is_improved) then
         call divide_transposed(factor, condensed%y)
         call project(rows, factor, condensed, first)
         return
      end if
      call divide_transposed(first, condensed%y)
      associate (total => products(k + 1, k + 1), along => sum(condensed%y**2))
         condensed%left = sqrt(max(0.0_wp, total - along))
         keeps_digits = condition <= good .and. along < total/2
      end associate
      condensed%y = condensed%y + matmul(first, c)
      if (.not. keeps_digits) call project(rows, first, condensed)
   end subroutine condense

   !> Returns the number of rows of a part of a long record, a multiple of `block_rows`: a thread
   !> computes their products in about a millisecond, much longer than it takes to start it. There
   !> are at most 64 parts, because each has its own sums.
   !>
   !> rows, columns  of the record
   pure integer function rows_of_part(rows, columns)
      integer, intent(in) :: rows, columns
      integer, parameter :: products = 25600   ! of a row, times the number of blocks
      integer, parameter :: most_parts = 64

      rows_of_part = block_rows*max(1, products/columns**2, (rows - 1)/(most_parts*block_rows) + 1)
   end function rows_of_part

   !> Computes the products of all columns.
   !>
   !> products  (columns, columns) the upper triangle of [A y]'[A y]
   !> divisor   (k, k) if present, A is replaced by A divisor**-1
   !> c         (k) if present, y is replaced by y - A c
   !> every     if present, only the first of so many blocks are taken
   subroutine multiply(rows, products, divisor, c, every)
      class(rows_t), intent(in) :: rows
      real(wp), intent(out), contiguous :: products(:, :)
      real(wp), intent(in), optional :: divisor(:, :), c(:)
      integer, intent(in), optional :: every
      real(wp), allocatable :: of_part(:, :, :)
      integer :: part, parts, rows_each, step

      step = block_rows
      if (present(every)) step = every*block_rows
      rows_each = rows_of_part(rows%rows/(step/block_rows), size(products, 2))*(step/block_rows)
      parts = (rows%rows + rows_each - 1)/rows_each
      products = 0
      if (parts == 1) then
         call multiply_part(1, rows%rows, products)
         return
      end if
      allocate (of_part(size(products, 1), size(products, 2), parts), source=0.0_wp)
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do part = 1, parts
         call multiply_part((part - 1)*rows_each + 1, min(part*rows_each, rows%rows), &
            of_part(:, :, part))
      end do
      !$omp end parallel do
      do part = 1, parts
         products = products + of_part(:, :, part)
      end do

   contains

      !> Adds the products of the rows `begin` to `end`.
      subroutine multiply_part(begin, end, sums)
         integer, intent(in) :: begin, end
         real(wp), intent(inout), contiguous :: sums(:, :)
         ! Column k + 2, if there is one, is 0.
         real(wp), allocatable :: x(:, :)
         integer :: first, k

         k = rows%columns
         allocate (x(block_rows, size(sums, 2)), source=0.0_wp)
         do first = begin, end, step
            call next_block(rows, first, x, divisor)
            if (present(c)) call combine_columns(x, k, -c, 1, x(:, k + 1))
            call add_products(x, size(sums, 2), sums)
         end do
      end subroutine multiply_part

   end subroutine multiply

   !> Computes a block of rows; rows beyond the last one are 0.
   !>
   !> divisor  as in `multiply`
   subroutine next_block(rows, first, x, divisor)
      class(rows_t), intent(in) :: rows
      integer, intent(in) :: first
      real(wp), intent(inout), contiguous :: x(:, :)
      real(wp), intent(in), optional :: divisor(:, :)
      integer :: j, k

      call rows%fill(first, x(:, :rows%columns + 1))
      if (rows%rows - first + 1 < block_rows) x(rows%rows - first + 2:, :rows%columns + 1) = 0
      if (.not. present(divisor)) return
      do k = 1, rows%columns
         do j = 1, k - 1
            x(:, k) = x(:, k) - divisor(j, k)*x(:, j)
         end do
         if (abs(divisor(k, k)) > 0) x(:, k) = x(:, k)/divisor(k, k)
      end do
   end subroutine next_block

   !> Corrects Q'y, and computes what is left of y.
   !>
   !> factor     (k, k) R of A or, with `divisor`, of A divisor**-1
   !> condensed  in and out: Q'y; out: what is left
   !> divisor    as in `multiply`
   subroutine project(rows, factor, condensed, divisor)
      class(rows_t), intent(in) :: rows
      real(wp), intent(in) :: factor(:, :)
      type(condensed_t), intent(inout) :: condensed
      real(wp), intent(in), optional :: divisor(:, :)
      real(wp) :: c(size(factor, 1)), still(size(c))
      real(wp), allocatable :: of_part(:, :), total(:)
      integer :: part, parts, rows_each

      c = condensed%y
      call divide(factor, c)
      rows_each = rows_of_part(rows%rows, size(c) + 1)
      parts = (rows%rows + rows_each - 1)/rows_each
      allocate (of_part(size(c), parts), total(parts), source=0.0_wp)
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag) if(parts > 1)
      do part = 1, parts
         call project_part((part - 1)*rows_each + 1, min(part*rows_each, rows%rows), &
            of_part(:, part), total(part))
      end do
      !$omp end parallel do
      still = sum(of_part, dim=2)
      call divide_transposed(factor, still)
      condensed%y = condensed%y + still
      condensed%left = sqrt(max(0.0_wp, sum(total) - sum(still**2)))

   contains

      !> Adds the products with what is left of the rows `begin` to `end`, and its sum of squares.
      subroutine project_part(begin, end, products, squares)
         integer, intent(in) :: begin, end
         real(wp), intent(inout), contiguous :: products(:)
         real(wp), intent(inout) :: squares
         real(wp), allocatable :: x(:, :)
         integer :: first, k

         k = size(products)
         allocate (x(block_rows, k + 1))
         do first = begin, end, block_rows
            call next_block(rows, first, x, divisor)
            call subtract_columns(x, k, c, x(:, k + 1), products, squares)
         end do
      end subroutine project_part

   end subroutine project

   !> Condenses by Householder reflections: each block is reflected together with the triangle that
   !> the blocks before have left.
   subroutine reflect(rows, condensed)
      class(rows_t), intent(in) :: rows
      type(condensed_t), intent(out) :: condensed
      real(wp) :: x(block_rows, rows%columns + 1), stack(rows%columns + 1 + block_rows, &
         rows%columns + 1), triangle(rows%columns + 1, rows%columns + 1)
      integer :: first, n

      n = rows%columns + 1
      triangle = 0
      do first = 1, rows%rows, block_rows
         call next_block(rows, first, x)
         stack(:n, :) = triangle
         stack(n + 1:, :) = x
         call triangle_of(stack, triangle)
      end do
      condensed%factor = triangle(:n - 1, :n - 1)
      condensed%y = triangle(:n - 1, n)
      condensed%left = abs(triangle(n, n))
   end subroutine reflect

   !> Condenses a matrix a (m, k) and a vector y (m).
   subroutine condense_matrix(a, y, condensed)
      real(wp), intent(in), target :: a(:, :), y(:)
      type(condensed_t), intent(out) :: condensed
      type(matrix_rows_t) :: rows

      rows%rows = size(a, 1)
      rows%columns = size(a, 2)
      rows%a => a
      rows%y => y
      call condense(rows, condensed)
   end subroutine condense_matrix

   !> Returns an upper triangle R (k, k), 0 below, with R'R = a'a.
   !>
   !> a  (m, k)
   function factor_of(a) result(factor)
      real(wp), intent(in), target :: a(:, :)
      real(wp) :: factor(size(a, 2), size(a, 2))
      type(matrix_rows_t) :: rows
      type(condensed_t) :: condensed

      rows%rows = size(a, 1)
      rows%columns = size(a, 2)
      rows%a => a
      call condense(rows, condensed, only_factor=.true.)
      factor = condensed%factor
   end function factor_of

   !> Copies a block of rows of a matrix and a vector.
   subroutine copy_rows(self, first, x)
      class(matrix_rows_t), intent(in) :: self
      integer, intent(in) :: first
      real(wp), intent(inout), contiguous :: x(:, :)
      integer :: n

      n = min(block_rows, self%rows - first + 1)
      x(:n, :self%columns) = self%a(first:first + n - 1, :)
      x(:n, self%columns + 1) = 0
      if (associated(self%y)) x(:n, self%columns + 1) = self%y(first:first + n - 1)
   end subroutine copy_rows

end module beamid_condensation
