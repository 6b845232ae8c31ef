!> Trial fits from given start values, and the objections to their results.
module beamid_trials
   use beamid_errors, only: error_t
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_model_roots, only: belief_t, damps, model_roots
   use beamid_residuals, only: residual_t
   use beamid_spectra, only: line_t, near_mains, noise_near, order_of_multiple, standing_out
   use beamid_strings, only: to_text
   use beamid_unknowns, only: quantity_t, stage_t, variables_of, scenario_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: trial_t, accepted_range, add_residual, try_start, object, is_multiple, resting, &
      inseparable, gain_of_mode

   !> A fit from one start.
   type :: trial_t
      type(scenario_t) :: start                  !< scenario with the start values
      type(fit_t) :: fit
      complex(wp), allocatable :: s(:, :)        !< (modes, records) roots at the estimate [1/time]
      complex(wp), allocatable :: ds(:, :, :)    !< (modes, records, free) their derivatives
      character(len=:), allocatable :: origin    !< where the start values come from, in words
      !> objection to the result; '': none
      character(len=:), allocatable :: objection
      logical :: is_absent = .false.             !< the objection is that a mode gains nothing
   end type trial_t

   !> Smallest gain with which a mode is accepted: that of a spectral line that stands out. The gain
   !> of a mode is the decrease of J that it causes, divided by the variance of the noise around its
   !> frequency. The median of the power of a line of noise is ln 2 times half of that variance.
   real(wp), parameter, public :: least_gain = 2*log(2.0_wp)*standing_out

