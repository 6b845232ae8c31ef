!> The manual page beamid(1), made from the tables of commands, options, groups, keys and
!> parameters.
module beamid_manual_page
   use beamid, only: version
   use beamid_blocks, only: block_t
   use beamid_case_files, only: groups, list_keys
   use beamid_command_table, only: commands, options, usage
   use beamid_key_facts, only: example_of, is_listed, parameter_example, parameter_range, &
      parameter_unit
   use beamid_key_help, only: key_line, meaning_of, symbol_of
   use beamid_parameters, only: parameters
   use beamid_texts, only: text_t
   implicit none
   private

   public :: add_page

   !> Purpose of the program, in one line.
   character(len=*), parameter, public :: purpose = &
      'physical parameters of a flexible beam from an accelerometer record'

contains

   !> Adds the manual page in the format of `man`.
   subroutine add_page(text)
      class(text_t), intent(inout) :: text
      type(block_t), allocatable :: blocks(:)
      integer :: g, k

      call text%line('.TH BEAMID 1 "" "beamid '//version//'" ""')
      call text%line('.SH NAME')
      call text%line('beamid \- '//purpose)
      call text%line('.SH SYNOPSIS')
      do k = 1, size(commands)
         if (k > 1) call text%line('.br')
         call text%line('.B '//escaped(usage(commands(k))))
      end do
      call add_commands(text)
      call text%line('.SH CASE FILE')
      call text%line(escaped('A case file consists of groups of keys, as in &beam length=4.0, '// &
         'E=80.0 /, in any order. A comment begins with !. Paths are relative to the case '// &
         'file. Any consistent set of units will do; a unit is given here as a dimension, and '// &
         'in parentheses for metres, newtons, seconds and kilograms.'))
      call list_keys(blocks)
      do g = 1, size(blocks)
         call add_group(text, g, blocks(g))
      end do
      call text%line('.SH PARAMETERS')
      call text%line('A fit can estimate these parameters.')
      do k = 1, size(parameters)
         if (.not. is_listed(k)) cycle
         call add_entry(text, symbol_of(k), meaning_of(k))
         call add_line(text, 'unit: '//parameter_unit(k)//'; '//trim('number '// &
            parameter_range(k)))
         call add_line(text, parameter_example(k))
      end do
      call text%line('.SH EXIT STATUS')
      call text%line('0: done. 1: the computation failed. 2: bad input; standard error then '// &
         'has one line for each problem, which says what was found and what was expected, and '// &
         'nothing is written. After Ctrl\-C or kill: the status of the signal.')
   end subroutine add_page

   !> Adds the sections of commands and options.
   subroutine add_commands(text)
      class(text_t), intent(inout) :: text
      character(len=:), allocatable :: label
      integer :: k

      call text%line('.SH COMMANDS')
      do k = 1, size(commands)
         call add_entry(text, trim(trim(commands(k)%name)//' '//commands(k)%arguments), &
            trim(commands(k)%help)//'.')
         if (commands(k)%detail /= '') call text%line(escaped(trim(commands(k)%detail)))
         call add_line(text, 'Example: beamid '//trim(commands(k)%example))
      end do
      call text%line('.SH OPTIONS')
      do k = 1, size(options)
         label = trim(options(k)%name)
         if (options(k)%command /= '') label = label//' ('//trim(options(k)%command)//')'
         call add_entry(text, label, trim(options(k)%help))
      end do
   end subroutine add_commands

   !> Adds the section of a group with all its keys.
   !>
   !> g  its row in `groups`
   subroutine add_group(text, g, block)
      class(text_t), intent(inout) :: text
      integer, intent(in) :: g
      type(block_t), intent(in) :: block
      character(len=:), allocatable :: name
      integer :: k

      name = '&'//block%name
      if (groups(g)%required) name = name//' (required)'
      if (groups(g)%may_repeat) name = name//' (may repeat)'
      call text%line('.SS '//escaped(name))
      call text%line(escaped(trim(groups(g)%purpose)))
      do k = 1, size(block%keys)
         associate (key => block%keys(k))
            call add_entry(text, trim(key%name), key%help)
            call add_line(text, key_line(block%name, key))
            call add_line(text, example_of(block%name, key))
         end associate
      end do
   end subroutine add_group

   !> Adds a labelled paragraph.
   subroutine add_entry(text, label, sentence)
      class(text_t), intent(inout) :: text
      character(len=*), intent(in) :: label, sentence

      call text%line('.TP')
      call text%line('.B '//escaped(label))
      call text%line(escaped(sentence))
   end subroutine add_entry

   !> Adds a sentence that begins on a new line.
   subroutine add_line(text, sentence)
      class(text_t), intent(inout) :: text
      character(len=*), intent(in) :: sentence

      call text%line('.br')
      call text%line(escaped(sentence))
   end subroutine add_line

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

end module beamid_manual_page
