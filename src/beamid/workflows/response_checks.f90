!> Compares frequency responses and tables of modes with the model before the fit, and looks for the
!> likely cause of a gross difference: a sign, a unit, another quantity, decibels, radians.
module beamid_response_checks
   use beamid_case_files, only: case_t
   use beamid_errors, only: bad_input, error_t
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_frequency_responses, only: frequency_response_t, quantities
   use beamid_input_checks, only: check_units, find_frequencies
   use beamid_kinds, only: wp
   use beamid_least_squares, only: options_t
   use beamid_linear_unknowns, only: linear_t
   use beamid_modal_tables, only: assign_modes, modal_table_t
   use beamid_observed_data, only: seen_modes_t
   use beamid_peak_starts, only: start_from_peaks
   use beamid_records, only: add_note, note_length
   use beamid_refusals, only: refuse
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_response_peaks, only: find_peaks, peak_t
   use beamid_responses, only: is_exact
   use beamid_strings, only: rounded, to_text
   use beamid_structure, only: is_coefficient
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: check_responses

   !> What a measured response may be instead of the declared one: the response of the model times a
   !> factor and a power of s.
   type :: hypothesis_t
      real(wp) :: factor = 1
      integer :: powers = 0           !< of s, added to those of the declared quantity
      character(len=88) :: cause = ''
   end type hypothesis_t

   real(wp), parameter :: g = 9.80665_wp, two_pi = 2*acos(-1.0_wp)
   type(hypothesis_t), parameter :: hypotheses(*) = [ &
      hypothesis_t(1/g, 0, 'the accelerations look like multiples of g; expected scale=9.80665'), &
      hypothesis_t(g, 0, 'the force looks like one in kgf; expected scale=0.101972'), &
      hypothesis_t(1e3_wp, 0, 'the motion looks like one in mm; expected scale=0.001'), &
      hypothesis_t(1e-3_wp, 0, 'the force looks like one in mN, or the response like one per '// &
      'kN; expected scale=1000'), &
      hypothesis_t(1e6_wp, 0, 'the motion looks like one in micrometres; expected scale=1e-6')]

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
         if (allocated(experiments(r)%observed)) call check_frequencies(case, r, experiments(r), &
            error)
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
      call start_from_peaks(problem, stage, options, failed)
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
      if (.not. allocated(experiment%observed)) return
      select type (observed => experiment%observed)
      type is (frequency_response_t)
         is_response = .true.
      end select
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
      real(wp) :: factor
      integer :: k

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
      if (.not. allocated(modes)) then
         allocate (modes(size(measured)))
         call assign_modes(measured, computed, modes)
      end if
      if (any(modes == 0) .or. any(modes > size(computed))) return
      factor = exp(sum(log(measured/computed(modes)))/size(measured))
      if (abs(log(factor)) < log(usual)) return
      call check_units(case, experiment, size(computed), computed, measured(1), error)
      if (allocated(error) .or. size(measured) < 2) return
      k = minloc(abs(log(factor/units)), dim=1)
      if (abs(log(factor/units(k))) < log(1.25_wp)) call refuse(case%path, &
         case%recordings(r)%line, 'record file', 'frequencies that are '//rounded(factor, 3)// &
         ' times those of the model, and look like '//trim(names(k)), 'frequencies in the '// &
         'reciprocal of the unit of time (Hz)', error)
   end subroutine check_frequencies

   !> Compares one response with that of the model at the start values.
   subroutine check_response(case, r, problem, experiment, notes, error)
      type(case_t), intent(in) :: case
      integer, intent(in) :: r
      type(residual_t), intent(inout) :: problem
      type(experiment_t), intent(inout) :: experiment
      character(len=note_length), allocatable, intent(inout) :: notes(:)
      type(error_t), allocatable, intent(out) :: error
      complex(wp), allocatable :: model(:)
      character(len=:), allocatable :: cause
      real(wp) :: least

      call response_of_model(problem, r, model)
      if (.not. allocated(model)) return
      select type (observed => experiment%observed)
      type is (frequency_response_t)
         ! The start values explain the response well enough if it is one of the model at all.
         least = min(0.5_wp, distance(observed%h, model)/2)
         if (distance(-observed%h, model) < least) then
            observed%h = -observed%h
            experiment%measured = observed%values()
            call add_note(notes, 'record '//to_text(r)//': the response has the opposite sign '// &
               'of that of the model: it has been negated; check the directions of force and '// &
               'sensor')
            return
         end if
         call find_cause(observed, model, least, cause)
         if (cause /= '') call refuse(case%path, case%recordings(r)%line, 'record file', &
            'a response that differs grossly from that of the model, rms '// &
            rounded(norm2(abs(observed%h))/sqrt(real(size(model), wp)), 3)//' instead of '// &
            rounded(norm2(abs(model))/sqrt(real(size(model), wp)), 3), cause, error)
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
      integer :: n

      allocate (y(size(problem%parts(r)%observed%measured)))
      allocate (none(size(y), 0))
      call problem%parts(r)%evaluate(problem%scenario%structures(r), &
         problem%scenario%excitations(r), .false., [integer ::], y, none, linear, problem%work, &
         failed, seen)
      if (allocated(failed)) return
      n = size(y)/2
      select type (observed => problem%parts(r)%observed)
      type is (frequency_response_t)
         model = cmplx(y(:n) + observed%measured(:n), y(n + 1:) + observed%measured(n + 1:), wp) &
            *observed%noise
      end select
   end subroutine response_of_model

   !> Finds the hypothesis that brings measured and computed response nearest to each other.
   !>
   !> nearest  distance that a hypothesis must undercut
   !> cause    in words, with what is expected instead; '': none
   subroutine find_cause(observed, model, nearest, cause)
      type(frequency_response_t), intent(in) :: observed
      complex(wp), intent(in) :: model(:)
      real(wp), intent(in) :: nearest
      character(len=:), allocatable, intent(out) :: cause
      complex(wp) :: s(size(model)), other(size(model))
      real(wp) :: least, phase(size(model))
      integer :: j, k, sign

      cause = ''
      least = nearest
      s = cmplx(observed%rate, two_pi*observed%frequency, wp)
      do k = 1, size(hypotheses)
         do sign = -1, 1, 2
            call try(sign*hypotheses(k)%factor*model, trim(hypotheses(k)%cause))
         end do
      end do
      do j = 0, 2
         if (j == observed%power) cycle
         do sign = -1, 1, 2
            call try(sign*s**(j - observed%power)*model, 'it looks like '// &
               'quantity='''//trim(quantities(j))//'''')
         end do
      end do
      if (all(abs(observed%h) < 600)) then
         phase = atan2(aimag(observed%h), real(observed%h))
         other = 10**(abs(observed%h)/20)*exp(cmplx(0.0_wp, phase, wp))
         if (distance(other, model) < least) cause = &
            'the magnitudes look like decibels; expected magnitude = 10^(dB/20)'
         other = abs(observed%h)*exp(cmplx(0.0_wp, 360/two_pi*phase, wp))
         if (distance(other, model) < least) cause = &
            'the phases look like radians; expected degrees'
      end if

   contains

      subroutine try(response, words)
         complex(wp), intent(in) :: response(:)
         character(len=*), intent(in) :: words
         real(wp) :: found

         found = distance(observed%h, response)
         if (.not. found < least) return
         least = found
         cause = words
      end subroutine try

   end subroutine find_cause

   !> Returns the distance of two responses relative to the first.
   pure real(wp) function distance(h, other)
      complex(wp), intent(in) :: h(:), other(:)

      distance = norm2(abs(h - other))/max(norm2(abs(h)), tiny(distance))
   end function distance

end module beamid_response_checks
