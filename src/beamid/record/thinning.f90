!> Every k-th sample of a record behind a symmetric low-pass filter, a sinc under a Kaiser window.
!>
!> It passes 0 to 0.6 of the new Nyquist frequency f_N, half the mean sampling rate over k, and
!> stops what lies above f_N, each within 3e-5 (90 dB): nothing folds back, and no phase is shifted.
!>
!> The stamps are used as they are. The filter's integral is a sum over nodes at the mean step,
!> where a polynomial through up to 12 neighbours gives the record's value, of lower degree where
!> uneven stamps would amplify the noise. A tone of 0.5 f_N goes through the same sums, and a sample
!> is kept only where the tone comes out right: a gap costs the samples beside it where it matters,
!> and no others. Of uneven stamps, tones with fewer than 4 or 5 stamps to a period are stopped less
!> well.
module beamid_thinning
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   implicit none
   private

   public :: thinned_t, thin_out, gap_limit, margin_of

   real(wp), parameter :: pi = acos(-1.0_wp)
   !> A step of more than this many median steps is a gap.
   real(wp), parameter :: gap_factor = 20
   !> Half the filter's length in samples, over k; the Kaiser window's parameter for 90 dB; the
   !> middle of the slope and the edge of the band that is promised, over f_N.
   real(wp), parameter :: half_samples = 14.4_wp, beta = 8.96_wp, slope = 0.8_wp, edge = 0.5_wp
   !> How far the tone may be off, beside the filter's own 3e-5.
   real(wp), parameter :: tolerance = 5e-5_wp
   !> Half the largest number of neighbours; the most that their weights may add up to.
   integer, parameter :: reach = 6
   real(wp), parameter :: most_weight = 4
   !> Intervals of the table of the filter; linear between, to 1e-6 of its peak.
   integer, parameter :: intervals = 16384

   !> What is left of a record.
   type :: thinned_t
      real(wp), allocatable :: t(:), z(:)   !< (samples)
      real(wp) :: passes = 0                !< what lies below passes within 1e-4 [1/time]
      real(wp) :: stops = 0                 !< what lies above is stopped [1/time]
      real(wp) :: half_width = 0            !< each sample is a mean over this time either way
      integer :: lost = 0                   !< samples that could not be computed
   end type thinned_t

