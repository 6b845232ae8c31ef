!> Reads tables of frequency responses and tables of modes. Their columns are found by name.
module beamid_frequency_tables
   use beamid_column_units, only: bare_name
   use beamid_csv, only: extent_t, open_table, part_t, read_rows
   use beamid_errors, only: bad_input, error_t
   use beamid_kinds, only: pi, two_pi, wp
   use beamid_numbers, only: shown
   use beamid_rows, only: column_length, reader_t
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: frequency_table_t, modal_rows_t, read_frequency_table, read_modal_rows

   !> A frequency response function at given frequencies.
   type :: frequency_table_t
      real(wp), allocatable :: frequency(:)   !< (n) ascending [1/time]
      complex(wp), allocatable :: h(:)        !< (n) response per unit force
      real(wp), allocatable :: coherence(:)   !< (n) 0 .. 1; not allocated: no such column
      !> (n) standard deviation of the real and of the imaginary part; not allocated: no such column
      real(wp), allocatable :: sd(:)
      logical :: is_polar = .false.   !< the file holds magnitudes and phases
   end type frequency_table_t

   !> Natural frequencies and damping ratios, each with its standard deviation.
   type :: modal_rows_t
      real(wp), allocatable :: frequency(:), sd(:)   !< (n) [1/time]
      !> (n) damping ratios and their standard deviations; not allocated: no such columns
      real(wp), allocatable :: damping(:), sd_damping(:)
      integer, allocatable :: mode(:)   !< (n) numbers of the modes; not allocated: no such column
   end type modal_rows_t

   !> A column: its name, and other names that are understood.
   type :: column_t
      character(len=16) :: name
      character(len=48) :: others = ''
   end type column_t

   integer, parameter :: frequency = 1, real_part = 2, imaginary_part = 3, magnitude = 4, &
      phase = 5, coherence = 6, deviation = 7
   type(column_t), parameter :: response_columns(*) = [ &
      column_t('frequency_hz', 'frequency freq f f_hz freq_hz hz'), column_t('real', 're'), &
      column_t('imag', 'im imaginary'), column_t('magnitude', 'mag amplitude abs'), &
      column_t('phase_deg', 'phase'), column_t('coherence', 'coh gamma2'), &
      column_t('sd', '')]
   type(column_t), parameter :: modal_columns(*) = [ &
      column_t('frequency_hz', 'frequency freq f f_hz fn'), column_t('sd_hz', 'sd_frequency'), &
      column_t('damping_ratio', 'damping zeta xi'), column_t('sd_damping', 'sd_damping_ratio'), &
      column_t('mode', '')]

