!> Labels of units. The program never converts: any consistent set is right, labels are for the
!> reader.
module beamid_units
   use beamid_excitation, only: excitation_t
   use beamid_parameters, only: amplitude, parameters
   use beamid_strings, only: to_text
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

   !> Unit of a parameter by its place in the table. What has the time in it is written with the
   !> unit of force, mass length/time**2; nothing when the first label is missing.
   pure function of_parameter(self, k) result(unit)
      class(units_t), intent(in) :: self
      integer, intent(in) :: k
      character(len=:), allocatable :: unit
      character(len=label_length) :: labels(4)
      integer :: exponents(4), force, j

      associate (mass => parameters(k)%unit(1), length => parameters(k)%unit(2), &
         time => parameters(k)%unit(3))
         force = merge(mass, 0, time /= 0)
         labels = [self%mass, self%force, self%length, self%time]
         exponents = [mass - force, force, length - force, time + 2*force]
      end associate
      unit = ''
      do j = 1, size(labels)
         if (exponents(j) <= 0) cycle
         if (unit == '') then
            unit = power(labels(j), exponents(j))
            if (unit == '') return
         else
            unit = joined(unit, power(labels(j), exponents(j)), '')
         end if
      end do
      do j = 1, size(labels)
         if (exponents(j) < 0) unit = joined(unit, '', power(labels(j), -exponents(j)))
      end do
   end function of_parameter

   !> Unit of what a fit estimates: a parameter (the amplitude may be a displacement, or of a
   !> base that moves an acceleration), or for 0 an acceleration.
   pure function of_quantity(self, k, excitation) result(unit)
      class(units_t), intent(in) :: self
      integer, intent(in) :: k
      type(excitation_t), intent(in) :: excitation
      character(len=:), allocatable :: unit

      if (k == 0 .or. k == amplitude .and. excitation%is_base) then
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

      unit = joined(self%length, '', power(self%time, 2))
   end function acceleration

   !> Unit of J, the sum of squared accelerations.
   pure function sum_of_squares(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(power(self%length, 2), '', power(self%time, 4))
   end function sum_of_squares

   !> label**exponent, exponent >= 1; nothing without a label.
   pure function power(label, exponent) result(unit)
      character(len=*), intent(in) :: label
      integer, intent(in) :: exponent
      character(len=:), allocatable :: unit

      unit = trim(label)
      if (label /= '' .and. exponent > 1) unit = unit//'^'//to_text(exponent)
   end function power

   !> first second/under; nothing when the first is missing.
   pure function joined(first, second, under) result(unit)
      character(len=*), intent(in) :: first, second, under
      character(len=:), allocatable :: unit

      unit = trim(first)
      if (second /= '') unit = unit//' '//trim(second)
      if (under /= '') unit = unit//'/'//trim(under)
      if (first == '') unit = ''
   end function joined

end module beamid_units
