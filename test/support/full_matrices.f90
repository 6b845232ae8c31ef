!> The equations of (3.13) in quadruple precision and as full matrices, assembled here from the
!> values of the splines alone: roots by inverse iteration, residues as the formulas have them,
!> undifferentiated, or the motion by exponentials of the whole first-order system, which know of no
!> roots. A difference over 1e-16 of a parameter is its derivative to 1e-15 or so.
module full_matrices
   use, intrinsic :: iso_fortran_env, only: real128
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: alone, galerkin_t
   use beamid_kinds, only: wp
   use beamid_quadrature, only: composite, rule_t
   use beamid_structure, only: n_parameters, of_c_D, of_c_H, of_c_R, of_E, of_gamma, of_I, of_J_S, &
      of_J_T, of_k_H, of_kappa_R, of_length, of_m_H, of_m_S, of_m_T, of_rho, of_x_F, of_x_S, &
      structure_t
   implicit none
   private

   public :: full_t, new_full, qp, exponential, solve, solve_real, square

   integer, parameter :: qp = real128

   type :: full_t
      integer :: n = 0                        !< unknowns, the hose last
      real(qp) :: q(n_parameters) = 0                   !< the parameters by number
      !> integrals of the mesh, of a length of its own, with rows of zeros for the hose
      real(qp), allocatable :: inertia(:, :), bending(:, :)
      !> tip, its slope, slope at the root, stretch of the hose's spring, load
      real(qp), allocatable :: tip(:), slope(:), root(:), stretch(:), load(:), shape(:)
      !> (n, 0:2) value, slope and curvature at the sensor; where the force acts
      real(qp), allocatable :: sensor(:, :), force(:, :)
      real(qp) :: length = 0, x_S = 0, x_F = 0   !< of the mesh; where `sensor` and `force` are
      real(qp) :: start = 0                   !< the beam's length then
      logical :: soft = .false., hose = .false., at_tip(2) = .false.   !< sensor, force
      real(qp), allocatable :: M(:, :), C(:, :), K(:, :), o(:)   !< of the parameters q
   contains
      procedure :: assemble
      procedure :: improve
      procedure :: residue
      procedure :: impulse
      procedure :: motions
   end type full_t

