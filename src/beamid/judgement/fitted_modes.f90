!> Modes of a fitted structure, with intervals of frequency and damping ratio that follow from the
!> errors of its parameters by linear theory.
module beamid_fitted_modes
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_parameters, only: amplitude
   use beamid_responses, only: work_t
   use beamid_statistics, only: unlimited
   implicit none
   private

   public :: fitted_mode_t, fitted_modes

   !> A mode with the half widths of its 95 % intervals, `unlimited` where there is no interval. A
   !> real root, which decays without oscillating, counts as a mode of its own.
   type :: fitted_mode_t
      integer :: record = 1                 !< record whose structure has the mode
      complex(wp) :: s = 0                  !< root [1/time]
      !> whether the root belongs to a cluster: it has no derivative and no interval by itself
      logical :: together = .false.
      real(wp) :: frequency = 0             !< |s|/(2 pi) [1/time]
      real(wp) :: damping_ratio = 0         !< -Re(s)/|s|
      real(wp) :: frequency_half_width = 0  !< [1/time]
      real(wp) :: damping_half_width = 0    !< of the damping ratio
   contains
      procedure, private :: add_error
   end type fitted_mode_t

contains

   !> Computes the lowest modes of each record's structure, the oscillating ones first.
   !>
   !> If the residuals are not white, the half widths grow by the largest factor by which those of
   !> the parameters do.
   !>
   !> count  number of modes for each record; the mesh may have fewer
   !> modes  of all records, record by record
   !> error  roots that cannot be found
   !> finer  a finer mesh; the half widths then include the error of the mesh
   subroutine fitted_modes(mesh, fit, count, modes, error, finer)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: count
      type(fitted_mode_t), allocatable, intent(out) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      type(mesh_t), intent(in), optional :: finer
      complex(wp), allocatable :: s(:), ds(:, :), exact(:), ignored(:, :)
      logical, allocatable :: together(:), exact_together(:)
      integer :: k, n, r

      allocate (modes(0))
      n = size(fit%free)
      do r = 1, size(fit%scenario%structures)
         call roots_on(mesh, fit, r, count, s, ds, together, error)
         if (allocated(error)) return
         do k = 1, size(s)
            modes = [modes, fitted_mode(fit, r, s(k), ds(k, :), together(k))]
         end do
         if (.not. present(finer)) cycle
         call roots_on(finer, fit, r, size(s), exact, ignored, exact_together, error)
         if (allocated(error)) return
         do k = 1, min(size(s), size(exact))
            associate (mode => modes(size(modes) - size(s) + k))
               ! On the finer mesh the estimates would be others.
               if (allocated(fit%mesh_shift)) exact(k) = exact(k) &
                  + sum(ds(k, :n)*fit%mesh_shift(:n), mask=acting(fit, r))
               call mode%add_error(exact(k))
            end associate
         end do
      end do
   end subroutine fitted_modes

   !> Computes the lowest roots of the structure of a record on a mesh, and their derivatives.
   !>
   !> s, ds, together  as in `lowest_roots` of the solver `modal`
   subroutine roots_on(mesh, fit, record, count, s, ds, together, error)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: record, count
      complex(wp), allocatable, intent(out) :: s(:), ds(:, :)
      logical, allocatable, intent(out) :: together(:)
      type(error_t), allocatable, intent(out) :: error
      type(modal_t) :: solver
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(work_t) :: work

      associate (structure => fit%scenario%structures(record))
         galerkin = galerkin_of(mesh, structure, moving=fit%free)
         call solver%prepare(galerkin, error)
         if (allocated(error)) return
         equations = new_equations(galerkin, structure, new_pulse(0.0_wp, 1.0_wp))
         call solver%lowest_roots(equations, fit%free, min(count, galerkin%space%n), s, ds, &
            together, work, error)
      end associate
   end subroutine roots_on

   !> Returns which free parameters act on the structure of a record.
   function acting(fit, record) result(acts)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: record
      logical :: acts(size(fit%free))

      associate (owner => fit%quantities(:size(fit%free))%record)
         acts = (owner == 0 .or. owner == record) .and. fit%free /= amplitude
      end associate
   end function acting

   !> Adds the distance to a root on a finer mesh to the half widths, and a tenth of it for the
   !> error of the finer mesh.
   subroutine add_error(self, exact)
      class(fitted_mode_t), intent(inout) :: self
      complex(wp), intent(in) :: exact
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp), more = 1.1_wp

      if (self%frequency_half_width < unlimited) self%frequency_half_width = &
         self%frequency_half_width + more*abs(abs(exact)/two_pi - self%frequency)
      if (self%damping_half_width < unlimited .and. abs(exact) > 0) self%damping_half_width = &
         self%damping_half_width + more*abs(real(exact)/abs(exact) + self%damping_ratio)
   end subroutine add_error

   !> Returns a mode with its intervals.
   !>
   !> record    number of the record
   !> s         root [1/time]
   !> ds        (free) derivatives of the root with respect to the free parameters
   !> together  whether the root belongs to a cluster
   function fitted_mode(fit, record, s, ds, together) result(mode)
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: record
      complex(wp), intent(in) :: s, ds(:)
      logical, intent(in) :: together
      type(fitted_mode_t) :: mode
      real(wp), dimension(size(ds)) :: modulus_derivative, damping_derivative
      logical :: acts(size(ds))   ! whether the parameter acts on this record's structure
      real(wp) :: scale, t
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
      integer :: n

      n = size(ds)
      mode%record = record
      mode%s = s
      mode%together = together
      mode%frequency = abs(s)/two_pi
      mode%damping_ratio = -real(s)/abs(s)
      mode%frequency_half_width = unlimited
      mode%damping_half_width = unlimited
      if (fit%statistics%samples == 0 .or. together) return
      associate (statistics => fit%statistics)
         ! An infinite standard error, or one whose square would overflow.
         if (any(statistics%std_error(:n) >= sqrt(unlimited)*epsilon(1.0_wp))) return
         scale = 1
         if (.not. fit%check%white) scale = max(scale, maxval(statistics%corrected_half_width(:n) &
            /max(statistics%half_width(:n), tiny(1.0_wp)), mask=.not. statistics%disputed(:n)))
         t = scale*statistics%quantile
         acts = acting(fit, record)
         modulus_derivative = merge(real(conjg(s)*ds)/abs(s), 0.0_wp, acts)
         damping_derivative = merge(-real(ds)/abs(s), 0.0_wp, acts) &
            + real(s)*modulus_derivative/abs(s)**2
         mode%frequency_half_width = t*deviation(modulus_derivative/two_pi)
         if (abs(aimag(s)) > 0) mode%damping_half_width = t*deviation(damping_derivative)
      end associate

   contains

      !> Returns the standard deviation of the linear combination g of the free parameters.
      real(wp) function deviation(g)
         real(wp), intent(in) :: g(:)

         deviation = sqrt(max(0.0_wp, dot_product(g, matmul(fit%statistics%covariance(:n, :n), g))))
      end function deviation

   end function fitted_mode

end module beamid_fitted_modes
