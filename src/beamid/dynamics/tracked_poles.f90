!> The poles of the structure that was solved last. A fit asks for structures that differ little
!> from one another, so that each search starts from the roots found before.
module beamid_tracked_poles
   use beamid_assembly, only: assembly_t, load_t, new_assembly
   use beamid_continuation, only: coincides, follow_loss
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_galerkin, only: alone, galerkin_t, mesh_t, same_mesh
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t, buckled
   use beamid_pole_derivatives, only: differentiate_poles, differentiate_roots
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: find_residues, poles_t
   use beamid_responses, only: work_t
   use beamid_splines, only: same_space
   use beamid_strings, only: to_text
   use beamid_structure, only: same_structure
   use beamid_structure_checks, only: check_axial_load
   use beamid_transfer_lines, only: transfer_along
   implicit none
   private

   public :: assemble, tracked_poles_t

   !> The equations of the last structure and their poles.
   type :: tracked_poles_t
      type(poles_t) :: poles = poles_t()         !< poles of the last structure
      !> the same poles, observed at the slope of the sensor; allocated if there is gravity
      type(poles_t), allocatable :: tilt_poles
      type(beam_modes_t), allocatable, private :: modes   !< modes of the bare beam
      !> the mesh for which the modes are computed
      type(mesh_t), private :: mesh = mesh_t()
      !> equations of the last structure
      type(assembly_t), allocatable, private :: assembly
      logical, private :: is_known = .false.   !< whether `poles` are those of `assembly`
      !> kind of load of `assembly`: a distributed force, a base that moves
      logical, private :: distributed = .false., base = .false.
      !> power of the distributed force of `assembly`
      real(wp), private :: power = 0
      !> poles of `stay_here`, from which every search starts; not allocated: a search starts from
      !> those of the last structure
      type(poles_t), allocatable, private :: first
   contains
      procedure :: prepare, stay_here, solve, solve_lowest, assemble_checked
   end type tracked_poles_t

