!> The words, marks and strings of a case file, one after the other, and what is wrong with them.
module beamid_tokens
   use beamid_numbers, only: shown
   use beamid_strings, only: to_text
   implicit none
   private

   public :: scanner_t, line_feed, letters, digits

   integer, parameter, public :: token_end = 0, token_group = 1, token_word = 2, &
      token_string = 3, token_mark = 4, token_broken = 5
   character(len=*), parameter :: line_feed = achar(10), blanks = ' '//achar(9)//achar(13), &
      letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_', digits = '0123456789'
   !> The most problems that are told.
   integer, parameter :: max_problems = 20

   !> The text under the scanner, the current token, and what was found wrong so far.
   type :: scanner_t
      character(len=:), allocatable :: path, text
      !> The problems, one line each, and the group and key that the next one is about.
      character(len=:), allocatable :: problems, place
      integer :: n_problems = 0
      !> Position behind the current token, and the line there.
      integer :: next = 1, next_line = 1
      !> What the current token is, and its line.
      integer :: kind = token_end, line = 1
      !> The token as written; of a string what is between its quotes.
      character(len=:), allocatable :: token
      !> A group whose contents are passed over without a word.
      logical :: quiet = .false.
      !> Parts of the text were passed over, so that a group not seen may still be there.
      logical :: passed_over = .false.
   contains
      procedure :: advance
      procedure :: skip_values
      procedure :: skip_to_group
      procedure :: is_key
      procedure :: is_mark
      procedure :: at_next
      procedure :: problem
   end type scanner_t

