!> Thins a record to every k-th sample behind a symmetric low-pass filter, a sinc with a Kaiser
!> window.
!>
!> The filter passes 0 to 0.6 of the new Nyquist frequency f_N, half the mean sampling rate over k,
!> and stops everything above f_N, each within 3e-5 (90 dB). There is no aliasing and no phase
!> shift.
!>
!> The time stamps may be uneven. The filter's integral is a sum over nodes at the mean time step. A
!> polynomial through up to 12 neighbours gives the record's value at a node; its degree is lower
!> where uneven time stamps would amplify the noise. A tone of 0.5 f_N is filtered in the same way,
!> and a sample is kept only if the tone comes out right. A gap therefore removes only those samples
!> beside it that it would spoil. With uneven time stamps, tones with fewer than 4 or 5 stamps per
!> period are stopped less well.
module beamid_thinning
   use beamid_kinds, only: pi, wp
   use beamid_sorting, only: median
   implicit none
   private

   public :: thinned_t, thin_out, gap_limit, margin_of

   !> A time step of more than this many median steps is a gap.
   real(wp), parameter :: gap_factor = 20
   !> Half the length of the filter in samples, over k; parameter of the Kaiser window for 90 dB;
   !> middle of the transition band and edge of the guaranteed passband, over f_N.
   real(wp), parameter :: half_samples = 14.4_wp, beta = 8.96_wp, cutoff = 0.8_wp, &
      passband_edge = 0.5_wp
   !> Largest error of the tone, beside the filter's own 3e-5.
   real(wp), parameter :: tolerance = 5e-5_wp
   !> Half the largest number of neighbours of a node; largest sum of the absolute values of their
   !> weights.
   integer, parameter :: reach = 6
   real(wp), parameter :: max_weight = 4
   !> Number of intervals in the table of the filter; linear interpolation between them is accurate
   !> to 1e-6 of the peak.
   integer, parameter :: intervals = 16384

   !> A thinned record.
   type :: thinned_t
      real(wp), allocatable :: t(:), z(:)   !< (samples) times [time] and filtered values
      real(wp) :: passes = 0                !< frequencies below pass within 1e-4 [1/time]
      real(wp) :: stops = 0                 !< frequencies above are stopped [1/time]
      real(wp) :: half_width = 0            !< half the span that each sample averages [time]
      integer :: lost = 0                   !< number of samples that could not be computed
   end type thinned_t

