!> Follows a parameter through a long record: fits consecutive windows, each from the result of the
!> window before, while the samples arrive.
!>
!> Each window is a free decay with its own amplitudes and its own values of all free parameters.
!> Gauss-Newton steps from the estimates of the window before find its minimum, mostly with a single
!> evaluation. With a `rate`, the prior of the followed parameter is a random walk from the last
!> window without a flag that shares no sample with this one, so that no sample counts twice.
!>
!> A window in which the parameter moves is recognised by its misfit: residuals that are not spread
!> evenly over the window, a large unexplained share of the energy, or halves of the window that
!> contradict each other. The first window and windows that move are searched for other minima, at
!> most eight times in the length of a window, over the range that the parameter may have reached.
module beamid_tracker
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: as_named
   use beamid_simulation, only: model_t
   use beamid_statistics, only: unlimited
   use beamid_tracked_windows, only: track_plan_t, tracked_t
   use beamid_unknowns, only: name_length, quantity_t, stage_t
   use beamid_variables, only: unbounded
   use beamid_window_judgements, only: flag_of, noise_of, precision_of, precision_t
   use beamid_window_searches, only: found_t, largest_change, new_window_search, &
      window_search_t, window_segments
   implicit none
   private

   public :: tracker_t, new_tracker

   !> A window that was not flagged.
   type :: memory_t
      real(wp) :: middle = 0, last = 0       !< of the window [time]
      real(wp) :: value = 0, variance = 0    !< of the searched variable
   end type memory_t

   !> Follows a parameter. Samples come in by `take`.
   type :: tracker_t
      type(track_plan_t) :: plan
      type(quantity_t), allocatable :: quantities(:)      !< (n) the free parameters
      integer :: which = 0                                !< place of the parameter among them
      character(len=name_length) :: name = ''             !< of the parameter
      integer :: elements = 0                             !< of the mesh
      !> relative error of the natural frequencies that the mesh causes
      real(wp) :: mesh_error = 0
      type(window_search_t), private :: search
      !> (n + 2 modes) as `p` of `found_t`
      real(wp), allocatable, private :: estimate(:)       !< of the last window with a fit
      real(wp), allocatable, private :: trusted(:)        !< of the last window without a flag
      type(memory_t), allocatable, private :: memory(:)   !< by time
      real(wp), allocatable, private :: t(:), z(:)        !< samples that later windows may use
      integer, private :: held = 0                        !< number of them
      integer, private :: windows = 0                     !< number of finished windows
      !> first sample after the last empty window [time], and number of windows since then
      real(wp), private :: begin = 0
      integer, private :: since = 0
      !> least mean square of the residuals of any window so far; starts at 1 if `sd` is stated
      real(wp), private :: floor = huge(1.0_wp)
      real(wp), private :: basin = unbounded   !< half width of the narrowest minimum so far
      real(wp), private :: searched = -huge(1.0_wp)   !< time of the last search for other minima
   contains
      procedure :: take
      procedure, private :: fit_window, look_around, judge, remember, extrapolate, reach
   end type tracker_t

   !> Largest number of elements that a refinement tries, and a mesh error that needs no refinement.
   integer, parameter :: finest = 64
   real(wp), parameter :: precise = 2e-4_wp
   !> Safety factor on the change to a mesh of twice as many elements: a support inside an element
   !> makes the convergence irregular, and the errors of all modes have the same sign.
   real(wp), parameter :: mesh_errors = 3
   !> Least relative error of a frequency: it keeps the equations regular.
   real(wp), parameter :: least_error = 1e-9_wp

