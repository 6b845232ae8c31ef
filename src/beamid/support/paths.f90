!> Operations on paths of files.
module beamid_paths
   implicit none
   private

   public :: path_t, append_path, directory_of, join_path

   !> An element of a list of paths.
   type :: path_t
      character(len=:), allocatable :: text
   end type path_t

contains

   !> Appends a path to a list. (An array constructor does not work for texts of different lengths.)
   pure subroutine append_path(list, path)
      type(path_t), allocatable, intent(inout) :: list(:)
      character(len=*), intent(in) :: path
      type(path_t), allocatable :: longer(:)

      if (.not. allocated(list)) allocate (list(0))
      allocate (longer(size(list) + 1))
      longer(:size(list)) = list
      longer(size(longer))%text = path
      call move_alloc(longer, list)
   end subroutine append_path

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