contains

   !> Computes the modes of the bare beam for a mesh, and forgets the poles.
   !>
   !> galerkin  integrals of the mesh
   subroutine prepare(self, galerkin, error)
      class(tracked_poles_t), intent(inout) :: self
      type(galerkin_t), intent(in) :: galerkin
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%modes)) deallocate (self%modes)
      allocate (self%modes)
      call bare_beam_modes(galerkin, self%modes, error)
      self%mesh = galerkin%mesh
      if (allocated(self%assembly)) deallocate (self%assembly)
      self%is_known = .false.
      if (allocated(self%first)) deallocate (self%first)
   end subroutine prepare

   !> Starts all further searches from the roots of the last structure, and from where their
   !> derivatives predict them.
   subroutine stay_here(self)
      class(tracked_poles_t), intent(inout) :: self

      if (self%is_known .and. allocated(self%poles%values)) self%first = self%poles
   end subroutine stay_here

   !> Computes the poles of a structure without structural damping and their derivatives, unless the
   !> last call computed them.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> error       the solver is not prepared for this mesh, the beam buckles, or the search for the
   !>             roots fails
   !> rate        poles that decay faster may be left out [1/time]
   !> modes       number of the lowest modes that are wanted besides
   recursive subroutine solve(self, equations, excitation, parameters, work, error, rate, modes)
      class(tracked_poles_t), intent(inout) :: self
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: parameters(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in) :: rate
      integer, intent(in) :: modes
      type(equations_t), allocatable :: elastic
      integer, allocatable :: rows(:)
      logical :: is_known, differentiated
      integer :: sensor

      if (equations%structure%eta > 0) then
         elastic = equations
         elastic%structure%eta = 0
         call self%solve(elastic, excitation, parameters, work, error, rate, modes)
         return
      end if
      call check_prepared(self, equations, work, error)
      if (allocated(error)) return
      is_known = self%is_known
      if (is_known) is_known = has_load(self, excitation) .and. &
         same_structure(self%assembly%given%structure, equations%structure)
      differentiated = is_known
      if (differentiated) differentiated = size(parameters) == size(self%assembly%given%parameters)
      if (differentiated) differentiated = all(parameters == self%assembly%given%parameters)
      if (.not. differentiated) then
         if (allocated(self%assembly)) rows = self%assembly%layout%row
         call move_to(self, equations, excitation, parameters)
         ! A parameter may add a row, which the poles are observed by.
         if (is_known) is_known = all(self%assembly%layout%row == rows)
      end if
      if (self%poles%rate < rate .or. self%poles%modes < modes .or. .not. is_known) then
         call update_poles(self, rate, modes, error)
         if (allocated(error)) return
      else if (differentiated) then
         ! If only the history of the force has changed, the derivatives remain valid.
         return
      end if
      self%is_known = .true.
      associate (assembly => self%assembly)
         call differentiate_poles(assembly, self%poles)
         call set_static(assembly, self%poles)
         if (assembly%layout%tilt_row == 0) return
         sensor = assembly%layout%sensor
         assembly%layout%sensor = assembly%layout%tilt_row
         call differentiate_poles(assembly, self%tilt_poles)
         call set_static(assembly, self%tilt_poles)
         assembly%layout%sensor = sensor
      end associate
   end subroutine solve

   !> Computes the poles of a structure without an excitation, and the lowest modes that oscillate
   !> with structural damping.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> wanted      number of modes
   !> lossy       poles with structural damping, as `add_loss` sets them; not allocated: there is
   !>             none, and `poles` holds the modes
   !> error       as of `solve` and `add_loss`
   subroutine solve_lowest(self, equations, parameters, wanted, lossy, work, error)
      class(tracked_poles_t), intent(inout) :: self
      type(equations_t), intent(in) :: equations
      integer, intent(in) :: parameters(:), wanted
      type(poles_t), allocatable, intent(out) :: lossy
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error

      associate (has_loss => equations%structure%eta > 0)
         call self%solve(equations, new_pulse(0.0_wp, 1.0_wp), parameters, work, error, 0.0_wp, &
            merge(huge(1), wanted, has_loss))
         if (allocated(error) .or. .not. has_loss) return
      end associate
      allocate (lossy)
      call add_loss(self, equations, parameters, wanted, lossy, work, error)
   end subroutine solve_lowest

   !> Assembles the equations of a structure under a load; arguments as of `solve`.
   subroutine move_to(self, equations, excitation, parameters)
      type(tracked_poles_t), intent(inout) :: self
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: parameters(:)
      logical :: done

      self%is_known = .false.
      done = allocated(self%assembly) .and. .not. excitation%is_base
      if (done) done = has_load(self, excitation)
      if (done) call self%assembly%renew(equations%structure, parameters, done)
      if (done) return
      if (.not. allocated(self%assembly)) allocate (self%assembly)
      call assemble(self%modes, equations, excitation, parameters, self%assembly)
      self%distributed = excitation%distributed
      self%base = excitation%is_base
      self%power = excitation%power
   end subroutine move_to

   !> Returns whether the load of `assembly` is that of an excitation.
   pure logical function has_load(self, excitation)
      type(tracked_poles_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation

      has_load = (self%distributed .eqv. excitation%distributed) .and. &
         (self%base .eqv. excitation%is_base) .and. abs(self%power - excitation%power) <= 0
   end function has_load

   !> Sets the transfer function at s = 0 and its derivative, unless all poles are there.
   subroutine set_static(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      complex(wp) :: h(1, 0:size(assembly%given%parameters))
      real(wp) :: step

      if (poles%has_all()) return
      ! For a step so small, the imaginary part is the derivative to all digits.
      step = 1e-30_wp*minval(abs(poles%s))
      call transfer_along(assembly, [cmplx(0.0_wp, step, wp)], h)
      if (allocated(poles%static)) deallocate (poles%static)
      allocate (poles%static(2, 0:size(assembly%given%parameters)))
      poles%static(1, :) = real(h(1, :))
      poles%static(2, :) = aimag(h(1, :))/step
   end subroutine set_static

   !> Adds structural damping to the poles of `solve`, for the lowest modes that oscillate.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> wanted      number of modes
   !> poles       `root`, `s` and `ds` of these modes with damping, no clusters, everything else
   !>             without damping
   !> error       a mode was not found, or two modes coincide
   subroutine add_loss(self, equations, parameters, wanted, poles, work, error)
      type(tracked_poles_t), intent(in) :: self
      type(equations_t), intent(in) :: equations
      integer, intent(in) :: parameters(:), wanted
      type(poles_t), intent(out) :: poles
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: assembly
      complex(wp) :: dr(size(self%poles%s), size(parameters))
      logical, dimension(size(self%poles%s)) :: done, waiting
      integer :: k, mode

      call self%assemble_checked(equations, parameters, assembly, work, error)
      if (allocated(error)) return
      poles = self%poles
      ! With damping, each mode stands for itself.
      poles%cluster = poles%cluster(:0)
      done = .false.
      waiting = aimag(poles%s) > 0
      do mode = 1, min(wanted, count(waiting))
         k = minloc(abs(self%poles%s), dim=1, mask=waiting)
         waiting(k) = .false.
         call follow_loss(assembly, poles%root(k), poles%vector(k), error)
         if (allocated(error)) return
         if (coincides(poles%root(k), poles%root, done)) then
            call failure(error, 'modal: found two modes near |s| = '//to_text(abs(poles%s(k)))// &
               ' that cannot be told apart, expected separate modes beside eta')
            return
         end if
         done(k) = .true.
         poles%s(k) = poles%root(k)%s
      end do
      dr = 0
      call differentiate_roots(assembly, poles%root, poles%vector, done, poles%ds, dr)
   end subroutine add_loss

   !> Assembles the equations of a structure in the modes of the mesh, for a force at a point.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> error       as of `check_prepared`
   subroutine assemble_checked(self, equations, parameters, assembly, work, error)
      class(tracked_poles_t), intent(in) :: self
      type(equations_t), intent(in) :: equations
      integer, intent(in) :: parameters(:)
      type(assembly_t), intent(out) :: assembly
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error

      call check_prepared(self, equations, work, error)
      if (.not. allocated(error)) call assemble(self%modes, equations, new_pulse(0.0_wp, 1.0_wp), &
         parameters, assembly)
   end subroutine assemble_checked

   !> Checks that the equations can be assembled, and counts one solution.
   !>
   !> error  interrupted; the solver is not prepared for this mesh; the mesh holds an end that the
   !>        structure does not hold; the beam buckles
   subroutine check_prepared(self, equations, work, error)
      type(tracked_poles_t), intent(in) :: self
      type(equations_t), intent(in) :: equations
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error

      work%solves = work%solves + 1
      call check_interrupt(error)
      if (allocated(error)) return
      if (.not. allocated(self%modes)) then
         call failure(error, 'modal: the modes of the mesh have not been prepared')
         return
      end if
      associate (galerkin => equations%galerkin, space => self%modes%space)
         if (.not. (same_mesh(self%mesh, galerkin%mesh) .and. same_space(space, &
            galerkin%space))) then
            call failure(error, 'modal: prepared for another mesh')
            return
         end if
      end associate
      call equations%check_ends(error)
      if (.not. allocated(error)) call check_axial_load(equations%structure, error)
   end subroutine check_prepared

   !> Finds the poles of the assembly at the sensor, and at the slope of the sensor if it reads
   !> gravity, starting from those of the last structure.
   !>
   !> rate, modes  as of `solve`
   !> error        the search fails, or a root that is real and positive shows that the beam buckles
   subroutine update_poles(self, rate, modes, error)
      type(tracked_poles_t), intent(inout) :: self
      real(wp), intent(in) :: rate
      integer, intent(in) :: modes
      type(error_t), allocatable, intent(out) :: error
      integer :: sensor

      self%is_known = .false.
      if (allocated(self%first)) call self%poles%start_from(self%first)
      associate (assembly => self%assembly)
         call find_poles(assembly, self%poles, error, rate, modes)
         if (allocated(error)) return
         if (assembly%is_dense() .and. any(real(self%poles%s) > 1e-10_wp*maxval(abs( &
            self%poles%s)) .and. .not. abs(aimag(self%poles%s)) > 0)) then
            call failure(error, 'modal: '//buckled)
            return
         end if
         if (assembly%layout%tilt_row > 0) then
            sensor = assembly%layout%sensor
            assembly%layout%sensor = assembly%layout%tilt_row
            if (.not. allocated(self%tilt_poles)) allocate (self%tilt_poles)
            call self%tilt_poles%start_from(self%poles)
            self%tilt_poles%vector = self%poles%vector
            call find_residues(assembly, self%tilt_poles, error)
            assembly%layout%sensor = sensor
            if (allocated(error)) return
         end if
      end associate
   end subroutine update_poles

   !> Assembles the equations in the modes of the bare beam, with the load of an excitation.
   !>
   !> parameters  numbers of the parameters of the slopes
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
         ! The first modes are the motions as a rigid body.
         load%shape(:size(modes%rigid, 2)) = matmul([equations%galerkin%integral( &
            excitation%power, alone), equations%galerkin%integral(excitation%power + 1, alone)], &
            modes%rigid)
      end if
      assembly = new_assembly(equations%structure, modes, parameters, load)
   end subroutine assemble

end module beamid_tracked_poles
