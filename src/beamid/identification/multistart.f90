!> Fits from several starts: which minima of J exist, and how often each is found.
module beamid_multistart
   use beamid_errors, only: error_t
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_identification, only: check_fit, misfit_of_fit, model_t, outcome_t, run_stages, &
      stage_fit_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_noise, only: uniform_noise
   use beamid_parameters, only: as_named, free_magnitude, get_free, parameters
   use beamid_unknowns, only: stage_t
   use beamid_variables, only: unbounded
   implicit none
   private

   public :: multistart_t, minimum_t, minima_t, identify_from_many, identify_meshes_from_many

   !> Number and spread of the starts.
   type :: multistart_t
      integer :: n = 0              !< number of starts; 0: the declared start alone
      integer :: seed = 1           !< of the random starts
      !> > 1; starts lie between the declared start divided by `spread` and multiplied by it or, for
      !> a parameter with two finite bounds, between these
      real(wp) :: spread = 3
   end type multistart_t

   !> One of the minima.
   type :: minimum_t
      integer :: count = 0                        !< number of starts that have led there
      type(stage_fit_t), allocatable :: fits(:)   !< (stages)
   end type minimum_t

   !> The minima that the searches from several starts have found on one mesh.
   type :: minima_t
      type(minimum_t), allocatable :: list(:)   !< different minima, by ascending misfit
      integer :: failures = 0                   !< number of starts whose search failed
   end type minima_t

   !> Relative differences of J and of the estimates up to which two fits have found the same
   !> minimum.
   real(wp), parameter :: same_sum = 1e-6_wp, same_estimate = 1e-3_wp

contains

   !> Runs all stages on one mesh from n starts of the first stage: the declared start and n - 1
   !> random starts.
   !>
   !> The starts are computed in parallel. The same seed gives the same starts.
   !>
   !> minima    in the order of ascending misfit: J, or what replaces it (`misfit_of_fit`)
   !> failures  number of starts that failed
   !> error     error of the declared start, if every start failed
   !> monitor   informed of every iteration and of finished starts
   !> check     .false.: exact derivatives are not compared with differences; default .true.
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
      integer, allocatable :: found(:), counts(:)
      integer :: finished, k

      failures = 0
      call check_fit(model, stages, experiments, error)
      if (allocated(error)) return
      allocate (outcomes(plan%n), found(0), counts(0))
      finished = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 1, plan%n
         if (interrupted()) cycle
         call run_stages(model, mesh, stages_from_start(model, stages, plan, k), experiments, &
            outcomes(k)%fits, outcomes(k)%error, monitor, check)
         !$omp critical (one_start_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, plan%n, 'starts')
         !$omp end critical (one_start_done)
      end do
      !$omp end parallel do
      call check_interrupt(error)
      if (allocated(error)) return
      do k = 1, plan%n
         if (allocated(outcomes(k)%error)) then
            failures = failures + 1
         else
            call collect(outcomes, experiments, k, found, counts)
         end if
      end do
      allocate (minima(size(found)))
      do k = 1, size(found)
         minima(k)%count = counts(k)
         call move_alloc(outcomes(found(k))%fits, minima(k)%fits)
      end do
      if (size(minima) == 0) call move_alloc(outcomes(1)%error, error)
   end subroutine identify_from_many

   !> Runs all stages from several starts on each mesh.
   !>
   !> fits    (stages, meshes) fits of the lowest J
   !> minima  (meshes) minima that were found
   !> error, monitor, check  as in `identify_from_many`
   subroutine identify_meshes_from_many(model, meshes, stages, experiments, plan, fits, minima, &
      error, monitor, check)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: meshes(:)
      type(stage_t), intent(in) :: stages(:)
      type(experiment_t), intent(in) :: experiments(:)
      type(multistart_t), intent(in) :: plan
      type(stage_fit_t), allocatable, intent(out) :: fits(:, :)
      type(minima_t), allocatable, intent(out) :: minima(:)
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      logical, intent(in), optional :: check
      integer :: k

      allocate (minima(size(meshes)), fits(size(stages), size(meshes)))
      do k = 1, size(meshes)
         call identify_from_many(model, meshes(k), stages, experiments, plan, minima(k)%list, &
            minima(k)%failures, error, monitor, check)
         if (allocated(error)) return
         fits(:, k) = minima(k)%list(1)%fits
      end do
   end subroutine identify_meshes_from_many

   !> Returns the stages with start number k in the first of them; start 1 is the declared one.
   function stages_from_start(model, stages, plan, k) result(restarted)
      type(model_t), intent(in) :: model
      type(stage_t), intent(in) :: stages(:)
      type(multistart_t), intent(in) :: plan
      integer, intent(in) :: k
      type(stage_t), allocatable :: restarted(:)
      real(wp) :: u(size(stages(1)%free)), value
      integer :: p

      restarted = stages
      if (k == 1) return
      u = uniform_noise(size(u), plan%seed + 7919*k)
      associate (first => restarted(1))
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
               ! A stiffness is drawn on a logarithmic scale, because it may be infinite.
               if (parameters(first%free(p))%is_reciprocal .and. first%lower(p) > 0) value = &
                  first%lower(p)*(first%upper(p)/first%lower(p))**u(p)
            else
               value = value*plan%spread**(2*u(p) - 1)
            end if
            first%start(p) = min(max(value, first%lower(p)), first%upper(p))
         end do
      end associate
   end function stages_from_start

   !> Counts a start with the minimum that it has found, or inserts it as a new minimum.
   !>
   !> k       number of the start
   !> found   (minima) number of the first start that has led to each minimum, by ascending misfit
   !> counts  (minima) number of starts that have led to each
   subroutine collect(outcomes, experiments, k, found, counts)
      type(outcome_t), intent(in) :: outcomes(:)
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: k
      integer, allocatable, intent(inout) :: found(:), counts(:)
      integer :: i, last, position

      position = 1
      last = size(outcomes(k)%fits)
      do i = 1, size(found)
         associate (old => outcomes(found(i))%fits(last), new => outcomes(k)%fits(last))
            if (same_minimum(old, new)) then
               counts(i) = counts(i) + 1
               return
            end if
            if (misfit_of_fit(old, experiments) <= misfit_of_fit(new, experiments)) &
               position = i + 1
         end associate
      end do
      found = [found(:position - 1), k, found(position:)]
      counts = [counts(:position - 1), 1, counts(position:)]
   end subroutine collect

   !> Tells whether two fits have found the same minimum.
   pure logical function same_minimum(a, b)
      type(stage_fit_t), intent(in) :: a, b

      ! After automatic starts, two fits may differ in the parameters that were kept fixed.
      same_minimum = size(a%free) == size(b%free)
      if (.not. same_minimum) return
      same_minimum = all(a%free == b%free) .and. abs(a%fit%J - b%fit%J) <= same_sum* &
         max(a%fit%J, b%fit%J)
      if (.not. same_minimum) return
      same_minimum = all(abs(a%fit%estimate - b%fit%estimate) <= same_estimate &
         *max(abs(a%fit%estimate), abs(b%fit%estimate)))
   end function same_minimum

end module beamid_multistart
