!> The oscillators of the equations in modal coordinates, without what couples them:
!>
!>     D_i(s) = m_i s**2 + c_i s + k_i + i l_i.
!>
!> The roots of D_i are the poles of oscillator i. Structural damping l_i counts for Im s > 0; for
!> Im s < 0 the sign of l_i is the opposite one. Time hysteresis adds r_il s/(s + b_l) for each
!> relaxation l: D_i is then a quotient, with a real pole in each interval of `beamid_relaxations`
!> beside the two poles of an oscillator.
module beamid_oscillators
   use beamid_coefficients, only: coefficients_t
   use beamid_kinds, only: wp
   use beamid_layout, only: layout_t
   use beamid_quadratics, only: lossy_roots, quadratic_roots
   use beamid_relaxations, only: new_relaxation, relaxation_t
   use beamid_terms, only: bending, hose, inertia, of_damping, of_loss, of_mass, of_relaxation, &
      of_stiffness, stretch
   implicit none
   private

   public :: changes, of_rate, oscillators_t, root_t

   !> Factors of the coefficients in Q(s): of those in M, C, K, L, of the stiffness that relaxes by
   !> each relaxation, and of the same stiffness where the rate of the relaxation changes.
   integer, parameter :: of_rate(2) = of_relaxation + size(of_relaxation), &
      changes = of_rate(size(of_rate))

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

   !> D(s) of n oscillators, those of the beam first.
   type :: oscillators_t
      real(wp), allocatable :: m(:), c(:), k(:), l(:)   !< (n) coefficients of s**2, s, 1 and i
      real(wp) :: E = 0, c_D = 0   !< coefficients of bending in K and C
      !> (n, 2 + relaxations) roots of D_i; without meaning for relaxations of an oscillator that
      !> has none [1/time]
      complex(wp), allocatable :: pole(:, :)
      type(relaxation_t) :: relaxation         !< the relaxations of the modulus
      real(wp) :: rates(2) = 0                 !< b_1 and b_2 of the structure [1/time]
      !> (n, relaxations) stiffness r that relaxes, and (n) whether it is not 0
      real(wp), allocatable :: relaxed(:, :)
      logical, allocatable :: relaxes(:)
      !> (n, relaxations) distances of the real poles from the point of accumulation and from -b
      real(wp), allocatable :: creep(:, :), rise(:, :)
      real(wp), private :: air = 0   !< coefficient of inertia in C
   contains
      procedure :: set, set_poles, find_origin, denominators, second_derivative, factors, &
         distance_between, distance_from_accumulation, select_oscillators
   end type oscillators_t

