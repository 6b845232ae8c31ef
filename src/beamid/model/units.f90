!> Labels of units for reports and messages. The program never converts units: any consistent set
!> is allowed, and the labels come from the case file.
module beamid_units
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
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
      procedure :: of_parameter, of_quantity, acceleration, velocity, frequency, sum_of_squares, &
         force_ratio
   end type units_t

   !> A label of a unit, and the unit in units of the SI.
   type :: known_unit_t
      character(len=4) :: label
      real(wp) :: value
   end type known_unit_t
   type(known_unit_t), parameter :: lengths(*) = [known_unit_t('m', 1.0_wp), &
      known_unit_t('cm', 1e-2_wp), known_unit_t('mm', 1e-3_wp)]
   type(known_unit_t), parameter :: forces(*) = [known_unit_t('N', 1.0_wp), &
      known_unit_t('mN', 1e-3_wp), known_unit_t('kN', 1e3_wp), known_unit_t('MN', 1e6_wp)]
   type(known_unit_t), parameter :: times(*) = [known_unit_t('s', 1.0_wp), &
      known_unit_t('ms', 1e-3_wp)]
   type(known_unit_t), parameter :: masses(*) = [known_unit_t('kg', 1.0_wp), &
      known_unit_t('g', 1e-3_wp), known_unit_t('t', 1e3_wp)]

contains

   !> Returns the label of the unit of parameter k. If the unit contains the time, mass is expressed
   !> by force (mass = force time**2/length). The result is empty if the first label is missing.
   pure function of_parameter(self, k) result(unit)
      class(units_t), intent(in) :: self
      integer, intent(in) :: k
      character(len=:), allocatable :: unit
      character(len=label_length) :: labels(4)
      integer :: given(3), exponents(4), force, j

      given = parameters(k)%unit
      associate (mass => given(1), length => given(2), time => given(3))
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

   !> Returns the label of the unit of frequencies, or nothing if the time has no label.
   pure function frequency(self) result(unit)
      class(units_t), intent(in) :: self
      character(len=:), allocatable :: unit

      unit = ''
      if (self%time /= '') unit = '1/'//trim(self%time)
      if (self%time == 's') unit = 'Hz'
   end function frequency

   !> Returns mass length/time**2 in units of force: 1 if the units are consistent, or if a label is
   !> missing or unknown.
   pure real(wp) function force_ratio(self) result(ratio)
      class(units_t), intent(in) :: self
      real(wp) :: values(4)

      values = [value_of(self%mass, masses), value_of(self%length, lengths), &
         value_of(self%time, times), value_of(self%force, forces)]
      ratio = 1
      if (all(values > 0)) ratio = values(1)*values(2)/values(3)**2/values(4)
   end function force_ratio

   !> Returns the value of a unit in units of the SI; 0 if its label is unknown.
   pure real(wp) function value_of(label, known) result(value)
      character(len=*), intent(in) :: label
      type(known_unit_t), intent(in) :: known(:)

      value = sum(known%value, mask=known%label == label)
   end function value_of

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
