!> Interfaces of the C library's calls for files, folders and signals, with their constants for
!> Linux (glibc); values and layouts are the same on x86-64 and aarch64.
module beamid_posix
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_int, c_int8_t, &
      c_int16_t, c_int32_t, c_int64_t, c_intptr_t, c_long, c_null_char, c_ptr, c_short, &
      c_size_t
   use beamid_kinds, only: ip
   implicit none
   private

   public :: c_fopen, c_fread, c_ferror, c_fclose, c_creat, c_fsync, c_close
   public :: c_link, c_rename, c_unlink, c_mkdir, c_rmdir, c_opendir, c_closedir, c_dirfd, c_flock
   public :: c_getpid, c_raise, c_setitimer, c_sigaction, c_signal, c_usleep
   public :: file_status, same_file, kind_there, entry_name, host_name, write_bytes, last_errno
   public :: errno_of, reason, c_poll, c_read

   !> Error numbers (errno), signals and their standard actions.
   integer(c_int), parameter, public :: enoent = 2, eintr = 4, eio = 5, eagain = 11, eexist = 17, &
      enotdir = 20, eisdir = 21, einval = 22, efbig = 27, enospc = 28, edquot = 122
   integer(c_int), parameter, public :: sighup = 1, sigint = 2, sigpipe = 13, sigalrm = 14, &
      sigterm = 15, sigxfsz = 25
   integer(c_intptr_t), parameter, public :: sig_dfl = 0, sig_ign = 1
   !> Operations of `c_flock`: exclusive lock; fail instead of waiting.
   integer(c_int), parameter, public :: lock_exclusive = 2, lock_nonblocking = 4
   !> Kinds of files, as `file_status` returns them.
   integer, parameter, public :: kind_directory = int(o'040000'), kind_regular = int(o'100000')
   integer(c_int), parameter :: at_fdcwd = -100, at_symlink_nofollow = 256, &
      basic_fields = int(z'7ff', c_int)
   integer, parameter :: kind_mask = int(o'170000')
   !> Longest name of a file in a folder [characters].
   integer, parameter, public :: max_name = 255

   !> `struct sigaction`, which is only stored and restored.
   type, bind(c), public :: signal_action_t
      integer(c_int64_t) :: bytes(32) = 0
   end type signal_action_t

   !> The first fields of `struct statx`, and the rest of its 256 bytes.
   type, bind(c) :: statx_t
      integer(c_int32_t) :: mask, block_size
      integer(c_int64_t) :: attributes
      integer(c_int32_t) :: links, user, group
      integer(c_int16_t) :: mode, unused
      integer(c_int64_t) :: inode, bytes
      integer(c_int64_t) :: rest(26)
   end type statx_t

   !> `struct dirent`: an entry of a folder.
   type, bind(c) :: dirent_t
      integer(c_int64_t) :: inode, offset
      integer(c_int16_t) :: length
      integer(c_int8_t) :: kind
      character(kind=c_char) :: name(max_name + 1)
   end type dirent_t

   !> `struct pollfd`: what to wait for.
   type, bind(c), public :: poll_t
      integer(c_int) :: descriptor = 0
      integer(c_short) :: events = 1   !< POLLIN
      integer(c_short) :: found = 0
   end type poll_t

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
      integer(c_size_t) function c_read(fd, buffer, n) bind(c, name='read')
         import :: c_char, c_int, c_size_t
         integer(c_int), value :: fd
         character(kind=c_char), intent(out) :: buffer(*)
         integer(c_size_t), value :: n
      end function c_read
      integer(c_int) function c_poll(which, n, milliseconds) bind(c, name='poll')
         import :: c_int, c_long, poll_t
         type(poll_t), intent(inout) :: which
         integer(c_long), value :: n
         integer(c_int), value :: milliseconds
      end function c_poll
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
      type(c_ptr) function c_opendir(path) bind(c, name='opendir')
         import :: c_char, c_ptr
         character(kind=c_char), intent(in) :: path(*)
      end function c_opendir
      type(c_ptr) function c_readdir(folder) bind(c, name='readdir')
         import :: c_ptr
         type(c_ptr), value :: folder
      end function c_readdir
      integer(c_int) function c_closedir(folder) bind(c, name='closedir')
         import :: c_int, c_ptr
         type(c_ptr), value :: folder
      end function c_closedir
      integer(c_int) function c_dirfd(folder) bind(c, name='dirfd')
         import :: c_int, c_ptr
         type(c_ptr), value :: folder
      end function c_dirfd
      integer(c_int) function c_flock(fd, operation) bind(c, name='flock')
         import :: c_int
         integer(c_int), value :: fd, operation
      end function c_flock
      integer(c_int) function c_gethostname(name, length) bind(c, name='gethostname')
         import :: c_char, c_int, c_size_t
         character(kind=c_char), intent(out) :: name(*)
         integer(c_size_t), value :: length
      end function c_gethostname
      integer(c_int) function c_usleep(microseconds) bind(c, name='usleep')
         import :: c_int
         integer(c_int), value :: microseconds
      end function c_usleep
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
      !> Replaces (unless `action` is null) and returns (unless `before` is null) the action of a
      !> signal. Unlike `c_signal` it keeps the flags of an action that another library has set.
      integer(c_int) function c_sigaction(number, action, before) bind(c, name='sigaction')
         import :: c_int, c_ptr
         integer(c_int), value :: number
         type(c_ptr), value :: action, before
      end function c_sigaction
      !> Sets a timer, 0: of real time.
      !>
      !> times  interval and first delay, each in seconds and microseconds
      integer(c_int) function c_setitimer(which, times, before) bind(c, name='setitimer')
         import :: c_int, c_long, c_ptr
         integer(c_int), value :: which
         integer(c_long), intent(in) :: times(4)
         type(c_ptr), value :: before
      end function c_setitimer
      integer(c_int) function c_raise(number) bind(c, name='raise')
         import :: c_int
         integer(c_int), value :: number
      end function c_raise
   end interface

