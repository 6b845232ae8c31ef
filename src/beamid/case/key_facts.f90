!> What there is to say about a key of a case file or a parameter of a fit, in words: unit, allowed
!> values, default and an example. The words come from the keys that the readers of the groups
!> register, from the table of parameters and from `key_examples`.
module beamid_key_facts
   use beamid_key_examples, only: example_row, key_examples, names_for_fit, names_for_prior, &
      names_without_fields
   use beamid_parameters, only: amplitude, any_value, key_of, not_negative, offset, on_beam, &
      parameters, share
   use beamid_structure, only: is_coefficient
   use beamid_units, only: units_t
   use beamid_values, only: key_t, kind_integer, kind_real, kind_text, listed, one_of, range_t
   implicit none
   private

   public :: unit_of, allowed_of, default_of, example_of, is_listed, parameter_unit, &
      parameter_range, parameter_example

contains

   !> Returns the unit of a key: a dimension, with its unit for metres, newtons, seconds and
   !> kilograms in parentheses; 'none' for integers, texts and numbers without a unit.
   !>
   !> group  name of the key's group
   function unit_of(group, key) result(unit)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: unit
      integer :: k, row

      unit = 'none'
      if (key%kind /= kind_real) return
      row = example_row(group, trim(key%name))
      if (row > 0) then
         if (key_examples(row)%unit /= '') unit = with_si(trim(key_examples(row)%unit))
      end if
      if (unit /= 'none') return
      do k = 1, size(parameters)
         if (key_of(k) /= key%name) cycle
         ! &beam has short forms of keys of &end.
         if (parameters(k)%group /= group .and. .not. (group == 'beam' .and. &
            parameters(k)%group == 'end')) cycle
         unit = parameter_unit(k)
         return
      end do
   end function unit_of

   !> Returns the unit of parameter k in the same form as `unit_of`.
   function parameter_unit(k) result(unit)
      integer, intent(in) :: k
      character(len=:), allocatable :: unit
      type(units_t) :: dimensions

      dimensions = units_t(length='length', force='force', time='time', mass='mass')
      unit = dimensions%of_parameter(k)
      if (unit == '') unit = 'none'
      if (unit == 'length/time^2') unit = 'acceleration'
      if (k == offset) unit = 'unit of the record'
      if (k == amplitude) unit = 'unit of the force or the displacement, or none for a factor'
      unit = with_si(unit)
   end function parameter_unit

   !> Returns a dimension, and in parentheses the unit that it has with m, N, s and kg. A text that
   !> refers to another unit is returned unchanged.
   pure function with_si(dimension) result(text)
      character(len=*), intent(in) :: dimension
      character(len=:), allocatable :: text
      character(len=*), parameter :: words(*) = [character(len=12) :: 'acceleration', 'length', &
         'force', 'time', 'mass'], units(*) = [character(len=5) :: 'm/s^2', 'm', 'N', 's', 'kg']
      integer :: first, k

      text = dimension
      if (dimension == 'none' .or. index(dimension, 'unit') > 0) return
      do k = 1, size(words)
         first = index(text, trim(words(k)))
         if (first > 0) text = text(:first - 1)//trim(units(k))//text(first + len_trim(words(k)):)
      end do
      text = dimension//' ('//text//')'
   end function with_si

   !> Returns the values that a key allows: their kind with the range, or all words.
   !>
   !> group  name of the key's group
   function allowed_of(group, key) result(text)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text, named
      integer :: row

      if (allocated(key%choices)) then
         text = one_of(key%choices, trim(merge('''', ' ', key%kind == kind_text)))
         return
      end if
      named = ''
      row = example_row(group, trim(key%name))
      if (row > 0) named = trim(key_examples(row)%allowed)
      select case (named)
      case (names_for_fit); text = parameter_names(.true.)//' E(x) c_D(x)'
      case (names_without_fields); text = parameter_names(.false.)
      case (names_for_prior); text = parameter_names(.false.)//' I height density'
      case default; text = named
      end select
      if (text /= '') return
      text = 'any text'
      if (key%is_file) text = 'path, relative to the case file'
      if (key%kind /= kind_text) text = range_in_words(key, key_range(group, key))
   end function allowed_of

   !> Returns the names of the parameters that a fit may estimate.
   !>
   !> with_offset  whether the offset is among them
   function parameter_names(with_offset) result(names)
      logical, intent(in) :: with_offset
      character(len=:), allocatable :: names
      integer :: k

      names = ''
      do k = 1, size(parameters)
         if (.not. is_listed(k) .or. is_coefficient(k)) cycle
         if (k == offset .and. .not. with_offset) cycle
         if (names /= '') names = names//' '
         names = names//trim(parameters(k)%name)
      end do
   end function parameter_names

   !> Returns whether parameter k is in lists of parameters: a fit may estimate it, and it does not
   !> belong to a second sensor, support or coefficient.
   elemental logical function is_listed(k)
      integer, intent(in) :: k

      is_listed = parameters(k)%is_free .and. parameters(k)%item <= 1
   end function is_listed

   !> Returns the range of a key of numbers in words, or '' if it allows every number. The upper
   !> limits of positions and shares, which readers of groups cannot check, are included.
   function key_range(group, key) result(text)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text
      type(range_t) :: range
      integer :: k

      range = key%range
      if (key%kind == kind_integer .and. range%high >= huge(1)) range%high = huge(range%high)
      text = range%limits()
      do k = 1, size(parameters)
         if (parameters(k)%group == group .and. key_of(k) == key%name .and. &
            any(parameters(k)%range == [on_beam, share])) text = parameter_range(k)
      end do
   end function key_range

   !> Returns the kind of the values of a key with their range, and the words that may replace them.
   function range_in_words(key, range) result(text)
      type(key_t), intent(in) :: key
      character(len=*), intent(in) :: range
      character(len=:), allocatable :: text

      text = key%kind_in_words()
      if (range /= '') then
         text = text//' '//range
      else if (key%most == 1) then
         text = 'any '//text
      end if
      if (key%infinite) text = text//', or inf'
      if (.not. allocated(key%words)) return
      if (size(key%words) == 1) text = text//', or '''//trim(key%words(1))//''''
      if (size(key%words) > 1) text = text//', or '''//listed(key%words, ''' or ''')//''''
   end function range_in_words

   !> Returns the range of parameter k in words; '' if it may have any value.
   pure function parameter_range(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text

      select case (parameters(k)%range)
      case (any_value); text = ''
      case (not_negative); text = '0 or more'
      case (on_beam); text = 'above 0, up to the length'
      case (share); text = 'from 0 to below 1'
      case default; text = 'above 0'
      end select
   end function parameter_range

   !> Returns the default of a key, or 'required', or the condition under which it is required.
   function default_of(key) result(text)
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: text

      text = 'none'
      if (key%default /= '') text = key%default
      if (key%required) text = 'required'
   end function default_of

   !> Returns a line of a case file that shows a key; '' if the table of examples lacks the key.
   !>
   !> group  name of the key's group
   pure function example_of(group, key) result(line)
      character(len=*), intent(in) :: group
      type(key_t), intent(in) :: key
      character(len=:), allocatable :: line
      integer :: row

      line = ''
      row = example_row(group, trim(key%name))
      if (row > 0) line = '&'//group//' '//trim(key_examples(row)%example)//' /'
   end function example_of

   !> Returns a line of a case file that lets a fit estimate parameter k.
   pure function parameter_example(k) result(line)
      integer, intent(in) :: k
      character(len=:), allocatable :: line

      line = '&stage free='''//trim(parameters(k)%name)//''' /'
      if (is_coefficient(k)) line = '&stage free='''//trim(parameters(k)%group)//''' /'
      ! The short form of &beam has k_R and c_R alone.
      if (any(parameters(k)%name == ['k_w', 'c_w'])) line = '&stage free='''// &
         trim(parameters(k)%name)//'.tip'' /'
   end function parameter_example

end module beamid_key_facts
