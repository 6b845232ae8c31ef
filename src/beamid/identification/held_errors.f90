!> What errors of held parameters, of which the standard deviations are stated, do to the estimates:
!> held at other values, the search would have ended elsewhere.
!>
!> To first order by G = -(J'J)**-1 J'J_h, J_h what the held one does to the residuals.
module beamid_held_errors
   use beamid_errors, only: error_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_parameters, only: get_free, name_length, parameters
   use beamid_priors, only: prior_t
   use beamid_residuals, only: residual_t
   implicit none
   private

   public :: held_t, held_errors

   !> A held parameter of which the error is known.
   type :: held_t
      character(len=name_length) :: name = ''
      integer :: record = 0                !< 0: all
      real(wp) :: sd = 0                   !< stated
      real(wp), allocatable :: effect(:)   !< (n) what that error does to each quantity
   end type held_t

contains

   !> Every prior of a parameter that is not free, or of several that are not all free.
   !>
   !> problem   as fitted, the estimates in its scenario
   !> estimate  (free)
   !> jacobian  (rows, n) by the n quantities that were estimated, of exact responses those that
   !>           enter linearly included
   !> scale     (n) of each quantity
   subroutine held_errors(problem, estimate, jacobian, scale, held, error)
      type(residual_t), intent(inout) :: problem
      real(wp), intent(in) :: estimate(:), jacobian(:, :), scale(:)
      type(held_t), allocatable, intent(out) :: held(:)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: free(:), record(:)
      type(held_t) :: one
      real(wp) :: along(problem%samples()), residual(size(jacobian, 1)), effect(size(scale))
      integer :: k, rank

      free = problem%free
      record = problem%record
      allocate (held(0))
      residual = 0
      do k = 1, size(problem%priors)
         associate (prior => problem%priors(k))
            call change(problem, prior, estimate, size(jacobian, 2), along, error)
            problem%free = free
            problem%record = record
            if (allocated(error)) return
            if (.not. any(abs(along) > 0)) cycle
            residual(:size(along)) = along
            call least_squares_step(jacobian, residual, scale, spread(.true., 1, size(scale)), &
               epsilon(1.0_wp)*size(residual), effect, rank)
            one%name = prior%name
            one%record = prior%record
            one%sd = prior%sd
            one%effect = prior%sd*effect
            held = [held, one]
         end associate
      end do
   end subroutine held_errors

   !> What a unit of what a prior is about changes the residuals by, as far as it is held.
   subroutine change(problem, prior, estimate, n, along, error)
      type(residual_t), intent(inout) :: problem
      type(prior_t), intent(in) :: prior
      real(wp), intent(in) :: estimate(:)
      integer, intent(in) :: n
      real(wp), intent(out) :: along(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:), slopes(:), jac(:, :), c(:)
      real(wp) :: value, r(size(along)), above(size(along))
      integer :: i, k, p

      along = 0
      values = estimate
      allocate (slopes(0))
      do k = 1, size(prior%parameter)
         p = prior%parameter(k)
         do i = 1, size(problem%parts)
            if (prior%record > 0 .and. i /= prior%record) cycle
            if (any(problem%free == p .and. (problem%record == 0 .or. problem%record == i))) cycle
            value = get_free(problem%scenario%structures(i), problem%scenario%excitations(i), p)
            problem%free = [problem%free, p]
            problem%record = [problem%record, i]
            values = [values, value]
            ! Of a stiffness the search knows the reciprocal.
            slopes = [slopes, prior%slope(k)]
            if (parameters(p)%is_reciprocal) slopes(size(slopes)) = -value**2
         end do
      end do
      if (size(slopes) == 0) return
      if (problem%exact) then
         associate (linear => n - size(estimate))
            allocate (jac(size(along), size(values) + linear), c(linear))
            call problem%evaluate(values, r, jac, error, c)
         end associate
         if (.not. allocated(error)) along = matmul(jac(:, size(estimate) + 1:size(values)), slopes)
         return
      end if
      ! By differences: a hundredth of the standard deviation moves no phase by much.
      associate (step => 1e-2_wp*prior%sd, first => size(estimate) + 1)
         values(first:) = values(first:) + step*slopes
         call problem%residuals(values, above, error)
         if (allocated(error)) return
         values(first:) = values(first:) - 2*step*slopes
         call problem%residuals(values, r, error)
         along = (above - r)/(2*step)
      end associate
   end subroutine change

end module beamid_held_errors
