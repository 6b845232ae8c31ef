!> Reader of the group &prior of a case file: knowledge about a parameter that does not come from
!> the records. `beamid_case_files` calls it.
module beamid_prior_groups
   use beamid_blocks, only: block_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_model_groups, only: section_t
   use beamid_numbers, only: shown
   use beamid_parameters, only: is_there, name_of_parameter, offset, parameters, &
      place_of_name
   use beamid_priors, only: prior_t
   use beamid_stage_groups, only: check_free
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: of_I, of_rho, structure_t
   use beamid_values, only: listed, positive, range_t
   implicit none
   private

   public :: read_prior

contains

   !> Reads a group &prior.
   !>
   !> structure, section, excitations  of the case
   !> records  number of records
   !> sound    whether no earlier group had a problem; otherwise only the keys are read
   !> others   priors of earlier groups
   subroutine read_prior(block, structure, section, excitations, records, sound, others, found)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      type(section_t), intent(in) :: section
      type(excitation_t), intent(in) :: excitations(:)
      integer, intent(in) :: records
      logical, intent(in) :: sound
      type(prior_t), intent(in) :: others(:)
      type(prior_t), intent(out) :: found
      character(len=:), allocatable :: name

      call block%get('parameter', name, 'name of the parameter, or I, width, height or density', &
         required=.true.)
      call block%get('sd', found%sd, 'standard deviation of the prior', positive, required=.true.)
      call block%get('value', found%value, 'the value of the case', 'mean of the prior')
      call block%get('record', found%record, 'number of the record that this prior applies to', &
         range_t(1, huge(1)), default='all records, with one common error')
      if (found%record > max(1, records)) call block%refuse('record', to_text(found%record), &
         '1 to '//to_text(max(1, records)))
      call block%close()
      if (block%failed() .or. .not. sound) return
      call find_parameters(lower(name))
      if (size(found%parameter) == 0) then
         call block%refuse('parameter', shown(name), 'one of '//listed([ &
            pack(name_of_parameter(structure, parameters%place), is_there(structure, &
            parameters%place) .and. parameters%place /= offset), [character(len=24) :: &
            'width', 'height', 'density']], ' '))
         return
      end if
      if (size(found%parameter) == 1) call check_free(block, found%parameter, structure, &
         excitations, 'parameter')
      if (block%failed()) return
      if (any(others%name == found%name .and. (others%record == found%record .or. &
         others%record == 0 .or. found%record == 0))) call block%refuse('parameter', &
         shown(name)//' twice', 'each parameter once, or once for each record')
      if (.not. allocated(found%value)) return
      if (found%slope(1) > 1 .or. found%slope(1) < 1) then
         call block%refuse('value', to_text(found%value), 'none beside '//trim(name)// &
            ', whose value is in &beam')
         return
      end if
      if (parameters(found%parameter(1))%is_reciprocal .and. .not. found%value > 0) &
         call block%refuse('value', to_text(found%value), 'a value above 0')

   contains

      !> Finds the parameters that the prior concerns. Width, height and density of the section act
      !> on I and rho, with the derivatives as slopes.
      subroutine find_parameters(name)
         character(len=*), intent(in) :: name

         found%slope = [1.0_wp]
         found%parameter = [place_of_name(structure, name)]
         if (name == 'i') found%parameter = [of_I]
         if (found%parameter(1) == offset) found%parameter = [0]
         associate (b => section%width, h => section%height, rho => section%density)
            found%name = name
            if (name == 'width' .and. b > 0) then
               found%parameter = [of_I, of_rho]
               found%slope = [h**3/12, rho*h]
            else if (name == 'height' .and. h > 0) then
               found%parameter = [of_I, of_rho]
               found%slope = [b*h**2/4, rho*b]
            else if (name == 'density' .and. rho > 0) then
               found%parameter = [of_rho]
               found%slope = [b*h]
            end if
         end associate
         found%slope = pack(found%slope, found%parameter > 0 .and. abs(found%slope) > 0)
         found%parameter = found%parameter(:size(found%slope))
         if (any(found%parameter == 0)) found%parameter = [integer ::]
         if (size(found%parameter) /= 1) return
         if (abs(found%slope(1) - 1) <= 0) found%name = name_of_parameter(structure, &
            found%parameter(1))
      end subroutine find_parameters

   end subroutine read_prior

end module beamid_prior_groups
