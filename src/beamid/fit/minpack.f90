!> Declares explicit interfaces of the MINPACK procedures `lmdif` and `lmder`, which
!> `beamid_searches` calls. The names of the arguments are MINPACK's.
module beamid_minpack
   use beamid_kinds, only: wp
   implicit none
   private

   public :: lmder, lmdif

   abstract interface
      !> Computes the residuals fvec (m) at x (n); iflag < 0 on return stops the search.
      subroutine residual_callback(m, n, x, fvec, iflag)
         import :: wp
         integer, intent(in) :: m, n
         real(wp), intent(in) :: x(n)
         real(wp), intent(inout) :: fvec(m)
         integer, intent(inout) :: iflag
      end subroutine residual_callback
      !> Computes the residuals fvec (m) for iflag = 1, or the Jacobian fjac (m, n) for iflag = 2.
      subroutine jacobian_callback(m, n, x, fvec, fjac, ldfjac, iflag)
         import :: wp
         integer, intent(in) :: m, n, ldfjac
         real(wp), intent(in) :: x(n)
         real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
         integer, intent(inout) :: iflag
      end subroutine jacobian_callback
   end interface

   interface
      !> Minimises a sum of squares with forward differences in place of derivatives.
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
      !> Minimises a sum of squares with exact derivatives.
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

end module beamid_minpack
