!> Checks whether a search has ended at a minimum. MINPACK's success code is no proof: MINPACK also
!> reports success if trial steps were rejected until they were negligibly short, if a derivative is
!> wrong, or if one long step ended where parameters have no effect.
module beamid_optimality
   use beamid_errors, only: error_t
   use beamid_gauss_newton, only: gauss_newton_step, gauss_newton_t, scales_of
   use beamid_kinds, only: wp
   use beamid_problems, only: differences, error_of_differences
   use beamid_searches, only: options_t, search_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: check_minimum

   !> Largest distance to the minimum, in standard errors, that is accepted. A hundredth of a
   !> standard error is below the digits of every reported result; searches that converge end at
   !> 1e-6 or less. The error of an integrator stops a search earlier; the second limit allows for
   !> the effect of this error on an estimate.
   real(wp), parameter :: near = 1e-2_wp, near_by_integrator = 0.25_wp

   !> Decrease of J that no longer matters, in units of the variance of the noise. It corresponds to
   !> a distance of 3 % of a standard error.
   real(wp), parameter :: negligible = 1e-3_wp

contains

   !> Checks that linear theory predicts no lower minimum ahead of the estimate. Linear theory is
   !> trusted up to a change of a parameter by its own size. The check demands no more than the
   !> search can resolve: relative changes of J and of the parameters by the tolerance, and by a
   !> thousand times the relative error of an integrator, which grows along a response and in
   !> differences of it.
   !>
   !> search     on return with the parameters from which to continue, the estimate or the start
   !> start      (n) where the first search began
   !> estimate   (n) where the search has ended
   !> residual   (rows) there, condensed or not
   !> jacobian   (rows, n) there
   !> objection  the reason why the estimate is no minimum; '': none
   !> note       how far the search has stopped short of its tolerance; '': it has not
   !> error      the derivatives at the start cannot be computed
   subroutine check_minimum(search, options, start, estimate, residual, jacobian, objection, &
      note, error)
      type(search_t), intent(inout) :: search
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: start(:), estimate(:), residual(:), jacobian(:, :)
      character(len=:), allocatable, intent(out) :: objection, note
      type(error_t), allocatable, intent(out) :: error
      type(gauss_newton_t) :: ahead
      real(wp) :: scales(size(estimate)), share, gain, J, visible, variance
      integer :: k

      objection = ''
      note = ''
      search%parameters = estimate
      if (size(search%moving) == 0) return
      associate (moving => search%moving)
         ahead = gauss_newton_step(jacobian(:, moving), residual, estimate(moving), &
            search%variables(moving), jacobian_error(search), search%residuals)
      end associate
      scales = scales_of(search%variables, estimate)
      share = 1/max(1.0_wp, maxval(abs(ahead%step)/scales(search%moving)))
      ! If every step was rejected, a minimum far away is an equally strong objection.
      if (all(abs(estimate - start) <= 1e-12_wp*scales)) share = 1
      J = sum(residual**2)
      gain = share*(2 - share)*(J - sum(ahead%residual**2))
      visible = max(options%tolerance, 1000*options%relative_error) &
         *maxval([(norm2(jacobian(:, k))*scales(k), k=1, size(scales))])
      visible = max(visible**2, options%tolerance*J)
      variance = J/max(1, search%residuals - size(estimate))
      if (search%failures_in_a_row > 0) then
         objection = ', but the model cannot be computed at the next steps'
      else if (.not. (ahead%distance <= merge(near, near_by_integrator, &
         options%relative_error <= 0) .or. gain <= visible)) then
         if (gain <= negligible*variance) then
            note = '; the search stopped short of its tolerance, but J can fall by no more '// &
               'than '//to_text(gain/variance)//' times the variance of the noise'
            return
         end if
         objection = ', but the derivatives predict that J can fall by '//to_text(100*gain/J)//' %'
         if (options%relative_error > 0) objection = objection// &
            '; the residuals have a relative error of '//to_text(options%relative_error)// &
            ', and a smaller one may help'
      else if (ahead%rank < size(scales) .and. size(search%moving) == size(scales)) then
         call check_lost_effects(search, start, estimate, residual, ahead%rank, objection, error)
      end if
   end subroutine check_minimum

   !> Objects if parameters that had an effect at the start have none at the estimate: the search
   !> has then run away. Parameters without an effect at either point are no objection; the record
   !> cannot determine them. Nor are parameters at their bounds, because a mass of zero, for
   !> example, may cancel the effect of others.
   !>
   !> rank       number of independent directions with an effect at the estimate
   !> objection  on return with the objection, if there is one
   subroutine check_lost_effects(search, start, estimate, residual, rank, objection, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: start(:), estimate(:), residual(:)
      integer, intent(in) :: rank
      character(len=:), allocatable, intent(inout) :: objection
      type(error_t), allocatable, intent(out) :: error
      !> Factor above round-off from which an effect at the start counts.
      real(wp), parameter :: clearly = 1e3_wp
      type(gauss_newton_t) :: ahead
      real(wp), allocatable :: r(:), jacobian(:, :)

      if (any(search%variables%is_at_bound(estimate))) return
      allocate (jacobian(size(residual), size(start)), r(size(residual)))
      if (associated(search%smooth)) then
         call search%smooth%condensed(start, r, jacobian, error)
      else
         r = residual
         call differences(search%problem, start, search%variables, search%relative_error, &
            jacobian, error)
      end if
      if (allocated(error)) return
      ahead = gauss_newton_step(jacobian, r, start, search%variables, &
         clearly*jacobian_error(search), search%residuals)
      if (ahead%rank <= rank) return
      objection = ', but parameters that had an effect at the start have none at the end'
      search%parameters = start
   end subroutine check_lost_effects

   !> Returns the relative error of the columns of a Jacobian.
   real(wp) function jacobian_error(search)
      type(search_t), intent(in) :: search

      jacobian_error = search%residuals*epsilon(jacobian_error)
      if (.not. associated(search%smooth)) jacobian_error = error_of_differences( &
         search%relative_error)
   end function jacobian_error

end module beamid_optimality
