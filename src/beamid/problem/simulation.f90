!> The model of an experiment with a known start, and what it computes.
module beamid_simulation
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_observation, only: new_sampling, observation_t, sampling_t
   use beamid_priors, only: prior_t
   use beamid_responses, only: prepare_for, response_t, solver_t, work_t
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: model_t, simulation_t, simulate

   !> What turns parameters into accelerations, mesh apart.
   type :: model_t
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(observation_t) :: observation
      class(solver_t), allocatable :: solver
      type(prior_t), allocatable :: priors(:)    !< what else is known; not allocated: nothing
   end type model_t

   !> A computed experiment.
   type :: simulation_t
      type(response_t) :: response               !< at the sample times
      real(wp), allocatable :: acceleration(:)   !< by the formula of the observation
      real(wp), allocatable :: force(:)          !< on the tip, at the sample times [force]
      type(work_t) :: work
   end type simulation_t

contains

   !> Response and observed acceleration at given times.
   !>
   !> samples  ascending [time]
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
      type(response_t) :: wide
      class(solver_t), allocatable :: solver

      galerkin = galerkin_of(mesh, model%structure)
      solver = model%solver
      call prepare_for(galerkin, solver, error)
      if (allocated(error)) return
      excitation = model%excitation
      structure = model%structure
      if (allocated(excitation%x_F)) structure%x_F = excitation%x_F
      call excitation%fit_to(structure%stiffness())
      equations = new_equations(galerkin, structure, excitation)
      sampling = new_sampling(model%observation, samples)
      call solver%respond(equations, excitation, sampling%times, wide, simulation%work, error)
      if (allocated(error)) return
      simulation%acceleration = sampling%acceleration(wide, excitation)
      simulation%response = sampling%at_samples(sampling%seen(wide, excitation))
      simulation%force = excitation%force(samples)
      if (excitation%is_release) then
         ! The motion is counted from the deflection before.
         simulation%force = simulation%force - excitation%f(1)
         simulation%response%displacement = simulation%response%displacement - excitation%f(1) &
            *structure%static_deflection(structure%sensor_place())
      end if
   end subroutine simulate

end module beamid_simulation
