!> `compare --damping`, through the program: tables of modes with damping ratios by closed forms and
!> by mpmath, damping ratios that frequency responses and free decays show by themselves, damping
!> ratios alone, limits of mechanisms, and cases that are refused.
program test_damping_models
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: full, to_text
   use case_answers, only: check_refused, identified, answer_t, nl
   use checks, only: check, check_close, finish, in_long_run, skip
   use shell, only: beamid, close_shell, has_all, in_root, line_count, open_shell, outcome_t, &
      read_file, replaced, unwrapped, write_file
   use tables, only: field, line, number
   implicit none

   !> A cantilever without damping, E I = 1.3, rho = .7, l = 1.1.
   real(wp), parameter :: rho = 0.7_wp, bending = 1.3_wp, length = 1.1_wp
   character(len=*), parameter :: beam = '&beam length=1.1, rho=0.7, E=1.25, I=1, c_D=1e-4 /'//nl
   character(len=*), parameter :: table = beam//'&record kind=''modes'', file=''modes.csv'' /'// &
      nl// &
      '&discretization degree=5, elements=8 /'//nl//'&stage free=''E'',''c_D'' /'//nl
   !> k l of the modes 1 to 5: cos(k l) cosh(k l) = -1.
   integer, parameter :: modes = 5
   real(wp), parameter :: kl(modes) = [1.8751040687119611664_wp, 4.6940911329741745764_wp, &
      7.8547574382376125649_wp, 10.995540734875466991_wp, 14.137168391046470581_wp]
   !> A strip of composite with spatial hysteresis and air, and a case that fits air alone.
   character(len=*), parameter :: strip = '&beam length=0.5, width=0.03, height=0.003, '// &
      'density=1700, E=3e10, {damping} /'//nl//'&sensor m_S=0.005, x_S=0.45 /'//nl// &
      '&discretization degree=5, elements=8 /'//nl
   character(len=*), parameter :: composite = 'a_h=0.02, b_h=0.1, gamma=0.05'
   character(len=:), allocatable :: reason
   real(wp) :: omega(modes)

   omega = (kl/length)**2*sqrt(bending/rho)
   call open_shell(reason)
   if (reason /= '') then
      call skip('beamid compare --damping', reason)
   else
      call test_tables()
      call test_ratios()
      call test_response()
      call test_decay()
      call test_limits()
      call test_refusals()
      call test_study()
      call close_shell()
   end if
   call finish('damping_models')

