!> Reads dates and times of day, as recorders and spreadsheets write them, and turns them into
!> seconds since the first.
!>
!> A time stamp is a time of day, h:mm:ss, with or without a date before it; mm:ss with a fraction,
!> without a date; or a date with h:mm. Seconds may have a fraction behind a point or a comma. AM or
!> PM, and behind a date a time zone (Z or +hh:mm), may follow. Dates are year-month-day,
!> day.month.year or month/day/year, with '-', '.' or '/'. If the first number is not the year, day
!> and month cannot be told apart. Only the day after counts then, in either order.
module beamid_time_stamps
   use beamid_kinds, only: ip, wp
   use beamid_strings, only: lower
   implicit none
   private

   public :: clock_t, is_stamp

   character(len=*), parameter :: digits = '0123456789'
   integer(ip), parameter :: second = 10_ip**9, hour = 3600*second, day = 24*hour   ! [ns]
   !> Forms of a time stamp: mm:ss, h:mm:ss, and a date with a time.
   integer, parameter :: of_hour = 1, of_day = 2, dated = 3
   integer, parameter :: none = -huge(0)

   !> A time stamp.
   type :: stamp_t
      integer :: form = 0            !< `of_hour`, `of_day` or `dated`; 0: no time stamp
      integer(ip) :: time = 0        !< time of the day, in universal time if there is a zone [ns]
      !> Number of the day if the first number of the date is year or day, and if it is the month;
      !> `none`: there is no such date.
      integer :: days(2) = none
      logical :: has_zone = .false.  !< whether a time zone is given
   end type stamp_t

   !> Counts the time since the first stamp.
   type :: clock_t
      logical :: is_running = .false.                 !< whether there was a first stamp
      character(len=:), allocatable :: beginning      !< the first stamp
      type(stamp_t), private :: last                  !< the last stamp
      integer(ip), private :: elapsed = 0             !< time from the first to the last stamp [ns]
   contains
      procedure :: read => read_clock
   end type clock_t

