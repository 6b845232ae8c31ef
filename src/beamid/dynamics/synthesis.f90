!> Motion of the sensor from poles and residues: the last step of the solver `modal`.
!>
!> Each pole s has a state z with z' = s z + f(t), z = 0 before the force begins. The force f is
!> linear between its nodes, so z is known in closed form. Displacement, velocity and acceleration
!> of the sensor are Re(sum r z), Re(sum r s z) and Re(sum r s**2 z) + f o'M**-1 F, with the
!> residues r. A cluster of poles has states of its own, with rows in place of residues.
!>
!> The real and imaginary parts of all states at many times are the columns of a matrix. Each motion
!> and each derivative is this matrix times a vector of weights.
module beamid_synthesis
   use beamid_cluster_motion, only: cluster_state_t
   use beamid_excitation, only: excitation_t
   use beamid_interrupts, only: interrupted
   use beamid_kinds, only: wp
   use beamid_matrices, only: multiply_long
   use beamid_poles, only: poles_t
   use beamid_quasi_static, only: add_quasi_static, round_off
   implicit none
   private

   public :: synthesize, at_rest, states_t

   !> The states of all poles and clusters at one time.
   type :: states_t
      !> (2, poles) real and imaginary part of z, and of y = dz/ds; y has no columns if no
      !> derivatives are wanted
      real(wp), allocatable :: z(:, :), y(:, :)
      type(cluster_state_t), allocatable :: cluster(:)   !< states of the clusters
      real(wp) :: t = 0                               !< time of the states [time]
      integer :: node = 1                             !< last node of the force at or before t
      real(wp) :: shortfall = 0   !< t minus the sum of all step lengths: round-off [time]
   contains
      procedure :: columns, through
      procedure, private :: plan
   end type states_t

   !> One time step between two nodes of the force.
   type :: step_t
      real(wp) :: length = 0                !< length of the step [time]
      real(wp) :: force = 0, slope = 0   !< force at its beginning and its slope [force, force/time]
      integer :: row = 0                    !< index of the sample time at its end; 0: none
      logical :: same = .false.             !< as long as the step before
      logical :: is_free = .true.           !< no force acts
   end type step_t

   !> Number of times that are computed at once: their states fit into the cache of a processor.
   integer, parameter :: block_size = 500
   !> Exponentials of a step, and states at the end of a block, are set to 0 below this number.
   !> Processors take a hundred times as long for products that underflow.
   real(wp), parameter :: underflow_limit = 1e-150_wp

