!> `beamid identify` on a record so long that threads share its rows and its table: the same bytes
!> for any number of threads.
program test_threads
   use checks, only: check, finish, skip
   use shell, only: close_shell, open_shell, outcome_t, program_path, run, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10)
   character(len=*), parameter :: beam = &
      '&beam length=0.5, rho=0.27, E=6.8e10, width=0.05, height=0.002, c_D=4e6, gamma=0.08 /'// &
      nl//'&sensor m_S=0.0045, x_S=0.44 /'//nl//'&discretization elements=8 /'//nl, &
      ! More than two parts of 32768 samples.
      samples = 't_first=0.0, t_last=5.0, t_step=0.00006'
   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason /= '') then
      call skip('threads', reason)
   else
      call write_file('truth.nml', beam//'&excitation kind=''release'', displacement=0.01 /'//nl// &
         '&record '//samples//' /'//nl//'&noise sd=0.1 /'//nl)
      call write_file('fit.nml', beam//'&excitation kind=''free'', modes=2 /'//nl// &
         '&record file=''out/truth/record.csv'', t_first=1.0 /'//nl// &
         '&stage free=''E'',''m_S'',''c_D'',''gamma'', start=''case'' /'//nl)
      outcome = run('"'//program_path//'" simulate truth.nml')
      call check('a long record', outcome%status == 0, outcome%err)
      outcome = run('for n in 1 2 3; do OMP_NUM_THREADS=$n "'//program_path// &
         '" identify fit.nml --quiet --out $n || exit 1; done')
      call check('fits', outcome%status == 0, outcome%err)
      outcome = run('test "$(wc -l <1/fit.csv)" -gt 60000 && for n in 2 3; do '// &
         'diff -r --exclude=manifest.txt 1 $n || exit 1; done')
      call check('the same bytes', outcome%status == 0, outcome%out//outcome%err)
   end if
   call close_shell()
   call finish('threads')

end program test_threads
