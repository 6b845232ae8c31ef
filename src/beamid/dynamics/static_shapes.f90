!> Static shapes of a structure whose points have prescribed displacements, as when its rigid
!> supports are displaced.
module beamid_static_shapes
   use beamid_bands, only: band_t
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgesv
   implicit none
   private

   public :: find_static_shape

contains

   !> Computes the static shape that has prescribed values at given points.
   !>
   !> stiffness  K of n unknowns; out: a Cholesky factor
   !> springs    (points) stiffness to add at each point. It has no effect on the shape, but makes K
   !>            regular for a beam that only these points hold.
   !> rows       (n, points) displacement or slope at a point = row . shape
   !> values     (points) prescribed displacement or slope
   !> shape      (n) 0 if the stiffness is not positive definite
   subroutine find_static_shape(stiffness, springs, rows, values, shape)
      type(band_t), intent(inout) :: stiffness
      real(wp), intent(in) :: springs(:), rows(:, :), values(:)
      real(wp), intent(out) :: shape(:)
      real(wp) :: answers(size(rows, 1), size(rows, 2)), flexibility(size(values), size(values)), &
         forces(size(values), 1)
      logical :: positive
      integer :: info, k, pivots(size(values))

      shape = 0
      do k = 1, size(values)
         call stiffness%add_rank_one(springs(k), rows(:, k))
      end do
      call stiffness%factor(positive)
      if (.not. positive) return
      ! Column k of the answers is the shape under a unit force at point k.
      answers = rows
      do k = 1, size(values)
         call stiffness%solve(answers(:, k))
      end do
      flexibility = matmul(transpose(rows), answers)
      forces(:, 1) = values
      call dgesv(size(values), 1, flexibility, size(values), pivots, forces, size(values), info)
      if (info == 0) shape = matmul(answers, forces(:, 1))
   end subroutine find_static_shape

end module beamid_static_shapes
