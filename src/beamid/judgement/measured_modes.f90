!> Natural frequencies and damping ratios as the records alone show them: each root may deviate
!> freely from that of a fitted model, which only supplies the start and the modes out of reach.
!>
!> Such estimates do not depend on the damping mechanism of the model. They exist for free decays,
!> for frequency responses, where the residue of each mode is free as well, and for tables of modes.
module beamid_measured_modes
   use beamid_deviations, only: deviation_columns, set_deviations
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_frequency_responses, only: frequency_response_t
   use beamid_galerkin, only: mesh_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_identification, only: model_t, stage_fit_t
   use beamid_kinds, only: two_pi, wp
   use beamid_modal_tables, only: modal_table_t
   use beamid_parameters, only: offset
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_responses, only: exact_solver_t
   use beamid_statistics, only: new_statistics, statistics_t
   implicit none
   private

   public :: measure_modes

   !> A measured mode.
   type, public :: measured_mode_t
      integer :: record = 1            !< number of the record, or of the first channel of a motion
      integer :: mode = 0              !< number of the mode
      real(wp) :: frequency = 0        !< |s|/(2 pi) [1/time]
      real(wp) :: sd_frequency = 0     !< its standard error [1/time]
      real(wp) :: damping = 0          !< damping ratio, -Re(s)/|s|
      real(wp) :: sd_damping = 0       !< its standard error
   end type measured_mode_t

   !> A fit of the roots of one motion.
   type, abstract :: roots_fit_t
      integer, allocatable :: mode(:)      !< (n) numbers of the modes
      complex(wp), allocatable :: s(:)     !< (n) roots of the model [1/time]
      integer :: unknowns = 2              !< unknowns for each root
      type(residual_t) :: problem          !< the records of the motion
   contains
      procedure(evaluate_rows), deferred :: evaluate
   end type roots_fit_t

   abstract interface
      !> Computes the residuals and their derivatives.
      !>
      !> x        unknowns; first real and imaginary part of the deviation of each root [1/time]
      !> r        (m) residuals
      !> columns  (m, size(x) or more) derivatives; the further ones are those with respect to
      !>          linear unknowns, which have been eliminated
      subroutine evaluate_rows(self, x, r, columns, error)
         import :: error_t, roots_fit_t, wp
         class(roots_fit_t), intent(inout) :: self
         real(wp), intent(in) :: x(:)
         real(wp), allocatable, intent(out) :: r(:), columns(:, :)
         type(error_t), allocatable, intent(out) :: error
      end subroutine evaluate_rows
   end interface

   !> The roots of a free decay.
   type, extends(roots_fit_t) :: decay_fit_t
   contains
      procedure :: evaluate => evaluate_decay
   end type decay_fit_t

   !> The roots of a frequency response. Real and imaginary part of the change of each residue are
   !> unknowns as well.
   type, extends(roots_fit_t) :: response_fit_t
      complex(wp), allocatable :: residue(:)   !< (n) residues of h(s) at the roots of the model
   contains
      procedure :: evaluate => evaluate_response
   end type response_fit_t

