!> Experiments that could be done, side by side: sensors, force, window and sampling from lists, and
!> what each combination would tell of the free parameters.
!>
!> For each place of force and sensor and each duration one response with its exact derivatives at
!> every sample time that any window has; the information of a window is a sum over its samples,
!> that of two sensors the sum of both.
module beamid_designs
   use beamid_boxes, only: box_t, complete, is_pulse, list_times, samples_until, window_times_t
   use beamid_design_setups, only: check_begin, differentiate, new_setup, place, setup_t
   use beamid_errors, only: bad_input, error_t, locate
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_information, only: eliminate, predict, prediction_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_parameters, only: as_named, free_magnitude, get_free, name_of_parameter
   use beamid_priors, only: priors_of
   use beamid_residuals, only: residual_t
   use beamid_simulation, only: model_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_kappa_R, of_x_F
   use beamid_unknowns, only: quantity_t, stage_t
   implicit none
   private

   public :: design_t, designs_t, compare_designs, needed

   !> More designs than this are refused.
   integer, parameter :: most_designs = 200000

   !> One experiment.
   type :: design_t
      real(wp) :: x_S(2) = 0, x_F = 0, duration = 0, t_first = 0, t_last = 0, t_step = 0
      integer :: samples = 0                        !< of all sensors
      real(wp), allocatable :: information(:, :)    !< (n, n) of the samples, of relative changes
      type(prediction_t) :: prediction              !< with what else is known
      integer, private :: share(2) = 0, window = 0  !< where its information comes from
   end type design_t

   type :: designs_t
      type(box_t) :: box                            !< every list with its values, ascending
      type(design_t) :: present                     !< the case as it is
      type(design_t), allocatable :: list(:)        !< every combination
      type(quantity_t), allocatable :: quantities(:)   !< (n) of the parameters
      logical, allocatable :: interest(:)           !< (n)
      real(wp), allocatable :: prior(:)             !< (n) information that is there without samples
   end type designs_t

   !> (n, n, windows) of one place of sensor and force and one duration.
   type :: share_t
      real(wp), allocatable :: information(:, :, :)
      type(error_t), allocatable :: error
   end type share_t

