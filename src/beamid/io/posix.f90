!> Calls of the C library that `beamid_files` is made of, with their constants for Linux (glibc):
!> the same values and layouts on x86-64 and aarch64.
module beamid_posix
   use, intrinsic :: iso_c_binding, only: c_char, c_f_pointer, c_int, c_int16_t, c_int32_t, &
      c_int64_t, c_intptr_t, c_null_char, c_ptr, c_size_t
   use beamid_kinds, only: ip
   implicit none
   private

   public :: c_fopen, c_fread, c_ferror, c_fclose, c_creat, c_write, c_fsync, c_close
   public :: c_link, c_rename, c_unlink, c_mkdir, c_rmdir, c_getpid, c_signal
   public :: file_status, last_errno, reason

   integer(c_int), parameter, public :: enoent = 2, eintr = 4, eio = 5, eexist = 17, &
      enotdir = 20, efbig = 27, enospc = 28, edquot = 122
   integer(c_int), parameter, public :: sigxfsz = 25
   integer(c_intptr_t), parameter, public :: sig_ign = 1
   !> What a path leads to, as `file_status` says it.
   integer, parameter, public :: kind_directory = int(o'040000'), kind_regular = int(o'100000')

   !> The head of `struct statx`, and room for the rest of its 256 bytes.
   type, bind(c) :: statx_t
      integer(c_int32_t) :: mask, block_size
      integer(c_int64_t) :: attributes
      integer(c_int32_t) :: links, user, group
      integer(c_int16_t) :: mode, unused
      integer(c_int64_t) :: inode, bytes
      integer(c_int64_t) :: rest(26)
   end type statx_t

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

   !> What a path leads to, links followed.
   subroutine file_status(path, kind, bytes, code)
      character(len=*), intent(in) :: path
      !> `kind_directory`, `kind_regular` or another; 0 after an error.
      integer, intent(out) :: kind
      !> The size that the file system gives; 0 for files made on the fly.
      integer(ip), intent(out) :: bytes
      !> 0 or an errno.
      integer(c_int), intent(out) :: code
      integer(c_int), parameter :: at_fdcwd = -100, basic_fields = int(z'7ff', c_int)
      integer, parameter :: kind_mask = int(o'170000')
      type(statx_t) :: status

      kind = 0
      bytes = 0
      code = c_statx(at_fdcwd, path//c_null_char, 0_c_int, basic_fields, status)
      if (code /= 0) then
         code = last_errno()
         return
      end if
      kind = iand(int(status%mode), kind_mask)
      bytes = status%bytes
   end subroutine file_status

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

end module beamid_posix
