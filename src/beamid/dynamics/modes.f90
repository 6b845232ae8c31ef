!> Undamped natural modes of the structure, and those of the bare beam.
module beamid_modes
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_galerkin, only: galerkin_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: undamped_modes, bare_beam_modes

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

end module beamid_modes
