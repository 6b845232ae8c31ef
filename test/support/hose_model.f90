!> A beam with a hose on two cubics, struck by a short pulse.
module hose_model
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t
   use beamid_kinds, only: wp
   use beamid_observation, only: observation_t
   use beamid_structure, only: hose_t, structure_t
   use models, only: model_of
   implicit none
   private

   public :: truth, mesh, hosed

   type(structure_t), parameter :: truth = structure_t(length=4, rho=0.03_wp, E=80, I=1, &
      c_D=0.05_wp, m_T=0.15_wp, hose=hose_t(m_H=0.04_wp, c_H=0.01_wp, k_H=0.3_wp))
   type(mesh_t), parameter :: mesh = mesh_t(3, 2, 4, 1)

contains

   !> By CVODE with `rtol`, or else exactly.
   function hosed(formula, rtol) result(model)
      integer, intent(in) :: formula
      real(wp), intent(in), optional :: rtol
      type(model_t) :: model

      model = model_of(truth, new_pulse(1.0_wp, 0.05_wp), observation_t(formula, 0.1_wp), rtol)
   end function hosed

end module hose_model
