!> Roots of the model and expected parameter values, for the search for start values.
!>
!> The search compares the roots of the model with the spectral lines of a record. It keeps each
!> parameter near the value that is expected before the record is seen.
module beamid_model_roots
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_parameters, only: on_beam, parameters
   use beamid_priors, only: prior_t, priors_of
   use beamid_residuals, only: residual_t
   use beamid_responses, only: exact_solver_t
   use beamid_structure, only: of_E, of_length, of_rho
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: model_roots, damps, belief_t, beliefs_about

   !> The expectation of a parameter before its record is seen, in the form of a normal
   !> distribution.
   !>
   !> The distribution is that of x: the logarithm of the parameter if `logarithmic`, else the
   !> parameter itself.
   type :: belief_t
      !> x is the logarithm; .false. for places along the beam, reciprocals and a `centre` of 0
      logical :: logarithmic = .false.
      real(wp) :: centre = 0      !< expected value of the parameter: the prior mean, or the start
      real(wp) :: width = 1       !< standard deviation of x
      !> the user states it by a prior, which therefore counts as determining the parameter
      logical :: stated = .false.
   contains
      procedure :: x_of
      procedure :: value_of
      procedure :: nearby_value
      procedure :: slope
   end type belief_t

contains

   !> Computes the lowest oscillating roots of the model of one record, and their derivatives.
   !>
   !> problem   fit whose parameters are free; supplies mesh and solver of the record
   !> scenario  structures and excitations at which the roots are computed
   !> r         number of the record
   !> s         (modes) roots, in ascending order [1/time]
   !> ds        (modes, free) derivatives with respect to the free parameters; 0 for parameters of
   !>           other records
   !> error     the solver has no modes, or there are fewer modes than asked for
   subroutine model_roots(problem, scenario, r, s, ds, error)
      type(residual_t), intent(inout), target :: problem
      type(scenario_t), intent(in) :: scenario
      integer, intent(in) :: r
      complex(wp), intent(out) :: s(:), ds(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations
      integer :: p

      equations = new_equations(problem%parts(r)%galerkin, scenario%structures(r), &
         scenario%excitations(r))
      select type (solver => problem%parts(r)%solver)
      class is (exact_solver_t)
         call solver%free_motion(equations, problem%free, s, ds, problem%work, error)
      class default
         call failure(error, 'start values: from a record only the modal response finds them')
      end select
      if (allocated(error)) return
      do p = 1, size(problem%free)
         if (all(problem%record(p) /= [0, r])) ds(:, p) = 0
      end do
   end subroutine model_roots

   !> Tells whether a parameter moves roots mainly along the real axis, so that it acts as damping.
   !>
   !> ds  derivatives of roots with respect to the parameter
   pure logical function damps(ds)
      complex(wp), intent(in) :: ds(:)

      damps = all(abs(real(ds)) >= abs(aimag(ds))) .and. any(abs(ds) > 0)
   end function damps

   !> Returns the expectation of each parameter.
   !>
   !> A prior of the user counts first. Otherwise the standard deviation is 30 % for a modulus and
   !> 10 % for a mass per length. It is 2 % for the length of the beam, 10 % of the length for the
   !> place of a support and 3 % for other places. All other parameters are expected to within a
   !> factor e, or, if they start from 0 or are reciprocals, to within a moderate value.
   !>
   !> free, records  (n) numbers of the parameters, and the record of each (0: all)
   !> starts         (n) their start values
   pure function beliefs_about(scenario, free, records, starts, priors) result(beliefs)
      type(scenario_t), intent(in) :: scenario
      integer, intent(in) :: free(:), records(:)
      real(wp), intent(in) :: starts(:)
      type(prior_t), intent(in) :: priors(:)
      type(belief_t) :: beliefs(size(starts))
      integer :: k, r, stated(size(starts))

      stated = priors_of(priors, free, records)
      beliefs%centre = starts
      do k = 1, size(starts)
         if (stated(k) > 0) beliefs(k)%centre = priors(stated(k))%centre_in(records(k))
      end do
      do k = 1, size(starts)
         r = max(1, records(k))
         associate (b => beliefs(k), p => free(k), s => scenario%structures(r))
            b%logarithmic = b%centre > 0 .and. parameters(p)%range /= on_beam .and. &
               .not. parameters(p)%is_reciprocal
            b%stated = stated(k) > 0
            if (b%stated) then
               b%width = priors(stated(k))%width(b%centre)
               if (b%logarithmic) b%width = b%width/b%centre
            else if (p == of_E) then
               b%width = 0.3_wp
            else if (p == of_rho) then
               b%width = 0.1_wp
            else if (p == of_length) then
               b%width = 0.02_wp
            else if (parameters(p)%range == on_beam) then
               ! Supports are moved between records; a sensor is mounted once.
               b%width = merge(0.1_wp, 0.03_wp, parameters(p)%group == 'support')*s%length
            else if (.not. b%logarithmic) then
               b%width = max(b%centre, scenario%magnitude_of(p, r))
            end if
         end associate
      end do
   end function beliefs_about

   !> Returns the coordinate x of a parameter value.
   elemental real(wp) function x_of(self, value)
      class(belief_t), intent(in) :: self
      real(wp), intent(in) :: value

      x_of = value
      if (self%logarithmic) x_of = log(max(value, 1e-30_wp*self%centre))
   end function x_of

   !> Returns the parameter value at the coordinate x.
   elemental real(wp) function value_of(self, x)
      class(belief_t), intent(in) :: self
      real(wp), intent(in) :: x

      value_of = x
      if (self%logarithmic) value_of = exp(x)
   end function value_of

   !> Returns a value one standard deviation away from the expected one: below it, because a place
   !> may be the end of the beam, unless that would be negative.
   elemental real(wp) function nearby_value(self) result(value)
      class(belief_t), intent(in) :: self

      associate (x => self%x_of(self%centre))
         value = self%value_of(x - self%width)
         if (value < 0) value = self%value_of(x + self%width)
      end associate
   end function nearby_value

   !> Returns the derivative d value/d x.
   elemental real(wp) function slope(self, value)
      class(belief_t), intent(in) :: self
      real(wp), intent(in) :: value

      slope = merge(value, 1.0_wp, self%logarithmic)
   end function slope

end module beamid_model_roots
