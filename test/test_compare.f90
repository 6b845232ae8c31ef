!> `beamid compare`, through the program: nested models and one that is not, of one simulated
!> record.
program test_compare
   use beamid_cases, only: case_t, measured_samples, needs_fit, read_case
   use beamid_errors, only: error_t
   use beamid_identification, only: identify, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, exists, has_all, in_scratch, line_count, open_shell, &
      outcome_t, read_file, replaced, write_file
   use tables, only: line, number, part
   implicit none

   character(len=*), parameter :: line_feed = achar(10)
   !> The structure of Table 4.1 on four cubics; noise of some two per cent.
   character(len=*), parameter :: truth = &
      '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//line_feed// &
      '&tip m_T=0.15 /'//line_feed// &
      '&hose m_H=0.04, c_H=0.004, k_H=0.3 /'//line_feed// &
      '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//line_feed// &
      '&discretization degree=3, elements=4 /'//line_feed// &
      '&observation formula=''displacement_difference'', delta=0.1 /'//line_feed
   character(len=*), parameter :: window = 't_first=0.2, t_last=5.0, t_step=0.1 /'//line_feed
   character(len=*), parameter :: maker = truth//'&record '//window// &
      '&noise sd=0.02, seed=7 /'//line_feed
   character(len=*), parameter :: fitted = truth//'&record file=''record.csv'', '//window
   character(len=*), parameter :: full_case = fitted// &
      '&stage free=''m_H'',''c_H'',''k_H'' start=0.035,0.0035,0.35 /'//line_feed
   !> c_H held at the truth: a special case of the full one, and a right one.
   character(len=*), parameter :: right_case = fitted// &
      '&stage free=''m_H'',''k_H'' start=0.035,0.35 /'//line_feed

   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('beamid compare', reason)
   else
      call test_models()
      call test_nested()
      call test_refusals()
      call close_shell()
   end if
   call finish('compare')

