!> The motion of the whole beam and of the hose, exact in time, for the studies of the paper; the
!> size of a motion, or of the difference of two motions, in the norms of the paper's Section 3; and
!> the points of time at which these norms are computed.
!>
!> With the vector x of a root s, as in `beamid_poles`, the unknowns of (3.13) move by
!> w = Re(sum x (x'F)/A z) with z' = s z + f; one root stands for a conjugate pair, with a factor of
!> 2. Factors of s and s**2 before z give w' and w'' - f M**-1 F. A cluster of roots moves the
!> unknowns as it moves the sensor, by moments over its contour.
module beamid_beam_motions
   use beamid_assembly, only: assembly_t, root_t
   use beamid_clusters, only: cluster_t
   use beamid_contours, only: contour_point, rows_of
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_responses, only: response_t
   use beamid_splines, only: clamped_root, spline_space_t
   use beamid_synthesis, only: at_rest, states_t
   use beamid_tracked_poles, only: assemble
   use beamid_transfer, only: transfer_at, transfer_t
   use beamid_vectors, only: solve_mass
   implicit none
   private

   public :: beam_motion_t, find_motion, norm_V, norm_H, motion_size, graded_times

   !> The solution of (3.13) at given times.
   type :: beam_motion_t
      real(wp), allocatable :: t(:)              !< (times) ascending [time]
      !> (times, unknowns, 0:2) w, w' and w'': spline coefficients, then y if there is a hose
      real(wp), allocatable :: w(:, :, :)
      type(spline_space_t) :: space              !< spline space of the deflection
   contains
      procedure :: at
      procedure :: hose
      procedure :: seen_by
   end type beam_motion_t

contains

   !> Computes the motion of all unknowns from rest.
   !>
   !> equations  of a beam with a rigid clamp
   !> times      (times) ascending [time]
   !> error      a root spring, a moving base, a rigid support, or roots that cannot be found
   subroutine find_motion(equations, excitation, times, motion, error)
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(beam_motion_t), intent(out) :: motion
      type(error_t), allocatable, intent(out) :: error
      type(beam_modes_t) :: modes
      type(assembly_t) :: assembly
      type(poles_t) :: poles
      complex(wp), allocatable :: shapes(:, :, :), z(:, :)
      real(wp), allocatable :: direct_term(:)   ! M**-1 F
      integer :: k, order, states

      if (any(equations%galerkin%space%essential .neqv. clamped_root) .or. excitation%is_base .or. &
         equations%constraints%number() > 0 .or. count(equations%hose > 0) > 1 .or. &
         any(equations%hose > 0 .and. equations%hose <= equations%galerkin%space%n)) then
         call failure(error, 'field: found a root or a base that moves, a rigid support, or a '// &
            'hose that is not at the tip; expected a clamp, a force, and at most one hose')
         return
      end if
      call bare_beam_modes(equations%galerkin, modes, error)
      if (allocated(error)) return
      call assemble(modes, equations, excitation, [integer ::], assembly)
      call find_poles(assembly, poles, error)
      if (allocated(error)) return
      motion%t = times
      motion%space = equations%galerkin%space
      states = size(poles%s) + sum(poles%cluster%m)
      allocate (motion%w(size(times), equations%n, 0:2), shapes(states, equations%n, 0:2), &
         z(size(times), states))
      states = size(poles%s)
      call shapes_of_poles(assembly, modes, poles, shapes(:states, :, :), direct_term)
      do k = 1, size(poles%cluster)
         associate (cluster => poles%cluster(k))
            call shapes_of_cluster(assembly, modes, cluster, &
               shapes(states + 1:states + cluster%m, :, :))
            states = states + cluster%m
         end associate
      end do
      call compute_states(poles, excitation, times, z)
      do order = 0, 2
         motion%w(:, :, order) = matmul(real(z), real(shapes(:, :, order))) &
            - matmul(aimag(z), aimag(shapes(:, :, order)))
      end do
      do k = 1, equations%n
         motion%w(:, k, 2) = motion%w(:, k, 2) + excitation%force(times)*direct_term(k)
      end do
   end subroutine find_motion

   !> Computes the motion of the unknowns of (3.13) per unit state z of each pole, and M**-1 F.
   !>
   !> shapes       (poles, unknowns, 0:2) of w, w' and w''; 0 for poles that belong to a cluster
   !> direct_term  (unknowns) M**-1 F
   subroutine shapes_of_poles(assembly, modes, poles, shapes, direct_term)
      type(assembly_t), intent(in) :: assembly
      type(beam_modes_t), intent(in) :: modes
      type(poles_t), intent(in) :: poles
      complex(wp), intent(out) :: shapes(:, :, 0:)
      real(wp), allocatable, intent(out) :: direct_term(:)
      real(wp) :: x(assembly%layout%n, 1), y(assembly%layout%r, 1)
      complex(wp) :: factor
      integer :: k, n, unknowns

      n = size(modes%shapes, 1)
      unknowns = size(shapes, 2)
      shapes = 0
      do k = 1, size(poles%s)
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         associate (vector => poles%vector(k))
            factor = sum(assembly%load%at((0.0_wp, 0.0_wp), vector%form, &
               assembly%layout%v)*vector%x)/vector%A
            if (abs(aimag(poles%s(k))) > 0) factor = 2*factor
            shapes(k, :, 0) = factor*to_unknowns(modes, vector%form, vector%x, &
               vector%y(assembly%layout%tip), unknowns)
            shapes(k, :, 1) = poles%s(k)*shapes(k, :, 0)
            shapes(k, :, 2) = poles%s(k)*shapes(k, :, 1)
         end associate
      end do
      allocate (direct_term(unknowns), source=0.0_wp)
      x(:, 1) = assembly%load%total
      call solve_mass(assembly, x, y)
      direct_term(:n) = matmul(modes%shapes, x(:n, 1))
      if (unknowns > n) direct_term(unknowns) = x(n + 1, 1)
   end subroutine shapes_of_poles

   !> Computes the motion of the unknowns of (3.13) per unit state of a cluster, from the moments of
   !> Q**-1 F over its contour.
   !>
   !> shapes  (m, unknowns, 3) of w, w' and w'' for the m roots of the cluster
   subroutine shapes_of_cluster(assembly, modes, cluster, shapes)
      type(assembly_t), intent(in) :: assembly
      type(beam_modes_t), intent(in) :: modes
      type(cluster_t), intent(in) :: cluster
      complex(wp), intent(out) :: shapes(:, :, :)
      complex(wp) :: mu(cluster%m + 2, size(shapes, 2)), none(cluster%m + 2, 0), z
      complex(wp), allocatable :: row(:, :), drow(:, :, :)
      type(transfer_t) :: value
      type(root_t) :: point
      integer :: i, k

      mu = 0
      do i = 1, cluster%points
         call contour_point(cluster, i, z, point)
         call transfer_at(assembly, point, .false., value)
         do k = 1, size(mu, 1)
            mu(k, :) = mu(k, :) + cluster%radius/cluster%points*z**k*to_unknowns(modes, &
               value%form, value%q, value%u(assembly%layout%tip), size(mu, 2))
         end do
      end do
      mu = cluster%weight()*mu
      if (cluster%on_axis) mu = real(mu)
      do i = 1, size(mu, 2)
         call rows_of(cluster, mu(:, i), none, row, drow)
         shapes(:, i, :) = row
      end do
   end subroutine shapes_of_cluster

   !> Returns the unknowns of (3.13), spline coefficients and hose, from the modal coordinates.
   !>
   !> form      0: x has y; 1: x has y relative to the tip
   !> x         modal coordinates, then the hose if there is one
   !> tip       displacement of the tip
   !> unknowns  their number
   function to_unknowns(modes, form, x, tip, unknowns) result(w)
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: form, unknowns
      complex(wp), intent(in) :: x(:), tip
      complex(wp) :: w(unknowns)
      integer :: n

      n = size(modes%shapes, 1)
      w = 0
      w(:n) = cmplx(matmul(modes%shapes, real(x(:n))), matmul(modes%shapes, aimag(x(:n))), wp)
      if (unknowns == n) return
      w(unknowns) = x(n + 1)
      if (form /= 0) w(unknowns) = w(unknowns) + tip
   end function to_unknowns

   !> Computes the states z of all poles, z' = s z + f from rest, followed by those of the clusters.
   !>
   !> z  (times, states)
   subroutine compute_states(poles, excitation, times, z)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      complex(wp), intent(out) :: z(:, :)
      type(states_t) :: states
      real(wp), allocatable :: x(:, :)   ! real parts, then imaginary parts, of each group of states
      integer :: column, i, m, state

      states = at_rest(poles, excitation, .false.)
      allocate (x(size(times), states%columns()))
      call states%through(poles, excitation, times, x)
      state = 0
      column = 0
      do i = 0, size(states%cluster)
         m = size(poles%s)
         if (i > 0) m = size(states%cluster(i)%x)
         z(:, state + 1:state + m) = cmplx(x(:, column + 1:column + m), &
            x(:, column + m + 1:column + 2*m), wp)
         state = state + m
         column = column + 2*m
      end do
   end subroutine compute_states

   !> Returns the deflection of the beam at one point, or a derivative of it, at all times.
   !>
   !> x           position, 0 to l [length]
   !> derivative  order of the derivative with respect to x
   !> order       order of the derivative with respect to time, 0 to 2
   function at(self, x, derivative, order) result(values)
      class(beam_motion_t), intent(in) :: self
      real(wp), intent(in) :: x
      integer, intent(in) :: derivative, order
      real(wp) :: values(size(self%t)), b(self%space%n)
      integer :: i

      b = self%space%at(x, derivative)
      values = 0
      do i = 1, size(b)
         if (abs(b(i)) > 0) values = values + b(i)*self%w(:, i, order)
      end do
   end function at

   !> Returns the displacement y of the hose, or a derivative of it, at all times; 0 without a hose.
   !>
   !> order  order of the derivative with respect to time, 0 to 2
   function hose(self, order) result(values)
      class(beam_motion_t), intent(in) :: self
      integer, intent(in) :: order
      real(wp) :: values(size(self%t))

      values = 0
      if (size(self%w, 2) > self%space%n) values = self%w(:, size(self%w, 2), order)
   end function hose

   !> Returns the motion of an observer: the inner product of its vector with w.
   !>
   !> observer  (unknowns) its vector
   function seen_by(self, observer) result(response)
      class(beam_motion_t), intent(in) :: self
      real(wp), intent(in) :: observer(:)
      type(response_t) :: response

      response%t = self%t
      response%displacement = matmul(self%w(:, :, 0), observer)
      response%velocity = matmul(self%w(:, :, 1), observer)
      response%acceleration = matmul(self%w(:, :, 2), observer)
   end function seen_by

   !> Returns |(y, u(l), u)|_V of a motion, or of the difference of two motions, at all times: the
   !> root of (y - u(l))**2 plus the integral of (u'')**2, as defined in Section 3.
   !>
   !> order  order of the derivative with respect to time, 0 to 2
   !> minus  motion to subtract, at the same times; one of the two numbers of elements must divide
   !>        the other. Default: nothing is subtracted.
   function norm_V(motion, order, minus) result(values)
      type(beam_motion_t), intent(in) :: motion
      integer, intent(in) :: order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(size(motion%t))
      real(wp) :: tip(size(motion%t)), hose(size(motion%t))

      tip = 0
      hose = 0
      if (size(motion%w, 2) > motion%space%n) call tip_and_hose(motion, order, minus, tip, hose)
      values = sqrt((hose - tip)**2 + integral_of_square(motion, 2, order, minus))
   end function norm_V

   !> Returns |(y, u(l), u)|_H of a motion, or of the difference of two motions, at all times: the
   !> root of y**2 + u(l)**2 plus the integral of u**2.
   !>
   !> order, minus  as for `norm_V`
   function norm_H(motion, order, minus) result(values)
      type(beam_motion_t), intent(in) :: motion
      integer, intent(in) :: order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(size(motion%t))
      real(wp) :: tip(size(motion%t)), hose(size(motion%t))

      call tip_and_hose(motion, order, minus, tip, hose)
      values = sqrt(hose**2 + tip**2 + integral_of_square(motion, 0, order, minus))
   end function norm_H

   !> Computes the motion of tip and hose, or the difference of two motions there, at all times.
   subroutine tip_and_hose(motion, order, minus, tip, hose)
      type(beam_motion_t), intent(in) :: motion
      integer, intent(in) :: order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp), intent(out) :: tip(:), hose(:)

      hose = motion%hose(order)
      tip = motion%at(motion%space%length, 0, order)
      if (.not. present(minus)) return
      hose = hose - minus%hose(order)
      tip = tip - minus%at(motion%space%length, 0, order)
   end subroutine tip_and_hose

   !> Returns the integral over the beam of the square of a derivative with respect to x, at all
   !> times. Gauss points on the finer mesh make it exact if one mesh is a refinement of the other.
   !>
   !> derivative  order of the derivative with respect to x
   !> order       order of the derivative with respect to time
   function integral_of_square(motion, derivative, order, minus) result(values)
      type(beam_motion_t), intent(in) :: motion
      integer, intent(in) :: derivative, order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(size(motion%t))
      real(wp) :: difference(size(motion%t)), x, h
      type(rule_t) :: rule
      integer :: elements, degree, e, q

      elements = motion%space%elements
      degree = motion%space%degree
      if (present(minus)) then
         elements = max(elements, minus%space%elements)
         degree = max(degree, minus%space%degree)
      end if
      rule = gauss_legendre(degree - derivative + 1)
      h = motion%space%length/elements
      values = 0
      do e = 0, elements - 1
         do q = 1, size(rule%points)
            x = (e + rule%points(q))*h
            difference = motion%at(x, derivative, order)
            if (present(minus)) difference = difference - minus%at(x, derivative, order)
            values = values + rule%weights(q)*h*difference**2
         end do
      end do
   end function integral_of_square

   !> Returns the size of a motion, or of the difference of two motions, in the norms of Lemma 3.1,
   !> (3.23) and (3.24): the largest |.|_V of the displacement, the largest |.|_V of the velocity,
   !> and the root of the integral of |.|_H**2 of the acceleration, (3.16).
   !>
   !> motion   at the times of `graded_times`
   !> weights  (times) quadrature weights of these times [time]
   !> minus    as for `norm_V`
   function motion_size(motion, weights, minus) result(values)
      type(beam_motion_t), intent(in) :: motion
      real(wp), intent(in) :: weights(:)
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(3)

      values(1) = maxval(norm_V(motion, 0, minus))
      values(2) = maxval(norm_V(motion, 1, minus))
      values(3) = sqrt(sum(weights*norm_H(motion, 2, minus)**2))
   end function motion_size

   !> Returns times and quadrature weights for integrals of the motion from the first node of the
   !> force to `finish`.
   !>
   !> Each corner of the force excites high modes, which c_D soon damps. After each node the panels
   !> therefore grow with the distance tau from it, like tau**(2/3). Each has four Gauss points.
   !>
   !> finish          after the last node of the force [time]
   !> panels          number of panels after the last node; the other intervals have fewer, so that
   !>                 all are graded alike
   !> times, weights  (4 times all panels) ascending [time]
   subroutine graded_times(excitation, finish, panels, times, weights)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: finish
      integer, intent(in) :: panels
      real(wp), allocatable, intent(out) :: times(:), weights(:)
      type(rule_t) :: rule
      real(wp), allocatable :: corners(:)
      real(wp) :: first, last, length
      integer :: k, j, m

      rule = gauss_legendre(4)
      corners = [excitation%t, finish]
      allocate (times(0), weights(0))
      length = finish - excitation%t(size(excitation%t))
      do k = 1, size(corners) - 1
         m = ceiling(panels*min(1.0_wp, (corners(k + 1) - corners(k))/length)**(1/3.0_wp))
         do j = 1, m
            first = corners(k) + (corners(k + 1) - corners(k))*(real(j - 1, wp)/m)**3
            last = corners(k) + (corners(k + 1) - corners(k))*(real(j, wp)/m)**3
            times = [times, first + (last - first)*rule%points]
            weights = [weights, (last - first)*rule%weights]
         end do
      end do
   end subroutine graded_times

end module beamid_beam_motions
