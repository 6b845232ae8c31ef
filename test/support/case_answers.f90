!> Writes the record and the case of a simulated beam, runs `beamid identify` and reads its answer.
module case_answers
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: to_text
   use checks, only: check, check_close
   use shell, only: beamid, outcome_t, read_file, remove_tree, write_file
   use simulated_beams, only: beam_t
   use tables, only: field, line, number, part
   implicit none
   private

   public :: answer_t, cell, identified, check_estimates, check_refused, modal_record, &
      write_record, times, groups_of, dip_case, nl, ruler

   character(len=*), parameter :: nl = new_line('a')
   !> A case with the free decay of a steel ruler; what is free is a guess.
   character(len=*), parameter :: ruler = &
      '&units length=''m'', force=''N'', time=''s'', mass=''kg'' /'//nl// &
      '&beam length=0.3, width=0.025, height=0.001, density=7850, E=2.0e11, c_D=4e6, '// &
      'gamma=0.05 /'//nl// &
      '&sensor m_S=0.005, x_S=0.28 /'//nl// &
      '&excitation kind=''free'', modes=3 /'//nl// &
      '&record file=''record.csv'' /'//nl// &
      '&stage free=''E'',''m_S'',''c_D'',''gamma'',''offset'' /'//nl
   !> Folder of the outputs.
   character(len=*), parameter :: folder = 'o'

   !> The answer of the program to one case.
   type :: answer_t
      integer :: status = -1                      !< exit status
      character(len=:), allocatable :: head       !< standard output before the line on record 1
      character(len=:), allocatable :: out, err   !< standard output and standard error
      character(len=:), allocatable :: estimates, modes, tests   !< tables; '': not written
   contains
      procedure :: estimate, is_determined, holds, is_honest, is_free, verdict_on_mode, test_matters
   end type answer_t

