!> The equations at s as one full matrix, for a dense assembly, in which a term couples all
!> oscillators. With E(s) of `beamid_dense_terms` and the row forces f = H y:
!>
!>     P(s) (x, y) = (F, -base_coupling/s**2),    P = [ D + E   V H ]
!>                                                    [   V'     -A ]
!>
!> At a root, P (x, y) = 0 and (x, f)'P = 0.
module beamid_systems
   use beamid_assembly, only: assembly_t, changes, root_t
   use beamid_kinds, only: wp
   use beamid_vectors, only: allocate_vector, find_vector, nearest_pole, vector_t
   implicit none
   private

   public :: system_at, improve_root, find_eigenvector, solve_adjoint, factor, solve, &
      factor_balanced, solve_balanced

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
      complex(wp), dimension(assembly%layout%r, assembly%layout%r) :: H, dH
      complex(wp) :: D(assembly%layout%n), dD(assembly%layout%n), f(changes, 0:2)
      integer :: i, k, n

      n = assembly%layout%n
      P = 0
      dP = 0
      associate (s => point%s, b => assembly%layout%beam)
         if (assembly%is_dense()) then
            f = assembly%oscillators%factors(point)
            P(:b, :b) = assembly%dense%at(f(:, 0), 0)
            dP(:b, :b) = assembly%dense%at(f(:, 1), 0)
         end if
         call assembly%oscillators%denominators(point, D, dD)
         do i = 1, n
            P(i, i) = P(i, i) + D(i)
            dP(i, i) = dP(i, i) + dD(i)
         end do
         call assembly%couplings%evaluate(assembly%couplings%form_at(s), s, H, dH)
         P(:n, n + 1:) = matmul(assembly%layout%vt, H)
         dP(:n, n + 1:) = matmul(assembly%layout%vt, dH)
         P(n + 1:, :n) = assembly%layout%v
         do k = 1, size(H, 1)
            P(n + k, n + k) = -assembly%couplings%compliance(k)
         end do
      end associate
   end subroutine system_at

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
      complex(wp), dimension(assembly%layout%n + assembly%layout%r, &
         assembly%layout%n + assembly%layout%r) :: P, dP
      complex(wp), dimension(assembly%layout%r, assembly%layout%r) :: H, dH
      complex(wp) :: z(size(P, 1), 1), rhs(size(P, 1)), left(size(P, 1)), change
      real(wp), dimension(size(P, 1)) :: rows, columns
      real(wp) :: largest
      integer :: pivots(size(P, 1)), step, n

      n = assembly%layout%n
      z = 1
      do step = 1, max_steps
         call system_at(assembly, root, P, dP)
         if (step > 1) z(:, 1) = matmul(dP, z(:, 1))
         rhs = z(:, 1)
         call factor_balanced(P, pivots, rows, columns)
         call solve_balanced(P, pivots, rows, columns, z)
         largest = maxval(abs(z))
         rhs = rhs/largest
         z = z/largest
         ! The left eigenvector is (x, f).
         call assembly%couplings%evaluate(assembly%couplings%form_at(root%s), root%s, H, dH)
         left = [z(:n, 1), matmul(H, z(n + 1:, 1))]
         change = -sum(left*rhs)/sum(left*matmul(dP, z(:, 1)))
         if (.not. abs(aimag(root%s)) > 0) change = real(change)
         if (step == 1) cycle
         root%s = root%s + change
         root%offset = root%offset + change
         if (abs(change) > 1e-2_wp*abs(root%offset) .and. root%side <= 2) &
            call nearest_pole(assembly, root)
         if (abs(change) <= tolerance*max(abs(root%offset), tolerance*abs(root%s))) exit
      end do
      root%j = maxloc(assembly%oscillators%m*abs(z(:n, 1))**2, dim=1)
   end subroutine improve_root

   !> Scales rows and columns of P to a largest entry of about 1, by powers of two, and computes the
   !> LU factors. Round-off then counts relative to the entries of the same kind, oscillator or
   !> attachment.
   !>
   !> P              in: the matrix; out: the factors of the scaled matrix
   !> pivots         (size of P) row interchanges
   !> rows, columns  (size of P) scales
   subroutine factor_balanced(P, pivots, rows, columns)
      complex(wp), intent(inout) :: P(:, :)
      integer, intent(out) :: pivots(:)
      real(wp), intent(out) :: rows(:), columns(:)
      integer :: k

      rows = 0
      do k = 1, size(columns)
         rows = max(rows, abs(real(P(:, k))) + abs(aimag(P(:, k))))
      end do
      rows = scale(1.0_wp, -exponent(rows))
      do k = 1, size(columns)
         P(:, k) = rows*P(:, k)
         columns(k) = scale(1.0_wp, -exponent(maxval(abs(real(P(:, k))) + abs(aimag(P(:, k))))))
         P(:, k) = columns(k)*P(:, k)
      end do
      call factor(P, pivots)
   end subroutine factor_balanced

   !> Solves P x = z by the factors of the balanced matrix.
   !>
   !> P, pivots, rows, columns  from `factor_balanced`
   !> z                         (size of P, :) in: right-hand sides; out: solutions
   subroutine solve_balanced(P, pivots, rows, columns, z)
      complex(wp), intent(in) :: P(:, :)
      integer, intent(in) :: pivots(:)
      real(wp), intent(in) :: rows(:), columns(:)
      complex(wp), intent(inout) :: z(:, :)
      integer :: k

      do k = 1, size(z, 2)
         z(:, k) = rows*z(:, k)
      end do
      call solve(P, pivots, z, 'N')
      do k = 1, size(z, 2)
         z(:, k) = columns*z(:, k)
      end do
   end subroutine solve_balanced

   !> Computes the eigenvector of a root.
   !>
   !> root    the root, with j, origin and offset as `nearest_pole` sets them
   !> vector  in: arrays to be reused, of any shape; out: the vector
   subroutine find_eigenvector(assembly, root, vector)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(inout) :: vector

      if (assembly%is_dense()) then
         call iterate_inversely(assembly, root, vector)
      else
         call find_vector(assembly, root, vector)
      end if
   end subroutine find_eigenvector

   !> Computes the eigenvector of a root by inverse iteration, with x_j = 1. Sets all components of
   !> `vector_t` except 1/D and G.
   subroutine iterate_inversely(assembly, root, vector)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      type(vector_t), intent(inout) :: vector
      complex(wp), dimension(assembly%layout%n + assembly%layout%r, &
         assembly%layout%n + assembly%layout%r) :: P, dP
      complex(wp) :: z(size(P, 1), 1)
      real(wp), dimension(size(P, 1)) :: rows, columns
      integer :: pivots(size(P, 1)), n, r, step

      n = assembly%layout%n
      r = assembly%layout%r
      call allocate_vector(n, r, vector)
      vector%form = assembly%couplings%form_at(root%s)
      call system_at(assembly, root, P, dP)
      call factor_balanced(P, pivots, rows, columns)
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
      vector%y = z(n + 1:, 1)
      vector%A = sum(vector%x*matmul(dP(:n, :), z(:, 1)))
      associate (m => assembly%oscillators%m, y => vector%y)
         call assembly%couplings%evaluate(vector%form, root%s, vector%H, vector%dH, vector%half_d2H)
         vector%f = matmul(vector%H, y)
         call assembly%oscillators%denominators(root, vector%D, vector%dD)
         vector%inertia = sum(m*abs(vector%x)**2) &
            + real(sum(conjg(y)*matmul(vector%half_d2H, y)))
      end associate
   end subroutine iterate_inversely

   !> Computes the motion z of the oscillators, with z_j = 0, and w of the rows under given forces
   !> at a root: P (z, w) = (f + V'g, -u) without the equation of oscillator j.
   !>
   !> f  (n) forces on the oscillators
   !> g  (r) forces along the rows
   !> u  (r) prescribed motion of the rows, in addition to that of the oscillators
   subroutine solve_adjoint(assembly, root, f, g, u, z, w)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root
      complex(wp), intent(in) :: f(:), g(:), u(:)
      complex(wp), intent(out) :: z(:), w(:)
      complex(wp), dimension(size(f) + size(g), size(f) + size(g)) :: P, dP
      complex(wp) :: solution(size(P, 1), 1)
      integer :: pivots(size(P, 1))

      call system_at(assembly, root, P, dP)
      P(root%j, :) = 0
      P(:, root%j) = 0
      P(root%j, root%j) = 1
      solution(:, 1) = [f + matmul(assembly%layout%vt, g), -u]
      solution(root%j, 1) = 0
      call factor(P, pivots)
      call solve(P, pivots, solution, 'N')
      z = solution(:size(f), 1)
      w = solution(size(f) + 1:, 1)
   end subroutine solve_adjoint

end module beamid_systems
