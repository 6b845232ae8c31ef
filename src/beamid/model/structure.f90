!> The structure of Figure 2.3: a clamped beam with Kelvin-Voigt damping, a tip mass, and a hose
!> that acts as a mass on a dashpot and a spring at the tip; q = (m_T, E, c_D, m_H, c_H, k_H) of
!> Section 2. What a beam on a bench has besides: air damping, rotary inertia of the tip mass, a
!> sensor with a mass somewhere on the beam, a clamp that gives way.
!>
!> A structure is its parameters and nothing else. What is known of each of them is in
!> `beamid_parameters`, what they do to the beam in `beamid_terms`.
module beamid_structure
   use beamid_kinds, only: wp
   use beamid_monomials, only: monomial_t, slope_of
   implicit none
   private

   public :: structure_t, same_structure, values_of

   !> A root that does not turn, and a sensor that sits at the tip.
   real(wp), parameter, public :: rigid = huge(1.0_wp), at_tip = -1

   !> Any consistent set of units. The components are the parameters, each a real(wp), and in this
   !> order they have their places: `values_of` counts on it.
   type :: structure_t
      real(wp) :: m_T = 0            !< tip mass
      real(wp) :: E = 0              !< modulus of elasticity
      real(wp) :: c_D = 0            !< Kelvin-Voigt viscosity
      real(wp) :: m_H = 0            !< hose mass; 0 means that there is no hose
      real(wp) :: c_H = 0            !< hose damping
      real(wp) :: k_H = 0            !< hose stiffness
      real(wp) :: rho = 0            !< mass per unit length
      real(wp) :: gamma = 0          !< air damping, gamma u_t
      real(wp) :: J_T = 0            !< rotary inertia at the tip
      real(wp) :: k_R = rigid        !< torsional spring at the root
      real(wp) :: c_R = 0            !< viscous damper at the root
      real(wp) :: m_S = 0            !< mass of the sensor
      real(wp) :: x_S = at_tip       !< where the sensor sits and observes
      real(wp) :: length = 0         !< l
      real(wp) :: I = 0              !< second moment of the cross section
   contains
      procedure :: has_hose
      procedure :: has_soft_root
      procedure :: is_given
      procedure :: sensor_place
      procedure :: get
      procedure :: set
      procedure :: stiffness
      procedure :: stiffening
      procedure :: static_deflection
      procedure :: omega
   end type structure_t

   !> How many parameters there are.
   integer, parameter, public :: n_parameters = storage_size(structure_t())/storage_size(1.0_wp)

   !> Places of the parameters: every component of this structure holds its own. Those that are
   !> asked for by name elsewhere follow as integers.
   integer :: i
   type(structure_t), parameter, public :: of = transfer([(real(i, wp), i=1, n_parameters)], &
      structure_t())
   integer, parameter, public :: of_m_T = nint(of%m_T), of_E = nint(of%E), &
      of_c_D = nint(of%c_D), of_m_H = nint(of%m_H), of_c_H = nint(of%c_H), &
      of_k_H = nint(of%k_H), of_rho = nint(of%rho), of_gamma = nint(of%gamma), &
      of_J_T = nint(of%J_T), of_k_R = nint(of%k_R), of_m_S = nint(of%m_S), &
      of_x_S = nint(of%x_S), of_length = nint(of%length), of_I = nint(of%I)

   !> Static compliance of the tip: of the beam, and of the root.
   type(monomial_t), parameter :: compliance(2) = [ &
      monomial_t(1/3.0_wp, [of_length, of_E, of_I], [3, -1, -1]), &
      monomial_t(1.0_wp, [of_length, of_k_R, 0], [2, -1, 1])]

contains

   !> The parameters by place.
   pure function values_of(structure) result(q)
      type(structure_t), intent(in) :: structure
      real(wp) :: q(n_parameters)

      q = transfer(structure, q)
   end function values_of

   !> Without a hose the coordinate y is absent from the equations.
   pure logical function has_hose(self)
      class(structure_t), intent(in) :: self

      has_hose = self%m_H > 0
   end function has_hose

   !> Whether the clamp gives way.
   pure logical function has_soft_root(self)
      class(structure_t), intent(in) :: self

      has_soft_root = self%k_R < rigid
   end function has_soft_root

   !> Whether a parameter by its place has a value that does something.
   pure logical function is_given(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k

      is_given = self%get(k) > 0 .and. self%get(k) < rigid
   end function is_given

   !> Position of the sensor [length].
   pure real(wp) function sensor_place(self)
      class(structure_t), intent(in) :: self

      sensor_place = self%x_S
      if (self%x_S < 0) sensor_place = self%length
   end function sensor_place

   !> Value of a parameter by its place.
   pure real(wp) function get(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: q(n_parameters)

      q = values_of(self)
      q(of_x_S) = self%sensor_place()
      get = q(k)
   end function get

   !> Gives a parameter a value.
   pure subroutine set(self, k, value)
      class(structure_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: value
      real(wp) :: q(n_parameters)

      q = values_of(self)
      q(k) = value
      call assign(self, transfer(q, structure_t()))
   end subroutine set

   pure subroutine assign(structure, values)
      type(structure_t), intent(inout) :: structure
      type(structure_t), intent(in) :: values

      structure = values
   end subroutine assign

   !> Whether two structures are alike to the last digit.
   pure logical function same_structure(a, b)
      type(structure_t), intent(in) :: a, b

      same_structure = all(abs(values_of(a) - values_of(b)) <= 0)
   end function same_structure

   !> Static stiffness of the tip, 3 E I/l**3 with a rigid root [force/length].
   pure real(wp) function stiffness(self)
      class(structure_t), intent(in) :: self

      stiffness = 3*self%E*self%I/self%length**3
      if (self%has_soft_root()) stiffness = stiffness/(1 + stiffness*self%length**2/self%k_R)
   end function stiffness

   !> Relative change of the tip's static stiffness per unit of a parameter.
   pure real(wp) function stiffening(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k
      integer :: j

      stiffening = 0
      do j = 1, size(compliance)
         stiffening = stiffening - self%stiffness()*slope_of(compliance(j), values_of(self), k)
      end do
   end function stiffening

   !> Deflection at x under a unit static force at the tip [length/force].
   pure real(wp) function static_deflection(self, x)
      class(structure_t), intent(in) :: self
      real(wp), intent(in) :: x

      static_deflection = x**2*(3*self%length - x)/(6*self%E*self%I)
      if (self%has_soft_root()) static_deflection = static_deflection + self%length*x/self%k_R
   end function static_deflection

   !> Rayleigh's estimate of the first angular frequency [1/time]: the static tip stiffness against
   !> the tip mass and 33/140 of the beam's.
   pure real(wp) function omega(self)
      class(structure_t), intent(in) :: self

      omega = sqrt(self%stiffness()/(self%m_T + 33*self%rho*self%length/140))
   end function omega

end module beamid_structure
