!> `beamid reproduce section-4` and `table-4.2` to `table-4.6`: writes report and tables of the RPL
!> experiment, which `beamid_section_4_results` computes.
module beamid_section_4
   use beamid
   use beamid_lines, only: csv_row
   use beamid_outputs, only: output_t
   use beamid_section_4_report, only: add_report
   use beamid_section_4_results, only: compute_section_4, results_t, table_4_4, table_4_5
   use beamid_strings, only: full, to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: reproduce_section_4

contains

   !> Reproduces Section 4 or one of its tables.
   !>
   !> data     folder of the case files
   !> part     'section-4', or 'table-4.2' to 'table-4.6'
   !> output   on return with the tables
   !> summary  on return with the report
   !> error    a file that cannot be read, or a computation that fails
   !> monitor  is told of the progress of the fits
   subroutine reproduce_section_4(data, part, output, summary, error, monitor)
      character(len=*), intent(in) :: data, part
      type(output_t), intent(inout) :: output
      type(text_t), intent(inout) :: summary
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout) :: monitor
      type(results_t) :: results
      integer :: k

      call compute_section_4(data, results, error, monitor)
      if (allocated(error)) return
      do k = 1, size(results%entries)
         results%entries(k)%wanted = part == 'section-4' .or. &
            part == 'table-'//results%entries(k)%name
      end do
      call add_report(summary, results)
      call add_numbers(output, results)
   end subroutine reproduce_section_4

   !> Writes the tables of the models that are wanted:
   !>
   !> tables.csv       the paper's parameters and our estimates, empty where nothing is fitted
   !> sums.csv         sums of squared residuals over t = 0 to 5, and squared distances of the
   !>                  responses from that of Table 4.4
   !> frequencies.csv  undamped natural frequencies at our estimates
   !> curves.csv       the whole record and the models at our estimates, acceleration by (4.1)
   !> valley.csv       only with Table 4.4: J along m_H for c_D = 0, with c_H and k_H fitted
   subroutine add_numbers(output, results)
      type(output_t), intent(inout) :: output
      type(results_t), intent(in) :: results
      type(text_t) :: tables, sums, frequencies, curves, valley
      integer, allocatable :: free(:)
      integer :: k, j

      call tables%line('table,parameter,ours,paper')
      call sums%line('model,ours,paper,at_paper_estimates,distance2,paper_difference,bound')
      call frequencies%line('model,mode,frequency_hz')
      call curves%line('model,t,measured,model_acceleration,residual')
      do k = 1, size(results%entries)
         associate (e => results%entries(k), printed => results%entries%printed_sum)
            if (.not. e%wanted) cycle
            if (size(e%fits) > 0) then
               free = e%fits(size(e%fits))%free
               do j = 1, size(free)
                  call tables%line(csv_row(e%name//','//trim(free_names(free(j))), &
                     [e%ours%get(free(j)), e%paper%get(free(j))]))
               end do
            else if (k == table_4_5) then
               call tables%line(csv_row('4.5,m_T,', [e%paper%m_T]))
               call tables%line(csv_row('4.5,E,', [e%paper%E]))
            end if
            call sums%line(csv_row(e%name, [e%our_sum, e%printed_sum, e%sum_at_paper, &
               e%distance2, e%printed_sum - printed(table_4_4), e%bound]))
            do j = 1, size(e%our_frequencies)
               call frequencies%line(csv_row(e%name//','//to_text(j), e%our_frequencies(j:j)))
            end do
            do j = 1, size(results%t)
               call curves%line(csv_row(e%name, [results%t(j), results%z(j), e%curve(j), &
                  results%z(j) - e%curve(j)]))
            end do
         end associate
      end do
      call output%add('tables.csv', tables%content())
      call output%add('sums.csv', sums%content())
      call output%add('frequencies.csv', frequencies%content())
      call output%add('curves.csv', curves%content())
      if (.not. results%entries(table_4_4)%wanted) return
      call valley%line('m_H,c_H,k_H,J')
      do k = 1, size(results%valley)
         associate (q => results%valley(k)%scenario%structures(1))
            call valley%line(csv_row(full(q%m_H), [q%c_H, q%k_H, results%valley(k)%fit%J]))
         end associate
      end do
      call output%add('valley.csv', valley%content())
   end subroutine add_numbers

end module beamid_section_4
