!> Order statistics of samples.
module beamid_sorting
   use beamid_kinds, only: wp
   implicit none
   private

   public :: sort, median

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

   !> The median, of very many numbers that of 100000 of them in even steps; 0 when there is none.
   real(wp) function median(values)
      real(wp), intent(in) :: values(:)
      integer, parameter :: most = 100000
      real(wp), allocatable :: some(:)

      median = 0
      if (size(values) == 0) return
      some = values(::1 + (size(values) - 1)/most)
      call sort(some)
      median = some((size(some) + 1)/2)
   end function median

end module beamid_sorting
