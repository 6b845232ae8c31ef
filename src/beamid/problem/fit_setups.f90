!> The setup of a fit: its records with their weights, its priors and penalties, and the parameters
!> that are free.
!>
!> This module defines the rows of the residual vector. `beamid_residuals` computes them.
module beamid_fit_setups
   use beamid_autoregression, only: autoregression_t
   use beamid_experiments, only: is_first, prepared_experiment_t
   use beamid_field_penalties, only: fields, penalty_count
   use beamid_kinds, only: wp
   use beamid_priors, only: prior_t, priors_of
   use beamid_problems, only: smooth_problem_t
   use beamid_structure, only: coefficient_at, is_coefficient
   use beamid_unknowns, only: scenario_t, stage_t
   implicit none
   private

   public :: fit_setup_t, set_free

   !> All data of a fit, except the values of the free parameters.
   type, abstract, extends(smooth_problem_t) :: fit_setup_t
      type(prepared_experiment_t), allocatable :: parts(:)   !< (records)
      !> (records) 1/noise; 1 for a single record whose noise is not stated
      real(wp), allocatable :: weight(:)
      !> (records) autoregression that whitens the noise of each record; not allocated: white noise
      type(autoregression_t), allocatable :: colour(:)
      type(prior_t), allocatable :: priors(:)
      real(wp) :: noise = 1                !< standard deviation of a weighted sample
      !> strengths of the penalties on E(x) and c_D(x) [units of J]; 0: no penalty
      real(wp) :: strength(fields) = 0
      type(scenario_t) :: scenario         !< values of all parameters before the search
      integer, allocatable :: free(:)      !< (n) numbers of the free parameters in `parameters`
      integer, allocatable :: record(:)    !< (n) record each of them belongs to; 0: all records
      logical :: offset = .false.          !< whether the offset of each sensor is unknown
   contains
      procedure :: samples, samples_in
      procedure :: first_rows
      procedure :: sequence
      procedure :: are_ordered
      procedure :: group_rows
      procedure :: is_all_time
      procedure :: knows_noise
      procedure :: rows
      procedure :: prior_rows
      procedure :: penalty_rows
      procedure :: field_columns
      procedure :: linear_unknowns
      procedure :: offset_is_unknown
      procedure :: is_weighted
      procedure :: is_estimated
      procedure :: guess_noise
      procedure :: without_weights
      procedure :: last_channel
      procedure :: with
   end type fit_setup_t

