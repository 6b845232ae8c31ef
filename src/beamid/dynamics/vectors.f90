!> Roots of an assembly and their vectors.
!>
!> For a root s near the pole p_j of oscillator j, with x_j = 1 and G = sum over i /= j of
!> v_i v_i'/D_i,
!>
!>     y = (1 + G H)**-1 v_j,  f = H y,  x_i = -v_i'f/D_i,  D_j + v_j'f = 0:
!>
!> nothing in it grows without bound when what hangs on the beam is light.
module beamid_vectors
   use beamid_assembly, only: assembly_t, pencil_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: root_t, vector_t, couplings, logarithmic_derivative, nearest_pole, solve_coupled, &
      solve_mass, vector_at

   !> A point s given relative to the nearest pole, so that D_j keeps its digits however near they
   !> are.
   type :: root_t
      integer :: j = 0                !< s = pole(j, side) + offset
      integer :: side = 1
      complex(wp) :: offset = 0
      complex(wp) :: s = 0
   end type root_t

   !> The vector x of a root, and what derivatives of it need.
   type :: vector_t
      complex(wp), allocatable :: x(:)       !< (n)
      complex(wp), allocatable :: y(:), f(:) !< (r) V'x and H y
      complex(wp), allocatable :: D(:), dD(:)      !< (n) D(s) and D'(s)
      complex(wp), allocatable :: G(:, :)          !< (r, r)
      complex(wp), allocatable :: H(:, :), dH(:, :)
      complex(wp) :: A = 0                   !< x'(2 s M + C) x
      real(wp) :: size_A = 0                 !< A with every term made positive
   end type vector_t

   interface
      subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine dgesv
      subroutine zgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, lda, ldb
         complex(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine zgesv
   end interface

contains

   !> Gives a point the nearest pole as its origin.
   pure subroutine nearest_pole(self, root)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(inout) :: root
      real(wp) :: distance(2)
      integer :: j, side

      do side = 1, 2
         distance(side) = minval(abs(root%s - self%pole(:, side)))
      end do
      side = minloc(distance, dim=1)
      j = minloc(abs(root%s - self%pole(:, side)), dim=1)
      if (j == root%j .and. side == root%side) return
      root%j = j
      root%side = side
      root%offset = root%s - self%pole(j, side)
   end subroutine nearest_pole

   !> D(s) and D'(s). The distances from other poles are taken by way of the nearest one, which
   !> leaves each with all its digits.
   pure subroutine from_pole(self, root, D, dD)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(:), dD(:)
      complex(wp) :: origin, a, b
      integer :: i

      origin = self%pole(root%j, root%side)
      do i = 1, self%n
         a = (origin - self%pole(i, 1)) + root%offset
         b = (origin - self%pole(i, 2)) + root%offset
         D(i) = self%pencil%m(i)*a*b
         dD(i) = self%pencil%m(i)*(a + b)
      end do
   end subroutine from_pole

   !> H(s) and H'(s).
   pure subroutine couplings(pencil, s, H, dH)
      type(pencil_t), intent(in) :: pencil
      complex(wp), intent(in) :: s
      complex(wp), intent(out) :: H(:, :), dH(:, :)

      H = (pencil%hm*s + pencil%hc)*s + pencil%hk
      dH = 2*pencil%hm*s + pencil%hc
   end subroutine couplings

   !> G(s), the sum without oscillator j, and G'(s).
   pure subroutine flexibility(v, j, D, dD, G, dG)
      real(wp), intent(in) :: v(:, :)
      integer, intent(in) :: j
      complex(wp), intent(in) :: D(:), dD(:)
      complex(wp), intent(out) :: G(:, :), dG(:, :)
      complex(wp) :: a, b
      integer :: i, k, l

      G = 0
      dG = 0
      do i = 1, size(D)
         if (i == j) cycle
         a = 1/D(i)
         b = -dD(i)*a**2
         do l = 1, size(v, 1)
            do k = 1, l
               G(k, l) = G(k, l) + v(k, i)*v(l, i)*a
               dG(k, l) = dG(k, l) + v(k, i)*v(l, i)*b
            end do
         end do
      end do
      do l = 1, size(v, 1)
         G(l, :l - 1) = G(:l - 1, l)
         dG(l, :l - 1) = dG(:l - 1, l)
      end do
   end subroutine flexibility

   !> W'/W of the characteristic polynomial W(s) = det(1 + G H)(D_j + v_j'f) prod over i /= j of D_i.
   complex(wp) function logarithmic_derivative(self, root) result(value)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), dimension(self%n) :: D, dD
      complex(wp), dimension(size(self%v, 1), size(self%v, 1)) :: H, dH, G, dG, a
      complex(wp) :: b(size(self%v, 1), size(self%v, 1) + 1), w, dw
      integer :: pivots(size(self%v, 1)), info, k, r

      r = size(self%v, 1)
      call from_pole(self, root, D, dD)
      call couplings(self%pencil, root%s, H, dH)
      call flexibility(self%v, root%j, D, dD, G, dG)
      associate (v => self%v(:, root%j), j => root%j)
         a = matmul(G, H)
         do k = 1, r
            a(k, k) = a(k, k) + 1
         end do
         b(:, 1) = v
         b(:, 2:) = matmul(dG, H) + matmul(G, dH)
         call zgesv(r, r + 1, a, r, pivots, b, r, info)
         w = D(j) + sum(v*matmul(H, b(:, 1)))
         if (info /= 0 .or. .not. abs(w) > 0) then
            ! On the root, or where it cannot be told: a step too short to matter.
            value = huge(1.0_wp)
            if (info /= 0) value = 1/(1e-8_wp*max(abs(root%s), tiny(1.0_wp)))
            return
         end if
         dw = dD(j) + sum(v*(matmul(dH, b(:, 1)) - matmul(H, matmul(b(:, 2:), b(:, 1)))))
         dD(j) = 0
         D(j) = 1
      end associate
      value = dw/w + sum(dD/D)
      do k = 1, r
         value = value + b(k, k + 1)
      end do
   end function logarithmic_derivative

   !> The vector of a root. Of a point that is no root: the answer to a force on oscillator j.
   function vector_at(self, root) result(vector)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      type(vector_t) :: vector
      complex(wp), dimension(size(self%v, 1), size(self%v, 1)) :: dG
      complex(wp) :: b(size(self%v, 1), 1)
      integer :: r

      r = size(self%v, 1)
      allocate (vector%D(self%n), vector%dD(self%n), vector%H(r, r), vector%dH(r, r), vector%G(r, r))
      call from_pole(self, root, vector%D, vector%dD)
      call couplings(self%pencil, root%s, vector%H, vector%dH)
      call flexibility(self%v, root%j, vector%D, vector%dD, vector%G, dG)
      b(:, 1) = self%v(:, root%j)
      call solve_coupled(vector%G, vector%H, b)
      vector%y = b(:, 1)
      vector%f = matmul(vector%H, vector%y)
      vector%x = -matmul(vector%f, self%v)
      vector%x(root%j) = 1
      vector%x(:root%j - 1) = vector%x(:root%j - 1)/vector%D(:root%j - 1)
      vector%x(root%j + 1:) = vector%x(root%j + 1:)/vector%D(root%j + 1:)
      vector%A = sum(vector%dD*vector%x**2) + sum(vector%y*matmul(vector%dH, vector%y))
      vector%size_A = sum(abs(vector%dD*vector%x**2)) &
         + sum(abs(vector%y)*matmul(abs(vector%dH), abs(vector%y)))
   end function vector_at

   !> b := (1 + G H)**-1 b.
   subroutine solve_coupled(G, H, b)
      complex(wp), intent(in) :: G(:, :), H(:, :)
      complex(wp), intent(inout) :: b(:, :)
      complex(wp) :: a(size(G, 1), size(G, 1))
      integer :: pivots(size(G, 1)), info, k, r

      r = size(G, 1)
      a = matmul(G, H)
      do k = 1, r
         a(k, k) = a(k, k) + 1
      end do
      call zgesv(r, size(b, 2), a, r, pivots, b, r, info)
      if (info /= 0) b = 0
   end subroutine solve_coupled

   !> x = M**-1 b and y = V'x, the latter without the cancellation of a sum over x.
   !>
   !> b, x  (n)
   !> y     (r)
   subroutine solve_mass(self, b, x, y)
      type(assembly_t), intent(in) :: self
      real(wp), intent(in) :: b(:)
      real(wp), intent(out) :: x(:), y(:)
      real(wp) :: a(size(self%v, 1), size(self%v, 1)), c(size(self%v, 1), 1), &
         scaled(size(self%v, 1), self%n)
      integer :: pivots(size(self%v, 1)), info, k, r

      associate (p => self%pencil, v => self%v)
         r = size(v, 1)
         scaled = v/spread(p%m, 1, r)
         a = matmul(matmul(scaled, transpose(v)), p%hm)
         do k = 1, r
            a(k, k) = a(k, k) + 1
         end do
         c(:, 1) = matmul(scaled, b)
         call dgesv(r, 1, a, r, pivots, c, r, info)
         if (info /= 0) c = 0
         y = c(:, 1)
         x = b/p%m - matmul(matmul(p%hm, y), scaled)
      end associate
   end subroutine solve_mass

end module beamid_vectors
