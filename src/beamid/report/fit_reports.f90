!> The complete report of a case's fit: all its tables and its summary. The command line and the
!> interface for C print the same report.
module beamid_fit_reports
   use beamid_along_reports, only: add_along_table
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t
   use beamid_errors, only: error_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_mode_summaries, only: fitted_modes_summary, minima_summary
   use beamid_outputs, only: output_t
   use beamid_refinement, only: of_higher_degree
   use beamid_response_reports, only: add_fitted_responses, add_measured_modes
   use beamid_score_reports, only: add_score_lines, add_score_table
   use beamid_shape_tables, only: add_shapes
   use beamid_summaries, only: fit_summary
   use beamid_tables, only: add_fit_tables, add_fitted_modes, add_minima, fitted_modes_header, &
      minima_header
   use beamid_texts, only: text_t
   use beamid_verdict_reports, only: add_verdict_tables
   use beamid_window_reports, only: add_drifts, add_window_table, window_summary
   implicit none
   private

   public :: report_fit, add_modes_of_fits

contains

   !> Reports the fit of a case.
   !>
   !> output   gets the tables
   !> summary  text for the reader
   !> error    the modes of the fitted structure cannot be computed
   !> modes    modes of the fitted structure on the finest mesh
   subroutine report_fit(case, found, output, summary, error, modes)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(in) :: found
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      type(fitted_mode_t), allocatable, intent(out), optional :: modes(:)
      type(fitted_mode_t), allocatable :: last_modes(:)
      type(text_t) :: text, table, minima
      integer :: k

      associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
         if (found%verdict%early /= '') call text%line(found%verdict%early)
         if (found%verdict%no_fit == '') call add_drifts(text, last, found%drift)
         if (found%verdict%no_fit == '') call add_score_lines(text, case, last, &
            [found%tests, found%harmonics])
         call add_score_table(output, last, [found%tests, found%harmonics])
      end associate
      call text%add(fit_summary(case, found%experiments, found%fits, found%notes, found%verdict))
      if (size(found%minima) > 0) then
         call minima%line(minima_header)
         do k = 1, size(found%minima)
            call text%line()
            call minima_summary(text, case, case%meshes(k)%elements, found%minima(k)%list, &
               found%minima(k)%failures)
            call add_minima(minima, case%meshes(k)%elements, found%minima(k)%list)
         end do
         call output%add('minima.csv', minima%content())
      end if
      call add_modes_of_fits(case, found%fits, text, table, last_modes, error, output)
      if (allocated(error)) return
      if (present(modes)) call move_alloc(last_modes, modes)
      call add_fit_tables(output, case%units, found%fits, found%experiments)
      call add_fitted_responses(output, found%fits(size(found%fits, 1), :), found%experiments)
      call add_measured_modes(output, found%fits(size(found%fits, 1), :), found%experiments)
      call add_along_table(output, case%units, found%fits(size(found%fits, 1), :))
      call add_verdict_tables(output, found%verdict)
      call output%add('case.txt', case%text, is_quoted=.true.)
      call output%add('modes.csv', table%content())
      associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
         if (size(found%windows) > 0) call text%add(window_summary(last, found%windows, &
            found%drift))
         if (size(found%windows) > 0) call add_window_table(output, last, found%windows)
      end associate
      summary = text%content()
   end subroutine report_fit

   !> Adds the modes of the structure that the last stage has estimated, with their intervals.
   !>
   !> fits            (stages, meshes)
   !> summary, table  get the modes
   !> modes           on the finest mesh
   !> output          gets the mode shapes for the first record
   subroutine add_modes_of_fits(case, fits, summary, table, modes, error, output)
      type(case_t), intent(in) :: case
      type(stage_fit_t), intent(in) :: fits(:, :)
      type(text_t), intent(inout) :: summary, table
      type(fitted_mode_t), allocatable, intent(out) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      type(output_t), intent(inout), optional :: output
      !> Number of modes.
      integer, parameter :: most = 5
      type(mesh_t) :: finer
      integer :: k

      call table%line(fitted_modes_header)
      do k = 1, size(case%meshes)
         finer = of_higher_degree(case%meshes(k))
         finer%elements = 2*finer%elements
         call fitted_modes(case%meshes(k), fits(size(fits, 1), k), most, modes, error, finer)
         if (allocated(error)) return
         call add_fitted_modes(table, case%meshes(k)%elements, modes)
      end do
      call summary%line()
      associate (mesh => case%meshes(size(case%meshes)), last => fits(size(fits, 1), size(fits, 2)))
         call fitted_modes_summary(summary, case, mesh%elements, modes)
         if (.not. present(output)) return
         call add_shapes(output, last%scenario%structures(1), mesh, pack([(modes(k)%s, &
            k=1, size(modes))], [(modes(k)%record == 1, k=1, size(modes))]), summary)
      end associate
   end subroutine add_modes_of_fits

end module beamid_fit_reports
