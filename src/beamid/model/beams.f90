!> A beam and what is attached to it: the values of its parameters by name and by number, which
!> attachments and springs there are, and how its properties vary.
module beamid_beams
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use beamid_beam_values, only: beam_values_t, coefficient_at, compliance_at, deflection, &
      find_item, function_of, hose_t, item_name_length, mass_t, most_items, n_beam, n_of, &
      n_parameters, no_spring, of_c_D, of_d_D, of_E, of_length, of_w_D, of_x_D, of_x_F, root, &
      rotation, sensor_t, support_t, tip, values_t, x_H_at, x_M_at, x_S_at
   use beamid_kinds, only: wp
   use beamid_variations, only: field_modulus, field_t, field_viscosity, variations_t
   implicit none
   private

   public :: beam_t, same_structure, values_of, yielding

   !> The values of the parameters together with the settings that are not parameters.
   type, extends(values_t) :: beam_t
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
      !> whether `set` was called with a number that is no parameter of this structure;
      !> `check_structure` then refuses the structure
      logical :: has_unknown_parameter = .false.
   contains
      procedure :: has_hose, essential, has_end_spring, has_spring, rigid_supports, items, place, &
         follows_tip, sensor_place, get, set, has_dip, has_fields, factors, factor_slopes
   end type beam_t

   !> The parameter whose value all coefficients of E(x), or of c_D(x), have before a fit.
   integer, parameter :: common_of(2) = [of_E, of_c_D]

   !> The values of all parameters, indexed by parameter number. `transfer` copies a beam to this
   !> type, because an array would be allocated each time.
   type, public :: parameter_values_t
      real(wp) :: q(n_parameters)
   end type parameter_values_t
   !> The values of the beam, or those of one attachment, for `transfer` as well.
   type :: numbers_t
      real(wp) :: q(n_beam) = 0
   end type numbers_t

