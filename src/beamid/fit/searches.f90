!> Runs one MINPACK search for the minimum of a sum of squares: `lmdif` (in place of IMSL's ZXSSQ,
!> which the paper used), or `lmder` if the problem has exact derivatives. `beamid_least_squares`
!> calls it, with checks before and after.
!>
!> MINPACK's callbacks have no argument for user data. Therefore `active`, which is private to this
!> module and to each thread, points to the current search while MINPACK runs.
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

   public :: monitor_t, options_t, search_t, run_search, notify_monitor, physical_parameters

   !> Receives reports of progress: of each iteration of a search, and of the share of a larger task
   !> that is finished.
   type, abstract :: monitor_t
   contains
      procedure(iteration), deferred :: iteration
      procedure :: done, advanced
   end type monitor_t

   !> Options of a least-squares fit.
   type :: options_t
      !> relative error of the residuals that an integrator's tolerance causes; 0: round-off only
      real(wp) :: relative_error = 0
      real(wp) :: tolerance = 1e-10_wp    !< relative, for J and for the parameters
      integer :: max_evaluations = 2000   !< of the residuals, in one search
      !> if `max_evaluations` do not suffice and derivatives are exact, continue by Newton's method
      logical :: persistent = .false.
      logical :: check = .true.            !< compare exact derivatives with differences
      !> .true.: the end of a search counts even if it is not a minimum; for searches whose ends are
      !> compared and continued
      logical :: rough = .false.
      !> whether residuals and Jacobian at the end are wanted in all rows; .false.: after a search
      !> with condensed rows they have none, unless their derivatives are compared in all rows
      logical :: all_rows = .true.
   end type options_t

   abstract interface
      !> Reports one iteration. Several threads may call it at the same time.
      !>
      !> label        name of the search
      !> number       number of the iteration
      !> evaluations  evaluations of the residuals so far
      !> J            sum of squares at this iteration
      !> names        (n) names of the parameters
      !> parameters   (n) physical values
      subroutine iteration(self, label, number, evaluations, J, names, parameters)
         import :: monitor_t, wp
         class(monitor_t), intent(inout) :: self
         character(len=*), intent(in) :: label, names(:)
         integer, intent(in) :: number, evaluations
         real(wp), intent(in) :: J, parameters(:)
      end subroutine iteration
   end interface

   !> A point at which residuals and exact derivatives were evaluated.
   type :: evaluated_t
      real(wp), allocatable :: parameters(:)    !< (n) physical values
      real(wp), allocatable :: residual(:)      !< (rows)
      real(wp), allocatable :: jacobian(:, :)   !< (rows, n) d residual/d parameter
      real(wp) :: J = huge(1.0_wp)              !< sum of squares
   end type evaluated_t

   !> The state of a search, which the callbacks read and change.
   type :: search_t
      class(problem_t), pointer :: problem => null()   !< the problem whose J is minimised
      !> the same problem if it has exact derivatives, otherwise null
      class(smooth_problem_t), pointer :: smooth => null()
      class(monitor_t), pointer :: monitor => null()   !< null: no reports
      !> number of residuals; the rows of a search are fewer if they are condensed
      integer :: residuals = 0
      character(len=:), allocatable :: label          !< name of the search in reports
      character(len=24), allocatable :: names(:)      !< (n) names of the parameters
      type(variable_t), allocatable :: variables(:)   !< (n) with their bounds
      real(wp), allocatable :: parameters(:)          !< (n) values of variables that do not move
      integer, allocatable :: moving(:)               !< indices of the variables that MINPACK moves
      !> (n) whether a variable was fixed at a bound before; it is not fixed a second time
      logical, allocatable :: was_fixed(:)
      !> index of a moving variable at its bound; 0: none
      integer :: near_bound = 0
      integer :: iterations_at_bound = 0       !< consecutive iterations that it has spent there
      !> relative error of the residuals, from which `lmdif` finds the steps of its differences
      real(wp) :: relative_error = epsilon(1.0_wp)
      !> largest length of the first step, in units of the norm of the scaled start (MINPACK's
      !> `factor`)
      real(wp) :: factor = 100
      real(wp), allocatable :: first_norm      !< Euclidean norm of the residuals at the start
      integer :: iterations = 0                !< number of iterations
      integer :: evaluations = 0               !< number of evaluations of the residuals
      !> number of trial steps that MINPACK shortened because the model could not be computed there
      integer :: shortened = 0
      integer :: failures_in_a_row = 0         !< number of such steps since the last success
      type(error_t), allocatable :: error      !< the error that stopped the search
      !> the point evaluated last, and an earlier point to which the search may return from a
      !> rejected trial step
      type(evaluated_t) :: evaluated(2)
      integer :: here = 1                      !< index of the point evaluated last
      real(wp) :: J = huge(1.0_wp)             !< sum of squares where the last step began
      !> distance to the minimum [standard errors] below which the search has converged
      real(wp) :: settled_distance = 0
      logical :: is_settled = .false.          !< whether that distance is reached
   contains
      procedure :: evaluate_at
   end type search_t

   type(search_t), pointer :: active => null()
   !$omp threadprivate(active)

   !> Number of failing trial steps in a row, each a tenth of the step before, that ends a search.
   integer, parameter :: max_failures = 10
   !> A search has converged if linear theory sees the minimum within `settled_offset`
   !> sqrt(tolerance) standard errors: 1e-6 by default. This distance is the relative offset of
   !> Bates and Watts (Technometrics 23, 1981, 179), who stop at 1e-3; round-off of a response
   !> limits it to some 1e-7. The test is made only after a step that changed J by at most the share
   !> `small_change`.
   real(wp), parameter :: settled_offset = 0.1_wp, small_change = 1e-5_wp

