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
      !> (states, 2) contributions of f and of its slope
      complex(wp), allocatable :: drive(:, :)
      !> (states + 2, states + 2, 0:states + 1) at the origin, powers of the matrix B with its
      !> forces, divided by factorials, for e**(B step)
      complex(wp), allocatable, private :: powers(:, :, :)
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
         if (cluster%is_origin) then
            if (.not. allocated(self%powers)) self%powers = nilpotent_powers(driven(cluster, n))
            a = polynomial(self%powers, step)
            self%growth = a(:n, :n)
            self%drive = a(:n, n + 1:)
         else
            a = driven(cluster, n)
            self%growth = exponential(step*a(:n, :n), cluster%centre%s*step)
            ! Here for x/step, f and slope*step.
            a(:n, :n) = step*(a(:n, :n) + cluster%centre%s*identity(n))
            a = exponential(a, (0.0_wp, 0.0_wp))
            self%drive = step*a(:n, n + 1:)
            self%drive(:, 2) = step*self%drive(:, 2)
         end if
      end if
      self%x = matmul(self%growth, self%x) + self%drive(:, 1)*force + self%drive(:, 2)*slope
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

   !> Returns the matrix of the linear system of the states, f and df/dt, (n + 2, n + 2): B - c I,
   !> and at n + 1 and n + 2 the columns of the forces.
   !>
   !> n  number of states, m or 2 m
   pure function driven(cluster, n) result(a)
      type(cluster_t), intent(in) :: cluster
      integer, intent(in) :: n
      complex(wp) :: a(n + 2, n + 2)

      a = 0
      a(:n, :n) = generator(cluster, n)
      a(cluster%m, n + 1) = 1
      a(n + 1, n + 2) = 1
   end function driven

   !> Returns a**k/k! for k = 0 to n - 1, (n, n, 0:n - 1); a**n is 0.
   pure function nilpotent_powers(a) result(powers)
      complex(wp), intent(in) :: a(:, :)
      complex(wp) :: powers(size(a, 1), size(a, 1), 0:size(a, 1) - 1)
      integer :: k

      powers(:, :, 0) = identity(size(a, 1))
      do k = 1, size(a, 1) - 1
         powers(:, :, k) = matmul(a, powers(:, :, k - 1))/k
      end do
   end function nilpotent_powers

   !> Returns the sum of powers(:, :, k) x**k by Horner's rule.
   pure function polynomial(powers, x) result(value)
      complex(wp), intent(in) :: powers(:, :, 0:)
      real(wp), intent(in) :: x
      complex(wp) :: value(size(powers, 1), size(powers, 2))
      integer :: k

      value = powers(:, :, ubound(powers, 3))
      do k = ubound(powers, 3) - 1, 0, -1
         value = x*value + powers(:, :, k)
      end do
   end function polynomial

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
