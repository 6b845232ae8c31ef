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
   use beamid_interrupts, only: interrupted
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   implicit none
   private

   public :: synthesize, at_rest, states_t

   !> Real and imaginary parts of z of all poles, and of y = dz/ds where derivatives are wanted.
   type :: states_t
      real(wp), allocatable :: z(:, :), y(:, :)       !< (2, poles); y of no poles: not wanted
      type(cluster_state_t), allocatable :: cluster(:)
      real(wp) :: t = 0                               !< where they have got to [time]
      integer :: node = 1                             !< of the force, at or before t
      real(wp) :: behind = 0                          !< what the steps so far lack to t [time]
   contains
      procedure :: columns
      procedure :: through
      procedure, private :: plan
   end type states_t

   !> One step within a segment of the force.
   type :: step_t
      real(wp) :: length = 0                !< [time]
      real(wp) :: force = 0, slope = 0      !< at its beginning, and its slope
      integer :: row = 0                    !< the sample it ends at; 0: none
      logical :: same = .false.             !< as long as the one before
   end type step_t

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
         if (interrupted()) return
         last = min(first + block - 1, size(times))
         call states%through(poles, excitation, times(first:last), x)
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
      allocate (states%z(2, n), states%y(2, merge(n, 0, with_slopes)), source=0.0_wp)
      allocate (states%cluster(size(poles%cluster)))
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

      columns = size(self%z) + size(self%y) &
         + 2*sum([(size(self%cluster(k)%x), k=1, size(self%cluster))])
   end function columns

   !> Marches through times and the nodes of the force, pole by pole.
   !>
   !> times  ascending, from where the states are [time]; before the first node they are 0
   !> x      (times or more, columns) real parts, then imaginary parts: of z, of y, of each cluster
   subroutine through(self, poles, excitation, times, x)
      class(states_t), intent(inout) :: self
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(wp), intent(inout), contiguous :: x(:, :)
      type(step_t), allocatable :: steps(:)
      integer :: at, count, i, j, k, n

      call self%plan(excitation, times, steps, count)
      n = size(poles%s)
      do k = 1, n
         if (size(self%y) > 0) then
            call march(poles%s(k), steps(:count), self%z(:, k), x(:, k), x(:, n + k), &
               self%y(:, k), x(:, 2*n + k), x(:, 3*n + k))
         else
            call march(poles%s(k), steps(:count), self%z(:, k), x(:, k), x(:, n + k))
         end if
      end do
      at = size(self%z) + size(self%y)
      do i = 1, size(self%cluster)
         associate (cluster => self%cluster(i), m => size(self%cluster(i)%x))
            do j = 1, count
               associate (by => steps(j))
                  call cluster%advance(poles%cluster(i), by%force, by%slope, by%length, by%same)
                  if (by%row == 0) cycle
                  x(by%row, at + 1:at + m) = real(cluster%x)
                  x(by%row, at + m + 1:at + 2*m) = aimag(cluster%x)
               end associate
            end do
            at = at + 2*m
         end associate
      end do
   end subroutine through

   !> The steps to some times, from node to node of the force and to each of them. What differs in
   !> the last digits only is one time: a force in step with the samples takes one step for each.
   !>
   !> steps  the first n are they
   subroutine plan(self, excitation, times, steps, n)
      class(states_t), intent(inout) :: self
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(step_t), allocatable, intent(out) :: steps(:)
      integer, intent(out) :: n
      real(wp) :: near
      integer :: k, last, nodes

      last = size(times)
      associate (t => excitation%t)
         nodes = self%node
         do while (nodes < size(t) .and. last > 0)
            if (t(nodes + 1) > times(last) + digits_of(times(last))) exit
            nodes = nodes + 1
         end do
         allocate (steps(last + nodes - self%node))
         n = 0
         do k = 1, last
            near = times(k) + digits_of(times(k))
            do while (self%node < size(t))
               if (t(self%node + 1) > near) exit
               call add(t(self%node + 1))
               self%node = self%node + 1
            end do
            if (times(k) > self%t + digits_of(times(k)) .or. n == 0) then
               call add(max(self%t, times(k)))
            else if (steps(n)%row > 0) then
               call add(self%t)
            end if
            steps(n)%row = k
         end do
      end associate

   contains

      subroutine add(finish)
         real(wp), intent(in) :: finish

         n = n + 1
         associate (by => steps(n), t => excitation%t, f => excitation%f, node => self%node)
            ! On a uniform grid the exponentials serve again. What their steps lack the next one
            ! has more: differences in the last digits do not add up.
            self%behind = self%behind + (finish - self%t)
            by%length = max(0.0_wp, self%behind)
            if (n > 1) by%same = abs(by%length - steps(n - 1)%length) <= digits_of(finish)
            if (by%same) by%length = steps(n - 1)%length
            self%behind = self%behind - by%length
            if (node < size(t)) then
               by%slope = (f(node + 1) - f(node))/(t(node + 1) - t(node))
               by%force = f(node) + by%slope*(self%t - t(node))
            end if
         end associate
         self%t = finish
      end subroutine add

   end subroutine plan

   !> The last digits of a time.
   pure real(wp) function digits_of(t)
      real(wp), intent(in) :: t

      digits_of = 4*epsilon(t)*abs(t)
   end function digits_of

   !> One pole through steps: z' = s z + f, and y' = s y + z where it is wanted.
   !>
   !> s               [1/time]
   !> z, y            (2) real and imaginary part, in and out
   !> x, x_i, w, w_i  (times) both at the samples: of z, and of y
   pure subroutine march(s, steps, z, x, x_i, y, w, w_i)
      complex(wp), intent(in) :: s
      type(step_t), intent(in) :: steps(:)
      real(wp), intent(inout) :: z(2)
      real(wp), intent(inout), contiguous :: x(:), x_i(:)
      real(wp), intent(inout), optional :: y(2)
      real(wp), intent(inout), optional, contiguous :: w(:), w_i(:)
      complex(wp) :: growth, phi(4), more
      real(wp) :: zr, zi, yr, yi, gr, gi, re
      logical :: known, slopes
      integer :: j

      slopes = present(y)
      zr = z(1)
      zi = z(2)
      yr = 0
      yi = 0
      if (slopes) then
         yr = y(1)
         yi = y(2)
      end if
      gr = 1
      gi = 0
      known = .false.
      do j = 1, size(steps)
         associate (by => steps(j), h => steps(j)%length)
            if (.not. by%same) then
               growth = exp(s*h)
               gr = real(growth)
               gi = aimag(growth)
               known = .false.
            end if
            if (slopes) then
               re = yr + h*zr
               yi = yi + h*zi
               yr = gr*re - gi*yi
               yi = gr*yi + gi*re
            end if
            re = zr
            zr = gr*re - gi*zi
            zi = gr*zi + gi*re
            if (abs(by%force) + abs(by%slope) > 0) then
               ! To z force h phi_1 + slope h**2 phi_2, to y its derivative.
               if (.not. known) phi = phi_functions(s*h, cmplx(gr, gi, wp))
               known = .true.
               more = h*(by%force*phi(1) + by%slope*h*phi(2))
               zr = zr + real(more)
               zi = zi + aimag(more)
               if (slopes) then
                  more = h**2*(by%force*phi(3) + by%slope*h*phi(4))
                  yr = yr + real(more)
                  yi = yi + aimag(more)
               end if
            end if
            if (by%row == 0) cycle
            x(by%row) = zr
            x_i(by%row) = zi
            if (.not. slopes) cycle
            w(by%row) = yr
            w_i(by%row) = yi
         end associate
      end do
      z = [zr, zi]
      if (slopes) y = [yr, yi]
   end subroutine march

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
