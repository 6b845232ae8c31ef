!> Identification: estimates the parameters from the records, in stages, on one mesh or several.
!>
!> This is the entry point for a complete fit; it runs `beamid_stages`.
module beamid_identification
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_criteria, only: misfit_of_records
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_frequency_checks, only: check_frequencies
   use beamid_galerkin, only: mesh_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t, options_t
   use beamid_model_checks, only: check_experiments, check_stage
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_simulation, only: model_t, simulate, simulation_t
   use beamid_smooth_fits, only: misfit_of
   use beamid_stage_fits, only: stage_fit_t
   use beamid_stages, only: run_stage
   use beamid_strings, only: to_text
   use beamid_unknowns, only: quantity_t, stage_t, scenario_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: model_t, stage_t, simulation_t, stage_fit_t, outcome_t, quantity_t, simulate, &
      identify, identify_meshes, check_fit, run_stages, misfit_of_fit, score_fits

   !> The results of all stages on one mesh, or the error.
   type :: outcome_t
      type(stage_fit_t), allocatable :: fits(:)   !< (stages)
      type(error_t), allocatable :: error         !< not allocated: success
   end type outcome_t

   !> Fits the samples of one record with the excitation of the model, or several experiments.
   interface identify
      module procedure :: identify_samples
      module procedure :: identify_experiments
   end interface identify
   !> The same on several meshes.
   interface identify_meshes
      module procedure :: identify_meshes_samples
      module procedure :: identify_meshes_experiments
   end interface identify_meshes

