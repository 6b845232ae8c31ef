!> The size of a beam's motion, or of the difference of two motions, in the norms of the paper's
!> Section 3, and the points of time at which these norms are computed.
module beamid_motion_norms
   use beamid_beam_motions, only: beam_motion_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_quadrature, only: gauss_legendre, rule_t
   implicit none
   private

   public :: norm_V, norm_H, motion_size, graded_times

contains

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

end module beamid_motion_norms
