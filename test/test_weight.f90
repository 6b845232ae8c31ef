!> Own weight, axial force, and properties that vary along the beam: frequencies against exact
!> solutions and finite elements, buckling, statics, and the way through whole matrices against the
!> one by oscillators that touch at few points.
program test_weight
   use beamid_assembly, only: assembly_t, new_assembly
   use beamid_columns, only: column_buckles, column_spring_t, column_t, most_pieces, new_column
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: ip, wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t, undamped_modes
   use beamid_pole_derivatives, only: differentiate_poles
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t, work_t
   use beamid_roots, only: damped_roots
   use beamid_strings, only: to_text
   use beamid_structure, only: end_t, free_end, no_spring, of_c_D, of_E, of_length, sensor_t, &
      structure_t
   use beamid_structure_checks, only: check_structure
   use beamid_variations, only: as_spline, in_lines, known_c_D, known_height, new_variation, &
      variations_t
   use checks, only: check, check_close, finish, held_root
   use hermite_beams, only: hermite_frequencies
   use integration_errors, only: accumulated_error
   use random_experiments, only: random_structure
   use random_numbers, only: start_random
   use static_checks, only: check_statics
   implicit none

   real(wp), parameter :: pi = acos(-1.0_wp)

   call start_random(20260413)
   call test_strip()
   call test_axial_force()
   call test_buckling()
   call test_euler_loads()
   call test_after_buckling()
   call test_pieces()
   call test_strings()
   call test_statics()
   call test_both_ways()
   call test_viscous_wedge()
   call finish('weight')

