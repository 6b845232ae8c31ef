!> Section 4 of the paper in words and tables: ours beside the paper's, and what the statistics say.
module beamid_section_4_report
   use beamid
   use beamid_paper, only: percent
   use beamid_section_4_results, only: basis, entry_t, results_t, table_4_2, table_4_3, &
      table_4_4, table_4_5, table_4_6
   use beamid_section_4_sums, only: add_distances, add_frequencies, add_sums, warning, window
   use beamid_section_4_valley, only: add_stages, add_valley
   use beamid_statistics, only: nested_test, undetermined
   use beamid_strings, only: fixed, to_text
   use beamid_texts, only: right, text_t
   implicit none
   private

   public :: section_4_report

contains

   !> The report, or those parts of it that belong to the tables wanted.
   function section_4_report(results, wanted) result(content)
      type(results_t), intent(in) :: results
      logical, intent(in) :: wanted(:)
      character(len=:), allocatable :: content
      type(text_t) :: text

      call add_head(text, results)
      if (wanted(table_4_2)) call add_table_4_2(text, results)
      if (wanted(table_4_3)) call add_table_4_3(text, results)
      if (wanted(table_4_4)) call add_table_4_4(text, results)
      if (wanted(table_4_5)) call add_table_4_5(text, results)
      if (wanted(table_4_6)) call add_table_4_6(text, results)
      call add_sums(text, results, wanted)
      call add_frequencies(text, results, wanted)
      call add_distances(text, results, wanted)
      content = text%content()
   end function section_4_report

   !> What the record is, and what is computed from it.
   subroutine add_head(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results

      call text%line('Section 4 of NASA CR-178199: the RPL experiment')
      call text%line()
      call text%line('NOT AN INDEPENDENT CONFIRMATION. The measurement was never printed as')
      call text%line('numbers; data/rpl_reconstructed.csv is a record rebuilt from the numbers')
      call text%line('that the paper does print, so as to have sums of squares and minima near the')
      call text%line('printed ones. What rests on it says that those numbers can go together, no')
      call text%line('more. Only what is marked INDEPENDENT does without any record.')
      call text%line()
      call text%line('J: squared residuals over the samples of the fit, '// &
         window(results%samples)//'; sum: '//window(results%scored)//'.')
      call text%line('N = 4 cubics, exact responses, acceleration by (4.1) with Delta = .1 s; '// &
         'ft, lb, s, slug.')
      call text%line('Rows "paper": J and sum as computed at the paper''s estimates.')
   end subroutine add_head

   subroutine add_table_4_2(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results

      associate (entry => results%entries(table_4_2))
         call add_table(text, entry, 'Table 4.2: m_H and k_H, c_D = c_H = 0')
         call add_start(text, entry)
         call add_nested(text, 'the hose (none, or m_H and k_H)', results%entries(basis)%our_J, &
            entry%our_J, size(results%samples), 2)
         call text%line('   (m_H = 0 is an edge of what is possible: chi-square is but a guide)')
      end associate
   end subroutine add_table_4_2

   !> Where the search began; the text prints no numbers, only how they were come by.
   subroutine add_start(text, entry)
      type(text_t), intent(inout) :: text
      type(entry_t), intent(in) :: entry

      associate (start => entry%fits(1)%fit%start, ours => entry%ours, paper => entry%paper)
         call text%line(' - started from m_H = '//to_text(start(1))//', k_H = '// &
            to_text(start(2))//', which have a mode at the observed .75 Hz (see the case')
         call text%line('   file); k_H/m_H is '//trim(adjustl(fixed(start(2)/start(1), 8, 2)))// &
            ' at the start, '//trim(adjustl(fixed(ours%k_H/ours%m_H, 8, 2)))//' at the end, '// &
            trim(adjustl(fixed(paper%k_H/paper%m_H, 8, 2)))//' in the paper''s table')
         call text%line(' - INDEPENDENT: no m_H and k_H have both observed frequencies. A hose')
         call text%line('   that raises the first from .71 to .75 Hz is a spring to every higher')
         call text%line('   mode: the second stays above 8.39 Hz, and with this E and m_T the')
         call text%line('   observed 7.5 Hz is out of reach')
      end associate
   end subroutine add_start

   subroutine add_table_4_3(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results

      associate (entry => results%entries(table_4_3))
         call add_table(text, entry, 'Table 4.3: c_H alone from zero, then m_H, c_H and k_H')
         call add_nested(text, 'c_H (Table 4.2 within Table 4.3)', &
            results%entries(table_4_2)%our_J, min(entry%our_J, &
            results%entries(table_4_2)%our_J), size(results%samples), 1)
      end associate
   end subroutine add_table_4_3

   subroutine add_table_4_4(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      real(wp) :: without, with

      associate (entry => results%entries(table_4_4))
         call add_table(text, entry, 'Table 4.4: c_D alone from zero, then all four parameters')
         call text%line(' - c_D = '//to_text(entry%paper%c_D)//' or 0 at the paper''s '// &
            'estimates: J = '//to_text(entry%J_at_paper)//' or '//to_text(results%J_without_c_D))
         call text%line('   INDEPENDENT: the two responses are |Y - Y_0|^2 = '// &
            to_text(results%distance2_without_c_D)//' apart, t = 0 to 5')
         call add_stages(text, entry)
         call add_valley(text, results, without, with)
         call add_nested(text, 'c_D (lowest J with c_D = 0 and of all)', without, &
            with, size(results%samples), 1)
      end associate
   end subroutine add_table_4_4

   subroutine add_table_4_5(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results

      associate (entry => results%entries(table_4_5))
         call text%line()
         call text%line('Table 4.5: Floyd''s m_T = '//to_text(entry%paper%m_T)//' and E = '// &
            to_text(entry%paper%E)//', nothing fitted')
         call text%line(warning)
         call text%line(' - sum '//to_text(entry%our_sum)//', paper '// &
            to_text(entry%printed_sum)//' ('//percent(entry%our_sum/entry%printed_sum - 1)// &
            '); J = '//to_text(entry%our_J))
         call text%line(' - INDEPENDENT: its first frequency is '// &
            fixed(entry%paper_frequencies(1), 6, 4)//' Hz, the observed one .75')
      end associate
   end subroutine add_table_4_5

   subroutine add_table_4_6(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results

      associate (entry => results%entries(table_4_6), floyd => results%entries(table_4_5))
         call add_table(text, entry, 'Table 4.6: m_T and E, no hose, no damping')
         call text%line(' - the paper''s closing claim: fitted m_T and E beat matched modes, '// &
            'sum '// &
            to_text(floyd%printed_sum)//' against '//to_text(entry%printed_sum)//'.')
         if (entry%our_sum < floyd%our_sum) then
            call text%line('   It holds here: '//to_text(floyd%our_sum)//' against '// &
               to_text(entry%our_sum)//'.')
         else
            call text%line('   It does not hold here: '//to_text(floyd%our_sum)//' against '// &
               to_text(entry%our_sum)//'.')
         end if
      end associate
   end subroutine add_table_4_6

   !> Estimates, J and sum: ours, the paper's, the relative difference; what the record determines.
   subroutine add_table(text, entry, title)
      type(text_t), intent(inout) :: text
      type(entry_t), intent(in) :: entry
      character(len=*), intent(in) :: title
      character(len=:), allocatable :: head, ours, paper, differs
      integer :: k

      associate (fit => entry%fits(size(entry%fits)))
         head = repeat(' ', 12)
         ours = '   ours     '
         paper = '   paper    '
         differs = '   differs  '
         do k = 1, size(fit%free)
            associate (a => entry%ours%get(fit%free(k)), b => entry%paper%get(fit%free(k)))
               head = head//right(trim(free_names(fit%free(k))), 12)
               ours = ours//right(to_text(a), 12)
               paper = paper//right(to_text(b), 12)
               differs = differs//right(percent(a/b - 1), 12)
            end associate
         end do
         call text%line()
         call text%line(title)
         call text%line(warning)
         call text%line(head//right('J', 12)//right('sum', 12)//right('printed', 10))
         call text%line(ours//right(to_text(entry%our_J), 12)//right(to_text(entry%our_sum), 12))
         call text%line(paper//right(to_text(entry%J_at_paper), 12)// &
            right(to_text(entry%sum_at_paper), 12)//right(to_text(entry%printed_sum), 10))
         call text%line(differs//right(percent(entry%our_J/entry%J_at_paper - 1), 12)// &
            right(percent(entry%our_sum/entry%sum_at_paper - 1), 12)// &
            right(percent(entry%our_sum/entry%printed_sum - 1), 10))
         call add_determined(text, fit)
      end associate
   end subroutine add_table

   !> Intervals, and a sentence for whatever the record does not determine.
   subroutine add_determined(text, fit)
      type(text_t), intent(inout) :: text
      type(stage_fit_t), intent(in) :: fit
      character(len=len(free_names)) :: names(size(fit%free))
      character(len=512), allocatable :: sentences(:)
      character(len=:), allocatable :: verdict
      integer :: k

      names = free_names(fit%free)
      associate (s => fit%statistics, q => fit%fit%estimate)
         do k = 1, size(q)
            verdict = ' is not determined'
            if (s%determined(k)) verdict = ' is determined'
            call text%line(' - '//trim(names(k))//verdict//': 95 % interval '//to_text(q(k))// &
               ' +- '//to_text(s%half_width(k)))
         end do
         sentences = undetermined(s, names, [fit%quantities%scale], fit%jacobian)
         do k = 1, size(sentences)
            call text%line(' - '//trim(sentences(k)))
         end do
      end associate
      if (.not. fit%check%white) call text%line(' - the residuals are NOT white noise, the '// &
         'intervals too narrow: as good as '// &
         trim(adjustl(fixed(fit%statistics%effective, 8, 1)))//' samples')
   end subroutine add_determined

   !> Banks and Fitzpatrick's test, in words.
   subroutine add_nested(text, what, J_restricted, J_full, samples, restrictions)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: J_restricted, J_full
      integer, intent(in) :: samples, restrictions
      character(len=:), allocatable :: verdict
      real(wp) :: U, probability

      call nested_test(J_restricted, J_full, samples, restrictions, U, probability)
      verdict = 'the record does not ask for it'
      if (probability < 0.05_wp) verdict = 'the record asks for it'
      call text%line(' - nested-model test of '//what//': J_0 = '//to_text(J_restricted)// &
         ', J = '//to_text(J_full)//',')
      call text%line('   U = '//to_text(samples)//' (J_0 - J)/J = '//to_text(U)// &
         ', probability '//to_text(probability)//': '//verdict)
   end subroutine add_nested

end module beamid_section_4_report
