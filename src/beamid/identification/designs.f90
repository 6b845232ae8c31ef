!> Experiments that could be done, side by side: sensors, force, window and sampling from lists, and
!> what each combination would tell of the free parameters.
!>
!> For each place of force and sensor and each duration one response with its exact derivatives at
!> every sample time that any window has; the information of a window is a sum over its samples,
!> that of two sensors the sum of both.
module beamid_designs
   use beamid_errors, only: bad_input, error_t, locate
   use beamid_excitation, only: excitation_t, new_free
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_information, only: eliminate, predict, prediction_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: as_named, free_magnitude, get_free, name_of_parameter
   use beamid_priors, only: priors_of
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_simulation, only: model_t
   use beamid_sorting, only: sort
   use beamid_starts, only: set_free
   use beamid_strings, only: to_text
   use beamid_structure, only: of_kappa_R, of_x_F
   use beamid_unknowns, only: quantity_t, stage_t
   implicit none
   private

   public :: box_t, design_t, designs_t, compare_designs, is_pulse, needed

   !> More designs than this, or more sample times of all windows together, are refused.
   integer, parameter :: most_designs = 200000, most_times = 1000000

   !> What there is to choose from; a list that is not allocated has the value of the case.
   type :: box_t
      real(wp), allocatable :: x_S(:), x_F(:)                     !< places [length]
      real(wp), allocatable :: duration(:)                        !< of the pulse [time]
      real(wp), allocatable :: t_first(:), t_last(:), t_step(:)   !< sample times [time]
      integer :: sensors = 1                                      !< at so many of the places
      real(wp) :: noise_sd = 0                                    !< of each [length/time**2]
      integer, allocatable :: interest(:)                         !< places among the `parameters`
      real(wp) :: target = 0           !< relative standard error that is wanted; 0: none
      !> So many modes start as if nobody knew the force, which has ended; 0: it is known
      integer :: modes = 0
   end type box_t

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

   !> Sample times of all windows, and which of them each window from t_first by t_step has.
   type :: window_times_t
      real(wp) :: t_first = 0, t_step = 0
      real(wp), allocatable :: t(:)
      integer, allocatable :: place(:)              !< of each in `times`
   end type window_times_t

   !> What is differentiated, and where the start is unknown what the motion comes from.
   type :: setup_t
      type(residual_t) :: problem
      type(residual_t), allocatable :: cause
   end type setup_t

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
      !$omp parallel do schedule(dynamic, 1)
      do k = 0, n_F*n_S - 1
         call inform(setup, designs, k, windows, shares)
      end do
      !$omp end parallel do
      do k = 1, size(shares)
         if (.not. allocated(shares(k)%error)) cycle
         call move_alloc(shares(k)%error, error)
         return
      end do
      call add_up(designs, shares)
   end subroutine compare_designs

   !> The problem of some experiments.
   !>
   !> modes  whose start is taken as unknown; 0: none
   !> error  also a sample before the force has ended
   subroutine new_setup(model, mesh, experiments, turning, modes, setup, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      logical, intent(in) :: turning
      integer, intent(in) :: modes
      type(setup_t), intent(out) :: setup
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: loose(size(experiments))
      real(wp) :: finish
      integer :: k

      loose = experiments
      if (modes > 0) then
         allocate (setup%cause)
         call new_residuals(model, mesh, experiments, setup%cause, error, turning)
         do k = 1, size(experiments)
            associate (force => experiments(k)%excitation)
               finish = force%t(merge(1, size(force%t), force%is_release))
               if (.not. allocated(error)) call check_begin(experiments(k)%samples(1), finish, &
                  error)
               if (allocated(error)) return
               loose(k)%excitation = new_free(modes)
               ! Where it acts is in the structure, but for a place of its own.
               if (allocated(force%x_F)) loose(k)%excitation%x_F = force%x_F
            end associate
         end do
         setup%cause%free = [integer ::]
         setup%cause%record = [integer ::]
      end if
      call new_residuals(model, mesh, loose, setup%problem, error, turning)
   end subroutine new_setup

   !> A motion whose start is unknown begins when the force has ended.
   subroutine check_begin(first, finish, error)
      real(wp), intent(in) :: first, finish
      type(error_t), allocatable, intent(out) :: error

      if (first < finish) call bad_input(error, 'found samples from '//to_text(first)// &
         ' on, expected none before the force has ended at '//to_text(finish)// &
         ', as its modes start anyhow')
   end subroutine check_begin

   !> Whether an excitation is a constant force from t = 0 on, of which the duration may be chosen.
   elemental logical function is_pulse(excitation)
      type(excitation_t), intent(in) :: excitation

      is_pulse = .not. (excitation%is_release .or. excitation%is_base .or. excitation%modes > 0)
      if (is_pulse) is_pulse = size(excitation%t) == 2
      if (is_pulse) is_pulse = .not. (abs(excitation%t(1)) > 0 .or. &
         abs(excitation%f(2) - excitation%f(1)) > 0)
   end function is_pulse

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
         associate (q => designs%quantities(k), s => setup%problem%world%structures(1), &
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
         associate (s => setup%problem%world%structures(1), t => experiments(1)%samples)
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
            known(k) = (scale(k)/prior%width(prior%centre(problem%given, problem%record(k))))**2
         end associate
      end do
   end function known_before

   !> Derivatives in units of the noise, by relative changes and by what enters linearly.
   !>
   !> jacobian  (samples, n + linear)
   subroutine differentiate(setup, scale, jacobian, error)
      type(setup_t), intent(inout) :: setup
      real(wp), intent(in) :: scale(:)
      real(wp), allocatable, intent(out) :: jacobian(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: r(:), c(:), none(:, :), values(:)
      integer :: k, m, row

      associate (problem => setup%problem)
         values = [(get_free(problem%world%structures(max(1, problem%record(k))), &
            problem%world%excitations(max(1, problem%record(k))), problem%free(k)), &
            k=1, size(scale))]
         allocate (r(problem%samples()), c(problem%linear_unknowns()))
         allocate (jacobian(size(r), size(scale) + size(c)), none(size(r), 0))
         if (allocated(setup%cause)) then
            call setup%cause%evaluate([real(wp) ::], r, none, error)
            if (allocated(error)) return
            r = setup%cause%without_weights(r)
            row = 0
            do k = 1, size(problem%parts)
               m = size(problem%parts(k)%experiment%measured)
               problem%parts(k)%experiment%measured = r(row + 1:row + m)
               row = row + m
            end do
         end if
         call problem%evaluate(values, r, jacobian, error, c)
         if (allocated(error)) return
      end associate
      do k = 1, size(scale)
         jacobian(:, k) = scale(k)*jacobian(:, k)
      end do
   end subroutine differentiate

   !> Lists that were not given, and all of them in ascending order.
   subroutine complete(box, experiment, model)
      type(box_t), intent(inout) :: box
      type(experiment_t), intent(in) :: experiment
      type(model_t), intent(in) :: model

      associate (s => experiment%structure_of(model%structure), t => experiment%samples)
         call settle(box%x_S, s%sensor_place())
         call settle(box%x_F, s%place(of_x_F))
         call settle(box%duration, merge(experiment%excitation%t(2), 0.0_wp, &
            is_pulse(experiment%excitation)))
         call settle(box%t_first, t(1))
         call settle(box%t_last, t(size(t)))
         call settle(box%t_step, (t(size(t)) - t(1))/max(1, size(t) - 1))
      end associate
   end subroutine complete

   subroutine settle(list, default)
      real(wp), allocatable, intent(inout) :: list(:)
      real(wp), intent(in) :: default

      if (.not. allocated(list)) list = [default]
      call sort(list)
   end subroutine settle

   !> The sample times of every window, and all of them together.
   subroutine list_times(box, windows, times, error)
      type(box_t), intent(in) :: box
      type(window_times_t), allocatable, intent(out) :: windows(:)
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: all_of_them(:)
      real(wp) :: last, same, total
      integer :: i, j, k, low, n

      last = maxval(box%t_last)
      total = 0
      do j = 1, size(box%t_step)
         total = total + sum(max(0.0_wp, last - box%t_first)/max(box%t_step(j), tiny(last)) + 1)
      end do
      if (total > most_times) then
         call bad_input(error, 'found '//to_text(total)//' sample times, expected at most '// &
            to_text(most_times))
         return
      end if
      allocate (windows(size(box%t_first)*size(box%t_step)), all_of_them(0))
      do i = 1, size(box%t_first)
         do j = 1, size(box%t_step)
            associate (window => windows((i - 1)*size(box%t_step) + j))
               window%t_first = box%t_first(i)
               window%t_step = box%t_step(j)
               n = int(max(0.0_wp, (last - window%t_first)/max(window%t_step, tiny(last))) &
                  *(1 + 1e-12_wp) + 1e-6_wp)
               window%t = [(window%t_first + k*window%t_step, k=0, n)]
               all_of_them = [all_of_them, window%t]
            end associate
         end do
      end do
      ! Those of two windows that differ by round-off only are one.
      call sort(all_of_them)
      same = 64*epsilon(same)*maxval(abs(all_of_them))
      times = pack(all_of_them, [.true., all_of_them(2:) - all_of_them(:size(all_of_them) - 1) &
         > same])
      do i = 1, size(windows)
         allocate (windows(i)%place(size(windows(i)%t)))
         low = 1
         do k = 1, size(windows(i)%t)
            do while (low < size(times))
               if (times(low + 1) > windows(i)%t(k) + same) exit
               low = low + 1
            end do
            windows(i)%place(k) = low
         end do
      end do
   end subroutine list_times

   !> How many samples a window has up to a time.
   pure integer function samples_until(window, t_last)
      type(window_times_t), intent(in) :: window
      real(wp), intent(in) :: t_last

      samples_until = count(window%t <= t_last + 1e-6_wp*window%t_step)
   end function samples_until

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

   !> Sensor and force at their places, and the length of a pulse.
   pure subroutine place(problem, x_S, x_F, duration)
      type(residual_t), intent(inout) :: problem
      real(wp), intent(in) :: x_S, x_F, duration

      associate (structure => problem%world%structures(1), force => problem%world%excitations(1))
         structure%sensor(structure%observer)%x_S = x_S
         structure%x_F = x_F
         if (is_pulse(force)) force%t(2) = duration
      end associate
   end subroutine place

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
      integer :: first, i, j, l, last, w

      allocate (information(n, n, size(ends)*size(windows)))
      do w = 1, size(windows)
         whole = 0
         first = 1
         do l = 1, size(ends)
            last = samples_until(windows(w), ends(l))
            rows = jacobian(windows(w)%place(first:last), :)
            do j = 1, size(whole, 2)
               do i = 1, j
                  whole(i, j) = whole(i, j) + dot_product(rows(:, i), rows(:, j))
                  whole(j, i) = whole(i, j)
               end do
            end do
            information(:, :, (w - 1)*size(ends) + l) = eliminate(whole, n)
            first = max(first, last + 1)
         end do
      end do
   end subroutine gather

   !> Information and errors of every design from those of single sensors.
   subroutine add_up(designs, shares)
      type(designs_t), intent(inout) :: designs
      type(share_t), intent(in) :: shares(:)
      integer :: k

      !$omp parallel do
      do k = 1, size(designs%list)
         associate (design => designs%list(k))
            design%information = shares(design%share(1))%information(:, :, design%window)
            if (designs%box%sensors == 2) design%information = design%information &
               + shares(design%share(2))%information(:, :, design%window)
            design%prediction = predicted(designs, design%information)
         end associate
      end do
      !$omp end parallel do
   end subroutine add_up

end module beamid_designs