contains

   !> Integrals of the mesh of `galerkin`, and the matrices of the structure.
   function new_full(galerkin, structure, excitation) result(self)
      type(galerkin_t), intent(in) :: galerkin
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      type(full_t) :: self
      type(rule_t) :: rule
      real(qp) :: weight
      real(wp) :: b(galerkin%mesh%degree + 1), d2b(galerkin%mesh%degree + 1)
      integer :: e, p, i, j, first, m

      self%soft = (structure%end(1)%kappa_R > 0)
      self%hose = any(structure%has_hose())
      self%length = galerkin%space%length
      self%x_S = structure%sensor_place()
      self%start = structure%length
      self%x_F = structure%get(of_x_F)
      self%at_tip = [structure%sensor(1)%x_S, structure%x_F] < 0
      self%q = [(real(structure%get(i), qp), i=1, n_parameters)]
      associate (space => galerkin%space)
         self%n = space%n + merge(1, 0, self%hose)
         allocate (self%inertia(self%n, self%n), self%bending(self%n, self%n), source=0.0_qp)
         rule = composite(galerkin%mesh%gauss_points, galerkin%mesh%panels)
         do e = 0, space%elements - 1
            first = space%first_on_element(e)
            m = space%last_on_element(e) - first + 1
            do p = 1, size(rule%points)
               weight = rule%weights(p)*real(space%length, qp)/space%elements
               b = space%on_element(e, rule%points(p), 0)
               d2b = space%on_element(e, rule%points(p), 2)
               do j = 1, m
                  do i = 1, m
                     self%inertia(first + i - 1, first + j - 1) = self%inertia(first + i - 1, &
                        first + j - 1) + weight*b(i)*b(j)
                     self%bending(first + i - 1, first + j - 1) = self%bending(first + i - 1, &
                        first + j - 1) + weight*d2b(i)*d2b(j)
                  end do
               end do
            end do
         end do
         self%tip = padded(space%at(space%length, 0))
         self%slope = padded(space%at(space%length, 1))
         self%root = padded(space%at(0.0_wp, 1))
         allocate (self%sensor(self%n, 0:2), self%force(self%n, 0:2))
         do i = 0, 2
            self%sensor(:, i) = padded(space%at(structure%sensor_place() &
               *(space%length/structure%length), i))
            self%force(:, i) = padded(space%at(structure%get(of_x_F) &
               *(space%length/structure%length), i))
         end do
         allocate (self%shape(self%n), source=0.0_qp)
         if (excitation%distributed) self%shape = padded(galerkin%moments(excitation%power, alone))
      end associate
      self%stretch = -self%tip
      if (self%hose) self%stretch(self%n) = 1
      call self%assemble()

   contains

      function padded(values) result(vector)
         real(wp), intent(in) :: values(:)
         real(qp) :: vector(self%n)

         vector = 0
         vector(:size(values)) = values
      end function padded

   end function new_full

   !> M, C, K and the observer of the parameters q, term by term.
   subroutine assemble(self)
      class(full_t), intent(inout) :: self
      real(qp) :: moved(2)

      associate (q => self%q, longer => self%q(of_length)/self%length)
         ! A place on the beam lies at place/longer on the mesh.
         moved = [q(of_x_S) - self%x_S, q(of_x_F) - self%x_F]/longer + merge(0.0_qp, &
            [self%x_S, self%x_F]*(1/longer - self%length/self%start), self%at_tip)
         self%o = self%sensor(:, 0) + moved(1)*self%sensor(:, 1)
         self%load = self%force(:, 0) + moved(2)*self%force(:, 1) + longer*self%shape
         self%M = q(of_rho)*longer*self%inertia + q(of_m_T)*square(self%tip) + q(of_J_T) &
            *square(self%slope/longer) + q(of_m_S)*square(self%o) + q(of_J_S) &
            *square((self%sensor(:, 1) + moved(1)*self%sensor(:, 2))/longer)
         self%C = q(of_c_D)*q(of_I)/longer**3*self%bending + q(of_gamma)*longer*self%inertia
         self%K = q(of_E)*q(of_I)/longer**3*self%bending
         if (self%soft) self%K = self%K + 1/q(of_kappa_R)*square(self%root/longer)
         if (self%soft) self%C = self%C + q(of_c_R)*square(self%root/longer)
         if (.not. self%hose) return
         self%M(self%n, self%n) = q(of_m_H)
         self%C = self%C + q(of_c_H)*square(self%stretch)
         self%K = self%K + q(of_k_H)*square(self%stretch)
      end associate
   end subroutine assemble

   !> x x'
   pure function square(x)
      real(qp), intent(in) :: x(:)
      real(qp) :: square(size(x), size(x))

      square = spread(x, 1, size(x))*spread(x, 2, size(x))
   end function square

   !> Inverse iteration with Rayleigh's quotient from a root and its vector, of cubic convergence.
   !>
   !> change  the last change of s
   subroutine improve(self, steps, s, x, change)
      class(full_t), intent(in) :: self
      integer, intent(in) :: steps
      complex(qp), intent(inout) :: s, x(:)
      real(qp), intent(out) :: change
      complex(qp) :: a, b, c, before
      integer :: i, j

      change = huge(change)
      do i = 1, steps
         before = s
         x = matmul(2*s*self%M + self%C, x)
         call solve((s*self%M + self%C)*s + self%K, x)
         x = x/sum(x/maxval(abs(x)))
         a = sum(x*matmul(self%M, x))
         b = sum(x*matmul(self%C, x))
         c = sum(x*matmul(self%K, x))
         do j = 1, 4
            s = s - ((a*s + b)*s + c)/(2*a*s + b)
         end do
         change = abs(s - before)
         if (change <= 1e-28_qp*abs(s)) exit
      end do
   end subroutine improve

   !> (o'x)(x'F)/(x'(2 s M + C) x), twice for one of a pair.
   complex(qp) function residue(self, s, x)
      class(full_t), intent(in) :: self
      complex(qp), intent(in) :: s, x(:)

      residue = sum(self%o*x)*sum(self%load*x)/sum(x*matmul(2*s*self%M + self%C, x))
      if (aimag(s) > 0) residue = 2*residue
   end function residue

   !> o'M**-1 F
   real(qp) function impulse(self)
      class(full_t), intent(in) :: self

      impulse = dot_product(self%o, solve_real(self%M, self%load))
   end function impulse

   !> Displacement, velocity and acceleration of the sensor, from rest, on a uniform grid: steps of
   !> x' = A x + b f with x = (w, w'), f as a part of the system.
   !>
   !> step    [time]
   !> force   (count) f on the grid, which begins at 0, linear in between; zero afterwards
   !> values  (:, 3) at step, 2 step, ...
   subroutine motions(self, step, force, values)
      class(full_t), intent(in) :: self
      real(qp), intent(in) :: step
      real(wp), intent(in) :: force(:)
      real(qp), intent(out) :: values(:, :)
      real(qp) :: a(2*self%n + 2, 2*self%n + 2), growth(2*self%n + 2, 2*self%n + 2), &
         x(2*self%n + 2)
      integer :: k, n

      n = self%n
      a = 0
      do k = 1, n
         a(k, n + k) = 1
         a(n + 1:2*n, k) = -solve_real(self%M, self%K(:, k))
         a(n + 1:2*n, n + k) = -solve_real(self%M, self%C(:, k))
      end do
      a(n + 1:2*n, 2*n + 1) = solve_real(self%M, self%load)
      a(2*n + 1, 2*n + 2) = 1
      growth = exponential(a*step)
      x = 0
      do k = 1, size(values, 1)
         x(2*n + 1:) = 0
         if (k < size(force)) x(2*n + 1:) = [real(force(k), qp), (force(k + 1) - force(k))/step]
         x = matmul(growth, x)
         values(k, 1:2) = [dot_product(self%o, x(:n)), dot_product(self%o, x(n + 1:2*n))]
         ! At its last node a force that jumps still acts.
         x(2*n + 1) = 0
         if (k < size(force)) x(2*n + 1) = force(k + 1)
         values(k, 3) = dot_product(self%o, matmul(a(n + 1:2*n, :), x))
      end do
   end subroutine motions

   !> e**a = (e**b)**(2**k) with b = a/2**k: the series of e**b, squared k times. The series is a
   !> polynomial in b**5, the coefficients of which are polynomials in b (Paterson and Stockmeyer
   !> 1973).
   function exponential(a) result(e)
      real(qp), intent(in) :: a(:, :)
      integer, parameter :: m = 5
      real(qp) :: e(size(a, 1), size(a, 1)), power(size(a, 1), size(a, 1), m), factorial(0:m*m - 1)
      integer :: i, j, k, squarings

      ! .25**25/25! < 1e-40
      squarings = max(0, exponent(maxval(sum(abs(a), dim=1))) + 2)
      power(:, :, 1) = scale(a, -squarings)
      do k = 2, m
         power(:, :, k) = matmul(power(:, :, 1), power(:, :, k - 1))
      end do
      factorial(0) = 1
      do k = 1, m*m - 1
         factorial(k) = k*factorial(k - 1)
      end do
      e = 0
      do j = m - 1, 0, -1
         e = matmul(power(:, :, m), e)
         do i = 1, size(a, 1)
            e(i, i) = e(i, i) + 1/factorial(m*j)
         end do
         do k = 1, m - 1
            e = e + power(:, :, k)/factorial(m*j + k)
         end do
      end do
      do k = 1, squarings
         e = matmul(e, e)
      end do
   end function exponential

   !> A**-1 b by elimination with partial pivoting.
   function solve_real(A, b) result(x)
      real(qp), intent(in) :: A(:, :), b(:)
      real(qp) :: x(size(b))
      complex(qp) :: z(size(b)), full(size(b), size(b))

      z = b
      full = A
      call solve(full, z)
      x = real(z, qp)
   end function solve_real

   !> b := A**-1 b by elimination with partial pivoting; a vanishing pivot is made tiny, as inverse
   !> iteration asks for.
   subroutine solve(A, b)
      complex(qp), intent(in) :: A(:, :)
      complex(qp), intent(inout) :: b(:)
      complex(qp) :: u(size(b), size(b)), row(size(b)), saved
      real(qp) :: large
      integer :: i, k, l, n, p

      n = size(b)
      u = A
      large = maxval(abs(u))
      do k = 1, n
         p = k - 1 + maxloc(abs(real(u(k:, k))) + abs(aimag(u(k:, k))), dim=1)
         if (p /= k) then
            row = u(p, :)
            u(p, :) = u(k, :)
            u(k, :) = row
            saved = b(p)
            b(p) = b(k)
            b(k) = saved
         end if
         if (.not. abs(u(k, k)) > 0) u(k, k) = epsilon(large)*large
         u(k, k) = 1/u(k, k)
         do i = k + 1, n
            if (.not. abs(real(u(i, k))) + abs(aimag(u(i, k))) > 0) cycle
            saved = u(i, k)*u(k, k)
            do l = k + 1, n
               u(i, l) = u(i, l) - saved*u(k, l)
            end do
            b(i) = b(i) - saved*b(k)
         end do
      end do
      do k = n, 1, -1
         b(k) = (b(k) - sum(u(k, k + 1:)*b(k + 1:)))*u(k, k)
      end do
   end subroutine solve

end module full_matrices
