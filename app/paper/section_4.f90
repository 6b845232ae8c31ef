!> `beamid reproduce section-4` and `table-4.2` to `table-4.6`: writes report and tables of the RPL
!> experiment: our estimates beside the paper's, with statistics. The numbers come from
!> `beamid_section_4_results` and `beamid_section_4_valley`.
module beamid_section_4
   use beamid
   use beamid_criteria, only: nested_test
   use beamid_errors, only: locate
   use beamid_lines, only: add_lines, columns, csv_row, filled
   use beamid_outputs, only: output_t
   use beamid_section_4_results, only: basis, compute_section_4, entry_t, first_bending, &
      model_names, results_t, table_4_2, table_4_3, table_4_4, table_4_5, table_4_6
   use beamid_section_4_valley, only: add_search, explore_valley
   use beamid_strings, only: full, to_text
   use beamid_texts, only: left, right, text_t
   use beamid_undetermined_directions, only: undetermined
   implicit none
   private

   public :: reproduce_section_4

   !> Titles of the tables; Table 4.5 has its own text.
   character(len=*), parameter :: titles(table_4_2:table_4_6) = [character(len=60) :: &
      'Table 4.2: m_H and k_H, c_D = c_H = 0', &
      'Table 4.3: c_H alone from zero, then m_H, c_H and k_H', &
      'Table 4.4: c_D alone from zero, then all four parameters', '', &
      'Table 4.6: m_T and E, no hose, no damping']

   !> Warning above all results that depend on the record.
   character(len=*), parameter :: warning = &
      'Reconstructed record: a consistency check, not an independent confirmation.'

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
      type(case_t) :: cases(size(model_names))
      type(results_t) :: results
      integer :: k

      call compute_section_4(data, cases, results, error, monitor)
      if (allocated(error)) return
      call explore_valley(cases(table_4_3), cases(table_4_4), results, error)
      call locate(error, cases(table_4_4)%path)
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
               free = e%fits(size(e%fits), 1)%free
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
      do k = 1, size(results%valley, 2)
         call valley%line(csv_row(full(results%valley(1, k)), results%valley(2:, k)))
      end do
      call output%add('valley.csv', valley%content())
   end subroutine add_numbers

   !> Adds the report, or the parts of it that belong to the wanted tables.
   subroutine add_report(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      character(len=:), allocatable :: verdict
      real(wp) :: without, with
      integer :: k

      call add_lines(text, [character(len=100) :: &
         'Section 4 of NASA CR-178199: the RPL experiment', &
         '', &
         'NOT AN INDEPENDENT CONFIRMATION. The measurement was never printed as', &
         'numbers; data/rpl_reconstructed.csv is a record rebuilt from the numbers', &
         'that the paper does print, so as to have sums of squares and minima near the', &
         'printed ones. What rests on it says that those numbers can go together, no', &
         'more. Only what is marked INDEPENDENT does without any record.', &
         ''])
      call text%line('J: squared residuals over the samples of the fit, '// &
         window(results%samples)//'; sum: '//window(results%scored)//'.')
      call add_lines(text, [character(len=100) :: &
         'N = 4 cubics, exact responses, acceleration by (4.1) with Delta = .1 s; '// &
         'ft, lb, s, slug.', &
         'Rows "paper": J and sum as computed at the paper''s estimates.'])
      do k = table_4_2, table_4_6
         if (.not. results%entries(k)%wanted) cycle
         call text%line()
         associate (entry => results%entries(k), J => results%entries%our_J, &
            m => size(results%samples), floyd => results%entries(table_4_5))
            if (k /= table_4_5) call add_table(text, entry, trim(titles(k)))
            select case (k)
            case (table_4_2)
               call add_start(text, entry)
               call add_nested(text, 'the hose (none, or m_H and k_H)', J(basis), J(k), m, 2)
               call text%line('   (m_H = 0 is an edge of what is possible: chi-square is but a '// &
                  'guide)')
            case (table_4_3)
               call add_nested(text, 'c_H (Table 4.2 within Table 4.3)', J(table_4_2), &
                  min(J(k), J(table_4_2)), m, 1)
            case (table_4_4)
               call add_search(text, results, without, with)
               call add_nested(text, 'c_D (lowest J with c_D = 0 and of all)', without, with, m, 1)
            case (table_4_5)
               call add_lines(text, [character(len=100) :: &
                  'Table 4.5: Floyd''s m_T = # and E = #, nothing fitted', &
                  warning, &
                  ' - sum #, paper # (#%); J = #', &
                  ' - INDEPENDENT: its first frequency is #.4 Hz, the observed one .75'], &
                  [entry%paper%m_T, entry%paper%E, entry%our_sum, entry%printed_sum, &
                  entry%our_sum/entry%printed_sum - 1, entry%our_J, entry%paper_frequencies(1)])
            case (table_4_6)
               verdict = '   It does not hold here'
               if (entry%our_sum < floyd%our_sum) verdict = '   It holds here'
               call text%line(filled(' - the paper''s closing claim: fitted m_T and E beat '// &
                  'matched modes, sum # against #.', [floyd%printed_sum, entry%printed_sum]))
               call text%line(filled(verdict//': # against #.', [floyd%our_sum, entry%our_sum]))
            end select
         end associate
      end do
      call add_sums(text, results)
   end subroutine add_report

   !> Adds the start values of the search for Table 4.2; the paper prints no numbers, only how they
   !> were obtained.
   subroutine add_start(text, entry)
      type(text_t), intent(inout) :: text
      type(entry_t), intent(in) :: entry

      associate (start => entry%fits(1, 1)%fit%start, ours => entry%ours, paper => entry%paper)
         call add_lines(text, [character(len=100) :: &
            ' - started from m_H = #, k_H = #, which have a mode at the observed .75 Hz (see '// &
            'the case', &
            '   file); k_H/m_H is #.2 at the start, #.2 at the end, #.2 in the paper''s table', &
            ' - INDEPENDENT: no m_H and k_H have both observed frequencies. A hose', &
            '   that raises the first from .71 to .75 Hz is a spring to every higher', &
            '   mode: the second stays above 8.39 Hz, and with this E and m_T the', &
            '   observed 7.5 Hz is out of reach'], &
            [start, start(2)/start(1), ours%hose(1)%k_H/ours%hose(1)%m_H, &
            paper%hose(1)%k_H/paper%hose(1)%m_H])
      end associate
   end subroutine add_start

   !> Adds a table of estimates, J and sum, ours and the paper's, with relative differences, and
   !> sentences on which parameters the record determines.
   subroutine add_table(text, entry, title)
      type(text_t), intent(inout) :: text
      type(entry_t), intent(in) :: entry
      character(len=*), intent(in) :: title
      character(len=512), allocatable :: sentences(:)
      character(len=:), allocatable :: head, verdict
      real(wp), allocatable :: ours(:), paper(:)
      integer :: k

      associate (fit => entry%fits(size(entry%fits), 1), &
         s => entry%fits(size(entry%fits), 1)%statistics)
         head = repeat(' ', 12)
         do k = 1, size(fit%free)
            head = head//right(trim(free_names(fit%free(k))), 12)
         end do
         ours = [(entry%ours%get(fit%free(k)), k=1, size(fit%free)), entry%our_J, entry%our_sum]
         paper = [(entry%paper%get(fit%free(k)), k=1, size(fit%free)), entry%J_at_paper, &
            entry%sum_at_paper]
         call text%line(title)
         call text%line(warning)
         call text%line(head//right('J', 12)//right('sum', 12)//right('printed', 10))
         call text%line('   ours     '//columns(ours, 12))
         call text%line('   paper    '//columns(paper, 12)//columns([entry%printed_sum], 10))
         call text%line('   differs  '//columns(ours/paper - 1, 12, '#%')// &
            columns([entry%our_sum/entry%printed_sum - 1], 10, '#%'))
         do k = 1, size(fit%free)
            verdict = ' is not determined'
            if (s%determined(k)) verdict = ' is determined'
            call text%line(filled(' - '//trim(free_names(fit%free(k)))//verdict// &
               ': 95 % interval # +- #', [fit%fit%estimate(k), s%half_width(k)]))
         end do
         sentences = undetermined(s, free_names(fit%free), [fit%quantities%scale], fit%jacobian)
         do k = 1, size(sentences)
            call text%line(' - '//trim(sentences(k)))
         end do
         if (.not. fit%check%white) call text%line(filled(' - the residuals are NOT white '// &
            'noise, the intervals too narrow: as good as #.1 samples', [s%effective]))
      end associate
   end subroutine add_table

   !> Adds the nested-model test of Banks and Fitzpatrick.
   !>
   !> what                  description of the restriction that is tested
   !> J_restricted, J_full  least J with and without the restriction
   !> samples               number of samples
   !> restrictions          number of parameters that the restriction fixes
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
      call text%line(filled(' - nested-model test of '//what//': J_0 = #, J = #,', &
         [J_restricted, J_full]))
      call text%line(filled('   U = # (J_0 - J)/J = #, probability #: '//verdict, &
         [real(samples, wp), U, probability]))
   end subroutine add_nested

   !> Returns the number of samples and their first and last times, in words.
   function window(samples) result(words)
      real(wp), intent(in) :: samples(:)
      character(len=:), allocatable :: words

      words = to_text(size(samples))//' at t = '//to_text(samples(1))//' to '// &
         to_text(samples(size(samples)))//' s'
   end function window

   !> Adds tables of the sums of squares, of the undamped frequencies, and of the squared distances
   !> of the responses beside the differences of the printed sums.
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
            call frequencies%line('   '//left(e%name, 8)//no_hose(last)// &
               columns(e%our_frequencies(:last), 10, '#.4')//no_hose(last)// &
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

   !> Returns an entry for the missing frequency of the hose if there are only two frequencies.
   pure function no_hose(frequencies) result(words)
      integer, intent(in) :: frequencies
      character(len=:), allocatable :: words

      words = ''
      if (frequencies == 2) words = right('-', 10)
   end function no_hose

end module beamid_section_4
