!> The interface of all solvers for the response in time, and the types that they exchange.
!>
!> Two solvers implement it: `cvode` integrates numerically, `modal` is exact in time.
module beamid_responses
   use beamid_equations, only: equations_t
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_free_motion, only: free_mode_t
   use beamid_galerkin, only: galerkin_t
   use beamid_kinds, only: wp, ip
   implicit none
   private

   public :: of_tilt, response_t, solver_t, exact_solver_t, is_exact, prepare_for, work_t

   !> Number of the fourth motion: the reading of a tilted sensor due to gravity, after displacement
   !> (1), velocity (2) and acceleration (3).
   integer, parameter :: of_tilt = 4

   !> Counters of a solver's work, summed over all calls that were given the same variable.
   type :: work_t
      integer(ip) :: solves = 0             !< computed responses
      integer(ip) :: steps = 0              !< steps of the integrator
      integer(ip) :: evaluations = 0        !< evaluations of the right-hand side
      integer(ip) :: factorizations = 0     !< factorizations of band matrices
   end type work_t

   !> Motion of the sensor at the requested times; all arrays have the shape of `t`.
   type :: response_t
      real(wp), allocatable :: t(:)              !< [time]
      real(wp), allocatable :: displacement(:)   !< [length]
      real(wp), allocatable :: velocity(:)       !< [length/time]
      real(wp), allocatable :: acceleration(:)   !< (3.13) [length/time**2]
      !> reading due to gravity of a sensor that rotates with the beam [length/time**2]; not
      !> allocated: no gravity
      real(wp), allocatable :: tilt(:)
   end type response_t

   !> A solver for the response in time.
   type, abstract :: solver_t
   contains
      procedure(respond), deferred :: respond
      procedure(relative_error), deferred :: relative_error
   end type solver_t

   !> A solver that is exact in time and provides exact derivatives and the modes. It must be
   !> prepared for a mesh, once, before the first response.
   type, abstract, extends(solver_t) :: exact_solver_t
   contains
      procedure(prepare), deferred :: prepare
      procedure(motions), deferred :: motions
      procedure(free_modes), deferred :: free_modes
      procedure(transfer), deferred :: transfer
      procedure :: differentiate
      procedure :: stay_here => keep_nothing
      procedure :: respond => respond_alone
      procedure :: relative_error => no_error
      procedure :: free_motion
   end type exact_solver_t

   abstract interface
      !> Computes the response from rest, (3.13) and (3.14). A solver may keep intermediate results
      !> for the next call.
      !>
      !> equations   structure and mesh
      !> excitation  force or base motion
      !> times       ascending [time]; before the excitation begins, the structure is at rest
      !> response    allocated on success
      !> work        in and out: counters, to which this call adds
      !> error       the solver failed
      subroutine respond(self, equations, excitation, times, response, work, error)
         import :: equations_t, error_t, excitation_t, response_t, solver_t, work_t, wp
         class(solver_t), intent(inout) :: self
         type(equations_t), intent(in), target :: equations
         type(excitation_t), intent(in) :: excitation
         real(wp), intent(in) :: times(:)
         type(response_t), intent(out) :: response
         type(work_t), intent(inout) :: work
         type(error_t), allocatable, intent(out) :: error
      end subroutine respond
      !> Returns the relative error that the solver leaves in a response; 0: round-off only.
      pure real(wp) function relative_error(self)
         import :: solver_t, wp
         class(solver_t), intent(in) :: self
      end function relative_error
      !> Prepares the solver for a mesh.
      !>
      !> galerkin  integrals of the mesh
      subroutine prepare(self, galerkin, error)
         import :: error_t, exact_solver_t, galerkin_t
         class(exact_solver_t), intent(inout) :: self
         type(galerkin_t), intent(in) :: galerkin
         type(error_t), allocatable, intent(out) :: error
      end subroutine prepare
      !> Computes motions of the sensor and their derivatives.
      !>
      !> equations   structure and mesh
      !> excitation  force or base motion
      !> times       ascending [time]
      !> which       numbers of the motions: 1 displacement, 2 velocity, 3 acceleration, and last,
      !>             if wanted, `of_tilt`
      !> parameters  numbers of the parameters of the derivatives
      !> motion      (times, 0:parameters, which) column 0 is the motion itself, column p its
      !>             derivative with respect to parameters(p)
      !> work        in and out: counters, to which this call adds
      subroutine motions(self, equations, excitation, times, which, parameters, motion, work, error)
         import :: equations_t, error_t, exact_solver_t, excitation_t, work_t, wp
         class(exact_solver_t), intent(inout) :: self
         type(equations_t), intent(in), target :: equations
         type(excitation_t), intent(in) :: excitation
         real(wp), intent(in) :: times(:)
         integer, intent(in) :: which(:), parameters(:)
         real(wp), intent(out) :: motion(:, 0:, :)
         type(work_t), intent(inout) :: work
         type(error_t), allocatable, intent(out) :: error
      end subroutine motions
      !> Computes the lowest modes that oscillate, including modes near critical damping.
      !>
      !> equations   structure and mesh
      !> parameters  numbers of the parameters of the derivatives
      !> wanted      number of modes
      !> modes       (wanted) in ascending order of |s|
      !> work        in and out: counters, to which this call adds
      !> error       the solver failed, or there are fewer modes
      subroutine free_modes(self, equations, parameters, wanted, modes, work, error)
         import :: equations_t, error_t, exact_solver_t, free_mode_t, work_t
         class(exact_solver_t), intent(inout) :: self
         type(equations_t), intent(in), target :: equations
         integer, intent(in) :: parameters(:), wanted
         type(free_mode_t), allocatable, intent(out) :: modes(:)
         type(work_t), intent(inout) :: work
         type(error_t), allocatable, intent(out) :: error
      end subroutine free_modes
      !> Computes the displacement of the sensor per unit force, the transfer function
      !> h(s) = o'Q(s)**-1 F, and its derivatives.
      !>
      !> equations   structure and mesh; the force acts at x_F of the structure
      !> s           (points) places in the complex plane, none of them a root [1/time]
      !> tilts       whether to add the reading of a tilted sensor due to gravity, divided by s**2:
      !>             s**2 h is then the acceleration that the sensor reads
      !> parameters  numbers of the parameters of the derivatives
      !> h           (points, 0:parameters) column 0 is h [length/force], column p its derivative
      !>             with respect to parameters(p)
      !> work        in and out: counters, to which this call adds
      !> error       the solver failed; a point is a root, so that h is not finite
      subroutine transfer(self, equations, s, tilts, parameters, h, work, error)
         import :: equations_t, error_t, exact_solver_t, work_t, wp
         class(exact_solver_t), intent(inout) :: self
         type(equations_t), intent(in), target :: equations
         complex(wp), intent(in) :: s(:)
         logical, intent(in) :: tilts
         integer, intent(in) :: parameters(:)
         complex(wp), intent(out) :: h(:, 0:)
         type(work_t), intent(inout) :: work
         type(error_t), allocatable, intent(out) :: error
      end subroutine transfer
   end interface

