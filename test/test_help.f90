!> What the program says about itself is whole: every command, group, key and parameter of the
!> tables has its help and its place in the manual page, and every group and free parameter stands
!> among the rules for groups in docs/. No line is wider than the terminal. A misspelt word gets the
!> nearest one. And what `new` writes runs as it is and finds what its record was made from.
program test_help
   use bad_cases, only: refused_command
   use beamid_blocks, only: block_t
   use beamid_case_files, only: list_keys
   use beamid_key_facts, only: allowed_of, default_of, example_of, is_listed, &
      parameter_example, unit_of
   use beamid_key_help, only: key_line, known_words, symbol_of
   use beamid_kinds, only: wp
   use beamid_parameters, only: parameters
   use beamid_texts, only: left
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, read_file, replaced, run, write_file
   use tables, only: field, longest, number
   implicit none

   character(len=*), parameter :: nl = achar(10)
   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   call open_shell(reason)
   if (reason /= '') then
      call skip('help', reason)
   else
      call test_words()
      call test_widths()
      call test_nearest()
      call test_shells()
      call test_new()
   end if
   call close_shell()
   call finish('help')

contains

   !> Tables against help, manual and docs/reference/groups.md. (test_case_reference does the same
   !> for the generated reference.)
   subroutine test_words()
      type(block_t), allocatable :: blocks(:)
      character(len=:), allocatable :: rules, manual, group
      type(outcome_t) :: page
      integer :: column, g, k

      outcome = beamid('help man')
      call check('manual: every byte can be printed', prints(outcome%out))
      call check('manual: installed', index(read_file('../../scripts/install.sh'), &
         'help man >"$share/man/man1/beamid.1"') > 0)
      manual = replaced(replaced(outcome%out, '\-', '-'), nl//'\&', nl)
      call check('words in the place of numbers', index(manual, '''auto'' or ''case''') > 0)
      rules = read_file('../../docs/reference/groups.md')
      call list_keys(blocks)
      do g = 1, size(blocks)
         group = trim(blocks(g)%name)
         outcome = wide('help '//group)
         call check('help '//group, outcome%status == 0 .and. outcome%err == '' .and. &
            index(outcome%out, 'group &'//group) > 0)
         call check('help '//group//': every byte can be printed', prints(outcome%out))
         call check('manual: '//group, index(manual, '.SS &'//group) > 0)
         call check('rules: '//group, index(rules, '&'//group) > 0)
         ! Explanations begin behind the longest name.
         column = max(17, 3 + maxval(len_trim(blocks(g)%keys%name)))
         do k = 1, size(blocks(g)%keys)
            associate (key => blocks(g)%keys(k))
               page = wide('help '//trim(key%name))
               call check('help '//trim(key%name)//': every byte can be printed', &
                  page%status == 0 .and. prints(page%out))
               call check('help '//trim(key%name)//' of '//group, has_all(page%out, &
                  trim(key%name)//', key of &'//group//'|  '//key%help//'|unit      '// &
                  unit_of(group, key)//'|allowed   '//allowed_of(group, key)//'|default   '// &
                  default_of(key)//'|example   '//example_of(group, key)//'|see also '))
               call check('help '//group//': '//trim(key%name), index(outcome%out, nl// &
                  left('  '//trim(key%name), column)//key%help//nl//repeat(' ', column)// &
                  key_line(group, key)//nl//repeat(' ', column)//example_of(group, key)//nl) > 0)
               call check('manual: '//group//' '//trim(key%name), index(manual, &
                  '.B '//trim(key%name)//nl//key%help//nl//'.br'//nl//key_line(group, key)//nl// &
                  '.br'//nl//example_of(group, key)//nl) > 0)
               call check('rules: '//group//' '//trim(key%name), &
                  index(rules, '`'//trim(key%name)//'`') > 0 .or. &
                  index(rules, '`'//trim(key%name)//'=') > 0)
            end associate
         end do
      end do
      do k = 1, size(parameters)
         if (.not. is_listed(k)) cycle
         outcome = wide('help '''//symbol_of(k)//'''')
         call check('help '//symbol_of(k), outcome%status == 0 .and. has_all(outcome%out, &
            'free in &stage as '''//symbol_of(k)//'''|example   '//parameter_example(k)))
         call check('manual: '//symbol_of(k), index(manual, nl// &
            parameter_example(k)//nl) > 0)
         call check('rules: '//trim(parameters(k)%name), &
            index(rules, '`'//trim(parameters(k)%name)//'`') > 0)
      end do
   end subroutine test_words

   !> Runs the program in a terminal of 10000 columns, in which no line is broken.
   function wide(arguments) result(outcome)
      character(len=*), intent(in) :: arguments
      type(outcome_t) :: outcome

      outcome = run('COLUMNS=10000 '//program_path//' '//arguments)
   end function wide

   !> No line of the help on any word is wider than the terminal, whose width COLUMNS gives: at
   !> least 40 characters, and 80 if COLUMNS is no number.
   subroutine test_widths()
      character(len=*), parameter :: columns(*) = [character(len=5) :: '40', '57', '80', '133', &
         '7', 'wide', '""']
      integer, parameter :: widths(*) = [40, 57, 80, 133, 40, 80, 80]
      character(len=20), allocatable :: words(:)
      character(len=:), allocatable :: list
      integer :: k

      call known_words(words)
      list = 'identify simulate modes frf profile bootstrap compare reproduce new help version'
      do k = 1, size(words)
         list = list//' '''//trim(words(k))//''''
      end do
      do k = 1, size(columns)
         outcome = run('COLUMNS='//trim(columns(k))//' '//program_path//' help '//list//' && '// &
            'COLUMNS='//trim(columns(k))//' '//program_path//' help')
         call check('no line is wider than COLUMNS='//trim(columns(k)), outcome%status == 0 .and. &
            longest(outcome%out) <= widths(k) .and. longest(outcome%out) > widths(k) - 5)
      end do
   end subroutine test_widths

   !> Whether a page is printable characters and ends of lines; UTF-8 is not.
   pure logical function prints(page)
      character(len=*), intent(in) :: page
      integer :: k

      prints = page /= '' .and. all([(page(k:k) == nl .or. iachar(page(k:k)) >= 32 .and. &
         iachar(page(k:k)) < 127, k=1, len(page))])
   end function prints

   !> Every word there is, and words that are nearly one.
   subroutine test_nearest()
      character(len=*), parameter :: commands(*) = [character(len=9) :: 'identify', 'simulate', &
         'modes', 'frf', 'profile', 'sample', 'bootstrap', 'compare', 'design', 'ensemble', &
         'reproduce', 'new', 'help', 'version']
      integer :: k

      do k = 1, size(commands)
         outcome = beamid('help '//trim(commands(k)))
         call check('help '//trim(commands(k)), outcome%status == 0 .and. &
            index(outcome%out, 'beamid '//trim(commands(k))) == 1 .and. &
            has_all(outcome%out, 'example  |beamid '//trim(commands(k))//'|see also '))
         call check(trim(commands(k))//' --help', same_as(trim(commands(k))//' --help', &
            outcome%out))
      end do
      outcome = beamid('help clamp')
      call check('a word of the field leads to keys', outcome%status == 0 .and. index(outcome%out, &
         'beamid help k_R end support') > 0, outcome%out)
      outcome = beamid('help status')
      call check('the exit status', outcome%status == 0 .and. index(outcome%out, &
         '2 bad input') > 0, outcome%out)
      call refused_command('help lenght', 'found lenght|perhaps length')
      call refused_command('help xyzzy', 'found xyzzy|expected a command', outcome)
      call check('far from all', index(outcome%err, 'perhaps') == 0)
      call refused_command('identfy case.nml', 'found identfy|perhaps identify')
      call write_file('key.nml', '&beam lenght=1 /'//nl)
      call refused_command('modes key.nml', 'key.nml:1: &beam lenght|perhaps length')
      call write_file('group.nml', '&baem length=1 /'//nl)
      call refused_command('modes group.nml', 'group.nml:1: found unknown group|perhaps beam')
      call write_file('free.nml', '&beam length=1, rho=1, E=1, I=1 /'//nl//'&excitation kind='// &
         '''free'' /'//nl//'&record file=''r.csv'' /'//nl//'&stage free=''E'',''cD'' /'//nl)
      call refused_command('identify free.nml', '&stage free|''cD''|perhaps c_D')
   end subroutine test_nearest

   logical function same_as(arguments, expected)
      character(len=*), intent(in) :: arguments, expected
      type(outcome_t) :: other

      other = beamid(arguments)
      same_as = other%status == 0 .and. other%out == expected
   end function same_as

   !> Bash takes the completion, and completes.
   subroutine test_shells()
      outcome = beamid('help bash >complete.bash')
      outcome = run('bash -c ''source ./complete.bash; COMP_WORDS=(beamid ide); COMP_CWORD=1; '// &
         '_beamid; echo "${COMPREPLY[*]}"; COMP_WORDS=(beamid new b); COMP_CWORD=2; _beamid; '// &
         'echo "${COMPREPLY[*]}"; COMP_WORDS=(beamid identify key); COMP_CWORD=2; _beamid; '// &
         'echo "${COMPREPLY[*]}"''')
      call check('bash completes', outcome%status == 0 .and. &
         outcome%out == 'identify'//nl//'base'//nl//'key.nml'//nl, outcome%out//outcome%err)
      outcome = beamid('help zsh')
      call check('zsh', outcome%status == 0 .and. index(outcome%out, '#compdef beamid'//nl) == 1)
   end subroutine test_shells

   !> Each kind of case: written once, fitted, and E where it was made, within 5 % of what any user
   !> would call right (the start is 7 % off; its own interval must hold it).
   subroutine test_new()
      character(len=*), parameter :: kinds(*) = [character(len=10) :: 'free-decay', 'impulse', &
         'base', 'struck-bar', 'paper']
      character(len=:), allocatable :: kind
      integer :: k

      do k = 1, size(kinds)
         kind = trim(kinds(k))
         outcome = beamid('new '//kind//' trial-'//kind)
         call check('new '//kind, outcome%status == 0 .and. outcome%out == 'trial-'//kind// &
            '/case.nml'//nl//'trial-'//kind//'/record.csv'//nl, outcome%err)
         call refused_command('new '//kind//' trial-'//kind, 'trial-'//kind//'/case.nml: found')
         outcome = beamid('identify trial-'//kind//'/case.nml --quiet --out fit-'//kind)
         call check('new '//kind//': runs', outcome%status == 0, outcome%err)
         if (outcome%status /= 0) cycle
         if (kind == 'paper') then
            call check_inside(kind, 'm_H', 0.04_wp)
            call check_inside(kind, 'k_H', 0.3_wp)
         else if (kind == 'struck-bar') then
            call check_inside(kind, 'E', 1.95e11_wp)
         else
            call check_inside(kind, 'E', 7e10_wp)
            call check_inside(kind, 'm_S', 5e-3_wp)
         end if
      end do
      outcome = beamid('new')
      call check('new without words', outcome%status == 0 .and. &
         exists('free-decay/case.nml') .and. exists('free-decay/record.csv'))
      call refused_command('new bese', 'new: found bese|perhaps base')
      call refused_command('new base a b', 'found 3 words')
      call refused_command('new base --out a', 'found --out')
      call write_file('file', 'x')
      call refused_command('new base file/below', 'file/below: cannot be written')
   end subroutine test_new

   !> The interval with every source of error holds the value that the record was made with, and is
   !> no wider than a tenth of it.
   subroutine check_inside(kind, name, truth)
      character(len=*), intent(in) :: kind, name
      real(wp), intent(in) :: truth
      character(len=:), allocatable :: table
      real(wp) :: low, high
      integer :: k

      table = read_file('fit-'//kind//'/estimates.csv')
      do k = 1, line_count(table) - 1
         if (field(table, k, 3) /= name) cycle
         low = number(field(table, k, 16))
         high = number(field(table, k, 17))
         call check('new '//kind//': '//name, low <= truth .and. truth <= high .and. &
            high - low < 0.2_wp*truth, field(table, k, 16)//' to '//field(table, k, 17))
         return
      end do
      call check('new '//kind//': '//name, .false., 'no row')
   end subroutine check_inside

end program test_help