contains

   !> Runs the program on a case.
   !>
   !> text  text of the case file
   function identified(text) result(answer)
      character(len=*), intent(in) :: text
      type(answer_t) :: answer
      type(outcome_t) :: outcome
      integer :: length

      call remove_tree(folder)
      call write_file('case.nml', text)
      outcome = beamid('identify case.nml --quiet --out '//folder)
      answer%status = outcome%status
      answer%out = outcome%out
      answer%err = outcome%err
      length = index(outcome%out, 'record 1: ') - 1
      if (length < 0) length = len(outcome%out)
      answer%head = outcome%out(:length)
      answer%estimates = read_file(folder//'/estimates.csv')
      answer%modes = read_file(folder//'/modes_seen.csv')
      answer%tests = read_file(folder//'/score_tests.csv')
   end function identified

   !> Returns the text of a column of estimates.csv for a parameter; '' if there is no such row.
   function estimate(self, parameter, column) result(text)
      class(answer_t), intent(in) :: self
      character(len=*), intent(in) :: parameter, column
      character(len=:), allocatable :: text

      text = cell(self%estimates, 'parameter', parameter, column)
   end function estimate

   !> Returns whether a parameter counts as determined.
   logical function is_determined(self, parameter)
      class(answer_t), intent(in) :: self
      character(len=*), intent(in) :: parameter

      is_determined = self%estimate(parameter, 'determined') == 'yes'
   end function is_determined

   !> Returns whether a parameter has been estimated.
   logical function is_free(self, parameter)
      class(answer_t), intent(in) :: self
      character(len=*), intent(in) :: parameter

      is_free = self%estimate(parameter, 'estimate') /= ''
   end function is_free

   !> Returns whether the total interval of a parameter holds a value. An end that the table leaves
   !> empty is unlimited; a parameter that is not in the table holds nothing.
   logical function holds(self, parameter, value)
      class(answer_t), intent(in) :: self
      character(len=*), intent(in) :: parameter
      real(wp), intent(in) :: value
      character(len=:), allocatable :: lower, upper

      lower = self%estimate(parameter, 'total_lower95')
      upper = self%estimate(parameter, 'total_upper95')
      holds = self%is_free(parameter)
      if (lower /= '') holds = holds .and. number(lower) <= value
      if (upper /= '') holds = holds .and. number(upper) >= value
   end function holds

   !> Returns whether each of some parameters that counts as determined has its true value in its
   !> total interval.
   !>
   !> parameters, values  (n) names and true values
   logical function is_honest(self, parameters, values)
      class(answer_t), intent(in) :: self
      character(len=*), intent(in) :: parameters(:)
      real(wp), intent(in) :: values(:)
      integer :: k

      is_honest = self%status == 0
      do k = 1, size(values)
         if (self%is_determined(trim(parameters(k)))) is_honest = is_honest .and. &
            self%holds(trim(parameters(k)), values(k))
      end do
   end function is_honest

   !> Returns the verdict of modes_seen.csv on a mode; '' if there is no such row.
   !>
   !> mode  number of the mode; 0: the first line without a mode
   function verdict_on_mode(self, mode) result(text)
      class(answer_t), intent(in) :: self
      integer, intent(in) :: mode
      character(len=:), allocatable :: text

      text = cell(self%modes, 'mode', to_text(mode), 'verdict')
   end function verdict_on_mode

   !> Returns whether a score test matters.
   logical function test_matters(self, parameter)
      class(answer_t), intent(in) :: self
      character(len=*), intent(in) :: parameter

      test_matters = cell(self%tests, 'parameter', parameter, 'matters') == 'yes'
   end function test_matters

   !> Returns the text in a column of a table, of the first row that has a word in another column;
   !> '' if there is no such row or column.
   function cell(table, key_column, key, column) result(text)
      character(len=*), intent(in) :: table, key_column, key, column
      character(len=:), allocatable :: text
      integer :: k, key_place, place

      text = ''
      key_place = place_of(line(table, 1), key_column)
      place = place_of(line(table, 1), column)
      if (key_place == 0 .or. place == 0) return
      k = 1
      do while (line(table, k + 1) /= '')
         if (field(table, k, key_place) == key) then
            text = field(table, k, place)
            return
         end if
         k = k + 1
      end do
   end function cell

   !> Returns the number of a column; 0 if the header does not have it.
   pure integer function place_of(header, column)
      character(len=*), intent(in) :: header, column
      integer, parameter :: most = 40

      do place_of = 1, most
         if (part(header, place_of, ',') == column) return
      end do
      place_of = 0
   end function place_of

   !> Returns m sample times at a rate [Hz], the first one step after 0 [s].
   pure function times(m, rate) result(t)
      integer, intent(in) :: m
      real(wp), intent(in) :: rate
      real(wp) :: t(m)
      integer :: k

      t = [(k, k=1, m)]/rate
   end function times

   !> Writes record.csv, with noise.
   !>
   !> t, a  (m) times [s] and accelerations [m/s^2]
   !> sd    standard deviation of the noise [m/s^2]
   !> seed  of the noise
   !> bare  .true.: without the column of times
   subroutine write_record(t, a, sd, seed, bare)
      real(wp), intent(in) :: t(:), a(:), sd
      integer, intent(in) :: seed
      logical, intent(in), optional :: bare
      character(len=60) :: rows(size(t))
      real(wp) :: measured(size(t))
      logical :: has_times
      integer :: k

      has_times = .true.
      if (present(bare)) has_times = .not. bare
      measured = a + gaussian_noise(size(t), sd, seed)
      do k = 1, size(t)
         if (has_times) write (rows(k), '(f0.7, a, f0.5, a)') t(k), ',', measured(k), nl
         if (.not. has_times) write (rows(k), '(f0.5, a)') measured(k), nl
      end do
      call write_file('record.csv', trim(merge('t,a', 'a  ', has_times))//nl//joined(rows))
   end subroutine write_record

   !> Returns lines one behind the other, without trailing blanks.
   pure function joined(rows) result(text)
      character(len=*), intent(in) :: rows(:)
      character(len=:), allocatable :: text
      character(len=size(rows)*len(rows)) :: buffer
      integer :: k, length

      length = 0
      do k = 1, size(rows)
         associate (n => len_trim(rows(k)))
            buffer(length + 1:length + n) = rows(k)
            length = length + n
         end associate
      end do
      text = buffer(:length)
   end function joined

   !> Returns the groups &beam, &sensor and &record of a case with the values of a beam. Its sensor
   !> is left out if it has no mass.
   function groups_of(beam) result(text)
      type(beam_t), intent(in) :: beam
      character(len=:), allocatable :: text

      text = '&beam length='//to_text(beam%length)//', width='//to_text(beam%width)// &
         ', height='//to_text(beam%height)//', density='//to_text(beam%density)//', E='// &
         to_text(beam%E)//', c_D='//to_text(beam%c_D)//', gamma='//to_text(beam%gamma)//' /'//nl
      if (beam%m_S > 0) text = text//'&sensor m_S='//to_text(beam%m_S)//', x_S='// &
         to_text(beam%x_S)//' /'//nl
      text = text//'&record file=''record.csv'' /'//nl
   end function groups_of

   !> Returns a case that looks for a dip after a pulse of 5 ms. It starts 2 % off in E, with a wide
   !> and shallow dip at two fifths of the length.
   !>
   !> amplitude  of the pulse [N]
   function dip_case(beam, amplitude) result(text)
      type(beam_t), intent(in) :: beam
      integer, intent(in) :: amplitude
      character(len=:), allocatable :: text
      type(beam_t) :: guess

      guess = beam
      guess%E = 1.02_wp*beam%E
      text = groups_of(guess)//'&along kind=''dip'', place='//to_text(0.4_wp*beam%length)// &
         ', width='//to_text(0.08_wp*beam%length)//', depth=0.1 /'//nl// &
         '&excitation kind=''pulse'', amplitude='//to_text(amplitude)//', duration=0.005 /'//nl// &
         '&discretization degree=3, elements=8 /'//nl// &
         '&stage free=''E'',''c_D'',''gamma'',''place'',''width'',''depth'' /'//nl
   end function dip_case

   !> Checks the estimates of a case.
   !>
   !> names, values  of the parameters
   !> share          allowed relative error
   subroutine check_estimates(label, text, names, values, share)
      character(len=*), intent(in) :: label, text, names(:)
      real(wp), intent(in) :: values(:), share
      type(answer_t) :: answer
      integer :: k

      answer = identified(text)
      call check(label//': status', answer%status == 0, answer%err)
      do k = 1, size(names)
         call check_close(label//': '//trim(names(k)), number(answer%estimate(trim(names(k)), &
            'estimate')), values(k), share*values(k))
      end do
   end subroutine check_estimates

   !> Checks that a command refuses a case.
   !>
   !> status  expected exit status
   subroutine check_refused(label, status, command, text, message)
      character(len=*), intent(in) :: label, command, text, message
      integer, intent(in) :: status
      type(outcome_t) :: outcome

      call write_file('refused.nml', text)
      outcome = beamid(command//' refused.nml')
      call check('refused: '//label, outcome%status == status .and. index(outcome%err, message) &
         > 0, outcome%err)
   end subroutine check_refused

   !> Returns a table of the five lowest modes as a record, with errors of 0.1 % in the frequencies
   !> and of 1 % in the damping ratios.
   !>
   !> table  modes.csv
   function modal_record(table) result(modes)
      character(len=*), intent(in) :: table
      character(len=:), allocatable :: modes, value
      integer :: column, row

      modes = 'mode,frequency_hz,sd_hz,damping_ratio,sd_damping'//nl
      do row = 1, 5
         modes = modes//to_text(row)
         do column = 3, 4
            value = field(table, row, column)
            modes = modes//','//value//','//to_text(merge(1e-3_wp, 1e-2_wp, column == 3) &
               *number(value))
         end do
         modes = modes//nl
      end do
   end function modal_record

end module case_answers
