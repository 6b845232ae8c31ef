!> A case and its records: from a case file to sample times, samples, experiments.
module beamid_cases
   use beamid_blocks, only: block_t
   use beamid_boxes, only: box_t
   use beamid_case_checks, only: can_be_fitted, check_needs, check_whole, needs_design, needs_fit, &
      needs_modes, needs_nothing, needs_response, place_experiment, settle_box, &
      settle_variations
   use beamid_case_files, only: case_t, groups, new_case, read_group
   use beamid_errors, only: error_t, locate
   use beamid_experiments, only: experiment_t, is_first
   use beamid_files, only: read_text
   use beamid_input_checks, only: leave_out_lead_in
   use beamid_kinds, only: wp
   use beamid_namelist, only: scan_namelist
   use beamid_parameters, only: is_there, name_of_parameter, on_beam, parameters
   use beamid_records, only: grid, load_recording, note_length, recording_t
   use beamid_refusals, only: refusals_t, refuse
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, of_length, same_structure, structure_t
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: case_t, read_case, parse_case, sample_times, measured_samples, scored_samples, &
      load_experiments, plan_experiments, grid_times
   public :: can_be_fitted, needs_nothing, needs_modes, needs_response, needs_fit, needs_design

contains

   !> Reads and checks a case file.
   !>
   !> path   of the case file; paths inside it are relative to it
   !> needs  needs_nothing, needs_modes, needs_response or needs_fit
   !> error  one line per problem: file, line, group, key, what was found, what was expected
   subroutine read_case(path, needs, case, error)
      character(len=*), intent(in) :: path
      integer, intent(in) :: needs
      type(case_t), intent(out) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: text

      call read_text(path, text, error)
      if (.not. allocated(error)) call parse_case(path, text, needs, case, error)
   end subroutine read_case

   !> The same of the text of a case file.
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
      ! The one experiment whose response is wanted: the beam as its record has it.
      call place_experiment(case, 1, experiment, error)
      if (.not. allocated(error)) case%model%structure = experiment%structure_of( &
         case%model%structure)
   end subroutine parse_case

   !> Every group in turn, those last that are checked against the others.
   !>
   !> refusals  problems outside of the groups
   subroutine read_groups(blocks, refusals, case, error)
      type(block_t), intent(inout) :: blocks(:)
      type(refusals_t), intent(in) :: refusals
      type(case_t), intent(inout) :: case
      type(error_t), allocatable, intent(out) :: error
      character(len=*), parameter :: last(5) = [character(len=8) :: 'stage', 'prior', 'design', &
         'ensemble', 'draw']
      type(refusals_t) :: all_of_them
      integer :: k
      logical :: sound

      sound = refusals%n == 0
      do k = 1, size(blocks)
         if (blocks(k)%name == 'along') call read_group(blocks(k), sound, case, error)
         sound = sound .and. .not. blocks(k)%failed()
      end do
      do k = 1, size(blocks)
         if (.not. any(blocks(k)%name == [last, 'along   '])) call read_group(blocks(k), sound, &
            case, error)
         sound = sound .and. .not. blocks(k)%failed()
      end do
      if (sound .and. .not. allocated(error)) call settle_variations(blocks, case)
      sound = sound .and. .not. any([(blocks(k)%failed(), k=1, size(blocks))])
      if (sound) call check_whole(blocks, case)
      sound = sound .and. .not. any([(blocks(k)%failed(), k=1, size(blocks))])
      do k = 1, size(blocks)
         if (any(blocks(k)%name == last)) call read_group(blocks(k), sound, case, error)
         call all_of_them%join(blocks(k)%refusals)
      end do
      call all_of_them%join(refusals)
      call all_of_them%tell(case%path, error)
      if (allocated(error)) return
      if (size(case%excitations) > 0) case%model%excitation = case%excitations(1)
      if (size(case%stages) > 0) call set_default_start(case%stages(1))
      if (size(case%excitations) > 1 .and. size(case%excitations) /= size(case%recordings)) &
         call refuse(case%path, 0, 'excitation', to_text(size(case%excitations))// &
         ' such groups for '//to_text(size(case%recordings))//' of &record', &
         'one, or one for each record', error)

   contains

      !> Of a motion from an unknown start the record itself tells where to begin.
      subroutine set_default_start(first)
         type(stage_t), intent(inout) :: first

         first%automatic = first%automatic .or. .not. (allocated(first%start) .or. first%declared) &
            .and. size(case%excitations) > 0 .and. all(case%excitations%modes > 0) &
            .and. case%multistart%n == 0
      end subroutine set_default_start

   end subroutine read_groups

   !> The grid of sample times of &record, for a response without a record.
   subroutine sample_times(case, times, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error

      call grid_times(case, case%recordings(1), times, error)
      if (.not. allocated(error)) call check_delta(case, times, error)
   end subroutine sample_times

   !> The sample times of a record's grid.
   subroutine grid_times(case, recording, times, error)
      type(case_t), intent(in) :: case
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error

      call grid(recording%window, times, error)
      call locate(error, case%path//':'//to_text(recording%line)//': &record t_step')
   end subroutine grid_times

   !> A Delta that the sample times cannot resolve would leave differences of round-off.
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

   !> The records and how each came about; refuses fewer samples than parameters.
   !>
   !> notes  what was done to the records, a sentence each
   subroutine load_experiments(case, experiments, notes, error)
      type(case_t), intent(in) :: case
      type(experiment_t), allocatable, intent(out) :: experiments(:)
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable :: sentences(:)
      integer, allocatable :: motions(:)
      integer :: k, linear, total, unknowns

      allocate (experiments(size(case%recordings)), notes(0))
      do k = 1, size(experiments)
         associate (experiment => experiments(k), recording => case%recordings(k))
            call samples_of(case, recording, 'record', recording%line, experiment%samples, &
               experiment%measured, sentences, error)
            if (allocated(error)) return
            if (size(experiments) > 1 .and. size(sentences) > 0) &
               sentences = 'record '//to_text(k)//': '//sentences
            notes = [character(len=note_length) :: notes, sentences]
            experiment%scale = recording%scale
            experiment%offset = recording%offset
            if (allocated(recording%sd)) experiment%sd = recording%sd
            experiment%motion = recording%experiment
            call place_experiment(case, k, experiment, error)
            if (allocated(error)) return
            associate (window => recording%window)
               if (experiment%excitation%modes > 0 .and. .not. allocated(window%t_step)) &
                  call leave_out_lead_in(allocated(window%t_first), experiment%samples, &
                  experiment%measured, notes)
            end associate
         end associate
      end do
      total = sum([(size(experiments(k)%samples), k=1, size(experiments))])
      call check_channels(case, experiments, error)
      if (allocated(error)) return
      motions = experiments%motion
      linear = 2*sum(experiments%excitation%modes, mask=is_first(motions))
      do k = 1, size(case%stages)
         unknowns = size(case%stages(k)%free) + linear &
            + merge(size(experiments), 0, case%stages(k)%offset)
         if (unknowns > total) call refuse(case%path, case%stage_lines(k), 'stage free', &
            to_text(unknowns)//' unknowns for '//to_text(total)//' samples', &
            'no more unknowns than samples', error)
      end do
      if (.not. allocated(error)) call check_free_places(case, experiments, error)
   end subroutine load_experiments

   !> What there is to choose from, and the experiments as they are planned or were done: sample
   !> times and noise, nothing measured.
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
            if (allocated(recording%path)) then
               call samples_of(case, recording, 'record', recording%line, experiment%samples, &
                  experiment%measured, notes, error)
            else
               call grid_times(case, recording, experiment%samples, error)
               if (.not. allocated(error)) call check_delta(case, experiment%samples, error)
            end if
            if (allocated(error)) return
            experiment%measured = 0*experiment%samples
            experiment%scale = recording%scale
            experiment%motion = recording%experiment
            experiment%sd = box%noise_sd
            if (allocated(recording%sd)) experiment%sd = recording%sd
            call place_experiment(case, k, experiment, error)
            if (allocated(error)) return
         end associate
      end do
      call check_channels(case, experiments, error)
      if (.not. allocated(error)) call check_free_places(case, experiments, error)
   end subroutine plan_experiments

   !> Channels of one motion stand one behind the other and are of the same beam, with the same
   !> start and the same parameters.
   subroutine check_channels(case, experiments, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: first, other
      integer :: j, k, p

      do k = 2, size(experiments)
         associate (number => experiments(k)%motion, line => case%recordings(k)%line)
            j = findloc(experiments(:k - 1)%motion, number, dim=1)
            if (number == 0 .or. j == 0) cycle
            first = experiments(j)%structure_of(case%model%structure)
            other = experiments(k)%structure_of(case%model%structure)
            other%observer = first%observer
            if (experiments(k - 1)%motion /= number) then
               call refuse(case%path, line, 'record experiment', to_text(number)//' again', &
                  'records of one experiment one behind the other', error)
            else if (.not. same_structure(first, other)) then
               call refuse(case%path, line, 'record experiment', to_text(number)// &
                  ' with another beam than record '//to_text(j), 'the same beam', error)
            else if (experiments(k)%excitation%modes /= experiments(j)%excitation%modes) then
               call refuse(case%path, line, 'record experiment', to_text(number)// &
                  ' with another start than record '//to_text(j), 'the same', error)
            end if
         end associate
         do p = 1, size(case%stages)
            if (allocated(error)) return
            if (any(case%stages(p)%owners() > 0)) call refuse(case%path, case%stage_lines(p), &
               'stage shared', 'parameters that are not shared, beside channels of one '// &
               'experiment', 'all of them', error)
         end do
         if (allocated(error)) return
      end do
   end subroutine check_channels

   !> What has a free place must find one on every beam, and a beam must reach what sits on it.
   subroutine check_free_places(case, experiments, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      logical :: stretches
      integer :: i, k, p

      stretches = .false.
      do k = 1, size(case%stages)
         associate (stage => case%stages(k))
            stretches = stretches .or. any(stage%free == of_length)
            do p = 1, size(stage%free)
               do i = 1, size(experiments)
                  if (any(stage%record(p) == [0, i])) call check_place(stage%free(p))
                  if (allocated(error)) return
               end do
            end do
         end associate
      end do

   contains

      !> Parameter p of stage k, the place q among the parameters, in record i.
      subroutine check_place(q)
         integer, intent(in) :: q
         type(structure_t) :: structure
         real(wp) :: least

         structure = experiments(i)%structure_of(case%model%structure)
         associate (stage => case%stages(k))
            if (stage%record(p) == 0 .and. differs(q, structure)) then
               call refuse(case%path, case%stage_lines(k), 'stage free', trim(name_of_parameter( &
                  structure, q))//' shared by records that give it different values', &
                  'it left out of shared, or one value', error)
            else if (q == of_length) then
               least = outermost(structure, stage%free)
               if (stage%upper(p) <= least) call refuse_value('upper', stage%upper, &
                  'more than '//to_text(least)//', where the outermost of what it carries is')
               if (.not. allocated(stage%start)) return
               if (stage%start(p) < least) call refuse_value('start', stage%start, &
                  'at least '//to_text(least)//', where the outermost of what it carries is')
            else if (parameters(q)%range == on_beam) then
               if (stage%lower(p) >= structure%length) call refuse_value('lower', stage%lower, &
                  'less than the length '//to_text(structure%length)//' of the beam')
               if (stretches .or. .not. allocated(stage%start)) return
               if (stage%start(p) > structure%length) call refuse_value('start', stage%start, &
                  'at most the length '//to_text(structure%length)//' of the beam')
            end if
         end associate
      end subroutine check_place

      subroutine refuse_value(key, values, expected)
         character(len=*), intent(in) :: key, expected
         real(wp), intent(in) :: values(:)

         call refuse(case%path, case%stage_lines(k), 'stage '//key, to_text(values(p))//' for '// &
            trim(name_of_parameter(case%model%structure, case%stages(k)%free(p))), expected, error)
      end subroutine refuse_value

      !> Whether parameter q has another value in record i than in the first.
      logical function differs(q, structure)
         integer, intent(in) :: q
         type(structure_t), intent(in) :: structure
         type(structure_t) :: first

         differs = .false.
         if (q > n_parameters) return
         if (parameters(q)%group == 'sensor' .and. parameters(q)%item /= experiments(i)%sensor) &
            return
         first = experiments(1)%structure_of(case%model%structure)
         differs = abs(structure%get(q) - first%get(q)) > 0
      end function differs

   end subroutine check_free_places

   !> The outermost place that does not move along the beam.
   pure real(wp) function outermost(structure, free)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: free(:)
      integer :: k

      outermost = 0
      do k = 1, n_parameters
         if (parameters(k)%range /= on_beam .or. .not. is_there(structure, k)) cycle
         if (.not. (structure%follows_tip(k) .or. any(free == k))) &
            outermost = max(outermost, structure%get(k))
      end do
   end function outermost

   !> The samples of the first record.
   !>
   !> samples, measured  (m) [time], [length/time**2]
   subroutine measured_samples(case, samples, measured, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t), allocatable :: experiments(:)
      character(len=note_length), allocatable :: notes(:)

      call load_experiments(case, experiments, notes, error)
      if (allocated(error)) return
      samples = experiments(1)%samples
      measured = experiments(1)%measured
   end subroutine measured_samples

   !> The samples of the window of &score; none without such a group.
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
      call samples_of(case, recording, 'score', case%score_line, samples, measured, notes, error)
   end subroutine scored_samples

   !> The samples of one window of a record.
   subroutine samples_of(case, recording, group, line, samples, measured, notes, error)
      type(case_t), intent(in) :: case
      type(recording_t), intent(in) :: recording
      character(len=*), intent(in) :: group
      integer, intent(in) :: line
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      type(recording_t) :: labelled

      labelled = recording
      labelled%time_unit = case%units%time
      call load_recording(labelled, samples, measured, notes, error, &
         place=case%path//':'//to_text(line)//': &'//group//': ')
      if (.not. allocated(error)) call check_delta(case, samples, error)
   end subroutine samples_of

end module beamid_cases
