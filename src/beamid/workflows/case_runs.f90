!> Runs the commands simulate, modes and design on a case.
!>
!> Each command has two steps. `prepare_...` checks the case and reads what the command needs; it
!> works with text and must not run beside other threads. The second step computes.
module beamid_case_runs
   use beamid_boxes, only: box_t
   use beamid_case_checks, only: can_be_fitted, check_needs, needs_design, needs_modes, &
      needs_response, place_experiment
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t, fail_if_rejected, fit_case, judge_case, load_case
   use beamid_cases, only: plan_experiments, sample_times
   use beamid_designs, only: compare_designs, designs_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, locate
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: galerkin_of, galerkin_t
   use beamid_identification, only: simulate, simulation_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_modal, only: modal_t
   use beamid_modes, only: undamped_modes
   use beamid_roots, only: damped_roots
   use beamid_simulation, only: lowest_modes, refine_for_modes, simulate_converged
   use beamid_strings, only: to_text
   implicit none
   private

   public :: simulated_t, place_response, prepare_simulation, simulate_case
   public :: case_modes_t, prepare_modes, modes_of_case
   public :: planned_t, prepare_design, design_case

   !> Responses of the structure of a case.
   type :: simulated_t
      real(wp), allocatable :: times(:)                   !< sample times [time]
      type(simulation_t), allocatable :: simulations(:)   !< (meshes)
      logical :: converged = .true.    !< .false.: the finest mesh still changes the response
      real(wp) :: remaining = 0        !< rms of this change [length/time**2]
   end type simulated_t

   !> Modes on one mesh.
   type :: mesh_modes_t
      real(wp), allocatable :: omega(:)      !< undamped angular frequencies, ascending [1/time]
      complex(wp), allocatable :: roots(:)   !< of the damped structure, by modulus [1/time]
   end type mesh_modes_t

   !> Modes of the structure of a case and, if the case can be fitted, of the fitted structure.
   type :: case_modes_t
      type(mesh_modes_t), allocatable :: meshes(:)           !< (meshes)
      real(wp) :: remaining = 0     !< relative change of the natural frequencies by the finest mesh
      logical :: is_fitted = .false.                         !< whether a fit was tried
      type(case_t) :: case                                   !< as it is fitted, by `modal`
      type(case_fit_t) :: fit                                !< records, fit and verdict
      type(error_t), allocatable :: fit_error                !< why there is no fit
   end type case_modes_t

   !> The experiments and the lists of settings that a design compares.
   type :: planned_t
      type(box_t) :: box
      type(experiment_t), allocatable :: experiments(:)
   end type planned_t

