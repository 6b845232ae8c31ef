!> Regressions that cannot be computed everywhere.
module edged_curves
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: curve_t

   !> y by a polynomial, by Michaelis and Menten's v x/(K + x), or by A (1 - exp(-k x)); it cannot
   !> be computed where a parameter is beyond an edge, or at it.
   type, extends(smooth_problem_t) :: curve_t
      character(len=12) :: law = 'polynomial'
      real(wp), allocatable :: x(:), y(:)
      integer :: refused = 0                       !< the parameter that must not lie ...
      real(wp) :: least = -unbounded, most = unbounded   !< ... here or outside
   contains
      procedure :: residuals
      procedure :: jacobian
   end type curve_t

contains

   subroutine residuals(self, parameters, r, error)
      class(curve_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call self%jacobian(parameters, r, jac, error)
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(curve_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      r = 0
      jac = 0
      if (self%refused > 0) then
         if (parameters(self%refused) <= self%least .or. parameters(self%refused) >= &
            self%most) then
            call failure(error, 'the curve: no values beyond its edge')
            return
         end if
      end if
      associate (x => self%x, p => parameters)
         select case (self%law)
         case ('polynomial')
            jac(:, 1) = 1
            jac(:, 2) = x
            jac(:, 3) = x**2
            r = p(1) + p(2)*x + p(3)*x**2 - self%y
         case ('proportional')
            jac(:, 1) = x
            r = p(1)*x - self%y
         case ('hyperbola')
            jac(:, 1) = x/(p(2) + x)
            jac(:, 2) = -p(1)*x/(p(2) + x)**2
            r = p(1)*x/(p(2) + x) - self%y
         case ('plateau')
            jac(:, 1) = 1 - exp(-p(2)*x)
            jac(:, 2) = p(1)*x*exp(-p(2)*x)
            r = p(1)*(1 - exp(-p(2)*x)) - self%y
         end select
      end associate
   end subroutine jacobian

end module edged_curves
