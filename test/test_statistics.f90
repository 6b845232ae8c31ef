!> Errors, correlations, what is not determined, criteria: against certified and hand-made numbers.
program test_statistics
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_criteria, only: aicc, bic, nested_test
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_noise, only: gaussian_noise
   use beamid_sorting, only: median, sort
   use beamid_statistics, only: new_statistics, statistics_t
   use beamid_strings, only: to_text
   use beamid_undetermined_directions, only: undetermined
   use beamid_variables, only: new_variable, unbounded
   use checks, only: check, check_close, finish
   use regressions, only: boxbod, mgh09, misra1a, regression_t
   implicit none

   call test_by_hand()
   call test_known_noise()
   call test_order()
   call test_oscillator()
   call test_nist()
   call test_singular()
   call test_refused()
   call test_criteria()
   call test_nested()
   call test_median()
   call finish('statistics')

contains

   !> Rows in units of a known noise. J'J = ((2,1), (1,2)) with the inverse ((2,-1), (-1,2))/3: the
   !> standard errors are sqrt(2/3) and the quantile is that of the normal distribution, whatever
   !> the residuals are, unless their sum of squares is improbable. That of one degree of freedom
   !> exceeds 6.634896601 with a probability of 1 %. No degree of freedom has to be left.
   subroutine test_known_noise()
      real(wp), parameter :: jacobian(3, 2) = reshape([1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, &
         1.0_wp], [3, 2]), estimate(2) = [20.0_wp, 15.0_wp], scale(2) = [1.0_wp, 1.0_wp], &
         normal = 1.9599639845400545_wp, limit = 6.6348966010212145_wp, &
         sizes(4) = [0.0_wp, 1e-3_wp, 0.99_wp*limit, 1.01_wp*limit]
      !> Some units of round-off; the quantile of the normal distribution has 13 digits.
      real(wp), parameter :: round_off = 1e-12_wp
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=:), allocatable :: name
      real(wp) :: variance
      integer :: k

      do k = 1, size(sizes)
         name = 'known noise, J = '//to_text(sizes(k))//', '
         ! Orthogonal to both columns, of the given sum of squares.
         call new_statistics(jacobian, sqrt(sizes(k)/3)*[1.0_wp, -1.0_wp, 1.0_wp], estimate, &
            scale, s, error, is_known=.true.)
         call check(name//'done', .not. allocated(error))
         if (allocated(error)) return
         variance = merge(1.0_wp, sizes(k), sizes(k) < limit)
         call check(name//'flags', s%noise_is_known .and. (s%is_exceeded .eqv. sizes(k) > limit))
         call check_close(name//'variance', s%variance, variance, round_off)
         call check_close(name//'standard error', s%std_error(1), sqrt(2*variance/3), round_off)
         ! One degree of freedom: 12.7062047361747, as in `test_by_hand`.
         call check_close(name//'half width', s%half_width(1), merge(normal, 12.7062047361747_wp, &
            sizes(k) < limit)*sqrt(2*variance/3), 1e-11_wp)
      end do
      call new_statistics(jacobian(:2, :), [0.0_wp, 0.0_wp], estimate, scale, s, error, &
         is_known=.true.)
      call check('known noise, as many rows as parameters', .not. allocated(error))
      if (allocated(error)) return
      ! The inverse of J'J = ((2,1), (1,1)) is ((1,-1), (-1,2)).
      call check_close('  standard error 1', s%std_error(1), 1.0_wp, round_off)
      call check_close('  standard error 2', s%std_error(2), sqrt(2.0_wp), round_off)
      call check_close('  half width', s%half_width(1), normal, round_off)
      call new_statistics(jacobian(:2, :), [0.0_wp, 0.0_wp], estimate, scale, s, error)
      call check('unknown noise, as many rows as parameters: refused', allocated(error))
      call new_statistics(jacobian(:1, :), [0.0_wp], estimate, scale, s, error, is_known=.true.)
      call check('known noise, fewer rows than parameters: refused', allocated(error))
   end subroutine test_known_noise

   !> Residuals in equal pairs: the variance of their mean is twice that of independent ones, which
   !> counts only if the rows have an order.
   subroutine test_order()
      integer, parameter :: m = 400
      real(wp) :: jacobian(m, 1), residual(m)
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      integer :: k

      jacobian = 1
      residual(:m/2) = gaussian_noise(m/2, 1.0_wp, 3)
      residual = [(residual((k + 1)/2), k=1, m)]
      residual = residual - sum(residual)/m
      call new_statistics(jacobian, residual, [9.0_wp], [1.0_wp], s, error)
      ! The taper of 20 lags and the chance correlations of 200 values allow some ten per cent.
      call check('rows in order: correlated', s%corrected_error(1) > 1.2_wp*s%std_error(1))
      call new_statistics(jacobian, residual, [9.0_wp], [1.0_wp], s, error, &
         ordered=spread(.false., 1, m))
      call check_close('rows without order: no correction', s%corrected_error(1)/s%std_error(1), &
         1.0_wp, 0.0_wp)
      ! Of each two pairs, one value counts.
      call new_statistics(jacobian, residual, [9.0_wp], [1.0_wp], s, error, &
         ordered=[(modulo(k, 4) == 1, k=1, m)])
      call check('rows apart: hardly correlated', s%corrected_error(1) < 1.4_wp*s%std_error(1))
   end subroutine test_order

   !> J = ((1,0), (1,1), (0,1)), J'J = ((2,1), (1,2)), inverse ((2,-1), (-1,2))/3; residuals
   !> (1,1,-1): variance 3/(3 - 2). Covariance and correlation know nothing of the scale.
   subroutine test_by_hand()
      real(wp), parameter :: jacobian(3, 2) = reshape([1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, &
         1.0_wp], [3, 2]), residual(3) = [1.0_wp, 1.0_wp, -1.0_wp], estimate(2) = [20.0_wp, &
         15.0_wp]
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
         call check_close(name//'half width 2', s%half_width(2), &
            12.7062047361747_wp*sqrt(2.0_wp), &
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
      logical :: exact
      integer :: k

      do k = 1, 2
         exact = k == 1
         call one_fit(misra1a(exact), [500.0_wp, 1e-4_wp])
         call one_fit(misra1a(exact), [250.0_wp, 5e-4_wp])
         ! The trap of BoxBOD, which test_least_squares looks into.
         call one_fit(boxbod(exact), [1.0_wp, 1.0_wp])
         call one_fit(boxbod(exact), [100.0_wp, 0.75_wp])
         call one_fit(mgh09(exact), [25.0_wp, 39.0_wp, 41.5_wp, 39.0_wp])
         call one_fit(mgh09(exact), [0.25_wp, 0.39_wp, 0.415_wp, 0.39_wp])
      end do
   end subroutine test_nist

   subroutine one_fit(regression, start)
      type(regression_t), intent(in) :: regression
      real(wp), intent(in) :: start(:)
      type(regression_t) :: problem
      type(options_t) :: options
      type(fit_t) :: found
      type(statistics_t) :: s
      type(error_t), allocatable :: error
      character(len=:), allocatable :: label
      integer :: k

      problem = regression
      label = trim(problem%name)//merge(', lmder', ', lmdif', problem%exact)//' from '// &
         to_text(start(1))//': '
      call fit(problem, size(problem%x), [(new_variable(start(k), -unbounded, unbounded, &
         start(k)), k=1, size(start))], options, found, error)
      if (allocated(error)) then
         call check(label//'converges', .false., error%message)
         return
      end if
      call check_close(label//'J', found%J/problem%J, 1.0_wp, 1e-6_wp)
      do k = 1, size(problem%b)
         call check_close(label//'b'//to_text(k), found%estimate(k)/problem%b(k), 1.0_wp, 1e-6_wp)
      end do
      call new_statistics(found%jacobian, found%residual, found%estimate, abs(found%estimate), &
         s, error)
      do k = 1, size(problem%sd)
         call check_close(label//'sd of b'//to_text(k), s%std_error(k)/problem%sd(k), 1.0_wp, &
            1e-6_wp)
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
         index(error%message, '2 ') > 0 .and. index(error%message, 'parameters') > 0, &
         error%message)
   end subroutine test_refused

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
      call check_close('nested, J 1.1 and 1, 50 samples', probability, erfc(sqrt(2.5_wp)), &
         1e-14_wp)
      ! A search that ended above its own special case: not a probability beyond 1.
      call nested_test(0.9_wp, 1.0_wp, 50, 1, U, probability)
      call check_close('nested, the full model worse', probability, 1.0_wp, 0.0_wp)
   end subroutine test_nested

   !> The median is the middle one of the sorted values, with ties and without, and in order.
   subroutine test_median()
      real(wp), allocatable :: values(:), sorted(:)
      integer :: n, step, wrong

      wrong = 0
      do n = 1, 60
         do step = 0, 2
            values = gaussian_noise(n, 1.0_wp, n)
            if (step == 1) values = real(nint(2*values), wp)
            sorted = values
            call sort(sorted)
            if (step == 2) values = sorted
            if (abs(median(values) - sorted((n + 1)/2)) > 0) wrong = wrong + 1
         end do
      end do
      call check('the median is the middle one of the sorted values', wrong == 0, to_text(wrong))
      call check('the median of no values', abs(median(values(:0))) <= 0)
   end subroutine test_median

end program test_statistics
