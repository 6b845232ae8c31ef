!> `beamid profile`, `sample` and `bootstrap`: one table of intervals that each of them completes,
!> as long as the fit is the same; what has no limit is said, and is no posterior.
program test_intervals
   use beamid_kinds, only: wp
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      read_file, remove_tree, replaced, write_file
   use tables, only: field, line, lines_with, longest, number
   implicit none

   character(len=*), parameter :: nl = achar(10)
   character(len=*), parameter :: model = &
      '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//nl//'&tip m_T=0.15 /'//nl// &
      '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl// &
      '&discretization elements=3 /'//nl//'&sample draws=1000 /'//nl//'&bootstrap n=200 /'//nl
   character(len=*), parameter :: grid = '&record t_first=0.1, t_last=4.0, t_step=0.05 /'//nl// &
      '&noise sd=0.05, seed=4 /'//nl, record = '&record file=''made/record.csv'', t_first=0.1 /'//nl
   character(len=:), allocatable :: reason, table, before
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason /= '') then
      call skip('intervals', reason)
   else
      call write_file('truth.nml', model//grid)
      outcome = beamid('simulate truth.nml --out made --quiet')
      call check('record made', outcome%status == 0, outcome%err)
      call write_file('case.nml', model//record//'&stage free=''E'',''m_T'', start=79,0.14 /'//nl)
      call test_one_table()
      call test_other_fit()
      call test_no_limit()
   end if
   call close_shell()
   call finish('intervals')

contains

   subroutine test_one_table()
      integer :: k

      outcome = beamid('profile case.nml --out out --quiet')
      call check('profile', outcome%status == 0, outcome%err)
      table = read_file('out/intervals.csv')
      call check('profile: two methods, two parameters', line_count(table) == 5, table)
      call check('profile: the way', line_count(read_file('out/profiles.csv')) > 12)
      before = table
      outcome = beamid('bootstrap case.nml --out out --quiet')
      call check('bootstrap', outcome%status == 0, outcome%err)
      table = read_file('out/intervals.csv')
      call check('bootstrap: the profiles stay', line_count(table) == 9 .and. &
         lines_with(table, 'profile,3,E') == 1 .and. lines_with(table, 'profile,3,m_T') == 1, table)
      call check('bootstrap: their bytes', index(table, line(before, 2)) > 0 .and. &
         index(table, line(before, 3)) > 0)
      call check('bootstrap: its table', line_count(read_file('out/bootstrap.csv')) == 201)
      call check('bootstrap: profiles.csv stays', exists('out/profiles.csv'))
      outcome = beamid('sample case.nml --out out --quiet')
      call check('sample', outcome%status == 0, outcome%err)
      table = read_file('out/intervals.csv')
      call check('sample: five methods', line_count(table) == 11, table)
      call check('sample: side by side', has_all(outcome%out, &
         'linear theory|profile|posterior|bootstrap (BCa)|Pareto k'), outcome%out)
      call check('sample: no line is wide', longest(outcome%out) <= 100)
      call check('sample: draws', line_count(read_file('out/posterior.csv')) == 1001 .and. &
         line(read_file('out/posterior.csv'), 1) == 'chain,draw,elements,lp,E,m_T')
      call check('sample: motion', line_count(read_file('out/posterior_motion.csv')) == 80)
      ! 5 % noise and parameters known to .1 %: linear theory is right, and all four agree. Ends of
      ! 200 resampled records are known to .2 standard errors, .1 half widths; three of them.
      do k = 2, line_count(table)
         call check_close('as linear theory: '//field(table, k - 1, 1)//' '// &
            field(table, k - 1, 3), (number(field(table, k - 1, 7)) &
            - number(field(table, k - 1, 6)))/width(k - 1), 1.0_wp, 0.3_wp)
      end do
   end subroutine test_one_table

   !> Width of the linear interval of the parameter in a row.
   real(wp) function width(row)
      integer, intent(in) :: row
      integer :: k

      width = -1
      do k = 1, line_count(table) - 1
         if (field(table, k, 1) == 'linear' .and. field(table, k, 3) == field(table, row, 3)) &
            width = number(field(table, k, 7)) - number(field(table, k, 6))
      end do
   end function width

   !> With other samples the intervals of before are those of another fit.
   subroutine test_other_fit()
      call write_file('case.nml', replaced(read_file('case.nml'), 't_first=0.1', 't_first=0.2'))
      outcome = beamid('profile case.nml --out out --quiet')
      call check('another fit', outcome%status == 0, outcome%err)
      call check('another fit: nothing of before', line_count(read_file('out/intervals.csv')) == 5)
   end subroutine test_other_fit

   !> Force, mass and stiffness may all grow together.
   subroutine test_no_limit()
      call write_file('flat.nml', model//record// &
         '&stage free=''E'',''rho'',''m_T'',''c_D'',''amplitude'', '// &
         'start=79,0.03,0.14,0.005,1 /'//nl)
      outcome = beamid('profile flat.nml --out flat --quiet')
      call check('no limit: status', outcome%status == 0, outcome%err)
      table = read_file('flat/intervals.csv')
      call check('no limit: in the table', lines_with(table, 'profile,|,unbounded') >= 4, table)
      call check('no limit: in words', index(outcome%out, 'no upper limit') > 0)
      outcome = beamid('sample flat.nml --out other --quiet')
      call check('no posterior: status', outcome%status == 1)
      call check('no posterior: words', has_all(outcome%err, 'flat.nml|no limit|&prior'), &
         outcome%err)
      call check('no posterior: nothing written', .not. exists('other'))
      call remove_tree('flat')
   end subroutine test_no_limit

end program test_intervals
