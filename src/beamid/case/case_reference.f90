!> The reference of case files in Markdown, for the documentation. Everything in it comes from the
!> tables of groups, keys and parameters.
module beamid_case_reference
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_key_facts, only: allowed_of, default_of, example_of, is_listed, parameter_example, &
      parameter_unit, unit_of
   use beamid_key_help, only: meaning_of, symbol_of
   use beamid_parameters, only: key_of, parameters
   use beamid_structure, only: is_coefficient
   use beamid_texts, only: text_t, wrapped
   implicit none
   private

   public :: add_reference, as_cell

contains

   !> Adds the page: a section for each group with a row for each key, then the parameters.
   subroutine add_reference(text)
      type(text_t), intent(inout) :: text
      type(block_t), allocatable :: blocks(:)
      integer :: g

      call list_keys(blocks)
      call text%line('# Case file')
      call text%line()
      call text%line('<!-- `beamid help --markdown` prints this page. -->')
      call text%line()
      call add_paragraph(text, '[Groups in detail](groups.md) has the rules that do not fit '// &
         'into a table.')
      call add_paragraph(text, 'A case file consists of groups. A group begins with its name, '// &
         'as in `&beam`, lists keys with their values, and ends with `/`. Groups may stand in '// &
         'any order. A comment begins with `!`. Paths are relative to the case file. A group '// &
         'that is left out has its defaults.')
      call add_paragraph(text, 'Any consistent set of units will do, because no value is '// &
         'converted. The tables give units as dimensions, and in parentheses for metres, '// &
         'newtons, seconds and kilograms. Words and texts are enclosed in quotes, and several '// &
         'values of a key are separated by commas.')
      do g = 1, size(blocks)
         call add_group(text, g, blocks(g))
      end do
      call add_parameters(text)
   end subroutine add_reference

   !> Adds the section of a group.
   !>
   !> g  its row in `groups`
   subroutine add_group(text, g, block)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: g
      type(block_t), intent(in) :: block
      character(len=:), allocatable :: sentences
      integer :: k

      sentences = trim(groups(g)%purpose)
      if (groups(g)%required) sentences = sentences//' The group is required.'
      if (groups(g)%may_repeat) then
         sentences = sentences//' The group may repeat.'
      else
         sentences = sentences//' The group may appear once.'
      end if
      call text%line('## `&'//block%name//'`')
      call text%line()
      call add_paragraph(text, as_cell(sentences))
      call text%line('| key | meaning | unit | allowed | default | example |')
      call text%line('|---|---|---|---|---|---|')
      do k = 1, size(block%keys)
         associate (key => block%keys(k))
            call text%line('| `'//trim(key%name)//'` | '//as_cell(key%help)//' | '// &
               as_cell(unit_of(block%name, key))//' | '//as_cell(allowed_of(block%name, key))// &
               ' | '//as_cell(default_of(key))//' | `'//example_of(block%name, key)//'` |')
         end associate
      end do
      call text%line()
   end subroutine add_group

   !> Adds the table of the parameters that a fit may estimate.
   subroutine add_parameters(text)
      type(text_t), intent(inout) :: text
      integer :: k

      call text%line('## Parameters')
      call text%line()
      call add_paragraph(text, 'A fit can estimate these parameters. Their symbols are the '// &
         'names in `free` and `shared` of `&stage`, in `parameter` of `&prior` and of `&draw`, '// &
         'and in `parameters` of `&design`. With several sensors, `m_S.a` is the mass of the '// &
         'sensor whose `name` is `a`; supports are named likewise.')
      call text%line('| symbol | meaning | unit | group and key | example |')
      call text%line('|---|---|---|---|---|')
      do k = 1, size(parameters)
         if (is_listed(k)) call add_parameter(text, k)
      end do
   end subroutine add_parameters

   subroutine add_parameter(text, k)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: k
      character(len=:), allocatable :: symbol, meaning, place, symbol_needed

      associate (row => parameters(k))
         symbol = symbol_of(k)
         meaning = meaning_of(k)
         if (is_coefficient(k)) then
            place = '`&stage` `free`'
         else
            place = '`&'//trim(row%group)//'` `'//key_of(k)//'`'
         end if
         if (row%is_reciprocal) meaning = meaning//'; may be infinite (rigid), because the fit '// &
            'searches for its reciprocal'
         if (row%needs > 0) then
            symbol_needed = trim(parameters(row%needs)%name)
            if (index(meaning, 'beside '//symbol_needed) == 0) meaning = meaning//'; requires '// &
               symbol_needed
         end if
         call text%line('| `'//symbol//'` | '//as_cell(meaning)//' | '// &
            as_cell(parameter_unit(k))//' | '//place//' | `'//parameter_example(k)//'` |')
      end associate
   end subroutine add_parameter

   !> Adds a paragraph and an empty line.
   subroutine add_paragraph(text, sentences)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: sentences

      call text%add(wrapped(sentences//new_line('a'), 0))
      call text%line()
   end subroutine add_paragraph

   !> Returns a text for a cell of a table, in which Markdown leaves `|`, `*`, `<` and `>` as they
   !> are. The name of a group, as in &beam, becomes code.
   pure function as_cell(text) result(cell)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: cell
      integer :: k, n

      cell = ''
      k = 1
      do while (k <= len(text))
         n = 1
         select case (text(k:k))
         case ('|', '*', '`', '\'); cell = cell//'\'//text(k:k)
         case ('<'); cell = cell//'&lt;'
         case ('>'); cell = cell//'&gt;'
         case ('&')
            n = verify(text(k + 1:)//' ', 'abcdefghijklmnopqrstuvwxyz')
            if (n == 1) cell = cell//'&amp;'
            if (n > 1) cell = cell//'`'//text(k:k + n - 1)//'`'
         case default; cell = cell//text(k:k)
         end select
         k = k + n
      end do
   end function as_cell

end module beamid_case_reference
