!> Natural frequencies, shapes and damped roots against characteristic equations and closed forms.
program test_modes
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_modes, only: undamped_modes
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, structure_t, support_t
   use checks, only: check, check_close, finish
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp), pi = acos(-1.0_wp)
   !> beta_i l of 1 + cos b cosh b + mu b (cos b sinh b - sin b cosh b) = 0, 30-digit roots.
   real(wp), parameter :: mu(4) = [0.0_wp, 0.2_wp, 1.0_wp, 10.0_wp]
   real(wp), parameter :: beta(5, 4) = reshape([ &
      1.875104068712_wp, 4.694091132974_wp, 7.854757438238_wp, 10.99554073488_wp, &
      14.13716839105_wp, &
      1.616399660156_wp, 4.267061566865_wp, 7.318372673343_wp, 10.40156263267_wp, &
      13.50670224839_wp, &
      1.247917409606_wp, 4.031139436715_wp, 7.134132240940_wp, 10.25662107371_wp, &
      13.38775632597_wp, &
      0.7357819193897_wp, 3.938465833252_wp, 7.075616367032_wp, 10.21504647843_wp, &
      13.35549858995_wp], [5, 4])
   !> The assembly with hose: rho = E I = l = 1.
   type(structure_t), parameter :: assembly = structure_t(length=1, rho=1, E=1, I=1, &
      c_D=1e-3_wp, m_T=0.5_wp, hose=hose_t(m_H=0.3_wp, c_H=0.2_wp, k_H=20))

   call test_cantilever()
   call test_published()
   call test_units()
   call test_order(3, 3.9_wp)
   call test_order(5, 7.5_wp)
   call test_sensitivity()
   call test_assembly()
   call test_table_4_1()
   call test_loose_hose()
   call test_shapes(3, 6)
   call test_shapes(5, 16)
   call test_shapes(7, 24)
   call test_kelvin_voigt()
   call test_poles_satisfy_equation()
   call finish('modes')

