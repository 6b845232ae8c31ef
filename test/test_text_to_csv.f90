!> Text of recorders, phones and spreadsheets becomes columns: each file is written here, character
!> by character, converted by the script and read as a record; or refused in one line.
program test_text_to_csv
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_records, only: read_record, recording_t
   use checks, only: check, finish, skip
   use shell, only: close_shell, has_all, in_scratch, line_count, open_shell, outcome_t, &
      python_with, read_file, replaced, run, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10), cr = achar(13), tab = achar(9), &
      script = ' ../../scripts/to_csv.py '
   real(wp), parameter :: t_exact(3) = [0.0_wp, 0.5_wp, 1.25_wp], halves(3) = [0.0_wp, 0.5_wp, &
      1.0_wp], &
      a(3) = [1.0_wp, -2.5_wp, 4.0_wp], f(3) = [0.0_wp, 2.0_wp, 0.25_wp]
   !> Parts of an .lvm file: a header, the header of a segment, names and rows.
   character(len=*), parameter :: stop = '***End_of_Header***', head = &
      'LabVIEW Measurement'//tab//nl//'Writer_Version'//tab//'2'//nl//'Reader_Version'//tab//'2'// &
      nl//'Separator'//tab//'Tab'//nl//'Decimal_Separator'//tab//'.'//nl//'Multi_Headings'//tab// &
      'Yes'//nl//'X_Columns'//tab//'One'//nl//'Time_Pref'//tab//'Relative'//nl//'Operator'//tab// &
      'B'//nl//'Date'//tab//'2024/05/01'//nl//'Time'//tab//'12:00:00,5'//nl//stop//tab//nl//tab// &
      nl, &
      segment = 'Channels'//tab//'2'//tab//tab//nl//'Samples'//tab//'3'//tab//'3'//tab//nl// &
      'Date'//tab//'2024/05/01'//tab//'2024/05/01'//tab//nl//'Time'//tab//'12:00:00,5'//tab// &
      '12:00:00,5'//tab//nl//'Y_Unit_Label'//tab//'g'//tab//'N'//tab//nl//'X_Dimension'//tab// &
      'Time'//tab//'Time'//tab//nl//'X0'//tab//'0.0E+0'//tab//'0.0E+0'//tab//nl//'Delta_X'//tab// &
      '0.500000'//tab//'0.500000'//tab//nl//stop//tab//tab//tab//nl, &
      names = 'X_Value'//tab//'acc'//tab//'force'//tab//'Comment'//nl, &
      rows = '0.000000'//tab//'1.0'//tab//'0.0'//tab//'begun, by hand'//nl//'0.500000'//tab// &
      '-2.5'//tab//'2.0'//nl//'1.000000'//tab//'4.0'//tab//'0.25'//nl, &
      no_times = tab//'1.0'//tab//'0.0'//tab//nl//tab//'-2.5'//tab//'2.0'//nl//tab//'4.0'//tab// &
      '0.25'//nl
   character(len=:), allocatable :: reason, python
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason == '') then
      python = python_with('numpy')
      if (python == '') reason = 'no numpy'
   end if
   if (reason /= '') then
      call skip('to_csv.py on text', reason)
   else
      call test_lvm()
      call test_lvm_without_times()
      call test_lvm_segments()
      call test_bad_lvm()
      call test_times()
      call test_archive()
      call test_forms()
      call test_bad_text()
   end if
   call close_shell()
   call finish('text_to_csv')