contains

   !> Makes the free parameters of a stage those of a fit.
   subroutine set_free(problem, stage)
      class(fit_setup_t), intent(inout) :: problem
      type(stage_t), intent(in) :: stage

      problem%free = stage%free
      problem%record = stage%owners()
      problem%offset = stage%offset
   end subroutine set_free

   !> Returns the number of measured values of all records together.
   pure integer function samples(self)
      class(fit_setup_t), intent(in) :: self

      samples = self%samples_in(1, size(self%parts))
   end function samples

   !> Returns the number of measured values of records `first` to `last` together.
   pure integer function samples_in(self, first, last)
      class(fit_setup_t), intent(in) :: self
      integer, intent(in) :: first, last
      integer :: i

      samples_in = 0
      do i = first, last
         samples_in = samples_in + size(self%parts(i)%observed%measured)
      end do
   end function samples_in

   !> Returns the row of the first sample of each record (records).
   pure function first_rows(self)
      class(fit_setup_t), intent(in) :: self
      integer :: first_rows(size(self%parts)), i

      first_rows(1) = 1
      do i = 2, size(first_rows)
         first_rows(i) = first_rows(i - 1) + size(self%parts(i - 1)%observed%measured)
      end do
   end function first_rows

   !> Returns the rows in which a test for white noise makes sense, in order.
   pure function sequence(self) result(rows)
      class(fit_setup_t), intent(in) :: self
      integer, allocatable :: rows(:)
      integer :: first(size(self%parts)), i

      first = self%first_rows()
      rows = [(self%parts(i)%observed%sequence() + first(i) - 1, i=1, size(self%parts))]
   end function sequence

   !> Divides the rows of data into groups: records, and the resonances of a frequency response.
   !>
   !> residual  (samples) weighted residuals of a fit
   !> group     (samples) number of the group of each row, ascending
   !> groups    (0:records) number of all groups, and of those of each record
   pure subroutine group_rows(self, residual, group, groups)
      class(fit_setup_t), intent(in) :: self
      real(wp), intent(in) :: residual(:)
      integer, intent(out) :: group(:), groups(0:)
      integer :: i, row

      groups(0) = 0
      row = 0
      do i = 1, size(self%parts)
         associate (observed => self%parts(i)%observed, m => size(self%parts(i)%observed%measured))
            associate (own => group(row + 1:row + m))
               own = observed%groups(residual(row + 1:row + m)/self%weight(i))
               groups(i) = maxval(own)
               own = own + groups(0)
            end associate
            groups(0) = groups(0) + groups(i)
            row = row + m
         end associate
      end do
   end subroutine group_rows

   !> Returns for each row of data (samples) whether it is part of a time record, so that its noise
   !> may depend on that of the row before.
   pure function are_ordered(self)
      class(fit_setup_t), intent(in) :: self
      logical :: are_ordered(self%samples())
      integer :: i, row

      row = 0
      do i = 1, size(self%parts)
         associate (m => size(self%parts(i)%observed%measured))
            are_ordered(row + 1:row + m) = self%parts(i)%observed%kind() == 'time'
            row = row + m
         end associate
      end do
   end function are_ordered

   !> Returns whether all records are functions of time.
   pure logical function is_all_time(self)
      class(fit_setup_t), intent(in) :: self
      integer :: i

      is_all_time = all([(self%parts(i)%observed%kind() == 'time', i=1, size(self%parts))])
   end function is_all_time

   !> Returns whether the noise of all data is known before the fit.
   pure logical function knows_noise(self)
      class(fit_setup_t), intent(in) :: self
      integer :: i

      knows_noise = all([(self%parts(i)%observed%noise_is_known, i=1, size(self%parts))])
   end function knows_noise

   !> Returns the number of all rows: samples, priors and penalties.
   pure integer function rows(self)
      class(fit_setup_t), intent(in) :: self
      integer :: first, n

      call self%penalty_rows(fields, first, n)
      rows = first + n - 1
   end function rows

   !> Returns the number of rows that belong to priors of free parameters.
   pure integer function prior_rows(self)
      class(fit_setup_t), intent(in) :: self

      prior_rows = 0
      if (size(self%priors) > 0) prior_rows = count(priors_of(self%priors, self%free, &
         self%record) > 0)
   end function prior_rows

   !> Returns the rows of the penalty on one field.
   !>
   !> a      number of the field: 1 for E(x), 2 for c_D(x)
   !> first  its first row
   !> rows   the number of its rows; 0 if it has no penalty
   pure subroutine penalty_rows(self, a, first, rows)
      class(fit_setup_t), intent(in) :: self
      integer, intent(in) :: a
      integer, intent(out) :: first, rows
      integer :: k

      first = self%samples() + self%prior_rows() + 1
      rows = 0
      do k = 1, a
         first = first + rows
         rows = 0
         if (self%strength(k) > 0) rows = penalty_count(size(self%field_columns(k)))
      end do
   end subroutine penalty_rows

   !> Returns the indices of the coefficients of a field among the free parameters; an empty array
   !> if not all of them are free.
   !>
   !> a  number of the field: 1 for E(x), 2 for c_D(x)
   pure function field_columns(self, a) result(columns)
      class(fit_setup_t), intent(in) :: self
      integer, intent(in) :: a
      integer, allocatable :: columns(:)
      integer :: coefficients, k

      allocate (columns(0))
      if (.not. any(is_coefficient(self%free))) return
      coefficients = self%scenario%structures(1)%variations%along(a)%coefficients
      if (coefficients == 0) return
      columns = [(findloc(self%free, coefficient_at(k, a), dim=1), k=1, coefficients)]
      if (any(columns == 0)) columns = [integer ::]
   end function field_columns

   !> Returns the number of linear unknowns: two for each mode of each free motion, and one for each
   !> unknown offset.
   pure integer function linear_unknowns(self)
      class(fit_setup_t), intent(in) :: self
      integer :: i

      linear_unknowns = count([(self%offset_is_unknown(i), i=1, size(self%parts))]) + 2*sum( &
         self%scenario%excitations%modes, mask=is_first([(self%parts(i)%observed%motion, &
         i=1, size(self%parts))]))
   end function linear_unknowns

   !> Tells whether the offset of record i is a linear unknown.
   pure logical function offset_is_unknown(self, i)
      class(fit_setup_t), intent(in) :: self
      integer, intent(in) :: i

      offset_is_unknown = self%offset .and. self%parts(i)%observed%has_offset
   end function offset_is_unknown

   !> Returns the last record of the motion whose first channel is record i.
   pure integer function last_channel(self, i) result(last)
      class(fit_setup_t), intent(in) :: self
      integer, intent(in) :: i

      last = i
      if (self%parts(i)%observed%motion == 0) return
      do while (last < size(self%parts))
         if (self%parts(last + 1)%observed%motion /= self%parts(i)%observed%motion) exit
         last = last + 1
      end do
   end function last_channel

   !> Tells whether the residuals are in units of the noise: with several records, or if the noise
   !> of a record is stated.
   pure logical function is_weighted(self)
      class(fit_setup_t), intent(in) :: self

      is_weighted = size(self%parts) > 1 .or. .not. all(self%is_estimated())
   end function is_weighted

   !> Tells for each record (records) whether its noise has to be estimated, because the user has
   !> not stated it. A single record needs its noise only to weigh it against priors.
   pure function is_estimated(self)
      class(fit_setup_t), intent(in) :: self
      logical :: is_estimated(size(self%parts))
      integer :: i

      is_estimated = [(.not. allocated(self%parts(i)%observed%sd), i=1, size(self%parts))]
   end function is_estimated

   !> Sets weights and noise before the first search: the stated noise, or else a twentieth of the
   !> standard deviation of the record.
   subroutine guess_noise(self)
      class(fit_setup_t), intent(inout) :: self
      real(wp) :: sd
      integer :: i

      self%weight = spread(1.0_wp, 1, size(self%parts))
      self%noise = 1
      do i = 1, size(self%parts)
         associate (observed => self%parts(i)%observed, z => self%parts(i)%observed%measured)
            if (allocated(observed%sd)) then
               self%weight(i) = 1/observed%sd
               cycle
            end if
            sd = 0.05_wp*norm2(z - sum(z)/max(1, size(z)))/sqrt(real(max(1, size(z)), wp))
            if (.not. sd > 0) sd = 1
            if (self%is_weighted()) self%weight(i) = 1/sd
            if (.not. self%is_weighted()) self%noise = sd
         end associate
      end do
   end subroutine guess_noise

   !> Returns the residuals in the unit of the data of each record (samples).
   !>
   !> r  (rows) weighted residuals
   pure function without_weights(self, r) result(plain)
      class(fit_setup_t), intent(in) :: self
      real(wp), intent(in) :: r(:)
      real(wp), allocatable :: plain(:)
      integer :: i, m, row

      plain = r(:self%samples())
      row = 0
      do i = 1, size(self%parts)
         m = size(self%parts(i)%observed%measured)
         plain(row + 1:row + m) = plain(row + 1:row + m)/self%weight(i)
         row = row + m
      end do
   end function without_weights

   !> Returns the scenario with trial values (n) of the free parameters.
   pure type(scenario_t) function with(self, parameters)
      class(fit_setup_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:)
      integer :: k

      with = self%scenario
      do k = 1, size(parameters)
         call with%set(self%free(k), self%record(k), parameters(k))
      end do
   end function with

end module beamid_fit_setups
