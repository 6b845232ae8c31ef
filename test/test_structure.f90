!> The structure and its equations: bands, energies, loads, refused values, parameters by name.
program test_structure
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t, status_bad_input
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_internal_forces, only: strain_energy
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: name_length, name_of_parameter, place_of_name
   use beamid_parameters, only: free_index, magnitude, parameters
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, of_c_R, of_kappa_R, of_x_S, structure_t
   use beamid_structure_checks, only: check_structure
   use checks, only: check, check_close, finish, of_mesh
   use dense_matrices, only: dense_of, half_bandwidth
   implicit none

   real(wp), parameter :: eps = epsilon(1.0_wp)
   type(structure_t), parameter :: assembly = structure_t(length=1.6_wp, rho=0.7_wp, E=30.0_wp, &
      I=0.2_wp, c_D=0.05_wp, m_T=0.4_wp, hose=hose_t(m_H=0.3_wp, c_H=0.2_wp, k_H=11.0_wp))
   integer, parameter :: degrees(*) = [3, 5, 7], meshes(*) = [1, 2, 3, 9, 20]
   integer :: d, m

   do d = 1, size(degrees)
      do m = 1, size(meshes)
         call test_matrices(degrees(d), meshes(m))
         call test_energies(degrees(d), meshes(m))
         call test_loads(degrees(d), meshes(m))
         call test_no_hose(degrees(d), meshes(m))
      end do
   end do
   call test_partial_hose()
   call test_check_structure()
   call test_parameters()
   call test_estimates()
   call finish('structure')

