!> Roots of an assembly and their vectors.
!>
!> With an oscillator j that takes part in the motion, x_j = 1, and G = sum over i /= j of
!> v_i v_i'/D_i,
!>
!>     y = (A + G H)**-1 v_j,  f = H y,  x_i = -v_i'f/D_i,  D_j + v_j'f = 0:
!>
!> nothing in it grows without bound when what hangs on the beam is light and s near a pole of D_j.
!> Of a row that a spring to the ground holds y is the force of the spring in a unit of its own, A y
!> the motion with the compliance in A, and H y the force with that of the dashpot.
module beamid_vectors
   use beamid_assembly, only: assembly_t, pencil_t
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgesv
   use beamid_structure, only: most_sensors, most_supports
   implicit none
   private

   public :: root_t, vector_t, add_answer, find_vector, logarithmic_derivative, nearest_pole, &
      solve_coupled, solve_mass

   !> The highest order of H: every coupling that `beamid_assembly` knows.
   integer, parameter, public :: most = 5 + 2*most_sensors + most_supports

   !> A point s given relative to the nearest pole, so that D keeps its digits however near it is.
   type :: root_t
      integer :: j = 0                !< the oscillator with x_j = 1: one that takes part
      integer :: origin = 0           !< s = pole(origin, side) + offset
      integer :: side = 1
      complex(wp) :: offset = 0
      complex(wp) :: s = 0
   end type root_t

   !> The vector x of a root, and what derivatives of it need; of y and f the first r count.
   type :: vector_t
      complex(wp), allocatable :: x(:)                        !< (n)
      complex(wp), allocatable :: D(:), dD(:)                 !< (n) D(s) and D'(s)
      complex(wp), allocatable :: inverse(:)                  !< (n) 1/D(s), 0 for oscillator j
      complex(wp) :: y(most), f(most)                         !< A**-1 V'x and H y
      complex(wp), allocatable, dimension(:, :) :: G, H, dH   !< (r, r)
      integer :: form = 1                    !< of the pencil
      complex(wp) :: A = 0                   !< x'(2 s M + C) x
      real(wp) :: inertia = 0                !< M on x and its conjugate, real and positive
   end type vector_t

