!> One response of one structure by either method, and the closed form of undamped ones.
module single_responses
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_failed
   use beamid_excitation, only: excitation_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: ip, wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: undamped_modes
   use beamid_responses, only: prepare_for, response_t, solver_t, work_t
   use beamid_structure, only: hose_t, structure_t
   use checks, only: check, check_close
   use integration_errors, only: accumulated_error
   implicit none
   private

   public :: assembly, table_4_1, fresh, grid, run, attempt, relative, compare, &
      modal_sum, against_closed, refused_clearly

   !> The full tip assembly: rho = E I = l = 1.
   type(structure_t), parameter :: assembly = structure_t(length=1, rho=1, E=1, I=1, &
      c_D=1e-3_wp, m_T=0.5_wp, hose=hose_t(m_H=0.3_wp, c_H=0.2_wp, k_H=20))
   !> The simulated structure of Table 4.1.
   type(structure_t), parameter :: table_4_1 = structure_t(length=4, rho=0.03_wp, E=80, I=1, &
      c_D=0.005_wp, m_T=0.15_wp, hose=hose_t(m_H=0.04_wp, c_H=0.004_wp, k_H=0.3_wp))
   type(modal_t), parameter :: fresh = modal_t()
   integer :: k
   real(wp), parameter :: grid(101) = [(0.05_wp*k, k=0, 100)]

contains

   !> One response by either method; a failure is a failed check, and zeros.
   subroutine run(solver, structure, mesh, excitation, times, response, name, work)
      class(solver_t), intent(in) :: solver
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      character(len=*), intent(in), optional :: name
      type(work_t), intent(out), optional :: work
      type(error_t), allocatable :: error

      call attempt(solver, structure, mesh, excitation, times, response, error, work)
      if (.not. allocated(error)) return
      if (present(name)) call check(name//': a response', .false., error%message)
      if (.not. present(name)) call check('a response', .false., error%message)
      response%t = times
      response%displacement = 0*times
      response%velocity = 0*times
      response%acceleration = 0*times
   end subroutine run

   subroutine attempt(solver, structure, mesh, excitation, times, response, error, work)
      class(solver_t), intent(in) :: solver
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      type(error_t), allocatable, intent(out) :: error
      type(work_t), intent(out), optional :: work
      class(solver_t), allocatable :: own
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(work_t) :: done

      galerkin = new_galerkin(mesh, structure%length)
      equations = new_equations(galerkin, structure, excitation)
      own = solver
      call prepare_for(galerkin, own, error)
      if (.not. allocated(error)) &
         call own%respond(equations, excitation, times, response, done, error)
      if (present(work)) work = done
   end subroutine attempt

   !> Largest difference over the largest value of the second.
   pure real(wp) function relative(a, b)
      real(wp), intent(in) :: a(:), b(:)

      relative = maxval(abs(a - b))/maxval(abs(b))
   end function relative

   !> Compares modal with cvode: displacement relative to its maximum.
   subroutine compare(name, structure, mesh, excitation, times)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(wp), parameter :: rtol = 1e-11_wp
      type(response_t) :: exact, integrated
      type(work_t) :: work

      call run(fresh, structure, mesh, excitation, times, exact, name//', modal')
      call run(cvode_t(rtol=rtol, max_steps=5000000_ip), structure, mesh, excitation, times, &
         integrated, name//', cvode', work)
      call check_close(name//', displacement', relative(exact%displacement, &
         integrated%displacement), 0.0_wp, accumulated_error(rtol, work%steps))
   end subroutine compare

   !> Undamped, any hose: the sum over the modes of the assembled M and K, an eigenproblem of its
   !> own, of (b'x)(x'F) times the oscillator's answer.
   !>
   !> motion   (3, times) displacement, velocity, acceleration
   !> fastest  the highest of the frequencies
   subroutine modal_sum(name, structure, mesh, excitation, times, motion, fastest)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(wp), intent(out) :: motion(3, size(times))
      real(wp), intent(out), optional :: fastest
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      integer :: i, j

      galerkin = new_galerkin(mesh, structure%length)
      equations = new_equations(galerkin, structure, excitation)
      call undamped_modes(equations, omega, shapes, error)
      call check(name//': undamped modes', .not. allocated(error))
      motion = 0
      if (present(fastest)) fastest = 0
      if (allocated(error)) return
      if (present(fastest)) fastest = maxval(omega)
      do i = 1, size(times)
         do j = 1, size(omega)
            motion(:, i) = motion(:, i) + dot_product(equations%observer, shapes(:, j)) &
               *dot_product(equations%load, shapes(:, j))*oscillator(omega(j), excitation, times(i))
         end do
      end do
   end subroutine modal_sum

   !> q, q', q'' of q'' + omega^2 q = f(t) from rest. f is a sum of steps and of ramps that begin at
   !> its nodes: (1 - cos)/omega^2, 1 - cos being 2 sin^2 of the half, and
   !> (tau - sin(omega tau)/omega)/omega^2.
   pure function oscillator(omega, excitation, t) result(q)
      real(wp), intent(in) :: omega, t
      type(excitation_t), intent(in) :: excitation
      real(wp) :: q(3), step, ramp, tau, rise
      integer :: i, n

      q = 0
      n = size(excitation%t)
      do i = 1, n
         tau = t - excitation%t(i)
         ! A jump answers at once where the force begins, and after the last instant where it ends.
         if (tau < 0 .or. (i == n .and. tau <= 0)) exit
         rise = 2*sin(omega*tau/2)**2/omega**2
         step = 0
         ramp = 0
         if (i == 1) step = excitation%f(1)
         if (i == n) step = -excitation%f(n)
         if (i < n) ramp = (excitation%f(i + 1) - excitation%f(i))/(excitation%t(i + 1) &
            - excitation%t(i))
         if (i > 1) ramp = ramp - (excitation%f(i) - excitation%f(i - 1)) &
            /(excitation%t(i) - excitation%t(i - 1))
         q = q + step*[rise, sin(omega*tau)/omega, cos(omega*tau)] &
            + ramp*[(tau - sin(omega*tau)/omega)/omega**2, rise, sin(omega*tau)/omega]
      end do
   end function oscillator

   !> The modal response against the closed form. The round-off of a frequency, ten eps, grows with
   !> the phase omega t. In displacement and velocity the first modes count, phase 500 by t = 5,
   !> with 1e-11 to spare for the others; in the acceleration all modes do alike, with the phase
   !> of the fastest. Both sides, so twice.
   subroutine against_closed(name, structure, mesh, excitation)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      type(response_t) :: exact
      real(wp) :: closed(3, size(grid)), fastest

      call run(fresh, structure, mesh, excitation, grid, exact, name)
      call modal_sum(name, structure, mesh, excitation, grid, closed, fastest)
      call check_close(name//', displacement', relative(exact%displacement, closed(1, :)), 0.0_wp, &
         1e-11_wp)
      call check_close(name//', velocity', relative(exact%velocity, closed(2, :)), 0.0_wp, 1e-11_wp)
      call check_close(name//', acceleration', relative(exact%acceleration, closed(3, :)), 0.0_wp, &
         20*epsilon(1.0_wp)*fastest*maxval(grid))
   end subroutine against_closed

   !> The words that a refusal must have.
   logical function refused_clearly(error)
      type(error_t), intent(in) :: error

      refused_clearly = error%status == status_failed .and. index(error%message, &
         'roots coincide') > 0 .and. index(error%message, 'cvode') > 0
   end function refused_clearly

end module single_responses
