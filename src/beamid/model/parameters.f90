!> The table of parameters. Each row holds the properties of one parameter: its name, group in the
!> case file, unit, range, default, typical magnitude and help.
!>
!> Reading, range checks, unit labels, scaling, start values and help follow from the rows.
module beamid_parameters
   use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_value
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_monomials, only: monomial_t, value_of
   use beamid_strings, only: lower
   use beamid_structure, only: c_D_at, c_H_at, c_P_at, c_R_at, c_RP_at, c_w_at, E_at, J_M_at, &
      J_S_at, k_H_at, kappa_P_at, kappa_R_at, kappa_RP_at, kappa_w_at, m_H_at, m_M_at, m_S_at, &
      most_coefficients, most_items, n_parameters, of_a_h, of_b, of_b_h, of_c_D, of_d, of_d_D, &
      of_E, of_eta, of_g, of_gamma, of_I, of_J_T, of_length, of_m_T, of_rho, of_T, of_w_D, &
      of_x_D, of_x_F, structure_t, x_H_at, x_M_at, x_P_at, x_S_at
   implicit none
   private

   public :: parameter_t, parameters, key_of, as_named, free_names, free_index, get_free, &
      set_free, free_magnitude, magnitude, may_be_negative, belongs_to_hose
   public :: amplitude, offset, positive, not_negative, on_beam, any_value, share

   !> Allowed ranges of a parameter: > 0; >= 0; a position, 0 < x <= length; any value; a share,
   !> 0 <= value < 1.
   integer, parameter :: positive = 1, not_negative = 2, on_beam = 3, any_value = 4, share = 5

   !> Numbers of two parameters that are not components of a structure: the amplitude of the
   !> excitation, and the offset of a record.
   integer, parameter :: amplitude = n_parameters + 1, offset = amplitude + 1

   !> Quantities that moderate values are made of, in addition to the parameters: the mass of beam
   !> and tip, the static stiffness of the tip, and the first natural angular frequency.
   integer, parameter :: the_mass = n_parameters + 1, the_stiffness = the_mass + 1, &
      the_omega = the_stiffness + 1

   !> Length of a name without that of an attachment.
   integer, parameter :: symbol_length = 9

   !> One row of the table.
   type :: parameter_t
      integer :: place                !< number of the parameter, equal to the number of the row
      character(len=symbol_length) :: name   !< name in fits and reports
      character(len=10) :: group      !< group of the case file
      integer :: unit(3)              !< exponents of mass, length and time in its unit
      integer :: range                !< allowed range: `positive` .. `share`
      character(len=20) :: default    !< default, as text for the help; '': required
      !> Moderate value: the scale of a fit that starts from zero, [unit of the parameter].
      type(monomial_t) :: moderate
      !> number of another parameter without which this one has no effect; 0: none
      integer :: needs = 0
      !> number of a parameter that must not be 0 for a fit to estimate this one, because it has no
      !> effect then; 0: none
      integer :: modifies = 0
      logical :: is_free = .true.     !< whether a fit may estimate it
      !> Whether a structure holds its reciprocal, for which a fit searches: the parameter may be
      !> infinite (a rigid spring).
      logical :: is_reciprocal = .false.
      character(len=80) :: help       !< line of help
      integer :: item = 0             !< number of its attachment, end or coefficient; 0: none
      character(len=symbol_length) :: key = '' !< key in the case file, if it differs from the name
   end type parameter_t

   !> Moderate value of a mass.
   type(monomial_t), parameter :: tenth_of_mass = monomial_t(0.1_wp, [the_mass, 0, 0])

   !> The table. A moderate mass is a tenth of the mass of beam and tip; a moderate stiffness is a
   !> tenth of the tip's static stiffness; moderate damping is one per cent of critical damping at
   !> the first natural frequency.
   integer :: i
   !> `nth(i)` is i. gfortran 12 accepts an array element as a component of a constructor, but not
   !> the index of an implied loop.
   integer, parameter :: nth(most_coefficients) = [(i, i=1, most_coefficients)]
   type(parameter_t), parameter :: rows(n_parameters + 2 + 2*most_coefficients) = [ &
      parameter_t(of_m_T, 'm_T', 'tip', [1, 0, 0], not_negative, '0', tenth_of_mass, &
         help='mass at the tip'), &
      parameter_t(of_E, 'E', 'beam', [1, -1, -2], positive, '', &
         monomial_t(place=[of_E, 0, 0]), help='modulus of elasticity'), &
      parameter_t(of_c_D, 'c_D', 'beam', [1, -1, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [of_E, the_omega, 0], [1, -1, 1]), &
         help='Kelvin-Voigt viscosity'), &
      parameter_t(of_rho, 'rho', 'beam', [1, -1, 0], positive, 'density*width*height', &
         monomial_t(place=[of_rho, 0, 0]), help='mass per unit length'), &
      parameter_t(of_gamma, 'gamma', 'beam', [1, -1, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [of_rho, the_omega, 0]), &
         help='air damping, a force gamma u_t per unit length'), &
      parameter_t(of_J_T, 'J_T', 'tip', [1, 2, 0], not_negative, '0', &
         monomial_t(1e-2_wp, [the_mass, of_length, 0], [1, 2, 1]), &
         help='rotary inertia of the tip mass'), &
      parameter_t(of_length, 'length', 'beam', [0, 1, 0], positive, '', &
         monomial_t(place=[of_length, 0, 0]), help='length of the beam'), &
      parameter_t(of_I, 'I', 'beam', [0, 4, 0], positive, 'width*height^3/12', &
         monomial_t(place=[of_I, 0, 0]), is_free=.false., &
         help='second moment of area of the cross section'), &
      parameter_t(of_x_F, 'x_F', 'excitation', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[of_length, 0, 0]), help='position of the force'), &
      parameter_t(of_g, 'g', 'gravity', [0, 1, -2], not_negative, '', &
         monomial_t(5e-2_wp, [the_stiffness, of_length, the_mass], [1, 1, -1]), &
         help='acceleration of gravity'), &
      parameter_t(of_T, 'T', 'axial', [1, 1, -2], any_value, '', &
         monomial_t(5e-2_wp, [the_stiffness, of_length, 0]), key='force', &
         help='axial force, positive in tension; its symbol is T'), &
      parameter_t(of_eta, 'eta', 'beam', [0, 0, 0], not_negative, '0', monomial_t(2e-2_wp), &
         help='loss factor of bending: the modulus is E(1 + i eta); not in time'), &
      parameter_t(of_a_h, 'a_h', 'beam', [1, 1, -1], not_negative, '0', &
         monomial_t(place=[the_stiffness, of_length, the_omega], power=[1, 1, -1]), &
         needs=of_b_h, help='strength of spatial hysteresis, a damping between distant sections'), &
      parameter_t(of_b_h, 'b_h', 'beam', [0, 1, 0], not_negative, '0', &
         monomial_t(0.1_wp, [of_length, 0, 0]), modifies=of_a_h, &
         help='range of spatial hysteresis, the standard deviation of its kernel; needs a_h'), &
      parameter_t(of_d(1), 'd_1', 'beam', [0, 0, 0], not_negative, '0', monomial_t(5e-2_wp), &
         needs=of_b(1), modifies=of_d(1), &
         help='strength of time hysteresis: E(1 + d_1 s/(s + b_1)) for motions like e^(s t)'), &
      parameter_t(of_b(1), 'b_1', 'beam', [0, 0, -1], not_negative, '0', &
         monomial_t(place=[the_omega, 0, 0]), modifies=of_d(1), &
         help='relaxation rate of time hysteresis'), &
      parameter_t(of_d(2), 'd_2', 'beam', [0, 0, 0], not_negative, '0', monomial_t(5e-2_wp), &
         needs=of_b(2), modifies=of_d(2), help='strength of the second relaxation'), &
      parameter_t(of_b(2), 'b_2', 'beam', [0, 0, -1], not_negative, '0', &
         monomial_t(10.0_wp, [the_omega, 0, 0]), modifies=of_d(2), &
         help='rate of the second relaxation'), &
      parameter_t(of_x_D, 'place', 'along', [0, 1, 0], on_beam, 'x or a dip', &
         monomial_t(place=[of_length, 0, 0]), help='position of the middle of the dip'), &
      parameter_t(of_w_D, 'width', 'along', [0, 1, 0], positive, 'x or a dip', &
         monomial_t(0.1_wp, [of_length, 0, 0]), help='standard deviation of the dip, '// &
         'at least half an element'), &
      parameter_t(of_d_D, 'depth', 'along', [0, 0, 0], share, 'x or a dip', &
         monomial_t(0.1_wp), help='share of E that is missing in the middle of the dip'), &
      (parameter_t(kappa_w_at(i), 'k_w', 'end', [1, 0, -2], not_negative, 'of the kind', &
         monomial_t(0.1_wp, [the_stiffness, 0, 0], [-1, 1, 1]), &
         is_reciprocal=.true., help='stiffness of the spring that holds the deflection of the '// &
         'end', item=nth(i)), &
      parameter_t(c_w_at(i), 'c_w', 'end', [1, 0, -1], not_negative, '0', &
         monomial_t(0.2_wp, [the_stiffness, the_omega, 0], [1, -1, 1]), needs=kappa_w_at(i), &
         help='damping coefficient of the deflection of the end', item=nth(i)), &
      parameter_t(kappa_R_at(i), 'k_R', 'end', [1, 2, -2], not_negative, 'of the kind', &
         monomial_t(0.1_wp, [of_length, of_E, of_I], [1, -1, -1]), &
         is_reciprocal=.true., help='stiffness of the spring that holds the rotation of the end', &
         item=nth(i)), &
      parameter_t(c_R_at(i), 'c_R', 'end', [1, 2, -1], not_negative, '0', &
         monomial_t(6e-2_wp, [the_stiffness, of_length, the_omega], [1, 2, -1]), &
         needs=kappa_R_at(i), help='damping coefficient of the rotation of the end', &
         item=nth(i)), i=1, 2), &
      (parameter_t(m_S_at(i), 'm_S', 'sensor', [1, 0, 0], not_negative, '0', tenth_of_mass, &
         help='mass of the sensor', item=nth(i)), &
      parameter_t(J_S_at(i), 'J_S', 'sensor', [1, 2, 0], not_negative, '0', &
         monomial_t(1e-4_wp, [the_mass, of_length, 0], [1, 2, 1]), &
         help='rotary inertia of the sensor', item=nth(i)), &
      parameter_t(x_S_at(i), 'x_S', 'sensor', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[of_length, 0, 0]), &
         help='position of the sensor, where the motion is observed', item=nth(i)), &
      i=1, most_items), &
      (parameter_t(x_P_at(i), 'x_P', 'support', [0, 1, 0], on_beam, '', &
         monomial_t(place=[of_length, 0, 0]), help='position of the support', item=nth(i)), &
      parameter_t(kappa_P_at(i), 'k_P', 'support', [1, 0, -2], not_negative, 'rigid', &
         monomial_t(0.1_wp, [the_stiffness, 0, 0], [-1, 1, 1]), &
         is_reciprocal=.true., help='stiffness of the support; 0: a damper alone', item=nth(i)), &
      parameter_t(c_P_at(i), 'c_P', 'support', [1, 0, -1], not_negative, '0', &
         monomial_t(0.2_wp, [the_stiffness, the_omega, 0], [1, -1, 1]), needs=kappa_P_at(i), &
         help='damping coefficient of the support, beside k_P', item=nth(i)), &
      parameter_t(kappa_RP_at(i), 'k_RP', 'support', [1, 2, -2], not_negative, '0', &
         monomial_t(0.1_wp, [of_length, of_E, of_I], [1, -1, -1]), &
         is_reciprocal=.true., key='k_R', &
         help='stiffness of the support against rotation; inf: rigid', item=nth(i)), &
      parameter_t(c_RP_at(i), 'c_RP', 'support', [1, 2, -1], not_negative, '0', &
         monomial_t(6e-2_wp, [the_stiffness, of_length, the_omega], [1, 2, -1]), &
         needs=kappa_RP_at(i), key='c_R', &
         help='damping coefficient of the support against rotation', item=nth(i)), &
      i=1, most_items), &
      (parameter_t(m_M_at(i), 'm_M', 'mass', [1, 0, 0], not_negative, '', tenth_of_mass, &
         help='mass on the beam', item=nth(i), key='m'), &
      parameter_t(J_M_at(i), 'J_M', 'mass', [1, 2, 0], not_negative, '0', &
         monomial_t(1e-4_wp, [the_mass, of_length, 0], [1, 2, 1]), &
         help='rotary inertia of the mass', item=nth(i), key='J'), &
      parameter_t(x_M_at(i), 'x_M', 'mass', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[of_length, 0, 0]), &
         help='position of the mass', item=nth(i), key='x'), i=1, most_items), &
      (parameter_t(m_H_at(i), 'm_H', 'hose', [1, 0, 0], not_negative, '', tenth_of_mass, &
         help='mass of the hose; 0: no hose', item=nth(i)), &
      parameter_t(c_H_at(i), 'c_H', 'hose', [1, 0, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [the_mass, the_omega, 0]), &
         help='damping coefficient between beam and hose', item=nth(i)), &
      parameter_t(k_H_at(i), 'k_H', 'hose', [1, 0, -2], not_negative, '0', &
         monomial_t(0.1_wp, [the_stiffness, 0, 0]), help='stiffness between beam and hose', &
         item=nth(i)), &
      parameter_t(x_H_at(i), 'x_H', 'hose', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[of_length, 0, 0]), &
         help='position of the hose on the beam', item=nth(i)), i=1, most_items), &
      parameter_t(amplitude, 'amplitude', 'excitation', [1, 1, -2], any_value, '', monomial_t(), &
         help='amplitude of a pulse or a release; factor of a table or of a base motion'), &
      parameter_t(offset, 'offset', 'record', [0, 0, 0], any_value, '0', monomial_t(), &
         help='offset of the sensor, in the unit of the record'), &
      (parameter_t(E_at(i), 'E', 'E(x)', [1, -1, -2], positive, '', &
         monomial_t(place=[of_E, 0, 0]), help='coefficient of E(x)', item=nth(i)), &
      i=1, most_coefficients), &
      (parameter_t(c_D_at(i), 'c_D', 'c_D(x)', [1, -1, -1], positive, '', &
         monomial_t(place=[of_c_D, 0, 0]), needs=of_c_D, help='coefficient of c_D(x)', &
         item=nth(i)), i=1, most_coefficients)]

   !> Checks at compile time that every row stands at its number: otherwise this divides by zero.
   integer, parameter :: in_order = 1/merge(1, 0, all(rows%place == [(i, i=1, size(rows))]))

   !> The table, as a variable: the compiler would copy a constant into every object that uses it.
   type(parameter_t), protected :: parameters(size(rows)) = rows