contains

   !> Measures the modes of all records.
   !>
   !> found  a fit of all records, whose modes are the start
   !> modes  in the order of the records; a record that shows no mode by itself, because a known
   !>        force acts on the beam, has none, nor has one whose fit of the roots does not converge
   !> error  the model of a record cannot be computed
   subroutine measure_modes(model, mesh, experiments, found, modes, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: found
      type(measured_mode_t), allocatable, intent(out) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      type(residual_t) :: problem
      type(fitted_mode_t), allocatable :: fitted(:)
      class(roots_fit_t), allocatable :: roots
      integer, parameter :: most = 12
      integer :: first, last

      allocate (modes(0))
      call fitted_modes(mesh, found, most, fitted, error)
      if (allocated(error)) return
      first = 1
      do while (first <= size(experiments))
         last = first
         if (experiments(first)%motion > 0) last = findloc(experiments%motion, &
            experiments(first)%motion, dim=1, back=.true.)
         call new_residuals(model, mesh, experiments(first:last), problem, error, found%free)
         if (allocated(error)) return
         call restore(problem, found, first, last)
         if (allocated(roots)) deallocate (roots)
         select type (observed => problem%parts(1)%observed)
         type is (modal_table_t)
            if (allocated(observed%damping)) modes = [modes, modes_of_table(observed, first)]
         type is (frequency_response_t)
            call new_response_fit(problem, observed, pack(fitted, fitted%record == first .and. &
               .not. fitted%together), roots, error)
         class default
            call new_decay_fit(problem, pack(fitted, fitted%record == first), roots)
         end select
         if (allocated(roots)) call add_modes(roots, first, modes, error)
         if (allocated(error)) return
         first = last + 1
      end do
   end subroutine measure_modes

   !> Gives a problem with some of the records the estimates of the fit as fixed values.
   pure subroutine restore(problem, found, first, last)
      type(residual_t), intent(inout) :: problem
      type(stage_fit_t), intent(in) :: found
      integer, intent(in) :: first, last

      problem%scenario%structures = found%scenario%structures(first:last)
      problem%scenario%excitations = found%scenario%excitations(first:last)
      problem%weight = found%weight(first:last)
      problem%offset = any(found%quantities%parameter == offset)
      deallocate (problem%priors)
      allocate (problem%priors(0), problem%free(0), problem%record(0))
   end subroutine restore

   !> Returns the modes of a table.
   pure function modes_of_table(table, record) result(modes)
      type(modal_table_t), intent(in) :: table
      integer, intent(in) :: record
      type(measured_mode_t) :: modes(size(table%mode))

      modes%record = record
      modes%mode = table%mode
      modes%frequency = table%frequency
      modes%sd_frequency = table%sd_frequency
      modes%damping = table%damping
      modes%sd_damping = table%sd_damping
   end function modes_of_table

   !> Makes the fit of the roots of a free decay.
   !>
   !> fitted  modes of the model
   !> roots   not allocated: the record is no free decay
   subroutine new_decay_fit(problem, fitted, roots)
      type(residual_t), intent(in) :: problem
      type(fitted_mode_t), intent(in) :: fitted(:)
      class(roots_fit_t), allocatable, intent(inout) :: roots
      type(decay_fit_t), allocatable :: decay
      integer :: k, n

      n = problem%scenario%excitations(1)%modes
      if (n == 0 .or. n > size(fitted)) return
      if (any(fitted(:n)%together)) return
      allocate (decay)
      call problem%copy_to(decay%problem)
      decay%mode = [(k, k=1, n)]
      decay%s = fitted(:n)%s
      call move_alloc(decay, roots)
   end subroutine new_decay_fit

   !> Makes the fit of the roots of a frequency response, of the modes that stand out of the noise.
   !>
   !> fitted  modes of the model
   !> roots   not allocated: there is none
   subroutine new_response_fit(problem, response, fitted, roots, error)
      type(residual_t), intent(inout), target :: problem
      type(frequency_response_t), intent(in) :: response
      type(fitted_mode_t), intent(in) :: fitted(:)
      class(roots_fit_t), allocatable, intent(inout) :: roots
      type(error_t), allocatable, intent(out) :: error
      !> Least height of a resonance in standard deviations of the noise at one frequency.
      real(wp), parameter :: clear = 10
      type(response_fit_t), allocatable :: fit
      complex(wp), allocatable :: s(:), residue(:)
      logical, allocatable :: seen(:)
      real(wp) :: noise
      integer :: k

      s = fitted%s
      seen = abs(aimag(s)) > 0 .and. fitted%frequency > minval(response%frequency) .and. &
         fitted%frequency < maxval(response%frequency)
      allocate (residue(size(s)))
      do k = 1, size(s)
         if (.not. seen(k)) cycle
         call find_residue(problem, s, k, residue(k), error)
         if (allocated(error)) return
         noise = response%noise(minloc(abs(response%frequency - fitted(k)%frequency), dim=1)) &
            /problem%weight(1)
         seen(k) = abs(residue(k)*s(k)**response%power/(response%rate - real(s(k)))) > clear*noise
      end do
      if (.not. any(seen)) return
      allocate (fit)
      call problem%copy_to(fit%problem)
      fit%unknowns = 4
      fit%mode = pack([(k, k=1, size(s))], seen)
      fit%s = pack(s, seen)
      fit%residue = pack(residue, seen)
      call move_alloc(fit, roots)
   end subroutine new_response_fit

   !> Computes the residue of the transfer function h(s) at a root: the mean over a circle of
   !> h(s) (s - root). With n points and other roots at four times the radius, the error is about
   !> 4**-n.
   !>
   !> s  (n) roots
   !> k  number of the root
   subroutine find_residue(problem, s, k, residue, error)
      type(residual_t), intent(inout), target :: problem
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: k
      complex(wp), intent(out) :: residue
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: points = 24
      type(equations_t), target :: equations
      complex(wp) :: circle(points), h(points, 0:0)
      real(wp) :: distance
      integer :: j

      distance = 2*aimag(s(k))
      do j = 1, size(s)
         if (j /= k) distance = min(distance, abs(s(j) - s(k)))
      end do
      circle = [(exp(cmplx(0, two_pi*j/points, wp)), j=1, points)]*distance/4
      residue = 0
      equations = new_equations(problem%parts(1)%galerkin, problem%scenario%structures(1), &
         problem%scenario%excitations(1), matrices=.false.)
      select type (solver => problem%parts(1)%solver)
      class is (exact_solver_t)
         call solver%transfer(equations, s(k) + circle, .false., [integer ::], h, problem%work, &
            error)
         if (.not. allocated(error)) residue = sum(h(:, 0)*circle)/points
      class default
         call failure(error, 'this method has no frequency response')
      end select
   end subroutine find_residue

   !> Fits the roots, and adds the measured modes if the fit converges and leaves degrees of
   !> freedom.
   subroutine add_modes(roots, record, modes, error)
      class(roots_fit_t), intent(inout) :: roots
      integer, intent(in) :: record
      type(measured_mode_t), allocatable, intent(inout) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      integer, parameter :: most = 30
      real(wp), parameter :: small = 1e-3_wp   ! last step in standard errors
      type(statistics_t) :: statistics
      type(error_t), allocatable :: failed
      real(wp), allocatable :: columns(:, :), r(:), scales(:), step(:), x(:)
      real(wp) :: largest
      logical :: is_settled
      integer :: k, n, rank

      n = size(roots%s)
      allocate (x(roots%unknowns*n), source=0.0_wp)
      is_settled = .false.
      do k = 1, most
         call roots%evaluate(x, r, columns, error)
         if (allocated(error)) return
         scales = 1/max(norm2(columns, dim=1), tiny(1.0_wp))
         allocate (step(size(scales)))
         call least_squares_step(columns, r, scales, spread(.true., 1, size(scales)), &
            epsilon(1.0_wp)*size(r), step, rank)
         call new_statistics(columns, r, scales, scales, statistics, failed)
         if (allocated(failed)) return
         is_settled = all(abs(step(:2*n)) < small*statistics%std_error(:2*n))
         if (is_settled) exit
         ! No step makes a mode grow, or changes its damping by more than a factor of 2.
         largest = maxval(abs(step(:2*n:2))/max(abs(real(roots%s) + x(:2*n:2)), tiny(1.0_wp)))
         x = x + step(:size(x))*min(1.0_wp, 0.5_wp/max(largest, tiny(1.0_wp)))
         deallocate (step)
      end do
      if (is_settled) modes = [modes, modes_of(roots, record, x(:2*n), statistics)]
   end subroutine add_modes

   !> Returns the measured modes. If the residuals are not white, the standard errors grow by the
   !> factor that `statistics` finds for the real part of the root.
   !>
   !> x  (2 n) real and imaginary parts of the deviations
   function modes_of(roots, record, x, statistics) result(modes)
      class(roots_fit_t), intent(in) :: roots
      integer, intent(in) :: record
      real(wp), intent(in) :: x(:)
      type(statistics_t), intent(in) :: statistics
      type(measured_mode_t) :: modes(size(roots%s))
      complex(wp) :: s
      real(wp) :: along(2), across(2), factor
      integer :: k

      modes%record = record
      modes%mode = roots%mode
      do k = 1, size(modes)
         s = roots%s(k) + cmplx(x(2*k - 1), x(2*k), wp)
         along = [real(s), aimag(s)]/abs(s)
         across = [-aimag(s)**2, real(s)*aimag(s)]/abs(s)**3
         modes(k)%frequency = abs(s)/two_pi
         modes(k)%damping = -real(s)/abs(s)
         associate (pair => statistics%covariance(2*k - 1:2*k, 2*k - 1:2*k))
            factor = statistics%corrected_error(2*k - 1)/statistics%std_error(2*k - 1)
            modes(k)%sd_frequency = factor*sqrt(dot_product(along, matmul(pair, along)))/two_pi
            modes(k)%sd_damping = factor*sqrt(dot_product(across, matmul(pair, across)))
         end associate
      end do
   end function modes_of

   !> Evaluates a free decay. Arguments as of `evaluate_rows`; the further columns belong to the
   !> amplitudes and offsets.
   subroutine evaluate_decay(self, x, r, columns, error)
      class(decay_fit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: r(:), columns(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: c(:), jac(:, :), tau(:)
      integer :: i, k

      allocate (c(self%problem%linear_unknowns()), r(self%problem%rows()))
      allocate (jac(size(r), size(c)), columns(size(r), size(x) + size(c)), tau(0))
      call set_deviations(self%problem, 1, cmplx(x(::2), x(2::2), wp))
      call self%problem%evaluate([real(wp) ::], r, jac, error, c)
      if (allocated(error)) return
      do i = 1, size(self%problem%parts)
         tau = [tau, self%problem%parts(i)%observed%times()]
      end do
      tau = tau - tau(1)
      do k = 1, size(x), 2
         columns(:, k:k + 1) = deviation_columns(tau, jac(:, k:k + 1), c(k:k + 1))
      end do
      columns(:, size(x) + 1:) = jac
   end subroutine evaluate_decay

   !> Evaluates a frequency response. Arguments as of `evaluate_rows`; behind the deviations, x has
   !> real and imaginary part of the change of each residue.
   subroutine evaluate_response(self, x, r, columns, error)
      class(response_fit_t), intent(inout) :: self
      real(wp), intent(in) :: x(:)
      real(wp), allocatable, intent(out) :: r(:), columns(:, :)
      type(error_t), allocatable, intent(out) :: error
      complex(wp), parameter :: i = (0.0_wp, 1.0_wp)
      complex(wp), allocatable :: at(:), factor(:)
      real(wp), allocatable :: none(:, :)
      complex(wp) :: a, s
      integer :: k, n

      allocate (r(self%problem%rows()), none(self%problem%rows(), 0))
      allocate (columns(size(r), size(x)))
      call self%problem%evaluate([real(wp) ::], r, none, error)
      if (allocated(error)) return
      n = size(self%s)
      select type (observed => self%problem%parts(1)%observed)
      type is (frequency_response_t)
         at = cmplx(observed%rate, two_pi*observed%frequency, wp)
         factor = at**observed%power/observed%noise*self%problem%weight(1)
      end select
      do k = 1, n
         s = self%s(k) + cmplx(x(2*k - 1), x(2*k), wp)
         a = self%residue(k) + cmplx(x(2*n + 2*k - 1), x(2*n + 2*k), wp)
         r = r + rows(pole(a, s, 1) - pole(self%residue(k), self%s(k), 1))
         columns(:, 2*k - 1) = rows(pole(a, s, 2))
         columns(:, 2*k) = rows(pole(i*a, s, 2))
         columns(:, 2*n + 2*k - 1) = rows(pole((1.0_wp, 0.0_wp), s, 1))
         columns(:, 2*n + 2*k) = rows(pole(i, s, 1))
      end do

   contains

      !> Returns the part of a root and its conjugate, a/(at - s)**power and its mirror image.
      pure function pole(a, s, power)
         complex(wp), intent(in) :: a, s
         integer, intent(in) :: power
         complex(wp) :: pole(size(at))

         pole = a/(at - s)**power + conjg(a)/(at - conjg(s))**power
      end function pole

      !> Returns the rows of a frequency response: real parts, then imaginary parts.
      pure function rows(h)
         complex(wp), intent(in) :: h(:)
         real(wp) :: rows(2*size(h))

         rows = [real(factor*h), aimag(factor*h)]
      end function rows

   end subroutine evaluate_response

end module beamid_measured_modes
