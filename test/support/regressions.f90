!> Nonlinear regressions of NIST StRD, public data and certified values, with their derivatives.
module regressions
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   implicit none
   private

   public :: regression_t, misra1a, boxbod, mgh09

   !> y = b1 (1 - exp(-b2 x)), or MGH09's y = b1 (x**2 + b2 x)/(x**2 + b3 x + b4).
   type, extends(smooth_problem_t) :: regression_t
      character(len=7) :: name = ''
      logical :: rational = .false.
      real(wp), allocatable :: x(:), y(:)
      !> certified, to eleven digits: parameters, their standard deviations, the sum of squares
      real(wp), allocatable :: b(:), sd(:)
      real(wp) :: J = 0
   contains
      procedure :: residuals
      procedure :: jacobian
   end type regression_t

contains

   type(regression_t) function misra1a(exact)
      logical, intent(in) :: exact

      misra1a%name = 'Misra1a'
      misra1a%exact = exact
      misra1a%b = [2.3894212918e2_wp, 5.5015643181e-4_wp]
      misra1a%sd = [2.7070075241_wp, 7.2668688436e-6_wp]
      misra1a%J = 1.2455138894e-1_wp
      misra1a%y = [10.07_wp, 14.73_wp, 17.94_wp, 23.93_wp, 29.61_wp, 35.18_wp, 40.02_wp, 44.82_wp, &
         50.76_wp, 55.05_wp, 61.01_wp, 66.40_wp, 75.47_wp, 81.78_wp]
      misra1a%x = [77.6_wp, 114.9_wp, 141.1_wp, 190.8_wp, 239.9_wp, 289.0_wp, 332.8_wp, 378.4_wp, &
         434.8_wp, 477.3_wp, 536.8_wp, 593.1_wp, 689.1_wp, 760.0_wp]
   end function misra1a

   type(regression_t) function boxbod(exact)
      logical, intent(in) :: exact

      boxbod%name = 'BoxBOD'
      boxbod%exact = exact
      boxbod%b = [2.1380940889e2_wp, 5.4723748542e-1_wp]
      boxbod%sd = [1.2354515176e1_wp, 1.0455993237e-1_wp]
      boxbod%J = 1.1680088766e3_wp
      boxbod%y = [109.0_wp, 149.0_wp, 149.0_wp, 191.0_wp, 213.0_wp, 224.0_wp]
      boxbod%x = [1.0_wp, 2.0_wp, 3.0_wp, 5.0_wp, 7.0_wp, 10.0_wp]
   end function boxbod

   type(regression_t) function mgh09(exact)
      logical, intent(in) :: exact

      mgh09%name = 'MGH09'
      mgh09%exact = exact
      mgh09%b = [1.9280693458e-1_wp, 1.9128232873e-1_wp, 1.2305650693e-1_wp, &
         1.3606233068e-1_wp]
      mgh09%sd = [real(wp) ::]
      mgh09%J = 3.0750560385e-4_wp
      mgh09%rational = .true.
      mgh09%y = [0.1957_wp, 0.1947_wp, 0.1735_wp, 0.1600_wp, 0.0844_wp, 0.0627_wp, 0.0456_wp, &
         0.0342_wp, 0.0323_wp, 0.0235_wp, 0.0246_wp]
      mgh09%x = [4.0_wp, 2.0_wp, 1.0_wp, 0.5_wp, 0.25_wp, 0.167_wp, 0.125_wp, 0.1_wp, 0.0833_wp, &
         0.0714_wp, 0.0625_wp]
   end function mgh09

   subroutine residuals(self, parameters, r, error)
      class(regression_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      if (size(r) /= size(self%y)) call failure(error, 'wrong number of residuals')
      associate (b => parameters, x => self%x)
         if (self%rational) then
            r = b(1)*(x**2 + b(2)*x)/(x**2 + b(3)*x + b(4)) - self%y
         else
            r = b(1)*(1 - exp(-b(2)*x)) - self%y
         end if
      end associate
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(regression_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: below(size(r))

      call self%residuals(parameters, r, error)
      associate (b => parameters, x => self%x)
         if (self%rational) then
            below = x**2 + b(3)*x + b(4)
            jac(:, 1) = (x**2 + b(2)*x)/below
            jac(:, 2) = b(1)*x/below
            jac(:, 3) = -b(1)*(x**2 + b(2)*x)*x/below**2
            jac(:, 4) = -b(1)*(x**2 + b(2)*x)/below**2
         else
            jac(:, 1) = 1 - exp(-b(2)*x)
            jac(:, 2) = b(1)*x*exp(-b(2)*x)
         end if
      end associate
   end subroutine jacobian

end module regressions
