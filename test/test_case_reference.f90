!> `help --markdown` prints a complete reference: every group, key and parameter of the tables has
!> one row in its section, the rows of a table have as many columns as its header, and no cell is
!> too long to be read. The page in docs/ is the page that the program prints.
program test_case_reference
   use bad_cases, only: refused_command
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_case_reference, only: as_cell
   use beamid_key_facts, only: allowed_of, default_of, example_of, unit_of
   use beamid_parameters, only: key_of, parameters
   use beamid_structure, only: is_coefficient
   use beamid_values, only: key_t
   use checks, only: check, finish, skip
   use shell, only: beamid, close_shell, line_count, open_shell, outcome_t, read_file, replaced
   use tables, only: line
   implicit none

   character(len=*), parameter :: nl = achar(10)
   !> The longest cell, and the longest line that is no row.
   integer, parameter :: most_in_cell = 200, most_in_line = 120
   character(len=:), allocatable :: reason, page
   type(outcome_t) :: outcome

   call test_cells()
   call open_shell(reason)
   if (reason /= '') then
      call skip('case reference', reason)
   else
      outcome = beamid('help --markdown')
      call check('help --markdown', outcome%status == 0 .and. outcome%err == '', outcome%err)
      page = outcome%out
      call check('docs/reference/case-file.md is what help --markdown prints', page == &
         read_file('../../docs/reference/case-file.md'), 'scripts/docs.sh writes the page')
      call test_groups()
      call test_parameters()
      call test_lines()
      call test_arguments()
   end if
   call close_shell()
   call finish('case reference')

