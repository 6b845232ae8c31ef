!> Interfaces of the integrator CVODE, as the Fortran modules of SUNDIALS 6.4 declare them.
!>
!> Only scripts/flang.sh reads this file: SUNDIALS is installed with module files of gfortran, which
!> no other compiler can read.
module fcvode_mod
   use, intrinsic :: iso_c_binding, only: c_double, c_funptr, c_int, c_ptr
   use fsundials_nvector_mod, only: N_Vector
   implicit none
   private

   public :: FCVode, FCVodeCreate, FCVodeFree, FCVodeGetCurrentGamma, FCVodeGetDky, FCVodeInit, &
      FCVodeReInit, FCVodeSetErrHandlerFn, FCVodeSetMaxOrd, FCVodeSetStabLimDet, &
      FCVodeSetStopTime, FCVodeSetUserData, FCVodeSVtolerances

   integer(c_int), parameter, public :: CV_BDF = 2, CV_ONE_STEP = 2

   interface
      integer(c_int) function FCVode(cvode_mem, tout, yout, tret, itask)
         import :: c_double, c_int, c_ptr, N_Vector
         type(c_ptr), intent(in) :: cvode_mem
         real(c_double), intent(in) :: tout
         type(N_Vector), target, intent(inout) :: yout
         real(c_double), target, intent(inout) :: tret(*)
         integer(c_int), intent(in) :: itask
      end function FCVode

      function FCVodeCreate(lmm, sunctx) result(memory)
         import :: c_int, c_ptr
         integer(c_int), intent(in) :: lmm
         type(c_ptr), intent(in) :: sunctx
         type(c_ptr) :: memory
      end function FCVodeCreate

      subroutine FCVodeFree(cvode_mem)
         import :: c_ptr
         type(c_ptr), target, intent(inout) :: cvode_mem
      end subroutine FCVodeFree

      integer(c_int) function FCVodeGetCurrentGamma(cvode_mem, gamma)
         import :: c_double, c_int, c_ptr
         type(c_ptr), intent(in) :: cvode_mem
         real(c_double), target, intent(inout) :: gamma(*)
      end function FCVodeGetCurrentGamma

      integer(c_int) function FCVodeGetDky(cvode_mem, t, k, dky)
         import :: c_double, c_int, c_ptr, N_Vector
         type(c_ptr), intent(in) :: cvode_mem
         real(c_double), intent(in) :: t
         integer(c_int), intent(in) :: k
         type(N_Vector), target, intent(inout) :: dky
      end function FCVodeGetDky

      integer(c_int) function FCVodeInit(cvode_mem, f, t0, y0)
         import :: c_double, c_funptr, c_int, c_ptr, N_Vector
         type(c_ptr), intent(in) :: cvode_mem
         type(c_funptr), intent(in), value :: f
         real(c_double), intent(in) :: t0
         type(N_Vector), target, intent(inout) :: y0
      end function FCVodeInit

      integer(c_int) function FCVodeReInit(cvode_mem, t0, y0)
         import :: c_double, c_int, c_ptr, N_Vector
         type(c_ptr), intent(in) :: cvode_mem
         real(c_double), intent(in) :: t0
         type(N_Vector), target, intent(inout) :: y0
      end function FCVodeReInit

      integer(c_int) function FCVodeSetErrHandlerFn(cvode_mem, ehfun, eh_data)
         import :: c_funptr, c_int, c_ptr
         type(c_ptr), intent(in) :: cvode_mem, eh_data
         type(c_funptr), intent(in), value :: ehfun
      end function FCVodeSetErrHandlerFn

      integer(c_int) function FCVodeSetMaxOrd(cvode_mem, maxord)
         import :: c_int, c_ptr
         type(c_ptr), intent(in) :: cvode_mem
         integer(c_int), intent(in) :: maxord
      end function FCVodeSetMaxOrd

      integer(c_int) function FCVodeSetStabLimDet(cvode_mem, stldet)
         import :: c_int, c_ptr
         type(c_ptr), intent(in) :: cvode_mem
         integer(c_int), intent(in) :: stldet
      end function FCVodeSetStabLimDet

      integer(c_int) function FCVodeSetStopTime(cvode_mem, tstop)
         import :: c_double, c_int, c_ptr
         type(c_ptr), intent(in) :: cvode_mem
         real(c_double), intent(in) :: tstop
      end function FCVodeSetStopTime

      integer(c_int) function FCVodeSetUserData(cvode_mem, user_data)
         import :: c_int, c_ptr
         type(c_ptr), intent(in) :: cvode_mem, user_data
      end function FCVodeSetUserData

      integer(c_int) function FCVodeSVtolerances(cvode_mem, reltol, abstol)
         import :: c_double, c_int, c_ptr, N_Vector
         type(c_ptr), intent(in) :: cvode_mem
         real(c_double), intent(in) :: reltol
         type(N_Vector), target, intent(inout) :: abstol
      end function FCVodeSVtolerances
   end interface

end module fcvode_mod
