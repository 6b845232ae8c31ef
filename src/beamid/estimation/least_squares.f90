!> Nonlinear least squares by MINPACK behind one interface: `lmdif`, the stand-in for IMSL's ZXSSQ,
!> or `lmder` for problems that know their derivatives.
!>
!> MINPACK calls back a procedure without a place for data of ours: `active`, private to this module
!> and to each thread, points to the problem in hand while MINPACK runs.
module beamid_least_squares
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_minpack, only: dgels, lmder, lmdif
   use beamid_problems, only: compare_derivatives, derivatives, problem_t
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: monitor_t, fit_t, options_t, fit

   !> Is told of every iteration.
   type, abstract :: monitor_t
   contains
      procedure(iteration), deferred :: iteration
   end type monitor_t

   type :: options_t
      !> relative error of the residuals' model (integrator tolerance)
      real(wp) :: noise = 0
      real(wp) :: tolerance = 1e-10_wp     !< relative, on J and on the parameters
      integer :: max_evaluations = 2000
   end type options_t

   type :: fit_t
      real(wp), allocatable :: estimate(:)    !< (n) physical parameters
      real(wp), allocatable :: start(:)       !< (n) where the search began
      real(wp), allocatable :: residual(:)    !< (m) at the estimate
      real(wp) :: J = 0                       !< sum of squares of the residuals
      integer :: iterations = 0
      integer :: evaluations = 0              !< of the residuals, those for differences included
      !> trial steps at which the model could not be computed
      integer :: shortened = 0
      real(wp), allocatable :: jacobian(:, :) !< (m, n) d residual/d parameter at the estimate
      !> Largest relative difference between exact derivatives and central differences, column by
      !> column, at the start and at the estimate; negative where the problem has no exact ones.
      real(wp) :: derivative_check(2) = -1
      character(len=:), allocatable :: reason !< why the search stopped, in words
   end type fit_t

   abstract interface
      !> May be called by several threads at once.
      !>
      !> label       which search it is
      !> J           sum of squares so far
      !> names, parameters  (n) physical values
      subroutine iteration(self, label, number, evaluations, J, names, parameters)
         import :: monitor_t, wp
         class(monitor_t), intent(inout) :: self
         character(len=*), intent(in) :: label, names(:)
         integer, intent(in) :: number, evaluations
         real(wp), intent(in) :: J, parameters(:)
      end subroutine iteration
   end interface

   !> What the callback needs to know.
   type :: search_t
      class(problem_t), pointer :: problem => null()
      class(monitor_t), pointer :: monitor => null()
      character(len=:), allocatable :: label
      character(len=16), allocatable :: names(:)
      type(variable_t), allocatable :: variables(:)
      real(wp), allocatable :: parameters(:)   !< (n) values of those that do not move
      integer, allocatable :: moving(:)        !< which variables MINPACK moves
      logical, allocatable :: held(:)          !< (n) may not be held at a bound a second time
      !> a moving variable that has come to a bound, 0: none
      integer :: near_bound = 0
      integer :: lingering = 0                 !< iterations in a row that it has spent there
      real(wp) :: first_norm = -1       !< of the residuals at the start
      integer :: iterations = 0, evaluations = 0, shortened = 0, failures_in_a_row = 0
      type(error_t), allocatable :: error
   end type search_t

   type(search_t), pointer :: active => null()
   !$omp threadprivate(active)

   !> So many failing trial steps in a row, each a tenth of the one before, end a search.
   integer, parameter :: max_failures = 10

