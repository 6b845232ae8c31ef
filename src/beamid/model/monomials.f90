!> Monomials: products of powers of quantities, and their derivatives. They are the coefficients in
!> the table of terms and the moderate values in the table of parameters.
module beamid_monomials
   use beamid_kinds, only: wp
   implicit none
   private

   public :: monomial_t, slope_of, value_of

   !> The monomial constant q(place(1))**power(1) q(place(2))**power(2) q(place(3))**power(3).
   type :: monomial_t
      real(wp) :: constant = 1    !< numerical factor
      integer :: place(3) = 0     !< indices of the quantities in q; 0: no factor
      integer :: power(3) = 1     !< exponents of the quantities
   end type monomial_t

contains

   !> Returns the value of a monomial.
   !>
   !> q  (:) quantities, by their indices
   pure real(wp) function value_of(self, q) result(value)
      type(monomial_t), intent(in) :: self
      real(wp), intent(in) :: q(:)
      integer :: i

      value = self%constant
      do i = 1, size(self%place)
         if (self%place(i) > 0) value = value*q(self%place(i))**self%power(i)
      end do
   end function value_of

   !> Returns the derivative of a monomial with respect to q(k), by the product rule.
   pure real(wp) function slope_of(self, q, k) result(slope)
      type(monomial_t), intent(in) :: self
      real(wp), intent(in) :: q(:)
      integer, intent(in) :: k
      type(monomial_t) :: rest
      integer :: i

      slope = 0
      if (.not. any(self%place == k)) return
      do i = 1, size(self%place)
         if (self%place(i) /= k) cycle
         rest = monomial_t(self%constant*self%power(i), self%place, self%power)
         rest%power(i) = self%power(i) - 1
         slope = slope + value_of(rest, q)
      end do
   end function slope_of

end module beamid_monomials
