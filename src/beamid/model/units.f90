!> Labels of units. The program never converts: any consistent set is right, labels are for the
!> reader.
module beamid_units
   use beamid_excitation, only: excitation_t
   use beamid_parameters, only: amplitude, free_names
   implicit none
   private

   public :: units_t, label_length

   !> The longest label.
   integer, parameter :: label_length = 16

   type :: units_t
      !> Labels, blank where not given.
      character(len=label_length) :: length = '', force = '', time = '', mass = ''
   contains
      procedure :: of_parameter
      procedure :: of_quantity
      procedure :: acceleration
      procedure :: velocity
      procedure :: sum_of_squares
   end type units_t

contains

   !> Unit of a parameter by its place in `free_names`.
   pure function of_parameter(self, k) result(unit)
      class(units_t), intent(in) :: self
      integer, intent(in) :: k
      character(len=:), allocatable :: unit

      unit = ''
      select case (free_names(k))
      case ('m_T', 'm_H', 'm_S'); unit = joined(self%mass, '', '')
      case ('E'); unit = joined(self%force, '', power(self%length, '^2'))
      case ('c_D'); unit = joined(self%force, self%time, power(self%length, '^2'))
      case ('c_H'); unit = joined(self%force, self%time, self%length)
      case ('k_H'); unit = joined(self%force, '', self%length)
      case ('amplitude'); unit = trim(self%force)
      case ('gamma'); unit = joined(self%force, self%time, power(self%length, '^2'))
      case ('J_T'); unit = joined(self%mass, power(self%length, '^2'), '')
      case ('k_R'); unit = joined(self%force, self%length, '')
      case ('x_S'); unit = trim(self%length)
      case ('rho'); unit = joined(self%mass, '', self%length)
      end select
   end function of_parameter

   !> Unit of what a fit estimates: a parameter (the amplitude may be a displacement), or for 0 an
   !> acceleration.
   pure function of_quantity(self, k, excitation) result(unit)
      class(units_t), intent(in) :: self
      integer, intent(in) :: k
      type(excitation_t), intent(in) :: excitation
      character(len=:), allocatable :: unit

      if (k == 0) then
         unit = self%acceleration()
      else if (k == amplitude .and. excitation%by_displacement) then
         unit = trim(self%length)
      else
         unit = self%of_parameter(k)
      end if
   end function of_quantity

   pure function velocity(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(self%length, '', self%time)
   end function velocity

   pure function acceleration(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(self%length, '', power(self%time, '^2'))
   end function acceleration

   !> Unit of J, the sum of squared accelerations.
   pure function sum_of_squares(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(power(self%length, '^2'), '', power(self%time, '^4'))
   end function sum_of_squares

   pure function power(label, exponent) result(unit)
      character(len=*), intent(in) :: label, exponent
      character(len=:), allocatable :: unit

      unit = ''
      if (label /= '') unit = trim(label)//exponent
   end function power

   !> first second/under; nothing when a label is missing.
   pure function joined(first, second, under) result(unit)
      character(len=*), intent(in) :: first, second, under
      character(len=:), allocatable :: unit

      unit = trim(first)
      if (second /= '') unit = unit//' '//trim(second)
      if (under /= '') unit = unit//'/'//trim(under)
      if (first == '') unit = ''
   end function joined

end module beamid_units
