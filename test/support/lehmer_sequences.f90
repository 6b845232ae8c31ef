!> Numbers that any language makes alike: Lehmer's x <- 16807 x mod (2**31 - 1), exact in double
!> precision, and what is built on it. References of tests come from other programs fed with the
!> same. In Python:
!>
!>    def uniform(n, seed):
!>        u = []
!>        for k in range(n):
!>            seed = 16807*seed % 2147483647
!>            u.append(seed/2147483647)
!>        return np.array(u)
!>    def gauss(n, seed):
!>        u = uniform(2*n, seed)
!>        return np.sqrt(-2*np.log(u[::2]))*np.cos(2*np.pi*u[1::2])
!>    def ar(n, phi, seed):
!>        x = gauss(n, seed)
!>        for k in range(1, n): x[k] += phi*x[k-1]
!>        return x
module lehmer_sequences
   use beamid_kinds, only: wp
   implicit none
   private

   public :: uniform, gauss, ar

contains

   !> In (0, 1).
   pure function uniform(n, seed) result(u)
      integer, intent(in) :: n, seed
      real(wp) :: u(n), x
      real(wp), parameter :: m = 2147483647.0_wp
      integer :: k

      x = seed
      do k = 1, n
         x = modulo(16807*x, m)
         u(k) = x/m
      end do
   end function uniform

   !> Of mean 0 and standard deviation 1.
   pure function gauss(n, seed) result(x)
      integer, intent(in) :: n, seed
      real(wp) :: x(n), u(2*n)
      real(wp), parameter :: pi = acos(-1.0_wp)

      u = uniform(2*n, seed)
      x = sqrt(-2*log(u(1::2)))*cos(2*pi*u(2::2))
   end function gauss

   !> x_k = phi x_(k-1) + e_k, e of standard deviation 1.
   pure function ar(n, phi, seed) result(x)
      integer, intent(in) :: n, seed
      real(wp), intent(in) :: phi
      real(wp) :: x(n)
      integer :: k

      x = gauss(n, seed)
      do k = 2, n
         x(k) = x(k) + phi*x(k - 1)
      end do
   end function ar

end module lehmer_sequences
