!> Reading and writing of whole files through the C library, because gfortran's runtime does not
!> report a full disk and waits for ever on a pipe.
module beamid_files
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_null_char, c_ptr, c_size_t
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: ip
   use beamid_posix, only: c_close, c_creat, c_fclose, c_ferror, c_fopen, c_fread, c_fsync, &
      efbig, enoent, errno_of, file_status, kind_directory, kind_regular, last_errno, reason, &
      write_bytes
   implicit none
   private

   public :: read_text, write_new

   !> Largest file that is read: 1 GiB [bytes].
   integer(ip), parameter :: max_bytes = 2_ip**30

contains

   !> Reads a whole regular file, byte for byte.
   !>
   !> text   '' if there is an error
   !> error  the file does not exist, is not a regular file, is too large or cannot be read
   subroutine read_text(path, text, error)
      character(len=*), intent(in) :: path
      character(len=:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: trouble
      integer(c_int) :: code
      integer(ip) :: bytes
      integer :: kind

      text = ''
      trouble = ''
      call file_status(path, kind, bytes, code)
      if (code == 0 .and. kind == kind_regular .and. bytes <= max_bytes) &
         call read_stream(path, bytes, text, code)
      if (code == enoent) then
         trouble = 'found no such file, expected a readable file'
      else if (code == efbig .or. kind == kind_regular .and. bytes > max_bytes) then
         trouble = 'found more than 1 GiB, expected a smaller file'
      else if (code /= 0) then
         trouble = 'found "'//reason(code)//'", expected a readable file'
      else if (kind == kind_directory) then
         trouble = 'is a directory, expected a file'
      else if (kind /= kind_regular) then
         trouble = 'found a pipe or a device, expected a regular file'
      end if
      if (trouble /= '') call bad_input(error, path//': '//trouble)
   end subroutine read_text

   !> Reads a file to its end; the file may have more bytes than its status says.
   subroutine read_stream(path, expected_bytes, text, code)
      character(len=*), intent(in) :: path
      integer(ip), intent(in) :: expected_bytes
      character(len=:), allocatable, intent(inout) :: text
      !> 0, or the errno of a failure.
      integer(c_int), intent(out) :: code
      type(c_ptr) :: stream
      character(len=:), allocatable :: buffer, larger
      integer(ip) :: filled
      integer(c_int) :: ignored

      stream = c_fopen(path//c_null_char, 'rb'//c_null_char)
      if (.not. c_associated(stream)) then
         code = last_errno()
         return
      end if
      filled = 0
      allocate (character(len=max(expected_bytes + 1, 4096_ip)) :: buffer)
      do
         filled = filled + c_fread(buffer(filled + 1:), 1_c_size_t, &
            len(buffer, c_size_t) - filled, stream)
         code = last_errno()
         if (filled < len(buffer, ip) .or. filled > max_bytes) exit
         allocate (character(len=2*filled) :: larger)
         larger(:filled) = buffer
         call move_alloc(larger, buffer)
      end do
      if (c_ferror(stream) == 0) code = merge(efbig, 0_c_int, filled > max_bytes)
      if (code == 0) text = buffer(:filled)
      ignored = c_fclose(stream)
   end subroutine read_stream

   !> Writes a new file and waits until it is on the disk; returns 0 or an errno.
   integer(c_int) function write_new(path, text) result(code)
      character(len=*), intent(in) :: path, text
      integer(c_int) :: fd, closing

      fd = c_creat(path//c_null_char, int(o'666', c_int))
      if (fd < 0) then
         code = last_errno()
         return
      end if
      code = write_bytes(fd, text)
      if (code == 0) code = errno_of(c_fsync(fd))
      closing = errno_of(c_close(fd))
      if (code == 0) code = closing
   end function write_new

end module beamid_files
