!> One record and the motion that the model has for it.
!>
!> The model's acceleration is f(p) + Phi(p) c: what a known force causes, and what enters linearly,
!> the motion of some modes from an unknown start and the offset of the sensor.
module beamid_experiments
   use beamid_equations, only: equations_t, new_equations, unknowns_of
   use beamid_errors, only: error_t, bad_input, failure
   use beamid_excitation, only: excitation_t
   use beamid_free_motion, only: free_mode_t
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_observation, only: observation_t, sampling_t, new_sampling
   use beamid_parameters, only: amplitude
   use beamid_responses, only: exact_solver_t, is_exact, of_tilt, prepare_for, response_t, &
      solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_g, structure_t
   implicit none
   private

   public :: experiment_t, prepared_experiment_t, linear_t, seen_modes_t, prepare_experiment, &
      is_first

   !> A record and how it came about.
   type :: experiment_t
      real(wp), allocatable :: samples(:)    !< (m) ascending [time]
      real(wp), allocatable :: measured(:)   !< (m) [length/time**2]
      type(excitation_t) :: excitation
      !> Of the beam, of the sensor and of the support [length]; not allocated: the structure's
      real(wp), allocatable :: length, x_S, x_P
      integer :: sensor = 1                  !< the record comes from
      !> Records of equal numbers are channels of one motion; 0: a motion of its own
      integer :: motion = 0
      !> Of the noise [length/time**2]; not allocated: not known
      real(wp), allocatable :: sd
      !> acceleration = scale*(value - offset), the offset in the record's own unit
      real(wp) :: scale = 1, offset = 0
   contains
      procedure :: structure_of
   end type experiment_t

   !> What one mesh makes of an experiment: computed once, used by every evaluation.
   type :: prepared_experiment_t
      type(experiment_t) :: experiment
      type(galerkin_t) :: galerkin
      class(solver_t), allocatable :: solver
      type(sampling_t) :: sampling
   contains
      procedure :: evaluate
      procedure, private :: free_motion
   end type prepared_experiment_t

   !> Free modes as the first channel of a motion sees them.
   type :: seen_modes_t
      real(wp) :: begin = 0                       !< of that channel [time]
      type(free_mode_t), allocatable :: modes(:)
   end type seen_modes_t

   !> What enters linearly: Phi = basis*weights(:, :, 0), and its derivatives in the same basis.
   type :: linear_t
      real(wp), allocatable :: basis(:, :)        !< (m, b)
      real(wp), allocatable :: weights(:, :, :)   !< (b, k, 0:parameters)
   contains
      procedure :: columns
      procedure :: add_change
   end type linear_t

contains

   !> The structure as it was in this experiment.
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

   !> Whether a record is the first channel of its motion.
   !>
   !> motions  (records) as of `experiment_t`
   pure function is_first(motions)
      integer, intent(in) :: motions(:)
      logical :: is_first(size(motions))
      integer :: k

      is_first = [(motions(k) == 0 .or. .not. any(motions(:k - 1) == motions(k)), &
         k=1, size(motions))]
   end function is_first

   !> structure  of this experiment
   !> solver     not prepared yet
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

   !> The model and its derivatives.
   !>
   !> offset      whether the sensor's offset is unknown
   !> parameters  by which it is differentiated, places among the `parameters`; none: by any method
   !> y           (m) f - measured
   !> dy          (m, parameters)
   !> linear      k columns: cosine and sine of each mode, then the offset
   !> work        counters to which this call adds
   !> first       of the same motion where this is a further channel: the modes as its sensor sees
   !>             them; not allocated where this is the first, and then set
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
            ! Linear in the amplitude: the derivative is the response to a unit one.
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

      !> What the force causes, and its derivatives.
      subroutine driven(force, parameters, y, dy)
         type(excitation_t), intent(in) :: force
         integer, intent(in) :: parameters(:)
         real(wp), intent(out) :: y(:), dy(:, :)
         type(response_t) :: response
         real(wp), allocatable :: motion(:, :, :)
         integer, allocatable :: which(:)
         integer :: p

         which = [self%sampling%observation%formula]
         if (structure%g > 0 .or. any(parameters == of_g)) which = [which, of_tilt]
         associate (sampling => self%sampling)
            select type (solver => self%solver)
            class is (exact_solver_t)
               allocate (motion(size(sampling%times), 0:size(parameters), size(which)))
               call solver%motions(equations, force, sampling%times, which, parameters, motion, &
                  work, error)
               if (allocated(error)) return
               y = sampling%of_motion(motion(:, 0, 1)) + sampling%of_base(force)
               if (size(which) > 1) y = y + motion(sampling%middle(), 0, 2)
               do p = 1, size(parameters)
                  dy(:, p) = sampling%of_motion(motion(:, p, 1))
                  if (size(which) > 1) dy(:, p) = dy(:, p) + motion(sampling%middle(), p, 2)
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

   !> What enters linearly: the two motions of each mode, of which the unknowns are accelerations at
   !> the first sample, and the offset.
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

   !> The real part of row*states, and minus its imaginary part, by real and imaginary parts of the
   !> states.
   pure function pair(row) result(weights)
      complex(wp), intent(in) :: row(:)
      real(wp) :: weights(2*size(row), 2)

      weights(:, 1) = [real(row), -aimag(row)]
      weights(:, 2) = [-aimag(row), -real(row)]
   end function pair

   !> (m, k) Phi, or with a place among the parameters its derivative.
   pure function columns(self, p)
      class(linear_t), intent(in) :: self
      integer, intent(in) :: p
      real(wp), allocatable :: columns(:, :)

      columns = matmul(self%basis, self%weights(:, :, p))
   end function columns

   !> Adds to each column of dy what changes with its parameter at coefficients c, (dPhi/dp) c.
   !>
   !> r      (m)
   !> along  (k, parameters) (dPhi/dp)'r
   pure subroutine add_change(self, c, r, dy, along)
      class(linear_t), intent(in) :: self
      real(wp), intent(in) :: c(:), r(:)
      real(wp), intent(inout) :: dy(:, :)
      real(wp), intent(out) :: along(:, :)
      real(wp) :: seen(size(self%basis, 2)), change(size(self%basis, 2), size(dy, 2))
      integer :: p

      seen = matmul(r, self%basis)
      do p = 1, size(dy, 2)
         change(:, p) = matmul(self%weights(:, :, p), c)
         along(:, p) = matmul(seen, self%weights(:, :, p))
      end do
      dy = dy + matmul(self%basis, change)
   end subroutine add_change

end module beamid_experiments
