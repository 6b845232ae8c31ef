!> Linear unknowns of a motion: amplitudes of free modes and offsets of sensors.
!>
!> The prediction of a model is f(p) + Phi(p) c. The columns of Phi are combinations of fixed
!> functions, the basis, with weights that depend on the parameters p. `beamid_projection`
!> eliminates c.
module beamid_linear_unknowns
   use beamid_condensation, only: condense_matrix, condensed_t, few_rows, rows_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: linear_t, stack_channels

   !> The matrix Phi = basis*weights(:, :, 0) of k linear unknowns, and its derivatives with respect
   !> to the parameters in the same basis.
   type :: linear_t
      real(wp), allocatable :: basis(:, :)        !< (m, b) basis functions at the data
      real(wp), allocatable :: weights(:, :, :)   !< (b, k, 0:parameters) 0: Phi; p: dPhi/dp
      !> all rows of the basis and of the residuals, block by block, if `basis` is condensed and
      !> they are known in this way
      class(rows_t), allocatable :: rows
   contains
      procedure :: columns
      procedure :: complete
      procedure :: add_change
      procedure :: condense
      procedure :: take_condensed
   end type linear_t

contains

   !> Returns Phi (m, k), or its derivative with respect to parameter p if p > 0.
   pure function columns(self, p)
      class(linear_t), intent(in) :: self
      integer, intent(in) :: p
      real(wp), allocatable :: columns(:, :)

      columns = matmul(self%basis, self%weights(:, :, p))
   end function columns

   !> Sets an empty basis if there are no linear unknowns.
   !>
   !> m           number of rows
   !> parameters  number of parameters
   pure subroutine complete(self, m, parameters)
      class(linear_t), intent(inout) :: self
      integer, intent(in) :: m, parameters

      if (allocated(self%basis)) return
      allocate (self%basis(m, 0), self%weights(0, 0, 0:parameters))
   end subroutine complete

   !> Adds (dPhi/dp) c to column p of dy, for every parameter p.
   !>
   !> c       (k) values of the linear unknowns
   !> r       (m) residuals
   !> dy      (m, parameters) derivatives of the residuals
   !> along   (k, parameters) products (dPhi/dp)'r, which variable projection needs
   !> change  (b, parameters) weights of the basis in (dPhi/dp) c
   pure subroutine add_change(self, c, r, dy, along, change)
      class(linear_t), intent(in) :: self
      real(wp), intent(in) :: c(:), r(:)
      real(wp), intent(inout) :: dy(:, :)
      real(wp), intent(out) :: along(:, :), change(:, :)
      real(wp) :: products(size(self%basis, 2))
      integer :: p

      products = matmul(r, self%basis)
      do p = 1, size(dy, 2)
         change(:, p) = matmul(self%weights(:, :, p), c)
         along(:, p) = matmul(products, self%weights(:, :, p))
      end do
      dy = dy + matmul(self%basis, change)
   end subroutine add_change

   !> Replaces the rows of residuals, derivatives and basis by fewer, which have the same products
   !> with one another. Few rows stay as they are.
   !>
   !> y   (m) residuals; on return (p + b + 1), p parameters
   !> dy  (m, p) their derivatives
   subroutine condense(self, y, dy)
      class(linear_t), intent(inout) :: self
      real(wp), allocatable, intent(inout) :: y(:), dy(:, :)
      type(condensed_t) :: condensed
      real(wp), allocatable :: columns(:, :)
      integer :: p

      if (size(y) < few_rows) return
      p = size(dy, 2)
      allocate (columns(size(y), p + size(self%basis, 2)))
      columns(:, :p) = dy
      columns(:, p + 1:) = self%basis
      call condense_matrix(columns, y, condensed)
      call self%take_condensed(condensed, y, dy, p)
   end subroutine condense

   !> Takes condensed rows: of the derivatives, of the basis and of the residuals.
   !>
   !> condensed  of [dy basis] and y; or, if y does not depend on the parameters, of the basis and y
   !> y, dy      (rows) and (rows, p)
   !> p          number of columns of dy that have been condensed; the others are 0
   subroutine take_condensed(self, condensed, y, dy, p)
      class(linear_t), intent(inout) :: self
      type(condensed_t), intent(in) :: condensed
      real(wp), allocatable, intent(inout) :: y(:), dy(:, :)
      integer, intent(in) :: p
      integer :: k, n

      k = size(condensed%y)
      n = size(dy, 2)
      y = [condensed%y, condensed%left]
      deallocate (dy)
      allocate (dy(k + 1, n), source=0.0_wp)
      dy(:k, :p) = condensed%factor(:, :p)
      if (allocated(self%basis)) deallocate (self%basis)
      allocate (self%basis(k + 1, size(condensed%factor, 2) - p), source=0.0_wp)
      self%basis(:k, :) = condensed%factor(:, p + 1:)
   end subroutine take_condensed

   !> Combines the linear unknowns of several channels of one motion.
   !>
   !> The rows of the channels follow one another. All channels share the unknowns of the modes; the
   !> other unknowns of a channel, its offset, are its own.
   !>
   !> channels  linear unknowns of each channel; on return empty if there is only one
   !> modes     number of unknowns of the modes
   subroutine stack_channels(channels, modes, linear)
      type(linear_t), intent(inout) :: channels(:)
      integer, intent(in) :: modes
      type(linear_t), intent(out) :: linear
      integer :: functions, i, m, own, place, row

      if (size(channels) == 1) then
         call move_alloc(channels(1)%basis, linear%basis)
         call move_alloc(channels(1)%weights, linear%weights)
         return
      end if
      m = sum([(size(channels(i)%basis, 1), i=1, size(channels))])
      functions = sum([(size(channels(i)%basis, 2), i=1, size(channels))])
      allocate (linear%basis(m, functions), source=0.0_wp)
      own = sum([(size(channels(i)%weights, 2) - modes, i=1, size(channels))])
      allocate (linear%weights(functions, modes + own, 0:ubound(channels(1)%weights, 3)), &
         source=0.0_wp)
      row = 0
      own = modes
      place = 0
      do i = 1, size(channels)
         associate (basis => channels(i)%basis, weights => channels(i)%weights)
            m = size(basis, 1)
            functions = size(basis, 2)
            linear%basis(row + 1:row + m, place + 1:place + functions) = basis
            linear%weights(place + 1:place + functions, :modes, :) = weights(:, :modes, :)
            linear%weights(place + 1:place + functions, own + 1:own + size(weights, 2) - modes, &
               :) = weights(:, modes + 1:, :)
            own = own + size(weights, 2) - modes
            row = row + m
            place = place + functions
         end associate
      end do
   end subroutine stack_channels

end module beamid_linear_unknowns
