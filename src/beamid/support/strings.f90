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

   !> Six significant digits at most, without trailing zeros.
   pure function real_to_text(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = significant(value, 6)
   end function real_to_text

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

   !> Shortest form with at most `digits` significant digits, fixed between 1e-4 and 1e6.
   pure function significant(value, digits) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: digits
      character(len=:), allocatable :: text
      character(len=40) :: buffer, form
      integer :: exponent, mark, last

      write (form, '(a,i0,a)') '(es40.', digits - 1, 'e3)'
      write (buffer, form) value
      mark = index(buffer, 'E')
      if (mark == 0) then
         text = trim(adjustl(buffer))
         return
      end if
      read (buffer(mark + 1:), *) exponent
      if (exponent >= -4 .and. exponent < digits) then
         write (form, '(a,i0,a)') '(f40.', max(0, digits - 1 - exponent), ')'
         write (buffer, form) value
         mark = len(buffer) + 1
      end if
      last = mark - 1
      if (index(buffer(:last), '.') > 0) then
         do while (buffer(last:last) == '0')
            last = last - 1
         end do
         if (buffer(last:last) == '.') last = last - 1
      end if
      text = trim(adjustl(buffer(:last)))
      if (mark <= len(buffer)) then
         ! Three digits of exponent only where they are needed.
         if (buffer(mark + 2:mark + 2) == '0') buffer(mark + 2:) = buffer(mark + 3:)
         text = text//trim(buffer(mark:))
      end if
      if (text(1:1) == '.') text = '0'//text
      if (len(text) > 1) then
         if (text(1:2) == '-.') text = '-0'//text(2:)
      end if
   end function significant

end module beamid_strings
