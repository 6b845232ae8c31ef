!> Interfaces of contexts, as the Fortran modules of SUNDIALS 6.4 declare them.
!>
!> Only scripts/flang.sh reads this file: SUNDIALS is installed with module files of gfortran, which
!> no other compiler can read.
module fsundials_context_mod
   use, intrinsic :: iso_c_binding, only: c_int, c_ptr
   implicit none
   private

   public :: FSUNContext_Create, FSUNContext_Free

   interface
      integer(c_int) function FSUNContext_Create(comm, ctx)
         import :: c_int, c_ptr
         type(c_ptr), intent(in) :: comm
         type(c_ptr), target, intent(inout) :: ctx
      end function FSUNContext_Create

      integer(c_int) function FSUNContext_Free(ctx)
         import :: c_int, c_ptr
         type(c_ptr), target, intent(inout) :: ctx
      end function FSUNContext_Free
   end interface

end module fsundials_context_mod
