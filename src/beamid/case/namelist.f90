!> Splits the text of a case file into groups, and each group into keys with their values as
!> written. The readers of the groups (`beamid_blocks`) interpret the keys.
module beamid_namelist
   use beamid_blocks, only: block_t
   use beamid_numbers, only: shown
   use beamid_refusals, only: refusals_t
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: lower, to_text
   use beamid_tokens, only: line_feed, scanner_t, token_broken, token_end, token_group, &
      token_key, token_mark, token_slash, token_t, token_word
   use beamid_values, only: listed
   implicit none
   private

   public :: group_t, scan_namelist

   !> Largest size of a case file [bytes].
   integer, parameter :: max_bytes = 2**18

   !> A group that a case file may contain.
   type :: group_t
      character(len=20) :: name
      logical :: may_repeat = .false.     !< the group may occur more than once
      logical :: required = .false.       !< a case file must contain the group
      logical :: stands_alone = .false.   !< if this group is given, no other group is required
      character(len=100) :: purpose = ''  !< sentence for the help and the reference
   end type group_t

contains

   !> Splits a case file into groups and reports all problems with its form.
   subroutine scan_namelist(text, groups, blocks, refusals)
      character(len=*), intent(in) :: text
      !> Groups that are known.
      type(group_t), intent(in) :: groups(:)
      !> Groups that were found, in the order of the file, each with its own problems.
      type(block_t), allocatable, intent(out) :: blocks(:)
      !> Problems outside the groups.
      type(refusals_t), intent(out) :: refusals
      type(scanner_t) :: scanner
      type(block_t) :: ignored
      integer :: g, i, n, first_line(size(groups))

      ! The number of '&' is an upper bound of the number of groups.
      allocate (blocks(count([(text(i:i) == '&', i=1, len(text))])))
      n = 0
      first_line = 0
      call refuse_binary(text, refusals)
      scanner%text = text
      ! Skip the byte-order mark of UTF-8.
      if (index(text, char(239)//char(187)//char(191)) == 1) scanner%next = 4
      if (refusals%n == 0) call scanner%advance()
      do while (scanner%token%kind /= token_end)
         select case (scanner%token%kind)
         case (token_group)
            call find_group(scanner%token, groups, first_line, refusals, g)
            if (g > 0) then
               n = n + 1
               blocks(n)%name = trim(groups(g)%name)
               call scan_group(scanner, blocks(n))
            else
               ! Problems inside a group that is unknown or repeated are not reported.
               call scan_group(scanner, ignored)
            end if
         case (token_broken)
            call refusals%add(scanner%token%line, scanner%token%text)
            call scanner%skip_to_group()
         case default
            call refusals%add(scanner%token%line, 'found '//shown(scanner%token%text)// &
               ' outside a group, expected ''&name'' and, behind the group, ''/''')
            call scanner%skip_to_group()
         end select
      end do
      blocks = blocks(:n)
      ! If there are other problems, a missing group may be a consequence of one of them.
      if (refusals%n > 0 .or. any(blocks%refusals%n > 0)) return
      if (all(first_line == 0)) then
         call refusals%add(scanner%line, 'found no group, expected &'// &
            listed([(groups(g)%name, g=1, size(groups))], ', &'))
      else if (.not. any(groups%stands_alone .and. first_line > 0)) then
         do g = 1, size(groups)
            if (groups(g)%required .and. first_line(g) == 0) call refusals%add(scanner%line, &
               'found no group &'//trim(groups(g)%name)//', expected one')
         end do
      end if
   end subroutine scan_namelist

   !> Refuses a file that is longer than `max_bytes`, is not UTF-8 or has control characters.
   subroutine refuse_binary(text, refusals)
      character(len=*), intent(in) :: text
      type(refusals_t), intent(inout) :: refusals
      integer :: i, code, continuation, line

      if (len(text) > max_bytes) then
         call refusals%add(1, 'found a file of more than '//to_text(max_bytes)// &
            ' bytes, expected a case file')
         return
      end if
      continuation = 0
      line = 1
      do i = 1, len(text)
         code = iachar(text(i:i))
         ! UTF-8: the first byte of a character says how many bytes 10xxxxxx follow.
         if (continuation > 0 .neqv. (code >= 128 .and. code < 192)) exit
         continuation = max(continuation - 1, 0)
         if (code >= 192) continuation = 1
         if (code >= 224) continuation = 2
         if (code >= 240) continuation = 3
         if (code == 192 .or. code == 193 .or. code > 244 .or. code == 127) exit
         if (code < 32 .and. code /= 9 .and. code /= 10 .and. code /= 13) exit
         if (code == 13 .and. i < len(text) .and. index(text(i + 1:), line_feed) /= 1) exit
         if (code == 10) line = line + 1
      end do
      if (i <= len(text) .or. continuation > 0) call refusals%add(line, 'found a character '// &
         'that is not text (a control character or not UTF-8), expected a text file')
   end subroutine refuse_binary

   !> Finds the group that a token names, and reports an unknown or repeated group.
   !>
   !> first_line  (number of groups) line where each group occurs first; 0: not yet
   !> g           number of the group; 0: unknown or not allowed to repeat
   subroutine find_group(token, groups, first_line, refusals, g)
      type(token_t), intent(in) :: token
      type(group_t), intent(in) :: groups(:)
      integer, intent(inout) :: first_line(:)
      type(refusals_t), intent(inout) :: refusals
      integer, intent(out) :: g
      character(len=:), allocatable :: suggestion
      integer :: i

      do g = size(groups), 1, -1
         if (lower(trim(groups(g)%name)) == lower(token%text(2:))) exit
      end do
      if (g == 0) then
         call or_nearest(token%text(2:), [(groups(i)%name, i=1, size(groups))], suggestion)
         call refusals%add(token%line, 'found unknown group '//shown(token%text)// &
            ', expected &'//listed([(groups(i)%name, i=1, size(groups))], ', &')//suggestion)
      else if (first_line(g) > 0 .and. .not. groups(g)%may_repeat) then
         call refusals%add(token%line, 'found &'//trim(groups(g)%name)// &
            ' again, expected it once (first in line '//to_text(first_line(g))//')')
         g = 0
      else
         first_line(g) = token%line
      end if
   end subroutine find_group

   !> Scans one group into a block; the scanner moves from the group's name to the token behind it.
   subroutine scan_group(scanner, block)
      type(scanner_t), intent(inout) :: scanner
      type(block_t), intent(inout) :: block
      character(len=:), allocatable :: key

      block%line = scanner%token%line
      key = ''
      call scanner%advance()
      do
         select case (scanner%token%kind)
         case (token_key)
            key = scanner%token%text
            call scan_key(scanner, block)
         case (token_slash)
            call scanner%advance()
            exit
         case (token_broken)
            call block%complain(scanner%token%line, key, scanner%token%text)
            call block%append(scanner%token)
            call scanner%skip_to_group()
            exit
         case (token_end, token_group)
            call report_missing_end(scanner, block)
            exit
         case default
            call report_no_key(scanner%token, block)
            key = ''
            call scanner%skip_values()
         end select
      end do
   end subroutine scan_group

   !> Scans `key = values` from the key onwards and appends both to the block. A comma that
   !> separates two values is not appended; any other comma is, and is refused later.
   subroutine scan_key(scanner, block)
      type(scanner_t), intent(inout) :: scanner
      type(block_t), intent(inout) :: block
      logical :: after_value

      if (index(scanner%token%text, '(') > 0) then
         call block%complain(scanner%token%line, scanner%token%text, 'found a subscript, array '// &
            'subscripts are not supported, expected the values in order')
         call scanner%skip_values()
         return
      end if
      call block%append(scanner%token)
      call scanner%advance()
      after_value = .false.
      do while (scanner%at_value())
         if (after_value .and. scanner%token%kind == token_mark .and. &
            scanner%token%text == ',') then
            after_value = .false.
         else
            call block%append(scanner%token)
            after_value = .true.
         end if
         call scanner%advance()
      end do
   end subroutine scan_key

   !> Reports a token that stands where a key is expected.
   subroutine report_no_key(token, block)
      type(token_t), intent(in) :: token
      type(block_t), intent(inout) :: block
      character(len=:), allocatable :: message

      message = shown(token%text)//', expected key = value or ''/'''
      if (token%kind == token_word .and. index(token%text, '(') > 0) message = &
         shown(token%text)//', array subscripts are not supported, expected key = values'
      if (token%text == '&') message = '''&'' alone, expected a key or ''/'''
      call block%complain(token%line, '', 'found '//message)
   end subroutine report_no_key

   !> Reports a group without '/'. It ends at '&end', at the next group or at the end of the file.
   subroutine report_missing_end(scanner, block)
      type(scanner_t), intent(inout) :: scanner
      type(block_t), intent(inout) :: block

      associate (token => scanner%token)
         if (token%kind == token_end) then
            call block%complain(block%line, '', 'found the end of the file, expected ''/'' '// &
               'behind the last value')
         else if (lower(token%text) /= '&end') then
            call block%complain(block%line, '', 'found '//shown(token%text)//' in line '// &
               to_text(token%line)//', expected ''/'' before it')
         else
            call block%complain(token%line, '', 'found ''&end'', expected ''/''')
            call scanner%advance()
            if (token%kind == token_slash) call scanner%advance()
         end if
      end associate
   end subroutine report_missing_end

end module beamid_namelist
