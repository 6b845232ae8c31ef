!> Fits proposal distributions for the samplers: Student's t with four degrees of freedom around the
!> mode of a density, in coordinates without bounds, with its own width on each side of every axis
!> (Geweke, Econometrica 57, 1989, 1317).
module beamid_proposals
   use beamid_densities, only: coordinate_t, density_t, evaluate_at, impossible, new_coordinate, &
      without_bounds
   use beamid_errors, only: error_t, failure
   use beamid_interrupts, only: interrupted
   use beamid_kinds, only: wp
   use beamid_lapack, only: dposv, dpotrf, dtrtrs
   use beamid_matrices, only: add_diagonal, identity, outer
   use beamid_searches, only: monitor_t
   use beamid_variables, only: has, variable_t
   implicit none
   private

   public :: proposal_t, new_proposal, refit_proposal, factor_covariance

   !> Proposal distribution: the mode of a density in coordinates without bounds, and how the
   !> density decreases from there.
   type :: proposal_t
      type(coordinate_t), allocatable :: coordinate(:)   !< (n) of the parameters
      real(wp), allocatable :: mode(:)                   !< (n) in these coordinates
      !> (n, n) triangle A; A A' is the covariance of a normal density of the same curvature at the
      !> mode, or that of earlier draws
      real(wp), allocatable :: axes(:, :)
      !> (n, 2) below and above the mode, in units of the axes
      real(wp), allocatable :: width(:, :)
   end type proposal_t

   !> Length that no axis exceeds: it multiplies the distance from a bound by e**10.
   real(wp), parameter :: longest_axis = 10

