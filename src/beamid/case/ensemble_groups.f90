!> Readers of the groups of a case file that repeat a command for many ensemble members: records
!> simulated with random noise and drawn parameters, or a list of cases. `beamid_case_files` calls
!> them.
module beamid_ensemble_groups
   use beamid_blocks, only: block_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_parameters, only: as_named, is_there, name_of_parameter, offset, &
      parameters, place_of_name, set_free
   use beamid_stage_groups, only: check_free
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_structure_checks, only: check_structure
   use beamid_values, only: listed, range_t
   implicit none
   private

   public :: draw_t, ensemble_t, read_draw, read_ensemble

   !> A parameter of the simulated beam that is drawn from a uniform distribution for each member.
   type :: draw_t
      integer :: parameter = 0         !< place among the `parameters`
      real(wp) :: low = 0, high = 0    !< ends of the distribution, in the unit of the case file
   end type draw_t

   !> The group &ensemble.
   type :: ensemble_t
      character(len=:), allocatable :: command   !< command run for each member; not allocated: the
      !< case has no such group
      integer :: members = 1000                  !< number of members
      integer :: seed = 1                        !< seed of draws and noise
      integer :: elements = 0                    !< of the beam that makes a record; 0: as the fit
      character(len=:), allocatable :: cases     !< path of a list of cases; not allocated: records
      !< are simulated
      integer :: line = 0                        !< line of the group in the case file
   end type ensemble_t

contains

   !> Reads the group &ensemble.
   !>
   !> structure  of the case
   !> sound      whether no earlier group had a problem
   subroutine read_ensemble(block, structure, sound, found)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      logical, intent(in) :: sound
      type(ensemble_t), intent(inout) :: found

      found%command = 'identify'
      found%line = block%line
      call block%get('command', found%command, 'command that is run on each member', &
         [character(len=9) :: 'identify', 'profile', 'sample', 'bootstrap', 'modes'])
      call block%get('members', found%members, 'number of members', range_t(1, 999999999))
      call block%get('seed', found%seed, 'seed of the random numbers')
      call block%get('elements', found%elements, 'number of elements of the mesh that '// &
         'simulates a record', range_t(1, 10000), default='that of the fit')
      call block%get_file('cases', found%cases, 'file with the path of a case in each line; '// &
         'each case is a member', default='none, the members are simulated from this case')
      call block%close()
      if (block%failed()) return
      if (allocated(found%cases)) then
         call block%exclude('members', 'beside cases')
         call block%exclude('seed', 'beside cases')
         call block%exclude('elements', 'beside cases')
         if (found%command /= 'identify') call block%refuse('command', shown(found%command), &
            '''identify'' beside cases')
      else if (sound .and. .not. structure%length > 0) then
         call block%refuse('', 'no group &beam', 'one, or a list of cases')
      end if
   end subroutine read_ensemble

   !> Reads a group &draw.
   !>
   !> structure, excitations  of the case
   !> sound   whether no earlier group had a problem; otherwise only the keys are read
   !> others  draws of earlier groups
   subroutine read_draw(block, structure, excitations, sound, others, found)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitations(:)
      logical, intent(in) :: sound
      type(draw_t), intent(in) :: others(:)
      type(draw_t), intent(out) :: found
      character(len=:), allocatable :: name

      call block%get('parameter', name, 'name of the parameter to draw', required=.true.)
      call block%get('low', found%low, 'lower end of the uniform distribution', required=.true.)
      call block%get('high', found%high, 'upper end of the uniform distribution', required=.true.)
      call block%close()
      if (block%failed()) return
      if (found%high < found%low) call block%refuse('high', to_text(found%high), &
         'at least low = '//to_text(found%low))
      if (block%failed() .or. .not. sound) return
      found%parameter = place_of_name(structure, name)
      if (found%parameter == 0 .or. found%parameter == offset) then
         call block%refuse('parameter', shown(name), 'one of '//listed(pack(name_of_parameter( &
            structure, parameters%place), parameters%is_free .and. is_there(structure, &
            parameters%place) .and. parameters%place /= offset), ' '))
         return
      end if
      if (any(others%parameter == found%parameter)) call block%refuse('parameter', &
         shown(name)//' twice', 'each parameter once')
      call check_free(block, [found%parameter], structure, excitations, 'parameter')
      if (block%failed()) return
      call check_end('low', found%low)
      call check_end('high', found%high)

   contains

      !> Refuses an end of the distribution with which the structure is not valid.
      subroutine check_end(key, value)
         character(len=*), intent(in) :: key
         real(wp), intent(in) :: value
         type(structure_t) :: drawn
         type(excitation_t) :: excitation
         type(error_t), allocatable :: error

         drawn = structure
         call set_free(drawn, excitation, found%parameter, as_named(found%parameter, value))
         call check_structure(drawn, error)
         if (allocated(error)) call block%complain(block%line_of(key), key, error%message)
      end subroutine check_end

   end subroutine read_draw

end module beamid_ensemble_groups
