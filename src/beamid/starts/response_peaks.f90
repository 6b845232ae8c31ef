!> Resonances of a measured frequency response: natural frequencies and damping ratios, as rough as
!> start values may be.
module beamid_response_peaks
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   implicit none
   private

   public :: find_peaks, peak_t

   !> One resonance.
   type :: peak_t
      real(wp) :: frequency = 0   !< |s|/(2 pi) [1/time]
      real(wp) :: damping = 0     !< damping ratio; 0: not found
      real(wp) :: size = 0        !< height above its surroundings
      real(wp) :: noise = 0       !< standard deviation of real and imaginary part at the peak
   end type peak_t

contains

   !> Finds the resonances of a frequency response, the highest first.
   !>
   !> A line is a peak if its magnitude exceeds that of both valleys beside it by far more than the
   !> noise. Near a resonance h = a/(i omega - s) up to a slowly varying part, so that 1/h is linear
   !> in omega; the straight line through the values of 1/h around the peak, weighted by |h|**4, has
   !> its zero at the root s.
   !>
   !> frequency  (n) ascending [1/time]
   !> h          (n)
   !> noise      (n) standard deviation of real and imaginary part, or any constant if unknown
   !> is_known   whether the noise is known
   !> most       largest number of peaks
   function find_peaks(frequency, h, noise, is_known, most) result(peaks)
      real(wp), intent(in) :: frequency(:), noise(:)
      complex(wp), intent(in) :: h(:)
      logical, intent(in) :: is_known
      integer, intent(in) :: most
      type(peak_t), allocatable :: peaks(:)
      !> Height of a peak in standard deviations, and as a share of its magnitude. Among thousands
      !> of values of a constant response with noise, the largest exceeds the smallest by about
      !> seven standard deviations.
      real(wp), parameter :: clear = 10, least_share = 0.3_wp
      !> Peaks whose frequencies differ by a smaller share are merged.
      real(wp), parameter :: same = 0.03_wp
      type(peak_t), allocatable :: candidates(:)
      type(peak_t) :: peak
      real(wp) :: magnitude(size(h)), level(size(h)), prominence
      integer :: k, n

      n = size(h)
      magnitude = abs(h)
      level = noise
      ! Second differences of a smooth response are small; those of noise have 6 times its variance.
      if (.not. is_known .and. n > 4) level = median(abs(h(3:) - 2*h(2:n - 1) + h(:n - 2))) &
         /sqrt(6.0_wp)
      allocate (candidates(0))
      do k = 2, n - 1
         if (magnitude(k) < magnitude(k - 1) .or. magnitude(k) <= magnitude(k + 1)) cycle
         prominence = magnitude(k) - max(valley(magnitude, k, -1), valley(magnitude, k, 1))
         if (prominence < max(clear*level(k), least_share*magnitude(k))) cycle
         peak = peak_at(k)
         if (peak%damping > 0) candidates = [candidates, peak]
      end do
      allocate (peaks(0))
      do while (size(peaks) < most .and. size(candidates) > 0)
         k = maxloc(candidates%size, dim=1)
         ! Noise splits a broad resonance into several peaks.
         if (.not. any(abs(log(peaks%frequency/candidates(k)%frequency)) < same)) &
            peaks = [peaks, candidates(k)]
         candidates = [candidates(:k - 1), candidates(k + 1:)]
      end do

   contains

      !> Returns the resonance at line k; its damping is 0 if the lines around k do not show one.
      type(peak_t) function peak_at(k) result(found)
         integer, intent(in) :: k
         real(wp) :: x, moments(0:2)
         complex(wp) :: sums(0:1), slope, intercept, zero
         integer :: first, j, last

         first = k
         do while (first > 1 .and. k - first < 50)
            if (magnitude(first - 1) < magnitude(k)/2) exit
            first = first - 1
         end do
         last = k
         do while (last < n .and. last - k < 50)
            if (magnitude(last + 1) < magnitude(k)/2) exit
            last = last + 1
         end do
         first = min(first, max(1, k - 1))
         last = max(last, min(n, k + 1))
         moments = 0
         sums = 0
         do j = first, last
            x = frequency(j) - frequency(k)
            ! The weight |h|**4 makes the errors of 1/h equal.
            moments = moments + magnitude(j)**4*[1.0_wp, x, x**2]
            sums = sums + magnitude(j)**4/h(j)*[1.0_wp, x]
         end do
         slope = (moments(0)*sums(1) - moments(1)*sums(0))/(moments(0)*moments(2) - moments(1)**2)
         intercept = (sums(0) - moments(1)*slope)/moments(0)
         found%frequency = frequency(k)
         found%size = prominence
         found%noise = level(k)
         if (.not. abs(slope) > 0) return
         zero = frequency(k) - intercept/slope
         if (abs(real(zero) - frequency(k)) > frequency(last) - frequency(first)) return
         found%frequency = abs(zero)
         found%damping = max(0.0_wp, aimag(zero)/abs(zero))
      end function peak_at

   end function find_peaks

   !> Returns the least magnitude between a peak and the next higher line, or the end.
   !>
   !> peak  number of the line of the peak
   !> step  1 for the lines after it, -1 for those before it
   pure real(wp) function valley(magnitude, peak, step)
      real(wp), intent(in) :: magnitude(:)
      integer, intent(in) :: peak, step
      integer :: k

      valley = magnitude(peak)
      k = peak + step
      do while (k >= 1 .and. k <= size(magnitude))
         if (magnitude(k) > magnitude(peak)) exit
         valley = min(valley, magnitude(k))
         k = k + step
      end do
   end function valley

end module beamid_response_peaks
