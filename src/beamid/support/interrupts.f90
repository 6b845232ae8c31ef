!> Signals that would end the program wait while files change their names.
module beamid_interrupts
   use, intrinsic :: iso_c_binding, only: c_funloc, c_int, c_intptr_t
   use beamid_posix, only: c_raise, c_signal, sig_ign, sighup, sigint, sigterm, sigxfsz
   implicit none
   private

   public :: hold_signals, release_signals

   integer(c_int), parameter :: numbers(*) = [sighup, sigint, sigterm, sigxfsz]
   !> What the program does at each of them otherwise.
   integer(c_intptr_t) :: actions(size(numbers))
   !> The last one that came, or 0.
   integer(c_int), volatile :: waiting = 0

contains

   !> From here on the signals of a terminal, of `kill` and of a closed terminal wait; those that
   !> the program ignores it goes on ignoring. The limit of a file's size is an error code, not the
   !> end of the program. Handlers serve all threads, a signal mask does not.
   subroutine hold_signals()
      integer(c_intptr_t) :: ignored
      integer :: k

      waiting = 0
      do k = 1, size(numbers)
         actions(k) = c_signal(numbers(k), transfer(c_funloc(remember), 0_c_intptr_t))
         if (actions(k) == sig_ign .or. numbers(k) == sigxfsz) &
            ignored = c_signal(numbers(k), sig_ign)
      end do
   end subroutine hold_signals

   !> The signals act as before; one that came meanwhile does so now.
   subroutine release_signals()
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed
      integer :: k

      do k = 1, size(numbers)
         ignored = c_signal(numbers(k), actions(k))
      end do
      if (waiting /= 0) failed = c_raise(waiting)
   end subroutine release_signals

   subroutine remember(number) bind(c)
      integer(c_int), value :: number

      waiting = number
   end subroutine remember

end module beamid_interrupts
