!> Fits from several starts, and what speaks against each of them.
module beamid_trials
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_model_roots, only: belief_t, damps, model_roots
   use beamid_residuals, only: residual_t
   use beamid_spectra, only: line_t, near_mains, noise_near, standing_out
   use beamid_strings, only: to_text
   use beamid_unknowns, only: quantity_t, stage_t, variables_of, scenario_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: trial_t, try_start, object, is_multiple, resting, gain_of_mode

   !> A fit from one start.
   type :: trial_t
      type(scenario_t) :: start
      type(fit_t) :: fit
      complex(wp), allocatable :: s(:, :)        !< (modes, records) roots of what was found
      complex(wp), allocatable :: ds(:, :, :)    !< (modes, records, free)
      !> what speaks against it; '': nothing
      character(len=:), allocatable :: objection
   end type trial_t

   !> A mode gains what J falls by with it over the variance of the noise around its frequency; as
   !> much as a line that stands out, of whose power the median is ln 2 times half of that variance.
   real(wp), parameter, public :: least_gain = 2*log(2.0_wp)*standing_out

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

contains

   !> Fits from start values.
   !>
   !> problem  with what is free in place; its scenario is left as it was
   !> values   (free)
   !> modes    whose roots are wanted
   !> error    the fit does not converge
   subroutine try_start(problem, stage, values, modes, options, trial, error)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: modes
      type(options_t), intent(in) :: options
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
      quick%max_evaluations = 100
      call fit(problem, problem%rows(), variables, quick, trial%fit, error)
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

   !> What mode k gains, beside a fit without it, in record r.
   !>
   !> without  (m) the residuals of that fit
   function gain_of_mode(problem, trial, k, r, without) result(gain)
      type(residual_t), intent(in) :: problem
      type(trial_t), intent(in) :: trial
      integer, intent(in) :: k, r
      real(wp), intent(in) :: without(:)
      real(wp) :: gain
      integer :: i, first, last

      associate (m => [(size(problem%parts(i)%experiment%samples), i=1, r)])
         last = sum(m)
         first = last - m(r) + 1
      end associate
      associate (rest => trial%fit%residual(first:last))
         gain = (sum(without(first:last)**2) - sum(rest**2))/noise_near( &
            problem%parts(r)%experiment%samples, rest, aimag(trial%s(k, r))/two_pi, &
            -real(trial%s(k, r)))
      end associate
   end function gain_of_mode

   !> Sets what speaks against a fit: a large J, much damping, or parameters far from what was
   !> believed.
   !>
   !> variance  sum of squares of the records about their means
   !> needed    modes without which a parameter would not be determined
   pure subroutine object(trial, beliefs, names, variance, needed)
      type(trial_t), intent(inout) :: trial
      type(belief_t), intent(in) :: beliefs(:)
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in) :: variance
      integer, intent(in) :: needed
      real(wp), parameter :: most_damping(2) = [0.1_wp, 0.3_wp], far = 2.5_wp
      ! What is stated has pulled already, and there may be many of it.
      real(wp), parameter :: far_from_stated = 4
      real(wp) :: ratio, deviation
      integer :: k

      trial%objection = ''
      if (trial%fit%J > variance/2) then
         trial%objection = 'J is more than half of what the record varies'
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
         if (abs(deviation) <= merge(far_from_stated, far, beliefs(k)%stated)) cycle
         trial%objection = trim(names(k))//' = '//to_text(trial%fit%estimate(k))// &
            ' is far from where it was to be, '//to_text(beliefs(k)%centre)
         return
      end do
   end subroutine object

   !> Whether a mode sits on a multiple of the lowest one, or on the mains, as nearly as its
   !> frequency can be told, where there is no line that is neither.
   !>
   !> s      (modes) roots [1/time]
   !> k      which mode
   !> gain   of it
   !> lines  of the record, span its length
   pure logical function is_multiple(s, k, gain, lines, span)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: k
      real(wp), intent(in) :: gain, span
      type(line_t), intent(in) :: lines(:)
      real(wp), parameter :: tolerance = 1.3e-3_wp, weak = 0.02_wp
      integer, parameter :: highest = 12
      real(wp) :: frequency, ratio, error
      integer :: n

      is_multiple = .false.
      if (k < 2) return
      frequency = aimag(s(k))/two_pi
      do n = 1, size(lines)
         if (abs(lines(n)%frequency - frequency) > max(1/span, 2e-3_wp*frequency)) cycle
         is_multiple = is_multiple .or. lines(n)%mains .or. lines(n)%harmonic > 0
         if (lines(n)%energy > weak*maxval(lines%energy)) return
      end do
      ! Three standard deviations of the frequency of a decaying oscillation in white noise.
      error = 3*hypot(2*real(s(k)), sqrt(12.0_wp)/span)/sqrt(max(gain, 1.0_wp))
      ratio = aimag(s(k))/aimag(s(1))
      is_multiple = is_multiple .or. near_mains(frequency, span, error/two_pi) .or. &
         nint(ratio) <= highest .and. &
         abs(ratio - nint(ratio)) < tolerance*ratio + error/aimag(s(1))
   end function is_multiple

   !> The parameters that neither modes nor what is stated determine: each in turn, that with the
   !> largest effect on frequencies and damping first, and what is left of an effect beside those of
   !> the others.
   !>
   !> s, ds    (modes, records), (modes, records, free) [1/time]
   !> visible  (modes, records) whether a mode is in the record
   pure function resting(s, ds, visible, beliefs, values) result(lost)
      complex(wp), intent(in) :: s(:, :), ds(:, :, :)
      logical, intent(in) :: visible(:, :)
      type(belief_t), intent(in) :: beliefs(:)
      real(wp), intent(in) :: values(:)
      logical :: lost(size(values))
      real(wp), parameter :: frequency_error = 4e-3_wp, damping_error = 0.3_wp, less = 3
      real(wp) :: a(2*size(s), size(values)), length(size(values))
      integer :: j, k, n

      do k = 1, size(values)
         a(:size(s), k) = reshape(merge(aimag(ds(:, :, k))/aimag(s)/frequency_error, 0.0_wp, &
            visible), [size(s)])
         a(size(s) + 1:, k) = reshape(merge(real(ds(:, :, k))/(damping_error*abs(real(s)) &
            + 1e-4_wp*abs(s)), 0.0_wp, visible), [size(s)])
         a(:, k) = a(:, k)*beliefs(k)%width*beliefs(k)%slope(max(values(k), &
            0.1_wp*beliefs(k)%centre))
         ! Damping is hardly known before.
         if (damps(reshape(ds(:, :, k), [size(s)]))) a(:, k) = less*a(:, k)
      end do
      lost = .true.
      do n = 1, size(values)
         length = norm2(a, dim=1)
         k = maxloc(length, dim=1, mask=lost)
         if (.not. length(k) > 1) exit
         lost(k) = .false.
         a(:, k) = a(:, k)/length(k)
         do j = 1, size(values)
            if (lost(j)) a(:, j) = a(:, j) - a(:, k)*dot_product(a(:, k), a(:, j))
         end do
      end do
      lost = lost .and. .not. beliefs%stated
   end function resting

end module beamid_trials
