!> Galerkin integrals of the spline space: the parts of (3.11) to (3.13) that depend on the mesh
!> alone. They are computed once and used for every trial value of the parameters.
module beamid_galerkin
   use beamid_bands, only: band_t, new_band
   use beamid_kinds, only: wp
   use beamid_knots, only: add_kinks, closely, kink_t, kinks_at_attachments, kinks_at_supports, &
      shortest, widely
   use beamid_quadrature, only: gauss_legendre, rule_t, composite
   use beamid_splines, only: new_spline_space, spline_space_t
   use beamid_structure, only: structure_t
   use beamid_variations, only: variations_t
   implicit none
   private

   public :: mesh_t, galerkin_t, galerkin_of, new_galerkin, same_mesh, slope_band

   !> Known factors of an integrand: none, that of the mass, that of air damping.
   integer, parameter, public :: alone = 1, with_mass = 2, with_air = 3
   !> Numbers of elements of the coarsest and the finest mesh of an automatic refinement.
   integer, parameter, public :: coarsest = 8, finest = 128

   !> The discretization of the beam: spline space and quadrature rule.
   type :: mesh_t
      integer :: degree = 3         !< degree of the splines: 3, 5 or 7
      integer :: elements = coarsest   !< number of mesh intervals N
      integer :: gauss_points = 4   !< Gauss points per panel
      integer :: panels = 1         !< panels per element
      logical :: at_attachments = .false.   !< knots at the attachments inside the beam
   end type mesh_t

   !> A quadrature point.
   type :: point_t
      integer :: element = 0               !< element, from 0
      !> first and last basis function that is nonzero on the element
      integer :: first = 0, last = 0
      real(wp) :: s = 0                    !< relative position in the element, 0 .. 1
      real(wp) :: xi = 0                   !< position x/l
      real(wp) :: weight = 0               !< quadrature weight [length]
   end type point_t

   !> The spline space of a mesh and its integrals.
   type :: galerkin_t
      type(mesh_t) :: mesh                !< the mesh
      type(spline_space_t) :: space       !< spline space with n basis functions b_i
      type(band_t) :: inertia             !< <f b_i, b_j> [length], f: known factor of the mass
      type(band_t) :: bending             !< <f b_i'', b_j''> [1/length**3], f: of the stiffness
      type(variations_t) :: variations    !< variation of the properties along the beam
      logical :: varies = .false.         !< a property has known variation
      !> integrals with the known factors of air damping and viscosity; undefined unless `varies`,
      !> because they then equal `inertia` and `bending`
      type(band_t) :: air, viscous
      real(wp), allocatable :: tip(:)     !< (n) values b_i(l)
      !> (bending points) quadrature points of the bending integrals
      type(point_t), allocatable :: bent(:)
      !> (bending points, 2) known factors of stiffness and viscosity there
      real(wp), allocatable :: known(:, :)
      !> (points) quadrature points of the other integrals
      type(point_t), allocatable, private :: points(:)
      !> (points, factors) their weights, without a factor and times those of mass and air damping
      real(wp), allocatable, private :: weights(:, :)
      !> (degree + 1, bending points) sqrt(weight) b'' of the functions on the point's element
      real(wp), allocatable, private :: curvature(:, :)
   contains
      procedure :: moments, integral, bending_band, curvatures, &
         subtract_bending_force, bending_energy
   end type galerkin_t

