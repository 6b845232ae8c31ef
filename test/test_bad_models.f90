!> Bad models, one row each: what a case says of beam, force, mesh, integrator, observation, stages
!> and noise.
program test_bad_models
   use bad_cases, only: accepted, case_text, nl, pulse, refused, refused_case, table
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
      call test_stage()
      call test_noise()
      call close_shell()
   end if
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

end program test_bad_models
