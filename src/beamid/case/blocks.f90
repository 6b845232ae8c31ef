!> A group of a case file as its reader sees it. The reader calls `get` once for each key; the call
!> states the key's name, default, meaning and range. `close` then refuses all other keys:
!>
!>     call block%get('panels', mesh%panels, 'in each element', range_t(1, 1000))
!>     call block%get('x_S', x_S, 'the tip', 'place of the sensor', positive)
!>     call block%close()
!>     if (block%failed()) return
!>
!> A reader gets the path of a file by `get_file` alone, which also resolves it.
!>
!> The variable holds the default before the call. If the key is not given, or its value is
!> refused, the variable is unchanged. If no single value can serve as the default, the variable is
!> allocatable and unallocated, and the argument `default` describes the default in words.
!>
!> A reader asks for all its keys before it looks at any value, so that `keys` is complete even if
!> the group is empty; the help is made in this way.
module beamid_blocks
   use beamid_entries, only: entries_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_paths, only: join_path
   use beamid_strings, only: append_string, string_t, to_text
   use beamid_values, only: key_t, kind_integer, kind_real, kind_text, new_key, number, one_of, &
      range_t
   implicit none
   private

   public :: block_t

   !> One group of a case file, with the folder of the file and typed access to the keys.
   type, extends(entries_t) :: block_t
      character(len=:), allocatable :: folder    !< folder of the case file; base of relative paths
      type(string_t), allocatable :: files(:)    !< files that this and earlier groups name
   contains
      generic :: get => get_real, get_real_or_none, get_reals, get_integer, get_integers, &
         get_text, get_texts
      procedure :: get_file
      procedure, private :: get_real, get_real_or_none, get_reals, get_integer, get_integers, &
         get_text, get_texts
   end type block_t

