!> Checks whether a case has everything that a command needs, after `beamid_group_checks`.
!> `workflows/cases` calls them.
module beamid_case_checks
   use beamid_boxes, only: box_t
   use beamid_case_files, only: case_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_mesh_unknowns, only: unknowns_of
   use beamid_numbers, only: shown
   use beamid_parameter_names, only: name_of_parameter
   use beamid_parameters, only: amplitude, parameters
   use beamid_records, only: any_in_time, are_in_time, window_t
   use beamid_refusals, only: refuse
   use beamid_responses, only: is_exact
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: compliance_at, deflection, is_coefficient, n_parameters, of_a_h, &
      of_eta, of_g, of_T, of_x_F, structure_t, tip, x_S_at
   use beamid_structure_checks, only: add_unit_hint, check_structure, is_at_tip
   implicit none
   private

   public :: check_needs, can_be_fitted, place_experiment, settle_box, has_grid
   public :: needs_nothing, needs_response, needs_fit, needs_design, needs_modes, needs_track

   !> What a command needs of a case: the structure alone, a response at given times, a fit,
   !> candidate experiments, or natural modes.
   integer, parameter :: needs_nothing = 0, needs_response = 1, needs_fit = 2, needs_design = 3, &
      needs_modes = 4, needs_track = 5

