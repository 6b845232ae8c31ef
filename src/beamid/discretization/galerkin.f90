!> Galerkin integrals of the spline space: everything in (3.11) to (3.13) that depends on
!> the mesh alone, so that it is computed once and serves every trial value of the parameters.
module beamid_galerkin
   use beamid_bands, only: band_t, new_band
   use beamid_kinds, only: wp
   use beamid_quadrature, only: gauss_legendre, rule_t, composite
   use beamid_splines, only: spline_space_t, new_spline_space
   use beamid_variations, only: variations_t
   implicit none
   private

   public :: mesh_t, galerkin_t, new_galerkin, same_mesh, slope_points

   !> How the beam is discretized.
   type :: mesh_t
      integer :: degree = 3         !< of the splines: 3, 5 or 7
      integer :: elements = 8       !< N
      integer :: gauss_points = 4   !< per panel
      integer :: panels = 1         !< per element
   end type mesh_t

   type :: galerkin_t
      type(mesh_t) :: mesh
      type(spline_space_t) :: space
      type(band_t) :: inertia             !< <b_i, b_j> [length]
      type(band_t) :: bending             !< <b_i'', b_j''> [1/length**3]
      !> What varies along the beam: a factor of mass in `inertia`, of stiffness in `bending`. Air
      !> and viscosity have matrices of their own then; else those are alike.
      type(variations_t) :: variations
      logical :: varies = .false.
      type(band_t) :: air, viscous
      real(wp), allocatable :: tip(:)     !< (n) b_i(l)
      type(rule_t), private :: rule
      !> (degree + 1, points, rows) sqrt(weight) b'' at the points of the rule for the bending
      !> integrals; all elements from number `rows - 1` on are alike.
      real(wp), allocatable, private :: curvature(:, :, :)
      !> (points, 0:elements - 1, 2) factors of stiffness and viscosity there
      real(wp), allocatable, private :: factor(:, :, :)
   contains
      procedure :: moments
      procedure :: integral
      procedure :: slope_band
      procedure :: add_bending_force
      procedure :: bending_energy
   end type galerkin_t

