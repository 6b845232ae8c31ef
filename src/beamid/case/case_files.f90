!> The case file: one namelist group for each part of the experiment, every key with a documented
!> default or required, every value checked where it is read.
module beamid_case_files
   use beamid_blocks, only: block_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_files, only: read_text
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_t
   use beamid_kinds, only: wp
   use beamid_method_groups, only: read_discretization, read_integrator, read_multistart, &
      read_observation, read_stage
   use beamid_modal, only: modal_t
   use beamid_model_groups, only: read_excitation, read_noise, read_structure, read_units
   use beamid_multistart, only: multistart_t
   use beamid_namelist, only: group_t, scan_namelist
   use beamid_numbers, only: shown
   use beamid_parameters, only: check_structure, parameters
   use beamid_record_groups, only: get_window, read_recording
   use beamid_records, only: append_recording, recording_t, window_t
   use beamid_refusals, only: refusals_t, refuse
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: of_x_F, structure_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: case_t, read_case, place_experiment, list_keys
   public :: needs_nothing, needs_response, needs_fit

   !> What a command needs of a case: the structure alone, a response at given times, a fit.
   integer, parameter :: needs_nothing = 0, needs_response = 1, needs_fit = 2

   type(group_t), parameter :: groups(*) = [ &
      group_t('beam', required=.true.), group_t('tip'), group_t('hose'), &
      group_t('sensor', may_repeat=.true.), group_t('support', may_repeat=.true.), &
      group_t('excitation', may_repeat=.true.), group_t('discretization'), group_t('integrator'), &
      group_t('observation'), group_t('record', may_repeat=.true.), group_t('score'), &
      group_t('stage', may_repeat=.true.), group_t('multistart'), group_t('noise'), &
      group_t('units')]

   type :: case_t
      character(len=:), allocatable :: path     !< as given
      character(len=:), allocatable :: name     !< file name without folder and ending
      type(model_t) :: model
      type(mesh_t), allocatable :: meshes(:)    !< one for each entry of `elements`
      type(recording_t), allocatable :: recordings(:)
      !> one for each recording, or one for all
      type(excitation_t), allocatable :: excitations(:)
      !> over which `identify` adds up squared residuals once the fit is done, where that is wanted
      type(window_t), allocatable :: score
      integer :: score_line = 0                 !< of the group &score
      type(stage_t), allocatable :: stages(:)
      type(multistart_t) :: multistart
      type(units_t) :: units
      !> of the noise that `simulate` adds to a record [acceleration]
      real(wp) :: noise_sd = 0
      integer :: noise_seed = 1
      integer, allocatable :: stage_lines(:)    !< of the groups &stage
   contains
      procedure :: can_be_fitted
   end type case_t

