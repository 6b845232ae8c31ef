!> Roots that come together: a tuned damper at its double root, modes at critical damping, groups of
!> three and four. Response, derivatives, the field and the columns of a free decay against
!> exponentials of the whole system in quadruple precision, which know of no roots; fits through a
!> double root; and what is said of an overdamped structure's modes.
program test_clusters
   use beamid_assembly, only: new_assembly
   use beamid_beam_motions, only: beam_motion_t, find_motion
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_free, new_pulse
   use beamid_experiments, only: experiment_t
   use beamid_fitted_modes, only: fitted_mode_t, fitted_modes
   use beamid_free_motion, only: free_mode_t
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_identification, only: identify, stage_fit_t, stage_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t, undamped_modes
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_projection, only: new_projection, projection_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: hose_t, of_c_D, of_c_H, of_E, of_gamma, of_k_H, of_m_H, &
      of_rho, of_x_S, &
      sensor_t, structure_t
   use checks, only: check, check_close, finish
   use full_matrices, only: full_t, new_full, qp
   use models, only: model_of, stage_of
   implicit none

   !> k_H and c_H of the double root on four cubics, from the determinant of s**2 M + s C + K and
   !> its derivative in quadruple precision; the strip itself: 30 x 1.5 mm of steel.
   type(structure_t), parameter :: tuned = structure_t(length=0.4_wp, rho=0.353_wp, E=2e11_wp, &
      I=0.03_wp*0.0015_wp**3/12, c_D=4e6_wp, gamma=0.1_wp, hose=hose_t(m_H=0.02_wp, &
      k_H=17.379942901774794_wp, c_H=0.67062974701630444_wp), sensor=sensor_t(m_S=0.012_wp, &
      x_S=0.35_wp))
   complex(wp), parameter :: double_root = (-12.311832069_wp, 33.571167234_wp)
   type(structure_t), parameter :: plain = structure_t(length=1, rho=1, E=1, I=1)
   type(mesh_t), parameter :: mesh = mesh_t(3, 4, 4, 1)
   !> Of all beams here the first mode has a period of .19 s or more.
   real(wp), parameter :: step = 1/64.0_wp
   integer, parameter :: samples = 48
   !> Round-off leaves 5e-15 and 2e-12; roots that are only just left alone lose up to 1e-12 of a
   !> response and 1e-9 of a derivative.
   real(wp), parameter :: allowed = 5e-12_wp, allowed_of_derivatives = 5e-9_wp

   type(galerkin_t), target :: galerkin
   type(modal_t) :: solver

   call test_tuned_damper()
   call test_critical_damping()
   call test_groups()
   call test_ordinary()
   call test_field()
   call test_free_columns()
   call test_roots_alone()
   call test_drift()
   call test_fits()
   call test_fitted_modes()
   call finish('clusters')

