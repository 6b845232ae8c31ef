!> Reads an accelerometer's record and takes the samples of a fit from it: window, clipping,
!> thinning and calibration. `case/` describes records as `recording_t`; experiments get their
!> samples here.
module beamid_records
   use beamid_clipping, only: find_limit
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_rows, only: column_length
   use beamid_series, only: columns_t, part_t, read_series, series_of, series_t
   use beamid_strings, only: to_text
   use beamid_thinning, only: gap_limit, margin_of, thin_out, thinned_t
   use beamid_windows, only: choose_rows, grid, window_t
   implicit none
   private

   public :: window_t, recording_t, frequency_keys_t, columns_t, read_record, load_recording, grid
   public :: add_note, any_in_time, append_recording, are_in_time, note_length, column_length

   !> Length of a note about a record.
   integer, parameter :: note_length = 400
   !> What a record of the kind 'frf' or 'modes' states beside its file.
   type :: frequency_keys_t
      integer :: power = 2   !< 0: receptance, 1: mobility, 2: accelerance
      !> range of the lines that are used, and their distance if there is no file [1/time]; not
      !> allocated: not stated
      real(wp), allocatable :: first, last, step
      real(wp) :: least_coherence = 0   !< lines with a lower coherence are left out
      integer :: averages = 0           !< number of averaged blocks; 0: not stated
      real(wp) :: rate = 0              !< decay rate of an exponential window [1/time]
      logical :: is_hann = .false.      !< the blocks were multiplied by a Hann window
      real(wp), allocatable :: x_F      !< position of the force [length]; not allocated: not stated
   end type frequency_keys_t

   !> A record, in a file or in memory, and how to read it.
   type :: recording_t
      character(len=5) :: kind = 'time'       !< 'time', 'frf' or 'modes'
      type(frequency_keys_t) :: lines = frequency_keys_t()   !< of another kind than 'time'
      character(len=:), allocatable :: path   !< of the file; not allocated: no file
      !> (rows) times [time] and values of a record in memory; messages then refer to it by `path`
      real(wp), allocatable :: t(:), z(:)
      type(window_t) :: window                !< samples that the fit uses
      !> Calibration: acceleration = scale*(value - offset), with the offset in the unit of the
      !> record.
      real(wp) :: scale = 1, offset = 0
      !> names in the header, or numbers from '1'; '': the first and the second column
      character(len=column_length) :: time_column = '', value_column = ''
      real(wp), allocatable :: rate   !< samples per unit of time, if there is no time column
      !> Samples at or beyond these limits are left out, in the unit of the record; not allocated:
      !> the limits are detected.
      real(wp), allocatable :: clip_low, clip_high
      integer :: thin = 1              !< takes every thin-th sample of the low-pass filtered record
      character(len=20) :: time_unit = ''   !< for the notes
      !> length of the beam during this record [length]; not allocated: as in the case
      real(wp), allocatable :: length
      real(wp), allocatable :: sd             !< standard deviation of the noise [acceleration]
      !> positions of sensor and support during this record [length]
      real(wp), allocatable :: x_S, x_P
      character(len=:), allocatable :: sensor   !< name of its sensor
      !> number of the motion of which it is a channel; 0: a motion of its own
      integer :: experiment = 0
      integer :: line = 0                     !< of its group in the case file; 0: none
   end type recording_t

