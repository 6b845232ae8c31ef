!> Experiments of a design as a residual problem whose derivatives are wanted although nothing has
!> been measured. The start of the motion may count as unknown although a known force causes it.
module beamid_design_setups
   use beamid_boxes, only: is_pulse
   use beamid_errors, only: bad_input, error_t
   use beamid_excitation, only: new_free
   use beamid_experiments, only: experiment_t
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_parameters, only: get_free
   use beamid_residuals, only: new_residuals, residual_t
   use beamid_simulation, only: model_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_x_F, x_S_at
   implicit none
   private

   public :: setup_t, new_setup, check_begin, differentiate, place

   !> A residual problem to differentiate.
   type :: setup_t
      type(residual_t) :: problem               !< with the free parameters of the design
      !> the same experiments with their forces, which gives the motion that `problem` then takes
      !> for measured; allocated if the start counts as unknown
      type(residual_t), allocatable :: cause
   end type setup_t

contains

   !> Makes a residual problem of experiments.
   !>
   !> experiments   (records) with sample times, noise and any measured values
   !> free          numbers of the free parameters
   !> modes         number of modes whose initial amplitude and phase count as unknown, as with
   !>               kind='free'; 0: the force is known
   !> error         an experiment that cannot be computed, or with `modes` a sample before the force
   !>               has ended
   subroutine new_setup(model, mesh, experiments, free, modes, setup, error)
      type(model_t), intent(in) :: model
      type(mesh_t), intent(in) :: mesh
      type(experiment_t), intent(in) :: experiments(:)
      integer, intent(in) :: free(:)
      integer, intent(in) :: modes
      type(setup_t), intent(out) :: setup
      type(error_t), allocatable, intent(out) :: error
      type(experiment_t) :: unforced(size(experiments))   ! with unknown start if modes > 0
      real(wp) :: finish
      integer, allocatable :: moving(:)
      integer :: k

      ! A design chooses the positions of force and sensor.
      moving = [free, of_x_F, x_S_at]
      unforced = experiments
      if (modes > 0) then
         allocate (setup%cause)
         call new_residuals(model, mesh, experiments, setup%cause, error, moving)
         do k = 1, size(experiments)
            associate (force => experiments(k)%excitation)
               finish = force%t(merge(1, size(force%t), force%is_release))
               if (.not. allocated(error)) call check_begin(experiments(k)%samples(1), finish, &
                  error)
               if (allocated(error)) return
               unforced(k)%excitation = new_free(modes)
               ! The position of the force is in the structure, unless the force has its own.
               if (allocated(force%x_F)) unforced(k)%excitation%x_F = force%x_F
            end associate
         end do
         setup%cause%free = [integer ::]
         setup%cause%record = [integer ::]
      end if
      call new_residuals(model, mesh, unforced, setup%problem, error, moving)
   end subroutine new_setup

   !> Refuses samples before the force has ended, for a motion with unknown initial
   !> amplitudes and phases.
   !>
   !> first   first sample time [time]
   !> finish  end of the force [time]
   subroutine check_begin(first, finish, error)
      real(wp), intent(in) :: first, finish
      type(error_t), allocatable, intent(out) :: error

      if (first < finish) call bad_input(error, 'found samples from '//to_text(first)// &
         ' on, expected none before the force has ended at '//to_text(finish)// &
         ', as its modes start anyhow')
   end subroutine check_begin

   !> Computes the derivatives of the residuals, in units of the noise, with respect to relative
   !> changes of the free parameters and with respect to the linear unknowns.
   !>
   !> setup     on return with the motion of `cause` as its measured values
   !> scale     (n) values that relative changes of the free parameters refer to, > 0
   !> jacobian  (samples, n + linear unknowns)
   !> error     a response that cannot be computed
   subroutine differentiate(setup, scale, jacobian, error)
      type(setup_t), intent(inout) :: setup
      real(wp), intent(in) :: scale(:)
      real(wp), allocatable, intent(out) :: jacobian(:, :)
      type(error_t), allocatable, intent(out) :: error
      real(wp), allocatable :: r(:), c(:), none(:, :), values(:)
      integer :: k, m, row

      associate (problem => setup%problem)
         values = [(get_free(problem%scenario%structures(max(1, problem%record(k))), &
            problem%scenario%excitations(max(1, problem%record(k))), problem%free(k)), &
            k=1, size(scale))]
         allocate (r(problem%samples()), c(problem%linear_unknowns()))
         allocate (jacobian(size(r), size(scale) + size(c)), none(size(r), 0))
         if (allocated(setup%cause)) then
            call setup%cause%evaluate([real(wp) ::], r, none, error)
            if (allocated(error)) return
            r = setup%cause%without_weights(r)
            row = 0
            do k = 1, size(problem%parts)
               m = size(problem%parts(k)%observed%measured)
               problem%parts(k)%observed%measured = r(row + 1:row + m)
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

   !> Sets the positions of sensor and force [length] and the duration of a pulse [time].
   !>
   !> problem   of one experiment
   !> duration  without effect on another excitation than a pulse
   pure subroutine place(problem, x_S, x_F, duration)
      type(residual_t), intent(inout) :: problem
      real(wp), intent(in) :: x_S, x_F, duration

      associate (structure => problem%scenario%structures(1), &
         force => problem%scenario%excitations(1))
         structure%sensor(structure%observer)%x_S = x_S
         structure%x_F = x_F
         if (is_pulse(force)) force%t(2) = duration
      end associate
   end subroutine place

end module beamid_design_setups
