!> Incomplete beta and gamma functions and what is built on them, against 40-digit arithmetic
!> (mpmath) and against the closed forms of special cases.
program test_distributions
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_distributions, only: chi_square_tail, incomplete_beta, incomplete_gamma, &
      normal_probability, normal_quantile, student_probability, student_quantile
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp), pi = acos(-1.0_wp)

   call test_beta()
   call test_beta_symmetry()
   call test_beta_closed_forms()
   call test_gamma()
   call test_gamma_closed_forms()
   call test_student_quantiles()
   call test_student_closed_forms()
   call test_round_trip()
   call test_chi_square()
   call test_monotonic()
   call test_extremes()
   call test_normal()
   call test_normal_round_trip()
   call finish('distributions')

contains

   !> Relative error that round-off must be expected to leave in I_x(a, b): each logarithm in the
   !> exponent of x**a (1 - x)**b/B(a, b) is wrong by half a unit of its last place, and x itself by
   !> half a unit of its own; four times that, for the fraction.
   pure real(wp) function beta_error(a, b, x)
      real(wp), intent(in) :: a, b, x

      beta_error = 4*eps*(1 + abs(log_gamma(a + b)) + abs(log_gamma(a)) + abs(log_gamma(b)) &
         + a*(1 + abs(log(x))) + b*(abs(log(1 - x)) + x/(1 - x)))
   end function beta_error

   !> The same for Q(a, x) with its x**a exp(-x)/Gamma(a).
   pure real(wp) function gamma_error(a, x)
      real(wp), intent(in) :: a, x

      gamma_error = 4*eps*(1 + abs(log_gamma(a)) + a*abs(log(x)) + x)
   end function gamma_error

   subroutine test_beta()
      integer, parameter :: n = 14
      real(wp), parameter :: a(n) = [0.5_wp, 2.0_wp, 5.0_wp, 0.5_wp, 10.0_wp, 50.0_wp, 0.01_wp, &
         1000.0_wp, 22.5_wp, 0.5_wp, 3.0_wp, 200.0_wp, 40.0_wp, 2.0_wp], &
         b(n) = [0.5_wp, 3.0_wp, 0.5_wp, 5.0_wp, 10.0_wp, 60.0_wp, 1.5_wp, 1000.0_wp, 0.5_wp, &
         22.5_wp, 7.0_wp, 0.5_wp, 2.0_wp, 40.0_wp], &
         x(n) = [0.3_wp, 0.4_wp, 0.9_wp, 0.001_wp, 0.5_wp, 0.4_wp, 0.5_wp, 0.49_wp, 0.9_wp, &
         1e-8_wp, 1e-30_wp, 0.99_wp, 0.25_wp, 0.25_wp], &
         reference(n) = [0.36901011956554538_wp, 0.5248_wp, 0.31664291502001226_wp, &
         0.077718007899033204_wp, 0.5_wp, 0.12470685834310026_wp, 0.99650760843578873_wp, &
         0.18555265943151166_wp, 0.030350989287990768_wp, 5.3227214430116673e-4_wp, 8.4e-89_wp, &
         0.045094107137079782_wp, 2.5642598989143858e-23_wp, 0.99988937756322199_wp]
      integer :: k

      do k = 1, n
         call check_close('I_x(a, b), a = '//to_text(a(k))//', b = '//to_text(b(k))//', x = '// &
            to_text(x(k)), incomplete_beta(a(k), b(k), x(k)), reference(k), &
            beta_error(a(k), b(k), x(k))*reference(k))
      end do
   end subroutine test_beta

   !> I_x(a, b) + I_{1-x}(b, a) = 1, with x a multiple of 1/64 so that 1 - x is exact.
   subroutine test_beta_symmetry()
      real(wp), parameter :: shapes(6) = [0.02_wp, 0.5_wp, 1.0_wp, 3.5_wp, 40.0_wp, 700.0_wp]
      real(wp) :: worst, allowed, excess, x
      integer :: i, j, k

      excess = 0
      worst = 0
      do i = 1, size(shapes)
         do j = 1, size(shapes)
            do k = 1, 63
               x = k/64.0_wp
               worst = abs(incomplete_beta(shapes(i), shapes(j), x) + &
                  incomplete_beta(shapes(j), shapes(i), 1 - x) - 1)
               allowed = beta_error(shapes(i), shapes(j), x)
               excess = max(excess, worst/allowed)
            end do
         end do
      end do
      call check_close('I_x(a, b) + I_1-x(b, a) = 1: worst in units of round-off', excess, &
         0.0_wp, 1.0_wp)
      call check_close('I_0', incomplete_beta(2.0_wp, 3.0_wp, 0.0_wp), 0.0_wp, 0.0_wp)
      call check_close('I_1', incomplete_beta(2.0_wp, 3.0_wp, 1.0_wp), 1.0_wp, 0.0_wp)
   end subroutine test_beta_symmetry

   !> I_x(a, 1) = x**a, I_x(1, b) = 1 - (1 - x)**b, I_x(1/2, 1/2) = 2/pi asin(sqrt(x)).
   subroutine test_beta_closed_forms()
      real(wp), parameter :: powers(4) = [0.1_wp, 1.0_wp, 7.0_wp, 120.0_wp]
      real(wp) :: x, excess(3)
      integer :: i, k

      excess = 0
      do k = 1, 31
         x = k/32.0_wp
         do i = 1, size(powers)
            associate (p => powers(i))
               excess(1) = max(excess(1), abs(incomplete_beta(p, 1.0_wp, x)/x**p - 1) &
                  /beta_error(p, 1.0_wp, x))
               excess(2) = max(excess(2), abs(incomplete_beta(1.0_wp, p, x) - (1 - (1 - x)**p)) &
                  /beta_error(1.0_wp, p, x))
            end associate
         end do
         excess(3) = max(excess(3), abs(incomplete_beta(0.5_wp, 0.5_wp, x) - 2/pi*asin(sqrt(x))) &
            /beta_error(0.5_wp, 0.5_wp, x))
      end do
      call check_close('I_x(a, 1) = x^a, in units of round-off', excess(1), 0.0_wp, 1.0_wp)
      call check_close('I_x(1, b) = 1 - (1 - x)^b, in units of round-off', excess(2), 0.0_wp, &
         1.0_wp)
      call check_close('I_x(1/2, 1/2) = arcsine law, in units of round-off', excess(3), 0.0_wp, &
         1.0_wp)
   end subroutine test_beta_closed_forms

   subroutine test_gamma()
      integer, parameter :: n = 13
      real(wp), parameter :: a(n) = [10.0_wp, 0.5_wp, 0.5_wp, 100.0_wp, 100.0_wp, 1e4_wp, 0.01_wp, &
         3.0_wp, 0.001_wp, 2.5_wp, 2.5_wp, 1e6_wp, 20.0_wp], &
         x(n) = [10.0_wp, 1e-10_wp, 50.0_wp, 80.0_wp, 130.0_wp, 1e4_wp, 0.01_wp, 700.0_wp, &
         5.0_wp, 3.4_wp, 3.6_wp, 1.001e6_wp, 1e-3_wp], &
         reference(n) = [0.45792971447185221_wp, 0.99998871620832942_wp, &
         1.5239706048321052e-23_wp, &
         0.98289168696486689_wp, 2.7504083673065263e-3_wp, 0.4986701916600448_wp, &
         0.039652576478490802_wp, 2.4225323864783195e-299_wp, 1.1509813397308609e-6_wp, &
         0.23594453769452138_wp, 0.20618591970955589_wp, 0.15865521363165971_wp, 1.0_wp]
      real(wp) :: scale
      integer :: k

      do k = 1, n
         ! Below x = a + 1 the function is 1 minus a series: there the error is that of the series,
         ! which is at most 1, and absolute.
         scale = merge(1.0_wp, reference(k), x(k) < a(k) + 1)
         call check_close('Q(a, x), a = '//to_text(a(k))//', x = '//to_text(x(k)), &
            incomplete_gamma(a(k), x(k)), reference(k), gamma_error(a(k), x(k))*scale)
      end do
   end subroutine test_gamma

   !> Q(1, x) = exp(-x), Q(1/2, x) = erfc(sqrt(x)), Q(a + 1, x) = Q(a, x) + x**a exp(-x)/Gamma(a +
   !> 1).
   subroutine test_gamma_closed_forms()
      real(wp), parameter :: shapes(4) = [0.3_wp, 1.7_wp, 6.0_wp, 33.0_wp]
      real(wp) :: x, excess(3)
      integer :: i, k

      excess = 0
      do k = 1, 60
         x = k**2/32.0_wp
         excess(1) = max(excess(1), abs(incomplete_gamma(1.0_wp, x)/exp(-x) &
            - 1)/gamma_error(1.0_wp, x))
         ! At x < 1.5 by the complement: absolute.
         excess(2) = max(excess(2), abs(incomplete_gamma(0.5_wp, x) - erfc(sqrt(x))) &
            /(merge(1.0_wp, erfc(sqrt(x)), x < 1.5_wp)*gamma_error(0.5_wp, x)))
         do i = 1, size(shapes)
            associate (a => shapes(i))
               excess(3) = max(excess(3), abs(incomplete_gamma(a + 1, x) - incomplete_gamma(a, x) &
                  - exp(a*log(x) - x - log_gamma(a + 1)))/gamma_error(a + 1, x))
            end associate
         end do
      end do
      call check_close('Q(1, x) = exp(-x), in units of round-off', excess(1), 0.0_wp, 1.0_wp)
      call check_close('Q(1/2, x) = erfc(sqrt x), in units of round-off', excess(2), 0.0_wp, 1.0_wp)
      call check_close('recurrence of Q in a, in units of round-off', excess(3), 0.0_wp, 1.0_wp)
      call check_close('Q(a, 0)', incomplete_gamma(3.0_wp, 0.0_wp), 1.0_wp, 0.0_wp)
   end subroutine test_gamma_closed_forms

   !> Tabulated and computed to 17 digits; twelve are asked for. With a million degrees of freedom
   !> the logarithms of the gamma functions in the exponent are 6e6, of which one unit of the last
   !> place is 1e-9: that much, divided by the slope of the distribution, is allowed.
   subroutine test_student_quantiles()
      integer, parameter :: n = 15, others = 8
      real(wp), parameter :: freedom(n) = [1.0_wp, 2.0_wp, 3.0_wp, 5.0_wp, 7.0_wp, 10.0_wp, &
         20.0_wp, 30.0_wp, 45.0_wp, 60.0_wp, 100.0_wp, 1000.0_wp, 1e6_wp, 2.5_wp, 0.5_wp], &
         reference(n) = [12.706204736174705_wp, 4.3026527297494639_wp, 3.1824463052837096_wp, &
         2.5705818356363155_wp, 2.3646242515927853_wp, 2.2281388519862747_wp, &
         2.0859634472658648_wp, &
         2.0422724563012383_wp, 2.0141033888808467_wp, 2.0002978220142605_wp, &
         1.9839715185235523_wp, &
         1.9623390808264085_wp, 1.959966356814107_wp, 3.5746548420036832_wp, 164.55767348048853_wp]
      real(wp), parameter :: p(others) = [0.5_wp, 0.5_wp, 0.99_wp, 0.99_wp, 0.9999_wp, 0.6827_wp, &
         0.001_wp, 0.999999_wp], freedoms(others) = [1.0_wp, 5.0_wp, 3.0_wp, 45.0_wp, 10.0_wp, &
         45.0_wp, 8.0_wp, 2.0_wp], quantiles(others) = [1.0_wp, 0.72668684380042265_wp, &
         5.8409093097333573_wp, 2.6895850193746429_wp, 6.211050891290663_wp, &
         1.0112574570594143_wp, 1.2929956623415028e-3_wp, 999.99924999984375_wp]
      real(wp) :: allowed
      integer :: k

      do k = 1, n
         allowed = 1e-12_wp*reference(k)
         if (freedom(k) > 1e5_wp) allowed = 1e-8_wp
         call check_close('Student, 95 %, freedom '//to_text(freedom(k)), &
            student_quantile(0.95_wp, freedom(k)), reference(k), allowed)
      end do
      do k = 1, others
         ! A probability near 1 is known to eps, of which 1 - p makes eps/(1 - p).
         call check_close('Student, p = '//to_text(p(k))//', freedom '//to_text(freedoms(k)), &
            student_quantile(p(k), freedoms(k)), quantiles(k), &
            quantiles(k)*(1e-12_wp + eps/min(p(k), 1 - p(k))))
      end do
   end subroutine test_student_quantiles

   !> P(|T| <= t): 2/pi atan t for 1, t/sqrt(2 + t**2) for 2 degrees of freedom; erf(t/sqrt 2) for
   !> very many, with the first term of the expansion in 1/freedom.
   subroutine test_student_closed_forms()
      real(wp), parameter :: many = 1e4_wp
      real(wp) :: t, worst(3), normal
      integer :: k

      worst = 0
      do k = 1, 60
         t = 0.1_wp*k
         worst(1) = max(worst(1), abs(student_probability(t, 1.0_wp) - 2/pi*atan(t)))
         worst(2) = max(worst(2), abs(student_probability(t, 2.0_wp) - t/sqrt(2 + t**2)))
         normal = erf(t/sqrt(2.0_wp)) - exp(-t**2/2)/sqrt(2*pi)*(t**3 + t)/(2*many)
         worst(3) = max(worst(3), abs(student_probability(t, many) - normal))
      end do
      ! Absolute round-off of 1 - I.
      call check_close('Student, freedom 1', worst(1), 0.0_wp, 20*eps)
      call check_close('Student, freedom 2', worst(2), 0.0_wp, 20*eps)
      ! The next term of the expansion: phi(t) (3 t**7 - 5 t**5 - 7 t**3 - 3 t)/(96*freedom**2)*2
      ! < .2e-8; the bound for the polynomial is its maximum over t, 30 or so, times phi.
      call check_close('Student, freedom 1e4 is nearly normal', worst(3), 0.0_wp, 1e-8_wp)
      call check_close('Student, t = 0', student_probability(0.0_wp, 7.0_wp), 0.0_wp, 0.0_wp)
   end subroutine test_student_closed_forms

   !> The quantile of the probability of t is t.
   subroutine test_round_trip()
      real(wp), parameter :: freedom(5) = [1.0_wp, 3.0_wp, 12.5_wp, 45.0_wp, 500.0_wp]
      real(wp) :: t, p, excess
      integer :: i, k

      excess = 0
      do i = 1, size(freedom)
         do k = 1, 24
            t = 0.125_wp*k
            p = student_probability(t, freedom(i))
            ! p has an error of a few eps (absolute, with the factor of the exponent, freedom*eps)
            ! which the slope, at least some (1 - p)/(t + 1), turns into one of t.
            excess = max(excess, abs(student_quantile(p, freedom(i)) - t) &
               /(10*eps*(1 + freedom(i))*(1 + t)/(1 - p)))
         end do
      end do
      call check_close('Student, quantile of the probability, in units of round-off', excess, &
         0.0_wp, 1.0_wp)
   end subroutine test_round_trip

   !> Tabulated points and tails out to where they underflow.
   subroutine test_chi_square()
      integer, parameter :: n = 15
      real(wp), parameter :: x(n) = [3.841458820694124_wp, 5.991464547107979_wp, &
         7.814727903251178_wp, &
         6.634896601021213_wp, 1e-12_wp, 1e-6_wp, 200.0_wp, 1400.0_wp, 1400.0_wp, 100.0_wp, &
         18.3_wp, 150.0_wp, 31.41_wp, 0.5_wp, 1e-3_wp], &
         freedom(n) = [1.0_wp, 2.0_wp, 3.0_wp, 1.0_wp, 1.0_wp, 3.0_wp, 1.0_wp, 1.0_wp, 2.0_wp, &
         100.0_wp, 10.0_wp, 100.0_wp, 20.0_wp, 20.0_wp, 20.0_wp], &
         tail(n) = [0.05_wp, 0.05_wp, 0.05_wp, 0.01_wp, 0.9999992021154392_wp, &
         0.99999999973403856_wp, 2.0884875837625448e-45_wp, 2.1010145162642175e-306_wp, &
         9.8596765437597709e-305_wp, 0.48119168452795672_wp, 0.050109061411462463_wp, &
         9.0393204235400909e-4_wp, 0.050005239202315169_wp, 0.99999999999979058_wp, 1.0_wp]
      integer :: k

      do k = 1, n
         call check_close('chi-square, '//to_text(freedom(k))//', beyond '//to_text(x(k)), &
            chi_square_tail(x(k), freedom(k)), tail(k), gamma_error(freedom(k)/2, x(k)/2) &
            *merge(1.0_wp, tail(k), x(k) < freedom(k) + 2))
      end do
      call check_close('chi-square, below 0', chi_square_tail(-1.0_wp, 3.0_wp), 1.0_wp, 0.0_wp)
      ! The three points that reference tables print with four digits: half a unit of the last one
      ! times the density, .03 to .1.
      call check_close('chi-square, 1, printed point', chi_square_tail(3.841_wp, 1.0_wp), &
         0.05_wp, 5e-5_wp)
      call check_close('chi-square, 2, printed point', chi_square_tail(5.991_wp, 2.0_wp), &
         0.05_wp, 5e-5_wp)
      call check_close('chi-square, 3, printed point', chi_square_tail(7.815_wp, 3.0_wp), &
         0.05_wp, 5e-5_wp)
   end subroutine test_chi_square

   !> Probabilities never fall, tails never rise, across the switch from series to fraction as
   !> well; a step back by round-off is allowed.
   subroutine test_monotonic()
      real(wp), parameter :: freedom(4) = [1.0_wp, 4.0_wp, 45.0_wp, 300.0_wp]
      real(wp) :: p, q, before_p, before_q, back
      integer :: i, k

      back = 0
      do i = 1, size(freedom)
         before_p = 0
         before_q = 1
         do k = 1, 2000
            p = student_probability(0.005_wp*k, freedom(i))
            q = chi_square_tail(2*freedom(i)*k/2000, freedom(i))
            back = max(back, (before_p - p)/(freedom(i)*eps), (q - before_q)/(freedom(i)*eps))
            before_p = p
            before_q = q
         end do
         call check('freedom '//to_text(freedom(i))//': probabilities within 0 .. 1', &
            p <= 1 .and. p > 0.9_wp .and. q >= 0 .and. q < 0.2_wp)
      end do
      ! 4 eps log_gamma(150) in relation to freedom eps: some ten.
      call check_close('monotonic, worst step back in units of freedom eps', back, 0.0_wp, 20.0_wp)
   end subroutine test_monotonic

   !> Far arguments: the limit, and neither NaN nor a search without end.
   subroutine test_extremes()
      real(wp) :: value

      call check_close('Q(1/2, 800) underflows', incomplete_gamma(0.5_wp, 800.0_wp), 0.0_wp, &
         tiny(1.0_wp))
      call check_close('Q(1/2, 1e300)', incomplete_gamma(0.5_wp, 1e300_wp), 0.0_wp, 0.0_wp)
      ! log_gamma(1e-6) = 14 is known to a unit in the last place, and so is the power of e; the
      ! same twice, for the two ways to round.
      call check_close('Q(1e-6, 1e-300)', incomplete_gamma(1e-6_wp, 1e-300_wp), &
         1 - exp(1e-6_wp*log(1e-300_wp))/gamma(1 + 1e-6_wp), 2*(14 + 1)*eps)
      ! Q(a, a) -> 1/2 - 1/(3 sqrt(2 pi a)); log_gamma(1e8) = 2e9 leaves 4e-7.
      call check_close('Q(1e8, 1e8)', incomplete_gamma(1e8_wp, 1e8_wp), &
         0.5_wp - 1/(3*sqrt(2*pi*1e8_wp)), 4e-7_wp)
      call check_close('chi-square beyond 1e308', chi_square_tail(1e308_wp, 20.0_wp), 0.0_wp, &
         0.0_wp)
      call check_close('I_x(a, b) at x = 1e-300', incomplete_beta(2.0_wp, 2.0_wp, 1e-300_wp), &
         0.0_wp, tiny(1.0_wp))
      call check_close('I_x(a, b) next to 1', incomplete_beta(2.0_wp, 2.0_wp, 1 - eps), 1.0_wp, eps)
      ! The median of a symmetric distribution; log_gamma(2e7) = 3e8.
      call check_close('I_1/2(1e7, 1e7)', incomplete_beta(1e7_wp, 1e7_wp, 0.5_wp), 0.5_wp, 1e-6_wp)
      call check_close('Student, t = 1e200', student_probability(1e200_wp, 3.0_wp), 1.0_wp, 0.0_wp)
      call check_close('Student, t = 1e-200', student_probability(1e-200_wp, 3.0_wp), 0.0_wp, eps)
      ! P(|T| > t) of Cauchy is 2/(pi t) - ...: t = 2/(pi 1e-12), of which eps/1e-12 is not known.
      value = student_quantile(1 - 1e-12_wp, 1.0_wp)
      call check_close('Student, p = 1 - 1e-12, freedom 1', value*pi/2*1e-12_wp, 1.0_wp, 5e-4_wp)
      call check_close('Student, p = 1e-12, freedom 1', student_quantile(1e-12_wp, 1.0_wp), &
         pi/2*1e-12_wp, 10*eps)
      value = student_quantile(1 - eps, 0.1_wp)
      call check('Student, p = 1 - eps, freedom 1/10: finite or the largest there is', &
         ieee_is_finite(value) .and. value > 1e100_wp, to_text(value))
      ! Normal: one million and one hundred million degrees of freedom are the same to 1e-6.
      call check_close('Student, 95 %, freedom 1e8', student_quantile(0.95_wp, 1e8_wp), &
         1.959963984540054_wp, 3e-6_wp)
   end subroutine test_extremes

   !> scipy.stats.norm.ppf(p), and norm.cdf at the same places. The rounding of p alone moves x by
   !> eps p/density, of 1 - p as much as of p; a few eps of x, or of 1 where x is near 0, beside it.
   !> The probability at a rounded x is known to x**2 eps of itself.
   subroutine test_normal()
      integer, parameter :: n = 20
      real(wp), parameter :: p(n) = [1e-300_wp, 1e-200_wp, 1e-100_wp, 1e-20_wp, 1e-16_wp, &
         1e-10_wp, 1e-5_wp, 0.02425_wp, 0.025_wp, 0.1_wp, 0.3_wp, 0.499999999_wp, 0.5_wp, 0.7_wp, &
         0.9_wp, 0.975_wp, 0.99999_wp, 0.9999999999_wp, 0.9999999999999_wp, 1 - eps/2]
      real(wp), parameter :: x(n) = [-37.0470962993612_wp, -30.20559417957964_wp, &
         -21.273453560965322_wp, -9.262340089798409_wp, -8.222082216130435_wp, &
         -6.361340902404056_wp, -4.264890793922825_wp, -1.972961051311885_wp, &
         -1.9599639845400545_wp, -1.2815515655446004_wp, -0.5244005127080409_wp, &
         -2.5066283428845328e-09_wp, 0.0_wp, 0.5244005127080407_wp, 1.2815515655446004_wp, &
         1.959963984540054_wp, 4.264890793923841_wp, 6.361340889697422_wp, &
         7.3487545403000425_wp, 8.209536151601387_wp]
      real(wp) :: density, found(n)
      integer :: k

      found = normal_quantile(p)
      do k = 1, n
         density = exp(-x(k)**2/2)/sqrt(2*pi)
         call check_close('normal quantile, p = '//to_text(p(k)), found(k), x(k), 4*eps &
            *max(1.0_wp, abs(x(k))) + eps*p(k)/density)
         call check_close('normal probability, x = '//to_text(x(k)), normal_probability(x(k)) &
            /p(k), 1.0_wp, 4*eps*(1 + x(k)**2))
      end do
      call check('normal quantiles ascend', all(found(2:) > found(:n - 1)))
      ! 1e-310 itself is known to 1e-14, and the probability at x to as much.
      call check_close('normal quantile, p = 1e-310', normal_quantile(1e-310_wp), &
         -37.663060331949524_wp, 1e-11_wp)
      call check_close('normal probability, far out', normal_probability(-40.0_wp), 0.0_wp, 0.0_wp)
      call check_close('normal probability, far out above', normal_probability(40.0_wp), 1.0_wp, &
         0.0_wp)
   end subroutine test_normal

   !> There and back again, on a fine grid of -37 .. 8; the error of p as above, that of x is eps
   !> p/density more where p is near 1.
   subroutine test_normal_round_trip()
      integer, parameter :: n = 4501
      real(wp) :: x, p, density, worst
      integer :: k

      worst = 0
      do k = 1, n
         x = -37 + (k - 1)*0.01_wp
         p = normal_probability(x)
         density = exp(-x**2/2)/sqrt(2*pi)
         worst = max(worst, abs(normal_quantile(p) - x)/(eps*max(1.0_wp, abs(x)) + eps*p/density &
            *(1 + x**2*min(1.0_wp, (1 - p)/p))))
      end do
      call check('normal quantile of a probability: back again', worst < 8, to_text(worst))
   end subroutine test_normal_round_trip

end program test_distributions
