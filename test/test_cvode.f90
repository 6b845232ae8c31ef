!> Responses by CVODE against closed forms and the inverse Laplace transform; cost; failures.
program test_cvode
   use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
   use, intrinsic :: iso_fortran_env, only: output_unit
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_failed
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: ip, wp
   use beamid_modes, only: undamped_modes
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, structure_t
   use checks, only: check, check_close, finish
   use shell, only: own_path
   use single_responses, only: assembly, modal_sum, run
   implicit none

   interface
      integer(c_int) function c_dup(descriptor) bind(c, name='dup')
         import :: c_int
         integer(c_int), value :: descriptor
      end function c_dup
      integer(c_int) function c_dup2(old, new) bind(c, name='dup2')
         import :: c_int
         integer(c_int), value :: old, new
      end function c_dup2
      integer(c_int) function c_creat(path, mode) bind(c, name='creat')
         import :: c_char, c_int
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: mode
      end function c_creat
      integer(c_int) function c_close(descriptor) bind(c, name='close')
         import :: c_int
         integer(c_int), value :: descriptor
      end function c_close
   end interface

   type(structure_t), parameter :: cantilever = structure_t(length=1, rho=1, E=1, I=1, m_T=0.2_wp)
   integer :: k
   real(wp), parameter :: grid(40) = [(0.05_wp*k, k=1, 40)]

   call test_step()
   call test_modal_sums()
   call test_kelvin_voigt()
   call test_static()
   call test_linear()
   call test_before()
   call test_table_as_pulse()
   call test_tolerance()
   call test_orders()
   call test_times()
   call test_exhausted()
   call test_complaint()
   call test_cost()
   call finish('cvode')

