!> The solver `modal`: the response as a sum of exponentials, exact in time, with exact derivatives.
!>
!> The flow is: modes of the bare beam (once per mesh), the equations in these modes
!> (`beamid_assembly`), their poles and residues (`beamid_tracked_poles`), and the motion under a
!> force (`beamid_synthesis`).
module beamid_modal
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_assembly, only: assembly_t
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_free_motion, only: find_free_modes, free_mode_t
   use beamid_galerkin, only: galerkin_t
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_pole_search, only: few_oscillators
   use beamid_poles, only: poles_t
   use beamid_quasi_static, only: slowest_unseen
   use beamid_responses, only: exact_solver_t, of_tilt, work_t
   use beamid_structure, only: of_g, of_length, structure_t
   use beamid_structure_checks, only: check_causal
   use beamid_synthesis, only: synthesize
   use beamid_terms, only: tilting
   use beamid_tracked_poles, only: tracked_poles_t
   use beamid_transfer_lines, only: transfer_along
   implicit none
   private

   public :: modal_t

   !> The solver. It keeps the poles of the last structure, which are the start of the next search.
   type, extends(exact_solver_t) :: modal_t
      type(tracked_poles_t), private :: last = tracked_poles_t()
   contains
      procedure :: prepare, motions, free_modes, lowest_roots, transfer, stay_here
   end type modal_t

