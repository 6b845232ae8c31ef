!> The command `track` for C: a parameter is followed through blocks of samples.
module beamid_c_tracking
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_int64_t
   use beamid_c_calls, only: told
   use beamid_c_handles, only: borrow, borrow_problem, give_back, new_handle, problem_t
   use beamid_case_files, only: case_t
   use beamid_errors, only: bad_input, error_t
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_series, only: check_samples
   use beamid_strings, only: to_text
   use beamid_tracked_windows, only: track_flags
   use beamid_tracking, only: prepare_tracking, take_samples, tracked_t, tracker_t
   implicit none
   private

   public :: beamid_track_begin, beamid_track_take, beamid_track_rows

   !> A tracker, and the rows of the last block of samples.
   type :: following_t
      type(case_t) :: case
      type(tracker_t) :: tracker
      type(tracked_t), allocatable :: rows(:)
      real(wp) :: last = -huge(1.0_wp)   !< time of the last sample [time]
   end type following_t

contains

   !> Makes the tracker of a case.
   !>
   !> of      handle of a case with the group &track
   !> handle  of the tracker, to be closed by `beamid_close`; 0 if there is an error
   integer(c_int) function beamid_track_begin(of, handle, message, room) result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: of
      integer(c_int64_t), intent(out) :: handle
      integer(c_int), value, intent(in) :: room
      character(kind=c_char), intent(inout) :: message(room)
      type(problem_t), pointer :: problem
      type(following_t), pointer :: following
      type(error_t), allocatable :: error

      handle = 0
      call borrow_problem(of, problem, error)
      if (.not. allocated(error)) then
         allocate (following)
         following%case = problem%case
         allocate (following%rows(0))
         call give_back(of)
         !$omp critical (texts_of_beamid)
         call prepare_tracking(following%case, following%tracker, error)
         !$omp end critical (texts_of_beamid)
         if (allocated(error)) deallocate (following)
      end if
      status = told(error, message)
      if (status == 0) handle = new_handle(following)
   end function beamid_track_begin

   !> Takes samples, and fits every window that they complete.
   !>
   !> handle  of the tracker
   !> t, z    (n) times, ascending, later than those before [time], and values in the unit of the
   !>         record
   !> rows    number of completed windows
   integer(c_int) function beamid_track_take(handle, n, t, z, rows, message, room) &
      result(status) bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: n, room
      real(c_double), intent(in) :: t(n), z(n)
      integer(c_int), intent(out) :: rows
      character(kind=c_char), intent(inout) :: message(room)
      type(following_t), pointer :: following
      type(error_t), allocatable :: error

      rows = 0
      call borrow_tracker(handle, following, error)
      if (.not. allocated(error)) then
         call check_samples(t, z, following%last, error)
         if (.not. allocated(error)) call take_samples(following%case, following%tracker, t, z, &
            following%rows, error)
         call check_interrupt(error)
         if (.not. allocated(error)) rows = size(following%rows)
         if (.not. allocated(error) .and. n > 0) following%last = t(n)
         call give_back(handle)
      end if
      status = told(error, message)
   end function beamid_track_take

   !> Copies the rows of the last `beamid_track_take`.
   !>
   !> n       number of rows
   !> values  (8, n) first and last time, estimate, lower and upper limit, misfit, processor time
   !>         [ms], number of the flag in `track_flags`, counted from 0
   integer(c_int) function beamid_track_rows(handle, n, values, message, room) result(status) &
      bind(c)
      integer(c_int64_t), value, intent(in) :: handle
      integer(c_int), value, intent(in) :: n, room
      real(c_double), intent(inout) :: values(8, n)
      character(kind=c_char), intent(inout) :: message(room)
      type(following_t), pointer :: following
      type(error_t), allocatable :: error
      integer :: k

      call borrow_tracker(handle, following, error)
      if (.not. allocated(error)) then
         if (size(following%rows) /= n) then
            call bad_input(error, 'found space for '//to_text(int(n))//' rows, expected '// &
               to_text(size(following%rows)))
         else
            do k = 1, n
               associate (row => following%rows(k))
                  values(:, k) = [row%first, row%last, row%estimate, row%lower, row%upper, &
                     row%misfit, row%milliseconds, findloc(track_flags, row%flag, dim=1) - 1.0_wp]
               end associate
            end do
         end if
         call give_back(handle)
      end if
      status = told(error, message)
   end function beamid_track_rows

   !> Borrows the tracker of a handle, which no other call may use.
   subroutine borrow_tracker(handle, following, error)
      integer(c_int64_t), intent(in) :: handle
      type(following_t), pointer, intent(out) :: following
      type(error_t), allocatable, intent(out) :: error
      class(*), pointer :: item
      character(len=*), parameter :: what = 'a tracker'

      following => null()
      call borrow(handle, .true., what, item, error)
      if (allocated(error)) return
      select type (item)
      type is (following_t); following => item
      class default
         call give_back(handle)
         call bad_input(error, 'found the handle of another object, expected '//what)
      end select
   end subroutine borrow_tracker

end module beamid_c_tracking
