!> Reproducible Gaussian noise, the same on every machine: L'Ecuyer's MRG32k3a (Operations Research
!> 47, 1999, 159), whose integers are exact in double precision, and the Box-Muller transform.
module beamid_noise
   use beamid_kinds, only: ip, wp
   implicit none
   private

   public :: gaussian_noise, uniform_noise

   real(wp), parameter :: m1 = 4294967087.0_wp, m2 = 4294944443.0_wp
   integer, parameter :: warm_up = 20

contains

   !> n independent values of mean 0 and standard deviation sd.
   !>
   !> seed  any integer; the same seed gives the same noise
   pure function gaussian_noise(n, sd, seed) result(noise)
      integer, intent(in) :: n, seed
      real(wp), intent(in) :: sd
      real(wp) :: noise(n)
      real(wp) :: state(6), u(2)
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
      integer :: k

      state = seeded(seed)
      do k = 1, n, 2
         call draw(state, u(1))
         call draw(state, u(2))
         noise(k) = sd*sqrt(-2*log(u(1)))*cos(two_pi*u(2))
         if (k < n) noise(k + 1) = sd*sqrt(-2*log(u(1)))*sin(two_pi*u(2))
      end do
   end function gaussian_noise

   !> n independent values, uniform in (0, 1).
   pure function uniform_noise(n, seed) result(noise)
      integer, intent(in) :: n, seed
      real(wp) :: noise(n)
      real(wp) :: state(6)
      integer :: k

      state = seeded(seed)
      do k = 1, n
         call draw(state, noise(k))
      end do
   end function uniform_noise

   !> Six numbers from the seed by squaring: the generator is linear, and would carry a linear
   !> relation between seeds over to their noise. No product reaches 2**53.
   pure function seeded(seed) result(state)
      integer, intent(in) :: seed
      real(wp) :: state(6), mixed, u
      integer :: k, round

      mixed = rest(real(seed, wp), m2)
      do k = 1, 6
         do round = 1, warm_up
            mixed = rest(mixed*rest(mixed + round, 2.0_wp**21) + 69069*k + 1, m2)
         end do
         state(k) = mixed
      end do
      do k = 1, warm_up
         call draw(state, u)
      end do
   end function seeded

   !> A uniform number in (0, 1).
   pure subroutine draw(state, u)
      real(wp), intent(inout) :: state(6)
      real(wp), intent(out) :: u
      real(wp) :: p1, p2

      p1 = rest(1403580*state(2) - 810728*state(1), m1)
      p2 = rest(527612*state(6) - 1370589*state(4), m2)
      state = [state(2), state(3), p1, state(5), state(6), p2]
      u = rest(p1 - p2, m1)
      if (.not. u > 0) u = m1
      u = u/(m1 + 1)
   end subroutine draw

   !> `modulo` of integers below 2**53, exact as well and without the C library's loop.
   pure real(wp) function rest(x, m)
      real(wp), intent(in) :: x, m

      rest = x - m*int(x/m, ip)
      if (rest < 0) rest = rest + m
      if (rest >= m) rest = rest - m
   end function rest

end module beamid_noise
