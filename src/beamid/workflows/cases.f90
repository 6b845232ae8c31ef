!> A case and its records: reads case files and turns their `&record` groups into sample times,
!> samples and experiments, which fits and designs start from.
module beamid_cases
   use beamid_blocks, only: block_t
   use beamid_boxes, only: box_t, plan_record
   use beamid_case_checks, only: can_be_fitted, check_needs, needs_design, needs_fit, needs_modes, &
      needs_nothing, needs_response, place_experiment, settle_box
   use beamid_case_files, only: case_t, groups, new_case, read_group
   use beamid_column_checks, only: check_columns
   use beamid_errors, only: error_t, locate
   use beamid_experiment_checks, only: check_channels, check_free_places
   use beamid_experiments, only: experiment_t, is_first
   use beamid_files, only: read_text
   use beamid_frequency_data, only: load_frequency_data, plan_lines
   use beamid_group_checks, only: check_whole, settle_variations
   use beamid_input_checks, only: leave_out_lead_in
   use beamid_kinds, only: wp
   use beamid_model_checks, only: check_stage
   use beamid_namelist, only: scan_namelist
   use beamid_records, only: are_in_time, columns_t, grid, load_recording, note_length, recording_t
   use beamid_refusals, only: refusals_t, refuse
   use beamid_strings, only: to_text
   use beamid_structure_checks, only: check_structure
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: case_t, read_case, parse_case, sample_times, measured_samples, scored_samples, &
      load_experiments, plan_experiments, grid_times, describe_experiment
   public :: can_be_fitted, needs_nothing, needs_modes, needs_response, needs_fit, needs_design

