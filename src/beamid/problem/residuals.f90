!> Residuals of a fit, model minus observed data, and their derivatives with respect to the free
!> parameters.
!>
!> The least-squares search calls this module. Each evaluation computes the model of every record
!> and eliminates the linear unknowns (variable projection).
module beamid_residuals
   use beamid_condensation, only: few_rows
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t, prepare_experiment
   use beamid_galerkin, only: mesh_t
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_motion_rows, only: motion_rows_t
   use beamid_observed_data, only: observed_data_t
   use beamid_prior_rows, only: add_prior_rows
   use beamid_problems, only: compare_derivatives
   use beamid_responses, only: is_exact
   use beamid_simulation, only: model_t
   use beamid_structure, only: yielding
   use beamid_triangles, only: triangle_of
   use beamid_unknowns, only: scenario_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: kept_t, residual_t, new_residuals

   !> Largest number of samples of a record at which exact derivatives are all compared with
   !> differences. Of a longer record, every k-th run of neighbours is compared, with the smallest k
   !> that leaves about this number or less.
   integer, parameter, public :: checked_samples = 8192

   !> The residuals of a fit as a function of its free parameters.
   !>
   !> The rows are, in this order: the data of each record times the weight of the record; one
   !> row for each free parameter that has a prior, namely its distance from the prior mean in
   !> standard deviations, times `noise`; and for E(x) and c_D(x) the differences of the logarithms
   !> of neighbouring coefficients, times the square root of the strength of the penalty.
   type, extends(motion_rows_t) :: residual_t
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure :: condensed_rows
      procedure :: condensed
      procedure :: evaluate
      procedure :: squares
      procedure :: beginning
      procedure :: copy_to
      procedure :: check_sample
      procedure :: thin, restore
      procedure, private :: has_long_record
   end type residual_t

   !> Data of an experiment that are kept while others stand in for them.
   type :: kept_t
      class(observed_data_t), allocatable :: observed
   end type kept_t

