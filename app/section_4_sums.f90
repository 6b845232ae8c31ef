!> The six models of Section 4 side by side: sums of squares, frequencies, distances of responses.
module beamid_section_4_sums
   use beamid
   use beamid_paper, only: percent
   use beamid_section_4_results, only: first_bending, results_t, table_4_4
   use beamid_strings, only: fixed, to_text
   use beamid_texts, only: left, right, text_t
   implicit none
   private

   public :: add_sums, add_frequencies, add_distances, warning, window

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

   !> The six sums of squares.
   subroutine add_sums(text, results, wanted)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      logical, intent(in) :: wanted(:)
      integer :: k

      call text%line()
      call text%line('Sums of squared residuals, '//window(results%scored))
      call text%line(warning)
      call text%line('   model       printed   at the paper''s estimates      at our estimates')
      do k = 1, size(wanted)
         associate (e => results%entries(k))
            if (.not. wanted(k)) cycle
            call text%line('   '//left(e%name, 8)//right(to_text(e%printed_sum), 11)// &
               right(to_text(e%sum_at_paper), 14)// &
               right(percent(e%sum_at_paper/e%printed_sum - 1), 13)// &
               right(to_text(e%our_sum), 13)//right(percent(e%our_sum/e%printed_sum - 1), 9))
         end associate
      end do
   end subroutine add_sums

   !> Undamped frequencies of the models.
   subroutine add_frequencies(text, results, wanted)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      logical, intent(in) :: wanted(:)
      character(len=:), allocatable :: ours, paper
      integer :: k, mode

      call text%line()
      call text%line('Undamped frequencies [Hz]; the paper''s are INDEPENDENT of any record')
      call text%line('            at our estimates            at the paper''s')
      call text%line('   model      hose     first    second      hose     first    second')
      do k = 1, size(wanted)
         if (.not. wanted(k)) cycle
         associate (e => results%entries(k))
            ours = ''
            paper = ''
            if (first_bending(e) == 1) then
               ours = right('-', 10)
               paper = right('-', 10)
            end if
            do mode = 1, first_bending(e) + 1
               ours = ours//fixed(e%our_frequencies(mode), 10, 4)
               paper = paper//fixed(e%paper_frequencies(mode), 10, 4)
            end do
            call text%line('   '//left(e%name, 8)//ours//paper)
         end associate
      end do
      call text%line('   observed by the paper:   .75      7.5')
   end subroutine add_frequencies

   !> How far the responses are from one another, beside the differences of the printed sums.
   subroutine add_distances(text, results, wanted)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      logical, intent(in) :: wanted(:)
      real(wp) :: difference
      integer :: k

      if (wanted(table_4_4) .and. count(wanted) == 1) return
      call text%line()
      call text%line('INDEPENDENT of any record: responses Y_k at the paper''s estimates, times of')
      call text%line('the sums. For any record S_k and S_4.4 differ by |Y_k - Y_4.4|^2 to within')
      call text%line('the bound 2 sqrt(S_4.4) |Y_k - Y_4.4|, S_4.4 = .70 as printed.')
      call text%line('   model   |Y_k - Y_4.4|^2   printed S_k - S_4.4      apart by     bound')
      do k = 1, size(wanted)
         associate (e => results%entries(k))
            if (.not. wanted(k) .or. k == table_4_4) cycle
            difference = e%printed_sum - results%entries(table_4_4)%printed_sum
            call text%line('   '//left(e%name, 8)//fixed(e%distance2, 15, 3)// &
               fixed(difference, 22, 3)//fixed(difference - e%distance2, 15, 3)// &
               fixed(e%bound, 10, 3))
         end associate
      end do
   end subroutine add_distances

end module beamid_section_4_sums
