!> The error type of the whole library. An allocated error is the signal of a failure: the caller
!> writes `if (allocated(error)) return`.
module beamid_errors
   implicit none
   private

   public :: error_t, bad_input, failure, locate

   !> Exit status of a computation that failed.
   integer, parameter, public :: status_failed = 1
   !> Exit status of input that cannot be accepted.
   integer, parameter, public :: status_bad_input = 2
   !> Exit status of a computation that a signal or the caller has stopped (`beamid_interrupts`).
   integer, parameter, public :: status_interrupted = 3

   !> An error: its message and the exit status of the program.
   type :: error_t
      !> Where the error is (file, group, key or line), what was found and what was expected.
      character(len=:), allocatable :: message
      !> `status_failed`, `status_bad_input` or `status_interrupted`.
      integer :: status = status_failed
   end type error_t

contains

   !> Makes an error of the user's input, with status 2.
   pure subroutine bad_input(error, message)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in) :: message

      allocate (error)
      error%message = message
      error%status = status_bad_input
   end subroutine bad_input

   !> Makes an error of a computation whose input is sound, with status 1.
   pure subroutine failure(error, message)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in) :: message

      allocate (error)
      error%message = message
      error%status = status_failed
   end subroutine failure

   !> Prepends the place to an error's message; does nothing if there is no error.
   !>
   !> what  file, group, mesh or other place that the error belongs to
   pure subroutine locate(error, what)
      type(error_t), allocatable, intent(inout) :: error
      character(len=*), intent(in) :: what

      if (allocated(error)) error%message = what//': '//error%message
   end subroutine locate

end module beamid_errors
