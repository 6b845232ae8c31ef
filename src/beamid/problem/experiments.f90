!> Experiments: a record, and the model of the motion that was recorded.
!>
!> The acceleration of the model is f(p) + Phi(p) c. The response f to a known force depends on the
!> parameters p. The linear unknowns c are the free modes of a motion with an unknown initial state,
!> and the offset of the sensor. `beamid_residuals` evaluates the experiments of a fit.
module beamid_experiments
   use beamid_equations, only: equations_t, new_equations, unknowns_of
   use beamid_errors, only: error_t, bad_input, failure
   use beamid_excitation, only: excitation_t
   use beamid_free_motion, only: free_mode_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_observation, only: observation_t, sampling_t, new_sampling
   use beamid_parameters, only: amplitude
   use beamid_responses, only: exact_solver_t, is_exact, of_tilt, prepare_for, response_t, &
      solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_g, structure_t
   implicit none
   private

   public :: experiment_t, prepared_experiment_t, seen_modes_t, prepare_experiment, is_first

   !> A record and the conditions under which it was taken.
   type :: experiment_t
      real(wp), allocatable :: samples(:)    !< (m) sample times, ascending [time]
      real(wp), allocatable :: measured(:)   !< (m) recorded acceleration [length/time**2]
      type(excitation_t) :: excitation
      !> length of the beam, place of the sensor, place of the first support in this experiment
      !> [length]; not allocated: as in the structure
      real(wp), allocatable :: length, x_S, x_P
      integer :: sensor = 1                  !< number of the sensor that recorded
      !> number of the motion; records with the same number are channels of one motion; 0: the
      !> motion has this record only
      integer :: motion = 0
      !> standard deviation of the noise [length/time**2]; not allocated: unknown
      real(wp), allocatable :: sd
      !> acceleration = scale*(value - offset); the offset is in the unit of the file
      real(wp) :: scale = 1, offset = 0
   contains
      procedure :: structure_of
   end type experiment_t

   !> An experiment with all that is computed once for a mesh and used by every evaluation.
   type :: prepared_experiment_t
      type(experiment_t) :: experiment
      type(galerkin_t) :: galerkin             !< integrals of the mesh
      class(solver_t), allocatable :: solver   !< prepared for the mesh
      type(sampling_t) :: sampling             !< response times of the observation formula
   contains
      procedure :: evaluate
      procedure, private :: free_motion
   end type prepared_experiment_t

   !> The free modes of a motion as the sensor of its first channel measures them.
   type :: seen_modes_t
      real(wp) :: begin = 0                       !< first sample of that channel [time]
      type(free_mode_t), allocatable :: modes(:)  !< (modes)
   end type seen_modes_t

