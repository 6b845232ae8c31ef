!> Fits in consecutive windows of the records: a part of the summary, and the table windows.csv.
module beamid_window_reports
   use beamid_drifts, only: drift_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_lines, only: columns, known, limit
   use beamid_outputs, only: output_t
   use beamid_parameters, only: as_named
   use beamid_strings, only: full, to_text
   use beamid_texts, only: left, right, text_t
   use beamid_unknowns, only: quantity_t
   use beamid_window_fits, only: window_fit_t
   implicit none
   private

   public :: window_summary, add_window_table, add_drifts

contains

   !> Adds a sentence on the parameters that are not constant during the motion, if there are any.
   !>
   !> fit  of the last stage to the whole records
   subroutine add_drifts(text, fit, drift)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      type(drift_t), intent(in) :: drift
      character(len=:), allocatable :: names
      integer :: k

      if (drift%windows == 0) return
      names = ''
      do k = 1, size(drift%is_significant)
         if (.not. drift%is_significant(k)) cycle
         names = names//', '//trim(fit%quantities(k)%name)
         names = names//' (scatter '//to_text(anint(10*drift%scatter(k)%ratio)/10)// &
            ' times its standard errors)'
      end do
      if (names /= '') call text%line('not constant during the motion, by a test in '// &
         to_text(drift%windows)//' windows: '//names(3:)//'; the intervals allow for that')
   end subroutine add_drifts

   !> Returns the estimates in every window, and the scatter beside the scatter expected from the
   !> standard errors.
   !>
   !> fit  of the last stage to the whole records
   function window_summary(fit, windows, drift) result(content)
      type(stage_fit_t), intent(in) :: fit
      type(window_fit_t), intent(in) :: windows(:)
      type(drift_t), intent(in) :: drift
      character(len=:), allocatable :: content
      !> Number of windows side by side.
      integer, parameter :: most = 6
      type(text_t) :: text
      integer :: first, i, k, last

      do first = 1, size(windows), most
         last = min(first + most - 1, size(windows))
         call add_block(first, last)
      end do
      call text%line(left('parameter', 10)//right('scatter')//right('expected'))
      do k = 1, size(fit%free)
         call text%line(left(trim(fit%quantities(k)%searched_name()), 10)// &
            columns([drift%scatter(k)%spread, drift%scatter(k)%expected], 14))
      end do
      do i = 1, size(windows)
         if (allocated(windows(i)%error)) call text%line('no fit in window '//to_text(i)//': '// &
            windows(i)%error%message)
      end do
      if (.not. any(drift%is_significant)) call text%line( &
         'no parameter changes between the windows by more than its standard errors explain')
      content = text%content()

   contains

      !> Adds the windows first to last.
      subroutine add_block(first, last)
         integer, intent(in) :: first, last
         character(len=:), allocatable :: line
         integer :: i, k

         call text%line()
         line = left('window', 10)
         do i = first, last
            line = line//right(to_text(i))
         end do
         call text%line(line)
         line = left('from t =', 10)
         do i = first, last
            line = line//columns(windows(i)%first(:1), 14)
         end do
         call text%line(line)
         do k = 1, size(fit%free)
            line = left(trim(fit%quantities(k)%searched_name()), 10)
            do i = first, last
               if (allocated(windows(i)%error)) then
                  line = line//right('-')
               else
                  line = line//columns(windows(i)%estimate(k:k), 14)
               end if
            end do
            call text%line(line)
         end do
      end subroutine add_block

   end function window_summary

   !> Adds windows.csv. A parameter that the records share has a row for each record, with the
   !> record's times.
   subroutine add_window_table(output, fit, windows)
      type(output_t), intent(inout) :: output
      type(stage_fit_t), intent(in) :: fit
      type(window_fit_t), intent(in) :: windows(:)
      type(text_t) :: table
      type(quantity_t) :: q
      real(wp) :: limits(3)
      integer :: i, k, r

      call table%line('record,window,t_first,t_last,parameter,estimate,std_error')
      do r = 1, size(fit%scenario%structures)
         do i = 1, size(windows)
            if (allocated(windows(i)%error)) cycle
            do k = 1, size(fit%free)
               q = fit%quantities(k)
               if (all(q%record /= [0, r])) cycle
               associate (w => windows(i))
                  q%searched = w%estimate(k)
                  q%value = as_named(q%parameter, w%estimate(k))
                  limits = q%limits(w%std_error(k), 0.0_wp)
                  call table%line(to_text(r)//','//to_text(i)//','//full(w%first(r))//','// &
                     full(w%last(r))//','//trim(q%name)//','//limit(q%value)//','// &
                     known(limits(1)))
               end associate
            end do
         end do
      end do
      call output%add('windows.csv', table%content())
   end subroutine add_window_table

end module beamid_window_reports
