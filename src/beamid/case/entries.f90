!> The keys and values of one group of a case file as written, the keys that the group's reader has
!> asked for, and the problems found in either. `beamid_blocks` adds a typed `get` for each key.
module beamid_entries
   use beamid_kinds, only: wp
   use beamid_numbers, only: shortened
   use beamid_refusals, only: refusals_t
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: lower, to_text
   use beamid_tokens, only: token_broken, token_key, token_mark, token_string, token_t, token_word
   use beamid_values, only: key_t, kind_text, listed, longest, number, read_value
   implicit none
   private

   public :: entries_t

   !> One group of a case file. `beamid_namelist` fills the tokens; a reader takes the values.
   type :: entries_t
      character(len=:), allocatable :: name     !< name of the group, without '&'
      integer :: line = 1                       !< line of the case file with the group's '&'
      type(refusals_t) :: refusals              !< problems found in the group
      type(key_t), allocatable :: keys(:)       !< keys that the reader has asked for so far
      !> (n_tokens) the group's tokens in the order of the file: each key, then its values
      type(token_t), allocatable, private :: tokens(:)
      integer, private :: n_tokens = 0
   contains
      procedure :: append
      procedure :: take
      procedure :: close
      procedure :: failed
      procedure :: has
      procedure :: line_of
      procedure :: require
      procedure :: exclude
      procedure :: exclude_other_kinds
      procedure :: refuse
      procedure :: complain
      procedure, private :: find_values
      procedure, private :: key_position
   end type entries_t

