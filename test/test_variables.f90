!> The change of variable behind every fit: bounds kept, derivative right, starts where documented.
program test_variables
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp)
   !> Start, lower, upper, magnitude; the last two groups start at or next to a bound.
   real(wp), parameter :: cases(4, 17) = reshape([ &
      2.0_wp, -unbounded, unbounded, 1.0_wp, &
      -3.0_wp, -unbounded, unbounded, 1.0_wp, &
      0.0_wp, -unbounded, unbounded, 0.5_wp, &
      0.4_wp, 0.0_wp, unbounded, 0.1_wp, &
      1e-6_wp, 0.0_wp, unbounded, 1e-3_wp, &
      1e9_wp, 0.0_wp, unbounded, 1.0_wp, &
      -2.0_wp, -5.0_wp, unbounded, 1.0_wp, &
      -2.0_wp, -unbounded, 7.0_wp, 1.0_wp, &
      0.3_wp, 0.0_wp, 1.0_wp, 0.1_wp, &
      0.999_wp, 0.0_wp, 1.0_wp, 0.1_wp, &
      100.0_wp, 0.0035_wp, 1e5_wp, 1.0_wp, &
      0.0_wp, 0.0_wp, unbounded, 0.5_wp, &
      4.0_wp, -unbounded, 4.0_wp, 0.5_wp, &
      0.0_wp, 0.0_wp, 1.0_wp, 0.5_wp, &
      1.0_wp, 0.0_wp, 1.0_wp, 0.5_wp, &
      0.0_wp, 0.0_wp, 1e3_wp, 0.5_wp, &
      1e-9_wp, 0.0_wp, unbounded, 0.5_wp], [4, 17])
   !> Where the last six must start: one per cent of the magnitude inside, at most 1/1000 of the
   !> interval: .005; .005; .001; .001; .005 (interval 1000); 1e-9 counts as at the bound: .005.
   real(wp), parameter :: moved(6) = [0.005_wp, 3.995_wp, 0.001_wp, 0.999_wp, 0.005_wp, 0.005_wp]
   integer :: k

   do k = 1, size(cases, 2)
      call test_start(k)
      call test_derivative(k)
      call test_bounds(k)
   end do
   call test_linear()
   call finish('variables')

