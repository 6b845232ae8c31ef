!> The fit that a case asks for: loads its records, fits its stages on the given meshes or on
!> refined ones, from one start or from several, and judges the result.
module beamid_case_fits
   use beamid_case_files, only: case_t
   use beamid_cases, only: load_experiments, scored_samples
   use beamid_errors, only: error_t, locate
   use beamid_experiments, only: experiment_t
   use beamid_fixed_parameters, only: add_fixed_parameters
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify_meshes, score_fits, stage_fit_t
   use beamid_input_checks, only: check_input
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_multistart, only: identify_meshes_from_many, minima_t
   use beamid_records, only: note_length
   use beamid_refinement, only: add_mesh_shift, identify_refining
   use beamid_responses, only: is_exact
   use beamid_score_tests, only: score_test_t, test_candidates
   use beamid_verdicts, only: new_verdict, verdict_t
   use beamid_window_fits, only: fit_windows, window_fit_t
   implicit none
   private

   public :: case_fit_t, load_case, fit_case, find_fits, add_mesh_shifts, judge_case, &
      add_score_tests

   !> The records of a case, its fit and the verdict on it.
   type :: case_fit_t
      type(experiment_t), allocatable :: experiments(:)        !< (records)
      character(len=note_length), allocatable :: notes(:)      !< on the records, one sentence each
      !> (m) sample times [time] and values [length/time**2] in the window of &score, over which
      !> squared residuals are summed after the fit; of size 0: no &score
      real(wp), allocatable :: scored(:), expected(:)
      type(stage_fit_t), allocatable :: fits(:, :)             !< (stages, meshes)
      type(minima_t), allocatable :: minima(:)                 !< (meshes); of size 0: one start
      type(verdict_t) :: verdict                               !< on the last stage, finest mesh
      type(window_fit_t), allocatable :: windows(:)            !< of size 0: no &windows
      type(score_test_t), allocatable :: tests(:)  !< of size 0: not asked for, or impossible
   end type case_fit_t

contains

   !> Loads the records of a case and the samples of &score.
   !>
   !> found  initial; on return with the records, nothing fitted
   !> error  records that cannot be read or do not go together
   subroutine load_case(case, found, error)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error

      allocate (found%minima(0), found%windows(0), found%tests(0))
      call load_experiments(case, found%experiments, found%notes, error)
      if (.not. allocated(error)) call check_input(case, found%experiments, found%notes, error)
      if (.not. allocated(error)) call scored_samples(case, found%scored, found%expected, error)
   end subroutine load_case

   !> Fits all stages of a case.
   !>
   !> case   on return with the last mesh tried, if the mesh is refined automatically
   !> found  as `load_case` returns it; on return with the fits
   !> error  a fit that fails, or an interruption
   !> check  .false.: do not compare exact derivatives with differences; default .true.
   subroutine fit_case(case, found, error, monitor, check)
      type(case_t), intent(inout) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check
      type(mesh_t), allocatable :: meshes(:)

      ! A copy, because find_fits must not change part of the case that it reads.
      meshes = case%meshes
      call find_fits(case, meshes, found%experiments, found%fits, found%minima, error, &
         monitor, check)
      case%meshes = meshes
      if (.not. allocated(error) .and. size(found%scored) > 0) call score_fits(case%model, &
         case%meshes, found%scored, found%expected, found%fits, error)
      call locate(error, case%path)
      call check_interrupt(error)
   end subroutine fit_case

   !> Fits experiments with the stages of a case, from one start or from several, on the given
   !> meshes or on one that is refined automatically.
   !>
   !> meshes       on return the last mesh tried, if the mesh is refined
   !> experiments  (records) of the case, with any samples
   !> fits         (stages, meshes); with several starts the fits of the lowest J
   !> minima       (meshes); of size 0: one start
   !> error        a fit that fails
   !> check        as in `fit_case`
   subroutine find_fits(case, meshes, experiments, fits, minima, error, monitor, check)
      type(case_t), intent(in) :: case
      type(mesh_t), intent(inout) :: meshes(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(minima_t), allocatable, intent(out) :: minima(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check

      if (case%multistart%n > 0) then
         call identify_meshes_from_many(case%model, meshes, case%stages, experiments, &
            case%multistart, fits, minima, error, monitor, check)
         return
      end if
      allocate (minima(0))
      if (case%refines .and. is_exact(case%model%solver)) then
         call identify_refining(case%model, meshes(1), case%stages, experiments, fits, error, &
            monitor, check)
      else
         call identify_meshes(case%model, meshes, case%stages, experiments, fits, error, &
            monitor, check)
      end if
   end subroutine find_fits

   !> Judges the last stage of a fit: adds the effect of the mesh on the estimates, the verdict, and
   !> the fits in windows that the case asks for.
   !>
   !> found  as `fit_case` returns it; if the fit is rejected, `verdict%no_fit` says why on return
   !> error  a verdict that cannot be computed, or an interruption
   subroutine judge_case(case, found, error, monitor)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor

      call add_mesh_shifts(case, found, error, monitor)
      if (allocated(error)) return
      associate (mesh => case%meshes(size(case%meshes)), &
         last => found%fits(size(found%fits, 1), size(found%fits, 2)))
         call add_fixed_parameters(case%model, mesh, found%experiments, &
            case%stages(size(case%stages)), last)
         call new_verdict(found%experiments, mesh, last, found%verdict, error)
         call locate(error, case%path)
         call check_interrupt(error)
         if (allocated(error) .or. case%windows == 0) return
         deallocate (found%windows)
         call fit_windows(case%model, mesh, found%experiments, last, case%windows, found%windows)
      end associate
      call check_interrupt(error)
   end subroutine judge_case

   !> Adds the shift of the last stage's estimates on finer meshes, unless it is already known. May
   !> run beside other threads.
   !>
   !> found  as `fit_case` returns it
   !> error  an interruption only
   subroutine add_mesh_shifts(case, found, error, monitor)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: k

      do k = 1, size(case%meshes)
         associate (last => found%fits(size(found%fits, 1), k))
            if (.not. allocated(last%mesh_shift)) call add_mesh_shift(case%model, case%meshes(k), &
               found%experiments, last, monitor)
         end associate
      end do
      call check_interrupt(error)
   end subroutine add_mesh_shifts

   !> Tests which parameters the model may lack, on the last stage and the finest mesh.
   !>
   !> found  with a verdict; on return with `tests`
   !> error  only an interruption: if a test cannot be computed there is none
   subroutine add_score_tests(case, found, error)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(score_test_t), allocatable :: tests(:)
      type(error_t), allocatable :: failed

      call test_candidates(case%model, case%meshes(size(case%meshes)), found%experiments, &
         found%fits(size(found%fits, 1), size(found%fits, 2)), tests, failed)
      call check_interrupt(error)
      if (.not. allocated(error) .and. .not. allocated(failed)) call move_alloc(tests, found%tests)
   end subroutine add_score_tests

end module beamid_case_fits
