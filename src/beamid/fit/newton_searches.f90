!> Newton's method for sums of squares, within a region of trust, where derivatives are exact.
!>
!> Where a model is too coarse for its record large residuals are left, and Levenberg-Marquardt,
!> which takes J'J for the second derivatives of half the sum of squares, creeps along a bent valley
!> of it. Here these are differences of the gradient J'r, one evaluation for each variable; and a
!> step that leaves the valley is led back into it, across, before it is judged.
module beamid_newton_searches
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dpotrf, dtrtrs
   use beamid_searches, only: search_t, tell, trial
   implicit none
   private

   public :: search_by_newton

   interface
      subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
         import :: wp
         character, intent(in) :: jobz, uplo
         integer, intent(in) :: n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: w(*), work(*)
         integer, intent(out) :: info
      end subroutine dsyev
   end interface

   !> Half the sum of squares about a point.
   type :: hill_t
      real(wp) :: half = 0                       !< its value
      real(wp), allocatable :: gradient(:)       !< (n)
      real(wp), allocatable :: unit(:)           !< (n) what the residuals change by, in length
      real(wp), allocatable :: curvature(:)      !< (n) eigenvalues in these units, ascending
      real(wp), allocatable :: direction(:, :)   !< (n, n) of each
   end type hill_t

