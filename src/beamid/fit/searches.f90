!> One search by MINPACK: `lmdif`, the stand-in for IMSL's ZXSSQ, or `lmder` for problems that know
!> their derivatives.
!>
!> MINPACK calls back a procedure without a place for data of ours: `active`, private to this module
!> and to each thread, points to the search in hand while MINPACK runs.
module beamid_searches
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
   use beamid_gauss_newton, only: gauss_newton_step, gauss_newton_t
   use beamid_kinds, only: wp
   use beamid_minpack, only: lmder, lmdif
   use beamid_problems, only: problem_t, smooth_problem_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: monitor_t, options_t, search_t, run_search, tell, trial

   !> Is told of every iteration, and of several searches how many are done.
   type, abstract :: monitor_t
   contains
      procedure(iteration), deferred :: iteration
      procedure :: done
      procedure :: advanced
   end type monitor_t

   type :: options_t
      !> of the residuals, by an integrator's tolerance; 0: round-off only
      real(wp) :: relative_error = 0
      real(wp) :: tolerance = 1e-10_wp     !< relative, on J and on the parameters
      integer :: max_evaluations = 2000
      !> where these do not do, go on by Newton's method if derivatives are exact
      logical :: persistent = .false.
      logical :: check = .true.            !< compare exact derivatives with differences
   end type options_t

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

   !> A point at which a problem that knows its derivatives was evaluated.
   type :: evaluated_t
      real(wp), allocatable :: parameters(:), residual(:), jacobian(:, :)   !< (n), (m), (m, n)
      real(wp) :: J = huge(1.0_wp)
   end type evaluated_t

   !> What the callback needs to know.
   type :: search_t
      class(problem_t), pointer :: problem => null()
      !> the same where it has exact derivatives
      class(smooth_problem_t), pointer :: smooth => null()
      class(monitor_t), pointer :: monitor => null()
      character(len=:), allocatable :: label
      character(len=24), allocatable :: names(:)
      type(variable_t), allocatable :: variables(:)
      real(wp), allocatable :: parameters(:)   !< (n) values of those that do not move
      integer, allocatable :: moving(:)        !< which variables MINPACK moves
      logical, allocatable :: held(:)          !< (n) may not be held at a bound a second time
      !> a moving variable that has come to a bound, 0: none
      integer :: near_bound = 0
      integer :: lingering = 0                 !< iterations in a row that it has spent there
      !> of the residuals, for the steps of differences
      real(wp) :: relative_error = epsilon(1.0_wp)
      real(wp) :: factor = 100          !< length of the first step, in norms of the scaled start
      real(wp), allocatable :: first_norm   !< of the residuals at the start
      integer :: iterations = 0, evaluations = 0, shortened = 0, failures_in_a_row = 0
      type(error_t), allocatable :: error
      !> the point asked for last, if it could be evaluated, and one to which a search may come back
      !> from a trial step
      type(evaluated_t) :: here, kept
      real(wp) :: J = huge(1.0_wp)             !< where the last step began
      real(wp) :: nothing = 0                  !< a distance that is none, in standard errors
      logical :: is_settled = .false.          !< no step is worth while
   contains
      procedure :: evaluate_at
   end type search_t

   type(search_t), pointer :: active => null()
   !$omp threadprivate(active)

   !> So many failing trial steps in a row, each a tenth of the one before, end a search.
   integer, parameter :: max_failures = 10
   !> A minimum as near as this, in standard errors and in square roots of the tolerance, is where
   !> the search is: 1e-6 by default. It is the relative offset of Bates and Watts (Technometrics
   !> 23, 1981, 179), who stop at 1e-3; round-off of a response sees some 1e-7. Asked for where a
   !> step has changed J by no more than `little`, relatively.
   real(wp), parameter :: settled = 0.1_wp, little = 1e-5_wp

