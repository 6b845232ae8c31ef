!> Simulation: the response of a model with known parameters and a known initial state.
module beamid_simulation
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: coarsest, finest, galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_model_checks, only: check_model, check_times
   use beamid_modes, only: undamped_modes
   use beamid_observation, only: new_sampling, observation_t, sampling_t
   use beamid_priors, only: prior_t
   use beamid_responses, only: prepare_for, response_t, solver_t, work_t
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: model_t, simulation_t, simulate, simulate_converged, refine_for_modes

   !> Number of natural frequencies for which the commands `modes` and `frf` refine the mesh.
   integer, parameter, public :: lowest_modes = 10

   !> A model without its mesh: everything that turns parameters into accelerations.
   type :: model_t
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(observation_t) :: observation
      class(solver_t), allocatable :: solver
      type(prior_t), allocatable :: priors(:)   !< prior information; not allocated: none
   end type model_t

   !> The result of a simulation with m samples.
   type :: simulation_t
      type(response_t) :: response               !< at the sample times
      !> (m) acceleration by the observation formula [length/time**2]
      real(wp), allocatable :: acceleration(:)
      real(wp), allocatable :: force(:)         !< (m) force at x_F, or acceleration of the base
      type(work_t) :: work                      !< what the solver did
   end type simulation_t

contains

   !> Computes the response and the observed acceleration at given times.
   !>
   !> samples  (m) ascending [time]
   !> error    a model or times from which nothing can be computed; the solver cannot compute the
   !>          response
   subroutine simulate(model, mesh, samples, simulation, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(in) :: samples(:)
      type(simulation_t), intent(out) :: simulation
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(structure_t) :: structure
      type(sampling_t) :: sampling
      type(response_t) :: at_points
      class(solver_t), allocatable :: solver

      excitation = model%excitation
      structure = model%structure
      if (allocated(excitation%x_F)) structure%x_F = excitation%x_F
      call check_model(structure, model%solver, excitation, error)
      if (.not. allocated(error)) call check_times(samples, '', error)
      if (allocated(error)) return
      galerkin = galerkin_of(mesh, structure, fixed=.true.)
      solver = model%solver
      call prepare_for(galerkin, solver, error)
      if (allocated(error)) return
      call excitation%fit_to(structure%stiffness())
      equations = new_equations(galerkin, structure, excitation)
      sampling = new_sampling(model%observation, samples)
      call solver%respond(equations, excitation, sampling%times, at_points, simulation%work, error)
      if (allocated(error)) return
      simulation%acceleration = sampling%acceleration(at_points, excitation)
      simulation%response = sampling%at_samples(sampling%seen(at_points, excitation))
      simulation%force = excitation%force(samples)
      if (excitation%is_release) then
         ! A release is reported relative to the static deflection before it.
         simulation%force = simulation%force - excitation%f(1)
         simulation%response%displacement = simulation%response%displacement - excitation%f(1) &
            *structure%static_deflection(structure%sensor_place())
      end if
   end subroutine simulate

   !> Simulates on meshes of 8, 16, ... 128 elements until the acceleration no longer changes.
   !>
   !> samples    (m) ascending [time]
   !> noise_sd   of the noise that will be added [length/time**2]; 0: none. The rms of the change
   !>            may be a tenth of it, or without noise 1e-3 of the rms of the acceleration
   !> mesh       on return the last mesh
   !> remaining  rms of the last change [length/time**2]
   !> converged  .false.: the acceleration still changes by more at 128 elements
   !> error      the solver cannot compute the response
   subroutine simulate_converged(model, samples, noise_sd, mesh, simulation, remaining, converged, &
      error)
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: samples(:), noise_sd
      type(mesh_t), intent(inout) :: mesh
      type(simulation_t), intent(out) :: simulation
      real(wp), intent(out) :: remaining
      logical, intent(out) :: converged
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: share_of_noise = 0.1_wp, share_of_signal = 1e-3_wp
      real(wp), allocatable :: before(:)
      real(wp) :: allowed

      mesh%elements = coarsest
      remaining = 0
      converged = .false.
      do
         call simulate(model, mesh, samples, simulation, error)
         if (allocated(error)) return
         associate (a => simulation%acceleration, m => sqrt(real(max(1, size(samples)), wp)))
            allowed = share_of_noise*noise_sd
            if (.not. noise_sd > 0) allowed = share_of_signal*norm2(a)/m
            if (allocated(before)) then
               remaining = norm2(a - before)/m
               converged = remaining <= allowed
            end if
         end associate
         if (converged .or. mesh%elements >= finest) return
         before = simulation%acceleration
         mesh%elements = 2*mesh%elements
      end do
   end subroutine simulate_converged

   !> Doubles the number of elements until the lowest natural frequencies change no further, by 1 in
   !> 10,000.
   !>
   !> count      number of natural frequencies
   !> mesh       on return with the number of elements
   !> remaining  largest relative change in the last step; above 1e-4 if even the finest mesh does
   !>            not suffice
   subroutine refine_for_modes(structure, count, mesh, remaining, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: count
      type(mesh_t), intent(inout) :: mesh
      real(wp), intent(out) :: remaining
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: allowed = 1e-4_wp
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      real(wp), allocatable :: before(:), omega(:), shapes(:, :)
      integer :: n

      mesh%elements = coarsest
      remaining = huge(remaining)
      do
         galerkin = galerkin_of(mesh, structure, fixed=.true.)
         equations = new_equations(galerkin, structure)
         call undamped_modes(equations, omega, shapes, error)
         if (allocated(error)) return
         if (allocated(before)) then
            n = min(count, size(before))
            remaining = maxval(abs(before(:n) - omega(:n))/max(omega(:n), tiny(remaining)), &
               mask=omega(:n) > 0)
         end if
         if (remaining <= allowed .or. mesh%elements >= finest) return
         call move_alloc(omega, before)
         mesh%elements = 2*mesh%elements
      end do
   end subroutine refine_for_modes

end module beamid_simulation
