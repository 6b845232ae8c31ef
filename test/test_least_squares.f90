!> Least-squares problems with certified answers, and problems that fail in every way they can.
module problems
   use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
   use beamid, only: monitor_t, problem_t, smooth_problem_t
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use regressions, only: boxbod, regression_t
   implicit none
   private

   public :: mistaken, mistaken_t, rosenbrock_t, edge_t, faint_t, valley_t, line_t, history_t, &
      diary_t

   !> A regression with a mistake in its derivatives.
   type, extends(regression_t) :: mistaken_t
      integer :: mistake = 0
   contains
      procedure :: jacobian => mistaken_jacobian
   end type mistaken_t

   !> A regression with a list of the points where it was evaluated.
   type, extends(regression_t) :: diary_t
      real(wp) :: point(4, 1000) = 0
      integer :: points = 0, repeated = 0
   contains
      procedure :: jacobian => diary_jacobian
   end type diary_t

   !> 10 (b - a^2), 1 - a; b outside [least, largest] cannot be computed, in one of three ways.
   type, extends(problem_t) :: rosenbrock_t
      real(wp) :: least = -huge(1.0_wp), largest = huge(1.0_wp)
      integer :: how = 1            !< 1: an error; 2: NaN; 3: infinite
      integer :: refusals = 0
   contains
      procedure :: residuals => rosenbrock_residuals
   end type rosenbrock_t

   !> The same with its derivatives, where it can be computed.
   type, extends(smooth_problem_t) :: edge_t
      type(rosenbrock_t) :: valley
   contains
      procedure :: residuals => edge_residuals
      procedure :: jacobian => edge_jacobian
   end type edge_t

   !> A narrow bent valley, a parabola, with residuals of 10 at its lowest point (3, 9), where J is
   !> 100: along it J'J is 0.01 there, half the second derivative of J 20.
   type, extends(smooth_problem_t) :: valley_t
   contains
      procedure :: residuals => valley_residuals
      procedure :: jacobian => valley_jacobian
   end type valley_t

   !> Of the second parameter less than the round-off of what the first does; its derivatives.
   type, extends(smooth_problem_t) :: faint_t
      real(wp) :: told = 1e-30_wp
   contains
      procedure :: residuals => faint_residuals
      procedure :: jacobian => faint_jacobian
   end type faint_t

   !> parameters - target, one residual each: the minimum is the target, or the nearest bound.
   type, extends(problem_t) :: line_t
      real(wp), allocatable :: target(:)
   contains
      procedure :: residuals => line_residuals
   end type line_t

   !> Writes down what a search reports.
   type, extends(monitor_t) :: history_t
      integer :: count = 0
      logical :: numbered = .true., named = .true.
      real(wp) :: J(1000) = 0
      real(wp), allocatable :: last(:)
   contains
      procedure :: iteration
   end type history_t