contains

   !> Returns the name of parameter k, without that of an attachment.
   elemental function free_names(k) result(name)
      integer, intent(in) :: k
      character(len=symbol_length) :: name

      name = parameters(k)%name
   end function free_names

   !> Returns the key of parameter k in the case file.
   pure function key_of(k) result(key)
      integer, intent(in) :: k
      character(len=len_trim(merge(parameters(k)%key, parameters(k)%name, parameters(k)%key /= &
         ''))) :: key

      key = merge(parameters(k)%key, parameters(k)%name, parameters(k)%key /= '')
   end function key_of

   !> Returns the number of the first parameter of a name (in any case) that a fit may estimate, or
   !> 0.
   pure integer function free_index(key)
      character(len=*), intent(in) :: key

      do free_index = 1, size(parameters)
         if (parameters(free_index)%is_free .and. lower(trim(parameters(free_index)%name)) &
            == lower(trim(key))) return
      end do
      free_index = 0
   end function free_index

   !> Returns the value of parameter k, which may be the amplitude; the offset is returned as 0.
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

   !> Sets parameter k, which may be the amplitude, to a value; the offset is ignored.
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

   !> Converts a value of parameter k between the quantity that the user names (a stiffness) and the
   !> quantity that the structure holds (its compliance), in either direction. 0 becomes infinity,
   !> and infinity or `huge` becomes 0. Values of all other parameters are returned unchanged.
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

   !> Returns a moderate value of parameter k, which may be the amplitude: then its own modulus.
   pure real(wp) function free_magnitude(structure, excitation, k) result(value)
      type(structure_t), intent(in) :: structure
      type(excitation_t), intent(in) :: excitation
      integer, intent(in) :: k

      value = magnitude(structure, k)
      if (k == amplitude .and. abs(excitation%amplitude) > 0) value = abs(excitation%amplitude)
   end function free_magnitude

   !> Returns the moderate value of parameter k in a structure, as the table defines it.
   pure real(wp) function magnitude(structure, k)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k

      real(wp) :: q(n_parameters + 3)
      integer :: place(3), i

      place = parameters(k)%moderate%place
      associate (s => structure)
         do i = 1, size(place)
            if (place(i) >= 1 .and. place(i) <= n_parameters) q(place(i)) = s%get(place(i))
         end do
         q(n_parameters + 1:) = [s%m_T + s%rho*s%length, 0.0_wp, 0.0_wp]
         if (any(place == n_parameters + 2)) q(n_parameters + 2) = s%tip_stiffness()
         if (any(place == n_parameters + 3)) q(n_parameters + 3) = s%omega()
         magnitude = value_of(parameters(k)%moderate, q)
      end associate
   end function magnitude

   !> Returns whether parameter k may be negative (a force or an offset).
   elemental logical function may_be_negative(k)
      integer, intent(in) :: k

      may_be_negative = parameters(k)%range == any_value
   end function may_be_negative

   !> Returns whether parameter k has no effect without a hose (m_H, c_H and k_H).
   elemental logical function belongs_to_hose(k)
      integer, intent(in) :: k

      belongs_to_hose = parameters(k)%group == 'hose'
   end function belongs_to_hose

end module beamid_parameters
