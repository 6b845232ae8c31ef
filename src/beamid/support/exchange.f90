!> Replaces the files of an earlier run by those of a new run, all of them or none. `beamid_outputs`
!> calls it.
!>
!> The new files are written to a temporary folder inside the output folder, as `new-<name>`; the
!> new manifest is the last of them. Then the old manifest is moved there, as `old-<name>`, and each
!> old file when the new file takes its name; so are old files that only an earlier run of the same
!> command has written. The new manifest takes its name last, so a folder without a manifest does
!> not hold a complete run. While the new manifest is in the temporary folder, an exchange has begun
!> and not ended: `take_back` undoes it, at once if a step fails, or else at the beginning of the
!> next run that writes to the folder.
!>
!> Runs on one machine wait for one another (`lock_folder`). A temporary folder of this machine is
!> therefore left from a program that has died. Temporary folders of other machines, which may share
!> the folder, are not touched; nor are any if the file system has no locks.
module beamid_exchange
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char, c_ptr
   use, intrinsic :: iso_fortran_env, only: int32
   use beamid_errors, only: error_t
   use beamid_files, only: read_text, write_new
   use beamid_folders, only: list_folder, lock_folder, make_folder, open_folder, remove_folder, &
      sync_folder
   use beamid_interrupts, only: hold_signals, release_signals
   use beamid_kinds, only: ip
   use beamid_manifests, only: command_in, compare, entries_in, entry_length, &
      entry_of, entry_of_file, manifest_header, manifest_name, name_in, new_entry
   use beamid_paths, only: join_path
   use beamid_posix, only: c_closedir, c_getpid, c_link, c_rename, eio, eisdir, &
      errno_of, host_name, kind_directory, kind_there, max_name
   use beamid_row_tables, only: row_table_t, write_table
   use beamid_strings, only: to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: named_text_t, exchange

   !> A new file: its name, and its text or a path to it.
   type :: named_text_t
      character(len=:), allocatable :: name, text
      !> Table whose rows follow the text. Not allocated: none.
      class(row_table_t), allocatable :: table
      !> Path of a file with the text, in the same file system; it is moved. Not allocated: `text`
      !> holds the text.
      character(len=:), allocatable :: path
      !> whether the text is that of a user, who may write what is no number
      logical :: is_quoted = .false.
   end type named_text_t

   !> Prefixes of names in the temporary folder.
   character(len=*), parameter :: new = '/new-', old = '/old-'

