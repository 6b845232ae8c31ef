!> Derivatives of a free decay with respect to the roots of its modes, for fits in which each root
!> may deviate from that of the model (`deviation` of `time_record_t`).
module beamid_deviations
   use beamid_kinds, only: wp
   use beamid_residuals, only: residual_t
   use beamid_time_records, only: time_record_t
   implicit none
   private

   public :: deviation_columns, set_deviations

contains

   !> Sets the deviations of the roots of a motion in all its channels.
   !>
   !> first      number of its first channel
   !> deviation  (modes) [1/time]
   subroutine set_deviations(problem, first, deviation)
      type(residual_t), intent(inout) :: problem
      integer, intent(in) :: first
      complex(wp), intent(in) :: deviation(:)
      integer :: i

      do i = first, problem%last_channel(first)
         select type (observed => problem%parts(i)%observed)
         type is (time_record_t)
            observed%deviation = deviation
         end select
      end do
   end subroutine set_deviations

   !> Returns the derivatives of the motion of one mode with respect to real and imaginary part of
   !> its root. The motion is Re(a z), z proportional to e**(s tau).
   !>
   !> tau      (m) times since the first sample of the first channel [time]
   !> columns  (m, 2) Re z and -Im z
   !> c        (2) Re a and Im a
   pure function deviation_columns(tau, columns, c) result(derivative)
      real(wp), intent(in) :: tau(:), columns(:, :), c(2)
      real(wp) :: derivative(size(tau), 2)

      derivative(:, 1) = tau*(c(1)*columns(:, 1) + c(2)*columns(:, 2))
      derivative(:, 2) = tau*(c(1)*columns(:, 2) - c(2)*columns(:, 1))
   end function deviation_columns

end module beamid_deviations