contains

   !> M, C, K of (3.11) assembled densely from the Gram matrices: same entries, same bandwidth.
   subroutine test_matrices(degree, elements)
      integer, intent(in) :: degree, elements
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      real(wp), allocatable :: gram(:, :), bending(:, :), mass(:, :), damping(:, :), &
         stiffness(:, :), b(:), d(:)
      integer :: n, expected

      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      n = galerkin%space%n + 1
      call check(of_mesh(degree, elements)//'unknowns with the hose', equations%n == n)
      allocate (gram(n, n), bending(n, n), b(n), d(n), source=0.0_wp)
      gram(:n - 1, :n - 1) = dense_of(galerkin%inertia)
      bending(:n - 1, :n - 1) = dense_of(galerkin%bending)
      b(:n - 1) = galerkin%space%at(assembly%length, 0)
      d = -b
      d(n) = 1
      mass = assembly%rho*gram + assembly%m_T*outer(b)
      mass(n, n) = assembly%hose(1)%m_H
      damping = assembly%c_D*assembly%I*bending + assembly%hose(1)%c_H*outer(d)
      stiffness = assembly%E*assembly%I*bending + assembly%hose(1)%k_H*outer(d)
      ! An entry is two products and a sum on both sides.
      call check_close(of_mesh(degree, elements)//'M', &
         maxval(abs(dense_of(equations%mass) - mass))/maxval(abs(mass)), 0.0_wp, 4*eps)
      call check_close(of_mesh(degree, elements)//'C', &
         maxval(abs(dense_of(equations%damping) - damping))/maxval(abs(damping)), 0.0_wp, 4*eps)
      call check_close(of_mesh(degree, elements)//'K', maxval(abs(dense_of(equations%stiffness) &
         - stiffness))/maxval(abs(stiffness)), 0.0_wp, 4*eps)
      ! The hose does not widen the band; a matrix of order n has no more than n - 1.
      expected = min(degree, n - 1)
      call check(of_mesh(degree, elements)//'half-bandwidth of K', &
         half_bandwidth(equations%stiffness) == expected .and. bandwidth(stiffness) == expected, &
         to_text(half_bandwidth(equations%stiffness)))
      call check(of_mesh(degree, elements)//'half-bandwidth of C', &
         half_bandwidth(equations%damping) == expected .and. bandwidth(damping) == expected)
      ! In M the hose stands alone: one less where the band reaches the corner only with it.
      expected = min(degree, n - 2)
      call check(of_mesh(degree, elements)//'half-bandwidth of M', &
         half_bandwidth(equations%mass) == expected .and. bandwidth(mass) == expected, &
         to_text(half_bandwidth(equations%mass)))
   end subroutine test_matrices

   pure function outer(x) result(matrix)
      real(wp), intent(in) :: x(:)
      real(wp) :: matrix(size(x), size(x))

      matrix = spread(x, 1, size(x))*spread(x, 2, size(x))
   end function outer

   !> Largest |i - j| with a nonzero entry of a dense matrix.
   pure integer function bandwidth(matrix)
      real(wp), intent(in) :: matrix(:, :)
      integer :: i, j

      bandwidth = 0
      do j = 1, size(matrix, 2)
         do i = 1, size(matrix, 1)
            if (abs(matrix(i, j)) > 0) bandwidth = max(bandwidth, abs(i - j))
         end do
      end do
   end function bandwidth

   !> x'Kx = EI int u''^2 + k_H (y - u(l))^2; x'Cx likewise; x'Mx = rho int u^2 + m_T u(l)^2 + m_H
   !> y^2. The integrals by twelve Gauss points per element from the spline's values, not its
   !> matrices.
   subroutine test_energies(degree, elements)
      integer, intent(in) :: degree, elements
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(structure_t) :: s
      type(rule_t) :: rule
      real(wp), allocatable :: x(:), u(:)
      real(wp) :: position, squared, curvature, tip, y, potential, kinetic, loss
      integer :: e, q, k

      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), assembly%length)
      equations = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      x = [(cos(4.1_wp*k), k=1, equations%n)]
      u = x(:equations%n - 1)
      y = x(equations%n)
      rule = gauss_legendre(12)
      squared = 0
      curvature = 0
      do e = 0, elements - 1
         do q = 1, size(rule%points)
            position = (e + rule%points(q))*assembly%length/elements
            associate (weight => rule%weights(q)*assembly%length/elements)
               squared = squared + weight*dot_product(galerkin%space%at(position, 0), u)**2
               curvature = curvature + weight*dot_product(galerkin%space%at(position, 2), u)**2
            end associate
         end do
      end do
      tip = dot_product(galerkin%space%at(assembly%length, 0), u)
      ! Not by `associate`: gfortran 12 then frees components of the constant that were never set.
      s = assembly
      potential = s%E*s%I*curvature + s%hose(1)%k_H*(y - tip)**2
      loss = s%c_D*s%I*curvature + s%hose(1)%c_H*(y - tip)**2
      kinetic = s%rho*squared + s%m_T*tip**2 + s%hose(1)%m_H*y**2
      ! Irregular coefficients: no more cancellation than the root combinations of degree 7 bring.
      call check_close(of_mesh(degree, elements)//'potential energy', &
         dot_product(x, equations%stiffness%times(x))/potential, 1.0_wp, 200*eps)
      call check_close(of_mesh(degree, elements)//'strain_energy', &
         strain_energy(equations, x)/potential, 1.0_wp, 200*eps)
      call check_close(of_mesh(degree, elements)//'dissipation', &
         dot_product(x, equations%damping%times(x))/loss, 1.0_wp, 200*eps)
      call check_close(of_mesh(degree, elements)//'kinetic energy', &
         dot_product(x, equations%mass%times(x))/kinetic, 1.0_wp, 200*eps)
      call check_close(of_mesh(degree, elements)//'observer', dot_product(equations%observer, x), &
         tip, 200*eps*gamma(degree + 1.0_wp))
   end subroutine test_energies

   !> Point load b(l); distributed load theta(l) b(l) + <theta, b>, theta = (x/l)^3; none on the
   !> hose.
   subroutine test_loads(degree, elements)
      integer, intent(in) :: degree, elements
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(excitation_t) :: excitation
      type(rule_t) :: rule
      real(wp), allocatable :: load(:)
      real(wp) :: scale
      integer :: e, q

      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), assembly%length)
      excitation = new_pulse(3.0_wp, 1.0_wp)
      equations = new_equations(galerkin, assembly, excitation)
      load = galerkin%space%at(assembly%length, 0)
      scale = maxval(abs(load))
      call check_close(of_mesh(degree, elements)//'point load, hose free', &
         maxval(abs(equations%load - [load, 0.0_wp])), 0.0_wp, 4*eps*scale)
      rule = gauss_legendre(12)
      do e = 0, elements - 1
         do q = 1, size(rule%points)
            associate (position => (e + rule%points(q))/elements)
               load = load + rule%weights(q)*assembly%length/elements*position**3 &
                  *galerkin%space%at(position*assembly%length, 0)
            end associate
         end do
      end do
      excitation%distributed = .true.
      excitation%power = 3
      equations = new_equations(galerkin, assembly, excitation)
      ! Sums of numbers of the size of the basis.
      call check_close(of_mesh(degree, elements)//'distributed load', &
         maxval(abs(equations%load - [load, 0.0_wp])), 0.0_wp, 40*eps*scale)
   end subroutine test_loads

   !> Without a hose: one unknown fewer, and the beam's part of the matrices as it was.
   subroutine test_no_hose(degree, elements)
      integer, intent(in) :: degree, elements
      type(galerkin_t), target :: galerkin
      type(equations_t) :: with_hose, without
      type(structure_t) :: bare
      real(wp), allocatable :: mass(:, :), stiffness(:, :)
      integer :: n

      galerkin = new_galerkin(mesh_t(degree, elements, degree + 1, 1), assembly%length)
      bare = assembly
      bare%hose(1)%m_H = 0
      call check('no hose mass, no hose', any(assembly%has_hose()) .and. .not. any(bare%has_hose()))
      with_hose = new_equations(galerkin, assembly, new_pulse(1.0_wp, 1.0_wp))
      without = new_equations(galerkin, bare, new_pulse(1.0_wp, 1.0_wp))
      n = without%n
      call check(of_mesh(degree, elements)//'one unknown fewer', n == with_hose%n - 1 .and. &
         n == galerkin%space%n .and. size(without%load) == n .and. size(without%observer) == n)
      mass = dense_of(with_hose%mass)
      stiffness = dense_of(with_hose%stiffness)
      ! The same operations: identical.
      call check_close(of_mesh(degree, elements)//'M without the hose', &
         maxval(abs(dense_of(without%mass) - mass(:n, :n))), 0.0_wp, 0.0_wp)
      ! k_H and c_H of a hose without mass act on nothing: only the beam's stiffness is left.
      call check_close(of_mesh(degree, elements)//'K without the hose', &
         maxval(abs(dense_of(without%stiffness) - bare%E*bare%I*dense_of(galerkin%bending))), &
         0.0_wp, 0.0_wp)
      call check(of_mesh(degree, elements)//'the hose is felt', maxval(abs(stiffness(:n, :n) &
         - dense_of(without%stiffness))) > assembly%hose(1)%k_H/2)
   end subroutine test_no_hose

   !> A hose with mass only: y is there, free of the beam.
   subroutine test_partial_hose()
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(structure_t) :: loose

      loose = assembly
      loose%hose(1)%k_H = 0
      loose%hose(1)%c_H = 0
      galerkin = new_galerkin(mesh_t(), loose%length)
      equations = new_equations(galerkin, loose, new_pulse(1.0_wp, 1.0_wp))
      call check('a loose hose keeps its coordinate', equations%n == galerkin%space%n + 1 .and. &
         abs(equations%stiffness%element(equations%n, equations%n)) <= 0 .and. &
         abs(equations%mass%element(equations%n, equations%n) - loose%hose(1)%m_H) <= 0)
   end subroutine test_partial_hose

   subroutine test_check_structure()
      type(error_t), allocatable :: error
      type(structure_t) :: s

      call check_structure(assembly, error)
      call check('check_structure accepts the assembly', .not. allocated(error))
      s = assembly
      s%c_D = 0; s%m_T = 0; s%hose(1)%m_H = 0; s%hose(1)%c_H = 0; s%hose(1)%k_H = 0
      call check_structure(s, error)
      call check('check_structure accepts zeros', .not. allocated(error))
      s = assembly; s%length = 0; call refused('length', s)
      s = assembly; s%length = -1; call refused('length', s)
      s = assembly; s%rho = 0; call refused('rho', s)
      s = assembly; s%rho = -0.1_wp; call refused('rho', s)
      s = assembly; s%E = 0; call refused('E', s)
      s = assembly; s%E = -80; call refused('E', s)
      s = assembly; s%I = 0; call refused('I', s)
      s = assembly; s%I = -1; call refused('I', s)
      s = assembly; s%c_D = -1e-9_wp; call refused('c_D', s)
      s = assembly; s%m_T = -1; call refused('m_T', s)
      s = assembly; s%hose(1)%m_H = -1; call refused('m_H', s)
      s = assembly; s%hose(1)%c_H = -1; call refused('c_H', s)
      s = assembly; s%hose(1)%k_H = -1; call refused('k_H', s)
   end subroutine test_check_structure

   !> The message starts with the key.
   subroutine refused(key, structure)
      character(len=*), intent(in) :: key
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable :: error

      call check_structure(structure, error)
      if (.not. allocated(error)) then
         call check('check_structure refuses '//key, .false., 'accepted')
      else
         call check('check_structure refuses '//key, error%status == status_bad_input .and. &
            index(error%message, key//': found ') == 1, error%message)
      end if
   end subroutine refused

   !> Each name reaches its own component, and no other.
   subroutine test_parameters()
      type(structure_t) :: s, held
      character(len=name_length) :: name
      real(wp) :: before(of_x_S), direct
      integer :: k, j

      ! Both ends described: the names of their parameters say which.
      held = assembly
      held%described = .true.
      do k = 1, of_x_S
         name = name_of_parameter(held, k)
         s = assembly
         s%sensor(1)%x_S = 1
         s%x_F = 2
         before = [(s%get(j), j=1, size(before))]
         call s%set(k, 123.5_wp + k)
         select case (trim(name))
         case ('m_T'); direct = s%m_T
         case ('E'); direct = s%E
         case ('c_D'); direct = s%c_D
         case ('m_H'); direct = s%hose(1)%m_H
         case ('c_H'); direct = s%hose(1)%c_H
         case ('k_H'); direct = s%hose(1)%k_H
         case ('rho'); direct = s%rho
         case ('gamma'); direct = s%gamma
         case ('J_T'); direct = s%J_T
         case ('k_w.root'); direct = s%end(1)%kappa_w
         case ('c_w.root'); direct = s%end(1)%c_w
         case ('k_R.root'); direct = s%end(1)%kappa_R
         case ('c_R.root'); direct = s%end(1)%c_R
         case ('k_w.tip'); direct = s%end(2)%kappa_w
         case ('c_w.tip'); direct = s%end(2)%c_w
         case ('k_R.tip'); direct = s%end(2)%kappa_R
         case ('c_R.tip'); direct = s%end(2)%c_R
         case ('m_S'); direct = s%sensor(1)%m_S
         case ('J_S'); direct = s%sensor(1)%J_S
         case ('x_F'); direct = s%x_F
         case ('x_S'); direct = s%sensor(1)%x_S
         case ('length'); direct = s%length
         case ('I'); direct = s%I
         case ('g'); direct = s%g
         case ('T'); direct = s%T
         case ('eta'); direct = s%eta
         case ('a_h'); direct = s%a_h
         case ('b_h'); direct = s%b_h
         case ('d_1'); direct = s%d_1
         case ('b_1'); direct = s%b_1
         case ('d_2'); direct = s%d_2
         case ('b_2'); direct = s%b_2
         case ('place'); direct = s%x_D
         case ('width'); direct = s%w_D
         case ('depth'); direct = s%d_D
         case default; direct = -1
         end select
         before(k) = 123.5_wp + k
         ! Copies, not computations: exact.
         call check_close('set '//trim(name), direct, 123.5_wp + k, 0.0_wp)
         call check_close('get '//trim(name)//' and all others', &
            maxval(abs([(s%get(j), j=1, size(before))] - before)), 0.0_wp, 0.0_wp)
         if (parameters(k)%group == 'end') then
            call check('place of '//trim(name), place_of_name(held, name) == k)
         else
            call check('index of '//trim(name), free_index(name) == merge(k, 0, &
               parameters(k)%is_free))
         end if
         call check('magnitude of '//trim(name)//' is positive', &
            magnitude(assembly, k) > 0)
      end do
      call check('the root of &beam', place_of_name(assembly, 'k_R') == of_kappa_R .and. &
         place_of_name(assembly, 'c_R') == of_c_R .and. place_of_name(assembly, 'k_w.tip') == 0)
      call check('any case', free_index('M_h') == free_index('m_H') &
         .and. free_index('e') == free_index('E'))
      call check('no such parameter', free_index('m') == 0 .and. free_index('') == 0 &
         .and. free_index('I') == 0)
   end subroutine test_parameters

   !> Rayleigh's estimate lies above the first frequency of a cantilever, by 1.5 per cent without
   !> tip mass: 3 * 140/33 against 1.875104068712^4.
   subroutine test_estimates()
      type(structure_t) :: s

      s = structure_t(length=2, rho=3, E=5, I=7)
      ! Closed forms of a few operations.
      call check_close('tip stiffness 3EI/l^3', s%stiffness(), 105/8.0_wp, 8*eps*14)
      call check_close('Rayleigh over the first frequency', &
         s%omega()/(1.875104068712_wp**2*sqrt(35/48.0_wp)), 1.0147_wp, 1e-4_wp)
   end subroutine test_estimates

end program test_structure
