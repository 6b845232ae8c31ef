!> The command `help`, the manual page and the completion for shells. The tables here are the only
!> place that names commands and options; groups, keys and parameters come from the library's
!> tables.
module beamid_manual
   use beamid, only: error_t, version
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_case_reference, only: add_reference
   use beamid_errors, only: bad_input
   use beamid_key_help, only: add_group_list, add_help_on, key_line, known_words
   use beamid_reproduction, only: parts, reproducible
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: lower
   use beamid_templates, only: template_kinds
   use beamid_terminal, only: print_text
   use beamid_texts, only: left, text_t, wrapped
   use beamid_values, only: listed, name_length, one_of
   implicit none
   private

   public :: run_help, command_names, commands_in_words

   !> A command, as the help describes it.
   type :: command_t
      character(len=9) :: name          !< name of the command
      character(len=22) :: arguments    !< words behind the command
      character(len=66) :: help         !< purpose, in one line
      character(len=430) :: detail      !< outputs and special options
   end type command_t

   type(command_t), parameter :: commands(*) = [ &
      command_t('identify', 'case.nml', 'fit the free parameters of each stage to the record', &
         'Writes quality.csv, modes_seen.csv, estimates.csv, fit.csv, correlations.csv, '// &
         'autocorrelation.csv, modes.csv, shapes.csv, attachments.csv, labels.csv, case.txt '// &
         'and summary.txt; along.csv where E or c_D varies along the beam, minima.csv with '// &
         '&multistart, windows.csv with &windows. --time measures the time of a fit.'), &
      command_t('simulate', 'case.nml', 'response of the structure at the sample times', &
         'Writes response.csv and, with the noise of &noise, record.csv in the form that '// &
         'identify reads.'), &
      command_t('modes', 'case.nml', 'natural frequencies, damping ratios and mode shapes', &
         'Writes modes.csv, shapes.csv and attachments.csv; where the case says how to fit a '// &
         'record also '// &
         'modes_fitted.csv, the modes of the fitted structure with their intervals.'), &
      command_t('profile', 'case.nml', 'intervals from the profile of J, which may have no end', &
         'Writes profiles.csv and intervals.csv, in which the intervals of earlier runs of '// &
         'sample and bootstrap stay beside the new ones.'), &
      command_t('sample', 'case.nml', 'draws from the posterior of the parameters', &
         'Writes posterior.csv (chain, draw, log density, parameters), posterior_motion.csv, '// &
         'posterior_modes.csv, profiles.csv and intervals.csv; &sample has its keys.'), &
      command_t('bootstrap', 'case.nml', 'fits of resampled records', &
         'Writes bootstrap.csv and intervals.csv; &bootstrap has its keys.'), &
      command_t('compare', 'a.nml b.nml ...', &
         'several models of one record: AICc, BIC, nested-model tests', &
         'Writes models.csv and nested.csv.'), &
      command_t('design', 'case.nml', &
         'which experiment would determine the free parameters best', &
         'Every combination of the lists in &design, at the values that the case has: '// &
         'standard errors of what is free in the last stage, as they would be, and the '// &
         'criteria D (log det of the information), A (sum of relative variances) and E (least '// &
         'eigenvalue of the information). By the exact response, on the last mesh. Writes '// &
         'design.csv, labels.csv and summary.txt.'), &
      command_t('reproduce', 'WHAT', 'results of NASA CR-178199 beside the paper''s numbers', &
         'WHAT is '//reproducible//'. section-4 is from a reconstructed record: a check of '// &
         'consistency, not an independent confirmation. all is table-4.1 (by the exact '// &
         'response, instead of CVODE), section-4, acceleration, convergence and varying, each '// &
         'to out/<name> or DIR/<name>.'), &
      command_t('ensemble', 'case.nml', 'a command on many made records, or on a list of cases', &
         'Writes members.csv and ensemble.csv, with a list also cases.csv. --only i:j does '// &
         'these members alone; whichever program does the last ones writes the tables. One '// &
         'that was interrupted goes on when it is run again. --only-new fits those cases of a '// &
         'list that are new, or of which the text or a file has changed, each from its last '// &
         'estimate, and writes in changed.csv what has moved.'), &
      command_t('new', '[KIND] [DIR]', &
         'a case file with comments and a small record, to begin with', &
         'KIND is free-decay (default), impulse, base or paper; writes case.nml and record.csv '// &
         'to DIR, by default a folder named KIND, and replaces neither.'), &
      command_t('help', '[WORD ...]', 'about a command, group, key or parameter', &
         'help man, help bash and help zsh print the manual page and what shells complete. '// &
         'help --markdown prints the reference of all groups, keys and parameters.'), &
      command_t('version', '', 'the version', '')]

   !> Options, and their help.
   character(len=*), parameter :: options(6) = [character(len=10) :: '--out DIR', '--quiet', &
      '--time', '--only i:j', '--only-new', '--markdown']
   character(len=*), parameter :: option_help(6) = [character(len=64) :: &
      'folder of the outputs; left out: out/<case name>', &
      'no progress on standard error', &
      'identify: the time of a fit, on standard error', &
      'ensemble: these members alone', &
      'ensemble: only cases without a result, or with changed files', &
      'help: the reference of groups, keys and parameters, in Markdown']

   character(len=*), parameter :: &
      purpose = 'physical parameters of a flexible beam from an accelerometer record', &
      statuses = 'Exit status: 0 done, 1 the computation failed, 2 bad input; that of the '// &
      'signal after Ctrl-C.'

