!> Detects samples that are clipped at the limit of the sensor or of its analogue-to-digital
!> converter.
!>
!> A limit appears as flats: three or more equal samples in a row at the extreme of the record. A
!> coarse converter also makes flats of good samples, at the top of any slow oscillation. If such a
!> flat stays within one step q of the converter for n samples, its curvature is at most
!> 8 q/(n - 1)**2 per sample squared, and the signal falls by less than 17 q within n samples on
!> either side. If an oscillation is cut off at a height E above the limit, the signal falls there
!> by 7 E to 15 E. A flat is therefore evidence of a limit if the signal falls by more than 20 q
!> within its own length on both sides. Clipping that passes this test undetected causes errors of
!> less than 3 q.
!>
!> Records that repeat every value, or whose steps are coarser at the top than elsewhere, have such
!> flats at other levels too. The extreme must therefore have more of them than all levels between
!> the two extremes together.
module beamid_clipping
   use beamid_kinds, only: wp
   use beamid_sorting, only: sort
   implicit none
   private

   public :: find_limit

   integer, parameter :: shortest_flat = 3   !< [samples]
   real(wp), parameter :: min_fall = 20      !< [steps of the converter]

contains

   !> Looks for an upper limit of a record.
   !>
   !> z      (samples) in order of time; the negated record for the lower limit
   !> limit  samples with z >= limit are at the limit; huge() if there is no evidence of a limit
   subroutine find_limit(z, limit)
      real(wp), intent(in) :: z(:)
      real(wp), intent(out) :: limit
      real(wp) :: top, bottom, fall
      integer :: first, last, at_top, elsewhere, n

      limit = huge(limit)
      n = size(z)
      if (n < shortest_flat) return
      top = maxval(z)
      bottom = minval(z)
      if (.not. any(min(z(:n - 2), z(2:n - 1), z(3:)) >= top)) return
      fall = min_fall*converter_step(z, top, top - bottom)
      if (.not. fall < top - bottom) return
      at_top = 0
      elsewhere = 0
      last = 0
      do while (last < n)
         first = last + 1
         do last = first, n - 1
            if (abs(z(last + 1) - z(first)) > 0) exit
         end do
         if (last - first + 1 < shortest_flat .or. first == 1 .or. last == n) cycle
         if (.not. is_steep(z, first, last, fall)) cycle
         if (z(first) >= top) then
            at_top = at_top + 1
         else if (z(first) > bottom) then
            elsewhere = elsewhere + 1
         end if
      end do
      if (at_top > elsewhere) limit = top
   end subroutine find_limit

   !> Returns whether the signal leaves a level by more than `fall`, before and after, within as
   !> many samples as it stayed there.
   pure logical function is_steep(z, first, last, fall) result(yes)
      real(wp), intent(in) :: z(:)
      !> First and last sample at the level; neither the first nor the last of the record.
      integer, intent(in) :: first, last
      real(wp), intent(in) :: fall
      integer :: length

      length = last - first + 1
      yes = maxval(abs(z(max(1, first - length):first - 1) - z(first))) > fall
      if (yes) yes = maxval(abs(z(last + 1:min(size(z), last + length)) - z(first))) > fall
   end function is_steep

   !> Returns the step of the converter: the smallest difference between values in the upper half,
   !> or in the whole record if all values in the upper half are equal.
   real(wp) function converter_step(z, top, span) result(step)
      real(wp), intent(in) :: z(:), top, span
      integer, parameter :: most = 100000
      real(wp), allocatable :: values(:)

      values = pack(z, z >= top - span/2)
      if (size(values) > most) values = values(::1 + (size(values) - 1)/most)
      step = smallest_difference(values, span)
      if (step < span) return
      values = z(::1 + (size(z) - 1)/most)
      step = smallest_difference(values, span)
   end function converter_step

   !> Returns the smallest difference between unequal numbers; `span` if all are equal.
   real(wp) function smallest_difference(values, span) result(least)
      !> The numbers; sorted on return.
      real(wp), intent(inout) :: values(:)
      !> Difference between the extremes of the record; 1e-12 of it is round-off.
      real(wp), intent(in) :: span
      real(wp) :: difference
      integer :: k

      call sort(values)
      least = span
      do k = 2, size(values)
         difference = values(k) - values(k - 1)
         if (difference > 1e-12_wp*span) least = min(least, difference)
      end do
   end function smallest_difference

end module beamid_clipping
