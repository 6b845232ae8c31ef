!> Effects of errors of fixed parameters on the estimates.
!>
!> A prior states the standard deviation of a parameter that the fit keeps fixed. With the parameter
!> fixed at another value, the search would have ended elsewhere. To first order this changes the
!> estimates by G = -(J'J)**-1 J'J_h for a unit change, where J_h is the derivative of the residuals
!> with respect to the fixed parameter.
module beamid_held_errors
   use beamid_errors, only: error_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: name_length
   use beamid_parameters, only: parameters
   use beamid_priors, only: prior_t
   use beamid_residuals, only: residual_t
   implicit none
   private

   public :: held_t, held_errors

   !> The effect of the error of one fixed parameter.
   type :: held_t
      character(len=name_length) :: name = ''
      integer :: record = 0                !< record it belongs to; 0: all records
      real(wp) :: sd = 0                   !< stated standard deviation [unit of the parameter]
      real(wp), allocatable :: effect(:)   !< (n) change of each quantity for an error of one sd
      !> The program keeps the parameter fixed although the user asked for it, at `value` and known
      !> to a factor.
      logical :: is_assumed = .false.
      real(wp) :: value = 0, factor = 1
   end type held_t

contains

   !> Returns the effect of every prior whose parameter is fixed, or whose parameters are not all
   !> free.
   !>
   !> problem   the fit, with the estimates in its scenario
   !> estimate  (free) estimates
   !> jacobian  (rows, n) derivatives with respect to the n estimated quantities, including the
   !>           linear unknowns if the response is exact
   !> scale     (n) scale of each quantity
   !> held      one entry for each prior with an effect
   !> error     the model cannot be computed
   subroutine held_errors(problem, estimate, jacobian, scale, held, error)
      type(residual_t), intent(inout) :: problem
      real(wp), intent(in) :: estimate(:), jacobian(:, :), scale(:)
      type(held_t), allocatable, intent(out) :: held(:)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: free(:), record(:)
      type(held_t) :: entry
      real(wp) :: derivative(problem%samples()), residual(size(jacobian, 1)), effect(size(scale))
      integer :: k, rank

      free = problem%free
      record = problem%record
      allocate (held(0))
      residual = 0
      do k = 1, size(problem%priors)
         associate (prior => problem%priors(k))
            call differentiate(problem, prior, estimate, size(jacobian, 2), derivative, error)
            problem%free = free
            problem%record = record
            if (allocated(error)) return
            if (.not. any(abs(derivative) > 0)) cycle
            residual(:size(derivative)) = derivative
            call least_squares_step(jacobian, residual, scale, spread(.true., 1, size(scale)), &
               epsilon(1.0_wp)*size(residual), effect, rank)
            entry%name = prior%name
            entry%record = prior%record
            entry%sd = prior%sd
            entry%effect = prior%sd*effect
            held = [held, entry]
         end associate
      end do
   end subroutine held_errors

   !> Computes the derivative of the residuals with respect to the quantity of a prior, through the
   !> fixed parameters that the quantity changes; 0 if all of them are free.
   !>
   !> n           number of estimated quantities
   !> derivative  (samples)
   subroutine differentiate(problem, prior, estimate, n, derivative, error)
      type(residual_t), intent(inout) :: problem
      type(prior_t), intent(in) :: prior
      real(wp), intent(in) :: estimate(:)
      integer, intent(in) :: n
      real(wp), intent(out) :: derivative(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:), slopes(:), jac(:, :), c(:)
      real(wp) :: value, r(size(derivative)), r_above(size(derivative))
      integer :: i, k, p

      derivative = 0
      values = estimate
      allocate (slopes(0))
      do k = 1, size(prior%parameter)
         p = prior%parameter(k)
         do i = 1, size(problem%parts)
            if (prior%record > 0 .and. i /= prior%record) cycle
            if (any(problem%free == p .and. (problem%record == 0 .or. problem%record == i))) cycle
            value = problem%scenario%get(p, i)
            problem%free = [problem%free, p]
            problem%record = [problem%record, i]
            values = [values, value]
            ! The search uses the reciprocal of a stiffness.
            slopes = [slopes, prior%slope(k)]
            if (parameters(p)%is_reciprocal) slopes(size(slopes)) = -value**2
         end do
      end do
      if (size(slopes) == 0) return
      if (problem%exact) then
         associate (linear => n - size(estimate))
            allocate (jac(size(derivative), size(values) + linear), c(linear))
            call problem%evaluate(values, r, jac, error, c)
         end associate
         if (.not. allocated(error)) derivative = matmul(jac(:, size(estimate) + 1:size(values)), &
            slopes)
         return
      end if
      ! Central differences. A step of a hundredth of the standard deviation keeps phase changes
      ! small.
      associate (step => 1e-2_wp*prior%sd, first => size(estimate) + 1)
         values(first:) = values(first:) + step*slopes
         call problem%residuals(values, r_above, error)
         if (allocated(error)) return
         values(first:) = values(first:) - 2*step*slopes
         call problem%residuals(values, r, error)
         derivative = (r_above - r)/(2*step)
      end associate
   end subroutine differentiate

end module beamid_held_errors