contains

   !> Returns the names of all commands.
   pure function command_names() result(names)
      character(len=len(commands%name)) :: names(size(commands))

      names = commands%name
   end function command_names

   !> Returns the names of all commands as `a, b or c`.
   function commands_in_words() result(text)
      character(len=:), allocatable :: text

      text = one_of(command_names(), '')
   end function commands_in_words

   !> Runs `beamid help [WORD ...]` and `beamid help --markdown`.
   !>
   !> words     commands, groups, keys or parameters; none: an overview
   !> markdown  whether to print the reference of case files in Markdown instead
   subroutine run_help(words, markdown, error)
      character(len=*), intent(in) :: words(:)
      logical, intent(in) :: markdown
      type(error_t), allocatable, intent(out) :: error
      type(text_t) :: text
      integer :: k

      if (markdown) then
         call add_reference(text)
      else if (size(words) == 0) then
         call add_overview(text)
      end if
      do k = 1, size(words)
         if (k > 1) call text%line()
         select case (words(k))
         case ('man'); call add_page(text)
         case ('bash'); call add_bash(text)
         case ('zsh'); call add_zsh(text)
         case default; call add_word(text, trim(words(k)), error)
         end select
         if (allocated(error)) return
      end do
      call print_text(text%content(), error)
   end subroutine run_help

   !> Adds the overview of commands, options and groups.
   subroutine add_overview(text)
      type(text_t), intent(inout) :: text
      integer :: k

      call text%line('beamid '//version//': '//purpose)
      call text%line()
      call text%line('usage: beamid <command> [case.nml] [--out DIR] [--quiet]')
      call text%line()
      do k = 1, size(commands)
         call text%line('  '//left(trim(commands(k)%name)//' '//trim(commands(k)%arguments), 26)// &
            trim(commands(k)%help))
      end do
      call text%line()
      do k = 1, size(options)
         call text%line('  '//left(trim(options(k)), 26)//trim(option_help(k)))
      end do
      call text%line()
      call text%line('A case file is made of groups, &beam length=..., E=... /; '// &
         '''beamid help beam'' lists the keys of one.')
      call add_group_list(text)
      call text%line()
      call text%line(statuses)
   end subroutine add_overview

   !> Adds the help on every command, group, key and parameter that a word names.
   !>
   !> error  the word is unknown
   subroutine add_word(text, word, error)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: word
      type(error_t), allocatable, intent(out) :: error
      character(len=name_length), allocatable :: words(:), all_words(:)
      character(len=:), allocatable :: suggestion
      logical :: found
      integer :: k

      found = .false.
      do k = 1, size(commands)
         if (lower(word) /= trim(commands(k)%name)) cycle
         found = .true.
         call text%line(usage(commands(k)))
         call text%line('  '//trim(commands(k)%help))
         if (commands(k)%detail /= '') call text%add(wrapped('  '//trim(commands(k)%detail)// &
            new_line('a'), 2))
      end do
      call add_help_on(trim(word(merge(2, 1, index(word, '&') == 1):)), text, found)
      if (found) return
      call known_words(words)
      ! gfortran 12 makes the result of an array constructor with a function in it too short.
      allocate (all_words(size(commands) + size(words)))
      all_words(:size(commands)) = commands%name
      all_words(size(commands) + 1:) = words
      call or_nearest(word, all_words, suggestion)
      call bad_input(error, 'help: found '//word// &
         ', expected a command, a group, a key or a parameter'//suggestion)
   end subroutine add_word

   !> Returns the command line of a command.
   function usage(command) result(line)
      type(command_t), intent(in) :: command
      character(len=:), allocatable :: line

      line = 'beamid '//trim(trim(command%name)//' '//command%arguments)
      if (command%name == 'help') line = line//' [--markdown]'
      if (any(command%name == [character(len=9) :: 'help', 'version', 'new'])) return
      line = line//' [--out DIR] [--quiet]'
      if (command%name == 'identify') line = line//' [--time]'
      if (command%name == 'ensemble') line = line//' [--only i:j] [--only-new]'
   end function usage

   !> Adds the manual page beamid(1) in the format of `man`.
   subroutine add_page(text)
      type(text_t), intent(inout) :: text
      type(block_t), allocatable :: blocks(:)
      character(len=:), allocatable :: name
      integer :: g, k

      call text%line('.TH BEAMID 1 "" "beamid '//version//'" ""')
      call text%line('.SH NAME')
      call text%line('beamid \- '//purpose)
      call text%line('.SH SYNOPSIS')
      do k = 1, size(commands)
         if (k > 1) call text%line('.br')
         call text%line('.B '//escaped(usage(commands(k))))
      end do
      call text%line('.SH COMMANDS')
      do k = 1, size(commands)
         call add_entry(trim(trim(commands(k)%name)//' '//commands(k)%arguments), &
            trim(commands(k)%help)//'.')
         if (commands(k)%detail /= '') call text%line(escaped(trim(commands(k)%detail)))
      end do
      call text%line('.SH OPTIONS')
      do k = 1, size(options)
         call add_entry(trim(options(k)), trim(option_help(k)))
      end do
      call text%line('.SH CASE FILE')
      call text%line(escaped('Groups of keys, &beam length=4.0, E=80.0 /, in any order; behind '// &
         '! a comment. Paths are relative to the case file. Any consistent set of units will do.'))
      call list_keys(blocks)
      do g = 1, size(blocks)
         name = '&'//trim(blocks(g)%name)
         if (groups(g)%required) name = name//' (required)'
         if (groups(g)%may_repeat) name = name//' (may repeat)'
         call text%line('.SS '//escaped(name))
         call text%line(escaped(trim(groups(g)%purpose)))
         do k = 1, size(blocks(g)%keys)
            call add_entry(trim(blocks(g)%keys(k)%name), key_line(blocks(g)%keys(k)))
         end do
      end do
      call text%line('.SH EXIT STATUS')
      call text%line('0 done, 1 the computation failed, 2 bad input: then standard error says '// &
         'in one line for each problem what was found, what was expected, and nothing is written.')

   contains

      !> Adds a labelled paragraph.
      subroutine add_entry(label, sentence)
         character(len=*), intent(in) :: label, sentence

         call text%line('.TP')
         call text%line('.B '//escaped(label))
         call text%line(escaped(sentence))
      end subroutine add_entry

   end subroutine add_page

   !> Returns a line in which the characters with a meaning for roff are escaped.
   pure function escaped(line) result(safe)
      character(len=*), intent(in) :: line
      character(len=:), allocatable :: safe
      integer :: k

      safe = ''
      if (scan(line(:min(1, len(line))), '.''') > 0) safe = '\&'
      do k = 1, len(line)
         select case (line(k:k))
         case ('-'); safe = safe//'\-'
         case ('\'); safe = safe//'\e'
         case default; safe = safe//line(k:k)
         end select
      end do
   end function escaped

   !> Adds the completion for bash: commands, and behind a command case files or its own words.
   subroutine add_bash(text)
      type(text_t), intent(inout) :: text
      character(len=name_length), allocatable :: words(:)

      call known_words(words)
      call text%line('_beamid() {')
      call text%line('   local word=${COMP_WORDS[COMP_CWORD]} command=${COMP_WORDS[1]}')
      call text%line('   if [[ $COMP_CWORD == 1 ]]; then')
      call text%line('      COMPREPLY=($(compgen -W "'//listed(command_names(), ' ')// &
         '" -- "$word"))')
      call text%line('   elif [[ ${COMP_WORDS[COMP_CWORD-1]} == --out ]]; then')
      call text%line('      COMPREPLY=($(compgen -d -- "$word"))')
      call text%line('   elif [[ $word == -* ]]; then')
      call text%line('      COMPREPLY=($(compgen -W "--out --quiet --time --only --only-new '// &
         '--markdown --help" -- "$word"))')
      call text%line('   else')
      call text%line('      case $command in')
      call text%line('      new) COMPREPLY=($(compgen -d -W "'//listed(template_kinds, ' ')// &
         '" -- "$word")) ;;')
      call text%line('      reproduce) COMPREPLY=($(compgen -W "'//listed(parts, ' ')// &
         ' all" -- "$word")) ;;')
      call text%line('      help) COMPREPLY=($(compgen -W "'//listed(command_names(), ' ')//' '// &
         listed(words, ' ')//'" -- "$word")) ;;')
      call text%line('      *) COMPREPLY=($(compgen -d -- "$word") $(compgen -G "$word*.nml")) ;;')
      call text%line('      esac')
      call text%line('   fi')
      call text%line('}')
      call text%line('complete -o filenames -F _beamid beamid')
   end subroutine add_bash

   !> Adds the completion for zsh.
   subroutine add_zsh(text)
      type(text_t), intent(inout) :: text
      character(len=name_length), allocatable :: words(:)
      integer :: k

      call known_words(words)
      call text%line('#compdef beamid')
      call text%line('local -a commands')
      call text%line('commands=(')
      do k = 1, size(commands)
         call text%line('   '''//trim(commands(k)%name)//':'// &
            without_quotes(commands(k)%help)//'''')
      end do
      call text%line(')')
      call text%line('if (( CURRENT == 2 )); then')
      call text%line('   _describe command commands')
      call text%line('elif [[ $words[CURRENT-1] == --out ]]; then')
      call text%line('   _files -/')
      call text%line('else')
      call text%line('   case $words[2] in')
      call text%line('   new) _alternative "kinds:kind:('//listed(template_kinds, ' ')// &
         ')" "folders:folder:_files -/" ;;')
      call text%line('   reproduce) compadd -- '//listed(parts, ' ')//' all ;;')
      call text%line('   help) compadd -- '//listed(command_names(), ' ')//' '// &
         listed(words, ' ')//' ;;')
      call text%line('   *) _arguments "*:case file:_files -g ''*.nml''" '// &
         '"--out:folder:_files -/"'// &
         ' --quiet --time --only --only-new --markdown --help ;;')
      call text%line('   esac')
      call text%line('fi')
   end subroutine add_zsh

   !> Returns a line without apostrophes and colons, which have a meaning in a completion.
   pure function without_quotes(line) result(safe)
      character(len=*), intent(in) :: line
      character(len=:), allocatable :: safe
      integer :: k

      safe = ''
      do k = 1, len_trim(line)
         if (line(k:k) /= '''' .and. line(k:k) /= ':') safe = safe//line(k:k)
      end do
   end function without_quotes

end module beamid_manual
