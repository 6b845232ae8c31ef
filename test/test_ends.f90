!> Ends of the beam: clamped, pinned, guided, free or elastic, in natural frequencies, responses by
!> both solvers, their derivatives and limits, and the balance of forces of a beam that nothing
!> holds; with attachments anywhere.
program test_ends
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_base_motion, new_force_table
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: ip, wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: natural_frequencies, undamped_modes
   use beamid_quadrature, only: composite, rule_t
   use beamid_responses, only: prepare_for, response_t, solver_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: c_H_at, c_P_at, c_R_at, c_RP_at, c_w_at, compliance_at, end_t, &
      free_end, &
      hose_t, J_M_at, k_H_at, kappa_P_at, kappa_RP_at, m_H_at, m_M_at, mass_t, no_spring, of_E, &
      of_length, of_m_T, sensor_t, structure_t, support_t, x_H_at, x_M_at, x_P_at
   use checks, only: check, check_close, finish, in_long_run, skip
   use integration_errors, only: accumulated_error
   use random_numbers, only: between, decades, start_random, uniform
   use shell, only: beamid, close_shell, open_shell, outcome_t, write_file
   implicit none

   character(len=*), parameter :: kinds(4) = [character(len=7) :: 'clamped', 'pinned', 'guided', &
      'free']
   real(wp), parameter :: f(9) = [0.0_wp, 0.7_wp, -0.3_wp, 0.5_wp, 0.1_wp, -0.6_wp, 0.2_wp, &
      0.4_wp, 0.0_wp]
   integer, parameter :: samples = 40
   real(wp), parameter :: pi = acos(-1.0_wp)
   character(len=:), allocatable :: reason
   integer :: i

   call start_random(20261125)
   call test_frequencies()
   call test_symmetric_beams()
   do i = 1, merge(440, 48, in_long_run())
      call test_motion(i)
   end do
   call test_free_in_air()
   call test_limits()
   call test_balance()
   call test_static()
   call test_mesh_of_another_beam()
   call open_shell(reason)
   if (reason == '') then
      call test_names()
      call test_compressed_beam()
      call test_refusals()
      call close_shell()
   else
      call skip('cases', reason)
   end if
   call finish('ends')

