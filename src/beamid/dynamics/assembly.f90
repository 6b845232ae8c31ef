!> The equations of motion in modal coordinates: the structure as oscillators that are coupled at a
!> few points.
!>
!> The coordinates are the modes of the bare beam (pinned at the root if the root can rotate) and
!> each hose as one more oscillator. In these coordinates M, C and K are diagonal except for the
!> attachments:
!>
!>     s**2 M + s C + K = D(s) + V H(s) A**-1 V',    D_i = m_i s**2 + c_i s + k_i.
!>
!> Each column of V holds the motion of the rows per unit of one oscillator: the displacements of
!> tip, hoses and attachments, and the slopes at root, tip and attachments. H is a small matrix,
!> the dynamic stiffness of the attachments. A is diagonal. Its entry is 1, except in the row of a
!> spring to the ground: there it is the compliance, and H contains 1 + s c/k, so that the spring
!> may be rigid (compliance 0).
!>
!> Structural damping gives the stiffness an imaginary part, i L, which is also diagonal:
!> D_i = m_i s**2 + c_i s + k_i + i l_i. This holds for Im s > 0; for Im s < 0 the sign of L is the
!> opposite one.
!>
!> Time hysteresis adds r_il s/(s + b_l) to D_i for each relaxation l: D_i is then a quotient, with
!> a real pole in each interval of `beamid_relaxations` beside the two poles of an oscillator.
!>
!> Terms that couple all oscillators of the beam (axial force, weight, spatial hysteresis,
!> properties that vary along the beam) are kept apart in a full matrix E(s), the component `dense`.
!>
!> A hose can be described in two ways. With the coordinate y, c_H s + k_H couples the hose with its
!> point of the beam; with y - u(x_H), m_H s**2 couples them instead. D(s) is the same. The smaller
!> coupling loses fewer digits, so `form_at` chooses for each hose at a given s. The choices are the
!> bits of an integer, the form: bit h - 1 is set if hose h is described by y - u(x_H).
module beamid_assembly
   use beamid_hysteresis, only: hysteresis_products
   use beamid_kinds, only: wp
   use beamid_matrices, only: add_diagonal, outer
   use beamid_modes, only: beam_modes_t
   use beamid_relaxations, only: new_relaxation, relaxation_t
   use beamid_structure, only: is_coefficient, of_b, of_g, of_length, structure_t
   use beamid_terms, only: bending, end_condition, force_value, hose, hose_value, hysteresis, &
      inertia, is_axial_force, is_end_condition, is_spring, load_shape, of_compliance, &
      of_damping, of_load, of_loss, of_mass, of_relaxation, of_stiffness, operators, &
      operators_of, place_on_mesh, sensor_slope, sensor_value, strengths_and_slopes, stretch, &
      tip_slope, tip_value, weight
   implicit none
   private

   public :: assembly_t, new_assembly, quadratic, load_t, relaxed_parts

   !> Rows of `change`: slopes of the coefficients in M, C, K, L and in the relaxing stiffness of
   !> each relaxation, and coefficients of the stiffness whose rate changes.
   integer, parameter :: of_rate(2) = of_relaxation + size(of_relaxation), &
      changes = of_rate(size(of_rate))

   !> Coefficients of the polynomials D(s) and H(s); H without the couplings of the hoses.
   type :: pencil_t
      real(wp), allocatable :: m(:), c(:), k(:)              !< (n) of s**2, s and 1 in D
      real(wp), allocatable :: l(:)                          !< (n) of i in D
      real(wp), allocatable :: hm(:, :), hc(:, :), hk(:, :)  !< (r, r) the same in H, symmetric
   end type pencil_t

   !> The load: a force at a point, a distributed force, or the motion of the base.
   type :: load_t
      !> (beam) <theta, phi> for the modes phi of the bare beam; not allocated: no distributed force
      real(wp), allocatable :: shape(:)
      logical :: base = .false.           !< the base moves; there is no force
   end type load_t

   !> A hose that is an oscillator, or that is held by its spring and dashpot alone.
   type :: hose_row_t
      integer :: point = 0           !< row of V of the displacement of the beam at the hose
      integer :: row = 0             !< row of V of the oscillator; 0: it is none
      integer :: oscillator = 0      !< number of the oscillator; 0: it is none
      !> coupling that acts at the point alone if the hose is no oscillator: `stretch` if the hose
      !> stays at rest because it lacks c_H and k_H, `hose` if it lacks a mass; 0: none
      integer :: at_point = 0
   end type hose_row_t

   !> The equations of one structure and their derivatives with respect to chosen parameters.
   !>
   !> Sizes: n oscillators, r rows, `parameters` the chosen parameters, `operators` those of
   !> `beamid_terms`. A slope is a derivative with respect to a parameter.
   type :: assembly_t
      type(structure_t) :: structure   !< the structure assembled
      !> (operators, matrices) coefficients, from `beamid_terms`
      real(wp), allocatable :: strength(:, :)
      integer :: n = 0                         !< number of oscillators
      integer :: zeros = 0   !< number of roots 0, those of the motion as a rigid body
      integer :: beam = 0   !< number of modes of the bare beam; these oscillators come first
      type(pencil_t) :: pencil      !< D and H
      type(hose_row_t), allocatable :: hose(:)   !< (hoses) the hoses
      !> (beam, beam, 5) E in C, K, L and the relaxing stiffnesses, and (beam, beam, 5, parameters)
      !> its slopes; not allocated: no term couples all oscillators
      real(wp), allocatable :: dense(:, :, :), dense_slope(:, :, :, :)
      real(wp), allocatable :: v(:, :)         !< (r, n) V; column i belongs to oscillator i
      !> (n, r) transpose of V, and (n, r (r + 1)/2) products of its rows k <= l, in the column with
      !> the number k + l (l - 1)/2
      real(wp), allocatable :: vt(:, :), vv(:, :)
      real(wp), allocatable :: compliance(:)   !< (r) diagonal of A
      real(wp), allocatable :: compliance_slope(:, :)   !< (r, parameters) its slopes
      !> (r) whether the spring of the row is so stiff that the pair of roots that it adds is far
      !> above all others and is left out
      logical, allocatable :: rigid(:)
      !> (n) F if all hoses are described by y, per unit force or acceleration of the base, and the
      !> part of the load that is divided by s
      real(wp), allocatable :: load(:), velocity_load(:)
      !> (r) the part of F that acts along the rows if all hoses are described by y, per unit force
      !> or acceleration of the base, and (r, parameters) its slopes. If the motion is small there,
      !> the product with V'x is more accurate than a sum over the oscillators.
      real(wp), allocatable, private :: row_load(:), row_load_slope(:, :)
      !> (hoses) masses that load the points of the hoses, too, if these are described by
      !> y - u(x_H), and (hoses, parameters) their slopes; 0 without a motion of the base
      real(wp), allocatable, private :: hose_load(:), hose_load_slope(:, :)
      !> (n) the remainder of F, (n, parameters) its slopes, and (n, parameters) the slopes of the
      !> part of the load that is divided by s
      real(wp), allocatable :: load_remainder(:), load_remainder_slope(:, :)
      real(wp), allocatable :: velocity_load_slope(:, :)
      logical, allocatable :: load_changes(:)  !< (parameters) whether a slope of F is not 0
      !> (r) displacement of a row per unit displacement of the base: 1 if it measures motion
      !> relative to the ground, otherwise 0. Per unit acceleration of the base, the row moves by
      !> this over s**2.
      real(wp), allocatable :: base_coupling(:)
      !> whether velocity or displacement of the base load the structure, besides its acceleration
      logical :: feels_base = .false.
      !> (n, 2 + relaxations) roots of D_i; without meaning for relaxations of an oscillator that
      !> has none [1/time]
      complex(wp), allocatable :: pole(:, :)
      type(relaxation_t) :: relaxation         !< the relaxations of the modulus
      real(wp) :: rates(2) = 0                 !< b_1 and b_2 of the structure [1/time]
      !> (n, relaxations) stiffness r that relaxes
      real(wp), allocatable :: relaxed(:, :)
      !> (n, relaxations) distances of the real poles from the point of accumulation and from -b
      real(wp), allocatable :: creep(:, :), rise(:, :)
      integer, allocatable :: parameters(:)    !< numbers of the parameters of the slopes
      !> operators of M, C, K, L and the relaxing stiffnesses that depend on a parameter
      integer, allocatable :: changing(:)
      !> (changes, changing, parameters) slopes of their coefficients
      real(wp), allocatable :: change(:, :, :)
      !> (changing, parameters) whether any of these slopes is not 0
      logical, allocatable :: acts(:, :)
      !> (operators) whether a coefficient has a slope that is not 0
      logical, allocatable, private :: has_slope(:)
      !> (beam) eigenvalues of the bare beam's modes: bending integral per unit inertia integral
      !> [1/length**4]
      real(wp), allocatable :: mu(:)
      !> (r, n) derivative of a row of V with respect to the position of its point on the beam of
      !> the mesh, and (r, parameters) the derivative of this position. A row whose point moves has
      !> only a diagonal entry in H.
      real(wp), allocatable :: v_slope(:, :), moves(:, :)
      !> (operators) row of V of an operator; 0: none. A parameter of the slopes may add a row that
      !> the structure itself does not need (J_T = 0, or a sensor that is at the tip by default).
      integer, allocatable :: row(:)
      !> rows of tip and sensor, which may be the same
      integer :: tip = 0, sensor = 0
      !> row of the slope at the sensor; 0: the sensor does not read gravity
      integer :: tilt_row = 0
   contains
      procedure :: renew
      procedure :: is_dense, form_at, distance_from_accumulation, is_bare, is_undamped, roots, &
         load_at, load_rows, row_power, couplings, coupling, mass_couplings, products
      procedure :: set_loss, traces, system_derivative, system_derivative_by_s, dense_products, &
         dense_at, dense_slope_at, second_derivative, full_matrices, load_change, relaxes
   end type assembly_t

   !> A pair of roots this many times above all poles of the oscillators has no influence on the
   !> observed motion.
   real(wp), parameter :: far_away = 1e5_wp

