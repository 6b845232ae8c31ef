!> A good case, a good record and a good force table; and what is asked for where one change makes
!> one of them bad: status 2 and one line on standard error, and nothing written.
module bad_cases
   use beamid_kinds, only: wp
   use checks, only: check
   use shell, only: beamid, exists, has_all, line_count, outcome_t, remove_tree, replaced, &
      write_file
   implicit none
   private

   public :: nl, cr, tab, mark, folder, case_text, pulse, table, record_text, force_text
   public :: carrying, group, named, freeing
   public :: refused, refused_case, refused_record, refused_force, refused_now, refused_command, &
      judge, accepted, write_good_files

   character(len=*), parameter :: nl = achar(10), cr = achar(13), tab = achar(9), &
      mark = char(239)//char(187)//char(191), folder = 'bad/'
   character(len=*), parameter :: case_text = &
      '! A short record of a coarse beam.'//nl// &
      '&beam           length=4.0, rho=0.03, E=80.0, I=1.0,'//nl// &
      '                c_D=0.005 /'//nl// &
      '&tip            m_T=0.15 /'//nl// &
      '&hose           m_H=0.04, c_H=0.004, k_H=0.3 /'//nl// &
      '&excitation     kind=''pulse'', amplitude=1.0, duration=0.05,'//nl// &
      '                load=''point'', power=2.0 /'//nl// &
      '&discretization degree=3, elements=2, gauss_points=2, panels=4 /'//nl// &
      '&integrator     method=''cvode'', rtol=1e-8, atol=1e-11, max_order=5, max_steps=20000 /'// &
         nl// &
      '&observation    formula=''displacement_difference'', delta=0.1 /'//nl// &
      '&record         file=''record.csv'', t_first=0.1, t_last=0.6, t_step=0.1 /'//nl// &
      '&stage          free=''m_H'',''k_H'', start=0.035,0.4, lower=0,0.1, upper=1,10 /'//nl// &
      '&units          length=''ft'', force=''lb'', time=''s'', mass=''slug'' /'//nl
   character(len=*), parameter :: pulse = 'kind=''pulse'', amplitude=1.0, duration=0.05', &
      table = 'kind=''table'', file=''force.csv'''
   character(len=*), parameter :: record_text = &
      't,acceleration'//nl// &
      '0.1,0.29'//nl// &
      '0.2,-0.97'//nl// &
      '0.3,-1.28'//nl// &
      '0.4,-1.27'//nl// &
      '0.5,-0.95'//nl// &
      '0.6,-0.43'//nl
   character(len=*), parameter :: force_text = 't,force'//nl//'0,1'//nl//'0.03,1.2'//nl// &
      '0.05,0'//nl

