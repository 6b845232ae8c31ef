!> Motion of the whole beam and of the hose, exact in time, and its size in the paper's norms.
!>
!> With the vector x of a root s, as in `beamid_poles`, the unknowns of (3.13) move by
!> w = Re(sum x (x'F)/A z), z' = s z + f, two times that for one of a pair; s and s**2 in front of z
!> give w' and w'' - f M**-1 F. A cluster of roots moves them as it moves the sensor.
module beamid_beam_motions
   use beamid_assembly, only: assembly_t
   use beamid_clusters, only: cluster_t
   use beamid_contours, only: contour_point, rows_of
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_modal, only: assemble
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_responses, only: response_t
   use beamid_splines, only: spline_space_t
   use beamid_synthesis, only: at_rest, states_t
   use beamid_transfer, only: transfer_at, transfer_t
   use beamid_vectors, only: root_t, solve_mass
   implicit none
   private

   public :: beam_motion_t, find_motion, norm_V, norm_H, motion_size, graded_times

   !> The solution of (3.13) at given times.
   type :: beam_motion_t
      real(wp), allocatable :: t(:)              !< (times) [time]
      !> (times, unknowns, 0:2) w, w' and w'': spline coefficients, then y where there is a hose
      real(wp), allocatable :: w(:, :, :)
      type(spline_space_t) :: space              !< of the splines
   contains
      procedure :: at
      procedure :: hose
      procedure :: seen_by
   end type beam_motion_t

contains

   !> Motion of all unknowns from rest.
   !>
   !> equations  of a beam whose root does not turn
   !> times      ascending [time]
   !> error      the root turns, the base moves, a support is rigid
   subroutine find_motion(equations, excitation, times, field, error)
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(beam_motion_t), intent(out) :: field
      type(error_t), allocatable, intent(out) :: error
      type(beam_modes_t) :: modes
      type(assembly_t) :: assembly
      type(poles_t) :: poles
      complex(wp), allocatable :: shapes(:, :, :), z(:, :)
      real(wp), allocatable :: impulse(:)
      integer :: k, order, states

      if (equations%structure%has_root_spring() .or. excitation%is_base .or. &
         equations%constraints%number() > 0) then
         call failure(error, 'field: found a root or a base that moves, or a rigid support; '// &
            'expected a clamp and a force')
         return
      end if
      call bare_beam_modes(equations%galerkin, modes, error)
      if (allocated(error)) return
      call assemble(modes, equations, excitation, [integer ::], assembly)
      call find_poles(assembly, poles, error)
      if (allocated(error)) return
      field%t = times
      field%space = equations%galerkin%space
      states = size(poles%s) + sum(poles%cluster%m)
      allocate (field%w(size(times), equations%n, 0:2), shapes(states, equations%n, 0:2), &
         z(size(times), states))
      states = size(poles%s)
      call unknowns_of_poles(assembly, modes, poles, shapes(:states, :, :), impulse)
      do k = 1, size(poles%cluster)
         associate (cluster => poles%cluster(k))
            call unknowns_of_cluster(assembly, modes, cluster, &
               shapes(states + 1:states + cluster%m, :, :))
            states = states + cluster%m
         end associate
      end do
      call march(poles, excitation, times, z)
      do order = 0, 2
         field%w(:, :, order) = matmul(real(z), real(shapes(:, :, order))) &
            - matmul(aimag(z), aimag(shapes(:, :, order)))
      end do
      do k = 1, equations%n
         field%w(:, k, 2) = field%w(:, k, 2) + excitation%force(times)*impulse(k)
      end do
   end subroutine find_motion

   !> What each pole moves, per unit of its state z, and M**-1 F, both in the unknowns of (3.13).
   !>
   !> shapes   (poles, unknowns, 0:2) of w, w' and w''
   !> impulse  (unknowns)
   subroutine unknowns_of_poles(assembly, modes, poles, shapes, impulse)
      type(assembly_t), intent(in) :: assembly
      type(beam_modes_t), intent(in) :: modes
      type(poles_t), intent(in) :: poles
      complex(wp), intent(out) :: shapes(:, :, 0:)
      real(wp), allocatable, intent(out) :: impulse(:)
      real(wp) :: x(assembly%n, 1), y(size(assembly%v, 1), 1)
      complex(wp) :: factor
      integer :: k, n, unknowns

      n = size(modes%shapes, 1)
      unknowns = size(shapes, 2)
      shapes = 0
      do k = 1, size(poles%s)
         if (any(poles%cluster%holds(poles%s(k)))) cycle
         associate (vector => poles%vector(k))
            factor = sum(assembly%load(:, 1, vector%form)*vector%x)/vector%A
            if (abs(aimag(poles%s(k))) > 0) factor = 2*factor
            shapes(k, :, 0) = factor*unknowns_of(assembly, modes, vector%form, vector%x, &
               vector%y(assembly%tip), unknowns)
            shapes(k, :, 1) = poles%s(k)*shapes(k, :, 0)
            shapes(k, :, 2) = poles%s(k)*shapes(k, :, 1)
         end associate
      end do
      allocate (impulse(unknowns), source=0.0_wp)
      x(:, 1) = assembly%load(:, 1, 1)
      call solve_mass(assembly, x, y)
      impulse(:n) = matmul(modes%shapes, x(:n, 1))
      if (assembly%hose > 0) impulse(unknowns) = x(n + 1, 1)
   end subroutine unknowns_of_poles

   !> What the states of a cluster move: moments of the motion Q**-1 F over its contour.
   !>
   !> shapes  (m, unknowns, 3)
   subroutine unknowns_of_cluster(assembly, modes, cluster, shapes)
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
            mu(k, :) = mu(k, :) + cluster%radius/cluster%points*z**k*unknowns_of(assembly, modes, &
               value%form, value%q, value%u(assembly%tip), size(mu, 2))
         end do
      end do
      mu = cluster%weight()*mu
      if (cluster%on_axis) mu = real(mu)
      do i = 1, size(mu, 2)
         call rows_of(cluster, mu(:, i), none, row, drow)
         shapes(:, i, :) = row
      end do
   end subroutine unknowns_of_cluster

   !> Spline coefficients and the hose from the oscillators' motion x.
   !>
   !> form  of the pencil: the second counts the hose from the tip
   function unknowns_of(assembly, modes, form, x, tip, unknowns) result(w)
      type(assembly_t), intent(in) :: assembly
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: form, unknowns
      complex(wp), intent(in) :: x(:), tip
      complex(wp) :: w(unknowns)
      integer :: n

      n = size(modes%shapes, 1)
      w = 0
      w(:n) = cmplx(matmul(modes%shapes, real(x(:n))), matmul(modes%shapes, aimag(x(:n))), wp)
      if (assembly%hose == 0) return
      w(unknowns) = x(n + 1)
      if (form == 2) w(unknowns) = w(unknowns) + tip
   end function unknowns_of

   !> States of all poles, z' = s z + f from rest, then those of the clusters.
   !>
   !> z  (times, states)
   subroutine march(poles, excitation, times, z)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      complex(wp), intent(out) :: z(:, :)
      type(states_t) :: states
      real(wp), allocatable :: x(:, :)
      integer :: at, from, i, m

      states = at_rest(poles, excitation, .false.)
      allocate (x(size(times), states%columns()))
      call states%through(poles, excitation, times, x)
      at = 0
      from = 0
      do i = 0, size(states%cluster)
         m = size(poles%s)
         if (i > 0) m = size(states%cluster(i)%x)
         z(:, at + 1:at + m) = cmplx(x(:, from + 1:from + m), x(:, from + m + 1:from + 2*m), wp)
         at = at + m
         from = from + 2*m
      end do
   end subroutine march

   !> The beam at one place, at all times.
   !>
   !> x           0 .. l [length]
   !> derivative  with respect to x
   !> order       of the derivative with respect to time, 0 .. 2
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

   !> The hose at all times; nothing where there is none.
   !>
   !> order  of the derivative with respect to time, 0 .. 2
   function hose(self, order) result(values)
      class(beam_motion_t), intent(in) :: self
      integer, intent(in) :: order
      real(wp) :: values(size(self%t))

      values = 0
      if (size(self%w, 2) > self%space%n) values = self%w(:, size(self%w, 2), order)
   end function hose

   !> Motion of observer . w.
   !>
   !> observer  (unknowns)
   function seen_by(self, observer) result(response)
      class(beam_motion_t), intent(in) :: self
      real(wp), intent(in) :: observer(:)
      type(response_t) :: response

      response%t = self%t
      response%displacement = matmul(self%w(:, :, 0), observer)
      response%velocity = matmul(self%w(:, :, 1), observer)
      response%acceleration = matmul(self%w(:, :, 2), observer)
   end function seen_by

   !> |(y, u(l), u)|_V of a field or of the difference between two, at all times: the root of
   !> (y - u(l))**2 plus the integral of (u'')**2, as Section 3 defines it.
   !>
   !> order  of the derivative with respect to time, 0 .. 2
   !> minus  a field at the same times whose number of elements divides, or is a multiple of,
   !>        that of the other
   function norm_V(field, order, minus) result(values)
      type(beam_motion_t), intent(in) :: field
      integer, intent(in) :: order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(size(field%t))
      real(wp) :: tip(size(field%t)), hose(size(field%t))

      tip = 0
      hose = 0
      if (size(field%w, 2) > field%space%n) call ends(field, order, minus, tip, hose)
      values = sqrt((hose - tip)**2 + integral_of_square(field, 2, order, minus))
   end function norm_V

   !> |(y, u(l), u)|_H likewise: the root of y**2 + u(l)**2 plus the integral of u**2.
   function norm_H(field, order, minus) result(values)
      type(beam_motion_t), intent(in) :: field
      integer, intent(in) :: order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(size(field%t))
      real(wp) :: tip(size(field%t)), hose(size(field%t))

      call ends(field, order, minus, tip, hose)
      values = sqrt(hose**2 + tip**2 + integral_of_square(field, 0, order, minus))
   end function norm_H

   !> Tip and hose of a field, or of the difference between two.
   subroutine ends(field, order, minus, tip, hose)
      type(beam_motion_t), intent(in) :: field
      integer, intent(in) :: order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp), intent(out) :: tip(:), hose(:)

      hose = field%hose(order)
      tip = field%at(field%space%length, 0, order)
      if (.not. present(minus)) return
      hose = hose - minus%hose(order)
      tip = tip - minus%at(field%space%length, 0, order)
   end subroutine ends

   !> Integral over the beam of the square of a derivative with respect to x, at all times, by
   !> Gauss points on the finer mesh: exact where one mesh is part of the other.
   function integral_of_square(field, derivative, order, minus) result(values)
      type(beam_motion_t), intent(in) :: field
      integer, intent(in) :: derivative, order
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(size(field%t))
      real(wp) :: difference(size(field%t)), x, h
      type(rule_t) :: rule
      integer :: elements, degree, e, q

      elements = field%space%elements
      degree = field%space%degree
      if (present(minus)) then
         elements = max(elements, minus%space%elements)
         degree = max(degree, minus%space%degree)
      end if
      rule = gauss_legendre(degree - derivative + 1)
      h = field%space%length/elements
      values = 0
      do e = 0, elements - 1
         do q = 1, size(rule%points)
            x = (e + rule%points(q))*h
            difference = field%at(x, derivative, order)
            if (present(minus)) difference = difference - minus%at(x, derivative, order)
            values = values + rule%weights(q)*h*difference**2
         end do
      end do
   end function integral_of_square

   !> Size of a motion, or of the difference between two, in the norms of Lemma 3.1, (3.23) and
   !> (3.24): the largest |.|_V of displacement and of velocity, and the root of the integral of
   !> |.|_H**2 of the acceleration, (3.16).
   !>
   !> weights  of the times, as `graded_times` gives them [time]
   function motion_size(field, weights, minus) result(values)
      type(beam_motion_t), intent(in) :: field
      real(wp), intent(in) :: weights(:)
      type(beam_motion_t), intent(in), optional :: minus
      real(wp) :: values(3)

      values(1) = maxval(norm_V(field, 0, minus))
      values(2) = maxval(norm_V(field, 1, minus))
      values(3) = sqrt(sum(weights*norm_H(field, 2, minus)**2))
   end function motion_size

   !> Times and weights for integrals over [first node of the force, finish] of what a corner of the
   !> force sets going: behind each node of the force panels that grow with the distance tau from
   !> it, like tau**(2/3), four Gauss points in each. The high modes, which need the short ones, are
   !> what c_D damps away first.
   !>
   !> finish   behind the last node of the force [time]
   !> panels   behind the last node; fewer behind the others, so that all are graded alike
   !> times, weights  ascending; allocated on return [time]
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
