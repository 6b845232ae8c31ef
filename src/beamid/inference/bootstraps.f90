!> The bootstrap of a fit: fits of resampled records, and intervals from the spread of their
!> estimates.
module beamid_bootstraps
   use beamid_condensation, only: condensed_t
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_inference, only: problem_of_fit
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kernels, only: products_with
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, monitor_t, options_t
   use beamid_motion_rows, only: basis_t
   use beamid_noise, only: gaussian_noise
   use beamid_priors, only: priors_of
   use beamid_resampling, only: acceleration, block_places, corrected_interval, &
      percentile_interval, usual_block
   use beamid_residuals, only: residual_t
   use beamid_simulation, only: model_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: bootstrap_plan_t, bootstrap_t, bootstrap_fit

   !> How records are resampled: by white noise of the stated or estimated standard deviation
   !> (parametric), by blocks of the residuals, or by blocks only if the residuals are not white.
   integer, parameter, public :: by_judgement = 0, parametric = 1, blocks = 2

   !> Settings of a bootstrap.
   type :: bootstrap_plan_t
      integer :: n = 1000              !< number of resampled records
      integer :: seed = 1              !< seed of the random numbers
      integer :: kind = by_judgement   !< `by_judgement`, `parametric` or `blocks`
      integer :: block = 0             !< length of a block in samples; 0: from the residuals
   end type bootstrap_plan_t

   !> Estimates from resampled records, and the 95 % intervals that they give.
   type :: bootstrap_t
      integer :: kind = parametric                 !< `parametric` or `blocks`
      integer :: block = 0                         !< length of a block in samples
      integer :: failures = 0                      !< number of fits that failed
      real(wp), allocatable :: estimates(:, :)     !< (free, n - failures)
      integer, allocatable :: number(:)            !< (n - failures) number of each record
      real(wp), allocatable :: percentile(:, :)    !< (2, free) ends of percentile intervals
      real(wp), allocatable :: corrected(:, :)     !< (2, free) corrected for bias, acceleration
      character(len=:), allocatable :: reason      !< why the first failed fit failed
   end type bootstrap_t

   !> The negative response of a fit to a long free decay: its products with the orthonormal basis
   !> of the rows near the estimate, and what is left of it. Not allocated: there is no basis.
   type :: fitted_record_t
      real(wp), allocatable :: basis(:, :)   !< (m, k)
      real(wp), allocatable :: along(:)      !< (k)
      real(wp), allocatable :: beside(:)     !< (m)
   contains
      procedure :: add
   end type fitted_record_t

