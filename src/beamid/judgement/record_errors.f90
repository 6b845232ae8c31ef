!> Errors that a record may have: the offset of its sensor, its scale, and a delay of its times.
module beamid_record_errors
   use beamid_experiments, only: experiment_t
   use beamid_frequency_responses, only: frequency_response_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: record_error_t, errors_of

   !> One error, with the derivatives of the residuals of its record.
   type :: record_error_t
      character(len=6) :: name = ''         !< 'offset', 'scale' or 'delay'
      real(wp) :: value = 0                 !< value in the case; 0 for the delay
      real(wp) :: least = -huge(1.0_wp)     !< least possible value
      real(wp), allocatable :: slope(:)     !< (m) derivatives, model minus record [unit of a row]
   end type record_error_t

contains

   !> Returns the errors that a record may have. A motion of unknown size has no scale and no delay,
   !> and a table of modes none at all.
   !>
   !> residual  (m) of a fit, model minus record [unit of a row]
   !> offset    whether the offset is to be among them
   function errors_of(experiment, residual, offset) result(list)
      type(experiment_t), intent(in) :: experiment
      real(wp), intent(in) :: residual(:)
      logical, intent(in) :: offset
      type(record_error_t), allocatable :: list(:)
      complex(wp), parameter :: i = (0.0_wp, 1.0_wp)
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
      real(wp) :: slope(size(residual))

      allocate (list(0))
      if (.not. allocated(experiment%observed)) then
         if (offset) list = [record_error_t('offset', experiment%offset, &
            slope=spread(experiment%scale, 1, size(residual)))]
         if (experiment%excitation%modes > 0) return
         slope = -derivative(experiment%samples, experiment%measured + residual)
      else
         select type (observed => experiment%observed)
         type is (frequency_response_t)
            associate (h => i*two_pi*observed%frequency*observed%lines_of(experiment%measured &
               + residual))
               slope = -[real(h)/observed%noise, aimag(h)/observed%noise]
            end associate
         class default
            return
         end select
      end if
      list = [list, record_error_t('scale', experiment%scale, 0.0_wp, -experiment%measured &
         /experiment%scale), record_error_t('delay', slope=slope)]
   end function errors_of

   !> Returns the derivative of a curve by differences over two steps.
   !>
   !> t, y  (m) times, ascending, and values
   pure function derivative(t, y) result(slope)
      real(wp), intent(in) :: t(:), y(:)
      real(wp) :: slope(size(t))
      integer :: k, m

      m = size(t)
      slope = 0
      do k = 1, m
         associate (before => max(1, k - 1), behind => min(m, k + 1))
            if (behind > before) slope(k) = (y(behind) - y(before))/(t(behind) - t(before))
         end associate
      end do
   end function derivative

end module beamid_record_errors
