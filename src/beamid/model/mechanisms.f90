!> The damping mechanisms of the beam material and of the surrounding air, and the combinations of
!> mechanisms that are compared with one another (docs/explanation/damping.md).
module beamid_mechanisms
   use beamid_structure, only: of_a_h, of_b, of_b_h, of_c_D, of_d, of_eta, of_gamma
   implicit none
   private

   public :: combination_t, combinations_for, is_of_damping

   !> A mechanism.
   type, public :: mechanism_t
      character(len=18) :: name   !< name in the tables
      !> number of the parameter that is proportional to the damping; with 0 there is no damping
      integer :: strength
      integer :: range = 0        !< number of the rate or range; 0: the mechanism has none
      logical :: in_time = .true. !< whether it is defined for records in time
      character(len=4) :: short = ''   !< name in narrow columns
   end type mechanism_t

   !> Numbers of the mechanisms.
   integer, parameter, public :: air = 1, kelvin_voigt = 2, structural = 3, time_hysteresis = 4, &
      spatial_hysteresis = 5

   type(mechanism_t), parameter, public :: mechanisms(*) = [ &
      mechanism_t('air', of_gamma, short='air'), &
      mechanism_t('Kelvin-Voigt', of_c_D, short='KV'), &
      mechanism_t('structural', of_eta, in_time=.false., short='eta'), &
      mechanism_t('time hysteresis', of_d(1), of_b(1), short='time'), &
      mechanism_t('spatial hysteresis', of_a_h, of_b_h, short='spat')]

   !> Pairs of mechanisms that are compared.
   integer, parameter :: pairs(2, 5) = reshape([air, kelvin_voigt, air, structural, &
      air, time_hysteresis, air, spatial_hysteresis, kelvin_voigt, structural], [2, 5])

   !> Mechanisms that act together.
   type :: combination_t
      integer, allocatable :: parts(:)   !< numbers of the mechanisms
   contains
      procedure :: name
      procedure :: parameters
   end type combination_t

contains

   !> Returns the combinations to compare: every mechanism alone, each mechanism of the material
   !> together with the air, and Kelvin-Voigt together with structural damping.
   !>
   !> in_time  whether there is a record in time, so that the mechanisms must be causal
   pure function combinations_for(in_time) result(combinations)
      logical, intent(in) :: in_time
      type(combination_t), allocatable :: combinations(:)
      type(combination_t) :: next
      integer :: k

      allocate (combinations(0))
      do k = 1, size(mechanisms) + size(pairs, 2)
         if (k <= size(mechanisms)) then
            next%parts = [k]
         else
            next%parts = pairs(:, k - size(mechanisms))
         end if
         if (in_time .and. .not. all(mechanisms(next%parts)%in_time)) cycle
         combinations = [combinations, next]
      end do
   end function combinations_for

   !> Returns the names of the mechanisms, joined by ' + '.
   pure function name(self)
      class(combination_t), intent(in) :: self
      character(len=:), allocatable :: name
      integer :: k

      name = trim(mechanisms(self%parts(1))%name)
      do k = 2, size(self%parts)
         name = name//' + '//trim(mechanisms(self%parts(k))%name)
      end do
   end function name

   !> Returns the numbers of the parameters: for each mechanism its strength, then its rate or range
   !> if it has one.
   pure function parameters(self)
      class(combination_t), intent(in) :: self
      integer, allocatable :: parameters(:)
      type(mechanism_t) :: mechanism
      integer :: k

      allocate (parameters(0))
      do k = 1, size(self%parts)
         mechanism = mechanisms(self%parts(k))
         parameters = [parameters, mechanism%strength]
         if (mechanism%range > 0) parameters = [parameters, mechanism%range]
      end do
   end function parameters

   !> Returns whether a parameter belongs to a damping mechanism of the beam, the second relaxation
   !> of time hysteresis included.
   elemental logical function is_of_damping(parameter)
      integer, intent(in) :: parameter

      is_of_damping = parameter > 0 .and. any(parameter == [mechanisms%strength, &
         mechanisms%range, of_d, of_b])
   end function is_of_damping

end module beamid_mechanisms
