!> Conversion of numbers to text, and of text to lower case; lists of texts.
module beamid_strings
   use beamid_kinds, only: wp, ip
   implicit none
   private

   public :: string_t, append_string, lower, to_text, full, fixed, rounded

   !> An element of a list of texts of different lengths.
   type :: string_t
      character(len=:), allocatable :: text
   end type string_t

   !> Returns a number as short as possible: `0.04`, `1.5E+09`, `12`. The results have explicit
   !> lengths, because gfortran keeps the length of a deferred-length result in static memory, which
   !> threads share.
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
      character(len=24) :: buffer

      write (buffer, '(i0)') value
      digits_of = len_trim(buffer)
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

      write (text, '(i0)') value
   end function integer_to_text

   !> Returns a 64-bit integer as text.
   pure function long_to_text(value) result(text)
      integer(ip), intent(in) :: value
      character(len=digits_of(value)) :: text

      write (text, '(i0)') value
   end function long_to_text

   !> Returns a real number as text, in the form of `short_form`.
   pure function real_to_text(value) result(text)
      real(wp), intent(in) :: value
      character(len=len_trim(short_form(value))) :: text

      text = short_form(value)
   end function real_to_text

   !> Returns a number rounded to at most `digits` significant digits, as short as possible.
   pure function rounded(value, digits) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      character(len=:), allocatable :: text
      character(len=40) :: buffer, form
      real(wp) :: near

      text = to_text(value)
      if (abs(value) > huge(value)) return
      write (form, '(a,i0,a)') '(es30.', digits - 1, 'e3)'
      write (buffer, form) value
      read (buffer, *) near
      text = to_text(near)
   end function rounded

   !> Returns a number with full precision: its text reads back as the same number.
   pure function full(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text
      character(len=32) :: buffer

      write (buffer, '(es24.16e3)') unsigned_zero(value)
      text = trim(adjustl(buffer))
   end function full

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