contains

   !> Returns whether all records are functions of time.
   pure logical function are_in_time(recordings)
      type(recording_t), intent(in) :: recordings(:)
      integer :: k

      are_in_time = all([(recordings(k)%kind == 'time', k=1, size(recordings))])
   end function are_in_time

   !> Returns whether any record is a function of time.
   pure logical function any_in_time(recordings)
      type(recording_t), intent(in) :: recordings(:)
      integer :: k

      any_in_time = any([(recordings(k)%kind == 'time', k=1, size(recordings))])
   end function any_in_time

   !> Reads all times and calibrated accelerations of a record.
   !>
   !> t      (rows) strictly increasing [time]
   !> z      (rows) accelerations [length/time**2]
   !> error  `file:line: ...` of the first mistake
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

   !> Takes the samples of a fit from a record: reads it, chooses the window, leaves out samples at
   !> the sensor's limit, thins the rest if requested, and calibrates.
   !>
   !> `thin` applies to windows without t_step. With t_step, samples are taken as recorded, and
   !> times whose samples are at the limit are left out.
   !>
   !> samples   (m) times [time]
   !> measured  (m) accelerations [length/time**2]
   !> notes     sentences about the processing and about anything unusual in the record
   !> error     `file:line: ...` of a mistake in the file, or `place` and `file: ...`
   !> place     text before messages about the window: where the window was requested; default ''
   !> columns   the columns of the file that were read; of a record in memory without names
   subroutine load_recording(recording, samples, measured, notes, error, place, columns)
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), intent(in), optional :: place
      type(columns_t), intent(out), optional :: columns
      type(series_t) :: series
      type(part_t) :: part
      logical, allocatable :: clipped(:)
      integer, allocatable :: rows(:)

      allocate (notes(0))
      ! Some rows beyond the window: its ends are not exact, and clipping is detected from
      ! neighbouring samples.
      part%margin = 100
      if (is_thinned(recording)) part%margin = part%margin + margin_of(recording%thin)
      associate (window => recording%window)
         if (allocated(window%t_first)) part%first = window%t_first
         if (allocated(window%t_last)) part%last = window%t_last
         call read_part(recording, part, series, error)
         if (allocated(error)) return
         if (series%skipped > 0) call add_note(notes, to_text(series%skipped)//' line'// &
            trim(merge('s', ' ', series%skipped > 1))//' of a header skipped')
         call note_columns(series%columns)
         if (present(columns)) columns = series%columns
         call choose_rows(window, series, rows, error)
         if (.not. allocated(error)) call refuse_constant(series%z(rows), error)
         if (.not. allocated(error)) call find_clipped(series%z)
      end associate
      if (.not. allocated(error)) then
         if (.not. allocated(recording%window%t_step)) &
            call note_gaps(series%t(rows(1):rows(size(rows))), notes)
         call calibrate_samples()
      end if
      if (allocated(error)) then
         error%message = recording%path//': '//error%message
         if (present(place)) error%message = place//error%message
      end if

   contains

      !> Adds notes on time stamps, and on the value column if it was chosen by default from
      !> several.
      subroutine note_columns(columns)
         type(columns_t), intent(in) :: columns

         if (allocated(columns%clock)) call add_note(notes, 'time stamps: t is in seconds from '// &
            columns%clock)
         if (columns%count > 2 .and. recording%value_column == '') call add_note(notes, &
            'warning: column '//to_text(columns%places(2))//' ('//shown(trim(columns%names(2)))// &
            ') of '//to_text(columns%count)//' is the record: value_column names another')
      end subroutine note_columns

      !> Finds the samples at the sensor's limit, and refuses a window without other samples.
      !>
      !> z  (rows kept) values in the record's unit
      subroutine find_clipped(z)
         real(wp), intent(in) :: z(:)
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
      end subroutine find_clipped

      !> Takes the samples of some rows, thins them if requested, and calibrates them.
      subroutine calibrate_samples()
         type(thinned_t) :: thinned
         integer, allocatable :: good(:)

         if (is_thinned(recording)) then
            call thin_out(series%t, series%z, clipped, rows, recording%thin, thinned)
            if (size(thinned%t) == 0) then
               call bad_input(error, 'found no sample for which the filter of thin = '// &
                  to_text(recording%thin)//' has the record it needs, '// &
                  to_text(thinned%half_width)//' on either side, expected a longer record or '// &
                  'a smaller number')
               return
            end if
            call note_thinning(thinned)
            call move_alloc(thinned%t, samples)
            call move_alloc(thinned%z, measured)
         else
            good = pack(rows, .not. clipped(rows))
            samples = series%t(good)
            measured = series%z(good)
         end if
         measured = recording%scale*(measured - recording%offset)
      end subroutine calibrate_samples

      !> Adds a note on the band of the filter, so that the user can see whether it contains the
      !> modes.
      subroutine note_thinning(thinned)
         type(thinned_t), intent(in) :: thinned
         character(len=:), allocatable :: unit

         unit = 'cycles per unit of time'
         if (recording%time_unit /= '') unit = 'cycles/'//trim(recording%time_unit)
         if (recording%time_unit == 's') unit = 'Hz'
         call add_note(notes, 'thinned by '//to_text(recording%thin)//': the filter passes up '// &
            'to '//to_text(thinned%passes)//' '//unit//' within 1e-4, stops what lies above '// &
            to_text(thinned%stops)//' and reaches over '//to_text(thinned%half_width)// &
            ' either way')
         if (thinned%lost > 0) call add_note(notes, to_text(thinned%lost)//' of '// &
            to_text(thinned%lost + size(thinned%t))//' thinned samples left out: '// &
            'the filter meets the record''s end, a gap or the sensor''s limit')
      end subroutine note_thinning

   end subroutine load_recording

   !> Appends a recording. (An array constructor would not do for components of deferred length.)
   subroutine append_recording(list, item)
      type(recording_t), allocatable, intent(inout) :: list(:)
      type(recording_t), intent(in) :: item
      type(recording_t), allocatable :: longer(:)

      allocate (longer(size(list) + 1))
      longer(:size(list)) = list
      longer(size(longer)) = item
      call move_alloc(longer, list)
   end subroutine append_recording

   !> Returns whether samples are thinned, behind a low-pass filter.
   pure logical function is_thinned(recording)
      type(recording_t), intent(in) :: recording

      is_thinned = recording%thin > 1 .and. .not. allocated(recording%window%t_step)
   end function is_thinned

   !> Reads a part of a record, in the record's own unit, from the file or from memory.
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
         series, error, recording%rate, stamps=.true.)
   end subroutine read_part

   !> Refuses a constant signal, z (m).
   subroutine refuse_constant(z, error)
      real(wp), intent(in) :: z(:)
      type(error_t), allocatable, intent(inout) :: error

      ! Two samples may well be the same.
      if (size(z) < 3) return
      if (maxval(z) > minval(z)) return
      call bad_input(error, 'found a constant signal ('//to_text(z(1))//' in all '// &
         to_text(size(z))//' samples of the window), expected one that moves')
   end subroutine refuse_constant

   !> Adds a note on the gaps of a record.
   !>
   !> t  (m) times of the samples in the window
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

   !> Appends a note.
   subroutine add_note(notes, text)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      character(len=*), intent(in) :: text

      notes = [character(len=note_length) :: notes, text]
   end subroutine add_note

end module beamid_records
