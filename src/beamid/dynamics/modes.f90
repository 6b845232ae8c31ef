!> Undamped natural modes: those of the structure, and those of the bare beam, which are the
!> coordinates (oscillators) of `beamid_assembly`.
module beamid_modes
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t, slope_band, with_air, with_mass
   use beamid_internal_forces, only: strain_energy
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_matrices, only: add_diagonal
   use beamid_splines, only: spline_space_t
   use beamid_structure, only: deflection, root, rotation, structure_t
   use beamid_structure_checks, only: check_axial_load
   use beamid_variations, only: variations_t
   implicit none
   private

   public :: natural_frequencies, undamped_modes, beam_modes_t, bare_beam_modes

   !> Message for a structure that buckles under its load.
   character(len=*), parameter, public :: buckled = 'axial force and weight buckle the beam, '// &
      'expected a stiffness above 0'

   !> The modes phi of the bare beam, held by the conditions that its spline space satisfies, of the
   !> eigenvalue problem B phi = mu G phi with the integrals B (bending) and G (inertia) of the mesh
   !> alone. E I mu/rho are the squares of the natural angular frequencies. If the beam can move as
   !> a rigid body, the first modes are these motions, with mu = 0.
   type :: beam_modes_t
      real(wp), allocatable :: mu(:)           !< (n) eigenvalues, ascending [1/length**4]
      real(wp), allocatable :: shapes(:, :)    !< (n, n) columns phi with phi' G phi = 1
      real(wp), allocatable :: tip(:)          !< (n) values phi(l)
      !> (n, 2) integrals of phi over the beam, with the known factors of mass and air damping
      real(wp), allocatable :: total(:, :)
      !> (2, r) the first r modes are the motions rigid(1, :) + rigid(2, :) x/l of the beam as a
      !> rigid body [length**(-1/2)]
      real(wp), allocatable :: rigid(:, :)
      type(spline_space_t) :: space            !< spline space of the shapes
      type(variations_t) :: variations         !< variation of the properties along the beam
      !> (bending points) positions x/l, (bending points, 2) known factors of stiffness and
      !> viscosity
      real(wp), allocatable :: bent(:), known(:, :)
      !> (bending points, n) sqrt(weight) phi''; not allocated unless a fit estimates the stiffness
      !> or the viscosity along the beam
      real(wp), allocatable :: curvatures(:, :)
      !> (n, n, 2) phi' A phi of air damping and phi' V phi of viscosity, less those of inertia and
      !> bending (unit matrix and mu); not allocated: no property has known variation
      real(wp), allocatable :: damping_remainder(:, :, :)
   contains
      procedure :: at, bending_products, tension
   end type beam_modes_t

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

   !> Computes the undamped natural angular frequencies of a structure on a mesh.
   !>
   !> omega  (n) ascending; 0 for motions as a rigid body [1/time]
   !> error  as of `undamped_modes`
   !> fixed  as of `galerkin_of`
   subroutine natural_frequencies(structure, mesh, omega, error, fixed)
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      real(wp), allocatable, intent(out) :: omega(:)
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: fixed
      type(galerkin_t), target :: galerkin
      real(wp), allocatable :: shapes(:, :)

      galerkin = galerkin_of(mesh, structure, fixed)
      call undamped_modes(new_equations(galerkin, structure), omega, shapes, error)
   end subroutine natural_frequencies

   !> Computes the undamped natural modes of a structure, K x = omega**2 M x, by LAPACK for band
   !> matrices.
   !>
   !> LAPACK solves M x = mu (K + sigma M) x for mu = 1/(omega**2 + sigma), because its error is
   !> relative to the largest eigenvalue, which in this form belongs to the lowest mode. The
   !> Rayleigh quotient with the strain energies of the shapes then removes the round-off of K
   !> itself, which would cost the lowest frequencies digits like N**4.
   !>
   !> omega   (n) natural angular frequencies, ascending [1/time]
   !> shapes  (n, n) columns x with x' M x = 1
   !> error   the structure buckles; the mesh holds an end that the structure does not hold; a
   !>         matrix is not positive definite
   subroutine undamped_modes(equations, omega, shapes, error)
      type(equations_t), intent(in) :: equations
      real(wp), allocatable, intent(out) :: omega(:), shapes(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call equations%check_ends(error)
      if (.not. allocated(error)) call check_axial_load(equations%structure, error)
      if (allocated(error)) return
      if (equations%buckles()) then
         call failure(error, 'modes: '//buckled)
         return
      end if
      call shapes_of(equations%stiffness, equations%mass, equations%omega**2, shapes, error)
      if (allocated(error)) return
      omega = [(sqrt(strain_energy(equations, shapes(:, k))), k=1, equations%n)]
      omega(:equations%structure%rigid_body_modes()) = 0
   end subroutine undamped_modes

   !> Computes the modes of the bare beam.
   !>
   !> error  a matrix is not positive definite or not finite
   subroutine bare_beam_modes(galerkin, modes, error)
      type(galerkin_t), intent(in) :: galerkin
      type(beam_modes_t), intent(out) :: modes
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      modes%space = galerkin%space
      associate (length => galerkin%space%length)
         ! The first eigenvalue of a cantilever is 12.36/length**4.
         call shapes_of(galerkin%bending, galerkin%inertia, 12/length**4, modes%shapes, error)
         if (allocated(error)) return
         allocate (modes%total(size(modes%shapes, 2), 2))
         modes%total(:, 1) = matmul(galerkin%moments(0.0_wp, with_mass), modes%shapes)
         modes%total(:, 2) = matmul(galerkin%moments(0.0_wp, with_air), modes%shapes)
         call set_rigid_motions(galerkin, modes)
         modes%mu = [(galerkin%bending_energy(modes%shapes(:, k)), k=1, size(modes%shapes, 2))]
         modes%mu(:size(modes%rigid, 2)) = 0
         modes%tip = modes%at(length, 0)
         if (galerkin%varies) then
            allocate (modes%damping_remainder(size(modes%mu), size(modes%mu), 2))
            associate (remainder => modes%damping_remainder)
               remainder(:, :, 1) = projected(galerkin%air, modes%shapes)
               remainder(:, :, 2) = projected(galerkin%viscous, modes%shapes)
               call add_diagonal(remainder(:, :, 1), spread(-1.0_wp, 1, size(modes%mu)))
               call add_diagonal(remainder(:, :, 2), -modes%mu)
            end associate
         end if
         modes%variations = galerkin%variations
         modes%bent = galerkin%bent%xi
         modes%known = galerkin%known
         associate (v => modes%variations)
            if (v%dips .or. any(v%along%coefficients > 0)) then
               allocate (modes%curvatures(size(modes%bent), size(modes%mu)))
               do k = 1, size(modes%mu)
                  modes%curvatures(:, k) = galerkin%curvatures(modes%shapes(:, k))
               end do
               modes%curvatures(:, :size(modes%rigid, 2)) = 0
            end if
         end associate
      end associate
   end subroutine bare_beam_modes

   !> Returns the motions a + b x/l of a rigid body that satisfy conditions at the ends.
   !>
   !> essential  (condition, end)
   !> motions    (2, r) coefficients a and b, r = 0, 1 or 2
   pure function rigid_motions(essential) result(motions)
      logical, intent(in) :: essential(2, 2)
      real(wp), allocatable :: motions(:, :)
      logical :: may_rotate

      may_rotate = .not. any(essential(rotation, :))
      if (all(essential(deflection, :))) then
         allocate (motions(2, 0))
      else if (any(essential(deflection, :))) then
         allocate (motions(2, merge(1, 0, may_rotate)))
         motions(1, :) = merge(0.0_wp, 1.0_wp, essential(deflection, root))
         motions(2, :) = 1 - 2*motions(1, :)
      else
         motions = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, merge(2, 1, may_rotate)])
      end if
   end function rigid_motions

   !> Replaces the first shapes by the motions of a rigid body, which are known more accurately than
   !> their computed coefficients, and makes the other shapes orthogonal to them.
   subroutine set_rigid_motions(galerkin, modes)
      type(galerkin_t), intent(in) :: galerkin
      type(beam_modes_t), intent(inout) :: modes
      type(band_t) :: factor
      real(wp) :: I(0:2), moments(galerkin%space%n, 2), motion(galerkin%space%n)
      logical :: positive
      integer :: j, k

      modes%rigid = rigid_motions(galerkin%space%essential)
      if (size(modes%rigid) == 0) return
      I = [(galerkin%integral(real(k, wp), with_mass), k=0, 2)]
      if (size(modes%rigid, 2) == 2) modes%rigid(:, 2) = [-I(1)/I(0), 1.0_wp]
      factor = galerkin%inertia
      call factor%factor(positive)
      moments(:, 1) = galerkin%moments(0.0_wp, with_mass)
      moments(:, 2) = galerkin%moments(1.0_wp, with_mass)
      do j = 1, size(modes%rigid, 2)
         associate (a => modes%rigid(1, j), b => modes%rigid(2, j))
            modes%rigid(:, j) = modes%rigid(:, j)/sqrt(a**2*I(0) + 2*a*b*I(1) + b**2*I(2))
            modes%total(j, :) = [a*I(0) + b*I(1), a*galerkin%integral(0.0_wp, &
               with_air) + b*galerkin%integral(1.0_wp, with_air)]
         end associate
         motion = matmul(moments, modes%rigid(:, j))
         modes%shapes(:, j) = motion
         call factor%solve(modes%shapes(:, j))
         do k = size(modes%rigid, 2) + 1, size(modes%shapes, 2)
            associate (share => dot_product(motion, modes%shapes(:, k)))
               modes%total(k, :) = modes%total(k, :) - share*modes%total(j, :)
               modes%shapes(:, k) = modes%shapes(:, k) - share*modes%shapes(:, j)
            end associate
         end do
      end do
   end subroutine set_rigid_motions

   !> Returns the integrals of (a + b m) phi_i' phi_j' from the root to a position x; m is the mass
   !> beyond a point, divided by rho.
   !>
   !> x       upper end of the integral, 0 .. l [length]
   !> a, b    coefficients [1], [1/length]
   !> values  (n, n)
   function tension(self, x, a, b) result(values)
      class(beam_modes_t), intent(in) :: self
      real(wp), intent(in) :: x, a, b
      real(wp) :: values(size(self%mu), size(self%mu))

      values = projected(slope_band(self%space, self%variations, x, a, b), self%shapes)
   end function tension

   !> Returns the products phi_i' A phi_j of all modes with a band matrix A.
   !>
   !> shapes  (n, modes) columns phi
   !> values  (modes, modes)
   function projected(band, shapes) result(values)
      type(band_t), intent(in) :: band
      real(wp), intent(in) :: shapes(:, :)
      real(wp) :: values(size(shapes, 2), size(shapes, 2))
      integer :: j

      do j = 1, size(shapes, 2)
         values(:, j) = matmul(band%times(shapes(:, j)), shapes)
      end do
   end function projected

   !> Returns the integrals of f phi_i'' phi_j''.
   !>
   !> factor  (bending points) values of f
   !> values  (n, n)
   function bending_products(self, factor) result(values)
      class(beam_modes_t), intent(in) :: self
      real(wp), intent(in) :: factor(:)
      real(wp) :: values(size(self%mu), size(self%mu))
      real(wp), allocatable :: curvatures(:, :), weighted(:, :)
      integer, allocatable :: nonzero(:)
      integer :: k, q

      nonzero = pack([(q, q=1, size(factor))], abs(factor) > 0)
      curvatures = self%curvatures(nonzero, :)
      weighted = curvatures
      do k = 1, size(self%mu)
         weighted(:, k) = factor(nonzero)*curvatures(:, k)
      end do
      values = matmul(transpose(weighted), curvatures)
   end function bending_products

   !> Returns the values of all modes, or of a derivative, at one position.
   !>
   !> x           position, 0 .. l [length]
   !> derivative  order of the derivative with respect to x
   !> values      (n)
   function at(self, x, derivative) result(values)
      class(beam_modes_t), intent(in) :: self
      real(wp), intent(in) :: x
      integer, intent(in) :: derivative
      real(wp) :: values(size(self%shapes, 2)), b(self%space%n)

      b = self%space%at(x, derivative)
      values = matmul(b, self%shapes)
      associate (r => size(self%rigid, 2), l => self%space%length)
         if (derivative == 0) values(:r) = self%rigid(1, :) + self%rigid(2, :)*(x/l)
         if (derivative == 1) values(:r) = self%rigid(2, :)/l
         if (derivative > 1) values(:r) = 0
      end associate
   end function at

   !> Computes the eigenvectors of K x = lambda M x, in ascending order of lambda, with x' M x = 1.
   !>
   !> sigma   shift, > 0, of the size of the lowest eigenvalue
   !> shapes  (n, n) columns x
   !> error   a matrix is not positive definite or not finite
   subroutine shapes_of(stiffness, mass_matrix, sigma, shapes, error)
      type(band_t), intent(in) :: stiffness, mass_matrix
      real(wp), intent(in) :: sigma
      real(wp), allocatable, intent(out) :: shapes(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(band_t) :: mass, shifted
      real(wp), allocatable :: mu(:), z(:, :), work(:)
      integer, allocatable :: iwork(:)
      integer :: n, k, info

      call check_interrupt(error)
      if (allocated(error)) return
      n = mass_matrix%n
      mass = mass_matrix
      shifted = stiffness
      shifted%a = shifted%a + sigma*mass%a
      allocate (mu(n), z(n, n), work(1 + 5*n + 2*n**2), iwork(3 + 5*n))
      ! LAPACK may stop the program if an entry is not finite.
      if (.not. (all(ieee_is_finite(mass%a)) .and. all(ieee_is_finite(shifted%a)))) then
         call failure(error, 'modes: the mass or stiffness matrix is not finite')
         return
      end if
      call dsbgvd('V', 'L', n, mass%kd, shifted%kd, mass%a, mass%kd + 1, shifted%a, &
         shifted%kd + 1, mu, z, n, work, size(work), iwork, size(iwork), info)
      if (info /= 0 .or. mu(1) <= 0) then
         call failure(error, 'modes: mass or stiffness matrix is not positive definite')
         return
      end if
      ! LAPACK returns mu in ascending order; the modes are in descending order of mu.
      allocate (shapes(n, n))
      do k = 1, n
         z(:, k) = z(:, k)/sqrt(mu(k))
         shapes(:, n + 1 - k) = z(:, k)/sqrt(dot_product(z(:, k), mass_matrix%times(z(:, k))))
      end do
   end subroutine shapes_of

end module beamid_modes
