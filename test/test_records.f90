!> Records as they come: columns, separators, windows, gaps, and what is refused.
program test_records
   use beamid_errors, only: error_t
   use beamid_outputs, only: output_t
   use beamid_kinds, only: wp
   use beamid_records, only: load_recording, note_length, read_record, recording_t
   use beamid_series, only: part_t, read_series, series_t
   use checks, only: check, check_close, finish
   use shell, only: own_path
   implicit none

   character(len=*), parameter :: nl = achar(10), cr = achar(13), tab = achar(9), &
      mark = char(239)//char(187)//char(191)
   !> Three columns; all numbers are exact in binary.
   character(len=*), parameter :: three = 'time,Temp,acc'//nl//'0,20,1'//nl//'0.5,21,-2'//nl// &
      '1.25,22,4'//nl
   character(len=:), allocatable :: scratch

   !> What came of a record.
   real(wp), allocatable :: t(:), z(:)
   character(len=note_length), allocatable :: notes(:)
   character(len=:), allocatable :: message

   scratch = own_path('records')
   call test_columns()
   call test_separators()
   call test_bad_columns()
   call test_windows()
   call test_long_record()
   call test_gaps()
   call test_calibration()
   call test_refused_windows()
   call test_bad_rows()
   call execute_command_line('rm -r '//scratch)
   call finish('records')

contains

   !> By default the first two columns; else by name in any case, or by number.
   subroutine test_columns()
      call columns('default', three, '', '', [0.0_wp, 0.5_wp, 1.25_wp], [20.0_wp, 21.0_wp, 22.0_wp])
      call three_columns('by name', 'time', 'acc')
      call three_columns('by name in another case', 'TIME', 'ACC')
      call three_columns('by number', '1', '3')
      call three_columns('one by name, one by number', '1', 'acc')
      call three_columns('time by default', '', 'acc')
      call columns('value before time', 'a,t'//nl//'1,0'//nl//'-2,0.5'//nl//'4,1.25'//nl, &
         't', 'a', [0.0_wp, 0.5_wp, 1.25_wp], [1.0_wp, -2.0_wp, 4.0_wp])
      call columns('numbers without a header', '1,0'//nl//'-2,0.5'//nl//'4,1.25'//nl, '2', '1', &
         [0.0_wp, 0.5_wp, 1.25_wp], [1.0_wp, -2.0_wp, 4.0_wp])
      call columns('names in quotes, blanks around', '"Time (s)" , "a z"'//nl//'0,1'//nl// &
         '0.5,-2'//nl//'1.25,4'//nl, 'time (S)', 'A z', [0.0_wp, 0.5_wp, 1.25_wp], &
         [1.0_wp, -2.0_wp, 4.0_wp])
      call columns('a name that is a number', 't,x,2'//nl//'0,9,1'//nl//'0.5,8,-2'//nl// &
         '1.25,7,4'//nl, 't', '2', [0.0_wp, 0.5_wp, 1.25_wp], [1.0_wp, -2.0_wp, 4.0_wp])
      call columns('text in a column that is not wanted', 'time,note,acc'//nl//'0,start,1'//nl// &
         '0.5,,-2'//nl//'1.25,2;3,4'//nl, 'time', 'acc', [0.0_wp, 0.5_wp, 1.25_wp], &
         [1.0_wp, -2.0_wp, 4.0_wp])
   end subroutine test_columns

   subroutine three_columns(what, time_column, value_column)
      character(len=*), intent(in) :: what, time_column, value_column

      call columns(what, three, time_column, value_column, [0.0_wp, 0.5_wp, 1.25_wp], &
         [1.0_wp, -2.0_wp, 4.0_wp])
   end subroutine three_columns

   subroutine test_separators()
      call in_form('semicolons', changed(three, ',', ';'))
      call in_form('tabs', changed(three, ',', tab))
      call in_form('CRLF, byte order mark, comments, blank lines', mark//'# by hand'//cr//nl// &
         changed(three, nl, cr//nl//cr//nl//'  # 7,7,7'//cr//nl))
      call in_form('no line end at the end', three(:len(three) - 1))
   end subroutine test_separators

   subroutine in_form(what, text)
      character(len=*), intent(in) :: what, text

      call columns(what, text, 'time', 'acc', [0.0_wp, 0.5_wp, 1.25_wp], [1.0_wp, -2.0_wp, 4.0_wp])
   end subroutine in_form

   !> Exact: the numbers are.
   subroutine columns(what, text, time_column, value_column, times, values)
      character(len=*), intent(in) :: what, text, time_column, value_column
      real(wp), intent(in) :: times(:), values(:)
      type(recording_t) :: recording
      logical :: ok

      recording%time_column = time_column
      recording%value_column = value_column
      call load(text, recording)
      ok = message == ''
      if (ok) ok = size(t) == size(times) .and. size(z) == size(values)
      if (ok) ok = maxval(abs(t - times)) <= 0 .and. maxval(abs(z - values)) <= 0
      call check('columns: '//what, ok, message)
   end subroutine columns

   subroutine test_bad_columns()
      call bad_columns('unknown name', three, 'time', 'accel', 'record.csv: found the columns '// &
         '''time'', ''Temp'', ''acc'', expected value_column = ''accel'' to be one of them')
      call bad_columns('unknown time', three, 't', 'acc', 'expected time_column = ''t'' to be one')
      call bad_columns('number too large', three, '1', '4', &
         'record.csv: found 3 columns, expected value_column = ''4'' to be one of them')
      call bad_columns('number 0', three, '0', '2', 'found 3 columns, expected time_column = ''0''')
      call bad_columns('a number of 30 digits', three, '1', repeat('9', 30), 'found 3 columns')
      call bad_columns('name without a header', '0,1'//nl//'1,2'//nl, 't', 'a', &
         'record.csv: found no names of columns, expected time_column = ''t''')
      call bad_columns('the same twice', three, '3', 'acc', &
         'record.csv: found column 3 as time_column and as value_column, expected two columns')
      call bad_columns('a name twice', 't,a,A'//nl//'0,1,2'//nl, 't', 'a', &
         'record.csv: found 2 columns called ''a'', expected value_column to name one')
      call bad_columns('row without the column', three//'2,23'//nl, 'time', 'acc', &
         'record.csv:5: column 3 (''acc''): found the end of the line, expected a number')
      call bad_columns('times that do not grow', three, 'acc', 'Temp', &
         'record.csv:3: column 3 (''acc''): found ''-2'' after ''1'', expected a larger')
   end subroutine test_bad_columns

   subroutine bad_columns(what, text, time_column, value_column, words)
      character(len=*), intent(in) :: what, text, time_column, value_column, words
      type(recording_t) :: recording

      recording%time_column = time_column
      recording%value_column = value_column
      call load(text, recording)
      call check('refused: '//what, index(message, words) > 0 .and. &
         index(message, nl) == 0, message)
   end subroutine bad_columns

   !> The stamps of the file, not a grid; ends within 1/1000 of the mean step count as inside.
   subroutine test_windows()
      character(len=*), parameter :: text = '0,1'//nl//'0.1001,2'//nl//'0.2,-1'//nl// &
         '0.35,0'//nl//'0.4,3'//nl//'0.5,1'//nl

      call window('whole', text, [0.0_wp, 0.1001_wp, 0.2_wp, 0.35_wp, 0.4_wp, 0.5_wp])
      call window('t_first', text, [0.2_wp, 0.35_wp, 0.4_wp, 0.5_wp], t_first=0.11_wp)
      call window('both', text, [0.2_wp, 0.35_wp, 0.4_wp], 0.20001_wp, 0.39999_wp)
      call window('t_step', text, [0.0_wp, 0.2_wp, 0.4_wp], t_step=0.2_wp)
   end subroutine test_windows

   subroutine window(what, text, times, t_first, t_last, t_step)
      character(len=*), intent(in) :: what, text
      real(wp), intent(in) :: times(:)
      real(wp), intent(in), optional :: t_first, t_last, t_step
      type(recording_t) :: recording
      logical :: ok

      if (present(t_first)) recording%window%t_first = t_first
      if (present(t_last)) recording%window%t_last = t_last
      if (present(t_step)) recording%window%t_step = t_step
      call load(text, recording)
      ok = message == ''
      if (ok) ok = size(t) == size(times) .and. size(notes) == 0
      if (ok) ok = maxval(abs(t - times)) <= 0
      call check('window: '//what, ok, message)
   end subroutine window

   !> Rows outside the window are not kept, and nothing of the window is lost for it.
   subroutine test_long_record()
      integer, parameter :: n = 30000
      type(recording_t) :: recording
      real(wp), allocatable :: all_t(:), all_z(:)
      type(series_t) :: series
      type(error_t), allocatable :: error
      integer, allocatable :: rows(:)
      integer :: k

      recording%window%t_first = 20.0005_wp
      recording%window%t_last = 25
      call load(table([(k*1e-3_wp, k=1, n)], [(cos(0.1_wp*k), k=1, n)]), recording)
      call check('long record: the window', message == '', message)
      call check('long record: its samples', size(t) == 5000)
      ! Numbers are written with 17 digits and read back exactly.
      call check('long record: first and last', maxval(abs(t([1, 5000]) - &
         [20001*1e-3_wp, 25000*1e-3_wp])) <= 0 .and. &
         maxval(abs(z([1, 5000]) - [cos(0.1_wp*20001), cos(0.1_wp*25000)])) <= 0)
      recording%path = scratch//'/record.csv'
      call read_series(recording%path, [' ', ' '], ['t', 'z'], part_t(20.0005_wp, 25.0_wp, 7), &
         series, error)
      call check('read_series: no error', .not. allocated(error))
      rows = nint(1e3_wp*series%t)
      call check('read_series: 7 rows before and behind', rows(1) <= 20001 - 7 .and. &
         rows(1) > 18000 .and. rows(size(rows)) == 25007)
      call check('read_series: no row twice or missing', &
         all(rows == [(k, k=rows(1), rows(1) + size(rows) - 1)]))
      call check('read_series: the whole file', series%rows == n .and. &
         series%last - series%first > 29.9_wp)
      call read_record(recording, all_t, all_z, error)
      call check('read_record: every row', .not. allocated(error) .and. size(all_t) == n .and. &
         size(all_z) == n)
   end subroutine test_long_record

   !> A gap is told and no more; 15 times the usual step is none, nor is one outside the window.
   subroutine test_gaps()
      type(recording_t) :: recording
      real(wp) :: times(40), values(40)
      integer :: k

      values = [(mod(7*k, 11), k=1, 40)]
      times = [(0.1_wp*k, k=1, 40)]
      call load(table(times, values), recording)
      call check('gaps: none', message == '' .and. size(notes) == 0 .and. size(t) == 40)
      times(21:) = times(21:) + 1.4_wp
      call load(table(times, values), recording)
      call check('gaps: 15 steps', message == '' .and. size(notes) == 0)
      times(21:) = times(21:) + 1.4_wp
      call load(table(times, values), recording)
      call check('gaps: 29 steps', message == '' .and. size(t) == 40 .and. size(notes) == 1, &
         message)
      call check('gaps: the note', all_notes() == '1 gap in the record, the '// &
         'longest from t = 2 to 4.9: more than 20 times the usual step', all_notes())
      times(31:) = times(31:) + 10
      call load(table(times, values), recording)
      call check('gaps: two', index(all_notes(), &
         '2 gaps in the record, the longest from t = 5.8 to 15.9') == 1, all_notes())
      recording%window%t_last = 2
      call load(table(times, values), recording)
      call check('gaps: outside of the window', message == '' .and. size(notes) == 0)
   end subroutine test_gaps

   subroutine test_calibration()
      type(recording_t) :: recording

      recording%scale = -0.5_wp
      recording%offset = 1
      recording%clip_high = 5
      call load('0,1'//nl//'1,3'//nl//'2,5'//nl//'3,-1'//nl, recording)
      ! Limits are in the record's own unit; halves are exact.
      call check('calibration behind the limits', message == '' .and. size(z) == 3, message)
      if (size(z) == 3) call check_close('calibration', maxval(abs(z - [0, -1, 1])), 0.0_wp, 0.0_wp)
   end subroutine test_calibration

   subroutine test_refused_windows()
      type(recording_t) :: recording, limited
      character(len=*), parameter :: moving = '0,1'//nl//'1,2'//nl//'2,1'//nl

      call refused('constant signal', '0,4'//nl//'1,4'//nl//'2,4'//nl, recording, &
         'place: '//scratch//'/record.csv: found a constant signal (4 in all 3 samples')
      limited%clip_low = 2.5_wp
      call refused('all at the limit', moving, limited, &
         'found all 3 samples of the window at the sensor''s limit (2.5)')
      limited%window%t_first = 0.2_wp
      limited%window%t_last = 0.8_wp
      call refused('no sample in the window', moving, limited, 'found no sample in the window')
      limited%window%t_last = 3
      call refused('beyond the record', moving, limited, 'found samples from 0 to 2, expected')
      recording%thin = 2
      call refused('shorter than the filter', moving, recording, &
         'found no sample for which the filter of thin = 2 has the record it needs')
   end subroutine test_refused_windows

   subroutine refused(what, text, recording, words)
      character(len=*), intent(in) :: what, text, words
      type(recording_t), intent(in) :: recording

      call load(text, recording)
      call check('refused: '//what, index(message, words) > 0 .and. &
         index(message, nl) == 0, message)
   end subroutine refused

   !> Every row is checked, in the window or not, with its line.
   subroutine test_bad_rows()
      type(recording_t) :: recording

      recording%window%t_last = 1
      call refused('text', 't,a'//nl//'0,1'//nl//'1,2'//nl//'2,x'//nl, recording, &
         'record.csv:4: column 2 (''a''): found ''x'', expected a number')
      call refused('the same stamp', '0,1'//nl//'1,2'//nl//'1.0,3'//nl, recording, &
         'record.csv:3: column 1: found ''1.0'' after ''1'', expected a larger number')
      call refused('a stamp that goes back', '0,1'//nl//'1,2'//nl//'0.5,3'//nl, recording, &
         'record.csv:3: column 1: found ''0.5'' after ''1''')
      call refused('not finite', '0,1'//nl//'1,Inf'//nl, recording, 'record.csv:2: column 2')
      call refused('decimal commas between semicolons', 't;a'//nl//'0,5;1'//nl, recording, &
         'record.csv:2: column 1 (''t''): found ''0,5'', expected a number (a decimal point is')
      call refused('decimal commas, no header', '0,5;1,5'//nl, recording, &
         'record.csv:1: found both '';'' and '','', expected one separator')
      call refused('decimal commas between tabs', 't'//tab//'a'//nl//'0,5'//tab//'1'//nl, &
         recording, 'record.csv:2: column 1 (''t''): found ''0,5'', expected a number (a decimal')
      call refused('another separator', '0,1'//nl//'1;2'//nl, recording, &
         'record.csv:2: fields are separated by '';'', expected '',''')
      call refused('blanks', '0 1'//nl//'1 2'//nl, recording, &
         'record.csv:1: column 1: found ''0 1''')
   end subroutine test_bad_rows

   !> Writes a record and loads it: t, z, notes, message.
   subroutine load(text, recording)
      character(len=*), intent(in) :: text
      type(recording_t), intent(in) :: recording
      type(recording_t) :: written
      type(error_t), allocatable :: error
      type(output_t) :: output

      call output%add('record.csv', text)
      call output%commit(scratch, error)
      if (allocated(error)) error stop 'scratch folder'
      written = recording
      written%path = scratch//'/record.csv'
      call load_recording(written, t, z, notes, error, place='place: ')
      message = ''
      if (allocated(error)) message = error%message
   end subroutine load

   !> The notes on the record, one behind the other.
   function all_notes() result(text)
      character(len=:), allocatable :: text
      integer :: k

      text = ''
      if (.not. allocated(notes)) return
      do k = 1, size(notes)
         text = text//trim(notes(k))
      end do
   end function all_notes

   !> Rows in full precision.
   function table(times, values) result(text)
      real(wp), intent(in) :: times(:), values(:)
      character(len=:), allocatable :: text
      integer, parameter :: width = 52
      integer :: k

      allocate (character(len=width*size(times)) :: text)
      do k = 1, size(times)
         write (text(width*(k - 1) + 1:width*k), '(es25.16e3,a,es25.16e3,a)') times(k), ',', &
            values(k), nl
      end do
   end function table

   !> A text with every `old` replaced.
   pure function changed(text, old, new) result(copy)
      character(len=*), intent(in) :: text, old, new
      character(len=:), allocatable :: copy
      integer :: k

      copy = ''
      do k = 1, len(text)
         if (text(k:k) == old) then
            copy = copy//new
         else
            copy = copy//text(k:k)
         end if
      end do
   end function changed

end program test_records
