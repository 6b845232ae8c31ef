!> Declares the types of least-squares problems, with or without exact derivatives, that a search
!> minimises. Computes Jacobians by central differences, and compares exact derivatives with them.
module beamid_problems
   use beamid_errors, only: error_t
   use beamid_kinds, only: wp
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: problem_t, smooth_problem_t, differences, error_of_differences, compare_derivatives

   !> A least-squares problem: residuals as a function of physical parameters.
   type, abstract :: problem_t
   contains
      procedure(residuals), deferred :: residuals
   end type problem_t

   !> A least-squares problem that also computes the derivatives of its residuals.
   type, abstract, extends(problem_t) :: smooth_problem_t
      !> .false.: the derivatives are not available in the present state; differences are used
      logical :: exact = .true.
   contains
      procedure(jacobian), deferred :: jacobian
      procedure :: condensed_rows => all_rows
      procedure :: condensed => all_of_jacobian
      procedure :: check_sample => check_none
   end type smooth_problem_t

   abstract interface
      !> Computes the residuals.
      !>
      !> parameters  (n) physical values
      !> r           (m) residuals
      !> error       the model cannot be computed at these parameters
      subroutine residuals(self, parameters, r, error)
         import :: error_t, problem_t, wp
         class(problem_t), intent(inout) :: self
         real(wp), intent(in) :: parameters(:)
         real(wp), intent(out) :: r(:)
         type(error_t), allocatable, intent(out) :: error
      end subroutine residuals
      !> Computes the residuals and their derivatives.
      !>
      !> parameters  (n) physical values
      !> r           (m) residuals
      !> jac         (m, n) d r/d parameter, with respect to physical parameters
      !> error       the model cannot be computed at these parameters
      subroutine jacobian(self, parameters, r, jac, error)
         import :: error_t, smooth_problem_t, wp
         class(smooth_problem_t), intent(inout) :: self
         real(wp), intent(in) :: parameters(:)
         real(wp), intent(out) :: r(:), jac(:, :)
         type(error_t), allocatable, intent(out) :: error
      end subroutine jacobian
   end interface

