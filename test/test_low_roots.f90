!> The lowest roots alone, and motions by them, against all roots of the same random structures on
!> fine meshes.
program test_low_roots
   use beamid_assembly, only: assembly_t, new_assembly
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_force_table, new_pulse, new_release
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_modes, only: bare_beam_modes, beam_modes_t
   use beamid_pole_derivatives, only: differentiate_poles
   use beamid_pole_search, only: find_poles
   use beamid_poles, only: poles_t
   use beamid_responses, only: work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: of_c_D, of_E, of_length, of_m_T, structure_t
   use checks, only: check, check_close, finish
   use random_experiments, only: random_structure, wide_structure
   use random_numbers, only: between, decades, pick, start_random, uniform
   implicit none

   integer, parameter :: parameters(4) = [of_E, of_c_D, of_m_T, of_length]

   call start_random(20261126)
   call test_roots()
   call test_motions()
   call finish('low_roots')

contains

   !> A structure, and a mesh on which it has many roots.
   subroutine draw(structure, galerkin, modes)
      type(structure_t), intent(out) :: structure
      type(galerkin_t), intent(out) :: galerkin
      type(beam_modes_t), intent(out) :: modes
      type(error_t), allocatable :: error

      structure = random_structure()
      structure%c_D = 2*structure%E/structure%omega()*decades(-4.0_wp, -2.0_wp)
      if (uniform() < 0.3_wp) structure = wide_structure()
      galerkin = galerkin_of(mesh_t(3, 10 + pick(30), 4, 1), structure)
      call bare_beam_modes(galerkin, modes, error)
      if (allocated(error)) call check('a mesh', .false., error%message)
   end subroutine draw

   !> Roots of a structure, and of one that differs a little: none is missing that should be there.
   subroutine test_roots()
      type(structure_t) :: structure
      type(galerkin_t) :: galerkin
      type(beam_modes_t) :: modes
      type(assembly_t) :: assembly
      type(poles_t) :: low, all
      type(error_t), allocatable :: error
      real(wp) :: worst, rate
      integer :: number, step, reduced, missing, wanted

      reduced = 0
      missing = 0
      worst = 0
      do number = 1, 400
         call draw(structure, galerkin, modes)
         wanted = pick(4)
         rate = 0
         if (uniform() < 0.7_wp) rate = structure%omega()*decades(-1.0_wp, 2.0_wp)
         do step = 1, 3
            assembly = new_assembly(structure, modes, parameters)
            if (step == 1) low = poles_t()
            call find_poles(assembly, low, error, rate, wanted)
            call check('roots: lowest', .not. allocated(error))
            if (allocated(error)) exit
            call differentiate_poles(assembly, low)
            if (.not. low%has_all()) then
               all = poles_t()
               call find_poles(assembly, all, error)
               call check('roots: all', .not. allocated(error))
               if (allocated(error)) exit
               reduced = reduced + 1
               if (low%rate < rate .or. low%modes < wanted) missing = missing + 1
               call compare_roots(low, all, missing, worst)
            end if
            structure%E = structure%E*between(0.8_wp, 1.2_wp)
            structure%c_D = structure%c_D*between(0.7_wp, 1.3_wp)
            structure%m_T = structure%m_T*between(0.8_wp, 1.2_wp)
         end do
      end do
      call check('roots: many of 1200 sets are reduced', reduced > 250, to_text(reduced))
      call check('roots: none is missing', missing == 0, to_text(missing))
      call check_close('roots: the same', worst, 0.0_wp, 1e-10_wp)
   end subroutine test_roots

   !> Looks among the lowest roots for each root that decays slowly, and for the lowest that
   !> oscillate.
   subroutine compare_roots(low, all, missing, worst)
      type(poles_t), intent(in) :: low, all
      integer, intent(inout) :: missing
      real(wp), intent(inout) :: worst
      real(wp) :: off
      integer :: k, oscillating

      do k = 1, size(all%s)
         associate (s => all%s(k))
            oscillating = count(aimag(all%s) > 0 .and. abs(all%s) < abs(s))
            if (real(s) < -low%rate .and. .not. (aimag(s) > 0 .and. oscillating < low%modes)) cycle
            off = minval(abs(low%s - s))/abs(s)
            if (off > 1e-6_wp) then
               missing = missing + 1
            else
               worst = max(worst, off)
            end if
         end associate
      end do
   end subroutine compare_roots

   !> Motions after a force, and during it. One more sample right after the first node of the force
   !> makes all poles visible.
   subroutine test_motions()
      type(structure_t) :: structure
      type(galerkin_t), target :: galerkin
      type(beam_modes_t) :: modes
      type(excitation_t) :: excitation
      type(error_t), allocatable :: error
      real(wp) :: worst(3)
      integer :: number

      worst = 0
      do number = 1, 300
         call draw(structure, galerkin, modes)
         associate (period => 2*acos(-1.0_wp)/structure%omega())
            select case (pick(4))
            case (1)
               excitation = new_release(1.0_wp, 0.0_wp, .false.)
            case (2)
               call new_force_table(period*[0.0_wp, 0.3_wp, 0.5_wp, 1.2_wp], [between(-1.0_wp, &
                  1.0_wp), 1.0_wp, between(-1.0_wp, 1.0_wp), between(-1.0_wp, 1.0_wp)], &
                  excitation, error)
            case default
               excitation = new_pulse(1.0_wp, period*between(0.01_wp, 1.0_wp))
            end select
            excitation%distributed = uniform() < 0.3_wp
            call compare_motions(structure, galerkin, excitation, period, worst)
         end associate
      end do
      call check_close('motions', worst(1), 0.0_wp, 1e-9_wp)
      call check_close('motions: derivatives', worst(2), 0.0_wp, 1e-8_wp)
      ! The sum over all poles of the derivative by c_D cancels near -E/c_D: it changes by up to
      ! 1e-7 if the poles are found from another start.
      call check_close('motions: derivatives of the acceleration', worst(3), 0.0_wp, 1e-6_wp)
   end subroutine test_motions

   !> Compares the motions by few poles with those by all.
   !>
   !> worst  greatest differences, relative to the greatest value: of motions, of derivatives of
   !>        displacement and velocity, and of derivatives of the acceleration
   subroutine compare_motions(structure, galerkin, excitation, period, worst)
      type(structure_t), intent(in) :: structure
      type(galerkin_t), intent(in), target :: galerkin
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: period
      real(wp), intent(inout) :: worst(3)
      real(wp) :: few(12, 0:size(parameters), 3), all(0:12, 0:size(parameters), 3)
      real(wp) :: times(0:12), off
      integer :: k, p, q

      times(0) = 1e-12_wp*period
      times(1:) = [(period*0.13_wp*q, q=1, 12)]
      call compute(structure, galerkin, excitation, times(1:), few)
      call compute(structure, galerkin, excitation, times, all)
      do q = 1, 3
         do p = 0, size(parameters)
            k = 1
            if (p > 0) k = merge(3, 2, q == 3)
            off = maxval(abs(few(:, p, q) - all(1:, p, q)))/maxval(abs(all(:, p, q)))
            worst(k) = max(worst(k), off)
            if (.not. off >= 0) worst(k) = huge(off)
         end do
      end do
   end subroutine compare_motions

   !> Displacements, velocities and accelerations, and their derivatives; `huge` after an error.
   subroutine compute(structure, galerkin, excitation, times, motion)
      type(structure_t), intent(in) :: structure
      type(galerkin_t), intent(in), target :: galerkin
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: times(:)
      real(wp), intent(out) :: motion(:, 0:, :)
      type(equations_t), target :: equations
      type(modal_t) :: solver
      type(work_t) :: work
      type(error_t), allocatable :: error

      equations = new_equations(galerkin, structure, excitation)
      call solver%prepare(galerkin, error)
      if (.not. allocated(error)) call solver%motions(equations, excitation, times, [1, 2, 3], &
         parameters, motion, work, error)
      if (allocated(error)) motion = huge(motion)
   end subroutine compute

end program test_low_roots
