!> The quick reading of numbers against the runtime's own `read`, bit for bit; and numbers as text.
program test_numbers
   use beamid_kinds, only: wp, ip
   use beamid_lines, only: filled
   use beamid_numbers, only: parse_number
   use beamid_strings, only: fixed, full, to_text
   use checks, only: check, finish
   use random_numbers, only: pick, start_random
   implicit none

   integer :: wrong
   character(len=:), allocatable :: first_wrong

   call start_random(20240607, 16807)
   call test_random()
   call test_halves()
   call test_edges()
   call test_zero()
   call test_text()
   call test_full()
   call finish('numbers')

contains

   !> Zero has no sign, and a number that does not fit is not replaced by asterisks.
   subroutine test_text()
      real(wp), volatile :: zero

      zero = -0.0_wp
      call check('text of -0', to_text(zero) == '0', to_text(zero))
      call check('full text of -0', full(zero) == full(0.0_wp), full(zero))
      call check('decimals of -0', fixed(zero, 8, 2) == '    0.00', fixed(zero, 8, 2))
      call check('what rounds to 0', fixed(-4e-3_wp, 8, 2) == '    0.00', fixed(-4e-3_wp, 8, 2))
      call check('what does not', fixed(-6e-3_wp, 8, 2) == '   -0.01', fixed(-6e-3_wp, 8, 2))
      call check('per cent', filled('#%', [0.125_wp]) == '12.5 %')
      call check('very many per cent', filled('#%', [-1e30_wp]) == '-1E+32 %', &
         filled('#%', [-1e30_wp]))
   end subroutine test_text

   !> Full precision as the runtime writes it: any double, and those on which rounding may go wrong,
   !> which are next to a power of ten, or in the middle between two numbers of 17 digits.
   subroutine test_full()
      character(len=32) :: text
      real(wp) :: x
      integer :: trial, k

      wrong = 0
      first_wrong = ''
      do trial = 1, 60000
         select case (mod(trial, 3))
         case (0)
            x = random_double()
         case (1)
            x = 10.0_wp**(mod(trial, 50) - 28)
            do k = 1, mod(trial, 4)
               x = nearest(x, -1.0_wp)
            end do
         case default
            x = sign((pick(1000000) + 0.5_wp)*2.0_wp**(mod(trial, 80) - 60), mod(trial, 2) - 0.5_wp)
         end select
         write (text, '(es24.16e3)') x
         if (full(x) == trim(adjustl(text))) cycle
         wrong = wrong + 1
         if (wrong == 1) first_wrong = full(x)//' for '//text
      end do
      call check('6 10**4 doubles in full precision', wrong == 0, first_wrong)
   end subroutine test_full

   !> Digits, point and exponent anywhere: short and long ones, inside and outside of what the quick
   !> way takes.
   subroutine test_random()
      character(len=60) :: token
      integer :: trial, digits, exponent

      call begin()
      do trial = 1, 100000
         digits = pick(22)
         token = sign_of(trial)//number_of(digits)
         exponent = pick(121) - 61
         if (pick(3) == 1) exponent = pick(600) - 300
         if (pick(3) > 1) write (token, '(2a,i0)') trim(token), letter(trial), exponent
         call compare(trim(token))
      end do
      call done('10**5 random numbers')
      call begin()
      do trial = 1, 20000
         write (token, '(es24.16e3)') random_double()
         call compare(trim(adjustl(token)))
      end do
      call done('2 10**4 doubles with 17 digits')
   end subroutine test_random

   !> Decimals as near to the middle between two doubles as 15 to 19 digits allow: the hardest.
   subroutine test_halves()
      integer, parameter :: qp = selected_real_kind(30)
      character(len=60) :: token, form
      real(wp) :: x
      integer :: trial

      call begin()
      do trial = 1, 20000
         x = random_double()
         if (abs(x) < 1e-20_wp .or. abs(x) > 1e20_wp) cycle
         write (form, '(a,i0,a)') '(es40.', 14 + pick(7), 'e3)'
         write (token, form) (real(x, qp) + real(nearest(x, 1.0_wp), qp))/2
         call compare(trim(adjustl(token)))
      end do
      call done('decimals near the middle of two doubles')
   end subroutine test_halves

   subroutine test_edges()
      character(len=30), parameter :: tokens(*) = [character(len=30) :: '9007199254740991', &
         '9007199254740992', '9007199254740993', '9007199254740995', '9007199254740993e-22', &
         '9007199254740992e22', '9007199254740992e23', '1e22', '1e23', '1e-22', '1e-23', '1e27', &
         '1e28', '999999999999999999', '9223372036854775807', '9223372036854775808', &
         '18446744073709551616', '8.5', '123456789012345678e27', '123456789012345678e-27', &
         '4.9e-324', '2.2250738585072011e-308', '1.7976931348623157e308', '000000000000000000001', &
         '0.000000000000000000000001', '1e+022', '1E-005', '.5d0', '5.d0', '+7', '1.e1', &
         '100000000000000000000', '0.1000000000000000055511151231']
      integer :: k

      call begin()
      do k = 1, size(tokens)
         call compare(trim(tokens(k)))
         call compare('-'//trim(tokens(k)))
         call compare(' '//trim(tokens(k))//achar(9)//' ', trim(tokens(k)))
      end do
      call done('edges of the quick way')
   end subroutine test_edges

   !> The sign of zero survives.
   subroutine test_zero()
      real(wp) :: value
      logical :: ok

      call parse_number('-0.0', value, ok)
      call check('minus zero', ok .and. abs(value) <= 0 .and. sign(1.0_wp, value) < 0)
      call parse_number('0', value, ok)
      call check('zero', ok .and. abs(value) <= 0 .and. sign(1.0_wp, value) > 0)
   end subroutine test_zero

   subroutine begin()
      wrong = 0
      first_wrong = ''
   end subroutine begin

   subroutine done(what)
      character(len=*), intent(in) :: what

      call check(what//': the same bits as read', wrong == 0, first_wrong)
   end subroutine done

   subroutine compare(token, bare)
      character(len=*), intent(in) :: token
      !> What `read` gets, when that is not the same.
      character(len=*), intent(in), optional :: bare
      real(wp) :: value, reference
      integer :: status
      logical :: ok

      call parse_number(token, value, ok)
      if (present(bare)) then
         read (bare, *, iostat=status) reference
      else
         read (token, *, iostat=status) reference
      end if
      if (status == 0 .and. ok) then
         if (transfer(value, 1_ip) == transfer(reference, 1_ip)) return
      else if (.not. ok .and. (status /= 0 .or. abs(reference) > huge(1.0_wp))) then
         return
      end if
      if (wrong == 0) first_wrong = token
      wrong = wrong + 1
   end subroutine compare

   !> Digits with a point among them, or none.
   function number_of(digits) result(text)
      integer, intent(in) :: digits
      character(len=:), allocatable :: text
      integer :: k, point

      text = ''
      point = pick(2*digits)
      do k = 1, digits
         text = text//achar(47 + pick(10))
         if (k == point) text = text//'.'
      end do
   end function number_of

   !> Any finite double of the middle range of exponents.
   real(wp) function random_double() result(x)
      x = (pick(1000000) + pick(1000000)/1e6_wp + pick(1000000)/1e12_wp)
      x = x*10.0_wp**(pick(41) - 21)
   end function random_double

   function sign_of(k) result(text)
      integer, intent(in) :: k
      character(len=:), allocatable :: text

      text = ''
      if (mod(k, 3) == 0) text = '-'
      if (mod(k, 7) == 0) text = '+'
   end function sign_of

   pure character(len=1) function letter(k)
      integer, intent(in) :: k
      character(len=*), parameter :: letters = 'eEdD'

      letter = letters(mod(k, 4) + 1:)
   end function letter

end program test_numbers
