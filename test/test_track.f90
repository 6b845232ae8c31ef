!> A parameter that is followed through a long record: the equations of a window against LAPACK, and
!> the command `track` on a support that moves once, from a file and from standard input.
program test_track
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgels
   use beamid_sample_streams, only: new_sample_stream, sample_stream_t
   use beamid_segments, only: new_segments, segments_t, step_t
   use checks, only: check, check_close, finish, skip
   use random_numbers, only: start_random
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, read_file, replaced, run, write_file
   use tables, only: field, number
   implicit none

   character(len=*), parameter :: nl = new_line('a')
   !> A cantilever on a rigid support, and a case that follows the support. The mesh has an error.
   character(len=*), parameter :: beam = &
      '&beam length=0.5, rho=2.67, E=2e11, width=0.05, height=0.0066, c_D=5e6 /'//nl// &
      '&sensor m_S=0.03, x_S=0.34 /'//nl//'&discretization degree=5, elements=12 /'//nl
   character(len=*), parameter :: track = beam//'&support x_P=0.09 /'//nl// &
      '&excitation kind=''free'', modes=2 /'//nl//'&record file=''both.csv'' /'//nl// &
      '&stage free=''x_P'',''c_D'',''offset'' /'//nl// &
      '&track parameter=''x_P'', window=0.3, hop=0.02, rate=0.05 /'//nl
   real(wp), parameter :: places(2) = [0.1_wp, 0.12_wp]
   character(len=:), allocatable :: reason

   call start_random(20261126)
   call test_segments()
   call test_stream()
   call open_shell(reason)
   if (reason /= '') then
      call skip('the command track', reason)
   else
      call make_record()
      call test_file()
      call test_window()
      call test_input()
      call test_refusals()
      call close_shell()
   end if
   call finish('track')

