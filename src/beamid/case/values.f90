!> The kind, range and default of a key of a case file, the reading of one value, and the words
!> that messages use for them. `beamid_entries` reads every value through `read_value`.
module beamid_values
   use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_value
   use beamid_kinds, only: wp
   use beamid_numbers, only: is_decimal, parse_number, shown
   use beamid_strings, only: lower, to_text
   use beamid_tokens, only: digits, letters, token_mark, token_string, token_t, token_word
   implicit none
   private

   public :: key_t, range_t, new_key, read_value, listed, one_of, number

   !> Kinds of values that a key takes.
   integer, parameter, public :: kind_real = 1, kind_integer = 2, kind_text = 3
   !> Longest name of a key, and longest text that a value may have [characters].
   integer, parameter, public :: name_length = 20, longest = 512
   !> The longest text among the choices of a key.
   integer, parameter :: longest_choice = 24

   !> An interval of numbers from `low` to `high`; by default all numbers.
   type :: range_t
      real(wp) :: low = -huge(1.0_wp), high = huge(1.0_wp)
      logical :: open = .false.            !< the interval excludes `low` itself
   contains
      procedure :: holds
      procedure :: limits
      procedure :: in_words
   end type range_t

   type(range_t), parameter, public :: positive = range_t(low=0, open=.true.), &
      not_negative = range_t(low=0)

   !> The definition of one key of a group.
   type :: key_t
      character(len=name_length) :: name = ''
      integer :: kind = kind_real          !< `kind_real`, `kind_integer` or `kind_text`
      integer :: most = 1                  !< largest number of values
      character(len=:), allocatable :: help       !< meaning of the key
      logical :: required = .false.        !< the group must give the key
      character(len=:), allocatable :: default    !< the default in words; '': none
      type(range_t) :: range               !< allowed numbers
      logical :: infinite = .false.        !< `inf` is allowed
      logical :: is_file = .false.         !< the value is the path of a file that the case reads
      !> Words in quotes that may be given instead of numbers; not allocated: none. (The length is
      !> fixed because gfortran 12 copies only part of an array of texts of deferred length if the
      !> array is a component of an array element.)
      character(len=name_length), allocatable :: words(:)
      !> The texts or integers that a key allows. Not allocated: any text, or a range of numbers.
      character(len=longest_choice), allocatable :: choices(:)
   contains
      procedure :: kind_in_words
      procedure :: noun
   end type key_t

