!> Densities of which means, deviations and probabilities are known.
module densities_with_answers
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_densities, only: density_t, impossible
   use beamid_kinds, only: wp
   implicit none
   private

   public :: normal_t, banana_t, flat_t, two_maxima_t, hole_t, wave_t, comb_t, product_t

   !> Normal, of a mean and of the inverse of a covariance.
   type, extends(density_t) :: normal_t
      real(wp), allocatable :: mean(:), precision(:, :)
   contains
      procedure :: evaluate => evaluate_normal
   end type normal_t

   !> q1 standard normal, q2 normal around bend*(q1**2 - 1).
   type, extends(density_t) :: banana_t
      real(wp) :: bend = 2, sd = 0.2_wp
   contains
      procedure :: evaluate => evaluate_banana
   end type banana_t

   !> Uniform in the first, exp(-rate q) in the second.
   type, extends(density_t) :: flat_t
      real(wp) :: rate = 5
   contains
      procedure :: evaluate => evaluate_flat
   end type flat_t

   !> In each of n directions normal with deviation 1; in the first a second one, so far away and
   !> so probable.
   type, extends(density_t) :: two_maxima_t
      real(wp) :: apart = 8, share = 0.5_wp
   contains
      procedure :: evaluate => evaluate_two_maxima
   end type two_maxima_t

   !> Standard normal, but it cannot be computed near `hole`, or, with a radius below 0, farther
   !> away from it than that.
   type, extends(density_t) :: hole_t
      real(wp) :: hole = 0, radius = 0
      logical :: says_nan = .false.
   contains
      procedure :: evaluate => evaluate_hole
   end type hole_t

   !> Standard normal, with waves on its logarithm.
   type, extends(density_t) :: wave_t
      real(wp) :: height = 0, number = 0
   contains
      procedure :: evaluate => evaluate_wave
   end type wave_t

   !> Standard normal, a fifth lower in a thousandth of the range.
   type, extends(density_t) :: comb_t
   contains
      procedure :: evaluate => evaluate_comb
   end type comb_t

   !> Two parameters of which a product of powers is known much better than each: the logarithms of
   !> q1/q2**4 and of q2 are normal with these deviations.
   type, extends(density_t) :: product_t
      real(wp) :: sd(2) = [1e-5_wp, 1e-3_wp]
   contains
      procedure :: evaluate => evaluate_product
   end type product_t

contains

   subroutine evaluate_product(self, q, value, gradient, curvature)
      class(product_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      real(wp) :: z(2), dz(2, 2)

      z = [log(q(1)) - 4*log(q(2)), log(q(2))]/self%sd
      dz = reshape([1/q(1)/self%sd(1), 0.0_wp, -4/q(2)/self%sd(1), 1/q(2)/self%sd(2)], [2, 2])
      value = -sum(z**2)/2 - sum(log(q))
      if (present(gradient)) gradient = -matmul(z, dz) - 1/q
      if (present(curvature)) curvature = matmul(transpose(dz), dz)
   end subroutine evaluate_product

   subroutine evaluate_wave(self, q, value, gradient, curvature)
      class(wave_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)

      value = self%height*sin(self%number*q(1)) - q(1)**2/2
      if (present(gradient)) gradient = self%height*self%number*cos(self%number*q) - q
      if (present(curvature)) curvature = 1
   end subroutine evaluate_wave

   subroutine evaluate_comb(self, q, value, gradient, curvature)
      class(comb_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)

      value = -q(1)**2/2
      if (modulo(37*q(1) + 0.5_wp, 1.0_wp) < 1e-3_wp) value = value - 0.2_wp
      if (present(gradient)) gradient = -q
      if (present(curvature)) curvature = 1
   end subroutine evaluate_comb

   subroutine evaluate_normal(self, q, value, gradient, curvature)
      class(normal_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)

      value = -dot_product(q - self%mean, matmul(self%precision, q - self%mean))/2
      if (present(gradient)) gradient = -matmul(self%precision, q - self%mean)
      if (present(curvature)) curvature = self%precision
   end subroutine evaluate_normal

   subroutine evaluate_banana(self, q, value, gradient, curvature)
      class(banana_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      real(wp) :: r(2), jac(2, 2)

      r = [q(1), (q(2) - self%bend*(q(1)**2 - 1))/self%sd]
      jac(1, :) = [1.0_wp, 0.0_wp]
      jac(2, :) = [-2*self%bend*q(1), 1.0_wp]/self%sd
      value = -sum(r**2)/2
      if (present(gradient)) gradient = -matmul(r, jac)
      if (present(curvature)) curvature = matmul(transpose(jac), jac)
   end subroutine evaluate_banana

   subroutine evaluate_flat(self, q, value, gradient, curvature)
      class(flat_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)

      value = -self%rate*q(2)
      if (present(gradient)) gradient = [0.0_wp, -self%rate]
      if (present(curvature)) curvature = 0
   end subroutine evaluate_flat

   subroutine evaluate_two_maxima(self, q, value, gradient, curvature)
      class(two_maxima_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      real(wp) :: logs(2), second
      integer :: k

      logs = [log(1 - self%share) - q(1)**2/2, log(self%share) - (q(1) - self%apart)**2/2]
      second = exp(logs(2) - maxval(logs))/sum(exp(logs - maxval(logs)))
      value = maxval(logs) + log(sum(exp(logs - maxval(logs)))) - sum(q(2:)**2)/2
      if (present(gradient)) then
         gradient = -q
         gradient(1) = gradient(1) + self%apart*second
      end if
      if (.not. present(curvature)) return
      curvature = 0
      do k = 1, size(q)
         curvature(k, k) = 1
      end do
   end subroutine evaluate_two_maxima

   subroutine evaluate_hole(self, q, value, gradient, curvature)
      class(hole_t), intent(inout) :: self
      real(wp), intent(in) :: q(:)
      real(wp), intent(out) :: value
      real(wp), intent(out), optional :: gradient(:), curvature(:, :)
      integer :: k

      value = -sum(q**2)/2
      if (present(gradient)) gradient = -q
      if (present(curvature)) then
         curvature = 0
         do k = 1, size(q)
            curvature(k, k) = 1
         end do
      end if
      if (self%radius >= 0 .and. all(abs(q - self%hole) > self%radius)) return
      if (self%radius < 0 .and. all(abs(q - self%hole) <= -self%radius)) return
      value = impossible
      if (self%says_nan) value = ieee_value(value, ieee_quiet_nan)
   end subroutine evaluate_hole

end module densities_with_answers
