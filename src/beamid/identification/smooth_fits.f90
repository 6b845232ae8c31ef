!> Fits of E(x), c_D(x) and dips: searches with a smoothness penalty whose strength the data
!> determine.
!>
!> The penalty is strength |D u|**2, where u are the logarithms of the coefficients of a field and D
!> takes differences. After each search the strength is set to the maximum of the restricted
!> marginal likelihood of the problem linearised at the estimate. The search is repeated until the
!> strength no longer changes. The first search uses a rigid penalty.
module beamid_smooth_fits
   use beamid_criteria, only: misfit_of_records
   use beamid_errors, only: error_t, failure
   use beamid_field_penalties, only: fields, penalty_count
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit_t, monitor_t, options_t
   use beamid_line_matches, only: match_lines, starts_along
   use beamid_noise_levels, only: estimates_noise, fit_with_noise
   use beamid_residuals, only: residual_t
   use beamid_smoothing, only: choose_strength, smoothing_t
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, of_x_D
   use beamid_variables, only: variable_t
   use beamid_whiteness, only: check_residuals, effective_samples, residual_check_t
   implicit none
   private

   public :: fit_smoothly, misfit_of, field_fit_t, new_field_fit, trial_t

   !> The smoothing of one field, E(x) or c_D(x).
   type :: field_fit_t
      integer, allocatable :: place(:)   !< (coefficients) their indices among the free parameters
      !> strength, freedom and linear theory of the logarithms, beside the other parameters
      type(smoothing_t) :: smoothing
   end type field_fit_t

   !> The end of a search from one of several starts.
   type :: trial_t
      real(wp), allocatable :: estimate(:)   !< (n)
      real(wp) :: misfit = 0                 !< value of `misfit_of`
   end type trial_t

