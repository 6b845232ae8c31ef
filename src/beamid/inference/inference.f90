!> Inference beyond linear theory from one fit: the profile likelihood of each parameter, and draws
!> from the posterior. The methods themselves are in `fit/` and know no beam; `beamid_bootstraps`
!> resamples records.
module beamid_inference
   use beamid_densities, only: impossible
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: two_pi, wp
   use beamid_lapack, only: dpotrf
   use beamid_least_squares, only: monitor_t
   use beamid_matrices, only: add_diagonal
   use beamid_motion_rows, only: basis_t
   use beamid_posteriors, only: new_posterior, posterior_t
   use beamid_profile_likelihood, only: follow_profile, is_open, minimise_at, side_t
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_sampling, only: draws_t, plan_t, sample
   use beamid_simulation, only: model_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: posterior_draws_t, problem_of_fit, profile_fit, sample_fit

   !> Draws from the posterior, and the model's response for some of them.
   type :: posterior_draws_t
      type(draws_t) :: draws
      integer, allocatable :: order(:)             !< (records) autoregressive order; 0: white noise
      !> (samples, shown) responses of the model [length/time**2]
      real(wp), allocatable :: motion(:, :)
      integer, allocatable :: shown(:)             !< (shown) index of the draw of each response
   end type posterior_draws_t

   !> J stays finite however large a parameter is, so that a flat prior must end somewhere. For an
   !> unbounded parameter it ends at this multiple of the estimate or of the parameter's magnitude.
   real(wp), parameter :: widest = 100

