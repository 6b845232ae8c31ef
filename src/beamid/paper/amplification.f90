!> How errors of a computed motion are amplified in the tip acceleration by each of the formulas
!> (4.1), (4.2) and (3.13).
!>
!> An error of amplitude a in a mode of circular frequency omega causes an acceleration error of
!> omega**2 a in (3.13). In the difference formulas it is, with x = omega Delta/2,
!>
!>     (4.1)  omega**2 (sin x/x)**2 a = 4 sin(x)**2/Delta**2 a,
!>     (4.2)  omega**2 |sin x|/x a    = 2 omega |sin x|/Delta a.
module beamid_amplification
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_modes, only: undamped_modes
   use beamid_observation, only: from_displacement, new_sampling, observation_t, sampling_t
   use beamid_responses, only: response_t
   implicit none
   private

   public :: deviation_t, formula_times, measure, gains, mode_observers, equation_row

   !> Number of formulas: (4.1), (4.2) and (3.13), in this order.
   integer, parameter :: formulas = 3

   !> Deviation of a computed response from the exact one at the samples, by each formula.
   type :: deviation_t
      real(wp) :: rms(formulas) = 0     !< rms of the acceleration error [length/time**2]
      real(wp) :: worst(formulas) = 0   !< largest acceleration error [length/time**2]
      real(wp) :: exact(formulas) = 0   !< rms of the exact acceleration [length/time**2]
      real(wp) :: displacement = 0      !< rms of the displacement error [length]
      real(wp) :: exact_displacement = 0   !< rms of the exact displacement [length]
   end type deviation_t

contains

   !> Returns the times that a response must have for all three formulas.
   !>
   !> samples  (m) ascending sample times [time]
   !> delta    time step Delta of (4.1) and (4.2) [time]
   pure function formula_times(samples, delta) result(times)
      real(wp), intent(in) :: samples(:), delta
      real(wp), allocatable :: times(:)
      type(sampling_t) :: whole, half

      whole = new_sampling(observation_t(from_displacement, delta), samples)
      half = new_sampling(observation_t(from_displacement, delta/2), whole%times)
      times = half%times
   end function formula_times

   !> Compares two responses by each formula.
   !>
   !> computed, exact  at the times that `formula_times` returns
   !> samples          (m) ascending sample times [time]
   !> delta            time step Delta of (4.1) and (4.2) [time]
   pure function measure(computed, exact, samples, delta) result(deviation)
      type(response_t), intent(in) :: computed, exact
      real(wp), intent(in) :: samples(:), delta
      type(deviation_t) :: deviation
      real(wp), dimension(size(samples)) :: a, b
      type(sampling_t) :: sampling
      type(response_t) :: sampled
      integer :: k

      do k = 1, formulas
         sampling = new_sampling(observation_t(k, delta), samples)
         a = sampling%acceleration(at_times(computed, sampling%times))
         b = sampling%acceleration(at_times(exact, sampling%times))
         deviation%rms(k) = rms(a - b)
         deviation%worst(k) = maxval(abs(a - b))
         deviation%exact(k) = rms(b)
      end do
      sampled = at_times(computed, samples)
      a = sampled%displacement
      sampled = at_times(exact, samples)
      deviation%displacement = rms(a - sampled%displacement)
      deviation%exact_displacement = rms(sampled%displacement)
   end function measure

   !> Returns the root mean square.
   pure real(wp) function rms(values)
      real(wp), intent(in) :: values(:)

      rms = norm2(values)/sqrt(real(size(values), wp))
   end function rms

   !> Returns a response at some of its times.
   !>
   !> times  each of them, up to round-off, is a time of the response [time]
   pure function at_times(response, times) result(part)
      type(response_t), intent(in) :: response
      real(wp), intent(in) :: times(:)
      type(response_t) :: part
      integer :: place(size(times)), k

      do k = 1, size(times)
         place(k) = minloc(abs(response%t - times(k)), dim=1)
      end do
      part%t = response%t(place)
      part%displacement = response%displacement(place)
      part%velocity = response%velocity(place)
      part%acceleration = response%acceleration(place)
   end function at_times

   !> Returns the acceleration amplitude that each formula gives a mode of unit displacement.
   !>
   !> omega  circular frequency of the mode [1/time]
   !> delta  time step Delta of (4.1) and (4.2) [time]
   pure function gains(omega, delta) result(values)
      real(wp), intent(in) :: omega, delta
      real(wp) :: values(formulas)

      values = [(2*sin(omega*delta/2)/delta)**2, 2*omega*abs(sin(omega*delta/2))/delta, omega**2]
   end function gains

   !> Computes for each undamped mode x of a structure the observer vector of its share in the
   !> motion of the tip, (tip'x) M x. The shares of all modes add up to the motion of the tip.
   !>
   !> omega      (n) circular frequencies, ascending [1/time]
   !> observers  (n, n) one column for each mode
   !> error      modes that cannot be found
   subroutine mode_observers(equations, omega, observers, error)
      type(equations_t), intent(in) :: equations
      real(wp), allocatable, intent(out) :: omega(:), observers(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: shapes(:, :)
      integer :: k

      call undamped_modes(equations, omega, shapes, error)
      if (allocated(error)) return
      allocate (observers, mold=shapes)
      do k = 1, size(omega)
         observers(:, k) = dot_product(equations%tip, shapes(:, k)) &
            *equations%mass%times(shapes(:, k))
      end do
   end subroutine mode_observers

   !> Computes tip'M**-1 K, the row that (3.13) applies to the displacements, for unknowns in units
   !> of displacement. The sum of its absolute values bounds the acceleration error that errors of
   !> one unit in every unknown cause.
   !>
   !> row    (n) [1/time**2]
   !> error  a mass matrix that is not positive definite
   subroutine equation_row(equations, row, error)
      type(equations_t), intent(in) :: equations
      real(wp), allocatable, intent(out) :: row(:)
      type(error_t), allocatable, intent(out) :: error
      type(band_t) :: factor
      logical :: positive

      row = equations%tip
      factor = equations%mass
      call factor%factor(positive)
      if (.not. positive) then
         call failure(error, 'the mass matrix is not positive definite')
         return
      end if
      call factor%solve(row)
      row = equations%stiffness%times(row)/equations%unit
   end subroutine equation_row

end module beamid_amplification
