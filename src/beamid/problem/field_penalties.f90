!> Smoothness penalties on E(x) and c_D(x).
!>
!> Each field along the beam is a sum over B-splines with positive coefficients. A penalty adds one
!> row to the residuals for each difference of the logarithms of neighbouring coefficients.
module beamid_field_penalties
   implicit none
   private

   public :: penalty_count

   !> Number of fields that a fit may estimate: E(x) is field 1, c_D(x) is field 2.
   integer, parameter, public :: fields = 2

   !> Order of the penalised differences.
   integer, parameter, public :: penalty_order = 1

contains

   !> Returns the number of rows of a penalty.
   !>
   !> coefficients  number of free coefficients of the field; 0 if the field is not free
   pure integer function penalty_count(coefficients)
      integer, intent(in) :: coefficients

      penalty_count = max(0, coefficients - penalty_order)
   end function penalty_count

end module beamid_field_penalties