contains

   !> Runs a fit from start values, and computes the roots of the model at its end.
   !>
   !> problem  the fit with its free parameters; its scenario is not changed
   !> values   (free) start values of the searched variables
   !> modes    number of roots to compute
   !> options  settings of the search
   !> most     largest number of evaluations of the search
   !> error    the fit does not converge, or the roots cannot be computed
   subroutine try_start(problem, stage, values, modes, options, most, trial, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: modes
      type(options_t), intent(in) :: options
      integer, intent(in) :: most
      type(trial_t), intent(out) :: trial
      type(error_t), allocatable, intent(out) :: error
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      complex(wp) :: s(modes), ds(modes, size(values))
      type(options_t) :: quick
      type(scenario_t) :: found
      integer :: r

      trial%start = problem%with(values)
      call variables_of(stage, trial%start, variables, quantities, error)
      if (allocated(error)) return
      quick = options
      quick%check = .false.
      quick%all_rows = .false.
      quick%max_evaluations = most
      call fit(problem, problem%rows(), variables, quick, trial%fit, error, &
         names=quantities%searched_name())
      if (allocated(error)) return
      found = problem%with(trial%fit%estimate)
      associate (records => size(problem%parts))
         allocate (trial%s(modes, records), trial%ds(modes, records, size(values)))
         do r = 1, records
            call model_roots(problem, found, r, s, ds, error)
            if (allocated(error)) return
            trial%s(:, r) = s
            trial%ds(:, r, :) = ds
         end do
      end associate
   end subroutine try_start

   !> Computes the residuals of a trial if its search has not.
   !>
   !> problem  the fit that the trial has run
   !> trial    on return with as many residuals as the fit has rows, or with none after an error
   !> error    the model cannot be computed
   subroutine add_residual(problem, trial, error)
      type(residual_t), intent(inout) :: problem
      type(trial_t), intent(inout) :: trial
      type(error_t), allocatable, intent(out) :: error

      if (size(trial%fit%residual) == problem%rows()) return
      deallocate (trial%fit%residual)
      allocate (trial%fit%residual(problem%rows()))
      call problem%residuals(trial%fit%estimate, trial%fit%residual, error)
      if (allocated(error)) trial%fit%residual = [real(wp) ::]
   end subroutine add_residual

   !> Returns the gain of mode k in record r, compared with a fit without this mode.
   !>
   !> trial    with its residuals
   !> without  (m) residuals of the fit without the mode
   function gain_of_mode(problem, trial, k, r, without) result(gain)
      type(residual_t), intent(in) :: problem
      type(trial_t), intent(in) :: trial
      integer, intent(in) :: k, r
      real(wp), intent(in) :: without(:)
      real(wp) :: gain
      integer :: i, first, last

      associate (m => [(size(problem%parts(i)%observed%measured), i=1, r)])
         last = sum(m)
         first = last - m(r) + 1
      end associate
      associate (rest => trial%fit%residual(first:last))
         gain = (sum(without(first:last)**2) - sum(rest**2))/noise_near( &
            problem%parts(r)%observed%times(), rest, aimag(trial%s(k, r))/two_pi, &
            -real(trial%s(k, r)))
      end associate
   end function gain_of_mode

   !> Sets the objection to a trial: a large J, too much damping, or parameters far from their
   !> expected values.
   !>
   !> names     (free) names of the parameters
   !> variance  sum of squares of the records about their means
   !> needed    number of modes without which a parameter would not be determined
   pure subroutine object(trial, beliefs, names, variance, needed)
      type(trial_t), intent(inout) :: trial
      type(belief_t), intent(in) :: beliefs(:)
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in) :: variance
      integer, intent(in) :: needed
      real(wp), parameter :: most_damping(2) = [0.1_wp, 0.3_wp]
      real(wp) :: ratio, deviation
      integer :: k

      trial%objection = ''
      if (trial%fit%J > variance/2) then
         trial%objection = 'the model explains less than half of the record''s variance'
         return
      end if
      do k = 1, min(needed, size(trial%s, 1))
         ratio = maxval(-real(trial%s(k, :))/abs(trial%s(k, :)))
         if (ratio <= most_damping(min(k, 2))) cycle
         trial%objection = 'mode '//to_text(k)//' has a damping ratio of '//to_text(ratio)
         return
      end do
      do k = 1, size(beliefs)
         if (damps(reshape(trial%ds(:, :, k), [size(trial%s)]))) cycle
         deviation = (beliefs(k)%x_of(trial%fit%estimate(k)) - beliefs(k)%x_of( &
            beliefs(k)%centre))/beliefs(k)%width
         if (abs(deviation) <= accepted_range(beliefs(k))) cycle
         trial%objection = trim(names(k))//' = '//to_text(trial%fit%estimate(k))// &
            ' is far from the value of the case or its prior, '//to_text(beliefs(k)%centre)// &
            ' (if that is a guess, set it near the estimate)'
         return
      end do
   end subroutine object

   !> Returns the largest distance of a parameter from its expected value at which a fit is accepted
   !> [standard deviations].
   elemental real(wp) function accepted_range(belief)
      type(belief_t), intent(in) :: belief

      ! Stated priors are part of the fit already, and there may be many of them.
      accepted_range = merge(4.0_wp, 2.5_wp, belief%stated)
   end function accepted_range

   !> Tells whether a mode sits on a multiple of the lowest mode or of the mains frequency.
   !>
   !> A strong spectral line near the frequency of the mode decides by itself: the mode is a
   !> multiple if the line is marked as a multiple. Without such a line, the frequency of the mode
   !> decides, to within its accuracy.
   !>
   !> s      (modes) roots [1/time]
   !> k      number of the mode
   !> gain   its gain
   !> lines  spectral lines of the record
   !> span   length of the record [time]
   pure logical function is_multiple(s, k, gain, lines, span)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: k
      real(wp), intent(in) :: gain, span
      type(line_t), intent(in) :: lines(:)
      real(wp), parameter :: weak = 0.02_wp
      real(wp) :: frequency, error
      integer :: n

      is_multiple = .false.
      if (k < 2) return
      frequency = aimag(s(k))/two_pi
      do n = 1, size(lines)
         if (abs(lines(n)%frequency - frequency) > max(1/span, 2e-3_wp*frequency)) cycle
         is_multiple = is_multiple .or. lines(n)%mains .or. lines(n)%harmonic > 0
         if (lines(n)%energy > weak*maxval(lines%energy)) return
      end do
      ! Three standard deviations of the angular frequency of a decaying oscillation in white noise.
      error = 3*hypot(2*real(s(k)), sqrt(12.0_wp)/span)/sqrt(max(gain, 1.0_wp))
      is_multiple = is_multiple .or. near_mains(frequency, span, error/two_pi) .or. &
         order_of_multiple(aimag(s(k)), aimag(s(1)), error/aimag(s(1))) > 0
   end function is_multiple

   !> Tells which parameters neither the modes nor the priors determine.
   !>
   !> The effects of the parameters on frequencies and damping are orthogonalised one after the
   !> other, the largest remaining effect first. A parameter whose remaining effect is below the
   !> accuracy of the modes is not determined.
   !>
   !> s             (modes, records) roots [1/time]
   !> ds            (modes, records, free) their derivatives
   !> visible       (modes, records) whether a mode is in the record
   !> beliefs       (free) expected values
   !> values        (free) values at which the roots were computed
   !> stated_are_known  whether parameters with a stated prior leave the modes to the others;
   !>                   default: all parameters compete for the modes
   !> undetermined  (free) whether the parameter is not determined
   pure function resting(s, ds, visible, beliefs, values, stated_are_known) result(undetermined)
      complex(wp), intent(in) :: s(:, :), ds(:, :, :)
      logical, intent(in) :: visible(:, :)
      type(belief_t), intent(in) :: beliefs(:)
      real(wp), intent(in) :: values(:)
      logical, intent(in), optional :: stated_are_known
      logical :: undetermined(size(values))
      real(wp) :: effect(2*size(s), size(values))
      integer :: k

      effect = effects(s, ds, visible, beliefs, values)
      if (present(stated_are_known)) then
         do k = 1, size(values)
            if (stated_are_known .and. beliefs(k)%stated) effect(:, k) = 0
         end do
      end if
      undetermined = is_below(effect, 1.0_wp) .and. .not. beliefs%stated
   end function resting

   !> Tells which parameters cannot be told from the others by any number of exact frequencies and
   !> damping ratios of these modes (free), such as rho beside E.
   !>
   !> Arguments as of `resting`.
   pure function inseparable(s, ds, beliefs, values)
      complex(wp), intent(in) :: s(:, :), ds(:, :, :)
      type(belief_t), intent(in) :: beliefs(:)
      real(wp), intent(in) :: values(:)
      logical :: inseparable(size(values))
      !> Share of an effect that the effects of other parameters must leave.
      real(wp), parameter :: least = 1e-3_wp
      real(wp) :: effect(2*size(s), size(values)), ignorance(size(values))
      integer :: k

      effect = effects(s, ds, spread(spread(.true., 1, size(s, 1)), 2, size(s, 2)), beliefs, values)
      do k = 1, size(values)
         if (beliefs(k)%stated) effect(:, k) = 0
         effect(:, k) = effect(:, k)/max(norm2(effect(:, k)), tiny(1.0_wp))
         ! Of parameters that cannot be separated, those that are known best stay fixed.
         ignorance(k) = beliefs(k)%width
         if (.not. beliefs(k)%logarithmic) ignorance(k) = ignorance(k)/max(abs(values(k)), &
            beliefs(k)%width)
      end do
      inseparable = is_below(effect, least, ignorance) .and. .not. beliefs%stated
   end function inseparable

   !> Returns the effects of one standard deviation of each parameter on the frequencies and damping
   !> ratios of the visible modes, in units of their accuracy (2 modes*records, free). Arguments as
   !> of `resting`.
   pure function effects(s, ds, visible, beliefs, values) result(effect)
      complex(wp), intent(in) :: s(:, :), ds(:, :, :)
      logical, intent(in) :: visible(:, :)
      type(belief_t), intent(in) :: beliefs(:)
      real(wp), intent(in) :: values(:)
      real(wp) :: effect(2*size(s), size(values))
      real(wp), parameter :: frequency_error = 4e-3_wp, damping_error = 0.3_wp, damping_factor = 3
      integer :: k

      do k = 1, size(values)
         effect(:size(s), k) = reshape(merge(aimag(ds(:, :, k))/aimag(s)/frequency_error, 0.0_wp, &
            visible), [size(s)])
         effect(size(s) + 1:, k) = reshape(merge(real(ds(:, :, k))/(damping_error*abs(real(s)) &
            + 1e-4_wp*abs(s)), 0.0_wp, visible), [size(s)])
         effect(:, k) = effect(:, k)*beliefs(k)%width*beliefs(k)%slope(max(values(k), &
            0.1_wp*beliefs(k)%centre))
         ! The expected damping is hardly known: it may be wrong by more than a factor e.
         if (damps(reshape(ds(:, :, k), [size(s)]))) effect(:, k) = damping_factor*effect(:, k)
      end do
   end function effects

   !> Tells for each column whether the other columns leave no more than a limit of it, if the
   !> columns are orthogonalised in the order of what is left of them.
   !>
   !> rank  (columns) another order, the largest first
   pure function is_below(columns, limit, rank)
      real(wp), intent(in) :: columns(:, :), limit
      real(wp), intent(in), optional :: rank(:)
      logical :: is_below(size(columns, 2))
      real(wp) :: left(size(columns, 1), size(columns, 2)), norm(size(columns, 2))
      integer :: j, k, n

      left = columns
      is_below = .true.
      do n = 1, size(norm)
         norm = norm2(left, dim=1)
         if (present(rank)) then
            k = maxloc(rank, dim=1, mask=is_below .and. norm > limit)
         else
            k = maxloc(norm, dim=1, mask=is_below .and. norm > limit)
         end if
         if (k == 0) exit
         is_below(k) = .false.
         left(:, k) = left(:, k)/norm(k)
         do j = 1, size(norm)
            if (is_below(j)) left(:, j) = left(:, j) &
               - left(:, k)*dot_product(left(:, k), left(:, j))
         end do
      end do
   end function is_below

end module beamid_trials
