!> Natural frequencies, damping ratios and mode shapes of a strip with a sensor near its tip.
program natural_modes
   use beamid, only: damped_roots, equations_t, error_t, galerkin_of, galerkin_t, mesh_t, &
      mode_shapes, natural_frequencies, new_equations, sensor_t, structure_t, wp
   implicit none
   type(structure_t) :: strip
   type(galerkin_t), target :: galerkin   ! the equations point to it
   type(equations_t) :: equations
   type(error_t), allocatable :: error
   complex(wp), allocatable :: roots(:), shapes(:, :)
   real(wp), parameter :: pi = acos(-1.0_wp)
   real(wp), allocatable :: omega(:)
   real(wp) :: x(6)
   type(mesh_t), parameter :: mesh = mesh_t(degree=5, elements=16, gauss_points=6)
   integer :: k

   ! Steel, 500 x 30 x 2 mm.
   strip = structure_t(length=0.5_wp, rho=7850*0.03_wp*0.002_wp, E=2.05e11_wp, &
      I=0.03_wp*0.002_wp**3/12, c_D=1e6_wp, gamma=0.05_wp)
   strip%sensors = 1
   strip%sensor(1) = sensor_t(m_S=0.012_wp, x_S=0.48_wp)

   call natural_frequencies(strip, mesh, omega, error)
   if (allocated(error)) error stop error%message
   print '(a,3f10.4)', 'without damping [Hz]:', omega(:3)/(2*pi)

   galerkin = galerkin_of(mesh, strip)
   equations = new_equations(galerkin, strip)
   call damped_roots(equations, roots, error)
   if (allocated(error)) error stop error%message
   x = strip%length*[(0.2_wp*k, k=0, 5)]
   call mode_shapes(equations, roots(:3), x, shapes, error)
   if (allocated(error)) error stop error%message

   print '(a)', ' mode   frequency [Hz]   damping ratio   shape at 0, .2, ..., 1 of the length'
   do k = 1, 3
      print '(i5,f17.4,f16.6,a,6f8.4)', k, abs(roots(k))/(2*pi), &
         -real(roots(k))/abs(roots(k)), '  ', real(shapes(:, k))
   end do
end program natural_modes
