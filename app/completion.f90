!> The completion of the command line for bash and zsh, made from the tables of commands, options,
!> groups, keys and parameters.
module beamid_completion
   use beamid_command_table, only: command_names, commands, options
   use beamid_key_help, only: known_words
   use beamid_reproduction, only: parts
   use beamid_templates, only: template_kinds
   use beamid_texts, only: text_t
   use beamid_values, only: listed, name_length
   implicit none
   private

   public :: add_bash, add_zsh

contains

   !> Adds the completion for bash: commands, and behind a command case files or its own words.
   subroutine add_bash(text)
      class(text_t), intent(inout) :: text
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
      call text%line('      COMPREPLY=($(compgen -W "'//option_words()//'" -- "$word"))')
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
      class(text_t), intent(inout) :: text
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
         '"--out:folder:_files -/" '//option_words()//' ;;')
      call text%line('   esac')
      call text%line('fi')
   end subroutine add_zsh

   !> Returns all options, separated by blanks.
   pure function option_words() result(words)
      character(len=:), allocatable :: option, words
      integer :: k

      words = ''
      do k = 1, size(options)
         option = trim(options(k)%name)//' '
         words = words//option(:index(option, ' '))
      end do
      words = words//'--help'
   end function option_words

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

end module beamid_completion
