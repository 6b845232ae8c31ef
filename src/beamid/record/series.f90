!> Reads two columns of a table, times and values, as a time series. Of a long series only the
!> requested part is kept.
module beamid_series
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_column_units, only: bare_name
   use beamid_csv, only: extent_t, open_table, part_t, read_rows
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: ip, wp
   use beamid_numbers, only: shown
   use beamid_rows, only: column_length, reader_t
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: columns_t, series_t, part_t, read_series, series_of, find_columns, check_samples

   !> The two columns of a file that a series was read from.
   type :: columns_t
      integer :: count = 0                     !< number of named columns of the file; 0: no names
      integer :: places(2) = 0                 !< numbers of the time and value column; 0: a rate
      character(len=column_length) :: names(2) = ''   !< their names; '': none
      character(len=:), allocatable :: clock   !< first time stamp; not allocated: times are numbers
   end type columns_t

   !> The rows kept of a time series, and the extent of the whole series.
   type, extends(extent_t) :: series_t
      real(wp), allocatable :: t(:)       !< (rows) strictly increasing [time]
      real(wp), allocatable :: z(:)       !< (rows) values, as in the file
      integer :: skipped = 0              !< lines of the header, without those of names and units
      type(columns_t) :: columns          !< where it was read from
   end type series_t

