!> Sorting of numbers, and their median.
module beamid_sorting
   use beamid_kinds, only: wp
   implicit none
   private

   public :: sort, sort_by, median

   interface
      !> LAPACK: sorts numbers, id = 'I' for ascending.
      subroutine dlasrt(id, n, d, info)
         import :: wp
         character(len=1), intent(in) :: id
         integer, intent(in) :: n
         real(wp), intent(inout) :: d(*)
         integer, intent(out) :: info
      end subroutine dlasrt
   end interface

contains

   !> Sorts numbers into ascending order.
   subroutine sort(values)
      real(wp), intent(inout) :: values(:)
      integer :: info

      call dlasrt('I', size(values), values, info)
   end subroutine sort

   !> Sorts complex numbers by ascending keys, by insertion; equal keys keep their order.
   pure subroutine sort_by(keys, values)
      real(wp), intent(in) :: keys(:)
      complex(wp), intent(inout) :: values(:)
      real(wp) :: sorted(size(keys))
      integer :: i, k

      do i = 1, size(keys)
         k = count(sorted(:i - 1) <= keys(i))
         sorted(:i) = [sorted(:k), keys(i), sorted(k + 1:i - 1)]
         values(:i) = [values(:k), values(i), values(k + 1:i - 1)]
      end do
   end subroutine sort_by

   !> Returns the median (of an even number of values the lower one); 0 if there are no values. Of
   !> more than 100000 values, every k-th value is used, so that at most 100000 remain.
   real(wp) function median(values)
      real(wp), intent(in) :: values(:)
      integer, parameter :: most = 100000
      real(wp), allocatable :: sample(:)

      median = 0
      if (size(values) == 0) return
      sample = values(::1 + (size(values) - 1)/most)
      call select_smallest((size(sample) + 1)/2, sample)
      median = sample((size(sample) + 1)/2)
   end function median

   !> Reorders values until the k-th smallest is in place k, by Hoare's algorithm (C. A. R. Hoare,
   !> Algorithm 65, Communications of the ACM 4, 1961, p. 321). This takes a time proportional to
   !> their number.
   pure subroutine select_smallest(k, values)
      integer, intent(in) :: k
      real(wp), intent(inout) :: values(:)
      real(wp) :: pivot, swapped
      integer :: first, last, i, j

      first = 1
      last = size(values)
      do while (first < last)
         pivot = values((first + last)/2)
         i = first
         j = last
         do while (i <= j)
            do while (values(i) < pivot)
               i = i + 1
            end do
            do while (values(j) > pivot)
               j = j - 1
            end do
            if (i > j) exit
            swapped = values(i)
            values(i) = values(j)
            values(j) = swapped
            i = i + 1
            j = j - 1
         end do
         ! The values between j and i equal the pivot.
         if (k <= j) then
            last = j
         else if (k >= i) then
            first = i
         else
            return
         end if
      end do
   end subroutine select_smallest

end module beamid_sorting