contains

   !> Unit step force on the assembly, inverse Laplace transform. With 12 quintics modes 1 to 4,
   !> which carry the displacement, are right to 1e-7 and better; the fourth and higher move it by
   !> 1e-4 at most. Global errors of BDF exceed rtol = 1e-10 by some hundred: 1e-8 altogether. In
   !> the acceleration modes 4 and 5, wrong by some 1e-6 in frequency, are still alive at t = .5:
   !> 1e-5.
   subroutine test_step()
      real(wp), parameter :: t(3) = [0.5_wp, 2.0_wp, 5.0_wp], &
         acceleration(3) = [0.46773168716_wp, -1.012774464_wp, -0.62641429_wp], &
         displacement(3) = [0.11603519614_wp, 0.650877602_wp, 0.51635582_wp]
      type(response_t) :: response
      type(work_t) :: work
      integer :: i

      call run(cvode_t(rtol=1e-10_wp), assembly, mesh_t(5, 12, 6, 1), new_pulse(1.0_wp, 10.0_wp), &
         t, response, work=work)
      do i = 1, size(t)
         call check_close('step, displacement at t = '//to_text(t(i)), response%displacement(i), &
            displacement(i), 1e-8_wp)
         call check_close('step, acceleration at t = '//to_text(t(i)), response%acceleration(i), &
            acceleration(i), 1e-5_wp)
      end do
      call check('step, counters', work%solves == 1 .and. work%steps > 100 .and. &
         work%evaluations >= work%steps .and. work%factorizations > 0 .and. &
         work%factorizations < work%evaluations, to_text(work%steps)//' steps, '// &
         to_text(work%evaluations)//' evaluations, '//to_text(work%factorizations)// &
         ' factorizations')
   end subroutine test_step

   !> Pulse, triangle and distributed load on an undamped beam of two elements: three modes, up to
   !> omega = 200, all seen by the acceleration. Times fall on nodes of the force, too.
   subroutine test_modal_sums()
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error

      call against_modes('pulse', new_pulse(1.3_wp, 0.25_wp))
      call new_force_table([0.1_wp, 0.3_wp, 0.55_wp], [0.0_wp, 2.0_wp, 0.0_wp], excitation, error)
      call against_modes('triangle', excitation)
      call new_force_table([0.2_wp, 0.3_wp, 0.5_wp, 0.8_wp, 0.86_wp], &
         [-1.0_wp, 2.0_wp, 2.0_wp, -0.5_wp, 1.0_wp], excitation, error)
      call against_modes('table with jumps at both ends', excitation)
      excitation%distributed = .true.
      excitation%power = 2.5_wp
      call against_modes('distributed table', excitation)
   end subroutine test_modal_sums

   subroutine against_modes(name, excitation)
      character(len=*), intent(in) :: name
      type(excitation_t), intent(in) :: excitation
      type(mesh_t), parameter :: mesh = mesh_t(3, 2, 4, 1)
      type(response_t) :: response
      real(wp) :: motion(3, size(grid))

      call run(cvode_t(rtol=1e-10_wp), cantilever, mesh, excitation, grid, response)
      call modal_sum(name, cantilever, mesh, excitation, grid, motion)
      ! Undamped errors pile up over tens of periods of the highest mode: some hundred rtol in the
      ! displacement, and up to omega, of the order of 100, times as much with each derivative, of
      ! which the size of the velocity and of the acceleration takes its share.
      call check_close(name//': displacement', &
         maxval(abs(response%displacement - motion(1, :)))/maxval(abs(motion(1, :))), 0.0_wp, &
         3e-8_wp)
      call check_close(name//': velocity', &
         maxval(abs(response%velocity - motion(2, :)))/maxval(abs(motion(2, :))), 0.0_wp, 1e-6_wp)
      call check_close(name//': acceleration', &
         maxval(abs(response%acceleration - motion(3, :)))/maxval(abs(motion(3, :))), 0.0_wp, &
         1e-5_wp)
      call check(name//': something moves', maxval(abs(motion(1, :))) > 1e-2_wp)
   end subroutine against_modes

   !> Kelvin-Voigt damping alone keeps the modes apart: each a damped oscillator with
   !> zeta = c_D omega/(2 E), here from hardly damped to 1.6.
   subroutine test_kelvin_voigt()
      type(mesh_t), parameter :: mesh = mesh_t(3, 2, 4, 1)
      type(structure_t) :: beam
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      type(response_t) :: response
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp) :: root
      real(wp) :: exact(size(grid)), half
      integer :: j

      beam = cantilever
      beam%c_D = 0.02_wp
      galerkin = new_galerkin(mesh, beam%length)
      equations = new_equations(galerkin, beam, new_pulse(1.0_wp, 5.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      exact = 0
      do j = 1, size(omega)
         half = beam%c_D*omega(j)**2/2
         root = sqrt(cmplx(half**2 - omega(j)**2, 0.0_wp, wp))
         ! q'' = exp(-half t) (cosh(root t) - half sinh(root t)/root).
         exact = exact + dot_product(equations%observer, shapes(:, j))**2 &
            *real(exp((root - half)*grid)*(1 - half/root)/2 &
                  + exp((-root - half)*grid)*(1 + half/root)/2, wp)
      end do
      call run(cvode_t(rtol=1e-10_wp), beam, mesh, new_pulse(1.0_wp, 5.0_wp), grid, response)
      ! Damping forgets errors: ten rtol of a displacement of .3 are left, which M^-1 K makes an
      ! acceleration omega_max^2 times as large.
      call check_close('Kelvin-Voigt: acceleration', maxval(abs(response%acceleration - exact)), &
         0.0_wp, 10*1e-10_wp*0.3_wp*maxval(omega)**2)
   end subroutine test_kelvin_voigt

   !> A constant force on a strongly damped beam ends in the static deflection: f l^3/(3EI), and for
   !> theta = (x/l)^2 with it 13 f l^4/(180 EI) more, a polynomial of degree 6 that degree 7
   !> contains.
   subroutine test_static()
      type(structure_t), parameter :: beam = structure_t(length=2, rho=0.5_wp, E=3, I=0.7_wp, &
         c_D=3, m_T=0.3_wp, hose=hose_t(m_H=0.1_wp, c_H=2, k_H=4))
      real(wp), parameter :: force = 1.7_wp, point = force*8/(3*2.1_wp), &
         spread = 13*force*16/(180*2.1_wp)
      type(excitation_t) :: excitation
      type(response_t) :: response

      excitation = new_pulse(force, 1000.0_wp)
      call run(cvode_t(rtol=1e-8_wp), beam, mesh_t(7, 2, 8, 1), excitation, [900.0_wp], response)
      ! All motion has died out; errors do not pile up at rest: some hundred rtol.
      call check_close('static, force at the tip', response%displacement(1), point, 1e-6_wp)
      excitation%distributed = .true.
      excitation%power = 2
      call run(cvode_t(rtol=1e-8_wp), beam, mesh_t(7, 2, 8, 1), excitation, [900.0_wp], response)
      call check_close('static, distributed', response%displacement(1), point + spread, 1e-6_wp)
      call check_close('static, at rest', response%velocity(1), 0.0_wp, 1e-6_wp)
   end subroutine test_static

   !> The same case on a small mesh for the comparisons below.
   subroutine small(solver, excitation, response, work)
      type(cvode_t), intent(in) :: solver
      type(excitation_t), intent(in) :: excitation
      type(response_t), intent(out) :: response
      type(work_t), intent(out), optional :: work

      call run(solver, assembly, mesh_t(3, 3, 4, 1), excitation, grid, response, work=work)
   end subroutine small

   !> 1024 times the force: every number of the computation is scaled by a power of two, so that the
   !> response is 1024 times the other, exactly. With -3.7 it is to the tolerance of either.
   subroutine test_linear()
      type(response_t) :: one, many, other

      call small(cvode_t(rtol=1e-8_wp), new_pulse(1.0_wp, 0.3_wp), one)
      call small(cvode_t(rtol=1e-8_wp), new_pulse(1024.0_wp, 0.3_wp), many)
      call small(cvode_t(rtol=1e-8_wp), new_pulse(-3.7_wp, 0.3_wp), other)
      call check_close('linear in the amplitude, 1024', &
         maxval(abs(many%acceleration/1024 - one%acceleration)), 0.0_wp, 0.0_wp)
      ! A hundred rtol of the acceleration's size, 2.
      call check_close('linear in the amplitude, -3.7', &
         maxval(abs(other%acceleration/(-3.7_wp) - one%acceleration)), 0.0_wp, 2e-6_wp)
      call check('linear: something moves', maxval(abs(one%acceleration)) > 0.5_wp)
   end subroutine test_linear

   !> Rest before the force, exactly; at its first instant the acceleration b'M^-1 F f answers.
   subroutine test_before()
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(response_t) :: response
      real(wp), allocatable :: a(:)
      logical :: positive

      call new_force_table([0.5_wp, 0.9_wp], [3.0_wp, 1.0_wp], excitation, error)
      call run(cvode_t(), assembly, mesh_t(3, 3, 4, 1), excitation, &
         [-1.0_wp, 0.0_wp, 0.2_wp, 0.4999_wp, 0.5_wp, 0.6_wp], response)
      call check_close('before the force', maxval(abs([response%displacement(:5), &
         response%velocity(:5), response%acceleration(:4)])), 0.0_wp, 0.0_wp)
      galerkin = new_galerkin(mesh_t(3, 3, 4, 1), assembly%length)
      equations = new_equations(galerkin, assembly, excitation)
      a = 3*equations%load
      call equations%mass%factor(positive)
      call equations%mass%solve(a)
      ! The same solve: round-off of a matrix of condition 1e3.
      call check_close('at its first instant', response%acceleration(5), &
         dot_product(equations%observer, a), 1e-11_wp)
      call check('after it', response%displacement(6) > 1e-3_wp, to_text(response%displacement(6)))
      ! All times before the force, and none at all.
      call run(cvode_t(), assembly, mesh_t(3, 3, 4, 1), excitation, [0.1_wp, 0.2_wp], response)
      call check_close('only times before the force', maxval(abs(response%acceleration)), 0.0_wp, &
         0.0_wp)
      call run(cvode_t(), assembly, mesh_t(3, 3, 4, 1), excitation, [real(wp) ::], response)
      call check('no times', size(response%displacement) == 0)
   end subroutine test_before

   !> A pulse as a table with more nodes on its plateau is the same force: a thousand rtol of
   !> the acceleration's size, 1e2 of the displacement's, as above.
   subroutine test_table_as_pulse()
      type(excitation_t) :: table
      type(error_t), allocatable :: error
      type(response_t) :: one, other

      call new_force_table([0.0_wp, 0.13_wp, 0.2_wp, 0.3_wp], spread(1.5_wp, 1, 4), table, error)
      call small(cvode_t(rtol=1e-8_wp), table, other)
      call small(cvode_t(rtol=1e-8_wp), new_pulse(1.5_wp, 0.3_wp), one)
      call check_close('table equal to a pulse, acceleration', &
         maxval(abs(other%acceleration - one%acceleration)), 0.0_wp, 1e-5_wp)
      call check_close('table equal to a pulse, displacement', &
         maxval(abs(other%displacement - one%displacement)), 0.0_wp, 1e-7_wp)
   end subroutine test_table_as_pulse

   !> Were the end of the pulse stepped over, the error would not follow the tolerance: each decade
   !> of rtol must bring at least a factor 4 (variable order, order 5 at best: 10^(5/6) = 7 per
   !> decade of local error), three decades 64.
   subroutine test_tolerance()
      real(wp), parameter :: rtol(4) = [1e-6_wp, 1e-7_wp, 1e-8_wp, 1e-9_wp]
      type(mesh_t), parameter :: mesh = mesh_t(3, 2, 4, 1)
      type(response_t) :: response
      real(wp) :: motion(3, size(grid)), error(size(rtol))
      type(excitation_t) :: excitation
      integer :: i

      ! Ends between two of the times asked for.
      excitation = new_pulse(1.0_wp, 0.333_wp)
      call modal_sum('tolerance', cantilever, mesh, excitation, grid, motion)
      do i = 1, size(rtol)
         call run(cvode_t(rtol=rtol(i)), cantilever, mesh, excitation, grid, response)
         error(i) = maxval(abs(response%displacement - motion(1, :)))/maxval(abs(motion(1, :)))
         ! The more steps, the more errors pile up: some tens of rtol in 60 undamped periods.
         call check_close('rtol = '//to_text(rtol(i))//': error of the displacement', error(i), &
            0.0_wp, 100*rtol(i))
      end do
      call check('error follows the tolerance over a jump', error(4) < error(1)/64, &
         to_text(error(1))//' to '//to_text(error(4)))
   end subroutine test_tolerance

   !> Each highest order runs; what it costs falls with the order from 1 to 3.
   subroutine test_orders()
      type(response_t) :: reference, response
      type(work_t) :: work(5)
      integer :: order

      call small(cvode_t(rtol=1e-10_wp), new_pulse(1.0_wp, 0.3_wp), reference)
      do order = 1, 5
         call small(cvode_t(rtol=1e-6_wp, max_order=order), new_pulse(1.0_wp, 0.3_wp), response, &
            work(order))
         ! Errors pile up with the number of steps, 1e4 and more for order 1: thousands of rtol;
         ! some tens for the others, which take a tenth of the steps.
         call check_close('max_order = '//to_text(order)//': displacement', &
            maxval(abs(response%displacement &
            - reference%displacement))/maxval(abs(reference%displacement)), 0.0_wp, &
            merge(5e-3_wp, 1e-4_wp, order == 1))
         call check('max_order = '//to_text(order)//': counters', work(order)%steps > 0 .and. &
            work(order)%evaluations > 0 .and. work(order)%factorizations > 0, &
            to_text(work(order)%steps)//' steps')
      end do
      call check('a higher order takes fewer steps', work(1)%steps > 3*work(2)%steps .and. &
         work(2)%steps > work(3)%steps)
   end subroutine test_orders

   !> The times asked for change nothing: interpolated within steps, to the tolerance of the steps.
   subroutine test_times()
      type(response_t) :: all_times, last, close
      type(excitation_t) :: excitation

      excitation = new_pulse(1.0_wp, 0.3_wp)
      call small(cvode_t(rtol=1e-8_wp), excitation, all_times)
      call run(cvode_t(rtol=1e-8_wp), assembly, mesh_t(3, 3, 4, 1), excitation, grid(40:40), last)
      ! The same steps up to the last time: bit for bit.
      call check_close('one time or forty', last%acceleration(1) - all_times%acceleration(40), &
         0.0_wp, 0.0_wp)
      ! Times that CVODE would call too close to the start, to the end of the pulse, to each other.
      call run(cvode_t(rtol=1e-8_wp), assembly, mesh_t(3, 3, 4, 1), excitation, &
         [1e-300_wp, 1e-15_wp, nearest(0.3_wp, -1.0_wp), 0.3_wp, 0.3_wp*(1 + 1e-13_wp), 2.0_wp], &
         close)
      call check_close('close times: rest', close%displacement(2), 0.0_wp, 1e-20_wp)
      ! 1e3 rtol of a displacement of .05.
      call check_close('close times: displacement at the end of the pulse', &
         maxval(abs(close%displacement(3:5) - all_times%displacement(6))), 0.0_wp, 1e-6_wp)
      call check('close times: the force is there at .3, and gone after', &
         abs(close%acceleration(4) - close%acceleration(3)) < 1e-4_wp .and. &
         close%acceleration(5) < close%acceleration(4) - 0.5_wp, to_text(close%acceleration(4))// &
         ' and '//to_text(close%acceleration(5)))
   end subroutine test_times

   !> A pulse on the assembly, standard output and standard error to a file, whose size is
   !> returned.
   subroutine respond_silently(solver, work, error, printed)
      type(cvode_t), intent(in) :: solver
      type(work_t), intent(inout) :: work
      type(error_t), allocatable, intent(out) :: error
      integer, intent(out) :: printed
      type(response_t) :: response
      character(len=60) :: path
      integer(c_int) :: saved(2), file, status
      integer :: unit
      type(cvode_t) :: copy
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations

      galerkin = new_galerkin(mesh_t(3, 3, 4, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 0.3_wp))
      copy = solver
      path = own_path('cvode')
      flush (output_unit)
      file = c_creat(trim(path)//c_null_char, int(o'600', c_int))
      saved = [c_dup(1_c_int), c_dup(2_c_int)]
      status = c_dup2(file, 1_c_int)
      status = c_dup2(file, 2_c_int)
      call copy%respond(equations, new_pulse(1.0_wp, 0.3_wp), grid, response, work, error)
      flush (output_unit)
      status = c_dup2(saved(1), 1_c_int)
      status = c_dup2(saved(2), 2_c_int)
      status = c_close(saved(1)) + c_close(saved(2)) + c_close(file)
      inquire (file=trim(path), size=printed)
      open (newunit=unit, file=trim(path), status='old', action='readwrite')
      close (unit, status='delete')
   end subroutine respond_silently

   !> max_steps used up: an error that names it, nothing printed, the work counted.
   subroutine test_exhausted()
      type(work_t) :: work
      type(error_t), allocatable :: error
      integer :: printed

      call respond_silently(cvode_t(max_steps=50_ip), work, error, printed)
      call check('max_steps used up: an error', allocated(error))
      if (.not. allocated(error)) return
      call check('max_steps used up: named', error%status == status_failed .and. &
         index(error%message, 'max_steps = 50') > 0, error%message)
      call check('max_steps used up: nothing printed', printed == 0, to_text(printed)//' bytes')
      call check('max_steps used up: work counted', work%steps == 50 .and. &
         work%evaluations >= 50 .and. work%solves == 1, to_text(work%steps)//' steps')
      ! Counters add up over calls.
      call respond_silently(cvode_t(max_steps=60_ip), work, error, printed)
      call check('counters add up', work%steps == 110 .and. work%solves == 2, to_text(work%steps))
   end subroutine test_exhausted

   !> What CVODE itself complains of, a tolerance below round-off, comes back in the error.
   subroutine test_complaint()
      type(work_t) :: work
      type(error_t), allocatable :: error
      integer :: printed

      call respond_silently(cvode_t(rtol=1e-18_wp), work, error, printed)
      call check('CVODE''s complaint: an error', allocated(error))
      if (.not. allocated(error)) return
      call check('CVODE''s complaint: names the call', error%status == status_failed .and. &
         index(error%message, 'CVode: ') == 1 .and. len(error%message) > 20, error%message)
      call check('CVODE''s complaint: nothing printed', printed == 0, to_text(printed)//' bytes')
   end subroutine test_complaint

   !> The cost of a step is O(N): 512 elements take at most 1.5 times 8 times what 64 take. The
   !> least of several repetitions, so that other load on the machine does not count.
   subroutine test_cost()
      integer, parameter :: meshes(2) = [64, 512]
      integer(ip), parameter :: steps = 400
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error
      type(cvode_t) :: solver
      real(wp) :: before, after, cost(2)
      integer :: m, repetition

      solver = cvode_t(max_steps=steps)
      excitation = new_pulse(1.0_wp, 10.0_wp)
      cost = huge(cost)
      do repetition = 1, 7
         do m = 1, 2
            galerkin = new_galerkin(mesh_t(3, meshes(m), 4, 1), assembly%length)
            equations = new_equations(galerkin, assembly, excitation)
            work = work_t()
            call cpu_time(before)
            call solver%respond(equations, excitation, [10.0_wp], response, work, error)
            call cpu_time(after)
            cost(m) = min(cost(m), (after - before)/work%steps)
            if (repetition == 1) call check('cost: N = '//to_text(meshes(m))// &
               ' took all its steps', work%steps == steps)
         end do
      end do
      call check('cost of a step grows like N', cost(2) <= 1.5_wp*8*cost(1), &
         'N = 64: '//to_text(1e6_wp*cost(1))//' us, N = 512: '//to_text(1e6_wp*cost(2))//' us')
   end subroutine test_cost

end program test_cvode
