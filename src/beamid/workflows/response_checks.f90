!> Compares frequency responses and tables of modes with the model before the fit, and looks for the
!> likely cause of a gross difference: a sign, a unit, another quantity, decibels, radians.
module beamid_response_checks
   use beamid_case_files, only: case_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_frequency_responses, only: frequency_response_t, quantities
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_input_checks, only: check_units, find_frequencies
   use beamid_kinds, only: two_pi, wp
   use beamid_least_squares, only: options_t
   use beamid_linear_unknowns, only: linear_t
   use beamid_modal, only: modal_t
   use beamid_modal_tables, only: assign_modes, modal_table_t
   use beamid_observed_data, only: seen_modes_t
   use beamid_peak_starts, only: fit_to_modes
   use beamid_records, only: add_note, note_length
   use beamid_refusals, only: refuse
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_response_peaks, only: find_peaks, peak_t
   use beamid_responses, only: is_exact, work_t
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: is_coefficient, structure_t
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: check_responses

   !> A unit that a measured response may have instead of that of the case.
   type :: hypothesis_t
      real(wp) :: factor = 1          !< of the response, if it has this unit
      character(len=72) :: cause = ''
   end type hypothesis_t

   real(wp), parameter :: g = 9.80665_wp
   type(hypothesis_t), parameter :: hypotheses(*) = [ &
      hypothesis_t(1/g, 'the accelerations look like multiples of g'), &
      hypothesis_t(g, 'the force looks like one in kgf'), &
      hypothesis_t(1e3_wp, 'the motion looks like one in mm'), &
      hypothesis_t(1e-3_wp, 'the force looks like one in mN, or the response like one per kN'), &
      hypothesis_t(1e6_wp, 'the motion looks like one in micrometres')]

