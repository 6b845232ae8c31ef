!> The result of one stage of a fit: estimates, their errors, and the notes about them.
!>
!> `beamid_stages` fills it; the judgement, the inferences and the reports read it.
module beamid_stage_fits
   use beamid_distributions, only: normal_quantile
   use beamid_errors, only: error_t
   use beamid_field_penalties, only: fields
   use beamid_fit_setups, only: fit_setup_t, set_free
   use beamid_gauss_newton, only: least_squares_step
   use beamid_held_errors, only: held_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit_t
   use beamid_parameters, only: offset
   use beamid_priors, only: prior_t
   use beamid_responses, only: work_t
   use beamid_smooth_fits, only: field_fit_t
   use beamid_statistics, only: new_statistics, statistics_t, unlimited
   use beamid_unknowns, only: quantity_t, scenario_t, stage_t
   use beamid_whiteness, only: residual_check_t
   implicit none
   private

   public :: stage_fit_t

   !> The result of one stage on one mesh: n estimated parameters, k linear unknowns, m samples.
   type :: stage_fit_t
      integer :: stage = 0                      !< number of the stage
      integer :: elements = 0                   !< number of elements of the mesh
      integer, allocatable :: free(:)           !< (n) numbers of the estimated parameters
      type(fit_t) :: fit                        !< the search for these n parameters
      real(wp), allocatable :: residual(:)      !< (m) model - record [length/time**2]
      !> (n + k) the parameters, then the linear unknowns; `statistics` refers to all of them
      type(quantity_t), allocatable :: quantities(:)
      !> (rows, n + k) derivatives of the weighted residuals with respect to the searched variables
      real(wp), allocatable :: jacobian(:, :)
      type(scenario_t) :: scenario              !< of every record, with the estimates in place
      type(prior_t), allocatable :: priors(:)   !< prior information that the fit has used
      real(wp), allocatable :: weight(:)        !< (records) weights of the residuals of `fit`
      logical :: weighted = .false.             !< whether the weights are 1/noise
      !> standard deviation of a weighted sample, by which the fit has weighed records and priors
      real(wp) :: noise = 1
      real(wp) :: strength(fields) = 0          !< of the penalties on E(x), c_D(x); 0: no penalty
      type(field_fit_t) :: fields(fields)       !< the smoothing of E(x) and c_D(x)
      type(held_t), allocatable :: held(:)      !< effects of errors of fixed parameters
      !> (n) shift of the searched variables by mesh refinement, and the error of this shift; not
      !> allocated: not requested, or not found
      real(wp), allocatable :: mesh_shift(:), mesh_error(:)
      real(wp) :: mesh_decrease = 0      !< relative decrease of J by mesh refinement
      !> (n) standard deviation by which each searched variable varies during the motion; not
      !> allocated: not tested
      real(wp), allocatable :: drift(:)
      !> (2, n) how far below and above each searched variable other explanations of the records
      !> lie; not allocated: none is known
      real(wp), allocatable :: reach(:, :)
      type(statistics_t) :: statistics   !< `samples` is 0 if no degree of freedom is left
      type(residual_check_t) :: check    !< whether the residuals are white
      !> largest shift of an estimate by the error of the integrator [standard errors]; -1: the
      !> solver is not an integrator
      real(wp) :: moved = -1
      character(len=:), allocatable :: reference   !< solution from which `moved` is measured
      real(wp) :: score = -1   !< sum of squared residuals over another window; -1: not requested
      type(work_t) :: work               !< what the solver did
      !> note: which parameters the start search has fixed because a mode is not in the record.
      !> doubt: why the fit is not to be trusted. other: another minimum of nearly the same J, or a
      !> dip that may not exist or may be elsewhere. Each is '' if there is nothing to report.
      character(len=:), allocatable :: note, doubt, other
      !> one line for each start whose fit was rejected, with the reason
      character(len=:), allocatable :: rejections
   contains
      procedure :: correlation
      procedure :: again
      procedure :: restore
      procedure :: copy_to
      procedure :: from_held
      procedure :: half_width
      procedure :: is_widened
      procedure :: total
      procedure :: extend
      procedure :: step_of_rows
      procedure :: shifts
      procedure :: shifted
      procedure :: is_too_coarse
   end type stage_fit_t

   !> A mesh shift is significant if it exceeds this share of the half width of the interval.
   real(wp), parameter :: significant_share = 0.25_wp

   !> Relative decrease of J from which a finer mesh, or a parameter that the model leaves out,
   !> matters.
   real(wp), parameter, public :: significant_decrease = 0.1_wp