contains

   !> Frequencies of a structure.
   subroutine frequencies(structure, degree, elements, omega)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: degree, elements
      real(wp), allocatable, intent(out) :: omega(:)
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: shapes(:, :)

      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), structure%length)
      equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      if (allocated(error)) then
         call check('modes of '//to_text(elements)//' elements', .false., error%message)
         allocate (omega(equations%n), source=0.0_wp)
      end if
   end subroutine frequencies

   type(structure_t) function cantilever(tip_mass)
      real(wp), intent(in) :: tip_mass

      cantilever = structure_t(length=1, rho=1, E=1, I=1, m_T=tip_mass)
   end function cantilever

   !> omega_i = beta_i^2. Quintic splines on 32 elements: the error (beta h)^8/3e6 or so is below
   !> 1e-9 even for mode 5, and the references carry 12 digits.
   subroutine test_cantilever()
      real(wp), allocatable :: omega(:)
      integer :: i, k

      do k = 1, size(mu)
         call frequencies(cantilever(mu(k)), 5, 32, omega)
         do i = 1, 5
            call check_close('mu = '//to_text(mu(k))//', omega '//to_text(i), omega(i), &
               beta(i, k)**2, 1e-9_wp*beta(i, k)**2)
         end do
      end do
   end subroutine test_cantilever

   !> Mathematical Problems in Engineering 2017, 1568019: mu = 1, seven digits.
   subroutine test_published()
      real(wp), parameter :: squares(5) = [1.557298_wp, 16.25009_wp, 50.89584_wp, 105.1983_wp, &
         179.2320_wp]
      real(wp), allocatable :: omega(:)
      integer :: i

      call frequencies(cantilever(1.0_wp), 5, 32, omega)
      do i = 1, 5
         ! One unit of the seventh digit printed.
         call check_close('published, mu = 1, beta^2 '//to_text(i), omega(i), squares(i), &
            10.0_wp**(floor(log10(squares(i))) - 6))
      end do
   end subroutine test_published

   !> omega = beta^2 sqrt(EI/(rho l^4)) in other units: each constant enters with its own power.
   subroutine test_units()
      type(structure_t), parameter :: beam = structure_t(length=3.7_wp, rho=0.023_wp, E=210.0_wp, &
         I=0.4_wp, m_T=0.2_wp*0.023_wp*3.7_wp)
      real(wp), allocatable :: omega(:)
      integer :: i

      call frequencies(beam, 5, 32, omega)
      do i = 1, 5
         ! As in test_cantilever.
         call check_close('other units, mu = .2, omega '//to_text(i), omega(i)/beta(i, 2)**2 &
            /sqrt(beam%E*beam%I/(beam%rho*beam%length**4)), 1.0_wp, 1e-9_wp)
      end do
   end subroutine test_units

   !> Error in omega falls like h^(2 degree - 2): 4 for cubics, 8 for quintics. The floor where it
   !> stops: the references have 12 to 13 digits, so that errors below 1e-11 say nothing.
   subroutine test_order(degree, least)
      integer, intent(in) :: degree
      real(wp), intent(in) :: least
      integer, parameter :: meshes(*) = [4, 8, 16, 32, 64]
      real(wp), parameter :: floor_of_error = 1e-11_wp
      real(wp), allocatable :: omega(:)
      real(wp) :: error(3, size(meshes)), order
      integer :: i, m, orders

      do m = 1, size(meshes)
         call frequencies(cantilever(1.0_wp), degree, meshes(m), omega)
         error(:, m) = abs(omega(:3)/beta(:3, 3)**2 - 1)
      end do
      orders = 0
      do i = 1, 3
         ! Cubics from 8 elements on: four for mode 3 are too few for the asymptotic order to show.
         do m = merge(3, 2, degree == 3), size(meshes)
            if (error(i, m) < floor_of_error) then
               call check('degree '//to_text(degree)//', mode '//to_text(i)//', N = '// &
                  to_text(meshes(m))//': at the floor', error(i, m) < floor_of_error, &
                  to_text(error(i, m)))
            else
               orders = orders + 1
               order = log(error(i, m - 1)/error(i, m))/log(2.0_wp)
               call check('degree '//to_text(degree)//', mode '//to_text(i)//', N = '// &
                  to_text(meshes(m))//': order', order >= least .and. order < 2*degree + 2, &
                  to_text(order)//', error '//to_text(error(i, m)))
            end if
         end do
      end do
      call check('degree '//to_text(degree)//': orders were seen', &
         orders >= merge(9, 3, degree == 3), to_text(orders))
   end subroutine test_order

   !> d beta_1/d mu at mu = 1, by the difference of fourth order with step .01: its error
   !> h^4/30 |beta^(5)| is some 1e-8, round-off eps/h nothing.
   subroutine test_sensitivity()
      real(wp), parameter :: reference = -0.251932421366_wp, h = 0.01_wp
      real(wp), allocatable :: omega(:)
      real(wp) :: beta_1(-2:2)
      integer :: k

      do k = -2, 2
         call frequencies(cantilever(1 + k*h), 5, 32, omega)
         beta_1(k) = sqrt(omega(1))
      end do
      call check_close('d beta_1/d mu at mu = 1', (8*(beta_1(1) - beta_1(-1)) &
         - (beta_1(2) - beta_1(-2)))/(12*h), reference, 2e-8_wp)
   end subroutine test_sensitivity

   !> Tip mass, hose and damping. Quintics on 24 elements: (beta h)^8 as above; the poles carry the
   !> round-off of an eigenvalue problem whose largest entry, c_D omega_max^2, is some 1e6.
   subroutine test_assembly()
      real(wp), parameter :: reference(5) = [1.689759892324_wp, 9.603101786881_wp, &
         17.13833288901_wp, 51.72422153953_wp, 106.0638487998_wp]
      complex(wp), parameter :: poles(3) = [(-0.0015966016133871_wp, 1.6897617523225_wp), &
         (-0.43889748614945_wp, 9.5950573575728_wp), (-0.19925586220265_wp, 17.13367740183_wp)]
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(structure_t) :: undamped
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:)
      complex(wp), allocatable :: roots(:)
      integer :: i

      undamped = assembly
      undamped%c_D = 0
      undamped%hose(1)%c_H = 0
      call frequencies(undamped, 5, 24, omega)
      do i = 1, 5
         call check_close('assembly, omega '//to_text(i), omega(i), reference(i), &
            1e-9_wp*reference(i))
      end do
      galerkin = new_galerkin(mesh_t(5, 24, 6, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      call check('assembly, damped roots found', .not. allocated(error))
      if (allocated(error)) return
      do i = 1, 3
         call check_close('assembly, real part of pole '//to_text(i), real(roots(i), wp), &
            real(poles(i), wp), 1e-9_wp*abs(poles(i)))
         call check_close('assembly, imaginary part of pole '//to_text(i), aimag(roots(i)), &
            aimag(poles(i)), 1e-9_wp*abs(poles(i)))
      end do
      call check('assembly, all roots decay', all(real(roots, wp) < 0))
      call check('assembly, ascending, imaginary parts not negative', all(aimag(roots) >= 0) .and. &
         all(abs(roots(2:)) >= abs(roots(:size(roots) - 1))))
      ! A complex pair stands for two roots, a real root for one: 2 n together.
      call check('assembly, number of roots', count(aimag(roots) > 0)*2 + count(aimag(roots) <= 0) &
         == 2*equations%n)
      equations = new_equations(galerkin, undamped, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      ! Without damping the roots are +- i omega: no further computation.
      call check_close('no damping, real parts', maxval(abs(real(roots, wp))), 0.0_wp, 0.0_wp)
      call check_close('no damping, omega 1', aimag(roots(1)), reference(1), 1e-9_wp*reference(1))
      call test_dashpot(undamped)
   end subroutine test_assembly

   !> A dashpot c beside the spring k of a support is all the damping there is: to first order
   !> ds/dc = s ds/dk, or Re s = -c d(omega**2/2)/dk. Second order, c**2 omega**2 against k**2, is
   !> 1e-8 at most; a central difference with steps of 1e-3 leaves 1e-6.
   subroutine test_dashpot(undamped)
      type(structure_t), intent(in) :: undamped
      type(structure_t) :: held
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: softer(:), stiffer(:)
      complex(wp), allocatable :: roots(:)
      real(wp), parameter :: k = 10, c = 1e-4_wp, h = 1e-3_wp*k
      integer :: i

      held = undamped
      held%supports = 1
      held%support(1) = support_t(x_P=0.6_wp, kappa_P=1/k, c_P=c)
      galerkin = new_galerkin(mesh_t(5, 24, 6, 1), held%length)
      equations = new_equations(galerkin, held, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      call check('a support''s dashpot: roots found', .not. allocated(error))
      if (allocated(error)) return
      held%support(1)%kappa_P = 1/(k - h)
      call frequencies(held, 5, 24, softer)
      held%support(1)%kappa_P = 1/(k + h)
      call frequencies(held, 5, 24, stiffer)
      do i = 1, 3
         call check_close('a support''s dashpot, decay of mode '//to_text(i), &
            real(roots(i), wp)/(c*(softer(i)**2 - stiffer(i)**2)/(4*h)), 1.0_wp, 1e-5_wp)
      end do
   end subroutine test_dashpot

   !> The structure behind Table 4.1, rad/s; the references are printed with eight decimals, of
   !> which half a unit is allowed on top of 1e-9 for the mesh (the table's own, 16 quintics).
   subroutine test_table_4_1()
      type(structure_t), parameter :: truth = structure_t(length=4, rho=0.03_wp, E=80, I=1, &
         m_T=0.15_wp, hose=hose_t(m_H=0.04_wp, k_H=0.3_wp))
      real(wp), parameter :: reference(6) = [2.59063789_wp, 4.84629206_wp, 51.96471056_wp, &
         163.69988125_wp, 338.93706051_wp, 577.86672629_wp]
      !> (beta h)^8/3e6 with 16 elements: modes 3 to 6 of the table bend 1 to 4 times and more.
      real(wp), parameter :: mesh_error(6) = [1e-9_wp, 1e-9_wp, 1e-9_wp, 1e-8_wp, 1e-7_wp, 1e-6_wp]
      real(wp), allocatable :: omega(:)
      integer :: i

      call frequencies(truth, 5, 16, omega)
      do i = 1, 6
         call check_close('Table 4.1, 16 quintics, omega '//to_text(i), omega(i), reference(i), &
            0.6e-8_wp + mesh_error(i)*reference(i))
      end do
      call frequencies(truth, 5, 40, omega)
      do i = 1, 6
         call check_close('Table 4.1, 40 quintics, omega '//to_text(i), omega(i), reference(i), &
            0.6e-8_wp + 1e-9_wp*reference(i))
      end do
   end subroutine test_table_4_1

   !> k_H = 0: the hose moves by itself, omega = 0, and the beam is one without a hose.
   subroutine test_loose_hose()
      type(structure_t) :: loose
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :), bare(:)
      integer :: i, n

      loose = cantilever(1.0_wp)
      loose%hose(1)%m_H = 0.3_wp
      galerkin = new_galerkin(mesh_t(5, 16, 6, 1), loose%length)
      equations = new_equations(galerkin, loose, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      call check('loose hose: modes found', .not. allocated(error))
      if (allocated(error)) return
      n = equations%n
      ! The shape is right to some eps; in omega the highest frequency, some 1e4, multiplies it.
      call check_close('loose hose: omega 1', omega(1), 0.0_wp, 1e-9_wp)
      call check_close('loose hose: y alone moves, by 1/sqrt(m_H)', abs(shapes(n, 1)), &
         1/sqrt(loose%hose(1)%m_H), 1e-12_wp)
      ! Round-off: coefficients of a mode that does not move are eps of those that do.
      call check_close('loose hose: the beam rests', maxval(abs(shapes(:n - 1, 1))), 0.0_wp, &
         1e-12_wp)
      call frequencies(cantilever(1.0_wp), 5, 16, bare)
      do i = 1, 5
         ! The same matrices but for a decoupled row; 1e-12 for another path of the eigensolver.
         call check_close('loose hose: omega '//to_text(i + 1), omega(i + 1), bare(i), &
            1e-12_wp*bare(i))
      end do
   end subroutine test_loose_hose

   !> X'MX = 1, X'KX = omega^2, K x = omega^2 M x.
   subroutine test_shapes(degree, elements)
      integer, intent(in) :: degree, elements
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :), x(:)
      character(len=:), allocatable :: name
      real(wp) :: worst, residual, norm, allowed
      integer :: i, j, n

      name = 'degree '//to_text(degree)//', N = '//to_text(elements)//': '
      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      call check(name//'modes found', .not. allocated(error))
      if (allocated(error)) return
      n = equations%n
      call check(name//'ascending', size(omega) == n .and. all(omega(2:) > omega(:n - 1)))
      ! The error of LAPACK's generalized eigenvectors is eps times the condition of K + sigma M,
      ! which is that of the highest frequencies over the lowest.
      allowed = 10*eps*(omega(n)/omega(1))**2
      worst = 0
      do j = 1, n
         x = equations%mass%times(shapes(:, j))
         do i = 1, n
            worst = max(worst, abs(dot_product(shapes(:, i), x) - merge(1.0_wp, 0.0_wp, i == j)))
         end do
      end do
      call check_close(name//'X''MX = 1', worst, 0.0_wp, min(allowed, 1e-6_wp))
      residual = 0
      norm = maxval(sum(abs(equations%stiffness%a), dim=1))*2
      do j = 1, n
         x = equations%stiffness%times(shapes(:, j)) - omega(j)**2*equations%mass%times(shapes(:, &
            j))
         residual = max(residual, maxval(abs(x))/(norm*maxval(abs(shapes(:, j)))))
      end do
      ! Backward stable would be a few n eps; the inverse form adds the condition of the pencil for
      ! the highest modes, which is square root of the above.
      call check_close(name//'K x - omega^2 M x', residual, 0.0_wp, &
         10*n*eps*omega(n)/omega(1))
   end subroutine test_shapes

   !> Damping proportional to stiffness: s^2 + (c_D/E) omega^2 s + omega^2 = 0 for every mode, two
   !> real roots where c_D omega > 2 E.
   subroutine test_kelvin_voigt()
      type(structure_t) :: beam
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp), allocatable :: roots(:)
      complex(wp) :: s, root(2)
      real(wp) :: half
      integer :: i, k, real_pairs

      beam = cantilever(0.2_wp)
      beam%c_D = 0.03_wp
      galerkin = new_galerkin(mesh_t(5, 4, 6, 1), beam%length)
      equations = new_equations(galerkin, beam, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      call damped_roots(equations, roots, error)
      call check('Kelvin-Voigt: roots found', .not. allocated(error))
      if (allocated(error)) return
      real_pairs = 0
      do i = 1, size(omega)
         half = beam%c_D/beam%E*omega(i)**2/2
         s = sqrt(cmplx(half**2 - omega(i)**2, 0.0_wp, wp))
         root = [-half + s, -half - s]
         ! The small one of two real roots by their product, to keep its digits.
         if (half > omega(i)) root(1) = omega(i)**2/root(2)
         if (half > omega(i)) real_pairs = real_pairs + 1
         do k = 1, merge(2, 1, half > omega(i))
            ! The roots rest on the tip values of the bare beam's modes. Those of the highest modes
            ! carry eps lambda_max/lambda_1, some 1e-9, of which the tip mass, moving the roots by
            ! 1e-4 at that end, passes on 1e-13: ten times that is allowed.
            call check_close('Kelvin-Voigt: mode '//to_text(i)//', root '//to_text(k)//' near '// &
               to_text(real(root(k), wp)), minval(abs(roots - root(k))), 0.0_wp, &
               1e-12_wp*abs(root(k)))
         end do
      end do
      call check('Kelvin-Voigt: some modes are overdamped, some not', &
         real_pairs > 0 .and. real_pairs < size(omega), to_text(real_pairs))
   end subroutine test_kelvin_voigt

   !> Any structure: the sum of all roots is -trace(M^-1 C), here by solving column by column.
   subroutine test_poles_satisfy_equation()
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      complex(wp), allocatable :: roots(:)
      real(wp), allocatable :: x(:)
      real(wp) :: trace, total
      logical :: positive
      integer :: i, k

      galerkin = new_galerkin(mesh_t(3, 3, 4, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      call damped_roots(equations, roots, error)
      call check('sum of roots: roots found', .not. allocated(error))
      if (allocated(error)) return
      call equations%mass%factor(positive)
      trace = 0
      do i = 1, equations%n
         x = [(equations%damping%element(i, k), k=1, equations%n)]
         call equations%mass%solve(x)
         trace = trace + x(i)
      end do
      total = sum(real(roots, wp)*merge(2, 1, aimag(roots) > 0))
      ! Round-off with the condition of M, some 1e3, and n terms.
      call check_close('sum of roots = -trace(M^-1 C)', total/trace, -1.0_wp, 1e4_wp*eps)
   end subroutine test_poles_satisfy_equation

end program test_modes
