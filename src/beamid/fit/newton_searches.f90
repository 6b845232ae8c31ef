!> Continues a search by Newton's method in a trust region, where exact derivatives are available.
!> `beamid_least_squares` uses it after MINPACK has used up its evaluations.
!>
!> If a model is too coarse for its record, large residuals remain. Levenberg-Marquardt, which
!> approximates the second derivatives of J/2 by J'J of the Jacobian, then creeps along a curved
!> valley of J. Here the second derivatives are differences of the gradient J'r, with one evaluation
!> for each variable. A step that leaves the valley is led back into it, across the valley, before
!> it is judged.
module beamid_newton_searches
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dposv
   use beamid_matrices, only: add_diagonal
   use beamid_searches, only: search_t, notify_monitor, physical_parameters
   implicit none
   private

   public :: search_by_newton

   interface
      !> LAPACK: eigenvalues and eigenvectors of a symmetric matrix.
      subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: w(*), work(*)
         integer, intent(out) :: info
      end subroutine dsyev
   end interface

   !> Quadratic model of half the sum of squares, J/2, around a point z.
   type :: quadratic_model_t
      real(wp) :: half_J = 0                     !< value at the point
      real(wp), allocatable :: gradient(:)       !< (n) of J/2 by z
      !> (n) lengths of the columns of the Jacobian; scaled z: scale z
      real(wp), allocatable :: scale(:)
      real(wp), allocatable :: curvature(:)      !< (n) eigenvalues of the scaled Hessian, ascending
      real(wp), allocatable :: direction(:, :)   !< (n, n) their eigenvectors, in columns
   end type quadratic_model_t

