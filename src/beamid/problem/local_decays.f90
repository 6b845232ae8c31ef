!> The rows of a free decay, condensed once for all roots near given ones.
!>
!> Draws from a posterior and fits of resampled records stay near an estimate. There e**(s t) is
!> e**(s0 t) times a polynomial of low degree in the time: with the time x from -1 to 1,
!>
!>     e**(a x) = I_0(a) T_0(x) + 2 I_1(a) T_1(x) + 2 I_2(a) T_2(x) + ...,
!>
!> where T_k are Chebyshev's polynomials, I_k the modified Bessel functions (Abramowitz and Stegun,
!> 9.6.34), and a is s - s0 times half the time in which the mode can be seen; a factor moves the
!> middle of this time to 0. The columns e**(s0 t) T_k are
!> decomposed once, so that each further evaluation works on as many rows as there are columns. They
!> do not depend on the measured values, and may be whitened like these.
module beamid_local_decays
   use beamid_condensation, only: condensed_t
   use beamid_kernels, only: exponential
   use beamid_kinds, only: wp
   use beamid_lapack, only: dgeqrf, dorgqr
   implicit none
   private

   public :: local_decay_t, new_local_decay

   !> Columns of each mode: real and imaginary part of e**(s0 t) T_0, then of e**(s0 t) T_1, and so
   !> on; after them the one of the offset if there is one.
   type :: local_decay_t
      complex(wp), allocatable :: s(:)     !< (modes) roots s0 [1/time]
      integer, allocatable :: terms(:)     !< (modes) number of polynomials
      !> (modes) middle and half length of the time, counted from `begin`, in which the mode can be
      !> seen [time]
      real(wp), allocatable :: middle(:), half(:)
      real(wp), allocatable :: radius(:)   !< (modes) largest |a|
      real(wp) :: begin = 0                !< time at which the motions are 1 [time]
      real(wp) :: scale = 0                !< of the offset; 0: no offset
      type(condensed_t) :: rows            !< of the columns and of the record
   contains
      procedure :: columns, matrix, decompose, covers, near
   end type local_decay_t

   !> Limits of the number of polynomials.
   integer, parameter :: least_terms = 3, most_terms = 16
   !> First neglected coefficients of the series and of its derivative by a, and the size at which a
   !> motion has decayed.
   real(wp), parameter :: negligible(2) = [1e-16_wp, 1e-14_wp], decayed = 1e-17_wp