contains

   !> BoxBOD with a mistake.
   function mistaken(mistake) result(problem)
      integer, intent(in) :: mistake
      type(mistaken_t) :: problem

      problem%regression_t = boxbod(.true.)
      problem%mistake = mistake
   end function mistaken

   !> mistake  1: the sign of a column; 2: of all; 3: a column times x; 4: none of it; 5: divided
   !>          by x; 6: twice as large
   subroutine mistaken_jacobian(self, parameters, r, jac, error)
      class(mistaken_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%regression_t%jacobian(parameters, r, jac, error)
      select case (self%mistake)
      case (1); jac(:, 2) = -jac(:, 2)
      case (2); jac = -jac
      case (3); jac(:, 2) = jac(:, 2)*self%x
      case (4); jac(:, 2) = 0
      case (5); jac(:, 2) = jac(:, 2)/self%x
      case (6); jac(:, 2) = 2*jac(:, 2)
      end select
   end subroutine mistaken_jacobian

   subroutine diary_jacobian(self, parameters, r, jac, error)
      class(diary_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call self%regression_t%jacobian(parameters, r, jac, error)
      associate (n => size(parameters))
         do k = 1, self%points
            if (all(abs(self%point(:n, k) - parameters) <= 0)) self%repeated = self%repeated + 1
         end do
         self%points = self%points + 1
         self%point(:n, self%points) = parameters
      end associate
   end subroutine diary_jacobian

   subroutine rosenbrock_residuals(self, parameters, r, error)
      class(rosenbrock_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      r = [10*(parameters(2) - parameters(1)**2), 1 - parameters(1)]
      if (parameters(2) >= self%least .and. parameters(2) <= self%largest) return
      self%refusals = self%refusals + 1
      select case (self%how)
      case (1); call failure(error, 'no model outside the limits')
      case (2); r(2) = ieee_value(1.0_wp, ieee_quiet_nan)
      case (3); r(1) = ieee_value(1.0_wp, ieee_positive_inf)
      end select
   end subroutine rosenbrock_residuals

   subroutine edge_residuals(self, parameters, r, error)
      class(edge_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      call self%valley%residuals(parameters, r, error)
   end subroutine edge_residuals

   subroutine edge_jacobian(self, parameters, r, jac, error)
      class(edge_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%residuals(parameters, r, error)
      jac = reshape([-20*parameters(1), -1.0_wp, 10.0_wp, 0.0_wp], [2, 2])
   end subroutine edge_jacobian

   subroutine valley_residuals(self, parameters, r, error)
      class(valley_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call self%jacobian(parameters, r, jac, error)
   end subroutine valley_residuals

   subroutine valley_jacobian(self, parameters, r, jac, error)
      class(valley_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: off

      off = parameters(1) - 3
      r = [1e4_wp*(parameters(2) - parameters(1)**2), 10 + off**2, 0.1_wp*off]
      jac(1, :) = 1e4_wp*[-2*parameters(1), 1.0_wp]
      jac(2, :) = [2*off, 0.0_wp]
      jac(3, :) = [0.1_wp, 0.0_wp]
      if (.not. self%exact) call failure(error, 'the valley: derivatives are exact')
   end subroutine valley_jacobian

   subroutine line_residuals(self, parameters, r, error)
      class(line_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      r = parameters - self%target
      if (size(r) == 0) call failure(error, 'no residuals')
   end subroutine line_residuals

   subroutine iteration(self, label, number, evaluations, J, names, parameters)
      class(history_t), intent(inout) :: self
      character(len=*), intent(in) :: label, names(:)
      integer, intent(in) :: number, evaluations
      real(wp), intent(in) :: J, parameters(:)

      self%numbered = self%numbered .and. number == self%count .and. evaluations > 0
      self%named = self%named .and. label == 'a label' .and. all(names == ['a', 'b'])
      self%count = self%count + 1
      self%J(self%count) = J
      self%last = parameters
   end subroutine iteration

   subroutine faint_residuals(self, parameters, r, error)
      class(faint_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      r = [((parameters(1) + 1e-30_wp*parameters(2) - 1)*k, k=1, size(r))]
   end subroutine faint_residuals

   subroutine faint_jacobian(self, parameters, r, jac, error)
      class(faint_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      call self%residuals(parameters, r, error)
      jac(:, 1) = [(real(k, wp), k=1, size(r))]
      jac(:, 2) = self%told*jac(:, 1)
   end subroutine faint_jacobian

end module problems

program test_least_squares
   use beamid, only: fit, fit_t, options_t
   use beamid_errors, only: error_t, status_failed
   use beamid_gauss_newton, only: gauss_newton_step, gauss_newton_t
   use beamid_kinds, only: wp
   use beamid_problems, only: compare_derivatives
   use beamid_strings, only: to_text
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use problems, only: edge_t, faint_t, history_t, line_t, mistaken, mistaken_t, rosenbrock_t, &
      diary_t, valley_t
   use regressions, only: boxbod, mgh09, misra1a, regression_t
   implicit none

   call test_nist()
   call test_box_trap()
   call test_mistakes()
   call test_faint()
   call test_no_repetition()
   call test_no_differences()
   call test_edge()
   call test_valley()
   call test_monitor()
   call test_forbidden()
   call test_never()
   call test_bounds()
   call test_limits()
   call test_outlook()
   call finish('least_squares')

contains

   !> Variables from starts without bounds, or with every parameter positive.
   function variables(starts, positive) result(v)
      real(wp), intent(in) :: starts(:)
      logical, intent(in) :: positive
      type(variable_t) :: v(size(starts))
      integer :: k

      v = [(new_variable(starts(k), merge(0.0_wp, -unbounded, positive), unbounded, &
         max(abs(starts(k)), 0.1_wp)), k=1, size(starts))]
   end function variables

   !> With options%tolerance = 1e-10, the default, J may end that much above its minimum,
   !> relatively: the parameters are then off by sqrt((m - n) 1e-10) standard deviations or less,
   !> 3e-5 for MGH09, whose standard deviations are as large as its parameters; 2e-6 and less for
   !> the others, of which they are 1 and 20 per cent. With 1e-14 it is six digits for all.
   subroutine test_nist()
      real(wp), parameter :: default = 1e-10_wp, tight = 1e-14_wp
      integer :: k

      do k = 0, 1
         associate (positive => k == 1)
            call nist(misra1a(.false.), [500.0_wp, 1e-4_wp], positive, default, 1e-6_wp)
            call nist(misra1a(.false.), [250.0_wp, 5e-4_wp], positive, default, 1e-6_wp)
            call nist(misra1a(.false.), [500.0_wp, 1e-4_wp], positive, tight, 1e-7_wp)
            call nist(mgh09(.false.), [0.25_wp, 0.39_wp, 0.415_wp, 0.39_wp], positive, default, &
               3e-5_wp)
            call nist(mgh09(.false.), [0.25_wp, 0.39_wp, 0.415_wp, 0.39_wp], positive, tight, &
               1e-6_wp)
            call nist(boxbod(.false.), [100.0_wp, 0.75_wp], positive, default, 5e-6_wp)
            call nist(boxbod(.false.), [100.0_wp, 0.75_wp], positive, tight, 1e-6_wp)
         end associate
      end do
      call nist(mgh09(.false.), [25.0_wp, 39.0_wp, 41.5_wp, 39.0_wp], .false., default, 3e-5_wp)
      call nist(mgh09(.false.), [25.0_wp, 39.0_wp, 41.5_wp, 39.0_wp], .false., tight, 1e-6_wp)
   end subroutine test_nist

   !> Parameters to `allowed`, relative; J, stationary at the minimum, is certified to 11 digits and
   !> must be right to 1e-10 of the fit's tolerance twice over.
   subroutine nist(regression, starts, positive, tolerance, allowed)
      type(regression_t), intent(in) :: regression
      real(wp), intent(in) :: starts(:), tolerance, allowed
      logical, intent(in) :: positive
      type(regression_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      character(len=:), allocatable :: title
      integer :: k

      problem = regression
      title = trim(problem%name)//' from '//to_text(starts(1))
      if (positive) title = title//', positive'
      title = title//', tolerance '//to_text(tolerance)//': '
      call fit(problem, size(problem%y), variables(starts, positive), &
         options_t(tolerance=tolerance), result, error)
      if (allocated(error)) then
         call check(title//'converges', .false., error%message)
         return
      end if
      do k = 1, size(problem%b)
         call check_close(title//'b'//to_text(k), result%estimate(k)/problem%b(k), 1.0_wp, allowed)
      end do
      call check_close(title//'J', result%J/problem%J, 1.0_wp, 2e-10_wp)
      ! A fit reports the residuals of its estimate, and nothing else.
      call check_close(title//'J is the sum of squares', result%J, sum(result%residual**2), &
         1e-12_wp*problem%J)
      ! z = 1 gives back the start to round-off.
      call check_close(title//'start', maxval(abs(result%start/starts - 1)), 0.0_wp, 1e-12_wp)
      call check(title//'counts', result%iterations > 1 .and. &
         result%evaluations > result%iterations .and. result%shortened == 0 .and. &
         len(result%reason) > 0, result%reason)
   end subroutine nist

   !> BoxBOD from (1, 1) is NIST's trap: MINPACK takes a step to where exp(-b2 x) = 0, no derivative
   !> with respect to b2 is left, and it stops with a success code at the mean of the data, J =
   !> 9771. That b2 has lost its effect is seen, and a search with shorter steps finds the minimum,
   !> to the digits of `test_nist`. With both parameters positive none does, and that is said.
   subroutine test_box_trap()
      type(regression_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      integer :: k

      problem = boxbod(.false.)
      call fit(problem, size(problem%y), variables([1.0_wp, 1.0_wp], .false.), options_t(), &
         result, error)
      call check('BoxBOD from (1, 1): converges', .not. allocated(error))
      if (allocated(error)) return
      do k = 1, 2
         call check_close('BoxBOD from (1, 1): b'//to_text(k), result%estimate(k)/problem%b(k), &
            1.0_wp, 5e-6_wp)
      end do
      call check_close('BoxBOD from (1, 1): J', result%J/problem%J, 1.0_wp, 2e-10_wp)
      call check('BoxBOD from (1, 1): said how', index(result%reason, 'shorter steps') > 0, &
         result%reason)
      call check_close('BoxBOD from (1, 1): the start is the first', &
         maxval(abs(result%start - 1)), 0.0_wp, 1e-12_wp)
      call fit(problem, size(problem%y), variables([1.0_wp, 1.0_wp], .true.), options_t(), result, &
         error)
      call fails('BoxBOD from (1, 1), positive', error, 'had an effect at the start have none')
   end subroutine test_box_trap

   !> A wrong derivative ends as an error that names it; without the comparison a search may see by
   !> itself that J does not fall where it was promised, at a success code of MINPACK's. The right
   !> ones agree with differences to the square of their step, 1e-10, and a factor for the
   !> curvature.
   subroutine test_mistakes()
      type(mistaken_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      integer :: k

      do k = 0, 6
         problem = mistaken(k)
         call fit(problem, size(problem%y), variables([100.0_wp, 0.75_wp], .false.), options_t(), &
            result, error)
         if (k > 0) then
            call fails('wrong derivatives '//to_text(k), error, 'disagrees with differences')
         else
            call check('right derivatives', .not. allocated(error) .and. &
               maxval(abs(result%derivative_check)) < 1e-8_wp, &
               to_text(maxval(abs(result%derivative_check))))
         end if
      end do
      do k = 1, 3
         problem = mistaken(k)
         call fit(problem, size(problem%y), variables([100.0_wp, 0.75_wp], .false.), &
            options_t(check=.false.), result, error)
         call fails('wrong derivatives '//to_text(k)//', not compared', error, &
            'the derivatives predict that J')
      end do
   end subroutine test_mistakes

   !> What differences cannot see at all they do not deny; a derivative that they would have seen
   !> they do.
   subroutine test_faint()
      type(faint_t) :: problem
      type(error_t), allocatable :: error
      real(wp), parameter :: told(2) = [1e-30_wp, 1e-6_wp]
      real(wp) :: r(8), jac(8, 2)
      real(wp), allocatable :: worst
      integer :: found, k

      do k = 1, size(told)
         problem%told = told(k)
         call problem%jacobian([1.5_wp, 1.0_wp], r, jac, error)
         call compare_derivatives(problem, [1.5_wp, 1.0_wp], variables([1.5_wp, 1.0_wp], .true.), &
            jac, worst, found)
         call check('a derivative of '//to_text(told(k)), found == merge(2, 0, k == 2), &
            to_text(found))
      end do
   end subroutine test_faint

   !> By derivatives no point is evaluated twice, also where the search comes back to it from a last
   !> step that it refused, as it does where the tolerance is beyond round-off. Else it does not end
   !> before linear theory sees the minimum within a tenth of sqrt(tolerance) of a standard error.
   subroutine test_no_repetition()
      type(diary_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      type(gauss_newton_t) :: ahead
      real(wp), parameter :: starts(4, 2) = reshape([0.25_wp, 0.39_wp, 0.415_wp, 0.39_wp, 25.0_wp, &
         39.0_wp, 41.5_wp, 39.0_wp], [4, 2])
      character(len=:), allocatable :: title
      integer :: k

      problem = diary_t(regression_t=misra1a(.true.))
      call fit(problem, 14, variables([500.0_wp, 1e-4_wp], .true.), options_t(check=.false., &
         tolerance=1e-30_wp), result, error)
      call check('Misra1a beyond round-off: converges', .not. allocated(error))
      call check('Misra1a beyond round-off: no point twice', problem%repeated == 0 .and. &
         problem%points == result%evaluations, to_text(problem%repeated)//' of '// &
         to_text(problem%points))
      do k = 1, 2
         problem = diary_t(regression_t=mgh09(.true.))
         title = 'MGH09 from '//to_text(starts(1, k))//', exact: '
         call fit(problem, 11, variables(starts(:, k), .false.), options_t(check=.false.), result, &
            error)
         call check(title//'converges', .not. allocated(error))
         if (allocated(error)) cycle
         call check(title//'no point twice', problem%repeated == 0 .and. &
            problem%points == result%evaluations, to_text(problem%repeated)//' of '// &
            to_text(problem%points))
         ahead = gauss_newton_step(result%jacobian, result%residual, result%estimate, &
            variables(starts(:, k), .false.), 1e-14_wp)
         call check(title//'nothing ahead', ahead%distance <= 1e-6_wp, to_text(ahead%distance))
         call check_close(title//'J', result%J/problem%J, 1.0_wp, 2e-10_wp)
      end do
   end subroutine test_no_repetition

   !> At a start on the edge of where the model can be computed there are derivatives and no
   !> differences: the fit goes on, and no comparison is told of.
   subroutine test_no_differences()
      type(edge_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      real(wp), parameter :: edges(2) = [0.0_wp, 0.5_wp]
      integer :: k

      do k = 1, 2
         problem%valley%least = edges(k)
         call fit(problem, 2, variables([0.9_wp, 0.5_wp], .false.), options_t(), result, error)
         call check('start '//to_text(0.5_wp - edges(k))//' above the edge', .not. allocated(error))
         call check('start '//to_text(0.5_wp - edges(k))//' above the edge: compared', &
            allocated(result%derivative_check) .eqv. k == 1)
      end do
   end subroutine test_no_differences

   !> The minimum (1, 1) lies where the model cannot be computed, or at the very edge: trial steps
   !> are refused until they are as good as none, which MINPACK takes for convergence.
   subroutine test_edge()
      real(wp), parameter :: edges(4) = [0.5_wp, 0.9_wp, 0.99_wp, 0.999999_wp]
      type(edge_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, size(edges)
         problem = edge_t(valley=rosenbrock_t(largest=edges(k), how=1))
         call fit(problem, 2, variables([-1.2_wp, 0.2_wp], .false.), options_t(), result, error)
         call fails('minimum beyond b = '//to_text(edges(k)), error, &
            'the model cannot be computed at the next steps')
      end do
      problem = edge_t(valley=rosenbrock_t(largest=1.0_wp, how=1))
      call fit(problem, 2, variables([-1.2_wp, 0.2_wp], .false.), options_t(), result, error)
      call check('minimum at the edge: converges', .not. allocated(error))
   end subroutine test_edge

   !> Large residuals in a bent valley: Levenberg-Marquardt creeps, Newton's method arrives.
   subroutine test_valley()
      type(valley_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      integer, parameter :: few = 50

      problem%exact = .true.
      call fit(problem, 3, variables([-1.0_wp, 1.0_wp], .false.), &
         options_t(max_evaluations=few), result, error)
      call fails('valley: a few evaluations', error, 'evaluations allowed are used up')
      call fit(problem, 3, variables([-1.0_wp, 1.0_wp], .false.), &
         options_t(max_evaluations=few, persistent=.true.), result, error)
      call check('valley: goes on and arrives', .not. allocated(error))
      if (allocated(error)) return
      ! A step that promises 1e-8 of the variance, 100, of half of J is none: with a curvature of 20
      ! a distance of sqrt(2e-6/20).
      call check_close('valley: along', result%estimate(1), 3.0_wp, 4e-4_wp)
      call check_close('valley: across', result%estimate(2), result%estimate(1)**2, 1e-4_wp)
      call check('valley: in how many evaluations', result%evaluations < 8*few, &
         to_text(result%evaluations))
   end subroutine test_valley

   !> J never rises from one iteration to the next; the last report is the result.
   subroutine test_monitor()
      type(rosenbrock_t) :: problem
      type(history_t) :: history
      type(fit_t) :: result
      type(error_t), allocatable :: error

      call fit(problem, 2, variables([-1.2_wp, 1.0_wp], .false.), options_t(), result, error, &
         history, 'a label', ['a', 'b'])
      call check('monitor: converges', .not. allocated(error))
      if (allocated(error)) return
      ! J = 0 is reached at least to the square of the tolerance in the parameters.
      call check_close('monitor: minimum of Rosenbrock''s function', &
         maxval(abs(result%estimate - 1)), 0.0_wp, 1e-7_wp)
      associate (J => history%J(:history%count))
         call check('monitor: J does not rise', all(J(2:) <= J(:size(J) - 1)), &
            to_text(history%count)//' reports from '//to_text(J(1))//' to '//to_text(J(size(J))))
         ! J(-1.2, 1) = (10*(1 - 1.44))^2 + 2.2^2 = 24.2.
         call check_close('monitor: J at the start', J(1), 24.2_wp, 1e-13_wp)
         call check('monitor: more than the start', size(J) > 5)
         call check_close('monitor: last J', J(size(J)), result%J, 1e-12_wp)
      end associate
      call check('monitor: numbers and names', history%numbered .and. history%named .and. &
         history%count == result%iterations)
      call check_close('monitor: last parameters', maxval(abs(history%last - result%estimate)), &
         0.0_wp, 1e-7_wp)
   end subroutine test_monitor

   !> From (-1.2, 1) the first full step leads to b = 2 a - a^2 = -3.84. When the model cannot be
   !> computed below -1, steps are made shorter, and the minimum (1, 1) is found all the same.
   subroutine test_forbidden()
      character(len=*), parameter :: how(3) = [character(len=8) :: 'error', 'NaN', 'infinite']
      type(rosenbrock_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, 3
         problem = rosenbrock_t(least=-1.0_wp, how=k)
         call fit(problem, 2, variables([-1.2_wp, 1.0_wp], .false.), options_t(), result, error)
         call check('forbidden region, '//trim(how(k))//': converges', .not. allocated(error))
         if (allocated(error)) cycle
         call check('forbidden region, '//trim(how(k))//': steps were shortened', &
            result%shortened > 0 .and. result%shortened == problem%refusals, &
            to_text(result%shortened))
         ! As in test_monitor.
         call check_close('forbidden region, '//trim(how(k))//': minimum', &
            maxval(abs(result%estimate - 1)), 0.0_wp, 1e-7_wp)
      end do
   end subroutine test_forbidden

   !> A model that fails at the start, or from there on everywhere, is an error with its own words.
   subroutine test_never()
      character(len=*), parameter :: words(3) = [character(len=12) :: 'no model', 'not finite', &
         'not finite']
      type(rosenbrock_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, 3
         problem = rosenbrock_t(least=2.0_wp, how=k)
         call fit(problem, 2, variables([-1.2_wp, 1.0_wp], .false.), options_t(), result, error)
         call fails('fails at the start, '//to_text(k), error, trim(words(k)))
         call check('one attempt is enough, '//to_text(k), problem%refusals == 1, &
            to_text(problem%refusals))
      end do
      ! The start lies on the edge: the first difference for the Jacobian cannot be computed.
      problem = rosenbrock_t(largest=1.0_wp, how=1)
      call fit(problem, 2, variables([-1.2_wp, 1.0_wp], .false.), options_t(), result, error)
      call fails('fails at the first difference', error, 'no model')
   end subroutine test_never

   subroutine fails(name, error, words)
      character(len=*), intent(in) :: name, words
      type(error_t), allocatable, intent(in) :: error

      if (.not. allocated(error)) then
         call check(name, .false., 'no error')
      else
         call check(name, error%status == status_failed .and. index(error%message, words) > 0, &
            error%message)
      end if
   end subroutine fails

   !> Residuals b - target: the minimum is the target, cut at the bounds, where J = 1 + 9 is left of
   !> the two targets that cannot be reached. A relative tolerance of 1e-10 on J is 1e-9 then: 3e-5
   !> in the parameters that reach their targets, whose squares it bounds; 1e-9 over the slope of J,
   !> 2 and 6, in those at their bounds.
   subroutine test_bounds()
      type(line_t) :: problem
      type(variable_t) :: v(4)
      type(fit_t) :: result
      type(error_t), allocatable :: error
      real(wp), parameter :: expected(4) = [0.0_wp, 2.0_wp, 1.0_wp, -3.0_wp], &
         targets(4) = [-1.0_wp, 5.0_wp, 1.0_wp, -3.0_wp]
      integer :: k

      problem = line_t(targets)
      v = [new_variable(0.7_wp, 0.0_wp, unbounded, 1.0_wp), &
           new_variable(0.5_wp, -1.0_wp, 2.0_wp, 1.0_wp), &
           new_variable(0.2_wp, -10.0_wp, 10.0_wp, 1.0_wp), &
           new_variable(4.0_wp, -unbounded, 5.0_wp, 1.0_wp)]
      call fit(problem, 4, v, options_t(), result, error)
      call check('bounds: converges', .not. allocated(error))
      if (allocated(error)) return
      do k = 1, 4
         call check_close('bounds: parameter '//to_text(k), result%estimate(k), expected(k), &
            merge(1e-9_wp, 3e-5_wp, k <= 2))
      end do
      call check('bounds: kept', result%estimate(1) >= 0 .and. result%estimate(2) <= 2)
      call check_close('bounds: J', result%J, 10.0_wp, 1e-9_wp)
      call check('bounds: parameters without names are numbered', index(result%reason, &
         '; parameter 1 held at its bound; parameter 2 held at its bound') > 0, result%reason)
      call fit(problem, 4, v, options_t(), result, error, names=['a', 'b', 'c', 'd'])
      call check('bounds: parameters are named', .not. allocated(error) .and. &
         index(result%reason, '; a held at its bound; b held at its bound') > 0, result%reason)
      ! Starts at a bound, with the minimum inside: the search must get away.
      problem = line_t([0.3_wp, 0.4_wp])
      call fit(problem, 2, [new_variable(0.0_wp, 0.0_wp, unbounded, 1.0_wp), &
         new_variable(1.0_wp, 0.0_wp, 1.0_wp, 1.0_wp)], options_t(), result, error)
      call check('start at a bound: converges', .not. allocated(error))
      if (allocated(error)) return
      ! J = 0 there: the last step is quadratic, and 1e-8 is more than it leaves.
      call check_close('start at a bound: minimum', &
         maxval(abs(result%estimate - [0.3_wp, 0.4_wp])), 0.0_wp, 1e-8_wp)
      call check('start at a bound: said where', result%start(1) > 0 .and. result%start(2) < 1)
   end subroutine test_bounds

   !> Too few residuals, too few evaluations.
   subroutine test_limits()
      type(rosenbrock_t) :: problem
      type(fit_t) :: result
      type(error_t), allocatable :: error

      call fit(problem, 1, variables([-1.2_wp, 1.0_wp], .false.), options_t(), result, error)
      call fails('fewer residuals than parameters', error, '1 residuals for 2 parameters')
      call fit(problem, 2, variables([-1.2_wp, 1.0_wp], .false.), options_t(max_evaluations=7), &
         result, error)
      call fails('evaluations used up', error, 'evaluations allowed are used up')
      call check('evaluations used up: no more than a Jacobian beyond', &
         result%evaluations <= 7 + 2 + 1, to_text(result%evaluations))
      call check('evaluations used up: the best so far is there', result%J <= 24.2_wp)
   end subroutine test_limits

   !> What linear theory promises stays inside the bounds and is stationary for what stays off
   !> them, wherever roundings put the parameters: those that start a last digit beyond a bound, and
   !> those whose way to a bound is so long that they come out beside it.
   subroutine test_outlook()
      type(variable_t) :: variables(4)
      type(gauss_newton_t) :: ahead
      real(wp), parameter :: near = 1e-3_wp, side(4) = [1, -1, 1, -1]
      real(wp) :: jacobian(7, 4), residual(7), p(4), found(4), gradient(4), beyond, slope
      logical :: finite
      integer :: i, k

      call random_seed(put=[(4711 + k, k=1, 64)])
      beyond = 0
      slope = 0
      finite = .true.
      do i = 1, 2000
         call random_number(jacobian)
         call random_number(residual)
         jacobian = jacobian - 0.5_wp
         residual = residual - 0.5_wp
         do k = 1, 4
            variables(k) = new_variable(side(k)*0.15_wp, min(side(k)*near, side(k)*0.2_wp), &
               max(side(k)*near, side(k)*0.2_wp), 1.0_wp)
            p(k) = variables(k)%start
            if (modulo(i/2**k, 3) == 0) p(k) = nearest(variables(k)%lower, -1.0_wp)
            if (modulo(i/2**k, 3) == 1) p(k) = nearest(variables(k)%upper, 1.0_wp)
         end do
         ahead = gauss_newton_step(jacobian, residual, p, variables, 1e-12_wp)
         found = p + ahead%step
         gradient = matmul(ahead%residual, jacobian)
         finite = finite .and. all(abs(found) < 1) .and. all(abs(ahead%residual) < 100)
         beyond = max(beyond, maxval(max(variables%lower - found, found - variables%upper)))
         slope = max(slope, maxval(abs(gradient), mask=found > variables%lower + 1e-4_wp .and. &
            found < variables%upper - 1e-4_wp))
      end do
      call check('outlook: finite', finite)
      ! Numbers of .1 and sums of seven products.
      call check_close('outlook: inside the bounds', max(beyond, 0.0_wp), 0.0_wp, 1e-15_wp)
      call check_close('outlook: stationary off them', slope, 0.0_wp, 1e-12_wp)
   end subroutine test_outlook

end program test_least_squares
