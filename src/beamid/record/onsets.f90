!> Detects where the motion begins in a record with a quiet lead-in.
module beamid_onsets
   use beamid_kinds, only: wp
   implicit none
   private

   public :: onset

   !> Number of blocks into which the record is divided. A block is quiet if its range is below
   !> `quiet` times the largest range of a block, and loud if it is above `loud` times that.
   integer, parameter :: blocks = 200
   real(wp), parameter :: quiet = 0.05_wp, loud = 0.25_wp
   !> Least number of quiet blocks in a lead-in, and largest number of blocks between the lead-in
   !> and the first loud block. In a free decay that starts at a turning point, at most the first
   !> block is quiet, and the ranges of the next blocks grow gradually.
   integer, parameter :: least_quiet = 5, most_between = 2

contains

   !> Returns the index of the first sample of the motion, or 1 if the record has no
   !> lead-in or fewer than five samples per block.
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
