!> The command `design`: predicts the standard errors that candidate experiments would give, and
!> reports the best of them.
module beamid_design
   use beamid
   use beamid_cases, only: needs_design, plan_experiments
   use beamid_commands, only: deliver, settings_t
   use beamid_design_reports, only: design_summary
   use beamid_design_tables, only: design_table
   use beamid_errors, only: locate
   use beamid_outputs, only: output_t
   use beamid_strings, only: to_text
   use beamid_tables, only: labels_table
   implicit none
   private

   public :: run_design

contains

   !> Runs the command with the exact solver on the last mesh of the case, whatever solver it names.
   subroutine run_design(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(box_t) :: box
      type(experiment_t), allocatable :: experiments(:)
      type(designs_t) :: designs
      type(output_t) :: output

      call read_case(settings%subject, needs_design, case, error)
      if (.not. allocated(error)) call plan_experiments(case, box, experiments, error)
      if (allocated(error)) return
      deallocate (case%model%solver)
      allocate (modal_t :: case%model%solver)
      associate (mesh => case%meshes(size(case%meshes)))
         call compare_designs(case%model, mesh, case%stages(size(case%stages)), experiments, &
            box, designs, error)
         call locate(error, case%path//':'//to_text(case%design_line)//': &design')
         if (allocated(error)) return
         call output%add('design.csv', design_table(designs))
         call output%add('labels.csv', labels_table(case%units))
         call deliver(output, design_summary(case, mesh%elements, designs), settings, case%name, &
            error, case%recordings)
      end associate
   end subroutine run_design

end module beamid_design
