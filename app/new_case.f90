!> The command `new`: writes a first case and its record.
module beamid_new_case
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use beamid, only: error_t
   use beamid_commands, only: settings_t
   use beamid_errors, only: bad_input
   use beamid_files, only: write_new
   use beamid_folders, only: make_folders
   use beamid_paths, only: join_path
   use beamid_posix, only: c_unlink, kind_there, reason
   use beamid_spelling, only: or_nearest
   use beamid_strings, only: lower, to_text
   use beamid_templates, only: new_template, template_kinds
   use beamid_terminal, only: print_text
   use beamid_values, only: one_of
   implicit none
   private

   public :: run_new, check_new

   !> Files that the command writes.
   character(len=*), parameter :: names(2) = [character(len=10) :: 'case.nml', 'record.csv']

contains

   !> Checks the words behind `new`: a kind and a folder, both optional.
   subroutine check_new(words, error)
      character(len=*), intent(in) :: words(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: perhaps

      if (size(words) > 2) then
         call bad_input(error, 'new: found '//to_text(size(words))// &
            ' words, expected a kind and a folder at most')
      else if (size(words) > 0) then
         if (any(template_kinds == lower(words(1)))) return
         call or_nearest(words(1), template_kinds, perhaps)
         call bad_input(error, 'new: found '//trim(words(1))//', expected '// &
            one_of(template_kinds, '')//perhaps)
      end if
   end subroutine check_new

   !> Runs `beamid new [KIND] [DIR]`.
   subroutine run_new(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: kind, folder, case, record
      integer, allocatable :: created(:)
      integer(c_int) :: code, ignored
      integer :: k

      kind = trim(template_kinds(1))
      if (size(settings%subjects) > 0) kind = lower(settings%subjects(1)%text)
      folder = kind
      if (size(settings%subjects) > 1) folder = settings%subjects(2)%text
      do k = 1, size(names)
         if (kind_there(join_path(folder, trim(names(k)))) == 0) cycle
         call bad_input(error, join_path(folder, trim(names(k)))// &
            ': found a file that exists already, which is not replaced; expected another folder')
         return
      end do
      call new_template(kind, case, record, error)
      if (allocated(error)) return
      call make_folders(folder, created, code)
      if (code == 0) code = write_new(join_path(folder, trim(names(2))), record)
      if (code == 0) then
         code = write_new(join_path(folder, trim(names(1))), case)
         if (code /= 0) then
            do k = 1, size(names)
               ignored = c_unlink(join_path(folder, trim(names(k)))//c_null_char)
            end do
         end if
      end if
      if (code /= 0) then
         call bad_input(error, folder//': cannot be written: '//reason(code))
         return
      end if
      call print_text(join_path(folder, trim(names(1)))//new_line('a')// &
         join_path(folder, trim(names(2)))//new_line('a'), error)
   end subroutine run_new

end module beamid_new_case
