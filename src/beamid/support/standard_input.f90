!> Reads standard input as it arrives. gfortran's runtime waits for whole buffers, and an
!> interruption would have to wait as well.
module beamid_standard_input
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_long, c_size_t
   use beamid_errors, only: bad_input, error_t
   use beamid_interrupts, only: check_interrupt
   use beamid_posix, only: c_poll, c_read, last_errno, poll_t, reason
   implicit none
   private

   public :: read_input

contains

   !> Waits until there is something to read, and reads what there is.
   !>
   !> text   on return as long as what was read; empty at the end of the input
   !> error  interrupted by the user, or the input cannot be read
   subroutine read_input(text, error)
      character(len=:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 65536
      !> Longest wait between checks for an interruption [ms].
      integer(c_int), parameter :: patience = 100
      character(kind=c_char) :: buffer(most)
      type(poll_t) :: which
      integer(c_size_t) :: n
      integer :: k

      text = ''
      do
         call check_interrupt(error)
         if (allocated(error)) return
         which%found = 0
         if (c_poll(which, 1_c_long, patience) > 0) exit
      end do
      n = c_read(0_c_int, buffer, int(most, c_size_t))
      if (n < 0) then
         call bad_input(error, 'standard input: '//reason(last_errno()))
         return
      end if
      deallocate (text)
      allocate (character(len=int(n)) :: text)
      do k = 1, int(n)
         text(k:k) = buffer(k)
      end do
   end subroutine read_input

end module beamid_standard_input
