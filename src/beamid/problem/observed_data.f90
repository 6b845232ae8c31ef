!> Observed data: the values that were measured in an experiment, and their prediction by the model.
!>
!> A fit knows its data by `observed_data_t` alone: measured values with their noise, a prediction
!> with derivatives, and linear unknowns. Each kind of data extends this type. The first kind is the
!> record of accelerations at given times (`beamid_time_records`).
module beamid_observed_data
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_free_motion, only: free_mode_t
   use beamid_galerkin, only: galerkin_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_local_decays, only: local_decay_t
   use beamid_responses, only: solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   implicit none
   private

   public :: condense_rows, meshed_model_t, observed_data_t, seen_modes_t, trial_t

   !> The model of an experiment on a mesh: all that every evaluation uses again.
   type :: meshed_model_t
      type(galerkin_t) :: galerkin             !< integrals of the mesh
      class(solver_t), allocatable :: solver   !< prepared for the mesh
   end type meshed_model_t

   !> The trial values for which the data of an experiment are predicted.
   type :: trial_t
      !> mesh and solver of the experiment; the solver may keep intermediate results
      type(meshed_model_t), pointer :: model => null()
      !> structure with trial values of the parameters, as in this experiment
      type(structure_t), pointer :: structure => null()
      type(excitation_t), pointer :: excitation => null()   !< excitation with trial values
      !> whether the offset of the sensor is unknown; .false. without `has_offset`
      logical :: offset = .false.
      !> (p) numbers in `parameters` to differentiate by; empty if the solver has no exact
      !> derivatives
      integer, allocatable :: parameters(:)
   end type trial_t

   !> The free modes of a motion as the sensor of its first channel measures them.
   type :: seen_modes_t
      real(wp) :: begin = 0                       !< first sample of that channel [time]
      type(free_mode_t), allocatable :: modes(:)  !< (modes)
   end type seen_modes_t

   !> The measured values of an experiment. `prepare_experiment` sets all components except
   !> `has_offset` and `noise_is_known`.
   type, abstract :: observed_data_t
      real(wp), allocatable :: measured(:)   !< (m) measured values [unit of the data]
      !> standard deviation of the noise, which is white [unit of the data]; not allocated: unknown
      real(wp), allocatable :: sd
      !> number of the motion, as in `experiment_t`
      integer :: motion = 0
      !> measured = scale*(value - offset), with the value in the file
      real(wp) :: scale = 1, offset = 0
      !> whether the noise of every value is known before the fit, by averages or repetitions, so
      !> that the residuals need not show it
      logical :: noise_is_known = .false.
      !> whether the sensor may have an unknown offset
      logical :: has_offset = .false.
   contains
      procedure(evaluate_data), deferred :: evaluate
      procedure :: condense => condense_rows
      procedure :: localize => localize_nothing
      procedure :: condense_near => condense_nothing
      procedure :: has_rows => has_no_rows
      procedure :: expand => expand_nothing
      procedure :: times => no_times
      procedure :: sequence => all_rows
      procedure :: groups => one_group
      procedure :: plain => as_it_is
      procedure :: take => take_values
      procedure :: kind => another_kind
      procedure :: description => describe_values
      procedure :: keep_beginning => keep_all
      procedure :: keep_sample => keep_every_value
   end type observed_data_t

   abstract interface
      !> Computes the prediction of the model minus the measured values, its derivatives and its
      !> linear unknowns.
      !>
      !> y       (m) prediction without its linear unknowns, minus the measured values [unit of the
      !>         data]
      !> dy      (m, p) derivatives of y
      !> linear  linear unknowns: first those that all channels of the motion share, two for each
      !>         free mode; then the offset [unit of the file]. Not allocated: none
      !> work    counters to which this call adds
      !> error   the prediction cannot be computed, or has no exact derivatives
      !> first   modes as the first channel measures them: allocated if these data are a further
      !>         channel of the same motion; otherwise set by this call
      subroutine evaluate_data(self, trial, y, dy, linear, work, error, first)
         import :: error_t, linear_t, observed_data_t, seen_modes_t, trial_t, work_t, wp
         class(observed_data_t), intent(in) :: self
         type(trial_t), intent(in) :: trial
         real(wp), intent(out) :: y(:), dy(:, :)
         type(linear_t), intent(out) :: linear
         type(work_t), intent(inout) :: work
         type(error_t), allocatable, intent(out) :: error
         type(seen_modes_t), intent(inout) :: first
      end subroutine evaluate_data
   end interface

