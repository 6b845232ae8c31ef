!> Recorders' files become columns: each is written by the library that reads it, where that is
!> installed, turned into text by the script and read as a record.
program test_to_csv
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_records, only: read_record, recording_t
   use checks, only: check, finish, skip
   use shell, only: close_shell, has_all, in_scratch, line_count, open_shell, outcome_t, &
      python_with, read_file, run, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10), script = ' ../../scripts/to_csv.py '
   !> Eight samples of two channels at 8 per second, all exact in binary and in 12 decimals.
   character(len=*), parameter :: samples = 'import numpy as np'//nl// &
      't = np.arange(8) / 8'//nl//'a = np.array([1, -2, 4, 0.5, -8, 16, 3, 0])'//nl// &
      'f = np.array([0, 2, 1, 0, 0, 0, 0, 0.25])'//nl
   real(wp), parameter :: t_exact(8) = [0.0_wp, 0.125_wp, 0.25_wp, 0.375_wp, 0.5_wp, 0.625_wp, &
      0.75_wp, 0.875_wp], &
      a(8) = [1.0_wp, -2.0_wp, 4.0_wp, 0.5_wp, -8.0_wp, 16.0_wp, 3.0_wp, 0.0_wp], &
      f(8) = [0.0_wp, 2.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.25_wp]
   character(len=:), allocatable :: reason, python
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason == '' .and. python_with('sys') == '') reason = 'no Python'
   if (reason /= '') then
      call skip('to_csv.py', reason)
   else
      call test_arguments()
      if (has('numpy')) call test_numpy()
      if (has('scipy')) then
         call test_mat()
         call test_wav()
      end if
      if (has('pyuff')) call test_uff()
      if (has('nptdms')) call test_tdms()
   end if
   call close_shell()
   call finish('to_csv')

