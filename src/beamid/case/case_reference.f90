!> The reference of case files in Markdown, for the documentation. Everything in it comes from the
!> tables of groups, keys and parameters, except for the units of keys that are no parameters.
module beamid_case_reference
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_parameters, only: key_of, parameters
   use beamid_structure, only: is_coefficient
   use beamid_texts, only: text_t, wrapped
   use beamid_units, only: units_t
   use beamid_values, only: key_t, kind_integer, kind_real, kind_text, listed, name_length, range_t
   implicit none
   private

   public :: add_reference, as_cell

   !> The unit of a key that holds no parameter.
   type :: key_unit_t
      character(len=name_length) :: key
      character(len=26) :: unit
      character(len=name_length) :: group = ''   !< blank: all groups with this key
   end type key_unit_t

   character(len=*), parameter :: of_parameter = 'unit of the parameter', &
      of_record = 'unit of the record'

   !> The first row that fits a key counts.
   type(key_unit_t), parameter :: key_units(*) = [ &
      key_unit_t('amplitude', 'N'), key_unit_t('atol', 'm'), key_unit_t('clip_high', of_record), &
      key_unit_t('clip_low', of_record), key_unit_t('delta', 's'), &
      key_unit_t('density', 'kg/m^3'), key_unit_t('displacement', 'm'), &
      key_unit_t('duration', 's'), key_unit_t('force', 'N'), key_unit_t('height', 'm'), &
      key_unit_t('high', of_parameter), key_unit_t('length', 'm'), &
      key_unit_t('low', of_parameter), key_unit_t('lower', of_parameter), &
      key_unit_t('noise_sd', 'm/s^2'), key_unit_t('offset', of_record), &
      key_unit_t('power', 'no unit'), key_unit_t('rate', '1/s'), key_unit_t('rtol', 'no unit'), &
      key_unit_t('scale', 'm/s^2 per unit of record'), &
      key_unit_t('sd', of_parameter, group='prior'), key_unit_t('sd', 'm/s^2'), &
      key_unit_t('spread', 'no unit'), key_unit_t('start', of_parameter), &
      key_unit_t('t_first', 's'), key_unit_t('t_last', 's'), key_unit_t('t_step', 's'), &
      key_unit_t('target', 'no unit'), key_unit_t('time', 's'), &
      key_unit_t('upper', of_parameter), key_unit_t('value', of_parameter), &
      key_unit_t('width', 'm'), key_unit_t('x', 'm'), key_unit_t('x_F', 'm'), &
      key_unit_t('x_P', 'm'), key_unit_t('x_S', 'm')]

