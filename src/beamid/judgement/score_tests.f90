!> Score tests: would another parameter, which the model leaves out, improve the fit significantly?
!>
!> If the residuals of the fit are white, the model lacks little. One derivative of the residuals
!> for each candidate then suffices; nothing is fitted again. Let r be the residuals of the fit, J
!> their derivatives with respect to the estimated quantities, and d those with respect to the
!> candidate. The score is g'r with g = d - J (J'J)**-1 J'd, the part of d that is orthogonal to the
!> columns of J. Its mean is 0 if the candidate has the value of the model. One Gauss-Newton step
!> with the candidate free changes the candidate by -g'r/|g|**2, and the estimates by
!> (J'J)**-1 J'd g'r/|g|**2 (Rao's score test; Cox and Hinkley, Theoretical Statistics, 1974,
!> section 9.3).
!>
!> If the residuals are not white, model and record may drift apart by several periods of a mode. A
!> derivative, being local, cannot predict so large a change. The stage is then fitted again with
!> the candidate free, from start values that the record gives, and the likelihood ratio is tested.
!>
!> The model's value of a candidate with a prior has an error of its own. The variance of this prior
!> adds to that of the change, so that a change that the prior allows is not significant. The errors
!> of the estimates include it already (`beamid_held_errors`).
module beamid_score_tests
   use beamid_distributions, only: chi_square_tail
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: run_stages
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: name_of_parameter
   use beamid_parameters, only: on_beam, parameters
   use beamid_priors, only: priors_of
   use beamid_record_errors, only: differentiate_error, errors_of
   use beamid_residuals, only: residual_t
   use beamid_scores, only: chance, find_largest_shift, is_testable, large_shift, score_test_t, &
      test
   use beamid_simulation, only: model_t
   use beamid_stage_fits, only: significant_decrease, stage_fit_t
   use beamid_structure, only: J_S_at, m_S_at, no_spring, of_c_D, of_eta, of_gamma, of_kappa_R, &
      structure_t, x_S_at, yielding
   use beamid_unknowns, only: stage_t
   use beamid_verification, only: exact_counterpart
   use beamid_whiteness, only: effective_samples
   implicit none
   private

   public :: score_test_t, test_candidates

