!> The region of a beam in which E(x) is low, for records that a dip cannot explain.
!>
!> The damage of a real beam has another shape than a dip: a cut, a crack, a loose joint. A fit of a
!> dip then leaves residuals far above the noise, and its place may be far from the damage. E(x),
!> whose shape is free, still shows where the beam is more flexible than elsewhere.
module beamid_damage_regions
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_field_bands, only: band, band_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify
   use beamid_kinds, only: wp
   use beamid_simulation, only: model_t
   use beamid_sorting, only: median
   use beamid_stage_fits, only: stage_fit_t
   use beamid_structure, only: E_at, of_d_D, of_E, of_w_D, of_x_D
   use beamid_unknowns, only: stage_t
   use beamid_variations, only: field_modulus
   implicit none
   private

   public :: find_soft_region

contains

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
      type(band_t) :: field
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
      call identify(smooth, mesh, [stage], experiments, fits, error, check=.false.)
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
