!> Whole files in and out, through the C library: gfortran's own runtime does not report a full
!> disk, and waits for ever on a pipe.
module beamid_files
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_intptr_t, c_null_char, c_ptr, &
      c_size_t
   use beamid_kinds, only: ip
   use beamid_errors, only: error_t, bad_input, failure
   use beamid_paths, only: directory_of, join_path
   use beamid_posix, only: c_close, c_creat, c_fclose, c_ferror, c_fopen, c_fread, c_fsync, &
      c_getpid, c_link, c_mkdir, c_rename, c_rmdir, c_signal, c_unlink, c_write, edquot, eexist, &
      efbig, eintr, eio, enoent, enospc, enotdir, file_status, kind_directory, kind_regular, &
      last_errno, reason, sig_ign, sigxfsz
   use beamid_strings, only: to_text
   implicit none
   private

   public :: read_text, output_t, directory_of, join_path

   !> The largest file that is read: 1 GiB.
   integer(ip), parameter :: max_bytes = 2_ip**30

   type :: named_text_t
      character(len=:), allocatable :: name, text
   end type named_text_t

   !> Files that are built in memory and written together, all of them or none.
   type :: output_t
      type(named_text_t), allocatable :: files(:)
   contains
      procedure :: add
      procedure :: commit
   end type output_t

