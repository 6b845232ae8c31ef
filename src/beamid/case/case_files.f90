!> The groups of a case file, each with its reader: one for each part of the experiment, every key
!> with a documented default or required, every value checked where it is read.
module beamid_case_files
   use beamid_along_groups, only: along_t, read_along
   use beamid_blocks, only: block_t
   use beamid_bootstraps, only: bootstrap_plan_t
   use beamid_boxes, only: box_t
   use beamid_design_groups, only: read_design
   use beamid_ensemble_groups, only: draw_t, ensemble_t, read_draw, read_ensemble
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_fingerprints, only: fingerprint_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_t
   use beamid_kinds, only: wp
   use beamid_method_groups, only: read_bootstrap, read_discretization, read_integrator, &
      read_multistart, read_observation, read_sample, read_windows
   use beamid_modal, only: modal_t
   use beamid_model_groups, only: read_excitation, read_noise, read_structure, read_units, section_t
   use beamid_multistart, only: multistart_t
   use beamid_namelist, only: group_t
   use beamid_paths, only: append_path, directory_of, path_t
   use beamid_prior_groups, only: read_prior
   use beamid_priors, only: prior_t
   use beamid_record_groups, only: get_window, read_recording
   use beamid_records, only: append_recording, recording_t, window_t
   use beamid_sampling, only: plan_t
   use beamid_stage_groups, only: read_stage
   use beamid_units, only: units_t
   implicit none
   private

   public :: case_t, new_case, read_group, list_keys, add_case

   type(group_t), parameter, public :: groups(*) = [ &
      group_t('beam', required=.true., purpose= &
      'Describes the beam: its length, cross section, material, damping and root.'), &
      group_t('tip', purpose='Describes a mass at the tip, the free end of the beam.'), &
      group_t('hose', purpose= &
      'Describes a hose at the tip: a mass that a spring and a damper connect to the beam.'), &
      group_t('sensor', may_repeat=.true., purpose= &
      'Describes an accelerometer: its mass, rotary inertia and position.'), &
      group_t('support', may_repeat=.true., purpose= &
      'Describes a support between beam and ground: rigid, or a spring, a damper or both.'), &
      group_t('gravity', purpose= &
      'Adds the weight of the beam and of the masses on it, for a beam that hangs or stands.'), &
      group_t('axial', purpose='Adds an axial force in the beam.'), &
      group_t('along', may_repeat=.true., purpose= &
      'Describes a property that varies along the beam.'), &
      group_t('excitation', may_repeat=.true., purpose= &
      'Describes what sets the beam in motion, for all records or for one.'), &
      group_t('discretization', purpose='Chooses the mesh of splines.'), &
      group_t('integrator', purpose='Chooses the method that computes the response in time.'), &
      group_t('observation', purpose= &
      'Chooses the formula of the observed acceleration, and its frame of reference.'), &
      group_t('record', may_repeat=.true., purpose= &
      'Names the file of a record, and describes its columns, calibration and samples.'), &
      group_t('score', purpose= &
      'Defines another window, over which squared residuals are added up after each stage.'), &
      group_t('stage', may_repeat=.true., purpose= &
      'Lists the parameters that a stage of the fit estimates, with their starts and bounds.'), &
      group_t('prior', may_repeat=.true., purpose= &
      'States what other sources than the records say about a parameter.'), &
      group_t('multistart', purpose='Repeats the fit from several start values.'), &
      group_t('windows', purpose= &
      'Repeats the last stage in consecutive windows of equal duration.'), &
      group_t('sample', purpose='Controls the draws of the command sample.'), &
      group_t('bootstrap', purpose='Controls the resampled records of the command bootstrap.'), &
      group_t('noise', purpose= &
      'Describes the noise that the commands simulate and ensemble add to a record.'), &
      group_t('design', purpose='Lists the experiments that the command design compares.'), &
      group_t('ensemble', stands_alone=.true., purpose= &
      'Defines the members of the command ensemble: simulated records, or a list of cases.'), &
      group_t('draw', may_repeat=.true., purpose= &
      'Defines the range from which a parameter of each ensemble member is drawn.'), &
      group_t('units', purpose='Labels the units in the output; no value is converted.')]

   type :: case_t
      character(len=:), allocatable :: path     !< as given
      character(len=:), allocatable :: text     !< of the file
      character(len=:), allocatable :: name     !< file name without folder and ending
      type(model_t) :: model
      type(mesh_t), allocatable :: meshes(:)    !< one for each entry of `elements`
      logical :: refines = .true.               !< a fit finds their number by itself
      type(section_t) :: section                !< of the beam
      type(along_t), allocatable :: along(:)    !< what varies along it, as given
      type(recording_t), allocatable :: recordings(:)
      !> one for each recording, or one for all
      type(excitation_t), allocatable :: excitations(:)
      !> over which `identify` adds up squared residuals once the fit is done, where that is wanted
      type(window_t), allocatable :: score
      integer :: score_line = 0                 !< of the group &score
      type(stage_t), allocatable :: stages(:)
      integer, allocatable :: stage_lines(:)    !< of the groups &stage
      type(multistart_t) :: multistart
      integer :: windows = 0                    !< in which the fit is repeated
      type(plan_t) :: sampling
      type(bootstrap_plan_t) :: bootstrap
      !> experiments to choose from, where that is wanted
      type(box_t), allocatable :: box
      integer :: design_line = 0                !< of the group &design
      type(units_t) :: units
      !> of the noise that `simulate` adds to a record [acceleration]
      real(wp) :: noise_sd = 0
      integer :: noise_seed = 1
      type(ensemble_t) :: ensemble
      type(draw_t), allocatable :: draws(:)     !< of its members
      type(path_t), allocatable :: files(:)     !< every file that the case names, in their order
   end type case_t

