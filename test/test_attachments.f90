!> What hangs on a beam besides tip mass and hose: air damping, rotary inertia, a root that turns, a
!> sensor with a mass anywhere. Frequencies, roots and deflections against published numbers,
!> characteristic equations and LAPACK; limits; parameters that mean the same.
program test_attachments
   use attached_beams, only: all_roots, coarse, everything, experiment_on, fine, poles_of
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, mesh_t
   use beamid_kinds, only: wp
   use beamid_modes, only: undamped_modes
   use beamid_observation, only: observation_t, new_sampling
   use beamid_parameter_names, only: is_there
   use beamid_parameters, only: free_names, parameters
   use beamid_poles, only: poles_t
   use beamid_strings, only: to_text
   use beamid_structure, only: at_tip, end_t, free_end, of_a_h, of_b, of_b_h, of_c_R, of_d, of_E, &
      of_eta, of_kappa_R, of_length, of_m_S, of_m_T, of_x_S, structure_t
   use checks, only: check, check_close, finish
   use exact_motions, only: exact, galerkin, prepare, relative
   use full_matrices, only: full_t, new_full
   use random_experiments, only: experiment_t, samples
   use random_numbers, only: decades, start_random, uniform
   implicit none

   integer, parameter :: every = of_x_S
   integer :: i
   !> Numbers of all parameters; E takes the place of the loss factor, which is not defined in time.
   integer, parameter :: all_in_time(every) = [(merge(of_E, i, any(i == [of_eta, &
      of_a_h, of_b_h, of_d, of_b])), i=1, every)]
   real(wp), parameter :: eps = epsilon(1.0_wp), pi = acos(-1.0_wp)

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

   call start_random(20240301)
   call test_published()
   call test_rotary_inertia()
   call test_soft_root()
   call test_soft_mass()
   call test_soft_root_limits()
   call test_static()
   call test_sensor_at_tip()
   call test_lapack()
   call test_air()
   call finish('attachments')

