!> The table of parameters: everything that is known of each of them, a row for one.
module beamid_parameters
   use beamid_errors, only: error_t, bad_input
   use beamid_excitation, only: excitation_t
   use beamid_kinds, only: wp
   use beamid_monomials, only: monomial_t, value_of
   use beamid_strings, only: lower, to_text
   use beamid_structure, only: n_parameters, of, structure_t, values_of
   implicit none
   private

   public :: parameter_t, parameters, parameter_names, free_names, free_index, get_free, set_free, &
      free_magnitude, magnitude, may_be_negative, belongs_to_hose, check_structure
   public :: amplitude, offset, positive, not_negative, on_beam, any_value

   !> Ranges.
   integer, parameter :: positive = 1, not_negative = 2, on_beam = 3, any_value = 4

   !> Places of the amplitude and of the offset, which belongs to the record.
   integer, parameter :: amplitude = n_parameters + 1, offset = amplitude + 1

   !> What moderate values are made of beside the parameters: the mass of beam and tip, the tip's
   !> static stiffness, the first angular frequency.
   integer, parameter :: the_mass = n_parameters + 1, the_stiffness = the_mass + 1, &
      the_omega = the_stiffness + 1

   type :: parameter_t
      integer :: place                !< row
      character(len=9) :: name        !< as it is printed, and its key
      character(len=10) :: group      !< of the case file
      integer :: unit(3)              !< exponents of mass, length and time
      integer :: range
      character(len=13) :: default    !< what holds without it; '': it is required
      !> The yardstick of a fit that starts from zero.
      type(monomial_t) :: moderate
      integer :: needs = 0            !< place of a parameter without which it means nothing
      logical :: is_free = .true.     !< whether a fit may free it
      character(len=60) :: help
   end type parameter_t

   type(monomial_t), parameter :: tenth_of_mass = monomial_t(0.1_wp, [the_mass, 0, 0])

   !> The rows. Moderate masses: a tenth of beam and tip; stiffness: a tenth of the tip's; damping:
   !> one per cent of critical at the first frequency.
   type(parameter_t), parameter :: parameters(n_parameters + 2) = [ &
      parameter_t(nint(of%m_T), 'm_T', 'tip', [1, 0, 0], not_negative, '0', tenth_of_mass, &
         help='tip mass'), &
      parameter_t(nint(of%E), 'E', 'beam', [1, -1, -2], positive, '', &
         monomial_t(place=[nint(of%E), 0, 0]), help='modulus of elasticity'), &
      parameter_t(nint(of%c_D), 'c_D', 'beam', [1, -1, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [nint(of%E), the_omega, 0], [1, -1, 1]), &
         help='Kelvin-Voigt viscosity'), &
      parameter_t(nint(of%m_H), 'm_H', 'hose', [1, 0, 0], not_negative, '', tenth_of_mass, &
         help='mass of the hose; 0: no hose'), &
      parameter_t(nint(of%c_H), 'c_H', 'hose', [1, 0, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [the_mass, the_omega, 0]), help='its damping'), &
      parameter_t(nint(of%k_H), 'k_H', 'hose', [1, 0, -2], not_negative, '0', &
         monomial_t(0.1_wp, [the_stiffness, 0, 0]), help='its stiffness'), &
      parameter_t(nint(of%rho), 'rho', 'beam', [1, -1, 0], positive, '', &
         monomial_t(place=[nint(of%rho), 0, 0]), help='mass per unit length'), &
      parameter_t(nint(of%gamma), 'gamma', 'beam', [1, -1, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [nint(of%rho), the_omega, 0]), &
         help='air damping, a force gamma u_t per unit length'), &
      parameter_t(nint(of%J_T), 'J_T', 'tip', [1, 2, 0], not_negative, '0', &
         monomial_t(1e-2_wp, [the_mass, nint(of%length), 0], [1, 2, 1]), &
         help='rotary inertia of the tip mass'), &
      parameter_t(nint(of%k_R), 'k_R', 'beam', [1, 2, -2], positive, 'a rigid clamp', &
         monomial_t(10.0_wp, [nint(of%E), nint(of%I), nint(of%length)], [1, 1, -1]), &
         needs=nint(of%k_R), help='torsional spring at the root'), &
      parameter_t(nint(of%c_R), 'c_R', 'beam', [1, 2, -1], not_negative, '0', &
         monomial_t(2e-2_wp, [nint(of%k_R), the_omega, 0], [1, -1, 1]), needs=nint(of%k_R), &
         help='viscous damper at the root, beside k_R'), &
      parameter_t(nint(of%m_S), 'm_S', 'sensor', [1, 0, 0], not_negative, '0', tenth_of_mass, &
         help='mass of the sensor'), &
      parameter_t(nint(of%x_S), 'x_S', 'sensor', [0, 1, 0], on_beam, 'the tip', &
         monomial_t(place=[nint(of%length), 0, 0]), &
         help='its place, where the motion is observed'), &
      parameter_t(nint(of%length), 'length', 'beam', [0, 1, 0], positive, '', &
         monomial_t(place=[nint(of%length), 0, 0]), is_free=.false., help='of the beam'), &
      parameter_t(nint(of%I), 'I', 'beam', [0, 4, 0], positive, 'b h^3/12', &
         monomial_t(place=[nint(of%I), 0, 0]), is_free=.false., &
         help='second moment of the cross section'), &
      parameter_t(amplitude, 'amplitude', 'excitation', [1, 1, -2], any_value, '', monomial_t(), &
         help='of the force'), &
      parameter_t(offset, 'offset', 'record', [0, 0, 0], any_value, '0', monomial_t(), &
         help='of the sensor, in the unit of the record')]

   !> Every row is where its place says: otherwise this divides by zero.
   integer :: k
   integer, parameter :: in_order = 1/merge(1, 0, all(parameters%place == &
      [(k, k=1, size(parameters))]))

   !> Names as they are printed; those of a structure alone, and all.
   character(len=*), parameter :: parameter_names(n_parameters) = parameters(:n_parameters)%name, &
      free_names(size(parameters)) = parameters%name

