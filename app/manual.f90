!> The command `help`: the overview, the help on words, and what else `help` prints.
module beamid_manual
   use beamid, only: error_t, version
   use beamid_case_reference, only: add_reference
   use beamid_command_table, only: command_t, commands, has_option, options, usage
   use beamid_completion, only: add_bash, add_zsh
   use beamid_errors, only: bad_input
   use beamid_help_pages, only: help_page_t
   use beamid_key_help, only: add_group_list, add_help_on, add_see_also, known_words
   use beamid_manual_page, only: add_page, purpose
   use beamid_see_also, only: a_command, an_everyday_word, related_words
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: lower
   use beamid_terminal, only: page_width, print_text
   use beamid_values, only: name_length
   implicit none
   private

   public :: run_help

   !> Columns of the overview and of the help on a command.
   integer, parameter :: overview_column = 28, fact_column = 16

contains

   !> Runs `beamid help [WORD ...]` and `beamid help --markdown`.
   !>
   !> words     commands, groups, keys or parameters; none: an overview
   !> markdown  whether to print the reference of case files in Markdown instead
   subroutine run_help(words, markdown, error)
      character(len=*), intent(in) :: words(:)
      logical, intent(in) :: markdown
      type(error_t), allocatable, intent(out) :: error
      type(help_page_t) :: page
      integer :: k

      page%width = page_width()
      if (markdown) then
         call add_reference(page%text_t)
      else if (size(words) == 0) then
         call add_overview(page)
      end if
      do k = 1, size(words)
         if (k > 1) call page%line()
         select case (words(k))
         case ('man'); call add_page(page)
         case ('bash'); call add_bash(page)
         case ('zsh'); call add_zsh(page)
         case ('exit', 'status', 'exit status'); call add_exit_status(page)
         case default; call add_word(page, trim(words(k)), error)
         end select
         if (allocated(error)) return
      end do
      call print_text(page%content(), error)
   end subroutine run_help

   !> Adds the overview of commands, options and groups.
   subroutine add_overview(page)
      type(help_page_t), intent(inout) :: page
      character(len=:), allocatable :: text
      integer :: k

      call page%paragraph(0, 'beamid '//version//': '//purpose, 4)
      call page%line()
      call page%paragraph(0, 'usage: beamid <command> [case.nml] [--out DIR] [--quiet]', 4)
      call page%line()
      do k = 1, size(commands)
         call page%labelled(2, trim(commands(k)%name)//' '//commands(k)%arguments, &
            overview_column, commands(k)%help)
      end do
      call page%line()
      do k = 1, size(options)
         text = trim(options(k)%help)
         if (options(k)%command /= '') text = trim(options(k)%command)//': '//text
         call page%labelled(2, options(k)%name, overview_column, text)
      end do
      call page%line()
      call page%paragraph(0, 'A case file consists of groups of keys, for example')
      call page%paragraph(4, '&record file=''record.csv'', t_first=0.2 /')
      call page%paragraph(0, '''beamid help record'' lists the keys of &record, and ''beamid '// &
         'help t_first'' explains one key.')
      call add_group_list(page)
      call page%line()
      call add_exit_status(page)
   end subroutine add_overview

   !> Adds what the exit status of the program means.
   subroutine add_exit_status(page)
      type(help_page_t), intent(inout) :: page

      call page%paragraph(0, 'Exit status: 0 done, 1 the computation failed, 2 bad input; '// &
         'after Ctrl-C that of the signal.')
   end subroutine add_exit_status

   !> Adds the help on a command.
   subroutine add_command(page, command)
      type(help_page_t), intent(inout) :: page
      type(command_t), intent(in) :: command
      integer :: k

      call page%paragraph(0, usage(command), 4)
      call page%paragraph(2, command%help)
      if (command%detail /= '') call page%paragraph(2, command%detail)
      do k = 1, size(options)
         if (has_option(command, options(k))) call page%labelled(4, options(k)%name, fact_column, &
            options(k)%help)
      end do
      call page%labelled(4, 'example', fact_column, 'beamid '//command%example)
      call add_see_also(page, a_command, trim(command%name), fact_column)
   end subroutine add_command

   !> Adds the help on every command, group, key and parameter that a word names.
   !>
   !> error  the word is unknown
   subroutine add_word(page, word, error)
      type(help_page_t), intent(inout) :: page
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
         call add_command(page, commands(k))
      end do
      call add_help_on(trim(word(merge(2, 1, index(word, '&') == 1):)), page, found)
      if (found) return
      if (related_words(an_everyday_word, lower(word)) /= '') then
         call page%paragraph(0, word//' is the name of no key')
         call add_see_also(page, an_everyday_word, lower(word), fact_column)
         return
      end if
      call known_words(words)
      ! gfortran 12 makes the result of an array constructor with a function in it too short.
      allocate (all_words(size(commands) + size(words)))
      all_words(:size(commands)) = commands%name
      all_words(size(commands) + 1:) = words
      call or_nearest(word, all_words, suggestion)
      call bad_input(error, 'help: found '//word// &
         ', expected a command, a group, a key or a parameter'//suggestion)
   end subroutine add_word

end module beamid_manual
