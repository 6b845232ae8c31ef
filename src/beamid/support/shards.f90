!> A long table in pieces (shards), each with the rows of consecutive ensemble members. The name and
!> the first line of a shard state the members and, by a fingerprint, the ensemble; the last line
!> has the checksum of everything above. A shard is written under a temporary name and then renamed,
!> so that several programs on several machines may add shards to one folder.
module beamid_shards
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use beamid_errors, only: bad_input, error_t
   use beamid_files, only: read_text, write_new
   use beamid_fingerprints, only: fingerprint_length, fingerprint_t
   use beamid_folders, only: list_folder, sync_folder
   use beamid_kinds, only: ip
   use beamid_paths, only: join_path
   use beamid_posix, only: c_getpid, c_rename, c_unlink, errno_of, file_status, host_name, &
      kind_directory, kind_regular, kind_there, max_name, reason
   use beamid_strings, only: to_text
   implicit none
   private

   public :: range_of_members_t, gaps, list_shards, read_shard, remove_damaged, remove_shards, &
      shard_path, temporary_path, write_shard

   !> Consecutive members, from `first` to `last`; by default none.
   type :: range_of_members_t
      integer :: first = 1, last = 0
   end type range_of_members_t

   !> Parts of the names of shards and of temporary files, and the beginning of a shard's last line.
   character(len=*), parameter :: prefix = 'members-', ending = '.csv', part = '.part-', &
      closing = '# whole ', line_feed = achar(10)