contains

   !> Returns the number of rows of `condensed`: m, unless a problem has fewer.
   !>
   !> m  number of residuals
   !> n  number of parameters
   pure integer function all_rows(self, m, n)
      class(smooth_problem_t), intent(in) :: self
      integer, intent(in) :: m, n

      all_rows = m
   end function all_rows

   !> Computes residuals and derivatives that a search uses in place of those of `jacobian`. They
   !> have the same J'J, J'r and r'r, but may have fewer rows. Here they are the same.
   !>
   !> r    (condensed_rows)
   !> jac  (condensed_rows, n)
   subroutine all_of_jacobian(self, parameters, r, jac, error)
      class(smooth_problem_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error

      call self%jacobian(parameters, r, jac, error)
   end subroutine all_of_jacobian

   !> Compares the exact derivatives of a part of the residuals with central differences, where a
   !> part is enough. Here there is none.
   !>
   !> is_done  .false.: all residuals have to be compared; nothing has been computed
   !>
   !> Other arguments as of `compare_derivatives`.
   subroutine check_none(self, parameters, variables, worst, mistaken, is_done)
      class(smooth_problem_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      type(variable_t), intent(in) :: variables(:)
      real(wp), allocatable, intent(out) :: worst
      integer, intent(out) :: mistaken
      logical, intent(out) :: is_done

      mistaken = 0
      is_done = .false.
   end subroutine check_none

   !> Compares a Jacobian, column by column, with central differences of the residuals.
   !>
   !> A column counts as wrong if it differs from the central differences by more than 0.5 % of its
   !> length, and by more than three times the uncertainty of the differences. This uncertainty is
   !> the larger of their change with a step three times longer or shorter and the round-off of the
   !> parameter with the largest effect. The criterion therefore does not depend on the size of a
   !> parameter's effect.
   !>
   !> parameters  (n) physical values
   !> variables   (n) with their bounds and magnitudes
   !> exact       (m, n) the Jacobian at the parameters
   !> worst       largest relative difference of a column; not allocated if the differences cannot
   !>             be computed
   !> mistaken    index of the column with the largest error among the wrong columns; 0: none
   subroutine compare_derivatives(problem, parameters, variables, exact, worst, mistaken)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: parameters(:), exact(:, :)
      type(variable_t), intent(in) :: variables(:)
      real(wp), allocatable, intent(out) :: worst
      integer, intent(out) :: mistaken
      real(wp), parameter :: longer = 3, allowed = 5e-3_wp
      type(error_t), allocatable :: error
      real(wp), dimension(size(exact, 1), size(exact, 2)) :: approximate, wide, narrow
      real(wp), dimension(size(exact, 2)) :: length, wrong, unsure
      real(wp), parameter :: eps = epsilon(1.0_wp)

      mistaken = 0
      call differences(problem, parameters, variables, eps, approximate, error)
      if (allocated(error)) return
      length = max(norm2(exact, dim=1), norm2(approximate, dim=1), tiny(1.0_wp))
      wrong = norm2(exact - approximate, dim=1)/length
      worst = maxval([0.0_wp, wrong])
      if (.not. worst > allowed) return
      call differences(problem, parameters, variables, eps*longer**3, wide, error)
      if (allocated(error)) return
      call differences(problem, parameters, variables, eps/longer**3, narrow, error)
      if (allocated(error)) return
      unsure = 0
      where (wrong > allowed) unsure = max(norm2(wide - approximate, dim=1), &
         norm2(narrow - approximate, dim=1), eps*maxval(norm2(exact, dim=1)*abs(parameters)) &
         /steps(eps, parameters, variables))/length
      mistaken = maxloc(wrong, dim=1, mask=wrong > allowed .and. .not. wrong <= 3*unsure)
   end subroutine compare_derivatives

   !> Computes the Jacobian by central differences. The step is proportional to the cube root of the
   !> relative error. Near a bound, the two points are moved inside.
   !>
   !> parameters      (n) physical values
   !> variables       (n) with their bounds and magnitudes
   !> relative_error  of the residuals
   !> jac             (m, n) d r/d parameter
   !> error           the model cannot be computed at one of the points
   subroutine differences(problem, parameters, variables, relative_error, jac, error)
      class(problem_t), intent(inout) :: problem
      real(wp), intent(in) :: parameters(:), relative_error
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(out) :: jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: all_steps(size(parameters)), p(size(parameters)), step
      real(wp), dimension(size(jac, 1)) :: above, below
      integer :: k

      all_steps = steps(relative_error, parameters, variables)
      do k = 1, size(parameters)
         step = all_steps(k)
         p = parameters
         p(k) = max(min(parameters(k), variables(k)%upper - step) - step, variables(k)%lower)
         call problem%residuals(p, below, error)
         if (allocated(error)) return
         p(k) = p(k) + 2*step
         call problem%residuals(p, above, error)
         if (allocated(error)) return
         jac(:, k) = (above - below)/(2*step)
      end do
   end subroutine differences

   !> Returns half the distance, (n), between the two points of each central difference.
   pure function steps(relative_error, parameters, variables)
      real(wp), intent(in) :: relative_error, parameters(:)
      type(variable_t), intent(in) :: variables(:)
      real(wp) :: steps(size(parameters))

      steps = relative_error**(1/3.0_wp)*max(abs(parameters), 1e-3_wp*variables%magnitude)
   end function steps

   !> Returns a bound, with some reserve, for the relative error of a Jacobian by central
   !> differences: the error of the residuals over the step.
   !>
   !> relative_error  of the residuals
   pure real(wp) function error_of_differences(relative_error) result(error)
      real(wp), intent(in) :: relative_error

      error = 10*relative_error**(2/3.0_wp)
   end function error_of_differences

end module beamid_problems
