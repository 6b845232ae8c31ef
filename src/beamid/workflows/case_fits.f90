!> The fit that a case asks for: loads its records, fits its stages on the given meshes or on
!> refined ones, from one start or from several, and judges the result.
module beamid_case_fits
   use beamid_case_files, only: case_t
   use beamid_cases, only: load_experiments, scored_samples
   use beamid_damage_regions, only: judge_shape_of_dip
   use beamid_drifts, only: default_windows, drift_t, find_drifts
   use beamid_errors, only: error_t, failure, locate, status_failed
   use beamid_experiments, only: experiment_t
   use beamid_fixed_parameters, only: add_fixed_parameters
   use beamid_galerkin, only: mesh_t
   use beamid_harmonics, only: test_harmonics
   use beamid_identification, only: identify_meshes, score_fits, stage_fit_t
   use beamid_input_checks, only: add_causes, check_input, describe_scale
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_memory, only: return_memory
   use beamid_multistart, only: identify_meshes_from_many, minima_t
   use beamid_range_limits, only: judge_ranges
   use beamid_records, only: add_note, note_length
   use beamid_refinement, only: add_mesh_shift, identify_refining
   use beamid_response_checks, only: check_responses
   use beamid_responses, only: is_exact
   use beamid_score_tests, only: score_test_t, test_candidates
   use beamid_strings, only: rounded
   use beamid_structure, only: is_coefficient, of_x_D
   use beamid_unknowns, only: stage_t
   use beamid_verdicts, only: implausible, new_verdict, verdict_t
   use beamid_weak_estimates, only: widen_weak_estimates
   use beamid_window_fits, only: fit_windows, window_fit_t
   implicit none
   private

   public :: case_fit_t, load_case, fit_case, find_fits, add_mesh_shifts, judge_case, &
      fail_if_rejected, add_score_tests

   !> The records of a case, its fit and the verdict on it.
   type :: case_fit_t
      type(experiment_t), allocatable :: experiments(:)        !< (records)
      character(len=note_length), allocatable :: notes(:)      !< on the records, one sentence each
      !> (m) sample times [time] and values [length/time**2] in the window of &score, over which
      !> squared residuals are summed after the fit; of size 0: no &score
      real(wp), allocatable :: scored(:), expected(:)
      type(stage_fit_t), allocatable :: fits(:, :)             !< (stages, meshes)
      type(minima_t), allocatable :: minima(:)                 !< (meshes); of size 0: one start
      type(verdict_t) :: verdict                               !< on the last stage, finest mesh
      type(window_fit_t), allocatable :: windows(:)            !< of size 0: no &windows
      type(drift_t) :: drift                                   !< whether parameters are constant
      type(score_test_t), allocatable :: tests(:), harmonics(:)   !< of size 0: none
   end type case_fit_t

