!> Frequency responses: the motion of the sensor per unit force at given frequencies, a kind of
!> observed data.
!>
!> With s = a + 2 pi i f and the transfer function h(s) = o'Q(s)**-1 F of displacement to force, the
!> prediction is s**p h(s): receptance (p = 0), mobility (p = 1) or accelerance (p = 2). The rate a
!> is that of an exponential window exp(-a t), by which the recorder has multiplied the response to
!> a blow at t = 0; otherwise it is 0.
module beamid_frequency_responses
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: two_pi, wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_observed_data, only: meshed_model_t, observed_data_t, seen_modes_t, trial_t
   use beamid_responses, only: exact_solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: frequency_response_t, predict_response, variance_from_coherence

   !> Names of the quantities; the power of s is the position less 1.
   character(len=*), parameter, public :: quantities(0:2) = [character(len=11) :: 'receptance', &
      'mobility', 'accelerance']

   !> A measured frequency response. The values are the real parts of all lines, then the imaginary
   !> parts, each divided by its `noise`.
   type, extends(observed_data_t) :: frequency_response_t
      real(wp), allocatable :: frequency(:)   !< (n) [1/time]
      complex(wp), allocatable :: h(:)        !< (n) as measured
      integer :: power = 2                    !< p of s**p h(s)
      real(wp) :: rate = 0                    !< a of the exponential window [1/time]
      !> (n) standard deviation of real and imaginary part; 1 if it is not known
      real(wp), allocatable :: noise(:)
      !> square root of the variance inflation factor of a window, which `noise` includes
      real(wp) :: correlation = 1
      real(wp), allocatable :: coherence(:)   !< (n) for the tables; not allocated: unknown
   contains
      procedure :: evaluate
      procedure :: sequence
      procedure :: groups => resonances
      procedure :: plain
      procedure :: take
      procedure :: kind
      procedure :: description
      procedure :: values
      procedure :: lines_of
   end type frequency_response_t

