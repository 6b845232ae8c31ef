!> Records whose times are dates or times of day: the seconds since the first row, as differences of
!> clocks by hand, and what is refused.
program test_time_stamps
   use beamid_kinds, only: wp
   use checks, only: check, finish
   use damaged_texts, only: any_byte, damage, doubled, dropped, exchanged, likely_byte
   use loaded_records, only: check_loaded, load, message, notes, t
   use random_numbers, only: start_random
   use shell, only: own_path
   implicit none

   character(len=*), parameter :: nl = achar(10), tab = achar(9)
   real(wp), parameter :: values(3) = [1, -2, 4]
   character(len=:), allocatable :: scratch

   scratch = own_path('time_stamps')
   call test_dates()
   call test_times_of_day()
   call test_ambiguous_dates()
   call test_mixtures()
   call test_bad_stamps()
   call test_mutations()
   call execute_command_line('rm -r '//scratch)
   call finish('time_stamps')

contains

   subroutine test_dates()
      real(wp), parameter :: quarters(3) = [0.0_wp, 0.25_wp, 0.5_wp], days(3) = [0.0_wp, 2.0_wp, &
         86401.0_wp]

      call read_as('ISO 8601 in universal time', stamps('2024-05-01T12:00:00.123Z', &
         '2024-05-01T12:00:00.373Z', '2024-05-01T12:00:00.623Z'), quarters)
      call check('  said', any(notes == 'time stamps: t is in seconds from '// &
         '2024-05-01T12:00:00.123Z'))
      call read_as('without a zone', stamps('2024-05-01T12:00:00.123', '2024-05-01T12:00:00.373', &
         '2024-05-01T12:00:00.623'), quarters)
      call read_as('with a blank and a zone', stamps('2024-05-01 12:00:00.123+02:00', &
         '2024-05-01 12:00:00.373+02:00', '2024-05-01 12:00:00.623+02:00'), quarters)
      call read_as('a zone that changes', stamps('2024-10-27T02:59:59.75+02:00', &
         '2024-10-27T02:00:00.00+0100', '2024-10-27T02:00:00.25+01'), quarters)
      call read_as('a zone across midnight', stamps('2024-03-01T00:59:59.75+01:00', &
         '2024-03-01T00:00:00Z', '2024-02-29T00:30:00.25-23:30'), quarters)
      call read_as('19 digits', stamps('2024/05/01 12:00:00.1230000000000000001', &
         '2024/05/01 12:00:00.3729999999999999999', '2024/05/01 12:00:00.623'), quarters)
      call read_as('across a leap day', stamps('2024-02-28T23:59:59', '2024-02-29T00:00:01', &
         '2024-03-01T00:00:00'), days)
      call read_as('across the end of a year', stamps('2023-12-30 23:59:59', &
         '2023-12-31 00:00:01', '2024-01-01 00:00:00'), days)
      call read_as('across the end of February', stamps('1900-02-27 23:59:59', &
         '1900-02-28 00:00:01', '1900-03-01 00:00:00'), days)
      call read_as('without names', '2024-05-01T12:00:00,1'//nl//'2024-05-01T12:00:02,-2'//nl// &
         '2024-05-02T12:00:01,4'//nl, days)
      call read_as('in quotes', '"time","a"'//nl//'"2024-05-01, 12:00:00","1"'//nl// &
         '"2024-05-01, 12:00:02","-2"'//nl//'"2024-05-02, 12:00:01","4"'//nl, days)
   end subroutine test_dates

   subroutine test_times_of_day()
      call read_as('a time of day across midnight', stamps('23:59:59.5', '00:00:00', &
         '0:00:01.25'), &
         [0.0_wp, 0.5_wp, 1.75_wp])
      call read_as('twelve hours', stamps('11:59:59 AM', '12:00:00 PM', '12:59:59.5 pm'), &
         [0.0_wp, 1.0_wp, 3600.5_wp])
      call read_as('twelve hours across midnight', stamps('11:59:59 PM', '12:00:00AM', &
         '01:00:00 am'), [0.0_wp, 1.0_wp, 3601.0_wp])
      call read_as('minutes across the hour', stamps('59:59.5', '00:00.0', '0:02.5'), &
         [0.0_wp, 0.5_wp, 3.0_wp])
      call read_as('a column of the date beside', 'Date,Time,a'//nl//'2024-05-01,23:59:59,1'//nl// &
         '2024-05-02,00:00:01,-2'//nl//'2024-05-02,00:00:01.5,4'//nl, &
         [0.0_wp, 2.0_wp, 2.5_wp], time_column='Time', value_column='a')
   end subroutine test_times_of_day

   !> Day and month change places: both readings that are one day apart are taken.
   subroutine test_ambiguous_dates()
      real(wp), parameter :: times(3) = [0.0_wp, 0.25_wp, 1.0_wp]

      call read_as('a German spreadsheet', 'Zeit;a'//nl//'31.12.2023 23:59:59,500;1,0'//nl// &
         '31.12.2023 23:59:59,750;-2,0'//nl//'01.01.2024 00:00:00,500;4,0'//nl, times)
      call read_as('day before month, on one day', 'Zeit'//tab//'a'//nl// &
         '05.01.2024 12:00:00,5'//tab//'1'//nl//'05.01.2024 12:00:00,75'//tab//'-2'//nl// &
         '05.01.2024 12:00:01,5'//tab//'4'//nl, times)
      call read_as('an American spreadsheet', stamps('1/31/2024 11:59:59.5 PM', &
         '1/31/2024 11:59:59.75 PM', '2/1/2024 12:00:00.5 AM'), times)
      call read_as('either order, next day', stamps('05.06.24 23:59:59.5', '05.06.24 23:59:59.75', &
         '06.06.24 00:00:00.5'), times)
      call read_as('the other order, next day', stamps('5/6/24 23:59:59.5', '5/6/24 23:59:59.75', &
         '5/7/24 0:00:00.5'), times)
      call refused('neither order', stamps('05.06.2024 23:59:59.5', '07.08.2024 00:00:00', &
         '07.08.2024 00:00:01'), &
         ':3: column 1 (''t''): found ''07.08.2024 00:00:00'', expected a '// &
         'time stamp like ''05.06.2024 23:59:59.5'', of the same or the next day')
   end subroutine test_ambiguous_dates

   !> What changes from one row to the next is a mistake there.
   subroutine test_mixtures()
      character(len=*), parameter :: first = '2024-05-01T12:00:00Z', second = &
         '2024-05-01T12:00:01Z', like = 'expected a time stamp like '''//first//''', of the same or'

      call refused('a number below stamps', stamps(first, '1.5', second), &
         ':3: column 1 (''t''): found ''1.5'', '//like)
      call refused('a zone that is missing', stamps(first, '2024-05-01T12:00:01', second), &
         ':3: column 1 (''t''): found ''2024-05-01T12:00:01'', '//like)
      call refused('a date that is missing', stamps(first, '12:00:01', second), &
         ':3: column 1 (''t''): found ''12:00:01'', '//like)
      call refused('not a number', stamps(first, 'NaN', second), ':3: column 1 (''t''): found '// &
         '''NaN'', '//like)
      call refused('nothing', stamps(first, '', second), &
         ':3: column 1 (''t''): found an empty field')
      call refused('a stamp below numbers', stamps('0.5', '12:00:01', '12:00:02'), &
         ':3: column 1 (''t''): found ''12:00:01'', expected a number')
      call refused('two hours in one', stamps('00:01.5', '00:00:02.5', '00:03.5'), &
         ':3: column 1 (''t''): found ''00:00:02.5'', expected a time stamp like ''00:01.5''')
      call refused('the value is a stamp', 't,a'//nl//'0,12:00:01'//nl//'1,12:00:02'//nl, &
         ':2: column 2 (''a''): found ''12:00:01'', expected a number')
   end subroutine test_mixtures

   subroutine test_bad_stamps()
      character(len=*), parameter :: bad(*) = [character(len=32) :: '2024-05-01', '12:00', &
         '24:00:00', '12:60:00', '12:00:60', '2023-02-29T12:00:00', '2024-13-01T12:00:00', &
         '31.04.2024 12:00:00', '2024-05-01T12:00:00+25:00', '2024-05-01T12:00:00 CET', &
         '13:00:00 PM', '0:00:00 AM', '12:00:00Z', '2024-05-01T', '2024-05-01T12', '1:2:3', &
         '12:00:00.', '12:00:00.5.5', '2024-05/01 12:00:00', '-12:00:00', '2024-05-01T12:00:00ZZ', &
         '12:00:00:500', 'x12:00:00', '12 :00:00', '1/2', '2024-05-01T12:00.5', '12:00:00e3']
      integer :: k

      do k = 1, size(bad)
         call refused('no stamp: '//trim(bad(k)), stamps(trim(bad(k)), trim(bad(k)), 'x'), &
            ':2: column 1 (''t''): found '''//trim(bad(k))//''', expected a number')
      end do
      call refused('seconds twice', stamps('5/1/2024 12:00', '5/1/2024 12:00', '5/1/2024 12:01'), &
         ':3: column 1 (''t''): found ''5/1/2024 12:00'' after ''5/1/2024 12:00'', expected a '// &
         'later time (with all fractions of the second)')
      call refused('back in time', stamps('12:00:01', '12:00:00', '12:00:02'), &
         ':3: column 1 (''t''): found ''12:00:00'' after ''12:00:01'', expected a later time')
      call refused('a day back', stamps('2024-05-02 12:00:01', '2024-05-01 12:00:02', ''), &
         ':3: column 1 (''t''): found ''2024-05-01 12:00:02'', expected a time stamp like')
   end subroutine test_bad_stamps

   !> Damaged tables end in one line, or in times that increase from 0; the same 3000 in every run.
   subroutine test_mutations()
      character(len=*), parameter :: valid(3) = [character(len=160) :: &
         't,a'//nl//'2024-05-01T23:59:59.5Z,1'//nl//'2024-05-02T00:00:00Z,-2'//nl// &
         '2024-05-02T00:00:00.5Z,4'//nl, &
         't;a'//nl//'31.12.2023 23:59:59,5;1'//nl//'01.01.2024 00:00:00;-2'//nl// &
         '01.01.2024 00:00:00,5;4'//nl, &
         't,a'//nl//'"11:59:59.5 PM",1'//nl//'"12:00:00 AM",-2'//nl//'"12:00:00.5 AM",4'//nl]
      character(len=:), allocatable :: text
      integer :: at, n_read, trial, way
      logical :: ok

      call start_random(20240501, 16807)
      ok = .true.
      n_read = 0
      do trial = 1, 3000
         text = trim(valid(1 + modulo(trial, 3)))
         call damage(text, [dropped, doubled, any_byte, likely_byte, exchanged], &
            '0123456789:.,-/+ TZAPM"'//nl, at, way)
         call load(text, scratch)
         if (message /= '') then
            ok = index(message, nl) == 0
         else
            n_read = n_read + 1
            ok = t(1) >= 0 .and. t(1) <= 0 .and. all(t(2:) > t(:size(t) - 1))
         end if
         if (.not. ok) exit
      end do
      call check('damaged stamps: an error or increasing times', ok, text)
      call check('damaged stamps: some are read, some are not', n_read > 100 .and. n_read < 2900)
   end subroutine test_mutations

   !> A table with three rows: these times, and `values`.
   pure function stamps(first, second, third) result(text)
      character(len=*), intent(in) :: first, second, third
      character(len=:), allocatable :: text

      text = 't,a'//nl//first//',1'//nl//second//',-2'//nl//third//',4'//nl
   end function stamps

   !> Equal to the last bit: all differences are short decimal fractions, rounded once.
   subroutine read_as(what, text, times, time_column, value_column)
      character(len=*), intent(in) :: what, text
      real(wp), intent(in) :: times(:)
      character(len=*), intent(in), optional :: time_column, value_column

      call load(text, scratch, time_column, value_column)
      call check_loaded('stamps: '//what, times, values)
   end subroutine read_as

   subroutine refused(what, text, words)
      character(len=*), intent(in) :: what, text, words

      call load(text, scratch)
      call check('refused: '//what, index(message, 'record.csv'//words) > 0 .and. &
         index(message, nl) == 0, message)
   end subroutine refused

end program test_time_stamps