contains

   !> Finds the mode of a density, and the axes and widths of the proposal around it.
   !>
   !> variables  (n) with their bounds
   !> start      (n) parameters near the mode
   !> error      the density cannot be computed at the start, or it has no mode near it
   !> monitor    receives reports of the progress
   subroutine new_proposal(density, variables, start, proposal, error, monitor)
      class(density_t), intent(in) :: density
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: start(:)
      type(proposal_t), intent(out) :: proposal
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      class(density_t), allocatable :: mine
      real(wp) :: top
      logical :: has_changed

      allocate (mine, source=density)
      proposal%coordinate = new_coordinate(variables)
      proposal%mode = proposal%coordinate%of(start)
      call find_axes(mine, proposal, top, error, monitor)
      if (allocated(error)) return
      call leave_far_bounds(proposal, has_changed)
      if (has_changed) call find_axes(mine, proposal, top, error, monitor)
      if (allocated(error)) return
      call measure_widths(mine, proposal, top, monitor)
   end subroutine new_proposal

   !> Finds the mode of a density from a point near it, and the axes there.
   !>
   !> proposal  in: with coordinates and the point
   !> top       log density of the coordinates at the mode
   subroutine find_axes(density, proposal, top, error, monitor)
      class(density_t), intent(inout) :: density
      type(proposal_t), intent(inout) :: proposal
      real(wp), intent(out) :: top
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), dimension(size(proposal%mode), size(proposal%mode)) :: H
      integer :: info, n

      n = size(proposal%mode)
      call climb(density, proposal%coordinate, proposal%mode, top, H, monitor)
      if (.not. top > impossible) then
         call failure(error, 'sampling: the density cannot be computed at the estimate')
         return
      end if
      call add_diagonal(H, spread(1/longest_axis**2, 1, n))
      call dpotrf('U', n, H, n, info)
      if (info /= 0) then
         call failure(error, 'sampling: the density has no mode near the estimate')
         return
      end if
      proposal%axes = identity(n)
      call dtrtrs('U', 'N', 'N', n, n, H, n, proposal%axes, n, info)
   end subroutine find_axes

   !> Climbs to the mode of a density by damped Newton steps.
   !>
   !> x     (n) coordinates: on entry the start, on return the mode
   !> here  log density of the coordinates at the mode; `impossible`: it cannot be computed at the
   !>       start
   !> H     (n, n) negative second derivatives there
   subroutine climb(density, coordinate, x, here, H, monitor)
      class(density_t), intent(inout) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(inout) :: x(:)
      real(wp), intent(out) :: here, H(:, :)
      class(monitor_t), intent(inout), optional :: monitor
      integer, parameter :: max_steps = 200
      real(wp) :: R(size(x), size(x)), trial(size(x)), g(size(x)), step(size(x)), value, damping
      integer :: i, info, k, n

      n = size(x)
      call in_coordinates(density, coordinate, x, here, g, H)
      if (.not. here > impossible) return
      damping = 1e-6_wp
      do i = 1, max_steps
         if (interrupted()) return
         if (present(monitor)) call monitor%advanced(i, 0, 'steps towards the mode')
         R = H
         call add_diagonal(R, [(damping*(1 + H(k, k)) + 1/longest_axis**2, k=1, n)])
         step = g
         call dposv('U', n, 1, R, n, step, n, info)
         if (info /= 0) exit
         trial = x + step*min(1.0_wp, 2/max(maxval(abs(step)), tiny(here)))
         call in_coordinates(density, coordinate, trial, value)
         if (value > here) then
            x = trial
            call in_coordinates(density, coordinate, x, here, g, H)
            damping = max(damping/10, 1e-12_wp)
            if (dot_product(step, g) < 1e-4_wp .and. maxval(abs(step)) < 1e-3_wp) exit
         else
            if (dot_product(step, g) < 1e-8_wp .or. damping > 1e12_wp) exit
            damping = 10*max(damping, 1e-3_wp)
         end if
      end do
   end subroutine climb

   !> Changes the coordinates of parameters between two bounds that are many standard deviations
   !> away. Their mode is then a little elsewhere, and the axes are those of the former coordinates.
   subroutine leave_far_bounds(proposal, has_changed)
      type(proposal_t), intent(inout) :: proposal
      logical, intent(out) :: has_changed
      !> Standard deviation of the logarithm of the ratio of the distances from the bounds: at least
      !> four to the nearer bound, and eight to both from the middle.
      real(wp), parameter :: far = 0.25_wp
      real(wp) :: q
      integer :: k

      has_changed = .false.
      do k = 1, size(proposal%mode)
         associate (c => proposal%coordinate(k), x => proposal%mode(k))
            if (.not. (has(c%lower) .and. has(c%upper)) .or. norm2(proposal%axes(k, :)) > far) cycle
            q = c%value(x)
            c = without_bounds(c)
            x = c%of(q)
            has_changed = .true.
         end associate
      end do
   end subroutine leave_far_bounds

   !> Measures the width on each side of every axis: that of the narrowest normal distribution that
   !> is nowhere below the density at some distances, up to 3.5 in units of the axis.
   !>
   !> top  log density of the coordinates at the mode
   subroutine measure_widths(density, proposal, top, monitor)
      class(density_t), intent(inout) :: density
      type(proposal_t), intent(inout) :: proposal
      real(wp), intent(in) :: top
      class(monitor_t), intent(inout), optional :: monitor
      real(wp), parameter :: distances(4) = [0.5_wp, 1.0_wp, 2.0_wp, 3.5_wp]
      real(wp), parameter :: narrowest = 0.3_wp, widest = 5
      real(wp) :: value, direction
      integer :: i, k, side

      allocate (proposal%width(size(proposal%mode), 2))
      do k = 1, size(proposal%mode)
         if (present(monitor)) call monitor%advanced(k, size(proposal%mode), 'axes of the density')
         do side = 1, 2
            direction = 2*side - 3
            proposal%width(k, side) = narrowest
            do i = 1, size(distances)
               call in_coordinates(density, proposal%coordinate, &
                  proposal%mode + direction*distances(i)*proposal%axes(:, k), value)
               if (.not. value > impossible) cycle
               proposal%width(k, side) = max(proposal%width(k, side), &
                  distances(i)/sqrt(2*max(top - value, 1e-3_wp)))
            end do
         end do
      end do
      proposal%width = min(proposal%width, widest)
   end subroutine measure_widths

   !> Computes the log density of the coordinates and, if requested, its derivatives.
   !>
   !> x          (n) coordinates
   !> value      log density; `impossible` where it cannot be computed
   !> gradient   (n) d value/d x
   !> curvature  (n, n) approximation of -d2 value/d x2, positive semidefinite; required with
   !>            `gradient`
   subroutine in_coordinates(density, coordinate, x, value, gradient, curvature)
      class(density_t), intent(inout) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      real(wp) :: slope(size(x)), log_slope_derivative
      integer :: k

      call evaluate_at(density, coordinate, x, value, gradient, curvature)
      if (.not. value > impossible) return
      value = value + sum(coordinate%log_slope(x))
      if (.not. present(gradient)) return
      slope = coordinate%slope(x)
      do k = 1, size(x)
         curvature(:, k) = slope*curvature(:, k)*slope(k)
      end do
      gradient = slope*gradient
      do k = 1, size(x)
         ! At the mode this term is the square of the derivative of `log_slope`, or more; elsewhere
         ! it must not make the curvature negative.
         log_slope_derivative = coordinate(k)%bend(x(k))
         curvature(k, k) = curvature(k, k) + max(0.0_wp, -gradient(k)*log_slope_derivative)
         gradient(k) = gradient(k) + log_slope_derivative
      end do
   end subroutine in_coordinates

   !> Replaces a proposal by one with mean and covariance of weighted draws, and somewhat wider;
   !> leaves it unchanged if this covariance is not positive definite.
   !>
   !> x       (n, draws) coordinates
   !> weight  (draws), with the sum 1
   subroutine refit_proposal(proposal, x, weight)
      type(proposal_t), intent(inout) :: proposal
      real(wp), intent(in) :: x(:, :), weight(:)
      real(wp), parameter :: widening = 1.2_wp
      real(wp), dimension(size(x, 1), size(x, 1)) :: covariance
      real(wp) :: mean(size(x, 1))
      logical :: positive
      integer :: i

      mean = matmul(x, weight)
      covariance = 0
      do i = 1, size(weight)
         covariance = covariance + weight(i)*outer(x(:, i) - mean, x(:, i) - mean)
      end do
      call factor_covariance(covariance, positive)
      if (.not. positive) return
      proposal%mode = mean
      proposal%axes = covariance
      proposal%width = widening
   end subroutine refit_proposal

   !> Computes the lower triangle L of a covariance L L', with a diagonal increased by the possible
   !> round-off.
   !>
   !> matrix    (n, n) on entry the covariance, on return L
   !> positive  .false.: the matrix is not positive definite, and undefined on return
   subroutine factor_covariance(matrix, positive)
      real(wp), intent(inout) :: matrix(:, :)
      logical, intent(out) :: positive
      integer :: info, k, n

      n = size(matrix, 1)
      do k = 1, n
         matrix(k, k) = matrix(k, k)*(1 + 1e-8_wp) + tiny(1.0_wp)
      end do
      call dpotrf('L', n, matrix, n, info)
      positive = info == 0
      do k = 2, n
         matrix(:k - 1, k) = 0
      end do
   end subroutine factor_covariance

end module beamid_proposals
