!> The excitation of the beam: a force as a function of time, the release of a deflected tip, a
!> motion of the base, or an unknown excitation before the record began (free motion).
module beamid_excitation
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   implicit none
   private

   public :: excitation_t, new_pulse, new_force_table, new_release, new_free, new_base_motion

   !> Times that differ by less than this many units in the last place count as equal.
   real(wp), parameter, public :: same_time = 16

   !> An excitation f(t): piecewise linear between its nodes and zero outside the interval from the
   !> first to the last node, at both of which it may jump.
   type :: excitation_t
      real(wp), allocatable :: t(:)      !< nodes, strictly increasing [time]
      !> values at the nodes, amplitude*shape [force]; of a moving base [length/time**2]
      real(wp), allocatable :: f(:)
      real(wp), allocatable, private :: shape(:)   !< values at the nodes per unit amplitude
      !> amplitude of a pulse [force], of a release [force] or [length]; factor of a table [1]
      real(wp) :: amplitude = 1
      !> .false.: the force acts at a point, (3.11). .true.: distributed, (3.10), with
      !> theta(x) = (x/l)**power.
      logical :: distributed = .false.
      real(wp) :: power = 2              !< exponent of theta(x), >= 2
      !> .true.: the amplitude is the static displacement at x_F before a release [length]; the
      !> force follows from the static stiffness (`fit_to`).
      logical :: by_displacement = .false.
      logical :: is_release = .false.    !< a static force is removed at the first node
      !> .true.: f is the acceleration of the base, not a force; the beam's motion is relative to
      !> the base.
      logical :: is_base = .false.
      !> position of the force [length]; not allocated: x_F of the structure
      real(wp), allocatable :: x_F
      !> > 0: free motion; the excitation is unknown, and this number of the lowest modes has an
      !> arbitrary amplitude and phase at the first sample
      integer :: modes = 0
   contains
      procedure :: force, base, kinks, set_amplitude, fit_to, size_scale
   end type excitation_t