contains

   !> What holds before any group is read.
   function new_case(path) result(case)
      character(len=*), intent(in) :: path
      type(case_t) :: case
      integer :: dot

      case%path = path
      case%name = path(index(path, '/', back=.true.) + 1:)
      dot = index(case%name, '.', back=.true.)
      if (dot > 1) case%name = case%name(:dot - 1)
      case%meshes = [mesh_t()]
      allocate (modal_t :: case%model%solver)
      allocate (case%along(0), case%stages(0), case%stage_lines(0), case%recordings(0), &
         case%excitations(0), case%model%priors(0), case%draws(0), case%files(0))
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
      type(prior_t) :: prior
      type(draw_t) :: draw
      type(along_t) :: along
      integer :: k

      block%folder = directory_of(case%path)
      associate (model => case%model)
         select case (block%name)
         case ('beam', 'tip', 'hose', 'sensor', 'support', 'gravity', 'axial')
            call read_structure(block, model%structure, case%section, case%along)
         case ('along')
            call read_along(block, model%structure, along, error)
            if (.not. (block%failed() .or. allocated(error))) case%along = [case%along, along]
         case ('discretization'); call read_discretization(block, case%meshes, case%refines)
         case ('integrator'); call read_integrator(block, model%solver)
         case ('observation'); call read_observation(block, model%observation)
         case ('multistart'); call read_multistart(block, case%multistart)
         case ('windows'); call read_windows(block, case%windows)
         case ('sample'); call read_sample(block, case%sampling)
         case ('bootstrap'); call read_bootstrap(block, case%bootstrap)
         case ('noise'); call read_noise(block, case%noise_sd, case%noise_seed)
         case ('units'); call read_units(block, case%units)
         case ('design')
            case%box = box_t()
            case%design_line = block%line
            call read_design(block, model%structure, case%excitations, sound, case%box)
         case ('score')
            case%score = window_t()
            case%score_line = block%line
            call get_window(block, case%score)
            call block%close()
         case ('excitation')
            call read_excitation(block, excitation, error)
            if (.not. block%failed()) case%excitations = [case%excitations, excitation]
         case ('record')
            call read_recording(block, recording)
            call append_recording(case%recordings, recording)
         case ('stage')
            call read_stage(block, model%structure, case%excitations, size(case%recordings), &
               minval(case%meshes%elements), sound, stage)
            if (.not. block%failed()) case%stages = [case%stages, stage]
            if (.not. block%failed()) case%stage_lines = [case%stage_lines, block%line]
         case ('prior')
            call read_prior(block, model%structure, case%section, case%excitations, &
               size(case%recordings), sound, model%priors, prior)
            if (.not. block%failed() .and. sound) model%priors = [model%priors, prior]
         case ('ensemble'); call read_ensemble(block, model%structure, sound, case%ensemble)
         case ('draw')
            call read_draw(block, model%structure, case%excitations, sound, case%draws, draw)
            if (.not. block%failed()) case%draws = [case%draws, draw]
         end select
      end associate
      if (.not. allocated(block%files)) return
      do k = 1, size(block%files)
         call append_path(case%files, block%files(k)%text)
      end do
   end subroutine read_group

   !> Adds the text of a case and the bytes of every file that it names to a fingerprint.
   subroutine add_case(fingerprint, case)
      type(fingerprint_t), intent(inout) :: fingerprint
      !> As `read_case` returns it, with an error as well: a case without a text has no files.
      type(case_t), intent(in) :: case
      integer :: k

      if (.not. allocated(case%text)) then
         call fingerprint%add('no case')
         return
      end if
      call fingerprint%add(case%text)
      do k = 1, size(case%files)
         call fingerprint%add_file(case%files(k)%text)
      end do
   end subroutine add_case

end module beamid_case_files