contains

   !> Prepares the fit of some experiments on one mesh. A stage sets later which parameters are
   !> free.
   !>
   !> model    structure, observation, solver and priors; its excitation is not used, because each
   !>          experiment has its own
   !> free     numbers of parameters that may be free, so that compliances of the ends among them
   !>          may become 0, and the mesh has no knots at positions among them; default: none
   !> error    the solver of the model cannot compute an experiment
   subroutine new_residuals(model, mesh, experiments, problem, error, free)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(residual_t), intent(out) :: problem
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: free(:)
      integer :: i

      problem%exact = is_exact(model%solver)
      allocate (problem%parts(size(experiments)))
      allocate (problem%scenario%structures(size(experiments)))
      allocate (problem%scenario%excitations(size(experiments)))
      do i = 1, size(experiments)
         problem%scenario%structures(i) = experiments(i)%structure_of(model%structure)
         if (present(free)) problem%scenario%structures(i)%yields = yielding(free)
         problem%scenario%excitations(i) = experiments(i)%excitation
         call prepare_experiment(experiments(i), problem%scenario%structures(i), mesh, &
            model%observation, model%solver, problem%parts(i), error, free)
         if (allocated(error)) return
      end do
      allocate (problem%priors(0))
      if (allocated(model%priors)) problem%priors = model%priors
      do i = 1, size(problem%priors)
         call problem%priors(i)%refer_to(problem%scenario)
      end do
      call problem%guess_noise()
   end subroutine new_residuals

   !> Copies the problem with its data. gfortran expands each assignment of this type to about 10 kB
   !> of code; call this procedure instead.
   subroutine copy_to(self, copy)
      class(residual_t), intent(in) :: self
      type(residual_t), intent(inout) :: copy

      copy = self
   end subroutine copy_to

   !> Returns the fit of the first part of each time record, and of all other data.
   !>
   !> share  length of the part, as a share of the time from the first sample to the last
   function beginning(self, share) result(part)
      class(residual_t), intent(in) :: self
      real(wp), intent(in) :: share
      type(residual_t) :: part
      integer :: i

      call self%copy_to(part)
      do i = 1, size(part%parts)
         call part%parts(i)%observed%keep_beginning(share)
      end do
   end function beginning

   !> Compares the exact derivatives of some samples of long records with central differences: the
   !> formulas are the same for all samples. Arguments as of `smooth_problem_t`.
   subroutine check_sample(self, parameters, variables, worst, mistaken, is_done)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      type(variable_t), intent(in) :: variables(:)
      real(wp), allocatable, intent(out) :: worst
      integer, intent(out) :: mistaken
      logical, intent(out) :: is_done
      type(kept_t), allocatable :: kept(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: r(:), jac(:, :)

      mistaken = 0
      ! The data are exchanged, so that the solvers continue from the same points as if all
      ! residuals were compared.
      call self%thin(checked_samples, kept)
      is_done = size(kept) > 0
      if (is_done) then
         allocate (r(self%rows()), jac(self%rows(), size(parameters)))
         call self%jacobian(parameters, r, jac, error)
         is_done = .not. allocated(error)
         if (is_done) call compare_derivatives(self, parameters, variables, jac, worst, mistaken)
      end if
      call self%restore(kept)
   end subroutine check_sample

   !> Replaces each long time record by some of its samples, as `keep_sample` chooses them.
   !>
   !> most  number of samples from which on a record is long
   !> kept  the data of all parts, for `restore`; of size 0 if no record is long
   subroutine thin(self, most, kept)
      class(residual_t), intent(inout) :: self
      integer, intent(in) :: most
      type(kept_t), allocatable, intent(out) :: kept(:)
      logical :: taken(size(self%parts))
      integer :: i

      allocate (kept(merge(size(taken), 0, any([(size(self%parts(i)%observed%measured) > most, &
         i=1, size(taken))]))))
      do i = 1, size(kept)
         call move_alloc(self%parts(i)%observed, kept(i)%observed)
         allocate (self%parts(i)%observed, source=kept(i)%observed)
         call self%parts(i)%observed%keep_sample(most, taken(i))
      end do
   end subroutine thin

   !> Puts back what `thin` has kept.
   subroutine restore(self, kept)
      class(residual_t), intent(inout) :: self
      type(kept_t), intent(inout) :: kept(:)
      integer :: i

      do i = 1, size(kept)
         deallocate (self%parts(i)%observed)
         call move_alloc(kept(i)%observed, self%parts(i)%observed)
      end do
   end subroutine restore

   !> Computes the residuals (rows) at trial values of the parameters (n).
   subroutine residuals(self, parameters, r, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: none(size(r), 0)

      call self%evaluate(parameters, r, none, error)
   end subroutine residuals

   !> Computes the residuals (rows) and their derivatives (rows, n) at trial values (n).
   subroutine jacobian(self, parameters, r, jac, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%evaluate(parameters, r, jac, error)
   end subroutine jacobian

   !> Computes the residuals with the linear unknowns eliminated, and derivatives as far as `jac`
   !> has columns.
   !>
   !> parameters    (n) trial values
   !> r             (samples) without the rows of priors and penalties, or (rows) with them
   !> jac           (size(r), 0): no derivatives. (size(r), n): derivatives of the residuals, the
   !>               linear unknowns being eliminated. (size(r), n + k): derivatives with respect to
   !>               all unknowns, first the parameters, then the k linear unknowns, each with all
   !>               others fixed
   !> coefficients  (k) linear unknowns; required if `jac` has n + k columns. With n columns,
   !>               they are fixed in the derivatives. For each motion they are cosine and sine of
   !>               each mode, then the offset of each channel
   !> error         interrupted by the user; the model cannot be computed; the samples cannot tell
   !>               the linear unknowns apart
   subroutine evaluate(self, parameters, r, jac, error, coefficients)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(out), optional :: coefficients(:)
      type(scenario_t) :: scenario
      type(linear_t) :: linear
      real(wp), allocatable :: dy(:, :), phi(:, :), c(:)
      integer, allocatable :: active(:)
      logical :: is_done
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
         m = self%samples_in(i, last)
         active = pack([(k, k=1, n)], size(jac, 2) > 0 .and. &
            (self%record == 0 .or. self%record == i))
         associate (y => r(row + 1:row + m), block => jac(row + 1:row + m, :))
            call self%expand_motion(scenario, i, last, active, merge(column, -1, &
               present(coefficients)), y, block, c, is_done, error)
            if (.not. (is_done .or. allocated(error))) then
               if (allocated(dy)) deallocate (dy)
               allocate (dy(m, size(active)))
               call self%evaluate_motion(scenario, i, last, self%free(active), y, dy, linear, error)
               if (.not. allocated(error)) call self%eliminate(linear, .not. &
                  present(coefficients), y, dy, phi, c, error)
               if (allocated(error)) return
               block(:, active) = dy
               if (present(coefficients) .and. size(c) > 0 .and. size(jac, 2) > n) &
                  block(:, column + 1:column + size(c)) = phi
            end if
            if (allocated(error)) return
         end associate
         if (present(coefficients)) then
            coefficients(column - n + 1:column - n + size(c)) = c
            column = column + size(c)
         end if
         row = row + m
         i = last + 1
      end do
      if (size(r) > row) call add_prior_rows(self, parameters, r(row + 1:), jac(row + 1:, :))
   end subroutine evaluate

   !> Computes the sum of squares of the residuals of each record, and that of the priors and
   !> penalties, with the linear unknowns eliminated. Long records are condensed.
   !>
   !> parameters  (n) trial values
   !> J           (records + 1)
   !> error       as of `evaluate`
   subroutine squares(self, parameters, J, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: J(:)
      type(error_t), allocatable, intent(out) :: error
      type(scenario_t) :: scenario
      type(linear_t) :: linear
      type(linear_t), allocatable :: channels(:)
      real(wp), allocatable :: y(:), dy(:, :), phi(:, :), c(:)
      real(wp) :: of_priors(self%rows() - self%samples()), none(size(of_priors), 0)
      integer :: rows(0:size(self%parts)), i, k, last

      self%log_volume = 0
      call check_interrupt(error)
      if (allocated(error)) return
      scenario = self%with(parameters)
      i = 1
      do while (i <= size(self%parts))
         last = self%last_channel(i)
         if (allocated(channels)) deallocate (channels)
         allocate (channels(i:last))
         rows(i - 1) = 0
         call self%condense_motion(scenario, i, last, [integer ::], .true., y, dy, linear, &
            channels, error, rows(i:last))
         if (.not. allocated(error)) call self%eliminate(linear, .true., y, dy, phi, c, error)
         if (allocated(error)) return
         J(i:last) = [(sum(y(rows(k - 1) + 1:rows(k))**2), k=i, last)]
         i = last + 1
      end do
      if (size(of_priors) > 0) call add_prior_rows(self, parameters, of_priors, none)
      J(size(J)) = sum(of_priors**2)
   end subroutine squares

   !> Returns the number of rows that a search needs: n + 1 if derivatives are exact and there is a
   !> long record, else all. Arguments as of `smooth_problem_t`.
   pure integer function condensed_rows(self, m, n)
      class(residual_t), intent(in) :: self
      integer, intent(in) :: m, n

      condensed_rows = merge(n + 1, m, self%has_long_record() .and. n + 1 < m)
   end function condensed_rows

   !> Returns whether derivatives are exact and a record is long enough to be condensed.
   pure logical function has_long_record(self)
      class(residual_t), intent(in) :: self
      integer :: i

      has_long_record = .false.
      if (.not. self%exact) return
      do i = 1, size(self%parts)
         has_long_record = has_long_record .or. self%samples_in(i, i) >= few_rows
      end do
   end function has_long_record

   !> Computes residuals and derivatives in condensed rows, with the linear unknowns eliminated.
   !>
   !> r    (n + 1)
   !> jac  (n + 1, n)
   subroutine condensed(self, parameters, r, jac, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(scenario_t) :: scenario
      type(linear_t) :: linear
      type(linear_t), allocatable :: channels(:)
      real(wp), allocatable :: y(:), dy(:, :), phi(:, :), c(:), rows(:, :)
      integer, allocatable :: active(:)
      integer :: i, k, last, m, n

      n = size(parameters)
      if (.not. self%has_long_record() .or. size(r) /= n + 1) then
         call self%jacobian(parameters, r, jac, error)
         return
      end if
      self%log_volume = 0
      call check_interrupt(error)
      if (allocated(error)) return
      scenario = self%with(parameters)
      allocate (rows(n + 1, n + 1), source=0.0_wp)
      i = 1
      do while (i <= size(self%parts))
         last = self%last_channel(i)
         active = pack([(k, k=1, n)], self%record == 0 .or. self%record == i)
         if (allocated(channels)) deallocate (channels)
         allocate (channels(i:last))
         call self%condense_motion(scenario, i, last, self%free(active), .true., y, dy, linear, &
            channels, error)
         if (.not. allocated(error)) call self%eliminate(linear, .true., y, dy, phi, c, error)
         if (allocated(error)) return
         call add_rows(active, dy, y, rows)
         i = last + 1
      end do
      m = self%rows() - self%samples()
      if (m > 0) then
         y = spread(0.0_wp, 1, m)
         dy = spread(spread(0.0_wp, 1, m), 2, n)
         call add_prior_rows(self, parameters, y, dy)
         call add_rows([(k, k=1, n)], dy, y, rows)
      end if
      jac = rows(:, :n)
      r = rows(:, n + 1)
   end subroutine condensed

   !> Adds rows to a triangle of n parameters and residuals, by reflections.
   !>
   !> active  (p) parameters on which the rows depend
   !> dy, y   (m, p), (m) derivatives and residuals
   !> rows    (n + 1, n + 1) upper triangle
   subroutine add_rows(active, dy, y, rows)
      integer, intent(in) :: active(:)
      real(wp), intent(in) :: dy(:, :), y(:)
      real(wp), intent(inout) :: rows(:, :)
      real(wp) :: a(size(rows, 1) + size(y), size(rows, 2))
      integer :: n

      n = size(rows, 1)
      a = 0
      a(:n, :) = rows
      a(n + 1:, active) = dy
      a(n + 1:, n) = y
      call triangle_of(a, rows)
   end subroutine add_rows

end module beamid_residuals
