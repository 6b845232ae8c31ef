!> Bad input, one row each: a good case with one change must end with status 2 and one line on
!> standard error that names file, place, what was found and what was expected, and write nothing.
program test_bad_input
   use beamid_blocks, only: block_t
   use beamid_case_files, only: list_keys
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      remove_tree, replaced, run, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10), cr = achar(13), tab = achar(9), &
      mark = char(239)//char(187)//char(191), folder = 'bad/'
   character(len=*), parameter :: case_text = &
      '! A short record of a coarse beam.'//nl// &
      '&beam           length=4.0, rho=0.03, E=80.0, I=1.0,'//nl// &
      '                c_D=0.005 /'//nl// &
      '&tip            m_T=0.15 /'//nl// &
      '&hose           m_H=0.04, c_H=0.004, k_H=0.3 /'//nl// &
      '&excitation     kind=''pulse'', amplitude=1.0, duration=0.05,'//nl// &
      '                load=''point'', power=2.0 /'//nl// &
      '&discretization degree=3, elements=2, gauss_points=2, panels=4 /'//nl// &
      '&integrator     method=''cvode'', rtol=1e-8, atol=1e-11, max_order=5, max_steps=20000 /'// &
         nl// &
      '&observation    formula=''displacement_difference'', delta=0.1 /'//nl// &
      '&record         file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /'//nl// &
      '&stage          free=''m_H'',''k_H'', start=0.035,0.4, lower=0,0.1, upper=1,10 /'//nl// &
      '&units          length=''ft'', force=''lb'', time=''s'', mass=''slug'' /'//nl
   character(len=*), parameter :: pulse = 'kind=''pulse'', amplitude=1.0, duration=0.05', &
      table = 'kind=''table'', file=''force.csv'''
   character(len=*), parameter :: record_text = &
      't,acceleration'//nl// &
      '0.1,0.29'//nl// &
      '0.2,-0.97'//nl// &
      '0.3,-1.28'//nl// &
      '0.4,-1.27'//nl// &
      '0.5,-0.95'//nl// &
      '0.6,-0.43'//nl
   character(len=*), parameter :: force_text = 't,force'//nl//'0,1'//nl//'0.03,1.2'//nl// &
      '0.05,0'//nl
   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('bad input', reason)
   else
      call test_good_cases()
      call test_accepted_forms()
      call test_case_files()
      call test_groups_and_keys()
      call test_every_group()
      call test_values()
      call test_not_finite()
      call test_structure()
      call test_cross_section()
      call test_excitation()
      call test_discretization()
      call test_integrator()
      call test_observation()
      call test_window()
      call test_window_of_fit()
      call test_record_keys()
      call test_stage()
      call test_release()
      call test_free_start()
      call test_sensor_and_clamp()
      call test_several_records()
      call test_noise()
      call test_needs()
      call test_record_rows()
      call test_record_files()
      call test_force_table()
      call test_output_folder()
      call test_several_problems()
      call close_shell()
   end if
   call finish('bad_input')

