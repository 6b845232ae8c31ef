!> The help for groups, keys and parameters, made from their tables.
module beamid_key_help
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_help_pages, only: help_page_t
   use beamid_key_facts, only: allowed_of, default_of, example_of, is_listed, parameter_example, &
      parameter_range, parameter_unit, unit_of
   use beamid_parameters, only: key_of, parameters
   use beamid_see_also, only: a_group, a_parameter, related_words
   use beamid_strings, only: lower
   use beamid_structure, only: is_coefficient
   use beamid_values, only: key_t, listed, name_length
   implicit none
   private

   public :: add_help_on, add_group_list, add_see_also, key_line, known_words, meaning_of, symbol_of

   !> Least column of the explanations of keys, and column of their properties.
   integer, parameter :: key_column = 17, fact_column = 14

contains

   !> Adds the help for every group, key and free parameter of a name, in upper or lower case.
   !>
   !> found  set to .true. if there is one; otherwise unchanged
   subroutine add_help_on(word, page, found)
      character(len=*), intent(in) :: word
      type(help_page_t), intent(inout) :: page
      logical, intent(inout) :: found
      type(block_t), allocatable :: blocks(:)
      integer :: g, k

      call list_keys(blocks)
      do g = 1, size(blocks)
         if (lower(trim(blocks(g)%name)) /= lower(word)) cycle
         if (found) call page%line()
         found = .true.
         call add_group(page, g, blocks(g))
      end do
      do g = 1, size(blocks)
         do k = 1, size(blocks(g)%keys)
            if (lower(trim(blocks(g)%keys(k)%name)) /= lower(word)) cycle
            if (found) call page%line()
            found = .true.
            call add_key(page, blocks(g)%name, blocks(g)%keys(k))
         end do
      end do
      do k = 1, size(parameters)
         if (lower(symbol_of(k)) /= lower(word) .or. .not. is_listed(k)) cycle
         if (found) call page%line()
         found = .true.
         call add_parameter(page, k)
      end do
   end subroutine add_help_on

   !> Adds the list of all groups as a paragraph.
   subroutine add_group_list(page)
      type(help_page_t), intent(inout) :: page
      integer :: g

      call page%labelled(2, 'groups:', 10, listed([('&'//groups(g)%name, g=1, size(groups))], ' '))
   end subroutine add_group_list

   !> Adds the command that prints the help on related words.
   !>
   !> of, topic  as for `related_words`
   !> column     column before which the command begins; default `fact_column`
   subroutine add_see_also(page, of, topic, column)
      type(help_page_t), intent(inout) :: page
      character(len=*), intent(in) :: of, topic
      integer, intent(in), optional :: column
      character(len=:), allocatable :: words
      integer :: place

      place = fact_column
      if (present(column)) place = column
      words = related_words(of, topic)
      if (words /= '') call page%labelled(4, 'see also', place, 'beamid help '//words)
   end subroutine add_see_also

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
      do k = 1, size(parameters)
         if (is_listed(k)) call add_word(words, symbol_of(k))
      end do
   end subroutine known_words

   !> Appends a word to a list unless the list has it.
   subroutine add_word(words, word)
      character(len=name_length), allocatable, intent(inout) :: words(:)
      character(len=*), intent(in) :: word

      if (.not. any(words == word)) words = [character(len=name_length) :: words, word]
   end subroutine add_word

   !> Returns the unit of a key, if it has one, the values that it allows, and its default.
   !>
   !> group  name of the key's group
   function key_line(group, key) result(line)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: line, default, unit

      line = allowed_of(group, key)
      unit = unit_of(group, key)
      if (index(unit, 'unit') /= 1) unit = 'unit: '//unit
      if (unit /= 'unit: none') line = unit//'; '//line
      default = default_of(key)
      if (index(default, 'required') /= 1) default = 'default: '//default
      line = line//'; '//default
   end function key_line

   !> Adds the help for a group: its purpose and all its keys.
   !>
   !> g  its row in `groups`
   subroutine add_group(page, g, block)
      type(help_page_t), intent(inout) :: page
      integer, intent(in) :: g
      type(block_t), intent(in) :: block
      character(len=:), allocatable :: title
      integer :: column, k

      title = 'group &'//block%name
      if (groups(g)%required) title = title//' (required)'
      if (groups(g)%may_repeat) title = title//' (may repeat)'
      call page%line(title)
      call page%paragraph(2, groups(g)%purpose)
      call page%line()
      column = max(key_column, 3 + maxval(len_trim(block%keys%name)))
      do k = 1, size(block%keys)
         associate (key => block%keys(k))
            call page%labelled(2, key%name, column, key%help)
            call page%labelled(2, '', column, key_line(block%name, key))
            call page%labelled(2, '', column, example_of(block%name, key))
         end associate
      end do
      call page%line()
      call add_see_also(page, a_group, block%name)
   end subroutine add_group

   !> Adds the help for a key: the definition, and a line for each of its properties.
   !>
   !> group  name of the key's group
   subroutine add_key(page, group, key)
      type(help_page_t), intent(inout) :: page
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key

      call page%line(trim(key%name)//', key of &'//group)
      call page%paragraph(2, key%help)
      call page%labelled(4, 'unit', fact_column, unit_of(group, key))
      call page%labelled(4, 'allowed', fact_column, allowed_of(group, key))
      call page%labelled(4, 'default', fact_column, default_of(key))
      call page%labelled(4, 'example', fact_column, example_of(group, key))
      call add_see_also(page, group, trim(key%name))
   end subroutine add_key

   !> Returns the name by which a stage estimates parameter k.
   pure function symbol_of(k) result(symbol)
      integer, intent(in) :: k
      character(len=:), allocatable :: symbol

      symbol = trim(parameters(k)%name)
      if (is_coefficient(k)) symbol = trim(parameters(k)%group)
   end function symbol_of

   !> Returns the definition of parameter k.
   pure function meaning_of(k) result(meaning)
      integer, intent(in) :: k
      character(len=:), allocatable :: meaning

      meaning = trim(parameters(k)%help)
      if (is_coefficient(k)) meaning = trim(parameters(k)%name)//' as a function along the '// &
         'beam, with its coefficients'
   end function meaning_of

   !> Adds the help for a parameter that a fit may estimate, parameter k of the table.
   subroutine add_parameter(page, k)
      type(help_page_t), intent(inout) :: page
      integer, intent(in) :: k
      character(len=:), allocatable :: allowed

      associate (row => parameters(k))
         call page%paragraph(0, symbol_of(k)//', parameter, free in &stage as '''//symbol_of(k)// &
            '''', 2)
         call page%paragraph(2, meaning_of(k))
         call page%labelled(4, 'unit', fact_column, parameter_unit(k))
         allowed = trim('number '//parameter_range(k))
         if (row%is_reciprocal) allowed = allowed//', or inf (rigid)'
         call page%labelled(4, 'allowed', fact_column, allowed)
         if (.not. is_coefficient(k)) call page%labelled(4, 'key', fact_column, key_of(k)// &
            ' of &'//row%group)
         call page%labelled(4, 'example', fact_column, parameter_example(k))
         if (row%needs > 0) call page%labelled(4, 'requires', fact_column, &
            trim(parameters(row%needs)%name)//' above 0')
         if (row%group == 'end') then
            call page%labelled(4, 'ends', fact_column, ''''//symbol_of(k)//'.root'' and '''// &
               symbol_of(k)//'.tip'' with a group &end for this end')
         else if (row%item > 0 .and. .not. is_coefficient(k)) then
            call page%labelled(4, 'several', &
            fact_column, 'with several groups &'//trim(row%group)//', '''//symbol_of(k)// &
            '.a'' is the parameter of the group with name=''a''')
         end if
         call add_see_also(page, a_parameter, symbol_of(k))
      end associate
   end subroutine add_parameter

end module beamid_key_help
