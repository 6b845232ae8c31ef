!> Fits parameters within bounds by nonlinear least squares: repeats MINPACK searches until one ends
!> at a minimum, treats parameters at their bounds, and refines results found with finite
!> differences. Everything above `fit/` fits through this module.
module beamid_least_squares
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgels
   use beamid_newton_searches, only: search_by_newton
   use beamid_optimality, only: check_minimum
   use beamid_problems, only: compare_derivatives, differences, problem_t, smooth_problem_t
   use beamid_searches, only: monitor_t, options_t, run_search, search_t
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: monitor_t, fit_t, options_t, fit

   !> Result of a least-squares fit.
   type :: fit_t
      real(wp), allocatable :: estimate(:)   !< (n) physical parameters
      real(wp), allocatable :: start(:)      !< (n) physical parameters at the start
      real(wp), allocatable :: residual(:)   !< (m) residuals at the estimate
      real(wp) :: J = 0                      !< sum of squares of the residuals
      integer :: iterations = 0              !< of all searches
      integer :: evaluations = 0             !< of the residuals, including those for differences
      !> number of trial steps that were shortened because the model could not be computed there
      integer :: shortened = 0
      real(wp), allocatable :: jacobian(:, :) !< (m, n) d residual/d parameter at the estimate
      !> (2) largest relative difference, over the columns, between exact derivatives and central
      !> differences, at the start and at the estimate; not allocated if they were not compared or
      !> the differences could not be computed
      real(wp), allocatable :: derivative_check(:)
      character(len=:), allocatable :: reason !< why the search stopped, in words
   contains
      procedure :: add_earlier
   end type fit_t

   !> Code that follows MINPACK's values of `info`, and the text for each value.
   integer, parameter :: nothing_to_search = 9
   character(len=*), parameter :: reasons(0:nothing_to_search) = [character(len=60) :: &
      'the search could not start', &
      'J falls no further', &
      'the parameters change no further', &
      'neither J nor the parameters change further', &
      'the residuals are orthogonal to every derivative', &
      'the evaluations allowed are used up', &
      'J cannot be made smaller in this precision', &
      'the parameters cannot be improved in this precision', &
      'the derivatives vanish to machine precision', &
      'nothing to search for: all that is free enters linearly']

   !> Bounds of the first step (MINPACK's `factor`): of the first search, and of the searches that
   !> follow if a search does not end at a minimum.
   real(wp), parameter :: first_steps(3) = [100.0_wp, 1.0_wp, 0.1_wp]

contains

   !> Minimises the sum of squares of m residuals by n <= m variables.
   !>
   !> problem    on return at any parameters
   !> m          number of residuals
   !> variables  (n) with starts, bounds and magnitudes
   !> result     the estimate and the course of the fit
   !> error      the model cannot be computed at the start or at the points that the search tries;
   !>            exact derivatives disagree with differences; no convergence
   !> monitor    receives a report of every iteration
   !> label      name of the search in these reports; default ''
   !> names      (n) names of the variables in reports and messages; default 'parameter 1', ...
   subroutine fit(problem, m, variables, options, result, error, monitor, label, names)
      class(problem_t), intent(inout), target :: problem
      integer, intent(in) :: m
      type(variable_t), intent(in) :: variables(:)
      type(options_t), intent(in) :: options
      type(fit_t), intent(out) :: result
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), target, optional :: monitor
      character(len=*), intent(in), optional :: label, names(:)
      type(search_t), target :: search
      character(len=:), allocatable :: objection, note
      ! (rows) and (rows, n) at the estimate; condensed, if the problem can condense its rows
      real(wp), allocatable :: at_start, at_end, residual(:), jacobian(:, :)
      logical :: must_compare
      integer :: attempt, info, k, rows

      if (m < size(variables)) then
         call failure(error, 'least squares: '//to_text(m)//' residuals for '// &
            to_text(size(variables))//' parameters')
         return
      end if
      call prepare()
      allocate (result%residual(0), result%jacobian(0, size(variables)))
      allocate (residual(rows), jacobian(rows, size(variables)))
      result%start = variables%start
      must_compare = associated(search%smooth) .and. options%check
      if (must_compare) then
         if (rows < m) search%evaluations = search%evaluations + 1
         call check_derivatives(result%start, at_start)
         if (allocated(error)) return
      end if
      do attempt = 1, size(first_steps)
         search%factor = first_steps(attempt)
         search%moving = [(k, k=1, size(variables))]
         search%was_fixed = spread(.false., 1, size(variables))
         call minimise_with_bounds()
         if (allocated(error)) return
         objection = ''
         if (info == 0 .or. info == 5 .or. options%rough) exit
         call check_minimum(search, options, result%start, result%estimate, residual, jacobian, &
            objection, note, error)
         if (allocated(error)) return
         if (objection == '') exit
      end do
      call describe_end()
      if (info == 0 .or. (info == 5 .and. .not. options%rough) .or. objection /= '') then
         ! Some callers use the estimate although it is no minimum.
         call find_all_rows()
         call failure(error, 'least squares: no convergence; '//result%reason//objection)
         return
      end if
      if (attempt > 1) result%reason = result%reason//'; search '//to_text(attempt)// &
         ', with shorter steps'
      call find_all_rows()
      if (allocated(error) .or. .not. must_compare) return
      call check_derivatives(result%estimate, at_end)
      if (allocated(at_start) .and. allocated(at_end)) result%derivative_check = [at_start, at_end]

   contains

      !> Connects a search with its problem, its variables and the receiver of its reports.
      subroutine prepare()
         search%problem => problem
         search%residuals = m
         rows = m
         select type (problem)
         class is (smooth_problem_t)
            if (problem%exact) search%smooth => problem
            if (problem%exact) rows = problem%condensed_rows(m, size(variables))
         end select
         if (present(monitor)) search%monitor => monitor
         search%label = ''
         if (present(label)) search%label = label
         allocate (search%names(size(variables)))
         do k = 1, size(variables)
            search%names(k) = 'parameter '//to_text(k)
         end do
         if (present(names)) search%names = names
         search%variables = variables
         search%parameters = variables%start
         ! The difference step, sqrt(relative_error) |z|, must be much larger than the error of the
         ! model. If the step is lost in this error, MINPACK leaves the parameters unchanged and
         ! still reports success.
         if (options%relative_error > 0) search%relative_error = max(options%relative_error, &
            1e-8_wp)
      end subroutine prepare

      !> Compares exact derivatives with central differences, because a fit with wrong derivatives
      !> is wrong.
      !>
      !> parameters  (n) physical values at which `result` has the Jacobian, unless it has no rows
      !> difference  largest relative difference of a column; not allocated if the differences
      !>             cannot be computed
      subroutine check_derivatives(parameters, difference)
         real(wp), intent(in) :: parameters(:)
         real(wp), allocatable, intent(out) :: difference
         logical :: is_done
         integer :: k

         call search%smooth%check_sample(parameters, search%variables, difference, k, is_done)
         if (.not. is_done) then
            if (size(result%residual) < m) call find_all_rows_at(parameters)
            if (allocated(error)) return
            call compare_derivatives(search%problem, parameters, search%variables, &
               result%jacobian, difference, k)
         end if
         if (k == 0) return
         call failure(error, 'least squares: the exact derivative by '//trim(search%names(k))// &
            ' disagrees with differences of the residuals')
      end subroutine check_derivatives

      !> Runs searches until no variable at a bound must be released. At a bound the change of
      !> variable has zero slope, so that a search would creep. Therefore a variable that stays at a
      !> bound is fixed there while the others move, and is released once if J decreases towards the
      !> inside.
      subroutine minimise_with_bounds()
         real(wp), allocatable :: z(:)
         real(wp) :: tolerance
         integer :: k

         if (size(search%variables) == 0) then
            ! All unknowns enter linearly and are eliminated.
            result%estimate = search%parameters
            call find_residual()
            info = nothing_to_search
            return
         end if
         ! A tolerance of the square root of the integrator's error would end a search too early
         ! where residuals are large and convergence is slow.
         tolerance = max(options%tolerance, options%relative_error**0.75_wp)
         do
            search%variables(search%moving) = search%variables(search%moving)%from( &
               search%parameters(search%moving))
            allocate (z(size(search%moving)), source=1.0_wp)
            search%near_bound = 0
            search%iterations_at_bound = 0
            call run_search(search, options, tolerance, z, residual, info)
            if (info == 5 .and. options%persistent .and. associated(search%smooth)) &
               call search_by_newton(search, z, residual, info)
            if (allocated(search%error)) then
               call move_alloc(search%error, error)
               return
            end if
            search%parameters(search%moving) = search%variables(search%moving)%value(z)
            deallocate (z)
            if (info < 0) then
               ! Stopped by `watch_bounds`: fix the variable at its bound and continue with the
               ! others.
               k = search%near_bound
               search%was_fixed(k) = .true.
               search%parameters(k) = search%variables(k)%nearest_bound(search%parameters(k))
               search%moving = pack(search%moving, search%moving /= k)
               if (size(search%moving) > 0) cycle
               call find_residual()
               if (allocated(error)) return
               info = 4
            end if
            result%estimate = search%parameters
            call find_jacobian()
            if (allocated(error)) then
               call name_variables_at_bounds(search, error%message)
               return
            end if
            k = variable_to_release()
            if (k == 0) exit
            search%moving = [search%moving, k]
         end do
         if (.not. associated(search%smooth)) call polish()
      end subroutine minimise_with_bounds

      !> Sets J, the counts and the reason for which the search has ended.
      subroutine describe_end()
         result%J = sum(residual**2)
         result%iterations = search%iterations
         result%evaluations = search%evaluations
         result%shortened = search%shortened
         result%reason = trim(reasons(info))
         call name_variables_at_bounds(search, result%reason)
         if (allocated(note)) result%reason = result%reason//note
      end subroutine describe_end

      !> Computes the residuals at the parameters of a search that has no variable to move.
      subroutine find_residual()
         real(wp), allocatable :: r(:)

         allocate (r(m))
         call search%problem%residuals(search%parameters, r, error)
         if (allocated(error)) return
         residual = 0
         if (rows == m) residual = r
         if (rows < m) residual(1) = norm2(r)
      end subroutine find_residual

      !> Computes all rows of the residuals and of the Jacobian at the estimate, if wanted.
      subroutine find_all_rows()
         if (rows < m) then
            deallocate (result%residual, result%jacobian)
            allocate (result%residual(0), result%jacobian(0, size(variables)))
            if (options%all_rows) call find_all_rows_at(result%estimate)
         else
            call move_alloc(residual, result%residual)
            call move_alloc(jacobian, result%jacobian)
         end if
      end subroutine find_all_rows

      !> Computes all rows of the residuals and of the Jacobian at some parameters.
      subroutine find_all_rows_at(parameters)
         real(wp), intent(in) :: parameters(:)

         deallocate (result%residual, result%jacobian)
         allocate (result%residual(m), result%jacobian(m, size(parameters)))
         if (rows < m) then
            call search%smooth%jacobian(parameters, result%residual, result%jacobian, error)
         else
            call search%evaluate_at(parameters, result%residual, error)
            if (.not. allocated(error)) result%jacobian = search%evaluated(search%here)%jacobian
         end if
      end subroutine find_all_rows_at

      !> Computes the Jacobian at the parameters of a search.
      subroutine find_jacobian()
         if (associated(search%smooth)) then
            call search%evaluate_at(search%parameters, residual, error)
            if (.not. allocated(error)) jacobian = search%evaluated(search%here)%jacobian
         else
            call differences(search%problem, search%parameters, search%variables, &
               search%relative_error, jacobian, error)
         end if
      end subroutine find_jacobian

      !> Refines an estimate by Gauss-Newton steps with the final Jacobian of central differences,
      !> because `lmdif` with its one-sided differences stops a little beside the minimum. The steps
      !> continue while they become shorter. A step is rejected if it is long or raises J by more
      !> than the error of the residuals.
      subroutine polish()
         integer, parameter :: most = 30
         real(wp) :: p(size(search%variables)), r(size(residual)), length, before
         real(wp), allocatable :: a(:, :), step(:, :)
         real(wp) :: work(64*(size(residual) + size(search%moving)))
         type(error_t), allocatable :: error
         integer :: k, m, n, info

         m = size(r)
         n = size(search%moving)
         if (n == 0) return
         before = huge(before)
         do k = 1, most
            a = jacobian(:, search%moving)
            step = reshape(-residual, [m, 1])
            call dgels('N', m, n, 1, a, m, step, m, work, size(work), info)
            if (info /= 0 .or. .not. all(ieee_is_finite(step(:n, 1)))) return
            p = result%estimate
            p(search%moving) = p(search%moving) + step(:n, 1)
            length = maxval(abs(p - result%estimate)/max(abs(result%estimate), tiny(length)))
            if (length > min(1e-2_wp, 0.9_wp*before) .or. any(p < search%variables%lower .or. &
               p > search%variables%upper)) return
            call search%problem%residuals(p, r, error)
            search%evaluations = search%evaluations + 1
            if (allocated(error)) return
            if (sum(r**2) > sum(residual**2)*(1 + 1e-6_wp)) return
            result%estimate = p
            residual = r
            if (length <= 1e-9_wp) return
            before = length
         end do
      end subroutine polish

      !> Returns the index of a variable, fixed at a bound, for which J decreases towards the
      !> inside; 0: none.
      pure integer function variable_to_release() result(k)
         real(wp) :: slope

         do k = 1, size(search%variables)
            if (any(search%moving == k)) cycle
            slope = dot_product(jacobian(:, k), residual)
            if (search%parameters(k) >= search%variables(k)%upper) slope = -slope
            if (slope < 0) return
         end do
         k = 0
      end function variable_to_release

   end subroutine fit

   !> Appends the names of the variables that a search has fixed at their bounds.
   pure subroutine name_variables_at_bounds(search, reason)
      type(search_t), intent(in) :: search
      character(len=:), allocatable, intent(inout) :: reason
      integer :: k

      do k = 1, size(search%variables)
         if (.not. any(search%moving == k)) reason = reason//'; '//trim(search%names(k))// &
            ' held at its bound'
      end do
   end subroutine name_variables_at_bounds

   !> Adds the cost of an earlier search, from whose end this fit started, and takes over its
   !> comparison of derivatives.
   subroutine add_earlier(self, before)
      class(fit_t), intent(inout) :: self
      type(fit_t), intent(in) :: before

      self%iterations = self%iterations + before%iterations
      self%evaluations = self%evaluations + before%evaluations
      self%shortened = self%shortened + before%shortened
      if (allocated(before%derivative_check)) self%derivative_check = before%derivative_check
   end subroutine add_earlier

end module beamid_least_squares
