!> A case and its records: sample times, samples, experiments.
module beamid_cases
   use beamid_case_files, only: case_t, needs_fit, needs_nothing, needs_response, &
      place_experiment, read_case
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_identification, only: stage_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: is_there, name_of_parameter, on_beam, parameters
   use beamid_records, only: grid, load_recording, note_length, recording_t
   use beamid_refusals, only: refuse
   use beamid_strings, only: to_text
   use beamid_structure, only: n_parameters, of_length, structure_t
   implicit none
   private

   public :: case_t, read_case, sample_times, measured_samples, scored_samples, load_experiments
   public :: needs_nothing, needs_response, needs_fit

contains

   !> The grid of sample times of &record, for a response without a record.
   subroutine sample_times(case, times, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error

      call grid(case%recordings(1)%window, times, error)
      if (allocated(error)) then
         error%message = case%path//':'//to_text(case%recordings(1)%line)//': &record t_step: '// &
            error%message
         return
      end if
      call check_delta(case, times, error)
   end subroutine sample_times

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
      integer :: k, total

      allocate (experiments(size(case%recordings)), notes(0))
      do k = 1, size(experiments)
         associate (experiment => experiments(k), recording => case%recordings(k))
            call samples_of(case, recording, 'record', recording%line, experiment%samples, &
               experiment%measured, error, sentences)
            if (allocated(error)) return
            if (size(experiments) > 1 .and. size(sentences) > 0) &
               sentences = 'record '//to_text(k)//': '//sentences
            notes = [character(len=note_length) :: notes, sentences]
            experiment%scale = recording%scale
            experiment%offset = recording%offset
            call place_experiment(case, k, experiment, error)
            if (allocated(error)) return
         end associate
      end do
      total = sum([(size(experiments(k)%samples), k=1, size(experiments))])
      do k = 1, size(case%stages)
         if (unknowns(case, k) <= total) cycle
         call refuse(case%path, case%stage_lines(k), 'stage free', &
            to_text(unknowns(case, k))//' unknowns for '//to_text(total)//' samples', &
            'no more unknowns than samples', error)
         return
      end do
      call check_free_place(case, experiments, error)
   end subroutine load_experiments

   !> What has a free place must find one on every beam, and a beam must reach what sits on it.
   subroutine check_free_place(case, experiments, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: structure
      real(wp) :: least
      logical :: stretches
      integer :: i, k, p

      stretches = .false.
      do k = 1, size(case%stages)
         associate (stage => case%stages(k))
            stretches = stretches .or. any(stage%free == of_length)
            do p = 1, size(stage%free)
               do i = 1, size(experiments)
                  if (all(stage%record(p) /= [0, i])) cycle
                  structure = experiments(i)%structure_of(case%model%structure)
                  if (differs(stage, p, i)) then
                     call refuse(case%path, case%stage_lines(k), 'stage free', trim( &
                        name_of_parameter(structure, stage%free(p)))//' shared by records that '// &
                        'give it different values', 'it left out of shared, or one value', error)
                     return
                  end if
                  if (stage%free(p) == of_length) then
                     least = outermost(structure, stage%free)
                     if (stage%upper(p) <= least) call refuse_value('upper', stage%upper(p), &
                        'more than '//to_text(least)//', where the outermost of what it carries is')
                     if (.not. allocated(stage%start)) cycle
                     if (stage%start(p) < least) call refuse_value('start', stage%start(p), &
                        'at least '//to_text(least)//', where the outermost of what it carries is')
                  else if (parameters(stage%free(p))%range == on_beam) then
                     if (stage%lower(p) >= structure%length) call refuse_value('lower', &
                        stage%lower(p), 'less than the length '//to_text(structure%length)// &
                        ' of the beam')
                     if (stretches .or. .not. allocated(stage%start)) cycle
                     if (stage%start(p) > structure%length) call refuse_value('start', &
                        stage%start(p), 'at most the length '//to_text(structure%length)// &
                        ' of the beam')
                  end if
               end do
            end do
         end associate
      end do

   contains

      !> Whether a parameter that all records share has another value in record i than in the first.
      logical function differs(stage, p, i)
         type(stage_t), intent(in) :: stage
         integer, intent(in) :: p, i
         type(structure_t) :: first, own

         differs = .false.
         if (stage%record(p) /= 0 .or. stage%free(p) > n_parameters) return
         first = experiments(1)%structure_of(case%model%structure)
         own = experiments(i)%structure_of(case%model%structure)
         if (parameters(stage%free(p))%group == 'sensor' .and. &
            parameters(stage%free(p))%item /= experiments(i)%sensor) return
         differs = abs(own%get(stage%free(p)) - first%get(stage%free(p))) > 0
      end function differs

      subroutine refuse_value(key, value, expected)
         character(len=*), intent(in) :: key, expected
         real(wp), intent(in) :: value

         call refuse(case%path, case%stage_lines(k), 'stage '//key, to_text(value)//' for '// &
            trim(name_of_parameter(structure, case%stages(k)%free(p))), expected, error)
      end subroutine refuse_value

   end subroutine check_free_place

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

   !> How many unknowns a stage has, those that enter linearly included.
   pure integer function unknowns(case, k)
      type(case_t), intent(in) :: case
      integer, intent(in) :: k
      integer :: r

      unknowns = size(case%stages(k)%free)
      do r = 1, size(case%recordings)
         unknowns = unknowns + 2*case%excitations(min(r, size(case%excitations)))%modes
         if (case%stages(k)%offset) unknowns = unknowns + 1
      end do
   end function unknowns

   !> The samples of the first record.
   !>
   !> samples, measured  (m) [time], [length/time**2]
   !> notes              what was done to the record, a sentence each
   subroutine measured_samples(case, samples, measured, error, notes)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable, intent(out), optional :: notes(:)
      type(experiment_t), allocatable :: experiments(:)
      character(len=note_length), allocatable :: sentences(:)

      call load_experiments(case, experiments, sentences, error)
      if (allocated(error)) return
      samples = experiments(1)%samples
      measured = experiments(1)%measured
      if (present(notes)) call move_alloc(sentences, notes)
   end subroutine measured_samples

   !> The samples of the window of &score; none without such a group.
   subroutine scored_samples(case, samples, measured, error)
      type(case_t), intent(in) :: case
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      type(recording_t) :: recording

      if (.not. allocated(case%score)) then
         allocate (samples(0), measured(0))
         return
      end if
      recording = case%recordings(1)
      recording%window = case%score
      call samples_of(case, recording, 'score', case%score_line, samples, measured, error)
   end subroutine scored_samples

   !> The samples of one window of a record.
   subroutine samples_of(case, recording, group, line, samples, measured, error, notes)
      type(case_t), intent(in) :: case
      type(recording_t), intent(in) :: recording
      character(len=*), intent(in) :: group
      integer, intent(in) :: line
      real(wp), allocatable, intent(out) :: samples(:), measured(:)
      type(error_t), allocatable, intent(out) :: error
      character(len=note_length), allocatable, intent(out), optional :: notes(:)
      type(recording_t) :: labelled
      character(len=note_length), allocatable :: sentences(:)

      labelled = recording
      labelled%time_unit = case%units%time
      call load_recording(labelled, samples, measured, sentences, error, &
         place=case%path//':'//to_text(line)//': &'//group//': ')
      if (allocated(error)) return
      if (present(notes)) call move_alloc(sentences, notes)
      call check_delta(case, samples, error)
   end subroutine samples_of

end module beamid_cases
