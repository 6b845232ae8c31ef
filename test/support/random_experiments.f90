!> Random beams, and experiments on them.
module random_experiments
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_observation, only: observation_t, new_sampling, sampling_t
   use beamid_structure, only: at_tip, structure_t
   use random_numbers, only: between, decades, uniform
   implicit none
   private

   public :: experiment_t, random_beam, random_structure, wide_structure, random_experiment, samples

   integer, parameter :: samples = 12

   type :: experiment_t
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(mesh_t) :: mesh
      type(sampling_t) :: sampling
   end type experiment_t

contains

   !> Beams of .1 to 30 in length, 10^-2 to 10^2 in density, stiffness over eight decades.
   function random_beam() result(s)
      type(structure_t) :: s

      s%length = decades(-1.0_wp, 1.5_wp)
      s%rho = decades(-2.0_wp, 2.0_wp)
      s%E = decades(-2.0_wp, 4.0_wp)
      s%I = decades(-1.0_wp, 1.0_wp)
   end function random_beam

   !> Beams as in the test of derivatives, with everything on them: tip masses of .001 to 100 beams,
   !> damping of mode 1 by the material and by the air from 1e-5 to critical; rotary inertias of
   !> radii of 1e-3 to .3 lengths; roots of 1e-2 to 1e3 times E I/l; sensors of 1e-3 to 1 beams;
   !> hoses of .001 to 10 beams, at a tenth to thirty times the beam's frequency, damped from
   !> 1e-3 to 30 times critically.
   function random_structure() result(s)
      type(structure_t) :: s
      real(wp) :: mass

      s = random_beam()
      mass = s%rho*s%length
      s%m_T = mass*decades(-3.0_wp, 2.0_wp)
      s%J_T = (mass + s%m_T)*(s%length*decades(-3.0_wp, -0.5_wp))**2
      s%end(1)%kappa_R = s%length/(s%E*s%I*decades(-2.0_wp, 3.0_wp))
      s%end(1)%c_R = 0.05_wp/(s%end(1)%kappa_R*s%omega())
      s%sensor(1)%m_S = mass*decades(-3.0_wp, 0.0_wp)
      s%sensor(1)%x_S = s%length*between(0.05_wp, 1.0_wp)
      s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 0.0_wp)
      s%gamma = 2*s%rho*s%omega()*decades(-5.0_wp, 0.0_wp)
      s%hose(1)%m_H = mass*decades(-3.0_wp, 1.0_wp)
      s%hose(1)%k_H = s%hose(1)%m_H*(s%omega()*decades(-1.0_wp, 1.5_wp))**2
      s%hose(1)%c_H = 2*sqrt(s%hose(1)%k_H*s%hose(1)%m_H)*decades(-3.0_wp, 1.5_wp)
   end function random_structure

   !> Every parameter over six decades about the beam's own; each left out in one of ten.
   function wide_structure() result(s)
      type(structure_t) :: s
      real(wp) :: mass

      s = random_beam()
      mass = s%rho*s%length
      s%m_T = mass*decades(-3.0_wp, 3.0_wp)
      s%J_T = mass*s%length**2*decades(-5.0_wp, 1.0_wp)
      s%end(1)%kappa_R = s%length/(s%E*s%I*decades(-3.0_wp, 3.0_wp))
      s%end(1)%c_R = 0.1_wp/(s%end(1)%kappa_R*s%omega())
      s%sensor(1)%m_S = mass*decades(-4.0_wp, 2.0_wp)
      s%sensor(1)%x_S = s%length*decades(-2.0_wp, 0.0_wp)
      s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 1.0_wp)
      s%gamma = 2*s%rho*s%omega()*decades(-4.0_wp, 2.0_wp)
      s%hose(1)%m_H = mass*decades(-4.0_wp, 2.0_wp)
      s%hose(1)%k_H = s%hose(1)%m_H*(s%omega()*decades(-3.0_wp, 3.0_wp))**2
      s%hose(1)%c_H = 2*sqrt(s%hose(1)%k_H*s%hose(1)%m_H)*decades(-4.0_wp, 2.0_wp)
      if (uniform() < 0.1_wp) s%m_T = 0
      if (uniform() < 0.1_wp) s%J_T = 0
      if (uniform() < 0.1_wp) s%end(1)%kappa_R = 0
      if (uniform() < 0.1_wp) s%sensor(1)%m_S = 0
      if (uniform() < 0.1_wp) s%sensor(1)%x_S = at_tip
      if (uniform() < 0.1_wp) s%c_D = 0
      if (uniform() < 0.1_wp) s%gamma = 0
      if (uniform() < 0.1_wp) s%hose(1)%m_H = 0
      if (uniform() < 0.1_wp) s%hose(1)%c_H = 0
   end function wide_structure

   !> Two to six elements of degree 3 or some of degree 5; a pulse or a table, at the tip or
   !> distributed; some samples in the first few periods.
   !>
   !> share     of meshes of degree 5, and of distributed forces
   !> quintics  how many numbers of elements from 2 on there are for degree 5
   !> formulas  the first of the formulas of what is observed
   function random_experiment(structure, share, quintics, formulas) result(e)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: share
      integer, intent(in) :: quintics, formulas
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp) :: period, times(samples), t
      integer :: k

      e%structure = structure
      e%mesh = mesh_t(3, 2 + int(5*uniform()), 4, 1)
      if (uniform() < share) e%mesh = mesh_t(5, 2 + int(quintics*uniform()), 6, 1)
      period = 2*acos(-1.0_wp)/structure%omega()
      if (uniform() < 0.5_wp) then
         e%excitation = new_pulse(decades(-1.0_wp, 1.0_wp), period*decades(-2.0_wp, 0.0_wp))
      else
         call new_force_table(period*[0.0_wp, between(0.01_wp, 0.1_wp), between(0.11_wp, 0.5_wp)], &
            [between(0.0_wp, 1.0_wp), between(-1.0_wp, 1.0_wp), between(0.0_wp, 1.0_wp)], &
            e%excitation, error)
      end if
      e%excitation%distributed = uniform() < share
      t = 0
      do k = 1, samples
         t = t + period*between(0.02_wp, 0.4_wp)
         times(k) = t
      end do
      k = 1 + int(formulas*uniform())
      e%sampling = new_sampling(observation_t(k, period*between(0.01_wp, 0.1_wp)), times)
   end function random_experiment

end module random_experiments
