!> Lists of settings from which `design` forms experiments, and the sample times of all windows that
!> these settings allow. `beamid_designs` computes the information of their combinations.
module beamid_boxes
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_frequency_responses, only: frequency_response_t
   use beamid_kinds, only: wp
   use beamid_simulation, only: model_t
   use beamid_sorting, only: sort
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_F, structure_t
   implicit none
   private

   public :: box_t, window_times_t, complete, is_pulse, list_times, places_of, plan_record, &
      samples_until

   !> Largest number of sample times that is accepted, all windows together.
   integer, parameter :: most_times = 1000000

   !> Lists of the settings to choose from. A list that is not allocated has one entry, the value of
   !> the case.
   type :: box_t
      real(wp), allocatable :: x_S(:)          !< positions of the sensor [length]
      real(wp), allocatable :: x_F(:)          !< positions of the force [length]
      real(wp), allocatable :: duration(:)     !< durations of the pulse [time]
      !> windows and sampling [time], or bands and distances of lines [1/time]
      real(wp), allocatable :: first(:), last(:), step(:)
      logical :: of_lines = .false.            !< the design plans frequency responses
      integer :: sensors = 1                   !< number of sensors in use at a time, 1 or 2
      !> noise level of each sensor [length/time**2], or of real and imaginary part of each line
      real(wp) :: noise_sd = 0
      integer, allocatable :: interest(:)      !< indices in `parameters` of those of interest
      real(wp) :: target = 0                   !< wanted relative standard error; 0: none
      !> number of modes whose initial amplitude and phase are unknown, as with kind='free'; the
      !> force has then ended before the first sample. 0: the force is known
      integer :: modes = 0
   end type box_t

   !> Sample times of one combination of `first` and `step`, up to the largest `last`; in the same
   !> way the frequencies of lines.
   type :: window_times_t
      real(wp) :: first = 0, step = 0               !< [time]
      real(wp), allocatable :: t(:)                 !< (m) ascending [time]
      integer, allocatable :: place(:)              !< (m) index of each in the times of all windows
   end type window_times_t

