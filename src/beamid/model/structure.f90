!> The structure: a beam with everything attached to it, described by the values of its parameters.
!>
!> The structure of Figure 2.3 is a clamped beam with Kelvin-Voigt damping, a tip mass, and a hose
!> modelled as a mass on a dashpot and a spring at the tip; its parameters are
!> q = (m_T, E, c_D, m_H, c_H, k_H) of Section 2. A beam on a test bench may also have air damping,
!> rotary inertia at the tip, other conditions at its ends (each end clamped, pinned, guided, free
!> or elastic), its own weight, and an axial force. At any position it may have attachments:
!> sensors with mass, supports, masses, and hoses (oscillators).
!>
!> `beamid_parameters` describes each parameter (name, unit, range, help), and `beamid_terms` states
!> how the parameters enter M, C, K and F. This module also computes static deflections.
module beamid_structure
   use beamid_columns, only: column_buckles, column_deflection, column_spring_t, column_t, &
      new_column
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_sorting, only: sort_by
   use beamid_variations, only: field_modulus, field_t, field_viscosity, variations_t
   implicit none
   private

   public :: structure_t, same_structure, values_of, is_coefficient, function_of, yielding

   !> Value of a position that the user has not given; the position is then the tip.
   real(wp), parameter, public :: at_tip = -1

   !> Compliance of a support or of an end without a spring.
   real(wp), parameter, public :: no_spring = huge(1.0_wp)
   !> Largest number of attachments of each kind.
   integer, parameter, public :: most_items = 20
   !> Length of the name of an attachment.
   integer, parameter, public :: item_name_length = 12

   !> A sensor (accelerometer) on the beam.
   type, public :: sensor_t
      real(wp) :: m_S = 0            !< mass [mass]
      real(wp) :: J_S = 0            !< rotary inertia [mass length**2]
      real(wp) :: x_S = at_tip       !< position, where the motion is observed [length]
   end type sensor_t

   !> A support: springs and dashpots between the beam and the ground, for the deflection and for
   !> the rotation. A compliance of 0 is a rigid connection, `no_spring` none or a dashpot alone.
   type, public :: support_t
      real(wp) :: x_P = 0            !< position [length]
      real(wp) :: kappa_P = 0        !< compliance of the deflection, 1/k_P [length/force]
      real(wp) :: c_P = 0            !< damping coefficient of the deflection [mass/time]
      !> compliance of the rotation, 1/k_RP [1/(force length)]
      real(wp) :: kappa_RP = no_spring
      real(wp) :: c_RP = 0           !< damping coefficient of the rotation [force length time]
   end type support_t

   !> A mass on the beam.
   type, public :: mass_t
      real(wp) :: m_M = 0            !< mass [mass]
      real(wp) :: J_M = 0            !< rotary inertia [mass length**2]
      real(wp) :: x_M = at_tip       !< position [length]
   end type mass_t

   !> A hose: a mass on a dashpot and a spring, an oscillator. Without a mass there is no hose.
   type, public :: hose_t
      real(wp) :: m_H = 0            !< mass [mass]
      real(wp) :: c_H = 0            !< damping coefficient [mass/time]
      real(wp) :: k_H = 0            !< stiffness [force/length]
      real(wp) :: x_H = at_tip       !< position on the beam [length]
   end type hose_t

   !> The conditions at an end of the beam: springs and dashpots between the beam and what holds it,
   !> which a base that moves carries along. A compliance of 0 is a rigid condition, `no_spring` a
   !> free end.
   type, public :: end_t
      real(wp) :: kappa_w = 0        !< compliance of the deflection, 1/k_w [length/force]
      real(wp) :: c_w = 0            !< damping coefficient of the deflection [mass/time]
      real(wp) :: kappa_R = 0        !< compliance of the rotation, 1/k_R [1/(force length)]
      real(wp) :: c_R = 0            !< damping coefficient of the rotation [force length time]
   end type end_t

   !> An end that nothing holds.
   type(end_t), parameter, public :: free_end = end_t(kappa_w=no_spring, kappa_R=no_spring)

   !> The two ends, and the two quantities that each may hold: arrays over conditions and ends are
   !> indexed (condition, end).
   integer, parameter, public :: root = 1, tip = 2, deflection = 1, rotation = 2

   !> The values of the parameters that belong to no attachment, in any consistent set of units.
   !> Every component is of kind real(wp); the order of the components defines the number of each
   !> parameter (see `values_of`).
   type :: beam_values_t
      real(wp) :: m_T = 0            !< tip mass [mass]
      real(wp) :: E = 0              !< modulus of elasticity [force/length**2]
      real(wp) :: c_D = 0            !< Kelvin-Voigt viscosity [force time/length**2]
      real(wp) :: rho = 0            !< mass per unit length [mass/length]
      real(wp) :: gamma = 0          !< air damping, a force gamma u_t per length [mass/length/time]
      real(wp) :: J_T = 0            !< rotary inertia at the tip [mass length**2]
      real(wp) :: length = 0         !< length l of the beam [length]
      real(wp) :: I = 0              !< second moment of area of the cross section [length**4]
      real(wp) :: x_F = at_tip       !< position where a force acts [length]
      real(wp) :: g = 0              !< acceleration of gravity, along the beam [length/time**2]
      real(wp) :: T = 0              !< axial force, tension > 0 [force]
      real(wp) :: eta = 0            !< loss factor: the modulus is E (1 + i eta) [1]
      real(wp) :: a_h = 0            !< strength of spatial hysteresis [force time]
      real(wp) :: b_h = 0            !< range of spatial hysteresis, a standard deviation [length]
      !> strength [1] and rate [1/time] of two relaxations of the modulus, E (1 + sum d s/(s + b))
      real(wp) :: d_1 = 0, b_1 = 0, d_2 = 0, b_2 = 0
      real(wp) :: x_D = 0            !< centre of a local reduction (dip) of the stiffness [length]
      real(wp) :: w_D = 0            !< width of the dip, a standard deviation [length]; 0: no dip
      real(wp) :: d_D = 0            !< depth of the dip, as a share of E [1]
      !> conditions at root and tip
      type(end_t) :: end(2) = [end_t(), free_end]
   end type beam_values_t

   !> The values of all parameters: those of the attachments follow.
   type, extends(beam_values_t) :: values_t
      !> the sensors; `structure_t%sensors` exist, but at least one
      type(sensor_t) :: sensor(most_items) = sensor_t()
      !> the supports; `structure_t%supports` exist
      type(support_t) :: support(most_items) = support_t()
      !> the masses; `structure_t%masses` exist
      type(mass_t) :: mass(most_items) = mass_t()
      !> the hoses; `structure_t%hoses` exist, but at least one, whose mass may be 0
      type(hose_t) :: hose(most_items) = hose_t()
   end type values_t

   !> The values of the parameters together with the settings that are not parameters.
   type, extends(values_t) :: structure_t
      integer :: sensors = 0         !< number of sensors
      integer :: supports = 0        !< number of supports
      integer :: masses = 0          !< number of masses
      integer :: hoses = 0           !< number of hoses
      integer :: observer = 1        !< number of the sensor whose motion is observed
      !> .true.: the beam stands on its root, so that its weight compresses it; .false.: it hangs
      logical :: stands = .false.
      !> (condition, end) whether a fit estimates the compliance, which may become 0 in the search
      logical :: yields(2, 2) = .false.
      !> (end) whether the case describes the end by a group of its own; the names of the parameters
      !> of such a root end with '.root'
      logical :: described(2) = .false.
      !> names of the attachments
      character(len=item_name_length), dimension(most_items) :: sensor_name = '', &
         support_name = '', mass_name = '', hose_name = ''
      !> variation of the properties along the beam
      type(variations_t) :: variations = variations_t()
   contains
      procedure :: has_hose, essential, has_end_spring, has_spring, rigid_supports, items, place, &
         follows_tip, sensor_place, get, set, stiffness, stiffening, static_deflection, &
         tip_stiffness, omega, total_mass, axial_load, buckles, rigid_body_modes, zero_roots, &
         has_dip, has_fields, factors, factor_slopes
   end type structure_t

   !> Number of all parameters, and number of those that belong to no attachment.
   integer, parameter, public :: n_parameters = storage_size(values_t())/storage_size(1.0_wp)
   integer, parameter :: n_beam = storage_size(beam_values_t())/storage_size(1.0_wp)
   !> Number of values of each attachment, in the order of `values_t`.
   integer, parameter :: n_of(4) = [storage_size(sensor_t()), storage_size(support_t()), &
      storage_size(mass_t()), storage_size(hose_t())]/storage_size(1.0_wp)

   !> Values in a row: as which `transfer` copies them. (An array would be allocated each time.)
   type :: all_numbers_t
      real(wp) :: q(n_parameters) = 0
   end type all_numbers_t
   type :: numbers_t
      real(wp) :: q(n_beam) = 0
   end type numbers_t

   !> Numbers of the parameters. Every component of `of` holds its own position in `values_t`.
   integer :: i
   type(values_t), parameter :: of = transfer([(real(i, wp), i=1, n_parameters)], values_t())
   integer, parameter, public :: of_m_T = nint(of%m_T), of_E = nint(of%E), &
      of_c_D = nint(of%c_D), of_rho = nint(of%rho), of_gamma = nint(of%gamma), &
      of_eta = nint(of%eta), of_J_T = nint(of%J_T), &
      of_length = nint(of%length), of_I = nint(of%I), of_x_F = nint(of%x_F), &
      of_g = nint(of%g), of_T = nint(of%T), of_a_h = nint(of%a_h), of_b_h = nint(of%b_h), &
      of_d(2) = nint([of%d_1, of%d_2]), of_b(2) = nint([of%b_1, of%b_2]), &
      of_x_D = nint(of%x_D), of_w_D = nint(of%w_D), of_d_D = nint(of%d_D)
   !> Numbers of the parameters of each end, (end) and (condition, end).
   integer, parameter, public :: kappa_w_at(2) = [nint(of%end(1)%kappa_w), &
      nint(of%end(2)%kappa_w)], c_w_at(2) = kappa_w_at + 1, kappa_R_at(2) = kappa_w_at + 2, &
      c_R_at(2) = kappa_w_at + 3, of_kappa_R = kappa_R_at(1), of_c_R = c_R_at(1), &
      compliance_at(2, 2) = reshape([kappa_w_at(1), kappa_R_at(1), kappa_w_at(2), kappa_R_at(2)], &
      [2, 2])
   !> Numbers of the parameters of each sensor, support, mass and hose.
   integer, parameter, public :: m_S_at(most_items) = nint(of%sensor%m_S), &
      J_S_at(most_items) = m_S_at + 1, x_S_at(most_items) = m_S_at + 2, &
      x_P_at(most_items) = nint(of%support%x_P), kappa_P_at(most_items) = x_P_at + 1, &
      c_P_at(most_items) = x_P_at + 2, kappa_RP_at(most_items) = x_P_at + 3, &
      c_RP_at(most_items) = x_P_at + 4, m_M_at(most_items) = nint(of%mass%m_M), &
      J_M_at(most_items) = m_M_at + 1, x_M_at(most_items) = m_M_at + 2, &
      m_H_at(most_items) = nint(of%hose%m_H), c_H_at(most_items) = m_H_at + 1, &
      k_H_at(most_items) = m_H_at + 2, x_H_at(most_items) = m_H_at + 3
   !> Largest number of coefficients of E(x) and of c_D(x), and the numbers of these parameters,
   !> which follow the amplitude and the offset of `beamid_parameters`.
   integer, parameter, public :: most_coefficients = 64, &
      E_at(most_coefficients) = [(n_parameters + 2 + i, i=1, most_coefficients)], &
      c_D_at(most_coefficients) = E_at + most_coefficients, &
      coefficient_at(most_coefficients, 2) = reshape([E_at, c_D_at], [most_coefficients, 2])
   !> The parameter whose value all coefficients of E(x), or of c_D(x), have before a fit.
   integer, parameter :: common_of(2) = [of_E, of_c_D]
   !> Numbers of the parameters of the first sensor and of the first hose.
   integer, parameter, public :: of_m_S = m_S_at(1), of_J_S = J_S_at(1), of_x_S = x_S_at(1), &
      of_m_H = m_H_at(1), of_c_H = c_H_at(1), of_k_H = k_H_at(1), of_x_H = x_H_at(1)

