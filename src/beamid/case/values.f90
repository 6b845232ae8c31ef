!> What the keys of a case file take, and the reading of one value.
module beamid_values
   use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_value
   use beamid_kinds, only: wp
   use beamid_numbers, only: is_decimal, parse_number, shown
   use beamid_strings, only: lower, to_text
   use beamid_tokens, only: digits, letters, token_mark, token_string, token_t, token_word
   implicit none
   private

   public :: key_t, range_t, new_key, read_value, listed, one_of, number

   !> What the values of a key are.
   integer, parameter, public :: kind_real = 1, kind_integer = 2, kind_text = 3
   !> The longest name, and the longest text among the values.
   integer, parameter, public :: name_length = 20, longest = 512
   !> The longest text among the choices of a key.
   integer, parameter :: longest_choice = 24

   !> Numbers from `low` to `high`.
   type :: range_t
      real(wp) :: low = -huge(1.0_wp), high = huge(1.0_wp)
      logical :: open = .false.            !< `low` itself does not belong to it
   contains
      procedure :: holds
      procedure :: in_words
   end type range_t

   type(range_t), parameter, public :: positive = range_t(low=0, open=.true.), &
      not_negative = range_t(low=0)

   !> One key of a group.
   type :: key_t
      character(len=name_length) :: name = ''
      integer :: kind = kind_real
      integer :: most = 1                  !< values that it takes
      character(len=:), allocatable :: help
      logical :: required = .false.
      character(len=:), allocatable :: default    !< what holds without it
      type(range_t) :: range
      logical :: infinite = .false.        !< `inf` is a value
      logical :: is_file = .false.         !< the value is the path of a file that the case reads
      !> Words that may stand for the numbers, in quotes. (gfortran 12 copies but a part of an array
      !> of texts whose length is deferred, where it belongs to an element of an array.)
      character(len=name_length), allocatable :: words(:)
      !> The texts or integers that a key allows. Not allocated: any text, or a range of numbers.
      character(len=longest_choice), allocatable :: choices(:)
   contains
      procedure :: noun
   end type key_t

contains

   elemental logical function holds(self, x)
      class(range_t), intent(in) :: self
      real(wp), intent(in) :: x

      holds = (x > self%low .or. x >= self%low .and. .not. self%open) .and. &
         (x <= self%high .or. self%high >= huge(x))
   end function holds

   !> The range in words; '' where it holds every number.
   pure function in_words(self) result(text)
      class(range_t), intent(in) :: self
      character(len=:), allocatable :: text

      text = ''
      if (self%open) then
         text = 'a value above '//number(self%low)
         if (self%high < huge(1.0_wp)) text = text//', up to '//number(self%high)
      else if (self%high < huge(1.0_wp)) then
         text = number(self%low)//' to '//number(self%high)
      else if (self%low > -huge(1.0_wp)) then
         text = number(self%low)//' or more'
      end if
   end function in_words

   !> Names with something between them.
   pure function listed(names, between) result(text)
      character(len=*), intent(in) :: names(:), between
      character(len=:), allocatable :: text
      integer :: k

      text = trim(names(1))
      do k = 2, size(names)
         text = text//between//trim(names(k))
      end do
   end function listed

   !> `a, b or c`, each between two marks; two words or more.
   pure function one_of(words, mark) result(text)
      character(len=*), intent(in) :: words(:), mark
      character(len=:), allocatable :: text
      integer :: n

      n = size(words)
      text = mark//listed(words(:n - 1), mark//', '//mark)//mark//' or '//mark//trim(words(n))//mark
   end function one_of

   !> A number for a message: whole ones with all their digits.
   pure function number(x) result(text)
      real(wp), intent(in) :: x
      character(len=:), allocatable :: text

      text = to_text(x)
      if (abs(x) > huge(1)) return
      if (abs(x - anint(x)) <= 0) text = to_text(nint(x))
   end function number

   pure function new_key(name, kind, default, help, most, range, required, infinite) result(key)
      character(len=*), intent(in) :: name, default, help
      integer, intent(in) :: kind, most
      type(range_t), intent(in), optional :: range
      logical, intent(in), optional :: required, infinite
      type(key_t) :: key

      key%name = name
      key%kind = kind
      key%most = most
      key%help = help
      if (present(range)) key%range = range
      if (present(required)) key%required = required
      if (present(infinite)) key%infinite = infinite
      key%default = default
      if (key%required) key%default = ''
   end function new_key

   !> What a key takes, in words.
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

   !> Reads one value.
   subroutine read_value(token, key, behind, x, message)
      type(token_t), intent(in) :: token
      type(key_t), intent(in) :: key
      !> Whether another value stands before this one.
      logical, intent(in) :: behind
      !> The number; 0 for a text.
      real(wp), intent(out) :: x
      !> Allocated when the value cannot be accepted: what was found and expected.
      character(len=:), allocatable, intent(out) :: message
      logical :: ok, whole

      whole = key%kind == kind_integer
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
         message = misfit(token, key, behind)
      else if (whole .and. scan(token%text, '.eEdD') > 0) then
         message = 'found '//shown(token%text)//', expected an integer'
      else if (whole .and. (.not. ok .or. abs(x) > huge(1))) then
         message = 'found '//shown(token%text)//', expected an integer between '// &
            to_text(-huge(1))//' and '//to_text(huge(1))
      else if (.not. ok) then
         message = 'found '//shown(token%text)//', expected a number of at most 1.79e308'
      end if
   end subroutine read_value

   !> Why a value is of the wrong kind.
   pure function misfit(token, key, behind) result(message)
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
   end function misfit

end module beamid_values