contains

   !> Whether two meshes are the same, quadrature included.
   pure logical function same_mesh(a, b)
      type(mesh_t), intent(in) :: a, b

      same_mesh = all([a%degree, a%elements, a%gauss_points, a%panels] == &
                      [b%degree, b%elements, b%gauss_points, b%panels])
   end function same_mesh

   !> Integrals for a beam of the given length [length].
   !>
   !> turning     whether the root may turn; default .false.
   !> variations  left out: nothing varies along the beam
   pure function new_galerkin(mesh, length, turning, variations) result(self)
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(in) :: length
      logical, intent(in), optional :: turning
      type(variations_t), intent(in), optional :: variations
      type(galerkin_t) :: self
      real(wp) :: b(mesh%degree + 1), d2b(mesh%degree + 1), weight, xi
      integer :: e, q, first, functions

      self%mesh = mesh
      self%space = new_spline_space(mesh%degree, mesh%elements, length, turning)
      self%rule = composite(mesh%gauss_points, mesh%panels)
      self%tip = self%space%at(length, 0)
      if (present(variations)) self%variations = variations
      self%varies = self%variations%exist()
      self%inertia = new_band(self%space%n, mesh%degree)
      self%bending = self%inertia
      if (self%varies) self%air = self%inertia
      if (self%varies) self%viscous = self%inertia
      call tabulate_curvature(self)
      do e = 0, mesh%elements - 1
         first = self%space%first_on_element(e)
         functions = self%space%last_on_element(e) - first + 1
         do q = 1, size(self%rule%points)
            weight = self%rule%weights(q)*length/mesh%elements
            b = self%space%on_element(e, self%rule%points(q), 0)
            d2b = self%space%on_element(e, self%rule%points(q), 2)
            xi = (e + self%rule%points(q))/mesh%elements
            call self%inertia%add_block(first, weight*self%variations%rho%at(xi), b(:functions))
            call self%bending%add_block(first, weight*self%variations%E%at(xi), d2b(:functions))
            if (.not. self%varies) cycle
            call self%air%add_block(first, weight, b(:functions))
            call self%viscous%add_block(first, weight*self%variations%c_D%at(xi), d2b(:functions))
         end do
      end do
   end function new_galerkin

   !> <theta, b_i> for theta(x) = (x/l)**power, the load shape of (3.10).
   !>
   !> power   >= 0; >= 2 for a load, so that theta and its slope vanish at the root
   !> mass    whether by the mass per length; default .false.
   !> values  (n) [length]
   pure function moments(self, power, mass) result(values)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: power
      logical, intent(in), optional :: mass
      real(wp) :: values(self%space%n)
      real(wp) :: b(self%mesh%degree + 1), weight
      integer :: e, q, first, last

      values = 0
      do e = 0, self%mesh%elements - 1
         first = self%space%first_on_element(e)
         last = self%space%last_on_element(e)
         do q = 1, size(self%rule%points)
            associate (s => self%rule%points(q))
               weight = self%rule%weights(q)*((e + s)/self%mesh%elements)**power &
                  *density(self, (e + s)/self%mesh%elements, mass)
               b = self%space%on_element(e, s, 0)
            end associate
            values(first:last) = values(first:last) + weight*b(:last - first + 1)
         end do
      end do
      values = values*self%space%length/self%mesh%elements
   end function moments

   !> Integral of (x/l)**power over the beam by the rule of the mesh, exact or not: with it w = x/l,
   !> by which a root turns, has the integrals that `inertia` and `moments` give it.
   !>
   !> power   >= 0
   !> mass    whether by the mass per length; default .false.
   !> result  [length]
   pure real(wp) function integral(self, power, mass)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: power
      logical, intent(in), optional :: mass
      integer :: e, q

      integral = 0
      do e = 0, self%mesh%elements - 1
         do q = 1, size(self%rule%points)
            associate (xi => (e + self%rule%points(q))/self%mesh%elements)
               integral = integral + self%rule%weights(q)*xi**power*density(self, xi, mass)
            end associate
         end do
      end do
      integral = integral*self%space%length/self%mesh%elements
   end function integral

   !> The factor of the mass per length where that counts.
   pure real(wp) function density(self, xi, mass)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: xi
      logical, intent(in), optional :: mass

      density = 1
      if (.not. present(mass)) return
      if (mass) density = self%variations%rho%at(xi)
   end function density

   !> Gauss points between the root and a place, exact for (l - x) b_i' b_j' whatever the mesh has
   !> for the other integrals.
   !>
   !> x  0 .. l [length]
   pure subroutine slope_points(space, x, points, weights)
      type(spline_space_t), intent(in) :: space
      real(wp), intent(in) :: x
      real(wp), allocatable, intent(out) :: points(:), weights(:)
      type(rule_t) :: rule
      real(wp) :: h, first, width
      integer :: e

      rule = gauss_legendre(space%degree)
      h = space%length/space%elements
      allocate (points(0), weights(0))
      do e = 0, space%elements - 1
         first = e*h
         width = min(h, x - first)
         if (.not. width > 0) exit
         points = [points, first + width*rule%points]
         weights = [weights, width*rule%weights]
      end do
   end subroutine slope_points

   !> The integral of (a + b (l - x)) b_i' b_j' from the root to a place.
   !>
   !> a, b  [1], [1/length]
   function slope_band(self, x, a, b) result(band)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: x, a, b
      type(band_t) :: band
      real(wp), allocatable :: points(:), weights(:)
      integer :: q

      band = new_band(self%space%n, self%mesh%degree)
      call slope_points(self%space, x, points, weights)
      do q = 1, size(points)
         call band%add_rank_one(weights(q)*(a + b*(self%space%length - points(q))), &
            self%space%at(points(q), 1))
      end do
   end function slope_band

   !> Tabulates curvatures for `bending_energy` and `add_bending_force`: at degree - 1 Gauss points,
   !> which are exact, where the rule of the mesh is exact for them too, else at its own.
   pure subroutine tabulate_curvature(self)
      type(galerkin_t), intent(inout) :: self
      type(rule_t) :: rule
      integer :: e, q

      associate (mesh => self%mesh)
         rule = self%rule
         if (mesh%gauss_points >= mesh%degree - 1 .and. .not. self%varies) &
            rule = composite(mesh%degree - 1, 1)
         allocate (self%curvature(mesh%degree + 1, size(rule%points), &
            min(mesh%elements, mesh%degree + 1)))
         do e = 0, size(self%curvature, 3) - 1
            do q = 1, size(rule%points)
               self%curvature(:, q, e + 1) = sqrt(rule%weights(q)*self%space%length/mesh%elements) &
                  *self%space%on_element(e, rule%points(q), 2)
            end do
         end do
         if (.not. self%varies) return
         allocate (self%factor(size(rule%points), 0:mesh%elements - 1, 2))
         do e = 0, mesh%elements - 1
            do q = 1, size(rule%points)
               associate (xi => (e + rule%points(q))/mesh%elements)
                  self%factor(q, e, :) = [self%variations%E%at(xi), self%variations%c_D%at(xi)]
               end associate
            end do
         end do
      end associate
   end subroutine tabulate_curvature

   !> force := force + factor (bending w), the bending matrix times w, by way of the curvature.
   !>
   !> In the band matrix the curvature of a smooth function is a difference of fourth order between
   !> rounded entries, which costs N**4 units of round-off; here it is one of second order.
   !>
   !> w, force  (n)
   !> viscous   whether by the factor of viscosity, not of stiffness
   pure subroutine add_bending_force(self, factor, w, force, viscous)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: factor, w(:)
      real(wp), intent(inout) :: force(:)
      logical, intent(in) :: viscous
      real(wp) :: kappa
      integer :: e, q, row, first, last, m

      do e = 0, self%mesh%elements - 1
         first = self%space%first_on_element(e)
         last = self%space%last_on_element(e)
         m = last - first + 1
         row = min(e + 1, size(self%curvature, 3))
         do q = 1, size(self%curvature, 2)
            kappa = factor*dot_product(self%curvature(:m, q, row), w(first:last))
            if (self%varies) kappa = kappa*self%factor(q, e, merge(2, 1, viscous))
            force(first:last) = force(first:last) + kappa*self%curvature(:m, q, row)
         end do
      end do
   end subroutine add_bending_force

   !> Integral of (w'')**2 over the beam, as accurate as `add_bending_force`.
   !>
   !> w       (n)
   !> result  [length**2/length**3]
   pure real(wp) function bending_energy(self, w)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: w(:)
      real(wp) :: kappa
      integer :: e, q, row, first, last

      bending_energy = 0
      do e = 0, self%mesh%elements - 1
         first = self%space%first_on_element(e)
         last = self%space%last_on_element(e)
         row = min(e + 1, size(self%curvature, 3))
         do q = 1, size(self%curvature, 2)
            kappa = dot_product(self%curvature(:last - first + 1, q, row), w(first:last))**2
            if (self%varies) kappa = kappa*self%factor(q, e, 1)
            bending_energy = bending_energy + kappa
         end do
      end do
   end function bending_energy

end module beamid_galerkin
