!> Numbers that look random and are the same in every run: Lehmer's generator.
module random_numbers
   use beamid_kinds, only: ip, wp
   implicit none
   private

   public :: start_random, uniform, between, decades, pick, random_state

   integer(ip), parameter :: modulus = 2147483647
   integer(ip), protected :: random_state = 1
   integer(ip) :: multiplier = 48271

contains

   !> Begins a sequence. The multiplier: 48271, or 16807.
   subroutine start_random(seed, factor)
      integer, intent(in) :: seed
      integer, intent(in), optional :: factor

      random_state = seed
      if (present(factor)) multiplier = factor
   end subroutine start_random

   !> Uniform in (0, 1).
   real(wp) function uniform()
      random_state = modulo(multiplier*random_state, modulus)
      uniform = real(random_state, wp)/modulus
   end function uniform

   !> Between two values.
   real(wp) function between(low, high)
      real(wp), intent(in) :: low, high

      between = low + (high - low)*uniform()
   end function between

   !> Evenly distributed in decades, between two powers of ten.
   real(wp) function decades(low, high)
      real(wp), intent(in) :: low, high

      decades = 10**between(low, high)
   end function decades

   !> A number from 1 to n.
   integer function pick(n)
      integer, intent(in) :: n
      real(wp) :: next

      next = uniform()
      pick = int(mod(random_state, int(n, ip))) + 1
   end function pick

end module random_numbers
