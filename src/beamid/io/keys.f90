!> What a case file may hold, groups of keys, and what was found in one.
module beamid_keys
   use beamid_strings, only: lower
   implicit none
   private

   public :: key_t, group_t, block_t, real_key, integer_key, string_key, group
   public :: place_of, noun

   !> What the values of a key are.
   integer, parameter, public :: kind_real = 1, kind_integer = 2, kind_string = 3
   !> The longest name of a group or a key.
   integer, parameter, public :: name_length = 63

   !> One key of a group.
   type :: key_t
      character(len=name_length) :: name = ''
      integer :: kind = kind_real
      !> How many values it takes at most; 1 for a scalar.
      integer :: max_count = 1
      !> Where a value in quotes goes instead: another key of the group, of texts.
      character(len=name_length) :: text_key = ''
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
      !> The group's keys, the line of each (0: not given) and its number of values.
      type(key_t), allocatable :: keys(:)
      integer, allocatable :: lines(:), counts(:)
   contains
      procedure :: has
      procedure :: count_of
      procedure :: line_of
   end type block_t

   !> The place of a name, in any case, in a list of keys or groups; 0 when it is not there.
   interface place_of
      module procedure :: place_of_key
      module procedure :: place_of_group
   end interface place_of

contains

   !> A key whose values are real numbers, one or up to `max_count`.
   pure type(key_t) function real_key(name, max_count, text_key) result(key)
      character(len=*), intent(in) :: name
      integer, intent(in), optional :: max_count
      character(len=*), intent(in), optional :: text_key

      key%name = name
      if (present(text_key)) key%text_key = text_key
      if (present(max_count)) key%max_count = max_count
   end function real_key

   !> A key whose values are integers.
   pure type(key_t) function integer_key(name, max_count) result(key)
      character(len=*), intent(in) :: name
      integer, intent(in), optional :: max_count

      key = real_key(name, max_count)
      key%kind = kind_integer
   end function integer_key

   !> A key whose values are texts in quotes.
   pure type(key_t) function string_key(name, max_count) result(key)
      character(len=*), intent(in) :: name
      integer, intent(in), optional :: max_count

      key = real_key(name, max_count)
      key%kind = kind_string
   end function string_key

   !> A group of keys, without '&' in its name.
   pure type(group_t) function group(name, keys, may_repeat, required) result(table)
      character(len=*), intent(in) :: name
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
      character(len=*), intent(in) :: key

      has = self%count_of(key) > 0
   end function has

   !> How many values a key was given; 0 when it is absent.
   pure integer function count_of(self, key) result(n)
      class(block_t), intent(in) :: self
      character(len=*), intent(in) :: key
      integer :: k

      n = 0
      k = place_of(key, self%keys)
      if (k > 0) n = self%counts(k)
   end function count_of

   !> The line on which a key stands; the group's line when it is absent.
   pure integer function line_of(self, key) result(line)
      class(block_t), intent(in) :: self
      character(len=*), intent(in) :: key
      integer :: k

      line = self%line
      k = place_of(key, self%keys)
      if (k == 0) return
      if (self%lines(k) > 0) line = self%lines(k)
   end function line_of

   pure integer function place_of_key(name, keys) result(place)
      character(len=*), intent(in) :: name
      type(key_t), intent(in) :: keys(:)

      do place = size(keys), 1, -1
         if (lower(keys(place)%name) == lower(name)) exit
      end do
   end function place_of_key

   pure integer function place_of_group(name, groups) result(place)
      character(len=*), intent(in) :: name
      type(group_t), intent(in) :: groups(:)

      do place = size(groups), 1, -1
         if (lower(groups(place)%name) == lower(name)) exit
      end do
   end function place_of_group

   !> What a key takes, in words.
   pure function noun(kind) result(text)
      integer, intent(in) :: kind
      character(len=:), allocatable :: text
      character(len=*), parameter :: nouns(kind_real:kind_string) = &
         [character(len=14) :: 'a number', 'an integer', 'text in quotes']

      text = trim(nouns(kind))
   end function noun

end module beamid_keys
