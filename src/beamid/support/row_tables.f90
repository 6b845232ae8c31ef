!> Tables whose rows are written as text piece by piece while the file is written, so that the text
!> of a long table is never in memory as a whole. While a piece is written, other threads make the
!> text of the next ones.
module beamid_row_tables
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use, intrinsic :: iso_fortran_env, only: int32
   use beamid_fingerprints, only: crc32
   use beamid_interrupts, only: stop_flag
   use beamid_kinds, only: ip
   use beamid_posix, only: c_close, c_creat, c_fsync, errno_of, last_errno, write_bytes
   use beamid_texts, only: text_t
   implicit none
   private

   public :: row_table_t, table_text, write_table

   !> A table below its header.
   type, abstract :: row_table_t
      integer :: rows = 0   !< number of rows
   contains
      procedure(add_rows), deferred :: add_rows
      procedure(is_finite), deferred :: is_finite
   end type row_table_t

   abstract interface
      !> Adds rows to a text, one line each; several threads call it at a time.
      !>
      !> first, last  numbers of the first and the last of these rows
      subroutine add_rows(self, first, last, text)
         import :: row_table_t, text_t
         class(row_table_t), intent(in) :: self
         integer, intent(in) :: first, last
         type(text_t), intent(inout) :: text
      end subroutine add_rows
      !> Returns whether all numbers of the table are finite.
      pure logical function is_finite(self)
         import :: row_table_t
         class(row_table_t), intent(in) :: self
      end function is_finite
   end interface

   !> Number of rows of a piece.
   integer, parameter :: piece_rows = 4096

contains

   !> Returns the whole text of a table.
   !>
   !> header  text before the first row
   function table_text(header, table) result(content)
      character(len=*), intent(in) :: header
      class(row_table_t), intent(in) :: table
      character(len=:), allocatable :: content
      type(text_t) :: text

      call text%add(header)
      call table%add_rows(1, table%rows, text)
      content = text%content()
   end function table_text

   !> Writes a table to a new file and waits until it is on the disk.
   !>
   !> header    text before the first row
   !> bytes     length of the file
   !> checksum  CRC-32 of the file
   !> code      0, or the errno of a failure
   subroutine write_table(path, header, table, bytes, checksum, code)
      character(len=*), intent(in) :: path, header
      class(row_table_t), intent(in) :: table
      integer(ip), intent(out) :: bytes
      integer(int32), intent(out) :: checksum
      integer(c_int), intent(out) :: code
      integer(c_int) :: fd, closing
      integer :: first

      bytes = 0
      checksum = 0
      fd = c_creat(path//c_null_char, int(o'666', c_int))
      if (fd < 0) then
         code = last_errno()
         return
      end if
      call put(header)
      !$omp parallel do ordered schedule(static, 1) copyin(stop_flag) if(table%rows > piece_rows)
      do first = 1, table%rows, piece_rows
         call put_rows(first, min(first + piece_rows - 1, table%rows))
      end do
      !$omp end parallel do
      if (code == 0) code = errno_of(c_fsync(fd))
      closing = errno_of(c_close(fd))
      if (code == 0) code = closing

   contains

      !> Writes some rows behind those before them; called from an ordered loop.
      subroutine put_rows(first, last)
         integer, intent(in) :: first, last
         type(text_t) :: text
         character(len=:), allocatable :: piece

         call table%add_rows(first, last, text)
         call text%get(piece)
         !$omp ordered
         if (code == 0) call put(piece)
         !$omp end ordered
      end subroutine put_rows

      !> Writes a piece.
      subroutine put(piece)
         character(len=*), intent(in) :: piece

         code = write_bytes(fd, piece)
         bytes = bytes + len(piece, ip)
         checksum = crc32(piece, checksum)
      end subroutine put

   end subroutine write_table

end module beamid_row_tables