contains

   !> Reports that a part of several searches is finished. One thread at a time calls it; it does
   !> nothing unless overridden.
   !>
   !> part   number of searches that are finished
   !> whole  number of all searches
   subroutine done(self, part, whole)
      class(monitor_t), intent(inout) :: self
      integer, intent(in) :: part, whole
   end subroutine done

   !> Reports, like `done`, the progress of work that has no iterations.
   !>
   !> part    number of pieces that are finished
   !> whole   number of all pieces; 0: not known
   !> pieces  plural noun for the pieces, such as 'draws'
   subroutine advanced(self, part, whole, pieces)
      class(monitor_t), intent(inout) :: self
      integer, intent(in) :: part, whole
      character(len=*), intent(in) :: pieces
   end subroutine advanced

   !> Calls MINPACK with the settings of a search.
   !>
   !> search     on return with counts, and with `error` if the model failed
   !> tolerance  relative, for the parameters; also for J if the model uses an integrator, because
   !>            then J does not converge to the last digit
   !> z          (moving variables) on entry the start, on return the solution
   !> r          (rows) residuals at the solution
   !> info       MINPACK's code of the reason for stopping; negative: a callback stopped the search
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
      search%evaluated(3 - search%here)%J = huge(search%J)
      search%is_settled = .false.
      search%settled_distance = settled_offset*sqrt(options%tolerance)
      ftol = merge(tolerance, 1e-14_wp, options%relative_error > 0)
      associate (m => size(r), n => size(z))
         if (associated(search%smooth)) then
            call lmder(lmder_callback, m, n, z, r, fjac, m, ftol, tolerance, gtol, &
               options%max_evaluations, diag, 1, search%factor, 1, info, nfev, njev, ipvt, qtf, &
               wa1, wa2, wa3, wa4)
            if (search%is_settled) info = 2
         else
            call lmdif(lmdif_callback, m, n, z, r, ftol, tolerance, gtol, options%max_evaluations, &
               search%relative_error, diag, 1, search%factor, 1, info, nfev, fjac, m, ipvt, qtf, &
               wa1, wa2, wa3, wa4)
         end if
      end associate
      active => null()
   end subroutine run_search

   !> Computes residuals, or derivatives (iflag = 2), for `lmder`, and stops a search that has
   !> converged. Its arguments are those of MINPACK; x holds the moving variables z.
   subroutine lmder_callback(m, n, x, fvec, fjac, ldfjac, iflag)
      integer, intent(in) :: m, n, ldfjac
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: fvec(m), fjac(ldfjac, n)
      integer, intent(inout) :: iflag
      type(error_t), allocatable :: error
      type(gauss_newton_t) :: ahead
      real(wp) :: r(m)
      integer :: k

      if (iflag /= 2) then
         call lmdif_callback(m, n, x, fvec, iflag)
         return
      end if
      call active%evaluate_at(physical_parameters(active, x), r, error)
      if (allocated(error)) then
         call move_alloc(error, active%error)
         iflag = -1
         return
      end if
      associate (here => active%evaluated(active%here), moving => active%moving)
         do k = 1, n
            fjac(:m, k) = here%jacobian(:, moving(k)) &
               *active%variables(moving(k))%derivative(x(k))
         end do
         if (.not. here%J < (1 - small_change)*active%J) then
            ahead = gauss_newton_step(here%jacobian(:, moving), r, here%parameters(moving), &
               active%variables(moving), active%residuals*epsilon(r), active%residuals)
            active%is_settled = ahead%distance <= active%settled_distance .and. &
               ahead%rank == n .and. &
               .not. any(active%variables(moving)%is_at_bound(here%parameters(moving)))
            if (active%is_settled) iflag = -1
         end if
         active%J = here%J
      end associate
   end subroutine lmder_callback

   !> Computes residuals for `lmdif`. iflag = 0 marks a new iteration, 1 the start or a trial step,
   !> 2 a difference for the Jacobian. At a trial step where the model fails, the residuals are set
   !> to a hundred times the norm at the start; Levenberg-Marquardt then tries a tenth of the step.
   subroutine lmdif_callback(m, n, x, fvec, iflag)
      integer, intent(in) :: m, n
      real(wp), intent(in) :: x(n)
      real(wp), intent(inout) :: fvec(m)
      integer, intent(inout) :: iflag
      type(error_t), allocatable :: error

      if (iflag == 0) then
         call watch_bounds(active, x, fvec, iflag)
         return
      end if
      call active%evaluate_at(physical_parameters(active, x), fvec, error)
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
   end subroutine lmdif_callback

   !> Computes residuals and, if the problem has exact derivatives, the Jacobian into `evaluated`,
   !> in condensed rows. Most trial steps are accepted, and the derivatives are then needed at the
   !> same point. After a rejected step the search returns to the point before, which `evaluated`
   !> still holds.
   !>
   !> parameters  (n) physical values
   !> r           (rows) residuals
   !> error       the model fails there, or derivatives are not finite
   subroutine evaluate_at(self, parameters, r, error)
      class(search_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(inout) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      if (.not. associated(self%smooth)) then
         self%evaluations = self%evaluations + 1
         call self%problem%residuals(parameters, r, error)
         return
      end if
      do k = 1, 2
         if (.not. is_at(self%evaluated(k), parameters)) cycle
         self%here = k
         r = self%evaluated(k)%residual
         return
      end do
      ! The new point takes the place of the worse one.
      self%here = merge(2, 1, self%evaluated(1)%J <= self%evaluated(2)%J)
      self%evaluations = self%evaluations + 1
      associate (here => self%evaluated(self%here))
         here%J = huge(here%J)
         if (.not. allocated(here%jacobian)) allocate (here%jacobian(size(r), size(parameters)), &
            here%residual(size(r)))
         here%parameters = parameters
         call self%smooth%condensed(parameters, here%residual, here%jacobian, error)
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

   !> Returns whether a point was evaluated at exactly these parameters.
   pure logical function is_at(evaluated, parameters)
      type(evaluated_t), intent(in) :: evaluated
      real(wp), intent(in) :: parameters(:)

      is_at = allocated(evaluated%parameters)
      if (is_at) is_at = all(abs(parameters - evaluated%parameters) <= 0)
   end function is_at

   !> Returns all physical parameters, (n), at a point x of the moving variables.
   function physical_parameters(search, x) result(parameters)
      type(search_t), intent(in) :: search
      real(wp), intent(in) :: x(:)
      real(wp) :: parameters(size(search%variables))
      integer :: k

      parameters = search%parameters
      ! A loop: an elemental call would copy the variables.
      do k = 1, size(x)
         associate (moving => search%moving(k))
            parameters(moving) = search%variables(moving)%value(x(k))
         end associate
      end do
   end function physical_parameters

   !> Counts an iteration and reports it to the monitor.
   !>
   !> parameters  (n) physical values
   !> J           sum of squares there
   subroutine notify_monitor(search, parameters, J)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: parameters(:), J

      if (associated(search%monitor)) call search%monitor%iteration(search%label, &
         search%iterations, search%evaluations, J, search%names, parameters)
      search%iterations = search%iterations + 1
   end subroutine notify_monitor

   !> Reports an iteration, and stops MINPACK (iflag < 0) if a variable has stayed at a bound for
   !> three iterations.
   !>
   !> x  (moving variables)
   !> r  (rows) residuals there
   subroutine watch_bounds(search, x, r, iflag)
      type(search_t), intent(inout) :: search
      real(wp), intent(in) :: x(:), r(:)
      integer, intent(inout) :: iflag
      integer, parameter :: patience = 3
      real(wp) :: parameters(size(search%variables))
      integer :: k, near

      parameters = physical_parameters(search, x)
      call notify_monitor(search, parameters, sum(r**2))
      near = 0
      do k = 1, size(search%variables)
         if (search%was_fixed(k) .or. .not. any(search%moving == k)) cycle
         if (search%variables(k)%is_at_bound(parameters(k))) near = k
      end do
      search%iterations_at_bound = merge(search%iterations_at_bound + 1, 0, near > 0 .and. &
         (near == search%near_bound .or. search%iterations_at_bound == 0))
      search%near_bound = near
      if (search%iterations_at_bound >= patience) iflag = -1
   end subroutine watch_bounds

end module beamid_searches
