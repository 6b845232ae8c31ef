!> Undamped natural modes of the structure, and those of the bare beam.
module beamid_modes
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_galerkin, only: galerkin_t, slope_points
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_splines, only: spline_space_t
   use beamid_structure_checks, only: check_axial_load
   use beamid_variations, only: variations_t
   implicit none
   private

   public :: undamped_modes, beam_modes_t, bare_beam_modes

   !> What is wrong with a structure that cannot carry its load.
   character(len=*), parameter, public :: buckled = 'axial force and weight buckle the beam, '// &
      'expected a stiffness above 0'

   !> The modes of the bare beam, clamped or pinned at the root: B phi = mu G phi with the integrals
   !> of the mesh alone; E I mu/rho are the squares of its angular frequencies. The first of the
   !> pinned beam is its turn as a whole, mu = 0.
   type :: beam_modes_t
      real(wp), allocatable :: mu(:)           !< (n) ascending [1/length**4]
      real(wp), allocatable :: shapes(:, :)    !< (n, n) columns phi with phi' G phi = 1
      real(wp), allocatable :: tip(:)          !< (n) phi(l)
      !> (n, 2) integral of phi by the mass per length, and by itself
      real(wp), allocatable :: total(:, :)
      !> The first mode is turn*x where the beam is pinned; 0 where it is clamped [length**(-3/2)].
      real(wp) :: turn = 0
      type(spline_space_t) :: space
      !> Gauss points along the beam, their weights, and (points, n) slopes of the modes there, as
      !> `tabulate_slopes` leaves them, for `tension`.
      real(wp), allocatable :: points(:), weights(:), slopes(:, :)
      !> (points) the mass beyond them, as `slope_band` has it
      real(wp), allocatable :: beyond(:)
      type(variations_t) :: variations
      !> Points of the bending integrals as x/l, (points, 2) what is known of the factors there, and
      !> where more varies than that (points, n) curvatures times the roots of the weights.
      real(wp), allocatable :: bent(:), known(:, :), curvatures(:, :)
      !> (n, n, 2) phi' A phi and phi' B phi of air and viscosity where something varies along the
      !> beam, less those of mass and stiffness; not allocated: nothing does
      real(wp), allocatable :: rest(:, :, :)
   contains
      procedure :: at
      procedure :: tabulate_slopes
      procedure :: bending_products
      procedure :: tension
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

      call check_axial_load(equations%structure, error)
      if (allocated(error)) return
      if (equations%buckles()) then
         call failure(error, 'modes: '//buckled)
         return
      end if
      call shapes_of(equations%stiffness, equations%mass, equations%omega**2, shapes, error)
      if (allocated(error)) return
      omega = [(sqrt(equations%strain_energy(shapes(:, k))), k=1, equations%n)]
   end subroutine undamped_modes

   !> Modes of the bare beam, pinned where the space of the mesh lets the root turn.
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
         modes%total(:, 2) = matmul(galerkin%moments(0.0_wp), modes%shapes)
         modes%total(:, 1) = modes%total(:, 2)
         if (galerkin%varies) modes%total(:, 1) = matmul(galerkin%moments(0.0_wp, mass=.true.), &
            modes%shapes)
         if (galerkin%space%turning > 0) call make_turn(galerkin, modes)
         modes%mu = [(galerkin%bending_energy(modes%shapes(:, k)), k=1, size(modes%shapes, 2))]
         if (galerkin%space%turning > 0) modes%mu(1) = 0
         modes%tip = modes%at(length, 0)
         if (galerkin%varies) call find_rest(galerkin, modes)
         modes%variations = galerkin%variations
         modes%bent = galerkin%bent%xi
         modes%known = galerkin%known
         associate (v => modes%variations)
            if (v%dips .or. any(v%along%coefficients > 0)) then
               modes%curvatures = galerkin%curvatures(modes%shapes)
               if (modes%turn > 0) modes%curvatures(:, 1) = 0
            end if
         end associate
      end associate
   end subroutine bare_beam_modes

   !> The turn w = x, which every spline space has, is known better than by its coefficients: it
   !> takes the place of the first shape, and is taken out of the others.
   subroutine make_turn(galerkin, modes)
      type(galerkin_t), intent(in) :: galerkin
      type(beam_modes_t), intent(inout) :: modes
      type(band_t) :: factor
      real(wp) :: turned(size(modes%shapes, 1)), moment(size(modes%shapes, 1))
      logical :: positive
      integer :: k

      associate (length => galerkin%space%length)
         modes%turn = 1/(length*sqrt(galerkin%integral(2.0_wp, mass=.true.)))
         moment = modes%turn*length*galerkin%moments(1.0_wp, mass=.true.)
         modes%total(1, :) = modes%turn*length*[galerkin%integral(1.0_wp, mass=.true.), &
            galerkin%integral(1.0_wp)]
      end associate
      factor = galerkin%inertia
      call factor%factor(positive)
      turned = moment
      call factor%solve(turned)
      modes%shapes(:, 1) = turned
      do k = 2, size(modes%shapes, 2)
         associate (share => dot_product(moment, modes%shapes(:, k)))
            modes%shapes(:, k) = modes%shapes(:, k) - share*turned
            modes%total(k, :) = modes%total(k, :) - share*modes%total(1, :)
         end associate
      end do
   end subroutine make_turn

   !> What air and viscosity do between the modes of a beam whose properties vary.
   subroutine find_rest(galerkin, modes)
      type(galerkin_t), intent(in) :: galerkin
      type(beam_modes_t), intent(inout) :: modes
      integer :: i, j

      associate (n => size(modes%mu), shapes => modes%shapes)
         allocate (modes%rest(n, n, 2))
         do j = 1, n
            modes%rest(:, j, 1) = matmul(galerkin%air%times(shapes(:, j)), shapes)
            modes%rest(:, j, 2) = matmul(galerkin%viscous%times(shapes(:, j)), shapes)
         end do
         do i = 1, n
            modes%rest(i, i, :) = modes%rest(i, i, :) - [1.0_wp, modes%mu(i)]
         end do
      end associate
   end subroutine find_rest

   !> Once per mesh, where anything pulls.
   subroutine tabulate_slopes(self)
      class(beam_modes_t), intent(inout) :: self
      integer :: k

      if (allocated(self%slopes)) return
      call slope_points(self%space, self%space%length, self%variations, self%points, self%weights)
      allocate (self%slopes(size(self%points), size(self%mu)))
      allocate (self%beyond(size(self%points)))
      do k = 1, size(self%points)
         self%slopes(k, :) = self%at(self%points(k), 1)
         self%beyond(k) = self%space%length &
            *self%variations%mass_beyond(self%points(k)/self%space%length)
      end do
   end subroutine tabulate_slopes

   !> The integral of (a + b m) phi_i' phi_j' from the root to a place, m the mass per length
   !> beyond.
   !>
   !> x     0 .. l [length]
   !> a, b  [1], [1/length]; b only where x = l
   function tension(self, x, a, b) result(values)
      class(beam_modes_t), intent(in) :: self
      real(wp), intent(in) :: x, a, b
      real(wp) :: values(size(self%mu), size(self%mu))
      real(wp), allocatable :: weights(:), slopes(:, :)
      integer :: cut, q, reached, whole

      associate (l => self%space%length, ends => self%space%ends)
         cut = self%space%elements
         if (x < l) cut = self%space%element_of(x)
         whole = count(self%points < ends(cut))
         weights = self%weights(:whole)*(a + b*self%beyond(:whole))
         slopes = self%slopes(:whole, :)
         if (x < l) then
            ! Of the element that is cut the part in front.
            reached = count(self%points < ends(cut + 1))
            associate (share => (x - ends(cut))/(ends(cut + 1) - ends(cut)))
               weights = [weights, self%weights(whole + 1:reached)*share*a]
               slopes = reshape([transpose(slopes), [(self%at(ends(cut) + (self%points(q) &
                  - ends(cut))*share, 1), q=whole + 1, reached)]], [size(weights), &
                  size(self%mu)], order=[2, 1])
            end associate
         end if
         do q = 1, size(self%mu)
            values(:, q) = matmul(weights*slopes(:, q), slopes)
         end do
      end associate
   end function tension

   !> The integrals of factor phi_i'' phi_j''.
   !>
   !> factor  (bending points)
   function bending_products(self, factor) result(values)
      class(beam_modes_t), intent(in) :: self
      real(wp), intent(in) :: factor(:)
      real(wp) :: values(size(self%mu), size(self%mu))
      real(wp), allocatable :: curvatures(:, :), weighted(:, :)
      integer, allocatable :: where_any(:)
      integer :: k, q

      where_any = pack([(q, q=1, size(factor))], abs(factor) > 0)
      curvatures = self%curvatures(where_any, :)
      weighted = curvatures
      do k = 1, size(self%mu)
         weighted(:, k) = factor(where_any)*curvatures(:, k)
      end do
      values = matmul(transpose(weighted), curvatures)
   end function bending_products

   !> Values of the modes, or of a derivative, at one place.
   !>
   !> x  0 .. l [length]
   function at(self, x, derivative) result(values)
      class(beam_modes_t), intent(in) :: self
      real(wp), intent(in) :: x
      integer, intent(in) :: derivative
      real(wp) :: values(size(self%shapes, 2)), b(self%space%n)

      b = self%space%at(x, derivative)
      values = matmul(b, self%shapes)
      if (self%turn > 0) values(1) = self%turn*merge(x, merge(1.0_wp, 0.0_wp, derivative == 1), &
         derivative == 0)
   end function at

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

      call check_interrupt(error)
      if (allocated(error)) return
      n = mass_matrix%n
      mass = mass_matrix
      shifted = stiffness
      shifted%a = shifted%a + sigma*mass%a
      allocate (mu(n), z(n, n), work(1 + 5*n + 2*n**2), iwork(3 + 5*n))
      ! With what is no number LAPACK may stop the program.
      if (.not. (all(ieee_is_finite(mass%a)) .and. all(ieee_is_finite(shifted%a)))) then
         call failure(error, 'modes: the mass or stiffness matrix is not finite')
         return
      end if
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
