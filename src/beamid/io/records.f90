!> An accelerometer's record: reading it, and taking the samples of a fit from it.
module beamid_records
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   implicit none
   private

   public :: window_t, recording_t, read_record, take_samples, grid

   !> More sample times than this are taken for a slip of the pen.
   integer, parameter :: max_samples = 1000000
   real(wp), parameter, public :: everything = huge(1.0_wp)

   !> Which samples are wanted; left out, the whole record.
   type :: window_t
      real(wp) :: t_first = -everything   !< [time]
      real(wp) :: t_last = everything     !< [time]
      real(wp) :: t_step = 0              !< [time]; 0: every sample between t_first and t_last
   end type window_t

   !> A record on file and how to read it.
   type :: recording_t
      character(len=:), allocatable :: path   !< not allocated: no file
      type(window_t) :: window                !< samples of the fit
      !> acceleration = scale*(value - offset), the offset in the record's own unit
      real(wp) :: scale = 1
      real(wp) :: offset = 0
      integer :: line = 0                     !< of its group in the case file; 0: there is none
   end type recording_t

contains

   !> Times and calibrated accelerations, from the first two columns of the file.
   !>
   !> t      (rows) strictly increasing [time]
   !> z      (rows) [length/time**2]
   !> error  `file:line: ...` of the first thing that is not a record
   subroutine read_record(recording, t, z, error)
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: t(:), z(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=column_length), allocatable :: header(:)
      real(wp), allocatable :: values(:, :)

      call read_columns(recording%path, 2, values, header, error, increasing=.true.)
      if (allocated(error)) return
      t = values(1, :)
      z = recording%scale*(values(2, :) - recording%offset)
   end subroutine read_record

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
   !> t, z              record, ascending
   !> samples, measured the samples taken
   !> error             a message without file: a time outside the record or between its samples
   subroutine take_samples(window, t, z, samples, measured, error)
      type(window_t), intent(in) :: window
      real(wp), intent(in) :: t(:), z(:)
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(window_t) :: bounded
      real(wp), allocatable :: times(:)
      integer, allocatable :: place(:)
      real(wp) :: near
      integer :: k, row

      near = 1e-3_wp*window%t_step
      if (window%t_step <= 0 .and. size(t) > 1) near = 1e-3_wp*(t(size(t)) - t(1))/(size(t) - 1)
      if (window%t_first > -everything .and. window%t_first < t(1) - near .or. &
         window%t_last < everything .and. window%t_last > t(size(t)) + near) then
         call bad_input(error, 'found samples from '//to_text(t(1))//' to '//to_text(t(size(t)))// &
            ', expected the window from '//bound(window%t_first, t(1))//' to '// &
            bound(window%t_last, t(size(t)))//' to lie inside')
         return
      end if
      if (window%t_step <= 0) then
         samples = pack(t, t >= window%t_first - near .and. t <= window%t_last + near)
         measured = pack(z, t >= window%t_first - near .and. t <= window%t_last + near)
         if (size(samples) == 0) call bad_input(error, &
            'found no sample in the window, expected one or more')
         return
      end if

      bounded = window_t(max(window%t_first, t(1)), min(window%t_last, t(size(t))), window%t_step)
      call grid(bounded, times, error)
      if (allocated(error)) return
      allocate (place(size(times)))
      row = 1
      do k = 1, size(times)
         do while (row < size(t))
            if (t(row) >= times(k) - near) exit
            row = row + 1
         end do
         if (abs(t(row) - times(k)) > near) then
            call bad_input(error, 'found no sample at t = '//to_text(times(k))// &
               ', expected one at every step of '//to_text(window%t_step))
            return
         end if
         place(k) = row
      end do
      samples = t(place)
      measured = z(place)
   end subroutine take_samples

   !> A bound of the window as text; that of the record where the window has none.
   pure function bound(value, fallback) result(text)
      real(wp), intent(in) :: value, fallback
      character(len=:), allocatable :: text

      text = to_text(merge(value, fallback, abs(value) < everything))
   end function bound

end module beamid_records