contains

   !> Returns the equations of a structure in modal coordinates.
   !>
   !> structure   beam and attachments
   !> modes       modes of the bare beam
   !> parameters  numbers of the parameters of the slopes
   !> load        kind of load; default: a force at a point
   !> whole       .true.: full matrices even if no term couples all oscillators; default .false.
   function new_assembly(structure, modes, parameters, load, whole) result(self)
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameters(:)
      type(load_t), intent(in), optional :: load
      logical, intent(in), optional :: whole
      type(assembly_t) :: self
      type(load_t) :: applied
      real(wp), allocatable :: slopes(:, :, :)
      real(wp) :: magnitude(operators_of(structure))
      logical, dimension(size(magnitude)) :: needed, used
      integer :: matrix, p, i

      if (present(load)) applied = load
      self%structure = structure
      self%zeros = structure%zero_roots()
      self%parameters = parameters
      self%beam = size(modes%mu)
      allocate (self%strength(size(used), of_compliance), &
         slopes(size(used), of_compliance, size(parameters)))
      call strengths_and_slopes(structure, modes%space%length, parameters, self%strength, slopes)
      magnitude = 0
      do matrix = 1, size(slopes, 2)
         do p = 1, size(parameters)
            magnitude = magnitude + abs(slopes(:, matrix, p))
         end do
      end do
      used = magnitude > 0
      self%has_slope = used
      do matrix = 1, size(slopes, 2)
         magnitude = magnitude + abs(self%strength(:, matrix))
      end do
      needed = magnitude > 0
      do i = 1, size(used)
         needed(i) = needed(i) .or. is_spring(i, structure)
      end do
      call set_rows(self, modes, needed)
      self%mu = modes%mu
      used(bending) = used(bending) .or. any([(any(parameters == of_b(i)), i=1, size(of_b))])
      used = used .and. (operators(:size(used))%derivative < 0 .or. self%row > 0)
      self%changing = pack([(i, i=1, size(used))], used)
      call set_load(self, modes, slopes, applied)
      call set_relaxations(self)
      call set_values(self, modes, slopes)
      call set_dense(self, modes, slopes, whole)
   end function new_assembly

   !> Changes an assembly to that of another structure, if they differ in the values of coefficients
   !> alone: the oscillators, V and the load are the same. The load must not be that of a base.
   !>
   !> structure   beam and attachments
   !> modes       modes of the bare beam, as before
   !> parameters  numbers of the parameters of the slopes
   !> done        .false.: something else differs; the assembly is unchanged
   subroutine renew(self, structure, modes, parameters, done)
      class(assembly_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameters(:)
      logical, intent(out) :: done
      real(wp) :: strength(size(self%strength, 1), size(self%strength, 2))
      real(wp) :: slopes(size(strength, 1), size(strength, 2), size(parameters))
      integer :: condition, k, matrix

      done = .false.
      associate (old => self%structure)
         if (self%is_dense() .or. self%relaxation%n > 0 .or. structure%has_fields() .or. &
            size(parameters) /= size(self%parameters) .or. abs(structure%length - old%length) > 0 &
            .or. any([structure%sensors - old%sensors, structure%supports - old%supports, &
            structure%masses - old%masses, structure%hoses - old%hoses, structure%observer &
            - old%observer] /= 0)) return
         if (any(parameters /= self%parameters) .or. any(structure%yields .neqv. old%yields)) return
         do condition = 1, 2
            do k = 1, 2
               if (structure%has_end_spring(condition, k) .neqv. old%has_end_spring(condition, k)) &
                  return
            end do
            do k = 1, structure%supports
               if (structure%has_spring(k, condition) .neqv. old%has_spring(k, condition)) return
            end do
         end do
         do k = 1, size(self%row)
            if (operators(k)%place == 0 .or. self%row(k) == 0 .and. k /= force_value) cycle
            if (abs(structure%get(operators(k)%place) - old%get(operators(k)%place)) > 0) return
         end do
      end associate
      call strengths_and_slopes(structure, modes%space%length, parameters, strength, slopes)
      do matrix = 1, size(strength, 2)
         do k = 1, size(strength, 1)
            if ((abs(strength(k, matrix)) > 0) .neqv. (abs(self%strength(k, matrix)) > 0)) return
         end do
      end do
      if (size(parameters) > 0) then
         do k = 1, size(strength, 1)
            if (any(abs(slopes(k, :, :)) > 0) .neqv. self%has_slope(k)) return
         end do
      end if
      done = .true.
      self%structure = structure
      self%strength = strength
      self%rates = [structure%b_1, structure%b_2]
      call set_values(self, modes, slopes)
   end subroutine renew

   !> Sets what the coefficients determine: D and H, the poles, the springs and the slopes.
   !>
   !> slopes  (operators, matrices, parameters) from `strengths_and_slopes`
   subroutine set_values(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)

      call set_pencil(self, modes)
      call set_change(self, slopes)
      call set_poles(self)
      call set_springs(self, modes, slopes)
      self%acts = any(abs(self%change) > 0, dim=1)
   end subroutine set_values

   !> Sets the slopes of the coefficients of the operators in `changing`.
   !>
   !> slopes  (operators, matrices, parameters) from `strengths_and_slopes`
   subroutine set_change(self, slopes)
      type(assembly_t), intent(inout) :: self
      real(wp), intent(in) :: slopes(:, :, :)
      integer :: i, l, p

      if (.not. allocated(self%change)) allocate (self%change(changes, size(self%changing), &
         size(self%parameters)))
      self%change = 0
      i = findloc(self%changing, bending, dim=1)
      do p = 1, size(self%parameters)
         self%change(:of_relaxation(2), :, p) = transpose(slopes(self%changing, &
            of_mass:of_relaxation(2), p))
         do l = 1, size(of_b)
            if (self%parameters(p) == of_b(l)) self%change(of_rate(l), i, p) = &
               self%strength(bending, of_relaxation(l))
         end do
      end do
   end subroutine set_change

   !> Sets the relaxations of the oscillators.
   subroutine set_relaxations(self)
      type(assembly_t), intent(inout) :: self
      real(wp) :: strength(2)
      integer :: l

      associate (s => self%strength(bending, :), structure => self%structure)
         self%rates = [structure%b_1, structure%b_2]
         strength = [structure%d_1, structure%d_2]
         if (.not. s(of_stiffness) > 0) strength = 0
         self%relaxation = new_relaxation(strength, self%rates, &
            s(of_damping)/max(s(of_stiffness), tiny(1.0_wp)))
         allocate (self%relaxed(self%n, self%relaxation%n), source=0.0_wp)
         do l = 1, self%relaxation%n
            self%relaxed(:self%beam, l) = self%relaxation%strength(l)*s(of_stiffness)*self%mu
         end do
         allocate (self%creep, self%rise, mold=self%relaxed)
         allocate (self%pole(self%n, 2 + self%relaxation%n))
      end associate
   end subroutine set_relaxations

   !> Numbers the oscillators and the rows of V, and sets V.
   !>
   !> needed  (operators) whether the operator has a coefficient that is not 0, or a slope
   subroutine set_rows(self, modes, needed)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      logical, intent(in) :: needed(:)
      integer :: k, r
      logical :: is_point(size(needed)), reads_gravity

      associate (s => self%structure)
         reads_gravity = s%g > 0 .or. any(self%parameters == of_g)
         allocate (self%row(size(needed)), source=0)
         self%n = self%beam
         self%tip = 1
         self%row(tip_value) = 1
         r = 1
         is_point = needed
         call number_hoses(self, r, is_point)
         do k = 1, size(needed)
            if (k == force_value .or. operators(k)%derivative < 0 .or. self%row(k) > 0 .or. &
               is_essential(modes, k)) cycle
            if (.not. (is_point(k) .or. k == sensor_value(s%observer) .or. reads_gravity .and. &
               k == sensor_slope(s%observer))) cycle
            if (is_end_condition(k) .or. operators(k)%is_grounded .or. &
               .not. stays_at_tip(self, operators(k)%place)) then
               r = r + 1
               self%row(k) = r
            else if (operators(k)%derivative == 0) then
               self%row(k) = self%tip
            else
               if (self%row(tip_slope) == 0) then
                  r = r + 1
                  self%row(tip_slope) = r
               end if
               self%row(k) = self%row(tip_slope)
            end if
         end do
         self%hose%point = self%row(hose_value(:size(self%hose)))
         self%sensor = self%row(sensor_value(s%observer))
         if (reads_gravity) self%tilt_row = self%row(sensor_slope(s%observer))
      end associate
      call set_v(self, modes, r)
   end subroutine set_rows

   !> Numbers the oscillators of the hoses and their rows.
   !>
   !> r         number of rows so far
   !> is_point  (operators) in and out: whether the operator needs a row
   subroutine number_hoses(self, r, is_point)
      type(assembly_t), intent(inout) :: self
      integer, intent(inout) :: r
      logical, intent(inout) :: is_point(:)
      logical, allocatable :: has_mass(:)
      logical :: is_held
      integer :: h

      has_mass = self%structure%has_hose()
      allocate (self%hose(size(has_mass)))
      do h = 1, size(has_mass)
         is_held = any(self%strength(stretch(h), :) > 0)
         is_point(hose_value(h)) = is_point(hose(h)) .or. is_point(stretch(h))
         if (has_mass(h) .and. is_held) then
            r = r + 1
            self%n = self%n + 1
            self%hose(h) = hose_row_t(row=r, oscillator=self%n)
         else if (has_mass(h)) then
            self%hose(h)%at_point = stretch(h)
         else if (is_held) then
            self%hose(h)%at_point = hose(h)
         end if
      end do
   end subroutine number_hoses

   !> Returns whether an operator is a condition at an end that the spline space itself satisfies.
   pure logical function is_essential(modes, operator)
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: operator

      is_essential = any(end_condition == operator .and. modes%space%essential)
   end function is_essential

   !> Sets V, its products, and its derivatives with respect to the positions of the points.
   !>
   !> r  number of rows
   subroutine set_v(self, modes, r)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: r
      integer :: h, k, l

      allocate (self%v(r, self%n), self%v_slope(r, self%n), &
         self%moves(r, size(self%parameters)), source=0.0_wp)
      do h = 1, size(self%hose)
         if (self%hose(h)%row > 0) self%v(self%hose(h)%row, self%hose(h)%oscillator) = 1
      end do
      do k = 1, size(self%row)
         if (self%row(k) == 0) cycle
         associate (row => self%row(k))
            self%v(row, :) = modes_at_point(self, modes, k, 0)
            self%moves(row, :) = position_slopes(self, modes, k)
            if (any(abs(self%moves(row, :)) > 0)) &
               self%v_slope(row, :) = modes_at_point(self, modes, k, 1)
         end associate
      end do
      allocate (self%vt, source=transpose(self%v))
      allocate (self%vv(self%n, (r*(r + 1))/2))
      do l = 1, r
         do k = 1, l
            self%vv(:, k + (l*(l - 1))/2) = self%vt(:, k)*self%vt(:, l)
         end do
      end do
   end subroutine set_v

   !> Returns whether a point is the tip and no parameter of the slopes moves it away.
   !>
   !> place  number of the parameter for the position; 0: the tip by definition
   pure logical function stays_at_tip(self, place)
      type(assembly_t), intent(in) :: self
      integer, intent(in) :: place

      stays_at_tip = place == 0
      if (place == 0) return
      stays_at_tip = self%structure%follows_tip(place) .and. .not. any(self%parameters == place)
   end function stays_at_tip

   !> Returns the values of the modes at the point of an operator, or of their derivatives.
   !>
   !> k     operator
   !> more  additional derivatives with respect to x, beyond the operator's own
   function modes_at_point(self, modes, k, more) result(values)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: k, more
      real(wp) :: values(self%n)

      values = 0
      values(:self%beam) = modes%at(place_on_mesh(k, self%structure, modes%space%length), &
         operators(k)%derivative + more)
   end function modes_at_point

   !> Returns the derivatives of an operator's position on the beam of the mesh with respect to the
   !> parameters.
   !>
   !> k      operator
   !> moves  (parameters) [length per unit of the parameter]
   pure function position_slopes(self, modes, k) result(moves)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: k
      real(wp) :: moves(size(self%parameters))

      moves = 0
      if (operators(k)%place == 0) return
      associate (s => self%structure, place => operators(k)%place, l => modes%space%length)
         where (self%parameters == place) moves = l/s%length
         if (s%follows_tip(place)) return
         where (self%parameters == of_length) moves = -s%place(place)*l/s%length**2
      end associate
   end function position_slopes

   !> Sets the rows of the springs to the ground, rigid or not. The unknown of such a row is the
   !> force y of the spring: A y is the motion, and (1 + s c/k) y the force of spring and damper, in
   !> a unit that gives the row the size of the others.
   !>
   !> slopes  (operators, matrices, parameters) from `strengths_and_slopes`
   subroutine set_springs(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      real(wp) :: unit, flexibility
      integer :: i, k

      if (.not. allocated(self%rigid)) allocate (self%compliance(size(self%v, 1)), &
         self%compliance_slope(size(self%v, 1), size(self%parameters)), &
         self%rigid(size(self%v, 1)))
      self%compliance = 1
      self%compliance_slope = 0
      self%rigid = .false.
      do k = 1, size(self%row)
         if (self%row(k) == 0 .or. .not. is_spring(k, self%structure)) cycle
         associate (row => self%row(k), l => modes%space%length, s => self%strength(k, :))
            unit = self%strength(bending, of_stiffness)*modes%mu(self%beam) &
               *l**(1 + 2*operators(k)%derivative)
            self%compliance(row) = unit*s(of_compliance)
            self%compliance_slope(row, :) = unit*slopes(k, of_compliance, :)
            self%pencil%hk(row, row) = unit
            self%pencil%hc(row, row) = unit*s(of_compliance)*s(of_damping)
            if (any(self%changing == k)) then
               i = findloc(self%changing, k, dim=1)
               self%change(2, i, :) = unit*(slopes(k, of_compliance, :)*s(of_damping) &
                  + s(of_compliance)*slopes(k, of_damping, :))
               self%change(3, i, :) = 0
            end if
            ! The pair of roots of so stiff a spring is far away and is left out. A rigid spring is
            ! held even if the poles are beyond the range of numbers.
            flexibility = sum(self%v(row, :)**2/self%pencil%m)
            self%rigid(row) = .not. flexibility < &
               s(of_compliance)*(far_away*maxval(abs(self%pole)))**2
         end associate
      end do
   end subroutine set_springs

   !> Sets E and its slopes, if a term couples all oscillators.
   !>
   !> slopes  (operators, matrices, parameters) from `strengths_and_slopes`
   !> whole   .true.: in any case
   subroutine set_dense(self, modes, slopes, whole)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      logical, intent(in), optional :: whole
      real(wp), allocatable :: mode_slope(:)
      logical :: needed, lags, pull(size(self%row))
      integer :: j, k

      do j = 1, size(pull)
         pull(j) = is_axial_force(j)
         if (pull(j)) pull(j) = abs(self%strength(j, of_stiffness)) > 0 .or. &
            any(abs(slopes(j, of_stiffness, :)) > 0)
      end do
      lags = abs(self%strength(hysteresis, of_damping)) > 0 .or. &
         any(abs(slopes(hysteresis, of_damping, :)) > 0)
      needed = allocated(modes%damping_remainder) .or. has_field(self) .or. lags .or. any(pull)
      if (present(whole)) needed = needed .or. whole
      if (.not. needed) return
      allocate (self%dense(self%beam, self%beam, 5), &
         self%dense_slope(self%beam, self%beam, 5, size(self%parameters)), source=0.0_wp)
      if (allocated(modes%damping_remainder)) then
         do j = 1, 2
            k = merge(inertia, bending, j == 1)
            call add_dense(self, 1, modes%damping_remainder(:, :, j), &
               self%strength(k, of_damping), slopes(k, of_damping, :))
         end do
      end if
      if (has_field(self)) call add_field_bending(self, modes, slopes)
      if (lags) call add_hysteresis(self, modes, slopes)
      if (.not. any(pull)) return
      do k = 1, size(pull)
         if (.not. pull(k)) cycle
         associate (s => self%strength(k, of_stiffness), &
            x => place_on_mesh(k, self%structure, modes%space%length))
            call add_dense(self, 2, modes%tension(x, merge(0.0_wp, 1.0_wp, k == weight), &
               merge(1.0_wp, 0.0_wp, k == weight)), s, slopes(k, of_stiffness, :))
            mode_slope = modes%at(x, 1)
            call add_dense(self, 2, outer(mode_slope, mode_slope), 0.0_wp, &
               s*position_slopes(self, modes, k))
         end associate
      end do
   end subroutine set_dense

   !> Adds a matrix to E, and to the slopes of E.
   !>
   !> j       1: to E in C, 2: in K, 3: in L, 4 and 5: in the relaxing stiffnesses
   !> matrix  (beam, beam)
   !> s, s_p  coefficient of the matrix, and (parameters) its slopes
   pure subroutine add_dense(self, j, matrix, s, s_p)
      type(assembly_t), intent(inout) :: self
      integer, intent(in) :: j
      real(wp), intent(in) :: matrix(:, :), s, s_p(:)
      integer :: p

      self%dense(:, :, j) = self%dense(:, :, j) + s*matrix
      do p = 1, size(s_p)
         if (abs(s_p(p)) > 0) self%dense_slope(:, :, j, p) = self%dense_slope(:, :, j, p) &
            + s_p(p)*matrix
      end do
   end subroutine add_dense

   !> Adds spatial hysteresis to E and its slopes.
   !>
   !> slopes  (operators, matrices, parameters) from `strengths_and_slopes`
   subroutine add_hysteresis(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      real(wp), dimension(self%beam, self%beam) :: products, by_range

      associate (s => self%strength(hysteresis, of_damping))
         call hysteresis_products(modes, place_on_mesh(hysteresis, self%structure, &
            modes%space%length), products, by_range)
         call add_dense(self, 1, products, s, slopes(hysteresis, of_damping, :))
         call add_dense(self, 1, by_range, 0.0_wp, s*position_slopes(self, modes, hysteresis))
      end associate
   end subroutine add_hysteresis

   !> Returns whether E(x) or c_D(x) depends on parameters: on those of the structure, or on a
   !> parameter of the slopes.
   pure logical function has_field(self)
      type(assembly_t), intent(in) :: self

      has_field = self%structure%has_fields() .or. any(is_coefficient(self%parameters))
   end function has_field

   !> Adds to E the bending that E(x) and c_D(x) cause beyond constant E and c_D and the known
   !> variation, and to its slopes their derivatives.
   !>
   !> slopes  (operators, matrices, parameters) from `strengths_and_slopes`
   subroutine add_field_bending(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      integer, parameter :: matrix(5) = [of_damping, of_stiffness, of_loss, of_relaxation]
      real(wp) :: factor(size(modes%bent), 2)
      real(wp) :: slope(2, size(self%parameters), size(modes%bent))
      integer :: j, k, p, q

      ! The functions return stiffness first, which loss and relaxations follow, and viscosity
      ! second.
      do q = 1, size(modes%bent)
         factor(q, :) = self%structure%factors(modes%bent(q)) - 1
         slope(:, :, q) = self%structure%factor_slopes(modes%bent(q), self%parameters)
      end do
      do j = 1, size(matrix)
         k = merge(2, 1, matrix(j) == of_damping)
         associate (s => self%strength(bending, matrix(j)))
            if (.not. (s > 0 .or. any(abs(slopes(bending, matrix(j), :)) > 0))) cycle
            if (any(abs(factor(:, k)) > 0)) call add_dense(self, j, &
               modes%bending_products(modes%known(:, k)*factor(:, k)), s, &
               slopes(bending, matrix(j), :))
            do p = 1, size(self%parameters)
               if (any(abs(slope(k, p, :)) > 0)) self%dense_slope(:, :, j, p) = &
                  self%dense_slope(:, :, j, p) + s*modes%bending_products(modes%known(:, k) &
                  *slope(k, p, :))
            end do
         end associate
      end do
   end subroutine add_field_bending

   !> Returns whether a term couples all oscillators of the beam.
   pure logical function is_dense(self)
      class(assembly_t), intent(in) :: self

      is_dense = allocated(self%dense)
   end function is_dense

   !> Sets F and its slopes: the part along the rows of V and the remainder.
   !>
   !> A base that moves loads the structure by -M r and, divided by s, by -C r, where r is the rigid
   !> displacement of the whole structure by one. An operator that is connected to the ground is
   !> treated differently: its row measures motion relative to the ground (`base_coupling`), which
   !> loads all of its terms.
   !>
   !> slopes   (operators, matrices, parameters) from `strengths_and_slopes`
   !> applied  kind of load
   subroutine set_load(self, modes, slopes, applied)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      type(load_t), intent(in) :: applied
      real(wp), dimension(self%n) :: point, point_slope, spread_out
      real(wp) :: moves(size(self%parameters))
      integer :: k, p

      allocate (self%velocity_load(self%n), self%base_coupling(size(self%v, 1)), source=0.0_wp)
      allocate (self%row_load_slope(size(self%v, 1), size(self%parameters)), &
         self%hose_load_slope(size(self%hose), size(self%parameters)), &
         self%load_remainder_slope(self%n, size(self%parameters)))
      self%row_load = along_rows(self, self%strength, applied%base)
      self%hose_load = of_hoses(self%strength)
      spread_out = 0
      if (applied%base) spread_out(:self%beam) = -modes%total(:, 1)
      if (allocated(applied%shape)) spread_out(:self%beam) = applied%shape
      point = 0
      point_slope = 0
      moves = 0
      if (.not. (applied%base .or. stays_at_tip(self, operators(force_value)%place))) then
         point = modes_at_point(self, modes, force_value, 0)
         point_slope = modes_at_point(self, modes, force_value, 1)
         moves = position_slopes(self, modes, force_value)
      end if
      self%load_remainder = rest_load(self%strength)
      self%load = self%load_remainder + matmul(self%row_load, self%v)
      do p = 1, size(self%parameters)
         self%row_load_slope(:, p) = along_rows(self, slopes(:, :, p), applied%base)
         self%hose_load_slope(:, p) = of_hoses(slopes(:, :, p))
         self%load_remainder_slope(:, p) = rest_load(slopes(:, :, p)) &
            + self%strength(force_value, of_load)*moves(p)*point_slope
      end do
      self%load_changes = [(applied%base .or. any(abs(self%row_load_slope(:, p)) > 0) .or. &
         any(abs(self%load_remainder_slope(:, p)) > 0), p=1, size(self%parameters))]
      if (.not. applied%base) return
      spread_out(:self%beam) = -modes%total(:, 2)
      self%velocity_load = self%strength(inertia, of_damping)*spread_out
      allocate (self%velocity_load_slope(self%n, size(self%parameters)))
      do p = 1, size(self%parameters)
         self%velocity_load_slope(:, p) = slopes(inertia, of_damping, p)*spread_out
      end do
      do k = 1, size(self%row)
         if (self%row(k) > 0 .and. operators(k)%is_grounded) self%base_coupling(self%row(k)) = 1
      end do
      self%feels_base = any(self%base_coupling > 0) .or. any(abs(self%velocity_load) > 0) .or. &
         any(abs(self%velocity_load_slope) > 0)

   contains

      !> Returns the part of F that acts along no row, or a derivative of it.
      pure function rest_load(s) result(rest)
         real(wp), intent(in) :: s(:, :)   !< (operators, matrices), or a derivative
         real(wp) :: rest(self%n)

         if (applied%base) then
            rest = s(inertia, of_mass)*spread_out
         else
            rest = s(force_value, of_load)*point + s(load_shape, of_load)*spread_out
         end if
      end function rest_load

      !> Returns the masses of the hoses that a base carries along, or a derivative of them.
      pure function of_hoses(s) result(masses)
         real(wp), intent(in) :: s(:, :)   !< (operators, matrices), or a derivative
         real(wp) :: masses(size(self%hose))

         masses = 0
         if (applied%base) where (self%hose%row > 0) masses = s(hose(:size(masses)), of_mass)
      end function of_hoses

   end subroutine set_load

   !> Returns the part of F that acts along the rows of V if all hoses are described by y, or a
   !> derivative of it, (r).
   !>
   !> s     (operators, matrices) coefficients, or their derivatives
   !> base  whether the base moves
   pure function along_rows(self, s, base) result(load)
      type(assembly_t), intent(in) :: self
      real(wp), intent(in) :: s(:, :)
      logical, intent(in) :: base
      real(wp) :: load(size(self%v, 1))
      integer :: h, k

      load = 0
      if (.not. base) then
         if (stays_at_tip(self, operators(force_value)%place)) &
            load(self%tip) = s(force_value, of_load)
         return
      end if
      do k = 1, size(self%row)
         if (self%row(k) == 0 .or. .not. operators(k)%moves_with_base .or. &
            operators(k)%is_grounded) cycle
         load(self%row(k)) = load(self%row(k)) - s(k, of_mass)
      end do
      do h = 1, size(self%hose)
         associate (row => merge(self%hose(h)%row, self%hose(h)%point, self%hose(h)%row > 0))
            ! A hose that nothing holds stays where it is.
            if (self%hose(h)%row > 0 .or. self%hose(h)%at_point == hose(h)) &
               load(row) = load(row) - s(hose(h), of_mass)
         end associate
      end do
   end function along_rows

   !> Computes the part of F that acts along the rows of V in a form, or a derivative of it.
   !>
   !> form  from `form_at`
   !> load  (r)
   !> p     index among the parameters of the slopes; absent: F itself
   pure subroutine load_rows(self, form, load, p)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      real(wp), intent(out) :: load(:)
      integer, intent(in), optional :: p
      real(wp) :: mass
      integer :: h

      if (present(p)) then
         load = self%row_load_slope(:, p)
      else
         load = self%row_load
      end if
      if (form == 0) return
      do h = 1, size(self%hose)
         if (.not. btest(form, h - 1)) cycle
         mass = self%hose_load(h)
         if (present(p)) mass = self%hose_load_slope(h, p)
         load(self%hose(h)%point) = load(self%hose(h)%point) - mass
      end do
   end subroutine load_rows

   !> Returns y'F of the part of F that acts along the rows of V.
   !>
   !> form  in which y is given, from `form_at`
   !> y     (r) motion of the rows
   pure complex(wp) function row_power(self, form, y) result(power)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: y(:)
      integer :: h, i

      power = 0
      do i = 1, size(y)
         power = power + self%row_load(i)*y(i)
      end do
      do h = 1, size(self%hose)
         if (btest(form, h - 1)) power = power - self%hose_load(h)*y(self%hose(h)%point)
      end do
   end function row_power

   !> Computes z'Op x for each operator that depends on a parameter, where x and z are two motions.
   !> For a spring to the ground the product is A y w.
   !>
   !> form  in which the motions are given, from `form_at`
   !> x, y  (n), (r) first motion: oscillators and rows A**-1 V'x
   !> z, w  (n), (r) second motion
   !> q     (changing) the products
   pure subroutine products(self, form, x, y, z, w, q)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: x(:), y(:), z(:), w(:)
      complex(wp), intent(out) :: q(:)
      complex(wp) :: own(size(y)), between(size(self%hose))
      integer :: h

      own = self%compliance*y*w
      do h = 1, size(self%hose)
         between(h) = 0
         if (self%hose(h)%row == 0) cycle
         associate (u => self%hose(h)%point, v => self%hose(h)%row, A => self%compliance)
            between(h) = A(u)*y(u)*w(v) + A(v)*y(v)*w(u)
         end associate
      end do
      call add_traces(self, form, x*z, own, between, q)
   end subroutine products

   !> Computes the trace of Op Z for each operator that depends on a parameter, where Z is Q**-1, or
   !> x z' of two motions.
   !>
   !> form      from `form_at`
   !> diagonal  (n) diagonal of Z
   !> T         (r, r) A**-1 V'Z V
   !> q         (changing) the traces
   pure subroutine traces(self, form, diagonal, T, q)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: diagonal(:), T(:, :)
      complex(wp), intent(out) :: q(:)
      complex(wp) :: own(size(T, 1)), between(size(self%hose))
      integer :: h, k

      own = [(T(k, k), k=1, size(own))]
      do h = 1, size(self%hose)
         between(h) = 0
         if (self%hose(h)%row == 0) cycle
         associate (u => self%hose(h)%point, v => self%hose(h)%row)
            between(h) = T(u, v) + T(v, u)
         end associate
      end do
      call add_traces(self, form, diagonal, own, between, q)
   end subroutine traces

   !> Adds up the traces of `traces` from the entries that operators on a point or on a hose need.
   !>
   !> own      (r) diagonal of A**-1 V'Z V
   !> between  (hoses) sum of both entries between the row of the point and that of the hose
   pure subroutine add_traces(self, form, diagonal, own, between, q)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: diagonal(:), own(:), between(:)
      complex(wp), intent(out) :: q(:)
      integer :: h, i

      associate (b => self%beam)
         do i = 1, size(self%changing)
            associate (k => self%changing(i), row => self%row(self%changing(i)))
               q(i) = 0
               if (row > 0) then
                  q(i) = own(row)
               else if (k == inertia) then
                  q(i) = sum(diagonal(:b))
               else if (k == bending) then
                  q(i) = sum(self%mu*diagonal(:b))
               else
                  do h = 1, size(self%hose)
                     if (.not. (k == hose(h) .or. k == stretch(h))) cycle
                     associate (of => self%hose(h))
                        q(i) = hose_trace(of, k, h, form, diagonal(max(1, of%oscillator)), &
                           own(of%point), between(h))
                     end associate
                  end do
               end if
            end associate
         end do
      end associate
   end subroutine add_traces

   !> Returns the trace of an operator of a hose.
   !>
   !> of        the hose
   !> k, h      operator and number of the hose
   !> form      from `form_at`
   !> own       diagonal of Z at its oscillator
   !> at_point  diagonal of A**-1 V'Z V at the row of its point
   !> between   sum of both entries between this row and that of the hose
   pure complex(wp) function hose_trace(of, k, h, form, own, at_point, between) result(trace)
      type(hose_row_t), intent(in) :: of
      integer, intent(in) :: k, h, form
      complex(wp), intent(in) :: own, at_point, between
      integer :: sign

      trace = 0
      if (of%row == 0) then
         if (of%at_point == k) trace = at_point
         return
      end if
      trace = own
      ! With y, the spring couples hose and beam; with y - u(x_H), the mass moves by the sum.
      sign = merge(1, -1, btest(form, h - 1))
      if (k == merge(hose(h), stretch(h), sign > 0)) trace = trace + at_point + sign*between
   end function hose_trace

   !> Returns the factors of the rows of `change` in Q at a point.
   !>
   !> s     [1/time]
   !> past  (2) s + b_1 and s + b_2 [1/time]
   !> f     (changes) factors
   !> df    (changes) their derivatives with respect to s
   pure subroutine change_factors(s, past, rates, f, df)
      complex(wp), intent(in) :: s, past(2)
      real(wp), intent(in) :: rates(2)
      complex(wp), intent(out) :: f(changes), df(changes)
      integer :: l

      f(:of_loss) = [s**2, s, (1.0_wp, 0.0_wp), (0.0_wp, 1.0_wp)]
      df(:of_loss) = [2*s, (1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)]
      f(of_loss + 1:) = 0
      df(of_loss + 1:) = 0
      do l = 1, size(rates)
         if (.not. rates(l) > 0) cycle
         f(of_relaxation(l)) = s/past(l)
         df(of_relaxation(l)) = rates(l)/past(l)**2
         f(of_rate(l)) = -s/past(l)**2
         df(of_rate(l)) = (s - rates(l))/past(l)**3
      end do
   end subroutine change_factors

   !> Returns the factors of the relaxing stiffnesses at a point, s/(s + b), and their first two
   !> derivatives with respect to s.
   !>
   !> s      [1/time]
   !> past   (2) s + b_1 and s + b_2 [1/time]
   !> parts  (0:2, 2) derivatives of each order; 0 for a relaxation without a rate
   pure function relaxed_parts(s, past, rates) result(parts)
      complex(wp), intent(in) :: s, past(2)
      real(wp), intent(in) :: rates(2)
      complex(wp) :: parts(0:2, 2)
      integer :: l

      parts = 0
      do l = 1, size(rates)
         if (.not. rates(l) > 0) cycle
         parts(:, l) = [s/past(l), rates(l)/past(l)**2, -2*rates(l)/past(l)**3]
      end do
   end function relaxed_parts

   !> Returns the sum of s**2 M_p + s C_p + K_p + i L_p and the relaxing stiffnesses over the
   !> operators: z'Q_p x or tr Q**-1 Q_p.
   !>
   !> q     (changing) from `products` or `traces`
   !> s     [1/time]
   !> past  (2) s + b_1 and s + b_2 [1/time]
   !> p     index among the parameters of the slopes
   pure complex(wp) function system_derivative(self, q, s, past, p) result(value)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), s, past(2)
      integer, intent(in) :: p
      complex(wp) :: f(changes), df(changes)
      integer :: i

      value = 0
      if (any(self%rates > 0)) then
         call change_factors(s, past, self%rates, f, df)
         do i = 1, size(q)
            if (self%acts(i, p)) value = value + sum(self%change(:, i, p)*f)*q(i)
         end do
         return
      end if
      do i = 1, size(q)
         if (.not. self%acts(i, p)) cycle
         value = value + ((self%change(1, i, p)*s + self%change(2, i, p))*s &
            + cmplx(self%change(3, i, p), self%change(4, i, p), wp))*q(i)
      end do
   end function system_derivative

   !> Returns the derivative of `system_derivative` with respect to s at constant q; arguments as
   !> there.
   pure complex(wp) function system_derivative_by_s(self, q, s, past, p) result(value)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), s, past(2)
      integer, intent(in) :: p
      complex(wp) :: f(changes), df(changes)
      integer :: i

      value = 0
      if (any(self%rates > 0)) then
         call change_factors(s, past, self%rates, f, df)
         do i = 1, size(q)
            if (self%acts(i, p)) value = value + sum(self%change(:, i, p)*df)*q(i)
         end do
         return
      end if
      do i = 1, size(q)
         if (.not. self%acts(i, p)) cycle
         value = value + (2*self%change(1, i, p)*s + self%change(2, i, p))*q(i)
      end do
   end function system_derivative_by_s

   !> Returns E at a point, or a derivative with respect to s, (beam, beam).
   !>
   !> s      [1/time]
   !> past   (2) s + b_1 and s + b_2 [1/time]
   !> order  order of the derivative, 0 to 2
   pure function dense_at(self, s, past, order) result(E)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s, past(2)
      integer, intent(in) :: order
      complex(wp) :: E(self%beam, self%beam), parts(0:2, 2)
      integer :: l

      select case (order)
      case (0)
         E = self%dense(:, :, 1)*s + cmplx(self%dense(:, :, 2), self%dense(:, :, 3), wp)
      case (1)
         E = self%dense(:, :, 1)
      case default
         E = 0
      end select
      if (.not. any(self%rates > 0)) return
      parts = relaxed_parts(s, past, self%rates)
      do l = 1, size(past)
         if (any(abs(self%dense(:, :, 3 + l)) > 0)) E = E + parts(order, l)*self%dense(:, :, 3 + l)
      end do
   end function dense_at

   !> Returns the derivative of E with respect to a parameter at a point, or its derivative with
   !> respect to s, (beam, beam).
   !>
   !> s, past  as of `dense_at`
   !> p        index among the parameters of the slopes
   !> order    order of the derivative with respect to s, 0 or 1
   pure function dense_slope_at(self, s, past, p, order) result(E)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s, past(2)
      integer, intent(in) :: p, order
      complex(wp) :: E(self%beam, self%beam), parts(0:2, 2)
      integer :: l

      associate (slope => self%dense_slope(:, :, :, p))
         E = slope(:, :, 1)
         if (order == 0) E = slope(:, :, 1)*s + cmplx(slope(:, :, 2), slope(:, :, 3), wp)
         if (.not. any(self%rates > 0)) return
         parts = relaxed_parts(s, past, self%rates)
         do l = 1, size(past)
            E = E + parts(order, l)*slope(:, :, 3 + l)
            if (self%parameters(p) /= of_b(l)) cycle
            if (order == 0) E = E - s/past(l)**2*self%dense(:, :, 3 + l)
            if (order == 1) E = E + (s - self%rates(l))/past(l)**3*self%dense(:, :, 3 + l)
         end do
      end associate
   end function dense_slope_at

   !> Returns z'E_p x at a point and its derivative with respect to s; 0 if the assembly is not
   !> dense.
   !>
   !> x, z     (n) two motions of the oscillators
   !> s, past  as of `dense_at`
   !> p        index among the parameters of the slopes
   pure function dense_products(self, x, z, s, past, p) result(q)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: x(:), z(:), s, past(2)
      integer, intent(in) :: p
      complex(wp) :: q(2)
      logical :: varies
      integer :: l, order

      q = 0
      if (.not. self%is_dense()) return
      varies = any(abs(self%dense_slope(:, :, :, p)) > 0)
      do l = 1, size(of_b)
         varies = varies .or. self%parameters(p) == of_b(l)
      end do
      if (.not. varies) return
      do order = 0, 1
         q(1 + order) = sum(z(:self%beam)*matmul(self%dense_slope_at(s, past, p, order), &
            x(:self%beam)))
      end do
   end function dense_products

   !> Returns x'Q'' x of the oscillators without the rows, where Q'' is the second derivative with
   !> respect to s.
   !>
   !> x, z     (n) two motions of the oscillators
   !> s, past  as of `dense_at`
   pure complex(wp) function second_derivative(self, x, z, s, past) result(value)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: x(:), z(:), s, past(2)
      integer :: l

      value = 2*sum(self%pencil%m*x*z)
      if (self%relaxation%n == 0) return
      do l = 1, size(past)
         if (self%relaxation%slot(l) == 0) cycle
         value = value - 2*self%rates(l)/past(l)**3*self%strength(bending, of_relaxation(l)) &
            *sum(self%mu*x(:self%beam)*z(:self%beam))
      end do
      if (self%is_dense()) value = value + sum(z(:self%beam)*matmul(self%dense_at(s, past, 2), &
         x(:self%beam)))
   end function second_derivative

   !> Returns whether oscillator i has relaxations.
   pure logical function relaxes(self, i)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: i

      relaxes = any(self%relaxed(i, :) > 0)
   end function relaxes

   !> Computes M, C and K of the oscillators as full matrices.
   !>
   !> compliance  (r) diagonal of A, with a value above 0 in place of a rigid spring
   !> M, C, K     (n, n)
   pure subroutine full_matrices(self, compliance, M, C, K)
      class(assembly_t), intent(in) :: self
      real(wp), intent(in) :: compliance(:)
      real(wp), dimension(:, :), intent(out) :: M, C, K
      real(wp) :: scaled(self%n, size(compliance)), h(size(compliance), size(compliance))

      associate (p => self%pencil, v => self%v, b => self%beam)
         scaled = self%vt/spread(compliance, 1, self%n)
         call self%coupling(of_mass, 0, h)
         M = matmul(self%vt, matmul(h, v))
         call self%coupling(of_damping, 0, h)
         C = matmul(scaled, matmul(h, v))
         call self%coupling(of_stiffness, 0, h)
         K = matmul(scaled, matmul(h, v))
         call add_diagonal(M, p%m)
         call add_diagonal(C, p%c)
         call add_diagonal(K, p%k)
         if (.not. self%is_dense()) return
         C(:b, :b) = C(:b, :b) + self%dense(:, :, 1)
         K(:b, :b) = K(:b, :b) + self%dense(:, :, 2)
      end associate
   end subroutine full_matrices

   !> Returns x'F_p at s, without the contribution of rows whose points move.
   !>
   !> form  from `form_at`
   !> x, y  (n), (r) motion: oscillators and rows
   !> s     [1/time]
   !> p     index among the parameters of the slopes
   pure complex(wp) function load_change(self, form, x, y, s, p) result(change)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form, p
      complex(wp), intent(in) :: x(:), y(:), s

      real(wp) :: load(size(y))

      change = 0
      if (.not. self%load_changes(p)) return
      call self%load_rows(form, load, p)
      change = sum(self%load_remainder_slope(:, p)*x) + sum(load*y)
      if (allocated(self%velocity_load_slope)) change = change &
         + sum(self%velocity_load_slope(:, p)*x)/s
   end function load_change

   !> Returns F at s, including the load by the velocity of the base.
   !>
   !> s     [1/time]
   !> form  from `form_at`
   !> load  (n)
   pure function load_at(self, s, form) result(load)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s
      integer, intent(in) :: form
      complex(wp) :: load(self%n)
      real(wp) :: rows(size(self%row_load))

      load = self%load
      if (form /= 0) then
         call self%load_rows(form, rows)
         load = self%load_remainder + matmul(rows, self%v)
      end if
      if (any(abs(self%velocity_load) > 0)) load = load + self%velocity_load/s
   end function load_at

   !> Returns H/s**2 for large s, (r, r), with a positive number on the diagonal of each row that is
   !> held.
   pure function mass_couplings(self) result(h)
      class(assembly_t), intent(in) :: self
      real(wp) :: h(size(self%v, 1), size(self%v, 1))
      integer :: k

      call self%coupling(of_mass, 0, h)
      do k = 1, size(h, 1)
         if (self%rigid(k)) h(k, k) = self%strength(inertia, of_mass) &
            *self%structure%length
      end do
   end function mass_couplings

   !> Returns the number of roots: two for each oscillator, less two for each row that is held.
   pure integer function roots(self)
      class(assembly_t), intent(in) :: self

      roots = 2*(self%n - count(self%rigid))
   end function roots

   !> Sets the structural damping to a share of that of another assembly of the same beam.
   pure subroutine set_loss(self, whole, share)
      class(assembly_t), intent(inout) :: self
      type(assembly_t), intent(in) :: whole
      real(wp), intent(in) :: share

      self%pencil%l = share*whole%pencil%l
      if (self%is_dense()) self%dense(:, :, 3) = share*whole%dense(:, :, 3)
      call set_poles(self)
   end subroutine set_loss

   !> Computes the roots of all D_i.
   pure subroutine set_poles(self)
      class(assembly_t), intent(inout) :: self
      integer :: i

      associate (p => self%pencil)
         do i = 1, self%n
            if (p%l(i) > 0) then
               self%pole(i, :2) = lossy_poles(p%m(i), p%c(i), cmplx(p%k(i), p%l(i), wp))
            else
               self%pole(i, :2) = quadratic(p%m(i), p%c(i), p%k(i))
            end if
            if (self%relaxation%n > 0) call relax_poles(self, i)
         end do
      end associate
   end subroutine set_poles

   !> Computes the roots of D_i with relaxations. The coefficients of the two that oscillate follow
   !> from the real ones.
   pure subroutine relax_poles(self, i)
      class(assembly_t), intent(inout) :: self
      integer, intent(in) :: i
      real(wp) :: c, share
      integer :: l

      self%creep(i, :) = 0
      self%rise(i, :) = 0
      self%pole(i, 3:) = 0
      if (.not. self%relaxes(i)) return
      associate (m => self%pencil%m(i), k => self%pencil%k(i), of => self%relaxation)
         ! Without the viscosity, which phi contains.
         c = self%strength(inertia, of_damping)
         share = 1
         do l = 1, of%n
            call of%find_root(l, [c, m]/k, self%creep(i, l), self%rise(i, l))
            self%pole(i, 2 + l) = of%point(l) + self%creep(i, l)
            share = share*of%rate(l)/(of%rate(l) - self%rise(i, l))
         end do
         self%pole(i, :2) = quadratic(1.0_wp, self%pencil%c(i)/m + sum(self%rise(i, :)), k/m*share)
      end associate
   end subroutine relax_poles

   !> Sets D, and H without the couplings of the hoses.
   subroutine set_pencil(self, modes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      integer :: r

      r = size(self%v, 1)
      associate (p => self%pencil)
         if (.not. allocated(p%m)) allocate (p%m(self%n), p%c(self%n), p%k(self%n), p%l(self%n), &
            p%hm(r, r), p%hc(r, r), p%hk(r, r))
         p%l = 0
         p%l(:self%beam) = self%strength(bending, of_loss)*modes%mu
         call sum_terms(self, modes, of_mass, p%m, p%hm)
         call sum_terms(self, modes, of_damping, p%c, p%hc)
         call sum_terms(self, modes, of_stiffness, p%k, p%hk)
      end associate
   end subroutine set_pencil

   !> Sums the terms of one matrix, without the couplings between hoses and beam.
   !>
   !> matrix  `of_mass`, `of_damping` or `of_stiffness`
   !> d       (n) diagonal of the oscillators
   !> h       (r, r) couplings of the rows
   pure subroutine sum_terms(self, modes, matrix, d, h)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: matrix
      real(wp), intent(out) :: d(:), h(:, :)
      integer :: i, k

      h = 0
      associate (s => self%strength(:, matrix))
         do k = 1, size(self%row)
            if (self%row(k) == 0 .or. is_spring(k, self%structure)) cycle
            h(self%row(k), self%row(k)) = h(self%row(k), self%row(k)) + s(k)
         end do
         d(:self%beam) = s(inertia) + s(bending)*modes%mu
         do i = 1, size(self%hose)
            associate (x => self%hose(i)%point, at_point => self%hose(i)%at_point)
               if (self%hose(i)%row > 0) d(self%hose(i)%oscillator) = s(hose(i)) + s(stretch(i))
               if (at_point > 0) h(x, x) = h(x, x) + s(at_point)
            end associate
         end do
      end associate
   end subroutine sum_terms

   !> Computes H(s) and H'(s) in a form, both of shape (r, r).
   pure subroutine couplings(self, form, s, H, dH)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: s
      complex(wp), intent(out) :: H(:, :), dH(:, :)
      complex(wp) :: value, slope, square
      integer :: i, k, l

      square = s*s
      associate (p => self%pencil)
         do l = 1, size(H, 2)
            do k = 1, size(H, 1)
               H(k, l) = cmplx((p%hm(k, l)*real(square) + p%hc(k, l)*real(s)) + p%hk(k, l), &
                  p%hm(k, l)*aimag(square) + p%hc(k, l)*aimag(s), wp)
               dH(k, l) = cmplx(2*p%hm(k, l)*real(s) + p%hc(k, l), 2*p%hm(k, l)*aimag(s), wp)
            end do
         end do
      end associate
      do i = 1, size(self%hose)
         if (self%hose(i)%row == 0) cycle
         associate (x => self%hose(i)%point, y => self%hose(i)%row, hose => self%structure%hose(i))
            if (btest(form, i - 1)) then
               value = hose%m_H*s**2
               slope = 2*hose%m_H*s
               H(x, y) = H(x, y) + value
               H(y, x) = H(y, x) + value
               dH(x, y) = dH(x, y) + slope
               dH(y, x) = dH(y, x) + slope
            else
               value = hose%c_H*s + hose%k_H
               slope = hose%c_H
               H(x, y) = H(x, y) - value
               H(y, x) = H(y, x) - value
               dH(x, y) = dH(x, y) - slope
               dH(y, x) = dH(y, x) - slope
            end if
            H(x, x) = H(x, x) + value
            dH(x, x) = dH(x, x) + slope
         end associate
      end do
   end subroutine couplings

   !> Computes the coefficients of s**2, s or 1 in H in a form.
   !>
   !> matrix  `of_mass`, `of_damping` or `of_stiffness`
   !> h       (r, r)
   pure subroutine coupling(self, matrix, form, h)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: matrix, form
      real(wp), intent(out) :: h(:, :)
      real(wp) :: value
      integer :: i, sign

      select case (matrix)
      case (of_mass)
         h = self%pencil%hm
      case (of_damping)
         h = self%pencil%hc
      case default
         h = self%pencil%hk
      end select
      do i = 1, size(self%hose)
         if (self%hose(i)%row == 0 .or. (btest(form, i - 1) .neqv. matrix == of_mass)) cycle
         sign = merge(1, -1, matrix == of_mass)
         value = self%strength(merge(hose(i), stretch(i), matrix == of_mass), matrix)
         associate (x => self%hose(i)%point, y => self%hose(i)%row)
            h(x, x) = h(x, x) + value
            h(x, y) = h(x, y) + sign*value
            h(y, x) = h(y, x) + sign*value
         end associate
      end do
   end subroutine coupling

   !> Returns both roots of a s**2 + b s + c without cancellation; a > 0, b >= 0, c >= 0.
   pure function quadratic(a, b, c) result(roots)
      real(wp), intent(in) :: a, b, c
      complex(wp) :: roots(2)
      real(wp) :: half, discriminant

      half = b/(2*a)
      discriminant = half**2 - c/a
      if (discriminant < 0) then
         roots(1) = cmplx(-half, sqrt(-discriminant), wp)
         roots(2) = conjg(roots(1))
      else
         roots(2) = -(half + sqrt(discriminant))
         roots(1) = 0
         if (c > 0) roots(1) = c/(a*roots(2))
      end if
   end function quadratic

   !> Returns both roots of m s**2 + c s + k without cancellation, the one with Im s > 0 first;
   !> m > 0, c >= 0, Im k > 0.
   pure function lossy_poles(m, c, k) result(roots)
      real(wp), intent(in) :: m, c
      complex(wp), intent(in) :: k
      complex(wp) :: roots(2)
      real(wp) :: half

      half = c/(2*m)
      ! The principal square root has a real part >= 0 and, because Im k > 0, an imaginary part < 0.
      roots(1) = -(half + sqrt(half**2 - k/m))
      roots(2) = k/(m*roots(1))
   end function lossy_poles

   !> Returns the form that is more accurate at s [1/time]: bit h - 1 is set if hose h is described
   !> by y - u(x_H).
   pure integer function form_at(self, s) result(form)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s
      complex(wp) :: held, moved
      integer :: h

      form = 0
      do h = 1, size(self%hose)
         if (self%hose(h)%row == 0) cycle
         associate (hose => self%structure%hose(h))
            held = hose%c_H*s + hose%k_H
            moved = hose%m_H*s**2
         end associate
         if (real(held)**2 + aimag(held)**2 > real(moved)**2 + aimag(moved)**2) &
            form = ibset(form, h - 1)
      end do
   end function form_at

   !> Returns |s + E/c_D| c_D/E, the relative distance of s from -E/c_D, the accumulation point of
   !> the slow roots of overdamped modes. The residue of such a root is reduced by the same factor.
   !> With relaxations, it is |phi| of `beamid_relaxations`.
   pure real(wp) function distance_from_accumulation(self, s)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s

      associate (E => self%strength(bending, of_stiffness), of => self%relaxation)
         distance_from_accumulation = abs(self%strength(bending, of_damping)*s + E &
            + E*sum(of%strength(:of%n)*s/(s + of%rate(:of%n))))/E
      end associate
   end function distance_from_accumulation

   !> Returns whether the beam has no attachments.
   pure logical function is_bare(self)
      class(assembly_t), intent(in) :: self

      associate (p => self%pencil)
         is_bare = .not. (any(abs(p%hm) + abs(p%hc) + abs(p%hk) > 0) .or. any(self%hose%row > 0))
      end associate
   end function is_bare

   !> Returns whether C and L are 0 and nothing relaxes.
   pure logical function is_undamped(self)
      class(assembly_t), intent(in) :: self

      is_undamped = .not. (any(abs(self%pencil%c) > 0) .or. any(abs(self%pencil%hc) > 0) .or. &
         any(self%pencil%l > 0) .or. self%relaxation%n > 0)
      if (self%is_dense()) is_undamped = is_undamped .and. .not. any(abs(self%dense(:, :, 1)) > 0)
   end function is_undamped

end module beamid_assembly
