!> Compares the designs of an experiment: forms all combinations of sensors, force, window and
!> sampling from lists, and predicts how well each of them determines the free parameters.
!>
!> One response with exact derivatives, at the sample times of all windows, is computed for each
!> position of force and sensor and each duration. The information of a window is the sum over its
!> samples; the information of two sensors is the sum of both.
module beamid_designs
   use beamid_boxes, only: box_t, complete, is_pulse, list_times, places_of, plan_record, &
      samples_until, window_times_t
   use beamid_design_information, only: present_information, prior_information, window_information
   use beamid_design_setups, only: check_begin, differentiate, new_setup, place, setup_t
   use beamid_errors, only: bad_input, error_t, locate
   use beamid_experiments, only: experiment_t
   use beamid_fit_setups, only: set_free
   use beamid_galerkin, only: mesh_t
   use beamid_information, only: predict, prediction_t
   use beamid_interrupts, only: check_interrupt, interrupted, stop_flag
   use beamid_kinds, only: wp
   use beamid_least_squares, only: monitor_t
   use beamid_parameter_names, only: name_of_parameter
   use beamid_parameters, only: as_named, free_magnitude, get_free
   use beamid_residuals, only: residual_t
   use beamid_simulation, only: model_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_F
   use beamid_unknowns, only: quantity_t, stage_t
   implicit none
   private

   public :: design_t, designs_t, compare_designs, needed

   !> Largest number of designs that is accepted.
   integer, parameter :: most_designs = 200000

   !> One design, with its predicted errors.
   type :: design_t
      real(wp) :: x_S(2) = 0                        !< positions of the sensors [length]
      real(wp) :: x_F = 0                           !< position of the force [length]
      real(wp) :: duration = 0                      !< duration of the pulse [time]
      !> window and sampling [time], or band and distance of lines [1/time]
      real(wp) :: first = 0, last = 0, step = 0
      integer :: samples = 0    !< number of samples, all sensors together, or of lines
      real(wp), allocatable :: information(:, :)    !< (n, n) by the samples, of relative changes
      type(prediction_t) :: prediction              !< by the samples and the priors
      integer, private :: share(2) = 0              !< of each sensor, index in the list of shares
      integer, private :: window = 0                !< index of window and end in a share
   end type design_t

   !> All designs that were compared.
   type :: designs_t
      type(box_t) :: box                            !< the lists of settings, complete and ascending
      type(design_t) :: present                     !< the experiments of the case
      type(design_t), allocatable :: list(:)        !< every combination
      type(quantity_t), allocatable :: quantities(:)   !< (n) free parameters, values and scales
      logical, allocatable :: interest(:)           !< (n) whether the parameter is of interest
      real(wp), allocatable :: prior(:)             !< (n) information of the priors
   end type designs_t

   !> Information by one sensor with given positions of sensor and force and given duration.
   type :: share_t
      real(wp), allocatable :: information(:, :, :)  !< (n, n, ends*windows)
      type(error_t), allocatable :: error            !< why it could not be computed
   end type share_t

