!> What an accelerometer on the tip of a beam sees of a pulse, with and without a hose.
program simulate_pulse
   use beamid, only: cvode_t, error_t, gaussian_noise, hose_t, mesh_t, modal_t, model_t, &
      new_pulse, simulate, simulation_t, structure_t, wp
   implicit none
   type(model_t) :: model
   type(simulation_t) :: with_hose, without, integrated
   type(error_t), allocatable :: error
   real(wp) :: t(51), record(51)
   integer :: k

   model%structure = structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.005_wp, m_T=0.15_wp, &
      hose=hose_t(m_H=0.04_wp, c_H=0.004_wp, k_H=0.3_wp))
   model%excitation = new_pulse(amplitude=1.0_wp, duration=0.05_wp)
   model%solver = modal_t()
   t = [(0.1_wp*k, k=0, 50)]

   call simulate(model, mesh_t(elements=8), t, with_hose, error)
   if (allocated(error)) error stop error%message
   ! What a recorder stores: the same seed always gives the same noise.
   record = with_hose%acceleration + gaussian_noise(size(t), sd=0.01_wp, seed=1)

   ! The same by an integrator.
   model%solver = cvode_t(rtol=1e-9_wp)
   call simulate(model, mesh_t(elements=8), t, integrated, error)
   if (allocated(error)) error stop error%message

   model%solver = modal_t()
   model%structure%hose(1)%m_H = 0
   model%structure%hose(1)%c_H = 0
   model%structure%hose(1)%k_H = 0
   call simulate(model, mesh_t(elements=8), t, without, error)
   if (allocated(error)) error stop error%message

   print '(a)', '      t   with hose     without    a record'
   do k = 11, 51, 10
      print '(f7.1,3f12.5)', t(k), with_hose%acceleration(k), without%acceleration(k), record(k)
   end do
   print '(a,es9.2)', 'integrator and exact response differ by', &
      maxval(abs(integrated%acceleration - with_hose%acceleration))
end program simulate_pulse
