!> Folders: creation with parents, lists, locks, and writing to the disk.
module beamid_folders
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_null_char, c_ptr
   use beamid_kinds, only: ip
   use beamid_paths, only: join_path
   use beamid_posix, only: c_closedir, c_dirfd, c_flock, c_fsync, c_mkdir, c_opendir, c_rmdir, &
      c_unlink, c_usleep, eagain, eexist, einval, enotdir, entry_name, errno_of, file_status, &
      kind_directory, last_errno, lock_exclusive, lock_nonblocking, max_name
   implicit none
   private

   public :: make_folder, make_folders, remove_folder, open_folder, list_folder, lock_folder, &
      sync_folder

contains

   !> Creates a folder and its missing parents.
   subroutine make_folders(path, created, code)
      character(len=*), intent(in) :: path
      !> Lengths of the leading parts of the path that were created, outermost first.
      integer, allocatable, intent(out) :: created(:)
      !> 0, or the errno of a failure.
      integer(c_int), intent(out) :: code
      integer :: i

      allocate (created(0))
      code = 0
      do i = 1, len(path)
         if (i < len(path)) then
            if (path(i:i) == '/' .or. path(i + 1:i + 1) /= '/') cycle
         end if
         if (is_folder(path(:i))) cycle
         code = make_folder(path(:i))
         if (code == 0) then
            created = [created, i]
         else if (code == eexist) then
            ! Another run may have created it just now. Anything else of this name is in the way.
            code = merge(0_c_int, enotdir, is_folder(path(:i)))
         end if
         if (code /= 0) return
      end do
   end subroutine make_folders

   !> Returns whether a path leads to a folder.
   logical function is_folder(path)
      character(len=*), intent(in) :: path
      integer :: kind
      integer(ip) :: bytes
      integer(c_int) :: code

      call file_status(path, kind, bytes, code)
      is_folder = kind == kind_directory
   end function is_folder

   !> Creates a folder; returns 0 or an errno, as all functions below do.
   integer(c_int) function make_folder(path) result(code)
      character(len=*), intent(in) :: path

      code = errno_of(c_mkdir(path//c_null_char, int(o'777', c_int)))
   end function make_folder

   !> Removes a folder and the files in it. If it contains folders, they and the folder itself
   !> remain.
   integer(c_int) function remove_folder(path) result(code)
      character(len=*), intent(in) :: path
      character(len=max_name), allocatable :: names(:)
      integer(c_int) :: ignored
      integer :: i

      code = list_folder(path, '', names)
      do i = 1, size(names)
         ignored = c_unlink(join_path(path, trim(names(i)))//c_null_char)
      end do
      if (c_rmdir(path//c_null_char) /= 0) code = last_errno()
   end function remove_folder

   !> Opens a folder, which `c_closedir` closes.
   integer(c_int) function open_folder(path, folder) result(code)
      character(len=*), intent(in) :: path
      type(c_ptr), intent(out) :: folder

      folder = c_opendir(path//c_null_char)
      code = 0
      if (.not. c_associated(folder)) code = last_errno()
   end function open_folder

   !> Lists the names in a folder that begin with `prefix`.
   integer(c_int) function list_folder(path, prefix, names) result(code)
      character(len=*), intent(in) :: path, prefix
      character(len=max_name), allocatable, intent(out) :: names(:)
      character(len=:), allocatable :: name
      type(c_ptr) :: folder
      integer :: n

      n = 0
      allocate (names(0))
      code = open_folder(path, folder)
      if (code /= 0) return
      do
         name = entry_name(folder)
         if (name == '') exit
         if (name == '.' .or. name == '..' .or. index(name, prefix) /= 1) cycle
         ! The list doubles each time, because there may be thousands of names.
         if (n == size(names)) names = [character(len=max_name) :: names, names, name]
         n = n + 1
         names(n) = name
      end do
      names = names(:n)
      code = c_closedir(folder)
   end function list_folder

   !> Locks an open folder against other runs; waits half a minute at most, because a run that was
   !> stopped must not block this run for ever. Returns .false. also if the file system has no
   !> locks.
   logical function lock_folder(folder) result(locked)
      !> Folder from `open_folder`; the lock ends when it is closed, or with the program.
      type(c_ptr), intent(in) :: folder
      integer, parameter :: attempts = 3000
      integer(c_int), parameter :: microseconds = 10000
      integer(c_int) :: ignored
      integer :: i

      do i = 1, attempts
         locked = c_flock(c_dirfd(folder), lock_exclusive + lock_nonblocking) == 0
         if (locked) return
         if (last_errno() /= eagain) return
         ignored = c_usleep(microseconds)
      end do
   end function lock_folder

   !> Waits until the names in a folder are on the disk; a file system that cannot do this (EINVAL)
   !> is no error.
   integer(c_int) function sync_folder(path) result(code)
      character(len=*), intent(in) :: path
      type(c_ptr) :: folder
      integer(c_int) :: ignored

      code = open_folder(path, folder)
      if (code /= 0) return
      code = errno_of(c_fsync(c_dirfd(folder)))
      if (code == einval) code = 0
      ignored = c_closedir(folder)
   end function sync_folder

end module beamid_folders
