!> The reports of the commands simulate, modes and design: tables and summary. The command line and
!> the interface for C use the same reports.
module beamid_run_reports
   use beamid_case_files, only: case_t
   use beamid_case_runs, only: case_modes_t, simulated_t
   use beamid_design_reports, only: design_summary, design_table
   use beamid_designs, only: designs_t
   use beamid_errors, only: error_t
   use beamid_fit_reports, only: add_modes_of_fits
   use beamid_fitted_modes, only: fitted_mode_t
   use beamid_mode_summaries, only: modes_summary
   use beamid_noise, only: gaussian_noise
   use beamid_outputs, only: output_t
   use beamid_shape_tables, only: add_shapes
   use beamid_strings, only: to_text
   use beamid_summaries, only: response_summary
   use beamid_tables, only: add_modes, labels_table, modes_header, record_table, response_table
   use beamid_texts, only: text_t
   implicit none
   private

   public :: report_simulation, report_modes, report_design

contains

   !> Reports a simulation: response.csv on every mesh, and record.csv with noise, of the last mesh.
   subroutine report_simulation(case, simulated, output, summary)
      type(case_t), intent(in) :: case
      type(simulated_t), intent(in) :: simulated
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      type(text_t) :: text
      integer, allocatable :: elements(:)

      elements = case%meshes%elements
      call output%add('response.csv', response_table(elements, simulated%simulations))
      ! The record is in the units of the sensor: `identify` undoes scale and offset.
      associate (recording => case%recordings(1), &
         last => simulated%simulations(size(simulated%simulations)))
         call output%add('record.csv', record_table(simulated%times, (last%acceleration + &
            gaussian_noise(size(simulated%times), case%noise_sd, case%noise_seed)) &
            /recording%scale + recording%offset))
      end associate
      call output%add('labels.csv', labels_table(case%units))
      if (.not. simulated%converged) call text%line('warning: mesh: from '// &
         to_text(case%meshes(1)%elements/2)//' to '//to_text(case%meshes(1)%elements)// &
         ' elements the acceleration still changes by '//to_text(simulated%remaining)// &
         ' rms; use more elements')
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
         call add_modes_of_fits(found%case, found%fits, summary, table, modes, error)
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
