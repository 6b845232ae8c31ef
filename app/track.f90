!> The command `track`: follows a parameter through a record, or through the samples that arrive on
!> standard input.
module beamid_track
   use beamid, only: case_t, error_t, needs_nothing, read_case, wp
   use beamid_commands, only: deliver, settings_t
   use beamid_errors, only: failure
   use beamid_outputs, only: output_t
   use beamid_refusals, only: refuse
   use beamid_sample_streams, only: new_sample_stream, sample_stream_t
   use beamid_standard_input, only: read_input
   use beamid_strings, only: to_text
   use beamid_terminal, only: new_progress, print_text, progress_t
   use beamid_track_reports, only: add_track, track_header, track_row, track_summary
   use beamid_tracking, only: append_rows, prepare_tracking, standard_input, take_samples, &
      track_record, tracked_t, tracker_t
   implicit none
   private

   public :: run_track

contains

   !> Runs `beamid track`.
   subroutine run_track(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(tracker_t) :: tracker
      type(tracked_t), allocatable :: rows(:)
      type(output_t) :: output
      type(progress_t) :: progress
      logical :: is_stream

      call read_case(settings%subject, needs_nothing, case, error)
      if (.not. allocated(error)) call prepare_tracking(case, tracker, error)
      if (allocated(error)) return
      is_stream = .false.
      if (allocated(case%recordings(1)%path)) is_stream = case%recordings(1)%path == standard_input
      if (is_stream) then
         call follow_input(case, tracker, rows, error)
      else
         progress = new_progress(settings%quiet)
         call track_record(case, tracker, rows, error, progress)
         call progress%finish()
      end if
      if (allocated(error)) return
      call add_track(output, trim(tracker%name), unit_of(case), rows)
      call deliver(output, track_summary(case, tracker, rows), settings, case%name, error, &
         case, is_printed=.not. is_stream)
      if (.not. allocated(error) .and. .not. any(rows%flag == '')) call failure(error, &
         case%path//': no window determines '//trim(tracker%name))
   end subroutine run_track

   !> Returns the unit of the parameter.
   function unit_of(case) result(unit)
      type(case_t), intent(in) :: case
      character(len=:), allocatable :: unit

      unit = trim(case%units%of_parameter(case%track%parameter))
   end function unit_of

   !> Follows the samples of standard input, and prints each row of the table at once.
   subroutine follow_input(case, tracker, rows, error)
      type(case_t), intent(in) :: case
      type(tracker_t), intent(inout) :: tracker
      type(tracked_t), allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(sample_stream_t) :: stream
      type(tracked_t), allocatable :: new(:)
      character(len=:), allocatable :: text
      real(wp), allocatable :: t(:), z(:)
      integer :: k, n

      associate (recording => case%recordings(1))
         stream = new_sample_stream('standard input', [recording%time_column, &
            recording%value_column], recording%rate)
      end associate
      call print_text(track_header//new_line('a'), error)
      if (allocated(error)) return
      allocate (rows(0))
      n = 0
      do
         call read_input(text, error)
         if (allocated(error)) return
         if (len(text) == 0) exit
         call stream%take(text, t, z, error)
         if (allocated(error)) return
         call take_samples(case, tracker, t, z, new, error)
         if (allocated(error)) return
         do k = 1, size(new)
            call print_text(track_row(trim(tracker%name), unit_of(case), new(k))// &
               new_line('a'), error)
            if (allocated(error)) return
         end do
         call append_rows(new, n, rows)
      end do
      rows = rows(:n)
      if (n == 0) call refuse(case%path, case%track%line, 'track window', &
         to_text(case%track%window), 'less than the length of standard input', error)
   end subroutine follow_input

end module beamid_track