contains

   !> The case with more groups behind &tip, in line 5 and after.
   function carrying(groups) result(text)
      character(len=*), intent(in) :: groups
      character(len=:), allocatable :: text

      text = replaced(case_text, 'm_T=0.15 /', 'm_T=0.15 /'//groups)
   end function carrying

   !> A line with a group.
   function group(name, keys) result(line)
      character(len=*), intent(in) :: name, keys
      character(len=:), allocatable :: line

      line = nl//'&'//name//' '//keys//' /'
   end function group

   !> As many groups, each with a name and a place of its own.
   function named(name, key, n) result(lines)
      character(len=*), intent(in) :: name, key
      integer, intent(in) :: n
      character(len=:), allocatable :: lines
      character(len=40) :: keys
      integer :: k

      lines = ''
      do k = 1, n
         write (keys, '(a,i0,a,f3.1)') 'name="n', k, '", '//key//'=', 0.2_wp*k
         lines = lines//group(name, trim(keys))
      end do
   end function named

   !> A case with other free parameters, bounds and starts.
   function freeing(text, keys) result(changed)
      character(len=*), intent(in) :: text, keys
      character(len=:), allocatable :: changed

      changed = replaced(text, 'free=''m_H'',''k_H'', start=0.035,0.4, lower=0,0.1, upper=1,10', &
         'free='//keys)
   end function freeing

   !> A change of the case file is refused; `words` follow the file's name and a colon.
   subroutine refused(what, old, new, words, command, file, lines)
      character(len=*), intent(in) :: what, old, new, words
      character(len=*), intent(in), optional :: command, file
      integer, intent(in), optional :: lines
      character(len=:), allocatable :: verb, place

      verb = 'identify'
      if (present(command)) verb = command
      call write_good_files(replaced(case_text, old, new))
      place = 'case.nml|'
      if (scan(words(:1), '0123456789') > 0) place = 'case.nml:'
      if (present(file)) place = ''
      call refused_now(what, verb, 'case.nml', place//words, lines)
   end subroutine refused

   !> A case of its own is refused.
   subroutine refused_case(what, text, words, command, record)
      character(len=*), intent(in) :: what, text, words
      character(len=*), intent(in), optional :: command, record
      character(len=:), allocatable :: verb, place

      verb = 'identify'
      if (present(command)) verb = command
      call write_good_files(text)
      if (present(record)) call write_file(folder//'record.csv', record)
      place = ''
      if (scan(words(:1), '0123456789') > 0) place = 'case.nml:'
      call refused_now(what, verb, 'case.nml', place//words)
   end subroutine refused_case

   !> A change of the record is refused.
   subroutine refused_record(what, old, new, words)
      character(len=*), intent(in) :: what, old, new, words

      call write_good_files()
      call write_file(folder//'record.csv', replaced(record_text, old, new))
      call refused_now('record: '//what, 'identify', 'case.nml', words)
   end subroutine refused_record

   !> A change of the force table is refused.
   subroutine refused_force(what, old, new, words)
      character(len=*), intent(in) :: what, old, new, words

      call write_good_files(replaced(case_text, pulse, table))
      call write_file(folder//'force.csv', replaced(force_text, old, new))
      call refused_now('force table: '//what, 'simulate', 'case.nml', 'force.csv|'//words)
   end subroutine refused_force

   !> Runs a command on a case file as it stands now.
   subroutine refused_now(what, command, file, words, lines)
      character(len=*), intent(in) :: what, command, file, words
      integer, intent(in), optional :: lines
      integer :: allowed

      allowed = 1
      if (present(lines)) allowed = lines
      call judge(command//': '//what, beamid(command//' '//file//' --quiet --out result', 'bad'), &
         words, allowed)
   end subroutine refused_now

   !> One check per row: status, message, and nothing written.
   subroutine judge(what, outcome, words, lines)
      character(len=*), intent(in) :: what, words
      type(outcome_t), intent(in) :: outcome
      !> The most lines that the message may have; 1 in most rows.
      integer, intent(in) :: lines
      character(len=:), allocatable :: fault
      character(len=12) :: status

      fault = ''
      write (status, '(i0)') outcome%status
      if (outcome%status /= 2) fault = fault//' status '//trim(status)//', expected 2;'
      if (line_count(outcome%err) < 1 .or. line_count(outcome%err) > lines) fault = fault// &
         ' not one line;'
      if (index(outcome%err, 'beamid: ') /= 1) fault = fault//' not from beamid;'
      if (.not. has_all(outcome%err, words)) fault = fault//' not with '//words//';'
      if (outcome%out /= '') fault = fault//' standard output used;'
      if (exists(folder//'result') .or. exists(folder//'out')) fault = fault//' output written;'
      call check(what, fault == '', fault//' '//outcome%err(:max(0, len(outcome%err) - 1)))
      if (index(fault, 'written') > 0) call remove_tree('bad')
   end subroutine judge

   !> A case that must pass. A model need not explain the six numbers of the record, which are those
   !> of another one.
   subroutine accepted(what, command, text, record, force, without_stage)
      character(len=*), intent(in) :: what, command, text
      character(len=*), intent(in), optional :: record, force
      logical, intent(in), optional :: without_stage
      type(outcome_t) :: outcome
      character(len=:), allocatable :: changed

      changed = text
      if (present(without_stage)) changed = replaced(text, '&stage ', '! ')
      call write_good_files(changed)
      if (present(record)) call write_file(folder//'record.csv', record)
      if (present(force)) call write_file(folder//'force.csv', force)
      outcome = beamid(command//' case.nml --quiet --out result', 'bad')
      call check(command//': '//what//' is accepted', (outcome%status == 0 &
         .and. outcome%err == '' .or. outcome%status == 1 .and. &
         index(outcome%out, 'no fit: the residuals are larger') == 1) &
         .and. outcome%out /= '' .and. &
         exists(folder//'result/summary.txt'), outcome%out//'//'//outcome%err)
      call remove_tree(folder//'result')
   end subroutine accepted

   !> The three files, good but for the case where `text` is given.
   subroutine write_good_files(text)
      character(len=*), intent(in), optional :: text

      if (present(text)) then
         call write_file(folder//'case.nml', text)
      else
         call write_file(folder//'case.nml', case_text)
      end if
      call write_file(folder//'record.csv', record_text)
      call write_file(folder//'force.csv', force_text)
   end subroutine write_good_files

   !> Checks that a command line is refused: status 2, one line, nothing on standard output.
   !>
   !> words    that the line holds, separated by '|'
   !> outcome  of the command
   subroutine refused_command(arguments, words, outcome)
      character(len=*), intent(in) :: arguments, words
      type(outcome_t), intent(out), optional :: outcome
      type(outcome_t) :: found

      found = beamid(arguments)
      call check(arguments//': refused', found%status == 2 .and. found%out == '' .and. &
         line_count(found%err) == 1 .and. has_all(found%err, words), found%err)
      if (present(outcome)) outcome = found
   end subroutine refused_command

end module bad_cases
