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
   use shell, only: beamid, close_shell, open_shell, outcome_t, read_file, replaced, write_file
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
      call refused('section in mm', 'width=0.025, height=0.001', 'width=25, height=1', &
         '&beam height: found 1, which looks like mm')
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
      call write_file('case.nml', replaced(ruler, 'record.csv''', 'record.csv'', t_first=0.5'))
      outcome = beamid('identify case.nml --quiet --out quiet')
      call check('a lead-in in the window: a warning', &
         index(outcome%out, 'warning: the motion begins at 2') > 0, &
         outcome%out(:min(300, len(outcome%out))))
   end subroutine test_lead_in

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
