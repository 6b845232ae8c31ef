!> Other parameter values that give a model the natural frequencies of a fit.
!>
!> Where the ratio of two frequencies has an extremum (a fold), two sets of parameters have the same
!> frequencies. A free motion with unknown amplitudes cannot tell them apart, and J has two equal
!> minima, which may be far from each other. The combination of parameters that changes the
!> frequencies least leads from one to the other: its largest component is varied over the range in
!> which a fit is accepted, and the other parameters follow so that the frequencies are met as
!> closely as possible. Each minimum of the misfit of the frequencies is such a set.
module beamid_equal_frequencies
   use beamid_assignments, only: assignment_t, fit_frequencies, lines_t
   use beamid_errors, only: error_t
   use beamid_fit_setups, only: set_free
   use beamid_kinds, only: two_pi, wp
   use beamid_lapack, only: dgesvd
   use beamid_model_roots, only: belief_t, damps
   use beamid_residuals, only: residual_t
   use beamid_trials, only: accepted_range, trial_t
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: find_equal_frequencies

   !> Relative standard deviation of the frequencies: smaller than any record can tell, so that the
   !> expected values decide only what the frequencies leave open.
   real(wp), parameter :: frequency_error = 1e-5_wp
   !> Smallest and largest step of the varied parameter [standard deviations], and the ratio of
   !> neighbouring steps. Twins that are closer than the first step are within one interval.
   real(wp), parameter :: first_step = 0.002_wp, largest_step = 0.05_wp, growth = 1.2_wp

