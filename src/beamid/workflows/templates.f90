!> Templates for `beamid new`: for each kind of experiment a case file with comments and a simulated
!> record that it fits.
module beamid_templates
   use beamid_cases, only: case_t, needs_nothing, parse_case, sample_times
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: new_base_motion, new_force_table
   use beamid_kinds, only: pi, two_pi, wp
   use beamid_noise, only: gaussian_noise
   use beamid_simulation, only: simulate, simulation_t
   use beamid_strings, only: full
   use beamid_texts, only: text_t
   implicit none
   private

   public :: new_template

   !> Kinds of experiment that have a template.
   character(len=10), parameter, public :: template_kinds(5) = [character(len=10) :: &
      'free-decay', 'impulse', 'base', 'struck-bar', 'paper']

   !> Longest line of a template.
   integer, parameter :: width = 90
   !> What makes the motion of a simulated record: the excitation of its case, a base that moves, or
   !> a mallet.
   integer, parameter :: by_case = 0, by_base = 1, by_mallet = 2
   character(len=*), parameter :: line_feed = new_line('a')

   ! Parts that several case files share. `strip` holds guesses, `strip_truth` the values that the
   ! records are simulated with.
   character(len=width), parameter :: begin(*) = [character(len=width) :: &
      '!', &
      '!    beamid identify case.nml', &
      '!', &
      '! fits it. Then replace record.csv by your own record, and the numbers by your own.', &
      '! `beamid help beam` explains the group &beam; it does so for every group and key.']

   character(len=width), parameter :: strip(*) = [character(len=width) :: &
      '', &
      '! Metres, seconds, newtons and kilograms, or another consistent set: mm, s, N and t.', &
      '&units  length=''m'', force=''N'', time=''s'', mass=''kg'' /', &
      '', &
      '! An aluminium strip, clamped at one end. Values of free parameters are guesses.', &
      '&beam', &
      '   length=0.5, width=0.05, height=0.002, density=2700', &
'   E=6.5e10        ! a guess', &
      '   c_D=4e6         ! damping inside the material (Kelvin-Voigt), a guess', &
      '   gamma=0.05      ! damping by the air, per length, a guess', &
      '/', &
      '', &
      '! The accelerometer: its mass (a guess), and its distance from the clamp.', &
      '&sensor  m_S=0.004, x_S=0.44 /']

   character(len=width), parameter :: strip_truth(*) = [character(len=width) :: &
      '&beam length=0.5, width=0.05, height=0.002, density=2700, E=7e10, c_D=2e6, gamma=0.08 /', &
      '&sensor m_S=0.005, x_S=0.44 /', &
      '&discretization degree=5, elements=16 /']

   ! The group &record with the keys that the user's own record most likely needs, without t_first.
   ! A key that the user would have to adapt to a file, but can leave out, is a comment.
   character(len=width), parameter :: record_keys(*) = [character(len=width) :: &
      '', &
      '&record', &
      '   file=''record.csv''              ! columns of times and measured values', &
      '   ! value_column=''acceleration''  ! name or number (''2''); default: the second column', &
      '   scale=1                        ! acceleration = scale (value - offset); default: 1', &
      '   offset=0                       ! value at zero acceleration; if free: its start value']

   character(len=width), parameter :: prior_knowledge(*) = [character(len=width) :: &
      '', &
      '! Standard deviations of fixed parameters. The total intervals include them. For a', &
      '! density from a handbook: &prior parameter=''density'', sd=30 /', &
      '&prior  parameter=''length'', sd=0.001 /', &
      '&prior  parameter=''height'', sd=0.00002 /']

   ! Lines of the case file of each kind, and of the case that its record is simulated with.
   character(len=width), parameter :: free_decay_case(*) = [character(len=width) :: &
      '! The tip of a strip was deflected and released; an accelerometer recorded the motion.', &
      begin, strip, '', &
      '! The initial state is unknown: amplitudes and phases of three modes are estimated', &
      '! with the parameters. Start values come from the spectral lines of the record.', &
      '&excitation  kind=''free'', modes=3 /', &
      record_keys, &
      '   ! t_first=0.2                  ! first time that is used, after the release', &
      '/', &
      '', &
      '! Add ''offset'' if the sensor reads gravity or has an offset, as that of a phone.', &
      '&stage       free=''E'',''m_S'',''c_D'',''gamma'' /', &
      prior_knowledge]

   character(len=width), parameter :: free_decay_truth(*) = [character(len=width) :: &
      strip_truth, &
      '&excitation kind=''release'', displacement=0.02 /', &
      '&record t_first=0.2, t_last=4.198, t_step=0.002 /', &
      '&noise sd=0.05, seed=1 /']

   character(len=width), parameter :: impulse_case(*) = [character(len=width) :: &
      '! A strip was struck 200 mm from its clamp, with 1 N for 10 ms from t = 0 on.', &
      begin, strip, '', &
      '! For a measured force: kind=''table'', file=''...'' with columns of time and force.', &
      '&excitation  kind=''pulse'', amplitude=1, duration=0.01, x_F=0.2 /', &
      record_keys, &
      '   t_first=0                      ! first time that is used; default: start of the record', &
      '/', &
      '', &
      '! Start values come from the spectral lines of the record.', &
      '&stage       free=''E'',''m_S'',''c_D'',''gamma'', start=''auto'' /', &
      prior_knowledge]

   character(len=width), parameter :: impulse_truth(*) = [character(len=width) :: &
      strip_truth, &
      '&excitation kind=''pulse'', amplitude=1, duration=0.01, x_F=0.2 /', &
      '&record t_first=0, t_last=1.999, t_step=0.001 /', &
      '&noise sd=0.1, seed=2 /']

   character(len=width), parameter :: base_case(*) = [character(len=width) :: &
      '! A strip on a shaker; one accelerometer on the strip, one on the base.', &
      begin, strip, '', &
      '! The column ''base'' of the same file is the acceleration of the base.', &
      '&excitation  kind=''base'', file=''record.csv'', value_column=''base'' /', &
      '&discretization degree=5 /', &
      record_keys, &
      '   t_first=0                      ! first time that is used; default: start of the record', &
      '/', &
      '', &
      '&stage       free=''E'',''m_S'',''c_D'',''gamma'', start=''auto'' /', &
      prior_knowledge]

   character(len=width), parameter :: base_truth(*) = [character(len=width) :: &
      strip_truth, &
      '&record t_first=0, t_last=1.999, t_step=0.001 /', &
      '&noise sd=0.1, seed=3 /']

   character(len=width), parameter :: bar_case(*) = [character(len=width) :: &
      '! A steel bar on two strings was struck in the middle, below a microphone (ASTM E1876).', &
      begin, &
      '', &
      '! Metres, seconds, newtons and kilograms, or another consistent set: mm, s, N and t.', &
      '&units  length=''m'', force=''N'', time=''s'', mass=''kg'' /', &
      '', &
      '&beam', &
      '   length=0.2, width=0.025, height=0.005', &
      '   rho=0.9875      ! mass of the bar divided by its length: 0.1975/0.2', &
      '   E=1.8e11        ! a guess', &
      '   c_D=1e4         ! all damping at the frequency of the first mode, a guess', &
      '/', &
      '', &
      '! The strings are so soft that the bar counts as free.', &
      '&end  at=''root'', kind=''free'' /', &
      '', &
      '! The microphone: it has no mass, and is above the middle of the bar.', &
      '&sensor  x_S=0.1 /', &
      '', &
      '! Amplitude and phase of the first mode are estimated, so that the unit of the sound and', &
      '! the distance of the microphone do not matter.', &
      '&excitation  kind=''free'', modes=1 /', &
      '&discretization degree=5 /', &
      '', &
      '&record', &
      '   file=''record.csv''              ! columns of times and sound', &
      '   value_column=''sound''           ! name or number (''2''); default: the second column', &
      '   t_first=0.1                    ! the higher modes have decayed', &
      '/', &
      '', &
      '&stage       free=''E'',''c_D'' /', &
      '', &
      '! Standard deviations of what was measured with calliper, micrometer and balance. That of', &
      '! rho is that of the mass, divided by the length. The total interval of E includes them.', &
      '&prior  parameter=''length'', sd=0.00005 /', &
      '&prior  parameter=''width'',  sd=0.00002 /', &
      '&prior  parameter=''height'', sd=0.00001 /', &
      '&prior  parameter=''rho'',    sd=0.0005 /']

   !> The true dimensions differ from the measured ones, as they do in a laboratory.
   character(len=width), parameter :: bar_truth(*) = [character(len=width) :: &
      '&beam length=0.19997, width=0.02501, height=0.005006, rho=0.98775, E=1.95e11, c_D=4e4 /', &
      '&end at=''root'', kind=''free'' /', &
      '&sensor x_S=0.1 /', &
      '&discretization degree=5, elements=16 /', &
      '&record t_first=0, t_last=0.3999, t_step=0.0001 /', &
      '&noise sd=2, seed=5 /']

   character(len=width), parameter :: paper_case(*) = [character(len=width) :: &
      '! The structure of NASA CR-178199, Table 4.1: a beam with a hose at the tip. A thruster', &
      '! at the tip fires for 0.05 s. The record has 2 % of noise.', &
      begin, '', &
      '&units  length=''ft'', force=''lb'', time=''s'', mass=''slug'' /', &
      '&beam   length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.0035 /', &
      '&tip    m_T=0.15 /', &
      '&hose   m_H=0.035, c_H=0.0035, k_H=0.4 /', &
      '&excitation  kind=''pulse'', amplitude=1.0, duration=0.05 /', &
      '&discretization degree=5 /', &
      record_keys, &
      '   t_first=0.02                   ! first time that is used; default: start of the record', &
      '/', &
      '', &
      '&stage       free=''c_D'',''m_H'',''c_H'',''k_H'' /']

   character(len=width), parameter :: paper_truth(*) = [character(len=width) :: &
      '&beam length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005 /', &
      '&tip m_T=0.15 /', &
      '&hose m_H=0.04, c_H=0.004, k_H=0.3 /', &
      '&discretization degree=5, elements=16 /', &
      '&excitation kind=''pulse'', amplitude=1.0, duration=0.05 /', &
      '&record t_first=0.02, t_last=5.0, t_step=0.02 /', &
      '&noise sd=0.02, seed=4 /']

