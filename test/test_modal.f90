!> Exact responses: against the inverse Laplace transform, against closed forms in the undamped
!> modes, against CVODE, and in the cases that a sum of exponentials finds hard.
program test_modal
   use beamid_assembly, only: assembly_t, new_assembly
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_failed
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t, undamped_modes
   use beamid_pole_derivatives, only: differentiate_poles
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_c_D, structure_t
   use checks, only: check, check_close, finish, in_long_run
   use integration_errors, only: accumulated_error
   use single_responses, only: against_closed, assembly, attempt, compare, fresh, &
      grid, refused_clearly, relative, run, table_4_1
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp)
   integer :: k

   call test_step()
   call test_poles()
   call test_against_cvode()
   call test_undamped()
   call test_proportional()
   call test_fine_mesh()
   call test_tables()
   call test_distributed()
   call test_times()
   call test_force_in_step()
   call test_long_day()
   call test_followed()
   call test_consistency()
   call test_refused()
   call finish('modal')

contains

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
         poles, error)
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
                  structure%hose(1)%m_H = 0
                  name = name//', no hose'
               end if
               if (damping == 0) then
                  structure%c_D = 0
                  structure%hose(1)%c_H = 0
                  name = name//', undamped'
               end if
               call compare(name, structure, mesh_t(3, n, 4, 1), new_pulse(1.0_wp, 0.05_wp), grid)
            end do
         end do
      end do
   end subroutine test_against_cvode

   !> Pulses and triangles on beams with and without tip mass and hose.
   subroutine test_undamped()
      type(structure_t) :: structure
      type(excitation_t) :: triangle
      type(error_t), allocatable :: error

      structure = table_4_1
      structure%c_D = 0
      structure%hose(1)%c_H = 0
      call new_force_table([0.0_wp, 0.04_wp, 0.08_wp], [0.0_wp, 1.0_wp, 0.0_wp], triangle, error)
      call against_closed('closed form, pulse', structure, mesh_t(3, 8, 4, 1), &
         new_pulse(1.0_wp, 0.05_wp))
      call against_closed('closed form, triangle', structure, mesh_t(3, 8, 4, 1), triangle)
      structure%hose(1)%m_H = 0
      call against_closed('closed form, pulse, no hose', structure, mesh_t(3, 8, 4, 1), &
         new_pulse(1.0_wp, 0.05_wp))
      structure%m_T = 0
      call against_closed('closed form, pulse, bare cantilever', structure, mesh_t(3, 8, 4, 1), &
         new_pulse(1.0_wp, 0.05_wp))
      call against_closed('closed form, triangle, bare cantilever', structure, mesh_t(3, 8, 4, 1), &
         triangle)
      call against_closed('closed form, pulse, bare cantilever, quintics', structure, &
         mesh_t(5, 6, 6, 1), new_pulse(1.0_wp, 0.05_wp))
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

   !> 256 cubics. With K stored as a band matrix the lowest frequencies would be off by 1e-7, and
   !> CVODE by 3e-7 (measured); both methods take the strain from the curvature of the shapes
   !> instead. The judge between them is a mesh of 24 quintics, whose frequencies are right to
   !> 1e-13; 256 cubics are right to (beta h)**4/1440, 4e-11 in mode 3. CVODE for the first second.
   subroutine test_fine_mesh()
      type(mesh_t), parameter :: fine = mesh_t(3, 256, 4, 1), judge = mesh_t(5, 24, 6, 1)
      real(wp), parameter :: times(1000) = [(0.005_wp*k, k=1, 1000)]
      type(response_t) :: cubic, quintic, integrated
      type(work_t) :: work
      real(wp) :: off

      call run(fresh, table_4_1, fine, new_pulse(1.0_wp, 0.05_wp), times, cubic, '256 cubics')
      call run(fresh, table_4_1, judge, new_pulse(1.0_wp, 0.05_wp), times, quintic, '24 quintics')
      call check_close('256 cubics against 24 quintics, both modal, displacement', &
         relative(cubic%displacement, quintic%displacement), 0.0_wp, 1e-8_wp)
      call run(cvode_t(rtol=1e-11_wp), table_4_1, judge, new_pulse(1.0_wp, 0.05_wp), times(:200), &
         integrated, '24 quintics, cvode', work)
      call check_close('24 quintics, modal against cvode', relative( &
         quintic%displacement(:200), integrated%displacement), 0.0_wp, &
         accumulated_error(1e-11_wp, work%steps))
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
      call compare('jagged table', table_4_1, mesh, table, grid)
      call compare('jagged table, assembly', assembly, mesh, table, grid)
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
      call compare('distributed load', structure, mesh_t(3, 5, 4, 1), excitation, grid)
      call run(fresh, structure, mesh_t(3, 5, 4, 1), excitation, grid, spread_out, 'distributed')
      call run(fresh, structure, mesh_t(3, 5, 4, 1), new_pulse(1.0_wp, 0.05_wp), grid, point, &
         'point')
      call check('distributed load: another one', relative(spread_out%displacement, &
         point%displacement) > 0.1_wp, to_text(relative(spread_out%displacement, &
         point%displacement)))
      structure%c_D = 0
      structure%hose(1)%c_H = 0
      call against_closed('closed form, distributed', structure, mesh_t(3, 8, 4, 1), excitation)
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

   !> A force that is recorded with the samples, whose times differ from those of the force by a
   !> last digit or by none, has one step for each; between the samples it has two. Undamped modes
   !> would tell of 2000 steps of which each were off by a digit: the phase 10*omega, 1e-11, stays.
   subroutine test_force_in_step()
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      integer, parameter :: m = 2000
      real(wp) :: t(m), f(m), beside(m), between(2*m - 1)
      type(excitation_t) :: table
      type(response_t) :: response, judge
      type(error_t), allocatable :: error
      integer :: i

      t = [(0.005_wp*(i - 1), i=1, m)]
      f = [(sin(7.0_wp*i) + cos(0.1_wp*i**2), i=1, m)]
      beside = [(t(i) + (modulo(i, 3) - 1)*spacing(t(i)), i=1, m)]
      between(1::2) = t
      between(2::2) = (t(2:) + t(:m - 1))/2
      call new_force_table(t, f, table, error)
      call check('force in step: a table', .not. allocated(error))
      call run(fresh, assembly, mesh, table, between, judge, 'samples between')
      call run(fresh, assembly, mesh, table, t, response, 'samples in step')
      call check_close('samples in step, displacement', relative(response%displacement, &
         judge%displacement(1::2)), 0.0_wp, 1e-11_wp)
      call check_close('samples in step, acceleration', relative(response%acceleration, &
         judge%acceleration(1::2)), 0.0_wp, 1e-11_wp)
      call run(fresh, assembly, mesh, table, beside(2:m - 1), response, 'a digit beside')
      call check_close('a digit beside, displacement', relative(response%displacement, &
         judge%displacement(3:2*m - 3:2)), 0.0_wp, 1e-11_wp)
      call check_close('a digit beside, acceleration', relative(response%acceleration, &
         judge%acceleration(3:2*m - 3:2)), 0.0_wp, 1e-11_wp)
   end subroutine test_force_in_step

   !> Equal steps late in the day, of which one in 64 is three digits longer: 6400 of them end where
   !> one long step does, to the digits of the time, 1e-10, times the frequencies alive. If
   !> each were taken for the longer one they would be 3e-7 late.
   subroutine test_long_day()
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      integer, parameter :: m = 6401
      real(wp), parameter :: day = 1e5_wp, h = 2.0_wp**(-10)
      real(wp) :: t(m)
      type(excitation_t) :: push
      type(response_t) :: steps, leap
      type(error_t), allocatable :: error
      integer :: i

      t(1) = day
      do i = 2, m
         t(i) = t(i - 1) + h
         if (modulo(i, 64) == 2) t(i) = t(i) + 3*spacing(day)
      end do
      call new_force_table([day, day + h], [1.0_wp, 1.0_wp], push, error)
      call check('long day: a force', .not. allocated(error))
      call run(fresh, table_4_1, mesh, push, t, steps, 'steps')
      call run(fresh, table_4_1, mesh, push, [t(m)], leap, 'one step')
      call check_close('long day: displacement', steps%displacement(m)/maxval(abs( &
         steps%displacement)), leap%displacement(1)/maxval(abs(steps%displacement)), 1e-8_wp)
      call check_close('long day: velocity', steps%velocity(m)/maxval(abs(steps%velocity)), &
         leap%velocity(1)/maxval(abs(steps%velocity)), 2e-9_wp)
   end subroutine test_long_day

   !> Roots that are followed as the structure changes are those that are found afresh: also where
   !> c_D makes pairs of fast modes real ones and the other way round, and predictions meet.
   subroutine test_followed()
      integer, parameter :: elements(3) = [4, 16, 32]
      real(wp), parameter :: factors(6) = [1.02_wp, 2.3_wp, 0.4_wp, 6.0_wp, 0.1_wp, 1.3_wp]
      type(structure_t) :: structure
      type(beam_modes_t) :: modes
      type(assembly_t) :: now
      type(poles_t) :: followed, afresh
      type(error_t), allocatable :: error
      real(wp) :: worst
      integer :: i, j, k

      do i = 1, size(elements)
         call bare_beam_modes(new_galerkin(mesh_t(3, elements(i), 4, 1), table_4_1%length), modes, &
            error)
         structure = table_4_1
         do j = 0, size(factors)
            if (j > 0) structure%c_D = factors(j)*structure%c_D
            now = new_assembly(structure, modes, [of_c_D])
            call find_poles(now, followed, error)
            if (.not. allocated(error)) call differentiate_poles(now, followed)
            if (.not. allocated(error)) call find_poles(now, afresh, error)
            call check('followed, '//to_text(elements(i))//' elements, c_D = '// &
               to_text(structure%c_D), .not. allocated(error))
            if (allocated(error)) return
            call check('followed: as many', size(followed%s) == size(afresh%s), &
               to_text(size(followed%s)))
            if (size(followed%s) /= size(afresh%s)) cycle
            worst = 0
            do k = 1, size(afresh%s)
               worst = max(worst, minval(abs(followed%s - afresh%s(k)))/abs(afresh%s(k)))
            end do
            ! Slow real roots lie within 1e-2 of each other and are known to 1e-12 of that.
            call check_close('followed: the same roots', worst, 0.0_wp, 1e-10_wp)
            deallocate (afresh%all)
         end do
         deallocate (followed%all)
      end do
   end subroutine test_followed

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
