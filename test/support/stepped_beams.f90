!> Natural frequencies of a clamped beam of uniform pieces: the conditions at the joints, eliminated
!> piece by piece, leave those of the free end, a determinant of two rows in place of four for each
!> piece.
module stepped_beams
   use beamid_kinds, only: wp
   use full_matrices, only: qp
   implicit none
   private

   public :: stepped_frequencies

contains

   !> ends        (pieces) where they end, ascending, the last at the length
   !> bending     (pieces) E I
   !> mass        (pieces) per length
   !> omega       the lowest [1/time]
   function stepped_frequencies(ends, bending, mass, wanted) result(omega)
      real(wp), intent(in) :: ends(:), bending(:), mass(:)
      integer, intent(in) :: wanted
      real(wp) :: omega(wanted)
      real(qp) :: low, high, middle, step
      integer :: i, k

      ! The root of omega grows by some pi/l from one to the next: steps of a twentieth of that, for
      ! the softest piece, pass over none.
      step = 0.15_qp/ends(size(ends))*sqrt(sqrt(minval(real(bending, qp)/mass)))
      high = step
      do k = 1, wanted
         do
            low = high
            high = low + step
            if (determinant(low**2) > 0 .neqv. determinant(high**2) > 0) exit
         end do
         do i = 1, 70
            middle = (low + high)/2
            if (determinant(low**2) > 0 .eqv. determinant(middle**2) > 0) then
               low = middle
            else
               high = middle
            end if
         end do
         omega(k) = real(low**2, wp)
         high = low + step/1000
      end do

   contains

      !> Moment and force at the free end, of the two motions that begin at the clamp with a moment
      !> or a force alone.
      real(qp) function determinant(w)
         real(qp), intent(in) :: w
         real(qp) :: state(4, 2), b, z, c(0:3)
         real(qp) :: pass(4, 4)
         integer :: p

         state = 0
         state(3, 1) = 1
         state(4, 2) = 1
         do p = 1, size(ends)
            b = sqrt(sqrt(mass(p)*w**2/bending(p)))
            z = b*ends(p)
            if (p > 1) z = b*(real(ends(p), qp) - ends(p - 1))
            c = [cosh(z) + cos(z), sinh(z) + sin(z), cosh(z) - cos(z), sinh(z) - sin(z)]/2
            associate (k => real(bending(p), qp))
               ! Deflection, slope, moment and force, each by the four at the beginning.
               pass(1, :) = [c(0), c(1)/b, c(2)/(k*b**2), c(3)/(k*b**3)]
               pass(2, :) = [b*c(3), c(0), c(1)/(k*b), c(2)/(k*b**2)]
               pass(3, :) = [k*b**2*c(2), k*b*c(3), c(0), c(1)/b]
               pass(4, :) = [k*b**3*c(1), k*b**2*c(2), b*c(3), c(0)]
            end associate
            state = matmul(pass, state)
         end do
         determinant = state(3, 1)*state(4, 2) - state(3, 2)*state(4, 1)
      end function determinant

   end function stepped_frequencies

end module stepped_beams
