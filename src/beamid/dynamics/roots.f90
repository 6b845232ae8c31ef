!> Roots of the characteristic equation of the damped structure, all at once by the Ehrlich-Aberth
!> iteration from those of its parts (Aberth, Math. Comp. 27, 1973, 339).
module beamid_roots
   use beamid_assembly, only: assembly_t, new_assembly, quadratic
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_strings, only: to_text
   use beamid_terms, only: bending, of_damping, of_stiffness
   use beamid_vectors, only: logarithmic_derivative, nearest_pole, root_t
   implicit none
   private

   public :: find_roots, damped_roots

   !> Sweeps at most, and those within which a root that has not arrived must come nearer.
   integer, parameter :: max_sweeps = 1000, patience = 20
   !> Relative to the largest, a root at 0: that of a hose which only its dashpot holds. There the
   !> relative corrections do not shrink; and squares of anything smaller would underflow.
   real(wp), parameter :: nothing = 1e-60_wp

   interface
      subroutine dpotrf(uplo, n, a, lda, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: info
      end subroutine dpotrf
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

   !> Roots s of (s**2 M + s C + K) x = 0.
   !>
   !> roots  complex pairs once, Im s > 0; real roots each; ascending |s| [1/time]
   subroutine damped_roots(equations, roots, error)
      type(equations_t), intent(in) :: equations
      complex(wp), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      type(beam_modes_t) :: modes
      type(root_t), allocatable :: all(:), half(:)

      call bare_beam_modes(equations%galerkin, modes, error)
      if (allocated(error)) return
      associate (structure => equations%structure)
         call find_roots(new_assembly(structure, modes, [integer ::]), all, half, error)
         if (allocated(error)) return
         roots = half%s
         ! A hose that nothing holds is free to drift: a root that the tip does not see.
         if (structure%has_hose() .and. .not. (structure%k_H > 0 .or. structure%c_H > 0)) &
            roots = [roots, (0.0_wp, 0.0_wp)]
      end associate
      call sort_by_modulus(roots)
   end subroutine damped_roots

   !> Ascending |s|, by insertion.
   pure subroutine sort_by_modulus(roots)
      complex(wp), intent(inout) :: roots(:)
      complex(wp) :: root
      integer :: i, j

      do i = 2, size(roots)
         root = roots(i)
         do j = i - 1, 1, -1
            if (abs(roots(j)) <= abs(root)) exit
            roots(j + 1) = roots(j)
         end do
         roots(j + 1) = root
      end do
   end subroutine sort_by_modulus

   !> All roots, and one of each complex pair with the real ones.
   !>
   !> all    in and out: roots of a structure much like this one, where there are as many; else not
   !>        allocated or of another size, and the search starts from the structure's parts
   subroutine find_roots(assembly, all, half, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), allocatable, intent(inout) :: all(:)
      type(root_t), allocatable, intent(out) :: half(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      if (allocated(all)) then
         if (size(all) /= assembly%roots()) deallocate (all)
      end if
      if (allocated(all)) then
         do k = 1, size(all)
            all(k)%origin = 0
            call nearest_pole(assembly, all(k))
         end do
      else
         call starting_points(assembly, all, error)
         if (allocated(error)) return
      end if
      call iterate(assembly, all, error)
      if (allocated(error)) return
      half = all
      call select_half(assembly, half)
   end subroutine find_roots

   !> Undamped modes of the whole, each with the damping that it sees; the slow roots of overdamped
   !> ones where they pile up. Off the real axis, since two real roots may have to become a pair.
   subroutine starting_points(assembly, roots, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), dimension(assembly%n, assembly%n) :: M, C, K
      real(wp) :: lambda(assembly%n), piled(assembly%n)
      complex(wp) :: pair(2)
      integer :: half, j, next, side

      call full_matrices(assembly, M, C, K)
      call slow_roots(assembly, M, C, K, piled)
      call solve_symmetric(K, M, lambda, error)
      if (allocated(error)) return
      half = assembly%roots()/2
      next = size(piled)
      allocate (roots(2*half))
      do j = half, 1, -1
         pair = quadratic(1.0_wp, dot_product(K(:, j), matmul(C, K(:, j))), max(lambda(j), 0.0_wp))
         if (abs(aimag(pair(1))) <= 0 .and. piled(next) < 0 .and. &
            abs(real(pair(1)) - piled(next)) < -0.1_wp*piled(next)) then
            pair(1) = piled(next)
            next = next - 1
         end if
         do side = 1, 2
            associate (root => roots(j + (side - 1)*half))
               root%s = pair(side)
               if (.not. abs(aimag(root%s)) > 0) root%s = root%s &
                  + (0.0_wp, 1e-3_wp)*(3 - 2*side)*room(assembly, root%s)
               root%origin = 0
               call nearest_pole(assembly, root)
            end associate
         end do
      end do
   end subroutine starting_points

   !> Slow roots of overdamped modes, near -E/c_D: there the inertia is that at -E/c_D, and with
   !> s = -E/c_D + epsilon/c_D and B the bending stiffness per unit of E the vectors are those of
   !> (s**2 M + K_rest) x = -epsilon B x, K_rest the stiffness but for bending.
   !>
   !> slow  (n) the nearest to -E/c_D last; 0: no Kelvin-Voigt damping
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
      associate (c_D => assembly%strength(bending, of_damping), p => assembly%pencil(1), &
         E => assembly%strength(bending, of_stiffness))
         if (.not. c_D > 0) return
         x = 0
         rest = (E/c_D)**2*M + K
         do i = 1, assembly%beam
            x(i, i) = p%k(i)/E
            rest(i, i) = rest(i, i) - p%k(i)
         end do
         call solve_symmetric(x, rest, theta, error)
         if (allocated(error)) return
         do i = 1, size(slow)
            pair = quadratic(dot_product(x(:, i), matmul(M, x(:, i))), &
               dot_product(x(:, i), matmul(C, x(:, i))), &
               max(dot_product(x(:, i), matmul(K, x(:, i))), 0.0_wp))
            if (abs(aimag(pair(1))) <= 0) slow(i) = real(pair(1))
         end do
      end associate
   end subroutine slow_roots

   !> K x = lambda M x by LAPACK; the vectors, x'M x = 1, stand in K afterwards. Not by DSYGVD:
   !> OpenBLAS shares the work of its DSYMV among threads however little there is, and where others
   !> want the processors too it waits for them, a hundred times as long as it works. A band matrix
   !> is made tridiagonal without.
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
      if (info == 0) call dsbevd('V', 'L', n, n - 1, band, n, lambda, K, n, work, size(work), &
         iwork, size(iwork), info)
      if (info == 0) call dtrsm('L', 'L', 'T', 'N', n, n, 1.0_wp, M, n, K, n)
      if (info /= 0) call failure(error, 'modal: mass matrix is not positive definite')
   end subroutine solve_symmetric

   !> How far a slow real root may be moved: those of overdamped modes lie the more densely the
   !> nearer they are to -E/c_D.
   pure real(wp) function room(assembly, s)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s

      room = abs(s)
      associate (k => assembly%strength(bending, of_stiffness), &
         c => assembly%strength(bending, of_damping))
         if (c > 0) room = min(room, abs(s + k/c))
      end associate
   end function room

   !> M, C and K in the oscillators, to a few digits: a spring that is rigid is a very stiff one.
   pure subroutine full_matrices(assembly, M, C, K)
      type(assembly_t), intent(in) :: assembly
      real(wp), dimension(:, :), intent(out) :: M, C, K
      real(wp), parameter :: stiffest = 1e4_wp
      real(wp) :: least
      integer :: i, r

      associate (p => assembly%pencil(1), v => assembly%v, A => assembly%compliance)
         r = size(v, 1)
         M = matmul(matmul(transpose(v), p%hm), v)
         C = 0
         K = 0
         do i = 1, r
            least = sum(v(i, :)**2)*p%hk(i, i)/(stiffest*maxval(p%k))
            C = C + outer(matmul(p%hc(i, :), v)/max(A(i), merge(least, 1.0_wp, A(i) < 1)), v(i, :))
            K = K + outer(matmul(p%hk(i, :), v)/max(A(i), merge(least, 1.0_wp, A(i) < 1)), v(i, :))
         end do
         do i = 1, assembly%n
            M(i, i) = M(i, i) + p%m(i)
            C(i, i) = C(i, i) + p%c(i)
            K(i, i) = K(i, i) + p%k(i)
         end do
      end associate
   end subroutine full_matrices

   pure function outer(x, y)
      real(wp), intent(in) :: x(:), y(:)
      real(wp) :: outer(size(x), size(y))

      outer = spread(x, 2, size(y))*spread(y, 1, size(x))
   end function outer

   !> Ehrlich-Aberth: corrections in turn until none moves. A multiple root is known to a root of
   !> the round-off only: there the corrections shrink first and then no longer.
   subroutine iterate(assembly, roots, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: done(size(roots)), settled(size(roots))
      real(wp) :: moved(size(roots)), before(size(roots)), least
      integer :: half, k, sweep

      half = size(roots)/2
      if (assembly%is_bare()) then
         do k = 1, size(roots)
            roots(k)%j = modulo(k - 1, assembly%n) + 1
            roots(k)%origin = roots(k)%j
            roots(k)%side = 1 + (k - 1)/assembly%n
            roots(k)%offset = 0
            roots(k)%s = assembly%pole(roots(k)%origin, roots(k)%side)
         end do
         return
      end if
      done = .false.
      before = huge(before)
      least = nothing*maxval(abs(roots%s))
      do sweep = 1, max_sweeps
         do k = 1, size(roots)
            if (done(k)) cycle
            call correct(assembly, roots, k, moved(k))
            ! Convergence is quadratic at least, but for multiple roots.
            settled(k) = moved(k) <= 1e-10_wp*abs(roots(k)%offset)
            done(k) = moved(k) <= 1e-6_wp*max(abs(roots(k)%offset), 1e-14_wp*abs(roots(k)%s)) &
               .or. abs(roots(k)%s) <= least
            ! Its mirror image has arrived when it has.
            if (k <= half .and. .not. done(k)) done(k + half) = .false.
         end do
         if (modulo(sweep, patience) == 0) then
            done = done .or. moved > before/2 .and. moved <= 1e-3_wp*abs(roots%s)
            before = moved
         end if
         if (.not. all(done)) cycle
         ! With all the others in place one more correction leaves round-off.
         do k = 1, size(roots)
            if (.not. settled(k)) call correct(assembly, roots, k, moved(k))
         end do
         return
      end do
      call failure(error, 'modal: '//to_text(count(.not. done))//' of '//to_text(size(roots))// &
         ' roots of the characteristic equation did not converge')
   end subroutine iterate

   !> Newton's correction of root k for the polynomial without the other roots. The second of a
   !> complex pair follows from the first once that one hardly moves; before, a pair may have to
   !> part into two real roots, which it cannot do as long as it is a mirror image.
   !>
   !> moved  size of the correction
   subroutine correct(assembly, roots, k, moved)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: roots(:)
      integer, intent(in) :: k
      real(wp), intent(out) :: moved
      complex(wp) :: slope, step, gap
      integer :: half, i, partner
      logical :: told, settled

      half = size(roots)/2
      partner = modulo(k - 1 + half, size(roots)) + 1
      if (k > half) then
         if (is_pair(roots(partner), roots(k))) then
            moved = 0
            return
         end if
      end if
      slope = logarithmic_derivative(assembly, roots(k))
      told = abs(slope) > 0
      do i = 1, size(roots)
         if (i == k) cycle
         gap = roots(k)%s - roots(i)%s
         told = told .and. abs(gap) > 0
         if (told) slope = slope - conjg(gap)/(real(gap)**2 + aimag(gap)**2)
      end do
      if (told .and. abs(slope) > 0) then
         step = -1/slope
         moved = abs(step)
      else
         ! The slope cannot be told, or two points have met: a little aside, and no convergence.
         step = 1e-8_wp*abs(roots(k)%s)
         moved = huge(moved)
      end if
      settled = moved <= 1e-2_wp*abs(aimag(roots(k)%s)) .and. k <= half .and. &
         abs(roots(partner)%s - conjg(roots(k)%s)) <= 1e-1_wp*abs(aimag(roots(k)%s))
      roots(k)%s = roots(k)%s + step
      roots(k)%offset = roots(k)%offset + step
      if (abs(step) > 1e-2_wp*abs(roots(k)%offset)) call nearest_pole(assembly, roots(k))
      if (settled) roots(partner) = mirrored(assembly, roots(k))
   end subroutine correct

   !> The conjugate root, from the conjugate pole.
   pure type(root_t) function mirrored(assembly, root)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(in) :: root

      mirrored = root_t(root%j, root%origin, root%side, conjg(root%offset), conjg(root%s))
      if (abs(aimag(assembly%pole(root%origin, root%side))) > 0) mirrored%side = 3 - root%side
   end function mirrored

   !> Whether two roots are conjugate and not real.
   pure logical function is_pair(a, b)
      type(root_t), intent(in) :: a, b

      is_pair = abs(real(a%s) - real(b%s)) <= 0 .and. abs(aimag(a%s) + aimag(b%s)) <= 0 .and. &
         abs(aimag(a%s)) > 1e-3_wp*abs(a%s)
   end function is_pair

   !> Keeps one root of each complex pair and the real ones.
   subroutine select_half(assembly, roots)
      type(assembly_t), intent(in) :: assembly
      type(root_t), allocatable, intent(inout) :: roots(:)
      integer :: k

      if (assembly%is_undamped()) then
         ! Without damping the real parts are round-off.
         do k = 1, size(roots)
            roots(k)%s = cmplx(0.0_wp, aimag(roots(k)%s), wp)
            roots(k)%offset = cmplx(0.0_wp, aimag(roots(k)%offset), wp)
         end do
      end if
      do k = 1, size(roots)
         if (abs(aimag(roots(k)%s)) > 1e-3_wp*abs(roots(k)%s)) cycle
         ! A pair has a mirror image; on the axis, at a multiple root most of all, there is noise.
         if (minval(abs(real(roots%s - roots(k)%s)) + abs(aimag(roots%s + roots(k)%s))) &
            <= 1e-2_wp*abs(aimag(roots(k)%s))) cycle
         roots(k)%s = real(roots(k)%s)
         associate (pole => assembly%pole(roots(k)%origin, roots(k)%side))
            if (abs(aimag(pole)) > 0) then
               roots(k)%offset = roots(k)%s - pole
            else
               roots(k)%offset = real(roots(k)%offset)
            end if
         end associate
      end do
      roots = pack(roots, aimag(roots%s) >= 0)
   end subroutine select_half

end module beamid_roots
