!> Beams with something attached: their roots; their motions by the exact solver against those of
!> the full matrices in quadruple precision and against CVODE.
module attached_beams
   use beamid_assembly, only: new_assembly
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, mesh_t
   use beamid_kinds, only: ip, wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_parameters, only: magnitude
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_structure, only: hose_t, end_t, free_end, sensor_t, structure_t
   use checks, only: check, check_close
   use exact_motions, only: as_columns, exact, galerkin, kinds, march, prepare, relative, solver
   use full_matrices, only: full_t, new_full, qp
   use integration_errors, only: accumulated_error
   use random_experiments, only: experiment_t, random_experiment
   implicit none
   private

   public :: everything, fine, coarse, experiment_on, references, starting_vector, &
      poles_of, compare, compare_full, all_roots

   !> Everything at once: rho = E I = l = 1.
   type(structure_t), parameter :: everything = structure_t(length=1, rho=1, E=1, I=1, &
      c_D=1e-3_wp, m_T=0.5_wp, hose=hose_t(m_H=0.3_wp, c_H=0.2_wp, k_H=20), gamma=0.05_wp, &
      J_T=0.02_wp, &
      end=[end_t(kappa_R=0.2_wp), free_end], sensor=sensor_t(m_S=0.1_wp, x_S=0.6_wp))
   !> Quintics: their frequencies are wrong by (beta h)**8/3e6.
   type(mesh_t), parameter :: fine = mesh_t(5, 24, 6, 1), coarse = mesh_t(5, 3, 6, 1)

