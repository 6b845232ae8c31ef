!> What the parts of `beamid reproduce` share: where the paper's numbers are, and how ours are set
!> beside them.
module beamid_paper
   use beamid
   use beamid_errors, only: bad_input
   use beamid_paths, only: directory_of, join_path
   use beamid_strings, only: fixed
   implicit none
   private

   public :: find_data, percent, scientific

contains

   !> The folder `data` of the project: below the current folder, else beside a folder above the
   !> program that holds fpm.toml.
   subroutine find_data(data, error)
      character(len=:), allocatable, intent(out) :: data
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: folder
      integer :: length
      logical :: found

      data = 'data'
      inquire (file='data/table_4_1_fit.nml', exist=found)
      if (found) return
      call get_command_argument(0, length=length)
      allocate (character(len=length) :: folder)
      call get_command_argument(0, folder)
      do while (index(folder, '/') > 0)
         folder = directory_of(folder)
         inquire (file=join_path(folder, 'fpm.toml'), exist=found)
         data = join_path(folder, 'data')
         if (found) return
         if (folder == '/' .or. folder == '.') exit
      end do
      call bad_input(error, &
         'reproduce: found no folder data/ here or above the program, expected to run '// &
         'in the project''s folder')
   end subroutine find_data

   !> A ratio minus one, in per cent.
   function percent(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = trim(adjustl(fixed(100*value, 12, 1)))//' %'
   end function percent

   !> Two decimals and an exponent at the right end of a column.
   pure function scientific(value, width) result(text)
      real(wp), intent(in) :: value
      integer, intent(in) :: width
      character(len=width) :: text
      character(len=9) :: number

      write (number, '(es9.2)') value
      text = number
      text = adjustr(text)
   end function scientific

end module beamid_paper
