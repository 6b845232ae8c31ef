!> The rows of a free decay, block by block: the basis of its linear unknowns and the record.
!>
!> All residuals of the decay and all their derivatives are combinations of these columns. The time
!> is counted from the middle of each motion, weighted by its energy, so that the columns e**(s t)
!> and t e**(s t) are far from parallel.
module beamid_decay_rows
   use beamid_condensation, only: condense, condensed_t, rows_of_part, rows_t
   use beamid_interrupts, only: stop_flag
   use beamid_kernels, only: block_rows, combine_columns, decay_t, new_decay
   use beamid_kinds, only: wp
   implicit none
   private

   public :: decay_rows_t, new_decay_rows

   !> Columns of each mode, then the one of the offset if there is one.
   type, extends(rows_t) :: decay_rows_t
      type(decay_t), allocatable :: motions(:)   !< (modes)
      real(wp), allocatable :: middle(:)         !< (modes) weighted mean time [time]
      real(wp) :: begin = 0                      !< time at which the motions are 1 [time]
      real(wp) :: scale = 0                      !< of the offset; 0: no offset
      !> (m) sample times [time] and measured values
      real(wp), pointer, contiguous :: times(:) => null(), measured(:) => null()
   contains
      procedure :: fill
      procedure :: condensed
      procedure :: expand
   end type decay_rows_t

contains

   !> Returns the rows of a free decay.
   !>
   !> s         (modes) roots [1/time]
   !> begin     time at which the motions are 1 [time]
   !> scale     of the offset; 0: no offset
   !> times     (m) ascending [time]
   !> measured  (m)
   function new_decay_rows(s, begin, scale, times, measured) result(self)
      complex(wp), intent(in) :: s(:)
      real(wp), intent(in) :: begin, scale
      real(wp), intent(in), target, contiguous :: times(:), measured(:)
      type(decay_rows_t) :: self
      real(wp) :: duration
      integer :: k, m

      m = size(times)
      self%rows = m
      self%columns = 4*size(s) + merge(1, 0, abs(scale) > 0)
      self%begin = begin
      self%scale = scale
      self%times => times
      self%measured => measured
      duration = times(m) - times(1)
      allocate (self%motions(size(s)), self%middle(size(s)))
      do k = 1, size(s)
         self%motions(k) = new_decay(s(k), duration/max(1, m - 1))
         self%middle(k) = times(1) - begin + duration*mean_place(-2*real(s(k))*duration)
      end do
   end function new_decay_rows

   !> Returns the mean of x between 0 and 1, weighted by e**(-a x).
   elemental real(wp) function mean_place(a)
      real(wp), intent(in) :: a

      if (abs(a) < 1e-3_wp) then
         mean_place = 0.5_wp - a/12
      else if (a > 0) then
         mean_place = 1/a - exp(-a)/(1 - exp(-a))
      else
         mean_place = 1/a + 1/(1 - exp(a))
      end if
   end function mean_place

   !> Computes a block of rows; for each mode the real and the imaginary part of e**(s t), then both
   !> times the time from the middle. Arguments as of `rows_t`.
   subroutine fill(self, first, x)
      class(decay_rows_t), intent(in) :: self
      integer, intent(in) :: first
      real(wp), intent(inout), contiguous :: x(:, :)
      real(wp) :: t(block_rows)
      integer :: b, k, n

      n = min(block_rows, self%rows - first + 1)
      t(:n) = self%times(first:first + n - 1) - self%begin
      t(n + 1:) = t(n)
      do k = 1, size(self%motions)
         b = 4*(k - 1)
         call self%motions(k)%fill(t, x(:, b + 1), x(:, b + 2))
         x(:, b + 3) = (t - self%middle(k))*x(:, b + 1)
         x(:, b + 4) = (t - self%middle(k))*x(:, b + 2)
      end do
      if (abs(self%scale) > 0) x(:, self%columns) = self%scale
      x(:n, self%columns + 1) = -self%measured(first:first + n - 1)
      x(n + 1:, self%columns + 1) = 0
   end subroutine fill

   !> Returns the condensed rows of a basis in the order of `free_mode_t`: for each mode the real
   !> parts of e**(s t) and t e**(s t), then the imaginary parts.
   function condensed(self) result(found)
      class(decay_rows_t), intent(in) :: self
      type(condensed_t) :: found
      real(wp) :: a(self%columns, 4)
      integer :: b, k

      call condense(self, found)
      do k = 1, size(self%motions)
         b = 4*(k - 1)
         a = found%factor(:, b + 1:b + 4)
         found%factor(:, b + 1) = a(:, 1)
         found%factor(:, b + 2) = a(:, 3) + self%middle(k)*a(:, 1)
         found%factor(:, b + 3) = a(:, 2)
         found%factor(:, b + 4) = a(:, 4) + self%middle(k)*a(:, 2)
      end do
   end function condensed

   !> Computes all rows of the residuals and of derivatives.
   !>
   !> weights  (b, 1 + n) of the basis, in the order of `condensed`; the first column is that of the
   !>          residuals, which are the basis times weights minus the record
   !> r        (m) residuals
   !> jac      (m, n) derivatives
   subroutine expand(self, weights, r, jac)
      class(decay_rows_t), intent(in) :: self
      real(wp), intent(in) :: weights(:, :)
      real(wp), intent(inout) :: r(:), jac(:, :)
      real(wp) :: of_columns(self%columns, size(weights, 2))
      integer :: b, k, part, rows_each

      of_columns = weights
      do k = 1, size(self%motions)
         b = 4*(k - 1)
         of_columns(b + 1, :) = weights(b + 1, :) + self%middle(k)*weights(b + 2, :)
         of_columns(b + 2, :) = weights(b + 3, :) + self%middle(k)*weights(b + 4, :)
         of_columns(b + 3, :) = weights(b + 2, :)
      end do
      rows_each = rows_of_part(self%rows, self%columns)
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag) if(self%rows > rows_each)
      do part = 1, self%rows, rows_each
         call expand_part(part, min(part + rows_each - 1, self%rows))
      end do
      !$omp end parallel do

   contains

      !> Computes the rows `begin` to `end`.
      subroutine expand_part(begin, end)
         integer, intent(in) :: begin, end
         real(wp) :: x(block_rows, self%columns + 1), y(block_rows, size(weights, 2))
         integer :: first, k, n

         do first = begin, end, block_rows
            call self%fill(first, x)
            y = 0
            y(:, 1) = x(:, self%columns + 1)
            call combine_columns(x, self%columns, of_columns, size(weights, 2), y)
            n = min(block_rows, self%rows - first + 1)
            r(first:first + n - 1) = y(:n, 1)
            do k = 1, size(jac, 2)
               jac(first:first + n - 1, k) = y(:n, k + 1)
            end do
         end do
      end subroutine expand_part

   end subroutine expand

end module beamid_decay_rows
