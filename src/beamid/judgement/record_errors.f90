!> Errors that a record may have: the offset of its sensor, its scale, and a delay of its times.
module beamid_record_errors
   use beamid_experiments, only: experiment_t
   use beamid_frequency_responses, only: frequency_response_t
   use beamid_kinds, only: two_pi, wp
   implicit none
   private

   public :: errors_of, differentiate_error

contains

   !> Returns the names of the errors that a record may have. A motion of unknown size has no scale
   !> and no delay, and a table of modes no error at all.
   !>
   !> offset  whether the offset is to be among them
   pure function errors_of(experiment, offset) result(names)
      type(experiment_t), intent(in) :: experiment
      logical, intent(in) :: offset
      character(len=6), allocatable :: names(:)
      logical :: has_offset, is_known

      has_offset = offset .and. .not. allocated(experiment%observed)
      is_known = .not. experiment%excitation%modes > 0
      if (allocated(experiment%observed)) is_known = experiment%observed%kind() == 'frf'
      names = [character(len=6) :: 'offset', 'scale', 'delay']
      names = pack(names, [has_offset, is_known, is_known])
   end function errors_of

   !> Computes the effect of an error on the residuals of a record, model minus record.
   !>
   !> name      of the error
   !> residual  (m) of a fit [unit of a row]
   !> value     value of the case; 1 for the scale, a factor of the record, 0 for the delay
   !> least     least possible value
   !> slope     (m) derivatives of the residuals [unit of a row per unit of the error]
   subroutine differentiate_error(experiment, name, residual, value, least, slope)
      type(experiment_t), intent(in) :: experiment
      character(len=*), intent(in) :: name
      real(wp), intent(in) :: residual(:)
      real(wp), intent(out) :: value, least, slope(:)

      least = -huge(least)
      select case (name)
      case ('offset')
         value = experiment%offset
         slope = experiment%scale
      case ('scale')
         ! The model's curve: the noise of the record itself is that of the residuals, too.
         value = 1
         least = 0
         slope = -(experiment%measured + residual)
      case default
         value = 0
         if (.not. allocated(experiment%observed)) then
            slope = -derivative(experiment%samples, experiment%measured + residual)
            return
         end if
         select type (observed => experiment%observed)
         type is (frequency_response_t)
            associate (h => cmplx(observed%rate, two_pi*observed%frequency, wp) &
               *observed%lines_of(experiment%measured + residual))
               slope = -[real(h)/observed%noise, aimag(h)/observed%noise]
            end associate
         end select
      end select
   end subroutine differentiate_error

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
