!> Weights of the linear unknowns of a free motion, the two motions of each mode and the offset of
!> the sensor, in its basis functions.
module beamid_mode_weights
   use beamid_free_motion, only: free_mode_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   implicit none
   private

   public :: set_weights

contains

   !> Sets the weights of the basis functions of a free motion in its linear unknowns.
   !>
   !> formula     of the observation
   !> parameters  number of parameters
   !> offset      whether the offset of the sensor is unknown
   pure subroutine set_weights(modes, formula, parameters, offset, linear)
      type(free_mode_t), intent(in) :: modes(:)
      integer, intent(in) :: formula, parameters
      logical, intent(in) :: offset
      type(linear_t), intent(inout) :: linear
      integer :: b, k, n, p

      n = 2*sum([(size(modes(k)%row, 1), k=1, size(modes))]) + merge(1, 0, offset)
      allocate (linear%weights(n, 2*size(modes) + merge(1, 0, offset), 0:parameters), source=0.0_wp)
      b = 0
      do k = 1, size(modes)
         n = 2*size(modes(k)%row, 1)
         linear%weights(b + 1:b + n, 2*k - 1:2*k, 0) = pair(modes(k)%row(:, formula))
         do p = 1, parameters
            linear%weights(b + 1:b + n, 2*k - 1:2*k, p) = pair(modes(k)%drow(:, formula, p))
         end do
         b = b + n
      end do
      if (offset) linear%weights(b + 1, 2*size(modes) + 1, 0) = 1
   end subroutine set_weights

   !> Returns the weights of Re(row*states) and of -Im(row*states) in the basis of the real and the
   !> imaginary parts of the states.
   !>
   !> row      (states)
   !> weights  (2*states, 2) first the real parts, then the imaginary parts; one column for each
   !>          motion
   pure function pair(row) result(weights)
      complex(wp), intent(in) :: row(:)
      real(wp) :: weights(2*size(row), 2)

      weights(:, 1) = [real(row), -aimag(row)]
      weights(:, 2) = [-aimag(row), -real(row)]
   end function pair

end module beamid_mode_weights
