!> A real beam on a roller that moves: scripts/roller_beam.py finds the roller's places. The
!> recorder's files lie beside the checkout; without them only what the script refuses is tested.
program test_roller_beam
   use beamid_kinds, only: wp
   use checks, only: check, check_close, finish, skip
   use shell, only: close_shell, exists, has_all, line_count, open_shell, outcome_t, &
      program_path, python_with, read_file, run
   use tables, only: field, number, part
   implicit none

   character(len=*), parameter :: nl = achar(10), script = '../../scripts/roller_beam.py ', &
      record = '../../../shared/data/roller_beam/test0.txt'
   character(len=:), allocatable :: reason
   type(outcome_t) :: outcome

   ! Where there is no matplotlib the script would install it.
   call open_shell(reason)
   if (reason == '' .and. python_with('numpy, matplotlib') == '') reason = 'no matplotlib'
   if (reason /= '') then
      call skip('roller beam', reason)
   else
      call test_refusals()
      if (exists(record)) then
         call test_places()
      else
         call skip('places of the roller', 'there is no '//record(7:))
      end if
   end if
   call close_shell()
   call finish('roller_beam')

contains

   subroutine test_refusals()
      outcome = run('mkdir none few; '//script//'none')
      call check('no record', outcome%status == 2 .and. has_all(outcome%err, &
         'none: found no file test*.txt') .and. line_count(outcome%err) == 1, outcome%err)
      outcome = run('seq 12 >few/test0.txt; '//script//'few')
      call check('other columns', outcome%status == 2 .and. has_all(outcome%err, &
         'few/test0.txt|found no line with the columns Time') .and. line_count(outcome%err) == 1, &
         outcome%err)
   end subroutine test_refusals

   !> An independent model found from two frequencies of each dwell a straight line of 50 to 55 mm
   !> per volt within .7 to 1.1 mm rms, and a mass of the sensor of 12 to 74 g, by what the support
   !> is made of; 1.5 mm are what a user can ask for.
   subroutine test_places()
      character(len=:), allocatable :: table
      real(wp) :: volts(10), places(10), slope, away(10)
      integer :: k

      outcome = run('mkdir trial; ln -s ../'//record//' trial; BEAMID_PROGRAM='//program_path// &
         ' '//script//'trial --out out --quick')
      call check('the study runs', outcome%status == 0, outcome%out//outcome%err)
      if (outcome%status /= 0) return
      table = read_file('out/places.csv')
      call check('ten dwells', line_count(table) == 11)
      do k = 1, 10
         volts(k) = number(field(table, k, 1))
         places(k) = number(field(table, k, 2))
      end do
      volts = volts - sum(volts)/10
      slope = sum(volts*places)/sum(volts**2)
      away = places - sum(places)/10 - slope*volts
      call check_close('m/V', slope, 0.0525_wp, 0.0025_wp)
      call check_close('rms distance from the line', norm2(away)/sqrt(10.0_wp), 0.0_wp, 1.5e-3_wp)
      call check_close('mass of the sensor', behind('m_S = '), 0.043_wp, 0.031_wp)
      call check('it trades against the support', behind('m_S with k_P: ') > 0.5_wp, outcome%out)
   end subroutine test_places

   !> The number that is printed behind some words.
   real(wp) function behind(words)
      character(len=*), intent(in) :: words
      integer :: k

      k = index(outcome%out, words) + len(words)
      behind = number(part(part(outcome%out(k:), 1, nl), 1, ' '))
   end function behind

end program test_roller_beam