contains

   !> Loads the records of a case and the samples of &score.
   !>
   !> found  initial; on return with the records, nothing fitted
   !> error  records that cannot be read or do not go together
   subroutine load_case(case, found, error)
      type(case_t), intent(inout) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error

      allocate (found%minima(0), found%windows(0), found%tests(0), found%harmonics(0))
      call load_experiments(case, found%experiments, found%notes, error)
      if (.not. allocated(error)) call check_input(case, found%experiments, found%notes, error)
      if (.not. allocated(error)) call check_responses(case, found%experiments, found%notes, error)
      if (.not. allocated(error)) call scored_samples(case, found%scored, found%expected, error)
      call return_memory_of(found)
   end subroutine load_case

   !> Fits all stages of a case.
   !>
   !> case   on return with the last mesh tried, if the mesh is refined automatically
   !> found  as `load_case` returns it; on return with the fits
   !> error  a fit that fails, or an interruption
   !> check  .false.: do not compare exact derivatives with differences; default .true.
   subroutine fit_case(case, found, error, monitor, check)
      type(case_t), intent(inout) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check
      type(mesh_t), allocatable :: meshes(:)

      ! A copy, because find_fits must not change part of the case that it reads.
      meshes = case%meshes
      call find_fits(case, meshes, found%experiments, found%fits, found%minima, error, &
         monitor, check)
      case%meshes = meshes
      if (.not. allocated(error)) call score_fits(case%model, meshes, found%scored, &
         found%expected, found%fits, error)
      if (allocated(error)) then
         if (error%status == status_failed) call add_causes(case, found%experiments, &
            found%notes, error%message)
      end if
      call locate(error, case%path)
      call check_interrupt(error)
      call return_memory_of(found)
   end subroutine fit_case

   !> Returns the memory of arrays that loading or fitting long records has left.
   subroutine return_memory_of(found)
      type(case_fit_t), intent(in) :: found
      integer :: k, samples

      if (.not. allocated(found%experiments)) return
      samples = 0
      do k = 1, size(found%experiments)
         ! A record that could not be read has no samples.
         if (allocated(found%experiments(k)%measured)) samples = samples &
            + size(found%experiments(k)%measured)
      end do
      call return_memory(samples)
   end subroutine return_memory_of

   !> Fits experiments with the stages of a case, from one start or from several, on the given
   !> meshes or on one that is refined automatically.
   !>
   !> meshes       on return the last mesh tried, if the mesh is refined
   !> experiments  (records) of the case, with any samples
   !> fits         (stages, meshes); with several starts the fits of the lowest J
   !> minima       (meshes); of size 0: one start
   !> error        a fit that fails
   !> check        as in `fit_case`
   subroutine find_fits(case, meshes, experiments, fits, minima, error, monitor, check)
      type(case_t), intent(in) :: case
      type(mesh_t), intent(inout) :: meshes(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(minima_t), allocatable, intent(out) :: minima(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check

      if (case%multistart%n > 0) then
         call identify_meshes_from_many(case%model, meshes, case%stages, experiments, &
            case%multistart, fits, minima, error, monitor, check)
         return
      end if
      allocate (minima(0))
      if (case%refines .and. is_exact(case%model%solver)) then
         call identify_refining(case%model, meshes(1), case%stages, experiments, fits, error, &
            monitor, check)
      else
         call identify_meshes(case%model, meshes, case%stages, experiments, fits, error, &
            monitor, check)
      end if
   end subroutine find_fits

   !> Judges the last stage of a fit: adds the error of the mesh and of fixed parameters, the
   !> verdict, and the test whether parameters are constant. This test is made if the case asks for
   !> windows, or if the records are long enough and show no mode with another constant frequency or
   !> decay rate than the model, because linear steps cannot tell such an error from a drift. A fit
   !> that is rejected is repeated from the spectral lines of the records, if it has started
   !> elsewhere. If parameters rest on modes that are not seen, the case is fitted again without
   !> them. A parameter whose interval is wider than its value is not determined.
   !>
   !> case   on return with the stages that the fit has used
   !> found  as `fit_case` returns it; if the fit is rejected, `verdict%no_fit` says why on return
   !> error  a verdict that cannot be computed, or an interruption
   subroutine judge_case(case, found, error, monitor)
      type(case_t), intent(inout) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(stage_t) :: asked
      character(len=:), allocatable :: hint
      integer :: k, windows
      logical :: again, restarted

      restarted = .false.
      asked = case%stages(size(case%stages))
      call judge_fit()
      if (allocated(error)) return
      if (found%verdict%no_fit /= '') then
         call fit_from_lines()
         if (again) call judge_fit()
         restarted = again
         if (allocated(error)) return
      end if
      if (any(found%verdict%lost) .and. case%multistart%n == 0) then
         call fit_without_lost()
         if (again) call judge_fit()
         if (allocated(error)) return
      end if
      found%verdict%starts_again = restarted
      associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
         if (found%verdict%no_fit == '' .and. last%note /= '') then
            call describe_scale(case, found%experiments, hint)
            if (hint /= '') call add_note(found%notes, 'warning: '//hint)
         end if
         if (last%statistics%samples == 0) return
         if (case%windows > 0) then
            deallocate (found%windows)
            call fit_windows(case%model, case%meshes(size(case%meshes)), found%experiments, last, &
               case%windows, found%windows)
            call find_drifts(found%experiments, case%windows, last, found%drift, found%windows)
         else if (size(found%verdict%sightings) > 0 .and. (found%verdict%missed == '' .or. &
            found%verdict%departures /= '')) then
            windows = default_windows(found%experiments, last, found%verdict%sightings(1)%model)
            if (windows > 0) call find_drifts(found%experiments, windows, last, found%drift)
         end if
         where ([(last%is_widened(k), k=1, size(last%free))]) &
            last%statistics%determined(:size(last%free)) = .false.
      end associate
      call check_interrupt(error)

   contains

      !> Adds the effect of the mesh, the errors of fixed parameters and the verdict to the last
      !> stage.
      subroutine judge_fit()
         call add_mesh_shifts(case, found, error, monitor)
         if (allocated(error)) return
         associate (mesh => case%meshes(size(case%meshes)), &
            last => found%fits(size(found%fits, 1), size(found%fits, 2)))
            call add_fixed_parameters(case%model, mesh, found%experiments, asked, last)
            call new_verdict(found%experiments, mesh, last, found%verdict, error)
            if (.not. allocated(error)) then
               if (found%verdict%early /= '') call last%extend(found%verdict%early_change)
               if (found%verdict%no_fit /= '') &
                  call add_causes(case, found%experiments, found%notes, found%verdict%no_fit)
               if (found%verdict%caution == '') &
                  found%verdict%caution = implausible(case%model%structure, last)
               if (found%verdict%caution//found%verdict%no_fit /= '') &
                  last%statistics%determined = .false.
               call judge_ranges(case%model, mesh, found%experiments, last)
               call test_harmonics(found%experiments, found%verdict%s, last, found%harmonics)
               call judge_shape_of_dip(case%model, mesh, found%experiments, found%verdict, last)
               if (found%verdict%no_fit == '' .and. is_exact(case%model%solver)) &
                  call widen_weak_estimates(case%model, mesh, found%experiments, last, monitor)
            end if
         end associate
         call locate(error, case%path)
         call check_interrupt(error)
      end subroutine judge_fit

      !> Fits a case again without the parameters that rest on modes which are not seen.
      !>
      !> If all these parameters belong to single records, they are fixed at the values of the case.
      !> Otherwise the search for start values rejects the mode, and fixes what this mode alone
      !> determines. This needs automatic start values.
      subroutine fit_without_lost()
         type(stage_t), allocatable :: stages(:)
         integer, allocatable :: parameters(:), records(:), owners(:)
         integer :: j, k

         associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
            parameters = pack(last%free, found%verdict%lost)
            records = pack([last%quantities(:size(last%free))%record], found%verdict%lost)
         end associate
         stages = case%stages
         if (all(records > 0)) then
            do k = 1, size(stages)
               owners = case%stages(k)%owners()
               stages(k) = case%stages(k)%without([(any(parameters == case%stages(k)%free(j) .and. &
                  records == owners(j)), j=1, size(owners))])
            end do
            again = size(stages(size(stages))%free) > 0
         else
            stages(1)%rejected_mode = found%verdict%missing_mode
            again = stages(1)%automatic .and. .not. any(case%stages%rejected_mode > 0)
         end if
         if (again) call fit_again(stages)
         if (.not. again .or. .not. all(records > 0)) return
         associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
            last%note = 'parameters that belong to one record are held at the values of the '// &
               'case, because this record does not show the mode that determines them: '// &
               found%verdict%lost_names
         end associate
      end subroutine fit_without_lost

      !> Fits a case again from the spectral lines of its records, after a search from other values
      !> has led to a fit that is rejected. Fields and dips have no such start.
      subroutine fit_from_lines()
         type(stage_t), allocatable :: stages(:)

         associate (first => case%stages(1))
            again = case%multistart%n == 0 .and. is_exact(case%model%solver) .and. &
               .not. (first%automatic .or. any(is_coefficient(first%free) .or. &
               first%free == of_x_D))
         end associate
         if (.not. again) return
         stages = case%stages
         stages(1)%automatic = .true.
         if (allocated(stages(1)%start)) deallocate (stages(1)%start)
         call fit_again(stages)
      end subroutine fit_from_lines

      !> Replaces the fits of a case by those with other stages, if the search converges and accepts
      !> its own result.
      !>
      !> stages    (stages) of the new fits; not allocated on return
      subroutine fit_again(stages)
         type(stage_t), allocatable, intent(inout) :: stages(:)
         type(stage_t), allocatable :: asked(:)
         type(stage_fit_t), allocatable :: fits(:, :)
         type(minima_t), allocatable :: minima(:)
         type(mesh_t), allocatable :: meshes(:)
         type(error_t), allocatable :: error

         meshes = case%meshes
         call move_alloc(case%stages, asked)
         call move_alloc(stages, case%stages)
         call find_fits(case, meshes, found%experiments, fits, minima, error, monitor)
         if (.not. allocated(error)) call score_fits(case%model, meshes, found%scored, &
            found%expected, fits, error)
         again = .not. allocated(error)
         if (again) again = fits(1, size(fits, 2))%doubt == ''
         if (again) then
            case%meshes = meshes
            call move_alloc(fits, found%fits)
         else
            call move_alloc(asked, case%stages)
         end if
      end subroutine fit_again

   end subroutine judge_case

   !> Makes an error of a verdict that rejects the fit. An earlier error is kept.
   !>
   !> found  as `judge_case` returns it
   subroutine fail_if_rejected(case, found, error)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(in) :: found
      type(error_t), allocatable, intent(inout) :: error

      if (allocated(error)) return
      if (found%verdict%no_fit /= '') call failure(error, case%path//': no fit: '// &
         found%verdict%no_fit)
   end subroutine fail_if_rejected

   !> Adds the shift of the last stage's estimates on finer meshes, unless it is already known. May
   !> run beside other threads.
   !>
   !> found  as `fit_case` returns it
   !> error  an interruption only
   subroutine add_mesh_shifts(case, found, error, monitor)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: k

      do k = 1, size(case%meshes)
         associate (last => found%fits(size(found%fits, 1), k))
            if (.not. allocated(last%mesh_shift)) call add_mesh_shift(case%model, case%meshes(k), &
               found%experiments, last, monitor)
         end associate
      end do
      call check_interrupt(error)
   end subroutine add_mesh_shifts

   !> Tests which parameters the model may lack, on the last stage and the finest mesh. Where one
   !> matters, the intervals include the estimates with this parameter free. If the fit is rejected
   !> and a parameter explains most of J, the reason names this parameter. A dip is located by small
   !> differences, so that its place is not determined if something is missing.
   !>
   !> found  with a verdict; on return with `tests`
   !> error  only an interruption: if a test cannot be computed there is none
   subroutine add_score_tests(case, found, error)
      type(case_t), intent(in) :: case
      type(case_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(score_test_t), allocatable :: tests(:)
      real(wp), parameter :: most = 0.5_wp
      type(error_t), allocatable :: failed
      integer :: k

      call test_candidates(case%model, case%meshes(size(case%meshes)), found%experiments, &
         found%fits(size(found%fits, 1), size(found%fits, 2)), tests, failed)
      call check_interrupt(error)
      if (allocated(error) .or. allocated(failed)) return
      call move_alloc(tests, found%tests)
      associate (last => found%fits(size(found%fits, 1), size(found%fits, 2)))
         do k = 1, size(found%tests)
            if (found%tests(k)%matters) call last%extend(found%tests(k)%shift(:size(last%free)))
         end do
         k = maxloc(found%tests%decrease, dim=1, mask=found%tests%rejects)
         if (k == 0) return
         if (found%verdict%no_fit /= '' .and. found%tests(k)%decrease > most .and. &
            index(found%verdict%no_fit, found%tests(k)%remedy()) == 0) &
            found%verdict%no_fit = found%verdict%no_fit//'; with '//trim(found%tests(k)%name)// &
            ' = '//rounded(found%tests(k)%value, 3)//', the weighted sum of squares falls by '// &
            rounded(100*found%tests(k)%decrease, 3)//' %: '//found%tests(k)%remedy()
         ! Scale and delay cannot be free.
         k = maxloc(found%tests%decrease, dim=1, mask=found%tests%rejects .and. &
            found%tests%name /= 'scale' .and. found%tests%name /= 'delay')
         if (k > 0) call judge_shape_of_dip(case%model, case%meshes(size(case%meshes)), &
            found%experiments, found%verdict, last, missing=trim(found%tests(k)%name))
      end associate
   end subroutine add_score_tests

end module beamid_case_fits
