!> Multiples of the first mode's frequency beside the higher modes of a free decay.
!>
!> A spring, a clamp or a sensor that is not linear adds oscillations at the multiples of the
!> frequency of the first mode. Such an oscillation beside a mode shifts the estimate of its
!> frequency, even if the record shows one line only.
module beamid_multiples
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   implicit none
   private

   public :: order_beside, explain_by_multiple, columns

   integer, parameter :: columns = 4   !< number of factors of the oscillation at a multiple

contains

   !> Returns the order of the multiple of the first mode's frequency next to a mode; 0: the mode is
   !> too low or too high for a multiple.
   !>
   !> s  (modes) roots [1/time]
   !> k  number of the mode
   pure integer function order_beside(s, k) result(order)
      complex(wp), intent(in) :: s(:)
      integer, intent(in) :: k
      integer, parameter :: highest = 12

      order = 0
      if (.not. aimag(s(1)) > 0) return
      if (aimag(s(k)) < (highest + 0.5_wp)*aimag(s(1))) order = nint(aimag(s(k))/aimag(s(1)))
      if (order < 2) order = 0
   end function order_beside

   !> Computes the oscillation at a multiple of the first mode's frequency that, together with
   !> changes of the estimates, reduces the residuals of a fit most.
   !>
   !> The oscillation is any combination of cosine and sine, each of which decays at the rate of the
   !> first mode, like an error of the sensor in proportion to the motion, or at n times this rate,
   !> like the n-th power of the motion.
   !>
   !> t         (m) sample times of a record [time]
   !> s         root of the first mode [1/time]
   !> order     n, of the multiple
   !> first     row of the residuals that belongs to the first sample
   !> jacobian  (rows, quantities) derivatives of all residuals
   !> residual  (rows)
   !> d         (rows) the oscillation, in the unit of the residuals; 0 if it cannot be computed
   subroutine explain_by_multiple(t, s, order, first, jacobian, residual, d)
      real(wp), intent(in) :: t(:), jacobian(:, :), residual(:)
      complex(wp), intent(in) :: s
      integer, intent(in) :: order, first
      real(wp), intent(out) :: d(:)
      real(wp), parameter :: independent = 1e-10_wp   ! of a column that counts as independent
      real(wp) :: a(size(jacobian, 1), size(jacobian, 2) + columns), step(size(a, 2)), &
         length(size(a, 2))
      complex(wp) :: wave(size(t))
      integer :: j, n, rank

      d = 0
      n = size(jacobian, 2)
      a(:, :n) = jacobian
      a(:, n + 1:) = 0
      do j = 1, 2
         wave = exp(cmplx(merge(1, order, j == 1)*real(s), order*aimag(s), wp)*(t - t(1)))
         a(first:first + size(t) - 1, n + 2*j - 1) = wave%re
         a(first:first + size(t) - 1, n + 2*j) = wave%im
      end do
      length = norm2(a, dim=1)
      if (size(a, 1) <= size(a, 2) .or. .not. all(length > 0)) return
      call least_squares_step(a, residual, 1/length, spread(.true., 1, size(step)), independent, &
         step, rank)
      d = matmul(a(:, n + 1:), step(n + 1:))
   end subroutine explain_by_multiple

end module beamid_multiples
