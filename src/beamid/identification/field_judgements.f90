!> Tests of properties that vary along the beam: whether a dip exists, and whether a field has
!> enough coefficients.
!>
!> In both cases the intervals of linear theory are too narrow. `beamid_stages` calls these tests
!> after each fit.
module beamid_field_judgements
   use beamid_distributions, only: chi_square_tail
   use beamid_field_penalties, only: fields
   use beamid_kinds, only: wp
   use beamid_line_matches, only: dip_places
   use beamid_smooth_fits, only: trial_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_d_D, of_w_D, of_x_D
   implicit none
   private

   public :: judge_dip, judge_functions

contains

   !> Withdraws the estimates of a dip that noise could explain, or that could be elsewhere.
   !>
   !> A dip without depth has neither place nor width, so a search along the beam finds a dip in
   !> mere noise, and linear theory then reports that all three are known. A dip is accepted if
   !> noise would reach its depth in fewer than one record in twenty, at the best of all places that
   !> a search tries, where depth, place and width can each adapt to the noise. Its place is
   !> accepted if no dip that a search has found elsewhere is as likely, at the same level.
   !>
   !> found   result; on return without intervals of the dip, and with a reason in `other`, if the
   !>         dip is not accepted
   !> trials  where searches from other starts have ended
   !> misfit  misfit of the fit, to be compared with those of the trials
   subroutine judge_dip(found, trials, misfit)
      type(stage_fit_t), intent(inout) :: found
      type(trial_t), intent(in) :: trials(:)
      real(wp), intent(in) :: misfit
      real(wp), parameter :: adapted = 3, chance = 0.05_wp/dip_places
      integer :: j, k, dip
      character(len=:), allocatable :: reason
      real(wp) :: depth_ratio

      if (found%statistics%samples == 0) return
      do dip = 1, size(found%free)
         if (found%free(dip) /= of_x_D) cycle
         reason = ''
         associate (s => found%statistics, record => found%quantities(dip)%record)
            do k = 1, size(found%free)
               if (found%free(k) /= of_d_D .or. found%quantities(k)%record /= record) cycle
               ! The ratio is limited to 1000, beyond which the probability is 0, because the
               ! standard error may be 0.
               depth_ratio = 1e3_wp
               if (s%corrected_error(k) > 0) depth_ratio = min(depth_ratio, &
                  found%fit%estimate(k)/s%corrected_error(k))
               if (.not. chi_square_tail(depth_ratio**2, adapted) < chance) reason = &
                  'this record does not tell that there is a dip: noise alone would lead to a '// &
                  'dip of this depth somewhere along the beam'
            end do
            do k = 1, size(trials)
               if (reason /= '' .or. .not. misfit > 0) exit
               if (abs(trials(k)%estimate(dip) - found%fit%estimate(dip))/2 &
                  <= s%corrected_half_width(dip)) cycle
               if (s%cannot_reject(trials(k)%misfit/misfit, dip, chance)) reason = 'a dip at '// &
                  to_text(trials(k)%estimate(dip))//' fits nearly as well'
            end do
            if (reason == '') cycle
            if (found%other /= '') reason = found%other//'; '//reason
            found%other = reason
            do j = 1, size(found%free)
               if (any(found%free(j) == [of_x_D, of_w_D, of_d_D]) .and. &
                  found%quantities(j)%record == record) call found%statistics%withdraw(j)
            end do
         end associate
      end do
   end subroutine judge_dip

   !> Withdraws the estimates of a field that has too few coefficients.
   !>
   !> Linear theory does not know the error of a shape that the coefficients cannot represent.
   subroutine judge_functions(found)
      type(stage_fit_t), intent(inout) :: found
      integer :: a, k

      if (found%statistics%samples == 0) return
      do a = 1, fields
         if (.not. found%is_too_coarse(a)) cycle
         do k = 1, size(found%fields(a)%place)
            call found%statistics%withdraw(found%fields(a)%place(k))
         end do
      end do
   end subroutine judge_functions

end module beamid_field_judgements
