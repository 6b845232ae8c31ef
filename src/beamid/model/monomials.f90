!> Products of powers of quantities, and their derivatives.
module beamid_monomials
   use beamid_kinds, only: wp
   implicit none
   private

   public :: monomial_t, slope_of, value_of

   !> constant q(place(1))**power(1) q(place(2))**power(2) ...; place 0: no factor.
   type :: monomial_t
      real(wp) :: constant = 1
      integer :: place(3) = 0
      integer :: power(3) = 1
   end type monomial_t

contains

   !> q  (:) quantities by place
   pure real(wp) function value_of(self, q) result(value)
      type(monomial_t), intent(in) :: self
      real(wp), intent(in) :: q(:)
      integer :: i

      value = self%constant
      do i = 1, size(self%place)
         if (self%place(i) == 0) cycle
         if (self%power(i) == 1) then
            value = value*q(self%place(i))
         else
            value = value*q(self%place(i))**self%power(i)
         end if
      end do
   end function value_of

   !> Derivative with respect to q(k), by the product rule.
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
