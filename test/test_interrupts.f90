!> Interrupts: every command of the library ends with the status of an interruption wherever the
!> flag is set, and afterwards finds what it found before; the program ends by the signal and writes
!> nothing; a call by C catches Ctrl-C while it lasts, and can be stopped by the caller.
program test_interrupts
   use, intrinsic :: iso_c_binding, only: c_int, c_intptr_t
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t, fit_case, judge_case, load_case
   use beamid_case_inferences, only: case_inference_t, infer
   use beamid_cases, only: needs_fit, read_case
   use beamid_errors, only: error_t, status_interrupted
   use beamid_interrupts, only: begin_call, check_interrupt, checks_until_interrupt, end_call, &
      interrupt_at_check, interrupted, set_flag, stop_call, stop_flag, &
      stopped_by_caller
   use beamid_kinds, only: wp
   use beamid_posix, only: c_raise, c_signal, sig_ign, sigint
   use beamid_strings, only: to_text
   use checks, only: check, finish, in_long_run
   use random_numbers, only: between, start_random
   use shell, only: close_shell, exists, in_scratch, open_shell, outcome_t, program_path, &
      read_file, &
      replaced, run, write_file
   implicit none

   character(len=*), parameter :: nl = new_line('a')
   character(len=:), allocatable :: reason

   call test_calls()
   call open_shell(reason)
   call check('program', reason == '', reason)
   if (reason == '') then
      call start_random(20261124)
      call write_file('table_4_1_noisy.csv', read_file('../../data/table_4_1_noisy.csv'))
      call write_file('short.nml', case_text('''modal''', '2', '100', '1000'))
      call write_file('starts.nml', case_text('''cvode'', rtol=1e-6', '2,3', '100', '1000')// &
         '&multistart n=3 /'//nl)
      call write_file('long.nml', case_text('''modal''', '4', '100000', '1000000'))
      call test_library('short', [character(len=9) :: 'profile', 'sample', 'bootstrap'], 24)
      call test_library('starts', [character(len=9) ::], 12)
      call test_program('INT', 130)
      call test_program('TERM', 143)
      call close_shell()
   end if
   call finish('interrupts')

contains

   !> Calls by C, as c_calls.f90 encloses a computation. Before and after them SIGINT is ignored, so
   !> that the action that a call restores can be told from that of the call.
   subroutine test_calls()
      integer(c_intptr_t) :: before, ignored
      integer(c_int) :: failed, flag
      type(error_t), allocatable :: error
      logical :: stops(2)
      integer :: k

      before = c_signal(sigint, sig_ign)
      call begin_call(catch=.true.)
      call check('a call: no interrupt at its beginning', .not. interrupted())
      ! A second call, in another thread, leaves SIGINT to the first.
      stops = .true.
      !$omp parallel do num_threads(2) schedule(static, 1) private(failed, flag) copyin(stop_flag)
      do k = 1, 2
         if (k == 2) then
            call begin_call(catch=.true.)
            failed = c_raise(sigint)
            stops(k) = interrupted()
            call end_call(flag)
         end if
      end do
      !$omp end parallel do
      call check('a second call is not stopped by SIGINT', .not. stops(2))
      call check('the first call is stopped by SIGINT', interrupted())
      call end_call(flag)
      call check('end of the call: number of the signal', flag == sigint, to_text(int(flag)))
      call check('after the call: no interrupt', .not. interrupted())
      failed = c_raise(sigint)
      call check('after the call: SIGINT is ignored again', .not. interrupted() .and. failed == 0)
      ignored = c_signal(sigint, before)
      call check('after the call: the action before', ignored == sig_ign)

      call set_flag(sigint)
      call begin_call(catch=.true.)
      call check('a handler that runs after the end of a call stops the next one', interrupted())
      call end_call(flag)
      call check('end of the call that it stops', flag == sigint, to_text(int(flag)))
      call begin_call(catch=.true.)
      call check('the call after it is not stopped', .not. interrupted())
      call end_call(flag)

      call begin_call(catch=.false.)
      call stop_call()
      call check_interrupt(error)
      call check('a call that its caller stops', is_interruption(error))
      call end_call(flag)
      call check('end of this call', flag == stopped_by_caller, to_text(int(flag)))
      call begin_call(catch=.false.)
      call check('the next call is not stopped', .not. interrupted())
      call end_call(flag)
      call check('end of the next call', flag == 0)
   end subroutine test_calls

   !> Returns the case of Table 4.1 with noise.
   !>
   !> method  of the integrator, quoted, and further keys of its group
   function case_text(method, elements, replicates, draws) result(text)
      character(len=*), intent(in) :: method, elements, replicates, draws
      character(len=:), allocatable :: text

      text = '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.0045 /'//nl// &
         '&tip m_T=0.15 /'//nl// &
         '&hose m_H=0.038, c_H=0.0038, k_H=0.33 /'//nl// &
         '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl// &
         '&discretization degree=3, elements='//elements//' /'//nl// &
         '&integrator method='//method//' /'//nl// &
         '&observation formula=''displacement_difference'', delta=0.1 /'//nl// &
         '&record file=''table_4_1_noisy.csv'', t_first=0.2, t_last=5.0, t_step=0.1 /'//nl// &
         '&stage free=''m_H'',''k_H'' /'//nl// &
         '&bootstrap n='//replicates//' /'//nl// &
         '&sample draws='//draws//' /'//nl
   end function case_text

   !> Sets the flag at random checks of a fit and of what follows it.
   !>
   !> commands  that follow the fit
   !> times     number of interruptions
   subroutine test_library(name, commands, times)
      character(len=*), intent(in) :: name, commands(:)
      integer, intent(in) :: times
      type(error_t), allocatable :: error
      real(wp), allocatable :: again(:), estimate(:)
      integer :: checks, k, n
      integer, parameter :: never = huge(never)

      call interrupt_at_check(never)
      call compute(name, commands, estimate, error)
      checks = never - checks_until_interrupt()
      call check(name//': uninterrupted', .not. allocated(error), text_of(error))
      call check(name//': many checks', checks > 100, to_text(checks))
      do k = 1, times
         ! Threads share the work in another order each time: not quite up to the last check.
         n = 1 + int(0.9_wp*checks**between(0.0_wp, 1.0_wp))
         call interrupt_at_check(n)
         call compute(name, commands, again, error)
         call check(name//': interrupted at check '//to_text(n), is_interruption(error))
      end do
      call interrupt_at_check(0)
      call compute(name, commands, again, error)
      call check(name//': works again', .not. allocated(error))
      if (allocated(error)) return
      call check(name//': the same estimates', all(abs(again - estimate) <= 0))
   end subroutine test_library

   function text_of(error) result(text)
      type(error_t), allocatable, intent(in) :: error
      character(len=:), allocatable :: text

      text = ''
      if (allocated(error)) text = error%message
   end function text_of

   logical function is_interruption(error)
      type(error_t), allocatable, intent(in) :: error

      is_interruption = allocated(error)
      if (is_interruption) is_interruption = error%status == status_interrupted
   end function is_interruption

   !> Reads and fits a case, and runs commands on the fit.
   !>
   !> estimate  (n) of the last stage on the finest mesh, then the first replicate of the bootstrap
   !>           and the first draw of the posterior where the commands make them
   subroutine compute(name, commands, estimate, error)
      character(len=*), intent(in) :: name, commands(:)
      real(wp), allocatable, intent(out) :: estimate(:)
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(case_fit_t) :: found
      type(case_inference_t), allocatable :: inferences(:)
      integer :: k

      allocate (estimate(0))
      call read_case(in_scratch(name//'.nml'), needs_fit, case, error)
      if (.not. allocated(error)) call load_case(case, found, error)
      if (.not. allocated(error)) call fit_case(case, found, error)
      if (.not. allocated(error)) call judge_case(case, found, error)
      if (allocated(error)) return
      estimate = found%fits(1, size(found%fits, 2))%fit%estimate
      do k = 1, size(commands)
         call infer(trim(commands(k)), case, found, inferences, error)
         if (allocated(error)) return
         associate (last => inferences(size(inferences)))
            if (allocated(last%resampled)) estimate = [estimate, last%resampled%estimates(:, 1)]
            if (allocated(last%posterior)) estimate = [estimate, last%posterior%draws%q(:, 1)]
         end associate
      end do
   end subroutine compute

   !> Sends a signal after 3 s, while the program computes what would take minutes; a loaded machine
   !> may take more than 1 s to start it. If the program does not end within 20 s, `timeout` kills
   !> it and the status is 137. Without `--foreground`, `timeout` sends the signal twice, to the
   !> program and to its group, and the second one may end the program before it has said so. Short
   !> runs of this suite stop the bootstrap, here in one thread, by SIGINT only.
   !>
   !> expected  status that a shell reports
   subroutine test_program(signal, expected)
      character(len=*), intent(in) :: signal
      integer, intent(in) :: expected
      type(outcome_t) :: outcome
      character(len=*), parameter :: commands(2) = [character(len=9) :: 'sample', 'bootstrap'], &
         threads(2) = [character(len=18) :: '', ' OMP_NUM_THREADS=1']
      integer :: k

      do k = 1, merge(size(commands), 1, signal == 'INT' .or. in_long_run())
         associate (what => trim(commands(k))//', '//signal//': ')
            outcome = run('env --default-signal='//signal// &
               trim(threads(k))// &
               ' timeout --foreground --preserve-status -k 20 -s '//signal//' 3 '''// &
               program_path//''' '//trim(commands(k))//' long.nml --quiet --out out')
            call check(what//'ends by the signal', outcome%status == expected, &
               to_text(outcome%status))
            call check(what//'one line', outcome%err == 'beamid: interrupted'//nl, outcome%err)
            call check(what//'no output', outcome%out == '' .and. .not. exists('out'))
         end associate
      end do
   end subroutine test_program

end program test_interrupts