contains

   !> Returns the values of all parameters, indexed by parameter number.
   pure function values_of(structure) result(q)
      type(structure_t), intent(in) :: structure
      real(wp) :: q(n_parameters)
      type(all_numbers_t) :: row

      row = transfer(structure%values_t, row)
      q = row%q
   end function values_of

   !> Returns whether parameter k is a coefficient of E(x) or c_D(x).
   elemental logical function is_coefficient(k)
      integer, intent(in) :: k

      is_coefficient = k >= E_at(1)
   end function is_coefficient

   !> Returns the function of which parameter k is a coefficient: `field_modulus`,
   !> `field_viscosity`, or 0 for any other parameter.
   elemental integer function function_of(k)
      integer, intent(in) :: k

      function_of = 0
      if (is_coefficient(k)) function_of = merge(field_viscosity, field_modulus, k >= c_D_at(1))
   end function function_of

   !> Returns the largest number of attachments of one kind; there is always a sensor.
   pure integer function items(self)
      class(structure_t), intent(in) :: self

      items = max(1, self%sensors, self%supports, self%masses, self%hoses)
   end function items

   !> Returns which hoses, (max(1, hoses)), have a mass. Without a mass, the equations have no
   !> coordinate y.
   pure function has_hose(self)
      class(structure_t), intent(in) :: self
      logical :: has_hose(max(1, self%hoses))

      has_hose = self%hose(:size(has_hose))%m_H > 0
   end function has_hose

   !> Returns the conditions, (condition, end), that hold exactly: their compliance is 0 and stays
   !> 0. The spline space satisfies them.
   pure function essential(self)
      class(structure_t), intent(in) :: self
      logical :: essential(2, 2)

      essential = reshape([self%end(root)%kappa_w, self%end(root)%kappa_R, &
         self%end(tip)%kappa_w, self%end(tip)%kappa_R] <= 0, [2, 2]) .and. .not. self%yields
   end function essential

   !> Returns which conditions, (condition, end), have a compliance that is among the given
   !> parameters.
   !>
   !> parameters  (:) numbers of parameters
   pure function yielding(parameters)
      integer, intent(in) :: parameters(:)
      logical :: yielding(2, 2)
      integer :: c, e

      do e = root, tip
         yielding(:, e) = [(any(parameters == compliance_at(c, e)), c=deflection, rotation)]
      end do
   end function yielding

   !> Returns whether an end has a spring, rigid or not, for its deflection or its rotation.
   pure logical function has_end_spring(self, condition, end)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: condition, end

      has_end_spring = merge(self%end(end)%kappa_w, self%end(end)%kappa_R, &
         condition == deflection) < no_spring
   end function has_end_spring

   !> Returns whether support p has a spring, rigid or not, for its deflection or its rotation; a
   !> support may have a damper alone.
   pure logical function has_spring(self, p, condition)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: p, condition

      has_spring = merge(self%support(p)%kappa_P, self%support(p)%kappa_RP, &
         condition == deflection) < no_spring
   end function has_spring

   !> Returns the number of rigid connections of the supports.
   pure integer function rigid_supports(self)
      class(structure_t), intent(in) :: self

      associate (support => self%support(:self%supports))
         rigid_supports = count(.not. support%kappa_P > 0) + count(.not. support%kappa_RP > 0)
      end associate
   end function rigid_supports

   !> Finds the attachment to which parameter k belongs.
   !>
   !> kind       1: sensor, 2: support, 3: mass, 4: hose; 0: parameter k belongs to no attachment
   !> item       number of the attachment
   !> component  number of the value
   pure subroutine find_item(k, kind, item, component)
      integer, intent(in) :: k
      integer, intent(out) :: kind, item, component

      kind = 0
      item = 0
      component = k
      if (k <= n_beam) return
      component = k - n_beam
      do kind = 1, size(n_of)
         if (component <= n_of(kind)*most_items) exit
         component = component - n_of(kind)*most_items
      end do
      item = (component - 1)/n_of(kind) + 1
      component = component - (item - 1)*n_of(kind)
   end subroutine find_item

   !> Returns the values of one attachment, or those of the beam, in the first entries of q.
   !>
   !> kind, item  as of `find_item`
   pure function values_in(self, kind, item) result(q)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: kind, item
      real(wp) :: q(n_beam)
      type(numbers_t) :: row

      select case (kind)
      case (1)
         row = transfer(self%sensor(item), row)
      case (2)
         row = transfer(self%support(item), row)
      case (3)
         row = transfer(self%mass(item), row)
      case (4)
         row = transfer(self%hose(item), row)
      case default
         row = transfer(self%beam_values_t, row)
      end select
      q = row%q
      if (kind > 0) q(n_of(kind) + 1:) = 0
   end function values_in

   !> Returns the value of parameter k as it is stored.
   pure real(wp) function stored(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: q(n_beam)
      integer :: kind, item, component

      call find_item(k, kind, item, component)
      q = values_in(self, kind, item)
      stored = q(component)
   end function stored

   !> Sets the stored value of parameter k.
   pure subroutine store(self, k, value)
      class(structure_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: value
      real(wp) :: q(n_beam)
      integer :: kind, item, component

      call find_item(k, kind, item, component)
      q = values_in(self, kind, item)
      q(component) = value
      select case (kind)
      case (1)
         self%sensor(item) = transfer(q, sensor_t())
      case (2)
         self%support(item) = transfer(q, support_t())
      case (3)
         self%mass(item) = transfer(q, mass_t())
      case (4)
         self%hose(item) = transfer(q, hose_t())
      case default
         self%beam_values_t = transfer(q, beam_values_t())
      end select
   end subroutine store

   !> Returns the position on the beam that parameter k stands for [length].
   pure real(wp) function place(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k

      place = stored(self, k)
      if (place < 0) place = self%length
   end function place

   !> Returns whether the position that parameter k stands for is the tip because none was given.
   pure logical function follows_tip(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k

      follows_tip = stored(self, k) < 0
   end function follows_tip

   !> Returns the position of the observing sensor [length].
   pure real(wp) function sensor_place(self)
      class(structure_t), intent(in) :: self

      sensor_place = self%place(x_S_at(self%observer))
   end function sensor_place

   !> Returns the value of parameter k. A position that was not given is returned as the length, and
   !> a coefficient that was not set as the value of E or c_D.
   pure real(wp) function get(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k
      integer :: a

      a = function_of(k)
      if (a > 0) then
         get = merge(self%E, self%c_D, a == field_modulus)
         if (allocated(self%variations%along(a)%value)) &
            get = self%variations%along(a)%value(k - coefficient_at(1, a) + 1)
         return
      end if
      get = stored(self, k)
      if (get < 0) get = merge(self%length, get, any(k == [of_x_F, x_S_at, x_M_at, x_H_at]))
   end function get

   !> Sets parameter k to a value.
   pure subroutine set(self, k, value)
      class(structure_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: value
      integer :: a

      a = function_of(k)
      if (a > 0) then
         ! If no coefficient was set before, the others become the value of the uniform property.
         associate (along => self%variations%along(a))
            if (.not. allocated(along%value)) &
               allocate (along%value(along%coefficients), source=merge(self%E, self%c_D, &
               a == field_modulus))
            along%value(k - coefficient_at(1, a) + 1) = value
         end associate
      else
         call store(self, k, value)
         if (k == of_w_D) self%variations%dips = value > 0
      end if
   end subroutine set

   !> Returns whether two structures have exactly equal parameters and the same observing sensor.
   pure logical function same_structure(a, b)
      type(structure_t), intent(in) :: a, b

      integer :: item, kind

      same_structure = all([a%supports - b%supports, a%masses - b%masses, a%observer &
         - b%observer] == 0) .and. (a%stands .eqv. b%stands) .and. &
         all(abs(values_in(a, 0, 1) - values_in(b, 0, 1)) <= 0)
      do item = 1, max(a%items(), b%items())
         do kind = 1, size(n_of)
            if (same_structure) same_structure = all(abs(values_in(a, kind, item) &
               - values_in(b, kind, item)) <= 0)
         end do
      end do
      if (same_structure) same_structure = &
         all(same_values(a%variations%along, b%variations%along))
   end function same_structure

   !> Returns whether two fields have exactly equal coefficients, or both have none.
   elemental logical function same_values(a, b)
      type(field_t), intent(in) :: a, b

      same_values = allocated(a%value) .eqv. allocated(b%value)
      if (same_values .and. allocated(a%value)) same_values = size(a%value) == size(b%value)
      if (same_values .and. allocated(a%value)) same_values = all(abs(a%value - b%value) <= 0)
   end function same_values

   !> Returns whether the stiffness has a dip, or may have one in a fit.
   pure logical function has_dip(self)
      class(structure_t), intent(in) :: self

      has_dip = self%w_D > 0
   end function has_dip

   !> Returns whether E or c_D vary along the beam by estimated parameters (coefficients or a dip),
   !> in addition to the known variation.
   pure logical function has_fields(self)
      class(structure_t), intent(in) :: self

      has_fields = self%has_dip() .or. allocated(self%variations%along(field_modulus)%value) .or. &
         allocated(self%variations%along(field_viscosity)%value)
   end function has_fields

   !> Returns E(x)/E and c_D(x)/c_D at one position, without the factors of the known variation.
   !>
   !> xi      position x/l, 0 .. 1
   !> result  (2) factor of E, factor of c_D
   pure function factors(self, xi)
      class(structure_t), intent(in) :: self
      real(wp), intent(in) :: xi
      real(wp) :: factors(2), uniform(2)
      integer :: a

      factors = 1
      uniform = [self%E, self%c_D]
      do a = 1, size(factors)
         associate (along => self%variations%along(a))
            if (allocated(along%value)) factors(a) = sum(along%shares(xi)*along%value)/uniform(a)
         end associate
      end do
      if (self%has_dip()) factors(field_modulus) = factors(field_modulus) &
         *(1 - self%d_D*dip_at(self, xi))
   end function factors

   !> Returns the shape of the dip, a Gaussian of height 1, at xi = x/l.
   pure real(wp) function dip_at(self, xi)
      type(structure_t), intent(in) :: self
      real(wp), intent(in) :: xi

      dip_at = exp(-((xi*self%length - self%x_D)/self%w_D)**2/2)
   end function dip_at

   !> Returns the derivatives of `factors` with respect to parameters, at constant xi.
   !>
   !> xi          position x/l, 0 .. 1
   !> parameters  (n) numbers of the parameters
   !> slopes      (2, n) derivatives of the factor of E and of the factor of c_D
   pure function factor_slopes(self, xi, parameters) result(slopes)
      class(structure_t), intent(in) :: self
      real(wp), intent(in) :: xi
      integer, intent(in) :: parameters(:)
      real(wp) :: slopes(2, size(parameters)), uniform(2), along(2), dip, z
      real(wp), allocatable :: share(:)
      integer :: a, p

      slopes = 0
      along = 1
      uniform = [self%E, self%c_D]
      do a = 1, size(along)
         share = self%variations%along(a)%shares(xi)
         if (allocated(self%variations%along(a)%value)) &
            along(a) = sum(share*self%variations%along(a)%value)/uniform(a)
         do p = 1, size(parameters)
            if (function_of(parameters(p)) == a) then
               ! This holds also if no coefficient is set and all equal E or c_D.
               slopes(a, p) = share(parameters(p) - coefficient_at(1, a) + 1)/uniform(a)
            else if (parameters(p) == common_of(a) .and. &
               allocated(self%variations%along(a)%value)) then
               slopes(a, p) = -along(a)/uniform(a)
            end if
         end do
      end do
      if (.not. self%has_dip()) return
      dip = dip_at(self, xi)
      z = (xi*self%length - self%x_D)/self%w_D
      slopes(field_modulus, :) = slopes(field_modulus, :)*(1 - self%d_D*dip)
      do p = 1, size(parameters)
         associate (slope => slopes(field_modulus, p), E => along(field_modulus))
            select case (parameters(p))
            case (of_d_D)
               slope = -E*dip
            case (of_x_D)
               slope = -E*self%d_D*dip*z/self%w_D
            case (of_w_D)
               slope = -E*self%d_D*dip*z**2/self%w_D
            case (of_length)
               slope = E*self%d_D*dip*z*xi/self%w_D
            end select
         end associate
      end do
   end function factor_slopes

   !> Returns the static stiffness at the position of the force, x_F [force/length]; 0 up to
   !> round-off if the beam is not supported, `huge` if a rigid end or support takes the force.
   pure real(wp) function stiffness(self)
      class(structure_t), intent(in) :: self
      real(wp) :: deflection

      deflection = self%static_deflection(self%place(of_x_F))
      stiffness = huge(deflection)
      if (abs(deflection) > tiny(deflection)) stiffness = 1/deflection
   end function stiffness

   !> Returns the derivative of log(`stiffness`) with respect to parameter k, computed by a complex
   !> step, which has no cancellation (Squire and Trapp, SIAM Review 40, 1998, 110).
   pure real(wp) function stiffening(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp), parameter :: step = 1e-30_wp
      complex(wp) :: q(n_parameters), x, deflection
      real(wp) :: moved

      stiffening = 0
      if (k > n_parameters .and. .not. is_coefficient(k)) return
      q = values_of(self)
      q(of_x_F) = self%place(of_x_F)
      moved = step*max(abs(self%get(k)), tiny(step)/step)
      if (k <= n_parameters) q(k) = cmplx(real(q(k)), moved, wp)
      x = q(of_x_F)
      if (self%follows_tip(of_x_F) .and. k == of_length) x = q(of_length)
      deflection = influence(self, q, x, x, k, moved)
      if (moved > 0) stiffening = -aimag(deflection)/(real(deflection)*moved)
   end function stiffening

   !> Returns the deflection at x under a unit static force at x_F [length/force].
   pure real(wp) function static_deflection(self, x)
      class(structure_t), intent(in) :: self
      real(wp), intent(in) :: x
      complex(wp) :: q(n_parameters)

      q = values_of(self)
      static_deflection = real(influence(self, q, cmplx(x, 0, wp), cmplx(self%place(of_x_F), 0, &
         wp)))
   end function static_deflection

   !> Returns the static stiffness of the tip of a cantilever [force/length], the scale of all
   !> stiffnesses: 3 E I/l**3 if the beam is uniform and the root does not rotate. Conditions at the
   !> tip and supports do not count; a root that rotates freely counts as one with the compliance
   !> 10 l/(E I).
   pure real(wp) function tip_stiffness(self)
      class(structure_t), intent(in) :: self
      complex(wp) :: q(n_parameters)
      real(wp) :: compliance

      q = values_of(self)
      compliance = self%end(root)%kappa_R
      if (compliance >= no_spring) compliance = 10*self%length/(self%E*self%I)
      tip_stiffness = 1/(real(flexibility(self, q, [q(of_length), q(of_length)], [0, 0])) &
         + self%length**2*compliance)
   end function tip_stiffness

   !> Returns which springs to the ground there are, rigid or not: those of deflection and rotation
   !> at the root, the same at the tip, those of the supports' deflections, and of their rotations.
   pure function springs(self) result(there)
      class(structure_t), intent(in) :: self
      logical :: there(4 + 2*self%supports)
      integer :: c, e, p

      there = [((self%has_end_spring(c, e), c=deflection, rotation), e=root, tip), &
         ((self%has_spring(p, c), p=1, self%supports), c=deflection, rotation)]
   end function springs

   !> Finds where springs or dampers to the ground act.
   !>
   !> there  (4 + 2 supports) which of them exist, in the order of `springs`
   !> place  (count(there)) numbers of the parameters for their positions; 0: root, -1: tip
   !> slope  (count(there)) 1: it resists the rotation; 0: the deflection
   pure subroutine find_places(self, there, place, slope)
      class(structure_t), intent(in) :: self
      logical, intent(in) :: there(:)
      integer, allocatable, intent(out) :: place(:), slope(:)
      integer :: c, p

      place = pack([0, 0, -1, -1, x_P_at(:self%supports), x_P_at(:self%supports)], there)
      slope = pack([0, 1, 0, 1, ((c, p=1, self%supports), c=0, 1)], there)
   end subroutine find_places

   !> Returns the number of motions as a rigid body, 0 to 2, that no spring to the ground resists.
   pure integer function rigid_body_modes(self)
      class(structure_t), intent(in) :: self

      rigid_body_modes = 2 - resisted(self, springs(self))
   end function rigid_body_modes

   !> Returns the number of roots 0 of the equations of motion: two for each rigid-body mode, less
   !> one for each that a damper to the ground resists.
   pure integer function zero_roots(self)
      class(structure_t), intent(in) :: self
      logical :: dampers(4 + 2*self%supports)

      zero_roots = self%rigid_body_modes()
      if (zero_roots == 0 .or. self%gamma > 0) return
      dampers = [self%end(root)%c_w > 0, self%end(root)%c_R > 0, self%end(tip)%c_w > 0, &
         self%end(tip)%c_R > 0, self%support(:self%supports)%c_P > 0, &
         self%support(:self%supports)%c_RP > 0]
      zero_roots = zero_roots + 2 - resisted(self, springs(self) .or. dampers)
   end function zero_roots

   !> Returns the number of independent motions as a rigid body that springs or dampers resist.
   !>
   !> there  (4 + 2 supports) which of them exist, in the order of `springs`
   pure integer function resisted(self, there)
      class(structure_t), intent(in) :: self
      logical, intent(in) :: there(:)
      integer, allocatable :: place(:), slope(:)
      real(wp) :: rows(2, count(there))
      integer :: i, j

      call find_places(self, there, place, slope)
      ! Motion of a point by a unit deflection, and by a unit rotation about the root times l.
      do i = 1, size(place)
         rows(:, i) = [1 - slope(i), 1]
         if (slope(i) > 0 .or. place(i) < 0) cycle
         rows(2, i) = 0
         if (place(i) > 0) rows(2, i) = self%get(place(i))/self%length
      end do
      resisted = min(1, size(place))
      do j = 2, size(place)
         do i = 1, j - 1
            if (abs(rows(1, i)*rows(2, j) - rows(2, i)*rows(1, j)) > 1e-9_wp) resisted = 2
         end do
      end do
   end function resisted

   !> Returns the influence function: the static deflection at x under a unit force at xi
   !> [length/force]; `huge` if the beam is not supported.
   !>
   !> The beam is taken as a cantilever that moves as a rigid body, w = v + a + b x, and each spring
   !> to the ground, those of a clamped root included, as an unknown reaction. The springs give one
   !> equation each, and equilibrium gives two, because the imagined clamp carries nothing. A beam
   !> with an axial force is a `column_t`.
   !>
   !> q         (n_parameters) values of the parameters, which may carry an imaginary step
   !> x, xi     positions of the deflection and of the force [length]
   !> k, moved  number of the parameter that carries the step, and the step's imaginary part
   pure complex(wp) function influence(self, q, x, xi, k, moved)
      type(structure_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), x, xi
      integer, intent(in), optional :: k
      real(wp), intent(in), optional :: moved
      complex(wp), allocatable :: points(:), a(:, :), b(:, :), rigid(:, :), row(:)
      type(column_spring_t), allocatable :: held(:)
      integer, allocatable :: slope(:)
      real(wp) :: l, unit
      logical :: regular
      integer :: i, j, n

      if (abs(q(of_g)) + abs(q(of_T)) > 0) then
         influence = column_deflection(column_of(self, q, [x, xi]), x, xi)
         return
      end if
      held = springs_of(self, q)
      n = size(held)
      allocate (a(n + 2, n + 2), b(n + 2, 1), rigid(n + 2, 2))
      points = [held%at, x, xi]
      slope = [held%slope, 0, 0]
      ! Lengths in l, forces in E I/l**2.
      l = self%length
      unit = l**3/(self%E*self%I)
      do j = 1, n + 2
         do i = 1, n + 2
            a(i, j) = flexibility(self, q, points([i, j]), slope([i, j]), k, moved)
            a(i, j) = a(i, j)*l**(slope(i) + slope(j))/unit
         end do
         rigid(j, :) = [cmplx(1 - slope(j), 0, wp), points(j)/l]
         if (slope(j) > 0) rigid(j, 2) = 1
      end do
      influence = a(n + 1, n + 2)
      row = [a(n + 1, :n), rigid(n + 1, :)]
      b(:n, 1) = -a(:n, n + 2)
      b(n + 1:, 1) = -rigid(n + 2, :)
      do i = 1, n
         a(i, i) = a(i, i) + held(i)%compliance*l**(2*slope(i))/unit
      end do
      a(:n, n + 1:) = rigid(:n, :)
      a(n + 1:, :n) = transpose(rigid(:n, :))
      a(n + 1:, n + 1:) = 0
      call eliminate(n + 2, 1, a, b, regular)
      influence = (influence + sum(row*b(:, 1)))*unit
      if (.not. regular) influence = huge(unit)
   end function influence

   !> Returns the springs to the ground, rigid or not, in the order of `springs`.
   !>
   !> q  as of `influence`
   pure function springs_of(self, q) result(held)
      type(structure_t), intent(in) :: self
      complex(wp), intent(in) :: q(:)
      type(column_spring_t) :: held(count(springs(self)))
      integer, allocatable :: place(:), slope(:)
      logical :: there(4 + 2*self%supports)
      integer :: i

      there = springs(self)
      call find_places(self, there, place, slope)
      held%slope = slope
      held%compliance = q(pack([compliance_at, kappa_P_at(:self%supports), &
         kappa_RP_at(:self%supports)], there))
      do i = 1, size(held)
         held(i)%at = 0
         if (place(i) < 0) held(i)%at = q(of_length)
         if (place(i) > 0) held(i)%at = q(place(i))
      end do
   end function springs_of

   !> Returns the beam under its axial force and weight, on its springs, as a `column_t`. Its pieces
   !> end at the positions `places`, at every spring and at every sensor.
   pure function column_of(self, q, places) result(column)
      type(structure_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), places(:)
      type(column_t) :: column
      type(column_spring_t) :: held(count(springs(self)))
      complex(wp), dimension(max(1, self%sensors) + self%masses) :: carried, at
      complex(wp) :: ends(size(places) + size(held) + size(at) + 2), N(size(ends) - 1), weight
      integer :: i, last(size(at))

      weight = merge(-q(of_g), q(of_g), self%stands)
      associate (sensors => max(1, self%sensors), masses => self%masses)
         at = [q(x_S_at(:sensors)), q(x_M_at(:masses))]
         carried = [q(m_S_at(:sensors)), q(m_M_at(:masses))]
      end associate
      where (real(at) < 0) at = q(of_length)
      held = springs_of(self, q)
      ends = [(0.0_wp, 0.0_wp), places, held%at, at, q(of_length)]
      call sort_by(real(ends), ends)
      ! The positions are complex: find the end that each equals, instead of comparing positions.
      last = [(minloc(abs(ends - at(i)), dim=1), i=1, size(at))]
      do i = 1, size(N)
         N(i) = q(of_T) + weight*(q(of_m_T) + q(of_rho)*(q(of_length) - ends(i)) &
            + sum(carried, mask=last > i))
      end do
      column = new_column(q(of_E)*q(of_I), ends, N, spread(-weight*q(of_rho), 1, size(N)), held)
   end function column_of

   !> Returns the mass of the beam and of everything that is fixed to it, without the hoses [mass].
   pure real(wp) function total_mass(self)
      class(structure_t), intent(in) :: self

      total_mass = self%m_T + self%rho*self%length &
         + sum(self%sensor(:max(1, self%sensors))%m_S) + sum(self%mass(:self%masses)%m_M)
   end function total_mass

   !> Returns the axial force at the root and at the tip, between which it lies everywhere, as
   !> multiples of E I/length**2; tension is positive. A cantilever under its own weight buckles at
   !> -7.84 at the root, one under a force at -2.47.
   pure function axial_load(self) result(load)
      class(structure_t), intent(in) :: self
      real(wp) :: load(2), weight

      weight = merge(-self%g, self%g, self%stands)
      load = self%T + weight*[self%total_mass(), self%m_T]
      load = load*self%length**2/(self%E*self%I)
   end function axial_load

   !> Returns whether axial force and weight buckle the beam. The result is .false. for a beam whose
   !> stiffness varies: its roots show whether it buckles.
   pure logical function buckles(self)
      class(structure_t), intent(in) :: self
      complex(wp) :: q(n_parameters)

      buckles = .false.
      if (self%rigid_body_modes() > 0) return
      if (self%variations%are_known() .or. self%has_fields()) return
      if (.not. (self%T < 0 .or. self%stands .and. self%g > 0)) return
      q = values_of(self)
      buckles = column_buckles(column_of(self, q, q(of_length:of_length)))
   end function buckles

   !> Returns the deflection or slope of a cantilever without springs and axial force at points(1)
   !> under a unit force or moment at points(2).
   !>
   !> q         (n_parameters) values of the parameters
   !> points    (2) positions [length]
   !> slope     (2) 1: slope or moment; 0: deflection or force
   !> k, moved  as in `influence`
   pure complex(wp) function flexibility(self, q, points, slope, k, moved)
      type(structure_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), points(2)
      integer, intent(in) :: slope(2)
      integer, intent(in), optional :: k
      real(wp), intent(in), optional :: moved
      complex(wp) :: near, far

      associate (first => merge(1, 2, real(points(1)) <= real(points(2))))
         near = points(first)
         far = points(3 - first)
      end associate
      if (self%variations%are_known() .or. self%has_fields()) then
         flexibility = varied_bending(self, q(of_length), near, points, slope, k, moved)
      else if (all(slope == 0)) then
         flexibility = near**2*(3*far - near)/6
      else if (all(slope == 1)) then
         flexibility = near
      else
         flexibility = near*sum(points, mask=slope == 0) - near**2/2
      end if
      flexibility = flexibility/(q(of_E)*q(of_I))
   end function flexibility

   !> Returns the integral from the root to `near` of the product of two bending moments over f, the
   !> factor of the stiffness. A unit force at p causes the moment p - t at t, a unit moment 1.
   !> Gauss-Legendre quadrature is applied between the positions where f is not smooth.
   !>
   !> near           the smaller of the two positions [length]
   !> points, slope  as in `flexibility`
   pure complex(wp) function varied_bending(self, length, near, points, slope, k, moved) &
      result(bent)
      type(structure_t), intent(in) :: self
      complex(wp), intent(in) :: length, near, points(2)
      integer, intent(in) :: slope(2)
      integer, intent(in), optional :: k
      real(wp), intent(in), optional :: moved
      integer, parameter :: parts = 16, order = 8
      type(rule_t) :: rule
      real(wp), allocatable :: ends(:)
      integer, allocatable :: knots(:)
      real(wp) :: h, last
      integer :: i, p, q

      call self%variations%breaks(3, ends, knots)
      last = min(real(near)/real(length), 1.0_wp)
      ends = [0.0_wp, pack(ends, ends < last), last]
      rule = gauss_legendre(order)
      bent = 0
      do i = 1, size(ends) - 1
         h = (ends(i + 1) - ends(i))/parts
         do p = 1, parts
            do q = 1, order
               bent = bent + h*rule%weights(q)*length &
                  *integrand(ends(i) + h*(p - 1 + rule%points(q)))
            end do
         end do
      end do
      ! The step of the upper end of the integral in xi, which is first order.
      bent = bent + length*cmplx(0, aimag(near/length), wp)*real(integrand(last))

   contains

      !> Returns the product of the moments over f, at t = length*xi.
      pure complex(wp) function integrand(xi)
         real(wp), intent(in) :: xi
         real(wp) :: slopes(2, 1), values(2)
         complex(wp) :: factor

         values = self%factors(xi)
         factor = values(1)
         if (present(k)) then
            slopes = self%factor_slopes(xi, [k])
            factor = cmplx(values(1), slopes(1, 1)*moved, wp)
         end if
         integrand = product(merge(points - length*xi, (1.0_wp, 0.0_wp), slope == 0)) &
            /(self%variations%bending(xi)*factor)
      end function integrand

   end function varied_bending

   !> Returns Rayleigh's estimate of the first natural angular frequency without supports [1/time],
   !> from the static tip stiffness, the tip mass and 33/140 of the beam's mass.
   pure real(wp) function omega(self)
      class(structure_t), intent(in) :: self

      omega = sqrt(self%tip_stiffness()/(self%m_T + 33*self%rho*self%length/140))
   end function omega

end module beamid_structure