contains

   !> Minimises the sum of squares.
   !>
   !> problem    what is to be fitted
   !> m          number of residuals, >= number of variables
   !> variables  (n) starts, bounds, scales
   !> options    accuracy of the model and of the fit
   !> result     estimates, J, counts, reason
   !> error      the model fails at the start, or wherever the search turns; no convergence
   !> monitor    told of every iteration
   !> label      what the monitor calls this search
   !> names      (n) of the variables, for the monitor
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
      real(wp) :: noise
      integer :: info, k

      if (m < size(variables)) then
         call failure(error, 'least squares: '//to_text(m)//' residuals for '// &
            to_text(size(variables))//' parameters')
         return
      end if
      search%problem => problem
      if (present(monitor)) search%monitor => monitor
      search%label = ''
      if (present(label)) search%label = label
      allocate (search%names(size(variables)))
      search%names = ''
      if (present(names)) search%names = names
      search%variables = variables
      search%parameters = variables%start
      search%moving = [(k, k=1, size(variables))]
      allocate (search%held(size(variables)), source=.false.)
      allocate (result%residual(m), result%jacobian(m, size(variables)))
      result%start = variables%start
      if (problem%has_jacobian()) call compare_derivatives(problem, result%start, variables, m, &
         result%derivative_check(1))

      ! The difference step, sqrt(noise) |z|, must stand well above the noise of the model: a step
      ! that drowns in integration error leaves the parameters where they are, with a success code.
      noise = max(options%noise, epsilon(noise))
      if (options%noise > 0) noise = max(noise, 1e-8_wp)
      call minimise_with_bounds(search, options, noise, result, info, error)
      if (allocated(error)) return
      result%J = sum(result%residual**2)
      result%iterations = search%iterations
      result%evaluations = search%evaluations
      result%shortened = search%shortened
      result%reason = reason_in_words(info)
      do k = 1, size(variables)
         if (.not. any(search%moving == k)) result%reason = result%reason//'; '// &
            trim(search%names(k))//' held at its bound'
      end do
      if (info == 0 .or. info == 5) then
         call failure(error, 'least squares: no convergence; '//result%reason)
      else if (problem%has_jacobian()) then
         call compare_derivatives(problem, result%estimate, variables, m, &
            result%derivative_check(2))
      end if
   end subroutine fit

   !> Minimises; where the minimum lies on a bound the change of variable has no slope there and the
   !> search would creep. A variable that lingers at a bound is held on it while the others move,
   !> and let go, once, if J falls towards the inside.
   subroutine minimise_with_bounds(search, options, noise, result, info, error)
      type(search_t), intent(inout), target :: search
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: noise
      type(fit_t), intent(inout) :: result
      integer, intent(out) :: info
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: z(:)
      integer :: k

      do
         search%variables(search%moving) = search%variables(search%moving)%from( &
            search%parameters(search%moving))
         allocate (z(size(search%moving)), source=1.0_wp)
         search%near_bound = 0
         search%lingering = 0
         active => search
         call minimise(search%problem%has_jacobian(), options, noise, z, result%residual, info)
         active => null()
         if (allocated(search%error)) then
            call move_alloc(search%error, error)
            return
         end if
         search%parameters(search%moving) = search%variables(search%moving)%value(z)
         deallocate (z)
         if (info < 0) then
            ! Stopped by `report`: hold the variable at its bound and go on with the others.
            k = search%near_bound
            search%held(k) = .true.
            search%parameters(k) = search%variables(k)%nearest_bound(search%parameters(k))
            search%moving = pack(search%moving, search%moving /= k)
            if (size(search%moving) > 0) cycle
            call search%problem%residuals(search%parameters, result%residual, error)
            if (allocated(error)) return
            info = 4
         end if
         result%estimate = search%parameters
         call derivatives(search%problem, search%parameters, search%variables, noise, &
            result%jacobian, error)
         if (allocated(error)) return
         k = inward(search, result)
         if (k == 0) exit
         search%moving = [search%moving, k]
      end do
      if (.not. search%problem%has_jacobian()) call polish(search, result)
   end subroutine minimise_with_bounds

   !> One Gauss-Newton step with the central differences of the final Jacobian: the one-sided ones of
   !> `lmdif` stop a little beside the minimum when the residuals are not zero. Taken only when it is
   !> short and J does not rise by more than the noise.
   subroutine polish(search, result)
      type(search_t), intent(inout) :: search
      type(fit_t), intent(inout) :: result
      real(wp) :: p(size(search%variables)), r(size(result%residual))
      real(wp), allocatable :: a(:, :), step(:, :), work(:)
      type(error_t), allocatable :: error
      integer :: m, n, info

      m = size(r)
      n = size(search%moving)
      if (n == 0) return
      a = result%jacobian(:, search%moving)
      step = reshape(-result%residual, [m, 1])
      allocate (work(64*(m + n)))
      call dgels('N', m, n, 1, a, m, step, m, work, size(work), info)
      if (info /= 0 .or. .not. all(ieee_is_finite(step(:n, 1)))) return
      p = search%parameters
      p(search%moving) = p(search%moving) + step(:n, 1)
      if (any(abs(p - search%parameters) > 1e-2_wp*abs(search%parameters)) .or. &
         any(p < search%variables%lower) .or. any(p > search%variables%upper)) return
      call search%problem%residuals(p, r, error)
      search%evaluations = search%evaluations + 1
      if (allocated(error)) return
      if (sum(r**2) > sum(result%residual**2)*(1 + 1e-6_wp)) return
      result%estimate = p
      result%residual = r
   end subroutine polish

   !> A variable held at a bound from which J falls towards the inside; 0 when there is none.
   pure integer function inward(search, result) result(k)
      type(search_t), intent(in) :: search
      type(fit_t), intent(in) :: result
      real(wp) :: slope

      do k = 1, size(search%variables)
         if (any(search%moving == k)) cycle
         slope = dot_product(result%jacobian(:, k), result%residual)
         if (search%parameters(k) >= search%variables(k)%upper) slope = -slope
         if (slope < 0) return
      end do
      k = 0
   end function inward

   !> Calls MINPACK for the active search.
   !>
   !> exact  whether the problem has derivatives of its own
   !> z      (n) start, then solution
   !> r      (m) residuals at the solution
   subroutine minimise(exact, options, epsfcn, z, r, info)
      logical, intent(in) :: exact
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: epsfcn
      real(wp), intent(inout) :: z(:)
      real(wp), intent(inout) :: r(:)
      integer, intent(out) :: info
      real(wp), dimension(size(z)) :: diag, qtf, wa1, wa2, wa3
      real(wp), allocatable :: fjac(:, :), wa4(:)
      integer :: nfev, njev, ipvt(size(z))
      real(wp), parameter :: factor = 100, gtol = 0

      allocate (fjac(size(r), size(z)), wa4(size(r)))
      ! J of an exact model may settle to the last digit; that of an integrator cannot.
      associate (m => size(r), n => size(z), tolerance => options%tolerance, &
         ftol => merge(options%tolerance, 1e-14_wp, options%noise > 0))
         if (exact) then
            call lmder(evaluate_both, m, n, z, r, fjac, m, ftol, tolerance, gtol, &
               options%max_evaluations, diag, 1, factor, 1, info, nfev, njev, ipvt, qtf, wa1, wa2, &
                  wa3, wa4)
         else
            call lmdif(evaluate, m, n, z, r, ftol, tolerance, gtol, options%max_evaluations, &
               epsfcn, &
               diag, 1, factor, 1, info, nfev, fjac, m, ipvt, qtf, wa1, wa2, wa3, wa4)
         end if
      end associate
   end subroutine minimise

   !> The callback of `lmder`: residuals through `evaluate`, derivatives for iflag = 2.
   subroutine evaluate_both(m, n, x, fvec, fjac, ldfjac, iflag)
      integer, intent(in) :: m, n, ldfjac
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
      integer, intent(inout) :: iflag
      type(error_t), allocatable :: error
      real(wp) :: r(m), full(m, size(active%variables))

      if (iflag /= 2) then
         call evaluate(m, n, x, fvec, iflag)
         return
      end if
      active%evaluations = active%evaluations + 1
      call active%problem%jacobian(trial(active, x), r, full, error)
      if (.not. allocated(error) .and. .not. all(ieee_is_finite(full))) &
         call failure(error, 'the derivatives are not finite')
      if (allocated(error)) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      fjac(:m, :) = full(:, active%moving)*spread(active%variables(active%moving)%derivative(x), &
         1, m)
   end subroutine evaluate_both

   !> The callback of MINPACK. iflag = 0: a new iteration; 2: a difference for the Jacobian; 1: the
   !> start or a trial step. A trial step at which the model fails is made to look a hundred times
   !> worse than the start, whereupon Levenberg-Marquardt takes a tenth of it.
   subroutine evaluate(m, n, x, fvec, iflag)
      integer, intent(in) :: m, n
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: fvec(m)
      integer, intent(inout) :: iflag
      type(error_t), allocatable :: error

      if (iflag == 0) then
         call report(active, x, fvec, iflag)
         return
      end if
      active%evaluations = active%evaluations + 1
      call active%problem%residuals(trial(active, x), fvec, error)
      if (.not. allocated(error)) then
         if (.not. ieee_is_finite(sum(fvec**2))) &
            call failure(error, 'the sum of squared residuals is not finite')
      end if
      if (.not. allocated(error)) then
         if (active%first_norm < 0) active%first_norm = norm2(fvec)
         active%failures_in_a_row = 0
         return
      end if

      active%failures_in_a_row = active%failures_in_a_row + 1
      if (iflag == 2 .or. active%first_norm < 0 .or. active%failures_in_a_row > max_failures) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      active%shortened = active%shortened + 1
      fvec = 100*(active%first_norm + tiny(1.0_wp))/sqrt(real(m, wp))
   end subroutine evaluate

   !> The physical parameters at x of MINPACK.
   function trial(search, x) result(parameters)
      type(search_t), intent(in) :: search
      real(wp), intent(in) :: x(:)
      real(wp) :: parameters(size(search%variables))

      parameters = search%parameters
      parameters(search%moving) = search%variables(search%moving)%value(x)
   end function trial

   !> Passes an iteration on to the monitor, and stops MINPACK (iflag < 0) when a variable has spent
   !> some iterations at a bound.
   subroutine report(search, x, r, iflag)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: x(:), r(:)
      integer, intent(inout) :: iflag
      integer, parameter :: patience = 3
      real(wp) :: parameters(size(search%variables))
      integer :: k, near

      parameters = trial(search, x)
      if (associated(search%monitor)) call search%monitor%iteration(search%label, &
         search%iterations, search%evaluations, sum(r**2), search%names, parameters)
      search%iterations = search%iterations + 1
      near = 0
      do k = 1, size(search%variables)
         if (search%held(k) .or. .not. any(search%moving == k)) cycle
         if (search%variables(k)%is_at_bound(parameters(k))) near = k
      end do
      search%lingering = merge(search%lingering + 1, 0, near > 0 .and. &
         (near == search%near_bound .or. search%lingering == 0))
      search%near_bound = near
      if (search%lingering >= patience) iflag = -1
   end subroutine report

   !> MINPACK's info.
   pure function reason_in_words(info) result(reason)
      integer, intent(in) :: info
      character(len=:), allocatable :: reason

      select case (info)
      case (1); reason = 'J falls no further'
      case (2); reason = 'the parameters change no further'
      case (3); reason = 'neither J nor the parameters change further'
      case (4); reason = 'the residuals are orthogonal to every derivative'
      case (5); reason = 'the evaluations allowed are used up'
      case (6); reason = 'J cannot be made smaller in this precision'
      case (7); reason = 'the parameters cannot be improved in this precision'
      case (8); reason = 'the derivatives vanish to machine precision'
      case default; reason = 'the search could not start'
      end select
   end function reason_in_words

end module beamid_least_squares
