!> Cyclic redundancy checks: CRC-32 for the files in a manifest, CRC-64 for fingerprints.
module beamid_checksums
   use, intrinsic :: iso_fortran_env, only: int32, int64
   use beamid_kinds, only: ip
   implicit none
   private

   public :: crc32, crc64

   !> Polynomials of CRC-32 (ISO 3309) and CRC-64 (ECMA-182), reflected: the lowest coefficient is
   !> in the highest bit. Checksums with all bits set, of 32 and of 64 bits.
   integer(int64), parameter :: polynomial_32 = int(z'edb88320', int64), &
      polynomial_64 = int(z'c96c5795d7870f42', int64), &
      all_32 = int(z'ffffffff', int64), all_64 = not(0_int64)

contains

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

   !> Returns the reflected CRC of a text for any polynomial of up to 64 bits.
   !>
   !> before  checksum of the preceding bytes
   !> ones    checksum with all bits set
   pure integer(int64) function crc(text, before, polynomial, ones)
      character(len=*), intent(in) :: text
      integer(int64), intent(in) :: before, polynomial, ones
      integer(int64) :: remainder(0:255)   !< remainders of single bytes
      integer(ip) :: at
      integer :: k

      remainder = [(k, k=0, 255)]
      do k = 1, 8
         remainder = merge(ieor(shiftr(remainder, 1), polynomial), shiftr(remainder, 1), &
            btest(remainder, 0))
      end do
      crc = ieor(before, ones)
      do at = 1, len(text, ip)
         crc = ieor(shiftr(crc, 8), remainder(iand(ieor(crc, iachar(text(at:at), int64)), &
            255_int64)))
      end do
      crc = ieor(crc, ones)
   end function crc

end module beamid_checksums
