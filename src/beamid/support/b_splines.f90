!> B-splines on any knots, and their derivatives.
module beamid_b_splines
   use beamid_kinds, only: wp
   implicit none
   private

   public :: b_splines, cardinal

contains

   !> The cardinal B-splines, of unit spacing, that are nonzero on one interval, from left to right,
   !> at s in [0, 1].
   pure function cardinal(degree, derivative, s) result(values)
      integer, intent(in) :: degree, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(degree + 1)
      integer :: i

      values = b_splines([(real(i, wp), i=1 - degree, degree)], s, derivative)
   end function cardinal

   !> The degree + 1 B-splines, scaled by degree!, that are nonzero between two knots, from left to
   !> right: de Boor's recurrence for the splines of degree degree - derivative, then differences of
   !> those over the spans of knots they live on.
   !>
   !> t  (2 degree) the knots around, relative to number `degree`, at 0
   !> u  between 0 and t(degree + 1)
   pure function b_splines(t, u, derivative) result(values)
      real(wp), intent(in) :: t(:), u
      integer, intent(in) :: derivative
      real(wp) :: values(size(t)/2 + 1)
      real(wp) :: saved, term
      integer :: degree, p, r

      degree = size(t)/2
      values = 0
      values(1) = 1
      do p = 1, degree - derivative
         saved = 0
         do r = 1, p
            term = values(r)/(t(degree + r) - t(degree + r - p))
            values(r) = saved + (t(degree + r) - u)*term
            saved = (u - t(degree + r - p))*term
         end do
         values(p + 1) = saved
      end do
      do p = degree - derivative + 1, degree
         do r = 1, p
            values(r) = p*values(r)/(t(degree + r) - t(degree + r - p))
         end do
         values(2:p + 1) = values(1:p) - values(2:p + 1)
         values(1) = -values(1)
      end do
      values = values*product([(real(p, wp), p=2, degree)])
   end function b_splines

end module beamid_b_splines
