!> Band matrices written out.
module dense_matrices
   use beamid_bands, only: band_t
   use beamid_kinds, only: wp
   implicit none
   private

   public :: dense_of

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

end module dense_matrices
