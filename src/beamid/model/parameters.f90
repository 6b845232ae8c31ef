!> The table of parameters: everything that is known of each of them, a row for one.
module beamid_parameters
   use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_value
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_monomials, only: monomial_t, value_of
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: item_name_length, most_sensors, most_supports, n_parameters, &
      of_c_D, function_of, is_coefficient, &
      of_c_H, c_P_at, of_c_R, of_E, of_g, of_gamma, of_I, J_S_at, of_J_T, of_k_H, kappa_P_at, &
      of_kappa_R, of_length, of_m_H, m_S_at, of_m_T, of_rho, of_T, of_x_F, x_P_at, x_S_at, &
      c_D_at, E_at, most_coefficients, of_d_D, of_w_D, of_x_D, structure_t, values_of
   implicit none
   private

   public :: parameter_t, parameters, key_of, as_named, free_names, free_index, name_of_parameter, &
      place_of_name, is_there, get_free, set_free, free_magnitude, magnitude, may_be_negative, &
      belongs_to_hose
   public :: amplitude, offset, positive, not_negative, on_beam, any_value, share

   !> Ranges.
   integer, parameter :: positive = 1, not_negative = 2, on_beam = 3, any_value = 4, share = 5

   !> Of a name as it is printed, that of its sensor or support behind it.
   integer, parameter, public :: name_length = 10 + item_name_length

   !> Places of the amplitude and of the offset, which belongs to the record.
   integer, parameter :: amplitude = n_parameters + 1, offset = amplitude + 1

   !> What moderate values are made of beside the parameters: the mass of beam and tip, the tip's
   !> static stiffness, the first angular frequency.
   integer, parameter :: the_mass = n_parameters + 1, the_stiffness = the_mass + 1, &
      the_omega = the_stiffness + 1

   type :: parameter_t
      integer :: place                !< row
      character(len=9) :: name        !< its key
      character(len=10) :: group      !< of the case file
      integer :: unit(3)              !< exponents of mass, length and time
      integer :: range
      character(len=13) :: default    !< what holds without it; '': it is required
      !> The yardstick of a fit that starts from zero.
      type(monomial_t) :: moderate
      integer :: needs = 0            !< place of a parameter without which it means nothing
      logical :: is_free = .true.     !< whether a fit may free it
      !> Whether a structure holds its reciprocal, and a search looks for that: it may be infinite.
      logical :: is_reciprocal = .false.
      character(len=60) :: help
      integer :: item = 0             !< which of the sensors or supports; 0: none
      character(len=9) :: key = ''    !< in the case file, where that is not its name
   end type parameter_t

   type(monomial_t), parameter :: tenth_of_mass = monomial_t(0.1_wp, [the_mass, 0, 0])

   !> The rows. Moderate masses: a tenth of beam and tip; stiffness: a tenth of the tip's; damping:
   !> one per cent of critical at the first frequency.
   integer :: i
   !> gfortran 12 takes an element, not the index of a loop by itself.
   integer, parameter :: nth(most_coefficients) = [(i, i=1, most_coefficients)]
   type(parameter_t), parameter :: parameters(n_parameters + 2 + 2*most_coefficients) = [ &
      parameter_t(of_m_T, 'm_T', 'tip', [1, 0, 0], not_negative, '0', tenth_of_mass, &
         help='tip mass'), &
      parameter_t(of_E, 'E', 'beam', [1, -1, -2], positive, '', &
         monomial_t(place=[of_E, 0, 0]), help='modulus of elasticity'), &
      parameter_t(of_c_D, 'c_D', 'beam', [1, -1, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [of_E, the_omega, 0], [1, -1, 1]), &
         help='Kelvin-Voigt viscosity'), &
      parameter_t(of_m_H, 'm_H', 'hose', [1, 0, 0], not_negative, '', tenth_of_mass, &
         help='mass of the hose; 0: no hose'), &
      parameter_t(of_c_H, 'c_H', 'hose', [1, 0, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [the_mass, the_omega, 0]), help='its damping'), &
      parameter_t(of_k_H, 'k_H', 'hose', [1, 0, -2], not_negative, '0', &
         monomial_t(0.1_wp, [the_stiffness, 0, 0]), help='its stiffness'), &
      parameter_t(of_rho, 'rho', 'beam', [1, -1, 0], positive, 'density b h', &
         monomial_t(place=[of_rho, 0, 0]), help='mass per unit length'), &
      parameter_t(of_gamma, 'gamma', 'beam', [1, -1, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [of_rho, the_omega, 0]), &
         help='air damping, a force gamma u_t per unit length'), &
      parameter_t(of_J_T, 'J_T', 'tip', [1, 2, 0], not_negative, '0', &
         monomial_t(1e-2_wp, [the_mass, of_length, 0], [1, 2, 1]), &
         help='rotary inertia of the tip mass'), &
      parameter_t(of_kappa_R, 'k_R', 'beam', [1, 2, -2], positive, 'a rigid clamp', &
         monomial_t(0.1_wp, [of_length, of_E, of_I], [1, -1, -1]), needs=of_kappa_R, &
         is_reciprocal=.true., help='torsional spring at the root'), &
      parameter_t(of_c_R, 'c_R', 'beam', [1, 2, -1], not_negative, '0', &
         monomial_t(6e-2_wp, [the_stiffness, of_length, the_omega], [1, 2, -1]), &
         needs=of_kappa_R, &
         help='viscous damper at the root, beside k_R'), &
      parameter_t(of_length, 'length', 'beam', [0, 1, 0], positive, '', &
         monomial_t(place=[of_length, 0, 0]), help='of the beam'), &
      parameter_t(of_I, 'I', 'beam', [0, 4, 0], positive, 'b h^3/12', &
         monomial_t(place=[of_I, 0, 0]), is_free=.false., &
         help='second moment of the cross section'), &
      parameter_t(of_x_F, 'x_F', 'excitation', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[of_length, 0, 0]), help='where a force acts'), &
      parameter_t(of_g, 'g', 'gravity', [0, 1, -2], not_negative, '', &
         monomial_t(5e-2_wp, [the_stiffness, of_length, the_mass], [1, 1, -1]), &
         help='gravity, along the beam'), &
      parameter_t(of_T, 'T', 'axial', [1, 1, -2], any_value, '', &
         monomial_t(5e-2_wp, [the_stiffness, of_length, 0]), key='force', &
         help='in the beam, tension above 0; free as T'), &
      parameter_t(of_x_D, 'place', 'along', [0, 1, 0], on_beam, 'x or a dip', &
         monomial_t(place=[of_length, 0, 0]), help='of the middle of a dip'), &
      parameter_t(of_w_D, 'width', 'along', [0, 1, 0], positive, 'x or a dip', &
         monomial_t(0.1_wp, [of_length, 0, 0]), help='of a dip, a standard deviation, '// &
         'at least half an element'), &
      parameter_t(of_d_D, 'depth', 'along', [0, 0, 0], share, 'x or a dip', &
         monomial_t(0.1_wp), help='of a dip, the share that is missing in its middle'), &
      (parameter_t(m_S_at(i), 'm_S', 'sensor', [1, 0, 0], not_negative, '0', tenth_of_mass, &
         help='mass of the sensor', item=nth(i)), &
      parameter_t(J_S_at(i), 'J_S', 'sensor', [1, 2, 0], not_negative, '0', &
         monomial_t(1e-4_wp, [the_mass, of_length, 0], [1, 2, 1]), &
         help='its rotary inertia', item=nth(i)), &
      parameter_t(x_S_at(i), 'x_S', 'sensor', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[of_length, 0, 0]), &
         help='its place, where the motion is observed', item=nth(i)), i=1, most_sensors), &
      (parameter_t(x_P_at(i), 'x_P', 'support', [0, 1, 0], on_beam, '', &
         monomial_t(place=[of_length, 0, 0]), help='its place', item=nth(i)), &
      parameter_t(kappa_P_at(i), 'k_P', 'support', [1, 0, -2], not_negative, 'rigid', &
         monomial_t(0.1_wp, [the_stiffness, 0, 0], [-1, 1, 1]), needs=kappa_P_at(i), &
         is_reciprocal=.true., help='its stiffness; 0: no spring, a damper alone', item=nth(i)), &
      parameter_t(c_P_at(i), 'c_P', 'support', [1, 0, -1], not_negative, '0', &
         monomial_t(0.2_wp, [the_stiffness, the_omega, 0], [1, -1, 1]), needs=kappa_P_at(i), &
         help='its damping, beside k_P', item=nth(i)), i=1, most_supports), &
      parameter_t(amplitude, 'amplitude', 'excitation', [1, 1, -2], any_value, '', monomial_t(), &
         help='of the force'), &
      parameter_t(offset, 'offset', 'record', [0, 0, 0], any_value, '0', monomial_t(), &
         help='of the sensor, in the unit of the record'), &
      (parameter_t(E_at(i), 'E', 'E(x)', [1, -1, -2], positive, '', &
         monomial_t(place=[of_E, 0, 0]), help='coefficient of E(x)', item=nth(i)), &
      i=1, most_coefficients), &
      (parameter_t(c_D_at(i), 'c_D', 'c_D(x)', [1, -1, -1], positive, '', &
         monomial_t(place=[of_c_D, 0, 0]), needs=of_c_D, help='coefficient of c_D(x)', &
         item=nth(i)), i=1, most_coefficients)]

   !> Every row is where its place says: otherwise this divides by zero.
   integer, parameter :: in_order = 1/merge(1, 0, all(parameters%place == &
      [(i, i=1, size(parameters))]))

   !> Keys of all rows. flang 19 does not evaluate `parameters%name`, the array of a text component.
   character(len=*), parameter :: free_names(size(parameters)) = &
      [(parameters(i)%name, i=1, size(parameters))]