contains

   !> Reads and checks a case file.
   !>
   !> path   of the case file; paths inside it are relative to it
   !> needs  needs_nothing, needs_response or needs_fit
   !> error  one line per problem: file, line, group, key, what was found, what was expected
   subroutine read_case(path, needs, case, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: needs
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(block_t), allocatable :: blocks(:)
      type(refusals_t) :: refusals
      character(len=:), allocatable :: text

      call read_text(path, text, error)
      if (allocated(error)) return
      case = new_case(path)
      call scan_namelist(text, groups, blocks, refusals)
      call read_groups(blocks, refusals, case, error)
      if (.not. allocated(error)) call check_needs(case, needs, error)
      if (.not. allocated(error) .and. needs == needs_response) call settle(case, error)
   end subroutine read_case

   function new_case(path) result(case)
      character(len=*), intent(in) :: path
      type(case_t) :: case

      case%path = path
      case%name = name_of(path)
      case%meshes = [mesh_t()]
      allocate (modal_t :: case%model%solver)
      allocate (case%stages(0), case%stage_lines(0), case%recordings(0), case%excitations(0))
   end function new_case

   !> Every group with the keys that its reader asks for.
   subroutine list_keys(blocks)
      type(block_t), allocatable, intent(out) :: blocks(:)
      type(case_t) :: case
      type(error_t), allocatable :: error
      integer :: g

      case = new_case('')
      allocate (blocks(size(groups)))
      do g = 1, size(groups)
         blocks(g)%name = trim(groups(g)%name)
         call read_group(blocks(g), .false., case, error)
      end do
   end subroutine list_keys

   !> The one experiment whose response is wanted: the beam as its record has it.
   subroutine settle(case, error)
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: experiment

      call place_experiment(case, 1, experiment, error)
      if (.not. allocated(error)) case%model%structure = experiment%structure_of( &
         case%model%structure)
   end subroutine settle

   !> Every group in turn, the stages last, because they are checked against the others.
   subroutine read_groups(blocks, refusals, case, error)
      type(block_t), intent(inout) :: blocks(:)
      !> Problems outside of the groups.
      type(refusals_t), intent(in) :: refusals
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      type(refusals_t) :: all_of_them
      integer :: k
      logical :: sound

      sound = refusals%n == 0
      do k = 1, size(blocks)
         if (blocks(k)%name /= 'stage') call read_group(blocks(k), sound, case, error)
         sound = sound .and. .not. blocks(k)%failed()
      end do
      if (sound) call check_whole(blocks, case, sound)
      do k = 1, size(blocks)
         if (blocks(k)%name == 'stage') call read_group(blocks(k), sound, case, error)
      end do
      do k = 1, size(blocks)
         call all_of_them%join(blocks(k)%refusals)
      end do
      call all_of_them%join(refusals)
      call all_of_them%tell(case%path, error)
      if (allocated(error)) return
      if (size(case%excitations) > 0) case%model%excitation = case%excitations(1)
      if (size(case%excitations) > 1 .and. size(case%excitations) /= size(case%recordings)) &
         call refuse(case%path, 0, 'excitation', to_text(size(case%excitations))// &
         ' such groups for '//to_text(size(case%recordings))//' of &record', &
         'one, or one for each record', error)
   end subroutine read_groups

   !> One group. Its problems stay in the block.
   !>
   !> sound  whether there has been no problem before
   !> error  of another file that the group names; an earlier one stays
   subroutine read_group(block, sound, case, error)
      type(block_t), intent(inout) :: block
      logical, intent(in) :: sound
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(inout) :: error
      type(stage_t) :: stage
      type(recording_t) :: recording
      type(excitation_t) :: excitation

      associate (model => case%model)
         select case (block%name)
         case ('beam', 'tip', 'hose', 'sensor', 'support')
            call read_structure(block, model%structure)
         case ('discretization'); call read_discretization(block, case%meshes)
         case ('integrator'); call read_integrator(block, model%solver)
         case ('observation'); call read_observation(block, model%observation)
         case ('multistart'); call read_multistart(block, case%multistart)
         case ('noise'); call read_noise(block, case%noise_sd, case%noise_seed)
         case ('units'); call read_units(block, case%units)
         case ('score')
            case%score = window_t()
            case%score_line = block%line
            call get_window(block, case%score)
            call block%close()
         case ('excitation')
            call read_excitation(case%path, block, excitation, error)
            if (.not. block%failed()) case%excitations = [case%excitations, excitation]
         case ('record')
            call read_recording(case%path, block, recording)
            call append_recording(case%recordings, recording)
         case ('stage')
            call read_stage(block, model%structure, case%excitations, size(case%recordings), &
               sound, stage)
            if (block%failed()) return
            case%stages = [case%stages, stage]
            case%stage_lines = [case%stage_lines, block%line]
         end select
      end associate
   end subroutine read_group

   !> Every value is in its range; what is left is whether they go together.
   subroutine check_whole(blocks, case, sound)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      logical, intent(out) :: sound
      type(error_t), allocatable :: error
      integer :: k, place

      call check_structure(case%model%structure, error, place)
      if (allocated(error)) then
         call refuse_parameter(blocks, place, error%message)
      else
         call check_forces(blocks, case)
         call check_rigid(blocks, case)
      end if
      sound = .not. (allocated(error) .or. any([(blocks(k)%failed(), k=1, size(blocks))]))
   end subroutine check_whole

   !> Tells what is wrong with a parameter where it is given.
   subroutine refuse_parameter(blocks, place, message)
      type(block_t), intent(inout) :: blocks(:)
      integer, intent(in) :: place
      character(len=*), intent(in) :: message
      integer :: item, k

      item = 0
      do k = 1, size(blocks)
         if (blocks(k)%name /= parameters(place)%group) cycle
         item = item + 1
         if (item < parameters(place)%item) cycle
         call blocks(k)%refusals%add(blocks(k)%line_of(trim(parameters(place)%name)), &
            '&'//trim(parameters(place)%group)//' '//message)
         return
      end do
   end subroutine refuse_parameter

   !> A force acts on the beam. Where a record has a beam of its own length that shows later.
   subroutine check_forces(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      integer :: k, n

      do k = 1, size(case%recordings)
         if (allocated(case%recordings(k)%length)) return
      end do
      n = 0
      do k = 1, size(blocks)
         if (blocks(k)%name /= 'excitation') cycle
         n = n + 1
         if (.not. allocated(case%excitations(n)%x_F)) cycle
         associate (x_F => case%excitations(n)%x_F, length => case%model%structure%length)
            if (x_F > length) call blocks(k)%refuse('x_F', to_text(x_F), &
               'a place above 0, up to the length '//to_text(length))
         end associate
      end do
   end subroutine check_forces

   !> Rigid supports leave the beam some freedom on every mesh.
   subroutine check_rigid(blocks, case)
      type(block_t), intent(inout) :: blocks(:)
      type(case_t), intent(in) :: case
      integer :: held, k, least

      associate (structure => case%model%structure, mesh => case%meshes( &
         minloc(case%meshes%elements, dim=1)))
         held = structure%rigid_supports()
         least = mesh%elements + mesh%degree - 2 + merge(1, 0, structure%has_root_spring())
         if (held < least) return
         do k = size(blocks), 1, -1
            if (blocks(k)%name /= 'support') cycle
            call blocks(k)%refuse('', to_text(held)//' rigid ones', 'at most '// &
               to_text(least - 1)//' on a mesh of '//to_text(mesh%elements)//' elements')
            return
         end do
      end associate
   end subroutine check_rigid

   !> Refuses a case that lacks what the command needs.
   subroutine check_needs(case, needs, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: needs
      type(error_t), allocatable, intent(out) :: error

      if (needs == needs_nothing) return
      if (size(case%excitations) == 0) call refuse(case%path, 0, 'excitation', 'no such group', &
         'one', error)
      if (size(case%recordings) == 0) call refuse(case%path, 0, 'record', 'no such group', 'one', &
         error)
      if (allocated(error)) return
      if (needs == needs_fit) call check_fit(case, error)
      if (needs == needs_response) call check_response(case, error)
   end subroutine check_needs

   subroutine check_fit(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error
      integer :: k

      do k = 1, size(case%recordings)
         if (.not. allocated(case%recordings(k)%path)) call refuse(case%path, &
            case%recordings(k)%line, 'record file', 'nothing', 'the path of a record', error)
      end do
      if (size(case%stages) == 0) call refuse(case%path, 0, 'stage', 'no such group', &
         'one or more', error)
      if (.not. allocated(case%score)) return
      if (size(case%recordings) > 1 .or. any(case%excitations%modes > 0) .or. &
         any(case%stages%offset)) call refuse(case%path, case%score_line, 'score', &
         'it beside several records, a free start or a free offset', &
         'one record with a known start', error)
   end subroutine check_fit

   subroutine check_response(case, error)
      type(case_t), intent(in) :: case
      type(error_t), allocatable, intent(inout) :: error

      if (size(case%recordings) > 1) call refuse(case%path, case%recordings(2)%line, 'record', &
         'a second one', 'one for a response', error)
      if (case%excitations(1)%modes > 0) call refuse(case%path, 0, 'excitation kind', '''free''', &
         'a start that is known for a response', error)
      associate (window => case%recordings(1)%window)
         if (.not. (allocated(window%t_first) .and. allocated(window%t_last) .and. &
            allocated(window%t_step))) call refuse(case%path, case%recordings(1)%line, 'record', &
            'no grid of sample times', 't_first, t_last and t_step', error)
      end associate
   end subroutine check_response

   !> Whether the case has all that a fit needs.
   logical function can_be_fitted(self)
      class(case_t), intent(in) :: self
      type(error_t), allocatable :: error

      call check_needs(self, needs_fit, error)
      can_be_fitted = .not. allocated(error)
   end function can_be_fitted

   !> Which sensor a record comes from, and its beam where that has a length, a place of the sensor
   !> or of the support of its own; these must go together.
   subroutine place_experiment(case, k, experiment, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      type(experiment_t), intent(inout) :: experiment
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: s
      integer :: n
      logical :: held

      associate (recording => case%recordings(k), structure => case%model%structure)
         if (size(case%excitations) > 0) experiment%excitation = &
            case%excitations(min(k, size(case%excitations)))
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
         else if (structure%sensors > 1) then
            call refuse(case%path, recording%line, 'record sensor', 'nothing', &
               'the name of one of '//to_text(structure%sensors)//' sensors', error)
         end if
         if (allocated(recording%x_P) .and. structure%supports /= 1) call refuse(case%path, &
            recording%line, 'record x_P', 'it beside '//to_text(structure%supports)// &
            ' groups &support', 'one such group', error)
         if (allocated(error)) return
         call check_structure(experiment%structure_of(structure), error)
         if (allocated(error)) error%message = case%path//':'//to_text(recording%line)// &
            ': &record '//error%message
         if (allocated(error) .or. .not. experiment%excitation%by_displacement) return
         s = experiment%structure_of(structure)
         held = .not. s%static_deflection(s%place(of_x_F))*s%tip_stiffness() > 1e-9_wp
         if (held) call refuse(case%path, 0, 'excitation displacement', &
            'a point that a rigid support holds', 'one that moves', error)
      end associate
   end subroutine place_experiment

   !> File name without folder and ending.
   pure function name_of(path) result(name)
      character(len=*), intent(in) :: path
      character(len=:), allocatable :: name
      integer :: dot

      name = path(index(path, '/', back=.true.) + 1:)
      dot = index(name, '.', back=.true.)
      if (dot > 1) name = name(:dot - 1)
   end function name_of

end module beamid_case_files
