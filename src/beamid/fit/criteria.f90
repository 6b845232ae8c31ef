!> Computes criteria for the comparison of models that were fitted to the same record: information
!> criteria, the misfit of several records, and the test of a model that is a special case of
!> another.
module beamid_criteria
   use beamid_distributions, only: chi_square_tail
   use beamid_kinds, only: wp
   implicit none
   private

   public :: aicc, bic, misfit_of_records, nested_test

contains

   !> Returns Akaike's information criterion with the correction for few samples (AICc),
   !> m ln(J/m) + 2 k + 2 k (k + 1)/(m - k - 1), with k = parameters + 1 for the noise variance. If
   !> the noise is known, it is J + 2 k with k = parameters, without a correction (Burnham and
   !> Anderson, Model Selection and Multimodel Inference, 2nd edition, section 2.2).
   !>
   !> J           sum of squares of the residuals; in units of the variance of the noise if that is
   !>             known
   !> samples     m
   !> parameters  number of fitted parameters
   !> is_known    whether the noise is known; default .false.
   !> value       huge if m <= k + 1 and the noise is not known
   pure real(wp) function aicc(J, samples, parameters, is_known) result(value)
      real(wp), intent(in) :: J
      integer, intent(in) :: samples, parameters
      logical, intent(in), optional :: is_known
      integer :: k

      if (is_true(is_known)) then
         value = J + 2*parameters
         return
      end if
      k = parameters + 1
      value = samples*log(J/samples) + 2*k
      if (samples > k + 1) then
         value = value + 2.0_wp*k*(k + 1)/(samples - k - 1)
      else
         value = huge(value)
      end if
   end function aicc

   !> Returns Schwarz's Bayesian information criterion (BIC), m ln(J/m) + k ln m, with
   !> k = parameters + 1. If the noise is known, it is J + k ln m with k = parameters. The arguments
   !> are as in `aicc`.
   pure real(wp) function bic(J, samples, parameters, is_known) result(value)
      real(wp), intent(in) :: J
      integer, intent(in) :: samples, parameters
      logical, intent(in), optional :: is_known

      if (is_true(is_known)) then
         value = J + parameters*log(real(samples, wp))
      else
         value = samples*log(J/samples) + (parameters + 1)*log(real(samples, wp))
      end if
   end function bic

   !> Returns an optional switch; .false. if it is absent.
   pure logical function is_true(switch)
      logical, intent(in), optional :: switch

      is_true = .false.
      if (present(switch)) is_true = switch
   end function is_true

   !> Tests restrictions on a model (Banks and Fitzpatrick): U = m (J_restricted - J_full)/J_full is
   !> compared with chi-square with as many degrees of freedom as there are restrictions. If the
   !> noise is known, U = J_restricted - J_full.
   !>
   !> J_restricted, J_full  sums of squares with and without the restrictions, as in `aicc`
   !> samples               m
   !> restrictions          number of restrictions
   !> U                     test statistic
   !> probability           of a U at least as large if the restrictions hold
   !> is_known              as in `aicc`
   pure subroutine nested_test(J_restricted, J_full, samples, restrictions, U, probability, &
      is_known)
      real(wp), intent(in) :: J_restricted, J_full
      integer, intent(in) :: samples, restrictions
      real(wp), intent(out) :: U, probability
      logical, intent(in), optional :: is_known

      U = J_restricted - J_full
      if (.not. is_true(is_known)) U = samples*U/J_full
      probability = chi_square_tail(U, real(restrictions, wp))
   end subroutine nested_test

   !> Returns the quantity that replaces J if the noise levels of several records are estimated from
   !> the fit itself, so that the weighted J carries no information: m times the weighted geometric
   !> mean of the residual variances of the records, m being the number of all samples.
   !>
   !> residual  (m) without weights
   !> samples   (records) number of samples of each record, in order
   pure real(wp) function misfit_of_records(residual, samples) result(J)
      real(wp), intent(in) :: residual(:)
      integer, intent(in) :: samples(:)
      real(wp) :: likelihood
      integer :: k, row

      likelihood = 0
      row = 0
      do k = 1, size(samples)
         associate (m => samples(k))
            likelihood = likelihood + m*log(max(tiny(J), sum(residual(row + 1:row + m)**2)/m))
            row = row + m
         end associate
      end do
      J = row*exp(likelihood/row)
   end function misfit_of_records

end module beamid_criteria
