!> The clamped spline space against truncated powers, the paper's nodal values and polynomials; what
!> it holds with knots where something jumps or has a kink.
program test_splines
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgels
   use beamid_splines, only: new_spline_space, spline_space_t
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, held_root, of_mesh
   implicit none

   integer, parameter :: degrees(*) = [3, 5, 7], meshes(*) = [1, 2, 3, 5, 16]
   real(wp), parameter :: eps = epsilon(1.0_wp)
   !> Neither 1 nor a power of 2: a forgotten power of the length shows.
   real(wp), parameter :: length = 2.5_wp
   integer :: d, m, root_rotation

   do d = 1, size(degrees)
      do m = 1, size(meshes)
         call test_root(degrees(d), meshes(m))
         call test_truncated_powers(degrees(d), meshes(m))
         do root_rotation = 0, 1
            call test_derivatives(degrees(d), meshes(m), root_rotation == 1)
            call test_continuity(degrees(d), meshes(m), root_rotation == 1)
            call test_polynomials(degrees(d), meshes(m), root_rotation == 1)
         end do
         call test_turning(degrees(d), meshes(m))
      end do
      call test_knots(degrees(d), .false.)
      call test_knots(degrees(d), .true.)
   end do
   call test_paper_values()
   call test_tip()
   call finish('splines')

