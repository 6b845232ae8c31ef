!> Reads a time series line by line, while it is recorded. The text has the form of a file that
!> `beamid_series` reads.
module beamid_sample_streams
   use beamid_csv, only: extent_t, part_t, read_rows
   use beamid_errors, only: bad_input, error_t
   use beamid_headers, only: find_rows
   use beamid_kinds, only: ip, wp
   use beamid_rows, only: column_length, reader_t
   use beamid_series, only: find_columns
   use beamid_strings, only: to_text
   implicit none
   private

   public :: sample_stream_t, new_sample_stream

   !> A series of which some lines have been read.
   type :: sample_stream_t
      type(reader_t), private :: reader
      character(len=column_length), private :: names(2) = ''   !< columns, as in `read_series`
      integer, private :: columns(2) = 0
      character(len=:), allocatable, private :: header   !< lines before the first row
      character(len=:), allocatable, private :: rest     !< a line without its end
      integer(ip), private :: lines = 0                  !< number of lines read
      logical, private :: has_begun = .false.            !< the first row has been found
      real(wp), private :: previous = -huge(1.0_wp)      !< time of the last row
   contains
      procedure :: take
      procedure, private :: take_line
      procedure, private :: find_first_row
   end type sample_stream_t

   !> Largest number of lines of a header; a longer one is refused.
   integer, parameter :: longest_header = 200

contains

   !> Makes a stream of which nothing has been read.
   !>
   !> name   of the stream in messages
   !> names  (2) time and value column, as in `read_series`
   !> rate   > 0: rows per unit of time, as in `read_series`
   function new_sample_stream(name, names, rate) result(self)
      character(len=*), intent(in) :: name, names(2)
      real(wp), intent(in), optional :: rate
      type(sample_stream_t) :: self

      self%reader%path = name
      self%names = names
      if (present(rate)) self%reader%rate = rate
      self%header = ''
      self%rest = ''
      allocate (self%reader%header(0))
   end function new_sample_stream

   !> Takes text, and returns the samples of the lines that it completes. A line counts as soon as
   !> its end arrives.
   !>
   !> text   what has arrived, not necessarily whole lines
   !> t, z   (rows) times and values of new rows
   !> error  `name:line: ...` of the first mistake
   subroutine take(self, text, t, z, error)
      class(sample_stream_t), intent(inout) :: self
      character(len=*), intent(in) :: text
      real(wp), allocatable, intent(out) :: t(:), z(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:, :)
      real(wp) :: row(2)
      logical :: is_row
      integer :: first, n, length

      allocate (values(2, 16))
      n = 0
      first = 1
      do
         length = index(text(first:), new_line('a'))
         if (length == 0) exit
         call self%take_line(self%rest//text(first:first + length - 1), row, is_row, error)
         if (allocated(error)) return
         self%rest = ''
         first = first + length
         if (.not. is_row) cycle
         if (n == size(values, 2)) values = reshape(values, [2, 2*n], pad=[0.0_wp])
         n = n + 1
         values(:, n) = row
      end do
      self%rest = self%rest//text(first:)
      t = values(1, :n)
      z = values(2, :n)
   end subroutine take

   !> Takes one line with its end.
   subroutine take_line(self, line, row, is_row, error)
      class(sample_stream_t), intent(inout) :: self
      character(len=*), intent(in) :: line
      real(wp), intent(out) :: row(2)
      logical, intent(out) :: is_row
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: values(:, :)
      type(extent_t) :: extent
      character(len=1) :: separator

      row = 0
      is_row = .false.
      self%lines = self%lines + 1
      if (.not. self%has_begun) then
         call self%find_first_row(line, is_row, error)
         if (allocated(error) .or. .not. is_row) return
      else
         separator = self%reader%separator
         self%reader%text = line
         call self%reader%rewind()
         self%reader%separator = separator
         self%reader%line = self%lines - 1
         if (.not. self%reader%next_row()) return
      end if
      call read_rows(self%reader, self%columns, part_t(), values, extent, error)
      if (allocated(error)) return
      row = values(:, 1)
      is_row = .true.
      if (row(1) <= self%previous) then
         call self%reader%problem(error, 'found t = '//to_text(row(1))//' after '// &
            to_text(self%previous)//', expected a larger number')
      end if
      self%previous = row(1)
   end subroutine take_line

   !> Adds a line to the header, and tries to read it as the first row.
   !>
   !> is_found  whether it is the first row; the reader then is at this row
   !> error     a long header without a row; no such columns
   subroutine find_first_row(self, line, is_found, error)
      class(sample_stream_t), intent(inout) :: self
      character(len=*), intent(in) :: line
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: refusal
      type(reader_t) :: trial
      real(wp), allocatable :: values(:, :)
      type(extent_t) :: extent

      is_found = .false.
      self%header = self%header//line
      self%reader%text = self%header
      call find_rows(self%reader, merge(1, 2, self%reader%rate > 0), refusal)
      if (.not. allocated(refusal)) then
         call find_columns(self%reader, self%names, self%columns, refusal)
         ! Reading moves the reader.
         trial = self%reader
         if (.not. allocated(refusal)) call read_rows(trial, self%columns, part_t(), values, &
            extent, refusal)
      end if
      is_found = .not. allocated(refusal)
      self%has_begun = is_found
      if (self%lines < longest_header .or. is_found) return
      call bad_input(error, refusal%message)
   end subroutine find_first_row

end module beamid_sample_streams
