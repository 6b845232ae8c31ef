!> Explicit interfaces of LAPACK's procedures for full matrices. A procedure that only one module
!> calls may have its interface there.
module beamid_lapack
   use beamid_kinds, only: wp
   implicit none
   private

   public :: dgeev, dgels, dgelsy, dgeqrf, dgesv, dgesvd, dorgqr, dposv, dpotrf, dtrtrs

   interface
      subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
         import :: wp
         character, intent(in) :: jobvl, jobvr
         integer, intent(in) :: n, lda, ldvl, ldvr, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), work(*)
         integer, intent(out) :: info
      end subroutine dgeev
      subroutine dgels(trans, m, n, nrhs, a, lda, b, ldb, work, lwork, info)
         import :: wp
         character, intent(in) :: trans
         integer, intent(in) :: m, n, nrhs, lda, ldb, lwork
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         real(wp), intent(out) :: work(*)
         integer, intent(out) :: info
      end subroutine dgels
      subroutine dgelsy(m, n, nrhs, a, lda, b, ldb, jpvt, rcond, rank, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, nrhs, lda, ldb, lwork
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(inout) :: jpvt(*)
         real(wp), intent(in) :: rcond
         integer, intent(out) :: rank, info
         real(wp), intent(out) :: work(*)
      end subroutine dgelsy
      subroutine dgeqrf(m, n, a, lda, tau, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: tau(*), work(*)
         integer, intent(out) :: info
      end subroutine dgeqrf
      subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
         import :: wp
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: ipiv(*), info
      end subroutine dgesv
      subroutine dgesvd(jobu, jobvt, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, info)
         import :: wp
         character, intent(in) :: jobu, jobvt
         integer, intent(in) :: m, n, lda, ldu, ldvt, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(out) :: s(*), u(ldu, *), vt(ldvt, *), work(*)
         integer, intent(out) :: info
      end subroutine dgesvd
      subroutine dorgqr(m, n, k, a, lda, tau, work, lwork, info)
         import :: wp
         integer, intent(in) :: m, n, k, lda, lwork
         real(wp), intent(inout) :: a(lda, *)
         real(wp), intent(in) :: tau(*)
         real(wp), intent(out) :: work(*)
         integer, intent(out) :: info
      end subroutine dorgqr
      subroutine dposv(uplo, n, nrhs, a, lda, b, ldb, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         integer, intent(out) :: info
      end subroutine dposv
      subroutine dpotrf(uplo, n, a, lda, info)
         import :: wp
         character, intent(in) :: uplo
         integer, intent(in) :: n, lda
         real(wp), intent(inout) :: a(lda, *)
         integer, intent(out) :: info
      end subroutine dpotrf
      subroutine dtrtrs(uplo, trans, diag, n, nrhs, a, lda, b, ldb, info)
         import :: wp
         character, intent(in) :: uplo, trans, diag
         integer, intent(in) :: n, nrhs, lda, ldb
         real(wp), intent(in) :: a(lda, *)
         real(wp), intent(inout) :: b(ldb, *)
         integer, intent(out) :: info
      end subroutine dtrtrs
   end interface

end module beamid_lapack
