!> Follows a parameter as the group &track of a case asks for, in a record or in samples that arrive
!> one after the other.
module beamid_tracking
   use beamid_case_checks, only: check_needs, needs_track
   use beamid_case_files, only: case_t
   use beamid_cases, only: describe_experiment
   use beamid_errors, only: error_t, locate
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_records, only: read_record
   use beamid_refusals, only: refuse
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient
   use beamid_tracked_windows, only: append_rows, tracked_t
   use beamid_tracker, only: new_tracker, tracker_t
   implicit none
   private

   public :: append_rows, prepare_tracking, track_record, take_samples, standard_input, tracked_t, &
      tracker_t

   !> Name of a record that is read from standard input.
   character(len=*), parameter :: standard_input = '-'
   !> Largest window in units of the hop.
   integer, parameter :: most_windows = 100000

contains

   !> Refuses a case that `track` does not support.
   subroutine check_tracking(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(out) :: error

      if (.not. allocated(case%track)) then
         call refuse(case%path, 0, 'track', 'no such group', 'one', error)
         return
      end if
      call check_needs(case, needs_track, error)
      if (allocated(error)) return
      associate (track => case%track, recording => case%recordings(1), &
         stage => case%stages(size(case%stages)), line => case%stage_lines(size(case%stages)))
         if (track%hop < track%window/most_windows) then
            call refuse(case%path, track%line, 'track hop', to_text(track%hop), &
               'at least window/'//to_text(most_windows), error)
         else if (size(case%recordings) /= 1) then
            call refuse(case%path, 0, 'record', to_text(size(case%recordings))//' such groups', &
               'one', error)
         else if (recording%kind /= 'time') then
            call refuse(case%path, recording%line, 'record kind', ''''//trim(recording%kind)// &
               '''', '''time''', error)
         else if (recording%thin > 1 .or. allocated(recording%window%t_step)) then
            call refuse(case%path, recording%line, 'record', 'thin or t_step', &
               'neither, because track uses every sample', error)
         else if (.not. any(case%excitations%modes > 0)) then
            call refuse(case%path, 0, 'excitation kind', 'no free decay', 'kind=''free''', error)
         else if (.not. any(stage%free == track%parameter)) then
            call refuse(case%path, track%line, 'track parameter', 'a parameter that is fixed', &
               'one that is free in the last &stage', error)
         else if (any(is_coefficient(stage%free))) then
            call refuse(case%path, line, 'stage free', 'E(x) or c_D(x)', &
               'single parameters, because a window cannot determine a function', error)
         end if
      end associate
   end subroutine check_tracking

   !> Makes the tracker of a case, on its last mesh or on refinements of it.
   !>
   !> error  the case cannot be tracked; the model cannot be computed
   subroutine prepare_tracking(case, tracker, error)
      type(case_t), intent(in) :: case
      type(tracker_t), intent(out) :: tracker
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: experiment

      call check_tracking(case, error)
      if (allocated(error)) return
      call describe_experiment(case, 1, experiment, error)
      if (allocated(error)) return
      ! Each window replaces these samples.
      experiment%samples = [0.0_wp, 1.0_wp]
      experiment%measured = [0.0_wp, 0.0_wp]
      associate (stage => case%stages(size(case%stages)))
         call new_tracker(case%model, case%meshes(size(case%meshes)), case%refines, experiment, &
            stage, case%track, tracker, error)
      end associate
      call locate(error, case%path)
   end subroutine prepare_tracking

   !> Follows the parameter through the file of the record.
   !>
   !> rows   result of each window
   !> error  the record cannot be read, or is shorter than a window; interrupted
   subroutine track_record(case, tracker, rows, error, monitor)
      type(case_t), intent(in) :: case
      type(tracker_t), intent(inout) :: tracker
      type(tracked_t), allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), allocatable :: t(:), z(:)
      type(tracked_t), allocatable :: new(:)
      integer :: first, last, n

      associate (recording => case%recordings(1))
         if (.not. (allocated(recording%path) .or. allocated(recording%t))) call refuse( &
            case%path, recording%line, 'record file', 'nothing', 'the path of a record, or ''-''', &
            error)
         if (.not. allocated(error)) call read_record(recording, t, z, error)
         if (allocated(error)) return
      end associate
      call keep_wanted(case, t, z)
      allocate (rows(0))
      n = 0
      do first = 1, size(t), 1000
         last = min(first + 999, size(t))
         call tracker%take(t(first:last), z(first:last), new, error)
         if (allocated(error)) return
         call append_rows(new, n, rows)
         if (present(monitor)) call monitor%advanced(last, size(t), 'samples')
      end do
      rows = rows(:n)
      if (n == 0) call refuse(case%path, case%track%line, 'track window', &
         to_text(case%track%window), 'less than the length of the record', error)
   end subroutine track_record

   !> Follows the parameter through samples that have arrived.
   !>
   !> t, z   (m) times [time] and values in the unit of the record
   !> rows   result of each window that these samples complete
   !> error  interrupted
   subroutine take_samples(case, tracker, t, z, rows, error)
      type(case_t), intent(in) :: case
      type(tracker_t), intent(inout) :: tracker
      real(wp), intent(in) :: t(:), z(:)
      type(tracked_t), allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: times(:), values(:)

      times = t
      values = case%recordings(1)%scale*(z - case%recordings(1)%offset)
      call keep_wanted(case, times, values)
      call tracker%take(times, values, rows, error)
   end subroutine take_samples

   !> Keeps the samples between t_first and t_last of the record and within its limits.
   !>
   !> t, z  times [time] and accelerations
   subroutine keep_wanted(case, t, z)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(inout) :: t(:), z(:)
      logical, allocatable :: is_wanted(:)

      allocate (is_wanted(size(t)), source=.true.)
      associate (r => case%recordings(1))
         if (allocated(r%window%t_first)) is_wanted = is_wanted .and. t >= r%window%t_first
         if (allocated(r%window%t_last)) is_wanted = is_wanted .and. t <= r%window%t_last
         if (allocated(r%clip_low)) is_wanted = is_wanted .and. z/r%scale + r%offset > r%clip_low
         if (allocated(r%clip_high)) is_wanted = is_wanted .and. z/r%scale + r%offset < r%clip_high
      end associate
      if (all(is_wanted)) return
      t = pack(t, is_wanted)
      z = pack(z, is_wanted)
   end subroutine keep_wanted

end module beamid_tracking
