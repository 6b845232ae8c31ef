!> Fits one window of a long record after another by Gauss-Newton steps. A window is a free decay
!> with amplitudes of its own. One parameter may have a prior of its own in each window.
module beamid_window_searches
   use beamid_autoregression, only: predictor_of, take_prediction
   use beamid_deviations, only: deviation_columns, set_deviations
   use beamid_errors, only: error_t, status_interrupted
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_model_roots, only: model_roots
   use beamid_observation, only: new_sampling
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_segments, only: new_segments, segments_t, squares_of_segments, step_t
   use beamid_simulation, only: model_t
   use beamid_statistics, only: unlimited
   use beamid_time_records, only: time_record_t
   use beamid_unknowns, only: quantity_t, stage_t, variables_of
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: window_search_t, found_t, largest_change, new_window_search

   !> Number of segments of a window; even, so that a window has halves.
   integer, parameter, public :: window_segments = 10

   !> A fit of one window: the point of the last evaluation, and the step behind it.
   type :: found_t
      !> (n + 2 modes) free parameters; real and imaginary part of the deviation of each root from
      !> the model [1/time]
      real(wp), allocatable :: p(:)
      type(segments_t) :: segments         !< rows at this point
      type(step_t) :: step                 !< to the minimum; of parameters, then linear unknowns
      !> (segments) weighted squared residuals, not whitened, at the last evaluation
      real(wp), allocatable :: squares(:)
      real(wp) :: sum_of_squares = huge(1.0_wp)   !< of the squares
      !> (order) coefficients that whiten the residuals; not allocated: the next evaluation
      !> computes them
      real(wp), allocatable :: predictor(:)
      real(wp) :: variance = 0             !< of the whitened residuals
      real(wp) :: objective = 0            !< sum of squares of whitened and further rows
      logical :: has_settled = .false.     !< the step is small
   end type found_t

   !> A fit whose samples are replaced from window to window.
   type :: window_search_t
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)   !< (n) start and bounds
      integer :: which = 0                 !< place of the parameter with a prior of its own
      !> mean and variance of this prior; `unlimited`: none [unit of the searched variable]
      real(wp) :: centre = 0, variance = unlimited
      !> standard deviation of real and imaginary part of the relative error of each root of the
      !> model, > 0
      real(wp) :: frequency_error = 0
      real(wp), allocatable :: omega(:)    !< (modes) angular frequencies at the start [1/time]
   contains
      procedure :: set_window
      procedure :: descend
      procedure :: look_around
      procedure :: move
      procedure, private :: evaluate
      procedure, private :: compute_rows
      procedure, private :: hold
   end type window_search_t

   !> Evaluations after which a search ends. It has settled when no unknown changes by more than a
   !> tenth of its standard error; `small` is the square of that.
   integer, parameter :: most = 6
   real(wp), parameter :: small = 1e-2_wp
   !> Order of the autoregressive process that whitens the residuals of a window.
   integer, parameter :: order = 6

