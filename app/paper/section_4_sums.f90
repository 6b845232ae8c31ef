!> The six models of Section 4 side by side: sums of squares, frequencies, distances of responses.
module beamid_section_4_sums
   use beamid
   use beamid_report_lines, only: add_lines, columns
   use beamid_section_4_results, only: first_bending, results_t, table_4_4
   implicit none
   private

   public :: add_sums, warning, window

   !> Above everything that rests on the record.
   character(len=*), parameter :: warning = &
      'Reconstructed record: a consistency check, not an independent confirmation.'

contains

   !> Number of samples, first and last time.
   function window(samples) result(words)
      real(wp), intent(in) :: samples(:)
      character(len=:), allocatable :: words

      words = to_text(size(samples))//' at t = '//to_text(samples(1))//' to '// &
         to_text(samples(size(samples)))//' s'
   end function window

   !> The sums of squares, the undamped frequencies, and how far the responses are from one another,
   !> beside the differences of the printed sums.
   subroutine add_sums(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      type(text_t) :: frequencies, distances
      real(wp) :: difference
      integer :: k, last

      call text%line()
      call text%line('Sums of squared residuals, '//window(results%scored))
      call add_lines(text, [character(len=80) :: warning, &
         '   model       printed   at the paper''s estimates      at our estimates'])
      call add_lines(frequencies, [character(len=80) :: '', &
         'Undamped frequencies [Hz]; the paper''s are INDEPENDENT of any record', &
         '            at our estimates            at the paper''s', &
         '   model      hose     first    second      hose     first    second'])
      call add_lines(distances, [character(len=80) :: '', &
         'INDEPENDENT of any record: responses Y_k at the paper''s estimates, times of', &
         'the sums. For any record S_k and S_4.4 differ by |Y_k - Y_4.4|^2 to within', &
         'the bound 2 sqrt(S_4.4) |Y_k - Y_4.4|, S_4.4 = .70 as printed.', &
         '   model   |Y_k - Y_4.4|^2   printed S_k - S_4.4      apart by     bound'])
      do k = 1, size(results%entries)
         associate (e => results%entries(k), four => results%entries(table_4_4))
            if (.not. e%wanted) cycle
            call text%line('   '//left(e%name, 8)//columns([e%printed_sum], 11)// &
               columns([e%sum_at_paper], 14)//columns([e%sum_at_paper/e%printed_sum - 1], 13, &
               '#%')//columns([e%our_sum], 13)//columns([e%our_sum/e%printed_sum - 1], 9, '#%'))
            last = first_bending(e) + 1
            call frequencies%line('   '//left(e%name, 8)//hose(last)// &
               columns(e%our_frequencies(:last), 10, '#.4')//hose(last)// &
               columns(e%paper_frequencies(:last), 10, '#.4'))
            difference = e%printed_sum - four%printed_sum
            if (k /= table_4_4) call distances%line('   '//left(e%name, 8)// &
               columns([e%distance2], 15, '#.3')//columns([difference], 22, '#.3')// &
               columns([difference - e%distance2], 15, '#.3')//columns([e%bound], 10, '#.3'))
         end associate
      end do
      call text%add(frequencies%content())
      call text%line('   observed by the paper:   .75      7.5')
      if (results%entries(table_4_4)%wanted .and. count(results%entries%wanted) == 1) return
      call text%add(distances%content())
   end subroutine add_sums

   !> In place of the hose's own frequency, where there are but two: nothing.
   pure function hose(frequencies) result(words)
      integer, intent(in) :: frequencies
      character(len=:), allocatable :: words

      words = ''
      if (frequencies == 2) words = right('-', 10)
   end function hose

end module beamid_section_4_sums
