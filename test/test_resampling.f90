!> Bootstrap intervals, lengths of blocks, and autoregressive noise: against numpy, scipy and arch
!> on numbers that all make alike, and against what theory promises.
program test_resampling
   use beamid_autoregression, only: autoregression_t, new_autoregression
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_resampling, only: acceleration, block_places, corrected_interval, &
      percentile_interval, usual_block
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   use lehmer_sequences, only: ar, gauss, uniform
   implicit none

   call test_intervals()
   call test_interval_corners()
   call test_usual_block()
   call test_block_places()
   call test_yule_walker()
   call test_likelihood()
   call test_innovations()
   call test_gaps()
   call test_white()
   call finish('resampling')

contains

   !> x = np.exp(gauss(40, 21)); idx = (uniform(40000, 22)*40).astype(int).reshape(1000, 40);
   !> est = x[idx].mean(1); np.percentile(est, [2.5, 97.5]);
   !> jack = [np.delete(x, i).mean() for i in range(40)]; U = 39*(np.mean(jack) - jack);
   !> a = (U**3).sum()/(6*(U**2).sum()**1.5); z0 = ndtri(((est < x.mean()).sum() + (est <=
   !> x.mean()).sum())/2000); z = z0 + ndtri([.025, .975]);
   !> np.percentile(est, 100*ndtr(z0 + z/(1 - a*z))). scipy.stats._resampling._bca_interval has the
   !> same a and the same levels, .043219500511906296 and .9881856358240368, for these.
   !> 1e-12: means of 40 numbers, and interpolation between neighbours.
   subroutine test_intervals()
      integer, parameter :: n = 40, resamples = 1000
      real(wp) :: x(n), u(n*resamples), estimates(resamples), others(n), a
      integer :: i, places(n)

      x = exp(gauss(n, 21))
      u = uniform(n*resamples, 22)
      do i = 1, resamples
         places = 1 + int(u((i - 1)*n + 1:i*n)*n)
         estimates(i) = sum(x(places))/n
      end do
      others = (sum(x) - x)/(n - 1)
      a = acceleration((n - 1)*(sum(others)/n - others))
      call check_close('acceleration', a, 0.05354222222752625_wp, 1e-12_wp)
      call check_ends('percentile', percentile_interval(estimates), [1.317850432245429_wp, &
         2.4764425173554767_wp])
      call check_ends('BCa', corrected_interval(estimates, sum(x)/n, a), [1.3533949015712052_wp, &
         2.581584372896539_wp])
      ! The mean of estimates is no matter; their order is none, and neither is their scale.
      call check_ends('BCa, mirrored', -corrected_interval(-estimates, -sum(x)/n, -a), &
         [2.581584372896539_wp, 1.3533949015712052_wp])
   end subroutine test_intervals

   subroutine check_ends(name, ends, reference)
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: ends(2), reference(2)

      call check_close(name//': one end', ends(1), reference(1), 1e-12_wp)
      call check_close(name//': the other', ends(2), reference(2), 1e-12_wp)
   end subroutine check_ends

   !> No bias and no acceleration: BCa is the percentile interval. An estimate beyond all others:
   !> its bias is held at that of half of one, and the interval stays among the estimates.
   subroutine test_interval_corners()
      real(wp) :: estimates(999), ends(2)
      integer :: k

      estimates = [(k, k=1, 999)]
      call check_ends('evenly spaced: percentile', percentile_interval(estimates), &
         [1 + 998*0.025_wp, 1 + 998*0.975_wp])
      ends = corrected_interval(estimates, 500.0_wp, 0.0_wp)
      ! The quantile of the normal law and back again: 1e-15 of 999.
      call check_close('no bias, no acceleration: below', ends(1), 25.95_wp, 1e-10_wp)
      call check_close('no bias, no acceleration: above', ends(2), 974.05_wp, 1e-10_wp)
      do k = -1, 1, 2
         ends = corrected_interval(estimates, 500 + k*1000.0_wp, 0.166_wp)
         call check('estimate beyond all: ends among them', ends(1) >= 1 .and. &
            ends(2) <= 999 .and. ends(1) <= ends(2), to_text(ends(1))//' to '//to_text(ends(2)))
      end do
      ends = corrected_interval(spread(2.0_wp, 1, 50), 2.0_wp, 0.0_wp)
      call check_ends('all estimates alike', ends, [2.0_wp, 2.0_wp])
      call check_close('acceleration of nothing', acceleration([0.0_wp, 0.0_wp]), 0.0_wp, 0.0_wp)
      call check_close('acceleration of symmetry', acceleration([-1.0_wp, 1.0_wp]), 0.0_wp, 0.0_wp)
      ! (8 - 2)/(6*6**1.5)
      call check_close('acceleration by hand', acceleration([2.0_wp, -1.0_wp, -1.0_wp]), &
         6.0_wp**(-1.5_wp), 1e-15_wp)
   end subroutine test_interval_corners

   !> Politis and White's rule in numpy,
   !>    c = np.array([r[:m-k]@r[k:] for k in range(last + 1)])/(r@r)
   !>    h = next(k for k in range(last-4) if (abs(c[k+1:k+6]) < 2*np.sqrt(np.log10(m)/m)).all())
   !>    k = np.arange(1, 2*h + 1); w = np.minimum(1, 2*(1 - k/(2*h)))
   !>    g = 2*(w*k*c[1:2*h+1]).sum(); s = 1 + 2*(w*c[1:2*h+1]).sum()
   !>    (2*g**2/(4/3*s**2))**(1/3)*m**(1/3),
   !> rounded: 1 where h is 0, 7.45, 31.46, 9.01, 12.09.
   !> arch.bootstrap.optimal_block_length(r)['circular'] has .38, 8.32, 28.08, 8.70,
   !> 10.51: it takes off the mean, counts the lag h + 1 as h, and
   !> divides by the norms of what overlaps; and rules of thumb differ by as much.
   subroutine test_usual_block()
      integer, parameter :: m(5) = [400, 400, 1000, 400, 60], seed(5) = [31, 32, 33, 34, 35], &
         expected(5) = [1, 7, 31, 9, 12]
      real(wp), parameter :: phi(5) = [0.0_wp, 0.5_wp, 0.9_wp, -0.5_wp, 0.95_wp], &
         arch(5) = [0.38_wp, 8.32_wp, 28.08_wp, 8.70_wp, 10.51_wp]
      integer :: k, length

      do k = 1, size(m)
         length = usual_block(ar(m(k), phi(k), seed(k)))
         call check('block of AR(1) '//to_text(phi(k)), length == expected(k), to_text(length))
         ! Half a sample of rounding, and a fifth for what is said above.
         call check_close('block of AR(1) '//to_text(phi(k))//', as arch has it', &
            real(length, wp), arch(k), 0.7_wp + 0.2_wp*arch(k))
      end do
      call check('block of nothing', usual_block(spread(0.0_wp, 1, 100)) == 1)
      call check('block of seven samples', usual_block(gauss(7, 1)) == 1)
      do k = 8, 30
         length = usual_block(ar(k, 0.99_wp, k))
         if (length < 1 .or. length > k/3) exit
      end do
      call check('blocks of few samples: no longer than a third', k > 30, to_text(k))
      ! A drift without end: no lag is quiet. 3 sqrt(900) at the most.
      length = usual_block([(real(k, wp), k=1, 900)])
      call check('block of a drift', length >= 1 .and. length <= 90, to_text(length))
   end subroutine test_usual_block

   !> Blocks hold one behind the other, lie inside, and begin anywhere with the same probability.
   subroutine test_block_places()
      integer, parameter :: m = 103, length = 10, draws = 2000
      integer :: places(m), i, k, starts(m - length + 1)
      logical :: whole, inside

      starts = 0
      whole = .true.
      inside = .true.
      do i = 1, draws
         places = block_places(m, length, i)
         inside = inside .and. minval(places) >= 1 .and. maxval(places) <= m
         do k = 1, m, length
            starts(places(k)) = starts(places(k)) + 1
            whole = whole .and. all(places(k + 1:min(k + length - 1, m)) == &
               places(k:min(k + length - 1, m) - 1) + 1)
         end do
      end do
      call check('blocks: whole', whole)
      call check('blocks: inside', inside)
      ! 22000 blocks in 94 places, 234 each with a deviation of 15.2: the largest of 94 lies
      ! beyond four of these once in 170 times; five.
      call check('blocks: begin anywhere', all(abs(starts - 234) < 76), to_text(minval(starts))// &
         ' to '//to_text(maxval(starts)))
      call check('blocks: same seed, same places', all(block_places(m, length, 5) == &
         block_places(m, length, 5)) .and. any(block_places(m, length, 5) /= &
         block_places(m, length, 6)))
      call check('one block of all', all(block_places(7, 7, 3) == [1, 2, 3, 4, 5, 6, 7]))
      places = block_places(m, 1, 3)
      call check('blocks of one: single places', minval(places) >= 1 .and. &
         maxval(places) <= m .and. any(places(2:) /= places(:m - 1) + 1))
   end subroutine test_block_places

   !> r_k = 1.2 r_(k-1) - .6 r_(k-2) + e_k, e = gauss(m, seed), from rest.
   function second_order(m, seed) result(r)
      integer, intent(in) :: m, seed
      real(wp) :: r(m)
      integer :: k

      r = gauss(m, seed)
      r(2) = r(2) + 1.2_wp*r(1)
      do k = 3, m
         r(k) = r(k) + 1.2_wp*r(k - 1) - 0.6_wp*r(k - 2)
      end do
   end function second_order

   !> r = second_order(500, 41); g = np.array([r[:500-k]@r[k:] for k in range(21)])/500;
   !> np.linalg.solve(toeplitz(g[:p]), g[1:p+1]); AICc m ln v + 2 (p + 1) m/(m - p - 2) is least
   !> at p = 2 of 0 .. 20. The condition of the matrix is some 20: 1e-13.
   subroutine test_yule_walker()
      type(autoregression_t) :: noise
      real(wp) :: t(500)
      integer :: k

      t = [(0.01_wp*k, k=1, 500)]
      noise = new_autoregression(second_order(500, 41), t, white=.false.)
      call check('AR(2): order', noise%order == 2, to_text(noise%order))
      if (noise%order /= 2) return
      call check_close('AR(2): a_1', noise%predictor(1, 2), 1.1657074811498034_wp, 1e-13_wp)
      call check_close('AR(2): a_2', noise%predictor(2, 2), -0.5631209272268068_wp, 1e-13_wp)
      ! The first value is predicted by none, and its variance is g[0]; the second by one.
      associate (r => second_order(500, 41))
         call check_close('AR(2): a_1 of order 1', noise%predictor(1, 1), dot_product(r(2:), &
            r(:499))/sum(r**2), 1e-14_wp)
         call check_close('AR(2): gain of order 0', noise%gain(0)**2, 1.1401293330968318_wp &
            /(sum(r**2)/500), 1e-13_wp)
      end associate
      call check_close('AR(2): gain of order 2', noise%gain(2), 1.0_wp, 1e-15_wp)
   end subroutine test_yule_walker

   !> The Gaussian density by the covariance of the process, Toeplitz, and its Cholesky factor:
   !> -(r' C**-1 r + ln det C)/2 is that of whitened values, -sum w**2/(2 v) - m ln(v)/2 + sum ln
   !> gain. 1e-10 of some 100: the condition of C is below 1e3.
   subroutine test_likelihood()
      integer, parameter :: m = 60
      type(autoregression_t) :: noise
      real(wp) :: r(m), t(m), c(0:m - 1), L(m, m), w(m), y(m), v, exact, whitened
      integer :: i, k

      t = [(k, k=1, m)]
      r = second_order(m, 42)
      noise = new_autoregression(r, t, white=.false.)
      call check('likelihood: there is some memory', noise%order >= 2, to_text(noise%order))
      associate (p => noise%order)
         ! Autocovariances: as estimated up to the order, and by recursion beyond.
         do k = 0, p
            c(k) = dot_product(r(:m - k), r(k + 1:))/m
         end do
         do k = p + 1, m - 1
            c(k) = dot_product(noise%predictor(:, p), c(k - 1:k - p:-1))
         end do
         v = c(0) - dot_product(noise%predictor(:, p), c(1:p))
         L = 0
         do k = 1, m
            L(k, k) = sqrt(c(0) - sum(L(k, :k - 1)**2))
            do i = k + 1, m
               L(i, k) = (c(i - k) - dot_product(L(i, :k - 1), L(k, :k - 1)))/L(k, k)
            end do
            y(k) = (r(k) - dot_product(L(k, :k - 1), y(:k - 1)))/L(k, k)
         end do
         exact = -sum(y**2)/2 - sum([(log(L(k, k)), k=1, m)])
         w = r
         call noise%whiten(w)
         whitened = -sum(w**2)/(2*v) - m*log(v)/2 + sum(log(noise%gain(min(p, noise%before))))
      end associate
      call check_close('likelihood: exact, by whitened values', whitened, exact, 1e-10_wp)
   end subroutine test_likelihood

   !> Long noise of order 2 from normal numbers of variance 1: what is left is these.
   subroutine test_innovations()
      integer, parameter :: m = 4000
      type(autoregression_t) :: noise
      real(wp) :: r(m), e(m), w(m), t(m), correlation
      integer :: k

      t = [(k, k=1, m)]
      e = gauss(m, 43)
      r = second_order(m, 43)
      noise = new_autoregression(r, t, white=.false.)
      w = r
      call noise%whiten(w)
      ! The estimate of a variance: a deviation of sqrt(2/m) = .022; that of the numbers themselves
      ! is known, and left is what two coefficients take off, 2/m, and the prediction from rest.
      call check_close('innovations: variance', sum(w**2)/sum(e**2), 1.0_wp, 8.0_wp/m)
      ! Coefficients are known to 1/sqrt(m) = .016 each, of values of deviation 1.9: four times
      ! that.
      call check_close('innovations: themselves', sqrt(sum((w(3:) - e(3:))**2)/m), 0.0_wp, &
         4*0.016_wp*1.9_wp)
      do k = 1, 10
         correlation = dot_product(w(:m - k), w(k + 1:))/sum(w**2)
         ! Four deviations of 1/sqrt(m).
         call check_close('innovations: autocorrelation at lag '//to_text(k), correlation, 0.0_wp, &
            4/sqrt(real(m, wp)))
      end do
   end subroutine test_innovations

   !> Behind a gap nothing is known of what was before it.
   subroutine test_gaps()
      integer, parameter :: m = 400, gap = 251
      type(autoregression_t) :: noise
      real(wp) :: r(m), t(m), w(m), alone(m - gap + 1)
      integer :: k

      t = [(k*0.5_wp, k=1, m)]
      t(gap:) = t(gap:) + 0.3_wp
      r = second_order(m, 44)
      noise = new_autoregression(r, t, white=.false.)
      ! 1.6 of the usual step is a gap; rows before the second stretch are those of the first.
      call check('gap: found', noise%before(gap) == 0 .and. noise%before(gap - 1) == gap - 2 .and. &
         noise%before(m) == m - gap)
      w = r
      call noise%whiten(w)
      alone = r(gap:)
      call noise%whiten(alone)
      call check('gap: whitened as a record of its own', all(abs(w(gap:) - alone) <= 0))
      call check_close('gap: the first behind it', w(gap), noise%gain(0)*r(gap), 0.0_wp)
      call check_close('gap: the second behind it', w(gap + 1), noise%gain(1)*(r(gap + 1) &
         - noise%predictor(1, 1)*r(gap)), 1e-15_wp)
      ! 1.4 of the step is none, and neither is what a file rounds.
      t = [(k*0.5_wp, k=1, m)]
      t(gap:) = t(gap:) + 0.2_wp
      noise = new_autoregression(r, t, white=.false.)
      call check('no gap', noise%before(m) == m - 1)
      ! Each value behind a gap of its own: no lag is known, and no memory found.
      t(:3) = [0.0_wp, 1.0_wp, 2.0_wp]
      do k = 4, m
         t(k) = t(k - 1) + merge(1.0_wp, 5.0_wp, modulo(k, 2) == 0)
      end do
      noise = new_autoregression(r, t, white=.false.)
      call check('pairs: one value before at the most', maxval(noise%before(5:)) == 1 .and. &
         all(abs(noise%gain) <= 1))
   end subroutine test_gaps

   !> Order 0 leaves all as it is; so little that nothing can be estimated.
   subroutine test_white()
      type(autoregression_t) :: noise
      real(wp) :: r(200), w(200), t(200)
      integer :: k, m, zero

      t = [(k, k=1, 200)]
      r = ar(200, 0.9_wp, 45)
      noise = new_autoregression(r, t, white=.true.)
      w = r
      call noise%whiten(w)
      call check('white by decree: unchanged', noise%order == 0 .and. all(abs(w - r) <= 0))
      ! AICc takes white noise for coloured in some 20 to 30 of 100 records, as AIC does (Shibata,
      ! Biometrika 63, 1976, 117: order 0 with probability .71); a deviation of 4.5, four of these.
      zero = 0
      do k = 1, 100
         noise = new_autoregression(gaussian_noise(200, 1.0_wp, k), t, white=.false.)
         if (noise%order == 0) zero = zero + 1
      end do
      call check_close('white noise: order 0 in 100 records', real(zero, wp), 71.0_wp, 18.0_wp)
      do m = 1, 12
         noise = new_autoregression(r(:m), t(:m), white=.false.)
         w = r
         call noise%whiten(w(:m))
         if (.not. all(abs(w(:m)) < 1e3_wp) .or. noise%order > m/4) exit
      end do
      call check('few values: finite', m > 12, to_text(m))
   end subroutine test_white

end program test_resampling
