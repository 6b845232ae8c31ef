!> Numbers as text, and text in lower case.
module beamid_strings
   use beamid_kinds, only: wp, ip
   implicit none
   private

   public :: lower, to_text, full, fixed

   !> A number as short as it can be read: `0.04`, `1.5E+09`, `12`.
   interface to_text
      module procedure :: integer_to_text
      module procedure :: long_to_text
      module procedure :: real_to_text
   end interface to_text

contains

   !> ASCII letters in lower case.
   pure function lower(text)
      character(len=*), intent(in) :: text
      character(len=len(text)) :: lower
      integer :: k

      lower = text
      do k = 1, len(text)
         if (text(k:k) >= 'A' .and. text(k:k) <= 'Z') lower(k:k) = achar(iachar(text(k:k)) + 32)
      end do
   end function lower

   pure function integer_to_text(value) result(text)
      integer, intent(in) :: value
      character(len=:), allocatable :: text

      text = long_to_text(int(value, ip))
   end function integer_to_text

   pure function long_to_text(value) result(text)
      integer(ip), intent(in) :: value
      character(len=:), allocatable :: text
      character(len=24) :: buffer

      write (buffer, '(i0)') value
      text = trim(buffer)
   end function long_to_text

   !> Six significant digits at most, without zeros at their end, fixed between 1e-4 and 1e6.
   pure function real_to_text(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text
      character(len=40) :: buffer, form
      integer :: exponent, mark

      write (buffer, '(es13.5e3)') value
      text = trim(adjustl(buffer))
      mark = index(text, 'E')
      if (value > huge(value)) text = 'inf'
      if (mark == 0) return
      read (text(mark + 1:), *) exponent
      if (exponent >= -4 .and. exponent < 6) then
         write (form, '(a,i0,a)') '(f40.', 5 - exponent, ')'
         write (buffer, form) value
         text = shortest(trim(adjustl(buffer)))
      else
         ! Three digits of exponent only where they are needed.
         text = shortest(text(:mark - 1))//text(mark:mark + 1)// &
            text(mark + merge(3, 2, abs(exponent) < 100):)
      end if
   end function real_to_text

   !> Decimals without zeros at their end, and without the point where there are none.
   pure function shortest(decimals) result(text)
      character(len=*), intent(in) :: decimals
      character(len=:), allocatable :: text

      text = decimals(:verify(decimals, '0', back=.true.))
      text = text(:verify(text, '.', back=.true.))
   end function shortest

   !> Full precision: the decimal form reads back as the same number.
   pure function full(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text
      character(len=32) :: buffer

      write (buffer, '(es24.16e3)') value
      text = trim(adjustl(buffer))
   end function full

   !> `digits` decimals, right-adjusted in `width` places.
   pure function fixed(value, width, digits) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: width, digits
      character(len=width) :: text
      character(len=16) :: form

      write (form, '(a,i0,a,i0,a)') '(f', width, '.', digits, ')'
      write (text, form) value
   end function fixed

end module beamid_strings
