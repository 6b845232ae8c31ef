!> Roots s of an assembly (`beamid_assembly`) and their vectors: (s**2 M + s C + K) x = 0 for the
!> motion x of the oscillators, by matrices of the order of V's rows.
!>
!> The vector is normalised to x_j = 1 at an oscillator j that takes part in the motion. With
!> G = sum over i /= j of v_i v_i'/D_i,
!>
!>     y = (A + G H)**-1 v_j,  f = H y,  x_i = -v_i'f/D_i,  D_j + v_j'f = 0.
!>
!> These quantities stay bounded if the attachments are light and s is near a root of D_j. For
!> most rows A = 1, and y = V'x is the motion at the row. For the row of a spring to the ground, y
!> is the spring's force in a suitable unit; A y is the motion, where A is the compliance, and
!> f = H y is the force of spring and dashpot.
module beamid_vectors
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate, size_of
   use beamid_terms, only: of_mass
   implicit none
   private

   public :: root_t, vector_t, add_response, allocate_vector, denominators, distance_between, &
      find_vector, nearest_pole, past_rates, solve_coupled, solve_mass

   !> A point s of the complex plane, a root or an approximation to one. It is stored relative to a
   !> nearby root of an oscillator's D_i (a pole), so that D_i(s) keeps its digits near the pole.
   type :: root_t
      integer :: j = 0                !< oscillator at which the vector is normalised, x_j = 1
      integer :: origin = 0           !< oscillator of the pole; 0: not chosen yet
      !> which of the roots of D_origin is the pole: 1 or 2 for those of an oscillator, 2 + l for
      !> that of relaxation l
      integer :: side = 1
      complex(wp) :: offset = 0       !< s - pole(origin, side) [1/time]
      complex(wp) :: s = 0            !< the point itself [1/time]
   end type root_t

   !> The vector of a root, and the quantities that its derivatives need. n: number of oscillators;
   !> r: number of rows of V.
   type :: vector_t
      complex(wp), allocatable :: x(:)          !< (n) motion of the oscillators, x_j = 1
      complex(wp), allocatable :: D(:), dD(:)   !< (n) D(s) and D'(s)
      complex(wp), allocatable :: inverse(:)    !< (n) 1/D(s); 0 for oscillator j
      complex(wp), allocatable :: y(:), f(:)    !< (r) A**-1 V'x and H y
      complex(wp), allocatable, dimension(:, :) :: G, H, dH   !< (r, r) G(s), H(s) and H'(s)
      complex(wp), allocatable :: coupled(:, :) !< (r, r) A + G H
      real(wp), allocatable :: hm(:, :)         !< (r, r) coefficients of s**2 in H
      integer :: form = 0                       !< form of H at s, from `form_at`
      complex(wp) :: A = 0                      !< x'(2 s M + C) x
      real(wp) :: inertia = 0                   !< x^H M x, real and positive
   end type vector_t