contains

   !> The next token. Strings, words, '&name' and the marks , = / are tokens.
   subroutine advance(self)
      class(scanner_t), intent(inout) :: self
      integer :: first

      call skip_blanks(self%text, self%next, self%next_line)
      self%line = self%next_line
      first = self%next
      if (first > len(self%text)) then
         self%kind = token_end
         self%token = ''
         return
      end if
      select case (self%text(first:first))
      case ("'", '"')
         call scan_string(self)
         return
      case (',', '=')
         self%kind = token_mark
         self%next = first + 1
      case ('&')
         self%kind = token_group
         self%next = first + 1
         do while (self%next <= len(self%text))
            if (index(letters//digits, self%text(self%next:self%next)) == 0) exit
            self%next = self%next + 1
         end do
      case default
         self%kind = token_word
         self%next = word_end(self%text, first) + 1
         if (self%text(first:self%next - 1) == '/') self%kind = token_mark
      end select
      self%token = self%text(first:self%next - 1)
   end subroutine advance

   !> The last character of a word. A '/' belongs to it when a name or number follows at once
   !> (`1/2`, `data/a.csv`); blanks and commas belong to it inside the brackets of a subscript.
   pure integer function word_end(text, first) result(last)
      character(len=*), intent(in) :: text
      integer, intent(in) :: first
      integer :: i, line_end

      line_end = index(text(first:), line_feed)
      line_end = merge(first + line_end - 2, len(text), line_end > 0)
      last = first
      i = first
      do while (i <= line_end)
         if (text(i:i) == '/') then
            if (i == line_end) exit
            if (index(letters//digits//'.~', text(i + 1:i + 1)) == 0) exit
         else if (index(blanks//',=!', text(i:i)) > 0) then
            exit
         else if (text(i:i) == '(') then
            i = i + max(index(text(i:line_end), ')') - 1, 0)
         end if
         last = i
         i = i + 1
      end do
   end function word_end

   !> A text in quotes; the scanner stands on the quote. The text ends in the same line, and
   !> behind it stands a blank or a mark.
   subroutine scan_string(self)
      class(scanner_t), intent(inout) :: self
      character(len=1) :: quote
      integer :: first, length

      first = self%next
      quote = self%text(first:first)
      self%kind = token_string
      self%token = ''
      do
         length = scan(self%text(self%next + 1:), quote//line_feed) - 1
         if (length < 0) length = len(self%text) - self%next
         self%token = self%token//self%text(self%next + 1:self%next + length)
         self%next = self%next + length + 1
         if (next_letter(self) /= quote) then
            self%kind = token_broken
            call self%problem('found '//shown(quote//self%token)// &
               ' without a closing quote, expected '//quote//' in the same line')
            return
         end if
         self%next = self%next + 1
         if (next_letter(self) /= quote) exit
         self%token = self%token//quote
      end do
      if (index(blanks//line_feed//',/!=', next_letter(self)) == 0) then
         self%kind = token_broken
         call self%problem('found '//shown(self%text(first:self%next))// &
            ', expected a blank or '','' behind the closing quote')
      end if
   end subroutine scan_string

   !> The character at the scanner's position; a line feed behind the text.
   pure character(len=1) function next_letter(self) result(letter)
      type(scanner_t), intent(in) :: self

      letter = line_feed
      if (self%next <= len(self%text)) letter = self%text(self%next:self%next)
   end function next_letter

   !> Moves a position and its line past blanks, line ends and comments.
   pure subroutine skip_blanks(text, next, line)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: next, line
      integer :: length

      do while (next <= len(text))
         if (text(next:next) == '!') then
            length = index(text(next:), line_feed) - 1
            if (length < 0) length = len(text) - next + 1
            next = next + length
         else if (index(blanks//line_feed, text(next:next)) > 0) then
            if (text(next:next) == line_feed) line = line + 1
            next = next + 1
         else
            exit
         end if
      end do
   end subroutine skip_blanks

   !> Goes to the next line that begins with '&', or to the end.
   subroutine skip_to_group(self)
      class(scanner_t), intent(inout) :: self
      integer :: length

      self%passed_over = .true.
      do
         length = index(self%text(self%next:), line_feed)
         if (length == 0) then
            self%next = len(self%text) + 1
            exit
         end if
         self%next = self%next + length
         self%next_line = self%next_line + 1
         length = verify(self%text(self%next:), blanks)
         if (length == 0) cycle
         self%next = self%next + length - 1
         if (next_letter(self) == '&') exit
      end do
      call self%advance()
   end subroutine skip_to_group

   !> Goes on from the current token to the next key, '/', group or end.
   subroutine skip_values(self)
      class(scanner_t), intent(inout) :: self

      call self%advance()
      do while (.not. self%at_next())
         call self%advance()
      end do
   end subroutine skip_values

   !> Whether the values of a key end before the current token.
   pure logical function at_next(self)
      class(scanner_t), intent(in) :: self

      at_next = self%kind == token_end .or. self%kind == token_group .or. &
         self%kind == token_broken .or. self%is_mark('/') .or. self%is_key()
   end function at_next

   !> Whether the current token is one of some marks.
   pure logical function is_mark(self, marks)
      class(scanner_t), intent(in) :: self
      character(len=*), intent(in) :: marks

      is_mark = self%kind == token_mark .and. index(marks, self%token) > 0
   end function is_mark

   !> Whether the current token is a name with '=' behind it.
   pure logical function is_key(self)
      class(scanner_t), intent(in) :: self
      integer :: next, line

      is_key = .false.
      if (self%kind /= token_word) return
      if (index(letters, self%token(1:1)) == 0) return
      next = self%next
      line = self%next_line
      call skip_blanks(self%text, next, line)
      is_key = index(self%text(next:), '=') == 1
   end function is_key

   !> Writes down a problem at a line (the current token's, unless given).
   subroutine problem(self, message, line)
      class(scanner_t), intent(inout) :: self
      !> What was found and what was expected.
      character(len=*), intent(in) :: message
      !> Another line than the current token's.
      integer, intent(in), optional :: line
      integer :: where_it_is

      if (self%quiet) return
      self%n_problems = self%n_problems + 1
      if (self%n_problems > max_problems) return
      where_it_is = self%line
      if (present(line)) where_it_is = line
      if (self%n_problems > 1) self%problems = self%problems//line_feed
      self%problems = self%problems//self%path//':'//to_text(where_it_is)//': '// &
         self%place//message
   end subroutine problem

end module beamid_tokens
