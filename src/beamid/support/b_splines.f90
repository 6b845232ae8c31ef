!> B-splines and their derivatives on arbitrary knots. The spline spaces and the fields along the
!> beam are built from them.
module beamid_b_splines
   use beamid_kinds, only: wp
   implicit none
   private

   public :: b_splines, cardinal

contains

   !> Returns the cardinal B-splines, on knots of unit spacing, that are nonzero on one interval,
   !> from left to right.
   !>
   !> degree      of the splines
   !> derivative  order of the derivative; 0: the values
   !> s           place in the interval, 0 to 1
   pure function cardinal(degree, derivative, s) result(values)
      integer, intent(in) :: degree, derivative
      real(wp), intent(in) :: s
      real(wp) :: values(degree + 1)
      integer :: i

      values = b_splines([(real(i, wp), i=1 - degree, degree)], s, derivative)
   end function cardinal

   !> Returns the degree + 1 B-splines, multiplied by degree!, that are nonzero between two knots,
   !> from left to right, or a derivative of them. De Boor's recurrence gives the splines of degree
   !> degree - derivative; repeated differences, divided by the lengths of their supports, are the
   !> derivatives.
   !>
   !> t           (2 degree) knots around the interval; the interval begins at t(degree) = 0
   !> u           place in the interval, 0 to t(degree + 1)
   !> derivative  order of the derivative; 0: the values
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
      do p = 2, degree
         values = p*values
      end do
   end function b_splines

end module beamid_b_splines
