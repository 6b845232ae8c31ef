!> Errors of the case or of the file in fits to frequency responses and tables of modes, by the
!> program: they are named, or no wrong value counts as determined.
program test_frequency_errors
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: to_text
   use case_answers, only: answer_t, check_refused, identified, nl
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, line_count, open_shell, outcome_t, read_file, replaced, &
      write_file
   use tables, only: field, number
   implicit none

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
   character(len=*), parameter :: true_beam = &
      '&beam length=0.5, width=0.03, height=0.003, density=2700, E=7e10, c_D=2e6, gamma=0.05 /'// &
      nl//'&sensor m_S=0.005, x_S=0.4 /'//nl//'&units length=''m'', force=''N'', time=''s'', '// &
      'mass=''kg'' /'//nl
   character(len=*), parameter :: record = '&record kind=''frf'', x_F=0.3, file=''r.csv'' /'//nl, &
      three = '&stage free=''E'',''c_D'',''gamma'' /'//nl, &
      fine = '&discretization degree=5, elements=16 /'//nl
   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('fits', reason)
   else
      call test_right()
      call test_model()
      call test_calibration()
      call test_units()
      call test_tables()
      call close_shell()
   end if
   call finish('frequency_errors')

contains

   !> Writes r.csv: the response of a beam with noise of a stated size.
   !>
   !> scale  factor of the response
   !> unit   number of units of frequency in 1 Hz
   !> seed   of the noise
   subroutine write_response(beam, scale, unit, seed)
      character(len=*), intent(in) :: beam
      real(wp), intent(in) :: scale, unit
      integer, intent(in) :: seed
      real(wp), parameter :: sd = 0.02_wp
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table, text
      character(len=120) :: row
      real(wp) :: noise(2)
      integer :: k

      call write_file('truth.nml', beam//fine//'&record kind=''frf'', x_F=0.3, f_first=4, '// &
         'f_last=300, f_step=0.5 /'//nl)
      outcome = beamid('frf truth.nml --quiet --out truth')
      call check('a response', outcome%status == 0, outcome%err)
      table = read_file('truth/frf.csv')
      text = 'frequency_hz,real,imag,sd'//nl
      do k = 1, line_count(table) - 1
         noise = gaussian_noise(2, sd, 10000*seed + k)
         write (row, '(es23.16, 3(a, es23.16))') unit*number(field(table, k, 2)), ',', &
            scale*number(field(table, k, 3)) + noise(1), ',', &
            scale*number(field(table, k, 4)) + noise(2), ',', sd
         text = text//trim(row)//nl
      end do
      call write_file('r.csv', text)
   end subroutine write_response

   !> Returns the case of a fit from values that are wrong by some percent.
   function case_of(beam) result(text)
      character(len=*), intent(in) :: beam
      character(len=:), allocatable :: text

      text = replaced(replaced(beam, 'E=7e10', 'E=7.3e10'), 'c_D=2e6', 'c_D=1.7e6')//record// &
         three//fine
   end function case_of

   !> Returns whether a fit is rejected, or each parameter that counts as determined has its true
   !> value in the total interval.
   logical function is_honest(answer)
      type(answer_t), intent(in) :: answer

      is_honest = answer%is_honest([character(len=5) :: 'E', 'c_D', 'gamma'], [7e10_wp, 2e6_wp, &
         0.05_wp]) .or. answer%status == 1 .and. index(answer%err, 'no fit: ') > 0
   end function is_honest

   !> Without an error, the resonances do not disagree: the intervals stay as narrow as the noise.
   subroutine test_right()
      integer, parameter :: trials = 10
      type(answer_t) :: answer
      integer :: accused, k, narrow

      accused = 0
      narrow = 0
      do k = 1, trials
         call write_response(true_beam, 1.0_wp, 1.0_wp, k)
         answer = identified(case_of(true_beam))
         call check('a right case '//to_text(k), answer%status == 0 .and. answer%is_determined('E'))
         if (index(answer%out, 'resonances of the record disagree') == 0) narrow = narrow + 1
         if (answer%test_matters('scale') .or. answer%test_matters('delay')) accused = accused + 1
      end do
      ! A parameter is disputed by chance in 5 % of the fits. Of ten fits, three or more are so with
      ! a probability of 1 %.
      call check('most right cases are undisputed', narrow > trials - 3, to_text(narrow))
      ! All score tests of a fit together accuse 1 %.
      call check('right scales and times are not accused', accused <= 1, to_text(accused))
   end subroutine test_right

   !> The beam is another one than the case says. Three resonances are in the record, which cannot
   !> all be explained.
   subroutine test_model()
      character(len=*), parameter :: wrong(*) = [character(len=40) :: 'x_S=0.42', 'm_S=0', &
         'm_S=0.01']
      type(answer_t) :: answer
      integer :: disputed, k, seed

      disputed = 0
      do k = 1, size(wrong)
         do seed = 1, 2
            call write_response(true_beam, 1.0_wp, 1.0_wp, 100*k + seed)
            answer = identified(case_of(replaced(true_beam, trim(merge('x_S=0.4  ', &
               'm_S=0.005', k == 1)), trim(wrong(k)))))
            call check('another '//trim(wrong(k)), is_honest(answer), answer%out//answer%err)
            if (index(answer%out, 'the resonances of the record disagree') > 0) &
               disputed = disputed + 1
         end do
      end do
      call check('resonances disagree', disputed > 0)
      call write_response(true_beam//'&mass m=0.012, x=0.25 /'//nl, 1.0_wp, 1.0_wp, 7)
      answer = identified(case_of(true_beam))
      call check('a mass that the case leaves out', is_honest(answer), answer%out)
      call write_response(replaced(true_beam, 'gamma=0.05', 'gamma=0.05, k_R=200'), 1.0_wp, &
         1.0_wp, 8)
      answer = identified(case_of(true_beam))
      call check('a soft clamp', is_honest(answer) .and. index(answer%head, 'k_R') > 0, answer%out)
   end subroutine test_model

   !> A force that is 10 % too large makes the damping too high; height and width of the resonances
   !> contradict each other.
   subroutine test_calibration()
      type(answer_t) :: answer

      call write_response(true_beam, 0.9_wp, 1.0_wp, 9)
      answer = identified(case_of(true_beam))
      call check('a wrong calibration', is_honest(answer) .and. index(answer%head, &
         'contradicts the scale') > 0, answer%out)
   end subroutine test_calibration

   !> Frequencies in rad/s lie near those of the next mode of a cantilever.
   subroutine test_units()
      call write_response(replaced(true_beam, 'm_S=0.005', 'm_S=0'), 1.0_wp, two_pi, 10)
      call check_refused('rad/s', 2, 'identify', replaced(case_of(replaced(true_beam, 'm_S=0.005', &
         'm_S=0')), 'file=''r.csv''', 'file=''r.csv'', f_last=800'), 'look like rad/s')
   end subroutine test_units

   !> Tables of modes: of a soft clamp, in percent, with a high mode, and with a mode left out.
   subroutine test_tables()
      character(len=*), parameter :: header = 'mode,frequency_hz,sd_hz,damping_ratio,sd_damping'//nl
      type(outcome_t) :: outcome
      type(answer_t) :: answer
      character(len=:), allocatable :: in_percent, left_out, light, modes, table, table_case
      real(wp) :: f, zeta
      integer :: k

      table_case = replaced(replaced(case_of(true_beam), fine, ''), 'kind=''frf'', x_F=0.3', &
         'kind=''modes''')
      call write_file('truth.nml', replaced(true_beam, 'gamma=0.05', 'gamma=0.05, k_R=200'))
      outcome = beamid('modes truth.nml --quiet --out truth')
      call check('modes', outcome%status == 0, outcome%err)
      table = read_file('truth/modes.csv')
      modes = header
      in_percent = header
      light = header
      left_out = header
      do k = 1, 6
         f = number(field(table, k, 3))
         zeta = number(field(table, k, 4))
         call add(modes, k, f, zeta)
         if (k <= 2) call add(in_percent, k, f, 100*zeta)
         if (k <= 2) call add(light, k, f, 100*zeta/10)
         if (k == 1) call add(left_out, 1, f, zeta)
         if (k == 3) call add(left_out, 2, f, zeta)
      end do
      call write_file('r.csv', modes)
      answer = identified(table_case)
      call check('six modes without elements', answer%status == 0, answer%err)
      call check('modes of a soft clamp', is_honest(answer) .and. index(answer%head, 'k_R') > 0, &
         answer%out)
      call write_file('r.csv', in_percent)
      call check_refused('percent', 2, 'identify', table_case, 'look like percent')
      call write_file('r.csv', light)
      call check_refused('percent of light damping', 2, 'identify', replaced(table_case, &
         'c_D=1.7e6, gamma=0.05', 'c_D=1.7e5, gamma=0.005'), 'look like percent')
      call write_file('r.csv', in_percent)
      call check_refused('percent, time hysteresis', 2, 'identify', replaced(table_case, &
         'c_D=1.7e6, gamma=0.05', 'd_1=0.01, b_1=300'), 'look like percent')
      call write_file('r.csv', left_out)
      answer = identified(replaced(table_case, '''gamma'' /', &
         '''gamma'',''m_S'' /'))
      call check('a mode left out', is_honest(answer), answer%out)
   end subroutine test_tables

   !> Adds a row to a table of modes.
   subroutine add(table, mode, f, zeta)
      character(len=:), allocatable, intent(inout) :: table
      integer, intent(in) :: mode
      real(wp), intent(in) :: f, zeta
      character(len=120) :: row

      write (row, '(i0, 4(a, es23.16))') mode, ',', f, ',', 5e-4_wp*f, ',', zeta, ',', 0.03_wp*zeta
      table = table//trim(row)//nl
   end subroutine add

end program test_frequency_errors
