!> Both roots of a quadratic equation, without cancellation.
module beamid_quadratics
   use beamid_kinds, only: wp
   implicit none
   private

   public :: lossy_roots, quadratic_roots

contains

   !> Returns both roots of a s**2 + b s + c without cancellation; a > 0, b >= 0, c >= 0.
   pure function quadratic_roots(a, b, c) result(roots)
      real(wp), intent(in) :: a, b, c
      complex(wp) :: roots(2)
      real(wp) :: half, discriminant

      half = b/(2*a)
      discriminant = half**2 - c/a
      if (discriminant < 0) then
         roots(1) = cmplx(-half, sqrt(-discriminant), wp)
         roots(2) = conjg(roots(1))
      else
         roots(2) = -(half + sqrt(discriminant))
         roots(1) = 0
         if (c > 0) roots(1) = c/(a*roots(2))
      end if
   end function quadratic_roots

   !> Returns both roots of m s**2 + c s + k without cancellation, the one with Im s > 0 first;
   !> m > 0, c >= 0, Im k > 0.
   pure function lossy_roots(m, c, k) result(roots)
      real(wp), intent(in) :: m, c
      complex(wp), intent(in) :: k
      complex(wp) :: roots(2)
      real(wp) :: half

      half = c/(2*m)
      ! The principal square root has a real part >= 0 and, because Im k > 0, an imaginary part < 0.
      roots(1) = -(half + sqrt(half**2 - k/m))
      roots(2) = k/(m*roots(1))
   end function lossy_roots

end module beamid_quadratics
