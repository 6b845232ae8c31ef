!> Records whose scale or times are wrong, struck beams with a mass that the case leaves out, and
!> records of noise, fitted by the program: the first lines tell it, and no wrong value counts as
!> determined.
program test_record_errors
   use beamid_kinds, only: two_pi, wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: to_text
   use case_answers, only: answer_t, cell, identified, nl
   use checks, only: check, check_close, finish, skip
   use shell, only: beamid, close_shell, line_count, open_shell, outcome_t, read_file, replaced, &
      write_file
   use tables, only: field, number
   implicit none

   character(len=*), parameter :: names(*) = [character(len=5) :: 'E', 'c_D', 'gamma']
   real(wp), parameter :: truth(*) = [7e10_wp, 2e6_wp, 0.05_wp]
   character(len=*), parameter :: beam = '&beam length=0.5, width=0.03, height=0.003, '// &
      'density=2700, E=7e10, c_D=2e6, gamma=0.05 /'//nl//'&sensor m_S=0.005, x_S=0.4 /'//nl// &
      '&units length=''m'', force=''N'', time=''s'', mass=''kg'' /'//nl
   character(len=*), parameter :: pulse = '&excitation kind=''pulse'', amplitude=5, '// &
      'duration=0.02, x_F=0.3 /'//nl
   character(len=*), parameter :: free = '&excitation kind=''free'' /'//nl
   character(len=*), parameter :: stage = '&stage free=''E'',''c_D'',''gamma'' /'//nl
   character(len=:), allocatable :: reason

   call open_shell(reason)
   if (reason /= '') then
      call skip('fits', reason)
   else
      call test_right()
      call test_scale()
      call test_delay()
      call test_unknown_mass()
      call test_noise_alone()
      call test_hum()
      call test_dying_motion()
      call test_moved_base()
      call close_shell()
   end if
   call finish('record_errors')

