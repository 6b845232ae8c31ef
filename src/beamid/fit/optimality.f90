!> Whether a search has ended at a minimum. A success code of MINPACK is no proof: it comes as well
!> where trial steps were refused until they were too short to matter, where a derivative is wrong,
!> and where one long step ended at a place at which parameters have no effect.
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

   !> Distance to the minimum that counts as none, in standard errors. A hundredth shows in no
   !> number that is told of a fit; searches that converge end at 1e-6 or less. An integrator's
   !> error stops a search earlier: then it is what that error may do to an estimate.
   real(wp), parameter :: near = 1e-2_wp, near_by_integrator = 0.25_wp

contains

   !> At a minimum linear theory sees no other ahead; it counts to where a parameter has changed by
   !> its own size. No more is asked for than a search can see: relative changes of J, and of the
   !> parameters, by the tolerance, and by a thousand times the relative error of an integrator,
   !> which grows along a response and in differences of it.
   !>
   !> start      where the first search began
   !> estimate, residual, jacobian  where the search has ended
   !> objection  what speaks against a minimum, or ''. `search` is then left where to go on from:
   !>            there, or at the start
   !> error      the derivatives at the start cannot be computed
   subroutine check_minimum(search, options, start, estimate, residual, jacobian, objection, error)
      type(search_t), intent(inout) :: search
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: start(:), estimate(:), residual(:), jacobian(:, :)
      character(len=:), allocatable, intent(out) :: objection
      type(error_t), allocatable, intent(out) :: error
      type(gauss_newton_t) :: ahead
      real(wp) :: scales(size(estimate)), share, gain, J, visible
      integer :: k

      objection = ''
      search%parameters = estimate
      if (size(search%moving) == 0) return
      associate (moving => search%moving)
         ahead = gauss_newton_step(jacobian(:, moving), residual, estimate(moving), &
            search%variables(moving), jacobian_error(search, size(residual)))
      end associate
      scales = scales_of(search%variables, estimate)
      share = 1/max(1.0_wp, maxval(abs(ahead%step)/scales(search%moving)))
      ! Where every step was refused a minimum far away is no less of an objection.
      if (all(abs(estimate - start) <= 1e-12_wp*scales)) share = 1
      J = sum(residual**2)
      gain = share*(2 - share)*(J - sum(ahead%residual**2))
      visible = max(options%tolerance, 1000*options%relative_error) &
         *maxval([(norm2(jacobian(:, k))*scales(k), k=1, size(scales))])
      visible = max(visible**2, options%tolerance*J)
      if (search%failures_in_a_row > 0) then
         objection = ', but only for steps at which the model cannot be computed'
      else if (.not. (ahead%distance <= merge(near, near_by_integrator, &
         options%relative_error <= 0) .or. gain <= visible)) then
         objection = ', but the derivatives promise a J that is '//to_text(100*gain/J)//' % smaller'
         if (options%relative_error > 0) objection = objection// &
            ', as far as a relative error of '//to_text(options%relative_error)// &
            ' in the residuals lets it be seen: a smaller one may help'
      else if (ahead%rank < size(scales) .and. size(search%moving) == size(scales)) then
         call check_lost_effects(search, start, estimate, residual, ahead%rank, objection, error)
      end if
   end subroutine check_minimum

   !> Parameters whose effect at the estimate is lost in round-off have none that the record could
   !> determine; but where it was there at the start, the search has run away from what it looked
   !> for. A parameter at its bound, a mass of zero say, may take others' effect away.
   !>
   !> rank  at the estimate
   subroutine check_lost_effects(search, start, estimate, residual, rank, objection, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: start(:), estimate(:), residual(:)
      integer, intent(in) :: rank
      character(len=:), allocatable, intent(inout) :: objection
      type(error_t), allocatable, intent(out) :: error
      !> So much larger an effect at the start is no matter of round-off.
      real(wp), parameter :: clearly = 1e3_wp
      type(gauss_newton_t) :: ahead
      real(wp), allocatable :: r(:), jacobian(:, :)

      if (any(search%variables%is_at_bound(estimate))) return
      allocate (jacobian(size(residual), size(start)), r(size(residual)))
      if (associated(search%smooth)) then
         call search%smooth%jacobian(start, r, jacobian, error)
      else
         r = residual
         call differences(search%problem, start, search%variables, search%relative_error, &
            jacobian, error)
      end if
      if (allocated(error)) return
      ahead = gauss_newton_step(jacobian, r, start, search%variables, &
         clearly*jacobian_error(search, size(r)))
      if (ahead%rank <= rank) return
      objection = ', but where parameters that had an effect at the start have none'
      search%parameters = start
   end subroutine check_lost_effects

   !> Relative error of the columns of a Jacobian.
   real(wp) function jacobian_error(search, m)
      type(search_t), intent(in) :: search
      integer, intent(in) :: m

      jacobian_error = m*epsilon(jacobian_error)
      if (.not. associated(search%smooth)) jacobian_error = error_of_differences( &
         search%relative_error)
   end function jacobian_error

end module beamid_optimality
