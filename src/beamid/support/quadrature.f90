!> Gauss-Legendre quadrature on the unit interval.
module beamid_quadrature
   use beamid_kinds, only: pi, wp
   implicit none
   private

   public :: rule_t, gauss_legendre, composite

   !> A quadrature rule: the integral of f over [0, 1] is sum(weights*f(points)). The points ascend.
   type :: rule_t
      real(wp), allocatable :: points(:)
      real(wp), allocatable :: weights(:)
   end type rule_t

contains

   !> Returns the n-point Gauss-Legendre rule on [0, 1], which is exact for polynomials of degree
   !> 2n - 1. Newton's method finds the zeros of the Legendre polynomial from Tricomi's estimates.
   !>
   !> n  number of points, >= 1
   pure function gauss_legendre(n) result(rule)
      integer, intent(in) :: n
      type(rule_t) :: rule
      real(wp) :: x, step, value, derivative
      integer :: k, iteration

      allocate (rule%points(n), rule%weights(n))
      do k = 1, n
         x = -cos(pi*(k - 0.25_wp)/(n + 0.5_wp))
         do iteration = 1, 20
            call legendre(n, x, value, derivative)
            step = value/derivative
            x = x - step
            if (abs(step) <= 2*epsilon(x)) exit
         end do
         call legendre(n, x, value, derivative)
         rule%points(k) = (1 + x)/2
         rule%weights(k) = 1/((1 - x**2)*derivative**2)
      end do
   end function gauss_legendre

   !> Returns the composite rule: the n-point rule on each of `panels` equal parts of [0, 1].
   pure function composite(n, panels) result(rule)
      integer, intent(in) :: n, panels
      type(rule_t) :: rule, single
      integer :: k

      single = gauss_legendre(n)
      rule%points = [((k - 1 + single%points)/panels, k=1, panels)]
      rule%weights = [(single%weights/panels, k=1, panels)]
   end function composite

   !> Computes the Legendre polynomial of degree n and its derivative at x, |x| < 1, by the
   !> three-term recurrence.
   pure subroutine legendre(n, x, value, derivative)
      integer, intent(in) :: n
      real(wp), intent(in) :: x
      real(wp), intent(out) :: value, derivative
      real(wp) :: previous, before
      integer :: k

      previous = 0
      value = 1
      do k = 1, n
         before = previous
         previous = value
         value = ((2*k - 1)*x*previous - (k - 1)*before)/k
      end do
      derivative = n*(x*value - previous)/(x**2 - 1)
   end subroutine legendre

end module beamid_quadrature
