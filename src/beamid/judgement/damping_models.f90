!> Fits of the same data with different damping mechanisms of the beam: starts from measured damping
!> ratios, fits, and the damping ratios of all modes by each model.
module beamid_damping_models
   use beamid_candidates, only: candidate_t, compute_criteria, criteria_t, fit_candidate, held, &
      shared
   use beamid_damping_starts, only: check_data, find_starts, frequency_range, tables_of
   use beamid_errors, only: bad_input, error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_identification, only: stage_t
   use beamid_interrupts, only: check_interrupt, stop_flag
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: monitor_t
   use beamid_measured_modes, only: measure_modes, measured_mode_t
   use beamid_mechanisms, only: combination_t, combinations_for, is_of_damping, mechanism_t, &
      mechanisms
   use beamid_modal_tables, only: modal_table_t
   use beamid_parameters, only: as_named, offset, set_free_parameter => set_free
   use beamid_responses, only: is_exact
   use beamid_strings, only: append_string, string_t
   use beamid_structure, only: of_b, of_c_D
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: damping_models_t, fit_damping_models

   !> The fits of all combinations of mechanisms.
   type :: damping_models_t
      !> whether damping ratios alone are compared, whose models keep the frequencies of a fit to
      !> all data
      logical :: by_ratios = .false.
      type(combination_t), allocatable :: combinations(:)   !< (models)
      type(candidate_t), allocatable :: models(:)
      type(measured_mode_t), allocatable :: measured(:)     !< by the records alone
      type(mode_list_t), allocatable :: modes(:)            !< (models) modes of each fitted model
      !> (any number) names of the models whose fit has failed, and the reasons
      type(string_t), allocatable :: failed(:), reasons(:)
   end type damping_models_t

   !> The modes of a model.
   type :: mode_list_t
      type(fitted_mode_t), allocatable :: modes(:)
   end type mode_list_t

   !> The fit of one combination, or the error. Fits of this module are `class`, although nothing
   !> extends `candidate_t`: gfortran then frees them by a procedure, not by inline code.
   type :: trial_t
      class(candidate_t), allocatable :: model
      type(error_t), allocatable :: error
   end type trial_t

