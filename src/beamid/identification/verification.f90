!> Verification of an integrator: whether its error has moved the estimates of a fit.
!>
!> The fit is continued from its estimates with the exact response. The shift of the estimates is
!> the effect of the error of the integrator.
module beamid_verification
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_gauss_newton, only: scales_of
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_modal, only: modal_t
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_simulation, only: model_t
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: exact_counterpart, verify_integrator

   !> Largest accepted shift of an estimate, in standard errors; and the relative shift that is
   !> accepted in any case, because no summary shows that digit. Without noise in the record, the
   !> standard errors come from the integrator itself and may be smaller.
   real(wp), parameter :: allowed = 0.25_wp, negligible = 1e-6_wp

contains

   !> Prepares the same fit with the exact response.
   !>
   !> free     numbers of parameters that may be free, as in `new_residuals`
   !> exact    the fit; without `parts` if the exact response cannot be prepared
   subroutine exact_counterpart(model, mesh, experiments, free, exact)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: free(:)
      type(residual_t), intent(out) :: exact
      type(model_t) :: exact_model
      type(error_t), allocatable :: error

      ! Copied by component: gfortran 12 copies a solver of one type into the memory of another.
      exact_model%structure = model%structure
      exact_model%observation = model%observation
      if (allocated(model%priors)) exact_model%priors = model%priors
      allocate (modal_t :: exact_model%solver)
      call new_residuals(exact_model, mesh, experiments, exact, error, free)
      if (allocated(error)) deallocate (exact%parts)
   end subroutine exact_counterpart

   !> Measures how far the error of the integrator has moved the estimates.
   !>
   !> problem    the fit with the integrator
   !> exact      from `exact_counterpart`
   !> variables  (n) variables of the fit
   !> names      (n) their names
   !> found      result of the fit
   !> moved      largest shift of an estimate [standard errors]; -1 if no degree of freedom is left
   !>            for standard errors
   !> reference  solution from which the shift is measured: the exact response, or a smaller
   !>            tolerance if that fails
   !> error      an estimate was moved too far, or no reference can be computed
   subroutine verify_integrator(problem, exact, variables, names, found, moved, reference, error)
      type(residual_t), intent(in) :: problem
      type(residual_t), intent(inout) :: exact
      type(variable_t), intent(in) :: variables(:)
      character(len=*), intent(in) :: names(:)
      type(fit_t), intent(in) :: found
      real(wp), intent(out) :: moved
      character(len=:), allocatable, intent(out) :: reference
      type(error_t), allocatable, intent(out) :: error
      type(fit_t) :: better
      type(statistics_t) :: statistics
      real(wp), dimension(size(variables)) :: scales, shift, ratio
      type(cvode_t), parameter :: default = cvode_t()
      real(wp) :: smaller
      integer :: k

      moved = -1
      reference = ''
      if (size(found%residual) <= size(variables) .or. size(variables) == 0) return
      call refit(problem, exact, variables, found, better, reference, error)
      if (allocated(error)) return
      scales = scales_of(variables, better%estimate)
      call new_statistics(better%jacobian, better%residual, better%estimate, scales, statistics, &
         error, problem%samples(), problem%noise)
      if (allocated(error)) return
      shift = abs(found%estimate - better%estimate)
      ratio = shift/max(statistics%std_error, tiny(moved))
      moved = maxval(ratio)
      where (shift <= negligible*scales) ratio = 0
      k = maxloc(ratio, dim=1)
      if (ratio(k) <= allowed) return
      associate (rtol => problem%parts(1)%solver%relative_error())
         ! The shift is proportional to the tolerance. Proposed is the power of ten that keeps it
         ! below a third of the accepted shift, and at most the default tolerance, because the shift
         ! of larger tolerances is not proportional.
         smaller = min(default%rtol, 10.0_wp**floor(log10(rtol*allowed/(3*ratio(k)))))
         call failure(error, 'a relative tolerance of '//to_text(rtol)//' is too large: the '// &
            'error of the integrator has moved '//trim(names(k))//' by '//to_text(shift(k))// &
            ', '//to_text(ratio(k))//' standard errors, compared with '//reference// &
            '; expected at most a quarter of a standard error: set rtol to '// &
            to_text(max(1e-14_wp, smaller))//' or less, or use method=''modal''')
      end associate
   end subroutine verify_integrator

   !> Continues from the estimates with the exact response, or with a hundredth of the tolerance if
   !> that fails.
   !>
   !> better     result of the continued fit
   !> reference  name of the solution that was used
   subroutine refit(problem, exact, variables, found, better, reference, error)
      type(residual_t), intent(in) :: problem
      type(residual_t), intent(inout) :: exact
      type(variable_t), intent(in) :: variables(:)
      type(fit_t), intent(in) :: found
      type(fit_t), intent(out) :: better
      character(len=:), allocatable, intent(out) :: reference
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: finer
      type(variable_t) :: start(size(variables))
      integer :: i

      start = variables%from(found%estimate)
      reference = 'the exact response'
      if (allocated(exact%parts)) then
         exact%scenario = problem%scenario
         exact%free = problem%free
         exact%record = problem%record
         exact%offset = problem%offset
         exact%weight = problem%weight
         exact%noise = problem%noise
         exact%strength = problem%strength
         call fit(exact, size(found%residual), start, options_t(check=.false.), better, error)
         if (.not. allocated(error)) return
      end if
      call problem%copy_to(finer)
      do i = 1, size(finer%parts)
         select type (solver => finer%parts(i)%solver)
         type is (cvode_t)
            solver%rtol = solver%rtol/100
            solver%atol = solver%atol/100
            solver%max_steps = 10*solver%max_steps
         end select
      end do
      associate (rtol => finer%parts(1)%solver%relative_error())
         reference = 'a tolerance of '//to_text(rtol)
         call fit(finer, size(found%residual), start, options_t(relative_error=rtol, &
            check=.false.), better, error)
      end associate
      if (allocated(error)) error%message = 'the error of the integrator cannot be measured, '// &
         'because the fit with '//reference//' failed: '//error%message
   end subroutine refit

end module beamid_verification
