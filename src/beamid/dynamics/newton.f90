!> Right-hand side and Newton system of (3.13), written as the first-order system w' = v, M v' = f F
!> - C v - K w, for the solver `cvode`.
!>
!> A step of the BDF solves (I - gamma J) (dw, dv) = (r_w, r_v), where J is the Jacobian and gamma
!> the step coefficient. The first block row gives dw = r_w + gamma dv. Inserted into the second, it
!> gives a symmetric, positive definite band system,
!>
!>     (M + gamma C + gamma**2 K) dv = M r_v - gamma K r_w,
!>
!> so that a step costs O(N), and the inverse of M is never formed.
!>
!> A relaxing stiffness K_l has internal variables z, with the force K_l z and z' = v - b_l z, which
!> follow w and v in the state. The step eliminates them, dz = (r_z + gamma dv)/(1 + gamma b_l):
!> they add gamma**2 K_l/(1 + gamma b_l) to the matrix, which stays banded.
module beamid_newton
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_internal_forces, only: subtract_internal_force
   use beamid_kinds, only: wp, ip
   implicit none
   private

   public :: motion_t, new_motion

   !> The first-order system under the force of the present segment, between two nodes.
   type :: motion_t
      !> M, C, K and F
      type(equations_t), pointer :: equations => null()
      !> Force in the segment: intercept + slope*t [force, force/time], or acceleration of the base.
      real(wp) :: intercept = 0, slope = 0
      !> beginning of the segment [time], and velocity and displacement of the base there
      real(wp) :: begin = 0, base(2) = 0
      !> numbers of evaluations of the right-hand side and of factorizations
      integer(ip) :: evaluations = 0, factorizations = 0
      type(band_t), private :: mass_factor      !< Cholesky factor of M
      !> Cholesky factor of M + gamma C + gamma**2 K
      type(band_t), private :: step_factor
      real(wp), private :: gamma = -1           !< gamma of `step_factor` [time]; -1: none
   contains
      procedure :: derivative, drive, acceleration, newton_step
      final :: release
   end type motion_t

contains

   !> Prepares the first-order system of given equations.
   !>
   !> equations  must outlive `motion`, which points to them
   !> motion     without force
   !> error      M is not positive definite: a mass is missing, or the mesh is finer than round-off
   !>            allows
   subroutine new_motion(equations, motion, error)
      type(equations_t), intent(in), target :: equations
      type(motion_t), intent(out) :: motion
      type(error_t), allocatable, intent(out) :: error
      logical :: positive

      motion%equations => equations
      motion%mass_factor = equations%mass
      call motion%mass_factor%factor(positive)
      if (.not. positive) call failure(error, 'the mass matrix is not positive definite')
      motion%step_factor = equations%mass
   end subroutine new_motion

   !> Frees `step_factor`. If a motion is part of a type with a finalizer of its own, gfortran 12
   !> frees the first of two such components, but not the second.
   pure subroutine release(motion)
      type(motion_t), intent(inout) :: motion

      if (allocated(motion%step_factor%a)) deallocate (motion%step_factor%a)
   end subroutine release

   !> Returns the excitation at time t: the force and two numbers that are not used, or
   !> acceleration, velocity and displacement of the base.
   !>
   !> t  in the segment [time]
   pure function drive(self, t)
      class(motion_t), intent(in) :: self
      real(wp), intent(in) :: t
      real(wp) :: drive(3), first, step

      first = self%intercept + self%slope*self%begin
      step = t - self%begin
      drive(1) = self%intercept + self%slope*t
      drive(2) = self%base(1) + step*(first + step*self%slope/2)
      drive(3) = self%base(2) + step*(self%base(1) + step*(first/2 + step*self%slope/6))
   end function drive

   !> Computes M**-1 (force F - C v - K w - sum of K_l z_l) by the Cholesky factor of M.
   !>
   !> drive  (3) excitation, as from `drive`
   !> y      state: (n) unknowns w, (n) their velocity v, (n) z for each relaxation
   !> a      (n) their acceleration
   subroutine acceleration(self, drive, y, a)
      class(motion_t), intent(in) :: self
      real(wp), intent(in) :: drive(:), y(:)
      real(wp), intent(out) :: a(:)
      integer :: l

      a = drive(1)*self%equations%load
      if (allocated(self%equations%base_loads)) a = a + matmul(self%equations%base_loads, drive(2:))
      associate (n => self%equations%n)
         call subtract_internal_force(self%equations, y(:n), y(n + 1:2*n), a)
         do l = 1, size(self%equations%relaxing)
            call self%equations%relaxing(l)%add_product(-1.0_wp, y((1 + l)*n + 1:(2 + l)*n), a)
         end do
      end associate
      call self%mass_factor%solve(a)
   end subroutine acceleration

   !> Computes the derivative dy of the state y = (w, v, z), both of shape (n (2 + relaxations)), at
   !> time t.
   subroutine derivative(self, t, y, dy)
      class(motion_t), intent(inout) :: self
      real(wp), intent(in) :: t, y(:)
      real(wp), intent(out) :: dy(:)

      integer :: l

      associate (n => self%equations%n)
         dy(:n) = y(n + 1:2*n)
         call self%acceleration(self%drive(t), y, dy(n + 1:2*n))
         do l = 1, size(self%equations%relaxing)
            associate (first => (1 + l)*n + 1, last => (2 + l)*n)
               dy(first:last) = y(n + 1:2*n) - self%equations%rate(l)*y(first:last)
            end associate
         end do
      end associate
      self%evaluations = self%evaluations + 1
   end subroutine derivative

   !> Solves (I - gamma J) x = r. The factorization is kept as long as gamma does not change.
   !>
   !> gamma     step coefficient of the BDF [time]
   !> r, x      (n (2 + relaxations))
   !> positive  .false.: the matrix could not be factored, and x is undefined
   subroutine newton_step(self, gamma, r, x, positive)
      class(motion_t), intent(inout) :: self
      real(wp), intent(in) :: gamma, r(:)
      real(wp), intent(out) :: x(:)
      logical, intent(out) :: positive
      real(wp) :: share(size(self%equations%rate))
      integer :: l

      positive = .true.
      share = gamma/(1 + gamma*self%equations%rate)
      associate (eq => self%equations, n => self%equations%n)
         if (abs(gamma - self%gamma) > 0) then
            self%step_factor%a = eq%mass%a + gamma*(eq%damping%a + gamma*eq%stiffness%a)
            do l = 1, size(share)
               self%step_factor%a = self%step_factor%a + gamma*share(l)*eq%relaxing(l)%a
            end do
            call self%step_factor%factor(positive)
            self%factorizations = self%factorizations + 1
            self%gamma = gamma
            if (.not. positive) then
               self%gamma = -1
               return
            end if
         end if
         x(n + 1:2*n) = 0
         call eq%mass%add_product(1.0_wp, r(n + 1:2*n), x(n + 1:2*n))
         call eq%stiffness%add_product(-gamma, r(:n), x(n + 1:2*n))
         do l = 1, size(share)
            call eq%relaxing(l)%add_product(-share(l), r((1 + l)*n + 1:(2 + l)*n), x(n + 1:2*n))
         end do
         call self%step_factor%solve(x(n + 1:2*n))
         x(:n) = r(:n) + gamma*x(n + 1:2*n)
         do l = 1, size(share)
            associate (first => (1 + l)*n + 1, last => (2 + l)*n)
               x(first:last) = r(first:last)*(share(l)/gamma) + share(l)*x(n + 1:2*n)
            end associate
         end do
      end associate
   end subroutine newton_step

end module beamid_newton
