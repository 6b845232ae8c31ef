!> Estimates the viscosity of the beam and the parameters of the hose from the record of Table 4.1.
!> Run it in the root folder of the project.
program fit_record
   use beamid, only: error_t, free_index, free_names, hose_t, identify, mesh_t, modal_t, model_t, &
      new_pulse, observation_t, read_record, recording_t, stage_fit_t, stage_t, structure_t, wp
   implicit none
   type(model_t) :: model
   type(stage_t) :: stage
   type(recording_t) :: recording
   type(stage_fit_t), allocatable :: fits(:)
   type(error_t), allocatable :: error
   real(wp), allocatable :: t(:), acceleration(:)
   integer :: k

   ! What is known, and a guess of what is not: the search starts there.
   model%structure = structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.0035_wp, m_T=0.15_wp, &
      hose=hose_t(m_H=0.035_wp, c_H=0.0035_wp, k_H=0.4_wp))
   model%excitation = new_pulse(amplitude=1.0_wp, duration=0.05_wp)
   model%observation = observation_t(formula=1, delta=0.1_wp)   ! differences of displacement
   model%solver = modal_t()

   recording%path = 'data/table_4_1_record.csv'
   call read_record(recording, t, acceleration, error)
   if (allocated(error)) error stop error%message

   stage%free = [free_index('c_D'), free_index('m_H'), free_index('c_H'), free_index('k_H')]
   call identify(model, mesh_t(elements=6), [stage], t, acceleration, fits, error)
   if (allocated(error)) error stop error%message

   print '(i0,a,es9.2)', size(t), ' samples, sum of squared residuals', fits(1)%fit%J
   do k = 1, size(stage%free)
      print '(a,f10.6,a,f9.6)', free_names(stage%free(k)), fits(1)%fit%estimate(k), '  +-', &
         fits(1)%statistics%half_width(k)
   end do
end program fit_record
