!> Conversion of numbers to text, and of text to lower case; lists of texts.
module beamid_strings
   use beamid_exact_products, only: multiply_exactly
   use beamid_kinds, only: wp, ip
   implicit none
   private

   public :: string_t, append_string, lower, to_text, full, put_full, fixed, rounded

   !> Largest length of a number with full precision.
   integer, parameter, public :: full_length = 32

   !> An element of a list of texts of different lengths.
   type :: string_t
      character(len=:), allocatable :: text
   end type string_t

   ! The results of all functions here have explicit lengths, because gfortran keeps the length of a
   ! deferred-length result in static memory, which threads share.

   !> Returns a number as short as possible: `0.04`, `1.5E+09`, `12`.
   interface to_text
      module procedure :: integer_to_text
      module procedure :: long_to_text
      module procedure :: real_to_text
   end interface to_text

contains

   !> Appends a text to a list. (An array constructor does not work for texts of different lengths.)
   pure subroutine append_string(list, text)
      type(string_t), allocatable, intent(inout) :: list(:)
      character(len=*), intent(in) :: text
      type(string_t), allocatable :: longer(:)

      if (.not. allocated(list)) allocate (list(0))
      allocate (longer(size(list) + 1))
      longer(:size(list)) = list
      longer(size(longer))%text = text
      call move_alloc(longer, list)
   end subroutine append_string

   !> Returns text with its ASCII letters in lower case.
   pure function lower(text)
      character(len=*), intent(in) :: text
      character(len=len(text)) :: lower
      integer :: k

      lower = text
      do k = 1, len(text)
         if (text(k:k) >= 'A' .and. text(k:k) <= 'Z') lower(k:k) = achar(iachar(text(k:k)) + 32)
      end do
   end function lower

   !> Returns the number of characters that an integer takes.
   pure integer function digits_of(value)
      integer(ip), intent(in) :: value
      integer(ip) :: rest

      digits_of = merge(2, 1, value < 0)
      rest = value/10
      do while (rest /= 0)
         rest = rest/10
         digits_of = digits_of + 1
      end do
   end function digits_of

   !> Returns the value, with 0 in place of -0.
   elemental real(wp) function unsigned_zero(value)
      real(wp), intent(in) :: value

      unsigned_zero = value
      if (abs(value) <= 0) unsigned_zero = 0
   end function unsigned_zero

   !> Returns a number with at most six significant digits as short as possible, with an exponent if
   !> it is below 1e-4 or from 1e6 on.
   pure function short_form(value) result(text)
      real(wp), intent(in) :: value
      character(len=40) :: text
      character(len=40) :: form
      integer :: exponent, mark

      write (text, '(es13.5e3)') unsigned_zero(value)
      text = adjustl(text)
      mark = index(text, 'E')
      if (value > huge(value)) text = 'inf'
      if (mark == 0) return
      read (text(mark + 1:), *) exponent
      if (exponent >= -4 .and. exponent < 6) then
         write (form, '(a,i0,a)') '(f40.', 5 - exponent, ')'
         write (text, form) unsigned_zero(value)
         text = text(verify(text, ' '):shortest(text, len(text)))
      else
         ! The exponent has three digits only if two are not enough.
         text = text(:shortest(text, mark - 1))//text(mark:mark + 1)// &
            text(mark + merge(3, 2, abs(exponent) < 100):)
      end if
   end function short_form

   !> Returns the length of a decimal number without trailing zeros, and without a trailing point.
   pure integer function shortest(text, last)
      character(len=*), intent(in) :: text
      integer, intent(in) :: last

      shortest = verify(text(:last), '0', back=.true.)
      shortest = verify(text(:shortest), '.', back=.true.)
   end function shortest

   !> Returns an integer as text.
   pure function integer_to_text(value) result(text)
      integer, intent(in) :: value
      character(len=digits_of(int(value, ip))) :: text

      text = long_to_text(int(value, ip))
   end function integer_to_text

   !> Returns a 64-bit integer as text.
   pure function long_to_text(value) result(text)
      integer(ip), intent(in) :: value
      character(len=digits_of(value)) :: text
      integer(ip) :: rest
      integer :: k

      text(1:1) = '-'
      rest = value
      do k = len(text), merge(2, 1, value < 0), -1
         text(k:k) = achar(iachar('0') + int(abs(mod(rest, 10_ip))))
         rest = rest/10
      end do
   end function long_to_text

   !> Returns a real number as text, in the form of `short_form`.
   pure function real_to_text(value) result(text)
      real(wp), intent(in) :: value
      character(len=len_trim(short_form(value))) :: text

      text = short_form(value)
   end function real_to_text

   !> Returns the number that is nearest to `value` among those with `digits` significant digits.
   pure real(wp) function nearest_decimal(value, digits) result(near)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      character(len=40) :: buffer, form

      near = value
      if (.not. abs(value) <= huge(value)) return
      write (form, '(a,i0,a)') '(es30.', digits - 1, 'e3)'
      write (buffer, form) value
      read (buffer, *) near
   end function nearest_decimal

   !> Returns a number rounded to at most `digits` significant digits, as short as possible.
   pure function rounded(value, digits) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      character(len=len_trim(short_form(nearest_decimal(value, digits)))) :: text

      text = short_form(nearest_decimal(value, digits))
   end function rounded

   !> Returns the number of characters of a number with full precision.
   pure integer function length_of(value) result(length)
      real(wp), intent(in) :: value
      character(len=full_length) :: buffer

      call put_full(value, buffer, length)
   end function length_of

   !> Returns a number with full precision: its text reads back as the same number.
   pure function full(value) result(text)
      real(wp), intent(in) :: value
      character(len=length_of(value)) :: text
      character(len=full_length) :: buffer
      integer :: length

      call put_full(value, buffer, length)
      text = buffer(:length)
   end function full

   !> Writes a number with full precision, as `full`, into a text.
   !>
   !> text    its first characters are set
   !> length  number of characters that are set
   pure subroutine put_full(value, text, length)
      real(wp), intent(in) :: value
      character(len=full_length), intent(out) :: text
      integer, intent(out) :: length
      integer(ip), parameter :: ten_8 = 10_ip**8, ten_16 = 10_ip**16
      integer :: i
      character(len=2), parameter :: two_digits(0:99) = [(achar(iachar('0') + i/10)// &
         achar(iachar('0') + mod(i, 10)), i=0, 99)]
      integer(ip) :: number
      integer :: at, eight(2), exponent, first, k

      call split_decimal(abs(value), number, exponent)
      if (number == 0) then
         write (text, '(es24.16e3)') unsigned_zero(value)
         text = adjustl(text)
         length = len_trim(text)
         return
      end if
      length = merge(24, 23, value < 0)
      if (value < 0) text(1:1) = '-'
      first = int(number/ten_16)
      number = number - first*ten_16
      ! The divisions of short integers are faster.
      eight(1) = int(number/ten_8)
      eight(2) = int(mod(number, ten_8))
      do k = 2, 1, -1
         do at = length - 22 + 8*k, length - 28 + 8*k, -2
            text(at:at + 1) = two_digits(mod(eight(k), 100))
            eight(k) = eight(k)/100
         end do
      end do
      text(length - 22:length - 21) = achar(iachar('0') + first)//'.'
      text(length - 4:length - 3) = merge('E-', 'E+', exponent < 0)
      exponent = abs(exponent)
      text(length - 2:length) = achar(iachar('0') + exponent/100)//achar(iachar('0') &
         + mod(exponent/10, 10))//achar(iachar('0') + mod(exponent, 10))
   end subroutine put_full

   !> Rounds a number to 17 significant digits, number 10**(exponent - 16). The product with a power
   !> of ten is computed in twice the precision.
   !>
   !> value   >= 0
   !> number  0: the number is outside the range of this method, or too near to the middle between
   !>         two numbers of 17 digits
   pure subroutine split_decimal(value, number, exponent)
      real(wp), intent(in) :: value
      integer(ip), intent(out) :: number
      integer, intent(out) :: exponent
      integer(ip), parameter :: ten_16 = 10_ip**16
      integer :: k
      ! These powers of ten have no round-off.
      real(wp), parameter :: ten(0:22) = [(10.0_wp**k, k=0, 22)]
      real(wp) :: below, high, low, more

      number = 0
      exponent = 0
      if (.not. (value > 1e-25_wp .and. value < 1e16_wp)) return
      exponent = floor(log10(value))
      k = 16 - exponent
      call multiply_exactly(value, ten(min(k, 22)), high, low)
      if (k > 22) then
         call multiply_exactly(high, ten(k - 22), more, below)
         below = below + low*ten(k - 22)
         high = more + below
         low = below - (high - more)
      end if
      if (high < 1e16_wp .or. high >= 1e17_wp) return
      below = floor(low)
      low = low - below
      if (abs(low - 0.5_wp) < 1e-6_wp) return
      number = int(high, ip) + int(below, ip)
      if (number >= ten_16) then
         if (low > 0.5_wp) number = number + 1
         if (number < 10*ten_16) return
      end if
      number = 0
   end subroutine split_decimal

   !> Returns a number with `digits` decimals, right-adjusted in `width` characters.
   pure function fixed(value, width, digits) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: width, digits
      character(len=width) :: text
      character(len=16) :: form

      write (form, '(a,i0,a,i0,a)') '(f', width, '.', digits, ')'
      write (text, form) value
      ! A number that is rounded to zero has no sign.
      if (verify(text, ' -.0') == 0) write (text, form) 0.0_wp
   end function fixed

end module beamid_strings
