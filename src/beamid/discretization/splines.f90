!> The spline space V^N: B-splines of odd degree on a mesh of [0, l], combined so that every basis
!> function satisfies the essential boundary conditions at root and tip. For the clamped root of
!> Section 3 of CR-178199 these are phi(0) = phi'(0) = 0.
!>
!> The mesh is uniform, h = l/N. Where a property of the beam has a jump or a kink, w'' has one too;
!> an element then ends there, at a knot of the multiplicity that this continuity requires.
!>
!> B_j is scaled by degree!. For cubics on the uniform mesh this is the paper's scaling,
!> B_j(x_j) = 4, B_j(x_j +- h) = 1. As many B-splines as the degree do not vanish at an end. A
!> clamped end replaces them by combinations of three neighbours, for cubics
!> b_1 = B_0 - 2 B_1 - 2 B_{-1}, so that the Gram matrices keep the half-bandwidth `degree`. An end
!> with a single condition has one more function, a combination of the two outermost B-splines: for
!> cubics and phi(0) = 0, B_{-1} - B_0/4. A free end keeps all B-splines. The dimension is
!> N + degree less the number of conditions, plus one for each additional knot.
module beamid_splines
   use beamid_b_splines, only: b_splines
   use beamid_kinds, only: wp
   use beamid_knots, only: mesh_knots
   implicit none
   private

   public :: spline_space_t, new_spline_space, same_space

   !> The knot and the functions of one element.
   type :: span_t
      integer :: left = 0             !< index of the last knot at the left end of the element
      integer :: before = 0           !< number of B-splines whose support ends before the element
      integer :: first = 0, last = 0  !< first and last basis function that is nonzero on it
      logical :: is_plain = .false.   !< whether its basis functions are B-splines
   end type span_t

   !> The conditions of a beam with a clamped root and a free tip.
   logical, parameter, public :: clamped_root(2, 2) = reshape([.true., .true., .false., .false.], &
      [2, 2])

   !> Largest number of B-splines in a basis function: three at one end, if the mesh is so coarse
   !> that both ends meet combinations of combinations.
   integer, parameter :: widest = 5

   !> A spline space. At most degree + 1 consecutive basis functions are nonzero on an element.
   type :: spline_space_t
      integer :: degree = 0                    !< degree of the splines, odd, >= 3
      !> number of elements: the mesh intervals, and the parts into which breaks divide them
      integer :: elements = 0
      integer :: n = 0                         !< dimension
      !> (condition, end) whether the deflection (condition 1) or the rotation (2) is 0 at the root
      !> (end 1) or at the tip (2)
      logical :: essential(2, 2) = clamped_root
      real(wp) :: length = 0                   !< length l of the beam [length]
      real(wp), allocatable :: ends(:)         !< (0:elements) ends of the elements [length]
      real(wp), private :: scale = 1           !< mesh intervals per unit of x, N/l [1/length]
      real(wp), allocatable, private :: knots(:)      !< knots x N/l, ascending, 0 at the root
      type(span_t), allocatable, private :: span(:)   !< (0:elements - 1) of each element
      !> (n) first B-spline of each basis function, and (widest, n) the coefficients of this and the
      !> following B-splines
      integer, allocatable, private :: start(:)
      real(wp), allocatable, private :: weight(:, :)
   contains
      procedure :: first_on_element, last_on_element, on_element, element_of, at
   end type spline_space_t

