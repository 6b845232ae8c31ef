!> Exact responses with hoses of all kinds, from none at all to one that is welded to the tip, tuned
!> to a mode of the beam, or at a double root; and with tip masses of all sizes.
program test_modal_hoses
   use beamid_assembly, only: new_assembly
   use beamid_cvode, only: cvode_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_modes, only: bare_beam_modes, beam_modes_t, undamped_modes
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_responses, only: response_t
   use beamid_strings, only: to_text
   use beamid_structure, only: structure_t
   use checks, only: check, check_close, finish
   use single_responses, only: against_closed, attempt, compare, fresh, grid, &
      modal_sum, refused_clearly, relative, run, table_4_1
   implicit none

   call test_no_hose()
   call test_light_hose()
   call test_rigid_hose()
   call test_hoses()
   call test_tuned()
   call test_double_root()
   call test_masses()
   call finish('modal_hoses')

contains

   !> What hangs on nothing is not there: k_H = c_H = 0. And k_H, c_H without m_H.
   subroutine test_no_hose()
      type(structure_t) :: structure
      type(mesh_t), parameter :: mesh = mesh_t(3, 6, 4, 1)
      type(response_t) :: without, loose

      structure = table_4_1
      structure%hose(1)%m_H = 0
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, without, 'no hose')
      structure%hose(1)%k_H = 0
      structure%hose(1)%c_H = 0
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'no hose at all')
      call check_close('m_H = 0: k_H and c_H do nothing', maxval(abs(loose%acceleration &
         - without%acceleration)), 0.0_wp, 0.0_wp)
      structure%hose(1)%m_H = 0.04_wp
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'loose hose')
      ! The same sums but for a hose that contributes nothing.
      call check_close('k_H = c_H = 0: m_H does nothing, displacement', &
         relative(loose%displacement, without%displacement), 0.0_wp, 1e-13_wp)
      call check_close('k_H = c_H = 0: m_H does nothing, acceleration', &
         relative(loose%acceleration, without%acceleration), 0.0_wp, 1e-12_wp)
      ! Springs and dashpots that are as good as absent.
      structure%hose(1)%k_H = 1e-13_wp
      call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, loose, 'slack spring')
      call check_close('k_H = 1e-13', relative(loose%displacement, without%displacement), 0.0_wp, &
         1e-11_wp)
      structure%hose(1)%k_H = 0
      structure%hose(1)%c_H = 1e-13_wp
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
         if (damping == 0) structure%hose(1)%c_H = 0
         if (damping == 0) structure%c_D = 0
         structure%hose(1)%m_H = 0
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
            structure%hose(1)%m_H = mass
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
            structure%hose(1)%m_H = 10.0_wp**(-i)
            call compare('light hose, m_H = 1e-'//to_text(i), structure, mesh, &
               new_pulse(1.0_wp, 0.05_wp), grid(:21))
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
      welded%m_T = table_4_1%m_T + table_4_1%hose(1)%m_H
      welded%hose(1)%m_H = 0
      call run(fresh, welded, mesh, new_pulse(1.0_wp, 0.05_wp), grid, reference, 'welded')
      do i = 4, 14, 2
         factor = 10.0_wp**i
         structure = table_4_1
         structure%hose(1)%k_H = table_4_1%hose(1)%k_H*factor
         call run(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, stiff, 'stiff spring')
         ! m_H omega**2/k_H of mode 3, 360/factor, times its share of the displacement, .02.
         call check_close('k_H times 1e'//to_text(i)//': as tip mass', &
            relative(stiff%displacement, reference%displacement), 0.0_wp, 20/factor + 1e-12_wp)
         structure = table_4_1
         structure%hose(1)%c_H = table_4_1%hose(1)%c_H*factor
         structure%hose(1)%k_H = 0
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

      critical = 2*sqrt(table_4_1%hose(1)%k_H*table_4_1%hose(1)%m_H)
      do i = 1, size(ratios)
         structure = table_4_1
         structure%hose(1)%c_H = ratios(i)*critical
         call compare('c_H '//to_text(ratios(i))//' times critical', structure, mesh, &
            new_pulse(1.0_wp, 0.05_wp), grid(:61))
      end do
      structure = table_4_1
      structure%hose(1)%k_H = 0
      call compare('dashpot without a spring', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
         grid(:61))
      structure = table_4_1
      structure%m_T = 0
      call compare('no tip mass', structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid(:61))
      structure%c_D = 0
      structure%hose(1)%c_H = 0
      ! Nothing damps what BDF leaves behind, and without a tip mass the higher modes are ten times
      ! larger; test_modal has the closed form of such a structure.
      call compare('no tip mass, no damping', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
         grid(:61))
      structure = table_4_1
      structure%c_D = 500
      structure%m_T = 0
      structure%hose(1)%m_H = 0
      call compare('all modes of the beam overdamped', structure, mesh, new_pulse(1.0_wp, &
         0.05_wp), grid(:61))
      structure%m_T = 0.15_wp
      call compare('all modes overdamped, tip mass', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
         grid(:61))
      structure%hose(1)%m_H = 0.04_wp
      call compare('all modes overdamped, tip mass and hose', structure, mesh, &
         new_pulse(1.0_wp, 0.05_wp), grid(:61))
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
      type(response_t) :: exact
      real(wp), allocatable :: omega(:), shapes(:, :)
      real(wp) :: closed(3, size(grid))
      character(len=:), allocatable :: name
      integer :: tip, mode, i

      galerkin = new_galerkin(mesh, table_4_1%length)
      do tip = 0, 1
         structure = table_4_1
         structure%hose(1)%m_H = 0
         structure%hose(1)%c_H = 0
         if (tip == 0) structure%m_T = 0
         equations = new_equations(galerkin, structure, new_pulse(1.0_wp, 0.05_wp))
         call undamped_modes(equations, omega, shapes, error)
         do mode = 1, 2
            do i = 1, size(masses)
               name = 'tuned to mode '//to_text(mode)//merge(' of the bare beam     ', &
                  ' of beam and tip mass ', tip == 0)//'m_H = '//to_text(masses(i))
               structure%hose(1)%m_H = masses(i)
               structure%hose(1)%k_H = masses(i)*omega(mode)**2
               structure%hose(1)%c_H = 0
               structure%c_D = 0
               call attempt(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, exact, error)
               if (allocated(error)) then
                  call check(name//': a refusal that says why', refused_clearly(error), &
                     error%message)
               else
                  ! Two roots at a distance of sqrt(m_H/m) omega/2, of which the eigenvectors of the
                  ! reference lose digits: 1e-16 over 1e-6 for the lightest.
                  call modal_sum(name, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid, closed)
                  call check_close(name, relative(exact%displacement, closed(1, :)), 0.0_wp, &
                     1e-10_wp)
               end if
               ! s**2 + (c/m) s + k/m of the hose is that of the damped mode.
               structure%c_D = table_4_1%c_D
               structure%hose(1)%c_H = masses(i)*structure%c_D/structure%E*omega(mode)**2
               call attempt(fresh, structure, mesh, new_pulse(1.0_wp, 0.05_wp), grid(:41), &
                  exact, error)
               if (allocated(error)) then
                  call check(name//', damped: a refusal that says why', refused_clearly(error), &
                     error%message)
               else
                  call compare(name//', damped', structure, mesh, new_pulse(1.0_wp, 0.05_wp), &
                     grid(:41))
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

      call find_poles(new_assembly(structure, modes, [integer ::]), poles, error)
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
      below = sqrt(table_4_1%hose(1)%k_H*table_4_1%hose(1)%m_H)
      above = 4*below
      structure%hose(1)%c_H = below
      fewer = real_roots(structure, modes)
      structure%hose(1)%c_H = above
      call check('double root: bracketed', real_roots(structure, modes) == fewer + 2, &
         to_text(fewer))
      do i = 1, 60
         middle = (below + above)/2
         if (middle <= below .or. middle >= above) exit
         structure%hose(1)%c_H = middle
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
            structure%hose(1)%c_H = middle*(1 + side*10.0_wp**(-i)*merge(0, 1, i == 0))
            if (i == 0 .and. side == 1) cycle
            name = 'double root, c_H off by '//to_text(structure%hose(1)%c_H/middle - 1)
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
            structure%hose(1)%c_H = 0
            if (hose == 0) structure%hose(1)%m_H = 0
            structure%m_T = ratio*structure%rho*structure%length
            call against_closed('m_T '//to_text(ratio)//' times the beam'// &
               merge(',  no hose', ', and hose', hose == 0), structure, mesh, &
               new_pulse(1.0_wp, 0.05_wp))
         end do
         do i = -12, 6, 6
            structure = table_4_1
            if (hose == 0) structure%hose(1)%m_H = 0
            structure%m_T = 10.0_wp**i*structure%rho*structure%length
            call compare('m_T '//to_text(10.0_wp**i)//' times the beam, damped'// &
               merge(',  no hose', ', and hose', hose == 0), structure, mesh, &
               new_pulse(1.0_wp, 0.05_wp), grid(:41))
         end do
      end do
   end subroutine test_masses

end program test_modal_hoses
