!> Motions of beams with something attached, by the exact solver against CVODE and against the full
!> matrices in quadruple precision.
program test_attachment_motions
   use attached_beams, only: coarse, compare, compare_full, everything, experiment_on
   use beamid_errors, only: error_t
   use beamid_galerkin, only: mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_parameter_names, only: is_there
   use beamid_parameters, only: free_names
   use beamid_strings, only: to_text
   use beamid_structure, only: of_c_R, of_gamma, of_J_T, of_kappa_R, of_length, of_m_S, of_x_S, &
      structure_t
   use checks, only: check, check_close, finish
   use exact_motions, only: exact, prepare, relative, solver
   use random_experiments, only: experiment_t, random_structure
   use random_numbers, only: between, decades, start_random
   implicit none

   call start_random(171094065)
   call test_alone()
   call test_together()
   call test_quadrature()
   call start_random(554540345)
   call test_limits()
   call start_random(1288573915)
   call test_walk()
   call finish('attachment_motions')

contains

   !> Each attachment alone on a beam with some tip mass, and none of them; also overdamped.
   subroutine test_alone()
      character(len=*), parameter :: names(8) = [character(len=12) :: 'nothing', 'gamma', 'J_T', &
         'k_R', 'm_S', 'only x_S', 'gamma = 100', 'hose']
      type(experiment_t) :: e
      type(structure_t) :: structure
      character(len=:), allocatable :: name
      integer :: i, load

      do i = 1, size(names)
         do load = 1, 2
            structure = structure_t(length=1, rho=1, E=1, I=1, c_D=1e-3_wp, m_T=0.2_wp)
            select case (i)
            case (2); structure%gamma = 0.3_wp
            case (3); structure%J_T = 0.05_wp
            case (4); structure%end(1)%kappa_R = 0.5_wp
            case (5); structure%sensor(1)%m_S = 0.2_wp
            case (7); structure%gamma = 100
            case (8); structure%hose(1)%m_H = 0.1_wp
            end select
            if (i == 5 .or. i == 6) structure%sensor(1)%x_S = 0.45_wp
            if (i == 8) structure%hose(1)%k_H = 1
            e = experiment_on(structure)
            e%excitation%distributed = load == 2
            e%mesh = mesh_t(2*load + 1, 3, 6, 1)
            name = trim(names(i))//merge(', at the tip ', ', distributed', load == 1)
            call compare_full(name, e, [1e-12_wp, 1e-11_wp, 1e-10_wp])
            call compare(name, e)
         end do
      end do
   end subroutine test_alone

   !> Everything together, at random; every fourth with air so thick that the first mode is
   !> overdamped, every fourth with so much viscosity.
   subroutine test_together()
      type(experiment_t) :: e
      type(structure_t) :: structure
      character(len=:), allocatable :: name
      integer :: number

      do number = 1, 40
         structure = random_structure()
         name = 'random '//to_text(number)
         if (modulo(number, 4) == 1) then
            structure%gamma = structure%omega()*(structure%rho + structure%m_T/structure%length) &
               *decades(0.5_wp, 1.5_wp)
            name = name//', thick air'
         else if (modulo(number, 4) == 3) then
            structure%c_D = 2*structure%E/structure%omega()*decades(0.0_wp, 0.5_wp)
            name = name//', viscous'
         end if
         e = experiment_on(structure)
         e%mesh = mesh_t(3 + 2*modulo(number/2, 2), 2 + modulo(number, 5), 6, 1)
         e%excitation%distributed = modulo(number/2, 3) == 0
         call compare(name//', degree '//to_text(e%mesh%degree)//', N = '// &
            to_text(e%mesh%elements), e)
      end do
   end subroutine test_together

   !> Rules that are not exact, for the mass and for the distributed load: a root that turns must
   !> meet with the integrals that the mesh has, as everything else does. Round-off alone remains.
   subroutine test_quadrature()
      type(mesh_t), parameter :: meshes(4) = [mesh_t(3, 4, 1, 4), mesh_t(3, 4, 2, 1), &
         mesh_t(3, 3, 3, 1), mesh_t(5, 3, 4, 1)]
      real(wp), parameter :: powers(3) = [2.0_wp, 2.5_wp, 3.0_wp]
      type(experiment_t) :: e
      integer :: m, p

      do m = 1, size(meshes)
         do p = 1, size(powers)
            e = experiment_on(everything)
            e%mesh = meshes(m)
            e%excitation%distributed = .true.
            e%excitation%power = powers(p)
            call compare_full('rule of '//to_text(meshes(m)%gauss_points)//' x '// &
               to_text(meshes(m)%panels)//', power '//to_text(powers(p)), e, &
               [1e-12_wp, 1e-11_wp, 1e-10_wp])
         end do
      end do
   end subroutine test_quadrature

   !> Attachments from next to nothing to far more than the beam, in quadruple precision.
   subroutine test_limits()
      integer, parameter :: some(6) = [of_gamma, of_J_T, of_kappa_R, of_c_R, of_m_S, of_x_S]
      real(wp), parameter :: sizes(6) = [1e-12_wp, 1e-6_wp, 1e-3_wp, 1e2_wp, 1e4_wp, 1e6_wp]
      type(experiment_t) :: e
      real(wp) :: allowed(3)
      integer :: i, k

      do k = 1, size(some)
         do i = 1, size(sizes)
            e = experiment_on(everything)
            e%mesh = coarse
            ! A root of 1e-12 swings for a million of the beam's periods.
            if (some(k) == of_kappa_R .and. sizes(i) < 1e-6_wp) cycle
            if (some(k) == of_x_S .and. (sizes(i) < 1e-6_wp .or. sizes(i) > 1)) cycle
            call e%structure%set(some(k), sizes(i))
            ! Round-off times the phase; where the sensor hardly moves (x_S = 1e-6) the splines
            ! themselves are known to eps/x_S. In thick air the forces all but balance: of the
            ! acceleration there remains less than 1e-10 of its terms.
            allowed = [1e-11_wp, 1e-10_wp, 1e-9_wp]
            if (some(k) == of_x_S) allowed = allowed + 1e-9_wp
            if (some(k) == of_gamma .and. sizes(i) > 1e3_wp) allowed(3) = 2e-6_wp
            call compare_full(trim(free_names(some(k)))//' = '//to_text(sizes(i)), e, allowed)
         end do
      end do
   end subroutine test_limits

   !> A walk through the parameters by one solver, each search starting where the last one ended, as
   !> in a fit; every fiftieth step is a leap. As a solver that begins anew.
   subroutine test_walk()
      type(experiment_t) :: e
      type(error_t), allocatable :: error
      real(wp), allocatable :: columns(:, :), known(:, :), none(:, :, :)
      type(modal_t) :: walker
      real(wp) :: worst, far
      integer :: step, k, refused, root

      do root = 1, 2
         e = experiment_on(everything)
         e%mesh = coarse
         if (root == 2) e%structure%end(1)%kappa_R = 0
         call prepare(e)
         walker = solver
         worst = 0
         refused = 0
         do step = 1, 300
            far = merge(2.0_wp, 0.1_wp, modulo(step, 50) == 0)
            do k = 1, of_x_S
               ! The mesh is prepared for one beam.
               if (k == of_length .or. .not. is_there(everything, k)) cycle
               if (k == of_x_S) then
                  call e%structure%set(k, between(0.1_wp, 1.0_wp))
               else if (root == 1 .or. k /= of_kappa_R) then
                  call e%structure%set(k, everything%get(k)*decades(-far, far))
               end if
            end do
            solver = walker
            call exact(e, [integer ::], columns, none, error)
            if (allocated(error)) refused = refused + 1
            walker = solver
            call prepare(e)
            call exact(e, [integer ::], known, none, error)
            if (allocated(error)) refused = refused + 1
            if (.not. relative(columns(:, 1), known(:, 1)) <= worst) &
               worst = relative(columns(:, 1), known(:, 1))
         end do
         call check('a walk: none refused', refused == 0, to_text(refused))
         ! Roots are known to 1e-13, times the phase, 1e2.
         call check_close('a walk: as from the start', worst, 0.0_wp, 1e-11_wp)
      end do
   end subroutine test_walk

end program test_attachment_motions
