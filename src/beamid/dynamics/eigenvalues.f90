!> All roots at once, as eigenvalues of the linearised equations of motion by LAPACK. They are
!> starting points to be improved, but none of the roots is missing.
!>
!> LAPACK's errors are relative to the largest eigenvalue. The eigenvalues s are accurate for the
!> large roots, the eigenvalues 1/(s - shift) for the roots near the shift: 0 for the lowest modes,
!> -E/c_D for the slow roots of overdamped modes, which accumulate there.
module beamid_eigenvalues
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_assembly, only: assembly_t, root_t
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeev, dgesv
   use beamid_relaxation_roots, only: restart_root
   use beamid_systems, only: system_at
   use beamid_terms, only: of_mass, of_relaxation
   use beamid_vectors, only: nearest_pole
   implicit none
   private

   public :: roots_of_matrix

   !> Relative difference below which an eigenvalue and a root are the same.
   real(wp), parameter :: same = 1e-6_wp

contains

   !> Computes starting points for all roots.
   !>
   !> relaxed  relaxation roots, which are left out; one that is no eigenvalue is computed again
   !> roots    one of each complex pair and of every two real roots in the first half, the other one
   !>          half the size further
   !> error    LAPACK fails, or the user has interrupted
   subroutine roots_of_matrix(assembly, relaxed, roots, error)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: relaxed(:)
      type(root_t), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: s(:), near(:)
      real(wp) :: error_of_s, fastest, shift

      call large_roots(assembly, relaxed, s)
      if (size(s) == 0) then
         call failure(error, 'modal: LAPACK finds no eigenvalues of the equations of motion')
         return
      end if
      call check_interrupt(error)
      if (allocated(error)) return
      if (size(relaxed) > 0) then
         call arrange(assembly, s, roots)
         return
      end if
      fastest = maxval(abs(s))
      ! The first shift is to the right of all roots, and close to the lowest.
      shift = 1e-3_wp*minval(abs(assembly%oscillators%pole), &
         mask=abs(assembly%oscillators%pole) > 0)
      call roots_near(assembly, shift, near)
      ! In units of epsilon, the error of s is |s| of the largest root, and the error of a root from
      ! 1/(s - shift) is |s - shift|**2 over that of the nearest root. Each list is used where its
      ! error is the smaller one.
      error_of_s = fastest
      if (size(near) > 0) call replace_within(s, near, (0.0_wp, 0.0_wp), &
         sqrt(minval(abs(near - shift))*fastest))
      associate (E => assembly%oscillators%E, c_D => assembly%oscillators%c_D)
         if (c_D*fastest > E) then
            call check_interrupt(error)
            if (allocated(error)) return
            shift = -E/c_D
            if (size(near) > 0) then
               ! The smallest root may be 0.
               if (minval(abs(near))*fastest > shift**2) error_of_s = shift**2/minval(abs(near))
            end if
            call roots_near(assembly, shift, near)
            if (size(near) > 0) call replace_within(s, near, cmplx(shift, 0, wp), &
               min(abs(shift)/2, sqrt(minval(abs(near - shift))*error_of_s)))
         end if
      end associate
      call arrange(assembly, s, roots)
   end subroutine roots_of_matrix

   !> Computes the roots as eigenvalues s of x'' = -M**-1 (C x' + K x + sum of K_l z_l), where
   !> constraint forces keep the acceleration of rigid rows at zero, and z_l' = x' - b_l z_l are the
   !> internal variables of the relaxing stiffnesses K_l.
   !>
   !> relaxed  relaxation roots, which are left out; one that is no eigenvalue is computed again
   !> s        roots [1/time]; size 0: LAPACK fails
   subroutine large_roots(assembly, relaxed, s)
      type(assembly_t), intent(in) :: assembly
      type(root_t), intent(inout) :: relaxed(:)
      complex(wp), allocatable, intent(out) :: s(:)
      real(wp), allocatable :: rigid(:, :), mass(:, :), b(:, :), a(:, :)
      integer, allocatable :: pivots(:), modes(:)
      complex(wp), allocatable :: others(:)
      integer :: i, info, k, l, n, m, states

      n = assembly%layout%n
      rigid = assembly%layout%v(pack([(k, k=1, assembly%layout%r)], assembly%couplings%rigid), :)
      m = n + size(rigid, 1)
      modes = pack([(i, i=1, n)], assembly%oscillators%relaxes)
      states = 2*n + size(modes)*assembly%oscillators%relaxation%n
      allocate (mass(m, m), b(m, states), a(states, states), source=0.0_wp)
      allocate (pivots(m))
      call assembly%full_matrices(merge(huge(1.0_wp), assembly%couplings%compliance, &
         assembly%couplings%rigid), mass(:n, :n), b(:n, n + 1:2*n), b(:n, :n))
      mass(n + 1:, :n) = rigid
      mass(:n, n + 1:) = transpose(rigid)
      others = relaxed%s
      k = 2*n
      associate (of => assembly%oscillators%relaxation, beam => assembly%layout%beam)
         do l = 1, of%n
            do i = 1, size(modes)
               b(modes(i), k + i) = assembly%oscillators%relaxed(modes(i), l)
               a(k + i, n + modes(i)) = 1
               a(k + i, k + i) = -of%rate(l)
               if (assembly%is_dense()) b(:beam, k + i) = b(:beam, k + i) &
                  + sum(assembly%dense%matrix(:, modes(i), of_relaxation, 0), dim=2, &
                  mask=spread(of%slot == l, 1, beam))
            end do
            ! What rigid springs hold relaxes by itself.
            others = [others, spread(cmplx(-of%rate(l), kind=wp), 1, size(modes) &
               - count(relaxed%side == 2 + l))]
            k = k + size(modes)
         end do
      end associate
      call dgesv(m, states, mass, m, pivots, b, m, info)
      allocate (s(0))
      if (info /= 0) return
      a(n + 1:2*n, :) = -b(:n, :)
      do i = 1, n
         a(i, n + i) = 1
      end do
      call largest_eigenvalues(a, assembly%roots(), others, s)
      do k = 1, size(relaxed)
         if (abs(aimag(others(k))) > 0) cycle
         if (abs(others(k) - relaxed(k)%s) > same*abs(others(k))) &
            call restart_root(assembly, real(others(k)), relaxed(k))
      end do
   end subroutine large_roots

   !> Computes the roots from eigenvalues 1/(s - shift), by the matrix P(s) of `beamid_systems`.
   !>
   !> shift  real shift [1/time]
   !> s      roots [1/time]; size 0: LAPACK fails
   subroutine roots_near(assembly, shift, s)
      type(assembly_t), intent(in) :: assembly
      real(wp), intent(in) :: shift
      complex(wp), allocatable, intent(out) :: s(:)
      complex(wp), allocatable :: P(:, :), dP(:, :)
      real(wp), allocatable :: matrix(:, :), b(:, :), a(:, :)
      real(wp) :: half_d2H(assembly%layout%r, assembly%layout%r)
      complex(wp) :: none(0)
      type(root_t) :: point
      integer, allocatable :: pivots(:)
      integer :: i, info, m, n

      n = assembly%layout%n
      m = n + assembly%layout%r
      allocate (P(m, m), dP(m, m), pivots(m))
      allocate (b(m, 2*m), a(2*m, 2*m), source=0.0_wp)
      point%s = shift
      call nearest_pole(assembly, point)
      call system_at(assembly, point, P, dP)
      matrix = real(P)
      b(:, :m) = real(dP)
      call assembly%couplings%coefficient(of_mass, assembly%couplings%form_at(point%s), half_d2H)
      b(:n, m + n + 1:) = matmul(assembly%layout%vt, half_d2H)
      do i = 1, n
         b(i, m + i) = assembly%oscillators%m(i)
      end do
      call dgesv(m, 2*m, matrix, m, pivots, b, m, info)
      allocate (s(0))
      if (info /= 0) return
      a(:m, :) = -b
      do i = 1, m
         a(m + i, i) = 1
      end do
      call largest_eigenvalues(a, assembly%roots(), none, s)
      s = shift + 1/s
   end subroutine roots_near

   !> Computes the n eigenvalues of largest modulus of a matrix.
   !>
   !> a       matrix, destroyed
   !> others  in: eigenvalues to leave out, or points near them; out: the eigenvalues
   !> values  in: what to return if LAPACK fails; out: (n) eigenvalues
   subroutine largest_eigenvalues(a, n, others, values)
      real(wp), intent(inout) :: a(:, :)
      integer, intent(in) :: n
      complex(wp), intent(inout) :: others(:)
      complex(wp), allocatable, intent(inout) :: values(:)
      real(wp) :: re(size(a, 1)), im(size(a, 1)), none(1, 1)
      real(wp), allocatable :: work(:)
      complex(wp) :: all(size(a, 1))
      logical :: taken(size(a, 1)), left_out(size(a, 1)), known(size(others))
      integer :: i, info, k, pass

      ! LAPACK may stop the program if an entry is not finite.
      if (any(.not. ieee_is_finite(a))) return
      allocate (work(34*size(a, 1)))
      call dgeev('N', 'N', size(a, 1), a, size(a, 1), re, im, none, 1, none, 1, work, size(work), &
         info)
      if (info /= 0) return
      all = cmplx(re, im, wp)
      left_out = .false.
      known = .false.
      do pass = 1, 2
         ! First those that are eigenvalues, then those that are no more than points near them.
         do k = 1, size(others)
            if (known(k)) cycle
            i = minloc(abs(all - others(k)), dim=1, mask=.not. left_out)
            if (pass == 1 .and. abs(all(i) - others(k)) > same*abs(all(i))) cycle
            known(k) = .true.
            left_out(i) = .true.
            others(k) = all(i)
         end do
      end do
      taken = .false.
      do k = 1, n
         taken(maxloc(abs(all), dim=1, mask=.not. (taken .or. left_out))) = .true.
      end do
      values = pack(all, taken)
   end subroutine largest_eigenvalues

   !> Replaces roots by more accurate values. Each better value within a radius of a centre takes
   !> the place of the nearest root that is not replaced yet, beginning with the outermost. Nothing
   !> is changed if the result would not consist of complex pairs and real roots.
   !>
   !> s       all roots [1/time]
   !> better  more accurate values of roots [1/time]
   subroutine replace_within(s, better, centre, radius)
      complex(wp), intent(inout) :: s(:)
      complex(wp), intent(in) :: better(:), centre
      real(wp), intent(in) :: radius
      complex(wp) :: new(size(s))
      logical :: waiting(size(better)), free(size(s))
      integer :: k, place

      new = s
      free = .true.
      waiting = abs(better - centre) <= radius
      do while (any(waiting))
         k = maxloc(abs(better - centre), dim=1, mask=waiting)
         waiting(k) = .false.
         place = minloc(abs(s - better(k)), dim=1, mask=free)
         free(place) = .false.
         new(place) = better(k)
      end do
      if (count(aimag(new) > 0) == count(aimag(new) < 0)) s = new
   end subroutine replace_within

   !> Arranges the roots with one of each pair in the first half, and stores them relative to their
   !> nearest poles.
   subroutine arrange(assembly, s, roots)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s(:)
      type(root_t), allocatable, intent(out) :: roots(:)
      complex(wp) :: pairs(size(s)/2), others(size(s)/2)
      complex(wp), allocatable :: upper(:), real_roots(:)
      integer :: k, n

      upper = pack(s, aimag(s) > 0)
      real_roots = pack(s, .not. abs(aimag(s)) > 0)
      n = size(upper)
      pairs = [upper, real_roots(1::2)]
      others = [conjg(upper), real_roots(2::2)]
      allocate (roots(size(s)))
      roots%s = [pairs, others]
      do k = 1, size(roots)
         roots(k)%origin = 0
         call nearest_pole(assembly, roots(k))
      end do
   end subroutine arrange

end module beamid_eigenvalues