contains

   !> Mesh and solver for a structure.
   subroutine prepare(structure)
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable :: error

      galerkin = new_galerkin(mesh, structure%length)
      call solver%prepare(galerkin, error)
      call check('a mesh', .not. allocated(error))
   end subroutine prepare

   !> A pulse of four steps, and its samples.
   subroutine pulse(excitation, force)
      type(excitation_t), intent(out) :: excitation
      real(wp), allocatable, intent(out) :: force(:)

      excitation = new_pulse(1.0_wp, 4*step)
      force = spread(1.0_wp, 1, 5)
   end subroutine pulse

   !> A force that bends at every step of the first eight and jumps at both ends.
   subroutine table(excitation, force)
      type(excitation_t), intent(out) :: excitation
      real(wp), allocatable, intent(out) :: force(:)
      type(error_t), allocatable :: error
      integer :: k

      force = [(cos(real(k, wp)), k=0, 8)]
      call new_force_table([(k*step, k=0, 8)], force, excitation, error)
   end subroutine table

   !> Motion and derivatives against the exponentials, in the 2-norm over the samples; of a
   !> derivative relative to itself, or to the motion over the parameter where the motion hardly
   !> depends on it.
   subroutine compare(name, structure, parameters, excitation, force)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: parameters(:)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: force(:)
      type(equations_t), target :: equations
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      type(full_t) :: full
      real(qp), dimension(samples, 3) :: exact, above, below
      real(wp) :: found(samples, 3), wrong, worst, size_of
      integer :: k, m, p

      equations = new_equations(galerkin, structure, excitation)
      call solver%differentiate(equations, excitation, [(k*step, k=1, samples)], parameters, &
         response, slopes, work, error)
      if (allocated(error)) then
         call check(name//': a response', .false., error%message)
         return
      end if
      full = new_full(galerkin, structure, excitation)
      call full%motions(real(step, qp), force, exact)
      found = reshape([response%displacement, response%velocity, response%acceleration], &
         [samples, 3])
      worst = 0
      do m = 1, 3
         wrong = real(norm2(found(:, m) - exact(:, m))/norm2(exact(:, m)), wp)
         if (.not. wrong <= worst) worst = wrong
      end do
      call check_close(name//', motion', worst, 0.0_wp, allowed)
      worst = 0
      do p = 1, size(parameters)
         associate (q => full%q(parameters(p)), value => real(structure%get(parameters(p)), qp))
            ! The differences leave 1e-20 of what is differentiated.
            q = value*(1 + 1e-10_qp)
            call full%assemble()
            call full%motions(real(step, qp), force, above)
            q = value*(1 - 1e-10_qp)
            call full%assemble()
            call full%motions(real(step, qp), force, below)
            above = (above - below)/(2e-10_qp*value)
            q = value
            found = reshape([slopes(p)%displacement, slopes(p)%velocity, &
                             slopes(p)%acceleration], [samples, 3])
            do m = 1, 3
               size_of = real(max(norm2(above(:, m)), norm2(exact(:, m))/value), wp)
               wrong = real(norm2(found(:, m) - above(:, m)), wp)/size_of
               if (.not. wrong <= worst) worst = wrong
            end do
         end associate
      end do
      if (size(parameters) > 0) call check_close(name//', derivatives', worst, 0.0_wp, &
         allowed_of_derivatives)
   end subroutine compare

   !> At the double root and at relative distances from it, by the spring and by the dashpot.
   subroutine test_tuned_damper()
      real(wp), parameter :: distances(9) = [0.0_wp, 1e-12_wp, 1e-9_wp, 1e-6_wp, 1e-4_wp, 1e-3_wp, &
         3e-3_wp, 1e-2_wp, 1e-1_wp]
      integer, parameter :: parameters(7) = [of_E, of_c_D, of_m_H, of_c_H, of_k_H, of_rho, of_x_S]
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      real(wp), allocatable :: force(:)
      integer :: k

      call prepare(tuned)
      do k = 1, size(distances)
         structure = tuned
         structure%hose(1)%k_H = tuned%hose(1)%k_H*(1 + distances(k))
         call pulse(excitation, force)
         call compare('tuned damper, k_H off by '//to_text(distances(k)), structure, parameters, &
            excitation, force)
         structure = tuned
         structure%hose(1)%c_H = tuned%hose(1)%c_H*(1 - distances(k))
         call table(excitation, force)
         call compare('tuned damper, c_H off by '//to_text(distances(k)), structure, &
            parameters(:merge(7, 0, modulo(k, 3) == 0)), excitation, force)
      end do
   end subroutine test_tuned_damper

   !> A beam with one of its modes at critical damping, c_D omega = 2 E, alone and with masses on
   !> it.
   subroutine test_critical_damping()
      real(wp), parameter :: distances(6) = [0.0_wp, 1e-15_wp, 1e-12_wp, -1e-9_wp, 1e-6_wp, &
         -1e-4_wp]
      type(structure_t) :: structure
      type(equations_t) :: equations
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error
      real(wp), allocatable :: force(:), omega(:), shapes(:, :)
      integer :: k, mode, loaded

      call prepare(plain)
      call table(excitation, force)
      do loaded = 0, 1
         structure = plain
         if (loaded == 1) structure = structure_t(length=1, rho=1, E=1, I=1, m_T=0.3_wp, &
            J_T=0.01_wp, sensor=sensor_t(m_S=0.1_wp, x_S=0.6_wp))
         equations = new_equations(galerkin, structure, excitation)
         call undamped_modes(equations, omega, shapes, error)
         do mode = 1, 3
            do k = 1, size(distances)
               structure%c_D = 2*structure%E/omega(mode)*(1 + distances(k))
               call compare('mode '//to_text(mode)//merge(' with masses', '            ', &
                  loaded == 1)//' off critical by '//to_text(distances(k)), structure, &
                  [of_E, of_c_D, of_rho], excitation, force)
            end do
         end do
      end do
   end subroutine test_critical_damping

   !> Mode 1 at critical damping and a hose that by itself has the same double root, or one root
   !> there: the lighter, the nearer four and three real roots come to one another.
   subroutine test_groups()
      type(structure_t) :: structure
      type(equations_t) :: equations
      type(excitation_t) :: excitation
      type(beam_modes_t) :: modes
      type(error_t), allocatable :: error
      real(wp), allocatable :: force(:), omega(:), shapes(:, :)
      integer, parameter :: parameters(5) = [of_E, of_c_D, of_m_H, of_c_H, of_k_H]
      integer :: k

      structure = plain
      call prepare(structure)
      call pulse(excitation, force)
      equations = new_equations(galerkin, structure, excitation)
      call undamped_modes(equations, omega, shapes, error)
      structure%c_D = 2*structure%E/omega(1)
      do k = 3, 12, 3
         structure%hose(1)%m_H = 10.0_wp**(-k)
         structure%hose(1)%k_H = structure%hose(1)%m_H*omega(1)**2
         structure%hose(1)%c_H = 2*structure%hose(1)%m_H*omega(1)
         call compare('four real roots, m_H = '//to_text(structure%hose(1)%m_H), structure, &
            parameters, &
            excitation, force)
         if (k > 3) call check_clusters('four real roots, m_H = '//to_text(structure%hose(1)%m_H), &
            structure, [4])
         structure%hose(1)%k_H = 1.5_wp*structure%hose(1)%m_H*omega(1)**2
         structure%hose(1)%c_H = 2.5_wp*structure%hose(1)%m_H*omega(1)
         call compare('three real roots, m_H = '//to_text(structure%hose(1)%m_H), structure, &
            parameters, &
            excitation, force)
         if (k > 3) call check_clusters('three real roots, m_H = '// &
            to_text(structure%hose(1)%m_H), &
            structure, [3])
      end do
      ! One of these may have a discriminant of exactly zero, which starts two roots from one
      ! point; which one, hangs on the BLAS that made mu.
      structure%hose(1)%m_H = 1e-6_wp
      structure%hose(1)%k_H = structure%hose(1)%m_H*omega(1)**2
      structure%hose(1)%c_H = 2*structure%hose(1)%m_H*omega(1)
      call bare_beam_modes(galerkin, modes, error)
      structure%c_D = 2/sqrt(modes%mu(1))*(1 - 4*epsilon(1.0_wp))
      do k = -3, 3
         structure%c_D = nearest(structure%c_D, 1.0_wp)
         call check_clusters('four real roots, c_D + '//to_text(k)//' last digits', structure, [4])
      end do
   end subroutine test_groups

   !> How many roots are taken together.
   subroutine check_clusters(name, structure, expected)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: expected(:)
      type(beam_modes_t) :: modes
      type(poles_t) :: poles
      type(error_t), allocatable :: error

      call bare_beam_modes(galerkin, modes, error)
      call find_poles(new_assembly(structure, modes, [integer ::]), poles, error)
      call check(name//': poles', .not. allocated(error))
      if (allocated(error)) return
      call check(name//': roots taken together', size(poles%cluster) == size(expected), &
         to_text(size(poles%cluster))//' groups')
      if (size(poles%cluster) /= size(expected)) return
      call check(name//': as many as expected', all(poles%cluster%m == expected))
      ! The contour counts them to round-off.
      if (size(expected) > 0) call check_close(name//': counted', &
         abs(poles%cluster(1)%counted - expected(1)), 0.0_wp, 1e-10_wp)
   end subroutine check_clusters

   !> Roots that stand by themselves are left alone; the slow roots of overdamped modes, which crowd
   !> near -E/c_D, among them.
   subroutine test_ordinary()
      type(structure_t) :: structure

      call prepare(tuned)
      call check_clusters('tuned damper', tuned, [2])
      structure = tuned
      structure%hose(1)%k_H = 2*tuned%hose(1)%k_H
      call check_clusters('damper out of tune', structure, [integer ::])
      structure = plain
      structure%m_T = 1
      call prepare(structure)
      call check_clusters('no damping', structure, [integer ::])
      structure%c_D = 100
      call check_clusters('overdamped', structure, [integer ::])
   end subroutine test_ordinary

   !> All unknowns of the tuned damper at its double root.
   subroutine test_field()
      type(equations_t), target :: equations
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error
      type(beam_motion_t) :: field
      type(full_t) :: full
      real(wp), allocatable :: force(:)
      real(qp) :: exact(samples, 3)
      real(wp) :: worst, wrong
      integer :: k, i, m

      call prepare(tuned)
      call table(excitation, force)
      equations = new_equations(galerkin, tuned, excitation)
      call find_motion(equations, excitation, [(k*step, k=1, samples)], field, error)
      call check('field: found', .not. allocated(error))
      if (allocated(error)) return
      full = new_full(galerkin, tuned, excitation)
      worst = 0
      do i = 1, equations%n
         full%o = 0
         full%o(i) = 1
         call full%motions(real(step, qp), force, exact)
         do m = 1, 3
            wrong = real(norm2(field%w(:, i, m - 1) - exact(:, m))/norm2(exact(:, m)), wp)
            if (.not. wrong <= worst) worst = wrong
         end do
      end do
      call check_close('field: every unknown of '//to_text(equations%n), worst, 0.0_wp, allowed)
   end subroutine test_field

   !> The columns of all modes hold the free motion; their span has the derivatives that differences
   !> say. At the double root; near it; and with the highest mode at critical damping, a little
   !> below, and a little above, where it no longer oscillates.
   subroutine test_free_columns()
      type(structure_t) :: structure
      type(equations_t) :: equations
      type(error_t), allocatable :: error
      real(wp), allocatable :: omega(:), shapes(:, :)
      integer :: k

      do k = 0, 8, 4
         structure = tuned
         structure%hose(1)%k_H = tuned%hose(1)%k_H*(1 + merge(10.0_wp**(-k), 0.0_wp, k > 0))
         call check_columns('tuned damper off by 1e-'//to_text(k), structure, 6, &
            [of_E, of_c_H, of_k_H])
      end do
      structure = plain
      call prepare(structure)
      equations = new_equations(galerkin, structure, new_free(1))
      call undamped_modes(equations, omega, shapes, error)
      do k = -1, 1
         structure%c_D = 2*structure%E/omega(size(omega))*(1 + k*1e-4_wp)
         call check_columns('mode '//to_text(size(omega))//' off critical by '//to_text(k)// &
            'e-4', structure, size(omega), [of_E, of_c_D])
      end do
   end subroutine test_free_columns

   subroutine check_columns(name, structure, modes, parameters)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: modes, parameters(:)
      real(wp), dimension(samples - 5) :: y, motion, above, below
      real(wp) :: step_of, c(2*modes), slope(samples - 5, 1)
      real(wp), allocatable :: phi(:, :), dphi(:, :, :), force(:)
      real(qp) :: exact(samples, 3)
      type(projection_t) :: projection
      type(structure_t) :: moved
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error
      type(full_t) :: full
      integer :: k, p

      call prepare(structure)
      call pulse(excitation, force)
      full = new_full(galerkin, structure, excitation)
      call full%motions(real(step, qp), force, exact)
      motion = real(exact(6:, 3), wp)
      call columns(structure, modes, parameters, phi, dphi)
      call new_projection(phi, projection, error)
      call check(name//': columns', .not. allocated(error))
      if (allocated(error)) return
      y = motion
      call projection%coefficients(y, c)
      ! Modes that have died leave columns that hardly differ: their condition costs some digits.
      call check_close(name//': the columns hold the motion', norm2(y)/norm2(motion), 0.0_wp, &
         1e-10_wp)
      ! A vector that they do not hold, and what is left of it as the parameters move.
      do p = 1, size(parameters)
         motion = [(sin(7.0_wp*k), k=1, size(motion))]
         y = motion
         call projection%coefficients(y, c)
         slope(:, 1) = matmul(dphi(:, :, p), c)
         call projection%derivatives(reshape(matmul(y, dphi(:, :, p)), [size(c), 1]), slope)
         step_of = 1e-5_wp*structure%get(parameters(p))
         moved = structure
         call moved%set(parameters(p), structure%get(parameters(p)) + step_of)
         above = rest_of(moved, modes, motion)
         call moved%set(parameters(p), structure%get(parameters(p)) - step_of)
         below = rest_of(moved, modes, motion)
         above = (above - below)/(2*step_of)
         ! Central differences over 1e-5: round-off of 1e-14 or so over 1e-5, and the third
         ! derivative times 1e-10.
         call check_close(name//': derivative by parameter '//to_text(parameters(p)), &
            norm2(slope(:, 1) - above)/norm2(above), 0.0_wp, 1e-5_wp)
      end do
   end subroutine check_columns

   !> What the columns leave of a vector.
   function rest_of(structure, modes, vector) result(rest)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: modes
      real(wp), intent(in) :: vector(:)
      real(wp) :: rest(size(vector)), c(2*modes)
      real(wp), allocatable :: phi(:, :), dphi(:, :, :)
      type(projection_t) :: projection
      type(error_t), allocatable :: error

      call columns(structure, modes, [integer ::], phi, dphi)
      call new_projection(phi, projection, error)
      rest = vector
      if (.not. allocated(error)) call projection%coefficients(rest, c)
   end function rest_of

   !> Accelerations of the modes from the sixth sample on, and their derivatives.
   subroutine columns(structure, wanted, parameters, phi, dphi)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: wanted, parameters(:)
      real(wp), allocatable, intent(out) :: phi(:, :), dphi(:, :, :)
      type(equations_t), target :: equations
      type(free_mode_t), allocatable :: modes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      complex(wp), allocatable :: states(:, :)
      complex(wp) :: motion(samples - 5)
      integer :: k, p

      allocate (phi(samples - 5, 2*wanted), source=0.0_wp)
      allocate (dphi(samples - 5, 2*wanted, size(parameters)), source=0.0_wp)
      equations = new_equations(galerkin, structure, new_free(wanted))
      call solver%free_modes(equations, parameters, wanted, modes, work, error)
      if (allocated(error)) return
      do k = 1, wanted
         states = modes(k)%states([((p - 1)*step, p=1, samples - 5)])
         motion = matmul(states, modes(k)%row(:, 3))
         phi(:, 2*k - 1) = real(motion)
         phi(:, 2*k) = -aimag(motion)
         do p = 1, size(parameters)
            motion = matmul(states, modes(k)%drow(:, 3, p))
            dphi(:, 2*k - 1, p) = real(motion)
            dphi(:, 2*k, p) = -aimag(motion)
         end do
      end do
   end subroutine columns

   !> Roots alone, once derivatives of others were asked for.
   subroutine test_roots_alone()
      type(equations_t) :: equations
      type(free_mode_t), allocatable :: modes(:)
      type(work_t) :: work
      type(error_t), allocatable :: error
      complex(wp) :: s(4), ds(4, 0)

      call prepare(tuned)
      equations = new_equations(galerkin, tuned, new_free(4))
      call solver%free_modes(equations, [of_gamma], 4, modes, work, error)
      call check('roots with derivatives', .not. allocated(error))
      call solver%free_motion(equations, [integer ::], s, ds, work, error)
      call check('roots alone', .not. allocated(error))
      if (allocated(error)) return
      call check_close('roots alone: the same', maxval(abs(s - modes%s)), 0.0_wp, 0.0_wp)
   end subroutine test_roots_alone

   !> A hose that only its dashpot holds has a root at 0, exactly: it drifts. Whether an iteration
   !> comes to 0 or next to it, is chance.
   subroutine test_drift()
      type(structure_t) :: structure
      type(beam_modes_t) :: modes
      type(poles_t) :: poles
      type(error_t), allocatable :: error
      real(wp) :: random(2)
      integer :: k, refused, drifting

      call random_seed(put=[(815 + k, k=1, 64)])
      structure = structure_t(length=4, rho=0.03_wp, E=80, I=1, m_T=0.15_wp, &
         hose=hose_t(m_H=0.04_wp))
      call prepare(structure)
      call bare_beam_modes(galerkin, modes, error)
      refused = 0
      drifting = 0
      do k = 1, 400
         call random_number(random)
         structure%hose(1)%c_H = 10.0_wp**(3*random(1) - 2)
         structure%c_D = 10.0_wp**(5*random(2) - 3)
         if (allocated(poles%all)) deallocate (poles%all)
         call find_poles(new_assembly(structure, modes, [integer ::]), poles, error)
         if (allocated(error)) then
            refused = refused + 1
         else
            if (count(abs(poles%s) < 1e-30_wp) == 1) drifting = drifting + 1
         end if
      end do
      call check('a hose that drifts: none refused', refused == 0, to_text(refused)//' of 400')
      call check('a hose that drifts: one root at 0', drifting == 400, to_text(drifting)//' of 400')
   end subroutine test_drift

   !> k_H and c_H from records that the exponentials have made of the double root, with a force that
   !> is known and without: what is left is the round-off of the record.
   subroutine test_fits()
      type(excitation_t) :: excitation
      type(experiment_t) :: experiment
      type(stage_t) :: stage
      real(wp), allocatable :: force(:)
      real(qp) :: exact(samples, 3)
      type(full_t) :: full
      integer :: k

      call prepare(tuned)
      call pulse(excitation, force)
      full = new_full(galerkin, tuned, excitation)
      call full%motions(real(step, qp), force, exact)
      stage = stage_of(['c_H', 'k_H'], [0.5_wp, 15.0_wp])
      experiment%excitation = excitation
      experiment%samples = [(k*step, k=1, samples)]
      experiment%measured = real(exact(:, 3), wp)
      call check_fit('a pulse', experiment, stage)
      experiment%excitation = new_free(6)
      experiment%samples = experiment%samples(6:)
      experiment%measured = experiment%measured(6:)
      stage%start = [0.6_wp, 16.5_wp]
      call check_fit('a free decay', experiment, stage)
   end subroutine test_fits

   subroutine check_fit(name, experiment, stage)
      character(len=*), intent(in) :: name
      type(experiment_t), intent(in) :: experiment
      type(stage_t), intent(in) :: stage
      type(stage_fit_t), allocatable :: fits(:)
      type(fitted_mode_t), allocatable :: modes(:)
      type(error_t), allocatable :: error

      call identify(model_of(tuned, experiment%excitation), mesh, [stage], [experiment], fits, &
         error)
      if (allocated(error)) then
         call check(name//': a fit', .false., error%message)
         return
      end if
      associate (fit => fits(1)%fit)
         ! The record is known to 1e-16, the condition of the problem is 1e4 or so.
         call check_close(name//': c_H', fit%estimate(1)/tuned%hose(1)%c_H, 1.0_wp, 1e-9_wp)
         call check_close(name//': k_H', fit%estimate(2)/tuned%hose(1)%k_H, 1.0_wp, 1e-9_wp)
         call check(name//': no trial step refused', fit%shortened == 0, fit%reason)
         ! Central differences over 1e-5 or so of a parameter are right to 1e-8 at best.
         call check(name//': derivatives against differences', all(fit%derivative_check >= 0 .and. &
            fit%derivative_check <= 1e-5_wp), to_text(maxval(fit%derivative_check)))
      end associate
      call fitted_modes(mesh, fits(1), 3, modes, error)
      call check(name//': modes', .not. allocated(error))
      if (allocated(error)) return
      ! Each is known to the root of round-off.
      call check_close(name//': both roots', maxval(abs(modes(:2)%s - double_root)), &
         0.0_wp, 1e-5_wp)
      call check(name//': they have no intervals, the third has', &
         all(modes%together .eqv. [.true., .true., .false.]) .and. &
         all((modes%frequency_half_width < huge(1.0_wp)) .neqv. modes%together))
   end subroutine check_fit

   !> Overdamped in all its modes: the estimate stands, and the table has the real roots.
   subroutine test_fitted_modes()
      type(structure_t) :: structure
      type(excitation_t) :: excitation
      type(stage_fit_t), allocatable :: fits(:)
      type(fitted_mode_t), allocatable :: modes(:)
      type(error_t), allocatable :: error
      type(experiment_t) :: experiment
      type(full_t) :: full
      real(wp), allocatable :: force(:)
      real(qp) :: exact(samples, 3)
      integer :: k

      structure = plain
      structure%c_D = 2
      call prepare(structure)
      call pulse(excitation, force)
      full = new_full(galerkin, structure, excitation)
      call full%motions(real(step, qp), force, exact)
      experiment%excitation = excitation
      experiment%samples = [(k*step, k=1, samples)]
      experiment%measured = real(exact(:, 3), wp)*(1 + 1e-6_wp*[(sin(3.0_wp*k), k=1, samples)])
      call identify(model_of(structure, excitation), mesh, [stage_of(['c_D'], [1.5_wp])], &
         [experiment], fits, error)
      call check('overdamped: a fit', .not. allocated(error))
      if (allocated(error)) return
      call check_close('overdamped: c_D', fits(1)%fit%estimate(1), 2.0_wp, 1e-5_wp)
      call fitted_modes(mesh, fits(1), 4, modes, error)
      call check('overdamped: modes', .not. allocated(error) .and. size(modes) == 4)
      if (allocated(error)) return
      ! -E/c_D and beyond.
      call check('overdamped: real roots, ascending', all(.not. abs(aimag(modes%s)) > 0) .and. &
         all(-real(modes%s) > 0.5_wp) .and. all(modes(2:)%frequency > modes(:3)%frequency))
      ! The modulus of a complex number is known to one unit in the last place.
      call check('overdamped: a damping ratio of 1 has no interval, the frequency has', &
         all(abs(modes%damping_ratio - 1) <= epsilon(1.0_wp) .and. &
            modes%damping_half_width >= huge(1.0_wp) &
         .and. modes%frequency_half_width < 1e-3_wp*modes%frequency))
   end subroutine test_fitted_modes

end program test_clusters
