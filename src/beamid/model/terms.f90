!> The table of terms: M, C, K and F of (3.13) are sums of operators on the mesh that no parameter
!> enters, each times a product of parameters.
!>
!> The mesh has a length of its own. An operator on a beam of length l is that of the mesh times a
!> power of l/mesh length, known for each of them: the length of the beam is a parameter as all
!> others.
module beamid_terms
   use beamid_kinds, only: wp
   use beamid_monomials, only: monomial_t, slope_of, value_of
   use beamid_structure, only: n_parameters, of, of_length, structure_t, values_of
   implicit none
   private

   public :: term_t, terms, strengths, strength_slopes
   public :: of_mass, of_damping, of_stiffness, of_load
   public :: inertia, bending, tip_value, tip_slope, sensor_value, root_slope, hose, stretch, &
      load_shape

   !> Matrices, and the vector of the load.
   integer, parameter :: of_mass = 1, of_damping = 2, of_stiffness = 3, of_load = 4

   !> Operators: <b, b>; <b'', b''>; the square of value or slope at a place (for the load the
   !> vector itself); the hose's coordinate y, and y - u(l); <theta, b> of a distributed load.
   integer, parameter :: inertia = 1, bending = 2, tip_value = 3, tip_slope = 4, &
      sensor_value = 5, root_slope = 6, hose = 7, stretch = 8, load_shape = 9

   !> Powers of the length by which they grow.
   integer, parameter :: growth(9) = [1, -3, 0, -2, 0, -2, 0, 0, 1]

   type :: term_t
      integer :: matrix
      integer :: operator
      type(monomial_t) :: factor = monomial_t()
   end type term_t

   type(term_t), parameter :: terms(*) = [ &
      term_t(of_mass, inertia, monomial_t(place=[nint(of%rho), 0, 0])), &
      term_t(of_stiffness, bending, monomial_t(place=[nint(of%E), nint(of%I), 0])), &
      term_t(of_damping, bending, monomial_t(place=[nint(of%c_D), nint(of%I), 0])), &
      term_t(of_damping, inertia, monomial_t(place=[nint(of%gamma), 0, 0])), &
      term_t(of_mass, tip_value, monomial_t(place=[nint(of%m_T), 0, 0])), &
      term_t(of_mass, tip_slope, monomial_t(place=[nint(of%J_T), 0, 0])), &
      term_t(of_mass, sensor_value, monomial_t(place=[nint(of%m_S), 0, 0])), &
      term_t(of_mass, hose, monomial_t(place=[nint(of%m_H), 0, 0])), &
      term_t(of_damping, stretch, monomial_t(place=[nint(of%c_H), 0, 0])), &
      term_t(of_stiffness, stretch, monomial_t(place=[nint(of%k_H), 0, 0])), &
      term_t(of_stiffness, root_slope, monomial_t(place=[nint(of%k_R), 0, 0])), &
      term_t(of_damping, root_slope, monomial_t(place=[nint(of%c_R), 0, 0])), &
      term_t(of_load, tip_value), &
      term_t(of_load, load_shape)]

contains

   !> How much of each operator there is.
   !>
   !> mesh_length  of the beam that the integrals of the mesh are for [length]
   !> s            (operators, 4) of M, C, K and F
   pure function strengths(structure, mesh_length) result(s)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mesh_length
      real(wp) :: s(size(growth), 4)
      real(wp) :: q(n_parameters)
      type(term_t) :: term
      integer :: t

      q = values_of(structure)
      s = 0
      do t = 1, size(terms)
         term = terms(t)
         if (.not. is_there(term%operator, structure)) cycle
         s(term%operator, term%matrix) = s(term%operator, term%matrix) + value_of(term%factor, q) &
            *(structure%length/mesh_length)**growth(term%operator)
      end do
   end function strengths

   !> Their derivatives with respect to a parameter.
   pure function strength_slopes(structure, mesh_length, parameter) result(s)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mesh_length
      integer, intent(in) :: parameter
      real(wp) :: s(size(growth), 4)
      real(wp) :: q(n_parameters)
      type(term_t) :: term
      integer :: t

      q = values_of(structure)
      s = 0
      if (parameter == of_length) s = strengths(structure, mesh_length) &
         *spread(growth, 2, 4)/structure%length
      do t = 1, size(terms)
         term = terms(t)
         if (.not. is_there(term%operator, structure)) cycle
         s(term%operator, term%matrix) = s(term%operator, term%matrix) &
            + slope_of(term%factor, q, parameter) &
            *(structure%length/mesh_length)**growth(term%operator)
      end do
   end function strength_slopes

   !> A rigid root has no slope for a spring to act on.
   pure logical function is_there(operator, structure)
      integer, intent(in) :: operator
      type(structure_t), intent(in) :: structure

      is_there = operator /= root_slope .or. structure%has_soft_root()
   end function is_there

end module beamid_terms