contains

   !> Returns a first case file of the given kind and the record that goes with it.
   !>
   !> kind       one of `template_kinds`
   !> case_text  content of the case file, which expects the record in record.csv beside it
   !> record     content of record.csv: a simulated response with noise
   !> error      an unknown kind
   subroutine new_template(kind, case_text, record, error)
      character(len=*), intent(in) :: kind
      character(len=:), allocatable, intent(out) :: case_text, record
      type(error_t), allocatable, intent(out) :: error

      select case (kind)
      case ('free-decay')
         case_text = joined(free_decay_case)
         call make_record(free_decay_truth, by_case, record, error)
      case ('impulse')
         case_text = joined(impulse_case)
         call make_record(impulse_truth, by_case, record, error)
      case ('base')
         case_text = joined(base_case)
         call make_record(base_truth, by_base, record, error)
      case ('struck-bar')
         case_text = joined(bar_case)
         call make_record(bar_truth, by_mallet, record, error)
      case ('paper')
         case_text = joined(paper_case)
         call make_record(paper_truth, by_case, record, error)
      case default
         call bad_input(error, 'no such kind of case')
      end select
   end subroutine new_template

   !> Joins lines of text, without their trailing blanks, into the content of a file.
   pure function joined(lines) result(text)
      character(len=*), intent(in) :: lines(:)
      character(len=:), allocatable :: text
      integer :: k

      text = ''
      do k = 1, size(lines)
         text = text//trim(lines(k))//line_feed
      end do
   end function joined

   !> Simulates the record of a structure and adds noise.
   !>
   !> truth   lines of the case file with the true values
   !> motion  `by_case`, `by_base` or `by_mallet`
   !> record  content of a CSV file with the columns t, acceleration and, if the base moves, its
   !>         acceleration; of a bar that is struck, t and sound, which follows the acceleration
   !> error   a response that cannot be computed
   subroutine make_record(truth, motion, record, error)
      character(len=*), intent(in) :: truth(:)
      integer, intent(in) :: motion
      character(len=:), allocatable, intent(out) :: record
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(simulation_t) :: simulation
      type(text_t) :: table
      real(wp), allocatable :: times(:), noise(:), base(:)
      character(len=:), allocatable :: row
      integer :: k

      call parse_case('template', joined(truth), needs_nothing, case, error)
      if (.not. allocated(error)) call sample_times(case, times, error)
      if (allocated(error)) return
      allocate (base(0))
      if (motion == by_base) then
         base = base_pulse(times)
         call new_base_motion(times, base, case%model%excitation, error)
      else if (motion == by_mallet) then
         call strike(case, error)
      end if
      if (.not. allocated(error)) call simulate(case%model, case%meshes(1), times, &
         simulation, error)
      if (allocated(error)) return
      noise = gaussian_noise(size(times), case%noise_sd, case%noise_seed)
      call table%line('t,'//trim(merge('sound       ', 'acceleration', motion == by_mallet))// &
         trim(merge(',base', '     ', motion == by_base)))
      do k = 1, size(times)
         row = full(times(k))//','//full(simulation%acceleration(k) + noise(k))
         if (size(base) > 0) row = row//','//full(base(k))
         call table%line(row)
      end do
      record = table%content()
   end subroutine make_record

   !> Returns the acceleration [m/s**2] of a base that moves to and fro once within 20 ms: a period
   !> of a sine.
   elemental real(wp) function base_pulse(t)
      real(wp), intent(in) :: t
      real(wp), parameter :: length = 0.02_wp

      base_pulse = 0
      if (t < length) base_pulse = 30*sin(two_pi*t/length)
   end function base_pulse

   !> Lets a mallet strike the middle of the beam for 0.4 ms, with half a sine of 30 N.
   subroutine strike(case, error)
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: pieces = 40
      real(wp), parameter :: contact = 4e-4_wp, force = 30
      integer :: k

      call new_force_table([(contact*k/pieces, k=0, pieces)], &
         [(force*sin(pi*k/pieces), k=0, pieces - 1), 0.0_wp], case%model%excitation, error)
      case%model%structure%x_F = case%model%structure%length/2
   end subroutine strike

end module beamid_templates
