!> Time records: accelerations at given times, the first kind of observed data.
!>
!> The acceleration of the model is f(p) + Phi(p) c. The response f to a known force depends on the
!> parameters p. The linear unknowns c are the free modes of a motion with an unknown initial state,
!> and the offset of the sensor.
module beamid_time_records
   use beamid_condensation, only: few_rows
   use beamid_decay_rows, only: decay_rows_t, new_decay_rows
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, failure
   use beamid_excitation, only: excitation_t
   use beamid_free_motion, only: free_mode_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t
   use beamid_local_decays, only: local_decay_t, new_local_decay
   use beamid_mode_weights, only: set_weights
   use beamid_observation, only: from_acceleration, new_sampling, sampling_t
   use beamid_observed_data, only: condense_rows, meshed_model_t, observed_data_t, seen_modes_t, &
      trial_t
   use beamid_parameters, only: amplitude
   use beamid_responses, only: exact_solver_t, is_exact, of_tilt, response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_g
   implicit none
   private

   public :: time_record_t

   !> Largest size of the matrix that `localize` decomposes, 160 MB.
   real(wp), parameter :: most_numbers = 2e7_wp

   !> A record of accelerations [length/time**2].
   type, extends(observed_data_t) :: time_record_t
      type(sampling_t) :: sampling   !< sample times, observation formula and response times
      !> (modes) deviation of the root of each free mode from that of the model; not allocated: none
      !> [1/time]
      complex(wp), allocatable :: deviation(:)
   contains
      procedure :: evaluate
      procedure :: condense
      procedure :: localize
      procedure :: condense_near
      procedure :: has_rows
      procedure :: expand
      procedure :: times => record_times
      procedure :: kind
      procedure :: keep_beginning
      procedure :: keep_sample
      procedure, private :: find_decay, find_modes, free_motion
   end type time_record_t

