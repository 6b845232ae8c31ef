!> The search for Table 4.4 in words: its stages, and the valley of J between Tables 4.3 and 4.4.
module beamid_section_4_valley
   use beamid
   use beamid_paper, only: percent
   use beamid_section_4_results, only: entry_t, results_t, table_4_3, table_4_4
   use beamid_strings, only: fixed, to_text
   use beamid_texts, only: right, text_t
   implicit none
   private

   public :: add_stages, add_valley

   !> A relative change of m_H that counts as none.
   real(wp), parameter :: near = 0.05_wp

contains

   !> The searches of the text, one after the other.
   subroutine add_stages(text, entry)
      type(text_t), intent(inout) :: text
      type(entry_t), intent(in) :: entry
      integer :: k, j
      character(len=:), allocatable :: line

      call text%line(' - stage by stage, as the text has it:')
      do k = 1, size(entry%fits)
         associate (fit => entry%fits(k))
            line = '     '//to_text(k)//':'
            do j = 1, size(fit%free)
               line = line//' '//trim(free_names(fit%free(j)))//' = '// &
                  to_text(fit%fit%estimate(j))
            end do
            call text%line(line//', J = '//to_text(fit%fit%J)//', sum = '//to_text(fit%score))
            call text%line('        '//fit%fit%reason)
         end associate
      end do
      associate (move => entry%ours%m_H/entry%paper%m_H - 1)
         if (abs(move) < near) then
            call text%line('   they reach Table 4.4, m_H to '//percent(move))
         else
            call text%line('   they do NOT reach Table 4.4: m_H differs by '//percent(move))
         end if
      end associate
   end subroutine add_stages

   !> J between Tables 4.3 and 4.4, and which of them is a minimum.
   !>
   !> without, with  lowest J found with c_D = 0 and with c_D free
   subroutine add_valley(text, results, without, with)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      real(wp), intent(out) :: without, with
      integer :: k

      associate (valley => results%valley, four => results%entries(table_4_4), &
         three => results%entries(table_4_3))
         without = min(minval([(valley(k)%fit%J, k=1, size(valley))]), three%our_J, &
            results%from_4_3%fit%J, results%from_4_4_undamped%fit%J)
         with = min(without, four%our_J, results%from_4_4%fit%J)
         call text%line(' - the valley between Tables 4.3 and 4.4: c_D = 0, c_H and k_H fitted '// &
            'for each m_H')
         call text%line('         m_H          c_H          k_H            J  above lowest')
         do k = 1, size(valley), 2
            associate (q => valley(k)%structure, J => valley(k)%fit%J)
               call text%line(fixed(q%m_H, 12, 3)//right(to_text(q%c_H), 13)// &
                  right(to_text(q%k_H), 13)//right(to_text(J), 13)// &
                  right(percent(J/with - 1), 13))
            end associate
         end do
         call add_bottoms(text, results)
         call add_end(text, 'Table 4.3 (m_H, c_H, k_H)', three%paper, three%J_at_paper, &
            results%from_4_3, with)
         call add_end(text, 'Table 4.4 (m_H, c_H, k_H, c_D = 0)', four%paper, &
            results%J_without_c_D, results%from_4_4_undamped, with)
         call add_end(text, 'Table 4.4 (all four)', four%paper, four%J_at_paper, &
            results%from_4_4, with)
         if (abs(results%from_4_4_undamped%structure%m_H - results%from_4_3%structure%m_H) < &
            near*results%from_4_3%structure%m_H) then
            call text%line(' - both ends of the valley lead to ONE minimum')
         else
            call text%line(' - the ends of the valley lead to TWO minima, one no more than local')
         end if
      end associate
   end subroutine add_valley

   !> Where along the valley J has local minima.
   subroutine add_bottoms(text, results)
      type(text_t), intent(inout) :: text
      type(results_t), intent(in) :: results
      character(len=:), allocatable :: line
      integer :: k, j

      associate (valley => results%valley, places => results%bottoms)
         line = '   local minima along it: '//to_text(size(places))
         do k = 1, size(places)
            line = line//', near m_H = '//to_text(valley(places(k))%structure%m_H)
         end do
         call text%line(line)
         do k = 2, size(places)
            associate (ridge => maxval([(valley(j)%fit%J, j=places(k - 1), places(k))]), &
               bottom => max(valley(places(k - 1))%fit%J, valley(places(k))%fit%J))
               call text%line('   between them J rises to '//to_text(ridge)//', '// &
                  trim(adjustl(fixed(100*(ridge/bottom - 1), 12, 3)))// &
                  ' % above the higher one')
            end associate
         end do
      end associate
   end subroutine add_bottoms

   !> Where a search ends that starts at the paper's estimates.
   subroutine add_end(text, name, paper, J, found, lowest)
      type(text_t), intent(inout) :: text
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: paper
      real(wp), intent(in) :: J, lowest
      type(stage_fit_t), intent(in) :: found
      character(len=:), allocatable :: line
      integer :: k

      call text%line(' - the paper''s '//name//': J = '//to_text(J)//', '// &
         percent(J/lowest - 1)//' above the lowest')
      line = '   a search from there ends at'
      do k = 1, size(found%free)
         line = line//' '//trim(free_names(found%free(k)))//' = '//to_text(found%fit%estimate(k))
      end do
      call text%line(line//', J = '//to_text(found%fit%J))
      associate (move => found%structure%m_H/paper%m_H - 1)
         line = '   m_H moves by '//percent(move)//', J falls by '//percent(1 - found%fit%J/J)
         if (abs(move) < near) then
            call text%line(line//': a minimum within 5 %, as the record was built to have')
         else
            call text%line(line//': no minimum within 5 %')
         end if
      end associate
   end subroutine add_end

end module beamid_section_4_valley