contains

   !> One column of times, one for each channel, other signs.
   subroutine test_lvm()
      character(len=:), allocatable :: text

      call converted('lvm', 'x.lvm', head//segment//names//rows)
      call column('lvm: the first channel', 'x.csv', 'acc [g]', halves, a)
      call column('lvm: the second channel', 'x.csv', 'force', halves, f)
      text = read_file('x.csv')
      call check('lvm: what the file says is kept', has_all(text, '# operator = B'//nl//'|'// &
         'Date 2024/05/01; Time 12:00:00,5'//nl//'|'//nl//'t [s],acc [g],force [N]'//nl), text)
      call converted('lvm: decimal commas, line ends of Windows', 'c.lvm', replaced( &
         replaced(head, 'Separator'//tab//'.', 'Separator'//tab//',')// &
         replaced(segment//names//rows, '.', ','), nl, cr//nl))
      call column('lvm: decimal commas', 'c.csv', 'acc', halves, a)
      call converted('lvm: commas between the fields', 'k.lvm', replaced(replaced( &
         replaced(replaced(head, 'Separator'//tab//'Tab', 'Separator'//tab//'Comma')//segment// &
         names//rows, 'begun, by hand', 'begun'), ',', ';'), tab, ','))
      call column('lvm: commas between the fields', 'k.csv', 'force', halves, f)
      call converted('lvm: times for each channel', 'm.lvm', replaced(head, 'X_Columns'//tab// &
         'One', 'X_Columns'//tab//'Multi')//segment//'X_Value'//tab//'acc'//tab//'X_Value'//tab// &
         'force'//tab//'Comment'//nl//'0.0'//tab//'1.0'//tab//'0.25'//tab//'0.0'//nl//'0.5'//tab// &
         '-2.5'//tab//'0.75'//tab//'2.0'//nl//'1.0'//tab//'4.0'//tab//'1.5'//tab//'0.25'//nl)
      call column('lvm: times of the first channel', 'm.csv', 'acc', halves, a)
      call column('lvm: times of the second channel', 'm_2.csv', 'force', 0.25_wp + t_exact, f)
      call converted('lvm: rounded times', 'r.lvm', replaced(replaced(head//replaced(segment, &
         '0.500000'//tab//'0.500000', '2.5E-4'//tab//'2.5E-4')//names//rows, '0.500000', '0.000'), &
         '1.000000', '0.001'))
      call column('lvm: the step replaces rounded times', 'r.csv', 'acc', 5e-4_wp*halves, a)
      call converted('lvm: a special block', 's.lvm', head//'***Start_Special***'//nl//'Key'// &
         tab// &
         '1'//nl//'***End_Special***'//nl//nl//segment//names//rows)
      call column('lvm: a special block', 's.csv', 'acc', halves, a)
      call converted('lvm: a shorter channel', 'h.lvm', head//replaced(segment, '3'//tab//'3', &
         '3'//tab//'2')//names//replaced(rows, '4.0'//tab//'0.25', '4.0'//tab))
      call column('lvm: a shorter channel', 'h_2.csv', 'force', halves(:2), f(:2))
   end subroutine test_lvm

   subroutine test_lvm_without_times()
      character(len=:), allocatable :: no_columns

      no_columns = replaced(head, 'X_Columns'//tab//'One', 'X_Columns'//tab//'No')
      call converted('lvm: no column of times', 'n.lvm', no_columns//segment//names//no_times)
      call column('lvm: no column of times', 'n.csv', 'force', halves, f)
      call converted('lvm: rows beyond the header''s samples', 'b.lvm', replaced(replaced( &
         no_columns, 'Headings'//tab//'Yes', 'Headings'//tab//'No')//segment, '3'//tab//'3', &
         '1'//tab//'1')//names//no_times, 'acc gets no times|the step of 1 of 3 samples')
      call column('lvm: rows beyond the header''s samples', 'b.csv', 'acc', 0.5_wp*[0, 1, 2], a, &
         rate=2.0_wp)
      call converted('lvm: no step', 'z.lvm', no_columns//replaced(segment, 'Delta_X', &
         'Delta_Y')// &
         names//no_times, 'acc gets no times|states no step Delta_X')
   end subroutine test_lvm_without_times

   subroutine test_lvm_segments()
      call converted('lvm: segments that follow', 'f.lvm', head//segment//names//rows//nl// &
         replaced(segment, '0.0E+0'//tab//'0.0E+0', '1.5E+0'//tab//'1.5E+0')//names//replaced( &
         replaced(replaced(rows, '1.000000', '2.500000'), '0.500000', '2.000000'), '0.000000', &
         '1.500000'))
      call column('lvm: segments that follow are joined', 'f.csv', 'acc', [halves, &
         1.5_wp + halves], &
         [a, a])
      call converted('lvm: segments that begin again', 'g.lvm', head//segment//names//rows//nl// &
         segment//names//rows)
      call column('lvm: segments that begin again', 'g.csv', 'segment 2/acc', halves, a)
   end subroutine test_lvm_segments

   subroutine test_bad_lvm()
      character(len=*), parameter :: good = head//segment//names//rows

      call refused_lvm('text', replaced(good, '-2.5', 'x'), ':25: column 2 (''acc''): found ''x''')
      call refused_lvm('NaN', replaced(good, '-2.5', 'NaN'), &
         ':25: column 2 (''acc''): found ''NaN''')
      call refused_lvm('an empty field', replaced(good, '-2.5', ''), &
         ':25: column 2 (''acc''): found an empty field')
      call refused_lvm('another decimal sign', replaced(good, '-2.5', '-2,5'), &
         ':25: column 2 (''acc''): found ''-2,5''|Decimal_Separator is ''.''')
      call refused_lvm('a time twice', replaced(good, '1.000000', '0.500000'), &
         ':26: column 1 (''X_Value''): found ''0.500000'' after ''0.500000''')
      call refused_lvm('too few rows', replaced(good, '3'//tab//'3', '4'//tab//'4'), &
         ':23: found 3 samples of ''acc''|expected 4 as Samples says')
      call refused_lvm('too many rows', replaced(good, '3'//tab//'3', '2'//tab//'2'), &
         ':23: found 3 samples of ''acc''|expected 2')
      call refused_lvm('too few names', head//segment//replaced(names, tab//'force', '')//rows, &
         ':23: found 1 names of channels|expected 2')
      call refused_lvm('a row that is too long', replaced(good, '4.0'//tab//'0.25', &
         '4.0'//tab//'0.25'//tab//'1'//tab//'1'), ':26: found 5 fields|expected 4')
      call refused_lvm('no names', head//segment, ':22: found the end of the file')
      call refused_lvm('no segment', head, 'found no segment')
      call refused_lvm('no header of a segment', head//names//rows, &
         ':14: found ''X_Value''|expected ''Channels''')
      call refused_lvm('a header without end', head//segment(:60), &
         ':14: found a header without ***End_of_Header***')
      call refused_lvm('another beginning', 'Recorder'//nl//good, ':1: found no ''LabVIEW Meas')
      call refused_lvm('nothing', '', ':1: found no ''LabVIEW Measurement''')
      call refused_lvm('one sign for both', replaced(replaced(good, 'Separator'//tab//'Tab', &
         'Separator'//tab//'Comma'), 'Separator'//tab//'.', 'Separator'//tab//','), ':1: found')
      call refused_lvm('unknown columns', replaced(good, 'X_Columns'//tab//'One', &
         'X_Columns'//tab//'Two'), ':1: found X_Columns ''two''')
      call refused_lvm('a spectrum', replaced(good, 'Time'//tab//'Time', 'Frequency'//tab// &
         'Frequency'), 'found neither|acc is no function of time')
   end subroutine test_bad_lvm

   subroutine refused_lvm(what, text, words)
      character(len=*), intent(in) :: what, text, words

      call refused('lvm: '//what, 'bad.lvm', text, 'bad.lvm|'//words)
   end subroutine refused_lvm

   !> Times in other units, and time stamps.
   subroutine test_times()
      call converted('times in ms', 'ms.csv', 'Time (ms),a (g)'//nl//'0,1'//nl//'500,-2.5'//nl// &
         '1250,4'//nl)
      call column('times in ms', 'ms_seconds.csv', 'a [g]', t_exact, a)
      call check('  said', has_all(read_file('ms_seconds.csv'), 'converted from ms to s'))
      call converted('minutes in a line of units', 'min.txt', 't'//tab//'a'//nl//'min'//tab//'g'// &
         nl//'0'//tab//'1'//nl//'0,5'//tab//'-2,5'//nl//'1,25'//tab//'4'//nl)
      call column('minutes in a line of units', 'min.csv', 'a', 60*t_exact, a)
      call converted('time stamps', 'iso.csv', 'time,a'//nl//'2024-05-01T23:59:59.5Z,1'//nl// &
         '2024-05-02T00:00:00Z,-2.5'//nl//'2024-05-02T00:00:00.75Z,4'//nl)
      call column('time stamps', 'iso_seconds.csv', 'a', t_exact, a)
      call converted('a spreadsheet', 'sheet.csv', '"Zeit";"a"'//nl// &
         '31.12.2023 23:59:59,5;"1,0"'// &
         nl//'01.01.2024 00:00:00;"-2,5"'//nl//'01.01.2024 00:00:00,75;"4,0"'//nl)
      call column('a spreadsheet', 'sheet_seconds.csv', 'a', t_exact, a)
      call converted('twelve hours', 'pm.csv', 't,a'//nl//'11:59:59.5 PM,1'//nl// &
         '12:00:00 AM,-2.5'//nl//'12:00:00.75 AM,4'//nl)
      call column('twelve hours', 'pm_seconds.csv', 'a', t_exact, a)
      call converted('milliseconds since 1970', 'unix.csv', 'timestamp,a'//nl//'1714564800123,1'// &
         nl//'1714564800623,-2.5'//nl//'1714564801373,4'//nl, options='--time-unit ms')
      call column('milliseconds since 1970', 'unix_seconds.csv', 'a', t_exact, a)
      call converted('days', 'days.csv', 'when,a'//nl//'45413.5,1'//nl//'45414,-2.5'//nl// &
         '45414.75,4'//nl, options='--time-unit d')
      call column('days', 'days_seconds.csv', 'a', 86400*t_exact, a)
   end subroutine test_times

   !> What phyphox saves: one file for each sensor, and facts of the phone.
   subroutine test_archive()
      call write_file('Accelerometer.csv', '"Time (s)","X (m/s^2)","Z (m/s^2)"'//nl// &
         '0.0E0,2.0E0,1.0E0'//nl//'5.0E-1,2.0E0,-2.5E0'//nl//'1.25E0,2.0E0,4.0E0'//nl)
      call write_file('Gyroscope.csv', '"Time (s)","X (rad/s)"'//nl//'0.0E0,0.0E0'//nl// &
         '5.0E-1,2.0E0'//nl//'1.0E0,2.5E-1'//nl)
      call write_file('meta/device.csv', 'property,value'//nl//'version,1'//nl)
      call write_file('a.csv', 't,a'//nl//'0,1'//nl//'1,x'//nl)
      call write_file('make.py', 'import zipfile'//nl//'def pack(name, *files):'//nl// &
         '    with zipfile.ZipFile(name, "w") as z:'//nl//'        [z.write(f) for f in files]'// &
         nl//'pack("p.zip", "Accelerometer.csv", "Gyroscope.csv", "meta/device.csv")'//nl// &
         'pack("bad.zip", "a.csv")'//nl//'pack("meta.zip", "meta/device.csv")'//nl)
      outcome = run(python//' make.py')
      call check('an archive is written', outcome%status == 0, outcome%err)
      call converted('an archive', 'p.zip', '')
      call column('an archive: the first table', 'p.csv', 'Accelerometer/Z [m/s^2]', t_exact, a)
      call column('an archive: the second table', 'p_2.csv', 'Gyroscope/X', halves, f)
      call refused('an archive with a mistake', 'bad.zip', '', &
         'bad.zip: a.csv:3: column 2 (''a''): found ''x''|expected a number')
      call refused('an archive without tables', 'meta.zip', '', 'meta.zip: found neither')
      call refused('no archive', 'no.zip', 'text', 'no.zip: cannot be read: ')
   end subroutine test_archive

   subroutine test_forms()
      character(len=1), parameter :: zero = achar(0)
      character(len=*), parameter :: plain = 't'//tab//'a'//nl//'0'//tab//'1'//nl//'0,5'//tab// &
         '-2,5'//nl//'1,25'//tab//'4'//nl
      character(len=:), allocatable :: wide
      integer :: k

      wide = char(255)//char(254)
      do k = 1, len(plain)
         wide = wide//plain(k:k)//zero
      end do
      call converted('UTF-16', 'wide.txt', wide)
      call column('UTF-16', 'wide.csv', 'a', t_exact, a)
      call converted('a column of text', 'note.txt', 't;note;a;'//nl//'0;"x; y";1;'//nl// &
         '0.5;;-2.5;'//nl//'1.25;z;4;'//nl, 'note contains no numbers: left out')
      call column('a column of text', 'note.csv', 'a', t_exact, a)
      call converted('no times', 'plain.txt', 'Logger 5'//nl//'x,y'//nl//'5,1'//nl//'5,-2.5'//nl// &
         '4,4'//nl)
      call column('no times', 'plain.csv', 'y', halves, a, rate=2.0_wp)
      call check('  the header is kept', has_all(read_file('plain.csv'), '# Logger 5'//nl))
   end subroutine test_forms

   subroutine test_bad_text()
      call refused_text('a row that is short', 't,a'//nl//'0,1'//nl//'0.5'//nl, &
         ':3: column 2 (''a''): found the end of the line')
      call refused_text('a row that is long', 't,a'//nl//'0,1'//nl//'0.5,1,5'//nl, &
         ':3: found 3 fields|expected 2')
      call refused_text('a time twice', 't,a'//nl//'0,1'//nl//'0.5,1'//nl//'0.5,2'//nl, &
         ':4: column 1 (''t''): found ''0.5'' after ''0.5''')
      call refused_text('a number below stamps', 't,a'//nl//'12:00:00,1'//nl//'0.5,1'//nl, &
         ':3: column 1 (''t''): found ''0.5''|expected a time stamp like ''12:00:00''')
      call refused_text('seconds that are lost', 't,a'//nl//'1/5/2024 12:00,1'//nl// &
         '1/5/2024 12:00,1'//nl, ':3: column 1 (''t''): found ''1/5/2024 12:00'' after')
      call refused_text('two decimal signs', 't;a'//nl//'0;1,5'//nl//'1;2.5'//nl, &
         ':3: column 2 (''a''): found ''2.5''|a decimal sign is '',''')
      call refused_text('thousands', 't'//tab//'a'//nl//'0'//tab//'1,234'//nl//'1'//tab//'999'// &
         nl, &
         'column 2: found a comma before three digits in every number')
      call refused_text('days', 'when,a'//nl//'45413.5,1'//nl//'45413.50001,2'//nl// &
         '45413.50002,2'//nl, &
         'column 1: found times from 45413.5, which look like days|--time-unit')
      call refused_text('since 1970', 't,a'//nl//'1714564800123,1'//nl//'1714564800124,2'//nl, &
         'which look like a time since 1970|--time-unit')
      call refused_text('a letter', 'Dear reader,'//nl//'this is no record.'//nl, &
         'found no row of numbers')
      call refused_text('nothing', '', 'found no row of numbers')
      call refused('a workbook', 'x.xlsx', 'PK', 'x.xlsx: found ''.xlsx''|export the sheet as CSV')
      outcome = run(python//script//'bad.csv --out bad.csv')
      call check('refused: its own input as output', outcome%status == 2 .and. &
         has_all(outcome%err, 'bad.csv: is the file to read'), outcome%err)
      outcome = run(python//script//'x.lvm --time-unit ms --out y.csv')
      call check('refused: a unit of other files', outcome%status == 2 .and. &
         has_all(outcome%err, '--time-unit is for text'), outcome%err)
   end subroutine test_bad_text

   subroutine refused_text(what, text, words)
      character(len=*), intent(in) :: what, text, words

      call refused('text: '//what, 'bad.csv', text, 'bad.csv|'//words)
   end subroutine refused_text

   !> Writes a file, unless its text is empty, and converts it. Standard error contains `words`, or
   !> nothing without them.
   subroutine converted(what, file, text, words, options)
      character(len=*), intent(in) :: what, file, text
      character(len=*), intent(in), optional :: words, options
      character(len=:), allocatable :: arguments

      arguments = file
      if (present(options)) arguments = file//' '//options
      if (text /= '') call write_file(file, text)
      outcome = run(python//script//arguments)
      if (present(words)) then
         call check(what//': converted', outcome%status == 0 .and. has_all(outcome%err, words), &
            outcome%err)
      else
         call check(what//': converted', outcome%status == 0 .and. outcome%err == '', outcome%err)
      end if
   end subroutine converted

   subroutine refused(what, file, text, words)
      character(len=*), intent(in) :: what, file, text, words

      if (index(file, '.zip') == 0 .or. text /= '') call write_file(file, text)
      outcome = run(python//script//file//' --out refused.csv')
      call check('refused: '//what, outcome%status == 2 .and. outcome%out == '' .and. &
         line_count(outcome%err) == 1 .and. has_all(outcome%err, words), outcome%err)
   end subroutine refused

   !> A column is read as a record. Values are exact; times are those of one rounding.
   subroutine column(what, file, name, times, values, rate)
      character(len=*), intent(in) :: what, file, name
      real(wp), intent(in) :: times(:), values(:)
      real(wp), intent(in), optional :: rate
      type(recording_t) :: recording
      type(error_t), allocatable :: error
      real(wp), allocatable :: t(:), z(:)
      logical :: ok

      recording%path = in_scratch(file)
      recording%value_column = name
      if (present(rate)) recording%rate = rate
      call read_record(recording, t, z, error)
      if (allocated(error)) then
         call check(what, .false., error%message)
         return
      end if
      ok = size(t) == size(times)
      if (ok) ok = maxval(abs(t - times)) <= 0 .and. maxval(abs(z - values)) <= 0
      call check(what, ok)
   end subroutine column

end program test_text_to_csv
