!> Motion of the sensor from poles and residues.
!>
!> Each pole carries a state z' = s z + f(t), at rest before the force. f is linear between its
!> nodes, so that z is known in closed form; displacement, velocity and acceleration of the sensor
!> are Re(sum r z), Re(sum r s z) and Re(sum r s**2 z) + f o' M**-1 F. A cluster of poles has states
!> of its own, and rows in the place of residues.
module beamid_synthesis
   use beamid_cluster_motion, only: cluster_state_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t
   implicit none
   private

   public :: synthesize, advance, at_rest, states_t

   !> States of all poles, and their derivatives with respect to the pole.
   type :: states_t
      complex(wp), allocatable :: z(:), y(:)          !< z, dz/ds
      type(cluster_state_t), allocatable :: cluster(:)
      complex(wp), allocatable :: growth(:)           !< e**(s step)
      real(wp) :: step = -1                           !< of `growth` [time]
      integer :: repeated = 0                         !< how often in a row it was used
   end type states_t

contains

   !> Marches through the sample times and the nodes of the force.
   subroutine synthesize(poles, excitation, times, response, slopes)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(inout) :: response
      type(response_t), allocatable, intent(out) :: slopes(:)
      type(states_t) :: states
      complex(wp), allocatable :: rs(:), rss(:)
      real(wp) :: t
      integer :: k, node, p

      response = zero_response(times)
      allocate (slopes(size(poles%ds, 2)))
      do p = 1, size(slopes)
         slopes(p) = zero_response(times)
      end do
      states = at_rest(poles, size(slopes) > 0)
      rs = poles%residue*poles%s
      rss = rs*poles%s
      node = 1
      t = excitation%t(1)
      do k = 1, size(times)
         do while (node < size(excitation%t))
            if (excitation%t(node + 1) > times(k)) exit
            call advance(states, poles, excitation, node, t, excitation%t(node + 1), &
               size(slopes) > 0)
            t = excitation%t(node + 1)
            node = node + 1
         end do
         if (times(k) > t) then
            call advance(states, poles, excitation, node, t, times(k), size(slopes) > 0)
            t = times(k)
         end if
         call observe(states, poles, rs, rss, excitation%force(times(k)), k, response, slopes)
      end do
   end subroutine synthesize

   !> A response of zeros.
   pure function zero_response(times) result(response)
      real(wp), intent(in) :: times(:)
      type(response_t) :: response

      response%t = times
      allocate (response%displacement(size(times)), response%velocity(size(times)), &
         response%acceleration(size(times)), source=0.0_wp)
   end function zero_response

   !> Nothing moves.
   pure function at_rest(poles, with_slopes) result(states)
      type(poles_t), intent(in) :: poles
      logical, intent(in) :: with_slopes
      type(states_t) :: states
      integer :: k

      allocate (states%z(size(poles%s)), states%y(size(poles%s)), states%growth(size(poles%s)))
      states%z = 0
      states%y = 0
      allocate (states%cluster(size(poles%cluster)))
      do k = 1, size(poles%cluster)
         allocate (states%cluster(k)%x(merge(2, 1, with_slopes)*poles%cluster(k)%m), &
            source=(0.0_wp, 0.0_wp))
      end do
   end function at_rest

   !> From t to `finish`, within the segment of the force that begins at `node`.
   !>
   !> with_slopes  whether dz/ds is wanted too
   pure subroutine advance(states, poles, excitation, node, t, finish, with_slopes)
      type(states_t), intent(inout) :: states
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: node
      real(wp), intent(in) :: t, finish
      logical, intent(in) :: with_slopes
      real(wp) :: step, force, slope
      complex(wp) :: phi(4), x
      logical :: same
      integer :: k

      step = finish - t
      ! On a uniform grid the exponentials serve again; now and then they are computed afresh, so
      ! that differences in the last digit of the step do not add up.
      same = abs(step - states%step) <= 4*spacing(finish) .and. states%repeated < 64
      if (.not. same) then
         states%growth = exp(poles%s*step)
         states%step = step
         states%repeated = 0
      end if
      states%repeated = states%repeated + 1
      if (with_slopes) then
         do k = 1, size(poles%s)
            states%y(k) = states%growth(k)*(states%y(k) + step*states%z(k))
         end do
      end if
      do k = 1, size(poles%s)
         states%z(k) = states%growth(k)*states%z(k)
      end do
      force = 0
      slope = 0
      if (node < size(excitation%t)) then
         associate (nodes => excitation%t, f => excitation%f)
            slope = (f(node + 1) - f(node))/(nodes(node + 1) - nodes(node))
            force = f(node) + slope*(t - nodes(node))
         end associate
      end if
      do k = 1, size(poles%cluster)
         call states%cluster(k)%advance(poles%cluster(k), force, slope, step, same)
      end do
      if (node >= size(excitation%t)) return
      do k = 1, size(poles%s)
         ! z: force step phi_1 + slope step**2 phi_2.
         x = poles%s(k)*step
         phi = phi_functions(x, states%growth(k))
         states%z(k) = states%z(k) + step*(force*phi(1) + slope*step*phi(2))
         states%y(k) = states%y(k) + step**2*(force*phi(3) + slope*step*phi(4))
      end do
   end subroutine advance

   !> phi_1 = (e**x - 1)/x, phi_2 = (phi_1 - 1)/x, and their derivatives phi_1' = phi_1 - phi_2 and
   !> phi_2' = phi_2 - 2 phi_3, phi_3 = (phi_2 - 1/2)/x. By the series of phi_3 for small x; for
   !> large x, a root much faster than the samples, these differences would cancel.
   pure function phi_functions(x, exponential) result(phi)
      complex(wp), intent(in) :: x, exponential
      complex(wp) :: phi(4), phi_3
      integer :: k

      if (abs(x) > 2) then
         phi(1) = (exponential - 1)/x
         phi(2) = (phi(1) - 1)/x
         phi(3) = (exponential*(x - 1) + 1)/x**2
         phi(4) = (exponential*(x - 2) + (x + 2))/x**3
      else
         ! phi_3 = sum x**k/(k + 3)!, to 2**24/27! < 1e-20
         phi_3 = 1
         do k = 24, 1, -1
            phi_3 = 1 + phi_3*x/(k + 3)
         end do
         phi_3 = phi_3/6
         phi(2) = 0.5_wp + x*phi_3
         phi(1) = 1 + x*phi(2)
         phi(3) = phi(1) - phi(2)
         phi(4) = phi(2) - 2*phi_3
      end if
   end function phi_functions

   !> Motion at sample k and its derivatives.
   pure subroutine observe(states, poles, rs, rss, force, k, response, slopes)
      type(states_t), intent(in) :: states
      type(poles_t), intent(in) :: poles
      complex(wp), intent(in) :: rs(:), rss(:)
      real(wp), intent(in) :: force
      integer, intent(in) :: k
      type(response_t), intent(inout) :: response
      type(response_t), intent(inout) :: slopes(:)
      complex(wp) :: r_p, s_p, change, z
      real(wp) :: u, v, a
      integer :: i, p

      u = 0
      v = 0
      a = force*poles%impulse
      do i = 1, size(poles%s)
         z = states%z(i)
         u = u + real(poles%residue(i))*real(z) - aimag(poles%residue(i))*aimag(z)
         v = v + real(rs(i))*real(z) - aimag(rs(i))*aimag(z)
         a = a + real(rss(i))*real(z) - aimag(rss(i))*aimag(z)
      end do
      do i = 1, size(poles%cluster)
         associate (row => poles%cluster(i)%row, x => states%cluster(i)%x(:poles%cluster(i)%m))
            u = u + real(sum(row(:, 1)*x))
            v = v + real(sum(row(:, 2)*x))
            a = a + real(sum(row(:, 3)*x))
         end associate
      end do
      response%displacement(k) = u
      response%velocity(k) = v
      response%acceleration(k) = a
      do p = 1, size(slopes)
         u = 0
         v = 0
         a = force*poles%dimpulse(p)
         do i = 1, size(poles%s)
            r_p = poles%dr(i, p)
            s_p = poles%ds(i, p)
            z = states%z(i)
            ! d(r z) = r_p z + r s_p y; with s before it, twice: the product rule.
            change = r_p*z + poles%residue(i)*s_p*states%y(i)
            u = u + real(change)
            change = change*poles%s(i) + poles%residue(i)*z*s_p
            v = v + real(change)
            change = change*poles%s(i) + rs(i)*z*s_p
            a = a + real(change)
         end do
         do i = 1, size(poles%cluster)
            associate (row => poles%cluster(i)%drow(:, :, p), x => states%cluster(i)%x)
               u = u + real(sum(row(:, 1)*x))
               v = v + real(sum(row(:, 2)*x))
               a = a + real(sum(row(:, 3)*x))
            end associate
         end do
         slopes(p)%displacement(k) = u
         slopes(p)%velocity(k) = v
         slopes(p)%acceleration(k) = a
      end do
   end subroutine observe

end module beamid_synthesis
