!> The one error type of the library. An allocated error is the signal:
!> the caller writes `if (allocated(error)) return`.
module beamid_errors
   implicit none
   private

   public :: error_t, bad_input, failure, locate

   !> Exit status of a computation that could not be finished.
   integer, parameter, public :: status_failed = 1
   !> Exit status of an input that cannot be accepted.
   integer, parameter, public :: status_bad_input = 2
   !> A signal or the caller has stopped the computation (`beamid_interrupts`).
   integer, parameter, public :: status_interrupted = 3

   type :: error_t
      !> What happened: where (file, group, key or line), what was found, what was expected.
      character(len=:), allocatable :: message
      !> `status_failed`, `status_bad_input` or `status_interrupted`.
      integer :: status = status_failed
   end type error_t

contains

   !> The user's input cannot be accepted.
   pure subroutine bad_input(error, message)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in) :: message

      allocate (error)
      error%message = message
      error%status = status_bad_input
   end subroutine bad_input

   !> The input was sound, the computation could not be finished.
   pure subroutine failure(error, message)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in) :: message

      allocate (error)
      error%message = message
      error%status = status_failed
   end subroutine failure

   !> Says before the message what it belongs to; nothing happens without an error.
   pure subroutine locate(error, what)
      type(error_t), allocatable, intent(inout) :: error
      character(len=*), intent(in) :: what

      if (allocated(error)) error%message = what//': '//error%message
   end subroutine locate

end module beamid_errors
