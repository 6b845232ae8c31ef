!> Bad input, one row each: a good case with one change must end with status 2 and one line on
!> standard error that names file, place, what was found and what was expected, and write nothing.
!> Here what is no case at all: files, groups, keys, forms of values, output folders.
program test_bad_input
   use bad_cases, only: accepted, case_text, cr, folder, force_text, judge, mark, nl, pulse, &
      record_text, refused, refused_now, tab, table, write_good_files
   use beamid_blocks, only: block_t
   use beamid_case_files, only: list_keys
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, open_shell, outcome_t, replaced, write_file
   implicit none

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
      call test_needs()
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
      ! The record is that of another tip: a fit has several minima.
      call accepted('m_T = 0', 'simulate', replaced(case_text, 'm_T=0.15', 'm_T=0'))
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
         '4: found unknown group ''&tipp''|expected &beam, &end, &tip')
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
                  len(keys(k)%help) > 0 .and. len(keys(k)%default) <= 80)
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
      call refused('too many free', 'free=''m_H'',', 'free='//repeat('''m_H'', ', n_parameters &
         + 4), &
         '12: &stage free: found '//to_text(n_parameters + 5)//' values|expected at most')
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
         '11: &record file: found ''''|expected the path of a file')
   end subroutine test_needs

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
      outcome = beamid('modes case.nml --quiet --out case.nml', 'bad')
      call judge('modes: output folder is a file', outcome, &
         'case.nml: |cannot be written|Not a directory', 1)
      outcome = beamid('modes case.nml --quiet --out /proc/beamid/result', 'bad')
      call judge('modes: output below /proc', outcome, '/proc/beamid/result|cannot be written', 1)
      outcome = beamid('modes case.nml --quiet --out '//repeat('x', 300), 'bad')
      call judge('modes: name too long', outcome, repeat('x', 300)//'|cannot be written', 1)
   end subroutine test_output_folder

   !> All problems of a file are told, one line each.
   subroutine test_several_problems()
      call write_good_files(replaced(replaced(case_text, 'm_T=0.15', 'mass=0.15'), 'degree=3', &
         'degree=x'))
      call refused_now('two problems', 'modes', 'case.nml', &
         'case.nml:4: &tip mass: found|case.nml:8: &discretization degree: found ''x''', lines=2)
      call write_good_files(replaced(case_text, 'm_T=0.15 /', 'm_T=-1 /'//nl// &
         '&sensor x_S=-1 /'//nl//'&sensor x_S=3 /'))
      call refused_now('three problems', 'modes', 'case.nml', &
         'case.nml:4: &tip m_T: found -1|case.nml:5: &sensor x_S: found -1|'// &
         'case.nml:6: &sensor name: found several', lines=3)
   end subroutine test_several_problems

end program test_bad_input
