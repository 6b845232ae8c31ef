!> Lines in the spectrum of a record: where a decaying oscillation stands out of what is around it.
module beamid_spectra
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   implicit none
   private

   public :: line_t, condense, strongest_line, strongest_peak, too_near, noise_near, &
      near_mains

   !> A decaying oscillation that a record holds.
   type :: line_t
      real(wp) :: frequency = 0    !< [1/time]
      real(wp) :: decay = 0        !< rate at which it dies out [1/time]
      real(wp) :: energy = 0       !< share of the variance of the record
      integer :: harmonic = 0      !< so many times the frequency of a stronger line; 0: of none
      logical :: mains = .false.   !< a multiple of 50 or 60 that does not die out
   end type line_t

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

   !> Rates of decay that are tried, times the length of the record.
   real(wp), parameter :: decays(4) = [0.0_wp, 3.0_wp, 12.0_wp, 40.0_wp]

   !> How far above the median of its surroundings the power of a line lies.
   real(wp), parameter, public :: standing_out = 25

contains

   !> A record shortened for scans, which cost samples times frequencies: means over equal spans of
   !> time, none of which reaches over a gap, and the beginning of what is left.
   !>
   !> t, z     (m) ascending [time] and any unit
   !> highest  frequency of interest [1/time]; its samples are left six to a period at least
   pure subroutine condense(t, z, highest, times, values)
      real(wp), intent(in) :: t(:), z(:), highest
      real(wp), allocatable, intent(out) :: times(:), values(:)
      real(wp), parameter :: longest = 800     ! periods of the highest
      real(wp) :: width, last
      integer :: count, k, n

      allocate (times(size(t)), values(size(t)))
      width = 1/(6*highest)
      ! No frequency above half the mean rate is seen.
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

   !> The decaying oscillation that explains most of a record, of those that stand out: a filter
   !> matched to each frequency of a grid and to some rates of decay.
   !>
   !> t, z      (m) ascending [time], without the lines that are known and without a mean
   !> range     (2) of the frequencies that are looked at [1/time]
   !> known     lines near which none is looked for
   !> line      frequency 0: none stands out
   subroutine strongest_line(t, z, range, known, line)
      real(wp), intent(in) :: t(:), z(:), range(2)
      type(line_t), intent(in) :: known(:)
      type(line_t), intent(out) :: line
      real(wp), allocatable :: power(:), floor(:)
      real(wp) :: span, step, most
      integer :: d, k

      span = t(size(t)) - t(1)
      most = 0
      do d = 1, size(decays)
         step = 1/(2*span*max(1.0_wp, decays(d)/12))
         power = matched(t, z, decays(d)/span, range, step)
         ! So wide that the line itself, (decay/pi)^2 of its power at that distance, is below.
         floor = surroundings(power, nint((25 + 4*decays(d))/span/step))
         do k = 2, size(power) - 1
            if (power(k) <= max(most, standing_out*floor(k), power(k - 1), power(k + 1))) cycle
            if (any(too_near(range(1) + (k - 1)*step, known, span))) cycle
            most = power(k)
            line = line_t(range(1) + (k - 1)*step, decays(d)/span)
         end do
      end do
   end subroutine strongest_line

   !> Whether a frequency is within 3/T, half a rate of decay or one per cent of a line's.
   !>
   !> span  T, of the record [time]
   elemental logical function too_near(frequency, line, span)
      real(wp), intent(in) :: frequency, span
      type(line_t), intent(in) :: line

      too_near = abs(frequency - line%frequency) < max(3/span, line%decay/2, &
         1e-2_wp*line%frequency)
   end function too_near

   !> Variance of white noise that would be as strong as a record is around a frequency.
   !>
   !> t, z   (m) ascending [time], a record without its lines
   !> decay  of the line that would be seen there [1/time]
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
      ! Of a variable that is distributed exponentially the median is ln 2 times the mean; means of
      ! so many samples have as much less variance.
      variance = median(matched(times, values, decay, [max(0.2_wp*frequency, frequency - reach), &
         frequency + reach], 1/(2*span)))/log(2.0_wp)*count(t <= times(size(times)))/size(times)
   end function noise_near

   !> Whether a frequency is a multiple of 50 or 60, to a tenth or a third of a width.
   !>
   !> error  by which the frequency may be off
   pure logical function near_mains(frequency, span, error)
      real(wp), intent(in) :: frequency, span, error
      real(wp) :: distance(2)

      distance = frequency - [50, 60]*max([1, 1], nint(frequency/[50, 60]))
      near_mains = any(abs(distance) < max(0.1_wp, 0.3_wp/span) + error)
   end function near_mains

   !> What an oscillation with each frequency of a grid explains of the sum of squares, about half
   !> of it: a phasor x + i y for each sample, turned on from one frequency to the next.
   function matched(t, z, decay, range, step) result(power)
      real(wp), intent(in) :: t(:), z(:), decay, range(2), step
      real(wp), allocatable :: power(:)
      integer, parameter :: lanes = 8     ! sums side by side, which a processor adds at once
      real(wp), dimension(lanes, size(t)/lanes + 1) :: x, y, c, s
      real(wp) :: envelope(size(t)), phase(size(t)), next(lanes), total(lanes, 2)
      integer :: j, k

      envelope = exp(-decay*(t - t(1)))
      phase = two_pi*(t - t(1))
      x = spread_out(z*envelope*cos(range(1)*phase))
      y = spread_out(z*envelope*sin(range(1)*phase))
      c = spread_out(cos(step*phase))
      s = spread_out(sin(step*phase))
      allocate (power(max(0, int((range(2) - range(1))/step) + 1)))
      do k = 1, size(power)
         total = 0
         do j = 1, size(x, 2)
            total(:, 1) = total(:, 1) + x(:, j)
            total(:, 2) = total(:, 2) + y(:, j)
            next = x(:, j)*c(:, j) - y(:, j)*s(:, j)
            y(:, j) = x(:, j)*s(:, j) + y(:, j)*c(:, j)
            x(:, j) = next
         end do
         power(k) = sum(sum(total, dim=1)**2)/sum(envelope**2)
      end do

   contains

      !> In lanes, filled up with zeros.
      pure function spread_out(values) result(table)
         real(wp), intent(in) :: values(:)
         real(wp) :: table(lanes, size(t)/lanes + 1)

         table = reshape(values, shape(table), pad=[0.0_wp])
      end function spread_out

   end function matched

   !> The median of so many neighbours on either side, at every quarter of that distance.
   function surroundings(power, reach) result(floor)
      real(wp), intent(in) :: power(:)
      integer, intent(in) :: reach
      real(wp) :: floor(size(power))
      integer :: first, last, middle, n, pace

      n = size(power)
      pace = max(1, reach/4)
      do first = 1, n, pace
         last = min(n, first + pace - 1)
         middle = (first + last)/2
         floor(first:last) = median(power(max(1, middle - reach):min(n, middle + reach)))
      end do
   end function surroundings

   !> The strongest peak under Hann's window, and the share of the variance below a frequency.
   !>
   !> t, z       (m) as they were recorded
   !> frequency  0: the record is shorter than one period of the highest
   !> share      0 .. 1
   subroutine strongest_peak(t, z, highest, frequency, share)
      real(wp), intent(in) :: t(:), z(:), highest
      real(wp), intent(out) :: frequency, share
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
      power = matched(times, values, 0.0_wp, [0.0_wp, min(highest, (m - 1)/(2*span))], step)
      ! The first points are those of the window and of a trend of the record, not of a motion.
      if (size(power) > 8) frequency = (maxloc(power(6:), dim=1) + 4)*step
      ! Parseval: four steps are one independent frequency.
      share = min(1.0_wp, sum(power)/2/max(sum(values**2), tiny(share)))
   end subroutine strongest_peak

end module beamid_spectra
