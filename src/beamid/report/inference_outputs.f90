!> The complete report of profile, sample and bootstrap: their tables, the table intervals.csv of
!> all methods, and the summary. The command line and the interface for C print the same report.
module beamid_inference_outputs
   use beamid_case_files, only: case_t
   use beamid_case_fits, only: case_fit_t
   use beamid_case_inferences, only: case_inference_t
   use beamid_errors, only: error_t
   use beamid_inference_reports, only: add_bootstrap, add_posterior, add_profiles, &
      posterior_header
   use beamid_interrupts, only: check_interrupt
   use beamid_intervals, only: interval_summary, interval_t, interval_table, linear_intervals, &
      read_intervals
   use beamid_number_tables, only: add_number_table, number_table_t
   use beamid_outputs, only: output_t
   use beamid_strings, only: to_text
   use beamid_texts, only: text_t
   implicit none
   private

   public :: report_inferences

contains

   !> Reports inferences about the last stage of a fit.
   !>
   !> command     'profile', 'sample' or 'bootstrap', as of `infer`
   !> inferences  (meshes)
   !> earlier     text of intervals.csv from an earlier command, or ''; its rows are kept if they
   !>             belong to the same fit
   !> output      gets the tables
   !> summary     text for the reader
   subroutine report_inferences(command, case, found, inferences, earlier, output, summary, error)
      character(len=*), intent(in) :: command, earlier
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(in) :: found
      type(case_inference_t), intent(in) :: inferences(:)
      type(output_t), intent(inout) :: output
      character(len=:), allocatable, intent(out) :: summary
      !> The computation was interrupted: tables and summary are incomplete.
      type(error_t), allocatable, intent(out) :: error
      type(interval_t), allocatable :: intervals(:)
      type(text_t) :: text, profiles, motion, modes, estimates
      type(number_table_t), allocatable :: draws
      type(text_t) :: remarks(size(inferences))
      integer :: k

      allocate (intervals(0), draws)
      do k = 1, size(inferences)
         associate (last => found%fits(size(found%fits, 1), k), here => inferences(k))
            if (allocated(here%sides)) call add_profiles(case, last, here%sides, profiles, &
               intervals, remarks(k))
            if (allocated(here%posterior)) call add_posterior(case, case%meshes(k), &
               found%experiments, last, here%posterior, draws, motion, modes, intervals, &
               remarks(k))
            if (allocated(here%resampled)) call add_bootstrap(case, last, here%resampled, &
               estimates, intervals, remarks(k))
            call linear_intervals(last, case%units, intervals)
         end associate
      end do
      call read_intervals(earlier, intervals)
      call text%line(case%name//': '//command//', last stage')
      do k = 1, size(inferences)
         associate (last => found%fits(size(found%fits, 1), k))
            call text%line()
            call text%line('N = '//to_text(last%elements)//', J = '//to_text(last%fit%J)//', '// &
               to_text(last%statistics%samples)//' samples')
            call text%add(remarks(k)%content())
            call interval_summary(intervals, last, text)
         end associate
      end do
      call add('profiles.csv', profiles)
      if (draws%rows > 0) call add_number_table(output, 'posterior.csv', &
         posterior_header(found%fits(size(found%fits, 1), 1)), draws)
      call add('posterior_motion.csv', motion)
      call add('posterior_modes.csv', modes)
      call add('bootstrap.csv', estimates)
      call output%add('intervals.csv', interval_table(intervals))
      summary = text%content()
      call check_interrupt(error)

   contains

      !> Adds a file to the output unless it is empty.
      subroutine add(name, content)
         character(len=*), intent(in) :: name
         type(text_t), intent(in) :: content

         if (.not. content%is_empty()) call output%add(name, content%content())
      end subroutine add

   end subroutine report_inferences

end module beamid_inference_outputs
