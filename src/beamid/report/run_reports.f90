!> The reports of the commands simulate, modes, frf and design: tables and summary. The command
!> line and the interface for C use the same reports.
module beamid_run_reports
   use beamid_case_files, only: case_t
   use beamid_case_runs, only: case_modes_t, design_case, modes_of_case, planned_t, &
      prepare_design, prepare_modes, prepare_simulation, simulate_case, simulated_t
   use beamid_design_reports, only: design_summary
   use beamid_design_tables, only: design_table
   use beamid_designs, only: designs_t
   use beamid_errors, only: error_t
   use beamid_fit_reports, only: add_modes_of_fits
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_frequency_runs, only: case_response_t, compute_responses, prepare_responses
   use beamid_interrupts, only: check_interrupt
   use beamid_least_squares, only: monitor_t
   use beamid_mode_summaries, only: add_refinement_warning, modes_summary
   use beamid_noise, only: gaussian_noise
   use beamid_outputs, only: output_t
   use beamid_response_reports, only: report_responses
   use beamid_shape_tables, only: add_shapes
   use beamid_strings, only: to_text
   use beamid_summaries, only: response_summary
   use beamid_tables, only: add_modes, add_record_table, add_response_table, labels_table, &
      modes_header
   use beamid_texts, only: text_t
   implicit none
   private

   public :: run_case

contains

   !> Runs the command `simulate`, `modes`, `frf` or `design` on a case, and reports the results.
   !>
   !> The critical sections are for programs that run several cases at a time. They work with text;
   !> the computation does not, and may run beside others.
   !>
   !> case     read without its needs; on return as it was computed
   !> output   on return with the tables of the command
   !> summary  text for the user
   subroutine run_case(command, case, output, summary, error, monitor)
      character(len=*), intent(in) :: command
      type(case_t), intent(inout) :: case
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(simulated_t) :: simulated
      type(case_modes_t) :: found
      type(planned_t) :: planned
      type(designs_t) :: designs
      type(case_response_t) :: responses

      !$omp critical (texts_of_beamid)
      select case (command)
      case ('simulate'); call prepare_simulation(case, simulated, error)
      case ('modes'); call prepare_modes(case, found, error)
      case ('frf'); call prepare_responses(case, responses, error)
      case ('design'); call prepare_design(case, planned, error)
      end select
      !$omp end critical (texts_of_beamid)
      if (allocated(error)) return
      select case (command)
      case ('simulate'); call simulate_case(case, simulated, error)
      case ('modes'); call modes_of_case(case, found, error, monitor)
      case ('frf'); call compute_responses(case, responses, error, monitor)
      case ('design'); call design_case(case, planned, designs, error, monitor)
      end select
      call check_interrupt(error)
      if (allocated(error)) return
      !$omp critical (texts_of_beamid)
      select case (command)
      case ('simulate'); call report_simulation(case, simulated, output, summary)
      case ('modes'); call report_modes(case, found, output, summary)
      case ('frf'); call report_responses(case, responses, output, summary)
      case ('design'); call report_design(case, designs, output, summary)
      end select
      call output%check_finite(error)
      !$omp end critical (texts_of_beamid)
   end subroutine run_case

   !> Reports a simulation: response.csv on every mesh, and record.csv with noise, of the last mesh.
   subroutine report_simulation(case, simulated, output, summary)
      type(case_t), intent(in) :: case
      type(simulated_t), intent(in) :: simulated
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(text_t) :: text
      integer, allocatable :: elements(:)

      elements = case%meshes%elements
      call add_response_table(output, elements, simulated%simulations)
      ! The record is in the units of the sensor: `identify` undoes scale and offset.
      associate (recording => case%recordings(1), &
         last => simulated%simulations(size(simulated%simulations)))
         call add_record_table(output, simulated%times, (last%acceleration + &
            gaussian_noise(size(simulated%times), case%noise_sd, case%noise_seed)) &
            /recording%scale + recording%offset)
      end associate
      call output%add('labels.csv', labels_table(case%units))
      if (.not. simulated%converged) call text%line('warning: mesh: from '// &
         to_text(case%meshes(1)%elements/2)//' to '//to_text(case%meshes(1)%elements)// &
         ' elements the acceleration still changes by '//to_text(simulated%remaining)// &
         ' rms; use a higher degree (degree=5) or more elements')
      call text%add(response_summary(case, simulated%simulations))
      summary = text%content()
   end subroutine report_simulation

   !> Reports natural modes: modes.csv on every mesh, shapes.csv of the last mesh and, if the case
   !> could be fitted, modes_fitted.csv.
   subroutine report_modes(case, found, output, summary)
      type(case_t), intent(in) :: case
      type(case_modes_t), intent(in) :: found
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(text_t) :: table, text
      integer :: k

      call table%line(modes_header)
      call add_refinement_warning(text, found%remaining)
      call text%line(case%name//': natural modes')
      do k = 1, size(case%meshes)
         associate (here => found%meshes(k), elements => case%meshes(k)%elements)
            call add_modes(table, elements, here%roots)
            if (k == size(case%meshes)) call add_shapes(output, case%model%structure, &
               case%meshes(k), here%roots, text)
            call text%line()
            call modes_summary(text, case, elements, here%omega, here%roots)
         end associate
      end do
      call output%add('modes.csv', table%content())
      if (found%is_fitted) call add_fit_of_modes(found, text, output)
      summary = text%content()
   end subroutine report_modes

   !> Adds the modes of the fitted structure with intervals, or the reason why there is no fit.
   subroutine add_fit_of_modes(found, summary, output)
      type(case_modes_t), intent(in) :: found
      type(text_t), intent(inout) :: summary
      type(output_t), intent(inout) :: output
      type(fitted_mode_t), allocatable :: modes(:)
      type(error_t), allocatable :: error
      type(text_t) :: table

      call summary%line()
      if (allocated(found%fit_error)) then
         error = found%fit_error
      else
         call add_modes_of_fits(found%case, found%fit%fits, summary, table, modes, error)
      end if
      if (allocated(error)) then
         call summary%line('no intervals: '//error%message)
         return
      end if
      call output%add('modes_fitted.csv', table%content())
   end subroutine add_fit_of_modes

   !> Reports a design: design.csv with all candidate experiments.
   subroutine report_design(case, designs, output, summary)
      type(case_t), intent(in) :: case
      type(designs_t), intent(in) :: designs
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary

      call output%add('design.csv', design_table(designs))
      call output%add('labels.csv', labels_table(case%units))
      summary = design_summary(case, case%meshes(size(case%meshes))%elements, designs)
   end subroutine report_design

end module beamid_run_reports