contains

   type(variable_t) function variable(k)
      integer, intent(in) :: k

      variable = new_variable(cases(1, k), cases(2, k), cases(3, k), cases(4, k))
   end function variable

   function name(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text

      text = 'start '//to_text(cases(1, k))//' in ['//bound(cases(2, k))//', '// &
         bound(cases(3, k))//']: '
   end function name

   function bound(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = 'none'
      if (abs(value) < unbounded) text = to_text(value)
   end function bound

   !> z = 1 is the start, moved inside when it lies at a bound, and said so in `start`.
   subroutine test_start(k)
      integer, intent(in) :: k
      type(variable_t) :: v
      real(wp) :: expected, scale, distance, stretch

      v = variable(k)
      expected = cases(1, k)
      if (k > size(cases, 2) - size(moved)) expected = moved(k - size(cases, 2) + size(moved))
      ! The start is recovered from its distance to the bound: round-off of the larger of the two,
      ! and sin(asin) near the upper of two bounds, 1e-3 of the interval, costs a factor sqrt(1e3).
      scale = max(abs(expected), merge(abs(cases(2, k)), 0.0_wp, abs(cases(2, k)) < unbounded), &
         merge(abs(cases(3, k)), 0.0_wp, abs(cases(3, k)) < unbounded .and. &
         abs(cases(2, k)) < unbounded))
      call check_close(name(k)//'component start', v%start, expected, 4*eps*scale)
      call check_close(name(k)//'value at z = 1', v%value(1.0_wp), expected, 8*eps*scale)
      ! A search that moves z by one moves the parameter by about its distance to the nearer bound;
      ! by its own size where there is none. Next to the upper of two bounds it turns back: z = 1
      ! lies pi along the sine, whose slope there is pi times the square root of distance and
      ! interval.
      stretch = 4
      if (max(abs(cases(2, k)), abs(cases(3, k))) < unbounded) stretch = &
         4*sqrt((cases(3, k) - cases(2, k))/min(v%start - cases(2, k), cases(3, k) - v%start))
      distance = min(abs(v%start - cases(2, k)), abs(cases(3, k) - v%start))
      if (distance > unbounded/2) distance = merge(abs(v%start), cases(4, k), abs(v%start) > 0)
      call check(name(k)//'order one', abs(v%derivative(1.0_wp)) > distance/2 .and. &
         abs(v%derivative(1.0_wp)) < stretch*distance, &
         'dv/dz = '//to_text(v%derivative(1.0_wp))//', distance '//to_text(distance))
   end subroutine test_start

   !> Against central differences: h^2/6 times a third derivative of the size of the scale, plus
   !> round-off eps/h; with h = 1e-5 both lie below 1e-9 of the largest value around.
   subroutine test_derivative(k)
      integer, intent(in) :: k
      real(wp), parameter :: z(*) = [-2.0_wp, -0.3_wp, 0.2_wp, 1.0_wp, 1.7_wp, 4.0_wp], h = 1e-5_wp
      type(variable_t) :: v
      real(wp) :: difference, scale
      integer :: i

      v = variable(k)
      do i = 1, size(z)
         difference = (v%value(z(i) + h) - v%value(z(i) - h))/(2*h)
         scale = abs(v%derivative(1.0_wp)) + maxval(abs(v%value([-4.0_wp, 1.0_wp, 4.0_wp])))
         call check_close(name(k)//'derivative at z = '//to_text(z(i)), &
            v%derivative(z(i))/scale, difference/scale, 1e-9_wp)
      end do
   end subroutine test_derivative

   !> No z leads outside; and z reaches the whole of the interval.
   subroutine test_bounds(k)
      integer, intent(in) :: k
      type(variable_t) :: v
      real(wp) :: least, largest, value
      integer :: i, j

      v = variable(k)
      least = huge(least)
      largest = -huge(largest)
      do i = -60, 60
         do j = -1, 1, 2
            value = v%value(j*10.0_wp**(i/10.0_wp))
            least = min(least, value)
            largest = max(largest, value)
         end do
      end do
      call check(name(k)//'bounds kept for |z| from 1e-6 to 1e6', least >= cases(2, k) .and. &
         largest <= cases(3, k), to_text(least)//' to '//to_text(largest))
      do i = 0, 100000
         value = v%value(i*1e-2_wp)
         least = min(least, value)
         largest = max(largest, value)
      end do
      ! A fine scan of z comes to within 1e-4 of the interval of two bounds, and past ten times
      ! the start or the magnitude where there is none.
      if (abs(cases(2, k)) < unbounded .and. abs(cases(3, k)) < unbounded) then
         call check(name(k)//'reaches both bounds', &
            least - cases(2, k) < 1e-4_wp*(cases(3, k) - cases(2, k)) .and. &
            cases(3, k) - largest < 1e-4_wp*(cases(3, k) - cases(2, k)))
      else
         call check(name(k)//'reaches far', largest - least > 10*max(abs(v%start - merge(cases(2, &
            k), 0.0_wp, abs(cases(2, k)) < unbounded)), cases(4, k)*0.01_wp))
      end if
   end subroutine test_bounds

   !> Unbounded: start + scale (z - 1), a straight line.
   subroutine test_linear()
      type(variable_t) :: v

      v = variable(2)
      call check_close('unbounded is linear', v%value(3.0_wp), 3.0_wp, 8*eps)
      v = variable(3)
      call check_close('from zero by the magnitude', v%value(3.0_wp), 1.0_wp, 4*eps)
   end subroutine test_linear

end program test_variables
