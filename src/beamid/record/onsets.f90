!> Detects where the motion begins in a record with a quiet lead-in.
module beamid_onsets
   use beamid_kinds, only: wp
   implicit none
   private

   public :: onset

   !> The record is divided into so many blocks. A block is quiet if its range is below `quiet`
   !> times the largest range of a block, and loud if it is above `loud` times that.
   integer, parameter :: blocks = 200
   real(wp), parameter :: quiet = 0.05_wp, loud = 0.25_wp
   !> A lead-in has at least so many quiet blocks, and at most so many blocks lie between it and the
   !> first loud block. A free decay that begins at a turning point leaves its first block quiet at
   !> most, and its range rises gradually.
   integer, parameter :: least_quiet = 5, most_between = 2

contains

   !> Returns the index of the first sample of the motion, or 1 if the record has no lead-in.
   !>
   !> z  (m) samples in any unit, with any offset
   pure integer function onset(z)
      real(wp), intent(in) :: z(:)
      real(wp) :: ranges(blocks), mean, largest
      integer :: first(blocks + 1), k, last_quiet, first_loud

      onset = 1
      if (size(z) < 5*blocks) return
      first = 1 + [(int(real(k, wp)*size(z)/blocks), k=0, blocks)]
      ranges = [(maxval(z(first(k):first(k + 1) - 1)) - minval(z(first(k):first(k + 1) - 1)), &
         k=1, blocks)]
      largest = maxval(ranges)
      first_loud = findloc(ranges >= loud*largest, .true., dim=1)
      last_quiet = findloc(ranges >= quiet*largest, .true., dim=1) - 1
      if (last_quiet < least_quiet .or. first_loud - last_quiet > most_between + 1) return
      associate (lead => z(:first(last_quiet + 1) - 1))
         mean = sum(lead)/size(lead)
         do onset = size(lead) + 1, size(z)
            if (abs(z(onset) - mean) > 2*maxval(abs(lead - mean))) return
         end do
      end associate
      onset = 1
   end function onset

end module beamid_onsets
