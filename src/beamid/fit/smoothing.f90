!> Chooses the strength s of a roughness penalty from the data by restricted maximum likelihood
!> (REML: Patterson and Thompson, Biometrika 58, 1971, 545; Wood, J. R. Stat. Soc. B 73, 2011, 3).
!> The smooth fields E(x) and c_D(x) of a fit are estimated with it.
!>
!> A linearised penalised fit minimises S = |r + J (v - v0)|**2 + s |L v|**2 over v (n). J has m
!> rows, L has rank k, whatever its number of rows, and a null space of dimension q = n - k. The
!> minimum is the posterior mode of v for noise of variance sigma**2, a normal prior of L v with
!> variance sigma**2/s, and a flat prior in the null space of L. The density of the data, with v
!> integrated out, is
!>
!>     (2 pi sigma**2)**(-m/2) (s/(2 pi sigma**2))**(k/2)
!>        (2 pi sigma**2)**(n/2) det(J'J + s L'L)**(-1/2) exp(-min S/(2 sigma**2))
!>
!> times a factor that does not depend on s. Its maximum over sigma**2 is at
!> sigma**2 = min S/(m - q), and -2 log of this maximum is, up to a constant,
!>
!>     score(s) = (m - q) log min S + log det(J'J + s L'L) - k log s.
module beamid_smoothing
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_smoothers, only: new_smoother, smoother_t, smoothing_point_t
   implicit none
   private

   public :: smoothing_t, choose_strength, difference_rows, resolution_length

   !> The chosen strength of a penalty, and the penalised fit at this strength.
   type :: smoothing_t
      real(wp) :: strength = 0   !< s of the fit
      !> strength of least score; differs from `strength` if the caller prescribes that
      real(wp) :: asked = 0
      real(wp) :: freedom = 0                      !< as in `smoothing_point_t`
      !> Whether the score decreases up to an end of the range, so that `asked` is this end: +1 a
      !> rigid fit, in the null space of L; -1 no penalty, or the smallest strength allowed; 0
      !> neither.
      integer :: at_end = 0
      logical :: bounded = .false.                 !< at_end = -1 is the smallest strength allowed
      real(wp) :: variance = 0                     !< sigma**2 of the noise, min S/(m - q)
      real(wp), allocatable :: estimate(:)         !< (n) v of the linearised problem
      !> (n, n) covariance of v, sigma**2 (J'J + s L'L)^-1, as if the strength were known
      real(wp), allocatable :: covariance(:, :)
      !> (n, n) row i: weights of the true v in the expected estimate of v_i
      real(wp), allocatable :: resolution(:, :)
      !> fits at strengths around the chosen strength, which is in the middle
      type(smoothing_point_t), allocatable :: curve(:)
   end type smoothing_t

   !> At the ends of the range, the effective degrees of freedom differ from their limit by this
   !> much.
   real(wp), parameter :: end_effect = 1e-6_wp

