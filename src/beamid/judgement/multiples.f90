!> Multiples of the first mode's frequency beside the higher modes of a free decay.
!>
!> A spring, a clamp or a sensor that is not linear adds oscillations at the multiples of the
!> frequency of the first mode. Such an oscillation beside a mode shifts the estimate of its
!> frequency, even if the record shows one line only.
module beamid_multiples
   use beamid_condensation, only: condense, condensed_t, rows_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kernels, only: block_rows
   use beamid_kinds, only: wp
   implicit none
   private

   public :: order_beside, explain_by_multiple, columns

   integer, parameter :: columns = 4   !< number of factors of the oscillation at a multiple

   !> The rows of a fit with the oscillation at a multiple as further unknowns.
   type, extends(rows_t) :: wider_rows_t
      real(wp), pointer :: jacobian(:, :) => null(), residual(:) => null()
      real(wp), pointer :: t(:) => null()   !< sample times of the record [time]
      integer :: first = 1                  !< row of its first sample
      integer :: order = 2                  !< of the multiple
      complex(wp) :: s = 0                  !< root of the first mode [1/time]
   contains
      procedure :: fill, oscillation
   end type wider_rows_t

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
      real(wp), intent(in), target :: t(:), jacobian(:, :), residual(:)
      complex(wp), intent(in) :: s
      integer, intent(in) :: order, first
      real(wp), intent(out) :: d(:)
      real(wp), parameter :: independent = 1e-10_wp   ! of a column that counts as independent
      type(wider_rows_t) :: rows
      type(condensed_t) :: condensed
      real(wp), dimension(size(jacobian, 2) + columns) :: length, step
      integer :: k, n, rank

      d = 0
      n = size(jacobian, 2)
      rows%rows = size(jacobian, 1)
      rows%columns = n + columns
      if (rows%rows <= rows%columns) return
      rows%jacobian => jacobian
      rows%residual => residual
      rows%t => t
      rows%first = first
      rows%order = order
      rows%s = s
      call condense(rows, condensed)
      length = norm2(condensed%factor, dim=1)
      if (.not. all(length > 0)) return
      call least_squares_step(condensed%factor, condensed%y, 1/length, spread(.true., 1, &
         size(step)), independent, step, rank)
      do k = 1, size(t)
         d(first + k - 1) = dot_product(rows%oscillation(k), step(n + 1:))
      end do
   end subroutine explain_by_multiple

   !> Computes a block of rows.
   subroutine fill(self, first, x)
      class(wider_rows_t), intent(in) :: self
      integer, intent(in) :: first
      real(wp), intent(inout), contiguous :: x(:, :)
      integer :: k, last, n

      n = size(self%jacobian, 2)
      last = min(first + block_rows - 1, self%rows)
      x(:last - first + 1, :n) = self%jacobian(first:last, :)
      x(:last - first + 1, n + columns + 1) = self%residual(first:last)
      do k = first, last
         x(k - first + 1, n + 1:n + columns) = self%oscillation(k - self%first + 1)
      end do
   end subroutine fill

   !> Returns cosine and sine of the multiple at a sample, with either decay; 0 if the sample is not
   !> of the record.
   !>
   !> k  number of the sample in the record
   pure function oscillation(self, k) result(values)
      class(wider_rows_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: values(columns)
      real(wp) :: decay, time
      complex(wp) :: slow

      values = 0
      if (k < 1 .or. k > size(self%t)) return
      time = self%t(k) - self%t(1)
      decay = real(self%s)*time
      slow = exp(cmplx(decay, self%order*aimag(self%s)*time, wp))
      values(:2) = [slow%re, slow%im]
      values(3:) = values(:2)*exp((self%order - 1)*decay)
   end function oscillation

end module beamid_multiples
