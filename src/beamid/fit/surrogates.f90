!> Polynomials that stand in for the logarithm of a density near its mode. A polynomial is fitted to
!> some draws and tested by others. Its largest error in the test tells how often it must be
!> compared with the density.
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
      real(wp), allocatable :: coefficient(:)   !< (terms)
      !> (terms) each term but the first is the term `parent` times the coordinate `factor`
      integer, allocatable :: parent(:), factor(:)
      !> (n, 2) unit of length of the coordinates below and above 0
      real(wp), allocatable :: width(:, :)
      !> square of the distance from 0 up to which the polynomial holds, in these units
      real(wp) :: reach = 0
      !> share of the draws at this distance at which the density is to be computed as well
      real(wp) :: slope = 0
   contains
      procedure :: share, at
   end type surrogate_t

   !> Highest degree, and number of draws per term that the fit needs.
   integer, parameter :: highest = 8, draws_per_term = 10
   !> Shares of the draws that the fit gets, and that the polynomial is to cover.
   real(wp), parameter :: fitted = 0.75_wp, covered = 0.9_wp
   !> The share grows with the fourth power of the distance; squares of distances below this part of
   !> the reach count as this part. The error of a polynomial grows faster.
   real(wp), parameter :: near = 0.2_wp, least_share = 0.02_wp

contains

   !> Fits a polynomial to draws. It holds nowhere if the density cannot be computed at one of them
   !> near the mode.
   !>
   !> y       (n, draws) coordinates
   !> value   (draws) logarithm of the density; `impossible` where it cannot be computed
   !> width   (n, 2) as in `surrogate_t`
   subroutine new_surrogate(y, value, width, self)
      real(wp), intent(in) :: y(:, :), value(:), width(:, :)
      type(surrogate_t), intent(out) :: self
      real(wp), allocatable :: terms(:, :), aims(:)
      real(wp), dimension(size(value)) :: squares, ordered
      integer :: first, i, k
      type(condensed_t) :: found

      self%width = width
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
         allocate (terms(size(inside), size(self%parent)))
         do i = 1, size(inside)
            terms(i, :) = terms_at(self, y(:, inside(i)))
         end do
         aims = -value(inside)
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
         if (squares(i) <= self%reach) self%slope = max(self%slope, 2*abs(value(i) &
            - self%at(y(:, i)))/max(near, squares(i)/self%reach)**2)
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
   !> half of this share.
   pure real(wp) function share(self, y)
      class(surrogate_t), intent(in) :: self
      real(wp), intent(in) :: y(:)
      real(wp) :: place

      share = 1
      if (.not. self%reach > 0) return
      place = square_of(self, y)/self%reach
      if (place <= 1) share = min(1.0_wp, max(least_share, self%slope*max(near, place)**2))
   end function share

   !> Returns the polynomial at y.
   pure real(wp) function at(self, y)
      class(surrogate_t), intent(in) :: self
      real(wp), intent(in) :: y(:)

      at = dot_product(self%coefficient, terms_at(self, y))
   end function at

end module beamid_surrogates
