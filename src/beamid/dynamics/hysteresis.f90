!> The integrals of spatial hysteresis, an internal damping by which distant sections of the beam
!> resist a difference of their rotations (Banks and Inman, J. Appl. Mech. 58, 1991, 716). Per unit
!> of strength,
!>
!>     G(phi, psi) = 1/2 int int h(x - xi) (phi'(x) - phi'(xi)) (psi'(x) - psi'(xi)) dxi dx,
!>
!> where h is the normal density with the standard deviation b. A slope is the integral of the
!> curvature. With the second integral Q of h, so that Q'' = h and Q vanishes at infinity,
!>
!>     G(phi, psi) = int int W(s, t) phi''(s) psi''(t) ds dt,
!>     W(s, t) = Q(|s - t|) + Q(l) - Q(max(s, t)) - Q(l - min(s, t)) >= 0.
!>
!> In this form nothing cancels for small b, where G tends to b**2/2 <phi'', psi''>. For b > l, a
!> linear function is subtracted from Q. W does not change, and nothing cancels either.
!>
!> The curvatures are polynomials on each element. The integral over two elements is one over the
!> distance r = |s - t|, on panels that are short in comparison with b, of Q(r) times a polynomial.
!> Its error is round-off, about 1e-13 of the largest entry, for every b > 0.
module beamid_hysteresis
   use beamid_kinds, only: two_pi, wp
   use beamid_modes, only: beam_modes_t
   use beamid_quadrature, only: gauss_legendre, rule_t
   implicit none
   private

   public :: hysteresis_products

   !> Length of a panel in units of b, and Gauss points on it: the error is below 1e-17.
   real(wp), parameter :: panel = 2
   integer, parameter :: panel_points = 12
   !> Distance in units of b beyond which Q counts as 0; it is 1e-20 there.
   real(wp), parameter :: reach = 9

   !> The curvatures of all modes as polynomials, and the quadrature rules for them.
   type :: curvature_t
      integer :: terms = 0                     !< number of Legendre polynomials on an element
      real(wp), allocatable :: ends(:)         !< (0:elements) ends of the elements [length]
      !> (terms, 0:elements - 1, modes) coefficients of phi''
      real(wp), allocatable :: c(:, :, :)
      !> (0:elements, modes) phi'(x) - phi'(0) at the ends of the elements
      real(wp), allocatable :: slope(:, :)
      type(rule_t) :: exact                    !< rule for the product of two curvatures
      type(rule_t) :: rule                     !< rule on a panel
   end type curvature_t

