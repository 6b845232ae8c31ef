!> `beamid reproduce section-4` and its tables: the RPL experiment.
module beamid_section_4
   use beamid
   use beamid_commands, only: deliver, settings_t
   use beamid_outputs, only: output_t
   use beamid_paper, only: find_data
   use beamid_section_4_report, only: section_4_report
   use beamid_section_4_results, only: compute_section_4, entry_t, results_t, table_4_4
   use beamid_strings, only: full, to_text
   use beamid_terminal, only: new_progress, progress_t
   use beamid_texts, only: text_t
   implicit none
   private

   public :: run_section_4

contains

   !> beamid reproduce section-4, or one of table-4.2 to table-4.6: that part of it.
   subroutine run_section_4(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(results_t) :: results
      type(progress_t) :: progress
      type(output_t) :: output
      character(len=:), allocatable :: data
      logical, allocatable :: wanted(:)
      integer :: k

      call find_data(data, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call compute_section_4(data, results, error, progress)
      call progress%finish()
      if (allocated(error)) return
      wanted = [(settings%subject == 'section-4' .or. &
         settings%subject == 'table-'//results%entries(k)%name, k=1, size(results%entries))]
      call output%add('tables.csv', tables_csv(results%entries, wanted))
      call output%add('sums.csv', sums_csv(results%entries, wanted))
      call output%add('frequencies.csv', frequencies_csv(results%entries, wanted))
      call output%add('curves.csv', curves_csv(results, wanted))
      if (wanted(table_4_4)) call output%add('valley.csv', valley_csv(results%valley))
      call deliver(output, section_4_report(results, wanted), settings, settings%subject, error)
   end subroutine run_section_4

   !> What each table prints; nothing of ours where nothing is fitted.
   function tables_csv(entries, wanted) result(content)
      type(entry_t), intent(in) :: entries(:)
      logical, intent(in) :: wanted(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer, allocatable :: free(:)
      integer :: k, j

      call text%line('table,parameter,ours,paper')
      do k = 1, size(entries)
         if (.not. wanted(k)) cycle
         if (size(entries(k)%fits) > 0) then
            free = entries(k)%fits(size(entries(k)%fits))%free
            do j = 1, size(free)
               call text%line(entries(k)%name//','//trim(free_names(free(j)))//','// &
                  full(entries(k)%ours%get(free(j)))//','//full(entries(k)%paper%get(free(j))))
            end do
         else if (entries(k)%name == '4.5') then
            call text%line('4.5,m_T,,'//full(entries(k)%paper%m_T))
            call text%line('4.5,E,,'//full(entries(k)%paper%E))
         end if
      end do
      content = text%content()
   end function tables_csv

   !> Sums of squares over t = 0 to 5, and how far the responses are from that of Table 4.4.
   function sums_csv(entries, wanted) result(content)
      type(entry_t), intent(in) :: entries(:)
      logical, intent(in) :: wanted(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      call text%line('model,ours,paper,at_paper_estimates,distance2,paper_difference,bound')
      do k = 1, size(entries)
         associate (entry => entries(k))
            if (wanted(k)) call text%line(entry%name//','//full(entry%our_sum)//','// &
               full(entry%printed_sum)//','//full(entry%sum_at_paper)//','// &
               full(entry%distance2)//','// &
               full(entry%printed_sum - entries(table_4_4)%printed_sum)//','//full(entry%bound))
         end associate
      end do
      content = text%content()
   end function sums_csv

   !> Undamped frequencies at our estimates.
   function frequencies_csv(entries, wanted) result(content)
      type(entry_t), intent(in) :: entries(:)
      logical, intent(in) :: wanted(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k, mode

      call text%line('model,mode,frequency_hz')
      do k = 1, size(entries)
         if (.not. wanted(k)) cycle
         do mode = 1, size(entries(k)%our_frequencies)
            call text%line(entries(k)%name//','//to_text(mode)//','// &
               full(entries(k)%our_frequencies(mode)))
         end do
      end do
      content = text%content()
   end function frequencies_csv

   !> The whole record and the models at our estimates, acceleration by (4.1).
   function curves_csv(results, wanted) result(content)
      type(results_t), intent(in) :: results
      logical, intent(in) :: wanted(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k, i

      call text%line('model,t,measured,model_acceleration,residual')
      do k = 1, size(results%entries)
         if (.not. wanted(k)) cycle
         associate (entry => results%entries(k))
            do i = 1, size(results%t)
               call text%line(entry%name//','//full(results%t(i))//','//full(results%z(i))//','// &
                  full(entry%curve(i))//','//full(results%z(i) - entry%curve(i)))
            end do
         end associate
      end do
      content = text%content()
   end function curves_csv

   !> J along m_H with c_D = 0, c_H and k_H fitted at each place.
   function valley_csv(valley) result(content)
      type(stage_fit_t), intent(in) :: valley(:)
      character(len=:), allocatable :: content
      type(text_t) :: text
      integer :: k

      call text%line('m_H,c_H,k_H,J')
      do k = 1, size(valley)
         associate (structure => valley(k)%structure)
            call text%line(full(structure%m_H)//','//full(structure%c_H)//','// &
               full(structure%k_H)//','//full(valley(k)%fit%J))
         end associate
      end do
      content = text%content()
   end function valley_csv

end module beamid_section_4
