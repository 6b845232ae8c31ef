!> Exact derivatives of the modal response against differences of eighth order, over random structures.
program test_derivatives
   use beamid_equations, only: equations_t, new_equations
   use beamid_errors, only: error_t
   use beamid_excitation, only: excitation_t, new_pulse
   use beamid_galerkin, only: galerkin_t, mesh_t, new_galerkin
   use beamid_kinds, only: wp
   use beamid_modal, only: modal_t
   use beamid_responses, only: response_t, work_t
   use beamid_strings, only: to_text
   use beamid_structure, only: parameter_names, structure_t
   use checks, only: check, finish
   implicit none

   integer, parameter :: structures = 1000, parameters = size(parameter_names), samples = 40
   !> Relative, in the 2-norm over the samples: the bar set for this comparison.
   real(wp), parameter :: allowed = 1e-8_wp
   !> Steps relative to the parameter. Light high modes turn by 1e4 rad within the record and need the
   !> small ones; a parameter that hardly matters needs the large ones, where round-off is divided by
   !> less. Four of the largest are still less than the parameter.
   real(wp), parameter :: steps(6) = [1e-6_wp, 1e-5_wp, 1e-4_wp, 1e-3_wp, 1e-2_wp, 1e-1_wp]
   !> Round-off of a response, relative to its norm: some ten units in the last place.
   real(wp), parameter :: round_off = 2e-15_wp
   character(len=*), parameter :: motions(3) = [character(len=12) :: 'displacement', 'velocity', &
                                                'acceleration']
   type(galerkin_t), target :: galerkin
   type(modal_t) :: solver
   real(wp) :: seed = 20261120, worst(3, parameters)
   integer :: k, p, motion, refused, poor(3, parameters), overdamped

   worst = 0
   poor = 0
   refused = 0
   overdamped = 0
   do k = 1, structures
      call compare()
   end do
   do p = 1, parameters
      do motion = 1, 3
         call check('d '//trim(motions(motion))//'/d '//trim(parameter_names(p)), &
            worst(motion, p) <= allowed, 'worst '//to_text(worst(motion, p))//', allowed '// &
            to_text(allowed)//'; reference too poor in '//to_text(poor(motion, p))//' of '// &
            to_text(structures))
         ! Where a parameter hardly matters (a hose damped by a thousandth) no difference in double
         ! precision has nine digits; elsewhere the reference must serve.
         call check('  the reference serves in 95 of 100', poor(motion, p) <= 5*structures/100)
      end do
   end do
   call check('overdamped hoses are among them', overdamped > structures/20, to_text(overdamped))
   call check('almost none is refused', refused <= structures/100, to_text(refused))
   call finish('derivatives')