contains

   !> Computes the integrals of spatial hysteresis and their derivatives with respect to its range.
   !>
   !> b         range of the kernel [length]; 0: the integrals vanish
   !> values    (modes, modes) G [1/length]
   !> by_range  (modes, modes) dG/db
   subroutine hysteresis_products(modes, b, values, by_range)
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: b
      real(wp), intent(out) :: values(:, :), by_range(:, :)
      type(curvature_t) :: curvature
      real(wp), allocatable :: kernel(:, :, :)
      real(wp) :: ends(size(values, 1), size(values, 1), 2), whole(size(values, 1)), Q(2)
      integer :: n

      values = 0
      by_range = 0
      if (.not. b > 0) return
      call expand_curvatures(modes, curvature)
      call find_kernel(curvature, b, kernel)
      call add_ends(curvature, b, ends)
      n = size(curvature%ends) - 1
      associate (c => reshape(curvature%c, [curvature%terms*n, size(values, 1)]))
         values = matmul(transpose(c), matmul(kernel(:, :, 1), c))
         by_range = matmul(transpose(c), matmul(kernel(:, :, 2), c))
      end associate
      whole = curvature%slope(n, :)
      Q = second_integral(curvature%ends(n), b, curvature%ends(n))
      values = values - ends(:, :, 1) + Q(1)*spread(whole, 1, size(whole)) &
         *spread(whole, 2, size(whole))
      by_range = by_range - ends(:, :, 2) + Q(2)*spread(whole, 1, size(whole)) &
         *spread(whole, 2, size(whole))
   end subroutine hysteresis_products

   !> Computes Q(r), the second integral of the kernel, and dQ/db, (2). For b > l, both are those
   !> less a linear function of r.
   !>
   !> r  distance, >= 0 [length]
   !> l  length of the beam [length]
   pure function second_integral(r, b, l) result(Q)
      real(wp), intent(in) :: r, b, l
      real(wp) :: Q(2)
      real(wp), parameter :: peak = 1/sqrt(two_pi), root_half = sqrt(0.5_wp)
      real(wp) :: z, fall

      z = r/b
      if (b > l) then
         ! exp(-z**2/2) - 1, without cancellation.
         fall = -2*exp(-z**2/4)*sinh(z**2/4)
         Q = peak*[b*fall, fall]
         Q(1) = Q(1) + r*erf(z*root_half)/2
      else
         Q(2) = peak*exp(-z**2/2)
         Q(1) = b*Q(2) - r*erfc(z*root_half)/2
      end if
   end function second_integral

   !> Expands the curvatures of all modes in Legendre polynomials on each element.
   subroutine expand_curvatures(modes, self)
      type(beam_modes_t), intent(in) :: modes
      type(curvature_t), intent(out) :: self
      real(wp) :: b(modes%space%degree + 1), bent(size(modes%mu))
      integer :: e, first, k, q

      associate (space => modes%space)
         self%terms = space%degree - 1
         self%exact = gauss_legendre(self%terms)
         self%rule = gauss_legendre(panel_points)
         self%ends = space%ends
         allocate (self%c(self%terms, 0:space%elements - 1, size(modes%mu)), source=0.0_wp)
         allocate (self%slope(0:space%elements, size(modes%mu)), source=0.0_wp)
         do e = 0, space%elements - 1
            first = space%first_on_element(e)
            associate (last => space%last_on_element(e))
               do q = 1, self%terms
                  b = space%on_element(e, self%exact%points(q), 2)
                  bent = self%exact%weights(q)*matmul(b(:last - first + 1), &
                     modes%shapes(first:last, :))
                  associate (p => legendre(self%terms, self%exact%points(q)))
                     do k = 1, self%terms
                        self%c(k, e, :) = self%c(k, e, :) + (2*k - 1)*p(k)*bent
                     end do
                  end associate
               end do
            end associate
            self%c(:, e, :size(modes%rigid, 2)) = 0
            self%slope(e + 1, :) = self%slope(e, :) &
               + (space%ends(e + 1) - space%ends(e))*self%c(1, e, :)
         end do
      end associate
   end subroutine expand_curvatures

   !> Returns the first Legendre polynomials on [0, 1] at a position.
   !>
   !> n  number of polynomials
   !> s  position, 0 .. 1
   pure function legendre(n, s) result(p)
      integer, intent(in) :: n
      real(wp), intent(in) :: s
      real(wp) :: p(n), u
      integer :: k

      u = 2*s - 1
      p(1) = 1
      if (n > 1) p(2) = u
      do k = 2, n - 1
         p(k + 1) = ((2*k - 1)*u*p(k) - (k - 1)*p(k - 1))/k
      end do
   end function legendre

   !> Computes the integrals of Q(|s - t|), and of its derivative with respect to b, times the
   !> Legendre polynomials of all pairs of elements.
   !>
   !> kernel  (terms x elements, terms x elements, 2)
   subroutine find_kernel(self, b, kernel)
      type(curvature_t), intent(in) :: self
      real(wp), intent(in) :: b
      real(wp), allocatable, intent(out) :: kernel(:, :, :)
      real(wp) :: block(self%terms, self%terms, 2)
      integer :: e, f, i, n, p

      p = self%terms
      n = size(self%ends) - 1
      allocate (kernel(p*n, p*n, 2), source=0.0_wp)
      do e = 0, n - 1
         do f = e, n - 1
            if (b <= self%ends(n) .and. self%ends(f) - self%ends(e + 1) > reach*b) exit
            call integrate_pair(self, b, e, f, block)
            do i = 1, 2
               kernel(p*e + 1:p*e + p, p*f + 1:p*f + p, i) = block(:, :, i)
               if (e == f) block(:, :, i) = block(:, :, i) + transpose(block(:, :, i))
               kernel(p*f + 1:p*f + p, p*e + 1:p*e + p, i) = transpose(block(:, :, i))
            end do
         end do
      end do
   end subroutine find_kernel

   !> Computes the integrals of Q(t - s), s < t, times the Legendre polynomials of two elements.
   !>
   !> e, f   element of s and element of t, e <= f
   !> block  (terms, terms, 2) indexed (s, t), and their derivatives with respect to b
   subroutine integrate_pair(self, b, e, f, block)
      type(curvature_t), intent(in) :: self
      real(wp), intent(in) :: b
      integer, intent(in) :: e, f
      real(wp), intent(out) :: block(:, :, :)
      real(wp) :: left, right, gap, breaks(0:3), length
      integer :: k, m, panels

      left = self%ends(e + 1) - self%ends(e)
      right = self%ends(f + 1) - self%ends(f)
      gap = self%ends(f) - self%ends(e)
      ! The overlap of the elements, one shifted by r, is a different polynomial of r in each part.
      breaks = max(0.0_wp, [gap - left, min(gap, gap + right - left), max(gap, gap + right &
         - left), gap + right])
      if (b <= self%ends(ubound(self%ends, 1))) &
         breaks = min(breaks, max(breaks(0), reach*b))
      block = 0
      do k = 1, 3
         length = breaks(k) - breaks(k - 1)
         if (.not. length > 0) cycle
         panels = ceiling(length/(panel*b))
         do m = 1, panels
            call add_panel(self, b, [left, right, gap], breaks(k - 1) + (m - 1)*length/panels, &
               length/panels, block)
         end do
      end do
   end subroutine integrate_pair

   !> Adds the integral over one panel of the distance r.
   !>
   !> sizes          lengths of the elements of s and t, and distance of their beginnings [length]
   !> begin, length  of the panel [length]
   subroutine add_panel(self, b, sizes, begin, length, block)
      type(curvature_t), intent(in) :: self
      real(wp), intent(in) :: b, sizes(3), begin, length
      real(wp), intent(inout) :: block(:, :, :)
      real(wp) :: r, low, high, s, Q(2), weight
      real(wp), dimension(self%terms) :: p, p_t
      integer :: i, j, k, l

      associate (left => sizes(1), right => sizes(2), gap => sizes(3), rule => self%rule, &
         exact => self%exact)
         do k = 1, size(rule%points)
            r = begin + length*rule%points(k)
            Q = length*rule%weights(k)*second_integral(r, b, self%ends(ubound(self%ends, 1)))
            low = max(0.0_wp, gap - r)
            high = min(left, gap + right - r)
            do l = 1, size(exact%points)
               s = low + (high - low)*exact%points(l)
               weight = (high - low)*exact%weights(l)
               p = legendre(self%terms, s/left)
               p_t = legendre(self%terms, (s + r - gap)/right)
               do j = 1, size(p)
                  do i = 1, size(p)
                     block(i, j, :) = block(i, j, :) + weight*p(i)*p_t(j)*Q
                  end do
               end do
            end do
         end do
      end associate
   end subroutine add_panel

   !> Computes the integrals of Q(max(s, t)) + Q(l - min(s, t)) times two curvatures, and their
   !> derivatives with respect to b. They are the integrals of
   !> Q(x) (phi'' slope_psi + slope_phi psi'') over both distances x from an end, where a slope is
   !> that relative to this end.
   !>
   !> values  (modes, modes, 2)
   subroutine add_ends(self, b, values)
      type(curvature_t), intent(in) :: self
      real(wp), intent(in) :: b
      real(wp), intent(out) :: values(:, :, :)
      integer :: e, end, n

      values = 0
      n = ubound(self%ends, 1)
      do e = 0, n - 1
         do end = 1, 2
            call add_element(self, b, e, end, values)
         end do
      end do
      values(:, :, 1) = values(:, :, 1) + transpose(values(:, :, 1))
      values(:, :, 2) = values(:, :, 2) + transpose(values(:, :, 2))
   end subroutine add_ends

   !> Adds the part of one element to half of `add_ends`.
   !>
   !> end  1: root, 2: tip
   subroutine add_element(self, b, e, end, values)
      type(curvature_t), intent(in) :: self
      real(wp), intent(in) :: b
      integer, intent(in) :: e, end
      real(wp), intent(inout) :: values(:, :, :)
      real(wp) :: near, length, r, s, p(self%terms + 1), u
      real(wp), dimension(size(values, 1)) :: bent, slope
      real(wp), allocatable :: left(:, :, :), right(:, :)
      real(wp) :: Q(2)
      integer :: i, k, m, n, panels

      n = ubound(self%ends, 1)
      associate (h => self%ends(e + 1) - self%ends(e), l => self%ends(n), rule => self%rule, &
         c => self%c(:, e, :))
         near = merge(self%ends(e), l - self%ends(e + 1), end == 1)
         length = h
         if (b <= l) length = min(h, reach*b - near)
         if (.not. length > 0) return
         panels = ceiling(length/(panel*b))
         allocate (left(panels*size(rule%points), size(values, 1), 2), &
            right(panels*size(rule%points), size(values, 1)))
         i = 0
         do m = 1, panels
            do k = 1, size(rule%points)
               i = i + 1
               u = (m - 1 + rule%points(k))*length/panels
               r = near + u
               s = merge(u, h - u, end == 1)/h
               p = legendre(self%terms + 1, s)
               bent = matmul(p(:self%terms), c)
               Q = length/panels*rule%weights(k)*second_integral(r, b, l)
               slope = self%slope(e, :) + h*matmul(integrals(p, s), c)
               if (end == 2) slope = self%slope(n, :) - slope
               left(i, :, 1) = Q(1)*bent
               left(i, :, 2) = Q(2)*bent
               right(i, :) = slope
            end do
         end do
         do i = 1, 2
            values(:, :, i) = values(:, :, i) + matmul(transpose(left(:, :, i)), right)
         end do
      end associate
   end subroutine add_element

   !> Returns the integrals of the Legendre polynomials from 0 to a position.
   !>
   !> p  (terms + 1) Legendre polynomials there
   !> s  position, 0 .. 1
   pure function integrals(p, s) result(values)
      real(wp), intent(in) :: p(:), s
      real(wp) :: values(size(p) - 1)
      integer :: k

      values(1) = s
      do k = 2, size(values)
         values(k) = (p(k + 1) - p(k - 1))/(2*(2*k - 1))
      end do
   end function integrals

end module beamid_hysteresis
