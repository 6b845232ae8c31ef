!> Starting points of the search for the roots of the characteristic equation, from the undamped
!> modes of the whole structure.
module beamid_starting_roots
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_assembly, only: assembly_t, root_t
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_lapack, only: dpotrf
   use beamid_oscillators, only: oscillators_t
   use beamid_quadratics, only: quadratic_roots
   use beamid_terms, only: of_stiffness
   use beamid_vectors, only: nearest_pole
   implicit none
   private

   public :: starting_points, leave_axis, solve_symmetric

   !> Largest relative distance from the real axis of a starting point of a root that may be real.
   real(wp), parameter, public :: nudge = 1e-3_wp

   interface
      subroutine dsygs2(itype, uplo, n, a, lda, b, ldb, info)
         import :: wp
         integer, intent(in) :: itype, n, lda, ldb
         character, intent(in) :: uplo
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(in) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dsygs2
      subroutine dsbevd(jobz, uplo, n, kd, ab, ldab, w, z, ldz, work, lwork, iwork, liwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, kd, ldab, ldz, lwork, liwork
         real(wp), intent(inout) :: ab(ldab, *)
         real(wp), intent(out) :: w(*), z(ldz, *), work(*)
         integer, intent(out) :: iwork(*), info
      end subroutine dsbevd
      subroutine dtrsm(side, uplo, transa, diag, m, n, alpha, a, lda, b, ldb)
         import :: wp
         character, intent(in) :: side, uplo, transa, diag
         integer, intent(in) :: m, n, lda, ldb
         real(wp), intent(in) :: alpha, a(lda, *)
         real(wp), intent(inout) :: b(ldb, *)
      end subroutine dtrsm
   end interface

contains

   !> Computes a starting point for every root.
   !>
   !> The starting points are the roots of the undamped modes with their modal damping. The slow
   !> roots of strongly overdamped modes, which accumulate at -E/c_D, come from `slow_roots`. Real
   !> points are moved off the real axis, because two real points may have to become a pair.
   !>
   !> roots  one of each pair (complex or real) in the first half, the other one half the size
   !>        further
   !> error  the mass matrix is not positive definite, or the user has interrupted
   subroutine starting_points(assembly, roots, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(assembly%layout%n, assembly%layout%n) :: M, C, K
      real(wp) :: lambda(assembly%layout%n), slow(assembly%layout%n)
      complex(wp) :: pair(2)
      integer :: half, j, next, side

      call assembly%full_matrices(limited_compliance(assembly), M, C, K)
      call slow_roots(assembly, M, C, K, slow)
      call check_interrupt(error)
      if (allocated(error)) return
      call solve_symmetric(K, M, lambda, error)
      if (.not. allocated(error)) call check_interrupt(error)
      if (allocated(error)) return
      half = assembly%roots()/2
      next = size(slow)
      allocate (roots(2*half))
      do j = half, 1, -1
         pair = quadratic_roots(1.0_wp, dot_product(K(:, j), matmul(C, K(:, j))), &
            max(lambda(j), 0.0_wp))
         if (assembly%oscillators%relaxation%n > 0) pair = relaxed_pair(assembly%oscillators, &
            pair, K(:, j), dot_product(K(:, j), matmul(C, K(:, j))), lambda(j))
         if (abs(aimag(pair(1))) <= 0 .and. slow(next) < 0 .and. &
            abs(real(pair(1)) - slow(next)) < -0.1_wp*slow(next)) then
            pair(1) = slow(next)
            next = next - 1
         end if
         do side = 1, 2
            roots(j + (side - 1)*half)%s = pair(side)
            call leave_axis(assembly, side, roots(j + (side - 1)*half))
         end do
         ! An oscillator with a strong response of its own need not take part in the mode: symmetric
         ! modes of a symmetric structure contain no antisymmetric oscillator. Newton's method
         ! follows the first root of a pair.
         if (abs(aimag(pair(1))) > 0) roots(j)%j = &
            maxloc(assembly%oscillators%m*K(:, j)**2, dim=1)
      end do
   end subroutine starting_points

   !> Returns the pair of roots of an undamped mode with modal damping and relaxations, by Newton's
   !> method for s**2 + c s + k + sum of r_l s/(s + b_l); or the pair without relaxations, if there
   !> is no such pair.
   !>
   !> pair   without relaxations [1/time]
   !> x      (n) the mode, with unit modal mass
   !> c, k   modal damping and stiffness
   pure function relaxed_pair(oscillators, pair, x, c, k) result(relaxed)
      type(oscillators_t), intent(in) :: oscillators
      complex(wp), intent(in) :: pair(2)
      real(wp), intent(in) :: x(:), c, k
      complex(wp) :: relaxed(2), s, past(oscillators%relaxation%n)
      real(wp) :: r(size(past))
      integer :: i

      associate (b => oscillators%relaxation%rate(:size(past)))
         r = matmul(x**2, oscillators%relaxed)
         ! Fast modes have the stiffness of a modulus that does not relax.
         s = (0, 1)*sqrt(max(k + sum(r*max(k, 0.0_wp)/(max(k, 0.0_wp) + b**2)), 0.0_wp))
         do i = 1, 20
            past = s + b
            s = s - ((s + c)*s + k + sum(r*s/past))/(2*s + c + sum(r*b/past**2))
         end do
      end associate
      relaxed = pair
      if (.not. (aimag(s) > nudge*abs(s) .and. ieee_is_finite(abs(s)))) return
      relaxed = [s, conjg(s)]
   end function relaxed_pair

   !> Moves a real starting point off the real axis and stores it relative to the nearest pole; a
   !> complex point keeps its position.
   !>
   !> side  1: upwards, 2: downwards
   subroutine leave_axis(assembly, side, root)
      type(assembly_t), intent(in) :: assembly
      integer, intent(in) :: side
      type(root_t), intent(inout) :: root

      if (.not. abs(aimag(root%s)) > 0) root%s = root%s &
         + (0.0_wp, 1.0_wp)*nudge*(3 - 2*side)*axis_scale(assembly%oscillators, root%s)
      root%origin = 0
      call nearest_pole(assembly, root)
   end subroutine leave_axis

   !> Computes the slow roots of overdamped modes, near -E/c_D.
   !>
   !> Near -E/c_D the inertia is that at -E/c_D. With s = -E/c_D + epsilon/c_D, the bending
   !> stiffness B per unit of E, and the stiffness K_rest without bending, the vectors are those of
   !> (s**2 M + K_rest) x = -epsilon B x.
   !>
   !> M, C, K  (n, n) matrices of `full_matrices`
   !> slow     (n) roots, the nearest to -E/c_D last [1/time]; 0: the mode is not overdamped, or no
   !>          mode of the bare beam is
   subroutine slow_roots(assembly, M, C, K, slow)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: M(:, :), C(:, :), K(:, :)
      real(wp), intent(out) :: slow(:)
      real(wp), dimension(size(slow), size(slow)) :: x, rest
      real(wp) :: theta(size(slow))
      complex(wp) :: pair(2)
      type(error_t), allocatable :: error
      integer :: i

      slow = 0
      associate (of => assembly%oscillators, beam => assembly%layout%beam)
         if (all(abs(aimag(of%pole(:beam, 1))) > 0) .or. .not. of%c_D > 0) return
         x = 0
         rest = (of%E/of%c_D)**2*M + K
         do i = 1, beam
            x(i, i) = of%k(i)/of%E
            rest(i, i) = rest(i, i) - of%k(i)
         end do
         call solve_symmetric(x, rest, theta, error)
         if (allocated(error)) return
         do i = 1, size(slow)
            pair = quadratic_roots(dot_product(x(:, i), matmul(M, x(:, i))), &
               dot_product(x(:, i), matmul(C, x(:, i))), &
               max(dot_product(x(:, i), matmul(K, x(:, i))), 0.0_wp))
            if (abs(aimag(pair(1))) <= 0) slow(i) = real(pair(1))
         end do
      end associate
   end subroutine slow_roots

   !> Solves K x = lambda M x by LAPACK.
   !>
   !> DSYGVD does not serve: OpenBLAS distributes the work of its DSYMV among threads even if there
   !> is little of it, and on a busy machine it then waits a hundred times as long as it works. The
   !> reduction of a band matrix to tridiagonal form uses no threads.
   !>
   !> K       (n, n) in: K; out: columns x with x'M x = 1
   !> M       (n, n) in: M; out: its Cholesky factor
   !> lambda  (n) eigenvalues, ascending
   !> error   the mass matrix is not positive definite, or an entry is not finite
   subroutine solve_symmetric(K, M, lambda, error)
      real(wp), intent(inout) :: K(:, :), M(:, :)
      real(wp), intent(out) :: lambda(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: work(1 + 5*size(lambda) + 2*size(lambda)**2), band(size(lambda), size(lambda))
      integer :: iwork(3 + 5*size(lambda)), info, j, n

      n = size(lambda)
      call dpotrf('L', n, M, n, info)
      if (info == 0) call dsygs2(1, 'L', n, K, n, M, n, info)
      do j = 1, n
         band(:n - j + 1, j) = K(j:, j)
      end do
      ! LAPACK may stop the program if an entry is not finite.
      if (.not. all(ieee_is_finite(K))) info = 1
      if (info == 0) call dsbevd('V', 'L', n, n - 1, band, n, lambda, K, n, work, size(work), &
         iwork, size(iwork), info)
      if (info == 0) call dtrsm('L', 'L', 'T', 'N', n, n, 1.0_wp, M, n, K, n)
      if (info /= 0) call failure(error, 'modal: mass matrix is not positive definite')
   end subroutine solve_symmetric

   !> Returns the distance by which a real point may be moved, up to a factor [1/time]. The roots of
   !> overdamped modes are the denser, the closer they are to -E/c_D.
   pure real(wp) function axis_scale(oscillators, s)
      type(oscillators_t), intent(in) :: oscillators
      complex(wp), intent(in) :: s

      axis_scale = abs(s)
      associate (E => oscillators%E, c_D => oscillators%c_D)
         if (c_D > 0) axis_scale = min(axis_scale, abs(s + E/c_D))
      end associate
   end function axis_scale

   !> Returns the diagonal of A, (r), in which the compliance of a very stiff spring is replaced by
   !> one that leaves M, C and K a few digits.
   pure function limited_compliance(assembly) result(compliance)
      type(assembly_t), intent(in) :: assembly
      real(wp) :: compliance(size(assembly%couplings%compliance))
      real(wp), parameter :: largest_ratio = 1e4_wp   ! of a spring to the beam's stiffness
      integer :: i

      compliance = assembly%couplings%compliance
      do i = 1, size(compliance)
         if (compliance(i) < 1) compliance(i) = max(compliance(i), &
            sum(assembly%layout%v(i, :)**2)*assembly%couplings%h(of_stiffness, i, i) &
            /(largest_ratio*maxval(assembly%oscillators%k)))
      end do
   end function limited_compliance

end module beamid_starting_roots
