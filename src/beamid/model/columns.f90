!> Statics of a beam with an axial force N(x) that varies along it, E I w'''' - (N w')' = f, on any
!> springs to the ground: influence function and buckling, for `beamid_structure`.
!>
!> N is piecewise linear. In a piece without load the transverse force V = N theta - E I theta'' is
!> constant, where theta = w', and theta is a power series; so the state (w, theta, M, V) at the end
!> of a piece, with M = E I theta', is linear in that at its beginning. The states that the left end
!> allows form a space of two dimensions. A basis of this space is carried from piece to piece, and
!> normalized at each end of a piece, so that it neither grows nor degenerates. The result is
!> analytic in the parameters, so that complex steps give its derivatives.
module beamid_columns
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
   implicit none
   private

   public :: column_t, column_spring_t, new_column, column_deflection, column_buckles

   !> Largest number of pieces. The slope grows at most by a factor of e per piece.
   integer, parameter, public :: most_pieces = 600

   !> A spring between the beam and the ground.
   type :: column_spring_t
      complex(wp) :: at = 0           !< its position, an end of a piece [length]
      complex(wp) :: compliance = 0   !< [length/force], or [1/(force length)] against rotation
      integer :: slope = 0            !< 1: it resists the rotation; 0: the deflection
   end type column_spring_t

   !> A beam divided into pieces, in units of its length l and of the force E I/l**2. Values are
   !> complex to carry a complex step.
   type :: column_t
      real(wp) :: length = 1                 !< l [length]
      real(wp) :: unit = 1                   !< l**3/(E I) [length/force]
      complex(wp) :: stiffness = 1           !< bending stiffness, 1 but for the step
      complex(wp), allocatable :: ends(:)    !< (pieces + 1) ends of the pieces, ascending
      !> (pieces) axial force at the beginning of each piece; size 0: the force would require more
      !> than `most_pieces`
      complex(wp), allocatable :: N(:)
      complex(wp), allocatable :: slope(:)   !< (pieces) dN/dx in each piece
      type(column_spring_t), allocatable :: springs(:)
      integer, allocatable :: place(:)       !< (springs) number of the end where each spring acts
   end type column_t

contains

   !> Returns a beam divided into pieces that are shorter than sqrt(E I/|N|), the length over which
   !> the axial force bends the beam.
   !>
   !> stiffness  bending stiffness E I [force length**2]
   !> ends       (intervals + 1) ends of intervals, ascending from 0 to the length [length]; N is
   !>            linear in each interval
   !> N          (intervals) axial force at the beginning of each interval [force]
   !> slope      (intervals) dN/dx in each interval [force/length]
   !> springs    between the beam and the ground, at ends of intervals
   pure function new_column(stiffness, ends, N, slope, springs) result(column)
      complex(wp), intent(in) :: stiffness, ends(:), N(:), slope(:)
      type(column_spring_t), intent(in) :: springs(:)
      type(column_t) :: column
      real(wp) :: bends(size(N)), force
      integer :: parts(size(N)), first, i, k

      column%length = real(ends(size(ends)))
      force = real(stiffness)/column%length**2
      column%unit = column%length/force
      column%stiffness = stiffness/real(stiffness)
      column%springs = springs
      column%springs%at = springs%at/column%length
      column%springs%compliance = springs%compliance*column%length**(2*springs%slope)/column%unit
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
      column%ends = column%ends/column%length
      column%N = column%N/force
      column%slope = column%slope*column%length/force
      column%place = [(end_at(column, column%springs(i)%at), i=1, size(springs))]
   end function new_column

   !> Returns the number of the end of a piece that is at x. Positions are complex: the nearest end
   !> is the one that equals x.
   pure integer function end_at(self, x)
      type(column_t), intent(in) :: self
      complex(wp), intent(in) :: x

      end_at = minloc(abs(self%ends - x), dim=1)
   end function end_at

   !> Returns the deflection at x under a unit force at xi [length/force]. The result is NaN if the
   !> column would require more than `most_pieces`, and `huge` if the springs do not hold the beam.
   !>
   !> x, xi  ends of pieces [length]
   pure complex(wp) function column_deflection(self, x, xi) result(w)
      type(column_t), intent(in) :: self
      complex(wp), intent(in) :: x, xi
      complex(wp) :: left(4, 2), right(4, 2), row(2), unused(2), a(4, 4), b(4, 1)
      integer :: near, far, last
      logical :: regular

      w = ieee_value(1.0_wp, ieee_quiet_nan)
      if (size(self%N) == 0) return
      ! The influence function is symmetric: the force acts at the end that is further right.
      near = end_at(self, x/self%length)
      far = end_at(self, xi/self%length)
      last = max(near, far)
      call sweep(self, last, .true., min(near, far), left, row)
      call sweep(mirrored(self), size(self%ends) + 1 - last, .false., 0, right, unused)
      ! Seen from the left, slope and transverse force have the opposite sign.
      right([2, 4], :) = -right([2, 4], :)
      a(:, :2) = left
      a(:, 3:) = -right
      b(:, 1) = [0, 0, 0, 1]
      call eliminate(4, 1, a, b, regular)
      w = huge(self%unit)
      if (regular) w = sum(row*b(:2, 1))*self%unit
   end function column_deflection

   !> Returns the column seen from its other end.
   pure function mirrored(self)
      type(column_t), intent(in) :: self
      type(column_t) :: mirrored
      integer :: n

      n = size(self%N)
      mirrored = self
      mirrored%ends = self%ends(n + 1) - self%ends(n + 1:1:-1)
      mirrored%N = self%N + self%slope*(self%ends(2:) - self%ends(:n))
      mirrored%N = mirrored%N(n:1:-1)
      mirrored%slope = -self%slope(n:1:-1)
      mirrored%place = n + 2 - self%place
   end function mirrored

   !> Computes a basis of the states that the part to the left of an end allows, if no force acts
   !> on this part.
   !>
   !> last     number of the end
   !> springs  whether the springs at this end belong to the part
   !> watched  number of an end of the part
   !> basis    (4, 2) columns (w, theta, M, V)
   !> row      (2) deflection at `watched` in each state of the basis
   pure subroutine sweep(self, last, springs, watched, basis, row)
      type(column_t), intent(in) :: self
      integer, intent(in) :: last, watched
      logical, intent(in) :: springs
      complex(wp), intent(out) :: basis(4, 2), row(2)
      complex(wp) :: change(2, 2)
      integer :: i, k

      ! A free end.
      basis = 0
      basis(1, 1) = 1
      basis(2, 2) = 1
      row = 0
      do k = 1, last
         if (k > 1) then
            basis = matmul(transfer_of(self, k - 1), basis)
            call normalize(basis, change)
            row = matmul(row, change)
         end if
         do i = 1, size(self%springs)
            if (self%place(i) /= k .or. k == last .and. .not. springs) cycle
            call add_spring(self%springs(i), basis, change)
            row = matmul(row, change)
         end do
         if (k == watched) row = basis(1, :)
      end do
   end subroutine sweep

   !> Changes a basis so that two of its rows are the unit matrix: the two with the largest
   !> determinant.
   !>
   !> change  (2, 2) old basis times `change` is the new basis
   pure subroutine normalize(basis, change)
      complex(wp), intent(inout) :: basis(4, 2)
      complex(wp), intent(out) :: change(2, 2)
      complex(wp) :: best, minor
      integer :: i, j

      best = 0
      do i = 1, 3
         do j = i + 1, 4
            minor = basis(i, 1)*basis(j, 2) - basis(i, 2)*basis(j, 1)
            if (abs(minor) <= abs(best)) cycle
            best = minor
            change(:, 1) = [basis(j, 2), -basis(j, 1)]
            change(:, 2) = [-basis(i, 2), basis(i, 1)]
         end do
      end do
      change = change/best
      basis = matmul(basis, change)
   end subroutine normalize

   !> Adds a spring to the part to the left: its reaction R is one more state, and the deflection or
   !> slope is the compliance times R. The largest coefficient of this equation is eliminated.
   !>
   !> change  (2, 2) as in `normalize`, for the part without the spring
   pure subroutine add_spring(spring, basis, change)
      type(column_spring_t), intent(in) :: spring
      complex(wp), intent(inout) :: basis(4, 2)
      complex(wp), intent(out) :: change(2, 2)
      complex(wp) :: states(4, 3), equation(3), unknown(3, 2)
      integer :: k, next, pivot

      states(:, :2) = basis
      states(:, 3) = 0
      states(4 - spring%slope, 3) = 1
      equation = [basis(1 + spring%slope, :), -spring%compliance]
      pivot = maxloc(abs(equation), dim=1)
      unknown = 0
      next = 0
      do k = 1, 3
         if (k == pivot) cycle
         next = next + 1
         unknown(k, next) = 1
         unknown(pivot, next) = -equation(k)/equation(pivot)
      end do
      basis = matmul(states, unknown)
      change = unknown(:2, :)
   end subroutine add_spring

   !> Returns the matrix (4, 4) from the state (w, theta, M, V) at the beginning of piece k to that
   !> at its end.
   pure function transfer_of(self, k) result(t)
      type(column_t), intent(in) :: self
      integer, intent(in) :: k
      complex(wp) :: t(4, 4)
      complex(wp) :: first(3), second(3), forced(3)

      call solve_piece(self, k, first, second, forced)
      associate (EI => self%stiffness)
         t(1, :) = [(1.0_wp, 0.0_wp), first(3), second(3)/EI, forced(3)]
         t(2, :) = [(0.0_wp, 0.0_wp), first(1), second(1)/EI, forced(1)]
         t(3, :) = [(0.0_wp, 0.0_wp), EI*first(2), second(2), EI*forced(2)]
         t(4, :) = [0, 0, 0, 1]
      end associate
   end function transfer_of

   !> Returns whether the axial force buckles the beam: whether the stiffness matrix of the pieces,
   !> whose unknowns are deflection and slope at their ends, is not positive definite. Its blocks of
   !> two unknowns are eliminated from left to right. A column that would require more than
   !> `most_pieces` counts as buckled.
   pure logical function column_buckles(self) result(buckles)
      type(column_t), intent(in) :: self
      !> Compliance that stands for a rigid spring.
      real(wp), parameter :: rigid = 1e-12_wp
      !> `part` is the stiffness matrix of everything to the left, `moved` the displacements at the
      !> end of a piece for unit displacements at its beginning. Order: w, theta; V, M.
      real(wp) :: t(4, 4), part(2, 2), moved(2, 2), flexibility(2, 2), corner
      integer :: i, k

      buckles = .true.
      if (size(self%N) == 0) return
      part = 0
      do k = 1, size(self%ends)
         do i = 1, size(self%springs)
            if (self%place(i) /= k) cycle
            associate (s => 1 + self%springs(i)%slope)
               part(s, s) = part(s, s) + 1/max(rigid, real(self%springs(i)%compliance))
            end associate
         end do
         if (k == size(self%ends)) exit
         t = real(transfer_of(self, k))
         t(:, 3:) = t(:, [4, 3])
         t(3:, :) = t([4, 3], :)
         flexibility = t(:2, 3:)
         moved = t(:2, :2) + matmul(flexibility, part)
         ! The pivot block is the inverse of `flexibility` times `moved`.
         corner = (flexibility(2, 2)*moved(1, 1) - flexibility(1, 2)*moved(2, 1))/ &
            determinant(flexibility)
         if (.not. (corner > 0 .and. determinant(moved) > 0)) return
         part = matmul(t(3:, :2) + matmul(t(3:, 3:), part), inverse(moved))
      end do
      buckles = .not. (part(1, 1) > 0 .and. determinant(part) > 0)
   end function column_buckles

   !> Returns the determinant of a matrix (2, 2).
   pure real(wp) function determinant(a)
      real(wp), intent(in) :: a(2, 2)

      determinant = a(1, 1)*a(2, 2) - a(1, 2)*a(2, 1)
   end function determinant

   !> Returns the inverse of a matrix (2, 2).
   pure function inverse(a)
      real(wp), intent(in) :: a(2, 2)
      real(wp) :: inverse(2, 2)

      inverse = reshape([a(2, 2), -a(2, 1), -a(1, 2), a(1, 1)], [2, 2])/determinant(a)
   end function inverse

   !> Computes theta, theta' and the integral of theta at the end of piece k for three solutions.
   !>
   !> first   (3) the solution that begins with theta = 1, theta' = 0, without force
   !> second  (3) the solution that begins with theta = 0, theta' = 1, without force
   !> forced  (3) the solution that begins with theta = theta' = 0, with the transverse force 1
   pure subroutine solve_piece(self, k, first, second, forced)
      type(column_t), intent(in) :: self
      integer, intent(in) :: k
      complex(wp), intent(out) :: first(3), second(3), forced(3)

      first = series(self, k, [(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], (0.0_wp, 0.0_wp))
      second = series(self, k, [(0.0_wp, 0.0_wp), (1.0_wp, 0.0_wp)], (0.0_wp, 0.0_wp))
      forced = series(self, k, [(0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], (-1.0_wp, 0.0_wp))
   end subroutine solve_piece

   !> Solves theta'' = (N theta + force)/(E I) over piece k by a power series.
   !>
   !> begin   (2) theta and theta' at the beginning
   !> force   right-hand side, 0 or -1
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
