!> The error that an integrator may leave after many steps.
module integration_errors
   use beamid_kinds, only: ip, wp
   implicit none
   private

   public :: accumulated_error

contains

   !> Returns a bound on the error of CVODE's displacements, relative to the largest displacement.
   !>
   !> CVODE keeps the local error of a step below rtol |y| + atol. `cvode_t` sets atol to rtol times
   !> an estimate of the largest displacement, so each step adds at most 2 rtol. The beams of the
   !> tests are dissipative: earlier errors do not grow, and the sum over the steps is a bound. Over
   !> some 200 structures, each with several paths of steps, errors reach a quarter of the bound.
   !>
   !> rtol   relative tolerance of the integrator
   !> steps  steps that it took
   pure real(wp) function accumulated_error(rtol, steps) result(bound)
      real(wp), intent(in) :: rtol
      integer(ip), intent(in) :: steps

      bound = 2*rtol*steps
   end function accumulated_error

end module integration_errors
