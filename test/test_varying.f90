!> Beams that vary along their length: frequencies of tapered and stepped ones against exact values,
!> how fast they converge with knots where something jumps and without them, weight, statics.
program test_varying
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse, new_release
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_identification, only: model_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: undamped_modes
   use beamid_roots, only: damped_roots
   use beamid_simulation, only: simulate, simulation_t
   use beamid_strings, only: to_text
   use beamid_structure, only: end_t, free_end, E_at, of_d_D, of_w_D, of_x_D, structure_t
   use beamid_variations, only: as_spline, field_modulus, in_lines, in_steps, known_c_D, &
      known_E, known_height, known_rho, known_width, new_variation, variations_t
   use checks, only: check, check_close, finish, of_mesh
   use static_checks, only: check_statics
   use stepped_beams, only: stepped_frequencies
   implicit none

   call test_tapers()
   call test_steps()
   call test_kink()
   call test_weight_of_steps()
   call test_wedge_statics()
   call test_statics()
   call test_release()
   call finish('varying')

contains

   !> The lowest undamped frequencies of a clamped beam of length, E I and mass one at the root.
   !>
   !> structure  left out: that beam
   function frequencies(varied, mesh, wanted, structure) result(omega)
      type(variations_t), intent(in) :: varied
      type(mesh_t), intent(in) :: mesh
      integer, intent(in) :: wanted
      type(structure_t), intent(in), optional :: structure
      real(wp) :: omega(wanted)
      type(galerkin_t), target :: galerkin

      galerkin = new_galerkin(mesh, 1.0_wp, variations=varied)
      omega = frequencies_of(galerkin, wanted, structure)
   end function frequencies

   function frequencies_of(galerkin, wanted, structure) result(omega)
      type(galerkin_t), intent(in), target :: galerkin
      integer, intent(in) :: wanted
      type(structure_t), intent(in), optional :: structure
      real(wp) :: omega(wanted)
      type(structure_t) :: s
      type(equations_t) :: equations
      real(wp), allocatable :: all_of_them(:), shapes(:, :)
      type(error_t), allocatable :: error

      s = structure_t(length=1, rho=1, E=1, I=1)
      if (present(structure)) s = structure
      equations = new_equations(galerkin, s, new_pulse(1.0_wp, 1.0_wp))
      call undamped_modes(equations, all_of_them, shapes, error)
      call check('frequencies', .not. allocated(error))
      omega = 0
      if (.not. allocated(error)) omega = all_of_them(:wanted)
   end function frequencies_of

   !> Depth linear, and width too, to a share of those at the root.
   type(variations_t) function taper(share, double) result(varied)
      real(wp), intent(in) :: share
      logical, intent(in) :: double

      varied%known(known_height) = new_variation(in_lines, [0.0_wp, 1.0_wp], [1.0_wp, share])
      if (double) varied%known(known_width) = varied%known(known_height)
      varied%by_density = .true.
   end function taper

   !> Clamped wedges and pyramids, frequencies in units of the root section to twelve digits (those
   !> of c = .2 to ten or nine): modes, and roots of the modal solver. Quintics err by h**8, nothing
   !> here; Rayleigh's quotient leaves some units of round-off times N**2: 1e-9, or half a digit of
   !> the last.
   subroutine test_tapers()
      real(wp), parameter :: shares(5) = [0.8_wp, 0.8_wp, 0.5_wp, 0.5_wp, 0.2_wp]
      logical, parameter :: doubles(5) = [.false., .true., .false., .true., .false.]
      real(wp), parameter :: known(3, 5) = reshape([ &
         3.60827487346_wp, 20.62101759145_wp, 56.19227836908_wp, &
         3.855116795037_wp, 21.05674542956_wp, 56.6303450616_wp, &
         3.82378484729_wp, 18.31726090417_wp, 47.26482701048_wp, &
         4.625150252432_wp, 19.54761318052_wp, 48.57889933386_wp, &
         4.29249453924_wp, 15.74270017_wp, 36.88455326_wp], [3, 5])
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      complex(wp), allocatable :: roots(:)
      type(error_t), allocatable :: error
      real(wp) :: omega(3), unit, allowed
      integer :: j, k

      ! Neither 1 nor alike, so that a forgotten power shows.
      unit = 4*sqrt(3/35.0_wp)
      do j = 1, size(shares)
         galerkin = new_galerkin(mesh_t(5, 48, 8, 1), 2.0_wp, variations=taper(shares(j), &
            doubles(j)))
         omega = frequencies_of(galerkin, 3, structure_t(length=2, rho=3, E=5, I=7))
         equations = new_equations(galerkin, structure_t(length=2, rho=3, E=5, I=7), &
            new_pulse(1.0_wp, 1.0_wp))
         call damped_roots(equations, roots, error)
         call check('taper: roots', .not. allocated(error))
         if (allocated(error)) cycle
         do k = 1, 3
            allowed = merge(1e-8_wp, 1e-9_wp, j == 5 .and. k > 1)
            call check_close('taper to '//to_text(shares(j))//', mode '//to_text(k), &
               omega(k)*unit/known(k, j), 1.0_wp, allowed)
            call check_close('taper to '//to_text(shares(j))//', root '//to_text(k), &
               abs(roots(k))*unit/known(k, j), 1.0_wp, allowed)
         end do
      end do
   end subroutine test_tapers

   !> Stiffness and mass that jump: on a knot of the mesh, in the middle of an element, and .02 of
   !> an element beside a knot. w errs like h**2 (cubics) and h**4 (quintics) in the energy, a
   !> frequency like the square of that, down to what round-off leaves. Without knots at the jump
   !> w'' cannot jump: h**1/2 and h.
   subroutine test_steps()
      character(len=*), parameter :: names(3) = [character(len=13) :: 'E jumps', 'rho jumps', &
         'E and rho do']
      real(wp), parameter :: beside(3) = [0.0_wp, 0.5_wp, 0.02_wp], &
         E(3) = [0.3_wp, 1.0_wp, 3.0_wp], rho(3) = [1.0_wp, 0.4_wp, 0.4_wp]
      !> Coarse and fine mesh by degree: between these the third frequency is neither rough nor
      !> known to round-off.
      integer, parameter :: degrees(2) = [3, 5], meshes(2, 2) = reshape([16, 32, 6, 12], [2, 2])
      real(wp) :: off(3, 2), plain(3, 2), x, exact(3), order
      type(variations_t) :: varied
      type(mesh_t) :: mesh
      integer :: b, i, j, p

      do j = 1, 3
         do b = 1, 3
            do p = 1, 2
               do i = 1, 2
                  mesh = mesh_t(degrees(p), meshes(i, p), degrees(p) + 1, 1)
                  x = (mesh%elements/2 + beside(b))/mesh%elements
                  exact = stepped_frequencies([x, 1.0_wp], [1.0_wp, E(j)], [1.0_wp, rho(j)], 3)
                  varied = variations_t()
                  if (abs(E(j) - 1) > 0) varied%known(known_E) = &
                     new_variation(in_steps, [0.0_wp, x, 1.0_wp], [1.0_wp, E(j), E(j)])
                  if (abs(rho(j) - 1) > 0) varied%known(known_rho) = &
                     new_variation(in_steps, [0.0_wp, x, 1.0_wp], [1.0_wp, rho(j), rho(j)])
                  off(:, i) = abs(frequencies(varied, mesh, 3)/exact - 1)
                  if (abs(E(j) - 1) > 0 .and. p == 1) plain(:, i) = abs(without_knots(varied, x, &
                     mesh)/exact - 1)
               end do
               associate (name => trim(names(j))//', '//to_text(beside(b))//' beside a knot, '// &
                  of_mesh(degrees(p), meshes(2, p)))
                  do i = 1, 3
                     order = log(off(i, 1)/off(i, 2))/log(2.0_wp)
                     ! Twice the order of w in the energy, less what the coarser mesh still lacks.
                     call check(name//'mode '//to_text(i), order >= merge(3.8_wp, 7.2_wp, p == 1) &
                        .or. off(i, 2) <= 3e-12_wp, 'order '//to_text(order)//', off '// &
                        to_text(off(i, 2)))
                  end do
                  if (abs(E(j) - 1) > 0 .and. b == 2 .and. p == 1) then
                     order = log(plain(3, 1)/plain(3, 2))/log(2.0_wp)
                     call check(name//'without knots it converges slowly', order < 1.5_wp .and. &
                        plain(3, 2) > 100*off(3, 2), 'order '//to_text(order)//', off '// &
                        to_text(plain(3, 2)))
                  end if
               end associate
            end do
         end do
      end do
   end subroutine test_steps

   !> The same integrals, in parts up to the jump, over cubics of the uniform mesh: mass that jumps,
   !> by nothing or not, asks for the parts, and for no knots of these.
   function without_knots(varied, x, mesh) result(omega)
      type(variations_t), intent(in) :: varied
      real(wp), intent(in) :: x
      type(mesh_t), intent(in) :: mesh
      real(wp) :: omega(3)
      type(galerkin_t), target :: galerkin
      type(variations_t) :: split
      integer :: q

      split%known(known_rho) = varied%known(known_rho)
      if (split%known(known_rho)%kind /= in_steps) split%known(known_rho) = &
         new_variation(in_steps, [0.0_wp, x, 1.0_wp], [1.0_wp, 1.0_wp, 1.0_wp])
      galerkin = new_galerkin(mesh, 1.0_wp, variations=split)
      do q = 1, size(galerkin%bent)
         galerkin%known(q, 1) = varied%known(known_E)%at(galerkin%bent(q)%xi)
      end do
      galerkin%bending = galerkin%bending_band(galerkin%known(:, 1))
      omega = frequencies_of(galerkin, 3)
   end function without_knots

   !> A kink of the stiffness at a third of the beam, never on a mesh that halves: against quintics
   !> on a mesh ten times as fine, which err by 1e-12.
   subroutine test_kink()
      integer, parameter :: degrees(2) = [3, 5], meshes(2, 2) = reshape([16, 32, 8, 16], [2, 2])
      type(variations_t) :: varied
      real(wp) :: exact(3), off(3, 2), order
      integer :: i, p

      varied%known(known_E) = &
         new_variation(in_lines, [0.0_wp, 1/3.0_wp, 1.0_wp], [1.0_wp, 0.6_wp, 1.1_wp])
      exact = frequencies(varied, mesh_t(5, 64, 6, 1), 3)
      do p = 1, 2
         do i = 1, 2
            off(:, i) = abs(frequencies(varied, mesh_t(degrees(p), meshes(i, p), degrees(p) + 1, &
               1), 3)/exact - 1)
         end do
         do i = 1, 3
            order = log(off(i, 1)/off(i, 2))/log(2.0_wp)
            call check('a kink, '//of_mesh(degrees(p), meshes(2, p))//'mode '//to_text(i), &
               order >= merge(3.8_wp, 7.2_wp, p == 1) .or. off(i, 2) <= 3e-12_wp, &
               'order '//to_text(order)//', off '//to_text(off(i, 2)))
         end do
      end do
   end subroutine test_kink

   !> The weight of a beam whose mass jumps: below the jump more of it hangs. It bends w'' by the
   !> integral of what hangs, which has a kink there, so cubics keep their order without a knot.
   subroutine test_weight_of_steps()
      type(structure_t) :: s
      type(variations_t) :: varied
      real(wp) :: exact(3), off(3, 2), order, without(3)
      integer :: i

      s = structure_t(length=1, rho=1, E=1, I=1, g=20)
      varied%known(known_rho) = &
         new_variation(in_steps, [0.0_wp, 1/3.0_wp, 1.0_wp], [1.0_wp, 4.0_wp, 4.0_wp])
      exact = frequencies(varied, mesh_t(7, 30, 8, 1), 3, s)
      do i = 1, 2
         off(:, i) = abs(frequencies(varied, mesh_t(3, 16*i, 4, 1), 3, s)/exact - 1)
      end do
      s%g = 0
      without = frequencies(varied, mesh_t(7, 30, 8, 1), 3, s)
      call check('weight counts', exact(1) > 1.5_wp*without(1), to_text(exact(1)/without(1)))
      do i = 1, 3
         order = log(off(i, 1)/off(i, 2))/log(2.0_wp)
         call check('weight of a beam with a jump, mode '//to_text(i), order >= 3.8_wp, 'order '// &
            to_text(order)//', off '//to_text(off(i, 2)))
      end do
   end subroutine test_weight_of_steps

   !> The tip of a wedge: l**3/(E I) times the integral of (1 - xi)**2/(1 - k xi)**3, k = 1 - c. By
   !> Gauss points that know it to round-off.
   subroutine test_wedge_statics()
      real(wp), parameter :: c = 0.5_wp
      type(structure_t) :: s
      real(wp) :: deflection

      s = structure_t(length=1.5_wp, rho=1, E=5, I=0.7_wp)
      s%variations = taper(c, .false.)
      deflection = s%length**3/(s%E*s%I)*(2*c - c**2/2 - 1.5_wp - log(c))/(1 - c)**3
      call check_close('wedge: stiffness', s%stiffness()*deflection, 1.0_wp, 1e-13_wp)
      call check_close('wedge: deflection', s%static_deflection(s%length)/deflection, 1.0_wp, &
         1e-13_wp)
      call check_close('wedge: of the tip', s%tip_stiffness()*deflection, 1.0_wp, 1e-13_wp)
   end subroutine test_wedge_statics

   !> Beams that vary in every way.
   !>
   !> kind  1: known; 2: with a dip besides; 3 and 4: by coefficients, cubic or linear
   function varied_beam(kind) result(s)
      integer, intent(in) :: kind
      type(structure_t) :: s
      integer :: j

      s = structure_t(length=1.3_wp, rho=1, E=2, I=1, c_D=1e-2_wp, m_T=0.1_wp, &
         end=[end_t(kappa_R=0.1_wp), free_end], x_F=0.975_wp)
      s%supports = 1
      s%support(1)%x_P = 0.325_wp
      s%support(1)%kappa_P = 0.02_wp
      associate (v => s%variations)
         v%known(known_height) = &
            new_variation(in_lines, [0.0_wp, 0.4_wp, 1.0_wp], [1.0_wp, 0.9_wp, 0.5_wp])
         v%known(known_width) = &
            new_variation(as_spline, [0.0_wp, 0.3_wp, 0.6_wp, 1.0_wp], [1.0_wp, 1.3_wp, &
            0.8_wp, 0.9_wp])
         v%by_density = .true.
         ! Under force and support w''' jumps: knots for that.
         v%known(known_c_D) = &
            new_variation(in_lines, [0.0_wp, 0.25_wp, 0.75_wp, 1.0_wp], spread(1.0_wp, 1, 4))
         if (kind <= 2) v%known(known_E) = &
            new_variation(in_steps, [0.0_wp, 0.55_wp], [1.0_wp, 0.7_wp])
         v%along(field_modulus)%coefficients = merge(6, 0, kind > 2)
         v%along(field_modulus)%degree = merge(3, 1, kind == 3)
      end associate
      if (kind == 2) then
         call s%set(of_x_D, 0.6_wp)
         call s%set(of_w_D, 0.08_wp)
         call s%set(of_d_D, 0.4_wp)
      end if
      do j = 1, s%variations%along(field_modulus)%coefficients
         call s%set(E_at(j), 2 + 0.7_wp*sin(1.3_wp*j))
      end do
   end function varied_beam

   !> Quintics err by h**8 here and h**6 elsewhere, 1e-10, and by some N**4 units of round-off,
   !> 2e-9.
   subroutine test_statics()
      integer :: kind

      do kind = 1, 4
         call check_statics('statics '//to_text(kind), varied_beam(kind), mesh_t(5, 52, 8, 1), &
            5e-9_wp)
      end do
   end subroutine test_statics

   !> A wedge whose tip is held aside: there until the release, and from there on, as the splines
   !> have it, h**8; with a dip too.
   subroutine test_release()
      type(model_t) :: model
      type(simulation_t) :: simulation
      type(error_t), allocatable :: error
      integer :: k

      do k = 1, 2
         model%structure = structure_t(length=1.5_wp, rho=1, E=5, I=0.7_wp, c_D=0.5_wp)
         model%structure%variations = taper(0.5_wp, .false.)
         if (k == 2) then
            call model%structure%set(of_x_D, 0.7_wp)
            call model%structure%set(of_w_D, 0.3_wp)
            call model%structure%set(of_d_D, 0.4_wp)
         end if
         model%excitation = new_release(0.01_wp, 0.1_wp, .true.)
         if (.not. allocated(model%solver)) allocate (modal_t :: model%solver)
         call simulate(model, mesh_t(5, 24, 8, 1), [0.05_wp, 0.1_wp + 1e-9_wp, 200.0_wp], &
            simulation, error)
         call check('release: a response', .not. allocated(error))
         if (allocated(error)) cycle
         call check_close('release: before', simulation%response%displacement(1)/0.01_wp, 1.0_wp, &
            1e-9_wp)
         ! In 1e-9 of a time unit it moves by the square of that.
         call check_close('release: at it', simulation%response%displacement(2)/0.01_wp, 1.0_wp, &
            1e-9_wp)
         call check_close('release: in the end', simulation%response%displacement(3)/0.01_wp, &
            0.0_wp, 1e-9_wp)
      end do
   end subroutine test_release

end program test_varying
