!> Searches for E(x) and c_D(x): as smooth as the data ask for.
!>
!> The coefficients' logarithms u carry a penalty strength |D u|**2 on their differences, beside the
!> residuals. Its strength is that of the restricted marginal likelihood of the problem linearised
!> where a search has ended; the search goes on with it, until it stays. The first search is rigid.
module beamid_smooth_fits
   use beamid_errors, only: error_t, failure
   use beamid_field_penalties, only: fields, penalty_count
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit_t, monitor_t, options_t
   use beamid_line_matches, only: match_lines, starts_along
   use beamid_noise_levels, only: fit_with_noise
   use beamid_residuals, only: residual_t
   use beamid_smoothing, only: choose_strength, smoothing_t
   use beamid_statistics, only: misfit_of_records
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, of_x_D
   use beamid_variables, only: variable_t
   use beamid_whiteness, only: check_residuals, effective_samples, residual_check_t
   implicit none
   private

   public :: fit_smoothly, misfit_of, field_fit_t, new_field_fit, trial_t

   !> What a search says of one of E(x) and c_D(x).
   type :: field_fit_t
      integer, allocatable :: place(:)     !< (n) its coefficients among the parameters
      type(smoothing_t) :: smoothing       !< of their logarithms among the other parameters
   end type field_fit_t

   !> Where a search has ended.
   type :: trial_t
      real(wp), allocatable :: estimate(:)
      real(wp) :: misfit = 0               !< as of `misfit_of`
   end type trial_t