contains

   !> Returns the path of the shard of these members, whether or not it exists.
   function shard_path(folder, fingerprint, range) result(path)
      character(len=*), intent(in) :: folder, fingerprint
      type(range_of_members_t), intent(in) :: range
      character(len=:), allocatable :: path

      path = join_path(folder, prefix//fingerprint//'-'//to_text(range%first)//'-'// &
         to_text(range%last)//ending)
   end function shard_path

   !> Returns a temporary path, to which no other program writes.
   function temporary_path(path) result(temporary)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: temporary

      temporary = path//part//host_name()//'-'//to_text(int(c_getpid()))
   end function temporary_path

   !> Lists the shards of a fingerprint in the order of their first members.
   !>
   !> others  number of shards with other fingerprints
   !> error   the folder cannot be read, or something that is not a file has the name of a shard
   subroutine list_shards(folder, fingerprint, shards, others, error)
      character(len=*), intent(in) :: folder, fingerprint
      type(range_of_members_t), allocatable, intent(out) :: shards(:)
      integer, intent(out) :: others
      type(error_t), allocatable, intent(out) :: error
      character(len=max_name), allocatable :: names(:)
      character(len=:), allocatable :: path
      type(range_of_members_t) :: range
      integer(c_int) :: absent, code
      integer(ip) :: bytes
      integer :: k, kind, n

      code = list_folder(folder, prefix, names)
      allocate (shards(size(names)))
      n = 0
      others = 0
      do k = 1, size(names)
         if (index(names(k), part) > 0) cycle
         path = join_path(folder, trim(names(k)))
         if (index(names(k), prefix//fingerprint//'-') /= 1) then
            if (kind_there(path) == kind_regular) others = others + 1
            cycle
         end if
         range = range_in(names(k)(len(prefix//fingerprint) + 2:))
         if (path /= shard_path(folder, fingerprint, range)) cycle
         call file_status(path, kind, bytes, absent)
         if (absent /= 0) cycle   ! Another program has removed it just now.
         if (kind /= kind_regular) then
            call bad_input(error, path//': found a '//trim(merge('directory       ', &
               'pipe or a device', kind == kind_directory))//' with the name of a shard, '// &
               'expected a file; move it elsewhere and run the ensemble again')
            return
         end if
         n = n + 1
         shards(n) = range
      end do
      call sort(shards(:n))
      shards = shards(:n)
      if (code /= 0) call bad_input(error, folder//': the folder cannot be read: '//reason(code))
   end subroutine list_shards

   !> Returns the range in a name like `1-100.csv`; an empty range if there is none.
   type(range_of_members_t) function range_in(name) result(range)
      character(len=*), intent(in) :: name
      integer :: dash, dot, status

      dash = index(name, '-')
      dot = index(name, '.')
      if (dash < 2 .or. dash > 11 .or. dot < dash + 2 .or. dot > dash + 11) return
      if (verify(name(:dash - 1)//name(dash + 1:dot - 1), '0123456789') > 0) return
      read (name(:dash - 1), *, iostat=status) range%first
      if (status == 0) read (name(dash + 1:dot - 1), *, iostat=status) range%last
      if (status /= 0) range = range_of_members_t()
   end function range_in

   !> Sorts shards by their first members. Merge sort is used because there may be thousands.
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

   !> Returns the members of a range that no shard holds.
   !>
   !> shards  in the order of their first members
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
         next = max(next, min(shards(k)%last, range%last) + 1)
      end do
      if (next <= range%last) missing = [missing, range_of_members_t(next, range%last)]
   end function gaps

   !> Writes a shard; returns 0, or the errno of a failure, after which the shard does not exist.
   integer(c_int) function write_shard(folder, fingerprint, range, rows) result(code)
      character(len=*), intent(in) :: folder, fingerprint, rows
      type(range_of_members_t), intent(in) :: range
      character(len=:), allocatable :: path, temporary, text
      integer(c_int) :: ignored

      path = shard_path(folder, fingerprint, range)
      temporary = temporary_path(path)
      text = opening(fingerprint, range)//rows
      code = write_new(temporary, text//closing//checksum(text)//line_feed)
      if (code == 0) code = errno_of(c_rename(temporary//c_null_char, path//c_null_char))
      if (code /= 0) ignored = c_unlink(temporary//c_null_char)
   end function write_shard

   !> Reads the rows of a shard.
   !>
   !> sound  whether the checksum is right and the shard belongs to this fingerprint and range
   !> error  the file cannot be read
   subroutine read_shard(folder, fingerprint, range, rows, sound, error)
      character(len=*), intent(in) :: folder, fingerprint
      type(range_of_members_t), intent(in) :: range
      character(len=:), allocatable, intent(out) :: rows
      logical, intent(out) :: sound
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: first_line, text
      integer(ip) :: n

      rows = ''
      sound = .false.
      call read_text(shard_path(folder, fingerprint, range), text, error)
      if (allocated(error)) return
      first_line = opening(fingerprint, range)
      n = len(text, ip) - len(closing) - fingerprint_length - 1
      if (n < len(first_line)) return
      sound = text(:len(first_line)) == first_line .and. &
         text(n + 1:) == closing//checksum(text(:n))//line_feed
      if (sound) rows = text(len(first_line) + 1:n)
   end subroutine read_shard

   !> Reads all shards that hold members of a range, and removes damaged shards from the folder and
   !> from the list: those with a wrong checksum, and those that do not hold what their names say.
   !>
   !> range    on return it includes the members of the removed shards
   !> removed  number of removed shards
   !> first    path of the first one; '': there was none
   !> error    a shard cannot be read; it is not removed
   subroutine remove_damaged(folder, fingerprint, range, shards, removed, first, error)
      character(len=*), intent(in) :: folder, fingerprint
      type(range_of_members_t), intent(inout) :: range
      type(range_of_members_t), allocatable, intent(inout) :: shards(:)
      integer, intent(out) :: removed
      character(len=:), allocatable, intent(out) :: first
      type(error_t), allocatable, intent(out) :: error
      type(range_of_members_t) :: wanted
      character(len=:), allocatable :: path, rows
      integer(c_int) :: ignored
      logical :: keeps(size(shards)), sound
      integer :: k

      removed = 0
      first = ''
      wanted = range
      keeps = .true.
      do k = 1, size(shards)
         if (shards(k)%last < wanted%first .or. shards(k)%first > wanted%last) cycle
         path = shard_path(folder, fingerprint, shards(k))
         call read_shard(folder, fingerprint, shards(k), rows, sound, error)
         if (allocated(error)) then
            if (kind_there(path) /= 0) return
            deallocate (error)   ! Another program has removed it just now.
         else if (.not. sound) then
            ignored = c_unlink(path//c_null_char)
            removed = removed + 1
            if (first == '') first = path
            range%first = min(range%first, max(shards(k)%first, 1))
            range%last = max(range%last, shards(k)%last)
         end if
         keeps(k) = sound
      end do
      shards = pack(shards, keeps)
   end subroutine remove_damaged

   !> Returns the first line of a shard.
   pure function opening(fingerprint, range) result(line)
      character(len=*), intent(in) :: fingerprint
      type(range_of_members_t), intent(in) :: range
      character(len=:), allocatable :: line

      line = '# members '//to_text(range%first)//' to '//to_text(range%last)//' of '// &
         fingerprint//line_feed
   end function opening

   !> Returns the checksum of everything above the last line of a shard.
   pure function checksum(text) result(digits)
      character(len=*), intent(in) :: text
      character(len=fingerprint_length) :: digits
      type(fingerprint_t) :: fingerprint

      call fingerprint%add(text)
      digits = fingerprint%digits()
   end function checksum

   !> Removes temporary files of programs that have died, and shards.
   !>
   !> but_of  fingerprint of shards that are kept; '': none is kept
   subroutine remove_shards(folder, but_of)
      character(len=*), intent(in) :: folder, but_of
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
            ! The program that writes the file is on this machine and still runs.
            if (kind_there('/proc/'//trim(names(k)(at + len(mark):))) /= 0) cycle
         else if (but_of /= '' .and. index(names(k), prefix//but_of//'-') == 1) then
            cycle
         end if
         ignored = c_unlink(join_path(folder, trim(names(k)))//c_null_char)
      end do
      ignored = sync_folder(folder)
   end subroutine remove_shards

end module beamid_shards
