!> Draws from densities of which all is known: by weights and by chains, with bounds, skewed, with
!> two maxima, and where nothing can be computed; the same draws for any number of threads.
program test_sampling
   use beamid_chains, only: quantile
   use beamid_densities, only: coordinate_t, new_coordinate
   use beamid_distributions, only: normal_probability
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_sampling, only: draws_t, plan_t, sample
   use beamid_sorting, only: sort
   use beamid_strings, only: to_text
   use beamid_variables, only: new_variable, unbounded, variable_t
   use checks, only: check, check_close, finish
   use densities_with_answers, only: banana_t, flat_t, hole_t, normal_t, product_t, two_maxima_t
   use omp_lib, only: omp_get_max_threads, omp_set_num_threads
   implicit none

   !> Without and with importance sampling.
   character(len=*), parameter :: by(0:1) = ['by chains:  ', 'by weights: ']

   call test_coordinates()
   call test_normal()
   call test_narrow()
   call test_product()
   call test_long_chains()
   call test_half_normal()
   call test_between_bounds()
   call test_banana()
   call test_two_maxima()
   call test_holes()
   call test_threads()
   call finish('sampling')

contains

   !> There and back again, and slopes against central differences: a step of 1e-5 leaves 1e-10 of
   !> truncation and 1e-11 of round-off.
   subroutine test_coordinates()
      real(wp), parameter :: xs(7) = [-20.0_wp, -3.0_wp, -0.5_wp, 0.0_wp, 0.1_wp, 2.0_wp, 9.0_wp], &
         d = 1e-5_wp
      type(coordinate_t) :: c(4)
      real(wp) :: slope
      integer :: i, k

      c = new_coordinate([new_variable(1.0_wp, -unbounded, unbounded, 3.0_wp), &
         new_variable(1.0_wp, 0.5_wp, unbounded, 3.0_wp), new_variable(1.0_wp, -unbounded, 4.0_wp, &
         3.0_wp), new_variable(1.0_wp, -2.0_wp, 5.0_wp, 3.0_wp)])
      do k = 1, 4
         do i = 1, size(xs)
            associate (x => xs(i), name => 'coordinate '//to_text(k)//' at '//to_text(xs(i))//': ')
               slope = (c(k)%value(x + d) - c(k)%value(x - d))/(2*d)
               call check_close(name//'slope', c(k)%slope(x), slope, 1e-8_wp*(1 + abs(slope)))
               call check_close(name//'log slope', c(k)%log_slope(x), log(abs(c(k)%slope(x))), &
                  1e-13_wp*(1 + abs(x)))
               call check_close(name//'bend', c(k)%bend(x), (c(k)%log_slope(x + d) &
                  - c(k)%log_slope(x - d))/(2*d), 1e-8_wp)
               ! Beyond |x| = 10 a bound is nearer than 1e-6 of what is moderate.
               if (abs(x) < 10) call check_close(name//'back again', c(k)%of(c(k)%value(x)), x, &
                  1e-9_wp)
            end associate
         end do
      end do
      call check_close('at a lower bound: a little inside', c(2)%value(c(2)%of(0.5_wp)), &
         0.5_wp + 3e-6_wp, 1e-12_wp)
      call check_close('at an upper bound: a little inside', c(4)%value(c(4)%of(5.0_wp)), &
         5 - 3e-6_wp, 1e-10_wp)
      call check('far out: within the bounds', all(c%value(800.0_wp) >= c%lower .and. &
         c%value(800.0_wp) <= c%upper .and. c%value(-800.0_wp) >= c%lower .and. &
         c%value(-800.0_wp) <= c%upper))
   end subroutine test_coordinates

   type(plan_t) function planned(importance) result(plan)
      integer, intent(in) :: importance

      plan%importance = importance == 1
   end function planned

   subroutine moments(draws, mean, sd)
      type(draws_t), intent(in) :: draws
      real(wp), intent(out) :: mean(:), sd(:)
      integer :: k

      mean = sum(draws%q, dim=2)/size(draws%q, 2)
      do k = 1, size(mean)
         sd(k) = sqrt(sum((draws%q(k, :) - mean(k))**2)/(size(draws%q, 2) - 1))
      end do
   end subroutine moments

   !> Means 3, -1, .5 and deviations .3, 2, .05, correlations .8 and -.5 and 0; bounds 0 or none,
   !> none, 0 and 1: ten deviations away, so that they cut nothing off. Draws of deviation s, n of
   !> them effective, have a mean that is wrong by s/sqrt(n) and a deviation by s/sqrt(2 n): .01 and
   !> .7 % for 10000, which is asked for by weights; three and four of these. Chains are worth less,
   !> and tell how much.
   subroutine test_normal()
      real(wp), parameter :: mean(3) = [3.0_wp, -1.0_wp, 0.5_wp], sd(3) = [0.3_wp, 2.0_wp, &
         0.05_wp], r12 = 0.8_wp, r23 = -0.5_wp
      type(normal_t) :: density
      type(variable_t) :: variables(3)
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      real(wp) :: m(3), s(3), determinant, allowed
      integer :: i, importance, k

      determinant = 1 - r12**2 - r23**2
      density%mean = mean
      density%precision = reshape([1 - r23**2, -r12, r12*r23, -r12, 1.0_wp, -r23, r12*r23, -r23, &
         1 - r12**2], [3, 3])/determinant
      do i = 1, 3
         density%precision(:, i) = density%precision(:, i)/sd/sd(i)
      end do
      variables = [new_variable(3.0_wp, 0.0_wp, unbounded, 3.0_wp), &
         new_variable(1.0_wp, -unbounded, unbounded, 5.0_wp), &
         new_variable(0.4_wp, 0.0_wp, 1.0_wp, 1.0_wp)]
      do importance = 0, 1
         call sample(density, variables, [3.5_wp, 1.0_wp, 0.4_wp], planned(importance), draws, &
            error)
         call check('normal, '//by(importance)//'done', .not. allocated(error))
         if (allocated(error)) cycle
         call check('normal, '//by(importance)//'by what was asked for', draws%weighted .eqv. &
            importance == 1)
         call check('normal, '//by(importance)//'effective', draws%effective > merge(10000, 2000, &
            importance == 1), to_text(draws%effective)//', '//to_text(draws%evaluations)// &
            ' evaluations, k '//to_text(draws%k))
         allowed = 3/sqrt(min(draws%effective, 10000.0_wp))
         call moments(draws, m, s)
         do k = 1, 3
            call check_close('normal, '//by(importance)//'mean '//to_text(k), (m(k) - mean(k)) &
               /sd(k), 0.0_wp, allowed)
            call check_close('normal, '//by(importance)//'deviation '//to_text(k), s(k)/sd(k), &
               1.0_wp, allowed)
         end do
         call check_close('normal, '//by(importance)//'correlation of 1 and 2', &
            correlation(draws, 1, 2), r12, allowed)
         call check_close('normal, '//by(importance)//'correlation of 2 and 3', &
            correlation(draws, 2, 3), r23, allowed)
         call check_close('normal, '//by(importance)//'correlation of 1 and 3', &
            correlation(draws, 1, 3), 0.0_wp, allowed)
         call check('normal, '//by(importance)//'reduction', maxval(draws%reduction) < &
            1.01_wp .and. minval(draws%tail) > 1000, to_text(maxval(draws%reduction)))
         ! -2 log density is chi square with 3 degrees of freedom: its mean is 3, its deviation
         ! sqrt(6).
         call check_close('normal, '//by(importance)//'log density', -2*sum(draws%log_density) &
            /size(draws%log_density), 3.0_wp, sqrt(6.0_wp)*allowed)
      end do
   end subroutine test_normal

   !> Of the parameters i and j.
   real(wp) function correlation(draws, i, j)
      type(draws_t), intent(in) :: draws
      integer, intent(in) :: i, j
      real(wp) :: m(size(draws%q, 1)), s(size(draws%q, 1))

      call moments(draws, m, s)
      correlation = sum((draws%q(i, :) - m(i))*(draws%q(j, :) - m(j)))/(s(i)*s(j))/size(draws%q, 2)
   end function correlation

   !> A deviation of 1e-9 of what is moderate, started exactly at the mode.
   subroutine test_narrow()
      real(wp), parameter :: sd = 1e-9_wp
      type(normal_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      real(wp) :: m(1), s(1), allowed
      integer :: importance

      density%mean = [0.0_wp]
      density%precision = reshape([1/sd**2], [1, 1])
      do importance = 0, 1
         call sample(density, [new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)], [0.0_wp], &
            planned(importance), draws, error)
         call check('narrow, '//by(importance)//'done', .not. allocated(error))
         if (allocated(error)) cycle
         call moments(draws, m, s)
         ! As above; and chains of one parameter take large steps: 2000 at the least.
         allowed = 3/sqrt(min(draws%effective, 10000.0_wp))
         call check('narrow, '//by(importance)//'effective', draws%effective > 2000, &
            to_text(draws%effective))
         call check_close('narrow, '//by(importance)//'mean', m(1)/sd, 0.0_wp, allowed)
         call check_close('narrow, '//by(importance)//'deviation', s(1)/sd, 1.0_wp, allowed)
      end do
   end subroutine test_narrow

   !> A narrow ridge, straight in logarithms, between bounds that are 15 deviations away: the bounds
   !> must not bend it. Without them, 60 % of the draws would count.
   subroutine test_product()
      type(product_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      real(wp) :: m(2), s(2)

      call sample(density, [new_variable(1.0_wp, 0.0_wp, 1e3_wp, 1.0_wp), &
         new_variable(1.0_wp, 0.985_wp, 1.015_wp, 1.0_wp)], [1.0_wp, 1.0_wp], planned(1), draws, &
         error)
      call check('product: done', .not. allocated(error))
      if (allocated(error)) return
      call check('product: by weights', draws%weighted)
      call check('product: half of the draws count', draws%effective > 0.5_wp*draws%evaluations, &
         to_text(draws%effective)//' of '//to_text(draws%evaluations))
      draws%q(1, :) = log(draws%q(1, :)) - 4*log(draws%q(2, :))
      draws%q(2, :) = log(draws%q(2, :))
      call moments(draws, m, s)
      ! 10,000 draws: four errors of a mean, and five of a deviation, 1/sqrt(2 10,000) of it.
      call check('product: means', all(abs(m) < 0.04_wp*density%sd), to_text(maxval(abs(m) &
         /density%sd)))
      call check('product: deviations', all(abs(s/density%sd - 1) < 0.035_wp), to_text(maxval(abs( &
         s/density%sd - 1))))
   end subroutine test_product

   !> 400000 draws by chains: a second step that is taken too often or too seldom shows in how the
   !> distances from the mean are distributed, of which 95 % are within 1.96 deviations.
   subroutine test_long_chains()
      type(normal_t) :: density
      type(draws_t) :: draws
      type(plan_t) :: plan
      type(error_t), allocatable :: error
      real(wp) :: m(1), s(1), allowed

      density%mean = [0.0_wp]
      density%precision = reshape([1.0_wp], [1, 1])
      plan = plan_t(draws=400000, importance=.false.)
      call sample(density, [new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)], [0.0_wp], &
         plan, draws, error)
      call check('long chains: done', .not. allocated(error))
      if (allocated(error)) return
      call moments(draws, m, s)
      allowed = 4/sqrt(min(draws%effective, 400000.0_wp))
      call check_close('long chains: mean', m(1), 0.0_wp, allowed)
      call check_close('long chains: deviation', s(1), 1.0_wp, allowed/sqrt(2.0_wp))
      call check_close('long chains: within 1.96', count(abs(draws%q) < 1.959963984540054_wp) &
         /real(size(draws%q), wp), 0.95_wp, allowed*sqrt(0.05_wp*0.95_wp))
   end subroutine test_long_chains

   !> exp(-q**2/2), q > 0, or q < 0: mean sqrt(2/pi), deviation sqrt(1 - 2/pi), quantiles of the
   !> normal law.
   subroutine test_half_normal()
      real(wp), parameter :: pi = acos(-1.0_wp), p(3) = [0.025_wp, 0.5_wp, 0.975_wp]
      type(normal_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      type(variable_t) :: variables(-1:1)
      real(wp) :: m(1), s(1), allowed
      real(wp), allocatable :: sorted(:)
      character(len=:), allocatable :: label
      integer :: importance, k, sign

      density%mean = [0.0_wp]
      density%precision = reshape([1.0_wp], [1, 1])
      variables(-1) = new_variable(0.0_wp, -unbounded, 0.0_wp, 1.0_wp)
      variables(1) = new_variable(0.0_wp, 0.0_wp, unbounded, 1.0_wp)
      do importance = 0, 1
         do sign = -1, 1, 2
            ! The estimate of such a fit is the bound itself.
            call sample(density, variables(sign:sign), [0.0_wp], planned(importance), draws, error)
            label = 'half normal, '//merge('q < 0, ', 'q > 0, ', sign < 0)//by(importance)
            call check(label//'done', .not. allocated(error))
            if (allocated(error)) cycle
            draws%q = sign*draws%q
            call check(label//'inside', all(draws%q > 0))
            call moments(draws, m, s)
            allowed = 3/sqrt(min(draws%effective, 10000.0_wp))
            call check_close(label//'mean', m(1), sqrt(2/pi), allowed*sqrt(1 - 2/pi))
            ! The fourth moment is .87 more than that of the normal law: 1.2 times as uncertain,
            ! and a deviation is less so than a mean by sqrt(2).
            call check_close(label//'deviation', s(1), sqrt(1 - 2/pi), allowed*sqrt(1 - 2/pi))
            sorted = draws%q(1, :)
            call sort(sorted)
            do k = 1, 3
               ! The share below a quantile is wrong by sqrt(p (1 - p)/n).
               call check_close(label//'quantile '//to_text(p(k)), 2*normal_probability( &
                  quantile(sorted, p(k))) - 1, p(k), allowed*sqrt(p(k)*(1 - p(k))))
            end do
         end do
      end do
   end subroutine test_half_normal

   !> Nothing is known of one parameter but its bounds, and hardly more of the other: uniform in
   !> -2 .. 4, mean 1 and deviation sqrt(3); exp(-5 q) between 0 and 1, mean 1/5 - 1/(exp(5) - 1).
   subroutine test_between_bounds()
      type(flat_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      real(wp) :: m(2), s(2), allowed
      integer :: importance

      do importance = 0, 1
         call sample(density, [new_variable(0.0_wp, -2.0_wp, 4.0_wp, 1.0_wp), &
            new_variable(0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp)], [0.0_wp, 0.0_wp], planned(importance), &
            draws, error)
         call check('between bounds, '//by(importance)//'done', .not. allocated(error))
         if (allocated(error)) cycle
         call moments(draws, m, s)
         allowed = 3/sqrt(min(draws%effective, 10000.0_wp))
         call check('between bounds, '//by(importance)//'effective', draws%effective > 1000, &
            to_text(draws%effective)//', '//to_text(draws%evaluations)//' evaluations, k '// &
            to_text(draws%k))
         call check_close('between bounds, '//by(importance)//'mean of the flat one', m(1), &
            1.0_wp, allowed*sqrt(3.0_wp))
         call check_close('between bounds, '//by(importance)//'deviation of the flat one', s(1), &
            sqrt(3.0_wp), allowed*sqrt(3.0_wp))
         call check_close('between bounds, '//by(importance)//'mean of the other', m(2), &
            0.2_wp - 1/(exp(5.0_wp) - 1), allowed*0.2_wp)
      end do
   end subroutine test_between_bounds

   !> q2 follows 2 (q1**2 - 1): mean 0 and variance 8 + sd**2; q1 is standard normal. Below the
   !> median, 2 (.4549364231 - 1), lies one half of q2 but for its own deviation. Axes that are
   !> straight fit nowhere: with a deviation of .2 weights can still be trusted, with .11 they
   !> cannot, and chains take their place.
   subroutine test_banana()
      character(len=24), parameter :: labels(3) = ['banana, by chains:      ', &
         'banana, by weights:     ', 'banana, weights failed: ']
      logical, parameter :: weighted(3) = [.false., .true., .false.]
      real(wp), parameter :: sds(3) = [0.2_wp, 0.2_wp, 0.11_wp]
      type(banana_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      type(variable_t) :: variables(2)
      real(wp) :: m(2), s(2), allowed, sd
      integer :: i

      variables = new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)
      do i = 1, 3
         density%sd = sds(i)
         sd = sqrt(8 + sds(i)**2)
         call sample(density, variables, [0.5_wp, 1.0_wp], planned(merge(0, 1, i == 1)), draws, &
            error)
         call check(labels(i)//'done', .not. allocated(error))
         if (allocated(error)) cycle
         call check(labels(i)//'as expected', draws%weighted .eqv. weighted(i), to_text(draws%k))
         call check(labels(i)//'effective', draws%effective > 100, to_text(draws%effective)// &
            ' of '//to_text(draws%evaluations)//' evaluations')
         call moments(draws, m, s)
         ! Four deviations of what is told to be effective, which is itself an estimate.
         allowed = 4/sqrt(min(draws%effective, 10000.0_wp))
         call check_close(labels(i)//'mean of the first', m(1), 0.0_wp, allowed)
         call check_close(labels(i)//'deviation of the first', s(1), 1.0_wp, allowed)
         call check_close(labels(i)//'mean of the second', m(2), 0.0_wp, allowed*sd)
         ! The kurtosis of chi square with one degree of freedom is 15: sqrt(14)/2 times as
         ! uncertain as a mean.
         call check_close(labels(i)//'deviation of the second', s(2)/sd, 1.0_wp, allowed*1.9_wp)
         ! What q2's own deviation moves across the median, where q1 has a slope of 2.7 and a
         ! density of .32 on each side: nothing to first order, 1e-3 or so to second.
         call check_close(labels(i)//'below the median', count(draws%q(2, :) < 2*(0.4549364231_wp &
            - 1))/real(size(draws%q, 2), wp), 0.5_wp, allowed/2 + 2e-3_wp)
      end do
   end subroutine test_banana

   !> Two maxima, so far apart: an error, or both of them with their shares. What no draw comes near
   !> nothing can tell of: with two parameters a second one 12 deviations away is missed in silence.
   subroutine test_two_maxima()
      real(wp), parameter :: apart(4) = [3.0_wp, 6.0_wp, 8.0_wp, 12.0_wp]
      type(two_maxima_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      type(variable_t) :: variables(2)
      real(wp) :: second, allowed
      integer :: i, n
      character(len=:), allocatable :: label

      variables = new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)
      do i = 1, size(apart)
         do n = 1, 2
            if (n == 2 .and. apart(i) > 10) cycle
            density%apart = apart(i)
            call sample(density, variables(:n), spread(0.1_wp, 1, n), planned(1), draws, error)
            label = 'two maxima '//to_text(apart(i))//' apart, of '//to_text(n)//': '
            if (allocated(error)) then
               call check(label//'refused', index(error%message, 'several maxima') > 0, &
                  error%message)
               cycle
            end if
            second = count(draws%q(1, :) > apart(i)/2)/real(size(draws%q, 2), wp)
            allowed = 4/sqrt(min(draws%effective, 10000.0_wp))
            call check_close(label//'share of the second', second, 0.5_wp, allowed/2)
         end do
      end do
   end subroutine test_two_maxima

   !> Densities that cannot be computed somewhere.
   subroutine test_holes()
      type(hole_t) :: density
      type(draws_t) :: draws
      type(error_t), allocatable :: error
      type(variable_t) :: variables(1)
      real(wp) :: expected, sd, cut, allowed
      integer :: importance, nan

      variables = new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)
      do nan = 0, 1
         do importance = 0, 1
            density%says_nan = nan == 1
            density%hole = 0.3_wp
            density%radius = 0.01_wp
            call sample(density, variables, [0.3_wp], planned(importance), draws, error)
            call check('hole at the start, '//by(importance)//'refused', allocated(error))
            if (allocated(error)) call check('hole at the start, '//by(importance)//'in words', &
               index(error%message, 'cannot be computed') > 0, error%message)
            ! Nothing but the start itself can be computed.
            density%radius = -1e-9_wp
            call sample(density, variables, [0.3_wp], planned(importance), draws, error)
            call check('all but the start a hole, '//by(importance)//'refused', allocated(error))
            if (allocated(error)) call check('all but the start a hole, '//by(importance)// &
               'in words', index(error%message, 'cannot be computed') > 0, error%message)
            ! A hole among what is probable: what cannot be computed has no probability, from 1 to
            ! 2; the mean is minus what is cut out, phi(1) - phi(2), over what is left.
            density%hole = 1.5_wp
            density%radius = 0.5_wp
            call sample(density, variables, [0.3_wp], planned(importance), draws, error)
            call check('hole beside the mode, '//by(importance)//'done', .not. allocated(error))
            if (allocated(error)) cycle
            cut = normal_probability(2.0_wp) - normal_probability(1.0_wp)
            expected = -(exp(-0.5_wp) - exp(-2.0_wp))/sqrt(2*acos(-1.0_wp))/(1 - cut)
            sd = sqrt((1 - cut - (exp(-0.5_wp) - 2*exp(-2.0_wp))/sqrt(2*acos(-1.0_wp)))/(1 - cut) &
               - expected**2)
            allowed = 4/sqrt(min(draws%effective, 10000.0_wp))
            call check('hole beside the mode, '//by(importance)//'nothing of it', &
               .not. any(abs(draws%q - 1.5_wp) <= 0.5_wp))
            call check_close('hole beside the mode, '//by(importance)//'mean', &
               sum(draws%q)/size(draws%q), expected, allowed*sd)
         end do
      end do
   end subroutine test_holes

   !> Any number of threads, more than there are chains among them: the same to the last bit.
   subroutine test_threads()
      type(banana_t) :: density
      type(plan_t) :: plan
      integer, parameter :: threads(4) = [1, 2, 3, 7]
      type(draws_t) :: draws(4)
      type(error_t), allocatable :: error
      type(variable_t) :: variables(2)
      integer :: importance, k, usual

      variables = new_variable(1.0_wp, -unbounded, unbounded, 1.0_wp)
      density%sd = 2
      density%bend = 0.3_wp
      usual = omp_get_max_threads()
      do importance = 0, 1
         plan = planned(importance)
         plan%draws = 2000
         do k = 1, 4
            call omp_set_num_threads(threads(k))
            call sample(density, variables, [0.5_wp, 1.0_wp], plan, draws(k), error)
            if (allocated(error)) exit
         end do
         call check('threads, '//by(importance)//'done', .not. allocated(error))
         if (allocated(error)) cycle
         call check('threads, '//by(importance)//'as asked for', draws(1)%weighted .eqv. &
            importance == 1)
         do k = 2, 4
            call check('threads, '//by(importance)//'1 and '//to_text(threads(k)), &
               all(transfer(draws(k)%q, [0]) == transfer(draws(1)%q, [0])) .and. &
               all(transfer(draws(k)%log_density, [0]) == transfer(draws(1)%log_density, [0])) &
               .and. draws(k)%evaluations == draws(1)%evaluations)
         end do
         plan%seed = 2
         call sample(density, variables, [0.5_wp, 1.0_wp], plan, draws(2), error)
         call check('threads, '//by(importance)//'another seed, other draws', &
            .not. allocated(error) .and. any(abs(draws(2)%q - draws(1)%q) > 0))
      end do
      call omp_set_num_threads(usual)
   end subroutine test_threads

end program test_sampling
