!> One stage of a fit: start values, search, statistics and tests of the result.
!>
!> `beamid_identification` runs the stages of a case in turn.
module beamid_stages
   use beamid_errors, only: error_t
   use beamid_field_judgements, only: judge_dip, judge_functions
   use beamid_field_penalties, only: fields
   use beamid_fit_setups, only: set_free
   use beamid_held_errors, only: held_errors
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t, options_t
   use beamid_parameters, only: as_named, offset
   use beamid_peak_starts, only: start_from_peaks
   use beamid_residuals, only: residual_t
   use beamid_responses, only: work_t
   use beamid_smooth_fits, only: fit_smoothly, misfit_of, new_field_fit, trial_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_start_choices, only: rival_t
   use beamid_starts, only: automatic_start, findings_t
   use beamid_statistics, only: new_statistics
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient
   use beamid_unknowns, only: name_length, name_of, quantity_t, stage_t, variables_of
   use beamid_variables, only: unbounded, variable_t
   use beamid_verification, only: verify_integrator
   use beamid_whiteness, only: check_residuals
   implicit none
   private

   public :: run_stage

contains

   !> Runs one stage. The estimates stay in the scenario of the fit.
   !>
   !> problem  the fit; on return with the free parameters of the stage
   !> exact    the same fit with the exact response, which checks the results of an integrator
   !> stage    free parameters, start values and bounds
   !> options  settings of the search
   !> label    name of the stage for the monitor
   !> found    result
   !> error    no start values; no convergence; the error of the integrator is too large
   !> monitor  informed of every iteration
   subroutine run_stage(problem, exact, stage, options, label, found, error, monitor)
      type(residual_t), intent(inout) :: problem, exact
      type(stage_t), intent(in) :: stage
      type(options_t), intent(in) :: options
      character(len=*), intent(in) :: label
      type(stage_fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(variable_t), allocatable :: variables(:)
      character(len=name_length), allocatable :: names(:)
      type(findings_t) :: findings
      type(stage_t) :: tried
      type(trial_t), allocatable :: trials(:)

      findings = findings_t(note='', doubt='', rejections='')
      tried = stage
      call set_free(problem, stage)
      problem%work = work_t()
      ! A field along the beam always starts from the spectral lines of the record (smooth_fits).
      if (stage%automatic .and. size(stage%free) > 0 .and. .not. any(is_coefficient( &
         stage%free))) then
         if (problem%is_all_time()) then
            call automatic_start(problem, tried, options, findings, error)
         else
            call start_from_peaks(problem, tried, options, error)
         end if
      end if
      if (allocated(error)) return
      found%note = findings%note
      found%doubt = findings%doubt
      found%other = ''
      found%rejections = findings%rejections
      call variables_of(tried, problem%scenario, variables, found%quantities, error)
      if (allocated(error)) return
      names = found%quantities%searched_name()
      call fit_smoothly(problem, variables, options, found%fit, trials, error, monitor, label, &
         names)
      if (allocated(error)) return
      if (.not. problem%exact) call verify_integrator(problem, exact, variables, names, &
         found%fit, found%moved, found%reference, error)
      if (allocated(error)) return
      found%free = tried%free
      call store_estimates(problem, found)
      call add_linear(problem, found, error)
      if (.not. allocated(error)) call judge_estimates(problem, trials, found, error)
      if (.not. allocated(error) .and. allocated(findings%rivals)) &
         call judge_rivals(found, findings%rivals)
   end subroutine run_stage

   !> Extends the intervals to each of the other minima whose likelihood is not significantly lower,
   !> at a level of 1 %.
   subroutine judge_rivals(found, rivals)
      type(stage_fit_t), intent(inout) :: found
      type(rival_t), intent(in) :: rivals(:)
      real(wp), parameter :: level = 0.01_wp
      integer :: j, k

      if (found%statistics%samples == 0) return
      do j = 1, size(rivals)
         if (.not. any([(found%statistics%cannot_reject(rivals(j)%ratio, k, level), &
            k=1, size(found%free))])) cycle
         call found%extend(rivals(j)%shift)
         if (found%other /= '') found%other = found%other//'; '
         found%other = found%other//rivals(j)%text//', which fits equally well; the '// &
            'intervals include it'
      end do
   end subroutine judge_rivals

   !> Puts the estimates into the quantities and into the scenario, and copies the setup of the fit.
   subroutine store_estimates(problem, found)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(inout) :: found
      real(wp) :: moderate
      integer :: k

      do k = 1, size(found%free)
         associate (q => found%quantities(k))
            q%searched = found%fit%estimate(k)
            q%value = as_named(q%parameter, q%searched)
            call problem%scenario%set(q%parameter, q%record, q%searched)
            ! An estimate at a bound of 0 is no reference for relative changes.
            moderate = problem%scenario%magnitude_of(q%parameter, q%record)
            q%scale = merge(abs(q%searched), moderate, abs(q%searched) > 1e-9_wp*moderate)
         end associate
      end do
      found%weight = problem%weight
      found%weighted = problem%is_weighted()
      found%noise = problem%noise
      found%strength = problem%strength
      found%priors = problem%priors
      found%scenario = problem%scenario
   end subroutine store_estimates

   !> Computes statistics, tests of the residuals and of fields, and effects of fixed parameters.
   !>
   !> trials  where searches from other starts have ended
   subroutine judge_estimates(problem, trials, found, error)
      type(residual_t), intent(inout) :: problem
      type(trial_t), intent(in) :: trials(:)
      type(stage_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: scales(:)
      integer, allocatable :: rows(:)
      logical, allocatable :: ordered(:)   ! not allocated: all rows are
      integer :: a, group(problem%samples()), groups(0:size(problem%parts)), n
      logical :: enough

      do a = 1, fields
         if (.not. found%strength(a) > 0) cycle
         call new_field_fit(problem, found%fit%estimate, found%fit%residual, found%jacobian, a, &
            found%fields(a), error, as_used=.true.)
         if (allocated(error)) return
      end do
      found%work = problem%work
      associate (m => problem%samples())
         if (problem%is_all_time()) then
            found%check = check_residuals(found%fit%residual(:m), found%jacobian(:m, :))
         else
            rows = problem%sequence()
            found%check = check_residuals(found%fit%residual(rows), found%jacobian(rows, :))
            ordered = problem%are_ordered()
         end if
         call problem%group_rows(found%fit%residual(:m), group, groups)
      end associate
      ! Linear unknowns count as parameters. Their scale replaces their value, because nobody asks
      ! whether an offset of 0 is determined.
      n = size(found%free)
      associate (q => found%quantities)
         scales = q%scale
         ! Noise that is known need not be estimated from degrees of freedom.
         enough = problem%samples() > size(q)
         if (problem%knows_noise()) enough = problem%rows() >= size(q)
         if (enough) call new_statistics(found%jacobian, found%fit%residual, &
            [q(:n)%searched, q(n + 1:)%scale], scales, found%statistics, error, &
            problem%samples(), merge(problem%noise, 0.0_wp, problem%prior_rows() > 0), &
            group, groups(q%record) > 1, ordered, problem%knows_noise())
         if (allocated(error)) return
         call judge_dip(found, trials, misfit_of(problem, found%fit))
         call judge_functions(found)
         if (size(found%priors) == 0) return
         n = merge(size(q), n, problem%exact)
         call held_errors(problem, found%fit%estimate, found%jacobian(:, :n), scales(:n), &
            found%held, error)
      end associate
   end subroutine judge_estimates

   !> Adds the linear unknowns to the quantities, and computes the derivatives with respect to all
   !> quantities, and the residuals if the search has not.
   subroutine add_linear(problem, found, error)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(inout) :: found
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: c(:), r(:)
      integer :: first, i, k, n, modes(size(problem%parts))

      modes = problem%scenario%excitations%modes
      n = problem%linear_unknowns()
      if (n == 0) then
         found%jacobian = found%fit%jacobian
         found%residual = problem%without_weights(found%fit%residual)
         return
      end if
      deallocate (found%fit%jacobian)
      allocate (c(n), found%fit%jacobian(0, size(found%free)))
      allocate (found%jacobian(problem%rows(), size(found%free) + n))
      if (size(found%fit%residual) > 0) then
         allocate (r(problem%rows()))
         call problem%evaluate(found%fit%estimate, r, found%jacobian, error, c)
      else
         deallocate (found%fit%residual)
         allocate (found%fit%residual(problem%rows()))
         call problem%evaluate(found%fit%estimate, found%fit%residual, found%jacobian, error, c)
         found%fit%J = sum(found%fit%residual(:problem%samples())**2)
      end if
      if (allocated(error)) return
      found%residual = problem%without_weights(found%fit%residual)
      n = 0
      first = 1
      do while (first <= size(modes))
         i = first
         do k = 1, modes(i)
            call add('cos_'//to_text(k), 0)
            call add('sin_'//to_text(k), 0)
         end do
         do i = first, problem%last_channel(first)
            if (problem%offset_is_unknown(i)) call add('offset', offset)
         end do
         first = i
      end do

   contains

      !> Adds the next quantity, which belongs to record i.
      !>
      !> parameter  number in `parameters`; 0 for the amplitude of a mode
      subroutine add(name, parameter)
         character(len=*), intent(in) :: name
         integer, intent(in) :: parameter
         type(quantity_t) :: q

         n = n + 1
         q%record = merge(i, 0, size(modes) > 1)
         q%name = name_of(name, q%record)
         q%parameter = parameter
         q%lower = -unbounded
         q%upper = unbounded
         q%value = c(n)
         associate (observed => problem%parts(i)%observed)
            q%scale = max(norm2(observed%measured)/sqrt(real(size(observed%measured), wp)), &
               tiny(1.0_wp))
            if (parameter == offset) then
               q%start = observed%offset
               q%value = observed%offset + c(n)
               q%scale = q%scale/abs(observed%scale)
            end if
         end associate
         found%quantities = [found%quantities, q]
      end subroutine add

   end subroutine add_linear

end module beamid_stages