contains

   !> Appends a token of the group: a key, a value of the key before it, or broken text.
   subroutine append(self, token)
      class(entries_t), intent(inout) :: self
      type(token_t), intent(in) :: token
      type(token_t), allocatable :: longer(:)

      if (.not. allocated(self%tokens)) allocate (self%tokens(16))
      if (self%n_tokens == size(self%tokens)) then
         allocate (longer(2*self%n_tokens))
         longer(:self%n_tokens) = self%tokens
         call move_alloc(longer, self%tokens)
      end if
      self%n_tokens = self%n_tokens + 1
      self%tokens(self%n_tokens) = token
   end subroutine append

   !> Registers a key among the keys of the group and reads its values; adds a problem to `refusals`
   !> if a value, the number of values or a value's range is not as `key` demands.
   subroutine take(self, key, numbers, texts, word)
      class(entries_t), intent(inout) :: self
      type(key_t), intent(in) :: key
      !> (number of values) values of a key of numbers, or of texts; size 0 if the key is not given
      !> or its values are refused
      real(wp), allocatable, intent(out), optional :: numbers(:)
      character(len=:), allocatable, intent(out), optional :: texts(:)
      !> The word of `key%words` that is given instead of numbers; '' if there is none.
      character(len=*), intent(out), optional :: word
      real(wp), allocatable :: x(:)
      character(len=:), allocatable :: name, message
      integer :: first, k, n

      call append_key(self%keys, key)
      if (present(numbers)) allocate (numbers(0))
      if (present(texts)) allocate (character(len=longest) :: texts(0))
      if (present(word)) word = ''
      name = trim(key%name)
      call self%find_values(name, first, n)
      if (first == 0) return
      if (allocated(key%words) .and. n == 1) then
         associate (only => self%tokens(first + 1))
            if (only%kind == token_string .and. any(key%words == only%text)) word = only%text
         end associate
         if (word /= '') return
      end if
      allocate (x(n))
      do k = 1, n
         call read_value(self%tokens(first + k), key, k > 1, x(k), message)
         if (.not. allocated(message)) cycle
         call self%complain(self%tokens(first + k)%line, name, message)
         return
      end do
      if (n == 0) then
         call self%refuse(name, 'no value', key%noun())
      else if (n > key%most) then
         message = 'at most '//to_text(key%most)
         if (key%most == 1) message = '1'
         if (key%most == 1 .and. key%kind /= kind_text) message = '1; a decimal point is ''.'''
         call self%refuse(name, to_text(n)//' values', message)
      else if (present(texts)) then
         deallocate (texts)
         allocate (character(len=longest) :: texts(n))
         do k = 1, n
            texts(k) = self%tokens(first + k)%text
         end do
      else if (.not. all(key%range%holds(x))) then
         k = findloc(key%range%holds(x), .false., dim=1)
         call self%refuse(name, number(x(k)), key%range%in_words())
      else
         call move_alloc(x, numbers)
      end if
   end subroutine take

   !> Ends the reading of the group: adds a problem for each unknown or repeated key. If the group
   !> has no problem at all, also adds one for each required key that is missing; otherwise the
   !> missing key may be a consequence of the other problem.
   subroutine close(self)
      class(entries_t), intent(inout) :: self
      character(len=:), allocatable :: suggestion
      integer :: first_line(size(self%keys)), i, k

      first_line = 0
      do i = 1, self%n_tokens
         associate (token => self%tokens(i))
            if (token%kind /= token_key) cycle
            do k = size(self%keys), 1, -1
               if (lower(trim(self%keys(k)%name)) == lower(token%text)) exit
            end do
            if (k == 0) then
               call or_nearest(token%text, [(self%keys(k)%name, k=1, size(self%keys))], suggestion)
               call self%complain(token%line, shortened(token%text), 'found an unknown key, '// &
                  'expected '//listed([(self%keys(k)%name, k=1, size(self%keys))], ', ')// &
                  suggestion)
            else if (first_line(k) > 0) then
               call self%complain(token%line, token%text, 'found the key again, expected it '// &
                  'once (first in line '//to_text(first_line(k))//')')
            else
               first_line(k) = token%line
            end if
         end associate
      end do
      if (self%failed()) return
      do k = 1, size(self%keys)
         if (self%keys(k)%required) call self%require(trim(self%keys(k)%name))
      end do
   end subroutine close

   !> Returns whether any problem has been found in the group.
   pure logical function failed(self)
      class(entries_t), intent(in) :: self

      failed = self%refusals%n > 0
   end function failed

   !> Returns whether the group gives a key; upper and lower case are equal.
   pure logical function has(self, name)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name

      has = self%key_position(name) > 0
   end function has

   !> Returns the line of a key; if the key is not given, the line of the group.
   pure integer function line_of(self, name) result(line)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name

      line = self%line
      if (self%has(name)) line = self%tokens(self%key_position(name))%line
   end function line_of

   !> Adds a problem if the group does not give a key.
   subroutine require(self, name)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: name

      if (.not. self%has(name)) call self%refuse(name, 'nothing', 'a value')
   end subroutine require

   !> Adds a problem if the group gives a key that has no meaning in its context.
   !>
   !> beside  the reason, the end of the message `expected none ...`: "beside file"
   subroutine exclude(self, name, beside)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: name, beside

      if (self%has(name)) call self%refuse(name, 'a value', 'none '//beside)
   end subroutine exclude

   !> Adds a problem for each key that has no meaning for the kind of the group.
   !>
   !> kind   value of the key `kind`
   !> keys   (n) keys that belong to certain kinds only
   !> kinds  (n) these kinds, separated by blanks
   subroutine exclude_other_kinds(self, kind, keys, kinds)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: kind, keys(:), kinds(:)
      integer :: k

      do k = 1, size(keys)
         if (index(kinds(k), trim(kind)) == 0) call self%exclude(trim(keys(k)), &
            'with kind = '''//trim(kind)//'''')
      end do
   end subroutine exclude_other_kinds

   !> Adds a problem: what was found as the value of a key, and what was expected.
   subroutine refuse(self, name, found, expected)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: name, found, expected

      call self%complain(self%line_of(name), name, 'found '//found//', expected '//expected)
   end subroutine refuse

   !> Adds a problem with a message of its own.
   !>
   !> line     line of the case file
   !> name     key; '': the problem concerns the whole group
   !> message  `found ..., expected ...`
   subroutine complain(self, line, name, message)
      class(entries_t), intent(inout) :: self
      integer, intent(in) :: line
      character(len=*), intent(in) :: name, message

      call self%refusals%add(line, '&'//trim(self%name//' '//name)//': '//message)
   end subroutine complain

   !> Finds the values of a key.
   !>
   !> first  position of the key among the tokens, its values follow; 0: the key is not given, or
   !>        the text behind it is broken and has been refused already
   !> n      number of values
   pure subroutine find_values(self, name, first, n)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name
      integer, intent(out) :: first, n
      integer :: last

      first = self%key_position(name)
      n = 0
      if (first == 0) return
      do last = first, self%n_tokens - 1
         if (self%tokens(last + 1)%kind < token_word) exit
      end do
      n = last - first
      if (last < self%n_tokens) then
         if (self%tokens(last + 1)%kind == token_broken) first = 0
      end if
      if (first == 0) n = 0
      if (n /= 1) return
      ! A comma alone, as in `key=, next=1`, is not a value.
      associate (only => self%tokens(last))
         if (only%kind == token_mark .and. only%text == ',') n = 0
      end associate
   end subroutine find_values

   !> Returns the position of a key among the tokens, in upper or lower case; 0: it is not given.
   pure integer function key_position(self, name) result(k)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name

      do k = 1, self%n_tokens
         if (self%tokens(k)%kind /= token_key) cycle
         if (lower(self%tokens(k)%text) == lower(name)) return
      end do
      k = 0
   end function key_position

   !> Appends a key to a list. (An array constructor does not work here, because the texts of the
   !> keys have different lengths.)
   subroutine append_key(keys, key)
      type(key_t), allocatable, intent(inout) :: keys(:)
      type(key_t), intent(in) :: key
      type(key_t), allocatable :: longer(:)

      if (.not. allocated(keys)) allocate (keys(0))
      allocate (longer(size(keys) + 1))
      longer(:size(keys)) = keys
      longer(size(longer)) = key
      call move_alloc(longer, keys)
   end subroutine append_key

end module beamid_entries
