!> Records as they come: columns, separators, windows, gaps, and what is refused.
program test_records
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_outputs, only: output_t
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
   call test_headers()
   call test_labview()
   call test_rate()
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
   subroutine columns(what, text, time_column, value_column, times, values, rate)
      character(len=*), intent(in) :: what, text, time_column, value_column
      real(wp), intent(in) :: times(:), values(:)
      real(wp), intent(in), optional :: rate
      type(recording_t) :: recording
      logical :: ok

      recording%time_column = time_column
      recording%value_column = value_column
      if (present(rate)) recording%rate = rate
      call load(text, recording)
      ok = message == ''
      if (ok) ok = size(t) == size(times) .and. size(z) == size(values)
      if (ok) ok = maxval(abs(t - times)) <= 0 .and. maxval(abs(z - values)) <= 0
      call check('columns: '//what, ok, message)
   end subroutine columns

   !> What LabVIEW writes: two headers, tabs, a column of remarks that is empty but for the first
   !> row, and in files without times a first column that is empty too.
   subroutine test_labview()
      character(len=*), parameter :: stop = '***End_of_Header***', first = &
         'LabVIEW Measurement'//tab//nl//'Writer_Version'//tab//'2'//nl//'Separator'//tab//'Tab'// &
         nl//'Decimal_Separator'//tab//'.'//nl//'Multi_Headings'//tab//'Yes'//nl//'X_Columns'// &
         tab//'One'//nl//'Time_Pref'//tab//'Absolute'//nl//'Date'//tab//'2019/05/06'//nl// &
         'Time'//tab//'12:00:00,1234567'//nl//stop//tab//nl//tab//nl, second = &
         'Channels'//tab//'2'//tab//tab//nl//'Samples'//tab//'3'//tab//'3'//tab//nl// &
         'Date'//tab//'2019/05/06'//tab//'2019/05/06'//tab//nl//'Time'//tab//'12:00:01,5'//tab// &
         '12:00:01,5'//tab//nl//'Y_Unit_Label'//tab//'g'//tab//'g'//tab//nl// &
         'X0'//tab//'0.0000000000000000E+0'//tab//'0.0000000000000000E+0'//tab//nl// &
         'Delta_X'//tab//'0.500000'//tab//'0.500000'//tab//nl//stop//tab//tab//tab//nl, &
         names = 'X_Value'//tab//'Temp'//tab//'Acc 0'//tab//'Comment'//nl, &
         rows = '0.000000'//tab//'20.0'//tab//'1.0'//tab//'begun, by hand'//nl// &
         '0.500000'//tab//'21.0'//tab//'-2.0'//tab//nl//'1.250000'//tab//'22.0'//tab//'4.0'//nl, &
         no_times = tab//'20.0'//tab//'1.0'//tab//nl//tab//'21.0'//tab//'-2.0'//nl//tab//'22.0'// &
         tab//'4.0'//nl, skipped = '18 lines of a header skipped'
      real(wp), parameter :: times(3) = [0.0_wp, 0.5_wp, 1.25_wp], values(3) = [1, -2, 4]

      call columns('.lvm', first//second//names//rows, 'x_value', 'acc 0', times, values)
      call check('  said', all_notes() == skipped, all_notes())
      call columns('.lvm, line ends of Windows', changed(first//second//names//rows, nl, cr//nl), &
         'x_value', '3', times, values)
      call columns('.lvm, decimal commas', first//second//names//changed(rows, '.', ','), &
         'x_value', 'acc 0', times, values)
      call columns('.lvm, without a remark in the first row', first//second//names// &
         rows(index(rows, nl) + 1:), 'x_value', 'acc 0', times(2:), values(2:))
      call columns('.lvm without times', first//second//names//no_times, '', 'acc 0', &
         [0.0_wp, 0.5_wp, 1.0_wp], values, rate=2.0_wp)
      call columns('.lvm without names', first//second//rows, '1', '3', times, values)
      call check('  said', all_notes() == skipped, all_notes())
      call columns('waveforms as text', 'waveform'//tab//'[0]'//tab//nl//'t0'//tab// &
         '06/05/2019 12:00:00,5'//nl//'delta t'//tab//'0,500000'//nl//nl//'time[0]'//tab//'Y[0]'// &
         nl//'06/05/2019 12:00:00,5'//tab//'1,0E+0'//nl//'06/05/2019 12:00:01,0'//tab//'-2,0E+0'// &
         nl//'06/05/2019 12:00:01,5'//tab//'4,0E+0'//nl, '', 'Y[0]', [0.0_wp, 0.5_wp, 1.0_wp], &
         values, rate=2.0_wp)
      call bad_columns('.lvm without times or a rate', first//second//names//no_times, '', '3', &
         'record.csv:21: column 1 (''X_Value''): found an empty field, expected a number')
      call bad_columns('.lvm of two segments', first//second//names//rows//second//names//rows, &
         '', '3', 'record.csv:24: column 1 (''X_Value''): found ''Channels'', expected a number')
   end subroutine test_labview

   !> Samples without times: the first at 0, the others by their number. Times are exact: the rate
   !> is a power of two.
   subroutine test_rate()
      real(wp), parameter :: times(3) = [0.0_wp, 0.25_wp, 0.5_wp], values(3) = [1, -2, 4]

      call columns('rate: one column', '1'//nl//'-2'//nl//'4'//nl, '', '', times, values, 4.0_wp)
      call columns('rate: one column with a name', 'acc'//nl//'1'//nl//'-2'//nl//'4', '', 'ACC', &
         times, values, 4.0_wp)
      call columns('rate: behind a header', 'Recorder 5'//nl//'Rate,4'//nl//'acc'//nl//'1'//nl// &
         '-2'//nl//'4', '', '', times, values, 4.0_wp)
      call columns('rate: decimal commas and an empty column', &
         '1,0;'//nl//'-2,0;'//nl//'4,0;'//nl, '', '', times, values, 4.0_wp)
      call columns('rate: of three columns', three, '', 'acc', times, values, 4.0_wp)
      call columns('rate: by number', three(15:), '', '3', times, values, 4.0_wp)
      call bad_columns('rate: several columns', three, '', '', &
         'record.csv: found 3 columns, expected value_column to name one of them', 4.0_wp)
      call bad_columns('rate: decimal commas or two columns', '1,0'//nl//'2,0'//nl, '', '', &
         'record.csv:1: found ''1,0'', which reads as 2 columns, expected a decimal point in '// &
         'place of the decimal comma, or value_column', 4.0_wp)
      call bad_columns('rate: two columns', '1.5,2'//nl//'2,3'//nl, '', '', &
         'record.csv: found 2 columns, expected value_column to name one of them', 4.0_wp)
      call bad_columns('one column with decimal commas', '0,29'//nl//'-0,97'//nl, '', '', &
         'record.csv:2: column 1: found ''-0'' after ''0'', expected a larger number (or a '// &
         'decimal point in ''-0,97'' in place of the decimal comma)')
      call bad_columns('rate: decimal commas below a name', 'acc'//nl//'1,0'//nl//'2,0'//nl, '', &
         '', 'record.csv:2: found twice as many fields as names', 4.0_wp)
      call bad_columns('rate: a line is empty', '1'//nl//'-2'//nl//nl//'4'//nl, '', '', &
         'record.csv:4: found a line without numbers before this one, expected none', 4.0_wp)
      call bad_columns('rate: a gap', 't,acc'//nl//'0,1'//nl//'1,'//nl//'2,1'//nl, '', 'acc', &
         'record.csv:3: column 2 (''acc''): found an empty field, expected a number', 4.0_wp)
   end subroutine test_rate

   !> Lines of a header, as recorders write them; the numbers are those of `three`.
   subroutine test_headers()
      call headed('none', three, '')
      call headed('one line', 'Recorder 5'//nl//three, '1 line of a header skipped')
      call headed('lines with other numbers of fields', 'Recorder,5'//nl//'Started,2024-05-01,'// &
         '10:00:00,UTC'//nl//nl//'# a remark'//nl//'2000 samples per second'//nl//three, &
         '3 lines of a header skipped')
      call headed('lines with as many fields', 'Recorder,AX-3,rev B'//nl//'2024-05-01,10:00:00,'// &
         'UTC'//nl//'Rates,2000,2000'//nl//three, '3 lines of a header skipped')
      call headed('a rate behind each channel', 'Channels'//tab//'2'//tab//nl//'Samples'//tab// &
         '3'//tab//'3'//nl//changed(three, ',', tab), '2 lines of a header skipped')
      call headed('lines of numbers', '1024'//nl//'0.5'//nl//three, '2 lines of a header skipped')
      call headed('a line below the names', three(:14)//'in SI units'//nl//three(15:), &
         '1 line of a header skipped')
      call headed('another separator in the header', 'Recorder; model 5; made, 2020'//nl// &
         'Rate, 2000'//nl//changed(three, ',', tab), '2 lines of a header skipped')
      call columns('the last of the lines names the columns', 'p,q,r'//nl//'time,Temp,acc'//nl// &
         three(15:), 'time', 'Acc', [0.0_wp, 0.5_wp, 1.25_wp], [1.0_wp, -2.0_wp, 4.0_wp])
      call columns('text beside the numbers', 'Recorder'//nl//'time,note,acc'//nl//'0,start,1'//nl &
         //'0.5,,-2'//nl//'1.25,x,4'//nl, 'time', 'acc', [0.0_wp, 0.5_wp, 1.25_wp], &
         [1.0_wp, -2.0_wp, 4.0_wp])
      call columns('no names', 'Recorder, model 5, 2020'//nl//'by hand'//nl//three(15:), '1', '3', &
         [0.0_wp, 0.5_wp, 1.25_wp], [1.0_wp, -2.0_wp, 4.0_wp])
   end subroutine test_headers

   !> The numbers of `three` behind a header, and the sentence about it.
   subroutine headed(what, text, sentence)
      character(len=*), intent(in) :: what, text, sentence

      call in_form('header: '//what, text)
      call check('  said', all_notes() == sentence, all_notes())
   end subroutine headed

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

   subroutine bad_columns(what, text, time_column, value_column, words, rate)
      character(len=*), intent(in) :: what, text, time_column, value_column, words
      real(wp), intent(in), optional :: rate
      type(recording_t) :: recording

      recording%time_column = time_column
      recording%value_column = value_column
      if (present(rate)) recording%rate = rate
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
      call read_series(recording%path, [' ', ' '], part_t(20.0005_wp, 25.0_wp, 7), &
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
      call refused('a decimal point behind decimal commas', 't;a'//nl//'0,5;1'//nl//'0.6;2'//nl, &
         recording, 'record.csv:3: column 1 (''t''): found ''0.6'', expected a number (a decimal')
      call refused('a decimal comma behind decimal points', 't'//tab//'a'//nl//'0.5'//tab//'1'//nl &
         //'0,6'//tab//'2'//nl, recording, &
         'record.csv:3: column 1 (''t''): found ''0,6'', expected a number (a decimal point is')
      call refused('decimal commas between commas', 'x'//nl//'t,a'//nl//'0,5,1,5'//nl, recording, &
         'record.csv:3: found twice as many fields as names')
      call refused('a bad first row', 'x,y'//nl//'t,a'//nl//'0,z'//nl//'1,2'//nl, recording, &
         'record.csv:3: column 2 (''a''): found ''z'', expected a number')
      call refused('a short first row', 'x'//nl//'t,a'//nl//'0'//nl//'1,2'//nl, recording, &
         'record.csv:3: column 2 (''a''): found the end of the line, expected a number')
      call refused('a bad first row without names', '0,z'//nl//'1,2'//nl, recording, &
         'record.csv:1: column 2: found ''z'', expected a number')
      call refused('names between the rows', '0,1'//nl//'t,a'//nl//'1,2'//nl, recording, &
         'record.csv:2: column 1: found ''t'', expected a number')
      call refused('text through and through', 'Dear reader,'//nl//'this is no record, it is a'// &
         ' letter.'//nl//'Yours, 7'//nl, recording, 'record.csv:2: column 1 (''Dear reader''): '// &
         'found ''this is no record'', expected a number')
      call refused('lines of words', 'one'//nl//'two'//nl//'three'//nl, recording, &
         'record.csv:1: found ''one'', expected 2 columns separated by')
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
