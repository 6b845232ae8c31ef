!> The table of terms: M, C, K and F of (3.13) are sums of terms. A term is an operator on the mesh,
!> which contains no parameter, times a coefficient, which is a monomial in the parameters.
!>
!> The mesh has a length of its own. The operator on a beam of length l is the operator of the mesh
!> times a power of (l/mesh length). The length of the beam is therefore a parameter like any other.
module beamid_terms
   use beamid_kinds, only: wp
   use beamid_monomials, only: monomial_t, slope_of, value_of
   use beamid_structure, only: c_H_at, c_P_at, c_R_at, c_RP_at, c_w_at, deflection, J_M_at, &
      J_S_at, k_H_at, kappa_P_at, kappa_R_at, kappa_RP_at, kappa_w_at, m_H_at, m_M_at, m_S_at, &
      most_items, of_a_h, of_b_h, of_c_D, of_d, of_E, of_eta, of_g, of_gamma, of_I, of_J_T, &
      of_length, of_m_T, of_rho, of_T, of_x_F, parameter_values_t, root, rotation, structure_t, &
      tip, values_of, x_H_at, x_M_at, x_P_at, x_S_at
   implicit none
   private

   public :: term_t, terms, strengths, strengths_and_slopes, is_spring, &
      is_axial_force, tilting, operators, operator_t, operators_of, place_on_mesh
   public :: of_mass, of_damping, of_stiffness, of_loss, of_relaxation, of_load, &
      of_compliance
   public :: inertia, bending, tip_value, tip_slope, end_condition, load_shape, &
      is_end_condition, force_value, tension, weight, hysteresis, sensor_value, sensor_slope, &
      hose, hose_value, stretch

   !> Targets of a term: M, C, K, the imaginary part of the stiffness where Im s > 0 (structural
   !> damping), the stiffness times s/(s + b) of two relaxations with the rates b, F, and the
   !> compliance of a spring to the ground, whose reciprocal enters K.
   integer, parameter :: of_mass = 1, of_damping = 2, of_stiffness = 3, of_loss = 4, &
      of_relaxation(2) = [5, 6], of_load = 7, of_compliance = 8

   !> Operators along the beam: `inertia` <b, b>, `bending` <b'', b''>, `tension` <b', b'>, `weight`
   !> <(l - x) b', b'> (l - x: the part of the beam beyond x), `hysteresis` of `beamid_hysteresis`,
   !> and `load_shape` <theta, b> of a distributed load. Operators at a point, products of the value
   !> or slope there (in F the value itself): `tip_value`, `tip_slope`, `force_value`.
   integer, parameter :: inertia = 1, bending = 2, tip_value = 3, tip_slope = 4, load_shape = 5, &
      force_value = 6, tension = 7, weight = 8, hysteresis = 9
   !> Value and slope at root and tip, the springs and dashpots that hold an end, (condition, end).
   integer, parameter :: end_condition(2, 2) = reshape([10, 11, 12, 13], [2, 2])
   !> Number of operators that belong to no attachment, and number of operators of the i-th
   !> attachments of all kinds together.
   integer, parameter :: n_single = 13, n_each = 11
   !> Operators of each attachment: value and slope at the sensor, and `sensor_weight`, <b', b'>
   !> between the root and the sensor; value and slope at the support; value, slope and weight of a
   !> mass; the coordinate y of the hose, `stretch` y - u(x_H), and `hose_value` u(x_H). The last
   !> has no term: y and u(x_H) make up `stretch`.
   integer :: i
   integer, parameter :: sensor_value(most_items) = [(n_single + n_each*i + 1, &
      i=0, most_items - 1)], sensor_slope(most_items) = sensor_value + 1, &
      sensor_weight(most_items) = sensor_value + 2, support_value(most_items) = sensor_value + 3, &
      support_slope(most_items) = sensor_value + 4, mass_value(most_items) = sensor_value + 5, &
      mass_slope(most_items) = sensor_value + 6, mass_weight(most_items) = sensor_value + 7, &
      hose(most_items) = sensor_value + 8, stretch(most_items) = sensor_value + 9, &
      hose_value(most_items) = sensor_value + 10

   !> Properties of an operator.
   type :: operator_t
      integer :: growth = 0          !< exponent of the beam's length in M, C, K or F
      !> order of the derivative with respect to x taken at the point (0: value, 1: slope); -1: the
      !> operator is not at a point
      integer :: derivative = -1
      !> number of the parameter for the position of the point, for the end of an integral, or for
      !> the range of a kernel; 0: root or tip
      integer :: place = 0
      !> whether it responds to a displacement of the whole structure: masses, air damping, and
      !> supports, which are connected to the ground; what holds an end moves with the base
      logical :: moves_with_base = .false.
      !> whether it moves with the base and has a spring or a damper: it is connected to the ground
      logical :: is_grounded = .false.
   end type operator_t

   !> The operators, in the order of their numbers. A structure has the first `operators_of`.
   type(operator_t), parameter :: operators(*) = [ &
      operator_t(1, moves_with_base=.true.), operator_t(-3), &
      operator_t(0, 0, moves_with_base=.true.), operator_t(-2, 1), &
      operator_t(1), operator_t(0, 0, of_x_F), operator_t(-1), operator_t(0), &
      operator_t(-1, place=of_b_h), &
      operator_t(0, 0), operator_t(-2, 1), operator_t(0, 0), operator_t(-2, 1), &
      (operator_t(0, 0, x_S_at(i), .true.), operator_t(-2, 1, x_S_at(i)), &
      operator_t(-1, place=x_S_at(i)), &
      operator_t(0, 0, x_P_at(i), .true., .true.), operator_t(-2, 1, x_P_at(i)), &
      operator_t(0, 0, x_M_at(i), .true.), operator_t(-2, 1, x_M_at(i)), &
      operator_t(-1, place=x_M_at(i)), &
      operator_t(moves_with_base=.true.), operator_t(), operator_t(0, 0, x_H_at(i)), &
      i=1, most_items)]

   !> A term of the equations of motion.
   type :: term_t
      integer :: matrix                           !< target, `of_mass` .. `of_compliance`
      integer :: operator                         !< number of the operator
      type(monomial_t) :: factor = monomial_t()   !< coefficient, without the power of the length
   end type term_t

   !> The table of terms, those of the attachments last.
   type(term_t), parameter :: terms(*) = [ &
      term_t(of_mass, inertia, monomial_t(place=[of_rho, 0, 0])), &
      term_t(of_stiffness, bending, monomial_t(place=[of_E, of_I, 0])), &
      term_t(of_damping, bending, monomial_t(place=[of_c_D, of_I, 0])), &
      term_t(of_damping, inertia, monomial_t(place=[of_gamma, 0, 0])), &
      term_t(of_loss, bending, monomial_t(place=[of_eta, of_E, of_I])), &
      term_t(of_relaxation(1), bending, monomial_t(place=[of_d(1), of_E, of_I])), &
      term_t(of_relaxation(2), bending, monomial_t(place=[of_d(2), of_E, of_I])), &
      term_t(of_damping, hysteresis, monomial_t(place=[of_a_h, 0, 0])), &
      term_t(of_mass, tip_value, monomial_t(place=[of_m_T, 0, 0])), &
      term_t(of_mass, tip_slope, monomial_t(place=[of_J_T, 0, 0])), &
      term_t(of_load, force_value), &
      term_t(of_load, load_shape), &
      (term_t(of_compliance, end_condition(deflection, i), &
      monomial_t(place=[kappa_w_at(i), 0, 0])), &
      term_t(of_damping, end_condition(deflection, i), monomial_t(place=[c_w_at(i), 0, 0])), &
      term_t(of_compliance, end_condition(rotation, i), &
      monomial_t(place=[kappa_R_at(i), 0, 0])), &
      term_t(of_damping, end_condition(rotation, i), monomial_t(place=[c_R_at(i), 0, 0])), &
      i=root, tip), &
      term_t(of_stiffness, tension, monomial_t(place=[of_T, 0, 0])), &
      term_t(of_stiffness, tension, monomial_t(place=[of_g, of_m_T, 0])), &
      term_t(of_stiffness, weight, monomial_t(place=[of_g, of_rho, 0])), &
      (term_t(of_mass, sensor_value(i), monomial_t(place=[m_S_at(i), 0, 0])), &
      term_t(of_mass, sensor_slope(i), monomial_t(place=[J_S_at(i), 0, 0])), &
      term_t(of_stiffness, sensor_weight(i), monomial_t(place=[of_g, m_S_at(i), 0])), &
      term_t(of_compliance, support_value(i), monomial_t(place=[kappa_P_at(i), 0, 0])), &
      term_t(of_damping, support_value(i), monomial_t(place=[c_P_at(i), 0, 0])), &
      term_t(of_compliance, support_slope(i), monomial_t(place=[kappa_RP_at(i), 0, 0])), &
      term_t(of_damping, support_slope(i), monomial_t(place=[c_RP_at(i), 0, 0])), &
      term_t(of_mass, mass_value(i), monomial_t(place=[m_M_at(i), 0, 0])), &
      term_t(of_mass, mass_slope(i), monomial_t(place=[J_M_at(i), 0, 0])), &
      term_t(of_stiffness, mass_weight(i), monomial_t(place=[of_g, m_M_at(i), 0])), &
      term_t(of_mass, hose(i), monomial_t(place=[m_H_at(i), 0, 0])), &
      term_t(of_damping, stretch(i), monomial_t(place=[c_H_at(i), 0, 0])), &
      term_t(of_stiffness, stretch(i), monomial_t(place=[k_H_at(i), 0, 0])), i=1, most_items)]

