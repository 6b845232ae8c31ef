!> Upper triangles R of matrices A with R'R = A'A, and systems of equations with them.
module beamid_triangles
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeqrf
   implicit none
   private

   public :: divide, divide_transposed, factorize, triangle_of

contains

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
         call divide(factor(:j, :j), inverse(:j, j))
      end do
      condition = norm2(inverse)*sqrt(real(k, wp))
      do j = 1, k
         factor(:, j) = factor(:, j)*length(j)
      end do
   end subroutine factorize

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

end module beamid_triangles
