!> Labels of units for reports and messages. The program never converts units: any consistent set
!> is allowed, and the labels come from the case file.
module beamid_units
   use beamid_excitation, only: excitation_t
   use beamid_parameters, only: amplitude, parameters
   use beamid_strings, only: to_text
   implicit none
   private

   public :: units_t, label_length

   !> Length of the longest label.
   integer, parameter :: label_length = 16

   !> The labels of the units.
   type :: units_t
      !> labels of the units of length, force, time and mass; blank if not given
      character(len=label_length) :: length = '', force = '', time = '', mass = ''
   contains
      procedure :: of_parameter, of_quantity, acceleration, velocity, sum_of_squares
   end type units_t

contains

   !> Returns the label of the unit of parameter k. If the unit contains the time, mass is expressed
   !> by force (mass = force time**2/length). The result is empty if the first label is missing.
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
      if (all(exponents <= 0) .and. any(exponents < 0 .and. labels /= '')) unit = '1'
      do j = 1, size(labels)
         if (exponents(j) < 0) unit = joined(unit, '', power(labels(j), -exponents(j)))
      end do
   end function of_parameter

   !> Returns the label of the unit of parameter k for a given excitation: the amplitude may be a
   !> force, a displacement, or the acceleration of a moving base. k = 0 stands for an acceleration.
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

   !> Returns the label of the unit of velocity, or nothing if the length has no label.
   pure function velocity(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(self%length, '', self%time)
   end function velocity

   !> Returns the label of the unit of acceleration, or nothing if the length has no label.
   pure function acceleration(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(self%length, '', power(self%time, 2))
   end function acceleration

   !> Returns the label of the unit of the objective J, a sum of squared accelerations.
   pure function sum_of_squares(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = joined(power(self%length, 2), '', power(self%time, 4))
   end function sum_of_squares

   !> Returns the text label^exponent, exponent >= 1, or nothing if the label is blank.
   pure function power(label, exponent) result(unit)
      character(len=*), intent(in) :: label
      integer, intent(in) :: exponent
      character(len=:), allocatable :: unit

      unit = trim(label)
      if (label /= '' .and. exponent > 1) unit = unit//'^'//to_text(exponent)
   end function power

   !> Returns the text "first second/under", or nothing if `first` is blank.
   pure function joined(first, second, under) result(unit)
      character(len=*), intent(in) :: first, second, under
      character(len=:), allocatable :: unit

      unit = trim(first)
      if (second /= '') unit = unit//' '//trim(second)
      if (under /= '') unit = unit//'/'//trim(under)
      if (first == '') unit = ''
   end function joined

end module beamid_units
