!> beamid <command> <case.nml> [--out DIR] [--quiet]
program beamid_main
   use beamid, only: error_t, version
   use beamid_errors, only: bad_input
   use beamid_strings, only: to_text
   use beamid_texts, only: text_t
   use beamid_comparison, only: run_compare
   use beamid_commands, only: run_identify, run_modes, run_simulate, settings_t, word_t
   use beamid_reproduction, only: reproducible, run_reproduce
   use beamid_terminal, only: complain, print_text
   implicit none

   type(settings_t) :: settings
   type(error_t), allocatable :: error

   call parse(settings, error)
   if (allocated(error)) then
      error%message = 'command line: '//error%message
   else
      select case (settings%command)
      case ('identify'); call run_identify(settings, error)
      case ('simulate'); call run_simulate(settings, error)
      case ('modes'); call run_modes(settings, error)
      case ('compare'); call run_compare(settings, error)
      case ('reproduce'); call run_reproduce(settings, error)
      case ('help'); call print_help(error)
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
      do while (k < command_argument_count() .and. .not. allocated(error))
         k = k + 1
         word = argument(k)
         select case (word)
         case ('--quiet'); settings%quiet = .true.
         case ('--time'); settings%time = .true.
         case ('--help', '-h', '--version')
            settings%command = trim(merge('version', 'help   ', word == '--version'))
            return
         case ('--out')
            k = k + 1
            settings%out = argument(k)
            if (k > command_argument_count()) then
               call bad_input(error, '--out: found nothing, expected a folder')
            else if (settings%out == '') then
               call bad_input(error, '--out: found an empty name, expected a folder')
            end if
         case default
            if (index(word, '-') == 1) then
               call bad_input(error, 'found '//word//', expected --out DIR, --quiet or --time')
            else if (.not. allocated(settings%command)) then
               settings%command = word
            else if (.not. allocated(settings%subject) .or. settings%command == 'compare') then
               if (.not. allocated(settings%subject)) settings%subject = word
               subject%text = word
               settings%subjects = [settings%subjects, subject]
            else
               call bad_input(error, 'found '//word//' behind '//settings%subject// &
                  ', expected nothing more')
            end if
         end select
      end do
      if (.not. allocated(error)) call check_command(settings, error)
   end subroutine parse

   !> Known command, with a subject where it needs one.
   subroutine check_command(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: commands = &
         'identify, simulate, modes, compare, reproduce, help or version'

      if (.not. allocated(settings%command)) then
         call bad_input(error, 'found no command, expected '//commands)
         return
      end if
      associate (command => settings%command, given => size(settings%subjects))
         select case (command)
         case ('help', 'version')
            if (given > 0) call bad_input(error, 'found '//settings%subject//' behind '// &
               command//', expected nothing')
         case ('identify', 'simulate', 'modes')
            if (given == 0) call bad_input(error, command// &
               ': found nothing, expected a case file')
         case ('compare')
            if (given < 2) call bad_input(error, 'compare: found '//to_text(given)// &
               ' case files, expected two or more')
         case ('reproduce')
            if (given == 0) call bad_input(error, &
               'reproduce: found nothing, expected '//reproducible)
         case default
            call bad_input(error, 'found '//command//', expected '//commands)
         end select
      end associate
   end subroutine check_command

   !> One word of the command line; empty behind the last.
   function argument(k) result(word)
      integer, intent(in) :: k
      character(len=:), allocatable :: word
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: word)
      call get_command_argument(k, word)
   end function argument

   !> beamid help
   subroutine print_help(error)
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: lines(*) = [character(len=90) :: &
         '', &
         'usage: beamid <command> [case.nml] [--out DIR] [--quiet]', &
         '', &
         '  identify case.nml     fit the free parameters of each stage to the record', &
         '  simulate case.nml     response of the structure at the sample times', &
         '  modes case.nml        natural frequencies and damping ratios', &
         '  compare a.nml b.nml   several models of one record: AICc, BIC, nested-model tests', &
         '  reproduce WHAT        results of NASA CR-178199 beside the paper''s numbers:', &
         '    table-4.1           simulated data, as the case file has it: CVODE', &
         '    section-4           Tables 4.2 to 4.6 from a reconstructed record: a check of', &
         '                        consistency, not an independent confirmation', &
         '    table-4.2 .. 4.6    one of them, table-4.2 and so on', &
         '    acceleration        what (4.1), (4.2) and (3.13) make of an integrator''s error', &
         '    convergence         Lemma 3.1 and Theorem 3.1 by numbers', &
         '    all                 table-4.1, by the exact response instead of CVODE, and', &
         '                        section-4, acceleration, convergence, each to out/<name>', &
         '                        or DIR/<name>', &
         '  help, version', &
         '', &
         '  --out DIR             folder of the outputs; left out: out/<case name>', &
         '  --quiet               no progress on standard error', &
         '  --time                identify: the time of a fit, on standard error', &
         '', &
         'Exit status: 0 done, 1 the computation failed, 2 bad input.']
      type(text_t) :: text
      integer :: k

      call text%line('beamid '//version// &
         ': physical parameters of a flexible beam from an accelerometer record')
      do k = 1, size(lines)
         call text%line(lines(k))
      end do
      call print_text(text%content(), error)
   end subroutine print_help

end program beamid_main
