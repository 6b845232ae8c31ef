!> From a record to parameters: residuals of the model against the record, and the stages of a fit.
module beamid_identification
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_observation, only: observation_t, sampling_t, new_sampling
   use beamid_problems, only: problem_t
   use beamid_responses, only: response_t, solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_parameters, only: amplitude, free_magnitude, free_names, get_free, set_free
   use beamid_statistics, only: check_residuals, new_statistics, residual_check_t, statistics_t
   use beamid_structure, only: structure_t
   use beamid_variables, only: variable_t, new_variable
   implicit none
   private

   public :: model_t, stage_t, simulation_t, stage_fit_t, simulate, identify, identify_meshes, score_fits

   !> What turns parameters into accelerations, mesh apart.
   type :: model_t
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(observation_t) :: observation
      class(solver_t), allocatable :: solver
   end type model_t

   !> One search: which parameters are free and from where. Each array has one entry per parameter.
   type :: stage_t
      integer, allocatable :: free(:)     !< places in `free_names`
      real(wp), allocatable :: start(:)   !< not allocated: where the stage before ended
      real(wp), allocatable :: lower(:)
      real(wp), allocatable :: upper(:)   !< or `unbounded`
   end type stage_t

   !> A computed experiment.
   type :: simulation_t
      type(response_t) :: response               !< at the sample times
      real(wp), allocatable :: acceleration(:)   !< by the formula of the observation
      type(work_t) :: work
   end type simulation_t

   !> The outcome of one stage on one mesh.
   type :: stage_fit_t
      integer :: stage = 0
      integer :: elements = 0
      integer, allocatable :: free(:)
      type(fit_t) :: fit
      real(wp), allocatable :: lower(:), upper(:)   !< bounds of the search
      type(structure_t) :: structure     !< with the estimates in place
      type(excitation_t) :: excitation   !< likewise
      real(wp), allocatable :: scale(:)  !< what relative changes of the estimates are relative to
      type(statistics_t) :: statistics   !< `samples` is 0 where no degree of freedom was left
      type(residual_check_t) :: check
      real(wp) :: score = -1             !< squared residuals over another window; -1: not asked for
      type(work_t) :: work
   end type stage_fit_t

   !> Residuals model - record as a function of the free parameters.
   type, extends(problem_t) :: residual_t
      type(galerkin_t) :: galerkin
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      class(solver_t), allocatable :: solver
      type(sampling_t) :: sampling
      integer, allocatable :: free(:)
      real(wp), allocatable :: measured(:)
      type(work_t) :: work
   contains
      procedure :: residuals
      procedure :: has_jacobian
      procedure :: jacobian
   end type residual_t

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
      type(equations_t) :: equations
      type(sampling_t) :: sampling
      type(response_t) :: wide
      class(solver_t), allocatable :: solver

      galerkin = new_galerkin(mesh, model%structure%length, &
         model%structure%has_soft_root())
      solver = model%solver
      call solver%prepare(galerkin, error)
      if (allocated(error)) return
      equations = new_equations(galerkin, model%structure, model%excitation)
      sampling = new_sampling(model%observation, samples)
      call solver%respond(equations, model%excitation, sampling%times, wide, simulation%work, error)
      if (allocated(error)) return
      simulation%acceleration = sampling%acceleration(wide)
      simulation%response = sampling%at_samples(wide)
   end subroutine simulate

   !> Runs the stages in turn on one mesh, each from where the one before ended.
   !>
   !> samples   (m) ascending [time]
   !> measured  (m) record at the samples [length/time**2]
   !> fits      (size(stages)) allocated on success
   !> error     says which stage failed, and why
   !> monitor   told of every iteration
   subroutine identify(model, mesh, stages, samples, measured, fits, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stages(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(residual_t) :: problem
      type(options_t) :: options
      integer :: k

      problem%galerkin = new_galerkin(mesh, model%structure%length, &
         model%structure%has_soft_root())
      problem%structure = model%structure
      problem%excitation = model%excitation
      problem%solver = model%solver
      call problem%solver%prepare(problem%galerkin, error)
      if (allocated(error)) return
      problem%sampling = new_sampling(model%observation, samples)
      problem%measured = measured
      options%noise = model%solver%noise()
      allocate (fits(size(stages)))
      do k = 1, size(stages)
         problem%free = stages(k)%free
         problem%work = work_t()
         call fit(problem, size(samples), variables_of(stages(k), problem%structure, &
            problem%excitation), options, &
            fits(k)%fit, error, monitor, 'N = '//to_text(mesh%elements)// &
            ', stage '//to_text(k), free_names(stages(k)%free))
         if (allocated(error)) then
            error%message = 'elements = '//to_text(mesh%elements)//', stage '//to_text(k)//': '// &
               error%message
            return
         end if
         fits(k)%stage = k
         fits(k)%elements = mesh%elements
         fits(k)%free = stages(k)%free
         call set_all(problem%structure, problem%excitation, stages(k)%free, fits(k)%fit%estimate)
         fits(k)%structure = problem%structure
         fits(k)%excitation = problem%excitation
         fits(k)%scale = scales(problem%structure, problem%excitation, stages(k)%free)
         fits(k)%lower = stages(k)%lower
         fits(k)%upper = stages(k)%upper
         fits(k)%work = problem%work
         fits(k)%check = check_residuals(fits(k)%fit%residual)
         if (size(samples) > size(stages(k)%free)) call new_statistics(fits(k)%fit%jacobian, &
            fits(k)%fit%residual, fits(k)%fit%estimate, fits(k)%scale, fits(k)%statistics, error)
         if (allocated(error)) return
      end do
   end subroutine identify

   !> `identify` on each mesh, as many at a time as there are threads.
   !>
   !> fits  (size(stages), size(meshes)) allocated on success
   !> error that of the first mesh, in the order given, which failed
   subroutine identify_meshes(model, meshes, stages, samples, measured, fits, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      type(stage_t), intent(in) :: stages(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type :: outcome_t
         type(stage_fit_t), allocatable :: fits(:)
         type(error_t), allocatable :: error
      end type outcome_t
      type(outcome_t), allocatable :: outcomes(:)
      integer :: k

      ! The finest mesh takes longest: it goes first.
      allocate (outcomes(size(meshes)))
      !$omp parallel do schedule(dynamic, 1)
      do k = size(meshes), 1, -1
         call identify(model, meshes(k), stages, samples, measured, outcomes(k)%fits, &
            outcomes(k)%error, monitor)
      end do
      !$omp end parallel do
      do k = 1, size(meshes)
         if (.not. allocated(outcomes(k)%error)) cycle
         call move_alloc(outcomes(k)%error, error)
         return
      end do
      allocate (fits(size(stages), size(meshes)))
      do k = 1, size(meshes)
         fits(:, k) = outcomes(k)%fits
      end do
   end subroutine identify_meshes

   !> Adds up the squared residuals of each fit over other samples than it was made from.
   !>
   !> meshes    (k) of the fits
   !> samples   (m) ascending [time]
   !> measured  (m) record at the samples [length/time**2]
   !> fits      (stages, k) component `score` is set
   subroutine score_fits(model, meshes, samples, measured, fits, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), intent(inout) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: fitted
      type(simulation_t) :: simulation
      integer :: mesh, stage

      fitted = model
      do mesh = 1, size(fits, 2)
         do stage = 1, size(fits, 1)
            fitted%structure = fits(stage, mesh)%structure
            fitted%excitation = fits(stage, mesh)%excitation
            call simulate(fitted, meshes(mesh), samples, simulation, error)
            if (allocated(error)) return
            fits(stage, mesh)%score = sum((simulation%acceleration - measured)**2)
         end do
      end do
   end subroutine score_fits

   !> Starts, bounds and scales of a stage's parameters.
   pure function variables_of(stage, structure, excitation) result(variables)
      type(stage_t), intent(in) :: stage
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      type(variable_t), allocatable :: variables(:)
      real(wp) :: start
      integer :: k

      allocate (variables(size(stage%free)))
      do k = 1, size(stage%free)
         start = get_free(structure, excitation, stage%free(k))
         if (allocated(stage%start)) start = stage%start(k)
         start = min(max(start, stage%lower(k)), stage%upper(k))
         variables(k) = new_variable(start, stage%lower(k), stage%upper(k), &
            free_magnitude(structure, excitation, stage%free(k)))
      end do
   end function variables_of

   !> Values of the free parameters, or where they are zero moderate ones.
   pure function scales(structure, excitation, free)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: free(:)
      real(wp) :: scales(size(free))
      integer :: k

      do k = 1, size(free)
         scales(k) = abs(get_free(structure, excitation, free(k)))
         if (.not. scales(k) > 0) scales(k) = free_magnitude(structure, excitation, free(k))
      end do
   end function scales

   !> Gives the free parameters their values.
   pure subroutine set_all(structure, excitation, free, values)
      type(structure_t), intent(inout) :: structure
      type(excitation_t), intent(inout) :: excitation
      integer, intent(in) :: free(:)
      real(wp), intent(in) :: values(:)
      integer :: k

      do k = 1, size(free)
         call set_free(structure, excitation, free(k), values(k))
      end do
   end subroutine set_all

   subroutine residuals(self, parameters, r, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      type(response_t) :: response
      type(equations_t) :: equations
      type(structure_t) :: structure
      type(excitation_t) :: excitation

      structure = self%structure
      excitation = self%excitation
      call set_all(structure, excitation, self%free, parameters)
      equations = new_equations(self%galerkin, structure, excitation)
      call self%solver%respond(equations, excitation, self%sampling%times, response, self%work, &
         error)
      if (allocated(error)) return
      r = self%sampling%acceleration(response) - self%measured
   end subroutine residuals

   pure logical function has_jacobian(self)
      class(residual_t), intent(in) :: self

      has_jacobian = self%solver%is_exact()
   end function has_jacobian

   subroutine jacobian(self, parameters, r, jac, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(equations_t) :: equations
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      integer :: k

      structure = self%structure
      excitation = self%excitation
      call set_all(structure, excitation, self%free, parameters)
      equations = new_equations(self%galerkin, structure, excitation)
      call self%solver%differentiate(equations, excitation, self%sampling%times, self%free, &
         response, slopes, self%work, error)
      if (.not. allocated(error) .and. any(self%free == amplitude)) then
         ! The response is linear in the amplitude: its derivative is the response to a unit one.
         call excitation%set_amplitude(1.0_wp)
         call self%solver%respond(equations, excitation, self%sampling%times, &
            slopes(findloc(self%free, amplitude, dim=1)), self%work, error)
      end if
      if (allocated(error)) return
      r = self%sampling%acceleration(response) - self%measured
      do k = 1, size(self%free)
         jac(:, k) = self%sampling%acceleration(slopes(k))
      end do
   end subroutine jacobian

end module beamid_identification