contains

   !> Returns the correlation of the named quantities j and k. It changes sign for one of two if the
   !> search has used its reciprocal.
   pure real(wp) function correlation(self, j, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: j, k

      correlation = self%statistics%correlation(j, k)
      if (self%quantities(j)%is_reciprocal() .neqv. self%quantities(k)%is_reciprocal()) &
         correlation = -correlation
   end function correlation

   !> Copies the fit. gfortran expands each assignment of this type to about 8 kB of code; call
   !> this procedure instead.
   subroutine copy_to(self, copy)
      class(stage_fit_t), intent(in) :: self
      type(stage_fit_t), intent(inout) :: copy

      copy = self
   end subroutine copy_to

   !> Returns a stage that continues from the estimates.
   pure type(stage_t) function again(self)
      class(stage_fit_t), intent(in) :: self

      associate (q => self%quantities, n => size(self%free))
         again%free = self%free
         again%record = q(:n)%record
         again%lower = q(:n)%lower
         again%upper = q(:n)%upper
         again%offset = any(q(n + 1:)%parameter == offset)
      end associate
   end function again

   !> Gives a problem the set-up of this fit: free parameters, offset, scenario with the estimates,
   !> weights, noise and penalties. Priors and whitening are left unchanged.
   !>
   !> problem  prepared for the same records; mesh and solver may differ
   subroutine restore(self, problem)
      class(stage_fit_t), intent(in) :: self
      class(fit_setup_t), intent(inout) :: problem

      call set_free(problem, self%again())
      problem%scenario = self%scenario
      problem%weight = self%weight
      problem%noise = self%noise
      problem%strength = self%strength
   end subroutine restore

   !> Returns the standard deviation of quantity k that the errors of fixed parameters cause.
   pure real(wp) function from_held(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k
      integer :: j

      from_held = 0
      if (.not. allocated(self%held)) return
      do j = 1, size(self%held)
         if (k <= size(self%held(j)%effect)) from_held = hypot(from_held, self%held(j)%effect(k))
      end do
   end function from_held

   !> Returns the half width of the 95 % interval of quantity k from noise, fixed parameters and
   !> drift together; `unlimited` if linear theory does not hold for it, or if the fit has no degree
   !> of freedom. Student's factor of few records belongs to their scatter alone.
   pure real(wp) function half_width(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: other

      other = self%from_held(k)
      if (allocated(self%drift)) then
         if (k <= size(self%drift)) other = hypot(other, self%drift(k))
      end if
      associate (s => self%statistics)
         half_width = unlimited
         if (s%samples == 0 .or. s%is_withdrawn(k)) return
         half_width = hypot(s%corrected_half_width(k), normal_quantile(0.975_wp)*other)
      end associate
   end function half_width

   !> Returns how far the total interval of quantity k extends below and above its estimate.
   !>
   !> The total interval covers every source of error: it is the hull of the interval about the
   !> estimate, the interval about the value that a finer mesh would give, and those about the
   !> values of other explanations of the records.
   pure function total(self, k) result(distance)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: distance(2), half, shift, shift_error

      half = self%half_width(k)
      shift = 0
      shift_error = 0
      if (allocated(self%mesh_shift) .and. k <= size(self%free)) then
         shift = self%mesh_shift(k)
         shift_error = self%mesh_error(k)
      end if
      distance = [max(half, half + shift_error - shift), max(half, half + shift_error + shift)]
      if (.not. allocated(self%reach) .or. k > size(self%free)) return
      distance = max(distance, half + self%reach(:, k))
   end function total

   !> Tells whether the errors of fixed parameters or a drift make the interval of quantity k wider
   !> than its value, which noise alone does not. A fit without degrees of freedom has no intervals.
   pure logical function is_widened(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k

      is_widened = .false.
      if (self%statistics%samples == 0) return
      associate (value => abs(self%quantities(k)%searched))
         is_widened = self%statistics%corrected_half_width(k) < value .and. &
            self%half_width(k) >= value
      end associate
   end function is_widened

   !> Extends the total intervals to another explanation of the records. An estimate that lies
   !> outside its interval there is not determined.
   !>
   !> shift    (n) of the searched variables
   !> covered  (n) distance from the estimates that the intervals cover already; default: 0
   subroutine extend(self, shift, covered)
      class(stage_fit_t), intent(inout) :: self
      real(wp), intent(in) :: shift(:)
      real(wp), intent(in), optional :: covered(:)
      real(wp) :: beyond(size(shift))
      integer :: k

      beyond = shift
      if (present(covered)) beyond = sign(max(0.0_wp, abs(shift) - covered), shift)
      if (.not. allocated(self%reach)) allocate (self%reach(2, size(shift)), source=0.0_wp)
      self%reach(1, :) = max(self%reach(1, :), -beyond)
      self%reach(2, :) = max(self%reach(2, :), beyond)
      do k = 1, size(shift)
         if (abs(beyond(k)) > self%half_width(k)) self%statistics%determined(k) = .false.
      end do
   end subroutine extend

   !> Computes the changes of the parameters that some rows of the residuals prefer, by one
   !> Gauss-Newton step, and their standard errors.
   !>
   !> rows        numbers of the rows
   !> change, sd  (n) of the searched variables; 0 and `unlimited` for parameters without an effect
   !>             on these rows
   subroutine step_of_rows(self, rows, change, sd)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: rows(:)
      real(wp), intent(out) :: change(:), sd(:)
      real(wp), allocatable :: a(:, :), residual(:), step(:), scales(:)
      integer, allocatable :: columns(:)
      type(statistics_t) :: statistics
      type(error_t), allocatable :: error
      integer :: i, n, rank

      change = 0
      sd = unlimited
      columns = pack([(i, i=1, size(self%quantities))], &
         [(any(abs(self%jacobian(rows, i)) > 0), i=1, size(self%quantities))])
      if (size(rows) <= size(columns)) return
      a = self%jacobian(rows, columns)
      residual = self%fit%residual(rows)
      scales = self%quantities(columns)%scale
      allocate (step(size(columns)))
      call least_squares_step(a, residual, scales, spread(.true., 1, size(step)), &
         epsilon(1.0_wp)*size(rows), step, rank)
      call new_statistics(a, residual + matmul(a, step), scales, scales, statistics, error)
      if (allocated(error)) return
      n = count(columns <= size(change))
      change(columns(:n)) = step(:n)
      sd(columns(:n)) = statistics%corrected_error(:n)
   end subroutine step_of_rows

   !> Tells whether the mesh shift of quantity k is significant.
   pure logical function shifts(self, k)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: k

      shifts = abs(self%mesh_shift(k))/significant_share > self%half_width(k)
   end function shifts

   !> Tells whether the mesh shift of any estimate is significant, or the decrease of J by mesh
   !> refinement.
   pure logical function shifted(self)
      class(stage_fit_t), intent(in) :: self
      integer :: k

      shifted = .false.
      if (.not. allocated(self%mesh_shift) .or. self%statistics%samples == 0) return
      shifted = self%mesh_decrease > significant_decrease .or. &
         any([(self%shifts(k), k=1, size(self%mesh_shift))])
   end function shifted

   !> Tells whether E(x) (a = 1) or c_D(x) (a = 2) needs more coefficients: the penalty hardly
   !> restricts it, yet the residuals are not white.
   pure logical function is_too_coarse(self, a)
      class(stage_fit_t), intent(in) :: self
      integer, intent(in) :: a
      real(wp), parameter :: nearly_all = 0.9_wp

      is_too_coarse = allocated(self%fields(a)%place) .and. .not. self%check%white
      if (is_too_coarse) is_too_coarse = self%fields(a)%smoothing%bounded .or. &
         self%fields(a)%smoothing%at_end < 0 .or. self%fields(a)%smoothing%freedom &
         > nearly_all*size(self%fields(a)%place)
   end function is_too_coarse

end module beamid_stage_fits
