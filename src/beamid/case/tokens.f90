!> Splits the text of a case file into tokens: keys, words, strings and punctuation marks.
!> `beamid_namelist` arranges them into groups.
module beamid_tokens
   use beamid_numbers, only: shown
   implicit none
   private

   public :: token_t, scanner_t, line_feed, letters, digits

   !> Kinds of tokens. `token_word` and all kinds after it may be a value of a key.
   integer, parameter, public :: token_end = 0, token_group = 1, token_slash = 2, &
      token_broken = 3, token_key = 4, token_word = 5, token_string = 6, token_mark = 7
   character(len=*), parameter :: line_feed = achar(10), blanks = ' '//achar(9)//achar(13), &
      letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_', digits = '0123456789'

   !> One token.
   type :: token_t
      integer :: kind = token_end          !< one of the kinds above
      integer :: line = 1                  !< line of the text where it begins
      !> Text as written. A group has `&name`, a key `name` without '=', a string the text between
      !> its quotes, a broken token the message that says what is wrong.
      character(len=:), allocatable :: text
   end type token_t

   !> A position in a text and the token before it.
   type :: scanner_t
      character(len=:), allocatable :: text     !< the whole text
      !> Position behind the current token, and the line of this position.
      integer :: next = 1, line = 1
      type(token_t) :: token                    !< the current token
   contains
      procedure :: advance
      procedure :: at_value
      procedure :: skip_values
      procedure :: skip_to_group
   end type scanner_t

contains

   !> Moves to the next token: a string, a word, `name =`, `&name`, or one of the marks , = /
   subroutine advance(self)
      class(scanner_t), intent(inout) :: self
      integer :: first, length, line, next

      call skip_blanks(self%text, self%next, self%line)
      first = self%next
      self%token%line = self%line
      self%token%kind = token_end
      self%token%text = ''
      if (first > len(self%text)) return
      select case (self%text(first:first))
      case ("'", '"')
         call scan_string(self)
         return
      case (',', '=')
         self%token%kind = token_mark
         self%next = first + 1
      case ('&')
         length = verify(self%text(first + 1:), letters//digits)
         if (length == 0) length = len(self%text) - first + 1
         self%token%kind = merge(token_group, token_word, length > 1)
         self%next = first + length
      case default
         self%token%kind = token_word
         self%next = word_end(self%text, first) + 1
         if (self%text(first:self%next - 1) == '/') self%token%kind = token_slash
      end select
      self%token%text = self%text(first:self%next - 1)
      ! A name followed by '=' is a key.
      next = self%next
      line = self%line
      call skip_blanks(self%text, next, line)
      if (index(letters, self%text(first:first)) == 0 .or. letter_at(self%text, next) /= '=') return
      self%token%kind = token_key
      self%next = next + 1
      self%line = line
   end subroutine advance

   !> Returns the position of the last character of a word. A '/' belongs to the word if a name or
   !> number follows directly (`1/2`, `data/a.csv`). Blanks and commas belong to the word inside
   !> the parentheses of a subscript.
   pure integer function word_end(text, first) result(last)
      character(len=*), intent(in) :: text
      integer, intent(in) :: first
      integer, parameter :: longest_subscript = 40
      integer :: i, length

      last = first
      i = first
      do while (i <= len(text))
         if (text(i:i) == '/') then
            if (index(letters//digits//'.~', letter_at(text, i + 1)) == 0) exit
         else if (index(blanks//line_feed//',=!', text(i:i)) > 0) then
            exit
         else if (text(i:i) == '(') then
            length = scan(text(i:min(i + longest_subscript, len(text))), ')'//line_feed)
            if (length > 0) then
               if (text(i + length - 1:i + length - 1) == ')') i = i + length - 1
            end if
         end if
         last = i
         i = i + 1
      end do
   end function word_end

   !> Scans a text in quotes; the scanner stands on the opening quote. The token is broken if the
   !> text does not end in the same line, or if neither a blank nor a mark follows.
   subroutine scan_string(self)
      class(scanner_t), intent(inout) :: self
      character(len=1) :: quote
      integer :: first, length

      first = self%next
      quote = self%text(first:first)
      self%token%kind = token_string
      do
         length = scan(self%text(self%next + 1:), quote//line_feed) - 1
         if (length < 0) length = len(self%text) - self%next
         self%token%text = self%token%text//self%text(self%next + 1:self%next + length)
         self%next = self%next + length + 1
         if (letter_at(self%text, self%next) /= quote) then
            self%token%kind = token_broken
            self%token%text = 'found '//shown(quote//self%token%text)// &
               ' without a closing quote, expected '//quote//' in the same line'
            return
         end if
         self%next = self%next + 1
         if (letter_at(self%text, self%next) /= quote) exit
         self%token%text = self%token%text//quote
      end do
      if (index(blanks//line_feed//',/!=', letter_at(self%text, self%next)) == 0) then
         self%token%kind = token_broken
         self%token%text = 'found '//shown(self%text(first:self%next))// &
            ', expected a blank or '','' behind the closing quote'
      end if
   end subroutine scan_string

   !> Returns the character at a position; behind the end of the text, a line feed.
   pure character(len=1) function letter_at(text, position) result(letter)
      character(len=*), intent(in) :: text
      integer, intent(in) :: position

      letter = line_feed
      if (position <= len(text)) letter = text(position:position)
   end function letter_at

   !> Moves a position, and its line number, past blanks, line ends and comments.
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

   !> Returns whether the current token may be a value of a key.
   pure logical function at_value(self)
      class(scanner_t), intent(in) :: self

      at_value = self%token%kind >= token_word
   end function at_value

   !> Moves past the values behind the current token: to the next key, '/', group or end of text.
   subroutine skip_values(self)
      class(scanner_t), intent(inout) :: self

      call self%advance()
      do while (self%at_value())
         call self%advance()
      end do
   end subroutine skip_values

   !> Moves to the next group that begins on a later line than the token before it, or to the end.
   subroutine skip_to_group(self)
      class(scanner_t), intent(inout) :: self
      integer :: line

      do
         line = self%token%line
         call self%advance()
         if (self%token%kind == token_end) exit
         if (self%token%kind == token_group .and. self%token%line > line) exit
      end do
   end subroutine skip_to_group

end module beamid_tokens
