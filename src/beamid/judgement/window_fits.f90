!> Repeats a fit in consecutive windows of the records. `beamid_drifts` tests whether the parameters
!> are constant.
module beamid_window_fits
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_fit_t
   use beamid_interrupts, only: stop_flag
   use beamid_kinds, only: wp
   use beamid_least_squares, only: options_t
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_stages, only: run_stage
   use beamid_strings, only: to_text
   use beamid_unknowns, only: stage_t
   use beamid_verdicts, only: new_verdict, verdict_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: window_fit_t, fit_windows, in_window

   !> The fit in one window.
   type :: window_fit_t
      real(wp), allocatable :: first(:), last(:)   !< (records) first and last sample time [time]
      real(wp), allocatable :: estimate(:)         !< (n) estimates of the free parameters
      real(wp), allocatable :: std_error(:)        !< (n) corrected for residuals that are not white
      !> (n) whether the modes that the window shows determine the parameter; the others have been
      !> kept fixed in a second fit, from which the next two components come
      logical, allocatable :: is_shown(:)
      real(wp), allocatable :: shown_estimate(:), shown_error(:)
      type(error_t), allocatable :: error          !< why the fit failed
   end type window_fit_t

contains

   !> Fits each window with the free parameters of a fit, starting from its estimates.
   !>
   !> experiments  (records) that were fitted
   !> fit          of one stage to the whole records
   !> n            number of windows of equal duration in each record
   !> windows      (n) fits, or the error of each
   subroutine fit_windows(model, mesh, experiments, fit, n, windows)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: n
      type(window_fit_t), allocatable, intent(out) :: windows(:)
      integer :: k

      allocate (windows(n))
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, n
         call fit_one(model, mesh, experiments, fit, k, n, windows(k))
      end do
      !$omp end parallel do
   end subroutine fit_windows

   !> Tells which samples (m) are in window k of n windows of equal duration.
   !>
   !> t  (m) ascending [time]
   pure function in_window(t, k, n)
      real(wp), intent(in) :: t(:)
      integer, intent(in) :: k, n
      logical :: in_window(size(t))
      real(wp) :: ends(2)

      ends = ends_of_window(t, k, n)
      in_window = t >= ends(1) .and. (t < ends(2) .or. k == n)
   end function in_window

   !> Returns the beginning and the end of window k of n [time].
   pure function ends_of_window(t, k, n) result(ends)
      real(wp), intent(in) :: t(:)
      integer, intent(in) :: k, n
      real(wp) :: ends(2)

      ends = t(1) + (t(size(t)) - t(1))*[k - 1, k]/n
   end function ends_of_window

   !> Fits window k of n. Runs in threads.
   subroutine fit_one(model, mesh, experiments, fit, k, n, window)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: k, n
      type(window_fit_t), intent(out) :: window
      type(experiment_t) :: parts(size(experiments))
      type(residual_t) :: problem, exact
      type(stage_fit_t) :: found
      type(options_t) :: options
      logical, allocatable :: inside(:)
      real(wp) :: ends(2)
      integer :: i

      allocate (window%first(size(parts)), window%last(size(parts)))
      do i = 1, size(parts)
         associate (t => experiments(i)%samples)
            inside = in_window(t, k, n)
            ends = ends_of_window(t, k, n)
            parts(i) = experiments(i)
            parts(i)%samples = pack(t, inside)
            parts(i)%measured = pack(experiments(i)%measured, inside)
         end associate
         window%first(i) = ends(1)
         window%last(i) = ends(2)
         if (size(parts(i)%samples) <= size(fit%quantities)) then
            call failure(window%error, to_text(size(parts(i)%samples))//' samples for '// &
               to_text(size(fit%quantities))//' unknowns')
            return
         end if
         window%first(i) = parts(i)%samples(1)
         window%last(i) = parts(i)%samples(size(parts(i)%samples))
      end do
      call new_residuals(model, mesh, parts, problem, window%error, fit%free)
      if (allocated(window%error)) return
      if (.not. problem%exact) call exact_counterpart(model, mesh, parts, fit%free, exact)
      problem%scenario = fit%scenario
      options%relative_error = model%solver%relative_error()
      options%check = .false.
      call run_stage(problem, exact, fit%again(), options, '', found, window%error)
      if (allocated(window%error)) return
      window%estimate = found%fit%estimate
      window%std_error = found%statistics%corrected_error(:size(found%free))
      call fit_shown(mesh, parts, fit, found, options, problem, exact, window)
   end subroutine fit_one

   !> Fits a window again without the parameters that rest on modes which it does not show.
   !>
   !> parts           (records) samples of the window
   !> fit             of the whole records
   !> found           of the window, with all parameters
   !> problem, exact  as of the fit of the window
   !> window          with estimates and errors; on return with those of the second fit
   subroutine fit_shown(mesh, parts, fit, found, options, problem, exact, window)
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: parts(:)
      type(stage_fit_t), intent(in) :: fit
      type(stage_fit_t), intent(inout) :: found
      type(options_t), intent(in) :: options
      type(residual_t), intent(inout) :: problem, exact
      type(window_fit_t), intent(inout) :: window
      type(verdict_t) :: verdict
      type(stage_t) :: stage
      type(error_t), allocatable :: error

      window%shown_estimate = window%estimate
      window%shown_error = window%std_error
      call new_verdict(parts, mesh, found, verdict, error)
      window%is_shown = spread(.not. allocated(error), 1, size(found%free))
      if (allocated(error)) return
      window%is_shown = .not. verdict%lost
      if (all(window%is_shown) .or. .not. any(window%is_shown)) return
      stage = fit%again()
      problem%scenario = fit%scenario
      call run_stage(problem, exact, stage%without(verdict%lost), options, '', found, error)
      if (allocated(error)) then
         window%is_shown = .false.
         return
      end if
      window%shown_estimate = unpack(found%fit%estimate, window%is_shown, window%estimate)
      window%shown_error = unpack(found%statistics%corrected_error(:size(found%free)), &
         window%is_shown, window%std_error)
   end subroutine fit_shown

end module beamid_window_fits
