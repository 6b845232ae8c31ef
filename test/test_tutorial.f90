!> What docs/tutorials/record-to-parameters.md and docs/how-to/own-record.md print is what their
!> commands print: case files are taken from their blocks, and the commands behind `$` are run. The
!> measured records lie beside the checkout; without them, or without what draws pictures, those
!> commands are skipped.
program test_tutorial
   use beamid_kinds, only: wp
   use beamid_numbers, only: parse_number
   use checks, only: check, finish, in_long_run, skip
   use shell, only: close_shell, exists, line_count, open_shell, outcome_t, program_path, &
      python_with, read_file, replaced, run, write_file
   use tables, only: line, part
   implicit none

   character(len=*), parameter :: nl = achar(10), margin = '    ', records = '../../../shared/data/'
   character(len=:), allocatable :: reason, text, block, before, command, printed
   type(outcome_t) :: outcome
   logical :: draws
   integer :: k, last, commands

   call open_shell(reason)
   if (reason /= '') then
      call skip('tutorial', reason)
   else
      outcome = run('ln -s ../../scripts scripts && cp -r ../../data data && '// &
         'cat ../../docs/tutorials/record-to-parameters.md ../../docs/how-to/own-record.md '// &
         '>pages.md && mkdir roller')
      call check('a checkout of its own', outcome%status == 0, outcome%err)
      if (exists(records//'measured_beam')) outcome = run('ln -s '//records// &
         'measured_beam/*.csv .')
      if (exists(records//'roller_beam')) outcome = run('ln -s ../'//records// &
         'roller_beam/test[01].txt roller')
      draws = python_with('numpy, matplotlib') /= ''
      text = read_file('pages.md')
      last = line_count(text)
      commands = 0
      before = ''
      k = 1
      do while (k <= last)
         block = block_at(k)
         if (block == '') then
            before = before//line(text, k)//nl
            k = k + 1
            cycle
         end if
         k = k + line_count(block)
         if (block(:1) == '&') call take_case(named(before), block)
         do while (next_command(block, command, printed))
            commands = commands + 1
            call try(command, printed)
         end do
         before = ''
      end do
      call check('commands are there', commands == 12)
   end if
   call close_shell()
   call finish('tutorial')

contains

   !> The indented block that begins in line k behind an empty one, without its margin; else ''.
   function block_at(k) result(block)
      integer, intent(in) :: k
      character(len=:), allocatable :: block, next
      integer :: j

      block = ''
      next = line(text, k)
      if (index(next, margin) /= 1 .or. line(text, max(k - 1, 1)) /= '') return
      do j = k, last
         next = line(text, j)
         if (next /= '' .and. index(next, margin) /= 1) exit
         block = block//next(min(len(margin), len(next)) + 1:)//nl
      end do
   end function block_at

   !> The last case file that a paragraph names in backticks.
   function named(paragraph) result(name)
      character(len=*), intent(in) :: paragraph
      character(len=:), allocatable :: name
      integer :: begin, end

      end = index(paragraph, '.nml`', back=.true.)
      begin = index(paragraph(:end), '`', back=.true.)
      name = ''
      if (end > 0) name = paragraph(begin + 1:end + 3)
   end function named

   !> A whole case is the one in data/, or becomes a file; groups alone take the place of those of
   !> the same names in a copy of the case that the sentence names before.
   subroutine take_case(name, block)
      character(len=*), intent(in) :: name, block
      character(len=:), allocatable :: whole, base, groups
      integer :: j

      if (name == '' .or. index(block, nl//'...') > 0) return
      if (index(block, '&beam ') == 1) then
         if (exists(name)) then
            whole = read_file(name)
            call check(name//' as printed', index(whole, trimmed(block)) > 0, whole)
         else
            call write_file(name, trimmed(block))
         end if
         return
      end if
      base = named(before(:index(before, '`'//name//'`', back=.true.) - 1))
      if (.not. exists(base)) return
      whole = read_file(base)
      groups = ''
      do j = 1, line_count(whole)
         if (index(block, part(line(whole, j), 1, ' ')//' ') == 0) &
            groups = groups//line(whole, j)//nl
      end do
      call write_file(name, groups//trimmed(block))
   end subroutine take_case

   !> Takes a command and what stands below it from a block.
   logical function next_command(block, command, printed) result(there)
      character(len=:), allocatable, intent(inout) :: block
      character(len=:), allocatable, intent(out) :: command, printed
      integer :: begin, end

      begin = index(nl//block, nl//'$ ')
      there = begin > 0
      if (.not. there) return
      command = line(block(begin + 2:), 1)
      block = block(begin + 3 + len(command):)
      end = index(nl//block, nl//'$ ')
      if (end == 0) end = len(block) + 1
      printed = block(:end - 1)
      block = block(end:)
   end function next_command

   !> Runs a command and compares.
   subroutine try(command, printed)
      character(len=*), intent(in) :: command, printed
      character(len=:), allocatable :: changed, missing

      if (index(command, 'plot_') > 0 .or. index(command, 'roller_beam.py') > 0) then
         if (.not. draws) then
            call skip(command, 'no matplotlib')
            return
         end if
      end if
      if ((index(command, 'measured') > 0 .or. index(command, 'refined') > 0) .and. &
         .not. exists('cantilever_50cm_release.csv') .or. &
         index(command, 'roller') > 0 .and. .not. exists('roller/test0.txt')) then
         call skip(command, 'there is no record of it')
         return
      end if
      if (index(command, 'roller') > 0 .and. .not. in_long_run()) then
         call skip(command, 'too long for every day; test_roller_beam runs a part')
         return
      end if
      changed = command
      if (index(command, 'scripts/run.sh') == 1) changed = replaced(command, 'scripts/run.sh', &
         '$BEAMID_PROGRAM')
      outcome = run('export BEAMID_PROGRAM='//program_path//'; '//changed)
      call check(command//': runs', outcome%status == 0, outcome%err)
      call compare(printed, outcome%out, missing)
      call check(command//': as printed', missing == '', missing)
   end subroutine try

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

end program test_tutorial