contains

   !> Returns the basis for roots near given ones; `decompose` sets its rows.
   !>
   !> s         (modes) roots [1/time]
   !> distance  (modes) greatest expected distance from the roots [1/time]
   !> begin     time at which the motions are 1 [time]
   !> scale     of the offset; 0: no offset
   !> times     (m) ascending [time]
   pure function new_local_decay(s, distance, begin, scale, times) result(self)
      complex(wp), intent(in) :: s(:)
      real(wp), intent(in) :: distance(:), begin, scale, times(:)
      type(local_decay_t) :: self
      real(wp) :: first, last
      integer :: k

      self%s = s
      self%begin = begin
      self%scale = scale
      allocate (self%terms(size(s)), self%middle(size(s)), self%half(size(s)), &
         self%radius(size(s)))
      first = times(1) - begin
      do k = 1, size(s)
         last = times(size(times)) - begin
         if (real(s(k)) < 0) last = min(last, first + log(decayed)/real(s(k)))
         self%middle(k) = (first + last)/2
         self%half(k) = (last - first)/2
         self%terms(k) = least_terms
         do while (radius_of(self%terms(k)) < distance(k)*self%half(k) .and. &
            self%terms(k) < most_terms)
            self%terms(k) = self%terms(k) + 1
         end do
         self%radius(k) = radius_of(self%terms(k))
      end do
   end function new_local_decay

   !> Returns the largest |a| for which the first neglected coefficient, about 2 (a/2)**n/n!, and
   !> its derivative are negligible.
   !>
   !> n  number of terms
   elemental real(wp) function radius_of(n)
      integer, intent(in) :: n

      radius_of = 2*min((negligible(1)*gamma(n + 1.0_wp)/2)**(1.0_wp/n), &
         (negligible(2)*gamma(real(n, wp)))**(1.0_wp/(n - 1)))
   end function radius_of

   !> Returns the number of columns.
   pure integer function columns(self)
      class(local_decay_t), intent(in) :: self

      columns = merge(1, 0, abs(self%scale) > 0)
      if (allocated(self%terms)) columns = columns + 2*sum(self%terms)
   end function columns

   !> Returns the columns (m, columns + 1) at the times, and behind them the negative record.
   !>
   !> times, measured  (m) [time] and [unit of the data]
   pure function matrix(self, times, measured) result(x)
      class(local_decay_t), intent(in) :: self
      real(wp), intent(in) :: times(:), measured(:)
      real(wp) :: x(size(times), self%columns() + 1)
      complex(wp) :: motion
      real(wp) :: place, t, polynomial(0:most_terms)
      integer :: at, i, j, k

      at = 0
      polynomial(0) = 1
      do k = 1, size(self%s)
         do i = 1, size(times)
            t = times(i) - self%begin
            motion = exponential(self%s(k), t)
            place = (t - self%middle(k))/self%half(k)
            polynomial(1) = place
            do j = 2, self%terms(k) - 1
               polynomial(j) = 2*place*polynomial(j - 1) - polynomial(j - 2)
            end do
            do j = 0, self%terms(k) - 1
               x(i, at + 2*j + 1) = polynomial(j)*real(motion)
               x(i, at + 2*j + 2) = polynomial(j)*aimag(motion)
            end do
         end do
         at = at + 2*self%terms(k)
      end do
      if (abs(self%scale) > 0) x(:, at + 1) = self%scale
      x(:, self%columns() + 1) = -measured
   end function matrix

   !> Decomposes the columns.
   !>
   !> x  (m, columns + 1) on entry columns and record, as from `matrix`, whitened if need be; on
   !>    return an orthonormal basis of the columns, and of the record in addition
   subroutine decompose(self, x)
      class(local_decay_t), intent(inout) :: self
      real(wp), intent(inout), contiguous :: x(:, :)
      real(wp) :: tau(size(x, 2)), work(32*size(x, 2))
      integer :: info, j, m, n

      m = size(x, 1)
      n = size(x, 2)
      call dgeqrf(m, n, x, m, tau, work, size(work), info)
      allocate (self%rows%factor(n - 1, n - 1), source=0.0_wp)
      do j = 1, n - 1
         self%rows%factor(:j, j) = x(:j, j)
      end do
      self%rows%y = x(:n - 1, n)
      self%rows%left = abs(x(n, n))
      call dorgqr(m, n, n, x, m, tau, work, size(work), info)
   end subroutine decompose

   !> Returns whether the basis covers roots: they are within its radius, and time and offset are
   !> those of the basis. Arguments as of `new_local_decay`.
   pure logical function covers(self, s, begin, scale)
      class(local_decay_t), intent(in) :: self
      complex(wp), intent(in) :: s(:)
      real(wp), intent(in) :: begin, scale

      covers = self%columns() > 0
      if (covers) covers = size(s) == size(self%s) .and. .not. abs(begin - self%begin) > 0 .and. &
         .not. abs(scale - self%scale) > 0
      if (covers) covers = all(abs(s - self%s)*self%half <= self%radius)
   end function covers

   !> Returns the condensed rows for roots that `covers` accepts. Their columns have the order of
   !> `free_mode_t`: for each mode the real parts of e**(s t) and t e**(s t), then the imaginary
   !> parts; and the offset.
   pure function near(self, s) result(found)
      class(local_decay_t), intent(in) :: self
      complex(wp), intent(in) :: s(:)
      type(condensed_t) :: found
      complex(wp) :: c(most_terms, 2)
      integer :: at, j, k, n

      n = self%columns()
      found%y = self%rows%y
      found%left = self%rows%left
      allocate (found%factor(n, 4*size(s) + n - 2*sum(self%terms)), source=0.0_wp)
      at = 0
      do k = 1, size(s)
         call coefficients(s(k) - self%s(k), self%middle(k), self%half(k), c(:self%terms(k), :))
         do j = 1, self%terms(k)
            associate (a => self%rows%factor(:at + 2*j, at + 2*j - 1), &
               b => self%rows%factor(:at + 2*j, at + 2*j), y => found%factor(:at + 2*j, :))
               y(:, 4*k - 3) = y(:, 4*k - 3) + real(c(j, 1))*a - aimag(c(j, 1))*b
               y(:, 4*k - 2) = y(:, 4*k - 2) + real(c(j, 2))*a - aimag(c(j, 2))*b
               y(:, 4*k - 1) = y(:, 4*k - 1) + aimag(c(j, 1))*a + real(c(j, 1))*b
               y(:, 4*k) = y(:, 4*k) + aimag(c(j, 2))*a + real(c(j, 2))*b
            end associate
         end do
         at = at + 2*self%terms(k)
      end do
      if (abs(self%scale) > 0) found%factor(:, 4*size(s) + 1) = self%rows%factor(:, n)
   end function near

   !> Computes the coefficients of e**(d t) and t e**(d t) in Chebyshev's polynomials.
   !>
   !> d             distance of a root from s0 [1/time]
   !> middle, half  of the time [time]
   !> c             (terms, 2)
   pure subroutine coefficients(d, middle, half, c)
      complex(wp), intent(in) :: d
      real(wp), intent(in) :: middle, half
      complex(wp), intent(out) :: c(:, :)
      complex(wp) :: bessel(0:size(c, 1)), quarter, power, term, shift
      integer :: j, k

      quarter = (d*half/2)**2
      power = 1
      do k = 0, size(c, 1)
         ! I_k(a) = sum (a/2)**(k + 2 j)/(j! (k + j)!), with |a| < 1.4.
         if (k > 0) power = power*(d*half/2)/k
         term = power
         bessel(k) = power
         do j = 1, 10
            term = term*quarter/(j*(k + j))
            bessel(k) = bessel(k) + term
         end do
      end do
      shift = exp(d*middle)
      c(1, 1) = shift*bessel(0)
      c(1, 2) = middle*c(1, 1) + shift*half*bessel(1)
      do k = 1, size(c, 1) - 1
         c(k + 1, 1) = 2*shift*bessel(k)
         c(k + 1, 2) = middle*c(k + 1, 1) + shift*half*(bessel(k - 1) + bessel(k + 1))
      end do
   end subroutine coefficients

end module beamid_local_decays
