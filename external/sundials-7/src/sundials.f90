!> What beamid uses of SUNDIALS 7: the names of its Fortran modules in one place, and what differs
!> from version 6, `create_cvode`.
module sundials
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_pointer, c_funloc, &
      c_int, c_int64_t, c_loc, c_null_char, c_null_ptr, c_ptr
   use fcvode_mod, only: CV_BDF, CV_ONE_STEP, FCVode, FCVodeCreate, FCVodeFree, &
      FCVodeGetCurrentGamma, FCVodeGetDky, FCVodeInit, FCVodeReInit, FCVodeSetMaxOrd, &
      FCVodeSetStabLimDet, FCVodeSetStopTime, FCVodeSetUserData, FCVodeSVtolerances
   use fsundials_core_mod, only: FN_VDestroy, FSUNContext_ClearErrHandlers, FSUNContext_Create, &
      FSUNContext_Free, FSUNContext_GetLogger, FSUNContext_PushErrHandler, FSUNLinSolFreeEmpty, &
      FSUNLinSolNewEmpty, FSUNLogger_SetWarningFilename, N_Vector, SUN_COMM_NULL, &
      SUNLinearSolver, SUNLinearSolver_Ops, SUNLINEARSOLVER_MATRIX_EMBEDDED
   implicit none
   private

   public :: CV_ONE_STEP, FCVode, FCVodeFree, FCVodeGetCurrentGamma, FCVodeGetDky, FCVodeInit, &
      FCVodeReInit, FCVodeSetMaxOrd, FCVodeSetStabLimDet, FCVodeSetStopTime, FCVodeSetUserData, &
      FCVodeSVtolerances, FN_VDestroy, FSUNContext_Free, FSUNLinSolFreeEmpty, FSUNLinSolNewEmpty, &
      N_Vector, SUNLinearSolver, SUNLinearSolver_Ops, &
      SUNLINEARSOLVER_MATRIX_EMBEDDED
   public :: complaint_t, create_cvode, new_vector

   !> The last error message of SUNDIALS, which is kept instead of being printed.
   type :: complaint_t
      character(len=:), allocatable :: text
   end type complaint_t

   interface
      !> N_VMake_Serial (nvector_serial.h). A sunindextype has 32 or 64 bits, as the library was
      !> built; where arguments travel in registers of 64 bits, this serves both.
      function make_serial(length, values, context) bind(c, name='N_VMake_Serial') result(vector)
         import :: c_double, c_int64_t, c_ptr
         integer(c_int64_t), value :: length
         real(c_double), intent(in) :: values(*)
         type(c_ptr), value :: context
         type(c_ptr) :: vector
      end function make_serial
   end interface

contains

   !> A vector on an array that outlives it; null where it could not be made.
   function new_vector(values, context) result(vector)
      real(c_double), intent(in), target, contiguous :: values(:)
      type(c_ptr), intent(in) :: context
      type(N_Vector), pointer :: vector
      type(c_ptr) :: address

      vector => null()
      address = make_serial(size(values, kind=c_int64_t), values, context)
      if (c_associated(address)) call c_f_pointer(address, vector)
   end function new_vector

   !> A context and the memory of a BDF integrator in it.
   !>
   !> complaint        keeps the messages; stays where it is as long as the memory lives
   !> context, memory  null where they could not be made
   !> flag             negative on failure
   subroutine create_cvode(complaint, context, memory, flag)
      type(complaint_t), intent(in), target :: complaint
      type(c_ptr), intent(out) :: context, memory
      integer(c_int), intent(out) :: flag
      type(c_ptr) :: logger

      memory = c_null_ptr
      flag = FSUNContext_Create(SUN_COMM_NULL, context)
      if (flag < 0) return
      ! The context comes with a handler that prints, and with a logger that prints warnings; the
      ! latter takes the name of another file only.
      flag = FSUNContext_GetLogger(context, logger)
      if (flag == 0) flag = FSUNLogger_SetWarningFilename(logger, '/dev/null')
      if (flag == 0) flag = FSUNContext_ClearErrHandlers(context)
      if (flag == 0) flag = FSUNContext_PushErrHandler(context, c_funloc(keep_message), &
         c_loc(complaint))
      if (flag < 0) return
      memory = FCVodeCreate(CV_BDF, context)
      if (.not. c_associated(memory)) flag = -1
   end subroutine create_cvode

   !> SUNErrHandlerFn; warnings have codes above zero.
   subroutine keep_message(line, function_name, file_name, message, code, user_data, context) &
      bind(c)
      integer(c_int), value :: line, code
      type(c_ptr), value :: function_name, file_name, message, user_data, context
      type(complaint_t), pointer :: complaint
      character(kind=c_char), pointer :: text(:)
      integer :: length

      if (code >= 0 .or. line < 0 .or. .not. (c_associated(function_name) .and. &
         c_associated(file_name) .and. c_associated(context) .and. c_associated(message))) return
      call c_f_pointer(user_data, complaint)
      call c_f_pointer(message, text, [1000])
      do length = 0, size(text) - 1
         if (text(length + 1) == c_null_char) exit
      end do
      complaint%text = transfer(text(:length), repeat(' ', length))
   end subroutine keep_message

end module sundials
