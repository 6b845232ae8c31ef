!> Sums of phasors, sum over j of c_j exp(-2 pi i f t_j), at many equidistant frequencies f and any
!> times t_j: a fast Fourier transform of values that are spread on an even grid.
!>
!> Source: L. Greengard and J.-Y. Lee, "Accelerating the nonuniform fast Fourier transform", SIAM
!> Review 46 (2004), 443-454, equations (10) to (13).
module beamid_fourier
   use beamid_kinds, only: pi, wp
   implicit none
   private

   public :: phasor_sums, fast_fourier_transform

contains

   !> Returns the sums of phasors, with an error of at most 3e-11 of the sum of |c|.
   !>
   !> t      (m) times [time]; step*(maxval(t) - minval(t)) is below 1
   !> c      (m) factors, in any unit
   !> first  lowest frequency [1/time]
   !> step   of the frequencies [1/time]
   !> n      number of frequencies
   !> sums   (n)
   pure function phasor_sums(t, c, first, step, n) result(sums)
      real(wp), intent(in) :: t(:), c(:), first, step
      integer, intent(in) :: n
      complex(wp) :: sums(n)
      integer, parameter :: reach = 12     ! points of the grid on either side of a time
      complex(wp), allocatable :: grid(:)
      complex(wp) :: value
      real(wp) :: width, spacing, x, share(-reach:reach), growth
      integer :: half, j, k, length, m, nearest

      ! The grid is twice as fine as the frequencies require. These are shifted so that the middle
      ! one is 0.
      length = 128
      do while (length < 2*n)
         length = 2*length
      end do
      half = length/4
      spacing = 2*pi/length
      width = pi*reach/(12*real(half, wp)**2)
      allocate (grid(0:length - 1), source=(0.0_wp, 0.0_wp))
      share = [(exp(-(k*spacing)**2/(4*width)), k=-reach, reach)]
      do j = 1, size(t)
         value = c(j)*exp(cmplx(0.0_wp, -2*pi*(first + half*step)*(t(j) - t(1)), wp))
         x = 2*pi*step*(t(j) - t(1))
         nearest = nint(x/spacing)
         x = x - nearest*spacing
         ! Share of the point k: exp(-(x - k spacing)**2/(4 width)).
         value = value*exp(-x**2/(4*width) - reach*x*spacing/(2*width))
         growth = exp(x*spacing/(2*width))
         do k = -reach, reach
            m = modulo(nearest + k, length)
            grid(m) = grid(m) + value*share(k)
            value = value*growth
         end do
      end do
      call fast_fourier_transform(grid)
      do k = 0, n - 1
         m = k - half
         sums(k + 1) = sqrt(pi/width)*exp(real(m, wp)**2*width)/length*grid(modulo(m, length))
      end do
   end function phasor_sums

   !> Replaces values by their discrete Fourier transform, sum over j of z_j exp(-2 pi i j k/n).
   !>
   !> z  (n) with n a power of 2
   pure subroutine fast_fourier_transform(z)
      complex(wp), intent(inout) :: z(0:)
      complex(wp) :: root(0:size(z)/2), moved
      integer :: bit, first, j, k, n, half

      n = size(z)
      root = [(exp(cmplx(0.0_wp, -2*pi*j/n, wp)), j=0, n/2)]
      ! Each value moves to the place whose binary digits are its own in reverse.
      j = 0
      do k = 0, n - 2
         if (k < j) then
            moved = z(k)
            z(k) = z(j)
            z(j) = moved
         end if
         bit = n/2
         do while (bit <= j)
            j = j - bit
            bit = bit/2
         end do
         j = j + bit
      end do
      half = 1
      do while (half < n)
         do first = 0, n - 1, 2*half
            do k = 0, half - 1
               moved = z(first + half + k)*root(k*(n/(2*half)))
               z(first + half + k) = z(first + k) - moved
               z(first + k) = z(first + k) + moved
            end do
         end do
         half = 2*half
      end do
   end subroutine fast_fourier_transform

end module beamid_fourier
