!> Statics of a cantilever with an axial force that changes along it, E I w'''' - (N w')' = f.
!>
!> For a unit force at xi the slope theta = w' satisfies E I theta'' - N theta = -1 between the root
!> and xi and = 0 beyond, theta = kappa E I theta' at the root, theta' = 0 at the tip. N is linear
!> in pieces, in each of which theta is a power series. From the tip on theta' = p theta + r is
!> known at the end of each piece; from the root on theta follows. All is analytic in the
!> parameters.
module beamid_columns
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_kinds, only: wp
   implicit none
   private

   public :: column_t, new_column, column_deflection, column_buckles

   !> Largest number of pieces. The slope grows by a factor of e per piece at most, so that its
   !> square stays below the largest number.
   integer, parameter, public :: most_pieces = 600

   !> A cantilever in pieces.
   type :: column_t
      complex(wp) :: stiffness = 0                   !< E I
      complex(wp) :: compliance = 0                  !< of the clamp
      complex(wp), allocatable :: ends(:)            !< (pieces + 1) ascending [length]
      !> (pieces) axial force where each piece begins, and dN/dx; (0) the force would need more than
      !> `most_pieces`
      complex(wp), allocatable :: N(:), slope(:)
   end type column_t

contains

   !> Returns a cantilever in pieces that are short compared with sqrt(E I/|N|), the length over
   !> which the force bends the beam.
   !>
   !> stiffness   E I [force length**2]
   !> compliance  of the clamp [1/(force length)]; 0: rigid
   !> ends        (intervals + 1) ascending [length]; in each interval the force is linear
   !> N, slope    (intervals) force where each interval begins [force], and dN/dx [force/length]
   pure function new_column(stiffness, compliance, ends, N, slope) result(column)
      complex(wp), intent(in) :: stiffness, compliance, ends(:), N(:), slope(:)
      type(column_t) :: column
      real(wp) :: bends(size(N))
      integer :: parts(size(N)), first, i, k

      column%stiffness = stiffness
      column%compliance = compliance
      allocate (column%N(0), column%slope(0))
      column%ends = ends(:1)
      associate (h => ends(2:) - ends(:size(N)))
         bends = abs(h)*sqrt(max(abs(N), abs(N + slope*h))/abs(stiffness))
         if (.not. sum(1 + bends) + size(N) <= most_pieces) return
         parts = merge(1 + ceiling(bends), 0, abs(h) > 0)
         deallocate (column%N, column%slope, column%ends)
         allocate (column%N(sum(parts)), column%slope(sum(parts)), column%ends(sum(parts) + 1))
         column%ends(1) = ends(1)
         first = 0
         do i = 1, size(N)
            do k = 1, parts(i)
               column%N(first + k) = N(i) + slope(i)*h(i)*(k - 1)/parts(i)
               column%slope(first + k) = slope(i)
               column%ends(first + k + 1) = ends(i) + h(i)*k/parts(i)
            end do
            first = first + parts(i)
            column%ends(first + 1) = ends(i + 1)
         end do
      end associate
   end function new_column

   !> Returns the deflection at x under a unit force at xi, both ends of pieces [length/force]; NaN
   !> where the column has more pieces than it may.
   pure complex(wp) function column_deflection(self, x, xi) result(w)
      type(column_t), intent(in) :: self
      complex(wp), intent(in) :: x, xi
      complex(wp), dimension(0:size(self%N)) :: p, r
      complex(wp) :: theta, first(3), second(3), forced(3)
      integer :: k, pushed, seen

      w = ieee_value(1.0_wp, ieee_quiet_nan)
      if (size(self%N) == 0) return
      ! Complex places: which ends they are, not on which side of them.
      seen = minloc(abs(self%ends - x), dim=1)
      pushed = minloc(abs(self%ends - xi), dim=1)
      p(size(self%N)) = 0
      r(size(self%N)) = 0
      do k = size(self%N), 1, -1
         call cross(self, k, k < pushed, first, second, forced)
         ! (theta, theta') at the end is first theta + second theta' + forced of the beginning.
         p(k - 1) = (p(k)*first(1) - first(2))/(second(2) - p(k)*second(1))
         r(k - 1) = (p(k)*forced(1) + r(k) - forced(2))/(second(2) - p(k)*second(1))
      end do
      associate (turn => self%compliance*self%stiffness)
         theta = turn*r(0)/(1 - turn*p(0))
      end associate
      w = 0
      do k = 1, size(self%N)
         if (k >= seen) return
         call cross(self, k, k < pushed, first, second, forced)
         associate (turned => p(k - 1)*theta + r(k - 1))
            w = w + first(3)*theta + second(3)*turned + forced(3)
            theta = first(1)*theta + second(1)*turned + forced(1)
         end associate
      end do
   end function column_deflection

   !> Returns whether the axial force buckles the beam: without load the slope that is 1 at the tip
   !> must not change its sign on the way to the root, nor what the clamp makes of it. A column of
   !> more pieces than it may have counts as buckled.
   pure logical function column_buckles(self) result(buckles)
      type(column_t), intent(in) :: self
      complex(wp) :: theta, turned, first(3), second(3), forced(3)
      real(wp) :: before(2)
      integer :: k

      theta = 1
      turned = 0
      buckles = .true.
      if (size(self%N) == 0) return
      do k = size(self%N), 1, -1
         call cross(self, k, .false., first, second, forced)
         ! The inverse of a matrix of determinant 1.
         before = real([second(2)*theta - second(1)*turned, first(1)*turned - first(2)*theta])
         theta = before(1)
         turned = before(2)
         if (.not. real(theta) > 0) return
      end do
      buckles = .not. real(theta - self%compliance*self%stiffness*turned) > 0
   end function column_buckles

   !> theta, theta' and the integral of theta at the end of a piece: of the two solutions that begin
   !> with theta = 1 and with theta' = 1, and of what a unit force beyond adds.
   pure subroutine cross(self, k, loaded, first, second, forced)
      type(column_t), intent(in) :: self
      integer, intent(in) :: k
      logical, intent(in) :: loaded
      complex(wp), intent(out) :: first(3), second(3), forced(3)

      first = series(self, k, [(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], (0.0_wp, 0.0_wp))
      second = series(self, k, [(0.0_wp, 0.0_wp), (1.0_wp, 0.0_wp)], (0.0_wp, 0.0_wp))
      forced = series(self, k, [(0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], &
         merge((-1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), loaded))
   end subroutine cross

   !> theta'' = (N theta + force)/(E I) over a piece.
   !>
   !> begin   theta and theta'
   !> values  theta, theta' and the integral of theta at the end
   pure function series(self, k, begin, force) result(values)
      type(column_t), intent(in) :: self
      integer, intent(in) :: k
      complex(wp), intent(in) :: begin(2), force
      complex(wp) :: values(3)
      !> A piece has |N| h**2 < E I: the terms fall like 1/i!.
      integer, parameter :: terms = 24
      complex(wp) :: c(-1:terms)
      integer :: i

      associate (h => self%ends(k + 1) - self%ends(k))
         ! c(i) = a_i h**i
         c(-1) = 0
         c(0) = begin(1)
         c(1) = begin(2)*h
         do i = 0, terms - 2
            c(i + 2) = (self%N(k)*c(i) + self%slope(k)*h*c(i - 1))*h**2/self%stiffness
            if (i == 0) c(2) = c(2) + force*h**2/self%stiffness
            c(i + 2) = c(i + 2)/((i + 2)*(i + 1))
         end do
         values = [sum(c(0:)), sum([(i*c(i), i=1, terms)])/h, h*sum([(c(i)/(i + 1), i=0, terms)])]
      end associate
   end function series

end module beamid_columns
