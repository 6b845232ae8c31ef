!> Checks of a case against its record before the fit: units, sampling, a quiet lead-in. The record
!> is a sum of decaying cosines with the frequencies of a steel ruler, which independent finite
!> elements gave.
program test_input_checks
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_onsets, only: onset
   use beamid_strings, only: to_text
   use case_answers, only: nl, ruler
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, replaced, run, &
      unwrapped, write_file
   implicit none

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
   !> Natural frequencies [Hz], damping ratios and amplitudes [m/s^2] of the first three modes.
   real(wp), parameter :: frequency(3) = [8.0639_wp, 53.9633_wp, 156.139_wp], &
      ratio(3) = [3e-3_wp, 2e-3_wp, 4e-3_wp], size_of(3) = [20.0_wp, 6.0_wp, 1.0_wp]
   integer, parameter :: m = 1200
   character(len=:), allocatable :: reason

   call test_onsets()
   call open_shell(reason)
   if (reason /= '') then
      call skip('input checks', reason)
   else
      call write_record(0.002_wp, 0)
      call test_units()
      call test_guesses()
      call test_columns()
      call test_stamps()
      call test_lead_in()
      call test_causes()
      call test_noise()
      call test_modes_without_elements()
      call test_unresolved_mesh()
      call test_errors_left_out()
      call test_modes_on_meshes()
      call test_quiet_sensor()
      call close_shell()
   end if
   call finish('input_checks')

