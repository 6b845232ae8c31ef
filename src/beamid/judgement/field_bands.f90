!> The estimated fields E(x) and c_D(x) with their 95 % bands, for the reports on a fit.
!>
!> The logarithm of a field is taken as normal, by the delta method from the errors of the estimated
!> quantities, so that the limits of its band are positive. Let g be the derivatives of log E(x)
!> with respect to the n quantities, C their covariance, and h and s the half widths and standard
!> errors of their intervals. The half width of log E(x) is then the root of
!>
!>     g' (h/s C h/s) g + sum over fixed parameters with an error of (sum g h/s effect)**2
!>
!> which is h/E if E alone was estimated.
module beamid_field_bands
   use beamid_distributions, only: normal_quantile
   use beamid_kinds, only: wp
   use beamid_smoothing, only: resolution_length
   use beamid_stage_fits, only: stage_fit_t
   use beamid_statistics, only: unlimited
   use beamid_structure, only: function_of, is_coefficient, of_c_D, of_d_D, of_E, of_w_D, of_x_D, &
      structure_t
   use beamid_variations, only: constant, field_modulus, field_t, known_c_D, known_E
   implicit none
   private

   public :: band, field_band_t, varies

   !> A field at points along the beam; values in the unit of E or c_D.
   type :: field_band_t
      real(wp), allocatable :: x(:)            !< (points) positions from root to tip [length]
      real(wp), allocatable :: start(:)        !< (points) values that the search started from
      real(wp), allocatable :: value(:)        !< (points) estimate
      logical :: is_estimate = .false.         !< whether any parameter of the field was estimated
      !> (points) half width of the 95 % band of log(value); `unlimited` where the record does not
      !> determine the field. Not allocated: nothing was estimated, or no degree of freedom was
      !> left.
      real(wp), allocatable :: half_width(:)
      !> (points) length over which the estimate averages [length], between the spacing of the
      !> coefficients and the length of the beam; not allocated: no penalty
      real(wp), allocatable :: resolution(:)
      real(wp) :: spacing = 0                  !< of the spline coefficients [length]; 0: none
   contains
      procedure :: lower
      procedure :: upper
   end type field_band_t

