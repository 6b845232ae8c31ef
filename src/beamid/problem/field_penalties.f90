!> Smoothness penalties on E(x) and c_D(x).
!>
!> Each field along the beam is a sum over B-splines with positive coefficients. A penalty adds one
!> row to the residuals for each difference of the logarithms of neighbouring coefficients.
module beamid_field_penalties
   use beamid_kinds, only: wp
   implicit none
   private

   public :: add_penalty_rows, penalty_count

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

   !> Computes the rows of one penalty, and their derivatives as far as `jac` has columns.
   !>
   !> differences  (rows, coefficients) matrix of differences, with its weight
   !> columns      (coefficients) indices of the coefficients among the parameters
   !> parameters   (n)
   !> r            (rows)
   !> jac          (rows, n or more), 0 on entry; or (rows, 0)
   pure subroutine add_penalty_rows(differences, columns, parameters, r, jac)
      real(wp), intent(in) :: differences(:, :), parameters(:)
      integer, intent(in) :: columns(:)
      real(wp), intent(inout) :: r(:), jac(:, :)
      integer :: k

      r = matmul(differences, log(parameters(columns)))
      if (size(jac, 2) == 0) return
      do k = 1, size(columns)
         jac(:, columns(k)) = differences(:, k)/parameters(columns(k))
      end do
   end subroutine add_penalty_rows

end module beamid_field_penalties
