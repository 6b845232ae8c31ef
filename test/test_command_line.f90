!> The built program from the outside: words, exit status, streams, output files and their contents,
!> and a few numbers that must survive the way from case file to table.
program test_command_line
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, read_file, remove_tree, replaced, run, write_file
   use short_case, only: case_text, check_success, nl, pulse, stage, text_of
   use tables, only: check_table, field, line, lines_with, longest, number
   implicit none

   character(len=*), parameter :: cr = achar(13), mark = char(239)//char(187)//char(191)
   character(len=*), parameter :: estimates_header = &
      'stage,elements,parameter,unit,start,estimate,std_error,lower95,upper95,determined', &
      fit_header = 'elements,t,measured,model,residual', &
      response_header = 'elements,t,force,displacement,velocity,acceleration', &
      modes_header = 'elements,mode,frequency_hz,damping_ratio,real,imag'
   character(len=:), allocatable :: reason, record_text

   call open_shell(reason)
   if (reason /= '') then
      call skip('command line', reason)
   else
      call test_help_and_version()
      call test_wrong_words()
      call test_simulate()
      call test_identify()
      call test_modes()
      call test_meshes_and_stages()
      call test_output_folder()
      call test_paths()
      call test_forms()
      call test_force_table()
      call test_progress()
      call test_terminal()
      call test_width()
      call test_frequencies()
      call test_round_trip()
      call test_formulas()
      call test_notes()
      call close_shell()
   end if
   call finish('command_line')