contains

   !> Returns a rectangular pulse: the constant force of a thruster for 0 <= t <= duration.
   !>
   !> amplitude  force [force]
   !> duration   duration, > 0 [time]
   pure function new_pulse(amplitude, duration) result(excitation)
      real(wp), intent(in) :: amplitude, duration
      type(excitation_t) :: excitation

      excitation%t = [0.0_wp, duration]
      excitation%shape = [1.0_wp, 1.0_wp]
      call excitation%set_amplitude(amplitude)
   end function new_pulse

   !> Returns a release: the beam is deflected statically at x_F and released. The motion relative
   !> to the deflected shape is the response to the step force -F.
   !>
   !> amplitude        static force [force], or static displacement at x_F [length]
   !> time             time of the release [time]
   !> by_displacement  .true.: the amplitude is a displacement
   pure function new_release(amplitude, time, by_displacement) result(excitation)
      real(wp), intent(in) :: amplitude, time
      logical, intent(in) :: by_displacement
      type(excitation_t) :: excitation
      real(wp), parameter :: for_ever = 1e30_wp

      excitation%t = [time, for_ever]
      excitation%shape = [-1.0_wp, -1.0_wp]
      excitation%is_release = .true.
      excitation%by_displacement = by_displacement
      call excitation%set_amplitude(amplitude)
   end function new_release

   !> Returns a free motion: the state at the first sample is unknown.
   !>
   !> modes  number of the lowest modes that move at the first sample, >= 1
   pure function new_free(modes) result(excitation)
      integer, intent(in) :: modes
      type(excitation_t) :: excitation

      excitation = new_pulse(0.0_wp, 1.0_wp)
      excitation%modes = modes
   end function new_free

   !> Computes the static force of a release whose displacement is given; other excitations are
   !> unchanged.
   !>
   !> stiffness  static stiffness at the position of the force [force/length]
   pure subroutine fit_to(self, stiffness)
      class(excitation_t), intent(inout) :: self
      real(wp), intent(in) :: stiffness

      if (self%by_displacement) self%f = self%amplitude*stiffness*self%shape
   end subroutine fit_to

   !> Sets the amplitude and scales f accordingly.
   pure subroutine set_amplitude(self, amplitude)
      class(excitation_t), intent(inout) :: self
      real(wp), intent(in) :: amplitude

      self%amplitude = amplitude
      self%f = amplitude*self%shape
   end subroutine set_amplitude

   !> Makes an excitation from a force given by a table.
   !>
   !> t, f        (nodes) times [time] and forces [force]
   !> excitation  the result; unchanged if there is an error
   !> error       fewer than two nodes, a negative first time or times that do not increase
   pure subroutine new_force_table(t, f, excitation, error)
      real(wp), intent(in) :: t(:), f(:)
      type(excitation_t), intent(inout) :: excitation
      type(error_t), allocatable, intent(out) :: error

      if (size(t) < 2) then
         call bad_input(error, 'found '//to_text(size(t))//' rows, expected 2 or more')
      else if (t(1) < 0) then
         call bad_input(error, 'found a first time of '//to_text(t(1))//', expected 0 or later')
      else if (any(t(2:) <= t(:size(t) - 1))) then
         call bad_input(error, 'found times that do not increase')
      else
         excitation = excitation_t()
         excitation%t = t
         excitation%shape = f
         call excitation%set_amplitude(1.0_wp)
      end if
   end subroutine new_force_table

   !> Makes an excitation from a table of accelerations of the base, which is at rest at the first
   !> node.
   !>
   !> t, f        (nodes) times [time] and accelerations [length/time**2]
   !> excitation  the result
   !> error       the same errors as of `new_force_table`
   pure subroutine new_base_motion(t, f, excitation, error)
      real(wp), intent(in) :: t(:), f(:)
      type(excitation_t), intent(inout) :: excitation
      type(error_t), allocatable, intent(out) :: error

      call new_force_table(t, f, excitation, error)
      excitation%is_base = .true.
   end subroutine new_base_motion

   !> Returns displacement, velocity and acceleration of the base; the first two by exact
   !> integration of the piecewise linear acceleration.
   !>
   !> times   (samples) ascending [time]
   !> motion  (samples, 3) displacement [length], velocity [length/time] and acceleration
   !>         [length/time**2]; 0 if the base does not move
   pure function base(self, times) result(motion)
      class(excitation_t), intent(in) :: self
      real(wp), intent(in) :: times(:)
      real(wp) :: motion(size(times), 3)
      real(wp) :: z, v, rate
      integer :: k, node

      motion = 0
      if (.not. self%is_base) return
      z = 0
      v = 0
      node = 1
      associate (t => self%t, f => self%f)
         do k = 1, size(times)
            do while (node < size(t))
               if (t(node + 1) > times(k)) exit
               call advance(t(node + 1) - t(node), f(node), f(node + 1), z, v)
               node = node + 1
            end do
            if (times(k) < t(1)) cycle
            motion(k, :) = [z, v, self%force(times(k))]
            rate = 0
            if (node < size(t)) rate = f(node)
            associate (last => merge(motion(k, 3), 0.0_wp, node < size(t)))
               call advance(times(k) - t(node), rate, last, motion(k, 1), motion(k, 2))
            end associate
         end do
      end associate
   end function base

   !> Advances displacement z and velocity v by one time step in which the acceleration changes
   !> linearly from `first` to `last`.
   pure subroutine advance(step, first, last, z, v)
      real(wp), intent(in) :: step, first, last
      real(wp), intent(inout) :: z, v

      z = z + step*(v + step*(2*first + last)/6)
      v = v + step*(first + last)/2
   end subroutine advance

   !> Returns f(t) [force]. The interval is closed, as in the paper: f(duration) of a pulse is still
   !> the amplitude, even if t exceeds the duration by round-off.
   elemental real(wp) function force(self, t)
      class(excitation_t), intent(in) :: self
      real(wp), intent(in) :: t
      integer :: low, high, middle

      force = 0
      associate (nodes => self%t, f => self%f)
         low = 1
         high = size(nodes)
         if (t < nodes(low) .or. t > nodes(high) + same_time*spacing(nodes(high))) return
         ! In a uniform table, and most are uniform, the interval is near `middle`.
         middle = 1 + int((t - nodes(low))/(nodes(high) - nodes(low))*(high - 1))
         middle = max(low, min(middle, high))
         if (nodes(max(low, middle - 1)) <= t) low = max(low, middle - 1)
         if (t < nodes(min(high, middle + 2))) high = min(high, middle + 2)
         do while (high - low > 1)
            middle = (low + high)/2
            if (t < nodes(middle)) then
               high = middle
            else
               low = middle
            end if
         end do
         force = f(low) + (f(high) - f(low))* &
            min(1.0_wp, (t - nodes(low))/(nodes(high) - nodes(low)))
      end associate
   end function force

   !> Returns for each node but the first (nodes) whether an integrator should restart there: the
   !> force jumps, or its slope by more than a tenth of the largest slope. The kinks of a smooth
   !> force that was sampled are smaller, and a restart would cost more steps than they do.
   pure function kinks(self)
      class(excitation_t), intent(in) :: self
      logical :: kinks(size(self%t))
      real(wp), parameter :: small = 0.1_wp
      real(wp) :: slope(0:size(self%t))
      integer :: n

      n = size(self%t)
      slope = 0
      associate (t => self%t, f => self%f)
         slope(1:n - 1) = (f(2:) - f(:n - 1))/(t(2:) - t(:n - 1))
         kinks = abs(slope(1:) - slope(:n - 1)) > small*maxval(abs(slope))
         kinks(1) = .false.
         ! An integrator cannot start where it has to stop at once.
         where (t(2:) - t(:n - 1) <= same_time*spacing(t(2:))) kinks(:n - 1) = .false.
         if (n > 1) kinks(n) = kinks(n) .or. abs(f(n)) > 0
      end associate
   end function kinks

   !> Estimates the size of the displacement that the force causes in an oscillator [length]: the
   !> smaller of the static deflection under the peak force and the amplitude after an impulsive
   !> force of the same impulse.
   !>
   !> stiffness  stiffness of the oscillator [force/length]
   !> omega      natural angular frequency of the oscillator [1/time]
   pure real(wp) function size_scale(self, stiffness, omega)
      class(excitation_t), intent(in) :: self
      real(wp), intent(in) :: stiffness, omega
      real(wp) :: impulse
      integer :: m

      m = size(self%t)
      impulse = sum((abs(self%f(2:)) + abs(self%f(:m - 1)))/2*(self%t(2:) - self%t(:m - 1)))
      size_scale = min(maxval(abs(self%f)), impulse*omega)/stiffness
   end function size_scale

end module beamid_excitation
