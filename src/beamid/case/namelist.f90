!> Takes the text of a case file apart into groups, and the groups into keys with their values as
!> written. What the keys mean is up to those who read the groups (`beamid_blocks`).
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

   !> The largest case file, bytes.
   integer, parameter :: max_bytes = 2**18

   !> One group that a file may hold.
   type :: group_t
      character(len=20) :: name
      logical :: may_repeat = .false., required = .false.
      logical :: stands_alone = .false.   !< beside it no group is required
   end type group_t

contains

   !> Takes a case file apart; all problems with its form are found.
   subroutine scan_namelist(text, groups, blocks, refusals)
      character(len=*), intent(in) :: text
      !> The groups that are known.
      type(group_t), intent(in) :: groups(:)
      !> The groups that were found, in the order of the file, each with the problems inside it.
      type(block_t), allocatable, intent(out) :: blocks(:)
      !> The problems outside of them.
      type(refusals_t), intent(out) :: refusals
      type(scanner_t) :: scanner
      integer :: g, i, n, seen(size(groups))

      ! There are no more groups than there are '&'.
      allocate (blocks(count([(text(i:i) == '&', i=1, len(text))])))
      n = 0
      seen = 0
      call refuse_binary(text, refusals)
      scanner%text = text
      if (index(text, char(239)//char(187)//char(191)) == 1) scanner%next = 4
      if (refusals%n == 0) call scanner%advance()
      do while (scanner%token%kind /= token_end)
         select case (scanner%token%kind)
         case (token_group)
            call find_group(scanner%token, groups, seen, refusals, g)
            if (g > 0) then
               n = n + 1
               blocks(n)%name = trim(groups(g)%name)
               call scan_group(scanner, blocks(n))
            else
               call pass_group(scanner)
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
      ! A group that is missing may have been lost to another problem.
      if (refusals%n > 0 .or. any(blocks%refusals%n > 0)) return
      if (all(seen == 0)) then
         call refusals%add(scanner%line, 'found no group, expected &'// &
            listed([(groups(g)%name, g=1, size(groups))], ', &'))
      else if (.not. any(groups%stands_alone .and. seen > 0)) then
         do g = 1, size(groups)
            if (groups(g)%required .and. seen(g) == 0) call refusals%add(scanner%line, &
               'found no group &'//trim(groups(g)%name)//', expected one')
         end do
      end if
   end subroutine scan_namelist

   !> Refuses what is not text, and a text that is far too long.
   subroutine refuse_binary(text, refusals)
      character(len=*), intent(in) :: text
      type(refusals_t), intent(inout) :: refusals
      integer :: i, code, more, line

      if (len(text) > max_bytes) then
         call refusals%add(1, 'found a file of more than '//to_text(max_bytes)// &
            ' bytes, expected a case file')
         return
      end if
      more = 0
      line = 1
      do i = 1, len(text)
         code = iachar(text(i:i))
         ! UTF-8: a first byte says how many bytes 10xxxxxx follow.
         if (more > 0 .neqv. (code >= 128 .and. code < 192)) exit
         more = max(more - 1, 0)
         if (code >= 192) more = 1
         if (code >= 224) more = 2
         if (code >= 240) more = 3
         if (code == 192 .or. code == 193 .or. code > 244 .or. code == 127) exit
         if (code < 32 .and. code /= 9 .and. code /= 10 .and. code /= 13) exit
         if (code == 13 .and. i < len(text) .and. index(text(i + 1:), line_feed) /= 1) exit
         if (code == 10) line = line + 1
      end do
      if (i <= len(text) .or. more > 0) call refusals%add(line, 'found a character '// &
         'that is not text (a control character or not UTF-8), expected a text file')
   end subroutine refuse_binary

   !> The group whose name is the token; 0 with a problem when it must not stand here.
   !>
   !> seen  line where each known group was first seen, 0 for not at all
   subroutine find_group(token, groups, seen, refusals, g)
      type(token_t), intent(in) :: token
      type(group_t), intent(in) :: groups(:)
      integer, intent(inout) :: seen(:)
      type(refusals_t), intent(inout) :: refusals
      integer, intent(out) :: g
      character(len=:), allocatable :: perhaps
      integer :: i

      do g = size(groups), 1, -1
         if (lower(trim(groups(g)%name)) == lower(token%text(2:))) exit
      end do
      if (g == 0) then
         call or_nearest(token%text(2:), [(groups(i)%name, i=1, size(groups))], perhaps)
         call refusals%add(token%line, 'found unknown group '//shown(token%text)// &
            ', expected &'//listed([(groups(i)%name, i=1, size(groups))], ', &')//perhaps)
      else if (seen(g) > 0 .and. .not. groups(g)%may_repeat) then
         call refusals%add(token%line, 'found &'//trim(groups(g)%name)// &
            ' again, expected it once (first in line '//to_text(seen(g))//')')
         g = 0
      else
         seen(g) = token%line
      end if
   end subroutine find_group

   !> Skips a group that is unknown or repeated; problems inside it are not reported.
   subroutine pass_group(scanner)
      type(scanner_t), intent(inout) :: scanner
      type(block_t) :: ignored

      call scan_group(scanner, ignored)
   end subroutine pass_group

   !> Goes through one group; the scanner stands on its name and ends on the token behind it.
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

   !> Goes through `key = values`; the scanner stands on the key. Commas that stand where they
   !> should are left out of the values.
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

   !> Something that is no key stands where one should.
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

   !> A group ends without '/': at '&end', at the next group or at the end of the file.
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