contains

   !> Makes the residual problem of a fit, in the state in which the fit has left it.
   !>
   !> experiments  (records) that were fitted
   !> found        their fit
   !> problem      with the estimates, weights, noise level and penalties of the fit
   !> variables    (n) free parameters, with bounds and magnitudes
   !> error        no free parameter, no degree of freedom, or residuals of 0
   subroutine problem_of_fit(model, mesh, experiments, found, problem, variables, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(residual_t), intent(out) :: problem
      type(variable_t), allocatable, intent(out) :: variables(:)
      type(error_t), allocatable, intent(out) :: error
      type(quantity_t), allocatable :: quantities(:)

      if (size(found%free) == 0 .or. found%statistics%samples == 0) then
         call failure(error, 'found '//merge('no free parameter                 ', &
            'no degree of freedom for the noise', size(found%free) == 0)// &
            ', expected free parameters and more samples than unknowns')
         return
      end if
      if (.not. found%statistics%variance > 0) then
         call failure(error, 'found residuals of 0, expected a record with noise, because '// &
            'intervals without noise have no width')
         return
      end if
      call new_residuals(model, mesh, experiments, problem, error, found%free)
      if (allocated(error)) return
      call found%restore(problem)
      call variables_of(found%again(), problem%scenario, variables, quantities, error)
   end subroutine problem_of_fit

   !> Follows the profile likelihood of every free parameter on both sides of its estimate.
   !>
   !> The interval ends where J has risen as much as it does at the end of the interval of linear
   !> theory, which is corrected for residuals that are not white.
   !>
   !> sides  (2, n) below and above the estimate of each parameter that was searched for, which may
   !>        be the reciprocal of the one in the case
   !> error  as in `problem_of_fit`, or an interruption; a side that fails has the state `is_lost`
   subroutine profile_fit(model, mesh, experiments, found, sides, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(side_t), allocatable, intent(out) :: sides(:, :)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      real(wp) :: t, rise(size(found%free)), first_step(size(found%free))
      integer :: finished, k, n, task

      call problem_of_fit(model, mesh, experiments, found, problem, variables, error)
      if (allocated(error)) return
      n = size(found%free)
      associate (s => found%statistics)
         do k = 1, n
            t = s%quantile
            first_step(k) = 0.1_wp*max(abs(found%fit%estimate(k)), variables(k)%magnitude)
            if (s%std_error(k) > 0 .and. s%corrected_half_width(k) < sqrt(unlimited)) then
               t = s%corrected_half_width(k)/s%std_error(k)
               first_step(k) = s%corrected_half_width(k)
            end if
            rise(k) = s%variance*t**2
         end do
      end associate
      allocate (sides(2, n))
      finished = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do task = 1, 2*n
         if (interrupted()) cycle
         call follow((task + 1)/2, 2 - modulo(task, 2))
         !$omp critical (one_side_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, 2*n, 'sides of profiles')
         !$omp end critical (one_side_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)

   contains

      !> Follows the profile of parameter k below (side 1) or above (side 2) its estimate.
      subroutine follow(k, side)
         integer, intent(in) :: k, side
         type(residual_t) :: mine

         call problem%copy_to(mine)
         call follow_profile(mine, mine%rows(), variables, found%fit%estimate, &
            sum(found%fit%residual**2), k, 2*side - 3, rise(k), first_step(k), sides(side, k), &
            monitor)
      end subroutine follow

   end subroutine profile_fit

   !> Draws from the posterior of the parameters and computes the model's response for some of the
   !> draws.
   !>
   !> sides      (2, n) profile likelihood; if a side is open, a flat prior has no finite weight
   !> plan       number of draws, seed and method
   !> posterior  draws and responses
   !> error      as in `problem_of_fit`; an open profile; a posterior that reaches the artificial
   !>            end of an unbounded range; a density without a mode; chains that do not agree
   subroutine sample_fit(model, mesh, experiments, found, sides, plan, posterior, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(side_t), intent(in) :: sides(:, :)
      type(plan_t), intent(in) :: plan
      type(posterior_draws_t), intent(out) :: posterior
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      !> Number of draws with a response.
      integer, parameter :: shown = 200
      !> At most this share of the posterior may lie in the outer half of the range up to an
      !> artificial end.
      real(wp), parameter :: leaning = 1e-3_wp
      !> Share above which an approximation is enough to refuse, before anything is drawn.
      real(wp), parameter :: clear = 10*leaning
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(posterior_t) :: density
      type(basis_t), allocatable :: bases(:)
      real(wp) :: limit(size(found%free))
      integer :: k, n

      n = size(found%free)
      call refuse_open(found, [(any(sides(:, k)%state == is_open), k=1, n)], error)
      if (allocated(error)) return
      call problem_of_fit(model, mesh, experiments, found, problem, variables, error)
      if (allocated(error)) return
      call new_posterior(problem, variables, found%fit%residual, found%jacobian, plan%coloured, &
         density)
      posterior%order = density%order
      limit = widest*max(abs(found%fit%estimate), variables%magnitude)
      call refuse_open(found, shares_beyond(density, variables, found%fit%estimate, limit) &
         > clear, error)
      if (allocated(error)) return
      call density%problem%localize(found%fit%estimate, found%statistics%covariance(:n, :n), bases)
      call bound(variables, limit)
      call sample(density, variables, found%fit%estimate, plan, posterior%draws, error, monitor)
      call check_interrupt(error)
      if (allocated(error)) then
         if (.not. allocated(posterior%draws%reduction)) return
         k = maxloc(posterior%draws%reduction, dim=1)
         error%message = error%message//'; expected a narrower bound or &prior for '// &
            trim(found%quantities(k)%searched_name())//', whose chains differ most, or the '// &
            'command profile instead'
         return
      end if
      call refuse_open(found, [(count(abs(posterior%draws%q(k, :)) > limit(k)/2) > leaning &
         *size(posterior%draws%q, 2), k=1, size(variables))], error)
      if (allocated(error)) return
      associate (draws => size(posterior%draws%q, 2))
         posterior%shown = [(1 + (k - 1)*(draws/min(shown, draws)), k=1, min(shown, draws))]
      end associate
      call predict(problem, posterior)
      call check_interrupt(error)
   end subroutine sample_fit

   !> Bounds variables by artificial ends, those that have no nearer bound on both sides.
   !>
   !> limit  (n) modulus of the artificial ends; on return twice the larger bound of a variable
   !>        whose own bounds are nearer
   elemental subroutine bound(variables, limit)
      type(variable_t), intent(inout) :: variables
      real(wp), intent(inout) :: limit

      if (variables%upper <= limit .and. variables%lower >= -limit) &
         limit = 2*max(abs(variables%upper), abs(variables%lower))
      variables%upper = min(variables%upper, limit)
      variables%lower = max(variables%lower, -limit)
   end subroutine bound

   !> Refuses the first of those parameters that the record does not bound, if there is one.
   !>
   !> is_unbounded  (free)
   subroutine refuse_open(found, is_unbounded, error)
      type(stage_fit_t), intent(in) :: found
      logical, intent(in) :: is_unbounded(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      k = findloc(is_unbounded, .true., dim=1)
      if (k > 0) call failure(error, 'posterior: the record sets '// &
         trim(found%quantities(k)%searched_name())//' no limit, and a flat prior up to '// &
         'infinity is no distribution; expected a bound in its stage, or &prior')
   end subroutine refuse_open

   !> Returns, for each parameter (n), the larger of its shares beyond both artificial ends.
   !>
   !> Arguments as of `share_beyond`, but `limit` (n) is above 0.
   function shares_beyond(density, variables, estimate, limit) result(shares)
      type(posterior_t), intent(in) :: density
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: estimate(:), limit(:)
      real(wp) :: shares(size(estimate)), of_side(2, size(estimate)), negligible
      type(posterior_t), allocatable :: copy
      integer :: task

      allocate (copy, source=density)
      call copy%find_negligible(estimate, negligible)
      of_side = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do task = 1, size(of_side)
         if (interrupted()) cycle
         call find_share((task + 1)/2, 2 - modulo(task, 2))
      end do
      !$omp end parallel do
      shares = maxval(of_side, dim=1)

   contains

      !> Finds the share of parameter k at its lower (1) or its upper (2) end.
      subroutine find_share(k, side)
         integer, intent(in) :: k, side

         of_side(side, k) = share_beyond(density, variables, estimate, k, (2*side - 3)*limit(k), &
            negligible)
      end subroutine find_share

   end function shares_beyond

   !> Returns roughly the share of a posterior in the outer half of the range from 0 to the
   !> artificial end of an unbounded parameter: its density there, with all other parameters at
   !> their most probable values, times their volume by the curvature (Laplace's approximation),
   !> relative to the same at the estimate. 0 if a bound comes first, if it cannot be computed, or
   !> if on the way there the density has become negligible and still falls.
   !>
   !> estimate    (n) mode of the posterior
   !> k           index of the parameter
   !> limit       artificial end of its range, of either sign
   !> negligible  as of `find_negligible` for the estimate
   real(wp) function share_beyond(density, variables, estimate, k, limit, negligible) result(share)
      type(posterior_t), intent(in) :: density
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: estimate(:), limit, negligible
      integer, intent(in) :: k
      type(posterior_t), allocatable :: mine
      real(wp) :: q(size(estimate)), volume_here, volume_there
      type(error_t), allocatable :: error
      integer :: i

      share = 0
      if (variables(k)%upper < limit .or. variables(k)%lower > limit) return
      allocate (mine, source=density)
      q = estimate
      call minimise_at(mine%problem, mine%problem%rows(), variables, k, 0.75_wp*limit, &
         negligible, q, error)
      if (allocated(error) .or. abs(q(k) - 0.75_wp*limit) > 0) return
      volume_here = log_volume(estimate, [(i, i=1, size(q))])
      volume_there = log_volume(q, [(i, i=1, k - 1), (i, i=k + 1, size(q))])
      if (.not. min(volume_here, volume_there) > impossible) return
      share = exp(min(0.0_wp, volume_there + log(abs(limit)/2) - volume_here - log(two_pi)/2))

   contains

      !> Returns the logarithm of the integral of the density over the parameters `over` near q,
      !> `impossible` if it cannot be computed. No parameter contributes more than the range up to
      !> its artificial end.
      function log_volume(q, over) result(volume)
         real(wp), intent(in) :: q(:)
         integer, intent(in) :: over(:)
         real(wp) :: volume
         real(wp) :: gradient(size(q)), H(size(q), size(q)), part(size(over), size(over))
         integer :: info, j

         call mine%evaluate(q, volume, gradient, H)
         if (.not. volume > impossible) return
         part = H(over, over)
         call add_diagonal(part, [(1/(widest*max(abs(estimate(over(j))), &
            variables(over(j))%magnitude))**2, j=1, size(over))])
         call dpotrf('L', size(over), part, max(1, size(over)), info)
         if (info /= 0) then
            volume = impossible
            return
         end if
         do j = 1, size(over)
            volume = volume + log(two_pi)/2 - log(part(j, j))
         end do
      end function log_volume

   end function share_beyond

   !> Computes the model's prediction [unit of the data] for the draws in `shown`; draws whose
   !> response cannot be computed are left out.
   subroutine predict(problem, posterior)
      type(residual_t), intent(in) :: problem
      type(posterior_draws_t), intent(inout) :: posterior
      !> Number of draws that start from the same copy of the problem, for any number of threads.
      integer, parameter :: block = 25
      logical :: computed(size(posterior%shown))
      integer :: first, k

      allocate (posterior%motion(problem%samples(), size(posterior%shown)))
      computed = .false.
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do first = 1, size(computed), block
         if (interrupted()) cycle
         call predict_block(first, min(first + block - 1, size(computed)))
      end do
      !$omp end parallel do
      posterior%shown = pack(posterior%shown, computed)
      posterior%motion = posterior%motion(:, pack([(k, k=1, size(computed))], computed))

   contains

      !> Computes the prediction for the shown draws `first` to `last`.
      subroutine predict_block(first, last)
         integer, intent(in) :: first, last
         type(residual_t), allocatable :: mine
         type(error_t), allocatable :: error
         real(wp) :: r(problem%rows())
         integer :: i, k

         allocate (mine)
         call problem%copy_to(mine)
         do k = first, last
            call mine%residuals(posterior%draws%q(:, posterior%shown(k)), r, error)
            computed(k) = .not. allocated(error)
            if (computed(k)) posterior%motion(:, k) = [(mine%parts(i)%observed%measured, &
               i=1, size(mine%parts))] + mine%without_weights(r)
         end do
      end subroutine predict_block

   end subroutine predict

end module beamid_inference