contains

   !> J, number of parameters and samples of a case's fit, by the library.
   subroutine fit_of(name, J, parameters, samples)
      character(len=*), intent(in) :: name
      real(wp), intent(out) :: J
      integer, intent(out) :: parameters, samples
      type(case_t) :: case
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: t(:), measured(:)

      J = -1
      parameters = 0
      samples = 0
      call read_case(in_scratch(name), needs_fit, case, error)
      if (.not. allocated(error)) call measured_samples(case, t, measured, error)
      if (.not. allocated(error)) call identify(case%model, case%meshes(1), case%stages, t, &
         measured, fits, error)
      call check(name//': fitted by the library', .not. allocated(error))
      if (allocated(error)) return
      J = fits(1)%fit%J
      parameters = size(fits(1)%free)
      samples = size(t)
   end subroutine fit_of

   !> A record with noise, and the cases: the full model, c_H held at the truth and 50 per cent
   !> above it, and a tip mass that is 5 per cent off, which makes the model no special case of
   !> any other.
   subroutine write_cases()
      type(outcome_t) :: outcome

      call write_file('maker.nml', maker)
      outcome = beamid('simulate maker.nml --quiet --out made')
      call check('the record is made', outcome%status == 0 .and. exists('made/record.csv'), &
         outcome%err)
      call write_file('record.csv', read_file('made/record.csv'))
      call write_file('full.nml', full_case)
      call write_file('right.nml', right_case)
      call write_file('wrong.nml', replaced(right_case, 'c_H=0.004', 'c_H=0.008'))
      call write_file('other.nml', replaced(right_case, 'm_T=0.15', 'm_T=0.1575'))
   end subroutine write_cases

   !> models.csv and nested.csv against the library's fits and the formulas written out here. The
   !> program prints full precision; searches of one case run alike in program and library, and two
   !> searches for one minimum agree in J to 1e-14 or so; AICc and BIC are sums of some hundred.
   subroutine test_models()
      character(len=*), parameter :: names(4) = [character(len=5) :: 'right', 'full', 'wrong', &
         'other']
      type(outcome_t) :: outcome
      character(len=:), allocatable :: models, nested, row
      real(wp) :: J(4), m, k, U
      integer :: i, parameters(4), samples(4)

      call write_cases()
      outcome = beamid('compare right.nml full.nml wrong.nml other.nml --quiet --out compared')
      call check('compare: done', outcome%status == 0 .and. outcome%err == '', outcome%err)
      models = read_file('compared/models.csv')
      nested = read_file('compared/nested.csv')
      call check('models.csv: header', line(models, 1) == 'model,elements,parameters,J,aicc,bic', &
         line(models, 1))
      call check('models.csv: four models', line_count(models) == 5, to_text(line_count(models)))
      call check('nested.csv: header', line(nested, &
         1) == 'restricted,full,restrictions,U,probability', line(nested, 1))
      call check('summary.txt is what was printed', outcome%out /= '' .and. &
         read_file('compared/summary.txt') == outcome%out)
      do i = 1, 4
         call fit_of(trim(names(i))//'.nml', J(i), parameters(i), samples(i))
         row = line(models, i + 1)
         m = samples(i)
         k = parameters(i) + 1
         call check(trim(names(i))//': named, N = 4, '//to_text(parameters(i))//' parameters', &
            part(row, 1, ',') == trim(names(i)) .and. part(row, 2, ',') == '4' .and. &
            part(row, 3, ',') == to_text(parameters(i)), row)
         call check_close(trim(names(i))//': J', number(row, 4)/J(i), 1.0_wp, 1e-12_wp)
         call check_close(trim(names(i))//': AICc', number(row, 5), m*log(J(i)/m) + 2*k &
            + 2*k*(k + 1)/(m - k - 1), 1e-9_wp)
         call check_close(trim(names(i))//': BIC', number(row, 6), m*log(J(i)/m) + k*log(m), &
            1e-9_wp)
      end do
      call check('49 samples, 2 and 3 parameters', all(samples == 49) .and. &
         all(parameters == [2, 3, 2, 2]))
      ! Two pairs, both within the full model; nothing with the other tip mass.
      call check('nested.csv: two pairs', line_count(nested) == 3, nested)
      if (line_count(nested) /= 3) return
      do i = 1, 3, 2
         row = line(nested, merge(2, 3, i == 1))
         U = m*(J(i) - J(2))/J(2)
         call check(trim(names(i))//' within full, one restriction', &
            part(row, 1, ',') == trim(names(i)) .and. part(row, 2, ',') == 'full' .and. &
            part(row, 3, ',') == '1', row)
         ! A difference of nearly equal J: 49 times their round-off.
         call check_close(trim(names(i))//' within full: U', number(row, 4), U, &
            1e-9_wp*max(1.0_wp, U))
         ! chi-square with one degree of freedom: erfc(sqrt(U/2)).
         call check_close(trim(names(i))//' within full: probability', number(row, 5), &
            erfc(sqrt(max(0.0_wp, number(row, 4))/2)), 1e-13_wp)
      end do
      ! c_H is known to 8 %: 100 % off is beyond doubt, and the truth was not rejected with this
      ! seed.
      call check('the wrong value is rejected', number(line(nested, 3), 5) < 1e-3_wp, &
         line(nested, 3))
      call check('the true value is not', number(line(nested, 2), 5) > 0.05_wp, line(nested, 2))
      ! A long line goes on in the next one.
      call check('in words', has_all(replaced(outcome%out, new_line('a')//'    ', ' '), &
         'right within full|no reason to prefer the full model|wrong within full|'// &
         'the full model is better'))
      ! The order of the arguments is that of the rows, and alters nothing else.
      outcome = beamid('compare full.nml right.nml --quiet --out turned')
      call check('copies of the cases', read_file('turned/case.txt') == '! full.nml'//line_feed// &
         read_file('full.nml')//line_feed//'! right.nml'//line_feed//read_file('right.nml')// &
         line_feed)
      call check('turned round', outcome%status == 0 .and. line(read_file('turned/models.csv'), 2) &
         == line(models, 3) .and. line(read_file('turned/nested.csv'), 2) == line(nested, 2))
   end subroutine test_models

   !> A length that the larger model frees need not be that of the smaller one; models that are
   !> seen by different sensors are not nested, though all their parameters agree.
   subroutine test_nested()
      character(len=*), parameter :: two_sensors = '&sensor name=''a'', x_S=4.0 /'//line_feed// &
         '&sensor name=''b'', x_S=3.9 /'//line_feed

      call write_file('long.nml', replaced(right_case, '''k_H'' start=0.035,0.35', &
         '''k_H'',''length'' start=0.035,0.35,4.0'))
      call write_file('right_a.nml', two_sensors//replaced(right_case, 'file=', &
         'sensor=''a'', file='))
      call write_file('full_a.nml', two_sensors//replaced(full_case, 'file=', &
         'sensor=''a'', file='))
      call write_file('full_b.nml', two_sensors//replaced(full_case, 'file=', &
         'sensor=''b'', file='))
      call check('within a model of free length', pairs('right.nml long.nml') == 1)
      call check('seen by one sensor', pairs('right_a.nml full_a.nml') == 1)
      call check('seen by two sensors', pairs('right_a.nml full_b.nml') == 0)
   end subroutine test_nested

   !> How many nested pairs the program finds; -1 where it fails.
   integer function pairs(names)
      character(len=*), intent(in) :: names
      type(outcome_t) :: outcome

      outcome = beamid('compare '//names//' --quiet --out pairs')
      pairs = -1
      if (outcome%status == 0) pairs = line_count(read_file('pairs/nested.csv')) - 1
   end function pairs

   !> Bad input: status 2, one line that says where, nothing written.
   subroutine refused(name, arguments, words)
      character(len=*), intent(in) :: name, arguments, words
      type(outcome_t) :: outcome

      outcome = beamid('compare '//arguments//' --out refused')
      call check(name, outcome%status == 2 .and. line_count(outcome%err) == 1 .and. &
         outcome%out == '' .and. has_all(outcome%err, words) .and. .not. exists('refused'), &
         to_text(outcome%status)//': '//outcome%err)
   end subroutine refused

   !> Another record in the second case, in its times or in a single value; a case without a
   !> stage; no case at all.
   subroutine test_refusals()
      character(len=:), allocatable :: record

      call write_file('shorter.nml', replaced(full_case, 't_last=5.0', 't_last=4.9'))
      call refused('fewer samples', 'full.nml shorter.nml', 'shorter.nml|&record|full.nml|same')
      call write_file('shifted.nml', replaced(replaced(full_case, 't_first=0.2', 't_first=0.3'), &
         't_last=5.0', 't_last=5.0'))
      call refused('later samples', 'full.nml shifted.nml', 'shifted.nml|&record|full.nml')
      record = read_file('record.csv')
      call write_file('touched.csv', record(:len(record) - 2)//merge('1', '2', &
         record(len(record) - 1:len(record) - 1) /= '1')//line_feed)
      call write_file('touched.nml', replaced(full_case, 'record.csv', 'touched.csv'))
      call refused('one digit of one value', 'full.nml right.nml touched.nml', &
         'touched.nml|&record|full.nml')
      call write_file('aimless.nml', fitted)
      call refused('a case without a stage', 'full.nml aimless.nml', 'aimless.nml|&stage')
      call refused('a case that is not there', 'full.nml nowhere.nml', 'nowhere.nml')
      call refused('no case', '', 'compare')
   end subroutine test_refusals

end program test_compare