contains

   !> A random experiment on a given structure.
   function experiment_on(structure) result(e)
      type(structure_t), intent(in) :: structure
      type(experiment_t) :: e

      e = random_experiment(structure, 0.3_wp, 3, 2)
   end function experiment_on

   !> Poles of a structure on the mesh at hand, a force at the tip.
   subroutine poles_of(structure, poles, error)
      type(structure_t), intent(in) :: structure
      type(poles_t), intent(out) :: poles
      type(error_t), allocatable, intent(out) :: error
      type(beam_modes_t) :: modes

      call bare_beam_modes(galerkin, modes, error)
      if (allocated(error)) return
      call find_poles(new_assembly(structure, modes, [integer ::]), poles, error)
   end subroutine poles_of

   !> The roots of a structure on a mesh, lowest first; a failure is a failed check.
   subroutine all_roots(name, structure, mesh, roots)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      complex(wp), allocatable, intent(out) :: roots(:)
      type(equations_t), target :: equations
      type(error_t), allocatable :: error

      galerkin = galerkin_of(mesh, structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      if (.not. allocated(error)) return
      call check(name//': roots', .false., error%message)
      allocate (roots(equations%n), source=(0.0_wp, 0.0_wp))
   end subroutine all_roots

   !> The motions, and their derivatives, from differences in quadruple precision, rounded.
   !>
   !> lost  a root of double precision leads nowhere
   subroutine references(e, parameters, columns, derivatives, lost)
      type(experiment_t), intent(in) :: e
      integer, intent(in) :: parameters(:)
      real(wp), allocatable, intent(out) :: columns(:, :), derivatives(:, :, :)
      logical, intent(out) :: lost
      type(full_t) :: base, moved(size(parameters))
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      complex(qp), allocatable :: x(:), y(:), z(:), dz(:)
      complex(qp) :: s, r, s_p, r_p
      real(qp) :: here(size(e%sampling%times), 3), last, step(size(parameters))
      real(qp) :: change(size(e%sampling%times), 3, size(parameters)), tolerance
      integer :: i, k, p

      ! What inverse iteration leaves: 1e-8 of a difference over 1e-16; for a motion 1e-20 is as
      ! good as nothing. A J_T of 1e6 beams alone costs ten digits of 34.
      tolerance = merge(1e-20_qp, 1e-24_qp, size(parameters) == 0)
      call poles_of(e%structure, poles, error)
      lost = allocated(error)
      allocate (columns(size(here, 1), size(kinds)), derivatives(size(here, 1), size(kinds), &
         size(parameters)), source=0.0_wp)
      if (lost) return
      base = new_full(galerkin, e%structure, e%excitation)
      here = 0
      here(:, 3) = base%impulse()*e%excitation%force(e%sampling%times)
      change = 0
      do p = 1, size(parameters)
         step(p) = 1e-16_qp*base%q(parameters(p))
         if (.not. step(p) > 0) step(p) = 1e-16_qp*magnitude(e%structure, parameters(p))
         moved(p) = base
         moved(p)%q(parameters(p)) = base%q(parameters(p)) + step(p)
         call moved(p)%assemble()
         change(:, 3, p) = (moved(p)%impulse() - base%impulse())/step(p) &
            *e%excitation%force(e%sampling%times)
      end do
      do k = 1, size(poles%s)
         s = poles%s(k)
         x = starting_vector(base%n)
         call base%improve(8, s, x, last)
         if (.not. last <= tolerance*abs(s)) lost = .true.
         if (.not. abs(s - poles%s(k)) <= 1e-8_qp*abs(s)) lost = .true.
         r = base%residue(s, x)
         z = march(s, e%excitation, e%sampling%times)
         do i = 1, 3
            here(:, i) = here(:, i) + real(r*s**(i - 1)*z, qp)
         end do
         if (size(parameters) == 0) cycle
         dz = (march(s*(1 + 1e-16_qp), e%excitation, e%sampling%times) - z)/(s*1e-16_qp)
         do p = 1, size(parameters)
            s_p = s
            y = x
            call moved(p)%improve(1, s_p, y, last)
            r_p = (moved(p)%residue(s_p, y) - r)/step(p)
            s_p = (s_p - s)/step(p)
            do i = 1, 3
               change(:, i, p) = change(:, i, p) + real((r_p*s**(i - 1) + r*(i - 1)*s_p &
                  *s**max(0, i - 2))*z + r*s**(i - 1)*dz*s_p, qp)
            end do
         end do
      end do
      columns = as_columns(e%sampling, here)
      do p = 1, size(parameters)
         derivatives(:, :, p) = as_columns(e%sampling, change(:, :, p))
      end do
   end subroutine references

   !> Something with a share of every vector.
   function starting_vector(n) result(x)
      integer, intent(in) :: n
      complex(qp) :: x(n)
      integer :: i

      do i = 1, n
         x(i) = 1/sqrt(i + 0.3_qp)
      end do
   end function starting_vector

   !> Compares modal with cvode: displacement relative to its maximum.
   subroutine compare(name, e)
      character(len=*), intent(in) :: name
      type(experiment_t), intent(in) :: e
      real(wp), parameter :: rtol = 1e-11_wp
      type(cvode_t) :: integrator
      type(equations_t), target :: equations
      type(response_t) :: summed, integrated
      type(work_t) :: work
      type(error_t), allocatable :: error

      call prepare(e)
      integrator = cvode_t(rtol=rtol, max_steps=5000000_ip)
      equations = new_equations(galerkin, e%structure, e%excitation)
      call solver%respond(equations, e%excitation, e%sampling%times, summed, work, error)
      if (allocated(error)) then
         call check(name//', modal', .false., error%message)
         return
      end if
      call integrator%respond(equations, e%excitation, e%sampling%times, integrated, work, error)
      if (allocated(error)) then
         call check(name//', cvode', .false., error%message)
         return
      end if
      call check_close(name//', modal against cvode', maxval(abs(summed%displacement &
         - integrated%displacement))/maxval(abs(integrated%displacement)), 0.0_wp, &
         accumulated_error(rtol, work%steps))
   end subroutine compare

   !> modal against the full matrices in quadruple precision.
   !>
   !> allowed  of displacement, velocity, acceleration
   subroutine compare_full(name, e, allowed)
      character(len=*), intent(in) :: name
      type(experiment_t), intent(in) :: e
      real(wp), intent(in) :: allowed(3)
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), known(:, :), none(:, :, :)
      logical :: lost
      integer :: m

      call prepare(e)
      call exact(e, [integer ::], columns, none, error)
      if (allocated(error)) then
         call check(name//': a response', .false., error%message)
         return
      end if
      call references(e, [integer ::], known, none, lost)
      call check(name//': a reference', .not. lost)
      do m = 1, 3
         call check_close(name//', '//trim(kinds(m)), relative(columns(:, m), known(:, m)), &
            0.0_wp, allowed(m))
      end do
   end subroutine compare_full

end module attached_beams