contains

   !> Dimension N + degree - 2; b_i(0) = b_i'(0) = 0 for every i, b_i''(0) not for all of them.
   subroutine test_root(degree, elements)
      integer, intent(in) :: degree, elements
      type(spline_space_t) :: space
      real(wp) :: curvature, scale

      space = new_spline_space(degree, elements, length)
      call check(of_mesh(degree, elements)//'dimension', space%n == elements + degree - 2 .and. &
         size(space%at(0.0_wp, 0)) == space%n, to_text(space%n))
      ! Three terms of size degree! or less cancel, with coefficients up to some tens for degree 7:
      ! a hundred units of round-off of degree!.
      scale = 100*eps*gamma(degree + 1.0_wp)
      call check_close(of_mesh(degree, elements)//'values at the root', &
         maxval(abs(space%at(0.0_wp, 0))), 0.0_wp, scale)
      call check_close(of_mesh(degree, elements)//'slopes at the root', &
         maxval(abs(space%at(0.0_wp, 1))), 0.0_wp, scale*elements/length)
      curvature = maxval(abs(space%at(0.0_wp, 2)))
      call check(of_mesh(degree, elements)//'curvature at the root', &
         curvature > gamma(degree + 1.0_wp)*(elements/length)**2/2, 'largest '//to_text(curvature))
   end subroutine test_root

   !> Functions beyond the root are plain B-splines, here from their definition by truncated powers,
   !> B(x) = sum over k of (-1)^k C(p+1, k) (x + (p+1)/2 - k)_+^p. At the root they are combinations
   !> of three, determined (up to scale) by the two conditions: middle coefficient 1.
   subroutine test_truncated_powers(degree, elements)
      integer, intent(in) :: degree, elements
      type(spline_space_t) :: space
      real(wp) :: x, largest, middle(degree), slope(degree), b(3), coefficients(3), determinant
      real(wp), allocatable :: got(:)
      integer :: i, k, p

      space = new_spline_space(degree, elements, length)
      p = (degree - 1)/2
      middle = [(bspline(degree, real(p + 1 - i, wp)), i=1, degree)]
      slope = [(bspline_slope(degree, real(p + 1 - i, wp)), i=1, degree)]
      largest = 0
      do k = 0, 7*elements
         x = k*length/(7*elements)
         got = space%at(x, 0)
         do i = 1, space%n
            if (i > degree - 2) then
               largest = max(largest, abs(got(i) &
                  - bspline(degree, x/length*elements - (i - (degree - 3)/2))))
            else
               determinant = middle(i)*slope(i + 2) - middle(i + 2)*slope(i)
               coefficients(1) = (middle(i + 2)*slope(i + 1) - middle(i + 1)*slope(i &
                  + 2))/determinant
               coefficients(2) = 1
               coefficients(3) = (middle(i + 1)*slope(i) - middle(i)*slope(i + 1))/determinant
               b = [bspline(degree, x/length*elements - (i - p - 1)), &
                    bspline(degree, x/length*elements - (i - p)), &
                    bspline(degree, x/length*elements - (i - p + 1))]
               largest = max(largest, abs(got(i) - dot_product(coefficients, b)))
            end if
         end do
      end do
      ! Truncated powers cancel: the largest, near the centre, is about ((p+1)/2)^p; some of them,
      ! and coefficients up to some tens in the root combinations: a hundred units of its round-off.
      call check_close(of_mesh(degree, elements)//'against truncated powers', largest, 0.0_wp, &
         100*eps*((degree + 1)/2.0_wp)**degree)
   end subroutine test_truncated_powers

   !> B-spline of the given degree with unit spacing, centred at 0, scaled by degree!.
   pure real(wp) function bspline(degree, x)
      integer, intent(in) :: degree
      real(wp), intent(in) :: x
      real(wp) :: binomial
      integer :: k

      bspline = 0
      if (abs(x) >= (degree + 1)/2.0_wp) return
      binomial = 1
      do k = 0, degree + 1
         ! The mirror image with the fewer terms: B is even.
         bspline = bspline + binomial*max(0.0_wp, (degree + 1)/2.0_wp - abs(x) - k)**degree
         binomial = -binomial*(degree + 1 - k)/(k + 1)
      end do
   end function bspline

   !> B' from the definition.
   pure real(wp) function bspline_slope(degree, x) result(slope)
      integer, intent(in) :: degree
      real(wp), intent(in) :: x
      real(wp) :: binomial
      integer :: k

      slope = 0
      binomial = 1
      do k = 0, degree + 1
         slope = slope + binomial*degree*max(0.0_wp, (degree + 1)/2.0_wp + x - k)**(degree - 1)
         binomial = -binomial*(degree + 1 - k)/(k + 1)
      end do
   end function bspline_slope

   !> A root that may turn: one more function in front, the others those of the clamped space; all
   !> of them vanish at the root, the slope of the first alone does not.
   subroutine test_turning(degree, elements)
      integer, intent(in) :: degree, elements
      type(spline_space_t) :: space, clamped
      real(wp) :: largest, x, slope(elements + degree - 1)
      integer :: k, order

      space = new_spline_space(degree, elements, length, held_root(.true.))
      clamped = new_spline_space(degree, elements, length, held_root(.false.))
      call check(of_mesh(degree, elements, .true.)//'dimension', space%n == clamped%n + 1 .and. &
         clamped%n == elements + degree - 2, to_text(space%n))
      ! As in test_root.
      call check_close(of_mesh(degree, elements, .true.)//'values at the root', &
         maxval(abs(space%at(0.0_wp, 0))), 0.0_wp, 100*eps*gamma(degree + 1.0_wp))
      slope = space%at(0.0_wp, 1)/(elements/length)
      call check(of_mesh(degree, elements, .true.)//'slopes at the root', abs(slope(1)) > 0.1_wp &
         .and. maxval(abs(slope(2:))) <= 100*eps*gamma(degree + 1.0_wp), to_text(slope(1)))
      largest = 0
      do k = 0, 7*elements
         x = k*length/(7*elements)
         do order = 0, degree
            largest = max(largest, maxval(abs(tail(space, x, order) - clamped%at(x, order))))
         end do
      end do
      call check_close(of_mesh(degree, elements, .true.)//'others as clamped', largest, 0.0_wp, &
         0.0_wp)
      ! The first lives on two elements.
      if (elements > 2) call check(of_mesh(degree, elements, .true.)// &
         'first function vanishes beyond its support', all([( &
         abs(head(space, k*length/elements)) <= 0, k=(degree + 1)/2, elements)]))
   end subroutine test_turning

   !> All functions but the first.
   function tail(space, x, order) result(values)
      type(spline_space_t), intent(in) :: space
      real(wp), intent(in) :: x
      integer, intent(in) :: order
      real(wp) :: values(space%n - 1), all_values(space%n)

      all_values = space%at(x, order)
      values = all_values(2:)
   end function tail

   !> The first function.
   real(wp) function head(space, x)
      type(spline_space_t), intent(in) :: space
      real(wp), intent(in) :: x
      real(wp) :: all_values(space%n)

      all_values = space%at(x, 0)
      head = all_values(1)
   end function head

   !> Each derivative against the central difference of the one before. Eight points inside one
   !> element: exact for polynomials of degree 8, so only round-off is left.
   subroutine test_derivatives(degree, elements, root_rotation)
      integer, intent(in) :: degree, elements
      logical, intent(in) :: root_rotation
      real(wp), parameter :: weights(4) = &
         [4/5.0_wp, -1/5.0_wp, 4/105.0_wp, -1/280.0_wp], step = 1/16.0_wp
      type(spline_space_t) :: space
      real(wp), dimension(degree + 1) :: difference, derivative
      real(wp) :: largest
      integer :: order, e, k

      space = new_spline_space(degree, elements, length, held_root(root_rotation))
      do order = 1, degree
         largest = 0
         do e = 0, elements - 1
            difference = 0
            do k = 1, 4
               difference = difference + weights(k)/step*elements/length &
                  *(space%on_element(e, 0.45_wp + k*step, order - 1) &
                    - space%on_element(e, 0.45_wp - k*step, order - 1))
            end do
            derivative = space%on_element(e, 0.45_wp, order)
            largest = max(largest, maxval(abs(difference - derivative)))
         end do
         ! Values of size 2^(order-1) degree! (N/l)^(order-1), times 3 for the root combinations,
         ! lose 2 sum|weights|/step = 34 units of round-off; factor 4 for the evaluation itself.
         call check_close(of_mesh(degree, elements, root_rotation)//'derivative '//to_text(order), &
            largest, 0.0_wp, 400*eps*2.0_wp**(order - 1)*gamma(degree + 1.0_wp) &
            *(elements/length)**order)
      end do
   end subroutine test_derivatives

   !> Derivatives up to degree - 1 agree on both sides of each knot; that of order degree jumps.
   subroutine test_continuity(degree, elements, root_rotation)
      integer, intent(in) :: degree, elements
      logical, intent(in) :: root_rotation
      type(spline_space_t) :: space
      real(wp), allocatable :: left(:), right(:)
      real(wp) :: largest, unit, least
      integer :: order, e

      if (elements == 1) return
      space = new_spline_space(degree, elements, length, held_root(root_rotation))
      do order = 0, degree
         unit = 2.0_wp**order*gamma(degree + 1.0_wp)*(elements/length)**order
         largest = 0
         least = huge(least)
         do e = 1, elements - 1
            left = spread_out(space, e - 1, 1.0_wp, order)
            right = spread_out(space, e, 0.0_wp, order)
            largest = max(largest, maxval(abs(right - left)))
            least = min(least, maxval(abs(right - left)))
         end do
         if (order < degree) then
            ! Both sides are sums of the same few terms: some units of round-off of the size above.
            call check_close(of_mesh(degree, elements, root_rotation)// &
               'continuity of derivative '//to_text(order), largest, 0.0_wp, 40*eps*unit)
         else
            call check(of_mesh(degree, elements, root_rotation)// &
               'the highest derivative jumps at every knot', &
               least > 0.1_wp*unit, 'least jump '//to_text(least))
         end if
      end do
   end subroutine test_continuity

   !> `on_element` in a vector over all basis functions.
   function spread_out(space, element, s, order) result(values)
      type(spline_space_t), intent(in) :: space
      integer, intent(in) :: element, order
      real(wp), intent(in) :: s
      real(wp) :: values(space%n), local(space%degree + 1)
      integer :: i

      local = space%on_element(element, s, order)
      values = 0
      do i = 1, size(local)
         if (space%first_on_element(element) + i - 1 <= space%n) &
            values(space%first_on_element(element) + i - 1) = local(i)
      end do
   end function spread_out

   !> (x/l)^2 .. (x/l)^degree lie in the space, x/l too where the root may turn: fitted by least
   !> squares at some points, all derivatives agree at others.
   subroutine test_polynomials(degree, elements, root_rotation)
      integer, intent(in) :: degree, elements
      logical, intent(in) :: root_rotation
      type(spline_space_t) :: space
      real(wp), allocatable :: a(:, :), b(:, :), work(:)
      real(wp) :: x, exact
      real(wp) :: largest(0:degree - 1)
      integer :: rows, powers, k, order, power, info

      space = new_spline_space(degree, elements, length, held_root(root_rotation))
      powers = degree - 1 + merge(0, 1, space%essential(2, 1))
      rows = 2*degree*elements + 1
      allocate (a(rows, space%n), b(rows, powers), work(64*(rows + space%n)))
      do k = 1, rows
         x = (k - 1)*length/(rows - 1)
         a(k, :) = space%at(x, 0)
         b(k, :) = [((x/length)**power, power=degree - powers + 1, degree)]
      end do
      call dgels('N', rows, space%n, powers, a, rows, b, rows, work, size(work), info)
      largest = 0
      do k = 1, 29
         x = k*length/31
         do order = 0, degree - 1
            do power = degree - powers + 1, degree
               exact = 0
               if (power >= order) exact = gamma(power + 1.0_wp)/gamma(power - order + 1.0_wp) &
                  *(x/length)**(power - order)/length**order
               largest(order) = max(largest(order), &
                  abs(dot_product(space%at(x, order), b(:space%n, power - degree + powers)) &
                  - exact))
            end do
         end do
      end do
      ! The fit leaves an error e of some units of round-off, itself a spline; Markov's inequality
      ! on one element allows its derivatives (2N/l)^d T_p^(d)(1) |e|, with Chebyshev's polynomial,
      ! T_p^(d)(1) = product of (p^2 - k^2)/(2k + 1), k < d.
      do order = 0, degree - 1
         call check_close(of_mesh(degree, elements, root_rotation)//'x^2 .. x^p, derivative '// &
            to_text(order), merge(largest(order), huge(x), info == 0), 0.0_wp, &
            16*eps*(2*elements/length)**order &
            *product([((degree**2 - k**2)/(2*k + 1.0_wp), k=0, order - 1)]))
      end do
   end subroutine test_polynomials

   !> Of a space with knots: its dimension; x**2 .. x**p, and behind a knot of multiplicity m
   !> (x - b)_+**(p - m + 1) .. p, are in it, one power less is not; x too where the root turns.
   subroutine test_knots(degree, root_rotation)
      integer, intent(in) :: degree
      logical, intent(in) :: root_rotation
      real(wp), parameter :: breaks(3) = [0.11_wp, 0.407_wp, 0.73_wp]
      integer, parameter :: elements = 5
      type(spline_space_t) :: space
      integer :: times(3), e, k, n, order, rows, powers, info, q
      real(wp), allocatable :: a(:, :), b(:, :), work(:), left(:), right(:)
      real(wp) :: x, unity, worst(0:degree), unit, miss

      ! A jump, one that moves a knot of the mesh (.4), and a kink.
      times = [degree - 1, degree - 1, degree - 2]
      space = new_spline_space(degree, elements, length, held_root(root_rotation), breaks, times)
      associate (name => of_mesh(degree, elements, root_rotation)//'knots at breaks, ')
         call check(name//'dimension', space%n == elements + degree - 2 + sum(times) - 1 + &
            merge(1, 0, root_rotation) .and. space%elements == elements + 2, to_text(space%n))
         ! A knot of the mesh that is near has made way, one that is not remains.
         call check(name//'ends', all([(minval(abs(space%ends - breaks(k)*length)) <= 4*eps, &
            k=1, 3)]) .and. minval(abs(space%ends - 0.4_wp*length)) > 1e-3_wp .and. &
            minval(abs(space%ends - 0.2_wp*length)) <= 4*eps)

         unity = 0
         do e = 0, space%elements - 1
            ! Behind the functions at the root, which are combinations.
            if (space%first_on_element(e) < degree - 1 + merge(0, 1, space%essential(2, 1))) cycle
            do k = 0, 10
               unity = max(unity, abs(sum(space%on_element(e, k/10.0_wp, 0))/gamma(degree &
                  + 1.0_wp) - 1))
            end do
         end do
         call check_close(name//'partition of unity', unity, 0.0_wp, 20*eps)

         ! On both sides of a break w, w' and more are alike, w'' (a jump) or w''' (a kink) not.
         do k = 1, 3
            e = minloc(abs(space%ends(1:) - breaks(k)*length), dim=1)
            worst = 0
            do order = 0, degree - times(k) + 1
               left = spread_out(space, e - 1, 1.0_wp, order)
               right = spread_out(space, e, 0.0_wp, order)
               unit = max(maxval(abs(left)), maxval(abs(right)))
               worst(order) = maxval(abs(right - left))/unit
            end do
            ! The two sides sum different terms of size degree! or so times spans of knots as short
            ! as a tenth of an interval, to that power.
            call check_close(name//'continuous at '//to_text(breaks(k)), maxval(worst(:degree &
               - times(k))), 0.0_wp, 1e-12_wp)
            call check(name//'derivative '//to_text(degree - times(k) + 1)//' jumps at '// &
               to_text(breaks(k)), worst(degree - times(k) + 1) > 0.1_wp, &
               to_text(worst(degree - times(k) + 1)))
         end do

         powers = degree - 1 + merge(0, 1, space%essential(2, 1))
         n = powers + sum(times) + 3
         rows = 40*space%elements
         allocate (a(rows, space%n), b(rows, n), work(64*(rows + space%n + n)))
         do k = 1, rows
            x = (k - 0.5_wp)*length/rows
            a(k, :) = space%at(x, 0)
            b(k, :powers) = [((x/length)**q, q=degree - powers + 1, degree)]
            b(k, powers + 1:) = [(((max(0.0_wp, x/length - breaks(e)))**q, q=degree - times(e), &
               degree), e=1, 3)]
         end do
         call dgels('N', rows, space%n, n, a, rows, b, rows, work, size(work), info)
         call check(name//'independent', info == 0)
         q = powers
         ! A fit leaves round-off of functions of size one, as sums of B-splines that are larger.
         worst = 0
         worst(0) = maxval([(norm2(b(space%n + 1:, k)), k=1, powers)])
         miss = 1
         do e = 1, 3
            miss = min(miss, norm2(b(space%n + 1:, q + 1)))
            worst(0) = maxval([worst(0), (norm2(b(space%n + 1:, k)), k=q + 2, q + 1 + times(e))])
            q = q + 1 + times(e)
         end do
         call check_close(name//'powers and their parts', worst(0), 0.0_wp, 1e-12_wp)
         call check(name//'no more than these', miss > 1e-6_wp, to_text(miss))
      end associate
   end subroutine test_knots

   !> The cubic basis at nodes and between, by hand from B = 4 - 6 x^2 + 3 |x|^3 (|x| <= 1),
   !> (2 - |x|)^3 (1 <= |x| <= 2), and b_1 = B_0 - 2 B_1 - 2 B_{-1}, b_2 = B_2.
   subroutine test_paper_values()
      integer, parameter :: elements = 5
      !> Position in units of h; b_1, h b_1', h^2 b_1''; b_2, h b_2', h^2 b_2''.
      real(wp), parameter :: hand(7, 6) = reshape([ &
         0.0_wp, 0.0_wp, 0.0_wp, -36.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
         0.5_wp, -3.125_wp, -9.75_wp, -3.0_wp, 0.125_wp, 0.75_wp, 3.0_wp, &
         1.0_wp, -7.0_wp, -3.0_wp, 30.0_wp, 1.0_wp, 3.0_wp, 6.0_wp, &
         1.5_wp, -5.625_wp, 6.75_wp, 9.0_wp, 2.875_wp, 3.75_wp, -3.0_wp, &
         2.0_wp, -2.0_wp, 6.0_wp, -12.0_wp, 4.0_wp, 0.0_wp, -12.0_wp, &
         3.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -3.0_wp, 6.0_wp], [7, 6])
      type(spline_space_t) :: space
      real(wp) :: values(elements + 1), x
      integer :: k, order, function

      space = new_spline_space(3, elements, length)
      do k = 1, size(hand, 2)
         x = hand(1, k)*length/elements
         do order = 0, 2
            values = space%at(x, order)/(elements/length)**order
            do function = 1, 2
               ! Entries up to 36, a handful of operations each.
               call check_close('cubic b_'//to_text(function)//' derivative '//to_text(order)// &
                  ' at '//to_text(hand(1, k))//' h', values(function), &
                  hand(1 + 3*(function - 1) + order + 1, k), 200*eps)
            end do
         end do
      end do
   end subroutine test_paper_values

   !> b(l): 1, 4, 1 for the last three functions only for N >= 3.
   subroutine test_tip()
      type(spline_space_t) :: space
      real(wp), allocatable :: tip(:)
      integer :: m

      do m = 3, size(meshes)
         space = new_spline_space(3, meshes(m), length)
         tip = space%at(length, 0)
         ! Four terms of at most 4.
         call check_close(of_mesh(3, meshes(m))//'tip = w_{N-1} + 4 w_N + w_{N+1}', maxval(abs(tip &
            - [spread(0.0_wp, 1, meshes(m) - 2), 1.0_wp, 4.0_wp, 1.0_wp])), 0.0_wp, 20*eps)
      end do
      space = new_spline_space(3, 2, length)
      call check_close(of_mesh(3, 2)//'tip = -2 w_1 + 4 w_2 + w_3', &
         maxval(abs(space%at(length, 0) - [-2.0_wp, 4.0_wp, 1.0_wp])), 0.0_wp, 20*eps)
      space = new_spline_space(3, 1, length)
      call check_close(of_mesh(3, 1)//'tip = -7 w_1 + w_2', &
         maxval(abs(space%at(length, 0) - [-7.0_wp, 1.0_wp])), 0.0_wp, 40*eps)
   end subroutine test_tip

end program test_splines