contains

   !> Makes the search.
   !>
   !> model, mesh  as in `new_residuals`
   !> experiment  a free decay; its samples are replaced
   !> stage       free parameters
   !> which       place of the parameter that may have a prior in each window
   !> quantities  (n) the free parameters
   !> error       the model cannot be computed; no start values
   subroutine new_window_search(model, mesh, experiment, stage, which, search, quantities, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiment
      type(stage_t), intent(in) :: stage
      integer, intent(in) :: which
      type(window_search_t), intent(out) :: search
      type(quantity_t), allocatable, intent(out) :: quantities(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: s(:), ds(:, :)

      call new_residuals(model, mesh, [experiment], search%problem, error, free=stage%free)
      if (allocated(error)) return
      search%which = which
      call set_free(search%problem, stage)
      call variables_of(stage, search%problem%scenario, search%variables, quantities, error)
      if (allocated(error)) return
      allocate (s(experiment%excitation%modes))
      allocate (ds(size(s), size(stage%free)))
      call model_roots(search%problem, search%problem%with(search%variables%start), 1, s, ds, error)
      if (.not. allocated(error)) search%omega = abs(aimag(s))
   end subroutine new_window_search

   !> Returns the largest relative change of a natural frequency from one search to the other.
   pure real(wp) function largest_change(one, other) result(change)
      type(window_search_t), intent(in) :: one, other

      change = maxval(abs(other%omega - one%omega)/other%omega)
   end function largest_change

   !> Replaces the samples.
   !>
   !> t, z  (m) times, ascending [time], and accelerations
   subroutine set_window(self, t, z)
      class(window_search_t), intent(inout) :: self
      real(wp), intent(in) :: t(:), z(:)

      select type (observed => self%problem%parts(1)%observed)
      type is (time_record_t)
         observed%sampling = new_sampling(observed%sampling%observation, t)
         observed%measured = z
      end select
   end subroutine set_window

   !> Searches for the minimum of the window.
   !>
   !> start  as `p` of `found_t`
   !> found  with `sum_of_squares` = huge if the model cannot be computed at the start
   !> error  interrupted by the user
   subroutine descend(self, start, found, error)
      class(window_search_t), intent(inout) :: self
      real(wp), intent(in) :: start(:)
      type(found_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      type(found_t) :: trial
      real(wp) :: share, best
      integer :: k

      found%p = start
      trial%p = start
      share = 1
      best = huge(best)
      do k = 1, most
         call self%evaluate(trial, error)
         if (allocated(error)) return
         if (trial%step%is_regular .and. trial%objective < best) then
            found = trial
            best = trial%objective
            share = 1
         else if (k == 1) then
            found%step = trial%step
            return
         else
            share = share/4
         end if
         if (found%has_settled) exit
         trial%p = self%move(found%p, share*found%step%change)
      end do
      ! Only a small step is taken without another evaluation.
      if (.not. found%has_settled) found%step%change = 0
   end subroutine descend

   !> Evaluates the rows at `trial%p`, and computes the step to the minimum.
   subroutine evaluate(self, trial, error)
      class(window_search_t), intent(inout) :: self
      type(found_t), intent(inout) :: trial
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: r(:), jac(:, :)
      type(error_t), allocatable :: refusal
      real(wp) :: slope
      integer :: k, m, n, p

      m = self%problem%samples()
      p = size(trial%p) + self%problem%linear_unknowns()
      trial%step%is_regular = .false.
      trial%sum_of_squares = huge(1.0_wp)
      call self%compute_rows(trial%p, r, jac, refusal)
      if (allocated(refusal)) then
         if (refusal%status == status_interrupted) call move_alloc(refusal, error)
         return
      end if
      trial%squares = squares_of_segments(r(:m), window_segments)
      trial%sum_of_squares = sum(trial%squares)
      if (.not. allocated(trial%predictor)) trial%predictor = predictor_of(r(:m), order)
      call take_prediction(trial%predictor, r(:m))
      do k = 1, p
         call take_prediction(trial%predictor, jac(:m, k))
      end do
      trial%segments = new_segments(jac, r, m, window_segments)
      trial%variance = max(sum(r(:m)**2)/(m - p), tiny(1.0_wp))
      if (self%variance < unlimited) then
         slope = sqrt(trial%variance/self%variance)
         call trial%segments%add_row(self%which, slope, slope*(trial%p(self%which) - self%centre))
      end if
      n = size(self%variables)
      do k = n + 1, size(trial%p)
         slope = sqrt(trial%variance)/(self%frequency_error*self%omega((k - n + 1)/2))
         call trial%segments%add_row(k, slope, slope*trial%p(k))
      end do
      trial%objective = sum(r(:m)**2) + trial%segments%further(p + 1, p + 1)
      call self%hold(trial)
      if (.not. trial%step%is_regular) return
      trial%has_settled = all([(trial%step%change(k)**2 <= small*trial%variance &
         *trial%step%inverse(k, k), k=1, size(trial%p))])
      associate (v => self%variables, change => trial%step%change(:n))
         if (any(trial%p(:n) + change < v%lower .or. trial%p(:n) + change > v%upper)) &
            trial%has_settled = .false.
      end associate
   end subroutine evaluate

   !> Computes residuals, and their derivatives with respect to the free parameters, the
   !> deviations of the roots, and the linear unknowns.
   !>
   !> p    (n + 2 modes) free parameters; real and imaginary part of each deviation
   !> r    (rows)
   !> jac  (rows, size(p) + linear unknowns)
   subroutine compute_rows(self, p, r, jac, error)
      class(window_search_t), intent(inout) :: self
      real(wp), intent(in) :: p(:)
      real(wp), allocatable, intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: without(:, :), c(:), t(:)
      integer :: first, k, m, n, rows, unknowns

      m = self%problem%samples()
      rows = self%problem%rows()
      unknowns = self%problem%linear_unknowns()
      n = size(self%variables)
      allocate (r(rows), c(unknowns), without(rows, n + unknowns), jac(rows, size(p) + unknowns))
      call set_deviations(self%problem, 1, cmplx(p(n + 1::2), p(n + 2::2), wp))
      call self%problem%evaluate(p(:n), r, without, error, c)
      if (allocated(error)) return
      jac(:, :n) = without(:, :n)
      jac(:, size(p) + 1:) = without(:, n + 1:)
      jac(m + 1:, n + 1:size(p)) = 0
      t = self%problem%parts(1)%observed%times()
      t = t - t(1)
      do k = 1, size(p) - n, 2
         first = size(p) + k
         jac(:m, n + k:n + k + 1) = deviation_columns(t, jac(:m, first:first + 1), c(k:k + 1))
      end do
   end subroutine compute_rows

   !> Computes the step. A parameter at a bound stays there if the step would cross the bound.
   subroutine hold(self, trial)
      class(window_search_t), intent(in) :: self
      type(found_t), intent(inout) :: trial
      logical, allocatable :: held(:), leaves(:)
      integer :: k, n

      n = size(self%variables)
      held = spread(.false., 1, size(trial%segments%further, 1) - 1)
      do k = 0, n
         trial%step = trial%segments%step(1, window_segments, held)
         if (.not. trial%step%is_regular) return
         associate (v => self%variables, p => trial%p(:n), &
            moved => trial%p(:n) + trial%step%change(:n))
            leaves = moved < v%lower .and. p <= v%lower .or. moved > v%upper .and. p >= v%upper
         end associate
         if (.not. any(leaves)) return
         held(:n) = held(:n) .or. leaves
      end do
   end subroutine hold

   !> Returns a point moved by a step, inside the bounds.
   !>
   !> p       as in `found_t`
   !> change  (size(p) or more) step; elements beyond p are ignored
   pure function move(self, p, change) result(moved)
      class(window_search_t), intent(in) :: self
      real(wp), intent(in) :: p(:), change(:)
      real(wp) :: moved(size(p))
      integer :: k

      moved = p + change(:size(p))
      do k = 1, size(self%variables)
         associate (v => self%variables(k))
            moved(k) = min(max(moved(k), v%lower), v%upper)
         end associate
      end do
   end function move

   !> Finds the point of the least sum of squares on a grid of the parameter with its own prior. The
   !> amplitudes adapt at each point.
   !>
   !> p      as of `found_t`; on return with the best value of the parameter
   !> range  ends of the grid
   !> points  number of its points
   !> is_found  .false.: the model could not be computed anywhere
   !> error  interrupted by the user
   subroutine look_around(self, range, points, p, is_found, error)
      class(window_search_t), intent(inout) :: self
      real(wp), intent(in) :: range(2)
      integer, intent(in) :: points
      real(wp), intent(inout) :: p(:)
      logical, intent(out) :: is_found
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: r(self%problem%rows()), best, least
      type(error_t), allocatable :: refusal
      integer :: k, n

      is_found = .false.
      n = size(self%variables)
      best = p(self%which)
      least = huge(least)
      do k = 1, points
         p(self%which) = range(1) + (k - 0.5_wp)/points*(range(2) - range(1))
         call set_deviations(self%problem, 1, cmplx(p(n + 1::2), p(n + 2::2), wp))
         call self%problem%residuals(p(:size(self%variables)), r, refusal)
         if (allocated(refusal)) then
            if (refusal%status == status_interrupted) then
               call move_alloc(refusal, error)
               return
            end if
            cycle
         end if
         if (sum(r**2) >= least) cycle
         is_found = .true.
         least = sum(r**2)
         best = p(self%which)
      end do
      p(self%which) = best
   end subroutine look_around

end module beamid_window_searches