contains

   !> Checks every record that is not a function of time. A response of the opposite sign is
   !> negated, with a note.
   !>
   !> experiments  (records)
   !> notes        what has been changed
   !> error        one sentence with the likely cause of a gross difference
   subroutine check_responses(case, experiments, notes, error)
      type(case_t), intent(in) :: case
      type(experiment_t), intent(inout) :: experiments(:)
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: problem
      type(error_t), allocatable :: failed
      type(options_t) :: options
      type(stage_t) :: stage
      integer :: k, r

      do r = 1, size(experiments)
         if (.not. allocated(experiments(r)%observed)) cycle
         call check_frequencies(case, r, experiments(r), error)
         if (.not. allocated(error)) call check_damping(case, r, experiments(r), error)
         if (allocated(error)) return
      end do
      if (size(case%stages) == 0 .or. .not. is_exact(case%model%solver)) return
      if (any(is_coefficient(case%stages(1)%free)) .or. .not. any([(is_response(experiments(r)), &
         r=1, size(experiments))])) return
      stage = case%stages(1)
      call new_residuals(case%model, case%meshes(minloc(case%meshes%elements, dim=1)), &
         experiments, problem, failed, [(case%stages(k)%free, k=1, size(case%stages))])
      if (allocated(failed)) return
      call set_free(problem, stage)
      call fit_to_modes(problem, stage, options, failed)
      if (allocated(failed)) return
      do r = 1, size(experiments)
         if (is_response(experiments(r))) call check_response(case, r, problem, experiments(r), &
            notes, error)
         if (allocated(error)) return
      end do
   end subroutine check_responses

   !> Returns whether an experiment is a frequency response.
   logical function is_response(experiment)
      type(experiment_t), intent(in) :: experiment

      is_response = .false.
      if (allocated(experiment%observed)) is_response = experiment%observed%kind() == 'frf'
   end function is_response

   !> Compares the resonances of a record with the natural frequencies of the model.
   !>
   !> r      number of the record
   !> error  a value of the case or the frequencies look like another unit
   subroutine check_frequencies(case, r, experiment, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: r
      type(experiment_t), intent(in) :: experiment
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 8
      !> Factor of all frequencies that wrong parameters can explain.
      real(wp), parameter :: usual = 1.8_wp
      real(wp), parameter :: units(*) = [two_pi, 1e3_wp, 1e-3_wp, 60.0_wp]
      character(len=10), parameter :: names(*) = [character(len=10) :: 'rad/s', 'mHz', 'kHz', &
         'per minute']
      real(wp), allocatable :: measured(:), computed(:)
      integer, allocatable :: modes(:)
      type(peak_t), allocatable :: peaks(:)
      real(wp) :: factor, other, scatter
      integer :: k
      logical :: is_numbered

      select type (observed => experiment%observed)
      type is (frequency_response_t)
         peaks = find_peaks(observed%frequency, observed%h, observed%noise, &
            observed%noise_is_known, 4)
         measured = peaks%frequency
      type is (modal_table_t)
         measured = observed%frequency
         modes = observed%mode
      class default
         return
      end select
      k = most
      if (allocated(modes)) k = max(k, maxval(modes))
      call find_frequencies(experiment%structure_of(case%model%structure), k, computed)
      if (.not. allocated(computed) .or. size(measured) == 0) return
      computed = pack(computed, computed > 0)
      if (size(measured) > size(computed)) return
      is_numbered = allocated(modes)
      if (.not. is_numbered) then
         allocate (modes(size(measured)))
         call assign_modes(measured, computed, modes)
      end if
      if (any(modes == 0) .or. any(modes > size(computed))) return
      call compare_frequencies(measured, computed(modes), factor, scatter)
      if (abs(log(factor)) < log(usual)) then
         ! Frequencies in rad/s may lie near those of higher modes. In Hz they agree far better.
         k = 1
         if (is_numbered .or. size(measured) < 2 .or. scatter < log(1.03_wp)) return
         call assign_modes(measured/units(k), computed, modes)
         if (any(modes == 0)) return
         call compare_frequencies(measured/units(k), computed(modes), factor, other)
         if (abs(log(factor)) > log(usual) .or. other > scatter/5) return
         factor = factor*units(k)
      else
         call check_units(case, experiment, size(computed), computed, measured(1), error)
         if (allocated(error) .or. size(measured) < 2) return
         k = minloc(abs(log(factor/units)), dim=1)
         if (abs(log(factor/units(k))) > log(1.25_wp)) return
      end if
      call refuse(case%path, case%recordings(r)%line, 'record file', 'frequencies that are '// &
         rounded(factor, 3)//' times those of the model, and look like '//trim(names(k)), &
         'frequencies in the reciprocal of the unit of time (Hz)', error)
   end subroutine check_frequencies

   !> Compares the damping ratios of a table of modes with those of the model at the values of the
   !> case.
   !>
   !> r      number of the record
   !> error  the ratios look like percent
   subroutine check_damping(case, r, experiment, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: r
      type(experiment_t), intent(in) :: experiment
      type(error_t), allocatable, intent(out) :: error
      !> Factor between values of the case and of a beam that are meant to be the same; geometric
      !> mean below which values are too small for percent.
      real(wp), parameter :: usual = 3, least = 0.02_wp
      real(wp), allocatable :: expected(:)
      real(wp) :: factor

      select type (observed => experiment%observed)
      type is (modal_table_t)
         if (.not. allocated(observed%damping)) return
         call find_damping(experiment%structure_of(case%model%structure), observed%frequency, &
            expected)
         if (.not. allocated(expected) .or. any(observed%damping <= 0)) return
         if (sum(log(observed%damping)) < size(expected)*log(least)) return
         factor = exp(sum(log(observed%damping/expected))/size(expected))
         if (abs(log(factor/100)) < log(usual)) call refuse(case%path, case%recordings(r)%line, &
            'record file', 'damping ratios that are '//rounded(factor, 3)// &
            ' times those of the model, and look like percent', 'ratios (2 % is 0.02)', error)
      end select
   end subroutine check_damping

   !> Computes the damping ratios of the model's modes that are nearest to some frequencies.
   !>
   !> frequencies  (n) [1/time]
   !> ratios       (n); not allocated if a mode has no damping or cannot be computed
   subroutine find_damping(structure, frequencies, ratios)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: frequencies(:)
      real(wp), allocatable, intent(out) :: ratios(:)
      integer, parameter :: most = 12
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(work_t) :: work
      type(error_t), allocatable :: error
      complex(wp), allocatable :: s(:), ds(:, :)
      logical, allocatable :: together(:)
      integer :: k

      galerkin = galerkin_of(mesh_t(elements=2*most), structure)
      call solver%prepare(galerkin, error)
      if (allocated(error)) return
      equations = new_equations(galerkin, structure, matrices=.false.)
      call solver%lowest_roots(equations, [integer ::], most, s, ds, together, work, error)
      if (allocated(error)) return
      s = pack(s, aimag(s) > 0)
      if (size(s) == 0) return
      s = [(s(minloc(abs(log(abs(s)/(two_pi*frequencies(k)))), dim=1)), k=1, size(frequencies))]
      if (all(real(s) < 0)) ratios = -real(s)/abs(s)
   end subroutine find_damping

   !> Compares frequencies with those of the model.
   !>
   !> factor   geometric mean of their ratios
   !> scatter  largest deviation of a logarithm of a ratio from that of the factor
   pure subroutine compare_frequencies(measured, computed, factor, scatter)
      real(wp), intent(in) :: measured(:), computed(:)
      real(wp), intent(out) :: factor, scatter

      factor = exp(sum(log(measured/computed))/size(measured))
      scatter = maxval(abs(log(measured/computed/factor)))
   end subroutine compare_frequencies

   !> Compares one response with that of the model that has the modes of the records.
   subroutine check_response(case, r, problem, experiment, notes, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: r
      type(residual_t), intent(inout) :: problem
      type(experiment_t), intent(inout) :: experiment
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: model(:)
      character(len=:), allocatable :: cause, remedy
      real(wp) :: least

      call response_of_model(problem, r, model)
      if (.not. allocated(model)) return
      select type (observed => experiment%observed)
      type is (frequency_response_t)
         ! A model with the right modes explains the response well enough, if signs and units agree.
         least = min(0.5_wp, distance(observed%h, model, observed%noise)/2)
         if (distance(-observed%h, model, observed%noise) < least) then
            observed%h = -observed%h
            experiment%measured = observed%values()
            call add_note(notes, 'record '//to_text(r)//': the response has the opposite sign '// &
               'of that of the model: it has been negated; check the directions of force and '// &
               'sensor')
            return
         end if
         call find_cause(observed, model, case%recordings(r)%scale, least, cause, remedy)
         if (cause /= '') call refuse(case%path, case%recordings(r)%line, 'record file', &
            'a response of '//rounded(norm2(abs(observed%h))/sqrt(real(size(model), wp)), 3)// &
            ' rms where the model has '//rounded(norm2(abs(model))/sqrt(real(size(model), wp)), &
            3)//': '//cause, remedy, error)
      end select
   end subroutine check_response

   !> Computes the response of the model in the experiment of record r, at the values of the
   !> scenario.
   !>
   !> model  (lines); not allocated if it cannot be computed
   subroutine response_of_model(problem, r, model)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: r
      complex(wp), allocatable, intent(out) :: model(:)
      type(error_t), allocatable :: failed
      type(linear_t) :: linear
      type(seen_modes_t) :: seen
      real(wp), allocatable :: y(:), none(:, :)

      allocate (y(size(problem%parts(r)%observed%measured)))
      allocate (none(size(y), 0))
      call problem%parts(r)%evaluate(problem%scenario%structures(r), &
         problem%scenario%excitations(r), .false., [integer ::], y, none, linear, problem%work, &
         failed, seen)
      if (allocated(failed)) return
      select type (observed => problem%parts(r)%observed)
      type is (frequency_response_t)
         model = observed%lines_of(y + observed%measured)
      end select
   end subroutine response_of_model

   !> Finds the hypothesis that brings measured and computed response nearest to each other.
   !>
   !> scale    factor by which the values of the file have been multiplied
   !> nearest  distance that a hypothesis must undercut
   !> cause    in words; '': none
   !> remedy   what is expected instead
   subroutine find_cause(observed, model, scale, nearest, cause, remedy)
      type(frequency_response_t), intent(in) :: observed
      complex(wp), intent(in) :: model(:)
      real(wp), intent(in) :: scale, nearest
      character(len=:), allocatable, intent(out) :: cause, remedy
      complex(wp) :: s(size(model)), direction(size(model))
      real(wp) :: least, phase(size(model))
      integer :: j, k, sign

      cause = ''
      remedy = ''
      least = nearest
      s = cmplx(observed%rate, two_pi*observed%frequency, wp)
      do sign = -1, 1, 2
         do k = 1, size(hypotheses)
            call try(observed%h, sign*hypotheses(k)%factor*model, trim(hypotheses(k)%cause), &
               'scale='//rounded(scale/hypotheses(k)%factor, 6))
         end do
         do j = 0, 2
            if (j /= observed%power) call try(observed%h, sign*s**(j - observed%power)*model, &
               'it looks like '//trim(quantities(j)), 'quantity='''//trim(quantities(j))//'''')
         end do
      end do
      ! No magnitude is larger than 600 dB, which keeps the power below from an overflow.
      if (any(abs(observed%h) > 600)) return
      phase = atan2(aimag(observed%h), real(observed%h))
      direction = exp(cmplx(0.0_wp, phase, wp))
      call try(10**(abs(observed%h)/20)*direction, model, 'the magnitudes look like decibels', &
         'magnitude = 10^(dB/20)')
      direction = exp(cmplx(0.0_wp, 360/two_pi*phase, wp))
      call try(abs(observed%h)*direction, model, 'the phases look like radians', 'degrees')

   contains

      !> Takes a hypothesis if it brings two responses nearer to each other than all before.
      subroutine try(measured, computed, words, expected)
         complex(wp), intent(in) :: measured(:), computed(:)
         character(len=*), intent(in) :: words, expected
         real(wp) :: found

         found = distance(measured, computed, observed%noise)
         if (.not. found < least) return
         least = found
         cause = words
         remedy = expected
      end subroutine try

   end subroutine find_cause

   !> Returns the distance of two responses relative to the first, in units of the noise, so that
   !> lines without information do not count.
   pure real(wp) function distance(h, other, noise)
      complex(wp), intent(in) :: h(:), other(:)
      real(wp), intent(in) :: noise(:)

      distance = norm2(abs(h - other)/noise)/max(norm2(abs(h)/noise), tiny(distance))
   end function distance

end module beamid_response_checks
