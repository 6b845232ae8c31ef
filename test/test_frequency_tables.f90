!> Tables of frequency responses and of modes: columns by name, and every error in words.
program test_frequency_tables
   use beamid_errors, only: error_t
   use beamid_frequency_tables, only: frequency_table_t, modal_rows_t, read_frequency_table, &
      read_modal_rows
   use beamid_kinds, only: wp
   use checks, only: check, check_close, finish
   use shell, only: own_path
   implicit none

   character(len=*), parameter :: nl = achar(10)
   character(len=:), allocatable :: path

   path = own_path('frequency-tables')
   call test_responses()
   call test_bad_responses()
   call test_phases()
   call test_modes()
   call test_bad_modes()
   call execute_command_line('rm '//path)
   call finish('frequency_tables')

contains

   !> Writes the file that is read.
   subroutine write_table(text)
      character(len=*), intent(in) :: text
      integer :: unit

      open (newunit=unit, file=path, access='stream', form='unformatted', status='replace', &
         action='write')
      write (unit) text
      close (unit)
   end subroutine write_table

   !> The same response with columns in any order and under other names; the degrees are exact to
   !> round-off, some units of 1e-16.
   subroutine test_responses()
      character(len=*), parameter :: numbers = nl//'1,3,4'//nl//'2,-5,12'//nl
      type(frequency_table_t) :: table
      type(error_t), allocatable :: error

      call expect('frequency_hz,real,imag'//numbers)
      call expect('Frequency (Hz),Real,Imag'//numbers)
      call expect('freq,re,im'//numbers)
      call expect('f_hz,RE,IMAGINARY'//numbers)
      call expect('f [Hz],real [m/s^2/N],imag [m/s^2/N]'//numbers)
      call expect(numbers(2:))
      call expect('imag,other,frequency_hz,real'//nl//'4,9,1,3'//nl//'12,9,2,-5'//nl)
      call expect('frequency_hz;real;imag'//nl//'1,0;3,0;4,0'//nl//'2,0;-5,0;12,0'//nl)
      call expect('frequency_hz,magnitude,phase_deg'//nl//'1,5,53.13010235415598'//nl// &
         '2,13,112.61986494804043'//nl)
      call expect('hz,abs,phase (deg)'//nl//'1,5,53.13010235415598'//nl// &
         '2,13,112.61986494804043'//nl)
      ! As in frf.csv of the program: real and imaginary part count.
      call expect('elements,frequency_hz,real,imag,magnitude,phase_deg'//nl//'16,1,3,4,7,7'//nl// &
         '16,2,-5,12,7,7'//nl)
      call check('without coherence and sd', .not. (allocated(table%coherence) .or. &
         allocated(table%sd)))
      call write_table('f,re,im,gamma2,sd'//nl//'0,3,4,0.5,0.1'//nl//'2,-5,12,1,0.2'//nl)
      call read_frequency_table(path, table, error)
      call check('a frequency of 0, coherence and sd', .not. allocated(error))
      if (allocated(error)) return
      call check_close('coherence', table%coherence(1), 0.5_wp, 0.0_wp)
      call check_close('sd', table%sd(2), 0.2_wp, 0.0_wp)
   end subroutine test_responses

   !> Expects 3 + 4i at 1 Hz and -5 + 12i at 2 Hz.
   subroutine expect(text)
      character(len=*), intent(in) :: text
      type(frequency_table_t) :: table
      type(error_t), allocatable :: error
      character(len=:), allocatable :: name

      name = text(:index(text, nl) - 1)
      call write_table(text)
      call read_frequency_table(path, table, error)
      call check(name//': read', .not. allocated(error))
      if (allocated(error)) then
         print '(2a)', '      ', error%message
         return
      end if
      call check(name//': frequencies', all(abs(table%frequency - [1, 2]) <= 0))
      call check(name//': response', all(abs(table%h - [(3.0_wp, 4.0_wp), (-5.0_wp, 12.0_wp)]) &
         < 1e-13_wp))
   end subroutine expect

   !> Every error says where it is and what was expected.
   subroutine test_bad_responses()
      character(len=*), parameter :: header = 'frequency_hz,real,imag'

      call refused(header(:17)//nl//'1,2'//nl, ':1: found ''frequency_hz,real'', &
         expected 3 columns')
      call refused('frequency_hz,real,x'//nl//'1,2,3'//nl, 'found the columns ''frequency_hz'', &
         '// &
         '''real'', ''x'', expected frequency_hz with real and imag, &
         or with magnitude and phase_deg')
      call refused('t,real,imag'//nl//'1,2,3'//nl, 'found the columns ''t'', ''real'', ''imag''')
      call refused('frequency_hz,magnitude,real'//nl//'1,2,3'//nl, &
         'or with magnitude and phase_deg')
      call refused('frequency_hz,real,real,imag'//nl//'1,2,3,4'//nl, &
         'found two columns called real')
      call refused(header//nl//'1,2,3'//nl//'2,x,3'//nl, ':3: column 2 (''real''): found ''x'', &
         '// &
         'expected a number')
      call refused(header//nl//'1,2,3'//nl//'1,2,3'//nl, ':3: column 1 (''frequency_hz''): '// &
         'found ''1'' after ''1'', expected a larger number')
      call refused(header//nl//'1,2,3'//nl//'2,,3'//nl, ':3: column 2 (''real''): found an empty')
      call refused(header//nl//'1,2,nan'//nl, 'found ''nan'', expected a number')
      call refused(header//nl//'-1,2,3'//nl//'1,2,3'//nl, 'frequency_hz of row 1: found -1, '// &
         'expected a value of at least 0')
      call refused(header//',coherence'//nl//'1,2,3,0.5'//nl//'2,2,3,1.01'//nl, &
         'coherence of row 2: found 1.01, expected a value between 0 and 1')
      call refused(header//',coherence'//nl//'1,2,3,-0.5'//nl, 'coherence of row 1: found -0.5')
      call refused(header//',sd'//nl//'1,2,3,0'//nl, 'sd of row 1: found 0, expected a value '// &
         'above 0')
      call refused('frequency_hz,magnitude,phase_deg'//nl//'1,2,3'//nl//'2,-30,3'//nl, &
         'magnitude of row 2: found -30, expected values of at least 0; decibels have to be '// &
         'converted: magnitude = 10^(dB/20)')
   end subroutine test_bad_responses

   !> Expects an error of a frequency response.
   subroutine refused(text, words)
      character(len=*), intent(in) :: text, words
      type(frequency_table_t) :: table
      type(error_t), allocatable :: error

      call write_table(text)
      call read_frequency_table(path, table, error)
      call check('refused: '//words, allocated(error))
      if (allocated(error)) call check('  in words, with the file', &
         index(error%message, path) == 1 .and. index(error%message, words) > 0, error%message)
   end subroutine refused

   !> The phase of a resonance of damping ratio 2 % in radians is refused; in degrees it is not, nor
   !> is a phase that is nearly constant.
   subroutine test_phases()
      integer, parameter :: lines = 41
      real(wp), parameter :: degree = acos(-1.0_wp)/180
      character(len=40*lines) :: in_degrees, in_radians, constant
      real(wp) :: f, phase
      integer :: k
      type(frequency_table_t) :: table
      type(error_t), allocatable :: error

      in_degrees = ''
      in_radians = ''
      constant = ''
      do k = 1, lines
         f = 0.8_wp + 0.01_wp*(k - 1)
         phase = -atan2(0.04_wp*f, 1 - f**2)
         call add(in_degrees, f, phase/degree)
         call add(in_radians, f, phase)
         call add(constant, f, 0.01_wp*phase)
      end do
      call write_table('frequency_hz,magnitude,phase_deg'//nl//trim(in_degrees))
      call read_frequency_table(path, table, error)
      call check('a resonance in degrees', .not. allocated(error))
      call write_table('frequency_hz,magnitude,phase_deg'//nl//trim(constant))
      call read_frequency_table(path, table, error)
      call check('a phase that is nearly constant', .not. allocated(error))
      call refused('frequency_hz,magnitude,phase_deg'//nl//trim(in_radians), &
         'which look like radians; expected degrees')
   end subroutine test_phases

   !> Adds a line of a table.
   subroutine add(text, f, phase)
      character(len=*), intent(inout) :: text
      real(wp), intent(in) :: f, phase
      character(len=40) :: row

      write (row, '(f0.4, a, f0.6, a)') f, ',1,', phase, nl
      text = trim(text)//row
   end subroutine add

   !> Modes with and without damping ratios and numbers.
   subroutine test_modes()
      type(modal_rows_t) :: rows
      type(error_t), allocatable :: error

      call write_table('fn (Hz),sd_frequency'//nl//'61,0.5'//nl//'9,0.25'//nl)
      call read_modal_rows(path, rows, error)
      call check('frequencies alone, in any order', .not. allocated(error))
      if (allocated(error)) return
      call check('  values', all(abs(rows%frequency - [61, 9]) <= 0) .and. all(abs(rows%sd &
         - [0.5_wp, 0.25_wp]) <= 0))
      call check('  without damping and numbers', .not. (allocated(rows%damping) .or. &
         allocated(rows%sd_damping) .or. allocated(rows%mode)))
      call write_table('mode,frequency_hz,sd_hz,zeta,sd_damping'//nl//'2,61,0.5,0.01,0.001'//nl// &
         '1,9,0.25,-0.02,0.002'//nl)
      call read_modal_rows(path, rows, error)
      call check('all columns', .not. allocated(error))
      if (allocated(error)) return
      call check('  values', all(rows%mode == [2, 1]) .and. all(abs(rows%damping - [0.01_wp, &
         -0.02_wp]) <= 0) .and. all(abs(rows%sd_damping - [0.001_wp, 0.002_wp]) <= 0))
   end subroutine test_modes

   !> Every error of a table of modes.
   subroutine test_bad_modes()
      character(len=*), parameter :: columns = 'expected frequency_hz and sd_hz, and '// &
         'damping_ratio only with sd_damping', full = 'mode,frequency_hz,sd_hz,damping_ratio,'// &
         'sd_damping'//nl

      call no_modes('frequency_hz,other'//nl//'9,1'//nl, 'found the columns ''frequency_hz'', '// &
         '''other'', '//columns)
      call no_modes('frequency_hz,sd_hz,damping_ratio'//nl//'9,1,0.1'//nl, columns)
      call no_modes('frequency_hz,sd_hz,sd_damping'//nl//'9,1,0.1'//nl, columns)
      call no_modes('9,1'//nl//'61,1'//nl, columns)
      call no_modes(full//'1,0,0.1,0.01,0.001'//nl, 'frequency_hz of row 1: found 0, &
         expected a '// &
         'value above 0')
      call no_modes(full//'1,9,-0.1,0.01,0.001'//nl, 'sd_hz of row 1: found -0.1')
      call no_modes(full//'1,9,0.1,1.5,0.1'//nl, 'damping_ratio of row 1: found 1.5, &
         expected a '// &
         'ratio below 1 (2 % is 0.02)')
      call no_modes(full//'1,9,0.1,0.01,0'//nl, 'sd_damping of row 1: found 0')
      call no_modes(full//'1,9,0.1,0.01,0.001'//nl//'2.5,61,0.1,0.01,0.001'//nl, &
         'mode of row 2: found 2.5, expected a number from 1 to 100')
      call no_modes(full//'0,9,0.1,0.01,0.001'//nl, 'mode of row 1: found 0')
      call no_modes(full//'1,nine,0.1,0.01,0.001'//nl, 'found ''nine'', expected a number')
   end subroutine test_bad_modes

   !> Expects an error of a table of modes.
   subroutine no_modes(text, words)
      character(len=*), intent(in) :: text, words
      type(modal_rows_t) :: rows
      type(error_t), allocatable :: error

      call write_table(text)
      call read_modal_rows(path, rows, error)
      call check('refused: '//words, allocated(error))
      if (allocated(error)) call check('  in words, with the file', &
         index(error%message, path) == 1 .and. index(error%message, words) > 0, error%message)
   end subroutine no_modes

end program test_frequency_tables
