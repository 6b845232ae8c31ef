!> Intervals of weak estimates: those with a large relative error.
!>
!> The residuals are linear in a parameter only near the estimate. A decay rate, for example, that a
!> faint mode determines to 40 % may be three times as large without a significant rise of J,
!> although the interval of linear theory ends before twice the estimate. The profile of J along a
!> weak parameter is therefore followed. Where it, or another parameter on the way, leaves the
!> interval of linear theory, the total interval is extended.
module beamid_weak_estimates
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_fit_t
   use beamid_interrupts, only: interrupted
   use beamid_kinds, only: wp
   use beamid_parameters, only: on_beam, parameters
   use beamid_profile_likelihood, only: at_bound, follow_profile, is_open, side_t
   use beamid_residuals, only: residual_t
   use beamid_statistics, only: unlimited
   use beamid_structure, only: is_coefficient
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: widen_weak_estimates

   !> Relative standard error above which an estimate is weak: at 2 standard errors, a logarithm and
   !> its tangent differ by a fifth there.
   real(wp), parameter :: weak = 0.2_wp
   !> Relative extension of an interval that is worth a note.
   real(wp), parameter :: noted = 0.2_wp

contains

   !> Extends the total intervals of a fit to the profiles of its weak estimates. Positions have no
   !> relative error, and the coefficients of E(x) and c_D(x) have intervals of their own.
   !>
   !> model, mesh, experiments  of the fit
   !> found                     the fit, with a known mesh shift and its fixed parameters
   subroutine widen_weak_estimates(model, mesh, experiments, found)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(inout) :: found
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(error_t), allocatable :: error
      character(len=:), allocatable :: names
      real(wp) :: before
      integer :: k, direction

      if (.not. any([(is_weak(found, k), k=1, size(found%free))])) return
      call exact_counterpart(model, mesh, experiments, found%free, problem)
      if (.not. allocated(problem%parts)) return
      call found%restore(problem)
      call variables_of(found%again(), problem%scenario, variables, quantities, error)
      if (allocated(error)) return
      names = ''
      do k = 1, size(found%free)
         if (.not. is_weak(found, k)) cycle
         before = sum(found%total(k))
         do direction = -1, 1, 2
            call widen(k, direction)
            if (interrupted()) return
         end do
         if (sum(found%total(k)) > (1 + noted)*before) names = names//', '// &
            trim(found%quantities(k)%name)
      end do
      if (names == '') return
      if (found%other /= '') found%other = found%other//'; '
      found%other = found%other//'the records determine '//names(3:)//' only roughly: linear '// &
         'theory does not hold so far from the estimate, and the total intervals follow the '// &
         'profile of J'

   contains

      !> Extends the intervals to the end of one side of the profile of parameter k.
      subroutine widen(k, direction)
         integer, intent(in) :: k, direction
         type(side_t) :: side
         real(wp) :: shift(size(found%free)), covered(size(found%free))
         integer :: j

         associate (s => found%statistics)
            covered = [(s%corrected_half_width(j), j=1, size(covered))]
            call follow_profile(problem, problem%rows(), variables, found%fit%estimate, &
               sum(found%fit%residual**2), k, direction, s%variance*(covered(k)/s%std_error(k)) &
               **2, covered(k), side)
            shift = side%parameters(:, size(side%J)) - found%fit%estimate
            if (side%state == at_bound) shift(k) = side%end - found%fit%estimate(k)
            if (side%state == is_open) call s%withdraw(k)
         end associate
         call found%extend(shift, covered)
      end subroutine widen

   end subroutine widen_weak_estimates

   !> Tells whether the estimate of parameter k is weak, and linear theory gives it an interval.
   pure logical function is_weak(found, k)
      type(stage_fit_t), intent(in) :: found
      integer, intent(in) :: k

      is_weak = .false.
      associate (s => found%statistics)
         if (s%samples == 0 .or. .not. s%variance > 0) return
         if (s%is_withdrawn(k) .or. parameters(found%free(k))%range == on_beam .or. &
            is_coefficient(found%free(k))) return
         is_weak = s%std_error(k) > 0 .and. s%corrected_half_width(k) < unlimited .and. &
            s%corrected_error(k) > weak*abs(found%fit%estimate(k))
      end associate
   end function is_weak

end module beamid_weak_estimates
