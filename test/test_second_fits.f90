!> Fits that are repeated after their verdict: from the spectral lines of the record, and without
!> the damping of a record that does not show its mode. Independent finite elements make the
!> records.
program test_second_fits
   use beamid_kinds, only: wp
   use case_answers, only: answer_t, groups_of, identified, nl, times, write_record
   use checks, only: check, finish, skip
   use shell, only: close_shell, open_shell, read_file, write_file
   use simulated_beams, only: after_pulse, beam_t, decay
   use tables, only: number
   implicit none

   type(beam_t), parameter :: strip = beam_t(length=0.4_wp, width=0.03_wp, height=0.002_wp, &
      E=7.0e10_wp, c_D=2e6_wp, gamma=0.05_wp, m_S=0.005_wp, x_S=0.35_wp)
   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('second fits', reason)
   else
      call test_own_damping()
      call test_far_start()
      call close_shell()
   end if
   call finish('second_fits')

contains

   !> Two records share E and m_S, each has its own damping, and the second does not show mode 2.
   !> Its c_D is then fixed, its gamma allows for that, and everything else is reported.
   subroutine test_own_damping()
      type(beam_t) :: guess
      type(answer_t) :: answer
      real(wp) :: t(2000)

      t = times(size(t), 400.0_wp)
      call write_record(t, decay(strip, t, [10.0_wp, 0.0_wp], [0.3_wp, 1.0_wp]), 0.05_wp, 21)
      call write_file('second.csv', read_file('record.csv'))
      call write_record(t, decay(strip, t, [10.0_wp, 2.0_wp], [0.3_wp, 1.0_wp]), 0.05_wp, 22)
      guess = strip
      guess%E = 6.5e10_wp
      guess%m_S = 0.004_wp
      guess%c_D = 3e6_wp
      answer = identified(groups_of(guess)//'&record file=''second.csv'' /'//nl// &
         '&excitation kind=''free'', modes=2 /'//nl// &
         '&discretization degree=5, elements=8 /'//nl// &
         '&stage free=''E'',''m_S'',''c_D'',''gamma'',''offset'', shared=''E'',''m_S'' /'//nl)
      call check('own damping: fitted', answer%status == 0, answer%err)
      call check('own damping: that of record 2 is fixed', .not. answer%is_free('c_D(2)') .and. &
         answer%is_free('c_D(1)'), answer%head)
      call check('own damping: the first lines say so', &
         index(answer%head, 'c_D(2) is fixed at') > 0, answer%head)
      call check('own damping: the intervals hold the truth', answer%holds('E', strip%E) .and. &
         answer%holds('m_S', strip%m_S) .and. answer%holds('c_D(1)', strip%c_D) .and. &
         answer%holds('gamma(1)', strip%gamma) .and. answer%holds('gamma(2)', strip%gamma), &
         answer%estimates)
      call check('own damping: nothing counts as determined', .not. answer%is_determined('E'))
   end subroutine test_own_damping

   !> The values of the case lead to another minimum, far above the noise. The program starts again
   !> from the spectral lines and says so; with the true values it does not.
   subroutine test_far_start()
      character(len=*), parameter :: rest = '&excitation kind=''pulse'', amplitude=1, '// &
         'duration=0.005 /'//nl//'&discretization degree=5, elements=8 /'//nl// &
         '&stage free=''E'',''m_S'',''c_D'',''gamma'' /'//nl//'&score t_first=1, t_last=2 /'//nl
      character(len=*), parameter :: sentence = 'this fit starts from the spectral lines'
      type(beam_t), parameter :: long = beam_t(length=0.458_wp, width=0.03_wp, &
         height=0.001026_wp, density=7850, E=2e11_wp, c_D=1e6_wp, gamma=0.1_wp, m_S=0.0087_wp, &
         x_S=0.3816_wp)
      type(beam_t) :: guess
      type(answer_t) :: answer
      real(wp) :: t(4000)

      t = times(size(t), 200.0_wp)
      call write_record(t(3:), after_pulse(long, 1.0_wp, 0.005_wp, t(3:)), 0.02_wp, 23)
      guess = long
      guess%E = 1.8e11_wp
      guess%m_S = 0.012_wp
      answer = identified(groups_of(guess)//rest)
      call check('a far start: fitted', answer%status == 0, answer%err)
      call check('a far start: the first lines say where the fit starts', &
         index(answer%head, sentence) > 0, answer%head)
      call check('a far start: the score is that of the second fit', &
         index(answer%out, 'sum of squares over the window of &score') > 0, answer%head)
      call check('a far start: near the truth', abs(number(answer%estimate('E', 'estimate')) - &
         long%E) < 0.01_wp*long%E, answer%estimate('E', 'estimate'))
      answer = identified(groups_of(long)//rest)
      call check('the true start: no second fit', answer%status == 0 .and. &
         index(answer%head, sentence) == 0, answer%err//answer%head)
   end subroutine test_far_start

end program test_second_fits
