!> Band matrices written out.
module dense_matrices
   use beamid_bands, only: band_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: dense_of, half_bandwidth

contains

   function dense_of(band) result(dense)
      type(band_t), intent(in) :: band
      real(wp) :: dense(band%n, band%n)
      integer :: i, j

      do j = 1, band%n
         do i = 1, band%n
            dense(i, j) = band%element(i, j)
         end do
      end do
   end function dense_of

   !> The half-bandwidth that the entries occupy: the largest |i - j| with A(i, j) /= 0.
   pure integer function half_bandwidth(band)
      type(band_t), intent(in) :: band

      do half_bandwidth = band%kd, 1, -1
         if (any(abs(band%a(1 + half_bandwidth, :band%n - half_bandwidth)) > 0)) return
      end do
   end function half_bandwidth

end module dense_matrices