contains

   !> Gives a point the nearest pole as its origin, and as oscillator j the one whose own answer is
   !> the largest against what holds it.
   pure subroutine nearest_pole(self, root)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(inout) :: root
      complex(wp) :: s
      real(wp) :: distance(2), least, weight(most), share, largest
      integer :: i, k, l, origin, side, r

      r = size(self%v, 1)
      s = root%s
      weight(:r) = 0
      associate (p => self%pencil(self%form_at(s)))
         do l = 1, r
            do k = 1, r
               weight(k) = max(weight(k), size_of((p%hm(k, l)*s + p%hc(k, l))*s + p%hk(k, l)) &
                  /max(1.0_wp, self%compliance(k)))
            end do
         end do
      end associate
      least = huge(least)
      largest = -1
      origin = 1
      side = 1
      do i = 1, self%n
         do k = 1, 2
            distance(k) = real(s - self%pole(i, k))**2 + aimag(s - self%pole(i, k))**2
            if (distance(k) >= least) cycle
            least = distance(k)
            origin = i
            side = k
         end do
         share = sum(self%v(:, i)**2*weight(:r))/self%pencil(1)%m(i)
         share = share**2/max(distance(1)*distance(2), tiny(1.0_wp))
         if (share <= largest) cycle
         largest = share
         root%j = i
      end do
      if (.not. least > 0) root%j = origin
      if (origin == root%origin .and. side == root%side) return
      root%origin = origin
      root%side = side
      root%offset = s - self%pole(origin, side)
   end subroutine nearest_pole

   !> H(s) and H'(s).
   pure subroutine couplings(pencil, s, H, dH)
      type(pencil_t), intent(in) :: pencil
      complex(wp), intent(in) :: s
      complex(wp), intent(out) :: H(:, :), dH(:, :)
      integer :: k, l

      do l = 1, size(H, 2)
         do k = 1, size(H, 1)
            H(k, l) = (pencil%hm(k, l)*s + pencil%hc(k, l))*s + pencil%hk(k, l)
            dH(k, l) = 2*pencil%hm(k, l)*s + pencil%hc(k, l)
         end do
      end do
   end subroutine couplings

   !> W'/W of the characteristic polynomial, W(s) = det(A + G H)(D_j + v_j'f) times D_i of all
   !> other oscillators.
   !> The one routine that a search calls hundreds of times: no array here is allocated. 0: without
   !> oscillator j there is a root at this very point, and the quotient cannot be told.
   pure complex(wp) function logarithmic_derivative(self, root) result(value)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), dimension(most, most) :: G, dG, H, dH, a
      complex(wp) :: b(most, most + 1), y(most), origin, left, right, D, dD, D_j, dD_j, w, dw
      logical :: regular
      integer :: i, k, l, r

      r = size(self%v, 1)
      associate (pencil => self%pencil(self%form_at(root%s)))
         origin = self%pole(root%origin, root%side)
         G(:r, :r) = 0
         dG(:r, :r) = 0
         value = 0
         do i = 1, self%n
            left = (origin - self%pole(i, 1)) + root%offset
            right = (origin - self%pole(i, 2)) + root%offset
            D = pencil%m(i)*left*right
            dD = pencil%m(i)*(left + right)
            if (i == root%j) then
               D_j = D
               dD_j = dD
               cycle
            end if
            D = 1/D
            dD = dD*D
            value = value + dD
            dD = -dD*D
            do l = 1, r
               do k = 1, l
                  G(k, l) = G(k, l) + self%v(k, i)*self%v(l, i)*D
                  dG(k, l) = dG(k, l) + self%v(k, i)*self%v(l, i)*dD
               end do
            end do
         end do
         do l = 1, r
            do k = 1, r
               H(k, l) = (pencil%hm(k, l)*root%s + pencil%hc(k, l))*root%s &
                  + pencil%hk(k, l)
               dH(k, l) = 2*pencil%hm(k, l)*root%s + pencil%hc(k, l)
            end do
            G(l, :l - 1) = G(:l - 1, l)
            dG(l, :l - 1) = dG(:l - 1, l)
         end do
      end associate
      do l = 1, r
         do k = 1, r
            a(k, l) = sum(G(k, :r)*H(:r, l))
            b(k, l + 1) = sum(dG(k, :r)*H(:r, l) + G(k, :r)*dH(:r, l))
         end do
         a(l, l) = a(l, l) + self%compliance(l)
         b(l, 1) = self%v(l, root%j)
      end do
      call eliminate(r, r + 1, a, b, regular)
      w = D_j
      dw = dD_j
      do k = 1, r
         y(k) = sum(H(k, :r)*b(:r, 1))
         w = w + self%v(k, root%j)*y(k)
         y(k) = sum(b(k, 2:r + 1)*b(:r, 1))
      end do
      do k = 1, r
         dw = dw + self%v(k, root%j)*sum(dH(k, :r)*b(:r, 1) - H(k, :r)*y(:r))
         value = value + b(k, k + 1)
      end do
      if (.not. regular) then
         ! It cannot be told here.
         value = 0
      else if (.not. abs(w) > 0) then
         value = huge(1.0_wp)
      else
         value = value + dw/w
      end if
   end function logarithmic_derivative

   !> b := a**-1 b for a tiny matrix, by elimination with partial pivoting; a is destroyed. LAPACK
   !> takes several times as long for these orders.
   !>
   !> r, m     order, and columns of b
   !> regular  .false. when a is singular; b is then undefined
   pure subroutine eliminate(r, m, a, b, regular)
      integer, intent(in) :: r, m
      complex(wp), intent(inout) :: a(:, :), b(:, :)
      logical, intent(out) :: regular
      complex(wp) :: factor, saved
      integer :: i, k, l, pivot

      regular = .true.
      do k = 1, r
         pivot = k
         do i = k + 1, r
            if (size_of(a(i, k)) > size_of(a(pivot, k))) pivot = i
         end do
         if (.not. size_of(a(pivot, k)) > 0) then
            regular = .false.
            return
         end if
         if (pivot /= k) then
            do l = k, r
               saved = a(k, l)
               a(k, l) = a(pivot, l)
               a(pivot, l) = saved
            end do
            do l = 1, m
               saved = b(k, l)
               b(k, l) = b(pivot, l)
               b(pivot, l) = saved
            end do
         end if
         a(k, k) = 1/a(k, k)
         do i = k + 1, r
            factor = a(i, k)*a(k, k)
            a(i, k + 1:r) = a(i, k + 1:r) - factor*a(k, k + 1:r)
            b(i, :m) = b(i, :m) - factor*b(k, :m)
         end do
      end do
      do k = r, 1, -1
         do l = 1, m
            b(k, l) = (b(k, l) - sum(a(k, k + 1:r)*b(k + 1:r, l)))*a(k, k)
         end do
      end do
   end subroutine eliminate

   !> A modulus that costs no square root.
   elemental real(wp) function size_of(z)
      complex(wp), intent(in) :: z

      size_of = abs(real(z)) + abs(aimag(z))
   end function size_of

   !> The vector of a root.
   pure subroutine find_vector(self, root, vector)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      type(vector_t), intent(inout) :: vector
      integer :: i, k, l, r

      r = size(self%v, 1)
      if (allocated(vector%H)) then
         if (size(vector%x) /= self%n .or. size(vector%H, 1) /= r) deallocate (vector%H)
      end if
      if (.not. allocated(vector%H)) then
         if (allocated(vector%x)) deallocate (vector%x, vector%D, vector%dD)
         if (allocated(vector%G)) deallocate (vector%inverse, vector%G, vector%dH)
         allocate (vector%x(self%n), vector%D(self%n), vector%dD(self%n), &
            vector%inverse(self%n), vector%G(r, r), vector%H(r, r), vector%dH(r, r))
      end if
      vector%form = self%form_at(root%s)
      associate (v => self%v, m => self%pencil(1)%m, G => vector%G, pencil => &
         self%pencil(vector%form))
         call couplings(pencil, root%s, vector%H, vector%dH)
         call denominators(self%n, m, self%pole, root, vector%D, vector%dD, vector%inverse)
         do l = 1, r
            do k = 1, l
               G(k, l) = real_sum(self%n, self%vv(:, k + l*(l - 1)/2), vector%inverse)
               G(l, k) = G(k, l)
            end do
            vector%y(l) = v(l, root%j)
         end do
         call solve_coupled(self, vector, vector%y(:r))
         vector%A = 0
         vector%inertia = 0
         do k = 1, r
            vector%f(k) = 0
            do l = 1, r
               vector%f(k) = vector%f(k) + vector%H(k, l)*vector%y(l)
               vector%A = vector%A + self%compliance(k)*vector%y(k)*vector%dH(k, l)*vector%y(l)
               vector%inertia = vector%inertia + pencil%hm(k, l)*real(conjg(vector%y(k)) &
                  *vector%y(l))
            end do
         end do
         vector%x = 0
         call add_answer(self%n, r, self%vt, vector%f, vector%inverse, vector%x)
         vector%x(root%j) = 1
         do i = 1, self%n
            vector%A = vector%A + vector%dD(i)*vector%x(i)**2
            vector%inertia = vector%inertia + m(i)*(real(vector%x(i))**2 + aimag(vector%x(i))**2)
         end do
      end associate
   end subroutine find_vector

   !> D, D' and 1/D at a point, but 0 in the place of 1/D_j; the distances from other poles by way
   !> of the nearest one, which leaves each its digits.
   pure subroutine denominators(n, m, pole, root, D, dD, inverse)
      integer, intent(in) :: n
      real(wp), intent(in) :: m(n)
      complex(wp), intent(in) :: pole(n, 2)
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(n), dD(n), inverse(n)
      complex(wp) :: origin, left, right
      real(wp) :: square
      integer :: i

      origin = pole(root%origin, root%side)
      do i = 1, n
         left = (origin - pole(i, 1)) + root%offset
         right = (origin - pole(i, 2)) + root%offset
         D(i) = m(i)*(left*right)
         dD(i) = m(i)*(left + right)
         square = real(D(i))**2 + aimag(D(i))**2
         inverse(i) = 0
         if (square > 0) inverse(i) = conjg(D(i))/square
      end do
      inverse(root%j) = 0
   end subroutine denominators

   !> sum a z
   pure complex(wp) function real_sum(n, a, z)
      integer, intent(in) :: n
      real(wp), intent(in) :: a(n)
      complex(wp), intent(in) :: z(n)
      integer :: i

      real_sum = 0
      do i = 1, n
         real_sum = real_sum + a(i)*z(i)
      end do
   end function real_sum

   !> x := x - D**-1 V f, the answer of the oscillators to forces along the rows.
   pure subroutine add_answer(n, r, vt, f, inverse, x)
      integer, intent(in) :: n, r
      real(wp), intent(in) :: vt(n, r)
      complex(wp), intent(in) :: f(r), inverse(n)
      complex(wp), intent(inout) :: x(n)
      complex(wp) :: force
      integer :: i, k

      do i = 1, n
         force = 0
         do k = 1, r
            force = force + vt(i, k)*f(k)
         end do
         x(i) = x(i) - force*inverse(i)
      end do
   end subroutine add_answer

   !> b := (A + G H)**-1 b; zero where there is no inverse.
   pure subroutine solve_coupled(self, vector, b)
      type(assembly_t), intent(in) :: self
      type(vector_t), intent(in) :: vector
      complex(wp), intent(inout) :: b(:)
      complex(wp) :: a(most, most), columns(most, 1)
      logical :: regular
      integer :: k, l, m, r

      r = size(b)
      do l = 1, r
         do k = 1, r
            a(k, l) = 0
            do m = 1, r
               a(k, l) = a(k, l) + vector%G(k, m)*vector%H(m, l)
            end do
         end do
         a(l, l) = a(l, l) + self%compliance(l)
         columns(l, 1) = b(l)
      end do
      call eliminate(r, 1, a, columns, regular)
      b = 0
      if (regular) b = columns(:r, 1)
   end subroutine solve_coupled

   !> x := M**-1 x and y = V'x, the latter without the cancellation of a sum over x; of a row that
   !> is held y is the force.
   !>
   !> x      (n, columns)
   !> y      (r, columns)
   !> moved  (r) by which rows that are held are moved, for the first column; left out: by nothing
   subroutine solve_mass(self, x, y, moved)
      type(assembly_t), intent(in) :: self
      real(wp), intent(inout) :: x(:, :)
      real(wp), intent(out) :: y(:, :)
      real(wp), intent(in), optional :: moved(:)
      real(wp), dimension(most, most) :: h, a, c
      integer :: pivots(most), info, k, l, r

      r = size(self%v, 1)
      h(:r, :r) = self%mass_couplings()
      associate (vt => self%vt, m => self%pencil(1)%m)
         do l = 1, r
            do k = 1, l
               a(k, l) = sum(vt(:, k)*vt(:, l)/m)
               a(l, k) = a(k, l)
            end do
         end do
         a(:r, :r) = matmul(a(:r, :r), h(:r, :r))
         do l = 1, size(x, 2)
            x(:, l) = x(:, l)/m
            do k = 1, r
               c(k, l) = sum(vt(:, k)*x(:, l))
            end do
         end do
         do k = 1, r
            if (.not. self%held(k)) then
               a(k, k) = a(k, k) + 1
            else if (present(moved)) then
               c(k, 1) = c(k, 1) - moved(k)
            end if
         end do
         call dgesv(r, size(x, 2), a, most, pivots, c, most, info)
         if (info /= 0) c = 0
         y = c(:r, :size(x, 2))
         do l = 1, size(x, 2)
            do k = 1, r
               x(:, l) = x(:, l) - sum(h(k, :r)*y(:, l))*vt(:, k)/m
            end do
         end do
      end associate
   end subroutine solve_mass

end module beamid_vectors
