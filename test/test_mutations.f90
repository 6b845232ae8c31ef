!> Seeded random damage to case files, records and force tables: whatever comes out, the program
!> ends
!> with status 0, 1 or 2 in reasonable time, and writes finite numbers or nothing.
program test_mutations
   use beamid_kinds, only: ip
   use beamid_strings, only: to_text
   use checks, only: check, finish, in_long_run, skip
   use random_numbers, only: pick, start_random
   use shell, only: close_shell, exists, line_count, open_shell, outcome_t, program_path, &
      read_file, &
      replaced, run, write_file
   implicit none

   character(len=*), parameter :: nl = achar(10)
   !> Few samples, loose tolerance, few steps, two elements: no single digit makes a run long.
   character(len=*), parameter :: pulse = 'kind=''pulse'', amplitude=1.0, duration=0.05', &
      case_text = &
      '! A short record of a coarse beam.'//nl// &
      '&beam           length=4.0, rho=0.03, E=0.8, I=1.0, c_D=0.005 /'//nl// &
      '&tip            m_T=0.15 /'//nl// &
      '&hose           m_H=0.04, c_H=0.004, k_H=0.3 /'//nl// &
      '&excitation     '//pulse//','//nl// &
      '                load=''distributed'', power=2.5 /'//nl// &
      '&discretization degree=3, elements=2, gauss_points=2, panels=4 /'//nl// &
      '&integrator     method=''cvode'', rtol=1e-4, atol=1e-7, max_order=5, max_steps=2000 /'// &
         nl// &
      '&observation    formula=''displacement_difference'', delta=0.1 /'//nl// &
      '&record         file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /'//nl// &
      '&stage          free=''m_H'',''k_H'', start=0.035,0.4, lower=0,0.1, upper=1,10 /'//nl// &
      '&stage          free=''E'' /'//nl// &
      '&noise          sd=0.01, seed=3 /'//nl// &
      '&units          length=''ft'', force=''lb'', time=''s'', mass=''slug'' /'//nl
   character(len=*), parameter :: record_text = '# accelerometer 3'//nl//'t,acceleration'//nl// &
      '0.1,0.29'//nl//'0.2,-0.97'//nl//'0.3,-1.28'//nl//'0.4,-1.27'//nl//'0.5,-9.5e-1'//nl// &
         '0.6,-0.43'//nl
   character(len=*), parameter :: force_text = 't,force'//nl//'0,1'//nl//'0.03,1.2'//nl// &
      '0.05,0.0'//nl

   !> What is run, and which file is damaged.
   type :: plan_t
      character(len=8) :: command
      character(len=10) :: file
      !> How many mutations in a long run, 2000 together. A short run makes half of them.
      integer :: number
   end type plan_t
   type(plan_t), parameter :: plans(*) = [ &
      plan_t('identify', 'case.nml', 500), plan_t('simulate', 'case.nml', 500), &
      plan_t('modes', 'case.nml', 300), plan_t('identify', 'record.csv', 400), &
      plan_t('simulate', 'force.csv', 200), plan_t('identify', 'force.csv', 100)]
   !> Longer than this is a hang [s].
   character(len=*), parameter :: patience = '20'

   type(plan_t) :: plan
   character(len=:), allocatable :: reason
   integer :: k, first

   call open_shell(reason)
   if (reason /= '') then
      call skip('mutations', reason)
   else
      call write_script()
      first = 1
      do k = 1, size(plans)
         plan = plans(k)
         if (.not. in_long_run()) plan%number = plan%number/2
         call test_plan(plan, first)
         first = first + plan%number
      end do
      call close_shell()
   end if
   call finish('mutations')

