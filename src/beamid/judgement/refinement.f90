!> The effect of the mesh on estimates: refits on finer meshes, starting from the estimates, and
!> fits on meshes that are refined until the effect is small.
module beamid_refinement
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: coarsest, finest, mesh_t
   use beamid_identification, only: identify_meshes, model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_residuals, only: residual_t
   use beamid_strings, only: to_text
   use beamid_unknowns, only: name_length, quantity_t, variables_of
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: add_mesh_shift, identify_refining, of_higher_degree

contains

   !> Fits all stages on meshes of 8, 16, ... 128 elements, until finer meshes shift no estimate of
   !> the last stage by more than a quarter of its half width and reduce J by no more than a tenth.
   !>
   !> mesh   on return with the number of elements of the last mesh tried
   !> fits   (stages, 1) on that mesh, with the mesh shifts of the last stage
   !> error  a fit that fails on any mesh
   !> check  .false.: do not compare exact derivatives with differences; default .true.
   subroutine identify_refining(model, mesh, stages, experiments, fits, error, monitor, check)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(inout) :: mesh
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check

      mesh%elements = coarsest
      do
         call identify_meshes(model, [mesh], stages, experiments, fits, error, monitor, check)
         if (allocated(error)) return
         associate (last => fits(size(stages), 1))
            call add_mesh_shift(model, mesh, experiments, last, monitor)
            if (.not. last%shifted() .or. mesh%elements >= finest) return
         end associate
         mesh%elements = 2*mesh%elements
      end do
   end subroutine identify_refining

   !> Adds to a fit by how much finer meshes shift its estimates.
   !>
   !> Two finer meshes are tried, one with splines of a degree higher by two, the other with twice
   !> the elements, both with exact integrals and with the exact response, whatever the model's
   !> solver. The mesh shift is the larger of the two shifts. Its error is the difference of the two
   !> plus a tenth of the mesh shift.
   !>
   !> experiments  (records) that were fitted
   !> found        their fit; on return with `mesh_shift`, `mesh_error` and `mesh_decrease`, unless
   !>              a fit on a finer mesh fails
   subroutine add_mesh_shift(model, mesh, experiments, found, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(inout) :: found
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), dimension(size(found%free)) :: by_degree, by_elements, shift
      logical :: failed

      if (size(found%free) == 0) return
      call refit(of_higher_degree(mesh), by_degree)
      if (.not. failed) call refit(mesh_t(mesh%degree, 2*mesh%elements, mesh%degree + 1, 1, &
         mesh%at_attachments), by_elements)
      if (failed) return
      shift = merge(by_degree, by_elements, abs(by_degree) >= abs(by_elements))
      found%mesh_shift = shift
      found%mesh_error = abs(by_degree - by_elements) + 0.1_wp*abs(shift)

   contains

      !> Fits on a finer mesh, starting from the estimates, and sets `failed`.
      !>
      !> moved  (free) shift of each estimate; 0 if the fit fails
      subroutine refit(finer, moved)
         type(mesh_t), intent(in) :: finer
         real(wp), intent(out) :: moved(:)
         type(residual_t) :: problem
         type(variable_t), allocatable :: variables(:)
         type(quantity_t), allocatable :: quantities(:)
         type(fit_t) :: refined
         type(error_t), allocatable :: error
         character(len=name_length), allocatable :: names(:)

         moved = 0
         call exact_counterpart(model, finer, experiments, found%free, problem)
         failed = .not. allocated(problem%parts)
         if (failed) return
         call found%restore(problem)
         call variables_of(found%again(), found%scenario, variables, quantities, error)
         if (.not. allocated(error)) then
            allocate (names(size(quantities)))
            names = quantities%name
            call fit(problem, problem%rows(), variables, options_t(check=.false., &
               all_rows=.false.), refined, error, monitor, 'finer mesh, N = '// &
               to_text(finer%elements), names)
         end if
         failed = allocated(error)
         if (failed) return
         moved = refined%estimate - found%fit%estimate
         if (found%fit%J > 0) found%mesh_decrease = max(found%mesh_decrease, &
            1 - refined%J/found%fit%J)
      end subroutine refit

   end subroutine add_mesh_shift

   !> Returns the mesh with splines of a degree higher by 2.
   pure type(mesh_t) function of_higher_degree(mesh) result(higher)
      type(mesh_t), intent(in) :: mesh

      higher = mesh_t(mesh%degree + 2, mesh%elements, mesh%degree + 3, 1, mesh%at_attachments)
   end function of_higher_degree

end module beamid_refinement
