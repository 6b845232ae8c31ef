!> The outputs of one run: collected in memory, and written together, all of them or none.
module beamid_outputs
   use, intrinsic :: iso_c_binding, only: c_int, c_null_char
   use beamid_errors, only: error_t, bad_input, failure
   use beamid_exchange, only: exchange, named_text_t
   use beamid_files, only: read_text
   use beamid_folders, only: make_folders
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: ip
   use beamid_manifests, only: entries_in, entry_length, manifest_name, name_in
   use beamid_paths, only: join_path
   use beamid_posix, only: c_rmdir, edquot, efbig, eio, enospc, reason, same_file
   use beamid_row_tables, only: row_table_t, table_text
   use beamid_strings, only: append_string, string_t
   implicit none
   private

   public :: output_t

   !> The files that a run will write.
   type :: output_t
      !> Files, in the order in which they were added; not allocated: none.
      type(named_text_t), allocatable, private :: files(:)
      !> Paths of inputs, which must not be overwritten; not allocated: none.
      type(string_t), allocatable, private :: inputs(:)
   contains
      procedure :: add
      procedure :: add_file
      procedure :: add_table
      procedure :: names
      procedure :: text_of
      procedure :: spare
      procedure :: check_finite
      procedure :: commit
   end type output_t

contains

   !> Adds a file; if the name was added before, replaces its text.
   !>
   !> name, text  name of the file inside the output folder, and its whole text
   !> is_quoted   whether the text is that of a user, which `check_finite` does not read; default:
   !>             .false.
   subroutine add(self, name, text, is_quoted)
      class(output_t), intent(inout) :: self
      character(len=*), intent(in) :: name, text
      logical, intent(in), optional :: is_quoted
      type(named_text_t), allocatable :: more(:)
      integer :: i, k

      if (.not. allocated(self%files)) allocate (self%files(0))
      do i = 1, size(self%files)
         if (self%files(i)%name == name) exit
      end do
      if (i > size(self%files)) then
         allocate (more(i))
         do k = 1, i - 1
            ! The parts are moved, because copies of long texts take time and memory.
            call move_alloc(self%files(k)%name, more(k)%name)
            call move_alloc(self%files(k)%text, more(k)%text)
            call move_alloc(self%files(k)%table, more(k)%table)
            call move_alloc(self%files(k)%path, more(k)%path)
            more(k)%is_quoted = self%files(k)%is_quoted
         end do
         more(i)%name = name
         call move_alloc(more, self%files)
      end if
      self%files(i)%text = text
      if (allocated(self%files(i)%table)) deallocate (self%files(i)%table)
      if (present(is_quoted)) self%files(i)%is_quoted = is_quoted
   end subroutine add

   !> Adds a file whose rows are written as text only while the file is written.
   !>
   !> header  text before the first row
   !> table   the rows; not allocated on return
   subroutine add_table(self, name, header, table)
      class(output_t), intent(inout) :: self
      character(len=*), intent(in) :: name, header
      class(row_table_t), allocatable, intent(inout) :: table
      integer :: i

      call self%add(name, header)
      do i = 1, size(self%files)
         if (self%files(i)%name == name) call move_alloc(table, self%files(i)%table)
      end do
   end subroutine add_table

   !> Adds a file that may be too large to be held in memory.
   !>
   !> path  of the file, in the file system of the output folder; `commit` moves it
   subroutine add_file(self, name, path)
      class(output_t), intent(inout) :: self
      character(len=*), intent(in) :: name, path

      call self%add(name, '')
      self%files(size(self%files))%path = path
   end subroutine add_file

   !> Returns the names of the files, one in each line.
   function names(self)
      class(output_t), intent(in) :: self
      character(len=:), allocatable :: names
      integer :: i

      names = ''
      if (.not. allocated(self%files)) return
      do i = 1, size(self%files)
         names = names//self%files(i)%name//new_line('a')
      end do
   end function names

   !> Returns the text of a file; '' if there is no file of this name.
   function text_of(self, name) result(text)
      class(output_t), intent(in) :: self
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      integer :: i

      text = ''
      if (.not. allocated(self%files)) return
      do i = 1, size(self%files)
         if (self%files(i)%name /= name) cycle
         text = self%files(i)%text
         if (allocated(self%files(i)%table)) text = table_text(text, self%files(i)%table)
      end do
   end function text_of

   !> Protects an input, a file of the user: `commit` does not overwrite it, unless the manifest of
   !> the output folder says that an earlier run has written it.
   subroutine spare(self, path)
      class(output_t), intent(inout) :: self
      character(len=*), intent(in) :: path

      call append_string(self%inputs, path)
   end subroutine spare

   !> Refuses files that would overwrite an input.
   subroutine check_inputs(self, directory, error)
      class(output_t), intent(in) :: self
      character(len=*), intent(in) :: directory
      type(error_t), allocatable, intent(out) :: error
      character(len=entry_length), allocatable :: entries(:)
      character(len=:), allocatable :: manifest, path
      type(error_t), allocatable :: ignored
      integer :: i, j, k

      if (.not. (allocated(self%inputs) .and. allocated(self%files))) return
      call read_text(join_path(directory, manifest_name), manifest, ignored)
      entries = entries_in(manifest)
      do i = 1, size(self%files)
         path = join_path(directory, self%files(i)%name)
         do j = 1, size(self%inputs)
            if (.not. same_file(path, self%inputs(j)%text)) cycle
            if (any([(name_in(entries(k)) == self%files(i)%name, k=1, size(entries))])) cycle
            call bad_input(error, path//': found a record of the case, which the run would '// &
               'overwrite, expected another output folder')
            return
         end do
      end do
   end subroutine check_inputs

   !> Refuses tables with a number that is not finite, wherever it came from.
   subroutine check_finite(self, error)
      class(output_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: forms(4) = [character(len=9) :: 'Infinity', '+Infinity', &
                                                 '-Infinity', 'NaN']
      integer :: i, k
      logical :: is_finite

      if (.not. allocated(self%files)) return
      do i = 1, size(self%files)
         if (self%files(i)%is_quoted) cycle
         is_finite = .not. any([(has_field(self%files(i)%text, trim(forms(k))), k=1, size(forms))])
         if (is_finite .and. allocated(self%files(i)%table)) &
            is_finite = self%files(i)%table%is_finite()
         if (is_finite) cycle
         call failure(error, self%files(i)%name//' would hold a number that is not finite: '// &
            'the values of the case are out of proportion to each other, or to the record')
         return
      end do
   end subroutine check_finite

   !> Returns whether a word is a complete field of a table.
   pure logical function has_field(text, word)
      character(len=*), intent(in) :: text, word
      integer(ip) :: at, next

      at = 0
      do
         next = index(text(at + 1:), word, kind=ip)
         has_field = next > 0
         if (.not. has_field) return
         at = at + next
         if (ends_field(text, at - 1) .and. ends_field(text, at + len(word))) return
      end do
   end function has_field

   !> Returns whether the character at a position does not belong to a field of a table.
   pure logical function ends_field(text, at)
      character(len=*), intent(in) :: text
      integer(ip), intent(in) :: at

      ends_field = at < 1 .or. at > len(text, ip)
      if (.not. ends_field) ends_field = index(', '//new_line('a'), text(at:at)) > 0
   end function ends_field

   !> Writes all files and their manifest, or changes nothing (`beamid_exchange`).
   subroutine commit(self, directory, error, command)
      class(output_t), intent(in) :: self
      !> Output folder; it and its parents are created if they are missing.
      character(len=*), intent(in) :: directory
      !> Status 1: the disk is full or broken; status 2: the folder cannot be written or holds an
      !> input.
      type(error_t), allocatable, intent(out) :: error
      !> Word for the kind of run, default `run`. Files that the last run of this kind has written
      !> and this run has not are removed, unless they have been changed since.
      character(len=*), intent(in), optional :: command
      character(len=:), allocatable :: left, message, kind
      integer(c_int) :: code, ignored
      integer, allocatable :: created(:)
      integer :: i

      call check_inputs(self, directory, error)
      if (.not. allocated(error)) call check_interrupt(error)
      if (allocated(error)) return
      left = ''
      kind = 'run'
      if (present(command)) kind = command
      call make_folders(directory, created, code)
      if (code == 0 .and. allocated(self%files)) &
         call exchange(directory, self%files, kind, code, left)
      if (code == 0) return
      do i = size(created), 1, -1
         ignored = c_rmdir(directory(:created(i))//c_null_char)
      end do
      message = directory//': the output folder cannot be written: '//reason(code)
      if (left /= '') message = message//'; older files are in '//left
      if (any(code == [enospc, edquot, eio, efbig])) then
         call failure(error, message)
      else
         call bad_input(error, message)
      end if
   end subroutine commit

end module beamid_outputs
