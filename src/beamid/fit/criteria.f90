!> Computes criteria for the comparison of models that were fitted to the same record: information
!> criteria, and the test of a model that is a special case of another.
module beamid_criteria
   use beamid_distributions, only: chi_square_tail
   use beamid_kinds, only: wp
   implicit none
   private

   public :: aicc, bic, nested_test

contains

   !> Returns Akaike's information criterion with the correction for few samples (AICc),
   !> m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), with k = parameters + 1 for the noise variance.
   !>
   !> J           sum of squares of the residuals
   !> samples     m
   !> parameters  number of fitted parameters
   !> value       huge if m <= k + 1
   pure real(wp) function aicc(J, samples, parameters) result(value)
      real(wp), intent(in) :: J
      integer, intent(in) :: samples, parameters
      integer :: k

      k = parameters + 1
      value = samples*log(J/samples) + 2*k
      if (samples > k + 1) then
         value = value + 2.0_wp*k*(k + 1)/(samples - k - 1)
      else
         value = huge(value)
      end if
   end function aicc

   !> Returns Schwarz's Bayesian information criterion (BIC), m ln(J/m) + k ln m, with
   !> k = parameters + 1. The arguments are as in `aicc`.
   pure real(wp) function bic(J, samples, parameters) result(value)
      real(wp), intent(in) :: J
      integer, intent(in) :: samples, parameters

      value = samples*log(J/samples) + (parameters + 1)*log(real(samples, wp))
   end function bic

   !> Tests restrictions on a model (Banks and Fitzpatrick): U = m (J_restricted - J_full)/J_full is
   !> compared with chi-square with as many degrees of freedom as there are restrictions.
   !>
   !> J_restricted, J_full  sums of squares with and without the restrictions
   !> samples               m
   !> restrictions          number of restrictions
   !> U                     test statistic
   !> probability           of a U at least as large if the restrictions hold
   pure subroutine nested_test(J_restricted, J_full, samples, restrictions, U, probability)
      real(wp), intent(in) :: J_restricted, J_full
      integer, intent(in) :: samples, restrictions
      real(wp), intent(out) :: U, probability

      U = samples*(J_restricted - J_full)/J_full
      probability = chi_square_tail(U, real(restrictions, wp))
   end subroutine nested_test

end module beamid_criteria