contains

   !> Writes modes.csv: frequencies and damping ratios with errors of .1 % and 1 %.
   !>
   !> ratio   true damping ratios
   !> factor  of the frequencies
   subroutine write_modes(ratio, factor, seed)
      real(wp), intent(in) :: ratio(modes), factor(modes)
      integer, intent(in) :: seed
      character(len=:), allocatable :: text
      real(wp) :: f(modes), noise(2*modes)
      integer :: k

      noise = gaussian_noise(2*modes, 1.0_wp, seed)
      f = omega*factor/(2*acos(-1.0_wp))
      text = 'mode,frequency_hz,sd_hz,damping_ratio,sd_damping'//nl
      do k = 1, modes
         text = text//to_text(k)//','//full(f(k)*(1 + 1e-3_wp*noise(k)))//','// &
            full(1e-3_wp*f(k))// &
            ','//full(ratio(k)*(1 + 1e-2_wp*noise(modes + k)))//','//full(1e-2_wp*ratio(k))//nl
      end do
      call write_file('modes.csv', text)
   end subroutine write_modes

   !> A truth of each mechanism is preferred, and models that do not contain it are rejected. The
   !> closed forms are exact to first order in damping ratios of .2 %, a twentieth of their errors.
   !> Time hysteresis raises the frequencies as well.
   subroutine test_tables()
      real(wp), parameter :: b = 60, d = 8e-3_wp
      !> air + spatial hysteresis, gamma = .1, a_h = .05, b_h = .33: by mpmath, as in
      !> test_spatial_hysteresis
      real(wp), parameter :: spatial(modes) = [0.0195550768822287417_wp, 0.0144043863613063409_wp, &
         0.0201054737623629711_wp, 0.0214213289572298537_wp, 0.0214277493081507765_wp]

      call check_truth('air', 'Kelvin-Voigt, structural', 0.01_wp/(2*rho*omega))
      call check_truth('Kelvin-Voigt', 'air, structural', 2e-3_wp*omega/omega(modes))
      call check_truth('structural', 'air, Kelvin-Voigt', spread(2e-3_wp, 1, modes))
      call check_truth('time hysteresis', 'air, Kelvin-Voigt, structural, spatial hysteresis', &
         d/2*omega*b/(omega**2 + b**2), 1 + d/2*omega**2/(omega**2 + b**2))
      call check_truth('air + spatial hysteresis', 'air, Kelvin-Voigt, structural, time '// &
         'hysteresis, spatial hysteresis, air + Kelvin-Voigt', spatial)
   end subroutine test_tables

   !> Compares the mechanisms for a table.
   !>
   !> truth     name of the true model, which has to be within 6 of the best one
   !> rejected  beginning of the list of rejected models
   !> ratio     true damping ratios
   !> factor    of the frequencies; default 1
   subroutine check_truth(truth, rejected, ratio, factor)
      character(len=*), intent(in) :: truth, rejected
      real(wp), intent(in) :: ratio(modes)
      real(wp), intent(in), optional :: factor(modes)
      type(outcome_t) :: outcome
      character(len=:), allocatable :: head, limit, models
      real(wp) :: J, least, own
      integer :: k, row

      if (present(factor)) call write_modes(ratio, factor, seed=3)
      if (.not. present(factor)) call write_modes(ratio, spread(1.0_wp, 1, modes), seed=3)
      call write_file('table.nml', table)
      outcome = beamid('compare --damping table.nml --quiet --out damping')
      call check('truth '//truth//': done', outcome%status == 0, outcome%err)
      if (outcome%status /= 0) return
      models = read_file('damping/models.csv')
      call check('truth '//truth//': ten models', line_count(models) == 11, models)
      least = huge(least)
      own = huge(own)
      do row = 1, 10
         J = number(field(models, row, 4))
         k = nint(number(field(models, row, 3)))
         ! No model has a factor for larger residuals here, so that J is chi-square.
         call check_close('  AICc of '//field(models, row, 1), number(field(models, row, 5)), &
            J + 2*k, 1e-9_wp*(J + 2*k))
         call check_close('  BIC of '//field(models, row, 1), number(field(models, row, 6)), &
            J + k*log(2.0_wp*modes), 1e-9_wp*(J + 2*k))
         least = min(least, J + 2*k)
         if (field(models, row, 1) == truth) own = J + 2*k
      end do
      call check('truth '//truth//' is possible', own - least <= 6, to_text(own - least))
      ! 10 values less 2 to 4 parameters: chi-square exceeds 38 with a probability of 1e-5.
      call check('truth '//truth//': its residuals are noise', own < 46, to_text(own))
      head = unwrapped(outcome%out)
      ! Models that have the truth as a limit: a slow relaxation damps like air on a beam without
      ! further masses.
      limit = truth
      if (truth == 'air') limit = 'time hysteresis'
      if (truth == 'Kelvin-Voigt') limit = 'hysteresis'
      call check('truth '//truth//': preferred, or contained', index(line(head, 1), truth) > 0 &
         .or. index(line(head, 1), limit) > 0, line(head, 1))
      call check('truth '//truth//': others are rejected', index(head, &
         'The data reject: '//rejected) &
         > 0, head(:min(len(head), 400)))
   end subroutine check_truth

   !> Frequencies that are off as those of another clamp do not change a comparison of damping
   !> ratios alone; with them, no model leaves residuals as small as the errors.
   subroutine test_ratios()
      real(wp), parameter :: off(modes) = [0.95_wp, 0.96_wp, 0.97_wp, 0.98_wp, 0.99_wp]
      type(outcome_t) :: outcome
      character(len=:), allocatable :: models

      call write_modes(spread(2e-3_wp, 1, modes), off, seed=4)
      call write_file('table.nml', table)
      outcome = beamid('compare --damping=ratios table.nml --quiet --out ratios')
      call check('ratios: done', outcome%status == 0, outcome%err)
      models = read_file('ratios/models.csv')
      call check('ratios: structural damping', index(line(outcome%out, 1), 'structural') > 0, &
         line(outcome%out, 1))
      call check('ratios: five values', has_all(outcome%out, 'm = 5 values'), outcome%out)
      ! One parameter; chi-square of four degrees of freedom exceeds 24 with a probability of 1e-4.
      call check('ratios: row of structural damping', field(models, 3, 1) == 'structural' .and. &
         field(models, 3, 3) == '1' .and. number(field(models, 3, 4)) < 24, line(models, 4))
      outcome = beamid('compare --damping table.nml --quiet --out all')
      call check('with frequencies: the misfit is stated', has_all(unwrapped(outcome%out), &
         'No model leaves residuals as small as the stated noise'), outcome%out)
   end subroutine test_ratios

   !> The damping ratios of a frequency response do not depend on the model that is fitted: a case
   !> that knows air damping alone measures those of spatial hysteresis. The truth is the table of
   !> `modes`.
   subroutine test_response()
      character(len=:), allocatable :: record
      type(outcome_t) :: outcome
      complex(wp), allocatable :: h(:)
      real(wp), allocatable :: noise(:)
      character(len=:), allocatable :: response
      real(wp) :: sd
      integer :: k, n

      call write_file('truth.nml', replaced(strip, '{damping}', composite)// &
         '&record kind=''frf'', f_first=5, f_last=350, f_step=0.5, x_F=0.2 /'//nl)
      outcome = beamid('frf truth.nml --quiet --out truth')
      call check('response: made', outcome%status == 0, outcome%err)
      response = read_file('truth/frf.csv')
      n = line_count(response) - 1
      h = [(cmplx(number(field(response, k, 3)), number(field(response, k, 4)), wp), k=1, n)]
      noise = gaussian_noise(2*n, 1.0_wp, 5)
      record = 'frequency_hz,real,imag,sd'//nl
      do k = 1, n
         sd = 0.01_wp*abs(h(k)) + 0.02_wp
         record = record//field(response, k, 2)//','//full(real(h(k)) + sd*noise(k))//','// &
            full(aimag(h(k)) + sd*noise(n + k))//','//full(sd)//nl
      end do
      call write_file('h.csv', record)
      call write_file('fit.nml', replaced(strip, '{damping}', 'gamma=0.1')// &
         '&record kind=''frf'', file=''h.csv'', x_F=0.2 /'//nl//'&stage free=''E'',''gamma'' /'//nl)
      call check_measured('response', 4)
   end subroutine test_response

   !> The same for a free decay.
   subroutine test_decay()
      type(outcome_t) :: outcome

      call write_file('truth.nml', replaced(strip, '{damping}', composite)// &
         '&excitation kind=''release'', force=0.5, x_F=0.3 /'//nl//'&noise sd=0.01, seed=2 /'// &
         nl// &
         '&record t_first=0.1, t_last=3, t_step=0.001 /'//nl)
      outcome = beamid('simulate truth.nml --quiet --out made')
      call check('decay: made', outcome%status == 0, outcome%err)
      call write_file('record.csv', read_file('made/record.csv'))
      call write_file('fit.nml', replaced(strip, '{damping}', 'gamma=0.1')// &
         '&excitation kind=''free'', modes=3 /'//nl//'&record file=''record.csv'', sd=0.01 /'// &
         nl// &
         '&stage free=''E'',''gamma'' start=3e10,0.1 /'//nl)
      call check_measured('decay', 3)
   end subroutine test_decay

   !> Compares the mechanisms for fit.nml, and the measured modes with those of truth.nml. Of
   !> `count` modes, each is within 4.5 standard errors with a probability of all but 3e-5. An error
   !> of the method of half a standard error would remain unseen.
   subroutine check_measured(label, count)
      character(len=*), intent(in) :: label
      integer, intent(in) :: count
      type(outcome_t) :: outcome
      character(len=:), allocatable :: damping, truth
      real(wp) :: known, measured, sd
      integer :: k

      outcome = beamid('modes truth.nml --quiet --out known')
      truth = read_file('known/modes.csv')
      outcome = beamid('compare --damping fit.nml --quiet --out measured')
      call check(label//': done', outcome%status == 0, outcome%err)
      damping = read_file('measured/damping.csv')
      do k = 1, count
         known = number(field(truth, k, 4))
         measured = number(field(damping, k, 8))
         sd = (number(field(damping, k, 10)) - number(field(damping, k, 9)))/(2*1.96_wp)
         call check_close(label//': damping ratio of mode '//to_text(k), measured, known, &
            4.5_wp*sd)
         call check(label//': mode '//to_text(k)//' is measured to 20 %', sd < 0.2_wp*known, &
            to_text(sd/known))
      end do
      call check(label//': spatial hysteresis is preferred', index(line(outcome%out, 1), &
         'spatial hysteresis') > 0, line(outcome%out, 1))
   end subroutine check_measured

   !> Where the truth is Kelvin-Voigt damping, records do not determine a relaxation rate, nor the
   !> range of spatial hysteresis, and the program says so; where it is time hysteresis between the
   !> frequencies, they do.
   subroutine test_limits()
      real(wp), parameter :: b = 60, d = 8e-3_wp
      type(answer_t) :: answer

      call write_modes(2e-3_wp*omega/omega(modes), spread(1.0_wp, 1, modes), seed=6)
      answer = identified(with('d_1=0.01, b_1=2000', '''d_1'',''b_1'''))
      call check('limit of time hysteresis: done', answer%status == 0, answer%err)
      call check('limit of time hysteresis: not determined', .not. answer%is_determined('b_1') &
         .and. .not. answer%is_determined('d_1'), answer%out)
      call check('limit of time hysteresis: reason', has_all(unwrapped(answer%out), &
         'b_1 is not determined|Kelvin-Voigt damping with c_D = E d_1/b_1'), answer%out)
      answer = identified(with('a_h=0.2, b_h=0.02', '''a_h'',''b_h'''))
      call check('limit of spatial hysteresis: done', answer%status == 0, answer%err)
      call check('limit of spatial hysteresis: reason', has_all(unwrapped(answer%out), &
         'b_h is not determined|Kelvin-Voigt damping with c_D I = a_h b_h^2/2'), answer%out)
      call write_modes(d/2*omega*b/(omega**2 + b**2), 1 + d/2*omega**2/(omega**2 + b**2), seed=7)
      answer = identified(with('d_1=0.01, b_1=50', '''d_1'',''b_1'''))
      call check('rate between the frequencies: determined', answer%is_determined('b_1') .and. &
         answer%is_determined('d_1'), answer%out)
   end subroutine test_limits

   !> Returns a case with other damping.
   function with(keys, names) result(text)
      character(len=*), intent(in) :: keys, names
      character(len=:), allocatable :: text

      text = replaced(replaced(table, 'c_D=1e-4', keys), '''c_D''', names)
   end function with

   subroutine test_refusals()
      character(len=*), parameter :: pulse = beam//'&excitation kind=''pulse'', amplitude=1, '// &
         'duration=0.1 /'//nl//'&record file=''record.csv'' /'//nl//'&stage free=''E'',''c_D'' '// &
         '/'// &
         nl

      call check_refused('another command', 2, 'modes --damping', table, 'behind compare')
      call check_refused('two cases', 2, 'compare --damping table.nml', table, 'expected one')
      call check_refused('another word', 2, 'compare --damping=all', table, 'found --damping=all')
      call check_refused('an integrator', 2, 'compare --damping', &
         pulse//'&integrator method=''cvode'' /'//nl, 'expected method=''modal''')
      call write_file('modes.csv', &
         'mode,frequency_hz,sd_hz'//nl//'1,0.4,0.01'//nl//'2,2.5,0.01'//nl)
      call check_refused('frequencies alone', 2, 'compare --damping', table, &
         'expected a free decay')
      call check_refused('ratios of a forced motion', 2, 'compare --damping=ratios', pulse, &
         'expected a free decay')
   end subroutine test_refusals
   !> `reproduce damping`: for each truth, the best model has its mechanisms, or has them as a
   !> limit.
   subroutine test_study()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: best, table, truth
      integer :: k

      if (.not. in_long_run()) then
         call skip('reproduce damping', 'it takes a minute')
         return
      end if
      outcome = in_root('reproduce damping --quiet --out @/study')
      call check('study: done', outcome%status == 0, outcome%err)
      table = read_file('study/damping_study.csv')
      call check('study: 7 truths and 7 models', line_count(table) == 50, &
         to_text(line_count(table)))
      do k = 1, line_count(table) - 1
         ! The difference from the best model is 0 for that model.
         if (number(field(table, k, 6)) > 0) cycle
         truth = field(table, k, 1)
         best = field(table, k, 2)
         call check('study: '//truth, index(best, truth) > 0 .or. (truth == 'Kelvin-Voigt' .and. &
            index(best, 'hysteresis') > 0), best)
      end do
   end subroutine test_study

end program test_damping_models
