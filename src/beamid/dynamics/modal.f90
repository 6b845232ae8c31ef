!> The solver `modal`: the response as a sum of exponentials, exact in time, with exact derivatives.
!>
!> The flow is: modes of the bare beam (once per mesh), the equations in these modes
!> (`beamid_assembly`), their poles and residues (`beamid_pole_search`), and the motion under a
!> force (`beamid_synthesis`).
module beamid_modal
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use beamid_assembly, only: assembly_t, load_t, new_assembly
   use beamid_continuation, only: coincides, follow_loss, loss_beside_relaxation
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_free_motion, only: find_free_modes, free_mode_t
   use beamid_galerkin, only: alone, galerkin_t, mesh_t, same_mesh
   use beamid_interrupts, only: check_interrupt
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t, buckled
   use beamid_pole_derivatives, only: differentiate_poles, differentiate_root
   use beamid_pole_search, only: few_oscillators, find_poles
   use beamid_poles, only: find_residues, poles_t
   use beamid_quasi_static, only: slowest_unseen
   use beamid_responses, only: exact_solver_t, of_tilt, work_t
   use beamid_splines, only: same_space
   use beamid_strings, only: to_text
   use beamid_structure, only: of_g, of_length, same_structure, structure_t
   use beamid_structure_checks, only: check_axial_load, check_causal
   use beamid_synthesis, only: synthesize
   use beamid_terms, only: bending, of_stiffness, tilting
   use beamid_transfer_lines, only: transfer_along
   use beamid_vectors, only: root_t
   implicit none
   private

   public :: modal_t, assemble

   !> The solver. It keeps the poles of the last structure, which are the start of the next search.
   type, extends(exact_solver_t) :: modal_t
      type(beam_modes_t), allocatable, private :: modes   !< modes of the bare beam
      !> the mesh for which the solver is prepared
      type(mesh_t), private :: mesh = mesh_t()
      type(poles_t), private :: poles = poles_t()         !< poles of the last structure
      !> the same poles, observed at the slope of the sensor; only if there is gravity
      type(poles_t), private :: tilt_poles = poles_t()
      !> equations of the last structure
      type(assembly_t), allocatable, private :: assembly
      logical, private :: is_known = .false.   !< whether `poles` are those of `assembly`
      !> kind of load of `assembly`: a distributed force, a base that moves
      logical, private :: distributed = .false., base = .false.
      !> power of the distributed force of `assembly`
      real(wp), private :: power = 0
      !> roots of `stay_here` and their derivatives, from which every search starts; not allocated:
      !> a search starts from those of the last structure
      type(root_t), allocatable, private :: first_root(:), first_all(:)
      complex(wp), allocatable, private :: first_ds(:, :)
      integer, allocatable, private :: first_parameters(:)
      real(wp), allocatable, private :: first_values(:)
      real(wp), private :: first_rate = 0
      integer, private :: first_modes = 0
   contains
      procedure :: prepare, motions, free_modes, lowest_roots, transfer, stay_here
      procedure, private :: solve, add_loss, assemble_checked
   end type modal_t