contains

   !> Returns whether a solver is exact in time.
   pure logical function is_exact(solver)
      class(solver_t), intent(in) :: solver

      select type (solver)
      class is (exact_solver_t)
         is_exact = .true.
      class default
         is_exact = .false.
      end select
   end function is_exact

   !> Prepares a solver for a mesh if it is exact; another solver needs no preparation.
   !>
   !> galerkin  integrals of the mesh
   subroutine prepare_for(galerkin, solver, error)
      type(galerkin_t), intent(in) :: galerkin
      class(solver_t), intent(inout) :: solver
      type(error_t), allocatable, intent(out) :: error

      select type (solver)
      class is (exact_solver_t)
         call solver%prepare(galerkin, error)
      end select
   end subroutine prepare_for

   !> Starts all further searches from the last structure and its derivatives, so that results do
   !> not depend on the structures in between. A solver without a search has nothing to keep.
   subroutine keep_nothing(self)
      class(exact_solver_t), intent(inout) :: self
   end subroutine keep_nothing

   !> Computes the response and its derivatives.
   !>
   !> parameters  numbers of the parameters
   !> response    as from `respond`
   !> slopes      (parameters) derivatives of each motion
   !>
   !> The other arguments are those of `respond`.
   subroutine differentiate(self, equations, excitation, times, parameters, response, slopes, &
      work, error)
      class(exact_solver_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: parameters(:)
      type(response_t), intent(out) :: response
      type(response_t), allocatable, intent(out) :: slopes(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: motion(:, :, :)
      integer :: p

      allocate (motion(size(times), 0:size(parameters), of_tilt))
      call self%motions(equations, excitation, times, [1, 2, 3, of_tilt], parameters, motion, &
         work, error)
      if (allocated(error)) return
      response = response_t(times, motion(:, 0, 1), motion(:, 0, 2), motion(:, 0, 3), &
         motion(:, 0, of_tilt))
      allocate (slopes(size(parameters)))
      do p = 1, size(parameters)
         slopes(p) = response_t(times, motion(:, p, 1), motion(:, p, 2), motion(:, p, 3), &
            motion(:, p, of_tilt))
      end do
   end subroutine differentiate

   !> Computes the response without derivatives; arguments as in `respond`.
   subroutine respond_alone(self, equations, excitation, times, response, work, error)
      class(exact_solver_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(response_t), allocatable :: slopes(:)

      call self%differentiate(equations, excitation, times, [integer ::], response, slopes, work, &
         error)
   end subroutine respond_alone

   !> Returns 0: an exact solver has no error except round-off.
   pure real(wp) function no_error(self)
      class(exact_solver_t), intent(in) :: self

      no_error = 0
   end function no_error

   !> Computes the roots of the lowest modes that oscillate and their derivatives.
   !>
   !> equations   structure and mesh
   !> parameters  numbers of the parameters of the derivatives
   !> s           (modes) roots in ascending order of |s| [1/time]; the size is the number of modes
   !>             wanted
   !> ds          (modes, parameters)
   !> work        in and out: counters, to which this call adds
   !> error       the solver failed, or there are fewer modes
   subroutine free_motion(self, equations, parameters, s, ds, work, error)
      class(exact_solver_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: parameters(:)
      complex(wp), intent(out) :: s(:), ds(:, :)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(free_mode_t), allocatable :: modes(:)
      integer :: k

      s = 0
      ds = 0
      call self%free_modes(equations, parameters, size(s), modes, work, error)
      if (allocated(error)) return
      do k = 1, size(s)
         s(k) = modes(k)%s
         ds(k, :) = modes(k)%ds
      end do
   end subroutine free_motion

end module beamid_responses
