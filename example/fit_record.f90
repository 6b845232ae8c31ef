!> Estimates the viscosity of the beam and the parameters of the hose from the record of Table 4.1.
!> Run it in the root folder of the project.
program fit_record
   use beamid, only: error_t, experiment_t, free_index, hose_t, identify, mesh_t, modal_t, &
      model_t, new_pulse, new_verdict, observation_t, read_record, recording_t, stage_fit_t, &
      stage_t, structure_t, verdict_t, wp
   implicit none
   type(model_t) :: model
   type(mesh_t), parameter :: mesh = mesh_t(elements=6)
   type(stage_t) :: stage
   type(recording_t) :: recording
   type(experiment_t) :: experiments(1)
   type(stage_fit_t), allocatable :: fits(:)
   type(verdict_t) :: verdict
   type(error_t), allocatable :: error
   real(wp) :: ends(2)
   integer :: k

   ! What is known, and a guess of what is not: the search starts there.
   model%structure = structure_t(length=4, rho=0.03_wp, E=80, I=1, c_D=0.0035_wp, m_T=0.15_wp, &
      hose=hose_t(m_H=0.035_wp, c_H=0.0035_wp, k_H=0.4_wp))
   model%excitation = new_pulse(amplitude=1.0_wp, duration=0.05_wp)
   model%observation = observation_t(formula=1, delta=0.1_wp)   ! differences of displacement
   model%solver = modal_t()

   recording%path = 'data/table_4_1_record.csv'
   experiments%excitation = model%excitation
   call read_record(recording, experiments(1)%samples, experiments(1)%measured, error)
   if (allocated(error)) error stop error%message

   stage%free = [free_index('c_D'), free_index('m_H'), free_index('c_H'), free_index('k_H')]
   call identify(model, mesh, [stage], experiments, fits, error)
   ! The search has ended in a minimum. Does the model explain the record there?
   if (.not. allocated(error)) call new_verdict(experiments, mesh, fits(1), verdict, error)
   if (allocated(error)) error stop error%message
   if (verdict%no_fit /= '') error stop verdict%no_fit

   print '(a,f0.2,a)', 'the model explains ', verdict%qualities(1)%fit_percent, ' % of the record'
   do k = 1, size(fits(1)%free)
      ends = fits(1)%quantities(k)%ends(fits(1)%total(k))
      print '(a8,3(f11.6,a))', fits(1)%quantities(k)%name, fits(1)%quantities(k)%value, &
         '  95 % interval', ends(1), ' to', ends(2)
   end do
end program fit_record
