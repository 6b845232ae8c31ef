!> What the tests of the built program share: running it, and files in a scratch folder.
module shell
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   implicit none
   private

   public :: outcome_t, open_shell, close_shell, program_path, scratch, beamid, in_root, run
   public :: own_path, write_file, read_file, exists, remove_tree, in_scratch, line_count, replaced
   public :: has_all, python_with, unwrapped

   character(len=*), parameter :: line_feed = achar(10)

   !> What a command left behind.
   type :: outcome_t
      !> Its exit status; -1 when it could not be started.
      integer :: status = -1
      !> Standard output and standard error, byte for byte.
      character(len=:), allocatable :: out, err
   end type outcome_t

   !> The program under test and the scratch folder, absolute; '' before `open_shell`.
   character(len=:), allocatable, protected :: program_path, scratch

   interface
      integer(c_int) function c_getpid() bind(c, name='getpid')
         import :: c_int
      end function c_getpid
      integer(c_int) function c_access(path, mode) bind(c, name='access')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: mode
      end function c_access
   end interface

contains

   !> Finds the program and makes build/test-<process>; `reason` is '' when both are there.
   !>
   !> The program: $BEAMID_PROGRAM, or else the newest one that fpm has built below this folder.
   subroutine open_shell(reason)
      character(len=:), allocatable, intent(out) :: reason
      character(len=*), &
         parameter :: newest = 'ls -t build/gfortran_*/app/beamid 2>/dev/null | head -n 1'
      character(len=40) :: name
      integer :: status

      reason = ''
      program_path = ''
      write (name, '(a,i0)') 'build/test-', c_getpid()
      scratch = trim(name)
      call execute_command_line('mkdir -p '//scratch//' && cd '//scratch//' && pwd >.out', &
         exitstat=status)
      if (status /= 0) then
         reason = 'the folder '//scratch//' cannot be made'
         return
      end if
      scratch = first_line(read_file(scratch//'/.out'))
      call execute_command_line('p=${BEAMID_PROGRAM:-$('//newest//')}; [ -x "$p" ] && '// &
         'realpath "$p" >'//quoted(in_scratch('.out')), exitstat=status)
      if (status == 0) program_path = first_line(read_file(in_scratch('.out')))
      if (program_path /= '') return
      reason = 'no program: BEAMID_PROGRAM names none, and build/gfortran_*/app holds none'
      call close_shell()
   end subroutine open_shell

   !> A place in /tmp that no other test and no other run of this one uses.
   function own_path(name) result(path)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: path
      character(len=12) :: process

      write (process, '(i0)') c_getpid()
      path = '/tmp/beamid-test-'//name//'-'//trim(process)
   end function own_path

   !> Removes the scratch folder.
   subroutine close_shell()
      call execute_command_line('rm -rf '//quoted(scratch))
   end subroutine close_shell

   !> Runs the program in the scratch folder, or in a folder below it.
   function beamid(arguments, folder) result(outcome)
      !> The words behind the program's name, as a shell reads them.
      character(len=*), intent(in) :: arguments
      character(len=*), intent(in), optional :: folder
      type(outcome_t) :: outcome

      outcome = run(quoted(program_path)//' '//arguments, folder)
   end function beamid

   !> Runs the program where the project's data are; `@` stands for the scratch folder.
   function in_root(arguments) result(outcome)
      character(len=*), intent(in) :: arguments
      type(outcome_t) :: outcome

      outcome = run('cd ../.. && '//quoted(program_path)//' '//replaced(arguments, '@', scratch))
   end function in_root

   !> Runs a shell command in the scratch folder, or in a folder below it, without standard input.
   function run(command, folder) result(outcome)
      character(len=*), intent(in) :: command
      character(len=*), intent(in), optional :: folder
      type(outcome_t) :: outcome
      character(len=:), allocatable :: place
      integer :: failed

      place = scratch
      if (present(folder)) place = in_scratch(folder)
      call execute_command_line('cd '//quoted(place)//' && { '//command//'; } >'// &
         quoted(in_scratch('.out'))//' 2>'//quoted(in_scratch('.err'))//' </dev/null', &
         exitstat=outcome%status, cmdstat=failed)
      if (failed /= 0) outcome%status = -1
      outcome%out = read_file(in_scratch('.out'))
      outcome%err = read_file(in_scratch('.err'))
   end function run

   !> A Python that has these modules, 'numpy, scipy', the system's or the project's own, as a word
   !> for the shell that holds in every folder; '': none.
   function python_with(modules) result(python)
      character(len=*), intent(in) :: modules
      character(len=:), allocatable :: python
      type(outcome_t) :: outcome

      outcome = run('for p in python3 "$PWD/../../.venv/bin/python"; do "$p" -c "import '// &
         modules//'" 2>/dev/null && echo "$p" && exit; done; exit 1')
      python = ''
      if (outcome%status == 0) python = quoted(outcome%out(:len(outcome%out) - 1))
   end function python_with

   !> Writes a file, byte for byte; its folder is made when it is missing.
   subroutine write_file(name, text)
      !> The file's name, relative to the scratch folder, and its bytes.
      character(len=*), intent(in) :: name, text
      integer :: unit, slash

      slash = index(name, '/', back=.true.)
      if (slash > 1) then
         if (.not. exists(name(:slash - 1))) call execute_command_line('mkdir -p '// &
            quoted(in_scratch(name(:slash - 1))))
      end if
      open (newunit=unit, file=in_scratch(name), access='stream', form='unformatted', &
         status='replace', action='write')
      write (unit) text
      close (unit)
   end subroutine write_file

   !> The bytes of a file; '' when it is not there.
   function read_file(name) result(text)
      !> The file's name, relative to the scratch folder.
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      integer :: unit, bytes, status

      text = ''
      open (newunit=unit, file=in_scratch(name), access='stream', form='unformatted', &
         status='old', &
         action='read', iostat=status)
      if (status /= 0) return
      inquire (unit, size=bytes)
      deallocate (text)
      allocate (character(len=max(bytes, 0)) :: text)
      if (bytes > 0) read (unit, iostat=status) text
      close (unit)
   end function read_file

   !> Whether a file or a folder is there.
   logical function exists(name)
      !> Its name, relative to the scratch folder.
      character(len=*), intent(in) :: name

      exists = c_access(in_scratch(name)//c_null_char, 0_c_int) == 0
   end function exists

   !> Removes a file or a folder with all that is in it.
   subroutine remove_tree(name)
      !> Its name, relative to the scratch folder.
      character(len=*), intent(in) :: name

      if (exists(name)) call execute_command_line('rm -rf '//quoted(in_scratch(name)))
   end subroutine remove_tree

   !> A name inside the scratch folder; an absolute one stays as it is.
   function in_scratch(name) result(path)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: path

      path = name
      if (index(name, '/') /= 1 .and. index(scratch, '/') == 1) path = scratch//'/'//name
   end function in_scratch

   !> How many lines a text has; a last one without a line feed counts.
   pure integer function line_count(text) result(n)
      character(len=*), intent(in) :: text
      integer :: k

      n = count([(text(k:k) == line_feed, k=1, len(text))])
      if (len(text) == 0) return
      if (text(len(text):) /= line_feed) n = n + 1
   end function line_count

   !> A text in which every `old` has become `new`; it stops when there is none, as tests err too.
   function replaced(text, old, new) result(changed)
      character(len=*), intent(in) :: text, old, new
      character(len=:), allocatable :: changed
      integer :: next, length

      if (index(text, old) == 0) error stop 'shell: nothing to replace'
      changed = ''
      next = 1
      do
         length = index(text(next:), old) - 1
         if (length < 0) exit
         changed = changed//text(next:next + length - 1)//new
         next = next + length + len(old)
      end do
      changed = changed//text(next:)
   end function replaced

   !> A text of the program without the breaks of its long lines.
   function unwrapped(text)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: unwrapped
      character(len=*), parameter :: break = line_feed//'    '

      unwrapped = text
      if (index(text, break) > 0) unwrapped = replaced(text, break, ' ')
   end function unwrapped

   !> Whether a text contains each of the words, which are separated by '|'.
   pure logical function has_all(text, words)
      character(len=*), intent(in) :: text, words
      integer :: next, length

      has_all = .true.
      next = 1
      do while (next <= len(words) .and. has_all)
         length = index(words(next:), '|') - 1
         if (length < 0) length = len(words) - next + 1
         has_all = index(text, words(next:next + length - 1)) > 0
         next = next + length + 1
      end do
   end function has_all

   pure function first_line(text) result(line)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: line

      line = text(:index(text//line_feed, line_feed) - 1)
   end function first_line

   !> A word that a shell takes as it is.
   pure function quoted(text) result(word)
      character(len=*), intent(in) :: text
      character(len=:), allocatable :: word
      integer :: k

      word = ''''
      do k = 1, len(text)
         if (text(k:k) == '''') then
            word = word//'''\'''''
         else
            word = word//text(k:k)
         end if
      end do
      word = word//''''
   end function quoted

end module shell