contains

   !> How the case file calls parameter k.
   pure function key_of(k) result(key)
      integer, intent(in) :: k
      character(len=:), allocatable :: key

      key = trim(parameters(k)%name)
      if (parameters(k)%key /= '') key = trim(parameters(k)%key)
   end function key_of

   !> Place of the first row with a key.
   pure integer function free_index(key)
      character(len=*), intent(in) :: key

      do free_index = 1, size(parameters)
         if (parameters(free_index)%is_free .and. lower(trim(parameters(free_index)%name)) &
            == lower(trim(key))) return
      end do
      free_index = 0
   end function free_index

   !> Whether a row means something in a structure: there are as many sensors, one at least, and
   !> supports.
   elemental logical function is_there(structure, k)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k

      is_there = .true.
      if (parameters(k)%group == 'sensor') is_there = parameters(k)%item <= max(1, &
         structure%sensors)
      if (parameters(k)%group == 'support') is_there = parameters(k)%item <= structure%supports
      if (parameters(k)%group == 'along') is_there = structure%has_dip()
      if (is_coefficient(k)) is_there = parameters(k)%item <= &
         structure%variations%along(function_of(k))%coefficients
   end function is_there

   !> Name of parameter k as it is printed: of one of several sensors or supports 'm_S.a', where
   !> that one has a name.
   elemental function name_of_parameter(structure, k) result(name)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      character(len=name_length) :: name

      name = parameters(k)%name
      if (parameters(k)%group == 'sensor' .and. structure%sensors > 1 .or. &
         parameters(k)%group == 'support' .and. structure%supports > 1) &
         name = labelled(structure, k)
      if (is_coefficient(k)) name = trim(name)//'.'//to_text(parameters(k)%item)
   end function name_of_parameter

   !> Place of what a fit may free, by its name in any case, with that of the sensor or support
   !> behind a point where there is more than one; 0 when there is none.
   elemental integer function place_of_name(structure, name) result(place)
      type(structure_t), intent(in) :: structure
      character(len=*), intent(in) :: name

      do place = size(parameters), 1, -1
         if (.not. (parameters(place)%is_free .and. is_there(structure, place))) cycle
         if (lower(trim(name_of_parameter(structure, place))) == lower(trim(name))) return
         ! The only one of its kind may be called by its name all the same.
         if (index(name, '.') < len_trim(name) .and. &
            lower(trim(name)) == lower(trim(labelled(structure, place)))) return
      end do
   end function place_of_name

   !> A name with that of its sensor or support, whether there are others or not.
   pure function labelled(structure, k) result(name)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      character(len=name_length) :: name

      name = parameters(k)%name
      associate (item => parameters(k)%item)
         if (parameters(k)%group == 'sensor') name = trim(name)//'.'//structure%sensor_name(item)
         if (parameters(k)%group == 'support') name = trim(name)//'.'//structure%support_name(item)
      end associate
   end function labelled

   !> Value of parameter k.
   pure real(wp) function get_free(structure, excitation, k) result(value)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: k

      if (k == amplitude) then
         value = excitation%amplitude
      else if (k == offset) then
         value = 0
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
      else if (k /= offset) then
         call structure%set(k, value)
      end if
   end subroutine set_free

   !> The value of parameter k that its name means from the one that a structure holds, or the other
   !> way round: a stiffness and its reciprocal, 0 and infinity.
   elemental real(wp) function as_named(k, value)
      integer, intent(in) :: k
      real(wp), intent(in) :: value

      as_named = value
      if (.not. parameters(k)%is_reciprocal) return
      if (abs(value) >= huge(value)) then
         as_named = 0
      else if (abs(value) > 0) then
         as_named = 1/value
      else
         as_named = ieee_value(value, ieee_positive_inf)
      end if
   end function as_named

   !> What a moderate value of parameter k is.
   pure real(wp) function free_magnitude(structure, excitation, k) result(value)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: k

      value = magnitude(structure, k)
      if (k == amplitude .and. abs(excitation%amplitude) > 0) value = abs(excitation%amplitude)
   end function free_magnitude

   !> What one would call a moderate value of a parameter in this structure.
   pure real(wp) function magnitude(structure, k)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k

      associate (s => structure)
         magnitude = value_of(parameters(k)%moderate, [values_of(s), s%m_T + s%rho*s%length, &
            s%tip_stiffness(), s%omega()])
      end associate
   end function magnitude

   !> Masses, damping and stiffness cannot be negative, a force can.
   elemental logical function may_be_negative(k)
      integer, intent(in) :: k

      may_be_negative = parameters(k)%range == any_value
   end function may_be_negative

   !> m_H, c_H and k_H mean nothing without a hose.
   elemental logical function belongs_to_hose(k)
      integer, intent(in) :: k

      belongs_to_hose = parameters(k)%group == 'hose'
   end function belongs_to_hose

end module beamid_parameters
