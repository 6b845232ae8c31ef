!> What becomes of the errors of a computed motion in the tip acceleration, by each of the formulas
!> (4.1), (4.2) and (3.13).
!>
!> A mode that the motion contains with an error of size a and frequency omega is in error by
!> omega**2 a in (3.13). The differences measure instead, with x = omega Delta/2,
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

   !> (4.1), (4.2), (3.13)
   integer, parameter :: formulas = 3

   !> How far one response is from another at some samples, by each formula.
   type :: deviation_t
      real(wp) :: rms(formulas) = 0     !< [length/time**2]
      real(wp) :: worst(formulas) = 0   !< the largest [length/time**2]
      real(wp) :: exact(formulas) = 0   !< rms of the exact one [length/time**2]
      real(wp) :: displacement = 0      !< rms [length]
      real(wp) :: exact_displacement = 0   !< rms of the exact one [length]
   end type deviation_t

contains

   !> Times at which all three formulas can be computed from one response.
   !>
   !> samples  ascending [time]
   !> delta    Delta of (4.1) and (4.2) [time]
   pure function formula_times(samples, delta) result(times)
      real(wp), intent(in) :: samples(:), delta
      real(wp), allocatable :: times(:)
      type(sampling_t) :: whole, half

      whole = new_sampling(observation_t(from_displacement, delta), samples)
      half = new_sampling(observation_t(from_displacement, delta/2), whole%times)
      times = half%times
   end function formula_times

   !> Compares two responses at `formula_times`.
   pure function measure(computed, exact, samples, delta) result(deviation)
      type(response_t), intent(in) :: computed, exact
      real(wp), intent(in) :: samples(:), delta
      type(deviation_t) :: deviation
      real(wp), dimension(size(samples)) :: a, b
      type(sampling_t) :: sampling
      type(response_t) :: seen
      integer :: k

      do k = 1, formulas
         sampling = new_sampling(observation_t(k, delta), samples)
         a = sampling%acceleration(picked(computed, sampling%times))
         b = sampling%acceleration(picked(exact, sampling%times))
         deviation%rms(k) = rms(a - b)
         deviation%worst(k) = maxval(abs(a - b))
         deviation%exact(k) = rms(b)
      end do
      seen = picked(computed, samples)
      a = seen%displacement
      seen = picked(exact, samples)
      deviation%displacement = rms(a - seen%displacement)
      deviation%exact_displacement = rms(seen%displacement)
   end function measure

   !> Root of the mean square.
   pure real(wp) function rms(values)
      real(wp), intent(in) :: values(:)

      rms = norm2(values)/sqrt(real(size(values), wp))
   end function rms

   !> A response at some of its times; round-off apart, it has them all.
   pure function picked(response, times) result(few)
      type(response_t), intent(in) :: response
      real(wp), intent(in) :: times(:)
      type(response_t) :: few
      integer :: place(size(times)), k

      do k = 1, size(times)
         place(k) = minloc(abs(response%t - times(k)), dim=1)
      end do
      few%t = response%t(place)
      few%displacement = response%displacement(place)
      few%velocity = response%velocity(place)
      few%acceleration = response%acceleration(place)
   end function picked

   !> Acceleration that each formula sees of a mode of unit displacement.
   !>
   !> omega  [1/time]
   !> delta  [time]
   pure function gains(omega, delta) result(values)
      real(wp), intent(in) :: omega, delta
      real(wp) :: values(formulas)

      values = [(2*sin(omega*delta/2)/delta)**2, 2*omega*abs(sin(omega*delta/2))/delta, omega**2]
   end function gains

   !> For each undamped mode x of a structure the observer of its share in the motion of the tip,
   !> (tip'x) M x: the shares add up to the tip's motion.
   !>
   !> omega      (n) ascending [1/time]
   !> observers  (n, n), a column for each mode
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

   !> tip'M**-1 K, which (3.13) applies to the displacements, for unknowns in units of displacement:
   !> the sum of its absolute values is what errors of one unit in every unknown can become.
   !>
   !> row  (n) [1/time**2]
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