contains

   !> The decay at time t after the release, 0 before it.
   elemental real(wp) function decay(t)
      real(wp), intent(in) :: t

      decay = 0
      if (t >= 0) decay = sum(size_of*exp(-two_pi*ratio*frequency*t)*cos(two_pi*frequency*t))
   end function decay

   !> Writes record.csv with noise of .03 and an offset of .35 m/s^2.
   !>
   !> unit    what a step of .002 s is written as
   !> quiet   samples before the release
   subroutine write_record(unit, quiet)
      real(wp), intent(in) :: unit
      integer, intent(in) :: quiet
      character(len=:), allocatable :: text
      real(wp) :: noise(m + quiet)
      integer :: k

      noise = gaussian_noise(m + quiet, 0.03_wp, 7)
      text = 't,a'//nl
      do k = 1, m + quiet
         text = text//to_text(k*unit)//','// &
            to_text(decay((k - quiet)*0.002_wp) + 0.35_wp + noise(k))//nl
      end do
      call write_file('record.csv', text)
   end subroutine write_record

   !> One value in another unit: exit status 2 and one line that names the key and the unit.
   subroutine test_units()
      call refused('E in GPa', 'E=2.0e11', 'E=200', '&beam E: found 200, which looks like GPa')
      call refused('E in MPa', 'E=2.0e11', 'E=2e5', '&beam E: found 200000, which looks like MPa')
      call refused('length in mm', 'length=0.3,', 'length=300,', &
         '&beam length: found 300, which looks like mm')
      call refused('all lengths in mm', 'length=0.3, width=0.025, height=0.001', &
         'length=300, width=25, height=1', '&beam length: found 300, which looks like mm')
      call refused('all lengths in cm', 'length=0.3, width=0.025, height=0.001', &
         'length=30, width=2.5, height=0.1', '&beam length: found 30, which looks like cm')
      call refused('width in mm', 'width=0.025', 'width=25', &
         '&beam width: found 25, which looks like mm')
      call refused('section in mm', 'width=0.025, height=0.001', 'width=25, height=1', &
         '&beam height: found 1, which looks like mm')
      call refused('height in mm', 'height=0.001', 'height=1', &
         '&beam height: found 1, which looks like mm')
      call refused('inconsistent labels', 'length=''m''', 'length=''mm''', &
         '&units force: found ''N'', expected a consistent unit')
      call accepted('consistent labels', 'length=''m'', force=''N'', time=''s'', mass=''kg''', &
         'length=''mm'', force=''N'', time=''s'', mass=''t''')
      call refused('density in g/cm^3', 'density=7850', 'density=7.85', &
         '&beam density: found 7.85, which looks like g/cm^3')
      call refused('mass in g', 'm_S=0.005', 'm_S=5', '&sensor m_S: found 5, which looks like g')
   end subroutine test_units

   subroutine refused(what, old, new, expected)
      character(len=*), intent(in) :: what, old, new, expected
      type(outcome_t) :: outcome

      call write_file('case.nml', ruler)
      if (old /= '') call write_file('case.nml', replaced(ruler, old, new))
      outcome = beamid('identify case.nml --quiet --out refused')
      call check(what//': status 2', outcome%status == 2, outcome%err)
      call check(what//': named', index(outcome%err, expected) > 0 .and. &
         index(outcome%err, nl) == len(outcome%err), outcome%err)
   end subroutine refused

   !> Guesses that are wrong, but in the right unit, are no errors of units.
   subroutine test_guesses()
      call accepted('the truth', '', '')
      call accepted('E 30 % too small', 'E=2.0e11', 'E=1.4e11')
      call accepted('E 30 % too large', 'E=2.0e11', 'E=2.6e11')
      call accepted('a third of the mass', 'm_S=0.005', 'm_S=0.0017')
      call accepted('three times the mass', 'm_S=0.005', 'm_S=0.015')
      call accepted('aluminium', 'density=7850, E=2.0e11', 'density=2700, E=7e10')
      call accepted('no labels', 'length=''m'', force=''N'', time=''s'', mass=''kg''', '')
   end subroutine test_guesses

   subroutine accepted(what, old, new)
      character(len=*), intent(in) :: what, old, new
      type(outcome_t) :: outcome

      call write_file('case.nml', ruler)
      if (old /= '') call write_file('case.nml', replaced(ruler, old, new))
      outcome = beamid('identify case.nml --quiet --out accepted')
      call check(what//': no error of units', outcome%status /= 2, outcome%err)
   end subroutine accepted

   !> A column in g without a scale: a free decay gives the same parameters and says so; with a
   !> known release or noise, it is refused.
   subroutine test_columns()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: text, plain

      call write_file('case.nml', ruler)
      outcome = beamid('identify case.nml --quiet --out plain')
      plain = read_file('plain/estimates.csv')
      text = read_file('record.csv')
      call write_file('record.csv', replaced(text, 't,a'//nl, 'Time (s),Acceleration z (g)'//nl))
      outcome = beamid('identify case.nml --quiet --out columns')
      call check('a free decay in g: fitted, as without a unit', outcome%status == 0 .and. &
         plain /= '' .and. read_file('columns/estimates.csv') == plain, outcome%err)
      call check('a free decay in g: said', index(outcome%out, 'the column is in g, but scale'// &
         ' = 1 (expected 9.80665)') > 0, outcome%out(:min(300, len(outcome%out))))
      call refused('a known noise in g', 'record.csv''', 'record.csv'', sd=0.03', &
         '&record scale: found 1 for a column in g (''Acceleration z (g)''), expected 9.80665')
      call refused('a known release in g', 'kind=''free'', modes=3', &
         'kind=''release'', displacement=0.01', '&record scale: found 1 for a column in g')
      call write_file('record.csv', replaced(text, 't,a'//nl, 'Time (ms),a (m/s^2)'//nl))
      call refused('a column in ms', '', '', 'found times in ms, expected s, as &units says')
      call write_file('record.csv', text)
   end subroutine test_columns

   !> Time stamps in milliseconds, or sample numbers.
   subroutine test_stamps()
      type(outcome_t) :: outcome

      call write_file('case.nml', ruler)
      call write_record(2.0_wp, 0)
      outcome = beamid('identify case.nml --quiet --out refused')
      call check('milliseconds: status 2', outcome%status == 2, outcome%err)
      call check('milliseconds: named', &
         index(outcome%err, 'found a Nyquist frequency of 0.25') > 0 .and. &
         index(outcome%err, 'look like milliseconds') > 0, outcome%err)
      call write_record(1.0_wp, 0)
      outcome = beamid('identify case.nml --quiet --out refused')
      call check('sample numbers: named', outcome%status == 2 .and. &
         index(outcome%err, 'look like sample numbers') > 0, outcome%err)
      ! Every second sample: mode 3 at 156 Hz looks like 250 - 156 = 94 Hz.
      call write_record(0.002_wp, 0)
      outcome = run('awk "NR == 1 || NR%2 == 0" record.csv > half.csv')
      call write_file('case.nml', replaced(ruler, 'record.csv', 'half.csv'))
      outcome = beamid('identify case.nml --quiet --out half')
      call check('a mode above the Nyquist frequency: where it appears', index(unwrapped( &
         outcome%out), ') lies above the Nyquist frequency 125 Hz; its samples look like 9') > 0, &
         outcome%out//outcome%err)
   end subroutine test_stamps

   !> Two seconds of quiet before the release: left out unless the case gives t_first.
   subroutine test_lead_in()
      type(outcome_t) :: outcome

      call write_record(0.002_wp, 1000)
      call write_file('case.nml', ruler)
      outcome = beamid('identify case.nml --quiet --out quiet')
      call check('a lead-in: fitted', outcome%status == 0, outcome%err)
      call check('a lead-in: left out, and said', index(outcome%out, 'the motion begins at 2') > 0 &
         .and. index(outcome%out, 'left out') > 0, outcome%out(:min(300, len(outcome%out))))
      call write_file('case.nml', replaced(ruler, 'record.csv''', 'record.csv'', t_first=1.9'))
      outcome = beamid('identify case.nml --quiet --out quiet')
      call check('a lead-in in the window: a warning', outcome%status == 0 .and. &
         index(outcome%out, 'warning: the motion begins at 2') == 1, &
         outcome%out(:min(300, len(outcome%out))))
      ! A window that is half empty: the fit is rejected.
      call write_file('case.nml', replaced(ruler, 'record.csv''', 'record.csv'', t_first=0.5'))
      outcome = beamid('identify case.nml --quiet --out quiet')
      call check('a long lead-in in the window: rejected, and why', outcome%status == 1 .and. &
         index(outcome%err, 'the motion begins at 2') > 0, outcome%err)
      call write_record(0.002_wp, 0)
   end subroutine test_lead_in

   !> Causes that a failed fit names: half the time step, for which the search ends outside of its
   !> ranges, and an offset that is most of the record.
   subroutine test_causes()
      type(outcome_t) :: outcome

      call write_record(0.001_wp, 0)
      call failed('half the time step', ruler, 'check rate or the time stamps')
      call write_record(0.002_wp, 0)
      ! 40 m/s^2 are twice the amplitude of the record.
      call write_file('case.nml', replaced(replaced(ruler, ',''offset''', ''), 'record.csv''', &
         'record.csv'', offset=-40'))
      outcome = beamid('identify case.nml --quiet --out failed')
      call check('an offset of 40: named', outcome%status == 1 .and. &
         index(outcome%err, 'add ''offset'' to free') > 0, outcome%err)
   end subroutine test_causes

   !> A fit that fails: exit status 1, and one line that names the cause.
   subroutine failed(what, case, expected)
      character(len=*), intent(in) :: what, case, expected
      type(outcome_t) :: outcome

      call write_file('case.nml', case)
      outcome = beamid('identify case.nml --quiet --out failed')
      call check(what//': named', outcome%status == 1 .and. index(outcome%err, expected) > 0 .and. &
         index(outcome%err, nl) == len(outcome%err), outcome%err)
   end subroutine failed

   !> A record with so little noise that it shows the error of the mesh. A finer mesh removes
   !> what is left, so that no parameter is missing.
   subroutine test_quiet_sensor()
      character(len=*), parameter :: beam = &
         '&beam length=0.523, width=0.035, height=0.0018, density=7850, E=1.984e11, '// &
         'c_D=4.85e6, gamma=0.0435 /'//nl//'&sensor m_S=0.0089, x_S=0.462 /'//nl, &
         fine = '&discretization degree=5, elements=24 /'//nl
      type(outcome_t) :: outcome

      call write_file('quiet.nml', beam//fine// &
         '&excitation kind=''release'', displacement=0.02 /'//nl// &
         '&record t_first=0.3, t_last=11, t_step=0.002 /'//nl//'&noise sd=0.005, seed=3 /'//nl)
      outcome = beamid('simulate quiet.nml --quiet --out quiet')
      call check('a quiet sensor: simulated', outcome%status == 0, outcome%err)
      call write_file('case.nml', beam//'&excitation kind=''free'', modes=3 /'//nl// &
         '&record file=''quiet/record.csv'', value_column=''acceleration'' /'//nl// &
         '&stage free=''E'',''m_S'',''c_D'',''gamma'' /'//nl//'&discretization elements=8 /'//nl)
      outcome = beamid('identify case.nml --quiet --out fitted')
      call check('a quiet sensor: the mesh is named, and no parameter', outcome%status == 0 .and. &
         index(outcome%out, 'warning: mesh: ') > 0 .and. &
         index(outcome%out, 'which the model leaves out') == 0, &
         outcome%err//outcome%out(:min(900, len(outcome%out))))
   end subroutine test_quiet_sensor

   !> A record of white noise, as that of a wrong column: refused, and the likely cause is named. Of
   !> 1,000 such records, one may show a peak; the seed is one of the 999.
   subroutine test_noise()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: text
      real(wp) :: noise(m)
      integer :: k

      noise = gaussian_noise(m, 0.03_wp, 11)
      text = 't,a'//nl
      do k = 1, m
         text = text//to_text(k*0.002_wp)//','//to_text(noise(k))//nl
      end do
      call write_file('record.csv', text)
      call write_file('case.nml', ruler)
      outcome = beamid('identify case.nml --quiet --out noise')
      call check('noise: status 2', outcome%status == 2, outcome%err)
      call check('noise: the column is named', index(outcome%err, 'no spectral line above the '// &
         'noise') > 0 .and. index(outcome%err, 'value_column') > 0, outcome%err)
      call check('noise: no output', read_file('noise/estimates.csv') == '')
   end subroutine test_noise

   !> Without `elements`, modes refines the mesh: mode 10 of the ruler without sensor has
   !> (19 pi/2)**2 = 890.7317973 for (k l)**2 to ten digits. With 8 elements it was 7 times as high.
   subroutine test_modes_without_elements()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: line, text
      real(wp) :: expected, found
      integer :: at, first, ios

      call write_file('modes.nml', '&beam length=0.3, width=0.025, height=0.001, '// &
         'density=7850, E=2.0e11 /'//nl)
      outcome = beamid('modes modes.nml --quiet --out modes')
      call check('modes: status 0', outcome%status == 0, outcome%err)
      text = read_file('modes/modes.csv')
      at = index(text, ',10,')
      found = 0
      if (at > 0) then
         first = at + 4
         line = text(first:first + index(text(first:), ',') - 2)
         read (line, *, iostat=ios) found
      end if
      expected = 890.7317973_wp/0.3_wp**2*sqrt(2e11_wp*0.001_wp**2/12/7850)/two_pi
      ! The mesh has converged to 1e-4, and with an error of fourth order to a fifteenth of that.
      call check('modes: the tenth frequency', abs(found/expected - 1) < 1e-5_wp, to_text(found))
      call check('modes: ten modes', index(text, ',11,') == 0, text)
   end subroutine test_modes_without_elements

   !> A beam whose last 2 cm are a millionth as stiff: 128 elements do not determine its tenth mode,
   !> and `modes` and `frf`, which refine the mesh for natural frequencies, say so.
   subroutine test_unresolved_mesh()
      character(len=*), parameter :: soft_end = '&beam length=0.3, width=0.025, height=0.001, '// &
         'density=7850, E=2.0e11 /'//nl//'&along kind=''steps'', parameter=''E'', '// &
         'x=0,0.2803, value=2e11,2e5 /'//nl, &
         response = '&record kind=''frf'', f_first=1, f_last=5, f_step=1, x_F=0.1 /'//nl
      type(outcome_t) :: outcome
      character(len=*), parameter :: commands(2) = [character(len=5) :: 'modes', 'frf']
      integer :: k

      call write_file('soft.nml', soft_end//response)
      do k = 1, 2
         outcome = beamid(trim(commands(k))//' soft.nml --quiet --out soft')
         call check(trim(commands(k))//': the mesh is not fine enough', outcome%status == 0 .and. &
            index(outcome%out, 'warning: mesh: the last refinement') == 1, outcome%out)
      end do
   end subroutine test_unresolved_mesh

   !> Profiles leave out the errors of fixed parameters, and say so.
   subroutine test_errors_left_out()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: text

      call write_record(0.002_wp, 0)
      call write_file('case.nml', ruler//'&prior parameter=''height'', sd=1e-5 /'//nl)
      outcome = beamid('profile case.nml --quiet --out profile')
      call check('profile: errors left out are named', index(outcome%out, &
         'do not include the errors of fixed parameters (height)') > 0, outcome%out)
      call write_file('case.nml', ruler)
      outcome = beamid('profile case.nml --quiet --out profile')
      text = outcome%out
      call check('profile: no fixed parameter has a prior', index(text, 'do not include') == 0, &
         text)
   end subroutine test_errors_left_out

   !> Intervals of the modes of a fit include the error of the mesh: on meshes of 4 and 8 elements,
   !> they hold the frequencies that a fit with 32 elements finds. With 4 elements, those of modes 3
   !> to 5 differ by more than ten times their intervals by noise, those with 32 elements.
   subroutine test_modes_on_meshes()
      integer, parameter :: elements(3) = [32, 8, 4]
      type(outcome_t) :: outcome
      character(len=:), allocatable :: text
      real(wp) :: row(7), frequencies(5, 3), half_widths(5, 3)
      integer :: at, ios, j, k

      call write_record(0.002_wp, 0)
      do j = 1, size(elements)
         call write_file('case.nml', ruler//'&discretization elements='//to_text(elements(j))// &
            ' /'//nl)
         outcome = beamid('identify case.nml --quiet --out mesh')
         text = read_file('mesh/modes.csv')
         do k = 1, size(frequencies, 1)
            row = 0
            at = index(text, nl//to_text(elements(j))//','//to_text(k)//',')
            ! Frequency, damping ratio, root, record, and the interval of the frequency.
            if (at > 0) read (text(at + 4 + len(to_text(elements(j))):), *, iostat=ios) row
            frequencies(k, j) = row(1)
            half_widths(k, j) = row(1) - row(6)
            if (j == 1) cycle
            call check(to_text(elements(j))//' elements: the interval of mode '//to_text(k)// &
               ' holds its frequency', half_widths(k, j) > 0 .and. &
               abs(frequencies(k, j) - frequencies(k, 1)) < half_widths(k, j), &
               to_text(frequencies(k, j))//' +- '//to_text(half_widths(k, j)))
         end do
      end do
      call check('4 elements: noise is not the error', all(abs(frequencies(3:, 3) - &
         frequencies(3:, 1)) > 10*half_widths(3:, 1)))
   end subroutine test_modes_on_meshes

   !> 200 free decays without a lead-in at random begin at once. With a lead-in of a tenth to nine
   !> tenths of the record the onset is found within 10 ms, a period of the second mode.
   subroutine test_onsets()
      integer, parameter :: n = 2000
      real(wp) :: noise(n), t(n), z(n)
      integer :: begin, k, late, wrong

      wrong = 0
      late = 0
      do k = 1, 200
         noise = gaussian_noise(n, 0.1_wp, k)
         t = 0.002_wp*[(begin, begin=0, n - 1)]
         z = decay(t + 0.01_wp*k) + noise
         if (onset(z) /= 1) wrong = wrong + 1
         begin = 200 + 8*k
         z = decay(t - t(begin)) + noise + 9.81_wp
         if (abs(t(onset(z)) - t(begin)) > 0.01_wp) late = late + 1
      end do
      call check('free decays begin at once', wrong == 0, to_text(wrong)//' of 200')
      call check('a motion after quiet is found', late == 0, to_text(late)//' of 200')
   end subroutine test_onsets

end program test_input_checks
