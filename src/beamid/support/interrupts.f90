!> Interrupts: Ctrl-C, `kill`, and callers that no longer want the result.
!>
!> A signal only sets a flag. Every loop that may take long tests the flag (`interrupted`) and ends
!> early. Every procedure that returns an error reports the flag as an error with the status
!> `status_interrupted` (`check_interrupt`). The flag stays set until the caller clears it. A loop
!> that responds to an error by trying the next candidate therefore fails again at once, and the
!> next `check_interrupt` further out replaces whatever it returns.
!>
!> `stop_flag` points to the flag of the current call. Each thread has its own pointer; the threads
!> of a parallel region take over the pointer of the thread that starts the region, for which every
!> parallel region has `copyin(stop_flag)`. Signals set the flag of the process. The program uses
!> this flag, and so does a call from C that asks for signals (`begin_call`). Every other call from
!> C uses the flag of its thread, so that a signal does not stop fits in other threads.
module beamid_interrupts
   use, intrinsic :: iso_c_binding, only: c_funloc, c_int, c_intptr_t, c_loc, c_null_ptr
   use beamid_errors, only: error_t, failure, status_interrupted
   use beamid_posix, only: c_raise, c_sigaction, c_signal, sig_ign, sigalrm, sighup, sigint, &
      signal_action_t, sigterm, sigxfsz
   implicit none
   private

   public :: interrupted, check_interrupt, stop_flag
   public :: set_flag, begin_call, end_call, forget_call, stop_call
   public :: interrupt_at_check, checks_until_interrupt
   public :: hold_signals, release_signals

   !> Value of a flag that the caller has set. Other values are 0 and the number of a signal.
   integer(c_int), parameter, public :: stopped_by_caller = -1
   character(len=*), parameter, public :: interruption = 'interrupted'

   integer(c_int), target, save, volatile :: flag_of_process = 0
   integer(c_int), target, save, volatile :: flag_of_thread = 0
   integer(c_int), pointer, save, volatile :: stop_flag => flag_of_process
   !$omp threadprivate(flag_of_thread, stop_flag)

   !> Number of checks after which the flag sets itself, for tests; 0: never.
   integer, save, volatile :: countdown = 0

   !> Whether a call from C has replaced the action of `sigint`, and the action before.
   logical, save, volatile :: catches = .false.
   type(signal_action_t), target, save :: action_before

   !> Signals that wait during an exchange of files, and their actions before.
   integer(c_int), parameter :: held_signals(*) = [sighup, sigint, sigterm, sigxfsz, sigalrm]
   integer(c_intptr_t) :: actions(size(held_signals))
   !> Last signal that came during the exchange; 0: none.
   integer(c_int), volatile :: waiting = 0

contains

   !> Returns whether the current call has to stop.
   logical function interrupted()
      if (countdown > 0) call count_down()
      interrupted = stop_flag /= 0
   end function interrupted

   !> Replaces an error, or no error, by an interruption if the current call has to stop.
   subroutine check_interrupt(error)
      type(error_t), allocatable, intent(inout) :: error

      if (.not. interrupted()) return
      call failure(error, interruption)
      error%status = status_interrupted
   end subroutine check_interrupt

   !> Clears the flag and makes it set itself at the n-th check from now, for tests; 0: never.
   subroutine interrupt_at_check(n)
      integer, intent(in) :: n

      stop_flag = 0
      countdown = n
   end subroutine interrupt_at_check

   !> Returns the number of checks that are left before the flag sets itself.
   integer function checks_until_interrupt()
      checks_until_interrupt = countdown
   end function checks_until_interrupt

   !> Counts one check and sets the flag at the last one.
   subroutine count_down()
      !$omp critical (interrupt_countdown)
      if (countdown == 1) stop_flag = sigint
      if (countdown > 0) countdown = countdown - 1
      !$omp end critical (interrupt_countdown)
   end subroutine count_down

   !> Handles a signal: sets the flag of the process.
   subroutine set_flag(number) bind(c)
      integer(c_int), value :: number

      flag_of_process = number
   end subroutine set_flag

   !> Begins a call from C, which `end_call` ends in the same thread.
   !>
   !> catch  whether `sigint` stops the call. The action of `sigint` is then replaced until the call
   !>        ends. Only one call at a time can catch it; for any further call `catch` has no effect.
   !>        The flag is not cleared: a signal that another thread received during the call before,
   !>        and whose handler ran only after its end, stops this call.
   subroutine begin_call(catch)
      logical, intent(in) :: catch
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed

      if (.not. catch .or. catches) then
         flag_of_thread = 0
         stop_flag => flag_of_thread
         return
      end if
      stop_flag => flag_of_process
      failed = c_sigaction(sigint, c_null_ptr, c_loc(action_before))
      ignored = c_signal(sigint, transfer(c_funloc(set_flag), 0_c_intptr_t))
      catches = .true.
   end subroutine begin_call

   !> Ends a call from C, and restores the action of `sigint`.
   !>
   !> flag  0, the number of a signal that has come since the call began, or `stopped_by_caller`
   subroutine end_call(flag)
      integer(c_int), intent(out) :: flag

      if (associated(stop_flag, flag_of_process)) call forget_call()
      flag = stop_flag
      ! A flag that another thread sets behind the line above stays set.
      if (flag /= 0) stop_flag = 0
   end subroutine end_call

   !> Restores the action of `sigint` if a call from C has replaced it: at the end of the call, or
   !> in a forked child, in which no thread is in the call.
   subroutine forget_call()
      integer(c_int) :: failed

      if (.not. catches) return
      failed = c_sigaction(sigint, c_loc(action_before), c_null_ptr)
      catches = .false.
   end subroutine forget_call

   !> Stops the current call of this thread.
   subroutine stop_call()
      if (stop_flag == 0) stop_flag = stopped_by_caller
   end subroutine stop_call

   !> Makes the signals of Ctrl-C, `kill` and a closed terminal wait until `release_signals`;
   !> signals that the program ignores stay ignored. Exceeding the limit of a file's size becomes an
   !> error code instead of ending the program. Handlers are used because they act in all threads,
   !> which a signal mask does not.
   subroutine hold_signals()
      integer(c_intptr_t) :: ignored
      integer :: k

      waiting = 0
      do k = 1, size(held_signals)
         actions(k) = c_signal(held_signals(k), transfer(c_funloc(remember), 0_c_intptr_t))
         if (actions(k) == sig_ign .or. held_signals(k) == sigxfsz) &
            ignored = c_signal(held_signals(k), sig_ign)
      end do
   end subroutine hold_signals

   !> Restores the actions of the signals, and raises a signal that has come in the meantime.
   subroutine release_signals()
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed
      integer :: k

      do k = 1, size(held_signals)
         ignored = c_signal(held_signals(k), actions(k))
      end do
      if (waiting /= 0) failed = c_raise(waiting)
   end subroutine release_signals

   !> Handles a signal during an exchange: remembers it.
   subroutine remember(number) bind(c)
      integer(c_int), value :: number

      waiting = number
   end subroutine remember

end module beamid_interrupts
