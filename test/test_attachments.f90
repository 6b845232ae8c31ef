!> What hangs on a beam besides tip mass and hose: air damping, rotary inertia, a root that turns, a
!> sensor with a mass anywhere. Against published numbers, characteristic equations, full matrices,
!> CVODE, and differences in quadruple precision.
program test_attachments
   use, intrinsic :: iso_fortran_env, only: int64
   use beamid_assembly, only: new_assembly
   use beamid_bands, only: band_t
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: ip, wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t, undamped_modes
   use beamid_observation, only: observation_t, new_sampling, sampling_t
   use beamid_parameters, only: magnitude, parameter_names
   use beamid_poles, only: find_poles, poles_t
   use beamid_responses, only: response_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: at_tip, of_c_R, of_gamma, of_J_T, of_k_R, of_length, of_m_S, of_m_T, &
      of_x_S, rigid, sensor_t, structure_t
   use checks, only: check, check_close, finish
   use full_matrices, only: full_t, new_full, qp
   implicit none

   integer, parameter :: samples = 12, every = of_x_S
   character(len=*), parameter :: kinds(4) = [character(len=12) :: 'displacement', 'velocity', &
      'acceleration', 'observation']
   !> Everything at once: rho = E I = l = 1.
   type(structure_t), parameter :: everything = structure_t(length=1, rho=1, E=1, I=1, &
      c_D=1e-3_wp, m_T=0.5_wp, m_H=0.3_wp, c_H=0.2_wp, k_H=20, gamma=0.05_wp, J_T=0.02_wp, &
      k_R=5, sensor=sensor_t(m_S=0.1_wp, x_S=0.6_wp))
   !> The beam alone, hardly damped.
   type(structure_t), parameter :: plain = structure_t(length=1, rho=1, E=1, I=1, c_D=1e-3_wp)
   !> Quintics: their frequencies are wrong by (beta h)**8/3e6.
   type(mesh_t), parameter :: fine = mesh_t(5, 24, 6, 1), coarse = mesh_t(5, 3, 6, 1)
   real(wp), parameter :: eps = epsilon(1.0_wp), pi = acos(-1.0_wp)
   !> What CVODE leaves with rtol = 1e-11: some hundred times as much of the largest displacement.
   real(wp), parameter :: cvode_error = 1e-8_wp

   !> One experiment.
   type :: experiment_t
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(mesh_t) :: mesh
      type(sampling_t) :: sampling
   end type experiment_t

   !> What many structures showed of one motion or its derivative.
   type :: tally_t
      integer :: compared = 0, beyond = 0, worst_at = 0
      !> relative, in the 2-norm over the samples; of a derivative times the parameter, relative to
      !> the motion
      real(wp) :: worst = 0, worst_of_motion = 0
   end type tally_t

   interface
      subroutine dggev(jobvl, jobvr, n, a, lda, b, ldb, alphar, alphai, beta, vl, ldvl, vr, ldvr, &
         work, lwork, info)
         import :: wp
         character, intent(in) :: jobvl, jobvr
         integer, intent(in) :: n, lda, ldb, ldvl, ldvr, lwork
         real(wp), intent(inout) :: a(lda, *), b(ldb, *)
         real(wp), intent(out) :: alphar(*), alphai(*), beta(*), vl(ldvl, *), vr(ldvr, *), work(*)
         integer, intent(out) :: info
      end subroutine dggev
   end interface

   integer(int64) :: state = 20240301
   type(galerkin_t), target :: galerkin
   type(modal_t) :: solver

   call test_published()
   call test_rotary_inertia()
   call test_soft_root()
   call test_soft_mass()
   call test_soft_root_limits()
   call test_static()
   call test_sensor_at_tip()
   call test_lapack()
   call test_alone()
   call test_together()
   call test_quadrature()
   call test_at_zero()
   call test_limits()
   call test_air()
   call test_many_derivatives()
   call test_many_roots()
   call test_walk()
   call finish('attachments')