contains

   !> Returns the sample times of an experiment [time], or the frequencies of its lines [1/time].
   function places_of(experiment) result(places)
      type(experiment_t), intent(in) :: experiment
      real(wp), allocatable :: places(:)

      places = experiment%samples
      if (.not. allocated(experiment%observed)) return
      select type (observed => experiment%observed)
      type is (frequency_response_t)
         places = observed%frequency
      end select
   end function places_of

   !> Makes an experiment one that is planned: with sample times, or with lines if it is a frequency
   !> response, with noise, and without measured values.
   !>
   !> places  (m) ascending [time], or frequencies [1/time]
   !> sd      standard deviation of the noise; a window correlates it as in the present experiment
   subroutine plan_record(places, sd, experiment)
      real(wp), intent(in) :: places(:), sd
      type(experiment_t), intent(inout) :: experiment

      if (allocated(experiment%observed)) then
         select type (observed => experiment%observed)
         type is (frequency_response_t)
            observed%frequency = places
            observed%h = 0*places
            observed%noise = spread(observed%correlation*sd, 1, size(places))
            observed%noise_is_known = .true.
            if (allocated(observed%coherence)) deallocate (observed%coherence)
            experiment%measured = observed%values()
         end select
         experiment%sd = 1
      else
         experiment%samples = places
         experiment%measured = 0*places
         experiment%sd = sd
      end if
   end subroutine plan_record

   !> Returns whether an excitation is a pulse: a constant force from t = 0 on, whose duration a
   !> design may choose.
   elemental logical function is_pulse(excitation)
      type(excitation_t), intent(in) :: excitation

      is_pulse = .not. (excitation%is_release .or. excitation%is_base .or. excitation%modes > 0)
      if (is_pulse) is_pulse = size(excitation%t) == 2
      if (is_pulse) is_pulse = .not. (abs(excitation%t(1)) > 0 .or. &
         abs(excitation%f(2) - excitation%f(1)) > 0)
   end function is_pulse

   !> Fills the lists that are not allocated from the present experiment and sorts all lists.
   !>
   !> box         on return every list is allocated and ascending
   !> experiment  the present one, with sample times
   !> model       whose structure gives the positions that the experiment does not state
   subroutine complete(box, experiment, model)
      type(box_t), intent(inout) :: box
      type(experiment_t), intent(in) :: experiment
      type(model_t), intent(in) :: model
      type(structure_t) :: s
      real(wp), allocatable :: t(:)
      real(wp) :: duration

      ! gfortran 12 frees twice what a function returns into an associate block.
      s = experiment%structure_of(model%structure)
      t = places_of(experiment)
      call complete_list(box%x_S, s%sensor_place())
      call complete_list(box%x_F, s%place(of_x_F))
      ! With -O2, gfortran 12 fails to write the module if this is an expression with `merge`.
      duration = 0
      if (is_pulse(experiment%excitation) .and. .not. box%of_lines) &
         duration = experiment%excitation%t(2)
      call complete_list(box%duration, duration)
      call complete_list(box%first, t(1))
      call complete_list(box%last, t(size(t)))
      call complete_list(box%step, (t(size(t)) - t(1))/max(1, size(t) - 1))
   end subroutine complete

   !> Gives a list its default if it is not allocated, and sorts it.
   subroutine complete_list(list, default)
      real(wp), allocatable, intent(inout) :: list(:)
      real(wp), intent(in) :: default

      if (.not. allocated(list)) list = [default]
      call sort(list)
   end subroutine complete_list

   !> Lists the sample times of every window, and the sample times of all windows together.
   !>
   !> box      with complete lists
   !> windows  (`first` times `step`, `step` fastest)
   !> times    all sample times, ascending, each once [time]
   !> error    more than `most_times` of them
   subroutine list_times(box, windows, times, error)
      type(box_t), intent(in) :: box
      type(window_times_t), allocatable, intent(out) :: windows(:)
      real(wp), allocatable, intent(out) :: times(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: all_times(:)
      real(wp) :: last, round_off, total
      integer :: i, j, k, low, n

      last = maxval(box%last)
      total = 0
      do j = 1, size(box%step)
         total = total + sum(max(0.0_wp, last - box%first)/max(box%step(j), tiny(last)) + 1)
      end do
      if (total > most_times) then
         call bad_input(error, 'found '//to_text(total)//trim(merge(' frequencies ', &
            ' sample times', box%of_lines))//', expected at most '//to_text(most_times))
         return
      end if
      allocate (windows(size(box%first)*size(box%step)), all_times(0))
      do i = 1, size(box%first)
         do j = 1, size(box%step)
            associate (window => windows((i - 1)*size(box%step) + j))
               window%first = box%first(i)
               window%step = box%step(j)
               n = int(max(0.0_wp, (last - window%first)/max(window%step, tiny(last))) &
                  *(1 + 1e-12_wp) + 1e-6_wp)
               window%t = [(window%first + k*window%step, k=0, n)]
               all_times = [all_times, window%t]
            end associate
         end do
      end do
      ! Times of different windows that differ by round-off alone count as the same time.
      call sort(all_times)
      round_off = 64*epsilon(round_off)*maxval(abs(all_times))
      times = pack(all_times, [.true., all_times(2:) - all_times(:size(all_times) - 1) &
         > round_off])
      do i = 1, size(windows)
         allocate (windows(i)%place(size(windows(i)%t)))
         low = 1
         do k = 1, size(windows(i)%t)
            do while (low < size(times))
               if (times(low + 1) > windows(i)%t(k) + round_off) exit
               low = low + 1
            end do
            windows(i)%place(k) = low
         end do
      end do
   end subroutine list_times

   !> Returns the number of samples of a window up to a time [time].
   pure integer function samples_until(window, last)
      type(window_times_t), intent(in) :: window
      real(wp), intent(in) :: last

      samples_until = count(window%t <= last + 1e-6_wp*window%step)
   end function samples_until

end module beamid_boxes