contains

   !> Reads a frequency response. A file without names of columns holds frequency, real and
   !> imaginary part, in this order.
   !>
   !> error  `path:line: ...`: a column that is missing, a number that is not one, frequencies that
   !>        are negative or do not increase, a coherence outside 0 .. 1, a standard deviation that
   !>        is not positive, values that look like decibels or radians
   subroutine read_frequency_table(path, table, error)
      character(len=*), intent(in) :: path
      type(frequency_table_t), intent(out) :: table
      type(error_t), allocatable, intent(out) :: error
      type(reader_t) :: reader
      real(wp), allocatable :: values(:, :)
      real(wp), parameter :: degree = pi/180
      integer :: columns(size(response_columns))
      logical :: is_polar

      call open_table(path, 3, reader, error)
      if (allocated(error)) return
      reader%ordered = .true.
      if (size(reader%header) == 0) then
         columns = 0
         columns([frequency, real_part, imaginary_part]) = [1, 2, 3]
      else
         call find_columns(reader, response_columns, columns, error)
         if (allocated(error)) return
      end if
      is_polar = columns(real_part) == 0 .or. columns(imaginary_part) == 0
      if (is_polar) is_polar = columns(magnitude) > 0 .and. columns(phase) > 0
      if (columns(frequency) == 0 .or. .not. is_polar .and. (columns(real_part) == 0 .or. &
         columns(imaginary_part) == 0)) then
         call bad_input(error, path//': found the columns '//names_of(reader)//', expected '// &
            'frequency_hz with real and imag, or with magnitude and phase_deg')
         return
      end if
      call read_all(reader, columns, values, error)
      if (allocated(error)) return
      table%frequency = values(:, frequency)
      table%is_polar = is_polar
      if (is_polar) then
         call check_polar(path, values(:, magnitude), values(:, phase), error)
         table%h = values(:, magnitude)*exp(cmplx(0.0_wp, degree*values(:, phase), wp))
      else
         table%h = cmplx(values(:, real_part), values(:, imaginary_part), wp)
      end if
      if (columns(coherence) > 0) then
         table%coherence = values(:, coherence)
         call check_all(path, 'coherence', table%coherence, table%coherence >= 0 .and. &
            table%coherence <= 1 + 1e-6_wp, 'a value between 0 and 1', error)
      end if
      if (columns(deviation) > 0) then
         table%sd = values(:, deviation)
         call check_all(path, 'sd', table%sd, table%sd > 0, 'a value above 0', error)
      end if
      call check_all(path, 'frequency_hz', table%frequency, table%frequency >= 0, &
         'a value of at least 0', error)
   end subroutine read_frequency_table

   !> Refuses magnitudes that look like decibels and phases that look like radians.
   !>
   !> magnitudes, phases  (n) as in the file
   subroutine check_polar(path, magnitudes, phases, error)
      character(len=*), intent(in) :: path
      real(wp), intent(in) :: magnitudes(:), phases(:)
      type(error_t), allocatable, intent(inout) :: error
      !> Fewest lines that are judged.
      integer, parameter :: enough = 8

      call check_all(path, 'magnitude', magnitudes, magnitudes >= 0, 'values of at least 0; '// &
         'decibels have to be converted: magnitude = 10^(dB/20)', error)
      if (allocated(error) .or. size(phases) < enough) return
      ! The phase passes 180 degrees from below to above a resonance; in degrees a range of less
      ! than one turn in radians would be no resonance at all.
      if (maxval(phases) - minval(phases) > 0.3_wp*two_pi .and. maxval(abs(phases)) <= two_pi) &
         call bad_input(error, path//': phase_deg: found values from '// &
         to_text(minval(phases))//' to '//to_text(maxval(phases))//', which look like radians; '// &
         'expected degrees')
   end subroutine check_polar

   !> Reads a table of modes. Its columns must have names.
   !>
   !> error  `path:line: ...`: a column that is missing, a number that is not one, a frequency or a
   !>        standard deviation that is not positive, a mode that is no positive integer
   subroutine read_modal_rows(path, rows, error)
      character(len=*), intent(in) :: path
      type(modal_rows_t), intent(out) :: rows
      type(error_t), allocatable, intent(out) :: error
      type(reader_t) :: reader
      real(wp), allocatable :: values(:, :)
      integer :: columns(size(modal_columns))

      call open_table(path, 2, reader, error)
      if (.not. allocated(error)) call find_columns(reader, modal_columns, columns, error)
      if (allocated(error)) return
      if (any(columns(:2) == 0) .or. (columns(3) > 0 .neqv. columns(4) > 0)) then
         call bad_input(error, path//': found the columns '//names_of(reader)//', expected '// &
            'frequency_hz and sd_hz, and damping_ratio only with sd_damping')
         return
      end if
      call read_all(reader, columns, values, error)
      if (allocated(error)) return
      rows%frequency = values(:, 1)
      rows%sd = values(:, 2)
      call check_all(path, 'frequency_hz', rows%frequency, rows%frequency > 0, 'a value above 0', &
         error)
      call check_all(path, 'sd_hz', rows%sd, rows%sd > 0, 'a value above 0', error)
      if (columns(3) > 0) then
         rows%damping = values(:, 3)
         rows%sd_damping = values(:, 4)
         call check_all(path, 'damping_ratio', rows%damping, abs(rows%damping) < 1, &
            'a ratio below 1 (2 % is 0.02)', error)
         call check_all(path, 'sd_damping', rows%sd_damping, rows%sd_damping > 0, &
            'a value above 0', error)
      end if
      if (columns(5) == 0 .or. allocated(error)) return
      rows%mode = nint(values(:, 5))
      call check_all(path, 'mode', values(:, 5), rows%mode >= 1 .and. rows%mode <= 100 .and. &
         abs(values(:, 5) - rows%mode) <= 0, 'a number from 1 to 100', error)
   end subroutine read_modal_rows

   !> Finds columns by name, in upper or lower case, with or without a unit in brackets.
   !>
   !> wanted   (k) names
   !> columns  (k) number of each column; 0: there is none
   !> error    two columns of the same name
   subroutine find_columns(reader, wanted, columns, error)
      type(reader_t), intent(in) :: reader
      type(column_t), intent(in) :: wanted(:)
      integer, intent(out) :: columns(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=column_length) :: name
      integer :: j, k, pass

      columns = 0
      do k = 1, size(wanted)
         do pass = 1, 3
            do j = 1, size(reader%header)
               name = lower(adjustl(reader%header(j)))
               if (pass > 1) name = bare_name(name)
               if (pass < 3 .and. name /= wanted(k)%name) cycle
               if (pass == 3 .and. (name == '' .or. index(' '//trim(wanted(k)%others)//' ', &
                  ' '//trim(name)//' ') == 0)) cycle
               if (columns(k) > 0) call bad_input(error, reader%path//': found two columns '// &
                  'called '//trim(name)//', expected one')
               columns(k) = j
            end do
            if (columns(k) > 0) exit
         end do
      end do
   end subroutine find_columns

   !> Reads all rows of chosen columns.
   !>
   !> columns  (k) their numbers; 0: the values are 0
   !> values   (rows, k)
   subroutine read_all(reader, columns, values, error)
      type(reader_t), intent(inout) :: reader
      integer, intent(in) :: columns(:)
      real(wp), allocatable, intent(out) :: values(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(extent_t) :: extent
      real(wp), allocatable :: rows(:, :)
      integer, allocatable :: there(:)
      integer :: k

      there = pack([(k, k=1, size(columns))], columns > 0)
      call read_rows(reader, columns(there), part_t(), rows, extent, error)
      allocate (values(size(rows, 2), size(columns)), source=0.0_wp)
      do k = 1, size(there)
         values(:, there(k)) = rows(k, :)
      end do
   end subroutine read_all

   !> Refuses the first value of a column that fails a check.
   !>
   !> values, passes  (rows)
   !> error           an earlier error is kept
   subroutine check_all(path, column, values, passes, expected, error)
      character(len=*), intent(in) :: path, column, expected
      real(wp), intent(in) :: values(:)
      logical, intent(in) :: passes(:)
      type(error_t), allocatable, intent(inout) :: error
      integer :: row

      if (allocated(error)) return
      row = findloc(passes, .false., dim=1)
      if (row > 0) call bad_input(error, path//': '//column//' of row '//to_text(row)// &
         ': found '//to_text(values(row))//', expected '//expected)
   end subroutine check_all

   !> Returns the names of the columns for a message.
   function names_of(reader) result(text)
      type(reader_t), intent(in) :: reader
      character(len=:), allocatable :: text
      integer :: k

      text = ''
      do k = 1, size(reader%header)
         if (k > 1) text = text//', '
         text = text//shown(trim(reader%header(k)))
      end do
   end function names_of

end module beamid_frequency_tables
