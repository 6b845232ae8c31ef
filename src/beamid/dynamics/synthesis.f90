!> Motion of the sensor from poles and residues.
!>
!> Each pole carries a state z' = s z + f(t), at rest before the force. f is linear between its
!> nodes, so that z is known in closed form; displacement, velocity and acceleration of the sensor
!> are Re(sum r z), Re(sum r s z) and Re(sum r s**2 z) + f o' M**-1 F. A cluster of poles has states
!> of its own, and rows in the place of residues. Real and imaginary parts of all states at many
!> times are a matrix, and each motion and each derivative is that matrix times a vector.
module beamid_synthesis
   use beamid_cluster_motion, only: cluster_state_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   implicit none
   private

   public :: synthesize, at_rest, states_t

   !> Real and imaginary parts of z of all poles, and of y = dz/ds where derivatives are wanted.
   type :: states_t
      real(wp), allocatable :: z(:, :), y(:, :)       !< (poles, 2); y of no poles: not wanted
      type(cluster_state_t), allocatable :: cluster(:)
      real(wp) :: t = 0                               !< where they have got to [time]
      integer :: node = 1                             !< of the force, at or before t
      real(wp), allocatable :: growth(:, :)           !< e**(s step)
      real(wp) :: step = -1                           !< of `growth` [time]
      integer :: repeated = 0                         !< how often in a row it was used
   contains
      procedure :: columns
      procedure :: through
      procedure, private :: advance
   end type states_t

   !> Times at once: the states of so many stay in the cache of a processor.
   integer, parameter :: block = 500

