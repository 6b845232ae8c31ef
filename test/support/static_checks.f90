!> Statics of a structure: against the matrices of a mesh, and its derivatives against differences.
module static_checks
   use beamid_bands, only: band_t
   use beamid_equations, only: equations_t, new_equations
   use beamid_excitation, only: new_pulse
   use beamid_galerkin, only: galerkin_of, galerkin_t, mesh_t
   use beamid_kinds, only: wp
   use beamid_parameter_names, only: is_there, name_of_parameter
   use beamid_parameters, only: parameters
   use beamid_strings, only: to_text
   use beamid_structure, only: is_coefficient, n_parameters, no_spring, structure_t
   use checks, only: check, check_close
   implicit none
   private

   public :: check_statics

contains

   !> Static stiffness and the deflection at another place against those of a mesh; the change of
   !> stiffness by each parameter against differences of fourth order, with relative steps of 1e-4:
   !> 1e-10 and round-off, some 1e-11.
   !>
   !> allowed  by the mesh, relatively
   subroutine check_statics(name, s, mesh, allowed)
      character(len=*), intent(in) :: name
      type(structure_t), intent(in) :: s
      type(mesh_t), intent(in) :: mesh
      real(wp), intent(in) :: allowed
      real(wp), parameter :: place = 0.5_wp
      real(wp), parameter :: steps(4) = [-2, -1, 1, 2], weights(4) = [1, -8, 8, -1]/12.0_wp
      type(structure_t) :: moved
      type(galerkin_t), target :: galerkin
      type(equations_t) :: equations
      type(band_t) :: factor
      logical :: positive
      real(wp), allocatable :: x(:)
      real(wp) :: h, stiffness(4)
      integer :: j, k, compared

      galerkin = galerkin_of(mesh, s)
      equations = new_equations(galerkin, s, new_pulse(1.0_wp, 1.0_wp))
      factor = equations%stiffness
      call factor%factor(positive)
      x = equations%load
      call factor%solve(x)
      call check_close(name//': stiffness', s%stiffness()*dot_product(x, equations%load), 1.0_wp, &
         allowed)
      call check_close(name//': at another place', s%static_deflection(place) &
         /dot_product(x, galerkin%space%at(place, 0)), 1.0_wp, allowed)
      compared = 0
      do k = 1, size(parameters)
         if (k > n_parameters .and. .not. is_coefficient(k) .or. .not. is_there(s, k)) cycle
         if (.not. s%get(k) > 0) cycle
         if (s%get(k) >= no_spring) cycle
         h = 1e-4_wp*s%get(k)
         do j = 1, 4
            moved = s
            call moved%set(k, s%get(k) + steps(j)*h)
            stiffness(j) = moved%stiffness()
         end do
         call check_close(name//': change by '//trim(name_of_parameter(s, k)), s%stiffening(k) &
            *s%get(k), s%get(k)*sum(weights*stiffness)/(h*s%stiffness()), 1e-8_wp)
         compared = compared + 1
      end do
      call check(name//': parameters', compared >= 10, to_text(compared))
   end subroutine check_statics

end module static_checks
