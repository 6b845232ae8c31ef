!> Readers of the groups of a case file that name parameters outside a stage: &prior, knowledge that
!> does not come from the records; &draw and &ensemble, the members of an ensemble; &design, the
!> candidate experiments; &track, a parameter that is followed. `beamid_case_files` calls them.
module beamid_plan_groups
   use beamid_blocks, only: block_t
   use beamid_boxes, only: box_t, is_pulse
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_model_groups, only: section_t
   use beamid_numbers, only: shown
   use beamid_parameter_names, only: is_there, name_of_parameter, place_of_name
   use beamid_parameters, only: as_named, offset, parameters, set_free
   use beamid_priors, only: prior_t
   use beamid_stage_groups, only: check_free
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: of_I, of_rho, structure_t
   use beamid_structure_checks, only: check_structure
   use beamid_tracked_windows, only: track_plan_t
   use beamid_values, only: listed, positive, range_t
   implicit none
   private

   public :: draw_t, ensemble_t, read_prior, read_draw, read_ensemble, read_design, read_track

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

      call block%get('parameter', name, 'name of the parameter that the prior is about', &
         required=.true.)
      call block%get('sd', found%sd, 'standard deviation of the prior; '// &
         'for a tolerance of +-a within which all values are equally likely, it is 0.6 a', &
         positive, required=.true.)
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
      call block%get('command', found%command, 'command that is run for each member', &
         [character(len=9) :: 'identify', 'profile', 'sample', 'bootstrap', 'modes'])
      call block%get('members', found%members, 'number of members', range_t(1, 999999999))
      call block%get('seed', found%seed, 'seed of the random numbers')
      call block%get('elements', found%elements, 'number of elements of the mesh that '// &
         'simulates the records', range_t(1, 10000), default='elements of &discretization')
      call block%get_file('cases', found%cases, 'path of a file with the path of a case in '// &
         'each line; each case is a member', default='none, the members are simulated')
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

      call block%get('parameter', name, 'name of the parameter that is drawn', required=.true.)
      call block%get('low', found%low, 'lower end of the uniform distribution', required=.true.)
      call block%get('high', found%high, 'upper end of the uniform distribution', required=.true.)
      call block%close()
      if (block%failed()) return
      if (found%high < found%low) call block%refuse('high', to_text(found%high), &
         'at least low = '//to_text(found%low))
      if (block%failed() .or. .not. sound) return
      found%parameter = place_of_name(structure, name)
      call check_name(block, structure, name, found%parameter)
      if (block%failed()) return
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

   !> Reads the group &track.
   !>
   !> sound  whether no other group had a problem; otherwise only the keys are read
   subroutine read_track(block, structure, sound, plan)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      logical, intent(in) :: sound
      type(track_plan_t), allocatable, intent(inout) :: plan
      character(len=:), allocatable :: name
      real(wp), allocatable :: rate

      plan = track_plan_t(line=block%line)
      call block%get('parameter', name, 'name of the parameter that is followed; it is free in '// &
         'the last stage', required=.true.)
      call block%get('window', plan%window, 'length of a window', positive, required=.true.)
      call block%get('hop', plan%hop, 'time from the start of a window to the start of the next', &
         positive, required=.true.)
      call block%get('rate', rate, 'no limit', 'standard deviation of the change of the '// &
         'parameter in a unit of time; in a time dt, it is rate times the square root of dt', &
         positive)
      call block%get('frequency_error', plan%frequency_error, 'standard deviation of the '// &
         'relative error of each natural frequency of the model, and of the error of each '// &
         'damping ratio, as learned from a calibration; each interval allows for it', &
         range_t(0, 0.1_wp))
      call block%close()
      if (block%failed() .or. .not. sound) return
      if (allocated(rate)) plan%rate = rate
      plan%parameter = place_of_name(structure, name)
      call check_name(block, structure, name, plan%parameter)
   end subroutine read_track

   !> Refuses a name that is none of a parameter of the structure that a fit may estimate.
   !>
   !> place  of the parameter of this name; 0: none
   subroutine check_name(block, structure, name, place)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      character(len=*), intent(in) :: name
      integer, intent(in) :: place

      if (place /= 0 .and. place /= offset) return
      call block%refuse('parameter', shown(name), 'one of '//listed(pack(name_of_parameter( &
         structure, parameters%place), parameters%is_free .and. is_there(structure, &
         parameters%place) .and. parameters%place /= offset), ' '))
   end subroutine check_name

   !> Reads the group &design.
   !>
   !> structure, excitations  of the case
   !> kind   of the first record: 'time', 'frf' or 'modes'
   !> sound  whether no other group had a problem; otherwise only the keys are read
   !> box    the lists of settings whose combinations are the candidates
   subroutine read_design(block, structure, excitations, kind, sound, box)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitations(:)
      character(len=*), intent(in) :: kind
      logical, intent(in) :: sound
      type(box_t), intent(inout) :: box
      integer, parameter :: most = 1000, places = 20
      character(len=:), allocatable :: names(:)
      character(len=4) :: word_S, word_F
      real(wp), allocatable :: noise, wanted, first(:), last(:), step(:)
      integer :: k

      call block%get('x_S', box%x_S, 'x_S of the case', 'positions of the sensor; ''auto'': '// &
         to_text(places)//' along the beam', most, ['auto'], word_S, positive)
      call block%get('x_F', box%x_F, 'x_F of the case', 'positions of the force; ''auto'': '// &
         to_text(places)//' along the beam', most, ['auto'], word_F, positive)
      call block%get('duration', box%duration, 'duration of the case', 'durations of the pulse', &
         most, range=positive)
      call block%get('t_first', box%first, 't_first of the record', 'times of the first sample', &
         most)
      call block%get('t_last', box%last, 't_last of the record', 'times of the last sample', most)
      call block%get('t_step', box%step, 't_step of the record', 'time steps of the samples', &
         most, range=positive)
      call block%get('f_first', first, 'f_first of the record', 'lowest frequencies of a '// &
         'frequency response', most, range=positive)
      call block%get('f_last', last, 'f_last of the record', 'highest frequencies of a '// &
         'frequency response', most, range=positive)
      call block%get('f_step', step, 'f_step of the record', 'distances of the lines of a '// &
         'frequency response', most, range=positive)
      call block%get('sensors', box%sensors, 'number of sensors that observe the beam at once', &
         range_t(1, 2))
      call block%get('modes', box%modes, 'number of modes whose initial amplitude and phase '// &
         'are treated as unknown, as with kind=''free''', range_t(0, 20))
      call block%get('noise_sd', noise, 'sd of &noise or of the record', &
         'standard deviation of the noise of each sensor, or of real and imaginary part of a '// &
         'frequency response', positive)
      call block%get('parameters', names, 'all that are free in the last stage', &
         'names of the parameters of interest; the other free parameters are nuisance '// &
         'parameters', size(parameters))
      call block%get('target', wanted, 'none', 'relative standard error that each parameter '// &
         'should have', positive)
      call block%close()
      if (block%failed() .or. .not. sound) return
      call block%exclude_other_kinds(kind, [character(len=8) :: 'duration', 't_first', 't_last', &
         't_step', 'modes', 'f_first', 'f_last', 'f_step'], [character(len=4) :: 'time', 'time', &
         'time', 'time', 'time', 'frf', 'frf', 'frf'])
      box%of_lines = kind == 'frf'
      if (box%of_lines) then
         call move_alloc(first, box%first)
         call move_alloc(last, box%last)
         call move_alloc(step, box%step)
      end if
      if (block%failed()) return
      if (allocated(noise)) box%noise_sd = noise
      if (allocated(wanted)) box%target = wanted
      if (word_S == 'auto') box%x_S = structure%length*[(k, k=1, places)]/places
      if (word_F == 'auto') box%x_F = structure%length*[(k, k=1, places)]/places
      call check_box(block, structure, excitations, names, box)
   end subroutine read_design

   !> Refuses settings of candidates that are impossible with the structure and the excitations, and
   !> finds the parameters of interest by their names. Arguments as of `read_design`.
   subroutine check_box(block, structure, excitations, names, box)
      type(block_t), intent(inout) :: block
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitations(:)
      character(len=:), allocatable, intent(in) :: names(:)
      type(box_t), intent(inout) :: box

      call check_list(block, 'x_S', box%x_S, structure%length)
      call check_list(block, 'x_F', box%x_F, structure%length)
      call check_list(block, 'duration', box%duration)
      call check_list(block, merge('f_first', 't_first', box%of_lines), box%first)
      call check_list(block, merge('f_last', 't_last', box%of_lines), box%last)
      call check_list(block, merge('f_step', 't_step', box%of_lines), box%step)
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
   end subroutine check_box

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

end module beamid_plan_groups
