!> Natural modes: undamped frequencies and shapes, and the damped roots of (s**2 M + s C + K) x = 0.
module beamid_modes
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_galerkin, only: galerkin_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: undamped_modes, bare_beam_modes, damped_roots

   interface
      subroutine dsbgvd(jobz, uplo, n, ka, kb, ab, ldab, bb, ldbb, w, z, ldz, work, lwork, iwork, &
         liwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, ka, kb, ldab, ldbb, ldz, lwork, liwork
         real(wp), intent(inout) :: ab(ldab, *), bb(ldbb, *)
         real(wp), intent(out) :: w(*), z(ldz, *), work(*)
         integer, intent(out) :: iwork(*), info
      end subroutine dsbgvd
      subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
         import :: wp
         character, intent(in) :: jobvl, jobvr
         integer, intent(in) :: n, lda, ldvl, ldvr, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), work(*)
         integer, intent(out) :: info
      end subroutine dgeev
   end interface

contains

   !> Solves K x = omega**2 M x by LAPACK for band matrices.
   !>
   !> The eigenvalues of M x = mu (K + sigma M) x, mu = 1/(omega**2 + sigma), are asked for:
   !> LAPACK's error is relative to the largest eigenvalue, which in this form belongs to the lowest
   !> mode. Rayleigh's quotient with the energies of the shapes then removes the round-off of K
   !> itself, which would cost the lowest frequencies digits like N**4.
   !>
   !> omega   (n) ascending [1/time]
   !> shapes  (n, n) columns x with x' M x = 1
   subroutine undamped_modes(equations, omega, shapes, error)
      type(equations_t), intent(in) :: equations
      real(wp), allocatable, intent(out) :: omega(:), shapes(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call shapes_of(equations%stiffness, equations%mass, equations%omega**2, shapes, error)
      if (allocated(error)) return
      omega = [(sqrt(equations%strain_energy(shapes(:, k))), k=1, equations%n)]
   end subroutine undamped_modes

   !> The bare clamped beam, B phi = mu G phi with the integrals of the mesh alone; EI mu/rho are
   !> the squares of its angular frequencies.
   !>
   !> mu      (n) ascending [1/length**4]
   !> shapes  (n, n) columns phi with phi' G phi = 1
   subroutine bare_beam_modes(galerkin, mu, shapes, error)
      type(galerkin_t), intent(in) :: galerkin
      real(wp), allocatable, intent(out) :: mu(:), shapes(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      ! The first eigenvalue of a cantilever is 12.36/length**4.
      call shapes_of(galerkin%bending, galerkin%inertia, 12/galerkin%space%length**4, shapes, error)
      if (allocated(error)) return
      mu = [(galerkin%bending_energy(shapes(:, k)), k=1, galerkin%space%n)]
   end subroutine bare_beam_modes

   !> Eigenvectors of K x = lambda M x in ascending order of lambda, x' M x = 1.
   !>
   !> sigma  size of the lowest eigenvalue, > 0
   subroutine shapes_of(stiffness, mass_matrix, sigma, shapes, error)
      type(band_t), intent(in) :: stiffness, mass_matrix
      real(wp), intent(in) :: sigma
      real(wp), allocatable, intent(out) :: shapes(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(band_t) :: mass, shifted
      real(wp), allocatable :: mu(:), z(:, :), work(:)
      integer, allocatable :: iwork(:)
      integer :: n, k, info

      n = mass_matrix%n
      mass = mass_matrix
      shifted = stiffness
      shifted%a = shifted%a + sigma*mass%a
      allocate (mu(n), z(n, n), work(1 + 5*n + 2*n**2), iwork(3 + 5*n))
      call dsbgvd('V', 'L', n, mass%kd, shifted%kd, mass%a, mass%kd + 1, shifted%a, &
         shifted%kd + 1, &
         mu, z, n, work, size(work), iwork, size(iwork), info)
      if (info /= 0 .or. mu(1) <= 0) then
         call failure(error, 'modes: mass or stiffness matrix is not positive definite')
         return
      end if
      ! From largest mu to smallest.
      allocate (shapes(n, n))
      do k = 1, n
         z(:, k) = z(:, k)/sqrt(mu(k))
         shapes(:, n + 1 - k) = z(:, k)/sqrt(dot_product(z(:, k), mass_matrix%times(z(:, k))))
      end do
   end subroutine shapes_of

   !> Roots s of the damped structure, in the coordinates of the undamped modes, where with
   !> (Omega q, q') as the state the matrix [0 Omega; -Omega -D] is as well scaled as can be.
   !>
   !> roots  complex pairs once, with positive imaginary part; real roots each; ascending |s|
   !>        [1/time]
   subroutine damped_roots(equations, roots, error)
      type(equations_t), intent(in) :: equations
      complex(wp), allocatable, intent(out) :: roots(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: omega(:), shapes(:, :), a(:, :), re(:), im(:), work(:)
      real(wp) :: unused(1, 1)
      integer :: n, k, info

      call undamped_modes(equations, omega, shapes, error)
      if (allocated(error)) return
      n = equations%n
      if (.not. any(abs(equations%damping%a) > 0)) then
         roots = cmplx(0.0_wp, omega, wp)
         return
      end if
      allocate (a(2*n, 2*n), source=0.0_wp)
      allocate (re(2*n), im(2*n), work(16*n))
      do k = 1, n
         a(k, n + k) = omega(k)
         a(n + k, k) = -omega(k)
         a(n + 1:, n + k) = -matmul(equations%damping%times(shapes(:, k)), shapes)
      end do
      call dgeev('N', 'N', 2*n, a, 2*n, re, im, unused, 1, unused, 1, work, size(work), info)
      if (info /= 0) then
         call failure(error, 'modes: the eigenvalues of the damped structure did not converge')
         return
      end if
      roots = pack(cmplx(re, im, wp), im >= 0)
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

end module beamid_modes