contains

   !> Prepares the solver for a mesh.
   !>
   !> galerkin  integrals of the mesh
   subroutine prepare(self, galerkin, error)
      class(modal_t), intent(inout) :: self
      type(galerkin_t), intent(in) :: galerkin
      type(error_t), allocatable, intent(out) :: error

      call self%last%prepare(galerkin, error)
   end subroutine prepare

   !> Starts all further searches from the roots of the last structure, and from where their
   !> derivatives predict them.
   subroutine stay_here(self)
      class(modal_t), intent(inout) :: self

      call self%last%stay_here()
   end subroutine stay_here

   !> Computes motions of the sensor and their derivatives; arguments as in `beamid_responses`.
   subroutine motions(self, equations, excitation, times, which, parameters, motion, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: which(:), parameters(:)
      real(wp), intent(out) :: motion(:, 0:, :)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: rate
      integer :: n

      call check_causal(equations%structure, parameters, error)
      rate = huge(rate)
      if (equations%galerkin%space%n >= few_oscillators) rate = slowest_unseen(excitation, times)
      if (.not. allocated(error)) call self%last%solve(equations, excitation, parameters, work, &
         error, rate, 0)
      if (allocated(error)) return
      n = count(which /= of_tilt)
      call synthesize(self%last%poles, excitation, times, which(:n), motion(:, :, :n))
      if (n < size(which)) call find_tilt(self, equations, excitation, times, parameters, &
         motion(:, :, n + 1))
      call check_interrupt(error)
      if (allocated(error)) return
      if (.not. all(ieee_is_finite(motion(:, 0, :)))) &
         call failure(error, 'modal: the response is not finite')
   end subroutine motions

   !> Computes the reading of the sensor due to gravity, which is proportional to its slope, and the
   !> derivatives of the reading.
   !>
   !> parameters  numbers of the parameters
   !> motion      (times, 0:parameters) column 0 is the reading itself; 0 without gravity
   subroutine find_tilt(self, equations, excitation, times, parameters, motion)
      type(modal_t), intent(in) :: self
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: parameters(:)
      real(wp), intent(out) :: motion(:, 0:)
      real(wp), allocatable :: slopes(:, :, :)
      integer :: p

      motion = 0
      if (.not. (equations%structure%g > 0 .or. any(parameters == of_g))) return
      allocate (slopes(size(times), 0:size(parameters), 1))
      call synthesize(self%last%tilt_poles, excitation, times, [1], slopes)
      motion = tilt_factor(equations)*slopes(:, :, 1)
      do p = 1, size(parameters)
         motion(:, p) = motion(:, p) + tilt_factor(equations, parameters(p))*slopes(:, 0, 1)
      end do
   end subroutine find_tilt

   !> Returns the reading of a tilted sensor per unit slope on the mesh, or its derivative with
   !> respect to a parameter.
   pure real(wp) function tilt_factor(equations, parameter) result(factor)
      type(equations_t), intent(in) :: equations
      integer, intent(in), optional :: parameter
      type(structure_t) :: unit

      associate (s => equations%structure)
         factor = tilting(s)*equations%galerkin%space%length/s%length
         if (.not. present(parameter)) return
         select case (parameter)
         case (of_g)
            unit = s
            unit%g = 1
            factor = tilting(unit)*equations%galerkin%space%length/s%length
         case (of_length)
            factor = -factor/s%length
         case default
            factor = 0
         end select
      end associate
   end function tilt_factor

   !> Computes the transfer function; arguments as in `beamid_responses`. It needs no roots, and
   !> holds for every structure with bending stiffness and every point.
   subroutine transfer(self, equations, s, tilts, parameters, h, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      complex(wp), intent(in) :: s(:)
      logical, intent(in) :: tilts
      integer, intent(in) :: parameters(:)
      complex(wp), intent(out) :: h(:, 0:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: assembly
      complex(wp), allocatable :: slope(:, :)
      integer :: p

      call self%last%assemble_checked(equations, parameters, assembly, work, error)
      if (allocated(error)) return
      if (.not. assembly%oscillators%E > tiny(1.0_wp)) then
         call failure(error, 'modal: found a beam without bending stiffness, expected E above 0')
         return
      end if
      call transfer_along(assembly, s, h)
      if (tilts .and. assembly%layout%tilt_row > 0) then
         allocate (slope, mold=h)
         assembly%layout%sensor = assembly%layout%tilt_row
         call transfer_along(assembly, s, slope)
         do p = 0, size(parameters)
            h(:, p) = h(:, p) + tilt_factor(equations)*slope(:, p)/s**2
            if (p > 0) h(:, p) = h(:, p) + tilt_factor(equations, parameters(p))*slope(:, 0)/s**2
         end do
      end if
      call check_interrupt(error)
      if (allocated(error)) return
      if (.not. all(ieee_is_finite(real(h(:, 0))) .and. ieee_is_finite(aimag(h(:, 0))))) &
         call failure(error, 'modal: the transfer function is not finite')
   end subroutine transfer

   !> Computes the lowest modes that oscillate; arguments as in `beamid_responses`.
   subroutine free_modes(self, equations, parameters, wanted, modes, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: parameters(:), wanted
      type(free_mode_t), allocatable, intent(out) :: modes(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(poles_t), allocatable :: lossy

      call self%last%solve_lowest(equations, parameters, wanted, lossy, work, error)
      if (allocated(error)) return
      if (allocated(lossy)) then
         call find_free_modes(lossy, wanted, modes, error)
      else
         call find_free_modes(self%last%poles, wanted, modes, error)
      end if
   end subroutine free_modes

   !> Computes the lowest roots, one of each complex pair. Modes that oscillate come first; if there
   !> are too few, real roots follow. Real roots of overdamped modes crowd near -E/c_D, below many
   !> modes that oscillate.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> wanted      number of roots
   !> s           roots of either kind in ascending order of |s|; as many as wanted, or as there are
   !>             [1/time]
   !> ds          (roots, parameters)
   !> together    (roots) whether the root nearly coincides with another; `ds` is then the
   !>             derivative of the mean of these roots
   subroutine lowest_roots(self, equations, parameters, wanted, s, ds, together, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: parameters(:), wanted
      complex(wp), allocatable, intent(out) :: s(:), ds(:, :)
      logical, allocatable, intent(out) :: together(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(poles_t), allocatable :: lossy

      call self%last%solve_lowest(equations, parameters, wanted, lossy, work, error)
      if (allocated(error)) return
      if (allocated(lossy)) then
         call select_lowest(lossy)
      else
         call select_lowest(self%last%poles)
      end if

   contains

      !> Selects the roots that `lowest_roots` returns.
      subroutine select_lowest(poles)
         type(poles_t), intent(in) :: poles
         logical :: waiting(size(poles%s))
         integer :: k, next

         ! Relaxations are no modes.
         waiting = poles%root%side <= 2
         allocate (s(min(wanted, count(waiting))))
         allocate (ds(size(s), size(parameters)), together(size(s)))
         do k = 1, size(s)
            next = minloc(abs(poles%s), dim=1, mask=waiting .and. aimag(poles%s) > 0)
            if (next == 0) next = minloc(abs(poles%s), dim=1, mask=waiting)
            waiting(next) = .false.
            s(k) = poles%s(next)
            ds(k, :) = poles%ds(next, :)
            together(k) = any(poles%cluster%holds(s(k)))
         end do
      end subroutine select_lowest

   end subroutine lowest_roots

end module beamid_modal
