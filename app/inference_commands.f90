!> The commands that ask more of a record than one fit: profile, sample and bootstrap.
module beamid_inference_commands
   use beamid
   use beamid_case_fits, only: case_fit_t, fit_case, judge_case, load_case
   use beamid_commands, only: deliver, folder_of, settings_t
   use beamid_errors, only: locate
   use beamid_files, only: read_text
   use beamid_inference, only: bootstrap_fit, bootstrap_t, posterior_draws_t, profile_fit, &
      sample_fit
   use beamid_inference_reports, only: add_bootstrap, add_posterior, add_profiles
   use beamid_intervals, only: interval_summary, interval_t, interval_table, linear_intervals, &
      read_intervals
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_profile_likelihood, only: side_t
   use beamid_strings, only: to_text
   use beamid_terminal, only: new_progress, progress_t
   use beamid_texts, only: text_t
   implicit none
   private

   public :: run_inference

contains

   !> beamid profile, sample, bootstrap: the fit of the last stage on every mesh, then what the
   !> command adds, and one table of all intervals that are known of this fit.
   subroutine run_inference(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(case_fit_t) :: found
      type(output_t) :: output
      type(progress_t) :: progress
      type(interval_t), allocatable :: intervals(:)
      type(side_t), allocatable :: sides(:, :)
      type(posterior_draws_t), allocatable :: posterior
      type(bootstrap_t), allocatable :: resampled
      type(text_t) :: text, profiles, draws, motion, modes, estimates
      type(text_t), allocatable :: remarks(:)
      character(len=:), allocatable :: earlier
      type(error_t), allocatable :: none
      integer :: k

      call read_case(settings%subject, needs_fit, case, error)
      if (.not. allocated(error)) call load_case(case, found, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call fit_case(case, found, error, progress)
      if (.not. allocated(error)) call judge_case(case, found, error)
      call progress%finish()
      if (allocated(error)) return
      if (found%verdict%no_fit /= '') then
         call failure(error, case%path//': no fit: '//found%verdict%no_fit)
         return
      end if
      allocate (intervals(0), remarks(size(case%meshes)))
      progress = new_progress(settings%quiet)
      do k = 1, size(case%meshes)
         associate (mesh => case%meshes(k), last => found%fits(size(found%fits, 1), k), &
            model => case%model, experiments => found%experiments)
            if (settings%command /= 'bootstrap') then
               call profile_fit(model, mesh, experiments, last, sides, error, progress)
               if (.not. allocated(error)) call add_profiles(case, last, sides, profiles, &
                  intervals, remarks(k))
            end if
            if (settings%command == 'sample' .and. .not. allocated(error)) then
               allocate (posterior)
               call sample_fit(model, mesh, experiments, last, sides, case%sampling, posterior, &
                  error)
               if (.not. allocated(error)) call add_posterior(case, mesh, experiments, last, &
                  posterior, draws, motion, modes, intervals, remarks(k))
               deallocate (posterior)
            else if (settings%command == 'bootstrap') then
               allocate (resampled)
               call bootstrap_fit(model, mesh, experiments, last, case%bootstrap, resampled, error, &
                  progress)
               if (.not. allocated(error)) call add_bootstrap(case, last, resampled, estimates, &
                  intervals, remarks(k))
               deallocate (resampled)
            end if
            call locate(error, case%path//': elements = '//to_text(mesh%elements))
            if (allocated(error)) exit
            call linear_intervals(last, case%units, intervals)
         end associate
      end do
      call progress%finish()
      if (allocated(error)) return
      call read_text(join_path(folder_of(settings, case%name), 'intervals.csv'), earlier, none)
      call read_intervals(earlier, intervals)
      call text%line(case%name//': '//trim(settings%command)//', last stage')
      do k = 1, size(case%meshes)
         associate (last => found%fits(size(found%fits, 1), k))
            call text%line()
            call text%line('N = '//to_text(last%elements)//', J = '//to_text(last%fit%J)//', '// &
               to_text(last%statistics%samples)//' samples')
            call text%add(remarks(k)%content())
            call interval_summary(intervals, last, text)
         end associate
      end do
      call add('profiles.csv', profiles)
      call add('posterior.csv', draws)
      call add('posterior_motion.csv', motion)
      call add('posterior_modes.csv', modes)
      call add('bootstrap.csv', estimates)
      call output%add('intervals.csv', interval_table(intervals))
      call deliver(output, text%content(), settings, case%name, error, case%recordings)

   contains

      !> A file, unless nothing was written to it.
      subroutine add(name, content)
         character(len=*), intent(in) :: name
         type(text_t), intent(in) :: content

         if (.not. content%is_empty()) call output%add(name, content%content())
      end subroutine add

   end subroutine run_inference

end module beamid_inference_commands
