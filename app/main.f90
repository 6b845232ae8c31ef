!> beamid <command> <case.nml> [--out DIR] [--quiet]
program beamid_main
   use beamid, only: error_t, version
   use beamid_commands, only: run_identify, run_modes, run_simulate, settings_t, word_t
   use beamid_comparison, only: run_compare
   use beamid_errors, only: bad_input
   use beamid_reproduction, only: reproducible, run_reproduce
   use beamid_strings, only: to_text
   use beamid_terminal, only: complain, print_text
   implicit none

   type(settings_t) :: settings
   type(error_t), allocatable :: error

   call parse(settings, error)
   if (.not. allocated(error)) then
      select case (settings%command)
      case ('identify'); call run_identify(settings, error)
      case ('simulate'); call run_simulate(settings, error)
      case ('modes'); call run_modes(settings, error)
      case ('compare'); call run_compare(settings, error)
      case ('reproduce'); call run_reproduce(settings, error)
      case ('help'); call print_text(help(), error)
      case ('version'); call print_text('beamid '//version//new_line('a'), error)
      end select
   end if
   if (allocated(error)) then
      call complain(error%message)
      stop error%status, quiet=.true.
   end if

contains

   !> Splits the command line; whatever is not understood is bad input.
   subroutine parse(settings, error)
      type(settings_t), intent(out) :: settings
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      type(word_t) :: subject
      integer :: k

      k = 0
      allocate (settings%subjects(0))
      do while (k < command_argument_count())
         k = k + 1
         word = argument(k)
         if (word == '--quiet') then
            settings%quiet = .true.
         else if (word == '--time') then
            settings%time = .true.
         else if (word == '--out') then
            k = k + 1
            if (k <= command_argument_count()) settings%out = argument(k)
            if (.not. allocated(settings%out)) then
               call bad_input(error, 'command line: --out: found nothing, expected a folder')
               return
            else if (settings%out == '') then
               call bad_input(error, 'command line: --out: found an empty name, expected a folder')
               return
            end if
         else if (word == '--help' .or. word == '-h') then
            settings%command = 'help'
            return
         else if (word == '--version') then
            settings%command = 'version'
            return
         else if (index(word, '-') == 1) then
            call bad_input(error, 'command line: found '//word// &
               ', expected --out DIR, --quiet or --time')
            return
         else if (.not. allocated(settings%command)) then
            settings%command = word
         else if (.not. allocated(settings%subject) .or. settings%command == 'compare') then
            if (.not. allocated(settings%subject)) settings%subject = word
            subject%text = word
            settings%subjects = [settings%subjects, subject]
         else
            call bad_input(error, 'command line: found '//word//' behind '//settings%subject// &
               ', expected nothing more')
            return
         end if
      end do
      call check_command(settings, error)
   end subroutine parse

   !> Known command, with a subject where it needs one.
   subroutine check_command(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: commands = &
         'identify, simulate, modes, compare, reproduce, help or version'

      if (.not. allocated(settings%command)) then
         call bad_input(error, 'command line: found no command, expected '//commands)
         return
      end if
      select case (settings%command)
      case ('help', 'version')
         if (allocated(settings%subject)) call bad_input(error, 'command line: found '// &
            settings%subject//' behind '//settings%command//', expected nothing')
      case ('identify', 'simulate', 'modes')
         if (.not. allocated(settings%subject)) call bad_input(error, 'command line: '// &
            settings%command//': found nothing, expected a case file')
      case ('compare')
         if (size(settings%subjects) < 2) call bad_input(error, &
            'command line: compare: found '//to_text(size(settings%subjects))// &
               ' case files, expected two or more')
      case ('reproduce')
         if (.not. allocated(settings%subject)) call bad_input(error, &
            'command line: reproduce: found nothing, expected '//reproducible)
      case default
         call bad_input(error, 'command line: found '//settings%command//', expected '//commands)
      end select
   end subroutine check_command

   !> One word of the command line.
   function argument(k) result(word)
      integer, intent(in) :: k
      character(len=:), allocatable :: word
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: word)
      call get_command_argument(k, word)
   end function argument

   !> The text of `beamid help`.
   function help() result(text)
      character(len=:), allocatable :: text
      character(len=*), parameter :: nl = new_line('a')

      text = 'beamid '//version// &
         ': physical parameters of a flexible beam from an accelerometer record'//nl// &
         nl// &
         'usage: beamid <command> [case.nml] [--out DIR] [--quiet]'//nl// &
         nl// &
         '  identify case.nml     fit the free parameters of each stage to the record'//nl// &
         '  simulate case.nml     response of the structure at the sample times'//nl// &
         '  modes case.nml        natural frequencies and damping ratios'//nl// &
         '  compare a.nml b.nml   several models of one record: AICc, BIC, nested-model tests'// &
            nl// &
         '  reproduce WHAT        results of NASA CR-178199 beside the paper''s numbers:'//nl// &
         '    table-4.1           simulated data, as the case file has it: CVODE'//nl// &
         '    section-4           Tables 4.2 to 4.6 from a reconstructed record: a check of'//nl// &
         '                        consistency, not an independent confirmation'//nl// &
         '    table-4.2 .. 4.6    one of them, table-4.2 and so on'//nl// &
         '    acceleration        what (4.1), (4.2) and (3.13) make of an integrator''s error'// &
            nl// &
         '    convergence         Lemma 3.1 and Theorem 3.1 by numbers'//nl// &
         '    all                 table-4.1, by the exact response instead of CVODE, and'//nl// &
         '                        section-4, acceleration, convergence, each to out/<name>'//nl// &
         '                        or DIR/<name>'//nl// &
         '  help, version'//nl// &
         nl// &
         '  --out DIR             folder of the outputs; left out: out/<case name>'//nl// &
         '  --quiet               no progress on standard error'//nl// &
         '  --time                identify: the time of a fit, on standard error'//nl// &
         nl// &
         'Exit status: 0 done, 1 the computation failed, 2 bad input.'//nl
   end function help

end program beamid_main