contains

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
            structure = structure_t(length=1, rho=1, E=1, I=1, m_T=masses(m), &
               end=[end_t(kappa_R=1/springs(i)), free_end])
            call check_frequencies('k_R = '//to_text(springs(i))//', m_T = '//to_text(masses(m)), &
               structure, fine, beta(:, i, m)**2, &
               (1e-12_wp + (beta(:, i, m)/24)**8/1e6_wp)*beta(:, i, m)**2)
         end do
      end do
      structure = structure_t(length=1, rho=1, E=1, I=1, m_T=0.5_wp, &
         end=[end_t(kappa_R=0.2_wp), free_end], J_T=0.02_wp)
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
            end=[end_t(kappa_R=decades(-3.0_wp, 2.0_wp)), free_end])
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

      rigid_root = experiment_on(everything)
      rigid_root%mesh = coarse
      rigid_root%structure%end(1)%kappa_R = 0
      call prepare(rigid_root)
      call exact(rigid_root, [integer ::], known, none, error)
      call check('rigid root: a response', .not. allocated(error))
      do i = 2, 30, 4
         stiff = rigid_root
         stiff%structure%end(1)%kappa_R = 10.0_wp**(-i)
         call prepare(stiff)
         call exact(stiff, [integer ::], columns, none, error)
         call check_close('k_R = 1e'//to_text(i)//': as a rigid root', &
            relative(columns(:, 1), known(:, 1)), 0.0_wp, 50*10.0_wp**(-i) + 1e-12_wp)
         if (i == 2) call check('k_R = 100: not quite rigid', relative(columns(:, 1), &
            known(:, 1)) > 1e-3_wp, to_text(relative(columns(:, 1), known(:, 1))))
      end do
      bar = everything
      bar%hose(1)%m_H = 0
      bar%gamma = 0
      bar%c_D = 0
      inertia = bar%rho*bar%length**3/3 + bar%m_T*bar%length**2 + bar%J_T &
         + bar%sensor(1)%m_S*bar%sensor(1)%x_S**2
      do i = 2, 10, 2
         bar%end(1)%kappa_R = 10.0_wp**i
         call all_roots('bar', bar, coarse, roots)
         call check_close('k_R = 1e-'//to_text(i)//': a bar on a spring', &
            abs(roots(1))*sqrt(inertia*bar%end(1)%kappa_R), 1.0_wp, 1/bar%end(1)%kappa_R + 1e-12_wp)
         bar%end(1)%c_R = 2*0.3_wp*sqrt(inertia/bar%end(1)%kappa_R)
         call all_roots('bar', bar, coarse, roots)
         call check_close('k_R = 1e-'//to_text(i)//': damped at the root, 30 % of critical', &
            -real(roots(1))*sqrt(inertia*bar%end(1)%kappa_R), 0.3_wp, &
            sqrt(1/bar%end(1)%kappa_R) + 1e-12_wp)
         bar%end(1)%c_R = 0
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
               + s%length*places(i)*s%end(1)%kappa_R
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
         e = experiment_on(everything)
         if (root == 2) e%structure%end(1)%kappa_R = 0
         name = merge('soft root, sensor ', 'rigid root, sensor', root == 1)
         e%structure%sensor(1)%x_S = e%structure%length
         call prepare(e)
         call exact(e, all_in_time, at_end, d_end, error)
         call check(name//' at x_S = l: a response', .not. allocated(error))
         e%structure%sensor(1)%x_S = at_tip
         call prepare(e)
         call exact(e, all_in_time, by_default, d_default, error)
         call check(name//' at the tip: a response', .not. allocated(error))
         e%structure%m_T = e%structure%m_T + e%structure%sensor(1)%m_S
         e%structure%sensor(1)%m_S = 0
         call prepare(e)
         call exact(e, all_in_time, as_mass, d_mass, error)
         call check(name//', tip mass m_T + m_S: a response', .not. allocated(error))
         ! A few roundings in each root, times the phase, 1e3.
         call check_close(name//' at x_S = l: as by default', relative(by_default(:, 3), &
            at_end(:, 3)), 0.0_wp, 1e-11_wp)
         call check_close(name//' at x_S = l: as tip mass', relative(as_mass(:, 3), &
            at_end(:, 3)), 0.0_wp, 1e-11_wp)
         do k = 1, every
            if (root == 2 .and. any(k == [of_kappa_R, of_c_R])) then
               call check('rigid root: derivatives by '//trim(free_names(k))//' vanish', &
                  all(abs(d_end(:, :, k)) <= 0))
               cycle
            end if
            if (parameters(k)%group == 'along') then
               call check(name//': without a dip derivatives by its '//trim(free_names(k))// &
                  ' vanish', all(abs(d_end(:, :, k)) <= 0))
               cycle
            end if
            if (.not. is_there(e%structure, k) .or. all_in_time(k) /= k) cycle
            ! By default the sensor stays at the tip of a beam that grows.
            riding = d_end(:, 3, k)
            if (k == of_length) riding = riding + d_end(:, 3, of_x_S)
            call check_close(name//' at x_S = l: as by default, d/d '//trim(free_names(k)), &
               relative(d_default(:, 3, k), riding), 0.0_wp, 1e-10_wp)
            ! With m_S = 0 the sensor drags no mass along.
            if (k == of_x_S) cycle
            call check_close(name//' at x_S = l: as tip mass, d/d '//trim(free_names(k)), &
               relative(d_mass(:, 3, k), riding), 0.0_wp, 1e-10_wp)
         end do
         call check_close(name//' at the tip: d/d m_S is d/d m_T', relative(d_end(:, 3, of_m_S), &
            d_end(:, 3, of_m_T)), 0.0_wp, 1e-10_wp)
         e%structure%m_T = everything%m_T
         e%structure%sensor(1)%m_S = everything%sensor(1)%m_S
         e%structure%sensor(1)%x_S = 0.9_wp
         call prepare(e)
         call exact(e, all_in_time, inside, d_inside, error)
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
      cases(2)%end(1)%kappa_R = 0
      cases(3)%hose(1)%m_H = 0
      cases(3)%sensor(1)%x_S = 0.25_wp
      cases(4)%gamma = 30
      cases(4)%c_D = 0.1_wp
      do i = 1, size(cases)
         do m = 1, size(meshes)
            name = 'LAPACK, case '//to_text(i)//', degree '//to_text(meshes(m)%degree)//', N = '// &
               to_text(meshes(m)%elements)
            galerkin = galerkin_of(meshes(m), cases(i))
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

      structure = structure_t(length=2, rho=0.5_wp, E=3, I=1, end=[end_t(kappa_R=1), free_end])
      galerkin = galerkin_of(coarse, structure)
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

end program test_attachments
