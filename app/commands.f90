!> The commands for one case: `identify`, `profile`, `sample`, `bootstrap`, `simulate`, `modes` and
!> `design`; and what all commands share: the settings from the command line and the delivery of
!> outputs. Each command has one routine, which reads the case, calls the library and collects the
!> outputs.
module beamid_commands
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid
   use beamid_case_fits, only: add_score_tests, case_fit_t, fit_case, judge_case, load_case
   use beamid_case_inferences, only: case_inference_t, infer
   use beamid_cases, only: can_be_fitted, needs_design, plan_experiments
   use beamid_design_reports, only: design_summary, design_table
   use beamid_errors, only: locate
   use beamid_files, only: read_text
   use beamid_fit_reports, only: add_modes_of_fits, report_fit
   use beamid_inference_outputs, only: report_inferences
   use beamid_interrupts, only: check_interrupt
   use beamid_mode_summaries, only: modes_summary
   use beamid_outputs, only: output_t
   use beamid_paths, only: join_path
   use beamid_shape_tables, only: add_shapes
   use beamid_simulation, only: simulate_converged
   use beamid_sorting, only: median
   use beamid_strings, only: string_t, to_text
   use beamid_summaries, only: response_summary
   use beamid_tables, only: add_modes, labels_table, modes_header, record_table, response_table
   use beamid_terminal, only: new_progress, print_text, progress_t, tell
   use beamid_texts, only: text_t, wrapped
   implicit none
   private

   public :: settings_t, run_identify, run_inference, run_simulate, run_modes, run_design
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
      call deliver(output, summary, settings, case%name, error, case%recordings)
      if (.not. allocated(error) .and. found%verdict%no_fit /= '') call failure(error, &
         case%path//': no fit: '//found%verdict%no_fit)
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
            call identify(case%model, case%meshes(mesh), case%stages, experiments, fits, &
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
      call deliver(output, summary, settings, case%name, error, case%recordings)
   end subroutine run_inference

   !> Runs `beamid simulate`: computes the response on each mesh, or without `elements` on a mesh
   !> that is refined until the response no longer changes, and a record of the last mesh.
   subroutine run_simulate(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(simulation_t), allocatable :: simulations(:)
      type(output_t) :: output
      type(text_t) :: summary
      real(wp), allocatable :: times(:)
      real(wp) :: remaining
      integer, allocatable :: elements(:)
      integer :: k
      logical :: converged

      call read_case(settings%subject, needs_response, case, error)
      if (allocated(error)) return
      call sample_times(case, times, error)
      if (allocated(error)) return
      allocate (simulations(size(case%meshes)))
      converged = .true.
      do k = 1, size(case%meshes)
         if (case%refines) then
            call simulate_converged(case%model, times, case%noise_sd, case%meshes(k), &
               simulations(k), remaining, converged, error)
         else
            call simulate(case%model, case%meshes(k), times, simulations(k), error)
         end if
         call locate(error, case%path//': elements = '//to_text(case%meshes(k)%elements))
         if (allocated(error)) return
      end do
      elements = case%meshes%elements
      call output%add('response.csv', response_table(elements, simulations))
      ! The record is in the units of the sensor: `identify` undoes scale and offset.
      associate (recording => case%recordings(1), last => simulations(size(simulations)))
         call output%add('record.csv', record_table(times, (last%acceleration + &
            gaussian_noise(size(times), case%noise_sd, case%noise_seed))/recording%scale &
            + recording%offset))
      end associate
      call output%add('labels.csv', labels_table(case%units))
      if (.not. converged) call summary%line('warning: mesh: from '//to_text(elements(1)/2)// &
         ' to '//to_text(elements(1))//' elements the acceleration still changes by '// &
         to_text(remaining)//' rms')
      call summary%add(response_summary(case, simulations))
      call deliver(output, summary%content(), settings, case%name, error, case%recordings)
   end subroutine run_simulate

   !> Runs `beamid modes`: computes the natural modes of the structure and, if the case can be
   !> fitted, of the fitted structure.
   subroutine run_modes(settings, error)
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(case_t) :: case
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(excitation_t) :: still
      type(output_t) :: output
      type(text_t) :: table, summary
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp), allocatable :: roots(:)
      integer :: k

      call read_case(settings%subject, needs_modes, case, error)
      if (allocated(error)) return
      still = new_pulse(0.0_wp, 1.0_wp)
      call table%line(modes_header)
      call summary%line(case%name//': natural modes')
      do k = 1, size(case%meshes)
         galerkin = galerkin_of(case%meshes(k), case%model%structure)
         equations = new_equations(galerkin, case%model%structure, still)
         call undamped_modes(equations, omega, shapes, error)
         if (.not. allocated(error)) call damped_roots(equations, roots, error)
         call locate(error, case%path//': elements = '//to_text(case%meshes(k)%elements))
         if (allocated(error)) return
         call add_modes(table, case%meshes(k)%elements, roots)
         if (k == size(case%meshes)) call add_shapes(output, case%model%structure, &
            case%meshes(k), roots, summary)
         call summary%line()
         call modes_summary(summary, case, case%meshes(k)%elements, omega, roots)
      end do
      call output%add('modes.csv', table%content())
      if (can_be_fitted(case)) call add_fit_of_modes(case, settings%quiet, summary, output)
      call deliver(output, summary%content(), settings, case%name, error, case%recordings)
   end subroutine run_modes

   !> Adds the modes of the fitted structure with intervals, if the fit succeeds. If it fails, the
   !> summary says why; this is not an error, because the modes of the declared structure are known.
   subroutine add_fit_of_modes(case, quiet, summary, output)
      type(case_t), intent(in) :: case
      logical, intent(in) :: quiet
      type(text_t), intent(inout) :: summary
      type(output_t), intent(inout) :: output
      type(case_t) :: exact
      type(stage_fit_t), allocatable :: fits(:, :)
      type(experiment_t), allocatable :: experiments(:)
      character(len=note_length), allocatable :: notes(:)
      type(fitted_mode_t), allocatable :: modes(:)
      type(progress_t) :: progress
      type(error_t), allocatable :: error
      type(text_t) :: table

      progress = new_progress(quiet)
      exact = case
      deallocate (exact%model%solver)
      allocate (modal_t :: exact%model%solver)
      call load_experiments(exact, experiments, notes, error)
      if (.not. allocated(error)) call identify_meshes(exact%model, exact%meshes, exact%stages, &
         experiments, fits, error, progress)
      call progress%finish()
      call summary%line()
      if (.not. allocated(error)) call add_modes_of_fits(exact, fits, summary, table, &
         modes, error)
      if (allocated(error)) then
         call summary%line('no intervals: '//error%message)
         return
      end if
      call output%add('modes_fitted.csv', table%content())
   end subroutine add_fit_of_modes

   !> Runs `beamid design`: predicts the standard errors that candidate experiments would give, with
   !> the exact solver on the last mesh of the case, whatever solver the case names.
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

   !> Writes all outputs to the output folder, all or none, and then prints the summary.
   !>
   !> name        name of the default folder in out/
   !> recordings  inputs, which the outputs must not overwrite
   subroutine deliver(output, summary, settings, name, error, recordings)
      type(output_t), intent(inout) :: output
      character(len=*), intent(in) :: summary, name
      type(settings_t), intent(in) :: settings
      type(error_t), allocatable, intent(out) :: error
      type(recording_t), intent(in), optional :: recordings(:)
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
      if (present(recordings)) then
         do k = 1, size(recordings)
            if (allocated(recordings(k)%path)) call output%spare(recordings(k)%path)
         end do
      end if
      call output%commit(folder, error, kind)
      ! A signal may have come during the exchange of the files.
      if (.not. allocated(error)) call check_interrupt(error)
      if (allocated(error)) return
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