contains

   !> Returns the number of rows that the filter needs on either side of a sample, with a reserve.
   !>
   !> k  every k-th sample is kept
   pure integer function margin_of(k) result(rows)
      integer, intent(in) :: k

      rows = ceiling(2*half_samples*k) + 2*reach
   end function margin_of

   !> Filters every k-th of the wanted rows. Leaves out samples for which the record is too short,
   !> or contains a gap or a bad sample within the filter's length.
   !>
   !> t, z     (rows) times, ascending, and values of the record
   !> bad      (rows) whether a sample must not be used
   !> wanted   indices in t, ascending, of the rows of the window
   !> k        2 or more
   !> thinned  on return the thinned record
   subroutine thin_out(t, z, bad, wanted, k, thinned)
      real(wp), intent(in) :: t(:), z(:)
      logical, intent(in) :: bad(:)
      integer, intent(in) :: wanted(:), k
      type(thinned_t), intent(out) :: thinned
      real(wp), allocatable :: filtered(:), kernel(:)
      logical, allocatable :: good(:)
      integer, allocatable :: places(:), part_ends(:)
      real(wp) :: steps(size(t) - 1), step, limit
      integer :: first, last, from, to, j

      allocate (thinned%t(0), thinned%z(0))
      places = wanted(::k)
      thinned%lost = size(places)
      limit = gap_limit(t)
      steps = t(2:) - t(:size(t) - 1)
      step = sum(steps, mask=steps <= limit)/max(1, count(steps <= limit))
      if (.not. step > 0) return
      thinned%half_width = half_samples*k*step
      thinned%passes = passband_edge/(2*k*step)
      thinned%stops = 1/(2*k*step)
      kernel = low_pass_kernel()

      ! Filters each part between two gaps separately.
      allocate (filtered(size(places)), good(size(places)))
      good = .false.
      part_ends = [pack([(j, j=1, size(t) - 1)], steps > limit), size(t)]
      last = 0
      to = 0
      do j = 1, size(part_ends)
         first = last + 1
         last = part_ends(j)
         from = to + 1
         to = to + count(places(from:) <= last)
         if (to >= from .and. t(last) - t(first) > 2*thinned%half_width) &
            call filter_without_gaps(t(first:last), z(first:last), bad(first:last), &
            t(places(from:to)), step, thinned, kernel, filtered(from:to), good(from:to))
      end do
      thinned%t = pack(t(places), good)
      thinned%z = pack(filtered, good)
      thinned%lost = count(.not. good)
   end subroutine thin_out

   !> Returns the longest time step that is no gap [time].
   real(wp) function gap_limit(t) result(limit)
      real(wp), intent(in) :: t(:)

      limit = gap_factor*median(t(2:) - t(:size(t) - 1))
   end function gap_limit

   !> Returns the impulse response of the filter, from its middle (0) to its end (intervals),
   !> relative to the middle.
   pure function low_pass_kernel() result(kernel)
      real(wp) :: kernel(0:intervals + 1)
      real(wp) :: u, x
      integer :: k

      kernel = 0
      do k = 0, intervals
         u = real(k, wp)/intervals
         x = pi*cutoff*half_samples*u
         kernel(k) = bessel_i0(beta*sqrt(1 - u*u))
         if (k > 0) kernel(k) = kernel(k)*sin(x)/x
      end do
      kernel = kernel/kernel(0)
   end function low_pass_kernel

   !> Returns the modified Bessel function I_0, for arguments up to about 20.
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
   !> t, z, bad  (rows) of the part, as in `thin_out`
   !> at         (samples) times of the wanted samples, ascending [time]
   !> step       between the nodes [time]
   !> thinned    with the half width and the passband
   !> kernel     impulse response
   !> filtered   (samples) values where `good`
   !> good       (samples) whether a sample could be computed
   subroutine filter_without_gaps(t, z, bad, at, step, thinned, kernel, filtered, good)
      real(wp), intent(in) :: t(:), z(:), at(:), step, kernel(0:)
      logical, intent(in) :: bad(:)
      type(thinned_t), intent(in) :: thinned
      real(wp), intent(out) :: filtered(:)
      logical, intent(out) :: good(:)
      real(wp), allocatable :: values(:)
      complex(wp), allocatable :: errors(:)
      logical, allocatable :: is_spoilt(:)
      real(wp) :: total, u, weight
      complex(wp) :: error
      integer :: k, j, first, last, place

      call interpolate_to_nodes(t, z, bad, step, 2*pi*thinned%passes, values, errors, is_spoilt)
      filtered = 0
      good = .false.
      do k = 1, size(at)
         if (at(k) - thinned%half_width < t(1)) cycle
         if (at(k) + thinned%half_width > t(size(t))) cycle
         first = ceiling((at(k) - thinned%half_width - t(1))/step) + 1
         last = min(floor((at(k) + thinned%half_width - t(1))/step) + 1, size(values))
         if (any(is_spoilt(first:last))) cycle
         total = 0
         error = 0
         do j = first, last
            u = abs((j - 1)*step - (at(k) - t(1)))*(intervals/thinned%half_width)
            place = int(u)
            weight = kernel(place) + (u - place)*(kernel(place + 1) - kernel(place))
            total = total + weight
            filtered(k) = filtered(k) + weight*values(j)
            error = error + weight*errors(j)
         end do
         filtered(k) = filtered(k)/total
         good(k) = abs(error/total) <= tolerance
      end do
   end subroutine filter_without_gaps

   !> Interpolates the record to nodes of even steps from its first sample, and computes the error
   !> of a tone there.
   !>
   !> t, z, bad  (rows) of the part, as in `thin_out`
   !> step       between the nodes [time]
   !> omega      angular frequency of the tone exp(i omega (t - t(1))) [1/time]
   !> values     (nodes) of the record
   !> errors     (nodes) of the tone
   !> is_spoilt  (nodes) whether a bad sample contributes to the value
   subroutine interpolate_to_nodes(t, z, bad, step, omega, values, errors, is_spoilt)
      real(wp), intent(in) :: t(:), z(:), step, omega
      logical, intent(in) :: bad(:)
      real(wp), allocatable, intent(out) :: values(:)
      complex(wp), allocatable, intent(out) :: errors(:)
      logical, allocatable, intent(out) :: is_spoilt(:)
      complex(wp), allocatable :: tone(:)
      real(wp) :: weights(2*reach), x
      integer :: node, nodes, row, first, last

      nodes = floor((t(size(t)) - t(1))/step*(1 + 1e-12_wp)) + 1
      allocate (values(nodes), errors(nodes), is_spoilt(nodes))
      tone = exp(cmplx(0.0_wp, omega*(t - t(1)), wp))
      row = 1
      do node = 1, nodes
         x = t(1) + (node - 1)*step
         do while (row < size(t) - 1)
            if (t(row + 1) > x) exit
            row = row + 1
         end do
         call interpolation_weights(t, x, row, step, first, last, weights)
         associate (w => weights(:last - first + 1))
            values(node) = dot_product(w, z(first:last))
            errors(node) = sum(w*tone(first:last)) - exp(cmplx(0.0_wp, omega*(x - t(1)), wp))
            is_spoilt(node) = any(bad(first:last))
         end associate
      end do
   end subroutine interpolate_to_nodes

   !> Computes the weights of the samples first .. last for the polynomial through them at x.
   !>
   !> t        (rows) times [time]
   !> x        time of the node [time]
   !> row      t(row) <= x <= t(row + 1)
   !> step     between the nodes [time]
   !> weights  of the samples; the further elements are not used
   pure subroutine interpolation_weights(t, x, row, step, first, last, weights)
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
         call lagrange_weights((x - t(first:last))/step, weights(:last - first + 1))
         if (sum(abs(weights(:last - first + 1))) <= max_weight) return
      end do
   end subroutine interpolation_weights

   !> Computes Lagrange's weights of polynomial interpolation.
   !>
   !> d        (points) distances from the points to the place of interpolation, none 0
   !> weights  (points)
   pure subroutine lagrange_weights(d, weights)
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
   end subroutine lagrange_weights

end module beamid_thinning
