!> Checks a case file against a table of groups and keys before gfortran's namelist reader sees it.
!>
!> That reader reports most mistakes as "End of file", lets others pass in silence and crashes on
!> `mass(`. Here every problem gets one line, `file:line: &group key: found X, expected Y`; what
!> passes is handed over as clean text that `read (text, nml=group)` accepts.
module beamid_namelist
   use beamid_kinds, only: wp, ip
   use beamid_errors, only: error_t, bad_input
   use beamid_files, only: read_text
   use beamid_csv, only: is_decimal, parse_number, shown
   implicit none
   private

   public :: key_t, group_t, block_t, real_key, integer_key, string_key, group, scan_namelist
   public :: kind_real, kind_integer, kind_string, name_length, string_length

   !> What the values of a key are.
   integer, parameter :: kind_real = 1, kind_integer = 2, kind_string = 3
   !> The longest name of a group or a key.
   integer, parameter :: name_length = 63
   !> The longest string value: declare `character(len=string_length)` and nothing is cut.
   integer, parameter :: string_length = 512
   !> The largest case file, bytes, and the most problems that are told.
   integer, parameter :: max_bytes = 2**18, max_problems = 20

   !> One key of a group.
   type :: key_t
      character(len=name_length) :: name = ''
      integer :: kind = kind_real
      !> How many values it takes at most; 1 for a scalar.
      integer :: max_count = 1
   end type key_t

   !> One group and what it may hold.
   type :: group_t
      character(len=name_length) :: name = ''
      type(key_t), allocatable :: keys(:)
      logical :: may_repeat = .false., required = .false.
   end type group_t

   !> One group as it was found in a file.
   type :: block_t
      !> The group's name as the table spells it.
      character(len=name_length) :: name = ''
      !> The line of its '&'.
      integer :: line = 0
      !> Clean text for `read (text, nml=...)`.
      character(len=:), allocatable :: text
      type(key_t), allocatable, private :: keys(:)
      integer, allocatable, private :: lines(:), counts(:)
   contains
      procedure :: has
      procedure :: count_of
      procedure :: line_of
   end type block_t

   integer, parameter :: token_end = 0, token_group = 1, token_word = 2, token_string = 3, &
      token_mark = 4, token_broken = 5
   character(len=*), parameter :: line_feed = achar(10), blanks = ' '//achar(9)//achar(13), &
      letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_', digits = '0123456789'

   !> The text under the scanner, the current token, and what was found wrong so far.
   type :: scanner_t
      character(len=:), allocatable :: path, text, problems, place
      integer :: n_problems = 0
      !> Position behind the current token, and the line there.
      integer :: next = 1, next_line = 1
      integer :: kind = token_end, line = 1
      !> The token as written; of a string what is between its quotes.
      character(len=:), allocatable :: token
      !> A group whose contents are passed over without a word.
      logical :: quiet = .false.
      !> Parts of the text were passed over, so that a group not seen may still be there.
      logical :: passed_over = .false.
   contains
      procedure :: problem
      procedure :: skip_to_group
      procedure :: skip_values
      procedure :: advance
      procedure :: is_key
      procedure :: is_mark
      procedure :: at_next
   end type scanner_t

