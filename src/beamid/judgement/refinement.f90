!> What the mesh does to estimates: the fit goes on from them on finer ones. And fits on meshes
!> refined until it no longer shows.
module beamid_refinement
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify_meshes, model_t, stage_fit_t, &
      stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_residuals, only: residual_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_kappa_R
   use beamid_unknowns, only: name_length, quantity_t, variables_of
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: add_mesh_shift, identify_refining

   !> Elements of the coarsest and of the finest mesh that refinement tries.
   integer, parameter :: coarsest = 8, finest = 128

contains

   !> All stages on meshes of 8, 16, ... 128 elements, until the mesh shifts no estimate of the last
   !> stage by more than a quarter of its half width.
   !>
   !> mesh   its elements are those of the last one tried on return
   !> fits   (size(stages), 1) on that mesh, with the shifts of the last stage
   !> error  of a fit, whatever its mesh
   !> check  .false.: derivatives are not compared with differences
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
         call identify_meshes(model, [mesh], stages, experiments, fits, error, monitor, &
            check)
         if (allocated(error)) return
         associate (last => fits(size(stages), 1))
            call add_mesh_shift(model, mesh, experiments, last, monitor)
            if (.not. last%shifted() .or. mesh%elements >= finest) return
         end associate
         mesh%elements = 2*mesh%elements
      end do
   end subroutine identify_refining

   !> By how much finer meshes shift what was searched for: one with splines of a degree higher by
   !> two, one with twice the elements, both with exact integrals. The larger of the two shifts, and
   !> the difference of the two with a tenth of that as its error. By the exact response, whatever
   !> the solver of the model.
   !>
   !> found  `mesh_shift` stays unallocated where a fit on a finer mesh fails
   subroutine add_mesh_shift(model, mesh, experiments, found, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(inout) :: found
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), dimension(size(found%free)) :: higher, halved, shift
      logical :: failed

      if (size(found%free) == 0) return
      call refit(mesh_t(mesh%degree + 2, mesh%elements, mesh%degree + 3, 1), higher)
      if (.not. failed) call refit(mesh_t(mesh%degree, 2*mesh%elements, mesh%degree + 1, 1), halved)
      if (failed) return
      shift = merge(higher, halved, abs(higher) >= abs(halved))
      found%mesh_shift = shift
      found%mesh_error = abs(higher - halved) + 0.1_wp*abs(shift)

   contains

      !> What a fit on another mesh finds, from where the fit has ended.
      subroutine refit(finer, moved)
         type(mesh_t), intent(in) :: finer
         real(wp), intent(out) :: moved(:)
         type(residual_t) :: problem
         type(variable_t), allocatable :: variables(:)
         type(quantity_t), allocatable :: quantities(:)
         type(stage_t) :: stage
         type(fit_t) :: better
         type(error_t), allocatable :: error
         character(len=name_length), allocatable :: names(:)

         moved = 0
         call exact_counterpart(model, finer, experiments, any(found%free == of_kappa_R), problem)
         failed = .not. allocated(problem%parts)
         if (failed) return
         stage = found%again()
         call set_free(problem, stage)
         problem%scenario = found%scenario
         problem%weight = found%weight
         problem%noise = found%noise
         problem%strength = found%strength
         call variables_of(stage, found%scenario, variables, quantities, error)
         if (.not. allocated(error)) then
            allocate (names(size(quantities)))
            names = quantities%name
            call fit(problem, problem%rows(), variables, options_t(check=.false.), better, error, &
               monitor, 'finer mesh, N = '//to_text(finer%elements), names)
         end if
         failed = allocated(error)
         if (.not. failed) moved = better%estimate - found%fit%estimate
      end subroutine refit

   end subroutine add_mesh_shift

end module beamid_refinement
