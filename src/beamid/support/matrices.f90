!> Small matrices: the identity, outer products, and sums with a diagonal matrix.
module beamid_matrices
   use beamid_kinds, only: wp
   implicit none
   private

   public :: add_diagonal, identity, outer

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

end module beamid_matrices