contains

   !> Writes r.csv: the motion after a pulse, sampled 1,500 times in 3 s, with noise.
   !>
   !> scale  factor of the record
   !> delay  of its times [s]
   !> seed   of the noise
   !> level  of the noise, a share of the motion; default: 0.01
   !> mass   group of the case file with a mass that `fitted` does not know
   !> hum    of 50 Hz, a share of the motion; default: 0
   !> fast   whether the motion decays twenty times as fast as that of `beam`; default .false.
   subroutine write_motion(scale, delay, seed, level, mass, hum, fast)
      real(wp), intent(in) :: scale, delay
      integer, intent(in) :: seed
      real(wp), intent(in), optional :: level, hum
      character(len=*), intent(in), optional :: mass
      logical, intent(in), optional :: fast
      real(wp) :: share
      type(outcome_t) :: outcome
      character(len=:), allocatable :: of_beam, table, text, unknown
      character(len=80) :: row
      real(wp), allocatable :: a(:), noise(:), t(:)
      integer :: k, m

      unknown = ''
      if (present(mass)) unknown = mass//nl
      of_beam = beam
      if (present(fast)) of_beam = replaced(beam, 'gamma=0.05', 'gamma=1')
      call write_file('truth.nml', of_beam//unknown//pulse//'&record t_first=0.002, '// &
         't_last=3, t_step=0.002 /'//nl)
      outcome = beamid('simulate truth.nml --quiet --out truth')
      call check('a record', outcome%status == 0, outcome%err)
      table = read_file('truth/record.csv')
      m = line_count(table) - 1
      t = [(number(field(table, k, 1)), k=1, m)]
      a = [(number(field(table, k, 2)), k=1, m)]
      share = 0.01_wp
      if (present(level)) share = level
      noise = gaussian_noise(m, share*norm2(a)/sqrt(real(m, wp)), seed)
      if (present(hum)) noise = noise + hum*norm2(a)*sqrt(2.0_wp/m)*sin(50*two_pi*t)
      text = 't,a'//nl
      do k = 1, m
         write (row, '(es23.16, a, es23.16)') t(k) + delay, ',', scale*a(k) + noise(k)
         text = text//trim(row)//nl
      end do
      call write_file('r.csv', text)
   end subroutine write_motion

   !> Fits r.csv.
   function fitted(excitation) result(answer)
      character(len=*), intent(in) :: excitation
      type(answer_t) :: answer

      answer = identified(beam//excitation//'&record file=''r.csv'' /'//nl//stage)
   end function fitted

   !> Right records are not accused, whatever their noise: of ten records, all tests together reject
   !> two with a probability of less than 1 %. Their parameters are determined.
   subroutine test_right()
      real(wp), parameter :: levels(*) = [0.01_wp, 0.1_wp, 0.3_wp]
      type(answer_t) :: answer
      integer :: accused, k, level

      do level = 1, size(levels)
         accused = 0
         do k = 1, 10
            call write_motion(1.0_wp, 0.0_wp, 40 + k, levels(level))
            answer = fitted(pulse)
            call check('a right record', answer%status == 0, answer%err)
            call check('a right record: determined', answer%is_determined('E') .and. &
               index(answer%head, 'no parameter counts') == 0, answer%head)
            if (answer%test_matters('scale') .or. answer%test_matters('delay')) &
               accused = accused + 1
         end do
         call check('right records, noise '//to_text(levels(level)), accused <= 1, &
            to_text(accused))
      end do
   end subroutine test_right

   !> A record that is too small is multiplied by the inverse, up to the noise and the second order
   !> of an error of 10 %. A motion of unknown size has no scale.
   subroutine test_scale()
      type(answer_t) :: answer

      call write_motion(0.9_wp, 0.0_wp, 51)
      answer = fitted(pulse)
      call check('scale: named', index(answer%head, 'contradicts the scale') > 0, &
         answer%head)
      call check('scale: no wrong value', answer%is_honest(names, truth), answer%estimates)
      call check_close('scale: value', number(cell(answer%tests, 'parameter', 'scale', 'value')), &
         1/0.9_wp, 0.02_wp)
      answer = fitted(free)
      call check('scale of a free motion: not tested', &
         cell(answer%tests, 'parameter', 'scale', 'value') == '', answer%tests)
   end subroutine test_scale

   !> Times that are 2 ms late, one step. The slope by differences is too small, because the highest
   !> visible mode turns far in a step; the sign and the order remain.
   subroutine test_delay()
      type(answer_t) :: answer
      real(wp) :: delay

      call write_motion(1.0_wp, 0.002_wp, 61)
      answer = fitted(pulse)
      call check('delay: named', index(answer%head, 'contradicts the times') > 0, &
         answer%head)
      call check('delay: no wrong value', answer%is_honest(names, truth), answer%estimates)
      delay = number(cell(answer%tests, 'parameter', 'delay', 'value'))
      call check('delay: value', delay > 0.001_wp .and. delay < 0.004_wp, to_text(delay))
   end subroutine test_delay

   !> A mass of 2 to 5 % of the beam, which the case leaves out. E falls until mode 1 has the
   !> frequency of the record; what is left is mode 2, which is small beside the motion. With the
   !> limit for free motions, ten times the noise, E would be up to 490 half widths off.
   subroutine test_unknown_mass()
      character(len=*), parameter :: masses(*) = [character(len=24) :: '&mass m=0.003, x=0.25 /', &
         '&mass m=0.006, x=0.35 /', '&mass m=0.003, x=0.3 /', '&mass m=0.003, x=0.35 /']
      !> What the first lines say. Of the third record, one candidate rejects the model, and the
      !> likelihood ratio of another one is significant only after that.
      character(len=*), parameter :: told(*) = [character(len=19) :: 'times the noise', &
         'times the noise', 'may also contradict', 'times the noise']
      type(answer_t) :: answer
      integer :: k

      do k = 1, size(masses)
         call write_motion(1.0_wp, 0.0_wp, 70 + k, mass=masses(k))
         answer = fitted(pulse)
         call check(trim(masses(k))//': told', index(answer%head, trim(told(k))) > 0, answer%head)
         call check(trim(masses(k))//': no wrong value', answer%is_honest(names, truth), &
            answer%estimates)
      end do
   end subroutine test_unknown_mass

   !> Records of noise are rejected, whether the force of the case would move the beam by more or by
   !> as much. A motion of a third of the noise is accepted: it reduces J by 160 variances of the
   !> noise, and chance by at most 32 (the quantile of three parameters and 1500 samples).
   subroutine test_noise_alone()
      character(len=*), parameter :: weak_pulse = '&excitation kind=''pulse'', '// &
         'amplitude=0.05, duration=0.02, x_F=0.3 /'//nl
      type(answer_t) :: answer
      integer :: k, told

      told = 0
      do k = 1, 12
         call write_motion(0.0_wp, 0.0_wp, 80 + k)
         answer = fitted(weak_pulse)
         call check('noise: rejected', answer%status == 1, answer%out)
         if (index(answer%out, 'no record shows the motion of the model') > 0) told = told + 1
         call check('noise: no estimate counts', index(answer%estimates, ',yes,') == 0, &
            answer%estimates)
         if (k > 6) cycle
         answer = fitted(pulse)
         call check('noise beside a large force: rejected', answer%status == 1, answer%out)
      end do
      ! In the others, the search does not converge: in about half of all records.
      call check('noise: the reason', told >= 3, to_text(told))
      call write_motion(1.0_wp, 0.0_wp, 97, 3.0_wp)
      answer = fitted(pulse)
      call check('a faint motion: accepted', answer%status == 0, answer%out//answer%err)
      call check('a faint motion: no wrong value', answer%is_honest(names, truth), answer%estimates)
   end subroutine test_noise_alone

   !> A hum of the mains, of 0.4 of the motion, leaves residuals of few independent samples. It does
   !> not hide the motion.
   subroutine test_hum()
      type(answer_t) :: answer

      call write_motion(1.0_wp, 0.0_wp, 98, hum=0.4_wp)
      answer = fitted(pulse)
      call check('hum: accepted', answer%status == 0, answer%out//answer%err)
      call check('hum: no wrong value', answer%is_honest(names, truth), answer%estimates)
   end subroutine test_hum

   !> A decay of which the last windows show nothing but noise: its parameters are constant. A false
   !> alarm has a probability of 5 %, more than two of eight one of .6 %.
   subroutine test_dying_motion()
      character(len=*), parameter :: windows = '&windows n=5 /'//nl
      type(answer_t) :: answer
      integer :: accused, k

      accused = 0
      do k = 1, 8
         call write_motion(1.0_wp, 0.0_wp, 100 + k, level=0.03_wp, fast=.true.)
         answer = identified(beam//free//'&record file=''r.csv'', t_first=0.1 /'//nl//stage// &
            windows)
         call check('a dying motion: accepted', answer%status == 0, answer%out//answer%err)
         if (index(answer%head, 'not constant during the motion') > 0) accused = accused + 1
      end do
      call check('dying motions', accused <= 2, to_text(accused))
   end subroutine test_dying_motion

   !> Motion by a moved base, with a density in the case that is 5 % too small. Only ratios to the
   !> mass count, if the sensor has none: E, c_D and gamma follow the density, and the summary says
   !> that no interval includes this.
   subroutine test_moved_base()
      character(len=*), parameter :: base = '&excitation kind=''base'', file=''base.csv'' /'//nl
      character(len=:), allocatable :: bare, text
      character(len=60) :: row
      type(outcome_t) :: outcome
      type(answer_t) :: answer
      integer :: k

      text = 't,a'//nl
      do k = 0, 200
         write (row, '(es23.16, a, es23.16)') 0.01_wp*k, ',', sin(3.0_wp*k)
         text = text//trim(row)//nl
      end do
      call write_file('base.csv', text)
      bare = replaced(beam, 'm_S=0.005', 'm_S=0')
      call write_file('truth.nml', bare//base//'&noise sd=0.001 /'//nl// &
         '&record t_first=0.002, t_last=2, t_step=0.002 /'//nl)
      outcome = beamid('simulate truth.nml --quiet --out truth')
      call check('a moved base: a record', outcome%status == 0, outcome%err)
      call write_file('r.csv', read_file('truth/record.csv'))
      answer = identified(replaced(bare, 'density=2700', 'density=2565')//base// &
         '&record file=''r.csv'' /'//nl//stage)
      call check('a moved base: accepted', answer%status == 0, answer%err)
      do k = 1, size(names)
         ! The noise of this record moves c_D and gamma by less than 0.5 %.
         call check_close('a moved base: '//trim(names(k)), number(answer%estimate( &
            trim(names(k)), 'estimate'))/truth(k), 0.95_wp, 0.01_wp)
      end do
      call check('a moved base: said', index(answer%out, 'mass that the model lacks') > 0, &
         answer%out)
   end subroutine test_moved_base

end program test_record_errors
