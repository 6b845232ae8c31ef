!> The values of the parameters of a structure, and the numbers of these parameters.
!>
!> The structure of Figure 2.3 is a clamped beam with Kelvin-Voigt damping, a tip mass, and a hose
!> modelled as a mass on a dashpot and a spring at the tip; its parameters are
!> q = (m_T, E, c_D, m_H, c_H, k_H) of Section 2. A beam on a test bench may also have air damping,
!> rotary inertia at the tip, other conditions at its ends (each end clamped, pinned, guided, free
!> or elastic), its own weight, and an axial force. At any position it may have attachments:
!> sensors with mass, supports, masses, and hoses (oscillators).
!>
!> `beamid_parameters` describes each parameter (name, unit, range, help), and `beamid_terms` states
!> how the parameters enter M, C, K and F.
module beamid_beam_values
   use beamid_kinds, only: wp
   use beamid_variations, only: field_modulus, field_viscosity
   implicit none
   private

   public :: beam_values_t, values_t, find_item, is_coefficient, function_of

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
   !> Number of all parameters, and number of those that belong to no attachment.
   integer, parameter, public :: n_parameters = storage_size(values_t())/storage_size(1.0_wp)
   integer, parameter, public :: n_beam = storage_size(beam_values_t())/storage_size(1.0_wp)
   !> Number of values of each attachment, in the order of `values_t`.
   integer, parameter, public :: n_of(4) = [storage_size(sensor_t()), storage_size(support_t()), &
      storage_size(mass_t()), storage_size(hose_t())]/storage_size(1.0_wp)

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
   !> Numbers of the parameters of the first sensor and of the first hose.
   integer, parameter, public :: of_m_S = m_S_at(1), of_J_S = J_S_at(1), of_x_S = x_S_at(1), &
      of_m_H = m_H_at(1), of_c_H = c_H_at(1), of_k_H = k_H_at(1), of_x_H = x_H_at(1)

contains

   !> Finds the attachment to which parameter k, 1 .. n_parameters, belongs.
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

end module beamid_beam_values
