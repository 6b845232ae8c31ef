!> Linear constraints b'w = 0 on the unknowns of band matrices, met by elimination.
!>
!> Of each the unknown e with the largest share of b goes. Another one that b touches takes along
!> the next on the way to e whose share is no smaller, as far as keeps b'w at zero. That is a
!> neighbour where the shares rise towards e, as those of splines at a place do, and the band grows
!> no wider.
module beamid_constraints
   use beamid_bands, only: band_t, new_band
   use beamid_kinds, only: wp
   implicit none
   private

   public :: constraints_t

   !> Unknown j of those that are left moves w(own(j)) by 1 and w(partner(j)) by share(j).
   type :: elimination_t
      integer, allocatable :: own(:), partner(:)
      real(wp), allocatable :: share(:)   !< |share| <= 1
   end type elimination_t

   type :: constraints_t
      !> Whether one follows from the others, or all together leave nothing to move.
      logical :: too_many = .false.
      type(elimination_t), allocatable, private :: all(:)
   contains
      procedure :: add
      procedure :: number
      procedure :: of_matrix
      procedure :: of_vector
      procedure :: expanded
   end type constraints_t

contains

   !> One more constraint; sets `too_many` where there is nothing left to eliminate.
   !>
   !> b  (n) in the unknowns before any elimination
   subroutine add(self, b)
      class(constraints_t), intent(inout) :: self
      real(wp), intent(in) :: b(:)
      !> What the others leave of a row counts down to here: below it is round-off.
      real(wp), parameter :: least = 1e-10_wp
      type(elimination_t) :: next
      real(wp), allocatable :: row(:)
      integer :: e, i, j, k

      if (.not. allocated(self%all)) allocate (self%all(0))
      row = self%of_vector(b)
      if (size(row) < 2 .or. .not. maxval(abs(row)) > least*maxval(abs(b))) then
         self%too_many = .true.
         return
      end if
      e = maxloc(abs(row), dim=1)
      next%own = [(i, i=1, e - 1), (i, i=e + 1, size(row))]
      next%partner = next%own
      next%share = 0*row(next%own)
      do j = 1, size(next%own)
         i = next%own(j)
         if (.not. abs(row(i)) > 0) cycle
         k = i + sign(1, e - i)
         do while (abs(row(k)) < abs(row(i)))
            k = k + sign(1, e - i)
         end do
         next%partner(j) = k
         next%share(j) = -row(i)/row(k)
      end do
      self%all = [self%all, next]
   end subroutine add

   !> How many unknowns are eliminated.
   pure integer function number(self)
      class(constraints_t), intent(in) :: self

      number = 0
      if (allocated(self%all)) number = size(self%all)
   end function number

   !> T'A T, T the map from the unknowns that are left to all; of matrices that are alike in order
   !> and half-bandwidth the results are too.
   function of_matrix(self, matrix) result(condensed)
      class(constraints_t), intent(in) :: self
      type(band_t), intent(in) :: matrix
      type(band_t) :: condensed
      integer :: c

      condensed = matrix
      do c = 1, self%number()
         condensed = condense(self%all(c), condensed)
      end do
   end function of_matrix

   !> The same of one elimination.
   function condense(by, a) result(condensed)
      type(elimination_t), intent(in) :: by
      type(band_t), intent(in) :: a
      type(band_t) :: condensed
      integer :: i, j, n

      n = size(by%own)
      associate (own => by%own, partner => by%partner, share => by%share)
         condensed = new_band(n, maxval([(findloc(min(own, partner) <= max(own(j), partner(j)) &
            + a%kd, .true., dim=1, back=.true.) - j, j=1, n)]))
         do j = 1, n
            do i = j, min(n, j + condensed%kd)
               call condensed%add(i, j, a%element(own(i), own(j)) &
                  + share(i)*a%element(partner(i), own(j)) &
                  + share(j)*a%element(own(i), partner(j)) &
                  + share(i)*share(j)*a%element(partner(i), partner(j)))
            end do
         end do
      end associate
   end function condense

   !> T'f.
   pure function of_vector(self, f) result(condensed)
      class(constraints_t), intent(in) :: self
      real(wp), intent(in) :: f(:)
      real(wp), allocatable :: condensed(:)
      integer :: c

      condensed = f
      do c = 1, self%number()
         associate (by => self%all(c))
            condensed = condensed(by%own) + by%share*condensed(by%partner)
         end associate
      end do
   end function of_vector

   !> T q: all unknowns from those that are left.
   pure function expanded(self, q) result(w)
      class(constraints_t), intent(in) :: self
      real(wp), intent(in) :: q(:)
      real(wp), allocatable :: w(:), fewer(:)
      integer :: c, j

      w = q
      do c = self%number(), 1, -1
         call move_alloc(w, fewer)
         allocate (w(size(fewer) + 1), source=0.0_wp)
         associate (by => self%all(c))
            w(by%own) = fewer
            do j = 1, size(fewer)
               w(by%partner(j)) = w(by%partner(j)) + by%share(j)*fewer(j)
            end do
         end associate
      end do
   end function expanded

end module beamid_constraints