contains

   !> Chooses the strength of a penalty for residuals of equal variance.
   !>
   !> jacobian   (m, n) of the residuals without the penalty
   !> residual   (m)
   !> at         (n) v0, parameters at which these residuals hold
   !> penalty    (p, n) L; a zero column for a parameter without penalty
   !> smoothing  the strength and the fit
   !> error      as of `new_smoother`
   !> least      smallest strength allowed; default: no limit
   !> used       strength of the fit; default: the strength of least score
   subroutine choose_strength(jacobian, residual, at, penalty, smoothing, error, least, used)
      real(wp), intent(in) :: jacobian(:, :), residual(:), at(:), penalty(:, :)
      type(smoothing_t), intent(out) :: smoothing
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: least, used
      !> Half decades on each side; three decades change the effective degrees of freedom of second
      !> differences by a factor of about five.
      integer, parameter :: each_side = 6
      type(smoother_t) :: smoother
      type(smoothing_point_t) :: chosen
      integer :: k

      call new_smoother(jacobian, residual, at, penalty, smoother, error)
      if (allocated(error)) return
      call find_minimum(smoother, smoothing%strength, smoothing%at_end, least)
      if (present(least)) smoothing%bounded = smoothing%at_end < 0 .and. &
         smoothing%strength <= least
      smoothing%asked = smoothing%strength
      if (present(used)) smoothing%strength = used
      chosen = smoother%point(smoothing%strength)
      smoothing%freedom = chosen%freedom
      smoothing%variance = (chosen%misfit + chosen%strength*chosen%roughness)/smoother%contrasts
      smoothing%estimate = smoother%estimate(smoothing%strength)
      smoothing%covariance = smoothing%variance*smoother%covariance(smoothing%strength)
      smoothing%resolution = smoother%resolution(smoothing%strength)
      allocate (smoothing%curve(2*each_side + 1))
      do k = -each_side, each_side
         smoothing%curve(each_side + 1 + k) = &
            smoother%point(smoothing%strength*10.0_wp**(0.5_wp*k))
      end do
   end subroutine choose_strength

   !> Finds the strength of least score in the range from no effect of the penalty to a rigid fit:
   !> the lowest of the minima, where the slope changes from negative to positive between two points
   !> of a grid, and of the ends towards which the score decreases. If the slope has two zeros
   !> within a step of the grid, the score is practically flat there: it is a sum of logistic curves
   !> in log s, each some units wide.
   !>
   !> strength  of least score
   !> at_end    as in `smoothing_t`
   !> least     lower limit of the range
   pure subroutine find_minimum(smoother, strength, at_end, least)
      type(smoother_t), intent(in) :: smoother
      real(wp), intent(out) :: strength
      integer, intent(out) :: at_end
      real(wp), intent(in), optional :: least
      real(wp), parameter :: step = 0.25_wp
      type(smoothing_point_t) :: here
      real(wp), allocatable :: gamma(:), log_strength(:), slopes(:), candidate(:)
      integer, allocatable :: ends(:)
      real(wp) :: best, lowest, lower, upper
      integer :: j, last

      gamma = pack(smoother%singular**2, smoother%singular**2 > 0)
      ! The data contain no information on the penalised parameters: all strengths are equivalent,
      ! and the fit is rigid.
      strength = 1
      if (present(least)) strength = max(strength, least)
      at_end = 1
      if (size(gamma) == 0) return
      lowest = end_effect/sum(1/gamma)
      upper = log(sum(gamma)/end_effect)
      if (present(least)) then
         strength = least
         if (smoother%slope(exp(upper)) > 0) at_end = merge(-1, 1, least >= exp(upper))
         if (least >= exp(upper)) return
         lowest = max(lowest, least)
      end if
      lower = log(lowest)
      last = 2 + int((upper - lower)/step)
      log_strength = [(lower + (upper - lower)*(j - 1)/(last - 1), j=1, last)]
      slopes = [(smoother%slope(exp(log_strength(j))), j=1, last)]
      allocate (candidate(0), ends(0))
      if (slopes(last) <= 0) then
         candidate = [exp(upper)]
         ends = [1]
      end if
      do j = 1, last - 1
         if (.not. (slopes(j) <= 0 .and. slopes(j + 1) > 0)) cycle
         candidate = [candidate, zero_between(smoother, log_strength(j), log_strength(j + 1))]
         ends = [ends, 0]
      end do
      if (slopes(1) > 0) then
         candidate = [candidate, lowest]
         ends = [ends, -1]
      end if
      best = huge(best)
      do j = 1, size(candidate)
         here = smoother%point(candidate(j))
         if (here%score >= best) cycle
         best = here%score
         strength = candidate(j)
         at_end = ends(j)
      end do
   end subroutine find_minimum

   !> Returns the strength at which the slope of the score changes from negative to positive, by
   !> bisection to machine precision.
   !>
   !> left, right  log s on either side
   pure real(wp) function zero_between(smoother, left, right) result(strength)
      type(smoother_t), intent(in) :: smoother
      real(wp), intent(in) :: left, right
      integer, parameter :: halvings = 60
      real(wp) :: below, above
      integer :: j

      below = left
      above = right
      do j = 1, halvings
         strength = exp((below + above)/2)
         if (smoother%slope(strength) > 0) then
            above = (below + above)/2
         else
            below = (below + above)/2
         end if
      end do
   end function zero_between

   !> Returns the rows of L for n coefficients of a B-spline on equidistant knots: finite
   !> differences of a given order. Their null space contains the polynomials of degree < order.
   !>
   !> order  1 for differences of neighbours, 2 for differences of these, and so on
   !> rows   (n - order, n); (0, n) for n <= order
   pure function difference_rows(n, order) result(rows)
      integer, intent(in) :: n, order
      real(wp) :: rows(max(n - order, 0), n)
      real(wp) :: stencil(order + 1)
      integer :: j

      ! Binomial coefficients with alternating signs.
      stencil(order + 1) = 1
      do j = order, 1, -1
         stencil(j) = -stencil(j + 1)*j/(order + 1 - j)
      end do
      rows = 0
      do j = 1, size(rows, 1)
         rows(j, j:j + order) = stencil
      end do
   end function difference_rows

   !> Returns the effective width of an averaging row a, (sum a)**2/sum(a**2) spacings: k spacings
   !> for k equal weights, less if weights of both signs cancel, 0 for a row of zeros.
   !>
   !> row      (n) weights of values one spacing apart
   !> spacing  in any unit of length
   pure real(wp) function resolution_length(row, spacing) result(width)
      real(wp), intent(in) :: row(:), spacing
      real(wp) :: largest

      width = 0
      largest = 0
      if (size(row) > 0) largest = maxval(abs(row))
      if (largest > 0) width = spacing*sum(row/largest)**2/sum((row/largest)**2)
   end function resolution_length

end module beamid_smoothing
