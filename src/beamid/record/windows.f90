!> Which samples of a record are wanted.
module beamid_windows
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp, ip
   use beamid_series, only: series_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: window_t, grid, take_samples, choose_rows

   !> More sample times than this are taken for a slip of the pen.
   integer, parameter :: max_samples = 1000000
   real(wp), parameter, public :: everything = huge(1.0_wp)

   !> Which samples are wanted; left out, the whole record.
   type :: window_t
      real(wp) :: t_first = -everything   !< [time]
      real(wp) :: t_last = everything     !< [time]
      real(wp) :: t_step = 0              !< [time]; 0: every sample between t_first and t_last
   end type window_t

contains

   !> t_first, t_first + t_step, ..., t_last.
   !>
   !> error  a message without file and key: too many of them
   subroutine grid(window, times, error)
      type(window_t), intent(in) :: window
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: steps
      integer :: k

      steps = (window%t_last - window%t_first)/window%t_step
      if (steps > max_samples) then
         call bad_input(error, 'found '//to_text(steps)//' samples, expected at most '// &
            to_text(max_samples))
         return
      end if
      times = [(window%t_first + k*window%t_step, k=0, int(steps*(1 + 1e-12_wp) + 1e-6_wp))]
   end subroutine grid

   !> The samples of the window. With t_step the record must hold a sample at each of its times, to
   !> within 1/1000 of the step; nothing is interpolated, and the record's own time stamps are kept.
   !>
   !> t, z              record, ascending, of one sample or more
   !> samples, measured the samples taken
   !> error             a message without file: a time outside the record or between its samples
   subroutine take_samples(window, t, z, samples, measured, error)
      type(window_t), intent(in) :: window
      real(wp), intent(in) :: t(:), z(:)
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(series_t) :: series
      integer, allocatable :: rows(:)

      series%t = t
      series%first = t(1)
      series%last = t(size(t))
      series%rows = size(t, kind=ip)
      call choose_rows(window, series, rows, error)
      if (allocated(error)) return
      samples = t(rows)
      measured = z(rows)
   end subroutine take_samples

   !> Which of the rows kept are in the window.
   !>
   !> rows   places in series%t, ascending
   !> error  as of take_samples
   subroutine choose_rows(window, series, rows, error)
      type(window_t), intent(in) :: window
      type(series_t), intent(in) :: series
      integer, allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: near
      integer :: k

      near = 1e-3_wp*window%t_step
      if (window%t_step <= 0) near = 1e-3_wp*(series%last - series%first)/max(1_ip, series%rows - 1)
      if (window%t_first > -everything .and. window%t_first < series%first - near .or. &
         window%t_last < everything .and. window%t_last > series%last + near) then
         call bad_input(error, 'found samples from '//to_text(series%first)//' to '// &
            to_text(series%last)//', expected the window from '// &
            bound(window%t_first, series%first)//' to '//bound(window%t_last, series%last)// &
            ' to lie inside')
      else if (window%t_step > 0) then
         call choose_steps(window, series, near, rows, error)
      else
         associate (t => series%t)
            rows = pack([(k, k=1, size(t))], t >= window%t_first - near .and. &
               t <= window%t_last + near)
         end associate
         if (size(rows) == 0) call bad_input(error, &
            'found no sample in the window, expected one or more')
      end if
   end subroutine choose_rows

   !> The rows at t_first, t_first + t_step, ..., each to within `near`.
   subroutine choose_steps(window, series, near, rows, error)
      type(window_t), intent(in) :: window
      type(series_t), intent(in) :: series
      real(wp), intent(in) :: near
      integer, allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(window_t) :: bounded
      real(wp), allocatable :: times(:)
      integer :: k, row

      bounded = window_t(max(window%t_first, series%first), min(window%t_last, series%last), &
         window%t_step)
      call grid(bounded, times, error)
      if (allocated(error)) return
      allocate (rows(size(times)))
      row = 1
      do k = 1, size(times)
         do while (row < size(series%t))
            if (series%t(row) >= times(k) - near) exit
            row = row + 1
         end do
         if (abs(series%t(row) - times(k)) > near) then
            call bad_input(error, 'found no sample at t = '//to_text(times(k))// &
               ', expected one at every step of '//to_text(window%t_step))
            return
         end if
         rows(k) = row
      end do
   end subroutine choose_steps

   !> A bound of the window as text; that of the record where the window has none.
   pure function bound(value, fallback) result(text)
      real(wp), intent(in) :: value, fallback
      character(len=:), allocatable :: text

      text = to_text(merge(value, fallback, abs(value) < everything))
   end function bound

end module beamid_windows
