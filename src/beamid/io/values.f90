!> The values of a key in a case file: their number, their type, and what is wrong with them.
module beamid_values
   use beamid_kinds, only: wp
   use beamid_numbers, only: is_decimal, parse_number, shown
   use beamid_keys, only: block_t, key_t, kind_integer, kind_string, noun, place_of
   use beamid_strings, only: to_text
   use beamid_tokens, only: digits, letters, scanner_t, token_broken, token_string
   implicit none
   private

   public :: scan_values, string_length

   !> The longest string value: declare `character(len=string_length)` and nothing is cut.
   integer, parameter :: string_length = 512

contains

   !> Goes through the values of a key; the scanner stands on the '='.
   subroutine scan_values(scanner, found, place)
      type(scanner_t), intent(inout) :: scanner
      !> The group, which gets the values, and the key's place in it.
      type(block_t), intent(inout) :: found
      integer, intent(in) :: place
      character(len=:), allocatable :: value, message
      integer :: k, n, line
      logical :: after_comma

      n = 0
      k = place
      line = scanner%line
      after_comma = .false.
      call scanner%advance()
      if (found%keys(k)%text_key /= '' .and. scanner%kind == token_string) then
         k = place_of(found%keys(place)%text_key, found%keys)
         found%lines(k) = line
         found%lines(place) = 0
      end if
      do
         if (scanner%is_mark(',')) then
            if (after_comma .or. n == 0) exit
            after_comma = .true.
         else if (scanner%is_mark('/=') .or. (scanner%at_next() .and. scanner%token /= '&')) then
            exit
         else
            call check_value(scanner%token, scanner%kind == token_string, found%keys(k)%kind, n, &
               value, message)
            if (allocated(message)) then
               call scanner%problem(message)
               call scanner%skip_values()
               return
            end if
            if (n == 0) value = ' '//trim(found%keys(k)%name)//'='//value
            if (n > 0) value = ','//value
            if (n < found%keys(k)%max_count) found%text = found%text//value
            n = n + 1
            after_comma = .false.
         end if
         call scanner%advance()
      end do
      found%counts(k) = n
      if (scanner%is_mark(',=')) then
         call report_mark(scanner, found%keys(k), n)
      else if (scanner%kind /= token_broken) then
         call check_count(scanner, found%keys(k), n, line)
      end if
   end subroutine scan_values

   !> A ',' or '=' where a value should be.
   subroutine report_mark(scanner, key, n)
      type(scanner_t), intent(inout) :: scanner
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
      type(key_t), intent(in) :: key
      integer, intent(in) :: n, line
      character(len=:), allocatable :: hint

      hint = ''
      if (key%kind /= kind_string) hint = '; a decimal point is ''.'''
      if (n == 0) then
         call scanner%problem('found no value, expected '//noun(key%kind), line)
      else if (n > key%max_count) then
         if (key%max_count == 1) hint = '1'//hint
         if (key%max_count > 1) hint = 'at most '//to_text(key%max_count)
         call scanner%problem('found '//to_text(n)//' values, expected '//hint, line)
      end if
   end subroutine check_count

   !> Checks one value and writes it anew in the one form that the reader takes without fail.
   subroutine check_value(token, is_string, kind, n, value, message)
      !> The value as written, without quotes.
      character(len=*), intent(in) :: token
      !> Whether it was in quotes.
      logical, intent(in) :: is_string
      !> What the key takes, and how many values stand before this one.
      integer, intent(in) :: kind, n
      !> The value's clean text.
      character(len=:), allocatable, intent(out) :: value
      !> Allocated when the value cannot be accepted: what was found and expected.
      character(len=:), allocatable, intent(out) :: message

      if (is_string .neqv. kind == kind_string) then
         message = misfit(token, is_string, kind, n)
      else if (.not. is_string) then
         call check_number(token, kind, n, value, message)
      else if (len(token) > string_length) then
         message = 'found a text of '//to_text(len(token))//' characters, expected at most '// &
            to_text(string_length)
      else
         value = "'"//doubled(token)//"'"
      end if
   end subroutine check_value

   !> The same for a number.
   subroutine check_number(token, kind, n, value, message)
      character(len=*), intent(in) :: token
      integer, intent(in) :: kind, n
      character(len=:), allocatable, intent(out) :: value, message
      character(len=40) :: buffer
      real(wp) :: x
      logical :: ok

      call parse_number(token, x, ok)
      if (.not. is_decimal(token)) then
         message = misfit(token, .false., kind, n)
      else if (kind == kind_integer .and. scan(token, '.eEdD') > 0) then
         message = 'found '//shown(token)//', expected an integer'
      else if (kind == kind_integer .and. (.not. ok .or. abs(x) > huge(1))) then
         message = 'found '//shown(token)//', expected an integer between '// &
            to_text(-huge(1))//' and '//to_text(huge(1))
      else if (.not. ok) then
         message = 'found '//shown(token)//', expected a number of at most 1.79e308'
      else if (kind == kind_integer) then
         value = to_text(nint(x))
      else
         write (buffer, '(es25.17e3)') x
         value = trim(adjustl(buffer))
      end if
   end subroutine check_number

   !> Why a value is of the wrong type.
   pure function misfit(token, is_string, kind, n) result(message)
      character(len=*), intent(in) :: token
      logical, intent(in) :: is_string
      integer, intent(in) :: kind, n
      character(len=:), allocatable :: message
      integer :: star

      star = index(token, '*')
      message = 'found '//shown(token)
      if (is_string) then
         message = 'found the text '//shown(token)//' in quotes, expected '//noun(kind)
      else if (star > 1 .and. verify(token(:star - 1), digits) == 0) then
         message = message//', expected the values written out, not a repeat count'
      else if (index(token, '(') > 1) then
         message = message//', array subscripts are not supported, expected '//noun(kind)
      else if (kind /= kind_string .and. n > 0 .and. verify(token(:1), letters) == 0) then
         message = message//' after a number, expected the next key or ''/'' '// &
            '(units are not written behind numbers)'
      else
         message = message//', expected '//noun(kind)
      end if
   end function misfit

   !> A text with every apostrophe doubled.
   pure function doubled(text) result(copy)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: copy
      integer :: i

      copy = ''
      do i = 1, len(text)
         copy = copy//text(i:i)
         if (text(i:i) == "'") copy = copy//"'"
      end do
   end function doubled

end module beamid_values
