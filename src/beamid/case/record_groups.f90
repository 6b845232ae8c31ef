!> Readers of the groups of a case file that describe records: files and columns, calibration, and
!> the selection of samples. `beamid_case_files` calls them.
module beamid_record_groups
   use beamid_blocks, only: block_t
   use beamid_frequency_responses, only: quantities
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_records, only: frequency_keys_t, recording_t, window_t
   use beamid_strings, only: to_text
   use beamid_values, only: positive, range_t
   implicit none
   private

   public :: read_recording, get_columns, get_window

contains

   !> Reads a group &record.
   subroutine read_recording(block, found)
      type(block_t), intent(inout) :: block
      type(recording_t), intent(out) :: found

      character(len=:), allocatable :: kind

      found%line = block%line
      kind = 'time'
      call block%get('kind', kind, 'kind of data: ''time'', accelerations at given times; '// &
         '''frf'', a frequency response function per unit force; ''modes'', natural '// &
         'frequencies and damping ratios', [character(len=5) :: 'time', 'frf', 'modes'])
      found%kind = kind
      call block%get_file('file', found%path, 'path of the table with the measured values; '// &
         '''-'': track reads standard input', default='required, except by simulate', input=.true.)
      call get_window(block, found%window)
      call block%get('scale', found%scale, 'factor that converts the record into an '// &
         'acceleration: acceleration = scale (value - offset); or factor of a frequency response')
      call block%get('offset', found%offset, 'offset of the sensor: value of the '// &
         'record at zero acceleration')
      call get_columns(block, 'measured values', found%time_column, found%value_column, found%rate)
      call block%get('clip_low', found%clip_low, 'detected from flat parts of the signal', &
         'lower limit of the recorder; samples at or below it are left out')
      call block%get('clip_high', found%clip_high, 'detected from flat parts of the signal', &
         'upper limit of the recorder; samples at or above it are left out')
      call block%get('thin', found%thin, 'reduction factor n: after a low-pass filter, every '// &
         'n-th sample is used', range_t(2, 100000), default='every sample, without a filter')
      call block%get('sd', found%sd, 'estimated by the fit', &
         'standard deviation of the noise of the acceleration, or of the real and of the '// &
         'imaginary part of a frequency response', positive)
      call block%get('length', found%length, 'length of &beam', &
         'length of the beam in this record', positive)
      call block%get('x_S', found%x_S, 'x_S of &sensor', 'position of the sensor in this record', &
         positive)
      call block%get('x_P', found%x_P, 'x_P of &support', &
         'position of the support in this record', positive)
      call block%get('sensor', found%sensor, 'name of the sensor that made this record', &
         default='the only sensor; required with several sensors')
      call block%get('experiment', found%experiment, 'number of the experiment; records with '// &
         'the same number are channels of one motion', range_t(1, huge(1)), &
         default='a motion of its own')
      call get_lines(block, found%lines)
      call block%close()
      if (block%failed()) return
      call exclude_keys_of_other_kinds(block, kind)
      if (.not. abs(found%scale) > 0) call block%refuse('scale', to_text(found%scale), &
         'a value other than 0')
      if (block%has('thin')) call block%exclude('t_step', 'beside thin')
      if (allocated(found%clip_low) .and. allocated(found%clip_high)) then
         if (found%clip_low >= found%clip_high) call block%refuse('clip_high', &
            to_text(found%clip_high), 'more than clip_low = '//to_text(found%clip_low))
      end if
   end subroutine read_recording

   !> Gets the keys of frequency responses.
   subroutine get_lines(block, lines)
      type(block_t), intent(inout) :: block
      type(frequency_keys_t), intent(inout) :: lines
      character(len=:), allocatable :: quantity, window
      integer :: k

      quantity = 'accelerance'
      window = 'boxcar'
      call block%get('quantity', quantity, 'response per unit force: ''accelerance'' '// &
         '(acceleration), ''mobility'' (velocity) or ''receptance'' (displacement)', quantities)
      do k = lbound(quantities, 1), ubound(quantities, 1)
         if (quantities(k) == quantity) lines%power = k
      end do
      call block%get('f_first', lines%first, 'start of the record; required without file', &
         'lowest frequency that is used', range_t(0))
      call block%get('f_last', lines%last, 'end of the record; required without file', &
         'highest frequency that is used', positive)
      call block%get('f_step', lines%step, 'none; required without file', &
         'distance of the frequencies at which the command frf computes the response', positive)
      call block%get('coherence_least', lines%least_coherence, 'least coherence; lines with a '// &
         'lower coherence are left out', range_t(0, 1))
      call block%get('averages', lines%averages, 'number of averaged blocks; with the '// &
         'coherence, it determines the noise of each line', range_t(2, 1000000), &
         default='none; required with a coherence and without sd')
      call block%get('exponential_window', lines%rate, 'decay rate of the exponential '// &
         'window of force and response; it is added to the decay rate of each mode of the model', &
         range_t(0))
      call block%get('window', window, 'window of the blocks: ''boxcar'' (none) or ''hann''', &
         [character(len=6) :: 'boxcar', 'hann'])
      lines%is_hann = window == 'hann'
      call block%get('x_F', lines%x_F, 'x_F of &excitation, else the tip', &
         'position of the force of a frequency response', positive)
      if (.not. (allocated(lines%first) .and. allocated(lines%last))) return
      if (lines%last < lines%first) call block%refuse('f_last', to_text(lines%last), &
         'no less than f_first = '//to_text(lines%first))
   end subroutine get_lines

   !> Refuses keys of the group &record that have no meaning for its kind.
   subroutine exclude_keys_of_other_kinds(block, kind)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: kind
      !> Keys that belong to certain kinds only, and these kinds.
      character(len=*), parameter :: keys(24) = [character(len=18) :: 't_first', 't_last', &
         't_step', 'scale', 'offset', 'time_column', 'value_column', 'rate', 'clip_low', &
         'clip_high', 'thin', 'sd', 'x_S', 'sensor', 'experiment', 'quantity', 'f_first', &
         'f_last', 'f_step', 'coherence_least', 'averages', 'exponential_window', 'window', &
         'x_F'], &
         kinds(24) = [character(len=8) :: 'time', 'time', 'time', 'time frf', 'time', 'time', &
         'time', 'time', 'time', 'time', 'time', 'time frf', 'time frf', 'time frf', 'time', &
         'frf', 'frf', 'frf', 'frf', 'frf', 'frf', 'frf', 'frf', 'frf']

      call block%exclude_other_kinds(kind, keys, kinds)
   end subroutine exclude_keys_of_other_kinds

   !> Gets the keys that describe the columns of a table.
   !>
   !> values                     content of the value column, for the help
   !> time_column, value_column  name or number of a column; '': default
   !> rate                       samples per unit of time, if there is no time column
   subroutine get_columns(block, values, time_column, value_column, rate)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: values
      character(len=*), intent(inout) :: time_column, value_column
      real(wp), allocatable, intent(inout) :: rate

      call read_column('time_column', time_column, 'times', 'the first column')
      call read_column('value_column', value_column, values, &
         'the second column; with rate, the only one')
      call block%get('rate', rate, 'none, with a time column', 'sampling rate of a '// &
         'file without a time column; the first sample is at t = 0', positive)
      if (block%has('rate')) call block%exclude('time_column', 'beside rate')

   contains

      !> Gets the name of a column; refuses an empty name and a name that would be truncated.
      subroutine read_column(key, column, content, default)
         character(len=*), intent(in) :: key, content, default
         character(len=*), intent(inout) :: column
         character(len=:), allocatable :: name

         call block%get(key, name, 'name (upper or lower case) or number, in quotes, of the '// &
            'column with the '//content, default=default)
         if (.not. allocated(name)) return
         if (name == '' .or. len_trim(adjustl(name)) > len(column)) call block%refuse(key, &
            shown(name), 'the name of a column, of at most '//to_text(len(column))// &
            ' characters, or its number')
         column = adjustl(name)
      end subroutine read_column

   end subroutine get_columns

   !> Gets the keys of a window, and refuses a window that ends before it begins.
   subroutine get_window(block, window)
      type(block_t), intent(inout) :: block
      type(window_t), intent(inout) :: window
      character(len=:), allocatable :: required

      required = ''
      if (block%name == 'record') required = '; required without file'
      call block%get('t_first', window%t_first, 'start of the record'//required, &
         'time of the first sample that is used')
      call block%get('t_last', window%t_last, 'end of the record'//required, &
         'time of the last sample that is used')
      call block%get('t_step', window%t_step, 'every sample'//required, &
         'time step between the samples that are used', positive)
      if (.not. (allocated(window%t_first) .and. allocated(window%t_last))) return
      if (window%t_last < window%t_first) call block%refuse('t_last', to_text(window%t_last), &
         'no less than t_first = '//to_text(window%t_first))
   end subroutine get_window

end module beamid_record_groups