contains

   !> Before any change the files are good, or no row below would prove a thing.
   subroutine test_good_cases()
      call accepted('as it is', 'identify', case_text)
      call accepted('as it is', 'simulate', case_text)
      call accepted('as it is', 'modes', case_text)
      call accepted('force table', 'identify', replaced(case_text, pulse, table))
      call accepted('force table', 'simulate', replaced(case_text, pulse, table))
   end subroutine test_good_cases

   !> Unusual, and to be taken all the same.
   subroutine test_accepted_forms()
      call accepted('m_T = 0', 'identify', replaced(case_text, 'm_T=0.15', 'm_T=0'))
      call accepted('c_D = 0', 'identify', replaced(case_text, 'c_D=0.005', 'c_D=0'))
      call accepted('c_H = k_H = 0', 'simulate', replaced(case_text, 'c_H=0.004, k_H=0.3', &
         'c_H=0, k_H=0'))
      call accepted('CRLF case file', 'identify', replaced(case_text, nl, cr//nl))
      call accepted('byte-order mark, case file', 'identify', mark//case_text)
      call accepted('both, case file', 'identify', mark//replaced(case_text, nl, cr//nl))
      call accepted('CRLF record', 'identify', case_text, record=replaced(record_text, nl, cr//nl))
      call accepted('byte-order mark, record', 'identify', case_text, record=mark//record_text)
      call accepted('both, record', 'identify', case_text, record=mark//replaced(record_text, nl, &
         cr//nl))
      call accepted('CRLF and byte-order mark, force table', 'simulate', &
         replaced(case_text, pulse, table), force=mark//replaced(force_text, nl, cr//nl))
      call accepted('no line end at the end', 'identify', case_text(:len(case_text) - 1), &
         record=record_text(:len(record_text) - 1))
      call accepted('tabs in the case file', 'identify', replaced(case_text, ' ', tab))
      call accepted('blank lines in the record', 'identify', case_text, &
         record=replaced(record_text, nl, nl//nl//'  '//nl))
      call accepted('semicolons in the record', 'identify', case_text, &
         record=replaced(record_text, ',', ';'))
      call accepted('tabs in the record', 'identify', case_text, &
         record=replaced(record_text, ',', tab))
      call accepted('columns by name and number', 'identify', replaced(case_text, &
         'file=''record.csv''', 'file=''record.csv'', time_column=''T'', value_column=''2'''))
      call accepted('a limit that is never reached', 'identify', replaced(case_text, &
         'file=''record.csv''', 'file=''record.csv'', clip_low=-5, clip_high=5'))
      call accepted('a third column', 'identify', case_text, record=replaced(record_text, nl, &
         ',7'//nl))
      call accepted('no header', 'identify', case_text, record=replaced(record_text, &
         't,acceleration'//nl, ''))
      call accepted('no hose', 'simulate', replaced(case_text, &
         '&hose           m_H=0.04, c_H=0.004, '// &
         'k_H=0.3 /', '')//'! free=''m_H''', without_stage=.true.)
   end subroutine test_accepted_forms

   subroutine test_case_files()
      call write_good_files()
      call write_file(folder//'case.nml', '')
      call refused_now('empty file', 'identify', 'case.nml', &
         'case.nml:1:|found no group|expected &beam')
      call write_file(folder//'case.nml', '! nothing'//nl//nl)
      call refused_now('comments only', 'modes', 'case.nml', &
         'case.nml:|found no group|expected &beam')
      call write_file(folder//'case.nml', case_text//achar(0))
      call refused_now('zero byte', 'modes', 'case.nml', &
         'case.nml:14:|control character|expected a text file')
      call write_file(folder//'case.nml', repeat('! '//repeat('x', 97)//nl, 3000)//case_text)
      call refused_now('300 kB', 'modes', 'case.nml', &
         'case.nml:1:|found a file of more than|expected a case file')
      call refused_now('missing case file', 'identify', 'none.nml', &
         'none.nml: found no such file|expected')
      call refused_now('missing case file', 'simulate', 'no/case.nml', &
         'no/case.nml: found no such file|expected')
      call refused_now('missing case file', 'modes', 'none.nml', &
         'none.nml: found no such file|expected')
      call refused_now('a file in place of a folder', 'modes', 'case.nml/case.nml', &
         'case.nml/case.nml: found|Not a directory|expected')
      call refused_now('directory in place of a file', 'identify', '.', &
         '.: is a directory|expected a file')
      call refused_now('device in place of a file', 'modes', '/dev/zero', &
         '/dev/zero: found|expected a regular file')
   end subroutine test_case_files

   subroutine test_groups_and_keys()
      call refused('unknown group', '&tip ', '&tipp ', &
         '4: found unknown group ''&tipp''|expected &beam, &tip')
      call refused('unknown key', 'm_T=', 'mass=', &
         '4: &tip mass: found an unknown key|expected m_T')
      call refused('repeated group', '&tip ', '&tip m_T=0.1 /'//nl//'&tip ', &
         '5: found &tip again|expected it once|line 4')
      call refused('repeated group, other case', '&tip ', '&TIP m_T=0.1 /'//nl//'&tip ', &
         '5: found &tip again|line 4')
      call refused('repeated key', 'm_T=0.15', 'm_T=0.15, m_T=0.2', &
         '4: &tip m_T: found the key again|expected it once')
      call refused('repeated key, other case', 'm_T=0.15', 'm_T=0.15,'//nl//'M_t=0.2', &
         '5: &tip M_t: found the key again|line 4')
      call refused('missing / inside', 'm_T=0.15 /', 'm_T=0.15', &
         '4: &tip: found ''&hose'' in line 5|expected ''/''')
      call refused('missing / at the end', 'mass=''slug'' /', 'mass=''slug''', &
         '13: &units: found the end of the file|expected ''/''')
      call refused('&end', 'm_T=0.15 /', 'm_T=0.15 &end', '4: &tip: found ''&end''|expected ''/''')
      call refused('stray word before /', 'm_T=0.15 /', 'm_T=0.15 light /', &
         '4: &tip m_T: found ''light'' after a number|expected')
      call refused('stray word first', 'm_T=0.15 /', 'light m_T=0.15 /', &
         '4: &tip: found ''light''|expected key = value')
      call refused('text outside a group', '&tip ', 'tip'//nl//'&tip ', &
         '4: found ''tip'' outside a group|expected')
      call refused('# before a group', '&tip ', '# &tip ', &
         '4: found ''#'' outside a group|expected')
      call refused('a $ group', '&tip ', '$tip ', '4: found ''$tip'' outside a group|expected')
      call refused('& alone', '&tip ', '& tip ', '4: found ''&'' outside a group|expected')
      call refused('subscript', 'm_T=0.15', 'm_T(1)=0.15', &
         '4: &tip m_T(1): found a subscript|expected the values in order')
      call refused('open bracket at the end of a line', 'm_T=0.15 /', 'm_T('//nl//'=0.15 /', &
         '4: &tip m_T(: found a subscript|expected')
      call refused('open bracket, nothing behind', 'm_T=0.15 /', 'm_T(', &
         '4: &tip|found ''m_T(''|expected', lines=2)
   end subroutine test_groups_and_keys

   !> Whatever a reader asks for says what it is, once; what it does not ask for is refused.
   subroutine test_every_group()
      type(block_t), allocatable :: groups(:)
      character(len=:), allocatable :: name, stranger
      integer :: g, i, k

      call list_keys(groups)
      do g = 1, size(groups)
         name = groups(g)%name
         do k = 1, size(groups(g)%keys)
            associate (keys => groups(g)%keys)
               call check('&'//name//' '//trim(keys(k)%name)//': has a line of help', &
                  len(keys(k)%help) > 0 .and. len(keys(k)%default) <= 60)
               call check('&'//name//' '//trim(keys(k)%name)//': asked for once', &
                  count([(keys(i)%name == keys(k)%name, i=1, size(keys))]) == 1)
            end associate
         end do
         stranger = '&'//name//' nonsense=1'
         if (index(case_text, '&'//name//' ') > 0) then
            call refused('a stranger in &'//name, '&'//name//' ', stranger//', ', &
               '&'//name//' nonsense: found an unknown key|expected '//trim(groups(g)%keys(1)%name))
         else
            call refused('a stranger in &'//name, '&units ', stranger//' /'//nl//'&units ', &
               '&'//name//' nonsense: found an unknown key|expected '//trim(groups(g)%keys(1)%name))
         end if
      end do
   end subroutine test_every_group

   subroutine test_values()
      call refused('text for a number', 'm_T=0.15', 'm_T=heavy', &
         '4: &tip m_T: found ''heavy''|expected a number')
      call refused('quoted text for a number', 'm_T=0.15', 'm_T=''0.15''', &
         '4: &tip m_T: found the text ''0.15'' in quotes|expected a number')
      call refused('number for text', 'kind=''pulse''', 'kind=1', &
         '6: &excitation kind: found ''1''|expected text in quotes')
      call refused('text without quotes', 'kind=''pulse''', 'kind=pulse', &
         '6: &excitation kind: found ''pulse''|expected text in quotes')
      call refused('no closing quote', 'kind=''pulse''', 'kind=''pulse', &
         '6: &excitation kind: found|without a closing quote|same line', lines=2)
      call refused('real for an integer', 'degree=3', 'degree=3.0', &
         '8: &discretization degree: found ''3.0''|expected an integer')
      call refused('integer beyond 32 bits', 'elements=2', 'elements=20000000000', &
         '8: &discretization elements: found ''20000000000''|expected an integer between')
      call refused('logical for a number', 'm_T=0.15', 'm_T=.true.', &
         '4: &tip m_T: found ''.true.''|expected a number')
      call refused('decimal comma', 'm_T=0.15', 'm_T=0,15', &
         '4: &tip m_T: found 2 values|expected 1|decimal point')
      call refused('too many values', 'rho=0.03', 'rho=0.03 0.04', &
         '2: &beam rho: found 2 values|expected 1')
      call refused('too many free', 'free=''m_H'',', 'free='//repeat('''m_H'', ', 20), &
         '12: &stage free: found 21 values|expected at most')
      call refused('no value', 'm_T=0.15', 'm_T=', '4: &tip m_T: found no value|expected a number')
      call refused('no value before a key', 'm_H=0.04', 'm_H=', &
         '5: &hose m_H: found no value|expected a number')
      call refused('empty value', 'lower=0,0.1', 'lower=0,,0.1', &
         '12: &stage lower: found an empty value|expected a number')
      call refused('a unit behind a number', 'length=4.0', 'length=4.0 ft', &
         '2: &beam length: found ''ft'' after a number|units are not written')
      call refused('a unit glued to a number', 'length=4.0', 'length=4.0ft', &
         '2: &beam length: found ''4.0ft''|expected a number')
      call refused('repeat count', 'lower=0,0.1', 'lower=2*0', &
         '12: &stage lower: found ''2*0''|expected the values written out')
      call refused('fraction', 'm_T=0.15', 'm_T=1/2', &
         '4: &tip m_T: found ''1/2''|expected a number')
      call refused('two signs', 'm_T=0.15', 'm_T=--1', &
         '4: &tip m_T: found ''--1''|expected a number')
      call refused('= twice', 'm_T=0.15', 'm_T==0.15', '4: &tip m_T: found ''=''|expected a number')
      call refused('hexadecimal', 'm_T=0.15', 'm_T=0x1', &
         '4: &tip m_T: found ''0x1''|expected a number')
      call refused('unit label with a comma', 'force=''lb''', 'force=''lb,f''', &
         '13: &units force: found ''lb,f''|expected a label without commas')
      call refused('unit label with a quote', 'force=''lb''', 'force=''"lb"''', &
         '13: &units force: found ''"lb"''|expected a label without')
   end subroutine test_values

   !> NaN and infinity, wherever a number may stand.
   subroutine test_not_finite()
      character(len=*), parameter :: places(*) = [character(len=14) :: 'length=4.0', 'rho=0.03', &
         'E=80.0', &
         'I=1.0', 'c_D=0.005', 'm_T=0.15', 'm_H=0.04', 'c_H=0.004', 'k_H=0.3', 'amplitude=1.0', &
         'duration=0.05', 'power=2.0', 'rtol=1e-8', 'atol=1e-11', 'delta=0.1', 't_first=0.1', &
            't_last=0.6', &
         't_step=0.1', 'start=0.035', 'lower=0', 'upper=1']
      character(len=*), parameter :: values(*) = [character(len=9) :: 'NaN', 'Inf', '-Infinity', &
         '1e999']
      character(len=:), allocatable :: key
      integer :: k, j

      do k = 1, size(places)
         key = places(k)(:index(places(k), '='))
         do j = 1, size(values)
            call refused(key//trim(values(j)), trim(places(k)), key//trim(values(j)), &
               ' '//key(:len(key) - 1)//': found '''//trim(values(j))//'''|expected a number')
         end do
      end do
   end subroutine test_not_finite

   subroutine test_structure()
      call refused('zero length', 'length=4.0', 'length=0', '2: &beam length: found 0|above 0')
      call refused('negative length', 'length=4.0', 'length=-4', &
         '2: &beam length: found -4|above 0')
      call refused('zero density', 'rho=0.03', 'rho=0', '2: &beam rho: found 0|above 0')
      call refused('negative density', 'rho=0.03', 'rho=-0.03', '2: &beam rho: found -0.03|above 0')
      call refused('zero modulus', 'E=80.0', 'E=0.0', '2: &beam E: found 0|above 0')
      call refused('negative modulus', 'E=80.0', 'E=-80', '2: &beam E: found -80|above 0')
      call refused('zero I', 'I=1.0', 'I=0', '2: &beam I: found 0|above 0')
      call refused('negative I', 'I=1.0', 'I=-1.0', '2: &beam I: found -1|above 0')
      call refused('negative viscosity', 'c_D=0.005', 'c_D=-0.005', &
         '3: &beam c_D: found -0.005|0 or more')
      call refused('negative tip mass', 'm_T=0.15', 'm_T=-0.15', &
         '4: &tip m_T: found -0.15|0 or more')
      call refused('negative hose mass', 'm_H=0.04', 'm_H=-0.04', &
         '5: &hose m_H: found -0.04|0 or more')
      call refused('negative hose damping', 'c_H=0.004', 'c_H=-1e-9', &
         '5: &hose c_H: found -1E-|0 or more')
      call refused('negative hose stiffness', 'k_H=0.3', 'k_H=-0.3', &
         '5: &hose k_H: found -0.3|0 or more')
      call refused('no length', 'length=4.0,', '', &
         '2: &beam length: found nothing|expected a value')
      call refused('no density', 'rho=0.03,', '', '2: &beam rho: found nothing|expected a value')
      call refused('no modulus', 'E=80.0,', '', '2: &beam E: found nothing|expected a value')
      call refused('no hose mass', 'm_H=0.04,', '', '5: &hose m_H: found nothing|expected a value')
      call refused('hose without mass', 'm_H=0.04', 'm_H=0', &
         '12: &stage free: found ''m_H''|expected a &hose group')
   end subroutine test_structure

   subroutine test_cross_section()
      character(len=*), parameter :: either = '|expected either I or width and height'

      call refused('both I and width', 'I=1.0', 'I=1.0, width=1, height=1', &
         '2: &beam I: found both'//either)
      call refused('both I and height', 'I=1.0', 'I=1.0, height=1', '2: &beam I: found both'// &
         either)
      call refused('no cross section', 'I=1.0,', '', '2: &beam I: found no cross section'//either)
      call refused('width alone', 'I=1.0', 'width=1', &
         '2: &beam height: found nothing|expected a value')
      call refused('height alone', 'I=1.0', 'height=1', &
         '2: &beam width: found nothing|expected a value')
      call refused('zero width', 'I=1.0', 'width=0, height=1', '2: &beam width: found 0|above 0')
      call refused('negative width', 'I=1.0', 'width=-1, height=1', &
         '2: &beam width: found -1|above 0')
      call refused('zero height', 'I=1.0', 'width=1, height=0', '2: &beam height: found 0|above 0')
      call refused('negative height', 'I=1.0', 'width=1, height=-2', &
         '2: &beam height: found -2|above 0')
   end subroutine test_cross_section

   subroutine test_excitation()
      call refused('unknown kind', '''pulse''', '''step''', &
         '6: &excitation kind: found ''step''|expected ''pulse'', ''table'', ''release'' or '// &
         '''free''')
      call refused('no kind', 'kind=''pulse'',', '', '6: &excitation kind: found nothing|expected')
      call refused('no amplitude', 'amplitude=1.0,', '', &
         '6: &excitation amplitude: found nothing|expected')
      call refused('no duration', 'duration=0.05,', '', &
         '6: &excitation duration: found nothing|expected')
      call refused('zero duration', 'duration=0.05', 'duration=0', &
         '6: &excitation duration: found 0|above 0')
      call refused('negative duration', 'duration=0.05', 'duration=-1', &
         '6: &excitation duration: found -1|above 0')
      call refused('pulse with a file', 'amplitude=1.0', 'amplitude=1.0, file=''force.csv''', &
         '6: &excitation file: found a value|expected none')
      call refused('table with an amplitude', pulse, table//', amplitude=1', &
         '6: &excitation amplitude: found a value|expected none')
      call refused('table with a duration', pulse, table//', duration=1', &
         '6: &excitation duration: found a value|expected none')
      call refused('table without a file', pulse, 'kind=''table''', &
         '6: &excitation file: found nothing|expected')
      call refused('unknown load', '''point''', '''tip''', &
         '7: &excitation load: found ''tip''|expected ''point'' or ''distributed''')
      call refused('power below 2', 'power=2.0', 'power=1.99', &
         '7: &excitation power: found 1.99|expected 2 or more')
      call refused('negative power', 'power=2.0', 'power=-2', &
         '7: &excitation power: found -2|expected 2 or more')
   end subroutine test_excitation

   subroutine test_discretization()
      character(len=*), parameter :: place = '8: &discretization '

      call refused('elements 0', 'elements=2', 'elements=0', place// &
         'elements: found 0|expected 1 to')
      call refused('elements -1', 'elements=2', 'elements=-1', place// &
         'elements: found -1|expected 1 to')
      call refused('elements 10**8', 'elements=2', 'elements=100000000', place// &
         'elements: found 100000000|expected 1 to')
      call refused('elements twice the same', 'elements=2', 'elements=3,2,3', place// &
         'elements: found 3 twice|expected each number once')
      call refused('elements good and bad', 'elements=2', 'elements=2,3,0', place// &
         'elements: found 0|expected 1 to')
      call refused('too many for all modes', 'elements=2', 'elements=5000', &
         'case.nml|&discretization elements: found 5000|expected at most', command='modes')
      call refused('degree 1', 'degree=3', 'degree=1', place//'degree: found 1|expected 3, 5 or 7')
      call refused('degree 2', 'degree=3', 'degree=2', place//'degree: found 2|expected 3, 5 or 7')
      call refused('degree 4', 'degree=3', 'degree=4', place//'degree: found 4|expected 3, 5 or 7')
      call refused('degree 9', 'degree=3', 'degree=9', place//'degree: found 9|expected 3, 5 or 7')
      call refused('degree -3', 'degree=3', 'degree=-3', place// &
         'degree: found -3|expected 3, 5 or 7')
      call refused('gauss_points 0', 'gauss_points=2', 'gauss_points=0', place// &
         'gauss_points: found 0|expected 1 to')
      call refused('gauss_points 10**6', 'gauss_points=2', 'gauss_points=1000000', place// &
         'gauss_points: found 1000000|expected 1 to')
      call refused('panels 0', 'panels=4', 'panels=0', place//'panels: found 0|expected 1 to')
      call refused('panels -4', 'panels=4', 'panels=-4', place//'panels: found -4|expected 1 to')
      call refused('too few points', 'gauss_points=2, panels=4', 'gauss_points=1, panels=1', &
         place//'gauss_points: found 1|expected at least')
   end subroutine test_discretization

   subroutine test_integrator()
      character(len=*), parameter :: place = '9: &integrator '

      call refused('unknown method', '''cvode''', '''euler''', place// &
         'method: found ''euler''|expected|''cvode''')
      call refused('rtol 0', 'rtol=1e-8', 'rtol=0', place//'rtol: found 0|expected')
      call refused('rtol -1', 'rtol=1e-8', 'rtol=-1', place//'rtol: found -1|expected')
      call refused('rtol 1', 'rtol=1e-8', 'rtol=1', place//'rtol: found 1|expected')
      call refused('rtol 1e-20', 'rtol=1e-8', 'rtol=1e-20', place//'rtol: found 1E-|expected')
      call refused('atol 0', 'atol=1e-11', 'atol=0', place//'atol: found 0|above 0')
      call refused('atol -1', 'atol=1e-11', 'atol=-1', place//'atol: found -1|above 0')
      call refused('max_order 0', 'max_order=5', 'max_order=0', place// &
         'max_order: found 0|expected 1 to 5')
      call refused('max_order 6', 'max_order=5', 'max_order=6', place// &
         'max_order: found 6|expected 1 to 5')
      call refused('max_steps 0', 'max_steps=20000', 'max_steps=0', place// &
         'max_steps: found 0|expected 1 to')
      call refused('max_steps -1', 'max_steps=20000', 'max_steps=-1', place// &
         'max_steps: found -1|expected 1 to')
   end subroutine test_integrator

   subroutine test_observation()
      character(len=*), parameter :: place = '10: &observation ', &
         difference = '''displacement_difference'''

      call refused('unknown formula', difference, '''jerk''', place// &
         'formula: found ''jerk''|expected|''equation''')
      call refused('delta missing', ', delta=0.1', '', place// &
         'delta: found nothing|expected a value')
      call refused('delta 0', 'delta=0.1', 'delta=0', place//'delta: found 0|above 0')
      call refused('delta -0.1', 'delta=0.1', 'delta=-0.1', place//'delta: found -0.1|above 0')
      call refused('delta without difference', difference, '''equation''', place// &
         'delta: found a value|expected none')
   end subroutine test_observation

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
         't_step: found|samples|expected at most 1000000', command='simulate')
      call refused('10**300 samples', 't_step=0.1', 't_step=1e-300', place// &
         't_step: found|samples|expected at most 1000000', command='simulate')
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
         'found|samples|expected at most 1000000')
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

   subroutine test_stage()
      character(len=*), parameter :: place = '12: &stage ', both = '''m_H'',''k_H'''

      call refused('unknown parameter', both, '''m_H'',''k_X''', place// &
         'free: found ''k_X''|expected one of m_T E c_D')
      call refused('empty parameter', both, '''m_H'',''''', place// &
         'free: found ''''|expected one of m_T E c_D')
      call refused('parameter twice', both, '''m_H'',''m_H''', place// &
         'free: found ''m_H'' twice|expected each parameter once')
      call refused('parameter twice, other case', both, '''m_H'',''M_h''', place// &
         'free: found ''M_h'' twice|expected each parameter once')
      call refused('hose parameter without hose', &
         '&hose           m_H=0.04, c_H=0.004, k_H=0.3 /', '!', place// &
         'free: found ''m_H''|expected a &hose group')
      call refused('no free', 'free='//both//',', '', place//'free: found nothing|expected a value')
      call refused('start above upper', 'start=0.035,0.4', 'start=0.035,40', place// &
         'start: found 40 for k_H|expected a value between 0.1 and 10')
      call refused('start below lower', 'start=0.035,0.4', 'start=0.035,0.01', place// &
         'start: found 0.01 for k_H|expected a value between 0.1 and 10')
      call refused('start below 0', 'start=0.035,0.4, lower=0,0.1', 'start=-1,0.4', place// &
         'start: found -1 for m_H|expected a value between 0 and')
      call refused('one start', 'start=0.035,0.4', 'start=0.035', place// &
         'start: found 1 values|expected 2')
      call refused('three starts', 'start=0.035,0.4', 'start=0.035,0.4,1', place// &
         'start: found 3 values|expected 2')
      call refused('one lower', 'lower=0,0.1', 'lower=0', place//'lower: found 1 values|expected 2')
      call refused('one upper', 'upper=1,10', 'upper=1', place//'upper: found 1 values|expected 2')
      call refused('lower > upper', 'upper=1,10', 'upper=1,0.05', place// &
         'upper: found 0.05|expected more than lower = 0.1')
      call refused('lower = upper', 'upper=1,10', 'upper=1,0.1', place// &
         'upper: found 0.1|expected more than lower = 0.1')
      call refused('negative lower', 'lower=0,0.1', 'lower=-1,0.1', place// &
         'lower: found -1|expected 0 or more')
      call refused('more parameters than samples', 't_last=0.6', 't_last=0.1', place// &
         'free: found 2 unknowns for 1 samples|expected no more')
      call refused('second stage', '&units ', '&stage free=''q'' /'//nl//'&units ', &
         '13: &stage free: found ''q''|expected one of')
   end subroutine test_stage

   subroutine test_release()
      character(len=*), parameter :: place = '6: &excitation ', &
         either = '|expected either force or displacement of the tip before'

      call accepted('release by force', 'identify', released('force=1'))
      call accepted('release by displacement', 'identify', released('displacement=0.1, time=-1'))
      call accepted('release between samples', 'simulate', released('displacement=0.1, time=0.35'))
      call accepted('release without cvode', 'identify', replaced(released('force=1'), &
         '''cvode''', '''modal'''))
      call refused_case('release with both', released('force=1, displacement=0.1'), place// &
         'force: found both force and displacement'//either)
      call refused_case('release with neither', released('time=0'), place// &
         'force: found neither'//either)
      call refused_case('release with neither', released('time=0'), place// &
         'force: found neither'//either, 'simulate')
      call refused_case('release with an amplitude', released('force=1, amplitude=1'), place// &
         'amplitude: found a value|expected none')
      call refused_case('release with a duration', released('force=1, duration=1'), place// &
         'duration: found a value|expected none')
      call refused_case('release with modes', released('force=1, modes=2'), place// &
         'modes: found a value|expected none')
      call refused_case('release with a load', released('force=1, load=''point'''), place// &
         'load: found a value|expected none')
      call refused_case('release at NaN', released('force=1, time=NaN'), place// &
         'time: found ''NaN''|expected a number')
      call refused_case('release of Inf', released('displacement=Inf'), place// &
         'displacement: found ''Inf''|expected a number')
      call refused('pulse with a time', 'amplitude=1.0', 'amplitude=1.0, time=0', place// &
         'time: found a value|expected none')
      call refused('pulse with a force', 'amplitude=1.0', 'amplitude=1.0, force=1', place// &
         'force: found a value|expected none')
      call refused('pulse with modes', 'amplitude=1.0', 'amplitude=1.0, modes=2', place// &
         'modes: found a value|expected none')
   end subroutine test_release

   !> The case with a release in place of the pulse.
   function released(keys) result(text)
      character(len=*), intent(in) :: keys
      character(len=:), allocatable :: text

      text = replaced(case_text, pulse//','//nl//'                load=''point'', power=2.0', &
         'kind=''release'', '//keys//nl//'  ')
   end function released

   !> The case with a free start, solved exactly, one parameter free.
   function freed(keys) result(text)
      character(len=*), intent(in) :: keys
      character(len=:), allocatable :: text

      text = replaced(released(keys), '''release''', '''free''')
      text = replaced(text, &
         'method=''cvode'', rtol=1e-8, atol=1e-11, max_order=5, max_steps=20000', &
         'method=''modal''')
      text = replaced(text, 'free=''m_H'',''k_H'', start=0.035,0.4, lower=0,0.1, upper=1,10', &
         'free=''m_H''')
   end function freed

   subroutine test_free_start()
      character(len=*), parameter :: place = '6: &excitation ', one = 'modes=1'

      call accepted('free start', 'identify', freed(one))
      ! With six samples, an offset and m_H, J has no minimum: m_H would go on for ever.
      call accepted('free start and offset', 'identify', replaced(freed(one), 'free=''m_H''', &
         'free=''c_H'',''offset'''))
      call accepted('nothing but what enters linearly', 'identify', replaced(freed(one), &
         'free=''m_H''', 'free=''offset'''))
      call accepted('free start', 'modes', freed(one))
      call refused_case('no mode', freed('modes=0'), place//'modes: found 0|expected 1 to 20')
      call refused_case('a negative number of modes', freed('modes=-1'), place// &
         'modes: found -1|expected 1 to 20')
      call refused_case('21 modes', freed('modes=21'), place//'modes: found 21|expected 1 to 20')
      call refused_case('one and a half modes', freed('modes=1.5'), place// &
         'modes: found ''1.5''|expected an integer')
      ! Two cubic elements have three functions, and there is the hose.
      call refused_case('more modes than the mesh has', replaced(freed('modes=5'), 't_step=0.1', &
         't_step=0.01'), 'case.nml|&excitation modes: found 5|expected at most 4', &
         record=long_record())
      call refused_case('free start with a force', freed('modes=1, force=1'), place// &
         'force: found a value|expected none')
      call refused_case('free start with an amplitude', freed('modes=1, amplitude=1'), place// &
         'amplitude: found a value|expected none')
      call refused_case('free start by cvode', replaced(freed(one), '''modal''', '''cvode'''), &
         'case.nml|found a start that is not known with method = ''cvode''|expected|''modal''')
      call refused_case('free start', freed(one), &
         'case.nml|&excitation kind: found ''free''|expected a start that is known', 'simulate')
      call refused_case('amplitude of a free start', replaced(freed(one), 'free=''m_H''', &
         'free=''m_H'',''amplitude'''), &
         '12: &stage free: found ''amplitude''|expected no amplitude')
      call refused_case('unknowns of the modes are counted', replaced(freed('modes=3'), &
         'free=''m_H''', 'free=''m_H'''), &
         '12: &stage free: found 7 unknowns for 6 samples|expected no more')
      call refused_case('the offset is counted', replaced(freed('modes=2'), 'free=''m_H''', &
         'free=''m_H'',''E'',''offset'''), &
         '12: &stage free: found 7 unknowns for 6 samples|expected no more')
      call refused_case('score beside a free start', replaced(freed(one), '&units ', &
         '&score t_last=0.4 /'//nl//'&units '), &
         '13: &score: found it beside|expected one record with a known start')
      call refused_case('score beside an offset', replaced(replaced(case_text, 'free=''m_H'',', &
         'free=''offset'','), '&units ', '&score t_last=0.4 /'//nl//'&units '), &
         '13: &score: found it beside|expected one record with a known start')
   end subroutine test_free_start

   !> 51 samples from .1 s to .6 s.
   function long_record() result(text)
      character(len=:), allocatable :: text
      character(len=24) :: row
      integer :: k

      text = 't,acceleration'//nl
      do k = 10, 60
         write (row, '(f4.2,a,f7.4)') k/100.0, ',', sin(0.3*k) + 0.2*cos(0.05*k*k)
         text = text//trim(row)//nl
      end do
   end function long_record

   subroutine test_sensor_and_clamp()
      character(len=*), parameter :: beam = 'c_D=0.005', sensor = '5: &sensor ', &
         tip = '&tip            m_T=0.15 /', after = tip//nl//'&sensor '

      call accepted('sensor, clamp, air', 'simulate', replaced(replaced(case_text, beam, &
         beam//', gamma=0.01, k_R=100'), tip, '&tip m_T=0.15, J_T=0.01 /'//nl// &
         '&sensor m_S=0.01, x_S=4 /'))
      call refused('negative air damping', beam, beam//', gamma=-1e-3', &
         '3: &beam gamma: found -0.001|0 or more')
      call refused('soft root of nothing', beam, beam//', k_R=0', '3: &beam k_R: found 0|above 0')
      call refused('negative spring at the root', beam, beam//', k_R=-5', &
         '3: &beam k_R: found -5|above 0')
      call refused('damper at a rigid root', beam, beam//', c_R=0.5', &
         '3: &beam c_R: found a value without k_R|expected both')
      call refused('negative damper at the root', beam, beam//', k_R=5, c_R=-0.5', &
         '3: &beam c_R: found -0.5|0 or more')
      call refused('c_R free with a rigid root', 'free=''m_H''', 'free=''c_R''', &
         '12: &stage free: found ''c_R''|expected a value of k_R in &beam for it')
      call refused('rigid root as a number', beam, beam//', k_R=Inf', &
         '3: &beam k_R: found ''Inf''|expected a number')
      call refused('k_R free with a rigid root', 'free=''m_H''', 'free=''k_R''', &
         '12: &stage free: found ''k_R''|expected a value of k_R in &beam for it')
      call refused('negative inertia of the tip', 'm_T=0.15', 'm_T=0.15, J_T=-1', &
         '4: &tip J_T: found -1|0 or more')
      call refused('negative mass of the sensor', tip, after//'m_S=-0.01 /', sensor// &
         'm_S: found -0.01|0 or more')
      call refused('place of the sensor free beyond the tip', 'free=''m_H'',''k_H'', '// &
         'start=0.035,0.4, lower=0,0.1, upper=1,10', 'free=''m_H'',''x_S'', lower=0,4', &
         '12: &stage lower: found 4 for x_S|expected less than the length 4')
      call refused('sensor beyond the tip', tip, after//'x_S=4.001 /', sensor// &
         'x_S: found 4.001|expected a place above 0, up to the length 4')
      call refused('sensor at the root', tip, after//'x_S=0 /', sensor//'x_S: found 0|above 0')
      call refused('sensor behind the root', tip, after//'x_S=-1 /', sensor// &
         'x_S: found -1|above 0')
   end subroutine test_sensor_and_clamp

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
         '14: &score: found it beside several records|expected one record')
      call refused('a response of two records', units, more//units, &
         '13: &record: found a second one|expected one for a response', command='simulate')
      call refused('the second record is missing', units, replaced(more, 'record.csv', &
         'none.csv')//units, 'none.csv: found no such file|expected', file='none.csv')
      call refused_case('parameters for each are counted', replaced(replaced(replaced(case_text, &
         units, more//units), 't_last=0.6', 't_last=0.1'), 'free=''m_H'',''k_H''', &
         'free=''m_H'',''k_H'', shared=''m_H'''), &
         '12: &stage free: found 3 unknowns for 2 samples|expected no more')
   end subroutine test_several_records

   subroutine test_noise()
      character(len=*), parameter :: units = '&units ', line = '13: &noise '

      call refused('no sd', units, '&noise seed=1 /'//nl//units, line// &
         'sd: found nothing|expected', &
         command='simulate')
      call refused('negative sd', units, '&noise sd=-1 /'//nl//units, line// &
         'sd: found -1|expected 0 or more', &
         command='simulate')
      call refused('NaN', units, '&noise sd=NaN /'//nl//units, line// &
         'sd: found ''NaN''|expected a number', &
         command='simulate')
      call refused('seed', units, '&noise sd=1, seed=1.5 /'//nl//units, &
         line//'seed: found ''1.5''|expected an integer', command='simulate')
   end subroutine test_noise

   !> Groups that a command cannot do without.
   subroutine test_needs()
      call refused('no &beam', '&beam           length=4.0, rho=0.03, E=80.0, I=1.0,'//nl// &
         '                c_D=0.005 /', '', 'found no group &beam|expected one', command='modes')
      call refused('no &excitation', '&excitation     '//pulse//','//nl// &
         '                load=''point'', power=2.0 /', &
         '', '&excitation: found no such group|expected one', command='simulate')
      call refused('no &record', &
         '&record         file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /', &
         '', '&record: found no such group|expected one')
      call refused('no &record', &
         '&record         file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /', &
         '', '&record: found no such group|expected one', command='simulate')
      call refused('no &stage', &
         '&stage          free=''m_H'',''k_H'', start=0.035,0.4, lower=0,0.1, upper=1,10 /', &
         '', '&stage: found no such group|expected one or more')
      call refused('no record file', 'file=''record.csv'', ', '', &
         '11: &record file: found nothing|expected the path of a record')
      call refused('empty record file', '''record.csv''', '''''', &
         '11: &record file: found ''''|expected the path of a record')
   end subroutine test_needs

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
      call refused_record('semicolons and decimal commas', record_text, &
         '0,1;0,29'//nl//'0,2;-0,97'//nl, 'record.csv:1: found both '';'' and '',''|decimal point')
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
   end subroutine test_force_table

   !> An output folder whose path leads through a file, or that the system does not allow.
   subroutine test_output_folder()
      character(len=*), parameter :: commands(*) = [character(len=8) :: 'identify', 'simulate', &
         'modes']
      type(outcome_t) :: outcome
      integer :: k

      call write_good_files()
      do k = 1, size(commands)
         outcome = beamid(trim(commands(k))//' case.nml --quiet --out record.csv/result', 'bad')
         call judge(trim(commands(k))//': output through a file', outcome, &
            'record.csv/result|output folder cannot be written|Not a directory', 1)
      end do
      outcome = beamid('modes case.nml --out case.nml', 'bad')
      call judge('modes: output folder is a file', outcome, &
         'case.nml: |cannot be written|Not a directory', 1)
      outcome = beamid('modes case.nml --out /proc/beamid/result', 'bad')
      call judge('modes: output below /proc', outcome, '/proc/beamid/result|cannot be written', 1)
      outcome = beamid('modes case.nml --out '//repeat('x', 300), 'bad')
      call judge('modes: name too long', outcome, repeat('x', 300)//'|cannot be written', 1)
   end subroutine test_output_folder

   !> All problems of a file are told, one line each.
   subroutine test_several_problems()
      call write_good_files(replaced(replaced(case_text, 'm_T=0.15', 'mass=0.15'), 'degree=3', &
         'degree=x'))
      call refused_now('two problems', 'modes', 'case.nml', &
         'case.nml:4: &tip mass: found|case.nml:8: &discretization degree: found ''x''', lines=2)
   end subroutine test_several_problems

   !> A change of the case file is refused; `words` follow the file's name and a colon.
   subroutine refused(what, old, new, words, command, file, lines)
      character(len=*), intent(in) :: what, old, new, words
      character(len=*), intent(in), optional :: command, file
      integer, intent(in), optional :: lines
      character(len=:), allocatable :: verb, place

      verb = 'identify'
      if (present(command)) verb = command
      call write_good_files(replaced(case_text, old, new))
      place = 'case.nml|'
      if (scan(words(:1), '0123456789') > 0) place = 'case.nml:'
      if (present(file)) place = ''
      call refused_now(what, verb, 'case.nml', place//words, lines)
   end subroutine refused

   !> A case of its own is refused.
   subroutine refused_case(what, text, words, command, record)
      character(len=*), intent(in) :: what, text, words
      character(len=*), intent(in), optional :: command, record
      character(len=:), allocatable :: verb, place

      verb = 'identify'
      if (present(command)) verb = command
      call write_good_files(text)
      if (present(record)) call write_file(folder//'record.csv', record)
      place = ''
      if (scan(words(:1), '0123456789') > 0) place = 'case.nml:'
      call refused_now(what, verb, 'case.nml', place//words)
   end subroutine refused_case

   !> A change of the record is refused.
   subroutine refused_record(what, old, new, words)
      character(len=*), intent(in) :: what, old, new, words

      call write_good_files()
      call write_file(folder//'record.csv', replaced(record_text, old, new))
      call refused_now('record: '//what, 'identify', 'case.nml', words)
   end subroutine refused_record

   !> A change of the force table is refused.
   subroutine refused_force(what, old, new, words)
      character(len=*), intent(in) :: what, old, new, words

      call write_good_files(replaced(case_text, pulse, table))
      call write_file(folder//'force.csv', replaced(force_text, old, new))
      call refused_now('force table: '//what, 'simulate', 'case.nml', 'force.csv|'//words)
   end subroutine refused_force

   !> Runs a command on a case file as it stands now.
   subroutine refused_now(what, command, file, words, lines)
      character(len=*), intent(in) :: what, command, file, words
      integer, intent(in), optional :: lines
      integer :: allowed

      allowed = 1
      if (present(lines)) allowed = lines
      call judge(command//': '//what, beamid(command//' '//file//' --quiet --out result', 'bad'), &
         words, allowed)
   end subroutine refused_now

   !> One check per row: status, message, and nothing written.
   subroutine judge(what, outcome, words, lines)
      character(len=*), intent(in) :: what, words
      type(outcome_t), intent(in) :: outcome
      !> The most lines that the message may have; 1 in most rows.
      integer, intent(in) :: lines
      character(len=:), allocatable :: fault
      character(len=12) :: status

      fault = ''
      write (status, '(i0)') outcome%status
      if (outcome%status /= 2) fault = fault//' status '//trim(status)//', expected 2;'
      if (line_count(outcome%err) < 1 .or. line_count(outcome%err) > lines) fault = fault// &
         ' not one line;'
      if (index(outcome%err, 'beamid: ') /= 1) fault = fault//' not from beamid;'
      if (.not. has_all(outcome%err, words)) fault = fault//' not with '//words//';'
      if (outcome%out /= '') fault = fault//' standard output used;'
      if (exists(folder//'result') .or. exists(folder//'out')) fault = fault//' output written;'
      call check(what, fault == '', fault//' '//outcome%err(:max(0, len(outcome%err) - 1)))
      if (index(fault, 'written') > 0) call remove_tree('bad')
   end subroutine judge

   !> A case that must pass.
   subroutine accepted(what, command, text, record, force, without_stage)
      character(len=*), intent(in) :: what, command, text
      character(len=*), intent(in), optional :: record, force
      logical, intent(in), optional :: without_stage
      type(outcome_t) :: outcome
      character(len=:), allocatable :: changed

      changed = text
      if (present(without_stage)) changed = replaced(text, '&stage ', '! ')
      call write_good_files(changed)
      if (present(record)) call write_file(folder//'record.csv', record)
      if (present(force)) call write_file(folder//'force.csv', force)
      outcome = beamid(command//' case.nml --quiet --out result', 'bad')
      call check(command//': '//what//' is accepted', outcome%status == 0 .and. &
         outcome%err == '' .and. &
         outcome%out /= '' .and. exists(folder//'result/summary.txt'), outcome%err)
      call remove_tree(folder//'result')
   end subroutine accepted

   !> The three files, good but for the case where `text` is given.
   subroutine write_good_files(text)
      character(len=*), intent(in), optional :: text

      if (present(text)) then
         call write_file(folder//'case.nml', text)
      else
         call write_file(folder//'case.nml', case_text)
      end if
      call write_file(folder//'record.csv', record_text)
      call write_file(folder//'force.csv', force_text)
   end subroutine write_good_files

end program test_bad_input
