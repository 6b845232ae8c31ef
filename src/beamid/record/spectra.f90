!> Lines in the spectrum of a record, from which start values of a search are taken.
module beamid_spectra
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   implicit none
   private

   public :: line_t, find_lines, decay_of

   !> A peak of the amplitude spectrum.
   type :: line_t
      real(wp) :: frequency = 0    !< [1/time]
      real(wp) :: amplitude = 0    !< of a sine, in the unit of the record
   end type line_t

   real(wp), parameter :: two_pi = 2*acos(-1.0_wp)

contains

   !> The strongest lines, in the order of frequency. The record is multiplied by Hann's window; its
   !> stamps may be uneven.
   !>
   !> t, z     (m) [time] and any unit
   !> highest  frequency up to which lines are looked for [1/time]; half the mean rate at most
   !> most     how many lines at most
   !> lines    peaks that stand out of the median of the spectrum five times or more and are no
   !>          weaker than a hundredth of the strongest; none where the record is shorter than one
   !>          period of the highest frequency
   !> share    of the record's variance that the frequencies up to the highest hold, 0 .. 1
   subroutine find_lines(t, z, highest, most, lines, share)
      real(wp), intent(in) :: t(:), z(:), highest
      integer, intent(in) :: most
      type(line_t), allocatable, intent(out) :: lines(:)
      real(wp), intent(out) :: share
      real(wp), allocatable :: times(:), values(:), spectrum(:)
      logical, allocatable :: peak(:), chosen(:)
      real(wp) :: step, threshold
      integer :: k, n, strongest

      allocate (lines(0))
      share = 0
      if (size(t) < 8) return
      if (.not. (t(size(t)) - t(1))*highest > 1) return
      call condense(t, z, highest, times, values)
      call scan(times, values, highest, spectrum, step, share)
      n = size(spectrum)
      if (n < 8) return
      threshold = max(5*median(spectrum), 1e-2_wp*maxval(spectrum(6:)))
      allocate (peak(n), chosen(n), source=.false.)
      ! The first lines are those of the window and of a trend of the record, not of a motion.
      peak(6:n - 1) = spectrum(6:n - 1) > threshold .and. spectrum(6:n - 1) >= spectrum(5:n - 2) &
         .and. spectrum(6:n - 1) > spectrum(7:)
      do while (count(chosen) < most .and. any(peak))
         strongest = maxloc(spectrum, dim=1, mask=peak)
         chosen(strongest) = .true.
         ! Side lobes of the window: within four of its widths, below a twentieth of the peak.
         do k = max(1, strongest - 16), min(n, strongest + 16)
            if (spectrum(k) < 0.05_wp*spectrum(strongest)) peak(k) = .false.
         end do
         peak(strongest) = .false.
      end do
      do k = 1, n
         if (chosen(k)) lines = [lines, summit(spectrum, k, step)]
      end do
   end subroutine find_lines

   !> A long record is shortened before it is scanned, which costs samples times frequencies: means
   !> of neighbours where the rate is far above what is looked for, and the beginning of what is
   !> left.
   pure subroutine condense(t, z, highest, times, values)
      real(wp), intent(in) :: t(:), z(:), highest
      real(wp), allocatable, intent(out) :: times(:), values(:)
      real(wp), parameter :: affordable = 2e8_wp
      real(wp) :: span
      integer :: block, k, m

      span = t(size(t)) - t(1)
      block = 1
      if (span > 0) block = max(1, int(min(size(t)/(16*highest*span), 1e6_wp)))
      m = size(t)/block
      times = [(sum(t((k - 1)*block + 1:k*block))/block, k=1, m)]
      values = [(sum(z((k - 1)*block + 1:k*block))/block, k=1, m)]
      if (m*4*span*highest <= affordable) return
      m = max(min(m, 1000), int(m*sqrt(affordable/(m*4*span*highest))))
      times = times(:m)
      values = values(:m)
   end subroutine condense

   !> Amplitudes at 0, step, 2 step, ...: a phasor per sample, turned on from one frequency to the
   !> next.
   subroutine scan(t, z, highest, spectrum, step, share)
      real(wp), intent(in) :: t(:), z(:), highest
      real(wp), allocatable, intent(out) :: spectrum(:)
      real(wp), intent(out) :: step, share
      real(wp) :: w(size(t)), phase(size(t)), span, kept
      complex(wp) :: phasor(size(t)), turn(size(t))
      integer :: k, n, m

      m = size(t)
      span = t(m) - t(1)
      step = 1/(4*span)
      n = int(min(highest, (m - 1)/(2*span))/step)
      w = sin(two_pi/2*(t - t(1))/span)**2
      phasor = w*(z - sum(w*z)/sum(w))
      phase = two_pi*step*(t - t(1))
      turn = cmplx(cos(phase), sin(phase), wp)
      kept = sum(real(phasor)**2)
      allocate (spectrum(n + 1))
      do k = 1, n + 1
         spectrum(k) = 2*abs(sum(phasor))/sum(w)
         phasor = phasor*turn
      end do
      ! Parseval: four steps are one independent frequency.
      share = min(1.0_wp, sum(spectrum**2)*sum(w)**2/(2*4*m*max(kept, tiny(kept))))
   end subroutine scan

   !> Frequency and amplitude of a peak, by the parabola through three logarithms.
   pure type(line_t) function summit(spectrum, k, step)
      real(wp), intent(in) :: spectrum(:), step
      integer, intent(in) :: k
      real(wp) :: a, b, c, shift

      a = log(max(spectrum(k - 1), tiny(a)))
      b = log(max(spectrum(k), tiny(b)))
      c = log(max(spectrum(k + 1), tiny(c)))
      shift = 0
      if (abs(a - 2*b + c) > 0) shift = max(-0.5_wp, min(0.5_wp, (a - c)/(2*(a - 2*b + c))))
      summit%frequency = (k - 1 + shift)*step
      summit%amplitude = exp(b - (a - c)*shift/4)
   end function summit

   !> Rate at which a line dies out, from its amplitude in six parts of the record [1/time]; 0 where
   !> it does not.
   pure real(wp) function decay_of(t, z, frequency) result(rate)
      real(wp), intent(in) :: t(:), z(:), frequency
      integer, parameter :: parts = 6
      real(wp) :: time(parts), size_of(parts), weight(parts), mean
      integer :: k, first, last

      do k = 1, parts
         first = 1 + (k - 1)*size(t)/parts
         last = k*size(t)/parts
         time(k) = (t(first) + t(last))/2
         size_of(k) = amplitude(t(first:last), z(first:last), frequency)
      end do
      weight = size_of**2
      rate = 0
      if (.not. all(size_of > 0)) return
      mean = sum(weight*time)/sum(weight)
      rate = -sum(weight*(time - mean)*log(size_of))/sum(weight*(time - mean)**2)
      rate = max(rate, 0.0_wp)
   end function decay_of

   !> Amplitude of a sine in a piece of the record, by least squares with a constant.
   pure real(wp) function amplitude(t, z, frequency)
      real(wp), intent(in) :: t(:), z(:), frequency
      real(wp) :: c(size(t)), s(size(t)), y(size(t)), cc, cs, ss, determinant

      c = cos(two_pi*frequency*(t - t(1)))
      s = sin(two_pi*frequency*(t - t(1)))
      c = c - sum(c)/size(t)
      s = s - sum(s)/size(t)
      y = z - sum(z)/size(t)
      cc = sum(c**2)
      cs = sum(c*s)
      ss = sum(s**2)
      determinant = cc*ss - cs**2
      amplitude = 0
      if (determinant > 1e-6_wp*cc*ss) amplitude = hypot(ss*sum(c*y) - cs*sum(s*y), &
         cc*sum(s*y) - cs*sum(c*y))/determinant
   end function amplitude

end module beamid_spectra
