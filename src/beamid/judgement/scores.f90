!> What the tests of parameters and errors of records that the model leaves out
!> (`beamid_score_tests`) share with those of harmonics (`beamid_harmonics`): the result of one
!> test, the score of one candidate, and whether a fit can be tested.
module beamid_scores
   use beamid_experiments, only: experiment_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: name_length
   use beamid_stage_fits, only: stage_fit_t
   use beamid_whiteness, only: effective_samples
   implicit none
   private

   public :: score_test_t, test, find_largest_shift, is_testable

   !> Significance level of all tests together, with which they reject the model.
   real(wp), parameter, public :: chance = 0.01_wp
   !> Least shift that matters, in half widths.
   real(wp), parameter, public :: large_shift = 0.5_wp

   !> The test of one candidate.
   type :: score_test_t
      character(len=name_length) :: name = ''
      !> index in the table of parameters; 0: an error of a record, with its name, or 'harmonic'
      integer :: parameter = 0
      integer :: record = 0                !< of this error; 0: all records
      !> of a harmonic of the first mode: its order, and the fitted mode next to it
      integer :: order = 0, mode = 0
      logical :: fades = .false.           !< whether its n-th power decays faster than the mode
      !> Probability of a score at least this large if the candidate has the model's value.
      real(wp) :: p_value = 1
      !> Estimate of the candidate by one Gauss-Newton step or by the refit; a spring as stiffness;
      !> of a harmonic its frequency [1/time].
      real(wp) :: value = 0
      real(wp), allocatable :: shift(:)    !< (n) change of each estimate with the candidate free
      !> The largest shift in units of the estimate's half width, and the index of this estimate; 0:
      !> no estimate has an interval.
      real(wp) :: moves = 0
      integer :: by = 0
      real(wp) :: decrease = 0             !< relative decrease of the weighted sum of squares
      !> Whether the candidate shifts an estimate by more than half of its half width, or reduces
      !> the sum of squares by over a tenth, and the test rejects the model; or another test has
      !> rejected the model, and this one is significant at a lower level (`decide`).
      logical :: rejects = .false., matters = .false.
   contains
      procedure :: remedy
   end type score_test_t

contains

   !> Returns what the user may do if the test matters.
   function remedy(self) result(text)
      class(score_test_t), intent(in) :: self
      character(len=:), allocatable :: text

      select case (self%name)
      case ('scale')
         text = 'check the calibration, the size of the excitation and the positions'
      case ('delay')
         text = 'check the trigger and the clocks'
      case ('harmonic')
         text = 'record a smaller motion'
         if (self%fades) text = text//', or begin later (t_first)'
      case default
         text = 'add '''//trim(self%name)//''' to free'
      end select
   end function remedy

   !> Computes the score of a candidate, its p-value and one Gauss-Newton step.
   !>
   !> d       (rows) derivatives of the residuals with respect to the candidate
   !> value   value of the candidate in the model
   !> bounds  (2) least and largest value; a step beyond them is not significant
   !> sd      standard deviation of `value`
   subroutine test(fit, d, value, bounds, sd, one)
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: d(:), value, bounds(2), sd
      type(score_test_t), intent(inout) :: one
      real(wp), dimension(size(fit%quantities)) :: slopes, scales
      real(wp) :: left(size(d)), products(size(d)), change, deviation, length
      integer :: m, rank

      one%value = value
      allocate (one%shift(size(fit%quantities)), source=0.0_wp)
      if (size(fit%jacobian, 2) /= size(slopes)) return
      scales = fit%quantities%scale
      call least_squares_step(fit%jacobian, d, scales, spread(.true., 1, size(scales)), &
         epsilon(1.0_wp)*size(d), slopes, rank)
      left = d + matmul(fit%jacobian, slopes)
      length = sum(left**2)
      ! If the estimates reproduce d to round-off, the candidate cannot be tested.
      if (.not. length > 1e-12_wp*sum(d**2)) return
      products = left*fit%fit%residual
      change = -sum(products)/length
      if (value + change < bounds(1) .or. value + change > bounds(2)) return
      one%value = value + change
      one%shift = slopes*change
      ! The variance is computed from the residuals after the step. Before the step, residuals that
      ! the candidate explains would count as noise.
      products = left*(fit%fit%residual + left*change)
      m = size(fit%residual)
      ! The variance of the rows of priors and penalties, which follow those of the records, is
      ! known: a single row could not show it.
      deviation = sqrt(sum(products(:m)**2)*m/effective_samples(products(:m)) &
         + fit%statistics%variance*sum(left(m + 1:)**2))
      if (fit%statistics%noise_is_known) deviation = sqrt(length*max(1.0_wp, &
         sum((fit%fit%residual + left*change)**2)/size(left)))
      if (.not. deviation > 0) return
      one%p_value = erfc(abs(change)/(hypot(deviation/length, sd)*sqrt(2.0_wp)))
      one%decrease = change**2*length/fit%fit%J
      call find_largest_shift(fit, one)
   end subroutine test

   !> Tells whether a fit has free parameters, statistics, and residuals that are more than errors
   !> of computation, which are no noise. If the start search has fixed a parameter, the tests would
   !> only find this parameter.
   pure logical function is_testable(experiments, fit)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      real(wp), parameter :: round_off = 1e-9_wp   ! share of the records
      integer :: k

      is_testable = .false.
      if (fit%statistics%samples == 0 .or. size(fit%free) == 0 .or. fit%note /= '') return
      is_testable = norm2(fit%residual) > round_off*norm2([(norm2(experiments(k)%measured), &
         k=1, size(experiments))])
   end function is_testable

   !> Notes which estimate the candidate moves most, in units of the estimate's half width.
   subroutine find_largest_shift(fit, one)
      type(stage_fit_t), intent(in) :: fit
      type(score_test_t), intent(inout) :: one
      real(wp) :: half
      integer :: k

      one%moves = 0
      one%by = 0
      do k = 1, size(fit%free)
         half = fit%half_width(k)
         if (.not. half > 0) cycle
         if (abs(one%shift(k)) <= one%moves*half) cycle
         one%moves = abs(one%shift(k))/half
         one%by = k
      end do
   end subroutine find_largest_shift

end module beamid_scores
