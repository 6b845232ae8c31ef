!> The outputs of one run exchanged for those of another, while the program is killed, signalled or
!> refused a call of the system at every step: what is left is one whole run or has no manifest, and
!> the next run leaves nothing else.
!>
!> A library in front of the C library (LD_PRELOAD) counts the calls and acts at one of them. In the
!> long run the program is killed at 300 random moments instead of 24, and at every pair of calls of
!> two runs.
program test_exchange
   use beamid_strings, only: to_text
   use checks, only: check, finish, in_long_run, skip
   use shell, only: close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, read_file, remove_tree, run, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10)
   !> WATCH: names of calls; AT: the number of the one that is hit, or of the first with FROM set;
   !> SIGNAL: what the program gets before it, or ERROR: what it returns. NO_LINKS: as on FAT.
   character(len=*), parameter :: library = &
      '#define _GNU_SOURCE'//nl// &
      '#include <dlfcn.h>'//nl// &
      '#include <errno.h>'//nl// &
      '#include <signal.h>'//nl// &
      '#include <stdlib.h>'//nl// &
      '#include <string.h>'//nl// &
      '#include <unistd.h>'//nl// &
      'static int value(const char *name) { char *s = getenv(name); return s ? atoi(s) : 0; }'// &
      nl// &
      'static int refused(const char *name, const char *path) {'//nl// &
      '   static int calls = 0;'//nl// &
      '   const char *watched = getenv("WATCH");'//nl// &
      '   if (value("NO_LINKS") && !strcmp(name, " link")) { errno = EPERM; return 1; }'//nl// &
      '   if (!watched || !strstr(watched, name) || !strstr(path, "work")) return 0;'//nl// &
      '   calls++;'//nl// &
      '   if (calls != value("AT") && !(value("FROM") && calls > value("AT"))) return 0;'//nl// &
      '   if (value("SIGNAL")) kill(getpid(), value("SIGNAL"));'//nl// &
      '   errno = value("ERROR");'//nl// &
      '   return errno != 0;'//nl// &
      '}'//nl// &
      '#define CALL(name, declared, passed, path) int name declared { \'//nl// &
      '   int (*real) declared; *(void **) &real = dlsym(RTLD_NEXT, #name); \'//nl// &
      '   return refused(" " #name, path) ? -1 : real passed; }'//nl// &
      'CALL(rename, (const char *a, const char *b), (a, b), a)'//nl// &
      'CALL(link, (const char *a, const char *b), (a, b), a)'//nl// &
      'CALL(unlink, (const char *a), (a), a)'//nl// &
      'CALL(rmdir, (const char *a), (a), a)'//nl// &
      'CALL(mkdir, (const char *a, mode_t m), (a, m), a)'//nl// &
      'CALL(creat, (const char *a, mode_t m), (a, m), a)'//nl// &
      'CALL(fsync, (int f), (f), "work")'//nl
   !> Debian 13's SUNDIALS brings MPI along, and that UCX, which takes SIGHUP for itself to begin a
   !> log unless it is told not to.
   character(len=*), parameter :: quiet = 'UCX_DEBUG_SIGNO=0 '
   !> Puts the library in front of one that is loaded already, as in a run with perturbed results.
   character(len=*), parameter :: preload = &
      'LD_PRELOAD="$PWD/calls.so${LD_PRELOAD:+:$LD_PRELOAD}"'
   character(len=*), parameter :: all_calls = ' mkdir creat fsync rename link unlink rmdir'
   character(len=*), parameter :: case_text = &
      '&beam length=4.0, rho=0.03, E=80.0, I=1.0 /'//nl//'&discretization elements=2 /'//nl// &
      '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl// &
      '&record t_first=0.1, t_last=0.6, t_step=0.1 /'//nl
   !> `older` and `newer` hold the outputs of two runs, of one command by the names in the manifest:
   !> one file of both, one of the newer only, three of the older only. `work` becomes either.
   character(len=*), parameter :: again = 'rm -rf work && cp -r older work && ', &
      like_older = 'diff -r older work', like_newer = 'diff -r newer work', &
      hidden = ' -x ".beamid-*"'
   character(len=:), allocatable :: reason, newer_run

   call open_shell(reason)
   if (reason == '') call set_up(reason)
   if (reason /= '') then
      call skip('exchange', reason)
   else
      call test_kill_at_every_step()
      call test_signals()
      call test_refused_calls('')
      call test_refused_calls('NO_LINKS=1 ')
      call test_broken_folder()
      call test_random_moments(merge(300, 24, in_long_run()))
      if (in_long_run()) call test_kill_twice()
      call test_two_at_once()
      call test_others()
   end if
   call close_shell()
   call finish('exchange')

