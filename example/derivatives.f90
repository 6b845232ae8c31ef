!> A response with its derivatives by two parameters, beside differences.
program derivatives
   use beamid, only: equations_t, error_t, excitation_t, free_index, galerkin_of, galerkin_t, &
      mesh_t, modal_t, new_equations, new_pulse, response_t, structure_t, work_t, wp
   implicit none
   real(wp), parameter :: t(5) = [1, 2, 3, 4, 5]
   type(structure_t) :: beam, other
   type(excitation_t) :: force
   type(galerkin_t), target :: galerkin
   type(equations_t), target :: equations
   type(modal_t) :: solver
   type(response_t) :: response, shifted
   type(response_t), allocatable :: sensitivities(:)
   type(work_t) :: work
   type(error_t), allocatable :: error
   real(wp), parameter :: step = 1e-4_wp
   integer :: k

   beam = structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.005_wp, m_T=0.15_wp)
   force = new_pulse(amplitude=1.0_wp, duration=0.05_wp)
   galerkin = galerkin_of(mesh_t(elements=8), beam)
   call solver%prepare(galerkin, error)
   if (allocated(error)) error stop error%message

   equations = new_equations(galerkin, beam, force)
   call solver%differentiate(equations, force, t, [free_index('E'), free_index('m_T')], response, &
      sensitivities, work, error)
   if (allocated(error)) error stop error%message

   other = beam
   other%E = beam%E + step
   equations = new_equations(galerkin, other, force)
   call solver%respond(equations, force, t, shifted, work, error)
   if (allocated(error)) error stop error%message

   print '(a)', '    t acceleration        by m_T          by E    difference'
   do k = 1, size(t)
      print '(f5.1,f13.6,3f14.6)', t(k), response%acceleration(k), &
         sensitivities(2)%acceleration(k), sensitivities(1)%acceleration(k), &
         (shifted%acceleration(k) - response%acceleration(k))/step
   end do
end program derivatives
