!> One search by MINPACK: `lmdif`, the stand-in for IMSL's ZXSSQ, or `lmder` for problems that know
!> their derivatives.
!>
!> MINPACK calls back a procedure without a place for data of ours: `active`, private to this module
!> and to each thread, points to the search in hand while MINPACK runs.
module beamid_searches
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_errors, only: error_t, failure
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
      !> (m, n) derivatives of the last point that was evaluated, and that point
      real(wp), allocatable :: jacobian(:, :), residual(:), point(:)
   contains
      procedure :: evaluate_at
   end type search_t

   type(search_t), pointer :: active => null()
   !$omp threadprivate(active)

   !> So many failing trial steps in a row, each a tenth of the one before, end a search.
   integer, parameter :: max_failures = 10

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
      ftol = merge(tolerance, 1e-14_wp, options%relative_error > 0)
      associate (m => size(r), n => size(z))
         if (associated(search%smooth)) then
            call lmder(evaluate_both, m, n, z, r, fjac, m, ftol, tolerance, gtol, &
               options%max_evaluations, diag, 1, search%factor, 1, info, nfev, njev, ipvt, qtf, &
               wa1, wa2, wa3, wa4)
         else
            call lmdif(evaluate, m, n, z, r, ftol, tolerance, gtol, options%max_evaluations, &
               search%relative_error, diag, 1, search%factor, 1, info, nfev, fjac, m, ipvt, qtf, &
               wa1, wa2, wa3, wa4)
         end if
      end associate
      active => null()
   end subroutine run_search

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
      call active%evaluate_at(trial(active, x), r, error)
      if (allocated(error)) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      fjac(:m, :) = active%jacobian(:, active%moving) &
         *spread(active%variables(active%moving)%derivative(x), 1, m)
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
   !> taken, and the next thing that is wanted are the derivatives there.
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
      if (allocated(self%point)) then
         if (all(abs(parameters - self%point) <= 0)) then
            r = self%residual
            return
         end if
         deallocate (self%point)
      end if
      self%evaluations = self%evaluations + 1
      if (.not. allocated(self%jacobian)) allocate (self%jacobian(size(r), size(parameters)), &
         self%residual(size(r)))
      call self%smooth%jacobian(parameters, self%residual, self%jacobian, error)
      if (.not. allocated(error)) then
         if (.not. all(ieee_is_finite(self%jacobian))) call failure(error, &
            'the derivatives are not finite')
      end if
      if (allocated(error)) return
      r = self%residual
      self%point = parameters
   end subroutine evaluate_at

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
