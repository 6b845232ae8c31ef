!> Interfaces of vectors, as the Fortran modules of SUNDIALS 6.4 declare them.
!>
!> Only scripts/flang.sh reads this file: SUNDIALS is installed with module files of gfortran, which
!> no other compiler can read.
module fsundials_nvector_mod
   use, intrinsic :: iso_c_binding, only: c_ptr
   implicit none
   private

   public :: FN_VDestroy, N_Vector

   type, bind(c) :: N_Vector
      type(c_ptr) :: content, ops, sunctx
   end type N_Vector

   interface
      subroutine FN_VDestroy(v)
         import :: N_Vector
         type(N_Vector), target, intent(inout) :: v
      end subroutine FN_VDestroy
   end interface

end module fsundials_nvector_mod
