!> Residuals model - record, over one record or several, as a function of the parameters that a
!> search moves. What enters linearly is eliminated at every evaluation.
module beamid_residuals
   use beamid_errors, only: error_t
   use beamid_experiments, only: apparatus_t
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   use beamid_projection, only: new_projection, projection_t
   use beamid_strings, only: to_text
   use beamid_unknowns, only: name_of, quantity_t, world_t
   use beamid_parameters, only: offset_place => offset
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: residual_t

   type, extends(smooth_problem_t) :: residual_t
      type(apparatus_t), allocatable :: parts(:)   !< one for each record
      type(world_t) :: world
      integer, allocatable :: free(:)              !< (n) places in the `parameters`
      integer, allocatable :: record(:)            !< (n) the record of each; 0: all
      logical :: offset = .false.
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure :: samples
      procedure :: linear_quantities
      procedure :: linear_jacobian
      procedure :: with
   end type residual_t

contains

   !> Number of residuals, all records together.
   pure integer function samples(self)
      class(residual_t), intent(in) :: self
      integer :: i

      samples = sum([(size(self%parts(i)%measured), i=1, size(self%parts))])
   end function samples

   !> The world with trial values in place.
   pure type(world_t) function with(self, parameters)
      class(residual_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      integer :: k

      with = self%world
      do k = 1, size(parameters)
         call with%set(self%free(k), self%record(k), parameters(k))
      end do
   end function with

   subroutine residuals(self, parameters, r, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: phi(:, :), c(:)
      type(world_t) :: world
      integer :: i, first, last

      world = self%with(parameters)
      last = 0
      do i = 1, size(self%parts)
         first = last + 1
         last = last + size(self%parts(i)%measured)
         call self%parts(i)%evaluate(world%structures(i), world%excitations(i), self%offset, &
            r(first:last), phi, error)
         if (.not. allocated(error)) call eliminate(phi, r(first:last), c, error)
         if (allocated(error)) return
      end do
   end subroutine residuals

   !> Eliminates the linear unknowns, if there are any.
   subroutine eliminate(phi, y, c, error, projection)
      real(wp), intent(in) :: phi(:, :)
      real(wp), intent(inout) :: y(:)
      real(wp), allocatable, intent(out) :: c(:)
      type(error_t), allocatable, intent(out) :: error
      type(projection_t), intent(out), optional :: projection
      type(projection_t) :: own

      allocate (c(size(phi, 2)))
      if (size(c) == 0) return
      call new_projection(phi, own, error)
      if (allocated(error)) return
      call own%coefficients(y, c)
      if (present(projection)) projection = own
   end subroutine eliminate

   subroutine jacobian(self, parameters, r, jac, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call with_linear(self, parameters, .true., r, jac, error)
   end subroutine jacobian

   !> Derivatives with respect to every unknown, those that enter linearly included, each with all
   !> the others held.
   !>
   !> jac  (m, n + k)
   !> c    (k)
   subroutine linear_jacobian(self, parameters, r, jac, c, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      real(wp), intent(out) :: c(:)
      type(error_t), allocatable, intent(out) :: error

      call with_linear(self, parameters, .false., r, jac, error, c)
   end subroutine linear_jacobian

   !> reduced  derivatives of the residuals with the linear unknowns eliminated; else of all
   subroutine with_linear(self, parameters, reduced, r, jac, error, coefficients)
      type(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      logical, intent(in) :: reduced
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(out), optional :: coefficients(:)
      type(projection_t) :: projection
      type(world_t) :: world
      real(wp), allocatable :: dy(:, :), phi(:, :), dphi(:, :, :), c(:)
      integer, allocatable :: mine(:)
      integer :: i, k, n, first, last, column

      world = self%with(parameters)
      n = size(parameters)
      jac = 0
      last = 0
      column = n
      do i = 1, size(self%parts)
         first = last + 1
         last = last + size(self%parts(i)%measured)
         mine = pack([(k, k=1, n)], self%record == 0 .or. self%record == i)
         if (allocated(dy)) deallocate (dy)
         allocate (dy(last - first + 1, size(mine)))
         call self%parts(i)%differentiate(world%structures(i), world%excitations(i), self%offset, &
            self%free(mine), r(first:last), dy, phi, dphi, error)
         if (.not. allocated(error)) call eliminate(phi, r(first:last), c, error, projection)
         if (allocated(error)) return
         do k = 1, size(mine)
            if (size(c) > 0) dy(:, k) = dy(:, k) + matmul(dphi(:, :, k), c)
            if (size(c) > 0 .and. reduced) call projection%derivative(dphi(:, :, k), &
               r(first:last), dy(:, k))
            jac(first:last, mine(k)) = dy(:, k)
         end do
         if (reduced) cycle
         jac(first:last, column + 1:column + size(c)) = phi
         if (present(coefficients)) coefficients(column - n + 1:column - n + size(c)) = c
         column = column + size(c)
      end do
   end subroutine with_linear

   !> The unknowns that enter linearly, in the order of `linear_jacobian`, without their values.
   function linear_quantities(self) result(quantities)
      class(residual_t), intent(in) :: self
      type(quantity_t), allocatable :: quantities(:)
      integer :: i, k, record

      allocate (quantities(0))
      do i = 1, size(self%parts)
         record = merge(i, 0, size(self%parts) > 1)
         do k = 1, self%world%excitations(i)%modes
            quantities = [quantities, linear('cos_'//to_text(k), 0), linear('sin_'//to_text(k), 0)]
         end do
         if (self%offset) quantities = [quantities, linear('offset', offset_place)]
      end do

   contains

      type(quantity_t) function linear(name, parameter)
         character(len=*), intent(in) :: name
         integer, intent(in) :: parameter

         linear%name = name_of(name, record)
         linear%parameter = parameter
         linear%record = record
         linear%lower = -unbounded
         linear%upper = unbounded
      end function linear

   end function linear_quantities

end module beamid_residuals