contains

   !> Does the same as `evaluate`, but condenses the rows if there are many (`beamid_condensation`).
   !>
   !> y   (rows) residuals
   !> dy  (rows, p) their derivatives
   subroutine condense_rows(self, trial, y, dy, linear, work, error, first)
      class(observed_data_t), intent(in), target :: self
      type(trial_t), intent(in) :: trial
      real(wp), allocatable, intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first

      allocate (y(size(self%measured)), dy(size(self%measured), size(trial%parameters)))
      call self%evaluate(trial, y, dy, linear, work, &
         error, first)
      if (allocated(error)) return
      call linear%complete(size(y), size(trial%parameters))
      call linear%condense(y, dy)
   end subroutine condense_rows

   !> Finds a basis of the rows that holds near given parameters, if there is one.
   !>
   !> covariance  (p, p) of the parameters, which tells how far they are expected to vary
   !> local       the basis, without its rows; unchanged: none
   !> matrix      (m, columns + 1) columns of the basis and negative record; not allocated: none
   !>
   !> The other arguments are those of `evaluate`.
   subroutine localize_nothing(self, trial, covariance, local, matrix, work, error, first)
      class(observed_data_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(in) :: covariance(:, :)
      type(local_decay_t), intent(inout) :: local
      real(wp), allocatable, intent(out) :: matrix(:, :)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
   end subroutine localize_nothing

   !> Does the same as `condense`, from the rows of a basis that holds near given parameters.
   !>
   !> local    from `localize`, with its rows
   !> is_done  .false.: the parameters are too far away; nothing has been computed
   subroutine condense_nothing(self, trial, local, y, dy, linear, work, error, first, is_done)
      class(observed_data_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      type(local_decay_t), intent(in) :: local
      real(wp), allocatable, intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      logical, intent(out) :: is_done

      is_done = .false.
   end subroutine condense_nothing

   !> Returns whether `condense` can tell all rows block by block.
   !>
   !> excitation  of the experiment
   pure logical function has_no_rows(self, excitation)
      class(observed_data_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation

      has_no_rows = .false.
   end function has_no_rows

   !> Computes all rows from weights of the basis.
   !>
   !> linear   from `condense`, with `rows`
   !> weights  (b, 1 + n) of the basis in the residuals and in n derivatives
   !> r        (m) residuals
   !> jac      (m, n) derivatives
   subroutine expand_nothing(self, linear, weights, r, jac)
      class(observed_data_t), intent(in), target :: self
      type(linear_t), intent(inout) :: linear
      real(wp), intent(in) :: weights(:, :)
      real(wp), intent(inout) :: r(:), jac(:, :)
   end subroutine expand_nothing

   !> Returns the time of each value (m) [time]; an empty array for data that are not a function of
   !> time. Their noise has no order in time, and they have no spectral lines.
   pure function no_times(self) result(times)
      class(observed_data_t), intent(in) :: self
      real(wp), allocatable :: times(:)

      allocate (times(0))
   end function no_times

   !> Returns the rows whose noise is independent and has an order, so that a test for white noise
   !> makes sense: all, unless a kind of data says otherwise.
   pure function all_rows(self) result(rows)
      class(observed_data_t), intent(in) :: self
      integer, allocatable :: rows(:)
      integer :: k

      rows = [(k, k=1, size(self%measured))]
   end function all_rows

   !> Returns the number of the group of each row. The errors of a group may have a common cause
   !> that the model lacks.
   !>
   !> residual  (m) of a fit [unit of `measured`]
   pure function one_group(self, residual) result(group)
      class(observed_data_t), intent(in) :: self
      real(wp), intent(in) :: residual(:)
      integer :: group(size(self%measured))

      group = spread(1, 1, size(residual))
   end function one_group

   !> Returns values or residuals without the division by the noise of each row.
   !>
   !> r  (m) in the unit of `measured`
   pure function as_it_is(self, r) result(plain)
      class(observed_data_t), intent(in) :: self
      real(wp), intent(in) :: r(:)
      real(wp), allocatable :: plain(:)

      plain = r(:size(self%measured))
   end function as_it_is

   !> Replaces the measured values, as in a simulation.
   !>
   !> values  (m) in the unit of `measured`
   pure subroutine take_values(self, values)
      class(observed_data_t), intent(inout) :: self
      real(wp), intent(in) :: values(:)

      self%measured = values
   end subroutine take_values

   !> Returns the kind of the data, as in a case file: 'time', 'frf', 'modes'; or 'other'.
   pure function another_kind(self) result(kind)
      class(observed_data_t), intent(in) :: self
      character(len=5) :: kind

      kind = 'other'
   end function another_kind

   !> Returns a description of the data, for reports.
   function describe_values(self) result(text)
      class(observed_data_t), intent(in) :: self
      character(len=:), allocatable :: text

      text = to_text(size(self%measured))//' values'
   end function describe_values

   !> Keeps the first part of a record; data that are not a function of time stay as they are.
   !>
   !> share  length of the part, as a share of the time from the first sample to the last
   pure subroutine keep_all(self, share)
      class(observed_data_t), intent(inout) :: self
      real(wp), intent(in) :: share
   end subroutine keep_all

   !> Keeps some values of a long record; data that are not a function of time stay as they are.
   !>
   !> most   number of values from which a record is long
   !> taken  whether values were left out
   pure subroutine keep_every_value(self, most, taken)
      class(observed_data_t), intent(inout) :: self
      integer, intent(in) :: most
      logical, intent(out) :: taken

      taken = .false.
   end subroutine keep_every_value

end module beamid_observed_data
