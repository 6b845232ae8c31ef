!> Polynomials that stand in for a density near its mode. A polynomial is fitted to some draws and
!> tested by others. Its largest error in the test tells how often it must be compared with the
!> density.
!>
!> The polynomial approximates the logarithm of the density or, if `power` is above 0, the density
!> to the power -1/power. If the standard deviation of the noise is integrated out, this is a sum of
!> squares, and needs fewer terms than its logarithm.
module beamid_surrogates
   use beamid_condensation, only: condense_matrix, condensed_t
   use beamid_densities, only: impossible
   use beamid_kinds, only: wp
   use beamid_sorting, only: sort
   implicit none
   private

   public :: surrogate_t, new_surrogate

   !> A polynomial of n coordinates.
   type :: surrogate_t
      real(wp) :: power = 0   !< as in `density_t`
      real(wp) :: top = 0     !< largest logarithm of the density, which scales the power
      real(wp), allocatable :: coefficient(:)   !< (terms)
      !> (terms) each term but the first is the term `parent` times the coordinate `factor`
      integer, allocatable :: parent(:), factor(:)
      !> (n, 2) unit of length of the coordinates below and above 0
      real(wp), allocatable :: width(:, :)
      !> square of the distance from 0 up to which the polynomial holds, in these units
      real(wp) :: reach = 0
      !> share of the draws at this distance at which the density is to be computed as well
      real(wp) :: slope = 0
      real(wp) :: least = 0.02_wp   !< smallest share of the draws
   contains
      procedure :: share, at, distrust
   end type surrogate_t

   !> Highest degree, and number of draws per term that the fit needs.
   integer, parameter :: highest = 8, draws_per_term = 4
   !> Shares of the draws that the fit gets, and that the polynomial is to cover.
   real(wp), parameter :: fitted = 0.75_wp, covered = 0.95_wp
   !> The share is so many times the largest error in the test.
   real(wp), parameter :: safety = 3
   !> The share grows with the sixth power of the distance, as the error of a polynomial of degree
   !> five does; squares of distances below this part of the reach count as this part.
   real(wp), parameter :: near = 0.3_wp

contains

   !> Fits a polynomial to draws. It holds nowhere if the density cannot be computed at one of them
   !> near the mode.
   !>
   !> y       (n, draws) coordinates
   !> value   (draws) logarithm of the density; `impossible` where it cannot be computed
   !> width   (n, 2) as in `surrogate_t`
   !> power   as in `density_t`
   subroutine new_surrogate(y, value, width, power, self)
      real(wp), intent(in) :: y(:, :), value(:), width(:, :), power
      type(surrogate_t), intent(out) :: self
      real(wp), allocatable :: terms(:, :), aims(:)
      real(wp), dimension(size(value)) :: squares, ordered
      real(wp) :: weight
      integer :: first, i, k
      type(condensed_t) :: found

      self%width = width
      self%power = power
      self%top = maxval(value)
      first = 1 + int(fitted*size(value))
      call set_terms(size(y, 1), first/draws_per_term, self)
      squares = [(square_of(self, y(:, i)), i=1, size(value))]
      ordered = squares
      call sort(ordered)
      self%reach = ordered(int(covered*size(value)))
      if (any(squares <= self%reach .and. .not. value > impossible)) then
         self%reach = 0
         return
      end if
      associate (inside => pack([(i, i=1, first - 1)], squares(:first - 1) <= self%reach))
         allocate (terms(size(inside), size(self%parent)), aims(size(inside)))
         do i = 1, size(inside)
            ! With these weights, errors of the logarithm count alike everywhere.
            weight = 1
            if (power > 0) weight = exp((value(inside(i)) - self%top)/power)
            terms(i, :) = weight*terms_at(self, y(:, inside(i)))
            aims(i) = -merge(1.0_wp, value(inside(i)), power > 0)
         end do
      end associate
      call condense_matrix(terms, aims, found)
      self%coefficient = -found%y
      do k = size(self%parent), 1, -1
         associate (R => found%factor, c => self%coefficient)
            if (.not. abs(R(k, k)) > 0) c(k) = 0
            if (abs(R(k, k)) > 0) c(k) = c(k)/R(k, k)
            c(:k - 1) = c(:k - 1) - c(k)*R(:k - 1, k)
         end associate
      end do
      do i = first, size(value)
         if (squares(i) <= self%reach) self%slope = max(self%slope, safety*abs(value(i) &
            - self%at(y(:, i)))/max(near, squares(i)/self%reach)**3)
      end do
   end subroutine new_surrogate

   !> Sets the terms of the highest degree for which they are not too many.
   pure subroutine set_terms(n, most, self)
      integer, intent(in) :: n, most
      type(surrogate_t), intent(inout) :: self
      integer :: before, degree, i, k, last

      self%parent = [0]
      self%factor = [1]
      before = 0
      do degree = 1, highest
         last = size(self%parent)
         associate (new => sum([(n - self%factor(k) + 1, k=before + 1, last)]))
            if (last + new > most) exit
         end associate
         do k = before + 1, last
            do i = self%factor(k), n
               self%parent = [self%parent, k]
               self%factor = [self%factor, i]
            end do
         end do
         before = last
      end do
   end subroutine set_terms

   !> Returns the terms, (terms), at y.
   pure function terms_at(self, y) result(terms)
      type(surrogate_t), intent(in) :: self
      real(wp), intent(in) :: y(:)
      real(wp) :: terms(size(self%parent))
      integer :: k

      terms(1) = 1
      do k = 2, size(terms)
         terms(k) = terms(self%parent(k))*y(self%factor(k))
      end do
   end function terms_at

   !> Returns the square of the distance from 0.
   pure real(wp) function square_of(self, y)
      type(surrogate_t), intent(in) :: self
      real(wp), intent(in) :: y(:)

      square_of = sum((y/merge(self%width(:, 1), self%width(:, 2), y < 0))**2)
   end function square_of

   !> Returns the share of the draws at y at which the density is to be computed as well; 1 where
   !> the polynomial does not hold. In the test, the logarithm of the density was wrong by at most
   !> a third of this share.
   pure real(wp) function share(self, y)
      class(surrogate_t), intent(in) :: self
      real(wp), intent(in) :: y(:)
      real(wp) :: place

      share = 1
      if (.not. self%reach > 0) return
      place = square_of(self, y)/self%reach
      if (place <= 1) share = min(1.0_wp, max(self%least, self%slope*max(near, place)**3))
   end function share

   !> Makes all shares four times as large; where they reach 1, the polynomial does not hold.
   pure subroutine distrust(self)
      class(surrogate_t), intent(inout) :: self

      self%least = 4*self%least
      self%slope = 4*self%slope
   end subroutine distrust

   !> Returns the logarithm of the density at y by the polynomial; `impossible` if the polynomial is
   !> no power of a density there.
   pure real(wp) function at(self, y)
      class(surrogate_t), intent(in) :: self
      real(wp), intent(in) :: y(:)

      at = dot_product(self%coefficient, terms_at(self, y))
      if (.not. self%power > 0) return
      if (at > 0) then
         at = self%top - self%power*log(at)
      else
         at = impossible
      end if
   end function at

end module beamid_surrogates