contains

   !> 600 x 50 x 2 mm of aluminium.
   type(structure_t) function strip() result(s)
      s = structure_t(length=0.6_wp, rho=0.27_wp, E=7e10_wp, I=0.05_wp*0.002_wp**3/12)
   end function strip

   !> The first angular frequency: of the undamped modes, and from the roots.
   subroutine first_frequency(s, mesh, by_modes, by_roots, error)
      type(structure_t), intent(in) :: s
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(out) :: by_modes, by_roots
      type(error_t), allocatable, intent(out) :: error
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      real(wp), allocatable :: omega(:), shapes(:, :)
      complex(wp), allocatable :: roots(:)

      by_modes = 0
      by_roots = 0
      galerkin = galerkin_of(mesh, s)
      equations = new_equations(galerkin, s, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, omega, shapes, error)
      if (.not. allocated(error)) by_modes = omega(1)
      if (.not. allocated(error)) call damped_roots(equations, roots, error)
      if (.not. allocated(error)) by_roots = abs(roots(1))
   end subroutine first_frequency

   !> A strip that hangs or stands, against 40 Hermite elements, which err by (beta h)**4/1440 in
   !> f1, 3e-9, and round-off.
   subroutine test_strip()
      character(len=*), parameter :: names(3) = [character(len=8) :: 'bare', 'hanging', 'standing']
      !> f1 [Hz] without weight; by how much weight changes it.
      real(wp), parameter :: f1 = 4.56957_wp, changes(3) = [0.0_wp, 1.546e-2_wp, -1.570e-2_wp]
      type(structure_t) :: s
      type(error_t), allocatable :: error
      real(wp) :: by_modes, by_roots, known(1)
      integer :: k

      do k = 1, 3
         s = strip()
         if (k > 1) s%g = 9.81_wp
         s%stands = k == 3
         call first_frequency(s, mesh_t(5, 12, 6, 1), by_modes, by_roots, error)
         call check(trim(names(k))//': frequencies', .not. allocated(error))
         known = hermite_frequencies(s, 40, 1)
         call check_close(trim(names(k))//': modes', by_modes/known(1), 1.0_wp, 3e-8_wp)
         call check_close(trim(names(k))//': roots', by_roots/known(1), 1.0_wp, 3e-8_wp)
         ! The figures have five digits, f1 has six.
         call check_close(trim(names(k))//': as known', by_roots/(2*pi*f1) - 1, changes(k), 6e-6_wp)
      end do
   end subroutine test_strip

   !> A cantilever under an axial force has w = cosh a x - cos b x - C (sinh a x/a - sin b x/b).
   subroutine test_axial_force()
      type(structure_t) :: s
      type(error_t), allocatable :: error
      real(wp) :: by_modes, by_roots, low, high, middle
      real(wp), parameter :: forces(5) = [-2.4_wp, -1.0_wp, 1.0_wp, 10.0_wp, 100.0_wp]
      integer :: i, k

      s = structure_t(length=1, rho=1, E=1, I=1)
      do k = 1, size(forces)
         s%T = forces(k)
         call first_frequency(s, mesh_t(7, 24, 8, 1), by_modes, by_roots, error)
         call check('axial force: frequencies', .not. allocated(error))
         low = 0.5_wp*by_modes
         high = 1.2_wp*by_modes
         do i = 1, 60
            middle = (low + high)/2
            if (characteristic(s%T, low)*characteristic(s%T, middle) > 0) low = middle
            if (characteristic(s%T, low)*characteristic(s%T, middle) <= 0) high = middle
         end do
         ! Near buckling, at -pi**2/4, round-off of the stiffness counts more: omega**2 is small.
         call check_close('axial force, modes', by_modes/middle, 1.0_wp, 1e-9_wp)
         call check_close('axial force, roots', by_roots/middle, 1.0_wp, 1e-9_wp)
      end do
   end subroutine test_axial_force

   !> Zero at the frequencies of a cantilever, rho = E I = l = 1.
   pure real(wp) function characteristic(T, omega) result(value)
      real(wp), intent(in) :: T, omega
      real(wp) :: a, b

      a = sqrt((T + sqrt(T**2 + 4*omega**2))/2)
      b = sqrt((-T + sqrt(T**2 + 4*omega**2))/2)
      value = (a**2*cosh(a) + b**2*cos(b))*(b**2*cosh(a) + a**2*cos(b)) &
         - (a*sinh(a) + b*sin(b))*(a*b**2*sinh(a) - a**2*b*sin(b))
   end function characteristic

   !> At T = -pi**2/4 E I/l**2, and at g rho l**3/(E I) = 7.8373 of a beam that stands: just below
   !> there are frequencies, just above an error, by everything that could go wrong.
   subroutine test_buckling()
      type(structure_t) :: s
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: modal
      type(cvode_t) :: cvode
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp) :: by_modes, by_roots
      integer :: k

      do k = 1, 4
         s = structure_t(length=1, rho=1, E=1, I=1, c_D=1e-3_wp)
         if (k < 3) s%T = -pi**2/4*merge(0.999_wp, 1.001_wp, k == 1)
         if (k > 2) s%g = 7.8373_wp*merge(0.999_wp, 1.001_wp, k == 3)
         s%stands = k > 2
         call check_structure(s, error)
         call check('buckling: the structure', allocated(error) .eqv. modulo(k, 2) == 0)
         call first_frequency(s, mesh_t(5, 8, 6, 1), by_modes, by_roots, error)
         call check('buckling: frequencies', allocated(error) .eqv. modulo(k, 2) == 0)
         galerkin = new_galerkin(mesh_t(5, 8, 6, 1), 1.0_wp)
         equations = new_equations(galerkin, s, new_pulse(1.0_wp, 0.1_wp))
         call modal%prepare(galerkin, error)
         call modal%respond(equations, new_pulse(1.0_wp, 0.1_wp), [0.5_wp, 1.0_wp], response, &
            work, error)
         call check('buckling: modal', allocated(error) .eqv. modulo(k, 2) == 0)
         if (k == 2) call check('buckling: in words', index(error%message, 'buckle') > 0)
         call cvode%respond(equations, new_pulse(1.0_wp, 0.1_wp), [0.5_wp, 1.0_wp], response, &
            work, error)
         call check('buckling: cvode', allocated(error) .eqv. modulo(k, 2) == 0)
      end do
   end subroutine test_buckling

   !> Buckling loads of uniform beams on every pair of ends that holds them: just below them the
   !> structure is accepted, just above it is refused. Two more beams have a support: rigid, it
   !> halves a pinned beam, which buckles at 4 pi**2; elastic, it does so from the stiffness
   !> 16 pi**2 E I/l**3 on.
   subroutine test_euler_loads()
      integer, parameter :: clamped = 1, pinned = 2, guided = 3, free = 4, beams = 8
      integer, parameter :: ends(2, beams) = reshape([clamped, clamped, clamped, pinned, clamped, &
         guided, clamped, free, pinned, pinned, pinned, guided, pinned, pinned, pinned, pinned], &
         [2, beams])
      real(wp), parameter :: load(beams) = [4*pi**2, 20.19072855642663_wp, pi**2, pi**2/4, pi**2, &
         pi**2/4, 4*pi**2, 4*pi**2]
      type(end_t) :: kinds(4)
      type(structure_t) :: s
      type(error_t), allocatable :: error
      integer :: b, swap

      kinds = [end_t(), end_t(kappa_R=no_spring), end_t(kappa_w=no_spring), free_end]
      do b = 1, beams
         do swap = 0, 1
            s = structure_t(length=1.5_wp, rho=1, E=2, I=3, end=kinds(ends([1 + swap, &
               2 - swap], b)))
            if (b > 6) then
               s%supports = 1
               s%support(1)%x_P = 0.75_wp
               if (b == 8) s%support(1)%kappa_P = 1.5_wp**3/(16*pi**2*6)
            end if
            associate (unit => s%E*s%I/s%length**2, name => 'Euler load of beam '//to_text(b))
               s%T = -load(b)*unit*(1 - 1e-9_wp)
               call check_structure(s, error)
               call check(name//': holds', .not. allocated(error))
               s%T = -load(b)*unit*(1 + 1e-9_wp)
               call check_structure(s, error)
               call check(name//': buckles', allocated(error))
            end associate
         end do
      end do
   end subroutine test_euler_loads

   !> 80 cubics with joints where something is err like h**4; other ends, and no support.
   subroutine test_statics()
      type(structure_t) :: s

      s = structure_t(length=1.3_wp, rho=1, E=1, I=1, m_T=0.1_wp, &
         end=[end_t(kappa_R=0.1_wp), free_end], T=0.2_wp, g=0.5_wp, x_F=0.975_wp)
      s%stands = .true.
      s%sensor(1) = sensor_t(m_S=0.3_wp, x_S=0.65_wp)
      s%supports = 1
      s%support(1)%x_P = 0.325_wp
      s%support(1)%kappa_P = 0.02_wp
      call check_statics('statics', s, mesh_t(3, 80, 4, 1), 1e-6_wp)
      s%end = [end_t(kappa_w=0.02_wp, kappa_R=no_spring), end_t(kappa_R=0.3_wp)]
      call check_statics('statics, elastic ends', s, mesh_t(3, 80, 4, 1), 1e-6_wp)
      s%end = [end_t(), end_t()]
      s%T = -2
      call check_statics('statics, clamped ends', s, mesh_t(3, 80, 4, 1), 1e-6_wp)
      s%end = [free_end, end_t(kappa_w=no_spring)]
      s%T = -0.5_wp
      s%stands = .false.
      call check_statics('statics, held by a support and a guide', s, mesh_t(3, 80, 4, 1), 1e-6_wp)
   end subroutine test_statics

   !> A column has at most `most_pieces` pieces, whatever its force: none at all beyond that.
   subroutine test_pieces()
      type(column_t) :: column
      complex(wp), parameter :: ends(3) = [(0.0_wp, 0.0_wp), (0.25_wp, 0.0_wp), (1.0_wp, 0.0_wp)], &
         unit = (1.0_wp, 0.0_wp), none = (0.0_wp, 0.0_wp)
      type(column_spring_t), parameter :: clamp(2) = [column_spring_t(slope=0), &
         column_spring_t(slope=1)]
      integer :: k, n

      do k = -300, 300, 10
         column = new_column(unit, ends, [unit, unit]*10.0_wp**k, [none, none], clamp)
         n = size(column%N)
         call check('pieces: bounded', n <= most_pieces .and. size(column%slope) == n .and. &
            size(column%ends) == n + 1)
         call check('pieces: none beyond that', (n == 0) .eqv. k > 5)
         call check('pieces: beyond that it counts as buckled', column_buckles(column) .eqv. k > 5)
         column = new_column(unit, ends, -[unit, unit]*10.0_wp**k, [none, none], clamp)
         call check('pieces: compression', column_buckles(column) .eqv. k > 0)
      end do
   end subroutine test_pieces

   !> The static deflection of a beam in strong tension T, l/T (1 - tanh(a l)/(a l)) under a unit
   !> force at the tip with a = sqrt(T/E I), to the round-off of some 500 pieces; and a beam in
   !> stronger tension, which is refused by all that compute anything of it.
   subroutine test_strings()
      type(structure_t) :: s
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: modal
      type(cvode_t) :: cvode
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp) :: by_modes, by_roots, a

      s = structure_t(length=1, rho=1, E=1, I=1, T=2e5_wp)
      a = sqrt(s%T)
      call check_close('string: deflection', s%static_deflection(1.0_wp)*s%T/(1 - tanh(a)/a), &
         1.0_wp, 500*epsilon(a))
      call check_structure(s, error)
      call check('string: accepted', .not. allocated(error))
      s%T = 1e12_wp
      call check_structure(s, error)
      call tell('string: the structure', error)
      call first_frequency(s, mesh_t(5, 8, 6, 1), by_modes, by_roots, error)
      call tell('string: frequencies', error)
      galerkin = new_galerkin(mesh_t(5, 8, 6, 1), 1.0_wp)
      equations = new_equations(galerkin, s, new_pulse(1.0_wp, 0.1_wp))
      call modal%prepare(galerkin, error)
      call modal%respond(equations, new_pulse(1.0_wp, 0.1_wp), [0.5_wp], response, work, error)
      call tell('string: modal', error)
      call cvode%respond(equations, new_pulse(1.0_wp, 0.1_wp), [0.5_wp], response, work, error)
      call tell('string: cvode', error)
   end subroutine test_strings

   !> Checks that a beam is refused because of its tension.
   subroutine tell(what, error)
      character(len=*), intent(in) :: what
      type(error_t), allocatable, intent(in) :: error

      call check(what, allocated(error))
      if (allocated(error)) call check(what//' in words', index(error%message, &
         'behaves like a string') > 0, error%message)
   end subroutine tell

   !> A search may try a beam that buckles: what the solver knows of that one's roots, of which two
   !> are real, is of no use for the next. The same response as by a solver that has seen neither.
   subroutine test_after_buckling()
      type(structure_t) :: s
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: seasoned, fresh
      type(response_t) :: response, judge
      type(response_t), allocatable :: slopes(:), judges(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      real(wp), parameter :: share(3) = [0.9_wp, 1.05_wp, 0.8_wp]
      real(wp), parameter :: times(3) = [0.3_wp, 1.0_wp, 4.0_wp]
      integer :: k

      galerkin = new_galerkin(mesh_t(5, 8, 6, 1), 1.0_wp)
      call seasoned%prepare(galerkin, error)
      do k = 1, size(share)
         s = structure_t(length=1, rho=1, E=1, I=1, c_D=1e-3_wp, T=-pi**2/4*share(k))
         equations = new_equations(galerkin, s, new_pulse(1.0_wp, 0.1_wp))
         call seasoned%differentiate(equations, new_pulse(1.0_wp, 0.1_wp), times, [of_E, of_c_D], &
            response, slopes, work, error)
         call check('after buckling: refused or not', allocated(error) .eqv. k == 2)
      end do
      if (allocated(error)) return
      call fresh%prepare(galerkin, error)
      call fresh%differentiate(equations, new_pulse(1.0_wp, 0.1_wp), times, [of_E, of_c_D], &
         judge, judges, work, error)
      call check('after buckling: a judge', .not. allocated(error))
      if (allocated(error)) return
      ! Roots to 1e-12 or so, near buckling less.
      call check_close('after buckling: acceleration', maxval(abs(response%acceleration &
         - judge%acceleration))/maxval(abs(judge%acceleration)), 0.0_wp, 1e-10_wp)
      do k = 1, 2
         call check_close('after buckling: derivatives', maxval(abs(slopes(k)%acceleration &
            - judges(k)%acceleration))/maxval(abs(judges(k)%acceleration)), 0.0_wp, 1e-8_wp)
      end do
   end subroutine test_after_buckling

   !> Ordinary structures both ways: poles, residues and their derivatives. Random ones have a pair
   !> of roots now and then that is nearly one: 1e-10 of a root, and of the largest residue of those
   !> that are no part of a cluster, with its digits.
   subroutine test_both_ways()
      type(structure_t) :: s
      type(galerkin_t) :: galerkin
      type(beam_modes_t) :: modes
      type(assembly_t) :: assembly
      type(poles_t) :: sparse, whole
      type(error_t), allocatable :: error
      integer :: number, k, j
      real(wp) :: off(4), worst(4), room

      worst = 0
      do number = 1, 400
         s = random_structure()
         galerkin = new_galerkin(mesh_t(3, 2 + modulo(number, 7), 4, 1), s%length, &
            held_root(.true.))
         call bare_beam_modes(galerkin, modes, error)
         assembly = new_assembly(s, modes, [of_E, of_c_D, of_length])
         call find_poles(assembly, sparse, error)
         call check('both ways: by few couplings', .not. allocated(error))
         if (allocated(error)) cycle
         call differentiate_poles(assembly, sparse)
         assembly = new_assembly(s, modes, [of_E, of_c_D, of_length], whole=.true.)
         call find_poles(assembly, whole, error)
         call check('both ways: by whole matrices', .not. allocated(error))
         if (allocated(error)) cycle
         call differentiate_poles(assembly, whole)
         call check('both ways: as many', size(whole%s) == size(sparse%s))
         do k = 1, size(sparse%s)
            if (any(sparse%cluster%holds(sparse%s(k)))) cycle
            j = minloc(abs(whole%s - sparse%s(k)), dim=1)
            if (any(whole%cluster%holds(whole%s(j)))) cycle
            room = abs(sparse%vector(k)%A)/(2*abs(sparse%s(k))*sparse%vector(k)%inertia)
            off(1) = abs(whole%s(j) - sparse%s(k))/abs(sparse%s(k))
            off(2) = abs(whole%residue(j) - sparse%residue(k))/maxval(abs(sparse%residue))
            off(3) = maxval(abs(whole%ds(j, :) - sparse%ds(k, :))/maxval(abs(sparse%ds), dim=1))
            off(4) = maxval(abs(whole%dr(j, :) - sparse%dr(k, :))/maxval(abs(sparse%dr), dim=1))
            worst = max(worst, off*min(1.0_wp, room))
            where (.not. off >= 0) worst = huge(worst)
         end do
      end do
      call check_close('both ways: roots', worst(1), 0.0_wp, 1e-10_wp)
      call check_close('both ways: residues', worst(2), 0.0_wp, 1e-10_wp)
      call check_close('both ways: roots by parameters', worst(3), 0.0_wp, 1e-8_wp)
      call check_close('both ways: residues by parameters', worst(4), 0.0_wp, 1e-8_wp)
   end subroutine test_both_ways

   !> Depth linear, half at the tip: E I like (1 - xi/2)**3, mass like 1 - xi/2.
   type(variations_t) function wedge() result(varied)
      varied%known(known_height) = new_variation(in_lines, [0.0_wp, 1.0_wp], [1.0_wp, 0.5_wp])
      varied%by_density = .true.
   end function wedge

   !> Compares modal with cvode for air and a viscosity that varies by itself, with a mass at the
   !> tip, clamped and on a spring.
   subroutine test_viscous_wedge()
      type(structure_t) :: s
      type(galerkin_t), target :: galerkin
      type(equations_t), target :: equations
      type(modal_t) :: modal
      type(cvode_t) :: integrator
      type(response_t) :: summed, integrated
      type(work_t) :: work
      type(error_t), allocatable :: error
      type(variations_t) :: varied
      type(excitation_t) :: pulse
      real(wp), parameter :: rtol = 1e-11_wp
      real(wp) :: times(20)
      integer :: k

      varied = wedge()
      varied%known(known_c_D) = new_variation(as_spline, [0.0_wp, 0.3_wp, 0.7_wp, 1.0_wp], &
         [1.0_wp, 0.6_wp, 1.4_wp, 0.8_wp])
      times = [(0.3_wp*k, k=1, 20)]
      pulse = new_pulse(1.0_wp, 0.5_wp)
      s = structure_t(length=1, rho=1, E=1, I=1, c_D=2e-3_wp, gamma=0.1_wp, m_T=0.2_wp)
      do k = 1, 2
         if (k == 2) s%end(1)%kappa_R = 0.2_wp
         galerkin = new_galerkin(mesh_t(3, 6, 6, 1), 1.2_wp, held_root(k == 2), varied)
         equations = new_equations(galerkin, s, pulse)
         call modal%prepare(galerkin, error)
         call modal%respond(equations, pulse, times, summed, work, error)
         call check('viscous wedge, modal', .not. allocated(error))
         work = work_t()
         integrator = cvode_t(rtol=rtol, max_steps=1000000_ip)
         call integrator%respond(equations, pulse, times, integrated, work, error)
         call check('viscous wedge, cvode', .not. allocated(error))
         call check_close('viscous wedge', maxval(abs(summed%displacement &
            - integrated%displacement))/maxval(abs(integrated%displacement)), 0.0_wp, &
            accumulated_error(rtol, work%steps))
      end do
   end subroutine test_viscous_wedge

end program test_weight