contains

   !> Uniform in (0, 1): Lehmer's generator with the multiplier 48271.
   real(wp) function uniform()
      state = modulo(48271_int64*state, 2147483647_int64)
      uniform = real(state, wp)/2147483647
   end function uniform

   !> Between two values.
   real(wp) function between(low, high)
      real(wp), intent(in) :: low, high

      between = low + (high - low)*uniform()
   end function between

   !> Evenly distributed in decades, between two powers of ten.
   real(wp) function decades(low, high)
      real(wp), intent(in) :: low, high

      decades = 10**between(low, high)
   end function decades

   !> Integrals for a structure, whose root may turn if it is soft.
   function mesh_of(mesh, structure) result(integrals)
      type(mesh_t), intent(in) :: mesh
      type(structure_t), intent(in) :: structure
      type(galerkin_t) :: integrals

      integrals = new_galerkin(mesh, structure%length, turning=structure%has_root_spring())
   end function mesh_of

   !> Beams as in the test of derivatives, with everything on them: tip masses of .001 to 100 beams,
   !> damping of mode 1 by the material and by the air from 1e-5 to critical; rotary inertias of
   !> radii of 1e-3 to .3 lengths; roots of 1e-2 to 1e3 times E I/l; sensors of 1e-3 to 1 beams;
   !> hoses of .001 to 10 beams, at a tenth to thirty times the beam's frequency, damped from
   !> 1e-3 to 30 times critically.
   function random_structure() result(s)
      type(structure_t) :: s
      real(wp) :: mass

      s%length = decades(-1.0_wp, 1.5_wp)
      s%rho = decades(-2.0_wp, 2.0_wp)
      s%E = decades(-2.0_wp, 4.0_wp)
      s%I = decades(-1.0_wp, 1.0_wp)
      mass = s%rho*s%length
      s%m_T = mass*decades(-3.0_wp, 2.0_wp)
      s%J_T = (mass + s%m_T)*(s%length*decades(-3.0_wp, -0.5_wp))**2
      s%k_R = s%E*s%I/s%length*decades(-2.0_wp, 3.0_wp)
      s%c_R = 0.05_wp*s%k_R/s%omega()
      s%sensor(1)%m_S = mass*decades(-3.0_wp, 0.0_wp)
      s%sensor(1)%x_S = s%length*between(0.05_wp, 1.0_wp)
      s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 0.0_wp)
      s%gamma = 2*s%rho*s%omega()*decades(-5.0_wp, 0.0_wp)
      s%m_H = mass*decades(-3.0_wp, 1.0_wp)
      s%k_H = s%m_H*(s%omega()*decades(-1.0_wp, 1.5_wp))**2
      s%c_H = 2*sqrt(s%k_H*s%m_H)*decades(-3.0_wp, 1.5_wp)
   end function random_structure

   !> Two to six elements of degree 3 or 5; a pulse or a table, at the tip or distributed; some
   !> samples in the first few periods.
   function random_experiment(structure) result(e)
      type(structure_t), intent(in) :: structure
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp) :: period, times(samples), t
      integer :: k

      e%structure = structure
      e%mesh = mesh_t(3, 2 + int(5*uniform()), 4, 1)
      if (uniform() < 0.3_wp) e%mesh = mesh_t(5, 2 + int(3*uniform()), 6, 1)
      period = 2*pi/structure%omega()
      if (uniform() < 0.5_wp) then
         e%excitation = new_pulse(decades(-1.0_wp, 1.0_wp), period*decades(-2.0_wp, 0.0_wp))
      else
         call new_force_table(period*[0.0_wp, between(0.01_wp, 0.1_wp), between(0.11_wp, 0.5_wp)], &
            [between(0.0_wp, 1.0_wp), between(-1.0_wp, 1.0_wp), between(0.0_wp, 1.0_wp)], &
            e%excitation, error)
      end if
      e%excitation%distributed = uniform() < 0.3_wp
      t = 0
      do k = 1, samples
         t = t + period*between(0.02_wp, 0.4_wp)
         times(k) = t
      end do
      k = 1 + int(2*uniform())
      e%sampling = new_sampling(observation_t(k, period*between(0.01_wp, 0.1_wp)), times)
   end function random_experiment

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
      real(qp) :: change(size(e%sampling%times), 3, size(parameters)), close
      integer :: i, k, p

      ! What inverse iteration leaves: 1e-8 of a difference over 1e-16; for a motion 1e-20 is as
      ! good as nothing. A J_T of 1e6 beams alone costs ten digits of 34.
      close = merge(1e-20_qp, 1e-24_qp, size(parameters) == 0)
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
         if (.not. last <= close*abs(s)) lost = .true.
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

   !> Poles of a structure on the mesh at hand, a force at the tip.
   subroutine poles_of(structure, poles, error)
      type(structure_t), intent(in) :: structure
      type(poles_t), intent(out) :: poles
      type(error_t), allocatable, intent(out) :: error
      type(beam_modes_t) :: modes

      call bare_beam_modes(galerkin, modes, error)
      if (allocated(error)) return
      call find_poles(new_assembly(structure, modes, [integer ::]), modes, poles, error)
   end subroutine poles_of

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

   !> The mesh of an experiment, and the solver ready for it.
   subroutine prepare(e)
      type(experiment_t), intent(in) :: e
      type(error_t), allocatable :: error

      galerkin = mesh_of(e%mesh, e%structure)
      call solver%prepare(galerkin, error)
      if (allocated(error)) call check('a mesh', .false., error%message)
   end subroutine prepare

   !> 2-norm of the difference over that of the second.
   pure real(wp) function relative(a, b)
      real(wp), intent(in) :: a(:), b(:)

      relative = norm2(a - b)/norm2(b)
   end function relative

   !> modal against cvode, displacement relative to its maximum.
   subroutine compare(name, e, allowed)
      character(len=*), intent(in) :: name
      type(experiment_t), intent(in) :: e
      real(wp), intent(in) :: allowed
      type(cvode_t) :: integrator
      type(equations_t), target :: equations
      type(response_t) :: summed, integrated
      type(work_t) :: work
      type(error_t), allocatable :: error

      call prepare(e)
      integrator = cvode_t(rtol=1e-11_wp, max_steps=5000000_ip)
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
         - integrated%displacement))/maxval(abs(integrated%displacement)), 0.0_wp, allowed)
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

   !> The roots of a structure on a mesh, lowest first; a failure is a failed check.
   subroutine all_roots(name, structure, mesh, roots)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      complex(wp), allocatable, intent(out) :: roots(:)
      type(equations_t), target :: equations
      type(error_t), allocatable :: error

      galerkin = mesh_of(mesh, structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      if (.not. allocated(error)) return
      call check(name//': roots', .false., error%message)
      allocate (roots(equations%n), source=(0.0_wp, 0.0_wp))
   end subroutine all_roots

   !> Undamped angular frequencies by LAPACK, and from the roots: both against the reference.
   subroutine check_frequencies(name, structure, mesh, omega, allowed)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(in) :: omega(:), allowed(:)
      type(equations_t), target :: equations
      type(error_t), allocatable :: error
      complex(wp), allocatable :: roots(:)
      real(wp), allocatable :: values(:), shapes(:, :)
      integer :: k

      call all_roots(name, structure, mesh, roots)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, values, shapes, error)
      call check(name//': modes', .not. allocated(error))
      if (allocated(error)) return
      do k = 1, size(omega)
         call check_close(name//': root '//to_text(k), abs(roots(k)), omega(k), allowed(k))
         call check_close(name//': mode '//to_text(k), values(k), omega(k), allowed(k))
      end do
   end subroutine check_frequencies

   !> Banks, Wang, Inman, Slater (1994): seven digits are printed, half a unit of the last is 8e-8
   !> of the first frequency and 2.6e-7 of the damping. 24 quintics are right to 1e-13 here.
   subroutine test_published()
      type(structure_t), parameter :: beam = structure_t(length=0.4573_wp, rho=0.093_wp, &
         E=0.491_wp, I=1, c_D=0.649e-5_wp, gamma=0.013_wp)
      real(wp), parameter :: hertz(2) = [6.148480_wp, 38.531865_wp], &
         zeta(2) = [2.064502e-3_wp, 1.888738e-3_wp]
      complex(wp), allocatable :: roots(:)
      integer :: k

      call all_roots('published', beam, fine, roots)
      do k = 1, 2
         call check_close('published beam in air, frequency '//to_text(k), &
            abs(roots(k))/(2*pi)/hertz(k), 1.0_wp, 1e-7_wp)
         call check_close('published beam in air, damping '//to_text(k), &
            -real(roots(k))/abs(roots(k))/zeta(k), 1.0_wp, 1e-6_wp)
      end do
   end subroutine test_published

   !> rho = E I = l = m_T = 1, J_T = .01. Eight to nine digits are given, of which half a unit of
   !> the last is allowed, on 12 quintics ((beta h)**8/3e6 is 1e-9 in mode 3); and fifteen, from the
   !> equation of test_soft_root with k_R = 1e30, on 24 quintics (4e-12 in mode 3).
   subroutine test_rotary_inertia()
      real(wp), parameter :: given(3) = [1.5436768_wp, 13.2395886_wp, 32.0695808_wp], &
         more(3) = [1.54367680340585_wp, 13.2395885595353_wp, 32.0695808100812_wp], &
         allowed(3) = [1e-12_wp, 1e-12_wp, 4e-12_wp]
      type(structure_t) :: structure

      structure = structure_t(length=1, rho=1, E=1, I=1, m_T=1, J_T=0.01_wp)
      call check_frequencies('J_T, 12 quintics', structure, mesh_t(5, 12, 6, 1), given, &
         spread(0.51e-7_wp, 1, 3))
      call check_frequencies('J_T, 24 quintics', structure, fine, more, allowed*more)
      ! The same in other units: length 10, time 1/7, mass 3.
      structure = structure_t(length=10, rho=0.3_wp, E=3*49*1000, I=1, m_T=3, J_T=3)
      call check_frequencies('J_T, 24 quintics, other units', structure, fine, 7*more, &
         allowed*7*more)
   end subroutine test_rotary_inertia

   !> rho = E I = l = 1, w = c_1 cos bx + c_2 sin bx + c_3 cosh bx + c_4 sinh bx, omega = b**2.
   !> At the root w = 0 and D2 w = k_R D w, whence c_3 = -c_1 and -2 b c_1 = k_R (c_2 + c_4). At the
   !> tip D2 w = J_T b**4 D w and D3 w = -m_T b**4 w: a determinant of order two, whose zeros, found
   !> with 40 digits (mpmath), are below; k_R = 1e30 gives the numbers of the rigid root. 24
   !> quintics: (beta h)**8/3e6 is 2e-11 for mode 3; round-off 1e-12.
   subroutine test_soft_root()
      real(wp), parameter :: springs(3) = [0.01_wp, 1.0_wp, 100.0_wp], masses(2) = [0.0_wp, 1.0_wp]
      real(wp), parameter :: beta(3, 3, 2) = reshape([ &
         0.4159342406748482_wp, 3.927804794675281_wp, 7.069291233042889_wp, &
         1.247917409606469_wp, 4.03113943671496_wp, 7.134132240939746_wp, &
         1.856786976958346_wp, 4.649726483419041_wp, 7.782671239730861_wp, &
         0.2940588611652282_wp, 3.274730732474585_wp, 6.356763479177092_wp, &
         0.8704773056997986_wp, 3.394721773466456_wp, 6.427324748089851_wp, &
         1.238147804359155_wp, 3.993634977773456_wp, 7.068770743890649_wp], [3, 3, 2])
      !> k_R = 5, m_T = .5, J_T = .02
      real(wp), parameter :: both(3) = [1.236015753729718_wp, 3.147089605971209_wp, &
         5.011127700593093_wp]
      type(structure_t) :: structure
      integer :: i, m

      do m = 1, size(masses)
         do i = 1, size(springs)
            structure = structure_t(length=1, rho=1, E=1, I=1, m_T=masses(m), k_R=springs(i))
            call check_frequencies('k_R = '//to_text(springs(i))//', m_T = '//to_text(masses(m)), &
               structure, fine, beta(:, i, m)**2, &
               (1e-12_wp + (beta(:, i, m)/24)**8/1e6_wp)*beta(:, i, m)**2)
         end do
      end do
      structure = structure_t(length=1, rho=1, E=1, I=1, m_T=0.5_wp, k_R=5, J_T=0.02_wp)
      call check_frequencies('k_R, m_T and J_T', structure, fine, both**2, &
         (1e-12_wp + (both/24)**8/1e6_wp)*both**2)
      ! Cubics: (beta h)**4/1440 and round-off.
      call check_frequencies('k_R, m_T and J_T, 64 cubics', structure, mesh_t(3, 64, 4, 1), &
         both**2, (1e-11_wp + (both/64)**4/1000)*both**2)
   end subroutine test_soft_root

   !> Undamped beams with a soft root and a tip mass, and nothing else: the search for the roots
   !> then starts at roots of the clamped beam with its tip mass, where W'/W cannot be told. Every
   !> root is one of LAPACK's frequencies. w = x is nearly a combination of the clamped modes of a
   !> fine mesh, which costs the highest modes of 19 quintics up to eight digits; the rest are right
   !> to 1e-12.
   subroutine test_soft_mass()
      type(structure_t) :: structure
      type(mesh_t) :: mesh
      type(equations_t), target :: equations
      type(error_t), allocatable :: error
      complex(wp), allocatable :: roots(:)
      real(wp), allocatable :: omega(:), shapes(:, :)
      real(wp) :: off
      integer :: number, wrong

      wrong = 0
      do number = 1, 200
         structure = structure_t(length=1, rho=1, E=1, I=1, m_T=decades(-1.0_wp, 1.0_wp), &
            k_R=decades(-2.0_wp, 3.0_wp))
         mesh = mesh_t(3 + 2*modulo(number, 2), 2 + int(18*uniform()), 6, 1)
         call all_roots('soft root and tip mass', structure, mesh, roots)
         equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
         call undamped_modes(equations, omega, shapes, error)
         if (size(roots) /= size(omega)) then
            wrong = wrong + 1
            cycle
         end if
         off = maxval(abs(abs(roots) - omega)/omega)
         if (.not. off <= 1e-7_wp) wrong = wrong + 1
      end do
      call check('soft root and tip mass: all roots of 200 beams', wrong == 0, to_text(wrong))
   end subroutine test_soft_mass

   !> A root ever stiffer answers like the rigid one: its turn adds E I/(l k_R) of the displacement
   !> and some ten times that in the phase. A root ever softer swings like a rigid bar on a spring,
   !> omega**2 (rho l**3/3 + m_T l**2 + J_T + m_S x_S**2) = k_R but for terms of order k_R l/(E I).
   subroutine test_soft_root_limits()
      type(experiment_t) :: stiff, rigid_root
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), known(:, :), none(:, :, :)
      complex(wp), allocatable :: roots(:)
      type(structure_t) :: bar
      real(wp) :: inertia
      integer :: i

      rigid_root = random_experiment(everything)
      rigid_root%mesh = coarse
      rigid_root%structure%k_R = rigid
      call prepare(rigid_root)
      call exact(rigid_root, [integer ::], known, none, error)
      call check('rigid root: a response', .not. allocated(error))
      do i = 2, 30, 4
         stiff = rigid_root
         stiff%structure%k_R = 10.0_wp**i
         call prepare(stiff)
         call exact(stiff, [integer ::], columns, none, error)
         call check_close('k_R = 1e'//to_text(i)//': as a rigid root', &
            relative(columns(:, 1), known(:, 1)), 0.0_wp, 50*10.0_wp**(-i) + 1e-12_wp)
         if (i == 2) call check('k_R = 100: not quite rigid', relative(columns(:, 1), &
            known(:, 1)) > 1e-3_wp, to_text(relative(columns(:, 1), known(:, 1))))
      end do
      bar = everything
      bar%m_H = 0
      bar%gamma = 0
      bar%c_D = 0
      inertia = bar%rho*bar%length**3/3 + bar%m_T*bar%length**2 + bar%J_T + bar%sensor(1)%m_S*bar%sensor(1)%x_S**2
      do i = 2, 10, 2
         bar%k_R = 10.0_wp**(-i)
         call all_roots('bar', bar, coarse, roots)
         call check_close('k_R = 1e-'//to_text(i)//': a bar on a spring', &
            abs(roots(1))*sqrt(inertia/bar%k_R), 1.0_wp, bar%k_R + 1e-12_wp)
         bar%c_R = 2*0.3_wp*sqrt(inertia*bar%k_R)
         call all_roots('bar', bar, coarse, roots)
         call check_close('k_R = 1e-'//to_text(i)//': damped at the root, 30 % of critical', &
            -real(roots(1))*sqrt(inertia/bar%k_R), 0.3_wp, sqrt(bar%k_R) + 1e-12_wp)
         bar%c_R = 0
      end do
   end subroutine test_soft_root_limits

   !> A force at the tip bends the beam by x**2 (3 l - x)/(6 E I) and turns the root by l/k_R. The
   !> splines hold a cubic without error. By a step that has long been on (the slowest mode decays
   !> like e**(-.02 t)), by the residues, and by K.
   subroutine test_static()
      type(experiment_t) :: e
      type(equations_t), target :: equations
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), none(:, :, :), x(:)
      real(wp), parameter :: places(3) = [0.3_wp, 0.6_wp, 1.0_wp]
      real(wp) :: deflection
      logical :: positive
      integer :: i, k
      character(len=:), allocatable :: name

      e%mesh = mesh_t(3, 5, 4, 1)
      e%excitation = new_pulse(1.0_wp, 1e6_wp)
      e%sampling = new_sampling(observation_t(3, 0.0_wp), [(5000.0_wp + k, k=1, samples)])
      do i = 1, size(places)
         e%structure = everything
         e%structure%sensor(1)%x_S = places(i)
         name = 'static, x_S = '//to_text(places(i))
         associate (s => e%structure)
            deflection = places(i)**2*(3*s%length - places(i))/(6*s%E*s%I) &
               + s%length*places(i)/s%k_R
         end associate
         call prepare(e)
         call exact(e, [integer ::], columns, none, error)
         call check_close(name//', a long step', columns(1, 1), deflection, 1e-12_wp)
         call poles_of(e%structure, poles, error)
         call check(name//': poles', .not. allocated(error))
         if (allocated(error)) cycle
         call check_close(name//', residues', -real(sum(poles%residue/poles%s)), deflection, &
            1e-12_wp)
         equations = new_equations(galerkin, e%structure, e%excitation)
         x = equations%load
         call equations%stiffness%factor(positive)
         call equations%stiffness%solve(x)
         ! K has a condition of 1e4.
         call check_close(name//', K', dot_product(equations%observer, x), deflection, 1e-12_wp)
      end do
      ! The tip: l**3/(3 E I) + l**2/k_R, which is also what `stiffness` says.
      call check_close('static, compliance of the tip', 1/everything%stiffness(), &
         1/3.0_wp + 1/5.0_wp, 4*eps)
   end subroutine test_static

   !> m_S at the tip is tip mass, whichever way the place is given; and it is not when x_S < l.
   subroutine test_sensor_at_tip()
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable, dimension(:, :) :: at_end, by_default, as_mass, inside
      real(wp), allocatable, dimension(:, :, :) :: d_end, d_default, d_mass, d_inside
      real(wp), allocatable :: riding(:)
      character(len=:), allocatable :: name
      integer :: k, root

      do root = 1, 2
         e = random_experiment(everything)
         if (root == 2) e%structure%k_R = rigid
         name = merge('soft root, sensor ', 'rigid root, sensor', root == 1)
         e%structure%sensor(1)%x_S = e%structure%length
         call prepare(e)
         call exact(e, [(k, k=1, every)], at_end, d_end, error)
         call check(name//' at x_S = l: a response', .not. allocated(error))
         e%structure%sensor(1)%x_S = at_tip
         call prepare(e)
         call exact(e, [(k, k=1, every)], by_default, d_default, error)
         call check(name//' at the tip: a response', .not. allocated(error))
         e%structure%m_T = e%structure%m_T + e%structure%sensor(1)%m_S
         e%structure%sensor(1)%m_S = 0
         call prepare(e)
         call exact(e, [(k, k=1, every)], as_mass, d_mass, error)
         call check(name//', tip mass m_T + m_S: a response', .not. allocated(error))
         ! A few roundings in each root, times the phase, 1e3.
         call check_close(name//' at x_S = l: as by default', relative(by_default(:, 3), &
            at_end(:, 3)), 0.0_wp, 1e-11_wp)
         call check_close(name//' at x_S = l: as tip mass', relative(as_mass(:, 3), &
            at_end(:, 3)), 0.0_wp, 1e-11_wp)
         do k = 1, every
            if (root == 2 .and. any(k == [of_k_R, of_c_R])) then
               call check('rigid root: derivatives by '//trim(parameter_names(k))//' vanish', &
                  all(abs(d_end(:, :, k)) <= 0))
               cycle
            end if
            ! By default the sensor stays at the tip of a beam that grows.
            riding = d_end(:, 3, k)
            if (k == of_length) riding = riding + d_end(:, 3, of_x_S)
            call check_close(name//' at x_S = l: as by default, d/d '//trim(parameter_names(k)), &
               relative(d_default(:, 3, k), riding), 0.0_wp, 1e-10_wp)
            ! With m_S = 0 the sensor drags no mass along.
            if (k == of_x_S) cycle
            call check_close(name//' at x_S = l: as tip mass, d/d '//trim(parameter_names(k)), &
               relative(d_mass(:, 3, k), riding), 0.0_wp, 1e-10_wp)
         end do
         call check_close(name//' at the tip: d/d m_S is d/d m_T', relative(d_end(:, 3, of_m_S), &
            d_end(:, 3, of_m_T)), 0.0_wp, 1e-10_wp)
         e%structure%m_T = everything%m_T
         e%structure%sensor(1)%m_S = everything%sensor(1)%m_S
         e%structure%sensor(1)%x_S = 0.9_wp
         call prepare(e)
         call exact(e, [(k, k=1, every)], inside, d_inside, error)
         call check(name//' at .9 l: another motion', relative(inside(:, 1), at_end(:, 1)) &
            > 1e-2_wp, to_text(relative(inside(:, 1), at_end(:, 1))))
      end do
   end subroutine test_sensor_at_tip

   !> All eigenvalues of [0 1; -K -C] - s [1 0; 0 M] by LAPACK's QZ, full matrices. Its error is
   !> some eps times the norms of the two, which at these N is up to 1e-12 of the largest root
   !> and, by the condition of M, 1e-10 of a large one itself.
   subroutine test_lapack()
      type(structure_t) :: cases(4)
      type(full_t) :: full
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      real(wp), allocatable :: a(:, :), b(:, :), work(:), re(:), im(:), beta(:)
      real(wp) :: nothing(1, 1), worst
      complex(wp) :: s
      type(mesh_t), parameter :: meshes(3) = [mesh_t(3, 2, 4, 1), mesh_t(3, 4, 4, 1), &
         mesh_t(5, 3, 6, 1)]
      character(len=:), allocatable :: name
      integer :: i, k, m, n, info

      cases = everything
      cases(2)%k_R = rigid
      cases(3)%m_H = 0
      cases(3)%sensor(1)%x_S = 0.25_wp
      cases(4)%gamma = 30
      cases(4)%c_D = 0.1_wp
      do i = 1, size(cases)
         do m = 1, size(meshes)
            name = 'LAPACK, case '//to_text(i)//', degree '//to_text(meshes(m)%degree)//', N = '// &
               to_text(meshes(m)%elements)
            galerkin = mesh_of(meshes(m), cases(i))
            call poles_of(cases(i), poles, error)
            call check(name//': poles', .not. allocated(error))
            if (allocated(error)) cycle
            full = new_full(galerkin, cases(i), new_pulse(1.0_wp, 1.0_wp))
            n = full%n
            if (allocated(a)) deallocate (a, b, work, re, im, beta)
            allocate (a(2*n, 2*n), b(2*n, 2*n), source=0.0_wp)
            allocate (work(64*n), re(2*n), im(2*n), beta(2*n))
            a(n + 1:, :n) = -real(full%K, wp)
            a(n + 1:, n + 1:) = -real(full%C, wp)
            b(n + 1:, n + 1:) = real(full%M, wp)
            do k = 1, n
               a(k, n + k) = 1
               b(k, k) = 1
            end do
            call dggev('N', 'N', 2*n, a, 2*n, b, 2*n, re, im, beta, nothing, 1, nothing, 1, work, &
               size(work), info)
            call check(name//': as many roots', info == 0 .and. size(re) == 2*count(aimag( &
               poles%s) > 0) + count(.not. aimag(poles%s) > 0), to_text(size(poles%s)))
            worst = 0
            do k = 1, 2*n
               if (im(k) < 0) cycle
               s = cmplx(re(k), im(k), wp)/beta(k)
               worst = max(worst, minval(abs(poles%s - s))/(1e-12_wp*maxval(abs(poles%s)) &
                  + 1e-10_wp*abs(s)))
            end do
            call check(name//': the same roots', worst <= 1, to_text(worst)// &
               ' of what is allowed')
         end do
      end do
   end subroutine test_lapack

   !> Each attachment alone on a beam with some tip mass, and none of them; also overdamped. So
   !> little damps what BDF leaves behind that CVODE is off by a few times more than elsewhere.
   subroutine test_alone()
      character(len=*), parameter :: names(8) = [character(len=12) :: 'nothing', 'gamma', 'J_T', &
         'k_R', 'm_S', 'only x_S', 'gamma = 100', 'hose']
      type(experiment_t) :: e
      type(structure_t) :: structure
      character(len=:), allocatable :: name
      integer :: i, load

      do i = 1, size(names)
         do load = 1, 2
            structure = plain
            structure%m_T = 0.2_wp
            select case (i)
            case (2); structure%gamma = 0.3_wp
            case (3); structure%J_T = 0.05_wp
            case (4); structure%k_R = 2
            case (5); structure%sensor(1)%m_S = 0.2_wp
            case (7); structure%gamma = 100
            case (8); structure%m_H = 0.1_wp
            end select
            if (i == 5 .or. i == 6) structure%sensor(1)%x_S = 0.45_wp
            if (i == 8) structure%k_H = 1
            e = random_experiment(structure)
            e%excitation%distributed = load == 2
            e%mesh = mesh_t(2*load + 1, 3, 6, 1)
            name = trim(names(i))//merge(', at the tip ', ', distributed', load == 1)
            call compare_full(name, e, [1e-12_wp, 1e-11_wp, 1e-10_wp])
            call compare(name, e, 5*cvode_error)
         end do
      end do
   end subroutine test_alone

   !> Everything together, at random; every fourth with air so thick that the first mode is
   !> overdamped, every fourth with so much viscosity.
   subroutine test_together()
      type(experiment_t) :: e
      type(structure_t) :: structure
      character(len=:), allocatable :: name
      integer :: number

      do number = 1, 40
         structure = random_structure()
         name = 'random '//to_text(number)
         if (modulo(number, 4) == 1) then
            structure%gamma = structure%omega()*(structure%rho + structure%m_T/structure%length) &
               *decades(0.5_wp, 1.5_wp)
            name = name//', thick air'
         else if (modulo(number, 4) == 3) then
            structure%c_D = 2*structure%E/structure%omega()*decades(0.0_wp, 0.5_wp)
            name = name//', viscous'
         end if
         e = random_experiment(structure)
         e%mesh = mesh_t(3 + 2*modulo(number/2, 2), 2 + modulo(number, 5), 6, 1)
         e%excitation%distributed = modulo(number/2, 3) == 0
         call compare(name//', degree '//to_text(e%mesh%degree)//', N = '// &
            to_text(e%mesh%elements), e, cvode_error)
      end do
   end subroutine test_together

   !> Rules that are not exact, for the mass and for the distributed load: a root that turns must
   !> meet with the integrals that the mesh has, as everything else does. Round-off alone remains.
   subroutine test_quadrature()
      type(mesh_t), parameter :: meshes(4) = [mesh_t(3, 4, 1, 4), mesh_t(3, 4, 2, 1), &
         mesh_t(3, 3, 3, 1), mesh_t(5, 3, 4, 1)]
      real(wp), parameter :: powers(3) = [2.0_wp, 2.5_wp, 3.0_wp]
      type(experiment_t) :: e
      integer :: m, p

      do m = 1, size(meshes)
         do p = 1, size(powers)
            e = random_experiment(everything)
            e%mesh = meshes(m)
            e%excitation%distributed = .true.
            e%excitation%power = powers(p)
            call compare_full('rule of '//to_text(meshes(m)%gauss_points)//' x '// &
               to_text(meshes(m)%panels)//', power '//to_text(powers(p)), e, &
               [1e-12_wp, 1e-11_wp, 1e-10_wp])
         end do
      end do
   end subroutine test_quadrature

   !> Derivatives where a parameter is 0, or the sensor where it is by default: those of a fit that
   !> starts there, against one-sided differences; the same when a plain response was asked for
   !> before; and the sensor near the root, and at the tip.
   subroutine test_at_zero()
      integer, parameter :: some(7) = [of_m_T, of_gamma, of_J_T, of_k_R, of_c_R, of_m_S, &
         of_x_S]
      character(len=*), parameter :: names(9) = [character(len=20) :: 'J_T = 0', 'm_S = 0', &
         'gamma = 0', 'all of them 0', 'x_S by default', 'J_T = 0, x_S default', &
         'x_S = .001 l', 'x_S = l', 'nothing at all'], &
         roots(2) = [character(len=10) :: 'soft root', 'rigid root']
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable, dimension(:, :) :: columns, known
      real(wp), allocatable, dimension(:, :, :) :: derivatives, later, reference
      character(len=:), allocatable :: name
      real(wp) :: allowed
      logical :: lost
      integer :: i, k, m, root

      do root = 1, 2
         do i = 1, size(names)
            e = random_experiment(everything)
            e%mesh = coarse
            if (root == 2) e%structure%k_R = rigid
            associate (s => e%structure)
               if (any(i == [1, 4, 6, 9])) s%J_T = 0
               if (any(i == [2, 4, 9])) s%sensor(1)%m_S = 0
               if (any(i == [3, 4, 9])) s%gamma = 0
               if (any(i == [5, 6, 9])) s%sensor(1)%x_S = at_tip
               if (i == 7) s%sensor(1)%x_S = 0.001_wp
               if (i == 8) s%sensor(1)%x_S = 1
               if (i == 9) s%m_T = 0
               if (i == 9) s%m_H = 0
            end associate
            name = trim(names(i))//', '//trim(roots(root))
            call prepare(e)
            call exact(e, some, columns, derivatives, error)
            call check(name//': derivatives', .not. allocated(error))
            call references(e, some, known, reference, lost)
            call check(name//': a reference', .not. lost)
            call prepare(e)
            call exact(e, [integer ::], columns, later, error)
            call exact(e, some, columns, later, error)
            if (allocated(error)) then
               call check(name//': derivatives after a response', .false., error%message)
               cycle
            end if
            do k = 1, size(some)
               if (root == 2 .and. any(some(k) == [of_k_R, of_c_R])) cycle
               do m = 1, 3
                  ! Sums over roots of relative error 1e-14 times the phase, 1e2; the acceleration
                  ! has all modes in it. A sensor near the root that is as heavy as the beam moves
                  ! the motion by 1e-9 of itself: of the motion, round-off counts.
                  allowed = 1e-9_wp
                  if (e%structure%get(some(k)) > 0) allowed = max(allowed, 1e-13_wp/ &
                     e%structure%get(some(k))*norm2(known(:, m))/norm2(reference(:, m, k)))
                  call check_close(name//', '//trim(kinds(m))//' by '// &
                     trim(parameter_names(some(k))), relative(derivatives(:, m, k), &
                     reference(:, m, k)), 0.0_wp, allowed)
                  call check_close(name//', after a response, '//trim(kinds(m))//' by '// &
                     trim(parameter_names(some(k))), relative(later(:, m, k), &
                     reference(:, m, k)), 0.0_wp, allowed)
               end do
            end do
         end do
      end do
   end subroutine test_at_zero

   !> Attachments from next to nothing to far more than the beam, in quadruple precision.
   subroutine test_limits()
      integer, parameter :: some(6) = [of_gamma, of_J_T, of_k_R, of_c_R, of_m_S, of_x_S]
      real(wp), parameter :: sizes(6) = [1e-12_wp, 1e-6_wp, 1e-3_wp, 1e2_wp, 1e4_wp, 1e6_wp]
      type(experiment_t) :: e
      real(wp) :: allowed(3)
      integer :: i, k

      do k = 1, size(some)
         do i = 1, size(sizes)
            e = random_experiment(everything)
            e%mesh = coarse
            ! A root of 1e-12 swings for a million of the beam's periods.
            if (some(k) == of_k_R .and. sizes(i) < 1e-6_wp) cycle
            if (some(k) == of_x_S .and. (sizes(i) < 1e-6_wp .or. sizes(i) > 1)) cycle
            call e%structure%set(some(k), sizes(i))
            ! Round-off times the phase; where the sensor hardly moves (x_S = 1e-6) the splines
            ! themselves are known to eps/x_S. In thick air the forces all but balance: of the
            ! acceleration there remains less than 1e-10 of its terms.
            allowed = [1e-11_wp, 1e-10_wp, 1e-9_wp]
            if (some(k) == of_x_S) allowed = allowed + 1e-9_wp
            if (some(k) == of_gamma .and. sizes(i) > 1e3_wp) allowed(3) = 2e-6_wp
            call compare_full(trim(parameter_names(some(k)))//' = '//to_text(sizes(i)), e, allowed)
         end do
      end do
   end subroutine test_limits

   !> Air on a beam with a soft root and nothing else damps all modes alike: s**2 + (gamma/rho) s +
   !> omega**2 = 0 with the undamped omega, by LAPACK. From thin to so thick that all modes of the
   !> mesh are overdamped; the fast roots then crowd at -gamma/rho.
   subroutine test_air()
      type(structure_t) :: structure
      type(equations_t), target :: equations
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp) :: s(2)
      real(wp) :: half, worst, gap
      character(len=:), allocatable :: name
      integer :: i, k

      structure = structure_t(length=2, rho=0.5_wp, E=3, I=1, k_R=1)
      galerkin = mesh_of(coarse, structure)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      do i = -6, 4
         structure%gamma = 10.0_wp**i
         name = 'air, gamma = 1e'//to_text(i)
         call poles_of(structure, poles, error)
         call check(name//': poles', .not. allocated(error))
         if (allocated(error)) cycle
         worst = 0
         do k = 1, size(omega)
            half = structure%gamma/structure%rho/2
            if (half < omega(k)) then
               s = cmplx(-half, sqrt(omega(k)**2 - half**2), wp)
            else
               s(2) = -half - sqrt(half**2 - omega(k)**2)
               s(1) = omega(k)**2/s(2)
            end if
            ! Near critical damping a root moves by omega/gap of the error of omega.
            gap = min(1.0_wp, sqrt(abs(half**2 - omega(k)**2))/omega(k))
            worst = max(worst, gap*minval(abs(poles%s - s(1)))/abs(s(1)), &
               gap*minval(abs(poles%s - s(2)))/abs(s(2)))
         end do
         call check_close(name//': roots', worst, 0.0_wp, 1e-10_wp)
         call check(name//': as many pairs as modes below critical damping', &
            count(aimag(poles%s) > 0) == count(omega > half), to_text(count(omega > half)))
      end do
   end subroutine test_air

   !> Derivatives of 300 random structures with respect to all parameters. The differences
   !> themselves are right to 1e-15 or so: what shows is the round-off of double precision.
   subroutine test_many_derivatives()
      type(experiment_t) :: e
      type(tally_t) :: tallies(0:every, size(kinds))
      type(error_t), allocatable :: error
      real(wp), allocatable, dimension(:, :) :: columns, known
      real(wp), allocatable, dimension(:, :, :) :: derivatives, reference
      character(len=:), allocatable :: name
      real(wp) :: sudden(size(kinds))
      integer :: number, k, m, refused, unknown
      logical :: lost

      refused = 0
      unknown = 0
      do number = 1, 300
         e = random_experiment(random_structure())
         call prepare(e)
         call exact(e, [(k, k=1, every)], columns, derivatives, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,2a)', '      structure ', number, ': ', error%message
            cycle
         end if
         call references(e, [(k, k=1, every)], known, reference, lost)
         if (lost) then
            unknown = unknown + 1
            cycle
         end if
         ! What is left of the acceleration that a force causes at once is known to the condition
         ! of M, 1e9 with a heavy J_T on a root that turns, times round-off of that.
         sudden = merge(1, 0, kinds == 'acceleration')*acceleration_at_once(e)
         do m = 1, size(kinds)
            call count_in(tallies(0, m), number, columns(:, m), known(:, m), &
               [known(:, m), sudden(m)], 1.0_wp)
            do k = 1, every
               call count_in(tallies(k, m), number, derivatives(:, m, k), reference(:, m, k), &
                  known(:, m), e%structure%get(k))
            end do
         end do
      end do
      call check('derivatives: none refused', refused == 0, to_text(refused))
      call check('derivatives: references for all', unknown == 0, to_text(unknown))
      do m = 1, size(kinds)
         call check_close('motions, '//trim(kinds(m))//' (structure '// &
            to_text(tallies(0, m)%worst_at)//'), worst of '// &
            to_text(tallies(0, m)%compared), tallies(0, m)%worst_of_motion, 0.0_wp, 1e-9_wp)
         do k = 1, every
            name = trim(kinds(m))//' by '//trim(parameter_names(k))
            associate (tally => tallies(k, m))
               ! Of a derivative that hardly counts (a motion changes by 1e-6 when the parameter
               ! doubles) few digits are left, but what it says of the motion is right. The length
               ! has four times the effect of E: frequencies go with l**-2 and E**(1/2).
               call check(name//': at most 3 % beyond 1e-7', tally%beyond <= 9, &
                  to_text(tally%beyond)//' of '//to_text(tally%compared)//', worst '// &
                  to_text(tally%worst))
               call check_close(name//', of the motion, worst of '//to_text(tally%compared)// &
                  ' (structure '//to_text(tally%worst_at)//')', tally%worst_of_motion, 0.0_wp, &
                  merge(4e-7_wp, 1e-7_wp, k == of_length))
            end associate
         end do
      end do
   end subroutine test_many_derivatives

   !> The largest acceleration that the force causes at once.
   real(wp) function acceleration_at_once(e) result(a)
      type(experiment_t), intent(in) :: e
      type(equations_t), target :: equations
      real(wp), allocatable :: x(:)
      logical :: positive

      equations = new_equations(galerkin, e%structure, e%excitation)
      x = equations%load
      call equations%mass%factor(positive)
      call equations%mass%solve(x)
      a = maxval(abs(e%excitation%f))*abs(dot_product(equations%observer, x))
   end function acceleration_at_once

   !> One motion of one structure.
   subroutine count_in(tally, number, found, expected, motion, parameter)
      type(tally_t), intent(inout) :: tally
      integer, intent(in) :: number
      real(wp), intent(in) :: found(:), expected(:), motion(:), parameter
      real(wp) :: wrong, of_motion

      wrong = relative(found, expected)
      of_motion = wrong*parameter*norm2(expected)/norm2(motion)
      tally%compared = tally%compared + 1
      if (.not. wrong <= 1e-7_wp) tally%beyond = tally%beyond + 1
      if (.not. wrong <= tally%worst) tally%worst = wrong
      if (of_motion <= tally%worst_of_motion) return
      tally%worst_of_motion = of_motion
      tally%worst_at = number
   end subroutine count_in

   !> Every parameter over six decades about the beam's own; each left out in one of ten.
   function wide_structure() result(s)
      type(structure_t) :: s
      real(wp) :: mass

      s%length = decades(-1.0_wp, 1.5_wp)
      s%rho = decades(-2.0_wp, 2.0_wp)
      s%E = decades(-2.0_wp, 4.0_wp)
      s%I = decades(-1.0_wp, 1.0_wp)
      mass = s%rho*s%length
      s%m_T = mass*decades(-3.0_wp, 3.0_wp)
      s%J_T = mass*s%length**2*decades(-5.0_wp, 1.0_wp)
      s%k_R = s%E*s%I/s%length*decades(-3.0_wp, 3.0_wp)
      s%c_R = 0.1_wp*s%k_R/s%omega()
      s%sensor(1)%m_S = mass*decades(-4.0_wp, 2.0_wp)
      s%sensor(1)%x_S = s%length*decades(-2.0_wp, 0.0_wp)
      s%c_D = 2*s%E/s%omega()*decades(-5.0_wp, 1.0_wp)
      s%gamma = 2*s%rho*s%omega()*decades(-4.0_wp, 2.0_wp)
      s%m_H = mass*decades(-4.0_wp, 2.0_wp)
      s%k_H = s%m_H*(s%omega()*decades(-3.0_wp, 3.0_wp))**2
      s%c_H = 2*sqrt(s%k_H*s%m_H)*decades(-4.0_wp, 2.0_wp)
      if (uniform() < 0.1_wp) s%m_T = 0
      if (uniform() < 0.1_wp) s%J_T = 0
      if (uniform() < 0.1_wp) s%k_R = rigid
      if (uniform() < 0.1_wp) s%sensor(1)%m_S = 0
      if (uniform() < 0.1_wp) s%sensor(1)%x_S = at_tip
      if (uniform() < 0.1_wp) s%c_D = 0
      if (uniform() < 0.1_wp) s%gamma = 0
      if (uniform() < 0.1_wp) s%m_H = 0
      if (uniform() < 0.1_wp) s%c_H = 0
   end function wide_structure

   !> 2000 structures: 2 n roots each, sum log |s| = log det K - log det M, sum s =
   !> -trace(M**-1 C), sum 1/s = -trace(K**-1 C), the last two relative to the sums of moduli. In
   !> every fifth, inverse iteration in quadruple precision leads from each root to one of its own.
   subroutine test_many_roots()
      type(structure_t) :: structure
      type(equations_t), target :: equations
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      type(mesh_t) :: mesh
      real(wp) :: worst(3)
      integer :: number, refused, miscounted, lost

      refused = 0
      miscounted = 0
      lost = 0
      worst = 0
      do number = 1, 2000
         structure = wide_structure()
         mesh = mesh_t(3, 2 + int(5*uniform()), 4, 1)
         if (uniform() < 0.3_wp) mesh = mesh_t(5, 2 + int(5*uniform()), 6, 1)
         galerkin = mesh_of(mesh, structure)
         call poles_of(structure, poles, error)
         if (allocated(error)) then
            refused = refused + 1
            print '(a,i0,2a)', '      structure ', number, ': ', error%message
            cycle
         end if
         equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
         associate (pairs => count(aimag(poles%s) > 0))
            if (size(poles%s) + pairs /= 2*equations%n) miscounted = miscounted + 1
         end associate
         worst = max(worst, sum_rules(equations, poles%s))
         if (modulo(number, 5) == 0) lost = lost + lost_roots(structure, poles)
      end do
      call check('roots: none of 2000 structures refused', refused == 0, to_text(refused))
      call check('roots: 2 n of each', miscounted == 0, to_text(miscounted))
      call check('roots: each its own in quadruple precision', lost == 0, to_text(lost))
      ! The references lose digits to the condition of M and K, 1e9 with masses and springs that are
      ! a thousand times the beam's. A root that is taken twice for another would show as the
      ! logarithm of their ratio.
      call check_close('roots: sum of logarithms', worst(1), 0.0_wp, 1e-7_wp)
      call check_close('roots: sum', worst(2), 0.0_wp, 1e-7_wp)
      call check_close('roots: sum of inverses', worst(3), 0.0_wp, 1e-7_wp)
   end subroutine test_many_roots

   !> By how much the three rules are missed.
   function sum_rules(equations, s) result(off)
      type(equations_t), intent(in) :: equations
      complex(wp), intent(in) :: s(:)
      real(wp) :: off(3), weight(size(s))

      weight = merge(2.0_wp, 1.0_wp, aimag(s) > 0)
      off(1) = abs(sum(weight*log(abs(s))) - log_determinant(equations%stiffness) &
         + log_determinant(equations%mass))
      off(2) = abs(sum(weight*real(s)) + trace(equations%mass, equations%damping)) &
         /sum(weight*abs(s))
      off(3) = abs(sum(weight*real(1/s)) + trace(equations%stiffness, equations%damping)) &
         /sum(weight/abs(s))
      ! max() would lose a NaN.
      where (.not. off >= 0) off = huge(off)
   end function sum_rules

   !> Logarithm of the determinant.
   real(wp) function log_determinant(band)
      type(band_t), intent(in) :: band
      type(band_t) :: factor
      logical :: positive

      factor = band
      call factor%factor(positive)
      log_determinant = huge(1.0_wp)
      if (positive) log_determinant = 2*sum(log(factor%a(1, :)))
   end function log_determinant

   !> trace(A**-1 B)
   real(wp) function trace(a, b)
      type(band_t), intent(in) :: a, b
      type(band_t) :: factor
      real(wp) :: x(a%n)
      logical :: positive
      integer :: i, j

      factor = a
      call factor%factor(positive)
      trace = 0
      do j = 1, a%n
         x = [(b%element(i, j), i=1, a%n)]
         call factor%solve(x)
         trace = trace + x(j)
      end do
      if (.not. positive) trace = huge(1.0_wp)
   end function trace

   !> How many roots are not one of their own in quadruple precision.
   integer function lost_roots(structure, poles) result(lost)
      type(structure_t), intent(in) :: structure
      type(poles_t), intent(in) :: poles
      type(full_t) :: full
      complex(qp) :: s(size(poles%s))
      complex(qp), allocatable :: x(:)
      real(qp) :: last
      integer :: k

      full = new_full(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      s = poles%s
      lost = 0
      do k = 1, size(s)
         x = starting_vector(full%n)
         call full%improve(12, s(k), x, last)
         if (.not. last <= 1e-20_qp*abs(s(k)) .or. .not. abs(s(k) - poles%s(k)) &
            <= 1e-8_qp*abs(s(k)) .or. any(abs(s(:k - 1) - s(k)) <= 1e-18_qp*abs(s(k)))) &
            lost = lost + 1
      end do
   end function lost_roots

   !> A walk through the parameters by one solver, each search starting where the last one ended, as
   !> in a fit; every fiftieth step is a leap. As a solver that begins anew.
   subroutine test_walk()
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), known(:, :), none(:, :, :)
      type(modal_t) :: walker
      real(wp) :: worst, far
      integer :: step, k, refused, root

      do root = 1, 2
         e = random_experiment(everything)
         e%mesh = coarse
         if (root == 2) e%structure%k_R = rigid
         call prepare(e)
         walker = solver
         worst = 0
         refused = 0
         do step = 1, 300
            far = merge(2.0_wp, 0.1_wp, modulo(step, 50) == 0)
            do k = 1, every
               ! The mesh is prepared for one beam.
               if (k == of_length) cycle
               if (k == of_x_S) then
                  call e%structure%set(k, between(0.1_wp, 1.0_wp))
               else if (root == 1 .or. k /= of_k_R) then
                  call e%structure%set(k, everything%get(k)*decades(-far, far))
               end if
            end do
            solver = walker
            call exact(e, [integer ::], columns, none, error)
            if (allocated(error)) refused = refused + 1
            walker = solver
            call prepare(e)
            call exact(e, [integer ::], known, none, error)
            if (allocated(error)) refused = refused + 1
            if (.not. relative(columns(:, 1), known(:, 1)) <= worst) &
               worst = relative(columns(:, 1), known(:, 1))
         end do
         call check('a walk: none refused', refused == 0, to_text(refused))
         ! Roots are known to 1e-13, times the phase, 1e2.
         call check_close('a walk: as from the start', worst, 0.0_wp, 1e-11_wp)
      end do
   end subroutine test_walk

end program test_attachments