contains

   !> Finds other parameter values with the frequencies of a fit.
   !>
   !> problem  the fit with its free parameters
   !> stage    the same parameters
   !> beliefs  (free) expected values
   !> trial    the fit whose frequencies are to be met
   !> modes    number of modes whose frequencies are to be met, the lowest ones
   !> values   (free, n) values of the searched variables; damping as in the fit
   subroutine find_equal_frequencies(problem, stage, beliefs, trial, modes, values)
      type(residual_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage
      type(belief_t), intent(in) :: beliefs(:)
      type(trial_t), intent(in) :: trial
      integer, intent(in) :: modes
      real(wp), allocatable, intent(out) :: values(:, :)
      type(belief_t) :: near(size(beliefs))
      type(lines_t) :: lines(size(problem%parts))
      type(assignment_t) :: found
      type(error_t), allocatable :: error
      real(wp), allocatable :: minima(:, :)
      logical :: is_damping(size(beliefs))
      integer :: k, r, varied

      allocate (values(size(beliefs), 0))
      do k = 1, size(beliefs)
         is_damping(k) = damps(reshape(trial%ds(:, :, k), [size(trial%s)]))
      end do
      call find_varied(trial, beliefs, is_damping, modes, varied)
      if (varied == 0) return
      do r = 1, size(lines)
         allocate (lines(r)%line(modes))
         lines(r)%line%frequency = aimag(trial%s(:modes, r))/two_pi
      end do
      near = beliefs
      where (is_damping .and. trial%fit%estimate > 0) near%centre = trial%fit%estimate
      call follow(problem, stage, near, lines, trial%fit%estimate, varied, minima)
      do k = 1, size(minima, 2)
         found%place = all_in_order(lines)
         found%value = minima(:, k)
         call fit_frequencies(problem, near, lines, frequency_error, found, error)
         if (.not. allocated(error)) values = reshape([values, found%value], &
            [size(beliefs), size(values, 2) + 1])
      end do
   end subroutine find_equal_frequencies

   !> Returns the assignment of each line to the mode with its number (modes, records).
   pure function all_in_order(lines) result(place)
      type(lines_t), intent(in) :: lines(:)
      integer :: place(size(lines(1)%line), size(lines)), k

      place = spread([(k, k=1, size(place, 1))], 2, size(lines))
   end function all_in_order

   !> Finds the largest component of the combination of parameters that changes the frequencies
   !> least, in standard deviations of the expected values.
   !>
   !> varied  its number; 0: fewer than two parameters change the frequencies
   subroutine find_varied(trial, beliefs, is_damping, modes, varied)
      type(trial_t), intent(in) :: trial
      type(belief_t), intent(in) :: beliefs(:)
      logical, intent(in) :: is_damping(:)
      integer, intent(in) :: modes
      integer, intent(out) :: varied
      integer, allocatable :: columns(:)
      real(wp), allocatable :: a(:, :), vt(:, :), sigma(:), work(:)
      real(wp) :: u(1, 1)
      integer :: info, k, m, n

      varied = 0
      columns = pack([(k, k=1, size(beliefs))], .not. is_damping)
      n = size(columns)
      if (n < 2) return
      m = modes*size(trial%s, 2)
      ! Rows of 0 make the matrix as long as it is wide.
      allocate (a(max(n, m), n), source=0.0_wp)
      do k = 1, n
         associate (b => beliefs(columns(k)))
            a(:m, k) = reshape(aimag(trial%ds(:modes, :, columns(k)))/aimag(trial%s(:modes, :)), &
               [m])*b%slope(trial%fit%estimate(columns(k)))*b%width
         end associate
      end do
      allocate (vt(n, n), sigma(n), work(10*size(a, 1)))
      call dgesvd('N', 'A', size(a, 1), n, a, size(a, 1), sigma, u, 1, vt, n, work, size(work), &
         info)
      if (info == 0) varied = columns(maxloc(abs(vt(n, :)), dim=1))
   end subroutine find_varied

   !> Varies one parameter in both directions from an estimate. The others follow the frequencies.
   !>
   !> lines     (records) frequencies to be met
   !> estimate  (free) where to begin
   !> varied    index of the parameter
   !> minima    (free, n) parameters where the misfit has a minimum, except the estimate
   subroutine follow(problem, stage, beliefs, lines, estimate, varied, minima)
      type(residual_t), intent(in) :: problem
      type(stage_t), intent(in) :: stage
      type(belief_t), intent(in) :: beliefs(:)
      type(lines_t), intent(in) :: lines(:)
      real(wp), intent(in) :: estimate(:)
      integer, intent(in) :: varied
      real(wp), allocatable, intent(out) :: minima(:, :)
      type(residual_t) :: rest
      type(assignment_t) :: found
      type(error_t), allocatable :: error
      logical :: is_other(size(estimate))
      real(wp) :: u, step, cost(2), before(size(estimate)), now(size(estimate))
      integer :: k, side

      allocate (minima(size(estimate), 0))
      call problem%copy_to(rest)
      is_other = [(k /= varied, k=1, size(estimate))]
      call set_free(rest, stage%without(.not. is_other))
      associate (b => beliefs(varied))
         do side = -1, 1, 2
            u = (b%x_of(estimate(varied)) - b%x_of(b%centre))/b%width
            step = first_step
            cost = 0
            now = estimate
            found%value = pack(estimate, is_other)
            found%place = all_in_order(lines)
            do
               ! The last steps lead beyond the range, as a minimum needs neighbours on both sides.
               if (side*u > accepted_range(b) + largest_step) exit
               u = u + side*step
               step = min(growth*step, largest_step)
               before = now
               now(varied) = b%value_of(b%x_of(b%centre) + u*b%width)
               if (now(varied) < 0) exit
               call rest%scenario%set(problem%free(varied), problem%record(varied), now(varied))
               call fit_frequencies(rest, pack(beliefs, is_other), lines, frequency_error, found, &
                  error)
               if (allocated(error)) exit
               now = unpack(found%value, is_other, now)
               if (cost(2) < cost(1) .and. cost(2) < found%cost) minima = reshape([minima, &
                  before], [size(estimate), size(minima, 2) + 1])
               cost = [cost(2), found%cost]
            end do
         end do
      end associate
   end subroutine follow

end module beamid_equal_frequencies
