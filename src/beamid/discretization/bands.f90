!> Symmetric band matrices for the splines' M, C and K, in LAPACK's lower band storage:
!> a(1 + i - j, j) = A(i, j) for j <= i <= j + kd.
module beamid_bands
   use beamid_kinds, only: wp
   implicit none
   private

   public :: band_t, new_band

   !> A symmetric band matrix, or its Cholesky factor.
   type :: band_t
      integer :: n = 0                   !< order
      integer :: kd = 0                  !< half-bandwidth
      real(wp), allocatable :: a(:, :)   !< (kd + 1, n) entries in lower band storage
   contains
      procedure :: add, add_rank_one, add_block, element, times, add_product, factor, solve
   end type band_t

   interface
      subroutine dsbmv(uplo, n, k, alpha, a, lda, x, incx, beta, y, incy)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, k, lda, incx, incy
         real(wp), intent(in) :: alpha, a(lda, *), x(*), beta
         real(wp), intent(inout) :: y(*)
      end subroutine dsbmv
      subroutine dpbtrf(uplo, n, kd, ab, ldab, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, kd, ldab
         real(wp), intent(inout) :: ab(ldab, *)
         integer, intent(out) :: info
      end subroutine dpbtrf
      subroutine dpbtrs(uplo, n, kd, nrhs, ab, ldab, b, ldb, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, kd, nrhs, ldab, ldb
         real(wp), intent(in) :: ab(ldab, *)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dpbtrs
   end interface

contains

   !> Returns the zero matrix of order n with half-bandwidth kd.
   pure function new_band(n, kd) result(band)
      integer, intent(in) :: n, kd
      type(band_t) :: band

      band%n = n
      band%kd = kd
      allocate (band%a(kd + 1, n), source=0.0_wp)
   end function new_band

   !> Adds `value` to A(i, j) and, by symmetry, A(j, i); |i - j| <= kd.
   pure subroutine add(self, i, j, value)
      class(band_t), intent(inout) :: self
      integer, intent(in) :: i, j
      real(wp), intent(in) :: value

      associate (row => max(i, j), column => min(i, j))
         self%a(1 + row - column, column) = self%a(1 + row - column, column) + value
      end associate
   end subroutine add

   !> Adds alpha x x' to the matrix.
   !>
   !> x  (n) vector whose nonzero entries lie within kd + 1 consecutive indices
   pure subroutine add_rank_one(self, alpha, x)
      class(band_t), intent(inout) :: self
      real(wp), intent(in) :: alpha, x(:)
      integer :: i, j

      do j = 1, self%n
         if (abs(x(j)) > 0) then
            do i = j, min(self%n, j + self%kd)
               self%a(1 + i - j, j) = self%a(1 + i - j, j) + alpha*x(i)*x(j)
            end do
         end if
      end do
   end subroutine add_rank_one

   !> Adds alpha x x' to the diagonal block whose first row is `first`.
   !>
   !> x  (m) vector, m <= kd + 1
   pure subroutine add_block(self, first, alpha, x)
      class(band_t), intent(inout) :: self
      integer, intent(in) :: first
      real(wp), intent(in) :: alpha, x(:)
      integer :: i, j

      do j = 1, size(x)
         do i = j, size(x)
            call self%add(first + i - 1, first + j - 1, alpha*x(i)*x(j))
         end do
      end do
   end subroutine add_block

   !> Returns A(i, j), which is zero outside the band.
   pure real(wp) function element(self, i, j)
      class(band_t), intent(in) :: self
      integer, intent(in) :: i, j

      element = 0
      if (abs(i - j) <= self%kd) element = self%a(1 + abs(i - j), min(i, j))
   end function element

   !> Returns the product A x with a vector x of shape (n).
   function times(self, x) result(y)
      class(band_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: y(self%n)

      y = 0
      call self%add_product(1.0_wp, x, y)
   end function times

   !> Adds alpha A x to y; x and y have the shape (n).
   subroutine add_product(self, alpha, x, y)
      class(band_t), intent(in) :: self
      real(wp), intent(in) :: alpha, x(:)
      real(wp), intent(inout) :: y(:)

      call dsbmv('L', self%n, self%kd, alpha, self%a, self%kd + 1, x, 1, 1.0_wp, y, 1)
   end subroutine add_product

   !> Replaces a positive definite matrix by its Cholesky factor, which `solve` uses.
   !>
   !> positive  .false.: the matrix is not positive definite, and its entries are then undefined
   subroutine factor(self, positive)
      class(band_t), intent(inout) :: self
      logical, intent(out) :: positive
      integer :: info

      call dpbtrf('L', self%n, self%kd, self%a, self%kd + 1, info)
      positive = info == 0
   end subroutine factor

   !> Solves A x = b in place, after `factor`.
   !>
   !> b  (n) in: the right-hand side; out: the solution x
   subroutine solve(self, b)
      class(band_t), intent(in) :: self
      real(wp), intent(inout) :: b(:)
      integer :: info

      call dpbtrs('L', self%n, self%kd, 1, self%a, self%kd + 1, b, self%n, info)
   end subroutine solve

end module beamid_bands