contains

   !> Puts the files of one run into an existing folder.
   subroutine exchange(directory, files, command, code, left)
      character(len=*), intent(in) :: directory
      type(named_text_t), intent(in) :: files(:)
      !> Command that is run, one word.
      character(len=*), intent(in) :: command
      !> 0, or the errno of a failure.
      integer(c_int), intent(out) :: code
      !> Temporary folder with old files that could not be put back; '': none.
      character(len=:), allocatable, intent(out) :: left
      character(len=entry_length), allocatable :: kept(:), outdated(:)
      character(len=:), allocatable :: temporary
      type(c_ptr) :: folder
      integer(c_int) :: ignored
      logical :: locked

      left = ''
      code = open_folder(directory, folder)
      if (code /= 0) return
      locked = lock_folder(folder)
      call hold_signals()
      if (locked) call take_back_all(directory, code, left)
      if (code == 0) then
         temporary = join_path(directory, prefix()//to_text(int(c_getpid())))
         code = make_folder(temporary)
         if (code == 0) then
            call sort_older(directory, files, command, kept, outdated)
            code = prepare(temporary, files, command, kept)
            if (code == 0) code = give_names(directory, temporary, files, outdated)
            if (take_back(directory, temporary) /= 0 .and. code /= 0) left = temporary
         end if
      end if
      ignored = c_closedir(folder)
      call release_signals()
   end subroutine exchange

   !> Returns the beginning of the names of temporary folders; the number of the process follows.
   function prefix()
      character(len=:), allocatable :: prefix
      integer :: i

      prefix = '.beamid-'//host_name()//'-'
      do i = 1, len(prefix)
         if (prefix(i:i) == '/') prefix(i:i) = '_'
      end do
   end function prefix

   !> Undoes the exchanges of runs that have died, and removes their temporary folders.
   subroutine take_back_all(directory, code, left)
      character(len=*), intent(in) :: directory
      integer(c_int), intent(out) :: code
      character(len=:), allocatable, intent(inout) :: left
      character(len=max_name), allocatable :: names(:)
      integer :: i, first

      code = list_folder(directory, prefix(), names)
      first = len(prefix()) + 1
      do i = 1, size(names)
         if (verify(trim(names(i)(first:)), '0123456789') > 0 .or. names(i)(first:) == '') cycle
         if (kind_there(join_path(directory, trim(names(i)))) /= kind_directory) cycle
         left = join_path(directory, trim(names(i)))
         code = take_back(directory, left)
         if (code /= 0) return
      end do
      left = ''
   end subroutine take_back_all

   !> Sorts the files that earlier runs have written and this run will not write. Files that have
   !> been changed since, or that cannot be read, belong to neither list.
   subroutine sort_older(directory, files, command, kept, outdated)
      character(len=*), intent(in) :: directory, command
      type(named_text_t), intent(in) :: files(:)
      !> Lines of the old manifest: files of other commands; files of an earlier run of this
      !> command.
      character(len=entry_length), allocatable, intent(out) :: kept(:), outdated(:)
      character(len=entry_length), allocatable :: entries(:)
      character(len=:), allocatable :: manifest
      type(error_t), allocatable :: error
      logical, allocatable :: same(:), ours(:)
      integer(c_int) :: code
      integer :: i, j

      call read_text(join_path(directory, manifest_name), manifest, error)
      entries = entries_in(manifest)
      allocate (same(size(entries)), ours(size(entries)))
      do i = 1, size(entries)
         call compare(directory, entries(i), same(i), code)
         if (any([(files(j)%name == name_in(entries(i)), j=1, size(files))])) same(i) = .false.
         ours(i) = command_in(entries(i)) == command
      end do
      kept = pack(entries, same .and. .not. ours)
      outdated = pack(entries, same .and. ours)
   end subroutine sort_older

   !> Writes the new files, and then the new manifest, to a temporary folder.
   integer(c_int) function prepare(temporary, files, command, kept) result(code)
      character(len=*), intent(in) :: temporary, command, kept(:)
      type(named_text_t), intent(in) :: files(:)
      type(text_t) :: manifest
      character(len=:), allocatable :: entry
      integer(ip) :: bytes
      integer(int32) :: checksum
      integer :: i

      call manifest%line(manifest_header)
      do i = 1, size(files)
         if (allocated(files(i)%path)) then
            code = renamed(files(i)%path, temporary//new//files(i)%name)
            if (code == 0) call entry_of_file(temporary//new//files(i)%name, files(i)%name, &
               command, entry, code)
         else if (allocated(files(i)%table)) then
            call write_table(temporary//new//files(i)%name, files(i)%text, files(i)%table, bytes, &
               checksum, code)
            entry = new_entry(files(i)%name, bytes, checksum, command)
         else
            code = write_new(temporary//new//files(i)%name, files(i)%text)
            entry = entry_of(files(i)%name, files(i)%text, command)
         end if
         if (code /= 0) return
         call manifest%line(entry)
      end do
      do i = 1, size(kept)
         call manifest%line(kept(i))
      end do
      code = write_new(temporary//new//manifest_name, manifest%content())
      if (code == 0) code = sync_folder(temporary)
   end function prepare

   !> Moves the old files to the temporary folder and gives the new files their names.
   integer(c_int) function give_names(directory, temporary, files, outdated) result(code)
      character(len=*), intent(in) :: directory, temporary, outdated(:)
      type(named_text_t), intent(in) :: files(:)
      integer(c_int) :: ignored
      integer :: i

      code = set_aside(directory, temporary, manifest_name, links=.false.)
      do i = 1, size(files)
         if (code == 0) code = set_aside(directory, temporary, files(i)%name, links=.true.)
         if (code == 0) code = renamed(temporary//new//files(i)%name, &
            join_path(directory, files(i)%name))
      end do
      do i = 1, size(outdated)
         if (code == 0) code = set_aside(directory, temporary, name_in(outdated(i)), links=.false.)
      end do
      if (code == 0) code = sync_folder(directory)
      if (code == 0) code = renamed(temporary//new//manifest_name, &
         join_path(directory, manifest_name))
      if (code /= 0) return
      code = sync_folder(directory)
      if (code /= 0) ignored = renamed(join_path(directory, manifest_name), &
         temporary//new//manifest_name)
   end function give_names

   !> Moves an old file, if there is one, to the temporary folder.
   integer(c_int) function set_aside(directory, temporary, name, links) result(code)
      character(len=*), intent(in) :: directory, temporary, name
      !> .true.: try a second link to the file first, so that its name exists at all times.
      logical, intent(in) :: links
      character(len=:), allocatable :: path

      code = 0
      path = join_path(directory, name)
      select case (kind_there(path))
      case (0)
         return
      case (kind_directory)
         code = eisdir
         return
      end select
      if (links) then
         if (c_link(path//c_null_char, temporary//old//name//c_null_char) == 0) return
      end if
      code = renamed(path, temporary//old//name)
   end function set_aside

   !> Removes a temporary folder. If an exchange has begun and not ended, puts back the old files
   !> first. The procedure may be interrupted and called again.
   integer(c_int) function take_back(directory, temporary) result(code)
      character(len=*), intent(in) :: directory, temporary
      character(len=max_name), allocatable :: names(:)
      integer :: i

      code = 0
      if (kind_there(temporary//new//manifest_name) /= 0) then
         code = take_names(directory, temporary)
         if (code == 0) code = list_folder(temporary, old(2:), names)
         if (code /= 0) return
         do i = 1, size(names)
            if (names(i) /= old(2:)//manifest_name) &
               code = put_back(directory, temporary, trim(names(i)(len(old):)))
            if (code /= 0) return
         end do
         code = sync_folder(directory)
         if (code == 0) code = put_back(directory, temporary, manifest_name)
      end if
      if (code == 0) code = remove_folder(temporary)
   end function take_back

   !> Moves new files that have their names already back to the temporary folder.
   integer(c_int) function take_names(directory, temporary) result(code)
      character(len=*), intent(in) :: directory, temporary
      character(len=entry_length), allocatable :: entries(:)
      character(len=:), allocatable :: manifest, name
      type(error_t), allocatable :: error
      logical :: same
      integer :: i

      code = eio
      call read_text(temporary//new//manifest_name, manifest, error)
      if (allocated(error)) return
      code = 0
      entries = entries_in(manifest)
      do i = 1, size(entries)
         name = name_in(entries(i))
         ! The entries of other commands follow those of the new files.
         if (command_in(entries(i)) /= command_in(entries(1))) exit
         if (kind_there(temporary//new//name) /= 0) cycle
         call compare(directory, entries(i), same, code)
         if (code == 0 .and. same) code = renamed(join_path(directory, name), temporary//new//name)
         if (code /= 0) return
      end do
   end function take_names

   !> Gives an old file its name back, unless a file of this name exists.
   integer(c_int) function put_back(directory, temporary, name) result(code)
      character(len=*), intent(in) :: directory, temporary, name

      code = 0
      if (kind_there(temporary//old//name) == 0) return
      if (kind_there(join_path(directory, name)) /= 0) return
      code = renamed(temporary//old//name, join_path(directory, name))
   end function put_back

   !> Renames a file; returns 0 or an errno.
   integer(c_int) function renamed(from, to)
      character(len=*), intent(in) :: from, to

      renamed = errno_of(c_rename(from//c_null_char, to//c_null_char))
   end function renamed

end module beamid_exchange
