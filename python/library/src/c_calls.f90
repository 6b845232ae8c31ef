!> The frame of each call from C that computes: interrupts, progress, and protection against forked
!> processes.
!>
!> `beamid_begin` and `beamid_end` enclose a call. Between them the interrupt flag belongs to the
!> call (`beamid_interrupts`), and a callback receives the progress.
module beamid_c_calls
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_procpointer, c_funloc, &
      c_funptr, c_int, c_null_char, c_null_funptr
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: begin_call, end_call, forget_call, stop_call
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use omp_lib, only: omp_get_thread_num, omp_set_num_threads
   implicit none
   private

   public :: beamid_watch_forks, beamid_begin, beamid_end, check_fork
   public :: progress_t, progress_of_call, end_progress, characters, told

   !> Progress of a computation, passed on to the callback of the call.
   type, extends(monitor_t) :: progress_t
      procedure(callback), pointer, nopass, private :: tell => null()
      integer(int64), private :: last = -huge(1_int64)   !< time of the last callback [clock counts]
      !> Number of pieces of work that another thread has completed and that the callback has not
      !> received yet, and their name; 0: none.
      integer, private :: completed = 0
      character(len=40), private :: completed_pieces = ''
   contains
      procedure :: iteration
      procedure :: done
      procedure :: advanced
   end type progress_t

   abstract interface
      !> Receives the progress in the thread of the call, at most ten times a second.
      !>
      !> part, whole  number of pieces that are done, and of all pieces; whole = 0: not known
      !> what         (length) name of the pieces
      !> result       not 0: the computation is to stop
      integer(c_int) function callback(part, whole, what, length) bind(c)
         import :: c_char, c_int
         integer(c_int), value :: part, whole, length
         character(kind=c_char), intent(in) :: what(length)
      end function callback

      !> Is called by the system when the process is forked.
      subroutine fork_handler() bind(c)
      end subroutine fork_handler
   end interface

   interface
      integer(c_int) function c_atfork(prepare, parent, child) bind(c, name='pthread_atfork')
         import :: c_funptr, c_int
         type(c_funptr), value :: prepare, parent, child
      end function c_atfork
   end interface

   !> Number of calls between `beamid_begin` and `beamid_end`, in all threads.
   integer, save :: calls_in_progress = 0
   !> Whether the handler of forks is installed.
   logical, save :: watches = .false.
   !> Whether this process was forked from a process that had loaded the library, and whether a call
   !> was in progress there at that time.
   logical, save :: is_forked = .false., was_busy = .false.

   !> Whether this thread is in a call, and the callback of the call.
   logical, save :: calling = .false.
   type(c_funptr), save :: callback_of_call
   !$omp threadprivate(calling, callback_of_call)