contains

   !> Finds a Python that has a module.
   logical function has(module)
      character(len=*), intent(in) :: module

      python = python_with(module)
      has = python /= ''
      if (.not. has) call skip('files that '//module//' reads', 'it is not installed')
   end function has

   !> What is refused before any library is asked for, and the line that says how to get one.
   subroutine test_arguments()
      python = 'python3'
      call refused('no file', '', 2, 'arguments are required: FILE')
      call refused('no such file', 'none.wav', 2, 'none.wav: no such file')
      call write_file('a.doc', 'a'//nl)
      call refused('another format', 'a.doc', 2, 'a.doc: found ''.doc''|expected one of .uff')
      call write_file('a.wav', '')
      call write_file('a.csv', 'mine'//nl)
      call refused('a file is there', 'a.wav', 2, 'a.csv: exists; --out a.csv replaces it')
      call check('  and stays', read_file('a.csv') == 'mine'//nl)
      ! Without its site packages and without .venv this Python has no library; where .venv has one
      ! the script goes on there and finds that an empty file is none.
      outcome = run('python3 -S'//script//'a.wav --out b.csv')
      call check('a missing library', line_count(outcome%err) == 1 .and. &
         (outcome%status == 1 .and. has_all(outcome%err, &
         'no module scipy|--install|.venv/bin/pip install ''scipy>=') .or. &
         outcome%status == 2 .and. has_all(outcome%err, 'scipy cannot read it')), outcome%err)
   end subroutine test_arguments

   subroutine test_numpy()
      character(len=*), parameter :: rates(*) = [character(len=6) :: 'np.inf', 'np.nan', '0', '-8']
      character(len=:), allocatable :: text
      integer :: k

      call convert('npz', 'np.savez("x.npz", time=t, acc=a, force=f, acc_unit="g", '// &
         'serial="A, 1")', 'x.npz')
      call column('npz: times', 'x.csv', 'acc [g]', a)
      call column('npz: a channel without a unit', 'x.csv', 'force', f)
      text = read_file('x.csv')
      call check('npz: what the file says is kept', has_all(text, '# from x.npz|# serial = A, 1'// &
         nl//'|'//nl//'t,acc [g],force'//nl))
      call convert('npz with a rate', 'np.savez("r.npz", fs=8, data=np.array([a, f]))', 'r.npz')
      call column('npz: rate', 'r.csv', 'data(2)', f)
      call check('npz: the rate is kept', has_all(read_file('r.csv'), '# fs = 8'//nl))
      call convert('npz with two rates', 'np.savez("d.npz", fs=8, rate=9, acc=a)', 'd.npz', &
         'd.npz: acc gets no times: found fs, rate, expected one')
      call column('npz: no rate of two', 'd.csv', 'acc', a, rate=8.0_wp)
      call convert('npy', 'np.save("v.npy", a)', 'v.npy')
      call check('npy: rate= is asked for', has_all(outcome%out, 'no times|rate=...'), outcome%out)
      call column('npy', 'v.csv', 'v', a, rate=8.0_wp)
      call convert('npy, three rows', 'np.save("m.npy", np.array([t, a, f]))', &
         'm.npy --out out/one.csv')
      call column('npy: the first two columns', 'out/one.csv', '', a)
      call column('npy: by number', 'out/one.csv', '3', f)
      call convert('chosen', '', 'x.npz --out c.csv --channel FORCE')
      call check('chosen: the others are left out', has_all(read_file('c.csv'), nl//'t,force'//nl))
      call convert('chosen by number', '', 'x.npz --out c.csv --channel 2')
      call column('chosen by number', 'c.csv', '', f)
      call refused('no such channel', 'x.npz --out c.csv --channel acc x', 2, &
         'x.npz: no channel ''x'' (found: 1 ''acc [g]'', 2 ''force'')')
      call write_file('bad.npz', 'text')
      call refused('no NumPy file', 'bad.npz', 2, 'bad.npz: numpy cannot read it')
      call convert('complex', 'np.save("i.npy", 1j * a)', '')
      call refused('complex numbers', 'i.npy', 2, &
         'i.npy: found neither a time series nor an FRF|'// &
         'i holds no series of real numbers')
      call convert('extended precision', 'np.savez("l.npz", t=t.astype(np.longdouble), '// &
         'acc=a.astype(np.longdouble))', 'l.npz')
      call column('extended precision', 'l.csv', 'acc', a)
      do k = 1, size(rates)
         call convert('a rate of '//trim(rates(k)), 'np.savez("b.npz", fs='//trim(rates(k))// &
            ', acc=a)', '')
         call refused('a rate of '//trim(rates(k)), 'b.npz', 2, 'b.npz: fs: found |'// &
            'expected a finite value above 0')
      end do
      call convert('a step that is lost', 'np.savez("b.npz", t0=1e9, dt=1e-9, acc=a)', '')
      call refused('a step that is lost', 'b.npz', 2, 'b.npz: dt: found 1e-09|no times that grow')
      call convert('not finite', 'np.save("n.npy", np.r_[a, np.nan])', 'n.npy', &
         'n.npy: n: 1 of 9 samples are no finite numbers')
   end subroutine test_numpy

   subroutine test_mat()
      call convert('mat', 'from scipy.io import savemat'//nl// &
         'savemat("x.mat", {"t": t, "acc": a, "Units": "g", "serial": "A, 1"})', &
         'x.mat --out mat.csv')
      call column('mat: times and unit', 'mat.csv', 'acc [g]', a)
      call check('mat: what the file says is kept', has_all(read_file('mat.csv'), &
         '# serial = A, 1'//nl))
      call convert('mat, structures', 'from scipy.io import savemat'//nl// &
         'savemat("s.mat", {"S": {"x_values": {"start_value": 0.0, "increment": 0.125}, '// &
         '"y_values": {"values": a, "quantity": {"label": "g"}}}, '// &
         '"B": {"values": f, "fs": 16.0, "unit": "N"}})', 's.mat')
      call column('mat: increment and unit of a structure', 's.csv', 'S.y_values.values [g]', a)
      call column('mat: a rate of its own', 's_2.csv', 'B.values [N]', f, factor=0.5_wp)
      call write_file('bad.mat', 'text')
      call refused('no MATLAB file', 'bad.mat', 2, 'bad.mat: scipy cannot read it')
   end subroutine test_mat

   subroutine test_wav()
      call convert('wav', 'from scipy.io import wavfile'//nl// &
         'wavfile.write("x.wav", 8, np.array([4 * a, 4 * f]).T.astype("i2"))', 'x.wav --out w.csv')
      call column('wav: the first', 'w.csv', '', 4*a)
      call column('wav: the second', 'w.csv', 'channel 2', 4*f)
      call check('wav: the rate is kept', has_all(read_file('w.csv'), '8 samples per s, int16'))
      call refused('an empty file', 'a.wav --out w.csv', 2, 'a.wav: scipy cannot read it')
   end subroutine test_wav

   !> A function of time with a rate, one with its own times, and one of frequency; both forms.
   subroutine test_uff()
      integer :: form
      character(len=*), parameter :: forms(2) = ['58 ', '58b'], binary(2) = ['0', '1']
      character(len=:), allocatable :: file, text

      do form = 1, 2
         file = 'u'//trim(forms(form))
         call convert('uff '//forms(form), 'import pyuff'//nl// &
            's = dict(type=58, binary='//binary(form)//', func_type=1, func_id=0, ver_num=0, '// &
            'load_case_id=0, rsp_ent_name="beam", rsp_node=5, rsp_dir=3, ref_ent_name="NONE", '// &
            'ref_node=1, ref_dir=3, data=a, x=t, id1="tip, A 1", id2="NONE", id3="NONE", '// &
            'id4="NONE", id5="NONE", abscissa_spacing=1, abscissa_min=0., abscissa_inc=.125, '// &
            'abscissa_spec_data_type=17, abscissa_axis_lab="Time", '// &
            'abscissa_axis_units_lab="s", '// &
            'ordinate_spec_data_type=12, ordinate_axis_lab="acc", ordinate_axis_units_lab="g", '// &
            'orddenom_spec_data_type=0)'//nl//'units = dict(type=164, units_code=1, '// &
            'units_description="SI", temp_mode=1, length=1., force=1., temp=1., temp_offset=0.)'// &
            nl//'g = dict(s, data=f, x=t * t, abscissa_spacing=0, ordinate_axis_units_lab="N", '// &
            'rsp_dir=-1)'//nl//'h = dict(s, func_type=4, abscissa_spec_data_type=18, data=1j * a)' &
            //nl//'pyuff.UFF("'//file//'.uff").write_sets([units, s, g, h], "overwrite")', &
            file//'.uff', 'set 4 is an FRF, written to a file of its own')
         call column(file//': a rate', file//'.csv', 'beam 5+Z [g]', a)
         call column(file//': its own times', file//'_2.csv', 'beam 5-X [N]', f, square=.true.)
         text = read_file(file//'.csv')
         call check(file//': what the file says is kept', has_all(text, 'tip, A 1|by 0.125|'// &
            'units_description SI|'//nl//'t [s],beam 5+Z [g]'//nl), text)
      end do
      call write_file('bad.uff', 'text')
      call refused('no UFF', 'bad.uff', 2, 'bad.uff: |found neither|expected one or more')
   end subroutine test_uff

   subroutine test_tdms()
      character(len=:), allocatable :: text

      call convert('tdms', 'from nptdms import ChannelObject, RootObject, TdmsWriter'//nl// &
         'known = {"wf_increment": 0.125, "unit_string": "g", "sensor": "A 1"}'//nl// &
         'with TdmsWriter("x.tdms") as w:'//nl// &
         '    w.write_segment([RootObject({"operator": "B"}),'//nl// &
         '        ChannelObject("m", "acc", a, known),'//nl// &
         '        ChannelObject("m", "force", f, dict(known, unit_string="N")),'//nl// &
         '        ChannelObject("m", "slow", f, {"wf_increment": 0.25}),'//nl// &
         '        ChannelObject("n", "raw", a), ChannelObject("n", "text", ["p", "q"])])', &
         'x.tdms --out tdms.csv', 'x.tdms: n/text holds no series of real numbers')
      call column('tdms: one channel', 'tdms.csv', 'm/acc [g]', a)
      call column('tdms: another', 'tdms.csv', 'm/force [N]', f)
      call column('tdms: with another increment', 'tdms_2.csv', 'm/slow', f, factor=2.0_wp)
      call column('tdms: without times', 'tdms_3.csv', 'n/raw', a, rate=8.0_wp)
      text = read_file('tdms.csv')
      call check('tdms: what the file says is kept', &
         has_all(text, 'sensor = A 1|wf_increment = 0.125|# operator = B'//nl), text)
      call write_file('bad.tdms', 'text')
      call refused('no TDMS', 'bad.tdms', 2, 'bad.tdms: ')
   end subroutine test_tdms

   !> Writes a file by a library, and columns by the script.
   !>
   !> code       Python, behind the samples
   !> arguments  of the script; '': it does not run
   !> words      of the one line on standard error; default none
   subroutine convert(what, code, arguments, words)
      character(len=*), intent(in) :: what, code, arguments
      character(len=*), intent(in), optional :: words

      call write_file('make.py', samples//code//nl)
      outcome = run(python//' make.py')
      call check(what//': is written', outcome%status == 0, outcome%err)
      if (arguments == '') return
      outcome = run(python//script//arguments)
      if (present(words)) then
         call check(what//': columns', outcome%status == 0 .and. has_all(outcome%err, words) .and. &
            line_count(outcome%err) == 1, outcome%err)
      else
         call check(what//': columns', outcome%status == 0 .and. outcome%err == '', outcome%err)
      end if
   end subroutine convert

   subroutine refused(what, arguments, status, words)
      character(len=*), intent(in) :: what, arguments, words
      integer, intent(in) :: status

      outcome = run(python//script//arguments)
      call check('refused: '//what, outcome%status == status .and. outcome%out == '' .and. &
         line_count(outcome%err) == 1 .and. has_all(outcome%err, words), outcome%err)
   end subroutine refused

   !> A column is read as a record: the numbers are those written, exactly, as all are short binary
   !> fractions.
   !>
   !> rate    of a file without times
   !> factor  of the times; default 1
   !> square  whether the times are squared
   subroutine column(what, file, name, values, rate, factor, square)
      character(len=*), intent(in) :: what, file, name
      real(wp), intent(in) :: values(:)
      real(wp), intent(in), optional :: rate, factor
      logical, intent(in), optional :: square
      type(recording_t) :: recording
      type(error_t), allocatable :: error
      real(wp), allocatable :: t(:), z(:), times(:)
      logical :: ok

      recording%path = in_scratch(file)
      recording%value_column = name
      if (present(rate)) recording%rate = rate
      call read_record(recording, t, z, error)
      if (allocated(error)) then
         call check(what, .false., error%message)
         return
      end if
      times = t_exact
      if (present(factor)) times = factor*times
      if (present(square)) times = times**2
      ok = size(t) == size(times)
      if (ok) ok = maxval(abs(t - times)) <= 0 .and. maxval(abs(z - values)) <= 0
      call check(what, ok)
   end subroutine column

end program test_to_csv