contains

   !> The library and the two folders; without a C compiler there is a reason to skip.
   subroutine set_up(reason)
      character(len=:), allocatable, intent(inout) :: reason
      type(outcome_t) :: outcome

      call write_file('calls.c', library)
      outcome = run('cc -shared -fPIC -o calls.so calls.c -ldl')
      if (outcome%status /= 0) reason = 'no C compiler: '//outcome%err
      call write_file('case.nml', case_text)
      newer_run = '"'//program_path//'" modes case.nml --quiet --out '
      outcome = run(newer_run//'newer && "'//program_path//'" simulate case.nml --quiet --out '// &
         'older && sed -i s/simulate/modes/ older/manifest.txt')
      call check('two runs', outcome%status == 0, outcome%err)
      outcome = run('for f in $(tail -n +2 newer/manifest.txt | cut -d" " -f1); do echo "$f" '// &
         '$(gzip -nc "newer/$f" | tail -c 8 | od -An -v -t u1) modes; done')
      call check('size and checksum as gzip has them', outcome%status == 0 .and. &
         decimal(read_file('newer/manifest.txt')) == outcome%out)
   end subroutine set_up

   !> A manifest without its header, with the bytes of checksum and size as gzip writes them, the
   !> lowest first, in decimal.
   function decimal(manifest) result(text)
      character(len=*), intent(in) :: manifest
      character(len=:), allocatable :: text
      character(len=100) :: words(4), line
      integer :: first, last, bytes, k, values(8)

      text = ''
      first = index(manifest, nl) + 1
      do while (first < len(manifest))
         last = first + index(manifest(first:), nl) - 2
         read (manifest(first:last), *) words
         read (words(3), '(4z2)') values(4:1:-1)
         read (words(2), *) bytes
         values(5:) = [(mod(bytes/256**k, 256), k=0, 3)]
         write (line, '(a,8(1x,i0),1x,a)') trim(words(1)), values, trim(words(4))
         text = text//trim(line)//nl
         first = last + 2
      end do
   end function decimal

   !> Runs the newer run in `work`, hit at a call.
   function hit(calls, at, what) result(outcome)
      character(len=*), intent(in) :: calls, what
      integer, intent(in) :: at
      type(outcome_t) :: outcome

      outcome = run(quiet//'OMP_NUM_THREADS=1 env --default-signal=HUP,INT,TERM '// &
         preload//' WATCH="'//calls//'" AT='//to_text(at)//' '//what//' '// &
         newer_run//'work')
   end function hit

   !> What a run that died leaves has no manifest or is one whole run; it can be taken back to the
   !> older run as long as the newer one has not ended, and the next run leaves only its own.
   subroutine test_kill_at_every_step()
      type(outcome_t) :: outcome
      integer :: at, whole, taken_back, next
      logical :: ended

      whole = 0
      taken_back = 0
      next = 0
      do at = 1, 100
         outcome = run(again//'true')
         outcome = hit(all_calls, at, 'SIGNAL=9')
         if (outcome%status == 0) exit
         ended = succeeds(like_newer//hidden)
         if (.not. exists('work/manifest.txt') .or. ended .or. &
            succeeds(like_older//hidden)) whole = whole + 1
         ! The next run takes back first what was begun; this one is then refused its own file.
         outcome = hit(' creat', 1, 'ERROR=28')
         if (outcome%status == 1 .and. (ended .or. succeeds(like_older))) &
            taken_back = taken_back + 1
         outcome = hit('', 0, '')
         if (outcome%status == 0 .and. succeeds(like_newer)) next = next + 1
      end do
      call check('kill -9 at every call: there are some', at > 20, to_text(at - 1)//' calls')
      call check('kill -9 at every call: one whole run or no manifest', whole == at - 1)
      call check('kill -9 at every call: the older run is not lost', taken_back == at - 1)
      call check('kill -9 at every call: the next run leaves its files only', next == at - 1)
   end subroutine test_kill_at_every_step

   !> Signals wait until the new files are there, and then end the program.
   subroutine test_signals()
      integer, parameter :: numbers(*) = [1, 2, 15]
      type(outcome_t) :: outcome
      integer :: at, k, whole

      do k = 1, size(numbers)
         whole = 0
         do at = 1, 100
            outcome = run(again//'true')
            outcome = hit(' rename', at, 'SIGNAL='//to_text(numbers(k)))
            if (outcome%status == 0) exit
            if (outcome%status == 128 + numbers(k) .and. outcome%out == '' .and. &
               succeeds(like_newer)) whole = whole + 1
         end do
         call check('signal '//to_text(numbers(k))//' at every rename: waits, then acts', &
            at > 5 .and. whole == at - 1, to_text(whole)//' of '//to_text(at - 1))
      end do
      outcome = run(again//'true')
      outcome = run(quiet//preload//' WATCH=" rename" AT=3 SIGNAL=1 env '// &
         '--ignore-signal=HUP '//newer_run//'work')
      call check('an ignored signal does nothing', outcome%status == 0 .and. outcome%out == &
         read_file('work/summary.txt'), outcome%err)
   end subroutine test_signals

   !> Whichever call is refused once, before the new files have their names: a failure in one line,
   !> and all as it was. Removing the temporary folder is no part of that.
   subroutine test_refused_calls(links)
      character(len=*), intent(in) :: links
      type(outcome_t) :: outcome
      integer :: at, whole

      whole = 0
      do at = 1, 100
         outcome = run(again//'true')
         outcome = hit(' mkdir creat fsync rename', at, links//'ERROR=5')
         if (outcome%status == 0) exit
         if (outcome%status == 1 .and. outcome%out == '' .and. line_count(outcome%err) == 1 .and. &
            has_all(outcome%err, 'work: the output folder cannot be written: Input/output error') &
            .and. succeeds(like_older)) whole = whole + 1
      end do
      call check(links//'a call refused: the older files are whole', at > 15 .and. &
         whole == at - 1, to_text(whole)//' of '//to_text(at - 1))
      call check(links//'and the last run has ended', succeeds(like_newer), outcome%err)
   end subroutine test_refused_calls

   !> From some rename on no other succeeds: the older files are put back by the next run.
   subroutine test_broken_folder()
      type(outcome_t) :: outcome
      integer :: at, told, taken_back

      told = 0
      taken_back = 0
      do at = 2, 7
         outcome = run(again//'true')
         outcome = hit(' rename', at, 'FROM=1 NO_LINKS=1 ERROR=5')
         if (outcome%status == 1 .and. has_all(outcome%err, &
            'Input/output error; older files are in work/.beamid-') .and. &
            .not. exists('work/manifest.txt')) told = told + 1
         outcome = hit(' rename', 1, 'FROM=1 ERROR=5')
         if (outcome%status == 1 .and. index(outcome%err, 'older files are in work/') > 0) &
            told = told + 1
         outcome = hit(' creat', 1, 'ERROR=28')
         if (succeeds(like_older)) taken_back = taken_back + 1
      end do
      call check('no rename any more: the message says where the older files are', told == 12, &
         to_text(told))
      call check('no rename any more: the next run puts them back', taken_back == 6)
   end subroutine test_broken_folder

   !> Killed again while the next run takes back, or later.
   subroutine test_kill_twice()
      type(outcome_t) :: outcome
      integer :: first, second, n, whole

      n = 0
      whole = 0
      do first = 1, 100
         do second = 1, 100
            outcome = run(again//'true')
            outcome = hit(all_calls, first, 'SIGNAL=9')
            if (outcome%status == 0) exit
            outcome = hit(all_calls, second, 'SIGNAL=9')
            if (outcome%status == 0) exit
            n = n + 1
            outcome = hit(' creat', 1, 'ERROR=28')
            if (.not. (succeeds(like_older) .or. succeeds(like_newer))) cycle
            outcome = hit('', 0, '')
            if (outcome%status == 0 .and. succeeds(like_newer)) whole = whole + 1
         end do
         if (second == 1) exit
      end do
      call check('kill -9 at every pair of calls: no run is lost', n > 400 .and. whole == n, &
         to_text(whole)//' of '//to_text(n))
   end subroutine test_kill_twice

   !> Killed at any time of its life. The time that one run takes is only to choose the moments.
   subroutine test_random_moments(moments)
      integer, intent(in) :: moments
      character(len=10) :: seconds
      type(outcome_t) :: outcome
      integer :: begin, end, rate

      call system_clock(begin, rate)
      outcome = hit('', 0, '')
      call system_clock(end)
      write (seconds, '(f10.6)') real(end - begin)/rate
      call write_file('moments.sh', 'export OMP_NUM_THREADS=1; good=0'//nl// &
         'for t in $(awk "BEGIN { srand(1); for (k = 0; k < '//to_text(moments)//'; k++) '// &
         'print rand()*'//trim(adjustl(seconds))//' }"); do'//nl// &
         again//'true'//nl// &
         'for run in 1 2; do'//nl// &
         '   '//newer_run//'work >stdout & sleep "$t"; kill -9 $!; wait $!'//nl// &
         'done'//nl// &
         '{ [ ! -e work/manifest.txt ] || '//like_older//hidden//' || '//like_newer//hidden// &
         '; } >stdout && '// &
         newer_run//'work >stdout && '//like_newer//' && good=$((good + 1))'//nl// &
         'done; echo "$good"'//nl)
      outcome = run('sh moments.sh')
      call check('killed at random moments', outcome%out == to_text(moments)//nl, &
         outcome%out(:max(0, len(outcome%out) - 1))//' of '//to_text(moments)//' are whole')
   end subroutine test_random_moments

   !> Two runs that make the same folders and write to them at once: both succeed, one of them last.
   subroutine test_two_at_once()
      type(outcome_t) :: outcome
      integer, parameter :: times = 50

      call write_file('two.sh', 'export OMP_NUM_THREADS=1; good=0'//nl// &
         'sed s/elements=2/elements=3/ case.nml >finer.nml'//nl// &
         'run_finer() { "'//program_path//'" modes finer.nml --out "$1"; }'//nl// &
         'run_finer finer >stdout'//nl// &
         'for k in $(seq '//to_text(times)//'); do'//nl//'rm -rf twice'//nl// &
         newer_run//'twice/at/once >stdout & first=$!'//nl// &
         'run_finer twice/at/once >stdout_2 & second=$!'//nl// &
         'wait $first && wait $second && { diff -r newer twice/at/once || '// &
         'diff -r finer twice/at/once; } >stdout && good=$((good + 1))'//nl// &
         'done; echo "$good"'//nl)
      outcome = run('sh two.sh')
      call check('two runs make the same folder', outcome%out == to_text(times)//nl, &
         outcome%out(:max(0, len(outcome%out) - 1))//' of '//to_text(times)//' '//outcome%err)
   end subroutine test_two_at_once

   !> What only looks like a temporary folder of this program stays.
   subroutine test_others()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: before

      call remove_tree('work')
      outcome = run('mkdir work && cd work && mkdir .beamid .beamid-1 ".beamid-$(hostname)-" '// &
         '".beamid-$(hostname)-1x" .beamid-elsewhere-17 && touch ".beamid-$(hostname)-12" '// &
         '.beamid-elsewhere-17/old-fit.csv fit.csv.new-12 fit.csv.old-12 && ls -AR >../before')
      before = read_file('before')
      outcome = hit('', 0, '')
      call check('files of others: the run', outcome%status == 0, outcome%err)
      outcome = run('cd work && rm manifest.txt modes.csv shapes.csv '// &
         'attachments.csv case.txt labels.csv summary.txt && ls -AR')
      call check('files of others stay', outcome%out == before)
   end subroutine test_others

   logical function succeeds(command)
      character(len=*), intent(in) :: command
      type(outcome_t) :: outcome

      outcome = run(command)
      succeeds = outcome%status == 0
   end function succeeds

end program test_exchange
