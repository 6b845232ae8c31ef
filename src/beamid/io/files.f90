!> Whole files in and out, through the C library: gfortran's own runtime does not report a full
!> disk, and waits for ever on a pipe. Linux (glibc) calls with the same layout on every processor.
module beamid_files
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_int, c_int16_t, &
      c_int32_t, c_int64_t, c_intptr_t, c_null_char, c_ptr, c_size_t
   use beamid_kinds, only: ip
   use beamid_errors, only: error_t, bad_input, failure
   implicit none
   private

   public :: read_text, output_t, directory_of, join_path

   !> The largest file that is read, in bytes: 1 GiB.
   integer(ip), parameter :: max_bytes = 2_ip**30
   ! Linux values, the same on x86-64 and aarch64.
   integer(c_int), parameter :: enoent = 2, eintr = 4, eio = 5, eexist = 17, enotdir = 20, &
      efbig = 27, enospc = 28, edquot = 122, sigxfsz = 25, at_fdcwd = -100
   integer, parameter :: kind_mask = int(o'170000'), kind_directory = int(o'040000'), &
      kind_regular = int(o'100000')

   !> The head of `struct statx`, and room for the rest of its 256 bytes.
   type, bind(c) :: statx_t
      integer(c_int32_t) :: mask, block_size
      integer(c_int64_t) :: attributes
      integer(c_int32_t) :: links, user, group
      integer(c_int16_t) :: mode, unused
      integer(c_int64_t) :: inode, bytes
      integer(c_int64_t) :: rest(26)
   end type statx_t

   !> A name and a text that belong together.
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

   interface
      integer(c_int) function c_statx(folder, path, flags, mask, status) bind(c, name='statx')
         import :: c_char, c_int, statx_t
         integer(c_int), value :: folder, flags, mask
         character(kind=c_char), intent(in) :: path(*)
         type(statx_t), intent(out) :: status
      end function c_statx
      type(c_ptr) function c_fopen(path, mode) bind(c, name='fopen')
         import :: c_char, c_ptr
         character(kind=c_char), intent(in) :: path(*), mode(*)
      end function c_fopen
      integer(c_size_t) function c_fread(buffer, size, n, stream) bind(c, name='fread')
         import :: c_char, c_ptr, c_size_t
         character(kind=c_char), intent(inout) :: buffer(*)
         integer(c_size_t), value :: size, n
         type(c_ptr), value :: stream
      end function c_fread
      integer(c_int) function c_ferror(stream) bind(c, name='ferror')
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_ferror
      integer(c_int) function c_fclose(stream) bind(c, name='fclose')
         import :: c_int, c_ptr
         type(c_ptr), value :: stream
      end function c_fclose
      integer(c_int) function c_creat(path, mode) bind(c, name='creat')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: mode
      end function c_creat
      integer(c_size_t) function c_write(fd, buffer, n) bind(c, name='write')
         import :: c_char, c_int, c_size_t
         integer(c_int), value :: fd
         character(kind=c_char), intent(in) :: buffer(*)
         integer(c_size_t), value :: n
      end function c_write
      integer(c_int) function c_fsync(fd) bind(c, name='fsync')
         import :: c_int
         integer(c_int), value :: fd
      end function c_fsync
      integer(c_int) function c_close(fd) bind(c, name='close')
         import :: c_int
         integer(c_int), value :: fd
      end function c_close
      integer(c_int) function c_link(old, new) bind(c, name='link')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: old(*), new(*)
      end function c_link
      integer(c_int) function c_rename(old, new) bind(c, name='rename')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: old(*), new(*)
      end function c_rename
      integer(c_int) function c_unlink(path) bind(c, name='unlink')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_unlink
      integer(c_int) function c_mkdir(path, mode) bind(c, name='mkdir')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: mode
      end function c_mkdir
      integer(c_int) function c_rmdir(path) bind(c, name='rmdir')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
      end function c_rmdir
      integer(c_int) function c_getpid() bind(c, name='getpid')
         import :: c_int
      end function c_getpid
      type(c_ptr) function c_errno() bind(c, name='__errno_location')
         import :: c_ptr
      end function c_errno
      type(c_ptr) function c_strerror(code) bind(c, name='strerror')
         import :: c_int, c_ptr
         integer(c_int), value :: code
      end function c_strerror
      integer(c_size_t) function c_strlen(text) bind(c, name='strlen')
         import :: c_ptr, c_size_t
         type(c_ptr), value :: text
      end function c_strlen
      integer(c_intptr_t) function c_signal(number, handler) bind(c, name='signal')
         import :: c_int, c_intptr_t
         integer(c_int), value :: number
         integer(c_intptr_t), value :: handler
      end function c_signal
   end interface

