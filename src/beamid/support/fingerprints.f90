!> Fingerprints of the inputs of a computation: 64 bits that tell whether stored results belong to
!> the same inputs.
!>
!> The checksum is CRC-64/XZ (ECMA-182, reflected). Two different inputs share it with a probability
!> of 5e-20; with 32 bits it would be 2e-10, so that 10,000 cases compared daily for a year would
!> overlook a change with a probability of 1e-3. It detects accidental changes, not forged files.
module beamid_fingerprints
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid_checksums, only: crc64
   use beamid_errors, only: error_t
   use beamid_files, only: read_text
   use beamid_kinds, only: ip
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: fingerprint_t

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

end module beamid_fingerprints
