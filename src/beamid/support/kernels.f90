!> The inner loops of long records: decaying exponentials at the sample times, and products of
!> columns. They know nothing of beams or cases.
!>
!> The rows of a record are taken in blocks that stay in the first cache of a processor, so that a
!> pass over a record of any length reads each sample once and allocates nothing of its length. All
!> loops have constant bounds, so that compilers use vector instructions.
module beamid_kernels
   use beamid_exact_products, only: multiply_exactly
   use beamid_kinds, only: wp
   implicit none
   private

   public :: decay_t, new_decay, exponential, add_products, combine_columns, lagged_products, &
      products_with, subtract_columns

   !> Number of rows of a block.
   integer, parameter, public :: block_rows = 128
   !> Number of samples for which one exponential is computed.
   integer, parameter :: chunk = 32
   !> Degrees of Taylor polynomials, and the largest arguments for which the first neglected term,
   !> relative to e**x, is below 2**-54.
   integer :: i
   integer, parameter :: highest = 14
   real(wp), parameter :: limits(highest) = [((0.5_wp**54*gamma(i + 2.0_wp))**(1/(i + 1.0_wp)), &
      i=1, highest)]

   !> The motion e**(s t) at times that lie near a uniform grid.
   !>
   !> One exponential is computed for the middle of each chunk of samples. The times of a chunk
   !> differ from a uniform grid around this middle by small deviations d, so that e**(s t) is the
   !> product of this exponential, a tabulated one of the grid, and e**(s d), a Taylor polynomial.
   !> Where deviations are large, every sample has its own exponential.
   type :: decay_t
      complex(wp) :: s = 0                           !< [1/time]
      real(wp), private :: step = 0                  !< of the grid [time]
      real(wp), private :: re(chunk) = 1, im(chunk) = 0     !< e**(s t) on the grid
      !> real and imaginary parts of s**k/k!
      real(wp), private :: a(0:highest) = 0, b(0:highest) = 0
   contains
      procedure :: fill
   end type decay_t