contains

   !> Markdown leaves escaped characters as they are.
   subroutine test_cells()
      call check('characters of Markdown', as_cell('a|b<c>d*e') == 'a\|b&lt;c&gt;d\*e', &
         as_cell('a|b<c>d*e'))
      call check('names of groups', as_cell('of &beam, a & b') == 'of `&beam`, a &amp; b', &
         as_cell('of &beam, a & b'))
      call check('columns are counted', columns_of('| a | b\|c |') == 2)
      call check('cells are measured', longest_cell('| a | b\|c | |') == 4)
   end subroutine test_cells

   !> Every group has one section, and in it every key has one row and no other row stands.
   subroutine test_groups()
      type(block_t), allocatable :: blocks(:)
      character(len=:), allocatable :: part, prose
      integer :: g, k

      call list_keys(blocks)
      do g = 1, size(blocks)
         call check('section &'//blocks(g)%name, count_of(nl//heading(blocks(g)%name)//nl) == 1)
         part = section(heading(blocks(g)%name))
         prose = part
         if (part /= '') prose = replaced(part, nl, ' ')
         call check('&'//blocks(g)%name//': a purpose', groups(g)%purpose /= '' .and. &
            index(prose, as_cell(trim(groups(g)%purpose))) > 0)
         call check('&'//blocks(g)%name//': whether it may repeat', groups(g)%may_repeat .eqv. &
            index(prose, 'The group may repeat.') > 0)
         call check('&'//blocks(g)%name//': as many rows as keys', rows_with(part, '| `') &
            == size(blocks(g)%keys), part)
         do k = 1, size(blocks(g)%keys)
            call check_key(part, blocks(g)%name, blocks(g)%keys(k))
         end do
      end do
      call check('as many sections as groups', count_of(nl//'## `&') == size(groups))
   end subroutine test_groups

   !> One row, with meaning, unit, allowed values, default and example.
   subroutine check_key(part, group, key)
      character(len=*), intent(in) :: part, group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: row

      call check('&'//group//' '//trim(key%name)//': one row', rows_with(part, &
         '| `'//trim(key%name)//'` |') == 1)
      row = row_with(part, '| `'//trim(key%name)//'` |')
      call check('&'//group//' '//trim(key%name)//': its cells', index(row, ' | '// &
         as_cell(key%help)//' | '//as_cell(unit_of(group, key))//' | '// &
         as_cell(allowed_of(group, key))//' | '//as_cell(default_of(key))//' | `'// &
         example_of(group, key)//'` |') > 0, row)
   end subroutine check_key

   !> Every parameter that a fit may estimate has one row.
   subroutine test_parameters()
      character(len=:), allocatable :: part, symbol
      integer :: k, n

      part = section('## Parameters')
      n = 0
      do k = 1, size(parameters)
         if (.not. parameters(k)%is_free .or. parameters(k)%item > 1) cycle
         n = n + 1
         symbol = trim(parameters(k)%name)
         if (is_coefficient(k)) symbol = trim(parameters(k)%group)
         call check('parameter '//symbol//': one row', rows_with(part, '| `'//symbol//'` |') == 1)
         if (.not. is_coefficient(k)) call check('parameter '//symbol//': its key', &
            index(row_with(part, '| `'//symbol//'` |'), '| `&'//trim(parameters(k)%group)// &
            '` `'//key_of(k)//'` |') > 0)
      end do
      call check('as many rows as parameters', rows_with(part, '| `') == n)
   end subroutine test_parameters

   !> Rows have the columns of their table; cells and lines are short.
   subroutine test_lines()
      character(len=:), allocatable :: this
      integer :: columns, k

      columns = 0
      do k = 1, line_count(page)
         this = line(page, k)
         if (index(this, '|') == 1) then
            if (columns == 0) columns = columns_of(this)
            call check('columns: '//this(:min(30, len(this))), columns_of(this) == columns)
            call check('cells: '//this(:min(30, len(this))), longest_cell(this) &
               <= most_in_cell, this)
         else
            columns = 0
            if (len(this) > most_in_line) call check('lines are short', .false., this)
         end if
      end do
      call check('lines are printable', all([(page(k:k) == nl .or. iachar(page(k:k)) >= 32 &
         .and. iachar(page(k:k)) < 127, k=1, len(page))]))
   end subroutine test_lines

   !> Other words beside the option are refused.
   subroutine test_arguments()
      call refused_command('help --markdown xyz', 'found xyz|expected nothing more')
      call refused_command('help beam --markdown', 'found beam|expected nothing more')
      call refused_command('modes case.nml --markdown', 'found --markdown|expected it behind help')
   end subroutine test_arguments

   pure function heading(group)
      character(len=*), intent(in) :: group
      character(len=:), allocatable :: heading

      heading = '## `&'//group//'`'
   end function heading

   !> Returns the lines from a heading to the next one.
   function section(title) result(lines)
      character(len=*), intent(in) :: title
      character(len=:), allocatable :: lines
      integer :: first, length

      lines = ''
      first = index(page, nl//title//nl)
      if (first == 0) return
      lines = page(first + len(title) + 2:)
      length = index(lines, nl//'## ')
      if (length > 0) lines = lines(:length)
   end function section

   !> Counts a text in the page; two of them may share a character at their ends.
   pure integer function count_of(text) result(n)
      character(len=*), intent(in) :: text
      integer :: k

      n = count([(page(k:k + len(text) - 1) == text, k=1, len(page) - len(text) + 1)])
   end function count_of

   !> Counts the lines that begin with a text.
   pure integer function rows_with(part, beginning) result(n)
      character(len=*), intent(in) :: part, beginning
      integer :: k

      n = count([(index(line(part, k), beginning) == 1, k=1, line_count(part))])
   end function rows_with

   !> Returns the first line that begins with a text, or ''.
   pure function row_with(part, beginning) result(row)
      character(len=*), intent(in) :: part, beginning
      character(len=:), allocatable :: row
      integer :: k

      do k = 1, line_count(part)
         row = line(part, k)
         if (index(row, beginning) == 1) return
      end do
      row = ''
   end function row_with

   !> Counts the cells of a row: bars that are not escaped stand before, between and behind them.
   pure integer function columns_of(row) result(n)
      character(len=*), intent(in) :: row

      n = size(bars(row)) - 1
   end function columns_of

   !> Returns the length of the longest cell, without the blanks around it.
   pure integer function longest_cell(row) result(length)
      character(len=*), intent(in) :: row
      integer, allocatable :: places(:)
      integer :: k

      places = bars(row)
      length = 0
      do k = 1, size(places) - 1
         length = max(length, len_trim(adjustl(row(places(k) + 1:places(k + 1) - 1))))
      end do
   end function longest_cell

   !> Returns the places of the bars in a row that are not escaped.
   pure function bars(row) result(places)
      character(len=*), intent(in) :: row
      integer, allocatable :: places(:)
      integer :: k

      places = pack([(k, k=1, len(row))], [(row(k:k) == '|' .and. row(max(1, k - 1): &
         max(1, k - 1)) /= '\', k=1, len(row))])
   end function bars

end program test_case_reference
