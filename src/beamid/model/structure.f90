!> The structure: a beam with everything attached to it, and its statics: deflections, stiffnesses,
!> motions as a rigid body, axial force and buckling.
module beamid_structure
   use beamid_beam_values, only: at_tip, c_D_at, c_H_at, c_P_at, c_R_at, c_RP_at, c_w_at, &
      coefficient_at, compliance_at, deflection, E_at, end_t, free_end, function_of, hose_t, &
      is_coefficient, item_name_length, J_M_at, J_S_at, k_H_at, kappa_P_at, kappa_R_at, &
      kappa_RP_at, kappa_w_at, m_H_at, m_M_at, m_S_at, mass_t, most_coefficients, most_items, &
      n_parameters, no_spring, of_a_h, of_b, of_b_h, of_c_D, of_c_H, of_c_R, of_d, of_d_D, of_E, &
      of_eta, of_g, of_gamma, of_I, of_J_S, of_J_T, of_k_H, of_kappa_R, of_length, of_m_H, of_m_S, &
      of_m_T, of_rho, of_T, of_w_D, of_x_D, of_x_F, of_x_S, root, rotation, sensor_t, support_t, &
      tip, x_H_at, x_M_at, x_P_at, x_S_at
   use beamid_beams, only: beam_t, parameter_values_t, same_structure, values_of, yielding
   use beamid_columns, only: column_buckles, column_deflection, column_spring_t, column_t, &
      new_column
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
   use beamid_quadrature, only: gauss_legendre, rule_t
   use beamid_sorting, only: sort_by
   implicit none
   private

   public :: structure_t, parameter_values_t, same_structure, values_of, yielding
   public :: at_tip, c_D_at, c_H_at, c_P_at, c_R_at, c_RP_at, c_w_at, coefficient_at, &
      compliance_at, deflection, E_at, end_t, free_end, function_of, hose_t, is_coefficient, &
      item_name_length, J_M_at, J_S_at, k_H_at, kappa_P_at, kappa_R_at, kappa_RP_at, kappa_w_at, &
      m_H_at, m_M_at, m_S_at, mass_t, most_coefficients, most_items, n_parameters, no_spring, &
      of_a_h, of_b, of_b_h, of_c_D, of_c_H, of_c_R, of_d, of_d_D, of_E, of_eta, of_g, of_gamma, &
      of_I, of_J_S, of_J_T, of_k_H, of_kappa_R, of_length, of_m_H, of_m_S, of_m_T, of_rho, of_T, &
      of_w_D, of_x_D, of_x_F, of_x_S, root, rotation, sensor_t, support_t, tip, x_H_at, x_M_at, &
      x_P_at, x_S_at

   !> A beam with everything attached to it.
   type, extends(beam_t) :: structure_t
   contains
      procedure :: stiffness, stiffening, static_deflection, tip_stiffness, omega, total_mass, &
         axial_load, buckles, rigid_body_modes, zero_roots
   end type structure_t

contains

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
      q = complex_values(self)
      q(of_x_F) = self%place(of_x_F)
      moved = step*max(abs(self%get(k)), tiny(step)/step)
      if (k <= n_parameters) q(k) = cmplx(real(q(k)), moved, wp)
      x = q(of_x_F)
      if (self%follows_tip(of_x_F) .and. k == of_length) x = q(of_length)
      deflection = influence(self, q, x, x, k, moved)
      if (moved > 0) stiffening = -aimag(deflection)/(real(deflection)*moved)
   end function stiffening

   !> Returns the values of all parameters.
   pure function complex_values(self) result(q)
      class(structure_t), intent(in) :: self
      complex(wp) :: q(n_parameters)
      type(parameter_values_t) :: values

      values = values_of(self)
      q = values%q
   end function complex_values

   !> Returns the deflection at x under a unit static force at x_F [length/force].
   pure real(wp) function static_deflection(self, x)
      class(structure_t), intent(in) :: self
      real(wp), intent(in) :: x

      static_deflection = real(influence(self, complex_values(self), cmplx(x, 0, wp), &
         cmplx(self%place(of_x_F), 0, wp)))
   end function static_deflection

   !> Returns the static stiffness of the tip of a cantilever [force/length], the scale of all
   !> stiffnesses: 3 E I/l**3 if the beam is uniform and the root does not rotate. Conditions at the
   !> tip and supports do not count; a root that rotates freely counts as one with the compliance
   !> 10 l/(E I).
   pure real(wp) function tip_stiffness(self)
      class(structure_t), intent(in) :: self
      complex(wp) :: q(n_parameters)
      real(wp) :: compliance

      q([of_length, of_E, of_I]) = [self%length, self%E, self%I]   ! `flexibility` reads these
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

   !> Returns springs or dampers to the ground: where they act, whether they resist the rotation
   !> (slope 1) or the deflection (slope 0), and their compliances.
   !>
   !> q      as of `influence`
   !> there  (4 + 2 supports) which of them are wanted, in the order of `springs`
   pure function springs_of(self, q, there) result(held)
      class(structure_t), intent(in) :: self
      complex(wp), intent(in) :: q(:)
      logical, intent(in) :: there(:)
      type(column_spring_t) :: held(count(there))
      integer :: c, p

      associate (n => self%supports, root_at => (0.0_wp, 0.0_wp), tip_at => q(of_length))
         held%slope = pack([0, 1, 0, 1, ((c, p=1, n), c=0, 1)], there)
         held%at = pack([root_at, root_at, tip_at, tip_at, q(x_P_at(:n)), q(x_P_at(:n))], there)
         held%compliance = q(pack([compliance_at, kappa_P_at(:n), kappa_RP_at(:n)], there))
      end associate
   end function springs_of

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
      type(column_spring_t) :: held(count(there))
      real(wp) :: rows(2, count(there))
      integer :: i, j

      held = springs_of(self, complex_values(self), there)
      ! Motion of a point by a unit deflection, and by a unit rotation about the root times l.
      do i = 1, size(held)
         rows(:, i) = [1 - held(i)%slope, 1]
         if (held(i)%slope == 0) rows(2, i) = real(held(i)%at)/self%length
      end do
      resisted = min(1, size(held))
      do j = 2, size(held)
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
      class(structure_t), intent(in) :: self
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
      held = springs_of(self, q, springs(self))
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

   !> Returns the beam under its axial force and weight, on its springs, as a `column_t`. Its pieces
   !> end at the positions `places`, at every spring and at every sensor.
   pure function column_of(self, q, places) result(column)
      class(structure_t), intent(in) :: self
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
      held = springs_of(self, q, springs(self))
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
      q = complex_values(self)
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
