!> Reader of the group &design of a case file: the candidate experiments among which `design`
!> chooses. `beamid_case_files` calls it.
module beamid_design_groups
   use beamid_blocks, only: block_t
   use beamid_boxes, only: box_t, is_pulse
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_numbers, only: shown
   use beamid_parameters, only: offset, parameters, place_of_name
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_values, only: positive, range_t
   implicit none
   private

   public :: read_design

contains

   !> Reads the group &design.
   !>
   !> structure, excitations  of the case
   !> sound  whether no other group had a problem; otherwise only the keys are read
   !> box    the lists of settings whose combinations are the candidates
   subroutine read_design(block, structure, excitations, sound, box)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitations(:)
      logical, intent(in) :: sound
      type(box_t), intent(inout) :: box
      integer, parameter :: most = 1000, places = 20
      character(len=:), allocatable :: names(:)
      character(len=4) :: word_S, word_F
      real(wp), allocatable :: noise, wanted
      integer :: k

      call block%get('x_S', box%x_S, 'that of the case', 'positions of the sensor; ''auto'': '// &
         to_text(places)//' along the beam', most, ['auto'], word_S, positive)
      call block%get('x_F', box%x_F, 'that of the case', 'positions of the force; ''auto'': '// &
         to_text(places)//' along the beam', most, ['auto'], word_F, positive)
      call block%get('duration', box%duration, 'that of the case', 'durations of the pulse', most, &
         range=positive)
      call block%get('t_first', box%t_first, 'that of the record', 'times of the first sample', &
         most)
      call block%get('t_last', box%t_last, 'that of the record', 'times of the last sample', most)
      call block%get('t_step', box%t_step, 'that of the record', 'time steps of the samples', &
         most, range=positive)
      call block%get('sensors', box%sensors, 'number of positions that are observed at once', &
         range_t(1, 2))
      call block%get('modes', box%modes, 'number of modes whose initial amplitude and phase '// &
         'are treated as unknown, as with kind=''free''', range_t(0, 20))
      call block%get('noise_sd', noise, 'sd of &noise, or of the record', &
         'standard deviation of the noise of each sensor', positive)
      call block%get('parameters', names, 'all that are free in the last stage', &
         'names of the parameters of interest; the other free parameters are nuisance '// &
         'parameters', size(parameters))
      call block%get('target', wanted, 'none', 'relative standard error that is wanted for '// &
         'each parameter', positive)
      call block%close()
      if (block%failed() .or. .not. sound) return
      if (allocated(noise)) box%noise_sd = noise
      if (allocated(wanted)) box%target = wanted
      associate (length => structure%length)
         if (word_S == 'auto') box%x_S = length*[(k, k=1, places)]/places
         if (word_F == 'auto') box%x_F = length*[(k, k=1, places)]/places
         call check_list(block, 'x_S', box%x_S, length)
         call check_list(block, 'x_F', box%x_F, length)
      end associate
      call check_list(block, 'duration', box%duration)
      call check_list(block, 't_first', box%t_first)
      call check_list(block, 't_last', box%t_last)
      call check_list(block, 't_step', box%t_step)
      if (allocated(box%duration) .and. .not. all(is_pulse(excitations))) call block%refuse( &
         'duration', to_text(size(box%duration))//' values', 'none without kind = ''pulse''')
      if (allocated(box%x_F) .and. any(excitations%is_base .or. excitations%distributed)) &
         call block%refuse('x_F', to_text(size(box%x_F))//' values', &
         'none without a force at a point')
      if (box%sensors == 2) then
         if (.not. allocated(box%x_S)) allocate (box%x_S(0))
         if (size(box%x_S) < 2) call block%refuse('sensors', '2 for '// &
            to_text(size(box%x_S))//' places', 'two or more places x_S')
      end if
      if (allocated(names)) call find_parameters(block, names, structure, box%interest)
   end subroutine read_design

   !> Refuses a list that contains a value twice or, if `length` is present, a place beyond the tip.
   subroutine check_list(block, key, values, length)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: key
      real(wp), allocatable, intent(in) :: values(:)
      real(wp), intent(in), optional :: length
      integer :: k

      if (.not. allocated(values)) return
      do k = 1, size(values)
         if (any(abs(values(:k - 1) - values(k)) <= 0)) then
            call block%refuse(key, to_text(values(k))//' twice', 'each value once')
            return
         end if
         if (.not. present(length)) cycle
         if (values(k) > length*(1 + epsilon(length))) then
            call block%refuse(key, to_text(values(k)), 'places above 0, up to the length '// &
               to_text(length))
            return
         end if
      end do
   end subroutine check_list

   !> Finds the parameters of interest; refuses unknown and repeated names.
   !>
   !> places  (size of names) places among the `parameters`
   subroutine find_parameters(block, names, structure, places)
      type(block_t), intent(inout) :: block
      character(len=*), intent(in) :: names(:)
      type(structure_t), intent(in) :: structure
      integer, allocatable, intent(out) :: places(:)
      integer :: k

      places = place_of_name(structure, names)
      do k = 1, size(names)
         if (places(k) == 0 .or. places(k) == offset) then
            call block%refuse('parameters', shown(names(k)), &
               'names of parameters that are free in the last stage')
         else if (any(places(:k - 1) == places(k))) then
            call block%refuse('parameters', shown(names(k))//' twice', 'each parameter once')
         end if
      end do
   end subroutine find_parameters

end module beamid_design_groups
