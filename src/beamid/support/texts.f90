!> Text that grows in memory line by line until it is printed or written as a whole, and the layout
!> of columns and long lines.
module beamid_texts
   use beamid_kinds, only: ip
   implicit none
   private

   public :: text_t, left, next_line, right, wrapped

   !> Default width of a column [characters].
   integer, parameter :: width = 14

   !> A growing text; its buffer doubles when it is full.
   type :: text_t
      character(len=:), allocatable, private :: buffer
      integer(ip), private :: length = 0
   contains
      procedure :: add
      procedure :: line
      procedure :: content
      procedure :: get
      procedure :: is_empty
   end type text_t

contains

   !> Appends a piece unchanged.
   pure subroutine add(self, piece)
      class(text_t), intent(inout) :: self
      character(len=*), intent(in) :: piece
      character(len=:), allocatable :: larger
      integer(ip) :: length

      ! 64 bits are needed: a text of more than 2**30 characters doubles to more than 2**31.
      length = self%length + len(piece, ip)
      if (.not. allocated(self%buffer)) allocate (character(len=4096) :: self%buffer)
      if (length > len(self%buffer, ip)) then
         allocate (character(len=2*length) :: larger)
         larger(:self%length) = self%buffer(:self%length)
         call move_alloc(larger, self%buffer)
      end if
      self%buffer(self%length + 1:length) = piece
      self%length = length
   end subroutine add

   !> Appends a line without its trailing blanks; without `piece`, an empty line.
   pure subroutine line(self, piece)
      class(text_t), intent(inout) :: self
      character(len=*), intent(in), optional :: piece

      if (present(piece)) call self%add(trim(piece))
      call self%add(new_line('a'))
   end subroutine line

   !> Returns the whole text.
   pure function content(self)
      class(text_t), intent(in) :: self
      character(len=:), allocatable :: content

      call self%get(content)
   end function content

   !> Copies the whole text, as `content` returns it, for procedures that run in threads: these must
   !> not call functions whose result is text of deferred length.
   pure subroutine get(self, content)
      class(text_t), intent(in) :: self
      character(len=:), allocatable, intent(out) :: content

      content = ''
      if (allocated(self%buffer)) content = self%buffer(:self%length)
   end subroutine get

   !> Returns whether nothing has been appended.
   pure logical function is_empty(self)
      class(text_t), intent(in) :: self

      is_empty = self%length == 0
   end function is_empty

   !> Takes the next line of a text; returns .false. if there is none.
   !>
   !> first  where the line begins, at the first call 1; on return where the next one begins
   !> line   the line without its line feed
   logical function next_line(text, first, line)
      character(len=*), intent(in) :: text
      integer(ip), intent(inout) :: first
      character(len=:), allocatable, intent(out) :: line
      integer(ip) :: length

      next_line = first <= len(text, ip)
      if (.not. next_line) return
      length = index(text(first:), new_line('a'), kind=ip) - 1
      if (length < 0) length = len(text, ip) - first + 1
      line = text(first:first + length - 1)
      first = first + length + 1
   end function next_line

   !> Returns text in which long lines are broken between words.
   !>
   !> indent   indentation of the continuation lines; default 4
   !> longest  largest length of a line; default 100 [characters]
   function wrapped(content, indent, longest)
      character(len=*), intent(in) :: content
      integer, intent(in), optional :: indent, longest
      character(len=:), allocatable :: wrapped
      character(len=:), allocatable :: line
      type(text_t) :: text
      integer(ip) :: first
      integer :: cut, margin, most

      margin = 4
      if (present(indent)) margin = indent
      most = 100
      if (present(longest)) most = longest
      first = 1
      do while (next_line(content, first, line))
         do while (len(line) > most)
            cut = scan(line(:most + 1), ' ', back=.true.)
            if (verify(line(:cut), ' ') == 0) exit
            call text%line(line(:cut))
            line = repeat(' ', margin)//adjustl(line(cut + 1:))
         end do
         call text%line(line)
      end do
      wrapped = text%content()
   end function wrapped

   !> Returns text at the right end of a column, with at least one blank before it.
   pure function right(text, columns)
      character(len=*), intent(in) :: text
      integer, intent(in), optional :: columns
      character(len=:), allocatable :: right
      integer :: wide

      wide = width
      if (present(columns)) wide = columns
      right = repeat(' ', max(1, wide - len_trim(adjustl(text))))//trim(adjustl(text))
   end function right

   !> Returns text at the left end of a column.
   pure function left(text, columns)
      character(len=*), intent(in) :: text
      integer, intent(in) :: columns
      character(len=max(columns, len(text))) :: left

      left = text
   end function left

end module beamid_texts
