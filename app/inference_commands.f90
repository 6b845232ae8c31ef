!> The commands `profile`, `sample` and `bootstrap`, which start from an accepted fit.
module beamid_inference_commands
   use beamid
   use beamid_case_fits, only: case_fit_t, fit_case, judge_case, load_case
   use beamid_case_inferences, only: case_inference_t, infer
   use beamid_commands, only: deliver, folder_of, settings_t
   use beamid_files, only: read_text
   use beamid_inference_outputs, only: report_inferences
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_terminal, only: new_progress, progress_t
   implicit none
   private

   public :: run_inference

contains

   !> Runs `beamid profile`, `sample` or `bootstrap`: fits the last stage on every mesh, then
   !> computes the inference, and completes the table of the intervals by all methods.
   subroutine run_inference(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(case_fit_t) :: found
      type(case_inference_t), allocatable :: inferences(:)
      type(output_t) :: output
      type(progress_t) :: progress
      character(len=:), allocatable :: earlier, summary
      type(error_t), allocatable :: none

      call read_case(settings%subject, needs_fit, case, error)
      if (.not. allocated(error)) call load_case(case, found, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call fit_case(case, found, error, progress)
      if (.not. allocated(error)) call judge_case(case, found, error, progress)
      call progress%finish()
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call infer(trim(settings%command), case, found, inferences, error, progress)
      call progress%finish()
      if (allocated(error)) return
      call read_text(join_path(folder_of(settings, case%name), 'intervals.csv'), earlier, none)
      call report_inferences(trim(settings%command), case, found, inferences, earlier, output, &
         summary, error)
      if (allocated(error)) return
      call deliver(output, summary, settings, case%name, error, case%recordings)
   end subroutine run_inference

end module beamid_inference_commands
