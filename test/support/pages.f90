!> Reads the blocks of Markdown pages: commands, what they print, case files and other files.
module pages
   use shell, only: line_count
   use tables, only: line, part
   implicit none
   private

   public :: block_t, next_block, next_command, named_file

   character(len=*), parameter :: nl = achar(10), margin = '    ', fence = '```'

   !> A fenced or indented block of a page.
   type :: block_t
      !> 'sh' (commands), 'console' (commands behind `$ ` and what they print), 'nml', 'csv',
      !> 'python' and so on; '' if the block has no language and does not begin with a command.
      character(len=:), allocatable :: language
      !> The lines of the block, without fence and margin.
      character(len=:), allocatable :: text
      !> The lines between the block before and this one.
      character(len=:), allocatable :: before
      !> The words of the HTML comment right above the block, as in `<!-- slow: a minute -->`; ''.
      character(len=:), allocatable :: remark
   end type block_t

contains

   !> Finds the next block of a page; false if there is none.
   logical function next_block(page, k, block) result(found)
      !> The page, and the number of the line at which to begin; then of the line behind the block.
      character(len=*), intent(in) :: page
      integer, intent(inout) :: k
      type(block_t), intent(out) :: block
      character(len=:), allocatable :: this, above
      integer :: last

      last = line_count(page)
      block%before = ''
      block%text = ''
      above = ''
      found = .true.
      do while (k <= last)
         this = line(page, k)
         if (index(adjustl(this), fence) == 1) then
            call take_fenced(page, k, block)
         else if (index(this, margin) == 1 .and. above == '') then
            call take_indented(page, k, block)
         else
            block%before = block%before//this//nl
            above = this
            k = k + 1
            cycle
         end if
         if (block%language == '') block%language = language_of(line(block%text, 1))
         block%remark = remark_in(block%before)
         return
      end do
      found = .false.
   end function next_block

   !> Takes the block whose fence is line k. Lines of a block in a list lose the fence's margin.
   subroutine take_fenced(page, k, block)
      character(len=*), intent(in) :: page
      integer, intent(inout) :: k
      type(block_t), intent(inout) :: block
      character(len=:), allocatable :: this
      integer :: indent

      this = line(page, k)
      indent = len(this) - len(trim(adjustl(this)))
      block%language = part(this(indent + len(fence) + 1:), 1, ' ')
      do
         k = k + 1
         if (k > line_count(page)) return
         this = line(page, k)
         if (index(adjustl(this), fence) == 1) exit
         block%text = block%text//this(min(indent, len(this)) + 1:)//nl
      end do
      k = k + 1
   end subroutine take_fenced

   !> Takes the indented block that begins in line k.
   subroutine take_indented(page, k, block)
      character(len=*), intent(in) :: page
      integer, intent(inout) :: k
      type(block_t), intent(inout) :: block
      character(len=:), allocatable :: this

      block%language = ''
      do while (k <= line_count(page))
         this = line(page, k)
         if (this /= '' .and. index(this, margin) /= 1) exit
         block%text = block%text//this(min(len(margin), len(this)) + 1:)//nl
         k = k + 1
      end do
   end subroutine take_indented

   !> The language of a block that names none, from its first line.
   function language_of(first) result(language)
      character(len=*), intent(in) :: first
      character(len=:), allocatable :: language
      character(len=*), parameter :: programs(*) = [character(len=8) :: 'beamid', 'fpm', 'pip', &
         'gfortran', 'python3', 'git', 'export', 'bash', 'cd']
      character(len=:), allocatable :: word

      word = part(first, 1, ' ')
      language = ''
      if (index(first, '&') == 1) language = 'nml'
      if (index(first, 'scripts/') == 1 .or. any(programs == word)) language = 'sh'
      if (word == '$') language = 'console'
   end function language_of

   !> The words of an HTML comment that is the last line but empty ones.
   function remark_in(before) result(remark)
      character(len=*), intent(in) :: before
      character(len=:), allocatable :: remark, this
      integer :: k

      remark = ''
      do k = line_count(before), 1, -1
         this = line(before, k)
         if (this == '') cycle
         if (index(this, '<!-- ') == 1 .and. index(this, ' -->') > 0) &
            remark = this(6:index(this, ' -->') - 1)
         return
      end do
   end function remark_in

   !> Takes the next command and what stands below it from the text of a 'console' block. A command
   !> whose line ends with a backslash goes on in the next line.
   logical function next_command(text, command, printed) result(there)
      character(len=:), allocatable, intent(inout) :: text
      character(len=:), allocatable, intent(out) :: command, printed
      character(len=:), allocatable :: this
      integer :: end

      there = index(text, '$ ') == 1
      if (.not. there) return
      command = ''
      do
         this = line(text, 1)
         command = command//this//nl
         text = text(min(len(this) + 2, len(text) + 1):)
         if (index(this, '\', back=.true.) /= len(this) .or. text == '') exit
      end do
      command = command(3:len(command) - 1)
      end = index(nl//text, nl//'$ ')
      if (end == 0) end = len(text) + 1
      printed = text(:end - 1)
      text = text(end:)
   end function next_command

   !> The last file that a text names in backticks, with one of the endings; '': none.
   function named_file(text, endings) result(name)
      !> The text, and endings as in 'nml csv'.
      character(len=*), intent(in) :: text, endings
      character(len=:), allocatable :: name, ending
      integer :: k, end, begin, last

      name = ''
      last = 0
      do k = 1, 10
         ending = part(endings, k, ' ')
         if (ending == '') return
         end = index(text, '.'//ending//'`', back=.true.)
         if (end <= last) cycle
         begin = index(text(:end), '`', back=.true.)
         name = text(begin + 1:end + len(ending))
         last = end
      end do
   end function named_file

end module pages
