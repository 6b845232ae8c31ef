!> Mode shapes against what is known of them in closed form, and against undamped ones.
program test_shapes
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_mode_shapes, only: mode_shapes
   use beamid_roots, only: damped_roots
   use beamid_structure, only: free_end, hose_t, sensor_t, structure_t, support_t
   use checks, only: check, check_close, finish
   implicit none

   integer, parameter :: points = 21
   type(mesh_t), parameter :: mesh = mesh_t(5, 24, 6, 1)
   type(galerkin_t), target :: galerkin
   type(equations_t), target :: equations
   type(error_t), allocatable :: error
   complex(wp), allocatable :: roots(:), shapes(:, :)
   real(wp) :: x(points)

   call test_cantilever()
   call test_free_bar()
   call test_support()
   call test_damper()
   call finish('shapes')

contains

   subroutine solve(structure)
      type(structure_t), intent(in) :: structure
      integer :: k

      galerkin = galerkin_of(mesh, structure)
      equations = new_equations(galerkin, structure, new_pulse(0.0_wp, 1.0_wp))
      x = structure%length*[(k/(points - 1.0_wp), k=0, points - 1)]
      call damped_roots(equations, roots, error)
      roots = pack(roots, aimag(roots) > 0)
      roots = roots(:4)
      if (.not. allocated(error)) call mode_shapes(equations, roots, x, shapes, error)
      call check('shapes', .not. allocated(error))
      if (allocated(error)) error stop
   end subroutine solve

   !> cosh - cos - sigma (sinh - sin), with the tabulated roots of cosh z cos z = -1. Kelvin-Voigt
   !> damping leaves the shapes as they are. Quintics err by h**6: 2.4e-5 in mode 4 on 12 elements,
   !> 4e-7 on 24.
   subroutine test_cantilever()
      real(wp), parameter :: z(4) = [1.87510406871196_wp, 4.69409113297418_wp, &
         7.85475743823761_wp, 10.9955407348755_wp]
      real(wp) :: known(points), sigma
      integer :: k

      call solve(structure_t(length=2, rho=0.3_wp, E=50, I=1, c_D=0.02_wp))
      do k = 1, 4
         sigma = (cosh(z(k)) + cos(z(k)))/(sinh(z(k)) + sin(z(k)))
         associate (y => z(k)*x/2)
            known = cosh(y) - cos(y) - sigma*(sinh(y) - sin(y))
         end associate
         known = known/known(points)
         call check_close('cantilever: a shape', maxval(abs(shapes(:, k) - known)), 0.0_wp, 1e-6_wp)
      end do
   end subroutine test_cantilever

   !> cosh + cos - sigma (sinh + sin), with the tabulated roots of cosh z cos z = 1, for a beam that
   !> nothing holds. Its rigid-body motions are orthogonal to these shapes. The tolerance is that of
   !> `test_cantilever`, times (z of mode 4 here/z of mode 4 there)**6 = 4.5.
   subroutine test_free_bar()
      real(wp), parameter :: z(4) = [4.73004074486270_wp, 7.85320462409584_wp, &
         10.9956078380017_wp, 14.1371654912575_wp]
      real(wp) :: known(points), sigma
      integer :: k

      call solve(structure_t(length=2, rho=0.3_wp, E=50, I=1, end=[free_end, free_end]))
      do k = 1, 4
         sigma = (cosh(z(k)) - cos(z(k)))/(sinh(z(k)) - sin(z(k)))
         associate (y => z(k)*x/2)
            known = cosh(y) + cos(y) - sigma*(sinh(y) + sin(y))
         end associate
         known = known/known(1)
         call check_close('free bar: a shape', maxval(abs(shapes(:, k)/shapes(1, k) - known)), &
            0.0_wp, 5e-6_wp)
      end do
   end subroutine test_free_bar

   !> Nothing moves at a rigid support, nor at the clamp.
   subroutine test_support()
      type(structure_t) :: structure

      structure = structure_t(length=1, rho=1, E=1, I=1, c_D=1e-3_wp, &
         sensor=sensor_t(m_S=0.2_wp, x_S=0.9_wp))
      structure%supports = 1
      structure%support(1) = support_t(x_P=0.7_wp)
      call solve(structure)
      call check_close('support: at rest', maxval(abs(shapes(15, :))), 0.0_wp, 1e-12_wp)
      call check_close('clamp: at rest', maxval(abs(shapes(1, :))), 0.0_wp, 1e-12_wp)
      call check_close('largest displacement', maxval(abs(maxval(abs(shapes), dim=1) - 1)), &
         0.0_wp, 1e-12_wp)
   end subroutine test_support

   !> A dashpot at the tip makes points move out of step: no factor makes the shape real. Without
   !> it, damping in proportion to the mass leaves it real.
   subroutine test_damper()
      call solve(structure_t(length=1, rho=1, E=1, I=1, hose=hose_t(m_H=0.2_wp, c_H=0.5_wp, &
         k_H=1)))
      call check('dashpot: complex', maxval(abs(aimag(shapes(:, 2)))) > 1e-3_wp)
      call solve(structure_t(length=1, rho=1, E=1, I=1, gamma=0.4_wp))
      call check_close('air: real', maxval(abs(aimag(shapes))), 0.0_wp, 1e-9_wp)
   end subroutine test_damper

end program test_shapes
