!> Free motion: the lowest modes, each as a complex motion whose real and imaginary parts are the
!> two motions of the mode.
!>
!> A mode with root s moves like e**(s tau)/s**2 at time tau after release, an acceleration of order
!> one. If two roots c +- D nearly coincide, e**((c + D) tau) and e**((c - D) tau) are nearly
!> linearly dependent. They are then replaced by e**(c tau) cosh D tau and e**(c tau) sinh(D tau)/D.
!> The same applies to the two roots of a mode near critical damping, which are real or a complex
!> pair.
module beamid_free_motion
   use beamid_cluster_motion, only: free_states
   use beamid_clusters, only: cluster_t
   use beamid_contours, only: free_rows
   use beamid_errors, only: error_t, failure
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   use beamid_strings, only: to_text
   implicit none
   private

   public :: free_mode_t, find_free_modes

   !> A mode in free motion. Each motion is a linear combination of states, which are functions of
   !> time.
   type :: free_mode_t
      complex(wp) :: s = 0                          !< root [1/time]
      !> (parameters) derivatives of the root; in a cluster, those of the mean of its roots
      complex(wp), allocatable :: ds(:)
      !> displacement of the sensor in the mode, up to a factor that is the same for all sensors; 0
      !> if the mode belongs to a cluster
      complex(wp) :: seen = 0
      !> (parameters) derivatives of `seen`
      complex(wp), allocatable :: dseen(:)
      !> (states, 3) coefficients of the states in displacement, velocity and acceleration
      complex(wp), allocatable :: row(:, :)
      !> (states, 3, parameters) their derivatives
      complex(wp), allocatable :: drow(:, :, :)
      !> the cluster to which the mode belongs; not allocated: none
      type(cluster_t), allocatable :: cluster
   contains
      procedure :: states, as_seen_beside
   end type free_mode_t

contains

   !> Selects the lowest modes, in ascending order of |s|; of a cluster, as many as are wanted.
   !>
   !> poles   poles with derivatives
   !> wanted  number of modes
   !> modes   (wanted)
   !> error   there are fewer modes
   subroutine find_free_modes(poles, wanted, modes, error)
      type(poles_t), intent(in) :: poles
      integer, intent(in) :: wanted
      type(free_mode_t), allocatable, intent(out) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: magnitude(size(poles%s) + size(poles%cluster))
      logical :: remaining(size(magnitude))
      integer :: found, k, next, n

      n = size(poles%s)
      magnitude = [abs(poles%s), abs(poles%cluster%centre%s)]
      do k = 1, n
         remaining(k) = aimag(poles%s(k)) > 0 .and. .not. any(poles%cluster%holds(poles%s(k)))
      end do
      remaining(n + 1:) = poles%cluster%modes() > 0
      found = count(remaining(:n)) + sum(poles%cluster%modes())
      if (found < wanted) then
         call failure(error, 'modal: found '//to_text(found)//' modes that oscillate, expected '// &
            to_text(wanted)//' for the free motion: the others are overdamped, or the mesh is '// &
            'too coarse for them. Check c_D, gamma and other damping, their units, and '// &
            'elements, or reduce modes in &excitation')
         return
      end if
      allocate (modes(wanted))
      found = 0
      do while (found < wanted)
         next = minloc(magnitude, dim=1, mask=remaining)
         remaining(next) = .false.
         if (next <= n) then
            found = found + 1
            modes(found) = mode_of_root(poles%s(next), poles%ds(next, :))
            modes(found)%seen = poles%residue(next)
            modes(found)%dseen = poles%dr(next, :)
         else
            do k = 1, min(poles%cluster(next - n)%modes(), wanted - found)
               found = found + 1
               modes(found) = mode_of_cluster(poles, poles%cluster(next - n), k)
            end do
         end if
      end do
   end subroutine find_free_modes

   !> Returns the mode of an isolated root. Its states are e**(s tau) and tau e**(s tau).
   !>
   !> s, ds  the root [1/time] and its derivatives (parameters)
   pure function mode_of_root(s, ds) result(mode)
      complex(wp), intent(in) :: s, ds(:)
      type(free_mode_t) :: mode
      integer :: order, p

      mode%s = s
      mode%ds = ds
      allocate (mode%row(2, 3), mode%drow(2, 3, size(ds)))
      do order = 1, 3
         mode%row(:, order) = [s**(order - 3), (0.0_wp, 0.0_wp)]
         do p = 1, size(ds)
            mode%drow(:, order, p) = ds(p)*[(order - 3)*s**(order - 4), s**(order - 3)]
         end do
      end do
   end function mode_of_root

   !> Returns mode k of a cluster. If the cluster lies on the real axis, its states are real, and
   !> two of them make one mode.
   pure function mode_of_cluster(poles, cluster, k) result(mode)
      type(poles_t), intent(in) :: poles
      type(cluster_t), intent(in) :: cluster
      integer, intent(in) :: k
      type(free_mode_t) :: mode
      complex(wp), allocatable :: s(:), row(:, :), second(:, :), drow(:, :, :), dsecond(:, :, :)
      integer :: p

      s = pack(poles%s, cluster%holds(poles%s) .and. aimag(poles%s) > 0)
      mode%s = cluster%centre%s
      if (k <= size(s)) mode%s = s(k)
      mode%ds = [(cluster%dmean(p), p=1, size(cluster%da, 2))]
      mode%cluster = cluster
      if (cluster%on_axis) then
         call free_rows(cluster, 2*k - 1, row, drow)
         call free_rows(cluster, 2*k, second, dsecond)
         row = row - (0, 1)*second
         drow = drow - (0, 1)*dsecond
      else
         call free_rows(cluster, k, row, drow)
      end if
      allocate (mode%row(2*cluster%m, 3), source=(0.0_wp, 0.0_wp))
      mode%row(:cluster%m, :) = row
      mode%drow = drow
   end function mode_of_cluster

   !> Converts a mode to the motion at this sensor, if the motion of the same mode at another sensor
   !> is given: multiplies by the ratio of the two displacements in the mode.
   !>
   !> other  the mode at the other sensor
   pure subroutine as_seen_beside(self, other)
      class(free_mode_t), intent(inout) :: self
      type(free_mode_t), intent(in) :: other
      complex(wp) :: ratio, change
      integer :: p

      ratio = self%seen/other%seen
      do p = 1, size(self%drow, 3)
         change = (self%dseen(p) - ratio*other%dseen(p))/other%seen
         self%drow(:, :, p) = ratio*self%drow(:, :, p) + change*self%row
      end do
      self%row = ratio*self%row
   end subroutine as_seen_beside

   !> Returns the states at times after release.
   !>
   !> tau     times after release [time]
   !> states  (times, states)
   pure function states(self, tau)
      class(free_mode_t), intent(in) :: self
      real(wp), intent(in) :: tau(:)
      complex(wp), allocatable :: states(:, :)

      if (allocated(self%cluster)) then
         states = free_states(self%cluster, size(self%row, 1), tau)
      else
         allocate (states(size(tau), 2))
         states(:, 1) = exp(self%s*tau)
         states(:, 2) = tau*states(:, 1)
      end if
   end function states

end module beamid_free_motion