contains

   !> Adds the page: a section for each group with a row for each key, then the parameters.
   subroutine add_reference(text)
      type(text_t), intent(inout) :: text
      type(block_t), allocatable :: blocks(:)
      integer :: g

      call list_keys(blocks)
      call text%line('# Case file')
      call text%line()
      call add_paragraph(text, 'A case file consists of groups. A group begins with its name, '// &
         'as in `&beam`, lists keys with their values, and ends with `/`. Groups may stand in '// &
         'any order. A comment begins with `!`. Paths are relative to the case file. A group '// &
         'that is left out has its defaults.')
      call add_paragraph(text, 'Any consistent set of units will do, because no value is '// &
         'converted. The tables give units for metres, newtons, seconds and kilograms. Words '// &
         'and texts are enclosed in quotes, and several values of a key are separated by commas.')
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
      call text%line('| key | type and unit | allowed | default | meaning |')
      call text%line('|---|---|---|---|---|')
      do k = 1, size(block%keys)
         associate (key => block%keys(k))
            call text%line('| `'//trim(key%name)//'` | '//as_cell(type_of(block%name, key))// &
               ' | '//as_cell(allowed(key))//' | '//as_cell(default_of(key))//' | '// &
               as_cell(key%help)//' |')
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
      call text%line('| symbol | unit | meaning | group and key |')
      call text%line('|---|---|---|---|')
      do k = 1, size(parameters)
         if (.not. parameters(k)%is_free .or. parameters(k)%item > 1) cycle
         call add_parameter(text, k)
      end do
   end subroutine add_parameters

   subroutine add_parameter(text, k)
      type(text_t), intent(inout) :: text
      integer, intent(in) :: k
      character(len=:), allocatable :: symbol, meaning, place, symbol_needed

      associate (row => parameters(k))
         if (is_coefficient(k)) then
            symbol = trim(row%group)
            meaning = trim(row%name)//' as a function along the beam, with its coefficients'
            place = '`&stage` `free`'
         else
            symbol = trim(row%name)
            meaning = trim(row%help)
            place = '`&'//trim(row%group)//'` `'//key_of(k)//'`'
         end if
         if (row%is_reciprocal) meaning = meaning//'; the search is in its reciprocal, so that '// &
            'it may be infinite, which is rigid'
         if (all(row%needs /= [0, k])) then
            symbol_needed = trim(parameters(row%needs)%name)
            if (index(meaning, 'beside '//symbol_needed) == 0) meaning = meaning//'; requires '// &
               symbol_needed
         end if
         call text%line('| `'//symbol//'` | '//as_cell(si_unit(k))//' | '//as_cell(meaning)// &
            ' | '//place//' |')
      end associate
   end subroutine add_parameter

   !> Adds a paragraph and an empty line.
   subroutine add_paragraph(text, sentences)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: sentences

      call text%add(wrapped(sentences//new_line('a'), 0))
      call text%line()
   end subroutine add_paragraph

   !> Returns the type of a key and the unit of its numbers.
   !>
   !> group  of the key
   function type_of(group, key) result(text)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text

      text = key%kind_in_words()
      if (key%is_file) text = 'path'
      if (key%kind == kind_real) text = text//', '//unit_of(group, trim(key%name))
   end function type_of

   !> Returns the unit of a key with real numbers; '?' if no table has one.
   function unit_of(group, name) result(unit)
      character(len=*), intent(in) :: group, name
      character(len=:), allocatable :: unit
      integer :: k

      do k = 1, size(parameters)
         if (parameters(k)%group /= group .or. key_of(k) /= name) cycle
         if (name == 'offset') exit
         unit = si_unit(k)
         return
      end do
      ! &beam has short forms of keys of &end.
      if (group == 'beam') then
         do k = 1, size(parameters)
            if (parameters(k)%group /= 'end' .or. key_of(k) /= name) cycle
            unit = si_unit(k)
            return
         end do
      end if
      unit = '?'
      do k = 1, size(key_units)
         if (key_units(k)%key /= name) cycle
         if (key_units(k)%group /= '' .and. key_units(k)%group /= group) cycle
         unit = trim(key_units(k)%unit)
         return
      end do
   end function unit_of

   !> Returns the unit of a parameter in metres, newtons, seconds and kilograms.
   function si_unit(k) result(unit)
      integer, intent(in) :: k
      character(len=:), allocatable :: unit
      type(units_t) :: units

      units = units_t(length='m', force='N', time='s', mass='kg')
      unit = units%of_parameter(k)
      if (unit == '') unit = 'no unit'
      if (parameters(k)%name == 'offset') unit = of_record
   end function si_unit

   !> Returns the values that a key allows: its range and its words.
   function allowed(key) result(text)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text
      type(range_t) :: range

      if (allocated(key%choices)) then
         text = listed(key%choices, ', ')
         if (key%kind == kind_text) text = ''''//listed(key%choices, ''', ''')//''''
         return
      end if
      range = key%range
      if (key%kind == kind_integer .and. range%high >= huge(1)) range%high = huge(range%high)
      text = range%limits()
      if (text == '') text = 'any'
      if (key%kind == kind_text) text = 'see meaning'
      if (key%infinite) text = text//', or inf'
      if (allocated(key%words)) text = text//', or '''//listed(key%words, ''', ''')//''''
   end function allowed

   !> Returns the default of a key, or when it is required.
   function default_of(key) result(text)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text

      text = 'none'
      if (key%default /= '') text = key%default
      if (key%required) text = 'required'
   end function default_of

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