contains

   !> Reads a whole file, byte for byte.
   subroutine read_text(path, text, error)
      !> The file's path.
      character(len=*), intent(in) :: path
      !> The file's bytes.
      character(len=:), allocatable, intent(out) :: text
      !> Allocated when the file is missing, not a regular file, too large or unreadable.
      type(error_t), allocatable, intent(out) :: error
      type(statx_t) :: status
      type(c_ptr) :: stream
      integer(c_int) :: code

      text = ''
      code = file_status(path, status)
      if (code == enoent) then
         call bad_input(error, path//': found no such file, expected a readable file')
      else if (code /= 0) then
         call bad_input(error, path//': found "'//reason(code)//'", expected a readable file')
      else if (iand(int(status%mode), kind_mask) == kind_directory) then
         call bad_input(error, path//': is a directory, expected a file')
      else if (iand(int(status%mode), kind_mask) /= kind_regular) then
         call bad_input(error, path//': found a pipe or a device, expected a regular file')
      end if
      if (allocated(error)) return

      stream = c_fopen(path//c_null_char, 'rb'//c_null_char)
      code = last_errno()
      if (.not. c_associated(stream)) then
         call bad_input(error, path//': found "'//reason(code)//'", expected a readable file')
         return
      end if
      call read_stream(path, stream, status%bytes, text, error)
      code = c_fclose(stream)
   end subroutine read_text

   !> Reads an open stream to its end: a file may hold more bytes than its status said.
   subroutine read_stream(path, stream, expected_bytes, text, error)
      !> The file's path, for messages.
      character(len=*), intent(in) :: path
      !> An open C stream.
      type(c_ptr), intent(in) :: stream
      !> The size that the file system gives, bytes; 0 for files made on the fly.
      integer(ip), intent(in) :: expected_bytes
      !> The bytes read.
      character(len=:), allocatable, intent(inout) :: text
      !> Allocated when reading fails or the file is larger than `max_bytes`.
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: buffer, larger
      integer(ip) :: filled, got
      integer(c_int) :: code

      filled = 0
      if (expected_bytes <= max_bytes) then
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
      end if
      if (max(filled, expected_bytes) > max_bytes) then
         call bad_input(error, path//': found more than 1 GiB, expected a smaller file')
      else if (c_ferror(stream) /= 0) then
         call bad_input(error, path//': found "'//reason(code)//'", expected a readable file')
      else
         text = buffer(:filled)
      end if
   end subroutine read_stream

   !> Adds a file to the list; a name given before gets the new text.
   subroutine add(self, name, text)
      class(output_t), intent(inout) :: self
      !> The file's name inside the output folder.
      character(len=*), intent(in) :: name
      !> Its whole text.
      character(len=*), intent(in) :: text
      type(named_text_t) :: file
      integer :: i

      file%name = name
      if (.not. allocated(self%files)) allocate (self%files(0))
      do i = 1, size(self%files)
         if (self%files(i)%name == name) exit
      end do
      if (i > size(self%files)) self%files = [self%files, file]
      self%files(i)%text = text
   end subroutine add

   !> Writes all files, or changes nothing: every text goes to a temporary name in the same folder
   !> first, and the final names are touched when all texts are on the disk.
   subroutine commit(self, directory, error)
      class(output_t), intent(in) :: self
      !> The output folder; it and its parents are created when missing.
      character(len=*), intent(in) :: directory
      !> Allocated when anything could not be written.
      type(error_t), allocatable, intent(out) :: error
      integer(c_intptr_t) :: handler
      integer(c_int) :: code, ignored
      integer, allocatable :: created(:)
      integer :: i

      ! A file size limit shall be an error code here (1 is SIG_IGN), not the end of the program.
      handler = c_signal(sigxfsz, 1_c_intptr_t)
      call make_directories(directory, created, code)
      if (allocated(self%files)) then
         do i = 1, size(self%files)
            if (code == 0) code = write_file(temporary(directory, self%files(i)%name, 'new'), &
               self%files(i)%text)
         end do
         if (code == 0) code = rename_all(directory, self%files)
         do i = 1, size(self%files)
            ignored = c_unlink(temporary(directory, self%files(i)%name, 'new'))
            ignored = c_unlink(temporary(directory, self%files(i)%name, 'old'))
         end do
      end if
      if (code /= 0) then
         do i = size(created), 1, -1
            ignored = c_rmdir(directory(:created(i))//c_null_char)
         end do
         call explain(directory, code, error)
      end if
      handler = c_signal(sigxfsz, handler)
   end subroutine commit

   !> Turns an errno of writing into an error: a full disk is a failure, the rest bad input.
   subroutine explain(directory, code, error)
      !> The output folder.
      character(len=*), intent(in) :: directory
      !> The errno.
      integer(c_int), intent(in) :: code
      !> The error made of it.
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: message

      message = directory//': the output folder cannot be written: '//reason(code)
      if (any(code == [enospc, edquot, eio, efbig])) then
         call failure(error, message)
      else
         call bad_input(error, message)
      end if
   end subroutine explain

   !> Creates a directory and its missing parents.
   subroutine make_directories(directory, created, code)
      !> The directory's path.
      character(len=*), intent(in) :: directory
      !> Lengths of those leading parts of the path that were created, outermost first.
      integer, allocatable, intent(out) :: created(:)
      !> 0 or an errno.
      integer(c_int), intent(out) :: code
      type(statx_t) :: status
      integer :: i

      allocate (created(0))
      code = 0
      do i = 1, len(directory)
         if (i < len(directory)) then
            if (i == 1 .or. directory(i + 1:i + 1) /= '/') cycle
         end if
         if (file_status(directory(:i), status) == 0) then
            if (iand(int(status%mode), kind_mask) == kind_directory) cycle
         end if
         if (c_mkdir(directory(:i)//c_null_char, int(o'777', c_int)) == 0) then
            created = [created, i]
         else
            code = last_errno()
            if (code == eexist) code = enotdir
            return
         end if
      end do
   end subroutine make_directories

   !> Writes one new file and waits until the disk has it; returns 0 or an errno.
   integer(c_int) function write_file(c_path, text) result(code)
      !> The file's path, ending in a null character.
      character(len=*), intent(in) :: c_path
      !> Its text.
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
      !> The output folder.
      character(len=*), intent(in) :: directory
      !> The files, whose temporary files exist.
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
      character(len=12) :: process

      write (process, '(i0)') c_getpid()
      c_path = join_path(directory, name)//'.'//purpose//'-'//trim(process)//c_null_char
   end function temporary

   !> The status of a path (of its target, for a link); returns 0 or an errno.
   integer(c_int) function file_status(path, status) result(code)
      !> The path.
      character(len=*), intent(in) :: path
      !> What the system knows about it.
      type(statx_t), intent(out) :: status
      integer(c_int), parameter :: basic_fields = int(z'7ff', c_int)

      code = c_statx(at_fdcwd, path//c_null_char, 0_c_int, basic_fields, status)
      if (code /= 0) code = last_errno()
   end function file_status

   !> The C library's `errno`.
   integer(c_int) function last_errno() result(code)
      integer(c_int), pointer :: location

      call c_f_pointer(c_errno(), location)
      code = location
   end function last_errno

   !> What an errno means, in words.
   function reason(code) result(text)
      !> The errno.
      integer(c_int), intent(in) :: code
      character(len=:), allocatable :: text
      character(kind=c_char), pointer :: letters(:)
      type(c_ptr) :: message
      integer :: i

      message = c_strerror(code)
      call c_f_pointer(message, letters, [c_strlen(message)])
      allocate (character(len=size(letters)) :: text)
      do i = 1, size(letters)
         text(i:i) = letters(i)
      end do
   end function reason

   !> The folder part of a path, without the last '/'; '.' when there is none.
   pure function directory_of(path) result(directory)
      !> A path.
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

   !> A name inside a folder; an absolute name stays as it is.
   pure function join_path(directory, name) result(path)
      !> The folder; empty means the current one.
      character(len=*), intent(in) :: directory
      !> The name, relative to the folder or absolute.
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: path

      if (index(name, '/') == 1 .or. len(directory) == 0) then
         path = name
      else if (directory(len(directory):) == '/') then
         path = directory//name
      else
         path = directory//'/'//name
      end if
   end function join_path

end module beamid_files