contains

   !> Returns whether two meshes are equal, including their quadrature rules.
   pure logical function same_mesh(a, b)
      type(mesh_t), intent(in) :: a, b

      same_mesh = all([a%degree, a%elements, a%gauss_points, a%panels] == [b%degree, b%elements, &
         b%gauss_points, b%panels]) .and. (a%at_attachments .eqv. b%at_attachments)
   end function same_mesh

   !> Returns the integrals for the beam of a structure, with its conditions at the ends and
   !> its variation along the beam.
   !>
   !> fixed   .true.: no position and no length will change. A support that resists the rotation
   !>         then gets a knot even if the mesh has no other knots at attachments. Default .false.
   !> moving  numbers of the parameters that may change; absent: none
   pure function galerkin_of(mesh, structure, fixed, moving) result(self)
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure
      logical, intent(in), optional :: fixed
      integer, intent(in), optional :: moving(:)
      type(galerkin_t) :: self
      type(kink_t), allocatable :: kinks(:)

      allocate (kinks(0))
      if (mesh%at_attachments) then
         ! An absent `moving` is not passed on: gfortran 12 reads its bounds unless it optimises.
         if (present(moving)) then
            kinks = kinks_at_attachments(structure, moving)
         else
            kinks = kinks_at_attachments(structure, [integer ::])
         end if
      else if (present(fixed)) then
         if (fixed) kinks = kinks_at_supports(structure)
      end if
      self = new_galerkin(mesh, structure%length, structure%essential(), structure%variations, &
         kinks)
   end function galerkin_of

   !> Returns the integrals for a beam that is described by its length and by the conditions at its
   !> ends. `galerkin_of` takes both from a structure.
   !>
   !> length      length of the beam [length]
   !> essential   (condition, end) conditions as in `spline_space_t`; absent: root clamped, tip free
   !> variations  variation along the beam; default: none
   !> kinks       (:) points at which a derivative may jump; default: none
   pure function new_galerkin(mesh, length, essential, variations, kinks) result(self)
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(in) :: length
      logical, intent(in), optional :: essential(2, 2)
      type(variations_t), intent(in), optional :: variations
      type(kink_t), intent(in), optional :: kinks(:)
      type(galerkin_t) :: self
      type(rule_t) :: rule
      real(wp), allocatable :: breaks(:)
      integer, allocatable :: knots(:)
      real(wp) :: b(mesh%degree + 1), d2b(mesh%degree + 1), near
      integer :: m, q

      self%mesh = mesh
      if (present(variations)) self%variations = variations
      self%varies = self%variations%are_known()
      call self%variations%breaks(mesh%degree, breaks, knots)
      near = closely
      if (present(kinks)) then
         if (mesh%at_attachments .and. size(kinks) > 0) near = widely
         call add_kinks(kinks, mesh%degree, merge(shortest/mesh%elements, 0.0_wp, &
            mesh%at_attachments), breaks, knots)
      end if
      self%space = new_spline_space(mesh%degree, mesh%elements, length, essential, &
         pack(breaks, knots > 0), pack(knots, knots > 0), near)
      rule = composite(mesh%gauss_points, mesh%panels)
      self%points = new_points(self%space, rule, pack(breaks, knots == 0))
      self%tip = self%space%at(length, 0)
      self%inertia = new_band(self%space%n, mesh%degree)
      self%bending = self%inertia
      if (self%varies) self%air = self%inertia
      if (self%varies) self%viscous = self%inertia
      call tabulate_curvature(self)
      allocate (self%weights(size(self%points), 3))
      do q = 1, size(self%points)
         associate (v => self%variations, point => self%points(q))
            m = point%last - point%first + 1
            b = self%space%on_element(point%element, point%s, 0)
            d2b = self%space%on_element(point%element, point%s, 2)
            self%weights(q, :) = point%weight*[1.0_wp, v%mass(point%xi), v%air(point%xi)]
            call self%inertia%add_block(point%first, self%weights(q, with_mass), b(:m))
            call self%bending%add_block(point%first, point%weight*v%bending(point%xi), d2b(:m))
            if (.not. self%varies) cycle
            call self%air%add_block(point%first, self%weights(q, with_air), b(:m))
            call self%viscous%add_block(point%first, point%weight*v%viscous(point%xi), d2b(:m))
         end associate
      end do
   end function new_galerkin

   !> Returns the points of a quadrature rule on every element; elements are split at the breaks.
   !>
   !> breaks  positions x/l, ascending
   pure function new_points(space, rule, breaks) result(points)
      type(spline_space_t), intent(in) :: space
      type(rule_t), intent(in) :: rule
      real(wp), intent(in) :: breaks(:)
      type(point_t), allocatable :: points(:)
      type(point_t) :: found((space%elements + size(breaks))*size(rule%points))
      real(wp), allocatable :: ends(:)
      integer :: e, k, n, q

      n = 0
      do e = 0, space%elements - 1
         associate (left => space%ends(e), h => space%ends(e + 1) - space%ends(e))
            ends = (breaks*space%length - left)/h
            ends = [0.0_wp, pack(ends, ends > 1e-9_wp .and. ends < 1 - 1e-9_wp), 1.0_wp]
            do k = 1, size(ends) - 1
               do q = 1, size(rule%points)
                  n = n + 1
                  associate (s => ends(k) + (ends(k + 1) - ends(k))*rule%points(q))
                     found(n) = point_t(element=e, first=space%first_on_element(e), &
                        last=space%last_on_element(e), s=s, xi=(left + s*h)/space%length, &
                        weight=(ends(k + 1) - ends(k))*h*rule%weights(q))
                  end associate
               end do
            end do
         end associate
      end do
      points = found(:n)
   end function new_points

   !> Returns <theta, b_i> for theta(x) = (x/l)**power, the load shape of (3.10).
   !>
   !> power   exponent, >= 0; for a load >= 2, so that theta and its slope vanish at the root
   !> factor  known factor that multiplies theta: `alone` for none, `with_mass` or `with_air`
   !> values  (n) [length]
   pure function moments(self, power, factor) result(values)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: power
      integer, intent(in) :: factor
      real(wp) :: values(self%space%n)
      real(wp) :: b(self%mesh%degree + 1), load(size(self%points))
      integer :: q

      values = 0
      load = self%weights(:, factor)*self%points%xi**power
      do q = 1, size(load)
         associate (first => self%points(q)%first, last => self%points(q)%last)
            b = self%space%on_element(self%points(q)%element, self%points(q)%s, 0)
            values(first:last) = values(first:last) + load(q)*b(:last - first + 1)
         end associate
      end do
   end function moments

   !> Returns the integral of (x/l)**power over the beam [length], by the quadrature rule of the
   !> mesh even if this is not exact: the integrals of the rigid rotation w = x/l then agree with
   !> those of `inertia` and `moments`.
   !>
   !> power   exponent, >= 0
   !> factor  as in `moments`
   pure real(wp) function integral(self, power, factor)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: power
      integer, intent(in) :: factor

      integral = sum(self%weights(:, factor)*self%points%xi**power)
   end function integral

   !> Computes Gauss points between the root and a position. They integrate (l - x) b_i' b_j'
   !> exactly, whatever rule the mesh has for the other integrals.
   !>
   !> x                upper end of the integral, 0 .. l [length]
   !> variations       elements are split where the mass beyond a position is not smooth
   !> points, weights  (:) positions and weights [length]
   pure subroutine slope_points(space, x, variations, points, weights)
      type(spline_space_t), intent(in) :: space
      real(wp), intent(in) :: x
      type(variations_t), intent(in) :: variations
      real(wp), allocatable, intent(out) :: points(:), weights(:)
      type(rule_t) :: rule
      real(wp), allocatable :: breaks(:), ends(:)
      integer, allocatable :: knots(:)
      real(wp) :: last
      integer :: e, k

      rule = gauss_legendre(space%degree)
      call variations%breaks(space%degree, breaks, knots)
      breaks = breaks*space%length
      allocate (points(0), weights(0))
      do e = 0, space%elements - 1
         last = min(space%ends(e + 1), x)
         if (.not. last > space%ends(e)) exit
         ends = [space%ends(e), pack(breaks, breaks > space%ends(e) .and. breaks < last), last]
         do k = 1, size(ends) - 1
            associate (width => ends(k + 1) - ends(k))
               points = [points, ends(k) + width*rule%points]
               weights = [weights, width*rule%weights]
            end associate
         end do
      end do
   end subroutine slope_points

   !> Returns the integrals of (a + b m) b_i' b_j' from the root to a position x. m is the mass of
   !> the beam beyond a point, divided by rho: l minus its position if the mass does not vary.
   !>
   !> variations  variation along the beam
   !> x           upper end of the integral, 0 .. l [length]
   !> a, b        coefficients [1], [1/length]
   function slope_band(space, variations, x, a, b) result(band)
      type(spline_space_t), intent(in) :: space
      type(variations_t), intent(in) :: variations
      real(wp), intent(in) :: x, a, b
      type(band_t) :: band
      real(wp), allocatable :: points(:), weights(:)
      real(wp) :: factor
      integer :: q

      band = new_band(space%n, space%degree)
      call slope_points(space, x, variations, points, weights)
      do q = 1, size(points)
         factor = a
         if (abs(b) > 0) factor = a &
            + b*space%length*variations%mass_beyond(points(q)/space%length)
         call band%add_rank_one(weights(q)*factor, space%at(points(q), 1))
      end do
   end function slope_band

   !> Chooses the points of the bending integrals and tabulates b'' there. The degree - 1 Gauss
   !> points that are exact for a uniform beam suffice if the rule of the mesh is exact, too, and
   !> nothing varies; otherwise the points are those of the mesh, or more for a dip.
   pure subroutine tabulate_curvature(self)
      type(galerkin_t), intent(inout) :: self
      integer, parameter :: of_a_dip = 8   ! resolves a dip whose width is a third of an element
      real(wp), allocatable :: breaks(:)
      integer, allocatable :: knots(:)
      integer :: q

      self%bent = self%points
      associate (mesh => self%mesh, v => self%variations)
         if (v%dips) then
            call v%breaks(mesh%degree, breaks, knots)
            self%bent = new_points(self%space, composite(max(mesh%gauss_points, of_a_dip), &
               mesh%panels), pack(breaks, knots == 0))
         else if (mesh%gauss_points >= mesh%degree - 1 .and. .not. self%varies .and. &
            all(v%along%coefficients == 0)) then
            self%bent = new_points(self%space, composite(mesh%degree - 1, 1), [real(wp) ::])
         end if
      end associate
      allocate (self%curvature(self%mesh%degree + 1, size(self%bent)), &
         self%known(size(self%bent), 2))
      do q = 1, size(self%bent)
         self%curvature(:, q) = sqrt(self%bent(q)%weight) &
            *self%space%on_element(self%bent(q)%element, self%bent(q)%s, 2)
         self%known(q, :) = [self%variations%bending(self%bent(q)%xi), &
            self%variations%viscous(self%bent(q)%xi)]
      end do
   end subroutine tabulate_curvature

   !> Returns the bending integrals <f b_i'', b_j''> with a factor f given at the bending points.
   !>
   !> factor  (bending points) values of f
   function bending_band(self, factor) result(band)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: factor(:)
      type(band_t) :: band
      integer :: q

      band = new_band(self%space%n, self%mesh%degree)
      do q = 1, size(factor)
         associate (first => self%bent(q)%first, last => self%bent(q)%last)
            call band%add_block(first, factor(q), self%curvature(:last - first + 1, q))
         end associate
      end do
   end function bending_band

   !> Returns sqrt(weight) w'' of a deflection w, (bending points).
   !>
   !> w  (n) spline coefficients
   pure function curvatures(self, w) result(values)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: w(:)
      real(wp) :: values(size(self%bent))
      integer :: q

      do q = 1, size(values)
         associate (first => self%bent(q)%first, last => self%bent(q)%last)
            values(q) = dot_product(self%curvature(:last - first + 1, q), w(first:last))
         end associate
      end do
   end function curvatures

   !> Subtracts the integrals of (k w'' + c v'') b_i'' from a force, by way of the curvatures.
   !>
   !> The product of a smooth w with the band matrix is a difference of fourth order between rounded
   !> entries, whose round-off grows like N**4. The curvature is a difference of second order only.
   !>
   !> k, c   (bending points) bending stiffness and viscosity
   !> w, v   (n) spline coefficients of displacement and velocity
   !> force  (n) generalized force
   pure subroutine subtract_bending_force(self, k, c, w, v, force)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: k(:), c(:), w(:), v(:)
      real(wp), intent(inout) :: force(:)
      real(wp) :: moment
      integer :: m, q

      do q = 1, size(k)
         associate (first => self%bent(q)%first, last => self%bent(q)%last)
            m = last - first + 1
            moment = k(q)*dot_product(self%curvature(:m, q), w(first:last)) &
               + c(q)*dot_product(self%curvature(:m, q), v(first:last))
            force(first:last) = force(first:last) - moment*self%curvature(:m, q)
         end associate
      end do
   end subroutine subtract_bending_force

   !> Returns the integral of f (w'')**2 over the beam [1/length], as accurately as
   !> `subtract_bending_force`.
   !>
   !> w       (n) spline coefficients of a displacement
   !> factor  (bending points) values of f; default: the known factor of the stiffness
   pure real(wp) function bending_energy(self, w, factor)
      class(galerkin_t), intent(in) :: self
      real(wp), intent(in) :: w(:)
      real(wp), intent(in), optional :: factor(:)

      if (present(factor)) then
         bending_energy = sum(factor*self%curvatures(w)**2)
      else
         bending_energy = sum(self%known(:, 1)*self%curvatures(w)**2)
      end if
   end function bending_energy

end module beamid_galerkin
