!> Checks a case file against a table of groups and keys before gfortran's namelist reader sees it.
!>
!> That reader reports most mistakes as "End of file", lets others pass in silence and crashes on
!> `mass(`. Here every problem gets one line, `file:line: &group key: found X, expected Y`; what
!> passes is handed over as clean text that `read (text, nml=group)` accepts.
module beamid_namelist
   use beamid_errors, only: error_t, bad_input
   use beamid_numbers, only: shortened, shown
   use beamid_keys, only: block_t, group, group_t, integer_key, key_t, name_length, place_of, &
      real_key, string_key
   use beamid_strings, only: lower, to_text
   use beamid_tokens, only: line_feed, scanner_t, token_broken, token_end, token_group, &
      token_word
   use beamid_values, only: scan_values, string_length
   implicit none
   private

   public :: scan_namelist, string_length
   public :: key_t, group_t, block_t, real_key, integer_key, string_key, group

   !> The largest case file, bytes.
   integer, parameter :: max_bytes = 2**18

contains

   !> Checks the text of a case file; all problems are found, up to 20 are told, one line each.
   subroutine scan_namelist(path, text, schema, blocks, error)
      !> The file's path, for messages, and its text.
      character(len=*), intent(in) :: path, text
      !> The groups that are known.
      type(group_t), intent(in) :: schema(:)
      !> The groups that were found, in the order of the file; size 0 after an error.
      type(block_t), allocatable, intent(out) :: blocks(:)
      !> Allocated when there are problems.
      type(error_t), allocatable, intent(out) :: error
      type(scanner_t) :: scanner
      integer :: i, n, seen(size(schema))

      n = 0
      scanner%path = path
      scanner%place = ''
      scanner%problems = ''
      call refuse_binary(scanner, text)
      if (scanner%n_problems == 0) then
         ! There are no more groups than there are '&'.
         allocate (blocks(count([(text(i:i) == '&', i=1, len(text))])))
         scanner%text = text
         if (index(text, char(239)//char(187)//char(191)) == 1) scanner%next = 4
         call scan_groups(scanner, schema, seen, blocks, n)
         call require_groups(scanner, schema, seen)
      end if
      if (scanner%n_problems > 0) then
         n = 0
         call bad_input(error, scanner%problems)
      end if
      if (.not. allocated(blocks)) allocate (blocks(0))
      blocks = blocks(:n)
   end subroutine scan_namelist

   !> Refuses what is not text, and a text that is far too long.
   subroutine refuse_binary(scanner, text)
      type(scanner_t), intent(inout) :: scanner
      character(len=*), intent(in) :: text
      integer :: i, code, more

      if (len(text) > max_bytes) then
         call scanner%problem('found a file of more than '//to_text(max_bytes)// &
            ' bytes, expected a case file')
         return
      end if
      more = 0
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
         if (code == 10) scanner%line = scanner%line + 1
      end do
      if (i <= len(text) .or. more > 0) call scanner%problem('found a character '// &
         'that is not text (a control character or not UTF-8), expected a text file')
   end subroutine refuse_binary

   !> Goes through all groups of the text.
   subroutine scan_groups(scanner, schema, seen, blocks, n)
      type(scanner_t), intent(inout) :: scanner
      type(group_t), intent(in) :: schema(:)
      !> Line where each known group was first seen, 0 for not at all.
      integer, intent(out) :: seen(:)
      !> The groups found and their number.
      type(block_t), intent(inout) :: blocks(:)
      integer, intent(inout) :: n
      type(group_t) :: ignored
      type(block_t) :: unused
      integer :: g

      seen = 0
      allocate (ignored%keys(0))
      call scanner%advance()
      do while (scanner%kind /= token_end)
         scanner%quiet = .false.
         scanner%place = ''
         if (scanner%kind /= token_group .or. scanner%token == '&') then
            if (scanner%kind /= token_broken) call scanner%problem('found '// &
               shown(scanner%token)//' outside a group, expected ''&name'' and, behind the '// &
               'group, ''/''')
            call scanner%skip_to_group()
            cycle
         end if
         call find_group(scanner, schema, seen, g)
         if (g > 0) then
            n = n + 1
            call scan_group(scanner, schema(g), blocks(n))
         else
            scanner%quiet = .true.
            call scan_group(scanner, ignored, unused)
         end if
      end do
   end subroutine scan_groups

   !> The group whose name is the current token; 0 with a problem when it must not stand here.
   subroutine find_group(scanner, schema, seen, g)
      type(scanner_t), intent(inout) :: scanner
      type(group_t), intent(in) :: schema(:)
      integer, intent(inout) :: seen(:)
      integer, intent(out) :: g
      integer :: i

      g = place_of(scanner%token(2:), schema)
      if (g == 0) then
         call scanner%problem('found unknown group '//shown(scanner%token)//', expected '// &
            list('&', [(schema(i)%name, i=1, size(schema))]))
         scanner%passed_over = .true.
      else if (seen(g) > 0 .and. .not. schema(g)%may_repeat) then
         call scanner%problem('found &'//trim(schema(g)%name)//' again, expected it once '// &
            '(first in line '//to_text(seen(g))//')')
         g = 0
      else
         seen(g) = scanner%line
      end if
   end subroutine find_group

   !> Reports the groups that had to be there.
   subroutine require_groups(scanner, schema, seen)
      type(scanner_t), intent(inout) :: scanner
      type(group_t), intent(in) :: schema(:)
      integer, intent(in) :: seen(:)
      integer :: g

      scanner%quiet = .false.
      scanner%place = ''
      if (scanner%passed_over) return
      if (all(seen == 0)) then
         call scanner%problem('found no group, expected '// &
            list('&', [(schema(g)%name, g=1, size(schema))]))
         return
      end if
      do g = 1, size(schema)
         if (schema(g)%required .and. seen(g) == 0) call scanner%problem('found no group &'// &
            trim(schema(g)%name)//', expected one')
      end do
   end subroutine require_groups

   !> Goes through one group; the scanner stands on its name and ends on the token behind it.
   subroutine scan_group(scanner, table, found)
      type(scanner_t), intent(inout) :: scanner
      type(group_t), intent(in) :: table
      type(block_t), intent(out) :: found

      found%name = table%name
      found%line = scanner%line
      found%text = '&'//trim(table%name)
      found%keys = table%keys
      allocate (found%lines(size(table%keys)), found%counts(size(table%keys)), source=0)
      call scanner%advance()
      do
         scanner%place = '&'//trim(table%name)//': '
         if (scanner%is_key()) then
            call scan_key(scanner, found)
         else if (scanner%is_mark('/')) then
            scanner%place = ''
            call scanner%advance()
            exit
         else if (scanner%kind == token_broken) then
            call scanner%skip_to_group()
            exit
         else if (scanner%kind == token_end .or. &
            (scanner%kind == token_group .and. scanner%token /= '&')) then
            call report_missing_end(scanner, found%line)
            exit
         else
            call report_no_key(scanner)
            call scanner%skip_values()
         end if
      end do
      found%text = found%text//' /'//line_feed
   end subroutine scan_group

   !> Something that is no key stands where one should.
   subroutine report_no_key(scanner)
      type(scanner_t), intent(inout) :: scanner

      if (scanner%kind == token_group) then
         call scanner%problem('found ''&'' alone, expected a key or ''/''')
      else if (scanner%kind == token_word .and. index(scanner%token, '(') > 0) then
         call scanner%problem('found '//shown(scanner%token)// &
            ', array subscripts are not supported, expected key = values')
      else
         call scanner%problem('found '//shown(scanner%token)//', expected key = value or ''/''')
      end if
   end subroutine report_no_key

   !> A group ends without '/': at '&end', at the next group or at the end of the file.
   subroutine report_missing_end(scanner, line)
      type(scanner_t), intent(inout) :: scanner
      !> The line where the group began.
      integer, intent(in) :: line

      if (scanner%kind == token_end) then
         call scanner%problem('found the end of the file, expected ''/'' behind the last value', &
            line)
      else if (lower(scanner%token) == '&end') then
         call scanner%problem('found ''&end'', expected ''/''')
         call scanner%advance()
         if (scanner%is_mark('/')) call scanner%advance()
      else
         call scanner%problem('found '//shown(scanner%token)//' in line '// &
            to_text(scanner%line)//', expected ''/'' before it', line)
      end if
   end subroutine report_missing_end

   !> Goes through `key = values`; the scanner stands on the key.
   subroutine scan_key(scanner, found)
      type(scanner_t), intent(inout) :: scanner
      type(block_t), intent(inout) :: found
      character(len=:), allocatable :: name
      integer :: i, k, before

      name = scanner%token
      scanner%place = '&'//trim(found%name)//' '//shortened(name)//': '
      before = scanner%n_problems
      k = place_of(name, found%keys)
      if (len(name) > name_length) then
         call scanner%problem('found a name of '//to_text(len(name))// &
            ' characters, expected at most '//to_text(name_length))
      else if (index(name, '(') > 0) then
         call scanner%problem('found a subscript, array subscripts are not supported, '// &
            'expected the values in order')
      else if (k == 0) then
         call scanner%problem('found an unknown key, expected '// &
            list('', [(found%keys(i)%name, i=1, size(found%keys))]))
      else if (found%lines(k) > 0) then
         call scanner%problem('found the key again, expected it once (first in line '// &
            to_text(found%lines(k))//')')
      end if
      if (scanner%n_problems > before .or. scanner%quiet) then
         call scanner%skip_values()
         return
      end if
      found%lines(k) = scanner%line
      call scanner%advance()
      call scan_values(scanner, found, k)
   end subroutine scan_key

   !> Names joined by commas.
   pure function list(prefix, names) result(text)
      !> What stands before each name, and the names.
      character(len=*), intent(in) :: prefix, names(:)
      character(len=:), allocatable :: text
      integer :: i

      text = ''
      do i = 1, size(names)
         if (i > 1) text = text//', '
         text = text//prefix//trim(names(i))
      end do
   end function list

end module beamid_namelist
