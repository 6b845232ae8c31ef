!> Exact responses: against the inverse Laplace transform, against closed forms in the undamped
!> modes, against CVODE, and in the cases that a sum of exponentials finds hard.
program test_modal
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_failed
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: ip, wp
   use beamid_modal, only: modal_t
   use beamid_assembly, only: new_assembly
   use beamid_modes, only: bare_beam_modes, beam_modes_t, undamped_modes
   use beamid_poles, only: find_poles, poles_t
   use beamid_responses, only: prepare_for, response_t, solver_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish, in_long_run
   implicit none

   !> The full tip assembly: rho = E I = l = 1.
   type(structure_t), parameter :: assembly = structure_t(length=1, rho=1, E=1, I=1, &
      c_D=1e-3_wp, m_T=0.5_wp, m_H=0.3_wp, c_H=0.2_wp, k_H=20)
   !> The simulated structure of Table 4.1.
   type(structure_t), parameter :: table_4_1 = structure_t(length=4, rho=0.03_wp, E=80, I=1, &
      c_D=0.005_wp, m_T=0.15_wp, m_H=0.04_wp, c_H=0.004_wp, k_H=0.3_wp)
   real(wp), parameter :: eps = epsilon(1.0_wp)
   !> What CVODE leaves with rtol = 1e-11: some hundred times as much of the largest displacement.
   real(wp), parameter :: cvode_error = 1e-8_wp
   type(modal_t), parameter :: fresh = modal_t()
   integer :: k
   real(wp), parameter :: grid(101) = [(0.05_wp*k, k=0, 100)]

   call test_step()
   call test_poles()
   call test_against_cvode()
   call test_undamped()
   call test_proportional()
   call test_fine_mesh()
   call test_tables()
   call test_distributed()
   call test_times()
   call test_consistency()
   call test_no_hose()
   call test_light_hose()
   call test_rigid_hose()
   call test_hoses()
   call test_tuned()
   call test_double_root()
   call test_masses()
   call test_refused()
   call finish('modal')

