!> Adds the error of parameters that the user asked for and the program keeps fixed, because the
!> record does not show the modes that would determine them.
!>
!> The 95 % range of such a parameter is assumed to be value/3 to 3 value, of E 0.7 to 1.3 value,
!> and of rho value/1.2 to 1.2 value. These ranges are too wide for linear theory. Therefore the
!> other parameters are fitted again with the parameter at either end of its range, and the larger
!> change counts as the half width of a 95 % interval.
module beamid_fixed_parameters
   use beamid_distributions, only: normal_quantile
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_held_errors, only: held_t
   use beamid_identification, only: run_stages
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: name_of_parameter
   use beamid_parameters, only: on_beam, parameters, set_free
   use beamid_priors, only: priors_of
   use beamid_simulation, only: model_t
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_structure, only: is_coefficient, of_E, of_rho
   use beamid_unknowns, only: stage_t
   implicit none
   private

   public :: add_fixed_parameters

contains

   !> Adds the errors of the fixed parameters to a fit, whose parameters then no longer count as
   !> determined. Does nothing if the fit has estimated every parameter of its stage.
   !>
   !> stage  as in the case file, before the start search fixed parameters
   !> fit    of this stage; on return with further entries of `held`
   subroutine add_fixed_parameters(model, mesh, experiments, stage, fit)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_t), intent(in) :: stage
      type(stage_fit_t), intent(inout) :: fit
      type(held_t) :: one
      integer :: k, owners(size(stage%free)), stated(size(stage%free))

      if (fit%statistics%samples == 0 .or. size(fit%free) == 0) return
      owners = stage%owners()
      stated = 0
      if (allocated(fit%priors)) stated = priors_of(fit%priors, stage%free, owners)
      do k = 1, size(stage%free)
         associate (p => stage%free(k), r => owners(k))
            if (any(fit%free == p .and. (r == 0 .or. &
               fit%quantities(:size(fit%free))%record == r))) cycle
            ! Positions are taken as exact, and a field has no single value.
            if (is_coefficient(p) .or. parameters(p)%range == on_beam) cycle
            fit%statistics%determined = .false.
            if (stated(k) > 0) cycle
            one%name = name_of_parameter(fit%scenario%structures(1), p)
            one%record = r
            call vary(model, mesh, experiments, fit, p, r, one)
            if (.not. allocated(fit%held)) allocate (fit%held(0))
            fit%held = [fit%held, one]
         end associate
      end do
   end subroutine add_fixed_parameters

   !> Computes the effect of one fixed parameter on the estimates by fits at both ends of its range.
   !>
   !> record  number of the record that the parameter belongs to; 0: all records
   !> one     on return with the effect as a standard deviation; unlimited if a fit fails
   subroutine vary(model, mesh, experiments, fit, parameter, record, one)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: parameter, record
      type(held_t), intent(inout) :: one
      type(model_t) :: moved
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      real(wp) :: ends(2), value
      integer :: n, side

      n = size(fit%free)
      value = fit%scenario%get(parameter, record)
      one%is_assumed = .true.
      one%value = value
      one%factor = 3
      if (parameter == of_E) one%factor = 1.3_wp
      if (parameter == of_rho) one%factor = 1.2_wp
      ends = [value/one%factor, value*one%factor]
      if (parameter == of_E) ends(1) = 0.7_wp*value
      ! The range of a parameter that is 0 extends to a moderate value.
      if (.not. abs(value) > 0) ends = [0.0_wp, fit%scenario%magnitude_of(parameter, record)]
      one%sd = (ends(2) - ends(1))/(2*normal_quantile(0.975_wp))
      if (allocated(one%effect)) deallocate (one%effect)
      allocate (one%effect(size(fit%quantities)), source=0.0_wp)
      do side = 1, 2
         if (abs(ends(side) - value) <= 0) cycle
         moved = model
         call set_free(moved%structure, moved%excitation, parameter, ends(side))
         stage = fit%again()
         stage%automatic = .true.
         stage%is_whole = .true.
         call run_stages(moved, mesh, [stage], experiments, fits, error, check=.false.)
         if (.not. allocated(error)) then
            if (size(fits(1)%free) == n) then
               one%effect(:n) = max(one%effect(:n), abs(fits(1)%fit%estimate(:n) - &
                  fit%fit%estimate))
               cycle
            end if
         end if
         one%effect(:n) = unlimited
      end do
      where (one%effect < unlimited) one%effect = one%effect/normal_quantile(0.975_wp)
   end subroutine vary

end module beamid_fixed_parameters