contains

   !> Gets one real number whose default is a number.
   !>
   !> name      key
   !> value     default on entry; the value of the key on return
   !> help      meaning of the key, for the help
   !> range     allowed values; absent: all
   subroutine get_real(self, name, value, help, range, required)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      real(wp), intent(inout) :: value
      character(len=*), intent(in) :: help
      type(range_t), intent(in), optional :: range
      !> Whether the key must be given; default .false.
      logical, intent(in), optional :: required
      real(wp), allocatable :: x(:)

      call self%take(new_key(name, kind_real, number(value), help, 1, range, required), x)
      if (size(x) > 0) value = x(1)
   end subroutine get_real

   !> Gets one real number that may remain unallocated; `default` describes its default in words.
   !>
   !> infinite  whether the word `inf` is allowed; default .false.
   subroutine get_real_or_none(self, name, value, default, help, range, required, infinite)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: value
      character(len=*), intent(in) :: default, help
      type(range_t), intent(in), optional :: range
      logical, intent(in), optional :: required, infinite
      real(wp), allocatable :: x(:)

      call self%take(new_key(name, kind_real, default, help, 1, range, required, infinite), x)
      if (size(x) > 0) value = x(1)
   end subroutine get_real_or_none

   !> Gets a list of real numbers, or one of several words instead of them.
   !>
   !> values  values of the key; unchanged if it is not given
   !> most    largest number of values
   !> words   words that may be given instead of numbers
   subroutine get_reals(self, name, values, default, help, most, words, word, range)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:)
      character(len=*), intent(in) :: default, help
      integer, intent(in) :: most
      character(len=*), intent(in), optional :: words(:)
      !> The word that was given; '' if none was. Required with `words`.
      character(len=*), intent(out), optional :: word
      type(range_t), intent(in), optional :: range
      real(wp), allocatable :: x(:)

      call self%take(new_key(name, kind_real, default, help, most, range, words=words), x, &
         word=word)
      if (size(x) > 0) values = x
   end subroutine get_reals

   !> Gets one integer; `default` replaces the default's number in the help by words.
   subroutine get_integer(self, name, value, help, range, default, choices)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      integer, intent(inout) :: value
      character(len=*), intent(in) :: help
      type(range_t), intent(in), optional :: range
      character(len=*), intent(in), optional :: default
      !> The values that are allowed, for the help; the caller checks them.
      character(len=*), intent(in), optional :: choices(:)
      type(key_t) :: key
      real(wp), allocatable :: x(:)

      key = new_key(name, kind_integer, to_text(value), help, 1, range)
      if (present(default)) key%default = default
      if (present(choices)) key%choices = choices
      call self%take(key, x)
      if (size(x) > 0) value = nint(x(1))
   end subroutine get_integer

   !> Gets a list of integers, or one of several words instead of them; arguments as `get_reals`.
   subroutine get_integers(self, name, values, default, help, most, range, words, word)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      integer, allocatable, intent(inout) :: values(:)
      character(len=*), intent(in) :: default, help
      integer, intent(in) :: most
      type(range_t), intent(in), optional :: range
      character(len=*), intent(in), optional :: words(:)
      character(len=*), intent(out), optional :: word
      real(wp), allocatable :: x(:)

      call self%take(new_key(name, kind_integer, default, help, most, range, words=words), x, &
         word=word)
      if (size(x) > 0) values = nint(x)
   end subroutine get_integers

   !> Gets one text without its trailing blanks.
   !>
   !> words    the allowed texts; absent: all texts are allowed
   !> default  description of the default in words, instead of the value on entry
   subroutine get_text(self, name, value, help, words, required, default)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      !> Default on entry; not allocated: there is none, or `default` describes it.
      character(len=:), allocatable, intent(inout) :: value
      character(len=*), intent(in) :: help
      character(len=*), intent(in), optional :: words(:), default
      logical, intent(in), optional :: required
      type(key_t) :: key
      character(len=:), allocatable :: texts(:)

      key = new_key(name, kind_text, '', help, 1, required=required)
      if (allocated(value)) key%default = ''''//value//''''
      if (present(default)) key%default = default
      if (present(words)) key%choices = words
      call self%take(key, texts=texts)
      if (size(texts) == 0) return
      if (present(words)) then
         if (.not. any(words == texts(1))) call self%refuse(name, shown(texts(1)), &
            one_of(words, ''''))
         if (.not. any(words == texts(1))) return
      end if
      value = trim(texts(1))
   end subroutine get_text

   !> Gets the path of a file that the case reads, and appends it to `files`. Every file that a case
   !> names must pass through this procedure, because the fingerprint of a case covers the files in
   !> this list.
   !>
   !> input  whether '-' stands for standard input; default .false.
   subroutine get_file(self, name, path, help, default, input)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      !> Path relative to the current folder, as `open` takes it; not allocated: not given.
      character(len=:), allocatable, intent(out) :: path
      character(len=*), intent(in) :: help, default
      logical, intent(in), optional :: input
      type(key_t) :: key
      character(len=:), allocatable :: texts(:)

      key = new_key(name, kind_text, default, help, 1)
      key%is_file = .true.
      call self%take(key, texts=texts)
      if (size(texts) == 0) return
      if (texts(1) == '') then
         call self%refuse(name, '''''', 'the path of a file')
         return
      end if
      if (present(input)) then
         if (input .and. texts(1) == '-') then
            path = '-'
            return
         end if
      end if
      path = join_path(self%folder, trim(texts(1)))
      call append_string(self%files, path)
   end subroutine get_file

   !> Gets a list of texts; at most `most` of them.
   subroutine get_texts(self, name, values, default, help, most, required)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      character(len=:), allocatable, intent(inout) :: values(:)
      character(len=*), intent(in) :: default, help
      integer, intent(in) :: most
      logical, intent(in), optional :: required
      character(len=:), allocatable :: texts(:)

      call self%take(new_key(name, kind_text, default, help, most, required=required), texts=texts)
      if (size(texts) > 0) call move_alloc(texts, values)
   end subroutine get_texts

end module beamid_blocks
