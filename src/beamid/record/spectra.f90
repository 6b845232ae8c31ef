!> Finds lines in the spectrum of a record, decaying oscillations that exceed their surroundings.
!> The search for start values assigns them to modes.
module beamid_spectra
   use beamid_fourier, only: phasor_sums
   use beamid_kinds, only: two_pi, wp
   use beamid_sorting, only: median
   implicit none
   private

   public :: line_t, condense, strongest_line, strongest_peak, too_near, noise_near, &
      noise_floor, near_mains, order_of_multiple

   !> A spectral line of a record, which is a decaying oscillation.
   type :: line_t
      real(wp) :: frequency = 0    !< [1/time]
      real(wp) :: decay = 0        !< rate of exponential decay [1/time]
      real(wp) :: energy = 0       !< share of the variance of the record
      !> multiple of the frequency of a stronger line; 0: no such multiple
      integer :: harmonic = 0
      !> whether it does not decay and is a multiple of 50 or 60 (mains hum, in Hz)
      logical :: mains = .false.
   end type line_t

   !> Rates of decay that are tried, times the length of the record.
   real(wp), parameter :: decays(4) = [0.0_wp, 3.0_wp, 12.0_wp, 40.0_wp]

   !> Smallest ratio of the power of a line to the median power around it.
   real(wp), parameter, public :: standing_out = 25

