!> The groups of a case file that describe records: where they are, how they are calibrated, which
!> samples are wanted. Each procedure reads one group, checks every value, and leaves its argument
!> alone on error.
module beamid_record_groups
   use beamid_errors, only: error_t
   use beamid_files, only: directory_of, join_path
   use beamid_kinds, only: wp
   use beamid_namelist, only: block_t, string_length
   use beamid_records, only: everything, recording_t, window_t
   use beamid_refusals, only: accept, positive, refuse
   use beamid_strings, only: to_text
   implicit none
   private

   public :: read_recording, read_score

contains

   subroutine read_recording(path, block, found, error)
      character(len=*), intent(in) :: path
      type(block_t), intent(in) :: block
      type(recording_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      character(len=string_length) :: file
      real(wp) :: t_first, t_last, t_step, scale, offset
      type(window_t) :: window
      integer :: status
      namelist /record/ file, t_first, t_last, t_step, scale, offset

      file = ''; t_first = -everything; t_last = everything; t_step = 0; scale = 1; offset = 0
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
      if (block%has('file')) found%path = join_path(directory_of(path), trim(file))
      found%window = window
      found%scale = scale
      found%offset = offset
      found%line = block%line
   end subroutine read_recording

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
