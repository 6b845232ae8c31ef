!> Generates reproducible random numbers, the same on every machine: uniform numbers by L'Ecuyer's
!> MRG32k3a (Operations Research 47, 1999, 159), whose integers are exact in double precision, and
!> Gaussian numbers by the Box-Muller transform.
module beamid_noise
   use beamid_kinds, only: ip, two_pi, wp
   implicit none
   private

   public :: gaussian_noise, uniform_noise

   !> The two moduli of MRG32k3a.
   real(wp), parameter :: m1 = 4294967087.0_wp, m2 = 4294944443.0_wp
   !> Rounds that mix a seed, and numbers that are discarded at the start.
   integer, parameter :: warm_up = 20

contains

   !> Returns n independent Gaussian numbers of mean 0 and standard deviation sd.
   !>
   !> seed  any integer; the same seed gives the same numbers
   pure function gaussian_noise(n, sd, seed) result(noise)
      integer, intent(in) :: n, seed
      real(wp), intent(in) :: sd
      real(wp) :: noise(n)
      real(wp) :: state(6), u(2)
      integer :: k

      state = seeded(seed)
      do k = 1, n, 2
         call draw_uniform(state, u(1))
         call draw_uniform(state, u(2))
         noise(k) = sd*sqrt(-2*log(u(1)))*cos(two_pi*u(2))
         if (k < n) noise(k + 1) = sd*sqrt(-2*log(u(1)))*sin(two_pi*u(2))
      end do
   end function gaussian_noise

   !> Returns n independent numbers, uniform in (0, 1); the same seed gives the same numbers.
   pure function uniform_noise(n, seed) result(noise)
      integer, intent(in) :: n, seed
      real(wp) :: noise(n)
      real(wp) :: state(6)
      integer :: k

      state = seeded(seed)
      do k = 1, n
         call draw_uniform(state, noise(k))
      end do
   end function uniform_noise

   !> Returns the six numbers of the generator's state for a seed, by repeated squaring. The
   !> generator is linear, so that a linear function of the seed would carry linear relations
   !> between seeds over to their numbers. No product reaches 2**53.
   pure function seeded(seed) result(state)
      integer, intent(in) :: seed
      real(wp) :: state(6), mixed, u
      integer :: k, round

      mixed = remainder(real(seed, wp), m2)
      do k = 1, 6
         do round = 1, warm_up
            mixed = remainder(mixed*remainder(mixed + round, 2.0_wp**21) + 69069*k + 1, m2)
         end do
         state(k) = mixed
      end do
      do k = 1, warm_up
         call draw_uniform(state, u)
      end do
   end function seeded

   !> Draws a uniform number in (0, 1) and advances the state.
   pure subroutine draw_uniform(state, u)
      real(wp), intent(inout) :: state(6)
      real(wp), intent(out) :: u
      real(wp) :: p1, p2

      p1 = remainder(1403580*state(2) - 810728*state(1), m1)
      p2 = remainder(527612*state(6) - 1370589*state(4), m2)
      state = [state(2), state(3), p1, state(5), state(6), p2]
      u = remainder(p1 - p2, m1)
      if (.not. u > 0) u = m1
      u = u/(m1 + 1)
   end subroutine draw_uniform

   !> Returns `modulo(x, m)` of integers below 2**53; exact, and without the C library's loop. The
   !> quotient may be off by one, which is corrected.
   pure real(wp) function remainder(x, m)
      real(wp), intent(in) :: x, m

      remainder = x - m*int(x*(1/m), ip)
      if (remainder < 0) remainder = remainder + m
      if (remainder >= m) remainder = remainder - m
   end function remainder

end module beamid_noise