contains

   !> Fits all combinations of mechanisms that the data allow.
   !>
   !> reference  model, records and stages of a case; its own fit finds the natural frequencies
   !> by_ratios  as in `damping_models_t`
   !> found      the fits
   !> error      the solver has no modes, the case frees no parameter, the fit of the case fails, or
   !>            the fits of all combinations fail
   subroutine fit_damping_models(reference, by_ratios, found, error, monitor)
      type(candidate_t), intent(inout) :: reference
      logical, intent(in) :: by_ratios
      type(damping_models_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      !> Number of modes beyond the measured ones whose damping ratios are computed.
      integer, parameter :: further = 4
      type(trial_t), allocatable :: trials(:)
      type(experiment_t), allocatable :: tables(:)
      integer :: done, k

      found%by_ratios = by_ratios
      call check_data(reference%experiments, by_ratios, error)
      if (allocated(error)) return
      call fit_reference(reference, error, monitor)
      if (allocated(error)) return
      call measure_modes(reference%model, reference%mesh, reference%experiments, reference%fit, &
         found%measured, error)
      if (allocated(error)) return
      if (by_ratios .and. size(found%measured) == 0) then
         call failure(error, 'no damping ratio can be measured: no mode stands out of the noise')
         return
      end if
      tables = tables_of(reference%experiments, reference%mesh, reference%fit, found%measured)
      found%combinations = combinations_for(any([(.not. allocated(reference%experiments(k) &
         %observed), k=1, size(reference%experiments))]))
      allocate (trials(size(found%combinations)))
      done = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, size(trials)
         call fit_combination(reference, found%combinations(k), tables, by_ratios, &
            trials(k)%model, trials(k)%error)
         !$omp critical (one_combination_done)
         done = done + 1
         if (present(monitor)) call monitor%advanced(done, size(trials), 'damping models')
         !$omp end critical (one_combination_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)
      if (.not. allocated(error)) call collect(trials, found, error)
      if (.not. allocated(error) .and. .not. by_ratios) call measure_again(found, error)
      if (allocated(error)) return
      allocate (found%modes(size(found%models)))
      do k = 1, size(found%models)
         call fitted_modes(found%models(k)%mesh, found%models(k)%fit, &
            maxval([0, found%measured%mode]) + further, found%modes(k)%modes, error)
         if (allocated(error)) return
      end do
   end subroutine fit_damping_models

   !> Measures the modes once more from the fit of the best model, in which weak modes may stand out
   !> that the damping of the first fit has hidden.
   subroutine measure_again(found, error)
      type(damping_models_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      type(measured_mode_t), allocatable :: measured(:)
      type(criteria_t) :: criteria

      criteria = compute_criteria(found%models)
      associate (best => found%models(criteria%best()))
         call measure_modes(best%model, best%mesh, best%experiments, best%fit, measured, error)
      end associate
      if (allocated(error)) return
      if (size(measured) >= size(found%measured)) call move_alloc(measured, found%measured)
   end subroutine measure_again

   !> Fits the case itself. Without damping among its free parameters, c_D is free as well.
   subroutine fit_reference(reference, error, monitor)
      type(candidate_t), intent(inout) :: reference
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      integer :: k

      if (.not. is_exact(reference%model%solver)) then
         call bad_input(error, 'found method=''cvode'' in &integrator, expected '// &
            'method=''modal'', because damping ratios are compared')
         return
      end if
      associate (last => reference%stages(size(reference%stages)))
         if (.not. any([(any(is_of_damping(reference%stages(k)%free)), &
            k=1, size(reference%stages))])) then
            call last%set_bounds()
            last%record = [last%owners(), 0]
            if (allocated(last%start)) last%start = [last%start, reference%model%structure%c_D]
            last%free = [last%free, of_c_D]
            last%lower = [last%lower, 0.0_wp]
            last%upper = [last%upper, unbounded]
         end if
      end associate
      call fit_candidate(reference, error, monitor)
      if (allocated(error)) return
      reference%refines = .false.
   end subroutine fit_reference

   !> Moves the fits that have succeeded into the result, and lists the others.
   subroutine collect(trials, found, error)
      type(trial_t), intent(inout) :: trials(:)
      type(damping_models_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      logical :: succeeds(size(trials))
      integer :: k, n

      succeeds = [(.not. allocated(trials(k)%error), k=1, size(trials))]
      if (.not. any(succeeds)) then
         call failure(error, 'no damping mechanism can be fitted; '// &
            found%combinations(1)%name()// &
            ': '//trials(1)%error%message)
         return
      end if
      allocate (found%models(count(succeeds)), found%failed(0), found%reasons(0))
      n = 0
      do k = 1, size(trials)
         if (succeeds(k)) then
            n = n + 1
            found%models(n) = trials(k)%model
         else
            call append_string(found%failed, found%combinations(k)%name())
            call append_string(found%reasons, trials(k)%error%message)
         end if
      end do
      found%combinations = pack(found%combinations, succeeds)
   end subroutine collect

   !> Fits one combination: to the tables from several start values, then to all data from the
   !> results, and for `by_ratios` to the damping ratios of the tables.
   subroutine fit_combination(reference, combination, tables, by_ratios, model, error)
      type(candidate_t), intent(in) :: reference
      type(combination_t), intent(in) :: combination
      type(experiment_t), intent(in) :: tables(:)
      logical, intent(in) :: by_ratios
      class(candidate_t), allocatable, intent(out) :: model
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: starts(:, :)
      class(candidate_t), allocatable :: whole
      type(candidate_t) :: ready
      integer :: k, range

      call set_up(reference, combination, tables, ready)
      call find_starts(ready%model, ready%mesh, ready%stages(1), combination, tables, starts, error)
      if (allocated(error)) return
      range = maxval(mechanisms(combination%parts)%range)
      do k = 1, size(starts, 2)
         call try_or_keep(ready, range, starts(:, k), whole, error)
      end do
      if (.not. allocated(whole)) return
      if (allocated(error)) deallocate (error)
      if (by_ratios) then
         call refit_ratios(whole, range, tables, model, error)
      else
         call move_alloc(whole, model)
      end if
   end subroutine fit_combination

   !> Fits a model from given start values. If that fails, it is fitted once more with its rate or
   !> range fixed: where only one combination of strength and range matters, a search may wander
   !> along a curved valley until its evaluations are used up. Arguments as of `try`.
   !>
   !> range  number of the rate or range; 0: there is none
   subroutine try_or_keep(model, range, start, best, error)
      type(candidate_t), intent(in) :: model
      integer, intent(in) :: range
      real(wp), intent(in) :: start(:)
      class(candidate_t), allocatable, intent(inout) :: best
      type(error_t), allocatable, intent(out) :: error

      call try(model, start, best, error)
      if (allocated(error) .and. range > 0) call keep(model, range, start, best, error)
   end subroutine try_or_keep

   !> Fits a model from given start values, and keeps the fit if it is better than the one so far.
   !>
   !> start  (free) start values
   !> best   the best fit so far; not allocated: there is none
   !> error  the fit has failed
   subroutine try(model, start, best, error)
      type(candidate_t), intent(in) :: model
      real(wp), intent(in) :: start(:)
      class(candidate_t), allocatable, intent(inout) :: best
      type(error_t), allocatable, intent(out) :: error
      class(candidate_t), allocatable :: trial

      call copy(model, trial)
      trial%stages(1)%start = start
      call fit_candidate(trial, error)
      if (allocated(error)) return
      if (allocated(best)) then
         if (trial%sum_of_squares() > best%sum_of_squares()) return
      end if
      call move_alloc(trial, best)
   end subroutine try

   !> Does the same as `try` with the rate or range fixed at its start value. It still counts as
   !> estimated.
   subroutine keep(model, range, start, best, error)
      type(candidate_t), intent(in) :: model
      integer, intent(in) :: range
      real(wp), intent(in) :: start(:)
      class(candidate_t), allocatable, intent(inout) :: best
      type(error_t), allocatable, intent(out) :: error
      class(candidate_t), allocatable :: trial
      logical :: is_range(size(start))

      call copy(model, trial)
      is_range = trial%stages(1)%free == range
      trial%stages(1) = trial%stages(1)%without(is_range)
      call set_free_parameter(trial%model%structure, trial%model%excitation, range, &
         start(findloc(is_range, .true., dim=1)))
      call try(trial, pack(start, .not. is_range), best, error)
      if (allocated(best)) best%owner(range, :) = shared
   end subroutine keep

   !> Copies a model, and its fit if there is one.
   subroutine copy(model, to)
      type(candidate_t), intent(in) :: model
      class(candidate_t), allocatable, intent(out) :: to

      allocate (to, source=model)
   end subroutine copy

   !> Sets up the model of a combination: one stage with the parameters of the combination and all
   !> parameters without damping that the reference has estimated. All other damping of the beam is
   !> 0.
   subroutine set_up(reference, combination, tables, model)
      type(candidate_t), intent(in) :: reference
      type(combination_t), intent(in) :: combination
      type(experiment_t), intent(in) :: tables(:)
      type(candidate_t), intent(out) :: model
      type(stage_t) :: stage, from
      type(mechanism_t) :: m
      real(wp) :: ends(2)
      integer :: j, k, owner, p

      model%model = reference%model
      model%mesh = reference%mesh
      model%experiments = reference%experiments
      do k = 1, size(reference%owner, 1)
         if (is_of_damping(k)) call set_free_parameter(model%model%structure, &
            model%model%excitation, k, 0.0_wp)
      end do
      allocate (stage%free(0), stage%record(0), stage%start(0), stage%lower(0), stage%upper(0))
      do j = size(reference%stages), 1, -1
         from = reference%stages(j)
         call from%set_bounds()
         from%record = from%owners()
         stage%offset = stage%offset .or. from%offset
         do k = 1, size(from%free)
            p = from%free(k)
            owner = from%record(k)
            if (p == offset .or. is_of_damping(p)) cycle
            if (any(stage%free == p .and. stage%record == owner)) cycle
            if (reference%owner(p, max(1, owner)) == held) cycle
            call add(p, owner, as_named(p, reference%fit%scenario%get(p, owner)), from%lower(k), &
               from%upper(k))
         end do
      end do
      do j = 1, size(combination%parts)
         m = mechanisms(combination%parts(j))
         call add(m%strength, 0, 0.0_wp, 0.0_wp, unbounded)
         if (m%range == 0) cycle
         ends = limits(m%range)
         call add(m%range, 0, sqrt(product(ends)), ends(1), ends(2))
      end do
      model%stages = [stage]

   contains

      !> Adds a parameter to the stage.
      subroutine add(parameter, owner, start, lower, upper)
         integer, intent(in) :: parameter, owner
         real(wp), intent(in) :: start, lower, upper

         stage%free = [stage%free, parameter]
         stage%record = [stage%record, owner]
         stage%start = [stage%start, start]
         stage%lower = [stage%lower, lower]
         stage%upper = [stage%upper, upper]
      end subroutine add

      !> Returns the bounds of a rate or range: beyond them, the mechanism differs from its limit by
      !> less than any record shows.
      pure function limits(parameter) result(ends)
         integer, intent(in) :: parameter
         real(wp) :: ends(2)

         if (any(parameter == of_b)) then
            ends = two_pi*frequency_range(tables)*[1e-3_wp, 1e4_wp]
         else
            ends = reference%fit%scenario%structures(1)%length*[1e-3_wp, 10.0_wp]
         end if
      end function limits

   end subroutine set_up

   !> Fits the damping of a model to the damping ratios of the tables alone. All other parameters
   !> keep the values of the fit to all data.
   !>
   !> whole  in: the fit to all data; out: undefined
   !> range  as of `try_or_keep`
   !> model  the fit; not allocated if it fails
   subroutine refit_ratios(whole, range, tables, model, error)
      type(candidate_t), intent(inout) :: whole
      integer, intent(in) :: range
      type(experiment_t), intent(in) :: tables(:)
      class(candidate_t), allocatable, intent(inout) :: model
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: no_weight = 1e12_wp
      type(stage_t) :: stage
      real(wp), allocatable :: start(:)
      integer :: k, r

      stage = whole%stages(1)
      if (any(stage%owners() > 0 .and. .not. is_of_damping(stage%free))) then
         call bad_input(error, 'found parameters of single records, expected common ones, '// &
            'because damping ratios alone are compared')
         return
      end if
      do k = 1, size(whole%fit%free)
         call set_free_parameter(whole%model%structure, whole%model%excitation, whole%fit%free(k), &
            whole%fit%fit%estimate(k))
      end do
      stage = stage%without(.not. is_of_damping(stage%free))
      stage%offset = .false.
      whole%stages = [stage]
      whole%experiments = tables
      whole%ignored = 0
      do r = 1, size(tables)
         select type (table => whole%experiments(r)%observed)
         type is (modal_table_t)
            table%sd_frequency = no_weight*table%sd_frequency
            whole%experiments(r)%measured = table%values()
            whole%ignored = whole%ignored + size(table%mode)
         end select
      end do
      start = [(whole%fit%scenario%get(stage%free(k), 0), k=1, size(stage%free))]
      call try_or_keep(whole, range, start, model, error)
   end subroutine refit_ratios

end module beamid_damping_models
