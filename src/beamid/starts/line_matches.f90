!> Start values if a property varies along the beam.
!>
!> From the lowest mode on, each mode is given the frequency and the decay rate of the nearest
!> spectral line. E(x) and c_D(x) are kept smooth, and all other parameters are kept near their
!> start.
module beamid_line_matches
   use beamid_assignments, only: lines_t
   use beamid_decaying_lines, only: find_lines
   use beamid_errors, only: error_t, failure
   use beamid_field_penalties, only: fields, penalty_count, penalty_order
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_model_roots, only: belief_t, beliefs_about, model_roots
   use beamid_parameters, only: free_names
   use beamid_problems, only: smooth_problem_t
   use beamid_residuals, only: residual_t
   use beamid_smoothing, only: difference_rows
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, of_x_D
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: match_lines, starts_along

   !> Number of places along the beam at which the search for a dip starts.
   integer, parameter, public :: dip_places = 11

   !> Largest number of modes that are matched.
   integer, parameter :: most_modes = 8

   !> Relative standard deviations of frequencies and decay rates, which come from the errors of the
   !> model and not from noise; and standard deviation of the differences of the logarithms of
   !> neighbouring coefficients. Start values need no better ones.
   real(wp), parameter :: frequency_error = 1e-3_wp, rate_error = 0.3_wp, unlike = 0.1_wp

   !> A mode and its spectral line in one record.
   type :: match_t
      integer :: record = 0, mode = 0
      real(wp) :: frequency = 0, rate = 0    !< frequency and decay rate of the line [1/time]
   end type match_t

   !> The least-squares problem that fits the modes of the model to their lines.
   type, extends(smooth_problem_t) :: matching_t
      type(residual_t) :: problem                 !< supplies the model
      type(match_t), allocatable :: matches(:)
      type(belief_t), allocatable :: beliefs(:)   !< (n) expected parameter values
      integer :: modes = 0                        !< number of modes to compute
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure :: rows
   end type matching_t

