!> Residuals model - record, over one record or several, as a function of the parameters that a
!> search moves. What enters linearly is eliminated at every evaluation.
module beamid_residuals
   use beamid_errors, only: error_t
   use beamid_experiments, only: apparatus_t, experiment_t, linear_t, new_apparatus
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_problems, only: smooth_problem_t
   use beamid_projection, only: new_projection, projection_t
   use beamid_responses, only: is_exact, work_t
   use beamid_simulation, only: model_t
   use beamid_unknowns, only: world_t
   implicit none
   private

   public :: residual_t, new_residuals

   type, extends(smooth_problem_t) :: residual_t
      type(apparatus_t), allocatable :: parts(:)   !< one for each record
      type(world_t) :: world
      integer, allocatable :: free(:)              !< (n) places in the `parameters`
      integer, allocatable :: record(:)            !< (n) the record of each; 0: all
      logical :: offset = .false.
      type(work_t) :: work                         !< of all evaluations
   contains
      procedure :: residuals
      procedure :: jacobian
      procedure :: samples
      procedure :: evaluate
      procedure :: with
   end type residual_t

contains

   !> The problem of some experiments on one mesh; what is free comes with a stage.
   !>
   !> model    its excitation is not used, each experiment has its own
   !> turning  whether the compliance of the clamp is free; default .false.
   !> error    an experiment that the model's solver cannot compute
   subroutine new_residuals(model, mesh, experiments, problem, error, turning)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(residual_t), intent(out) :: problem
      type(error_t), allocatable, intent(out) :: error
      logical, intent(in), optional :: turning
      integer :: i

      problem%exact = is_exact(model%solver)
      allocate (problem%parts(size(experiments)))
      allocate (problem%world%structures(size(experiments)))
      allocate (problem%world%excitations(size(experiments)))
      do i = 1, size(experiments)
         problem%world%structures(i) = experiments(i)%structure_of(model%structure)
         if (present(turning)) problem%world%structures(i)%root_is_free = turning
         problem%world%excitations(i) = experiments(i)%excitation
         call new_apparatus(experiments(i), problem%world%structures(i), mesh, &
            model%observation, model%solver, problem%parts(i), error)
         if (allocated(error)) return
      end do
   end subroutine new_residuals

   !> Number of residuals, all records together.
   pure integer function samples(self)
      class(residual_t), intent(in) :: self
      integer :: i

      samples = sum([(size(self%parts(i)%experiment%samples), i=1, size(self%parts))])
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
      real(wp) :: none(size(r), 0)

      call self%evaluate(parameters, r, none, error)
   end subroutine residuals

   subroutine jacobian(self, parameters, r, jac, error)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%evaluate(parameters, r, jac, error)
   end subroutine jacobian

   !> Residuals with the linear unknowns eliminated, and derivatives as far as there is room.
   !>
   !> jac           (m, 0); (m, n) of the residuals; (m, n + k) with respect to every unknown, the
   !>               linear ones included, each with all the others held
   !> coefficients  (k) the linear unknowns, where the derivatives are with respect to all: of each
   !>               record in turn cosine and sine of each mode, then the offset
   subroutine evaluate(self, parameters, r, jac, error, coefficients)
      class(residual_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(out), optional :: coefficients(:)
      type(projection_t) :: projection
      type(world_t) :: world
      type(linear_t) :: linear
      real(wp), allocatable :: dy(:, :), phi(:, :), along(:, :), c(:)
      integer, allocatable :: mine(:)
      integer :: i, k, n, m, row, column

      world = self%with(parameters)
      n = size(parameters)
      jac = 0
      row = 0
      column = n
      do i = 1, size(self%parts)
         m = size(self%parts(i)%experiment%samples)
         mine = pack([(k, k=1, n)], size(jac, 2) > 0 .and. &
            (self%record == 0 .or. self%record == i))
         if (allocated(dy)) deallocate (dy)
         allocate (dy(m, size(mine)))
         associate (y => r(row + 1:row + m), by => jac(row + 1:row + m, :))
            call self%parts(i)%evaluate(world%structures(i), world%excitations(i), self%offset, &
               self%free(mine), y, dy, linear, self%work, error)
            if (allocated(error)) return
            if (allocated(c)) deallocate (c)
            allocate (c(size(linear%weights, 2)))
            if (size(c) > 0) then
               phi = linear%columns(0)
               call new_projection(phi, projection, error)
               if (allocated(error)) return
               call projection%coefficients(y, c)
               if (allocated(along)) deallocate (along)
               allocate (along(size(c), size(mine)))
               call linear%add_change(c, y, dy, along)
               if (.not. present(coefficients)) call projection%derivatives(along, dy)
            end if
            by(:, mine) = dy
            if (present(coefficients) .and. size(c) > 0) then
               by(:, column + 1:column + size(c)) = phi
               coefficients(column - n + 1:column - n + size(c)) = c
               column = column + size(c)
            end if
         end associate
         row = row + m
      end do
   end subroutine evaluate

end module beamid_residuals
