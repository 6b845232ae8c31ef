!> Properties that vary along the beam: those that are known, by values at places, and those that a
!> fit looks for, by the coefficients of B-splines.
!>
!> What is known multiplies: a property is its parameter times a factor of xi = x/l, 1 where nothing
!> is said. Bending by a section of width b and height h goes with b h**3, and the mass per length,
!> where that is density b h, with b h.
module beamid_variations
   use beamid_b_splines, only: cardinal
   use beamid_kinds, only: wp
   use beamid_quadrature, only: gauss_legendre, rule_t
   implicit none
   private

   public :: variation_t, new_variation, field_t, variations_t, constant, in_steps, in_lines, &
      as_spline, of_E_x, of_c_D_x

   !> How a factor goes between its places: it keeps the value of the last one, or on straight
   !> lines, or as the natural cubic spline.
   integer, parameter :: constant = 0, in_steps = 1, in_lines = 2, as_spline = 3

   !> The functions of x that a fit looks for, in the order of all that comes in pairs of them.
   integer, parameter :: of_E_x = 1, of_c_D_x = 2

   !> A factor that is known.
   type :: variation_t
      integer :: kind = constant
      real(wp), allocatable :: xi(:)       !< places, ascending, from 0 on
      real(wp), allocatable :: factor(:)   !< there
      real(wp), allocatable, private :: bend(:)   !< second derivative of the spline there
   contains
      procedure :: at
   end type variation_t

   !> A property as a sum over B-splines on a uniform mesh of its own; these add up to one.
   type :: field_t
      integer :: coefficients = 0            !< how many there are; 0: the property is its parameter
      integer :: degree = 3                  !< 3, or 1: on straight lines
      real(wp), allocatable :: value(:)      !< (coefficients); not allocated: all its parameter
   contains
      procedure :: shares
      procedure :: places
   end type field_t

   type :: variations_t
      type(variation_t) :: E = variation_t(), c_D = variation_t(), rho = variation_t(), &
         gamma = variation_t(), width = variation_t(), height = variation_t()
      logical :: by_density = .false.        !< the mass goes with width and height
      type(field_t) :: along(2) = field_t()   !< what a fit looks for: E(x) and c_D(x)
      logical :: dips = .false.              !< the stiffness has a dip, or a fit looks for one
   contains
      procedure :: bending
      procedure :: viscous
      procedure :: mass
      procedure :: mass_beyond
      procedure :: air
      procedure :: are_known
      procedure :: breaks
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

   !> kind    in_steps, in_lines or as_spline
   !> xi      (n) ascending, from 0; but for steps to 1
   !> factor  (n)
   function new_variation(kind, xi, factor) result(self)
      integer, intent(in) :: kind
      real(wp), intent(in) :: xi(:), factor(:)
      type(variation_t) :: self
      real(wp), allocatable :: h(:), slope(:), diagonal(:), beside(:), b(:, :)
      integer :: info, n

      self%kind = kind
      self%xi = xi
      self%factor = factor
      n = size(xi)
      if (kind /= as_spline) return
      allocate (self%bend(n), source=0.0_wp)
      if (n < 3) return
      h = xi(2:) - xi(:n - 1)
      slope = (factor(2:) - factor(:n - 1))/h
      diagonal = 2*(h(:n - 2) + h(2:))
      beside = [h(2:n - 2), 0.0_wp]
      b = reshape(6*(slope(2:) - slope(:n - 2)), [n - 2, 1])
      call dptsv(n - 2, 1, diagonal, beside, b, n - 2, info)
      self%bend(2:n - 1) = b(:, 1)
   end function new_variation

   !> xi  x/l, 0 .. 1
   pure real(wp) function at(self, xi) result(factor)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: xi
      real(wp) :: a, b, h
      integer :: k, n

      factor = 1
      if (self%kind == constant) return
      n = size(self%xi)
      k = max(1, count(self%xi <= xi))
      if (self%kind == in_steps) then
         factor = self%factor(k)
         return
      end if
      k = min(k, n - 1)
      h = self%xi(k + 1) - self%xi(k)
      b = (xi - self%xi(k))/h
      a = 1 - b
      factor = a*self%factor(k) + b*self%factor(k + 1)
      if (self%kind == as_spline) factor = factor &
         + ((a**3 - a)*self%bend(k) + (b**3 - b)*self%bend(k + 1))*h**2/6
   end function at

   !> How much each coefficient counts at a place.
   !>
   !> xi      x/l, 0 .. 1
   !> shares  (coefficients), of sum 1; none where there are none
   pure function shares(self, xi)
      class(field_t), intent(in) :: self
      real(wp), intent(in) :: xi
      real(wp) :: shares(self%coefficients)
      integer :: element, elements

      shares = 0
      if (self%coefficients == 0) return
      elements = self%coefficients - self%degree
      element = min(max(int(xi*elements), 0), elements - 1)
      shares(element + 1:element + self%degree + 1) = cardinal(self%degree, 0, &
         xi*elements - element)/gamma(self%degree + 1.0_wp)
   end function shares

   !> Where each coefficient sits: a straight line has its own values there as coefficients. Those
   !> of the first and the last lie beyond the ends.
   pure function places(self)
      class(field_t), intent(in) :: self
      real(wp) :: places(self%coefficients)
      integer :: j

      places = [((j - (self%degree + 1)/2.0_wp)/(self%coefficients - self%degree), &
         j=1, self%coefficients)]
   end function places

   !> Factor of the bending stiffness E I.
   pure real(wp) function bending(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      bending = self%E%at(xi)*self%width%at(xi)*self%height%at(xi)**3
   end function bending

   !> Of c_D I.
   pure real(wp) function viscous(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      viscous = self%c_D%at(xi)*self%width%at(xi)*self%height%at(xi)**3
   end function viscous

   !> Of the mass per length.
   pure real(wp) function mass(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      mass = self%rho%at(xi)
      if (self%by_density) mass = mass*self%width%at(xi)*self%height%at(xi)
   end function mass

   !> Integral of that from a place to the tip, which is the weight that hangs there.
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

   !> Of the air damping.
   pure real(wp) function air(self, xi)
      class(variations_t), intent(in) :: self
      real(wp), intent(in) :: xi

      air = self%gamma%at(xi)
   end function air

   !> Whether anything is known to vary.
   pure logical function are_known(self)
      class(variations_t), intent(in) :: self

      are_known = any([self%E%kind, self%c_D%kind, self%rho%kind, self%gamma%kind, &
         self%width%kind, self%height%kind] /= constant)
   end function are_known

   !> Where integrals have to be split, and how many knots w asks for there. What bends may jump, m
   !> = -1, have a kink, 0, or be smooth up to derivative m: so is w'' = M/(E I), and a spline of
   !> degree p has to have p - 2 - m knots; by mass and air damping, which bend w'''', p - 4 - m.
   !>
   !> degree  of the splines
   !> xi      (breaks) ascending, within 0 .. 1
   !> knots   (breaks) 0: none
   pure subroutine breaks(self, degree, xi, knots)
      class(variations_t), intent(in) :: self
      integer, intent(in) :: degree
      real(wp), allocatable, intent(out) :: xi(:)
      integer, allocatable, intent(out) :: knots(:)
      integer :: a

      allocate (xi(0), knots(0))
      call add_variation(self%E, 2, degree, xi, knots)
      call add_variation(self%c_D, 2, degree, xi, knots)
      call add_variation(self%width, 2, degree, xi, knots)
      call add_variation(self%height, 2, degree, xi, knots)
      call add_variation(self%rho, 4, degree, xi, knots)
      call add_variation(self%gamma, 4, degree, xi, knots)
      do a = 1, size(self%along)
         call add_field(self%along(a), degree, xi, knots)
      end do
   end subroutine breaks

   !> order  of the derivative of w that it bends
   pure subroutine add_variation(variation, order, degree, xi, knots)
      type(variation_t), intent(in) :: variation
      integer, intent(in) :: order, degree
      real(wp), allocatable, intent(inout) :: xi(:)
      integer, allocatable, intent(inout) :: knots(:)
      integer, parameter :: smooth(in_steps:as_spline) = [-1, 0, 2]
      integer :: k

      if (variation%kind == constant) return
      do k = 2, size(variation%xi)
         call add(variation%xi(k), degree - order - smooth(variation%kind), xi, knots)
      end do
   end subroutine add_variation

   pure subroutine add_field(field, degree, xi, knots)
      type(field_t), intent(in) :: field
      integer, intent(in) :: degree
      real(wp), allocatable, intent(inout) :: xi(:)
      integer, allocatable, intent(inout) :: knots(:)
      integer :: k, elements

      elements = field%coefficients - field%degree
      do k = 1, elements - 1
         call add(real(k, wp)/elements, degree - 1 - field%degree, xi, knots)
      end do
   end subroutine add_field

   !> One more place, or more knots at one that is there.
   pure subroutine add(place, times, xi, knots)
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
   end subroutine add

end module beamid_variations
