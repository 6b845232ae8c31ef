!> Galerkin integrals against exact rationals, polynomials in closed form and Romberg's quadrature.
program test_galerkin
   use beamid_bands, only: band_t
   use beamid_galerkin, only: alone, galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, held_root, of_mesh
   use dense_matrices, only: dense_of
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp), length = 1.75_wp
   integer, parameter :: degrees(*) = [3, 5, 7], meshes(*) = [1, 2, 3, 5, 16]
   integer :: d, m, turning

   call test_cubic_rows()
   do d = 1, size(degrees)
      call test_interior_rows(degrees(d))
      do m = 1, size(meshes)
         do turning = 0, 1
            call test_against_romberg(degrees(d), meshes(m), turning == 1)
            call test_definite(degrees(d), meshes(m), turning == 1)
            call test_energy(degrees(d), meshes(m), turning == 1)
         end do
         call test_turn(degrees(d), meshes(m))
      end do
   end do
   do m = 1, size(meshes)
      call test_polynomials(meshes(m))
   end do
   call test_panels()
   call finish('galerkin')

contains

   !> Enough Gauss points for products of two splines to be integrated exactly.
   type(mesh_t) function exact_mesh(degree, elements)
      integer, intent(in) :: degree, elements

      exact_mesh = mesh_t(degree=degree, elements=elements, gauss_points=degree + 1)
   end function exact_mesh

   !> <B_i, B_j> = h 36 (2416, 1191, 120, 1)/5040 and <B_i'', B_j''> = (96, -54, 0, 6)/h^3.
   subroutine test_cubic_rows()
      integer, parameter :: elements = 12, row = 7
      real(wp), parameter :: inertia(0:3) = 36*[2416, 1191, 120, 1]/5040.0_wp, &
         bending(0:3) = [96.0_wp, -54.0_wp, 0.0_wp, 6.0_wp], h = length/elements
      type(galerkin_t) :: galerkin
      integer :: k

      ! The default mesh: four points, exact for cubics.
      galerkin = new_galerkin(mesh_t(degree=3, elements=elements), length)
      do k = 0, 3
         ! Sixteen products of size 16 h, and of size 144/h^3, added up.
         call check_close('cubic inertia, offset '//to_text(k), &
            galerkin%inertia%element(row, row + k)/h, inertia(k), 64*eps)
         call check_close('cubic bending, offset '//to_text(k), &
            galerkin%bending%element(row + k, row)*h**3, bending(k), 576*eps)
      end do
   end subroutine test_cubic_rows

   !> The integral of two cardinal B-splines of degree p is one of degree 2p + 1 at an integer, an
   !> Eulerian number over (2p + 1)!; two second differences of those of degree p - 2 for bending.
   subroutine test_interior_rows(degree)
      integer, intent(in) :: degree
      integer :: elements, row, k, q
      real(wp) :: inertia, bending, h, unit
      type(galerkin_t) :: galerkin

      elements = 4*degree
      row = 2*degree
      h = length/elements
      galerkin = new_galerkin(exact_mesh(degree, elements), length)
      unit = gamma(degree + 1.0_wp)**2
      q = 2*degree - 3
      do k = 0, degree
         inertia = h*unit*eulerian(2*degree + 1, degree - k)/gamma(2*degree + 2.0_wp)
         bending = unit/h**3/gamma(q + 1.0_wp)*(6*eulerian(q, degree - 2 - k) &
            - 4*(eulerian(q, degree - 3 - k) + eulerian(q, degree - 1 - k)) &
            + eulerian(q, degree - 4 - k) + eulerian(q, degree - k))
         ! degree + 1 points on degree + 1 elements; products up to unit h and 16 unit/h^3.
         call check_close('degree '//to_text(degree)//': inertia, offset '//to_text(k), &
            galerkin%inertia%element(row + k, row)/(h*unit), inertia/(h*unit), 16*eps)
         call check_close('degree '//to_text(degree)//': bending, offset '//to_text(k), &
            galerkin%bending%element(row + k, row)*h**3/unit, bending*h**3/unit, 64*eps)
      end do
   end subroutine test_interior_rows

   !> Eulerian number <n, k>, 0 outside 0 .. n - 1.
   pure recursive real(wp) function eulerian(n, k) result(number)
      integer, intent(in) :: n, k

      number = 0
      if (k < 0 .or. k >= n) return
      number = 1
      if (n > 1) number = (k + 1)*eulerian(n - 1, k) + (n - k)*eulerian(n - 1, k - 1)
   end function eulerian

   !> Every entry, the root's included, and <theta, b_i>, by extrapolated trapezoidal sums.
   subroutine test_against_romberg(degree, elements, turning)
      integer, intent(in) :: degree, elements
      logical, intent(in) :: turning
      type(galerkin_t) :: galerkin
      real(wp), allocatable :: gram(:, :), theta(:)
      real(wp), parameter :: powers(3) = [2.0_wp, 3.0_wp, 2.5_wp]
      real(wp) :: allowed
      integer :: k

      galerkin = new_galerkin(exact_mesh(degree, elements), length, held_root(turning))
      ! Romberg's sums of up to 129 terms keep some tens of units of round-off of the largest entry.
      call romberg(galerkin, 0, gram)
      call check_close(of_mesh(degree, elements, turning)//'inertia by Romberg', &
         maxval(abs(gram - dense_of(galerkin%inertia)))/maxval(abs(gram)), 0.0_wp, 100*eps)
      call romberg(galerkin, 2, gram)
      call check_close(of_mesh(degree, elements, turning)//'bending by Romberg', &
         maxval(abs(gram - dense_of(galerkin%bending)))/maxval(abs(gram)), 0.0_wp, 100*eps)
      do k = 1, size(powers)
         theta = romberg_moments(galerkin, powers(k))
         ! x^2.5 b_i is no polynomial: it behaves like x^4.5 at the root, where n Gauss points err
         ! by some n^-11. For N = 1 <theta, b_1> = l (-18/5.5 + 11/6.5), a tenfold cancellation: 100
         ! n^-11.
         allowed = 100*eps
         if (abs(powers(k) - nint(powers(k))) > 0) allowed = 100*(degree + 1.0_wp)**(-11)
         call check_close(of_mesh(degree, elements, turning)//'<theta, b_i>, power '// &
            to_text(powers(k)), maxval(abs(galerkin%moments(powers(k), alone) - theta)) &
            /maxval(abs(theta)), 0.0_wp, allowed)
      end do
   end subroutine test_against_romberg

   !> Gram matrix of the derivatives of the given order. On an element the integrands are
   !> polynomials of degree 14 at most: seven extrapolations are exact.
   subroutine romberg(galerkin, order, gram)
      type(galerkin_t), intent(in) :: galerkin
      integer, intent(in) :: order
      real(wp), allocatable, intent(out) :: gram(:, :)
      integer, parameter :: levels = 7
      real(wp), allocatable :: table(:, :, :), b(:)
      integer :: e, level, k, n

      n = galerkin%space%n
      allocate (gram(n, n), table(n, n, 0:levels), b(n))
      gram = 0
      do e = 0, galerkin%mesh%elements - 1
         do level = 0, levels
            table(:, :, level) = 0
            do k = 0, 2**level
               b = on_element(galerkin, e, k/2.0_wp**level, order)
               if (k == 0 .or. k == 2**level) b = b/sqrt(2.0_wp)
               table(:, :, level) = table(:, :, level) + spread(b, 1, n)*spread(b, 2, n)/2**level
            end do
         end do
         do level = 1, levels
            do k = levels, level, -1
               table(:, :, k) = table(:, :, k) &
                  + (table(:, :, k) - table(:, :, k - 1))/(4.0_wp**level - 1)
            end do
         end do
         gram = gram + table(:, :, levels)*length/galerkin%mesh%elements
      end do
   end subroutine romberg

   !> <theta, b_i> with theta = (x/l)**power.
   function romberg_moments(galerkin, power) result(theta)
      type(galerkin_t), intent(in) :: galerkin
      real(wp), intent(in) :: power
      real(wp) :: theta(galerkin%space%n)
      integer, parameter :: levels = 9
      real(wp) :: table(galerkin%space%n, 0:levels), s
      integer :: e, level, k

      theta = 0
      do e = 0, galerkin%mesh%elements - 1
         do level = 0, levels
            table(:, level) = 0
            do k = 0, 2**level
               s = k/2.0_wp**level
               table(:, level) = table(:, level) + on_element(galerkin, e, s, 0) &
                  *((e + s)/galerkin%mesh%elements)**power/2**level &
                  *merge(0.5_wp, 1.0_wp, k == 0 .or. k == 2**level)
            end do
         end do
         do level = 1, levels
            do k = levels, level, -1
               table(:, k) = table(:, k) + (table(:, k) - table(:, k - 1))/(4.0_wp**level - 1)
            end do
         end do
         theta = theta + table(:, levels)*length/galerkin%mesh%elements
      end do
   end function romberg_moments

   !> All basis functions at a place in an element, from its own side at a knot.
   function on_element(galerkin, element, s, order) result(values)
      type(galerkin_t), intent(in) :: galerkin
      integer, intent(in) :: element, order
      real(wp), intent(in) :: s
      real(wp) :: values(galerkin%space%n), local(galerkin%mesh%degree + 1)
      integer :: first, last

      first = galerkin%space%first_on_element(element)
      last = min(first + galerkin%mesh%degree, galerkin%space%n)
      local = galerkin%space%on_element(element, s, order)
      values = 0
      values(first:last) = local(:last - first + 1)
   end function on_element

   !> Both matrices are positive definite: the functions are linearly independent, and the clamp
   !> leaves no rigid motion. (They are symmetric by their storage.)
   subroutine test_definite(degree, elements, turning)
      integer, intent(in) :: degree, elements
      logical, intent(in) :: turning
      type(galerkin_t) :: galerkin
      type(band_t) :: inertia, bending
      logical :: positive

      galerkin = new_galerkin(exact_mesh(degree, elements), length, held_root(turning))
      inertia = galerkin%inertia
      bending = galerkin%bending
      call inertia%factor(positive)
      call check(of_mesh(degree, elements, turning)//'inertia is positive definite', positive)
      ! A root that turns is free to: the spring of the structure holds it.
      if (turning) call bending%add_rank_one(1/length, galerkin%space%at(0.0_wp, 1))
      call bending%factor(positive)
      call check(of_mesh(degree, elements, turning)//'bending is positive definite', positive)
   end subroutine test_definite

   !> The integral by quadrature and the quadratic form are one number.
   subroutine test_energy(degree, elements, turning)
      integer, intent(in) :: degree, elements
      logical, intent(in) :: turning
      type(galerkin_t) :: galerkin
      real(wp), allocatable :: x(:)
      real(wp) :: form
      integer :: k

      galerkin = new_galerkin(exact_mesh(degree, elements), length, held_root(turning))
      x = [(sin(7.3_wp*k), k=1, galerkin%space%n)]
      form = dot_product(x, galerkin%bending%times(x))
      ! Irregular coefficients: the form does not cancel, but its terms are up to 16 times as large.
      call check_close(of_mesh(degree, elements, turning)//'bending energy', &
         galerkin%bending_energy(x)/form, 1.0_wp, 200*eps)
   end subroutine test_energy

   !> w = x, by least squares from <x, b_i>: it has no bending and the integrals of a turning bar.
   !> The rule of the mesh has them too where it is not exact.
   subroutine test_turn(degree, elements)
      integer, intent(in) :: degree, elements
      type(galerkin_t) :: galerkin
      type(mesh_t) :: mesh
      type(band_t) :: factor
      real(wp), allocatable :: x(:), force(:)
      character(len=:), allocatable :: name
      real(wp) :: exact
      logical :: positive
      integer :: rule, k

      do rule = 1, 2
         mesh = exact_mesh(degree, elements)
         ! At least as many points as functions on an element, but none of x**2 exact.
         if (rule == 2) mesh = mesh_t(degree, elements, 1, 2*degree + 2)
         galerkin = new_galerkin(mesh, length, held_root(.true.))
         name = of_mesh(degree, elements, .true.)//merge('exact', 'rough', rule == 1)//' rule, '
         factor = galerkin%inertia
         call factor%factor(positive)
         x = length*galerkin%moments(1.0_wp, alone)
         call factor%solve(x)
         ! The inertia has a condition of 1e3 (cubics) to 1e8 (degree 7).
         call check_close(name//'x at the tip', dot_product(galerkin%tip, x)/length, 1.0_wp, &
            1e-9_wp)
         call check_close(name//'x has no bending', galerkin%bending_energy(x)*length, 0.0_wp, &
            1e-9_wp)
         force = galerkin%inertia%times(x)
         call check_close(name//'<x, x> is the integral of x^2', dot_product(x, force) &
            /(length**2*galerkin%integral(2.0_wp, alone)), 1.0_wp, 1e-9_wp)
         do k = 2, 3
            call check_close(name//'<theta, x>, power '//to_text(k), dot_product(x, &
               galerkin%moments(real(k, wp), alone))/(length*galerkin%integral(k + 1.0_wp, &
               alone)), 1.0_wp, 1e-9_wp)
         end do
         do k = 0, 4
            ! Midpoints err by k(k - 1)/24 of the panels' width squared, relative to 1/(k - 1).
            exact = length/(k + 1)
            call check_close(name//'integral of (x/l)^'//to_text(k), galerkin%integral(real(k, &
               wp), alone)/exact, 1.0_wp, 20*eps + merge(0.0_wp, (k + 1)*k &
               /(24*real(elements*(2*degree + 2), wp)**2), rule == 1 .or. k < 2))
         end do
      end do
   end subroutine test_turn

   !> x^2 and x^3 in the cubic space by their blossoms: B_j has the coefficients h^2 (j^2 - 1/3)/6
   !> and h^3 (j^3 - j)/6, and b_1 takes that of B_0. Their integrals in closed form.
   subroutine test_polynomials(elements)
      integer, intent(in) :: elements
      type(galerkin_t) :: galerkin
      character(len=:), allocatable :: name
      real(wp) :: square(elements + 1), cube(elements + 1), h
      integer :: j

      galerkin = new_galerkin(mesh_t(degree=3, elements=elements), length)
      h = length/elements
      square = h**2*[((j**2 - 1/3.0_wp)/6, j=1, elements + 1)]
      cube = h**3*[((real(j, wp)**3 - j)/6, j=1, elements + 1)]
      square(1) = -h**2/18
      ! Fourth differences of coefficients of size l^2/6 cost N^4 units of round-off in the bending
      ! forms; 200 units for sums and for the root.
      name = of_mesh(3, elements)
      associate (l => length, G => galerkin%inertia, S => galerkin%bending)
         call check_close(name//'<x^2, x^2> = l^5/5', &
            dot_product(square, G%times(square))*5/l**5, 1.0_wp, 200*eps)
         call check_close(name//'<x^2, x^3> = l^6/6', &
            dot_product(square, G%times(cube))*6/l**6, 1.0_wp, 200*eps)
         call check_close(name//'<x^3, x^3> = l^7/7', &
            dot_product(cube, G%times(cube))*7/l**7, 1.0_wp, 200*eps)
         call check_close(name//'<2, 2> = 4 l', &
            dot_product(square, S%times(square))/(4*l), 1.0_wp, (200 + elements**4)*eps)
         call check_close(name//'<2, 6 x> = 6 l^2', &
            dot_product(square, S%times(cube))/(6*l**2), 1.0_wp, (200 + elements**4)*eps)
         call check_close(name//'<6 x, 6 x> = 12 l^3', &
            dot_product(cube, S%times(cube))/(12*l**3), 1.0_wp, (200 + elements**4)*eps)
         ! Second differences: N^2 units.
         call check_close(name//'bending energy of x^2', &
            galerkin%bending_energy(square)/(4*l), 1.0_wp, (50 + 4*elements**2)*eps)
         call check_close(name//'tip of x^2', dot_product(galerkin%tip, square)/l**2, 1.0_wp, &
            50*eps)
         call check_close(name//'tip of x^3', dot_product(galerkin%tip, cube)/l**3, 1.0_wp, 50*eps)
         call check_close(name//'<(x/l)^2, x^2> = l^3/5', &
            dot_product(galerkin%moments(2.0_wp, alone), square)*5/l**3, 1.0_wp, 200*eps)
      end associate
   end subroutine test_polynomials

   !> Two points are too few for the inertia of cubics, and enough for their bending. By hand, from
   !> the fourth and sixth derivatives of B^2, p panels make the diagonal too large by
   !> (2/45 p^-4 + 20/189 p^-6) h.
   subroutine test_panels()
      real(wp), parameter :: exact = 36*2416/5040.0_wp
      integer, parameter :: panels(*) = [1, 2, 4, 8]
      type(galerkin_t) :: galerkin
      integer :: k

      do k = 1, size(panels)
         galerkin = new_galerkin(mesh_t(degree=3, elements=12, gauss_points=2, panels=panels(k)), &
            length)
         ! Round-off as in test_cubic_rows.
         call check_close('two points, '//to_text(panels(k))//' panels: bending is exact', &
            galerkin%bending%element(7, 7)*(length/12)**3, 96.0_wp, 600*eps)
         call check_close('two points, '//to_text(panels(k))//' panels: error of the inertia', &
            galerkin%inertia%element(7, 7)*12/length - exact, &
            2/45.0_wp/panels(k)**4 + 20/189.0_wp/panels(k)**6, 64*eps)
      end do
   end subroutine test_panels

end program test_galerkin