contains

   !> Continues a search from the point that it has reached.
   !>
   !> z     (n) moving variables: on entry the start, on return the solution
   !> r     (m) residuals there
   !> info  as with MINPACK: 1 J decreases no further; 5 it would decrease further, or the model
   !>       fails
   subroutine search_by_newton(search, z, r, info)
      type(search_t), intent(inout) :: search
      real(wp), intent(inout) :: z(:), r(:)
      integer, intent(out) :: info
      integer, parameter :: max_iterations = 100
      !> Predicted decreases of J/2 that are negligible, relative to the variance of the residuals
      !> (a step of some 1e-4 standard errors), and relative to J/2 (round-off).
      real(wp), parameter :: negligible = 1e-8_wp, round_off = 1e-13_wp
      type(quadratic_model_t) :: model
      type(error_t), allocatable :: error
      real(wp), dimension(size(z)) :: step, next
      integer, parameter :: max_corrections = 3
      real(wp) :: radius, predicted, variance, decrease, shift, next_r(size(r))
      logical :: inside
      integer :: k, n

      info = 5
      call build_model(search, z, r, model, error)
      if (allocated(error)) return
      radius = 0.1_wp*norm2(model%scale*z)
      do k = 1, max_iterations
         call find_step(model, radius, step, predicted, shift)
         inside = .not. shift > 0
         variance = 2*model%half_J/max(1, search%residuals - size(z))
         next = z + step
         call residuals_at(search, next, next_r, error)
         do n = 1, max_corrections
            if (allocated(error)) exit
            decrease = model%half_J - sum(next_r**2)/2
            if (decrease >= 0.25_wp*predicted) exit
            call return_to_valley(search, max(shift, 1e-3_wp*model%curvature(size(z))), &
               model%scale, next, next_r, error)
         end do
         decrease = -1
         if (.not. allocated(error)) decrease = model%half_J - sum(next_r**2)/2
         if (inside .and. predicted <= max(negligible*variance, round_off*model%half_J) .and. &
            (decrease > 0 .or. predicted <= round_off*model%half_J)) then
            ! This last Newton step doubles the number of correct digits.
            info = 1
            if (.not. decrease > 0) return
            z = next
            r = next_r
            return
         end if
         if (decrease < 0.25_wp*predicted) then
            radius = 0.25_wp*norm2(model%scale*step)
         else if (decrease > 0.75_wp*predicted .and. .not. inside) then
            radius = 2*radius
         end if
         ! Only round-off remains to be gained.
         if (predicted <= round_off*model%half_J .or. .not. radius > 0) return
         if (.not. decrease > 1e-4_wp*predicted) cycle
         z = next
         r = next_r
         call notify_monitor(search, physical_parameters(search, z), sum(r**2))
         call build_model(search, z, r, model, error)
         if (allocated(error)) return
      end do
   end subroutine search_by_newton

   !> Computes value, gradient and scaled Hessian of J/2 at a point.
   !>
   !> z      (n) moving variables
   !> r      (m) on return the residuals at z
   !> model  on return the quadratic model
   subroutine build_model(search, z, r, model, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:)
      real(wp), intent(inout) :: r(:)
      type(quadratic_model_t), intent(out) :: model
      type(error_t), allocatable, intent(out) :: error
      !> Relative change of the residuals by a difference step, and the longest step of a variable.
      real(wp), parameter :: difference = 1e-4_wp
      real(wp) :: jacobian(size(r), size(z)), hessian(size(z), size(z)), other(size(r)), &
         displaced(size(z)), work(64*size(z)), h
      integer :: info, k, n

      n = size(z)
      allocate (model%scale(n), model%curvature(n))
      call derivatives_at(search, z, r, jacobian, error)
      if (allocated(error)) return
      model%half_J = sum(r**2)/2
      model%gradient = matmul(r, jacobian)
      model%scale = norm2(jacobian, dim=1)
      where (.not. model%scale > 1e-8_wp*maxval(model%scale)) &
         model%scale = max(tiny(h), 1e-8_wp*maxval(model%scale))
      do k = 1, n
         h = difference*min(1.0_wp, norm2(r)/model%scale(k))
         displaced = z
         displaced(k) = z(k) + h
         call derivatives_at(search, displaced, other, jacobian, error)
         if (allocated(error)) return
         hessian(:, k) = (matmul(other, jacobian) - model%gradient)/(h*model%scale(k)*model%scale)
      end do
      model%direction = (hessian + transpose(hessian))/2
      call dsyev('V', 'U', n, model%direction, n, model%curvature, work, size(work), info)
      if (info /= 0) call failure(error, 'LAPACK finds no eigenvalues of the second derivatives')
   end subroutine build_model

   !> Computes the step to the minimum of the quadratic model within a radius.
   !>
   !> radius     largest length of the scaled step
   !> step       (n) of z
   !> predicted  decrease of J/2 that the model predicts
   !> shift      added to every curvature to limit the length; 0: the model has a minimum, and the
   !>            step leads to it
   pure subroutine find_step(model, radius, step, predicted, shift)
      type(quadratic_model_t), intent(in) :: model
      real(wp), intent(in) :: radius
      real(wp), intent(out) :: step(:), predicted, shift
      integer, parameter :: halvings = 100
      real(wp), dimension(size(step)) :: slope, along
      real(wp) :: lowest, highest
      integer :: k

      slope = matmul(model%gradient/model%scale, model%direction)
      lowest = max(0.0_wp, -model%curvature(1)) + 1e-12_wp*maxval(abs(model%curvature))
      along = -slope/(model%curvature + lowest)
      shift = merge(0.0_wp, lowest, model%curvature(1) > 0)
      if (norm2(along) > radius) then
         ! The length decreases with the shift; with the upper limit it is at most the radius.
         highest = lowest + norm2(slope)/radius
         do k = 1, halvings
            shift = sqrt(lowest*highest)
            if (norm2(slope/(model%curvature + shift)) > radius) then
               lowest = shift
            else
               highest = shift
            end if
            if (highest <= lowest*(1 + 1e-3_wp)) exit
         end do
         shift = highest
         along = -slope/(model%curvature + shift)
      end if
      predicted = -sum(along*(slope + model%curvature*along/2))
      step = matmul(model%direction, along)/model%scale
   end subroutine find_step

   !> Takes a Levenberg-Marquardt step across the valley. Along the valley, where curvatures are
   !> smaller than the shift, the step is short.
   !>
   !> shift  added to every eigenvalue of the scaled J'J
   !> scale  (n) as in `quadratic_model_t`
   !> z, r   (n), (m) the point that a step has reached, and its residuals; on return those after
   !>        this step
   subroutine return_to_valley(search, shift, scale, z, r, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: shift, scale(:)
      real(wp), intent(inout) :: z(:), r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jacobian(size(r), size(z)), normal(size(z), size(z)), step(size(z), 1)
      integer :: info, k, n

      n = size(z)
      call derivatives_at(search, z, r, jacobian, error)
      if (allocated(error)) return
      do k = 1, n
         jacobian(:, k) = jacobian(:, k)/scale(k)
      end do
      step(:, 1) = -matmul(r, jacobian)
      normal = matmul(transpose(jacobian), jacobian)
      call add_diagonal(normal, spread(shift, 1, n))
      call dposv('U', n, 1, normal, n, step, n, info)
      if (info /= 0) return
      z = z + step(:, 1)/scale
      call residuals_at(search, z, r, error)
   end subroutine return_to_valley

   !> Computes the residuals, (m), at z.
   subroutine residuals_at(search, z, r, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      call search%evaluate_at(physical_parameters(search, z), r, error)
      if (allocated(error)) return
      if (.not. ieee_is_finite(sum(r**2))) call failure(error, 'the residuals are not finite')
   end subroutine residuals_at

   !> Computes the residuals, (m), and their derivatives by z, (m, n).
   subroutine derivatives_at(search, z, r, jacobian, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:)
      real(wp), intent(out) :: r(:), jacobian(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: slope(size(z))
      integer :: k

      call residuals_at(search, z, r, error)
      if (allocated(error)) return
      slope = search%variables(search%moving)%derivative(z)
      do k = 1, size(z)
         jacobian(:, k) = slope(k)*search%evaluated(search%here)%jacobian(:, search%moving(k))
      end do
   end subroutine derivatives_at

end module beamid_newton_searches
