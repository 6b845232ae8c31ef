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
module beamid_condensation
   use beamid_kernels, only: add_products, block_rows, combine_columns, subtract_columns
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeqrf
   implicit none
   private

   public :: condensed_t, condense, condense_matrix, factor_of, triangle_of

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
      real(wp), allocatable :: x(:, :), products(:, :), first(:, :), factor(:, :), c(:)
      real(wp) :: condition
      logical :: is_improved, keeps_digits
      integer :: columns, k

      k = rows%columns
      ! The kernel takes an even number of columns.
      columns = 2*((k + 2)/2)
      allocate (x(block_rows, columns), source=0.0_wp)
      allocate (products(columns, columns), first(k, k), factor(k, k))
      is_improved = .false.
      allocate (c(k), source=0.0_wp)
      if (rows%rows >= stride**2*block_rows .and. .not. present(only_factor)) then
         call multiply(rows, x, products, every=stride)
         call factorize(products, k, first, condition)
         if (condition <= good) then
            c = products(:k, k + 1)
            call divide_transposed(first, c)
            call divide(first, c)
         end if
      end if
      call multiply(rows, x, products, c=c)
      call factorize(products, k, first, condition)
      if (condition > poor .and. condition <= very_poor) then
         is_improved = .true.
         call multiply(rows, x, products, first)
         call factorize(products, k, factor, condition)
      end if
      if (.not. condition <= very_poor) then
         call reflect(rows, x, condensed)
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
         call project(rows, x, factor, condensed, first)
         return
      end if
      call divide_transposed(first, condensed%y)
      associate (total => products(k + 1, k + 1), along => sum(condensed%y**2))
         condensed%left = sqrt(max(0.0_wp, total - along))
         keeps_digits = condition <= good .and. along < total/2
      end associate
      condensed%y = condensed%y + matmul(first, c)
      if (.not. keeps_digits) call project(rows, x, first, condensed)
   end subroutine condense

   !> Computes the products of all columns.
   !>
   !> x         (block_rows, columns) space for a block; column k + 2, if there is one, is 0
   !> products  (columns, columns) the upper triangle of [A y]'[A y]
   !> divisor   (k, k) if present, A is replaced by A divisor**-1
   !> c         (k) if present, y is replaced by y - A c
   !> every     if present, only the first of so many blocks are taken
   subroutine multiply(rows, x, products, divisor, c, every)
      class(rows_t), intent(in) :: rows
      real(wp), intent(inout), contiguous :: x(:, :)
      real(wp), intent(out), contiguous :: products(:, :)
      real(wp), intent(in), optional :: divisor(:, :), c(:)
      integer, intent(in), optional :: every
      integer :: first, k, step

      k = rows%columns
      step = block_rows
      if (present(every)) step = every*block_rows
      products = 0
      do first = 1, rows%rows, step
         call next_block(rows, first, x, divisor)
         if (present(c)) call combine_columns(x, k, -c, 1, x(:, k + 1))
         call add_products(x, size(products, 2), products)
      end do
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

   !> Computes Cholesky's factor of A'A. Columns of zeros give rows and columns of zeros.
   !>
   !> products   (k or more, k or more) upper triangle of A'A
   !> factor     (k, k) upper triangle; 0 below
   !> condition  estimate of the condition of A, its columns scaled to length one; huge: the
   !>            factorization has failed
   pure subroutine factorize(products, k, factor, condition)
      real(wp), intent(in) :: products(:, :)
      integer, intent(in) :: k
      real(wp), intent(out) :: factor(:, :), condition
      real(wp) :: length(k), inverse(k, k), pivot
      integer :: i, j

      condition = huge(condition)
      length = [(sqrt(products(j, j)), j=1, k)]
      if (.not. all(length <= sqrt(huge(condition)))) return
      factor = 0
      do j = 1, k
         if (.not. length(j) > 0) cycle
         do i = 1, j - 1
            if (.not. length(i) > 0) cycle
            factor(i, j) = (products(i, j)/(length(i)*length(j)) &
               - dot_product(factor(:i - 1, i), factor(:i - 1, j)))/factor(i, i)
         end do
         pivot = 1 - sum(factor(:j - 1, j)**2)
         if (.not. pivot > 0) return
         factor(j, j) = sqrt(pivot)
      end do
      inverse = 0
      do j = 1, k
         if (.not. length(j) > 0) cycle
         inverse(j, j) = 1
         call divide(factor, inverse(:, j))
      end do
      condition = norm2(inverse)*sqrt(real(k, wp))
      do j = 1, k
         factor(:, j) = factor(:, j)*length(j)
      end do
   end subroutine factorize

   !> Corrects Q'y, and computes what is left of y.
   !>
   !> factor     (k, k) R of A or, with `divisor`, of A divisor**-1
   !> condensed  in and out: Q'y; out: what is left
   !> divisor    as in `multiply`
   subroutine project(rows, x, factor, condensed, divisor)
      class(rows_t), intent(in) :: rows
      real(wp), intent(inout), contiguous :: x(:, :)
      real(wp), intent(in) :: factor(:, :)
      type(condensed_t), intent(inout) :: condensed
      real(wp), intent(in), optional :: divisor(:, :)
      real(wp) :: c(size(factor, 1)), still(size(c)), total
      integer :: first, k

      k = size(c)
      c = condensed%y
      call divide(factor, c)
      still = 0
      total = 0
      do first = 1, rows%rows, block_rows
         call next_block(rows, first, x, divisor)
         call subtract_columns(x, k, c, x(:, k + 1), still, total)
      end do
      call divide_transposed(factor, still)
      condensed%y = condensed%y + still
      condensed%left = sqrt(max(0.0_wp, total - sum(still**2)))
   end subroutine project

   !> Solves R x = b; components of x whose diagonal element is 0 are 0.
   pure subroutine divide(r, x)
      real(wp), intent(in) :: r(:, :)
      real(wp), intent(inout) :: x(:)
      integer :: j

      do j = size(x), 1, -1
         if (abs(r(j, j)) > 0) then
            x(j) = x(j)/r(j, j)
         else
            x(j) = 0
         end if
         x(:j - 1) = x(:j - 1) - x(j)*r(:j - 1, j)
      end do
   end subroutine divide

   !> Solves R'x = b; components of x whose diagonal element is 0 are 0.
   pure subroutine divide_transposed(r, x)
      real(wp), intent(in) :: r(:, :)
      real(wp), intent(inout) :: x(:)
      integer :: j

      do j = 1, size(x)
         x(j) = x(j) - dot_product(r(:j - 1, j), x(:j - 1))
         if (abs(r(j, j)) > 0) then
            x(j) = x(j)/r(j, j)
         else
            x(j) = 0
         end if
      end do
   end subroutine divide_transposed

   !> Condenses by Householder reflections: each block is reflected together with the triangle that
   !> the blocks before have left.
   subroutine reflect(rows, x, condensed)
      class(rows_t), intent(in) :: rows
      real(wp), intent(inout), contiguous :: x(:, :)
      type(condensed_t), intent(out) :: condensed
      real(wp) :: stack(rows%columns + 1 + block_rows, rows%columns + 1), &
         triangle(rows%columns + 1, rows%columns + 1)
      integer :: first, n

      n = rows%columns + 1
      triangle = 0
      do first = 1, rows%rows, block_rows
         call next_block(rows, first, x)
         stack(:n, :) = triangle
         stack(n + 1:, :) = x(:, :n)
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

   !> Reflects a matrix into an upper triangle.
   !>
   !> a         (m, n) m >= n; destroyed
   !> triangle  (n, n) 0 below the diagonal
   subroutine triangle_of(a, triangle)
      real(wp), intent(inout), contiguous :: a(:, :)
      real(wp), intent(out) :: triangle(:, :)
      real(wp) :: tau(size(a, 2)), work(32*size(a, 2))
      integer :: info, j

      call dgeqrf(size(a, 1), size(a, 2), a, size(a, 1), tau, work, size(work), info)
      triangle = 0
      do j = 1, size(a, 2)
         triangle(:j, j) = a(:j, j)
      end do
   end subroutine triangle_of

end module beamid_condensation
