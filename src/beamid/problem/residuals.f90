!> Residuals model - record, over one record or several, as a function of the parameters that a
!> search moves. What enters linearly is eliminated at every evaluation.
module beamid_residuals
   use beamid_autoregression, only: autoregression_t
   use beamid_errors, only: error_t
   use beamid_experiments, only: prepared_experiment_t, experiment_t, is_first, linear_t, &
      prepare_experiment, seen_modes_t
   use beamid_galerkin, only: mesh_t
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_observation, only: new_sampling
   use beamid_priors, only: prior_t, priors_of
   use beamid_problems, only: smooth_problem_t
   use beamid_projection, only: new_projection, projection_t
   use beamid_responses, only: is_exact, work_t
   use beamid_simulation, only: model_t
   use beamid_smoothing, only: difference_rows
   use beamid_structure, only: coefficient_at, is_coefficient
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: residual_t, new_residuals

   !> E(x) and c_D(x), and the order of the differences that keep them smooth.
   integer, parameter, public :: fields = 2, penalty_order = 1

   !> Rows are the samples of each record in turn, times its weight, then one for each free
   !> parameter of which something is known: its distance from that value in standard deviations,
   !> times the noise of the other rows. Of E(x) and of c_D(x) follow the differences of the
   !> logarithms of neighbouring coefficients, times the root of a strength.
   type, extends(smooth_problem_t) :: residual_t
      type(prepared_experiment_t), allocatable :: parts(:)   !< one for each record
      real(wp), allocatable :: weight(:)           !< (records) 1/noise; of one record 1
      !> (records) what makes the noise of each white; not allocated: it is
      type(autoregression_t), allocatable :: colour(:)
      type(prior_t), allocatable :: priors(:)
      real(wp) :: noise = 1                        !< of a weighted sample
      !> of the penalties on E(x) and c_D(x); 0: none [1 in units of J]
      real(wp) :: strength(fields) = 0
      type(scenario_t) :: scenario
      integer, allocatable :: free(:)              !< (n) places in the `parameters`
      integer, allocatable :: record(:)            !< (n) the record of each; 0: all
      logical :: offset = .false.
      type(work_t) :: work                         !< of all evaluations
      !> log sqrt(det Phi'Phi) of the last evaluation, Phi the columns of the linear unknowns
      real(wp) :: log_volume = 0
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure :: samples
      procedure :: first_rows
      procedure :: rows
      procedure :: prior_rows
      procedure :: penalty_rows
      procedure :: field_columns
      procedure :: linear_unknowns
      procedure :: is_weighted
      procedure :: is_estimated
      procedure :: guess_noise
      procedure :: without_weights
      procedure :: evaluate
      procedure :: last_channel
      procedure, private :: motion
      procedure, private :: add_priors
      procedure :: with
      procedure :: beginning
   end type residual_t

contains

   !> The problem of some experiments on one mesh; what is free comes with a stage.
   !>
   !> model    its excitation is not used, each experiment has its own
   !> turning  whether the compliance of the clamp is free; default .false.
   !> error    an experiment that the model's solver cannot compute
   subroutine new_residuals(model, mesh, experiments, problem, error, turning)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(residual_t), intent(out) :: problem
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: turning
      integer :: i

      problem%exact = is_exact(model%solver)
      allocate (problem%parts(size(experiments)))
      allocate (problem%scenario%structures(size(experiments)))
      allocate (problem%scenario%excitations(size(experiments)))
      do i = 1, size(experiments)
         problem%scenario%structures(i) = experiments(i)%structure_of(model%structure)
         if (present(turning)) problem%scenario%structures(i)%root_is_free = turning
         problem%scenario%excitations(i) = experiments(i)%excitation
         call prepare_experiment(experiments(i), problem%scenario%structures(i), mesh, &
            model%observation, model%solver, problem%parts(i), error)
         if (allocated(error)) return
      end do
      allocate (problem%priors(0))
      if (allocated(model%priors)) problem%priors = model%priors
      do i = 1, size(problem%priors)
         call problem%priors(i)%refer_to(problem%scenario)
      end do
      call problem%guess_noise()
   end subroutine new_residuals

   !> Number of residuals, all records together.
   pure integer function samples(self)
      class(residual_t), intent(in) :: self
      integer :: i

      samples = sum([(size(self%parts(i)%experiment%samples), i=1, size(self%parts))])
   end function samples

   !> (records) the first row of each.
   pure function first_rows(self)
      class(residual_t), intent(in) :: self
      integer :: first_rows(size(self%parts)), i

      first_rows(1) = 1
      do i = 2, size(first_rows)
         first_rows(i) = first_rows(i - 1) + size(self%parts(i - 1)%experiment%samples)
      end do
   end function first_rows

   !> All residuals: those of the samples, what is known of free parameters, and the penalties.
   pure integer function rows(self)
      class(residual_t), intent(in) :: self
      integer :: first, last

      call self%penalty_rows(fields, first, last)
      rows = first + last - 1
   end function rows

   !> How many of them are what is known of free parameters.
   pure integer function prior_rows(self)
      class(residual_t), intent(in) :: self

      prior_rows = count(priors_of(self%priors, self%free, self%record) > 0)
   end function prior_rows

   !> Where the penalty on E(x) (1) or c_D(x) (2) begins, and how many rows it has.
   pure subroutine penalty_rows(self, a, first, rows)
      class(residual_t), intent(in) :: self
      integer, intent(in) :: a
      integer, intent(out) :: first, rows
      integer :: k

      first = self%samples() + self%prior_rows() + 1
      rows = 0
      do k = 1, a
         first = first + rows
         rows = 0
         if (self%strength(k) > 0) rows = max(0, size(self%field_columns(k)) - penalty_order)
      end do
   end subroutine penalty_rows

   !> Places of the coefficients of a function, of_E_x or of_c_D_x, among the free parameters, where
   !> all of them are; else of size 0.
   pure function field_columns(self, a) result(columns)
      class(residual_t), intent(in) :: self
      integer, intent(in) :: a
      integer, allocatable :: columns(:)
      integer :: coefficients, k

      allocate (columns(0))
      if (.not. any(is_coefficient(self%free))) return
      coefficients = self%scenario%structures(1)%variations%along(a)%coefficients
      if (coefficients == 0) return
      columns = [(findloc(self%free, coefficient_at(k, a), dim=1), k=1, coefficients)]
      if (any(columns == 0)) columns = [integer ::]
   end function field_columns

   !> How many unknowns enter linearly.
   pure integer function linear_unknowns(self)
      class(residual_t), intent(in) :: self
      integer :: i

      linear_unknowns = merge(size(self%parts), 0, self%offset) + 2*sum( &
         self%scenario%excitations%modes, mask=is_first([(self%parts(i)%experiment%motion, &
         i=1, size(self%parts))]))
   end function linear_unknowns

   !> Whether residuals are in units of the noise: of several records, or where it is stated.
   pure logical function is_weighted(self)
      class(residual_t), intent(in) :: self

      is_weighted = size(self%parts) > 1 .or. .not. all(self%is_estimated())
   end function is_weighted

   !> (records) whether the noise is not stated. Of one record none is needed, but beside priors.
   pure function is_estimated(self)
      class(residual_t), intent(in) :: self
      logical :: is_estimated(size(self%parts))
      integer :: i

      is_estimated = [(.not. allocated(self%parts(i)%experiment%sd), i=1, size(self%parts))]
   end function is_estimated

   !> The noise as stated, or before any fit a twentieth of what a record varies.
   subroutine guess_noise(self)
      class(residual_t), intent(inout) :: self
      real(wp) :: sd
      integer :: i

      self%weight = spread(1.0_wp, 1, size(self%parts))
      self%noise = 1
      do i = 1, size(self%parts)
         associate (experiment => self%parts(i)%experiment, z => self%parts(i)%experiment%measured)
            if (allocated(experiment%sd)) then
               self%weight(i) = 1/experiment%sd
               cycle
            end if
            sd = 0.05_wp*norm2(z - sum(z)/size(z))/sqrt(real(size(z), wp))
            if (.not. sd > 0) sd = 1
            if (self%is_weighted()) self%weight(i) = 1/sd
            if (.not. self%is_weighted()) self%noise = sd
         end associate
      end do
   end subroutine guess_noise

   !> (samples) residuals as accelerations.
   !>
   !> r  (rows)
   pure function without_weights(self, r) result(plain)
      class(residual_t), intent(in) :: self
      real(wp), intent(in) :: r(:)
      real(wp), allocatable :: plain(:)
      integer :: i, m, row

      plain = r(:self%samples())
      row = 0
      do i = 1, size(self%parts)
         m = size(self%parts(i)%experiment%samples)
         plain(row + 1:row + m) = plain(row + 1:row + m)/self%weight(i)
         row = row + m
      end do
   end function without_weights

   !> The scenario with trial values in place.
   pure type(scenario_t) function with(self, parameters)
      class(residual_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      integer :: k

      with = self%scenario
      do k = 1, size(parameters)
         call with%set(self%free(k), self%record(k), parameters(k))
      end do
   end function with

   !> The problem with the first part of each record.
   !>
   !> share  of the time from its first sample to its last
   function beginning(self, share) result(part)
      class(residual_t), intent(in) :: self
      real(wp), intent(in) :: share
      type(residual_t) :: part
      integer :: i, m

      part = self
      do i = 1, size(part%parts)
         associate (prepared => part%parts(i), t => self%parts(i)%experiment%samples)
            m = count(t <= t(1) + share*(t(size(t)) - t(1)))
            prepared%experiment%samples = t(:m)
            prepared%experiment%measured = self%parts(i)%experiment%measured(:m)
            prepared%sampling = new_sampling(prepared%sampling%observation, t(:m))
         end associate
      end do
   end function beginning

   subroutine residuals(self, parameters, r, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: none(size(r), 0)

      call self%evaluate(parameters, r, none, error)
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%evaluate(parameters, r, jac, error)
   end subroutine jacobian

   !> Residuals with the linear unknowns eliminated, and derivatives as far as there is room.
   !>
   !> r             (samples), or (rows) with those of the priors
   !> jac           (m, 0); (m, n) of the residuals; (m, n + k) with respect to every unknown, the
   !>               linear ones included, each with all the others held
   !> coefficients  (k) the linear unknowns, where the derivatives are with respect to all: of each
   !>               motion in turn cosine and sine of each mode, then the offset of each channel
   subroutine evaluate(self, parameters, r, jac, error, coefficients)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(out), optional :: coefficients(:)
      type(projection_t) :: projection
      type(scenario_t) :: scenario
      type(linear_t) :: linear
      real(wp), allocatable :: dy(:, :), phi(:, :), along(:, :), c(:)
      integer, allocatable :: mine(:)
      integer :: i, k, last, n, m, row, column

      self%log_volume = 0
      call check_interrupt(error)
      if (allocated(error)) return
      scenario = self%with(parameters)
      n = size(parameters)
      jac = 0
      row = 0
      column = n
      i = 1
      do while (i <= size(self%parts))
         last = self%last_channel(i)
         m = sum([(size(self%parts(k)%experiment%samples), k=i, last)])
         mine = pack([(k, k=1, n)], size(jac, 2) > 0 .and. &
            (self%record == 0 .or. self%record == i))
         if (allocated(dy)) deallocate (dy)
         allocate (dy(m, size(mine)))
         associate (y => r(row + 1:row + m), by => jac(row + 1:row + m, :))
            call self%motion(scenario, i, last, self%free(mine), y, dy, linear, error)
            if (allocated(error)) return
            if (allocated(c)) deallocate (c)
            allocate (c(size(linear%weights, 2)))
            if (size(c) > 0) then
               phi = linear%columns(0)
               call new_projection(phi, projection, error)
               if (allocated(error)) return
               self%log_volume = self%log_volume &
                  + sum([(log(abs(projection%r(k, k))), k=1, size(c))])
               call projection%coefficients(y, c)
               if (allocated(along)) deallocate (along)
               allocate (along(size(c), size(mine)))
               call linear%add_change(c, y, dy, along)
               if (.not. present(coefficients)) call projection%derivatives(along, dy)
            end if
            by(:, mine) = dy
            if (present(coefficients) .and. size(c) > 0) then
               by(:, column + 1:column + size(c)) = phi
               coefficients(column - n + 1:column - n + size(c)) = c
               column = column + size(c)
            end if
         end associate
         row = row + m
         i = last + 1
      end do
      if (size(r) > row) call self%add_priors(parameters, r(row + 1:), jac(row + 1:, :))
   end subroutine evaluate

   !> The last record of the motion of which record i is the first channel.
   pure integer function last_channel(self, i) result(last)
      class(residual_t), intent(in) :: self
      integer, intent(in) :: i

      last = i
      if (self%parts(i)%experiment%motion == 0) return
      do while (last < size(self%parts))
         if (self%parts(last + 1)%experiment%motion /= self%parts(i)%experiment%motion) exit
         last = last + 1
      end do
   end function last_channel

   !> Weighted residuals of one motion by its channels, one below the other; its modes are common to
   !> them, the offset of each is its own.
   !>
   !> y, dy, linear  as of `prepared_experiment_t`, rows in the order of the channels
   subroutine motion(self, scenario, first, last, parameters, y, dy, linear, error)
      class(residual_t), intent(inout) :: self
      type(scenario_t), intent(in) :: scenario
      integer, intent(in) :: first, last, parameters(:)
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(error_t), allocatable, intent(out) :: error
      type(linear_t) :: channel(first:last)
      type(seen_modes_t) :: seen
      integer :: i, k, m, modes, place, row

      row = 0
      do i = first, last
         m = size(self%parts(i)%experiment%samples)
         call self%parts(i)%evaluate(scenario%structures(i), scenario%excitations(i), self%offset, &
            parameters, y(row + 1:row + m), dy(row + 1:row + m, :), channel(i), self%work, error, &
            seen)
         if (allocated(error)) return
         if (self%is_weighted()) then
            associate (w => self%weight(i), rows => dy(row + 1:row + m, :))
               y(row + 1:row + m) = w*y(row + 1:row + m)
               rows = w*rows
               channel(i)%basis = w*channel(i)%basis
            end associate
         end if
         if (allocated(self%colour)) then
            associate (reading => y(row + 1:row + m))
               call self%colour(i)%whiten(reading)
            end associate
            do k = 1, size(dy, 2)
               associate (column => dy(row + 1:row + m, k))
                  call self%colour(i)%whiten(column)
               end associate
            end do
            do k = 1, size(channel(i)%basis, 2)
               call self%colour(i)%whiten(channel(i)%basis(:, k))
            end do
         end if
         row = row + m
      end do
      if (first == last) then
         call move_alloc(channel(first)%basis, linear%basis)
         call move_alloc(channel(first)%weights, linear%weights)
         return
      end if
      modes = 2*scenario%excitations(first)%modes
      k = sum([(size(channel(i)%basis, 2), i=first, last)])
      allocate (linear%basis(size(y), k), source=0.0_wp)
      allocate (linear%weights(k, modes + merge(last - first + 1, 0, self%offset), &
         0:size(parameters)), source=0.0_wp)
      row = 0
      place = 0
      do i = first, last
         associate (basis => channel(i)%basis, weights => channel(i)%weights)
            m = size(basis, 1)
            k = size(basis, 2)
            linear%basis(row + 1:row + m, place + 1:place + k) = basis
            linear%weights(place + 1:place + k, :modes, :) = weights(:, :modes, :)
            if (self%offset) linear%weights(place + 1:place + k, modes + i - first + 1, :) = &
               weights(:, modes + 1, :)
            row = row + m
            place = place + k
         end associate
      end do
   end subroutine motion

   !> The rows of what is known of free parameters.
   pure subroutine add_priors(self, parameters, r, jac)
      class(residual_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(inout) :: r(:), jac(:, :)
      real(wp) :: centre, slope
      integer :: which(size(parameters)), k, row

      which = priors_of(self%priors, self%free, self%record)
      row = 0
      do k = 1, size(parameters)
         if (which(k) == 0) cycle
         row = row + 1
         associate (prior => self%priors(which(k)))
            centre = prior%centre_in(self%record(k))
            slope = self%noise/prior%width(centre)
            r(row) = slope*(parameters(k) - centre)
         end associate
         if (size(jac, 2) > 0) jac(row, k) = slope
      end do
      call add_penalties(self, parameters, r(row + 1:), jac(row + 1:, :))
   end subroutine add_priors

   !> The rows that keep E(x) and c_D(x) smooth.
   pure subroutine add_penalties(self, parameters, r, jac)
      type(residual_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(inout) :: r(:), jac(:, :)
      integer, allocatable :: columns(:)
      real(wp), allocatable :: differences(:, :)
      integer :: a, k, row

      row = 0
      do a = 1, fields
         if (.not. self%strength(a) > 0) cycle
         columns = self%field_columns(a)
         differences = sqrt(self%strength(a))*difference_rows(size(columns), penalty_order)
         associate (rows => size(differences, 1))
            r(row + 1:row + rows) = matmul(differences, log(parameters(columns)))
            if (size(jac, 2) > 0) then
               do k = 1, size(columns)
                  jac(row + 1:row + rows, columns(k)) = differences(:, k)/parameters(columns(k))
               end do
            end if
            row = row + rows
         end associate
      end do
   end subroutine add_penalties

end module beamid_residuals
