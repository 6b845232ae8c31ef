!> Motion of a cluster of roots in time.
!>
!> With d = (d/dt - c)/R the states are v, d v, ..., d**(m-1) v, where R P(d) v = f, and for
!> derivatives with respect to parameters as many of y, P(d) y = v: a linear system
!>
!>     x' = B x + e_m f
!>
!> that no parameter but those of the roots enters, solved by exponentials of small matrices. N(d) v
!> is the motion with the transfer function N/(R P); of two roots c +- D the free motions are
!> e**(c t) cosh D t and e**(c t) sinh(D t)/D.
module beamid_cluster_motion
   use beamid_clusters, only: cluster_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: cluster_state_t, free_states

   type :: cluster_state_t
      complex(wp), allocatable :: x(:)            !< (m), or (2 m) with derivatives
      complex(wp), allocatable :: growth(:, :)    !< e**(B step)
      complex(wp), allocatable :: drive(:, :)     !< what f and (slope of f) step add
   contains
      procedure :: advance
   end type cluster_state_t

contains

   !> One step further.
   !>
   !> force, slope  f at its beginning, and df/dt
   !> same          the step is that of the last call
   pure subroutine advance(self, cluster, force, slope, step, same)
      class(cluster_state_t), intent(inout) :: self
      type(cluster_t), intent(in) :: cluster
      real(wp), intent(in) :: force, slope, step
      logical, intent(in) :: same
      complex(wp) :: a(size(self%x) + 2, size(self%x) + 2)
      integer :: n

      if (.not. same) then
         n = size(self%x)
         a = 0
         a(:n, :n) = step*generator(cluster, n)
         self%growth = exponential(a(:n, :n), cluster%centre%s*step)
         ! x/step, f and slope step as one system: f' = slope.
         a(:n, :n) = a(:n, :n) + cluster%centre%s*step*unit(n)
         a(cluster%m, n + 1) = 1
         a(n + 1, n + 2) = 1
         a = exponential(a, (0.0_wp, 0.0_wp))
         self%drive = step*a(:n, n + 1:)
      end if
      self%x = matmul(self%growth, self%x) + self%drive(:, 1)*force + self%drive(:, 2)*slope*step
   end subroutine advance

   !> States at the times after a unit impulse.
   !>
   !> n  how many of them, m or 2 m
   pure function free_states(cluster, n, times) result(states)
      type(cluster_t), intent(in) :: cluster
      integer, intent(in) :: n
      real(wp), intent(in) :: times(:)
      complex(wp) :: states(size(times), n), a(n, n)
      integer :: i

      a = generator(cluster, n)
      do i = 1, size(times)
         associate (t => times(i), s => cluster%centre%s)
            states(i, :) = column(exponential(a*t, s*t), cluster%m)
         end associate
      end do
   end function free_states

   !> B - c
   pure function generator(cluster, n) result(a)
      type(cluster_t), intent(in) :: cluster
      integer, intent(in) :: n
      complex(wp) :: a(n, n)
      integer :: i

      a = 0
      do i = 1, n
         if (modulo(i, cluster%m) > 0) then
            a(i, i + 1) = cluster%radius
         else
            a(i, i - cluster%m + 1:i) = -cluster%radius*cluster%a(:cluster%m)
            if (i > cluster%m) a(i, 1) = cluster%radius
         end if
      end do
   end function generator

   !> e**(a + shift), by the series and by squaring.
   pure function exponential(a, shift) result(e)
      complex(wp), intent(in) :: a(:, :), shift
      complex(wp) :: e(size(a, 1), size(a, 1)), small(size(a, 1), size(a, 1))
      integer :: k, squarings

      ! .5**15/15! < 1e-16
      squarings = max(0, exponent(maxval(sum(abs(a), dim=1))) + 1)
      small = scale(1.0_wp, -squarings)*a
      e = unit(size(a, 1))
      do k = 14, 1, -1
         e = unit(size(a, 1)) + matmul(small, e)/k
      end do
      e = exp(scale(1.0_wp, -squarings)*shift)*e
      do k = 1, squarings
         e = matmul(e, e)
      end do
   end function exponential

   pure function unit(n)
      integer, intent(in) :: n
      complex(wp) :: unit(n, n)
      integer :: i

      unit = 0
      do i = 1, n
         unit(i, i) = 1
      end do
   end function unit

   pure function column(a, k)
      complex(wp), intent(in) :: a(:, :)
      integer, intent(in) :: k
      complex(wp) :: column(size(a, 1))

      column = a(:, k)
   end function column

end module beamid_cluster_motion
