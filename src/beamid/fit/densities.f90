!> Declares the probability densities that the samplers draw from, and coordinates without bounds
!> for their parameters.
module beamid_densities
   use beamid_kinds, only: wp
   use beamid_variables, only: has, unbounded, variable_t
   implicit none
   private

   public :: density_t, coordinate_t, new_coordinate, without_bounds, evaluate_at, impossible

   !> Logarithm of the density where the density is zero or cannot be computed.
   real(wp), parameter :: impossible = -huge(1.0_wp)

   !> A probability density of n parameters.
   type, abstract :: density_t
      !> if above 0, the density to the power -1/power is close to a polynomial near the mode, as a
      !> sum of squares is; if 0, the logarithm of the density is
      real(wp) :: power = 0
   contains
      procedure(evaluate), deferred :: evaluate
   end type density_t

   abstract interface
      !> Computes the logarithm of the density and, if requested, its derivatives.
      !>
      !> q          (n) parameters within their bounds
      !> value      log density up to a constant; `impossible` where it cannot be computed
      !> gradient   (n) d value/d q
      !> curvature  (n, n) approximation of -d2 value/d q2, positive semidefinite
      subroutine evaluate(self, q, value, gradient, curvature)
         import :: density_t, wp
         class(density_t), intent(inout) :: self
         real(wp), intent(in) :: q(:)
         real(wp), intent(out) :: value
         real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      end subroutine evaluate
   end interface

   !> Maps a parameter to a coordinate x without bounds. With one bound x is the logarithm of the
   !> distance from the bound, with two bounds the logarithm of the ratio of the distances from
   !> them, and without bounds the parameter over its magnitude.
   type :: coordinate_t
      !> bounds and moderate value of the parameter, in its unit
      real(wp) :: lower = -unbounded, upper = unbounded, magnitude = 1
      !> outside these values the density is 0, whatever the bounds of x say [unit of the parameter]
      real(wp) :: least = -unbounded, most = unbounded
   contains
      procedure :: value, of, slope, log_slope, bend, allows
   end type coordinate_t

contains

   !> Returns the coordinate of a variable of a fit.
   elemental type(coordinate_t) function new_coordinate(variable)
      type(variable_t), intent(in) :: variable

      new_coordinate = coordinate_t(variable%lower, variable%upper, variable%magnitude, &
         variable%lower, variable%upper)
   end function new_coordinate

   !> Returns a coordinate that does not depend on the bounds: the logarithm of a parameter whose
   !> lower bound is at least 0, otherwise the parameter itself. If the data determine only a
   !> product of powers of parameters, their logarithms vary along a straight line. In a coordinate
   !> that depends on a bound far away, this line is curved. The bounds still limit the density.
   elemental type(coordinate_t) function without_bounds(coordinate)
      type(coordinate_t), intent(in) :: coordinate

      without_bounds = coordinate
      without_bounds%lower = merge(0.0_wp, -unbounded, coordinate%lower >= 0)
      without_bounds%upper = unbounded
   end function without_bounds

   !> Computes the log density of the parameters at a point given by its coordinates; `impossible`
   !> outside the bounds. The volume of the coordinates is not included.
   !>
   !> x                    (n) coordinates
   !> gradient, curvature  derivatives with respect to the parameters, not the coordinates, as of
   !>                      `evaluate`
   subroutine evaluate_at(density, coordinate, x, value, gradient, curvature)
      class(density_t), intent(inout) :: density
      type(coordinate_t), intent(in) :: coordinate(:)
      real(wp), intent(in) :: x(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      real(wp) :: q(size(x))

      q = coordinate%value(x)
      value = impossible
      if (all(coordinate%allows(q))) call density%evaluate(q, value, gradient, curvature)
   end subroutine evaluate_at

   !> Tells whether a value of the parameter is within its bounds.
   elemental logical function allows(self, q)
      class(coordinate_t), intent(in) :: self
      real(wp), intent(in) :: q

      allows = q >= self%least .and. q <= self%most
   end function allows

   !> Returns the parameter at x.
   elemental real(wp) function value(self, x)
      class(coordinate_t), intent(in) :: self
      real(wp), intent(in) :: x

      if (has(self%lower) .and. has(self%upper)) then
         value = self%lower + (self%upper - self%lower)*logistic(x)
      else if (has(self%lower)) then
         value = self%lower + exp(min(x, 700.0_wp))
      else if (has(self%upper)) then
         value = self%upper - exp(min(x, 700.0_wp))
      else
         value = x*self%magnitude
      end if
   end function value

   !> Returns the coordinate x of a parameter value; at a bound that of a point slightly inside.
   elemental real(wp) function of(self, value) result(x)
      class(coordinate_t), intent(in) :: self
      real(wp), intent(in) :: value
      real(wp) :: nearest

      nearest = 1e-6_wp*self%magnitude
      if (has(self%lower) .and. has(self%upper)) then
         nearest = min(nearest, 1e-3_wp*(self%upper - self%lower))
         x = log(max(value - self%lower, nearest)/max(self%upper - value, nearest))
      else if (has(self%lower)) then
         x = log(max(value - self%lower, nearest))
      else if (has(self%upper)) then
         x = log(max(self%upper - value, nearest))
      else
         x = value/self%magnitude
      end if
   end function of

   !> Returns the derivative d value/d x.
   elemental real(wp) function slope(self, x)
      class(coordinate_t), intent(in) :: self
      real(wp), intent(in) :: x

      slope = exp(self%log_slope(x))
      if (has(self%upper) .and. .not. has(self%lower)) slope = -slope
   end function slope

   !> Returns log |d value/d x|, which changes the density when the coordinate changes.
   elemental real(wp) function log_slope(self, x)
      class(coordinate_t), intent(in) :: self
      real(wp), intent(in) :: x

      if (has(self%lower) .and. has(self%upper)) then
         log_slope = log(self%upper - self%lower) - abs(x) - 2*log(1 + exp(-abs(x)))
      else if (has(self%lower) .or. has(self%upper)) then
         log_slope = x
      else
         log_slope = log(self%magnitude)
      end if
   end function log_slope

   !> Returns the derivative of `log_slope` by x.
   elemental real(wp) function bend(self, x)
      class(coordinate_t), intent(in) :: self
      real(wp), intent(in) :: x

      bend = merge(1.0_wp, 0.0_wp, has(self%lower) .or. has(self%upper))
      if (has(self%lower) .and. has(self%upper)) bend = 1 - 2*logistic(x)
   end function bend

   !> Returns the logistic function 1/(1 + exp(-x)), without overflow.
   elemental real(wp) function logistic(x)
      real(wp), intent(in) :: x

      logistic = 1/(1 + exp(-max(x, -700.0_wp)))
   end function logistic

end module beamid_densities