contains

   !> One response by either method; a failure is a failed check, and zeros.
   subroutine run(solver, structure, mesh, excitation, times, response, name)
      class(solver_t), intent(in) :: solver
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      character(len=*), intent(in) :: name
      type(error_t), allocatable :: error

      call attempt(solver, structure, mesh, excitation, times, response, error)
      if (.not. allocated(error)) return
      call check(name//': a response', .false., error%message)
      response%t = times
      response%displacement = 0*times
      response%velocity = 0*times
      response%acceleration = 0*times
   end subroutine run

   subroutine attempt(solver, structure, mesh, excitation, times, response, error)
      class(solver_t), intent(in) :: solver
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      type(error_t), allocatable, intent(out) :: error
      class(solver_t), allocatable :: own
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(work_t) :: work

      galerkin = new_galerkin(mesh, structure%length)
      equations = new_equations(galerkin, structure, excitation)
      own = solver
      call prepare_for(galerkin, own, error)
      if (.not. allocated(error)) &
         call own%respond(equations, excitation, times, response, work, error)
   end subroutine attempt

   !> Largest difference over the largest value of the second.
   pure real(wp) function relative(a, b)
      real(wp), intent(in) :: a(:), b(:)

      relative = maxval(abs(a - b))/maxval(abs(b))
   end function relative

   !> modal against cvode, displacement relative to its maximum.
   subroutine compare(name, structure, mesh, excitation, times, allowed)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:), allowed
      type(response_t) :: exact, integrated

      call run(fresh, structure, mesh, excitation, times, exact, name//', modal')
      call run(cvode_t(rtol=1e-11_wp, max_steps=5000000_ip), structure, mesh, excitation, times, &
         integrated, name//', cvode')
      call check_close(name//', displacement', relative(exact%displacement, &
         integrated%displacement), 0.0_wp, allowed)
   end subroutine compare

   !> Quintics on 24 elements are wrong by (beta h)**8/3e6, 1e-13 in mode 4: what is left is
   !> round-off. The references have eleven and nine digits, of which half a unit of the last is
   !> allowed.
   subroutine test_step()
      real(wp), parameter :: t(3) = [0.5_wp, 2.0_wp, 5.0_wp], &
         acceleration(3) = [0.46773168716_wp, -1.012774464_wp, -0.62641429_wp], &
         displacement(3) = [0.11603519614_wp, 0.650877602_wp, 0.51635582_wp], &
         digits(3) = [0.6e-11_wp, 0.6e-9_wp, 0.6e-8_wp]
      integer, parameter :: elements(2) = [24, 48]
      type(response_t) :: response
      integer :: i, k

      do k = 1, size(elements)
         call run(fresh, assembly, mesh_t(5, elements(k), 6, 1), new_pulse(1.0_wp, 10.0_wp), t, &
            response, 'step')
         do i = 1, size(t)
            call check_close('step, '//to_text(elements(k))//' quintics, displacement at t = '// &
               to_text(t(i)), response%displacement(i), displacement(i), digits(i))
            call check_close('step, '//to_text(elements(k))//' quintics, acceleration at t = '// &
               to_text(t(i)), response%acceleration(i), acceleration(i), max(1e-8_wp, digits(i)))
         end do
      end do
   end subroutine test_step

   !> Poles of the whole assembly (30-digit roots of the transcendental equation); sums over
   !> residues that do not depend on the poles: sum r = 0, sum r s = b'M^-1 b, -sum r/s = l**3/(3
   !> E I), the static deflection of the tip, all with 24 quintics.
   subroutine test_poles()
      complex(wp), parameter :: reference(3) = [(-0.0015966016133871_wp, 1.6897617523225_wp), &
         (-0.43889748614945_wp, 9.5950573575728_wp), (-0.19925586220265_wp, 17.13367740183_wp)]
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      type(beam_modes_t) :: modes
      real(wp), allocatable :: x(:)
      logical :: positive
      integer :: i, k

      galerkin = new_galerkin(mesh_t(5, 24, 6, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      call bare_beam_modes(galerkin, modes, error)
      if (.not. allocated(error)) call find_poles(new_assembly(assembly, modes, [integer ::]), &
         modes, poles, error)
      call check('poles found', .not. allocated(error))
      if (allocated(error)) return
      do i = 1, size(reference)
         k = minloc(abs(poles%s - reference(i)), dim=1)
         ! Thirteen and fourteen digits are printed.
         call check_close('real part of pole '//to_text(i), real(poles%s(k), wp), &
            real(reference(i), wp), 1e-12_wp*abs(reference(i)))
         call check_close('imaginary part of pole '//to_text(i), aimag(poles%s(k)), &
            aimag(reference(i)), 1e-12_wp*abs(reference(i)))
      end do
      ! A complex pair stands for two roots, a real root for one: 2 n together.
      call check('as many poles as there are', count(aimag(poles%s) > 0)*2 &
         + count(.not. aimag(poles%s) > 0) == 2*equations%n .and. all(aimag(poles%s) >= 0), &
         to_text(size(poles%s)))
      call check('all decay', all(real(poles%s, wp) < 0))
      ! Round-off of sums of n terms each of relative error some ten eps.
      call check_close('sum of residues', real(sum(poles%residue), wp)/sum(abs(poles%residue)), &
         0.0_wp, 1e-13_wp)
      x = equations%observer
      call equations%mass%factor(positive)
      call equations%mass%solve(x)
      ! The reference itself is a solution with M, of condition 1e4.
      call check_close('sum of residues times s', real(sum(poles%residue*poles%s), wp) &
         /dot_product(equations%observer, x), 1.0_wp, 1e-11_wp)
      call check_close('impulse', poles%impulse/dot_product(equations%observer, x), 1.0_wp, &
         1e-11_wp)
      ! The static deflection is a cubic: splines have it without error.
      call check_close('-sum of residues over s', -real(sum(poles%residue/poles%s), wp), 1/3.0_wp, &
         1e-13_wp)
   end subroutine test_poles

   !> Both methods on one mesh: nothing but the integrator's tolerance lies between them.
   subroutine test_against_cvode()
      type(structure_t) :: structure
      character(len=:), allocatable :: name
      integer :: n, hose, damping

      do n = 2, merge(8, 5, in_long_run())
         do hose = 0, 1
            do damping = 0, 1
               structure = table_4_1
               name = 'Table 4.1, N = '//to_text(n)
               if (hose == 0) then
                  structure%m_H = 0
                  name = name//', no hose'
               end if
               if (damping == 0) then
                  structure%c_D = 0
                  structure%c_H = 0
                  name = name//', undamped'
               end if
               call compare(name, structure, mesh_t(3, n, 4, 1), new_pulse(1.0_wp, 0.05_wp), grid, &
                  cvode_error)
            end do
         end do
      end do
   end subroutine test_against_cvode

   !> Undamped, any hose: sum (b'x)(x'F)/omega**2 (1 - cos(omega t)) over the modes of the
   !> assembled M and K, an eigenproblem of its own. A pulse is a step less a step, a triangle
   !> three ramps.
   !>
   !> fastest  the highest of the frequencies
   subroutine closed_undamped(structure, mesh, excitation, kind, times, response, fastest, name)
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      character(len=*), intent(in) :: kind, name
      real(wp), intent(in) :: times(:)
      type(response_t), intent(out) :: response
      real(wp), intent(out) :: fastest
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      real(wp) :: weight, w, t, a
      integer :: i, j, p

      galerkin = new_galerkin(mesh, structure%length)
      equations = new_equations(galerkin, structure, excitation)
      call undamped_modes(equations, omega, shapes, error)
      call check(name//': undamped modes', .not. allocated(error))
      response%t = times
      response%displacement = 0*times
      response%velocity = 0*times
      response%acceleration = 0*times
      fastest = 0
      if (allocated(error)) return
      fastest = maxval(omega)
      a = excitation%t(2)
      do i = 1, size(times)
         do j = 1, size(omega)
            w = omega(j)
            weight = dot_product(equations%observer, shapes(:, j)) &
               *dot_product(equations%load, shapes(:, j))
            do p = 0, 2
               t = times(i) - p*a
               if (t < 0) cycle
               if (kind == 'pulse') then
                  if (p == 2 .or. p == 1 .and. .not. t > 0) cycle
                  ! 1 - cos = 2 sin**2 of the half.
                  response%displacement(i) = response%displacement(i) + (1 - 2*p)*weight/w**2 &
                     *2*sin(w*t/2)**2
                  response%velocity(i) = response%velocity(i) + (1 - 2*p)*weight/w*sin(w*t)
                  response%acceleration(i) = response%acceleration(i) + (1 - 2*p)*weight*cos(w*t)
               else
                  ! Slopes 1/a, -2/a, 1/a.
                  response%displacement(i) = response%displacement(i) + merge(-2, 1, p == 1)/a &
                     *weight/w**2*(t - sin(w*t)/w)
                  response%velocity(i) = response%velocity(i) + merge(-2, 1, p == 1)/a &
                     *weight/w**2*2*sin(w*t/2)**2
                  response%acceleration(i) = response%acceleration(i) + merge(-2, 1, p == 1)/a &
                     *weight/w*sin(w*t)
               end if
            end do
         end do
      end do
   end subroutine closed_undamped

   !> The modal response against the closed form. The round-off of a frequency, ten eps, grows with
   !> the phase omega t. In displacement and velocity the first modes count, phase 500 by t = 5,
   !> with 1e-11 to spare for the others; in the acceleration all modes do alike, with the phase
   !> of the fastest. Both sides, so twice.
   subroutine against_closed(name, structure, mesh, excitation, kind)
      character(len=*), intent(in) :: name, kind
      type(structure_t), intent(in) :: structure
      type(mesh_t), intent(in) :: mesh
      type(excitation_t), intent(in) :: excitation
      type(response_t) :: exact, closed
      real(wp) :: fastest

      call run(fresh, structure, mesh, excitation, grid, exact, name)
      call closed_undamped(structure, mesh, excitation, kind, grid, closed, fastest, name)
      call check_close(name//', displacement', relative(exact%displacement, closed%displacement), &
         0.0_wp, 1e-11_wp)
      call check_close(name//', velocity', relative(exact%velocity, closed%velocity), 0.0_wp, &
         1e-11_wp)
      call check_close(name//', acceleration', relative(exact%acceleration, closed%acceleration), &
         0.0_wp, 20*eps*fastest*maxval(grid))
   end subroutine against_closed

   !> Pulses and triangles on beams with and without tip mass and hose.
   subroutine test_undamped()
      type(structure_t) :: structure
      type(excitation_t) :: triangle
      type(error_t), allocatable :: error

      structure = table_4_1
      structure%c_D = 0
      structure%c_H = 0
      call new_force_table([0.0_wp, 0.04_wp, 0.08_wp], [0.0_wp, 1.0_wp, 0.0_wp], triangle, error)
      call against_closed('closed form, pulse', structure, mesh_t(3, 8, 4, 1), &
         new_pulse(1.0_wp, 0.05_wp), 'pulse')
      call against_closed('closed form, triangle', structure, mesh_t(3, 8, 4, 1), triangle, &
         'triangle')
      structure%m_H = 0
      call against_closed('closed form, pulse, no hose', structure, mesh_t(3, 8, 4, 1), &
         new_pulse(1.0_wp, 0.05_wp), 'pulse')
      structure%m_T = 0
      call against_closed('closed form, pulse, bare cantilever', structure, mesh_t(3, 8, 4, 1), &
         new_pulse(1.0_wp, 0.05_wp), 'pulse')
      call against_closed('closed form, triangle, bare cantilever', structure, mesh_t(3, 8, 4, 1), &
         triangle, 'triangle')
      call against_closed('closed form, pulse, bare cantilever, quintics', structure, &
         mesh_t(5, 6, 6, 1), new_pulse(1.0_wp, 0.05_wp), 'pulse')
   end subroutine test_undamped

   !> Kelvin-Voigt damping alone keeps the undamped modes: s**2 + (c_D/E) omega**2 s + omega**2 =
   !> 0 for each, and 1 - (s_2 e**(s_1 t) - s_1 e**(s_2 t))/(s_2 - s_1) its step response. Light,
   !> with some modes overdamped, and with all of them overdamped: their slow roots then crowd at
   !> -E/c_D.
   subroutine test_proportional()
      type(structure_t) :: structure
      type(response_t) :: exact
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      real(wp), parameter :: viscosities(6) = [1e-3_wp, 1e-2_wp, 0.1_wp, 1.0_wp, 10.0_wp, 1e4_wp], &
         masses(3) = [0.0_wp, 0.5_wp, 1e-6_wp], times(40) = [(0.05_wp*k, k=1, 40)]
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp) :: s(2)
      real(wp) :: u(size(times)), weight, half
      character(len=:), allocatable :: name
      integer :: i, j, m

      do m = 1, size(masses)
         structure = structure_t(length=1, rho=1, E=1, I=1, m_T=masses(m))
         galerkin = new_galerkin(mesh, structure%length)
         do i = 1, size(viscosities)
            structure%c_D = viscosities(i)
            equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 10.0_wp))
            call undamped_modes(equations, omega, shapes, error)
            u = 0
            do j = 1, size(omega)
               half = structure%c_D/structure%E*omega(j)**2/2
               s(1) = sqrt(cmplx(half**2 - omega(j)**2, 0.0_wp, wp))
               s(2) = -half - s(1)
               s(1) = omega(j)**2/s(2)
               weight = dot_product(equations%observer, shapes(:, j))**2/omega(j)**2
               u = u + weight*(1 - real((s(2)*exp(s(1)*times) - s(1)*exp(s(2)*times))/(s(2) &
                  - s(1))))
            end do
            name = 'Kelvin-Voigt, m_T = '//to_text(masses(m))//', c_D = '//to_text(viscosities(i))
            call attempt(fresh, structure, mesh, new_pulse(1.0_wp, 10.0_wp), times, exact, error)
            if (allocated(error)) then
               call check(name//': a response or a refusal that says why', refused_clearly(error), &
                  error%message)
               cycle
            end if
            ! Slow roots lie (E/c_D)**2/omega**2 of their size apart, with which round-off is to be
            ! compared; no mode here has a double root of its own.
            call check_close(name//', displacement', relative(exact%displacement, u), 0.0_wp, &
               1e-11_wp + eps*(structure%c_D*omega(1)/structure%E)**2)
         end do
      end do
   end subroutine test_proportional

   !> The words that a refusal must have.
   logical function refused_clearly(error)
      type(error_t), intent(in) :: error

      refused_clearly = error%status == status_failed .and. index(error%message, &
         'roots coincide') > 0 .and. index(error%message, 'cvode') > 0
   end function refused_clearly

   !> 256 cubics. With K stored as a band matrix the lowest frequencies would be off by 1e-7, and
   !> CVODE by 3e-7 (measured); both methods take the strain from the curvature of the shapes
   !> instead. The judge between them is a mesh of 24 quintics, whose frequencies are right to
   !> 1e-13; 256 cubics are right to (beta h)**4/1440, 4e-11 in mode 3. CVODE for the first second.
   subroutine test_fine_mesh()
      type(mesh_t), parameter :: fine = mesh_t(3, 256, 4, 1), judge = mesh_t(5, 24, 6, 1)
      real(wp), parameter :: times(1000) = [(0.005_wp*k, k=1, 1000)]
      type(response_t) :: cubic, quintic, integrated
      real(wp) :: off

      call run(fresh, table_4_1, fine, new_pulse(1.0_wp, 0.05_wp), times, cubic, '256 cubics')
      call run(fresh, table_4_1, judge, new_pulse(1.0_wp, 0.05_wp), times, quintic, '24 quintics')
      call check_close('256 cubics against 24 quintics, both modal, displacement', &
         relative(cubic%displacement, quintic%displacement), 0.0_wp, 1e-8_wp)
      call run(cvode_t(rtol=1e-11_wp), table_4_1, judge, new_pulse(1.0_wp, 0.05_wp), times(:200), &
         integrated, '24 quintics, cvode')
      call check_close('24 quintics, modal against cvode', relative( &
         quintic%displacement(:200), integrated%displacement), 0.0_wp, cvode_error)
      call run(cvode_t(rtol=1e-11_wp), table_4_1, fine, new_pulse(1.0_wp, 0.05_wp), times(:200), &
         integrated, '256 cubics, cvode')
      off = relative(integrated%displacement, quintic%displacement(:200))
      print '(a,es9.2)', '      256 cubics by cvode, off the judge by ', off
      call check_close('256 cubics, modal against cvode', relative(cubic%displacement(:200), &
         integrated%displacement), 0.0_wp, 1e-8_wp)
   end subroutine test_fine_mesh

   !> Tables: the pulse as a table, the pulse cut into pieces, linearity, and a jagged force by
   !> CVODE.
   subroutine test_tables()
      type(mesh_t), parameter :: mesh = mesh_t(3, 5, 4, 1)
      type(excitation_t) :: table
      type(response_t) :: a, b
      type(error_t), allocatable :: error

      call run(fresh, table_4_1, mesh, new_pulse(2.0_wp, 0.05_wp), grid, a, 'pulse')
      call new_force_table([0.0_wp, 0.05_wp], [2.0_wp, 2.0_wp], table, error)
      call run(fresh, table_4_1, mesh, table, grid, b, 'pulse as a table')
      call check_close('a table that is a pulse', maxval(abs(a%acceleration - b%acceleration)), &
         0.0_wp, 0.0_wp)
      ! More nodes: more products of exponentials, each a rounding.
      call new_force_table([0.0_wp, 0.01_wp, 0.0101_wp, 0.03_wp, 0.05_wp], spread(2.0_wp, 1, 5), &
         table, error)
      call run(fresh, table_4_1, mesh, table, grid, b, 'pulse in pieces')
      call check_close('a pulse in pieces, displacement', relative(b%displacement, &
         a%displacement), 0.0_wp, 1e-13_wp)
      call check_close('a pulse in pieces, acceleration', relative(b%acceleration, &
         a%acceleration), 0.0_wp, 1e-12_wp)
      ! A power of two: without any rounding.
      call run(fresh, table_4_1, mesh, new_pulse(-8.0_wp, 0.05_wp), grid, b, 'pulse, -8')
      call check_close('linear in the amplitude', maxval(abs(b%acceleration + 4*a%acceleration)), &
         0.0_wp, 0.0_wp)
      ! Beginning late, ending on a jump, slopes of all kinds.
      call new_force_table([0.3_wp, 0.31_wp, 0.7_wp, 0.72_wp, 1.9_wp, 3.33_wp], [1.5_wp, -1.0_wp, &
         2.0_wp, 0.0_wp, 0.3_wp, -0.7_wp], table, error)
      call compare('jagged table', table_4_1, mesh, table, grid, cvode_error)
      call compare('jagged table, assembly', assembly, mesh, table, grid, cvode_error)
      call run(fresh, table_4_1, mesh, table, grid, a, 'jagged table')
      call check('at rest before the table begins', all(abs(a%displacement(:6)) <= 0) .and. &
         all(abs(a%velocity(:6)) <= 0) .and. all(abs(a%acceleration(:6)) <= 0))
   end subroutine test_tables

   !> The load of (3.10), undamped in closed form with the moments in F, damped by CVODE.
   subroutine test_distributed()
      type(excitation_t) :: excitation
      type(structure_t) :: structure
      type(response_t) :: point, spread_out

      excitation = new_pulse(1.0_wp, 0.05_wp)
      excitation%distributed = .true.
      excitation%power = 2.5_wp
      structure = table_4_1
      call compare('distributed load', structure, mesh_t(3, 5, 4, 1), excitation, grid, cvode_error)
      call run(fresh, structure, mesh_t(3, 5, 4, 1), excitation, grid, spread_out, 'distributed')
      call run(fresh, structure, mesh_t(3, 5, 4, 1), new_pulse(1.0_wp, 0.05_wp), grid, point, &
         'point')
      call check('distributed load: another one', relative(spread_out%displacement, &
         point%displacement) > 0.1_wp, to_text(relative(spread_out%displacement, &
         point%displacement)))
      structure%c_D = 0
      structure%c_H = 0
      call against_closed('closed form, distributed', structure, mesh_t(3, 8, 4, 1), excitation, &
         'pulse')
   end subroutine test_distributed

   !> Any times: the same numbers, whether asked for one by one, on a grid, or on an uneven set.
   subroutine test_times()
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      real(wp), parameter :: uneven(9) = [-1.0_wp, 0.0_wp, 1e-9_wp, 0.05_wp, 0.0500001_wp, 0.4_wp, &
         0.75_wp, 3.0_wp, 300.0_wp]
      type(response_t) :: together, alone, long, short
      real(wp), allocatable :: many(:)
      real(wp) :: worst(3)
      integer :: i

      call run(fresh, assembly, mesh, new_pulse(1.0_wp, 0.05_wp), uneven, together, 'uneven')
      worst = 0
      do i = 1, size(uneven)
         call run(fresh, assembly, mesh, new_pulse(1.0_wp, 0.05_wp), uneven(i:i), alone, 'alone')
         worst(1) = max(worst(1), abs(alone%displacement(1) - together%displacement(i)))
         worst(2) = max(worst(2), abs(alone%velocity(1) - together%velocity(i)))
         worst(3) = max(worst(3), abs(alone%acceleration(1) - together%acceleration(i)))
      end do
      ! Exponentials of sums against products of exponentials: eps times the phase, omega_max*.35 in
      ! the fastest mode that is alive.
      call check_close('times one by one, displacement', worst(1)/maxval(abs( &
         together%displacement)), 0.0_wp, 1e-13_wp)
      call check_close('times one by one, velocity', worst(2)/maxval(abs(together%velocity)), &
         0.0_wp, 1e-13_wp)
      call check_close('times one by one, acceleration', worst(3)/maxval(abs( &
         together%acceleration)), 0.0_wp, 1e-12_wp)
      call check('before the force: rest', abs(together%displacement(1)) <= 0 .and. &
         abs(together%velocity(1)) <= 0 .and. abs(together%acceleration(1)) <= 0)
      ! At the first instant the structure has not moved; the acceleration answers at once, b'M^-1
      ! b.
      call check('at the first instant: no displacement, an acceleration', &
         abs(together%displacement(2)) <= 0 .and. abs(together%velocity(2)) <= 0 .and. &
         together%acceleration(2) > 0.5_wp, to_text(together%acceleration(2)))
      call check('in the end: almost rest', abs(together%displacement(9)) < 0.7_wp &
         *maxval(abs(together%displacement)), to_text(together%displacement(9)))

      ! 20000 equal steps by recurrence against the last time alone: undamped, phase 50*omega.
      many = [(0.0025_wp*i, i=1, 20000)]
      call run(fresh, table_4_1, mesh, new_pulse(1.0_wp, 0.05_wp), many, long, 'many times')
      call run(fresh, table_4_1, mesh, new_pulse(1.0_wp, 0.05_wp), many(20000:), short, 'last time')
      call check_close('20000 equal steps, displacement at the end', &
         (long%displacement(20000) - short%displacement(1))/maxval(abs(long%displacement)), &
         0.0_wp, 1e-11_wp)
      call run(fresh, table_4_1, mesh, new_pulse(1.0_wp, 0.05_wp), [real(wp) ::], short, 'no times')
      call check('no times', size(short%displacement) == 0)
      call run(fresh, table_4_1, mesh, new_pulse(1.0_wp, 0.05_wp), [0.5_wp, 0.5_wp], short, 'twice')
      call check_close('a time twice', short%acceleration(1), short%acceleration(2), 0.0_wp)
   end subroutine test_times

   !> Velocity is the derivative of displacement, acceleration that of velocity, away from jumps:
   !> central differences of eighth order with h = 1e-3. Modes with omega > 100, on which the
   !> (omega h)**8/630 of the formula would tell, are damped by c_D within .1; round-off is 2
   !> eps/h of the larger quantity, 1e-12.
   subroutine test_consistency()
      real(wp), parameter :: h = 1e-3_wp, c(4) = [4/5.0_wp, -1/5.0_wp, 4/105.0_wp, -1/280.0_wp]
      real(wp), parameter :: middles(5) = [0.3_wp, 0.45_wp, 1.2_wp, 2.0_wp, 4.8_wp]
      type(response_t) :: response
      type(excitation_t) :: ramp
      type(error_t), allocatable :: error
      real(wp) :: du, dv
      integer :: i, j, force

      do force = 1, 2
         ramp = new_pulse(1.0_wp, 0.05_wp)
         if (force == 2) call new_force_table([0.0_wp, 0.1_wp, 7.0_wp], [1.0_wp, -1.0_wp, 5.0_wp], &
            ramp, error)
         do i = 1, size(middles)
            call run(fresh, assembly, mesh_t(5, 4, 6, 1), ramp, [(middles(i) + j*h, j=-4, 4)], &
               response, 'differences')
            du = 0
            dv = 0
            do j = 1, 4
               du = du + c(j)*(response%displacement(5 + j) - response%displacement(5 - j))/h
               dv = dv + c(j)*(response%velocity(5 + j) - response%velocity(5 - j))/h
            end do
            call check_close('force '//to_text(force)//', velocity is du/dt at '// &
               to_text(middles(i)), response%velocity(5), du, 1e-11_wp)
            call check_close('force '//to_text(force)//', acceleration is dv/dt at '// &
               to_text(middles(i)), response%acceleration(5), dv, 1e-10_wp)
         end do
      end do
   end subroutine test_consistency

   !> What hangs on nothing is not there: k_H = c_H = 0. And k_H, c_H without m_H.
   subroutine test_no_hose()
      type(structure_t) :: structure
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      type(response_t) :: without, loose

      structure = table_4_1
      structure%m_H = 0
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, without, 'no hose')
      structure%k_H = 0
      structure%c_H = 0
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'no hose at all')
      call check_close('m_H = 0: k_H and c_H do nothing', maxval(abs(loose%acceleration &
         - without%acceleration)), 0.0_wp, 0.0_wp)
      structure%m_H = 0.04_wp
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'loose hose')
      ! The same sums but for a hose that contributes nothing.
      call check_close('k_H = c_H = 0: m_H does nothing, displacement', &
         relative(loose%displacement, without%displacement), 0.0_wp, 1e-13_wp)
      call check_close('k_H = c_H = 0: m_H does nothing, acceleration', &
         relative(loose%acceleration, without%acceleration), 0.0_wp, 1e-12_wp)
      ! Springs and dashpots that are as good as absent.
      structure%k_H = 1e-13_wp
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'slack spring')
      call check_close('k_H = 1e-13', relative(loose%displacement, without%displacement), 0.0_wp, &
         1e-11_wp)
      structure%k_H = 0
      structure%c_H = 1e-13_wp
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'slack dashpot')
      call check_close('c_H = 1e-13', relative(loose%displacement, without%displacement), 0.0_wp, &
         1e-11_wp)
   end subroutine test_no_hose

   !> A hose of vanishing mass follows the tip: k_H (y - u) = -m_H y'', so that its effect is that
   !> of m_H at the tip, linear in m_H. (u(m_H) - u(0))/m_H settles, until round-off takes over.
   subroutine test_light_hose()
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      type(structure_t) :: structure
      type(response_t) :: without, light
      character(len=:), allocatable :: name
      real(wp) :: mass, change(size(grid)), slope(size(grid)), size_u
      integer :: damping, i

      do damping = 0, 1
         structure = table_4_1
         if (damping == 0) structure%c_H = 0
         if (damping == 0) structure%c_D = 0
         structure%m_H = 0
         call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, without, 'no hose')
         size_u = maxval(abs(without%displacement))
         ! d u/d m_H at 0 is d u/d m_T: central differences of the response without a hose, whose
         ! error is 1e-10 by the step's square and 1e-11 by round-off.
         structure%m_T = table_4_1%m_T + 1e-6_wp
         call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, light, 'm_T +')
         slope = light%displacement
         structure%m_T = table_4_1%m_T - 1e-6_wp
         call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, light, 'm_T -')
         slope = (slope - light%displacement)/2e-6_wp
         structure%m_T = table_4_1%m_T
         do i = 3, 14
            mass = 10.0_wp**(-i)
            structure%m_H = mass
            name = merge('m_H = 1E-', 'm_H = 1e-', damping == 0)//to_text(i)// &
               merge(', undamped', ', damped  ', damping == 0)
            call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, light, name)
            change = light%displacement - without%displacement - mass*slope
            ! Second order in m_H: (m_H/m_T)**2 times the phase squared, 50**2. The hose's own
            ! motion, of the order of omega**2 m_H/k_H, is second order too.
            call check_close(name//': as m_H at the tip', maxval(abs(change))/size_u, 0.0_wp, &
               5e4_wp*mass**2 + 1e-12_wp)
         end do
         ! And against CVODE where that can still follow the hose.
         do i = 3, 7, 2
            structure%m_H = 10.0_wp**(-i)
            call compare('light hose, m_H = 1e-'//to_text(i), structure, mesh, &
               new_pulse(1.0_wp, 0.05_wp), grid(:21), cvode_error)
         end do
      end do
   end subroutine test_light_hose

   !> A hose that is welded to the tip, by its spring or by its dashpot, is tip mass.
   subroutine test_rigid_hose()
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      type(structure_t) :: structure, welded
      type(response_t) :: reference, stiff
      real(wp) :: factor
      integer :: i

      welded = table_4_1
      welded%m_T = table_4_1%m_T + table_4_1%m_H
      welded%m_H = 0
      call run(fresh, welded, mesh, new_pulse(1.0_wp, 0.05_wp), grid, reference, 'welded')
      do i = 4, 14, 2
         factor = 10.0_wp**i
         structure = table_4_1
         structure%k_H = table_4_1%k_H*factor
         call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, stiff, 'stiff spring')
         ! m_H omega**2/k_H of mode 3, 360/factor, times its share of the displacement, .02.
         call check_close('k_H times 1e'//to_text(i)//': as tip mass', &
            relative(stiff%displacement, reference%displacement), 0.0_wp, 20/factor + 1e-12_wp)
         structure = table_4_1
         structure%c_H = table_4_1%c_H*factor
         structure%k_H = 0
         call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, stiff, 'stiff dashpot')
         ! The dashpot slips: m_H omega/c_H of mode 1, 40/factor, over some periods.
         call check_close('c_H times 1e'//to_text(i)//': as tip mass', &
            relative(stiff%displacement, reference%displacement), 0.0_wp, 400/factor + 1e-12_wp)
      end do
   end subroutine test_rigid_hose

   !> Hoses of every kind by CVODE.
   subroutine test_hoses()
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      type(structure_t) :: structure
      real(wp), parameter :: ratios(7) = [0.0_wp, 0.9_wp, 1.0_wp, 1.1_wp, 3.0_wp, 100.0_wp, 1e4_wp]
      real(wp) :: critical
      integer :: i

      critical = 2*sqrt(table_4_1%k_H*table_4_1%m_H)
      do i = 1, size(ratios)
         structure = table_4_1
         structure%c_H = ratios(i)*critical
         call compare('c_H '//to_text(ratios(i))//' times critical', structure, mesh, &
            new_pulse(1.0_wp, 0.05_wp), grid(:61), cvode_error)
      end do
      structure = table_4_1
      structure%k_H = 0
      call compare('dashpot without a spring', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
         grid(:61), cvode_error)
      structure = table_4_1
      structure%m_T = 0
      call compare('no tip mass', structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid(:61), &
         cvode_error)
      structure%c_D = 0
      structure%c_H = 0
      ! Nothing damps what BDF leaves behind, and without a tip mass the higher modes are ten times
      ! larger; test_undamped has the closed form of such a structure.
      ! Nothing damps what BDF leaves behind, and without a tip mass the higher modes are ten times
      ! larger; test_undamped has the closed form of such a structure.
      call compare('no tip mass, no damping', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
         grid(:61), 10*cvode_error)
      structure = table_4_1
      structure%c_D = 500
      structure%m_T = 0
      structure%m_H = 0
      call compare('all modes of the beam overdamped', structure, mesh, new_pulse(1.0_wp, &
         0.05_wp), grid(:61), cvode_error)
      structure%m_T = 0.15_wp
      call compare('all modes overdamped, tip mass', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
         grid(:61), cvode_error)
      structure%m_H = 0.04_wp
      call compare('all modes overdamped, tip mass and hose', structure, mesh, &
         new_pulse(1.0_wp, 0.05_wp), grid(:61), cvode_error)
   end subroutine test_hoses

   !> The hose alone swings exactly as a mode of the beam does, bare or with its tip mass,
   !> undamped or with the very root of the damped mode; heavy hoses and light ones.
   subroutine test_tuned()
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      real(wp), parameter :: masses(4) = [0.04_wp, 1e-4_wp, 1e-8_wp, 1e-12_wp]
      type(structure_t) :: structure
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      type(response_t) :: exact, closed
      real(wp), allocatable :: omega(:), shapes(:, :)
      real(wp) :: fastest
      character(len=:), allocatable :: name
      integer :: tip, mode, i

      galerkin = new_galerkin(mesh, table_4_1%length)
      do tip = 0, 1
         structure = table_4_1
         structure%m_H = 0
         structure%c_H = 0
         if (tip == 0) structure%m_T = 0
         equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 0.05_wp))
         call undamped_modes(equations, omega, shapes, error)
         do mode = 1, 2
            do i = 1, size(masses)
               name = 'tuned to mode '//to_text(mode)//merge(' of the bare beam     ', &
                  ' of beam and tip mass ', tip == 0)//'m_H = '//to_text(masses(i))
               structure%m_H = masses(i)
               structure%k_H = masses(i)*omega(mode)**2
               structure%c_H = 0
               structure%c_D = 0
               call attempt(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, exact, error)
               if (allocated(error)) then
                  call check(name//': a refusal that says why', refused_clearly(error), &
                     error%message)
               else
                  ! Two roots at a distance of sqrt(m_H/m) omega/2, of which the eigenvectors of the
                  ! reference lose digits: 1e-16 over 1e-6 for the lightest.
                  call closed_undamped(structure, mesh, new_pulse(1.0_wp, 0.05_wp), 'pulse', grid, &
                     closed, fastest, name)
                  call check_close(name, relative(exact%displacement, closed%displacement), &
                     0.0_wp, 1e-10_wp)
               end if
               ! s**2 + (c/m) s + k/m of the hose is that of the damped mode.
               structure%c_D = table_4_1%c_D
               structure%c_H = masses(i)*structure%c_D/structure%E*omega(mode)**2
               call attempt(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid(:41), &
                  exact, error)
               if (allocated(error)) then
                  call check(name//', damped: a refusal that says why', refused_clearly(error), &
                     error%message)
               else
                  call compare(name//', damped', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
                     grid(:41), cvode_error)
               end if
            end do
         end do
      end do
   end subroutine test_tuned

   !> How many real roots the structure has, -1 when they cannot be had.
   integer function real_roots(structure, modes)
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      type(poles_t) :: poles
      type(error_t), allocatable :: error

      call find_poles(new_assembly(structure, modes, [integer ::]), modes, poles, error)
      real_roots = -1
      if (.not. allocated(error)) real_roots = count(.not. aimag(poles%s) > 0)
   end function real_roots

   !> Two roots meet on the real axis as c_H passes a certain value, which bisection finds. There,
   !> and at distances of 1e-1 to 1e-15 of it on either side: the right response, or a refusal.
   subroutine test_double_root()
      type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
      type(structure_t) :: structure
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error
      type(response_t) :: exact, integrated
      type(beam_modes_t) :: modes
      character(len=:), allocatable :: name
      real(wp) :: below, above, middle
      integer :: i, side, fewer, number, refusals, answers

      galerkin = new_galerkin(mesh, table_4_1%length)
      call bare_beam_modes(galerkin, modes, error)
      structure = table_4_1
      below = sqrt(table_4_1%k_H*table_4_1%m_H)
      above = 4*below
      structure%c_H = below
      fewer = real_roots(structure, modes)
      structure%c_H = above
      call check('double root: bracketed', real_roots(structure, modes) == fewer + 2, &
         to_text(fewer))
      do i = 1, 60
         middle = (below + above)/2
         if (middle <= below .or. middle >= above) exit
         structure%c_H = middle
         number = real_roots(structure, modes)
         ! A refusal here is as near as one can come.
         if (number < 0) exit
         if (number == fewer) below = middle
         if (number > fewer) above = middle
      end do
      call check('double root: found by bisection', above/below - 1 < 1e-4_wp, to_text(middle))
      refusals = 0
      answers = 0
      do i = 0, 15
         do side = -1, 1, 2
            structure%c_H = middle*(1 + side*10.0_wp**(-i)*merge(0, 1, i == 0))
            if (i == 0 .and. side == 1) cycle
            name = 'double root, c_H off by '//to_text(structure%c_H/middle - 1)
            call attempt(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid(:41), exact, &
               error)
            if (allocated(error)) then
               refusals = refusals + 1
               call check(name//': a refusal that says why', refused_clearly(error), error%message)
               cycle
            end if
            answers = answers + 1
            call run(cvode_t(rtol=1e-11_wp), structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
               grid(:41), integrated, name)
            ! Two roots a distance d apart are wrong by eps/d, their residues, which are of the
            ! order of 1/d, by eps/d**3. Where that is too much a refusal is asked for: an answer
            ! must have seven digits.
            call check_close(name//', displacement', relative(exact%displacement, &
               integrated%displacement), 0.0_wp, 1e-7_wp)
         end do
      end do
      call check('double root: answers away from it', answers >= 12, to_text(answers)// &
         ' answers, '//to_text(refusals)//' refusals')
   end subroutine test_double_root

   !> Tip masses from nothing to a million beams, undamped in closed form. The reference loses
   !> digits: its lowest frequency falls like 1/sqrt(m_T), and M then has a condition of m_T over
   !> an element's mass; both show in the frequency and, times the phase, in the response.
   subroutine test_masses()
      type(structure_t) :: structure
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      real(wp) :: ratio
      integer :: i, hose

      do hose = 0, 1
         do i = -12, 6, 2
            ratio = 10.0_wp**i
            structure = table_4_1
            structure%c_D = 0
            structure%c_H = 0
            if (hose == 0) structure%m_H = 0
            structure%m_T = ratio*structure%rho*structure%length
            call against_closed('m_T '//to_text(ratio)//' times the beam'// &
               merge(',  no hose', ', and hose', hose == 0), structure, mesh, &
               new_pulse(1.0_wp, 0.05_wp), 'pulse')
         end do
         do i = -12, 6, 6
            structure = table_4_1
            if (hose == 0) structure%m_H = 0
            structure%m_T = 10.0_wp**i*structure%rho*structure%length
            call compare('m_T '//to_text(10.0_wp**i)//' times the beam, damped'// &
               merge(',  no hose', ', and hose', hose == 0), structure, mesh, &
               new_pulse(1.0_wp, 0.05_wp), grid(:41), cvode_error)
         end do
      end do
   end subroutine test_masses

   !> Not prepared, or prepared for another mesh, even one with as many functions.
   subroutine test_refused()
      type(galerkin_t), target :: galerkin, other
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error
      integer :: i
      type(mesh_t), parameter :: others(3) = [mesh_t(3, 5, 4, 1), mesh_t(5, 4, 6, 1), &
         mesh_t(3, 6, 4, 1)]
      real(wp), parameter :: lengths(3) = [4.0_wp, 4.0_wp, 2.0_wp]

      galerkin = new_galerkin(mesh_t(3, 6, 4, 1), table_4_1%length)
      equations = new_equations(galerkin, table_4_1, new_pulse(1.0_wp, 0.05_wp))
      call solver%respond(equations, new_pulse(1.0_wp, 0.05_wp), grid, response, work, error)
      call check('not prepared: refused', allocated(error))
      if (allocated(error)) call check('not prepared: in words', index(error%message, &
         'prepared') > 0 .and. error%status == status_failed, error%message)
      do i = 1, size(others)
         other = new_galerkin(others(i), lengths(i))
         call solver%prepare(other, error)
         call check('another mesh: prepared', .not. allocated(error))
         call solver%respond(equations, new_pulse(1.0_wp, 0.05_wp), grid, response, work, error)
         call check('prepared for degree '//to_text(others(i)%degree)//', '// &
            to_text(others(i)%elements)//' elements, length '//to_text(lengths(i))// &
            ' (n = '//to_text(other%space%n)//' of '//to_text(galerkin%space%n)//'): refused', &
            allocated(error))
         if (allocated(error)) call check('another mesh: in words', &
            index(error%message, 'another mesh') > 0, error%message)
      end do
   end subroutine test_refused

end program test_modal
