!> Band matrices against dense ones, with numbers from a seeded generator.
program test_bands
   use beamid_bands, only: band_t, new_band
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use checks, only: check, check_close, finish
   use dense_matrices, only: dense_of, half_bandwidth
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp)
   !> Orders and half-bandwidths: a lone number, a diagonal, a band wider than the matrix (the
   !> cubic space on one element is such), and the usual.
   integer, parameter :: shapes(2, 8) = &
      reshape([1, 0, 6, 0, 2, 3, 5, 1, 7, 6, 12, 3, 40, 5, 200, 7], [2, 8])
   integer, allocatable :: seed(:)
   integer :: k

   call random_seed(size=k)
   allocate (seed(k), source=[(20241 + 37*k, k=1, k)])
   call random_seed(put=seed)
   do k = 1, size(shapes, 2)
      call test_products(shapes(1, k), shapes(2, k))
      call test_rank_one(shapes(1, k), shapes(2, k))
      call test_factor(shapes(1, k), shapes(2, k))
   end do
   call test_half_bandwidth()
   call test_indefinite()
   call finish('bands')

contains

   function of(n, kd) result(text)
      integer, intent(in) :: n, kd
      character(len=:), allocatable :: text

      text = 'n = '//to_text(n)//', kd = '//to_text(kd)//': '
   end function of

   !> A band matrix with entries in (-1, 1) and the same matrix dense; each entry is added in two
   !> parts, from above the diagonal and from below.
   subroutine random_band(n, kd, band, dense)
      integer, intent(in) :: n, kd
      type(band_t), intent(out) :: band
      real(wp), intent(out) :: dense(n, n)
      real(wp) :: value(2)
      integer :: i, j

      band = new_band(n, kd)
      dense = 0
      do j = 1, n
         do i = j, min(n, j + kd)
            call random_number(value)
            value = 2*value - 1
            call band%add(i, j, value(1))
            call band%add(j, i, value(2))
            dense(i, j) = value(1) + value(2)
            dense(j, i) = dense(i, j)
         end do
      end do
   end subroutine random_band

   !> add, element, times, add_product.
   subroutine test_products(n, kd)
      integer, intent(in) :: n, kd
      type(band_t) :: band
      real(wp) :: dense(n, n), x(n), y(n), z(n)

      call random_band(n, kd, band, dense)
      ! The same two numbers are added on both sides: no difference at all.
      call check_close(of(n, kd)//'add, element', maxval(abs(dense_of(band) - dense)), 0.0_wp, &
         0.0_wp)
      call random_number(x)
      call random_number(y)
      ! Sums of 2 kd + 1 terms below 2 in two orders.
      call check_close(of(n, kd)//'times', maxval(abs(band%times(x) - matmul(dense, x))), 0.0_wp, &
         4*(2*kd + 1)*eps)
      z = y
      call band%add_product(-2.5_wp, x, z)
      call check_close(of(n, kd)//'add_product', maxval(abs(z - (y - 2.5_wp*matmul(dense, x)))), &
         0.0_wp, 10*(2*kd + 1)*eps)
      call check(of(n, kd)//'times is not zero', maxval(abs(band%times(x))) > 1e-3_wp)
   end subroutine test_products

   !> A + alpha x x' with x nonzero in kd + 1 consecutive places, at the end as for the hose.
   subroutine test_rank_one(n, kd)
      integer, intent(in) :: n, kd
      type(band_t) :: band
      real(wp) :: dense(n, n), x(n)
      integer :: start

      do start = 1, max(1, n - kd), max(1, n - kd - 1)
         call random_band(n, kd, band, dense)
         x = 0
         call random_number(x(start:min(n, start + kd)))
         call band%add_rank_one(-3.0_wp, x)
         dense = dense - 3*spread(x, 2, n)*spread(x, 1, n)
         ! One product and one sum for each entry below 5.
         call check_close(of(n, kd)//'add_rank_one from '//to_text(start), &
            maxval(abs(dense_of(band) - dense)), 0.0_wp, 5*eps)
      end do
   end subroutine test_rank_one

   !> Cholesky: |A x - b| <= c n eps |A| |x| is all that one can ask for.
   subroutine test_factor(n, kd)
      integer, intent(in) :: n, kd
      type(band_t) :: band, factor
      real(wp) :: dense(n, n), x(n), b(n)
      logical :: positive
      integer :: i

      call random_band(n, kd, band, dense)
      do i = 1, n
         ! Dominant diagonal: positive definite.
         call band%add(i, i, 2*(2*kd + 1.0_wp) + 3)
         dense(i, i) = dense(i, i) + 2*(2*kd + 1.0_wp) + 3
      end do
      call random_number(b)
      factor = band
      call factor%factor(positive)
      x = b
      if (positive) call factor%solve(x)
      call check(of(n, kd)//'factor accepts a positive definite matrix', positive)
      call check_close(of(n, kd)//'residual of solve', maxval(abs(matmul(dense, x) - b)), 0.0_wp, &
         4*(kd + 1)*eps*maxval(sum(abs(dense), dim=1))*maxval(abs(x)))
      ! The same with the sign changed, and with one negative eigenvalue: refused.
      factor = band
      factor%a = -factor%a
      call factor%factor(positive)
      call check(of(n, kd)//'factor refuses a negative definite matrix', .not. positive)
      factor = band
      call factor%add(n, n, -2*dense(n, n))
      call factor%factor(positive)
      call check(of(n, kd)//'factor refuses one negative diagonal entry', .not. positive)
   end subroutine test_factor

   !> What the entries occupy, not what is stored.
   subroutine test_half_bandwidth()
      type(band_t) :: band
      integer :: kd

      band = new_band(9, 5)
      call check('half-bandwidth of zero', half_bandwidth(band) == 0)
      do kd = 0, 5
         call band%add(9 - kd, 9, 1.0_wp)
         call check('half-bandwidth '//to_text(kd), half_bandwidth(band) == kd)
      end do
      call check('outside the band is zero', abs(band%element(1, 9)) <= 0)
   end subroutine test_half_bandwidth

   !> Indefinite with a positive diagonal; singular.
   subroutine test_indefinite()
      type(band_t) :: band
      logical :: positive

      band = new_band(2, 1)
      call band%add(1, 1, 1.0_wp)
      call band%add(2, 2, 1.0_wp)
      call band%add(2, 1, 2.0_wp)
      call band%factor(positive)
      call check('factor refuses [1 2; 2 1]', .not. positive)
      band = new_band(3, 1)
      call band%factor(positive)
      call check('factor refuses zero', .not. positive)
   end subroutine test_indefinite

end program test_bands
