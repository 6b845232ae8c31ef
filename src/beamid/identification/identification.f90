!> From records to parameters: the stages of a fit, on one mesh or on several.
module beamid_identification
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t, new_apparatus
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_residuals, only: residual_t
   use beamid_responses, only: is_exact, work_t
   use beamid_simulation, only: model_t, simulate, simulation_t
   use beamid_starts, only: automatic_start, check_frequencies
   use beamid_strings, only: to_text
   use beamid_parameters, only: offset
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_structure, only: structure_t
   use beamid_unknowns, only: name_length, quantity_t, stage_t, variables_of, world_t
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart, verify_integrator
   use beamid_whiteness, only: check_residuals, residual_check_t
   implicit none
   private

   public :: model_t, stage_t, simulation_t, stage_fit_t, outcome_t, quantity_t, simulate, &
      identify, identify_meshes, score_fits

   !> The outcome of one stage on one mesh.
   type :: stage_fit_t
      integer :: stage = 0
      integer :: elements = 0
      integer, allocatable :: free(:)    !< (n) of the parameters that were searched for
      type(fit_t) :: fit                 !< of these alone
      !> (n + k) the parameters, then what was eliminated; statistics are of all of them
      type(quantity_t), allocatable :: quantities(:)
      real(wp), allocatable :: jacobian(:, :)   !< (m, n + k)
      type(structure_t) :: structure     !< of the first record, with the estimates in place
      type(excitation_t) :: excitation   !< likewise
      type(world_t) :: world             !< of every record
      type(statistics_t) :: statistics   !< `samples` is 0 where no degree of freedom was left
      type(residual_check_t) :: check
      !> How far an integrator's error has moved an estimate, in standard errors; -1: no integrator
      real(wp) :: moved = -1
      character(len=:), allocatable :: reference   !< seen from where
      real(wp) :: score = -1             !< squared residuals over another window; -1: not asked for
      type(work_t) :: work
   end type stage_fit_t

   !> All stages on one mesh, or what went wrong.
   type :: outcome_t
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
   end type outcome_t

   !> Of one record, given by its samples and the model's own excitation, or of several.
   interface identify
      module procedure :: identify_samples
      module procedure :: identify_experiments
   end interface identify
   interface identify_meshes
      module procedure :: identify_meshes_samples
      module procedure :: identify_meshes_experiments
   end interface identify_meshes

