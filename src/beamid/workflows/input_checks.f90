!> Detects, before the fit, a quiet lead-in of a record, sampling that is too slow for the model,
!> and values that look like another unit.
!>
!> Only records of a free decay are checked, because the spectrum of a forced record contains that
!> of the force.
module beamid_input_checks
   use beamid_case_files, only: case_t
   use beamid_errors, only: bad_input, error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: two_pi, wp
   use beamid_modes, only: natural_frequencies
   use beamid_onsets, only: onset
   use beamid_records, only: add_note, note_length
   use beamid_sorting, only: median
   use beamid_spectra, only: strongest_peak
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: add_causes, check_input, check_units, describe_scale, find_frequencies, &
      leave_out_lead_in

   !> Ratio of frequencies that ordinary errors of E and masses explain.
   real(wp), parameter :: usual = 1.3_wp

   !> A suspicion: the value of a key looks like another unit.
   type :: suspicion_t
      character(len=12) :: group = '', key = '', unit = ''
      real(wp) :: value = 0, corrected = 0
      type(structure_t) :: structure   !< with the corrected value
   end type suspicion_t

contains

   !> Leaves out the samples before the motion, or, if the case gives t_first, only says where the
   !> motion begins. Does nothing if the record has no lead-in.
   !>
   !> has_t_first  whether the case gives t_first
   !> t, z         (m) samples of the window [time], [length/time**2]
   !> notes        on return with one more sentence
   subroutine leave_out_lead_in(has_t_first, t, z, notes)
      logical, intent(in) :: has_t_first
      real(wp), allocatable, intent(inout) :: t(:), z(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      integer :: first

      first = onset(z)
      if (first == 1) return
      if (has_t_first) then
         call add_note(notes, 'warning: the motion begins at '//to_text(t(first))// &
            ', after t_first; set t_first to this time or later')
      else
         call add_note(notes, 'the motion begins at '//to_text(t(first))//': '// &
            to_text(first - 1)//' samples before it are left out')
         t = t(first:)
         z = z(first:)
      end if
   end subroutine leave_out_lead_in

   !> Compares the natural frequencies of the model with the sampling rate and with the strongest
   !> spectral line of each record of a free decay.
   !>
   !> error  a value that looks like another unit; a first natural frequency above the Nyquist
   !>        frequency
   !> notes  modes above the Nyquist frequency
   subroutine check_input(case, experiments, notes, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: frequencies(:)
      real(wp) :: line, nyquist
      integer :: mode, modes, r

      do r = 1, size(experiments)
         associate (experiment => experiments(r))
            call compare_with_model(case, experiment, frequencies, nyquist, line)
            if (.not. allocated(frequencies)) cycle
            modes = size(frequencies)
            if (line > 0) call check_units(case, experiment, modes, frequencies, line, error)
            if (.not. allocated(error)) call check_width(case, experiment, error)
            if (allocated(error)) return
            if (frequencies(1) > nyquist) then
               call bad_input(error, case%path//': record '//to_text(r)// &
                  ': found a Nyquist frequency of '//with_unit(nyquist, case)// &
                  ', expected more than the first natural frequency of the model, '// &
                  with_unit(frequencies(1), case)// &
                  cause(experiment%samples, frequencies(1)/nyquist))
               return
            end if
            mode = findloc(frequencies > nyquist, .true., dim=1)
            if (mode > 0) call add_note(notes, 'record '//to_text(r)//': the model''s mode '// &
               to_text(mode)//' (at '//with_unit(frequencies(mode), case)// &
               ') lies above the Nyquist frequency '//with_unit(nyquist, case)// &
               '; its samples look like '//with_unit(folded(frequencies(mode), nyquist), case))
         end associate
      end do
   end subroutine check_input

   !> Returns the frequency below the Nyquist frequency whose samples are the same.
   pure real(wp) function folded(frequency, nyquist)
      real(wp), intent(in) :: frequency, nyquist

      folded = abs(frequency - 2*nyquist*anint(frequency/(2*nyquist)))
   end function folded

   !> Returns a frequency with its unit.
   function with_unit(frequency, case) result(text)
      real(wp), intent(in) :: frequency
      type(case_t), intent(in) :: case
      character(len=:), allocatable :: text

      text = trim(rounded(frequency, 4)//' '//case%units%frequency())
   end function with_unit

   !> Appends to the message of a failed fit which mistakes in the input may be its cause: the
   !> warnings of the records, and a first natural frequency that is far from the record's.
   subroutine add_causes(case, experiments, notes, text)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      character(len=*), intent(in) :: notes(:)
      character(len=:), allocatable, intent(inout) :: text
      character(len=:), allocatable :: scale
      integer :: k

      do k = 1, size(notes)
         if (index(notes(k), 'warning: ') == 1) text = text//'; '// &
            trim(notes(k)(len('warning: ') + 1:))
      end do
      call describe_scale(case, experiments, scale)
      if (scale /= '') text = text//'; '//scale
   end subroutine add_causes

   !> Describes by how much the strongest spectral line of a free decay is away from the first
   !> natural frequency of the model; '': by no more than ordinary errors explain.
   !>
   !> Whoever states a wrong sampling rate, length or thickness multiplies all frequencies.
   subroutine describe_scale(case, experiments, text)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiments(:)
      character(len=:), allocatable, intent(out) :: text
      real(wp), allocatable :: frequencies(:)
      real(wp) :: line, nyquist
      integer :: r

      text = ''
      do r = 1, size(experiments)
         call compare_with_model(case, experiments(r), frequencies, nyquist, line)
         if (.not. allocated(frequencies)) cycle
         ! A record without a line is refused by `check_frequencies` of the start search.
         if (.not. line > 0 .or. distance_to(frequencies, line) < log(usual)) cycle
         text = 'the strongest spectral line of record '//to_text(r)//' is at '// &
            with_unit(line, case)//', '//rounded(line/frequencies(1), 3)// &
            ' times the first natural frequency of the model, '// &
            with_unit(frequencies(1), case)//': check rate or the time stamps, the length and '// &
            'the height. If they are right and this line is mode 1, E is about '// &
            rounded(case%model%structure%E*(line/frequencies(1))**2, 3)
         return
      end do
   end subroutine describe_scale

   !> Computes the natural frequencies of the model in one experiment, the Nyquist frequency of its
   !> record and the strongest spectral line of the record.
   !>
   !> frequencies  (modes) [1/time]; not allocated if the record is no free decay or has few samples
   !> line         [1/time]; 0 if no line of the record stands above its noise
   subroutine compare_with_model(case, experiment, frequencies, nyquist, line)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiment
      real(wp), allocatable, intent(out) :: frequencies(:)
      real(wp), intent(out) :: nyquist, line
      integer, parameter :: enough = 50
      real(wp) :: share

      nyquist = 0
      line = 0
      if (experiment%excitation%modes == 0 .or. size(experiment%samples) < enough) return
      call find_frequencies(experiment%structure_of(case%model%structure), &
         experiment%excitation%modes, frequencies)
      if (.not. allocated(frequencies)) return
      associate (t => experiment%samples)
         nyquist = 0.5_wp/median(t(2:) - t(:size(t) - 1))
      end associate
      call strongest_peak(experiment%samples, experiment%measured, nyquist, line, share)
   end subroutine compare_with_model

   !> Returns the likely cause if the sampling seems too slow for the model. Time stamps with small
   !> steps are in seconds; then a value of the beam is the likelier cause.
   !>
   !> factor  ratio of the first natural frequency to the Nyquist frequency
   function cause(t, factor)
      real(wp), intent(in) :: t(:), factor
      real(wp), parameter :: small = 0.05_wp
      character(len=:), allocatable :: cause
      logical :: are_whole, count_samples

      are_whole = all(abs(t - anint(t)) <= 1e-9_wp*max(1.0_wp, abs(t)))
      count_samples = are_whole .and. all(abs(t(2:) - t(:size(t) - 1) - 1) <= 0)
      cause = ''
      if (count_samples) then
         cause = '; the time stamps look like sample numbers'
      else if (median(t(2:) - t(:size(t) - 1)) < small) then
         cause = '; check length, height, E and density, and their units'
      else if (factor < 1e3_wp) then
         cause = '; the time stamps look like milliseconds'
      else if (factor < 1e6_wp) then
         cause = '; the time stamps look like microseconds'
      end if
   end function cause

   !> Refuses a width that can only be in mm. It does not change the frequencies if nothing is
   !> attached to the beam, and they change little with small masses.
   subroutine check_width(case, experiment, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiment
      type(error_t), allocatable, intent(out) :: error
      type(structure_t) :: structure

      if (.not. has_typical_sizes(case) .or. experiment%excitation%modes == 0) return
      structure = experiment%structure_of(case%model%structure)
      associate (width => case%section%width)
         if (width > 10*structure%length) call bad_input(error, case%path// &
            ': &beam width: found '//rounded(width, 4)//', which looks like mm: the length is '// &
            rounded(structure%length, 4)//'; expected '//rounded(width/1000, 4)// &
            ' in the units of the case')
      end associate
   end subroutine check_width

   !> Tells whether the labels of a case are those of the SI. Without labels a value has no typical
   !> size.
   pure logical function has_typical_sizes(case)
      type(case_t), intent(in) :: case

      has_typical_sizes = case%units%length == 'm' .and. case%units%time == 's' .and. &
         (case%units%mass == 'kg' .or. case%units%force == 'N')
   end function has_typical_sizes

   !> Looks for a value that has a typical size in another unit and makes the first modes of the
   !> model agree with the strongest line of the record.
   !>
   !> frequencies  (modes) natural frequencies of the model [1/time]
   !> line         strongest spectral line of the record [1/time]
   !> error        says which value, and what it looks like
   subroutine check_units(case, experiment, modes, frequencies, line, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiment
      integer, intent(in) :: modes
      real(wp), intent(in) :: frequencies(:), line
      type(error_t), allocatable, intent(out) :: error
      !> A corrected value must lead within this ratio, and at least halve the logarithmic distance.
      real(wp), parameter :: near = 2
      type(suspicion_t), allocatable :: suspicions(:)
      real(wp), allocatable :: corrected(:)
      real(wp) :: distance, least
      integer :: best, k

      least = min(log(near), distance_to(frequencies, line)/2)
      if (distance_to(frequencies, line) < log(usual)) return
      call list_suspicions(case, experiment, suspicions)
      best = 0
      do k = 1, size(suspicions)
         call find_frequencies(suspicions(k)%structure, modes, corrected)
         if (.not. allocated(corrected)) cycle
         distance = distance_to(corrected, line)
         if (distance >= least) cycle
         least = distance
         best = k
      end do
      if (best == 0) return
      associate (s => suspicions(best))
         call bad_input(error, case%path//': &'//trim(s%group)//' '//trim(s%key)//': found '// &
            rounded(s%value, 4)//', which looks like '//trim(s%unit)//': the first natural '// &
            'frequency of the model is '//with_unit(frequencies(1), case)// &
            ', but the strongest line of the record is at '//with_unit(line, case)// &
            '; expected '// &
            rounded(s%corrected, 4)//' in the units of the case')
      end associate
   end subroutine check_units

   !> Lists the values that would be typical in another unit.
   subroutine list_suspicions(case, experiment, suspicions)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(in) :: experiment
      type(suspicion_t), allocatable, intent(out) :: suspicions(:)
      type(structure_t) :: s
      real(wp) :: mass
      integer :: i

      allocate (suspicions(0))
      if (.not. has_typical_sizes(case)) return
      s = experiment%structure_of(case%model%structure)
      mass = s%rho*s%length
      if (s%E < 2e3_wp) call add(scaled(E=1e9_wp), 'beam', 'E', 'GPa', s%E, 1e9_wp)
      if (s%E < 2e6_wp) call add(scaled(E=1e6_wp), 'beam', 'E', 'MPa', s%E, 1e6_wp)
      if (s%length >= 5) then
         call add(scaled(length=1e-3_wp), 'beam', 'length', 'mm', s%length, 1e-3_wp)
         call add(scaled(length=1e-3_wp, section=1e-3_wp), 'beam', 'length', 'mm', s%length, &
            1e-3_wp)
         call add(scaled(length=1e-2_wp), 'beam', 'length', 'cm', s%length, 1e-2_wp)
         call add(scaled(length=1e-2_wp, section=1e-2_wp), 'beam', 'length', 'cm', s%length, &
            1e-2_wp)
      end if
      associate (section => case%section)
         if (section%height > 0) then
            if (section%height >= s%length .or. section%height >= 0.5_wp) then
               call add(scaled(section=1e-3_wp), 'beam', 'height', 'mm', section%height, 1e-3_wp)
               call add(scaled(height=1e-3_wp), 'beam', 'height', 'mm', section%height, 1e-3_wp)
            end if
            if (section%density >= 0.3_wp .and. section%density <= 25) &
               call add(scaled(rho=1e3_wp), 'beam', 'density', 'g/cm^3', section%density, 1e3_wp)
         end if
      end associate
      do i = 1, s%sensors
         if (s%sensor(i)%m_S > mass .and. s%sensor(i)%m_S >= 0.2_wp) &
            call add(scaled(m_S=1e-3_wp), 'sensor', 'm_S', 'g', s%sensor(i)%m_S, 1e-3_wp)
      end do
      if (s%m_T > mass .and. s%m_T >= 0.2_wp) &
         call add(scaled(m_T=1e-3_wp), 'tip', 'm_T', 'g', s%m_T, 1e-3_wp)

   contains

      !> Returns the structure with some of its values multiplied by factors: `section` scales
      !> width and height.
      function scaled(E, length, section, height, rho, m_S, m_T) result(other)
         real(wp), intent(in), optional :: E, length, section, height, rho, m_S, m_T
         type(structure_t) :: other

         other = s
         if (present(E)) other%E = s%E*E
         if (present(rho)) other%rho = s%rho*rho
         if (present(m_T)) other%m_T = s%m_T*m_T
         if (present(m_S)) other%sensor%m_S = s%sensor%m_S*m_S
         if (present(length)) then
            other%length = s%length*length
            ! Positions within the corrected length are already in its unit.
            where (s%sensor%x_S > other%length) other%sensor%x_S = s%sensor%x_S*length
            where (s%support%x_P > other%length) other%support%x_P = s%support%x_P*length
         end if
         if (present(section)) then
            other%I = s%I*section**4
            other%rho = s%rho*section**2
         end if
         if (present(height)) then
            other%I = s%I*height**3
            other%rho = s%rho*height
         end if
      end function scaled

      subroutine add(structure, group, key, unit, value, factor)
         type(structure_t), intent(in) :: structure
         character(len=*), intent(in) :: group, key, unit
         real(wp), intent(in) :: value, factor
         type(suspicion_t) :: new

         new%group = group
         new%key = key
         new%unit = unit
         new%value = value
         new%corrected = value*factor
         new%structure = structure
         suspicions = [suspicions, new]
      end subroutine add

   end subroutine list_suspicions

   !> Computes the undamped natural frequencies of a structure on a coarse mesh.
   !>
   !> frequencies  (modes) [1/time]; not allocated if they cannot be computed
   subroutine find_frequencies(structure, modes, frequencies)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: modes
      real(wp), allocatable, intent(out) :: frequencies(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:)

      call natural_frequencies(structure, mesh_t(elements=max(8, 2*modes)), omega, error)
      if (allocated(error)) return
      if (size(omega) < modes) return
      frequencies = omega(:modes)/two_pi
   end subroutine find_frequencies

   !> Returns how far the strongest line is from the nearest natural frequency, as the absolute
   !> logarithm of their ratio.
   pure real(wp) function distance_to(frequencies, line)
      real(wp), intent(in) :: frequencies(:), line

      distance_to = minval(abs(log(max(frequencies, tiny(line))/line)))
   end function distance_to

end module beamid_input_checks
