!> Sums of phasors against their definition.
program test_fourier
   use beamid_fourier, only: fast_fourier_transform, phasor_sums
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check_close, finish
   use random_numbers, only: start_random, uniform
   implicit none

   real(wp), parameter :: pi = acos(-1.0_wp)
   integer, parameter :: sizes(*) = [1, 2, 3, 40, 47, 48, 49, 700, 4096]
   integer :: k

   call start_random(5)
   do k = 0, 10
      call test_transform(2**k)
   end do
   do k = 1, size(sizes)
      call test_sums(1, sizes(k), 0.5_wp)
      call test_sums(300, sizes(k), 0.5_wp)
      call test_sums(300, sizes(k), 0.99_wp)
   end do
   call test_sums(3000, 64, 1e-3_wp)
   call finish('fourier')

contains

   !> n values: round-off grows with the logarithm of n, and stays below 1e-14 of the sum of |z|.
   subroutine test_transform(n)
      integer, intent(in) :: n
      complex(wp) :: z(0:n - 1), exact(0:n - 1)
      integer :: i, j

      z = [(cmplx(uniform() - 0.5_wp, uniform() - 0.5_wp, wp), i=1, n)]
      do i = 0, n - 1
         ! The phase is reduced in integers, because cos and sin of large numbers lose digits.
         exact(i) = sum([(z(j)*exp(cmplx(0.0_wp, -2*pi*modulo(j*i, n)/n, wp)), j=0, n - 1)])
      end do
      associate (size_of_z => sum(abs(z)))
         call fast_fourier_transform(z)
         call check_close('transform of '//to_text(n), maxval(abs(z - exact))/size_of_z, 0.0_wp, &
            1e-14_wp)
      end associate
   end subroutine test_transform

   !> m random times over a span of `turns`/step, some of them equal, and n frequencies. A value is
   !> spread over 12 points on either side; what is cut off is exp(-9 pi) of it, and the outermost
   !> frequencies are amplified by exp(pi): an error of exp(-8 pi) = 1.2e-11 on either side.
   subroutine test_sums(m, n, turns)
      integer, intent(in) :: m, n
      real(wp), intent(in) :: turns
      real(wp) :: t(m), c(m), first, step
      complex(wp) :: exact(n)
      integer :: i

      step = 0.7_wp
      first = 3.1_wp
      t = [(5 + turns/step*uniform(), i=1, m)]
      t(m/2 + 1) = t(1)
      c = [(uniform() - 0.5_wp, i=1, m)]
      do i = 1, n
         exact(i) = sum(c*exp(cmplx(0.0_wp, -2*pi*(first + (i - 1)*step)*(t - t(1)), wp)))
      end do
      call check_close(to_text(m)//' times, '//to_text(n)//' frequencies, '//to_text(turns)// &
         ' turns', maxval(abs(phasor_sums(t, c, first, step, n) - exact))/sum(abs(c)), 0.0_wp, &
         2.5e-11_wp)
   end subroutine test_sums

end program test_fourier
