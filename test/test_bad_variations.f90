!> Bad cases of properties that vary along the beam, one row each: &along, and E(x) and c_D(x) in
!> &stage.
program test_bad_variations
   use bad_cases, only: accepted, carrying, folder, freeing, case_text, group, refused_case, &
      refused_now, write_good_files
   use checks, only: finish, skip
   use shell, only: close_shell, open_shell, remove_tree, replaced, write_file
   implicit none

   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('bad variations', reason)
   else
      call test_places()
      call test_values()
      call test_company()
      call test_files()
      call test_dips()
      call test_coefficients()
      call close_shell()
   end if
   call finish('bad_variations')

contains

   !> The good case with such groups in line 5 and after; the beam of 4 has E = 80, rho = .03.
   function along(keys, more) result(text)
      character(len=*), intent(in) :: keys
      character(len=*), intent(in), optional :: more
      character(len=:), allocatable :: text

      text = group('along', keys)
      if (present(more)) text = text//group('along', more)
      text = carrying(text)
   end function along

   !> That with a rectangle in the place of I.
   function rectangular(text, section) result(changed)
      character(len=*), intent(in) :: text, section
      character(len=:), allocatable :: changed

      changed = replaced(text, 'I=1.0', section)
   end function rectangular

   !> Stages in the place of the one that is there, by modal.
   function staged(stages) result(text)
      character(len=*), intent(in) :: stages
      character(len=:), allocatable :: text

      text = replaced(case_text, '''cvode''', '''modal''')
      text = freeing(text, stages)
   end function staged

   !> Values of a parameter along the beam that are refused.
   subroutine refuse_values(what, parameter, keys, words)
      character(len=*), intent(in) :: what, parameter, keys, words

      call refused_case(what, along('parameter='''//parameter//''', '//keys), words)
   end subroutine refuse_values

   subroutine test_places()
      character(len=*), parameter :: x = '5: &along x: found '

      call accepted('straight lines', 'simulate', along('parameter=''E'', x=0,4, value=80,40'))
      call accepted('steps that end before the tip', 'simulate', &
         along('parameter=''E'', kind=''steps'', x=0,3, value=80,40'))
      call accepted('steps with their end', 'simulate', &
         along('parameter=''E'', kind=''steps'', x=0,2,4, value=80,40'))
      call accepted('a spline', 'simulate', &
         along('parameter=''rho'', kind=''spline'', x=0,1,4, value=.03,.02,.025'))
      call refuse_values('x not ascending', 'E', 'x=0,3,2,4, value=80,9,9,9', &
         x//'2 after 3|ascending')
      call refuse_values('x twice', 'E', 'x=0,2,2,4, value=80,9,9,9', x//'2 after 2|ascending')
      call refuse_values('x not from 0', 'E', 'x=1,4, value=80,9', &
         x//'1 as the first place|expected 0')
      call refuse_values('x from below 0', 'E', 'x=-1,4, value=80,9', &
         x//'-1 as the first place|expected 0')
      call refuse_values('x beyond the length', 'E', 'x=0,5, value=80,9', &
         x//'5|places up to the length 4')
      call refuse_values('steps beyond the length', 'E', 'x=0,5, value=80,9, kind=''steps''', &
         x//'5|places up to the length 4')
      call refuse_values('x short of the length', 'E', 'x=0,3, value=80,9', &
         x//'3 as the last place|expected the length 4')
      call refuse_values('spline short of the length', 'E', 'x=0,3, value=80,9, kind=''spline''', &
         x//'3 as the last place|expected the length 4')
      call refuse_values('one place', 'E', 'x=0, value=80', x//'1 place|two')
      call refuse_values('no x', 'E', 'value=80,40', x//'nothing')
   end subroutine test_places

   subroutine test_values()
      character(len=*), parameter :: value = '5: &along value: found '

      call accepted('a viscosity that vanishes', 'simulate', &
         along('parameter=''c_D'', x=0,4, value=.005,0'))
      call refuse_values('more values than places', 'E', 'x=0,4, value=80,9,9', &
         value//'3 values|expected 2, one for each x')
      call refuse_values('fewer values than places', 'E', 'x=0,4, value=80', &
         value//'1 values|expected 2')
      call refuse_values('no values', 'E', 'x=0,4', value//'nothing')
      call refuse_values('a value of 0', 'E', 'x=0,4, value=80,0', value//'0|above 0')
      call refuse_values('a value below 0', 'rho', 'x=0,4, value=.03,-1', value//'-1|above 0')
      call refuse_values('damping below 0', 'gamma', 'x=0,4, value=.03,-1', &
         value//'-1|expected 0 or more')
      call refuse_values('no damping at all', 'c_D', 'x=0,4, value=0,0', value//'0|above 0')
      call refuse_values('a spline that falls below 0', 'E', 'kind=''spline'', x=0,1,2,3,4, '// &
         'value=80,1,80,1,80', value//'a spline|falls to 0|kind = ''linear''')
      call refuse_values('another value in &beam', 'E', 'x=0,4, value=70,40', &
         value//'40 to 70|E = 80 of &beam')
      call refused_case('another height in &beam', rectangular(along( &
         'parameter=''height'', x=0,4, value=.1,.05'), 'width=1, height=.2'), &
         value//'0.05 to 0.1|height = 0.2 of &beam')
      call accepted('a height that &beam leaves out', 'simulate', rectangular(along( &
         'parameter=''height'', x=0,4, value=.2,.1'), 'width=1'))
      call refuse_values('no numbers', 'E', 'x=0,4, value=''a'',''b''', &
         '5: &along value: found the text')
   end subroutine test_values

   subroutine test_company()
      character(len=*), parameter :: parameter = '5: &along parameter: found '

      call refused_case('no parameter', along('x=0,4, value=80,40'), parameter//'nothing')
      call refused_case('another parameter', along('parameter=''m_T'', x=0,4, value=80,40'), &
         parameter//'''m_T''|expected ''E'', ''c_D''')
      call refused_case('an unknown kind', along('parameter=''E'', kind=''cubic'', x=0,4, '// &
         'value=80,40'), '5: &along kind: found ''cubic''|''spline''')
      call refused_case('a parameter twice', along('parameter=''E'', x=0,4, value=80,40', &
         'parameter=''E'', x=0,4, value=80,40'), '6: &along parameter: found ''E'' twice')
      call refused_case('rho beside density', rectangular(replaced(along( &
         'parameter=''rho'', x=0,4, value=.03,.02'), 'rho=0.03', 'density=1'), &
         'width=.3, height=.1'), parameter//'''rho'' beside density')
      call refused_case('height beside I', along('parameter=''height'', x=0,4, value=.1,.05'), &
         parameter//'''height'' beside I')
      call refused_case('width beside I', along('parameter=''width'', x=0,4, value=.1,.05'), &
         parameter//'''width'' beside I')
      call refused_case('height without width', rectangular(along( &
         'parameter=''height'', x=0,4, value=.1,.05'), 'height=.1'), &
         '2: &beam width: found nothing')
      call refused_case('a place beside values', along('parameter=''E'', x=0,4, value=80,40, '// &
         'place=2'), '5: &along place: found a value|expected none')
   end subroutine test_company

   subroutine test_files()
      character(len=*), parameter :: from = 'parameter=''E'', file=''along.csv'''

      call refused_case('a file that is not there', along(from), 'along.csv|no such file')
      call refused_case('two files that are not there', along(from, &
         'parameter=''rho'', file=''rho.csv'''), 'along.csv|no such file')
      call refused_case('a file without a name', along('parameter=''E'', file='''''), &
         '5: &along file: found ''''|expected the path')
      call refused_case('a folder', along('parameter=''E'', file=''.'''), &
         'directory|expected a file')
      call refused_case('a file beside x', along(from//', x=0,4'), &
         '5: &along x: found a value|expected none beside file')
      call refused_case('a file beside value', along(from//', value=0,4'), &
         '5: &along value: found a value|expected none beside file')
      call write_good_files(along(from))
      call write_file(folder//'along.csv', 'hello scenario'//new_line('a'))
      call refused_now('no table', 'simulate', 'case.nml', 'along.csv:1: found ''hello scenario''')
      call write_file(folder//'along.csv', '')
      call refused_now('an empty table', 'simulate', 'case.nml', 'along.csv|no line of data')
      call write_file(folder//'along.csv', 'x,value'//new_line('a')//'0,80'//new_line('a')// &
         '4,forty'//new_line('a'))
      call refused_now('a table of words', 'simulate', 'case.nml', 'along.csv:3|''forty''')
      call write_file(folder//'along.csv', 'x,value'//new_line('a')//'0,80'//new_line('a')// &
         '3,40'//new_line('a'))
      call refused_now('a table short of the length', 'simulate', 'case.nml', &
         'case.nml:5: &along x: found 3 as the last place')
      call write_file(folder//'along.csv', 'x,value'//new_line('a')//'0,80'//new_line('a')// &
         '4,40'//new_line('a'))
      call accepted('a table', 'simulate', along(from))
      call remove_tree(folder//'along.csv')
   end subroutine test_files

   subroutine test_dips()
      character(len=*), parameter :: dip = 'kind=''dip'', place=2, width=1.2, depth=.3'

      call accepted('a dip', 'simulate', along(dip))
      call accepted('a dip of what varies', 'simulate', along('parameter=''E'', x=0,4, '// &
         'value=80,40', dip))
      call accepted('a dip to find', 'identify', replaced(freeing(along(dip), &
         '''place'',''depth'''), '''cvode''', '''modal'''))
      call refused_case('two dips', along(dip, dip), '6: &along kind: found a second dip')
      call refused_case('a dip of rho', along('parameter=''rho'', '//dip), &
         '5: &along parameter: found ''rho'' with a dip|expected ''E''')
      call refused_case('depth 1', along('kind=''dip'', place=2, width=1.2, depth=1'), &
         '5: &along depth: found 1|less than 1')
      call refused_case('depth below 0', along('kind=''dip'', place=2, width=1.2, depth=-.1'), &
         '5: &along depth: found -0.1|0 or more')
      call refused_case('width 0', along('kind=''dip'', place=2, width=0, depth=.1'), &
         '5: &along width: found 0|above 0')
      call refused_case('a dip between the points of the mesh', along('kind=''dip'', place=2, '// &
         'width=.01, depth=.1'), '5: &along width: found 0.01|half an element, 1, or more elements')
      call refused_case('no depth', along('kind=''dip'', place=2, width=1.2'), &
         '5: &along depth: found nothing')
      call refused_case('no place', along('kind=''dip'', depth=.2, width=1.2'), &
         '5: &along place: found nothing')
      call refused_case('a dip at the root', along('kind=''dip'', place=0, width=1.2, depth=.1'), &
         '5: &along place: found 0|above 0')
      call refused_case('a dip beyond the tip', along('kind=''dip'', place=5, width=1.2, '// &
         'depth=.1'), '5: &along place: found 5|up to the length 4')
      call refused_case('it in a second group', along('parameter=''E'', x=0,4, value=80,40', &
         'kind=''dip'', place=5, width=1.2, depth=.1'), &
         '6: &along place: found 5|up to the length 4')
      call refused_case('a dip with places', along(dip//', x=0,4'), &
         '5: &along x: found a value|expected none')
      call refused_case('a dip with a file', along(dip//', file=''along.csv'''), &
         '5: &along file: found a value|expected none')
      call refused_case('a depth that may reach 2', freeing(along(dip), '''depth'', upper=2'), &
         'case.nml|&stage upper: found 2 for depth|less than 1')
      call refused_case('a place that is free without a dip', freeing(case_text, '''place'''), &
         'case.nml|&stage free: found ''place''|expected one of')
   end subroutine test_dips

   !> The stage stands in line 12.
   subroutine test_coefficients()
      character(len=*), parameter :: free = '12: &stage free: found ', &
         more = ' /'//new_line('a')//'&stage free='

      call accepted('E(x)', 'identify', staged('''E(x)'', coefficients=4'))
      call accepted('E(x) beside another', 'identify', staged('''E(x)'',''m_H'', '// &
         'coefficients=4, start=80,.04, upper=200,1'))
      call accepted('E(x) on straight lines', 'identify', staged('''E(x)'', coefficients=4, '// &
         'kind=''linear'''))
      call accepted('E, then E(x)', 'identify', staged('''E'''//more//'''E(x)'', coefficients=4'))
      call accepted('E(x) and c_D(x) in turn', 'identify', staged('''E(x)'', coefficients=4'// &
         more//'''c_D(x)'', coefficients=5'))
      call refused_case('E(x) beside E', staged('''E(x)'',''E'', coefficients=4'), &
         free//'E beside E(x)|expected one of them')
      call refused_case('E before E(x)', staged('''E'',''E(x)'', coefficients=4'), &
         free//'E beside E(x)|expected one of them')
      call refused_case('E(x), then E', staged('''E(x)'', coefficients=4'//more//'''E'''), &
         '13: &stage free: found E beside E(x)|expected one of them')
      call refused_case('c_D(x) beside c_D', staged('''c_D(x)'',''c_D'', coefficients=4'), &
         free//'c_D beside c_D(x)|expected one of them')
      call refused_case('E(x) twice', staged('''E(x)'',''e(X)'', coefficients=4'), &
         free//'''E(x)'' twice')
      call refused_case('E(x) beside a coefficient', staged('''E(x)'',''E.3'', coefficients=4'), &
         free//'''E.3'' twice')
      call refused_case('a coefficient alone', staged('''E.3'''), free//'''E.3''|expected one of')
      call refused_case('E(x) beside &along E', replaced(staged('''E(x)'', coefficients=4'), &
         'm_T=0.15 /', 'm_T=0.15 /'//group('along', 'parameter=''E'', x=0,4, value=80,40')), &
         '13: &stage free: found E(x) beside &along of the same parameter')
      call refused_case('E(x) beside a dip', replaced(staged('''E(x)'', coefficients=4'), &
         'm_T=0.15 /', 'm_T=0.15 /'//group('along', 'kind=''dip'', place=2, width=1, depth=.1')), &
         '13: &stage free: found E(x) beside &along of the same parameter')
      call refused_case('c_D(x) without c_D', replaced(staged('''c_D(x)'', coefficients=4'), &
         'c_D=0.005', 'c_D=0'), free//'''c_D.1''|expected a value of c_D')
      call refused_case('coefficients alone', staged('''E'', coefficients=5'), &
         '12: &stage coefficients: found a value|expected none without E(x)')
      call refused_case('kind alone', staged('''E'', kind=''linear'''), &
         '12: &stage kind: found a value|expected none without E(x)')
      call refused_case('3 coefficients', staged('''E(x)'', coefficients=3'), &
         '12: &stage coefficients: found 3|expected 4 to 64')
      call refused_case('65 coefficients', staged('''E(x)'', coefficients=65'), &
         '12: &stage coefficients: found 65|expected 4 to 64')
      call refused_case('an unknown kind', staged('''E(x)'', kind=''steps'''), &
         '12: &stage kind: found ''steps''|expected ''spline'' or ''linear''')
      call refused_case('other coefficients later', staged('''E(x)'', coefficients=4'//more// &
         '''E(x)'', coefficients=5'), '13: &stage coefficients: found 5|the same number and kind')
      call refused_case('another kind later', staged('''E(x)'', coefficients=4'//more// &
         '''E(x)'', coefficients=4, kind=''linear'''), &
         '13: &stage coefficients: found 4 of kind linear|the same number and kind')
      call refused_case('starts for some', staged('''E(x)'',''m_H'', coefficients=4, start=80'), &
         '12: &stage start: found 1 values|expected 2')
      call refused_case('more unknowns than samples', staged('''E(x)'''), &
         '12: &stage free: found 16 unknowns for 6 samples')
   end subroutine test_coefficients

end program test_bad_variations
