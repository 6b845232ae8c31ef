!> Properties that vary along the beam: known variation, given by values at positions, and fields
!> that a fit estimates, given by the coefficients of B-splines.
!>
!> Known variation is a factor: a property is its parameter times a function of xi = x/l, which is 1
!> by default. For a cross section of width b and height h, the bending stiffness and the bending
!> viscosity vary like b h**3, and the mass per length varies like b h if rho is density b h.
module beamid_variations
   use beamid_b_splines, only: cardinal
   use beamid_kinds, only: wp
   use beamid_quadrature, only: gauss_legendre, rule_t
   implicit none
   private

   public :: add_break, variation_t, new_variation, field_t, variations_t, constant, in_steps, &
      in_lines, &
      as_spline, field_modulus, field_viscosity

   !> Interpolation of a factor between its positions: constant 1; the value at the last position
   !> before; piecewise linear; the natural cubic spline.
   integer, parameter :: constant = 0, in_steps = 1, in_lines = 2, as_spline = 3

   !> The functions of x that a fit may estimate. Arrays with an entry for each function use this
   !> order.
   integer, parameter :: field_modulus = 1, field_viscosity = 2

   !> The quantities that may have a known factor, and their names. Arrays with an entry for each of
   !> them use this order.
   integer, parameter, public :: known_E = 1, known_c_D = 2, known_rho = 3, known_gamma = 4, &
      known_width = 5, known_height = 6
   character(len=*), parameter, public :: known_names(6) = [character(len=6) :: 'E', 'c_D', 'rho', &
      'gamma', 'width', 'height']
   !> Which derivative of w each quantity determines: 2 for those of the bending stiffness and
   !> viscosity, 4 for mass and air damping.
   integer, parameter :: order_of(size(known_names)) = [2, 2, 4, 4, 2, 2]

   !> A known factor of a property, a function of xi = x/l.
   type :: variation_t
      integer :: kind = constant   !< interpolation, `constant` .. `as_spline`
      !> (n, 3) columns: positions x/l, ascending from 0; the factor there; its second derivatives,
      !> 0 unless `kind` is `as_spline`. Not allocated if `kind` is `constant`. One array, because
      !> every structure contains six variations.
      real(wp), allocatable :: table(:, :)
   contains
      procedure :: at
   end type variation_t

   !> A property to be estimated: a sum of B-splines on its own uniform mesh. The B-splines add up
   !> to 1.
   type :: field_t
      !> number of coefficients; 0: the property is uniform, equal to its parameter
      integer :: coefficients = 0
      integer :: degree = 3                  !< degree of the B-splines: 3, or 1 (piecewise linear)
      !> (coefficients) [unit of the property]; not allocated: all equal the parameter
      real(wp), allocatable :: value(:)
   contains
      procedure :: shares, places
   end type field_t

   !> All variation along the beam, known and estimated.
   type :: variations_t
      !> known factor of each quantity, index `known_E` .. `known_height`
      type(variation_t) :: known(size(known_names)) = variation_t()
      logical :: by_density = .false.        !< the mass per length varies with width and height
      type(field_t) :: along(2) = field_t()  !< estimated fields: E(x), c_D(x)
      logical :: dips = .false.              !< the stiffness has a dip, or may have one in a fit
   contains
      procedure :: bending, viscous, mass, mass_beyond, air, are_known, breaks
   end type variations_t

   interface
      subroutine dptsv(n, nrhs, d, e, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, ldb
         real(wp), intent(inout) :: d(*), e(*), b(ldb, *)
         integer, intent(out) :: info
      end subroutine dptsv
   end interface

contains

   !> Returns a known factor from its values at positions.
   !>
   !> kind    interpolation: in_steps, in_lines or as_spline
   !> xi      (n) positions x/l, ascending from 0; to 1, except for steps
   !> factor  (n) values at the positions
   function new_variation(kind, xi, factor) result(self)
      integer, intent(in) :: kind
      real(wp), intent(in) :: xi(:), factor(:)
      type(variation_t) :: self
      real(wp), allocatable :: h(:), slope(:), diagonal(:), off_diagonal(:), b(:, :)
      integer :: info, n

      n = size(xi)
      self%kind = kind
      self%table = reshape([xi, factor, spread(0.0_wp, 1, n)], [n, 3])
      if (kind /= as_spline .or. n < 3) return
      h = xi(2:) - xi(:n - 1)
      slope = (factor(2:) - factor(:n - 1))/h
      diagonal = 2*(h(:n - 2) + h(2:))
      off_diagonal = [h(2:n - 2), 0.0_wp]
      b = reshape(6*(slope(2:) - slope(:n - 2)), [n - 2, 1])
      call dptsv(n - 2, 1, diagonal, off_diagonal, b, n - 2, info)
      self%table(2:n - 1, 3) = b(:, 1)
   end function new_variation

   !> Returns the factor at one position.
   !>
   !> xi  position x/l, 0 .. 1
   pure real(wp) function at(self, xi) result(factor)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: xi
      real(wp) :: a, b, h
      integer :: k, n

      factor = 1
      if (self%kind == constant) return
      associate (places => self%table(:, 1), values => self%table(:, 2), second => self%table(:, 3))
         n = size(places)
         k = max(1, count(places <= xi))
         if (self%kind == in_steps) then
            factor = values(k)
            return
         end if
         k = min(k, n - 1)
         h = places(k + 1) - places(k)
         b = (xi - places(k))/h
         a = 1 - b
         factor = a*values(k) + b*values(k + 1)
         if (self%kind == as_spline) factor = factor &
            + ((a**3 - a)*second(k) + (b**3 - b)*second(k + 1))*h**2/6
      end associate
   end function at

   !> Returns the values of the B-splines at one position: the weights of the coefficients.
   !>
   !> xi      position x/l, 0 .. 1
   !> shares  (coefficients) weights, of sum 1
   pure function shares(self, xi)
      class(field_t), intent(in) :: self
      real(wp), intent(in) :: xi
      real(wp) :: shares(self%coefficients)
      integer :: element, elements, k

      shares = 0
      if (self%coefficients == 0) return
      elements = self%coefficients - self%degree
      element = min(max(int(xi*elements), 0), elements - 1)
      shares(element + 1:element + self%degree + 1) = cardinal(self%degree, 0, &
         xi*elements - element)/product([(k, k=1, self%degree)])
   end function shares

   !> Returns the position x/l that belongs to each coefficient (the Greville abscissa): a linear
   !> function has its values at these positions as coefficients. The first and the last position
   !> may lie beyond the ends of the beam.
   pure function places(self)
      class(field_t), intent(in) :: self
      real(wp) :: places(self%coefficients)
      integer :: j

      places = [((j - (self%degree + 1)/2.0_wp)/(self%coefficients - self%degree), &
         j=1, self%coefficients)]
   end function places

   !> Returns the known factor of the bending stiffness E I at xi = x/l.
   pure real(wp) function bending(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      bending = self%known(known_E)%at(xi)*second_moment(self, xi)
   end function bending

   !> Returns the known factor of the bending viscosity c_D I at xi = x/l.
   pure real(wp) function viscous(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      viscous = self%known(known_c_D)%at(xi)*second_moment(self, xi)
   end function viscous

   !> Returns the known factor of the second moment of area at xi = x/l.
   pure real(wp) function second_moment(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      second_moment = self%known(known_width)%at(xi)*self%known(known_height)%at(xi)**3
   end function second_moment

   !> Returns the known factor of the mass per length at xi = x/l.
   pure real(wp) function mass(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      mass = self%known(known_rho)%at(xi)
      if (self%by_density) mass = mass*self%known(known_width)%at(xi) &
         *self%known(known_height)%at(xi)
   end function mass

   !> Returns the integral of `mass` from xi = x/l to the tip: the mass of the beam beyond this
   !> position, divided by rho l. Its weight acts there as an axial force.
   pure real(wp) function mass_beyond(self, xi) result(integral)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi
      type(rule_t) :: rule
      real(wp), allocatable :: ends(:)
      integer, allocatable :: knots(:)
      integer :: k, q

      integral = 1 - xi
      if (.not. self%are_known()) return
      call self%breaks(3, ends, knots)
      ends = [xi, pack(ends, ends > xi), 1.0_wp]
      rule = gauss_legendre(8)
      integral = 0
      do k = 1, size(ends) - 1
         associate (h => ends(k + 1) - ends(k))
            do q = 1, size(rule%points)
               integral = integral + h*rule%weights(q)*self%mass(ends(k) + h*rule%points(q))
            end do
         end associate
      end do
   end function mass_beyond

   !> Returns the known factor of the air damping at xi = x/l.
   pure real(wp) function air(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      air = self%known(known_gamma)%at(xi)
   end function air

   !> Returns whether any property has known variation.
   pure logical function are_known(self)
      class(variations_t), intent(in) :: self

      are_known = any(self%known%kind /= constant)
   end function are_known

   !> Computes the positions at which integrals must be split, and the number of knots that the
   !> splines need there.
   !>
   !> Let a property have m continuous derivatives at a position (m = -1: a jump, m = 0: a kink). If
   !> the property is E I or c_D I, then w'' = M/(E I) is smooth to the same order, and a spline of
   !> degree p needs p - 2 - m knots. If the property is mass or air damping, which determine w'''',
   !> the spline needs p - 4 - m knots.
   !>
   !> degree  degree p of the splines
   !> xi      (breaks) positions x/l, ascending, strictly between 0 and 1
   !> knots   (breaks) number of knots at each position, 0 or more
   pure subroutine breaks(self, degree, xi, knots)
      class(variations_t), intent(in) :: self
      integer, intent(in) :: degree
      real(wp), allocatable, intent(out) :: xi(:)
      integer, allocatable, intent(out) :: knots(:)
      integer :: a

      allocate (xi(0), knots(0))
      do a = 1, size(self%known)
         call add_variation(self%known(a), order_of(a), degree, xi, knots)
      end do
      do a = 1, size(self%along)
         call add_field(self%along(a), degree, xi, knots)
      end do
   end subroutine breaks

   !> Adds the positions of a known factor.
   !>
   !> order  order of the derivative of w that the property determines: 2 for bending, 4 for mass
   !>        and air damping
   pure subroutine add_variation(variation, order, degree, xi, knots)
      type(variation_t), intent(in) :: variation
      integer, intent(in) :: order, degree
      real(wp), allocatable, intent(inout) :: xi(:)
      integer, allocatable, intent(inout) :: knots(:)
      integer, parameter :: smooth(in_steps:as_spline) = [-1, 0, 2]
      integer :: k

      if (variation%kind == constant) return
      do k = 2, size(variation%table, 1)
         call add_break(variation%table(k, 1), degree - order - smooth(variation%kind), xi, knots)
      end do
   end subroutine add_variation

   !> Adds the interior knots of an estimated field.
   pure subroutine add_field(field, degree, xi, knots)
      type(field_t), intent(in) :: field
      integer, intent(in) :: degree
      real(wp), allocatable, intent(inout) :: xi(:)
      integer, allocatable, intent(inout) :: knots(:)
      integer :: k, elements

      elements = field%coefficients - field%degree
      do k = 1, elements - 1
         call add_break(real(k, wp)/elements, degree - 1 - field%degree, xi, knots)
      end do
   end subroutine add_field

   !> Adds a position with a number of knots. If the position is in the list already, its number of
   !> knots becomes the larger one. The ends of the beam are not added.
   pure subroutine add_break(place, times, xi, knots)
      real(wp), intent(in) :: place
      integer, intent(in) :: times
      real(wp), allocatable, intent(inout) :: xi(:)
      integer, allocatable, intent(inout) :: knots(:)
      real(wp), parameter :: same = 1e-9_wp
      integer :: k

      if (.not. (place > same .and. place < 1 - same)) return
      k = count(xi < place + same)
      if (k > 0) then
         if (xi(k) > place - same) then
            knots(k) = max(knots(k), times)
            return
         end if
      end if
      xi = [xi(:k), place, xi(k + 1:)]
      knots = [knots(:k), max(times, 0), knots(k + 1:)]
   end subroutine add_break

end module beamid_variations
