!> Paths of files, taken apart and put together.
module beamid_paths
   implicit none
   private

   public :: directory_of, join_path

contains

   !> The folder part of a path, without the last '/'; '.' when there is none.
   pure function directory_of(path) result(directory)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: directory
      integer :: slash

      slash = index(path, '/', back=.true.)
      if (slash == 0) then
         directory = '.'
      else
         directory = path(:max(slash - 1, 1))
      end if
   end function directory_of

   !> A name inside a folder (empty: the current one); an absolute name stays as it is.
   pure function join_path(directory, name) result(path)
      character(len=*), intent(in) :: directory, name
      character(len=:), allocatable :: path

      if (index(name, '/') == 1 .or. len(directory) == 0) then
         path = name
      else if (directory(len(directory):) == '/') then
         path = directory//name
      else
         path = directory//'/'//name
      end if
   end function join_path

end module beamid_paths
