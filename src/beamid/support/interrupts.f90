!> Interrupts: Ctrl-C, `kill`, and a caller who no longer wants the result.
!>
!> A signal only sets a flag. Every loop that may take long asks for the flag (`interrupted`) and
!> ends early; every procedure that returns an error reports the flag as an error of the status
!> `status_interrupted` (`check_interrupt`). The flag stays set until the caller clears it. A loop
!> that treats an error as "try the next one" therefore fails again at once, and whatever it
!> returns is replaced by the error of the next `check_interrupt` further out.
!>
!> `stop_flag` points to the flag of the call in hand. Each thread has its own pointer. The threads
!> of a parallel region take over the pointer of the thread that starts the region: each parallel
!> region says `copyin(stop_flag)`. Signals set the flag of the process. The program uses that flag,
!> and so does a call by C that asks for signals (`begin_call`); every other call by C has the flag
!> of its thread, so that a signal does not stop fits in other threads.
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

   !> Flags are 0, the number of a signal, or this: the caller has stopped the call.
   integer(c_int), parameter, public :: stopped_by_caller = -1
   character(len=*), parameter, public :: interruption = 'interrupted'

   integer(c_int), target, save, volatile :: flag_of_process = 0
   integer(c_int), target, save, volatile :: flag_of_thread = 0
   integer(c_int), pointer, save, volatile :: stop_flag => flag_of_process
   !$omp threadprivate(flag_of_thread, stop_flag)

   !> Checks left before the flag is set by itself; 0: never (tests).
   integer, save, volatile :: countdown = 0

   !> Whether a call by C has replaced the action of `sigint`, and the action before that.
   logical, save, volatile :: catches = .false.
   type(signal_action_t), target, save :: action_before

   integer(c_int), parameter :: numbers(*) = [sighup, sigint, sigterm, sigxfsz, sigalrm]
   !> What the program does at each of them otherwise.
   integer(c_intptr_t) :: actions(size(numbers))
   !> The last one that came, or 0.
   integer(c_int), volatile :: waiting = 0

contains

   !> Returns whether the call in hand is to stop.
   logical function interrupted()
      if (countdown > 0) call count_down()
      interrupted = stop_flag /= 0
   end function interrupted

   !> Replaces an error, or none, by an interruption if the call in hand is to stop.
   subroutine check_interrupt(error)
      type(error_t), allocatable, intent(inout) :: error

      if (.not. interrupted()) return
      call failure(error, interruption)
      error%status = status_interrupted
   end subroutine check_interrupt

   !> Sets the flag at the n-th check from now, for tests; 0: never. Clears the flag.
   subroutine interrupt_at_check(n)
      integer, intent(in) :: n

      stop_flag = 0
      countdown = n
   end subroutine interrupt_at_check

   !> Returns how many checks are left before the flag is set.
   integer function checks_until_interrupt()
      checks_until_interrupt = countdown
   end function checks_until_interrupt

   subroutine count_down()
      !$omp critical (interrupt_countdown)
      if (countdown == 1) stop_flag = sigint
      if (countdown > 0) countdown = countdown - 1
      !$omp end critical (interrupt_countdown)
   end subroutine count_down

   !> Handler of signals: sets the flag of the process.
   subroutine set_flag(number) bind(c)
      integer(c_int), value :: number

      flag_of_process = number
   end subroutine set_flag

   !> Begins a call by C; to be ended by `end_call` in the same thread.
   !>
   !> catch  whether `sigint` is to stop the call: its action is replaced until the call ends. Only
   !>        one call at a time catches it; to another one the answer is no.
   subroutine begin_call(catch)
      logical, intent(in) :: catch
      integer(c_intptr_t) :: ignored
      integer(c_int) :: failed

      if (.not. catch .or. catches) then
         flag_of_thread = 0
         stop_flag => flag_of_thread
         return
      end if
      flag_of_process = 0
      stop_flag => flag_of_process
      failed = c_sigaction(sigint, c_null_ptr, c_loc(action_before))
      ignored = c_signal(sigint, transfer(c_funloc(set_flag), 0_c_intptr_t))
      catches = .true.
   end subroutine begin_call

   !> Ends a call by C, and restores the action of `sigint`.
   !>
   !> flag  0; a signal that has come since the call began; or `stopped_by_caller`
   subroutine end_call(flag)
      integer(c_int), intent(out) :: flag

      if (associated(stop_flag, flag_of_process)) call forget_call()
      flag = stop_flag
      stop_flag = 0
   end subroutine end_call

   !> Restores the action of `sigint`, if a call by C has replaced it: at its end, or in a forked
   !> child, where nobody is in the call.
   subroutine forget_call()
      integer(c_int) :: failed

      if (.not. catches) return
      failed = c_sigaction(sigint, c_loc(action_before), c_null_ptr)
      catches = .false.
   end subroutine forget_call

   !> Stops the call in hand of this thread.
   subroutine stop_call()
      if (stop_flag == 0) stop_flag = stopped_by_caller
   end subroutine stop_call

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
