!> The help for groups, keys and parameters, made from their tables, for `help` and the manual.
module beamid_key_help
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_parameters, only: free_names, key_of, parameters
   use beamid_strings, only: lower
   use beamid_texts, only: left, text_t, wrapped
   use beamid_units, only: units_t
   use beamid_values, only: key_t, kind_text, listed, name_length, one_of
   implicit none
   private

   public :: add_help_on, add_group_list, known_words, key_line

contains

   !> Adds the help for every group, key and free parameter of a name, in upper or lower case.
   !>
   !> found  set to .true. if there is one; otherwise unchanged
   subroutine add_help_on(word, text, found)
      character(len=*), intent(in) :: word
      type(text_t), intent(inout) :: text
      logical, intent(inout) :: found
      type(block_t), allocatable :: blocks(:)
      integer :: g, k

      call list_keys(blocks)
      do g = 1, size(blocks)
         if (lower(trim(blocks(g)%name)) /= lower(word)) cycle
         if (found) call text%line()
         found = .true.
         call text%line('group &'//trim(blocks(g)%name)//trim(merge(', required   ', &
            '             ', groups(g)%required))//trim(merge(', may repeat', '            ', &
            groups(g)%may_repeat)))
         call text%line('  '//trim(groups(g)%purpose))
         do k = 1, size(blocks(g)%keys)
            call add_key(text, blocks(g)%keys(k))
         end do
      end do
      do g = 1, size(blocks)
         do k = 1, size(blocks(g)%keys)
            if (lower(trim(blocks(g)%keys(k)%name)) /= lower(word)) cycle
            if (found) call text%line()
            found = .true.
            call text%line('key of &'//trim(blocks(g)%name))
            call add_key(text, blocks(g)%keys(k))
         end do
      end do
      do k = 1, size(parameters)
         if (lower(trim(parameters(k)%name)) /= lower(word) .or. .not. parameters(k)%is_free) cycle
         if (found) call text%line()
         found = .true.
         call add_parameter(text, k)
         exit
      end do
   end subroutine add_help_on

   !> Adds the list of all groups as a paragraph.
   subroutine add_group_list(text)
      type(text_t), intent(inout) :: text
      integer :: g

      call text%add(wrapped('  groups: '//listed([('&'//groups(g)%name, g=1, size(groups))], &
         ' ')//new_line('a'), 10))
   end subroutine add_group_list

   !> Returns all names of groups, keys and free parameters, each once.
   subroutine known_words(words)
      character(len=name_length), allocatable, intent(out) :: words(:)
      type(block_t), allocatable :: blocks(:)
      integer :: g, k

      call list_keys(blocks)
      allocate (words(0))
      do g = 1, size(blocks)
         call add_word(words, blocks(g)%name)
         do k = 1, size(blocks(g)%keys)
            call add_word(words, blocks(g)%keys(k)%name)
         end do
      end do
      do k = 1, size(free_names)
         call add_word(words, free_names(k))
      end do
   end subroutine known_words

   !> Appends a word to a list unless the list has it.
   subroutine add_word(words, word)
      character(len=name_length), allocatable, intent(inout) :: words(:)
      character(len=*), intent(in) :: word

      if (.not. any(words == word)) words = [character(len=name_length) :: words, word]
   end subroutine add_word

   !> Returns a key in one sentence: its meaning, the values that it takes, and its default. A
   !> default that begins with `required` is the condition under which the key is required.
   function key_line(key) result(line)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: line
      integer :: k

      line = takes(key)
      if (key%required) then
         line = line//', required'
      else if (index(key%default, 'required') == 1) then
         line = line//', '//key%default
      else if (key%default /= '') then
         line = line//', default: '//key%default
      end if
      line = key%help//' ('//line//')'
      if (.not. allocated(key%words) .or. key%kind == kind_text) return
      line = line//'; or'
      do k = 1, size(key%words)
         line = line//' '''//trim(key%words(k))//''''
      end do
   end function key_line

   !> Returns the kind of the values of a key, with their range or with the words that it allows.
   function takes(key) result(text)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text

      if (allocated(key%choices)) then
         text = one_of(key%choices, trim(merge('''', ' ', key%kind == kind_text)))
         return
      end if
      text = key%kind_in_words()
      if (key%range%limits() /= '') text = text//' '//key%range%limits()
      if (key%infinite) text = text//' or inf'
   end function takes

   !> Adds the help for a key.
   subroutine add_key(text, key)
      type(text_t), intent(inout) :: text
      type(key_t), intent(in) :: key
      integer, parameter :: column = 19

      call text%add(wrapped(left('  '//trim(key%name), column)//key_line(key)//new_line('a'), &
         column))
   end subroutine add_key

   !> Adds the help for a parameter that a fit may estimate, parameter k of the table.
   subroutine add_parameter(text, k)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: k
      type(units_t) :: units
      character(len=:), allocatable :: unit

      units = units_t(length='m', force='N', time='s', mass='kg')
      associate (row => parameters(k))
         call text%line('parameter, free in &stage as '''//trim(row%name)//'''')
         unit = units%of_parameter(k)
         if (unit == '') unit = '-'
         call text%add(wrapped('  '//trim(row%help)//'; '//key_of(k)//' of &'//trim(row%group)// &
            '; in metres, seconds and kilograms its unit is '//unit//new_line('a'), 2))
         if (row%is_reciprocal) call text%line( &
            '  searched for as its reciprocal, so that it may reach infinity (inf), which is rigid')
         if (all(row%needs /= [0, k])) call text%line('  needs '// &
            trim(parameters(row%needs)%name)//' above 0')
         if (row%item > 0) call text%line('  of several '//trim(row%group)// &
            's: '''//trim(row%name)//'.a'' is that of the one named a')
      end associate
   end subroutine add_parameter

end module beamid_key_help