contains

   !> Reads a whole regular file, byte for byte.
   subroutine read_text(path, text, error)
      character(len=*), intent(in) :: path
      character(len=:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      type(c_ptr) :: stream
      integer(c_int) :: code
      integer(ip) :: bytes
      integer :: kind

      text = ''
      call file_status(path, kind, bytes, code)
      if (code == enoent) then
         call bad_input(error, path//': found no such file, expected a readable file')
      else if (code /= 0) then
         call unreadable(path, code, error)
      else if (kind == kind_directory) then
         call bad_input(error, path//': is a directory, expected a file')
      else if (kind /= kind_regular) then
         call bad_input(error, path//': found a pipe or a device, expected a regular file')
      else if (bytes > max_bytes) then
         call too_large(path, error)
      end if
      if (allocated(error)) return

      stream = c_fopen(path//c_null_char, 'rb'//c_null_char)
      if (c_associated(stream)) then
         call read_stream(path, stream, bytes, text, error)
         code = c_fclose(stream)
      else
         call unreadable(path, last_errno(), error)
      end if
   end subroutine read_text

   !> Reads an open stream to its end: a file may hold more bytes than its status said.
   subroutine read_stream(path, stream, expected_bytes, text, error)
      !> The file's path, for messages.
      character(len=*), intent(in) :: path
      type(c_ptr), intent(in) :: stream
      integer(ip), intent(in) :: expected_bytes
      character(len=:), allocatable, intent(inout) :: text
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: buffer, larger
      integer(ip) :: filled, got
      integer(c_int) :: code

      filled = 0
      allocate (character(len=max(expected_bytes + 1, 4096_ip)) :: buffer)
      do
         got = c_fread(buffer(filled + 1:), 1_c_size_t, len(buffer, c_size_t) - filled, stream)
         code = last_errno()
         filled = filled + got
         if (filled < len(buffer, ip) .or. filled > max_bytes) exit
         allocate (character(len=2*filled) :: larger)
         larger(:filled) = buffer
         call move_alloc(larger, buffer)
      end do
      if (filled > max_bytes) then
         call too_large(path, error)
      else if (c_ferror(stream) /= 0) then
         call unreadable(path, code, error)
      else
         text = buffer(:filled)
      end if
   end subroutine read_stream

   subroutine unreadable(path, code, error)
      character(len=*), intent(in) :: path
      !> The errno.
      integer(c_int), intent(in) :: code
      type(error_t), allocatable, intent(out) :: error

      call bad_input(error, path//': found "'//reason(code)//'", expected a readable file')
   end subroutine unreadable

   subroutine too_large(path, error)
      character(len=*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      call bad_input(error, path//': found more than 1 GiB, expected a smaller file')
   end subroutine too_large

   !> Adds a file to the list; a name given before gets the new text.
   subroutine add(self, name, text)
      class(output_t), intent(inout) :: self
      !> The file's name inside the output folder, and its whole text.
      character(len=*), intent(in) :: name, text
      type(named_text_t), allocatable :: more(:)
      integer :: i, n

      if (.not. allocated(self%files)) allocate (self%files(0))
      n = size(self%files)
      do i = 1, n
         if (self%files(i)%name == name) exit
      end do
      if (i > n) then
         allocate (more(n + 1))
         more(:n) = self%files
         call move_alloc(more, self%files)
         self%files(i)%name = name
      end if
      self%files(i)%text = text
   end subroutine add

   !> Writes all files, or changes nothing: every text goes to a temporary name in the same folder
   !> first, and the final names are touched when all texts are on the disk.
   subroutine commit(self, directory, error)
      class(output_t), intent(in) :: self
      !> The output folder; it and its parents are created when missing.
      character(len=*), intent(in) :: directory
      !> Status 1 for a full or broken disk, 2 for a folder that cannot be written.
      type(error_t), allocatable, intent(out) :: error
      integer(c_intptr_t) :: handler
      integer(c_int) :: code, ignored
      integer, allocatable :: created(:)
      integer :: i

      ! A file size limit shall be an error code here, not the end of the program.
      handler = c_signal(sigxfsz, sig_ign)
      call make_directories(directory, created, code)
      if (code == 0 .and. allocated(self%files)) code = write_all(directory, self%files)
      if (code /= 0) then
         do i = size(created), 1, -1
            ignored = c_rmdir(directory(:created(i))//c_null_char)
         end do
         associate (message => directory//': the output folder cannot be written: '//reason(code))
            if (any(code == [enospc, edquot, eio, efbig])) then
               call failure(error, message)
            else
               call bad_input(error, message)
            end if
         end associate
      end if
      handler = c_signal(sigxfsz, handler)
   end subroutine commit

   !> Creates a directory and its missing parents.
   subroutine make_directories(directory, created, code)
      character(len=*), intent(in) :: directory
      !> Lengths of those leading parts of the path that were created, outermost first.
      integer, allocatable, intent(out) :: created(:)
      !> 0 or an errno.
      integer(c_int), intent(out) :: code
      integer :: i, kind
      integer(ip) :: bytes

      allocate (created(0))
      code = 0
      do i = 1, len(directory)
         if (i < len(directory)) then
            if (directory(i:i) == '/' .or. directory(i + 1:i + 1) /= '/') cycle
         end if
         call file_status(directory(:i), kind, bytes, code)
         if (kind == kind_directory) cycle
         code = 0
         if (c_mkdir(directory(:i)//c_null_char, int(o'777', c_int)) /= 0) code = last_errno()
         if (code == eexist) code = enotdir
         if (code /= 0) return
         created = [created, i]
      end do
   end subroutine make_directories

   !> Writes and names all files, and leaves no temporary one behind; returns 0 or an errno.
   integer(c_int) function write_all(directory, files) result(code)
      character(len=*), intent(in) :: directory
      type(named_text_t), intent(in) :: files(:)
      integer(c_int) :: ignored
      integer :: i

      code = 0
      do i = 1, size(files)
         code = write_file(temporary(directory, files(i)%name, 'new'), files(i)%text)
         if (code /= 0) exit
      end do
      if (code == 0) code = rename_all(directory, files)
      do i = 1, size(files)
         ignored = c_unlink(temporary(directory, files(i)%name, 'new'))
         ignored = c_unlink(temporary(directory, files(i)%name, 'old'))
      end do
   end function write_all

   !> Writes one new file and waits until the disk has it; returns 0 or an errno.
   integer(c_int) function write_file(c_path, text) result(code)
      !> The file's path, ending in a null character.
      character(len=*), intent(in) :: c_path
      character(len=*), intent(in) :: text
      integer(c_int) :: fd
      integer(ip) :: done, n

      code = 0
      fd = c_creat(c_path, int(o'666', c_int))
      if (fd < 0) then
         code = last_errno()
         return
      end if
      done = 0
      do while (done < len(text, ip) .and. code == 0)
         n = c_write(fd, text(done + 1:), len(text, c_size_t) - done)
         if (n < 0) code = last_errno()
         if (n == 0) code = enospc
         if (code == eintr) code = 0
         done = done + max(n, 0_ip)
      end do
      if (code == 0) then
         if (c_fsync(fd) /= 0) code = last_errno()
      end if
      if (c_close(fd) /= 0 .and. code == 0) code = last_errno()
   end function write_file

   !> Gives all temporary files their final names; puts the older files back when one refuses.
   integer(c_int) function rename_all(directory, files) result(code)
      character(len=*), intent(in) :: directory
      type(named_text_t), intent(in) :: files(:)
      logical :: kept(size(files))
      integer(c_int) :: ignored
      integer :: i, j

      code = 0
      do i = 1, size(files)
         associate (final => join_path(directory, files(i)%name)//c_null_char)
            kept(i) = c_link(final, temporary(directory, files(i)%name, 'old')) == 0
            if (c_rename(temporary(directory, files(i)%name, 'new'), final) /= 0) &
               code = last_errno()
         end associate
         if (code /= 0) exit
      end do
      if (code == 0) return
      do j = 1, i - 1
         associate (final => join_path(directory, files(j)%name)//c_null_char)
            if (kept(j)) ignored = c_rename(temporary(directory, files(j)%name, 'old'), final)
            if (.not. kept(j)) ignored = c_unlink(final)
         end associate
      end do
   end function rename_all

   !> A name beside the final one that no other running program uses, ending in a null character.
   function temporary(directory, name, purpose) result(c_path)
      !> The output folder, the file's final name and 'new' or 'old'.
      character(len=*), intent(in) :: directory, name, purpose
      character(len=:), allocatable :: c_path

      c_path = join_path(directory, name)//'.'//purpose//'-'//to_text(int(c_getpid()))//c_null_char
   end function temporary

end module beamid_files