contains

   !> Fits many resampled records: the model's own response plus either white noise of the stated or
   !> estimated standard deviation, or blocks drawn at random from the residuals. The centres of the
   !> priors of free parameters are drawn anew as well.
   !>
   !> experiments  (records) that were fitted
   !> found        their fit
   !> bootstrap    estimates and intervals
   !> error        a fit without noise or degrees of freedom, more than half of the fits failed, or
   !>              an interruption
   subroutine bootstrap_fit(model, mesh, experiments, found, plan, bootstrap, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(bootstrap_plan_t), intent(in) :: plan
      type(bootstrap_t), intent(out) :: bootstrap
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(residual_t) :: problem
      type(variable_t), allocatable :: variables(:)
      type(error_t), allocatable :: failed
      type(options_t) :: options
      type(fitted_record_t), allocatable :: fitted_records(:)
      real(wp) :: estimates(size(found%free), plan%n)
      logical :: done(plan%n)
      integer :: finished, first_failed, k, number

      call problem_of_fit(model, mesh, experiments, found, problem, variables, error)
      if (allocated(error)) return
      variables = variables%from(found%fit%estimate)
      options%relative_error = model%solver%relative_error()
      options%check = .false.
      options%all_rows = .false.
      call choose_kind(plan, found, experiments, bootstrap)
      call project_records(problem, found, fitted_records)
      finished = 0
      first_failed = plan%n + 1
      bootstrap%reason = ''
      !$omp parallel do schedule(dynamic, 8) private(failed) copyin(stop_flag)
      do number = 1, plan%n
         if (interrupted()) cycle
         call fit_one(number, failed)
         done(number) = .not. allocated(failed)
         !$omp critical (one_replicate_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, plan%n, 'resampled records')
         if (allocated(failed)) then
            if (number < first_failed) then
               first_failed = number
               bootstrap%reason = failed%message
            end if
         end if
         !$omp end critical (one_replicate_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)
      if (allocated(error)) return
      bootstrap%number = pack([(k, k=1, plan%n)], done)
      bootstrap%estimates = estimates(:, bootstrap%number)
      bootstrap%failures = count(.not. done)
      if (2*bootstrap%failures > plan%n) then
         call failure(error, to_text(bootstrap%failures)//' of '//to_text(plan%n)// &
            ' fits of resampled records fail: '//bootstrap%reason)
         return
      end if
      call find_intervals(found, bootstrap)

   contains

      !> Fits resampled record `number` and stores its estimates.
      subroutine fit_one(number, failed)
         integer, intent(in) :: number
         type(error_t), allocatable, intent(out) :: failed
         type(residual_t) :: mine
         type(fit_t) :: fitted

         call problem%copy_to(mine)
         call resample(mine, found, fitted_records, bootstrap, plan%seed + 7919*number)
         call fit(mine, mine%rows(), variables, options, fitted, failed)
         if (.not. allocated(failed)) estimates(:, number) = fitted%estimate
      end subroutine fit_one

   end subroutine bootstrap_fit

   !> Chooses how to resample, and the length of the blocks.
   !>
   !> bootstrap  on return with `kind` and `block`
   subroutine choose_kind(plan, found, experiments, bootstrap)
      type(bootstrap_plan_t), intent(in) :: plan
      type(stage_fit_t), intent(in) :: found
      type(experiment_t), intent(in) :: experiments(:)
      type(bootstrap_t), intent(inout) :: bootstrap
      integer :: k

      bootstrap%kind = plan%kind
      if (plan%kind == by_judgement) bootstrap%kind = merge(parametric, blocks, found%check%white)
      if (bootstrap%kind /= blocks) return
      bootstrap%block = plan%block
      if (plan%block == 0) bootstrap%block = usual_block(found%residual)
      bootstrap%block = min(bootstrap%block, minval([(size(experiments(k)%measured), &
         k=1, size(experiments))]))
   end subroutine choose_kind

   !> Decomposes the rows of long free decays once, for all resampled records: their columns do not
   !> depend on the measured values.
   !>
   !> problem  of the fit; on return with the decomposed rows
   !> fitted   (records) response of the fit
   subroutine project_records(problem, found, fitted)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(in) :: found
      type(fitted_record_t), allocatable, intent(out) :: fitted(:)
      type(basis_t), allocatable :: bases(:)
      integer :: i, k, m, n, row

      n = size(found%free)
      call problem%localize(found%fit%estimate, found%statistics%covariance(:n, :n), bases)
      allocate (fitted(size(bases)))
      row = 0
      do i = 1, size(bases)
         m = size(problem%parts(i)%observed%measured)
         if (allocated(bases(i)%columns)) then
            k = problem%local(i)%columns()
            associate (self => fitted(i))
               self%basis = bases(i)%columns(:, :k)
               self%beside = -(problem%parts(i)%observed%measured &
                  + found%residual(row + 1:row + m))
               self%along = products_with(self%basis, self%beside)
               self%beside = self%beside - matmul(self%basis, self%along)
            end associate
         end if
         row = row + m
      end do
   end subroutine project_records

   !> Computes the condensed rows of the negative sum of the response and of noise.
   !>
   !> noise  (m)
   !> rows   with the factor of the basis; on return with the record
   pure subroutine add(self, noise, rows)
      class(fitted_record_t), intent(in) :: self
      real(wp), intent(in), contiguous :: noise(:)
      type(condensed_t), intent(inout) :: rows
      real(wp) :: along(size(self%along))

      along = products_with(self%basis, noise)
      rows%y = self%along - along
      rows%left = sqrt(max(0.0_wp, sum((self%beside - noise)**2) - sum(along**2)))
   end subroutine add

   !> Replaces every record by a resampled one, and every centre of a prior of a free parameter by a
   !> random value.
   !>
   !> problem  of the fit; on return with the resampled records
   !> fitted   (records) from `project_records`
   !> seed     of this resampled record; the noise of record i and the priors derive theirs from it
   subroutine resample(problem, found, fitted, bootstrap, seed)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(in) :: found
      type(fitted_record_t), intent(in) :: fitted(:)
      type(bootstrap_t), intent(in) :: bootstrap
      integer, intent(in) :: seed
      real(wp), allocatable :: noise(:)
      real(wp) :: z(size(found%free)), inflation
      integer :: which(size(found%free)), i, k, m, record, row

      ! The fitted parameters absorb part of the noise, so the residuals are smaller than the noise.
      inflation = sqrt(real(found%statistics%samples, wp)/found%statistics%freedom)
      row = 0
      do i = 1, size(problem%parts)
         associate (observed => problem%parts(i)%observed)
            m = size(observed%measured)
            associate (r => found%residual(row + 1:row + m))
               if (bootstrap%kind == blocks) then
                  noise = inflation*(r(block_places(m, bootstrap%block, seed + 101*i)) - sum(r)/m)
               else if (allocated(observed%sd)) then
                  noise = gaussian_noise(m, observed%sd, seed + 101*i)
               else
                  noise = gaussian_noise(m, inflation*norm2(r)/sqrt(real(m, wp)), seed + 101*i)
               end if
               observed%measured = observed%measured + r + noise
            end associate
            if (allocated(fitted(i)%basis)) call fitted(i)%add(noise, problem%local(i)%rows)
         end associate
         row = row + m
      end do
      which = priors_of(problem%priors, problem%free, problem%record)
      z = gaussian_noise(size(z), 1.0_wp, seed + 57)
      do k = 1, size(which)
         if (which(k) == 0) cycle
         associate (prior => problem%priors(which(k)), q => found%quantities(k))
            record = problem%record(k)
            prior%centre(max(1, record, prior%record)) = q%searched &
               + z(k)*prior%width(prior%centre_in(record))
         end associate
      end do
   end subroutine resample

   !> Computes the percentile intervals and the BCa intervals of the estimates. The acceleration
   !> comes from the influence of each sample on the estimate, by linear theory; it is 0 where
   !> linear theory has no standard errors.
   subroutine find_intervals(found, bootstrap)
      type(stage_fit_t), intent(in) :: found
      type(bootstrap_t), intent(inout) :: bootstrap
      real(wp) :: influence(size(found%residual))
      integer :: k, m, n

      n = size(found%free)
      m = size(influence)
      allocate (bootstrap%percentile(2, n), bootstrap%corrected(2, n))
      do k = 1, n
         influence = 0
         associate (s => found%statistics)
            if (all(s%std_error < sqrt(unlimited))) influence = -matmul(found%jacobian(:m, :), &
               s%covariance(:, k)/s%variance)*found%fit%residual(:m)
         end associate
         bootstrap%percentile(:, k) = percentile_interval(bootstrap%estimates(k, :))
         bootstrap%corrected(:, k) = corrected_interval(bootstrap%estimates(k, :), &
            found%fit%estimate(k), acceleration(influence))
      end do
   end subroutine find_intervals

end module beamid_bootstraps
