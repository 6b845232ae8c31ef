!> Interfaces of linear solvers, as the Fortran modules of SUNDIALS 6.4 declare them.
!>
!> Only scripts/flang.sh reads this file: SUNDIALS is installed with module files of gfortran, which
!> no other compiler can read.
module fsundials_linearsolver_mod
   use, intrinsic :: iso_c_binding, only: c_funptr, c_int, c_ptr
   implicit none
   private

   public :: FSUNLinSolFreeEmpty, FSUNLinSolNewEmpty, SUNLinearSolver, SUNLinearSolver_Ops

   integer(c_int), parameter, public :: SUNLINEARSOLVER_MATRIX_EMBEDDED = 3

   type, bind(c) :: SUNLinearSolver_Ops
      type(c_funptr) :: gettype, getid, setatimes, setpreconditioner, setscalingvectors, &
         setzeroguess, initialize, setup, solve, numiters, resnorm, lastflag, space, resid, free
   end type SUNLinearSolver_Ops

   type, bind(c) :: SUNLinearSolver
      type(c_ptr) :: content, ops, sunctx
   end type SUNLinearSolver

   interface
      subroutine FSUNLinSolFreeEmpty(s)
         import :: SUNLinearSolver
         type(SUNLinearSolver), target, intent(inout) :: s
      end subroutine FSUNLinSolFreeEmpty

      function FSUNLinSolNewEmpty(sunctx) result(solver)
         import :: c_ptr, SUNLinearSolver
         type(c_ptr), intent(in) :: sunctx
         type(SUNLinearSolver), pointer :: solver
      end function FSUNLinSolNewEmpty
   end interface

end module fsundials_linearsolver_mod
