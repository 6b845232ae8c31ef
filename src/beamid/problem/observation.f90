!> Tip acceleration as the accelerometer's model sees it: the three formulas of Section 4.
module beamid_observation
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_responses, only: response_t
   implicit none
   private

   public :: observation_t, sampling_t, new_sampling

   !> The formulas: second differences of displacements (4.1), first differences of velocities
   !> (4.2), accelerations (3.13). The number is that of the motion that the formula uses.
   integer, parameter, public :: from_displacement = 1, from_velocity = 2, from_acceleration = 3

   type :: observation_t
      integer :: formula = from_acceleration
      real(wp) :: delta = 0           !< Delta of (4.1) and (4.2) [time], > 0 there
      logical :: relative = .false.   !< to a base that moves
   end type observation_t

   !> Sample times together with the response times that the formula needs for them.
   type :: sampling_t
      real(wp), allocatable :: samples(:)            !< (m) ascending [time]
      real(wp), allocatable :: times(:)              !< ascending, no two alike [time]
      type(observation_t) :: observation
      integer, allocatable, private :: place(:, :)   !< (points, m) where in `times` each point lies
   contains
      procedure :: acceleration
      procedure :: seen
      procedure :: of_base
      procedure :: of_motion
      procedure :: at_samples
      procedure :: middle
   end type sampling_t

contains

   !> Merges the shifted copies of the sample times into one ascending list. Times that differ only
   !> by round-off, as t + Delta of one sample and t - Delta of another do, become one.
   !>
   !> samples  (m) ascending [time]
   pure function new_sampling(observation, samples) result(self)
      type(observation_t), intent(in) :: observation
      real(wp), intent(in) :: samples(:)
      type(sampling_t) :: self
      real(wp), allocatable :: offsets(:), times(:)
      integer, allocatable :: next(:)
      real(wp) :: t, same
      integer :: m, points, k, total

      ! From each sample; the sample itself is always in the middle.
      select case (observation%formula)
      case (from_displacement)
         offsets = observation%delta*[-1.0_wp, 0.0_wp, 1.0_wp]
      case (from_velocity)
         offsets = observation%delta*[-0.5_wp, 0.0_wp, 0.5_wp]
      case default
         offsets = [0.0_wp]
      end select
      m = size(samples)
      points = size(offsets)
      self%observation = observation
      self%samples = samples
      allocate (self%place(points, m), times(points*m), next(points))
      same = 0
      if (m > 0) same = 64*epsilon(same)*maxval(abs(samples))
      next = 1
      total = 0
      do while (any(next <= m))
         t = minval(samples(min(next, m)) + offsets, mask=next <= m)
         total = total + 1
         times(total) = t
         do k = 1, points
            do while (next(k) <= m)
               if (samples(next(k)) + offsets(k) > t + same) exit
               self%place(k, next(k)) = total
               next(k) = next(k) + 1
            end do
         end do
      end do
      self%times = times(:total)
   end function new_sampling

   !> Acceleration at the samples (m) from the response at `times` [length/time**2]; whatever the
   !> formula, a sensor that turns reads a share of gravity.
   !>
   !> excitation  of a base whose motion is seen too; left out: of the response alone
   pure function acceleration(self, response, excitation) result(a)
      class(sampling_t), intent(in) :: self
      type(response_t), intent(in) :: response
      type(excitation_t), intent(in), optional :: excitation
      real(wp) :: a(size(self%samples))

      select case (self%observation%formula)
      case (from_displacement)
         a = self%of_motion(response%displacement)
      case (from_velocity)
         a = self%of_motion(response%velocity)
      case default
         a = self%of_motion(response%acceleration)
      end select
      if (allocated(response%tilt)) a = a + response%tilt(self%middle())
      if (present(excitation)) a = a + self%of_base(excitation)
   end function acceleration

   !> What a base that moves adds at the samples (m); nothing to a motion relative to it.
   pure function of_base(self, excitation) result(a)
      class(sampling_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation
      real(wp) :: a(size(self%samples)), base(size(self%times), 3)

      a = 0
      if (self%observation%relative .or. .not. excitation%is_base) return
      base = excitation%base(self%times)
      a = self%of_motion(base(:, self%observation%formula))
   end function of_base

   !> The response as the sensor sees it, with the motion of the base where it is absolute.
   pure function seen(self, response, excitation) result(absolute)
      class(sampling_t), intent(in) :: self
      type(response_t), intent(in) :: response
      type(excitation_t), intent(in) :: excitation
      type(response_t) :: absolute
      real(wp) :: base(size(response%t), 3)

      absolute = response
      if (self%observation%relative .or. .not. excitation%is_base) return
      base = excitation%base(response%t)
      absolute%displacement = response%displacement + base(:, 1)
      absolute%velocity = response%velocity + base(:, 2)
      absolute%acceleration = response%acceleration + base(:, 3)
   end function seen

   !> Acceleration at the samples from the motion that the formula uses.
   pure function of_motion(self, motion) result(a)
      class(sampling_t), intent(in) :: self
      real(wp), intent(in) :: motion(:)
      real(wp) :: a(size(self%samples))

      associate (place => self%place, delta => self%observation%delta)
         select case (self%observation%formula)
         case (from_displacement)
            a = (motion(place(3, :)) - 2*motion(place(2, :)) + motion(place(1, :)))/delta**2
         case (from_velocity)
            a = (motion(place(3, :)) - motion(place(1, :)))/delta
         case default
            a = motion(place(1, :))
         end select
      end associate
   end function of_motion

   !> Where in `times` the samples themselves are.
   pure function middle(self)
      class(sampling_t), intent(in) :: self
      integer :: middle(size(self%samples))

      middle = self%place((size(self%place, 1) + 1)/2, :)
   end function middle

   !> The response at the samples alone.
   pure function at_samples(self, response) result(narrow)
      class(sampling_t), intent(in) :: self
      type(response_t), intent(in) :: response
      type(response_t) :: narrow

      associate (middle => self%middle())
         narrow%t = self%samples
         narrow%displacement = response%displacement(middle)
         narrow%velocity = response%velocity(middle)
         narrow%acceleration = response%acceleration(middle)
      end associate
   end function at_samples

end module beamid_observation