contains

   !> Returns kind and size of the file that a path leads to; links are followed.
   subroutine file_status(path, kind, bytes, code)
      character(len=*), intent(in) :: path
      !> `kind_directory`, `kind_regular` or another kind; 0 after an error.
      integer, intent(out) :: kind
      !> Size according to the file system [bytes]; 0 for files whose content is made when read.
      integer(ip), intent(out) :: bytes
      !> 0, or the errno of a failure.
      integer(c_int), intent(out) :: code
      type(statx_t) :: status

      kind = 0
      bytes = 0
      code = errno_of(get_status(path, 0_c_int, status))
      if (code /= 0) return
      kind = iand(int(status%mode), kind_mask)
      bytes = status%bytes
   end subroutine file_status

   !> Returns whether two paths lead to the same existing file.
   logical function same_file(a, b) result(same)
      character(len=*), intent(in) :: a, b
      type(statx_t) :: status_a, status_b
      !> Place of the device's number in `rest`.
      integer, parameter :: device = 12

      same = get_status(a, 0_c_int, status_a) == 0
      if (same) same = get_status(b, 0_c_int, status_b) == 0
      if (same) same = status_a%inode == status_b%inode .and. &
         status_a%rest(device) == status_b%rest(device)
   end function same_file

   !> Returns the kind of the file at a path, where a link is not followed; 0: there is none.
   integer function kind_there(path)
      character(len=*), intent(in) :: path
      type(statx_t) :: status

      kind_there = 0
      if (get_status(path, at_symlink_nofollow, status) == 0) &
         kind_there = iand(int(status%mode), kind_mask)
   end function kind_there

   !> Calls `statx` for a path.
   integer(c_int) function get_status(path, flags, status)
      character(len=*), intent(in) :: path
      integer(c_int), intent(in) :: flags
      type(statx_t), intent(out) :: status

      get_status = c_statx(at_fdcwd, path//c_null_char, flags, basic_fields, status)
   end function get_status

   !> Returns the name of the next entry of an open folder; '' after the last one.
   function entry_name(folder) result(name)
      !> Folder from `c_opendir`.
      type(c_ptr), intent(in) :: folder
      character(len=:), allocatable :: name
      type(dirent_t), pointer :: entry
      type(c_ptr) :: location

      name = ''
      location = c_readdir(folder)
      if (.not. c_associated(location)) return
      call c_f_pointer(location, entry)
      name = up_to_null(entry%name)
   end function entry_name

   !> Returns the name of this machine; '' if it has none.
   function host_name() result(name)
      character(len=:), allocatable :: name
      character(kind=c_char) :: letters(max_name + 1)

      letters = c_null_char
      if (c_gethostname(letters, int(max_name, c_size_t)) /= 0) letters = c_null_char
      name = up_to_null(letters)
   end function host_name

   !> Returns the text before the null character in characters from C.
   pure function up_to_null(letters) result(text)
      character(kind=c_char), intent(in) :: letters(:)
      character(len=:), allocatable :: text
      integer :: i, length

      length = findloc(letters, c_null_char, dim=1) - 1
      allocate (character(len=length) :: text)
      do i = 1, length
         text(i:i) = letters(i)
      end do
   end function up_to_null

   !> Writes a whole text to an open file, pipe or terminal; returns 0 or an errno.
   integer(c_int) function write_bytes(fd, text) result(code)
      integer(c_int), intent(in) :: fd
      character(len=*), intent(in) :: text
      integer(ip) :: done, n
      integer(c_int) :: ignored

      code = 0
      done = 0
      do while (done < len(text, ip) .and. code == 0)
         n = c_write(fd, text(done + 1:), len(text, c_size_t) - done)
         if (n < 0) code = last_errno()
         if (n == 0) code = enospc
         ! EAGAIN: another program may have made the terminal non-blocking.
         if (code == eagain) ignored = c_usleep(1000_c_int)
         if (code == eintr .or. code == eagain) code = 0
         done = done + max(n, 0_ip)
      end do
   end function write_bytes

   !> Returns 0, or the errno of a C call that has just returned a number other than 0.
   integer(c_int) function errno_of(returned) result(code)
      integer(c_int), intent(in) :: returned

      code = 0
      if (returned /= 0) code = last_errno()
   end function errno_of

   !> Returns the C library's `errno`.
   integer(c_int) function last_errno() result(code)
      integer(c_int), pointer :: location

      call c_f_pointer(c_errno(), location)
      code = location
   end function last_errno

   !> Returns the meaning of an errno in words.
   function reason(code) result(text)
      !> Error number.
      integer(c_int), intent(in) :: code
      character(len=:), allocatable :: text
      character(kind=c_char), pointer :: letters(:)
      type(c_ptr) :: message

      message = c_strerror(code)
      call c_f_pointer(message, letters, [c_strlen(message) + 1])
      text = up_to_null(letters)
   end function reason

end module beamid_posix
