!> Random beams with everything that can stand on them or under them.
module random_benches
   use beamid_kinds, only: wp
   use beamid_strings, only: to_text
   use beamid_structure, only: no_spring, structure_t
   use random_numbers, only: between, decades
   implicit none
   private

   public :: bench, load_axially

contains

   !> A beam with everything, its first frequency some 1/(2 pi) and up. The number decides what
   !> holds it: no support; one, two that give way; one, two rigid ones; one of each. From 41 to 50
   !> the first support is a damper alone, and there is another one or none. Beyond 50 there are
   !> attachments of all kinds (`attach`).
   function bench(number) result(s)
      integer, intent(in) :: number
      type(structure_t) :: s
      integer, parameter :: how_many(6) = [0, 1, 2, 1, 2, 2]
      integer :: i

      s%length = decades(-0.3_wp, 0.3_wp)
      s%rho = decades(-0.5_wp, 0.5_wp)
      s%E = decades(-0.5_wp, 0.5_wp)
      s%I = s%length**3*decades(-0.5_wp, 0.5_wp)
      s%c_D = decades(-3.0_wp, -1.5_wp)*s%E
      s%gamma = decades(-2.0_wp, -1.0_wp)*s%rho
      s%m_T = decades(-1.5_wp, 0.0_wp)*s%rho*s%length
      s%J_T = decades(-3.0_wp, -1.5_wp)*s%rho*s%length**3
      if (modulo(number, 2) == 0) then
         s%end(1)%kappa_R = s%length/(decades(0.5_wp, 1.5_wp)*s%E*s%I)
         s%end(1)%c_R = decades(-2.0_wp, -1.0_wp)/s%end(1)%kappa_R
      end if
      if (modulo(number, 3) == 0) then
         s%hose(1)%m_H = decades(-1.5_wp, -0.5_wp)*s%rho*s%length
         s%hose(1)%k_H = decades(-1.0_wp, 0.5_wp)*s%E*s%I/s%length**3
         s%hose(1)%c_H = 0.1_wp*s%hose(1)%k_H
      end if
      s%x_F = between(0.3_wp, 1.0_wp)*s%length
      s%sensors = 2
      s%observer = 1 + modulo(number, 2)
      s%sensor_name(:2) = ['a', 'b']
      s%support_name(:2) = ['p', 'q']
      do i = 1, 2
         s%sensor(i)%m_S = decades(-2.0_wp, -0.5_wp)*s%rho*s%length
         s%sensor(i)%J_S = decades(-4.0_wp, -2.0_wp)*s%rho*s%length**3
         s%sensor(i)%x_S = between(0.2_wp, 1.0_wp)*s%length
      end do
      s%supports = how_many(modulo(number, 6) + 1)
      if (number > 40 .and. number <= 50) s%supports = 1 + modulo(number, 2)
      do i = 1, s%supports
         ! Apart, and inside an element of three: (0, l/3), (l/3, 2 l/3).
         s%support(i)%x_P = (between(0.1_wp, 0.9_wp) + 2 - i)/3*s%length
         if (number > 40 .and. number <= 50 .and. i == 1) then
            s%support(i)%kappa_P = no_spring
            s%support(i)%c_P = decades(-2.0_wp, 0.0_wp)*sqrt(s%rho*s%E*s%I)/s%length
            cycle
         end if
         if (any(modulo(number, 6) == [3, 4]) .or. modulo(number, 6) == 5 .and. i == 1) cycle
         s%support(i)%kappa_P = s%length**3/(decades(0.0_wp, 2.0_wp)*s%E*s%I)
         s%support(i)%c_P = decades(-2.0_wp, -1.0_wp)/s%support(i)%kappa_P
      end do
      if (number > 50) call attach(number, s)
      if (number /= 2) return
      ! The dashpots of the supports are all that damps.
      s%c_D = 0
      s%gamma = 0
      s%end(1)%c_R = 0
   end function bench

   !> Adds up to four masses and up to four hoses anywhere, from soft to stiff, and makes the
   !> supports resist the rotation, by a spring, a damper, both, or rigidly.
   subroutine attach(number, s)
      integer, intent(in) :: number
      type(structure_t), intent(inout) :: s
      integer :: i

      s%masses = modulo(number, 5)
      s%hoses = modulo(number/2, 5)
      do i = 1, 4
         s%mass_name(i) = 'm'//to_text(i)
         s%mass(i)%m_M = decades(-2.0_wp, -0.5_wp)*s%rho*s%length
         s%mass(i)%J_M = decades(-4.0_wp, -2.0_wp)*s%rho*s%length**3
         s%mass(i)%x_M = between(0.1_wp, 1.0_wp)*s%length
         s%hose_name(i) = 'h'//to_text(i)
         s%hose(i)%m_H = decades(-1.5_wp, -0.5_wp)*s%rho*s%length
         s%hose(i)%k_H = decades(-1.0_wp, 4.0_wp)*s%E*s%I/s%length**3
         s%hose(i)%c_H = decades(-3.0_wp, 0.0_wp)*sqrt(s%hose(i)%k_H*s%hose(i)%m_H)
         if (i > 1) s%hose(i)%x_H = between(0.1_wp, 1.0_wp)*s%length
      end do
      if (s%hoses == 0) s%hose(1)%m_H = 0
      do i = 1, s%supports
         s%support(i)%kappa_RP = s%length/(decades(-1.0_wp, 1.0_wp)*s%E*s%I)
         s%support(i)%c_RP = decades(-3.0_wp, -1.0_wp)*sqrt(s%rho*s%E*s%I)*s%length
         if (modulo(number + i, 3) == 1) s%support(i)%kappa_RP = no_spring
         if (modulo(number + i, 3) == 2) s%support(i)%kappa_RP = 0
      end do
   end subroutine attach

   !> Weight, one in two upside down, and an axial force of either sign: at most .3 and .2 of what
   !> buckles a clamped beam by itself.
   subroutine load_axially(number, s)
      integer, intent(in) :: number
      type(structure_t), intent(inout) :: s

      s%stands = modulo(number, 4) > 1
      s%g = decades(-1.0_wp, -0.5_wp)*s%E*s%I/s%length**2/(s%m_T + s%rho*s%length)
      s%T = between(-0.5_wp, 1.0_wp)*s%E*s%I/s%length**2
   end subroutine load_axially

end module random_benches
