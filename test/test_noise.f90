!> Synthetic noise: the generator's own numbers, reproducible, and Gaussian.
program test_noise
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_kinds, only: wp
   use beamid_noise, only: gaussian_noise
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   implicit none

   call test_first_values()
   call test_reproducible()
   call test_sizes()
   call test_moments()
   call test_distribution()
   call test_serial()
   call test_seeds()
   call finish('noise')

contains

   !> The generator written anew in whole numbers (Python, 30 digits for the logarithm and the
   !> cosine), that in turn checked against the first published number of MRG32k3a,
   !> .127011122046577. sqrt, log and cos of another library may differ by a unit of the last
   !> place: 1e-14.
   subroutine test_first_values()
      integer, parameter :: seeds(5) = [1, 2, 42, -7, 2147483647]
      real(wp), parameter :: reference(6, 5) = reshape([ &
         -1.199754381475216_wp, -0.8869629067764541_wp, 0.39838787259762587_wp, &
         0.9652960935064149_wp, -1.311897444654584_wp, -1.6333803029339176_wp, &
         0.3645788135234182_wp, 1.075200981958207_wp, -0.4635431867804789_wp, &
         -0.2778764749613418_wp, 0.5167327823318073_wp, 0.17938899195551541_wp, &
         0.7813680992730292_wp, -0.6716480851957599_wp, 0.9815080397582562_wp, &
         -0.3183515397614736_wp, -1.1984711294818127_wp, -0.7260393719055778_wp, &
         0.5412524419665354_wp, 2.249020748091395_wp, 1.2755206588257606_wp, &
         -2.687278428087261_wp, 0.491814618397805_wp, 1.2151223037343515_wp, &
         0.8625078572436564_wp, -0.3338687568174465_wp, 0.25200821743420865_wp, &
         0.9609889429242867_wp, 0.6694224985681337_wp, -0.3103091356663017_wp], [6, 5])
      real(wp) :: noise(6)
      integer :: k, i

      do k = 1, size(seeds)
         noise = gaussian_noise(6, 1.0_wp, seeds(k))
         do i = 1, 6
            call check_close('seed '//to_text(seeds(k))//', value '//to_text(i), noise(i), &
               reference(i, k), 1e-14_wp)
         end do
      end do
      ! sd is a factor: one rounding.
      call check_close('standard deviation .25 is a factor', maxval(abs(gaussian_noise(6, &
         0.25_wp, 42) - reference(:, 3)/4)), 0.0_wp, 1e-14_wp)
   end subroutine test_first_values

   subroutine test_reproducible()
      real(wp) :: a(501), b(501)

      a = gaussian_noise(501, 1.0_wp, 5)
      b = gaussian_noise(501, 1.0_wp, 5)
      call check_close('the same seed, the same noise', maxval(abs(a - b)), 0.0_wp, 0.0_wp)
      b = gaussian_noise(501, 1.0_wp, 6)
      call check('another seed, other noise: no value alike', minval(abs(a - b)) > 0, &
         to_text(minval(abs(a - b))))
      call check_close('a longer record begins like a shorter one', maxval(abs( &
         gaussian_noise(11, 1.0_wp, 5) - a(:11))), 0.0_wp, 0.0_wp)
   end subroutine test_reproducible

   subroutine test_sizes()
      real(wp) :: one(1), two(2)

      call check('n = 0', size(gaussian_noise(0, 1.0_wp, 1)) == 0)
      one = gaussian_noise(1, 1.0_wp, 1)
      two = gaussian_noise(2, 1.0_wp, 1)
      call check_close('n = 1 is the first of n = 2', one(1), two(1), 0.0_wp)
      call check('sd = 0 is silence', all(abs(gaussian_noise(7, 0.0_wp, 3)) <= 0))
   end subroutine test_sizes

   !> Sampling errors with n values: mean 1/sqrt(n), standard deviation 1/sqrt(2 n), skewness
   !> sqrt(6/n), kurtosis sqrt(24/n). Four of each: once in 16000 for a single good generator; the
   !> seeds are fixed, so that the outcome is too.
   subroutine test_moments()
      integer, parameter :: n = 100001
      integer, parameter :: seeds(3) = [0, 7, -123456]
      real(wp) :: x(n), mean, sd
      integer :: k

      do k = 1, size(seeds)
         x = gaussian_noise(n, 1.0_wp, seeds(k))
         call check('seed '//to_text(seeds(k))//': finite', all(ieee_is_finite(x)))
         mean = sum(x)/n
         sd = sqrt(sum((x - mean)**2)/(n - 1))
         call check_close('seed '//to_text(seeds(k))//': mean', mean, 0.0_wp, 4/sqrt(real(n, wp)))
         call check_close('seed '//to_text(seeds(k))//': standard deviation', sd, 1.0_wp, &
            4/sqrt(2.0_wp*n))
         call check_close('seed '//to_text(seeds(k))//': skewness', sum(((x - mean)/sd)**3)/n, &
            0.0_wp, 4*sqrt(6.0_wp/n))
         call check_close('seed '//to_text(seeds(k))//': kurtosis', sum(((x - mean)/sd)**4)/n, &
            3.0_wp, 4*sqrt(24.0_wp/n))
         ! The largest of n normal values: P(|x| > 3.5) n = 46.5, and P(|x| > 6) n = 2e-4.
         call check('seed '//to_text(seeds(k))//': tails', maxval(abs(x)) > 3.5_wp .and. &
            maxval(abs(x)) < 6, to_text(maxval(abs(x))))
      end do
   end subroutine test_moments

   !> Sixteen intervals of equal probability: chi-square with 15 degrees of freedom, of which 37.7
   !> is the point that is exceeded once in a thousand times.
   subroutine test_distribution()
      integer, parameter :: n = 64000, cells = 16
      real(wp) :: x(n), expected, chi
      integer :: counts(cells), k, cell

      x = gaussian_noise(n, 1.0_wp, 11)
      counts = 0
      do k = 1, n
         cell = min(cells, 1 + int(cells*(1 + erf(x(k)/sqrt(2.0_wp)))/2))
         counts(cell) = counts(cell) + 1
      end do
      expected = real(n, wp)/cells
      chi = sum((counts - expected)**2)/expected
      call check_close('Gaussian: chi-square of 16 equal intervals', chi, 15.0_wp, 22.7_wp)
   end subroutine test_distribution

   !> Autocorrelation at lags 1 to 10, of the values and of their squares: 4/sqrt(n).
   subroutine test_serial()
      integer, parameter :: n = 50000
      real(wp) :: x(n), y(n)
      integer :: k

      x = gaussian_noise(n, 1.0_wp, 21)
      y = (x**2 - 1)/sqrt(2.0_wp)
      do k = 1, 10
         call check_close('lag '//to_text(k), dot_product(x(:n - k), x(k + 1:))/n, 0.0_wp, &
            4/sqrt(real(n, wp)))
      end do
      ! Box-Muller pairs share a radius: their squares must not show it.
      do k = 1, 2
         call check_close('squares, lag '//to_text(k), dot_product(y(:n - k), y(k + 1:))/n, &
            0.0_wp, 4/sqrt(real(n, wp)))
      end do
   end subroutine test_serial

   !> An ensemble takes its seeds one after another: the records of neighbouring seeds are
   !> unrelated, and so are the values that successive seeds have at one and the same place.
   subroutine test_seeds()
      integer, parameter :: n = 1000, ensemble = 1000, places = 50
      real(wp) :: x(n, 0:ensemble), across(places)
      integer :: k

      do k = 0, ensemble
         x(:, k) = gaussian_noise(n, 1.0_wp, k)
      end do
      ! The largest of 1000 normal values is below 5.3 standard deviations, once in ten thousand
      ! times excepted.
      call check_close('neighbouring seeds, worst correlation of their records', maxval([( &
         abs(dot_product(x(:, k), x(:, k - 1)))/n, k=1, ensemble)]), 0.0_wp, 5.3_wp/sqrt(real(n, &
         wp)))
      across = [(dot_product(x(k, 1:), x(k, :ensemble - 1))/ensemble, k=1, places)]
      ! 50 places: 4.6 standard deviations, of 1/sqrt(ensemble).
      call check_close('one place, successive seeds, worst correlation of 50', &
         maxval(abs(across)), 0.0_wp, 4.6_wp/sqrt(real(ensemble, wp)))
   end subroutine test_seeds

end program test_noise
