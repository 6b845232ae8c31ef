!> Response as a sum of exponentials, exact in time, with exact derivatives: the structure in the
!> modes of the bare beam, its poles, and the motion that they make of a force.
module beamid_modal
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_assembly, only: assembly_t, load_t, new_assembly
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_free_motion, only: find_free_modes, free_mode_t
   use beamid_galerkin, only: galerkin_t, mesh_t, same_mesh
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t, buckled
   use beamid_poles, only: differentiate_poles, find_poles, observe_also, poles_t
   use beamid_responses, only: exact_solver_t, of_tilt, work_t
   use beamid_structure, only: of_g, of_length, same_structure, structure_t
   use beamid_structure_checks, only: check_axial_load
   use beamid_synthesis, only: synthesize
   use beamid_terms, only: tilting
   implicit none
   private

   public :: modal_t, assemble

   type, extends(exact_solver_t) :: modal_t
      type(beam_modes_t), allocatable, private :: modes   !< of the bare beam
      type(mesh_t), private :: mesh = mesh_t()            !< what it was prepared for
      type(poles_t), private :: poles = poles_t()         !< of the last structure
      !> the same, of the slope at the sensor, where there is gravity
      type(poles_t), private :: turns = poles_t()
      type(structure_t), allocatable, private :: structure   !< that structure
      logical, private :: distributed = .false., base = .false.   !< its load
      real(wp), private :: power = 0
      integer, allocatable, private :: layout(:)          !< rows of the assembly they belong to
   contains
      procedure :: prepare
      procedure :: motions
      procedure :: free_modes
      procedure :: lowest_roots
      procedure, private :: solve
   end type modal_t

