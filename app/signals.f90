!> Ctrl-C and `kill`: the computation stops at its next check of the flag,
!> and the program ends by the signal, so that the caller sees the status of an interrupted program
!> (130 or 143 in a shell).
module beamid_signals
   use, intrinsic :: iso_c_binding, only: c_funloc, c_int, c_intptr_t, c_long, c_null_ptr
   use beamid_interrupts, only: interruption, set_flag
   use beamid_posix, only: c_raise, c_setitimer, c_signal, sig_dfl, sig_ign, sigalrm, sigint, &
      sigterm, write_bytes
   implicit none
   private

   public :: catch_signals, end_by_signal, stop_patience

   !> The signal that has come, or 0.
   integer(c_int), volatile :: came = 0

   character(len=*), parameter :: message = 'beamid: '//interruption//new_line('a')

contains

   !> Lets `sigint` and `sigterm` stop the computation. A second signal of the same kind ends the
   !> program at once. Signals that the program ignores stay ignored.
   subroutine catch_signals()
      integer(c_intptr_t) :: before
      integer :: k
      integer(c_int), parameter :: caught(2) = [sigint, sigterm]

      do k = 1, size(caught)
         before = c_signal(caught(k), transfer(c_funloc(stop_computation), 0_c_intptr_t))
         if (before == sig_ign) before = c_signal(caught(k), sig_ign)
      end do
   end subroutine catch_signals

   !> Handler: sets the flag. A program that has not ended after `patience`, because it is inside
   !> one long call of another library or of the system, is ended by `give_up`.
   subroutine stop_computation(number) bind(c)
      integer(c_int), value :: number
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed
      integer(c_long), parameter :: patience(4) = [0_c_long, 0_c_long, 0_c_long, 350000_c_long]

      came = number
      call set_flag(number)
      ignored = c_signal(number, sig_dfl)
      ignored = c_signal(sigalrm, transfer(c_funloc(give_up), 0_c_intptr_t))
      failed = c_setitimer(0_c_int, patience, c_null_ptr)
   end subroutine stop_computation

   !> Handler of the alarm.
   subroutine give_up(number) bind(c)
      integer(c_int), value :: number
      integer(c_int) :: ignored

      if (number == sigalrm) ignored = write_bytes(2_c_int, message)
      call end_by_signal()
   end subroutine give_up

   !> Stops the timer behind `give_up`: the computation has ended.
   subroutine stop_patience()
      integer(c_int) :: failed
      integer(c_long), parameter :: never(4) = 0

      failed = c_setitimer(0_c_int, never, c_null_ptr)
   end subroutine stop_patience

   !> Ends the program by the signal that has come; does nothing if there was none.
   subroutine end_by_signal()
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed

      if (came == 0) return
      ignored = c_signal(came, sig_dfl)
      failed = c_raise(came)
   end subroutine end_by_signal

end module beamid_signals
