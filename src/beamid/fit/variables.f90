!> Parameters as a search sees them: without bounds, and of order one.
!>
!> A smooth change of variable keeps each parameter inside its bounds. Far from a bound it is close
!> to linear, so that the search runs as it would without bounds; every search starts at z = 1.
module beamid_variables
   use beamid_kinds, only: wp
   implicit none
   private

   public :: variable_t, new_variable, unbounded, has

   !> Stands for a bound that is not there.
   real(wp), parameter :: unbounded = huge(1.0_wp)

   !> A search by a logarithm goes no farther, and no number is lost.
   real(wp), parameter :: farthest = 50

   type :: variable_t
      real(wp) :: start = 0                    !< value at z = 1
      real(wp) :: lower = -unbounded
      real(wp) :: upper = unbounded
      real(wp) :: magnitude = 1                !< what a moderate value is
      logical :: is_logarithmic = .false.      !< searched for by its logarithm; no bounds but 0
      real(wp), private :: scale = 1           !< size of the parameter's region of interest
      real(wp), private :: x = 1               !< x = z*self%x is the argument of the formulas below
   contains
      procedure :: value
      procedure :: derivative
      procedure :: from
      procedure :: is_at_bound
      procedure :: nearest_bound
   end type variable_t

contains

   !> start         lower <= start <= upper. At a bound every smooth change of variable is
   !>               stationary: a search from there starts one per cent of `magnitude` (at most
   !>               1/1000 of the interval) inside; component `start` tells where
   !> lower, upper  or -unbounded, unbounded
   !> magnitude     what a moderate value of the parameter is, > 0
   pure function new_variable(start, lower, upper, magnitude) result(self)
      real(wp), intent(in) :: start, lower, upper, magnitude
      type(variable_t) :: self
      real(wp) :: inside, distance

      self%lower = lower
      self%upper = upper
      self%start = start
      self%magnitude = magnitude
      inside = 1e-2_wp*magnitude
      if (has(lower) .and. has(upper)) inside = min(inside, 1e-3_wp*(upper - lower))
      if (has(lower) .and. start - lower < 1e-4_wp*inside) then
         self%start = lower + inside
      else if (has(upper) .and. upper - start < 1e-4_wp*inside) then
         self%start = upper - inside
      end if

      if (has(lower) .and. has(upper)) then
         self%scale = upper - lower
         self%x = 2*asin(sqrt((self%start - lower)/self%scale))
      else if (has(lower) .or. has(upper)) then
         distance = abs(self%start - merge(lower, upper, has(lower)))
         self%scale = merge(magnitude, distance, abs(self%start - start) > 0)
         self%x = sqrt((distance/self%scale)*(distance/self%scale + 2))
      else
         self%scale = merge(abs(start), magnitude, abs(start) > 0)
      end if
   end function new_variable

   !> The parameter at z: lower + scale (sqrt(1 + x**2) - 1) or its mirror image with one bound,
   !> lower + scale sin(x/2)**2 with two, start + scale (z - 1) with none; x = z*self%x.
   elemental real(wp) function value(self, z)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: z
      real(wp) :: x

      x = z*self%x
      if (self%is_logarithmic) then
         value = self%start*exp(min(max(z - 1, -farthest), farthest))
      else if (has(self%lower) .and. has(self%upper)) then
         value = min(self%lower + self%scale*sin(x/2)**2, self%upper)
      else if (has(self%lower)) then
         value = self%lower + self%scale*(x**2/(sqrt(1 + x**2) + 1))
      else if (has(self%upper)) then
         value = self%upper - self%scale*(x**2/(sqrt(1 + x**2) + 1))
      else
         value = self%start + self%scale*(z - 1)
      end if
   end function value

   !> d value/d z.
   elemental real(wp) function derivative(self, z)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: z
      real(wp) :: x

      x = z*self%x
      if (self%is_logarithmic) then
         derivative = self%start*exp(min(max(z - 1, -farthest), farthest))
      else if (has(self%lower) .and. has(self%upper)) then
         derivative = self%x*self%scale*sin(x)/2
      else if (has(self%lower)) then
         derivative = self%x*self%scale*x/sqrt(1 + x**2)
      else if (has(self%upper)) then
         derivative = -self%x*self%scale*x/sqrt(1 + x**2)
      else
         derivative = self%scale
      end if
   end function derivative

   !> The same variable with another start.
   elemental type(variable_t) function from(self, start)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: start

      from = new_variable(start, self%lower, self%upper, self%magnitude)
      from%is_logarithmic = self%is_logarithmic
   end function from

   !> Whether a value is so near a bound that it might as well lie on it.
   elemental logical function is_at_bound(self, value)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: value

      is_at_bound = has(self%lower) .and. value - self%lower < 1e-4_wp*self%magnitude .or. &
         has(self%upper) .and. self%upper - value < 1e-4_wp*self%magnitude
   end function is_at_bound

   !> The bound that is nearest to a value.
   elemental real(wp) function nearest_bound(self, value)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: value

      nearest_bound = merge(self%lower, self%upper, .not. has(self%upper) .or. &
         has(self%lower) .and. value - self%lower <= self%upper - value)
   end function nearest_bound

   !> Whether a bound is there.
   elemental logical function has(bound)
      real(wp), intent(in) :: bound

      has = abs(bound) < unbounded
   end function has

end module beamid_variables
