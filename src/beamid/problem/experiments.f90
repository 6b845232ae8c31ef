!> Experiments: what was measured and under which conditions, and the preparation for a fit.
!> `beamid_residuals` evaluates the experiments of a fit.
module beamid_experiments
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_of, mesh_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_mesh_unknowns, only: unknowns_of
   use beamid_observation, only: new_sampling, observation_t
   use beamid_observed_data, only: meshed_model_t, observed_data_t, seen_modes_t, trial_t
   use beamid_responses, only: is_exact, prepare_for, solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use beamid_time_records, only: time_record_t
   implicit none
   private

   public :: experiment_t, prepared_experiment_t, prepare_experiment, is_first

   !> Measured values and the conditions under which they were measured.
   type :: experiment_t
      !> (m) sample times of a time record, ascending [time]
      real(wp), allocatable :: samples(:)
      !> (m) measured values; of a time record: acceleration [length/time**2]
      real(wp), allocatable :: measured(:)
      type(excitation_t) :: excitation
      !> length of the beam, place of the sensor, place of the first support in this experiment
      !> [length]; not allocated: as in the structure
      real(wp), allocatable :: length, x_S, x_P
      integer :: sensor = 1                  !< number of the sensor that recorded
      !> number of the motion; records with the same number are channels of one motion; 0: the
      !> motion has this record only
      integer :: motion = 0
      !> standard deviation of the noise [unit of `measured`]; not allocated: unknown
      real(wp), allocatable :: sd
      !> measured = scale*(value - offset); the offset is in the unit of the file
      real(wp) :: scale = 1, offset = 0
      !> data of another kind than a time record, with what their prediction needs; not allocated:
      !> a time record
      class(observed_data_t), allocatable :: observed
   contains
      procedure :: structure_of
      procedure :: has_known_noise
   end type experiment_t

   !> The data of an experiment, and the model that predicts them.
   type, extends(meshed_model_t) :: prepared_experiment_t
      class(observed_data_t), allocatable :: observed
   contains
      procedure :: evaluate, trial
   end type prepared_experiment_t

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

   !> Returns whether the rows of the record are divided by a noise that is known before the fit.
   pure logical function has_known_noise(self)
      class(experiment_t), intent(in) :: self

      has_known_noise = .false.
      if (allocated(self%observed)) has_known_noise = self%observed%noise_is_known
   end function has_known_noise

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

   !> Prepares an experiment for a mesh: integrals, solver and observed data.
   !>
   !> structure    structure as it was in this experiment
   !> observation  observation formula of a time record
   !> solver       solver that is not yet prepared
   !> error        the solver cannot compute a motion with an unknown initial state; the mesh has
   !>              fewer modes than the motion; the solver cannot be prepared
   !> moving       as in `galerkin_of`
   subroutine prepare_experiment(experiment, structure, mesh, observation, solver, prepared, &
      error, moving)
      type(experiment_t), intent(in) :: experiment
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(observation_t), intent(in) :: observation
      class(solver_t), intent(in) :: solver
      type(prepared_experiment_t), intent(out) :: prepared
      type(error_t), allocatable, intent(out) :: error
      integer, intent(in), optional :: moving(:)
      integer :: most

      if (experiment%excitation%modes > 0 .and. .not. is_exact(solver)) then
         call bad_input(error, 'found an unknown initial state (kind=''free''), whose modes '// &
            'no integrator finds; expected method=''modal'' in &integrator')
         return
      end if
      prepared%galerkin = galerkin_of(mesh, structure, moving=moving)
      most = unknowns_of(mesh, structure)
      if (experiment%excitation%modes > most) then
         call bad_input(error, 'found '//to_text(experiment%excitation%modes)//' modes, '// &
            'expected at most '//to_text(most)//', the number of modes of the mesh')
         return
      end if
      call observe(experiment, observation, prepared%observed)
      prepared%solver = solver
      call prepare_for(prepared%galerkin, prepared%solver, error)
   end subroutine prepare_experiment

   !> Makes the observed data of an experiment: its own kind of data if it has one, else a time
   !> record.
   subroutine observe(experiment, observation, observed)
      type(experiment_t), intent(in) :: experiment
      type(observation_t), intent(in) :: observation
      class(observed_data_t), allocatable, intent(out) :: observed
      type(time_record_t), allocatable :: record

      if (allocated(experiment%observed)) then
         allocate (observed, source=experiment%observed)
      else
         allocate (record)
         record%sampling = new_sampling(observation, experiment%samples)
         record%has_offset = .true.
         call move_alloc(record, observed)
      end if
      observed%measured = experiment%measured
      if (allocated(experiment%sd)) observed%sd = experiment%sd
      observed%motion = experiment%motion
      observed%scale = experiment%scale
      observed%offset = experiment%offset
   end subroutine observe

   !> Returns trial values that point to the experiment, the structure and the excitation. Arguments
   !> as the components of `trial_t`.
   function trial(self, structure, excitation, offset, parameters)
      class(prepared_experiment_t), intent(inout), target :: self
      type(structure_t), intent(in), target :: structure
      type(excitation_t), intent(in), target :: excitation
      logical, intent(in) :: offset
      integer, intent(in) :: parameters(:)
      type(trial_t) :: trial

      trial%model => self%meshed_model_t
      trial%structure => structure
      trial%excitation => excitation
      trial%offset = offset
      trial%parameters = parameters
   end function trial

   !> Computes the prediction of an experiment, its derivatives and its linear unknowns. Arguments
   !> as of `trial` and `observed_data_t`.
   subroutine evaluate(self, structure, excitation, offset, parameters, y, dy, linear, work, &
      error, first)
      class(prepared_experiment_t), intent(inout), target :: self
      type(structure_t), intent(in), target :: structure
      type(excitation_t), intent(in), target :: excitation
      logical, intent(in) :: offset
      integer, intent(in) :: parameters(:)
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first

      call self%observed%evaluate(self%trial(structure, excitation, offset, parameters), y, dy, &
         linear, work, error, first)
      if (.not. allocated(error)) call linear%complete(size(y), size(parameters))
   end subroutine evaluate

end module beamid_experiments