contains

   !> The step is the least-squares solution of LAPACK, also with a further row and with an unknown
   !> that is held; the residuals behind it are those of the rows. Round-off of normal equations of
   !> a condition of about 10: 1e-12.
   subroutine test_segments()
      integer, parameter :: m = 403, p = 5, count = 7
      real(wp) :: jac(m + 1, p), r(m + 1), a(m + 1, p), b(m + 1, 1), work(1000), left(m), scatter
      type(segments_t) :: segments
      type(step_t) :: step
      integer :: first, info, k, last

      call random_number(jac)
      call random_number(r)
      jac(m + 1, :) = 0
      jac(m + 1, 2) = 3
      segments = new_segments(jac, r, m, count)
      call check('all rows are in segments', sum(segments%rows) == m)
      step = segments%step(1, count, spread(.false., 1, p))
      a = jac
      b(:, 1) = -r
      call dgels('N', m + 1, p, 1, a, m + 1, b, m + 1, work, size(work), info)
      call check_close('a step', norm2(step%change - b(:p, 1)), 0.0_wp, 1e-12_wp)
      left = r(:m) + matmul(jac(:m, :), step%change)
      call check_close('residuals behind it', sum(segments%sums_of_squares(step%change)), &
         sum(left**2), 1e-12_wp*sum(r**2))
      scatter = 0
      last = 0
      do k = 1, count
         first = last + 1
         last = nint(real(k, wp)*m/count)
         scatter = scatter + dot_product(matmul(jac(first:last, :), step%inverse(4, :)), &
            left(first:last))**2
      end do
      scatter = scatter*count/(count - 1) + 0.3_wp*(3*step%inverse(4, 2))**2
      call check_close('robust variance', segments%robust_variance(4, step, 0.3_wp), scatter, &
         1e-12_wp*scatter)
      step = segments%step(1, count, [.false., .false., .true., .false., .false.])
      a(:, :4) = jac(:, [1, 2, 4, 5])
      b(:, 1) = -r
      call dgels('N', m + 1, 4, 1, a, m + 1, b, m + 1, work, size(work), info)
      call check_close('a step with an unknown held', norm2(step%change([1, 2, 4, 5]) - b(:4, 1)), &
         0.0_wp, 1e-12_wp)
      call check('which does not change', .not. abs(step%change(3)) > 0)
   end subroutine test_segments

   !> Text in pieces that end anywhere gives the samples of the whole text.
   subroutine test_stream()
      character(len=*), parameter :: text = 'a recorder'//nl//'time [s];count;a [m/s^2]'//nl// &
         '0,0;7;1,5'//nl//nl//'# a remark'//nl//'0,1;7;-2,25'//nl//'0,2;7;3,125'//nl//'0,3;7;4'
      type(sample_stream_t) :: stream
      type(error_t), allocatable :: error
      real(wp), allocatable :: t(:), z(:), all_t(:), all_z(:)
      integer :: at, length

      do length = 1, 23, 11
         stream = new_sample_stream('input', [character(len=4) :: 'time', 'a'])
         allocate (all_t(0), all_z(0))
         do at = 1, len(text), length
            call stream%take(text(at:min(at + length - 1, len(text))), t, z, error)
            if (allocated(error)) exit
            all_t = [all_t, t]
            all_z = [all_z, z]
         end do
         ! The last line has no end: it may be cut off inside a number.
         if (.not. allocated(error)) then
            call check('samples of a stream', are_equal(all_t, [0.0_wp, 0.1_wp, 0.2_wp]) .and. &
               are_equal(all_z, [1.5_wp, -2.25_wp, 3.125_wp]))
         else
            call check('a stream', .false., error%message)
         end if
         deallocate (all_t, all_z)
      end do
      stream = new_sample_stream('input', [character(len=4) :: '', ''])
      call stream%take('t,a'//nl//'1,2'//nl//'1,3'//nl, t, z, error)
      call check('times that do not increase', allocated(error))
      if (allocated(error)) call check('and where', has_all(error%message, &
         'input:3|found t = 1 after 1|expected a larger number'), error%message)
   end subroutine test_stream

   !> Returns whether two arrays have the same size and elements.
   pure logical function are_equal(x, y)
      real(wp), intent(in) :: x(:), y(:)

      are_equal = size(x) == size(y)
      if (are_equal) are_equal = .not. any(abs(x - y) > 0)
   end function are_equal

   !> Two free decays of one second each, with the support at two places.
   subroutine make_record()
      type(outcome_t) :: outcome
      character(len=4) :: place
      integer :: k

      do k = 1, 2
         write (place, '(f4.2)') places(k)
         call write_file('dwell.nml', beam//'&support x_P='//place//' /'//nl// &
            '&excitation kind=''release'', displacement=0.001 /'//nl//'&noise sd=0.05, seed='// &
            achar(48 + k)//' /'//nl//'&record t_first=0.0005, t_last=1, t_step=0.0005 /'//nl)
         outcome = beamid('simulate dwell.nml --quiet --out out/dwell'//achar(48 + k))
         call check('a dwell is simulated', outcome%status == 0, outcome%err)
      end do
      outcome = run('awk -F, ''FNR==1{k++; if(k==1)print; next}'// &
         '{printf "%.4f,%s\n",$1+(k-1),$2}'' out/dwell1/record.csv '// &
         'out/dwell2/record.csv > both.csv')
      call write_file('track.nml', track)
   end subroutine make_record

   !> Windows inside a dwell hold its place, and those that contain the move are flagged.
   subroutine test_file()
      character(len=:), allocatable :: flag, table
      type(outcome_t) :: outcome
      real(wp) :: first, last, place
      integer :: clear, flagged, held, k, moving, still

      outcome = beamid('track track.nml --quiet')
      call check('track', outcome%status == 0, outcome%err)
      call check('its summary', has_all(outcome%out, &
         'x_P in 85 windows of 0.3|mesh: 12 elements; '), outcome%out)
      table = read_file('out/track/track.csv')
      call check('its columns', index(table, &
         't_first,t_last,parameter,estimate,lower95,upper95,latency_ms,flag,misfit,unit'//nl) == 1)
      call check('a row for each window', line_count(table) == 86)
      clear = 0
      flagged = 0
      held = 0
      moving = 0
      still = 0
      do k = 1, line_count(table) - 1
         first = number(field(table, k, 1))
         last = number(field(table, k, 2))
         flag = field(table, k, 8)
         ! A twentieth of a window on either side of the move need not show it.
         if (first < 0.985_wp .and. last > 1.015_wp) then
            moving = moving + 1
            if (flag == 'moving') flagged = flagged + 1
         else if (last < 1 .or. first > 1) then
            still = still + 1
            if (flag /= '') cycle
            clear = clear + 1
            place = places(merge(1, 2, last < 1))
            if (number(field(table, k, 5)) <= place .and. place <= number(field(table, k, 6))) &
               held = held + 1
         end if
      end do
      call check('windows with a move', moving > 10)
      call check('all of them are flagged', flagged == moving)
      ! The release excites modes that the model leaves out; they disturb the first windows.
      call check('most others are not', clear > 0.7_wp*still)
      call check('and hold the place', held >= 0.9_wp*clear)
   end subroutine test_file

   !> The estimate in one window is that of `identify`. Whitening changes the weights of samples,
   !> and a search ends within a tenth of a standard error: both together stay below half of one.
   subroutine test_window()
      character(len=:), allocatable :: estimates, table
      type(outcome_t) :: outcome
      integer :: k

      call write_file('one.nml', replaced(replaced(track(:index(track, '&track') - 1), &
         'file=''both.csv''', 'file=''both.csv'', t_first=1.39, t_last=1.71'), 'x_P=0.09', &
         'x_P=0.118'))
      table = read_file('out/track/track.csv')
      do k = 1, line_count(table) - 1
         if (number(field(table, k, 1)) > 1.4_wp .and. field(table, k, 8) == '') exit
      end do
      call write_file('one.nml', replaced(read_file('one.nml'), 't_first=1.39, t_last=1.71', &
         't_first='//field(table, k, 1)//', t_last='//field(table, k, 2)))
      outcome = beamid('identify one.nml --quiet')
      estimates = read_file('out/one/estimates.csv')
      call check_close('the estimate of identify in the same window', &
         number(field(table, k, 4)), number(field(estimates, 1, 6)), &
         0.5_wp*number(field(estimates, 1, 7)))
   end subroutine test_window

   !> Standard input gives the same rows, on standard output and in the table.
   subroutine test_input()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: of_file, table
      integer :: k, same

      of_file = read_file('out/track/track.csv')
      call write_file('input.nml', replaced(track, 'both.csv', '-'))
      outcome = run(program_path//' track input.nml < both.csv')
      call check('track of standard input', outcome%status == 0, outcome%err)
      table = read_file('out/input/track.csv')
      call check('prints what it writes', outcome%out == table)
      same = 0
      do k = 1, line_count(of_file) - 1
         if (field(table, k, 4) == field(of_file, k, 4) .and. field(table, k, 8) &
            == field(of_file, k, 8)) same = same + 1
      end do
      call check('the same rows as of a file', same == 85 .and. line_count(table) == 86)
      outcome = run('(head -n 800 both.csv; printf "0.4,"; printf "1") | '//program_path// &
         ' track input.nml --out out/cut')
      call check('an input that stops inside a line', outcome%status == 0, outcome%err)
      outcome = run('awk ''BEGIN {print "t,a"; for (; k < 2000; k++) print k/2000 ",1.5"}'' | '// &
         program_path//' track input.nml --out out/constant')
      call check('a constant record determines nothing, status 1', outcome%status == 1 .and. &
         index(read_file('out/constant/track.csv'), ',unseen,') > 0, outcome%err)
      outcome = run('(head -n 800 both.csv; sed 1d both.csv | sed ''s/^/9/'') | '//program_path// &
         ' track input.nml --out out/gap')
      table = read_file('out/gap/track.csv')
      call check('a gap has one row', outcome%status == 0 .and. line_count(table) < 130 .and. &
         index(table, ',gap,') > 0 .and. index(table, ',gap,') == index(table, ',gap,', .true.), &
         outcome%err)
      outcome = run('(head -n 800 both.csv; echo wrong,1) | '//program_path// &
         ' track input.nml --out out/wrong')
      call check('a wrong line, status 2', outcome%status == 2 .and. has_all(outcome%err, &
         'standard input:801: column 1|found ''wrong'''), outcome%err)
      call check('and no table', .not. exists('out/wrong/track.csv'))
      outcome = run('head -n 100 both.csv | '//program_path//' track input.nml --out out/short')
      call check('an input shorter than a window, status 2', outcome%status == 2 .and. &
         has_all(outcome%err, '&track window: found 0.3|standard input'), outcome%err)
   end subroutine test_input

   !> Cases that cannot be tracked: one line, status 2.
   subroutine test_refusals()
      call refuse('no group', replaced(track, '&track', '!'), '&track: found no such group')
      call refuse('a fixed parameter', replaced(track, 'parameter=''x_P''', 'parameter=''E'''), &
         '&track parameter: found a parameter that is fixed')
      call refuse('an unknown parameter', replaced(track, 'parameter=''x_P''', &
         'parameter=''y_P'''), '&track parameter: found |y_P')
      call refuse('no hop', replaced(track, ' hop=0.02,', ''), '&track hop: found nothing')
      call refuse('a tiny hop', replaced(track, 'hop=0.02', 'hop=1e-9'), &
         '&track hop: found 1E-09|at least window/100000')
      call refuse('a negative window', replaced(track, 'window=0.3', 'window=-1'), &
         '&track window: found -1')
      call refuse('thinning', replaced(track, '''both.csv''', '''both.csv'', thin=4'), &
         '&record: found thin')
      call refuse('a function along the beam', replaced(track, 'free=''x_P'',''c_D''', &
         'free=''x_P'',''E(x)'''), '&stage free: found E(x)')
      call refuse('a range without effect', replaced(replaced(track, 'c_D=5e6', 'b_h=0.1'), &
         '''c_D'',', '''b_h'','), 'found ''b_h'' beside a_h = 0')
      call refuse('a loss factor', replaced(track, 'c_D=5e6', 'eta=0.01'), '&beam eta: found 0.01')
      call refuse('a known force', replaced(track, 'kind=''free'', modes=2', &
         'kind=''pulse'', amplitude=1, duration=0.01'), '&excitation kind')
      call refuse('two records', track//'&record file=''both.csv'' /'//nl, '&record: found 2')
      call refuse('standard input of identify', replaced(track, 'both.csv', '-'), &
         '&record file: found ''-''', 'identify')
   end subroutine test_refusals

   !> Checks that a case is refused.
   subroutine refuse(what, text, message, command)
      character(len=*), intent(in) :: what, text, message
      character(len=*), intent(in), optional :: command
      type(outcome_t) :: outcome
      character(len=:), allocatable :: verb

      verb = 'track'
      if (present(command)) verb = command
      call write_file('bad.nml', text)
      outcome = beamid(verb//' bad.nml --quiet --out out/bad')
      call check(what//': status 2, one line', outcome%status == 2 .and. &
         line_count(outcome%err) == 1 .and. has_all(outcome%err, message), outcome%err)
      call check(what//': no output', .not. exists('out/bad'))
   end subroutine refuse

end program test_track
