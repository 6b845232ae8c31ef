!> The lowest roots of the model of a record, and where start values may lie.
module beamid_model_roots
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_parameters, only: free_magnitude, on_beam, parameters
   use beamid_priors, only: prior_t, priors_of
   use beamid_residuals, only: residual_t
   use beamid_responses, only: exact_solver_t
   use beamid_structure, only: of_E, of_length, of_rho
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: model_roots, damps, belief_t, beliefs_about

   !> What is thought of a parameter before its record is seen: x has a standard deviation about the
   !> x of the start, the logarithm of the parameter where that has one and is no place.
   type :: belief_t
      logical :: logarithmic = .false.
      real(wp) :: centre = 0      !< the start
      real(wp) :: width = 1       !< standard deviation of x
      logical :: stated = .false. !< by the user, who holds it as determined by that
   contains
      procedure :: x_of
      procedure :: value_of
      procedure :: slope
   end type belief_t

contains

   !> The lowest oscillating roots of the model of record r in a scenario, and their derivatives by
   !> what is free, 0 by what belongs to another record.
   !>
   !> s   (modes) [1/time]
   !> ds  (modes, free)
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

   !> Whether a parameter moves roots along the real axis.
   pure logical function damps(ds)
      complex(wp), intent(in) :: ds(:)

      damps = all(abs(real(ds)) >= abs(aimag(ds))) .and. any(abs(ds) > 0)
   end function damps

   !> What is believed of parameters that have some values, where it is not stated: a modulus to
   !> 30 %, a mass per length to 10 %, lengths and places to some per cent of the beam, everything
   !> else to a factor e.
   !>
   !> free, records, starts  (n) parameters, the record of each, or 0, and values
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
               ! A support is moved about, a sensor is mounted once.
               b%width = merge(0.1_wp, 0.03_wp, parameters(p)%group == 'support')*s%length
            else if (.not. b%logarithmic) then
               b%width = max(b%centre, free_magnitude(s, scenario%excitations(r), p))
            end if
         end associate
      end do
   end function beliefs_about

   elemental real(wp) function x_of(self, value)
      class(belief_t), intent(in) :: self
      real(wp), intent(in) :: value

      x_of = value
      if (self%logarithmic) x_of = log(max(value, 1e-30_wp*self%centre))
   end function x_of

   elemental real(wp) function value_of(self, x)
      class(belief_t), intent(in) :: self
      real(wp), intent(in) :: x

      value_of = x
      if (self%logarithmic) value_of = exp(x)
   end function value_of

   !> d value/d x
   elemental real(wp) function slope(self, value)
      class(belief_t), intent(in) :: self
      real(wp), intent(in) :: value

      slope = merge(value, 1.0_wp, self%logarithmic)
   end function slope

end module beamid_model_roots
