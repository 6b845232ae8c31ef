!> The built program when something fails: computations, file systems, streams, numbers that a
!> computer cannot handle. Exit status, one line, and what lies in the output folder.
program test_command_failures
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, read_file, remove_tree, replaced, run, write_file
   use short_case, only: case_text, listing, nl, pulse, text_of
   implicit none

   character(len=:), allocatable :: reason, record_text

   call open_shell(reason)
   if (reason /= '') then
      call skip('command failures', reason)
   else
      call make_record()
      call test_failures()
      call test_full_disk()
      call test_standard_output()
      call test_extremes()
      call test_score()
      call close_shell()
   end if
   call finish('command_failures')

contains

   !> The six samples that the case itself gives.
   subroutine make_record()
      type(outcome_t) :: outcome

      call write_file('case.nml', replaced(case_text, 'file=''record.csv'', ', ''))
      outcome = beamid('simulate case.nml --quiet')
      call check('a record is made', outcome%status == 0, outcome%err)
      record_text = read_file('out/case/record.csv')
      call write_file('record.csv', record_text)
   end subroutine make_record

   !> A computation that fails says so in one line and leaves what was there before.
   subroutine test_failures()
      character(len=*), parameter :: commands(*) = [character(len=8) :: 'simulate', 'identify']
      character(len=:), allocatable :: before
      type(outcome_t) :: outcome
      integer :: k

      call write_file('old/kept.txt', 'kept')
      call write_file('old/summary.txt', 'older summary'//nl)
      call write_file('old/estimates.csv', 'older estimates'//nl)
      call write_file('old/response.csv', '')
      before = listing('old')
      call write_file('case.nml', replaced(case_text, 'rtol=1e-8', 'rtol=1e-8, max_steps=10'))
      do k = 1, size(commands)
         outcome = beamid(trim(commands(k))//' case.nml --quiet --out old')
         call check(trim(commands(k))//': gives up, status 1', outcome%status == 1 .and. &
            outcome%out == '')
         call check(trim(commands(k))//': one line', line_count(outcome%err) == 1 .and. &
            has_all(outcome%err, 'beamid: |case.nml: |elements = 2|10'), &
               outcome%err(:len(outcome%err) - 1))
         call check(trim(commands(k))//': older files as they were', listing('old') == before)
         outcome = beamid(trim(commands(k))//' case.nml --quiet --out none')
         call check(trim(commands(k))//': nothing written', outcome%status == 1 .and. &
            .not. exists('none'))
      end do
      call write_file('case.nml', replaced(case_text, 'm_T=0.15', 'm_T=-1'))
      outcome = beamid('modes case.nml --out old')
      call check('bad input: older files as they were', outcome%status == 2 .and. &
         listing('old') == before)
   end subroutine test_failures

   !> A file system that takes no more, here a limit on the size of files.
   subroutine test_full_disk()
      character(len=:), allocatable :: before
      type(outcome_t) :: outcome

      call write_file('case.nml', replaced(case_text, 't_step=0.1', 't_step=0.01'))
      before = listing('old')
      ! The limit would also stop a program that counts executed lines (scripts/coverage.sh) while
      ! it writes its counters. With this prefix it skips them, and says so.
      outcome = run('(ulimit -f 1; GCOV_PREFIX=/dev/null "'//program_path// &
         '" simulate case.nml --quiet --out old; echo "status $?") 2>&1 | grep -v "^profiling:"')
      call check('full disk: status 1 and one line', has_all(outcome%out, &
         'beamid: old: the output folder cannot be written|status 1') .and. &
            line_count(outcome%out) == 2, &
         outcome%out(:max(0, len(outcome%out) - 1)))
      call check('full disk: older files as they were', listing('old') == before)
      call write_file('case.nml', case_text)
      outcome = beamid('identify case.nml --quiet --out old')
      call check('older outputs are replaced by the next success', outcome%status == 0 .and. &
         read_file('old/summary.txt') == outcome%out .and. read_file('old/kept.txt') == 'kept')
   end subroutine test_full_disk

   !> Standard output that takes nothing, or has no reader any more: status 1 and one line, which
   !> says where the outputs are. Standard error that takes nothing is no reason to fail.
   subroutine test_standard_output()
      type(outcome_t) :: outcome

      call refused_by('help >/dev/full', 'No space left on device')
      call refused_by('version >/dev/full', 'No space left on device')
      call refused_by('version >&-', 'Bad file descriptor')
      call remove_tree('full')
      call refused_by('modes case.nml --quiet --out full >/dev/full', &
         'No space left|the outputs are in full')
      call check('full device: the outputs are there', &
         index(read_file('full/summary.txt'), 'natural modes') > 0 .and. &
         exists('full/manifest.txt'))
      ! The reader closes its end before it lets the program start.
      outcome = run('mkfifo start; { read -r go <start; "'//program_path//'" help; '// &
         'echo "status $?" >&2; } | { exec <&-; echo go >start; }')
      call check('no reader: status 1 and one line', line_count(outcome%err) == 2 .and. &
         has_all(outcome%err, 'beamid: standard output: cannot be written: Broken pipe|status 1'))
      outcome = beamid('identify case.nml --out full 2>/dev/full')
      call check('standard error on a full device', outcome%status == 0 .and. &
         outcome%out == read_file('full/summary.txt'))
      outcome = beamid('fit case.nml 2>&-')
      call check('no standard error', outcome%status == 2)
   end subroutine test_standard_output

   subroutine refused_by(arguments, words)
      character(len=*), intent(in) :: arguments, words
      type(outcome_t) :: outcome

      outcome = beamid(arguments)
      call check(arguments, outcome%status == 1 .and. outcome%out == '' .and. &
         line_count(outcome%err) == 1 .and. &
         has_all(outcome%err, 'beamid: standard output: cannot be written: |'//words), &
         outcome%err(:max(0, len(outcome%err) - 1)))
   end subroutine refused_by

   !> Numbers that a computer cannot handle: a message or finite numbers, never a NaN, and no zeros
   !> for accelerations because Delta drowned in round-off.
   subroutine test_extremes()
      call sober('simulate', 'delta=0.1', 'delta=1e-200', must_fail=.true.)
      call sober('simulate', 'delta=0.1', 'delta=1e-20', must_fail=.true.)
      call sober('identify', 'delta=0.1', 'delta=1e-20', must_fail=.true.)
      call sober('identify', pulse, 'kind=''pulse'', amplitude=1e160, duration=0.05')
      call sober('identify', pulse, 'kind=''pulse'', amplitude=0.0, duration=0.05')
      call sober('simulate', pulse, 'kind=''pulse'', amplitude=1e150, duration=0.05')
      call sober('modes', 'c_D=0.005', 'c_D=1e5')
      call sober('modes', 'c_D=0.005', 'c_D=1.7e308')
      call sober('modes', 'E=80.0', 'E=1e20')
      call sober('modes', 'm_H=0.04', 'm_H=1e-300')
      call sober('modes', 'c_H=0.004', 'c_H=1e50')
      call sober('simulate', 'c_H=0.004', 'c_H=1e5')
      call sober('simulate', 'method=''cvode'', rtol=1e-8', 'method=''modal''')
      call sober('simulate', 'c_H=0.004', 'c_H=1e5', modal=.true.)
      call sober('simulate', 'k_H=0.3', 'k_H=1e-20', modal=.true.)
      call sober('simulate', 'm_H=0.04', 'm_H=1e-20', modal=.true.)
      call sober('identify', 'amplitude=1.0', 'amplitude=0.0', modal=.true.)
      call sober('identify', 'length=4.0', 'length=1e20', modal=.true.)
      call sober('simulate', 't_first=0.1', 'scale=1e-309, t_first=0.1', must_fail=.true.)
   end subroutine test_extremes

   !> A sample whose square overflows, outside the window of the fit and inside that of the score.
   subroutine test_score()
      type(outcome_t) :: outcome

      call write_file('record.csv', record_text//'0.7,1e200'//nl)
      call write_file('case.nml', case_text//'&score t_first=0.1, t_last=0.7, t_step=0.1 /'//nl)
      outcome = beamid('identify case.nml --quiet --out score')
      call check('score that is not finite: status 1, one line', outcome%status == 1 .and. &
         outcome%out == '' .and. line_count(outcome%err) == 1 .and. has_all(outcome%err, &
         'case.nml: |elements = 2, stage 1: |window of the score is not finite|1E+200'), &
         outcome%err)
      call check('score that is not finite: nothing written', .not. exists('score'))
      call write_file('record.csv', record_text)
   end subroutine test_score

   !> One change of the case ends with finite outputs, or with one line and none.
   subroutine sober(command, old, new, must_fail, modal)
      character(len=*), intent(in) :: command, old, new
      logical, intent(in), optional :: must_fail, modal
      character(len=:), allocatable :: text, fault
      type(outcome_t) :: outcome

      text = replaced(case_text, old, new)
      if (present(modal)) text = replaced(text, 'method=''cvode'', rtol=1e-8', 'method=''modal''')
      call write_file('case.nml', text)
      outcome = beamid(command//' case.nml --quiet --out sober')
      fault = ''
      if (outcome%status == 0) then
         if (outcome%err /= '') fault = fault//' success with a message;'
         if (text_of(run('grep -lE "NaN|Inf|\*\*" sober/*')) /= '') fault = fault// &
            ' NaN, infinity or stars;'
         if (.not. exists('sober/summary.txt')) fault = fault//' success without outputs;'
         if (present(must_fail)) fault = fault//' accepted;'
      else
         if (outcome%status > 2 .or. line_count(outcome%err) /= 1) fault = fault//' not one line;'
         if (exists('sober')) fault = fault//' output written;'
      end if
      call check('extreme: '//command//', '//new//trim(merge(' modal', '      ', present(modal))), &
         fault == '', fault//' '//outcome%err(:max(0, len(outcome%err) - 1)))
      call remove_tree('sober')
   end subroutine sober

end program test_command_failures