contains

   !> Shortens a record for scans, whose cost is proportional to samples times frequencies: means
   !> over equal spans of time, none across a gap, and only the beginning of a long record.
   !>
   !> t, z           (m) ascending times [time], and values in any unit
   !> highest        highest frequency of interest [1/time]; each of its periods keeps at least six
   !>                samples
   !> times, values  the shortened record
   pure subroutine condense(t, z, highest, times, values)
      real(wp), intent(in) :: t(:), z(:), highest
      real(wp), allocatable, intent(out) :: times(:), values(:)
      real(wp), parameter :: longest = 800     ! periods of the highest
      real(wp) :: width, last
      integer :: count, k, n

      allocate (times(size(t)), values(size(t)))
      width = 1/(6*highest)
      ! Frequencies above half the mean sampling rate cannot be seen.
      last = t(1) + longest*max(1/highest, 2*(t(size(t)) - t(1))/size(t))
      n = 0
      count = 0
      do k = 1, size(t)
         if (t(k) > last) exit
         if (count > 0) then
            if (int((t(k) - t(1))/width) == int((t(k - 1) - t(1))/width)) then
               count = count + 1
               times(n) = times(n) + (t(k) - times(n))/count
               values(n) = values(n) + (z(k) - values(n))/count
               cycle
            end if
         end if
         n = n + 1
         count = 1
         times(n) = t(k)
         values(n) = z(k)
      end do
      times = times(:n)
      values = values(:n)
   end subroutine condense

   !> Finds the decaying oscillation that explains most of a record, among those that exceed their
   !> surroundings: with a filter matched to each frequency of a grid and each of some rates of
   !> decay.
   !>
   !> t, z   (m) ascending times [time], and values without mean and without the known lines
   !> range  (2) lowest and highest frequency [1/time]
   !> known  lines; frequencies near them are excluded
   !> line   on return the strongest line; its frequency is 0 if there is none
   subroutine strongest_line(t, z, range, known, line)
      real(wp), intent(in) :: t(:), z(:), range(2)
      type(line_t), intent(in) :: known(:)
      type(line_t), intent(out) :: line
      real(wp), allocatable :: power(:), background(:)
      real(wp) :: span, step, highest_power
      integer :: d, k

      span = t(size(t)) - t(1)
      highest_power = 0
      do d = 1, size(decays)
         step = 1/(2*span*max(1.0_wp, decays(d)/12))
         power = matched_filter(t, z, decays(d)/span, range, step)
         ! The median reaches so far that the line itself does not raise it: there the line has some
         ! (decay/pi/reach)^2 of its power, with decay and reach in units of 1/span.
         background = running_median(power, nint((25 + 4*decays(d))/span/step))
         do k = 2, size(power) - 1
            if (power(k) <= max(highest_power, standing_out*background(k), power(k - 1), &
               power(k + 1))) cycle
            if (any(too_near(range(1) + (k - 1)*step, known, span))) cycle
            highest_power = power(k)
            line = line_t(range(1) + (k - 1)*step, decays(d)/span)
         end do
      end do
   end subroutine strongest_line

   !> Returns whether a frequency is closer to a line than 3/T, half the rate of decay or 1 % of the
   !> line's frequency.
   !>
   !> span  T, length of the record [time]
   elemental logical function too_near(frequency, line, span)
      real(wp), intent(in) :: frequency, span
      type(line_t), intent(in) :: line

      too_near = abs(frequency - line%frequency) < max(3/span, line%decay/2, &
         1e-2_wp*line%frequency)
   end function too_near

   !> Returns the variance of white noise that would be as strong as the record around a frequency.
   !>
   !> t, z       (m) ascending times [time], and values without the lines
   !> frequency  [1/time]
   !> decay      of a line that would be detected there [1/time]
   function noise_near(t, z, frequency, decay) result(variance)
      real(wp), intent(in) :: t(:), z(:), frequency, decay
      real(wp) :: variance
      real(wp), allocatable :: times(:), values(:)
      real(wp) :: span, reach

      call condense(t, z, 2*frequency, times, values)
      span = times(size(times)) - times(1)
      variance = sum(z**2)/size(z)
      if (.not. span > 0) return       ! too few samples for anything else
      reach = 60/span + 3*decay
      ! The median of an exponential distribution is ln 2 times its mean. Means of several samples
      ! have a variance that is smaller in the same ratio.
      variance = median(matched_filter(times, values, decay, [max(0.2_wp*frequency, &
         frequency - reach), frequency + reach], 1/(2*span)))/log(2.0_wp) &
         *count(t <= times(size(times)))/size(times)
   end function noise_near

   !> Returns the standard deviation of the white noise of a record: the lowest level of its
   !> spectrum at some frequencies below half the mean sampling rate, where motions are weak.
   !>
   !> t, z  (m) ascending times [time], and residuals of a fit; only the first 20,000 are used
   real(wp) function noise_floor(t, z) result(sd)
      real(wp), intent(in) :: t(:), z(:)
      integer, parameter :: most = 20000
      real(wp), parameter :: places(6) = [0.15_wp, 0.3_wp, 0.45_wp, 0.6_wp, 0.75_wp, 0.9_wp]
      real(wp) :: highest
      integer :: k, m

      m = min(size(t), most)
      sd = norm2(z)/sqrt(real(max(1, size(z)), wp))
      if (m < 3) return
      highest = (m - 1)/(2*(t(m) - t(1)))
      sd = sqrt(minval([(noise_near(t(:m), z(:m), places(k)*highest, 0.0_wp), &
         k=1, size(places))]))
   end function noise_floor

   !> Returns n if a frequency is n times another one, to within .13 %, for n up to 12; otherwise 0.
   !>
   !> frequency, first  [1/time]
   !> error             by which the ratio of the two may be wrong
   pure integer function order_of_multiple(frequency, first, error) result(order)
      real(wp), intent(in) :: frequency, first, error
      real(wp), parameter :: tolerance = 1.3e-3_wp
      integer, parameter :: highest = 12
      real(wp) :: ratio

      ratio = frequency/first
      order = 0
      if (abs(ratio - anint(ratio)) < tolerance*ratio + error .and. ratio < highest + 0.5_wp) &
         order = nint(ratio)
   end function order_of_multiple

   !> Returns whether a frequency is a multiple of 50 or 60, to within the larger of 0.1 and
   !> 0.3/span.
   !>
   !> frequency  [1/time]
   !> span       length of the record [time]
   !> error      by which the frequency may be wrong [1/time]
   pure logical function near_mains(frequency, span, error)
      real(wp), intent(in) :: frequency, span, error
      real(wp) :: distance(2)

      distance = frequency - [50, 60]*max([1, 1], nint(frequency/[50, 60]))
      near_mains = any(abs(distance) < max(0.1_wp, 0.3_wp/span) + error)
   end function near_mains

   !> Returns approximately half the sum of squares that an oscillation with each frequency of a
   !> grid explains.
   !>
   !> t, z   (m) times [time] and values
   !> decay  rate of decay of the oscillation [1/time]
   !> range  (2) lowest and highest frequency [1/time]
   !> step   of the frequencies [1/time], below 1/(length of the record)
   !> power  (frequencies)
   function matched_filter(t, z, decay, range, step) result(power)
      real(wp), intent(in) :: t(:), z(:), decay, range(2), step
      real(wp), allocatable :: power(:)
      real(wp) :: envelope(size(t))
      complex(wp), allocatable :: sums(:)

      envelope = exp(-decay*(t - t(1)))
      sums = phasor_sums(t, z*envelope, range(1), step, max(0, int((range(2) - range(1))/step) + 1))
      power = (real(sums)**2 + aimag(sums)**2)/sum(envelope**2)
   end function matched_filter

   !> Returns the median of each value's neighbours, computed at every quarter of the reach.
   !>
   !> power  (frequencies)
   !> reach  number of neighbours on either side
   function running_median(power, reach) result(background)
      real(wp), intent(in) :: power(:)
      integer, intent(in) :: reach
      real(wp) :: background(size(power))
      integer :: first, last, middle, n, stride

      n = size(power)
      stride = max(1, reach/4)
      do first = 1, n, stride
         last = min(n, first + stride - 1)
         middle = (first + last)/2
         background(first:last) = median(power(max(1, middle - reach):min(n, middle + reach)))
      end do
   end function running_median

   !> Finds the strongest peak of the spectrum with Hann's window, and the share of the variance
   !> below a frequency.
   !>
   !> t, z       (m) times [time] and values as recorded
   !> highest    highest frequency of interest [1/time]
   !> frequency  of the peak [1/time]; 0 if the record is shorter than a period of `highest`, or if
   !>            white noise would have such a peak in more than 1 of 1,000 records
   !> share      of the variance below `highest`, 0 .. 1
   subroutine strongest_peak(t, z, highest, frequency, share)
      real(wp), intent(in) :: t(:), z(:), highest
      real(wp), intent(out) :: frequency, share
      real(wp), parameter :: level = 1e-3_wp
      real(wp), allocatable :: times(:), values(:), power(:)
      real(wp) :: w(size(t)), step, span
      integer :: m

      frequency = 0
      share = 0
      if (size(t) < 8) return
      if (.not. (t(size(t)) - t(1))*highest > 1) return
      call condense(t, z, highest, times, values)
      m = size(times)
      span = times(m) - times(1)
      step = 1/(4*span)
      w(:m) = sin(two_pi/2*(times - times(1))/span)**2
      values = w(:m)*(values - sum(w(:m)*values)/sum(w(:m)))
      power = matched_filter(times, values, 0.0_wp, [0.0_wp, min(highest, (m - 1)/(2*span))], step)
      ! The first points belong to the window and to a trend of the record, not to a motion.
      if (size(power) > 8) then
         frequency = (maxloc(power(6:), dim=1) + 4)*step
         ! The power of white noise is exponentially distributed, with a median of log(2) times its
         ! mean. Four steps of the grid make one independent frequency.
         if (maxval(power(6:)) < log(size(power)/(4*level))*median(power(6:))/log(2.0_wp)) &
            frequency = 0
      end if
      ! Parseval's theorem.
      share = min(1.0_wp, sum(power)/2/max(sum(values**2), tiny(share)))
   end subroutine strongest_peak

end module beamid_spectra
