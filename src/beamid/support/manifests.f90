!> The manifest of an output folder: name, size and checksum of each file, and the command whose
!> complete run has written the file.
!>
!> The checksum is CRC-32 as in gzip, zip and PNG (ISO 3309; Python: `zlib.crc32`, coreutils 9.6 and
!> newer: `cksum -a crc32b`). It detects a truncated file or a file of another run, not a forged
!> one.
module beamid_manifests
   use, intrinsic :: iso_c_binding, only: c_associated, c_int, c_null_char, c_ptr, c_size_t
   use, intrinsic :: iso_fortran_env, only: int32
   use beamid_errors, only: bad_input, error_t
   use beamid_files, only: read_text
   use beamid_fingerprints, only: crc32
   use beamid_kinds, only: ip
   use beamid_paths, only: join_path
   use beamid_posix, only: c_fclose, c_ferror, c_fopen, c_fread, file_status, kind_regular, &
      kind_there, last_errno
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: new_entry, entry_of, entry_of_file, entries_in, name_in, command_in, compare, &
      read_listed

   character(len=*), parameter, public :: manifest_name = 'manifest.txt'
   character(len=*), parameter, public :: manifest_header = 'name bytes crc32 command'
   !> Length of a line [characters]: a name has at most 255.
   integer, parameter, public :: entry_length = 320

   character(len=*), parameter :: line_feed = achar(10)

contains

   !> Returns the line of a file: `estimates.csv 1234 0a1b2c3d identify`.
   pure function entry_of(name, text, command) result(entry)
      !> Name of the file, its whole text, and the command (one word).
      character(len=*), intent(in) :: name, text, command
      character(len=:), allocatable :: entry

      entry = new_entry(name, len(text, ip), crc32(text, 0_int32), command)
   end function entry_of

   !> Computes the line of a file that may be too large to be held in memory.
   subroutine entry_of_file(path, name, command, entry, code)
      character(len=*), intent(in) :: path, name, command
      character(len=:), allocatable, intent(out) :: entry
      !> 0, or the errno of a failure.
      integer(c_int), intent(out) :: code
      type(c_ptr) :: stream
      integer(ip) :: bytes
      integer(int32) :: checksum
      integer(c_int) :: ignored
      integer :: kind

      entry = ''
      call file_status(path, kind, bytes, code)
      if (code /= 0) return
      stream = c_fopen(path//c_null_char, 'rb'//c_null_char)
      if (.not. c_associated(stream)) then
         code = last_errno()
         return
      end if
      call read_checksum(stream, checksum, code)
      entry = new_entry(name, bytes, checksum, command)
      ignored = c_fclose(stream)
   end subroutine entry_of_file

   !> Returns the complete lines below the header of a manifest; size 0 if the text is no manifest.
   pure function entries_in(text) result(entries)
      character(len=*), intent(in) :: text
      character(len=entry_length), allocatable :: entries(:)
      integer(ip) :: at, next, n

      n = 0
      if (index(text, manifest_header//line_feed) == 1) &
         n = count([(text(at:at) == line_feed, at=1, len(text, ip))], kind=ip) - 1
      allocate (entries(n))
      next = len(manifest_header) + 2
      do at = 1, n
         entries(at) = text(next:next + index(text(next:), line_feed, kind=ip) - 2)
         next = next + index(text(next:), line_feed, kind=ip)
      end do
   end function entries_in

   !> Returns the name in a line: everything but the last three words. '' if it has a '/', and might
   !> lead to another folder.
   pure function name_in(entry) result(name)
      character(len=*), intent(in) :: entry
      character(len=:), allocatable :: name
      integer :: k

      name = trim(entry)
      do k = 1, 3
         name = name(:max(index(name, ' ', back=.true.) - 1, 0))
      end do
      if (index(name, '/') > 0) name = ''
   end function name_in

   !> Returns the last word of a line: the command.
   pure function command_in(entry) result(command)
      character(len=*), intent(in) :: entry
      character(len=:), allocatable :: command

      command = trim(entry(index(trim(entry), ' ', back=.true.) + 1:))
   end function command_in

   !> Compares a file in a folder with a line of the manifest.
   !>
   !> same  whether the folder holds the file of the line, byte for byte
   subroutine compare(directory, entry, same, code)
      character(len=*), intent(in) :: directory, entry
      logical, intent(out) :: same
      !> 0, or the errno if the file exists and cannot be read.
      integer(c_int), intent(out) :: code
      character(len=:), allocatable :: path, there
      integer(ip) :: bytes
      integer :: kind

      same = .false.
      code = 0
      path = join_path(directory, name_in(entry))
      if (kind_there(path) /= kind_regular) return
      ! A file of another size need not be read.
      call file_status(path, kind, bytes, code)
      if (code /= 0) return
      if (index(entry, name_in(entry)//' '//to_text(bytes)//' ') /= 1) return
      call entry_of_file(path, name_in(entry), command_in(entry), there, code)
      same = entry == there
   end subroutine compare

   !> Reads a file of an output folder and checks it against the manifest.
   !>
   !> text   of the file; empty: there is no such file
   !> error  the file or the manifest cannot be read, or the file has not the bytes that it lists
   subroutine read_listed(directory, name, text, error)
      character(len=*), intent(in) :: directory, name
      character(len=:), allocatable, intent(out) :: text
      type(error_t), allocatable, intent(out) :: error
      character(len=entry_length), allocatable :: entries(:)
      character(len=:), allocatable :: manifest, path
      integer :: k

      text = ''
      path = join_path(directory, name)
      if (kind_there(path) == 0) return
      call read_text(path, text, error)
      if (.not. allocated(error)) call read_text(join_path(directory, manifest_name), manifest, &
         error)
      if (allocated(error)) return
      entries = entries_in(manifest)
      do k = 1, size(entries)
         if (name_in(entries(k)) /= name) cycle
         if (entries(k) == entry_of(name, text, command_in(entries(k)))) return
      end do
      call bad_input(error, path//': found another size or checksum than in '//manifest_name// &
         ', expected the file as a run has written it')
   end subroutine read_listed

   !> Computes the checksum of an open stream piece by piece, because the file may be too large for
   !> the memory.
   subroutine read_checksum(stream, checksum, code)
      type(c_ptr), intent(in) :: stream
      integer(int32), intent(out) :: checksum
      !> 0, or the errno of a failure.
      integer(c_int), intent(out) :: code
      character(len=:), allocatable :: piece
      integer(ip) :: got

      allocate (character(len=2**20) :: piece)
      checksum = 0
      do
         got = c_fread(piece, 1_c_size_t, len(piece, c_size_t), stream)
         code = merge(last_errno(), 0_c_int, c_ferror(stream) /= 0)
         checksum = crc32(piece(:got), checksum)
         if (got < len(piece, ip)) exit
      end do
   end subroutine read_checksum

   !> Returns a line of the manifest.
   !>
   !> bytes     length of the file
   !> checksum  CRC-32 of the file
   pure function new_entry(name, bytes, checksum, command) result(entry)
      character(len=*), intent(in) :: name, command
      integer(ip), intent(in) :: bytes
      integer(int32), intent(in) :: checksum
      character(len=:), allocatable :: entry

      entry = name//' '//to_text(bytes)//' '//hexadecimal(checksum)//' '//command
   end function new_entry

   !> Returns a checksum as eight hexadecimal digits.
   pure function hexadecimal(checksum) result(digits)
      integer(int32), intent(in) :: checksum
      character(len=8) :: digits

      write (digits, '(z8.8)') checksum
      digits = lower(digits)
   end function hexadecimal

end module beamid_manifests