contains

   !> Returns the values of all parameters.
   pure type(parameter_values_t) function values_of(beam) result(values)
      class(beam_t), intent(in) :: beam

      values = transfer(beam%values_t, values)
   end function values_of

   !> Returns the largest number of attachments of one kind; there is always a sensor.
   pure integer function items(self)
      class(beam_t), intent(in) :: self

      items = max(1, self%sensors, self%supports, self%masses, self%hoses)
   end function items

   !> Returns which hoses, (max(1, hoses)), have a mass. Without a mass, the equations have no
   !> coordinate y.
   pure function has_hose(self)
      class(beam_t), intent(in) :: self
      logical :: has_hose(max(1, self%hoses))

      has_hose = self%hose(:size(has_hose))%m_H > 0
   end function has_hose

   !> Returns the conditions, (condition, end), that hold exactly: their compliance is 0 and stays
   !> 0. The spline space satisfies them.
   pure function essential(self)
      class(beam_t), intent(in) :: self
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
      class(beam_t), intent(in) :: self
      integer, intent(in) :: condition, end

      has_end_spring = merge(self%end(end)%kappa_w, self%end(end)%kappa_R, &
         condition == deflection) < no_spring
   end function has_end_spring

   !> Returns whether support p has a spring, rigid or not, for its deflection or its rotation; a
   !> support may have a damper alone.
   pure logical function has_spring(self, p, condition)
      class(beam_t), intent(in) :: self
      integer, intent(in) :: p, condition

      has_spring = merge(self%support(p)%kappa_P, self%support(p)%kappa_RP, &
         condition == deflection) < no_spring
   end function has_spring

   !> Returns the number of rigid connections of the supports.
   pure integer function rigid_supports(self)
      class(beam_t), intent(in) :: self

      associate (support => self%support(:self%supports))
         rigid_supports = count(.not. support%kappa_P > 0) + count(.not. support%kappa_RP > 0)
      end associate
   end function rigid_supports

   !> Returns the values of one attachment, or those of the beam, in the first entries of q.
   !>
   !> kind, item  as of `find_item`
   pure function values_in(self, kind, item) result(q)
      class(beam_t), intent(in) :: self
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

   !> Returns the value of parameter k as it is stored; NaN if k is no parameter.
   pure real(wp) function stored(self, k)
      class(beam_t), intent(in) :: self
      integer, intent(in) :: k
      real(wp) :: q(n_beam)
      integer :: kind, item, component

      if (k < 1 .or. k > n_parameters) then
         stored = ieee_value(0.0_wp, ieee_quiet_nan)
         return
      end if
      call find_item(k, kind, item, component)
      q = values_in(self, kind, item)
      stored = q(component)
   end function stored

   !> Sets the stored value of parameter k.
   pure subroutine store(self, k, value)
      class(beam_t), intent(inout) :: self
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
      class(beam_t), intent(in) :: self
      integer, intent(in) :: k

      place = stored(self, k)
      if (place < 0) place = self%length
   end function place

   !> Returns whether the position that parameter k stands for is the tip because none was given.
   pure logical function follows_tip(self, k)
      class(beam_t), intent(in) :: self
      integer, intent(in) :: k

      follows_tip = stored(self, k) < 0
   end function follows_tip

   !> Returns the position of the observing sensor [length].
   pure real(wp) function sensor_place(self)
      class(beam_t), intent(in) :: self

      sensor_place = self%place(x_S_at(self%observer))
   end function sensor_place

   !> Returns the value of parameter k; NaN if k is no parameter of a structure. A position that was
   !> not given is returned as the length, and a coefficient that was not set as the value of E or
   !> c_D.
   pure real(wp) function get(self, k)
      class(beam_t), intent(in) :: self
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

   !> Sets parameter k to a value. If k is no parameter of this structure (0, the amplitude, the
   !> offset, or a coefficient that E(x) or c_D(x) does not have), no value changes, and
   !> `check_structure` refuses the structure from then on.
   pure subroutine set(self, k, value)
      class(beam_t), intent(inout) :: self
      integer, intent(in) :: k
      real(wp), intent(in) :: value
      integer :: a
      logical :: is_known

      a = function_of(k)
      is_known = k >= 1 .and. k <= n_parameters
      if (a > 0) is_known = k - coefficient_at(1, a) < self%variations%along(a)%coefficients
      if (.not. is_known) then
         self%has_unknown_parameter = .true.
      else if (a > 0) then
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
      class(beam_t), intent(in) :: a, b
      integer :: item, kind

      same_structure = all([a%supports, a%masses, a%observer] == [b%supports, b%masses, &
         b%observer]) .and. (a%stands .eqv. b%stands) .and. all(abs(values_in(a, 0, 1) &
         - values_in(b, 0, 1)) <= 0)
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
      class(beam_t), intent(in) :: self

      has_dip = self%w_D > 0
   end function has_dip

   !> Returns whether E or c_D vary along the beam by estimated parameters (coefficients or a dip),
   !> in addition to the known variation.
   pure logical function has_fields(self)
      class(beam_t), intent(in) :: self

      has_fields = self%has_dip() .or. allocated(self%variations%along(field_modulus)%value) .or. &
         allocated(self%variations%along(field_viscosity)%value)
   end function has_fields

   !> Returns E(x)/E and c_D(x)/c_D at one position, without the factors of the known variation.
   !>
   !> xi      position x/l, 0 .. 1
   !> result  (2) factor of E, factor of c_D
   pure function factors(self, xi)
      class(beam_t), intent(in) :: self
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
      class(beam_t), intent(in) :: self
      real(wp), intent(in) :: xi

      dip_at = exp(-((xi*self%length - self%x_D)/self%w_D)**2/2)
   end function dip_at

   !> Returns the derivatives of `factors` with respect to parameters, at constant xi.
   !>
   !> xi          position x/l, 0 .. 1
   !> parameters  (n) numbers of the parameters
   !> slopes      (2, n) derivatives of the factor of E and of the factor of c_D
   pure function factor_slopes(self, xi, parameters) result(slopes)
      class(beam_t), intent(in) :: self
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

end module beamid_beams
