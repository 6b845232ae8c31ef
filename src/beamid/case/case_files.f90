!> The groups of a case file and the reader of each. Every key is required or has a documented
!> default, and every value is checked where it is read. `workflows/cases` calls these readers;
!> `beamid_group_checks` then checks that the groups go together.
module beamid_case_files
   use beamid_along_groups, only: along_t, read_along
   use beamid_blocks, only: block_t
   use beamid_bootstraps, only: bootstrap_plan_t
   use beamid_boxes, only: box_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_excitation_groups, only: read_excitation
   use beamid_fingerprints, only: fingerprint_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_t
   use beamid_kinds, only: wp
   use beamid_method_groups, only: read_bootstrap, read_discretization, read_integrator, &
      read_multistart, read_observation, read_sample, read_windows
   use beamid_modal, only: modal_t
   use beamid_model_groups, only: read_noise, read_structure, read_units, section_t
   use beamid_multistart, only: multistart_t
   use beamid_namelist, only: group_t
   use beamid_paths, only: directory_of
   use beamid_plan_groups, only: draw_t, ensemble_t, read_design, read_draw, read_ensemble, &
      read_prior, read_track
   use beamid_priors, only: prior_t
   use beamid_record_groups, only: get_window, read_recording
   use beamid_records, only: append_recording, recording_t, window_t
   use beamid_sampling, only: plan_t
   use beamid_stage_groups, only: read_stage
   use beamid_strings, only: string_t
   use beamid_tracked_windows, only: track_plan_t
   use beamid_units, only: units_t
   implicit none
   private

   public :: case_t, new_case, read_group, list_keys, add_case

   !> All groups, in the order in which they are listed in the help.
   type(group_t), parameter, public :: groups(*) = [ &
      group_t('beam', required=.true., purpose= &
      'Describes the beam: its length, cross section, material, damping and root.'), &
      group_t('end', may_repeat=.true., purpose= &
      'Describes what holds an end of the beam. Without it the root is clamped, the tip free.'), &
      group_t('tip', purpose='Describes a mass at the tip, the other end of the beam.'), &
      group_t('hose', may_repeat=.true., purpose= &
      'Describes a hose or absorber: a mass that a spring and a damper connect to the beam.'), &
      group_t('mass', may_repeat=.true., purpose= &
      'Describes a mass on the beam, at any position.'), &
      group_t('sensor', may_repeat=.true., purpose= &
      'Describes an accelerometer: its mass, rotary inertia and position.'), &
      group_t('support', may_repeat=.true., purpose= &
      'Describes a support: rigid, or springs and dampers between beam and ground.'), &
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
      'States what is known about a parameter from other sources than the records.'), &
      group_t('multistart', purpose='Repeats the fit from several start values.'), &
      group_t('windows', purpose= &
      'Repeats the last stage in consecutive windows of equal duration.'), &
      group_t('track', purpose= &
      'Names the parameter that the command track follows, and the windows that it fits.'), &
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

   !> The contents of a case file. Lists are empty, not unallocated, if a group is absent.
   type :: case_t
      character(len=:), allocatable :: path     !< path of the case file, as given
      character(len=:), allocatable :: text     !< text of the case file
      character(len=:), allocatable :: name     !< file name without folder and extension
      type(model_t) :: model                    !< structure, solver, observation and priors
      type(mesh_t), allocatable :: meshes(:)    !< one mesh for each entry of `elements`
      logical :: refines = .true.               !< elements='auto': a fit refines the mesh itself
      type(section_t) :: section                !< rectangular cross section of the beam
      type(along_t), allocatable :: along(:)    !< properties that vary along the beam, as given
      type(recording_t), allocatable :: recordings(:)   !< groups &record
      !> (number of recordings, or 1 for all of them) groups &excitation
      type(excitation_t), allocatable :: excitations(:)
      !> Window over which `identify` adds up squared residuals after the fit (group &score); not
      !> allocated: none.
      type(window_t), allocatable :: score
      integer :: score_line = 0                 !< line of the group &score
      type(stage_t), allocatable :: stages(:)   !< groups &stage
      integer, allocatable :: stage_lines(:)    !< (number of stages) line of each &stage
      type(multistart_t) :: multistart          !< group &multistart
      integer :: windows = 0                    !< number of windows in which the last stage is
      !< repeated; 0: none
      type(track_plan_t), allocatable :: track  !< group &track; not allocated: none
      type(plan_t) :: sampling                  !< group &sample
      type(bootstrap_plan_t) :: bootstrap       !< group &bootstrap
      !> Candidate experiments of `design`; not allocated: no group &design.
      type(box_t), allocatable :: box
      integer :: design_line = 0                !< line of the group &design
      type(units_t) :: units                    !< unit labels
      !> Standard deviation of the noise that `simulate` adds to a record [acceleration].
      real(wp) :: noise_sd = 0
      integer :: noise_seed = 1                 !< seed of this noise
      type(ensemble_t) :: ensemble              !< group &ensemble
      type(draw_t), allocatable :: draws(:)     !< parameters drawn for each ensemble member
      type(string_t), allocatable :: files(:)   !< every file that the case names, in order
   contains
      procedure :: copy_to
   end type case_t