contains

   !> A key whose values are real numbers.
   pure type(key_t) function real_key(name, max_count) result(key)
      !> The key's name.
      character(len=*), intent(in) :: name
      !> How many values it takes at most; default 1.
      integer, intent(in), optional :: max_count

      key = key_t(name, kind_real, 1)
      if (present(max_count)) key%max_count = max_count
   end function real_key

   !> A key whose values are integers.
   pure type(key_t) function integer_key(name, max_count) result(key)
      !> The key's name.
      character(len=*), intent(in) :: name
      !> How many values it takes at most; default 1.
      integer, intent(in), optional :: max_count

      key = real_key(name, max_count)
      key%kind = kind_integer
   end function integer_key

   !> A key whose values are texts in quotes.
   pure type(key_t) function string_key(name, max_count) result(key)
      !> The key's name.
      character(len=*), intent(in) :: name
      !> How many values it takes at most; default 1.
      integer, intent(in), optional :: max_count

      key = real_key(name, max_count)
      key%kind = kind_string
   end function string_key

   !> A group of keys.
   pure type(group_t) function group(name, keys, may_repeat, required) result(table)
      !> The group's name, without '&'.
      character(len=*), intent(in) :: name
      !> Its keys.
      type(key_t), intent(in) :: keys(:)
      !> Whether it may stand in a file more than once, and whether it must be there; default no.
      logical, intent(in), optional :: may_repeat, required

      table%name = name
      table%keys = keys
      if (present(may_repeat)) table%may_repeat = may_repeat
      if (present(required)) table%required = required
   end function group

   !> Whether a key was given.
   pure logical function has(self, key)
      class(block_t), intent(in) :: self
      !> The key's name, in any case.
      character(len=*), intent(in) :: key

      has = self%count_of(key) > 0
   end function has

   !> How many values a key was given; 0 when it is absent.
   pure integer function count_of(self, key) result(n)
      class(block_t), intent(in) :: self
      !> The key's name, in any case.
      character(len=*), intent(in) :: key
      integer :: k

      n = 0
      k = find_key(self%keys, key)
      if (k > 0) n = self%counts(k)
   end function count_of

   !> The line on which a key stands; the group's line when it is absent.
   pure integer function line_of(self, key) result(line)
      class(block_t), intent(in) :: self
      !> The key's name, in any case.
      character(len=*), intent(in) :: key
      integer :: k

      line = self%line
      k = find_key(self%keys, key)
      if (k == 0) return
      if (self%lines(k) > 0) line = self%lines(k)
   end function line_of

   !> Reads a case file and checks it; all problems are found, up to 20, one line each.
   subroutine scan_namelist(path, text, schema, blocks, error)
      !> The file's path, for messages.
      character(len=*), intent(in) :: path
      !> The file's text.
      character(len=*), intent(in) :: text
      !> The groups that are known.
      type(group_t), intent(in) :: schema(:)
      !> The groups that were found, in the order of the file; size 0 after an error.
      type(block_t), allocatable, intent(out) :: blocks(:)
      !> Allocated when there are problems.
      type(error_t), allocatable, intent(out) :: error
      type(scanner_t) :: scanner
      integer :: n, seen(size(schema))

      allocate (blocks(count_of_mark(text)))
      scanner%path = path
      scanner%problems = ''
      n = 0
      seen = 0
      call refuse_binary(scanner, text)
      if (scanner%n_problems == 0) then
         scanner%text = text
         if (index(text, char(239)//char(187)//char(191)) == 1) scanner%next = 4
         call scan_groups(scanner, schema, seen, blocks, n)
         call require_groups(scanner, schema, seen)
      end if
      if (scanner%n_problems > 0) then
         n = 0
         call bad_input(error, scanner%problems)
      end if
      blocks = blocks(:n)
   end subroutine scan_namelist

   !> Goes through all groups of the text.
   subroutine scan_groups(scanner, schema, seen, blocks, n)
      type(scanner_t), intent(inout) :: scanner
      !> The groups that are known.
      type(group_t), intent(in) :: schema(:)
      !> Line where each known group was first seen, 0 for not at all.
      integer, intent(inout) :: seen(:)
      !> The groups found so far and their number.
      type(block_t), intent(inout) :: blocks(:)
      integer, intent(inout) :: n
      character(len=:), allocatable :: name
      integer :: g, i

      call scanner%advance()
      do while (scanner%kind /= token_end)
         scanner%quiet = .false.
         scanner%place = ''
         if (scanner%kind == token_broken) then
            call scanner%skip_to_group()
            cycle
         else if (scanner%kind /= token_group .or. scanner%token == '&') then
            call scanner%problem('found '//shown(scanner%token)//' outside a group, expected '// &
               '''&name'' and, behind the group, ''/''')
            call scanner%skip_to_group()
            cycle
         end if
         name = scanner%token(2:)
         g = find_group(schema, name)
         if (g == 0) then
            call scanner%problem('found unknown group '//shown(scanner%token)//', expected '// &
               list('&', [(schema(i)%name, i=1, size(schema))]))
            scanner%passed_over = .true.
         else if (seen(g) > 0 .and. .not. schema(g)%may_repeat) then
            call scanner%problem('found &'//trim(schema(g)%name)//' again, expected it once '// &
               '(first in line '//integer_text(seen(g))//')')
         else
            seen(g) = scanner%line
            n = n + 1
            call scan_group(scanner, schema(g), blocks(n))
            cycle
         end if
         scanner%quiet = .true.
         call scan_group(scanner, group(name, [key_t ::]))
      end do
   end subroutine scan_groups

   !> Goes through one group; the scanner stands on its name and ends on the token behind it.
   subroutine scan_group(scanner, table, found)
      type(scanner_t), intent(inout) :: scanner
      !> The group's keys.
      type(group_t), intent(in) :: table
      !> What was found in it.
      type(block_t), intent(out), optional :: found
      type(block_t) :: item
      integer :: line

      line = scanner%line
      item%name = table%name
      item%line = line
      item%text = '&'//trim(table%name)
      item%keys = table%keys
      allocate (item%lines(size(table%keys)), item%counts(size(table%keys)), source=0)
      call scanner%advance()
      do
         scanner%place = '&'//trim(table%name)//': '
         if (scanner%kind == token_end .or. scanner%kind == token_group) then
            if (scanner%kind == token_group .and. scanner%token == '&') then
               call scanner%problem('found ''&'' alone, expected a key or ''/''')
               call scanner%skip_values()
               cycle
            end if
            call report_missing_end(scanner, line)
            exit
         else if (scanner%kind == token_broken) then
            call scanner%skip_to_group()
            exit
         else if (scanner%is_mark('/')) then
            scanner%place = ''
            call scanner%advance()
            exit
         else if (scanner%is_key()) then
            call scan_key(scanner, item)
         else
            if (scanner%kind == token_word .and. index(scanner%token, '(') > 0) then
               call scanner%problem('found '//shown(scanner%token)// &
                  ', array subscripts are not supported, expected key = values')
            else
               call scanner%problem('found '//shown(scanner%token)// &
                  ', expected key = value or ''/''')
            end if
            call scanner%skip_values()
         end if
      end do
      item%text = item%text//' /'//line_feed
      if (present(found)) found = item
   end subroutine scan_group

   !> A group ends without '/': at '&end', at the next group or at the end of the file.
   subroutine report_missing_end(scanner, line)
      type(scanner_t), intent(inout) :: scanner
      !> The line where the group began.
      integer, intent(in) :: line

      if (scanner%kind == token_end) then
         call scanner%problem('found the end of the file, expected ''/'' behind the last value', &
            line)
      else if (lower(scanner%token) == '&end') then
         call scanner%problem('found ''&end'', expected ''/''')
         call scanner%advance()
         if (scanner%is_mark('/')) call scanner%advance()
      else
         call scanner%problem('found '//shown(scanner%token)//' in line '// &
            integer_text(scanner%line)//', expected ''/'' before it', line)
      end if
   end subroutine report_missing_end

   !> Goes through `key = values`; the scanner stands on the key.
   subroutine scan_key(scanner, item)
      type(scanner_t), intent(inout) :: scanner
      !> The group; gets the values.
      type(block_t), intent(inout) :: item
      character(len=:), allocatable :: name
      integer :: k, before, i

      name = scanner%token
      scanner%place = '&'//trim(item%name)//' '//unquoted(shown(name))//': '
      before = scanner%n_problems
      k = find_key(item%keys, name)
      if (len(name) > name_length) then
         call scanner%problem('found a name of '//integer_text(len(name))// &
            ' characters, expected at most '//integer_text(name_length))
      else if (index(name, '(') > 0) then
         call scanner%problem('found a subscript, array subscripts are not supported, '// &
            'expected the values in order')
      else if (k == 0) then
         call scanner%problem('found an unknown key, expected '//list('', &
            [(item%keys(i)%name, i=1, size(item%keys))]))
      else if (item%lines(k) > 0) then
         call scanner%problem('found the key again, expected it once (first in line '// &
            integer_text(item%lines(k))//')')
      end if
      if (scanner%n_problems > before .or. scanner%quiet) then
         call scanner%skip_values()
         return
      end if
      item%lines(k) = scanner%line
      call scanner%advance()
      call scan_values(scanner, item, k)
   end subroutine scan_key

   !> Goes through the values of a key; the scanner stands on the '='.
   subroutine scan_values(scanner, item, k)
      type(scanner_t), intent(inout) :: scanner
      !> The group; gets the values.
      type(block_t), intent(inout) :: item
      !> The key's place in the group.
      integer, intent(in) :: k
      character(len=:), allocatable :: value, message
      integer :: n, line
      logical :: after_comma

      n = 0
      line = scanner%line
      after_comma = .false.
      call scanner%advance()
      do
         if (scanner%is_mark(',')) then
            if (after_comma .or. n == 0) exit
            after_comma = .true.
         else if (scanner%is_mark('/=') .or. (scanner%at_next() .and. scanner%token /= '&')) then
            exit
         else
            call check_value(scanner, item%keys(k)%kind, n, value, message)
            if (allocated(message)) then
               call scanner%problem(message)
               call scanner%skip_values()
               return
            end if
            if (n == 0) value = ' '//trim(item%keys(k)%name)//'='//value
            if (n > 0) value = ','//value
            if (n < item%keys(k)%max_count) item%text = item%text//value
            n = n + 1
            after_comma = .false.
         end if
         call scanner%advance()
      end do
      item%counts(k) = n
      if (scanner%is_mark(',=')) then
         call report_mark(scanner, item%keys(k), n)
      else if (scanner%kind /= token_broken) then
         call check_count(scanner, item%keys(k), n, line)
      end if
   end subroutine scan_values

   !> A ',' or '=' where a value should be.
   subroutine report_mark(scanner, key, n)
      type(scanner_t), intent(inout) :: scanner
      !> The key.
      type(key_t), intent(in) :: key
      !> How many values stand before the mark.
      integer, intent(in) :: n
      character(len=:), allocatable :: mark
      integer :: line

      mark = scanner%token
      line = scanner%line
      call scanner%advance()
      if (mark == '=') then
         call scanner%problem('found ''='' without a key before it, expected '// &
            noun(key%kind), line)
      else if (n == 0 .and. (scanner%is_key() .or. scanner%is_mark('/'))) then
         call check_count(scanner, key, n, line)
      else
         call scanner%problem('found an empty value before '','', expected '//noun(key%kind), line)
      end if
      if (.not. scanner%at_next()) call scanner%skip_values()
   end subroutine report_mark

   !> Compares the number of values with what the key takes.
   subroutine check_count(scanner, key, n, line)
      type(scanner_t), intent(inout) :: scanner
      !> The key.
      type(key_t), intent(in) :: key
      !> How many values were given.
      integer, intent(in) :: n
      !> The key's line.
      integer, intent(in) :: line
      character(len=:), allocatable :: hint

      hint = ''
      if (key%kind /= kind_string) hint = '; a decimal point is ''.'''
      if (n == 0) then
         call scanner%problem('found no value, expected '//noun(key%kind), line)
      else if (n > key%max_count) then
         if (key%max_count == 1) hint = '1'//hint
         if (key%max_count > 1) hint = 'at most '//integer_text(key%max_count)
         call scanner%problem('found '//integer_text(n)//' values, expected '//hint, line)
      end if
   end subroutine check_count

   !> Checks one value and writes it anew in the one form that the reader takes without fail.
   subroutine check_value(scanner, kind, n, value, message)
      type(scanner_t), intent(in) :: scanner
      !> What the key takes.
      integer, intent(in) :: kind
      !> How many values stand before this one.
      integer, intent(in) :: n
      !> The value's clean text.
      character(len=:), allocatable, intent(out) :: value
      !> Allocated when the value cannot be accepted: what was found and expected.
      character(len=:), allocatable, intent(out) :: message
      character(len=:), allocatable :: token
      character(len=40) :: buffer
      real(wp) :: x
      logical :: ok

      token = scanner%token
      if (scanner%kind == token_string .neqv. kind == kind_string) then
         message = word_message(token, kind, n, scanner%kind == token_string)
      else if (kind == kind_string) then
         value = "'"//doubled(token)//"'"
         if (len(token) > string_length) message = 'found a text of '// &
            integer_text(len(token))//' characters, expected at most '// &
            integer_text(string_length)
      else
         call parse_number(token, x, ok)
         if (.not. is_decimal(token)) then
            message = word_message(token, kind, n, .false.)
         else if (kind == kind_integer .and. scan(token, '.eEdD') > 0) then
            message = 'found '//shown(token)//', expected an integer'
         else if (kind == kind_integer .and. (.not. ok .or. abs(x) > huge(1))) then
            message = 'found '//shown(token)//', expected an integer between '// &
               integer_text(-huge(1))//' and '//integer_text(huge(1))
         else if (.not. ok) then
            message = 'found '//shown(token)//', expected a number of at most 1.79e308'
         else if (kind == kind_integer) then
            value = integer_text(nint(x))
         else
            write (buffer, '(es25.17e3)') x
            value = trim(adjustl(buffer))
         end if
      end if
   end subroutine check_value

   !> Why a value is of the wrong type.
   pure function word_message(token, kind, n, is_string) result(message)
      !> The value as written.
      character(len=*), intent(in) :: token
      !> What the key takes, and how many values stand before this one.
      integer, intent(in) :: kind, n
      !> Whether the value was in quotes.
      logical, intent(in) :: is_string
      character(len=:), allocatable :: message
      integer :: star

      star = index(token, '*')
      message = 'found '//shown(token)
      if (is_string) then
         message = 'found the text '//shown(token)//' in quotes, expected '//noun(kind)
      else if (star > 1 .and. verify(token(:max(star - 1, 1)), digits) == 0) then
         message = message//', expected the values written out, not a repeat count'
      else if (index(token, '(') > 1) then
         message = message//', array subscripts are not supported, expected '//noun(kind)
      else if (kind /= kind_string .and. n > 0 .and. verify(token(:1), letters) == 0) then
         message = message//' after a number, expected the next key or ''/'' '// &
            '(units are not written behind numbers)'
      else
         message = message//', expected '//noun(kind)
      end if
   end function word_message

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
      !> The whole text.
      character(len=*), intent(in) :: text
      !> Where the word begins.
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
         if (char_at(self, 0) /= quote) then
            self%kind = token_broken
            call self%problem('found '//shown(quote//self%token)// &
               ' without a closing quote, expected '//quote//' in the same line')
            return
         end if
         self%next = self%next + 1
         if (char_at(self, 0) /= quote) exit
         self%token = self%token//quote
      end do
      if (index(blanks//line_feed//',/!=', char_at(self, 0)) == 0) then
         self%kind = token_broken
         call self%problem('found '//shown(self%text(first:self%next))// &
            ', expected a blank or '','' behind the closing quote')
      end if
   end subroutine scan_string

   !> The character at a distance from the scanner's position; a line feed behind the text.
   pure character(len=1) function char_at(scanner, distance) result(letter)
      type(scanner_t), intent(in) :: scanner
      !> How far behind the position.
      integer, intent(in) :: distance

      letter = line_feed
      if (scanner%next + distance <= len(scanner%text)) &
         letter = scanner%text(scanner%next + distance:scanner%next + distance)
   end function char_at

   !> Passes blanks, line ends and comments.
   pure subroutine skip_blanks(text, next, line)
      !> The whole text.
      character(len=*), intent(in) :: text
      !> The position and its line, moved.
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
         if (length == 0) self%next = len(self%text) + 1
         if (length == 0) exit
         self%next = self%next + length
         self%next_line = self%next_line + 1
         length = verify(self%text(self%next:), blanks)
         if (length == 0) cycle
         if (char_at(self, length - 1) == '&') exit
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
      !> The marks.
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
      self%problems = self%problems//self%path//':'//integer_text(where_it_is)//': '// &
         self%place//message
   end subroutine problem

   !> Refuses what is not text, and a text that is empty or far too long.
   subroutine refuse_binary(scanner, text)
      type(scanner_t), intent(inout) :: scanner
      !> The file's text.
      character(len=*), intent(in) :: text
      integer :: i, j, more

      scanner%place = ''
      scanner%line = 1
      if (len(text, ip) > max_bytes) then
         call scanner%problem('found a file of more than '//integer_text(max_bytes)// &
            ' bytes, expected a case file')
         return
      end if
      more = 0
      do i = 1, len(text)
         j = iachar(text(i:i))
         if (more > 0 .neqv. (j >= 128 .and. j < 192)) exit
         more = max(more - 1, 0)
         if (j >= 192) more = 1
         if (j >= 224) more = 2
         if (j >= 240) more = 3
         if (j == 192 .or. j == 193 .or. j > 244 .or. j == 127) exit
         if (j < 32 .and. j /= 9 .and. j /= 10 .and. j /= 13) exit
         if (j == 13 .and. i < len(text) .and. index(text(i + 1:), line_feed) /= 1) exit
         if (j == 10) scanner%line = scanner%line + 1
      end do
      if (i <= len(text) .or. more > 0) call scanner%problem('found a character '// &
         'that is not text (a control character or not UTF-8), expected a text file')
   end subroutine refuse_binary

   !> Reports the groups that had to be there.
   subroutine require_groups(scanner, schema, seen)
      type(scanner_t), intent(inout) :: scanner
      !> The groups that are known.
      type(group_t), intent(in) :: schema(:)
      !> Line where each was seen, 0 for not at all.
      integer, intent(in) :: seen(:)
      integer :: g, i

      scanner%quiet = .false.
      scanner%place = ''
      if (scanner%passed_over) return
      if (all(seen == 0)) then
         call scanner%problem('found no group, expected '// &
            list('&', [(schema(i)%name, i=1, size(schema))]))
         return
      end if
      do g = 1, size(schema)
         if (schema(g)%required .and. seen(g) == 0) call scanner%problem('found no group &'// &
            trim(schema(g)%name)//', expected one')
      end do
   end subroutine require_groups

   !> The place of a key in a list, in any case of letters; 0 when it is not there.
   pure integer function find_key(keys, name) result(place)
      !> The list.
      type(key_t), intent(in) :: keys(:)
      !> The key's name.
      character(len=*), intent(in) :: name

      do place = size(keys), 1, -1
         if (lower(trim(keys(place)%name)) == lower(name)) exit
      end do
   end function find_key

   !> The place of a group in a list, in any case of letters; 0 when it is not there.
   pure integer function find_group(groups, name) result(place)
      !> The list.
      type(group_t), intent(in) :: groups(:)
      !> The group's name.
      character(len=*), intent(in) :: name

      do place = size(groups), 1, -1
         if (lower(trim(groups(place)%name)) == lower(name)) exit
      end do
   end function find_group

   !> Names joined by commas.
   pure function list(prefix, names) result(text)
      !> What stands before each name, and the names.
      character(len=*), intent(in) :: prefix, names(:)
      character(len=:), allocatable :: text
      integer :: i

      text = ''
      do i = 1, size(names)
         if (i > 1) text = text//', '
         text = text//prefix//trim(names(i))
      end do
   end function list

   !> A text without its first and last character.
   pure function unquoted(text) result(inner)
      !> The text.
      character(len=*), intent(in) :: text
      character(len=len(text) - 2) :: inner

      inner = text(2:len(text) - 1)
   end function unquoted

   !> What a key takes, in words.
   pure function noun(kind) result(text)
      !> The kind of the key.
      integer, intent(in) :: kind
      character(len=:), allocatable :: text

      select case (kind)
      case (kind_real)
         text = 'a number'
      case (kind_integer)
         text = 'an integer'
      case default
         text = 'text in quotes'
      end select
   end function noun

   !> A text with every apostrophe doubled.
   pure function doubled(text) result(copy)
      !> The text.
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: copy
      integer :: i

      copy = ''
      do i = 1, len(text)
         copy = copy//text(i:i)
         if (text(i:i) == "'") copy = copy//"'"
      end do
   end function doubled

   !> A text in small letters.
   pure function lower(text) result(copy)
      !> The text.
      character(len=*), intent(in) :: text
      character(len=len(text)) :: copy
      integer :: i

      copy = text
      do i = 1, len(text)
         if (text(i:i) >= 'A' .and. text(i:i) <= 'Z') copy(i:i) = achar(iachar(text(i:i)) + 32)
      end do
   end function lower

   !> The number of '&' in a text: it has no more groups than that.
   pure integer function count_of_mark(text) result(n)
      !> The text.
      character(len=*), intent(in) :: text
      integer :: i

      n = 0
      do i = 1, int(min(len(text, ip), int(max_bytes, ip)))
         if (text(i:i) == '&') n = n + 1
      end do
   end function count_of_mark

   !> An integer in digits.
   pure function integer_text(i) result(text)
      !> The integer.
      integer, intent(in) :: i
      character(len=:), allocatable :: text
      character(len=12) :: buffer

      write (buffer, '(i0)') i
      text = trim(buffer)
   end function integer_text

end module beamid_namelist
