!> The error that an integrator may leave after many steps.
module integration_errors
   use beamid_kinds, only: ip, wp
   implicit none
   private

   public :: accumulated_error

contains

   !> Returns an estimate of the largest error of CVODE's displacements, relative to the largest
   !> displacement.
   !>
   !> CVODE keeps the root mean square of the local errors of a step, each relative to
   !> rtol |y| + atol, below 1. `cvode_t` sets atol to rtol times an estimate of the largest
   !> displacement, so a step adds 2 rtol. The beams of the tests are dissipative: earlier errors do
   !> not grow, and add up over the steps at most. One component may err by more than the root mean
   !> square; errors of different signs cancel. Over some 200 structures, each with several paths of
   !> steps, errors reach a quarter of the estimate. The exact solver is compared more sharply, with
   !> references in quadruple precision.
   !>
   !> rtol   relative tolerance of the integrator
   !> steps  steps that it took
   pure real(wp) function accumulated_error(rtol, steps) result(bound)
      real(wp), intent(in) :: rtol
      integer(ip), intent(in) :: steps

      bound = 2*rtol*steps
   end function accumulated_error

end module integration_errors
