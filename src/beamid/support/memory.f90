!> Memory that the program no longer uses, as glibc manages it.
module beamid_memory
   use, intrinsic :: iso_c_binding, only: c_int, c_size_t
   implicit none
   private

   public :: return_memory

   interface
      !> Returns free pages to the system, also those between pages in use.
      !>
      !> pad  number of bytes that may stay free at the end [bytes]
      integer(c_int) function c_malloc_trim(pad) bind(c, name='malloc_trim')
         import :: c_int, c_size_t
         integer(c_size_t), value :: pad
      end function c_malloc_trim
   end interface

   !> Least number of samples for which the memory that comes back is worth the time.
   integer, parameter :: many_samples = 100000

contains

   !> Returns free memory to the system after a step that has handled long records. Without this
   !> call, free pages that lie between used ones stay with the program.
   !>
   !> samples  number of samples of all records
   subroutine return_memory(samples)
      integer, intent(in) :: samples
      integer(c_int) :: ignored

      if (samples >= many_samples) ignored = c_malloc_trim(0_c_size_t)
   end subroutine return_memory

end module beamid_memory
