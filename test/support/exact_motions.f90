!> Motions of an experiment and their derivatives by the exact solver, in columns; and the
!> time functions in quadruple precision, for what they are compared with.
module exact_motions
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_of, galerkin_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_observation, only: sampling_t
   use beamid_responses, only: response_t, work_t
   use checks, only: check
   use full_matrices, only: qp
   use random_experiments, only: experiment_t, samples
   implicit none
   private

   public :: kinds, galerkin, solver, prepare, exact, motion_columns, as_columns, march, &
      relative

   character(len=*), parameter :: kinds(4) = [character(len=12) :: 'displacement', 'velocity', &
      'acceleration', 'observation']
   !> The mesh at hand, and the solver that is ready for it.
   type(galerkin_t), target :: galerkin
   type(modal_t) :: solver

contains

   !> The mesh of an experiment, and the solver ready for it.
   subroutine prepare(e)
      type(experiment_t), intent(in) :: e
      type(error_t), allocatable :: error

      galerkin = galerkin_of(e%mesh, e%structure)
      call solver%prepare(galerkin, error)
      if (allocated(error)) call check('a mesh', .false., error%message)
   end subroutine prepare

   !> Exact derivatives, and the motions themselves, by a solver that is ready for the mesh.
   subroutine exact(e, parameters, columns, derivatives, error)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: parameters(:)
      real(wp), allocatable, intent(out) :: columns(:, :), derivatives(:, :, :)
      type(error_t), allocatable, intent(out) :: error
      type(equations_t), target :: equations
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      integer :: k

      equations = new_equations(galerkin, e%structure, e%excitation)
      call solver%differentiate(equations, e%excitation, e%sampling%times, parameters, response, &
         slopes, work, error)
      allocate (columns(size(e%sampling%times), size(kinds)), source=0.0_wp)
      allocate (derivatives(size(columns, 1), size(kinds), size(parameters)), source=0.0_wp)
      if (allocated(error)) return
      columns = motion_columns(e%sampling, response)
      do k = 1, size(parameters)
         derivatives(:, :, k) = motion_columns(e%sampling, slopes(k))
      end do
   end subroutine exact

   !> Displacement, velocity and acceleration at the times, and what is observed at the samples.
   pure function motion_columns(sampling, response) result(columns)
      type(sampling_t), intent(in) :: sampling
      type(response_t), intent(in) :: response
      real(wp) :: columns(size(sampling%times), size(kinds))

      columns(:, 1) = response%displacement
      columns(:, 2) = response%velocity
      columns(:, 3) = response%acceleration
      columns(:, 4) = 0
      columns(:samples, 4) = sampling%acceleration(response)
   end function motion_columns

   !> The same of motions in quadruple precision: (4.1) and (4.2) cancel digits that are there.
   function as_columns(sampling, motions) result(columns)
      type(sampling_t), intent(in) :: sampling
      real(qp), intent(in) :: motions(:, :)
      real(wp) :: columns(size(motions, 1), size(kinds))
      type(response_t) :: high, low

      ! The formulas are linear: high and low halves of each number, one after the other.
      high%t = sampling%times
      high%displacement = real(motions(:, 1), wp)
      high%velocity = real(motions(:, 2), wp)
      high%acceleration = real(motions(:, 3), wp)
      low%t = sampling%times
      low%displacement = real(motions(:, 1) - high%displacement, wp)
      low%velocity = real(motions(:, 2) - high%velocity, wp)
      low%acceleration = real(motions(:, 3) - high%acceleration, wp)
      columns = motion_columns(sampling, high) + motion_columns(sampling, low)
   end function as_columns

   !> z' = s z + f from rest, at the times.
   pure function march(s, excitation, times) result(values)
      complex(qp), intent(in) :: s
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      complex(qp) :: values(size(times)), growth, z
      real(qp) :: t, finish, step, force, slope
      integer :: i, node

      z = 0
      node = 1
      t = excitation%t(1)
      do i = 1, size(times)
         do while (t < times(i))
            finish = times(i)
            if (node < size(excitation%t)) finish = min(finish, real(excitation%t(node + 1), qp))
            step = finish - t
            growth = exp(s*step)
            z = growth*z
            if (node < size(excitation%t)) then
               associate (nodes => excitation%t, f => excitation%f)
                  slope = (real(f(node + 1), qp) - f(node))/(real(nodes(node + 1), qp) &
                     - nodes(node))
                  force = f(node) + slope*(t - nodes(node))
               end associate
               z = z + force*(growth - 1)/s + slope*(growth - 1 - s*step)/s**2
               if (finish >= excitation%t(node + 1)) node = node + 1
            end if
            t = finish
         end do
         values(i) = z
      end do
   end function march

   !> 2-norm of the difference over that of the second.
   pure real(wp) function relative(a, b)
      real(wp), intent(in) :: a(:), b(:)

      relative = norm2(a - b)/norm2(b)
   end function relative

end module exact_motions
