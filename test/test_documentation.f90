!> What README.md and the pages in docs/ print is what their commands print.
!>
!> Each page gets a folder of its own, with copies of data/ and the scripts. Blocks of commands are
!> run there, and the output of commands behind `$` is compared (`compare`, `alike`). Case files and
!> other files are written from the blocks that show them. A file that exists has to hold its block.
!> An HTML comment right above a block says what is different about it:
!>
!>     <!-- not run: reason -->    the block is listed as skipped
!>     <!-- slow: reason -->       the block is run in long runs only (BEAMID_LONG_TESTS)
!>     <!-- exit status N -->      the status of its commands, instead of 0
!>
!> Scripts that draw are run in long runs only; in other runs they do nothing.
!>
!> A page that contains `<!-- needs FILE -->` is skipped without that file. Measured records are not
!> part of the project: BEAMID_RECORDS names the folder that holds them, by default ../shared/data.
program test_documentation
   use beamid_kinds, only: wp
   use beamid_numbers, only: parse_number
   use beamid_strings, only: to_text
   use checks, only: check, finish, in_long_run, skip
   use pages, only: block_t, named_file, next_block, next_command
   use shell, only: close_shell, exists, line_count, open_shell, outcome_t, program_path, &
      python_with, read_file, run, write_file
   use tables, only: line, part
   implicit none

   character(len=*), parameter :: nl = achar(10), place = 'page/'
   character(len=:), allocatable :: reason, list, python
   type(outcome_t) :: outcome
   logical :: draws
   integer :: k, commands

   call open_shell(reason)
   if (reason /= '') then
      call skip('documentation', reason)
   else
      draws = in_long_run() .and. python_with('numpy, matplotlib') /= ''
      python = python_with('beamid')
      commands = 0
      outcome = run('cd ../.. && ls '//chosen_pages())
      list = outcome%out
      do k = 1, line_count(list)
         call test_page(line(list, k))
      end do
      if (command_argument_count() == 0) call check('commands are there', commands > 50, &
         to_text(commands))
   end if
   call close_shell()
   call finish('documentation')

contains

   !> The pages that the arguments of this program name, from the checkout; all of them by default.
   function chosen_pages() result(names)
      character(len=:), allocatable :: names
      character(len=200) :: argument
      integer :: k

      names = ''
      do k = 1, command_argument_count()
         call get_command_argument(k, argument)
         names = names//' '//trim(argument)
      end do
      if (names == '') names = 'README.md docs/*.md docs/*/*.md'
   end function chosen_pages

   !> Runs all blocks of a page.
   subroutine test_page(name)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: page, needed, command, printed
      type(block_t) :: block
      integer :: k, begin

      page = read_file('../../'//name)
      call check_lines(name, page)
      call prepare()
      needed = ''
      begin = index(page, '<!-- needs ')
      if (begin > 0) needed = part(page(begin:), 3, ' ')
      k = 1
      do while (next_block(page, k, block))
         select case (block%language)
         case ('nml', 'csv', 'fortran')
            call take_file(name, block)
         case ('sh')
            if (may_run(name//': '//line(block%text, 1), block%remark, needed, '')) &
               call run_script(name, block)
         case ('console')
            do while (next_command(block%text, command, printed))
               if (may_run(name//': '//command, block%remark, needed, command)) &
                  call try(name, command, printed, expected_status(block%remark))
            end do
         case ('python')
            if (index(block%text, 'import beamid') > 0) call run_python(name, block, needed)
         end select
      end do
   end subroutine test_page

   !> Makes the folder of a page: what a checkout has, with a `run.sh` that does not build.
   subroutine prepare()
      outcome = run('rm -rf page && mkdir -p page/scripts page/bin page/roller && '// &
         'cp -r ../../data page && ln -s $PWD/../../example page/example && '// &
         'cp ../../example/*.f90 page && '// &
         'ln -s $(realpath ../../scripts/*) page/scripts && rm page/scripts/run.sh && '// &
         'ln -s '//program_path//' page/bin/beamid; '// &
         'r=$(realpath -m "${BEAMID_RECORDS:-../../../shared/data}"); '// &
         'ln -s $r/measured_beam/*.csv page; ln -s $r/roller_beam/test[01].txt page/roller; '// &
         'find page page/roller -xtype l -delete')
      call write_file(place//'scripts/run.sh', '#!/usr/bin/env bash'//nl// &
         '[[ $# -gt 0 ]] || set -- reproduce table-4.1'//nl//'exec "$BEAMID_PROGRAM" "$@"'//nl)
      outcome = run('chmod +x page/scripts/run.sh')
      if (draws) return
      outcome = run('cd page/scripts && for s in plot_*.py report.py roller_beam.py; do '// &
         'rm $s; printf "#!/bin/sh\n" >$s; chmod +x $s; done')
   end subroutine prepare

   !> Lines have at most 120 characters and cells of tables 200, except in blocks.
   subroutine check_lines(name, page)
      character(len=*), intent(in) :: name, page
      character(len=:), allocatable :: this, wrong
      logical :: inside
      integer :: k, j

      wrong = ''
      inside = .false.
      do k = 1, line_count(page)
         this = line(page, k)
         if (index(adjustl(this), '```') == 1) inside = .not. inside
         if (index(this, '|') == 1) then
            do j = 2, 30
               if (characters(part(this, j, '|')) > 202) wrong = wrong//' '//to_text(k)
            end do
         else if (.not. inside .and. characters(this) > 120) then
            wrong = wrong//' '//to_text(k)
         end if
      end do
      call check(name//': lines of at most 120 characters, cells of 200'//wrong, wrong == '')
   end subroutine check_lines

   !> The number of characters of UTF-8 text.
   pure integer function characters(text) result(n)
      character(len=*), intent(in) :: text
      integer :: k

      n = count([(iand(iachar(text(k:k)), 192) /= 128, k=1, len(text))])
   end function characters

   !> Whether commands can be run here and now; if not, says why.
   logical function may_run(name, remark, needed, command) result(yes)
      !> Its name, the comment above its block, a file that the page needs, and the command if its
      !> output is compared.
      character(len=*), intent(in) :: name, remark, needed, command

      commands = commands + 1
      yes = .false.
      if (index(remark, 'not run: ') == 1) then
         call skip(name, remark(10:))
      else if (index(remark, 'slow: ') == 1 .and. .not. in_long_run()) then
         call skip(name, remark(7:))
      else if (needed /= '' .and. .not. exists(place//needed)) then
         call skip(name, 'there is no '//needed)
      else if (.not. draws .and. (index(command, 'plot_') > 0 .or. index(command, 'report') > 0 &
         .or. index(command, 'roller_beam.py') > 0)) then
         call skip(name, 'pictures are drawn in long runs only, by matplotlib')
      else
         yes = .true.
      end if
   end function may_run

   !> The exit status that a comment announces.
   integer function expected_status(remark) result(status)
      character(len=*), intent(in) :: remark

      status = 0
      if (index(remark, 'exit status ') == 1) read (remark(13:), *) status
   end function expected_status

   !> Checks that a file that exists holds its block; otherwise writes the block as the file. Groups
   !> of a case file replace those of the same names in a copy of the case that is named before.
   subroutine take_file(page, block)
      character(len=*), intent(in) :: page
      type(block_t), intent(in) :: block
      character(len=:), allocatable :: name, base, whole, groups
      integer :: j

      name = named_file(block%before, 'nml csv f90')
      if (name == '' .or. index(block%text, nl//'...') > 0) return
      if (block%language /= 'nml' .or. index(block%text, '&beam ') == 1) then
         if (exists(place//name)) then
            whole = read_file(place//name)
            call check(page//': '//name//' as printed', index(whole, trimmed(block%text)) > 0)
         else
            call write_file(place//name, trimmed(block%text))
         end if
         return
      end if
      base = named_file(block%before(:index(block%before, '`'//name//'`', back=.true.) - 1), 'nml')
      if (base == '') return
      if (.not. exists(place//base)) return
      whole = read_file(place//base)
      groups = ''
      do j = 1, line_count(whole)
         if (index(nl//block%text, nl//part(line(whole, j), 1, ' ')//' ') == 0) &
            groups = groups//line(whole, j)//nl
      end do
      call write_file(place//name, groups//trimmed(block%text))
   end subroutine take_file

   !> Runs a block of commands as one script that ends at the first error.
   subroutine run_script(page, block)
      character(len=*), intent(in) :: page
      type(block_t), intent(in) :: block
      integer :: status

      call write_file(place//'block.sh', block%text)
      call execute('bash -e block.sh')
      status = expected_status(block%remark)
      call check_status(page//': '//line(block%text, 1), status)
   end subroutine run_script

   !> Runs a command and compares what it prints.
   subroutine try(page, command, printed, status)
      character(len=*), intent(in) :: page, command, printed
      integer, intent(in) :: status
      character(len=:), allocatable :: missing

      call write_file(place//'block.sh', command//nl)
      call execute('bash -e block.sh')
      call check_status(page//': '//command, status)
      if (status /= 0) outcome%out = outcome%out//outcome%err
      call compare(printed, outcome%out, missing)
      if (printed /= '') call check(page//': '//command//': as printed '//missing, missing == '')
   end subroutine try

   !> Runs a block of Python that imports the package.
   subroutine run_python(page, block, needed)
      character(len=*), intent(in) :: page, needed
      type(block_t), intent(in) :: block

      if (python == '') then
         call skip(page//': Python', 'the package is not installed')
         return
      end if
      if (.not. may_run(page//': Python', block%remark, needed, '')) return
      call write_file(place//'block.py', block%text)
      call execute(python//' block.py')
      call check_status(page//': '//line(block%text, 1), 0)
   end subroutine run_python

   !> Checks the exit status of the last command. If it is wrong, prints the command's messages.
   subroutine check_status(name, status)
      character(len=*), intent(in) :: name
      integer, intent(in) :: status

      if (outcome%status == status) then
         call check(name//': exit status '//to_text(status), .true.)
      else
         call check(name//': exit status '//to_text(status), .false., &
            to_text(outcome%status)//': '//outcome%err)
      end if
   end subroutine check_status

   !> Executes a shell command in the folder of the page.
   subroutine execute(command)
      character(len=*), intent(in) :: command

      outcome = run('export BEAMID_PROGRAM='//program_path//' PATH="$PWD/bin:$PATH"; '//command, &
         'page')
   end subroutine execute

   !> Goes through what is printed and what came out. A line `...` stands for any lines, at the end
   !> of a line for the rest of it.
   !>
   !> missing  the first line that was not found where it should be
   subroutine compare(expected, found, missing)
      character(len=*), intent(in) :: expected, found
      character(len=:), allocatable, intent(out) :: missing
      character(len=:), allocatable :: next
      logical :: anywhere
      integer :: i, j

      missing = ''
      anywhere = .false.
      j = 0
      do i = 1, line_count(expected)
         next = line(expected, i)
         if (next == '') cycle
         if (next == '...') then
            anywhere = .true.
            cycle
         end if
         do
            j = j + 1
            if (j > line_count(found)) then
               missing = next
               return
            end if
            if (line(found, j) == '') cycle
            if (alike(next, line(found, j))) exit
            if (anywhere) cycle
            missing = next//' | '//line(found, j)
            return
         end do
         anywhere = .false.
      end do
   end subroutine compare

   !> Whether two lines have the same words and the same numbers, these within .2 % or one and a
   !> half of the last digit: estimates, intervals and criteria that converged have more digits than
   !> that in common on every machine.
   logical function alike(expected, found)
      character(len=*), intent(in) :: expected, found
      character(len=:), allocatable :: a, b, left, right
      real(wp) :: x, y
      logical :: ok(2)

      left = adjustl(expected)
      right = adjustl(found)
      alike = .false.
      do while (len_trim(left) > 0)
         a = part(left, 1, ' ')
         if (a == '...') exit
         b = part(right, 1, ' ')
         call parse_number(bare(a), x, ok(1))
         call parse_number(bare(b), y, ok(2))
         if (all(ok)) then
            if (.not. abs(x - y) <= max(2e-3_wp*abs(x), 1.5_wp*last_digit(bare(a)))) return
         else if (a /= b) then
            return
         end if
         left = adjustl(left(len(a) + 1:))
         right = adjustl(right(min(len(b), len(right)) + 1:))
      end do
      alike = a == '...' .or. len_trim(right) == 0
   end function alike

   !> A number without what stands around it in a sentence.
   pure function bare(word) result(number)
      character(len=*), intent(in) :: word
      character(len=:), allocatable :: number

      number = word(merge(2, 1, index(word, '(') == 1):)
      do while (scan(number, ',;:)%', back=.true.) == len(number) .and. len(number) > 0)
         number = number(:len(number) - 1)
      end do
   end function bare

   !> What one unit of the last digit of a number is.
   pure real(wp) function last_digit(number)
      character(len=*), intent(in) :: number
      integer :: point, exponent, mark, status

      mark = scan(number, 'eE')
      exponent = 0
      if (mark > 0) read (number(mark + 1:), *, iostat=status) exponent
      if (mark == 0) mark = len(number) + 1
      point = index(number(:mark - 1), '.')
      if (point > 0) exponent = exponent - (mark - 1 - point)
      last_digit = 10.0_wp**exponent
   end function last_digit

   !> Without empty lines at the end.
   pure function trimmed(block)
      character(len=*), intent(in) :: block
      character(len=:), allocatable :: trimmed

      trimmed = block
      do while (len(trimmed) > 1)
         if (trimmed(len(trimmed) - 1:) /= nl//nl) exit
         trimmed = trimmed(:len(trimmed) - 1)
      end do
   end function trimmed

end program test_documentation
