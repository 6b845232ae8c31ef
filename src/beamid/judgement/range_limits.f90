!> Whether the records determine the rate or range of a damping mechanism, or only one combination
!> with its strength.
!>
!> Where time or spatial hysteresis is near a limit, strength and range lie in a long curved valley
!> of J. Linear theory then gives intervals that do not contain the truth. The limit itself is
!> therefore fitted: if the records do not reject it, range and strength are not determined.
module beamid_range_limits
   use beamid_distributions, only: normal_quantile
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: model_t, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_least_squares, only: fit, fit_t, options_t
   use beamid_model_roots, only: model_roots
   use beamid_parameters, only: parameters
   use beamid_residuals, only: residual_t
   use beamid_structure, only: of_a_h, of_b, of_b_h, of_d
   use beamid_unknowns, only: quantity_t, variables_of
   use beamid_variables, only: variable_t
   use beamid_verification, only: exact_counterpart
   implicit none
   private

   public :: judge_ranges

   !> A limit of a mechanism: for a small range or rate, or for a large one. The strength times
   !> range**power stays constant on the way to it.
   type :: limit_t
      integer :: range, strength    !< numbers of the parameters
      logical :: is_large
      integer :: power
      character(len=60) :: text     !< what remains there
   end type limit_t
   type(limit_t), parameter :: limits(*) = [ &
      limit_t(of_b_h, of_a_h, .false., 2, 'Kelvin-Voigt damping with c_D I = a_h b_h^2/2'), &
      limit_t(of_b_h, of_a_h, .true., -1, 'a b_h far above the length; only a_h/b_h is '// &
         'determined'), &
      limit_t(of_b(1), of_d(1), .true., -1, 'Kelvin-Voigt damping with c_D = E d_1/b_1'), &
      limit_t(of_b(1), of_d(1), .false., 1, 'a b_1 near 0; only the product d_1 b_1 is '// &
         'determined'), &
      limit_t(of_b(2), of_d(2), .true., -1, 'Kelvin-Voigt damping with c_D = E d_2/b_2'), &
      limit_t(of_b(2), of_d(2), .false., 1, 'a b_2 near 0; only the product d_2 b_2 is determined')]

contains

   !> Withdraws estimates of ranges and strengths whose limit the records do not reject.
   !>
   !> model, mesh, experiments  of the fit
   !> found                     the fit; on return with a reason in `other`
   subroutine judge_ranges(model, mesh, experiments, found)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(inout) :: found
      type(residual_t) :: problem
      real(wp) :: shift(size(found%free))
      logical :: is_possible
      integer :: j, k, strength

      if (found%statistics%samples == 0 .or. .not. any([(any(found%free == limits(j)%range), &
         j=1, size(limits))])) return
      call exact_counterpart(model, mesh, experiments, found%free, problem)
      if (.not. allocated(problem%parts)) return
      call found%restore(problem)
      do j = 1, size(limits)
         k = findloc(found%free, limits(j)%range, dim=1)
         if (k == 0) cycle
         if (found%statistics%is_withdrawn(k)) cycle
         call fit_limit(problem, found, limits(j), k, shift, is_possible)
         if (.not. is_possible) cycle
         strength = findloc(found%free, limits(j)%strength, dim=1)
         shift(k) = 0
         if (strength > 0) shift(strength) = 0
         call found%extend(shift)
         call found%statistics%withdraw(k)
         if (strength > 0) call found%statistics%withdraw(strength)
         if (found%other /= '') found%other = found%other//'; '
         found%other = found%other//trim(parameters(limits(j)%range)%name)// &
            ' is not determined: the records are explained equally well by '//trim(limits(j)%text)
      end do
   end subroutine judge_ranges

   !> Fits the model at a limit.
   !>
   !> prepared     the fit, with the estimates in its scenario
   !> k            place of the range among the free parameters
   !> shift        (free) of the searched variables
   !> is_possible  whether the fit converges and the records do not reject it, at a level of 5 %
   subroutine fit_limit(prepared, found, limit, k, shift, is_possible)
      type(residual_t), intent(in) :: prepared
      type(stage_fit_t), intent(in) :: found
      type(limit_t), intent(in) :: limit
      integer, intent(in) :: k
      real(wp), intent(out) :: shift(:)
      logical, intent(out) :: is_possible
      real(wp), parameter :: level = 0.05_wp
      type(residual_t) :: problem
      type(stage_t) :: stage
      type(variable_t), allocatable :: variables(:)
      type(quantity_t), allocatable :: quantities(:)
      type(fit_t) :: there
      type(error_t), allocatable :: error
      real(wp) :: at, before, inflation
      integer :: j, r

      shift = 0
      is_possible = .false.
      call prepared%copy_to(problem)
      r = found%quantities(k)%record
      call find_limit(problem, limit, max(1, r), at, error)
      if (allocated(error)) return
      before = found%fit%estimate(k)
      call problem%scenario%set(limit%range, r, at)
      call problem%scenario%set(limit%strength, r, problem%scenario%get(limit%strength, r) &
         *(before/at)**limit%power)
      stage = found%again()
      stage = stage%without([(j == k, j=1, size(found%free))])
      call set_free(problem, stage)
      call variables_of(stage, problem%scenario, variables, quantities, error)
      if (allocated(error)) return
      call fit(problem, problem%rows(), variables, options_t(check=.false., all_rows=.false.), &
         there, error)
      if (allocated(error)) return
      shift(:k - 1) = there%estimate(:k - 1) - found%fit%estimate(:k - 1)
      shift(k + 1:) = there%estimate(k:) - found%fit%estimate(k + 1:)
      associate (s => found%statistics)
         inflation = 1
         if (s%std_error(k) > 0 .and. s%std_error(k) < huge(1.0_wp)) inflation = &
            (s%corrected_error(k)/s%std_error(k))**2
         is_possible = there%J - found%fit%J < inflation*s%variance &
            *normal_quantile(1 - level/2)**2
      end associate
   end subroutine fit_limit

   !> Returns a range or rate at which the mechanism does not differ from its limit.
   !>
   !> r      number of the record
   !> error  the roots of the model cannot be computed
   subroutine find_limit(problem, limit, r, at, error)
      type(residual_t), intent(inout) :: problem
      type(limit_t), intent(in) :: limit
      integer, intent(in) :: r
      real(wp), intent(out) :: at
      type(error_t), allocatable, intent(out) :: error
      !> Number of modes that matter at most, and distance from their frequencies, as a factor.
      integer, parameter :: modes = 8
      real(wp), parameter :: far = 1e3_wp
      complex(wp) :: s(modes), ds(modes, size(problem%free))

      at = 0
      if (limit%range == of_b_h) then
         at = problem%scenario%structures(r)%length*merge(30.0_wp, 1e-3_wp, limit%is_large)
         return
      end if
      call model_roots(problem, problem%scenario, r, s, ds, error)
      if (allocated(error)) return
      at = merge(far*abs(s(modes)), abs(s(1))/far, limit%is_large)
   end subroutine find_limit

end module beamid_range_limits
