!> The objects that handles stand for: cases and fits.
module beamid_c_objects
   use, intrinsic :: iso_c_binding, only: c_int64_t
   use beamid_c_handles, only: borrow, give_back
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t
   use beamid_errors, only: bad_input, error_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
   implicit none
   private

   public :: problem_t, outcome_t, borrow_problem, borrow_outcome

   !> An open case, with its records if it serves fits.
   type :: problem_t
      type(case_t) :: case                !< the case
      type(case_fit_t) :: loaded          !< its records, before a fit
      logical :: is_for_fits = .false.    !< opened for fits, not for responses
   end type problem_t

   !> A fit of a case.
   type :: outcome_t
      type(case_t) :: case                          !< the case as it was fitted
      type(case_fit_t) :: found                     !< all fits of the case, and the verdict
      type(output_t) :: tables                      !< tables of a judged fit
      !> Texts that the program would print; not allocated: not judged, no inference.
      character(len=:), allocatable :: summary, intervals
      real(wp), allocatable :: modes(:, :)          !< modes with the columns of `beamid_array`
   contains
      procedure :: last_fit
   end type outcome_t

contains

   !> Borrows the case of a handle, which other calls may use at the same time.
   subroutine borrow_problem(handle, problem, error)
      integer(c_int64_t), intent(in) :: handle
      type(problem_t), pointer, intent(out) :: problem
      type(error_t), allocatable, intent(out) :: error
      class(*), pointer :: item
      character(len=*), parameter :: what = 'an open case'

      problem => null()
      call borrow(handle, .false., what, item, error)
      if (allocated(error)) return
      select type (item)
      type is (problem_t); problem => item
      class default
         call give_back(handle)
         call bad_input(error, 'found the handle of a fit, expected '//what)
      end select
   end subroutine borrow_problem

   !> Borrows the fit of a handle, which no other call may use.
   subroutine borrow_outcome(handle, outcome, error)
      integer(c_int64_t), intent(in) :: handle
      type(outcome_t), pointer, intent(out) :: outcome
      type(error_t), allocatable, intent(out) :: error
      class(*), pointer :: item
      character(len=*), parameter :: what = 'a fit'

      outcome => null()
      call borrow(handle, .true., what, item, error)
      if (allocated(error)) return
      select type (item)
      type is (outcome_t); outcome => item
      class default
         call give_back(handle)
         call bad_input(error, 'found the handle of a case, expected '//what)
      end select
   end subroutine borrow_outcome

   !> Returns the fit of the last stage on the last mesh.
   function last_fit(self) result(fit)
      class(outcome_t), intent(in), target :: self
      type(stage_fit_t), pointer :: fit

      fit => self%found%fits(size(self%found%fits, 1), size(self%found%fits, 2))
   end function last_fit

end module beamid_c_objects