contains

   !> Runs the stages in turn on one mesh, each from where the one before ended.
   !>
   !> experiments  one for each record
   !> fits         (size(stages)) allocated on success
   !> error        says which stage failed, and why
   !> monitor      told of every iteration
   !> check        .false.: derivatives are not compared with differences
   subroutine identify_experiments(model, mesh, stages, experiments, fits, error, monitor, check)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check
      type(residual_t) :: problem, exact
      type(options_t) :: options
      integer :: i, k

      allocate (problem%parts(size(experiments)))
      allocate (problem%world%structures(size(experiments)))
      allocate (problem%world%excitations(size(experiments)))
      do i = 1, size(experiments)
         problem%world%structures(i) = experiments(i)%structure_of(model%structure)
         problem%world%excitations(i) = experiments(i)%excitation
         call new_apparatus(experiments(i), problem%world%structures(i), mesh, &
            model%observation, model%solver, problem%parts(i), error)
         if (allocated(error)) return
      end do
      call check_frequencies(problem, experiments, error)
      if (allocated(error)) return
      problem%exact = is_exact(model%solver)
      if (.not. problem%exact) call exact_counterpart(problem, experiments, mesh, &
         model%observation, exact)
      options%relative_error = model%solver%relative_error()
      if (present(check)) options%check = check
      allocate (fits(size(stages)))
      do k = 1, size(stages)
         call run_stage(problem, exact, stages(k), options, 'N = '//to_text(mesh%elements)// &
            ', stage '//to_text(k), experiments, fits(k), error, monitor)
         if (allocated(error)) then
            error%message = 'elements = '//to_text(mesh%elements)//', stage '//to_text(k)//': '// &
               error%message
            return
         end if
         fits(k)%stage = k
         fits(k)%elements = mesh%elements
      end do
   end subroutine identify_experiments

   !> One search and what it says; the estimates stay in the problem's world.
   !>
   !> exact  what an integrator's results are checked against
   subroutine run_stage(problem, exact, stage, options, label, experiments, found, error, monitor)
      type(residual_t), intent(inout) :: problem, exact
      type(stage_t), intent(in) :: stage
      type(options_t), intent(in) :: options
      character(len=*), intent(in) :: label
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(variable_t), allocatable :: variables(:)
      character(len=name_length), allocatable :: names(:)
      real(wp), allocatable :: values(:), scales(:)
      integer :: i, k, n

      problem%free = stage%free
      problem%record = stage%owners()
      problem%offset = stage%offset
      do i = 1, size(problem%parts)
         problem%parts(i)%work = work_t()
      end do
      if (stage%automatic) call automatic_start(problem, stage, experiments, error)
      if (allocated(error)) return
      call variables_of(stage, problem%world, variables, found%quantities)
      names = found%quantities%name
      call fit(problem, problem%samples(), variables, options, found%fit, error, monitor, label, &
         names)
      if (allocated(error)) return
      if (.not. problem%exact) call verify_integrator(problem, exact, variables, names, &
         found%fit, found%moved, found%reference, error)
      if (allocated(error)) return
      found%free = stage%free
      do k = 1, size(stage%free)
         call problem%world%set(problem%free(k), problem%record(k), found%fit%estimate(k))
         found%quantities(k)%value = found%fit%estimate(k)
         found%quantities(k)%scale = abs(found%fit%estimate(k))
         associate (moderate => problem%world%magnitude(problem%free(k), problem%record(k)))
            ! What a search leaves beside a bound at 0 is no yardstick.
            if (found%quantities(k)%scale <= 1e-9_wp*moderate) found%quantities(k)%scale = moderate
         end associate
      end do
      found%world = problem%world
      found%structure = found%world%structures(1)
      found%excitation = found%world%excitations(1)
      call add_linear(problem, experiments, found, error)
      if (allocated(error)) return
      do i = 1, size(problem%parts)
         found%work%solves = found%work%solves + problem%parts(i)%work%solves
         found%work%steps = found%work%steps + problem%parts(i)%work%steps
         found%work%evaluations = found%work%evaluations + problem%parts(i)%work%evaluations
         found%work%factorizations = found%work%factorizations &
            + problem%parts(i)%work%factorizations
      end do
      found%check = check_residuals(found%fit%residual, found%jacobian)
      ! What was eliminated counts, but no one asks whether an offset of nothing differs from it.
      n = size(stage%free)
      scales = found%quantities%scale
      values = [found%quantities(:n)%value, found%quantities(n + 1:)%scale]
      if (problem%samples() > size(scales)) call new_statistics(found%jacobian, &
         found%fit%residual, values, scales, found%statistics, error)
   end subroutine run_stage

   !> The quantities that were eliminated, and derivatives with respect to all.
   subroutine add_linear(problem, experiments, found, error)
      type(residual_t), intent(inout) :: problem
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(quantity_t), allocatable :: linear(:)
      real(wp), allocatable :: c(:)
      real(wp) :: r(problem%samples()), size_of_record
      integer :: k

      linear = problem%linear_quantities()
      if (size(linear) == 0) then
         found%jacobian = found%fit%jacobian
         return
      end if
      allocate (c(size(linear)), found%jacobian(size(r), size(found%free) + size(linear)))
      call problem%linear_jacobian(found%fit%estimate, r, found%jacobian, c, error)
      if (allocated(error)) return
      do k = 1, size(linear)
         associate (experiment => experiments(max(1, linear(k)%record)))
            size_of_record = norm2(experiment%measured)/sqrt(real(size(experiment%measured), wp))
            linear(k)%value = c(k)
            linear(k)%scale = max(size_of_record, tiny(1.0_wp))
            if (linear(k)%parameter == offset) then
               linear(k)%start = experiment%offset
               linear(k)%value = experiment%offset + c(k)
               linear(k)%scale = linear(k)%scale/abs(experiment%scale)
            end if
         end associate
      end do
      found%quantities = [found%quantities, linear]
   end subroutine add_linear

   !> One record from its samples.
   !>
   !> samples, measured  (m) ascending [time], [length/time**2]
   subroutine identify_samples(model, mesh, stages, samples, measured, fits, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stages(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(experiment_t) :: experiments(1)

      call only_experiment(model, samples, measured, experiments)
      call identify(model, mesh, stages, experiments, fits, error, monitor)
   end subroutine identify_samples

   !> The model's own excitation and a record, as the only experiment. A subroutine: gfortran 12
   !> leaks what a function puts into an array constructor.
   subroutine only_experiment(model, samples, measured, experiments)
      type(model_t), intent(in) :: model
      real(wp), intent(in) :: samples(:), measured(:)
      type(experiment_t), intent(out) :: experiments(1)

      experiments(1)%samples = samples
      experiments(1)%measured = measured
      experiments(1)%excitation = model%excitation
   end subroutine only_experiment

   !> `identify` on each mesh, as many at a time as there are threads.
   !>
   !> fits   (size(stages), size(meshes)) allocated on success
   !> error  of the first mesh that failed
   subroutine identify_meshes_experiments(model, meshes, stages, experiments, fits, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(outcome_t), allocatable :: outcomes(:)
      integer :: k

      ! The finest mesh takes longest: it goes first.
      allocate (outcomes(size(meshes)))
      !$omp parallel do schedule(dynamic, 1)
      do k = size(meshes), 1, -1
         call identify(model, meshes(k), stages, experiments, outcomes(k)%fits, outcomes(k)%error, &
            monitor)
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
   end subroutine identify_meshes_experiments

   subroutine identify_meshes_samples(model, meshes, stages, samples, measured, fits, error, &
      monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      type(stage_t), intent(in) :: stages(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(experiment_t) :: experiments(1)

      call only_experiment(model, samples, measured, experiments)
      call identify_meshes(model, meshes, stages, experiments, fits, error, monitor)
   end subroutine identify_meshes_samples

   !> Adds up the squared residuals of each fit over other samples than it was made from.
   !>
   !> meshes    (k) of the fits
   !> samples   (m) ascending [time]
   !> measured  (m) record at the samples [length/time**2]
   !> fits      (stages, k) component `score` is set
   !> error     a response that cannot be computed; a sum that is not finite
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
            if (ieee_is_finite(fits(stage, mesh)%score)) cycle
            call failure(error, 'elements = '//to_text(meshes(mesh)%elements)//', stage '// &
               to_text(stage)//': the sum of squares over the window of the score is not '// &
               'finite; the largest sample there is '//to_text(maxval(abs(measured))))
            return
         end do
      end do
   end subroutine score_fits

end module beamid_identification
