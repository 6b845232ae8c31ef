!> The structure of Figure 2.3: a clamped beam with Kelvin-Voigt damping, a tip mass, and a hose
!> that acts as a mass on a dashpot and a spring at the tip; q = (m_T, E, c_D, m_H, c_H, k_H) of
!> Section 2. What a beam on a bench has besides: air damping, rotary inertia of the tip mass, a
!> sensor with a mass somewhere on the beam, a clamp that gives way.
module beamid_structure
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: structure_t, check_structure, same_structure, parameter_names, parameter_index

   !> A root that does not turn, and a sensor that sits at the tip.
   real(wp), parameter, public :: rigid = huge(1.0_wp), at_tip = -1

   !> Any consistent set of units.
   type :: structure_t
      real(wp) :: length = 0         !< l [length], > 0
      real(wp) :: rho = 0            !< mass per unit length [mass/length], > 0
      real(wp) :: E = 0              !< modulus of elasticity [force/length**2], > 0
      real(wp) :: I = 0              !< second moment of the cross section [length**4], > 0
      real(wp) :: c_D = 0            !< Kelvin-Voigt viscosity [force time/length**2], >= 0
      real(wp) :: m_T = 0            !< tip mass [mass], >= 0
      real(wp) :: m_H = 0            !< hose mass [mass], >= 0; 0 means that there is no hose
      real(wp) :: c_H = 0            !< hose damping [force time/length], >= 0
      real(wp) :: k_H = 0            !< hose stiffness [force/length], >= 0
      real(wp) :: gamma = 0          !< air damping, gamma u_t [force time/length**2], >= 0
      real(wp) :: J_T = 0            !< rotary inertia at the tip [mass length**2], >= 0
      real(wp) :: k_R = rigid        !< torsional spring at the root [force length], > 0
      real(wp) :: m_S = 0            !< mass of the sensor [mass], >= 0
      !> where the sensor sits and observes [length], 0 < x_S <= l; `at_tip`: at the tip
      real(wp) :: x_S = at_tip
   contains
      procedure :: has_hose
      procedure :: has_soft_root
      procedure :: sensor_place
      procedure :: get
      procedure :: set
      procedure :: magnitude
      procedure :: stiffness
      procedure :: stiffening
      procedure :: static_deflection
      procedure :: omega
   end type structure_t

   !> Names of the parameters that a fit may free, as they are printed, and their places.
   character(len=*), parameter :: parameter_names(12) = &
      [character(len=5) :: 'm_T', 'E', 'c_D', 'm_H', 'c_H', 'k_H', 'rho', 'gamma', 'J_T', 'k_R', &
       'm_S', 'x_S']
   integer, parameter, public :: of_m_T = 1, of_E = 2, of_c_D = 3, of_m_H = 4, of_c_H = 5, &
      of_k_H = 6, of_rho = 7, of_gamma = 8, of_J_T = 9, of_k_R = 10, of_m_S = 11, of_x_S = 12

