!> Modal tables: natural frequencies and damping ratios with their standard deviations, a kind of
!> observed data.
!>
!> With a root s of the structure, the natural frequency is |s|/(2 pi) and the damping ratio
!> -Re(s)/|s|, as in modes.csv.
module beamid_modal_tables
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: two_pi, wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_observed_data, only: observed_data_t, seen_modes_t, trial_t
   use beamid_responses, only: exact_solver_t, work_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: assign_modes, modal_table_t

   !> Measured modes. The values are the frequencies, then the damping ratios if there are any, each
   !> divided by its standard deviation.
   type, extends(observed_data_t) :: modal_table_t
      integer, allocatable :: mode(:)                !< (n) number of each mode
      real(wp), allocatable :: frequency(:), sd_frequency(:)   !< (n) [1/time]
      !> (n) damping ratios and their standard deviations; not allocated: not measured
      real(wp), allocatable :: damping(:), sd_damping(:)
   contains
      procedure :: evaluate
      procedure :: sequence
      procedure :: plain
      procedure :: take
      procedure :: kind
      procedure :: description
      procedure :: values
   end type modal_table_t

contains

   !> Returns the values of the rows.
   pure function values(self)
      class(modal_table_t), intent(in) :: self
      real(wp), allocatable :: values(:)

      values = self%frequency/self%sd_frequency
      if (allocated(self%damping)) values = [values, self%damping/self%sd_damping]
   end function values

   !> Replaces the measured modes.
   pure subroutine take(self, values)
      class(modal_table_t), intent(inout) :: self
      real(wp), intent(in) :: values(:)
      integer :: n

      n = size(self%mode)
      self%measured = values
      self%frequency = values(:n)*self%sd_frequency
      if (allocated(self%damping)) self%damping = values(n + 1:)*self%sd_damping
   end subroutine take

   !> Returns the rows that hold frequencies [1/time], without those of damping ratios.
   pure function plain(self, r)
      class(modal_table_t), intent(in) :: self
      real(wp), intent(in) :: r(:)
      real(wp), allocatable :: plain(:)

      plain = self%sd_frequency*r(:size(self%mode))
   end function plain

   !> Returns 'modes'.
   pure function kind(self)
      class(modal_table_t), intent(in) :: self
      character(len=5) :: kind

      kind = 'modes'
   end function kind

   !> Returns a description of the table.
   function description(self) result(text)
      class(modal_table_t), intent(in) :: self
      character(len=:), allocatable :: text

      text = to_text(size(self%mode))//' natural frequencies'
      if (allocated(self%damping)) text = text//' and damping ratios'
      text = text//'; modes have no order, so there is no test for white noise'
   end function description

   !> Returns an empty array: modes have no order in which their errors could be correlated.
   pure function sequence(self)
      class(modal_table_t), intent(in) :: self
      integer, allocatable :: sequence(:)

      sequence = pack(self%mode, .false.)
   end function sequence

   !> Assigns measured frequencies to modes of the model.
   !>
   !> A wrong modulus multiplies all frequencies of the model by nearly the same factor. Each pair
   !> of a measured and a computed frequency suggests a factor. With each factor, every measured
   !> frequency belongs to the nearest mode. The chosen factor minimises the
   !> sum of (log(ratio)/0.05)**2 over the pairs, plus 3 log(1 + (log(factor)/0.15)**2). This
   !> penalty is quadratic up to a factor of about 1.15, the effect of 30 % of E. Beyond, it grows
   !> only logarithmically, because a unit error can produce any factor.
   !>
   !> measured  (n) ascending or not [1/time]
   !> computed  (m) ascending, m >= n [1/time]
   !> modes     (n) number of the mode of each measured frequency; 0 if two of them are nearest to
   !>           the same mode with every factor
   pure subroutine assign_modes(measured, computed, modes)
      real(wp), intent(in) :: measured(:), computed(:)
      integer, intent(out) :: modes(:)
      !> Standard deviations of the common factor and of the ratio of frequencies, and the weight of
      !> the penalty.
      real(wp), parameter :: of_factor = 0.15_wp, of_ratio = 0.05_wp, weight = 3
      integer :: candidate(size(measured)), i, j, k
      real(wp) :: cost, factor, least

      modes = 0
      least = huge(least)
      do i = 1, size(measured)
         do j = 1, size(computed)
            factor = measured(i)/computed(j)
            candidate = [(minloc(abs(log(measured(k)/(factor*computed))), dim=1), &
               k=1, size(measured))]
            if (any([(any(candidate(k + 1:) == candidate(k)), k=1, size(candidate))])) cycle
            cost = weight*log(1 + (log(factor)/of_factor)**2) &
               + sum((log(measured/(factor*computed(candidate)))/of_ratio)**2)
            if (cost >= least) cycle
            least = cost
            modes = candidate
         end do
      end do
   end subroutine assign_modes

   !> Computes the modes of the model minus the measured ones, and their derivatives. Arguments as
   !> of `observed_data_t`. There are no linear unknowns.
   subroutine evaluate(self, trial, y, dy, linear, work, error, first)
      class(modal_table_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      type(equations_t), target :: equations
      complex(wp) :: s(max(0, maxval(self%mode))), ds(size(s), size(trial%parameters))
      real(wp) :: d_size(size(self%mode))
      integer :: n, p

      if (trial%offset) then
         call failure(error, 'a table of modes has no offset')
         return
      end if
      if (.not. allocated(first%modes)) allocate (first%modes(0))
      if (size(self%mode) == 0) return
      equations = new_equations(trial%model%galerkin, trial%structure, trial%excitation, &
         matrices=.false.)
      select type (solver => trial%model%solver)
      class is (exact_solver_t)
         call solver%free_motion(equations, trial%parameters, s, ds, work, error)
      class default
         call failure(error, 'this method has no modes')
      end select
      if (allocated(error)) return
      n = size(self%mode)
      associate (root => s(self%mode), change => ds(self%mode, :), sd => self%sd_frequency, &
         damped => self%sd_damping)
         y(:n) = abs(root)/two_pi/sd - self%measured(:n)
         if (size(y) > n) y(n + 1:) = -real(root)/abs(root)/damped - self%measured(n + 1:)
         do p = 1, size(trial%parameters)
            d_size = real(conjg(root)*change(:, p))/abs(root)
            dy(:n, p) = d_size/two_pi/sd
            if (size(y) > n) dy(n + 1:, p) = (real(root)*d_size/abs(root) - real(change(:, p))) &
               /abs(root)/damped
         end do
      end associate
   end subroutine evaluate

end module beamid_modal_tables
