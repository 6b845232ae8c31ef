!> Gauss-Legendre rules: exact where they must be, and wrong by the known amount where they are not.
program test_quadrature
   use beamid_kinds, only: wp
   use beamid_quadrature, only: composite, gauss_legendre, rule_t
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp)
   integer, parameter :: panels(*) = [1, 2, 3, 4, 7]
   integer :: n, p

   do n = 1, 20
      do p = 1, size(panels)
         call test_exactness(n, panels(p))
         call test_shape(n, panels(p))
      end do
      call test_limit(n)
   end do
   call test_composite_error()
   call test_known_rules()
   call finish('quadrature')

contains

   !> Monomials on [0, 1]: integral of x^k = 1/(k + 1), k = 0 .. 2n - 1.
   subroutine test_exactness(n, panels)
      integer, intent(in) :: n, panels
      type(rule_t) :: rule
      real(wp) :: worst
      integer :: k

      rule = composite(n, panels)
      worst = 0
      do k = 0, 2*n - 1
         worst = max(worst, abs((k + 1)*sum(rule%weights*rule%points**k) - 1))
      end do
      ! A point off by eps changes x^k by k eps, and most of the integral lies near 1: 2 n eps.
      ! Weights carry as much again from the recurrence.
      call check_close('n = '//to_text(n)//', panels = '//to_text(panels)// &
         ': worst of x^0 .. x^(2n-1)', worst, 0.0_wp, (4*n + 8)*eps)
   end subroutine test_exactness

   !> Weights positive with sum 1; points inside, ascending, symmetric about 1/2 with their weights.
   subroutine test_shape(n, panels)
      integer, intent(in) :: n, panels
      type(rule_t) :: rule
      character(len=:), allocatable :: name
      integer :: m

      rule = composite(n, panels)
      m = n*panels
      name = 'n = '//to_text(n)//', panels = '//to_text(panels)//': '
      call check(name//'points inside and ascending', size(rule%points) == m .and. &
         size(rule%weights) == m .and. all(rule%points > 0) .and. all(rule%points < 1) .and. &
         all(rule%points(2:) > rule%points(:m - 1)) .and. all(rule%weights > 0))
      ! Sum of m numbers of mean 1/m, each right to a few eps.
      call check_close(name//'sum of weights', sum(rule%weights), 1.0_wp, (n + 4)*eps)
      ! Round-off of points of order 1; weights are at most 1, of condition n.
      call check_close(name//'symmetric points', &
         maxval(abs(rule%points + rule%points(m:1:-1) - 1)), 0.0_wp, 4*eps)
      call check_close(name//'symmetric weights', &
         maxval(abs(rule%weights - rule%weights(m:1:-1))), 0.0_wp, 4*n*eps/panels)
   end subroutine test_shape

   !> The square of the polynomial with the points for zeros has degree 2n: the rule says 0, the
   !> integral, which the next rule finds, is (n!)^4/((2n + 1) (2n)!^2).
   subroutine test_limit(n)
      integer, intent(in) :: n
      type(rule_t) :: rule, next
      real(wp) :: exact, value
      integer :: k

      rule = gauss_legendre(n)
      next = gauss_legendre(n + 1)
      exact = 1/(2*n + 1.0_wp)
      do k = 1, n
         exact = exact*(k/real(n + k, wp))**2
      end do
      value = 0
      do k = 1, n + 1
         value = value + next%weights(k)*product((next%points(k) - rule%points)**2)
      end do
      ! The zeros of neighbouring rules lie 1/n apart, near the ends 1/n^2: differences of points
      ! lose n^2 eps at most there, n of them.
      call check_close('n = '//to_text(n)//': degree 2n, integrated by n + 1 points', value/exact, &
         1.0_wp, 4*n**2*eps)
      value = 0
      do k = 1, n
         value = value + rule%weights(k)*product((rule%points(k) - rule%points)**2)
      end do
      call check('n = '//to_text(n)//': degree 2n is not exact', abs(value) < 0.01_wp*exact, &
         'rule '//to_text(value)//', integral '//to_text(exact))
   end subroutine test_limit

   !> Error of the composite rule for x^(2n): (n!)^4/((2n + 1) (2n)!^2 panels^(2n)).
   subroutine test_composite_error()
      type(rule_t) :: rule
      real(wp) :: error, expected
      integer :: n, p, k

      do n = 1, 3
         do p = 1, size(panels)
            rule = composite(n, panels(p))
            error = 1/(2*n + 1.0_wp) - sum(rule%weights*rule%points**(2*n))
            expected = 1/(2*n + 1.0_wp)
            do k = 1, n
               expected = expected*(k/real(n + k, wp))**2/panels(p)**2
            end do
            ! Two numbers below 1/3 are subtracted: a few eps, absolute.
            call check_close('n = '//to_text(n)//', panels = '//to_text(panels(p))// &
               ': error of x^(2n)', error, expected, 8*eps)
         end do
      end do
   end subroutine test_composite_error

   !> Rules that one knows in closed form.
   subroutine test_known_rules()
      real(wp), parameter :: third = sqrt(1/3.0_wp)/2, fifth = sqrt(15.0_wp)/10
      !> Five points on [-1, 1]: +- sqrt(5 +- 2 sqrt(10/7))/3, (322 -+ 13 sqrt(70))/900.
      real(wp), parameter :: outer = sqrt(5 + 2*sqrt(10/7.0_wp))/3, &
         inner = sqrt(5 - 2*sqrt(10/7.0_wp))/3
      type(rule_t) :: rule

      ! Each is evaluated once by a few operations on either side.
      rule = gauss_legendre(1)
      call check_close('one point', rule%points(1), 0.5_wp, 2*eps)
      rule = gauss_legendre(2)
      call check_close('two points', maxval(abs(rule%points - [0.5_wp - third, 0.5_wp + third])), &
         0.0_wp, 2*eps)
      rule = gauss_legendre(3)
      call check_close('three points', maxval(abs(rule%points &
         - [0.5_wp - fifth, 0.5_wp, 0.5_wp + fifth])), 0.0_wp, 2*eps)
      call check_close('three weights', maxval(abs(rule%weights &
         - [5/18.0_wp, 8/18.0_wp, 5/18.0_wp])), 0.0_wp, 8*eps)
      rule = gauss_legendre(5)
      call check_close('five points', maxval(abs(2*rule%points - 1 &
         - [-outer, -inner, 0.0_wp, inner, outer])), 0.0_wp, 8*eps)
      call check_close('five weights', maxval(abs(2*rule%weights &
         - [322 - 13*sqrt(70.0_wp), 322 + 13*sqrt(70.0_wp), 512.0_wp, 322 + 13*sqrt(70.0_wp), &
            322 - 13*sqrt(70.0_wp)]/900)), 0.0_wp, 8*eps)
   end subroutine test_known_rules

end program test_quadrature