contains

   !> Reads a time series. Every row of the file is checked, whether it is kept or not.
   !>
   !> path    of the file
   !> names   time column and value column: a name in the header in upper or lower case, with or
   !>         without its unit, a number from '1', or '' for the first and the second column
   !> part    rows to keep
   !> series  on return the rows kept and the extent of the file
   !> error   `path:line: ...` of the first mistake
   !> rate    > 0: rows per unit of time, the first at 0. The file then has no time column; if it
   !>         has more than one column, the value column must be named
   !> stamps  whether the times may be time stamps, which become seconds since the first; default
   !>         .false.
   subroutine read_series(path, names, part, series, error, rate, stamps)
      character(len=*), intent(in) :: path, names(2)
      type(part_t), intent(in) :: part
      type(series_t), intent(out) :: series
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: rate
      logical, intent(in), optional :: stamps
      type(reader_t) :: reader
      real(wp), allocatable :: values(:, :)
      integer :: columns(2), k

      call open_table(path, merge(1, 2, present(rate)), reader, error)
      reader%ordered = .true.
      if (present(rate)) reader%rate = rate
      if (present(stamps)) reader%allows_stamps = stamps .and. .not. present(rate)
      if (.not. allocated(error)) call find_columns(reader, names, columns, error)
      if (.not. allocated(error)) call read_rows(reader, columns, part, values, &
         series%extent_t, error)
      if (allocated(error)) return
      series%skipped = reader%skipped
      series%columns%count = size(reader%header)
      series%columns%places = columns
      do k = 1, 2
         if (columns(k) > 0 .and. columns(k) <= size(reader%header)) &
            series%columns%names(k) = reader%header(columns(k))
      end do
      if (reader%clock%is_running) series%columns%clock = reader%clock%beginning
      call keep_part(values(1, :), values(2, :), part, series)
   end subroutine read_series

   !> Makes a time series of samples in memory; the same rows are kept as from a file.
   !>
   !> t, z   (rows) times and values, equally many
   !> error  `sample k: ...`: no sample, a number that is not finite, or a time that does not
   !>        increase
   subroutine series_of(t, z, part, series, error)
      real(wp), intent(in) :: t(:), z(:)
      type(part_t), intent(in) :: part
      type(series_t), intent(out) :: series
      type(error_t), allocatable, intent(out) :: error

      if (size(t) == 0 .or. size(t) /= size(z)) then
         call bad_input(error, 'found '//to_text(size(t))//' times and '//to_text(size(z))// &
            ' values, expected as many of one as of the other, and some')
         return
      end if
      call check_samples(t, z, -huge(1.0_wp), error)
      if (allocated(error)) return
      series%first = t(1)
      series%last = t(size(t))
      series%rows = size(t, kind=ip)
      call keep_part(t, z, part, series)
   end subroutine series_of

   !> Refuses numbers that are not finite, and times that do not increase.
   !>
   !> t, z   (rows) times and values
   !> last   time before the first; -huge: none
   !> error  `sample k: ...` of the first mistake
   subroutine check_samples(t, z, last, error)
      real(wp), intent(in) :: t(:), z(:), last
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: before
      integer :: k

      before = last
      do k = 1, size(t)
         if (.not. (ieee_is_finite(t(k)) .and. ieee_is_finite(z(k)))) then
            call bad_input(error, 'sample '//to_text(k)//': found t = '//to_text(t(k))// &
               ', a = '//to_text(z(k))//', expected finite numbers')
         else if (t(k) <= before) then
            call bad_input(error, 'sample '//to_text(k)//': found t = '//to_text(t(k))// &
               ' after '//to_text(before)//', expected a larger number')
         end if
         if (allocated(error)) return
         before = t(k)
      end do
   end subroutine check_samples

   !> Keeps the rows of a part, and its margin.
   pure subroutine keep_part(t, z, part, series)
      real(wp), intent(in) :: t(:), z(:)
      type(part_t), intent(in) :: part
      type(series_t), intent(inout) :: series
      integer :: first, last

      first = max(1, count(t < part%first) - part%margin + 1)
      last = min(size(t), count(t <= part%last) + part%margin)
      series%t = t(first:last)
      series%z = z(first:last)
   end subroutine keep_part

   !> Finds the two columns of a series.
   !>
   !> columns  numbers of the time column (0 with a rate) and of the value column
   !> error    no such column, or ambiguous names
   subroutine find_columns(reader, names, columns, error)
      type(reader_t), intent(inout) :: reader
      character(len=*), intent(in) :: names(2)
      integer, intent(out) :: columns(2)
      type(error_t), allocatable, intent(out) :: error
      !> Their keys in the case file, for messages.
      character(len=*), parameter :: keys(2) = [character(len=12) :: 'time_column', 'value_column']
      integer :: k, n

      columns = [1, 2]
      if (reader%rate > 0) then
         columns = [0, 1]
         n = size(reader%header)
         if (n == 0) n = reader%count_filled()
         if (n > 1 .and. names(2) == '' .and. reader%has_decimal_comma()) then
            call reader%problem(error, 'found '//shown(reader%row())//', which reads as 2 '// &
               'columns, expected a decimal point in place of the decimal comma, or '// &
               'value_column to name one of the columns')
         else if (n > 1 .and. names(2) == '') then
            call bad_input(error, reader%path//': found '// &
               to_text(n)//' columns, expected value_column to name one of them beside rate')
         end if
         if (allocated(error)) return
      end if
      do k = 1, 2
         if (names(k) == '') cycle
         call find_column(reader, names(k), trim(keys(k)), columns(k), error)
         if (allocated(error)) return
      end do
      if (columns(1) == columns(2)) call bad_input(error, reader%path//': found column '// &
         to_text(columns(1))//' as '//trim(keys(1))//' and as '//trim(keys(2))// &
         ', expected two columns')
   end subroutine find_columns

   !> Finds the number of a column. A name in the header takes precedence over a name without its
   !> unit, and both over a number.
   !>
   !> name    of the column, with or without its unit, or its number
   !> key     of the case file, for messages
   !> column  its number
   !> error   no such column, or several of this name
   subroutine find_column(reader, name, key, column, error)
      type(reader_t), intent(in) :: reader
      character(len=*), intent(in) :: name, key
      integer, intent(out) :: column
      type(error_t), allocatable, intent(out) :: error
      integer :: k, found, pass, status
      logical :: is_wanted
      character(len=len(name)) :: wanted

      found = 0
      column = 0
      wanted = lower(adjustl(name))
      do pass = 1, 2
         do k = 1, size(reader%header)
            if (pass == 1) is_wanted = lower(adjustl(reader%header(k))) == wanted
            if (pass == 2) is_wanted = lower(bare_name(adjustl(reader%header(k)))) == wanted
            if (.not. is_wanted) cycle
            found = found + 1
            column = k
         end do
         if (found > 0) exit
      end do
      if (found == 0 .and. verify(trim(name), '0123456789') == 0) then
         read (name, *, iostat=status) column
         if (status /= 0) column = huge(column)
         found = 1
         k = size(reader%header)
         if (k == 0) k = reader%count_fields()
         if (column < 1 .or. column > k) call bad_input(error, reader%path//': found '// &
            to_text(k)//' columns, expected '//key//' = '//shown(name)//' to be one of them')
      else if (found == 0 .and. size(reader%header) == 0) then
         call bad_input(error, reader%path//': found no names of columns, expected '//key// &
            ' = '//shown(name)//' to be one; a number counts the columns')
      else if (found == 0) then
         call bad_input(error, reader%path//': found the columns '//name_list(reader%header)// &
            ', expected '//key//' = '//shown(name)//' to be one of them')
      else if (found > 1) then
         call bad_input(error, reader%path//': found '//to_text(found)//' columns called '// &
            shown(name)//', expected '//key//' to name one; a number counts the columns')
      end if
   end subroutine find_column

   !> Returns the names of columns, at most twelve, for a message.
   pure function name_list(header) result(text)
      character(len=*), intent(in) :: header(:)
      character(len=:), allocatable :: text
      integer, parameter :: most = 12
      integer :: k

      text = shown(header(1))
      do k = 2, min(most, size(header))
         text = text//', '//shown(header(k))
      end do
      if (size(header) > most) text = text//', ...'
   end function name_list

end module beamid_series
