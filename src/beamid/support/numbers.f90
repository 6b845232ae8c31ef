!> Strict reading of one number, and quotation of a user's text in messages.
!>
!> gfortran's list-directed `read` accepts "1/2", "2*3" and "nan" as numbers. The characters are
!> therefore checked here before the C library converts them. Short numbers, of which records
!> consist, are converted here, with the same result to the last bit.
module beamid_numbers
   use, intrinsic :: ieee_exceptions, only: ieee_get_status, ieee_overflow, &
      ieee_set_halting_mode, ieee_set_status, ieee_status_type, ieee_underflow
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_null_char, c_null_ptr, c_ptr
   use beamid_kinds, only: wp, ip
   implicit none
   private

   public :: parse_number, is_decimal, with_point, trim_blanks, shown, shortened

   character(len=*), parameter :: blanks = ' '//achar(9)

   interface
      real(c_double) function c_strtod(text, rest) bind(c, name='strtod')
         import :: c_char, c_double, c_ptr
         character(kind=c_char), intent(in) :: text(*)
         type(c_ptr), value :: rest
      end function c_strtod
   end interface

contains

   !> Reads one decimal number: blanks, sign, digits, point, exponent by e, E, d or D, blanks.
   subroutine parse_number(token, value, ok)
      character(len=*), intent(in) :: token
      !> The number; 0 if there is none.
      real(wp), intent(out) :: value
      !> Whether the token is a finite number.
      logical, intent(out) :: ok
      character(len=:), allocatable :: text
      integer :: letter

      call parse_short(token, value, ok)
      if (ok) return
      text = trim_blanks(token)
      ok = is_decimal(text)
      if (.not. ok) return
      letter = scan(text, 'dD')
      if (letter > 0) text(letter:letter) = 'e'
      value = convert(text//c_null_char)
      ok = abs(value) <= huge(value)
      if (.not. ok) value = 0
   end subroutine parse_number

   !> Reads a number of up to 18 digits and a moderate exponent, if it is certain which double is
   !> nearest. `ok` is .false. for all other numbers, and for text that is no number.
   pure subroutine parse_short(token, value, ok)
      character(len=*), intent(in) :: token
      !> The number; 0 if `ok` is .false.
      real(wp), intent(out) :: value
      logical, intent(out) :: ok
      integer(ip), parameter :: largest = (huge(1_ip) - 9)/10
      integer(ip) :: mantissa
      integer :: at, last, digit, n_digits, power
      logical :: negative, after_point

      value = 0
      ok = .false.
      at = verify(token, blanks)
      last = verify(token, blanks, back=.true.)
      if (at == 0) return
      negative = token(at:at) == '-'
      if (negative .or. token(at:at) == '+') at = at + 1

      mantissa = 0
      n_digits = 0
      power = 0
      after_point = .false.
      do at = at, last
         digit = iachar(token(at:at)) - 48
         if (digit >= 0 .and. digit <= 9) then
            if (mantissa > largest) return
            mantissa = 10*mantissa + digit
            n_digits = n_digits + 1
            if (after_point) power = power - 1
         else if (token(at:at) == '.' .and. .not. after_point) then
            after_point = .true.
         else
            exit
         end if
      end do
      if (n_digits == 0) return
      ok = at > last
      if (.not. ok) call add_exponent(token(at:last), power, ok)
      if (ok) call scale_exactly(mantissa, power, value, ok)
      if (negative) value = -value
   end subroutine parse_short

   !> Adds the exponent in 'e+12' to a power of ten; `ok` is .false. unless it has 1 to 3 digits.
   pure subroutine add_exponent(text, power, ok)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: power
      logical, intent(out) :: ok
      integer :: at, first, exponent

      first = 2
      call skip_sign(text, first)
      ok = scan(text(1:1), 'eEdD') > 0 .and. first <= len(text) .and. len(text) - first <= 2 &
         .and. verify(text(first:), '0123456789') == 0
      if (.not. ok) return
      exponent = 0
      do at = first, len(text)
         exponent = 10*exponent + iachar(text(at:at)) - 48
      end do
      if (text(first - 1:first - 1) == '-') exponent = -exponent
      power = power + exponent
   end subroutine add_exponent

   !> Returns mantissa*10**power, rounded to the nearest double. An integer below 2**53 with an
   !> exact power of ten needs one rounding only (Clinger, 1990). Other numbers are computed with 64
   !> bits or more, if the compiler has them, and accepted if all numbers within the error bound
   !> round to the same double.
   pure subroutine scale_exactly(mantissa, power, value, ok)
      integer(ip), intent(in) :: mantissa
      integer, intent(in) :: power
      !> The number; 0 if it is not certain.
      real(wp), intent(out) :: value
      logical, intent(out) :: ok
      integer, parameter :: long = max(wp, selected_real_kind(18)), most = 22, most_long = 27
      integer :: k
      real(wp), parameter :: ten(0:most) = [(10.0_wp**k, k=0, most)]
      real(long), parameter :: long_ten(0:most_long) = [(10.0_long**k, k=0, most_long)]
      real(long) :: product, error

      value = 0
      ok = mantissa <= 2_ip**53 .and. abs(power) <= most
      if (ok) then
         value = real(mantissa, wp)
         if (power < 0) value = value/ten(-power)
         if (power > 0) value = value*ten(power)
      else if (abs(power) <= most_long .and. digits(product) >= 64) then
         product = real(mantissa, long)
         if (power < 0) product = product/long_ten(-power)
         if (power > 0) product = product*long_ten(power)
         error = product*epsilon(product)
         ok = real(product - error, wp) >= real(product + error, wp)
         if (ok) value = real(product, wp)
      end if
   end subroutine scale_exactly

   !> Converts text to a number; an overflow or underflow does not halt the program.
   real(wp) function convert(c_text) result(value)
      !> The characters, followed by a null character.
      character(len=*), intent(in) :: c_text
      type(ieee_status_type) :: before

      call ieee_get_status(before)
      call ieee_set_halting_mode([ieee_overflow, ieee_underflow], .false.)
      value = c_strtod(c_text, c_null_ptr)
      call ieee_set_status(before)
   end function convert

   !> Returns whether a text is exactly one decimal number: [sign] digits [. digits] [exponent].
   pure logical function is_decimal(text) result(yes)
      character(len=*), intent(in) :: text
      integer :: next, digits, more

      next = 1
      call skip_sign(text, next)
      call skip_digits(text, next, digits)
      if (next <= len(text)) then
         if (text(next:next) == '.') then
            next = next + 1
            call skip_digits(text, next, more)
            digits = digits + more
         end if
      end if
      yes = digits > 0
      if (next > len(text) .or. .not. yes) return
      yes = scan(text(next:next), 'eEdD') > 0
      next = next + 1
      call skip_sign(text, next)
      call skip_digits(text, next, digits)
      yes = yes .and. digits > 0 .and. next > len(text)
   end function is_decimal

   !> Returns a text with its first comma replaced by a point.
   pure function with_point(text) result(changed)
      character(len=*), intent(in) :: text
      character(len=len(text)) :: changed
      integer :: comma

      changed = text
      comma = index(text, ',')
      if (comma > 0) changed(comma:comma) = '.'
   end function with_point

   !> Moves a position past a sign, if there is one.
   pure subroutine skip_sign(text, next)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: next

      if (next > len(text)) return
      if (scan(text(next:next), '+-') > 0) next = next + 1
   end subroutine skip_sign

   !> Moves a position past a sequence of digits, and counts them.
   pure subroutine skip_digits(text, next, n_digits)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: next
      integer, intent(out) :: n_digits

      n_digits = verify(text(next:), '0123456789') - 1
      if (n_digits < 0) n_digits = len(text) - next + 1
      next = next + n_digits
   end subroutine skip_digits

   !> Returns a text without the blanks and tabs around it.
   pure function trim_blanks(text) result(trimmed)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: trimmed

      trimmed = text(max(verify(text, blanks), 1):verify(text, blanks, back=.true.))
   end function trim_blanks

   !> Returns a text in quotes for a message.
   pure function shown(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: shown

      shown = "'"//shortened(text)//"'"
   end function shown

   !> Returns a text for a message: at most 40 characters, without control characters.
   pure function shortened(text) result(short)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: short
      integer :: i, n

      short = trim_blanks(text)
      n = len(short)
      if (n > 40) then
         n = 37
         ! Do not cut inside a UTF-8 character, whose later bytes are 10xxxxxx.
         do while (n > 1 .and. iand(iachar(short(n + 1:n + 1)), 192) == 128)
            n = n - 1
         end do
         short = short(:n)//'...'
      end if
      do i = 1, len(short)
         if (iachar(short(i:i)) < 32 .or. iachar(short(i:i)) == 127) short(i:i) = '?'
      end do
   end function shortened

end module beamid_numbers
