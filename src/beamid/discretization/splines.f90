!> B-splines of odd degree on a uniform mesh of [0, l], combined so that every function satisfies
!> the essential conditions of a clamped root, phi(0) = phi'(0) = 0 (Section 3 of CR-178199).
!>
!> With h = l/N, B_j is centred at x_j = j h and scaled by degree!, which for cubics is the paper's
!> B_j(x_j) = 4, B_j(x_j +- h) = 1. The degree functions that do not vanish at the root are replaced
!> by local combinations of three neighbours, for cubics b_1 = B_0 - 2 B_1 - 2 B_{-1}, so that the
!> Gram matrices keep half-bandwidth = degree. The dimension is N + degree - 2.
!>
!> A root that may turn (phi(0) = 0 alone) adds one function in front, for cubics B_{-1} - B_0/4.
module beamid_splines
   use beamid_kinds, only: wp
   implicit none
   private

   public :: spline_space_t, new_spline_space, cardinal

   !> Functions that may be nonzero on one element: at most degree + 1, consecutive.
   type :: spline_space_t
      integer :: degree = 0                    !< odd, >= 3
      integer :: elements = 0                  !< N
      integer :: n = 0                         !< dimension
      integer :: turning = 0                   !< 1: the root may turn; 0: clamped
      real(wp) :: length = 0                   !< l
      !> Row i: the coefficients of B_{k}, B_{k+1}, B_{k+2}, k = i - (degree+1)/2, in b_i, i <=
      !> degree-2.
      real(wp), allocatable, private :: root(:, :)
   contains
      procedure :: first_on_element
      procedure :: last_on_element
      procedure :: on_element
      procedure :: at
   end type spline_space_t

contains

   !> degree    odd, >= 3
   !> elements  number of mesh intervals, >= 1
   !> length    l > 0 [length]
   !> turning   whether the root may turn; default .false.
   pure function new_spline_space(degree, elements, length, turning) result(space)
      integer, intent(in) :: degree, elements
      real(wp), intent(in) :: length
      logical, intent(in), optional :: turning
      type(spline_space_t) :: space
      real(wp) :: value(degree + 1), slope(degree + 1), determinant
      integer :: i

      space%degree = degree
      space%elements = elements
      if (present(turning)) space%turning = merge(1, 0, turning)
      space%n = elements + degree - 2 + space%turning
      space%length = length

      ! At the root, B_k with k = -(degree-1)/2 + i - 1 has value(i) and slope(i), i = 1..degree.
      value = cardinal(degree, 0, 0.0_wp)
      slope = cardinal(degree, 1, 0.0_wp)
      allocate (space%root(degree - 2, 3))
      do i = 1, degree - 2
         determinant = value(i)*slope(i + 2) - value(i + 2)*slope(i)
         space%root(i, 1) = (value(i + 2)*slope(i + 1) - value(i + 1)*slope(i + 2))/determinant
         space%root(i, 2) = 1
         space%root(i, 3) = (value(i + 1)*slope(i) - value(i)*slope(i + 1))/determinant
      end do
   end function new_spline_space

   !> Index of the first of the functions returned by `on_element`.
   !>
   !> element  0 .. N-1, covering [element h, (element + 1) h]
   pure integer function first_on_element(self, element)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element

      first_on_element = max(1, element - 1 + self%turning)
   end function first_on_element

   !> Index of the last of them.
   pure integer function last_on_element(self, element)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element

      last_on_element = element + self%degree - 1 + self%turning
   end function last_on_element

   !> Derivative of order `derivative` of the functions first, first+1, ... that live on an element.
   !>
   !> element     0 .. N-1
   !> s           position in the element, 0 .. 1
   !> derivative  0 .. degree [the result has unit 1/length**derivative]
   !> values      (degree + 1); entries beyond the last function of the element are zero
   pure function on_element(self, element, s, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      integer, intent(in) :: element, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(self%degree + 1)
      real(wp) :: plain(self%degree + 1)
      integer :: i, c, k, row, first, functions

      plain = cardinal(self%degree, derivative, s)*(self%elements/self%length)**derivative
      if (element >= self%degree) then
         values = plain
         return
      end if

      ! plain(c) belongs to B_k, k = element - (degree+1)/2 + c; b_i = B_{i-(degree-3)/2} for i >
      ! degree-2.
      values = 0
      first = max(1, element - 1)
      do row = 1, element + self%degree - first
         i = first + row - 1
         if (i > self%degree - 2) then
            values(row) = plain(i - element + 2)
         else
            do k = 1, 3
               c = i + k - 1 - element
               if (c >= 1) values(row) = values(row) + self%root(i, k)*plain(c)
            end do
         end if
      end do
      if (self%turning == 0 .or. element > 1) return
      ! The function that turns the root lives on the first two elements, in front of the others.
      functions = element + self%degree - 1
      values(2:functions + 1) = values(:functions)
      associate (at_root => cardinal(self%degree, 0, 0.0_wp))
         if (element == 0) values(1) = plain(1) - at_root(1)/at_root(2)*plain(2)
         if (element == 1) values(1) = -at_root(1)/at_root(2)*plain(1)
      end associate
   end function on_element

   !> Derivative of order `derivative` of all basis functions at one position.
   !>
   !> x           0 .. l [length]
   !> derivative  0 .. degree
   !> values      (n) [1/length**derivative]
   pure function at(self, x, derivative) result(values)
      class(spline_space_t), intent(in) :: self
      real(wp), intent(in) :: x
      integer, intent(in) :: derivative
      real(wp) :: values(self%n)
      real(wp) :: local(self%degree + 1), position
      integer :: element, first, last

      position = x/self%length*self%elements
      element = min(max(int(position), 0), self%elements - 1)
      first = self%first_on_element(element)
      last = self%last_on_element(element)
      local = self%on_element(element, position - element, derivative)
      values = 0
      values(first:last) = local(:last - first + 1)
   end function at

   !> The degree + 1 cardinal B-splines (unit spacing, scaled by degree!) that are nonzero on one
   !> interval, from left to right, at s in [0, 1]: de Boor's recurrence for the spline of degree
   !> degree - derivative, then differences, since B_p' = B_{p-1}(. + 1/2) - B_{p-1}(. - 1/2).
   pure function cardinal(degree, derivative, s) result(values)
      integer, intent(in) :: degree, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(degree + 1)
      real(wp) :: saved, term
      integer :: p, r

      values = 0
      values(1) = 1
      do p = 1, degree - derivative
         saved = 0
         do r = 1, p
            term = values(r)/p
            values(r) = saved + (r - s)*term
            saved = (s + p - r)*term
         end do
         values(p + 1) = saved
      end do
      do p = degree - derivative + 1, degree
         values(2:p + 1) = values(1:p) - values(2:p + 1)
         values(1) = -values(1)
      end do
      values = values*gamma(degree + 1.0_wp)
   end function cardinal

end module beamid_splines
