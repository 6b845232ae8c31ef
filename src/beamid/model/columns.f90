!> Statics of a cantilever with an axial force N(x) that varies along it, E I w'''' - (N w')' = f:
!> influence function and buckling, for `beamid_structure`.
!>
!> Under a unit force at xi, the slope theta = w' satisfies E I theta'' - N theta = -1 between the
!> root and xi, and = 0 beyond xi. The boundary conditions are theta = kappa E I theta' at the root
!> (kappa: compliance of the clamp) and theta' = 0 at the tip. N is piecewise linear, and theta is a
!> power series in each piece. A first sweep, from the tip to the root, computes the coefficients of
!> theta' = p theta + r at the ends of the pieces; a second sweep, from the root to the tip,
!> computes theta and its integral w. The result is analytic in the parameters, so that complex
!> steps give its derivatives.
module beamid_columns
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_kinds, only: wp
   implicit none
   private

   public :: column_t, new_column, column_deflection, column_buckles

   !> Largest number of pieces. The slope grows at most by a factor of e per piece, so that its
   !> square does not overflow.
   integer, parameter, public :: most_pieces = 600

   !> A cantilever divided into pieces. Values are complex to carry a complex step.
   type :: column_t
      complex(wp) :: stiffness = 0           !< bending stiffness E I [force length**2]
      complex(wp) :: compliance = 0          !< compliance of the clamp [1/(force length)]
      complex(wp), allocatable :: ends(:)    !< (pieces + 1) ends of the pieces, ascending [length]
      !> (pieces) axial force at the beginning of each piece [force]; size 0: the force would
      !> require more than `most_pieces`
      complex(wp), allocatable :: N(:)
      complex(wp), allocatable :: slope(:)   !< (pieces) dN/dx in each piece [force/length]
   end type column_t

contains

   !> Returns a cantilever divided into pieces that are shorter than sqrt(E I/|N|), the length over
   !> which the axial force bends the beam.
   !>
   !> stiffness   bending stiffness E I [force length**2]
   !> compliance  compliance of the clamp [1/(force length)]; 0: rigid
   !> ends        (intervals + 1) ends of intervals, ascending [length]; N is linear in each
   !>             interval
   !> N           (intervals) axial force at the beginning of each interval [force]
   !> slope       (intervals) dN/dx in each interval [force/length]
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

   !> Returns the deflection at x under a unit force at xi [length/force]. The result is NaN if the
   !> column would require more than `most_pieces`.
   !>
   !> x, xi  ends of pieces [length]
   pure complex(wp) function column_deflection(self, x, xi) result(w)
      type(column_t), intent(in) :: self
      complex(wp), intent(in) :: x, xi
      complex(wp), dimension(0:size(self%N)) :: p, r
      complex(wp) :: theta, first(3), second(3), forced(3)
      integer :: k, loaded_end, observed_end

      w = ieee_value(1.0_wp, ieee_quiet_nan)
      if (size(self%N) == 0) return
      ! The positions are complex: find the end that each equals, instead of comparing positions.
      observed_end = minloc(abs(self%ends - x), dim=1)
      loaded_end = minloc(abs(self%ends - xi), dim=1)
      p(size(self%N)) = 0
      r(size(self%N)) = 0
      do k = size(self%N), 1, -1
         call solve_piece(self, k, k < loaded_end, first, second, forced)
         ! (theta, theta') at the end = first*theta + second*theta' + forced, with theta and theta'
         ! at the beginning.
         p(k - 1) = (p(k)*first(1) - first(2))/(second(2) - p(k)*second(1))
         r(k - 1) = (p(k)*forced(1) + r(k) - forced(2))/(second(2) - p(k)*second(1))
      end do
      associate (root => self%compliance*self%stiffness)
         theta = root*r(0)/(1 - root*p(0))
      end associate
      w = 0
      do k = 1, size(self%N)
         if (k >= observed_end) return
         call solve_piece(self, k, k < loaded_end, first, second, forced)
         associate (dtheta => p(k - 1)*theta + r(k - 1))
            w = w + first(3)*theta + second(3)*dtheta + forced(3)
            theta = first(1)*theta + second(1)*dtheta + forced(1)
         end associate
      end do
   end function column_deflection

   !> Returns whether the axial force buckles the beam. The solution without load that has slope 1
   !> and curvature 0 at the tip is followed to the root: the beam is stable if the slope, and at
   !> the root the residual of the clamp's boundary condition, stay positive. A column that would
   !> require more than `most_pieces` counts as buckled.
   pure logical function column_buckles(self) result(buckles)
      type(column_t), intent(in) :: self
      complex(wp) :: theta, dtheta, first(3), second(3), forced(3)
      real(wp) :: before(2)
      integer :: k

      theta = 1
      dtheta = 0
      buckles = .true.
      if (size(self%N) == 0) return
      do k = size(self%N), 1, -1
         call solve_piece(self, k, .false., first, second, forced)
         ! The transfer matrix has the determinant 1; this is its inverse.
         before = real([second(2)*theta - second(1)*dtheta, first(1)*dtheta - first(2)*theta])
         theta = before(1)
         dtheta = before(2)
         if (.not. real(theta) > 0) return
      end do
      buckles = .not. real(theta - self%compliance*self%stiffness*dtheta) > 0
   end function column_buckles

   !> Computes theta, theta' and the integral of theta at the end of piece k for three solutions.
   !>
   !> loaded  whether the force acts beyond the piece
   !> first   (3) the solution that begins with theta = 1, theta' = 0, without force
   !> second  (3) the solution that begins with theta = 0, theta' = 1, without force
   !> forced  (3) the solution that begins with theta = theta' = 0, with the unit force if `loaded`
   pure subroutine solve_piece(self, k, loaded, first, second, forced)
      type(column_t), intent(in) :: self
      integer, intent(in) :: k
      logical, intent(in) :: loaded
      complex(wp), intent(out) :: first(3), second(3), forced(3)

      first = series(self, k, [(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], (0.0_wp, 0.0_wp))
      second = series(self, k, [(0.0_wp, 0.0_wp), (1.0_wp, 0.0_wp)], (0.0_wp, 0.0_wp))
      forced = series(self, k, [(0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], &
         merge((-1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), loaded))
   end subroutine solve_piece

   !> Solves theta'' = (N theta + force)/(E I) over piece k by a power series.
   !>
   !> begin   (2) theta and theta' at the beginning
   !> force   right-hand side, 0 or -1 [force]
   !> values  (3) theta, theta' and the integral of theta at the end
   pure function series(self, k, begin, force) result(values)
      type(column_t), intent(in) :: self
      integer, intent(in) :: k
      complex(wp), intent(in) :: begin(2), force
      complex(wp) :: values(3)
      !> In a piece, |N| h**2 < E I: the terms decrease like 1/i!.
      integer, parameter :: terms = 24
      complex(wp) :: c(-1:terms)
      integer :: i

      associate (h => self%ends(k + 1) - self%ends(k))
         ! c(i) = a_i h**i, where a_i are the coefficients of the power series.
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
