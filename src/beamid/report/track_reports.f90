!> Reports of the command `track`: the table track.csv, row by row or as a whole, and the summary.
module beamid_track_reports
   use beamid_case_files, only: case_t
   use beamid_kinds, only: wp
   use beamid_lines, only: filled, unit_suffix
   use beamid_outputs, only: output_t
   use beamid_sorting, only: median
   use beamid_strings, only: full, to_text
   use beamid_texts, only: text_t
   use beamid_tracked_windows, only: track_flags, tracked_t
   use beamid_tracker, only: tracker_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: add_track, track_header, track_row, track_summary

   character(len=*), parameter :: track_header = &
      't_first,t_last,parameter,estimate,lower95,upper95,latency_ms,flag,misfit,unit'

contains

   !> Returns a row of track.csv.
   !>
   !> name, unit  of the parameter
   function track_row(name, unit, row) result(line)
      character(len=*), intent(in) :: name, unit
      type(tracked_t), intent(in) :: row
      character(len=:), allocatable :: line

      line = full(row%first)//','//full(row%last)//','//trim(name)//','//end_of(row%estimate)// &
         ','//end_of(row%lower)//','//end_of(row%upper)//','// &
         full(anint(1e4_wp*row%milliseconds)/1e4_wp)//','//trim(row%flag)//','// &
         full(anint(1e6_wp*row%misfit)/1e6_wp)//','//unit
   end function track_row

   !> Returns a number, 'inf' if it is infinite, or nothing if there is no bound.
   function end_of(value) result(text)
      real(wp), intent(in) :: value
      character(len=:), allocatable :: text

      text = ''
      if (abs(value) < unbounded) text = full(value)
      if (value > unbounded) text = 'inf'
   end function end_of

   !> Adds track.csv.
   subroutine add_track(output, name, unit, rows)
      type(output_t), intent(inout) :: output
      character(len=*), intent(in) :: name, unit
      type(tracked_t), intent(in) :: rows(:)
      type(text_t) :: table
      integer :: k

      call table%line(track_header)
      do k = 1, size(rows)
         call table%line(track_row(name, unit, rows(k)))
      end do
      call output%add('track.csv', table%content())
   end subroutine add_track

   !> Returns the summary: windows, flags, range of the parameter, and processor time.
   !>
   !> rows  one or more
   function track_summary(case, tracker, rows) result(summary)
      type(case_t), intent(in) :: case
      type(tracker_t), intent(in) :: tracker
      type(tracked_t), intent(in) :: rows(:)
      character(len=:), allocatable :: summary
      character(len=*), parameter :: reasons(3) = [character(len=88) :: &
         ' windows are flagged ''moving'': one set of parameters does not explain them', &
         ' windows are flagged ''unseen'': the motion is too small to determine the parameter', &
         ' windows are flagged ''gap'': they have too few samples']
      type(text_t) :: text
      logical :: is_clear(size(rows))
      character(len=:), allocatable :: name
      integer :: k, n

      name = trim(tracker%name)
      is_clear = rows%flag == ''
      call text%line(case%name//': '//trim(name)//' in '//to_text(size(rows))//' windows of '// &
         to_text(case%track%window)//unit_suffix(case%units%time)//', from t = '// &
         to_text(rows(1)%first)//' to '//to_text(rows(size(rows))%last)// &
         unit_suffix(case%units%time))
      do k = 1, size(reasons)
         n = count(rows%flag == track_flags(1 + k))
         if (n > 0) call text%line(to_text(n)//trim(reasons(k)))
      end do
      if (.not. any(is_clear)) then
         call text%line('no window determines '//trim(name))
      else
         call text%line(trim(name)//' in the '//to_text(count(is_clear))// &
            ' windows without a flag: '//filled('# to #', [minval(rows%estimate, mask=is_clear), &
            maxval(rows%estimate, mask=is_clear)])// &
            unit_suffix(case%units%of_parameter(case%track%parameter)))
         call text%line('half width of the 95 % intervals, median: '//to_text(median(pack( &
            (rows%upper - rows%lower)/2, is_clear)))//unit_suffix(case%units%of_parameter( &
            case%track%parameter)))
      end if
      call text%line('mesh: '//to_text(tracker%elements)//' elements; the '// &
         'intervals allow for a relative error of the natural frequencies of '// &
         to_text(tracker%mesh_error))
      if (.not. case%track%frequency_error > 0) call text%line('the intervals contain no '// &
         'error of the model; a calibration shows it (frequency_error of &track)')
      call text%line('processor time of a window, median: '//to_text(median( &
         rows%milliseconds))//' ms')
      summary = text%content()
   end function track_summary

end module beamid_track_reports
