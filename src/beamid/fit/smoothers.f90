!> Transforms penalised least-squares problems to a diagonal form in which fits for any strength of
!> the penalty, and their restricted likelihood, cost few operations. `beamid_smoothing` chooses the
!> strength with this module and explains the symbols.
!>
!> With N a basis of the null space of L, any v is N b + L^+ w, w = L v. b is eliminated by the QR
!> decomposition of J N (Elden, BIT 17, 1977, 134). J N must have full rank; this is the only
!> condition for J'J + s L'L to be regular for s > 0. The singular values of the remaining rows of
!> J L^+ are the square roots of gamma_i, the generalized eigenvalues of J'J and L'L outside the
!> null space. Then
!>
!>     score(s) = (m - q) log min S + sum log(1 + gamma_i/s).
module beamid_smoothers
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeqrf, dgesvd, dtrtrs
   use beamid_strings, only: to_text
   implicit none
   private

   public :: smoother_t, smoothing_point_t, new_smoother

   !> A penalised fit at one strength of the penalty.
   type :: smoothing_point_t
      real(wp) :: strength = 0    !< s
      real(wp) :: misfit = 0      !< |r|**2 of the linearised problem
      real(wp) :: roughness = 0   !< |L v|**2
      !> Effective degrees of freedom of the penalised parameters: the trace of (J'J + s L'L)^-1 J'J
      !> less the number of zero columns of L. From the dimension of the null space of L in the
      !> other columns, for large s, to the number of these columns or the rank that J gives them,
      !> for s = 0.
      real(wp) :: freedom = 0
      real(wp) :: score = 0       !< -2 log restricted likelihood, up to a constant
   end type smoothing_point_t

   !> The linearised problem in coordinates z (k) in which the penalty is s |z|**2, and the
   !> residuals are beta + singular*z and a remainder that does not depend on z. Here
   !> v = null_fit + basis z, z = rows v, and L'L = rows' rows.
   type :: smoother_t
      integer :: contrasts = 0                    !< m - q, number of error contrasts
      integer :: min_freedom = 0                  !< `freedom` for large s
      real(wp) :: unexplained = 0                 !< sum of squares of the remainder
      real(wp), allocatable :: singular(:)        !< (k) sqrt(gamma); 0 for round-off
      real(wp), allocatable :: beta(:)            !< (k) residuals at z = 0
      real(wp), allocatable :: null_fit(:)        !< (n) the fit within the null space of L
      real(wp), allocatable :: basis(:, :)        !< (n, k) generalized eigenvectors
      real(wp), allocatable :: null_basis(:, :)   !< (n, q) N with orthonormal J N
      real(wp), allocatable :: rows(:, :)         !< (k, n)
   contains
      procedure :: point, slope, estimate, resolution, covariance
   end type smoother_t

   !> Lengths below this share of their natural size are round-off; for ranks.
   real(wp), parameter :: round_off = 1e-12_wp

   interface
      !> LAPACK: QR decomposition with column pivoting.
      subroutine dgeqp3(m, n, a, lda, jpvt, tau, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(inout) :: jpvt(*)
         real(wp), intent(out) :: tau(*), work(*)
         integer, intent(out) :: info
      end subroutine dgeqp3
      !> LAPACK: multiplies a matrix by Q of a QR decomposition.
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

   !> Transforms a linearised problem with a penalty to diagonal form.
   !>
   !> jacobian  (m, n) J of the residuals without the penalty
   !> residual  (m) r
   !> at        (n) v0, parameters at which these residuals hold
   !> penalty   (p, n) L; a zero column for a parameter without penalty
   !> error     values that are not finite; L = 0; no residuals beside those for the null space of
   !>           L; a combination of parameters that changes neither the residuals nor the penalty
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
      ! Units of the parameters: each column of the penalty gets length 1; if it is zero, the column
      ! of J. Units from J alone would spoil the condition of the penalty, because some parameters
      ! have little effect on the data.
      length = norm2(penalty, dim=1)
      smoother%min_freedom = count(length > 0)
      call split_penalty(penalty, length, image, null_space, smoother%rows, error)
      if (allocated(error)) return
      smoother%min_freedom = smoother%min_freedom - size(image, 2)
      q = size(null_space, 2)
      smoother%contrasts = m - q
      if (m <= q) then
         call failure(error, 'smoothing: '//to_text(m)//' residuals for '//to_text(q)// &
            ' parameters that no penalty holds')
         return
      end if
      where (.not. length > 0) length = norm2(jacobian, dim=1)
      where (.not. length > 0) length = 1
      a = reduce_by_qr(jacobian, residual, length)
      smoother%unexplained = a(n + 1, n + 1)**2
      call make_diagonal(a(:n, :), image, null_space, at, smoother, length, error)
   end subroutine new_smoother

   !> Splits the space of parameters into the part that the penalty acts on and its null space, by a
   !> singular value decomposition of the penalty with columns of length 1.
   !>
   !> penalty     (p, n) L
   !> length      (n) of its columns
   !> image       (n, k) L^+, for orthonormal coordinates of L v
   !> null_space  (n, q) orthonormal; parameters without penalty have columns of their own
   !> rows        (k, n) L for these coordinates, in the caller's units
   !> error       L = 0, or a decomposition that does not converge
   subroutine split_penalty(penalty, length, image, null_space, rows, error)
      real(wp), intent(in) :: penalty(:, :), length(:)
      real(wp), allocatable, intent(out) :: image(:, :), null_space(:, :), rows(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: penalised(:), unpenalised(:)
      real(wp), allocatable :: scaled(:, :), singular(:), vt(:, :), work(:)
      real(wp) :: unused(1, 1)
      integer :: info, j, k, n, p

      n = size(length)
      penalised = pack([(j, j=1, n)], length > 0)
      unpenalised = pack([(j, j=1, n)], .not. length > 0)
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
      do j = 1, size(unpenalised)
         null_space(unpenalised(j), j) = 1
      end do
      do j = k + 1, size(penalised)
         null_space(penalised, size(unpenalised) + j - k) = vt(j, :)
      end do
   end subroutine split_penalty

   !> Returns the triangle of the QR decomposition of the Jacobian with the residual as last column,
   !> (n + 1, n + 1).
   !>
   !> jacobian  (m, n)
   !> residual  (m)
   !> length    (n) unit of each column
   function reduce_by_qr(jacobian, residual, length) result(a)
      real(wp), intent(in) :: jacobian(:, :), residual(:), length(:)
      real(wp), allocatable :: a(:, :)
      real(wp), allocatable :: augmented(:, :), tau(:), work(:)
      integer :: info, j, m, n

      ! Rows of zeros where there are fewer residuals than parameters.
      m = max(size(jacobian, 1), size(jacobian, 2) + 1)
      n = size(jacobian, 2)
      allocate (augmented(m, n + 1), a(n + 1, n + 1), source=0.0_wp)
      allocate (tau(n + 1), work(64*(n + 1)))
      do j = 1, n
         augmented(:size(residual), j) = jacobian(:, j)/length(j)
      end do
      augmented(:size(residual), n + 1) = residual
      call dgeqrf(m, n + 1, augmented, m, tau, work, size(work), info)
      do j = 1, n + 1
         a(:j, j) = augmented(:j, j)
      end do
   end function reduce_by_qr

   !> Transforms a penalised least-squares problem to diagonal form.
   !>
   !> a           (n, n + 1) J and r, reduced
   !> image       (n, k) as in `split_penalty`
   !> null_space  (n, q) as in `split_penalty`; undefined on return
   !> at          (n) in the caller's units
   !> smoother    on entry with `contrasts`, `rows` and the other numbers, on return complete
   !> length      (n) units of the columns of J
   !> error       a combination of parameters changes neither the residuals nor the penalty
   subroutine make_diagonal(a, image, null_space, at, smoother, length, error)
      real(wp), intent(in) :: a(:, :), image(:, :), at(:), length(:)
      real(wp), intent(inout) :: null_space(:, :)
      type(smoother_t), intent(inout) :: smoother
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: reflected(:, :), response(:, :), basis(:, :), u(:, :), vt(:, :), &
         work(:), left(:, :)
      real(wp) :: noise
      integer :: info, k, n, q

      n = size(at)
      k = size(image, 2)
      q = size(null_space, 2)
      allocate (reflected(n, k + 1))
      reflected(:, :k) = matmul(a(:, :n), image)
      reflected(:, k + 1) = a(:, n + 1)
      noise = n*epsilon(noise)*norm2(reflected(:, :k))
      call eliminate_null_space(a(:, :n), null_space, reflected, response, basis, error)
      if (allocated(error)) return
      allocate (work(10*k), u(k, k), vt(k, k), smoother%singular(k))
      left = reflected(q + 1:, :k)
      call dgesvd('A', 'A', k, k, left, k, smoother%singular, u, k, vt, k, work, size(work), info)
      if (info /= 0) then
         call no_convergence(error)
         return
      end if
      where (smoother%singular <= noise) smoother%singular = 0

      smoother%null_basis = transpose(basis)/spread(length, 2, q)
      smoother%basis = matmul(image - matmul(null_space, response(:, :k)), transpose(vt)) &
         /spread(length, 2, k)
      smoother%rows = matmul(vt, smoother%rows)
      smoother%beta = matmul(reflected(q + 1:, k + 1), u) &
         - smoother%singular*matmul(smoother%rows, at)
      smoother%null_fit = at - matmul(null_space, response(:, k + 1))/length &
         - matmul(smoother%basis, matmul(smoother%rows, at))
   end subroutine make_diagonal

   !> Eliminates the null space of the penalty by a QR decomposition of J N with column pivoting.
   !>
   !> jacobian    (n, n) J, reduced
   !> null_space  (n, q) N; on return with scaled and permuted columns
   !> reflected   (n, k + 1) columns of J L^+ and r; on return multiplied by Q'
   !> response    (q, k + 1) coefficients of N that fit these columns
   !> basis       (q, n) transpose of the N for which J N is orthonormal
   !> error       a combination of parameters changes neither the residuals nor the penalty
   subroutine eliminate_null_space(jacobian, null_space, reflected, response, basis, error)
      real(wp), intent(in) :: jacobian(:, :)
      real(wp), intent(inout) :: null_space(:, :), reflected(:, :)
      real(wp), allocatable, intent(out) :: response(:, :), basis(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: columns(:, :), work(:), tau(:), reach(:)
      integer, allocatable :: pivot(:)
      integer :: info, j, n, q

      n = size(null_space, 1)
      q = size(null_space, 2)
      ! Each column of N is scaled by the length that the terms of its column of J N would add up to
      ! without cancellation: a column of J N that is round-off then has the length of round-off.
      reach = matmul(norm2(jacobian, dim=1), abs(null_space))
      do j = 1, q
         if (reach(j) > 0) null_space(:, j) = null_space(:, j)/reach(j)
      end do
      allocate (pivot(q), tau(q), work(64*(n + 1)))
      pivot = 0
      columns = matmul(jacobian, null_space)
      call dgeqp3(n, q, columns, n, pivot, tau, work, size(work), info)
      j = count([(abs(columns(j, j)) <= round_off, j=1, q)])
      if (j > 0) then
         call failure(error, 'smoothing: neither the residuals nor the penalty determine '// &
            to_text(j)//' of the parameters, or combinations of them')
         return
      end if
      null_space = null_space(:, pivot)
      call dormqr('L', 'T', n, size(reflected, 2), q, columns, n, tau, reflected, n, work, &
         size(work), info)
      response = reflected(:q, :)
      basis = transpose(null_space)
      if (q > 0) then
         call dtrtrs('U', 'N', 'N', q, size(reflected, 2), columns, n, response, q, info)
         call dtrtrs('U', 'T', 'N', q, n, columns, n, basis, q, info)
      end if
   end subroutine eliminate_null_space

   !> Makes the error of a singular value decomposition that does not converge.
   pure subroutine no_convergence(error)
      type(error_t), allocatable, intent(out) :: error

      call failure(error, 'smoothing: a singular value decomposition did not converge')
   end subroutine no_convergence

   !> Computes the fit and the score at a strength > 0.
   pure type(smoothing_point_t) function point(self, strength)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp), dimension(size(self%beta)) :: gamma, penalty_share

      gamma = self%singular**2
      penalty_share = strength/(gamma + strength)
      point%strength = strength
      point%misfit = sum((penalty_share*self%beta)**2) + self%unexplained
      point%roughness = sum((self%singular*self%beta/(gamma + strength))**2)
      point%freedom = sum(gamma/(gamma + strength)) + self%min_freedom
      ! The limit gives a score also if all residuals are zero.
      point%score = self%contrasts*log(max(sum(penalty_share*self%beta**2) + self%unexplained, &
         tiny(strength))) + sum(log(1 + gamma/strength))
   end function point

   !> Returns d score/d log s, since d min S/d log s = s |L v|**2. At a zero, s |L v|**2/sigma**2 is
   !> the number of effective degrees of freedom beyond the null space.
   pure real(wp) function slope(self, strength)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      type(smoothing_point_t) :: here

      here = self%point(strength)
      slope = self%contrasts*(strength*here%roughness/max(here%misfit + strength*here%roughness, &
         tiny(strength))) - (here%freedom - self%min_freedom)
   end function slope

   !> Returns v, (n), of the least S.
   pure function estimate(self, strength) result(v)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp) :: v(size(self%null_fit))

      v = self%null_fit - matmul(self%basis, self%singular*self%beta/(self%singular**2 + strength))
   end function estimate

   !> Returns the resolution matrix (J'J + s L'L)^-1 J'J, (n, n): the identity less the effect of
   !> the penalty.
   pure function resolution(self, strength) result(matrix)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp) :: matrix(size(self%null_fit), size(self%null_fit))
      integer :: j

      matrix = -matmul(self%basis, self%rows*spread(strength/(self%singular**2 + strength), 2, &
         size(self%null_fit)))
      do j = 1, size(self%null_fit)
         matrix(j, j) = 1 + matrix(j, j)
      end do
   end function resolution

   !> Returns (J'J + s L'L)^-1, (n, n): the covariance of v for noise of unit variance.
   pure function covariance(self, strength) result(matrix)
      class(smoother_t), intent(in) :: self
      real(wp), intent(in) :: strength
      real(wp) :: matrix(size(self%null_fit), size(self%null_fit))

      matrix = matmul(self%null_basis, transpose(self%null_basis)) + matmul(self%basis &
         /spread(self%singular**2 + strength, 1, size(self%null_fit)), transpose(self%basis))
   end function covariance

end module beamid_smoothers