contains

   !> Place of what a fit may free, by its name in any case; 0 when there is none.
   pure integer function free_index(name)
      character(len=*), intent(in) :: name

      do free_index = size(parameters), 1, -1
         if (parameters(free_index)%is_free .and. &
            lower(trim(free_names(free_index))) == lower(trim(name))) return
      end do
   end function free_index

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
      else if (k <= n_parameters) then
         call structure%set(k, value)
      end if
   end subroutine set_free

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
            s%stiffness(), s%omega()])
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

   !> Refuses values outside the physical ranges; the message starts with the name of the parameter.
   subroutine check_structure(structure, error)
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer :: k

      do k = 1, n_parameters
         call check_range(structure, k, error)
         if (.not. allocated(error)) call check_company(structure, k, error)
         if (allocated(error)) return
      end do
      ! Each is in range, but the whole may be out of what numbers can hold.
      if (.not. (structure%omega() > 0 .and. structure%omega() < huge(1.0_wp))) call bad_input( &
         error, 'E: found a structure whose first frequency is '//to_text(structure%omega())// &
         ', expected a finite one above 0')
   end subroutine check_structure

   subroutine check_range(structure, k, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error
      character(len=:), allocatable :: expected
      real(wp) :: value

      value = structure%get(k)
      select case (parameters(k)%range)
      case (positive)
         if (.not. value > 0) expected = 'a value above 0'
      case (not_negative)
         if (.not. value >= 0) expected = '0 or more'
      case (on_beam)
         if (.not. (value > 0 .and. value <= structure%length) .and. structure%length > 0) &
            expected = 'a place above 0, up to the length '//to_text(structure%length)
      end select
      if (allocated(expected)) call bad_input(error, trim(parameters(k)%name)//': found '// &
         to_text(value)//', expected '//expected)
   end subroutine check_range

   !> Refuses a value that means nothing without another one.
   subroutine check_company(structure, k, error)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: k
      type(error_t), allocatable, intent(out) :: error

      associate (needs => parameters(k)%needs)
         if (needs == 0 .or. needs == k) return
         if (structure%get(k) > 0 .and. .not. structure%is_given(needs)) call bad_input(error, &
            trim(parameters(k)%name)//': found a value without '//trim(parameters(needs)%name)// &
            ', expected both')
      end associate
   end subroutine check_company

end module beamid_parameters
