!> Motion of a cluster of roots in time.
!>
!> With the operator d = (d/dt - c)/R, the states are v, d v, ..., d**(m-1) v, where R P(d) v = f.
!> Derivatives with respect to parameters have as many additional states of y, where P(d) y = v.
!> Together they are a linear system
!>
!>     x' = B x + e_m f
!>
!> that depends on the roots but on no other parameter. It is solved by exponentials of small
!> matrices. N(d) v is the motion with the transfer function N/(R P). For two roots c +- D, the free
!> motions are e**(c t) cosh D t and e**(c t) sinh(D t)/D.
module beamid_cluster_motion
   use beamid_clusters, only: cluster_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: identity
   implicit none
   private

   public :: cluster_state_t, free_states

   !> The states of a cluster and the matrices of a time step.
   type :: cluster_state_t
      !> (m) states, or (2 m) with derivatives
      complex(wp), allocatable :: x(:)
      !> (states, states) e**(B step)
      complex(wp), allocatable :: growth(:, :)
      !> (states, 2) contributions of f and of (slope of f) x step
      complex(wp), allocatable :: drive(:, :)
   contains
      procedure :: advance
   end type cluster_state_t

contains

   !> Advances the states by one time step.
   !>
   !> force  f at the beginning of the step
   !> slope  df/dt, constant in the step
   !> step   length of the step [time]
   !> same   the step is as long as that of the last call, so that the matrices are used again
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
         ! x/step, f and slope*step are one linear system, because f' = slope.
         a(:n, :n) = a(:n, :n) + cluster%centre%s*step*identity(n)
         a(cluster%m, n + 1) = 1
         a(n + 1, n + 2) = 1
         a = exponential(a, (0.0_wp, 0.0_wp))
         self%drive = step*a(:n, n + 1:)
      end if
      self%x = matmul(self%growth, self%x) + self%drive(:, 1)*force + self%drive(:, 2)*slope*step
   end subroutine advance

   !> Returns the states after a unit impulse.
   !>
   !> n       number of states, m or 2 m
   !> times   after the impulse [time]
   !> states  (times, n)
   pure function free_states(cluster, n, times) result(states)
      type(cluster_t), intent(in) :: cluster
      integer, intent(in) :: n
      real(wp), intent(in) :: times(:)
      complex(wp) :: states(size(times), n), a(n, n), growth(n, n)
      integer :: i

      a = generator(cluster, n)
      do i = 1, size(times)
         associate (t => times(i), s => cluster%centre%s)
            growth = exponential(a*t, s*t)
            states(i, :) = growth(:, cluster%m)
         end associate
      end do
   end function free_states

   !> Returns B - c I, (n, n).
   !>
   !> n  number of states, m or 2 m
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

   !> Returns e**(a + shift I), by the power series and repeated squaring.
   pure function exponential(a, shift) result(e)
      complex(wp), intent(in) :: a(:, :), shift
      complex(wp) :: e(size(a, 1), size(a, 1)), small(size(a, 1), size(a, 1))
      integer :: k, squarings

      ! The remainder of the series is .5**15/15! < 1e-16.
      squarings = max(0, exponent(maxval(sum(abs(a), dim=1))) + 1)
      small = scale(1.0_wp, -squarings)*a
      e = identity(size(a, 1))
      do k = 14, 1, -1
         e = identity(size(a, 1)) + matmul(small, e)/k
      end do
      e = exp(scale(1.0_wp, -squarings)*shift)*e
      do k = 1, squarings
         e = matmul(e, e)
      end do
   end function exponential

end module beamid_cluster_motion
