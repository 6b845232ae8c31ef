!> The structure of Figure 2.3: a clamped beam with Kelvin-Voigt damping, a tip mass, and a hose
!> that acts as a mass on a dashpot and a spring at the tip; q = (m_T, E, c_D, m_H, c_H, k_H) of
!> Section 2.
module beamid_structure
   use beamid_errors, only: error_t, bad_input
   use beamid_kinds, only: wp
   use beamid_strings, only: lower, to_text
   implicit none
   private

   public :: structure_t, check_structure, parameter_names, parameter_index

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
   contains
      procedure :: has_hose
      procedure :: get
      procedure :: set
      procedure :: magnitude
      procedure :: stiffness
      procedure :: omega
   end type structure_t

   !> Names of the parameters that a fit may free, as they are printed.
   character(len=*), parameter :: parameter_names(7) = &
      [character(len=3) :: 'm_T', 'E', 'c_D', 'm_H', 'c_H', 'k_H', 'rho']

contains

   !> Without a hose the coordinate y is absent from the equations.
   pure logical function has_hose(self)
      class(structure_t), intent(in) :: self

      has_hose = self%m_H > 0
   end function has_hose

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
      case (1); get = self%m_T
      case (2); get = self%E
      case (3); get = self%c_D
      case (4); get = self%m_H
      case (5); get = self%c_H
      case (6); get = self%k_H
      case (7); get = self%rho
      end select
   end function get

   !> Gives a parameter a value, by its place in `parameter_names`.
   pure subroutine set(self, k, value)
      class(structure_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: value

      select case (k)
      case (1); self%m_T = value
      case (2); self%E = value
      case (3); self%c_D = value
      case (4); self%m_H = value
      case (5); self%c_H = value
      case (6); self%k_H = value
      case (7); self%rho = value
      end select
   end subroutine set

   !> Static stiffness of the tip, 3 E I/l**3 [force/length].
   pure real(wp) function stiffness(self)
      class(structure_t), intent(in) :: self

      stiffness = 3*self%E*self%I/self%length**3
   end function stiffness

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
         case (1, 4); magnitude = mass/10
         case (2); magnitude = self%E
         case (3); magnitude = 2e-2_wp*self%E/self%omega()
         case (5); magnitude = 2e-2_wp*mass*self%omega()
         case (6); magnitude = self%stiffness()/10
         case (7); magnitude = self%rho
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
