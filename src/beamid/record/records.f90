!> An accelerometer's record: reading it, and taking the samples of a fit from it.
module beamid_records
   use beamid_clipping, only: find_limit
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_rows, only: column_length
   use beamid_series, only: part_t, read_series, series_of, series_t
   use beamid_strings, only: to_text
   use beamid_thinning, only: gap_limit, margin_of, thin_out, thinned_t
   use beamid_windows, only: choose_rows, grid, window_t
   implicit none
   private

   public :: window_t, recording_t, read_record, load_recording, grid
   public :: add_note, append_recording, note_length, column_length

   !> Of a sentence about what was done to a record.
   integer, parameter :: note_length = 200
   !> A record on file, or in memory, and how to read it.
   type :: recording_t
      character(len=:), allocatable :: path   !< not allocated: no file
      !> (rows) samples that are in memory; `path` is what messages call them
      real(wp), allocatable :: t(:), z(:)
      type(window_t) :: window                !< samples of the fit
      !> acceleration = scale*(value - offset), the offset in the record's own unit
      real(wp) :: scale = 1
      real(wp) :: offset = 0
      !> names in the header, or numbers from '1'; '': the first and the second column
      character(len=column_length) :: time_column = '', value_column = ''
      real(wp), allocatable :: rate           !< samples per unit of time; no time column then
      !> Samples at or beyond these are left out, in the record's own unit; not allocated:
      !> limits are looked for.
      real(wp), allocatable :: clip_low, clip_high
      integer :: thin = 1                     !< every thin-th sample, behind a low-pass filter
      character(len=20) :: time_unit = ''     !< for the notes
      real(wp), allocatable :: length         !< of the beam then [length], where it has its own
      real(wp), allocatable :: sd             !< of the noise [acceleration]
      real(wp), allocatable :: x_S, x_P       !< places of sensor and support then [length]
      character(len=:), allocatable :: sensor   !< its name
      integer :: experiment = 0               !< of which motion it is a channel; 0: of its own
      integer :: line = 0                     !< of its group in the case file; 0: there is none
   end type recording_t

