!> Nonlinear least squares by MINPACK (`lmdif`, the stand-in for IMSL's ZXSSQ) behind one interface.
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
      real(wp) :: z(size(variables)), diag(size(variables)), qtf(size(variables)), epsfcn
      real(wp), dimension(size(variables)) :: wa1, wa2, wa3
      real(wp), allocatable :: fjac(:, :), wa4(:)
      integer :: info, nfev, ipvt(size(variables))

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
      allocate (result%residual(m), fjac(m, size(variables)), wa4(m))
      z = 1
      result%start = variables%value(z)

      ! The difference step, sqrt(epsfcn) |z|, must stand well above the noise of the model: a step
      ! that drowns in integration error leaves the parameters where they are, with a success code.
      epsfcn = max(options%noise, epsilon(epsfcn))
      if (options%noise > 0) epsfcn = max(epsfcn, 1e-8_wp)
      active => search
      call lmdif(evaluate, m, size(z), z, result%residual, options%tolerance, options%tolerance, 0.0_wp, &
         options%max_evaluations, epsfcn, diag, 1, 100.0_wp, 1, info, nfev, fjac, m, ipvt, qtf, &
         wa1, wa2, wa3, wa4)
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
      end if
   end subroutine fit

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