contains

   !> Stores a point relative to the nearest pole. Chooses as oscillator j the one whose own
   !> response is the largest in comparison with its couplings to the rows of V.
   !>
   !> root    in: s, and origin, side and offset if origin > 0; out: j, origin, side and offset
   !> keep_j  .true.: j is given; default .false.
   pure subroutine nearest_pole(self, root, keep_j)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(inout) :: root
      logical, intent(in), optional :: keep_j
      real(wp) :: distance, least
      integer :: i, k, origin, side
      logical :: choose

      choose = .true.
      if (present(keep_j)) choose = .not. keep_j
      if (choose) root%j = largest_response(self, root%s)
      least = huge(least)
      origin = 1
      side = 1
      associate (s => root%s)
         do i = 1, self%n
            do k = 1, size(self%pole, 2)
               if (k == 3) then
                  if (.not. self%relaxes(i)) exit
               end if
               distance = real(s - self%pole(i, k))**2 + aimag(s - self%pole(i, k))**2
               if (distance >= least) cycle
               least = distance
               origin = i
               side = k
            end do
         end do
      end associate
      if (.not. least > 0) root%j = origin
      if (origin == root%origin .and. side == root%side) return
      root%origin = origin
      root%side = side
      root%offset = root%s - self%pole(origin, side)
   end subroutine nearest_pole

   !> Returns the oscillator whose own response is the largest in comparison with its couplings to
   !> the rows of V.
   !>
   !> s  [1/time]
   pure integer function largest_response(self, s) result(j)
      type(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s
      complex(wp) :: H(size(self%v, 1), size(self%v, 1), 2)
      real(wp) :: weight(size(self%v, 1)), response, distance, damped, largest
      integer :: i, k, l

      damped = 1
      do l = 1, self%relaxation%n
         damped = damped*(abs(s + self%relaxation%rate(l))**2 + tiny(1.0_wp))
      end do
      weight = 0
      call self%couplings(self%form_at(s), s, H(:, :, 1), H(:, :, 2))
      do l = 1, size(weight)
         do k = 1, size(weight)
            weight(k) = max(weight(k), size_of(H(k, l, 1))/max(1.0_wp, self%compliance(k)))
         end do
      end do
      j = 1
      largest = -1
      do i = 1, self%n
         response = sum(self%v(:, i)**2*weight)/self%pencil%m(i)
         distance = 1
         do k = 1, size(self%pole, 2)
            if (k == 3) then
               if (.not. self%relaxes(i)) exit
               distance = distance/damped
            end if
            distance = distance*(real(s - self%pole(i, k))**2 + aimag(s - self%pole(i, k))**2)
         end do
         response = response**2/max(distance, tiny(1.0_wp))
         if (response <= largest) cycle
         largest = response
         j = i
      end do
   end function largest_response

   !> Computes the vector of a root.
   !>
   !> root    the root, with j, origin and offset as `nearest_pole` sets them
   !> vector  in: arrays to be reused, of any shape; out: the vector
   pure subroutine find_vector(self, root, vector)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      type(vector_t), intent(inout) :: vector
      integer :: i, k, l, r

      r = size(self%v, 1)
      call allocate_vector(self%n, r, vector)
      vector%form = self%form_at(root%s)
      associate (v => self%v, m => self%pencil%m, G => vector%G)
         call self%couplings(vector%form, root%s, vector%H, vector%dH)
         call self%coupling(of_mass, vector%form, vector%hm)
         if (self%relaxation%n > 0) then
            call denominators(self, root, vector%D, vector%dD)
            vector%inverse = merge(0.0_wp, 1.0_wp, abs(vector%D) <= 0)/merge(vector%D, &
               (1.0_wp, 0.0_wp), abs(vector%D) > 0)
            vector%inverse(root%j) = 0
         else
            call quadratic_denominators(self%n, m, self%pole, root, vector%D, vector%dD, &
               vector%inverse)
         end if
         do l = 1, r
            do k = 1, l
               G(k, l) = weighted_sum(self%n, self%vv(:, k + l*(l - 1)/2), vector%inverse)
               G(l, k) = G(k, l)
            end do
            vector%y(l) = v(l, root%j)
         end do
         do l = 1, r
            do k = 1, r
               vector%coupled(k, l) = 0
               do i = 1, r
                  vector%coupled(k, l) = vector%coupled(k, l) + G(k, i)*vector%H(i, l)
               end do
            end do
            vector%coupled(l, l) = vector%coupled(l, l) + self%compliance(l)
         end do
         call solve_coupled(vector, vector%y)
         vector%A = 0
         vector%inertia = 0
         do k = 1, r
            vector%f(k) = 0
            do l = 1, r
               vector%f(k) = vector%f(k) + vector%H(k, l)*vector%y(l)
               vector%A = vector%A + self%compliance(k)*vector%y(k)*vector%dH(k, l)*vector%y(l)
               vector%inertia = vector%inertia + vector%hm(k, l)*real(conjg(vector%y(k)) &
                  *vector%y(l))
            end do
         end do
         vector%x = 0
         call add_response(self%n, r, self%vt, vector%f, vector%inverse, vector%x)
         vector%x(root%j) = 1
         do i = 1, self%n
            vector%A = vector%A + vector%dD(i)*vector%x(i)**2
            vector%inertia = vector%inertia + m(i)*(real(vector%x(i))**2 + aimag(vector%x(i))**2)
         end do
      end associate
   end subroutine find_vector

   !> Returns the sum of n complex numbers with real weights.
   pure complex(wp) function weighted_sum(n, weight, values)
      integer, intent(in) :: n
      real(wp), intent(in) :: weight(n)
      complex(wp), intent(in) :: values(n)
      real(wp) :: re, im
      integer :: i

      ! A product of a real and a complex number would be one of two complex numbers.
      re = 0
      im = 0
      do i = 1, n
         re = re + weight(i)*real(values(i))
         im = im + weight(i)*aimag(values(i))
      end do
      weighted_sum = cmplx(re, im, wp)
   end function weighted_sum

   !> Allocates the arrays of a vector for n oscillators and r rows, unless they have these shapes.
   pure subroutine allocate_vector(n, r, vector)
      integer, intent(in) :: n, r
      type(vector_t), intent(inout) :: vector

      if (allocated(vector%H)) then
         if (size(vector%x) == n .and. size(vector%H, 1) == r) return
         deallocate (vector%H)
      end if
      if (allocated(vector%x)) deallocate (vector%x, vector%D, vector%dD, vector%y, vector%f)
      if (allocated(vector%G)) deallocate (vector%inverse, vector%G, vector%dH, vector%hm, &
         vector%coupled)
      allocate (vector%x(n), vector%D(n), vector%dD(n), vector%inverse(n), vector%y(r), &
         vector%f(r), vector%G(r, r), vector%H(r, r), vector%dH(r, r), vector%hm(r, r), &
         vector%coupled(r, r))
   end subroutine allocate_vector

   !> Computes D and D' at a point.
   !>
   !> D, dD  (n) D and D'
   pure subroutine denominators(self, root, D, dD)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(:), dD(:)
      complex(wp) :: origin, left, right, past(2)
      integer :: i, l

      origin = self%pole(root%origin, root%side)
      past = past_relaxations(self, root)
      do i = 1, self%n
         left = (origin - self%pole(i, 1)) + root%offset
         right = (origin - self%pole(i, 2)) + root%offset
         D(i) = self%pencil%m(i)*(left*right)
         dD(i) = self%pencil%m(i)*(left + right)
         if (self%relaxation%n == 0) cycle
         if (.not. self%relaxes(i)) cycle
         if (self%pencil%l(i) > 0) then
            D(i) = (self%pencil%m(i)*root%s + self%pencil%c(i))*root%s &
               + cmplx(self%pencil%k(i), self%pencil%l(i), wp)
         end if
         dD(i) = 2*self%pencil%m(i)*root%s + self%pencil%c(i)
         do l = 1, self%relaxation%n
            associate (r => self%relaxed(i, l), b => self%relaxation%rate(l))
               dD(i) = dD(i) + r*b/past(l)**2
               if (self%pencil%l(i) > 0) then
                  D(i) = D(i) + r*root%s/past(l)
               else if (root%side == 2 + l) then
                  D(i) = D(i)*((self%creep(root%origin, l) - self%creep(i, l)) + root%offset) &
                     /past(l)
               else
                  D(i) = D(i)*((origin - self%pole(i, 2 + l)) + root%offset)/past(l)
               end if
            end associate
         end do
      end do
   end subroutine denominators

   !> Returns s + b at a point for each relaxation of the assembly [1/time].
   pure function past_relaxations(self, root) result(past)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp) :: past(2)
      integer :: l

      past = root%s + self%relaxation%rate
      l = root%side - 2
      if (l > 0) past(l) = self%rise(root%origin, l) + root%offset
   end function past_relaxations

   !> Returns s + b_1 and s + b_2 of the structure at a point, to all digits [1/time].
   pure function past_rates(self, root) result(past)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp) :: past(2), of_relaxations(2)
      integer :: l

      past = root%s + self%rates
      if (root%side <= 2) return
      of_relaxations = past_relaxations(self, root)
      do l = 1, 2
         if (self%relaxation%slot(l) > 0) past(l) = of_relaxations(self%relaxation%slot(l))
      end do
   end function past_rates

   !> Returns the difference a - b of two points with the full accuracy of their offsets.
   pure complex(wp) function distance_between(self, a, b) result(distance)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: a, b

      if (a%side > 2 .and. a%side == b%side) then
         distance = self%creep(a%origin, a%side - 2) - self%creep(b%origin, b%side - 2)
      else
         distance = self%pole(a%origin, a%side) - self%pole(b%origin, b%side)
      end if
      distance = distance + (a%offset - b%offset)
   end function distance_between

   !> Computes D, D' and 1/D at a point, with 0 in the place of 1/D_j, if nothing relaxes. The
   !> distances from the poles are formed relative to the nearest pole, so that none loses digits by
   !> cancellation.
   !>
   !> m               (n) modal masses m_i of D_i = m_i s**2 + c_i s + k_i
   !> pole            (n, 2) roots of D_i [1/time]
   !> D, dD, inverse  (n) D, D' and 1/D
   pure subroutine quadratic_denominators(n, m, pole, root, D, dD, inverse)
      integer, intent(in) :: n
      real(wp), intent(in) :: m(n)
      complex(wp), intent(in) :: pole(n, *)
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(n), dD(n), inverse(n)
      complex(wp) :: origin, left, right
      real(wp) :: square
      integer :: i

      origin = pole(root%origin, root%side)
      do i = 1, n
         left = (origin - pole(i, 1)) + root%offset
         right = (origin - pole(i, 2)) + root%offset
         dD(i) = cmplx(m(i)*real(left + right), m(i)*aimag(left + right), wp)
         left = left*right
         left = cmplx(m(i)*real(left), m(i)*aimag(left), wp)
         D(i) = left
         square = real(left)**2 + aimag(left)**2
         inverse(i) = 0
         if (square > 0) inverse(i) = cmplx(real(left)/square, -aimag(left)/square, wp)
      end do
      inverse(root%j) = 0
   end subroutine quadratic_denominators

   !> Adds the response of the oscillators to forces f along the rows of V to x: x := x - D**-1 V f.
   !>
   !> n, r     numbers of oscillators and rows
   !> vt       (n, r) transpose of `assembly%v`
   !> f        (r) forces
   !> inverse  (n) 1/D
   !> x        (n) motion of the oscillators
   pure subroutine add_response(n, r, vt, f, inverse, x)
      integer, intent(in) :: n, r
      real(wp), intent(in) :: vt(n, r)
      complex(wp), intent(in) :: f(r), inverse(n)
      complex(wp), intent(inout) :: x(n)
      real(wp) :: re, im
      integer :: i, k

      do i = 1, n
         re = 0
         im = 0
         do k = 1, r
            re = re + vt(i, k)*real(f(k))
            im = im + vt(i, k)*aimag(f(k))
         end do
         x(i) = x(i) - cmplx(re, im, wp)*inverse(i)
      end do
   end subroutine add_response

   !> Solves (A + G H) x = b in place; the result is 0 if the matrix is singular.
   !>
   !> vector  supplies A + G H
   !> b       (r) in: right-hand side; out: solution
   pure subroutine solve_coupled(vector, b)
      type(vector_t), intent(in) :: vector
      complex(wp), intent(inout) :: b(:)

      if (size(b) == 2) then
         call solve_pair(vector%coupled, b)
      else
         call solve_several(vector%coupled, b)
      end if
   end subroutine solve_coupled

   !> Solves a x = b in place; the result is 0 if the matrix is singular.
   pure subroutine solve_several(a, b)
      complex(wp), intent(in) :: a(:, :)
      complex(wp), intent(inout) :: b(:)
      complex(wp) :: matrix(size(b), size(b)), column(size(b), 1)
      logical :: regular

      matrix = a
      column(:, 1) = b
      call eliminate(size(b), 1, matrix, column, regular)
      b = 0
      if (regular) b = column(:, 1)
   end subroutine solve_several

   !> Solves a x = b in place for two unknowns, by elimination with pivoting; the result is 0 if the
   !> matrix is singular.
   pure subroutine solve_pair(a, b)
      complex(wp), intent(in) :: a(2, 2)
      complex(wp), intent(inout) :: b(2)
      complex(wp) :: factor, pivot
      integer :: k

      k = merge(1, 2, size_of(a(1, 1)) >= size_of(a(2, 1)))
      if (size_of(a(k, 1)) > 0) then
         factor = a(3 - k, 1)/a(k, 1)
         pivot = a(3 - k, 2) - factor*a(k, 2)
         if (size_of(pivot) > 0) then
            factor = (b(3 - k) - factor*b(k))/pivot
            b = [(b(k) - a(k, 2)*factor)/a(k, 1), factor]
            return
         end if
      end if
      b = 0
   end subroutine solve_pair

   !> Computes the accelerations x := M**-1 x of the oscillators under forces, and y = V'x of the
   !> rows, without the cancellation of a sum over x. For a rigid row, y is the constraint force.
   !>
   !> x      (n, columns) in: forces; out: accelerations
   !> y      (r, columns) accelerations of the rows, or forces of rigid rows
   !> moved  (r) prescribed accelerations of rigid rows, for the first column; default: none
   subroutine solve_mass(self, x, y, moved)
      type(assembly_t), intent(in) :: self
      real(wp), intent(inout) :: x(:, :)
      real(wp), intent(out) :: y(:, :)
      real(wp), intent(in), optional :: moved(:)
      real(wp) :: h(size(self%v, 1), size(self%v, 1))
      complex(wp) :: a(size(self%v, 1), size(self%v, 1)), c(size(self%v, 1), size(x, 2))
      logical :: regular
      integer :: k, l, r

      r = size(self%v, 1)
      h = self%mass_couplings()
      associate (vt => self%vt, m => self%pencil%m)
         do l = 1, r
            do k = 1, l
               a(k, l) = sum(vt(:, k)*vt(:, l)/m)
               a(l, k) = a(k, l)
            end do
         end do
         a = matmul(a, h)
         do l = 1, size(x, 2)
            x(:, l) = x(:, l)/m
            do k = 1, r
               c(k, l) = sum(vt(:, k)*x(:, l))
            end do
         end do
         do k = 1, r
            if (.not. self%rigid(k)) then
               a(k, k) = a(k, k) + 1
            else if (present(moved)) then
               c(k, 1) = c(k, 1) - moved(k)
            end if
         end do
         call eliminate(r, size(x, 2), a, c, regular)
         y = 0
         if (regular) y = real(c)
         do l = 1, size(x, 2)
            do k = 1, r
               x(:, l) = x(:, l) - sum(h(k, :)*y(:, l))*vt(:, k)/m
            end do
         end do
      end associate
   end subroutine solve_mass

end module beamid_vectors