contains

   !> Returns the structure as it was in this experiment: with its own length, places and sensor.
   pure type(structure_t) function structure_of(self, structure)
      class(experiment_t), intent(in) :: self
      type(structure_t), intent(in) :: structure

      structure_of = structure
      structure_of%observer = self%sensor
      if (allocated(self%length)) structure_of%length = self%length
      if (allocated(self%x_S)) structure_of%sensor(self%sensor)%x_S = self%x_S
      if (allocated(self%x_P)) structure_of%support(1)%x_P = self%x_P
      if (allocated(self%excitation%x_F)) structure_of%x_F = self%excitation%x_F
   end function structure_of

   !> Tells for each record (records) whether it is the first channel of its motion.
   !>
   !> motions  (records) number of the motion of each record, as in `experiment_t`
   pure function is_first(motions)
      integer, intent(in) :: motions(:)
      logical :: is_first(size(motions))
      integer :: k

      is_first = [(motions(k) == 0 .or. .not. any(motions(:k - 1) == motions(k)), &
         k=1, size(motions))]
   end function is_first

   !> Prepares an experiment for a mesh: integrals, solver and response times.
   !>
   !> structure    structure as it was in this experiment
   !> observation  observation formula
   !> solver       solver that is not yet prepared
   !> error        the solver cannot compute a motion with an unknown initial state; the mesh has
   !>              fewer modes than the motion; the solver cannot be prepared
   subroutine prepare_experiment(experiment, structure, mesh, observation, solver, prepared, error)
      type(experiment_t), intent(in) :: experiment
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(observation_t), intent(in) :: observation
      class(solver_t), intent(in) :: solver
      type(prepared_experiment_t), intent(out) :: prepared
      type(error_t), allocatable, intent(out) :: error
      integer :: most

      if (experiment%excitation%modes > 0 .and. .not. is_exact(solver)) then
         call bad_input(error, 'found a start that is not known, whose modes no integrator '// &
            'finds; expected the modal response')
         return
      end if
      prepared%galerkin = galerkin_of(mesh, structure)
      most = unknowns_of(mesh, structure)
      if (experiment%excitation%modes > most) then
         call bad_input(error, 'found '//to_text(experiment%excitation%modes)//' modes that '// &
            'move at the start, expected at most '//to_text(most)//', as many as the mesh has')
         return
      end if
      prepared%experiment = experiment
      prepared%solver = solver
      prepared%sampling = new_sampling(observation, experiment%samples)
      call prepare_for(prepared%galerkin, prepared%solver, error)
   end subroutine prepare_experiment

   !> Computes the model of an experiment, its derivatives and its linear unknowns.
   !>
   !> structure   structure with trial values of the parameters, as in this experiment
   !> excitation  excitation with trial values
   !> offset      whether the offset of the sensor is unknown
   !> parameters  (p) numbers in `parameters` to differentiate by; must be empty if the solver has
   !>             no exact derivatives
   !> y           (m) f minus the record [length/time**2]
   !> dy          (m, p) derivatives of y
   !> linear      linear unknowns: cosine and sine of each mode, which are accelerations at the
   !>             first sample [length/time**2], then the offset [unit of the file]
   !> work        counters to which this call adds
   !> error       the response cannot be computed, or has no exact derivatives
   !> first       modes as the first channel measures them: allocated if this is a further channel
   !>             of the same motion; otherwise set by this call
   subroutine evaluate(self, structure, excitation, offset, parameters, y, dy, linear, work, &
      error, first)
      class(prepared_experiment_t), intent(inout), target :: self
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      logical, intent(in) :: offset
      integer, intent(in) :: parameters(:)
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      type(equations_t), target :: equations
      type(excitation_t) :: applied
      real(wp) :: none(size(y), 0)
      integer :: p

      applied = excitation
      if (applied%by_displacement) call applied%fit_to(structure%stiffness())
      equations = new_equations(self%galerkin, structure, applied, &
         matrices=.not. is_exact(self%solver))
      y = 0
      dy = 0
      if (excitation%modes == 0) then
         call driven(applied, parameters, y, dy)
         if (allocated(error)) return
         p = findloc(parameters, amplitude, dim=1)
         if (p > 0) then
            ! f is linear in the amplitude: its derivative is the response to a unit amplitude.
            call applied%set_amplitude(1.0_wp)
            if (applied%by_displacement) call applied%fit_to(structure%stiffness())
            call driven(applied, [integer ::], dy(:, p), none)
            if (allocated(error)) return
         end if
      end if
      y = y - self%experiment%measured
      call self%free_motion(equations, applied%modes, parameters, offset, first, linear, work, &
         error)

   contains

      !> Computes the observed response to a force (m), and its derivatives (m, p).
      subroutine driven(force, parameters, y, dy)
         type(excitation_t), intent(in) :: force
         integer, intent(in) :: parameters(:)
         real(wp), intent(out) :: y(:), dy(:, :)
         type(response_t) :: response
         real(wp), allocatable :: motion(:, :, :)
         integer, allocatable :: rows(:)
         integer :: p

         rows = [self%sampling%observation%formula]
         if (structure%g > 0 .or. any(parameters == of_g)) rows = [rows, of_tilt]
         associate (sampling => self%sampling)
            select type (solver => self%solver)
            class is (exact_solver_t)
               allocate (motion(size(sampling%times), 0:size(parameters), size(rows)))
               call solver%motions(equations, force, sampling%times, rows, parameters, motion, &
                  work, error)
               if (allocated(error)) return
               y = sampling%of_motion(motion(:, 0, 1)) + sampling%of_base(force)
               if (size(rows) > 1) y = y + motion(sampling%middle(), 0, 2)
               do p = 1, size(parameters)
                  dy(:, p) = sampling%of_motion(motion(:, p, 1))
                  if (size(rows) > 1) dy(:, p) = dy(:, p) + motion(sampling%middle(), p, 2)
                  if (force%by_displacement) dy(:, p) = dy(:, p) &
                     + structure%stiffening(parameters(p))*y
               end do
            class default
               call solver%respond(equations, force, sampling%times, response, work, error)
               if (allocated(error)) return
               y = sampling%acceleration(response, force)
               if (size(parameters) > 0) call failure(error, 'this method has no exact derivatives')
            end select
         end associate
      end subroutine driven

   end subroutine evaluate

   !> Computes the linear unknowns: the two motions of each free mode, and the offset. Arguments as
   !> of `evaluate`.
   !>
   !> count  number of modes
   subroutine free_motion(self, equations, count, parameters, offset, first, linear, work, error)
      class(prepared_experiment_t), intent(inout) :: self
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: count, parameters(:)
      logical, intent(in) :: offset
      type(seen_modes_t), intent(inout) :: first
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(free_mode_t), allocatable :: modes(:)
      complex(wp), allocatable :: states(:, :)
      integer :: b, i, k, n, p

      allocate (modes(0))
      select type (solver => self%solver)
      class is (exact_solver_t)
         if (count > 0) call solver%free_modes(equations, parameters, count, modes, work, error)
      class default
         if (count > 0) call failure(error, 'this method has no modes')
      end select
      if (allocated(error)) return
      if (.not. allocated(first%modes)) then
         first%begin = self%experiment%samples(1)
         first%modes = modes
      else
         do k = 1, count
            if (.not. abs(first%modes(k)%seen) > 0 .or. .not. abs(modes(k)%seen) > 0) then
               call failure(error, 'mode '//to_text(k)//' nearly meets another one: what two '// &
                  'channels see of it cannot be compared')
               return
            end if
            call modes(k)%as_seen_beside(first%modes(k))
         end do
      end if
      n = 2*sum([(size(modes(k)%row, 1), k=1, count)]) + merge(1, 0, offset)
      allocate (linear%basis(size(self%experiment%samples), n))
      allocate (linear%weights(n, 2*count + merge(1, 0, offset), 0:size(parameters)), &
         source=0.0_wp)
      b = 0
      associate (formula => self%sampling%observation%formula)
         do k = 1, count
            states = modes(k)%states(self%sampling%times - first%begin)
            n = size(states, 2)
            do i = 1, n
               linear%basis(:, b + i) = self%sampling%of_motion(real(states(:, i)))
               linear%basis(:, b + n + i) = self%sampling%of_motion(aimag(states(:, i)))
            end do
            linear%weights(b + 1:b + 2*n, 2*k - 1:2*k, 0) = pair(modes(k)%row(:, formula))
            do p = 1, size(parameters)
               linear%weights(b + 1:b + 2*n, 2*k - 1:2*k, p) = pair(modes(k)%drow(:, formula, p))
            end do
            b = b + 2*n
         end do
      end associate
      if (.not. offset) return
      linear%basis(:, b + 1) = self%experiment%scale
      linear%weights(b + 1, 2*count + 1, 0) = 1
   end subroutine free_motion

   !> Returns the weights of Re(row*states) and of -Im(row*states) in the basis of the real and the
   !> imaginary parts of the states.
   !>
   !> row      (states)
   !> weights  (2*states, 2) first the real parts, then the imaginary parts; one column for each
   !>          motion
   pure function pair(row) result(weights)
      complex(wp), intent(in) :: row(:)
      real(wp) :: weights(2*size(row), 2)

      weights(:, 1) = [real(row), -aimag(row)]
      weights(:, 2) = [-aimag(row), -real(row)]
   end function pair

end module beamid_experiments
