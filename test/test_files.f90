!> A table that notes how many of its rows are wanted at once.
module long_tables
   use beamid_row_tables, only: row_table_t
   use beamid_strings, only: to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: squares_t

   !> Numbers and their squares.
   type, extends(row_table_t) :: squares_t
      logical :: is_sound = .true.   !< what `is_finite` returns
   contains
      procedure :: add_rows
      procedure :: is_finite
   end type squares_t

   !> Largest number of rows that were added at once.
   integer, public :: most_rows = 0

contains

   !> Adds rows. Arguments as of `row_table_t`.
   subroutine add_rows(self, first, last, text)
      class(squares_t), intent(in) :: self
      integer, intent(in) :: first, last
      type(text_t), intent(inout) :: text
      integer :: k

      most_rows = max(most_rows, last - first + 1)
      do k = first, min(last, self%rows)
         call text%line(to_text(k)//','//to_text(k*k))
      end do
   end subroutine add_rows

   !> Returns what the test wants.
   pure logical function is_finite(self)
      class(squares_t), intent(in) :: self

      is_finite = self%is_sound
   end function is_finite

end module long_tables

!> Reading whole files, and writing all outputs or none.
program test_files
   use, intrinsic :: iso_fortran_env, only: int32, int64
   use beamid_errors, only: error_t
   use beamid_files, only: read_text
   use beamid_fingerprints, only: crc32, crc64
   use beamid_outputs, only: output_t
   use beamid_paths, only: directory_of, join_path
   use beamid_row_tables, only: row_table_t
   use checks, only: check, finish
   use long_tables, only: most_rows, squares_t
   use shell, only: own_path
   implicit none

   character(len=*), parameter :: line_feed = achar(10)
   !> Every byte from 0 to 255, so that nothing is translated unseen.
   character(len=256) :: all_bytes
   character(len=:), allocatable :: scratch
   character(len=200) :: argument
   integer :: i

   do i = 0, 255
      all_bytes(i + 1:i + 1) = char(i)
   end do
   call get_command_argument(1, argument)
   if (argument /= '') call commit_under_limit(trim(argument))

   scratch = own_path('files')
   call command('mkdir '//scratch)
   call test_paths()
   call test_reading()
   call test_refusals()
   call test_writing()
   call test_manifest()
   call test_long_checksums()
   call test_long_table()
   call test_outdated()
   call test_harmless_failure()
   call test_rollback()
   call test_full_disk()
   call command('rm -r '//scratch)
   call finish('files')

contains

   !> Paths are joined and split as `dirname` does.
   subroutine test_paths()
      call check('directory of a/b.csv', directory_of('a/b.csv') == 'a')
      call check('directory of b.csv', directory_of('b.csv') == '.')
      call check('directory of /b.csv', directory_of('/b.csv') == '/')
      call check('join a, b', join_path('a', 'b') == 'a/b')
      call check('join a/, b', join_path('a/', 'b') == 'a/b')
      call check('join a, /b', join_path('a', '/b') == '/b')
      call check('join nothing, b', join_path('', 'b') == 'b')
   end subroutine test_paths

   !> What was written is read back byte for byte, at any size.
   subroutine test_reading()
      call check_round_trip('empty', '')
      call check_round_trip('one byte, no line end', 'x')
      call check_round_trip('all bytes', all_bytes//all_bytes)
      ! The first buffer holds 4096 bytes or the size that the system gives plus one.
      call check_round_trip('4095 bytes', repeat('x', 4095))
      call check_round_trip('4096 bytes', repeat('y', 4096))
      call check_round_trip('3 MB', repeat(all_bytes, 12000))
   end subroutine test_reading

   subroutine check_round_trip(name, text)
      character(len=*), intent(in) :: name, text
      type(output_t) :: output
      type(error_t), allocatable :: error
      character(len=:), allocatable :: got

      call output%add('bytes', text)
      call output%commit(scratch, error)
      if (.not. allocated(error)) call read_text(scratch//'/bytes', got, error)
      call check(name//': no error', .not. allocated(error))
      if (allocated(error)) return
      call check(name//': same bytes', len(got) == len(text) .and. got == text)
   end subroutine check_round_trip

   !> Whatever is not a readable regular file is refused in one line, and nothing waits for ever.
   subroutine test_refusals()
      type(error_t), allocatable :: error
      character(len=:), allocatable :: text

      call command('mkfifo '//scratch//'/pipe')
      call command('truncate -s 1100M '//scratch//'/huge')
      call command('ln -s '//scratch//'/loop '//scratch//'/loop')
      call refuse('missing', 'no such file')
      call refuse('.', 'is a directory, expected a file')
      call refuse('pipe', 'a pipe or a device')
      call refuse('huge', 'more than 1 GiB')
      call refuse('bytes/below', 'Not a directory')
      call refuse('loop', 'symbolic links')
      call refuse(repeat('n', 300), 'too long')
      call refuse('/dev/zero', 'a pipe or a device')
      call read_text('', text, error)
      call check('empty path', allocated(error))
      call command('rm '//scratch//'/huge')
      ! The system gives 0 bytes as the size of this file; it is read to its end all the same.
      call read_text('/proc/self/status', text, error)
      call check('size unknown before', .not. allocated(error) .and. len(text) > 0)
   end subroutine test_refusals

   subroutine refuse(name, words)
      character(len=*), intent(in) :: name, words
      type(error_t), allocatable :: error
      character(len=:), allocatable :: text

      call read_text(join_path(scratch, name), text, error)
      call check('refused: '//words, allocated(error))
      if (.not. allocated(error)) return
      call check('  says so, status 2, one line', error%status == 2 .and. &
         index(error%message, words) > 0 .and. index(error%message, line_feed) == 0, error%message)
   end subroutine refuse

   !> Folders are made, a name given twice keeps the last text, nothing else is left behind.
   subroutine test_writing()
      type(output_t) :: output
      type(error_t), allocatable :: error

      call output%add('one.csv', 'old')
      call output%add('two.csv', 'second')
      call output%add('one.csv', 'first')
      call output%commit(scratch//'/new//deep/folder/', error)
      call check('folders are made', .not. allocated(error))
      call check('first file', content('new/deep/folder/one.csv') == 'first')
      call check('second file', content('new/deep/folder/two.csv') == 'second')
      call check('no other file but the manifest', holds('new/deep/folder', 3))
      call output%add('one.csv', 'again')
      call output%commit(scratch//'/new/deep/folder', error)
      call check('written over', content('new/deep/folder/one.csv') == 'again')
      call check('no other file but the manifest', holds('new/deep/folder', 3))
   end subroutine test_writing

   !> Name, size and CRC-32 of each file. The value for '123456789' is the one that the definitions
   !> of CRC-32 give as a check; no byte has 0, and of all bytes zlib has 29058c73.
   subroutine test_manifest()
      type(output_t) :: output
      type(error_t), allocatable :: error

      call output%add('check.csv', '123456789')
      call output%add('empty.csv', '')
      call output%add('bytes', all_bytes)
      call output%commit(scratch//'/listed', error)
      call check('manifest', content('listed/manifest.txt') == 'name bytes crc32 command'// &
         line_feed//'check.csv 9 cbf43926 run'//line_feed//'empty.csv 0 00000000 run'// &
         line_feed//'bytes 256 29058c73 run'//line_feed, content('listed/manifest.txt'))
   end subroutine test_manifest

   !> Eight bytes at once give the checksums that single bytes give, as in texts that are too short
   !> for it, wherever the first eight begin.
   subroutine test_long_checksums()
      character(len=:), allocatable :: text
      integer(int32) :: sum_32
      integer(int64) :: sum_64
      integer :: begin, first

      text = repeat(all_bytes//'odd', 40)
      do begin = 1, 9
         sum_32 = 0
         sum_64 = 0
         do first = begin, len(text), 100
            associate (piece => text(first:min(first + 99, len(text))))
               sum_32 = crc32(piece, sum_32)
               sum_64 = crc64(piece, sum_64)
            end associate
         end do
         call check('CRC-32 of a long text', crc32(text(begin:), 0_int32) == sum_32)
         call check('CRC-64 of a long text', crc64(text(begin:), 0_int64) == sum_64)
      end do
   end subroutine test_long_checksums

   !> The rows of a table are written in pieces. The file and its line in the manifest are those of
   !> the whole text.
   subroutine test_long_table()
      integer, parameter :: rows = 10000
      character(len=*), parameter :: header = 'k,square'//line_feed
      type(output_t) :: output, whole, unsound
      class(row_table_t), allocatable :: table
      type(error_t), allocatable :: error

      allocate (table, source=squares_t(rows=rows))
      call output%add('before.csv', 'old')
      call output%add_table('table.csv', header, table)
      call check('a table is handed over', .not. allocated(table))
      call output%add('after.csv', 'new')
      most_rows = 0
      call output%commit(scratch//'/rows', error)
      call check('a table is written', .not. allocated(error))
      call check('some rows at a time', most_rows > 0 .and. 2*most_rows <= rows)
      call check('rows of a table', index(output%text_of('table.csv'), header//'1,1'//line_feed// &
         '2,4'//line_feed) == 1 .and. index(output%text_of('table.csv'), line_feed// &
         '10000,100000000'//line_feed) > 0)
      call check('the file is the whole text', content('rows/table.csv') == &
         output%text_of('table.csv'))
      call whole%add('before.csv', 'old')
      call whole%add('table.csv', output%text_of('table.csv'))
      call whole%add('after.csv', 'new')
      call whole%commit(scratch//'/text', error)
      call check('manifest of a table', content('rows/manifest.txt') == content( &
         'text/manifest.txt'))
      call output%check_finite(error)
      call check('finite numbers', .not. allocated(error))
      allocate (table, source=squares_t(rows=rows, is_sound=.false.))
      call unsound%add_table('table.csv', header, table)
      call unsound%check_finite(error)
      call check_failed('numbers that are not finite', error, 1, 'not finite')
      call output%add('table.csv', 'short')
      call check('a text replaces a table', output%text_of('table.csv') == 'short')
   end subroutine test_long_table

   !> What an earlier run of the same command has written and this one has not goes, unless
   !> somebody has changed it; the files of another command, and of others, stay. A line that leads
   !> to another folder leads nowhere.
   subroutine test_outdated()
      type(output_t) :: first, second, other
      type(error_t), allocatable :: error

      call other%add('zero.csv', 'zero')
      call other%add('one.csv', 'zero')
      call other%add('late.csv', 'zero')
      call other%commit(scratch//'/dated', error, 'other')
      call first%add('one.csv', 'one')
      call first%add('two.csv', 'two')
      call first%add('three.csv', 'three')
      call first%commit(scratch//'/dated', error)
      call command('cd '//scratch//' && echo mine >dated/notes.txt && echo more '// &
         '>>dated/three.csv && echo more >>dated/late.csv && printf two >two.csv && '// &
         'printf "../%s" '// &
         '"$(grep two dated/manifest.txt)" >line && cat line >>dated/manifest.txt && '// &
         'echo >>dated/manifest.txt && echo nonsense >>dated/manifest.txt')
      call second%add('one.csv', 'another')
      call second%commit(scratch//'/dated', error)
      call check('written over', .not. allocated(error) .and. content('dated/one.csv') == 'another')
      call check('outdated file is gone', .not. exists('dated/two.csv'))
      call check('changed file stays', exists('dated/three.csv'))
      call check('files of others stay', exists('dated/notes.txt') .and. exists('two.csv'))
      call check('file of another command stays', content('dated/zero.csv') == 'zero')
      call check('no other file', holds('dated', 6))
      call check('the manifest has what is as it was written', content('dated/manifest.txt') == &
         'name bytes crc32 command'//line_feed//'one.csv 7 9d293438 run'//line_feed// &
         'zero.csv 4 abdef192 other'//line_feed, content('dated/manifest.txt'))
   end subroutine test_outdated

   !> A folder that cannot be written is bad input; what was made on the way is removed.
   subroutine test_harmless_failure()
      type(output_t) :: output
      type(error_t), allocatable :: error

      call output%add('one.csv', 'text')
      call output%commit(scratch//'/bytes/out', error)
      call check_failed('below a file', error, 2, 'Not a directory')
      call output%commit(scratch//'/bytes', error)
      call check_failed('a file itself', error, 2, 'Not a directory')
      call output%commit('/proc/none', error)
      call check_failed('in /proc', error, 2, 'cannot be written')
      ! No file name may have 300 bytes: the second file fails after the first is written.
      call output%add(repeat('n', 300), 'text')
      call output%commit(scratch//'/made/for/nothing', error)
      call check_failed('name too long', error, 2, 'too long')
      call check('made folders are gone', .not. exists('made'))
      call output%commit(scratch//'/new/deep/folder', error)
      call check_failed('name too long, old folder', error, 2, 'too long')
      call check('older file is whole', content('new/deep/folder/one.csv') == 'again')
      call check('no temporary file', holds('new/deep/folder', 3))
   end subroutine test_harmless_failure

   !> When the last name cannot be given, the names given before are taken back.
   subroutine test_rollback()
      type(output_t) :: output
      type(error_t), allocatable :: error

      call command('mkdir -p '//scratch//'/back/taken')
      call output%add('old.csv', 'old')
      call output%commit(scratch//'/back', error)
      call output%add('old.csv', 'new')
      call output%add('fresh.csv', 'new')
      call output%add('taken', 'a folder has this name')
      call output%commit(scratch//'/back', error)
      call check_failed('a folder in the way', error, 2, 'directory')
      call check('older file is back', content('back/old.csv') == 'old')
      call check('fresh file is gone', .not. exists('back/fresh.csv'))
      call check('no temporary file', holds('back', 3))
   end subroutine test_rollback

   !> A full disk is a failure (status 1), shown by the limit on the size of a file: this program
   !> is started again under the limit and commits more than it allows.
   subroutine test_full_disk()
      type(output_t) :: output
      type(error_t), allocatable :: error
      character(len=200) :: program_name
      integer :: code

      call output%add('big.csv', 'older')
      call output%commit(scratch//'/full', error)
      call get_command_argument(0, program_name)
      call execute_command_line('ulimit -f 64; '//trim(program_name)//' '//scratch//'/full', &
         exitstat=code)
      call check('limit reached: failure, no signal', code == 11)
      call check('older file is whole', content('full/big.csv') == 'older')
      call check('no temporary file', holds('full', 2))
   end subroutine test_full_disk

   !> The part of the test above under the limit; the exit status is 10 + the error's status.
   subroutine commit_under_limit(directory)
      character(len=*), intent(in) :: directory
      type(output_t) :: output
      type(error_t), allocatable :: error

      call output%add('small.csv', 'x')
      call output%add('big.csv', repeat('x', 10**6))
      call output%commit(directory, error)
      if (.not. allocated(error)) stop 10, quiet=.true.
      if (index(error%message, 'File too large') == 0) stop 13, quiet=.true.
      if (error%status == 1) stop 11, quiet=.true.
      stop 12, quiet=.true.
   end subroutine commit_under_limit

   subroutine check_failed(name, error, status, words)
      character(len=*), intent(in) :: name, words
      type(error_t), allocatable, intent(in) :: error
      integer, intent(in) :: status

      call check(name//': refused', allocated(error))
      if (.not. allocated(error)) return
      call check('  status and words', error%status == status .and. &
         index(error%message, words) > 0 .and. index(error%message, line_feed) == 0, error%message)
   end subroutine check_failed

   function content(name) result(text)
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: text
      type(error_t), allocatable :: error

      call read_text(scratch//'/'//name, text, error)
      if (allocated(error)) text = '(unreadable)'
   end function content

   logical function exists(name)
      character(len=*), intent(in) :: name

      exists = succeeds('test -e '//scratch//'/'//name)
   end function exists

   !> Whether a folder has exactly n entries, hidden ones too.
   logical function holds(name, n)
      character(len=*), intent(in) :: name
      integer, intent(in) :: n
      character(len=8) :: digits

      write (digits, '(i0)') n
      holds = succeeds('test $(ls -A '//scratch//'/'//name//' | wc -l) -eq '//digits)
   end function holds

   logical function succeeds(command)
      character(len=*), intent(in) :: command
      integer :: code

      call execute_command_line(command, exitstat=code)
      succeeds = code == 0
   end function succeeds

   subroutine command(words)
      character(len=*), intent(in) :: words

      if (.not. succeeds(words)) call check('command: '//words, .false.)
   end subroutine command

end program test_files