contains

   !> Times and calibrated accelerations, all of them.
   !>
   !> t      (rows) strictly increasing [time]
   !> z      (rows) [length/time**2]
   !> error  `file:line: ...` of the first thing that is not a record
   subroutine read_record(recording, t, z, error)
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: t(:), z(:)
      type(error_t), allocatable, intent(out) :: error
      type(series_t) :: series

      call read_part(recording, part_t(), series, error)
      if (allocated(error)) return
      call move_alloc(series%t, t)
      z = recording%scale*(series%z - recording%offset)
   end subroutine read_record

   !> The samples of a fit: reads the record, takes those of the window, leaves out those at the
   !> sensor's limit, thins the rest where that is wanted, calibrates.
   !>
   !> `thin` is for windows without t_step; with t_step samples are taken as they were recorded, and
   !> those of its times that are at the limit are left out.
   !>
   !> samples, measured  (m) [time], [length/time**2]
   !> notes              what was done and what is unusual, a sentence each
   !> error              `file:line: ...` of what is not a record, or `file: ...` behind `place`
   !> place              where the window was asked for, before messages about it; default ''
   subroutine load_recording(recording, samples, measured, notes, error, place)
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in), optional :: place
      type(series_t) :: series
      type(part_t) :: part
      logical, allocatable :: clipped(:)
      integer, allocatable :: rows(:)

      allocate (notes(0))
      ! Some rows more than the window has: its ends are not exact, and a flat shows by what is
      ! beside it.
      part%margin = 100
      if (thins(recording)) part%margin = part%margin + margin_of(recording%thin)
      associate (window => recording%window)
         if (allocated(window%t_first)) part%first = window%t_first
         if (allocated(window%t_last)) part%last = window%t_last
         call read_part(recording, part, series, error)
         if (allocated(error)) return
         if (series%skipped > 0) call add_note(notes, to_text(series%skipped)//' line'// &
            trim(merge('s', ' ', series%skipped > 1))//' of a header skipped')
         call choose_rows(window, series, rows, error)
         if (.not. allocated(error)) call refuse_constant(series%z(rows), error)
         if (.not. allocated(error)) call leave_out_clipped(recording, series%z, rows, clipped, &
            notes, error)
      end associate
      if (.not. allocated(error)) then
         if (.not. allocated(recording%window%t_step)) &
            call note_gaps(series%t(rows(1):rows(size(rows))), notes)
         call take_rows(recording, series, rows, clipped, samples, measured, notes, error)
      end if
      if (allocated(error)) then
         error%message = recording%path//': '//error%message
         if (present(place)) error%message = place//error%message
      end if
   end subroutine load_recording

   !> One recording more. (An array constructor would not do for texts of their own length.)
   subroutine append_recording(list, item)
      type(recording_t), allocatable, intent(inout) :: list(:)
      type(recording_t), intent(in) :: item
      type(recording_t), allocatable :: longer(:)

      allocate (longer(size(list) + 1))
      longer(:size(list)) = list
      longer(size(longer)) = item
      call move_alloc(longer, list)
   end subroutine append_recording

   !> Whether a low-pass filter stands before the samples.
   pure logical function thins(recording)
      type(recording_t), intent(in) :: recording

      thins = recording%thin > 1 .and. .not. allocated(recording%window%t_step)
   end function thins

   !> The record's own numbers.
   subroutine read_part(recording, part, series, error)
      type(recording_t), intent(in) :: recording
      type(part_t), intent(in) :: part
      type(series_t), intent(out) :: series
      type(error_t), allocatable, intent(out) :: error

      if (allocated(recording%t)) then
         call series_of(recording%t, recording%z, part, series, error)
         if (allocated(error)) error%message = recording%path//': '//error%message
         return
      end if
      call read_series(recording%path, [recording%time_column, recording%value_column], part, &
         series, error, recording%rate)
   end subroutine read_part

   subroutine refuse_constant(z, error)
      real(wp), intent(in) :: z(:)
      type(error_t), allocatable, intent(inout) :: error

      ! Two samples may well be the same.
      if (size(z) < 3) return
      if (maxval(z) > minval(z)) return
      call bad_input(error, 'found a constant signal ('//to_text(z(1))//' in all '// &
         to_text(size(z))//' samples of the window), expected one that moves')
   end subroutine refuse_constant

   !> Which rows are at the sensor's limit; refuses a window that holds no other.
   !>
   !> z        (rows kept) in the record's own unit
   !> rows     places in z of the window's samples
   !> clipped  (rows kept)
   subroutine leave_out_clipped(recording, z, rows, clipped, notes, error)
      type(recording_t), intent(in) :: recording
      real(wp), intent(in) :: z(:)
      integer, intent(in) :: rows(:)
      logical, allocatable, intent(out) :: clipped(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(inout) :: error
      character(len=:), allocatable :: limits
      real(wp) :: low, high
      integer :: n

      call find_limit(-z, low)
      low = -low
      call find_limit(z, high)
      if (allocated(recording%clip_low)) low = recording%clip_low
      if (allocated(recording%clip_high)) high = recording%clip_high
      clipped = z <= low .or. z >= high
      n = count(clipped(rows))
      if (n == 0) return
      limits = to_text(high)
      if (any(z(rows) <= low)) limits = to_text(low)
      if (any(z(rows) <= low) .and. any(z(rows) >= high)) limits = limits//' and '//to_text(high)
      if (n == size(rows)) then
         call bad_input(error, 'found all '//to_text(n)//' samples of the window at the '// &
            'sensor''s limit ('//limits//'), expected some within it')
         return
      end if
      call add_note(notes, to_text(n)//' of '//to_text(size(rows))// &
         ' samples left out: at the sensor''s limit ('//limits//')')
   end subroutine leave_out_clipped

   !> Says where the record has gaps.
   subroutine note_gaps(t, notes)
      !> The stamps of the window.
      real(wp), intent(in) :: t(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      real(wp) :: limit
      integer :: n, longest

      if (size(t) < 3) return
      limit = gap_limit(t)
      n = count(t(2:) - t(:size(t) - 1) > limit)
      if (n == 0) return
      longest = maxloc(t(2:) - t(:size(t) - 1), dim=1)
      call add_note(notes, to_text(n)//' gap'//trim(merge('s', ' ', n > 1))// &
         ' in the record, the longest from t = '//to_text(t(longest))//' to '// &
         to_text(t(longest + 1))//': more than 20 times the usual step')
   end subroutine note_gaps

   !> The samples at some rows, thinned where that is wanted, and calibrated.
   subroutine take_rows(recording, series, rows, clipped, samples, measured, notes, error)
      type(recording_t), intent(in) :: recording
      type(series_t), intent(in) :: series
      integer, intent(in) :: rows(:)
      logical, intent(in) :: clipped(:)
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(inout) :: error
      type(thinned_t) :: thinned
      integer, allocatable :: good(:)

      if (thins(recording)) then
         call thin_out(series%t, series%z, clipped, rows, recording%thin, thinned)
         if (size(thinned%t) == 0) then
            call bad_input(error, 'found no sample for which the filter of thin = '// &
               to_text(recording%thin)//' has the record it needs, '// &
               to_text(thinned%half_width)//' on either side, expected a longer record or '// &
               'a smaller number')
            return
         end if
         call note_thinning(recording, thinned, notes)
         call move_alloc(thinned%t, samples)
         call move_alloc(thinned%z, measured)
      else
         good = pack(rows, .not. clipped(rows))
         samples = series%t(good)
         measured = series%z(good)
      end if
      measured = recording%scale*(measured - recording%offset)
   end subroutine take_rows

   !> Says what the filter does, so that the modes can be seen to lie inside.
   subroutine note_thinning(recording, thinned, notes)
      type(recording_t), intent(in) :: recording
      type(thinned_t), intent(in) :: thinned
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      character(len=:), allocatable :: unit

      unit = 'cycles per unit of time'
      if (recording%time_unit /= '') unit = 'cycles/'//trim(recording%time_unit)
      if (recording%time_unit == 's') unit = 'Hz'
      call add_note(notes, 'thinned by '//to_text(recording%thin)//': the filter passes up to '// &
         to_text(thinned%passes)//' '//unit//' within 1e-4, stops what lies above '// &
         to_text(thinned%stops)//' and reaches over '//to_text(thinned%half_width)//' either way')
      if (thinned%lost > 0) call add_note(notes, to_text(thinned%lost)//' of '// &
         to_text(thinned%lost + size(thinned%t))//' thinned samples left out: '// &
         'the filter meets the record''s end, a gap or the sensor''s limit')
   end subroutine note_thinning

   subroutine add_note(notes, text)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      character(len=*), intent(in) :: text

      notes = [character(len=note_length) :: notes, text]
   end subroutine add_note

end module beamid_records
