!> What `track` is asked for in each window of a record, and the result in a window.
module beamid_tracked_windows
   use beamid_kinds, only: wp
   use beamid_statistics, only: unlimited
   implicit none
   private

   public :: track_plan_t, tracked_t, append_rows

   !> Settings of the group &track.
   type :: track_plan_t
      integer :: parameter = 0          !< number in `parameters` of the one that is followed
      integer :: line = 0               !< of the group in the case file
      real(wp) :: window = 0            !< length of a window [time]
      real(wp) :: hop = 0               !< from the start of a window to that of the next [time]
      !> standard deviation of the random walk [unit of the searched variable/sqrt(time)];
      !> `unlimited`: no limit
      real(wp) :: rate = unlimited
      !> standard deviation of the error of each natural frequency and decay rate of the model,
      !> relative to the frequency, apart from that of the mesh
      real(wp) :: frequency_error = 0
   end type track_plan_t

   !> Flags of a window: none; the parameter moves in the window; no motion that stands out of the
   !> noise; too few samples.
   character(len=6), parameter, public :: track_flags(4) = ['      ', 'moving', 'unseen', 'gap   ']

   !> The result in one window.
   type :: tracked_t
      real(wp) :: first = 0, last = 0      !< times of the first and the last sample [time]
      real(wp) :: estimate = 0, lower = 0, upper = 0   !< with 95 % limits [unit of the parameter]
      !> share of the energy that the model does not explain
      real(wp) :: misfit = 1
      character(len=6) :: flag = ''        !< one of `track_flags`
      real(wp) :: milliseconds = 0         !< processor time that the window took
   end type tracked_t

contains

   !> Appends rows to a list, which has room for more.
   !>
   !> n     number of rows in the list
   !> list  (n or more)
   pure subroutine append_rows(new, n, list)
      type(tracked_t), intent(in) :: new(:)
      integer, intent(inout) :: n
      type(tracked_t), allocatable, intent(inout) :: list(:)
      type(tracked_t), allocatable :: longer(:)

      if (n + size(new) > size(list)) then
         allocate (longer(2*(n + size(new))))
         longer(:n) = list(:n)
         call move_alloc(longer, list)
      end if
      list(n + 1:n + size(new)) = new
      n = n + size(new)
   end subroutine append_rows

end module beamid_tracked_windows
