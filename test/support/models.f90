!> Models and stages of a fit in one line.
module models
   use beamid_cvode, only: cvode_t
   use beamid_excitation, only: excitation_t
   use beamid_identification, only: model_t, stage_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_observation, only: observation_t
   use beamid_parameters, only: free_index
   use beamid_structure, only: structure_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: model_of, stage_of

contains

   !> Solved exactly, or by CVODE where `rtol` is given.
   function model_of(structure, excitation, observation, rtol) result(model)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      type(observation_t), intent(in), optional :: observation
      real(wp), intent(in), optional :: rtol
      type(model_t) :: model

      model%structure = structure
      model%excitation = excitation
      if (present(observation)) model%observation = observation
      if (present(rtol)) then
         model%solver = cvode_t(rtol=rtol)
      else
         allocate (modal_t :: model%solver)
      end if
   end function model_of

   !> All of `names` free and positive, from the given starts; an offset beside them if asked for.
   function stage_of(names, start, offset) result(stage)
      character(len=*), intent(in) :: names(:)
      real(wp), intent(in), optional :: start(:)
      logical, intent(in), optional :: offset
      type(stage_t) :: stage
      integer :: i

      stage%free = [(free_index(names(i)), i=1, size(names))]
      if (present(start)) stage%start = start
      stage%lower = spread(0.0_wp, 1, size(names))
      stage%upper = spread(unbounded, 1, size(names))
      if (present(offset)) stage%offset = offset
   end function stage_of

end module models
