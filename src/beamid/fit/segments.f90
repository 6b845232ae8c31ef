!> A least-squares problem whose rows are divided into segments of consecutive rows. The products of
!> residuals and derivatives of each segment are enough for a Gauss-Newton step, for the residuals
!> after it, and for tests whether all segments agree.
module beamid_segments
   use beamid_kernels, only: add_products, block_rows
   use beamid_kinds, only: wp
   use beamid_lapack, only: dpotrf, dtrtrs
   implicit none
   private

   public :: segments_t, step_t, new_segments, squares_of_segments

   !> Residuals r and derivatives J of segments of rows.
   type :: segments_t
      !> (p + 1, p + 1, segments) [J r]'[J r] of each segment
      real(wp), allocatable :: products(:, :, :)
      integer, allocatable :: rows(:)               !< (segments)
      !> (p + 1, p + 1) [J r]'[J r] of further rows, such as those of priors
      real(wp), allocatable :: further(:, :)
   contains
      procedure :: add_row
      procedure :: step
      procedure :: sums_of_squares
      procedure :: robust_variance
   end type segments_t

   !> A Gauss-Newton step: the minimum of a linear least-squares problem.
   type :: step_t
      real(wp), allocatable :: change(:)       !< (p)
      real(wp), allocatable :: inverse(:, :)   !< (p, p) (J'J)**-1; 0 for what is held
      real(wp) :: decrease = 0                 !< of the sum of squares
      logical :: is_regular = .false.          !< .false.: J'J is singular, and nothing is computed
   end type step_t

contains

   !> Divides rows into segments of nearly equal length.
   !>
   !> jac      (m, p) derivatives
   !> r        (m) residuals
   !> n        number of the first rows that are divided; the rows after them are `further`
   !> count    number of segments, at most n
   function new_segments(jac, r, n, count) result(self)
      real(wp), intent(in) :: jac(:, :), r(:)
      integer, intent(in) :: n, count
      type(segments_t) :: self
      real(wp), allocatable :: x(:, :), product(:, :)
      integer :: b, columns, first, last, p

      p = size(jac, 2)
      ! The kernel takes an even number of columns.
      columns = 2*((p + 2)/2)
      allocate (x(block_rows, columns), source=0.0_wp)
      allocate (product(columns, columns))
      allocate (self%products(p + 1, p + 1, count), self%rows(count))
      allocate (self%further(p + 1, p + 1), source=0.0_wp)
      last = 0
      do b = 1, count
         first = last + 1
         last = last_row(b, n, count)
         self%rows(b) = last - first + 1
         call multiply(first, last)
         self%products(:, :, b) = product(:p + 1, :p + 1)
      end do
      if (size(r) > n) then
         call multiply(n + 1, size(r))
         self%further = product(:p + 1, :p + 1)
      end if

   contains

      !> Computes [J r]'[J r] of the rows from..to.
      subroutine multiply(from, to)
         integer, intent(in) :: from, to
         integer :: i, k, rows

         product = 0
         do i = from, to, block_rows
            rows = min(block_rows, to - i + 1)
            do k = 1, p
               x(:rows, k) = jac(i:i + rows - 1, k)
            end do
            x(:rows, p + 1) = r(i:i + rows - 1)
            x(rows + 1:, :) = 0
            call add_products(x, columns, product)
         end do
         do k = 2, p + 1
            product(k, :k - 1) = product(:k - 1, k)
         end do
      end subroutine multiply

   end function new_segments

   !> Returns the last row of segment b of `count` segments of n rows.
   elemental integer function last_row(b, n, count)
      integer, intent(in) :: b, n, count

      last_row = nint(real(b, wp)*n/count)
   end function last_row

   !> Returns the sum of squares in each segment.
   !>
   !> r      (n) values, one for each row
   !> count  number of segments
   pure function squares_of_segments(r, count) result(squares)
      real(wp), intent(in) :: r(:)
      integer, intent(in) :: count
      real(wp) :: squares(count)
      integer :: b

      squares = [(sum(r(last_row(b - 1, size(r), count) + 1:last_row(b, size(r), count))**2), &
         b=1, count)]
   end function squares_of_segments

   !> Adds a further row that depends on one unknown.
   !>
   !> k         number of the unknown
   !> slope, r  derivative and residual of the row
   pure subroutine add_row(self, k, slope, r)
      class(segments_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: slope, r
      integer :: n

      n = size(self%further, 1)
      self%further(k, k) = self%further(k, k) + slope**2
      self%further(k, n) = self%further(k, n) + slope*r
      self%further(n, k) = self%further(k, n)
      self%further(n, n) = self%further(n, n) + r**2
   end subroutine add_row

   !> Returns the step to the minimum of some segments and the further rows.
   !>
   !> first, last  numbers of the segments
   !> held         (p) unknowns that do not change
   function step(self, first, last, held) result(found)
      class(segments_t), intent(in) :: self
      integer, intent(in) :: first, last
      logical, intent(in) :: held(:)
      type(step_t) :: found
      real(wp) :: total(size(held) + 1, size(held) + 1)
      real(wp), allocatable :: a(:, :), inverse(:, :), length(:)
      integer, allocatable :: free(:)
      integer :: info, j, n, p

      p = size(held)
      total = sum(self%products(:, :, first:last), dim=3) + self%further
      free = pack([(j, j=1, p)], .not. held)
      n = size(free)
      allocate (found%change(p), found%inverse(p, p), source=0.0_wp)
      length = [(sqrt(total(free(j), free(j))), j=1, n)]
      if (.not. all(length > 0 .and. length < huge(length))) return
      a = total(free, free)
      do j = 1, n
         a(:, j) = a(:, j)/(length*length(j))
      end do
      call dpotrf('U', n, a, max(1, n), info)
      if (info /= 0) return
      allocate (inverse(n, n), source=0.0_wp)
      do j = 1, n
         inverse(j, j) = 1/length(j)
      end do
      call dtrtrs('U', 'T', 'N', n, n, a, max(1, n), inverse, max(1, n), info)
      if (info /= 0) return
      found%inverse(free, free) = matmul(transpose(inverse), inverse)
      found%change = -matmul(found%inverse, total(:p, p + 1))
      found%decrease = -dot_product(found%change, total(:p, p + 1))
      found%is_regular = .true.
   end function step

   !> Returns the sum of squared residuals of each segment (segments) after a step.
   !>
   !> change  (p)
   pure function sums_of_squares(self, change) result(total)
      class(segments_t), intent(in) :: self
      real(wp), intent(in) :: change(:)
      real(wp) :: total(size(self%rows)), x(size(change) + 1)
      integer :: b

      x = [change, 1.0_wp]
      total = [(max(0.0_wp, dot_product(x, matmul(self%products(:, :, b), x))), &
         b=1, size(total))]
   end function sums_of_squares

   !> Returns the variance of an unknown after a step, from the scatter of the segments and the
   !> noise of the further rows. It allows
   !> for residuals that depend on one another within a segment (a cluster-robust variance: Liang
   !> and Zeger, Biometrika 73, 1986, 13).
   !>
   !> k     number of the unknown
   !> step  from all segments
   !> noise  variance of a further row
   pure real(wp) function robust_variance(self, k, step, noise) result(variance)
      class(segments_t), intent(in) :: self
      integer, intent(in) :: k
      type(step_t), intent(in) :: step
      real(wp), intent(in) :: noise
      real(wp) :: x(size(step%change) + 1)
      integer :: b, n, p

      p = size(step%change)
      n = size(self%rows)
      x = [step%change, 1.0_wp]
      variance = sum([(dot_product(step%inverse(k, :), matmul(self%products(:p, :, b), x))**2, &
         b=1, n)])*n/max(1, n - 1) + noise*dot_product(step%inverse(k, :), &
         matmul(self%further(:p, :p), step%inverse(:, k)))
   end function robust_variance

end module beamid_segments
