!> Samples that sit at the limit of the sensor or of its converter.
!>
!> A limit shows as flats, three or more equal samples in a row at the extreme of the record. A
!> coarse converter makes flats of good samples too, at the top of any slow swing: one that stays
!> within a step q of the converter for n samples has a curvature of at most 8 q/(n - 1)**2 per
!> sample squared and falls by less than 17 q within n samples on either side; a swing cut off at a
!> height E above the limit falls by 7 E to 15 E there. So a flat is evidence of a limit when the
!> signal falls by more than 20 q within its own length on both sides. What that lets pass is wrong
!> by less than 3 q.
!>
!> Records that repeat every value, or whose steps are coarser at the top than elsewhere, have such
!> flats at other levels too: the extreme must hold more of them than all levels between the two.
module beamid_clipping
   use beamid_kinds, only: wp
   use beamid_sorting, only: sort
   implicit none
   private

   public :: find_limit

   integer, parameter :: shortest = 3      !< samples of a flat
   real(wp), parameter :: steep = 20       !< steps of the converter

contains

   !> Looks for a limit that the record reaches from below.
   !>
   !> z      (samples) in order of time; of the negated record for the limit from above
   !> limit  samples with z >= limit are at the limit; huge() where there is no evidence of one
   subroutine find_limit(z, limit)
      real(wp), intent(in) :: z(:)
      real(wp), intent(out) :: limit
      real(wp) :: top, bottom, fall
      integer :: first, last, at_top, elsewhere, n

      limit = huge(limit)
      n = size(z)
      if (n < shortest) return
      top = maxval(z)
      bottom = minval(z)
      if (.not. any(min(z(:n - 2), z(2:n - 1), z(3:)) >= top)) return
      fall = steep*converter_step(z, top, top - bottom)
      if (.not. fall < top - bottom) return
      at_top = 0
      elsewhere = 0
      last = 0
      do while (last < n)
         first = last + 1
         do last = first, n - 1
            if (abs(z(last + 1) - z(first)) > 0) exit
         end do
         if (last - first + 1 < shortest .or. first == 1 .or. last == n) cycle
         if (.not. is_steep(z, first, last, fall)) cycle
         if (z(first) >= top) then
            at_top = at_top + 1
         else if (z(first) > bottom) then
            elsewhere = elsewhere + 1
         end if
      end do
      if (at_top > elsewhere) limit = top
   end subroutine find_limit

   !> Whether the signal leaves a level by more than `fall`, within as many samples as it stayed
   !> there, before and after.
   pure logical function is_steep(z, first, last, fall) result(yes)
      real(wp), intent(in) :: z(:)
      !> The samples at the level; neither the first nor the last of all.
      integer, intent(in) :: first, last
      real(wp), intent(in) :: fall
      integer :: length

      length = last - first + 1
      yes = maxval(abs(z(max(1, first - length):first - 1) - z(first))) > fall
      if (yes) yes = maxval(abs(z(last + 1:min(size(z), last + length)) - z(first))) > fall
   end function is_steep

   !> The step of the converter: the smallest difference of two values of the upper half, or of all
   !> where those are one.
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

   !> The smallest difference between numbers that are not the same; `span` when all are.
   real(wp) function smallest_difference(values, span) result(least)
      !> The numbers; sorted on return.
      real(wp), intent(inout) :: values(:)
      !> Between the largest and the smallest of the record; 1e-12 of it is round-off.
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
