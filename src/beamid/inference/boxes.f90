!> Lists of settings that an experiment may have, and the sample times of all windows in them.
module beamid_boxes
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: excitation_t
   use beamid_experiments, only: experiment_t
   use beamid_kinds, only: wp
   use beamid_simulation, only: model_t
   use beamid_sorting, only: sort
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_F, structure_t
   implicit none
   private

   public :: box_t, window_times_t, complete, is_pulse, list_times, samples_until

   !> More sample times than this, all windows together, are refused.
   integer, parameter :: most_times = 1000000

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

   !> Sample times of all windows, and which of them each window from t_first by t_step has.
   type :: window_times_t
      real(wp) :: t_first = 0, t_step = 0
      real(wp), allocatable :: t(:)
      integer, allocatable :: place(:)              !< of each in `times`
   end type window_times_t

contains

   !> Whether an excitation is a constant force from t = 0 on, of which the duration may be chosen.
   elemental logical function is_pulse(excitation)
      type(excitation_t), intent(in) :: excitation

      is_pulse = .not. (excitation%is_release .or. excitation%is_base .or. excitation%modes > 0)
      if (is_pulse) is_pulse = size(excitation%t) == 2
      if (is_pulse) is_pulse = .not. (abs(excitation%t(1)) > 0 .or. &
         abs(excitation%f(2) - excitation%f(1)) > 0)
   end function is_pulse

   !> Lists that were not given, and all of them in ascending order.
   subroutine complete(box, experiment, model)
      type(box_t), intent(inout) :: box
      type(experiment_t), intent(in) :: experiment
      type(model_t), intent(in) :: model
      type(structure_t) :: s

      ! gfortran 12 frees twice what a function returns into an associate block.
      s = experiment%structure_of(model%structure)
      associate (t => experiment%samples)
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

end module beamid_boxes
