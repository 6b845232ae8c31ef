!> Runs the commands profile, sample and bootstrap on the fit of a case, on each of its meshes.
module beamid_case_inferences
   use beamid_bootstraps, only: bootstrap_fit, bootstrap_t
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t, fail_if_rejected
   use beamid_errors, only: error_t, locate
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_inference, only: posterior_draws_t, profile_fit, sample_fit
   use beamid_least_squares, only: monitor_t
   use beamid_profile_likelihood, only: side_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: case_inference_t, infer, infer_on_mesh

   !> Results on one mesh; those of other commands are not allocated.
   type :: case_inference_t
      type(side_t), allocatable :: sides(:, :)    !< (2, free) profile below and above the estimate
      type(posterior_draws_t), allocatable :: posterior   !< draws of `sample`
      type(bootstrap_t), allocatable :: resampled         !< estimates and intervals of `bootstrap`
   end type case_inference_t

contains

   !> Runs a command on the last stage of a fit, on every mesh.
   !>
   !> command     'profile', 'sample' (which computes profiles first) or 'bootstrap'
   !> found       as `judge_case` returns it
   !> inferences  (meshes)
   !> error       a fit that the verdict has rejected, or the failure of the command
   subroutine infer(command, case, found, inferences, error, monitor)
      character(len=*), intent(in) :: command
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(in) :: found
      type(case_inference_t), allocatable, intent(out) :: inferences(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: k

      call fail_if_rejected(case, found, error)
      if (allocated(error)) return
      allocate (inferences(size(case%meshes)))
      do k = 1, size(case%meshes)
         associate (mesh => case%meshes(k), last => found%fits(size(found%fits, 1), k))
            call infer_on_mesh(command, case, mesh, found%experiments, last, inferences(k), error, &
               monitor)
            call locate(error, case%path//': elements = '//to_text(mesh%elements))
            if (allocated(error)) return
         end associate
      end do
   end subroutine infer

   !> Runs a command on a fit on one mesh.
   !>
   !> command      as in `infer`
   !> experiments  (records) that were fitted
   !> fit          their fit on the mesh
   !> error        the failure of the command
   subroutine infer_on_mesh(command, case, mesh, experiments, fit, here, error, monitor)
      character(len=*), intent(in) :: command
      type(case_t), intent(in) :: case
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      type(case_inference_t), intent(out) :: here
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor

      if (command == 'bootstrap') then
         allocate (here%resampled)
         call bootstrap_fit(case%model, mesh, experiments, fit, case%bootstrap, here%resampled, &
            error, monitor)
      else
         call profile_fit(case%model, mesh, experiments, fit, here%sides, error, monitor)
      end if
      if (command == 'sample' .and. .not. allocated(error)) then
         allocate (here%posterior)
         call sample_fit(case%model, mesh, experiments, fit, here%sides, case%sampling, &
            here%posterior, error, monitor)
      end if
   end subroutine infer_on_mesh

end module beamid_case_inferences
