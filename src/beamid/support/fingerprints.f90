!> Cyclic redundancy checks (CRC-32 for the files in a manifest), and fingerprints of the inputs of
!> a computation: 64 bits that tell whether stored results belong to the same inputs.
!>
!> The checksum of a fingerprint is CRC-64/XZ (ECMA-182, reflected). Two different inputs share it
!> with a probability of 5e-20; with 32 bits it would be 2e-10, so that 10,000 cases compared daily
!> for a year would overlook a change with a probability of 1e-3. It detects accidental changes, not
!> forged files.
module beamid_fingerprints
   use, intrinsic :: iso_fortran_env, only: int32, int64
   use beamid_errors, only: error_t
   use beamid_files, only: read_text
   use beamid_kinds, only: ip
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: fingerprint_t, crc32, crc64

   !> Number of hexadecimal digits of a fingerprint.
   integer, parameter, public :: fingerprint_length = 16

   !> Checksum over all texts and files that were added, in their order. The length of each is added
   !> before its bytes, so that moving bytes from one text to the next changes the fingerprint.
   type :: fingerprint_t
      integer(int64), private :: checksum = 0
   contains
      procedure :: add
      procedure :: add_file
      procedure :: digits
   end type fingerprint_t

   !> Polynomials of CRC-32 (ISO 3309) and CRC-64 (ECMA-182), reflected: the lowest coefficient is
   !> in the highest bit. Checksums with all bits set, of 32 and of 64 bits.
   integer(int64), parameter :: polynomial_32 = int(z'edb88320', int64), &
      polynomial_64 = int(z'c96c5795d7870f42', int64), &
      all_32 = int(z'ffffffff', int64), all_64 = not(0_int64)

contains

   !> Adds a text.
   pure subroutine add(self, text)
      class(fingerprint_t), intent(inout) :: self
      character(len=*), intent(in) :: text

      self%checksum = crc64(to_text(len(text, ip))//':', self%checksum)
      self%checksum = crc64(text, self%checksum)
   end subroutine add

   !> Adds the bytes of a file, but not its path, so that a folder may be moved or have another name
   !> on another machine. A file that cannot be read differs from every file that can be read.
   subroutine add_file(self, path)
      class(fingerprint_t), intent(inout) :: self
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: text
      type(error_t), allocatable :: error

      call read_text(path, text, error)
      if (allocated(error)) then
         self%checksum = crc64('unreadable:', self%checksum)
      else
         call self%add(text)
      end if
   end subroutine add_file

   !> Returns the fingerprint in hexadecimal digits.
   pure function digits(self)
      class(fingerprint_t), intent(in) :: self
      character(len=fingerprint_length) :: digits

      write (digits, '(z16.16)') self%checksum
      digits = lower(digits)
   end function digits

   !> Returns the CRC-32 of a text that may continue preceding bytes.
   !>
   !> before  checksum of the preceding bytes; 0: there are none
   pure integer(int32) function crc32(text, before)
      character(len=*), intent(in) :: text
      integer(int32), intent(in) :: before
      integer(int64) :: bits

      bits = crc(text, iand(int(before, int64), all_32), polynomial_32, all_32)
      ! Bit 31 is the sign of the 32-bit result.
      if (btest(bits, 31)) bits = bits - 2_int64**32
      crc32 = int(bits, int32)
   end function crc32

   !> Returns the CRC-64/XZ of a text that may continue preceding bytes.
   !>
   !> before  checksum of the preceding bytes; 0: there are none
   pure integer(int64) function crc64(text, before)
      character(len=*), intent(in) :: text
      integer(int64), intent(in) :: before

      crc64 = crc(text, before, polynomial_64, all_64)
   end function crc64

   !> Returns the reflected CRC of a text for any polynomial of up to 64 bits. Eight bytes are taken
   !> at once, with a table for each of their places, if the text is long enough for these tables.
   !>
   !> before  checksum of the preceding bytes
   !> ones    checksum with all bits set
   pure integer(int64) function crc(text, before, polynomial, ones)
      character(len=*), intent(in) :: text
      integer(int64), intent(in) :: before, polynomial, ones
      integer(int64), parameter :: low = 255
      integer(ip), parameter :: long = 8192
      integer(int64) :: remainder(0:255, 0:7)   !< of single bytes, with as many zero bytes behind
      integer(int64) :: bits
      integer(ip) :: at, eights
      integer :: k

      remainder(:, 0) = [(k, k=0, 255)]
      do k = 1, 8
         remainder(:, 0) = merge(ieor(shiftr(remainder(:, 0), 1), polynomial), &
            shiftr(remainder(:, 0), 1), btest(remainder(:, 0), 0))
      end do
      crc = ieor(before, ones)
      eights = 0
      if (len(text, ip) >= long) then
         do k = 1, 7
            remainder(:, k) = ieor(shiftr(remainder(:, k - 1), 8), &
               remainder(iand(remainder(:, k - 1), low), 0))
         end do
         eights = len(text, ip)/8
      end if
      do at = 1, 8*eights, 8
         ! The first byte is the lowest, as processors store it on which this program runs.
         bits = ieor(crc, transfer(text(at:at + 7), bits))
         crc = ieor(ieor(ieor(remainder(iand(bits, low), 7), &
            remainder(iand(shiftr(bits, 8), low), 6)), &
            ieor(remainder(iand(shiftr(bits, 16), low), 5), &
            remainder(iand(shiftr(bits, 24), low), 4))), &
            ieor(ieor(remainder(iand(shiftr(bits, 32), low), 3), &
            remainder(iand(shiftr(bits, 40), low), 2)), &
            ieor(remainder(iand(shiftr(bits, 48), low), 1), &
            remainder(shiftr(bits, 56), 0))))
      end do
      do at = 8*eights + 1, len(text, ip)
         crc = ieor(shiftr(crc, 8), remainder(iand(ieor(crc, iachar(text(at:at), int64)), low), 0))
      end do
      crc = ieor(crc, ones)
   end function crc

end module beamid_fingerprints
