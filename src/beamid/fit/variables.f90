!> Transforms physical parameters to the variables z of a search, which have no bounds and are of
!> order one. MINPACK moves z; the model gets the physical values.
!>
!> A smooth change of variable keeps each parameter inside its bounds. Far from a bound the change
!> is close to linear, so that the search runs as it would without bounds. Every search starts at
!> z = 1.
module beamid_variables
   use beamid_kinds, only: wp
   implicit none
   private

   public :: variable_t, new_variable, unbounded, has

   !> Value of a bound that does not exist (with a minus sign for a lower bound).
   real(wp), parameter :: unbounded = huge(1.0_wp)

   !> Largest change of the logarithm of a parameter in a search; it prevents overflow.
   real(wp), parameter :: farthest = 50

   !> A parameter with its bounds and its change of variable. The unit of `start`, `lower`, `upper`,
   !> `magnitude` and `scale` is that of the parameter.
   type :: variable_t
      real(wp) :: start = 0                    !< value at z = 1
      real(wp) :: lower = -unbounded           !< lower bound
      real(wp) :: upper = unbounded            !< upper bound
      real(wp) :: magnitude = 1                !< moderate value of the parameter, > 0
      logical :: is_logarithmic = .false.      !< its logarithm is varied; the only bound is 0
      real(wp), private :: scale = 1           !< unit of the change of variable
      !> z = 1 corresponds to this argument x of the formulas in `value`
      real(wp), private :: x = 1
   contains
      procedure :: value, derivative, from, is_at_bound, nearest_bound
   end type variable_t

contains

   !> Returns the variable of a parameter.
   !>
   !> start         value at z = 1, lower <= start <= upper. At a bound every smooth change of
   !>               variable has zero slope. A search from a bound therefore starts one per cent of
   !>               `magnitude` (at most 1/1000 of the interval) inside; the component `start` tells
   !>               where
   !> lower, upper  bounds; -unbounded, unbounded: none
   !> magnitude     moderate value of the parameter, > 0
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

   !> Returns the parameter at z. With x = z self%x it is lower + scale (sqrt(1 + x**2) - 1) with a
   !> lower bound, the mirror image with an upper bound, lower + scale sin(x/2)**2 with two bounds,
   !> and start + scale (z - 1) without bounds.
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

   !> Returns the derivative d value/d z.
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

   !> Returns the same variable with another start.
   elemental type(variable_t) function from(self, start)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: start

      from = new_variable(start, self%lower, self%upper, self%magnitude)
      from%is_logarithmic = self%is_logarithmic
   end function from

   !> Returns whether a value is nearer to a bound than 1e-4 of the magnitude.
   elemental logical function is_at_bound(self, value)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: value

      is_at_bound = has(self%lower) .and. value - self%lower < 1e-4_wp*self%magnitude .or. &
         has(self%upper) .and. self%upper - value < 1e-4_wp*self%magnitude
   end function is_at_bound

   !> Returns the bound that is nearest to a value.
   elemental real(wp) function nearest_bound(self, value)
      class(variable_t), intent(in) :: self
      real(wp), intent(in) :: value

      nearest_bound = merge(self%lower, self%upper, .not. has(self%upper) .or. &
         has(self%lower) .and. value - self%lower <= self%upper - value)
   end function nearest_bound

   !> Returns whether a bound exists.
   elemental logical function has(bound)
      real(wp), intent(in) :: bound

      has = abs(bound) < unbounded
   end function has

end module beamid_variables
