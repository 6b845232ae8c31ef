!> Cyclic redundancy checks: CRC-32 for the files that a manifest lists, CRC-64 for fingerprints.
module beamid_checksums
   use, intrinsic :: iso_fortran_env, only: int32, int64
   use beamid_kinds, only: ip
   implicit none
   private

   public :: crc32, crc64

   !> The polynomials of ISO 3309 and ECMA-182, the lowest coefficient in the highest bit of 32 and
   !> of 64, and all of these bits.
   integer(int64), parameter :: polynomial_32 = int(z'edb88320', int64), &
      polynomial_64 = int(z'c96c5795d7870f42', int64), &
      all_32 = int(z'ffffffff', int64), all_64 = not(0_int64)

contains

   !> Returns the CRC-32 of a text, or of everything that `before` stands for and the text.
   !>
   !> before  the checksum of the preceding bytes; 0: there are none
   pure integer(int32) function crc32(text, before)
      character(len=*), intent(in) :: text
      integer(int32), intent(in) :: before
      integer(int64) :: bits

      bits = crc(text, iand(int(before, int64), all_32), polynomial_32, all_32)
      ! The highest of the 32 bits is the sign.
      if (btest(bits, 31)) bits = bits - 2_int64**32
      crc32 = int(bits, int32)
   end function crc32

   !> Returns the CRC-64/XZ of a text, or of everything that `before` stands for and the text.
   !>
   !> before  as above
   pure integer(int64) function crc64(text, before)
      character(len=*), intent(in) :: text
      integer(int64), intent(in) :: before

      crc64 = crc(text, before, polynomial_64, all_64)
   end function crc64

   !> Returns the check for any polynomial of up to 64 bits.
   !>
   !> ones  all bits of the checksum
   pure integer(int64) function crc(text, before, polynomial, ones)
      character(len=*), intent(in) :: text
      integer(int64), intent(in) :: before, polynomial, ones
      integer(int64) :: rest(0:255)   !< remainders of single bytes
      integer(ip) :: at
      integer :: k

      rest = [(k, k=0, 255)]
      do k = 1, 8
         rest = merge(ieor(shiftr(rest, 1), polynomial), shiftr(rest, 1), btest(rest, 0))
      end do
      crc = ieor(before, ones)
      do at = 1, len(text, ip)
         crc = ieor(shiftr(crc, 8), rest(iand(ieor(crc, iachar(text(at:at), int64)), 255_int64)))
      end do
      crc = ieor(crc, ones)
   end function crc

end module beamid_checksums
