!> Linear constraints b'w = 0 on the unknowns w of band matrices, imposed by elimination. They
!> represent rigid supports in the spline space.
!>
!> Each constraint eliminates the unknown e with the largest |b_e|. Every other unknown i with
!> b_i /= 0 is coupled with a partner: the next unknown k, from i towards e, with |b_k| >= |b_i|.
!> A unit change of w_i then changes w_k by -b_i/b_k, so that b'w stays zero. For the values of
!> splines at a point, |b| increases towards e; the partner is then the neighbour of i, and the
!> half-bandwidth does not grow.
module beamid_constraints
   use beamid_bands, only: band_t, new_band
   use beamid_kinds, only: wp
   implicit none
   private

   public :: constraints_t

   !> One elimination: a unit of the remaining unknown j stands for w(own(j)) = 1 and
   !> w(partner(j)) = share(j).
   type :: elimination_t
      integer, allocatable :: own(:)      !< (remaining) index of the unknown itself
      !> (remaining) index of its partner, or own(j) if it has none
      integer, allocatable :: partner(:)
      real(wp), allocatable :: share(:)   !< (remaining) -b_own/b_partner, |share| <= 1
   end type elimination_t

   !> A list of constraints. T is the matrix that maps the remaining unknowns q to all, w = T q.
   type :: constraints_t
      !> .true.: a constraint depends on the others, or no unknown remains
      logical :: too_many = .false.
      type(elimination_t), allocatable, private :: all(:)   !< one elimination for each constraint
   contains
      procedure :: add, number, of_matrix, of_vector, of_vectors, expanded, kept
   end type constraints_t

contains

   !> Adds a constraint, or sets `too_many` if it leaves no unknown or depends on the others.
   !>
   !> b  (n) coefficients of all unknowns w, before any elimination
   subroutine add(self, b)
      class(constraints_t), intent(inout) :: self
      real(wp), intent(in) :: b(:)
      !> Least relative size of a row after the other eliminations; a smaller row is round-off.
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

   !> Returns the number of constraints, and of eliminated unknowns.
   pure integer function number(self)
      class(constraints_t), intent(in) :: self

      number = 0
      if (allocated(self%all)) number = size(self%all)
   end function number

   !> Returns T'A T for a band matrix A. Matrices of equal order and half-bandwidth have results of
   !> equal order and half-bandwidth.
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

   !> Applies one elimination to a band matrix.
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

   !> Returns T'f for a vector f of all unknowns.
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

   !> Returns T'f for vectors f of all unknowns, the columns of an array.
   pure function of_vectors(self, f) result(condensed)
      class(constraints_t), intent(in) :: self
      real(wp), intent(in) :: f(:, :)
      real(wp) :: condensed(size(f, 1) - self%number(), size(f, 2))
      integer :: k

      do k = 1, size(f, 2)
         condensed(:, k) = self%of_vector(f(:, k))
      end do
   end function of_vectors

   !> Returns the entries of a vector of all unknowns that belong to the remaining unknowns.
   pure function kept(self, values)
      class(constraints_t), intent(in) :: self
      real(wp), intent(in) :: values(:)
      real(wp), allocatable :: kept(:)
      integer :: c

      kept = values
      do c = 1, self%number()
         kept = kept(self%all(c)%own)
      end do
   end function kept

   !> Returns all unknowns w = T q from the remaining unknowns q.
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
