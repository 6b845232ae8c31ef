!> The commands for one case: `identify`, `profile`, `sample`, `bootstrap`, `simulate`, `modes`,
!> `frf` and `design`; and what all commands share: the settings from the command line and the
!> delivery of outputs. Each command has one routine, which reads the case, calls the library and
!> collects the outputs.
module beamid_commands
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid
   use beamid_case_fits, only: add_score_tests, case_fit_t, fail_if_rejected, fit_case, &
      judge_case, load_case
   use beamid_case_inferences, only: case_inference_t, infer
   use beamid_errors, only: locate
   use beamid_files, only: read_text
   use beamid_fit_reports, only: report_fit
   use beamid_identification, only: run_stages
   use beamid_inference_outputs, only: report_inferences
   use beamid_interrupts, only: check_interrupt
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_run_reports, only: run_case
   use beamid_sorting, only: median
   use beamid_strings, only: string_t, to_text
   use beamid_tables, only: labels_table
   use beamid_terminal, only: new_progress, print_text, progress_t, tell
   use beamid_texts, only: wrapped
   implicit none
   private

   public :: settings_t, run_identify, run_inference, run_on_case
   public :: deliver, folder_of

   !> The parsed command line.
   type :: settings_t
      character(len=:), allocatable :: command   !< name of the command
      character(len=:), allocatable :: subject   !< first word behind it, mostly the case file
      type(string_t), allocatable :: subjects(:) !< every word behind the command
      character(len=:), allocatable :: out       !< --out DIR; not allocated: out/<case name>
      logical :: quiet = .false.                 !< --quiet: no progress
      logical :: time = .false.                  !< --time: measure the time of a fit
      character(len=:), allocatable :: only      !< --only i:j: some members of an ensemble
      logical :: only_new = .false.              !< --only-new: cases without a valid result
      logical :: damping = .false.               !< --damping: compare damping mechanisms
      logical :: by_ratios = .false.             !< --damping=ratios: by damping ratios alone
      logical :: markdown = .false.              !< --markdown: the reference in Markdown
   end type settings_t

contains

   !> Runs `beamid identify`: fits the record and judges the fit.
   !>
   !> error  also a fit that the verdict rejects, after the outputs have been written
   subroutine run_identify(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(case_fit_t) :: found
      type(output_t) :: output
      character(len=:), allocatable :: summary

      call fit_and_judge(settings, case, found, error)
      if (.not. allocated(error)) call add_score_tests(case, found, error)
      if (allocated(error)) return
      call report_fit(case, found, output, summary, error)
      call locate(error, case%path)
      if (allocated(error)) return
      if (settings%time) call time_fits(case, found%experiments)
      call deliver(output, summary, settings, case%name, error, case)
      call fail_if_rejected(case, found, error)
   end subroutine run_identify

   !> Reads a case, fits it and judges the fit.
   subroutine fit_and_judge(settings, case, found, error)
      type(settings_t), intent(in) :: settings
      type(case_t), intent(out) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(progress_t) :: progress

      call read_case(settings%subject, needs_fit, case, error)
      if (.not. allocated(error)) call load_case(case, found, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call fit_case(case, found, error, progress)
      if (.not. allocated(error)) call judge_case(case, found, error, progress)
      call progress%finish()
   end subroutine fit_and_judge

   !> Repeats the fit on each mesh for about a second and prints the median time on standard error.
   !> The time is that of the fit and its statistics, without the comparison of exact derivatives
   !> with differences.
   subroutine time_fits(case, experiments)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      integer, parameter :: most = 101
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: seconds(most)
      integer(int64) :: begin, finish, rate
      integer :: mesh, k

      do mesh = 1, size(case%meshes)
         do k = 1, most
            call system_clock(begin, rate)
            call run_stages(case%model, case%meshes(mesh), case%stages, experiments, fits, &
               error, check=.false.)
            call system_clock(finish)
            seconds(k) = real(finish - begin, wp)/rate
            if (sum(seconds(:k)) > 1) exit
         end do
         call tell('time: N = '//to_text(case%meshes(mesh)%elements)//', median of '// &
            to_text(min(k, most))//' fits: '//to_text(median(seconds(:min(k, most))))//' s')
      end do
   end subroutine time_fits

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

      call fit_and_judge(settings, case, found, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call infer(trim(settings%command), case, found, inferences, error, progress)
      call progress%finish()
      if (allocated(error)) return
      call read_text(join_path(folder_of(settings, case%name), 'intervals.csv'), earlier, none)
      call report_inferences(trim(settings%command), case, found, inferences, earlier, output, &
         summary, error)
      if (allocated(error)) return
      call deliver(output, summary, settings, case%name, error, case)
   end subroutine run_inference

   !> Runs `beamid simulate`, `modes`, `frf` or `design`.
   subroutine run_on_case(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(progress_t) :: progress
      type(output_t) :: output
      character(len=:), allocatable :: summary

      call read_case(settings%subject, needs_nothing, case, error)
      if (allocated(error)) return
      progress = new_progress(settings%quiet)
      call run_case(settings%command, case, output, summary, error, progress)
      call progress%finish()
      if (.not. allocated(error)) call deliver(output, summary, settings, case%name, error, case)
   end subroutine run_on_case

   !> Writes all outputs to the output folder, all or none, and then prints the summary.
   !>
   !> name  name of the default folder in out/
   !> case  case file; its text and units are added for reports as case.txt and labels.csv, and the
   !>       outputs must not overwrite its records
   !>
   !> is_printed  whether the summary is printed; default .true.
   subroutine deliver(output, summary, settings, name, error, case, is_printed)
      type(output_t), intent(inout) :: output
      character(len=*), intent(in) :: summary, name
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t), intent(in), optional :: case
      logical, intent(in), optional :: is_printed
      character(len=:), allocatable :: folder, kind, lines, summary_file
      integer :: k

      folder = folder_of(settings, name)
      kind = settings%command
      if (kind == 'reproduce') kind = settings%subject
      call output%check_finite(error)
      if (allocated(error)) return
      lines = wrapped(summary)
      select case (settings%command)
      case ('profile', 'sample', 'bootstrap')
         summary_file = 'intervals.txt'    ! summary.txt belongs to the fit
      case default
         summary_file = 'summary.txt'
      end select
      call output%add(summary_file, lines)
      if (present(case)) then
         call output%add('case.txt', case%text, is_quoted=.true.)
         call output%add('labels.csv', labels_table(case%units))
         do k = 1, size(case%recordings)
            if (allocated(case%recordings(k)%path)) call output%spare(case%recordings(k)%path)
         end do
      end if
      call output%commit(folder, error, kind)
      ! A signal may have come during the exchange of the files.
      if (.not. allocated(error)) call check_interrupt(error)
      if (allocated(error)) return
      if (present(is_printed)) then
         if (.not. is_printed) return
      end if
      call print_text(lines, error)
      if (allocated(error)) error%message = error%message//'; the outputs are in '//folder
   end subroutine deliver

   !> Returns the output folder of a case: that of --out, or out/<name>.
   function folder_of(settings, name) result(folder)
      type(settings_t), intent(in) :: settings
      character(len=*), intent(in) :: name
      character(len=:), allocatable :: folder

      folder = 'out/'//name
      if (allocated(settings%out)) folder = settings%out
   end function folder_of

end module beamid_commands