contains

   !> Rows that the filter needs on either side of a sample, and some to spare.
   pure integer function margin_of(k) result(rows)
      integer, intent(in) :: k

      rows = ceiling(2*half_samples*k) + 2*reach
   end function margin_of

   !> Every k-th of the wanted rows, filtered; without those for which the record does not reach
   !> far enough, or holds a gap or a sample to be left out.
   !>
   !> t, z    (rows) of the record, ascending
   !> bad     (rows) whether a sample is not to be used
   !> wanted  places in t, ascending, of the window's rows
   !> k       2 or more
   subroutine thin_out(t, z, bad, wanted, k, thinned)
      real(wp), intent(in) :: t(:), z(:)
      logical, intent(in) :: bad(:)
      integer, intent(in) :: wanted(:), k
      type(thinned_t), intent(out) :: thinned
      real(wp), allocatable :: y(:), kernel(:)
      logical, allocatable :: good(:)
      integer, allocatable :: places(:), ends(:)
      real(wp) :: step, limit
      integer :: first, last, from, to, j

      allocate (thinned%t(0), thinned%z(0))
      places = wanted(::k)
      thinned%lost = size(places)
      limit = gap_limit(t)
      step = mean_step(t, limit)
      if (.not. step > 0) return
      thinned%half_width = half_samples*k*step
      thinned%passes = edge/(2*k*step)
      thinned%stops = 1/(2*k*step)
      kernel = low_pass()

      ! Each part between two gaps by itself.
      allocate (y(size(places)), good(size(places)))
      good = .false.
      ends = [pack([(j, j=1, size(t) - 1)], t(2:) - t(:size(t) - 1) > limit), size(t)]
      last = 0
      to = 0
      do j = 1, size(ends)
         first = last + 1
         last = ends(j)
         from = to + 1
         to = to + count(places(from:) <= last)
         if (to >= from .and. t(last) - t(first) > 2*thinned%half_width) &
            call filter_part(t(first:last), z(first:last), bad(first:last), &
            t(places(from:to)), step, thinned, kernel, y(from:to), good(from:to))
      end do
      thinned%t = pack(t(places), good)
      thinned%z = pack(y, good)
      thinned%lost = count(.not. good)
   end subroutine thin_out

   !> The longest step that is no gap.
   real(wp) function gap_limit(t) result(limit)
      real(wp), intent(in) :: t(:)

      limit = gap_factor*median(t(2:) - t(:size(t) - 1))
   end function gap_limit

   !> The mean of the steps that are no gaps; 0 when there is none.
   pure real(wp) function mean_step(t, limit) result(step)
      real(wp), intent(in) :: t(:), limit
      real(wp) :: steps(size(t) - 1)

      steps = t(2:) - t(:size(t) - 1)
      step = sum(steps, mask=steps <= limit)/max(1, count(steps <= limit))
   end function mean_step

   !> The filter from its middle (0) to its end (intervals); without a factor.
   pure function low_pass() result(kernel)
      real(wp) :: kernel(0:intervals + 1)
      real(wp) :: u, x
      integer :: k

      kernel = 0
      do k = 0, intervals
         u = real(k, wp)/intervals
         x = pi*slope*half_samples*u
         kernel(k) = bessel_i0(beta*sqrt(1 - u*u))
         if (k > 0) kernel(k) = kernel(k)*sin(x)/x
      end do
      kernel = kernel/kernel(0)
   end function low_pass

   !> The modified Bessel function I_0, for arguments up to 20 or so.
   pure real(wp) function bessel_i0(x) result(total)
      real(wp), intent(in) :: x
      real(wp) :: term
      integer :: k

      total = 1
      term = 1
      do k = 1, 100
         term = term*(x/(2*k))**2
         total = total + term
         if (term < epsilon(total)*total) exit
      end do
   end function bessel_i0

   !> Filters a part of the record without gaps.
   !>
   !> at    (samples) times of the samples wanted, ascending [time]
   !> step  between the nodes [time]
   !> y     (samples) the samples, where `good`
   subroutine filter_part(t, z, bad, at, step, thinned, kernel, y, good)
      real(wp), intent(in) :: t(:), z(:), at(:), step, kernel(0:)
      logical, intent(in) :: bad(:)
      type(thinned_t), intent(in) :: thinned
      real(wp), intent(out) :: y(:)
      logical, intent(out) :: good(:)
      real(wp), allocatable :: values(:)
      complex(wp), allocatable :: errors(:)
      logical, allocatable :: spoilt(:)
      real(wp) :: total, u, weight
      complex(wp) :: error
      integer :: k, j, first, last, place

      call fill_nodes(t, z, bad, step, 2*pi*thinned%passes, values, errors, spoilt)
      y = 0
      good = .false.
      do k = 1, size(at)
         if (at(k) - thinned%half_width < t(1)) cycle
         if (at(k) + thinned%half_width > t(size(t))) cycle
         first = ceiling((at(k) - thinned%half_width - t(1))/step) + 1
         last = min(floor((at(k) + thinned%half_width - t(1))/step) + 1, size(values))
         if (any(spoilt(first:last))) cycle
         total = 0
         error = 0
         do j = first, last
            u = abs((j - 1)*step - (at(k) - t(1)))*(intervals/thinned%half_width)
            place = int(u)
            weight = kernel(place) + (u - place)*(kernel(place + 1) - kernel(place))
            total = total + weight
            y(k) = y(k) + weight*values(j)
            error = error + weight*errors(j)
         end do
         y(k) = y(k)/total
         good(k) = abs(error/total) <= tolerance
      end do
   end subroutine filter_part

   !> The record at nodes of even steps from its first sample, and how far a tone is off there.
   !>
   !> omega   of the tone exp(i omega (t - t(1))) [1/time]
   !> values  (nodes) of the record
   !> errors  (nodes) of the tone
   !> spoilt  (nodes) whether a bad sample went into the value
   subroutine fill_nodes(t, z, bad, step, omega, values, errors, spoilt)
      real(wp), intent(in) :: t(:), z(:), step, omega
      logical, intent(in) :: bad(:)
      real(wp), allocatable, intent(out) :: values(:)
      complex(wp), allocatable, intent(out) :: errors(:)
      logical, allocatable, intent(out) :: spoilt(:)
      complex(wp), allocatable :: tone(:)
      real(wp) :: weights(2*reach), x
      integer :: node, nodes, row, first, last

      nodes = floor((t(size(t)) - t(1))/step*(1 + 1e-12_wp)) + 1
      allocate (values(nodes), errors(nodes), spoilt(nodes))
      tone = exp(cmplx(0.0_wp, omega*(t - t(1)), wp))
      row = 1
      do node = 1, nodes
         x = t(1) + (node - 1)*step
         do while (row < size(t) - 1)
            if (t(row + 1) > x) exit
            row = row + 1
         end do
         call interpolate(t, x, row, step, first, last, weights)
         associate (w => weights(:last - first + 1))
            values(node) = dot_product(w, z(first:last))
            errors(node) = sum(w*tone(first:last)) - exp(cmplx(0.0_wp, omega*(x - t(1)), wp))
            spoilt(node) = any(bad(first:last))
         end associate
      end do
   end subroutine fill_nodes

   !> The weights of the samples first .. last for the polynomial through them, at x.
   !>
   !> row   t(row) <= x <= t(row + 1)
   pure subroutine interpolate(t, x, row, step, first, last, weights)
      real(wp), intent(in) :: t(:), x, step
      integer, intent(in) :: row
      integer, intent(out) :: first, last
      real(wp), intent(out) :: weights(2*reach)
      real(wp), parameter :: same = 1e-9_wp
      integer :: half

      first = row
      if (t(row + 1) - x < x - t(row)) first = row + 1
      last = first
      weights = 1
      if (abs(t(first) - x) <= same*step) return
      do half = reach, 1, -1
         first = max(1, row - half + 1)
         last = min(size(t), row + half)
         call lagrange((x - t(first:last))/step, weights(:last - first + 1))
         if (sum(abs(weights(:last - first + 1))) <= most_weight) return
      end do
   end subroutine interpolate

   !> Lagrange's weights.
   !>
   !> d        (points) from the points to where the polynomial is wanted, none of them 0
   !> weights  (points)
   pure subroutine lagrange(d, weights)
      real(wp), intent(in) :: d(:)
      real(wp), intent(out) :: weights(:)
      real(wp) :: difference
      integer :: k, j

      weights = d
      do k = 1, size(d)
         do j = k + 1, size(d)
            difference = d(j) - d(k)
            weights(k) = weights(k)*difference
            weights(j) = -weights(j)*difference
         end do
      end do
      weights = product(d)/weights
   end subroutine lagrange

end module beamid_thinning
