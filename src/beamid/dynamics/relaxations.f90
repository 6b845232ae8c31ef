!> The relaxations of a modulus with time hysteresis (Boltzmann; standard linear solid),
!>
!>     E (s) = E phi(s),    phi(s) = 1 + tau s + sum over l of d_l s/(s + b_l),
!>
!> where tau = c_D/E. Between -b_l and -b of the next slower relaxation (0 for the slowest), phi
!> grows from minus infinity to plus infinity (to 1 for the slowest), and vanishes at one point a_l.
!> If a mode has the stiffness k phi, its relaxation roots lie in these intervals too, one in each.
!> Those of the higher modes accumulate at a_l, and those of modes that are slower than the
!> relaxation approach -b_l. Both distances of a root, from a_l and from -b_l, are therefore known
!> to all digits:
!>
!>     s = a + creep = -b + rise,    phi = creep (tau + sum of d_l b_l/((s + b_l) (a + b_l))).
!>
!> `creep` is the distance from the point of accumulation a: the motion e**(a t) is a creep under
!> constant force. `rise` is how far the root rises above the lower end -b of its interval.
module beamid_relaxations
   use beamid_kinds, only: wp
   implicit none
   private

   public :: relaxation_t, new_relaxation

   !> The relaxations of a structure, without those of strength 0. Two with the same rate are one.
   type :: relaxation_t
      integer :: n = 0                 !< number of relaxations
      real(wp) :: strength(2) = 0      !< (n) d
      real(wp) :: rate(2) = 0          !< (n) b, ascending [1/time]
      real(wp) :: tau = 0              !< c_D/E [time]
      real(wp) :: point(2) = 0         !< (n) a, where the roots accumulate [1/time]
      real(wp) :: lag(2) = 0           !< (n) a + b, to all digits [1/time]
      !> index of a relaxation of the structure among those of this type; 0: it has no strength
      integer :: slot(2) = 0
   contains
      procedure :: find_root
      procedure, private :: find_rise
   end type relaxation_t

contains

   !> Returns the relaxations of given strengths d and rates b [1/time].
   !>
   !> tau  c_D/E [time]
   pure type(relaxation_t) function new_relaxation(d, b, tau) result(self)
      real(wp), intent(in) :: d(2), b(2), tau
      integer :: order(2), j, l

      order = [1, 2]
      if (b(1) > b(2)) order = [2, 1]
      self%tau = tau
      do l = 1, 2
         j = order(l)
         if (.not. (d(j) > 0 .and. b(j) > 0)) cycle
         if (self%n == 1 .and. abs(b(j) - self%rate(1)) <= 1e-14_wp*b(j)) then
            self%strength(1) = self%strength(1) + d(j)
         else
            self%n = self%n + 1
            self%strength(self%n) = d(j)
            self%rate(self%n) = b(j)
         end if
         self%slot(j) = self%n
      end do
      do j = 1, self%n
         self%lag(j) = self%find_rise(j, 0.0_wp, 0.0_wp)
         self%point(j) = self%lag(j) - self%rate(j)
      end do
   end function new_relaxation

   !> Finds the root of phi + e(1) s + e(2) s**2 in the interval of a relaxation.
   !>
   !> j            number of the relaxation
   !> e            coefficients [time], [time**2]
   !> creep, rise  distances of the root from a_j and from -b_j [1/time]
   pure subroutine find_root(self, j, e, creep, rise)
      class(relaxation_t), intent(in) :: self
      integer, intent(in) :: j
      real(wp), intent(in) :: e(2)
      real(wp), intent(out) :: creep, rise
      real(wp) :: s, other, other_slope, f, slope, step
      integer :: k, l

      rise = self%find_rise(j, e(1), e(2))
      creep = rise - self%lag(j)
      if (abs(creep) > 0.1_wp*self%lag(j)) return
      ! Newton's method for creep, whose digits a difference of rise and lag would lose.
      do k = 1, 8
         rise = self%lag(j) + creep
         s = self%point(j) + creep
         other = self%tau
         other_slope = 0
         do l = 1, self%n
            if (l == j) cycle
            associate (share => self%strength(l)*self%rate(l)/((s + self%rate(l)) &
               *(self%point(j) + self%rate(l))))
               other = other + share
               other_slope = other_slope - share/(s + self%rate(l))
            end associate
         end do
         associate (own => self%strength(j)*self%rate(j)/self%lag(j))
            f = creep*(own + rise*other) + rise*s*(e(1) + e(2)*s)
            slope = own + rise*other + creep*(other + rise*other_slope) + s*(e(1) + e(2)*s) &
               + rise*(e(1) + 2*e(2)*s)
         end associate
         step = -f/slope
         creep = creep + step
         if (abs(step) <= 2*epsilon(step)*abs(creep)) exit
      end do
      rise = self%lag(j) + creep
   end subroutine find_root

   !> Returns the distance from -b_j of the root of phi + e_1 s + e_2 s**2, by Newton's method
   !> within an interval that holds the root [1/time].
   pure real(wp) function find_rise(self, j, e_1, e_2) result(rise)
      class(relaxation_t), intent(in) :: self
      integer, intent(in) :: j
      real(wp), intent(in) :: e_1, e_2
      real(wp) :: low, high, s, rest, rest_slope, f, next
      integer :: k, l

      low = 0
      high = self%rate(j)
      if (j > 1) high = self%rate(j) - self%rate(j - 1)
      rise = high/2
      do k = 1, 200
         s = rise - self%rate(j)
         rest = 1 + (self%tau + e_1 + e_2*s)*s
         rest_slope = self%tau + e_1 + 2*e_2*s
         do l = 1, self%n
            if (l == j) cycle
            rest = rest + self%strength(l)*s/(s + self%rate(l))
            rest_slope = rest_slope + self%strength(l)*self%rate(l)/(s + self%rate(l))**2
         end do
         ! phi + e_1 s + e_2 s**2 times the distance; it grows through the root.
         f = rise*rest + self%strength(j)*s
         if (f > 0) then
            high = rise
         else
            low = rise
         end if
         next = rise - f/(rest + rise*rest_slope + self%strength(j))
         if (.not. (next > low .and. next < high)) then
            next = (low + high)/2
            if (.not. low > 0) next = high*1e-2_wp
         end if
         f = abs(next - rise)
         rise = next
         if (f <= 2*epsilon(f)*rise) exit
      end do
   end function find_rise

end module beamid_relaxations