contains

   !> Sets D and its roots. The rates and strengths of the relaxations are set in the first call
   !> alone; for other relaxations, begin with a new variable.
   subroutine set(self, given, layout)
      class(oscillators_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      type(layout_t), intent(in) :: layout
      integer :: l

      associate (n => layout%n, b => layout%beam, mu => layout%mu, s => given%structure, &
         strength => given%c(:, :, 0))
         if (.not. allocated(self%m)) allocate (self%m(n), self%c(n), self%k(n), self%l(n))
         call sum_terms(layout, strength(:, of_mass), self%m)
         call sum_terms(layout, strength(:, of_damping), self%c)
         call sum_terms(layout, strength(:, of_stiffness), self%k)
         self%l(:b) = strength(bending, of_loss)*mu
         self%l(b + 1:) = 0
         self%E = strength(bending, of_stiffness)
         self%c_D = strength(bending, of_damping)
         self%air = strength(inertia, of_damping)
         self%rates = [s%b_1, s%b_2]
         if (.not. allocated(self%pole)) then
            self%relaxation = new_relaxation(merge([s%d_1, s%d_2], 0.0_wp, self%E > 0), &
               self%rates, self%c_D/max(self%E, tiny(1.0_wp)))
            allocate (self%pole(n, 2 + self%relaxation%n))
            allocate (self%relaxed(n, self%relaxation%n), source=0.0_wp)
            allocate (self%creep, self%rise, mold=self%relaxed)
         end if
         do l = 1, self%relaxation%n
            self%relaxed(:b, l) = self%relaxation%strength(l)*self%E*mu
         end do
         self%relaxes = any(self%relaxed > 0, dim=2)
      end associate
      call self%set_poles()
   end subroutine set

   !> Sums the terms of one matrix.
   !>
   !> s  (operators) coefficients of the matrix
   !> d  (n) its diagonal
   pure subroutine sum_terms(layout, s, d)
      type(layout_t), intent(in) :: layout
      real(wp), intent(in) :: s(:)
      real(wp), intent(out) :: d(:)
      integer :: h

      d(:layout%beam) = s(inertia) + s(bending)*layout%mu
      do h = 1, size(layout%hose)
         associate (i => layout%hose(h)%oscillator)
            if (i > 0) d(i) = s(hose(h)) + s(stretch(h))
         end associate
      end do
   end subroutine sum_terms

   !> Computes the roots of all D_i.
   pure subroutine set_poles(self)
      class(oscillators_t), intent(inout) :: self
      integer :: i

      do i = 1, size(self%m)
         if (self%l(i) > 0) then
            self%pole(i, :2) = lossy_roots(self%m(i), self%c(i), cmplx(self%k(i), self%l(i), wp))
         else
            self%pole(i, :2) = quadratic_roots(self%m(i), self%c(i), self%k(i))
         end if
         if (self%relaxation%n > 0) call relax_poles(self, i)
      end do
   end subroutine set_poles

   !> Computes the roots of D_i with relaxations. The coefficients of the two that oscillate follow
   !> from the real ones.
   pure subroutine relax_poles(self, i)
      type(oscillators_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp) :: share
      integer :: l

      self%creep(i, :) = 0
      self%rise(i, :) = 0
      self%pole(i, 3:) = 0
      if (.not. self%relaxes(i)) return
      associate (m => self%m(i), k => self%k(i), of => self%relaxation)
         share = 1
         do l = 1, of%n
            ! Without the viscosity, which phi contains.
            call of%find_root(l, [self%air, m]/k, self%creep(i, l), self%rise(i, l))
            self%pole(i, 2 + l) = of%point(l) + self%creep(i, l)
            share = share*of%rate(l)/(of%rate(l) - self%rise(i, l))
         end do
         self%pole(i, :2) = quadratic_roots(1.0_wp, self%c(i)/m + sum(self%rise(i, :)), k/m*share)
      end associate
   end subroutine relax_poles

   !> Stores a point relative to the nearest pole. If the point is a pole, the vector is normalised
   !> at its oscillator.
   !>
   !> root  in: s, and origin, side and offset if origin > 0; out: origin, side and offset, too
   pure subroutine find_origin(self, root)
      class(oscillators_t), intent(in) :: self
      type(root_t), intent(inout) :: root
      real(wp) :: distance, least
      integer :: i, k, origin, side

      least = huge(least)
      origin = 1
      side = 1
      do i = 1, size(self%m)
         do k = 1, merge(size(self%pole, 2), 2, self%relaxes(i))
            distance = real(root%s - self%pole(i, k))**2 + aimag(root%s - self%pole(i, k))**2
            if (distance >= least) cycle
            least = distance
            origin = i
            side = k
         end do
      end do
      if (.not. least > 0) root%j = origin
      if (origin == root%origin .and. side == root%side) return
      root%origin = origin
      root%side = side
      root%offset = root%s - self%pole(origin, side)
   end subroutine find_origin

   !> Computes D, D' and 1/D at a point.
   !>
   !> Two oscillators may have the same pole: the rigid motions of a free beam in air. A mass on the
   !> beam couples them, but leaves a root at this pole, with D_j = D_i = 0 but for round-off. The
   !> vector of this root is that of a point next to it: 1/D_i is taken at s (1 + epsilon). A point
   !> closer to the pole would lose the differences of large numbers that the vector needs.
   !>
   !> D, dD    (n) D and D'
   !> inverse  (n) 1/D, with 0 in the place of 1/D_j
   pure subroutine denominators(self, root, D, dD, inverse)
      class(oscillators_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(size(self%m)), dD(size(self%m))
      complex(wp), intent(out), optional :: inverse(size(self%m))
      complex(wp) :: near
      real(wp) :: reach, square
      integer :: i

      call quadratic_denominators(size(self%m), self%m, self%pole, root, D, dD)
      if (self%relaxation%n > 0) call relax_denominators(self, root, D, dD)
      if (.not. present(inverse)) return
      reach = epsilon(1.0_wp)**2*(real(root%s)**2 + aimag(root%s)**2)
      do i = 1, size(self%m)
         near = D(i)
         square = real(near)**2 + aimag(near)**2
         if (.not. square > reach*(real(dD(i))**2 + aimag(dD(i))**2)) then
            near = epsilon(1.0_wp)*root%s*dD(i)
            square = real(near)**2 + aimag(near)**2
         end if
         inverse(i) = 0
         if (square > 0) inverse(i) = cmplx(real(near)/square, -aimag(near)/square, wp)
      end do
      inverse(root%j) = 0
   end subroutine denominators

   !> Computes D and D' at a point without relaxations. The distances from the poles are formed
   !> relative to the nearest pole, so that none loses digits by cancellation.
   !>
   !> m      (n) modal masses m_i of D_i = m_i s**2 + c_i s + k_i
   !> pole   (n, 2) roots of D_i [1/time]
   !> D, dD  (n) D and D'
   pure subroutine quadratic_denominators(n, m, pole, root, D, dD)
      integer, intent(in) :: n
      real(wp), intent(in) :: m(n)
      complex(wp), intent(in) :: pole(n, *)
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: D(n), dD(n)
      complex(wp) :: origin, left, right
      integer :: i

      origin = pole(root%origin, root%side)
      do i = 1, n
         left = (origin - pole(i, 1)) + root%offset
         right = (origin - pole(i, 2)) + root%offset
         dD(i) = cmplx(m(i)*real(left + right), m(i)*aimag(left + right), wp)
         left = left*right
         D(i) = cmplx(m(i)*real(left), m(i)*aimag(left), wp)
      end do
   end subroutine quadratic_denominators

   !> Changes D and D' at a point to those with relaxations.
   !>
   !> D, dD  (n) in: from `quadratic_denominators`; out: D and D'
   pure subroutine relax_denominators(self, root, D, dD)
      type(oscillators_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(inout) :: D(:), dD(:)
      complex(wp) :: past(2), inverse, slope, origin
      real(wp) :: pole(size(D))
      integer :: i, l

      past = past_relaxations(self, root)
      where (self%relaxes) dD = 2*self%m*root%s + self%c
      where (self%relaxes .and. self%l > 0) D = (self%m*root%s + self%c)*root%s &
         + cmplx(self%k, self%l, wp)
      do l = 1, self%relaxation%n
         inverse = 1/past(l)
         slope = self%relaxation%rate(l)*inverse**2
         ! As in `distance_between`, to all digits near a pole of this relaxation.
         if (root%side == 2 + l) then
            pole = self%creep(:, l)
            origin = pole(root%origin)
         else
            pole = real(self%pole(:, 2 + l))
            origin = self%pole(root%origin, root%side)
         end if
         do i = 1, size(D)
            if (.not. self%relaxes(i)) cycle
            dD(i) = dD(i) + self%relaxed(i, l)*slope
            if (self%l(i) > 0) then
               D(i) = D(i) + self%relaxed(i, l)*root%s*inverse
            else
               D(i) = D(i)*((origin - pole(i)) + root%offset)*inverse
            end if
         end do
      end do
   end subroutine relax_denominators

   !> Returns x'D'' x at a point, where D'' is the second derivative of D with respect to s.
   pure complex(wp) function second_derivative(self, root, x) result(value)
      class(oscillators_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(in) :: x(:)
      complex(wp) :: past(2)
      integer :: l

      value = 2*sum(self%m*x**2)
      past = past_relaxations(self, root)
      do l = 1, self%relaxation%n
         value = value - 2*self%relaxation%rate(l)/past(l)**3*sum(self%relaxed(:, l)*x**2)
      end do
   end function second_derivative

   !> Returns s + b at a point for each relaxation, to all digits [1/time].
   pure function past_relaxations(self, root) result(past)
      type(oscillators_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp) :: past(2)
      integer :: l

      past = root%s + self%relaxation%rate
      l = root%side - 2
      if (l > 0) past(l) = self%rise(root%origin, l) + root%offset
   end function past_relaxations

   !> Returns the factors of the coefficients in Q at a point, and their first two derivatives with
   !> respect to s.
   !>
   !> f  (changes, 0:2) factors; 0 for a relaxation without a rate
   pure function factors(self, root) result(f)
      class(oscillators_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp) :: f(changes, 0:2)
      complex(wp) :: past, of_relaxations(2)
      integer :: l

      f = 0
      f(of_mass, :) = [root%s**2, 2*root%s, (2.0_wp, 0.0_wp)]
      f(of_damping, :1) = [root%s, (1.0_wp, 0.0_wp)]
      f(of_stiffness, 0) = 1
      f(of_loss, 0) = (0.0_wp, 1.0_wp)
      of_relaxations = past_relaxations(self, root)
      do l = 1, size(self%rates)
         associate (b => self%rates(l), slot => self%relaxation%slot(l))
            if (.not. b > 0) cycle
            past = root%s + b
            if (slot > 0) past = of_relaxations(slot)
            f(of_relaxation(l), :) = [root%s/past, b/past**2, -2*b/past**3]
            f(of_rate(l), :1) = [-root%s/past**2, (root%s - b)/past**3]
         end associate
      end do
   end function factors

   !> Returns the difference a - b of two points with the full accuracy of their offsets.
   pure complex(wp) function distance_between(self, a, b) result(distance)
      class(oscillators_t), intent(in) :: self
      type(root_t), intent(in) :: a, b

      if (a%side > 2 .and. a%side == b%side) then
         distance = self%creep(a%origin, a%side - 2) - self%creep(b%origin, b%side - 2)
      else
         distance = self%pole(a%origin, a%side) - self%pole(b%origin, b%side)
      end if
      distance = distance + (a%offset - b%offset)
   end function distance_between

   !> Returns |s + E/c_D| c_D/E, the relative distance of s from -E/c_D, the accumulation point of
   !> the slow roots of overdamped modes. The residue of such a root is reduced by the same factor.
   !> With relaxations, it is |phi| of `beamid_relaxations`.
   pure real(wp) function distance_from_accumulation(self, s)
      class(oscillators_t), intent(in) :: self
      complex(wp), intent(in) :: s

      associate (E => self%E, of => self%relaxation)
         distance_from_accumulation = abs(self%c_D*s + E &
            + E*sum(of%strength(:of%n)*s/(s + of%rate(:of%n))))/E
      end associate
   end function distance_from_accumulation

   !> Returns some of the oscillators, if nothing relaxes.
   !>
   !> kept  numbers of the oscillators that remain
   pure type(oscillators_t) function select_oscillators(self, kept) result(few)
      class(oscillators_t), intent(in) :: self
      integer, intent(in) :: kept(:)

      few%m = self%m(kept)
      few%c = self%c(kept)
      few%k = self%k(kept)
      few%l = self%l(kept)
      few%relaxes = self%relaxes(kept)
      few%E = self%E
      few%c_D = self%c_D
      few%pole = self%pole(kept, :)
   end function select_oscillators

end module beamid_oscillators