contains

   !> Returns the sample times (m), ascending [time].
   pure function record_times(self) result(times)
      class(time_record_t), intent(in) :: self
      real(wp), allocatable :: times(:)

      times = self%sampling%sample_times
   end function record_times

   !> Returns 'time'.
   pure function kind(self)
      class(time_record_t), intent(in) :: self
      character(len=5) :: kind

      kind = 'time'
   end function kind

   !> Keeps the first part of the record.
   !>
   !> share  length of the part, as a share of the time from the first sample to the last
   pure subroutine keep_beginning(self, share)
      class(time_record_t), intent(inout) :: self
      real(wp), intent(in) :: share
      real(wp) :: t(size(self%measured))
      integer :: m

      t = self%sampling%sample_times
      m = count(t <= t(1) + share*(t(size(t)) - t(1)))
      self%measured = self%measured(:m)
      self%sampling = new_sampling(self%sampling%observation, t(:m))
   end subroutine keep_beginning

   !> Keeps some samples of a long record: runs of neighbours, in equal distances over the whole
   !> record, so that neither its length nor its highest frequency is lost. Arguments as of
   !> `observed_data_t`.
   pure subroutine keep_sample(self, most, taken)
      class(time_record_t), intent(inout) :: self
      integer, intent(in) :: most
      logical, intent(out) :: taken
      integer, parameter :: run = 32
      real(wp), allocatable :: t(:)
      integer :: first, k, stride

      taken = size(self%measured) > most
      if (.not. taken) return
      stride = run*(1 + (size(self%measured) - 1)/most)
      associate (rows => [((k, k=first, min(first + run - 1, size(self%measured))), &
         first=1, size(self%measured), stride)])
         t = self%sampling%sample_times(rows)
         self%measured = self%measured(rows)
      end associate
      self%sampling = new_sampling(self%sampling%observation, t)
   end subroutine keep_sample

   !> Computes the accelerations of the model minus the record, their derivatives and their linear
   !> unknowns. Arguments as of `observed_data_t`; the first linear unknowns are cosine and sine of
   !> each mode, which are accelerations at the first sample.
   subroutine evaluate(self, trial, y, dy, linear, work, error, first)
      class(time_record_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      type(equations_t), target :: equations
      type(excitation_t) :: applied
      real(wp) :: none(size(y), 0)
      integer :: p

      applied = trial%excitation
      if (applied%by_displacement) call applied%fit_to(trial%structure%stiffness())
      equations = new_equations(trial%model%galerkin, trial%structure, applied, &
         matrices=.not. is_exact(trial%model%solver))
      y = 0
      dy = 0
      if (trial%excitation%modes == 0) then
         call driven(applied, trial%parameters, y, dy)
         if (allocated(error)) return
         p = findloc(trial%parameters, amplitude, dim=1)
         if (p > 0) then
            ! f is linear in the amplitude: its derivative is the response to a unit amplitude.
            call applied%set_amplitude(1.0_wp)
            if (applied%by_displacement) call applied%fit_to(trial%structure%stiffness())
            call driven(applied, [integer ::], dy(:, p), none)
            if (allocated(error)) return
         end if
      end if
      y = y - self%measured
      call self%free_motion(trial%model, equations, applied%modes, trial%parameters, trial%offset, &
         first, linear, work, error)

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
         if (trial%structure%g > 0 .or. any(parameters == of_g)) rows = [rows, of_tilt]
         associate (sampling => self%sampling)
            select type (solver => trial%model%solver)
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
                     + trial%structure%stiffening(parameters(p))*y
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

   !> Condenses the rows of a free decay without forming them. Arguments as of `observed_data_t`.
   subroutine condense(self, trial, y, dy, linear, work, error, first)
      class(time_record_t), intent(in), target :: self
      type(trial_t), intent(in) :: trial
      real(wp), allocatable, intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      type(free_mode_t), allocatable :: modes(:)
      type(decay_rows_t) :: rows
      logical :: is_decay

      call self%find_decay(trial, first, modes, is_decay, work, error)
      if (allocated(error)) return
      if (.not. is_decay) then
         call condense_rows(self, trial, y, dy, linear, work, error, first)
         return
      end if
      rows = new_decay_rows([modes%s], first%begin, merge(self%scale, 0.0_wp, trial%offset), &
         self%sampling%sample_times, self%measured)
      call set_weights(modes, from_acceleration, size(trial%parameters), trial%offset, linear)
      allocate (dy(0, size(trial%parameters)))
      call linear%take_condensed(rows%condensed(), y, dy, 0)
      allocate (linear%rows, source=rows)
   end subroutine condense

   !> Finds a basis of the rows of a free decay near given parameters. Arguments as of
   !> `observed_data_t`.
   subroutine localize(self, trial, covariance, local, matrix, work, error, first)
      class(time_record_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      real(wp), intent(in) :: covariance(:, :)
      type(local_decay_t), intent(inout) :: local
      real(wp), allocatable, intent(out) :: matrix(:, :)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      !> Distance from the centre [standard deviations]: one draw of Student's t with four degrees
      !> of freedom in 4000 is further away.
      real(wp), parameter :: reach = 12
      type(free_mode_t), allocatable :: modes(:)
      real(wp), allocatable :: distance(:)
      logical :: is_decay
      integer :: k

      call self%find_decay(trial, first, modes, is_decay, work, error)
      if (allocated(error) .or. .not. is_decay) return
      distance = [(reach*sqrt(max(0.0_wp, real(dot_product(modes(k)%ds, matmul(covariance, &
         modes(k)%ds))))), k=1, size(modes))]
      local = new_local_decay([modes%s], distance, first%begin, merge(self%scale, 0.0_wp, &
         trial%offset), self%sampling%sample_times)
      if (real(size(self%measured), wp)*local%columns() <= most_numbers) &
         matrix = local%matrix(self%sampling%sample_times, self%measured)
   end subroutine localize

   !> Condenses the rows of a free decay near given parameters. Arguments as of `observed_data_t`.
   subroutine condense_near(self, trial, local, y, dy, linear, work, error, first, is_done)
      class(time_record_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      type(local_decay_t), intent(in) :: local
      real(wp), allocatable, intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(seen_modes_t), intent(inout) :: first
      logical, intent(out) :: is_done
      type(free_mode_t), allocatable :: modes(:)
      type(seen_modes_t) :: before

      is_done = .false.
      if (.not. allocated(local%rows%y)) return
      before = first
      call self%find_decay(trial, first, modes, is_done, work, error)
      if (allocated(error)) return
      if (is_done) is_done = local%covers([modes%s], first%begin, merge(self%scale, 0.0_wp, &
         trial%offset))
      if (.not. is_done) then
         first = before
         return
      end if
      call set_weights(modes, from_acceleration, size(trial%parameters), trial%offset, linear)
      allocate (dy(0, size(trial%parameters)))
      call linear%take_condensed(local%near([modes%s]), y, dy, 0)
   end subroutine condense_near

   !> Finds the free modes of a long record, if the rows of its decay can be condensed. Arguments as
   !> of `evaluate`.
   !>
   !> first     unchanged if the rows cannot be condensed
   !> modes     of the excitation
   !> is_decay  .false.: the record is short or no free decay, or modes form a cluster
   subroutine find_decay(self, trial, first, modes, is_decay, work, error)
      class(time_record_t), intent(in) :: self
      type(trial_t), intent(in) :: trial
      type(seen_modes_t), intent(inout) :: first
      type(free_mode_t), allocatable, intent(out) :: modes(:)
      logical, intent(out) :: is_decay
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), allocatable, target :: equations
      type(seen_modes_t) :: before
      integer :: k

      is_decay = self%has_rows(trial%excitation)
      if (.not. is_decay) return
      before = first
      equations = new_equations(trial%model%galerkin, trial%structure, trial%excitation, &
         matrices=.false.)
      call self%find_modes(trial%model, equations, trial%excitation%modes, trial%parameters, &
         first, modes, work, error)
      if (allocated(error)) return
      is_decay = .not. any([(allocated(modes(k)%cluster), k=1, size(modes))])
      if (.not. is_decay) first = before
   end subroutine find_decay

   !> Returns whether the record is long and a free decay.
   pure logical function has_rows(self, excitation)
      class(time_record_t), intent(in) :: self
      type(excitation_t), intent(in) :: excitation

      has_rows = excitation%modes > 0 .and. size(self%measured) >= few_rows .and. &
         self%sampling%observation%formula == from_acceleration
   end function has_rows

   !> Computes all rows of a free decay. Arguments as of `observed_data_t`.
   subroutine expand(self, linear, weights, r, jac)
      class(time_record_t), intent(in), target :: self
      type(linear_t), intent(inout) :: linear
      real(wp), intent(in) :: weights(:, :)
      real(wp), intent(inout) :: r(:), jac(:, :)

      select type (rows => linear%rows)
      type is (decay_rows_t)
         rows%times => self%sampling%sample_times
         rows%measured => self%measured
         call rows%expand(weights, r, jac)
      end select
   end subroutine expand

   !> Finds the free modes as this channel measures them. Arguments as of `evaluate`.
   !>
   !> count  number of modes
   !> modes  (count)
   subroutine find_modes(self, model, equations, count, parameters, first, modes, work, error)
      class(time_record_t), intent(in) :: self
      type(meshed_model_t), intent(inout) :: model
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: count, parameters(:)
      type(seen_modes_t), intent(inout) :: first
      type(free_mode_t), allocatable, intent(out) :: modes(:)
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      allocate (modes(0))
      select type (solver => model%solver)
      class is (exact_solver_t)
         if (count > 0) call solver%free_modes(equations, parameters, count, modes, work, error)
      class default
         if (count > 0) call failure(error, 'this method has no modes')
      end select
      if (allocated(error)) return
      if (allocated(self%deviation)) modes%s = modes%s + self%deviation(:count)
      if (.not. allocated(first%modes)) then
         first%begin = self%sampling%sample_times(1)
         first%modes = modes
         return
      end if
      do k = 1, count
         if (.not. abs(first%modes(k)%seen) > 0 .or. .not. abs(modes(k)%seen) > 0) then
            call failure(error, 'mode '//to_text(k)//' nearly coincides with another, so '// &
               'that its amplitudes in two channels cannot be compared')
            return
         end if
         call modes(k)%as_seen_beside(first%modes(k))
      end do
   end subroutine find_modes

   !> Computes the linear unknowns: the two motions of each free mode, and the offset. Arguments as
   !> of `evaluate`.
   !>
   !> count  number of modes
   subroutine free_motion(self, model, equations, count, parameters, offset, first, linear, &
      work, error)
      class(time_record_t), intent(in) :: self
      type(meshed_model_t), intent(inout) :: model
      type(equations_t), intent(in), target :: equations
      integer, intent(in) :: count, parameters(:)
      logical, intent(in) :: offset
      type(seen_modes_t), intent(inout) :: first
      type(linear_t), intent(out) :: linear
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      type(free_mode_t), allocatable :: modes(:)
      complex(wp), allocatable :: states(:, :)
      integer :: b, i, k, n

      call self%find_modes(model, equations, count, parameters, first, modes, work, error)
      if (allocated(error)) return
      call set_weights(modes, self%sampling%observation%formula, size(parameters), offset, linear)
      allocate (linear%basis(size(self%sampling%sample_times), size(linear%weights, 1)))
      b = 0
      do k = 1, count
         states = modes(k)%states(self%sampling%times - first%begin)
         n = size(states, 2)
         do i = 1, n
            linear%basis(:, b + i) = self%sampling%of_motion(real(states(:, i)))
            linear%basis(:, b + n + i) = self%sampling%of_motion(aimag(states(:, i)))
         end do
         b = b + 2*n
      end do
      if (offset) linear%basis(:, b + 1) = self%scale
   end subroutine free_motion

end module beamid_time_records
