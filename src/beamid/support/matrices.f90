!> Small matrices: the identity, outer products, sums with a diagonal matrix, and elimination; the
!> product of a long matrix with a small one.
module beamid_matrices
   use beamid_kinds, only: wp
   implicit none
   private

   public :: add_diagonal, eliminate, identity, multiply_long, outer, size_of

   !> Adds d (n) to the diagonal of a (n, n).
   interface add_diagonal
      procedure :: add_real_diagonal, add_complex_diagonal
   end interface add_diagonal

contains

   !> Returns the identity of order n.
   pure function identity(n)
      integer, intent(in) :: n
      real(wp) :: identity(n, n)
      integer :: k

      identity = 0
      do k = 1, n
         identity(k, k) = 1
      end do
   end function identity

   !> Returns the outer product x y', (m, n).
   pure function outer(x, y)
      real(wp), intent(in) :: x(:), y(:)
      real(wp) :: outer(size(x), size(y))

      outer = spread(x, 2, size(y))*spread(y, 1, size(x))
   end function outer

   !> Computes the product of a long matrix with a small one, four columns at once.
   !>
   !> x        (rows or more, columns)
   !> weights  (columns, :)
   !> product  (rows, :)
   pure subroutine multiply_long(x, weights, product)
      real(wp), intent(in), contiguous :: x(:, :), weights(:, :)
      real(wp), intent(out) :: product(:, :)
      real(wp) :: total(size(product, 1)), w(4)
      integer :: c, i, p, rows

      rows = size(product, 1)
      do p = 1, size(product, 2)
         total = 0
         do c = 1, size(x, 2) - 3, 4
            w = weights(c:c + 3, p)
            if (all(abs(w) <= 0)) cycle
            !$omp simd
            do i = 1, rows
               total(i) = total(i) + (w(1)*x(i, c) + w(2)*x(i, c + 1)) &
                  + (w(3)*x(i, c + 2) + w(4)*x(i, c + 3))
            end do
         end do
         do c = size(x, 2) - modulo(size(x, 2), 4) + 1, size(x, 2)
            total = total + weights(c, p)*x(:rows, c)
         end do
         product(:, p) = total
      end do
   end subroutine multiply_long

   !> Adds real numbers to the diagonal of a real matrix.
   pure subroutine add_real_diagonal(a, d)
      real(wp), intent(inout) :: a(:, :)
      real(wp), intent(in) :: d(:)
      integer :: k

      do k = 1, size(d)
         a(k, k) = a(k, k) + d(k)
      end do
   end subroutine add_real_diagonal

   !> Adds complex numbers to the diagonal of a complex matrix.
   pure subroutine add_complex_diagonal(a, d)
      complex(wp), intent(inout) :: a(:, :)
      complex(wp), intent(in) :: d(:)
      integer :: k

      do k = 1, size(d)
         a(k, k) = a(k, k) + d(k)
      end do
   end subroutine add_complex_diagonal

   !> Solves a x = b in place for a small matrix, by elimination with partial pivoting. LAPACK takes
   !> several times as long for these orders, and the last bits of the results of a threaded LAPACK
   !> differ from run to run.
   !>
   !> r, m     order of a, and number of columns of b
   !> a        (r, r) matrix, destroyed
   !> b        (r, m) in: the right-hand sides; out: the solutions
   !> regular  .false.: a is singular, and b is undefined
   pure subroutine eliminate(r, m, a, b, regular)
      integer, intent(in) :: r, m
      complex(wp), intent(inout) :: a(:, :), b(:, :)
      logical, intent(out) :: regular
      complex(wp) :: factor, saved
      integer :: i, k, l, pivot

      regular = .true.
      do k = 1, r
         pivot = k
         do i = k + 1, r
            if (size_of(a(i, k)) > size_of(a(pivot, k))) pivot = i
         end do
         if (.not. size_of(a(pivot, k)) > 0) then
            regular = .false.
            return
         end if
         if (pivot /= k) then
            do l = k, r
               saved = a(k, l)
               a(k, l) = a(pivot, l)
               a(pivot, l) = saved
            end do
            do l = 1, m
               saved = b(k, l)
               b(k, l) = b(pivot, l)
               b(pivot, l) = saved
            end do
         end if
         a(k, k) = 1/a(k, k)
         do i = k + 1, r
            factor = a(i, k)*a(k, k)
            a(i, k + 1:r) = a(i, k + 1:r) - factor*a(k, k + 1:r)
            b(i, :m) = b(i, :m) - factor*b(k, :m)
         end do
      end do
      do k = r, 1, -1
         do l = 1, m
            b(k, l) = (b(k, l) - sum(a(k, k + 1:r)*b(k + 1:r, l)))*a(k, k)
         end do
      end do
   end subroutine eliminate

   !> Returns |Re z| + |Im z|, a norm of z that needs no square root.
   elemental real(wp) function size_of(z)
      complex(wp), intent(in) :: z

      size_of = abs(real(z)) + abs(aimag(z))
   end function size_of

end module beamid_matrices
