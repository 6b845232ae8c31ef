!> `beamid ensemble`: the same bytes whatever threads, parts and kills; failed members are rows; the
!> summary adds up what the table says; a fleet is fitted where something is new.
program test_ensemble
   use beamid_kinds, only: wp
   use beamid_shards, only: gaps, range_of_members_t
   use checks, only: check, check_close, finish, in_long_run, skip
   use random_numbers, only: between, start_random
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, python_with, read_file, remove_tree, replaced, run, write_file
   use tables, only: field, line, lines_with, number
   implicit none

   character(len=*), parameter :: nl = achar(10)
   character(len=*), parameter :: &
      beam = '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//nl//'&tip m_T=0.15 /'//nl// &
      '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl// &
      '&discretization elements=2 /'//nl, &
      samples = '&record t_first=0.1, t_last=2.0, t_step=0.05 /'//nl, &
      noise = '&noise sd=0.02 /'//nl, &
      stage = '&stage free=''E'',''m_T'', start=79,0.14 /'//nl, &
      draw = '&draw parameter=''m_T'', low=0.13, high=0.17 /'//nl
   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call test_gaps()
   call open_shell(reason)
   if (reason /= '') then
      call skip('ensemble', reason)
   else
      call write_file('case.nml', ensemble(400)//draw)
      call test_bytes()
      call test_kills()
      call test_mpi()
      call test_intervals()
      call test_failed_members()
      call test_bad_input()
      call test_another_case()
      call test_fleet()
   end if
   call close_shell()
   call finish('ensemble')

contains

   function ensemble(members) result(text)
      integer, intent(in) :: members
      character(len=:), allocatable :: text
      character(len=80) :: group

      write (group, '(a,i0,a)') '&ensemble members=', members, ' /'
      text = beam//samples//noise//stage//trim(group)//nl
   end function ensemble

   subroutine test_gaps()
      type(range_of_members_t), parameter :: shards(3) = [range_of_members_t(3, 5), &
         range_of_members_t(4, 4), range_of_members_t(9, 20)]

      call check('what shards lack', told(gaps(shards, range_of_members_t(1, 30))) == &
         ' 1 2 6 8 21 30')
      call check('what shards lack in the midst', told(gaps(shards, range_of_members_t(4, 7))) == &
         ' 6 7')
      call check('shards that hold all', size(gaps(shards, range_of_members_t(9, 12))) == 0)
   end subroutine test_gaps

   function told(ranges) result(text)
      type(range_of_members_t), intent(in) :: ranges(:)
      character(len=:), allocatable :: text
      character(len=24) :: piece
      integer :: k

      text = ''
      do k = 1, size(ranges)
         write (piece, '(2(1x,i0))') ranges(k)%first, ranges(k)%last
         text = text//trim(piece)
      end do
   end function told

   !> Threads, and a job array of seven parts.
   subroutine test_bytes()
      character(len=*), parameter :: part = '--only $((1 + 58*k)):$((58*(k + 1)))'
      character(len=:), allocatable :: table
      integer :: k

      outcome = run('OMP_NUM_THREADS=1 "'//program_path//'" ensemble case.nml --out one')
      call check('one thread', outcome%status == 0 .and. outcome%err == '', outcome%err)
      table = read_file('one/members.csv')
      call check('a row for each parameter of each member', line_count(table) == 801 .and. &
         all([(number(field(table, 2*k, 1)) >= k .and. number(field(table, 2*k, 1)) <= k, &
         k=1, 400)]))
      call check('outputs of one kind', exists('one/manifest.txt') .and. &
         exists('one/ensemble.csv') .and. read_file('one/summary.txt') == outcome%out)
      outcome = run('for n in 2 3; do OMP_NUM_THREADS=$n "'//program_path// &
         '" ensemble case.nml --out threads && cmp one/members.csv threads/members.csv && '// &
         'cmp one/summary.txt threads/summary.txt && rm -r threads || exit 1; done')
      call check('two and three threads: the same bytes', outcome%status == 0, outcome%err)
      ! The parts in no order, two of them at a time.
      outcome = run('for k in 6 0 3; do "'//program_path//'" ensemble case.nml --out parts '// &
         part//' & done; wait; test ! -e parts/members.csv && for k in 1 5 2 4; do "'// &
         program_path//'" ensemble case.nml --out parts '//part//' & done; wait; '// &
         'cmp one/members.csv parts/members.csv && cmp one/ensemble.csv parts/ensemble.csv')
      call check('seven parts: the same bytes', outcome%status == 0, outcome%err)
      call check('whole parts leave nothing temporary', index(run_out('ls -A parts/shards parts'), &
         '.part') == 0)
      outcome = run('f=$(ls -d parts/shards/*-1-*); sed -i 2s/ok/OK/ $f; "'//program_path// &
         '" ensemble case.nml --out parts --quiet && cmp one/members.csv parts/members.csv')
      call check('a damaged shard is told, and made again', outcome%status == 0 .and. &
         has_all(outcome%err, 'found a damaged shard|its members are computed again'), outcome%err)
   end subroutine test_bytes

   function run_out(command) result(text)
      character(len=*), intent(in) :: command
      character(len=:), allocatable :: text

      outcome = run(command)
      text = outcome%out
   end function run_out

   !> SIGKILL at random moments; what ended unharmed is run again from the beginning.
   subroutine test_kills()
      integer :: kills, wanted, attempt
      character(len=8) :: seconds
      real(wp) :: longest

      wanted = 3
      if (in_long_run()) wanted = 20
      call write_file('many.nml', ensemble(3000)//draw)
      longest = duration('"'//program_path//'" ensemble many.nml --out whole --quiet')
      call start_random(4711)
      kills = 0
      do attempt = 1, 20*wanted
         write (seconds, '(f8.3)') between(0.0_wp, longest)
         outcome = run('"'//program_path//'" ensemble many.nml --out killed --quiet >/dev/null '// &
            '& p=$!; sleep '//trim(adjustl(seconds))//'; kill -9 $p; wait $p')
         if (outcome%status == 137) kills = kills + 1
         if (outcome%status /= 137) then
            outcome = run('cmp whole/members.csv killed/members.csv')
            call check('between kills: ended, the same bytes', outcome%status == 0, outcome%err)
            call remove_tree('killed')
         end if
         if (kills == wanted) exit
      end do
      call check('kills', kills == wanted)
      outcome = run('"'//program_path//'" ensemble many.nml --out killed --quiet && '// &
         'cmp whole/members.csv killed/members.csv && cmp whole/summary.txt killed/summary.txt '// &
         '&& ls -A killed/shards')
      call check('resumed: the same bytes', outcome%status == 0, outcome%err)
      call check('kills leave nothing temporary', index(outcome%out, '.part') == 0)
   end subroutine test_kills

   !> Seconds that a command takes.
   real(wp) function duration(command)
      character(len=*), intent(in) :: command

      outcome = run('date +%s%N; '//command//' >/dev/null; date +%s%N')
      duration = 1e-9_wp*(number(line(outcome%out, 2)) - number(line(outcome%out, 1)))
   end function duration

   !> The same by Open MPI.
   subroutine test_mpi()
      character(len=:), allocatable :: mpi

      mpi = 'BEAMID_PROGRAM="'//program_path//'" ../../scripts/ensemble_mpi.py -n 2 '
      outcome = run('command -v mpiexec && { /usr/bin/python3 -c "import mpi4py" || python3 -c '// &
         '"import mpi4py"; }')
      if (outcome%status /= 0 .or. python_with('sys') == '') then
         call skip('ensemble_mpi.py', 'no mpiexec or no mpi4py, as by scripts/setup.sh mpi')
         return
      end if
      outcome = run(mpi//'case.nml --out ranks && cmp one/members.csv ranks/members.csv && '// &
         'cmp one/summary.txt ranks/summary.txt')
      call check('two workers: the same bytes', outcome%status == 0, outcome%err)
      outcome = run(mpi//'none.nml --out none')
      call check('a case that is refused', outcome%status == 2 .and. &
         has_all(outcome%err, 'none.nml: found no such file') .and. .not. exists('none'), &
         outcome%err)
      if (in_long_run()) call kill_ranks(mpi//'many.nml --out lost')
   end subroutine test_mpi

   !> SIGKILL to one rank, or to all of them and mpiexec, at random moments.
   subroutine kill_ranks(command)
      character(len=*), intent(in) :: command
      character(len=*), parameter :: which(0:1) = [character(len=30) :: '$m $r', &
         '$(echo "$r" | tail -n 1)']
      integer, parameter :: wanted = 20
      character(len=8) :: seconds
      real(wp) :: longest
      integer :: attempt, kills

      longest = duration(command)
      call remove_tree('lost')
      kills = 0
      do attempt = 1, 10*wanted
         write (seconds, '(f8.3)') between(0.0_wp, longest)
         ! The ranks are children of mpiexec, which is the child of the script; it may wait for ever
         ! for ranks that died before they had begun.
         outcome = run(command//' & p=$!; sleep '//trim(adjustl(seconds))//'; '// &
            'm=$(pgrep -P $p); r=$(pgrep -P ${m:-$p}) && kill -9 '//trim(which(mod(attempt, 2)))// &
            '; timeout 30 tail -f /dev/null --pid=$p || kill -9 $m; wait $p')
         if (outcome%status /= 0) then
            kills = kills + 1
         else
            outcome = run('cmp whole/members.csv lost/members.csv')
            call check('between kills of ranks: ended, the same bytes', outcome%status == 0, &
               outcome%err)
            call remove_tree('lost')
         end if
         if (kills == wanted) exit
      end do
      call check('kills of ranks', kills == wanted)
      outcome = run(command//' && cmp whole/members.csv lost/members.csv')
      call check('resumed: the same bytes', outcome%status == 0, outcome%err)
   end subroutine kill_ranks

   !> Small noise, where linear theory holds: of 400 intervals of 95 % each 380 hold the truth, with
   !> a deviation of 4.4, of which three make 3.3 %; the sd of 400 estimates has a relative error of
   !> 1/sqrt(800) = 3.5 %, three times that is 10.6 %; a mean lies within three of its errors.
   subroutine test_intervals()
      character(len=:), allocatable :: table
      integer :: k

      call write_file('still.nml', replaced(ensemble(400), 'sd=0.02', 'sd=0.002'))
      outcome = beamid('ensemble still.nml --out still')
      call check('noise alone', outcome%status == 0, outcome%err)
      table = read_file('still/ensemble.csv')
      do k = 1, 2
         call check_close('coverage of '//field(table, k, 2), number(field(table, k, 9)), &
            0.95_wp, 0.033_wp)
         call check_close('sd over standard error of '//field(table, k, 2), &
            number(field(table, k, 5))/number(field(table, k, 6)), 1.0_wp, 0.106_wp)
         call check('no bias of '//field(table, k, 2), abs(number(field(table, k, 7))) <= &
            3*number(field(table, k, 8)), field(table, k, 7))
      end do
      call check('the truth is the case''s', field(read_file('still/members.csv'), 1, 12) == &
         '8.0000000000000000E+001')
      call write_file('modes.nml', beam//'&ensemble command=''modes'', members=20 /'//nl//draw)
      outcome = beamid('ensemble modes.nml --out modes')
      call check('modes', outcome%status == 0 .and. lines_with(read_file('modes/members.csv'), &
         'frequency_1') == 20, outcome%err)
   end subroutine test_intervals

   !> A sensor that is drawn beyond the end of the beam.
   subroutine test_failed_members()
      character(len=:), allocatable :: table

      call write_file('some.nml', ensemble(40)//'&draw parameter=''length'', low=3.5, high=4 /'// &
         nl//'&sensor x_S=3 /'//nl//'&draw parameter=''x_S'', low=3, high=4 /'//nl)
      outcome = beamid('ensemble some.nml --out some')
      table = read_file('some/members.csv')
      call check('some fail, the run goes on', outcome%status == 0 .and. &
         has_all(outcome%out, 'members failed; the first is member'), outcome%err)
      call check('a failed member is one row', lines_with(table, ',failed,') > 0 .and. &
         2*lines_with(table, ',failed,') + lines_with(table, ',ok,') == 80)
      call check('its message is quoted', lines_with(table, ',failed,') == lines_with(table, &
         ',failed,"|",,,,,,,,,') .and. lines_with(table, ',failed,"x_S: found |, expected a '// &
         'place above 0, up to the length |",,,,,,,,,') > 0)
      call write_file('all.nml', replaced(replaced(read_file('some.nml'), 'high=4 /'//nl// &
         '&sensor', 'high=3.6 /'//nl//'&sensor'), 'low=3, ', 'low=3.8, '))
      outcome = beamid('ensemble all.nml --out all')
      call check('all fail: status 1', outcome%status == 1 .and. .not. exists('all/members.csv') &
         .and. has_all(outcome%err, 'all.nml: every member failed; member 1:'), outcome%err)
   end subroutine test_failed_members

   subroutine test_bad_input()
      call refused('case.nml --only 5:2', 'command line: --only: found ''5:2''|expected i:j')
      call refused('case.nml --only 0:2', 'found ''0:2''')
      call refused('case.nml --only 401:500', 'found ''401:500''|from 1 to 400')
      call refused('case.nml --only 1-4', 'found ''1-4''')
      call refused('case.nml --only', 'found ''''')
      call refused('case.nml --only-new', 'case.nml:8: &ensemble cases: found nothing')
      call changed('members=400', 'members=0', 'bad.nml:8: &ensemble members: found 0|expected 1')
      call changed('low=0.13', 'low=0.18', 'bad.nml:9: &draw high: found 0.17|at least low = 0.18')
      call changed('low=0.13', 'low=-1', 'bad.nml:9: &draw low: m_T: found -1|expected 0 or more')
      call changed('''m_T'', low', '''m_X'', low', 'bad.nml:9: &draw parameter: found ''m_X''')
      call changed('''m_T'', low', '''m_H'', low', 'bad.nml:9: &draw parameter|a &hose group')
      call changed('members=400', 'cases=''none.txt''', 'bad.nml:8: &ensemble cases: |none.txt'// &
         ': found no such file')
      call changed('t_step=0.05', '', 'bad.nml:5: &record: found neither a file nor')
      call changed('sd=0.02 /'//nl//stage, 'sd=0 /'//nl, 'bad.nml: &stage: found no such group')
      call write_file('bad.nml', replaced(ensemble(4), noise, ''))
      call refused('bad.nml', 'bad.nml:7: &ensemble: found neither &draw nor &noise')
      call write_file('bad.nml', '&ensemble members=3 /'//nl)
      call refused('bad.nml', 'bad.nml:1: &ensemble: found no group &beam')
      call write_file('bad.nml', beam)
      call refused('bad.nml', 'bad.nml: &ensemble: found no such group')
      outcome = beamid('modes bad.nml --only 1:2')
      call check('--only elsewhere', outcome%status == 2 .and. has_all(outcome%err, &
         'modes: found --only'), outcome%err)
   end subroutine test_bad_input

   !> The case with something else in it.
   subroutine changed(old, new, words)
      character(len=*), intent(in) :: old, new, words

      call write_file('bad.nml', replaced(ensemble(400)//draw, old, new))
      call refused('bad.nml', words)
   end subroutine changed

   !> Status 2, one line, nothing written.
   subroutine refused(arguments, words)
      character(len=*), intent(in) :: arguments, words

      outcome = beamid('ensemble '//arguments//' --out bad')
      if (arguments == 'case.nml --only') outcome = beamid('ensemble --out bad case.nml --only')
      call check(arguments//': refused', outcome%status == 2 .and. outcome%out == '' .and. &
         line_count(outcome%err) == 1 .and. has_all(outcome%err, words) .and. &
         .not. exists('bad'), outcome%err)
   end subroutine refused

   !> Members of another text are not mixed in, and go once the new ones are whole.
   subroutine test_another_case()
      call write_file('case.nml', ensemble(400)//draw//'! changed'//nl)
      outcome = beamid('ensemble case.nml --out one --only 1:10')
      call check('another text: told, and begun anew', outcome%status == 0 .and. &
         has_all(outcome%err, 'one/shards: found members of another case') .and. &
         has_all(outcome%out, 'members 1 to 10 of 400 are done'), outcome%err)
      outcome = beamid('ensemble case.nml --out one --quiet')
      call check('whole again', outcome%status == 0 .and. index(outcome%err, 'another') > 0)
      outcome = beamid('ensemble case.nml --out one')
      call check('the older ones are gone', outcome%status == 0 .and. outcome%err == '', &
         outcome%err)
   end subroutine test_another_case

   !> Three beams, of which one changes its tip and one has no record.
   subroutine test_fleet()
      character(len=:), allocatable :: before, table

      call make_record('a', '0.15')
      call make_record('b', '0.15')
      call write_file('fleet/c/case.nml', fleet_case())
      call write_file('fleet/list.txt', '# beams'//nl//'a/case.nml'//nl//nl//'b/case.nml ! 2'//nl &
         //'c/case.nml')
      call write_file('fleet/fleet.nml', '&ensemble cases=''list.txt'' /'//nl)
      outcome = beamid('ensemble fleet/fleet.nml --out known')
      before = read_file('known/members.csv')
      call check('a fleet', outcome%status == 0 .and. lines_with(before, ',ok,') == 4 .and. &
         lines_with(before, '3,failed|c/record.csv') == 1, outcome%err//before)
      outcome = run('"'//program_path//'" identify fleet/a/case.nml --out single --quiet')
      table = read_file('single/estimates.csv')
      ! identify compares derivatives with differences first, and its search begins with other roots
      ! at hand: both end within the tolerance of a search, 1e-10 of J and of the parameters.
      call check_close('as identify has it', number(field(before, 1, 6))/number(field(table, 1, &
         6)), 1.0_wp, 1e-9_wp)
      call check_close('the total interval too', number(field(before, 1, 11))/number(field( &
         table, 1, 17)), 1.0_wp, 1e-8_wp)
      outcome = beamid('ensemble fleet/fleet.nml --out known --only-new')
      call check('nothing new', outcome%status == 0 .and. has_all(outcome%out, &
         '1 of 3 cases are new|no estimate has moved') .and. read_file('known/members.csv') == &
         before, outcome%out//outcome%err)
      call make_record('b', '0.16')
      call make_record('c', '0.15')
      outcome = beamid('ensemble fleet/fleet.nml --out known --only-new')
      table = read_file('known/changed.csv')
      call check('a new record and a changed one', outcome%status == 0 .and. has_all(outcome%out, &
         '2 of 3 cases are new|moved: b/case.nml: m_T') .and. line_count(table) == 2 .and. &
         has_all(line(table, 2), '2,b/case.nml,2,m_T,'), outcome%out//outcome%err)
      call check_close('what moved', number(field(table, 1, 8)), 0.16_wp, 0.003_wp)
   end subroutine test_fleet

   function fleet_case() result(text)
      character(len=:), allocatable :: text

      text = beam//replaced(samples, '&record', '&record file=''record.csv'',')//stage
   end function fleet_case

   !> A record of a beam with this tip.
   subroutine make_record(name, m_T)
      character(len=*), intent(in) :: name, m_T

      call write_file('truth.nml', replaced(beam, 'm_T=0.15', 'm_T='//m_T)//samples// &
         '&noise sd=0.01, seed=1 /'//nl)
      outcome = beamid('simulate truth.nml --out truth --quiet')
      call write_file('fleet/'//name//'/record.csv', read_file('truth/record.csv'))
      call write_file('fleet/'//name//'/case.nml', fleet_case())
   end subroutine make_record

end program test_ensemble
