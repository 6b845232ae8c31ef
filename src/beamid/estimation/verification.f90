!> Whether an integrator's error has moved the estimates of a fit: the exact response at the same
!> estimates knows where the minimum would have been without it.
module beamid_verification
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t, new_apparatus
   use beamid_galerkin, only: mesh_t
   use beamid_gauss_newton, only: look_ahead, outlook_t, scales_of
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit_t
   use beamid_modal, only: modal_t
   use beamid_observation, only: observation_t
   use beamid_problems, only: error_of_differences
   use beamid_residuals, only: residual_t
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: exact_counterpart, verify_integrator

   !> How far an estimate may have been moved, in standard errors; and relatively, where a record
   !> without noise leaves standard errors that are the integrator's own: a digit that no summary
   !> shows.
   real(wp), parameter :: allowed = 0.25_wp, unseen = 1e-6_wp

contains

   !> The residuals of the same experiments by the exact response; without parts where it cannot be
   !> prepared.
   subroutine exact_counterpart(problem, experiments, mesh, observation, exact)
      type(residual_t), intent(in) :: problem
      type(experiment_t), intent(in) :: experiments(:)
      type(mesh_t), intent(in) :: mesh
      type(observation_t), intent(in) :: observation
      type(residual_t), intent(out) :: exact
      type(error_t), allocatable :: error
      integer :: i

      allocate (exact%parts(size(experiments)))
      do i = 1, size(experiments)
         call new_apparatus(experiments(i), problem%world%structures(i), mesh, observation, &
            modal_t(), exact%parts(i), error)
         if (.not. allocated(error)) cycle
         deallocate (exact%parts)
         return
      end do
   end subroutine exact_counterpart

   !> problem    as it was fitted
   !> exact      from `exact_counterpart`
   !> variables  (n) of the fit
   !> names      (n) theirs
   !> moved      by how many standard errors, the largest over the parameters; -1 where no degree of
   !>            freedom is left for these
   !> error      an estimate was moved too far; the response cannot be computed for the comparison
   subroutine verify_integrator(problem, exact, variables, names, fit, moved, error)
      type(residual_t), intent(in) :: problem
      type(residual_t), intent(inout) :: exact
      type(variable_t), intent(in) :: variables(:)
      character(len=*), intent(in) :: names(:)
      type(fit_t), intent(in) :: fit
      real(wp), intent(out) :: moved
      type(error_t), allocatable, intent(out) :: error
      type(outlook_t) :: ahead
      type(statistics_t) :: statistics
      character(len=:), allocatable :: judge
      real(wp), allocatable :: r(:), jacobian(:, :)
      real(wp), dimension(size(variables)) :: scales, ratio
      real(wp) :: threshold
      integer :: k

      moved = -1
      if (size(fit%residual) <= size(variables) .or. size(variables) == 0) return
      call compute(problem, exact, fit, r, jacobian, threshold, judge, error)
      if (allocated(error)) return
      ahead = look_ahead(jacobian, r, fit%estimate, variables, threshold)
      scales = scales_of(variables, fit%estimate)
      call new_statistics(jacobian, ahead%residual, fit%estimate, scales, statistics, error)
      if (allocated(error)) return
      ratio = abs(ahead%step)/max(statistics%std_error, tiny(moved))
      moved = maxval(ratio)
      where (abs(ahead%step) <= unseen*scales) ratio = 0
      k = maxloc(ratio, dim=1)
      if (ratio(k) <= allowed) return
      associate (rtol => problem%parts(1)%solver%noise())
         call failure(error, 'rtol = '//to_text(rtol)//' of the integrator is too large: it has '// &
            'moved '//trim(names(k))//' by '//to_text(abs(ahead%step(k)))//', '// &
            to_text(ratio(k))//' standard errors, seen from '//judge// &
            '; expected at most a quarter, so rtol = '//to_text(smaller(rtol, ratio(k)))// &
            ' or less, or method = ''modal''')
      end associate
   end subroutine verify_integrator

   !> Residuals and derivatives at the estimates by the exact response; where there is none, by a
   !> hundredth of the tolerance, with the derivatives that the fit has.
   !>
   !> threshold  relative error of the derivatives
   !> judge      which of the two
   subroutine compute(problem, exact, fit, r, jacobian, threshold, judge, error)
      type(residual_t), intent(in) :: problem
      type(residual_t), intent(inout) :: exact
      type(fit_t), intent(in) :: fit
      real(wp), allocatable, intent(out) :: r(:), jacobian(:, :)
      real(wp), intent(out) :: threshold
      character(len=:), allocatable, intent(out) :: judge
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: finer
      integer :: i

      allocate (r, mold=fit%residual)
      allocate (jacobian, mold=fit%jacobian)
      threshold = size(r)*epsilon(threshold)
      judge = 'the exact response'
      if (allocated(exact%parts)) then
         exact%world = problem%world
         exact%free = problem%free
         exact%record = problem%record
         exact%offset = problem%offset
         call exact%jacobian(fit%estimate, r, jacobian, error)
         if (.not. allocated(error)) return
      end if
      finer = problem
      do i = 1, size(finer%parts)
         select type (solver => finer%parts(i)%solver)
         type is (cvode_t)
            solver%rtol = solver%rtol/100
            solver%atol = solver%atol/100
            solver%max_steps = 10*solver%max_steps
         end select
      end do
      jacobian = fit%jacobian
      threshold = error_of_differences(max(problem%parts(1)%solver%noise(), 1e-8_wp))
      judge = 'rtol = '//to_text(problem%parts(1)%solver%noise()/100)
      call finer%residuals(fit%estimate, r, error)
      if (allocated(error)) error%message = 'the integrator''s error cannot be told: '//error%message
   end subroutine compute

   !> The power of ten that keeps the shift, which goes with the tolerance, below a third of what is
   !> allowed; from a tolerance so loose that nothing goes with it, the default.
   pure real(wp) function smaller(rtol, ratio)
      real(wp), intent(in) :: rtol, ratio
      type(cvode_t), parameter :: default = cvode_t()

      smaller = min(default%rtol, 10.0_wp**floor(log10(rtol*allowed/(3*ratio))))
   end function smaller

end module beamid_verification