contains

   !> one.sh FOLDER: the command in the folder's file `command`, with its status in `status`.
   subroutine write_script()
      call write_file('one.sh', 'cd "$1" && read -r command <command'//nl// &
         'timeout '//patience//' "'//program_path//'" $command case.nml --quiet --out result '// &
         '>stdout 2>stderr </dev/null'//nl//'echo "$?" >status'//nl)
   end subroutine write_script

   !> Makes the mutations of a plan, runs them all by one command, and judges each.
   subroutine test_plan(plan, first)
      type(plan_t), intent(in) :: plan
      !> Number, and seed, of the first mutation.
      integer, intent(in) :: first
      character(len=200) :: stories(plan%number)
      character(len=80) :: detail
      character(len=:), allocatable :: fault
      type(outcome_t) :: outcome
      integer :: k, status, faults, counts(0:2)

      outcome = run('seq '//to_text(first)//' '//to_text(first + plan%number - 1)//' | xargs mkdir')
      do k = 1, plan%number
         call write_mutation(plan, first + k - 1, stories(k))
      end do
      ! One thread each, as many at a time as there are processors.
      outcome = run('export OMP_NUM_THREADS=1; seq '//to_text(first)//' '// &
         to_text(first + plan%number - 1)//' | xargs -P "$(nproc)" -I "{}" sh one.sh "{}"')
      call check(trim(plan%command)//', '//trim(plan%file)//': all were run', outcome%status == 0, &
         outcome%err)
      counts = 0
      faults = 0
      do k = 1, plan%number
         call judge(to_text(first + k - 1)//'/', status, fault)
         if (status >= 0 .and. status <= 2) counts(status) = counts(status) + 1
         if (fault == '') cycle
         faults = faults + 1
         call check('mutation '//to_text(first + k - 1)//', '//trim(plan%command)//', '// &
            trim(plan%file), &
            .false., trim(stories(k))//':'//fault)
      end do
      write (detail, '(3(a,i0))') 'status 0: ', counts(0), ', 1: ', counts(1), ', 2: ', counts(2)
      call check(trim(plan%command)//', '//trim(plan%file)//': '//to_text(plan%number)// &
         ' mutations', &
         faults == 0, trim(detail))
      call check(trim(plan%command)//', '//trim(plan%file)//': some accepted, some refused', &
         counts(0) > 0 .and. counts(2) > 0)
   end subroutine test_plan

   !> The folder of one mutation: the command and the three files, one of them damaged.
   subroutine write_mutation(plan, seed, story)
      type(plan_t), intent(in) :: plan
      integer, intent(in) :: seed
      !> What was done, in words.
      character(len=*), intent(out) :: story
      character(len=:), allocatable :: folder, case, record, force

      call start_random(int(mod(16807_ip*16807*seed, 2147483647_ip)), 16807)
      folder = to_text(seed)//'/'
      case = case_text
      record = record_text
      force = force_text
      ! Every third case takes its force from the table.
      if (plan%file == 'force.csv' .or. mod(seed, 3) == 0) case = replaced(case, pulse, &
         'kind=''table'', file=''force.csv''')
      if (mod(seed, 2) == 0) case = replaced(case, '''cvode''', '''modal''')
      if (mod(seed, 5) == 0) case = replaced(replaced(case, &
         'displacement_difference'', delta=0.1', &
         'equation'''), 'degree=3', 'degree=5')
      select case (plan%file)
      case ('case.nml'); call damage(case, story)
      case ('record.csv'); call damage(record, story)
      case ('force.csv'); call damage(force, story)
      end select
      call write_file(folder//'command', trim(plan%command)//nl)
      call write_file(folder//'case.nml', case)
      call write_file(folder//'record.csv', record)
      call write_file(folder//'force.csv', force)
   end subroutine write_mutation

   !> One to three accidents; every other one hits a digit.
   subroutine damage(text, story)
      character(len=:), allocatable, intent(inout) :: text
      character(len=*), intent(out) :: story
      integer :: times, k, at, length

      story = ''
      times = max(1, pick(6) - 3)
      do k = 1, times
         if (len(text) < 2) return
         at = place(text)
         length = min(pick(12), len(text) - at + 1)
         select case (pick(9) - 1)
         case (0)
            text = text(:at - 1)//text(at + 1:)
            call tell(story, at, 'dropped')
         case (1)
            text = text(:at)//text(at:)
            call tell(story, at, 'doubled')
         case (2)
            at = min(at, len(text) - 1)
            text = text(:at - 1)//text(at + 1:at + 1)//text(at:at)//text(at + 2:)
            call tell(story, at, 'swapped with the next')
         case (3)
            if (pick(4) == 1) text = text(:at - 1)
            call tell(story, at, 'end of the text, or nothing')
         case (4)
            text = text(:at - 1)//text(at + length:)
            call tell(story, at, 'dropped with some behind')
         case (5)
            text = text(:at + length - 1)//text(at:)
            call tell(story, at, 'doubled with some behind')
         case (6)
            text(at:at) = char(pick(256) - 1)
            call tell(story, at, 'any byte')
         case (7)
            text(at:at) = likely()
            call tell(story, at, 'now '//text(at:at))
         case (8)
            text = text(:at)//exponent()//text(at + 1:)
            call tell(story, at, 'given an exponent')
         end select
      end do

   end subroutine damage

   !> Adds one accident to the story.
   subroutine tell(story, at, what)
      character(len=*), intent(inout) :: story
      integer, intent(in) :: at
      character(len=*), intent(in) :: what

      story = trim(story)//' byte '//to_text(at)//' '//what//';'
   end subroutine tell

   !> A position: of any byte, or of a digit.
   integer function place(text)
      character(len=*), intent(in) :: text
      integer :: next

      place = pick(len(text))
      if (pick(2) == 1) return
      next = scan(text(place:), '0123456789')
      if (next > 0) place = place + next - 1
   end function place

   !> A byte that means something in such files.
   character(len=1) function likely()
      character(len=*), parameter :: letters = '0123456789.eEdD+-,;/=''"&!#*() '//achar(9)//nl// &
         achar(13)
      integer :: k

      k = pick(len(letters))
      likely = letters(k:k)
   end function likely

   !> Makes a number far too large or small, or leaves it (e0).
   function exponent() result(text)
      character(len=:), allocatable :: text
      character(len=*), parameter :: exponents(*) = [character(len=5) :: 'e0', 'e9', 'e-9', 'e20', &
         'e-20', &
         'e99', 'e-99', 'e300', 'e-300', 'e999']

      text = trim(exponents(pick(size(exponents))))
   end function exponent

   !> What a run did wrong; '' for nothing.
   subroutine judge(folder, status, fault)
      character(len=*), intent(in) :: folder
      integer, intent(out) :: status
      character(len=:), allocatable, intent(out) :: fault
      character(len=:), allocatable :: message
      integer :: failed

      fault = ''
      message = read_file(folder//'status')
      read (message, *, iostat=failed) status
      if (failed /= 0) status = -1
      message = read_file(folder//'stderr')
      select case (status)
      case (0:2)
         if (status == 0 .neqv. message == '') fault = fault//' a message and success, or neither;'
         if (status > 0 .and. index(message, 'beamid: ') /= 1) fault = fault//' no message;'
         if (line_count(message) > merge(1, 20, status == 1)) fault = fault//' too many lines;'
         if (status == 0 .or. status == 1 .and. index(message, ': no fit: ') > 0) then
            if (read_file(folder//'result/summary.txt') /= read_file(folder//'stdout')) &
               fault = fault//' summary.txt is not standard output;'
            if (not_finite(folder)) fault = fault//' a number that is not finite;'
         else
            if (read_file(folder//'stdout') /= '') fault = fault//' standard output used;'
            if (exists(folder//'result')) fault = fault//' output written;'
         end if
      case (124)
         fault = ' hangs;'
      case default
         fault = ' status '//to_text(status)//';'
      end select
      if (fault /= '') fault = fault//' '//message(:min(len(message), 300))
   end subroutine judge

   !> Whether an output file holds a NaN, an infinity or a number that did not fit its field.
   logical function not_finite(folder)
      character(len=*), intent(in) :: folder
      character(len=*), parameter :: files(*) = [character(len=13) :: 'estimates.csv', 'fit.csv', &
         'response.csv', 'record.csv', 'modes.csv', 'summary.txt']
      character(len=:), allocatable :: text
      integer :: k

      not_finite = .false.
      do k = 1, size(files)
         text = read_file(folder//'result/'//trim(files(k)))
         not_finite = not_finite .or. index(text, 'NaN') > 0 .or. index(text, 'Inf') > 0 .or. &
            index(text, '**') > 0
      end do
   end function not_finite

end program test_mutations