contains

   !> Checks that a response can be computed, puts the length and the positions that the record
   !> states into the model, and sets the sample times.
   !>
   !> simulated  on return with `times`: those of a record in memory, or the grid of the record
   subroutine prepare_simulation(case, simulated, error)
      type(case_t), intent(inout) :: case
      type(simulated_t), intent(out) :: simulated
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: times(:)   ! not allocated: those of the grid

      if (size(case%recordings) == 1) then
         if (allocated(case%recordings(1)%t)) times = case%recordings(1)%t
      end if
      call place_response(case, error, times)
      if (.not. allocated(error)) call sample_times(case, simulated%times, error)
   end subroutine prepare_simulation

   !> Checks that a case has everything that a response needs, and puts the length and the positions
   !> that its first record states into the model.
   !>
   !> times  (m) times of the response that replace the window of a single record [time]
   subroutine place_response(case, error, times)
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: times(:)
      type(experiment_t) :: experiment

      if (present(times) .and. size(case%recordings) == 1) then
         associate (window => case%recordings(1)%window)
            window%t_first = times(1)
            window%t_last = times(size(times))
            window%t_step = 1.0_wp
         end associate
      end if
      call check_needs(case, needs_response, error)
      if (.not. allocated(error)) call place_experiment(case, 1, experiment, error)
      if (.not. allocated(error)) case%model%structure = experiment%structure_of( &
         case%model%structure)
   end subroutine place_response

   !> Computes the response on each mesh; without `elements`, on a mesh that is refined until the
   !> response no longer changes.
   !>
   !> case  on return with the refined mesh
   subroutine simulate_case(case, simulated, error)
      type(case_t), intent(inout) :: case
      type(simulated_t), intent(inout) :: simulated
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      allocate (simulated%simulations(size(case%meshes)))
      do k = 1, size(case%meshes)
         if (case%refines) then
            call simulate_converged(case%model, simulated%times, case%noise_sd, case%meshes(k), &
               simulated%simulations(k), simulated%remaining, simulated%converged, error)
         else
            call simulate(case%model, case%meshes(k), simulated%times, simulated%simulations(k), &
               error)
         end if
         call locate(error, case%path//': elements = '//to_text(case%meshes(k)%elements))
         if (allocated(error)) return
      end do
   end subroutine simulate_case

   !> Checks a case for `modes`, and loads its records if it can be fitted.
   subroutine prepare_modes(case, found, error)
      type(case_t), intent(in) :: case
      type(case_modes_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error

      call check_needs(case, needs_modes, error)
      if (allocated(error)) return
      found%is_fitted = can_be_fitted(case)
      if (.not. found%is_fitted) return
      call case%copy_to(found%case)
      deallocate (found%case%model%solver)
      allocate (modal_t :: found%case%model%solver)
      call load_case(found%case, found%fit, found%fit_error)
   end subroutine prepare_modes

   !> Computes the natural modes of the structure on each mesh, and fits the case if it can be
   !> fitted. A fit that fails or is rejected is no error, because the modes of the declared
   !> structure are known. Without `elements`, the mesh is refined for the lowest modes, and only
   !> these are kept.
   !>
   !> case  on return with the refined mesh
   subroutine modes_of_case(case, found, error, monitor)
      type(case_t), intent(inout) :: case
      type(case_modes_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(excitation_t) :: still
      real(wp), allocatable :: shapes(:, :)
      integer :: k

      still = new_pulse(0.0_wp, 1.0_wp)
      allocate (found%meshes(size(case%meshes)))
      do k = 1, size(case%meshes)
         if (case%refines) call refine_for_modes(case%model%structure, lowest_modes, &
            case%meshes(k), found%remaining, error)
         call locate(error, case%path)
         if (allocated(error)) return
         galerkin = galerkin_of(case%meshes(k), case%model%structure, fixed=.true.)
         equations = new_equations(galerkin, case%model%structure, still)
         call undamped_modes(equations, found%meshes(k)%omega, shapes, error)
         if (.not. allocated(error)) call damped_roots(equations, found%meshes(k)%roots, error)
         call locate(error, case%path//': elements = '//to_text(case%meshes(k)%elements))
         if (allocated(error)) return
         if (.not. case%refines) cycle
         associate (here => found%meshes(k))
            here%omega = here%omega(:min(lowest_modes, size(here%omega)))
            here%roots = here%roots(:min(lowest_modes, size(here%roots)))
         end associate
      end do
      if (.not. found%is_fitted .or. allocated(found%fit_error)) return
      call fit_case(found%case, found%fit, found%fit_error, monitor)
      if (.not. allocated(found%fit_error)) call judge_case(found%case, found%fit, &
         found%fit_error, monitor)
      call fail_if_rejected(found%case, found%fit, found%fit_error)
   end subroutine modes_of_case

   !> Checks a case for `design`, and describes its experiments.
   !>
   !> case  on return with the exact solver, whatever solver it names
   subroutine prepare_design(case, planned, error)
      type(case_t), intent(inout) :: case
      type(planned_t), intent(out) :: planned
      type(error_t), allocatable, intent(out) :: error

      call check_needs(case, needs_design, error)
      if (.not. allocated(error)) call plan_experiments(case, planned%box, planned%experiments, &
         error)
      if (allocated(error)) return
      deallocate (case%model%solver)
      allocate (modal_t :: case%model%solver)
   end subroutine prepare_design

   !> Predicts the standard errors that candidate experiments would give, on the last mesh.
   subroutine design_case(case, planned, designs, error, monitor)
      type(case_t), intent(in) :: case
      type(planned_t), intent(in) :: planned
      type(designs_t), intent(out) :: designs
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor

      call compare_designs(case%model, case%meshes(size(case%meshes)), &
         case%stages(size(case%stages)), planned%experiments, planned%box, designs, error, &
         monitor)
      call locate(error, case%path//':'//to_text(case%design_line)//': &design')
   end subroutine design_case

end module beamid_case_runs