contains

   subroutine test_help_and_version()
      type(outcome_t) :: outcome
      character(len=*), parameter :: words(*) = [character(len=9) :: 'help', '--help', '-h', &
         'fit -h']
      integer :: k

      do k = 1, size(words)
         outcome = beamid(trim(words(k)))
         call check(trim(words(k)), outcome%status == 0 .and. outcome%err == '' .and. &
            has_all(outcome%out, &
            'usage: beamid|identify|simulate|modes|reproduce|version|--out DIR|--quiet|'// &
             'Exit status'))
      end do
      outcome = beamid('version')
      call check('version', outcome%status == 0 .and. outcome%err == '' .and. &
         line_count(outcome%out) == 1 &
         .and. has_all(outcome%out, 'beamid |.'), outcome%out(:max(0, len(outcome%out) - 1)))
      call check('--version', outcome%out == text_of(beamid('--version')) .and. outcome%out /= '')
      outcome = beamid('help')
      call check('help: lines fit a terminal', longest(outcome%out) <= 100)
   end subroutine test_help_and_version

   subroutine test_wrong_words()
      call write_file('case.nml', case_text)
      call refused('', 'found no command|expected identify, simulate')
      call refused('fit case.nml', 'found fit|expected identify, simulate')
      call refused('""', 'found |expected identify, simulate')
      call refused('Modes case.nml', 'found Modes|expected identify, simulate')
      call refused('studio', 'found studio, a command of the Python package|expected identify')
      call refused('identify', 'identify: found nothing|expected a case file')
      call refused('simulate', 'simulate: found nothing|expected a case file')
      call refused('modes', 'modes: found nothing|expected a case file')
      call refused('reproduce', 'reproduce: found nothing|expected table-4.1')
      call refused('reproduce table-9.9', 'table-9.9|expected')
      call refused('compare case.nml', 'compare: found 1 case files|expected two or more')
      call refused('modes case.nml case.nml', &
         'found case.nml behind case.nml|expected nothing more')
      call refused('help mode-shapes', 'found mode-shapes|expected a command')
      call refused('version 2', 'found 2 behind version|expected nothing')
      call refused('modes case.nml --out', '--out: found nothing|expected a folder')
      call refused('modes case.nml --out ""', '--out: found an empty name|expected a folder')
      call refused('modes case.nml --fast', 'found --fast|expected --out DIR|--quiet')
      call refused('modes -q case.nml', 'found -q|expected --out DIR|--quiet')
      call check('wrong words write nothing', .not. exists('out'))
   end subroutine test_wrong_words

   !> Status 2, one line, nothing on standard output.
   subroutine refused(arguments, words)
      character(len=*), intent(in) :: arguments, words
      type(outcome_t) :: outcome

      outcome = beamid(arguments)
      call check('beamid '//arguments, outcome%status == 2 .and. outcome%out == '' .and. &
         line_count(outcome%err) == 1 .and. index(outcome%err, 'beamid: ') == 1 .and. &
         has_all(outcome%err, words), outcome%err(:max(0, len(outcome%err) - 1)))
   end subroutine refused

   subroutine test_simulate()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      integer :: k

      call write_file('case.nml', replaced(case_text, 'file=''record.csv'', ', ''))
      outcome = beamid('simulate case.nml --quiet')
      call check_success('simulate', outcome, 'out/case/')
      table = read_file('out/case/response.csv')
      call check_table('response.csv', table, response_header, rows=6)
      record_text = read_file('out/case/record.csv')
      call check_table('record.csv', record_text, 't,acceleration', rows=6)
      call check('record.csv: the response''s times and accelerations', all([(field(table, k, &
         2) == &
         field(record_text, k, 1) .and. field(table, k, 6) == field(record_text, k, 2), k=1, 6)]))
      call check('response.csv: elements', all([(field(table, k, 1) == '2', k=1, 6)]))
      do k = 1, 6
         call check_close('response.csv: time '//field(table, k, 2), number(field(table, k, 2)), &
            k*0.1_wp, 1e-12_wp)
      end do
      call check('response.csv: no force behind the pulse', all([(abs(number(field(table, k, &
         3))) <= 0, k=1, 6)]))
      call check('simulate: a copy of the case', read_file('out/case/case.txt') == &
         read_file('case.nml') .and. read_file('out/case/labels.csv') /= '')
      call write_file('record.csv', record_text)
   end subroutine test_simulate

   subroutine test_identify()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      real(wp) :: sum_of_squares
      integer :: k

      call write_file('case.nml', case_text)
      outcome = beamid('identify case.nml --quiet')
      call check_success('identify', outcome, 'out/case/')
      table = read_file('out/case/estimates.csv')
      call check_table('estimates.csv', table, estimates_header, rows=3, texts=[3, 4, 10])
      call check('estimates.csv: parameters', field(table, 1, 3) == 'm_H' .and. field(table, 2, &
         3) == 'k_H' &
         .and. field(table, 3, 3) == 'J')
      call check('estimates.csv: units', field(table, 1, 4) == 'slug' .and. field(table, 2, &
         4) == 'lb/ft')
      call check_close('estimates.csv: start of m_H', number(field(table, 1, 5)), 0.035_wp, &
         1e-15_wp)
      call check_close('estimates.csv: start of k_H', number(field(table, 2, 5)), 0.4_wp, 1e-15_wp)
      sum_of_squares = number(field(table, 3, 6))
      table = read_file('out/case/fit.csv')
      call check_table('fit.csv', table, fit_header, rows=6)
      call check('fit.csv: the record', all([(field(table, k, 2) == field(record_text, k, 1) .and. &
         field(table, k, 3) == field(record_text, k, 2), k=1, 6)]))
      call check('fit.csv: residual = measured - model', all([(abs(number(field(table, k, 3)) - &
         number(field(table, k, 4)) - number(field(table, k, 5))) < 1e-14_wp, k=1, 6)]))
      call check_close('J = sum of squares of fit.csv', sum_of_squares, &
         sum([(number(field(table, k, 5))**2, k=1, 6)]), 1e-12_wp*sum_of_squares)
   end subroutine test_identify

   subroutine test_modes()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: table
      integer :: k

      call write_file('alone.nml', '&beam length=4.0, rho=0.03, E=80.0, I=1.0 /'//nl// &
         '&discretization elements=3,8,5 /'//nl)
      outcome = beamid('modes alone.nml')
      call check_success('modes', outcome, 'out/alone/')
      table = read_file('out/alone/modes.csv')
      call check_table('modes.csv', table, modes_header, rows=4 + 9 + 6)
      call check('modes.csv: elements in the order given', all([(field(table, k, 1) == &
         trim(merge('3', merge('8', '5', k <= 13), k <= 4)), k=1, 19)]))
      call check('modes.csv: modes from 1', field(table, 1, 2) == '1' .and. field(table, 5, &
         2) == '1' .and. &
         field(table, 14, 2) == '1' .and. field(table, 13, 2) == '9')
      call check('modes.csv: frequencies ascend', all([(number(field(table, k, 3)) < &
         number(field(table, k + 1, 3)), k=5, 12)]))
      call check('modes.csv: undamped', all([(abs(number(field(table, k, 4))) < 1e-9_wp, k=1, 19)]))
      call check('modes: a copy of the case', read_file('out/alone/case.txt') == &
         read_file('alone.nml') .and. read_file('out/alone/labels.csv') /= '')
   end subroutine test_modes

   !> Everything for each of the elements, and a row for each stage.
   subroutine test_meshes_and_stages()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: text

      text = replaced(replaced(case_text, 'elements=2', 'elements=3,2'), stage, stage//nl// &
         '&stage free=''c_H'' /')
      call write_file('case.nml', text)
      outcome = beamid('simulate case.nml --quiet --out several')
      call check_success('simulate, two meshes', outcome, 'several/')
      call check_table('response.csv, two meshes', read_file('several/response.csv'), &
         response_header, rows=12)
      call check('response.csv: order of the meshes', field(read_file('several/response.csv'), 1, &
         1) == '3' &
         .and. field(read_file('several/response.csv'), 7, 1) == '2')
      outcome = beamid('identify case.nml --quiet --out several')
      call check_success('identify, two meshes and stages', outcome, 'several/')
      call check_table('estimates.csv, two meshes and stages', read_file('several/estimates.csv'), &
         estimates_header, rows=2*(3 + 2), texts=[3, 4, 10])
      call check_table('fit.csv, two meshes and stages', read_file('several/fit.csv'), fit_header, &
         rows=12)
      call check('summary: both stages', has_all(outcome%out, 'Stage 1|Stage 2|m_H|k_H|c_H'))
      call check('an older file of another command stays', exists('several/response.csv'))
   end subroutine test_meshes_and_stages

   subroutine test_output_folder()
      type(outcome_t) :: outcome

      call write_file('two words/my.case.nml', case_text)
      outcome = beamid('modes my.case.nml', 'two words')
      call check('default folder: out/<case name>, one ending less', outcome%status == 0 .and. &
         exists('two words/out/my.case/modes.csv'), outcome%err)
      outcome = beamid('modes my.case.nml --out a/b/c', 'two words')
      call check('--out makes missing parents', outcome%status == 0 .and. &
         exists('two words/a/b/c/modes.csv'))
      outcome = beamid('--out d/ --quiet modes my.case.nml', 'two words')
      call check('--out before the command, with a slash', outcome%status == 0 .and. &
         exists('two words/d/modes.csv'))
      outcome = beamid('modes my.case.nml --out "e f"', 'two words')
      call check('--out with a blank', outcome%status == 0 .and. exists('two words/e f/modes.csv'))
      call check('no temporary file stays', &
         text_of(run('find . -name ".beamid-*"')) == '')
      ! A record of somebody in the output folder, under the name of an output.
      call write_file('mine/case.nml', case_text)
      call write_file('mine/record.csv', record_text)
      outcome = beamid('simulate case.nml --quiet --out .', 'mine')
      call check('the record of the case is not overwritten', outcome%status == 2 .and. &
         has_all(outcome%err, './record.csv: found a record of the case|another output folder') &
         .and. read_file('mine/record.csv') == record_text .and. &
         .not. exists('mine/summary.txt'), outcome%err)
      outcome = run('cd mine && mv record.csv ../mine.csv')
      outcome = beamid('simulate case.nml --quiet --out .', 'mine')
      call check('nor is it in the way elsewhere', outcome%status == 0, outcome%err)
      outcome = beamid('simulate case.nml --quiet --out .', 'mine')
      call check('what an earlier run wrote is', outcome%status == 0, outcome%err)
   end subroutine test_output_folder

   !> What a case names lies beside the case, wherever the program runs.
   subroutine test_paths()
      type(outcome_t) :: outcome

      call write_file('here/inner/case.nml', replaced(case_text, '''record.csv''', &
         '''../data/record.csv'''))
      call write_file('here/data/record.csv', record_text)
      call write_file('elsewhere/empty', '')
      outcome = beamid('identify ../here/inner/case.nml --quiet', 'elsewhere')
      call check('record beside the case', outcome%status == 0, outcome%err)
      call check('output below the current folder', exists('elsewhere/out/case/fit.csv') .and. &
         .not. exists('here/inner/out'))
      outcome = run('"'//program_path// &
         '" identify "$PWD/here/inner/case.nml" --quiet --out absolute')
      call check('absolute path of the case', outcome%status == 0 .and. &
         exists('absolute/fit.csv'), outcome%err)
      call write_file('here/inner/force.nml', replaced(case_text, pulse, &
         'kind=''table'', file=''force.csv'''))
      call write_file('here/inner/force.csv', '0,1'//nl//'0.05,1'//nl)
      outcome = beamid('simulate ../here/inner/force.nml --quiet', 'elsewhere')
      call check('force table beside the case', outcome%status == 0 .and. &
         exists('elsewhere/out/force/response.csv'), outcome%err)
   end subroutine test_paths

   !> One case, written in other ways: the same outputs to the last byte.
   subroutine test_forms()
      character(len=:), allocatable :: reference
      character(len=*), parameter :: tip = '&tip m_T=0.15 /'//nl

      reference = outputs_of(case_text, record_text)
      call check('forms: the reference', reference /= '')
      call check('forms: CRLF', outputs_of(replaced(case_text, nl, cr//nl), &
         replaced(record_text, nl, cr//nl)) == reference)
      call check('forms: byte-order marks', outputs_of(mark//case_text, mark// &
         record_text) == reference)
      call check('forms: keys and groups in any case', &
         outputs_of(replaced(replaced(replaced(replaced( &
         replaced(case_text, '&beam length', '&BEAM LENGTH'), 'rho', 'Rho'), 'm_T', 'M_t'), &
            '&stage free', &
         '&Stage FREE'), 't_first', 'T_First'), record_text) == reference)
      call check('forms: parameters in any case', outputs_of(replaced(case_text, &
         '''m_H'',''k_H''', &
         '''M_H'',''k_h'''), record_text) == reference)
      call check('forms: another order of groups', outputs_of(stage//nl// &
         replaced(replaced(case_text, tip, ''), &
         stage, tip), record_text) == reference)
      call check('forms: one line, comments, tabs', outputs_of('! one'//nl// &
         replaced(replaced(case_text, nl, &
         ' '), ', ', achar(9)//' , ')//'! last', record_text) == reference)
      call check('forms: other spellings of numbers', &
         outputs_of(replaced(replaced(replaced(case_text, '80.0', &
         '+8.0D1'), '0.005', '5e-3'), 'm_T=0.15', 'm_T = .15'), record_text) == reference)
      call check('forms: I = b h^3/12', outputs_of(replaced(case_text, 'I=1.0', &
         'width=1.5, height=2'), &
         record_text) == reference)
      call check('forms: height first', outputs_of(replaced(case_text, 'I=1.0', &
         'height=2, width=1.5'), &
         record_text) == reference)
      call check('forms: another I does differ', outputs_of(replaced(case_text, 'I=1.0', &
         'width=1, height=2'), &
         record_text) /= reference)
   end subroutine test_forms

   !> A pulse, written as a table, is the same force.
   subroutine test_force_table()
      character(len=:), allocatable :: by_pulse, by_table
      character(len=*), parameter :: table = 'kind=''table'', file=''force.csv'''
      type(outcome_t) :: outcome
      integer :: k

      call write_file('pulse.nml', case_text)
      call write_file('table.nml', replaced(case_text, pulse, table))
      call write_file('force.csv', 't,force'//nl//'0,1'//nl//'0.05,1'//nl)
      outcome = beamid('simulate pulse.nml --quiet')
      outcome = beamid('simulate table.nml --quiet')
      call check_success('simulate with a force table', outcome, 'out/table/')
      by_pulse = read_file('out/pulse/response.csv')
      by_table = read_file('out/table/response.csv')
      call check('force table: the pulse as a table', by_pulse == by_table)
      call write_file('force.csv', '0,0'//nl//'0.25,1'//nl//'0.45,0'//nl)
      outcome = beamid('simulate table.nml --quiet')
      by_table = read_file('out/table/response.csv')
      call check_table('response.csv, triangle', by_table, response_header, rows=6)
      do k = 1, 6
         call check_close('force of the triangle at '//field(by_table, k, 2), &
            number(field(by_table, k, 3)), &
            max(0.0_wp, min(k*0.1_wp/0.25_wp, (0.45_wp - k*0.1_wp)/0.2_wp)), 1e-12_wp)
      end do
   end subroutine test_force_table

   !> No line of what is printed about any case in data/ is wider than 100 columns.
   subroutine test_width()
      type(outcome_t) :: outcome, cases
      character(len=:), allocatable :: file, verb
      integer :: k

      ! By the exact response: the integrator takes long.
      outcome = run('cp -r ../../data data && sed -i "s/cvode/modal/; s/, rtol=1e-11//" data/*.nml')
      cases = run('ls data/*.nml')
      call check('width: cases', line_count(cases%out) >= 9)
      do k = 1, line_count(cases%out)
         file = line(cases%out, k)
         outcome = beamid('modes '//file//' --out wide --quiet')
         call check('width of modes '//file, outcome%status == 0 .and. longest(outcome%out) <= 100)
         verb = 'simulate '
         outcome = run('grep -q "^&stage" '//file)
         if (outcome%status == 0) verb = 'identify '
         outcome = run('grep -q "^&design" '//file)
         if (outcome%status == 0) verb = 'design '
         outcome = beamid(verb//file//' --out wide --quiet')
         call check('width of the other '//file, outcome%status == 0 .and. &
            longest(outcome%out) <= 100, outcome%err)
      end do
      outcome = beamid('compare data/rpl_table_4_2.nml data/rpl_table_4_3.nml --out wide --quiet')
      call check('width of compare', outcome%status == 0 .and. longest(outcome%out) <= 100)
   end subroutine test_width

   !> In a terminal of 80 and of 60 columns no line of the progress is wider.
   subroutine test_terminal()
      character(len=*), parameter :: watch = 'import fcntl, os, pty, struct, sys, termios'//nl// &
         'columns = int(sys.argv[1])'//nl//'try:'//nl//'    os.close(pty.openpty()[0])'//nl// &
         'except OSError:'//nl//'    print("none")'//nl//'    sys.exit()'//nl// &
         'pid, fd = pty.fork()'//nl//'if pid == 0:'//nl// &
         '    fcntl.ioctl(2, termios.TIOCSWINSZ, struct.pack("4H", 24, columns, 0, 0))'//nl// &
         '    os.execv(sys.argv[2], sys.argv[2:])'//nl//'text = b""'//nl//'try:'//nl// &
         '    while piece := os.read(fd, 4096):'//nl//'        text += piece'//nl// &
         'except OSError:'//nl//'    pass'//nl//'lines = text.decode().split("\r")'//nl// &
         'seen = [line for line in lines if "iteration" in line and "\n" not in line]'//nl// &
         'print(len(seen) > 2, max(map(len, seen)) < columns, os.waitpid(pid, 0)[1])'//nl
      type(outcome_t) :: outcome
      integer :: k

      outcome = run('python3 --version')
      if (outcome%status /= 0) then
         call skip('progress in a terminal', 'no Python')
         return
      end if
      call write_file('case.nml', case_text)
      call write_file('watch.py', watch)
      do k = 60, 80, 20
         outcome = run('python3 watch.py '//to_text(k)//' "'//program_path// &
            '" identify case.nml --out progress')
         if (outcome%out == 'none'//nl) then
            call skip('progress in a terminal', 'this machine has no pseudo-terminals')
            return
         end if
         call check('terminal of '//to_text(k)//' columns', outcome%out == 'True True 0'//nl, &
            outcome%out//outcome%err)
      end do
   end subroutine test_terminal

   !> Standard error of a fit: plain lines when it is no terminal.
   subroutine test_progress()
      type(outcome_t) :: outcome, quiet

      call write_file('case.nml', replaced(case_text, 'elements=2', 'elements=2,3'))
      outcome = beamid('identify case.nml --out progress')
      call check('progress: status', outcome%status == 0)
      call check('progress: plain lines', index(outcome%err, cr) == 0 .and. index(outcome%err, &
         achar(27)) == 0 &
         .and. line_count(outcome%err) >= 4)
      call check('progress: every line names iteration, evaluations, J and the parameters', &
         lines_with(outcome%err, &
            'iteration |evaluations|J = |m_H = |k_H = ') == line_count(outcome%err))
      call check('progress: each mesh', has_all(outcome%err, &
         'N = 2, stage 1: iteration 0|N = 3, stage 1: iteration 0'))
      call check('progress: no progress on standard output', index(outcome%out, 'iteration 0') == 0)
      quiet = beamid('identify case.nml --out progress --quiet')
      call check('progress: none with --quiet', quiet%status == 0 .and. quiet%err == '')
      call check('progress: --quiet changes no result', quiet%out == outcome%out)
      outcome = beamid('modes case.nml --out progress')
      call check('progress: of the fit behind the modes', outcome%status == 0 .and. &
         has_all(outcome%err, 'N = 2, stage 1: iteration 0|N = 3, stage 1: iteration 0'))
      quiet = beamid('modes case.nml --out progress --quiet')
      call check('progress: none of that fit with --quiet', quiet%status == 0 .and. &
         quiet%err == '' .and. quiet%out == outcome%out)
      call write_file('case.nml', case_text//'&multistart n=6, seed=1 /'//achar(10))
      outcome = beamid('identify case.nml --out progress')
      call check('progress: time left once a start of several is done', outcome%status == 0 .and. &
         index(outcome%err, ' s left, J = ') > index(outcome%err, 'iteration 0'), outcome%err)
      outcome = beamid('simulate case.nml --out progress')
      call check('progress: none of a simulation', outcome%status == 0 .and. outcome%err == '')
   end subroutine test_progress

   !> Frequencies of a cantilever with a tip mass of 0.2 rho l: beta l from reference_values.md.
   subroutine test_frequencies()
      real(wp), parameter :: beta(5) = [1.616399660156_wp, 4.267061566865_wp, 7.318372673343_wp, &
         10.40156263267_wp, 13.50670224839_wp]
      real(wp), parameter :: pi = acos(-1.0_wp), rho = 0.093_wp, EI = 0.491_wp, length = 0.4573_wp
      character(len=:), allocatable :: table
      type(outcome_t) :: outcome
      real(wp) :: exact
      character(len=20) :: mass
      integer :: k

      write (mass, '(es20.13)') 0.2_wp*rho*length
      call write_file('cantilever.nml', '&beam length=0.4573, rho=0.093, E=0.491, I=1 /'//nl// &
         '&tip m_T='// &
         trim(adjustl(mass))//' /'//nl//'&discretization degree=5, elements=32 /'//nl)
      outcome = beamid('modes cantilever.nml --quiet')
      table = read_file('out/cantilever/modes.csv')
      do k = 1, 5
         exact = beta(k)**2*sqrt(EI/(rho*length**4))/(2*pi)
         ! What quintic splines reach with N = 32, with a margin.
         call check_close('frequency of mode '//achar(48 + k)//', relative', number(field(table, &
            k, 3))/exact, &
            1.0_wp, 1e-9_wp)
      end do
   end subroutine test_frequencies

   !> simulate, then identify on its record.csv, finds what the record was made with.
   subroutine test_round_trip()
      real(wp), parameter :: truth(4) = [0.15_wp, 0.04_wp, 0.004_wp, 0.3_wp]
      character(len=:), allocatable :: table, text
      type(outcome_t) :: outcome
      integer :: k

      text = replaced(replaced(case_text, 'rtol=1e-8', 'rtol=1e-9'), 't_last=0.6', 't_last=4')
      call write_file('case.nml', text)
      outcome = beamid('simulate case.nml --quiet --out trip')
      call write_file('trip/case.nml', replaced(replaced(text, stage, &
         '&stage free=''m_T'',''m_H'',''c_H'',''k_H'', start=0.13,0.05,0.003,0.35 /'), 'm_H=0.04', &
            'm_H=0.05'))
      outcome = beamid('identify trip/case.nml --quiet --out trip/fit')
      call check_success('round trip', outcome, 'trip/fit/')
      table = read_file('trip/fit/estimates.csv')
      do k = 1, size(truth)
         call check_close('round trip: '//field(table, k, 3)//', relative', &
            number(field(table, k, 6))/truth(k), 1.0_wp, 1e-4_wp)
      end do
   end subroutine test_round_trip

   !> The three formulas agree where Delta is small against the periods.
   subroutine test_formulas()
      character(len=*), parameter :: difference = 'formula=''displacement_difference'', delta=0.1'
      character(len=:), allocatable :: text, exact, first, second
      integer :: k

      text = replaced(case_text, 'c_D=0.005', 'c_D=1')
      text = replaced(text, 'rtol=1e-8', 'rtol=1e-11')
      exact = response_of(replaced(text, difference, 'formula=''equation'''))
      first = response_of(replaced(text, difference, 'formula=''velocity_difference'', delta=1e-3'))
      second = response_of(replaced(text, difference, &
         'formula=''displacement_difference'', delta=1e-3'))
      do k = 2, 6
         call check_close('(4.2) against (3.13) at '//field(exact, k, 2), number(field(first, k, &
            6)), &
            number(field(exact, k, 6)), 1e-3_wp)
         call check_close('(4.1) against (3.13) at '//field(exact, k, 2), number(field(second, k, &
            6)), &
            number(field(exact, k, 6)), 1e-3_wp)
      end do
   end subroutine test_formulas

   !> What was done to the record stands below the line that says what was identified.
   subroutine test_notes()
      type(outcome_t) :: outcome
      character(len=:), allocatable :: note, table

      call write_file('case.nml', replaced(case_text, 't_step=0.1', 't_step=0.1, clip_low=-1.2'))
      call write_file('record.csv', record_text)
      outcome = beamid('identify case.nml --quiet --out notes')
      call check_success('notes', outcome, 'notes/')
      note = line(outcome%out(index(outcome%out, ': identification from'):), 2)
      call check('notes: samples left out', note == &
         '2 of 6 samples left out: at the sensor''s limit (-1.2)', note)
      call check('notes: the others are fitted', index(outcome%out, 'from 4 samples') > 0)
      table = read_file('notes/fit.csv')
      call check_table('fit.csv without them', table, fit_header, rows=4)
   end subroutine test_notes

   !> response.csv of a case.
   function response_of(text) result(table)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: table
      type(outcome_t) :: outcome

      call write_file('case.nml', text)
      outcome = beamid('simulate case.nml --quiet --out response')
      table = read_file('response/response.csv')
      call remove_tree('response')
   end function response_of

   !> All that `identify` writes for a case and a record, in one text; '' when it fails.
   function outputs_of(text, record) result(outputs)
      character(len=*), intent(in) :: text, record
      character(len=:), allocatable :: outputs
      type(outcome_t) :: outcome

      call write_file('form/case.nml', text)
      call write_file('form/record.csv', record)
      outcome = beamid('identify case.nml --quiet', 'form')
      outputs = ''
      if (outcome%status == 0) outputs = outcome%out//read_file('form/out/case/estimates.csv')// &
         read_file('form/out/case/fit.csv')
      call remove_tree('form')
   end function outputs_of

end program test_command_line
