!> The parameters that a structure has, and their printed names: with the name of the attachment
!> or the end that each belongs to, where there are several.
module beamid_parameter_names
   use beamid_parameters, only: parameters
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: c_R_at, c_RP_at, function_of, is_coefficient, item_name_length, &
      kappa_R_at, kappa_RP_at, no_spring, root, structure_t, tip
   implicit none
   private

   public :: group_of, name_of_parameter, place_of_name, is_there

   !> Length of a printed name, with the name of the attachment after it.
   integer, parameter, public :: name_length = 10 + item_name_length

contains

   !> Returns the group of the case file that gives parameter k: &beam for the rotation of a root
   !> that the case does not describe by &end.
   pure function group_of(structure, k) result(group)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      character(len=:), allocatable :: group

      group = trim(parameters(k)%group)
      if (any(k == [kappa_R_at(root), c_R_at(root)]) .and. .not. structure%described(root)) &
         group = 'beam'
   end function group_of

   !> Returns whether parameter k exists in a structure: its attachment (there is always a sensor
   !> and a hose, whose mass may be 0), dip or coefficient must exist. Springs and dampers of an end
   !> exist if the case describes the end, or if they are neither rigid nor absent; those of the
   !> rotation of the root always exist. Those of the rotation of a support exist if it has either.
   elemental logical function is_there(structure, k)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      integer :: item

      is_there = .true.
      item = parameters(k)%item
      select case (parameters(k)%group)
      case ('sensor', 'support', 'mass', 'hose')
         is_there = item <= attachments(structure, parameters(k)%group)
         if (any(k == [kappa_RP_at, c_RP_at])) is_there = is_there .and. &
            (structure%support(item)%kappa_RP < no_spring .or. structure%support(item)%c_RP > 0)
      case ('along')
         is_there = structure%has_dip()
      case ('end')
         if (all(k /= [kappa_R_at(root), c_R_at(root)])) is_there = structure%described(item) &
            .or. structure%get(k) > 0 .and. structure%get(k) < no_spring
      case ('E(x)', 'c_D(x)')
         is_there = item <= structure%variations%along(function_of(k))%coefficients
      end select
   end function is_there

   !> Returns the number of attachments that a group of the case file describes; there is always a
   !> sensor and a hose. 0: the group describes no attachment.
   pure integer function attachments(structure, group)
      type(structure_t), intent(in) :: structure
      character(len=*), intent(in) :: group

      select case (group)
      case ('sensor')
         attachments = max(1, structure%sensors)
      case ('support')
         attachments = structure%supports
      case ('mass')
         attachments = structure%masses
      case ('hose')
         attachments = max(1, structure%hoses)
      case default
         attachments = 0
      end select
   end function attachments

   !> Returns the printed name of parameter k. If there are several attachments of a kind, the name
   !> of the attachment follows ('m_S.a'). The end follows the name of its springs and dashpots
   !> ('k_R.tip'), except for k_R and c_R of &beam, and a coefficient is followed by its number
   !> ('E.3').
   elemental function name_of_parameter(structure, k) result(name)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      character(len=name_length) :: name

      name = parameters(k)%name
      if (attachments(structure, parameters(k)%group) > 1) name = labelled(structure, k)
      if (parameters(k)%group == 'end') then
         if (parameters(k)%item == tip .or. structure%described(1) .or. &
            .not. any(k == [kappa_R_at(1), c_R_at(1)])) name = labelled(structure, k)
      end if
      if (is_coefficient(k)) name = trim(name)//'.'//to_text(parameters(k)%item)
   end function name_of_parameter

   !> Returns the number of the parameter with a given printed name that a fit may estimate, or 0.
   !> Upper and lower case are equal. The suffix of an attachment ('m_S.a') is required if there
   !> are several of its kind, and allowed if there is one.
   elemental integer function place_of_name(structure, name) result(place)
      type(structure_t), intent(in) :: structure
      character(len=*), intent(in) :: name

      do place = size(parameters), 1, -1
         if (.not. (parameters(place)%is_free .and. is_there(structure, place))) cycle
         if (lower(trim(name_of_parameter(structure, place))) == lower(trim(name))) return
         ! The suffix is allowed for the only attachment of a kind, too.
         if (index(name, '.') < len_trim(name) .and. &
            lower(trim(name)) == lower(trim(labelled(structure, place)))) return
      end do
   end function place_of_name

   !> Returns the name of parameter k with the name of its attachment or end as a suffix.
   pure function labelled(structure, k) result(name)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      character(len=name_length) :: name
      integer :: item

      name = parameters(k)%name
      item = parameters(k)%item
      select case (parameters(k)%group)
      case ('sensor')
         name = trim(name)//'.'//structure%sensor_name(item)
      case ('support')
         name = trim(name)//'.'//structure%support_name(item)
      case ('mass')
         name = trim(name)//'.'//structure%mass_name(item)
      case ('hose')
         name = trim(name)//'.'//structure%hose_name(item)
      case ('end')
         name = trim(name)//'.'//merge('tip ', 'root', item == tip)
      end select
   end function labelled

end module beamid_parameter_names