contains

   !> Refuses a case that lacks something that the command needs.
   !>
   !> needs  needs_nothing, needs_modes, needs_response, needs_fit, needs_design or needs_track
   subroutine check_needs(case, needs, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: needs
      type(error_t), allocatable, intent(out) :: error
      integer :: k, most

      call check_elements(case, needs, error)
      if (needs == needs_nothing .or. needs == needs_modes .or. allocated(error)) return
      if (size(case%excitations) == 0 .and. (needs == needs_response .or. &
         any_in_time(case%recordings))) call refuse(case%path, 0, 'excitation', 'no such group', &
         'one', error)
      if (size(case%recordings) == 0) call refuse(case%path, 0, 'record', 'no such group', 'one', &
         error)
      call check_loss(case, error)
      call check_coupled(case, error)
      if (needs /= needs_design) call check_held_sensor(case, error)
      if (allocated(error)) return
      if (needs == needs_response) then
         call check_response(case, error)
         return
      else if (needs == needs_design) then
         call check_design(case, error)
         return
      end if
      call check_kinds(case, error)
      call check_modifiers(case, error)
      ! The samples of `track` may come from elsewhere.
      do k = 1, merge(0, size(case%recordings), needs == needs_track)
         if (.not. allocated(case%recordings(k)%path)) call refuse(case%path, &
            case%recordings(k)%line, 'record file', 'nothing', 'the path of a record', error)
         if (allocated(error)) exit
         if (case%recordings(k)%path == '-') call refuse(case%path, case%recordings(k)%line, &
            'record file', '''-''', 'the path of a record; only track reads standard input', error)
      end do
      if (size(case%stages) == 0) call refuse(case%path, 0, 'stage', 'no such group', &
         'one or more', error)
      if (.not. (are_in_time(case%recordings) .or. is_exact(case%model%solver))) call refuse( &
         case%path, 0, 'integrator method', '''cvode'' beside a record that is not a function '// &
         'of time', '''modal''', error)
      if (any(case%excitations%modes > 0) .and. .not. is_exact(case%model%solver)) call refuse( &
         case%path, 0, 'integrator method', '''cvode'' beside kind=''free'' in &excitation', &
         '''modal'', which computes the modes', error)
      if (any([(any(is_coefficient(case%stages(k)%free)), k=1, size(case%stages))]) .and. .not. &
         is_exact(case%model%solver)) call refuse(case%path, 0, 'integrator method', &
         '''cvode'' with E(x) or c_D(x) in free', '''modal'', which has their derivatives', error)
      if (allocated(error)) return
      most = unknowns_of(case%meshes(minloc(case%meshes%elements, dim=1)), case%model%structure)
      if (any(case%excitations%modes > most)) call refuse(case%path, 0, 'excitation modes', &
         to_text(maxval(case%excitations%modes)), 'at most '//to_text(most)// &
         ', the number of modes of the mesh', error)
      if (case%windows > 0 .and. .not. are_in_time(case%recordings)) call refuse(case%path, 0, &
         'windows', 'the group beside a record that is not a function of time', &
         'only records that are functions of time', error)
      if (.not. allocated(case%score)) return
      if (size(case%recordings) > 1 .or. any(case%excitations%modes > 0) .or. &
         any(case%stages%offset) .or. case%recordings(1)%kind /= 'time') &
         call refuse(case%path, case%score_line, 'score', 'the group beside several records, '// &
         'kind=''free'', a free offset or a record that is no function of time', &
         'one record with a known excitation', error)
   end subroutine check_needs

   !> Refuses meshes on which one response of the exact solver, or all natural modes, would take
   !> minutes. A fit has half the limit, because it is repeated with twice the elements.
   subroutine check_elements(case, needs, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: needs
      type(error_t), allocatable, intent(inout) :: error
      !> The time of one response grows with the square of the number of elements, or with its cube
      !> if all modes are coupled.
      integer, parameter :: most = 1000, most_coupled = 256
      integer :: limit, repeats, k
      character(len=:), allocatable :: reason
      logical :: coupled

      if (needs == needs_nothing) return
      if (needs == needs_response .and. .not. is_exact(case%model%solver)) return
      repeats = merge(2, 1, needs == needs_fit .or. needs == needs_track)
      associate (s => case%model%structure, found => maxval(case%meshes%elements))
         coupled = abs(s%g) + abs(s%T) > 0 .or. s%a_h > 0 .or. s%variations%are_known() .or. &
            s%has_dip() .or. any([(any(is_coefficient(case%stages(k)%free) .or. &
            case%stages(k)%free == of_g .or. case%stages(k)%free == of_T .or. &
            case%stages(k)%free == of_a_h), k=1, size(case%stages))])
         limit = merge(most_coupled, most, coupled)/repeats
         reason = ''
         if (repeats > 1) reason = ' in a fit'
         if (coupled) reason = reason// &
            ' with gravity, an axial force, a_h or &along, which couple all modes'
         if (needs == needs_response) reason = reason//' (or &integrator method=''cvode'')'
         if (found > limit) call refuse(case%path, 0, 'discretization elements', to_text(found), &
            'at most '//to_text(limit)//reason, error)
      end associate
   end subroutine check_elements

   !> Refuses a case from which no single response can be computed.
   subroutine check_response(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error

      if (size(case%recordings) > 1) call refuse(case%path, case%recordings(2)%line, 'record', &
         'a second one', 'one for a response', error)
      if (case%recordings(1)%kind /= 'time') call refuse(case%path, case%recordings(1)%line, &
         'record kind', ''''//trim(case%recordings(1)%kind)//'''', '''time'' for a response in '// &
         'time; the command frf computes frequency responses', error)
      if (case%excitations(1)%modes > 0) call refuse(case%path, 0, 'excitation kind', '''free''', &
         'a known excitation, which a response needs', error)
      if (.not. has_grid(case%recordings(1)%window)) call refuse(case%path, &
         case%recordings(1)%line, 'record', 'no grid of sample times', &
         't_first, t_last and t_step', error)
   end subroutine check_response

   !> Refuses a sensor at a tip that does not move, because its record would be 0.
   subroutine check_held_sensor(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      associate (s => case%model%structure)
         if (s%end(tip)%kappa_w > 0 .or. any(case%excitations%is_base) .or. &
            all(case%recordings%kind == 'modes') .or. any([(allocated(case%recordings(k)%x_S), &
            k=1, size(case%recordings))])) return
         if (any([(any(case%stages(k)%free == compliance_at(deflection, tip)), &
            k=1, size(case%stages))])) return
         do k = 1, max(1, s%sensors)
            if (.not. is_at_tip(s, s%place(x_S_at(k)))) cycle
            call refuse(case%path, 0, 'sensor x_S', to_text(s%length)//', the tip, which &end '// &
               'holds', 'a place that moves', error)
            return
         end do
      end associate
   end subroutine check_held_sensor

   !> Refuses a case whose candidate experiments or present experiment are incomplete.
   subroutine check_design(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      type(box_t) :: box
      integer :: k

      if (.not. allocated(case%box)) call refuse(case%path, 0, 'design', 'no such group', 'one', &
         error)
      if (size(case%stages) == 0) call refuse(case%path, 0, 'stage', 'no such group', &
         'one or more', error)
      if (any(case%excitations%modes > 0)) call refuse(case%path, 0, 'excitation kind', &
         '''free''', 'the excitation of the planned experiment, as kind=''release'' and a '// &
         'displacement; with modes=... in &design its start counts as unknown', error)
      do k = 1, size(case%recordings)
         associate (recording => case%recordings(k))
            if (recording%kind /= case%recordings(1)%kind .or. recording%kind == 'modes') &
               call refuse(case%path, recording%line, 'record kind', ''''//trim( &
               recording%kind)//'''', '''time'' or ''frf'', the same for all records', error)
            if (recording%kind == 'time' .and. .not. (allocated(recording%path) .or. &
               has_grid(recording%window))) call refuse(case%path, recording%line, 'record', &
               'neither a file nor a grid of sample times', 't_first, t_last and t_step', error)
         end associate
      end do
      if (allocated(error)) return
      call settle_box(case, box)
      associate (s => case%model%structure, last => size(case%stages))
         if (.not. box%noise_sd > 0) call refuse(case%path, case%design_line, 'design noise_sd', &
            'nothing', 'a value above 0, here, as sd of &noise or as sd of the record', error)
         if (size(box%interest) == 0) call refuse(case%path, case%stage_lines(last), &
            'stage free', 'the offset alone', 'a parameter beside it', error)
         do k = 1, size(box%interest)
            if (.not. any(case%stages(last)%free == box%interest(k))) call refuse(case%path, &
               case%design_line, 'design parameters', shown(trim(name_of_parameter(s, &
               box%interest(k)))), 'parameters that are free in the last stage', error)
         end do
         if (box%sensors == 2 .and. any(abs([s%sensor%m_S, s%sensor%J_S]) > 0)) call refuse( &
            case%path, case%design_line, 'design sensors', '2 with a mass, each of which '// &
            'changes the motion at the other', '1, or a sensor without m_S and J_S', error)
         if (box%sensors == 2 .and. box%modes > 0) call refuse(case%path, case%design_line, &
            'design sensors', '2 beside modes', '1', error)
         if (box%sensors == 2 .and. any(parameters(case%stages(last)%free)%group == 'sensor')) &
            call refuse(case%path, case%design_line, 'design sensors', &
            '2 beside a free parameter of the sensor', '1', error)
      end associate
   end subroutine check_design

   !> Refuses structural damping beside a response in time, for which it is not defined.
   subroutine check_loss(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      character(len=*), parameter :: expected = 'records of the kinds ''frf'' and ''modes'' '// &
         'alone: a loss factor is not causal'
      integer :: k

      if (.not. any_in_time(case%recordings)) return
      if (case%model%structure%eta > 0) call refuse(case%path, 0, 'beam eta', &
         to_text(case%model%structure%eta)//' beside a response in time', expected, error)
      do k = 1, size(case%stages)
         if (any(case%stages(k)%free == of_eta)) call refuse(case%path, case%stage_lines(k), &
            'stage free', '''eta'' beside a record in time', expected, error)
      end do
      if (any(case%draws%parameter == of_eta)) call refuse(case%path, 0, 'draw parameter', &
         '''eta'' beside a record in time', expected, error)
   end subroutine check_loss

   !> Refuses spatial hysteresis with cvode, whose matrices are banded.
   subroutine check_coupled(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      if (is_exact(case%model%solver)) return
      if (case%model%structure%a_h > 0 .or. any(case%draws%parameter == of_a_h) .or. &
         any([(any(case%stages(k)%free == of_a_h), k=1, size(case%stages))])) &
         call refuse(case%path, 0, 'integrator method', '''cvode'' beside a_h', '''modal'': '// &
         'spatial hysteresis couples all points of the beam', error)
   end subroutine check_coupled

   !> Refuses free parameters that have no effect at the start values of their stage, because
   !> another parameter is 0 there: b_h beside a_h = 0, or a_h beside b_h = 0. The strength of a
   !> relaxation is refused at 0 itself, where the relaxation has no root.
   subroutine check_modifiers(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      integer :: k, p, strength

      do p = 1, n_parameters
         strength = parameters(p)%modifies
         if (strength == 0) cycle
         do k = 1, size(case%stages)
            call check_pair(k, p, strength)
            if (strength /= p) call check_pair(k, strength, p)
         end do
      end do

   contains

      !> Refuses a free parameter whose partner is 0 at the start of a stage.
      subroutine check_pair(k, free, partner)
         integer, intent(in) :: k, free, partner
         character(len=:), allocatable :: found, name, other

         if (.not. any(case%stages(k)%free == free)) return
         if (start_of(case, k, partner) > 0) return
         name = trim(name_of_parameter(case%model%structure, free))
         other = trim(name_of_parameter(case%model%structure, partner))
         found = ''''//name//''' beside '//other//' = 0, where it has no effect'
         if (free == partner) found = ''''//name//''' from the start value 0'
         call refuse(case%path, case%stage_lines(k), 'stage free', found, 'a start value of '// &
            other//' above 0, in &'//trim(parameters(partner)%group)//' or in start', error)
      end subroutine check_pair

   end subroutine check_modifiers

   !> Returns the value of a parameter at the start of a stage: that of the case, of this stage or
   !> of an earlier one; `huge` if an earlier stage estimates it from there.
   pure real(wp) function start_of(case, stage, parameter) result(value)
      type(case_t), intent(in) :: case
      integer, intent(in) :: stage, parameter
      integer :: j, k

      value = case%model%structure%get(parameter)
      do k = 1, stage
         j = findloc(case%stages(k)%free, parameter, dim=1)
         if (j == 0) cycle
         if (allocated(case%stages(k)%start)) value = case%stages(k)%start(j)
         if (k < stage .and. value > 0) value = huge(value)
      end do
   end function start_of

   !> Refuses free parameters that only a record in time depends on, beside other records alone.
   subroutine check_kinds(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      character(len=*), parameter :: lacking = 'without a record in time', &
         expected = 'such a record, or a list without it'
      integer :: k

      if (any_in_time(case%recordings)) return
      do k = 1, size(case%stages)
         associate (stage => case%stages(k), line => case%stage_lines(k))
            if (stage%offset) call refuse(case%path, line, 'stage free', '''offset'' '//lacking, &
               expected, error)
            if (any(stage%free == amplitude)) call refuse(case%path, line, 'stage free', &
               '''amplitude'' '//lacking, expected, error)
         end associate
      end do
   end subroutine check_kinds

   !> Returns the candidate experiments of a case; takes the noise and the parameters of interest
   !> from the rest of the case if &design does not give them.
   subroutine settle_box(case, box)
      type(case_t), intent(in) :: case
      type(box_t), intent(out) :: box

      box = case%box
      if (.not. box%noise_sd > 0) box%noise_sd = case%noise_sd
      if (.not. box%noise_sd > 0 .and. allocated(case%recordings(1)%sd)) &
         box%noise_sd = case%recordings(1)%sd
      if (.not. allocated(box%interest)) box%interest = case%stages(size(case%stages))%free
   end subroutine settle_box

   !> Returns whether a window states all sample times: first, last and step.
   pure logical function has_grid(window)
      type(window_t), intent(in) :: window

      has_grid = allocated(window%t_first) .and. allocated(window%t_last) .and. &
         allocated(window%t_step)
   end function has_grid

   !> Returns whether a case has everything that a fit needs.
   logical function can_be_fitted(case)
      type(case_t), intent(in) :: case
      type(error_t), allocatable :: error

      call check_needs(case, needs_fit, error)
      can_be_fitted = .not. allocated(error)
   end function can_be_fitted

   !> Sets excitation and sensor of the experiment of record k and, if the record has its own, beam
   !> length and places of sensor and support. Refuses values that do not fit together.
   subroutine place_experiment(case, k, experiment, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      type(experiment_t), intent(inout) :: experiment
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: s
      real(wp), allocatable :: x_F
      integer :: n

      associate (recording => case%recordings(k), structure => case%model%structure)
         if (size(case%excitations) > 0) experiment%excitation = &
            case%excitations(min(k, size(case%excitations)))
         if (recording%kind /= 'time') then
            ! A frequency response is that to a unit force; modes have no force.
            if (allocated(experiment%excitation%x_F)) x_F = experiment%excitation%x_F
            if (allocated(recording%lines%x_F)) x_F = recording%lines%x_F
            experiment%excitation = new_pulse(0.0_wp, 1.0_wp)
            if (allocated(x_F)) experiment%excitation%x_F = x_F
         end if
         if (allocated(recording%length)) experiment%length = recording%length
         if (allocated(recording%x_S)) experiment%x_S = recording%x_S
         if (allocated(recording%x_P)) experiment%x_P = recording%x_P
         if (allocated(recording%sensor)) then
            do n = structure%sensors, 1, -1
               if (lower(trim(structure%sensor_name(n))) == lower(recording%sensor)) exit
            end do
            experiment%sensor = n
            if (n == 0 .or. recording%sensor == '') call refuse(case%path, &
               recording%line, 'record sensor', shown(recording%sensor), 'the name of a &sensor', &
               error)
         else if (structure%sensors > 1 .and. recording%kind /= 'modes') then
            call refuse(case%path, recording%line, 'record sensor', 'nothing', &
               'the name of one of '//to_text(structure%sensors)//' sensors', error)
         end if
         if (allocated(recording%x_P) .and. structure%supports /= 1) call refuse(case%path, &
            recording%line, 'record x_P', 'a value beside '//to_text(structure%supports)// &
            ' groups &support', 'one such group', error)
         if (allocated(error)) return
         s = experiment%structure_of(structure)
         call check_structure(s, error, n)
         call add_unit_hint(s, n, case%units, error)
         if (allocated(error)) error%message = case%path//':'//to_text(recording%line)// &
            ': &record '//error%message
      end associate
      if (allocated(error) .or. .not. experiment%excitation%by_displacement) return
      if (.not. s%static_deflection(s%place(of_x_F))*s%tip_stiffness() > 1e-9_wp) call refuse( &
         case%path, 0, 'excitation displacement', 'a point that a rigid support holds', &
         'one that moves', error)
   end subroutine place_experiment

end module beamid_case_checks