contains

   !> Returns an end of a kind.
   pure function end_of(kind) result(end)
      character(len=*), intent(in) :: kind
      type(end_t) :: end

      if (kind == 'guided' .or. kind == 'free') end%kappa_w = no_spring
      if (kind == 'pinned' .or. kind == 'free') end%kappa_R = no_spring
   end function end_of

   !> Uniform beams with every pair of ends, modes 1 to 5, against the roots beta l of the
   !> characteristic equations, computed with mpmath (40 digits). The discretization error of
   !> quintic splines on 40 elements is 3e-10 in the fifth mode.
   subroutine test_frequencies()
      !> Clamped and clamped, or free and free; clamped or free and pinned; clamped or free and
      !> guided; clamped and free; two pinned or two guided; pinned and guided.
      real(wp), parameter :: roots(5, 6) = reshape([ &
         4.730040744862704_wp, 7.8532046240958376_wp, 10.995607838001671_wp, &
         14.137165491257464_wp, 17.278759657399481_wp, &
         3.9266023120479188_wp, 7.0685827456287321_wp, 10.210176122813031_wp, &
         13.351768777754093_wp, 16.49336143134641_wp, &
         2.365020372431352_wp, 5.4978039190008355_wp, 8.6393798286997407_wp, &
         11.780972451020228_wp, 14.922565104551627_wp, &
         1.8751040687119612_wp, 4.6940911329741746_wp, 7.8547574382376126_wp, &
         10.995540734875467_wp, 14.137168391046471_wp, &
         3.1415926535897932_wp, 6.2831853071795865_wp, 9.4247779607693797_wp, &
         12.566370614359173_wp, 15.707963267948966_wp, &
         1.5707963267948966_wp, 4.7123889803846899_wp, 7.8539816339744831_wp, &
         10.995574287564276_wp, 14.13716694115407_wp], [5, 6])
      !> Column of `roots` for each pair of kinds, and the number of motions as a rigid body.
      integer, parameter :: column(4, 4) = reshape([1, 2, 3, 4, 2, 5, 6, 2, 3, 6, 5, 3, 4, 2, 3, &
         1], [4, 4]), rigid(4, 4) = reshape([0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 1, 0, 1, 1, 2], [4, &
         4])
      type(structure_t) :: s
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error
      complex(wp), allocatable :: found(:)
      integer :: a, b, n

      do a = 1, 4
         do b = 1, 4
            s = structure_t(length=1, rho=1, E=1, I=1, end=[end_of(kinds(a)), end_of(kinds(b))])
            galerkin = galerkin_of(mesh_t(5, 40, 6, 1), s)
            associate (name => trim(kinds(a))//' and '//trim(kinds(b)))
               call damped_roots(new_equations(galerkin, s, pulse()), found, error)
               call check(name//': roots', .not. allocated(error))
               if (allocated(error)) cycle
               n = rigid(a, b)
               call check(name//': rigid-body modes at 0', count(abs(found) <= 0) == n, &
                  to_text(count(abs(found) <= 0)))
               call check_close(name//': modes 1 to 5', maxval(abs(sqrt(abs(found(n + 1:n + 5))) &
                  /roots(:, column(a, b)) - 1)), 0.0_wp, 1e-9_wp)
            end associate
         end do
      end do
   end subroutine test_frequencies

   !> Beams with equal springs at both ends: symmetric modes have no part of the antisymmetric ones,
   !> and the two motions as a rigid body respond at the same pole. Without damping, the roots are
   !> the natural frequencies of the band matrices, which use no poles.
   subroutine test_symmetric_beams()
      real(wp), parameter :: springs(6) = [1e-3_wp, 1e-2_wp, 0.3_wp, 3.0_wp, 30.0_wp, 1e3_wp]
      type(mesh_t), parameter :: mesh = mesh_t(3, 16, 4, 1)
      type(structure_t) :: s
      type(galerkin_t), target :: galerkin
      type(error_t), allocatable :: error
      type(end_t) :: elastic
      complex(wp), allocatable :: found(:)
      real(wp), allocatable :: omega(:)
      integer :: k, turns

      do turns = 0, 1
         do k = 1, size(springs)
            elastic = free_end
            elastic%kappa_w = 1/springs(k)
            if (turns == 1) elastic%kappa_R = 1/springs(k)
            s = structure_t(length=1, rho=1, E=1, I=1, end=[elastic, elastic])
            galerkin = galerkin_of(mesh, s)
            call damped_roots(new_equations(galerkin, s, pulse()), found, error)
            if (.not. allocated(error)) call natural_frequencies(s, mesh, omega, error)
            call check('equal springs '//to_text(springs(k))//': found', .not. allocated(error))
            if (allocated(error)) cycle
            ! The lowest frequencies are a share of round-off of the highest, 1e-5 in omega**2.
            call check_close('equal springs '//to_text(springs(k)), maxval(abs(abs(found(:6)) &
               /omega(:6) - 1)), 0.0_wp, 1e-6_wp)
         end do
      end do
   end subroutine test_symmetric_beams

   !> Returns a force of random nodes over the first second.
   function pulse() result(force)
      type(excitation_t) :: force
      type(error_t), allocatable :: error
      integer :: k

      call new_force_table([(k/8.0_wp, k=0, 8)], f, force, error)
   end function pulse

   !> Draws a beam whose ends are rigid, free or elastic, with what may be attached to it; beyond
   !> number 40, up to four attachments of each kind.
   function random_beam(number) result(s)
      integer, intent(in) :: number
      type(structure_t) :: s
      real(wp) :: kappa(2, 2)
      integer :: c, e

      s = structure_t(length=1.3_wp, rho=0.8_wp, E=2, I=0.9_wp, c_D=1e-3_wp, x_F=0.9_wp)
      s%sensor(1) = sensor_t(m_S=0.05_wp, J_S=0.001_wp, x_S=0.4_wp)
      s%sensors = 1
      do e = 1, 2
         do c = 1, 2
            kappa(c, e) = decades(-2.0_wp, 2.0_wp)
            if (uniform() < 0.3_wp) kappa(c, e) = 0
            if (uniform() < 0.4_wp) kappa(c, e) = no_spring
         end do
      end do
      s%end%kappa_w = kappa(1, :)
      s%end%kappa_R = kappa(2, :)
      where (kappa(1, :) > 0 .and. [uniform() < 0.3_wp, uniform() < 0.3_wp]) s%end%c_w = 0.2_wp
      where (kappa(2, :) > 0 .and. [uniform() < 0.3_wp, uniform() < 0.3_wp]) s%end%c_R = 0.1_wp
      if (modulo(number, 2) == 0) s%m_T = 0.3_wp
      if (modulo(number, 3) == 0) s%gamma = 0.2_wp
      if (modulo(number, 4) == 0) then
         s%supports = 1
         s%support(1) = support_t(x_P=0.7_wp, kappa_P=decades(-1.0_wp, 1.0_wp))
      end if
      if (modulo(number, 5) == 0) then
         s%hose(1)%m_H = 0.2_wp
         s%hose(1)%c_H = 0.1_wp
         s%hose(1)%k_H = 3
      end if
      if (number > 40) call attach(s)
   end function random_beam

   !> Attaches up to four masses, hoses and supports anywhere.
   subroutine attach(s)
      type(structure_t), intent(inout) :: s
      integer :: i

      s%masses = int(5*uniform())
      s%hoses = int(5*uniform())
      s%supports = int(5*uniform())
      do i = 1, 4
         s%mass(i) = mass_t(decades(-2.0_wp, 0.0_wp), decades(-4.0_wp, -2.0_wp), between(0.1_wp, &
            1.3_wp))
         s%hose(i) = hose_t(decades(-2.0_wp, 0.0_wp), decades(-2.0_wp, 0.0_wp), decades(-1.0_wp, &
            2.0_wp), between(0.1_wp, 1.3_wp))
         ! A quarter of the beam each, so that supports are apart.
         s%support(i) = support_t(0.3_wp*(i - 1) + between(0.1_wp, 0.3_wp), decades(-2.0_wp, &
            1.0_wp), 0.0_wp, decades(-2.0_wp, 1.0_wp), decades(-3.0_wp, -1.0_wp))
         if (uniform() < 0.3_wp) s%support(i)%kappa_P = no_spring
         if (uniform() < 0.3_wp) s%support(i)%kappa_RP = no_spring
         if (s%support(i)%kappa_P > 0) s%support(i)%c_P = decades(-2.0_wp, 0.0_wp)
      end do
      if (s%hoses == 0) s%hose(1)%m_H = 0
   end subroutine attach

   !> Both solvers under a force and, if the ends hold the beam, under a base that moves;
   !> derivatives of the exact response by fourth-order differences.
   subroutine test_motion(number)
      integer, intent(in) :: number
      type(structure_t) :: s
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error
      character(len=:), allocatable :: name
      integer :: k

      s = random_beam(number)
      name = 'beam '//to_text(number)
      call compare_solvers(name, s, pulse())
      call compare_slopes(name, s, pulse())
      if (s%rigid_body_modes() > 0) return
      call new_base_motion([(k/8.0_wp, k=0, 8)], f, excitation, error)
      call check(name//': base', .not. allocated(error))
      if (allocated(error)) return
      call compare_solvers(name//', base', s, excitation)
      call compare_slopes(name//', base', s, excitation)
   end subroutine test_motion

   !> Free beams in air with one mass. Both rigid motions of the bare beam have the root -gamma/rho,
   !> to the last digit in one of forty, and one root of the beam with the mass stays there. The sum
   !> rules of the exact response refuse it if a residue is wrong.
   subroutine test_free_in_air()
      type(structure_t) :: s
      type(response_t) :: response
      type(work_t) :: work
      integer :: k

      do k = 1, 300
         s = structure_t(length=between(0.5_wp, 2.0_wp), rho=between(0.5_wp, 2.0_wp), E=2, &
            I=0.9_wp, c_D=1e-3_wp, gamma=between(0.1_wp, 0.3_wp), &
            end=[end_of('free'), end_of('free')])
         s%x_F = s%length*between(0.1_wp, 1.0_wp)
         s%sensors = 1
         s%sensor(1) = sensor_t(m_S=decades(-3.0_wp, 0.0_wp), x_S=s%length*between(0.1_wp, 1.0_wp))
         call respond('free in air '//to_text(k), modal_t(), s, pulse(), response, work, &
            4 + modulo(k, 37))
         if (modulo(k, 30) > 0) cycle
         call compare_solvers('free in air '//to_text(k), s, pulse())
         call compare_slopes('free in air '//to_text(k), s, pulse())
      end do
   end subroutine test_free_in_air

   !> A mesh for a clamped root and a free tip does not serve a pinned beam, whose first natural
   !> frequency is pi**2 here (the error of this mesh is 1e-12). Without the check it would come out
   !> as 15.42.
   subroutine test_mesh_of_another_beam()
      type(structure_t) :: s
      type(galerkin_t), target :: clamped
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(response_t) :: response
      type(modal_t) :: exact
      type(cvode_t) :: integrator
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp), allocatable :: roots(:)

      s = structure_t(length=1.0_wp, rho=1.0_wp, E=1.0_wp, I=1.0_wp)
      s%end = [end_of('pinned'), end_of('pinned')]
      call natural_frequencies(s, mesh_t(5, 16, 6, 1), omega, error)
      call check('pinned beam: frequencies', .not. allocated(error))
      call check_close('pinned beam: first frequency', omega(1), pi**2, 1e-9_wp)
      clamped = new_galerkin(mesh_t(5, 16, 6, 1), s%length)
      call new_force_table([0.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], excitation, error)
      equations = new_equations(clamped, s)
      call undamped_modes(equations, omega, shapes, error)
      call check_mesh_refused('undamped modes', error)
      call damped_roots(equations, roots, error)
      call check_mesh_refused('damped roots', error)
      equations = new_equations(clamped, s, excitation)
      call exact%prepare(clamped, error)
      call exact%respond(equations, excitation, times(), response, work, error)
      call check_mesh_refused('modal', error)
      call integrator%respond(equations, excitation, times(), response, work, error)
      call check_mesh_refused('cvode', error)
   end subroutine test_mesh_of_another_beam

   !> Checks that a computation has refused the mesh.
   subroutine check_mesh_refused(name, error)
      character(len=*), intent(in) :: name
      type(error_t), allocatable, intent(in) :: error

      call check('mesh of another beam, '//name//': an error', allocated(error))
      if (allocated(error)) call check('mesh of another beam, '//name//': the reason', &
         index(error%message, 'galerkin_of') > 0, error%message)
   end subroutine check_mesh_refused

   !> Computes a response; a failure is a failed check.
   !>
   !> elements  of the mesh; default: 6
   subroutine respond(name, solver, s, excitation, response, work, elements)
      character(len=*), intent(in) :: name
      class(solver_t), intent(in) :: solver
      type(structure_t), intent(in) :: s
      type(excitation_t), intent(in) :: excitation
      type(response_t), intent(out) :: response
      type(work_t), intent(out) :: work
      integer, intent(in), optional :: elements
      class(solver_t), allocatable :: own
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(error_t), allocatable :: error
      integer :: n

      n = 6
      if (present(elements)) n = elements
      galerkin = galerkin_of(mesh_t(5, n, 6, 1), s)
      equations = new_equations(galerkin, s, excitation)
      own = solver
      call prepare_for(galerkin, own, error)
      if (.not. allocated(error)) &
         call own%respond(equations, excitation, times(), response, work, error)
      if (.not. allocated(error)) return
      call check(name//': a response', .false., error%message)
      allocate (response%displacement(samples), response%velocity(samples), &
         response%acceleration(samples), source=0.0_wp)
   end subroutine respond

   !> Returns the sample times, which go on after the force has ended.
   pure function times() result(t)
      real(wp) :: t(samples)
      integer :: k

      t = [(0.05_wp*k, k=1, samples)]
   end function times

   !> Compares displacements of the two solvers, relative to the largest; the limit is the error
   !> that the integrator accumulates.
   subroutine compare_solvers(name, s, excitation)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: s
      type(excitation_t), intent(in) :: excitation
      real(wp), parameter :: rtol = 1e-11_wp
      type(response_t) :: exact, integrated
      type(work_t) :: work

      call respond(name//', modal', modal_t(), s, excitation, exact, work)
      call respond(name//', cvode', cvode_t(rtol=rtol, max_steps=5000000_ip), s, excitation, &
         integrated, work)
      call check_close(name//': displacement', maxval(abs(exact%displacement &
         - integrated%displacement))/maxval(abs(integrated%displacement)), 0.0_wp, &
         accumulated_error(rtol, work%steps))
   end subroutine compare_solvers

   !> Compares derivatives with differences of sixth order with relative steps of 1e-4. The fastest
   !> modes turn by up to 1e3 rad, and by four times this share when the length changes; the
   !> truncation error of their small part of the displacement stays below 2e-9. Round-off is that
   !> of phases of 1e3 rad over the step, and relative to the motion of the base if there is one: no
   !> more than what the times give without reversal.
   subroutine compare_slopes(name, s, excitation)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: s
      type(excitation_t), intent(in) :: excitation
      real(wp), parameter :: weights(3) = [45, -9, 1]/60.0_wp
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(response_t) :: response, moved
      type(response_t), allocatable :: slopes(:)
      type(structure_t) :: changed
      type(work_t) :: work
      type(error_t), allocatable :: error
      integer, allocatable :: parameters(:)
      real(wp) :: base, difference(samples), h
      integer :: k, step

      parameters = [of_E, of_length, of_m_T, pack(reshape(compliance_at, [4]), &
         [(s%get(compliance_at(1 + modulo(k, 2), 1 + k/2)) > 0 .and. &
         s%get(compliance_at(1 + modulo(k, 2), 1 + k/2)) < no_spring, k=0, 3)]), &
         pack([c_w_at, c_R_at], [s%end%c_w, s%end%c_R] > 0), pack([x_P_at(1)], [s%supports > 0])]
      parameters = [parameters, m_M_at(:s%masses), J_M_at(:s%masses), x_M_at(:s%masses), &
         m_H_at(:s%hoses), c_H_at(:s%hoses), k_H_at(:s%hoses), x_H_at(:s%hoses), &
         x_P_at(2:s%supports), kappa_P_at(:s%supports), c_P_at(:s%supports), &
         kappa_RP_at(:s%supports), c_RP_at(:s%supports)]
      parameters = pack(parameters, [(s%get(parameters(k)) > 0 .and. s%get(parameters(k)) &
         < no_spring, k=1, size(parameters))])
      galerkin = galerkin_of(mesh_t(5, 6, 6, 1), s)
      equations = new_equations(galerkin, s, excitation)
      call solver%prepare(galerkin, error)
      if (.not. allocated(error)) call solver%differentiate(equations, excitation, times(), &
         parameters, response, slopes, work, error)
      call check(name//': derivatives', .not. allocated(error))
      if (allocated(error)) return
      base = sum(abs(f))/8*maxval(times())
      do k = 1, size(parameters)
         difference = 0
         h = 1e-4_wp*s%get(parameters(k))
         do step = -3, 3
            if (step == 0) cycle
            changed = s
            call changed%set(parameters(k), s%get(parameters(k)) + step*h)
            call respond(name, modal_t(), changed, excitation, moved, work)
            difference = difference + sign(1, step)*weights(abs(step))*moved%displacement/h
         end do
         call check_close(name//': derivative '//to_text(parameters(k)), &
            maxval(abs(slopes(k)%displacement - difference))*s%get(parameters(k)) &
            /maxval(abs(response%displacement)), 0.0_wp, 1e-8_wp + 1e3_wp*epsilon(h)/1e-4_wp &
            *merge(base, 0.0_wp, excitation%is_base)/maxval(abs(response%displacement)))
      end do
   end subroutine compare_slopes

   !> An end whose spring is almost rigid or almost absent moves like the limit, up to a term of
   !> first order: ten times the stiffness or compliance gives ten times the difference.
   subroutine test_limits()
      type(structure_t) :: s
      type(response_t) :: limit, near, nearer
      type(work_t) :: work
      real(wp) :: small, change(2)
      integer :: c, e, soft

      do e = 1, 2
         do c = 1, 2
            do soft = 0, 1
               s = random_beam(1)
               s%end = [end_of('clamped'), end_of('pinned')]
               call s%set(compliance_at(c, e), merge(no_spring, 0.0_wp, soft == 1))
               call respond('limit', modal_t(), s, pulse(), limit, work)
               small = 1e-7_wp
               call s%set(compliance_at(c, e), merge(1/small, small, soft == 1))
               call respond('near', modal_t(), s, pulse(), near, work)
               call s%set(compliance_at(c, e), merge(10/small, small/10, soft == 1))
               call respond('nearer', modal_t(), s, pulse(), nearer, work)
               change = [maxval(abs(near%acceleration - limit%acceleration)), &
                  maxval(abs(nearer%acceleration - limit%acceleration))] &
                  /maxval(abs(limit%acceleration))
               call check('condition '//to_text(c)//', end '//to_text(e)//merge(': soft ', &
                  ': stiff', soft == 1), change(1) < 1e-4_wp .and. &
                  abs(change(2) - change(1)/10) < 0.1_wp*change(1)/10 + 1e-9_wp, &
                  to_text(change(1))//', '//to_text(change(2)))
            end do
         end do
      end do
   end subroutine test_limits

   !> Without air and supports, the integral of rho a over a free beam plus m a of tip and sensor is
   !> the force, at every instant. The beam is integrated by Gauss points on each element.
   subroutine test_balance()
      type(structure_t) :: s
      type(rule_t) :: rule
      type(response_t) :: response
      type(work_t) :: work
      type(excitation_t) :: force
      real(wp) :: sum(samples)
      integer :: e, q

      s = structure_t(length=1.3_wp, rho=0.8_wp, E=2, I=0.9_wp, c_D=1e-3_wp, x_F=0.9_wp, &
         m_T=0.3_wp, end=[end_of('free'), end_of('free')])
      s%sensors = 2
      s%sensor(2) = sensor_t(m_S=0.05_wp, x_S=0.4_wp)
      force = pulse()
      rule = composite(6, 1)
      sum = 0
      do e = 0, 5
         do q = 1, size(rule%points)
            s%sensor(1)%x_S = (e + rule%points(q))/6*s%length
            call respond('balance', modal_t(), s, force, response, work)
            sum = sum + rule%weights(q)*s%length/6*s%rho*response%acceleration
         end do
      end do
      s%sensor(1)%x_S = s%length
      call respond('balance', modal_t(), s, force, response, work)
      sum = sum + s%m_T*response%acceleration
      s%sensor(1)%x_S = 0.4_wp
      call respond('balance', modal_t(), s, force, response, work)
      sum = sum + s%sensor(2)%m_S*response%acceleration
      call check_close('balance of a free beam', maxval(abs(sum - force%force(times()))), 0.0_wp, &
         1e-10_wp)
   end subroutine test_balance

   !> Static deflections of uniform beams in closed form (Roark, beams with a force in the middle):
   !> clamped at both ends F l**3/(192 E I), pinned at both F l**3/(48 E I), clamped and pinned
   !> 7 F l**3/(768 E I), guided at the root and clamped at the tip, at the root, F l**3/(12 E I).
   subroutine test_static()
      type(structure_t) :: s
      real(wp) :: unit

      s = structure_t(length=1.3_wp, rho=0.8_wp, E=2, I=0.9_wp, x_F=0.65_wp)
      unit = s%length**3/(s%E*s%I)
      s%end = [end_of('clamped'), end_of('clamped')]
      call check_close('static, clamped', s%static_deflection(0.65_wp)/unit, 1/192.0_wp, 1e-14_wp)
      s%end = [end_of('pinned'), end_of('pinned')]
      call check_close('static, pinned', s%static_deflection(0.65_wp)/unit, 1/48.0_wp, 1e-14_wp)
      s%end = [end_of('clamped'), end_of('pinned')]
      call check_close('static, propped', s%static_deflection(0.65_wp)/unit, 7/768.0_wp, 1e-14_wp)
      s%end = [end_of('guided'), end_of('clamped')]
      s%x_F = 1e-9_wp
      call check_close('static, guided', s%static_deflection(1e-9_wp)/unit, 1/12.0_wp, 1e-8_wp)
   end subroutine test_static

   !> The kinds by a case file, and the names of their parameters.
   subroutine test_names()
      type(outcome_t) :: outcome
      character(len=*), parameter :: nl = new_line('a')

      call write_file('free.nml', '&beam length=.12, width=.02, height=.005, E=2e11, '// &
         'density=7850 /'//nl//'&end at=''root'', kind=''free'' /'//nl// &
         '&discretization degree=5, elements=40, gauss_points=6, panels=1 /'//nl)
      outcome = beamid('modes free.nml --out out')
      ! 1801.55262965 and 4966.04919621 Hz, from the characteristic equation.
      call check('free bar', outcome%status == 0 .and. index(outcome%out, '1801.552630') > 0 &
         .and. index(outcome%out, '4966.049196') > 0, outcome%out)
   end subroutine test_names

   !> A beam clamped at both ends under compression: a release by a displacement is computed and
   !> fitted, with exact derivatives that identify compares with differences. Compression above the
   !> Euler load, 4 pi**2 E I/l**2 = 153.527 N, is refused.
   subroutine test_compressed_beam()
      type(outcome_t) :: outcome
      character(len=*), parameter :: nl = new_line('a'), beam = &
         '&end at=''tip'', kind=''clamped'' /'//nl// &
         '&excitation kind=''release'', displacement=0.005, x_F=0.25 /'//nl// &
         '&sensor x_S=0.35 /'//nl//'&discretization degree=5, elements=8 /'//nl// &
         '&beam length=0.6, width=0.03, height=0.002, density=2700, E=7e10, c_D=2e6 /'//nl

      call write_file('pressed.nml', beam//'&axial force=-80 /'//nl// &
         '&record t_first=0.002, t_last=0.5, t_step=0.001 /'//nl//'&noise sd=0.1, seed=1 /'//nl)
      outcome = beamid('simulate pressed.nml --out pressed')
      call check('clamped and compressed: simulate', outcome%status == 0, outcome%err)
      call write_file('pressed_fit.nml', beam//'&axial force=-70 /'//nl// &
         '&record file=''pressed/record.csv'' /'//nl// &
         '&stage free=''T'',''c_D'', lower=-140,0, upper=0,1e8 /'//nl)
      outcome = beamid('identify pressed_fit.nml --quiet --out fit')
      call check('clamped and compressed: identify', outcome%status == 0, outcome%err)
      call write_file('slender.nml', beam//'&axial force=-153.52 /'//nl)
      outcome = beamid('modes slender.nml --out out')
      call check('clamped, below the Euler load', outcome%status == 0, outcome%err)
      call write_file('slender.nml', beam//'&axial force=-153.54 /'//nl)
      outcome = beamid('modes slender.nml --out out')
      call check('clamped, above the Euler load', outcome%status == 2 .and. &
         index(outcome%err, 'buckles') > 0, outcome%err)
   end subroutine test_compressed_beam

   !> Ends that contradict a load, a support or each other: one line, status 2.
   subroutine test_refusals()
      call refused('weight', '&end at=''root'', kind=''free'' /', '&gravity g=9.81 /', &
         'rigid body')
      call refused('release', '&end at=''root'', kind=''pinned'' /', &
         '&excitation kind=''release'', force=1 /', 'rigid body')
      call refused('held twice', '&end at=''tip'', kind=''pinned'' /', '&support x_P=1 /', &
         'found a support at the tip')
      call refused('one end twice', '&end at=''tip'', kind=''pinned'' /', &
         '&end at=''tip'', kind=''free'' /', 'twice')
      call refused('unknown kind', '&end at=''tip'', kind=''welded'' /', '', 'welded')
      call refused('which end', '&end kind=''free'' /', '', 'at')
      call refused('sensor at a held tip', '&end at=''tip'', kind=''pinned'' /', &
         '&sensor x_S=1 /'//new_line('a')//'&excitation kind=''pulse'', amplitude=1, '// &
         'duration=0.1, x_F=0.5 /'//new_line('a')//'&record t_first=1, t_last=9, t_step=1 /', &
         'sensor x_S: found 1, the tip, which &end holds', 'simulate')
   end subroutine test_refusals

   !> Checks that a case with two groups is refused in one line that contains a word.
   !>
   !> command  default: modes
   subroutine refused(name, first, second, word, command)
      character(len=*), intent(in) :: name, first, second, word
      character(len=*), intent(in), optional :: command
      type(outcome_t) :: outcome
      character(len=*), parameter :: nl = new_line('a')

      call write_file('bad.nml', '&beam length=1, rho=1, E=1, I=1 /'//nl//first//nl// &
         second//nl)
      if (present(command)) then
         outcome = beamid(command//' bad.nml --out out')
      else
         outcome = beamid('modes bad.nml --out out')
      end if
      call check('refused: '//name, outcome%status == 2 .and. index(outcome%err, word) > 0 .and. &
         index(outcome%err, nl) >= len_trim(outcome%err), outcome%err)
   end subroutine refused

end program test_ends
