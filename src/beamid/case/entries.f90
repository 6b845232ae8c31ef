!> The keys of one group of a case file with their values as written, what the group's reader asked
!> for, and what is wrong with either.
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

   type :: entries_t
      character(len=:), allocatable :: name     !< of the group, without '&'
      integer :: line = 1                       !< of its '&'
      type(refusals_t) :: refusals
      type(key_t), allocatable :: keys(:)       !< asked for so far
      !> (n) each key with its values behind it
      type(token_t), allocatable, private :: tokens(:)
      integer, private :: n = 0
   contains
      procedure :: append
      procedure :: take
      procedure :: close
      procedure :: failed
      procedure :: has
      procedure :: line_of
      procedure :: require
      procedure :: exclude
      procedure :: refuse
      procedure :: complain
      procedure, private :: find
      procedure, private :: place
   end type entries_t

contains

   !> A key, one of its values, or what is broken.
   subroutine append(self, token)
      class(entries_t), intent(inout) :: self
      type(token_t), intent(in) :: token
      type(token_t), allocatable :: longer(:)

      if (.not. allocated(self%tokens)) allocate (self%tokens(16))
      if (self%n == size(self%tokens)) then
         allocate (longer(2*self%n))
         longer(:self%n) = self%tokens
         call move_alloc(longer, self%tokens)
      end if
      self%n = self%n + 1
      self%tokens(self%n) = token
   end subroutine append

   !> Notes what a key is, and reads its values.
   subroutine take(self, key, numbers, texts, word)
      class(entries_t), intent(inout) :: self
      type(key_t), intent(in) :: key
      !> (values) of a key that takes numbers, or texts; none where it is not given or refused
      real(wp), allocatable, intent(out), optional :: numbers(:)
      character(len=:), allocatable, intent(out), optional :: texts(:)
      !> Which of the key's words stands for the numbers; ''.
      character(len=*), intent(out), optional :: word
      real(wp), allocatable :: x(:)
      character(len=:), allocatable :: name, message
      integer :: first, k, n

      call append_key(self%keys, key)
      if (present(numbers)) allocate (numbers(0))
      if (present(texts)) allocate (character(len=longest) :: texts(0))
      if (present(word)) word = ''
      name = trim(key%name)
      call self%find(name, first, n)
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

   !> Refuses keys that nobody has asked for or that stand there twice, and the lack of required
   !> ones, where no other problem can be the reason.
   subroutine close(self)
      class(entries_t), intent(inout) :: self
      character(len=:), allocatable :: perhaps
      integer :: seen(size(self%keys)), i, k

      seen = 0
      do i = 1, self%n
         associate (token => self%tokens(i))
            if (token%kind /= token_key) cycle
            do k = size(self%keys), 1, -1
               if (lower(trim(self%keys(k)%name)) == lower(token%text)) exit
            end do
            if (k == 0) then
               call or_nearest(token%text, [(self%keys(k)%name, k=1, size(self%keys))], perhaps)
               call self%complain(token%line, shortened(token%text), 'found an unknown key, '// &
                  'expected '//listed([(self%keys(k)%name, k=1, size(self%keys))], ', ')//perhaps)
            else if (seen(k) > 0) then
               call self%complain(token%line, token%text, 'found the key again, expected it '// &
                  'once (first in line '//to_text(seen(k))//')')
            else
               seen(k) = token%line
            end if
         end associate
      end do
      if (self%failed()) return
      do k = 1, size(self%keys)
         if (self%keys(k)%required) call self%require(trim(self%keys(k)%name))
      end do
   end subroutine close

   !> Whether anything in the group was refused.
   pure logical function failed(self)
      class(entries_t), intent(in) :: self

      failed = self%refusals%n > 0
   end function failed

   !> Whether a key is given.
   pure logical function has(self, name)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name

      has = self%place(name) > 0
   end function has

   !> The line of a key; the group's where the key is not given.
   pure integer function line_of(self, name) result(line)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name

      line = self%line
      if (self%has(name)) line = self%tokens(self%place(name))%line
   end function line_of

   !> Refuses the group without a key.
   subroutine require(self, name)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: name

      if (.not. self%has(name)) call self%refuse(name, 'nothing', 'a value')
   end subroutine require

   !> Refuses a key that has no meaning beside another.
   subroutine exclude(self, name, beside)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: name, beside

      if (self%has(name)) call self%refuse(name, 'a value', 'none '//beside)
   end subroutine exclude

   !> Refuses what a key has.
   subroutine refuse(self, name, found, expected)
      class(entries_t), intent(inout) :: self
      character(len=*), intent(in) :: name, found, expected

      call self%complain(self%line_of(name), name, 'found '//found//', expected '//expected)
   end subroutine refuse

   !> One problem more, of a key or, where its name is '', of the group.
   subroutine complain(self, line, name, message)
      class(entries_t), intent(inout) :: self
      integer, intent(in) :: line
      character(len=*), intent(in) :: name, message

      call self%refusals%add(line, '&'//trim(self%name//' '//name)//': '//message)
   end subroutine complain

   !> Where a key stands, and how many values it has; 0 where it is not given, or so broken that
   !> nothing more can be said about it.
   pure subroutine find(self, name, first, n)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name
      integer, intent(out) :: first, n
      integer :: last

      first = self%place(name)
      n = 0
      if (first == 0) return
      do last = first, self%n - 1
         if (self%tokens(last + 1)%kind < token_word) exit
      end do
      n = last - first
      if (last < self%n) then
         if (self%tokens(last + 1)%kind == token_broken) first = 0
      end if
      if (first == 0) n = 0
      if (n /= 1) return
      ! A comma alone, as in `key=, next=1`, is no value.
      associate (only => self%tokens(last))
         if (only%kind == token_mark .and. only%text == ',') n = 0
      end associate
   end subroutine find

   !> The place of a key, in any case, among the tokens; 0 where it is not given.
   pure integer function place(self, name)
      class(entries_t), intent(in) :: self
      character(len=*), intent(in) :: name

      do place = 1, self%n
         if (self%tokens(place)%kind /= token_key) cycle
         if (lower(self%tokens(place)%text) == lower(name)) return
      end do
      place = 0
   end function place

   !> One key more. (An array constructor would not do for texts of their own length.)
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
