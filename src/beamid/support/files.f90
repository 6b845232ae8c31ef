!> Whole files in and out, through the C library: gfortran's own runtime does not report a full
!> disk, and waits for ever on a pipe.
module beamid_files
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_null_char, c_ptr, c_size_t
   use beamid_kinds, only: ip
   use beamid_errors, only: error_t, bad_input
   use beamid_posix, only: c_close, c_creat, c_fclose, c_ferror, c_fopen, c_fread, c_fsync, &
      enoent, file_status, kind_directory, kind_regular, last_errno, reason, write_bytes
   implicit none
   private

   public :: read_text, write_new

   !> The largest file that is read: 1 GiB.
   integer(ip), parameter :: max_bytes = 2_ip**30

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

   !> Writes one new file and waits until the disk has it; returns 0 or an errno.
   integer(c_int) function write_new(path, text) result(code)
      character(len=*), intent(in) :: path, text
      integer(c_int) :: fd

      fd = c_creat(path//c_null_char, int(o'666', c_int))
      if (fd < 0) then
         code = last_errno()
         return
      end if
      code = write_bytes(fd, text)
      if (code == 0) then
         if (c_fsync(fd) /= 0) code = last_errno()
      end if
      if (c_close(fd) /= 0 .and. code == 0) code = last_errno()
   end function write_new

end module beamid_files