contains

   !> Modes of the bare beam: once per mesh.
   subroutine prepare(self, galerkin, error)
      class(modal_t), intent(inout) :: self
      type(galerkin_t), intent(in) :: galerkin
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%modes)) deallocate (self%modes)
      allocate (self%modes)
      call bare_beam_modes(galerkin, self%modes, error)
      self%mesh = galerkin%mesh
      if (allocated(self%structure)) deallocate (self%structure)
   end subroutine prepare

   subroutine motions(self, equations, excitation, times, which, parameters, motion, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: which(:), parameters(:)
      real(wp), intent(out) :: motion(:, 0:, :)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      integer :: n

      call self%solve(equations, excitation, parameters, work, error)
      if (allocated(error)) return
      n = count(which /= of_tilt)
      call synthesize(self%poles, excitation, times, which(:n), motion(:, :, :n))
      if (n < size(which)) call turn(self, equations, excitation, times, parameters, &
         motion(:, :, n + 1))
      call check_interrupt(error)
      if (allocated(error)) return
      if (.not. all(ieee_is_finite(motion(:, 0, :)))) &
         call failure(error, 'modal: the response is not finite')
   end subroutine motions

   !> What the sensor reads of gravity as it turns.
   subroutine turn(self, equations, excitation, times, parameters, motion)
      type(modal_t), intent(in) :: self
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: parameters(:)
      real(wp), intent(out) :: motion(:, 0:)
      real(wp), allocatable :: turns(:, :, :)
      type(structure_t) :: unit
      real(wp) :: shorter
      integer :: p

      motion = 0
      if (.not. (equations%structure%g > 0 .or. any(parameters == of_g))) return
      allocate (turns(size(times), 0:size(parameters), 1))
      call synthesize(self%turns, excitation, times, [1], turns)
      associate (s => equations%structure)
         unit = s
         unit%g = 1
         shorter = equations%galerkin%space%length/s%length
         motion = tilting(s)*shorter*turns(:, :, 1)
         do p = 1, size(parameters)
            if (parameters(p) == of_g) motion(:, p) = motion(:, p) &
               + tilting(unit)*shorter*turns(:, 0, 1)
            if (parameters(p) == of_length) motion(:, p) = motion(:, p) - motion(:, 0)/s%length
         end do
      end associate
   end subroutine turn

   !> Poles of the structure and their derivatives; those of the last structure are kept.
   subroutine solve(self, equations, excitation, parameters, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: parameters(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: assembly, turned
      logical :: same

      work%solves = work%solves + 1
      call check_interrupt(error)
      if (allocated(error)) return
      if (.not. allocated(self%modes)) then
         call failure(error, 'modal: the modes of the mesh have not been prepared')
         return
      else if (.not. same_mesh(self%mesh, equations%galerkin%mesh) .or. &
         self%modes%space%turning /= equations%galerkin%space%turning .or. &
         abs(self%modes%space%length - equations%galerkin%space%length) > 0) then
         call failure(error, 'modal: prepared for another mesh')
         return
      end if
      call check_axial_load(equations%structure, error)
      if (allocated(error)) return
      call assemble(self%modes, equations, excitation, parameters, assembly)
      same = knows(self, equations%structure, excitation, assembly%row)
      if (.not. same) then
         if (allocated(self%structure)) deallocate (self%structure)
         call find_poles(assembly, self%poles, error)
         if (allocated(error)) return
         self%structure = equations%structure
         self%distributed = excitation%distributed
         self%base = excitation%is_base
         self%power = excitation%power
         self%layout = assembly%row
         if (assembly%is_dense() .and. any(real(self%poles%s) > 1e-10_wp*maxval(abs( &
            self%poles%s)) .and. .not. abs(aimag(self%poles%s)) > 0)) then
            call failure(error, 'modal: '//buckled)
            deallocate (self%structure)
            return
         end if
         if (assembly%turn > 0) then
            turned = assembly
            turned%sensor = assembly%turn
            call observe_also(turned, self%poles, self%turns, error)
            if (allocated(error)) deallocate (self%structure)
            if (allocated(error)) return
         end if
      end if
      ! Under another force, as where many are tried, the derivatives are those of before.
      if (same) same = size(self%poles%parameters) == size(parameters)
      if (same) same = all(self%poles%parameters == parameters)
      if (same) return
      call differentiate_poles(assembly, self%poles)
      if (assembly%turn == 0) return
      assembly%sensor = assembly%turn
      call differentiate_poles(assembly, self%turns, also=self%poles)
   end subroutine solve

   !> Whether the poles that are kept are those of a structure under a load.
   pure logical function knows(self, structure, excitation, layout)
      class(modal_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: layout(:)

      knows = allocated(self%structure)
      if (knows) knows = same_structure(self%structure, structure) .and. &
         (self%distributed .eqv. excitation%distributed) .and. &
         (self%base .eqv. excitation%is_base) .and. &
         abs(self%power - excitation%power) <= 0 .and. all(self%layout == layout)
   end function knows

   subroutine free_modes(self, equations, parameters, wanted, modes, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: parameters(:), wanted
      type(free_mode_t), allocatable, intent(out) :: modes(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error

      call self%solve(equations, new_pulse(0.0_wp, 1.0_wp), parameters, work, error)
      if (.not. allocated(error)) call find_free_modes(self%poles, wanted, modes, error)
   end subroutine free_modes

   !> One root of each of the lowest modes that oscillate; where there are too few of them, the
   !> lowest real roots too. Those of overdamped modes crowd near -E/c_D, below many a mode that
   !> oscillates.
   !>
   !> s         ascending |s| of either kind, as many as are wanted or as there are [1/time]
   !> ds        (roots, parameters)
   !> together  whether a root nearly meets another: ds is then that of their mean
   subroutine lowest_roots(self, equations, parameters, wanted, s, ds, together, work, error)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: parameters(:), wanted
      complex(wp), allocatable, intent(out) :: s(:), ds(:, :)
      logical, allocatable, intent(out) :: together(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      logical, allocatable :: waiting(:)
      integer :: k, next

      call self%solve(equations, new_pulse(0.0_wp, 1.0_wp), parameters, work, error)
      if (allocated(error)) return
      associate (poles => self%poles)
         allocate (s(min(wanted, size(poles%s))))
         allocate (ds(size(s), size(parameters)), together(size(s)))
         allocate (waiting(size(poles%s)), source=.true.)
         do k = 1, size(s)
            next = minloc(abs(poles%s), dim=1, mask=waiting .and. aimag(poles%s) > 0)
            if (next == 0) next = minloc(abs(poles%s), dim=1, mask=waiting)
            waiting(next) = .false.
            s(k) = poles%s(next)
            ds(k, :) = poles%ds(next, :)
            together(k) = any(poles%cluster%holds(s(k)))
         end do
      end associate
   end subroutine lowest_roots

   !> The structure in the modes of the bare beam, with its load.
   subroutine assemble(modes, equations, excitation, parameters, assembly)
      type(beam_modes_t), intent(in) :: modes
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: parameters(:)
      type(assembly_t), intent(out) :: assembly
      type(load_t) :: load

      load%base = excitation%is_base
      if (excitation%distributed) then
         load%shape = matmul(equations%shape(:modes%space%n), modes%shapes)   ! (3.10)
         if (modes%turn > 0) load%shape(1) = modes%turn*modes%space%length &
            *equations%galerkin%integral(excitation%power + 1)
      end if
      assembly = new_assembly(equations%structure, modes, parameters, load)
   end subroutine assemble

end module beamid_modal
