!> Operations on paths of files.
module beamid_paths
   implicit none
   private

   public :: directory_of, join_path

contains

   !> Returns the folder of a path without a '/' at its end; '.' if there is none.
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

   !> Returns the path of a name inside a folder (empty: the current folder); an absolute name is
   !> returned unchanged.
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
