!> Units in the names of columns: what is recognised, and what is compared with the case.
program test_column_units
   use bad_cases, only: accepted, case_text, folder, nl, record_text, refused_case, &
      refused_record, write_good_files
   use beamid_column_units, only: are_units, bare_name, column_unit_t, no_unit, other_unit, &
      unit_of_acceleration, unit_of_column, unit_of_raw_values, unit_of_time
   use beamid_kinds, only: wp
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, open_shell, outcome_t, replaced, write_file
   implicit none

   character(len=*), parameter :: names = 't,acceleration'//nl, square = char(194)//char(178), &
      micro = char(194)//char(181), mu = char(206)//char(188), degree = char(194)//char(176)
   character(len=:), allocatable :: reason

   call test_units()
   call test_bare_names()
   call test_lines()
   call open_shell(reason)
   if (reason /= '') then
      call skip('units of columns in the program', reason)
   else
      call test_times()
      call test_values()
      call test_scale()
      call test_dates()
      call test_stamps()
      call close_shell()
   end if
   call finish('column_units')

contains

   subroutine test_units()
      call unit('Time (s)', unit_of_time, 1.0_wp)
      call unit('Time (ms)', unit_of_time, 1e-3_wp)
      call unit('t ['//micro//'s]', unit_of_time, 1e-6_wp)
      call unit('t ['//mu//'s]', unit_of_time, 1e-6_wp)
      call unit('t [us]', unit_of_time, 1e-6_wp)
      call unit('t / ms', unit_of_time, 1e-3_wp)
      call unit('time_ms', unit_of_time, 1e-3_wp)
      call unit('Zeit [min]', unit_of_time, 60.0_wp)
      call unit('Acceleration z (m/s^2)', unit_of_acceleration, 1.0_wp)
      call unit('Acceleration z (m/s'//square//')', unit_of_acceleration, 1.0_wp)
      call unit('Acceleration z (m/s'//char(178)//')', unit_of_acceleration, 1.0_wp)
      call unit('a [m s^-2]', unit_of_acceleration, 1.0_wp)
      call unit('a [m'//char(194)//char(183)//'s'//char(226)//char(129)//char(187)//square//']', &
         unit_of_acceleration, 1.0_wp)
      call unit('a / (m/s2)', unit_of_acceleration, 1.0_wp)
      call unit('a (m/(s^2))', unit_of_acceleration, 1.0_wp)
      call unit('a [mm/s'//square//']', unit_of_acceleration, 1e-3_wp)
      call unit('a [cm/s/s]', unit_of_acceleration, 1e-2_wp)
      call unit('a (ft/s**2)', unit_of_acceleration, 0.3048_wp)
      call unit('a (in/sec^2)', unit_of_acceleration, 0.0254_wp)
      call unit('a (g)', unit_of_acceleration, 9.80665_wp)
      call unit('a (mg)', unit_of_acceleration, 9.80665e-3_wp)
      call unit('acceleration_g', unit_of_acceleration, 9.80665_wp)
      call unit('acc_x_g', unit_of_acceleration, 9.80665_wp)
      call unit('Channel A [mV]', unit_of_raw_values, 1.0_wp)
      call unit('a (counts)', unit_of_raw_values, 1.0_wp)
      call unit('Gyroscope x (rad/s)', other_unit, 1.0_wp)
      call unit('T ['//degree//'C]', other_unit, 1.0_wp)
      call unit('f (Hz)', other_unit, 1.0_wp)
      call unit('v (m/s)', other_unit, 1.0_wp)
      ! Words in brackets that are no units, and names that only look like some.
      call unit('a (left)', no_unit, 1.0_wp)
      call unit('Channel (A)', no_unit, 1.0_wp)
      call unit('acceleration with g', no_unit, 1.0_wp)
      call unit('acceleration_with_g', no_unit, 1.0_wp)
      call unit('acc_z', no_unit, 1.0_wp)
      call unit('a', no_unit, 1.0_wp)
      call unit('', no_unit, 1.0_wp)
      call unit('()', no_unit, 1.0_wp)
      call unit('a ()', no_unit, 1.0_wp)
      call unit('a)', no_unit, 1.0_wp)
      call unit('_g', no_unit, 1.0_wp)
      call unit('a_', no_unit, 1.0_wp)
      call unit(' / g', no_unit, 1.0_wp)
      call unit(repeat(')', 100), no_unit, 1.0_wp)
      call unit(repeat(char(226), 100)//'('//char(226)//')', no_unit, 1.0_wp)
   end subroutine test_units

   subroutine unit(name, kind, factor)
      character(len=*), intent(in) :: name
      integer, intent(in) :: kind
      real(wp), intent(in) :: factor
      type(column_unit_t) :: found

      found = unit_of_column(name)
      call check('unit of '//name, found%kind == kind .and. &
         (kind == no_unit .or. abs(found%factor - factor) <= 4*epsilon(factor)*factor))
   end subroutine unit

   subroutine test_bare_names()
      call check('bare names', bare_name('Acceleration z (m/s^2)') == 'Acceleration z' .and. &
         bare_name('a / (m/s^2)') == 'a' .and. bare_name('t_s') == 't' .and. &
         bare_name('acc_z') == 'acc_z' .and. bare_name('a (with g) (g)') == 'a (with g)' .and. &
         bare_name('(s)') == '(s)' .and. bare_name('') == '')
   end subroutine test_bare_names

   subroutine test_lines()
      call check('a line of units', are_units([character(len=8) :: '(ms)', '(mV)', '']) .and. &
         are_units([character(len=8) :: 's', 'C', 'g', '-']))
      call check('no line of units', .not. (are_units([character(len=8) :: 's', 'x', 'g']) .or. &
         are_units([character(len=8) :: '', '']) .or. are_units([character(len=8) :: 'N', 'C'])))
   end subroutine test_lines

   !> The case is in ft and s; its excitation is known.
   subroutine test_times()
      call accepted('times in s', 'identify', case_text, replaced(record_text, names, &
         'Time (s),acceleration (ft/s^2)'//nl))
      call refused_record('times in ms', names, 'Time (ms),a'//nl, 'record.csv: column 1 '// &
         '(''Time (ms)''): found times in ms, expected s, as &units says (scripts/to_csv.py '// &
         'converts times to s)')
      call refused_record('times in ms, in a line of units', names, 't,a'//nl//'ms,ft/s2'//nl, &
         'record.csv: column 1 (''t [ms]''): found times in ms')
      call refused_case('times in ms, without labels', without_units(), 'record.csv: column 1 '// &
         '(''t_ms''): found times in ms, expected s, or time=''ms'' in &units', &
         record=replaced(record_text, names, 't_ms,a'//nl))
      call accepted('times in ms, as in the case', 'identify', replaced(case_text, 'time=''s''', &
         'time=''ms'''), replaced(record_text, names, 't_ms,a'//nl))
      call refused_record('a spectrum', names, 'f (Hz),a (ft/s^2)'//nl, 'record.csv: column 1 '// &
         '(''f (Hz)''): found a column in Hz, expected times; time_column names another')
   end subroutine test_times

   subroutine test_values()
      call refused_record('a gyroscope', names, 't (s),x (rad/s)'//nl, 'record.csv: column 2 '// &
         '(''x (rad/s)''): found a column in rad/s, expected accelerations; value_column names')
      call refused_record('a velocity', names, 't (s),v (ft/s)'//nl, &
         'found a column in ft/s, expected accelerations')
      call refused_record('times as values', names, 'index,Time (s)'//nl, &
         'record.csv: column 2 '// &
         '(''Time (s)''): found a column of times, expected accelerations')
      call refused_record('times without a unit as values', names, 'index,time'//nl, &
         'record.csv: column 2 (''time''): found a column of times')
   end subroutine test_values

   subroutine test_scale()
      character(len=:), allocatable :: in_g

      in_g = replaced(record_text, names, 't (s),a (g)'//nl)
      call refused_record('g without scale', names, 't (s),a (g)'//nl, &
         'case.nml:11: &record scale: found 1 for a column in g (''a (g)''), expected 32.174')
      call refused_record('m/s^2 for ft/s^2', names, 't (s),a (m/s^2)'//nl, &
         '&record scale: found 1 for a column in m/s^2 (''a (m/s^2)''), expected 3.28084')
      call refused_record('mm/s^2 for ft/s^2', names, 't (s),a [mm/s'//square//']'//nl, &
         'expected 0.00328084')
      call refused_record('mV without scale', names, 't (s),a [mV]'//nl, &
         '&record scale: found 1 '// &
         'for a column in mV (''a [mV]''), expected the factor from mV to ft/s^2')
      call refused_case('g without scale and without labels', without_units(), '&record scale: '// &
         'found 1 for a column in g (''a (g)''), expected the factor from g to the unit of the '// &
         'case', record=in_g)
      call refused_case('g with a factor of 1000', with_scale('1000'), &
         '&record scale: found 1000 for a column in g', record=in_g)
      call accepted('g with its factor', 'identify', with_scale('32.174'), in_g)
      call accepted('g upside down, with a calibration', 'identify', with_scale('-30'), in_g)
      call accepted('mV with a factor', 'identify', with_scale('0.7'), replaced(record_text, &
         names, &
         't (s),a [mV]'//nl))
   end subroutine test_scale

   !> Times that are days or count from 1970 are refused, unless the column says that they are s.
   subroutine test_dates()
      character(len=:), allocatable :: days
      type(outcome_t) :: outcome

      days = 'when,a'//nl//'45413.5,0.29'//nl//'45413.500001,-0.97'//nl//'45413.500002,-1.28'// &
         nl// &
         '45413.500003,-1.27'//nl
      call refused_case('days of a spreadsheet', whole(), &
         'record.csv: column 1 (''when''): found '// &
         'times of 45413.5 with steps of 1E-06, which look like days of a spreadsheet, '// &
         'expected seconds (scripts/to_csv.py --time-unit d', record=days)
      call refused_case('days of MATLAB', whole(), 'found times of 739372 with steps', &
         record=replaced(replaced(replaced(replaced(days, '45413.500001', '739372.50001'), &
         '45413.500002', '739372.50002'), '45413.500003', '739372.50003'), '45413.5', '739372.5'))
      call refused_case('milliseconds since 1970', whole(), &
         'record.csv: column 1 (''t''): found '// &
         'times of 1.71E+12, which look like milliseconds since 1970, expected seconds', &
         record=replaced(replaced(replaced(replaced(replaced(replaced(record_text, &
         '0.1,', '1714564800100,'), '0.2,', '1714564800200,'), '0.3,', '1714564800300,'), &
         '0.4,', '1714564800400,'), '0.5,', '1714564800500,'), '0.6,', '1714564800600,'))
      ! The computation may fail later, so long after the pulse.
      call write_good_files(whole())
      call write_file(folder//'record.csv', replaced(days, 'when', 'when (s)'))
      outcome = beamid('identify case.nml --quiet --out result', 'bad')
      call check('seconds that are so large are not refused', outcome%status < 2, outcome%err)
   end subroutine test_dates

   subroutine test_stamps()
      character(len=:), allocatable :: stamps

      stamps = record_text
      stamps = replaced(replaced(replaced(stamps, '0.1,', '12:00:00.1,'), '0.2,', '12:00:00.2,'), &
         '0.3,', '12:00:00.3,')
      stamps = replaced(replaced(replaced(stamps, '0.4,', '12:00:00.4,'), '0.5,', '12:00:00.5,'), &
         '0.6,', '12:00:00.6,')
      call accepted('time stamps', 'identify', without_step(), stamps)
      call refused_case('time stamps in a case in ms', replaced(without_step(), 'time=''s''', &
         'time=''ms'''), &
         'record.csv: column 1 (''t''): found time stamps, which become seconds, '// &
         'expected time=''s'' in &units', record=stamps)
      call refused_case('time stamps of a force', replaced(case_text, &
         'kind=''pulse'', amplitude=1.0, duration=0.05', 'kind=''table'', file=''record.csv'''), &
         'record.csv:2: column 1 (''t''): found ''12:00:00.1'', expected a number '// &
         '(scripts/to_csv.py turns time stamps into seconds)', record=stamps)
   end subroutine test_stamps

   function without_units() result(text)
      character(len=:), allocatable :: text

      text = case_text(:index(case_text, '&units') - 1)
   end function without_units

   function with_scale(scale) result(text)
      character(len=*), intent(in) :: scale
      character(len=:), allocatable :: text

      text = replaced(case_text, 't_first=0.1,', 'scale='//scale//', t_first=0.1,')
   end function with_scale

   !> The whole record, without a window.
   function whole() result(text)
      character(len=:), allocatable :: text

      text = replaced(case_text, ', t_first=0.1, t_last=0.6, t_step=0.1', '')
   end function whole

   !> The whole record by an observation that needs no step.
   function without_step() result(text)
      character(len=:), allocatable :: text

      text = replaced(whole(), &
         '&observation    formula=''displacement_difference'', delta=0.1 /', '')
   end function without_step

end program test_column_units
