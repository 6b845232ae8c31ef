!> Regressions whose derivatives are known: NIST StRD and a damped oscillator.
module regressions
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   implicit none
   private

   public :: regression_t, misra1a, boxbod, mgh09

   !> y = b1 (1 - exp(-b2 x)), or MGH09's y = b1 (x**2 + b2 x)/(x**2 + b3 x + b4).
   type, extends(smooth_problem_t) :: regression_t
      logical :: rational = .false.
      real(wp), allocatable :: x(:), y(:)
   contains
      procedure :: residuals
      procedure :: jacobian
   end type regression_t

contains

   type(regression_t) function misra1a(exact)
      logical, intent(in) :: exact

      misra1a%exact = exact
      misra1a%y = [10.07_wp, 14.73_wp, 17.94_wp, 23.93_wp, 29.61_wp, 35.18_wp, 40.02_wp, 44.82_wp, &
         50.76_wp, 55.05_wp, 61.01_wp, 66.40_wp, 75.47_wp, 81.78_wp]
      misra1a%x = [77.6_wp, 114.9_wp, 141.1_wp, 190.8_wp, 239.9_wp, 289.0_wp, 332.8_wp, 378.4_wp, &
         434.8_wp, 477.3_wp, 536.8_wp, 593.1_wp, 689.1_wp, 760.0_wp]
   end function misra1a

   type(regression_t) function boxbod(exact)
      logical, intent(in) :: exact

      boxbod%exact = exact
      boxbod%y = [109.0_wp, 149.0_wp, 149.0_wp, 191.0_wp, 213.0_wp, 224.0_wp]
      boxbod%x = [1.0_wp, 2.0_wp, 3.0_wp, 5.0_wp, 7.0_wp, 10.0_wp]
   end function boxbod

   type(regression_t) function mgh09(exact)
      logical, intent(in) :: exact

      mgh09%exact = exact
      mgh09%rational = .true.
      mgh09%y = [0.1957_wp, 0.1947_wp, 0.1735_wp, 0.1600_wp, 0.0844_wp, 0.0627_wp, 0.0456_wp, &
         0.0342_wp, 0.0323_wp, 0.0235_wp, 0.0246_wp]
      mgh09%x = [4.0_wp, 2.0_wp, 1.0_wp, 0.5_wp, 0.25_wp, 0.167_wp, 0.125_wp, 0.1_wp, 0.0833_wp, &
         0.0714_wp, 0.0625_wp]
   end function mgh09

   subroutine residuals(self, parameters, r, error)
      class(regression_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      associate (b => parameters, x => self%x)
         if (self%rational) then
            r = b(1)*(x**2 + b(2)*x)/(x**2 + b(3)*x + b(4)) - self%y
         else
            r = b(1)*(1 - exp(-b(2)*x)) - self%y
         end if
      end associate
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(regression_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: below(size(r))

      call self%residuals(parameters, r, error)
      associate (b => parameters, x => self%x)
         if (self%rational) then
            below = x**2 + b(3)*x + b(4)
            jac(:, 1) = (x**2 + b(2)*x)/below
            jac(:, 2) = b(1)*x/below
            jac(:, 3) = -b(1)*(x**2 + b(2)*x)*x/below**2
            jac(:, 4) = -b(1)*(x**2 + b(2)*x)/below**2
         else
            jac(:, 1) = 1 - exp(-b(2)*x)
            jac(:, 2) = b(1)*x*exp(-b(2)*x)
         end if
      end associate
   end subroutine jacobian

end module regressions

!> Errors, correlations, what is not determined, whiteness, criteria: against certified and
!> hand-made numbers, and against what theory promises of many records.
program test_statistics
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_cases, only: case_t, measured_samples, needs_fit, read_case
   use beamid_cvode, only: cvode_t
   use beamid_errors, only: error_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, identify_meshes, model_t, simulate, simulation_t, &
      stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_modal, only: modal_t
   use beamid_noise, only: gaussian_noise
   use beamid_statistics, only: aicc, bic, nested_test, new_statistics, statistics_t, &
      undetermined
   use beamid_whiteness, only: check_residuals, residual_check_t
   use beamid_strings, only: to_text
   use beamid_variables, only: new_variable, unbounded
   use checks, only: check, check_close, finish, in_long_run
   use regressions, only: boxbod, mgh09, misra1a, regression_t
   implicit none

   call test_by_hand()
   call test_oscillator()
   call test_nist()
   call test_singular()
   call test_refused()
   call test_white()
   call test_coloured()
   call test_corrected()
   call test_criteria()
   call test_nested()
   call test_table_4_1()
   call test_bound()
   call finish('statistics')

contains

   !> J = ((1,0), (1,1), (0,1)), J'J = ((2,1), (1,2)), inverse ((2,-1), (-1,2))/3; residuals
   !> (1,1,-1): variance 3/(3 - 2). Covariance and correlation know nothing of the scale.
   subroutine test_by_hand()
      real(wp), parameter :: jacobian(3, 2) = reshape([1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, &
         1.0_wp], [3, 2]), residual(3) = [1.0_wp, 1.0_wp, -1.0_wp], estimate(2) = [20.0_wp, 15.0_wp]
      real(wp), parameter :: scales(2, 2) = reshape([1.0_wp, 1.0_wp, 2e5_wp, 7e-3_wp], [2, 2])
      !> A condition of some 1e8 is scaled away: a few eps.
      real(wp), parameter :: round_off = 1e-13_wp
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=:), allocatable :: name
      integer :: k

      do k = 1, 2
         name = 'by hand, scale '//to_text(k)//', '
         call new_statistics(jacobian, residual, estimate, scales(:, k), s, error)
         call check(name//'done', .not. allocated(error))
         if (allocated(error)) return
         call check_close(name//'variance', s%variance, 3.0_wp, round_off)
         call check_close(name//'covariance 11', s%covariance(1, 1), 2.0_wp, round_off)
         call check_close(name//'covariance 12', s%covariance(1, 2), -1.0_wp, round_off)
         call check_close(name//'covariance 21', s%covariance(2, 1), -1.0_wp, round_off)
         call check_close(name//'covariance 22', s%covariance(2, 2), 2.0_wp, round_off)
         call check_close(name//'standard error 1', s%std_error(1), sqrt(2.0_wp), round_off)
         call check_close(name//'correlation 12', s%correlation(1, 2), -0.5_wp, round_off)
         call check_close(name//'correlation 22', s%correlation(2, 2), 1.0_wp, round_off)
         ! One degree of freedom: 12.7062047361747; 12.7*sqrt(2) = 17.97 lies between 15 and 20.
         call check_close(name//'half width 2', s%half_width(2), 12.7062047361747_wp*sqrt(2.0_wp), &
            1e-11_wp)
         call check(name//'20 is determined, 15 is not', s%determined(1) .and. &
            .not. s%determined(2))
      end do
      call new_statistics(jacobian, residual, estimate, scales(:, 1), s, error)
      ! Eigenvalues of J'J are 3 and 1, their vectors (1,1) and (1,-1).
      call check_close('by hand, singular value 1', s%singular(1), sqrt(3.0_wp), round_off)
      call check_close('by hand, singular value 2', s%singular(2), 1.0_wp, round_off)
      call check_close('by hand, condition', s%condition, sqrt(3.0_wp), round_off)
      call check_close('by hand, direction 1', abs(dot_product(s%direction(:, 1), [1.0_wp, &
         1.0_wp])), sqrt(2.0_wp), round_off)
      call check_close('by hand, direction 2', abs(dot_product(s%direction(:, 2), [1.0_wp, &
         -1.0_wp])), sqrt(2.0_wp), round_off)
   end subroutine test_by_hand

   !> y = 2 exp(-C t/2) cos(sqrt(K - C**2/4) t): the Jacobian by hand; residuals of any shape whose
   !> variance is .01. Seven to eight digits are printed.
   subroutine test_oscillator()
      integer, parameter :: m = 501
      real(wp), parameter :: stiffness = 20.5_wp, damping = 1.5_wp
      real(wp) :: jacobian(m, 2), residual(m), t, omega, decay, a(2, 2), det
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      integer :: k

      omega = sqrt(stiffness - damping**2/4)
      do k = 1, m
         t = 0.01_wp*(k - 1)
         decay = 2*exp(-damping*t/2)
         jacobian(k, 1) = -decay*sin(omega*t)*t/(2*omega)
         jacobian(k, 2) = -t/2*decay*cos(omega*t) + decay*sin(omega*t)*t*damping/(4*omega)
         residual(k) = merge(1, -1, modulo(k, 3) == 0)*0.1_wp*sqrt((m - 2)/real(m, wp))
      end do
      call new_statistics(jacobian, residual, [stiffness, damping], [stiffness, damping], s, error)
      call check('oscillator: done', .not. allocated(error))
      if (allocated(error)) return
      call check_close('oscillator: variance', s%variance, 0.01_wp, 1e-14_wp)
      call check_close('oscillator: sd(K)', s%std_error(1), 0.08408723_wp, 0.6e-8_wp)
      call check_close('oscillator: sd(C)', s%std_error(2), 0.01856637_wp, 0.6e-8_wp)
      call check_close('oscillator: correlation', s%correlation(1, 2), 0.17176704_wp, 0.6e-8_wp)
      ! t of 499 degrees of freedom is 1.96473 (mpmath).
      call check_close('oscillator: interval of K', s%half_width(1), &
         1.9647293909876891_wp*s%std_error(1), 1e-11_wp)
      ! Singular values of two columns in closed form; round-off of a condition of 5.
      jacobian = jacobian*spread([stiffness, damping], 1, m)
      a = matmul(transpose(jacobian), jacobian)
      det = sqrt((a(1, 1) - a(2, 2))**2/4 + a(1, 2)**2)
      call check_close('oscillator: condition', s%condition, &
         sqrt(((a(1, 1) + a(2, 2))/2 + det)/((a(1, 1) + a(2, 2))/2 - det)), 1e-11_wp)
      call check('oscillator: both determined', all(s%determined))
   end subroutine test_oscillator

   !> Certified values have eleven digits; six are asked for in parameters and deviations, and J to
   !> six as well. A search that follows J to 1e-14 of itself leaves 1e-7 standard deviations, and
   !> the largest deviation is that of MGH09's b2, as large as b2. (With 1e-10 it would leave 1e-5
   !> of it.)
   subroutine test_nist()
      real(wp), parameter :: misra(2, 2) = reshape([2.3894212918e2_wp, 5.5015643181e-4_wp, &
         2.7070075241_wp, 7.2668688436e-6_wp], [2, 2])
      real(wp), parameter :: box(2, 2) = reshape([2.1380940889e2_wp, 5.4723748542e-1_wp, &
         1.2354515176e1_wp, 1.0455993237e-1_wp], [2, 2])
      real(wp), parameter :: mgh(4) = [1.9280693458e-1_wp, 1.9128232873e-1_wp, 1.2305650693e-1_wp, &
         1.3606233068e-1_wp]
      logical :: exact
      integer :: k

      do k = 1, 2
         exact = k == 1
         call one_fit('Misra1a', misra1a(exact), [500.0_wp, 1e-4_wp], misra(:, 1), misra(:, 2), &
            1.2455138894e-1_wp)
         call one_fit('Misra1a', misra1a(exact), [250.0_wp, 5e-4_wp], misra(:, 1), misra(:, 2), &
            1.2455138894e-1_wp)
         if (exact) call one_fit('BoxBOD', boxbod(exact), [1.0_wp, 1.0_wp], box(:, 1), box(:, 2), &
            1.1680088766e3_wp)
         call one_fit('BoxBOD', boxbod(exact), [100.0_wp, 0.75_wp], box(:, 1), box(:, 2), &
            1.1680088766e3_wp)
         call one_fit('MGH09', mgh09(exact), [25.0_wp, 39.0_wp, 41.5_wp, 39.0_wp], mgh, &
            [real(wp) ::], 3.0750560385e-4_wp)
         call one_fit('MGH09', mgh09(exact), [0.25_wp, 0.39_wp, 0.415_wp, 0.39_wp], mgh, &
            [real(wp) ::], 3.0750560385e-4_wp)
      end do
      call lost_fit()
   end subroutine test_nist

   !> BoxBOD from (1, 1) by lmdif ends on a plain: the first step, from where the curve lies a
   !> hundred times too low, takes b2 to where exp(-b2) is nothing, and with it every derivative
   !> with respect to b2. MINPACK calls that converged. The mean of y, 172.5, is left as b1. What
   !> must not happen is that it goes unnoticed: b2 is said not to be determined. (The right
   !> minimum would be as welcome.)
   subroutine lost_fit()
      type(regression_t) :: problem
      type(options_t) :: options
      type(fit_t) :: found
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=160), allocatable :: text(:)

      problem = boxbod(.false.)
      call fit(problem, 6, [new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp), &
         new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)], options, found, error)
      if (allocated(error)) then
         call check('BoxBOD, lmdif from 1: refused', .true., error%message)
         return
      end if
      if (abs(found%estimate(2)/5.4723748542e-1_wp - 1) < 1e-6_wp) then
         call check_close('BoxBOD, lmdif from 1: J', found%J/1.1680088766e3_wp, 1.0_wp, 1e-6_wp)
         return
      end if
      call new_statistics(found%jacobian, found%residual, found%estimate, abs(found%estimate), &
         s, error)
      text = undetermined(s, ['b1', 'b2'], abs(found%estimate), found%jacobian)
      call check('BoxBOD, lmdif from 1: on the plain, b2 not determined', .not. s%determined(2) &
         .and. &
         s%determined(1) .and. size(text) == 1, 'b2 = '//to_text(found%estimate(2))//', '// &
         found%reason)
      if (size(text) == 1) call check('BoxBOD, lmdif from 1: said of b2', index(text(1), &
         'b2') == 1, trim(text(1)))
   end subroutine lost_fit

   !> sd  certified, or of size 0: not known
   subroutine one_fit(name, regression, start, certified, sd, J)
      character(len=*), intent(in) :: name
      type(regression_t), intent(in) :: regression
      real(wp), intent(in) :: start(:), certified(:), sd(:), J
      type(regression_t) :: problem
      type(options_t) :: options
      type(fit_t) :: found
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=:), allocatable :: label
      integer :: k

      problem = regression
      label = name//merge(', lmder', ', lmdif', problem%exact)//' from '//to_text(start(1))//': '
      call fit(problem, size(problem%x), [(new_variable(start(k), -unbounded, unbounded, &
         start(k)), k=1, size(start))], options, found, error)
      if (allocated(error)) then
         call check(label//'converges', .false., error%message)
         return
      end if
      call check_close(label//'J', found%J/J, 1.0_wp, 1e-6_wp)
      do k = 1, size(certified)
         call check_close(label//'b'//to_text(k), found%estimate(k)/certified(k), 1.0_wp, 1e-6_wp)
      end do
      call new_statistics(found%jacobian, found%residual, found%estimate, abs(found%estimate), &
         s, error)
      do k = 1, size(sd)
         call check_close(label//'sd of b'//to_text(k), s%std_error(k)/sd(k), 1.0_wp, 1e-6_wp)
      end do
      if (.not. problem%exact) return
      ! Central differences with a step of eps**(1/3): eps**(2/3) = 4e-11 of third derivatives and
      ! as much of round-off, in columns that may vary a thousand times within a step's scale.
      call check(label//'derivatives agree', all(found%derivative_check >= 0) .and. &
         all(found%derivative_check < 1e-5_wp), to_text(maxval(found%derivative_check)))
   end subroutine one_fit

   !> Columns that are alike, that are zero, or that add up: what is said of them.
   subroutine test_singular()
      integer, parameter :: m = 40
      character(len=3), parameter :: names(3) = ['c_D', 'm_H', 'k_H']
      real(wp), parameter :: scale(3) = [0.5_wp, 2.0_wp, 30.0_wp], noises(2) = [0.1_wp, 0.0_wp]
      real(wp) :: jacobian(m, 3), residual(m), x(m)
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=160), allocatable :: text(:)
      character(len=:), allocatable :: label
      integer :: k, noise

      x = [(k/real(m, wp), k=1, m)]
      do noise = 1, 2
         ! A record without noise leaves residuals of zero: what is singular is singular all the
         ! same.
         residual = noises(noise)*gaussian_noise(m, 1.0_wp, 3)
         label = 'noise '//to_text(noises(noise))//', '
         jacobian(:, 1) = cos(x)/scale(1)
         jacobian(:, 2) = 10*x**2/scale(2)
         jacobian(:, 3) = cos(x)/scale(3)
         call new_statistics(jacobian, residual, scale, scale, s, error)
         text = undetermined(s, names, scale, jacobian)
         call check(label//'two columns alike: one sentence', size(text) == 1, to_text(size(text)))
         if (size(text) > 0) call check(label//'two columns alike: names both and not the third', &
            index(text(1), 'c_D') > 0 .and. index(text(1), 'k_H') > 0 .and. index(text(1), &
            'm_H') == 0 .and. index(text(1), '-100 %') > 0, trim(text(1)))
         ! Round-off of the decomposition decides by how much: 1e16 at least, a few times.
         call check(label//'two columns alike: condition', s%condition > 1e15_wp, &
            to_text(s%condition))
         if (noise == 1) then
            call check(label//'two columns alike: not determined, the third is', &
               .not. s%determined(1) .and. s%determined(2) .and. .not. s%determined(3))
            call check(label//'two columns alike: errors finite and large', &
               all(ieee_is_finite(s%std_error)) .and. s%std_error(1) > 1e6_wp*scale(1), &
               to_text(s%std_error(1)))
         end if
         call check(label//'two columns alike: correlations within -1 .. 1', &
            all(abs(s%correlation) <= 1 + 1e-12_wp), to_text(s%correlation(1, 3)))

         jacobian(:, 3) = 0
         call new_statistics(jacobian, residual, scale, scale, s, error)
         text = undetermined(s, names, scale, jacobian)
         call check(label//'zero column: one sentence', size(text) == 1, to_text(size(text)))
         if (size(text) > 0) call check(label//'zero column: names it alone', index(text(1), &
            'k_H') > 0 .and. index(text(1), 'c_D') == 0 .and. index(text(1), 'm_H') == 0 .and. &
            index(text(1), 'NaN') == 0, trim(text(1)))
         if (noise == 1) call check(label//'zero column: not determined, the others are', &
            s%determined(1) .and. s%determined(2) .and. .not. s%determined(3))
         call check_close(label//'zero column: correlation with another', s%correlation(1, 3), &
            0.0_wp, 1e-6_wp)

         ! c_D + m_H alone acts, in relative changes: the sentence must hold both, with opposite
         ! signs.
         jacobian(:, 1) = cos(x)/scale(1)
         jacobian(:, 2) = cos(x)/scale(2)*(1 + 1e-9_wp*x)
         jacobian(:, 3) = 10*x**2/scale(3)
         call new_statistics(jacobian, residual, scale, scale, s, error)
         text = undetermined(s, names, scale, jacobian)
         ! Almost alike: 1e-9 of a column is far more than eps, so that without noise all is
         ! determined.
         call check(label//'almost alike: as many sentences as the noise asks for', &
            size(text) == merge(1, 0, noise == 1), to_text(size(text)))
         ! sigma_3 = |x cos x| 1e-9/2 roughly; sigma_1 is that of the largest column.
         call check(label//'almost alike: condition', s%condition > 1e9_wp .and. s%condition &
            < 1e11_wp, to_text(s%condition))
      end do

      ! Nothing acts at all.
      jacobian = 0
      residual = gaussian_noise(m, 1.0_wp, 3)
      call new_statistics(jacobian, residual, scale, scale, s, error)
      call check('nothing acts: done', .not. allocated(error))
      if (allocated(error)) return
      text = undetermined(s, names, scale, jacobian)
      call check('nothing acts: a sentence for each', size(text) == 3, to_text(size(text)))
      call check('nothing acts: nothing determined', .not. any(s%determined))
      call check('nothing acts: no NaN in the errors', all(s%std_error > 1e6_wp*scale), &
         to_text(s%std_error(1)))
      call check('nothing acts: no NaN in the correlations', all(abs(s%correlation) <= 1))

      ! Doubling a weak parameter changes J by sum((J p)**2), J itself being 39: known exactly.
      jacobian(:, 1) = cos(x)*100
      jacobian(:, 2) = 0
      jacobian(1, 2) = 1e-3_wp
      jacobian(:, 3) = 10*x**2
      residual = gaussian_noise(m, 1.0_wp, 3)
      call new_statistics(jacobian, residual, scale, scale, s, error)
      text = undetermined(s, names, scale, jacobian)
      call check('weak parameter: one sentence', size(text) == 1, to_text(size(text)))
      if (size(text) > 0) call check('weak parameter: by how much J changes', index(text(1), &
         'm_H') == 1 .and. index(text(1), 'changes J by 4E-06 ') > 0, trim(text(1)))
   end subroutine test_singular

   !> No degree of freedom is left: an error, in words.
   subroutine test_refused()
      type(statistics_t) :: s
      type(error_t), allocatable :: error

      call new_statistics(reshape([1.0_wp, 2.0_wp, 3.0_wp, 5.0_wp], [2, 2]), [1.0_wp, 1.0_wp], &
         [1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], s, error)
      call check('two samples, two parameters: refused', allocated(error))
      if (allocated(error)) call check('two samples, two parameters: in words', &
         index(error%message, '2 ') > 0 .and. index(error%message, 'parameters') > 0, error%message)
   end subroutine test_refused

   !> White noise is found white in 95 of 100 records: 500 records, of which 475 are expected with a
   !> standard deviation of sqrt(500*.05*.95) = 4.9; four of these either way, and one per cent
   !> (5) for the chi-square law itself, which is that of long records. One long stream is cut
   !> into records. A regression of four parameters (constant, slope, cosine and sine) leaves
   !> correlations of the order of 4/m, which the test expects and takes off.
   subroutine test_white()
      integer, parameter :: records = 500
      integer, parameter :: lengths(3) = [49, 200, 1000], fitted(3) = [0, 1, 4]
      integer, parameter :: expected = 475, allowed = 25
      real(wp), allocatable :: stream(:), x(:), basis(:, :)
      type(residual_check_t) :: found
      real(wp) :: beyond
      integer :: i, k, r, m, passed

      do i = 1, size(lengths)
         m = lengths(i)
         stream = gaussian_noise(m*records, 0.3_wp, 1000 + m)
         basis = orthonormal_basis(m)
         do k = 1, size(fitted)
            passed = 0
            beyond = 0
            do r = 1, records
               x = stream((r - 1)*m + 1:r*m)
               x = x - matmul(basis(:, :fitted(k)), matmul(x, basis(:, :fitted(k))))
               found = whiteness(x, basis(:, :fitted(k)))
               if (found%white) passed = passed + 1
               beyond = beyond + count(abs(found%autocorrelation) > found%band)
            end do
            call check_close('white noise, m = '//to_text(m)//', '//to_text(fitted(k))// &
               ' parameters fitted: found white', real(passed, wp), real(expected, wp), &
               real(allowed, wp))
            ! Bands +-1.96/sqrt(m): 5 per cent of 20 lags beyond; the variance of r_k is (m -
            ! k)/(m(m+2)), so that for short records it is less. Lags of one record are nearly
            ! independent: 10000 of them, and fitted parameters move some.
            call check('white noise, m = '//to_text(m)//', '//to_text(fitted(k))// &
               ' parameters fitted: lags beyond the bands', beyond/(20*records) < 0.06_wp .and. &
               beyond/(20*records) > 0.02_wp, to_text(beyond/(20*records)))
         end do
      end do
      found = whiteness([0.0_wp, 0.0_wp, 0.0_wp])
      call check('residuals of zero: white, no NaN', found%white .and. &
         all(abs(found%autocorrelation) <= 0))
      found = whiteness([2.0_wp, 2.0_wp, 2.0_wp])
      call check('constant residuals: no NaN', all(abs(found%autocorrelation) <= 1))
      found = whiteness([1.0_wp])
      call check('one residual: no lags', size(found%autocorrelation) == 0 .and. found%white)
      ! By hand: residuals 1, -1, 1, -1 have mean 0; r_1 = -3/4, r_2 = 2/4; one lag for so
      ! few: Q = 4*6*9/16/3.
      found = whiteness([1.0_wp, -1.0_wp, 1.0_wp, -1.0_wp])
      call check_close('by hand, lag 1', found%autocorrelation(1), -0.75_wp, 1e-15_wp)
      call check_close('by hand, lag 2', found%autocorrelation(2), 0.5_wp, 1e-15_wp)
      call check_close('by hand, Ljung-Box', found%ljung_box, 24*0.1875_wp, 1e-13_wp)
      call check('by hand, a probability', found%probability > 0 .and. found%probability < 0.1_wp, &
         to_text(found%probability))
      call check_close('by hand, band', found%band, 1.95996398454_wp/2, 1e-11_wp)
   end subroutine test_white

   !> What the library says of residuals left by a fit whose derivatives span `basis`, (m, n).
   function whiteness(residual, basis) result(found)
      real(wp), intent(in) :: residual(:)
      real(wp), intent(in), optional :: basis(:, :)
      type(residual_check_t) :: found

      found = check_residuals(residual, basis)
   end function whiteness

   !> (m, 4) orthonormal columns that span 1, t, cos and sin of two and a half periods.
   function orthonormal_basis(m) result(basis)
      integer, intent(in) :: m
      real(wp), allocatable :: basis(:, :)
      real(wp) :: t(m)
      integer :: j, k

      t = [(k/real(m, wp), k=1, m)]
      basis = reshape([spread(1.0_wp, 1, m), t, cos(16*t), sin(16*t)], [m, 4])
      do k = 1, 4
         do j = 1, k - 1
            basis(:, k) = basis(:, k) - dot_product(basis(:, j), basis(:, k))*basis(:, j)
         end do
         basis(:, k) = basis(:, k)/norm2(basis(:, k))
      end do
   end function orthonormal_basis

   !> Autoregressive noise x_k = phi x_{k-1} + e_k of unit variance.
   function autoregressive(m, phi, seed) result(x)
      integer, intent(in) :: m, seed
      real(wp), intent(in) :: phi
      real(wp) :: x(m)
      integer :: k

      x = gaussian_noise(m, 1.0_wp, seed)
      do k = 2, m
         x(k) = phi*x(k - 1) + sqrt(1 - phi**2)*x(k)
      end do
   end function autoregressive

   !> With phi = .5 and 200 samples r_1 is .5 with an error of .06, and the Ljung-Box sum some 70
   !> against 31: a failure to see it is beyond four deviations.
   subroutine test_coloured()
      integer, parameter :: m = 200, records = 100
      type(residual_check_t) :: found
      real(wp) :: lag(3)
      integer :: k, seen

      seen = 0
      lag = 0
      do k = 1, records
         found = whiteness(autoregressive(m, 0.5_wp, 77*k))
         if (.not. found%white) seen = seen + 1
         lag = lag + found%autocorrelation(:3)/records
      end do
      call check('AR(1), phi = .5: found not white', seen == records, to_text(seen)//' of 100')
      do k = 1, 3
         ! Deviation sqrt(.75/m) to sqrt(1.6/m) a record, a tenth of it for the mean of 100, four of
         ! these; bias (1 + 3 phi)/m or so.
         call check_close('AR(1), phi = .5: mean autocorrelation at lag '//to_text(k), lag(k), &
            0.5_wp**k, 0.4_wp*sqrt(1.6_wp/m) + 3.0_wp/m)
      end do
      ! Alternating: the same the other way round.
      found = whiteness(autoregressive(m, -0.5_wp, 5))
      call check('AR(1), phi = -.5: found not white', .not. found%white, to_text(found%probability))
   end subroutine test_coloured

   !> A constant fitted to AR(1) noise: its variance is that of white noise times (1 + phi)/(1 -
   !> phi). With 20 lags, tapered linearly, the estimate aims at 1 + 2 sum (1 - k/21) phi**k, less
   !> what the mean taken off removes, (1 + phi)/(1 - phi)/m of each autocovariance.
   subroutine test_corrected()
      integer, parameter :: m = 2000, records = 200
      real(wp), parameter :: phis(3) = [0.0_wp, 0.6_wp, 0.8_wp]
      real(wp) :: jacobian(m, 1), x(m), full, tapered, mean_ratio, mean_effective, actual, plain
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=:), allocatable :: label
      integer :: i, k, r
      logical :: narrower

      jacobian = 1
      do i = 1, size(phis)
         associate (phi => phis(i))
            label = 'constant in AR(1) noise, phi = '//to_text(phi)//': '
            mean_ratio = 0
            mean_effective = 0
            actual = 0
            plain = 0
            narrower = .false.
            do r = 1, records
               x = autoregressive(m, phi, 1000*i + 13*r)
               actual = actual + (sum(x)/m)**2/records
               call new_statistics(jacobian, x - sum(x)/m, [1.0_wp], [1.0_wp], s, error)
               mean_ratio = mean_ratio + (s%corrected_error(1)/s%std_error(1))**2/records
               mean_effective = mean_effective + s%effective/records
               plain = plain + s%covariance(1, 1)/records
               narrower = narrower .or. s%corrected_error(1) < s%std_error(1) &
                  .or. s%corrected_half_width(1) < s%half_width(1)
            end do
            full = (1 + phi)/(1 - phi)
            tapered = 1 + 2*sum([((1 - k/21.0_wp)*(1 - real(k, wp)/m)*(phi**k - full/m), k=1, 20)])
            ! One estimate with a linear taper of 21 lags scatters by sqrt(4*21/(3 m)) = 12 % of
            ! itself; the mean of 200 by .8 %: four of these. White noise: never below 1, so that
            ! half of the scatter counts, .4*12 % = 5 %.
            if (phi > 0) then
               call check_close(label//'variance inflation', mean_ratio/tapered, 1.0_wp, 0.035_wp)
               call check_close(label//'effective number', mean_effective*tapered/m, 1.0_wp, &
                  0.05_wp)
               ! What the taper leaves out, by the formula above: 10 % of the variance for phi =
               ! .6, 22 % for .8; the error, its root, is then 5 and 12 % too small.
               call check(label//'against the exact inflation', mean_ratio > 0.75_wp*full .and. &
                  mean_ratio < 1.02_wp*full, to_text(mean_ratio)//' of '//to_text(full))
               ! The scatter of the estimates themselves: 200 records know a variance to 10 %,
               ! four of these; the plain error must be refuted by them.
               call check_close(label//'actual variance over plain', actual/plain, full, &
                  0.4_wp*full)
            else
               call check_close(label//'variance inflation', mean_ratio, 1.0_wp, 0.08_wp)
               call check(label//'effective number', mean_effective > 0.9_wp*m .and. &
                  mean_effective <= m, to_text(mean_effective))
            end if
            call check(label//'never below the plain errors', .not. narrower)
         end associate
      end do
   end subroutine test_corrected

   !> J = 2, m = 20, 3 parameters, so that k = 4: 20 ln .1 = -46.05170185988091;
   !> AICc + 8 + 40/15, BIC + 4 ln 20 = 4*2.995732273553991.
   subroutine test_criteria()
      call check_close('AICc', aicc(2.0_wp, 20, 3), -46.05170185988091_wp + 8 + 40.0_wp/15, &
         1e-12_wp)
      call check_close('BIC', bic(2.0_wp, 20, 3), -46.05170185988091_wp &
         + 4*2.995732273553991_wp, 1e-12_wp)
      ! One more parameter must earn 2.40... in -m ln J here: k = 4 to 5 raises 8 + 40/15 to 10 +
      ! 60/14.
      call check_close('AICc, price of a parameter', aicc(2.0_wp, 20, 4) - aicc(2.0_wp, 20, &
         3), 2 + 60.0_wp/14 - 40.0_wp/15, 1e-12_wp)
      call check_close('AICc without correction in the limit', aicc(2e6_wp, 20000000, 3), &
         2e7_wp*log(0.1_wp) + 8, 1e-4_wp)
      ! m - k - 1 <= 0: no finite correction exists.
      call check('AICc, too few samples', aicc(2.0_wp, 5, 3) > 1e300_wp)
      call check('AICc, just enough samples', aicc(2.0_wp, 6, 3) < 100, to_text(aicc(2.0_wp, &
         6, 3)))
   end subroutine test_criteria

   !> U = m (J_0 - J)/J; printed chi-square points 3.841, 5.991, 7.815 to half a unit of their
   !> last digit.
   subroutine test_nested()
      real(wp), parameter :: points(3) = [3.841_wp, 5.991_wp, 7.815_wp]
      real(wp) :: U, probability
      integer :: k

      do k = 1, 3
         call nested_test(2.0_wp*(1 + points(k)/50), 2.0_wp, 50, k, U, probability)
         call check_close('nested, U, '//to_text(k)//' restrictions', U, points(k), 1e-13_wp)
         call check_close('nested, probability, '//to_text(k)//' restrictions', probability, &
            0.05_wp, 2.5e-5_wp)
      end do
      ! U = 50*.1 = 5: erfc(sqrt(5/2)).
      call nested_test(1.1_wp, 1.0_wp, 50, 1, U, probability)
      call check_close('nested, J 1.1 and 1, 50 samples', probability, erfc(sqrt(2.5_wp)), 1e-14_wp)
      ! A search that ended above its own special case: not a probability beyond 1.
      call nested_test(0.9_wp, 1.0_wp, 50, 1, U, probability)
      call check_close('nested, the full model worse', probability, 1.0_wp, 0.0_wp)
   end subroutine test_nested

   !> The case of Table 4.1, exact responses and CVODE with rtol 1e-11.
   !>
   !> What CVODE leaves is measured at the modal minimum: 3e-9 of the record, and ten times less for
   !> each digit of rtol, so that it is the integrator that is off. It moves the minimum of J by a
   !> step of Gauss and Newton, J by 2 r dr at most. On top of that, `lmdif` ends where its forward
   !> differences say that J is flat: their steps are 1e-4 of a parameter (a tenth of a per cent of
   !> J's digits, but no integrator noise), which moves the end by 1e-4 standard deviations times
   !> the curvature of the model, of order one. c_D, whose deviation is up to 36 % of it, is the
   !> only one of which that could be more than 1e-5.
   subroutine test_table_4_1()
      character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
      type(case_t) :: case
      type(model_t) :: model
      type(stage_fit_t), allocatable :: exact(:, :), integrated(:, :)
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error
      real(wp), allocatable :: samples(:), measured(:), change(:), shift(:)
      real(wp) :: moved
      character(len=:), allocatable :: label
      character(len=160), allocatable :: text(:)
      integer, allocatable :: meshes(:)
      integer :: i, j, k

      call read_case('data/table_4_1_fit.nml', needs_fit, case, error)
      if (.not. allocated(error)) call measured_samples(case, samples, measured, error)
      if (allocated(error)) then
         call check('Table 4.1: read', .false., error%message)
         return
      end if
      model = case%model
      deallocate (model%solver)
      model%solver = modal_t()
      call identify_meshes(model, case%meshes, case%stages, samples, measured, exact, error)
      call check('Table 4.1: modal converges', .not. allocated(error))
      if (allocated(error)) return
      deallocate (model%solver)
      model%solver = cvode_t(rtol=1e-11_wp)
      meshes = [2, 3]
      if (in_long_run()) meshes = [(k, k=1, size(case%meshes))]
      call identify_meshes(model, case%meshes(meshes), case%stages, samples, measured, integrated, &
         error)
      call check('Table 4.1: cvode converges', .not. allocated(error))
      if (allocated(error)) return
      do j = 1, size(meshes)
         k = meshes(j)
         associate (a => exact(1, k), b => integrated(1, j))
            label = 'Table 4.1, N = '//to_text(a%elements)//': '
            model%structure = a%structure
            call simulate(model, case%meshes(k), samples, simulation, error)
            change = simulation%acceleration - measured - a%fit%residual
            call check_close(label//'the integrator''s error at the minimum', norm2(change) &
               /norm2(measured), 0.0_wp, 1e-8_wp)
            shift = matmul(a%statistics%covariance, matmul(change, &
               a%fit%jacobian))/a%statistics%variance
            moved = 2*norm2(change)/sqrt(a%fit%J)
            do i = 1, 4
               call check_close(label//names(i)//', shift of the minimum by the integrator', &
                  shift(i)/a%fit%estimate(i), 0.0_wp, 1e-5_wp)
               call check_close(label//names(i)//', cvode over modal', b%fit%estimate(i) &
                  /a%fit%estimate(i), 1.0_wp, max(1e-5_wp, merge(1e-3_wp, 0.0_wp, i == 1) &
                  *a%statistics%std_error(i)/a%fit%estimate(i)))
               ! Central differences with a step of rtol**(1/3) at least 1e-8**(1/3): 2e-3, squared.
               call check_close(label//'sd of '//names(i)//', cvode over modal', &
                  b%statistics%std_error(i)/a%statistics%std_error(i), 1.0_wp, 1e-4_wp)
            end do
            call check_close(label//'J, cvode over modal', b%fit%J/a%fit%J, 1.0_wp, 1e-7_wp + moved)
            ! A step of 6e-6, its square 4e-11, round-off 1e-16/6e-6 of responses whose derivative
            ! is, for c_D, a thousand times smaller than themselves.
            call check(label//'exact derivatives against differences', &
               all(a%fit%derivative_check >= 0) .and. all(a%fit%derivative_check < 1e-5_wp), &
               to_text(a%fit%derivative_check(1))//' and '//to_text(a%fit%derivative_check(2)))
            call check(label//'no exact derivatives with cvode', &
               .not. allocated(b%fit%derivative_check))
            text = undetermined(a%statistics, names, a%quantities%scale, a%jacobian)
            do i = 1, size(text)
               print '(3a)', '      ', label, trim(text(i))
            end do
            print '(5a)', '      ', label, 'c_D '//to_text(a%fit%estimate(1)), ' +- ', &
               to_text(a%statistics%half_width(1))//', condition '//to_text(a%statistics%condition)
            call check(label//'determined, all four', all(a%statistics%determined))
            ! An interval narrower than the value, and a sentence that denies it, do not go
            ! together: relative changes are relative to the estimates.
            do i = 1, 4
               call check_close(label//names(i)//', relative to its estimate', &
                  a%quantities(i)%scale/a%fit%estimate(i), 1.0_wp, 1e-12_wp)
            end do
            call check(label//'no sentence denies it', size(text) == 0)
         end associate
      end do
      ! N = 2 misses mode 3 by several per cent and has nothing else for c_D to explain: the
      ! interval is some three quarters of the value, against 3 % for N = 6.
      associate (s => exact(1, 1)%statistics, q => exact(1, 1)%fit%estimate)
         call check('Table 4.1, N = 2: c_D known to no better than half of itself', &
            s%half_width(1)/q(1) > 0.5_wp .and. s%half_width(1)/q(1) < 1, &
            to_text(s%half_width(1)/q(1)))
      end associate
      associate (s => exact(1, 5)%statistics, q => exact(1, 5)%fit%estimate)
         call check('Table 4.1, N = 6: c_D known to 5 %', s%half_width(1)/q(1) < 0.05_wp, &
            to_text(s%half_width(1)/q(1)))
      end associate
   end subroutine test_table_4_1

   !> The truth lies on the bound of c_D. Where the noise pulls c_D below it, c_D is held there: its
   !> value is the bound itself, the others are those of a fit with c_D = 0 not free, in few
   !> iterations; where it does not, the minimum lies inside, with a smaller J than on the bound.
   subroutine test_bound()
      character(len=3), parameter :: names(4) = ['c_D', 'm_H', 'c_H', 'k_H']
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      integer, parameter :: records = 12
      type(case_t) :: case
      type(model_t) :: model
      type(stage_t) :: all_four, three
      type(simulation_t) :: simulation
      type(stage_fit_t), allocatable :: found(:), held(:)
      type(error_t), allocatable :: error
      real(wp), allocatable :: samples(:), unused(:), noise(:), measured(:)
      character(len=:), allocatable :: label
      integer :: i, r, on_bound

      call read_case('data/table_4_1_fit.nml', needs_fit, case, error)
      if (.not. allocated(error)) call measured_samples(case, samples, unused, error)
      model = case%model
      deallocate (model%solver)
      model%solver = modal_t()
      associate (s => model%structure)
         s%c_D = 0
         s%m_H = 0.04_wp
         s%c_H = 0.004_wp
         s%k_H = 0.3_wp
      end associate
      call simulate(model, mesh, samples, simulation, error)
      call check('on a bound: record made', .not. allocated(error))
      if (allocated(error)) return
      noise = gaussian_noise(records*size(samples), 0.02_wp*norm2(simulation%acceleration) &
         /sqrt(real(size(samples), wp)), 404)
      all_four = case%stages(1)
      three = stage_t(free=all_four%free(2:), start=all_four%start(2:), lower=all_four%lower(2:), &
         upper=all_four%upper(2:))
      on_bound = 0
      do r = 1, records
         label = 'on a bound, record '//to_text(r)//': '
         measured = simulation%acceleration + noise((r - 1)*size(samples) + 1:r*size(samples))
         model%structure%c_D = 0
         call identify(model, mesh, [three], samples, measured, held, error)
         if (.not. allocated(error)) call identify(model, mesh, [all_four], samples, measured, &
            found, error)
         if (allocated(error)) then
            call check(label//'converges', .false., error%message)
            cycle
         end if
         ! Measured with the holding of bounds switched off: 1600 iterations where the minimum is
         ! on the bound. With it some twenty; a minimum inside but near the bound lets go again,
         ! at a price.
         call check(label//'few iterations', found(1)%fit%iterations <= &
            merge(40, 200, found(1)%fit%estimate(1) <= 0), &
            to_text(found(1)%fit%iterations)//', c_D '// to_text(found(1)%fit%estimate(1)))
         if (found(1)%fit%estimate(1) > 0) then
            call check(label//'inside: J below that on the bound', found(1)%fit%J < held(1)%fit%J, &
               to_text(held(1)%fit%J/found(1)%fit%J - 1))
            cycle
         end if
         on_bound = on_bound + 1
         call check_close(label//'c_D is its bound', found(1)%fit%estimate(1), 0.0_wp, 0.0_wp)
         ! J falls towards the outside: the slope at the bound is positive.
         call check(label//'J rises towards the inside', &
            dot_product(found(1)%fit%jacobian(:, 1), found(1)%fit%residual) > 0)
         do i = 2, 4
            ! Two searches for one minimum of J, each followed to 1e-14: 1e-7 standard deviations.
            call check_close(label//names(i), found(1)%fit%estimate(i)/held(1)%fit%estimate(i &
               - 1), 1.0_wp, 1e-7_wp)
         end do
         call check_close(label//'J', found(1)%fit%J/held(1)%fit%J, 1.0_wp, 1e-12_wp)
      end do
      ! Half of the records, by the sign of the noise: all or none happens once in 2000 times.
      call check('on a bound: some records', on_bound > 0 .and. on_bound < records, &
         to_text(on_bound))
   end subroutine test_bound

end program test_statistics