contains

   !> Returns whether a number lies in the range; an upper end of `huge` also allows infinity.
   elemental logical function holds(self, x)
      class(range_t), intent(in) :: self
      real(wp), intent(in) :: x

      holds = (x > self%low .or. x >= self%low .and. .not. self%open) .and. &
         (x <= self%high .or. self%high >= huge(x))
   end function holds

   !> Returns the range in words for a message; '' if every number is allowed.
   pure function in_words(self) result(text)
      class(range_t), intent(in) :: self
      character(len=:), allocatable :: text

      text = self%limits()
      if (self%open) text = 'a value '//text
   end function in_words

   !> Returns the range in words for the help; '' if every number is allowed.
   pure function limits(self) result(text)
      class(range_t), intent(in) :: self
      character(len=:), allocatable :: text

      text = ''
      if (self%open) then
         text = 'above '//number(self%low)
         if (self%high < huge(1.0_wp)) text = text//', up to '//number(self%high)
      else if (self%high < huge(1.0_wp)) then
         text = number(self%low)//' to '//number(self%high)
      else if (self%low > -huge(1.0_wp)) then
         text = number(self%low)//' or more'
      end if
   end function limits

   !> Returns names joined by a separator.
   pure function listed(names, between) result(text)
      character(len=*), intent(in) :: names(:), between
      character(len=:), allocatable :: text
      integer :: k

      text = trim(names(1))
      do k = 2, size(names)
         text = text//between//trim(names(k))
      end do
   end function listed

   !> Returns `a, b or c` with each word between two marks.
   !>
   !> words  two words or more
   !> mark   quotation mark
   pure function one_of(words, mark) result(text)
      character(len=*), intent(in) :: words(:), mark
      character(len=:), allocatable :: text
      integer :: n

      n = size(words)
      text = mark//listed(words(:n - 1), mark//', '//mark)//mark//' or '//mark//trim(words(n))//mark
   end function one_of

   !> Returns a number as text for a message; integers have all their digits.
   pure function number(x) result(text)
      real(wp), intent(in) :: x
      character(len=:), allocatable :: text

      text = to_text(x)
      if (abs(x) > huge(1)) return
      if (abs(x - anint(x)) <= 0) text = to_text(nint(x))
   end function number

   !> Returns the definition of a key; arguments are the components of `key_t`. A required key has
   !> no default.
   pure function new_key(name, kind, default, help, most, range, required, infinite, words) &
      result(key)
      character(len=*), intent(in) :: name, default, help
      integer, intent(in) :: kind, most
      type(range_t), intent(in), optional :: range
      logical, intent(in), optional :: required, infinite
      character(len=*), intent(in), optional :: words(:)
      type(key_t) :: key

      key%name = name
      key%kind = kind
      key%most = most
      key%help = help
      if (present(range)) key%range = range
      if (present(required)) key%required = required
      if (present(infinite)) key%infinite = infinite
      if (present(words)) key%words = words
      key%default = default
      if (key%required) key%default = ''
   end function new_key

   !> Returns the kind of the values of a key for the help: number, integer or text, or several of
   !> them.
   pure function kind_in_words(self) result(text)
      class(key_t), intent(in) :: self
      character(len=:), allocatable :: text

      text = 'number'
      if (self%kind == kind_integer) text = 'integer'
      if (self%kind == kind_text) text = 'text'
      if (self%most > 1) text = text//'s'
   end function kind_in_words

   !> Returns the kind of value that a key takes in words, for a message.
   pure function noun(self) result(text)
      class(key_t), intent(in) :: self
      character(len=:), allocatable :: text
      character(len=*), parameter :: nouns(kind_real:kind_text) = &
         [character(len=14) :: 'a number', 'an integer', 'text in quotes']
      integer :: k

      text = trim(nouns(self%kind))
      if (self%infinite) text = text//' or inf'
      if (.not. allocated(self%words)) return
      do k = 1, size(self%words)
         text = text//' or '''//trim(self%words(k))//''''
      end do
   end function noun

   !> Reads one value of a key; the range is checked by the caller.
   subroutine read_value(token, key, behind, x, message)
      type(token_t), intent(in) :: token
      type(key_t), intent(in) :: key
      !> Whether another value precedes this one.
      logical, intent(in) :: behind
      !> The number; 0 for text.
      real(wp), intent(out) :: x
      !> Allocated if the value is refused: `found ..., expected ...`.
      character(len=:), allocatable, intent(out) :: message
      logical :: ok, is_integer

      is_integer = key%kind == kind_integer
      call parse_number(token%text, x, ok)
      if (token%kind == token_mark .and. token%text == ',') then
         message = 'found an empty value before '','', expected '//key%noun()
      else if (token%kind == token_mark) then
         message = 'found ''='' without a key before it, expected '//key%noun()
      else if (token%kind == token_string .and. key%kind == kind_text) then
         x = 0
         if (len(token%text) > longest) message = 'found a text of '// &
            to_text(len(token%text))//' characters, expected at most '//to_text(longest)
      else if (key%infinite .and. token%kind == token_word .and. lower(token%text) == 'inf') then
         x = ieee_value(x, ieee_positive_inf)
      else if (token%kind == token_string .or. key%kind == kind_text .or. &
         .not. is_decimal(token%text)) then
         message = wrong_kind(token, key, behind)
      else if (is_integer .and. scan(token%text, '.eEdD') > 0) then
         message = 'found '//shown(token%text)//', expected an integer'
      else if (is_integer .and. (.not. ok .or. abs(x) > huge(1))) then
         message = 'found '//shown(token%text)//', expected an integer between '// &
            to_text(-huge(1))//' and '//to_text(huge(1))
      else if (.not. ok) then
         message = 'found '//shown(token%text)//', expected a number of at most 1.79e308'
      end if
   end subroutine read_value

   !> Returns the message for a value of the wrong kind; arguments as `read_value`.
   pure function wrong_kind(token, key, behind) result(message)
      type(token_t), intent(in) :: token
      type(key_t), intent(in) :: key
      logical, intent(in) :: behind
      character(len=:), allocatable :: message
      integer :: star

      star = index(token%text, '*')
      message = 'found '//shown(token%text)
      if (token%kind == token_string) then
         message = 'found the text '//shown(token%text)//' in quotes, expected '//key%noun()
      else if (star > 1 .and. verify(token%text(:star - 1), digits) == 0) then
         message = message//', expected the values written out, not a repeat count'
      else if (index(token%text, '(') > 1) then
         message = message//', array subscripts are not supported, expected '//key%noun()
      else if (key%kind /= kind_text .and. behind .and. verify(token%text(:1), letters) == 0) then
         message = message//' after a number, expected the next key or ''/'' '// &
            '(units are not written behind numbers)'
      else
         message = message//', expected '//key%noun()
      end if
   end function wrong_kind

end module beamid_values
