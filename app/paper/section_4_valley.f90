!> The valley of J between the estimates of Tables 4.3 and 4.4: its computation, and its part of the
!> report on Section 4, with the search for Table 4.4 and its stages.
module beamid_section_4_valley
   use beamid
   use beamid_lines, only: add_lines, columns, filled
   use beamid_profiles, only: lowest_places, profile, squared_distance, sum_of_squares
   use beamid_section_4_results, only: results_t, search_t, table_4_3, table_4_4
   use beamid_strings, only: to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: explore_valley, add_search

   !> Relative difference of m_H below which two estimates count as the same minimum.
   real(wp), parameter :: near = 0.05_wp

contains

   !> Computes J along m_H with c_D = 0, and fits that start at the paper's estimates.
   !>
   !> case_3, case_4  cases of Tables 4.3 and 4.4; the structures of their models are replaced
   !> results         on return with `valley`, `bottoms` and all components after them
   !> error           a fit or a response that fails
   subroutine explore_valley(case_3, case_4, results, error)
      type(case_t), intent(inout) :: case_3, case_4
      type(results_t), intent(inout) :: results
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: places = 27
      real(wp), parameter :: m_first = 0.03_wp, m_step = 0.005_wp
      type(simulation_t) :: simulation
      type(structure_t) :: undamped
      type(stage_t) :: along
      type(stage_fit_t), allocatable :: fits(:)
      integer :: k

      allocate (results%valley(4, places))
      associate (model => case_3%model, mesh => case_3%meshes(1), &
         three => results%entries(table_4_3)%paper, four => results%entries(table_4_4))
         model%structure = three
         along%free = [free_index('c_H'), free_index('k_H')]
         along%lower = [0.0_wp, 0.0_wp]
         along%upper = [unbounded, unbounded]
         call profile(model, mesh, free_index('m_H'), [(m_first + k*m_step, k=0, places - 1)], &
            along, results%samples, results%measured, fits, error)
         if (allocated(error)) return
         do k = 1, places
            associate (q => fits(k)%scenario%structures(1))
               results%valley(:, k) = [q%hose(1)%m_H, q%hose(1)%c_H, q%hose(1)%k_H, fits(k)%fit%J]
            end associate
         end do
         results%bottoms = lowest_places(results%valley(4, :))

         call search_from(three, case_3%stages, results%from_4_3)
         if (allocated(error)) return
         undamped = four%paper
         undamped%c_D = 0
         model%structure = undamped
         call sum_of_squares(model, mesh, results%samples, results%measured, &
            results%J_without_c_D, error)
         if (allocated(error)) return
         call simulate(model, mesh, results%scored, simulation, error)
         if (allocated(error)) return
         results%distance2_without_c_D = squared_distance(simulation%acceleration, four%response)
         call search_from(undamped, case_3%stages, results%from_4_4_undamped)
         if (.not. allocated(error)) call search_from(four%paper, case_4%stages, results%from_4_4)
      end associate

   contains

      !> Fits the last of some stages, starting from the parameters of a structure.
      subroutine search_from(structure, stages, found)
         type(structure_t), intent(in) :: structure
         type(stage_t), intent(in) :: stages(:)
         type(search_t), intent(out) :: found
         type(stage_t) :: stage(1)

         stage(1) = stages(size(stages))
         if (allocated(stage(1)%start)) deallocate (stage(1)%start)
         case_4%model%structure = structure
         call identify(case_4%model, case_4%meshes(1), stage, results%samples, &
            results%measured, fits, error)
         if (allocated(error)) return
         found = search_t(fits(1)%free, fits(1)%fit%estimate, fits(1)%fit%J, &
            fits(1)%scenario%structures(1)%hose(1)%m_H)
      end subroutine search_from

   end subroutine explore_valley

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
            associate (found => entry%fits(k, 1))
               call text%line('     '//to_text(k)//':'//estimates(found%free, &
                  found%fit%estimate, found%fit%J)//filled(', sum = #', [found%score]))
               call text%line('        '//found%fit%reason)
            end associate
         end do
         associate (move => entry%ours%hose(1)%m_H/entry%paper%hose(1)%m_H - 1)
            if (abs(move) < near) then
               call text%line(filled('   they reach Table 4.4, m_H to #%', [move]))
            else
               call text%line(filled('   they do NOT reach Table 4.4: m_H differs by #%', [move]))
            end if
         end associate
      end associate
      call add_valley(text, results, without, with)
   end subroutine add_search

   !> Returns the estimates of the free parameters of a fit and its J, in words.
   function estimates(free, estimate, J) result(words)
      integer, intent(in) :: free(:)
      real(wp), intent(in) :: estimate(:), J
      character(len=:), allocatable :: words
      integer :: k

      words = ''
      do k = 1, size(free)
         words = words//' '//trim(free_names(free(k)))//' = '//to_text(estimate(k))
      end do
      words = words//', J = '//to_text(J)
   end function estimates

   !> Adds J between the estimates of Tables 4.3 and 4.4, and which of the two is a minimum.
   !>
   !> without, with  on return the lowest J found with c_D = 0 and with c_D free
   subroutine add_valley(text, results, without, with)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      real(wp), intent(out) :: without, with
      real(wp) :: ridge
      integer :: k

      associate (m_H => results%valley(1, :), J => results%valley(4, :), &
         four => results%entries(table_4_4), three => results%entries(table_4_3), &
         from_4_3 => results%from_4_3, undamped => results%from_4_4_undamped)
         without = min(minval(J), three%our_J, from_4_3%J, undamped%J)
         with = min(without, four%our_J, results%from_4_4%J)
         call add_lines(text, [character(len=100) :: &
            ' - the valley between Tables 4.3 and 4.4: c_D = 0, c_H and k_H fitted for each m_H', &
            '         m_H          c_H          k_H            J  above lowest'])
         do k = 1, size(J), 2
            call text%line(columns(m_H(k:k), 12, '#.3')//columns(results%valley(2:, k), 13)// &
               columns([J(k)/with - 1], 13, '#%'))
         end do
         associate (places => results%bottoms)
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
         if (abs(undamped%m_H - from_4_3%m_H) < near*from_4_3%m_H) then
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
   !> found   where the search ends
   !> lowest  lowest J that any search has found
   subroutine add_end(text, name, paper, J, found, lowest)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: paper
      real(wp), intent(in) :: J, lowest
      type(search_t), intent(in) :: found
      character(len=:), allocatable :: verdict

      associate (move => found%m_H/paper%hose(1)%m_H - 1)
         verdict = ': no minimum within 5 %'
         if (abs(move) < near) verdict = ': a minimum within 5 %, as the record was built to have'
         call text%line(filled(' - the paper''s '//name//': J = #, #% above the lowest', &
            [J, J/lowest - 1]))
         call text%line('   a search from there ends at'//estimates(found%free, &
            found%estimate, found%J))
         call text%line(filled('   m_H moves by #%, J falls by #%'//verdict, &
            [move, 1 - found%J/J]))
      end associate
   end subroutine add_end

end module beamid_section_4_valley
