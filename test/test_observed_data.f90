!> Two kinds of observed data that only this test has: static deflections and natural frequencies.
module other_kinds
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_observed_data, only: observed_data_t, seen_modes_t, trial_t
   use beamid_responses, only: exact_solver_t, work_t
   use beamid_structure, only: of_E
   implicit none
   private

   public :: deflections_t, frequencies_t

   !> Deflections under a known static force at the tip [length].
   type, extends(observed_data_t) :: deflections_t
      real(wp) :: force = 0                !< [force]
      real(wp), allocatable :: places(:)   !< (m) distances from the root [length]
   contains
      procedure :: evaluate => evaluate_deflections
   end type deflections_t

   !> The lowest natural frequencies [1/time].
   type, extends(observed_data_t) :: frequencies_t
   contains
      procedure :: evaluate => evaluate_frequencies
   end type frequencies_t

contains

   !> Of the parameters in this test, the deflections of a clamped beam depend on E alone.
   subroutine evaluate_deflections(self, trial, y, dy, linear, work, error, first)
      class(deflections_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      integer :: k

      if (trial%offset) call failure(error, 'deflections have no offset')
      y = [(self%force*trial%structure%static_deflection(self%places(k)), k=1, size(y))]
      do k = 1, size(trial%parameters)
         dy(:, k) = merge(-y/trial%structure%E, 0*y, trial%parameters(k) == of_E)
      end do
      y = y - self%measured
   end subroutine evaluate_deflections

   subroutine evaluate_frequencies(self, trial, y, dy, linear, work, error, first)
      class(frequencies_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
      type(equations_t), target :: equations
      complex(wp) :: s(size(y)), ds(size(y), size(trial%parameters))

      equations = new_equations(trial%model%galerkin, trial%structure, trial%excitation)
      select type (solver => trial%model%solver)
      class is (exact_solver_t)
         call solver%free_motion(equations, trial%parameters, s, ds, work, error)
      class default
         call failure(error, 'this method has no modes')
      end select
      if (allocated(error)) return
      y = aimag(s)/two_pi - self%measured
      dy = aimag(ds)/two_pi
   end subroutine evaluate_frequencies

end module other_kinds

!> Fits to data that are not time records use the interface of observed data alone.
program test_observed_data
   use beamid_autoregression, only: autoregression_t, new_autoregression
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_free, new_pulse, new_release
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, stage_fit_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish
   use free_decays, only: first_offset, formulas, made, mesh, noise_of, noisy, stamps, &
      true_offset, truth
   use models, only: model_of, stage_of
   use other_kinds, only: deflections_t, frequencies_t
   implicit none

   integer, parameter :: places = 20
   real(wp), parameter :: deflection_noise = 2e-5_wp

   call test_deflections()
   call test_both()
   call test_beginning()
   call test_frequencies()
   call test_white()
   call finish('observed_data')

contains

   !> The deflections of the true strip under 1 N at its tip, F x^2 (3 l - x)/(6 E I), with noise.
   function bent() result(experiment)
      type(experiment_t) :: experiment
      type(deflections_t), allocatable :: deflections
      integer :: k

      allocate (deflections)
      deflections%force = 1
      deflections%places = truth%length*[(k, k=1, places)]/places
      associate (x => deflections%places)
         experiment%measured = deflections%force*x**2*(3*truth%length - x)/(6*truth%E*truth%I) &
            + gaussian_noise(places, deflection_noise, 5)
      end associate
      experiment%excitation = new_pulse(0.0_wp, 1.0_wp)
      call move_alloc(deflections, experiment%observed)
   end function bent

   !> A free decay of the true strip with noise.
   function decay() result(experiment)
      type(experiment_t) :: experiment

      experiment = made(truth, new_release(0.02_wp, 0.0_wp, .true.), formulas(3), stamps(200, &
         0.5_wp, 3))
      experiment = noisy(experiment, gaussian_noise(200, noise_of(experiment), 53))
   end function decay

   !> Deflections are proportional to 1/E, so the least squares have a closed solution.
   subroutine test_deflections()
      type(experiment_t) :: experiments(1)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: w(:)
      real(wp) :: E, J
      integer :: k

      experiments(1) = bent()
      call identify(model_of(truth, new_pulse(0.0_wp, 1.0_wp), formulas(3)), mesh, &
         [stage_of(['E'], [1.3_wp*truth%E])], experiments, fits, error)
      call check('deflections: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      w = [(truth%static_deflection(k*truth%length/places), k=1, places)]
      associate (z => experiments(1)%measured, found => fits(1))
         E = truth%E*sum(w**2)/sum(w*z)
         J = sum((w*truth%E/E - z)**2)
         ! The search ends within 1e-6 standard errors of the minimum.
         call check_close('deflections: E', (found%fit%estimate(1) - E) &
            /found%statistics%std_error(1), 0.0_wp, 1e-5_wp)
         call check_close('deflections: J', found%fit%J/J, 1.0_wp, 1e-10_wp)
         call check_close('deflections: standard error', found%statistics%std_error(1)/E, &
            sqrt(J/(places - 1)/sum((w*truth%E/E)**2)), 1e-9_wp)
         call check('deflections: exact derivatives', found%fit%derivative_check(1) < 1e-6_wp)
      end associate
   end subroutine test_deflections

   !> A free decay and deflections determine E and rho together. The offset and the amplitudes
   !> belong to the decay alone. The noise of both records is estimated.
   subroutine test_both()
      type(experiment_t) :: experiments(2)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp), parameter :: exact(4) = [truth%E, truth%rho, truth%c_D, truth%gamma]

      experiments(1) = decay()
      experiments(2) = bent()
      call identify(model_of(truth, new_free(2), formulas(3)), mesh, [stage_of([character(len=5) &
         :: 'E', 'rho', 'c_D', 'gamma'], exact*[1.01_wp, 1.01_wp, 1.2_wp, 0.8_wp], .true.)], &
         experiments, fits, error)
      call check('both: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      associate (q => fits(1)%quantities, found => fits(1)%statistics)
         call check('both: unknowns', size(q) == 9 .and. count(q%name == 'offset(1)') == 1, &
            to_text(size(q)))
         call check('both: data', found%samples == 200 + places)
         ! 4.5 standard errors: once in a hundred thousand.
         call check_close('both: estimates, in standard errors', &
            maxval(abs(q(:4)%value - exact)/found%std_error(:4)), 0.0_wp, 4.5_wp)
         call check_close('both: offset, in standard errors', (q(9)%value - true_offset) &
            /found%std_error(9), 0.0_wp, 4.5_wp)
         ! The deflections alone leave this error of E, the decay alone a larger one.
         call check('both: the deflections determine E', found%std_error(1)/truth%E < 2e-3_wp, &
            to_text(found%std_error(1)/truth%E))
         ! 20 values give their standard deviation within 16 %; four times as much.
         call check_close('both: noise of the deflections', log(fits(1)%weight(2) &
            *deflection_noise), 0.0_wp, 0.64_wp)
      end associate
   end subroutine test_both

   !> The beginning of a fit shortens time records only.
   subroutine test_beginning()
      type(residual_t) :: problem, part
      type(error_t), allocatable :: error
      type(experiment_t) :: experiments(2)

      experiments(1) = decay()
      experiments(2) = bent()
      call new_residuals(model_of(truth, new_free(2), formulas(3)), mesh, experiments, problem, &
         error)
      call check('beginning: prepared', .not. allocated(error))
      if (allocated(error)) return
      part = problem%beginning(0.5_wp)
      associate (t => experiments(1)%samples)
         call check('beginning: rows', problem%samples() == 200 + places .and. part%samples() &
            == count(t <= (t(1) + t(200))/2) + places .and. size(part%parts(2)%observed%measured) &
            == places)
      end associate
   end subroutine test_beginning

   !> The natural frequencies of a clamped beam, (beta l)^2 sqrt(E I/(rho l^4))/(2 pi), give E back
   !> up to the error of the mesh. Cubic splines change (beta l)^4, and with it E, by (beta h)^4/720
   !> to leading order; twice that is allowed.
   subroutine test_frequencies()
      real(wp), parameter :: beta(2) = [1.8751040687119611_wp, 4.6940911329741746_wp]
      integer, parameter :: elements = 16
      type(structure_t) :: strip
      type(experiment_t) :: experiments(1)
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error

      strip%length = truth%length
      strip%rho = truth%rho
      strip%E = truth%E
      strip%I = truth%I
      experiments(1)%excitation = new_pulse(0.0_wp, 1.0_wp)
      experiments(1)%measured = beta**2*sqrt(strip%E*strip%I/strip%rho)/strip%length**2 &
         /(2*acos(-1.0_wp))
      allocate (frequencies_t :: experiments(1)%observed)
      call identify(model_of(strip, new_pulse(0.0_wp, 1.0_wp), formulas(3)), &
         mesh_t(3, elements, 4, 1), [stage_of(['E'], [1.3_wp*strip%E])], experiments, fits, error)
      call check('frequencies: the fit converges', .not. allocated(error))
      if (allocated(error)) return
      call check_close('frequencies: E', fits(1)%fit%estimate(1)/strip%E, 1.0_wp, &
         2*(beta(2)/elements)**4/720)
      call check('frequencies: exact derivatives', fits(1)%fit%derivative_check(1) < 1e-6_wp)
   end subroutine test_frequencies

   !> Noise without an order in time is white.
   subroutine test_white()
      type(autoregression_t) :: noise
      real(wp) :: r(60), whitened(60)
      integer :: k

      r = [(sin(0.1_wp*k), k=1, 60)]
      noise = new_autoregression(r, [real(wp) ::], white=.false.)
      whitened = r
      call noise%whiten(whitened)
      call check('white noise: unchanged', noise%order == 0 .and. all(abs(whitened - r) <= 0))
   end subroutine test_white

end program test_observed_data
