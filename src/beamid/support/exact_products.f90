!> The product of two numbers in twice the working precision.
module beamid_exact_products
   use beamid_kinds, only: wp
   implicit none
   private

   public :: multiply_exactly

contains

   !> Computes a product and its round-off, so that a b = product + error (Dekker, Numerische
   !> Mathematik 18, 1971, 224). Factors above 1e300 overflow.
   elemental subroutine multiply_exactly(a, b, product, error)
      real(wp), intent(in) :: a, b
      real(wp), intent(out) :: product, error
      real(wp), parameter :: splitter = 134217729    ! 2**27 + 1
      real(wp) :: high_a, high_b, low_a, low_b

      high_a = splitter*a
      high_a = high_a - (high_a - a)
      low_a = a - high_a
      high_b = splitter*b
      high_b = high_b - (high_b - b)
      low_b = b - high_b
      product = a*b
      error = ((high_a*high_b - product) + high_a*low_b + low_a*high_b) + low_a*low_b
   end subroutine multiply_exactly

end module beamid_exact_products
