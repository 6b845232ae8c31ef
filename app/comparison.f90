!> The command `compare`: compares several models of one record, or damping mechanisms, by
!> information criteria and tests of nested models.
module beamid_comparison
   use beamid
   use beamid_candidates, only: candidate_t
   use beamid_commands, only: deliver, settings_t
   use beamid_comparison_reports, only: report_comparison
   use beamid_comparisons, only: check_samples, compare_damping, fit_candidates, new_candidate, &
      set_labels
   use beamid_damping_models, only: damping_models_t
   use beamid_outputs, only: output_t
   use beamid_strings, only: string_t
   use beamid_tables, only: labels_table
   use beamid_terminal, only: new_progress, progress_t
   use beamid_texts, only: text_t
   implicit none
   private

   public :: run_compare

contains

   !> Runs `beamid compare a.nml b.nml ...` on the last mesh of each case, or `beamid compare
   !> --damping case.nml`.
   subroutine run_compare(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(candidate_t), allocatable :: models(:)
      type(string_t), allocatable :: labels(:), names(:)
      type(progress_t) :: progress
      type(output_t) :: output
      character(len=:), allocatable :: summary
      type(text_t) :: cases
      integer :: k

      if (settings%damping) then
         call run_damping(settings, error)
         return
      end if
      associate (paths => settings%subjects)
         allocate (models(size(paths)), names(size(paths)))
         do k = 1, size(paths)
            call read_case(paths(k)%text, needs_fit, case, error)
            if (.not. allocated(error)) call new_candidate(case, models(k), error)
            if (.not. allocated(error)) call check_samples(models(k), models(1), case%path, &
               paths(1)%text, error)
            if (allocated(error)) return
            names(k)%text = case%name
            call cases%line('! '//paths(k)%text)
            call cases%add(case%text)
            call cases%line()
            if (k == 1) call output%add('labels.csv', labels_table(case%units))
         end do
         call set_labels(names, paths, labels)
         progress = new_progress(settings%quiet)
         call fit_candidates(models, paths, error, progress)
         call progress%finish()
      end associate
      if (allocated(error)) return
      call report_comparison(models, labels, output, summary)
      call output%add('case.txt', cases%content(), is_quoted=.true.)
      call deliver(output, summary, settings, 'compare', error)
   end subroutine run_compare

   !> Runs `beamid compare --damping case.nml`: compares damping mechanisms.
   subroutine run_damping(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(damping_models_t) :: found
      type(string_t), allocatable :: labels(:)
      type(progress_t) :: progress
      type(output_t) :: output
      character(len=:), allocatable :: summary

      call read_case(settings%subject, needs_fit, case, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call compare_damping(case, settings%by_ratios, found, labels, error, progress)
      call progress%finish()
      if (allocated(error)) return
      call report_comparison(found%models, labels, output, summary, found)
      call deliver(output, summary, settings, case%name, error, case)
   end subroutine run_damping

end module beamid_comparison