contains

   !> Runs a search like `fit_with_noise`, with penalties if a field or the place of a dip is free.
   !>
   !> If E varies along the beam, a search from a distant start fails: over a long record, the phase
   !> of each mode is wrong by a different number of turns. The search therefore starts from the
   !> spectral lines of the records. If no lines match, the first search fits the beginning of the
   !> record, and each further search fits twice as much, from the previous estimate.
   !>
   !> For a dip there are several starts. If none of them leaves residuals that look like noise,
   !> more starts are tried all along the beam.
   !>
   !> problem    the fit; on return with the strengths of the penalties
   !> variables  (n) start, bounds and scale of each free parameter
   !> found      result
   !> trials     approximate ends of the searches from several starts
   !> error      no convergence; the noise or the strength of a penalty does not settle
   !> monitor    informed of every iteration
   !> label      name of the search for the monitor
   !> names      (n) names of the variables
   subroutine fit_smoothly(problem, variables, options, found, trials, error, monitor, label, names)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(options_t), intent(in) :: options
      type(fit_t), intent(out) :: found
      type(trial_t), allocatable, intent(out) :: trials(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      type(variable_t) :: start(size(variables))
      type(options_t) :: quick, persistent
      type(variable_t), allocatable :: starts(:, :)
      logical :: dips, looks_like_noise
      integer :: k

      allocate (trials(0))
      if (.not. any(is_coefficient(problem%free) .or. problem%free == of_x_D)) then
         ! If there are linear unknowns, their derivatives need all rows again (beamid_stages).
         quick = options
         quick%all_rows = estimates_noise(problem) .or. problem%linear_unknowns() == 0
         call fit_with_noise(problem, variables, quick, found, error, monitor, label, names)
         return
      end if
      problem%strength = 0
      start = variables
      quick = options
      quick%check = .false.
      quick%tolerance = 1e-4_wp
      quick%rough = .true.
      persistent = options
      persistent%persistent = .true.
      ! Without exact derivatives, each Jacobian takes n evaluations more.
      quick%max_evaluations = 50*merge(1, size(variables) + 1, problem%exact)
      persistent%max_evaluations = 300*merge(1, size(variables) + 1, problem%exact)
      call match_lines(problem, variables, starts)
      dips = any(problem%free == of_x_D)
      looks_like_noise = size(starts, 2) == 1 .and. .not. dips
      if (looks_like_noise) start = starts(:, 1)
      if (.not. looks_like_noise .and. size(starts, 2) > 0) call try_starts(problem, starts, &
         quick, trials, start, looks_like_noise, monitor, label, names)
      if (dips .and. .not. looks_like_noise) then
         ! Spectral lines may mislead if a record is short or has few samples in a period.
         starts = starts_along(problem, variables)
         call try_starts(problem, starts, quick, trials, start, looks_like_noise, monitor, label, &
            names, grows=.true.)
      else if (size(starts, 2) == 0) then
         call fit_growing_parts(problem, start, quick, monitor, label, names)
      end if
      call fit_with_strengths(problem, start, persistent, found, error, monitor, label, names, &
         settled=0.02_wp)
      if (allocated(error)) then
         if (.not. any(is_coefficient(problem%free)) .or. index(error%message, &
            'no convergence') + index(error%message, 'does not settle') == 0) return
         error%message = error%message//'; perhaps '//to_text(maxval([(size( &
            problem%field_columns(k)), k=1, fields)]))//' coefficients are too few for '// &
            'the variation along the beam: try more of them, or a shorter part of the record'
         return
      end if
      found%start = variables%start
   end subroutine fit_smoothly

   !> Runs searches from several starts.
   !>
   !> starts            (n, starts)
   !> trials            on return with the ends of the successful searches appended
   !> best              on return the end of the search with the smallest misfit of all trials
   !> looks_like_noise  whether the residuals of that search are white
   !> grows             present: each search begins with a short part of the record
   subroutine try_starts(problem, starts, options, trials, best, looks_like_noise, monitor, label, &
      names, grows)
      type(residual_t), intent(in) :: problem
      type(variable_t), intent(in) :: starts(:, :)
      type(options_t), intent(in) :: options
      type(trial_t), allocatable, intent(inout) :: trials(:)
      type(variable_t), intent(inout) :: best(:)
      logical, intent(inout) :: looks_like_noise
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      logical, intent(in), optional :: grows
      type(residual_t) :: part
      type(fit_t) :: found
      type(variable_t) :: start(size(best))
      type(residual_check_t) :: check
      type(trial_t) :: trial
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, size(starts, 2)
         start = starts(:, k)
         call problem%copy_to(part)
         if (present(grows)) call fit_growing_parts(part, start, options, monitor, label, names)
         call fit_with_strengths(part, start, options, found, error, monitor, label, names, &
            settled=0.5_wp)
         if (allocated(error)) cycle
         trial%estimate = found%estimate
         trial%misfit = misfit_of(part, found)
         trials = [trials, trial]
         if (trials(size(trials))%misfit > minval(trials%misfit)) cycle
         best = start%from(found%estimate)
         associate (m => problem%samples())
            check = check_residuals(found%residual(:m), found%jacobian(:m, :))
         end associate
         looks_like_noise = check%white
      end do
   end subroutine try_starts

   !> Returns J, or, for several records whose noise is not stated, the quantity that replaces J.
   pure real(wp) function misfit_of(problem, found) result(misfit)
      type(residual_t), intent(in) :: problem
      type(fit_t), intent(in) :: found
      integer :: i

      misfit = found%J
      if (size(problem%parts) == 1 .or. .not. any(problem%is_estimated())) return
      misfit = misfit_of_records(problem%without_weights(found%residual), &
         [(size(problem%parts(i)%observed%measured), i=1, size(problem%parts))])
   end function misfit_of

   !> Moves a start by fitting longer and longer parts of the record.
   !>
   !> start  (n) on return the last estimate
   subroutine fit_growing_parts(problem, start, options, monitor, label, names)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(inout) :: start(:)
      type(options_t), intent(in) :: options
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      type(residual_t) :: part
      type(fit_t) :: found
      type(error_t), allocatable :: error
      integer :: k

      do k = halvings(problem), 1, -1
         part = problem%beginning(0.5_wp**k)
         call fit_with_strengths(part, start, options, found, error, monitor, label, names, &
            settled=0.5_wp)
         if (allocated(error)) cycle
         start = start%from(found%estimate)
         problem%strength = part%strength
      end do
   end subroutine fit_growing_parts

   !> Returns how many times a record may be halved so that a part keeps ten samples for each
   !> unknown. The coefficients of a penalised field count only as far as the penalty does not
   !> determine them.
   pure integer function halvings(problem)
      type(residual_t), intent(in) :: problem
      integer, parameter :: most = 10, for_each = 10
      integer :: a, unknowns

      unknowns = size(problem%free) + problem%linear_unknowns()
      do a = 1, fields
         unknowns = unknowns - penalty_count(size(problem%field_columns(a)))
      end do
      halvings = max(0, min(most, int(log(problem%samples()/(for_each*real(unknowns, wp))) &
         /log(2.0_wp))))
   end function halvings

   !> Repeats a search until the strengths of the penalties agree with its result.
   !>
   !> settled  change of the logarithm of a strength below which the iteration has converged
   subroutine fit_with_strengths(problem, variables, options, found, error, monitor, label, names, &
      settled)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(options_t), intent(in) :: options
      type(fit_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      real(wp), intent(in) :: settled
      integer, parameter :: most = 60, patience = 10
      real(wp), parameter :: most_at_once = 10
      type(variable_t) :: restart(size(variables))
      type(field_fit_t) :: field
      type(options_t) :: quiet
      type(fit_t) :: previous
      real(wp), dimension(fields) :: step, limit, last
      integer :: a, k

      do a = 1, fields
         if (size(problem%field_columns(a)) > 0 .and. .not. problem%strength(a) > 0) &
            call set_rigid_strength(problem, variables, a, error)
         if (allocated(error)) return
      end do
      call fit_with_noise(problem, variables, options, found, error, monitor, label, names)
      if (.not. any(problem%strength > 0)) return
      quiet = options
      quiet%check = .false.
      limit = log(most_at_once)
      last = 0
      do k = 1, most
         if (allocated(error)) return
         step = 0
         do a = 1, fields
            if (.not. problem%strength(a) > 0) cycle
            call new_field_fit(problem, found%estimate, found%residual, found%jacobian, a, &
               field, error)
            if (allocated(error)) return
            step(a) = log(field%smoothing%strength/problem%strength(a))
            ! A strength falls by a factor of 10 at most, because a misfit that one field has not
            ! explained yet must not be explained by the other. The steps become shorter if
            ! strengths oscillate, as between two maxima of the likelihood or between two fields.
            if (k > patience .and. step(a)*last(a) < 0) limit(a) = limit(a)/2
            step(a) = max(step(a), -limit(a))
            if (k > patience) step(a) = min(step(a), limit(a))
         end do
         last = step
         if (all(abs(step) <= settled)) exit
         problem%strength = problem%strength*exp(step)
         previous = found
         restart = variables%from(found%estimate)
         call fit_with_noise(problem, restart, quiet, found, error, monitor, label, names)
         if (allocated(error)) return
         call found%add_earlier(previous)
      end do
      if (k > most) call failure(error, 'the strength of the smoothing does not settle: try '// &
         'another number of coefficients')
   end subroutine fit_with_strengths

   !> Returns the smallest strength of a penalty that is allowed.
   !>
   !> It corresponds to a standard deviation of about 25 % for the difference between neighbouring
   !> coefficients. A wrong model would otherwise remove every penalty. The errors of a wrong model
   !> are correlated over long times, so they count as the noise of as many samples as they are
   !> worth.
   !>
   !> residual  (samples)
   pure real(wp) function least_strength(problem, residual) result(strength)
      type(residual_t), intent(in) :: problem
      real(wp), intent(in) :: residual(:)
      real(wp), parameter :: unlike = 0.25_wp
      real(wp) :: effective
      integer :: first(size(problem%parts) + 1), i

      first = [problem%first_rows(), size(residual) + 1]
      effective = 0
      do i = 1, size(first) - 1
         effective = effective + effective_samples(residual(first(i):first(i + 1) - 1))
      end do
      strength = max(sum(residual**2)/effective/unlike**2, tiny(strength))
   end function least_strength

   !> Sets the strength of a first search: so large that the data determine only what the penalty
   !> leaves free.
   !>
   !> a  number of the field: 1 for E(x), 2 for c_D(x)
   subroutine set_rigid_strength(problem, variables, a, error)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      integer, intent(in) :: a
      type(error_t), allocatable, intent(out) :: error
      real(wp), parameter :: rigid = 1e4_wp, steep = 2
      real(wp), allocatable :: r(:), jacobian(:, :)
      integer, allocatable :: columns(:)
      integer :: k

      columns = problem%field_columns(a)
      allocate (r(problem%rows()), jacobian(problem%rows(), size(variables)))
      call problem%jacobian([variables%start], r, jacobian, error)
      if (allocated(error)) return
      problem%strength(a) = rigid*max(tiny(rigid), sum([(sum((jacobian(:, columns(k)) &
         *variables(columns(k))%start)**2), k=1, size(columns))]))
      if (all(abs(variables(columns)%start - variables(columns(1))%start) <= 0)) return
      ! A start that varies along the beam keeps its shape, up to a slope of `steep` in the
      ! logarithm over the length. Its misfit is not noise, and no measure of the information in the
      ! data.
      problem%strength(a) = sum(r(:problem%samples())**2)/problem%samples() &
         *(size(columns)/steep)**2
   end subroutine set_rigid_strength

   !> Computes the smoothing of one field at an estimate. The rows of the other penalty and of the
   !> priors count as data.
   !>
   !> estimate  (n)
   !> residual  (rows)
   !> jacobian  (rows, n or more) the columns after the first n belong to linear unknowns
   !> a         number of the field: 1 for E(x), 2 for c_D(x)
   !> as_used   .true.: all results except `asked` belong to the strength of the fit; default
   !>           .false.: to the strength that maximises the likelihood
   subroutine new_field_fit(problem, estimate, residual, jacobian, a, field, error, as_used)
      type(residual_t), intent(in) :: problem
      real(wp), intent(in) :: estimate(:), residual(:), jacobian(:, :)
      integer, intent(in) :: a
      type(field_fit_t), intent(out) :: field
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: as_used
      real(wp), allocatable :: slopes(:, :), data_residual(:), expansion_point(:), &
         penalty(:, :), strength
      logical, allocatable :: is_data(:)
      integer :: first, k, n, rows

      field%place = problem%field_columns(a)
      n = size(estimate)
      call problem%penalty_rows(a, first, rows)
      allocate (is_data(size(residual)), source=.true.)
      is_data(first:first + rows - 1) = .false.
      slopes = jacobian(pack([(k, k=1, size(is_data))], is_data), :)
      data_residual = pack(residual, is_data)
      allocate (penalty(rows, size(slopes, 2)), source=0.0_wp)
      expansion_point = [estimate, spread(0.0_wp, 1, size(slopes, 2) - n)]
      penalty(:, :n) = jacobian(first:first + rows - 1, :n)/sqrt(problem%strength(a))
      do k = 1, size(field%place)
         associate (p => field%place(k))
            expansion_point(p) = log(estimate(p))
            slopes(:, p) = slopes(:, p)*estimate(p)
            penalty(:, p) = penalty(:, p)*estimate(p)
         end associate
      end do
      if (present(as_used)) then
         if (as_used) strength = problem%strength(a)
      end if
      call choose_strength(slopes, data_residual, expansion_point, penalty, field%smoothing, &
         error, least_strength(problem, residual(:problem%samples())), strength)
   end subroutine new_field_fit

end module beamid_smooth_fits