contains

   !> Goes on from where a search has come to.
   !>
   !> z     (n) of the moving variables, start, then solution
   !> r     (m) residuals there
   !> info  as of MINPACK: 1 J falls no further, 5 it would still, or the model fails
   subroutine search_by_newton(search, z, r, info)
      type(search_t), intent(inout) :: search
      real(wp), intent(inout) :: z(:), r(:)
      integer, intent(out) :: info
      integer, parameter :: most = 100
      !> What the next step promises, in units of the variance of the residuals: some 1e-4 of a
      !> standard error are no step.
      real(wp), parameter :: nothing = 1e-8_wp, round_off = 1e-13_wp
      type(hill_t) :: hill
      type(error_t), allocatable :: error
      real(wp), dimension(size(z)) :: step, next
      integer, parameter :: most_corrections = 3
      real(wp) :: radius, promise, variance, fall, shift, left(size(r))
      logical :: inside
      integer :: k, n

      info = 5
      call survey(search, z, r, hill, error)
      if (allocated(error)) return
      radius = 0.1_wp*norm2(hill%unit*z)
      do k = 1, most
         call find_step(hill, radius, step, promise, shift)
         inside = .not. shift > 0
         variance = 2*hill%half/max(1, size(r) - size(z))
         next = z + step
         call residuals_at(search, next, left, error)
         do n = 1, most_corrections
            if (allocated(error)) exit
            fall = hill%half - sum(left**2)/2
            if (fall >= 0.25_wp*promise) exit
            call lead_back(search, max(shift, 1e-3_wp*hill%curvature(size(z))), hill%unit, next, &
               left, error)
         end do
         fall = -1
         if (.not. allocated(error)) fall = hill%half - sum(left**2)/2
         if (inside .and. promise <= max(nothing*variance, round_off*hill%half) .and. &
            (fall > 0 .or. promise <= round_off*hill%half)) then
            ! This last step goes twice as many digits.
            info = 1
            if (.not. fall > 0) return
            z = next
            r = left
            return
         end if
         if (fall < 0.25_wp*promise) then
            radius = 0.25_wp*norm2(hill%unit*step)
         else if (fall > 0.75_wp*promise .and. .not. inside) then
            radius = 2*radius
         end if
         ! Round-off is all that is left to gain.
         if (promise <= round_off*hill%half .or. .not. radius > 0) return
         if (.not. fall > 1e-4_wp*promise) cycle
         z = next
         r = left
         call tell(search, trial(search, z), sum(r**2))
         call survey(search, z, r, hill, error)
         if (allocated(error)) return
      end do
   end subroutine search_by_newton

   !> Value, gradient and second derivatives.
   !>
   !> r  (m) residuals at z
   subroutine survey(search, z, r, hill, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:)
      real(wp), intent(inout) :: r(:)
      type(hill_t), intent(out) :: hill
      type(error_t), allocatable, intent(out) :: error
      !> Lengths of differences: what they change of the residuals, and of a variable at most.
      real(wp), parameter :: difference = 1e-4_wp
      real(wp) :: jacobian(size(r), size(z)), hessian(size(z), size(z)), other(size(r)), &
         work(64*size(z)), h
      integer :: info, k, n

      n = size(z)
      allocate (hill%unit(n), hill%curvature(n))
      call derivatives_at(search, z, r, jacobian, error)
      if (allocated(error)) return
      hill%half = sum(r**2)/2
      hill%gradient = matmul(r, jacobian)
      hill%unit = norm2(jacobian, dim=1)
      where (.not. hill%unit > 1e-8_wp*maxval(hill%unit)) &
         hill%unit = max(tiny(h), 1e-8_wp*maxval(hill%unit))
      do k = 1, n
         h = difference*min(1.0_wp, norm2(r)/hill%unit(k))
         call derivatives_at(search, moved(z, k, h), other, jacobian, error)
         if (allocated(error)) return
         hessian(:, k) = (matmul(other, jacobian) - hill%gradient)/(h*hill%unit(k)*hill%unit)
      end do
      hill%direction = (hessian + transpose(hessian))/2
      call dsyev('V', 'U', n, hill%direction, n, hill%curvature, work, size(work), info)
      if (info /= 0) call failure(error, 'LAPACK finds no eigenvalues of the second derivatives')
   end subroutine survey

   !> z with variable k moved.
   pure function moved(z, k, by)
      real(wp), intent(in) :: z(:), by
      integer, intent(in) :: k
      real(wp) :: moved(size(z))

      moved = z
      moved(k) = moved(k) + by
   end function moved

   !> The step to the least value of the quadratic model within a radius.
   !>
   !> promise  what half the sum of squares falls by on it
   !> shift    added to every curvature to make it so short; 0: the model has a minimum, and this is
   !>          it
   pure subroutine find_step(hill, radius, step, promise, shift)
      type(hill_t), intent(in) :: hill
      real(wp), intent(in) :: radius
      real(wp), intent(out) :: step(:), promise, shift
      integer, parameter :: halvings = 100
      real(wp), dimension(size(step)) :: slope, along
      real(wp) :: least, most
      integer :: k

      slope = matmul(hill%gradient/hill%unit, hill%direction)
      least = max(0.0_wp, -hill%curvature(1)) + 1e-12_wp*maxval(abs(hill%curvature))
      along = -slope/(hill%curvature + least)
      shift = merge(0.0_wp, least, hill%curvature(1) > 0)
      if (norm2(along) > radius) then
         ! The length falls with the shift; where it is as large as this it is short enough.
         most = least + norm2(slope)/radius
         do k = 1, halvings
            shift = sqrt(least*most)
            if (norm2(slope/(hill%curvature + shift)) > radius) then
               least = shift
            else
               most = shift
            end if
            if (most <= least*(1 + 1e-3_wp)) exit
         end do
         shift = most
         along = -slope/(hill%curvature + shift)
      end if
      promise = -sum(along*(slope + hill%curvature*along/2))
      step = matmul(hill%direction, along)/hill%unit
   end subroutine find_step

   !> A step of Levenberg and Marquardt across the valley: along it, where curvatures are below the
   !> shift, it is short.
   !>
   !> unit  (n) as of `hill_t`
   !> z, r  (n), (m) in: where a step has led; out: where this one has
   subroutine lead_back(search, shift, unit, z, r, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: shift, unit(:)
      real(wp), intent(inout) :: z(:), r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jacobian(size(r), size(z)), normal(size(z), size(z)), step(size(z), 1)
      integer :: info, k, n

      n = size(z)
      call derivatives_at(search, z, r, jacobian, error)
      if (allocated(error)) return
      do k = 1, n
         jacobian(:, k) = jacobian(:, k)/unit(k)
      end do
      step(:, 1) = -matmul(r, jacobian)
      normal = matmul(transpose(jacobian), jacobian)
      do k = 1, n
         normal(k, k) = normal(k, k) + shift
      end do
      call dpotrf('U', n, normal, n, info)
      if (info /= 0) return
      call dtrtrs('U', 'T', 'N', n, 1, normal, n, step, n, info)
      call dtrtrs('U', 'N', 'N', n, 1, normal, n, step, n, info)
      z = z + step(:, 1)/unit
      call residuals_at(search, z, r, error)
   end subroutine lead_back

   !> (m) residuals at z.
   subroutine residuals_at(search, z, r, error)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      call search%evaluate_at(trial(search, z), r, error)
      if (allocated(error)) return
      if (.not. ieee_is_finite(sum(r**2))) call failure(error, 'the residuals are not finite')
   end subroutine residuals_at

   !> And their derivatives by z.
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
         jacobian(:, k) = slope(k)*search%here%jacobian(:, search%moving(k))
      end do
   end subroutine derivatives_at

end module beamid_newton_searches
