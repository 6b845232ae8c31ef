!> Nonlinear least squares by MINPACK behind one interface: `lmdif`, the stand-in for IMSL's ZXSSQ, or
!> `lmder` for problems that know their derivatives.
!>
!> MINPACK calls back a procedure without a place for data of ours: `active`, private to this module
!> and to each thread, points to the problem in hand while MINPACK runs.
module beamid_least_squares
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: problem_t, monitor_t, fit_t, options_t, fit

   !> A sum of squares to be minimised.
   type, abstract :: problem_t
   contains
      procedure(residuals), deferred :: residuals
      procedure :: has_jacobian
      procedure :: jacobian
   end type problem_t

   !> Is told of every iteration.
   type, abstract :: monitor_t
   contains
      procedure(iteration), deferred :: iteration
   end type monitor_t

   type :: options_t
      real(wp) :: noise = 0                !< relative error of the residuals' model (integrator tolerance)
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
      integer :: shortened = 0                !< trial steps at which the model could not be computed
      real(wp), allocatable :: jacobian(:, :) !< (m, n) d residual/d parameter at the estimate
      !> Largest relative difference between exact derivatives and central differences, column by
      !> column, at the start and at the estimate; negative where the problem has no exact ones.
      real(wp) :: derivative_check(2) = -1
      character(len=:), allocatable :: reason !< why the search stopped, in words
   end type fit_t

   abstract interface
      !> parameters  (n) physical values
      !> r           (m)
      !> error       the model cannot be computed there
      subroutine residuals(self, parameters, r, error)
         import :: error_t, problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in) :: parameters(:)
         real(wp), intent(out) :: r(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine residuals
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
      subroutine residual_callback(m, n, x, fvec, iflag)
         import :: wp
         integer, intent(in) :: m, n
         real(wp), intent(in) :: x(n)
         real(wp), intent(inout) :: fvec(m)
         integer, intent(inout) :: iflag
      end subroutine residual_callback
      subroutine jacobian_callback(m, n, x, fvec, fjac, ldfjac, iflag)
         import :: wp
         integer, intent(in) :: m, n, ldfjac
         real(wp), intent(in) :: x(n)
         real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
         integer, intent(inout) :: iflag
      end subroutine jacobian_callback
   end interface

   interface
      subroutine lmdif(fcn, m, n, x, fvec, ftol, xtol, gtol, maxfev, epsfcn, diag, mode, factor, &
         nprint, info, nfev, fjac, ldfjac, ipvt, qtf, wa1, wa2, wa3, wa4)
         import :: wp, residual_callback
         procedure(residual_callback) :: fcn
         integer, intent(in) :: m, n, maxfev, mode, nprint, ldfjac
         real(wp), intent(inout) :: x(n), diag(n)
         real(wp), intent(in) :: ftol, xtol, gtol, epsfcn, factor
         integer, intent(out) :: info, nfev, ipvt(n)
         real(wp), intent(out) :: fvec(m), fjac(ldfjac, n), qtf(n), wa1(n), wa2(n), wa3(n), wa4(m)
      end subroutine lmdif
      subroutine lmder(fcn, m, n, x, fvec, fjac, ldfjac, ftol, xtol, gtol, maxfev, diag, mode, factor, &
         nprint, info, nfev, njev, ipvt, qtf, wa1, wa2, wa3, wa4)
         import :: wp, jacobian_callback
         procedure(jacobian_callback) :: fcn
         integer, intent(in) :: m, n, maxfev, mode, nprint, ldfjac
         real(wp), intent(inout) :: x(n), diag(n)
         real(wp), intent(in) :: ftol, xtol, gtol, factor
         integer, intent(out) :: info, nfev, njev, ipvt(n)
         real(wp), intent(out) :: fvec(m), fjac(ldfjac, n), qtf(n), wa1(n), wa2(n), wa3(n), wa4(m)
      end subroutine lmder
   end interface

   !> What the callback needs to know.
   type :: search_t
      class(problem_t), pointer :: problem => null()
      class(monitor_t), pointer :: monitor => null()
      character(len=:), allocatable :: label
      character(len=16), allocatable :: names(:)
      type(variable_t), allocatable :: variables(:)
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
      real(wp) :: z(size(variables)), epsfcn
      integer :: info

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
      allocate (result%residual(m))
      z = 1
      result%start = variables%value(z)
      if (problem%has_jacobian()) call check_derivatives(problem, m, result%start, variables%magnitude(), &
         result%derivative_check(1), error)
      if (allocated(error)) return

      ! The difference step, sqrt(epsfcn) |z|, must stand well above the noise of the model: a step
      ! that drowns in integration error leaves the parameters where they are, with a success code.
      epsfcn = max(options%noise, epsilon(epsfcn))
      if (options%noise > 0) epsfcn = max(epsfcn, 1e-8_wp)
      active => search
      call minimise(problem%has_jacobian(), options, epsfcn, z, result%residual, info)
      active => null()

      result%estimate = variables%value(z)
      result%J = sum(result%residual**2)
      result%iterations = search%iterations
      result%evaluations = search%evaluations
      result%shortened = search%shortened
      result%reason = reason_in_words(info)
      if (allocated(search%error)) then
         call move_alloc(search%error, error)
      else if (info == 0 .or. info == 5) then
         call failure(error, 'least squares: no convergence; '//result%reason)
      else
         call final_jacobian(problem, variables, epsfcn, result, error)
      end if
   end subroutine fit

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
      associate (m => size(r), n => size(z), tolerance => options%tolerance)
         if (exact) then
            call lmder(evaluate_both, m, n, z, r, fjac, m, 1e-14_wp, tolerance, gtol, &
               options%max_evaluations, diag, 1, factor, 1, info, nfev, njev, ipvt, qtf, wa1, wa2, wa3, wa4)
         else
            call lmdif(evaluate, m, n, z, r, tolerance, tolerance, gtol, options%max_evaluations, epsfcn, &
               diag, 1, factor, 1, info, nfev, fjac, m, ipvt, qtf, wa1, wa2, wa3, wa4)
         end if
      end associate
   end subroutine minimise

   !> The Jacobian at the estimate: exact, and compared with central differences, or these alone.
   subroutine final_jacobian(problem, variables, epsfcn, result, error)
      class(problem_t), intent(inout) :: problem
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: epsfcn
      type(fit_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: r(:)

      allocate (result%jacobian(size(result%residual), size(result%estimate)), r(size(result%residual)))
      if (problem%has_jacobian()) then
         call problem%jacobian(result%estimate, r, result%jacobian, error)
         if (.not. allocated(error)) call check_derivatives(problem, size(r), result%estimate, &
            variables%magnitude(), result%derivative_check(2), error)
      else
         call central_differences(problem, result%estimate, &
            epsfcn**(1/3.0_wp)*max(abs(result%estimate), 1e-3_wp*variables%magnitude()), result%jacobian, error)
      end if
   end subroutine final_jacobian

   !> Largest relative difference, over the columns, between the exact Jacobian and central differences.
   subroutine check_derivatives(problem, m, parameters, magnitude, worst, error)
      class(problem_t), intent(inout) :: problem
      integer, intent(in) :: m
      real(wp), intent(in) :: parameters(:), magnitude(:)
      real(wp), intent(out) :: worst
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: exact(:, :), differences(:, :), r(:)
      real(wp) :: size_of_column
      integer :: k

      worst = -1
      allocate (exact(m, size(parameters)), differences(m, size(parameters)), r(m))
      call problem%jacobian(parameters, r, exact, error)
      if (allocated(error)) return
      call central_differences(problem, parameters, &
         epsilon(1.0_wp)**(1/3.0_wp)*max(abs(parameters), 1e-3_wp*magnitude), differences, error)
      if (allocated(error)) return
      do k = 1, size(parameters)
         size_of_column = max(norm2(exact(:, k)), norm2(differences(:, k)))
         if (size_of_column > 0) worst = max(worst, norm2(exact(:, k) - differences(:, k))/size_of_column)
      end do
   end subroutine check_derivatives

   !> d residual/d parameter by central differences.
   !>
   !> step  (n) > 0
   subroutine central_differences(problem, parameters, step, jacobian, error)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: parameters(:), step(:)
      real(wp), intent(out) :: jacobian(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: p(size(parameters)), ahead(size(jacobian, 1)), behind(size(jacobian, 1))
      integer :: k

      do k = 1, size(parameters)
         p = parameters
         p(k) = parameters(k) + step(k)
         call problem%residuals(p, ahead, error)
         if (allocated(error)) return
         p(k) = parameters(k) - step(k)
         call problem%residuals(p, behind, error)
         if (allocated(error)) return
         jacobian(:, k) = (ahead - behind)/(2*step(k))
      end do
   end subroutine central_differences

   !> By default a problem has no derivatives of its own.
   pure logical function has_jacobian(self)
      class(problem_t), intent(in) :: self

      has_jacobian = .not. same_type_as(self, self)
   end function has_jacobian

   !> Residuals and their derivatives.
   !>
   !> r    (m)
   !> jac  (m, n) d r/d parameter, physical parameters
   subroutine jacobian(self, parameters, r, jac, error)
      class(problem_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%residuals(parameters, r, error)
      jac = 0
      if (.not. allocated(error)) call failure(error, 'this problem has no exact derivatives')
   end subroutine jacobian

   !> The callback of `lmder`: residuals through `evaluate`, derivatives for iflag = 2.
   subroutine evaluate_both(m, n, x, fvec, fjac, ldfjac, iflag)
      integer, intent(in) :: m, n, ldfjac
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
      integer, intent(inout) :: iflag
      type(error_t), allocatable :: error
      real(wp) :: r(m)

      if (iflag /= 2) then
         call evaluate(m, n, x, fvec, iflag)
         return
      end if
      active%evaluations = active%evaluations + 1
      call active%problem%jacobian(active%variables%value(x), r, fjac(:m, :), error)
      if (.not. allocated(error) .and. .not. all(ieee_is_finite(fjac(:m, :)))) &
         call failure(error, 'the derivatives are not finite')
      if (allocated(error)) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      fjac(:m, :) = fjac(:m, :)*spread(active%variables%derivative(x), 1, m)
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
         call report(active, x, fvec)
         return
      end if
      active%evaluations = active%evaluations + 1
      call active%problem%residuals(active%variables%value(x), fvec, error)
      if (.not. allocated(error) .and. .not. all(ieee_is_finite(fvec))) &
         call failure(error, 'the residuals are not finite')
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

   !> Passes an iteration on to the monitor.
   subroutine report(search, z, r)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: z(:), r(:)

      if (associated(search%monitor)) call search%monitor%iteration(search%label, &
         search%iterations, search%evaluations, sum(r**2), search%names, search%variables%value(z))
      search%iterations = search%iterations + 1
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
