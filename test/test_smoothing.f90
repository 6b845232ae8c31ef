!> The strength of a penalty: the score against the covariance of the data, its minimum against a
!> scan, limits, units, what the estimate averages, and many simulated data.
program test_smoothing
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use, intrinsic :: iso_fortran_env, only: qp => real128
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise, uniform_noise
   use beamid_smoothers, only: new_smoother, smoother_t, smoothing_point_t
   use beamid_smoothing, only: choose_strength, difference_rows, resolution_length, smoothing_t
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   implicit none

   !> A problem whose penalty has independent rows.
   type :: problem_t
      character(len=:), allocatable :: name
      real(wp), allocatable :: jacobian(:, :), residual(:), at(:), penalty(:, :)
   end type problem_t

   integer :: k

   call test_rows()
   call test_width()
   do k = 1, 5
      call test_score(example(k))
      call test_minimum(example(k))
      call test_solution(example(k))
      call test_limits(example(k))
      call test_units(example(k))
   end do
   call test_more_rows()
   call test_several_minima()
   call test_graded()
   call test_ends()
   call test_least()
   call test_null_truth()
   call test_prior_truth()
   call test_refused()
   call finish('smoothing')

contains

   !> Small problems: m, n, rows and zero columns of L; more and less data than parameters, a
   !> penalty on everything, a Jacobian without full rank.
   function example(number) result(problem)
      integer, intent(in) :: number
      type(problem_t) :: problem
      integer, parameter :: sizes(4, 5) = reshape([9, 5, 3, 0, 14, 7, 3, 2, 8, 4, 4, 0, 6, 8, &
         5, 1, 12, 7, 4, 1], [4, 5])
      integer :: m, n, p, zero

      m = sizes(1, number)
      n = sizes(2, number)
      p = sizes(3, number)
      zero = sizes(4, number)
      problem%name = to_text(m)//' residuals, '//to_text(n)//' parameters, '//to_text(p)// &
         ' rows: '
      problem%jacobian = random(m, n, 10*number)
      problem%penalty = random(p, n, 10*number + 1)
      ! Not the last ones: a column without penalty may stand anywhere.
      problem%penalty(:, 2:1 + zero) = 0
      if (number == 5) problem%jacobian(:, 5) = problem%jacobian(:, 4) - problem%jacobian(:, 6)
      problem%at = gaussian_noise(n, 1.0_wp, 10*number + 2)
      ! The truth is another v, of about the size that the prior allows, and noise.
      problem%residual = matmul(problem%jacobian, problem%at - gaussian_noise(n, 1.0_wp, &
         10*number + 3)) + 0.7_wp*gaussian_noise(m, 1.0_wp, 10*number + 4)
   end function example

   pure function random(m, n, seed) result(matrix)
      integer, intent(in) :: m, n, seed
      real(wp) :: matrix(m, n)

      matrix = reshape(gaussian_noise(m*n, 1.0_wp, seed), [m, n])
   end function random

   !> Solves with a symmetric positive definite matrix by elimination in quadruple precision, and
   !> returns the log of its determinant.
   subroutine solve(matrix, x, log_det)
      real(qp), intent(in) :: matrix(:, :)
      real(qp), intent(inout) :: x(:, :)
      real(qp), intent(out) :: log_det
      real(qp) :: a(size(matrix, 1), size(matrix, 1)), factor
      integer :: i, j, n

      a = matrix
      n = size(a, 1)
      log_det = 0
      do j = 1, n
         log_det = log_det + log(a(j, j))
         do i = j + 1, n
            factor = a(i, j)/a(j, j)
            a(i, :) = a(i, :) - factor*a(j, :)
            x(i, :) = x(i, :) - factor*x(j, :)
         end do
      end do
      do j = n, 1, -1
         x(j, :) = x(j, :)/a(j, j)
         do i = 1, j - 1
            x(i, :) = x(i, :) - a(i, j)*x(j, :)
         end do
      end do
   end subroutine solve

   !> A basis of the null space of the penalty, what it leaves of anything, and L^+.
   subroutine split(penalty, null, image)
      real(wp), intent(in) :: penalty(:, :)
      real(qp), allocatable, intent(out) :: null(:, :), image(:, :)
      real(qp), allocatable :: x(:, :)
      real(qp) :: unused
      integer :: n, p

      p = size(penalty, 1)
      n = size(penalty, 2)
      x = penalty
      call solve(matmul(x, transpose(x)), x, unused)
      image = transpose(x)
      null = random(n, n - p, 77)
      null = null - matmul(image, matmul(real(penalty, qp), null))
   end subroutine split

   !> The data J v0 - r are normal with the mean X b, X = J N, and the covariance sigma**2 V,
   !> V = 1 + Z Z'/s, Z = J L^+: -2 log of their restricted likelihood at the best sigma**2 is
   !> log |V| + log |X'V^-1 X| + (m - q) log y'P y (Patterson and Thompson).
   real(qp) function covariance_score(problem, strength) result(score)
      type(problem_t), intent(in) :: problem
      real(wp), intent(in) :: strength
      real(qp), allocatable :: null(:, :), image(:, :), x(:, :), z(:, :), y(:, :), v(:, :), &
         vxy(:, :), b(:, :)
      real(qp) :: log_v, log_x
      integer :: j, m, q

      call split(problem%penalty, null, image)
      m = size(problem%residual)
      q = size(null, 2)
      x = matmul(problem%jacobian, null)
      z = matmul(problem%jacobian, image)
      y = reshape(matmul(problem%jacobian, problem%at) - problem%residual, [m, 1])
      v = matmul(z, transpose(z))/strength
      do j = 1, m
         v(j, j) = 1 + v(j, j)
      end do
      allocate (vxy(m, q + 1))
      vxy(:, :q) = x
      vxy(:, q + 1) = y(:, 1)
      call solve(v, vxy, log_v)
      b = matmul(transpose(x), vxy(:, q + 1:))
      call solve(matmul(transpose(x), vxy(:, :q)), b, log_x)
      score = log_v + log_x + (m - q)*log(dot_product(y(:, 1), vxy(:, q + 1) &
         - matmul(vxy(:, :q), b(:, 1))))
   end function covariance_score

   !> (0, 0, 1, -2, 1, 0, ...), and third differences; polynomials are not penalised.
   subroutine test_rows()
      integer, parameter :: n = 7
      real(wp) :: x(n)
      integer :: j, order

      x = [(real(j, wp), j=1, n)]
      call check('first differences', all(shape(difference_rows(n, 1)) == [6, 7]) .and. &
         all(abs(matmul(difference_rows(n, 1), x**2) - [(2*j + 1, j=1, n - 1)]) <= 0))
      call check('second differences', all(shape(difference_rows(n, 2)) == [5, 7]) .and. &
         all(abs(matmul(difference_rows(n, 2), x**3) - [(6*(j + 1), j=1, n - 2)]) <= 0))
      do order = 1, 4
         ! Whole numbers, exact.
         call check('differences of order '//to_text(order)//': of polynomials', &
            all(abs(matmul(difference_rows(n, order), x**(order - 1))) <= 0) .and. &
            all(abs(matmul(difference_rows(n, order), x**order) - gamma(order + 1.0_wp)) <= 0))
      end do
      call check('no differences of too few', size(difference_rows(2, 2), 1) == 0)
   end subroutine test_rows

   !> k equal weights are k spacings wide. A normal curve of the standard deviation d: 2 sqrt(pi) d,
   !> which the sum over steps of d/5 meets to exp(-pi**2 25), and its ends at 8 d to 1e-14.
   subroutine test_width()
      real(wp), parameter :: ones(4) = 0.25_wp
      real(wp) :: row(81)
      integer :: j

      call check_close('width of four equal weights', resolution_length([0.0_wp, ones, 0.0_wp], &
         0.5_wp), 2.0_wp, 1e-15_wp)
      row = 1e-200_wp*[(exp(-0.5_wp*((j - 41)/5.0_wp)**2), j=1, 81)]
      call check_close('width of a normal curve', resolution_length(row, 0.2_wp), &
         2*sqrt(acos(-1.0_wp)), 1e-13_wp)
      call check_close('width of weights that cancel', resolution_length([1.0_wp, -1.0_wp], &
         1.0_wp), 0.0_wp, 0.0_wp)
      call check_close('width of nothing', resolution_length([0.0_wp, 0.0_wp], 1.0_wp), 0.0_wp, &
         0.0_wp)
   end subroutine test_width

   !> Differences of the score between strengths are those of the restricted likelihood.
   subroutine test_score(problem)
      type(problem_t), intent(in) :: problem
      !> The smoother's own round-off: eps times a condition of 1e6 of the problem.
      real(wp), parameter :: tolerance = 1e-9_wp, h = 1e-4_wp
      type(smoother_t) :: smoother
      type(smoothing_point_t) :: point
      type(error_t), allocatable :: error
      real(wp) :: first, strength
      real(qp) :: reference
      integer :: j

      call new_smoother(problem%jacobian, problem%residual, problem%at, problem%penalty, &
         smoother, error)
      call check(problem%name//'done', .not. allocated(error))
      if (allocated(error)) return
      point = smoother%point(1.0_wp)
      first = point%score
      reference = covariance_score(problem, 1.0_wp)
      do j = -4, 4
         if (j == 0) cycle
         strength = 10.0_wp**j
         point = smoother%point(strength)
         call check_close(problem%name//'score at 10**'//to_text(j), point%score - first, &
            real(covariance_score(problem, strength) - reference, wp), &
            tolerance*max(1.0_wp, abs(point%score - first)))
         ! Central differences in quadruple precision err by h**2/6 = 2e-9 of a third derivative
         ! by the log of the strength, which is of order one, and the smoother by its round-off.
         call check_close(problem%name//'slope at 10**'//to_text(j), smoother%slope(strength), &
            real((covariance_score(problem, strength*exp(h)) &
            - covariance_score(problem, strength*exp(-h)))/(2*h), wp), 1e-8_wp)
      end do
   end subroutine test_score

   !> The best of a dense scan of the restricted likelihood lies beside the strength chosen.
   subroutine test_minimum(problem)
      type(problem_t), intent(in) :: problem
      real(wp), parameter :: step = 0.02_wp
      integer, parameter :: steps = 1000
      type(smoothing_t) :: smoothing
      type(error_t), allocatable :: error
      real(qp) :: score(-steps:steps)
      integer :: best, j

      call choose_strength(problem%jacobian, problem%residual, problem%at, problem%penalty, &
         smoothing, error)
      call check(problem%name//'a strength', .not. allocated(error))
      if (allocated(error)) return
      do j = -steps, steps
         score(j) = covariance_score(problem, exp(step*j))
      end do
      best = minloc(score, dim=1) - steps - 1
      if (smoothing%at_end == 0) then
         call check_close(problem%name//'minimum', log(smoothing%strength), step*best, step)
      else
         ! The scan is flat there: it falls by as much as the freedom still changes, 1e-6 or so
         ! times the number of residuals.
         call check_close(problem%name//'minimum at an end', &
            real(score(steps*smoothing%at_end) - minval(score), wp), 0.0_wp, 1e-4_wp)
      end if
      ! Nothing of the scan lies lower, but for round-off; at an end, which is where the freedom is
      ! off by 1e-6, by what the score still falls beyond: as much times the condition.
      call check_close(problem%name//'least', real(min(0.0_qp, minval(score) &
         - covariance_score(problem, smoothing%strength)), wp), 0.0_wp, merge(1e-10_wp, 1e-4_wp, &
         smoothing%at_end == 0))
      call check(problem%name//'the choice is in the middle of the curve', &
         size(smoothing%curve) == 13 .and. abs(smoothing%curve(7)%strength/smoothing%strength &
         - 1) < 1e-15_wp)
      call check(problem%name//'the curve is in order', &
         all(smoothing%curve(2:)%strength > smoothing%curve(:12)%strength) .and. &
         all(smoothing%curve(2:)%misfit >= smoothing%curve(:12)%misfit) .and. &
         all(smoothing%curve(2:)%roughness <= smoothing%curve(:12)%roughness) .and. &
         all(smoothing%curve(2:)%freedom <= smoothing%curve(:12)%freedom))
   end subroutine test_minimum

   !> Estimate, sums of squares, covariance and resolution against the normal equations; and of data
   !> without noise the estimate is the resolution times the truth.
   subroutine test_solution(problem)
      type(problem_t), intent(in) :: problem
      !> Conditions of some 1e4 in the normal equations.
      real(wp), parameter :: tolerance = 1e-10_wp, strength = 0.37_wp
      type(smoother_t) :: smoother
      type(smoothing_t) :: smoothing
      type(smoothing_point_t) :: point
      type(error_t), allocatable :: error
      real(wp), allocatable :: v(:), truth(:), resolution(:, :)
      real(qp), allocatable :: matrix(:, :), x(:, :)
      real(qp) :: unused
      integer :: j, n

      call new_smoother(problem%jacobian, problem%residual, problem%at, problem%penalty, &
         smoother, error)
      if (allocated(error)) return
      n = size(problem%at)
      associate (a => problem%jacobian, l => problem%penalty, r => problem%residual, &
         at => problem%at)
         matrix = matmul(transpose(a), a) + strength*matmul(transpose(l), l)
         x = reshape(matmul(transpose(a), matmul(a, at) - r), [n, 1])
         call solve(matrix, x, unused)
         v = x(:, 1)
         point = smoother%point(strength)
         call check_close(problem%name//'estimate', maxval(abs(smoother%estimate(strength) - v)), &
            0.0_wp, tolerance)
         call check_close(problem%name//'misfit', point%misfit, sum((r + matmul(a, v - at))**2), &
            tolerance)
         call check_close(problem%name//'roughness', point%roughness, sum(matmul(l, v)**2), &
            tolerance)
         x = matmul(matrix, smoother%covariance(strength))
         do j = 1, n
            x(j, j) = x(j, j) - 1
         end do
         call check_close(problem%name//'covariance', real(maxval(abs(x)), wp), 0.0_wp, tolerance)
         resolution = smoother%resolution(strength)
         call check_close(problem%name//'resolution', real(maxval(abs(matmul(matrix, &
            resolution) - matmul(transpose(a), a))), wp), 0.0_wp, tolerance)
         call check_close(problem%name//'freedom', point%freedom, sum([(resolution(j, j), j=1, &
            n)]) - count(norm2(l, dim=1) <= 0), tolerance)
         truth = gaussian_noise(n, 1.0_wp, 5)
         call choose_strength(a, matmul(a, at - truth), at, l, smoothing, error)
      end associate
      call check(problem%name//'data without noise, done', .not. allocated(error))
      if (allocated(error)) return
      ! Both are products with the same generalized eigenvectors; also where the strength is next
      ! to nothing, conditions of 1e4 at most.
      call check_close(problem%name//'data without noise', maxval(abs(smoothing%estimate &
         - matmul(smoothing%resolution, truth))), 0.0_wp, 1e-9_wp)
   end subroutine test_solution

   !> Far beyond the scale of the problem: the null space alone, or the fit without penalty.
   subroutine test_limits(problem)
      type(problem_t), intent(in) :: problem
      !> What a strength that differs from its limit by that factor leaves, some 1e-12 times
      !> generalized eigenvalues between 1e-3 and 1e3.
      real(wp), parameter :: far = 1e12_wp, tolerance = 1e-8_wp
      type(smoother_t) :: smoother
      type(smoothing_point_t) :: point
      type(error_t), allocatable :: error
      real(qp), allocatable :: null(:, :), image(:, :), x(:, :), b(:, :)
      real(wp), allocatable :: v(:)
      real(qp) :: unused
      integer :: n, zero

      call new_smoother(problem%jacobian, problem%residual, problem%at, problem%penalty, &
         smoother, error)
      if (allocated(error)) return
      n = size(problem%at)
      zero = count(norm2(problem%penalty, dim=1) <= 0)
      call split(problem%penalty, null, image)
      x = matmul(problem%jacobian, null)
      b = reshape(matmul(transpose(x), matmul(problem%jacobian, problem%at) - problem%residual), &
         [size(null, 2), 1])
      call solve(matmul(transpose(x), x), b, unused)
      v = matmul(null, b(:, 1))
      call check_close(problem%name//'rigid, estimate', maxval(abs(smoother%estimate(far) - v)), &
         0.0_wp, tolerance)
      point = smoother%point(far)
      call check_close(problem%name//'rigid, freedom', point%freedom, &
         real(size(null, 2) - zero, wp), tolerance)
      point = smoother%point(1/far)
      call check_close(problem%name//'no penalty, freedom', point%freedom, &
         real(min(size(problem%residual), n - merge(1, 0, problem%name(:4) == '12 r')) - zero, &
         wp), tolerance)
      if (size(problem%residual) <= n) then
         call check_close(problem%name//'no penalty, misfit', point%misfit, 0.0_wp, tolerance)
         return
      end if
      ! The gradient of the sum of squares vanishes, also where J leaves v open.
      call check_close(problem%name//'no penalty, gradient', maxval(abs(matmul( &
         problem%residual + matmul(problem%jacobian, smoother%estimate(1/far) - problem%at), &
         problem%jacobian))), 0.0_wp, tolerance)
   end subroutine test_limits

   !> Other units of the parameters, of the residuals, of the penalty.
   subroutine test_units(problem)
      type(problem_t), intent(in) :: problem
      !> The strength where a slope vanishes that has a few eps of its terms: those times a
      !> condition of 1e4 at most.
      real(wp), parameter :: tolerance = 1e-10_wp
      type(smoothing_t) :: plain, other
      type(error_t), allocatable :: error
      real(wp), allocatable :: unit(:)
      integer :: j, m, n, p

      m = size(problem%residual)
      n = size(problem%at)
      p = size(problem%penalty, 1)
      unit = [(10.0_wp**(modulo(7*j, 19) - 9), j=1, n)]
      associate (a => problem%jacobian, l => problem%penalty, r => problem%residual, &
         at => problem%at)
         call choose_strength(a, r, at, l, plain, error)
         if (.not. allocated(error)) call choose_strength(a*spread(unit, 1, m), r, at/unit, &
            l*spread(unit, 1, p), other, error)
         call check(problem%name//'units of parameters, done', .not. allocated(error))
         if (allocated(error)) return
         call check_close(problem%name//'units of parameters, strength', &
            other%strength/plain%strength, 1.0_wp, tolerance)
         call check_close(problem%name//'units of parameters, estimate', &
            maxval(abs(other%estimate*unit - plain%estimate)), 0.0_wp, tolerance)
         call check_close(problem%name//'units of parameters, errors', maxval(abs([(sqrt( &
            other%covariance(j, j)/plain%covariance(j, j))*unit(j) - 1, j=1, n)])), 0.0_wp, &
            tolerance)
         call choose_strength(1e-20_wp*a, 1e-20_wp*r, at, l, other, error)
         call check(problem%name//'units of residuals, done', .not. allocated(error))
         if (allocated(error)) return
         call check_close(problem%name//'units of residuals, strength', &
            other%strength/plain%strength*1e40_wp, 1.0_wp, tolerance)
         call check_close(problem%name//'units of residuals, freedom', other%freedom, &
            plain%freedom, tolerance)
         ! From v0 within the null space the residuals alone say how large v - v0 is.
         call choose_strength(a, r, 0*at, l, plain, error)
         if (.not. allocated(error)) call choose_strength(a, 1e5_wp*r, 0*at, 1e-3_wp*l, other, &
            error)
         call check(problem%name//'louder data, done', .not. allocated(error))
         if (allocated(error)) return
         call check_close(problem%name//'louder data, strength', &
            other%strength/plain%strength*1e-6_wp, 1.0_wp, tolerance)
         call check_close(problem%name//'louder data, variance', &
            other%variance/plain%variance*1e-10_wp, 1.0_wp, tolerance)
      end associate
   end subroutine test_units

   !> Rows that say the same twice change nothing: the rank counts.
   subroutine test_more_rows()
      type(problem_t) :: problem
      type(smoothing_t) :: one, two
      type(error_t), allocatable :: error
      real(wp), allocatable :: rows(:, :)
      integer :: p

      problem = example(2)
      p = size(problem%penalty, 1)
      allocate (rows(3*p, size(problem%at)), source=0.0_wp)
      rows(:p, :) = 0.6_wp*problem%penalty
      rows(2*p + 1:, :) = 0.8_wp*problem%penalty
      call choose_strength(problem%jacobian, problem%residual, problem%at, problem%penalty, one, &
         error)
      if (.not. allocated(error)) call choose_strength(problem%jacobian, problem%residual, &
         problem%at, rows, two, error)
      call check('dependent rows: done', .not. allocated(error))
      if (allocated(error)) return
      ! Round-off, as of other units.
      call check_close('dependent rows: strength', two%strength/one%strength, 1.0_wp, 1e-10_wp)
      call check_close('dependent rows: roughness', two%curve(7)%roughness, &
         one%curve(7)%roughness, 1e-10_wp)
   end subroutine test_more_rows

   !> Generalized eigenvalues many decades apart: scores with several minima, of which the lowest.
   subroutine test_several_minima()
      integer, parameter :: m = 12, n = 4, problems = 300, steps = 4000
      type(smoother_t) :: smoother
      type(smoothing_point_t) :: point
      type(smoothing_t) :: smoothing
      type(error_t), allocatable :: error
      real(wp) :: jacobian(m, n), residual(m), zero(n), identity(n, n), score(steps), above
      integer :: i, j, several

      several = 0
      above = 0
      zero = 0
      identity = 0
      do i = 1, n
         identity(i, i) = 1
      end do
      do j = 1, problems
         jacobian = random(m, n, 100 + j)*spread(10**(8*uniform_noise(n, j) - 4), 1, m)
         residual = gaussian_noise(m, 0.3_wp, 900 + j) + 10*matmul(jacobian, &
            gaussian_noise(n, 1.0_wp, 500 + j)/norm2(jacobian, dim=1))
         call new_smoother(jacobian, residual, zero, identity, smoother, error)
         if (.not. allocated(error)) call choose_strength(jacobian, residual, zero, identity, &
            smoothing, error)
         if (allocated(error)) exit
         do i = 1, steps
            point = smoother%point(exp(0.01_wp*(i - steps/2)))
            score(i) = point%score
         end do
         if (count(score(2:steps - 1) < score(:steps - 2) .and. score(2:steps - 1) < score(3:)) &
            > 1) several = several + 1
         point = smoother%point(smoothing%strength)
         above = max(above, point%score - minval(score))
      end do
      call check('several minima: done', .not. allocated(error))
      call check('several minima: they occur', several > 10, to_text(several))
      ! Round-off, or what the score still falls beyond an end of the range.
      call check_close('several minima: none is lower', above, 0.0_wp, 1e-6_wp)
   end subroutine test_several_minima

   !> Data that see the coefficients the less the farther they lie, by ten decades, and the last not
   !> at all: J'J would be without digits. Straight lines remain what they are.
   subroutine test_graded()
      integer, parameter :: m = 60, n = 20
      type(smoother_t) :: smoother
      type(smoothing_point_t) :: point
      type(error_t), allocatable :: error
      real(wp) :: jacobian(m, n), line(n), resolution(n, n), v(n)
      integer :: j

      jacobian = random(m, n, 3)
      do j = 1, n
         jacobian(:, j) = jacobian(:, j)*10.0_wp**(-10*(j - 1)/(n - 1.0_wp))
      end do
      jacobian(:, n) = 0
      line = [(1 + 0.1_wp*j, j=1, n)]
      call new_smoother(jacobian, -matmul(jacobian, line), 0*line, difference_rows(n, 2), &
         smoother, error)
      call check('graded: done', .not. allocated(error))
      if (allocated(error)) return
      do j = -18, 6, 6
         resolution = smoother%resolution(10.0_wp**j)
         ! Continued over coefficients beyond those that the data see; second differences of a
         ! condition of 1e2 spread round-off by as much, and sums of squares of it once more.
         call check_close('graded: lines are averaged to lines, 10**'//to_text(j), &
            maxval(abs(matmul(resolution, line) - line)), 0.0_wp, 1e-11_wp)
         v = smoother%estimate(10.0_wp**j)
         ! The data are rounded to some 1e-14, and what is seen weakly enlarges that, by 1/(2
         ! sqrt(s)) at most where it is still rough.
         call check_close('graded: a line is found, 10**'//to_text(j), maxval(abs(v - line)), &
            0.0_wp, 1e-11_wp + 1e-14_wp*n/10.0_wp**(0.5_wp*j))
      end do
      ! The least singular value but the zero is about 1e-9.5, its square 1e-19.
      point = smoother%point(1e-30_wp)
      call check_close('graded: freedom without penalty', point%freedom, n - 1.0_wp, 1e-6_wp)
   end subroutine test_graded

   !> A truth of pure noise about a line, one without noise, and data that say nothing.
   subroutine test_ends()
      integer, parameter :: m = 50, n = 12
      type(smoothing_t) :: smoothing
      type(error_t), allocatable :: error
      real(wp) :: jacobian(m, n), truth(n), line(n), noise(m)
      integer :: j

      jacobian = random(m, n, 8)
      line = [(real(j, wp), j=1, n)]
      ! Noise of which the directions of curved v have no part.
      noise = gaussian_noise(m, 1.0_wp, 9)
      noise = noise - projected(jacobian, noise)
      call choose_strength(jacobian, noise - matmul(jacobian, line), 0*line, &
         difference_rows(n, 2), smoothing, error)
      call check('rigid: done', .not. allocated(error))
      if (allocated(error)) return
      call check('rigid: said so', smoothing%at_end == 1, to_text(smoothing%strength))
      ! The end of the range is where the freedom is off by 1e-6.
      call check_close('rigid: freedom', smoothing%freedom, 2.0_wp, 1.01e-6_wp)
      ! The noise was made orthogonal by normal equations: 1e-14 times a condition of some tens.
      call check_close('rigid: a line', maxval(abs(smoothing%estimate - line)), 0.0_wp, 1e-10_wp)
      call check_close('rigid: variance', smoothing%variance, sum(noise**2)/(m - 2), 1e-10_wp)

      ! 2**-10 steps: no product or sum of these is rounded, and nothing is left of the data.
      jacobian = anint(jacobian*2.0_wp**10)/2.0_wp**10
      truth = anint(100*gaussian_noise(n, 1.0_wp, 4))
      call choose_strength(jacobian, -matmul(jacobian, truth), 0*truth, difference_rows(n, 2), &
         smoothing, error)
      call check('no noise: done', .not. allocated(error))
      if (allocated(error)) return
      call check('no noise: no penalty, and said so', smoothing%at_end == -1, &
         to_text(smoothing%strength))
      call check_close('no noise: freedom', smoothing%freedom, real(n, wp), 1.01e-6_wp)
      ! The end of the range holds back 1e-6 of the direction that is seen least.
      call check_close('no noise: the truth', maxval(abs(smoothing%estimate - truth)), 0.0_wp, &
         1e-6_wp*norm2(matmul(difference_rows(n, 2), truth)))

      jacobian = 0
      jacobian(:, 1) = 1
      jacobian(:, 2) = [(real(j, wp), j=1, m)]
      call choose_strength(jacobian, noise, 0*truth, difference_rows(n, 2), smoothing, error)
      call check('two values: a line through them is determined', .not. allocated(error))
      if (allocated(error)) return
      call check('two values: rigid', smoothing%at_end == 1)
      ! Whole numbers up to 50 but for the noise: round-off times 50 squared.
      call check_close('two values: the others lie on a line', maxval(abs(matmul( &
         difference_rows(n, 2), smoothing%estimate))), 0.0_wp, 1e-12_wp)
      ! Residuals of zeros have no scale at all.
      call choose_strength(jacobian, 0*noise, 0*truth, difference_rows(n, 2), smoothing, error)
      call check('zeros: zero', .not. allocated(error) .and. all(abs(smoothing%estimate) <= 0))
   end subroutine test_ends

   !> A strength that may not be lower than some value: below the one that is chosen without it does
   !> nothing, above that it is the strength, and all that is told belongs to it.
   subroutine test_least()
      integer, parameter :: m = 60, n = 12
      type(smoothing_t) :: free, held
      type(smoother_t) :: smoother
      type(smoothing_point_t) :: point
      type(error_t), allocatable :: error
      real(wp) :: jacobian(m, n), truth(n), r(m), penalty(n - 1, n), least
      integer :: j

      jacobian = random(m, n, 18)
      truth = [(sin(0.7_wp*j), j=1, n)]
      r = gaussian_noise(m, 0.1_wp, 19) - matmul(jacobian, truth)
      penalty = difference_rows(n, 1)
      call choose_strength(jacobian, r, 0*truth, penalty, free, error)
      if (.not. allocated(error)) call choose_strength(jacobian, r, 0*truth, penalty, held, error, &
         0.1_wp*free%strength)
      call check('least: done', .not. allocated(error))
      if (allocated(error)) return
      call check('least: below the minimum', free%at_end == 0 .and. held%at_end == 0 .and. &
         .not. held%bounded)
      ! Both halve down to the last digits of log s.
      call check_close('least: the same minimum', log(held%strength/free%strength), 0.0_wp, &
         1e-12_wp)

      least = 30*free%strength
      call choose_strength(jacobian, r, 0*truth, penalty, held, error, least)
      if (.not. allocated(error)) call new_smoother(jacobian, r, 0*truth, penalty, smoother, error)
      call check('least: done above', .not. allocated(error))
      if (allocated(error)) return
      point = smoother%point(least)
      call check('least: it is the strength, and said so', held%at_end == -1 .and. held%bounded &
         .and. abs(held%strength - least) <= 0, to_text(held%strength/least))
      ! One computation, done twice.
      call check_close('least: its freedom', held%freedom, point%freedom, 1e-14_wp)
      call check_close('least: its estimate', maxval(abs(held%estimate &
         - smoother%estimate(least))), 0.0_wp, 1e-14_wp)
      call check_close('least: its resolution', maxval(abs(held%resolution &
         - smoother%resolution(least))), 0.0_wp, 1e-14_wp)

      call choose_strength(jacobian, r, 0*truth, penalty, held, error, used=least)
      call check('used: another than the one asked for', .not. allocated(error) .and. &
         abs(held%strength - least) <= 0 .and. abs(held%asked - free%strength) <= 0 .and. &
         held%at_end == 0 .and. abs(held%freedom - point%freedom) < 1e-14_wp)

      call choose_strength(jacobian, r, 0*truth, penalty, held, error, 1e30_wp*free%strength)
      call check('least: beyond all it is the bound', .not. allocated(error) .and. &
         held%at_end == -1 .and. held%bounded)
   end subroutine test_least

   !> The part of y in the range of a matrix.
   function projected(matrix, y) result(part)
      real(wp), intent(in) :: matrix(:, :), y(:)
      real(wp) :: part(size(y))
      real(qp) :: b(size(matrix, 2), 1), a(size(matrix, 1), size(matrix, 2)), unused

      a = matrix
      b(:, 1) = matmul(y, a)
      call solve(matmul(transpose(a), a), b, unused)
      part = real(matmul(a, b(:, 1)), wp)
   end function projected

   !> Averages over neighbouring coefficients, and two parameters without penalty.
   function averages(m, n) result(jacobian)
      integer, intent(in) :: m, n
      real(wp) :: jacobian(m, n + 2)
      integer :: i, j

      do j = 1, n
         do i = 1, m
            jacobian(i, j) = exp(-0.5_wp*((n + 1)*i/(m + 1.0_wp) - j)**2)
         end do
      end do
      jacobian(:, n + 1:) = random(m, 2, 6)
   end function averages

   !> Truths in the null space: how much freedom REML gives away, and how often it gives none.
   subroutine test_null_truth()
      integer, parameter :: m = 120, n = 20, sets = 400
      type(smoothing_t) :: smoothing
      type(error_t), allocatable :: error
      real(wp) :: jacobian(m, n + 2), penalty(n - 2, n + 2), truth(n + 2), freedom(sets), variance
      integer :: j, rigid

      jacobian = averages(m, n)
      penalty = 0
      penalty(:, :n) = difference_rows(n, 2)
      truth = [(2 - 0.3_wp*j, j=1, n), 5.0_wp, -3.0_wp]
      rigid = 0
      variance = 0
      do j = 1, sets
         call choose_strength(jacobian, gaussian_noise(m, 0.3_wp, 1000 + j) &
            - matmul(jacobian, truth), 0*truth, penalty, smoothing, error)
         if (allocated(error)) exit
         freedom(j) = smoothing%freedom - 2
         if (smoothing%at_end == 1) rigid = rigid + 1
         variance = variance + smoothing%variance/sets
      end do
      call check('lines: done', .not. allocated(error))
      if (allocated(error)) return
      call check('lines: mean freedom beyond a line', sum(freedom)/sets < 0.4_wp, &
         to_text(sum(freedom)/sets)//', most '//to_text(maxval(freedom))//', rigid in '// &
         to_text(rigid)//' of '//to_text(sets))
      ! The slope at the rigid end is a weighted sum of chi-squares less its mean, which is below it
      ! more often than not; all weight on one would make that 68 %.
      call check('lines: rigid more often than not', rigid > sets/2 .and. rigid < 0.75_wp*sets)
      ! Four standard errors, sqrt(2/116/400) = .0066; curvature that is found and is not there
      ! lowers it by a fraction of .4/116 or two.
      call check_close('lines: variance', variance/0.3_wp**2, 1.0_wp, 4*0.0066_wp)
   end subroutine test_null_truth

   !> Truths drawn from the prior: the strength, and how often the bands hold the truth.
   subroutine test_prior_truth()
      integer, parameter :: m = 120, n = 40, sets = 400
      real(wp), parameter :: strength = 0.02_wp, sd = 0.3_wp
      type(smoothing_t) :: smoothing
      type(error_t), allocatable :: error
      real(qp), allocatable :: null(:, :), image(:, :)
      real(wp) :: jacobian(m, n + 2), penalty(n - 2, n + 2), truth(n + 2), found(sets), &
         freedom, variance, mean, deviation
      integer :: i, inside, j

      jacobian = averages(m, n)
      penalty = 0
      penalty(:, :n) = difference_rows(n, 2)
      call split(penalty, null, image)
      inside = 0
      freedom = 0
      variance = 0
      do j = 1, sets
         truth = matmul(image, gaussian_noise(n - 2, sd/sqrt(strength), 5000 + j)) &
            + matmul(null, gaussian_noise(size(null, 2), 1.0_wp, 7000 + j))
         call choose_strength(jacobian, gaussian_noise(m, sd, 9000 + j) &
            - matmul(jacobian, truth), 0*truth, penalty, smoothing, error)
         if (allocated(error)) exit
         found(j) = log(smoothing%strength/strength)
         freedom = freedom + smoothing%freedom/sets
         variance = variance + smoothing%variance/sets
         inside = inside + count([(abs(smoothing%estimate(i) - truth(i)) < &
            1.96_wp*sqrt(smoothing%covariance(i, i)), i=1, n + 2)])
      end do
      call check('prior: done', .not. allocated(error))
      if (allocated(error)) return
      mean = sum(found)/sets
      deviation = sqrt(sum((found - mean)**2)/(sets - 1))
      ! The log of a mean of f squares is 1/f too small on average: of the roughness, with the
      ! freedom beyond a line, and of the noise, with the rest. Beside that four standard errors.
      call check_close('prior: log strength', mean, 1/(freedom - 2) - 1/(m - 2 - freedom), &
         4*deviation/sqrt(real(sets, wp)))
      call check('prior: freedom and scatter', freedom > 10, to_text(freedom)//', '// &
         to_text(deviation))
      ! Four standard errors.
      call check_close('prior: variance', variance/sd**2, 1.0_wp, &
         4*sqrt(2/((m - 2 - freedom)*sets)))
      ! Some 400*30 independent cases: a standard error of .2 %. Of 88 degrees of freedom 1.96
      ! errors are 94.7 % (Student). The rest is for the strength, which the bands take for known:
      ! its log is off by a third, and the width of a band by a few per cent.
      call check_close('prior: bands', inside/real(sets*(n + 2), wp), 0.95_wp, 0.015_wp)
   end subroutine test_prior_truth

   !> Nothing to choose, nothing to choose by, or no solution for any strength; a parameter that J
   !> does not see is no reason where the penalty holds it.
   subroutine test_refused()
      integer, parameter :: m = 12, n = 6
      type(smoothing_t) :: smoothing
      type(error_t), allocatable :: error
      real(wp) :: jacobian(m, n), penalty(3, n), residual(m), at(n), line(n), other(m, n)
      integer :: j

      jacobian = random(m, n, 1)
      residual = gaussian_noise(m, 1.0_wp, 2)
      at = 0
      line = [(real(j, wp), j=1, n)]
      penalty = 0
      penalty(:, :5) = difference_rows(5, 2)
      other = jacobian
      other(:, 6) = 0
      call choose_strength(other, residual, at, penalty, smoothing, error)
      call refused(error, 'unseen, without penalty', 'determine 1 ')
      other = jacobian
      other(:, 6) = matmul(other(:, :5), line(:5))
      call choose_strength(other, residual, at, penalty, smoothing, error)
      call refused(error, 'like a line', 'determine 1 ')
      ! A constant added to all of them is not seen, but for round-off of a large sum.
      other = jacobian
      other(:, 5) = -sum(other(:, :4), dim=2)
      call choose_strength(other, residual, at, penalty, smoothing, error)
      call refused(error, 'constants unseen', 'determine 1 ')
      ! Nothing but straight lines is unseen: J has what three rows of differences say.
      other(:, :5) = matmul(jacobian(:, :3), penalty(:, :5))
      call choose_strength(other, residual, at, penalty, smoothing, error)
      call refused(error, 'lines unseen', 'determine 2 ')
      other = jacobian
      other(:, 2) = 0
      call choose_strength(other, residual, at, penalty, smoothing, error)
      call check('unseen, with penalty: done', .not. allocated(error))
      other = jacobian
      other(:, 2) = other(:, 4)
      call choose_strength(other, residual, at, penalty, smoothing, error)
      call check('alike, with penalty: done', .not. allocated(error))
      call choose_strength(jacobian, residual, at, 0*penalty, smoothing, error)
      call refused(error, 'no penalty', 'zero')
      call choose_strength(jacobian, residual, at, penalty(:0, :), smoothing, error)
      call refused(error, 'no rows', 'zero')
      call choose_strength(jacobian(:3, :), residual(:3), at, penalty, smoothing, error)
      call refused(error, 'three residuals', '3 residuals for 3 ')
      call choose_strength(jacobian(:4, :), residual(:4), at, penalty, smoothing, error)
      call check('four residuals: done', .not. allocated(error))
      residual(5) = ieee_value(residual(5), ieee_quiet_nan)
      call choose_strength(jacobian, residual, at, penalty, smoothing, error)
      call refused(error, 'not a number', 'finite')
   end subroutine test_refused

   subroutine refused(error, name, words)
      type(error_t), allocatable, intent(in) :: error
      character(len=*), intent(in) :: name, words

      call check(name//': refused', allocated(error))
      if (allocated(error)) call check(name//': in words', index(error%message, words) > 0, &
         error%message)
   end subroutine refused

end program test_smoothing
