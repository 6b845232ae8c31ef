!> Dips that do not explain their records, and the region in which E(x) is low instead.
!>
!> The damage of a real beam has another shape than a dip: a cut, a crack, a loose joint. A fit of a
!> dip then leaves residuals above the noise, and its place may be far from the damage. E(x), whose
!> shape is free, may still show where the beam is more flexible than elsewhere.
module beamid_damage_regions
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_field_bands, only: band, field_band_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: run_stages
   use beamid_kinds, only: wp
   use beamid_simulation, only: model_t
   use beamid_sorting, only: median
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: to_text
   use beamid_structure, only: E_at, of_d_D, of_E, of_w_D, of_x_D
   use beamid_unknowns, only: stage_t
   use beamid_variations, only: field_modulus
   use beamid_verdicts, only: verdict_t
   implicit none
   private

   public :: judge_shape_of_dip

   !> Largest ratio of residuals to noise with which a dip may have a place. A dip is located by
   !> small differences, so that this limit is lower than that of other parameters: perfect records
   !> reach 1.05, and cuts that pass for a dip elsewhere leave 3 to 13.
   real(wp), parameter :: gross_for_dip = 2

contains

   !> Withdraws the estimates of a dip if the model with this dip does not explain the records, and
   !> tells where E(x) is low instead. Changes nothing if there is no dip, or if its place is not
   !> determined anyway and the residuals are near the noise.
   !>
   !> verdict  on the fit
   !> fit      on return without intervals of the dip, and with the reason in `other`
   !> missing  a parameter that the model lacks according to a test, after a call without it
   subroutine judge_shape_of_dip(model, mesh, experiments, verdict, fit, missing)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(verdict_t), intent(in) :: verdict
      type(stage_fit_t), intent(inout) :: fit
      character(len=*), intent(in), optional :: missing
      character(len=:), allocatable :: reason
      real(wp), allocatable :: region(:)
      integer :: k

      k = findloc(fit%free, of_x_D, dim=1)
      if (k == 0) return
      call object_to_dip(verdict, fit, reason)
      if (present(missing)) then
         if (reason /= '') return
         reason = 'the records also need '//missing//' as a free parameter'
      end if
      if (reason == '') return
      if (verdict%misfit <= gross_for_dip .and. fit%statistics%is_withdrawn(k)) return
      call find_soft_region(model, mesh, experiments, fit, min(1.0_wp, &
         gross_for_dip/verdict%misfit), region)
      fit%other = 'something is there, but not a dip of this shape: '//reason
      if (size(region) == 2) then
         fit%other = fit%other//'; a smooth E(x) that fits as well is lowest between x = '// &
            to_text(region(1))//' and '//to_text(region(2))
      else
         fit%other = fit%other//'; a smooth E(x) does not locate it either'
      end if
      fit%statistics%determined = .false.
      do k = 1, size(fit%free)
         if (any(fit%free(k) == [of_x_D, of_w_D, of_d_D])) call fit%statistics%withdraw(k)
      end do
   end subroutine judge_shape_of_dip

   !> Describes what shows that a model with a dip does not explain the records.
   !>
   !> reason  '': nothing
   subroutine object_to_dip(verdict, fit, reason)
      type(verdict_t), intent(in) :: verdict
      type(stage_fit_t), intent(in) :: fit
      character(len=:), allocatable, intent(out) :: reason
      real(wp), parameter :: near = 1e-3_wp
      integer :: k

      reason = ''
      if (verdict%misfit > gross_for_dip) then
         reason = 'the residuals are '//to_text(anint(10*verdict%misfit)/10)//' times the noise'
      else if (verdict%departures//verdict%missed /= '') then
         reason = 'the residuals exceed the noise around '//verdict%departures//verdict%missed
      else
         k = findloc(fit%free, of_w_D, dim=1)
         if (k == 0) return
         associate (w => fit%quantities(k))
            if (w%searched < (1 + near)*w%lower) &
               reason = 'the width of the dip is at its lower bound, which the mesh sets'
         end associate
      end if
   end subroutine object_to_dip

   !> Finds the region around the lowest E(x) in which E(x) is at most half way from its median to
   !> its minimum.
   !>
   !> fit     of a stage with a dip; its other parameters are fitted again with E(x)
   !> share   largest residuals with which E(x) explains the records, relative to those of the dip
   !> region  (2) first and last position [length]; of size 0: no such fit converges, E(x) does not
   !>         explain the records either, or its band does not exclude the median
   subroutine find_soft_region(model, mesh, experiments, fit, share, region)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: share
      real(wp), allocatable, intent(out) :: region(:)
      integer, parameter :: coefficients = 16, degree = 3, points = 201
      type(model_t) :: smooth
      type(stage_t) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(error_t), allocatable :: error
      type(field_band_t) :: field
      real(wp) :: limit
      integer :: first, k, last

      allocate (region(0))
      smooth = model
      smooth%structure%w_D = 0
      smooth%structure%d_D = 0
      smooth%structure%variations%along(field_modulus)%coefficients = coefficients
      smooth%structure%variations%along(field_modulus)%degree = degree
      stage = fit%again()
      stage = stage%without([(any(stage%free(k) == [of_E, of_x_D, of_w_D, of_d_D]), &
         k=1, size(stage%free))])
      stage%free = [stage%free, E_at(:coefficients)]
      stage%record = [stage%record, spread(0, 1, coefficients)]
      deallocate (stage%lower, stage%upper)
      call run_stages(smooth, mesh, [stage], experiments, fits, error, check=.false.)
      if (allocated(error)) return
      if (.not. norm2(fits(1)%residual) <= share*norm2(fit%residual)) return
      field = band(fits(1), field_modulus, points)
      k = minloc(field%value, dim=1)
      if (.not. allocated(field%half_width)) return
      if (.not. field%upper(k) < median(field%value)) return
      limit = (median(field%value) + field%value(k))/2
      first = findloc(field%value(:k) > limit, .true., dim=1, back=.true.) + 1
      last = k - 2 + findloc([field%value(k:) > limit, .true.], .true., dim=1)
      deallocate (region)
      region = field%x([first, last])
   end subroutine find_soft_region

end module beamid_damage_regions