contains

   !> Computes the modes of the bare beam for a mesh.
   !>
   !> galerkin  integrals of the mesh
   subroutine prepare(self, galerkin, error)
      class(modal_t), intent(inout) :: self
      type(galerkin_t), intent(in) :: galerkin
      type(error_t), allocatable, intent(out) :: error

      if (allocated(self%modes)) deallocate (self%modes)
      allocate (self%modes)
      call bare_beam_modes(galerkin, self%modes, error)
      self%mesh = galerkin%mesh
      if (allocated(self%assembly)) deallocate (self%assembly)
      self%is_known = .false.
      if (allocated(self%first_root)) deallocate (self%first_root)
   end subroutine prepare

   !> Starts all further searches from the roots of the last structure, and from where their
   !> derivatives predict them.
   subroutine stay_here(self)
      class(modal_t), intent(inout) :: self

      if (.not. self%is_known .or. .not. allocated(self%poles%values)) return
      self%first_root = self%poles%root
      self%first_all = self%poles%all
      self%first_ds = self%poles%ds
      self%first_parameters = self%poles%parameters
      self%first_values = self%poles%values
      self%first_rate = self%poles%rate
      self%first_modes = self%poles%modes
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
      if (.not. allocated(error)) call self%solve(equations, excitation, parameters, work, error, &
         rate, 0)
      if (allocated(error)) return
      n = count(which /= of_tilt)
      call synthesize(self%poles, excitation, times, which(:n), motion(:, :, :n))
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
      call synthesize(self%tilt_poles, excitation, times, [1], slopes)
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

   !> Computes the poles of a structure without structural damping and their derivatives, unless the
   !> last call computed them.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> error       the solver is not prepared for this mesh, the beam buckles, or the search for the
   !>             roots fails
   !> rate        poles that decay faster may be left out [1/time]
   !> modes       number of the lowest modes that are wanted besides
   recursive subroutine solve(self, equations, excitation, parameters, work, error, rate, modes)
      class(modal_t), intent(inout) :: self
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
         same_structure(self%assembly%structure, equations%structure)
      differentiated = is_known
      if (differentiated) differentiated = size(parameters) == size(self%assembly%parameters)
      if (differentiated) differentiated = all(parameters == self%assembly%parameters)
      if (.not. differentiated) then
         if (allocated(self%assembly)) rows = self%assembly%row
         call move_to(self, equations, excitation, parameters)
         ! A parameter may add a row, which the poles are observed by.
         if (is_known) is_known = all(self%assembly%row == rows)
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
         if (assembly%tilt_row == 0) return
         sensor = assembly%sensor
         assembly%sensor = assembly%tilt_row
         call differentiate_poles(assembly, self%tilt_poles)
         call set_static(assembly, self%tilt_poles)
         assembly%sensor = sensor
      end associate
   end subroutine solve

   !> Assembles the equations of a structure under a load; arguments as of `solve`.
   subroutine move_to(self, equations, excitation, parameters)
      class(modal_t), intent(inout) :: self
      type(equations_t), intent(in) :: equations
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: parameters(:)
      logical :: done

      self%is_known = .false.
      done = allocated(self%assembly) .and. .not. excitation%is_base
      if (done) done = has_load(self, excitation)
      if (done) call self%assembly%renew(equations%structure, self%modes, parameters, done)
      if (done) return
      if (.not. allocated(self%assembly)) allocate (self%assembly)
      call assemble(self%modes, equations, excitation, parameters, self%assembly)
      self%distributed = excitation%distributed
      self%base = excitation%is_base
      self%power = excitation%power
   end subroutine move_to

   !> Returns whether the load of `assembly` is that of an excitation.
   pure logical function has_load(self, excitation)
      class(modal_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation

      has_load = (self%distributed .eqv. excitation%distributed) .and. &
         (self%base .eqv. excitation%is_base) .and. abs(self%power - excitation%power) <= 0
   end function has_load

   !> Sets the transfer function at s = 0 and its derivative, unless all poles are there.
   subroutine set_static(assembly, poles)
      type(assembly_t), intent(in) :: assembly
      type(poles_t), intent(inout) :: poles
      complex(wp) :: h(1, 0:size(assembly%parameters))
      real(wp) :: step

      if (poles%has_all()) return
      ! For a step so small, the imaginary part is the derivative to all digits.
      step = 1e-30_wp*minval(abs(poles%s))
      call transfer_along(assembly, [cmplx(0.0_wp, step, wp)], h)
      if (allocated(poles%static)) deallocate (poles%static)
      allocate (poles%static(2, 0:size(assembly%parameters)))
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
      class(modal_t), intent(in) :: self
      type(equations_t), intent(in) :: equations
      integer, intent(in) :: parameters(:), wanted
      type(poles_t), intent(out) :: poles
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(assembly_t) :: assembly
      complex(wp), dimension(size(parameters)) :: ds, dr
      logical, dimension(size(self%poles%s)) :: done, waiting
      integer :: k, mode

      call self%assemble_checked(equations, parameters, assembly, work, error)
      if (allocated(error)) return
      if (assembly%relaxation%n > 0) then
         call failure(error, 'modal: '//loss_beside_relaxation)
         return
      end if
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
         call differentiate_root(assembly, poles%root(k), poles%vector(k), ds, dr)
         poles%s(k) = poles%root(k)%s
         poles%ds(k, :) = ds
      end do
   end subroutine add_loss

   !> Assembles the equations of a structure in the modes of the mesh, for a force at a point.
   !>
   !> parameters  numbers of the parameters of the derivatives
   !> error       as of `check_prepared`
   subroutine assemble_checked(self, equations, parameters, assembly, work, error)
      class(modal_t), intent(in) :: self
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
   !> error  interrupted; the solver is not prepared for this mesh; the beam buckles
   subroutine check_prepared(self, equations, work, error)
      class(modal_t), intent(in) :: self
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
      call check_axial_load(equations%structure, error)
   end subroutine check_prepared

   !> Finds the poles of the assembly at the sensor, and at the slope of the sensor if it reads
   !> gravity, starting from those of the last structure.
   !>
   !> rate, modes  as of `solve`
   !> error        the search fails, or a root that is real and positive shows that the beam buckles
   subroutine update_poles(self, rate, modes, error)
      class(modal_t), intent(inout) :: self
      real(wp), intent(in) :: rate
      integer, intent(in) :: modes
      type(error_t), allocatable, intent(out) :: error
      integer :: sensor

      self%is_known = .false.
      if (allocated(self%first_root)) then
         self%poles%root = self%first_root
         self%poles%all = self%first_all
         self%poles%ds = self%first_ds
         self%poles%parameters = self%first_parameters
         self%poles%values = self%first_values
         self%poles%rate = self%first_rate
         self%poles%modes = self%first_modes
      end if
      associate (assembly => self%assembly)
         call find_poles(assembly, self%poles, error, rate, modes)
         if (allocated(error)) return
         if (assembly%is_dense() .and. any(real(self%poles%s) > 1e-10_wp*maxval(abs( &
            self%poles%s)) .and. .not. abs(aimag(self%poles%s)) > 0)) then
            call failure(error, 'modal: '//buckled)
            return
         end if
         if (assembly%tilt_row > 0) then
            sensor = assembly%sensor
            assembly%sensor = assembly%tilt_row
            self%tilt_poles%root = self%poles%root
            self%tilt_poles%all = self%poles%all
            self%tilt_poles%rate = self%poles%rate
            self%tilt_poles%modes = self%poles%modes
            self%tilt_poles%vector = self%poles%vector
            call find_residues(assembly, self%tilt_poles, error)
            assembly%sensor = sensor
            if (allocated(error)) return
         end if
      end associate
   end subroutine update_poles

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

      call self%assemble_checked(equations, parameters, assembly, work, error)
      if (allocated(error)) return
      if (.not. assembly%strength(bending, of_stiffness) > tiny(1.0_wp)) then
         call failure(error, 'modal: found a beam without bending stiffness, expected E above 0')
         return
      end if
      call transfer_along(assembly, s, h)
      if (tilts .and. assembly%tilt_row > 0) then
         allocate (slope, mold=h)
         assembly%sensor = assembly%tilt_row
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

      type(poles_t) :: poles

      call self%solve(equations, new_pulse(0.0_wp, 1.0_wp), parameters, work, error, 0.0_wp, &
         merge(huge(1), wanted, equations%structure%eta > 0))
      if (allocated(error)) return
      if (equations%structure%eta > 0) then
         call self%add_loss(equations, parameters, wanted, poles, work, error)
         if (.not. allocated(error)) call find_free_modes(poles, wanted, modes, error)
      else
         call find_free_modes(self%poles, wanted, modes, error)
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
      type(poles_t) :: poles

      call self%solve(equations, new_pulse(0.0_wp, 1.0_wp), parameters, work, error, 0.0_wp, &
         merge(huge(1), wanted, equations%structure%eta > 0))
      if (allocated(error)) return
      if (equations%structure%eta > 0) then
         call self%add_loss(equations, parameters, wanted, poles, work, error)
         if (.not. allocated(error)) call select_lowest(poles)
      else
         call select_lowest(self%poles)
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

end module beamid_modal