contains

   !> Returns the number of operators of a structure: those of the beam, and those of as many
   !> attachments of every kind as there are of the most frequent kind.
   pure integer function operators_of(structure)
      type(structure_t), intent(in) :: structure

      operators_of = n_single + n_each*structure%items()
   end function operators_of

   !> Returns the coefficient of every operator in M, C, K and F.
   !>
   !> mesh_length  length of the beam for which the integrals of the mesh were computed [length]
   !> s            (operators, 8) coefficients, one column for each target; `operators_of` is the
   !>              number of operators
   pure function strengths(structure, mesh_length) result(s)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mesh_length
      real(wp) :: s(operators_of(structure), of_compliance), &
         none(operators_of(structure), of_compliance, 0)

      call strengths_and_slopes(structure, mesh_length, [integer ::], s, none)
   end function strengths

   !> Computes the coefficients of `strengths` and their derivatives with respect to parameters.
   !>
   !> mesh_length  length of the beam for which the integrals of the mesh were computed [length]
   !> parameters   (n) numbers of the parameters
   !> s            (operators, 8) coefficients
   !> slopes       (operators, 8, n) derivatives of s
   pure subroutine strengths_and_slopes(structure, mesh_length, parameters, s, slopes)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mesh_length
      integer, intent(in) :: parameters(:)
      real(wp), intent(out), contiguous :: s(:, :), slopes(:, :, :)
      type(parameter_values_t) :: values
      real(wp) :: value, scale
      logical :: enters(size(parameters))
      integer :: k, p, power, t

      values = values_of(structure)
      s = 0
      slopes = 0
      do t = 1, size(terms)
         if (terms(t)%operator > size(s, 1)) exit
         if (.not. is_there(terms(t)%operator, structure)) cycle
         k = terms(t)%operator
         associate (matrix => terms(t)%matrix, factor => terms(t)%factor, &
            place => terms(t)%factor%place, q => values%q)
            value = value_of(factor, q)
            ! An infinite compliance means that there is no spring.
            if (matrix == of_compliance .and. value >= huge(value)) cycle
            ! Written out: this is the innermost loop of every evaluation's set-up.
            do p = 1, size(parameters)
               enters(p) = place(1) == parameters(p) .or. place(2) == parameters(p) .or. &
                  place(3) == parameters(p)
            end do
            if (abs(value) <= 0 .and. .not. any(enters)) cycle
            power = operators(k)%growth
            if (matrix == of_compliance) power = -power
            ! The weight compresses a standing beam.
            scale = 1
            if (structure%stands) scale = merge(-1, 1, any(place == of_g))
            if (power /= 0) scale = scale*(structure%length/mesh_length)**power
            value = scale*value
            s(k, matrix) = s(k, matrix) + value
            do p = 1, size(parameters)
               if (enters(p)) slopes(k, matrix, p) = slopes(k, matrix, p) &
                  + scale*slope_of(factor, q, parameters(p))
               if (parameters(p) == of_length) slopes(k, matrix, p) = slopes(k, matrix, p) &
                  + value*power/structure%length
            end do
         end associate
      end do
      do k = 1, size(s, 1)
         if (.not. s(k, of_compliance) > 0) cycle
         s(k, of_stiffness) = 1/s(k, of_compliance)
         slopes(k, of_stiffness, :) = -slopes(k, of_compliance, :)*s(k, of_stiffness)**2
      end do
   end subroutine strengths_and_slopes

   !> Returns the position of an operator's point, or of the end of its integral, or the range of
   !> its kernel, on the mesh, whose beam has the length `mesh_length` [length].
   pure real(wp) function place_on_mesh(operator, structure, mesh_length) result(x)
      integer, intent(in) :: operator
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: mesh_length

      x = merge(0.0_wp, mesh_length, any(operator == end_condition(:, root)))
      associate (place => operators(operator)%place)
         if (place == 0) return
         ! A point at the tip stays at mesh_length: round-off must not move it off the mesh.
         if (.not. structure%follows_tip(place)) x = structure%place(place) &
            *(mesh_length/structure%length)
      end associate
   end function place_on_mesh

   !> Returns the position of an operator among those of its attachment, in the order of
   !> `sensor_value` .. `hose_value`, from 0 on; -1: the operator belongs to no attachment.
   elemental integer function kind_of(operator)
      integer, intent(in) :: operator

      kind_of = -1
      if (operator > n_single) kind_of = modulo(operator - n_single - 1, n_each)
   end function kind_of

   !> Returns whether the attachment of an operator exists. There is always a sensor and a hose,
   !> whose mass may be 0.
   pure logical function is_there(operator, structure)
      integer, intent(in) :: operator
      type(structure_t), intent(in) :: structure

      associate (item => (operator - n_single - 1)/n_each + 1)
         select case (kind_of(operator))
         case (-1)
            is_there = .true.
         case (0:2)
            is_there = item <= max(1, structure%sensors)
         case (3:4)
            is_there = item <= structure%supports
         case (5:7)
            is_there = item <= structure%masses
         case default
            is_there = item <= max(1, structure%hoses)
         end select
      end associate
   end function is_there

   !> Returns whether an operator is a spring to the ground, which may be rigid: a spring of an end
   !> or of a support.
   pure logical function is_spring(operator, structure)
      integer, intent(in) :: operator
      type(structure_t), intent(in) :: structure
      integer :: at(2), condition, item

      is_spring = is_end_condition(operator)
      if (is_spring) then
         at = findloc(end_condition, operator)
         is_spring = structure%has_end_spring(at(1), at(2))
      else if (operator > n_single .and. is_there(operator, structure)) then
         item = (operator - n_single - 1)/n_each + 1
         condition = operator - support_value(item) + 1
         if (condition == deflection .or. condition == rotation) &
            is_spring = structure%has_spring(item, condition)
      end if
   end function is_spring

   !> Returns whether an operator holds an end of the beam.
   elemental logical function is_end_condition(operator)
      integer, intent(in) :: operator

      is_end_condition = any(end_condition == operator)
   end function is_end_condition

   !> Returns whether an operator is an axial force, along the whole beam or a part of it.
   elemental logical function is_axial_force(operator)
      integer, intent(in) :: operator

      is_axial_force = operator == tension .or. operator == weight .or. &
         any(kind_of(operator) == [2, 7])
   end function is_axial_force

   !> Returns the reading of a sensor per unit of slope that is due to gravity [length/time**2]. The
   !> slope turns the sensor's axis towards the direction of gravity: the reading is g times the
   !> slope on a hanging beam and -g times the slope on a standing one. A sensor at the end of a
   !> simple pendulum, where the acceleration is -g times the slope, therefore reads zero.
   pure real(wp) function tilting(structure)
      type(structure_t), intent(in) :: structure

      tilting = merge(-structure%g, structure%g, structure%stands)
   end function tilting

end module beamid_terms
