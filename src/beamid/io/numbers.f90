!> The strict reading of one number, and what is quoted of a user's text in messages.
!>
!> gfortran's list-directed `read` takes "1/2", "2*3" and "nan" for good numbers, so the characters
!> are checked here before the C library converts them.
module beamid_numbers
   use, intrinsic :: ieee_exceptions, only: ieee_get_status, ieee_overflow, &
      ieee_set_halting_mode, ieee_set_status, ieee_status_type, ieee_underflow
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_null_char, c_null_ptr, c_ptr
   use beamid_kinds, only: wp
   implicit none
   private

   public :: parse_number, is_decimal, trim_blanks, shown, shortened

   character(len=*), parameter :: blanks = ' '//achar(9)

   interface
      real(c_double) function c_strtod(text, rest) bind(c, name='strtod')
         import :: c_char, c_double, c_ptr
         character(kind=c_char), intent(in) :: text(*)
         type(c_ptr), value :: rest
      end function c_strtod
   end interface

contains

   !> Reads one decimal number: blanks around, sign, digits, point, exponent by e, E, d or D.
   subroutine parse_number(token, value, ok)
      character(len=*), intent(in) :: token
      !> The number; 0 when there is none.
      real(wp), intent(out) :: value
      !> Whether the token is a number and finite.
      logical, intent(out) :: ok
      character(len=:), allocatable :: text
      integer :: letter

      value = 0
      text = trim_blanks(token)
      ok = is_decimal(text)
      if (.not. ok) return
      letter = scan(text, 'dD')
      if (letter > 0) text(letter:letter) = 'e'
      value = convert(text//c_null_char)
      ok = abs(value) <= huge(value)
      if (.not. ok) value = 0
   end subroutine parse_number

   !> The number in a text; that it may over- or underflow is no cause to halt.
   real(wp) function convert(c_text) result(value)
      !> The characters, ending in a null character.
      character(len=*), intent(in) :: c_text
      type(ieee_status_type) :: before

      call ieee_get_status(before)
      call ieee_set_halting_mode([ieee_overflow, ieee_underflow], .false.)
      value = c_strtod(c_text, c_null_ptr)
      call ieee_set_status(before)
   end function convert

   !> Whether a text is a decimal number and nothing else: [sign] digits [. digits] [exponent].
   pure logical function is_decimal(text) result(yes)
      character(len=*), intent(in) :: text
      integer :: next, digits, more

      next = 1
      call pass_sign(text, next)
      call pass_digits(text, next, digits)
      if (next <= len(text)) then
         if (text(next:next) == '.') then
            next = next + 1
            call pass_digits(text, next, more)
            digits = digits + more
         end if
      end if
      yes = digits > 0
      if (next > len(text) .or. .not. yes) return
      yes = scan(text(next:next), 'eEdD') > 0
      next = next + 1
      call pass_sign(text, next)
      call pass_digits(text, next, digits)
      yes = yes .and. digits > 0 .and. next > len(text)
   end function is_decimal

   !> Moves `next` past a sign.
   pure subroutine pass_sign(text, next)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: next

      if (next > len(text)) return
      if (scan(text(next:next), '+-') > 0) next = next + 1
   end subroutine pass_sign

   !> Moves `next` past digits, `passed` of them.
   pure subroutine pass_digits(text, next, passed)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: next
      integer, intent(out) :: passed

      passed = verify(text(next:), '0123456789') - 1
      if (passed < 0) passed = len(text) - next + 1
      next = next + passed
   end subroutine pass_digits

   !> A text without the blanks and tabs around it.
   pure function trim_blanks(text) result(trimmed)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: trimmed

      trimmed = text(max(verify(text, blanks), 1):verify(text, blanks, back=.true.))
   end function trim_blanks

   !> A text in quotes for a message.
   pure function shown(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: shown

      shown = "'"//shortened(text)//"'"
   end function shown

   !> A text for a message: at most 40 characters, none of them a control character.
   pure function shortened(text) result(short)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: short
      integer :: i, n

      short = trim_blanks(text)
      n = len(short)
      if (n > 40) then
         n = 37
         ! Never cut inside a UTF-8 character: its later bytes are 10xxxxxx.
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
