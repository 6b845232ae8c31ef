!> Everything that a fit may free, by name: the parameters of the structure, the amplitude of the
!> force, the offset of the sensor.
module beamid_parameters
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_strings, only: lower
   use beamid_structure, only: parameter_names, structure_t
   implicit none
   private

   public :: free_names, free_index, get_free, set_free, free_magnitude, may_be_negative, &
      belongs_to_hose
   public :: amplitude, offset

   !> Names as they are printed; the first ones are those of `structure_t`.
   character(len=*), parameter :: free_names(size(parameter_names) + 2) = &
      [character(len=9) :: parameter_names, 'amplitude', 'offset']

   !> Places of the amplitude and of the offset, which belongs to the record.
   integer, parameter :: amplitude = size(parameter_names) + 1, offset = amplitude + 1

contains

   !> Place of a name in `free_names`, any case; 0 when there is none.
   pure integer function free_index(name)
      character(len=*), intent(in) :: name

      do free_index = size(free_names), 1, -1
         if (lower(trim(free_names(free_index))) == lower(trim(name))) return
      end do
   end function free_index

   !> Value of parameter k.
   pure real(wp) function get_free(structure, excitation, k) result(value)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: k

      if (k == amplitude) then
         value = excitation%amplitude
      else
         value = structure%get(k)
      end if
   end function get_free

   !> Gives parameter k a value.
   pure subroutine set_free(structure, excitation, k, value)
      type(structure_t), intent(inout) :: structure
      type(excitation_t), intent(inout) :: excitation
      integer, intent(in) :: k
      real(wp), intent(in) :: value

      if (k == amplitude) then
         call excitation%set_amplitude(value)
      else
         call structure%set(k, value)
      end if
   end subroutine set_free

   !> What a moderate value of parameter k is.
   pure real(wp) function free_magnitude(structure, excitation, k) result(value)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: k

      if (k == amplitude) then
         value = abs(excitation%amplitude)
         if (.not. value > 0) value = 1
      else
         value = structure%magnitude(k)
      end if
   end function free_magnitude

   !> Masses, damping and stiffness cannot be negative, a force can.
   elemental logical function may_be_negative(k)
      integer, intent(in) :: k

      may_be_negative = k == amplitude .or. k == offset
   end function may_be_negative

   !> m_H, c_H and k_H mean nothing without a hose.
   elemental logical function belongs_to_hose(k)
      integer, intent(in) :: k

      belongs_to_hose = index(free_names(k), '_H') > 0
   end function belongs_to_hose

end module beamid_parameters
