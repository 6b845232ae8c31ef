!> Do 95 % intervals contain the truth in 95 % of the records? Table 4.1's structure with white noise.
program test_coverage
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, simulate, simulation_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index, free_names
   use beamid_strings, only: to_text
   use beamid_variables, only: unbounded
   use checks, only: check, finish
   implicit none

   integer, parameter :: records = 2000, parameters = 4
   !> Binomial: 2000 records of 95 % give 1900 +- 9.7; three standard deviations are 1.5 %.
   real(wp), parameter :: least = 0.935_wp, most = 0.965_wp
   type(model_t) :: model
   type(mesh_t) :: mesh
   type(stage_t) :: stage
   type(simulation_t) :: clean
   type(stage_fit_t), allocatable :: fits(:)
   type(error_t), allocatable :: error
   real(wp) :: t(49), truth(parameters), sd
   integer :: k, p, inside(parameters), failed

   model%structure%length = 4
   model%structure%rho = 0.03_wp
   model%structure%E = 80
   model%structure%I = 1
   model%structure%c_D = 0.005_wp
   model%structure%m_T = 0.15_wp
   model%structure%m_H = 0.04_wp
   model%structure%c_H = 0.004_wp
   model%structure%k_H = 0.3_wp
   model%excitation = new_pulse(1.0_wp, 0.05_wp)
   model%observation = observation_t(1, 0.1_wp)
   allocate (modal_t :: model%solver)
   ! The model that makes the records is the one that is fitted: no discretization error.
   mesh = mesh_t(degree=3, elements=4, gauss_points=4, panels=1)
   t = [(0.1_wp*k, k=2, 50)]
   call simulate(model, mesh, t, clean, error)
   sd = 0.02_wp*norm2(clean%acceleration)/sqrt(real(size(t), wp))
   stage%free = [free_index('c_D'), free_index('m_H'), free_index('c_H'), free_index('k_H')]
   truth = [0.005_wp, 0.04_wp, 0.004_wp, 0.3_wp]
   stage%lower = [(0.0_wp, p=1, parameters)]
   stage%upper = [(unbounded, p=1, parameters)]

   inside = 0
   failed = 0
   do k = 1, records
      call identify(model, mesh, [stage], t, clean%acceleration + gaussian_noise(size(t), sd, k), fits, &
         error)
      if (allocated(error)) then
         failed = failed + 1
         cycle
      end if
      do p = 1, parameters
         if (abs(fits(1)%fit%estimate(p) - truth(p)) <= fits(1)%statistics%half_width(p)) &
            inside(p) = inside(p) + 1
      end do
   end do
   call check('every record can be fitted', failed == 0, to_text(failed)//' failed')
   do p = 2, parameters
      call check('coverage of '//trim(free_names(stage%free(p))), &
         real(inside(p), wp)/records >= least .and. real(inside(p), wp)/records <= most, &
         to_text(100.0_wp*inside(p)/records)//' %, allowed 93.5 to 96.5')
   end do
   ! Noise of 2 % leaves c_D undetermined: its estimate piles up at the bound 0, from where an
   ! interval wider than the value contains the truth more often than promised.
   call check('coverage of c_D, at its bound, is no less than promised', &
      real(inside(1), wp)/records >= least, to_text(100.0_wp*inside(1)/records)//' %')
   call finish('coverage')
end program test_coverage
