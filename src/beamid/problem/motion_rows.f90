!> The rows of a fit, motion by motion: residuals and derivatives with the linear unknowns, in all
!> rows or condensed, their elimination, and all rows from condensed ones.
module beamid_motion_rows
   use beamid_errors, only: error_t
   use beamid_fit_setups, only: fit_setup_t
   use beamid_kinds, only: wp
   use beamid_linear_unknowns, only: linear_t, stack_channels
   use beamid_local_decays, only: local_decay_t
   use beamid_observed_data, only: seen_modes_t, trial_t
   use beamid_projection, only: new_projection, projection_t
   use beamid_responses, only: exact_solver_t, work_t
   use beamid_unknowns, only: scenario_t
   implicit none
   private

   public :: basis_t, motion_rows_t

   !> Columns of a record that are orthonormal.
   type :: basis_t
      real(wp), allocatable :: columns(:, :)   !< (m, k)
   end type basis_t

   !> A fit whose motions can be evaluated.
   type, abstract, extends(fit_setup_t) :: motion_rows_t
      type(work_t) :: work   !< what the solver did in all evaluations
      !> log sqrt(det Phi'Phi) of the last evaluation; Phi: columns of the linear unknowns
      real(wp) :: log_volume = 0
      !> (records) bases of long free decays that hold near given parameters; not allocated: none
      type(local_decay_t), allocatable :: local(:)
   contains
      procedure :: localize
      procedure :: evaluate_motion
      procedure :: condense_motion
      procedure, private :: condense_channel
      procedure :: eliminate
      procedure :: expand_motion
      procedure, private :: weight_channel, whiten_channel
   end type motion_rows_t

contains

   !> Computes the weighted residuals of one motion, the channels one below the other.
   !>
   !> first, last  numbers of the records that are channels of the motion
   !> parameters   (p) numbers of the parameters to differentiate by
   !> y            (m) residuals of the model without its linear unknowns
   !> dy           (m, p) derivatives of y
   !> linear       linear unknowns of the motion; all channels share the modes
   subroutine evaluate_motion(self, scenario, first, last, parameters, y, dy, linear, error)
      class(motion_rows_t), intent(inout) :: self
      type(scenario_t), intent(in) :: scenario
      integer, intent(in) :: first, last, parameters(:)
      real(wp), intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear
      type(error_t), allocatable, intent(out) :: error
      type(linear_t) :: channel(first:last)
      type(seen_modes_t) :: seen
      integer :: i, m, row

      row = 0
      do i = first, last
         m = size(self%parts(i)%observed%measured)
         call self%parts(i)%evaluate(scenario%structures(i), scenario%excitations(i), &
            self%offset_is_unknown(i), parameters, y(row + 1:row + m), dy(row + 1:row + m, :), &
            channel(i), self%work, error, seen)
         if (allocated(error)) return
         call self%weight_channel(i, y(row + 1:row + m), dy(row + 1:row + m, :), channel(i)%basis)
         call self%whiten_channel(i, y(row + 1:row + m), dy(row + 1:row + m, :), channel(i)%basis)
         row = row + m
      end do
      call stack_channels(channel, 2*scenario%excitations(first)%modes, linear)
   end subroutine evaluate_motion

   !> Multiplies the rows of record i by its weight.
   !>
   !> y      (m) residuals
   !> dy     (m, p) derivatives
   !> basis  (m, b) basis functions of the linear unknowns
   pure subroutine weight_channel(self, i, y, dy, basis)
      class(motion_rows_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(inout) :: y(:), dy(:, :), basis(:, :)

      if (.not. self%is_weighted()) return
      y = self%weight(i)*y
      dy = self%weight(i)*dy
      basis = self%weight(i)*basis
   end subroutine weight_channel

   !> Whitens the rows of record i if its noise is autoregressive. Arguments as of
   !> `weight_channel`.
   pure subroutine whiten_channel(self, i, y, dy, basis)
      class(motion_rows_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(inout) :: y(:), dy(:, :), basis(:, :)
      integer :: k

      if (.not. allocated(self%colour)) return
      call self%colour(i)%whiten(y)
      do k = 1, size(dy, 2)
         call self%colour(i)%whiten(dy(:, k))
      end do
      do k = 1, size(basis, 2)
         call self%colour(i)%whiten(basis(:, k))
      end do
   end subroutine whiten_channel

   !> Prepares many evaluations near given parameters: the solvers start from there, and the rows of
   !> long free decays are decomposed once (`beamid_local_decays`).
   !>
   !> parameters  (n)
   !> covariance  (n, n) of the parameters, which tells how far they are expected to vary
   !> bases       (records) orthonormal basis of the columns of each record and of the record
   !>             itself; without rows: the record has none
   subroutine localize(self, parameters, covariance, bases)
      class(motion_rows_t), intent(inout), target :: self
      real(wp), intent(in) :: parameters(:), covariance(:, :)
      type(basis_t), allocatable, intent(out) :: bases(:)
      type(scenario_t), target :: scenario
      type(seen_modes_t) :: seen
      type(error_t), allocatable :: error
      integer, allocatable :: active(:)
      real(wp) :: nothing(0), none(0, 0), r(self%rows()), jac(size(r), size(parameters))
      integer :: i, k

      if (allocated(self%local)) deallocate (self%local)
      allocate (self%local(size(self%parts)), bases(size(self%parts)))
      if (.not. self%exact) return
      call self%jacobian(parameters, r, jac, error)
      if (allocated(error)) return
      scenario = self%with(parameters)
      do i = 1, size(self%parts)
         select type (solver => self%parts(i)%solver)
         class is (exact_solver_t)
            call solver%stay_here()
         end select
         if (self%last_channel(max(1, i - 1)) < i .or. i == 1) seen = seen_modes_t()
         active = pack([(k, k=1, size(parameters))], self%record == 0 .or. self%record == i)
         call self%parts(i)%observed%localize(self%parts(i)%trial(scenario%structures(i), &
            scenario%excitations(i), self%offset_is_unknown(i), self%free(active)), &
            covariance(active, active), self%local(i), bases(i)%columns, self%work, error, seen)
         if (allocated(error)) return
         if (.not. allocated(bases(i)%columns)) cycle
         call self%whiten_channel(i, nothing, none, bases(i)%columns)
         call self%local(i)%decompose(bases(i)%columns)
      end do
   end subroutine localize

   !> Computes the weighted residuals of one motion in condensed rows. Arguments as of
   !> `evaluate_motion`, but y and dy have as many rows as it takes.
   !>
   !> channel  (first:last) linear unknowns of each channel
   !> locally  whether the bases of `localize` may be used; `channel` then cannot tell all rows
   !> last_rows  (first:last) if present, index of the last row of each channel
   subroutine condense_motion(self, scenario, first, last, parameters, locally, y, dy, linear, &
      channel, error, last_rows)
      class(motion_rows_t), intent(inout) :: self
      type(scenario_t), intent(in) :: scenario
      integer, intent(in) :: first, last, parameters(:)
      logical, intent(in) :: locally
      real(wp), allocatable, intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: linear, channel(first:)
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out), optional :: last_rows(first:)
      type(seen_modes_t) :: seen
      real(wp), allocatable :: y_of(:), dy_of(:, :), before(:, :)
      integer :: i

      do i = first, last
         call self%condense_channel(i, scenario, parameters, locally, y_of, dy_of, channel(i), &
            seen, error)
         if (allocated(error)) return
         if (i == first) then
            call move_alloc(y_of, y)
            call move_alloc(dy_of, dy)
         else
            call move_alloc(dy, before)
            allocate (dy(size(y) + size(y_of), size(parameters)))
            dy(:size(y), :) = before
            dy(size(y) + 1:, :) = dy_of
            y = [y, y_of]
         end if
         if (present(last_rows)) last_rows(i) = size(y)
      end do
      call stack_channels(channel, 2*scenario%excitations(first)%modes, linear)
   end subroutine condense_motion

   !> Computes the weighted residuals of record i in condensed rows. Arguments as of
   !> `condense_motion`.
   !>
   !> seen  modes as the first channel of the motion measures them
   subroutine condense_channel(self, i, scenario, parameters, locally, y, dy, channel, seen, error)
      class(motion_rows_t), intent(inout), target :: self
      integer, intent(in) :: i, parameters(:)
      type(scenario_t), intent(in), target :: scenario
      logical, intent(in) :: locally
      real(wp), allocatable, intent(out) :: y(:), dy(:, :)
      type(linear_t), intent(out) :: channel
      type(seen_modes_t), intent(inout) :: seen
      type(error_t), allocatable, intent(out) :: error
      type(trial_t) :: trial
      logical :: is_done
      integer :: m

      is_done = .false.
      trial = self%parts(i)%trial(scenario%structures(i), scenario%excitations(i), &
         self%offset_is_unknown(i), parameters)
      associate (observed => self%parts(i)%observed)
         if (locally .and. allocated(self%local)) call observed%condense_near(trial, &
            self%local(i), y, dy, channel, self%work, error, seen, is_done)
         if (allocated(error)) return
         if (.not. is_done .and. allocated(self%colour)) then
            m = size(observed%measured)
            allocate (y(m), dy(m, size(parameters)))
            call observed%evaluate(trial, y, dy, channel, self%work, error, seen)
            if (allocated(error)) return
            call channel%complete(m, size(parameters))
            call self%whiten_channel(i, y, dy, channel%basis)
            call channel%condense(y, dy)
         else if (.not. is_done) then
            call observed%condense(trial, y, dy, channel, self%work, error, seen)
            if (allocated(error)) return
         end if
      end associate
      call self%weight_channel(i, y, dy, channel%basis)
   end subroutine condense_channel

   !> Eliminates the linear unknowns of one motion.
   !>
   !> adapt  whether the linear unknowns adapt to the parameters in the derivatives
   !> y      (m) residuals
   !> dy     (m, p) their derivatives
   !> phi    (m, k) columns of the linear unknowns; not allocated if there are none
   !> c      (k) linear unknowns
   !> error  the samples cannot tell the linear unknowns apart
   !> weights  (b, 1 + p) weights of the basis in what is added to y and dy
   subroutine eliminate(self, linear, adapt, y, dy, phi, c, error, weights)
      class(motion_rows_t), intent(inout) :: self
      type(linear_t), intent(in) :: linear
      logical, intent(in) :: adapt
      real(wp), intent(inout) :: y(:), dy(:, :)
      real(wp), allocatable, intent(out) :: phi(:, :), c(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable, intent(out), optional :: weights(:, :)
      type(projection_t) :: projection
      real(wp), allocatable :: along(:, :), change(:, :), dc(:, :)
      integer :: k

      allocate (c(size(linear%weights, 2)))
      if (size(c) == 0) return
      phi = linear%columns(0)
      call new_projection(phi, projection, error)
      if (allocated(error)) return
      self%log_volume = self%log_volume + sum([(log(abs(projection%r(k, k))), k=1, size(c))])
      call projection%coefficients(y, c)
      allocate (along(size(c), size(dy, 2)), dc(size(c), size(dy, 2)))
      allocate (change(size(linear%basis, 2), size(dy, 2)))
      call linear%add_change(c, y, dy, along, change)
      if (adapt) call projection%derivatives(along, dy, dc)
      if (.not. present(weights)) return
      allocate (weights(size(change, 1), 1 + size(change, 2)))
      associate (phi_weights => linear%weights(:, :, 0))
         weights(:, 1) = matmul(phi_weights, c)
         weights(:, 2:) = change
         if (adapt) weights(:, 2:) = change + matmul(phi_weights, dc)
      end associate
   end subroutine eliminate

   !> Computes all rows of a motion from its condensed rows, if its observed data allow.
   !>
   !> first, last  numbers of the records that are channels of the motion
   !> active       numbers of the columns of the parameters
   !> column       number of columns before those of the linear unknowns, which are left out if
   !>              `jac` has no more columns; -1: these have no columns, and adapt to the parameters
   !> r, jac       (m) and (m, columns) residuals and derivatives
   !> c            (k) linear unknowns
   !> is_done      .false.: not possible; nothing has been computed
   subroutine expand_motion(self, scenario, first, last, active, column, r, jac, c, is_done, error)
      class(motion_rows_t), intent(inout) :: self
      type(scenario_t), intent(in) :: scenario
      integer, intent(in) :: first, last, active(:), column
      real(wp), intent(inout) :: r(:), jac(:, :)
      real(wp), allocatable, intent(out) :: c(:)
      logical, intent(out) :: is_done
      type(error_t), allocatable, intent(out) :: error
      type(linear_t) :: linear, channels(first:last)
      real(wp), allocatable :: y(:), dy(:, :), phi(:, :), weights(:, :), expansion(:, :)
      real(wp) :: none(0, 0)
      integer :: b, i, m, place, row

      is_done = .not. allocated(self%colour) .and. all([(self%parts(i)%observed%has_rows( &
         scenario%excitations(i)), i=first, last)])
      if (.not. is_done) return
      call self%condense_motion(scenario, first, last, self%free(active), .false., y, dy, linear, &
         channels, error)
      if (allocated(error)) return
      is_done = all([(allocated(channels(i)%rows), i=first, last)])
      if (.not. is_done) return
      call self%eliminate(linear, column < 0, y, dy, phi, c, error, expansion)
      if (allocated(error)) return
      allocate (weights(size(expansion, 1), 1 + size(jac, 2)), source=0.0_wp)
      weights(:, 1) = expansion(:, 1)
      weights(:, 1 + active) = expansion(:, 2:)
      if (column >= 0 .and. size(jac, 2) >= column + size(c)) &
         weights(:, column + 2:column + 1 + size(c)) = linear%weights(:, :, 0)
      row = 0
      place = 0
      do i = first, last
         m = size(self%parts(i)%observed%measured)
         b = channels(i)%rows%columns
         associate (r_of => r(row + 1:row + m), jac_of => jac(row + 1:row + m, :))
            call self%parts(i)%observed%expand(channels(i), weights(place + 1:place + b, :), r_of, &
               jac_of)
            call self%weight_channel(i, r_of, jac_of, none)
         end associate
         row = row + m
         place = place + b
      end do
   end subroutine expand_motion

end module beamid_motion_rows
