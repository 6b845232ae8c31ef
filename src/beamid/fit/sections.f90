!> Least-squares problems in which one parameter of another problem is fixed: their minimum, and
!> how it moves with this parameter.
module beamid_sections
   use beamid_errors, only: error_t
   use beamid_gauss_newton, only: least_squares_step, scales_of
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_problems, only: smooth_problem_t
   use beamid_variables, only: variable_t
   implicit none
   private

   public :: section_t, new_section, minimise, find_slopes, distance_of

   !> The least-squares problem in which one parameter of another problem is fixed.
   type, extends(smooth_problem_t) :: section_t
      class(smooth_problem_t), pointer :: full => null()    !< the problem with all n parameters
      integer :: rows = 0                                   !< m, number of residuals
      type(variable_t), allocatable :: variables(:)         !< (n) of all parameters
      integer :: fixed = 0                                  !< index of the fixed parameter
      real(wp) :: value = 0                                 !< its value
      real(wp) :: J_min = 0                                 !< least sum of squares
      real(wp) :: rise = 1                                  !< of J at the end of the interval
      !> largest number of evaluations, with a Jacobian each, in one search; 0: that of `options_t`
      integer :: max_evaluations = 0
   contains
      procedure :: residuals, jacobian, condensed_rows, condensed
   end type section_t

contains

   !> Fixes parameter k of a problem; the other arguments are those of `follow_profile`.
   subroutine new_section(section, problem, rows, variables, k, J_min, rise)
      type(section_t), intent(inout) :: section
      class(smooth_problem_t), intent(inout), target :: problem
      integer, intent(in) :: rows, k
      type(variable_t), intent(in) :: variables(:)
      real(wp), intent(in) :: J_min, rise

      section%full => problem
      section%exact = problem%exact
      section%rows = rows
      section%variables = variables
      section%fixed = k
      section%J_min = J_min
      section%rise = rise
   end subroutine new_section

   !> Returns the distance from the estimate, as in `side_t`, for a sum of squares J.
   pure real(wp) function distance_of(section, J)
      type(section_t), intent(in) :: section
      real(wp), intent(in) :: J

      distance_of = sqrt(max(0.0_wp, J - section%J_min)/section%rise)
   end function distance_of

   !> Minimises J over all parameters except the fixed one.
   !>
   !> parameters  (n) on entry the start and the fixed value, on return the minimum
   !> J           least sum of squares
   !> error       the fit failed
   !> tolerance   if present, a rough minimum is enough: relative error of J, unless 100 evaluations
   !>             do not reach it
   subroutine minimise(section, parameters, J, error, tolerance)
      type(section_t), intent(inout) :: section
      real(wp), intent(inout) :: parameters(:)
      real(wp), intent(out) :: J
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: tolerance
      type(variable_t) :: others(size(parameters) - 1)
      type(options_t) :: options
      type(fit_t) :: found

      associate (k => section%fixed)
         section%value = parameters(k)
         others = [section%variables(:k - 1), section%variables(k + 1:)]
         ! A parameter that has decreased with the fixed one, to a thousandth of its size, say, is
         ! not yet at a bound.
         others%magnitude = max(1e-4_wp*others%magnitude, min(others%magnitude, &
            abs([parameters(:k - 1), parameters(k + 1:)])))
         others = others%from([parameters(:k - 1), parameters(k + 1:)])
      end associate
      options%check = .false.
      options%tolerance = 1e-9_wp
      if (section%max_evaluations > 0) options%max_evaluations = section%max_evaluations &
         *merge(1, size(others) + 1, section%exact)
      options%rough = present(tolerance)
      if (present(tolerance)) then
         options%tolerance = tolerance
         options%max_evaluations = 100
      end if
      J = 0
      call fit(section, section%rows, others, options, found, error)
      if (allocated(error)) return
      parameters = all_parameters(section, found%estimate)
      J = found%J
   end subroutine minimise

   !> Computes the derivatives, (n), of all parameters along the curve of minima by the fixed
   !> parameter, from the Jacobian; 0 for the other parameters if the Jacobian is not available.
   subroutine find_slopes(section, parameters, slopes)
      type(section_t), intent(inout) :: section
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: slopes(:)
      real(wp) :: r(section%rows), jac(section%rows, size(parameters))
      type(error_t), allocatable :: error
      logical :: moves(size(parameters))
      integer :: rank, k

      slopes = 0
      slopes(section%fixed) = 1
      if (.not. section%exact) return
      call section%full%jacobian(parameters, r, jac, error)
      if (allocated(error)) return
      moves = [(k /= section%fixed .and. .not. section%variables(k)%is_at_bound(parameters(k)), &
         k=1, size(parameters))]
      call least_squares_step(jac, jac(:, section%fixed), scales_of(section%variables, &
         parameters), moves, epsilon(1.0_wp)*section%rows, slopes, rank)
      slopes(section%fixed) = 1
   end subroutine find_slopes

   !> Computes the residuals, (rows), with one parameter fixed; `parameters` (n - 1) are the others.
   subroutine residuals(self, parameters, r, error)
      class(section_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:)
      type(error_t), allocatable, intent(out) :: error

      call self%full%residuals(all_parameters(self, parameters), r, error)
   end subroutine residuals

   !> Computes the residuals and their derivatives, (rows, n - 1), by the parameters not fixed.
   subroutine jacobian(self, parameters, r, jac, error)
      class(section_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: full(size(jac, 1), size(jac, 2) + 1)

      call self%full%jacobian(all_parameters(self, parameters), r, full, error)
      if (.not. allocated(error)) call leave_out_fixed(self, full, jac)
   end subroutine jacobian

   !> Returns the number of condensed rows: those of the problem with all n parameters.
   pure integer function condensed_rows(self, m, n)
      class(section_t), intent(in) :: self
      integer, intent(in) :: m, n

      condensed_rows = self%full%condensed_rows(m, n + 1)
   end function condensed_rows

   !> Does the same as `jacobian`, in condensed rows.
   subroutine condensed(self, parameters, r, jac, error)
      class(section_t), intent(inout) :: self
      real(wp), intent(in) :: parameters(:)
      real(wp), intent(out) :: r(:), jac(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: full(size(jac, 1), size(jac, 2) + 1)

      call self%full%condensed(all_parameters(self, parameters), r, full, error)
      if (.not. allocated(error)) call leave_out_fixed(self, full, jac)
   end subroutine condensed

   !> Copies the derivatives (rows, n) by all parameters but the fixed one.
   pure subroutine leave_out_fixed(self, full, jac)
      class(section_t), intent(in) :: self
      real(wp), intent(in) :: full(:, :)
      real(wp), intent(out) :: jac(:, :)

      jac(:, :self%fixed - 1) = full(:, :self%fixed - 1)
      jac(:, self%fixed:) = full(:, self%fixed + 1:)
   end subroutine leave_out_fixed

   !> Returns all parameters, (n), with the fixed value in its place among the others.
   pure function all_parameters(self, others) result(parameters)
      class(section_t), intent(in) :: self
      real(wp), intent(in) :: others(:)
      real(wp) :: parameters(size(others) + 1)

      parameters = [others(:self%fixed - 1), self%value, others(self%fixed:)]
   end function all_parameters

end module beamid_sections