contains

   !> Returns the values of the rows (2 n): parts of the measured response, divided by the noise.
   pure function values(self)
      class(frequency_response_t), intent(in) :: self
      real(wp) :: values(2*size(self%h))

      values = [real(self%h)/self%noise, aimag(self%h)/self%noise]
   end function values

   !> Replaces the measured response.
   pure subroutine take(self, values)
      class(frequency_response_t), intent(inout) :: self
      real(wp), intent(in) :: values(:)

      self%measured = values
      self%h = self%lines_of(values)
   end subroutine take

   !> Returns real and imaginary parts without the division by the noise.
   pure function plain(self, r)
      class(frequency_response_t), intent(in) :: self
      real(wp), intent(in) :: r(:)
      real(wp), allocatable :: plain(:)

      plain = [self%noise, self%noise]*r
   end function plain

   !> Returns 'frf'.
   pure function kind(self)
      class(frequency_response_t), intent(in) :: self
      character(len=5) :: kind

      kind = 'frf'
   end function kind

   !> Returns the complex values (n) of rows (2 n), without the division by the noise.
   pure function lines_of(self, rows) result(lines)
      class(frequency_response_t), intent(in) :: self
      real(wp), intent(in) :: rows(:)
      complex(wp) :: lines(size(self%noise))

      associate (n => size(self%noise))
         lines = cmplx(rows(:n), rows(n + 1:), wp)*self%noise
      end associate
   end function lines_of

   !> Returns a description of the lines and of their noise.
   function description(self) result(text)
      class(frequency_response_t), intent(in) :: self
      character(len=:), allocatable :: text

      associate (n => size(self%frequency))
         text = to_text(n)//trim(merge(' line ', ' lines', n == 1))//' of '// &
            trim(quantities(self%power))//', f = '//to_text(self%frequency(1))//' to '// &
            to_text(self%frequency(n))
      end associate
      if (self%noise_is_known) then
         text = text//', with known noise'
      else
         text = text//', noise estimated from the residuals'
      end if
      text = text//'; residuals are tested for white noise along the frequency'
   end function description

   !> Returns the rows that the test for white noise uses: every third frequency, because a Hann
   !> window correlates neighbouring ones.
   pure function sequence(self)
      class(frequency_response_t), intent(in) :: self
      integer, allocatable :: sequence(:)
      integer, parameter :: distance = 3
      integer :: k, n

      n = size(self%frequency)
      sequence = [[(k, k=1, n, distance)], [(n + k, k=1, n, distance)]]
   end function sequence

   !> Returns the groups of the rows: the lines around each resonance of the fitted response,
   !> between the minima of its magnitude on either side.
   pure function resonances(self, residual) result(group)
      class(frequency_response_t), intent(in) :: self
      real(wp), intent(in) :: residual(:)
      integer :: group(size(self%measured))
      real(wp) :: h(size(self%h))
      integer :: k, number
      logical :: has_peak

      h = abs(self%lines_of(self%measured + residual))
      number = 1
      has_peak = .false.
      associate (n => size(h))
         do k = 1, n
            group(k) = number
            if (k == 1 .or. k == n) cycle
            if (h(k) > h(k - 1) .and. h(k) >= h(k + 1)) has_peak = .true.
            if (has_peak .and. h(k) < h(k - 1) .and. h(k) <= h(k + 1)) then
               number = number + 1
               has_peak = .false.
            end if
         end do
         if (.not. has_peak) where (group(:n) == number) group(:n) = max(1, number - 1)
         group(n + 1:) = group(:n)
      end associate
   end function resonances

   !> Returns the variance of the real part and of the imaginary part of a frequency response that
   !> is the average of n blocks, |h|**2 (1 - c)/(2 (n - 1) c) with the coherence c (Bendat and
   !> Piersol, Random Data, 4th edition, section 9.1; n - 1 because n is small), as a running mean.
   !>
   !> Without the mean, lines whose coherence happens to be high would outweigh all others.
   !>
   !> h, coherence  (lines)
   !> averages      n >= 2
   pure function variance_from_coherence(h, coherence, averages) result(variance)
      complex(wp), intent(in) :: h(:)
      real(wp), intent(in) :: coherence(:)
      integer, intent(in) :: averages
      real(wp) :: variance(size(h))
      !> Lines on either side of the mean, and least noise as a share of the magnitude.
      integer, parameter :: reach = 10
      real(wp), parameter :: least = 1e-6_wp
      real(wp) :: raw(size(h))
      integer :: first, k, last

      raw = abs(h)**2*max(1 - coherence, least**2)/(2*(averages - 1)*max(coherence, least))
      do k = 1, size(h)
         first = max(1, k - reach)
         last = min(size(h), k + reach)
         variance(k) = sum(raw(first:last))/(last - first + 1)
      end do
   end function variance_from_coherence

   !> Computes the frequency response of a structure, and its derivatives.
   !>
   !> power       p of s**p h(s)
   !> rate        a of the exponential window [1/time]
   !> frequency   (n) [1/time]
   !> parameters  (p) numbers of the parameters to differentiate by
   !> h           (n, 0:p) column 0 is the response, column p its derivative
   !> error       the solver has no transfer function; a root on the imaginary axis
   subroutine predict_response(model, structure, excitation, power, rate, frequency, parameters, &
      h, work, error)
      type(meshed_model_t), intent(inout), target :: model
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: power, parameters(:)
      real(wp), intent(in) :: rate, frequency(:)
      complex(wp), intent(out) :: h(:, 0:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations
      complex(wp) :: s(size(frequency))
      integer :: k

      s = cmplx(rate, two_pi*frequency, wp)
      equations = new_equations(model%galerkin, structure, excitation, matrices=.false.)
      select type (solver => model%solver)
      class is (exact_solver_t)
         call solver%transfer(equations, s, power == 2, parameters, h, work, error)
      class default
         call failure(error, 'this method has no frequency response')
      end select
      if (allocated(error)) return
      do k = 0, size(parameters)
         h(:, k) = s**power*h(:, k)
      end do
   end subroutine predict_response

   !> Computes the frequency response of the model minus the measured one, and its derivatives.
   !> Arguments as of `observed_data_t`. There are no linear unknowns.
   subroutine evaluate(self, trial, y, dy, linear, work, error, first)
      class(frequency_response_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      complex(wp) :: h(size(self%frequency), 0:size(trial%parameters))
      integer :: k, n

      if (trial%offset) then
         call failure(error, 'a frequency response has no offset')
         return
      end if
      call predict_response(trial%model, trial%structure, trial%excitation, self%power, self%rate, &
         self%frequency, trial%parameters, h, work, error)
      if (allocated(error)) return
      n = size(self%frequency)
      y(:n) = real(h(:, 0))/self%noise - self%measured(:n)
      y(n + 1:) = aimag(h(:, 0))/self%noise - self%measured(n + 1:)
      do k = 1, size(trial%parameters)
         dy(:n, k) = real(h(:, k))/self%noise
         dy(n + 1:, k) = aimag(h(:, k))/self%noise
      end do
      if (.not. allocated(first%modes)) allocate (first%modes(0))
   end subroutine evaluate

end module beamid_frequency_responses