contains

   !> Called by one thread at a time; does nothing unless overridden.
   !>
   !> part, whole  of the work
   subroutine done(self, part, whole)
      class(monitor_t), intent(inout) :: self
      integer, intent(in) :: part, whole
   end subroutine done

   !> As `done`, of work without iterations.
   !>
   !> whole   0: not known
   !> pieces  what the work is counted in, 'draws'
   subroutine advanced(self, part, whole, pieces)
      class(monitor_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: pieces
   end subroutine advanced

   !> Calls MINPACK.
   !>
   !> tolerance  relative, on the parameters; of a model by an integrator also on J, which cannot
   !>            settle to the last digit
   !> z          (n) start, then solution
   !> r          (m) residuals at the solution
   !> info       MINPACK's, or negative when the search was stopped
   subroutine run_search(search, options, tolerance, z, r, info)
      type(search_t), intent(inout), target :: search
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: tolerance
      real(wp), intent(inout) :: z(:)
      real(wp), intent(inout) :: r(:)
      integer, intent(out) :: info
      real(wp), dimension(size(z)) :: diag, qtf, wa1, wa2, wa3
      real(wp), allocatable :: fjac(:, :), wa4(:)
      real(wp) :: ftol
      integer :: nfev, njev, ipvt(size(z))
      real(wp), parameter :: gtol = 0

      allocate (fjac(size(r), size(z)), wa4(size(r)))
      active => search
      search%J = huge(search%J)
      search%kept%J = huge(search%J)
      search%is_settled = .false.
      search%nothing = settled*sqrt(options%tolerance)
      ftol = merge(tolerance, 1e-14_wp, options%relative_error > 0)
      associate (m => size(r), n => size(z))
         if (associated(search%smooth)) then
            call lmder(evaluate_both, m, n, z, r, fjac, m, ftol, tolerance, gtol, &
               options%max_evaluations, diag, 1, search%factor, 1, info, nfev, njev, ipvt, qtf, &
               wa1, wa2, wa3, wa4)
            if (search%is_settled) info = 2
         else
            call lmdif(evaluate, m, n, z, r, ftol, tolerance, gtol, options%max_evaluations, &
               search%relative_error, diag, 1, search%factor, 1, info, nfev, fjac, m, ipvt, qtf, &
               wa1, wa2, wa3, wa4)
         end if
      end associate
      active => null()
   end subroutine run_search

   !> The callback of `lmder`: residuals through `evaluate`, derivatives for iflag = 2, and there
   !> the end of a search that has settled.
   subroutine evaluate_both(m, n, x, fvec, fjac, ldfjac, iflag)
      integer, intent(in) :: m, n, ldfjac
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
      integer, intent(inout) :: iflag
      type(error_t), allocatable :: error
      type(gauss_newton_t) :: ahead
      real(wp) :: r(m)
      integer :: k

      if (iflag /= 2) then
         call evaluate(m, n, x, fvec, iflag)
         return
      end if
      call active%evaluate_at(trial(active, x), r, error)
      if (allocated(error)) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      do k = 1, n
         associate (moving => active%moving(k))
            fjac(:m, k) = active%here%jacobian(:, moving)*active%variables(moving)%derivative(x(k))
         end associate
      end do
      if (.not. active%here%J < (1 - little)*active%J) then
         associate (variables => active%variables(active%moving), &
            parameters => active%here%parameters(active%moving))
            ahead = gauss_newton_step(active%here%jacobian(:, active%moving), r, parameters, &
               variables, m*epsilon(r))
            active%is_settled = ahead%distance <= active%nothing .and. ahead%rank == n .and. &
               .not. any(variables%is_at_bound(parameters))
         end associate
         if (active%is_settled) iflag = -1
      end if
      active%J = active%here%J
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
      call active%evaluate_at(trial(active, x), fvec, error)
      if (.not. allocated(error)) then
         if (.not. ieee_is_finite(sum(fvec**2))) &
            call failure(error, 'the sum of squared residuals is not finite')
      end if
      if (.not. allocated(error)) then
         if (.not. allocated(active%first_norm)) active%first_norm = norm2(fvec)
         active%failures_in_a_row = 0
         return
      end if

      active%failures_in_a_row = active%failures_in_a_row + 1
      if (iflag == 2 .or. .not. allocated(active%first_norm) .or. &
         active%failures_in_a_row > max_failures) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      active%shortened = active%shortened + 1
      fvec = 100*(active%first_norm + tiny(1.0_wp))/sqrt(real(m, wp))
   end subroutine evaluate

   !> Residuals, and with them the derivatives of a problem that knows them: most trial steps are
   !> taken, and the next thing that is wanted are the derivatives there; `here` has them. From
   !> those that are not taken a search comes back to where it was, and does not pay for it again.
   subroutine evaluate_at(self, parameters, r, error)
      class(search_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(inout) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      if (.not. associated(self%smooth)) then
         self%evaluations = self%evaluations + 1
         call self%problem%residuals(parameters, r, error)
         return
      end if
      if (is_at(self%here, parameters)) then
         r = self%here%residual
         return
      end if
      if (is_at(self%kept, parameters)) then
         call swap(self%here, self%kept)
         r = self%here%residual
         return
      end if
      if (self%here%J <= self%kept%J) call swap(self%here, self%kept)
      self%evaluations = self%evaluations + 1
      associate (here => self%here)
         here%J = huge(here%J)
         if (.not. allocated(here%jacobian)) allocate (here%jacobian(size(r), size(parameters)), &
            here%residual(size(r)))
         here%parameters = parameters
         call self%smooth%jacobian(parameters, here%residual, here%jacobian, error)
         if (.not. allocated(error)) then
            if (.not. all(ieee_is_finite(here%jacobian))) call failure(error, &
               'the derivatives are not finite')
         end if
         if (allocated(error)) then
            deallocate (here%parameters)
            return
         end if
         r = here%residual
         here%J = sum(r**2)
         if (.not. ieee_is_finite(here%J)) here%J = huge(here%J)
      end associate
   end subroutine evaluate_at

   !> Whether a point has been evaluated there.
   pure logical function is_at(evaluated, parameters)
      type(evaluated_t), intent(in) :: evaluated
      real(wp), intent(in) :: parameters(:)

      is_at = allocated(evaluated%parameters)
      if (is_at) is_at = all(abs(parameters - evaluated%parameters) <= 0)
   end function is_at

   subroutine swap(a, b)
      type(evaluated_t), intent(inout) :: a, b
      type(evaluated_t) :: c

      call move(a, c)
      call move(b, a)
      call move(c, b)

   contains

      subroutine move(from, to)
         type(evaluated_t), intent(inout) :: from
         type(evaluated_t), intent(out) :: to

         call move_alloc(from%parameters, to%parameters)
         call move_alloc(from%residual, to%residual)
         call move_alloc(from%jacobian, to%jacobian)
         to%J = from%J
      end subroutine move

   end subroutine swap

   !> The physical parameters at a point of the moving variables.
   function trial(search, x) result(parameters)
      type(search_t), intent(in) :: search
      real(wp), intent(in) :: x(:)
      real(wp) :: parameters(size(search%variables))

      parameters = search%parameters
      parameters(search%moving) = search%variables(search%moving)%value(x)
   end function trial

   !> Counts an iteration, and tells the monitor of it.
   !>
   !> parameters  physical
   subroutine tell(search, parameters, J)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: parameters(:), J

      if (associated(search%monitor)) call search%monitor%iteration(search%label, &
         search%iterations, search%evaluations, J, search%names, parameters)
      search%iterations = search%iterations + 1
   end subroutine tell

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
      call tell(search, parameters, sum(r**2))
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

end module beamid_searches