contains

   !> One random structure: every parameter, every motion.
   subroutine compare()
      type(structure_t) :: structure
      type(excitation_t) :: pulse
      type(error_t), allocatable :: error
      type(response_t) :: response
      type(response_t), allocatable :: slopes(:)
      type(work_t) :: work
      real(wp) :: times(samples), exact(samples, 3), reference(samples, 3), uncertain(3)
      type(equations_t) :: equations
      integer :: i, motion, p

      structure = random_structure()
      if (structure%c_H**2 > 4*structure%k_H*structure%m_H) overdamped = overdamped + 1
      galerkin = new_galerkin(mesh_t(3, 4, 4, 1), structure%length)
      call solver%prepare(galerkin, error)
      ! Three periods of the first mode, the force on during a fifth of the first.
      times = [(3*i/(samples*structure%omega()/6.283_wp), i=1, samples)]
      pulse = new_pulse(1.0_wp, 0.2_wp*6.283_wp/structure%omega())
      equations = new_equations(galerkin, structure, pulse)
      call solver%differentiate(equations, pulse, times, [(i, i=1, parameters)], response, slopes, &
         work, error)
      if (allocated(error)) then
         refused = refused + 1
         return
      end if
      do p = 1, parameters
         exact(:, 1) = slopes(p)%displacement
         exact(:, 2) = slopes(p)%velocity
         exact(:, 3) = slopes(p)%acceleration
         call differences(structure, pulse, times, p, reference, uncertain)
         do motion = 1, 3
            if (uncertain(motion) > allowed/5) then
               poor(motion, p) = poor(motion, p) + 1
            else
               worst(motion, p) = max(worst(motion, p), norm2(exact(:, motion) - &
                  reference(:, motion))/norm2(reference(:, motion)))
            end if
         end do
      end do
   end subroutine compare

   !> Central differences of eighth order with the step at which their uncertainty is least: their
   !> difference from those of sixth order, and the round-off that the step lets through.
   subroutine differences(structure, pulse, times, p, reference, uncertain)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: pulse
      real(wp), intent(in) :: times(:)
      integer, intent(in) :: p
      real(wp), intent(out) :: reference(:, :), uncertain(:)
      real(wp), parameter :: eighth(4) = [4/5.0_wp, -1/5.0_wp, 4/105.0_wp, -1/280.0_wp], &
         sixth(4) = [3/4.0_wp, -3/20.0_wp, 1/60.0_wp, 0.0_wp]
      real(wp), dimension(samples, 3) :: ahead, behind, high, low
      real(wp) :: doubt, h
      integer :: s, j, motion

      uncertain = huge(uncertain)
      reference = 1
      do s = 1, size(steps)
         h = steps(s)*structure%get(p)
         high = 0
         low = 0
         do j = 1, 4
            ahead = shifted(structure, pulse, times, p, j*h)
            behind = shifted(structure, pulse, times, p, -j*h)
            high = high + eighth(j)/h*(ahead - behind)
            low = low + sixth(j)/h*(ahead - behind)
         end do
         do motion = 1, 3
            doubt = (norm2(high(:, motion) - low(:, motion)) + &
               round_off*norm2(ahead(:, motion))/h)/norm2(high(:, motion))
            if (doubt >= uncertain(motion)) cycle
            uncertain(motion) = doubt
            reference(:, motion) = high(:, motion)
         end do
      end do
   end subroutine differences

   !> The three motions with one parameter changed by h.
   function shifted(structure, pulse, times, p, h) result(motion)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: pulse
      real(wp), intent(in) :: times(:), h
      integer, intent(in) :: p
      real(wp) :: motion(samples, 3)
      type(structure_t) :: changed
      type(equations_t) :: equations
      type(response_t) :: response
      type(work_t) :: work
      type(error_t), allocatable :: error

      changed = structure
      call changed%set(p, structure%get(p) + h)
      equations = new_equations(galerkin, changed, pulse)
      call solver%respond(equations, pulse, times, response, work, error)
      motion = huge(1.0_wp)**0.25_wp
      if (allocated(error)) return
      motion(:, 1) = response%displacement
      motion(:, 2) = response%velocity
      motion(:, 3) = response%acceleration
   end function shifted

   !> Beams of 0.1 to 10 lengths, tips and hoses from light to heavy, damping from a hundred thousandth
   !> of critical to beyond it.
   function random_structure() result(s)
      type(structure_t) :: s

      s%length = decades(-1.0_wp, 1.0_wp)
      s%rho = decades(-2.0_wp, 1.0_wp)
      s%E = decades(0.0_wp, 9.0_wp)
      s%I = decades(-6.0_wp, 0.0_wp)
      s%m_T = decades(-2.0_wp, 1.0_wp)*s%rho*s%length
      s%m_H = decades(-2.0_wp, 0.5_wp)*(s%rho*s%length + s%m_T)
      s%k_H = decades(-1.5_wp, 1.5_wp)*s%stiffness()
      s%c_H = decades(-3.0_wp, 0.7_wp)*2*sqrt(s%k_H*s%m_H)
      s%c_D = decades(-5.0_wp, -1.0_wp)*2*s%E/s%omega()
   end function random_structure

   !> 10**x, x uniform between two exponents; Lehmer's generator, exact in double precision.
   real(wp) function decades(low, high)
      real(wp), intent(in) :: low, high

      seed = modulo(48271*seed, 2147483647.0_wp)
      decades = 10**(low + (high - low)*seed/2147483647)
   end function decades

end program test_derivatives