contains

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

   !> Position of the sensor [length].
   pure real(wp) function sensor_place(self)
      class(structure_t), intent(in) :: self

      sensor_place = self%x_S
      if (self%x_S < 0) sensor_place = self%length
   end function sensor_place

   !> Place of a parameter in `parameter_names`, any case; 0 when there is none of that name.
   pure integer function parameter_index(name)
      character(len=*), intent(in) :: name

      do parameter_index = size(parameter_names), 1, -1
         if (lower(trim(parameter_names(parameter_index))) == lower(trim(name))) return
      end do
   end function parameter_index

   !> Value of a parameter by its place in `parameter_names`.
   pure real(wp) function get(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k

      get = 0
      select case (k)
      case (of_m_T); get = self%m_T
      case (of_E); get = self%E
      case (of_c_D); get = self%c_D
      case (of_m_H); get = self%m_H
      case (of_c_H); get = self%c_H
      case (of_k_H); get = self%k_H
      case (of_rho); get = self%rho
      case (of_gamma); get = self%gamma
      case (of_J_T); get = self%J_T
      case (of_k_R); get = self%k_R
      case (of_m_S); get = self%m_S
      case (of_x_S); get = self%sensor_place()
      end select
   end function get

   !> Gives a parameter a value, by its place in `parameter_names`.
   pure subroutine set(self, k, value)
      class(structure_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: value

      select case (k)
      case (of_m_T); self%m_T = value
      case (of_E); self%E = value
      case (of_c_D); self%c_D = value
      case (of_m_H); self%m_H = value
      case (of_c_H); self%c_H = value
      case (of_k_H); self%k_H = value
      case (of_rho); self%rho = value
      case (of_gamma); self%gamma = value
      case (of_J_T); self%J_T = value
      case (of_k_R); self%k_R = value
      case (of_m_S); self%m_S = value
      case (of_x_S); self%x_S = value
      end select
   end subroutine set

   !> Whether two structures are alike to the last digit.
   pure logical function same_structure(a, b)
      type(structure_t), intent(in) :: a, b
      integer :: k

      same_structure = abs(a%length - b%length) <= 0 .and. abs(a%I - b%I) <= 0
      do k = 1, size(parameter_names)
         same_structure = same_structure .and. abs(a%get(k) - b%get(k)) <= 0
      end do
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

      stiffening = 0
      select case (k)
      case (of_E); stiffening = self%stiffness()*self%length**3/(3*self%E**2*self%I)
      case (of_k_R); stiffening = self%stiffness()*(self%length/self%k_R)**2
      end select
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

   !> What one would call a moderate value of a parameter in this structure: the yardstick of a fit
   !> that starts from zero. Masses: a tenth of beam and tip; stiffness: a tenth of the tip's;
   !> damping: one per cent of critical at the first frequency.
   pure real(wp) function magnitude(self, k)
      class(structure_t), intent(in) :: self
      integer, intent(in) :: k

      associate (mass => self%m_T + self%rho*self%length)
         select case (k)
         case (of_m_T, of_m_H, of_m_S); magnitude = mass/10
         case (of_E); magnitude = self%E
         case (of_c_D); magnitude = 2e-2_wp*self%E/self%omega()
         case (of_c_H); magnitude = 2e-2_wp*mass*self%omega()
         case (of_k_H); magnitude = self%stiffness()/10
         case (of_rho); magnitude = self%rho
         case (of_gamma); magnitude = 2e-2_wp*self%rho*self%omega()
         case (of_J_T); magnitude = mass*(self%length/10)**2
         case (of_k_R); magnitude = 10*self%E*self%I/self%length
         case (of_x_S); magnitude = self%length
         case default; magnitude = 1
         end select
      end associate
   end function magnitude

   !> Refuses values outside the physical ranges; the message starts with the name of the parameter.
   subroutine check_structure(structure, error)
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error

      associate (s => structure)
         call positive('length', s%length)
         call positive('rho', s%rho)
         call positive('E', s%E)
         call positive('I', s%I)
         call not_negative('c_D', s%c_D)
         call not_negative('m_T', s%m_T)
         call not_negative('m_H', s%m_H)
         call not_negative('c_H', s%c_H)
         call not_negative('k_H', s%k_H)
         call not_negative('gamma', s%gamma)
         call not_negative('J_T', s%J_T)
         call positive('k_R', s%k_R)
         call not_negative('m_S', s%m_S)
         if (.not. allocated(error) .and. s%length > 0 .and. &
            .not. (s%sensor_place() > 0 .and. s%sensor_place() <= s%length)) call bad_input(error, &
            'x_S: found '//to_text(s%x_S)//', expected a place above 0, up to the length '// &
            to_text(s%length))
         ! Each is in range, but the whole may be out of what numbers can hold.
         if (allocated(error)) return
         if (.not. (s%omega() > 0 .and. s%omega() < huge(1.0_wp))) call bad_input(error, &
            'E: found a structure whose first frequency is '//to_text(s%omega())// &
            ', expected a finite one above 0')
      end associate

   contains

      subroutine positive(name, value)
         character(len=*), intent(in) :: name
         real(wp), intent(in) :: value

         if (allocated(error) .or. value > 0) return
         call bad_input(error, name//': found '//to_text(value)//', expected a value above 0')
      end subroutine positive

      subroutine not_negative(name, value)
         character(len=*), intent(in) :: name
         real(wp), intent(in) :: value

         if (allocated(error) .or. value >= 0) return
         call bad_input(error, name//': found '//to_text(value)//', expected 0 or more')
      end subroutine not_negative

   end subroutine check_structure

end module beamid_structure
