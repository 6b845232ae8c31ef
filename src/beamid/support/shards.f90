!> A long table in pieces: each shard holds the rows of some consecutive members, written to a
!> temporary name, then renamed, so that one that is there is whole; its last line has the checksum
!> of what is above. Its name says which members it holds and, by a fingerprint, of what: several
!> programs on several machines may add to one folder.
module beamid_shards
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use, intrinsic :: iso_fortran_env, only: int32
   use beamid_errors, only: error_t
   use beamid_files, only: read_text, write_new
   use beamid_folders, only: list_folder, sync_folder
   use beamid_kinds, only: ip
   use beamid_manifests, only: crc32, hexadecimal
   use beamid_paths, only: join_path
   use beamid_posix, only: c_getpid, c_rename, c_unlink, errno_of, host_name, kind_there, max_name
   use beamid_strings, only: to_text
   implicit none
   private

   public :: range_of_members_t, gaps, list_shards, read_shard, remove_shards, shard_path, &
      temporary_path, write_shard

   !> Consecutive members.
   type :: range_of_members_t
      integer :: first = 1, last = 0
   end type range_of_members_t

   character(len=*), parameter :: prefix = 'members-', ending = '.csv', part = '.part-', &
      closing = '# whole ', line_feed = achar(10)

contains

   !> Where the rows of these members are, or would be.
   function shard_path(folder, fingerprint, range) result(path)
      character(len=*), intent(in) :: folder, fingerprint
      type(range_of_members_t), intent(in) :: range
      character(len=:), allocatable :: path

      path = join_path(folder, prefix//fingerprint//'-'//to_text(range%first)//'-'// &
         to_text(range%last)//ending)
   end function shard_path

   !> A name that no other program writes to.
   function temporary_path(path) result(temporary)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: temporary

      temporary = path//part//host_name()//'-'//to_text(int(c_getpid()))
   end function temporary_path

   !> The shards of a fingerprint, by their first members.
   !>
   !> others  how many there are of other fingerprints
   !> code    0 or an errno
   subroutine list_shards(folder, fingerprint, shards, others, code)
      character(len=*), intent(in) :: folder, fingerprint
      type(range_of_members_t), allocatable, intent(out) :: shards(:)
      integer, intent(out) :: others
      integer(c_int), intent(out) :: code
      character(len=max_name), allocatable :: names(:)
      type(range_of_members_t) :: range
      integer :: k, n

      code = list_folder(folder, prefix, names)
      allocate (shards(size(names)))
      n = 0
      others = 0
      do k = 1, size(names)
         if (index(names(k), part) > 0) cycle
         if (index(names(k), prefix//fingerprint//'-') /= 1) then
            others = others + 1
         else if (named(names(k)(len(prefix//fingerprint) + 2:))) then
            n = n + 1
            shards(n) = range
         end if
      end do
      call sort(shards(:n))
      shards = shards(:n)

   contains

      !> Reads `1-100.csv`.
      logical function named(text)
         character(len=*), intent(in) :: text
         integer :: dash, dot, status

         dash = index(text, '-')
         dot = index(text, ending)
         named = dash > 1 .and. dot > dash + 1 .and. dash < 12 .and. dot < dash + 12
         if (named) named = verify(text(:dash - 1)//text(dash + 1:dot - 1), '0123456789') == 0
         if (.not. named) return
         read (text(:dash - 1), *, iostat=status) range%first
         if (status == 0) read (text(dash + 1:dot - 1), *, iostat=status) range%last
         named = status == 0
      end function named

   end subroutine list_shards

   !> Ascending first members, by merging: there may be thousands.
   recursive subroutine sort(shards)
      type(range_of_members_t), intent(inout) :: shards(:)
      type(range_of_members_t) :: half(size(shards)/2)
      integer :: i, j, k

      if (size(shards) < 2) return
      call sort(shards(:size(half)))
      call sort(shards(size(half) + 1:))
      half = shards(:size(half))
      j = size(half) + 1
      k = 1
      do i = 1, size(half)
         do while (j <= size(shards))
            if (shards(j)%first >= half(i)%first) exit
            shards(k) = shards(j)
            j = j + 1
            k = k + 1
         end do
         shards(k) = half(i)
         k = k + 1
      end do
   end subroutine sort

   !> What no shard holds of a range.
   pure function gaps(shards, range) result(missing)
      type(range_of_members_t), intent(in) :: shards(:), range
      type(range_of_members_t), allocatable :: missing(:)
      integer :: k, next

      allocate (missing(0))
      next = range%first
      do k = 1, size(shards)
         if (shards(k)%first > range%last .or. next > range%last) exit
         if (shards(k)%first > next) missing = [missing, range_of_members_t(next, &
            shards(k)%first - 1)]
         next = max(next, shards(k)%last + 1)
      end do
      if (next <= range%last) missing = [missing, range_of_members_t(next, range%last)]
   end function gaps

   !> Writes a shard; returns 0 or an errno, and then there is none.
   integer(c_int) function write_shard(path, rows) result(code)
      character(len=*), intent(in) :: path, rows
      character(len=:), allocatable :: temporary
      integer(c_int) :: ignored

      temporary = temporary_path(path)
      code = write_new(temporary, rows//closing//checksum(rows)//line_feed)
      if (code == 0) code = errno_of(c_rename(temporary//c_null_char, path//c_null_char))
      if (code /= 0) ignored = c_unlink(temporary//c_null_char)
   end function write_shard

   !> The rows of a shard; one that is not whole is an error.
   subroutine read_shard(path, rows, whole)
      character(len=*), intent(in) :: path
      character(len=:), allocatable, intent(out) :: rows
      logical, intent(out) :: whole
      character(len=:), allocatable :: text
      type(error_t), allocatable :: error
      integer(ip) :: n

      rows = ''
      whole = .false.
      call read_text(path, text, error)
      if (allocated(error)) return
      n = len(text, ip) - len(closing) - 9
      if (n < 0) return
      rows = text(:n)
      whole = text(n + 1:) == closing//checksum(rows)//line_feed
   end subroutine read_shard

   pure function checksum(rows) result(digits)
      character(len=*), intent(in) :: rows
      character(len=8) :: digits

      digits = hexadecimal(crc32(rows, 0_int32))
   end function checksum

   !> Removes what programs that have died left behind, and shards.
   subroutine remove_shards(folder, but_of)
      character(len=*), intent(in) :: folder
      !> The fingerprint of shards that stay, '': none; left out: all stay.
      character(len=*), intent(in), optional :: but_of
      character(len=max_name), allocatable :: names(:)
      character(len=:), allocatable :: mark
      integer(c_int) :: ignored
      integer :: at, k

      mark = part//host_name()//'-'
      ignored = list_folder(folder, prefix, names)
      do k = 1, size(names)
         at = index(names(k), part)
         if (at > 0) then
            if (index(names(k), mark) /= at) cycle
            ! Its writer is on this machine and alive.
            if (kind_there('/proc/'//trim(names(k)(at + len(mark):))) /= 0) cycle
         else
            if (.not. present(but_of)) cycle
            if (but_of /= '' .and. index(names(k), prefix//but_of//'-') == 1) cycle
         end if
         ignored = c_unlink(join_path(folder, trim(names(k)))//c_null_char)
      end do
      ignored = sync_folder(folder)
   end subroutine remove_shards

end module beamid_shards