contains

   !> Returns whether E or c_D varies along the beam.
   !>
   !> a  the field, field_modulus or field_viscosity
   pure logical function varies(structure, a)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: a

      associate (v => structure%variations)
         if (a == field_modulus) then
            varies = v%known(known_E)%kind /= constant .or. structure%has_dip()
         else
            varies = v%known(known_c_D)%kind /= constant
         end if
         varies = varies .or. allocated(v%along(a)%value)
      end associate
   end function varies

   !> Returns E(x) or c_D(x) of the first record with its band, including the known variation.
   !>
   !> a       the field, field_modulus or field_viscosity
   !> points  number of points from root to tip, 2 or more
   function band(fit, a, points)
      class(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: a, points
      type(field_band_t) :: band
      type(structure_t) :: start
      real(wp) :: slope(size(fit%quantities)), xi
      logical :: belongs(size(fit%quantities))   ! to the field
      integer, allocatable :: which(:)
      integer :: k

      start = fit%scenario%structures(1)
      do k = 1, size(fit%quantities)
         associate (q => fit%quantities(k))
            belongs(k) = q%record <= 1 .and. is_part(q%parameter, a)
            if (belongs(k)) call start%set(q%parameter, q%start)
         end associate
      end do
      band%is_estimate = any(belongs)
      allocate (band%x(points), band%start(points), band%value(points))
      if (band%is_estimate .and. fit%statistics%samples > 0) allocate (band%half_width(points))
      ! A loop, because gfortran would pass `quantities%parameter` as an array temporary.
      which = [(fit%quantities(k)%parameter, k=1, size(fit%quantities))]
      do k = 1, points
         xi = (k - 1.0_wp)/(points - 1)
         band%x(k) = xi*fit%scenario%structures(1)%length
         band%value(k) = value_at(fit%scenario%structures(1), a, xi)
         band%start(k) = value_at(start, a, xi)
         if (.not. allocated(band%half_width)) cycle
         slope = 0
         where (belongs) slope = log_derivatives(fit%scenario%structures(1), a, xi, which)
         band%half_width(k) = log_half_width(fit, slope)
      end do
      call add_resolution(fit, a, band)
   end function band

   !> Returns whether field a depends on a parameter.
   pure logical function is_part(parameter, a)
      integer, intent(in) :: parameter, a

      if (a == field_modulus) then
         is_part = any(parameter == [of_E, of_x_D, of_w_D, of_d_D])
      else
         is_part = parameter == of_c_D
      end if
      is_part = is_part .or. function_of(parameter) == a
   end function is_part

   !> Returns the value of field a at xi = x/l.
   pure real(wp) function value_at(structure, a, xi)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: a
      real(wp), intent(in) :: xi
      real(wp) :: factors(2)

      factors = structure%factors(xi)
      if (a == field_modulus) then
         value_at = structure%E*structure%variations%known(known_E)%at(xi)*factors(1)
      else
         value_at = structure%c_D*structure%variations%known(known_c_D)%at(xi)*factors(2)
      end if
   end function value_at

   !> Returns the derivatives of the logarithm of field a at xi = x/l with respect to parameters; 0
   !> for parameters that the field does not depend on.
   pure function log_derivatives(structure, a, xi, parameters) result(slopes)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: a, parameters(:)
      real(wp), intent(in) :: xi
      real(wp) :: slopes(size(parameters)), factors(2), by(2, size(parameters))
      integer :: k

      factors = structure%factors(xi)
      by = structure%factor_slopes(xi, parameters)
      slopes = 0
      do k = 1, size(parameters)
         if (.not. is_part(parameters(k), a)) cycle
         slopes(k) = by(a, k)/factors(a)
         ! E and c_D themselves multiply their factors.
         if (.not. any(parameters(k) == [of_E, of_c_D])) cycle
         if (structure%get(parameters(k)) > 0) slopes(k) = slopes(k) &
            + 1/structure%get(parameters(k))
      end do
   end function log_derivatives

   !> Returns the half width of the 95 % band of the logarithm of a field at a point.
   !>
   !> slope  (n) derivatives of the logarithm with respect to the quantities
   pure real(wp) function log_half_width(fit, slope) result(half_width)
      class(stage_fit_t), intent(in) :: fit
      real(wp), intent(in) :: slope(:)
      real(wp) :: g(size(slope))
      integer :: j, n

      half_width = unlimited
      associate (s => fit%statistics)
         if (any(abs(slope) > 0 .and. .not. (s%corrected_half_width < unlimited .and. &
            s%std_error < unlimited))) return
         ! A dip that may not exist leaves E known; a field that is too coarse does not.
         if (any([(abs(slope(j)) > 0 .and. is_coefficient(fit%quantities(j)%parameter) .and. &
            s%is_withdrawn(j), j=1, size(slope))])) return
         g = 0
         where (abs(slope) > 0 .and. s%std_error > 0) g = slope*s%corrected_half_width/s%std_error
         half_width = max(0.0_wp, dot_product(g, matmul(s%covariance, g)))
         if (allocated(fit%held)) then
            do j = 1, size(fit%held)
               n = min(size(slope), size(fit%held(j)%effect))
               half_width = half_width + (normal_quantile(0.975_wp)*dot_product(slope(:n), &
                  fit%held(j)%effect(:n)))**2
            end do
         end if
         half_width = sqrt(half_width)
      end associate
   end function log_half_width

   !> Adds the spacing of the coefficients and the length over which the estimate averages at each
   !> point, from the resolution matrix's row of the nearest coefficient.
   subroutine add_resolution(fit, a, band)
      class(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: a
      type(field_band_t), intent(inout) :: band
      type(field_t) :: along
      real(wp), allocatable :: places(:), row(:)
      integer :: j, k

      along = fit%scenario%structures(1)%variations%along(a)
      if (.not. allocated(along%value)) return
      band%spacing = fit%scenario%structures(1)%length/(along%coefficients - along%degree)
      if (.not. allocated(fit%fields(a)%place)) return
      places = along%places()*fit%scenario%structures(1)%length
      allocate (band%resolution(size(band%x)))
      do k = 1, size(band%x)
         j = minloc(abs(places - band%x(k)), dim=1)
         row = fit%fields(a)%smoothing%resolution(fit%fields(a)%place(j), &
            fit%fields(a)%place)
         band%resolution(k) = min(fit%scenario%structures(1)%length, max(band%spacing, &
            resolution_length(row, band%spacing)))
      end do
   end subroutine add_resolution

   !> Returns the lower end of the band at point k; 0 where the band is unlimited.
   pure real(wp) function lower(self, k)
      class(field_band_t), intent(in) :: self
      integer, intent(in) :: k

      lower = self%value(k)*exp(-min(self%half_width(k), -log(tiny(lower))))
      if (.not. self%half_width(k) < unlimited) lower = 0
   end function lower

   !> Returns the upper end of the band at point k, or `unlimited`.
   pure real(wp) function upper(self, k)
      class(field_band_t), intent(in) :: self
      integer, intent(in) :: k

      upper = 0
      if (.not. self%value(k) > 0) return
      upper = unlimited
      if (.not. self%half_width(k) < unlimited) return
      if (log(self%value(k)) + self%half_width(k) < log(unlimited)) &
         upper = self%value(k)*exp(self%half_width(k))
   end function upper

end module beamid_field_bands
