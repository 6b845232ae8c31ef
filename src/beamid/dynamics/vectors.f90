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
   use beamid_assembly, only: assembly_t, root_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate, size_of
   implicit none
   private

   public :: vector_t, add_response, allocate_vector, allocate_vectors, find_vector, nearest_pole, &
      solve_coupled, solve_mass

   !> The vector of a root, and the quantities that its derivatives need. n: number of oscillators;
   !> r: number of rows of V.
   type :: vector_t
      complex(wp), allocatable :: x(:)          !< (n) motion of the oscillators, x_j = 1
      complex(wp), allocatable :: D(:), dD(:)   !< (n) D(s) and D'(s)
      complex(wp), allocatable :: inverse(:)    !< (n) 1/D(s); 0 for oscillator j
      complex(wp), allocatable :: y(:), f(:)    !< (r) A**-1 V'x and H y
      !> (r, r) G(s), H(s), H'(s) and H''(s)/2
      complex(wp), allocatable, dimension(:, :) :: G, H, dH, half_d2H
      complex(wp), allocatable :: coupled(:, :) !< (r, r) A + G H
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
      logical :: choose

      choose = .true.
      if (present(keep_j)) choose = .not. keep_j
      if (choose) root%j = largest_response(self, root%s)
      call self%oscillators%find_origin(root)
   end subroutine nearest_pole

   !> Returns the oscillator whose own response is the largest in comparison with its couplings to
   !> the rows of V.
   !>
   !> The root of an oscillator that is hardly coupled equals its pole to all digits. If exactly one
   !> oscillator has a pole within round-off of s, it is therefore the one. (Several have, where the
   !> slow roots of overdamped modes accumulate.)
   !>
   !> s  [1/time]
   pure integer function largest_response(self, s) result(j)
      type(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s
      complex(wp) :: H(self%layout%r, self%layout%r, 2), gap
      real(wp) :: weight(self%layout%r), response, distance, damped, largest, round_off
      logical :: is_near
      integer :: i, k, l, near   ! near: oscillator with a pole within round-off; -1: several

      damped = 1
      do l = 1, self%oscillators%relaxation%n
         damped = damped*(abs(s + self%oscillators%relaxation%rate(l))**2 + tiny(1.0_wp))
      end do
      weight = 0
      call self%couplings%evaluate(self%couplings%form_at(s), s, H(:, :, 1), H(:, :, 2))
      do l = 1, size(weight)
         do k = 1, size(weight)
            weight(k) = max(weight(k), size_of(H(k, l, 1)) &
               /max(1.0_wp, self%couplings%compliance(k)))
         end do
      end do
      round_off = 4*epsilon(1.0_wp)*abs(s)
      j = 1
      largest = -1
      near = 0
      do i = 1, self%layout%n
         response = sum(self%layout%v(:, i)**2*weight)/self%oscillators%m(i)
         distance = 1
         is_near = .false.
         associate (of => self%oscillators)
            do k = 1, merge(size(of%pole, 2), 2, of%relaxes(i))
               if (k == 3) distance = distance/damped
               gap = s - of%pole(i, k)
               is_near = is_near .or. abs(real(gap)) + abs(aimag(gap)) <= round_off
               distance = distance*(real(gap)**2 + aimag(gap)**2)
            end do
         end associate
         if (is_near) near = merge(i, -1, near == 0)
         response = response**2/max(distance, tiny(1.0_wp))
         if (response <= largest) cycle
         largest = response
         j = i
      end do
      if (near > 0) j = near
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

      r = self%layout%r
      call allocate_vector(self%layout%n, r, vector)
      vector%form = self%couplings%form_at(root%s)
      associate (v => self%layout%v, m => self%oscillators%m, G => vector%G, &
         compliance => self%couplings%compliance)
         call self%couplings%evaluate(vector%form, root%s, vector%H, vector%dH, vector%half_d2H)
         call self%oscillators%denominators(root, vector%D, vector%dD, vector%inverse)
         call self%layout%project(vector%inverse, G)
         vector%y = v(:, root%j)
         do l = 1, r
            do k = 1, r
               vector%coupled(k, l) = 0
               do i = 1, r
                  vector%coupled(k, l) = vector%coupled(k, l) + G(k, i)*vector%H(i, l)
               end do
            end do
            vector%coupled(l, l) = vector%coupled(l, l) + compliance(l)
         end do
         call solve_coupled(vector, vector%y)
         vector%A = 0
         vector%inertia = 0
         do k = 1, r
            vector%f(k) = 0
            do l = 1, r
               vector%f(k) = vector%f(k) + vector%H(k, l)*vector%y(l)
               vector%A = vector%A + compliance(k)*vector%y(k)*vector%dH(k, l)*vector%y(l)
               vector%inertia = vector%inertia + real(vector%half_d2H(k, l)) &
                  *real(conjg(vector%y(k))*vector%y(l))
            end do
         end do
         vector%x = 0
         call add_response(self%layout%n, r, self%layout%vt, vector%f, vector%inverse, vector%x)
         vector%x(root%j) = 1
         do i = 1, self%layout%n
            vector%A = vector%A + vector%dD(i)*vector%x(i)**2
            vector%inertia = vector%inertia + m(i)*(real(vector%x(i))**2 + aimag(vector%x(i))**2)
         end do
      end associate
   end subroutine find_vector

   !> Allocates n vectors, unless there are as many.
   pure subroutine allocate_vectors(n, vectors)
      integer, intent(in) :: n
      type(vector_t), allocatable, intent(inout) :: vectors(:)

      if (allocated(vectors)) then
         if (size(vectors) /= n) deallocate (vectors)
      end if
      if (.not. allocated(vectors)) allocate (vectors(n))
   end subroutine allocate_vectors

   !> Allocates the arrays of a vector for n oscillators and r rows, unless they have these shapes.
   pure subroutine allocate_vector(n, r, vector)
      integer, intent(in) :: n, r
      type(vector_t), intent(inout) :: vector

      if (allocated(vector%H)) then
         if (size(vector%x) == n .and. size(vector%H, 1) == r) return
         deallocate (vector%H)
      end if
      if (allocated(vector%x)) deallocate (vector%x, vector%D, vector%dD, vector%y, vector%f)
      if (allocated(vector%G)) deallocate (vector%inverse, vector%G, vector%dH, vector%half_d2H, &
         vector%coupled)
      allocate (vector%x(n), vector%D(n), vector%dD(n), vector%inverse(n), vector%y(r), &
         vector%f(r), vector%G(r, r), vector%H(r, r), vector%dH(r, r), vector%half_d2H(r, r), &
         vector%coupled(r, r))
   end subroutine allocate_vector

   !> Adds the response of the oscillators to forces f along the rows of V to x: x := x - D**-1 V f.
   !>
   !> n, r     numbers of oscillators and rows
   !> vt       (n, r) transpose of V
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
      real(wp) :: h(self%layout%r, self%layout%r)
      complex(wp) :: a(self%layout%r, self%layout%r), c(self%layout%r, size(x, 2))
      logical :: regular
      integer :: k, l, r

      r = self%layout%r
      h = self%couplings%masses()
      associate (vt => self%layout%vt, m => self%oscillators%m)
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
            if (.not. self%couplings%rigid(k)) then
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
