!> Part of the report on Section 4: the search for Table 4.4, its stages, and the valley of J
!> between the estimates of Tables 4.3 and 4.4.
module beamid_section_4_valley
   use beamid
   use beamid_lines, only: add_lines, columns, filled
   use beamid_section_4_results, only: results_t, table_4_3, table_4_4
   use beamid_strings, only: to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: add_search

   !> Relative difference of m_H below which two estimates count as the same minimum.
   real(wp), parameter :: near = 0.05_wp

contains

   !> Adds the effect of c_D, the stages of the search that the paper describes, and the valley.
   !>
   !> without, with  on return the lowest J found with c_D = 0 and with c_D free
   subroutine add_search(text, results, without, with)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      real(wp), intent(out) :: without, with
      integer :: k

      associate (entry => results%entries(table_4_4))
         call add_lines(text, [character(len=100) :: &
            ' - c_D = # or 0 at the paper''s estimates: J = # or #', &
            '   INDEPENDENT: the two responses are |Y - Y_0|^2 = # apart, t = 0 to 5'], &
            [entry%paper%c_D, entry%J_at_paper, results%J_without_c_D, &
            results%distance2_without_c_D])
         call text%line(' - stage by stage, as the text has it:')
         do k = 1, size(entry%fits)
            call text%line('     '//to_text(k)//':'//estimates(entry%fits(k))// &
               filled(', sum = #', [entry%fits(k)%score]))
            call text%line('        '//entry%fits(k)%fit%reason)
         end do
         associate (move => entry%ours%m_H/entry%paper%m_H - 1)
            if (abs(move) < near) then
               call text%line(filled('   they reach Table 4.4, m_H to #%', [move]))
            else
               call text%line(filled('   they do NOT reach Table 4.4: m_H differs by #%', [move]))
            end if
         end associate
      end associate
      call add_valley(text, results, without, with)
   end subroutine add_search

   !> Returns the estimates and J of a fit, in words.
   function estimates(found) result(words)
      type(stage_fit_t), intent(in) :: found
      character(len=:), allocatable :: words
      integer :: k

      words = ''
      do k = 1, size(found%free)
         words = words//' '//trim(free_names(found%free(k)))//' = '// &
            to_text(found%fit%estimate(k))
      end do
      words = words//', J = '//to_text(found%fit%J)
   end function estimates

   !> Adds J between the estimates of Tables 4.3 and 4.4, and which of the two is a minimum.
   !>
   !> without, with  on return the lowest J found with c_D = 0 and with c_D free
   subroutine add_valley(text, results, without, with)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      real(wp), intent(out) :: without, with
      real(wp) :: ridge
      real(wp), allocatable :: m_H(:)
      integer :: k

      associate (valley => results%valley, four => results%entries(table_4_4), &
         three => results%entries(table_4_3), from_4_3 => results%from_4_3, &
         undamped => results%from_4_4_undamped)
         without = min(minval(valley%fit%J), three%our_J, from_4_3%fit%J, undamped%fit%J)
         with = min(without, four%our_J, results%from_4_4%fit%J)
         call add_lines(text, [character(len=100) :: &
            ' - the valley between Tables 4.3 and 4.4: c_D = 0, c_H and k_H fitted for each m_H', &
            '         m_H          c_H          k_H            J  above lowest'])
         do k = 1, size(valley), 2
            associate (q => valley(k)%scenario%structures(1), J => valley(k)%fit%J)
               call text%line(columns([q%m_H], 12, '#.3')//columns([q%c_H, q%k_H, J], 13)// &
                  columns([J/with - 1], 13, '#%'))
            end associate
         end do
         m_H = [(valley(k)%scenario%structures(1)%m_H, k=1, size(valley))]
         associate (J => valley%fit%J, places => results%bottoms)
            call text%line(filled('   local minima along it: #'//repeat(', near m_H = #', &
               size(places)), [real(wp) :: size(places), m_H(places)]))
            do k = 2, size(places)
               ridge = maxval(J(places(k - 1):places(k)))
               call text%line(filled('   between them J rises to #, #.3 % above the higher one', &
                  [ridge, 100*(ridge/maxval(J(places(k - 1:k))) - 1)]))
            end do
         end associate
         call add_end(text, 'Table 4.3 (m_H, c_H, k_H)', three%paper, three%J_at_paper, &
            from_4_3, with)
         call add_end(text, 'Table 4.4 (m_H, c_H, k_H, c_D = 0)', four%paper, &
            results%J_without_c_D, undamped, with)
         call add_end(text, 'Table 4.4 (all four)', four%paper, four%J_at_paper, &
            results%from_4_4, with)
         if (abs(undamped%scenario%structures(1)%m_H - from_4_3%scenario%structures(1)%m_H) < &
            near*from_4_3%scenario%structures(1)%m_H) then
            call text%line(' - both ends of the valley lead to ONE minimum')
         else
            call text%line(' - the ends of the valley lead to TWO minima, one no more than local')
         end if
      end associate
   end subroutine add_valley

   !> Adds where a search that starts at the paper's estimates ends.
   !>
   !> name    of the paper's table and the free parameters
   !> paper   structure with the paper's estimates
   !> J       at the paper's estimates
   !> found   fit that the search ends at
   !> lowest  lowest J that any search has found
   subroutine add_end(text, name, paper, J, found, lowest)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: paper
      real(wp), intent(in) :: J, lowest
      type(stage_fit_t), intent(in) :: found
      character(len=:), allocatable :: verdict

      associate (move => found%scenario%structures(1)%m_H/paper%m_H - 1)
         verdict = ': no minimum within 5 %'
         if (abs(move) < near) verdict = ': a minimum within 5 %, as the record was built to have'
         call text%line(filled(' - the paper''s '//name//': J = #, #% above the lowest', &
            [J, J/lowest - 1]))
         call text%line('   a search from there ends at'//estimates(found))
         call text%line(filled('   m_H moves by #%, J falls by #%'//verdict, &
            [move, 1 - found%fit%J/J]))
      end associate
   end subroutine add_end

end module beamid_section_4_valley