contains

   !> Reads the next stamp.
   !>
   !> text     of the stamp, without blanks around it
   !> seconds  since the first stamp; without a date, the clock may pass midnight (of mm:ss: the
   !>          full hour)
   !> ok       whether the text is a stamp of the same form as the first, and its date the same as,
   !>          or the day after, that of the stamp before
   pure subroutine read_clock(self, text, seconds, ok)
      class(clock_t), intent(inout) :: self
      character(len=*), intent(in) :: text
      real(wp), intent(out) :: seconds
      logical, intent(out) :: ok
      type(stamp_t) :: stamp
      integer(ip) :: step, period

      seconds = 0
      stamp = stamp_of(text)
      ok = stamp%form > 0
      if (.not. ok) return
      if (.not. self%is_running) then
         self%is_running = .true.
         self%beginning = text
         self%last = stamp
         return
      end if
      ok = stamp%form == self%last%form .and. (stamp%has_zone .eqv. self%last%has_zone)
      if (.not. ok) return
      step = stamp%time - self%last%time
      if (stamp%form == dated) then
         if (any(stamp%days /= none .and. stamp%days == self%last%days)) then
            continue
         else if (any(stamp%days /= none .and. self%last%days /= none .and. &
            stamp%days - 1 == self%last%days)) then
            step = step + day
         else
            ok = .false.
            return
         end if
      else
         period = merge(hour, day, stamp%form == of_hour)
         if (step < -period/2) step = step + period
      end if
      self%elapsed = self%elapsed + step
      self%last = stamp
      seconds = real(self%elapsed, wp)/real(second, wp)
   end subroutine read_clock

   !> Returns whether a text is a time stamp.
   pure logical function is_stamp(text)
      character(len=*), intent(in) :: text
      type(stamp_t) :: stamp

      is_stamp = index(text, ':') > 0
      if (.not. is_stamp) return
      stamp = stamp_of(text)
      is_stamp = stamp%form > 0
   end function is_stamp

   !> Returns the stamp that a text contains; its form is 0 if there is none.
   pure type(stamp_t) function stamp_of(text) result(stamp)
      character(len=*), intent(in) :: text
      integer :: at
      logical :: ok

      at = 1
      ok = .true.
      if (verify(text, digits) == 0) return
      if (scan(text(verify(text, digits):verify(text, digits)), '-./') > 0) then
         call read_date(text, at, stamp%days, ok)
         stamp%form = dated
      end if
      if (ok) call read_time(text, at, stamp, ok)
      if (ok .and. at <= len(text)) call read_half(text, at, stamp%time, ok)
      if (ok .and. at <= len(text) .and. stamp%form == dated) call read_zone(text, at, stamp, ok)
      if (.not. ok .or. at <= len(text)) stamp%form = 0
   end function stamp_of

   !> Reads a date and the 'T', comma or blank behind it.
   !>
   !> at    position of its first character; on return behind it
   !> days  number of the day in either reading, as in `stamp_t`
   pure subroutine read_date(text, at, days, ok)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: at
      integer, intent(out) :: days(2)
      logical, intent(out) :: ok
      character(len=1) :: sign
      integer :: numbers(3), widths(3), k

      days = none
      sign = ' '
      do k = 1, 3
         call read_digits(text, at, 4, numbers(k), widths(k))
         ok = widths(k) > 0 .and. at < len(text)
         if (.not. ok) return
         if (k == 1) sign = text(at:at)
         if (k < 3) ok = text(at:at) == sign .and. scan(sign, '-./') > 0
         if (k == 3) ok = scan(text(at:at), 'Tt, ') > 0
         if (.not. ok) return
         at = at + 1
      end do
      do while (at < len(text) .and. text(at:at) == ' ')
         at = at + 1
      end do
      if (widths(1) == 4) then
         days(1) = day_number(numbers(1), numbers(2), numbers(3))
      else
         days(1) = day_number(numbers(3), numbers(2), numbers(1))
         days(2) = day_number(numbers(3), numbers(1), numbers(2))
      end if
      ok = any(days /= none)
   end subroutine read_date

   !> Reads a time of day.
   !>
   !> at     position of its first character; on return behind it
   !> stamp  its form is set unless it is `dated`
   pure subroutine read_time(text, at, stamp, ok)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: at
      type(stamp_t), intent(inout) :: stamp
      logical, intent(out) :: ok
      integer(ip) :: fraction
      integer :: numbers(3), width, n

      numbers = 0
      fraction = 0
      do n = 1, 3
         call read_digits(text, at, 2, numbers(n), width)
         ok = width == 2 .or. n == 1 .and. width == 1
         if (.not. ok) return
         if (at > len(text) .or. n == 3) exit
         if (text(at:at) /= ':') exit
         at = at + 1
      end do
      ok = n >= 2
      if (.not. ok) return
      width = 0
      if (at < len(text)) then
         if (scan(text(at:at), '.,') > 0) call read_fraction(text, at, fraction, width)
      end if
      if (n == 2 .and. width > 0) then
         ok = stamp%form /= dated
         numbers = [0, numbers(1:2)]
         stamp%form = of_hour
      else if (stamp%form /= dated) then
         ok = n == 3
         stamp%form = of_day
      end if
      ok = ok .and. numbers(1) < 24 .and. all(numbers(2:) < 60)
      stamp%time = numbers(1)*hour + (60*numbers(2) + numbers(3))*second + fraction
   end subroutine read_time

   !> Reads the digits behind a decimal sign.
   !>
   !> at        position of the sign; on return behind the last digit
   !> fraction  rounded [ns]
   !> width     number of the digits
   pure subroutine read_fraction(text, at, fraction, width)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: at
      integer(ip), intent(out) :: fraction
      integer, intent(out) :: width
      integer :: digit

      fraction = 0
      width = 0
      do while (at < len(text))
         digit = index(digits, text(at + 1:at + 1)) - 1
         if (digit < 0) exit
         at = at + 1
         width = width + 1
         if (width <= 9) fraction = 10*fraction + digit
         if (width == 10 .and. digit >= 5) fraction = fraction + 1
      end do
      fraction = fraction*10_ip**max(0, 9 - width)
      if (width > 0) at = at + 1
   end subroutine read_fraction

   !> Reads AM or PM, if it comes next, and corrects the time [ns].
   pure subroutine read_half(text, at, time, ok)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: at
      integer(ip), intent(inout) :: time
      logical, intent(out) :: ok
      character(len=2) :: word
      integer :: first

      ok = .true.
      first = at
      if (text(first:first) == ' ') first = first + 1
      if (first + 1 > len(text)) return
      word = lower(text(first:first + 1))
      if (word /= 'am' .and. word /= 'pm') return
      at = first + 2
      ok = time >= hour .and. time < 13*hour
      if (time >= 12*hour) time = time - 12*hour
      if (word == 'pm') time = time + 12*hour
   end subroutine read_half

   !> Reads a time zone, and subtracts it from the time and the days.
   pure subroutine read_zone(text, at, stamp, ok)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: at
      type(stamp_t), intent(inout) :: stamp
      logical, intent(out) :: ok
      integer :: hours, minutes, width, direction

      if (text(at:at) == ' ' .and. at < len(text)) at = at + 1
      stamp%has_zone = .true.
      ok = text(at:) == 'Z' .or. text(at:) == 'z' .or. lower(text(at:)) == 'utc'
      if (ok) then
         at = len(text) + 1
         return
      end if
      if (scan(text(at:at), '+-') == 0) return
      direction = merge(1, -1, text(at:at) == '+')
      at = at + 1
      call read_digits(text, at, 2, hours, width)
      ok = width == 2 .and. hours < 24
      if (.not. ok .or. at > len(text)) then
         minutes = 0
      else
         if (text(at:at) == ':') at = at + 1
         call read_digits(text, at, 2, minutes, width)
         ok = width == 2 .and. minutes < 60
      end if
      stamp%time = stamp%time - direction*(hours*hour + 60*minutes*second)
      where (stamp%days /= none) stamp%days = stamp%days + int(floor_ratio(stamp%time))
      stamp%time = modulo(stamp%time, day)
   end subroutine read_zone

   !> Returns the number of whole days in a time [ns], which may be negative.
   pure integer(ip) function floor_ratio(time)
      integer(ip), intent(in) :: time

      floor_ratio = (time - modulo(time, day))/day
   end function floor_ratio

   !> Reads up to `most` digits.
   !>
   !> at      position of the first; on return behind the last
   !> number  their value
   !> width   how many there are
   pure subroutine read_digits(text, at, most, number, width)
      character(len=*), intent(in) :: text
      integer, intent(inout) :: at
      integer, intent(in) :: most
      integer, intent(out) :: number, width
      integer :: digit

      number = 0
      width = 0
      do while (at <= len(text) .and. width < most)
         digit = index(digits, text(at:at)) - 1
         if (digit < 0) exit
         number = 10*number + digit
         width = width + 1
         at = at + 1
      end do
   end subroutine read_digits

   !> Returns the number of days from 1 March of the year 0 to a date of the Gregorian calendar;
   !> `none` if there is no such date. Years below 100 are those of this century.
   pure integer function day_number(year, month, day_of_month) result(number)
      integer, intent(in) :: year, month, day_of_month
      integer, parameter :: lengths(12) = [31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]
      integer :: y, m

      number = none
      if (month < 1 .or. month > 12) return
      if (day_of_month < 1 .or. day_of_month > lengths(month)) return
      y = year
      if (y < 100) y = y + 2000
      if (month == 2 .and. day_of_month == 29 .and. (modulo(y, 4) /= 0 .or. &
         modulo(y, 100) == 0 .and. modulo(y, 400) /= 0)) return
      ! The year begins in March, so that a leap day is its last day.
      m = modulo(month - 3, 12)
      if (month < 3) y = y - 1
      number = 365*y + y/4 - y/100 + y/400 + (153*m + 2)/5 + day_of_month - 1
   end function day_number

end module beamid_time_stamps