contains

   !> Computes motions of the sensor and their derivatives.
   !>
   !> poles       poles and residues, with derivatives if `motion` has more than one column
   !> excitation  the force, linear between its nodes
   !> times       ascending [time]
   !> which       1 displacement, 2 velocity, 3 acceleration
   !> motion      (times, 0:parameters, which) column 0 is the motion itself, column p its
   !>             derivative with respect to parameter p
   subroutine synthesize(poles, excitation, times, which, motion)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: which(:)
      real(wp), intent(out) :: motion(:, 0:, :)
      type(states_t) :: states
      real(wp), allocatable :: x(:, :)
      integer :: first, last, p, q

      states = at_rest(poles, excitation, size(motion, 2) > 1)
      allocate (x(min(block_size, size(times)), states%columns()))
      associate (weights => weights_of(poles, which, states%columns(), size(motion, 2) - 1))
         do first = 1, size(times), block_size
            if (interrupted()) exit
            last = min(first + block_size - 1, size(times))
            call states%through(poles, excitation, times(first:last), x)
            do q = 1, size(which)
               call multiply_long(x, weights(:, :, q), motion(first:last, :, q))
            end do
         end do
      end associate
      if (interrupted()) return
      if (.not. poles%has_all()) call add_quasi_static(poles, excitation, times, which, motion)
      do q = 1, size(which)
         if (which(q) < 3) cycle
         associate (force => excitation%force(times), impulse => [poles%impulse, poles%dimpulse])
            do p = 0, size(motion, 2) - 1
               motion(:, p, q) = motion(:, p, q) + impulse(p + 1)*force
            end do
         end associate
      end do
   end subroutine synthesize

   !> Returns the weights by which the columns of states are multiplied.
   !>
   !> which       1 displacement, 2 velocity, 3 acceleration
   !> columns     number of columns of states
   !> parameters  number of parameters
   !> weights     (columns, 0:parameters, which)
   function weights_of(poles, which, columns, parameters) result(weights)
      type(poles_t), intent(in) :: poles
      integer, intent(in) :: which(:), columns, parameters
      real(wp) :: weights(columns, 0:parameters, size(which))
      complex(wp) :: power(size(poles%s)), slope(size(poles%s))
      integer :: i, order, p, q, at

      weights = 0
      associate (n => size(poles%s), s => poles%s, r => poles%residue)
         do q = 1, size(which)
            order = which(q) - 1
            power = s**order
            call set(0, n, 0, r*power)
            do p = 1, parameters
               ! d(r s**k z) = (dr s**k + k r s**(k - 1) ds) z + r s**k ds y
               slope = poles%dr(:, p)*power
               if (order > 0) slope = slope + order*r*s**(order - 1)*poles%ds(:, p)
               call set(0, n, p, slope)
               call set(2*n, n, p, r*power*poles%ds(:, p))
            end do
            at = merge(4, 2, parameters > 0)*n
            do i = 1, size(poles%cluster)
               associate (cluster => poles%cluster(i), &
                  m => merge(2, 1, parameters > 0)*poles%cluster(i)%m)
                  call set(at, m, 0, cluster%row(:, which(q)))
                  do p = 1, parameters
                     call set(at, m, p, cluster%drow(:, which(q), p))
                  end do
                  at = at + 2*m
               end associate
            end do
         end do
      end associate

   contains

      !> Sets the weights in column p that make the real part of the sum of coefficients times
      !> states.
      !>
      !> before, states  number of columns before those of the states, and number of states
      !> coefficients    (states or fewer)
      subroutine set(before, states, p, coefficients)
         integer, intent(in) :: before, states, p
         complex(wp), intent(in) :: coefficients(:)

         associate (m => size(coefficients))
            weights(before + 1:before + m, p, q) = real(coefficients)
            weights(before + states + 1:before + states + m, p, q) = -aimag(coefficients)
         end associate
      end subroutine set

   end function weights_of

   !> Returns the states of a structure at rest, at the first node of the force.
   !>
   !> with_slopes  whether derivatives are wanted
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

   !> Returns the number of columns that the states have: real and imaginary parts of z, y and the
   !> clusters' states.
   pure integer function columns(self)
      class(states_t), intent(in) :: self
      integer :: k

      columns = size(self%z) + size(self%y)
      do k = 1, size(self%cluster)
         columns = columns + 2*size(self%cluster(k)%x)
      end do
   end function columns

   !> Advances the states through given times, and through the nodes of the force in between.
   !>
   !> times  ascending within a call and from call to call [time]; before the first node of the
   !>        force the states are 0
   !> x      (times or more, columns) states at the times: for z, for y and for each cluster, all
   !>        real parts, then all imaginary parts
   subroutine through(self, poles, excitation, times, x)
      class(states_t), intent(inout) :: self
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(wp), intent(inout), contiguous :: x(:, :)
      type(step_t), allocatable :: steps(:)
      integer :: at, i, j, k, n, n_steps

      call self%plan(excitation, times, steps, n_steps)
      n = size(poles%s)
      do k = 1, n
         if (size(self%y) > 0) then
            call march(poles%s(k), steps(:n_steps), self%z(:, k), x(:, k), x(:, n + k), &
               self%y(:, k), x(:, 2*n + k), x(:, 3*n + k))
         else
            call march(poles%s(k), steps(:n_steps), self%z(:, k), x(:, k), x(:, n + k))
         end if
      end do
      at = size(self%z) + size(self%y)
      do i = 1, size(self%cluster)
         associate (cluster => self%cluster(i), m => size(self%cluster(i)%x))
            do j = 1, n_steps
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

   !> Plans the steps: from node to node of the force, and to each of the times. Two times that
   !> differ only by round-off count as one, so that a force with nodes at the sample times takes
   !> one step per sample.
   !>
   !> steps  out: the steps; the first n are used
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
            if (t(nodes + 1) > times(last) + round_off(times(last))) exit
            nodes = nodes + 1
         end do
         allocate (steps(last + nodes - self%node))
         n = 0
         do k = 1, last
            near = times(k) + round_off(times(k))
            do while (self%node < size(t))
               if (t(self%node + 1) > near) exit
               call add_step(t(self%node + 1))
               self%node = self%node + 1
            end do
            if (times(k) > self%t + round_off(times(k)) .or. n == 0) then
               call add_step(max(self%t, times(k)))
            else if (steps(n)%row > 0) then
               call add_step(self%t)
            end if
            steps(n)%row = k
         end do
      end associate

   contains

      !> Adds the step from the time of the states to `finish` [time].
      subroutine add_step(finish)
         real(wp), intent(in) :: finish
         type(step_t) :: by

         ! On a uniform grid all steps have the same length, and the exponentials are used again.
         ! The round-off that a step neglects is added to the next, so that it does not
         ! accumulate.
         self%shortfall = self%shortfall + (finish - self%t)
         by = step_t(length=max(0.0_wp, self%shortfall))
         if (n > 0) by%same = abs(by%length - steps(n)%length) <= round_off(finish)
         if (by%same) by%length = steps(n)%length
         self%shortfall = self%shortfall - by%length
         associate (t => excitation%t, f => excitation%f, node => self%node)
            if (node < size(t)) then
               by%slope = (f(node + 1) - f(node))/(t(node + 1) - t(node))
               by%force = f(node) + by%slope*(self%t - t(node))
               by%is_free = .not. abs(by%force) + abs(by%slope) > 0
            end if
         end associate
         n = n + 1
         steps(n) = by
         self%t = finish
      end subroutine add_step

   end subroutine plan

   !> Advances the state of one pole through all steps: z' = s z + f and, if wanted, y' = s y + z.
   !>
   !> s          the pole [1/time]
   !> steps      from `plan`
   !> z, y       (2) real and imaginary part of the state, in and out; y: default: not wanted
   !> x, x_imag  (times) out: real and imaginary part of z at the samples
   !> w, w_imag  (times) out: the same of y
   pure subroutine march(s, steps, z, x, x_imag, y, w, w_imag)
      complex(wp), intent(in) :: s
      type(step_t), intent(in) :: steps(:)
      real(wp), intent(inout) :: z(2)
      real(wp), intent(inout), contiguous :: x(:), x_imag(:)
      real(wp), intent(inout), optional :: y(2)
      real(wp), intent(inout), optional, contiguous :: w(:), w_imag(:)
      complex(wp) :: growth, z_now, y_now, phi(4)
      real(wp) :: re, im, z_re, z_im, y_re, y_im, start(2)
      logical :: known, with_slope
      integer :: j

      with_slope = present(y)
      z_re = z(1)
      z_im = z(2)
      start = 0
      if (with_slope) start = y
      y_re = start(1)
      y_im = start(2)
      growth = 1
      known = .false.
      do j = 1, size(steps)
         associate (by => steps(j), h => steps(j)%length)
            if (.not. by%same) then
               growth = exp(s*h)
               if (abs(real(growth)) + abs(aimag(growth)) < underflow_limit) growth = 0
               known = .false.
            end if
            if (with_slope) then
               re = y_re + h*z_re
               im = y_im + h*z_im
               y_re = real(growth)*re - aimag(growth)*im
               y_im = real(growth)*im + aimag(growth)*re
            end if
            re = real(growth)*z_re - aimag(growth)*z_im
            z_im = real(growth)*z_im + aimag(growth)*z_re
            z_re = re
            if (.not. by%is_free) then
               if (.not. known) phi = phi_functions(s*h, growth)
               known = .true.
               z_now = h*(by%force*phi(1) + by%slope*h*phi(2))
               y_now = h**2*(by%force*phi(3) + by%slope*h*phi(4))
               z_re = z_re + real(z_now)
               z_im = z_im + aimag(z_now)
               y_re = y_re + real(y_now)
               y_im = y_im + aimag(y_now)
            end if
            if (by%row == 0) cycle
            x(by%row) = z_re
            x_imag(by%row) = z_im
            if (.not. with_slope) cycle
            w(by%row) = y_re
            w_imag(by%row) = y_im
         end associate
      end do
      z = [z_re, z_im]
      if (sum(abs(z)) < underflow_limit) z = 0
      if (.not. with_slope) return
      y = [y_re, y_im]
      if (sum(abs(y)) < underflow_limit) y = 0
   end subroutine march

   !> Returns phi_1 = (e**x - 1)/x, phi_2 = (phi_1 - 1)/x, and their derivatives phi_1' = phi_1 -
   !> phi_2 and phi_2' = phi_2 - 2 phi_3, where phi_3 = (phi_2 - 1/2)/x. For small x, phi_3 comes
   !> from its power series. For large x (a pole much faster than the samples) these differences
   !> would cancel, so closed forms are used.
   !>
   !> x            s times the step
   !> exponential  e**x
   !> phi          (4) phi_1, phi_2, phi_1', phi_2'
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
         ! phi_3 = sum x**k/(k + 3)!; the first term left out is at most 2**25/28!.
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