contains

   !> Computes the information and the predicted errors of every design, at the parameter values of
   !> the model.
   !>
   !> model        with an exact solver
   !> stage        with the free parameters
   !> experiments  (records) the present ones, with sample times, noise and any measured values
   !> box          lists of settings to choose from
   !> error        too many combinations, or a response that cannot be computed
   subroutine compare_designs(model, mesh, stage, experiments, box, designs, error, monitor)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stage
      type(experiment_t), intent(in) :: experiments(:)
      type(box_t), intent(in) :: box
      type(designs_t), intent(out) :: designs
      type(error_t), allocatable, intent(out) :: error
      class(monitor_t), intent(inout), optional :: monitor
      type(setup_t) :: setup
      type(experiment_t) :: one
      type(window_times_t), allocatable :: windows(:)
      type(share_t), allocatable :: shares(:)
      real(wp), allocatable :: times(:)
      integer :: finished, k, n_F, n_S

      call add_present(model, mesh, stage, experiments, box, designs, error)
      if (allocated(error)) return
      call complete(designs%box, experiments(1), model)
      if (box%modes > 0 .and. is_pulse(experiments(1)%excitation)) call check_begin(minval( &
         designs%box%first), maxval(designs%box%duration), error)
      if (.not. allocated(error)) call list_times(designs%box, windows, times, error)
      if (.not. allocated(error)) call list_designs(designs, windows, error)
      if (allocated(error)) return
      one = experiments(1)
      one%motion = 0
      call plan_record(times, box%noise_sd, one)
      call new_setup(model, mesh, [one], stage%free, box%modes, setup, error)
      if (allocated(error)) return
      call set_free(setup%problem, single_stage(stage))
      n_S = size(designs%box%x_S)
      n_F = size(designs%box%x_F)
      allocate (shares(size(designs%box%duration)*n_F*n_S))
      finished = 0
      !$omp parallel do schedule(dynamic, 1) copyin(stop_flag)
      do k = 0, n_F*n_S - 1
         if (interrupted()) cycle
         call compute_shares(setup, designs, k, windows, shares)
         !$omp critical (one_position_done)
         finished = finished + 1
         if (present(monitor)) call monitor%advanced(finished, n_F*n_S, 'positions')
         !$omp end critical (one_position_done)
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

   !> Returns how many times each sample of a design must be repeated for every parameter of
   !> interest to reach a relative standard error. Instead, the force may be multiplied by the
   !> square root of this number.
   !>
   !> wanted  relative standard error, > 0
   !> times   factor on the number of samples; < 0: no number suffices
   function needed(designs, design, wanted) result(times)
      type(designs_t), intent(in) :: designs
      type(design_t), intent(in) :: design
      real(wp), intent(in) :: wanted
      real(wp) :: times, ratio
      type(prediction_t) :: prediction
      integer :: k

      times = 1
      ! Without priors the first step is exact. With priors each step falls short of the number
      ! needed, by less and less.
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

   !> Predicts the errors by the information of samples and priors together.
   !>
   !> information  (n, n) of the samples, of relative changes
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

   !> Returns the stage of a single experiment, in which every parameter occurs once.
   pure type(stage_t) function single_stage(stage) result(single)
      type(stage_t), intent(in) :: stage
      integer :: k

      single = stage%without([(any(stage%free(:k - 1) == stage%free(k)), k=1, size(stage%free))])
      single%record = 0*single%free
   end function single_stage

   !> Lists the parameters with their scales and computes what the present experiments tell of them.
   !>
   !> designs       on return complete but for the list of designs
   !> error         a response that cannot be computed
   subroutine add_present(model, mesh, stage, experiments, box, designs, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(stage_t), intent(in) :: stage
      type(experiment_t), intent(in) :: experiments(:)
      type(box_t), intent(in) :: box
      type(designs_t), intent(inout) :: designs
      type(error_t), allocatable, intent(out) :: error
      type(setup_t) :: setup
      type(stage_t) :: single
      real(wp), allocatable :: scale(:), t(:)
      integer, allocatable :: column(:)
      integer :: k

      designs%box = box
      call new_setup(model, mesh, experiments, stage%free, box%modes, setup, error)
      if (allocated(error)) return
      single = single_stage(stage)
      call list_quantities(single, setup%problem, experiments(1), designs%quantities)
      designs%interest = [(any(box%interest == single%free(k)), k=1, size(single%free))]
      call set_free(setup%problem, single)
      scale = designs%quantities%scale
      designs%prior = prior_information(setup%problem, scale)
      call set_free(setup%problem, stage)
      column = [(findloc(single%free, stage%free(k), dim=1), k=1, size(stage%free))]
      call present_information(setup, column, scale, designs%present%information, error)
      if (allocated(error)) return
      t = places_of(experiments(1))
      associate (design => designs%present, s => setup%problem%scenario%structures(1))
         design%prediction = predicted(designs, design%information)
         design%samples = sum([(size(places_of(experiments(k))), k=1, size(experiments))])
         design%x_S = [s%sensor_place(), 0.0_wp]
         design%x_F = s%place(of_x_F)
         if (is_pulse(experiments(1)%excitation) .and. .not. box%of_lines) &
            design%duration = experiments(1)%excitation%t(2)
         design%first = t(1)
         design%last = t(size(t))
         design%step = (t(size(t)) - t(1))/max(1, size(t) - 1)
      end associate
   end subroutine add_present

   !> Lists the free parameters with their values and with the scales of their relative changes.
   !>
   !> experiment  the first one; values are those of its structure and excitation
   !> quantities  (n) the scale of a value that is practically zero is the parameter's magnitude
   subroutine list_quantities(stage, problem, experiment, quantities)
      type(stage_t), intent(in) :: stage
      type(residual_t), intent(in) :: problem
      type(experiment_t), intent(in) :: experiment
      type(quantity_t), allocatable, intent(out) :: quantities(:)
      integer :: k

      allocate (quantities(size(stage%free)))
      do k = 1, size(quantities)
         associate (q => quantities(k), s => problem%scenario%structures(1), &
            e => experiment%excitation)
            q%parameter = stage%free(k)
            q%name = name_of_parameter(s, q%parameter)
            q%searched = get_free(s, e, q%parameter)
            q%value = as_named(q%parameter, q%searched)
            q%scale = free_magnitude(s, e, q%parameter)
            if (abs(q%searched) > 1e-9_wp*q%scale) q%scale = abs(q%searched)
         end associate
      end do
   end subroutine list_quantities

   !> Lists every combination of sensors, force, duration, begin, step and end, the last changing
   !> fastest, without its information. Windows that end before they begin are left out.
   !>
   !> windows  sample times of every begin and step
   !> error    no combination, or more than `most_designs`
   subroutine list_designs(designs, windows, error)
      type(designs_t), intent(inout) :: designs
      type(window_times_t), intent(in) :: windows(:)
      type(error_t), allocatable, intent(out) :: error
      type(design_t) :: design
      real(wp) :: total
      integer :: d, f, i, j, l, n, samples(size(designs%box%last), size(windows)), w

      associate (box => designs%box)
         do w = 1, size(windows)
            samples(:, w) = [(samples_until(windows(w), box%last(l)), l=1, size(box%last))]
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
                        do l = 1, size(box%last)
                           if (samples(l, w) == 0) cycle
                           n = n + 1
                           design%x_S = [box%x_S(i), merge(box%x_S(j), 0.0_wp, j > i)]
                           design%x_F = box%x_F(f)
                           design%duration = box%duration(d)
                           design%first = windows(w)%first
                           design%step = windows(w)%step
                           design%last = box%last(l)
                           design%samples = box%sensors*samples(l, w)
                           design%share = ([i, j] - 1)*size(box%x_F) + f - 1
                           design%share = design%share*size(box%duration) + d
                           design%window = (w - 1)*size(box%last) + l
                           designs%list(n) = design
                        end do
                     end do
                  end do
               end do
            end do
         end do
      end associate
   end subroutine list_designs

   !> Computes the information of every window and duration for one pair of positions of sensor and
   !> force. Runs in threads.
   !>
   !> setup   of one experiment with the sample times of all windows
   !> k       number of the pair, from 0; the position of the force changes fastest
   !> shares  (0:) of all pairs and durations, the durations fastest; those of pair k are set
   subroutine compute_shares(setup, designs, k, windows, shares)
      type(setup_t), intent(in) :: setup
      type(designs_t), intent(in) :: designs
      integer, intent(in) :: k
      type(window_times_t), intent(in) :: windows(:)
      type(share_t), intent(inout) :: shares(0:)
      type(setup_t) :: own
      real(wp), allocatable :: imaginary(:, :, :), jacobian(:, :), scale(:)
      integer :: d, f, m, s

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
               m = size(jacobian, 1)/merge(2, 1, box%of_lines)
               call window_information(jacobian(:m, :), size(designs%interest), windows, box%last, &
                  share%information)
               if (.not. box%of_lines) cycle
               ! The rows of the real parts are followed by those of the imaginary parts.
               call window_information(jacobian(m + 1:, :), size(designs%interest), windows, &
                  box%last, imaginary)
               share%information = share%information + imaginary
            end associate
         end do
      end associate
   end subroutine compute_shares

   !> Adds up the information of every design from that of single sensors and predicts its errors.
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

   !> Adds up the information of design k and predicts its errors. A procedure of its own, because
   !> with gfortran 14 threads share the associate-names of a parallel loop.
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
