!> Strict numbers and columns of numbers.
program test_csv
   use beamid_csv, only: column_length, read_columns
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp, ip
   use beamid_numbers, only: parse_number
   use beamid_outputs, only: output_t
   use checks, only: check, finish
   use damaged_texts, only: any_byte, damage, doubled, dropped, exchanged, likely_byte, other
   use random_numbers, only: pick, start_random
   use shell, only: own_path
   implicit none

   character(len=*), parameter :: lf = achar(10), cr = achar(13), tab = achar(9), &
      bom = char(239)//char(187)//char(191)
   character(len=:), allocatable :: scratch

   scratch = own_path('csv')
   call start_random(20240607, 16807)
   call test_numbers()
   call test_not_numbers()
   call test_tables()
   call test_bad_tables()
   call test_mutations('a table', '# record'//lf//'t,a'//lf//'0.0,1.5e-3'//lf//'0.1,-2.25'//lf// &
      '0.2,3.125'//lf//'0.3,4d0'//lf)
   call test_mutations('a header', 'Recorder'//tab//'5'//lf//'Rate'//tab//'10'//tab//lf// &
      't'//tab//'a'//tab//'Comment'//lf//'0,0'//tab//'1,5e-3'//tab//lf//'0,1'//tab//'-2,25'//lf// &
      '0,2'//tab//'3,125'//tab//'end'//lf)
   call test_mutations('quotes', '"t, s","a"'//lf//'"0,0","1,5e-3"'//lf//'"0,1",'//'"-2,25"'//lf// &
      '"0,2" ,"3,125"'//lf//'"0,3","4"'//lf)
   call test_size()
   call execute_command_line('rm -r '//scratch)
   call finish('csv')

contains

   !> Equality is exact: the compiler and the C library both round to the nearest double.
   subroutine test_numbers()
      call number('1', 1.0_wp)
      call number(' +1.5 ', 1.5_wp)
      call number('-.5', -0.5_wp)
      call number('5.', 5.0_wp)
      call number('1e3', 1000.0_wp)
      call number('1D-3', 1.0e-3_wp)
      call number(tab//'2.5d+1', 25.0_wp)
      call number('0.1', 0.1_wp)
      call number('3.14159265358979323846264338327950288419716939937510582097494459230781640628', &
         acos(-1.0_wp))
      call number('1.7976931348623157e308', huge(1.0_wp))
      call number('2.2250738585072014E-308', tiny(1.0_wp))
      ! Too small for a double is zero, not an error.
      call number('1e-999', 0.0_wp)
      call number('0e999', 0.0_wp)
      call number('1'//repeat('0', 300)//'d-300', 1.0_wp)
      call number(repeat('0', 5000)//'7', 7.0_wp)
   end subroutine test_numbers

   subroutine number(token, expected)
      character(len=*), intent(in) :: token
      real(wp), intent(in) :: expected
      real(wp) :: value
      logical :: ok

      call parse_number(token, value, ok)
      call check('number '//token(:min(30, len(token))), ok .and. value >= expected &
         .and. value <= expected)
   end subroutine number

   !> What list-directed input would take, and what it would not.
   subroutine test_not_numbers()
      character(len=8), parameter :: tokens(*) = [character(len=8) :: '', ' ', '+', '.', 'e5', &
         '1e', '1e+', '1 5', '1/2', '2*3', '0x10', 'nan', 'NaN', 'inf', '-Inf', 'infinity', '1,5', &
         '1;5', '--1', '+-1', '1.2.3', '1e5.0', '1e5e5', '1+5', '1_8', '1f3', '.e1', '(1)', &
         '1e999', '-1e999', '9e308', '1'//tab//'5', '1'//achar(0), '''1''', '1.0ft', '1e 5']
      real(wp) :: value
      logical :: ok
      integer :: i

      do i = 1, size(tokens)
         call parse_number(trim(tokens(i)), value, ok)
         call check('not a number: '//trim(tokens(i)), .not. ok .and. abs(value) <= 0)
      end do
      call parse_number('1'//repeat('0', 400), value, ok)
      call check('not a number: 10**400', .not. ok)
   end subroutine test_not_numbers

   !> Each of these texts holds the rows (0, 1) and (0.5, -2); both are exact in binary.
   subroutine test_tables()
      call table('plain', '0,1'//lf//'0.5,-2'//lf, 0)
      call table('no line end at the end', '0,1'//lf//'0.5,-2', 0)
      call table('names', 't,a'//lf//'0,1'//lf//'0.5,-2'//lf, 2)
      call table('names in quotes', '"t", "a"'//lf//'0,1'//lf//'0.5,-2'//lf, 2)
      call table('CRLF', 't,a'//cr//lf//'0,1'//cr//lf//'0.5,-2'//cr//lf, 2)
      call table('BOM', bom//'0,1'//lf//'0.5,-2'//lf, 0)
      call table('BOM and names', bom//'t,a'//lf//'0,1'//lf//'0.5,-2'//lf, 2)
      call table('comments, blank lines', '# x'//lf//lf//'t,a'//lf//' '//lf//'0,1'//lf//'  # 1,2' &
         //lf//'0.5,-2'//lf//lf, 2)
      call table('more columns', 't,a,b'//lf//'0,1,x'//lf//'0.5,-2,'//lf, 3)
      call table('tabs', 't'//tab//'a'//lf//'0'//tab//'1'//lf//'0.5'//tab//'-2'//lf, 2)
      call table('semicolons', 't;a'//lf//'0;1'//lf//'0.5;-2'//lf, 2)
      call table('semicolons, no names', '0;1'//lf//'0.5;-2'//lf, 0)
      call table('semicolons, more columns', 't;a;b'//lf//'0;1;x,y'//lf//'0.5;-2;'//lf, 3)
      call table('semicolons, decimal commas', 't;a'//lf//'0;1'//lf//'0,5;-2'//lf, 2)
      call table('tabs, decimal commas', '0,0'//tab//'1,0'//lf//'0,5'//tab//'-2,0'//lf, 0)
      call table('tabs, names with commas', 't, s'//tab//'a, g'//lf//'0'//tab//'1'//lf//'0.5'// &
         tab//'-2'//lf, 2, named=.false.)
      call table('blanks around', ' 0 , 1 '//lf//tab//'0.5 ,'//tab//'-2'//lf, 0)
      call table('a long line', '0,1,'//repeat('x', 100000)//lf//'0.5,-2'//lf, 0)
   end subroutine test_tables

   subroutine table(name, text, n_names, named)
      character(len=*), intent(in) :: name, text
      integer, intent(in) :: n_names
      !> Whether the first two are t and a; default .true.
      logical, intent(in), optional :: named
      real(wp), allocatable :: values(:, :)
      character(len=column_length), allocatable :: header(:)
      type(error_t), allocatable :: error
      logical :: ok

      call read_written(text, values, header, error)
      ok = .not. allocated(error)
      if (ok) ok = all(shape(values) == [2, 2])
      if (ok) ok = maxval(abs(values - reshape([0.0_wp, 1.0_wp, 0.5_wp, -2.0_wp], [2, 2]))) <= 0
      call check('table: '//name, ok)
      call check('  names', size(header) == n_names)
      if (present(named)) return
      if (n_names > 1 .and. size(header) > 1) &
         call check('  named t and a', header(1) == 't' .and. header(2) == 'a')
   end subroutine table

   !> One line says file, line, what was found and what was expected.
   subroutine test_bad_tables()
      call bad('', ': ', 'no line of data')
      call bad(lf//lf//'# only'//lf, ': ', 'no line of data')
      call bad('t,a'//lf, ': ', 'names of columns only')
      call bad('t,a'//lf//'0,1'//lf//'1'//lf, ':3: column 2 (''a'')', 'end of the line')
      call bad('0,1'//lf//lf//'# x'//lf//'1,abc'//lf, ':4: column 2', 'found ''abc'', expected a')
      call bad('t,a'//lf//'0,'//lf, ':2: column 2', 'empty field')
      call bad('t,a'//lf//'0;1'//lf, ':2: ', 'separated by '';''')
      call bad('0,1'//lf//'1;1'//lf, ':2: ', 'separated by '';'', expected '',''')
      call bad('0;1'//lf//'1,1'//lf, ':2: column 2', 'end of the line')
      call bad('0.5;1'//lf//'1,5;1'//lf, ':2: column 1', 'a decimal point is ''.''')
      call bad('0,5;1'//lf//'1.5;1'//lf, ':2: column 1', 'a decimal sign is '','' as in the lines')
      call bad('0,5;1'//lf//'1.000,5;1'//lf, ':2: column 1', 'found ''1.000,5''')
      call bad('0;1'//lf//'1,000,5;1'//lf, ':2: column 1', 'found ''1,000,5''')
      call bad('0,1'//lf//'1,5;1'//lf, ':2: ', 'found both '';'' and '',''')
      call bad('t,a'//lf//'0,5,1,5'//lf, ':2: ', 'with a decimal point, not a decimal comma')
      call bad('0 1'//lf//'1 2'//lf, ':1: column 1', 'found ''0 1''')
      call bad('time accel'//lf//'1 2'//lf, ':1: ', 'expected 2 columns')
      call bad('0,1'//lf//'1/2,1'//lf, ':2: column 1', 'found ''1/2''')
      call bad('0,1'//lf//'1,nan'//lf, ':2: column 2', 'found ''nan''')
      call bad('0,1'//lf//'1,1e999'//lf, ':2: column 2', 'at most 1.79e308')
      call bad('0,1'//lf//'1,2'//achar(0)//lf, ':2: ', 'control character')
      call bad('P'//char(200)//achar(1)//achar(0), ':1: ', 'control character')
      call bad('t,a'//lf//'0,1'//lf//'0.2,1'//lf//'0.2,1'//lf, ':4: column 1 (''t'')', &
         'found ''0.2'' after ''0.2''')
      call bad('3,1'//lf//'-3,1'//lf, ':2: column 1', 'found ''-3'' after ''3''')
      call bad('0,'//repeat('x', 1000)//lf, ':1: column 2', 'xxx...''')
   end subroutine test_bad_tables

   subroutine bad(text, place, words)
      character(len=*), intent(in) :: text, place, words
      real(wp), allocatable :: values(:, :)
      character(len=column_length), allocatable :: header(:)
      type(error_t), allocatable :: error

      call read_written(text, values, header, error)
      call check('refused: '//words, allocated(error))
      if (.not. allocated(error)) return
      call check('  one line, place and words', error%status == 2 .and. &
         index(error%message, 'table.csv'//place) > 0 .and. index(error%message, words) > 0 .and. &
         scan(error%message, lf//cr//achar(0)) == 0 .and. len(error%message) < 250, error%message)
   end subroutine bad

   !> Damaged tables end in one line or in finite, increasing numbers; 3000 of each, the same ones
   !> in every run.
   subroutine test_mutations(what, valid)
      character(len=*), intent(in) :: what, valid
      character(len=:), allocatable :: text
      character(len=column_length), allocatable :: header(:)
      real(wp), allocatable :: values(:, :)
      type(error_t), allocatable :: error
      integer :: trial, n_read
      logical :: ok

      ok = .true.
      n_read = 0
      do trial = 1, 3000
         text = valid
         call mutate(text)
         if (pick(2) == 1) call mutate(text)
         call read_written(text, values, header, error)
         if (allocated(error)) then
            ok = ok .and. index(error%message, lf) == 0 .and. size(values, 2) == 0
         else
            n_read = n_read + 1
            ok = ok .and. all(abs(values) <= huge(1.0_wp))
            ok = ok .and. all(values(1, 2:) > values(1, :size(values, 2) - 1))
         end if
         if (.not. ok) exit
      end do
      call check('mutations of '//what//': an error or sound numbers', ok)
      if (.not. ok) call check('  the text', .false., text)
      ! Neither everything nor nothing passes, or the test would show little.
      call check('mutations of '//what//': some pass, some do not', n_read > 100 .and. &
         n_read < 2900)
   end subroutine test_mutations

   !> A byte dropped, doubled, replaced, exchanged with its neighbour, or all behind it cut off.
   subroutine mutate(text)
      character(len=:), allocatable, intent(inout) :: text
      integer :: at, way

      if (len(text) < 2) return
      call damage(text, [dropped, doubled, any_byte, likely_byte, exchanged, other], &
         ',;.-+eEdD0 "#/*'//lf//cr//tab, at, way)
      if (way /= other) return
      if (pick(10) == 1) text = text(:at)
   end subroutine mutate

   !> A million rows are read right, and in seconds at most even with all checks compiled in.
   subroutine test_size()
      integer, parameter :: n = 1000000
      character(len=*), parameter :: name = 'big.csv'
      character(len=:), allocatable :: text
      character(len=column_length), allocatable :: header(:)
      real(wp), allocatable :: values(:, :)
      type(output_t) :: output
      type(error_t), allocatable :: error
      character(len=24) :: line, detail
      integer(ip) :: start, finished, rate
      integer :: i

      allocate (character(len=25*n) :: text)
      do i = 1, n
         write (line, '(i9,a,es14.7)') i, ',', real(i, wp)**(-1)
         text(25*i - 24:25*i) = line//lf
      end do
      call output%add(name, text)
      call output%commit(scratch, error)
      call system_clock(start, rate)
      call read_columns(scratch//'/'//name, 2, values, header, error, increasing=.true.)
      call system_clock(finished)
      call check('10**6 rows: read', .not. allocated(error))
      if (allocated(error)) return
      ! Integers below 2**53 are exact; 7 decimals of the reciprocal are right to 1e-7 of it.
      call check('10**6 rows: right', all(nint(values(1, :)) == [(i, i=1, n)]) .and. &
         all(abs(values(1, :)*values(2, :) - 1) <= 1.0e-7_wp))
      write (detail, '(f0.3,a)') real(finished - start, wp)/real(rate, wp), ' s'
      call check('10**6 rows: time', finished - start < 30*rate, trim(detail))
   end subroutine test_size

   subroutine read_written(text, values, header, error)
      character(len=*), intent(in) :: text
      real(wp), allocatable, intent(out) :: values(:, :)
      character(len=column_length), allocatable, intent(out) :: header(:)
      type(error_t), allocatable, intent(out) :: error
      type(output_t) :: output

      call output%add('table.csv', text)
      call output%commit(scratch, error)
      if (allocated(error)) error stop 'scratch folder'
      call read_columns(scratch//'/table.csv', 2, values, header, error, increasing=.true.)
   end subroutine read_written

end program test_csv
