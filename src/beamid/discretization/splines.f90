!> The spline space V^N: B-splines of odd degree on a mesh of [0, l], combined so that every basis
!> function satisfies the essential boundary conditions of a clamped root, phi(0) = phi'(0) = 0
!> (Section 3 of CR-178199).
!>
!> The mesh is uniform, h = l/N. Where a property of the beam has a jump or a kink, w'' has one too;
!> an element then ends there, at a knot of the multiplicity that this continuity requires.
!>
!> B_j is scaled by degree!. For cubics on the uniform mesh this is the paper's scaling,
!> B_j(x_j) = 4, B_j(x_j +- h) = 1. As many B-splines as the degree do not vanish at the root. They
!> are replaced by combinations of three neighbours, for cubics b_1 = B_0 - 2 B_1 - 2 B_{-1}, so
!> that the Gram matrices keep the half-bandwidth `degree`. The dimension is N + degree - 2, plus
!> one for each additional knot.
!>
!> If the root may rotate (phi(0) = 0 is the only condition), the basis has one more function, the
!> first: for cubics B_{-1} - B_0/4.
module beamid_splines
   use beamid_b_splines, only: b_splines
   use beamid_kinds, only: wp
   implicit none
   private

   public :: spline_space_t, new_spline_space

   !> A spline space. At most degree + 1 consecutive basis functions are nonzero on an element.
   type :: spline_space_t
      integer :: degree = 0                    !< degree of the splines, odd, >= 3
      !> number of elements: the mesh intervals, and the parts into which breaks divide them
      integer :: elements = 0
      integer :: n = 0                         !< dimension
      integer :: root_rotation = 0                   !< 1: the root may rotate; 0: it is clamped
      real(wp) :: length = 0                   !< length l of the beam [length]
      real(wp), allocatable :: ends(:)         !< (0:elements) ends of the elements [length]
      real(wp), private :: scale = 1           !< mesh intervals per unit of x, N/l [1/length]
      real(wp), allocatable, private :: knots(:)      !< knots x N/l, ascending, 0 at the root
      !> (0:elements - 1) index of the last knot at the left end of an element
      integer, allocatable, private :: left(:)
      !> (0:elements - 1) number of B-splines whose support ends before an element
      integer, allocatable, private :: before(:)
      !> (degree - 2, 3) row i: coefficients of the B-splines i, i + 1, i + 2, counted from the
      !> root, in the combination b_i
      real(wp), allocatable, private :: root(:, :)
   contains
      procedure :: first_on_element, last_on_element, on_element, element_of, at
      procedure, private :: plain
   end type spline_space_t