contains

   !> Returns start values that suit the spectral lines, the best first.
   !>
   !> If the place of a dip is free, the search starts all along the beam, because dips at distant
   !> places may give similar frequencies.
   !>
   !> variables  (n) variables with the start values of the case
   !> starts     (n, candidates); no candidates if no lines of the records match the model
   subroutine match_lines(problem, variables, starts)
      type(residual_t), intent(in) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(variable_t), allocatable, intent(out) :: starts(:, :)
      integer, parameter :: most_starts = 6
      type(variable_t), allocatable :: tried(:, :)
      type(lines_t), allocatable :: lines(:)
      real(wp), allocatable :: cost(:)
      real(wp) :: length
      integer :: best, dip, k

      allocate (starts(size(variables), 0))
      call lines_of_problem(problem, variables, lines)
      if (.not. allocated(lines)) return
      dip = findloc(problem%free, of_x_D, dim=1)
      length = problem%scenario%structures(1)%length
      tried = starts_along(problem, variables)
      allocate (cost(size(tried, 2)))
      do k = 1, size(cost)
         call match_from(problem, lines, tried(:, k), cost(k))
      end do
      do k = 1, most_starts
         best = minloc(cost, dim=1)
         if (.not. cost(best) < huge(cost)) return
         starts = reshape([starts, tried(:, best)], [size(variables), k])
         ! Of several candidates with the dip at the same place, the best one is enough.
         if (dip == 0) return
         where (abs(tried(dip, :)%start - tried(dip, best)%start) < 0.01_wp*length .and. &
            abs(cost - cost(best)) <= 0.1_wp*cost(best)) cost = huge(cost)
         cost(best) = huge(cost)
      end do
   end subroutine match_lines

   !> Returns the start values of the case, and if the place of a dip is free, copies of them with
   !> the dip at several places along the beam.
   !>
   !> variables  (n) variables with the start values of the case
   !> starts     (n, 1 or 1 + dip_places)
   pure function starts_along(problem, variables) result(starts)
      type(residual_t), intent(in) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(variable_t), allocatable :: starts(:, :)
      real(wp) :: first, last
      integer :: dip, k

      dip = findloc(problem%free, of_x_D, dim=1)
      allocate (starts(size(variables), merge(dip_places + 1, 1, dip > 0)))
      do k = 1, size(starts, 2)
         starts(:, k) = variables
         if (k == 1) cycle
         first = max(0.0_wp, variables(dip)%lower)
         last = min(problem%scenario%structures(1)%length, variables(dip)%upper)
         starts(dip, k) = variables(dip)%from(first + (k - 1.5_wp)*(last - first)/dip_places)
      end do
   end function starts_along

   !> Finds the spectral lines of each record, up to the highest mode that is matched.
   !>
   !> lines  (records); not allocated if the model has no modes, or a record has no lines
   subroutine lines_of_problem(problem, variables, lines)
      type(residual_t), intent(in) :: problem
      type(variable_t), intent(in) :: variables(:)
      type(lines_t), allocatable, intent(out) :: lines(:)
      type(residual_t) :: trial
      type(lines_t) :: found(size(problem%parts))
      type(error_t), allocatable :: error
      complex(wp), allocatable :: s(:), ds(:, :)
      integer :: modes, r

      call problem%copy_to(trial)
      modes = min(most_modes, problem%parts(1)%galerkin%space%n - 2)
      if (modes < 1) return
      allocate (s(modes), ds(modes, size(variables)))
      do r = 1, size(found)
         call model_roots(trial, problem%with([variables%start]), r, s, ds, error)
         if (allocated(error)) return
         call find_lines(problem%parts(r)%observed%times(), problem%parts(r)%observed%measured, &
            1.3_wp*maxval(aimag(s))/two_pi, most_modes + 4, found(r)%line)
         if (size(found(r)%line) == 0) return
      end do
      lines = found
   end subroutine lines_of_problem

   !> Matches lines to modes from one start, the lowest mode first.
   !>
   !> lines      (records) spectral lines
   !> variables  (n) on return with the start values that suit the lines
   !> cost       sum of squares; huge if no lines match
   subroutine match_from(problem, lines, variables, cost)
      type(residual_t), intent(in) :: problem
      type(lines_t), intent(in) :: lines(:)
      type(variable_t), intent(inout) :: variables(:)
      real(wp), intent(out) :: cost
      type(matching_t) :: matching
      type(fit_t) :: found
      type(error_t), allocatable :: error
      type(options_t) :: options
      complex(wp), allocatable :: s(:), ds(:, :)
      integer :: before, k, nearest, r
      real(wp) :: limit, distance

      cost = huge(cost)
      call problem%copy_to(matching%problem)
      matching%beliefs = beliefs_about(problem%scenario, problem%free, problem%record, &
         [variables%start], problem%priors)
      do k = 1, size(variables)
         if (is_coefficient(problem%free(k))) matching%beliefs(k)%width = 1
         if (problem%free(k) == of_x_D) matching%beliefs(k)%width = 0.2_wp &
            *problem%scenario%structures(1)%length
      end do
      allocate (matching%matches(0))
      options%check = .false.
      options%tolerance = 1e-6_wp
      options%max_evaluations = 200
      do k = 1, min(most_modes, problem%parts(1)%galerkin%space%n - 2)
         matching%modes = k
         if (allocated(s)) deallocate (s, ds)
         allocate (s(k), ds(k, size(variables)))
         before = size(matching%matches)
         do r = 1, size(lines)
            call model_roots(matching%problem, problem%with([variables%start]), r, s, ds, error)
            if (allocated(error)) return
            associate (line => lines(r)%line, f => aimag(s(k))/two_pi)
               if (.not. f > 0) cycle
               nearest = minloc(abs(log(line%frequency/f)), dim=1)
               ! Modes that have been matched predict the next one more closely.
               limit = merge(0.3_wp, 0.1_wp, before == 0)
               distance = abs(log(line(nearest)%frequency/f))
               if (distance > limit) cycle
               matching%matches = [matching%matches, match_t(r, k, line(nearest)%frequency, &
                  max(line(nearest)%decay, 1e-6_wp*f))]
            end associate
         end do
         if (size(matching%matches) == before) cycle
         call fit(matching, matching%rows(), variables, options, found, error, &
            label='lines', names=free_names(problem%free))
         if (allocated(error)) return
         variables = variables%from(found%estimate)
      end do
      if (size(matching%matches) > 0) cost = found%J
   end subroutine match_from

   !> Returns the number of residuals: two for each match, one for each parameter, and those of the
   !> smoothness penalties.
   pure integer function rows(self)
      class(matching_t), intent(in) :: self
      integer :: a

      rows = 2*size(self%matches) + size(self%beliefs)
      do a = 1, fields
         rows = rows + penalty_count(size(self%problem%field_columns(a)))
      end do
   end function rows

   !> Computes the residuals (rows) at trial values of the parameters (n).
   subroutine residuals(self, parameters, r, error)
      class(matching_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call self%jacobian(parameters, r, jac, error)
   end subroutine residuals

   !> Computes the residuals (rows) and their derivatives (rows, n) at trial values of the
   !> parameters.
   subroutine jacobian(self, parameters, r, jac, error)
      class(matching_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: s(self%modes), ds(self%modes, size(parameters))
      real(wp), allocatable :: differences(:, :)
      integer, allocatable :: columns(:)
      integer :: a, k, last, n, row

      r = 0
      jac = 0
      last = 0
      n = size(parameters)
      do k = 1, size(self%matches)
         associate (match => self%matches(k))
            if (match%record /= last) call model_roots(self%problem, &
               self%problem%with(parameters), match%record, s, ds, error)
            if (allocated(error)) return
            last = match%record
            associate (root => s(match%mode), by => ds(match%mode, :))
               if (.not. aimag(root) > 0) then
                  call failure(error, 'lines: mode '//to_text(match%mode)//' is overdamped')
                  return
               end if
               r(2*k - 1) = log(aimag(root)/two_pi/match%frequency)/frequency_error
               jac(2*k - 1, :) = aimag(by)/aimag(root)/frequency_error
               if (.not. real(root) < 0) cycle
               r(2*k) = log(-real(root)/match%rate)/rate_error
               jac(2*k, :) = real(by)/real(root)/rate_error
            end associate
         end associate
      end do
      row = 2*size(self%matches)
      do k = 1, n
         associate (b => self%beliefs(k))
            if (.not. b%slope(parameters(k)) > 0) then
               call failure(error, 'lines: a parameter at 0 that is believed to be above')
               return
            end if
            r(row + k) = (b%x_of(parameters(k)) - b%x_of(b%centre))/b%width
            jac(row + k, k) = 1/(b%slope(parameters(k))*b%width)
         end associate
      end do
      row = row + n
      do a = 1, fields
         columns = self%problem%field_columns(a)
         if (size(columns) == 0) cycle
         differences = difference_rows(size(columns), penalty_order)/unlike
         associate (m => size(differences, 1))
            r(row + 1:row + m) = matmul(differences, log(parameters(columns)))
            do k = 1, size(columns)
               jac(row + 1:row + m, columns(k)) = differences(:, k)/parameters(columns(k))
            end do
            row = row + m
         end associate
      end do
   end subroutine jacobian

end module beamid_line_matches
