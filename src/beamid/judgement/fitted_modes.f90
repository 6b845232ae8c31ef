!> Modes of a fitted structure, with intervals of frequency and damping ratio that follow from the
!> errors of its parameters by linear theory.
module beamid_fitted_modes
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_identification, only: stage_fit_t
   use beamid_kinds, only: two_pi, wp
   use beamid_modal, only: modal_t
   use beamid_parameters, only: amplitude
   use beamid_responses, only: work_t
   use beamid_statistics, only: unlimited
   implicit none
   private

   public :: fitted_mode_t, fitted_modes, mode_finder_t, new_mode_finder

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
      !> change of the root if the estimates shift as a finer mesh would shift them
      complex(wp), private :: shift = 0
   contains
      procedure, private :: add_error
   end type fitted_mode_t

   !> Finds the modes of fits that differ in the values of their parameters alone, each from those
   !> of the fit before.
   type :: mode_finder_t
      private
      type(galerkin_t), allocatable :: galerkin(:)   !< (records)
      type(modal_t), allocatable :: solver(:)        !< (records)
   contains
      procedure :: find
   end type mode_finder_t

contains

   !> Computes the lowest modes of each record's structure. Arguments as of `new_mode_finder` and
   !> `find`.
   !>
   !> finer  a finer mesh; the half widths then include the error of the mesh
   subroutine fitted_modes(mesh, fit, count, modes, error, finer)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: count
      type(fitted_mode_t), allocatable, intent(out) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      type(mesh_t), intent(in), optional :: finer
      type(mode_finder_t) :: finder, finer_finder
      type(fitted_mode_t), allocatable :: exact(:)
      integer, allocatable :: here(:), there(:)
      integer :: j, k, r

      call new_mode_finder(mesh, fit, finder, error)
      if (.not. allocated(error)) call finder%find(fit, count, modes, error)
      if (.not. allocated(modes)) allocate (modes(0))
      if (allocated(error) .or. .not. present(finer)) return
      call new_mode_finder(finer, fit, finer_finder, error)
      if (.not. allocated(error)) call finer_finder%find(fit, count, exact, error)
      if (allocated(error)) return
      do r = 1, size(fit%scenario%structures)
         here = pack([(k, k=1, size(modes))], modes%record == r)
         there = pack([(k, k=1, size(exact))], exact%record == r)
         do j = 1, min(size(here), size(there))
            call modes(here(j))%add_error(exact(there(j))%s + modes(here(j))%shift)
         end do
      end do
   end subroutine fitted_modes

   !> Adds the distance to a root on a finer mesh to the half widths, and a tenth of it for the
   !> error of the finer mesh.
   subroutine add_error(self, exact)
      class(fitted_mode_t), intent(inout) :: self
      complex(wp), intent(in) :: exact
      real(wp), parameter :: more = 1.1_wp

      if (self%frequency_half_width < unlimited) self%frequency_half_width = &
         self%frequency_half_width + more*abs(abs(exact)/two_pi - self%frequency)
      if (self%damping_half_width < unlimited .and. abs(exact) > 0) self%damping_half_width = &
         self%damping_half_width + more*abs(real(exact)/abs(exact) + self%damping_ratio)
   end subroutine add_error

   !> Prepares the meshes of the structures of a fit.
   !>
   !> error  a mesh without modes
   subroutine new_mode_finder(mesh, fit, finder, error)
      type(mesh_t), intent(in) :: mesh
      type(stage_fit_t), intent(in) :: fit
      type(mode_finder_t), intent(out) :: finder
      type(error_t), allocatable, intent(out) :: error
      integer :: r

      associate (structures => fit%scenario%structures)
         allocate (finder%galerkin(size(structures)), finder%solver(size(structures)))
         do r = 1, size(structures)
            finder%galerkin(r) = galerkin_of(mesh, structures(r), moving=fit%free)
            call finder%solver(r)%prepare(finder%galerkin(r), error)
            if (allocated(error)) return
         end do
      end associate
   end subroutine new_mode_finder

   !> Computes the lowest modes of each record's structure, the oscillating ones first.
   !>
   !> If the residuals are not white, the half widths grow by the largest factor by which those of
   !> the parameters do.
   !>
   !> count  number of modes for each record; the mesh may have fewer
   !> modes  of all records, record by record
   !> error  roots that cannot be found
   subroutine find(self, fit, count, modes, error)
      class(mode_finder_t), intent(inout), target :: self
      type(stage_fit_t), intent(in) :: fit
      integer, intent(in) :: count
      type(fitted_mode_t), allocatable, intent(out) :: modes(:)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations
      type(work_t) :: work
      complex(wp), allocatable :: s(:), ds(:, :)
      integer, allocatable :: free(:)
      logical, allocatable :: together(:)
      integer :: k, r

      allocate (modes(0), free(0))
      if (fit%statistics%samples > 0) free = fit%free
      do r = 1, size(self%solver)
         equations = new_equations(self%galerkin(r), fit%scenario%structures(r), &
            matrices=.false.)
         call self%solver(r)%lowest_roots(equations, free, min(count, &
            self%galerkin(r)%space%n), s, ds, together, work, error)
         if (allocated(error)) return
         do k = 1, size(s)
            modes = [modes, fitted_mode(fit, r, s(k), ds(k, :), together(k))]
         end do
      end do
   end subroutine find

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
         associate (owner => fit%quantities(:n)%record)
            acts = (owner == 0 .or. owner == record) .and. fit%free /= amplitude
         end associate
         if (allocated(fit%mesh_shift)) mode%shift = sum(ds*fit%mesh_shift(:n), mask=acts)
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
