!> The same fit from several starts: which minima there are, and how often each is found.
module beamid_multistart
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: identify, model_t, outcome_t, stage_fit_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_noise, only: uniform_noise
   use beamid_parameters, only: as_named, free_magnitude, get_free, parameters
   use beamid_unknowns, only: stage_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: multistart_t, minimum_t, identify_from_many

   !> How many starts, and how far apart.
   type :: multistart_t
      integer :: n = 0              !< 0: the declared start alone
      integer :: seed = 1
      !> starts lie between the declared one divided by this and times this, > 1
      real(wp) :: spread = 3
   end type multistart_t

   !> One of the minima found.
   type :: minimum_t
      integer :: count = 0
      type(stage_fit_t), allocatable :: fits(:)
   end type minimum_t

   !> Fits whose sums of squares and estimates agree so well have found the same minimum.
   real(wp), parameter :: same_sum = 1e-6_wp, same_estimate = 1e-3_wp

contains

   !> Runs all stages on one mesh from the declared start and from n - 1 others of the first stage,
   !> as many at a time as there are threads. The same seed gives the same starts.
   !>
   !> minima    ascending J
   !> failures  how many starts failed
   !> error     that of the declared start, where every start failed
   !> check     .false.: derivatives are not compared with differences
   subroutine identify_from_many(model, mesh, stages, experiments, plan, minima, failures, error, &
      monitor, check)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(multistart_t), intent(in) :: plan
      type(minimum_t), allocatable, intent(out) :: minima(:)
      integer, intent(out) :: failures
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check
      type(outcome_t), allocatable :: outcomes(:)
      integer :: finished, k

      allocate (outcomes(plan%n), minima(0))
      finished = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, plan%n
         if (interrupted()) cycle
         call identify(model, mesh, from_elsewhere(model, stages, plan, k), experiments, &
            outcomes(k)%fits, outcomes(k)%error, monitor, check)
         !$omp critical (one_start_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, plan%n, &
            'starts')
         !$omp end critical (one_start_done)
      end do
      !$omp end parallel do
      failures = 0
      call check_interrupt(error)
      if (allocated(error)) return
      do k = 1, plan%n
         if (allocated(outcomes(k)%error)) then
            failures = failures + 1
         else
            call collect(minima, outcomes(k)%fits)
         end if
      end do
      if (size(minima) == 0) call move_alloc(outcomes(1)%error, error)
   end subroutine identify_from_many

   !> The stages with start k in the first of them; the first is the declared one.
   function from_elsewhere(model, stages, plan, k) result(moved)
      type(model_t), intent(in) :: model
      type(stage_t), intent(in) :: stages(:)
      type(multistart_t), intent(in) :: plan
      integer, intent(in) :: k
      type(stage_t), allocatable :: moved(:)
      real(wp) :: u(size(stages(1)%free)), value
      integer :: p

      moved = stages
      if (k == 1) return
      u = uniform_noise(size(u), plan%seed + 7919*k)
      associate (first => moved(1))
         first%automatic = .false.
         call first%set_bounds()
         if (.not. allocated(first%start)) first%start = &
            [(as_named(first%free(p), get_free(model%structure, model%excitation, &
            first%free(p))), p=1, size(u))]
         do p = 1, size(u)
            value = first%start(p)
            if (.not. abs(value) > 0 .or. value > huge(value)) value = as_named(first%free(p), &
               free_magnitude(model%structure, model%excitation, first%free(p)))
            if (first%upper(p) < unbounded .and. first%lower(p) > -unbounded) then
               value = first%lower(p) + u(p)*(first%upper(p) - first%lower(p))
               ! What may be infinite has no midpoint.
               if (parameters(first%free(p))%is_reciprocal .and. first%lower(p) > 0) value = &
                  first%lower(p)*(first%upper(p)/first%lower(p))**u(p)
            else
               value = value*plan%spread**(2*u(p) - 1)
            end if
            first%start(p) = min(max(value, first%lower(p)), first%upper(p))
         end do
      end associate
   end function from_elsewhere

   !> Counts a fit with the minimum it has found, or as a new one at its place.
   subroutine collect(minima, fits)
      type(minimum_t), allocatable, intent(inout) :: minima(:)
      type(stage_fit_t), intent(in) :: fits(:)
      type(minimum_t), allocatable :: longer(:)
      integer :: k, place

      place = 1
      do k = 1, size(minima)
         associate (old => minima(k)%fits(size(fits)), new => fits(size(fits)))
            if (same(old, new)) then
               minima(k)%count = minima(k)%count + 1
               return
            end if
            if (old%fit%J <= new%fit%J) place = k + 1
         end associate
      end do
      allocate (longer(size(minima) + 1))
      longer(:place - 1) = minima(:place - 1)
      longer(place)%count = 1
      longer(place)%fits = fits
      longer(place + 1:) = minima(place:)
      call move_alloc(longer, minima)
   end subroutine collect

   !> Whether two fits have found the same minimum.
   pure logical function same(a, b)
      type(stage_fit_t), intent(in) :: a, b

      same = abs(a%fit%J - b%fit%J) <= same_sum*max(a%fit%J, b%fit%J) .and. &
         all(abs(a%fit%estimate - b%fit%estimate) <= same_estimate &
         *max(abs(a%fit%estimate), abs(b%fit%estimate)))
   end function same

end module beamid_multistart
