!> Bad records and force tables, one row each, and what a case says of a record.
program test_bad_records
   use bad_cases, only: accepted, case_text, folder, force_text, freeing, nl, pulse, record_text, &
      refused, refused_case, refused_force, refused_record, table
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, replaced, write_file
   implicit none

   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('bad records', reason)
   else
      call test_window()
      call test_window_of_fit()
      call test_record_keys()
      call test_several_records()
      call test_sensor_and_support()
      call test_record_rows()
      call test_record_files()
      call test_force_table()
      call test_force_column()
      call close_shell()
   end if
   call finish('bad_records')

contains

   subroutine test_window()
      character(len=*), parameter :: place = '11: &record ', &
         grid = '11: &record: found no grid|expected t_first, t_last and t_step'

      call refused('t_step 0', 't_step=0.1', 't_step=0', place//'t_step: found 0|above 0')
      call refused('t_step negative', 't_step=0.1', 't_step=-0.1', place// &
         't_step: found -0.1|above 0')
      call refused('t_last < t_first', 't_last=0.6', 't_last=0.05', place// &
         't_last: found 0.05|t_first = 0.1')
      call refused('t_step 0', 't_step=0.1', 't_step=0', place//'t_step: found 0|above 0', &
         command='simulate')
      call refused('t_last < t_first', 't_last=0.6', 't_last=0.05', place// &
         't_last: found 0.05|t_first = 0.1', command='simulate')
      call refused('no t_first', 't_first=0.1,', '', grid, command='simulate')
      call refused('no t_last', 't_last=0.6,', '', grid, command='simulate')
      call refused('no t_step', ', t_step=0.1', '', grid, command='simulate')
      call refused('5 million samples', 't_step=0.1', 't_step=1e-7', place// &
         't_step: found 1E-07|more than 1000000 samples|expected a larger step', &
         command='simulate')
      call refused('10**300 samples', 't_step=0.1', 't_step=1e-300', place// &
         't_step: found 1E-300|more than 1000000 samples|expected a larger step', &
         command='simulate')
   end subroutine test_window

   subroutine test_window_of_fit()
      character(len=*), parameter :: place = '11: &record|record.csv|'

      call refused('window before the record', 't_first=0.1', 't_first=0.0', place// &
         'found samples from 0.1 to 0.6|expected the window from 0 to 0.6')
      call refused('window behind the record', 't_last=0.6', 't_last=0.7', place// &
         'found samples from 0.1 to 0.6|expected the window from 0.1 to 0.7')
      call refused('window apart', 't_first=0.1, t_last=0.6', 't_first=7, t_last=9', place// &
         'found samples from 0.1 to 0.6|expected the window from 7 to 9')
      call refused('times between the samples', 't_step=0.1', 't_step=0.05', place// &
         'found no sample at t = 0.15|every step of 0.05')
      call refused('times shifted', 't_first=0.1', 't_first=0.12', place// &
         'found no sample at t = 0.12|every step of 0.1')
      call refused('5 million samples', 't_step=0.1', 't_step=1e-7', place// &
         'found 1E-07|more than 1000000 samples|expected a larger step')
      call refused('no sample in the window', 't_first=0.1, t_last=0.6, t_step=0.1', &
         't_first=0.32, t_last=0.38', place//'found no sample')
   end subroutine test_window_of_fit

   !> Columns, limits and thinning.
   subroutine test_record_keys()
      character(len=*), parameter :: place = '11: &record ', step = ', t_step=0.1', &
         file = 'file=''record.csv'''

      call refused('unknown column', file, file//', value_column=''accel''', &
         'record.csv: found the columns ''t'', ''acceleration''|value_column = ''accel''', file='')
      call refused('column 3 of 2', file, file//', value_column=''3''', &
         'record.csv: found 2 columns|value_column = ''3''', file='')
      call refused('one column for both', file, file//', time_column=''2''', &
         'record.csv: found column 2 as time_column and as value_column|expected two', file='')
      call refused('empty name of a column', file, file//', time_column=''''', place// &
         'time_column: found ''''|expected the name of a column')
      call refused('a name of 101 characters', file, file//', value_column='''// &
         repeat('x', 101)//'''', place//'value_column: found|of at most 100 characters')
      call refused('a column without quotes', file, file//', value_column=2', place// &
         'value_column: found ''2''|expected text in quotes')
      call refused('rate 0', file, file//', rate=0', place//'rate: found 0|above 0')
      call refused('rate negative', file, file//', rate=-10', place//'rate: found -10|above 0')
      call refused('rate beside a time column', file, file//', rate=10, time_column=''t''', &
         place//'time_column: found a value|expected none beside rate')
      call refused('rate and two columns', file, file//', rate=10', &
         'record.csv: found 2 columns|expected value_column to name one of them', file='')
      call refused('thin 1', step, ', thin=1', place//'thin: found 1|expected 2 to')
      call refused('thin 0', step, ', thin=0', place//'thin: found 0|expected 2 to')
      call refused('thin 2.5', step, ', thin=2.5', place//'thin: found ''2.5''|expected an integer')
      call refused('thin beside t_step', step, step//', thin=2', place// &
         't_step: found a value|expected none beside thin')
      call refused('record shorter than the filter', step, ', thin=2', &
         '11: &record: |record.csv: found no sample for which the filter of thin = 2')
      call refused('limits in the wrong order', step, step//', clip_low=1, clip_high=-1', place// &
         'clip_high: found -1|expected more than clip_low = 1')
      call refused('all at the limit', step, step//', clip_high=-2', &
         '11: &record: |found all 6 samples of the window at the sensor''s limit (-2)|expected')
   end subroutine test_record_keys

   !> Several records, and what each may have of its own.
   subroutine test_several_records()
      character(len=*), parameter :: file = 'file=''record.csv''', &
         more = '&record file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /'//nl, &
         units = '&units ', cause = '&excitation '//pulse//' /'//nl, &
         score = '&score t_last=0.4 /'//nl
      character(len=:), allocatable :: text

      call accepted('two records', 'identify', replaced(case_text, units, more//units))
      call accepted('two records, E for each', 'identify', replaced(replaced(case_text, units, &
         more//units), 'free=''m_H'',''k_H''', 'free=''m_H'',''k_H'', shared=''m_H'''))
      text = replaced(case_text, units, more//more//units)
      call accepted('three records', 'identify', text)
      call refused_case('two excitations for three records', replaced(text, units, cause//units), &
         'case.nml|&excitation: found 2 such groups for 3 of &record|one for each record')
      call refused('two excitations for one record', units, cause//units, &
         '&excitation: found 2 such groups for 1 of &record|one for each record')
      call refused('shared, but not free', 'free=''m_H'',''k_H''', &
         'free=''m_H'',''k_H'', shared=''E''', &
         '12: &stage shared: found ''E''|expected parameters that are free')
      call refused('shared, but unknown', 'free=''m_H'',''k_H''', &
         'free=''m_H'',''k_H'', shared=''m_H'',''q''', &
         '12: &stage shared: found ''q''|expected parameters that are free')
      call refused('a beam of nothing', file, file//', length=0', &
         '11: &record length: found 0|above 0')
      call refused('a sensor at the root', file, file//', x_S=0', &
         '11: &record x_S: found 0|above 0')
      call refused('a record''s sensor beyond the tip', file, file//', x_S=5', &
         '11: &record x_S: found 5|up to the length 4')
      call refused('a record''s sensor beyond the tip', file, file//', x_S=5', &
         '11: &record x_S: found 5|up to the length 4', command='simulate')
      call refused('a record''s sensor beyond its tip', file, file//', length=2, x_S=3', &
         '11: &record x_S: found 3|up to the length 2')
      call refused('score beside two records', units, more//score//units, &
         '14: &score: found the group beside several records|expected one record')
      call refused('a response of two records', units, more//units, &
         '13: &record: found a second one|expected one for a response', command='simulate')
      call refused('the second record is missing', units, replaced(more, 'record.csv', &
         'none.csv')//units, 'none.csv: found no such file|expected', file='none.csv')
      call refused_case('parameters for each are counted', replaced(replaced(replaced(case_text, &
         units, more//units), 't_last=0.6', 't_last=0.1'), 'free=''m_H'',''k_H''', &
         'free=''m_H'',''k_H'', shared=''m_H'''), &
         '12: &stage free: found 3 unknowns for 2 samples|expected no more')
   end subroutine test_several_records

   !> Which sensor a record comes from, and where the support was.
   subroutine test_sensor_and_support()
      character(len=*), parameter :: tip = 'm_T=0.15 /', file = 'file=''record.csv''', &
         a = nl//'&sensor name=''a'', x_S=2 /', b = nl//'&sensor name=''b'' /', &
         supports = nl//'&support name=''a'', x_P=2 /'//nl//'&support name=''b'', x_P=3 /', &
         beside = 'groups &support|expected one such group', units = '&units ', &
         another = '&record file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1'
      character(len=:), allocatable :: two, held

      two = replaced(case_text, tip, tip//a//b)
      held = replaced(case_text, tip, tip//nl//'&support x_P=2 /')
      call refused_case('no sensor named beside two', two, &
         '13: &record sensor: found nothing|expected the name of one of 2 sensors')
      call refused_case('no sensor named beside two', two, &
         '13: &record sensor: found nothing|expected the name of one of 2 sensors', 'simulate')
      call refused_case('a sensor that is not there', replaced(two, file, file//', sensor=''c'''), &
         '13: &record sensor: found ''c''|expected the name of a &sensor')
      call refused_case('a sensor without a name', replaced(two, file, file//', sensor='''''), &
         '13: &record sensor: found ''''|expected the name of a &sensor')
      call refused('a sensor where none has a name', file, file//', sensor=''a''', &
         '11: &record sensor: found ''a''|expected the name of a &sensor')
      call refused_case('the other sensor beyond the tip of this record', replaced(two, file, &
         file//', sensor=''b'', length=1'), '13: &record x_S: found 2|up to the length 1')
      call accepted('its own place of the support', 'simulate', replaced(held, file, &
         file//', x_P=3'))
      call refused_case('its support at the root', replaced(held, file, file//', x_P=0'), &
         '12: &record x_P: found 0|above 0')
      call refused_case('its support beyond the tip', replaced(held, file, file//', x_P=5'), &
         '12: &record x_P: found 5|up to the length 4')
      call refused_case('a shared place of the support that records give differently', &
         freeing(replaced(held, units, another//', x_P=3 /'//nl//units), '''x_P'''), &
         '13: &stage free: found x_P shared by records that give it different values|'// &
         'expected the parameter left out of shared, or one value')
      call refused_case('a shared length that records give differently', &
         freeing(replaced(case_text, units, another//', length=3 /'//nl//units), '''length'''), &
         '12: &stage free: found length shared by records that give it different values|'// &
         'expected the parameter left out of shared, or one value')
      call refused_case('its support beyond its tip', replaced(held, file, &
         file//', length=2.5, x_P=3'), '12: &record x_P: found 3|up to the length 2.5')
      call refused('x_P without a support', file, file//', x_P=2', &
         '11: &record x_P: found a value beside 0 '//beside)
      call refused_case('x_P beside two supports', replaced(replaced(case_text, tip, &
         tip//supports), file, file//', x_P=2'), '13: &record x_P: found a value beside 2 '//beside)
      call refused_case('a force beyond its tip', replaced(replaced(case_text, pulse, &
         pulse//', x_F=2'), file, file//', length=1'), &
         '11: &record x_F: found 2|up to the length 1')
   end subroutine test_sensor_and_support

   subroutine test_record_rows()
      character(len=*), parameter :: row = '0.3,-1.28', place = 'record.csv:4: column '

      call refused_record('missing field', row, '0.3', place// &
         '2 (''acceleration''): found the end of the line|expected a number')
      call refused_record('text in a number', row, '0.3,-1.2x8', place// &
         '2 (''acceleration''): found ''-1.2x8''|expected a number')
      call refused_record('text for a number', row, 'noon,-1.28', place// &
         '1 (''t''): found ''noon''|expected a number')
      call refused_record('NaN', row, '0.3,NaN', place// &
         '2 (''acceleration''): found ''NaN''|expected a number')
      call refused_record('NaN as a time', row, 'nan,-1.28', place// &
         '1 (''t''): found ''nan''|expected a number')
      call refused_record('Inf', row, '0.3,-inf', place// &
         '2 (''acceleration''): found ''-inf''|expected a number')
      call refused_record('1e999', row, '0.3,1e999', place// &
         '2 (''acceleration''): found ''1e999''|expected a number of at most')
      call refused_record('empty field', row, '0.3,', place// &
         '2 (''acceleration''): found an empty field|expected a number')
      call refused_record('two empty fields', row, ',', place// &
         '1 (''t''): found an empty field|expected a number')
      call refused_record('decreasing times', row, '0.15,-1.28', place// &
         '1 (''t''): found ''0.15'' after ''0.2''|expected a larger number')
      call refused_record('duplicate times', row, '0.2,-1.28', place// &
         '1 (''t''): found ''0.2'' after ''0.2''|expected a larger number')
      call refused_record('blank between', row, '0.3 -1.28', place// &
         '1 (''t''): found ''0.3 -1.28''|expected a number')
      call refused_record('fraction', row, '3/10,-1.28', place// &
         '1 (''t''): found ''3/10''|expected a number')
      call refused_record('repeat count', row, '2*3,-1.28', place// &
         '1 (''t''): found ''2*3''|expected a number')
      call refused_record('semicolon in a row', row, '0.3;-1.28', &
         'record.csv:4: fields are separated by '';''|expected '',''')
      call refused_record('blank inside a number', row, '0.3,-1 28', place// &
         '2 (''acceleration''): found ''-1 28''|expected a number')
      call refused_record('zero byte', row, '0.3,-1.28'//achar(0), &
         'record.csv:4: found a control character|expected a text file')
      call refused_record('decimal commas', row, '0,3,-1,28', 'record.csv:4:|expected')
   end subroutine test_record_rows

   subroutine test_record_files()
      call refused('missing record', '''record.csv''', '''none.csv''', &
         'none.csv: found no such file|expected', file='none.csv')
      call refused('record is a folder', '''record.csv''', '''.''', &
         '.: is a directory|expected a file', file='.')
      call refused_record('empty', record_text, '', &
         'record.csv: found no line of data|expected columns of numbers')
      call refused_record('blank', record_text, nl//' '//nl, &
         'record.csv: found no line of data|expected columns of numbers')
      call refused_record('header only', record_text, 't,acceleration'//nl, &
         'record.csv: found names of columns only|expected numbers below')
      call refused_record('one column', record_text, 't'//nl//'0.1'//nl//'0.2'//nl, &
         'record.csv:1: found ''t''|expected 2 columns')
      call refused_record('one column, no names', record_text, '0.1'//nl//'0.2'//nl, &
         'record.csv:1: column 2: found the end of the line|expected a number')
      call refused_record('text through and through', record_text, 'Dear reader,'//nl// &
         'this is no record, it is a letter.'//nl, &
         'record.csv:2: column 1 (''Dear reader''): found ''this is no record''|expected a number')
      call refused_record('decimal commas, then a point', record_text, &
         '0,1;0,29'//nl//'0,2;-0.97'//nl, &
         'record.csv:2: column 2: found ''-0.97''|expected a number (a decimal sign is '',''')
      call refused_record('constant signal', record_text, '0.1,2'//nl//'0.2,2'//nl//'0.3,2'//nl// &
         '0.4,2'//nl//'0.5,2'//nl//'0.6,2'//nl, &
         '11: &record: |record.csv: found a constant signal (2 in all 6|expected')
      call refused_record('binary', record_text, repeat(achar(1)//char(255), 200), &
         'record.csv:1: found a control character|expected a text file')
   end subroutine test_record_files

   subroutine test_force_table()
      call refused('missing force table', pulse, 'kind=''table'', file=''none.csv''', &
         'none.csv: found no such file|expected', file='none.csv')
      call refused_force('one row', '0.03,1.2'//nl//'0.05,0'//nl, '', &
         'found 1 rows|expected 2 or more')
      call refused_force('negative time', nl//'0,1', nl//'-0.01,1', &
         'found a first time of -0.01|expected 0 or later')
      call refused_force('decreasing times', '0.05,0', '0.02,0', &
         'force.csv:4: column 1 (''t''): found ''0.02'' after ''0.03''|expected a larger number')
      call refused_force('text', '1.2', 'strong', &
         'force.csv:3: column 2 (''force''): found ''strong''|expected a number')
      call refused_force('empty', force_text, '', &
         'found no line of data|expected columns of numbers')
      call refused_force('NaN', '1.2', 'NaN', &
         'force.csv:3: column 2 (''force''): found ''NaN''|expected a number')
      call refused_force('no force', force_text, '0,0'//nl//'1,0'//nl, &
         'found the same force (0) in all 2 rows|expected one that changes')
      call refused_force('a constant', force_text, '0,2'//nl//'1,2'//nl//'2,2'//nl, &
         'found the same force (2) in all 3 rows|expected one that changes')
   end subroutine test_force_table

   !> The force in a recorder's file, beside the acceleration.
   subroutine test_force_column()
      character(len=*), parameter :: both = 't,acceleration,trigger,force,note'//nl// &
         '0,0.1,1,0,begin'//nl//'0.1,0.29,1,1.5,'//nl//'0.2,-0.97,1,0.5,'//nl// &
         '0.3,-1.28,1,0,'//nl//'0.4,-1.27,1,0,'//nl//'0.5,-0.95,1,0,'//nl// &
         '0.6,-0.43,1,0,end'//nl, &
         keys = 'kind=''table'', file=''record.csv'', '
      character(len=*), parameter :: place = '6: &excitation '
      character(len=:), allocatable :: text

      call write_file(folder//'record.csv', both)
      call write_file(folder//'force.csv', 't,f'//nl//'0,0'//nl//'0.1,1.5'//nl//'0.2,0.5'//nl// &
         '0.3,0'//nl//'0.4,0'//nl//'0.5,0'//nl//'0.6,0'//nl)
      call check('a force column is the table of it', response(keys//'value_column=''force''') == &
         response(table) .and. response(table) /= '')
      text = replaced(case_text, pulse, keys//'value_column=''force''')
      call accepted('a force column', 'identify', text, both)
      call accepted('a force column by number, and the time', 'identify', replaced(text, &
         '''force''', '''4'', time_column=''T'''), both)
      call accepted('a force column at a rate', 'identify', replaced(text, '''force''', &
         '''force'', rate=10'), both)
      call refused_case('a force column that is none', replaced(text, '''force''', '''forces'''), &
         'record.csv: found the columns|''force''|expected value_column = ''forces''', record=both)
      call refused_case('a constant force column', replaced(text, '''force''', '''trigger'''), &
         'record.csv: found the same force (1) in all 7 rows|expected one', record=both)
      call refused_case('a column of text', replaced(text, '''force''', '''note'''), &
         'record.csv:2: column 5 (''note''): found ''begin''|expected a number', record=both)
      call refused_case('a force of NaN', text, &
         'record.csv:3: column 4 (''force''): found ''nan''|expected', &
         record=replaced(both, '0.29,1,1.5', '0.29,1,nan'))
      call refused_case('the time as force', replaced(text, '''force''', '''t'''), &
         'record.csv: found column 1 as time_column and as value_column|expected two', record=both)
      call refused('a column of a pulse', pulse, pulse//', value_column=''force''', place// &
         'value_column: found a value|expected none with kind = ''pulse''')
      call refused('a rate of a pulse', pulse, pulse//', rate=10', place// &
         'rate: found a value|expected none with kind = ''pulse''')
      call refused('a force''s rate beside a time column', pulse, keys// &
         'time_column=''t'', rate=10', place// &
         'time_column: found a value|expected none beside rate')
   end subroutine test_force_column

   !> The response to another excitation than the pulse.
   function response(excitation) result(text)
      character(len=*), intent(in) :: excitation
      character(len=:), allocatable :: text
      type(outcome_t) :: outcome

      call write_file(folder//'response.nml', replaced(case_text, pulse, excitation))
      outcome = beamid('simulate response.nml --quiet --out response', 'bad')
      text = read_file(folder//'response/response.csv')
   end function response

end program test_bad_records
