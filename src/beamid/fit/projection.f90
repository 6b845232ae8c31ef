!> Eliminates unknowns that enter linearly (variable projection: Golub and Pereyra, SIAM J. Numer.
!> Anal. 10, 1973, 413): r(p) = y + Phi c with the c that minimises |r|, and the derivative of r(p)
!> with c(p) eliminated. Residuals of free motions use it for amplitudes and offset.
module beamid_projection
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeqrf, dorgqr, dtrtrs
   use beamid_strings, only: to_text
   implicit none
   private

   public :: projection_t, new_projection

   !> QR decomposition of Phi (m, k).
   type :: projection_t
      real(wp), allocatable :: q(:, :)   !< (m, k) orthonormal basis of the columns of Phi
      real(wp), allocatable :: r(:, :)   !< (k, k) Phi = q r, upper triangle
   contains
      procedure :: coefficients, derivatives
   end type projection_t

contains

   !> Decomposes the columns of the linear unknowns.
   !>
   !> phi    (m, k) Phi, m >= k
   !> error  fewer samples than unknowns, or dependent columns: the samples cannot tell the unknowns
   !>        apart
   subroutine new_projection(phi, projection, error)
      real(wp), intent(in) :: phi(:, :)
      type(projection_t), intent(out) :: projection
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: tau(:), work(:), length(:)
      integer :: m, k, j, info

      m = size(phi, 1)
      k = size(phi, 2)
      if (m < k) then
         call failure(error, 'projection: '//to_text(m)//' samples for '//to_text(k)// &
            ' linear unknowns')
         return
      end if
      allocate (tau(k), work(64*max(k, 1)), projection%r(k, k))
      projection%q = phi
      length = norm2(phi, dim=1)
      call dgeqrf(m, k, projection%q, max(1, m), tau, work, size(work), info)
      projection%r = 0
      do j = 1, k
         projection%r(:j, j) = projection%q(:j, j)
         if (abs(projection%r(j, j)) > 1e-10_wp*length(j)) cycle
         call failure(error, &
            'the samples cannot tell the motions of the modes and the offset apart')
         return
      end do
      call dorgqr(m, k, k, projection%q, max(1, m), tau, work, size(work), info)
   end subroutine new_projection

   !> Computes the linear unknowns and the remaining residuals.
   !>
   !> y  (m) on entry the residuals for c = 0, on return r = y + Phi c
   !> c  (k) the linear unknowns
   subroutine coefficients(self, y, c)
      class(projection_t), intent(in) :: self
      real(wp), intent(inout) :: y(:)
      real(wp), intent(out) :: c(:)
      real(wp) :: b(size(c), 1)
      integer :: info, k

      k = size(c)
      b(:, 1) = matmul(y, self%q)
      y = y - matmul(self%q, b(:, 1))
      call dtrtrs('U', 'N', 'N', k, 1, self%r, max(1, k), b, max(1, k), info)
      c = -b(:, 1)
   end subroutine coefficients

   !> Computes dr/dp of the residuals with c(p) eliminated, for each parameter p.
   !>
   !> along   (k, parameters) (dPhi/dp)'r, where r are the residuals
   !> slopes  (m, parameters) on entry dy/dp + (dPhi/dp) c with c fixed, on return dr/dp
   !> dc      (k, parameters) dc/dp
   subroutine derivatives(self, along, slopes, dc)
      class(projection_t), intent(in) :: self
      real(wp), intent(in) :: along(:, :)
      real(wp), intent(inout) :: slopes(:, :)
      real(wp), intent(out), optional :: dc(:, :)
      real(wp) :: b(size(along, 1), size(along, 2))
      integer :: info, k

      k = size(b, 1)
      b = along
      call dtrtrs('U', 'T', 'N', k, size(b, 2), self%r, max(1, k), b, max(1, k), info)
      b = matmul(transpose(self%q), slopes) + b
      slopes = slopes - matmul(self%q, b)
      if (.not. present(dc)) return
      call dtrtrs('U', 'N', 'N', k, size(b, 2), self%r, max(1, k), b, max(1, k), info)
      dc = -b
   end subroutine derivatives

end module beamid_projection
