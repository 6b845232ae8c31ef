!> Explicit interfaces of the MINPACK and LAPACK procedures of the least-squares search.
module beamid_minpack
   use beamid_kinds, only: wp
   implicit none
   private

   public :: dgels, dgelsy, dpotrf, dtrtrs, lmder, lmdif

   abstract interface
      subroutine residual_callback(m, n, x, fvec, iflag)
         import :: wp
         integer, intent(in) :: m, n
         real(wp), intent(in) :: x(n)
         real(wp), intent(inout) :: fvec(m)
         integer, intent(inout) :: iflag
      end subroutine residual_callback
      subroutine jacobian_callback(m, n, x, fvec, fjac, ldfjac, iflag)
         import :: wp
         integer, intent(in) :: m, n, ldfjac
         real(wp), intent(in) :: x(n)
         real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
         integer, intent(inout) :: iflag
      end subroutine jacobian_callback
   end interface

   interface
      subroutine lmdif(fcn, m, n, x, fvec, ftol, xtol, gtol, maxfev, epsfcn, diag, mode, factor, &
         nprint, info, nfev, fjac, ldfjac, ipvt, qtf, wa1, wa2, wa3, wa4)
         import :: wp, residual_callback
         procedure(residual_callback) :: fcn
         integer, intent(in) :: m, n, maxfev, mode, nprint, ldfjac
         real(wp), intent(inout) :: x(n), diag(n)
         real(wp), intent(in) :: ftol, xtol, gtol, epsfcn, factor
         integer, intent(out) :: info, nfev, ipvt(n)
         real(wp), intent(out) :: fvec(m), fjac(ldfjac, n), qtf(n), wa1(n), wa2(n), wa3(n), wa4(m)
      end subroutine lmdif
      subroutine lmder(fcn, m, n, x, fvec, fjac, ldfjac, ftol, xtol, gtol, maxfev, diag, mode, &
         factor, nprint, info, nfev, njev, ipvt, qtf, wa1, wa2, wa3, wa4)
         import :: wp, jacobian_callback
         procedure(jacobian_callback) :: fcn
         integer, intent(in) :: m, n, maxfev, mode, nprint, ldfjac
         real(wp), intent(inout) :: x(n), diag(n)
         real(wp), intent(in) :: ftol, xtol, gtol, factor
         integer, intent(out) :: info, nfev, njev, ipvt(n)
         real(wp), intent(out) :: fvec(m), fjac(ldfjac, n), qtf(n), wa1(n), wa2(n), wa3(n), wa4(m)
      end subroutine lmder
   end interface

   interface
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
   end interface

end module beamid_minpack
