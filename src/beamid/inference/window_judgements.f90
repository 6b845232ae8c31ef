!> Judges the fit of one window of a long record: whether one set of parameters explains it, and how
!> well it determines one of them.
module beamid_window_judgements
   use beamid_kinds, only: wp
   use beamid_segments, only: step_t
   use beamid_window_searches, only: found_t, window_segments
   implicit none
   private

   public :: flag_of, noise_of, precision_of, precision_t

   !> How well a window determines a parameter.
   type :: precision_t
      real(wp) :: variance = 0     !< of the searched variable; 0: the parameter is at a bound
      real(wp) :: half_width = 0   !< of the 95 % interval
      logical :: contradicts = .false.   !< the halves of the window contradict each other
   end type precision_t

   !> A window is flagged 'moving' if the mean square of a segment is `uneven` times that of the
   !> window, and `deviations` standard deviations above it; ...
   real(wp), parameter :: uneven = 2.25_wp, deviations = 5
   !> ... if the share `gross` of the energy is unexplained, and the mean square of the residuals is
   !> `above_floor` times the least of all windows; ...
   real(wp), parameter :: gross = 0.0625_wp, above_floor = 9
   !> ... or if its halves are `apart` standard errors apart. From `doubtful` standard errors on,
   !> the interval is wider by their difference.
   real(wp), parameter :: apart = 4, doubtful = 2
   !> Least energy of a motion that is seen, in variances of the noise, and its least share of the
   !> energy of the window.
   real(wp), parameter :: visible = 50, least_share = 0.5_wp

contains

   !> Returns the mean square of the residuals of a fit, in weighted rows; huge if there is no fit.
   pure real(wp) function noise_of(found) result(variance)
      type(found_t), intent(in) :: found

      variance = huge(variance)
      if (found%sum_of_squares < huge(variance)) variance = found%sum_of_squares &
         /(sum(found%segments%rows) - size(found%step%change))
   end function noise_of

   !> Returns the flag of a fit: '', 'moving' or 'unseen'.
   !>
   !> total  energy of the window about its mean, in weighted rows
   !> floor  least `noise_of` of any window
   pure function flag_of(found, total, floor) result(flag)
      type(found_t), intent(in) :: found
      real(wp), intent(in) :: total, floor
      character(len=6) :: flag
      real(wp) :: left, mean

      flag = 'unseen'
      left = found%sum_of_squares
      if (.not. left < huge(left)) return
      if (total - left < visible*noise_of(found)) return
      flag = 'moving'
      mean = left/sum(found%segments%rows)
      if (any(found%squares/found%segments%rows > mean*max(uneven, 1 + deviations*sqrt(2.0_wp &
         /found%segments%rows)))) return
      if (left > gross*total .and. noise_of(found) > above_floor*floor) return
      if (left > (1 - least_share)*total) then
         flag = 'unseen'
      else if (found%has_settled) then
         flag = ''
      end if
   end function flag_of

   !> Returns how well a window determines a parameter.
   !>
   !> k  place of the parameter
   function precision_of(found, k) result(precision)
      type(found_t), intent(in) :: found
      integer, intent(in) :: k
      type(precision_t) :: precision
      type(step_t) :: early, late
      real(wp) :: plain, robust, difference, error, doubt
      logical :: held(size(found%step%change))
      integer :: n

      plain = found%variance*found%step%inverse(k, k)
      if (.not. plain > 0) return
      robust = found%segments%robust_variance(k, found%step, found%variance)
      precision%variance = max(plain, robust)
      held = [(.not. found%step%inverse(n, n) > 0, n=1, size(held))]
      early = found%segments%step(1, window_segments/2, held)
      late = found%segments%step(window_segments/2 + 1, window_segments, held)
      doubt = 0
      if (early%is_regular .and. late%is_regular) then
         difference = abs(early%change(k) - late%change(k))
         error = sqrt(found%variance*(early%inverse(k, k) + late%inverse(k, k)) &
            *precision%variance/plain)
         if (difference > doubtful*error) doubt = difference
         precision%contradicts = difference > apart*error
      end if
      ! Normal quantile for the many residuals, Student's with 9 degrees of freedom for the scatter
      ! of ten segments.
      precision%half_width = sqrt(max(1.960_wp**2*plain, 2.262_wp**2*robust)) + doubt
   end function precision_of

end module beamid_window_judgements
