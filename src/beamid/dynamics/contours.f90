!> The transfer function of a cluster of roots (`beamid_clusters`), from contour integrals.
!>
!> The transfer function h and W'/W (`beamid_transfer`) are integrated over a circle that separates
!> the m roots of the cluster from all others. With s = c + R z and the mean < > over the circle,
!>
!>     mu_k = R <z**(k+1) h>,  S_k = R <z**(k+1) W'/W>,  d S_k = -k <z**k d log W>.
!>
!> The trapezoidal rule converges like a geometric series. S_k is the sum of the k-th powers of the
!> roots in z, and S_0 their number; Newton's identities give the polynomial P with these roots. The
!> mu_k are the coefficients of N/P at infinity, where N/(R P) is the part of h with these poles.
module beamid_contours
   use beamid_assembly, only: assembly_t, root_t
   use beamid_clusters, only: cluster_t
   use beamid_kinds, only: pi, wp
   use beamid_transfer, only: transfer_t, transfer_at
   implicit none
   private

   public :: measure, contour_point, rows_of, free_rows

contains

   !> Computes point k of the circle. The mean over the circle is the mean over its points; for a
   !> circle about the real axis, whose points are on the upper half, it is the real part of that.
   !>
   !> k      number of the point, 1 .. points
   !> z      position relative to the centre and the radius, |z| = 1
   !> point  the point s = c + R z
   pure subroutine contour_point(self, k, z, point)
      class(cluster_t), intent(in) :: self
      integer, intent(in) :: k
      complex(wp), intent(out) :: z
      type(root_t), intent(out) :: point
      real(wp) :: angle

      angle = merge(1, 2, self%on_axis)*pi*(k - 0.5_wp)/self%points
      z = cmplx(cos(angle), sin(angle), wp)
      point = self%centre
      point%offset = point%offset + self%radius*z
      point%s = point%s + self%radius*z
   end subroutine contour_point

   !> Computes the polynomial P of a cluster and the sensor's motion, with their derivatives with
   !> respect to the parameters of the assembly.
   !>
   !> self  in: roots, circle and number of points; out: the other components, too
   subroutine measure(assembly, self)
      type(assembly_t), intent(in) :: assembly
      type(cluster_t), intent(inout) :: self
      complex(wp) :: mu(0:self%m + 1), S(0:self%m), z, power
      complex(wp), allocatable :: dmu(:, :), dS(:, :)
      type(transfer_t) :: value
      type(root_t) :: point
      integer :: i, k, n

      n = size(assembly%given%parameters)
      self%parameters = assembly%given%parameters
      allocate (dmu(0:self%m + 1, n), dS(self%m, n), source=(0.0_wp, 0.0_wp))
      mu = 0
      S = 0
      do i = 1, self%points
         call contour_point(self, i, z, point)
         call transfer_at(assembly, point, n > 0, value)
         power = z/self%points
         do k = 0, self%m + 1
            mu(k) = mu(k) + self%radius*power*value%h
            if (k <= self%m) S(k) = S(k) + self%radius*power*value%dlog
            if (n > 0) then
               dmu(k, :) = dmu(k, :) + self%radius*power*value%dh
               if (k < self%m) dS(k + 1, :) = dS(k + 1, :) - (k + 1)*power*value%dlog_p
            end if
            power = power*z
         end do
      end do
      mu = self%weight()*mu
      dmu = self%weight()*dmu
      if (self%on_axis) then
         mu = real(mu)
         dmu = real(dmu)
         S = real(S)
         dS = real(dS)
      end if
      self%counted = S(0)
      self%moments = [mu(0), self%centre%s*mu(0) + self%radius*mu(1)]
      if (self%is_origin) then
         ! P = z**m, independent of the parameters. A pole at 0 is at most a double one.
         S = 0
         dS = 0
         mu(2:) = 0
         dmu(2:, :) = 0
      end if
      call newton_identities(S(1:), dS, self%a, self%da)
      call rows_of(self, mu, dmu, self%row, self%drow)
   end subroutine measure

   !> Computes the monic polynomial whose roots have the power sums S_1, S_2, ..., and its
   !> derivatives, by Newton's identities: k a_(m-k) = -sum over i = 1 .. k of a_(m-k+i) S_i.
   !>
   !> S   (m) power sums
   !> dS  (m, parameters) derivatives of S
   !> a   (m + 1) coefficients, by ascending powers
   !> da  (m + 1, parameters) derivatives of a
   pure subroutine newton_identities(S, dS, a, da)
      complex(wp), intent(in) :: S(:), dS(:, :)
      complex(wp), allocatable, intent(out) :: a(:), da(:, :)
      integer :: i, k, m

      m = size(S)
      allocate (a(m + 1), da(m + 1, size(dS, 2)), source=(0.0_wp, 0.0_wp))
      a(m + 1) = 1
      do k = 1, m
         associate (j => m + 1 - k)
            do i = 1, k
               a(j) = a(j) - a(j + i)*S(i)/k
               da(j, :) = da(j, :) - (da(j + i, :)*S(i) + a(j + i)*dS(i, :))/k
            end do
         end associate
      end do
   end subroutine newton_identities

   !> Computes the rows that map the states of `beamid_cluster_motion` to displacement, velocity and
   !> acceleration of a motion with given moments, without the part of the acceleration that follows
   !> the force instantaneously.
   !>
   !> With N P_p = Q P + rest, the derivative with respect to a parameter is
   !> (N/P)_p = (N_p - Q)/P - rest/P**2.
   !>
   !> mu    (m + 2) moments
   !> dmu   (m + 2, parameters) derivatives of mu
   !> row   (m, 3) rows for displacement, velocity and acceleration
   !> drow  (2 m, 3, parameters) derivatives of the rows; the second half belongs to 1/P**2
   pure subroutine rows_of(self, mu, dmu, row, drow)
      class(cluster_t), intent(in) :: self
      complex(wp), intent(in) :: mu(:), dmu(:, :)
      complex(wp), allocatable, intent(out) :: row(:, :), drow(:, :, :)
      complex(wp) :: moments(size(mu), 3), slopes(size(mu), 3)
      integer :: i, order, p

      allocate (row(self%m, 3), drow(2*self%m, 3, size(dmu, 2)))
      moments = derived(self, mu)
      do order = 1, 3
         do i = 1, self%m
            row(i, order) = sum(self%a(i + 1:)*moments(:self%m + 1 - i, order))
         end do
      end do
      do p = 1, size(dmu, 2)
         slopes = derived(self, dmu(:, p))
         do order = 1, 3
            call divide(self, row(:, order), self%da(:, p), drow(:, order, p))
            do i = 1, self%m
               drow(i, order, p) = drow(i, order, p) &
                  + sum(self%a(i + 1:)*slopes(:self%m + 1 - i, order) &
                  + self%da(i + 1:, p)*moments(:self%m + 1 - i, order))
            end do
         end do
      end do
   end subroutine rows_of

   !> Computes the rows of the free motion that starts with state k alone, divided by c**2, so that
   !> the acceleration is of order one.
   !>
   !> k          number of the state, 1 .. m
   !> row, drow  as in `rows_of`
   pure subroutine free_rows(self, k, row, drow)
      class(cluster_t), intent(in) :: self
      integer, intent(in) :: k
      complex(wp), allocatable, intent(out) :: row(:, :), drow(:, :, :)
      complex(wp) :: mu(self%m + 2), dmu(self%m + 2, size(self%da, 2))

      associate (a => self%a, da => self%da, m => self%m)
         mu = 0
         dmu = 0
         mu(k) = 1
         ! z**m and z**(m + 1) are reduced by P(z) = 0.
         mu(m + 1:) = [-a(k), a(m)*a(k)]
         dmu(m + 1, :) = -da(k, :)
         dmu(m + 2, :) = a(m)*da(k, :) + da(m, :)*a(k)
         if (k > 1) mu(m + 2) = mu(m + 2) - a(k - 1)
         if (k > 1) dmu(m + 2, :) = dmu(m + 2, :) - da(k - 1, :)
      end associate
      call rows_of(self, mu/self%centre%s**2, dmu/self%centre%s**2, row, drow)
   end subroutine free_rows

   !> Returns the moments of a motion and of its first and second time derivatives, s = c + R z. The
   !> first m moments of each are correct.
   !>
   !> mu       (m + 2) moments of the motion
   !> moments  (m + 2, 3) moments of displacement, velocity and acceleration
   pure function derived(self, mu) result(moments)
      class(cluster_t), intent(in) :: self
      complex(wp), intent(in) :: mu(:)
      complex(wp) :: moments(size(mu), 3)
      integer :: order

      moments(:, 1) = mu
      do order = 2, 3
         moments(:, order) = self%centre%s*moments(:, order - 1) &
            + self%radius*eoshift(moments(:, order - 1), 1)
      end do
   end function derived

   !> Divides N P_p by P with remainder, N P_p = Q P + rest.
   !>
   !> row       (m) coefficients of N
   !> da        (m + 1) coefficients of P_p
   !> quotient  (2 m) coefficients of -Q, then of -rest
   pure subroutine divide(self, row, da, quotient)
      class(cluster_t), intent(in) :: self
      complex(wp), intent(in) :: row(:), da(:)
      complex(wp), intent(out) :: quotient(:)
      complex(wp) :: product(2*self%m)
      integer :: i, m

      m = self%m
      product = 0
      do i = 1, m
         product(i:i + m) = product(i:i + m) - row(i)*da
      end do
      quotient = 0
      do i = m, 1, -1
         quotient(i) = product(i + m)
         product(i:i + m) = product(i:i + m) - quotient(i)*self%a
      end do
      quotient(m + 1:) = product(:m)
   end subroutine divide

end module beamid_contours
