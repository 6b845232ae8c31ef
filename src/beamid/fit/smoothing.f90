!> How strong a roughness penalty is to be, by the data: restricted marginal likelihood (REML:
!> Patterson and Thompson, Biometrika 58, 1971, 545; Wood, J. R. Stat. Soc. B 73, 2011, 3).
!>
!> Linearised, a penalised fit is the least of S = |r + J (v - v0)|**2 + s |L v|**2. That is the
!> mode of v for noise of the variance sigma**2 if L v, of rank k, is a priori normal with the
!> variance sigma**2/s and nothing is known of v within the null space of L, whose dimension is
!> q = n - k. The density of the data with v integrated out is
!>
!>     (2 pi sigma**2)**(-m/2) (s/(2 pi sigma**2))**(k/2)
!>        (2 pi sigma**2)**(n/2) det(J'J + s L'L)**(-1/2) exp(-min S/(2 sigma**2))
!>
!> times what does not depend on s: k is the rank, whatever the number of rows of L. The largest by
!> sigma**2 is at sigma**2 = min S/(m - q), and -2 log of what is left is, up to a constant,
!>
!>     score(s) = (m - q) log min S + log det(J'J + s L'L) - k log s.
!>
!> Coordinates make both sums of squares diagonal. With N a basis of the null space of L, any v is
!> N b + L^+ w, w = L v; b is eliminated by the QR decomposition of J N (Elden, BIT 17, 1977, 134),
!> which J'J + s L'L regular for s > 0 requires to have full rank and nothing else; the singular
!> values of what is left of J L^+ are the roots of gamma_i, the generalized eigenvalues of J'J and
!> L'L but for those of the null space. Then
!>
!>     score(s) = (m - q) log min S + sum log(1 + gamma_i/s).
module beamid_smoothing
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeqrf, dgesvd, dtrtrs
   use beamid_strings, only: to_text
   implicit none
   private

   public :: smoother_t, smoothing_point_t, smoothing_t
   public :: choose_strength, difference_rows, new_smoother, resolution_length

   !> What a strength does.
   type :: smoothing_point_t
      real(wp) :: strength = 0
      real(wp) :: misfit = 0      !< |r|**2 of the linearised problem
      real(wp) :: roughness = 0   !< |L v|**2
      !> Effective degrees of freedom of what is penalised: the trace of (J'J + s L'L)^-1 J'J less
      !> the number of columns of L that are zero. From the dimension of the null space of L within
      !> the other columns, for s large, to their number or the rank that J leaves them, for s = 0.
      real(wp) :: freedom = 0
      real(wp) :: score = 0       !< -2 log restricted likelihood, up to a constant
   end type smoothing_point_t

   !> The linearised problem in coordinates z (k) that leave the penalty s |z|**2 and the residuals
   !> beta + singular*z, beside a rest that none of them reaches: v = base + rough z, z = rows v,
   !> and L'L = rows' rows.
   type :: smoother_t
      integer :: contrasts = 0                     !< m - q
      integer :: smooth = 0                        !< freedom for s large
      real(wp) :: rest = 0                         !< squared
      real(wp), allocatable :: singular(:)         !< (k) roots of gamma; what is round-off is 0
      real(wp), allocatable :: beta(:)             !< (k)
      real(wp), allocatable :: base(:)             !< (n) the fit within the null space of L
      real(wp), allocatable :: rough(:, :)         !< (n, k) generalized eigenvectors
      real(wp), allocatable :: free(:, :)          !< (n, q) N with J N orthonormal
      real(wp), allocatable :: rows(:, :)          !< (k, n)
   contains
      procedure :: point
      procedure :: slope
      procedure :: estimate
      procedure :: resolution
      procedure :: covariance
   end type smoother_t

   !> The strength of least score, and what follows from it.
   type :: smoothing_t
      real(wp) :: strength = 0
      real(wp) :: asked = 0                        !< the one of least score, where another is used
      real(wp) :: freedom = 0                      !< as of `smoothing_point_t`
      !> The score falls to an end of the range, which `asked` then is: +1 rigid, nothing but the
      !> null space of L is left; -1 no penalty at all, or the least that is allowed; 0 neither.
      integer :: at_end = 0
      logical :: bounded = .false.                 !< -1 is the least that is allowed
      real(wp) :: variance = 0                     !< sigma**2 of the noise, min S/(m - q)
      real(wp), allocatable :: estimate(:)         !< (n) v of the linearised problem
      !> (n, n) of v, sigma**2 (J'J + s L'L)^-1, as if the strength were known
      real(wp), allocatable :: covariance(:, :)
      !> (n, n) row i: what the estimate of v_i averages of the true v
      real(wp), allocatable :: resolution(:, :)
      !> Strengths around the one chosen, which is in the middle.
      type(smoothing_point_t), allocatable :: curve(:)
   end type smoothing_t

   !> Lengths below this part of their natural size are round-off: ranks.
   real(wp), parameter :: round_off = 1e-12_wp
   !> At an end of the range the freedom is off its limit by no more than this.
   real(wp), parameter :: end_effect = 1e-6_wp

   interface
      subroutine dgeqp3(m, n, a, lda, jpvt, tau, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(inout) :: jpvt(*)
         real(wp), intent(out) :: tau(*), work(*)
         integer, intent(out) :: info
      end subroutine dgeqp3
      subroutine dormqr(side, trans, m, n, k, a, lda, tau, c, ldc, work, lwork, info)
         import :: wp
         character, intent(in) :: side, trans
         integer, intent(in) :: m, n, k, lda, ldc, lwork
         real(wp), intent(in) :: a(lda, *), tau(*)
         real(wp), intent(inout) :: c(ldc, *)
         real(wp), intent(out) :: work(*)
         integer, intent(out) :: info
      end subroutine dormqr
   end interface

contains

   !> Chooses the strength of a penalty for residuals that have the same variance.
   !>
   !> jacobian  (m, n) of the residuals without penalty
   !> residual  (m)
   !> at        (n) the v at which they are
   !> penalty   (p, n) L; a zero column for a parameter without penalty
   !> error     as of `new_smoother`
   !> least     no strength below this one is chosen, whatever the score is there; default: none
   !> used      the strength of which all the rest is told, where that is not to be the one of least
   !>           score
   subroutine choose_strength(jacobian, residual, at, penalty, smoothing, error, least, used)
      real(wp), intent(in) :: jacobian(:, :), residual(:), at(:), penalty(:, :)
      type(smoothing_t), intent(out) :: smoothing
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: least, used
      !> To either side three decades, within which the freedom of second differences changes by a
      !> factor of about five.
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

   !> Makes data and penalty diagonal.
   !>
   !> jacobian, residual, at, penalty  as of `choose_strength`
   !> error  nothing is penalised; no residuals left beside the null space of L; a combination of
   !>        parameters that changes neither the residuals nor the penalty
   subroutine new_smoother(jacobian, residual, at, penalty, smoother, error)
      real(wp), intent(in) :: jacobian(:, :), residual(:), at(:), penalty(:, :)
      type(smoother_t), intent(out) :: smoother
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: length(:), image(:, :), null_space(:, :), a(:, :)
      integer :: m, n, q

      m = size(jacobian, 1)
      n = size(jacobian, 2)
      if (.not. (all(ieee_is_finite(jacobian)) .and. all(ieee_is_finite(residual)) .and. &
         all(ieee_is_finite(at)) .and. all(ieee_is_finite(penalty)))) then
         call failure(error, 'smoothing: residuals, derivatives or penalty are not finite')
         return
      end if
      ! Units of the parameters: a column of the penalty has length 1, or else one of J. Not all by
      ! J: what the data hardly see would spoil the condition of the penalty.
      length = norm2(penalty, dim=1)
      smoother%smooth = count(length > 0)
      call split_penalty(penalty, length, image, null_space, smoother%rows, error)
      if (allocated(error)) return
      smoother%smooth = smoother%smooth - size(image, 2)
      q = size(null_space, 2)
      smoother%contrasts = m - q
      if (m <= q) then
         call failure(error, 'smoothing: '//to_text(m)//' residuals for '//to_text(q)// &
            ' parameters that no penalty holds')
         return
      end if
      where (.not. length > 0) length = norm2(jacobian, dim=1)
      where (.not. length > 0) length = 1
      a = reduced(jacobian, residual, length)
      smoother%rest = a(n + 1, n + 1)**2
      call make_diagonal(a(:n, :), image, null_space, at, smoother, length, error)
   end subroutine new_smoother

   !> What the penalty sees and what it does not, in units in which its columns have length 1.
   !>
   !> length      (n) of the columns of the penalty
   !> image       (n, k) L^+, with orthonormal coordinates of L v
   !> null_space  (n, q) orthonormal, columns without penalty apart from the others
   !> rows        (k, n) those coordinates of L v, in the caller's units
   subroutine split_penalty(penalty, length, image, null_space, rows, error)
      real(wp), intent(in) :: penalty(:, :), length(:)
      real(wp), allocatable, intent(out) :: image(:, :), null_space(:, :), rows(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: penalised(:), others(:)
      real(wp), allocatable :: scaled(:, :), singular(:), vt(:, :), work(:)
      real(wp) :: unused(1, 1)
      integer :: info, j, k, n, p

      n = size(length)
      penalised = pack([(j, j=1, n)], length > 0)
      others = pack([(j, j=1, n)], .not. length > 0)
      if (size(penalised) == 0) then
         call failure(error, 'smoothing: the penalty is zero')
         return
      end if
      p = size(penalty, 1)
      allocate (scaled(p, size(penalised)), vt(size(penalised), size(penalised)))
      allocate (singular(min(p, size(penalised))), work(10*(p + n)))
      do j = 1, size(penalised)
         scaled(:, j) = penalty(:, penalised(j))/length(penalised(j))
      end do
      call dgesvd('N', 'A', p, size(penalised), scaled, p, singular, unused, 1, vt, &
         size(penalised), work, size(work), info)
      if (info /= 0) then
         call no_convergence(error)
         return
      end if
      k = count(singular > round_off*singular(1))
      allocate (image(n, k), null_space(n, n - k), rows(k, n), source=0.0_wp)
      do j = 1, k
         image(penalised, j) = vt(j, :)/singular(j)
         rows(j, penalised) = singular(j)*vt(j, :)*length(penalised)
      end do
      do j = 1, size(others)
         null_space(others(j), j) = 1
      end do
      do j = k + 1, size(penalised)
         null_space(penalised, size(others) + j - k) = vt(j, :)
      end do
   end subroutine split_penalty

   !> The triangle of the QR decomposition of the Jacobian with the residual behind it.
   !>
   !> length  (n) unit of each column
   !> a       (n + 1, n + 1)
   function reduced(jacobian, residual, length) result(a)
      real(wp), intent(in) :: jacobian(:, :), residual(:), length(:)
      real(wp), allocatable :: a(:, :)
      real(wp), allocatable :: whole(:, :), tau(:), work(:)
      integer :: info, j, m, n

      ! Rows of zeros where there are fewer residuals than parameters.
      m = max(size(jacobian, 1), size(jacobian, 2) + 1)
      n = size(jacobian, 2)
      allocate (whole(m, n + 1), a(n + 1, n + 1), source=0.0_wp)
      allocate (tau(n + 1), work(64*(n + 1)))
      do j = 1, n
         whole(:size(residual), j) = jacobian(:, j)/length(j)
      end do
      whole(:size(residual), n + 1) = residual
      call dgeqrf(m, n + 1, whole, m, tau, work, size(work), info)
      do j = 1, n + 1
         a(:j, j) = whole(:j, j)
      end do
   end function reduced

   !> Eliminates the null space of the penalty, and turns the coordinates of L v to the singular
   !> vectors of what is left of J.
   !>
   !> a                  (n, n + 1) J and r, reduced
   !> image, null_space  as of `split_penalty`
   !> at                 (n) in the caller's units
   !> length             (n) units of the columns of J
   subroutine make_diagonal(a, image, null_space, at, smoother, length, error)
      real(wp), intent(in) :: a(:, :), image(:, :), at(:), length(:)
      real(wp), intent(inout) :: null_space(:, :)
      type(smoother_t), intent(inout) :: smoother
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: seen(:, :), whole(:, :), response(:, :), basis(:, :), u(:, :), &
         vt(:, :), work(:), tau(:), left(:, :), reach(:)
      integer, allocatable :: pivot(:)
      real(wp) :: noise
      integer :: info, j, k, n, q

      n = size(at)
      k = size(image, 2)
      q = size(null_space, 2)
      ! J N in units of what its terms add up to if they do not cancel: a length of round-off is
      ! seen for what it is.
      reach = matmul(norm2(a(:, :n), dim=1), abs(null_space))
      do j = 1, q
         if (reach(j) > 0) null_space(:, j) = null_space(:, j)/reach(j)
      end do
      allocate (pivot(q), tau(q), work(64*(n + 1)), u(k, k), vt(k, k), smoother%singular(k))
      pivot = 0
      seen = matmul(a(:, :n), null_space)
      call dgeqp3(n, q, seen, n, pivot, tau, work, size(work), info)
      j = count([(abs(seen(j, j)) <= round_off, j=1, q)])
      if (j > 0) then
         call failure(error, 'smoothing: neither the residuals nor the penalty determine '// &
            to_text(j)//' of the parameters, or combinations of them')
         return
      end if
      null_space = null_space(:, pivot)
      allocate (whole(n, k + 1))
      whole(:, :k) = matmul(a(:, :n), image)
      whole(:, k + 1) = a(:, n + 1)
      noise = n*epsilon(noise)*norm2(whole(:, :k))
      call dormqr('L', 'T', n, k + 1, q, seen, n, tau, whole, n, work, size(work), info)
      response = whole(:q, :)
      left = whole(q + 1:, :k)
      basis = transpose(null_space)
      if (q > 0) then
         call dtrtrs('U', 'N', 'N', q, k + 1, seen, n, response, q, info)
         call dtrtrs('U', 'T', 'N', q, n, seen, n, basis, q, info)
      end if
      deallocate (work)
      allocate (work(10*k))
      call dgesvd('A', 'A', k, k, left, k, smoother%singular, u, k, vt, k, work, size(work), info)
      if (info /= 0) then
         call no_convergence(error)
         return
      end if
      where (smoother%singular <= noise) smoother%singular = 0

      smoother%free = transpose(basis)/spread(length, 2, q)
      smoother%rough = matmul(image - matmul(null_space, response(:, :k)), transpose(vt)) &
         /spread(length, 2, k)
      smoother%rows = matmul(vt, smoother%rows)
      smoother%beta = matmul(whole(q + 1:, k + 1), u) &
         - smoother%singular*matmul(smoother%rows, at)
      smoother%base = at - matmul(null_space, response(:, k + 1))/length &
         - matmul(smoother%rough, matmul(smoother%rows, at))
   end subroutine make_diagonal

   pure subroutine no_convergence(error)
      type(error_t), allocatable, intent(out) :: error

      call failure(error, 'smoothing: a singular value decomposition did not converge')
   end subroutine no_convergence

   !> The strength of least score from where the penalty does nothing to where it allows nothing:
   !> the lowest minimum, each where the slope rises through zero between two points of a grid, or
   !> an end towards which the score falls. Two zeros within a step of the grid are of a score as
   !> good as flat: it is made of logistic curves in log s, some units wide.
   !>
   !> at_end  as of `smoothing_t`
   !> least   where the range begins at the lowest
   pure subroutine find_minimum(smoother, strength, at_end, least)
      type(smoother_t), intent(in) :: smoother
      real(wp), intent(out) :: strength
      integer, intent(out) :: at_end
      real(wp), intent(in), optional :: least
      real(wp), parameter :: step = 0.25_wp
      type(smoothing_point_t) :: here
      real(wp), allocatable :: gamma(:), place(:), rise(:), candidate(:)
      integer, allocatable :: ends(:)
      real(wp) :: best, lowest, lower, upper
      integer :: j, last

      gamma = pack(smoother%singular**2, smoother%singular**2 > 0)
      ! The data say nothing of what is penalised: all strengths are alike, and the fit is rigid.
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
      place = [(lower + (upper - lower)*(j - 1)/(last - 1), j=1, last)]
      rise = [(smoother%slope(exp(place(j))), j=1, last)]
      allocate (candidate(0), ends(0))
      if (rise(last) <= 0) then
         candidate = [exp(upper)]
         ends = [1]
      end if
      do j = 1, last - 1
         if (.not. (rise(j) <= 0 .and. rise(j + 1) > 0)) cycle
         candidate = [candidate, zero_between(smoother, place(j), place(j + 1))]
         ends = [ends, 0]
      end do
      if (rise(1) > 0) then
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

   !> The strength between two at which the slope of the score rises through zero, by halving down
   !> to the last digit.
   !>
   !> left, right  logs of strengths
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

   !> strength  > 0
   pure type(smoothing_point_t) function point(self, strength)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp), dimension(size(self%beta)) :: gamma, held

      gamma = self%singular**2
      held = strength/(gamma + strength)
      point%strength = strength
      point%misfit = sum((held*self%beta)**2) + self%rest
      point%roughness = sum((self%singular*self%beta/(gamma + strength))**2)
      point%freedom = sum(gamma/(gamma + strength)) + self%smooth
      ! Residuals of nothing but zeros have a score too.
      point%score = self%contrasts*log(max(sum(held*self%beta**2) + self%rest, &
         tiny(strength))) + sum(log(1 + gamma/strength))
   end function point

   !> d score/d log s: min S changes as s |L v|**2. Where it vanishes s |L v|**2/sigma**2 is the
   !> freedom beyond that of the null space.
   pure real(wp) function slope(self, strength)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      type(smoothing_point_t) :: here

      here = self%point(strength)
      slope = self%contrasts*(strength*here%roughness/max(here%misfit + strength*here%roughness, &
         tiny(strength))) - (here%freedom - self%smooth)
   end function slope

   !> v of the least S.
   pure function estimate(self, strength) result(v)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp) :: v(size(self%base))

      v = self%base - matmul(self%rough, self%singular*self%beta/(self%singular**2 + strength))
   end function estimate

   !> (J'J + s L'L)^-1 J'J, which is 1 less what the penalty holds back.
   !>
   !> matrix  (n, n)
   pure function resolution(self, strength) result(matrix)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp) :: matrix(size(self%base), size(self%base))
      integer :: j

      matrix = -matmul(self%rough, self%rows*spread(strength/(self%singular**2 + strength), 2, &
         size(self%base)))
      do j = 1, size(self%base)
         matrix(j, j) = 1 + matrix(j, j)
      end do
   end function resolution

   !> (J'J + s L'L)^-1, the covariance of v in units of the noise's variance.
   !>
   !> matrix  (n, n)
   pure function covariance(self, strength) result(matrix)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp) :: matrix(size(self%base), size(self%base))

      matrix = matmul(self%free, transpose(self%free)) + matmul(self%rough &
         /spread(self%singular**2 + strength, 1, size(self%base)), transpose(self%rough))
   end function covariance

   !> Rows of L for n coefficients of a B-spline of equal spacing: differences between neighbours,
   !> and differences of those, as often as `order` says; null space: polynomials of degree < order.
   !>
   !> rows  (n - order, n), (0, n) for n <= order
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

   !> Effective width of an averaging row a: (sum a)**2/sum(a**2) spacings, k of them for k equal
   !> weights, and less where weights of both signs cancel; 0 of a row of zeros.
   !>
   !> row      (n) weights of values that lie a spacing apart
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