contains

   !> Makes a tracker that has seen no samples.
   !>
   !> The change of the natural frequencies to a mesh of twice as many elements is part of the error
   !> of the model.
   !>
   !> model, experiment  as in `new_window_search`
   !> mesh     coarsest mesh; a finer one is used if it `refines`
   !> refines  whether to refine the mesh until its error is far below the other errors
   !> stage    free parameters; the followed one is among them
   !> error    the model cannot be computed; no start values
   subroutine new_tracker(model, mesh, refines, experiment, stage, plan, tracker, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      logical, intent(in) :: refines
      type(experiment_t), intent(in) :: experiment
      type(stage_t), intent(in) :: stage
      type(track_plan_t), intent(in) :: plan
      type(tracker_t), intent(out) :: tracker
      type(error_t), allocatable, intent(out) :: error
      type(window_search_t) :: finer
      type(quantity_t), allocatable :: quantities(:)
      type(mesh_t) :: used

      tracker%plan = plan
      tracker%which = findloc(stage%free, plan%parameter, dim=1)
      used = mesh
      do
         call new_window_search(model, used, experiment, stage, tracker%which, tracker%search, &
            tracker%quantities, error)
         if (allocated(error)) return
         tracker%elements = used%elements
         used%elements = 2*used%elements
         call new_window_search(model, used, experiment, stage, tracker%which, finer, quantities, &
            error)
         if (allocated(error)) return
         tracker%mesh_error = mesh_errors*largest_change(tracker%search, finer)
         if (.not. refines .or. tracker%elements >= finest) exit
         if (tracker%mesh_error <= max(precise, plan%frequency_error/10)) exit
      end do
      tracker%search%frequency_error = hypot(plan%frequency_error, max(tracker%mesh_error, &
         least_error))
      tracker%estimate = [tracker%search%variables%start, 0*tracker%search%omega, &
         0*tracker%search%omega]
      tracker%trusted = tracker%estimate
      allocate (tracker%memory(0), tracker%t(4096), tracker%z(4096))
      if (tracker%search%problem%is_weighted()) tracker%floor = 1
      associate (q => tracker%quantities(tracker%which))
         tracker%name = q%name
         if (q%is_reciprocal() .and. plan%rate < unlimited) tracker%plan%rate = plan%rate/q%start**2
      end associate
   end subroutine new_tracker

   !> Takes samples, and fits every window that they complete.
   !>
   !> t, z   (m) times, ascending, later than those before [time], and accelerations
   !> rows   result of each completed window
   !> error  interrupted by the user
   subroutine take(self, t, z, rows, error)
      class(tracker_t), intent(inout) :: self
      real(wp), intent(in) :: t(:), z(:)
      type(tracked_t), allocatable, intent(out) :: rows(:)
      type(error_t), allocatable, intent(out) :: error
      type(tracked_t) :: row
      real(wp) :: first, before, after
      integer :: from, k, m, to
      !> Rounding of a time in units of a window.
      real(wp), parameter :: slack = 1e-9_wp

      allocate (rows(0))
      m = size(t)
      if (m == 0) return
      if (self%held == 0 .and. self%since == 0) self%begin = t(1)
      if (self%held + m > size(self%t)) then
         self%t = [self%t(:self%held), spread(0.0_wp, 1, self%held + 2*m)]
         self%z = [self%z(:self%held), spread(0.0_wp, 1, self%held + 2*m)]
      end if
      self%t(self%held + 1:self%held + m) = t
      self%z(self%held + 1:self%held + m) = z
      self%held = self%held + m
      from = 1
      to = 0
      do
         first = self%begin + self%since*self%plan%hop - slack*self%plan%window
         if (self%t(self%held) < first + self%plan%window) exit
         do while (self%t(from) < first)
            from = from + 1
         end do
         to = max(to, from - 1)
         do while (self%t(to + 1) < first + self%plan%window)
            to = to + 1
         end do
         call cpu_time(before)
         call self%fit_window(self%t(from:to), self%z(from:to), row, error)
         if (allocated(error)) return
         call cpu_time(after)
         self%since = self%since + 1
         if (from > to) then
            ! One row stands for all empty windows of a gap.
            row%first = first + slack*self%plan%window
            row%last = row%first + self%plan%window
            self%begin = self%t(from)
            self%since = 0
         end if
         row%milliseconds = 1e3_wp*(after - before)
         rows = [rows, row]
         self%windows = self%windows + 1
      end do
      do k = from, self%held
         self%t(k - from + 1) = self%t(k)
         self%z(k - from + 1) = self%z(k)
      end do
      self%held = self%held - from + 1
   end subroutine take

   !> Fits and judges one window.
   !>
   !> error  interrupted by the user
   subroutine fit_window(self, t, z, row, error)
      class(tracker_t), intent(inout) :: self
      real(wp), intent(in) :: t(:), z(:)
      type(tracked_t), intent(out) :: row
      type(error_t), allocatable, intent(out) :: error
      type(found_t) :: found, other
      real(wp) :: total
      integer :: unknowns
      logical :: is_due

      row%flag = 'gap'
      unknowns = size(self%estimate) + self%search%problem%linear_unknowns()
      total = (norm2(z - sum(z)/max(1, size(z)))*self%search%problem%weight(1))**2
      if (size(t) >= 2*unknowns + window_segments .and. .not. total > 0) row%flag = 'unseen'
      if (size(t) < 2*unknowns + window_segments .or. .not. total > 0) then
         if (size(t) > 0) row = tracked_t(first=t(1), last=t(size(t)), flag=row%flag)
         call self%extrapolate(row)
         return
      end if
      row%first = t(1)
      row%last = t(size(t))
      call self%search%set_window(t, z)
      call self%reach(t(1), (t(1) + t(size(t)))/2, self%search%centre, self%search%variance)
      call self%search%descend(self%estimate, found, error)
      if (allocated(error)) return
      self%floor = min(self%floor, noise_of(found))
      row%flag = flag_of(found, total, self%floor)
      is_due = row%first - self%searched >= self%plan%window/8
      if (is_due .and. (self%windows == 0 .or. row%flag == 'moving')) then
         self%searched = row%first
         call self%look_around(row%first, row%last, other, error)
         if (allocated(error)) return
         if (other%sum_of_squares < found%sum_of_squares) then
            found = other
            self%floor = min(self%floor, noise_of(found))
            row%flag = flag_of(found, total, self%floor)
         end if
      end if
      call self%judge(found, total, row)
   end subroutine fit_window

   !> Returns where the random walk starts, and its variance at a time; `unlimited` if there is no
   !> limit.
   !>
   !> first   the windows before end before this time
   !> at      time of the variance
   pure subroutine reach(self, first, at, centre, variance)
      class(tracker_t), intent(in) :: self
      real(wp), intent(in) :: first, at
      real(wp), intent(out) :: centre, variance
      integer :: k

      centre = self%trusted(self%which)
      variance = unlimited
      if (.not. self%plan%rate < unlimited) return
      do k = size(self%memory), 1, -1
         if (self%memory(k)%last >= first) cycle
         centre = self%memory(k)%value
         variance = self%memory(k)%variance + self%plan%rate**2*(at - self%memory(k)%middle)
         return
      end do
   end subroutine reach

   !> Looks for another minimum over the range that the parameter may have reached.
   !>
   !> found  as `descend` returns it, from the best point of a grid
   !> error  interrupted by the user
   subroutine look_around(self, first, last, found, error)
      class(tracker_t), intent(inout) :: self
      real(wp), intent(in) :: first, last
      type(found_t), intent(out) :: found
      type(error_t), allocatable, intent(out) :: error
      !> Largest number of points at the beginning, and later.
      integer, parameter :: first_points = 400, later_points = 160
      real(wp) :: range(2), start(size(self%trusted)), centre, variance
      integer :: points
      logical :: is_found

      start = self%trusted
      start(size(self%quantities) + 1:) = 0
      associate (v => self%search%variables(self%which), value => self%trusted(self%which))
         range = [v%lower, v%upper]
         if (.not. (v%lower > -unbounded .and. v%upper < unbounded)) &
            range = [max(v%lower, min(value/3, 3*value)), min(v%upper, max(value/3, 3*value))]
      end associate
      call self%reach(first, last, centre, variance)
      if (variance < unlimited) range = [max(range(1), centre - 3*sqrt(variance)), &
         min(range(2), centre + 3*sqrt(variance))]
      points = merge(first_points, later_points, self%windows == 0)
      if (self%basin < unbounded) points = max(1, min(points, &
         ceiling(2*(range(2) - range(1))/max(self%basin, tiny(centre)))))
      call self%search%look_around(range, points, start, is_found, error)
      if (is_found .and. .not. allocated(error)) call self%search%descend(start, found, error)
   end subroutine look_around

   !> Computes the estimate of a window and its interval.
   !>
   !> total  energy of the window about its mean, in weighted rows
   subroutine judge(self, found, total, row)
      class(tracker_t), intent(inout) :: self
      type(found_t), intent(in) :: found
      real(wp), intent(in) :: total
      type(tracked_t), intent(inout) :: row
      type(precision_t) :: precision

      if (row%flag /= 'unseen') precision = precision_of(found, self%which)
      if (row%flag == 'unseen' .or. .not. precision%variance > 0) then
         row%flag = 'unseen'
         call self%extrapolate(row)
         if (.not. found%sum_of_squares < total) return
         row%misfit = found%sum_of_squares/total
         row%estimate = as_named(self%plan%parameter, found%p(self%which) &
            + found%step%change(self%which))
         row%lower = min(row%lower, row%estimate)
         row%upper = max(row%upper, row%estimate)
         return
      end if
      row%misfit = found%sum_of_squares/total
      if (precision%contradicts .and. row%flag == '') row%flag = 'moving'
      self%estimate = self%search%move(found%p, found%step%change)
      associate (q => self%quantities(self%which))
         q%searched = self%estimate(self%which)
         call place(q, precision%half_width, row)
      end associate
      if (row%flag == '') call self%remember(row, found, precision%variance, total)
   end subroutine judge

   !> Sets estimate and limits of a row from the searched variable of a quantity.
   pure subroutine place(q, half, row)
      type(quantity_t), intent(inout) :: q
      real(wp), intent(in) :: half
      type(tracked_t), intent(inout) :: row
      real(wp) :: limits(2)

      q%value = as_named(q%parameter, q%searched)
      limits = q%ends([half, half])
      row%estimate = q%value
      row%lower = limits(1)
      row%upper = limits(2)
   end subroutine place

   !> Keeps a window without a flag as a start of the random walk and of searches.
   subroutine remember(self, row, found, variance, total)
      class(tracker_t), intent(inout) :: self
      type(tracked_t), intent(in) :: row
      type(found_t), intent(in) :: found
      real(wp), intent(in) :: variance, total
      integer :: first

      self%trusted = self%estimate
      self%basin = min(self%basin, &
         sqrt(max(0.0_wp, total - found%sum_of_squares)*found%step%inverse(self%which, self%which)))
      ! All that a later window may start from, and one more.
      first = max(1, findloc(self%memory%last >= row%first, .true., dim=1) - 1)
      if (size(self%memory) > 0) then
         if (self%memory(size(self%memory))%last < row%first) first = size(self%memory)
      end if
      self%memory = [self%memory(first:), memory_t((row%first + row%last)/2, row%last, &
         self%estimate(self%which), variance)]
   end subroutine remember

   !> Sets a row of a window that says nothing: the last value, with what the random walk allows.
   subroutine extrapolate(self, row)
      class(tracker_t), intent(in) :: self
      type(tracked_t), intent(inout) :: row
      type(quantity_t) :: q
      real(wp) :: centre, half, variance

      q = self%quantities(self%which)
      call self%reach(row%first, row%last, centre, variance)
      q%searched = centre
      half = unbounded
      if (variance < unlimited) half = 1.960_wp*sqrt(variance)
      call place(q, half, row)
      if (.not. half < unbounded) then
         row%lower = q%lower
         row%upper = q%upper
      end if
      row%misfit = 1
   end subroutine extrapolate

end module beamid_tracker
