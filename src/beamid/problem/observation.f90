!> Observation formulas: the acceleration that the model predicts for the accelerometer.
!>
!> Section 4 has three formulas. Each one turns the computed motion of the sensor into accelerations
!> at the sample times.
module beamid_observation
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_responses, only: response_t
   implicit none
   private

   public :: observation_t, sampling_t, new_sampling

   !> The observation formulas: second differences of displacements (4.1), first differences of
   !> velocities (4.2), and the acceleration itself (3.13). The number of a formula is also the
   !> number of the motion that it uses: 1 displacement, 2 velocity, 3 acceleration.
   integer, parameter, public :: from_displacement = 1, from_velocity = 2, from_acceleration = 3

   !> An observation formula and its settings.
   type :: observation_t
      integer :: formula = from_acceleration   !< one of the three formulas above
      !> time step Delta of (4.1) and (4.2) [time]; > 0 with these formulas, unused with (3.13)
      real(wp) :: delta = 0
      !> .true.: the sensor measures motion relative to a moving base; .false.: absolute motion
      logical :: relative = .false.
   end type observation_t

   !> The sample times of a record, and the response times that the observation formula needs for
   !> them.
   type :: sampling_t
      real(wp), allocatable :: sample_times(:)   !< (m) ascending [time]
      real(wp), allocatable :: times(:)          !< (n) response times, ascending [time]
      type(observation_t) :: observation
      !> (points, m) index in `times` of each point of the formula, for each sample; points is 3 for
      !> the difference formulas, else 1
      integer, allocatable, private :: place(:, :)
   contains
      procedure :: acceleration
      procedure :: seen
      procedure :: of_base
      procedure :: of_motion
      procedure :: at_samples
      procedure :: middle
   end type sampling_t

contains

   !> Returns the response times that an observation formula needs for given sample times.
   !>
   !> Merges the shifted copies of the sample times into one ascending list. Two times that differ
   !> only by round-off, such as t + Delta of one sample and t - Delta of another, become one time.
   !>
   !> sample_times  (m) ascending [time]
   pure function new_sampling(observation, sample_times) result(self)
      type(observation_t), intent(in) :: observation
      real(wp), intent(in) :: sample_times(:)
      type(sampling_t) :: self
      real(wp), allocatable :: offsets(:), times(:)
      integer, allocatable :: next_sample(:)
      real(wp) :: time, round_off
      integer :: m, points, k, total

      ! Points of the formula relative to the sample; the middle point is the sample itself.
      select case (observation%formula)
      case (from_displacement)
         offsets = observation%delta*[-1.0_wp, 0.0_wp, 1.0_wp]
      case (from_velocity)
         offsets = observation%delta*[-0.5_wp, 0.0_wp, 0.5_wp]
      case default
         offsets = [0.0_wp]
      end select
      m = size(sample_times)
      points = size(offsets)
      self%observation = observation
      self%sample_times = sample_times
      allocate (self%place(points, m), times(points*m), next_sample(points))
      round_off = 0
      if (m > 0) round_off = 64*epsilon(round_off)*maxval(abs(sample_times))
      next_sample = 1
      total = 0
      do while (any(next_sample <= m))
         time = huge(time)
         do k = 1, points
            if (next_sample(k) <= m) time = min(time, sample_times(next_sample(k)) + offsets(k))
         end do
         total = total + 1
         times(total) = time
         do k = 1, points
            do while (next_sample(k) <= m)
               if (sample_times(next_sample(k)) + offsets(k) > time + round_off) exit
               self%place(k, next_sample(k)) = total
               next_sample(k) = next_sample(k) + 1
            end do
         end do
      end do
      self%times = times(:total)
   end function new_sampling

   !> Returns the observed acceleration at the samples [length/time**2].
   !>
   !> With every formula, a sensor that is tilted by the slope of the beam also reads a component of
   !> gravity (`response%tilt`).
   !>
   !> response    motion of the sensor at `times`
   !> excitation  excitation whose base motion is added; if it is absent, the result is that of the
   !>             response alone
   pure function acceleration(self, response, excitation) result(a)
      class(sampling_t), intent(in) :: self
      type(response_t), intent(in) :: response
      type(excitation_t), intent(in), optional :: excitation
      real(wp) :: a(size(self%sample_times))

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

   !> Returns the acceleration that a moving base adds at the samples (m) [length/time**2]; 0 if the
   !> sensor measures relative motion.
   pure function of_base(self, excitation) result(a)
      class(sampling_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation
      real(wp) :: a(size(self%sample_times)), base(size(self%times), 3)

      a = 0
      if (self%observation%relative .or. .not. excitation%is_base) return
      base = excitation%base(self%times)
      a = self%of_motion(base(:, self%observation%formula))
   end function of_base

   !> Returns the response, plus the motion of the base if the sensor measures absolute motion.
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

   !> Applies the observation formula, without gravity and base motion.
   !>
   !> motion  (n) displacement, velocity or acceleration at `times`, as the formula needs
   !> a       (m) acceleration at the samples [length/time**2]
   pure function of_motion(self, motion) result(a)
      class(sampling_t), intent(in) :: self
      real(wp), intent(in), contiguous :: motion(:)
      real(wp) :: a(size(self%sample_times))

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

   !> Returns the index in `times` of each sample (m).
   pure function middle(self)
      class(sampling_t), intent(in) :: self
      integer :: middle(size(self%sample_times))

      middle = self%place((size(self%place, 1) + 1)/2, :)
   end function middle

   !> Returns the response at the samples alone, without its tilt.
   pure function at_samples(self, response) result(reduced)
      class(sampling_t), intent(in) :: self
      type(response_t), intent(in) :: response
      type(response_t) :: reduced

      associate (middle => self%middle())
         reduced%t = self%sample_times
         reduced%displacement = response%displacement(middle)
         reduced%velocity = response%velocity(middle)
         reduced%acceleration = response%acceleration(middle)
      end associate
   end function at_samples

end module beamid_observation
