!> A group of a case file as its reader sees it. One `get` for each key says what the key is called,
!> what it takes, what holds without it and what it means; `close` refuses what nobody asked for:
!>
!>     call block%get('panels', mesh%panels, 'in each element', range_t(1, 1000))
!>     call block%get('x_S', x_S, 'the tip', 'place of the sensor', positive)
!>     call block%close()
!>     if (block%failed()) return
!>
!> A reader gets the path of a file by `get_file` alone, which also resolves it.
!>
!> A value that is not given, or refused, keeps what it had: the default. Where no value can stand
!> for the default it is given in words, and the value is allocatable. A reader asks for all its
!> keys before it looks at any, so that `keys` lists them also where none is given.
module beamid_blocks
   use beamid_entries, only: entries_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_paths, only: append_path, join_path, path_t
   use beamid_strings, only: to_text
   use beamid_values, only: key_t, kind_integer, kind_real, kind_text, new_key, number, one_of, &
      range_t
   implicit none
   private

   public :: block_t

   type, extends(entries_t) :: block_t
      character(len=:), allocatable :: folder    !< of the case file; paths are relative to it
      type(path_t), allocatable :: files(:)      !< that the group names; not allocated: none
   contains
      generic :: get => get_real, get_real_or_none, get_reals, get_integer, get_integers, &
         get_text, get_texts
      procedure :: get_file
      procedure, private :: get_real, get_real_or_none, get_reals, get_integer, get_integers, &
         get_text, get_texts
   end type block_t

contains

   !> One real number.
   subroutine get_real(self, name, value, help, range, required, infinite)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      real(wp), intent(inout) :: value
      character(len=*), intent(in) :: help
      type(range_t), intent(in), optional :: range
      !> `required`: it must be given; `infinite`: `inf` is a value; default no.
      logical, intent(in), optional :: required, infinite
      real(wp), allocatable :: x(:)

      call self%take(new_key(name, kind_real, number(value), help, 1, range, required, infinite), x)
      if (size(x) > 0) value = x(1)
   end subroutine get_real

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

   !> Several real numbers, or one of some words in their place.
   subroutine get_reals(self, name, values, default, help, most, words, word, range)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      real(wp), allocatable, intent(inout) :: values(:)
      character(len=*), intent(in) :: default, help
      integer, intent(in) :: most
      character(len=*), intent(in), optional :: words(:)
      !> The one that was given; ''.
      character(len=*), intent(out), optional :: word
      type(range_t), intent(in), optional :: range
      type(key_t) :: key
      real(wp), allocatable :: x(:)

      key = new_key(name, kind_real, default, help, most, range)
      if (present(words)) key%words = words
      call self%take(key, x, word=word)
      if (size(x) > 0) values = x
   end subroutine get_reals

   !> One integer; `default` says in words what is not its value.
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

   !> Several integers, or one of some words in their place, as above.
   subroutine get_integers(self, name, values, default, help, most, range, words, word)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      integer, allocatable, intent(inout) :: values(:)
      character(len=*), intent(in) :: default, help
      integer, intent(in) :: most
      type(range_t), intent(in), optional :: range
      character(len=*), intent(in), optional :: words(:)
      character(len=*), intent(out), optional :: word
      type(key_t) :: key
      real(wp), allocatable :: x(:)

      key = new_key(name, kind_integer, default, help, most, range)
      if (present(words)) key%words = words
      call self%take(key, x, word=word)
      if (size(x) > 0) values = nint(x)
   end subroutine get_integers

   !> One text, of some words where they are given; blanks at its end do not count.
   subroutine get_text(self, name, value, help, words, required, default)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      !> Not allocated: there is no default, or it is given in words.
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

   !> Gets the path of a file that the case reads, and adds it to `files`. Every file that a case
   !> names passes through here: the fingerprint of a case covers the files in this list.
   subroutine get_file(self, name, path, help, default)
      class(block_t), intent(inout) :: self
      character(len=*), intent(in) :: name
      !> On return relative to the current folder, as `open` takes it; not allocated: not given
      character(len=:), allocatable, intent(out) :: path
      character(len=*), intent(in) :: help, default
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
      path = join_path(self%folder, trim(texts(1)))
      call append_path(self%files, path)
   end subroutine get_file

   !> Several texts.
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