contains

   !> Installs a handler that notices when the process is forked; to be called before any OpenMP
   !> region of the process. The threads of libgomp do not survive a fork, and a parallel region in
   !> the child would wait for them for ever. In the child every region therefore runs in one
   !> thread.
   subroutine beamid_watch_forks() bind(c)
      integer(c_int) :: ignored

      if (.not. watches) ignored = c_atfork(c_null_funptr, c_null_funptr, c_funloc(note_fork))
      watches = .true.
   end subroutine beamid_watch_forks

   !> Notes in the child that the process was forked.
   subroutine note_fork() bind(c)
      is_forked = .true.
      was_busy = was_busy .or. calls_in_progress > 0
      if (.not. calling) call forget_call()
   end subroutine note_fork

   !> Begins a call, which `beamid_end` ends in the same thread.
   !>
   !> catch     1: `SIGINT` stops the call; only one thread at a time may ask for this
   !> progress  a `callback`, or null
   !> result    0; 1: the call has not begun, and `message` says why
   !> room      size of `message`
   integer(c_int) function beamid_begin(catch, progress, message, room) result(status) bind(c)
      integer(c_int), value, intent(in) :: catch, room
      type(c_funptr), value, intent(in) :: progress
      character(kind=c_char), intent(inout) :: message(room)
      type(error_t), allocatable :: error

      call beamid_watch_forks()
      if (calling) then
         call failure(error, 'found a call inside another one, as from a progress callback; '// &
            'expected one call at a time in each thread')
      else
         call check_fork(error)
      end if
      if (.not. allocated(error)) then
         if (is_forked) call omp_set_num_threads(1)
         calling = .true.
         callback_of_call = progress
         !$omp atomic
         calls_in_progress = calls_in_progress + 1
         call begin_call(catch == 1)
      end if
      status = told(error, message)
   end function beamid_begin

   !> Refuses calls in a process that was forked while another thread was in a call, because the
   !> locks of that thread are never released in the child.
   subroutine check_fork(error)
      type(error_t), allocatable, intent(out) :: error

      if (was_busy) call failure(error, 'this process was forked while a computation was '// &
         'running, and cannot use beamid: start processes by ''spawn'' or ''forkserver''')
   end subroutine check_fork

   !> Ends the call of this thread; does nothing if there is no call.
   !>
   !> result  0: the call was not interrupted; number of a signal that has come since the call
   !>         began, even if the computation had ended before; -1: the callback has stopped the call
   integer(c_int) function beamid_end() result(flag) bind(c)
      flag = 0
      if (.not. calling) return
      call end_call(flag)
      !$omp atomic
      calls_in_progress = calls_in_progress - 1
      calling = .false.
      callback_of_call = c_null_funptr
   end function beamid_end

   !> Returns a monitor that passes progress to the callback of the call; null if there is no
   !> callback.
   function progress_of_call() result(monitor)
      type(progress_t), pointer :: monitor

      monitor => null()
      if (.not. calling) return
      if (.not. c_associated(callback_of_call)) return
      allocate (monitor)
      call c_f_procpointer(callback_of_call, monitor%tell)
   end function progress_of_call

   !> Reports an iteration of a search.
   subroutine iteration(self, label, number, evaluations, J, names, parameters)
      class(progress_t), intent(inout) :: self
      character(len=*), intent(in) :: label, names(:)
      integer, intent(in) :: number, evaluations
      real(wp), intent(in) :: J, parameters(:)

      call report(self, evaluations, 0, 'evaluations, '//label)
   end subroutine iteration

   !> Ignores the share of work that is done; `advanced` reports it.
   subroutine done(self, part, whole)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: part, whole
   end subroutine done

   !> Reports the number of pieces that are done.
   subroutine advanced(self, part, whole, pieces)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: pieces

      call report(self, part, whole, pieces)
   end subroutine advanced

   !> Calls the callback if this is the thread of the call and a tenth of a second has passed, or
   !> all pieces are done. Work that another thread completes is kept until this thread reports
   !> again.
   subroutine report(self, part, whole, what)
      class(progress_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: what
      integer(int64) :: now, rate

      if (omp_get_thread_num() /= 0 .or. .not. calling) then
         if (part /= whole) return
         self%completed = whole
         self%completed_pieces = what
         return
      end if
      call tell_completed(self)
      call system_clock(now, rate)
      if (part /= whole .and. now < self%last + rate/10) return
      self%last = now
      call call_back(self, part, whole, what)
   end subroutine report

   !> Reports the work that another thread has completed.
   subroutine tell_completed(self)
      class(progress_t), intent(inout) :: self
      integer :: whole

      whole = self%completed
      self%completed = 0
      if (whole > 0) call call_back(self, whole, whole, trim(self%completed_pieces))
   end subroutine tell_completed

   !> Calls the callback, and stops the call if the callback asks for it.
   subroutine call_back(self, part, whole, what)
      class(progress_t), intent(in) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: what

      if (self%tell(int(part, c_int), int(whole, c_int), what, len(what, c_int)) /= 0) &
         call stop_call()
   end subroutine call_back

   !> Reports the work that was completed last, and frees the monitor; to be called in the thread of
   !> the call. Does nothing if the monitor is null.
   subroutine end_progress(monitor)
      type(progress_t), pointer, intent(inout) :: monitor

      if (.not. associated(monitor)) return
      call tell_completed(monitor)
      deallocate (monitor)
   end subroutine end_progress

   !> Returns the status of an error (0: no error), and copies its message as far as there is room.
   integer(c_int) function told(error, message) result(status)
      type(error_t), allocatable, intent(in) :: error
      character(kind=c_char), intent(inout) :: message(:)
      integer :: k, length

      status = 0
      if (allocated(error)) status = error%status
      if (size(message) == 0) return
      length = 0
      if (allocated(error)) length = min(len(error%message), size(message) - 1)
      do k = 1, length
         message(k) = error%message(k:k)
      end do
      message(length + 1) = c_null_char
   end function told

   !> Returns characters from C as text.
   pure function characters(letters) result(text)
      character(kind=c_char), intent(in) :: letters(:)
      character(len=size(letters)) :: text
      integer :: k

      do k = 1, size(letters)
         text(k:k) = letters(k)
      end do
   end function characters

end module beamid_c_calls
