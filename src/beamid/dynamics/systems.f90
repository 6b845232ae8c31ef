!> The equations at s as one full matrix, for a dense assembly, in which a term couples all
!> oscillators. With E(s) of `beamid_assembly` and the row forces f = H y:
!>
!>     P(s) (x, y) = (F, -base_coupling/s**2),    P = [ D + E   V H ]
!>                                                    [   V'     -A ]
!>
!> At a root, P (x, y) = 0 and (x, f)'P = 0. Therefore ds/dp = -(x, f)'P_p (x, y)/A with A = (x,
!> f)'P_s (x, y), where the indices p and s denote partial derivatives. The derivative of the
!> eigenvector solves the bordered system
!>
!>     P (x, y)_p + P_s (x, y) ds/dp = -P_p (x, y),    (x, f)'P_s (x, y)_p = 0.
module beamid_systems
   use beamid_assembly, only: assembly_t, pencil_t
   use beamid_kinds, only: wp
   use beamid_vectors, only: nearest_pole, root_t, vector_t
   implicit none
   private

   public :: system_at, improve_root, find_whole_vector, differentiate_vector, vector_slope_t, &
      factor, solve

   !> Derivatives of a root and its eigenvector with respect to one parameter.
   type :: vector_slope_t
      complex(wp) :: s = 0                    !< of the root [1/time]
      !> (n), (r), (r) of the oscillators, the rows and their forces
      complex(wp), allocatable :: x(:), y(:), f(:)
      complex(wp) :: A = 0   !< of A = x'(2 s M + C) x
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

   !> Computes P(s) and P'(s).
   !>
   !> point  s, given by its distance from a pole of an oscillator, which keeps the digits of D(s)
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
         P(:n, n + 1:) = matmul(transpose(v), couplings(pencil, s))
         dP(:n, n + 1:) = matmul(transpose(v), couplings_slope(pencil, s))
         P(n + 1:, :n) = v
         do k = 1, r
            P(n + k, n + k) = -assembly%compliance(k)
         end do
      end associate
   end subroutine system_at

   !> Returns H(s), (r, r).
   pure function couplings(pencil, s) result(H)
      type(pencil_t), intent(in) :: pencil
      complex(wp), intent(in) :: s
      complex(wp) :: H(size(pencil%hm, 1), size(pencil%hm, 2))

      H = (pencil%hm*s + pencil%hc)*s + pencil%hk
   end function couplings

   !> Returns H'(s), (r, r).
   pure function couplings_slope(pencil, s) result(dH)
      type(pencil_t), intent(in) :: pencil
      complex(wp), intent(in) :: s
      complex(wp) :: dH(size(pencil%hm, 1), size(pencil%hm, 2))

      dH = 2*pencil%hm*s + pencil%hc
   end function couplings_slope

   !> Computes the LU factors of P for `solve`. A pivot that vanishes, as it may at a root, is
   !> replaced by a tiny number, as inverse iteration requires. The number is far below round-off,
   !> because the round-off of a row or column may be smaller than that of P.
   !>
   !> P       in: the matrix; out: its factors
   !> pivots  (size of P) row interchanges
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

   !> Solves P x = b, or P'x = b, by the LU factors.
   !>
   !> P, pivots  from `factor`
   !> b          (size of P, columns) in: right-hand sides; out: solutions
   !> side       'N': P; 'T': P'
   subroutine solve(P, pivots, b, side)
      complex(wp), intent(in) :: P(:, :)
      integer, intent(in) :: pivots(:)
      complex(wp), intent(inout) :: b(:, :)
      character, intent(in) :: side
      integer :: info

      call zgetrs(side, size(pivots), size(b, 2), P, size(pivots), pivots, b, size(pivots), info)
   end subroutine solve

   !> Improves a root by inverse iteration, with the Rayleigh quotient in each step. Q is quadratic
   !> in s, so the error after the last step is the square of the last change. A multiple root of
   !> order k is accurate only to the k-th root of round-off.
   !>
   !> root  in: a point near the root; out: the root, and the oscillator with the largest modal mass
   subroutine improve_root(assembly, root)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: root
      integer, parameter :: max_steps = 20
      real(wp), parameter :: tolerance = 3e-8_wp
      complex(wp), dimension(assembly%n + size(assembly%v, 1), assembly%n &
         + size(assembly%v, 1)) :: P, dP
      complex(wp) :: z(size(P, 1), 1), rhs(size(P, 1)), left(size(P, 1)), change
      real(wp), dimension(size(P, 1)) :: rows, columns
      integer :: pivots(size(P, 1)), step, n

      n = assembly%n
      z = 1
      do step = 1, max_steps
         call system_at(assembly, root, P, dP)
         if (step > 1) z(:, 1) = matmul(dP, z(:, 1))
         rhs = z(:, 1)
         call balance(P, rows, columns)
         call factor(P, pivots)
         call solve_balanced(P, pivots, rows, columns, z)
         rhs = rhs/maxval(abs(z))
         z = z/maxval(abs(z))
         left = left_vector(assembly, root%s, z(:, 1))
         change = -sum(left*rhs)/sum(left*matmul(dP, z(:, 1)))
         if (.not. abs(aimag(root%s)) > 0) change = real(change)
         if (step == 1) cycle
         root%s = root%s + change
         root%offset = root%offset + change
         if (abs(change) > 1e-2_wp*abs(root%offset)) call nearest_pole(assembly, root)
         if (abs(change) <= tolerance*max(abs(root%offset), tolerance*abs(root%s))) exit
      end do
      root%j = maxloc(assembly%pencil(1)%m*abs(z(:n, 1))**2, dim=1)
   end subroutine improve_root

   !> Scales rows and columns of P to a largest entry of about 1, by powers of two. Round-off then
   !> counts relative to the entries of the same kind, oscillator or attachment.
   !>
   !> P              in and out
   !> rows, columns  (size of P) the factors
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

   !> Solves P x = z by the factors of the balanced matrix.
   !>
   !> P, pivots      from `factor`
   !> rows, columns  from `balance`
   !> z              (size of P, 1) in: right-hand side; out: solution
   subroutine solve_balanced(P, pivots, rows, columns, z)
      complex(wp), intent(in) :: P(:, :)
      integer, intent(in) :: pivots(:)
      real(wp), intent(in) :: rows(:), columns(:)
      complex(wp), intent(inout) :: z(:, :)

      z(:, 1) = rows*z(:, 1)
      call solve(P, pivots, z, 'N')
      z(:, 1) = columns*z(:, 1)
   end subroutine solve_balanced

   !> Returns the left eigenvector (x, f) of the right eigenvector (x, y).
   !>
   !> s  the root [1/time]
   !> z  (n + r) right eigenvector
   pure function left_vector(assembly, s, z) result(left)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s, z(:)
      complex(wp) :: left(size(z))

      left = z
      left(assembly%n + 1:) = matmul(couplings(assembly%pencil(assembly%form_at(s)), s), &
         z(assembly%n + 1:))
   end function left_vector

   !> Computes the eigenvector of a root by inverse iteration, with x_j = 1. Sets all components of
   !> `vector_t` except those that need D without E.
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
         ! The iteration is that of P, not of the balanced matrix. If an oscillator is hardly
         ! coupled with others, its row of P is round-off at its root; balanced, it would be of
         ! order one.
         if (step > 1) z(:, 1) = matmul(dP, z(:, 1))
         call solve_balanced(P, pivots, rows, columns, z)
         z = z/maxval(abs(z))
      end do
      z = z/z(root%j, 1)
      vector%x = z(:n, 1)
      vector%y(:r) = z(n + 1:, 1)
      z(:, 1) = left_vector(assembly, root%s, z(:, 1))
      vector%f(:r) = z(n + 1:, 1)
      vector%A = sum(z(:n, 1)*matmul(dP(:n, :n), vector%x)) &
         + sum(z(:n, 1)*matmul(dP(:n, n + 1:), vector%y(:r)))
      associate (pencil => assembly%pencil(vector%form), y => vector%y(:r))
         vector%inertia = sum(pencil%m*abs(vector%x)**2) &
            + real(sum(conjg(y)*matmul(pencil%hm, y)))
      end associate
   end subroutine find_whole_vector

   !> Computes the derivatives of a root and its eigenvector with respect to every parameter of the
   !> assembly, by the bordered system.
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
         dA_dx(assembly%n)
      complex(wp), dimension(size(assembly%v, 1), size(assembly%v, 1)) :: H, dH, H_p, dH_p
      integer :: pivots(size(P, 1) + 1), k, n, m, r

      n = assembly%n
      m = size(P, 1)
      r = m - n
      call system_at(assembly, root, P, dP)
      associate (s => root%s, pencil => assembly%pencil(vector%form), x => vector%x, &
         y => vector%y(:r), f => vector%f(:r), A => assembly%compliance)
         H = couplings(pencil, s)
         dH = couplings_slope(pencil, s)
         bordered(:m, :m) = P
         bordered(:m, m + 1) = matmul(dP, [x, y])
         bordered(m + 1, :m) = matmul([x, f], dP)
         bordered(m + 1, m + 1) = 0
         b = 0
         do k = 1, size(slopes)
            b(:m, k) = -system_change(assembly, root, vector, k)
         end do
         call factor(bordered, pivots)
         call solve(bordered, pivots, b, 'N')
         dA_dx = 2*matmul(dP(:n, :n), x)
         do k = 1, size(slopes)
            associate (by => slopes(k), slope => assembly%slope(vector%form, k), &
               A_p => assembly%compliance_slope(:, k))
               by%s = b(m + 1, k)
               by%x = b(:n, k)
               by%y = b(n + 1:m, k)
               H_p = couplings(slope, s) + dH*by%s
               dH_p = 2*(slope%hm*s + pencil%hm*by%s) + slope%hc
               by%f = matmul(H, by%y) + matmul(H_p, y)
               by%A = sum(by%x*dA_dx) &
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

   !> Returns P_p (x, y), the change of the equations with a parameter at constant s and (x, y).
   !>
   !> p  index of the parameter
   !> b  (n + r)
   function system_change(assembly, root, vector, p) result(b)
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
            + matmul(matmul(couplings(slope, s), y), v)
         if (any(abs(dense) > 0)) b(:beam) = b(:beam) + matmul(dense(:, :, 1)*s &
            + dense(:, :, 2), x(:beam))
         b(n + 1:) = moves*matmul(v_p, x) - assembly%compliance_slope(:, p)*y
      end associate
   end function system_change

end module beamid_systems