contains

   !> Returns a spline space.
   !>
   !> degree        degree of the splines, odd, >= 3
   !> elements      number of mesh intervals N, >= 1
   !> length        length l of the beam, > 0 [length]
   !> essential     (condition, end) conditions as in `spline_space_t`; absent: root clamped, tip
   !>               free
   !> breaks        positions x/l, ascending, of knots in addition to those of the mesh; a break
   !>               replaces a mesh knot that is close to it
   !> multiplicity  multiplicity of each break, 1 .. degree - 1
   !> near          largest distance to a mesh knot that is replaced, < 0.5 [mesh intervals];
   !>               default 0.05
   pure function new_spline_space(degree, elements, length, essential, breaks, multiplicity, &
      near) result(space)
      integer, intent(in) :: degree, elements
      real(wp), intent(in) :: length
      logical, intent(in), optional :: essential(2, 2)
      real(wp), intent(in), optional :: breaks(:)
      integer, intent(in), optional :: multiplicity(:)
      real(wp), intent(in), optional :: near
      type(spline_space_t) :: space
      real(wp), allocatable :: nodes(:)
      integer, allocatable :: times(:)
      integer :: e, i

      space%degree = degree
      if (present(essential)) space%essential = essential
      space%length = length
      space%scale = elements/length
      call mesh_knots(elements, nodes, times, breaks, multiplicity, near)
      space%elements = size(nodes) - 1
      space%n = space%elements + sum(times - 1) + degree
      allocate (space%ends(0:space%elements), space%span(0:space%elements - 1))
      space%ends = nodes/elements*length
      space%ends(space%elements) = length
      ! The knots continue uniformly beyond the root and the tip.
      space%knots = [(real(i, wp), i=-degree, -1)]
      do e = 0, space%elements - 1
         space%knots = [space%knots, spread(nodes(e + 1), 1, times(e + 1))]
         space%span(e)%left = size(space%knots)
         space%span(e)%before = size(space%knots) - (degree + 1)
      end do
      space%knots = [space%knots, [(real(elements + i, wp), i=0, degree)]]

      space%start = [(i, i=1, space%n)]
      allocate (space%weight(widest, space%n), source=0.0_wp)
      space%weight(1, :) = 1
      call combine_at(space, 1)
      call combine_at(space, 2)
      space%n = size(space%start)
      call find_nonzero_functions(space)
   end function new_spline_space

   !> Returns whether two spaces of the same degree are equal.
   pure logical function same_space(a, b)
      type(spline_space_t), intent(in) :: a, b

      same_space = all(a%essential .eqv. b%essential) .and. size(a%knots) == size(b%knots) &
         .and. a%elements == b%elements
      if (same_space) same_space = all(abs(a%knots - b%knots) <= 0) .and. &
         abs(a%length - b%length) <= 0
   end function same_space

   !> Replaces the functions that do not vanish at an end by combinations that satisfy the
   !> conditions there.
   !>
   !> end  1: root, 2: tip
   pure subroutine combine_at(space, end)
      type(spline_space_t), intent(inout) :: space
      integer, intent(in) :: end
      integer, allocatable :: order(:), start(:)
      real(wp), allocatable :: weight(:, :)
      integer :: i

      order = [(i, i=1, size(space%start))]
      if (end == 2) order = order(size(order):1:-1)
      call combine(space%degree, space%essential(:, end), order, values_at_end(space, end), &
         space%start, space%weight, start, weight)
      order = [(i, i=1, size(start))]
      if (end == 2) order = order(size(order):1:-1)
      space%start = start(order)
      space%weight = weight(:, order)
   end subroutine combine_at

   !> Returns value and slope of all functions at an end, (2, functions).
   !>
   !> end  1: root, 2: tip
   pure function values_at_end(space, end) result(values)
      type(spline_space_t), intent(in) :: space
      integer, intent(in) :: end
      real(wp) :: values(2, size(space%start))
      real(wp) :: splines(space%degree + 1)
      integer :: c, d, element, i, k

      element = merge(0, space%elements - 1, end == 1)
      values = 0
      do d = 1, 2
         splines = plain(space, element, real(end - 1, wp), d - 1)
         ! The B-spline that vanishes at the end, up to round-off.
         splines(merge(space%degree + 1, 1, end == 1)) = 0
         do i = 1, size(space%start)
            do k = 1, widest
               c = space%start(i) + k - 1 - space%span(element)%before
               if (c < 1 .or. c > space%degree + 1) cycle
               values(d, i) = values(d, i) + space%weight(k, i)*splines(c)
            end do
         end do
      end do
   end function values_at_end

   !> Combines functions so that they satisfy the conditions at an end.
   !>
   !> essential      (2) whether the deflection and the rotation are 0
   !> order          (functions) numbers of the functions, from the end inwards
   !> values         (2, functions) values and slopes at the end
   !> start, weight  the functions
   !> new_start, new_weight  the combinations, from the end inwards
   pure subroutine combine(degree, essential, order, values, start, weight, new_start, new_weight)
      integer, intent(in) :: degree, order(:), start(:)
      logical, intent(in) :: essential(2)
      real(wp), intent(in) :: values(:, :), weight(:, :)
      integer, allocatable, intent(out) :: new_start(:)
      real(wp), allocatable, intent(out) :: new_weight(:, :)
      real(wp) :: determinant, outer(2)
      integer :: i, n, nonzero

      nonzero = 0
      if (any(essential)) nonzero = min(degree, size(order))
      n = size(order) - count(essential)
      allocate (new_start(max(n, 0)), new_weight(widest, max(n, 0)))
      if (n < 1) return
      n = 0
      associate (v => values(1, order), s => values(2, order))
         if (count(essential) == 1) then
            n = 1
            outer = [-merge(v(2), s(2), essential(1)), merge(v(1), s(1), essential(1))]
            call add_up(outer/outer(maxloc(abs(outer), dim=1)), start(order(:2)), &
               weight(:, order(:2)), new_start(1), new_weight(:, 1))
         end if
         do i = 1, nonzero - 2
            n = n + 1
            determinant = v(i)*s(i + 2) - v(i + 2)*s(i)
            call add_up([(v(i + 2)*s(i + 1) - v(i + 1)*s(i + 2))/determinant, 1.0_wp, &
               (v(i + 1)*s(i) - v(i)*s(i + 1))/determinant], start(order(i:i + 2)), &
               weight(:, order(i:i + 2)), new_start(n), new_weight(:, n))
         end do
         new_start(n + 1:) = start(order(nonzero + 1:))
         new_weight(:, n + 1:) = weight(:, order(nonzero + 1:))
      end associate

   end subroutine combine

   !> Computes a sum of coefficients times functions.
   !>
   !> starts, weights  the functions
   !> start, weight    the sum
   pure subroutine add_up(coefficients, starts, weights, start, weight)
      real(wp), intent(in) :: coefficients(:), weights(:, :)
      integer, intent(in) :: starts(:)
      integer, intent(out) :: start
      real(wp), intent(out) :: weight(:)
      integer :: j

      start = minval(starts)
      weight = 0
      do j = 1, size(starts)
         associate (shift => starts(j) - start)
            weight(shift + 1:) = weight(shift + 1:) + coefficients(j)*weights(:widest - shift, j)
         end associate
      end do
   end subroutine add_up

   !> Finds the basis functions that are nonzero on each element.
   pure subroutine find_nonzero_functions(space)
      type(spline_space_t), intent(inout) :: space
      integer :: e, finish(space%n), i

      finish = [(space%start(i) - 1 + findloc(abs(space%weight(:, i)) > 0, .true., dim=1, &
         back=.true.), i=1, space%n)]
      do e = 0, space%elements - 1
         associate (span => space%span(e))
            span%first = findloc(finish > span%before, .true., dim=1)
            span%last = findloc(space%start <= span%before + space%degree + 1, .true., dim=1, &
               back=.true.)
            associate (i => span%first, j => span%last)
               span%is_plain = j - i == space%degree .and. all(finish(i:j) == space%start(i:j)) &
                  .and. all(abs(space%weight(1, i:j) - 1) <= 0)
            end associate
         end associate
      end do
   end subroutine find_nonzero_functions

   !> Returns the index of the first basis function that is nonzero on an element.
   !>
   !> element  0 .. elements - 1; the element is [ends(element), ends(element + 1)]
   pure integer function first_on_element(self, element)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element

      first_on_element = self%span(element)%first
   end function first_on_element

   !> Returns the index of the last basis function that is nonzero on an element.
   pure integer function last_on_element(self, element)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element

      last_on_element = self%span(element)%last
   end function last_on_element

   !> Returns the element that contains a position.
   !>
   !> x  position, 0 .. l [length]
   pure integer function element_of(self, x) result(element)
      class(spline_space_t), intent(in) :: self
      real(wp), intent(in) :: x

      element = min(max(int(x*self%scale), 0), self%elements - 1)
      do while (element > 0)
         if (x >= self%ends(element)) exit
         element = element - 1
      end do
      do while (element < self%elements - 1)
         if (x < self%ends(element + 1)) exit
         element = element + 1
      end do
   end function element_of

   !> Returns a derivative of the basis functions that are nonzero on an element.
   !>
   !> element     0 .. elements - 1
   !> s           relative position in the element, 0 .. 1
   !> derivative  order of the derivative, 0 .. degree
   !> values      (degree + 1) functions first_on_element, first_on_element + 1, ..., and zeros
   !>             after the last function of the element [1/length**derivative]
   pure function on_element(self, element, s, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(self%degree + 1)

      values = plain(self, element, s, derivative)
      if (.not. self%span(element)%is_plain) values = combined(self, element, values)
   end function on_element

   !> Returns the values of the basis functions on an element, (degree + 1), as `on_element` does,
   !> from those of the B-splines.
   pure function combined(self, element, splines) result(values)
      type(spline_space_t), intent(in) :: self
      integer, intent(in) :: element
      real(wp), intent(in) :: splines(:)
      real(wp) :: values(size(splines))
      integer :: c, i, k

      values = 0
      associate (span => self%span(element))
         do i = span%first, span%last
            do k = 1, widest
               c = self%start(i) + k - 1 - span%before
               if (c >= 1 .and. c <= self%degree + 1) values(i - span%first + 1) = &
                  values(i - span%first + 1) + self%weight(k, i)*splines(c)
            end do
         end do
      end associate
   end function combined

   !> Returns a derivative of all basis functions at one position; at a knot where it jumps, the
   !> mean of both sides. The derivative of a response with respect to the position of a moment
   !> contains this mean of the second derivative.
   !>
   !> x           position, 0 .. l [length]
   !> derivative  order of the derivative, 0 .. degree
   !> values      (n) values of the derivative [1/length**derivative]
   pure function at(self, x, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      real(wp), intent(in) :: x
      integer, intent(in) :: derivative
      real(wp) :: values(self%n)
      integer :: element, k

      element = self%element_of(x)
      values = beside(self, element, x, derivative)
      if (derivative < 2) return
      k = element + merge(0, 1, x - self%ends(element) < self%ends(element + 1) - x)
      if (k < 1 .or. k >= self%elements) return
      if (abs(x - self%ends(k)) > 1e-9_wp*self%length) return
      if (self%span(k)%left - self%span(k - 1)%left < 2) return
      values = (beside(self, k - 1, x, derivative) + beside(self, k, x, derivative))/2
   end function at

   !> Returns a derivative of all basis functions at a position, as continued from one element.
   pure function beside(self, element, x, derivative) result(values)
      type(spline_space_t), intent(in) :: self
      integer, intent(in) :: element, derivative
      real(wp), intent(in) :: x
      real(wp) :: values(self%n), local(self%degree + 1)

      associate (left => self%ends(element), right => self%ends(element + 1), &
         first => self%span(element)%first, last => self%span(element)%last)
         local = self%on_element(element, (x - left)/(right - left), derivative)
         values = 0
         values(first:last) = local(:last - first + 1)
      end associate
   end function beside

   !> Returns a derivative of the degree + 1 B-splines that are nonzero on an element, from left to
   !> right, before they are combined at the ends.
   pure function plain(self, element, s, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(self%degree + 1)

      associate (m => self%span(element)%left, p => self%degree)
         values = b_splines(self%knots(m - p + 1:m + p) - self%knots(m), &
            s*(self%knots(m + 1) - self%knots(m)), derivative)
         values = values*self%scale**derivative
      end associate
   end function plain

end module beamid_splines
