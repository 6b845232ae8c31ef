!> What every response solver computes, and the one interface behind which the solvers stand.
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

   !> What gravity adds to the reading of a sensor that turns, after displacement, velocity and
   !> acceleration.
   integer, parameter :: of_tilt = 4

   !> What a solver did, summed over the calls that were given the same counter.
   type :: work_t
      integer(ip) :: solves = 0             !< responses computed
      integer(ip) :: steps = 0              !< steps of the integrator
      integer(ip) :: evaluations = 0        !< of the right-hand side
      integer(ip) :: factorizations = 0     !< of banded matrices
   end type work_t

   !> Motion of the observed point at the requested times, each array of the same shape.
   type :: response_t
      real(wp), allocatable :: t(:)              !< [time]
      real(wp), allocatable :: displacement(:)   !< [length]
      real(wp), allocatable :: velocity(:)       !< [length/time]
      real(wp), allocatable :: acceleration(:)   !< (3.13) [length/time**2]
      !> What a sensor that turns with the beam reads of gravity; not allocated: nothing
      !> [length/time**2]
      real(wp), allocatable :: tilt(:)
   end type response_t

   !> What computes responses.
   type, abstract :: solver_t
   contains
      procedure(respond), deferred :: respond
      procedure(relative_error), deferred :: relative_error
   end type solver_t

   !> A solver that is exact in time, with exact derivatives, and knows the modes. Before the first
   !> response it is prepared for a mesh, once.
   type, abstract, extends(solver_t) :: exact_solver_t
   contains
      procedure(prepare), deferred :: prepare
      procedure(motions), deferred :: motions
      procedure(free_modes), deferred :: free_modes
      procedure :: differentiate
      procedure :: respond => respond_alone
      procedure :: relative_error => no_error
      procedure :: free_motion
   end type exact_solver_t

   abstract interface
      !> Response from rest, (3.13) and (3.14). A method may keep what it found, for the next call.
      !>
      !> times     ascending [time]; before the force begins the structure is at rest
      !> response  allocated on success
      !> work      counters to which this call adds
      !> error     when the method could not do what was asked
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
      !> Relative error that the method leaves in a response; 0: round-off only.
      pure real(wp) function relative_error(self)
         import :: solver_t, wp
         class(solver_t), intent(in) :: self
      end function relative_error
      subroutine prepare(self, galerkin, error)
         import :: error_t, exact_solver_t, galerkin_t
         class(exact_solver_t), intent(inout) :: self
         type(galerkin_t), intent(in) :: galerkin
         type(error_t), allocatable, intent(out) :: error
      end subroutine prepare
      !> Motions of the observed point together with their derivatives.
      !>
      !> which       1 displacement, 2 velocity, 3 acceleration; at the end `of_tilt`
      !> parameters  places among the `parameters`
      !> motion      (times, 0:parameters, which), 0 the motion itself
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
      !> The lowest modes that oscillate, or nearly do.
      !>
      !> modes  (wanted) ascending |s|
      !> error  also when there are fewer
      subroutine free_modes(self, equations, parameters, wanted, modes, work, error)
         import :: equations_t, error_t, exact_solver_t, free_mode_t, work_t
         class(exact_solver_t), intent(inout) :: self
         type(equations_t), intent(in), target :: equations
         integer, intent(in) :: parameters(:), wanted
         type(free_mode_t), allocatable, intent(out) :: modes(:)
         type(work_t), intent(inout) :: work
         type(error_t), allocatable, intent(out) :: error
      end subroutine free_modes
   end interface

contains

   !> Whether a solver is exact.
   pure logical function is_exact(solver)
      class(solver_t), intent(in) :: solver

      select type (solver)
      class is (exact_solver_t)
         is_exact = .true.
      class default
         is_exact = .false.
      end select
   end function is_exact

   !> What an exact solver computes once per mesh; another one has nothing to prepare.
   subroutine prepare_for(galerkin, solver, error)
      type(galerkin_t), intent(in) :: galerkin
      class(solver_t), intent(inout) :: solver
      type(error_t), allocatable, intent(out) :: error

      select type (solver)
      class is (exact_solver_t)
         call solver%prepare(galerkin, error)
      end select
   end subroutine prepare_for

   !> Response together with its derivatives.
   !>
   !> parameters  places among the `parameters`
   !> slopes      (size(parameters)) derivatives of each motion
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

   !> A response without derivatives.
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

   pure real(wp) function no_error(self)
      class(exact_solver_t), intent(in) :: self

      no_error = 0
   end function no_error

   !> Their roots alone, and the derivatives of these.
   !>
   !> s   as many as are wanted [1/time]
   !> ds  (modes, parameters)
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
