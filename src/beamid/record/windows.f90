!> Chooses the samples of a record that a fit uses.
module beamid_windows
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp, ip
   use beamid_series, only: series_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: window_t, grid, choose_rows

   !> Largest number of sample times; more indicate a mistake in t_step or t_last.
   integer, parameter :: max_samples = 1000000

   !> Largest time in any unit; its powers do not overflow.
   real(wp), parameter :: largest_time = 1e40_wp

   !> Largest deviation of a time, in time steps.
   real(wp), parameter :: tolerance = 1e-3_wp

   !> The window of a fit; by default the whole record.
   type :: window_t
      real(wp), allocatable :: t_first, t_last   !< [time]; default: those of the record
      !> time step [time]; not allocated: every sample between t_first and t_last
      real(wp), allocatable :: t_step
   end type window_t

contains

   !> Computes the times t_first, t_first + t_step, ..., t_last of a window in which all three are
   !> given.
   !>
   !> times  (m) [time]
   !> error  too many times; a message without file and key
   subroutine grid(window, times, error)
      type(window_t), intent(in) :: window
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: steps
      integer :: k

      steps = (window%t_last - window%t_first)/window%t_step
      if (.not. steps <= max_samples) then
         call bad_input(error, 'found '//to_text(window%t_step)//', which makes more than '// &
            to_text(max_samples)//' samples from '//to_text(window%t_first)//' to '// &
            to_text(window%t_last)//', expected a larger step')
         return
      else if (.not. max(abs(window%t_first), abs(window%t_last)) <= largest_time) then
         call bad_input(error, 'found sample times from '//to_text(window%t_first)//' to '// &
            to_text(window%t_last)//', expected times within '//to_text(largest_time))
         return
      end if
      times = [(window%t_first + k*window%t_step, k=0, int(steps*(1 + 1e-12_wp) + 1e-6_wp))]
   end subroutine grid

   !> Chooses the rows of a series that are in the window. With t_step, the series must contain a
   !> sample within 1/1000 of the step of each time; values are not interpolated, and the samples
   !> keep their own times.
   !>
   !> rows   (m) indices in series%t, ascending
   !> error  a time outside the record or between its samples; a message without file
   subroutine choose_rows(window, series, rows, error)
      type(window_t), intent(in) :: window
      type(series_t), intent(in) :: series
      integer, allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: first, last, step
      integer :: k

      first = series%first
      last = series%last
      step = (last - first)/max(1_ip, series%rows - 1)
      if (allocated(window%t_first)) first = window%t_first
      if (allocated(window%t_last)) last = window%t_last
      if (allocated(window%t_step)) step = window%t_step
      if (first < series%first - tolerance*step .or. last > series%last + tolerance*step) then
         call bad_input(error, 'found samples from '//to_text(series%first)//' to '// &
            to_text(series%last)//', expected the window from '//to_text(first)//' to '// &
            to_text(last)//' to lie inside')
      else if (allocated(window%t_step)) then
         call choose_steps(window_t(max(first, series%first), min(last, series%last), step), &
            series%t, rows, error)
      else
         associate (t => series%t)
            rows = pack([(k, k=1, size(t))], t >= first - tolerance*step .and. &
               t <= last + tolerance*step)
         end associate
         if (size(rows) == 0) call bad_input(error, &
            'found no sample in the window, expected one or more')
      end if
   end subroutine choose_rows

   !> Chooses the rows at t_first, t_first + t_step, ..., each to within `tolerance` steps.
   subroutine choose_steps(window, t, rows, error)
      type(window_t), intent(in) :: window
      real(wp), intent(in) :: t(:)
      integer, allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: times(:)
      integer :: k, row

      call grid(window, times, error)
      if (allocated(error)) return
      allocate (rows(size(times)))
      row = 1
      do k = 1, size(times)
         do while (row < size(t))
            if (t(row) >= times(k) - tolerance*window%t_step) exit
            row = row + 1
         end do
         if (abs(t(row) - times(k)) > tolerance*window%t_step) then
            call bad_input(error, 'found no sample at t = '//to_text(times(k))// &
               ', expected one at every step of '//to_text(window%t_step))
            return
         end if
         rows(k) = row
      end do
   end subroutine choose_steps

end module beamid_windows
