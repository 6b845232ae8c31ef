!> Bad models, one row each: what a case says of beam, force, mesh, integrator, observation, stages
!> and noise.
program test_bad_models
   use bad_cases, only: accepted, carrying, case_text, freeing, group, named, nl, pulse, refused, &
      refused_case, table
   use beamid_kinds, only: wp
   use checks, only: finish, skip
   use shell, only: close_shell, open_shell, replaced
   implicit none

   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('bad models', reason)
   else
      call test_structure()
      call test_cross_section()
      call test_excitation()
      call test_discretization()
      call test_integrator()
      call test_observation()
      call test_release()
      call test_free_start()
      call test_sensor_and_clamp()
      call test_several_sensors()
      call test_supports()
      call test_several_supports()
      call test_weight()
      call test_heavy_loads()
      call test_proportions()
      call test_place_of_force()
      call test_moved_base()
      call test_free_length()
      call test_stage()
      call test_noise()
      call close_shell()
   end if
   call test_priors()
   call test_channels()
   call finish('bad_models')

contains

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
      call refused('no density', 'rho=0.03,', '', '2: &beam rho: found no mass|expected either')
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
         '6: &excitation kind: found ''step''|expected ''pulse'', ''table'', ''release'', '// &
         '''free'' or ''base''')
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
      call refused('knots elsewhere', 'panels=4', 'knots=''masses''', place// &
         'knots: found ''masses''|expected ''attachments'' or ''uniform''')
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
         'free=''m_H'', start=''case''')
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
         't_step=0.01'), 'case.nml: &excitation modes: found 5|expected at most 4', &
         record=long_record())
      call refused_case('free start with a force', freed('modes=1, force=1'), place// &
         'force: found a value|expected none')
      call refused_case('free start with an amplitude', freed('modes=1, amplitude=1'), place// &
         'amplitude: found a value|expected none')
      call refused_case('free start by cvode', replaced(freed(one), '''modal''', '''cvode'''), &
         'case.nml: &integrator method: found ''cvode'' beside kind=''free'''// &
         '|expected ''modal''')
      call refused_case('free start', freed(one), &
         'case.nml|&excitation kind: found ''free''|expected a known excitation', 'simulate')
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
         '13: &score: found the group beside|expected one record with a known excitation')
      call refused_case('score beside an offset', replaced(replaced(case_text, 'free=''m_H'',', &
         'free=''offset'','), '&units ', '&score t_last=0.4 /'//nl//'&units '), &
         '13: &score: found the group beside|expected one record with a known excitation')
   end subroutine test_free_start

   !> 51 samples from .1 s to .6 s.
   function long_record() result(text)
      character(len=:), allocatable :: text
      character(len=24) :: row
      integer :: k

      text = 't,acceleration'//nl
      do k = 10, 60
         write (row, '(f4.2,a,f7.4)') k/100.0_wp, ',', sin(0.3_wp*k) + &
            0.2_wp*cos(0.05_wp*k*k)
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
      ! Without its spring the root is pinned.
      call accepted('pinned root', 'modes', replaced(case_text, beam, beam//', k_R=0'))
      call refused('two descriptions of the root', beam, beam//', k_R=5 /'//nl// &
         '&end at=''root'', kind=''pinned''', '3: &beam k_R: found a value beside &end|'// &
         'expected this key in')
      call refused('negative spring at the root', beam, beam//', k_R=-5', &
         '3: &beam k_R: found -5|0 or more')
      call refused('damper at a rigid root', beam, beam//', c_R=0.5', &
         '3: &beam c_R: found a value without k_R|expected both')
      call refused('negative damper at the root', beam, beam//', k_R=5, c_R=-0.5', &
         '3: &beam c_R: found -0.5|0 or more')
      call refused('c_R free with a rigid root', 'free=''m_H''', 'free=''c_R''', &
         '12: &stage free: found ''c_R''|expected a value of k_R in &beam for it')
      call refused('spring at the root without a value', beam, beam//', k_R=NaN', &
         '3: &beam k_R: found ''NaN''|expected a number or inf')
      call refused('spring at the root that pushes for ever', beam, beam//', k_R=-Inf', &
         '3: &beam k_R: found ''-Inf''|expected a number or inf')
      call refused_case('k_R from 0', freeing(case_text, '''k_R'', start=0'), &
         '12: &stage start: found 0 for k_R|expected a value above 0')
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

   subroutine test_several_sensors()
      character(len=*), parameter :: file = 'file=''record.csv''', letters = &
         '|expected at most 12 letters, digits and _', each = &
         '6: &sensor name: found several groups &sensor, and one without it|a name for each'
      character(len=:), allocatable :: a, b, two

      a = group('sensor', 'name=''a'', x_S=2')
      b = group('sensor', 'name=''b''')
      two = replaced(carrying(a//b), file, file//', sensor=''a''')
      call accepted('two sensors', 'identify', two)
      call accepted('two sensors', 'simulate', two)
      call accepted('a sensor by its name in another case', 'identify', replaced(two, &
         'sensor=''a''', 'sensor=''A'''))
      call accepted('mass of one of two sensors', 'identify', freeing(two, '''m_S.b'''))
      call accepted('20 sensors', 'modes', carrying(named('sensor', 'x_S', 20)))
      call refused_case('21 sensors', carrying(named('sensor', 'x_S', 21)), &
         '25: &sensor name: found 21 groups &sensor|expected at most 20')
      call refused_case('two sensors without names', carrying(group('sensor', 'x_S=2')// &
         group('sensor', 'x_S=3')), each)
      call refused_case('first sensor without a name', carrying(group('sensor', 'x_S=2')//b), each)
      call refused_case('second sensor without a name', carrying(a//group('sensor', 'x_S=3')), &
         each)
      call refused_case('the same name twice', carrying(a//a), &
         '6: &sensor name: found ''a'' twice|expected a name of its own for each')
      call refused_case('the same name in another case', carrying(a//group('sensor', &
         'name=''A''')), '6: &sensor name: found ''A'' twice|expected a name of its own for each')
      call refused_case('name with a blank', carrying(group('sensor', 'name=''a b''')), &
         '5: &sensor name: found ''a b'''//letters)
      call refused_case('name with a dot', carrying(group('sensor', 'name=''a.b''')), &
         '5: &sensor name: found ''a.b'''//letters)
      call refused_case('empty name', carrying(group('sensor', 'name=''''')), &
         '5: &sensor name: found '''''//letters)
      call refused_case('name of 13 letters', carrying(group('sensor', &
         'name=''abcdefghijklm''')), '5: &sensor name: found ''abcdefghijklm'''//letters)
      call refused_case('second sensor beyond the tip', carrying(a//group('sensor', &
         'name=''b'', x_S=5')), '6: &sensor x_S: found 5|up to the length 4')
      call refused_case('first sensor beyond the tip', carrying(group('sensor', &
         'name=''b'', x_S=5')//a), '5: &sensor x_S: found 5|up to the length 4')
      call refused_case('negative mass of the second', carrying(a//group('sensor', &
         'name=''b'', m_S=-1')), '6: &sensor m_S: found -1|0 or more')
      call refused_case('negative inertia', carrying(group('sensor', 'J_S=-1')), &
         '5: &sensor J_S: found -1|0 or more')
      call refused_case('m_S beside two sensors', freeing(two, '''m_S'''), &
         '14: &stage free: found ''m_S''|expected one of|m_S.a|m_S.b')
      call refused_case('m_S of a sensor that is not there', freeing(two, '''m_S.c'''), &
         '14: &stage free: found ''m_S.c''|expected one of|m_S.a|m_S.b')
      call refused_case('m_S twice', freeing(carrying(a), '''m_S'',''m_S.a'''), &
         '13: &stage free: found ''m_S.a'' twice|expected each parameter once')
   end subroutine test_several_sensors

   subroutine test_supports()
      character(len=:), allocatable :: roller

      roller = carrying(group('support', 'x_P=2'))
      ! By the exact response: the record is of a beam without a roller, so that a fit by the
      ! integrator may or may not pass the check of its tolerance.
      call accepted('roller', 'identify', replaced(roller, &
         'method=''cvode'', rtol=1e-8, atol=1e-11, max_order=5, max_steps=20000', &
         'method=''modal'''))
      call accepted('roller', 'simulate', roller)
      call accepted('spring and dashpot', 'simulate', carrying(group('support', &
         'x_P=2, k_P=100, c_P=1')))
      call misplaced('no place', 'k_P=3', 'x_P: found nothing|expected a value')
      call misplaced('at the root', 'x_P=0', 'x_P: found 0|above 0')
      call misplaced('behind the root', 'x_P=-1', 'x_P: found -1|above 0')
      call misplaced('beyond the tip', 'x_P=4.001', &
         'x_P: found 4.001|expected a place above 0, up to the length 4')
      call misplaced('soft support of nothing', 'x_P=2, k_P=0', 'k_P: found 0|above 0|c_P')
      call accepted('a damper alone', 'simulate', carrying(group('support', &
         'x_P=2, k_P=0, c_P=1')))
      call misplaced('negative stiffness', 'x_P=2, k_P=-1', 'k_P: found -1|0 or more')
      call misplaced('neither soft nor rigid', 'x_P=2, k_P=NaN', 'k_P: found ''NaN''|a number')
      call misplaced('dashpot alone', 'x_P=2, c_P=1', &
         'c_P: found a value without k_P|expected both')
      call misplaced('negative dashpot', 'x_P=2, k_P=1, c_P=-1', 'c_P: found -1|0 or more')
      call misplaced('a name with a dot', 'name=''a.b'', x_P=2', 'name: found ''a.b''|letters')
      call refused_case('x_P free without a support', freeing(case_text, '''x_P'''), &
         '12: &stage free: found ''x_P''|expected one of m_T E c_D')
      call refused_case('c_P free at a rigid support', freeing(roller, '''c_P'''), &
         '13: &stage free: found ''c_P''|expected a value of k_P in &support for it')
      call refused_case('free x_P beyond the tip', freeing(roller, '''x_P'', lower=4'), &
         '13: &stage lower: found 4 for x_P|expected less than the length 4 of the beam')
      call refused_case('free x_P from beyond the tip', freeing(roller, '''x_P'', start=5'), &
         '13: &stage start: found 5 for x_P|expected at most the length 4 of the beam')
   end subroutine test_supports

   subroutine test_weight()
      character(len=:), allocatable :: hanging

      hanging = carrying(group('gravity', 'g=32.2'))
      call accepted('hanging', 'identify', carrying(group('gravity', 'g=0.1')))
      call accepted('hanging, in words', 'modes', carrying(group('gravity', &
         'direction=''hanging'', g=32.2')))
      call accepted('no gravity, standing', 'simulate', carrying(group('gravity', &
         'g=0, direction=''standing''')))
      call accepted('free gravity', 'identify', freeing(hanging, '''g'''))
      call accepted('stretched', 'identify', carrying(group('axial', 'force=10')))
      call accepted('pressed', 'simulate', carrying(group('axial', 'force=-10')))
      call accepted('free axial force', 'identify', freeing(carrying(group('axial', 'force=1')), &
         '''T'', lower=-5'))
      call refused_case('gravity of nothing', carrying(group('gravity', '')), &
         '5: &gravity g: found nothing|expected a value')
      call refused_case('negative gravity', carrying(group('gravity', 'g=-9.81')), &
         '5: &gravity g: found -9.81|expected 0 or more')
      call refused_case('gravity sideways', carrying(group('gravity', &
         'g=9.81, direction=''lying''')), '5: &gravity direction: found ''lying''|'// &
         'expected ''hanging'' or ''standing''')
      call refused_case('gravity twice', carrying(group('gravity', 'g=1')//group('gravity', &
         'g=1')), '6: found &gravity again|expected it once')
      call refused_case('axial force of nothing', carrying(group('axial', '')), &
         '5: &axial force: found nothing|expected a value')
      call refused_case('axial force by its short name', carrying(group('axial', 'T=1')), &
         '5: &axial T: found an unknown key|expected force')
      ! -pi**2/4 E I/l**2 is -12.34; 7.84 E I/(rho l**3) is 327, less with m_T.
      call refused_case('pressed too hard', carrying(group('axial', 'force=-12.4')), &
         '5: &axial force: found -12.4|buckles the beam|expected less compression')
      call refused_case('too heavy to stand', carrying(group('gravity', &
         'g=100, direction=''standing''')), &
         '5: &gravity g: found 100|buckles the beam|expected less compression')
   end subroutine test_weight

   !> Loads that the beam cannot carry, or beside which its stiffness counts for nothing: the number
   !> of pieces of the column would grow beyond bounds.
   subroutine test_heavy_loads()
      character(len=*), parameter :: commands(*) = [character(len=8) :: 'identify', 'simulate', &
         'modes'], tension = 'which stretches the beam until it behaves like a string', &
         units = '|check the units: E I/length^2 is only 5 (E = 80 lb/ft^2)', &
         no_units = '|(E = 7 looks like GPa: with m, s and kg, E is in N/m^2; aluminium: 7e10)'
      character(len=:), allocatable :: hanging, standing
      integer :: k

      hanging = strip('hanging')
      standing = strip('standing')
      do k = 1, size(commands)
         call refused_case('modulus in GPa, hanging', hanging, '7: &gravity g: found 9.81, '// &
            tension//'|(E = 7), expected at most 0.00'//no_units, trim(commands(k)))
         call refused_case('modulus in GPa, standing', standing, '7: &gravity g: found 9.81, '// &
            'which buckles the beam|expected less compression or more than E = 7'//no_units, &
            trim(commands(k)))
         call refused_case('gravity of 1e30', carrying(group('gravity', 'g=1e30')), &
            '5: &gravity g: found 1E+30, '//tension//units, trim(commands(k)))
         call refused_case('tension of 1e300', carrying(group('axial', 'force=1e300')), &
            '5: &axial force: found 1E+300, '//tension//'|(E = 80), expected at most '// &
            '1.25E+06'//units, trim(commands(k)))
         call refused_case('compression of 1e300', carrying(group('axial', 'force=-1e300')), &
            '5: &axial force: found -1E+300, which buckles the beam'//units, trim(commands(k)))
         call refused_case('compression of 1e300 with a support', carrying(group('axial', &
            'force=-1e300')//group('support', 'x_P=4')), &
            '5: &axial force: found -1E+300, which buckles the beam'//units, trim(commands(k)))
      end do
      call refused_case('a strip of 22 km, standing', replaced(replaced(standing, 'E=7,', &
         'E=7e10,'), 'length=0.6', 'length=22377.249367708933'), &
         '7: &gravity g: found 9.81, which buckles the beam|E I/length^2 is only 4.65976E-09', &
         'simulate')
      call accepted('a heavy rope', 'modes', carrying(group('axial', 'force=1e6')))
      call refused_case('many elements whose modes are coupled', replaced(carrying( &
         group('gravity', 'g=1')), 'elements=2', 'elements=257'), &
         'case.nml|&discretization elements: found 257|expected at most 256 with gravity', 'modes')
      call refused_case('many elements with the exact response', replaced(replaced(case_text, &
         'elements=2', 'elements=1001'), &
         'method=''cvode'', rtol=1e-8, atol=1e-11, max_order=5, max_steps=20000', &
         'method=''modal'''), &
         'case.nml|&discretization elements: found 1001|expected at most 1000|cvode', 'simulate')
      call refused_case('many elements in a fit', replaced(case_text, 'elements=2', &
         'elements=501'), 'case.nml|&discretization elements: found 501|expected at most 500 '// &
         'in a fit', 'identify')
   end subroutine test_heavy_loads

   !> A strip whose modulus is given in GPa; the other values are in m, s and kg.
   function strip(direction) result(text)
      character(len=*), intent(in) :: direction
      character(len=:), allocatable :: text

      text = '&beam length=0.6, rho=0.27, E=7, width=0.05, height=0.002, c_D=5e-6 /'// &
         group('excitation', 'kind=''pulse'', amplitude=1, duration=0.05')// &
         group('observation', 'formula=''displacement_difference'', delta=0.1')// &
         group('discretization', 'elements=2')//group('record', 'file=''record.csv'', '// &
         't_first=0.1, t_last=0.6, t_step=0.1')//group('stage', 'free=''E''')// &
         group('gravity', 'g=9.81, direction='''//direction//'''')//nl
   end function strip

   !> Values that are numbers, but not beside the others: each is refused by its own name.
   subroutine test_proportions()
      character(len=*), parameter :: beside = '|out of proportion to the beam, expected at ', &
         beam = 'c_D=0.005', tip = 'm_T=0.15', hose = '5: &hose '
      character(len=*), parameter :: frequency = '|first natural angular frequency|'// &
         'expected 1E-20 to 1E+20: check the units'

      call refused('modulus of 1e300', 'E=80.0', 'E=1e300', &
         '2: &beam E: found 1E+300|expected 1E-40 to 1E+40')
      call refused('length of 1e-200', 'length=4.0', 'length=1e-200', &
         '2: &beam length: found 1E-200|expected 1E-40 to 1E+40')
      call refused('length of 1e200', 'length=4.0', 'length=1e200', &
         '2: &beam length: found 1E+200|expected 1E-40 to 1E+40', 'modes')
      call refused('a frequency beyond any clock', 'length=4.0', 'length=1e-15', &
         '2: &beam length: found 1E-15|E = 80, I = 1, length = 1E-15 and rho = 0.03'//frequency)
      call refused('mass per length of 1e-39', 'rho=0.03', 'rho=3e-40', &
         '2: &beam rho: found 3E-40'//frequency, 'modes')
      call refused('viscosity of 1e100', beam, 'c_D=1e100', '3: &beam c_D: found 1E+100'//beside// &
         'most')
      call refused('air damping of 1e300', beam, beam//', gamma=1e300', &
         '3: &beam gamma: found 1E+300'//beside//'most', 'simulate')
      call refused('a clamp of 1e-300', beam, beam//', k_R=1e-300', &
         '3: &beam k_R: found 1E-300'//beside//'least 2E-12', 'modes')
      call refused('tip mass of 1e75', tip, 'm_T=1e75', '4: &tip m_T: found 1E+75'//beside// &
         'most 1.2E+12', 'modes')
      call refused('hose damping of 1e100', 'c_H=0.004', 'c_H=1e100', &
         hose//'c_H: found 1E+100'//beside//'most', 'modes')
      call refused_case('a sensor at the root', carrying(group('sensor', 'x_S=1e-100')), &
         '5: &sensor x_S: found 1E-100'//beside//'least 4E-09', 'modes')
      call refused_case('a support that does not hold', carrying(group('support', &
         'x_P=2, k_P=1e-200')), '5: &support k_P: found 1E-200'//beside//'least')
      call refused('width of 1e300', 'I=1.0', 'width=1e300, height=1', &
         '2: &beam width: found 1E+300|expected 1E-30 to 1E+30')
      call refused('times of 1e300', 't_first=0.1, t_last=0.6, t_step=0.1', &
         't_first=1e299, t_last=1e300, t_step=1e299', '11: &record t_step: found sample times '// &
         'from 1E+299 to 1E+300|expected times within 1E+40', 'simulate')
   end subroutine test_proportions

   !> One support that is refused.
   subroutine misplaced(what, keys, words)
      character(len=*), intent(in) :: what, keys, words

      call refused_case('support: '//what, carrying(group('support', keys)), '5: &support '//words)
      call refused_case('support: '//what, carrying(group('support', keys)), '5: &support '// &
         words, 'modes')
   end subroutine misplaced

   subroutine test_several_supports()
      character(len=*), parameter :: commands(*) = [character(len=8) :: 'identify', 'simulate', &
         'modes']
      character(len=:), allocatable :: a
      integer :: k

      a = group('support', 'name=''a'', x_P=2')
      call accepted('two supports', 'simulate', carrying(a//group('support', &
         'name=''b'', x_P=3, k_P=10')))
      call accepted('eight supports', 'simulate', replaced(carrying(named('support', 'x_P', 8)), &
         'elements=2', 'elements=16'))
      call refused_case('21 supports', carrying(named('support', 'x_P', 21)), &
         '25: &support name: found 21 groups &support|expected at most 20')
      do k = 1, size(commands)
         call refused_case('eight supports of three functions', carrying(named('support', 'x_P', &
            8)), '12: &support: found 8 rigid ones|at most 2 on a mesh of 2 elements', &
            trim(commands(k)))
         call refused_case('as many supports as functions', carrying(named('support', 'x_P', 3)), &
            '7: &support: found 3 rigid ones|at most 2 on a mesh of 2 elements', trim(commands(k)))
      end do
      call refused_case('two supports without names', carrying(group('support', 'x_P=2')// &
         group('support', 'x_P=3')), &
         '6: &support name: found several groups &support, and one without it|a name for each')
      call refused_case('the same name twice', carrying(a//group('support', &
         'name=''a'', x_P=3')), &
         '6: &support name: found ''a'' twice|expected a name of its own for each')
      call refused_case('two supports at one place', carrying(a//group('support', &
         'name=''b'', x_P=2')), '6: &support x_P: found two supports at 2|one in one place')
      call refused_case('second support beyond the tip', carrying(a//group('support', &
         'name=''b'', x_P=5')), '6: &support x_P: found 5|up to the length 4')
      call refused_case('x_P beside two supports', freeing(carrying(a//group('support', &
         'name=''b'', x_P=3')), '''x_P'''), &
         '14: &stage free: found ''x_P''|expected one of|x_P.a|x_P.b')
   end subroutine test_several_supports

   subroutine test_place_of_force()
      character(len=*), parameter :: place = '6: &excitation x_F: found ', &
         point = '12: &stage free: found ''x_F''|expected a force at a point for it', &
         tip = 'm_T=0.15 /'

      call accepted('force at a place', 'identify', replaced(case_text, pulse, pulse//', x_F=2'))
      call accepted('table at a place', 'simulate', replaced(replaced(case_text, pulse, table), &
         'power=2.0', 'x_F=2'))
      call accepted('release at a place', 'identify', released('displacement=0.1, x_F=2'))
      call accepted('release at a support that gives way', 'identify', replaced(released( &
         'displacement=0.1, x_F=2'), tip, tip//group('support', 'x_P=2, k_P=10')))
      call refused_case('release by displacement at a rigid support', replaced(released( &
         'displacement=0.1, x_F=2'), tip, tip//group('support', 'x_P=2')), 'case.nml: '// &
         '&excitation displacement: found a point that a rigid support holds|expected one that')
      call refused('force at the root', pulse, pulse//', x_F=0', place//'0|above 0')
      call refused('force behind the root', pulse, pulse//', x_F=-1', place//'-1|above 0')
      call refused('force beyond the tip', pulse, pulse//', x_F=4.001', place// &
         '4.001|expected a place above 0, up to the length 4')
      call refused('force beyond the tip', pulse, pulse//', x_F=4.001', place// &
         '4.001|expected a place above 0, up to the length 4', command='modes')
      call refused('place of a distributed force', 'load=''point''', &
         'load=''distributed'', x_F=2', &
         '7: &excitation x_F: found a value|expected none with load = ''distributed''')
      call refused_case('place of a free start', freed('modes=1, x_F=2'), place// &
         'a value|expected none with kind = ''free''')
      call refused_case('x_F free with a distributed force', freeing(replaced(case_text, &
         '''point''', '''distributed'''), '''x_F'''), point)
      call refused_case('x_F free with a free start', replaced(freed('modes=1'), 'free=''m_H''', &
         'free=''x_F'''), point)
      call refused_case('x_F free with a base that moves', freeing(moved(''), '''x_F'''), point)
      call refused_case('free x_F beyond the tip', freeing(case_text, '''x_F'', lower=4'), &
         '12: &stage lower: found 4 for x_F|expected less than the length 4 of the beam')
      call refused_case('free x_F from beyond the tip', freeing(case_text, '''x_F'', start=5'), &
         '12: &stage start: found 5 for x_F|expected at most the length 4 of the beam')
   end subroutine test_place_of_force

   !> The case with a base that moves in place of the force.
   function moved(keys) result(text)
      character(len=*), intent(in) :: keys
      character(len=:), allocatable :: text

      text = replaced(released(keys), 'kind=''release'', ', 'kind=''base'', file=''force.csv'' ')
   end function moved

   subroutine test_moved_base()
      character(len=*), parameter :: delta = 'delta=0.1', others(*) = [character(len=14) :: &
         'amplitude=1', 'duration=1', 'load=''point''', 'power=2', 'force=1', 'displacement=1', &
         'time=0', 'modes=2', 'x_F=2']
      integer :: k

      call accepted('a base that moves', 'identify', moved(''))
      call accepted('a base that moves', 'simulate', moved(''))
      call accepted('seen from the base', 'simulate', replaced(moved(''), delta, &
         delta//', frame=''relative'''))
      do k = 1, size(others)
         call refused_case('base with '//trim(others(k)), moved(trim(others(k))), &
            '6: &excitation '//others(k)(:index(others(k), '=') - 1)// &
            ': found a value|expected none with kind = ''base''')
      end do
      call refused_case('base without a file', replaced(moved(''), 'file=''force.csv''', ''), &
         '6: &excitation file: found nothing|expected')
      call refused_case('base with an empty file', replaced(moved(''), 'force.csv', ''), &
         '6: &excitation file: found ''''|expected the path of a file')
      call refused_case('base with no such file', replaced(moved(''), 'force.csv', 'none.csv'), &
         'none.csv: found no such file|expected')
      call refused('frame without a base that moves', delta, delta//', frame=''relative''', &
         '10: &observation frame: found ''relative'' without a base that moves|'// &
         'expected ''absolute'', or kind = ''base'' in &excitation')
      call refused('unknown frame', delta, delta//', frame=''sideways''', &
         '10: &observation frame: found ''sideways''|expected ''absolute'' or ''relative''')
   end subroutine test_moved_base

   !> A beam of free length reaches what sits on it.
   subroutine test_free_length()
      character(len=:), allocatable :: text

      text = carrying(group('sensor', 'x_S=2'))
      call accepted('length', 'identify', freeing(text, '''length'', start=3.9, lower=3, upper=5'))
      call refused_case('length up to less than the sensor''s place', freeing(text, &
         '''length'', upper=1'), '13: &stage upper: found 1 for length|expected more than 2')
      call refused_case('length from less than the sensor''s place', freeing(text, &
         '''length'', start=1'), '13: &stage start: found 1 for length|expected at least 2')
      call refused_case('length up to less than the place of the force', freeing(replaced( &
         case_text, pulse, pulse//', x_F=3'), '''length'', upper=2.5'), &
         '12: &stage upper: found 2.5 for length|expected more than 3')
   end subroutine test_free_length

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
      call refused_case('parameter three times', freeing(case_text, '''m_H'',''m_H'',''M_h'''), &
         place//'free: found ''m_H'' twice|expected each parameter once')
      call refused('unknown parameter twice', both, '''k_X'',''k_X''', place// &
         'free: found ''k_X''|expected one of m_T E c_D')
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

   !> What is known beside the record, and of the section.
   subroutine test_priors()
      character(len=:), allocatable :: rectangle, dense

      rectangle = replaced(case_text, 'I=1.0', 'width=12, height=1')
      dense = replaced(rectangle, 'rho=0.03', 'density=0.0025')
      call accepted('prior of a held one', 'identify', carrying(group('prior', &
         'parameter=''length'', sd=0.1')))
      call accepted('prior of a free one', 'identify', carrying(group('prior', &
         'parameter=''M_H'', sd=0.01, value=0.05')))
      call accepted('prior of I', 'identify', carrying(group('prior', 'parameter=''I'', sd=0.1')))
      call accepted('prior of a height', 'identify', rectangle//group('prior', &
         'parameter=''height'', sd=0.01')//nl)
      call accepted('density', 'identify', dense//group('prior', &
         'parameter=''density'', sd=0.0001')//group('prior', 'parameter=''width'', sd=0.1')//nl)
      call accepted('windows need samples', 'identify', carrying(group('windows', 'n=2')))
      call accepted('noise of the record', 'identify', replaced(case_text, 't_step=0.1', &
         't_step=0.1, sd=0.2'))
      call refused_case('prior of nothing', carrying(group('prior', 'sd=0.1')), &
         '5: &prior parameter: found nothing|expected')
      call refused_case('prior without sd', carrying(group('prior', 'parameter=''length''')), &
         '5: &prior sd: found nothing|expected')
      call refused_case('prior of sd 0', carrying(group('prior', 'parameter=''length'', sd=0')), &
         '5: &prior sd: found 0|expected a value above 0')
      call refused_case('prior of an unknown one', carrying(group('prior', &
         'parameter=''lenght'', sd=0.1')), '5: &prior parameter: found ''lenght''|expected one of')
      call refused_case('prior of a height that is not there', carrying(group('prior', &
         'parameter=''height'', sd=0.1')), '5: &prior parameter: found ''height''|expected one of')
      call refused_case('prior of the offset', carrying(group('prior', &
         'parameter=''offset'', sd=0.1')), '5: &prior parameter: found ''offset''|expected one of')
      call refused_case('prior of another record', carrying(group('prior', &
         'parameter=''length'', sd=0.1, record=2')), '5: &prior record: found 2|expected')
      call refused_case('prior twice', carrying(group('prior', 'parameter=''E'', sd=1')// &
         group('prior', 'parameter=''e'', sd=2')), &
         '6: &prior parameter: found ''e'' twice|expected')
      call refused_case('prior of a damper of no clamp', carrying(group('prior', &
         'parameter=''c_R'', sd=1')), '5: &prior parameter: found ''c_R''|expected a value of k_R')
      call refused_case('value of a height', rectangle//group('prior', &
         'parameter=''height'', sd=0.01, value=2')//nl, '&prior value: found 2|expected none')
      call refused_case('rho and density', replaced(dense, 'c_D=0.005', 'c_D=0.005, rho=1'), &
         '&beam rho: found both rho and density|expected either')
      call refused_case('density without a section', replaced(dense, 'width=12, height=1', &
         'I=1'), '&beam density: found 0.0025|expected width and height beside density')
      call refused_case('no mass', replaced(case_text, ' rho=0.03,', ''), &
         '&beam rho: found no mass|expected either rho or')
      call refused_case('one window', carrying(group('windows', 'n=1')), &
         '5: &windows n: found 1|expected')
      call refused_case('elements in words', replaced(case_text, 'elements=2', &
         'elements=''many'''), '&discretization elements: found the text ''many''|expected')
   end subroutine test_priors

   !> Channels of one motion.
   subroutine test_channels()
      character(len=*), parameter :: line = &
         'file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1'
      character(len=:), allocatable :: two, again

      again = nl//'&record '//line//', experiment=1'
      two = replaced(case_text, line//' /', line//', experiment=1 /'//again//' /')
      call accepted('channels', 'identify', two)
      call refused_case('channel of number 0', replaced(case_text, line, line//', experiment=0'), &
         '&record experiment: found 0|expected')
      call refused_case('channels of two beams', replaced(two, again, again//', length=5'), &
         '&record experiment: found 1 with another beam than record 1|expected the same beam')
      call refused_case('channels far apart', replaced(two, again, nl//'&record '//line//' /'// &
         again), '&record experiment: found 1 again|expected the records of one experiment')
      call refused_case('channels that share not all', replaced(two, 'free=''m_H'',''k_H''', &
         'free=''m_H'',''k_H'', shared=''k_H'''), '&stage shared: found parameters that are not')
   end subroutine test_channels

end program test_bad_models
