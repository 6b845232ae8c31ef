!> The equations at s as one matrix, where something acts between all oscillators. With E(s) of
!> `beamid_assembly` and f = H y
!>
!>     P(s) (x, y) = (F, -base_coupling/s**2),    P = [ D + E   V H ]
!>                                           [   V'     -A ],
!>
!> and at a root (x, f)'P = 0 too. So ds/dp = -(x, f)'P_p (x, y)/A, A = (x, f)'P_s (x, y), and the
!> vector's own derivative solves
!>
!>     P (x, y)_p + P_s (x, y) ds/dp = -P_p (x, y),    (x, f)'P_s (x, y)_p = 0.
module beamid_systems
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_vectors, only: nearest_pole, root_t, vector_t
   implicit none
   private

   public :: system_at, improve_root, find_whole_vector, differentiate_vector, vector_slope_t, &
      factor, solve

   !> Derivatives of a root and its vector with respect to one parameter.
   type :: vector_slope_t
      complex(wp) :: s = 0                    !< of the root
      complex(wp), allocatable :: x(:), y(:), f(:)
      complex(wp) :: A = 0
   end type vector_slope_t

   interface
      subroutine zgetrf(m, n, a, lda, ipiv, info)
         import :: wp
         integer, intent(in) :: m, n, lda
         complex(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine zgetrf
      subroutine zgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: n, nrhs, lda, ldb, ipiv(*)
         complex(wp), intent(in) :: a(lda, *)
         complex(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine zgetrs
   end interface

contains

   !> P(s) and P'(s).
   !>
   !> point  its distances from the poles keep their digits
   !> P, dP  (n + r, n + r)
   subroutine system_at(assembly, point, P, dP)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: point
      complex(wp), intent(out) :: P(:, :), dP(:, :)
      complex(wp) :: left, right, origin
      integer :: i, k, n, r

      n = assembly%n
      r = size(assembly%v, 1)
      P = 0
      dP = 0
      associate (s => point%s, b => assembly%beam, v => assembly%v, &
         pencil => assembly%pencil(assembly%form_at(point%s)))
         P(:b, :b) = assembly%dense(:, :, 1)*s + assembly%dense(:, :, 2)
         dP(:b, :b) = assembly%dense(:, :, 1)
         origin = assembly%pole(point%origin, point%side)
         do i = 1, n
            left = (origin - assembly%pole(i, 1)) + point%offset
            right = (origin - assembly%pole(i, 2)) + point%offset
            P(i, i) = P(i, i) + pencil%m(i)*left*right
            dP(i, i) = dP(i, i) + pencil%m(i)*(left + right)
         end do
         P(:n, n + 1:) = matmul(transpose(v), (pencil%hm*s + pencil%hc)*s + pencil%hk)
         dP(:n, n + 1:) = matmul(transpose(v), 2*pencil%hm*s + pencil%hc)
         P(n + 1:, :n) = v
         do k = 1, r
            P(n + k, n + k) = -assembly%compliance(k)
         end do
      end associate
   end subroutine system_at

   !> LU factors, as `solve` takes them; at a root a pivot that vanishes is made tiny, as inverse
   !> iteration asks for: far below round-off, which counts by row and column and may be less here.
   subroutine factor(P, pivots)
      complex(wp), intent(inout) :: P(:, :)
      integer, intent(out) :: pivots(:)
      integer :: info, k

      call zgetrf(size(pivots), size(pivots), P, size(pivots), pivots, info)
      do k = 1, size(pivots)
         if (.not. abs(real(P(k, k))) + abs(aimag(P(k, k))) > 0) &
            P(k, k) = epsilon(1.0_wp)**2*maxval(abs(P(:k, k))) + tiny(1.0_wp)
      end do
   end subroutine factor

   !> b := P**-1 b, or P'**-1 b ('T').
   subroutine solve(P, pivots, b, side)
      complex(wp), intent(in) :: P(:, :)
      integer, intent(in) :: pivots(:)
      complex(wp), intent(inout) :: b(:, :)
      character, intent(in) :: side
      integer :: info

      call zgetrs(side, size(pivots), size(b, 2), P, size(pivots), pivots, b, size(pivots), info)
   end subroutine solve

   !> Rayleigh's quotient and inverse iteration in turn, from a point near a root; of a multiple one
   !> it is known to a root of the round-off only. What a last change leaves is its square, as Q is
   !> one of s.
   subroutine improve_root(assembly, root)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      integer, parameter :: most_steps = 20
      real(wp), parameter :: arrived = 3e-8_wp
      complex(wp), dimension(assembly%n + size(assembly%v, 1), assembly%n &
         + size(assembly%v, 1)) :: P, dP
      complex(wp) :: z(size(P, 1), 1), driven(size(P, 1)), left(size(P, 1)), change
      real(wp), dimension(size(P, 1)) :: rows, columns
      integer :: pivots(size(P, 1)), step, n

      n = assembly%n
      z = 1
      do step = 1, most_steps
         call system_at(assembly, root, P, dP)
         if (step > 1) z(:, 1) = matmul(dP, z(:, 1))
         driven = z(:, 1)
         call balance(P, rows, columns)
         call factor(P, pivots)
         call solve_balanced(P, pivots, rows, columns, z)
         driven = driven/maxval(abs(z))
         z = z/maxval(abs(z))
         left = left_of(assembly, root%s, z(:, 1))
         change = -sum(left*driven)/sum(left*matmul(dP, z(:, 1)))
         if (.not. abs(aimag(root%s)) > 0) change = real(change)
         if (step == 1) cycle
         root%s = root%s + change
         root%offset = root%offset + change
         if (abs(change) > 1e-2_wp*abs(root%offset)) call nearest_pole(assembly, root)
         if (abs(change) <= arrived*max(abs(root%offset), arrived*abs(root%s))) exit
      end do
      root%j = maxloc(assembly%pencil(1)%m*abs(z(:n, 1))**2, dim=1)
   end subroutine improve_root

   !> Rows and columns divided by the largest of each, powers of two: round-off counts relative to
   !> what is of its own kind, an oscillator or an attachment.
   !>
   !> rows, columns  (size of P) that multiply
   pure subroutine balance(P, rows, columns)
      complex(wp), intent(inout) :: P(:, :)
      real(wp), intent(out) :: rows(:), columns(:)
      integer :: k

      rows = scale(1.0_wp, -exponent(maxval(abs(P), dim=2)))
      do k = 1, size(rows)
         P(k, :) = P(k, :)*rows(k)
      end do
      columns = scale(1.0_wp, -exponent(maxval(abs(P), dim=1)))
      do k = 1, size(columns)
         P(:, k) = P(:, k)*columns(k)
      end do
   end subroutine balance

   !> z := P**-1 z of the matrix that has been balanced and factored.
   subroutine solve_balanced(P, pivots, rows, columns, z)
      complex(wp), intent(in) :: P(:, :)
      integer, intent(in) :: pivots(:)
      real(wp), intent(in) :: rows(:), columns(:)
      complex(wp), intent(inout) :: z(:, :)

      z(:, 1) = rows*z(:, 1)
      call solve(P, pivots, z, 'N')
      z(:, 1) = columns*z(:, 1)
   end subroutine solve_balanced

   !> (x, f) of (x, y).
   pure function left_of(assembly, s, z) result(left)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s, z(:)
      complex(wp) :: left(size(z))

      left = z
      associate (p => assembly%pencil(assembly%form_at(s)), n => assembly%n)
         left(n + 1:) = matmul((p%hm*s + p%hc)*s + p%hk, z(n + 1:))
      end associate
   end function left_of

   !> The vector of a root, x_j = 1, with as much of `vector_t` as does not need D apart from E.
   subroutine find_whole_vector(assembly, root, vector)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(inout) :: vector
      complex(wp), dimension(assembly%n + size(assembly%v, 1), assembly%n &
         + size(assembly%v, 1)) :: P, dP
      complex(wp) :: z(size(P, 1), 1)
      real(wp), dimension(size(P, 1)) :: rows, columns
      integer :: pivots(size(P, 1)), n, r, step

      n = assembly%n
      r = size(assembly%v, 1)
      if (allocated(vector%x)) deallocate (vector%x, vector%D, vector%dD)
      if (allocated(vector%H)) deallocate (vector%H)
      allocate (vector%D(n), vector%dD(n))
      vector%form = assembly%form_at(root%s)
      call system_at(assembly, root, P, dP)
      call balance(P, rows, columns)
      call factor(P, pivots)
      z = 1
      do step = 1, 3
         ! By P itself, not by what is balanced: where next to nothing couples an oscillator with
         ! others its row is round-off at its root, and balanced it would be of order one.
         if (step > 1) z(:, 1) = matmul(dP, z(:, 1))
         call solve_balanced(P, pivots, rows, columns, z)
         z = z/maxval(abs(z))
      end do
      z = z/z(root%j, 1)
      vector%x = z(:n, 1)
      vector%y(:r) = z(n + 1:, 1)
      z(:, 1) = left_of(assembly, root%s, z(:, 1))
      vector%f(:r) = z(n + 1:, 1)
      vector%A = sum(z(:n, 1)*matmul(dP(:n, :n), vector%x)) &
         + sum(z(:n, 1)*matmul(dP(:n, n + 1:), vector%y(:r)))
      associate (pencil => assembly%pencil(vector%form), y => vector%y(:r))
         vector%inertia = sum(pencil%m*abs(vector%x)**2) &
            + real(sum(conjg(y)*matmul(pencil%hm, y)))
      end associate
   end subroutine find_whole_vector

   !> Derivatives with respect to every parameter of the assembly.
   !>
   !> slopes  (parameters)
   subroutine differentiate_vector(assembly, root, vector, slopes)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      type(vector_slope_t), intent(out) :: slopes(:)
      complex(wp), dimension(assembly%n + size(assembly%v, 1), assembly%n &
         + size(assembly%v, 1)) :: P, dP
      complex(wp) :: bordered(size(P, 1) + 1, size(P, 1) + 1), b(size(P, 1) + 1, size(slopes)), &
         pushed(assembly%n)
      complex(wp), dimension(size(assembly%v, 1), size(assembly%v, 1)) :: H, dH, H_p, dH_p
      integer :: pivots(size(P, 1) + 1), k, n, m, r

      n = assembly%n
      m = size(P, 1)
      r = m - n
      call system_at(assembly, root, P, dP)
      associate (s => root%s, pencil => assembly%pencil(vector%form), x => vector%x, &
         y => vector%y(:r), f => vector%f(:r), v => assembly%v, A => assembly%compliance)
         H = (pencil%hm*s + pencil%hc)*s + pencil%hk
         dH = 2*pencil%hm*s + pencil%hc
         bordered(:m, :m) = P
         bordered(:m, m + 1) = matmul(dP, [x, y])
         bordered(m + 1, :m) = matmul([x, f], dP)
         bordered(m + 1, m + 1) = 0
         b = 0
         do k = 1, size(slopes)
            b(:m, k) = -changed(assembly, root, vector, k)
         end do
         call factor(bordered, pivots)
         call solve(bordered, pivots, b, 'N')
         pushed = 2*matmul(dP(:n, :n), x)
         do k = 1, size(slopes)
            associate (by => slopes(k), slope => assembly%slope(vector%form, k), &
               A_p => assembly%compliance_slope(:, k))
               by%s = b(m + 1, k)
               by%x = b(:n, k)
               by%y = b(n + 1:m, k)
               H_p = (slope%hm*s + slope%hc)*s + slope%hk + dH*by%s
               dH_p = 2*(slope%hm*s + pencil%hm*by%s) + slope%hc
               by%f = matmul(H, by%y) + matmul(H_p, y)
               by%A = sum(by%x*pushed) &
                  + sum((2*(slope%m*s + pencil%m*by%s) + slope%c)*x**2) &
                  + sum((A_p*y + A*by%y)*matmul(dH, y)) &
                  + sum(A*y*(matmul(dH_p, y) + matmul(dH, by%y)))
               if (any(abs(assembly%dense_slope(:, :, 1, k)) > 0)) by%A = by%A + &
                  sum(x(:assembly%beam)*matmul(assembly%dense_slope(:, :, 1, k), &
                  x(:assembly%beam)))
            end associate
         end do
      end associate
   end subroutine differentiate_vector

   !> P_p (x, y), with parameter p of the assembly.
   function changed(assembly, root, vector, p) result(b)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(in) :: vector
      integer, intent(in) :: p
      complex(wp) :: b(assembly%n + size(assembly%v, 1))

      associate (s => root%s, slope => assembly%slope(vector%form, p), x => vector%x, &
         y => vector%y(:size(assembly%v, 1)), f => vector%f(:size(assembly%v, 1)), &
         v => assembly%v, v_p => assembly%v_slope, moves => assembly%moves(:, p), &
         n => assembly%n, beam => assembly%beam, dense => assembly%dense_slope(:, :, :, p))
         b(:n) = ((slope%m*s + slope%c)*s + slope%k)*x + matmul(moves*f, v_p) &
            + matmul(matmul((slope%hm*s + slope%hc)*s + slope%hk, y), v)
         if (any(abs(dense) > 0)) b(:beam) = b(:beam) + matmul(dense(:, :, 1)*s &
            + dense(:, :, 2), x(:beam))
         b(n + 1:) = moves*matmul(v_p, x) - assembly%compliance_slope(:, p)*y
      end associate
   end function changed

end module beamid_systems