contains

   !> Every experiment in the box, at the values that the model has.
   !>
   !> model        with an exact solver
   !> stage        whose parameters are free
   !> experiments  the present ones, with times, noise and samples of any value
   !> error        too many combinations, or a response that cannot be computed
   subroutine compare_designs(model, mesh, stage, experiments, box, designs, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stage
      type(experiment_t), intent(in) :: experiments(:)
      type(box_t), intent(in) :: box
      type(designs_t), intent(out) :: designs
      type(error_t), allocatable, intent(out) :: error
      type(setup_t) :: setup
      type(experiment_t) :: one
      type(window_times_t), allocatable :: windows(:)
      type(share_t), allocatable :: shares(:)
      real(wp), allocatable :: times(:)
      logical :: turning
      integer :: k, n_F, n_S

      turning = any(stage%free == of_kappa_R)
      call add_present(model, mesh, stage, experiments, turning, box, designs, error)
      if (allocated(error)) return
      call complete(designs%box, experiments(1), model)
      if (box%modes > 0 .and. is_pulse(experiments(1)%excitation)) call check_begin(minval( &
         designs%box%t_first), maxval(designs%box%duration), error)
      if (.not. allocated(error)) call list_times(designs%box, windows, times, error)
      if (.not. allocated(error)) call list_designs(designs, windows, error)
      if (allocated(error)) return
      one = experiments(1)
      one%motion = 0
      one%sd = box%noise_sd
      one%samples = times
      one%measured = 0*times
      call new_setup(model, mesh, [one], turning, box%modes, setup, error)
      if (allocated(error)) return
      call set_free(setup%problem, alone(stage))
      n_S = size(designs%box%x_S)
      n_F = size(designs%box%x_F)
      allocate (shares(size(designs%box%duration)*n_F*n_S))
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 0, n_F*n_S - 1
         if (interrupted()) cycle
         call inform(setup, designs, k, windows, shares)
      end do
      !$omp end parallel do
      call check_interrupt(error)
      if (allocated(error)) return
      do k = 1, size(shares)
         if (.not. allocated(shares(k)%error)) cycle
         call move_alloc(shares(k)%error, error)
         return
      end do
      call add_up(designs, shares)
   end subroutine compare_designs

   !> What the samples of an experiment have to be multiplied in number by, every one repeated, that
   !> every parameter of interest is known to a relative standard error; of a force its square root.
   !>
   !> times  < 0: no number is enough
   function needed(designs, design, wanted) result(times)
      type(designs_t), intent(in) :: designs
      type(design_t), intent(in) :: design
      real(wp), intent(in) :: wanted
      real(wp) :: times, ratio
      type(prediction_t) :: prediction
      integer :: k

      times = 1
      ! At once without priors; with them each step falls short of what is needed, by less and less.
      do k = 1, 1000
         prediction = predicted(designs, times*design%information)
         if (.not. prediction%finite) exit
         ratio = maxval(pack(prediction%sd, designs%interest))/wanted
         if (abs(ratio - 1) < 1e-9_wp) return
         times = times*ratio**2
         if (times > 1e30_wp .or. times < 1e-30_wp) exit
      end do
      if (.not. prediction%finite .or. times > 1e30_wp) times = -1
   end function needed

   !> With what is known beside the samples.
   pure function predicted(designs, information) result(prediction)
      type(designs_t), intent(in) :: designs
      real(wp), intent(in) :: information(:, :)
      type(prediction_t) :: prediction
      real(wp) :: whole(size(designs%prior), size(designs%prior))
      integer :: k

      whole = information
      do k = 1, size(whole, 1)
         whole(k, k) = whole(k, k) + designs%prior(k)
      end do
      call predict(whole, designs%interest, prediction)
   end function predicted

   !> The stage in an experiment by itself, where every parameter has one value.
   pure type(stage_t) function alone(stage)
      type(stage_t), intent(in) :: stage
      integer :: k

      alone = stage%without([(any(stage%free(:k - 1) == stage%free(k)), k=1, size(stage%free))])
      alone%record = 0*alone%free
   end function alone

   !> The parameters with their scales, and what the case as it is tells of them.
   subroutine add_present(model, mesh, stage, experiments, turning, box, designs, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stage
      type(experiment_t), intent(in) :: experiments(:)
      logical, intent(in) :: turning
      type(box_t), intent(in) :: box
      type(designs_t), intent(inout) :: designs
      type(error_t), allocatable, intent(out) :: error
      type(setup_t) :: setup
      type(stage_t) :: single
      real(wp), allocatable :: information(:, :), known(:), scale(:), jacobian(:, :)
      integer, allocatable :: first(:), others(:), column(:)
      integer :: k, m, n

      designs%box = box
      call new_setup(model, mesh, experiments, turning, box%modes, setup, error)
      if (allocated(error)) return
      single = alone(stage)
      n = size(single%free)
      allocate (designs%quantities(n))
      do k = 1, n
         associate (q => designs%quantities(k), s => setup%problem%scenario%structures(1), &
            e => experiments(1)%excitation)
            q%parameter = single%free(k)
            q%name = name_of_parameter(s, q%parameter)
            q%searched = get_free(s, e, q%parameter)
            q%value = as_named(q%parameter, q%searched)
            q%scale = free_magnitude(s, e, q%parameter)
            if (abs(q%searched) > 1e-9_wp*q%scale) q%scale = abs(q%searched)
         end associate
      end do
      designs%interest = [(any(box%interest == single%free(k)), k=1, n)]
      call set_free(setup%problem, single)
      scale = designs%quantities%scale
      designs%prior = known_before(setup%problem, scale)
      call set_free(setup%problem, stage)
      column = [(findloc(single%free, stage%free(k), dim=1), k=1, size(stage%free))]
      scale = scale(column)
      call differentiate(setup, scale, jacobian, error)
      if (allocated(error)) return
      information = matmul(transpose(jacobian), jacobian)
      ! What another record has of its own is nuisance, and has its own priors.
      known = known_before(setup%problem, scale)
      first = [(findloc(column, k, dim=1), k=1, n)]
      others = pack([(k, k=1, size(information, 1))], [(.not. any(first == k), &
         k=1, size(information, 1))])
      do k = 1, size(others)
         m = others(k)
         if (m <= size(known)) information(m, m) = information(m, m) + known(m)
      end do
      associate (present => designs%present)
         present%information = eliminate(information([first, others], [first, others]), n)
         present%prediction = predicted(designs, present%information)
         present%samples = setup%problem%samples()
         associate (s => setup%problem%scenario%structures(1), t => experiments(1)%samples)
            present%x_S = [s%sensor_place(), 0.0_wp]
            present%x_F = s%place(of_x_F)
            if (is_pulse(experiments(1)%excitation)) &
               present%duration = experiments(1)%excitation%t(2)
            present%t_first = t(1)
            present%t_last = t(size(t))
            present%t_step = (t(size(t)) - t(1))/max(1, size(t) - 1)
         end associate
      end associate
   end subroutine add_present

   !> Information of priors of free parameters.
   pure function known_before(problem, scale) result(known)
      type(residual_t), intent(in) :: problem
      real(wp), intent(in) :: scale(:)
      real(wp) :: known(size(scale))
      integer :: which(size(scale)), k

      known = 0
      which = priors_of(problem%priors, problem%free, problem%record)
      do k = 1, size(scale)
         if (which(k) == 0) cycle
         associate (prior => problem%priors(which(k)))
            known(k) = (scale(k)/prior%width(prior%centre_in(problem%record(k))))**2
         end associate
      end do
   end function known_before

   !> Every combination, without its information: sensors, force, duration, begin, step and end, the
   !> last one changing fastest. Windows that end before they begin are none.
   subroutine list_designs(designs, windows, error)
      type(designs_t), intent(inout) :: designs
      type(window_times_t), intent(in) :: windows(:)
      type(error_t), allocatable, intent(out) :: error
      type(design_t) :: design
      real(wp) :: total
      integer :: d, f, i, j, l, n, samples(size(designs%box%t_last), size(windows)), w

      associate (box => designs%box)
         do w = 1, size(windows)
            samples(:, w) = [(samples_until(windows(w), box%t_last(l)), l=1, size(box%t_last))]
         end do
         n = size(box%x_S)
         if (box%sensors == 2) n = n*(n - 1)/2
         total = real(n, wp)*size(box%x_F)*size(box%duration)*count(samples > 0)
         if (total > most_designs .or. total < 1) then
            call bad_input(error, 'found '//to_text(total)//' experiments to choose from, '// &
               'expected 1 to '//to_text(most_designs))
            return
         end if
         allocate (designs%list(nint(total)))
         n = 0
         do i = 1, size(box%x_S)
            do j = merge(i + 1, i, box%sensors == 2), merge(size(box%x_S), i, box%sensors == 2)
               do f = 1, size(box%x_F)
                  do d = 1, size(box%duration)
                     do w = 1, size(windows)
                        do l = 1, size(box%t_last)
                           if (samples(l, w) == 0) cycle
                           n = n + 1
                           design%x_S = [box%x_S(i), merge(box%x_S(j), 0.0_wp, j > i)]
                           design%x_F = box%x_F(f)
                           design%duration = box%duration(d)
                           design%t_first = windows(w)%t_first
                           design%t_step = windows(w)%t_step
                           design%t_last = box%t_last(l)
                           design%samples = box%sensors*samples(l, w)
                           design%share = ([i, j] - 1)*size(box%x_F) + f - 1
                           design%share = design%share*size(box%duration) + d
                           design%window = (w - 1)*size(box%t_last) + l
                           designs%list(n) = design
                        end do
                     end do
                  end do
               end do
            end do
         end do
      end associate
   end subroutine list_designs

   !> What each window tells with the sensor and the force at one place, of every duration.
   !>
   !> k  0, 1, ...: which places
   subroutine inform(setup, designs, k, windows, shares)
      type(setup_t), intent(in) :: setup
      type(designs_t), intent(in) :: designs
      integer, intent(in) :: k
      type(window_times_t), intent(in) :: windows(:)
      type(share_t), intent(inout) :: shares(0:)
      type(setup_t) :: own
      real(wp), allocatable :: jacobian(:, :), scale(:)
      integer :: d, f, s

      own = setup
      scale = designs%quantities%scale
      associate (box => designs%box)
         f = mod(k, size(box%x_F)) + 1
         s = k/size(box%x_F) + 1
         do d = 1, size(box%duration)
            call place(own%problem, box%x_S(s), box%x_F(f), box%duration(d))
            if (allocated(own%cause)) call place(own%cause, box%x_S(s), box%x_F(f), &
               box%duration(d))
            associate (share => shares(k*size(box%duration) + d - 1))
               call differentiate(own, scale, jacobian, share%error)
               call locate(share%error, 'x_S = '//to_text(box%x_S(s))//', x_F = '// &
                  to_text(box%x_F(f)))
               if (allocated(share%error)) return
               call gather(jacobian, size(designs%interest), windows, box%t_last, &
                  share%information)
            end associate
         end do
      end associate
   end subroutine inform

   !> Information of the first n parameters in every window, and up to every end.
   !>
   !> information  (n, n, ends*windows)
   subroutine gather(jacobian, n, windows, ends, information)
      real(wp), intent(in) :: jacobian(:, :), ends(:)
      integer, intent(in) :: n
      type(window_times_t), intent(in) :: windows(:)
      real(wp), allocatable, intent(out) :: information(:, :, :)
      real(wp) :: whole(size(jacobian, 2), size(jacobian, 2))
      real(wp), allocatable :: rows(:, :)
      real(wp) :: part(n, n)
      integer :: first, i, j, l, last, place, w

      allocate (information(n, n, size(ends)*size(windows)))
      do w = 1, size(windows)
         whole = 0
         first = 1
         do l = 1, size(ends)
            last = samples_until(windows(w), ends(l))
            allocate (rows(max(0, last - first + 1), size(jacobian, 2)))
            do i = 1, size(rows, 1)
               rows(i, :) = jacobian(windows(w)%place(first + i - 1), :)
            end do
            do j = 1, size(whole, 2)
               do i = 1, j
                  whole(i, j) = whole(i, j) + dot_product(rows(:, i), rows(:, j))
                  whole(j, i) = whole(i, j)
               end do
            end do
            deallocate (rows)
            ! In two steps: gfortran 14 checks the bounds before it knows where a result goes.
            part = eliminate(whole, n)
            place = (w - 1)*size(ends) + l
            information(:, :, place) = part
            first = max(first, last + 1)
         end do
      end do
   end subroutine gather

   !> Information and errors of every design from those of single sensors.
   subroutine add_up(designs, shares)
      type(designs_t), intent(inout) :: designs
      type(share_t), intent(in) :: shares(:)
      integer :: k

      !$omp parallel do copyin(stop_flag)
      do k = 1, size(designs%list)
         if (interrupted()) cycle
         call add_shares(designs, shares, k)
      end do
      !$omp end parallel do
   end subroutine add_up

   !> The same of design k. By itself: an associate-name in a loop of several threads is none of
   !> their own with gfortran 14.
   subroutine add_shares(designs, shares, k)
      type(designs_t), intent(inout) :: designs
      type(share_t), intent(in) :: shares(:)
      integer, intent(in) :: k

      associate (design => designs%list(k))
         design%information = shares(design%share(1))%information(:, :, design%window)
         if (designs%box%sensors == 2) design%information = design%information &
            + shares(design%share(2))%information(:, :, design%window)
         design%prediction = predicted(designs, design%information)
      end associate
   end subroutine add_shares

end module beamid_designs