contains

   !> Copies the case. gfortran expands each assignment of this type to about 8 kB of code; call
   !> this procedure instead.
   subroutine copy_to(self, copy)
      class(case_t), intent(in) :: self
      type(case_t), intent(inout) :: copy

      copy = self
   end subroutine copy_to

   !> Returns a case with all defaults, before any group is read.
   !>
   !> path  path of the case file; '' for the help
   function new_case(path) result(case)
      character(len=*), intent(in) :: path
      type(case_t) :: case
      integer :: dot

      case%path = path
      case%name = path(index(path, '/', back=.true.) + 1:)
      dot = index(case%name, '.', back=.true.)
      if (dot > 1) case%name = case%name(:dot - 1)
      case%meshes = [mesh_t(at_attachments=.true.)]
      allocate (modal_t :: case%model%solver)
      allocate (case%along(0), case%stages(0), case%stage_lines(0), case%recordings(0), &
         case%excitations(0), case%model%priors(0), case%draws(0), case%files(0))
   end function new_case

   !> Lists every group with its keys: reads empty groups, whose readers register their keys.
   !>
   !> blocks  (number of groups) a block for each entry of `groups`
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

   !> Reads one group into the case. Problems in the group are added to the block.
   !>
   !> sound  whether no earlier group had a problem
   !> error  error in another file that the group names; an earlier error is kept
   subroutine read_group(block, sound, case, error)
      type(block_t), intent(inout) :: block
      logical, intent(in) :: sound
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(inout) :: error
      character(len=5) :: kind

      block%folder = directory_of(case%path)
      call move_alloc(case%files, block%files)
      associate (model => case%model)
         select case (block%name)
         case ('beam', 'end', 'tip', 'hose', 'mass', 'sensor', 'support', 'gravity', 'axial')
            call read_structure(block, model%structure, case%section, case%along)
         case ('discretization'); call read_discretization(block, case%meshes, case%refines)
         case ('integrator'); call read_integrator(block, model%solver)
         case ('observation'); call read_observation(block, model%observation)
         case ('multistart'); call read_multistart(block, case%multistart)
         case ('windows'); call read_windows(block, case%windows)
         case ('track'); call read_track(block, model%structure, sound, case%track)
         case ('sample'); call read_sample(block, case%sampling)
         case ('bootstrap'); call read_bootstrap(block, case%bootstrap)
         case ('noise'); call read_noise(block, case%noise_sd, case%noise_seed)
         case ('units'); call read_units(block, case%units)
         case ('design')
            case%box = box_t()
            case%design_line = block%line
            kind = 'time'
            if (size(case%recordings) > 0) kind = case%recordings(1)%kind
            call read_design(block, model%structure, case%excitations, kind, sound, case%box)
         case ('score')
            case%score = window_t()
            case%score_line = block%line
            call get_window(block, case%score)
            call block%close()
         case ('ensemble'); call read_ensemble(block, model%structure, sound, case%ensemble)
         case default; call read_list_item(block, sound, case, error)
         end select
      end associate
      call move_alloc(block%files, case%files)
   end subroutine read_group

   !> Reads a group that may repeat and appends it to its list in the case; arguments as
   !> `read_group`.
   subroutine read_list_item(block, sound, case, error)
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

      associate (model => case%model)
         select case (block%name)
         case ('along')
            call read_along(block, model%structure, along, error)
            if (.not. (block%failed() .or. allocated(error))) case%along = [case%along, along]
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
         case ('draw')
            call read_draw(block, model%structure, case%excitations, sound, case%draws, draw)
            if (.not. block%failed()) case%draws = [case%draws, draw]
         end select
      end associate
   end subroutine read_list_item

   !> Adds the text of a case and the bytes of every file that it names to a fingerprint.
   subroutine add_case(fingerprint, case)
      type(fingerprint_t), intent(inout) :: fingerprint
      !> As returned by `read_case`, also with an error: a case without text has no files.
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
