!> What sets the beam in motion: the force of a thruster in time, the release of a tip that was held
!> aside, or something unknown before the record began.
module beamid_excitation
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   implicit none
   private

   public :: excitation_t, new_pulse, new_force_table, new_release, new_free, new_base_motion

   !> Times that differ by less than this many units in the last place are the same.
   real(wp), parameter, public :: same_time = 16

   !> f is linear between its nodes and zero outside [first node, last node]; it may jump at these
   !> two.
   type :: excitation_t
      real(wp), allocatable :: t(:)      !< nodes, strictly increasing [time]
      real(wp), allocatable :: f(:)      !< force at the nodes, amplitude*shape [force]
      real(wp), allocatable, private :: shape(:)
      real(wp) :: amplitude = 1          !< of a pulse [force]; of a table a factor
      !> .false.: the force acts at a point, (3.11). .true.: distributed, (3.10), with
      !> theta(x) = (x/l)**power.
      logical :: distributed = .false.
      real(wp) :: power = 2              !< >= 2
      !> The point is held aside by the amplitude [length]; the force follows from the stiffness.
      logical :: by_displacement = .false.
      logical :: is_release = .false.    !< f is taken away at the first node
      !> f is the acceleration of the base, relative to which the beam moves, and no force.
      logical :: is_base = .false.
      !> place where the force acts [length]; not allocated: the structure's
      real(wp), allocatable :: x_F
      !> > 0: no force is known; the motion at the first sample is any of so many modes.
      integer :: modes = 0
   contains
      procedure :: force
      procedure :: base
      procedure :: set_amplitude
      procedure :: fit_to
      procedure :: size_scale
   end type excitation_t

contains

   !> Constant force of the thruster, 0 <= t <= duration.
   !>
   !> amplitude  [force]
   !> duration   > 0 [time]
   pure function new_pulse(amplitude, duration) result(excitation)
      real(wp), intent(in) :: amplitude, duration
      type(excitation_t) :: excitation

      excitation%t = [0.0_wp, duration]
      excitation%shape = [1.0_wp, 1.0_wp]
      call excitation%set_amplitude(amplitude)
   end function new_pulse

   !> The tip is held aside and let go. The motion that follows is the answer to the step -F.
   !>
   !> amplitude        [force], or [length] of the tip's displacement
   !> time             of the release [time]
   !> by_displacement  which of the two the amplitude is
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

   !> Nothing is known about the start.
   !>
   !> modes  how many of the lowest modes move at the first sample, >= 1
   pure function new_free(modes) result(excitation)
      integer, intent(in) :: modes
      type(excitation_t) :: excitation

      excitation = new_pulse(0.0_wp, 1.0_wp)
      excitation%modes = modes
   end function new_free

   !> The force of a displacement that is given, once the structure is known.
   !>
   !> stiffness  static, where the force acts [force/length]
   pure subroutine fit_to(self, stiffness)
      class(excitation_t), intent(inout) :: self
      real(wp), intent(in) :: stiffness

      if (self%by_displacement) self%f = self%amplitude*stiffness*self%shape
   end subroutine fit_to

   !> Scales the force.
   pure subroutine set_amplitude(self, amplitude)
      class(excitation_t), intent(inout) :: self
      real(wp), intent(in) :: amplitude

      self%amplitude = amplitude
      self%f = amplitude*self%shape
   end subroutine set_amplitude

   !> A force given by nodes.
   !>
   !> t, f   nodes [time] and forces [force]
   !> error  fewer than two nodes, a negative first time or times that do not increase
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

   !> The base moves, from rest at the first node, by an acceleration that is given by nodes.
   !>
   !> t, f   nodes [time] and accelerations [length/time**2]
   !> error  as of a force table
   pure subroutine new_base_motion(t, f, excitation, error)
      real(wp), intent(in) :: t(:), f(:)
      type(excitation_t), intent(inout) :: excitation
      type(error_t), allocatable, intent(out) :: error

      call new_force_table(t, f, excitation, error)
      excitation%is_base = .true.
   end subroutine new_base_motion

   !> Displacement, velocity and acceleration of the base, by integration of its acceleration.
   !>
   !> times   ascending [time]
   !> motion  (times, 3) [length], [length/time], [length/time**2]; 0: it does not move
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

   !> One step with an acceleration that changes linearly from `first` to `last`.
   pure subroutine advance(step, first, last, z, v)
      real(wp), intent(in) :: step, first, last
      real(wp), intent(inout) :: z, v

      z = z + step*(v + step*(2*first + last)/6)
      v = v + step*(first + last)/2
   end subroutine advance

   !> f(t) [force], with the closed interval of the paper: f(duration) is still the amplitude, also
   !> where the time misses it by round-off.
   elemental real(wp) function force(self, t)
      class(excitation_t), intent(in) :: self
      real(wp), intent(in) :: t
      integer :: low, high, middle

      force = 0
      associate (nodes => self%t, f => self%f)
         low = 1
         high = size(nodes)
         if (t < nodes(low) .or. t > nodes(high) + same_time*spacing(nodes(high))) return
         ! Most tables are uniform: about there.
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

   !> Size of the displacement that the force causes in an oscillator: the smaller of what its peak
   !> does statically and what its impulse does suddenly.
   !>
   !> stiffness  [force/length]
   !> omega      angular frequency [1/time]
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
