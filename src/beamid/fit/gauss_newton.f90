!> Computes Gauss-Newton steps within bounds: the minimum of a sum of squares that linear theory
!> predicts from a point, the residuals that remain there, and the distance to it. Searches stop by
!> this distance, and `beamid_optimality` checks their results with it.
module beamid_gauss_newton
   use beamid_condensation, only: condense_matrix, condensed_t, few_rows
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgelsy
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: gauss_newton_t, gauss_newton_step, least_squares_step, scales_of

   !> The minimum that linear theory predicts.
   type :: gauss_newton_t
      real(wp), allocatable :: step(:)      !< (n) to the minimum, physical parameters
      real(wp), allocatable :: residual(:)  !< (m) r + jacobian step
      !> Distance to the minimum in standard errors, sqrt((J - J_min)/s^2) with s^2 = J_min/(m - n).
      !> It is the shift, in units of its own standard error, of the parameter or combination of
      !> parameters that the step moves most in these units.
      real(wp) :: distance = 0
      integer :: rank = 0   !< number of independent directions in which parameters have an effect
   end type gauss_newton_t

contains

   !> Minimises |residual + jacobian step| with parameters + step inside the bounds. A variable that
   !> reaches a bound stays there, and the others move on.
   !>
   !> jacobian    (m, n) d residual/d parameter
   !> residual    (m)
   !> parameters  (n) inside the bounds of the variables
   !> variables   (n) with their bounds and magnitudes
   !> threshold   relative error of the columns; directions with a smaller relative effect are left
   !>             unchanged
   !> residuals   number of residuals if the rows have been condensed; default: m
   function gauss_newton_step(jacobian, residual, parameters, variables, threshold, &
      residuals) result(ahead)
      real(wp), intent(in) :: jacobian(:, :), residual(:), parameters(:), threshold
      type(variable_t), intent(in) :: variables(:)
      integer, intent(in), optional :: residuals
      type(gauss_newton_t) :: ahead
      real(wp) :: p(size(parameters)), step(size(parameters)), share(size(parameters)), left
      logical :: free(size(parameters))
      integer :: hit, k, m, rank

      m = size(residual)
      if (present(residuals)) m = residuals
      ! A parameter that the search put on a bound may lie beyond it by round-off.
      p = min(max(parameters, variables%lower), variables%upper)
      free = .true.
      ahead%residual = residual
      do while (any(free))
         call least_squares_step(jacobian, ahead%residual, scales_of(variables, p), free, &
            threshold, step, rank)
         ahead%rank = max(ahead%rank, rank)
         ! The share of the step at which each variable reaches a bound.
         share = 1
         do k = 1, size(p)
            if (p(k) + step(k) < variables(k)%lower) share(k) = (variables(k)%lower - p(k))/step(k)
            if (p(k) + step(k) > variables(k)%upper) share(k) = (variables(k)%upper - p(k))/step(k)
         end do
         hit = minloc(share, dim=1)
         p = min(max(p + share(hit)*step, variables%lower), variables%upper)
         ahead%residual = ahead%residual + share(hit)*matmul(jacobian, step)
         if (share(hit) >= 1) exit
         free(hit) = .false.
      end do
      ahead%step = p - parameters
      left = sum(ahead%residual**2)
      ahead%distance = sqrt(max(0.0_wp, sum(residual**2) - left) &
         /max(left/max(1, m - size(p)), tiny(left)))
   end function gauss_newton_step

   !> Returns the scale, (n), of relative changes of each parameter: the larger of its absolute
   !> value and its magnitude.
   pure function scales_of(variables, parameters) result(scales)
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: parameters(:)
      real(wp) :: scales(size(parameters))

      scales = max(abs(parameters), variables%magnitude)
   end function scales_of

   !> Minimises |r + jacobian step|, and returns the shortest of the minimising steps, measured in
   !> relative changes. Uses LAPACK's least squares by QR with column pivoting (`dgelsy`), for many
   !> rows after they have been condensed.
   !>
   !> jacobian   (m, n)
   !> residual   (m) r
   !> scales     (n) > 0, of relative changes
   !> free       (n) whether a variable moves
   !> threshold  smallest reciprocal condition number of the columns that are used
   !> step       (n) 0 for variables that do not move
   !> rank       number of independent directions in which the moving variables have an effect
   subroutine least_squares_step(jacobian, residual, scales, free, threshold, step, rank)
      real(wp), intent(in) :: jacobian(:, :), residual(:), scales(:), threshold
      logical, intent(in) :: free(:)
      real(wp), intent(out) :: step(:)
      integer, intent(out) :: rank
      real(wp), allocatable :: a(:, :), b(:)
      type(condensed_t) :: condensed
      real(wp) :: work(67*(size(scales) + 1))
      integer :: columns(count(free)), pivots(count(free)), info, k, m, n

      columns = pack([(k, k=1, size(free))], free)
      m = size(residual)
      n = size(columns)
      if (m < few_rows) then
         a = jacobian(:, columns)
         b = -residual
      else
         call condense_matrix(jacobian, residual, condensed)
         a = condensed%factor(:, columns)
         b = -condensed%y
         m = size(b)
      end if
      do k = 1, n
         a(:, k) = a(:, k)*scales(columns(k))
      end do
      if (m < n) b = [b, spread(0.0_wp, 1, n - m)]
      pivots = 0
      call dgelsy(m, n, 1, a, max(1, m), b, size(b), pivots, threshold, rank, work, size(work), &
         info)
      step = 0
      step(columns) = b(:n)*scales(columns)
   end subroutine least_squares_step

end module beamid_gauss_newton