contains

   !> Returns a spline space.
   !>
   !> degree        degree of the splines, odd, >= 3
   !> elements      number of mesh intervals N, >= 1
   !> length        length l of the beam, > 0 [length]
   !> root_rotation       whether the root may rotate; default .false.
   !> breaks        positions x/l, ascending, of knots in addition to those of the mesh; a break
   !>               replaces a mesh knot that is close to it
   !> multiplicity  multiplicity of each break, 1 .. degree - 1
   pure function new_spline_space(degree, elements, length, root_rotation, breaks, multiplicity) &
      result(space)
      integer, intent(in) :: degree, elements
      real(wp), intent(in) :: length
      logical, intent(in), optional :: root_rotation
      real(wp), intent(in), optional :: breaks(:)
      integer, intent(in), optional :: multiplicity(:)
      type(spline_space_t) :: space
      real(wp) :: value(degree + 1), slope(degree + 1), determinant
      real(wp), allocatable :: nodes(:)
      integer, allocatable :: times(:)
      integer :: e, i

      space%degree = degree
      if (present(root_rotation)) space%root_rotation = merge(1, 0, root_rotation)
      space%length = length
      space%scale = elements/length
      call mesh_knots(elements, nodes, times, breaks, multiplicity)
      space%elements = size(nodes) - 1
      space%n = space%elements + sum(times - 1) + degree - 2 + space%root_rotation
      allocate (space%ends(0:space%elements), space%left(0:space%elements - 1), &
         space%before(0:space%elements - 1))
      space%ends = nodes/elements*length
      space%ends(space%elements) = length
      ! The knots continue uniformly beyond the root and the tip.
      space%knots = [(real(i, wp), i=-degree, -1)]
      do e = 0, space%elements - 1
         space%knots = [space%knots, spread(nodes(e + 1), 1, times(e + 1))]
         space%left(e) = size(space%knots)
         space%before(e) = space%left(e) - (degree + 1)
      end do
      space%knots = [space%knots, [(real(elements + i, wp), i=0, degree)]]

      ! value(i) and slope(i) are those of B-spline i at the root, i = 1 .. degree. The combination
      ! of three neighbours, the middle one with coefficient 1, has value and slope 0.
      value = space%plain(0, 0.0_wp, 0)
      slope = space%plain(0, 0.0_wp, 1)
      allocate (space%root(degree - 2, 3))
      do i = 1, degree - 2
         determinant = value(i)*slope(i + 2) - value(i + 2)*slope(i)
         space%root(i, 1) = (value(i + 2)*slope(i + 1) - value(i + 1)*slope(i + 2))/determinant
         space%root(i, 2) = 1
         space%root(i, 3) = (value(i + 1)*slope(i) - value(i)*slope(i + 1))/determinant
      end do
   end function new_spline_space

   !> Computes the ends of the elements, in mesh intervals from the root. A break replaces the
   !> nearest node of the mesh if it is within a twentieth of an interval; otherwise it is an
   !> additional node.
   !>
   !> nodes  (:) ends of elements, ascending from 0 to `elements`
   !> times  (:) multiplicity of the knot at each node
   pure subroutine mesh_knots(elements, nodes, times, breaks, multiplicity)
      integer, intent(in) :: elements
      real(wp), allocatable, intent(out) :: nodes(:)
      integer, allocatable, intent(out) :: times(:)
      real(wp), intent(in), optional :: breaks(:)
      integer, intent(in), optional :: multiplicity(:)
      real(wp), parameter :: near = 0.05_wp, same = 1e-9_wp
      logical :: taken(0:elements)
      real(wp) :: x
      integer :: i, j, k

      nodes = [(real(i, wp), i=0, elements)]
      times = [(1, i=0, elements)]
      if (.not. present(breaks)) return
      taken = .false.
      taken([0, elements]) = .true.
      do k = 1, size(breaks)
         x = breaks(k)*elements
         if (.not. (x > same .and. x < elements - same)) cycle
         j = nint(x)
         if (abs(x - j) <= near .and. .not. taken(j)) then
            taken(j) = .true.
            i = minloc(abs(nodes - j), dim=1)
            nodes(i) = x
            times(i) = multiplicity(k)
         else
            i = count(nodes < x)
            nodes = [nodes(:i), x, nodes(i + 1:)]
            times = [times(:i), multiplicity(k), times(i + 1:)]
         end if
      end do
   end subroutine mesh_knots

   !> Returns the index of the first basis function that is nonzero on an element.
   !>
   !> element  0 .. elements - 1; the element is [ends(element), ends(element + 1)]
   pure integer function first_on_element(self, element)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element

      first_on_element = max(1, self%before(element) - 1 + self%root_rotation)
   end function first_on_element

   !> Returns the index of the last basis function that is nonzero on an element.
   pure integer function last_on_element(self, element)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element

      last_on_element = self%before(element) + self%degree - 1 + self%root_rotation
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
      real(wp) :: plain(self%degree + 1), at_root(self%degree + 1)
      integer :: i, c, k, row, first, functions

      plain = self%plain(element, s, derivative)
      associate (before => self%before(element))
         if (before >= self%degree) then
            values = plain
            return
         end if

         ! plain(c) is B-spline number before + c; b_i is B-spline number i + 2 for i > degree - 2.
         values = 0
         first = max(1, before - 1)
         do row = 1, before + self%degree - first
            i = first + row - 1
            if (i > self%degree - 2) then
               values(row) = plain(i - before + 2)
            else
               do k = 1, 3
                  c = i + k - 1 - before
                  if (c >= 1) values(row) = values(row) + self%root(i, k)*plain(c)
               end do
            end if
         end do
         if (self%root_rotation == 0 .or. before > 1) return
         ! The first basis function, which rotates the root, is nonzero on the first two elements.
         functions = before + self%degree - 1
         values(2:functions + 1) = values(:functions)
         at_root = self%plain(0, 0.0_wp, 0)
         if (before == 0) values(1) = plain(1) - at_root(1)/at_root(2)*plain(2)
         if (before == 1) values(1) = -at_root(1)/at_root(2)*plain(1)
      end associate
   end function on_element

   !> Returns a derivative of all basis functions at one position.
   !>
   !> x           position, 0 .. l [length]
   !> derivative  order of the derivative, 0 .. degree
   !> values      (n) values of the derivative [1/length**derivative]
   pure function at(self, x, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      real(wp), intent(in) :: x
      integer, intent(in) :: derivative
      real(wp) :: values(self%n)
      real(wp) :: local(self%degree + 1)
      integer :: element, first, last

      element = self%element_of(x)
      first = self%first_on_element(element)
      last = self%last_on_element(element)
      associate (left => self%ends(element), right => self%ends(element + 1))
         local = self%on_element(element, (x - left)/(right - left), derivative)
      end associate
      values = 0
      values(first:last) = local(:last - first + 1)
   end function at

   !> Returns a derivative of the degree + 1 B-splines that are nonzero on an element, from left to
   !> right, before they are combined at the root.
   pure function plain(self, element, s, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(self%degree + 1)

      associate (m => self%left(element), p => self%degree)
         values = b_splines(self%knots(m - p + 1:m + p) - self%knots(m), &
            s*(self%knots(m + 1) - self%knots(m)), derivative)*self%scale**derivative
      end associate
   end function plain

end module beamid_splines
