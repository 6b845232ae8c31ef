!> The groups of a case file that describe records: where they are, how they are calibrated, which
!> samples are wanted. Each procedure reads one group, checks every value, and leaves its argument
!> alone on error.
module beamid_record_groups
   use beamid_errors, only: error_t
   use beamid_paths, only: directory_of, join_path
   use beamid_kinds, only: wp
   use beamid_namelist, only: block_t, string_length
   use beamid_records, only: column_length, everything, recording_t, window_t
   use beamid_refusals, only: accept, exclude, in_range, positive, quoted, refuse
   use beamid_strings, only: to_text
   implicit none
   private

   public :: read_recording, read_score

   integer, parameter :: max_thin = 100000

contains

   subroutine read_recording(path, block, found, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(recording_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: file
      character(len=string_length) :: time_column, value_column
      real(wp) :: t_first, t_last, t_step, scale, offset, clip_low, clip_high, length, x_S
      type(window_t) :: window
      integer :: status, thin
      namelist /record/ file, t_first, t_last, t_step, scale, offset, time_column, value_column, &
         clip_low, clip_high, thin, length, x_S

      file = ''; t_first = -everything; t_last = everything; t_step = 0; scale = 1; offset = 0
      time_column = ''; value_column = ''; thin = 1; length = 0; x_S = 0
      clip_low = -everything; clip_high = everything
      read (block%text, nml=record, iostat=status)
      call accept(path, block, status, error)
      call checked_window(path, block, t_first, t_last, t_step, window, error)
      if (allocated(error)) return
      if (.not. abs(scale) > 0) then
         call refuse(path, block%line_of('scale'), 'record', 'scale', to_text(scale), &
            'a value other than 0', error)
         return
      end if
      if (block%has('file') .and. file == '') then
         call refuse(path, block%line_of('file'), 'record', 'file', '''''', &
            'the path of a record', error)
         return
      end if
      call checked_column(path, block, 'time_column', time_column, error)
      call checked_column(path, block, 'value_column', value_column, error)
      if (block%has('length')) call positive(path, block, 'length', length, error)
      if (block%has('x_S')) call positive(path, block, 'x_S', x_S, error)
      if (block%has('thin')) call in_range(path, block, 'thin', thin, 2, max_thin, error)
      if (block%has('thin')) call exclude(path, block, ['t_step'], 'beside thin', error)
      if (clip_low >= clip_high) call refuse(path, block%line_of('clip_high'), 'record', &
         'clip_high', to_text(clip_high), 'more than clip_low = '//to_text(clip_low), error)
      if (allocated(error)) return
      if (block%has('file')) found%path = join_path(directory_of(path), trim(file))
      found%window = window
      found%scale = scale
      found%offset = offset
      found%time_column = adjustl(time_column)
      found%value_column = adjustl(value_column)
      found%clip_low = clip_low
      found%clip_high = clip_high
      found%thin = thin
      found%length = length
      found%x_S = x_S
      found%line = block%line
   end subroutine read_recording

   !> A column has a name, and one that is not cut.
   subroutine checked_column(path, block, key, name, error)
      character(len=*), intent(in) :: path, key, name
      type(block_t), intent(in) :: block
      type(error_t), allocatable, intent(inout) :: error

      if (.not. block%has(key)) return
      if (name == '' .or. len_trim(adjustl(name)) > column_length) call refuse(path, &
         block%line_of(key), 'record', key, quoted(name), &
         'the name of a column, of at most '//to_text(column_length)// &
         ' characters, or its number', error)
   end subroutine checked_column

   !> The window over which a fit is scored.
   subroutine read_score(path, block, found, line, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(window_t), intent(inout) :: found
      integer, intent(inout) :: line
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: t_first, t_last, t_step
      type(window_t) :: window
      integer :: status
      namelist /score/ t_first, t_last, t_step

      t_first = -everything; t_last = everything; t_step = 0
      read (block%text, nml=score, iostat=status)
      call accept(path, block, status, error)
      call checked_window(path, block, t_first, t_last, t_step, window, error)
      if (allocated(error)) return
      found = window
      line = block%line
   end subroutine read_score

   !> A window whose ends are in order.
   subroutine checked_window(path, block, t_first, t_last, t_step, window, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      real(wp), intent(in) :: t_first, t_last, t_step
      type(window_t), intent(out) :: window
      type(error_t), allocatable, intent(inout) :: error

      if (block%has('t_step')) call positive(path, block, 't_step', t_step, error)
      if (allocated(error)) return
      window = window_t(t_first, t_last, t_step)
      if (t_last < t_first) call refuse(path, block%line_of('t_last'), trim(block%name), 't_last', &
         to_text(t_last), 'no less than t_first = '//to_text(t_first), error)
   end subroutine checked_window

end module beamid_record_groups
