!> Handlers for Ctrl-C and `kill`. The computation stops at its next check of the interrupt flag,
!> and the program then ends by the signal, so that its caller sees the exit status of an
!> interrupted program (130 or 143 in a shell).
module beamid_signals
   use, intrinsic :: iso_c_binding, only: c_funloc, c_int, c_intptr_t, c_long, c_null_ptr
   use beamid_interrupts, only: interruption, set_flag
   use beamid_posix, only: c_raise, c_setitimer, c_signal, sig_dfl, sig_ign, sigalrm, sigint, &
      sigterm, write_bytes
   implicit none
   private

   public :: catch_signals, end_by_signal, stop_patience

   !> Number of the signal that has been received; 0: none.
   integer(c_int), volatile :: received = 0

   character(len=*), parameter :: message = 'beamid: '//interruption//new_line('a')

contains

   !> Makes `sigint` and `sigterm` stop the computation. A second signal of the same kind ends the
   !> program at once. A signal that the program's caller has set to be ignored stays ignored.
   subroutine catch_signals()
      integer(c_intptr_t) :: before
      integer :: k
      integer(c_int), parameter :: caught(2) = [sigint, sigterm]

      do k = 1, size(caught)
         before = c_signal(caught(k), transfer(c_funloc(stop_computation), 0_c_intptr_t))
         if (before == sig_ign) before = c_signal(caught(k), sig_ign)
      end do
   end subroutine catch_signals

   !> Handles a signal: sets the interrupt flag and starts a timer. If the program has not ended
   !> after `patience`, because it is inside one long call of a library or of the system, `give_up`
   !> ends it.
   subroutine stop_computation(number) bind(c)
      integer(c_int), value :: number
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed
      integer(c_long), parameter :: patience(4) = [0_c_long, 0_c_long, 0_c_long, 350000_c_long]

      received = number
      call set_flag(number)
      ignored = c_signal(number, sig_dfl)
      ignored = c_signal(sigalrm, transfer(c_funloc(give_up), 0_c_intptr_t))
      failed = c_setitimer(0_c_int, patience, c_null_ptr)
   end subroutine stop_computation

   !> Handles the alarm of the timer: ends the program.
   subroutine give_up(number) bind(c)
      integer(c_int), value :: number
      integer(c_int) :: ignored

      if (number == sigalrm) ignored = write_bytes(2_c_int, message)
      call end_by_signal()
   end subroutine give_up

   !> Stops the timer of `give_up` after the computation has ended.
   subroutine stop_patience()
      integer(c_int) :: failed
      integer(c_long), parameter :: never(4) = 0

      failed = c_setitimer(0_c_int, never, c_null_ptr)
   end subroutine stop_patience

   !> Ends the program by the signal that was received; does nothing if there was none.
   subroutine end_by_signal()
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed

      if (received == 0) return
      ignored = c_signal(received, sig_dfl)
      failed = c_raise(received)
   end subroutine end_by_signal

end module beamid_signals
