!> Loads records that are not functions of time: frequency responses and tables of modes.
module beamid_frequency_data
   use beamid_boxes, only: plan_record
   use beamid_case_files, only: case_t
   use beamid_errors, only: bad_input, error_t
   use beamid_experiments, only: experiment_t
   use beamid_frequency_responses, only: frequency_response_t, variance_from_coherence
   use beamid_frequency_tables, only: frequency_table_t, modal_rows_t, read_frequency_table, &
      read_modal_rows
   use beamid_kinds, only: two_pi, wp
   use beamid_modal_tables, only: assign_modes, modal_table_t
   use beamid_modes, only: natural_frequencies
   use beamid_records, only: add_note, frequency_keys_t, note_length, recording_t
   use beamid_refusals, only: refuse
   use beamid_strings, only: rounded, to_text
   implicit none
   private

   public :: line_frequencies, load_frequency_data, plan_lines

contains

   !> Loads record k, which is a frequency response or a table of modes.
   !>
   !> experiment  with beam and position of the sensor; on return with `observed`
   !> notes       sentences about the record
   !> error       a file that cannot be read, or keys that do not go with it
   subroutine load_frequency_data(case, k, experiment, notes, error)
      type(case_t), intent(inout) :: case
      integer, intent(in) :: k
      type(experiment_t), intent(inout) :: experiment
      character(len=note_length), allocatable, intent(out) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      type(frequency_response_t), allocatable :: response
      type(modal_table_t), allocatable :: table

      allocate (notes(0))
      experiment%samples = [real(wp) ::]
      if (case%recordings(k)%kind == 'frf') then
         allocate (response)
         call load_response(case%path, case%recordings(k), response, notes, error)
         if (allocated(error)) return
         experiment%measured = response%values()
         if (response%noise_is_known) experiment%sd = 1
         call move_alloc(response, experiment%observed)
      else
         allocate (table)
         call load_modes(case, case%recordings(k), experiment, table, notes, error)
         if (allocated(error)) return
         experiment%measured = table%values()
         experiment%sd = 1
         call move_alloc(table, experiment%observed)
      end if
   end subroutine load_frequency_data

   !> Loads a frequency response: chooses its lines, scales it and determines its noise.
   subroutine load_response(path, recording, response, notes, error)
      character(len=*), intent(in) :: path
      type(recording_t), intent(in) :: recording
      type(frequency_response_t), intent(inout) :: response
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      type(frequency_table_t) :: table
      logical, allocatable :: used(:)
      integer :: n

      call read_frequency_table(recording%path, table, error)
      if (allocated(error)) return
      associate (lines => recording%lines)
         allocate (used(size(table%h)))
         used = table%frequency > 0
         if (allocated(lines%first)) used = used .and. table%frequency >= lines%first
         if (allocated(lines%last)) used = used .and. table%frequency <= lines%last
         if (allocated(table%coherence)) then
            n = count(used .and. table%coherence < lines%least_coherence)
            used = used .and. table%coherence >= lines%least_coherence
            if (n > 0) call add_note(notes, to_text(n)//' lines with a coherence below '// &
               to_text(lines%least_coherence)//' are left out')
         else if (lines%least_coherence > 0) then
            call refuse(path, recording%line, 'record coherence_least', to_text( &
               lines%least_coherence)//' for a file without coherence', 'a column coherence', error)
            return
         end if
         if (.not. any(used)) then
            call bad_input(error, recording%path//': found no line between f_first and f_last '// &
               'with a frequency above 0, expected some')
            return
         end if
         call find_noise(path, recording, table, response, error)
         if (allocated(error)) return
         if (.not. response%noise_is_known) call warn_of_correlation( &
            correlation_of_lines(lines, table%frequency), notes)
         response%power = lines%power
         response%rate = lines%rate
         response%frequency = pack(table%frequency, used)
         response%h = recording%scale*pack(table%h, used)
         response%noise = pack(response%noise, used)
         if (allocated(table%coherence)) response%coherence = pack(table%coherence, used)
      end associate
      if (.not. any(abs(response%h - response%h(1)) > 0) .and. size(response%h) > 1) &
         call bad_input(error, recording%path//': found the same value at every frequency, '// &
         'expected a frequency response')
      call check_convention(response, notes)
      if (table%is_polar) call check_decibels(abs(table%h), notes)
   end subroutine load_response

   !> Warns of magnitudes that look like decibels: over a resonance a magnitude changes by a large
   !> factor, its logarithm by a small one.
   subroutine check_decibels(magnitude, notes)
      real(wp), intent(in) :: magnitude(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      real(wp), parameter :: factor = 10, range = 20

      if (maxval(magnitude) > factor*minval(magnitude) .or. maxval(magnitude) - minval(magnitude) &
         < range) return
      call add_note(notes, 'warning: magnitudes from '//rounded(minval(magnitude), 3)//' to '// &
         rounded(maxval(magnitude), 3)//' look like decibels; magnitude = 10^(dB/20)')
   end subroutine check_decibels

   !> Determines the standard deviation of the real and of the imaginary part of every line: from
   !> the key sd, the column sd, or the coherence and the number of averages. Without any of them it
   !> is 1, and the fit estimates it. A window correlates neighbouring lines, which raises the
   !> variance of a mean over lines (`correlation_of_lines`).
   subroutine find_noise(path, recording, table, response, error)
      character(len=*), intent(in) :: path
      type(recording_t), intent(in) :: recording
      type(frequency_table_t), intent(in) :: table
      type(frequency_response_t), intent(inout) :: response
      type(error_t), allocatable, intent(out) :: error

      associate (lines => recording%lines)
         response%noise_is_known = .true.
         if (allocated(recording%sd)) then
            response%noise = spread(recording%sd, 1, size(table%h))
         else if (allocated(table%sd)) then
            response%noise = abs(recording%scale)*table%sd
         else if (allocated(table%coherence) .and. lines%averages > 1) then
            response%noise = abs(recording%scale)*sqrt(variance_from_coherence(table%h, &
               table%coherence, lines%averages))
         else if (allocated(table%coherence)) then
            call refuse(path, recording%line, 'record averages', 'nothing beside a column '// &
               'coherence', 'the number of averaged blocks, or sd', error)
            return
         else
            response%noise_is_known = .false.
            response%noise = spread(1.0_wp, 1, size(table%h))
            return
         end if
         response%correlation = sqrt(correlation_of_lines(lines, table%frequency))
         response%noise = response%correlation*response%noise
      end associate
      if (any(.not. response%noise > 0)) call bad_input(error, recording%path// &
         ': found a response of 0, whose noise is unknown, expected other values')
   end subroutine find_noise

   !> Returns the variance inflation factor of a window: neighbouring frequencies are correlated, so
   !> that a mean over them has this many times the variance of a mean over independent ones.
   !>
   !> For a window w of the duration T it is T int(w**4)/(int(w**2))**2, the sum of the squared
   !> correlations between the noise of one line and that of all lines at distances of 1/T. This is
   !> 35/18 = 1 + 2 (2/3)**2 + 2 (1/6)**2 for a Hann window, and x coth(x) with x = a T for
   !> exp(-a t). If there are both, the larger factor counts.
   !>
   !> frequency  (n) of all lines of the file, ascending [1/time]; their least distance is 1/T
   pure real(wp) function correlation_of_lines(lines, frequency) result(factor)
      type(frequency_keys_t), intent(in) :: lines
      real(wp), intent(in) :: frequency(:)
      real(wp), parameter :: of_hann = 35.0_wp/18
      real(wp) :: x
      integer :: n

      factor = merge(of_hann, 1.0_wp, lines%is_hann)
      n = size(frequency)
      if (n < 2 .or. .not. lines%rate > 0) return
      x = lines%rate/minval(frequency(2:) - frequency(:n - 1))
      factor = max(factor, x/tanh(x))
   end function correlation_of_lines

   !> Warns if the noise is estimated and a window correlates neighbouring lines: the estimate of
   !> the noise level does not show it.
   !>
   !> factor  as of `correlation_of_lines`
   subroutine warn_of_correlation(factor, notes)
      real(wp), intent(in) :: factor
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      !> Intervals that are 10 % too narrow.
      real(wp), parameter :: harmless = 1.21_wp

      if (factor > harmless) call add_note(notes, 'warning: the window correlates neighbouring '// &
         'lines, so that intervals from estimated noise are too narrow by a factor of up to '// &
         rounded(sqrt(factor), 2)//'; state sd, or a coherence and averages')
   end subroutine warn_of_correlation

   !> Detects the convention exp(-i omega t) by a phase that rises through the resonances, and then
   !> conjugates the response and adds a note. Fewer than 16 frequencies are not checked.
   !>
   !> With exp(i omega t) the phase decreases through every resonance, whatever the sign of its
   !> residue, because a response follows its force. The sum of the phase steps, each weighted by
   !> |h|**2/noise**2, is therefore negative.
   subroutine check_convention(response, notes)
      type(frequency_response_t), intent(inout) :: response
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      !> Fewest lines, and least sum of the steps as a share of the sum of their sizes.
      integer, parameter :: enough = 16
      real(wp), parameter :: clear = 0.5_wp
      real(wp), allocatable :: steps(:)
      integer :: n

      n = size(response%h)
      if (n < enough) return
      associate (h => response%h/response%noise)
         steps = aimag(conjg(h(:n - 1))*h(2:))
      end associate
      if (.not. sum(steps) > clear*sum(abs(steps))) return
      response%h = conjg(response%h)
      call add_note(notes, 'the phase of the response rises through its resonances, as with '// &
         'the convention exp(-i omega t): the response has been conjugated')
   end subroutine check_convention

   !> Loads a table of modes, and assigns them to modes of the model. A mesh that is refined
   !> automatically starts with enough elements for them.
   subroutine load_modes(case, recording, experiment, table, notes, error)
      type(case_t), intent(inout) :: case
      type(recording_t), intent(in) :: recording
      type(experiment_t), intent(in) :: experiment
      type(modal_table_t), intent(inout) :: table
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      !> Highest mode for which the mesh is refined.
      integer, parameter :: highest = 20
      type(modal_rows_t) :: rows
      real(wp), allocatable :: computed(:)
      integer :: k

      call read_modal_rows(recording%path, rows, error)
      if (allocated(error)) return
      if (case%refines .and. allocated(rows%mode)) case%meshes%elements = &
         max(case%meshes%elements, 2*min(maxval(rows%mode), highest))
      call frequencies_of(case, experiment, computed, error)
      if (allocated(error)) return
      table%frequency = rows%frequency
      table%sd_frequency = rows%sd
      if (allocated(rows%damping)) table%damping = rows%damping
      if (allocated(rows%damping)) table%sd_damping = rows%sd_damping
      if (allocated(rows%mode)) then
         table%mode = rows%mode
      else
         allocate (table%mode(size(rows%frequency)))
         call assign_modes(rows%frequency, computed, table%mode)
         if (any(table%mode == 0)) then
            call bad_input(error, recording%path//': found '//to_text(size(table%mode))// &
               ' frequencies of which two belong to one mode of the model, expected a column '// &
               'mode with the numbers of the modes')
            return
         end if
         call add_note(notes, 'the modes of the table have no numbers; the nearest modes of '// &
            'the model are assigned to them')
      end if
      do k = 1, size(table%mode)
         if (table%mode(k) > size(computed)) then
            call bad_input(error, recording%path//': found mode '//to_text(table%mode(k))// &
               ', expected at most '//to_text(size(computed))//', the number of modes that the '// &
               'mesh resolves; use more elements')
            return
         end if
         call add_note(notes, '  '//rounded(table%frequency(k), 6)//' is mode '// &
            to_text(table%mode(k))//' (model '//rounded(computed(table%mode(k)), 6)//')')
      end do
      table%noise_is_known = .true.
   end subroutine load_modes

   !> Computes the natural frequencies of the model, without those of rigid-body motion, that the
   !> coarsest mesh can resolve.
   !>
   !> frequencies  (modes) ascending [1/time]
   subroutine frequencies_of(case, experiment, frequencies, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiment
      real(wp), allocatable, intent(out) :: frequencies(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: omega(:)

      call natural_frequencies(experiment%structure_of(case%model%structure), &
         case%meshes(minloc(case%meshes%elements, dim=1)), omega, error, fixed=.true.)
      if (allocated(error)) return
      omega = pack(omega, omega > 0)
      frequencies = omega(:max(1, size(omega)/2))/two_pi
   end subroutine frequencies_of

   !> Plans the experiment of a frequency response: with the lines of the keys f_first, f_last and
   !> f_step, or with the lines and the known noise of a file.
   !>
   !> sd  standard deviation of real and imaginary part, unless the file states the noise
   subroutine plan_lines(path, recording, sd, experiment, error)
      character(len=*), intent(in) :: path
      type(recording_t), intent(in) :: recording
      real(wp), intent(in) :: sd
      type(experiment_t), intent(inout) :: experiment
      type(error_t), allocatable, intent(out) :: error
      type(frequency_response_t), allocatable :: response
      character(len=note_length), allocatable :: notes(:)
      real(wp), allocatable :: frequency(:)

      experiment%samples = [real(wp) ::]
      allocate (response, notes(0))
      if (allocated(recording%path)) then
         call load_response(path, recording, response, notes, error)
         if (.not. allocated(error)) frequency = response%frequency
      else
         response%power = recording%lines%power
         response%rate = recording%lines%rate
         call line_frequencies(path, recording, frequency, error)
      end if
      if (allocated(error)) return
      response%correlation = sqrt(correlation_of_lines(recording%lines, frequency))
      if (response%noise_is_known) then
         experiment%measured = 0*response%values()
         experiment%sd = 1
         call move_alloc(response, experiment%observed)
      else
         call move_alloc(response, experiment%observed)
         call plan_record(frequency, sd, experiment)
      end if
   end subroutine plan_lines

   !> Returns the frequencies of a response that is computed: f_first, f_first + f_step, ... f_last.
   !>
   !> error  one of them is missing, or they make too many lines
   subroutine line_frequencies(path, recording, frequency, error)
      character(len=*), intent(in) :: path
      type(recording_t), intent(in) :: recording
      real(wp), allocatable, intent(out) :: frequency(:)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 1000000
      real(wp) :: lines
      integer :: k

      associate (keys => recording%lines)
         if (.not. (allocated(keys%first) .and. allocated(keys%last) .and. &
            allocated(keys%step))) then
            call refuse(path, recording%line, 'record', 'no list of frequencies', &
               'f_first, f_last and f_step', error)
            return
         end if
         lines = (keys%last - keys%first)/keys%step
         if (.not. lines < most) then
            call refuse(path, recording%line, 'record f_step', to_text(keys%step), 'at least '// &
               to_text((keys%last - keys%first)/most)//', which makes a million frequencies', error)
            return
         end if
         frequency = [(keys%first + k*keys%step, k=0, int(lines*(1 + 4*epsilon(lines)) + 1e-9_wp))]
      end associate
   end subroutine line_frequencies

end module beamid_frequency_data