contains

   !> Motions at the times and their derivatives.
   !>
   !> times   ascending [time]
   !> which   1 displacement, 2 velocity, 3 acceleration
   !> motion  (times, 0:parameters, which), 0 the motion itself
   subroutine synthesize(poles, excitation, times, which, motion)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: which(:)
      real(wp), intent(out) :: motion(:, 0:, :)
      type(states_t) :: states
      real(wp), allocatable :: x(:, :), weights(:, :, :)
      integer :: first, last, q

      states = at_rest(poles, excitation, size(motion, 2) > 1)
      allocate (x(min(block, size(times)), states%columns()))
      weights = weights_of(poles, which, states%columns(), size(motion, 2) - 1)
      do first = 1, size(times), block
         last = min(first + block - 1, size(times))
         call states%through(poles, excitation, times(first:last), x(:last - first + 1, :))
         do q = 1, size(which)
            motion(first:last, :, q) = matmul(x(:last - first + 1, :), weights(:, :, q))
         end do
      end do
      do q = 1, size(which)
         if (which(q) < 3) cycle
         associate (force => excitation%force(times), impulse => [poles%impulse, poles%dimpulse])
            do last = 0, size(motion, 2) - 1
               motion(:, last, q) = motion(:, last, q) + impulse(last + 1)*force
            end do
         end associate
      end do
   end subroutine synthesize

   !> What the columns of states are multiplied by.
   !>
   !> weights  (columns, 0:parameters, which)
   pure function weights_of(poles, which, columns, parameters) result(weights)
      type(poles_t), intent(in) :: poles
      integer, intent(in) :: which(:), columns, parameters
      real(wp) :: weights(columns, 0:parameters, size(which))
      complex(wp) :: power(size(poles%s)), r(size(poles%s))
      integer :: i, m, order, p, q, at

      associate (n => size(poles%s), s => poles%s)
         do q = 1, size(which)
            order = which(q) - 1
            power = s**order
            r = poles%residue*power
            weights(:, 0, q) = 0
            weights(:n, 0, q) = real(r)
            weights(n + 1:2*n, 0, q) = -aimag(r)
            do p = 1, parameters
               ! d(r s**k z) = (dr s**k + k r s**(k - 1) ds) z + r s**k ds y
               r = poles%dr(:, p)*power
               if (order > 0) r = r + order*poles%residue*s**(order - 1)*poles%ds(:, p)
               weights(:n, p, q) = real(r)
               weights(n + 1:2*n, p, q) = -aimag(r)
               r = poles%residue*power*poles%ds(:, p)
               weights(2*n + 1:3*n, p, q) = real(r)
               weights(3*n + 1:4*n, p, q) = -aimag(r)
            end do
            at = merge(4, 2, parameters > 0)*n
            do i = 1, size(poles%cluster)
               associate (cluster => poles%cluster(i))
                  m = merge(2, 1, parameters > 0)*cluster%m
                  weights(at + 1:at + cluster%m, 0, q) = real(cluster%row(:, which(q)))
                  weights(at + m + 1:at + m + cluster%m, 0, q) = -aimag(cluster%row(:, which(q)))
                  do p = 1, parameters
                     weights(at + 1:at + m, p, q) = real(cluster%drow(:, which(q), p))
                     weights(at + m + 1:at + 2*m, p, q) = -aimag(cluster%drow(:, which(q), p))
                  end do
                  at = at + 2*m
               end associate
            end do
         end do
      end associate
   end function weights_of

   !> Nothing moves, at the first node of the force.
   !>
   !> with_slopes  whether dz/ds is wanted too
   pure function at_rest(poles, excitation, with_slopes) result(states)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      logical, intent(in) :: with_slopes
      type(states_t) :: states
      integer :: k, n

      n = size(poles%s)
      allocate (states%z(n, 2), states%y(merge(n, 0, with_slopes), 2), source=0.0_wp)
      allocate (states%growth(n, 2), states%cluster(size(poles%cluster)))
      do k = 1, size(poles%cluster)
         allocate (states%cluster(k)%x(merge(2, 1, with_slopes)*poles%cluster(k)%m), &
            source=(0.0_wp, 0.0_wp))
      end do
      states%t = excitation%t(1)
   end function at_rest

   !> How many numbers they are.
   pure integer function columns(self)
      class(states_t), intent(in) :: self
      integer :: k

      columns = 2*(size(self%z, 1) + size(self%y, 1) &
         + sum([(size(self%cluster(k)%x), k=1, size(self%cluster))]))
   end function columns

   !> Marches through times and the nodes of the force.
   !>
   !> times  ascending, from where the states are [time]; before the first node they are 0
   !> x      (times, columns) real parts, then imaginary parts: of z, of y, of each cluster
   pure subroutine through(self, poles, excitation, times, x)
      class(states_t), intent(inout) :: self
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(wp), intent(out) :: x(:, :)
      integer :: at, i, k, m, n

      n = size(self%z, 1)
      m = size(self%y, 1)
      do k = 1, size(times)
         do while (self%node < size(excitation%t))
            if (excitation%t(self%node + 1) > times(k)) exit
            call self%advance(poles, excitation, excitation%t(self%node + 1))
            self%node = self%node + 1
         end do
         if (times(k) > self%t) call self%advance(poles, excitation, times(k))
         x(k, :n) = self%z(:, 1)
         x(k, n + 1:2*n) = self%z(:, 2)
         at = 2*(n + m)
         x(k, 2*n + 1:2*n + m) = self%y(:, 1)
         x(k, 2*n + m + 1:at) = self%y(:, 2)
         do i = 1, size(self%cluster)
            associate (states => self%cluster(i)%x)
               x(k, at + 1:at + size(states)) = real(states)
               at = at + size(states)
               x(k, at + 1:at + size(states)) = aimag(states)
               at = at + size(states)
            end associate
         end do
      end do
   end subroutine through

   !> From t to `finish`, within one segment of the force.
   pure subroutine advance(self, poles, excitation, finish)
      class(states_t), intent(inout) :: self
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: finish
      real(wp) :: step, force, slope, re
      logical :: same
      integer :: k

      step = finish - self%t
      ! On a uniform grid the exponentials serve again; now and then they are computed afresh, so
      ! that differences in the last digit of the step do not add up.
      same = abs(step - self%step) <= 4*epsilon(finish)*abs(finish) .and. self%repeated < 64
      if (.not. same) then
         do k = 1, size(poles%s)
            associate (growth => exp(poles%s(k)*step))
               self%growth(k, 1) = real(growth)
               self%growth(k, 2) = aimag(growth)
            end associate
         end do
         self%step = step
         self%repeated = 0
      end if
      self%repeated = self%repeated + 1
      associate (z => self%z, y => self%y, g => self%growth)
         do k = 1, size(y, 1)
            re = y(k, 1) + step*z(k, 1)
            y(k, 2) = y(k, 2) + step*z(k, 2)
            y(k, 1) = g(k, 1)*re - g(k, 2)*y(k, 2)
            y(k, 2) = g(k, 1)*y(k, 2) + g(k, 2)*re
         end do
         do k = 1, size(z, 1)
            re = z(k, 1)
            z(k, 1) = g(k, 1)*re - g(k, 2)*z(k, 2)
            z(k, 2) = g(k, 1)*z(k, 2) + g(k, 2)*re
         end do
      end associate
      force = 0
      slope = 0
      if (self%node < size(excitation%t)) then
         associate (t => excitation%t, f => excitation%f, node => self%node)
            slope = (f(node + 1) - f(node))/(t(node + 1) - t(node))
            force = f(node) + slope*(self%t - t(node))
         end associate
      end if
      do k = 1, size(poles%cluster)
         call self%cluster(k)%advance(poles%cluster(k), force, slope, step, same)
      end do
      if (abs(force) + abs(slope) > 0) call drive(self, poles, force, slope)
      self%t = finish
   end subroutine advance

   !> What the force adds within a step: to z force step phi_1 + slope step**2 phi_2, to y its
   !> derivative.
   pure subroutine drive(self, poles, force, slope)
      type(states_t), intent(inout) :: self
      type(poles_t), intent(in) :: poles
      real(wp), intent(in) :: force, slope
      complex(wp) :: phi(4), more
      integer :: k

      associate (step => self%step)
         do k = 1, size(poles%s)
            phi = phi_functions(poles%s(k)*step, cmplx(self%growth(k, 1), self%growth(k, 2), wp))
            more = step*(force*phi(1) + slope*step*phi(2))
            self%z(k, :) = self%z(k, :) + [real(more), aimag(more)]
            if (size(self%y) == 0) cycle
            more = step**2*(force*phi(3) + slope*step*phi(4))
            self%y(k, :) = self%y(k, :) + [real(more), aimag(more)]
         end do
      end associate
   end subroutine drive

   !> phi_1 = (e**x - 1)/x, phi_2 = (phi_1 - 1)/x, and their derivatives phi_1' = phi_1 - phi_2 and
   !> phi_2' = phi_2 - 2 phi_3, phi_3 = (phi_2 - 1/2)/x. By the series of phi_3 for small x; for
   !> large x, a root much faster than the samples, these differences would cancel.
   pure function phi_functions(x, exponential) result(phi)
      complex(wp), intent(in) :: x, exponential
      complex(wp) :: phi(4), phi_3
      integer :: k

      if (real(x)**2 + aimag(x)**2 > 4) then
         phi(1) = (exponential - 1)/x
         phi(2) = (phi(1) - 1)/x
         phi(3) = (exponential*(x - 1) + 1)/x**2
         phi(4) = (exponential*(x - 2) + (x + 2))/x**3
      else
         ! phi_3 = sum x**k/(k + 3)!, to 2**24/27! < 1e-20
         phi_3 = 1
         do k = 24, 1, -1
            phi_3 = 1 + phi_3*x*(1.0_wp/(k + 3))
         end do
         phi_3 = phi_3/6
         phi(2) = 0.5_wp + x*phi_3
         phi(1) = 1 + x*phi(2)
         phi(3) = phi(1) - phi(2)
         phi(4) = phi(2) - 2*phi_3
      end if
   end function phi_functions

end module beamid_synthesis
