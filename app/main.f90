!> The main program: beamid <command> <case.nml> [--out DIR] [--quiet]. It parses the command line,
!> calls the routine of the command, prints an error message and sets the exit status.
program beamid_main
   use beamid, only: error_t, version
   use beamid_command_table, only: command_names, commands_in_words
   use beamid_commands, only: run_identify, run_inference, run_on_case, settings_t
   use beamid_comparison, only: run_compare
   use beamid_ensemble, only: run_ensemble
   use beamid_errors, only: bad_input
   use beamid_interrupts, only: check_interrupt
   use beamid_manual, only: run_help
   use beamid_new_case, only: check_new, run_new
   use beamid_reproduction, only: reproducible, run_reproduce
   use beamid_signals, only: catch_signals, end_by_signal, stop_patience
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: append_string, string_t, to_text
   use beamid_terminal, only: complain, print_text
   use beamid_track, only: run_track
   implicit none

   type(settings_t) :: settings
   type(error_t), allocatable :: error

   call catch_signals()
   call parse(settings, error)
   if (allocated(error)) then
      error%message = 'command line: '//error%message
   else
      select case (settings%command)
      case ('identify'); call run_identify(settings, error)
      case ('simulate', 'modes', 'frf', 'design'); call run_on_case(settings, error)
      case ('profile', 'sample', 'bootstrap'); call run_inference(settings, error)
      case ('compare'); call run_compare(settings, error)
      case ('track'); call run_track(settings, error)
      case ('reproduce'); call run_reproduce(settings, error)
      case ('ensemble'); call run_ensemble(settings, error)
      case ('new'); call run_new(settings, error)
      case ('help'); call run_help(words_of(settings%subjects), settings%markdown, error)
      case ('version'); call print_text('beamid '//version//new_line('a'), error)
      end select
   end if
   call check_interrupt(error)
   if (allocated(error)) then
      call stop_patience()
      call complain(error%message)
      call end_by_signal()
      stop error%status, quiet=.true.
   end if

contains

   !> Parses the command line; any word that is not understood is an error.
   subroutine parse(settings, error)
      type(settings_t), intent(out) :: settings
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: word
      integer :: k

      k = 0
      allocate (settings%subjects(0))
      do while (k < command_argument_count() .and. .not. allocated(error))
         k = k + 1
         word = argument(k)
         select case (word)
         case ('--quiet'); settings%quiet = .true.
         case ('--time'); settings%time = .true.
         case ('--only-new'); settings%only_new = .true.
         case ('--markdown'); settings%markdown = .true.
         case ('--damping', '--damping=ratios')
            settings%damping = .true.
            settings%by_ratios = word /= '--damping'
         case ('--only')
            k = k + 1
            settings%only = argument(k)
         case ('--version')
            settings%command = 'version'
            return
         case ('--help', '-h')
            ! Behind a command, --help asks about this command.
            deallocate (settings%subjects)
            allocate (settings%subjects(0))
            if (allocated(settings%command)) then
               if (any(command_names() == settings%command)) &
                  call append_string(settings%subjects, settings%command)
            end if
            settings%command = 'help'
            settings%markdown = .false.
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
            call take_word(word, settings, error)
         end select
      end do
      if (.not. allocated(error)) call check_command(settings, error)
   end subroutine parse

   !> Takes a word that is no option: the command, or what the command is about.
   subroutine take_word(word, settings, error)
      character(len=*), intent(in) :: word
      type(settings_t), intent(inout) :: settings
      type(error_t), allocatable, intent(out) :: error

      if (index(word, '-') == 1) then
         call bad_input(error, 'found '//word//', expected --out DIR, --quiet or --time')
      else if (.not. allocated(settings%command)) then
         settings%command = word
      else if (.not. allocated(settings%subject) .or. any(settings%command == &
         [character(len=7) :: 'compare', 'help', 'new'])) then
         if (.not. allocated(settings%subject)) settings%subject = word
         call append_string(settings%subjects, word)
      else
         call bad_input(error, 'found '//word//' behind '//settings%subject// &
            ', expected nothing more')
      end if
   end subroutine take_word

   !> Checks that the command is known and has the words behind it that it needs.
   subroutine check_command(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: suggestion

      if (.not. allocated(settings%command)) then
         call bad_input(error, 'found no command, expected '//commands_in_words())
         return
      end if
      associate (command => settings%command, given => size(settings%subjects))
         select case (command)
         case ('help')
            if (settings%markdown .and. given > 0) call bad_input(error, 'found '// &
               settings%subject//' beside help --markdown, expected nothing more')
         case ('new')
            call check_new(words_of(settings%subjects), error)
            if (.not. allocated(error) .and. allocated(settings%out)) call bad_input(error, &
               'new: found --out, expected the folder behind the kind')
         case ('version')
            if (given > 0) call bad_input(error, 'found '//settings%subject//' behind '// &
               command//', expected nothing')
         case ('identify', 'simulate', 'modes', 'frf', 'profile', 'sample', 'bootstrap', 'design', &
            'ensemble', 'track')
            if (given == 0) call bad_input(error, command// &
               ': found nothing, expected a case file')
         case ('compare')
            if (settings%damping .and. given /= 1) call bad_input(error, 'compare --damping: '// &
               'found '//to_text(given)//' case files, expected one')
            if (given < 2 .and. .not. settings%damping) call bad_input(error, 'compare: found '// &
               to_text(given)//' case files, expected two or more, or --damping and one')
         case ('reproduce')
            if (given == 0) call bad_input(error, &
               'reproduce: found nothing, expected '//reproducible)
         case ('report', 'plot', 'to-csv', 'studio')
            call bad_input(error, 'found '//command//', a command of the Python package '// &
               '(in a checkout: .venv/bin/beamid), expected '//commands_in_words())
         case default
            call or_nearest(command, command_names(), suggestion)
            call bad_input(error, 'found '//command//', expected '//commands_in_words()//suggestion)
         end select
         if (.not. allocated(error) .and. command /= 'ensemble' .and. (settings%only_new .or. &
            allocated(settings%only))) call bad_input(error, command//': found --only, '// &
            'expected it behind ensemble')
         if (.not. allocated(error) .and. command /= 'compare' .and. settings%damping) &
            call bad_input(error, command//': found --damping, expected it behind compare')
         if (.not. allocated(error) .and. command /= 'help' .and. settings%markdown) &
            call bad_input(error, command//': found --markdown, expected it behind help')
      end associate
   end subroutine check_command

   !> Returns words as an array of texts, as long as the longest word.
   pure function words_of(words) result(texts)
      type(string_t), intent(in) :: words(:)
      character(len=:), allocatable :: texts(:)
      integer :: k, longest

      longest = 0
      do k = 1, size(words)
         longest = max(longest, len(words(k)%text))
      end do
      allocate (character(len=longest) :: texts(size(words)))
      do k = 1, size(words)
         texts(k) = words(k)%text
      end do
   end function words_of

   !> Returns word k of the command line; '' behind the last word.
   function argument(k) result(word)
      integer, intent(in) :: k
      character(len=:), allocatable :: word
      integer :: length

      call get_command_argument(k, length=length)
      allocate (character(len=length) :: word)
      call get_command_argument(k, word)
   end function argument

end program beamid_main
