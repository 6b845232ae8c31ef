!> Recognises the unit in the name of a column: "Acceleration z (m/s^2)", "t [ms]", "a / g",
!> "acceleration_g".
module beamid_column_units
   use beamid_kinds, only: wp
   use beamid_numbers, only: trim_blanks
   use beamid_strings, only: lower
   implicit none
   private

   public :: column_unit_t, unit_of_column, bare_name, are_units, without_brackets, length_in_m, &
      time_in_s
   public :: no_unit, unit_of_time, unit_of_acceleration, unit_of_raw_values, other_unit

   !> Kinds of units; raw values are the volts or counts of a sensor.
   integer, parameter :: no_unit = 0, unit_of_time = 1, unit_of_acceleration = 2, &
      unit_of_raw_values = 3, other_unit = 4

   !> The unit of a column.
   type :: column_unit_t
      integer :: kind = no_unit          !< one of the kinds above
      character(len=24) :: text = ''     !< as in the name of the column
      real(wp) :: factor = 1             !< its value in s or in m/s^2, for times and accelerations
      logical :: is_multiple_of_g = .false.
   end type column_unit_t

   real(wp), parameter :: g = 9.80665_wp

contains

   !> Returns the unit in the name of a column, or a unit of the kind `no_unit`.
   pure type(column_unit_t) function unit_of_column(name) result(unit)
      character(len=*), intent(in) :: name
      integer :: first, last, bare

      call find_unit(name, bare, first, last)
      if (last >= first) unit = unit_of(name(first:last))
   end function unit_of_column

   !> Returns the name of a column without its unit.
   pure function bare_name(name) result(bare)
      character(len=*), intent(in) :: name
      character(len=len(name)) :: bare
      integer :: first, last, length

      call find_unit(name, length, first, last)
      bare = name(:length)
   end function bare_name

   !> Returns whether the fields of a line are units and nothing else, with or without brackets, and
   !> at least one of them is one of time or acceleration, or volts.
   pure logical function are_units(fields) result(yes)
      character(len=*), intent(in) :: fields(:)
      character(len=*), parameter :: weak = ' - 1 none n k c a e f % '
      type(column_unit_t) :: unit
      integer :: k
      logical :: is_sure

      yes = .true.
      is_sure = .false.
      do k = 1, size(fields)
         if (fields(k) == '') cycle
         unit = unit_of(without_brackets(fields(k)))
         is_sure = is_sure .or. any(unit%kind == [unit_of_time, unit_of_acceleration, &
            unit_of_raw_values])
         yes = yes .and. (unit%kind /= no_unit .or. index(weak, ' '// &
            trim(canonical(without_brackets(fields(k))))//' ') > 0)
      end do
      yes = yes .and. is_sure
   end function are_units

   !> Returns a text without blanks and one pair of brackets around it.
   pure function without_brackets(text) result(inner)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: inner
      integer :: n

      inner = trim_blanks(text)
      n = len(inner)
      if (n < 3) return
      if (inner(1:1) == '(' .and. inner(n:n) == ')' .or. &
         inner(1:1) == '[' .and. inner(n:n) == ']') inner = inner(2:n - 1)
   end function without_brackets

   !> Finds the unit in a name: in brackets at its end, behind a slash between blanks, or, if the
   !> unit is known, behind the last underscore.
   !>
   !> bare         length of the name without its unit
   !> first, last  positions of the unit's first and last character; last < first: no unit
   pure subroutine find_unit(name, bare, first, last)
      character(len=*), intent(in) :: name
      integer, intent(out) :: bare, first, last
      character(len=*), parameter :: no_separate_word(9) = [character(len=9) :: 'with', 'without', &
         'incl', 'including', 'no', 'minus', 'plus', 'and', 'of']
      character(len=:), allocatable :: word
      type(column_unit_t) :: unit
      integer :: at

      bare = len_trim(name)
      first = bare + 1
      last = bare
      if (bare < 3) return
      at = 0
      if (name(bare:bare) == ']') at = index(name, '[', back=.true.)
      if (name(bare:bare) == ')') at = opening(name(:bare))
      if (at > 1) then
         first = at + 1
         last = bare - 1
      else if (index(name, ' / ') > 1) then
         at = index(name, ' / ')
         first = at + 3
      else
         at = index(name, '_', back=.true.)
         if (at < 2 .or. at >= bare) return
         unit = unit_of(name(at + 1:bare))
         word = lower(name(scan(name(:at - 1), '_ ', back=.true.) + 1:at - 1))
         if (unit%kind == no_unit .or. unit%kind == other_unit .or. &
            any(no_separate_word == word)) return
         first = at + 1
      end if
      bare = len_trim(name(:at - 1))
      ! 'a / (m/s^2)'
      if (bare > 2) then
         if (name(bare - 1:bare) == ' /') bare = len_trim(name(:bare - 1))
      end if
   end subroutine find_unit

   !> Returns the position of the bracket that the last character of a name closes; 0: none.
   pure integer function opening(name) result(at)
      character(len=*), intent(in) :: name
      integer :: depth

      depth = 0
      do at = len(name), 1, -1
         if (name(at:at) == ')') depth = depth + 1
         if (name(at:at) == '(') depth = depth - 1
         if (depth == 0) exit
      end do
   end function opening

   !> Returns the unit that a text names.
   pure type(column_unit_t) function unit_of(text) result(unit)
      character(len=*), intent(in) :: text
      character(len=*), parameter :: raw = ' v mv uv volt volts count counts lsb adc digit '// &
         'digits raw pc mv/v ', &
         other = ' rad/s deg/s degc rad deg hz khz rpm pa kpa hpa mbar bar kn mn mt ut db lx % '// &
         'm mm cm um km in ft m/s mm/s cm/s km/h mph in/s ft/s rad/s2 deg/s2 '
      character(len=:), allocatable :: word

      word = trim(canonical(text))
      unit%text = trim_blanks(text)
      if (word == '') return
      unit%factor = time_in_s(word)
      if (unit%factor > 0) then
         unit%kind = unit_of_time
         return
      end if
      call find_acceleration(word, unit)
      if (unit%factor > 0) return
      unit%factor = 1
      if (index(raw, ' '//word//' ') > 0) unit%kind = unit_of_raw_values
      if (index(other, ' '//word//' ') > 0) unit%kind = other_unit
   end function unit_of

   !> Sets kind and factor of a unit of acceleration; the factor of other units is 0.
   !>
   !> word  unit in its canonical form
   pure subroutine find_acceleration(word, unit)
      character(len=*), intent(in) :: word
      type(column_unit_t), intent(inout) :: unit
      character(len=*), parameter :: per_square(8) = [character(len=8) :: '/s2', '/s/s', 's-2', &
         '.s-2', '/(s2)', '/ss', '/sec2', '/sec/sec']
      integer :: k, n

      unit%factor = 0
      select case (word)
      case ('g', 'gn', 'g0', 'gee')
         unit%factor = g
      case ('mg')
         unit%factor = 1e-3_wp*g
      case ('ug')
         unit%factor = 1e-6_wp*g
      case ('gal')
         unit%factor = 1e-2_wp
      case ('mgal')
         unit%factor = 1e-5_wp
      end select
      unit%is_multiple_of_g = unit%factor > 0 .and. index(word, 'gal') == 0
      do k = 1, size(per_square)
         n = len(word) - len_trim(per_square(k))
         if (n < 1) cycle
         if (word(n + 1:) == per_square(k)) unit%factor = max(unit%factor, length_in_m(word(:n)))
      end do
      if (unit%factor > 0) unit%kind = unit_of_acceleration
   end subroutine find_acceleration

   !> Returns a unit of length in m, or 0 if it is unknown.
   pure real(wp) function length_in_m(label)
      character(len=*), intent(in) :: label

      select case (trim(canonical(label)))
      case ('m', 'meter', 'metre')
         length_in_m = 1
      case ('dm')
         length_in_m = 1e-1_wp
      case ('cm')
         length_in_m = 1e-2_wp
      case ('mm')
         length_in_m = 1e-3_wp
      case ('um')
         length_in_m = 1e-6_wp
      case ('km')
         length_in_m = 1e3_wp
      case ('in', 'inch')
         length_in_m = 0.0254_wp
      case ('ft', 'foot', 'feet')
         length_in_m = 0.3048_wp
      case default
         length_in_m = 0
      end select
   end function length_in_m

   !> Returns a unit of time in s, or 0 if it is unknown.
   pure real(wp) function time_in_s(label)
      character(len=*), intent(in) :: label

      select case (trim(canonical(label)))
      case ('s', 'sec', 'secs', 'second', 'seconds', 'sekunden')
         time_in_s = 1
      case ('ms', 'msec', 'msecs', 'millisecond', 'milliseconds', 'millis')
         time_in_s = 1e-3_wp
      case ('us', 'usec', 'usecs', 'microsecond', 'microseconds', 'micros')
         time_in_s = 1e-6_wp
      case ('ns', 'nsec', 'nanosecond', 'nanoseconds')
         time_in_s = 1e-9_wp
      case ('min', 'mins', 'minute', 'minutes')
         time_in_s = 60
      case ('h', 'hr', 'hrs', 'hour', 'hours')
         time_in_s = 3600
      case ('d', 'day', 'days')
         time_in_s = 86400
      case default
         time_in_s = 0
      end select
   end function time_in_s

   !> Returns a unit in lower case and ASCII, without blanks and signs of powers and products: a
   !> superscript two (in UTF-8 or Latin-1) becomes '2', the Greek letter mu 'u', a degree 'deg'.
   pure function canonical(text) result(word)
      character(len=*), intent(in) :: text
      character(len=2*len(text) + 8) :: word
      integer :: at, n

      word = ''
      n = 0
      at = 1
      do while (at <= len_trim(text))
         select case (iachar(text(at:at)))
         case (194, 206, 226)
            ! The first byte of a character of two or three bytes in UTF-8.
            if (text(at:min(len(text), at + 2)) == char(226)//char(129)//char(187) .or. &
               text(at:min(len(text), at + 2)) == char(226)//char(136)//char(146)) then
               call append('-', word, n)
               at = at + 2
            else if (text(at:min(len(text), at + 1)) == char(206)//char(188)) then
               call append('u', word, n)
               at = at + 1
            end if
         case (178)
            call append('2', word, n)
         case (181)
            call append('u', word, n)
         case (176)
            call append('deg', word, n)
         case (32, 9, 42, 94, 183)     ! blank, tab, *, ^, dot of a product
            continue
         case default
            call append(lower(text(at:at)), word, n)
         end select
         at = at + 1
      end do
   end function canonical

   !> Appends a piece to a word of n characters.
   pure subroutine append(piece, word, n)
      character(len=*), intent(in) :: piece
      character(len=*), intent(inout) :: word
      integer, intent(inout) :: n

      word(n + 1:n + len(piece)) = piece
      n = n + len(piece)
   end subroutine append

end module beamid_column_units
