!> Linear constraints b'w = 0 on the unknowns of band matrices, met by elimination: of each the
!> unknown with the largest share follows from the others, and the band grows by what it touches.
module beamid_constraints
   use beamid_bands, only: band_t, new_band
   use beamid_kinds, only: wp
   implicit none
   private

   public :: constraints_t

   !> w(place) = -sum of share*w over the others.
   type :: constraint_t
      integer :: place = 0
      real(wp), allocatable :: share(:)   !< 0 at `place`
   end type constraint_t

   type :: constraints_t
      type(constraint_t), allocatable, private :: all(:)
   contains
      procedure :: add
      procedure :: number
      procedure :: of_matrix
      procedure :: of_vector
      procedure :: expanded
   end type constraints_t

contains

   !> One more constraint.
   !>
   !> b  (n) in the unknowns before any elimination
   subroutine add(self, b)
      class(constraints_t), intent(inout) :: self
      real(wp), intent(in) :: b(:)
      type(constraint_t) :: constraint

      if (.not. allocated(self%all)) allocate (self%all(0))
      constraint%share = self%of_vector(b)
      constraint%place = maxloc(abs(constraint%share), dim=1)
      constraint%share = constraint%share/constraint%share(constraint%place)
      constraint%share(constraint%place) = 0
      self%all = [self%all, constraint]
   end subroutine add

   !> How many there are.
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
      type(band_t) :: condensed, wide
      integer :: c, i, j, k

      condensed = matrix
      if (.not. allocated(self%all)) return
      do c = 1, size(self%all)
         associate (e => self%all(c)%place, share => self%all(c)%share, a => condensed)
            wide = new_band(a%n - 1, min(2*a%kd, a%n - 2))
            do j = 1, a%n
               do i = j, min(a%n, j + wide%kd + 1)
                  k = i - merge(1, 0, i > e) - (j - merge(1, 0, j > e))
                  if (i == e .or. j == e .or. k > wide%kd) cycle
                  call wide%add(i - merge(1, 0, i > e), j - merge(1, 0, j > e), a%element(i, j) &
                     - share(i)*a%element(e, j) - share(j)*a%element(e, i) &
                     + share(i)*share(j)*a%element(e, e))
               end do
            end do
         end associate
         condensed = wide
      end do
   end function of_matrix

   !> T'f.
   pure function of_vector(self, f) result(condensed)
      class(constraints_t), intent(in) :: self
      real(wp), intent(in) :: f(:)
      real(wp), allocatable :: condensed(:)
      integer :: c

      condensed = f
      if (.not. allocated(self%all)) return
      do c = 1, size(self%all)
         associate (e => self%all(c)%place)
            condensed = condensed - self%all(c)%share*condensed(e)
            condensed = [condensed(:e - 1), condensed(e + 1:)]
         end associate
      end do
   end function of_vector

   !> T q: all unknowns from those that are left.
   pure function expanded(self, q) result(w)
      class(constraints_t), intent(in) :: self
      real(wp), intent(in) :: q(:)
      real(wp), allocatable :: w(:)
      integer :: c

      w = q
      if (.not. allocated(self%all)) return
      do c = size(self%all), 1, -1
         associate (e => self%all(c)%place)
            w = [w(:e - 1), 0.0_wp, w(e:)]
            w(e) = -dot_product(self%all(c)%share, w)
         end associate
      end do
   end function expanded

end module beamid_constraints