contains

   !> Reads and checks a case file.
   !>
   !> path   of the case file; paths inside the file are relative to its folder
   !> needs  what the command requires of the case: needs_nothing, needs_modes, needs_response,
   !>        needs_fit or needs_design
   !> error  one line per problem: file, line, group, key, the value found, the values expected
   subroutine read_case(path, needs, case, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: needs
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: text

      call read_text(path, text, error)
      if (.not. allocated(error)) call parse_case(path, text, needs, case, error)
   end subroutine read_case

   !> Parses and checks the text of a case file.
   !>
   !> path   name of the case in messages, and the file whose folder relative paths start from
   !> text   content of the case file
   !> needs  as in `read_case`
   !> error  as in `read_case`
   subroutine parse_case(path, text, needs, case, error)
      character(len=*), intent(in) :: path, text
      integer, intent(in) :: needs
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      type(block_t), allocatable :: blocks(:)
      type(refusals_t) :: refusals
      type(experiment_t) :: experiment

      case = new_case(path)
      case%text = text
      call scan_namelist(text, groups, blocks, refusals)
      call read_groups(blocks, refusals, case, error)
      if (.not. allocated(error)) call check_needs(case, needs, error)
      if (allocated(error) .or. needs /= needs_response) return
      ! A response is computed for the first record: the model takes over the length and positions
      ! that the record states.
      call place_experiment(case, 1, experiment, error)
      if (.not. allocated(error)) case%model%structure = experiment%structure_of( &
         case%model%structure)
   end subroutine parse_case

   !> Reads every group into the case: &along first, and last the groups that are checked against
   !> the others.
   !>
   !> refusals  problems found outside the groups
   !> error     all problems, one line each
   subroutine read_groups(blocks, refusals, case, error)
      type(block_t), intent(inout) :: blocks(:)
      type(refusals_t), intent(in) :: refusals
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: checked_last(6) = [character(len=8) :: 'stage', 'prior', &
         'design', 'ensemble', 'draw', 'track']
      type(refusals_t) :: all_refusals
      integer :: k
      logical :: sound

      sound = refusals%n == 0
      do k = 1, size(blocks)
         if (blocks(k)%name == 'along') call read_group(blocks(k), sound, case, error)
         sound = sound .and. .not. blocks(k)%failed()
      end do
      do k = 1, size(blocks)
         if (.not. any(blocks(k)%name == [checked_last, 'along   '])) &
            call read_group(blocks(k), sound, case, error)
         sound = sound .and. .not. blocks(k)%failed()
      end do
      if (sound .and. .not. allocated(error)) call settle_variations(blocks, case)
      sound = sound .and. .not. any([(blocks(k)%failed(), k=1, size(blocks))])
      if (sound) call check_whole(blocks, case)
      sound = sound .and. .not. any([(blocks(k)%failed(), k=1, size(blocks))])
      do k = 1, size(blocks)
         if (any(blocks(k)%name == checked_last)) call read_group(blocks(k), sound, case, error)
         call all_refusals%join(blocks(k)%refusals)
      end do
      call all_refusals%join(refusals)
      call all_refusals%tell(case%path, error)
      if (allocated(error)) return
      if (size(case%excitations) > 0) case%model%excitation = case%excitations(1)
      if (size(case%stages) > 0) call set_default_start(case%stages(1))
      if (size(case%excitations) > 1 .and. size(case%excitations) /= size(case%recordings)) &
         call refuse(case%path, 0, 'excitation', to_text(size(case%excitations))// &
         ' such groups for '//to_text(size(case%recordings))//' of &record', &
         'one, or one for each record', error)

   contains

      !> Takes the start values of the first stage from the records if the case gives none and every
      !> motion has an unknown start.
      subroutine set_default_start(first)
         type(stage_t), intent(inout) :: first


         if (allocated(first%start) .or. first%declared .or. case%multistart%n > 0) return
         first%automatic = first%automatic .or. size(case%excitations) > 0 .and. &
            all(case%excitations%modes > 0) .or. .not. are_in_time(case%recordings)
      end subroutine set_default_start

   end subroutine read_groups

   !> Returns the sample times of a response: those of the first record if it is in memory, or its
   !> grid.
   !>
   !> times  (m) ascending [time]
   !> error  an invalid grid, or a time step of the difference formulas that it cannot resolve
   subroutine sample_times(case, times, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error

      if (allocated(case%recordings(1)%t)) then
         times = case%recordings(1)%t
      else
         call grid_times(case, case%recordings(1), times, error)
      end if
      if (.not. allocated(error)) call check_delta(case, times, error)
   end subroutine sample_times

   !> Returns the sample times of a record's grid.
   !>
   !> times  (m) ascending [time]
   !> error  t_first, t_last and t_step that make no grid
   subroutine grid_times(case, recording, times, error)
      type(case_t), intent(in) :: case
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error

      call grid(recording%window, times, error)
      call locate(error, case%path//':'//to_text(recording%line)//': &record t_step')
   end subroutine grid_times

   !> Refuses a time step Delta of the difference formulas (4.1) and (4.2) below a millionth of the
   !> last sample time: the differences would consist of round-off.
   subroutine check_delta(case, times, error)
      type(case_t), intent(in) :: case
      real(wp), intent(in) :: times(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: least

      least = 1e-6_wp*maxval(abs(times))
      associate (delta => case%model%observation%delta)
         if (delta > 0 .and. delta < least) call refuse(case%path, 0, 'observation delta', &
            to_text(delta), 'at least '//to_text(least)//', a millionth of the last time', error)
      end associate
   end subroutine check_delta

   !> Loads the records and describes the experiment that each of them comes from.
   !>
   !> case         on return with more elements if the mesh is refined automatically, and a table of
   !>              modes needs them
   !> experiments  (records)
   !> notes        one sentence for each change made to the records, such as clipped samples removed
   !> error        a record that cannot be read; records that contradict one another; a stage with
   !>              more unknowns than samples; a structure or a stage that a program has made
   !>              invalid after `read_case`
   subroutine load_experiments(case, experiments, notes, error)
      type(case_t), intent(inout) :: case
      type(experiment_t), allocatable, intent(out) :: experiments(:)
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable :: sentences(:)
      integer, allocatable :: motions(:)
      character(len=7) :: noun
      integer :: k, linear, total, unknowns

      allocate (experiments(size(case%recordings)), notes(0))
      call check_structure(case%model%structure, error)
      do k = 1, size(case%stages)
         if (.not. allocated(error)) call check_stage(case%stages(k), .true., error)
      end do
      if (allocated(error)) return
      do k = 1, size(experiments)
         associate (experiment => experiments(k), recording => case%recordings(k))
            if (recording%kind == 'time') then
               call load_samples(case, recording, k, 'record', experiment%samples, &
                  experiment%measured, sentences, error)
               if (.not. allocated(error)) call describe_experiment(case, k, experiment, error)
               experiment%offset = recording%offset
            else
               call describe_experiment(case, k, experiment, error)
               if (.not. allocated(error)) call load_frequency_data(case, k, experiment, &
                  sentences, error)
            end if
            if (allocated(error)) return
            associate (window => recording%window)
               if (experiment%excitation%modes > 0 .and. .not. allocated(window%t_step)) &
                  call leave_out_lead_in(allocated(window%t_first), experiment%samples, &
                  experiment%measured, sentences)
            end associate
            if (size(experiments) > 1 .and. size(sentences) > 0) &
               sentences = 'record '//to_text(k)//': '//sentences
            notes = [character(len=note_length) :: notes, sentences]
         end associate
      end do
      total = sum([(size(experiments(k)%measured), k=1, size(experiments))])
      call check_channels(case, experiments, error)
      if (allocated(error)) return
      motions = experiments%motion
      linear = 2*sum(experiments%excitation%modes, mask=is_first(motions))
      do k = 1, size(case%stages)
         unknowns = size(case%stages(k)%free) + linear &
            + merge(size(experiments), 0, case%stages(k)%offset)
         noun = merge('samples', 'values ', are_in_time(case%recordings))
         if (unknowns > total) call refuse(case%path, case%stage_lines(k), 'stage free', &
            to_text(unknowns)//' unknowns for '//to_text(total)//' '//trim(noun), &
            'no more unknowns than '//trim(noun), error)
      end do
      if (.not. allocated(error)) call check_free_places(case, experiments, error)
   end subroutine load_experiments

   !> Returns the settings that a design chooses from and the experiments as planned or done, with
   !> sample times and noise but without measured values.
   !>
   !> box          lists of settings of &design, with the defaults of the case
   !> experiments  (records); `measured` is 0
   !> error        as in `load_experiments`, or an invalid grid of sample times
   subroutine plan_experiments(case, box, experiments, error)
      type(case_t), intent(in) :: case
      type(box_t), intent(out) :: box
      type(experiment_t), allocatable, intent(out) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable :: notes(:)
      integer :: k

      call settle_box(case, box)
      allocate (experiments(size(case%recordings)))
      do k = 1, size(experiments)
         associate (experiment => experiments(k), recording => case%recordings(k))
            if (recording%kind == 'frf') then
               call plan_lines(case%path, recording, box%noise_sd, experiment, error)
            else if (allocated(recording%path)) then
               call load_samples(case, recording, k, 'record', experiment%samples, &
                  experiment%measured, notes, error)
            else
               call grid_times(case, recording, experiment%samples, error)
               if (.not. allocated(error)) call check_delta(case, experiment%samples, error)
            end if
            if (allocated(error)) return
            if (recording%kind == 'time') call plan_record(experiment%samples, box%noise_sd, &
               experiment)
            call describe_experiment(case, k, experiment, error)
            if (allocated(error)) return
         end associate
      end do
      call check_channels(case, experiments, error)
      if (.not. allocated(error)) call check_free_places(case, experiments, error)
   end subroutine plan_experiments

   !> Sets scale, noise level, number of the motion and positions of experiment k from its &record.
   !>
   !> experiment  with its samples; `sd` remains as it is if the record states none
   !> error       a length or a position that does not fit the beam
   subroutine describe_experiment(case, k, experiment, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      type(experiment_t), intent(inout) :: experiment
      type(error_t), allocatable, intent(out) :: error

      associate (recording => case%recordings(k))
         if (recording%kind == 'time') then
            experiment%scale = recording%scale
            if (allocated(recording%sd)) experiment%sd = recording%sd
         end if
         experiment%motion = recording%experiment
      end associate
      call place_experiment(case, k, experiment, error)
   end subroutine describe_experiment

   !> Loads the samples of the first record.
   !>
   !> samples   (m) sample times, ascending [time]
   !> measured  (m) acceleration [length/time**2]
   !> error     as in `load_experiments`
   subroutine measured_samples(case, samples, measured, error)
      type(case_t), intent(inout) :: case
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t), allocatable :: experiments(:)
      character(len=note_length), allocatable :: notes(:)

      call load_experiments(case, experiments, notes, error)
      if (allocated(error)) return
      samples = experiments(1)%samples
      measured = experiments(1)%measured
   end subroutine measured_samples

   !> Loads the samples of the first record in the window of &score; returns empty arrays without
   !> this group.
   !>
   !> samples   (m) sample times, ascending [time]
   !> measured  (m) acceleration [length/time**2]
   !> error     a window that cannot be read
   subroutine scored_samples(case, samples, measured, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(recording_t) :: recording
      character(len=note_length), allocatable :: notes(:)

      if (.not. allocated(case%score)) then
         allocate (samples(0), measured(0))
         return
      end if
      recording = case%recordings(1)
      recording%window = case%score
      recording%line = case%score_line
      call load_samples(case, recording, 1, 'score', samples, measured, notes, error)
   end subroutine scored_samples

   !> Loads the samples of a record in its window.
   !>
   !> k         number of the record
   !> group     name of the group that the window comes from, for messages
   !> samples   (m) sample times, ascending [time]
   !> measured  (m) acceleration [length/time**2]
   !> notes     one sentence for each change made to the record
   !> error     a record that cannot be read, columns in other units than those of the case, or an
   !>           unresolved time step (`check_delta`)
   subroutine load_samples(case, recording, k, group, samples, measured, notes, error)
      type(case_t), intent(in) :: case
      type(recording_t), intent(in) :: recording
      integer, intent(in) :: k
      character(len=*), intent(in) :: group
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      type(recording_t) :: labelled
      type(columns_t) :: columns

      labelled = recording
      labelled%time_unit = case%units%time
      call load_recording(labelled, samples, measured, notes, error, &
         place=case%path//':'//to_text(recording%line)//': &'//group//': ', columns=columns)
      if (.not. allocated(error)) call check_columns(case, k, columns, samples, notes, error)
      if (.not. allocated(error)) call check_delta(case, samples, error)
   end subroutine load_samples

end module beamid_cases
