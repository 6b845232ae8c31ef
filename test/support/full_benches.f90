!> A beam with all that can stand on it or under it, in quadruple precision and as full matrices:
!> sensors with rotary inertia, supports, a force anywhere, a base that moves, weight. A rigid
!> support is a force that leaves no acceleration there, or minus that of the base.
module full_benches
   use beamid_galerkin, only: alone, galerkin_t
   use beamid_kinds, only: wp
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_structure, only: of_x_F, structure_t, x_H_at, x_M_at, x_P_at, x_S_at
   use dense_matrices, only: dense_of
   use full_matrices, only: exponential, qp, solve, solve_real, square
   implicit none
   private

   public :: bench_motion, bench_transfer

contains

   !> Motion of the sensor from rest on a uniform grid.
   !>
   !> structure  with trial values
   !> near       with places near those, where the splines are evaluated
   !> is_base    f is the acceleration of the base, else a force
   !> step       [time]
   !> f          on the grid, which begins at 0, linear in between; zero afterwards
   !> values     (:, 4) displacement, velocity, acceleration at step, 2 step, ..., and what the
   !>            sensor reads of gravity
   subroutine bench_motion(galerkin, structure, near, is_base, step, f, values)
      type(galerkin_t), intent(in) :: galerkin
      type(structure_t), intent(in) :: structure, near
      logical, intent(in) :: is_base
      real(wp), intent(in) :: step, f(:)
      real(qp), intent(out) :: values(:, :)
      real(qp), allocatable :: M(:, :), C(:, :), K(:, :), loads(:, :), o(:), a(:, :), &
         growth(:, :), x(:), held(:, :), tilt(:), rides(:), bent(:, :)
      real(qp) :: d(2), b(2)
      integer :: i, j, l, n, order, relaxations

      n = galerkin%space%n + count(structure%has_hose())
      relaxations = findloc(abs([structure%d_1, structure%d_2]) > 0, .true., dim=1, back=.true.)
      order = (2 + relaxations)*n + 4
      allocate (M(n, n), C(n, n), K(n, n), loads(n, 3), a(order, order), x(order), source=0.0_qp)
      call assemble(galerkin, structure, near, is_base, M, C, K, loads, o, tilt, held, rides)
      bent = bending_of(galerkin, structure, n)
      d = [structure%d_1, structure%d_2]
      b = [structure%b_1, structure%b_2]
      do i = 1, n
         a(i, n + i) = 1
         a(n + 1:2*n, i) = accelerations(M, held, -K(:, i), 0*rides)
         a(n + 1:2*n, n + i) = accelerations(M, held, -C(:, i), 0*rides)
         do l = 1, relaxations
            ! z' = u' - b z, with the force d K_E z
            j = 2*n + 4 + (l - 1)*n + i
            a(n + 1:2*n, j) = accelerations(M, held, -d(l)*bent(:, i), 0*rides)
            a(j, n + i) = 1
            a(j, j) = -b(l)
         end do
      end do
      ! f and its slope; velocity and displacement of the base.
      a(n + 1:2*n, 2*n + 1) = accelerations(M, held, loads(:, 1), merge(-rides, 0*rides, is_base))
      a(n + 1:2*n, 2*n + 3) = accelerations(M, held, loads(:, 2), 0*rides)
      a(n + 1:2*n, 2*n + 4) = accelerations(M, held, loads(:, 3), 0*rides)
      a(2*n + 1, 2*n + 2) = 1
      a(2*n + 3, 2*n + 1) = 1
      a(2*n + 4, 2*n + 3) = 1
      growth = exponential(a*real(step, qp))
      do i = 1, size(values, 1)
         x(2*n + 1:2*n + 2) = 0
         if (i < size(f)) x(2*n + 1:2*n + 2) = [real(f(i), qp), (real(f(i + 1), qp) - f(i))/step]
         x = matmul(growth, x)
         x(2*n + 1) = 0
         if (i < size(f)) x(2*n + 1) = f(i + 1)
         values(i, :) = [dot_product(o, x(:n)), dot_product(o, x(n + 1:2*n)), &
            dot_product(o, matmul(a(n + 1:2*n, :), x)), dot_product(tilt, x(:n))]
      end do
   end subroutine bench_motion

   !> Displacement of the sensor per unit force, and its reading of gravity, at places in the
   !> complex plane above the real axis: (s**2 M + s C + K + (i eta + sum of d s/(s + b)) K_E) q = F
   !> by elimination, where K_E is the part of K that is due to E, with the forces of rigid
   !> supports.
   !>
   !> structure, near  as in `bench_motion`
   !> s                (points) [1/time]
   !> h                (points, 2) displacement and reading
   subroutine bench_transfer(galerkin, structure, near, s, h)
      type(galerkin_t), intent(in) :: galerkin
      type(structure_t), intent(in) :: structure, near
      complex(wp), intent(in) :: s(:)
      complex(qp), intent(out) :: h(:, :)
      real(qp), allocatable :: M(:, :), C(:, :), K(:, :), loads(:, :), o(:), held(:, :), tilt(:), &
         rides(:)
      complex(qp), allocatable :: full(:, :), x(:)
      complex(qp) :: z
      integer :: i, n

      n = galerkin%space%n + count(structure%has_hose())
      allocate (M(n, n), C(n, n), K(n, n), loads(n, 3))
      call assemble(galerkin, structure, near, .false., M, C, K, loads, o, tilt, held, rides)
      allocate (full(n + size(held, 2), n + size(held, 2)), x(n + size(held, 2)))
      do i = 1, size(s)
         z = cmplx(s(i), kind=qp)
         full = 0
         full(:n, :n) = (z*M + C)*z + K
         full(:n, :n) = full(:n, :n) + (cmplx(0, structure%eta, qp) + structure%d_1*z/(z &
            + max(structure%b_1, tiny(1.0_wp))) + structure%d_2*z/(z + max(structure%b_2, &
            tiny(1.0_wp))))*bending_of(galerkin, structure, n)
         full(:n, n + 1:) = held
         full(n + 1:, :n) = transpose(held)
         x = 0
         x(:n) = loads(:, 1)
         call solve(full, x)
         h(i, :) = [sum(o*x(:n)), sum(tilt*x(:n))]
      end do
   end subroutine bench_transfer

   !> The part of K that is due to E, (n, n).
   function bending_of(galerkin, s, n) result(bent)
      type(galerkin_t), intent(in) :: galerkin
      type(structure_t), intent(in) :: s
      integer, intent(in) :: n
      real(qp) :: bent(n, n)

      bent = 0
      bent(:galerkin%space%n, :galerkin%space%n) = real(s%E, qp)*s%I*(galerkin%space%length &
         /real(s%length, qp))**3*dense_of(galerkin%bending)
   end function bending_of

   !> M**-1 force, where what is held has an acceleration that is known.
   function accelerations(M, held, force, known) result(a)
      real(qp), intent(in) :: M(:, :), held(:, :), force(:), known(:)
      real(qp) :: a(size(force))
      real(qp), dimension(size(force) + size(held, 2), size(force) + size(held, 2)) :: whole
      real(qp) :: b(size(whole, 1))
      integer :: n

      n = size(force)
      whole = 0
      whole(:n, :n) = M
      whole(:n, n + 1:) = held
      whole(n + 1:, :n) = transpose(held)
      b(:n) = force
      b(n + 1:) = known
      b = solve_real(whole, b)
      a = b(:n)
   end function accelerations

   !> M, C, K, the loads by f and by velocity and displacement of the base, and the sensor.
   !>
   !> held, rides  (n, rows), (rows) rows that rigid supports hold, and 1 for those whose motion is
   !>              relative to a base that moves
   subroutine assemble(galerkin, s, near, is_base, M, C, K, loads, o, tilt, held, rides)
      type(galerkin_t), intent(in) :: galerkin
      type(structure_t), intent(in) :: s, near
      logical, intent(in) :: is_base
      real(qp), intent(out) :: M(:, :), C(:, :), K(:, :), loads(:, :)
      real(qp), allocatable, intent(out) :: o(:), tilt(:), held(:, :), rides(:)
      real(qp), dimension(size(M, 1)) :: tip, v, row, whole, y
      real(qp) :: g, longer
      integer :: h, i, n

      n = galerkin%space%n
      longer = s%length/real(galerkin%space%length, qp)
      allocate (held(size(M, 1), 0), rides(0))
      M = 0; C = 0; K = 0; loads = 0; whole = 0
      tip = at(galerkin%space%length + 0.0_qp, galerkin%space%length, 0)
      whole(:n) = longer*galerkin%moments(0.0_wp, alone)
      M(:n, :n) = s%rho*longer*dense_of(galerkin%inertia)
      C(:n, :n) = s%gamma*longer*dense_of(galerkin%inertia) &
         + real(s%c_D, qp)*s%I/longer**3*dense_of(galerkin%bending)
      K(:n, :n) = real(s%E, qp)*s%I/longer**3*dense_of(galerkin%bending)
      M = M + s%m_T*square(tip) + s%J_T*square(at(galerkin%space%length + 0.0_qp, &
         galerkin%space%length, 1)/longer)
      v = s%rho*whole + s%m_T*tip
      if ((s%end(1)%kappa_R > 0)) then
         K = K + 1/real(s%end(1)%kappa_R, qp)*square(at(0.0_qp, 0.0_wp, 1)/longer)
         C = C + s%end(1)%c_R*square(at(0.0_qp, 0.0_wp, 1)/longer)
      end if
      if (s%a_h > 0) call add_hysteresis()
      h = n
      do i = 1, max(1, s%hoses)
         if (.not. s%hose(i)%m_H > 0) cycle
         h = h + 1
         y = 0
         y(h) = 1
         row = y - point(x_H_at(i), 0)
         M = M + s%hose(i)%m_H*square(y)
         C = C + s%hose(i)%c_H*square(row)
         K = K + s%hose(i)%k_H*square(row)
         v = v + s%hose(i)%m_H*y
      end do
      g = merge(-s%g, s%g, s%stands)
      call pull(galerkin%space%length, galerkin%space%length + 0.0_qp, (s%T + g*s%m_T)/longer, &
         g*s%rho)
      do i = 1, s%sensors
         call pull(near%place(x_S_at(i))*(galerkin%space%length/near%length), &
            s%place(x_S_at(i))/longer, g*s%sensor(i)%m_S/longer, 0.0_qp)
         M = M + s%sensor(i)%m_S*square(point(x_S_at(i), 0)) &
            + s%sensor(i)%J_S*square(point(x_S_at(i), 1)/longer)
         v = v + s%sensor(i)%m_S*point(x_S_at(i), 0)
      end do
      do i = 1, s%masses
         call pull(near%place(x_M_at(i))*(galerkin%space%length/near%length), &
            s%place(x_M_at(i))/longer, g*s%mass(i)%m_M/longer, 0.0_qp)
         M = M + s%mass(i)%m_M*square(point(x_M_at(i), 0)) &
            + s%mass(i)%J_M*square(point(x_M_at(i), 1)/longer)
         v = v + s%mass(i)%m_M*point(x_M_at(i), 0)
      end do
      if (is_base) then
         loads(:, 1) = -v
         loads(:, 2) = -s%gamma*whole
      else
         loads(:, 1) = point(of_x_F, 0)
      end if
      do i = 1, s%supports
         row = point(x_P_at(i), 1)/longer
         if (.not. s%support(i)%kappa_RP > 0) then
            held = reshape([held, row], [size(row), size(held, 2) + 1])
            rides = [rides, 0.0_qp]
         else
            if (s%support(i)%kappa_RP < huge(1.0_wp)) &
               K = K + 1/real(s%support(i)%kappa_RP, qp)*square(row)
            C = C + s%support(i)%c_RP*square(row)
         end if
         v = point(x_P_at(i), 0)
         if (.not. s%support(i)%kappa_P > 0) then
            held = reshape([held, v], [size(v), size(held, 2) + 1])
            rides = [rides, 1.0_qp]
            cycle
         end if
         K = K + 1/real(s%support(i)%kappa_P, qp)*square(v)
         C = C + s%support(i)%c_P*square(v)
         if (is_base) loads(:, 2:) = loads(:, 2:) - spread(v, 2, 2) &
            *spread([real(s%support(i)%c_P, qp), 1/real(s%support(i)%kappa_P, qp)], 1, size(v))
      end do
      o = point(x_S_at(s%observer), 0)
      tilt = g*point(x_S_at(s%observer), 1)/longer

   contains

      !> Adds spatial hysteresis to C as it is defined: half the double integral of the kernel times
      !> the differences of two slopes, by 14 Gauss points on each element. Where b is a fifth of
      !> the length or more, they leave round-off.
      subroutine add_hysteresis()
         real(qp), parameter :: pi = acos(-1.0_qp)
         type(rule_t) :: rule
         real(qp), allocatable :: slope(:, :), kernel(:, :), x(:), weight(:)
         real(qp) :: b
         integer :: e, j, q

         rule = gauss_legendre(14)
         associate (space => galerkin%space)
            x = [(space%ends(e) + (real(space%ends(e + 1), qp) - space%ends(e))*rule%points, &
               e=0, space%elements - 1)]
            weight = [((real(space%ends(e + 1), qp) - space%ends(e))*rule%weights, &
               e=0, space%elements - 1)]
         end associate
         allocate (slope(size(x), size(M, 1)), kernel(size(x), size(x)))
         b = s%b_h/longer
         do q = 1, size(x)
            slope(q, :) = at(x(q), real(x(q), wp), 1)
            do j = 1, size(x)
               kernel(q, j) = weight(q)*weight(j)*exp(-((x(q) - x(j))/b)**2/2)/(b*sqrt(2*pi))
            end do
         end do
         kernel = -kernel
         do q = 1, size(x)
            kernel(q, q) = 0
            kernel(q, q) = -sum(kernel(q, :))
         end do
         C = C + s%a_h/longer*matmul(transpose(slope), matmul(kernel, slope))
      end subroutine add_hysteresis

      !> Adds the integral of (a + b (l - x)) b_i' b_j' from the root to x, by way of x0 near by.
      subroutine pull(x0, x, a, b)
         real(wp), intent(in) :: x0
         real(qp), intent(in) :: x, a, b
         type(rule_t) :: rule
         real(wp) :: h, first, last
         integer :: e, q

         rule = gauss_legendre(galerkin%space%degree)
         h = galerkin%space%length/galerkin%space%elements
         do e = 0, galerkin%space%elements - 1
            first = e*h
            last = min(x0, first + h)
            if (e == galerkin%space%elements - 1) last = x0
            if (last <= first) exit
            do q = 1, size(rule%points)
               associate (at_q => first + (last - first)*rule%points(q))
                  K = K + rule%weights(q)*(last - first)*(a + b*(galerkin%space%length - at_q)) &
                     *square(at(real(at_q, qp), at_q, 1))
               end associate
            end do
         end do
         ! From x0 to x, which are next to each other.
         K = K + (x - x0)*a*square(at((x + x0)/2, x0, 1))
      end subroutine pull

      !> Splines at the place that a parameter is.
      function point(place, derivative) result(b)
         integer, intent(in) :: place, derivative
         real(qp) :: b(size(M, 1))

         b = at(s%place(place)/longer, near%place(place)*(galerkin%space%length/near%length), &
            derivative)
      end function point

      !> Splines at x, by Taylor's series about a place near by: exact within an element.
      function at(x, x0, derivative) result(b)
         real(qp), intent(in) :: x
         real(wp), intent(in) :: x0
         integer, intent(in) :: derivative
         real(qp) :: b(size(M, 1))
         integer :: d

         b = 0
         do d = galerkin%space%degree, derivative, -1
            b(:n) = galerkin%space%at(min(x0, galerkin%space%length), d) &
               + b(:n)*(x - x0)/(d - derivative + 1)
         end do
      end function at

   end subroutine assemble

end module full_benches
