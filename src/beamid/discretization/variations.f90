!> Properties that vary along the beam, as sums over B-splines.
module beamid_variations
   use beamid_kinds, only: wp
   use beamid_splines, only: cardinal
   implicit none
   private

   public :: variation_t, variations_t

   !> A factor of a property, sum over c_j B_j on a uniform mesh of its own; the B_j add up to one.
   type :: variation_t
      integer :: degree = 3
      !> (elements + degree) c_j, from root to tip; not allocated: 1 everywhere
      real(wp), allocatable :: coefficients(:)
   contains
      procedure :: at
   end type variation_t

   !> Factors of the modulus, of the mass per length and of the Kelvin-Voigt viscosity.
   type :: variations_t
      type(variation_t) :: E, rho, c_D
   contains
      procedure :: exist
   end type variations_t

contains

   !> xi  x/l, 0 .. 1
   pure real(wp) function at(self, xi) result(factor)
      class(variation_t), intent(in) :: self
      real(wp), intent(in) :: xi
      integer :: element, elements

      factor = 1
      if (.not. allocated(self%coefficients)) return
      elements = size(self%coefficients) - self%degree
      element = min(max(int(xi*elements), 0), elements - 1)
      factor = sum(self%coefficients(element + 1:element + self%degree + 1) &
         *cardinal(self%degree, 0, xi*elements - element))/gamma(self%degree + 1.0_wp)
   end function at

   !> Whether anything varies.
   pure logical function exist(self)
      class(variations_t), intent(in) :: self

      exist = allocated(self%E%coefficients) .or. allocated(self%rho%coefficients) .or. &
         allocated(self%c_D%coefficients)
   end function exist

end module beamid_variations