contains

   !> Runs the stages in turn on one mesh. Each stage starts where the previous one ended.
   !>
   !> experiments  one for each record
   !> fits         (size(stages)) results; allocated on success
   !> error        says which stage failed, and why
   !> monitor      informed of every iteration
   !> check        .false.: exact derivatives are not compared with differences; default .true.
   subroutine identify_experiments(model, mesh, stages, experiments, fits, error, monitor, check)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check

      call check_fit(model, stages, experiments, error)
      if (.not. allocated(error)) call run_stages(model, mesh, stages, experiments, fits, error, &
         monitor, check)
   end subroutine identify_experiments

   !> Refuses a model, experiments or stages from which nothing can be computed.
   subroutine check_fit(model, stages, experiments, error)
      type(model_t), intent(in) :: model
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call check_experiments(model%structure, model%solver, experiments, error)
      do k = 1, size(stages)
         if (allocated(error)) return
         call check_stage(stages(k), any(experiments%excitation%modes > 0), error)
      end do
   end subroutine check_fit

   !> Runs the stages. Arguments as of `identify_experiments`; they are not checked. `check_fit`
   !> takes a fifth of the time of a short fit, and what reads a case file has checked it.
   subroutine run_stages(model, mesh, stages, experiments, fits, error, monitor, check)
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
      type(stage_t) :: stage
      type(scenario_t) :: given
      type(error_t), allocatable :: objection
      integer, allocatable :: free(:)
      integer :: k, p

      free = [(stages(k)%free, k=1, size(stages))]
      call new_residuals(model, mesh, experiments, problem, error, free)
      if (allocated(error)) return
      given = problem%scenario
      if (.not. problem%exact) call exact_counterpart(model, mesh, experiments, free, &
         exact)
      options%relative_error = model%solver%relative_error()
      if (present(check)) options%check = check
      allocate (fits(size(stages)))
      do k = 1, size(stages)
         stage = stages(k)
         ! Parameters that the first stage has fixed because a mode is not in the record stay fixed.
         if (k > 1) stage = stage%without([(any(stages(1)%free == stage%free(p)) .and. &
            .not. any(fits(1)%free == stage%free(p)), p=1, size(stage%free))])
         call run_stage(problem, exact, stage, options, 'N = '//to_text(mesh%elements)// &
            ', stage '//to_text(k), fits(k), error, monitor)
         call check_interrupt(error)
         if (interrupted()) return
         if (k == 1) then
            if (is_poor(problem, fits(1)%residual, failed=allocated(error))) then
               ! Perhaps the model is in other units than the record.
               problem%scenario = given
               call check_frequencies(problem, objection)
               if (allocated(objection)) then
                  call move_alloc(objection, error)
                  return
               end if
               if (.not. allocated(error)) problem%scenario = fits(1)%scenario
            end if
         end if
         if (allocated(error)) then
            error%message = 'elements = '//to_text(mesh%elements)//', stage '//to_text(k)//': '// &
               error%message
            return
         end if
         if (k > 1) call try_automatic_start(model, mesh, experiments, free, stage, [(all( &
            fits(k - 1)%free /= stage%free(p)), p=1, size(stage%free))], options, problem, &
            fits(k), monitor)
         fits(k)%stage = k
         fits(k)%elements = mesh%elements
      end do
   end subroutine run_stages

   !> Repeats a later stage from the spectral lines of free decays if a parameter that it adds has
   !> stayed at its bound, and keeps the better fit. The search, which started from the estimates
   !> without this parameter, may have found only the nearest minimum.
   !>
   !> free     parameters of all stages
   !> added    (free parameters of the stage) whether it is missing in the stage before
   !> problem  in: the state at the end of the stage; out: that of the fit that is kept
   !> fit      in: of the stage; out: the better fit
   !> monitor  informed of every iteration
   subroutine try_automatic_start(model, mesh, experiments, free, stage, added, options, problem, &
      fit, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: free(:)
      type(stage_t), intent(in) :: stage
      logical, intent(in) :: added(:)
      type(options_t), intent(in) :: options
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(inout) :: fit
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), parameter :: clearly = 1e-3_wp   ! relative difference of two misfits
      type(residual_t) :: fresh, exact
      type(stage_t) :: again
      type(stage_fit_t) :: found
      type(error_t), allocatable :: error

      if (allocated(stage%start) .or. stage%declared .or. any(experiments%excitation%modes == 0)) &
         return
      if (.not. (problem%exact .and. problem%is_all_time()) .or. size(added) == 0) return
      associate (q => fit%quantities(:size(added)))
         if (.not. any(added .and. (abs(q%searched) <= 0 .or. q%value <= q%lower .or. &
            q%value >= q%upper))) return
      end associate
      again = stage
      again%automatic = .true.
      again%is_whole = .true.
      call new_residuals(model, mesh, experiments, fresh, error, free)
      if (.not. allocated(error)) call run_stage(fresh, exact, again, options, 'N = '// &
         to_text(mesh%elements)//', the stage repeated', found, error, monitor)
      ! If the repetition fails or keeps a parameter fixed, the first fit stands.
      if (allocated(error) .or. interrupted()) return
      if (size(found%free) /= size(fit%free) .or. .not. misfit_of(fresh, found%fit) < &
         (1 - clearly)*misfit_of(problem, fit%fit)) return
      call found%copy_to(fit)
      call fresh%copy_to(problem)
   end subroutine try_automatic_start

   !> Tells whether a search has failed, or its residuals hold more than half of the variance of the
   !> records.
   pure logical function is_poor(problem, residual, failed)
      type(residual_t), intent(in) :: problem
      real(wp), allocatable, intent(in) :: residual(:)
      logical, intent(in) :: failed
      real(wp) :: left, varied
      integer :: i

      is_poor = failed
      if (is_poor) return
      left = sum(residual**2)
      varied = 0
      do i = 1, size(problem%parts)
         associate (z => problem%parts(i)%observed%measured)
            varied = varied + sum((z - sum(z)/size(z))**2)
         end associate
      end do
      is_poor = .not. left <= varied/2
   end function is_poor

   !> Returns J or, for several records not all of whose noise levels are given, what replaces it.
   pure real(wp) function misfit_of_fit(fit, experiments) result(misfit)
      type(stage_fit_t), intent(in) :: fit
      type(experiment_t), intent(in) :: experiments(:)
      integer :: k

      misfit = fit%fit%J
      if (size(experiments) == 1 .or. &
         all([(allocated(experiments(k)%sd), k=1, size(experiments))])) return
      misfit = misfit_of_records(fit%residual, [(size(experiments(k)%measured), &
         k=1, size(experiments))])
   end function misfit_of_fit

   !> Runs the stages on the samples of one record.
   !>
   !> samples          (m) sample times, ascending [time]
   !> measured         (m) recorded acceleration [length/time**2]
   !> other arguments  as of `identify_experiments`
   subroutine identify_samples(model, mesh, stages, samples, measured, fits, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stages(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(experiment_t) :: experiments(1)

      experiments(1) = experiment_t(samples, measured, model%excitation)
      call identify(model, mesh, stages, experiments, fits, error, monitor)
   end subroutine identify_samples

   !> Runs `identify` on each mesh, in parallel.
   !>
   !> fits     (size(stages), size(meshes)) results; allocated on success
   !> error    error of the first mesh that failed
   !> monitor  informed of every iteration and of finished meshes
   !> check    as of `identify_experiments`
   subroutine identify_meshes_experiments(model, meshes, stages, experiments, fits, error, &
      monitor, check)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check
      type(outcome_t), allocatable :: outcomes(:)
      integer :: finished, j, k

      ! The finest mesh takes longest and therefore starts first.
      allocate (outcomes(size(meshes)))
      finished = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag) if(size(meshes) > 1)
      do k = size(meshes), 1, -1
         call run_stages(model, meshes(k), stages, experiments, outcomes(k)%fits, &
            outcomes(k)%error, monitor, check)
         !$omp critical (one_mesh_done)
         finished = finished + meshes(k)%elements
         if (present(monitor)) call monitor%done(finished, sum(meshes%elements))
         !$omp end critical (one_mesh_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)
      if (allocated(error)) return
      do k = 1, size(meshes)
         if (.not. allocated(outcomes(k)%error)) cycle
         call move_alloc(outcomes(k)%error, error)
         return
      end do
      allocate (fits(size(stages), size(meshes)))
      do k = 1, size(meshes)
         do j = 1, size(stages)
            call move_fit(outcomes(k)%fits(j), fits(j, k))
         end do
      end do
   end subroutine identify_meshes_experiments

   !> Moves a fit; the arrays of all rows are not copied, because they are large.
   !>
   !> from  on return without these arrays
   subroutine move_fit(from, to)
      type(stage_fit_t), intent(inout) :: from, to
      real(wp), allocatable :: jacobian(:, :), residual(:), weighted(:)

      call move_alloc(from%jacobian, jacobian)
      call move_alloc(from%residual, residual)
      call move_alloc(from%fit%residual, weighted)
      call from%copy_to(to)
      call move_alloc(jacobian, to%jacobian)
      call move_alloc(residual, to%residual)
      call move_alloc(weighted, to%fit%residual)
   end subroutine move_fit

   !> Runs `identify` on each mesh, for the samples of one record.
   !>
   !> samples   (m) sample times, ascending [time]
   !> measured  (m) recorded acceleration [length/time**2]
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

      experiments(1) = experiment_t(samples, measured, model%excitation)
      call identify_meshes(model, meshes, stages, experiments, fits, error, monitor)
   end subroutine identify_meshes_samples

   !> Computes the sum of squared residuals of each fit over samples that the fit has not used.
   !>
   !> meshes    (k) meshes of the fits
   !> samples   (m) sample times, ascending [time]; of size 0: nothing is computed
   !> measured  (m) recorded acceleration [length/time**2]
   !> fits      (stages, k) on return with component `score`
   !> error     a response cannot be computed; a sum is not finite
   subroutine score_fits(model, meshes, samples, measured, fits, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      real(wp), intent(in) :: samples(:), measured(:)
      type(stage_fit_t), intent(inout) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(model_t) :: fitted
      type(simulation_t) :: simulation
      integer :: mesh, stage

      if (size(samples) == 0) return
      fitted = model
      do mesh = 1, size(fits, 2)
         do stage = 1, size(fits, 1)
            fitted%structure = fits(stage, mesh)%scenario%structures(1)
            fitted%excitation = fits(stage, mesh)%scenario%excitations(1)
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