contains

   !> As `fit_with_noise`; on return the problem has the strengths.
   !>
   !> Where E varies a search from afar is lost: over a long record the phase of every mode is off
   !> by turns, each mode by another number of them. So it starts from the lines of the records.
   !> Where there are none the first search is for the first part of the record, and each goes on
   !> from the one before on twice as much.
   !>
   !> Where a dip is looked for there are several starts, and where none of them leaves what looks
   !> like noise others all along the beam.
   !>
   !> trials  where searches from other starts have ended, roughly
   !> error   also where a strength does not settle
   subroutine fit_smoothly(problem, variables, options, found, trials, error, monitor, label, names)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(options_t), intent(in) :: options
      type(fit_t), intent(out) :: found
      type(trial_t), allocatable, intent(out) :: trials(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      type(variable_t) :: from(size(variables))
      type(options_t) :: rough, persistent
      type(variable_t), allocatable :: starts(:, :)
      logical :: dips, suits
      integer :: k

      allocate (trials(0))
      if (.not. any(is_coefficient(problem%free) .or. problem%free == of_x_D)) then
         call fit_with_noise(problem, variables, options, found, error, monitor, label, names)
         return
      end if
      problem%strength = 0
      from = variables
      rough = options
      rough%check = .false.
      rough%tolerance = 1e-4_wp
      persistent = options
      persistent%persistent = .true.
      ! Differences take evaluations of their own.
      rough%max_evaluations = 50*merge(1, size(variables) + 1, problem%exact)
      persistent%max_evaluations = 300*merge(1, size(variables) + 1, problem%exact)
      call match_lines(problem, variables, starts)
      dips = any(problem%free == of_x_D)
      suits = size(starts, 2) == 1 .and. .not. dips
      if (suits) from = starts(:, 1)
      if (.not. suits .and. size(starts, 2) > 0) call try_starts(problem, starts, rough, trials, &
         from, suits, monitor, label, names)
      if (dips .and. .not. suits) then
         ! Lines may mislead, where a record has few samples in a period or is short.
         starts = starts_along(problem, variables)
         call try_starts(problem, starts, rough, trials, from, suits, monitor, label, names, &
            grows=.true.)
      else if (size(starts, 2) == 0) then
         call grow(problem, from, rough, monitor, label, names)
      end if
      call settle(problem, from, persistent, found, error, monitor, label, names, settled=0.02_wp)
      if (allocated(error)) then
         if (.not. any(is_coefficient(problem%free)) .or. index(error%message, &
            'no convergence') + index(error%message, 'does not settle') == 0) return
         error%message = error%message//'; perhaps '//to_text(maxval([(size( &
            problem%field_columns(k)), k=1, fields)]))//' coefficients are too few for '// &
            'what varies along the beam, or a shorter record does better'
         return
      end if
      found%start = variables%start
   end subroutine fit_smoothly

   !> Searches from several starts.
   !>
   !> trials  where they end, added to those that are there
   !> best    the start of the least J of all, where a search succeeds
   !> suits   whether what that leaves looks like noise
   !> grows   whether each begins with a short piece of the record
   subroutine try_starts(problem, starts, options, trials, best, suits, monitor, label, names, &
      grows)
      type(residual_t), intent(in) :: problem
      type(variable_t), intent(in) :: starts(:, :)
      type(options_t), intent(in) :: options
      type(trial_t), allocatable, intent(inout) :: trials(:)
      type(variable_t), intent(inout) :: best(:)
      logical, intent(inout) :: suits
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      logical, intent(in), optional :: grows
      type(residual_t) :: part
      type(fit_t) :: found
      type(variable_t) :: from(size(best))
      type(residual_check_t) :: check
      type(trial_t) :: trial
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, size(starts, 2)
         from = starts(:, k)
         part = problem
         if (present(grows)) call grow(part, from, options, monitor, label, names)
         call settle(part, from, options, found, error, monitor, label, names, settled=0.5_wp)
         if (allocated(error)) cycle
         trial%estimate = found%estimate
         trial%misfit = misfit_of(part, found)
         trials = [trials, trial]
         if (trials(size(trials))%misfit > minval(trials%misfit)) cycle
         best = from%from(found%estimate)
         associate (m => problem%samples())
            check = check_residuals(found%residual(:m), found%jacobian(:m, :))
         end associate
         suits = check%white
      end do
   end subroutine try_starts

   !> J, or what takes its place for several records whose noise is not stated.
   pure real(wp) function misfit_of(problem, found) result(misfit)
      type(residual_t), intent(in) :: problem
      type(fit_t), intent(in) :: found
      integer :: i

      misfit = found%J
      if (size(problem%parts) == 1 .or. .not. any(problem%is_estimated())) return
      misfit = misfit_of_records(problem%without_weights(found%residual), &
         [(size(problem%parts(i)%experiment%samples), i=1, size(problem%parts))])
   end function misfit_of

   !> Moves a start to where it suits longer and longer pieces of the record.
   subroutine grow(problem, from, options, monitor, label, names)
      type(residual_t), intent(inout) :: problem
      type(variable_t), intent(inout) :: from(:)
      type(options_t), intent(in) :: options
      class(monitor_t), intent(inout), optional :: monitor
      character(len=*), intent(in) :: label, names(:)
      type(residual_t) :: part
      type(fit_t) :: found
      type(error_t), allocatable :: error
      integer :: k

      do k = doublings(problem), 1, -1
         part = problem%beginning(0.5_wp**k)
         call settle(part, from, options, found, error, monitor, label, names, settled=0.5_wp)
         if (allocated(error)) cycle
         from = from%from(found%estimate)
         problem%strength = part%strength
      end do
   end subroutine grow

   !> How often a record may be halved: a part has ten samples for each parameter, of a penalised
   !> function those that no penalty holds.
   pure integer function doublings(problem)
      type(residual_t), intent(in) :: problem
      integer, parameter :: most = 10, for_each = 10
      integer :: a, unknowns

      unknowns = size(problem%free) + problem%linear_unknowns()
      do a = 1, fields
         unknowns = unknowns - penalty_count(size(problem%field_columns(a)))
      end do
      doublings = max(0, min(most, int(log(problem%samples()/(for_each*real(unknowns, wp))) &
         /log(2.0_wp))))
   end function doublings

   !> A search with strengths that suit it.
   !>
   !> settled  a change of log strength by less is none
   subroutine settle(problem, variables, options, found, error, monitor, label, names, settled)
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
      type(variable_t) :: from(size(variables))
      type(field_fit_t) :: field
      type(options_t) :: quiet
      type(fit_t) :: before
      real(wp), dimension(fields) :: step, limit, last
      integer :: a, k

      do a = 1, fields
         if (size(problem%field_columns(a)) > 0 .and. .not. problem%strength(a) > 0) &
            call set_rigid(problem, variables, a, error)
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
            ! Step by step: what one function has not explained yet is nothing of the other. And
            ! where each fit has another of two maxima of the likelihood for its largest, or two
            ! functions take turns, shorter ones from turn to turn.
            if (k > patience .and. step(a)*last(a) < 0) limit(a) = limit(a)/2
            step(a) = max(step(a), -limit(a))
            if (k > patience) step(a) = min(step(a), limit(a))
         end do
         last = step
         if (all(abs(step) <= settled)) exit
         problem%strength = problem%strength*exp(step)
         before = found
         from = variables%from(found%estimate)
         call fit_with_noise(problem, from, quiet, found, error, monitor, label, names)
         if (allocated(error)) return
         call found%add_earlier(before)
      end do
      if (k > most) call failure(error, 'the strength of the smoothing does not settle')
   end subroutine settle

   !> No property differs between neighbouring coefficients by more than some 25 %, as a standard
   !> deviation: a model that is wrong would ask for any penalty to vanish. What it cannot explain
   !> goes on for long, and counts as noise of the few samples that it is worth.
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

   !> A strength beside which the data count for nothing, but for what is smooth.
   subroutine set_rigid(problem, variables, a, error)
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
      ! A start that varies already keeps its shape, up to a slope of `steep` in the logarithm over
      ! the length. What is wrong with it is no noise, and no measure of what the data can tell.
      problem%strength(a) = sum(r(:problem%samples())**2)/problem%samples() &
         *(size(columns)/steep)**2
   end subroutine set_rigid

   !> The smoothing of E(x) (1) or c_D(x) (2) at an estimate, all other rows taken for data.
   !>
   !> estimate            (n)
   !> residual, jacobian  (rows), (rows, n or more)
   !> as_used             .true.: all but `asked` belongs to the strength of the problem
   subroutine new_field_fit(problem, estimate, residual, jacobian, a, field, error, as_used)
      type(residual_t), intent(in) :: problem
      real(wp), intent(in) :: estimate(:), residual(:), jacobian(:, :)
      integer, intent(in) :: a
      type(field_fit_t), intent(out) :: field
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: as_used
      real(wp), allocatable :: J(:, :), r(:), at(:), penalty(:, :), used
      logical, allocatable :: data(:)
      integer :: first, k, n, rows

      field%place = problem%field_columns(a)
      n = size(estimate)
      call problem%penalty_rows(a, first, rows)
      allocate (data(size(residual)), source=.true.)
      data(first:first + rows - 1) = .false.
      J = jacobian(pack([(k, k=1, size(data))], data), :)
      r = pack(residual, data)
      allocate (penalty(rows, size(J, 2)), source=0.0_wp)
      at = [estimate, spread(0.0_wp, 1, size(J, 2) - n)]
      penalty(:, :n) = jacobian(first:first + rows - 1, :n)/sqrt(problem%strength(a))
      do k = 1, size(field%place)
         associate (p => field%place(k))
            at(p) = log(estimate(p))
            J(:, p) = J(:, p)*estimate(p)
            penalty(:, p) = penalty(:, p)*estimate(p)
         end associate
      end do
      if (present(as_used)) then
         if (as_used) used = problem%strength(a)
      end if
      call choose_strength(J, r, at, penalty, field%smoothing, error, &
         least_strength(problem, residual(:problem%samples())), used)
   end subroutine new_field_fit

end module beamid_smooth_fits
