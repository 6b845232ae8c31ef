!> The scripts that read an output folder refuse one that its manifest does not vouch for.
program test_scripts
   use checks, only: check, finish, skip
   use shell, only: close_shell, has_all, line_count, open_shell, outcome_t, program_path, &
      python_with, read_file, run, write_file
   use tables, only: part
   implicit none

   character(len=*), parameter :: nl = achar(10), scripts = '../../scripts/'
   character(len=*), parameter :: case_text = &
      '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /'//nl// &
      '&discretization elements=2,3 /'//nl// &
      '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /'//nl// &
      '&record file=''out/truth/record.csv'', t_first=0.1, t_last=2.0, t_step=0.05 /'//nl, &
      stage = '&stage free=''E'', start=79 /'//nl
   !> What all of them share needs nothing but Python itself.
   character(len=*), parameter :: check_outputs = 'import sys'//nl// &
      'sys.path.insert(0, "'//scripts//'")'//nl//'import program'//nl// &
      'print(program.outputs(sys.argv[1]))'//nl
   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason == '' .and. python_with('sys') == '') reason = 'no Python'
   if (reason /= '') then
      call skip('scripts', reason)
   else
      call test_shared()
      call test_each()
   end if
   call close_shell()
   call finish('scripts')

contains

   subroutine test_shared()
      call write_file('check_outputs.py', check_outputs)
      call write_file('truth.nml', case_text)
      call write_file('case.nml', case_text//stage)
      outcome = run('"'//program_path//'" simulate truth.nml && "'//program_path// &
         '" identify case.nml --quiet')
      call check('two runs', outcome%status == 0, outcome%err)
      outcome = run('python3 check_outputs.py out/case')
      call check('outputs of a run', outcome%status == 0 .and. outcome%out == 'out/case'//nl, &
         outcome%err)
      call judge('benchmark.py', scripts//'benchmark.py table tables', &
         'found ''tables''|expected table, decay')
      call refused('rm copy/manifest.txt', 'copy: no manifest.txt')
      call refused('echo >>copy/fit.csv', 'copy/fit.csv: not as manifest.txt has it')
      call refused('sed -i s/m/M/ copy/fit.csv', 'copy/fit.csv: not as manifest.txt has it')
      call refused('rm copy/fit.csv', 'copy/fit.csv: No such file')
      call refused('echo other >copy/manifest.txt', 'manifest.txt: found|expected a manifest')
      call refused('>copy/manifest.txt', 'manifest.txt: found|expected a manifest')
      call refused('echo fit.csv >>copy/manifest.txt', 'copy/fit.csv: not as manifest.txt has it')
      call refused('rm -r copy', 'copy: no such folder')
   end subroutine test_shared

   !> A copy of the outputs, damaged by a command: status 2 and one line.
   subroutine refused(damage, words)
      character(len=*), intent(in) :: damage, words

      outcome = run('rm -rf copy && cp -r out/case copy && '//damage)
      call judge(damage, 'python3 check_outputs.py copy', words)
   end subroutine refused

   subroutine judge(what, command, words)
      character(len=*), intent(in) :: what, command, words

      outcome = run(command)
      call check(what, outcome%status == 2 .and. outcome%out == '' .and. &
         line_count(outcome%err) == 1 .and. has_all(outcome%err, words), told(outcome))
   end subroutine judge

   !> Standard error without its last line feed.
   function told(outcome)
      type(outcome_t), intent(in) :: outcome
      character(len=:), allocatable :: told

      told = outcome%err(:max(0, len(outcome%err) - 1))
   end function told

   !> Every script that is given an output folder asks. Where there is no matplotlib or Plotly, in
   !> Python or in .venv, the scripts would install it: then nothing is tested.
   subroutine test_each()
      if (python_with('numpy, matplotlib, plotly') == '') then
         call skip('each script', 'no matplotlib or Plotly')
         return
      end if
      outcome = run(scripts//'plot_fit.py out/case')
      call check('plot_fit.py: a picture', outcome%out == 'out/case/fit.png'//nl, outcome%err)
      outcome = run(scripts//'plot_modes.py out/case --animate && head -c 6 out/case/modes.gif')
      call check('plot_modes.py: a picture, and one that moves', outcome%out == &
         'out/case/modes.png'//nl//'out/case/modes.gif'//nl//'GIF89a', outcome%err)
      call test_along()
      call test_intervals()
      call test_map()
      call test_page()
      outcome = run('mkdir -p part/section-4 && cp -r out/case part/table-4.1 && '// &
         'touch part/section-4/curves.csv && rm out/case/manifest.txt')
      call judge('plot_fit.py', scripts//'plot_fit.py out/case', 'out/case: no manifest.txt')
      call judge('plot_convergence.py', scripts//'plot_convergence.py out/case', &
         'out/case: no manifest.txt')
      call test_commands()
      call judge('plot_paper.py', scripts//'plot_paper.py part/section-4', &
         'part/section-4: no manifest.txt')
      call judge('report.py', scripts//'report.py part', 'part/section-4: no manifest.txt')
      call test_samples()
   end subroutine test_each

   !> What varies along the beam, which the page of the fit shows too; a fit in which nothing does.
   subroutine test_along()
      call judge('plot_along.py: nothing varies', scripts//'plot_along.py out/case', &
         'out/case: found no along.csv|expected a fit of E(x) or c_D(x)')
      call write_file('along.nml', case_text//'&along kind=''dip'', place=2.0, '// &
         'width=1.0, depth=0.001 /'//nl//stage)
      outcome = run('"'//program_path//'" identify along.nml --quiet >printed && '//scripts// &
         'plot_along.py out/along && '//scripts//'report.py out/along && '// &
         'grep -c ''id="along"'' out/along/report.html')
      call check('plot_along.py: a picture, and one in the page', outcome%out == &
         'out/along/along.png'//nl//'out/along/report.html'//nl//'1'//nl, told(outcome))
      call judge('plot_along.py: another mesh', scripts//'plot_along.py out/along --elements 7', &
         'along.csv: nothing for 7 elements')
   end subroutine test_along

   !> Pictures of what is there: nothing, resampled records, draws; the page of the fit has a
   !> section of them.
   subroutine test_intervals()
      call judge('plot_intervals.py: nothing there', scripts//'plot_intervals.py out/case', &
         'found no profiles.csv|expected one of them')
      call write_file('more.nml', case_text//stage//'&sample draws=400 /'//nl// &
         '&bootstrap n=100 /'//nl)
      call write_file('truth.nml', case_text//'&noise sd=0.02, seed=3 /'//nl)
      outcome = run('"'//program_path//'" simulate truth.nml --quiet && "'//program_path// &
         '" bootstrap more.nml --quiet && '//scripts//'plot_intervals.py out/more')
      call check('plot_intervals.py: resampled records', part(outcome%out, &
         line_count(outcome%out), nl) == 'out/more/bootstrap.png', told(outcome))
      outcome = run('"'//program_path//'" sample more.nml --quiet >printed && '// &
         'diff printed out/more/intervals.txt && '//scripts//'plot_intervals.py out/more')
      call check('plot_intervals.py: profiles, draws, motion', outcome%out == &
         'out/more/profiles.png'//nl//'out/more/posterior.png'//nl// &
         'out/more/posterior_motion.png'//nl, told(outcome))
      outcome = run('"'//program_path//'" identify more.nml --quiet >printed && '// &
         scripts//'report.py out/more && grep -c ''id="beyond"'' out/more/report.html && '// &
         'diff printed out/more/summary.txt')
      call check('page: beyond one fit', outcome%out == 'out/more/report.html'//nl//'1'//nl, &
         told(outcome))
   end subroutine test_intervals

   !> report.py makes a page of the outputs of every command, not of fits alone.
   subroutine test_commands()
      character(len=*), parameter :: commands(*) = [character(len=9) :: 'simulate', 'modes', &
         'profile', 'bootstrap', 'design', 'ensemble'], ids(*) = [character(len=11) :: &
         'response', 'modes', 'intervals', 'intervals', 'experiments', 'members']
      character(len=:), allocatable :: folder
      integer :: i

      call write_file('each.nml', case_text//stage//'&bootstrap n=100 /'//nl// &
         '&noise sd=0.02 /'//nl//'&ensemble members=3 /'//nl//'&design x_S=1,2,3, noise_sd=1 /'//nl)
      do i = 1, size(commands)
         folder = 'out/'//trim(commands(i))
         outcome = run('"'//program_path//'" '//trim(commands(i))//' each.nml --quiet --out '// &
            folder//' >printed && '//scripts//'report.py '//folder//' && grep -c ''id="'// &
            trim(ids(i))//'"'' '//folder//'/report.html')
         call check('report.py: '//trim(commands(i)), outcome%out == folder//'/report.html'//nl// &
            '1'//nl, told(outcome))
      end do
      outcome = run('"'//program_path//'" compare case.nml each.nml --quiet --out out/compare '// &
         '>printed && '//scripts//'report.py out/compare --case case.nml each.nml && '// &
         'grep -c ''id="models"'' out/compare/report.html')
      call check('report.py: compare', outcome%out == 'out/compare/report.html'//nl//'1'//nl, &
         told(outcome))
   end subroutine test_commands

   !> A map of experiments over two settings, and a curve over one; no other setting, no parameter.
   subroutine test_map()
      call write_file('design.nml', case_text//stage// &
         '&design x_S=1,2,3, t_last=1,2, noise_sd=1 /'//nl)
      outcome = run('"'//program_path//'" design design.nml && '//scripts// &
         'plot_design.py out/design')
      call check('plot_design.py: a map', has_all(outcome%out, 'out/design/design_E.png'), &
         outcome%err)
      outcome = run(scripts//'plot_design.py out/design --over x_S --out curve.png')
      call check('plot_design.py: a curve', outcome%out == 'curve.png'//nl, outcome%err)
      call judge('plot_design.py: one force', scripts//'plot_design.py out/design --over x_F', &
         'found --over x_F|x_S, t_last')
      call judge('plot_design.py: another name', scripts//'plot_design.py out/design '// &
         '--parameter m_T', 'found --parameter m_T, expected E')
   end subroutine test_map

   !> The page of a fit is one file that needs nothing else, says what it is, and has no numbers of
   !> seventeen digits. scripts/tests looks at the pages in a browser.
   subroutine test_page()
      character(len=*), parameter :: count = 'import re'//nl// &
         'page = open("out/case/report.html").read()'//nl// &
         'pictures = re.findall("<img [^>]*>", page)'//nl// &
         'bare = [tag for tag in pictures if not re.search(''alt="[^"]{9,}"'', tag)]'//nl// &
         'links = re.findall("https?://|<script[^>]* src", page)'//nl// &
         'print(len(pictures) >= 4, len(bare), len(links),'//nl// &
         '      len(re.findall(r"[0-9]{12,}E[-+]", page.split("<pre>")[0])))'//nl
      character(len=:), allocatable :: page

      outcome = run(scripts//'report.py out/case')
      call check('report.py: a page', outcome%status == 0 .and. &
         outcome%out == 'out/case/report.html'//nl, outcome%err)
      if (outcome%status /= 0) return
      page = read_file('out/case/report.html')
      call check('page: language, title, sections', has_all(page, '<html lang="en">|'// &
         '<title>case: a fit by beamid</title>|id="estimates"|id="curves"|id="modes"|'// &
         'id="correlations"|&amp;beam'))
      call write_file('count.py', count)
      outcome = run('python3 count.py')
      call check('page: pictures with a text, no links, short numbers', &
         outcome%out == 'True 0 0 0'//nl, outcome%out)
   end subroutine test_page

   !> A picture of a record reads what the program reads: a header, decimal commas, a rate.
   subroutine test_samples()
      character(len=*), parameter :: tab = achar(9), head = 'Recorder, 5'//nl//'Rate'//tab//'4'// &
         tab//nl//'X'//tab//'acc'//tab//'Comment'//nl, code = 'import sys'//nl// &
         'sys.path.insert(0, "'//scripts//'")'//nl//'import cases'//nl// &
         'a = {"file": ["''a.lvm''"], "value_column": ["''ACC''"]}'//nl// &
         'b = {"file": ["''b.txt''"], "rate": ["4d0"]}'//nl// &
         'for keys in a, dict(a, rate=["4"]), b:'//nl// &
         '    t, z = cases.read_samples("case.nml", keys)'//nl// &
         '    print(*(t - [k / 4 for k in range(9)]), *(z - [k + 0.5 for k in range(9)]))'//nl
      character(len=:), allocatable :: rows
      character(len=9) :: row
      integer :: k

      rows = ''
      do k = 0, 8
         write (row, '(i0,a,i2.2,a,i0,a)') k/4, ',', 25*mod(k, 4), tab, k, ',5'
         rows = rows//trim(row)//nl
      end do
      call write_file('a.lvm', head//rows)
      call write_file('b.txt', 'Recorder'//nl//'0.5'//nl//'1.5'//nl//'2.5'//nl//'3.5'//nl//'4.5'// &
         nl//'5.5'//nl//'6.5'//nl//'7.5'//nl//'8.5'//nl)
      call write_file('samples.py', code)
      outcome = run('for p in python3 ../../.venv/bin/python; do '// &
         '$p -c "import numpy" 2>/dev/null && exec $p samples.py; done')
      call check('samples of a record', outcome%status == 0 .and. outcome%out == &
         repeat(repeat('0.0 ', 17)//'0.0'//nl, 3), outcome%out//outcome%err)
   end subroutine test_samples

end program test_scripts
