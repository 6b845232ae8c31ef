!> Motion by poles so fast that their state is quasi-static at all samples.
!>
!> Where such a pole s has decayed since the last node of the force f, its state z, as of
!> `beamid_synthesis`, is -f/s - f'/s**2. What all of these poles contribute follows from the sums
!> of r s**k over all poles, r the residues: h(0) and h'(0) of the transfer function, with the
!> opposite sign, for k = -1 and -2, and 0 and o'M**-1 F for k = 0 and 1.
module beamid_quasi_static
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   implicit none
   private

   public :: slowest_unseen, add_quasi_static, round_off

   !> Decay of what is not seen, as a logarithm; e**-40 is 4e-18.
   real(wp), parameter :: unseen = 40

contains

   !> Returns the decay rate above which the state of a pole is quasi-static at all samples
   !> [1/time].
   pure real(wp) function slowest_unseen(excitation, times) result(rate)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)   !< ascending [time]
      real(wp) :: f(2), since
      integer :: k, node

      rate = 0
      node = 0
      do k = 1, size(times)
         call before(excitation, times(k), node, f, since)
         rate = max(rate, unseen/since)
      end do
   end function slowest_unseen

   !> Computes the force just before a time, and how long it has had no node.
   !>
   !> node   in and out: last node before t, 0 if there is none; in: that of an earlier time
   !> f      force [force] and its slope [force/time]
   !> since  time since the node; `huge` if there is none
   pure subroutine before(excitation, t, node, f, since)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: t
      integer, intent(inout) :: node
      real(wp), intent(out) :: f(2), since

      f = 0
      since = huge(since)
      associate (nodes => excitation%t, force => excitation%f)
         do while (node < size(nodes))
            if (nodes(node + 1) >= t - round_off(t)) exit
            node = node + 1
         end do
         if (node == 0) return
         since = t - nodes(node)
         if (node == size(nodes)) return
         f(2) = (force(node + 1) - force(node))/(nodes(node + 1) - nodes(node))
         f(1) = force(node) + f(2)*since
      end associate
   end subroutine before

   !> Adds the motion by the poles that have been left out.
   !> Arguments as of `synthesize`.
   subroutine add_quasi_static(poles, excitation, times, which, motion)
      type(poles_t), intent(in) :: poles
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: which(:)
      real(wp), intent(inout) :: motion(:, 0:, :)
      real(wp) :: rest(-2:1, 0:ubound(motion, 2)), f(2), since
      integer :: k, n, node, p, q

      ! The sums of r s**k over the poles that are there, less those over all poles.
      n = ubound(motion, 2)
      rest(-2, :) = poles%static(2, :n)
      rest(-1, :) = poles%static(1, :n)
      rest(0, :) = 0
      rest(1, :) = -[poles%impulse, poles%dimpulse(:n)]
      associate (r => poles%residue, s => poles%s)
         do k = -2, 1
            rest(k, 0) = rest(k, 0) + sum(real(r*s**k))
            do p = 1, n
               rest(k, p) = rest(k, p) + sum(real((poles%dr(:, p) + k*r*poles%ds(:, p)/s)*s**k))
            end do
         end do
      end associate
      node = 0
      do k = 1, size(times)
         call before(excitation, times(k), node, f, since)
         if (.not. any(abs(f) > 0)) cycle
         do q = 1, size(which)
            motion(k, :, q) = motion(k, :, q) + f(1)*rest(which(q) - 2, :) &
               + f(2)*rest(which(q) - 3, :)
         end do
      end do
   end subroutine add_quasi_static

   !> Returns the difference below which two times near t are equal, four units in the last place
   !> [time].
   pure real(wp) function round_off(t)
      real(wp), intent(in) :: t

      round_off = 4*epsilon(t)*abs(t)
   end function round_off

end module beamid_quasi_static
