!> Handles: numbers that stand for the objects that C holds, cases and fits. No number is used
!> twice, so a null, invented or closed handle is an error and never leads to another object.
module beamid_c_handles
   use, intrinsic :: iso_c_binding, only: c_int64_t
   use beamid_c_calls, only: check_fork
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t
   use beamid_errors, only: bad_input, error_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
   implicit none
   private

   public :: problem_t, outcome_t, new_handle, borrow, borrow_problem, borrow_outcome, give_back, &
      close_handle

   !> One place of the table of objects.
   type :: slot_t
      class(*), pointer :: item => null()   !< the object
      integer(c_int64_t) :: handle = 0    !< handle of the object; 0: the slot is vacant
      integer :: borrowers = 0            !< number of calls that use the object
      logical :: lent_alone = .false.     !< the object is lent to one call that may change it
      integer :: next_vacant = 0          !< next slot in the list of vacant slots; 0: none
   end type slot_t

   !> Factor of a handle, which is a serial number times this plus the place of the slot.
   integer(c_int64_t), parameter :: most_slots = 2_c_int64_t**24

   !> The table of objects, its first vacant slot (0: none), and the number of handles so far.
   type(slot_t), allocatable, save :: slots(:)
   integer, save :: first_vacant = 0
   integer(c_int64_t), save :: serial = 0

   !> An open case, with its records if it serves fits.
   type :: problem_t
      type(case_t) :: case                !< the case
      type(case_fit_t) :: loaded          !< its records, before a fit
      logical :: is_for_fits = .false.    !< opened for fits, not for responses
   end type problem_t

   !> A fit of a case, or the results of another command (`beamid_run`), which are tables and a
   !> summary alone.
   type :: outcome_t
      type(case_t) :: case                          !< the case as it was fitted
      type(case_fit_t) :: found                     !< all fits of the case, and the verdict
      type(output_t) :: tables                      !< tables of a judged fit
      !> Texts that the program would print; not allocated: not judged, no inference.
      character(len=:), allocatable :: summary, intervals
      real(wp), allocatable :: modes(:, :)          !< modes with the columns of `beamid_array`
   contains
      procedure :: has_fit
      procedure :: last_fit
   end type outcome_t

contains

   !> Returns a handle for an object, which the table owns from now on.
   integer(c_int64_t) function new_handle(item) result(handle)
      class(*), target, intent(in) :: item
      integer :: k

      !$omp critical (handles_of_beamid)
      if (first_vacant == 0) call add_slots()
      k = first_vacant
      first_vacant = slots(k)%next_vacant
      serial = serial + 1
      handle = serial*most_slots + k
      slots(k) = slot_t(item, handle)
      !$omp end critical (handles_of_beamid)
   end function new_handle

   !> Extends the table by vacant slots.
   subroutine add_slots()
      type(slot_t), allocatable :: more(:)
      integer :: k, n

      n = 0
      if (allocated(slots)) n = size(slots)
      allocate (more(2*n + 16))
      if (n > 0) more(:n) = slots
      do k = n + 1, size(more) - 1
         more(k)%next_vacant = k + 1
      end do
      first_vacant = n + 1
      call move_alloc(more, slots)
   end subroutine add_slots

   !> Borrows the object of a handle until `give_back`.
   !>
   !> alone  whether the caller may change the object: no other call may have borrowed it
   !> what   the expected object for the error message, like 'a fit'
   !> item   the object; not associated if there is an error
   subroutine borrow(handle, alone, what, item, error)
      integer(c_int64_t), intent(in) :: handle
      logical, intent(in) :: alone
      character(len=*), intent(in) :: what
      class(*), pointer, intent(out) :: item
      type(error_t), allocatable, intent(out) :: error
      integer :: k
      logical :: in_use

      item => null()
      call check_fork(error)
      if (allocated(error)) return
      in_use = .false.
      !$omp critical (handles_of_beamid)
      k = place_of(handle)
      if (k > 0) then
         in_use = slots(k)%lent_alone .or. (alone .and. slots(k)%borrowers > 0)
         if (.not. in_use) then
            item => slots(k)%item
            slots(k)%borrowers = slots(k)%borrowers + 1
            slots(k)%lent_alone = alone
         end if
      end if
      !$omp end critical (handles_of_beamid)
      if (k == 0) call bad_input(error, 'found a handle that is null or closed, expected '//what)
      if (in_use) call bad_input(error, 'found '//what//' that another call is using, expected '// &
         'one call at a time')
   end subroutine borrow

   !> Gives back an object that `borrow` has lent.
   subroutine give_back(handle)
      integer(c_int64_t), intent(in) :: handle
      integer :: k

      !$omp critical (handles_of_beamid)
      k = place_of(handle)
      if (k > 0) then
         slots(k)%borrowers = slots(k)%borrowers - 1
         slots(k)%lent_alone = .false.
      end if
      !$omp end critical (handles_of_beamid)
   end subroutine give_back

   !> Deletes the object of a handle. It is an error if the object is in use.
   subroutine close_handle(handle, error)
      integer(c_int64_t), intent(in) :: handle
      type(error_t), allocatable, intent(out) :: error
      class(*), pointer :: item

      call borrow(handle, .true., 'an open one', item, error)
      if (allocated(error)) return
      !$omp critical (handles_of_beamid)
      associate (k => place_of(handle))
         slots(k) = slot_t(next_vacant=first_vacant)
         first_vacant = k
      end associate
      !$omp end critical (handles_of_beamid)
      deallocate (item)
   end subroutine close_handle

   !> Returns the slot of a handle; 0: the handle is not open.
   integer function place_of(handle) result(k)
      integer(c_int64_t), intent(in) :: handle

      k = int(modulo(handle, most_slots))
      if (handle <= 0 .or. .not. allocated(slots)) k = 0
      if (k == 0) return
      if (k > size(slots)) then
         k = 0
      else if (slots(k)%handle /= handle) then
         k = 0
      end if
   end function place_of

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
   !>
   !> or_results  whether the results of `beamid_run` will do as well; default: .false.
   subroutine borrow_outcome(handle, outcome, error, or_results)
      integer(c_int64_t), intent(in) :: handle
      type(outcome_t), pointer, intent(out) :: outcome
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: or_results
      class(*), pointer :: item
      logical :: is_accepted
      character(len=*), parameter :: what = 'a fit'

      outcome => null()
      call borrow(handle, .true., what, item, error)
      if (allocated(error)) return
      select type (item)
      type is (outcome_t); outcome => item
      class default
         call give_back(handle)
         call bad_input(error, 'found the handle of a case, expected '//what)
         return
      end select
      is_accepted = outcome%has_fit()
      if (present(or_results)) is_accepted = is_accepted .or. or_results
      if (is_accepted) return
      outcome => null()
      call give_back(handle)
      call bad_input(error, 'found the results of a command, expected '//what)
   end subroutine borrow_outcome

   !> Returns whether this is a fit.
   pure logical function has_fit(self)
      class(outcome_t), intent(in) :: self

      has_fit = allocated(self%found%fits)
   end function has_fit

   !> Returns the fit of the last stage on the last mesh; null if there is no fit.
   function last_fit(self) result(fit)
      class(outcome_t), intent(in), target :: self
      type(stage_fit_t), pointer :: fit

      fit => null()
      if (self%has_fit()) fit => self%found%fits(size(self%found%fits, 1), size(self%found%fits, 2))
   end function last_fit

end module beamid_c_handles
