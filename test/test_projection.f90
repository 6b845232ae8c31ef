!> Elimination of the linear unknowns on small dense problems: its minimum, its covariance and its
!> derivative against those of the whole problem, and what it refuses.
module separable
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   use beamid_projection, only: new_projection, projection_t
   implicit none
   private

   public :: separable_t, whole_t, model, linear

   integer, parameter :: linear = 3

   !> r = model(p) c - y with c eliminated.
   type, extends(smooth_problem_t) :: separable_t
      real(wp), allocatable :: t(:), y(:)
   contains
      procedure :: residuals => separable_residuals
      procedure :: jacobian => separable_jacobian
   end type separable_t

   !> The same with c among the parameters: (p, c).
   type, extends(smooth_problem_t) :: whole_t
      real(wp), allocatable :: t(:), y(:)
   contains
      procedure :: residuals => whole_residuals
      procedure :: jacobian => whole_jacobian
   end type whole_t

contains

   !> A decaying constant, a decaying wave, a constant.
   !>
   !> phi   (m, 3)
   !> dphi  (m, 3, 2) by p
   pure subroutine model(t, p, phi, dphi)
      real(wp), intent(in) :: t(:), p(:)
      real(wp), intent(out) :: phi(:, :), dphi(:, :, :)

      phi(:, 1) = exp(-p(1)*t)
      phi(:, 2) = exp(-p(1)*t)*sin(p(2)*t)
      phi(:, 3) = 1
      dphi = 0
      dphi(:, 1, 1) = -t*phi(:, 1)
      dphi(:, 2, 1) = -t*phi(:, 2)
      dphi(:, 2, 2) = t*exp(-p(1)*t)*cos(p(2)*t)
   end subroutine model

   subroutine separable_residuals(self, parameters, r, error)
      class(separable_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call self%jacobian(parameters, r, jac, error)
   end subroutine separable_residuals

   subroutine separable_jacobian(self, parameters, r, jac, error)
      class(separable_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      type(projection_t) :: projection
      real(wp) :: phi(size(r), linear), dphi(size(r), linear, size(parameters)), c(linear)
      integer :: k

      call model(self%t, parameters, phi, dphi)
      call new_projection(phi, projection, error)
      if (allocated(error)) return
      r = -self%y
      call projection%coefficients(r, c)
      do k = 1, size(parameters)
         jac(:, k) = matmul(dphi(:, :, k), c)
         call projection%derivatives(reshape(matmul(r, dphi(:, :, k)), [linear, 1]), jac(:, k:k))
      end do
   end subroutine separable_jacobian

   subroutine whole_residuals(self, parameters, r, error)
      class(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: jac(size(r), size(parameters))

      call self%jacobian(parameters, r, jac, error)
   end subroutine whole_residuals

   subroutine whole_jacobian(self, parameters, r, jac, error)
      class(whole_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: phi(size(r), linear), dphi(size(r), linear, size(parameters) - linear)
      integer :: k, n

      n = size(parameters) - linear
      if (n < 1) call failure(error, 'too few parameters')
      if (n < 1) return
      call model(self%t, parameters(:n), phi, dphi)
      r = matmul(phi, parameters(n + 1:)) - self%y
      do k = 1, n
         jac(:, k) = matmul(dphi(:, :, k), parameters(n + 1:))
      end do
      jac(:, n + 1:) = phi
   end subroutine whole_jacobian

end module separable

program test_projection
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_noise, only: gaussian_noise
   use beamid_projection, only: new_projection, projection_t
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use separable, only: linear, model, separable_t, whole_t
   implicit none

   integer, parameter :: m = 40
   integer :: i
   real(wp), parameter :: t(m) = [(0.05_wp*i + 0.01_wp*mod(7*i, 5), i=1, m)]
   real(wp), parameter :: truth(2) = [0.8_wp, 5.0_wp], c_truth(linear) = [2.0_wp, -1.5_wp, 0.7_wp]
   type(separable_t) :: reduced
   type(whole_t) :: whole
   type(fit_t) :: short, long

   call make_problem()
   call test_coefficients()
   call test_minimum()
   call test_covariance()
   call test_derivative()
   call test_scales()
   call test_edges()
   call test_refusals()
   call finish('projection')

contains

   !> Noise of a tenth of the signal: the residuals are far from zero, so that no term of the
   !> derivative is small.
   subroutine make_problem()
      real(wp) :: phi(m, linear), dphi(m, linear, 2)

      call model(t, truth, phi, dphi)
      reduced%t = t
      reduced%y = matmul(phi, c_truth) + gaussian_noise(m, 0.15_wp, 5)
      whole%t = reduced%t
      whole%y = reduced%y
   end subroutine make_problem

   !> What is left is orthogonal to every column, and y = r - Phi c.
   subroutine test_coefficients()
      type(projection_t) :: projection
      type(error_t), allocatable :: error
      real(wp) :: phi(m, 4), y(m), r(m), c(4)

      phi = reshape(gaussian_noise(4*m, 1.0_wp, 1), [m, 4])
      phi(:, 4) = 1
      y = gaussian_noise(m, 1.0_wp, 2)
      r = y
      call new_projection(phi, projection, error)
      call check('four columns are independent', .not. allocated(error))
      if (allocated(error)) return
      call projection%coefficients(r, c)
      ! Sums of 40 products of order 1: 40 round-offs, twice.
      call check_close('residuals orthogonal to the columns', maxval(abs(matmul(r, phi))), 0.0_wp, &
         2e-14_wp)
      call check_close('residuals = y + Phi c', maxval(abs(r - y - matmul(phi, c))), 0.0_wp, &
         2e-14_wp)
      call check('something is left and something is taken', norm2(r) < 0.999_wp*norm2(y) .and. &
         norm2(r) > 0.5_wp*norm2(y), to_text(norm2(r)/norm2(y)))
   end subroutine test_coefficients

   !> Both searches from the same p; the whole one from c = 1.
   subroutine test_minimum()
      type(variable_t) :: variables(2 + linear)
      type(error_t), allocatable :: error
      type(projection_t) :: projection
      real(wp) :: phi(m, linear), dphi(m, linear, 2), c(linear), r(m)
      integer :: k

      variables = [(new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp), k=1, 2 + linear)]
      variables(1) = new_variable(0.5_wp, 0.0_wp, unbounded, 1.0_wp)
      variables(2) = new_variable(4.5_wp, 0.0_wp, unbounded, 1.0_wp)
      call fit(reduced, m, variables(:2), options_t(tolerance=1e-14_wp), short, error)
      call check('the search with c eliminated converges', .not. allocated(error))
      call fit(whole, m, variables, options_t(tolerance=1e-14_wp), long, error)
      call check('the search for all converges', .not. allocated(error))
      if (.not. (allocated(short%estimate) .and. allocated(long%estimate))) return
      ! Both searches stop when J falls by less than 1e-14 of it, or at 1e-8 standard errors. J is a
      ! parabola there: the parameters are within 1e-7 sqrt(m) of these, some tenths of them.
      call check_close('J', short%J/long%J, 1.0_wp, 2e-14_wp)
      do k = 1, 2
         call check_close('p('//to_text(k)//')', short%estimate(k)/long%estimate(k), 1.0_wp, &
            1e-7_wp)
      end do
      call model(t, short%estimate, phi, dphi)
      call new_projection(phi, projection, error)
      r = -reduced%y
      call projection%coefficients(r, c)
      do k = 1, linear
         call check_close('c('//to_text(k)//')', c(k)/long%estimate(2 + k), 1.0_wp, 1e-7_wp)
      end do
      call check('fewer iterations without c', short%iterations < long%iterations, &
         to_text(short%iterations)//' against '//to_text(long%iterations))
      call check('exact derivatives at both ends', all(short%derivative_check >= 0 .and. &
         short%derivative_check < 1e-7_wp), to_text(maxval(short%derivative_check)))
   end subroutine test_minimum

   !> The covariance of p alone is s**2 ((Q J)'(Q J))**-1 with Q J what is left of the derivatives
   !> with c held: the block of the whole one, by Schur's complement. `derivatives` with r = 0
   !> computes Q J.
   subroutine test_covariance()
      type(projection_t) :: projection
      type(statistics_t) :: stated
      type(error_t), allocatable :: error
      real(wp) :: phi(m, linear), dphi(m, linear, 2), slope(m, 2), none(m), normal(2, 2), &
         inverse(2, 2), determinant
      integer :: k

      if (.not. allocated(long%estimate)) return
      associate (p => long%estimate(:2), c => long%estimate(3:))
         call new_statistics(long%jacobian, long%residual, long%estimate, abs(long%estimate), &
            stated, error)
         call model(t, p, phi, dphi)
         call new_projection(phi, projection, error)
         none = 0
         do k = 1, 2
            slope(:, k) = matmul(dphi(:, :, k), c)
            call projection%derivatives(reshape(matmul(none, dphi(:, :, k)), [linear, 1]), &
               slope(:, k:k))
         end do
      end associate
      normal = matmul(transpose(slope), slope)
      determinant = normal(1, 1)*normal(2, 2) - normal(1, 2)**2
      inverse = reshape([normal(2, 2), -normal(1, 2), -normal(1, 2), normal(1, 1)], [2, 2]) &
         /determinant*stated%variance
      ! The normal equations square a condition of some tens.
      call check_close('covariance of p, largest relative difference', maxval(abs(inverse &
         - stated%covariance(:2, :2))/abs(stated%covariance(:2, :2))), 0.0_wp, 1e-11_wp)
      call check('the truth is within four standard errors', all(abs(long%estimate &
         - [truth, c_truth]) < 4*stated%std_error), to_text(maxval(abs(long%estimate - [truth, &
         c_truth])/stated%std_error)))
      call check('the variance counts p and c', abs(stated%variance/(long%J/(m - 2 - linear)) - 1) &
         < 1e-13_wp)
   end subroutine test_covariance

   !> Against a five-point difference, step h = 1e-3: truncation h**4 = 1e-12 times fifth
   !> derivatives of some 5**5/30 = 100, round-off 1e-16/h = 1e-13.
   subroutine test_derivative()
      real(wp), parameter :: h = 1e-3_wp
      real(wp), parameter :: weights(4) = [1, -8, 8, -1]/12.0_wp
      integer, parameter :: steps(4) = [-2, -1, 1, 2]
      real(wp) :: r(m), exact(m, 2), difference(m), p(2)
      type(error_t), allocatable :: error
      integer :: k, j

      ! Far from the minimum, where the residuals are large.
      call reduced%jacobian([1.7_wp, 3.1_wp], r, exact, error)
      do k = 1, 2
         difference = 0
         do j = 1, 4
            p = [1.7_wp, 3.1_wp]
            p(k) = p(k) + steps(j)*h
            call reduced%residuals(p, r, error)
            difference = difference + weights(j)*r/h
         end do
         call check_close('dr/dp('//to_text(k)//') against differences', norm2(exact(:, k) - &
            difference)/norm2(difference), 0.0_wp, 1e-9_wp)
      end do
   end subroutine test_derivative

   !> Columns of very different size, as a motion in metres beside an offset in volts: what is left
   !> is the same.
   subroutine test_scales()
      type(projection_t) :: projection
      type(error_t), allocatable :: error
      real(wp) :: phi(m, linear), dphi(m, linear, 2), r(m), scaled(m), c(linear), d(linear)
      real(wp), parameter :: scale(linear) = [1e-150_wp, 1.0_wp, 1e150_wp]

      call model(t, truth, phi, dphi)
      r = reduced%y
      scaled = r
      call new_projection(phi, projection, error)
      call projection%coefficients(r, c)
      call new_projection(phi*spread(scale, 1, m), projection, error)
      call check('columns of 1e-150 to 1e150 are independent', .not. allocated(error))
      if (allocated(error)) return
      call projection%coefficients(scaled, d)
      call check_close('what is left does not depend on the units', maxval(abs(scaled - r)), &
         0.0_wp, 1e-13_wp)
      call check_close('and the unknowns scale', maxval(abs(d*scale/c - 1)), 0.0_wp, 1e-12_wp)
   end subroutine test_scales

   !> As many samples as unknowns, and no unknowns at all.
   subroutine test_edges()
      type(projection_t) :: projection
      type(error_t), allocatable :: error
      real(wp) :: phi(linear, linear), r(linear), c(linear), y(m), slope(m, 1), none(0), &
         dphi(m, 0)

      phi = reshape([2.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 3.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 4.0_wp], &
         [linear, linear])
      ! (1, 1, 1) is the solution.
      r = -sum(phi, dim=2)
      call new_projection(phi, projection, error)
      call check('as many samples as unknowns', .not. allocated(error))
      if (allocated(error)) return
      call projection%coefficients(r, c)
      call check_close('nothing is left', maxval(abs(r)), 0.0_wp, 1e-14_wp)
      call check_close('the unknowns solve the equations', maxval(abs(c - 1)), 0.0_wp, 1e-14_wp)
      call new_projection(dphi, projection, error)
      call check('no linear unknown', .not. allocated(error))
      if (allocated(error)) return
      y = reduced%y
      slope(:, 1) = t
      call projection%coefficients(y, none)
      call projection%derivatives(reshape(none, [0, 1]), slope)
      call check('nothing is taken where nothing is unknown', all(abs(y - reduced%y) <= 0) .and. &
         all(abs(slope(:, 1) - t) <= 0))
   end subroutine test_edges

   subroutine test_refusals()
      real(wp) :: phi(m, linear), dphi(m, linear, 2), changed(m, linear), nearly
      character(len=*), parameter :: apart = 'cannot tell the motions of the modes and the offset'
      integer :: k

      call model(t, truth, phi, dphi)
      call refused('more unknowns than samples', phi(:2, :), '2 samples for 3 linear unknowns')
      call refused('no sample', phi(:0, :), '0 samples for 3 linear unknowns')
      do k = 1, linear
         changed = phi
         changed(:, k) = 0
         call refused('column '//to_text(k)//' of zeros', changed, apart)
         changed = phi
         changed(:, k) = 3*phi(:, modulo(k, 3) + 1) - 2*phi(:, modulo(k + 1, 3) + 1)
         call refused('column '//to_text(k)//' made of the others', changed, apart)
      end do
      changed = phi
      changed(3, 2) = ieee_value(1.0_wp, ieee_quiet_nan)
      call refused('a NaN', changed, apart)
      ! 1e-13 of a column leaves three digits, 1e-6 ten.
      changed = phi
      nearly = 1e-13_wp
      changed(:, 3) = phi(:, 1) + nearly*phi(:, 3)
      call refused('columns alike to 1e-13', changed, apart)
      changed(:, 3) = phi(:, 1) + 1e-6_wp*phi(:, 3)
      call accepted('columns alike to 1e-6', changed)
   end subroutine test_refusals

   subroutine refused(what, phi, words)
      character(len=*), intent(in) :: what, words
      real(wp), intent(in) :: phi(:, :)
      type(projection_t) :: projection
      type(error_t), allocatable :: error

      call new_projection(phi, projection, error)
      if (.not. allocated(error)) then
         call check(what//' is refused', .false., 'accepted')
      else
         call check(what//' is refused', index(error%message, words) > 0, error%message)
      end if
   end subroutine refused

   subroutine accepted(what, phi)
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: phi(:, :)
      type(projection_t) :: projection
      type(error_t), allocatable :: error

      call new_projection(phi, projection, error)
      call check(what//' are accepted', .not. allocated(error))
   end subroutine accepted

end program test_projection