contains

   !> Returns the motion e**(s t).
   !>
   !> s     [1/time]
   !> step  mean step of the times; 0 if there is none [time]
   pure function new_decay(s, step) result(self)
      complex(wp), intent(in) :: s
      real(wp), intent(in) :: step
      type(decay_t) :: self
      complex(wp) :: power
      integer :: j, k

      self%s = s
      self%step = step
      do j = 1, chunk
         power = exp(s*(step*place(j)))
         self%re(j) = real(power)
         self%im(j) = aimag(power)
      end do
      power = 1
      do k = 0, ubound(self%a, 1)
         if (k > 0) power = power*s/k
         self%a(k) = real(power)
         self%b(k) = aimag(power)
      end do
   end function new_decay

   !> Returns the place of sample j of a chunk, in steps from its middle.
   elemental real(wp) function place(j)
      integer, intent(in) :: j

      place = j - (chunk + 1)/2.0_wp
   end function place

   !> Returns e**(s t). The round-off of the phase, which grows with t, is computed as well and
   !> taken into account.
   elemental complex(wp) function exponential(s, t)
      complex(wp), intent(in) :: s
      real(wp), intent(in) :: t
      real(wp) :: phase, error

      call multiply_exactly(aimag(s), t, phase, error)
      exponential = exp(cmplx(real(s)*t, phase, wp))
      exponential = exponential + exponential*cmplx(0.0_wp, error, wp)
   end function exponential

   !> Computes the motion for a block.
   !>
   !> t       (block_rows) ascending [time]
   !> re, im  (block_rows) real and imaginary parts of e**(s t)
   pure subroutine fill(self, t, re, im)
      class(decay_t), intent(in) :: self
      real(wp), intent(in) :: t(block_rows)
      real(wp), intent(out) :: re(block_rows), im(block_rows)
      complex(wp) :: e
      real(wp) :: d(chunk), middle, largest, u, v
      integer :: first, j

      do first = 1, block_rows, chunk
         middle = (t(first) + t(first + chunk - 1))/2
         largest = 0
         !$omp simd reduction(max:largest)
         do j = 1, chunk
            d(j) = (t(first + j - 1) - middle) - self%step*place(j)
            largest = max(largest, abs(d(j)))
         end do
         largest = largest*abs(self%s)
         if (.not. largest <= limits(highest)) then
            do j = first, first + chunk - 1
               e = exponential(self%s, t(j))
               re(j) = real(e)
               im(j) = aimag(e)
            end do
            cycle
         end if
         e = exponential(self%s, middle)
         !$omp simd private(u, v)
         do j = 1, chunk
            u = self%re(j)*real(e) - self%im(j)*aimag(e)
            v = self%re(j)*aimag(e) + self%im(j)*real(e)
            re(first + j - 1) = u
            im(first + j - 1) = v
         end do
         call multiply(self, count(largest > limits) + 1, d, re(first), im(first))
      end do
   end subroutine fill

   !> Multiplies the motion of a chunk by e**(s d), a Taylor polynomial.
   pure subroutine multiply(self, degree, d, re, im)
      type(decay_t), intent(in) :: self
      integer, intent(in) :: degree
      real(wp), intent(in) :: d(chunk)
      real(wp), intent(inout) :: re(chunk), im(chunk)
      real(wp), dimension(chunk) :: p, q
      real(wp) :: u
      integer :: j, k

      p = self%a(degree)
      q = self%b(degree)
      do k = degree - 1, 0, -1
         !$omp simd
         do j = 1, chunk
            p(j) = self%a(k) + d(j)*p(j)
            q(j) = self%b(k) + d(j)*q(j)
         end do
      end do
      !$omp simd private(u)
      do j = 1, chunk
         u = re(j)
         re(j) = u*p(j) - im(j)*q(j)
         im(j) = u*q(j) + im(j)*p(j)
      end do
   end subroutine multiply

   !> Adds the products of the columns of a block to a sum.
   !>
   !> x        (block_rows, k) k even
   !> product  (k, k) the upper triangle of x'x is added
   pure subroutine add_products(x, k, product)
      integer, intent(in) :: k
      real(wp), intent(in) :: x(block_rows, k)
      real(wp), intent(inout) :: product(k, k)
      real(wp) :: a, b, c, d
      integer :: i, j, l

      do l = 1, k - 1, 2
         do j = 1, l, 2
            a = 0
            b = 0
            c = 0
            d = 0
            !$omp simd reduction(+:a, b, c, d)
            do i = 1, block_rows
               a = a + x(i, j)*x(i, l)
               b = b + x(i, j + 1)*x(i, l)
               c = c + x(i, j)*x(i, l + 1)
               d = d + x(i, j + 1)*x(i, l + 1)
            end do
            product(j, l) = product(j, l) + a
            product(j + 1, l) = product(j + 1, l) + b
            product(j, l + 1) = product(j, l + 1) + c
            product(j + 1, l + 1) = product(j + 1, l + 1) + d
         end do
      end do
   end subroutine add_products

   !> Subtracts a combination of columns from a vector, and adds the products of the columns with
   !> what is left, and its sum of squares.
   !>
   !> x        (block_rows, k)
   !> c        (k) coefficients
   !> r        (block_rows) on return r - x c
   !> product  (k) on return plus x'r, with the r that is left
   !> total    on return plus r'r
   pure subroutine subtract_columns(x, k, c, r, product, total)
      integer, intent(in) :: k
      real(wp), intent(in) :: x(block_rows, k), c(k)
      real(wp), intent(inout) :: r(block_rows), product(k), total
      real(wp) :: a
      integer :: i, j

      do j = 1, k
         !$omp simd
         do i = 1, block_rows
            r(i) = r(i) - c(j)*x(i, j)
         end do
      end do
      do j = 1, k
         a = 0
         !$omp simd reduction(+:a)
         do i = 1, block_rows
            a = a + x(i, j)*r(i)
         end do
         product(j) = product(j) + a
      end do
      a = 0
      !$omp simd reduction(+:a)
      do i = 1, block_rows
         a = a + r(i)**2
      end do
      total = total + a
   end subroutine subtract_columns

   !> Adds combinations of columns to other columns.
   !>
   !> x        (block_rows, k)
   !> weights  (k, n)
   !> y        (block_rows, n) on return plus x weights
   pure subroutine combine_columns(x, k, weights, n, y)
      integer, intent(in) :: k, n
      real(wp), intent(in) :: x(block_rows, k), weights(k, n)
      real(wp), intent(inout) :: y(block_rows, n)
      integer :: i, j, l

      do l = 1, n
         do j = 1, k
            if (.not. abs(weights(j, l)) > 0) cycle
            !$omp simd
            do i = 1, block_rows
               y(i, l) = y(i, l) + weights(j, l)*x(i, j)
            end do
         end do
      end do
   end subroutine combine_columns

   !> Returns the products of the columns of a matrix with a vector.
   !>
   !> x  (m, k)
   !> y  (m)
   pure function products_with(x, y) result(products)
      real(wp), intent(in), contiguous :: x(:, :), y(:)
      real(wp) :: products(size(x, 2)), a
      integer :: first, i, j, m

      m = size(y)
      products = 0
      do first = 1, m, 4*block_rows
         do j = 1, size(x, 2)
            a = 0
            !$omp simd reduction(+:a)
            do i = first, min(first + 4*block_rows - 1, m)
               a = a + x(i, j)*y(i)
            end do
            products(j) = products(j) + a
         end do
      end do
   end function products_with

   !> Returns the sums of x(i) x(i + k) over i, for k = 1, ..., lags.
   !>
   !> x  (m)
   pure function lagged_products(x, lags) result(products)
      real(wp), intent(in), contiguous :: x(:)
      integer, intent(in) :: lags
      real(wp) :: products(lags), a
      integer :: first, i, k, m

      m = size(x)
      products = 0
      do first = 1, m, 4*block_rows
         do k = 1, lags
            a = 0
            !$omp simd reduction(+:a)
            do i = first, min(first + 4*block_rows - 1, m - k)
               a = a + x(i)*x(i + k)
            end do
            products(k) = products(k) + a
         end do
      end do
   end function lagged_products

end module beamid_kernels