contains

   !> Tests k_R, J_S, gamma, c_D and x_S, eta if no record is a function of time, and the errors of
   !> each record (`errors_of`), as far as the fit has not estimated them. J_S and x_S are those of
   !> the sensor of the first record.
   !>
   !> fit    result of one stage, with statistics
   !> tests  in the order above; of size 0 if the fit has no degree of freedom, no free parameter or
   !>        no noise, has fixed a parameter of its stage, or has no exact response
   !> error  the response cannot be computed
   subroutine test_candidates(model, mesh, experiments, fit, tests, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      type(score_test_t), allocatable, intent(out) :: tests(:)
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: problem
      real(wp), allocatable :: d(:)
      integer, allocatable :: candidates(:)
      logical, allocatable :: is_in_time(:)
      real(wp) :: largest
      integer :: k

      allocate (tests(0))
      if (.not. is_testable(experiments, fit)) return
      call exact_counterpart(model, mesh, experiments, [fit%free, of_kappa_R], problem)
      if (.not. allocated(problem%parts)) return
      call fit%restore(problem)
      do k = 1, size(problem%scenario%structures)
         problem%scenario%structures(k)%yields = yielding([fit%free, of_kappa_R])
      end do
      is_in_time = [(.not. allocated(experiments(k)%observed), k=1, size(experiments))]
      call choose_candidates(fit, fit%scenario%structures(1), any(is_in_time), candidates)
      deallocate (tests)
      allocate (tests(size(candidates)))
      do k = 1, size(candidates)
         call differentiate(problem, fit, candidates(k), d, error)
         if (allocated(error)) return
         associate (s => fit%scenario%structures(1), p => candidates(k))
            tests(k)%name = name_of_parameter(s, p)
            tests(k)%parameter = p
            ! No candidate may be negative.
            largest = merge(s%length, huge(largest), parameters(p)%range == on_beam)
            call test(fit, d, s%get(p), [0.0_wp, largest], sd=prior_error(problem, p), &
               one=tests(k))
            ! For several records each search takes longer than their fit. A clamp that yields is
            ! the usual cause if one model cannot explain them all.
            if ((.not. fit%check%white .or. fit%statistics%is_exceeded) .and. &
               (size(experiments) == 1 .or. p == of_kappa_R)) &
               call refit(model, mesh, experiments, fit, p, prior_error(problem, p), tests(k))
            ! The search works with the compliance of a spring.
            if (parameters(p)%is_reciprocal .and. tests(k)%value > 0) &
               tests(k)%value = 1/tests(k)%value
         end associate
      end do
      call test_records(experiments, fit, .not. problem%offset, tests)
      call decide(fit, tests)
   end subroutine test_candidates

   !> Tests the errors that each record may have.
   !>
   !> offset  whether the offset is to be tested
   !> tests   to which these tests are added
   subroutine test_records(experiments, fit, offset, tests)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      logical, intent(in) :: offset
      type(score_test_t), allocatable, intent(inout) :: tests(:)
      type(score_test_t), allocatable :: more(:)
      character(len=6), allocatable :: names(:)
      real(wp) :: d(size(fit%jacobian, 1)), least, value
      integer :: first, j, k, last, n

      n = size(tests)
      allocate (more(n + sum([(size(errors_of(experiments(k), offset)), k=1, size(experiments))])))
      more(:n) = tests
      last = 0
      do k = 1, size(experiments)
         first = last + 1
         last = last + size(experiments(k)%measured)
         names = errors_of(experiments(k), offset)
         do j = 1, size(names)
            d = 0
            call differentiate_error(experiments(k), names(j), fit%residual(first:last), value, &
               least, d(first:last))
            d = fit%weight(k)*d
            n = n + 1
            more(n)%name = names(j)
            more(n)%record = k
            call test(fit, d, value, [least, huge(d)], sd=0.0_wp, one=more(n))
         end do
      end do
      call move_alloc(more, tests)
   end subroutine test_records

   !> Lists the parameters to test: those that the structure has and the fit has not estimated.
   !>
   !> in_time  whether any record is a function of time, for which eta is not defined
   subroutine choose_candidates(fit, structure, in_time, candidates)
      type(stage_fit_t), intent(in) :: fit
      type(structure_t), intent(in) :: structure
      logical, intent(in) :: in_time
      integer, allocatable, intent(out) :: candidates(:)
      logical :: is_known
      integer :: k

      associate (all_of_them => [of_kappa_R, J_S_at(structure%observer), of_gamma, of_c_D, &
         x_S_at(structure%observer), of_eta])
         candidates = pack(all_of_them, [(all(fit%free /= all_of_them(k)), &
            k=1, size(all_of_them))])
      end associate
      associate (x_S => x_S_at(structure%observer), structures => fit%scenario%structures)
         ! Without x_S the sensor is at the tip by definition, unless it has a mass.
         is_known = structure%follows_tip(x_S) .and. &
            .not. structure%get(m_S_at(structure%observer)) > 0
         ! Sensors at several positions have no common error.
         if (is_known .or. any([(abs(structures(k)%get(x_S) - structure%get(x_S)) > 0, &
            k=1, size(structures))])) candidates = pack(candidates, candidates /= x_S)
      end associate
      if (in_time) candidates = pack(candidates, candidates /= of_eta)
      ! A root that turns freely has no spring to test.
      if (structure%get(of_kappa_R) >= no_spring) candidates = pack(candidates, &
         candidates /= of_kappa_R)
   end subroutine choose_candidates

   !> Differentiates the residuals of the fit with respect to a parameter that it has not estimated.
   !>
   !> d  (rows) derivatives; 0 in the rows of priors and penalties
   subroutine differentiate(problem, fit, parameter, d, error)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: parameter
      real(wp), allocatable, intent(out) :: d(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: r(problem%samples()), jac(problem%samples(), 1)
      real(wp), allocatable :: c(:)

      call set_free(problem, fit%again())
      problem%free = [parameter]
      problem%record = [0]
      allocate (c(problem%linear_unknowns()))
      call problem%evaluate([problem%scenario%structures(1)%get(parameter)], r, jac, error, c)
      if (allocated(error)) return
      allocate (d(size(fit%jacobian, 1)), source=0.0_wp)
      d(:size(r)) = jac(:, 1)
   end subroutine differentiate

   !> Fits again with a candidate free and replaces the result of the score test. Keeps that result
   !> if the fit fails or fixes a parameter.
   !>
   !> sd  standard deviation of the candidate's value in the model
   subroutine refit(model, mesh, experiments, fit, parameter, sd, one)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: parameter
      real(wp), intent(in) :: sd
      type(score_test_t), intent(inout) :: one
      type(stage_t) :: stage, alone
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: after, before, change, ratio
      integer :: first, last, n, r

      n = size(fit%free)
      stage = fit%again()
      alone%free = [parameter]
      call alone%set_bounds()
      stage%record = [stage%owners(), 0]
      stage%free = [stage%free, parameter]
      stage%lower = [stage%lower, alone%lower]
      stage%upper = [stage%upper, alone%upper]
      stage%automatic = .true.
      stage%is_whole = .true.
      call run_stages(model, mesh, [stage], experiments, fits, error, check=.false.)
      if (allocated(error)) return
      if (size(fits(1)%free) /= n + 1) return
      before = 0
      after = 0
      ratio = 0
      first = 1
      do r = 1, size(experiments)
         last = first + size(experiments(r)%measured) - 1
         associate (old => fit%residual(first:last), new => fits(1)%residual(first:last))
            before = before + (fit%weight(r)*norm2(old))**2
            after = after + (fit%weight(r)*norm2(new))**2
            ratio = ratio + effective_samples(new)*log(sum(old**2)/sum(new**2))
         end associate
         first = last + 1
      end do
      ! A search that ends with a larger sum has not found the minimum with one more parameter.
      if (.not. after < before) return
      one%value = fits(1)%fit%estimate(n + 1)
      change = abs(one%value - fit%scenario%structures(1)%get(parameter))
      one%shift(:n) = fits(1)%fit%estimate(:n) - fit%fit%estimate
      ! The ratio is the square of the change over its standard error.
      if (sd > 0) ratio = ratio/(1 + ratio*(sd/max(change, tiny(sd)))**2)
      one%p_value = chi_square_tail(max(0.0_wp, ratio), 1.0_wp)
      one%decrease = 1 - after/before
      call find_largest_shift(fit, one)
   end subroutine refit

   !> Returns the standard deviation of a candidate by its prior; 0 if it has none.
   pure real(wp) function prior_error(problem, parameter) result(sd)
      type(residual_t), intent(in) :: problem
      integer, intent(in) :: parameter
      integer :: stated(1)

      sd = 0
      stated = priors_of(problem%priors, [parameter], [0])
      if (stated(1) == 0) return
      associate (prior => problem%priors(stated(1)))
         sd = prior%width(prior%centre_in(0))
      end associate
   end function prior_error

   !> Decides which tests reject the model: they are significant by Bonferroni's correction for
   !> their number, and a finer mesh does not reduce J by half as much or more. The residuals that
   !> such a candidate explains are errors of the mesh, which the intervals include. After a
   !> rejection the true cause may be any candidate, or none: each that is significant alone counts.
   subroutine decide(fit, tests)
      type(stage_fit_t), intent(in) :: fit
      type(score_test_t), intent(inout) :: tests(:)
      real(wp), parameter :: chance_alone = 0.05_wp   ! of each test after a rejection
      logical :: counts(size(tests))

      counts = (tests%moves > large_shift .or. tests%decrease > significant_decrease) .and. &
         (tests%name == 'offset' .or. tests%decrease > 2*fit%mesh_decrease)
      ! The penalty on a field distorts the motion as if its size were another one.
      if (any(fit%strength > 0)) counts = counts .and. tests%name /= 'scale' .and. &
         tests%name /= 'delay'
      ! A clamp whose stiffness vanishes is not a clamp.
      where (tests%parameter == of_kappa_R) counts = counts .and. tests%value > 0
      tests%rejects = counts .and. tests%p_value < chance/max(1, size(tests))
      ! An offset shifts hardly anything else, and nothing else looks like an offset.
      tests%matters = tests%rejects .or. any(tests%rejects .and. tests%name /= 'offset') .and. &
         counts .and. tests%p_value < chance_alone .and. tests%name /= 'offset'
   end subroutine decide

end module beamid_score_tests
