!> The structure as oscillators that touch at few points.
!>
!> In the modes of the bare beam, pinned at a root that may turn, with the hose as one more
!> oscillator, M, C and K are diagonal up to what hangs on the beam:
!>
!>     s**2 M + s C + K = D(s) + V H(s) A**-1 V',    D_i = m_i s**2 + c_i s + k_i.
!>
!> The columns of V say how much each oscillator moves the tip, the hose, the slopes of root and
!> tip, the sensors and supports; H holds what acts between them, a small matrix. A is diagonal: 1,
!> but of a spring to the ground its compliance, with 1 + s c/k in H, so that it may be rigid.
!>
!> What acts between all oscillators of the beam, by axial force and weight or where properties vary
!> along it, stands beside: E(s), a full matrix (`dense`).
!>
!> The hose has the same D(s) whether its coordinate is y, with c_H s + k_H between it and the tip,
!> or y - u(l), with m_H s**2 instead. The smaller of the two loses no digits: both forms are kept,
!> and `form_at` says which one serves at s.
module beamid_assembly
   use beamid_kinds, only: wp
   use beamid_modes, only: beam_modes_t
   use beamid_structure, only: is_coefficient, of_g, of_length, of_x_F, structure_t
   use beamid_terms, only: bending, force_value, hose, inertia, is_grounded, is_spring, &
      load_shape, of_compliance, of_damping, of_load, of_mass, of_stiffness, operators, &
      place_on_mesh, pulls, root_slope, sensor_slope, sensor_value, strengths_and_slopes, stretch, &
      tip_slope, tip_value, weight
   implicit none
   private

   public :: assembly_t, new_assembly, pencil_t, quadratic, load_t

   !> Coefficients of D(s) and H(s), or of their derivatives with respect to one parameter.
   type :: pencil_t
      real(wp), allocatable :: m(:), c(:), k(:)              !< (n)
      real(wp), allocatable :: hm(:, :), hc(:, :), hk(:, :)  !< (r, r), symmetric
   end type pencil_t

   !> What drives the structure: a force at a point, distributed, or the base that moves.
   type :: load_t
      real(wp), allocatable :: shape(:)   !< <theta, phi> of the beam's modes; not allocated: none
      logical :: base = .false.           !< the base moves, no force
   end type load_t

   type :: assembly_t
      type(structure_t) :: structure
      real(wp), allocatable :: strength(:, :)  !< (operators, matrices) of `beamid_terms`
      integer :: n = 0                         !< oscillators
      integer :: beam = 0                      !< the first of them: modes of the bare beam
      type(pencil_t) :: pencil(2)              !< hose by y, by y - u(l)
      !> (beam, beam, 2) E of C and K, and (beam, beam, 2, parameters) its derivatives; not
      !> allocated: nothing acts so
      real(wp), allocatable :: dense(:, :, :), dense_slope(:, :, :, :)
      real(wp), allocatable :: v(:, :)         !< (r, n) column i is v_i
      !> (n, r), and (n, r (r + 1)/2) products of rows k <= l at k + l (l - 1)/2
      real(wp), allocatable :: vt(:, :), vv(:, :)
      real(wp), allocatable :: compliance(:)   !< (r) diagonal of A
      real(wp), allocatable :: compliance_slope(:, :)   !< (r, parameters)
      !> (r) which rows are held so fast that the two roots they take away are nowhere near
      logical, allocatable :: held(:)
      !> (n, 2, 2) F, and what of it goes with 1/s, by the two forms of the pencil: per unit force,
      !> or per unit acceleration of the base
      real(wp), allocatable :: load(:, :, :)
      !> (r, 2) what of F acts along the rows of V, by the two forms, and (r, 2, parameters) its
      !> derivatives: where little moves, V'x tells more than a sum over the oscillators
      real(wp), allocatable :: push(:, :), push_slope(:, :, :)
      !> the rest of F, (n), (n, parameters), and of what goes with 1/s the derivatives
      real(wp), allocatable :: rest(:), rest_slope(:, :), velocity_load_slope(:, :)
      logical, allocatable :: load_changes(:)  !< (parameters) whether any of these is not 0
      !> (r) by which a row is longer as the base moves: of what is connected to the ground, over
      !> s**2
      real(wp), allocatable :: base_coupling(:)
      !> Whether velocity or displacement of the base drive the structure too.
      logical :: feels_base = .false.
      complex(wp), allocatable :: pole(:, :)   !< (n, 2) roots of D_i [1/time]
      integer, allocatable :: parameters(:)    !< places of those to differentiate with respect to
      !> operators in M, C and K that a parameter changes, and (3, operators, parameters) the
      !> derivatives of what stands before them in M, C and K
      integer, allocatable :: changing(:)
      real(wp), allocatable :: change(:, :, :)
      !> (operators, parameters) whether any of these is not 0
      logical, allocatable :: acts(:, :)
      !> (2, parameters) d pencil/d parameter, where something acts between all oscillators
      type(pencil_t), allocatable :: slope(:, :)
      real(wp), allocatable :: mu(:)           !< (beam) bending of the modes, of which inertia is 1
      !> (r, n) how a row of v changes as its place moves along the beam of the mesh, and
      !> (r, parameters) how a parameter moves that place; such a row has no entry of H but that on
      !> the diagonal
      real(wp), allocatable :: v_slope(:, :), moves(:, :)
      !> (operators) row of v; 0: none. A parameter to be differentiated with respect to may add one
      !> that the structure by itself does without: J_T = 0, a sensor at the tip by default.
      integer, allocatable :: row(:)
      !> Rows of v; 0: not there. The sensor's may be that of the tip.
      integer :: tip = 0, hose = 0, sensor = 0
      !> That of the sensor's slope, where it reads gravity.
      integer :: turn = 0
   contains
      procedure :: is_dense
      procedure :: form_at
      procedure :: from_pile
      procedure :: is_bare
      procedure :: is_undamped
      procedure :: roots
      procedure :: load_at
      procedure :: mass_couplings
      procedure :: products
      procedure, private :: acts_at_tip
      procedure :: traces
      procedure :: varied
      procedure :: grown
      procedure :: load_change
   end type assembly_t

   !> A root this many times beyond all poles of the oscillators moves nothing that is observed.
   real(wp), parameter :: far_away = 1e5_wp

contains

   !> structure   what hangs on the beam
   !> modes       of the bare beam
   !> parameters  places in the table to differentiate with respect to
   !> load        left out: a force at a point
   !> whole       whether everything goes by whole matrices, whatever acts; default .false.
   function new_assembly(structure, modes, parameters, load, whole) result(self)
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameters(:)
      type(load_t), intent(in), optional :: load
      logical, intent(in), optional :: whole
      type(assembly_t) :: self
      type(load_t) :: applied
      real(wp), allocatable :: slopes(:, :, :)
      real(wp) :: reach(size(operators))
      logical, dimension(size(operators)) :: needed, used
      integer :: form, matrix, p, i

      if (present(load)) applied = load
      self%structure = structure
      self%parameters = parameters
      self%beam = size(modes%mu)
      allocate (self%strength(size(operators), of_compliance), &
         slopes(size(operators), of_compliance, size(parameters)))
      call strengths_and_slopes(structure, modes%space%length, parameters, self%strength, slopes)
      reach = 0
      do matrix = 1, size(slopes, 2)
         do p = 1, size(parameters)
            reach = reach + abs(slopes(:, matrix, p))
         end do
      end do
      used = reach > 0
      do matrix = 1, size(slopes, 2)
         reach = reach + abs(self%strength(:, matrix))
      end do
      needed = reach > 0
      do i = root_slope, size(operators)
         needed(i) = needed(i) .or. is_spring(i, structure)
      end do
      call lay_out(self, modes, needed)
      self%mu = modes%mu
      do form = 1, 2
         self%pencil(form) = new_pencil(self, modes, self%strength, form)
      end do
      used = used .and. (operators%derivative < 0 .or. self%row > 0)
      self%changing = pack([(i, i=1, size(operators))], used)
      allocate (self%change(3, size(self%changing), size(parameters)))
      do p = 1, size(parameters)
         self%change(:, :, p) = transpose(slopes(self%changing, of_mass:of_stiffness, p))
      end do
      call set_load(self, modes, slopes, applied)
      allocate (self%pole(self%n, 2))
      do i = 1, self%n
         self%pole(i, :) = quadratic(self%pencil(1)%m(i), self%pencil(1)%c(i), &
            self%pencil(1)%k(i))
      end do
      call set_springs(self, modes, slopes)
      self%acts = any(abs(self%change) > 0, dim=1)
      call set_dense(self, modes, slopes, whole)
   end function new_assembly

   !> Which oscillators and couplings there are, and V.
   !>
   !> needed  (operators) which of them count
   subroutine lay_out(self, modes, needed)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      logical, intent(in) :: needed(:)
      integer :: k, l, r
      logical :: turns

      associate (s => self%structure)
         turns = s%g > 0 .or. any(self%parameters == of_g)
         allocate (self%row(size(operators)), source=0)
         self%n = self%beam
         self%tip = 1
         self%row(tip_value) = 1
         r = 1
         if (s%has_hose() .and. any(self%strength(stretch, :) > 0)) then
            r = r + 1
            self%hose = r
            self%n = self%n + 1
         end if
         do k = 1, size(operators)
            if (k == force_value .or. operators(k)%derivative < 0 .or. self%row(k) > 0 .or. &
               k == root_slope .and. modes%space%turning == 0) cycle
            if (.not. (needed(k) .or. k == sensor_value(s%observer) .or. turns .and. &
               k == sensor_slope(s%observer))) cycle
            if (k == root_slope .or. is_grounded(k) .or. &
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
         self%sensor = self%row(sensor_value(s%observer))
         if (turns) self%turn = self%row(sensor_slope(s%observer))
      end associate
      allocate (self%v(r, self%n), self%v_slope(r, self%n), &
         self%moves(r, size(self%parameters)), source=0.0_wp)
      if (self%hose > 0) self%v(self%hose, self%beam + 1) = 1
      do k = 1, size(operators)
         if (self%row(k) == 0) cycle
         associate (row => self%row(k))
            self%v(row, :) = at_point(self, modes, k, 0)
            self%moves(row, :) = moves_of(self, modes, k)
            if (any(abs(self%moves(row, :)) > 0)) self%v_slope(row, :) = at_point(self, modes, k, 1)
         end associate
      end do
      allocate (self%vt, source=transpose(self%v))
      allocate (self%vv(self%n, (r*(r + 1))/2))
      do l = 1, r
         do k = 1, l
            self%vv(:, k + (l*(l - 1))/2) = self%vt(:, k)*self%vt(:, l)
         end do
      end do
   end subroutine lay_out

   !> Whether a point is the tip, and remains there whatever parameter moves.
   pure logical function stays_at_tip(self, place)
      type(assembly_t), intent(in) :: self
      integer, intent(in) :: place

      stays_at_tip = place == 0
      if (place == 0) return
      stays_at_tip = self%structure%follows_tip(place) .and. .not. any(self%parameters == place)
   end function stays_at_tip

   !> What the oscillators do at the point of an operator.
   !>
   !> more  derivatives with respect to the place on the beam of the mesh, beyond the operator's own
   function at_point(self, modes, k, more) result(values)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: k, more
      real(wp) :: values(self%n)

      values = 0
      values(:self%beam) = modes%at(place_on_mesh(k, self%structure, modes%space%length), &
         operators(k)%derivative + more)
   end function at_point

   !> How the parameters move the point of an operator along the beam of the mesh.
   pure function moves_of(self, modes, k) result(moves)
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
   end function moves_of

   !> Springs to the ground, rigid or not: A y is the motion, (1 + s c/k) y the force, in units in
   !> which it is of the size of the others.
   subroutine set_springs(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      real(wp) :: unit, alone
      integer :: form, i, k

      allocate (self%compliance(size(self%v, 1)), source=1.0_wp)
      allocate (self%compliance_slope(size(self%v, 1), size(self%parameters)), source=0.0_wp)
      allocate (self%held(size(self%v, 1)), source=.false.)
      do k = 1, size(operators)
         if (self%row(k) == 0 .or. .not. is_spring(k, self%structure)) cycle
         associate (row => self%row(k), l => modes%space%length, s => self%strength(k, :))
            unit = self%strength(bending, of_stiffness)*modes%mu(self%beam) &
               *l**(1 + 2*operators(k)%derivative)
            self%compliance(row) = unit*s(of_compliance)
            self%compliance_slope(row, :) = unit*slopes(k, of_compliance, :)
            do form = 1, 2
               self%pencil(form)%hk(row, row) = unit
               self%pencil(form)%hc(row, row) = unit*s(of_compliance)*s(of_damping)
            end do
            if (any(self%changing == k)) then
               i = findloc(self%changing, k, dim=1)
               self%change(2, i, :) = unit*(slopes(k, of_compliance, :)*s(of_damping) &
                  + s(of_compliance)*slopes(k, of_damping, :))
               self%change(3, i, :) = 0
            end if
            ! Of a spring so stiff only the root that it sends away would know.
            alone = sum(self%v(row, :)**2/self%pencil(1)%m)
            self%held(row) = alone >= s(of_compliance)*(far_away*maxval(abs(self%pole)))**2
         end associate
      end do
   end subroutine set_springs

   !> Derivatives of the pencil.
   subroutine set_pencil_slopes(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      integer :: form, i, p

      allocate (self%slope(2, size(self%parameters)))
      do p = 1, size(self%parameters)
         do form = 1, 2
            self%slope(form, p) = new_pencil(self, modes, slopes(:, :, p), form)
            do i = 1, size(self%changing)
               associate (row => self%row(self%changing(i)))
                  if (is_spring(self%changing(i), self%structure) .and. row > 0) &
                     self%slope(form, p)%hc(row, row) = self%change(2, i, p)
               end associate
            end do
         end do
      end do
   end subroutine set_pencil_slopes

   !> E and its derivatives.
   subroutine set_dense(self, modes, slopes, whole)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      logical, intent(in), optional :: whole
      type(beam_modes_t) :: own
      real(wp), allocatable :: tension(:, :), turning(:), moves(:)
      logical :: needed, pull(size(operators))
      integer :: j, k, p

      do j = 1, size(operators)
         pull(j) = pulls(j)
         if (pull(j)) pull(j) = abs(self%strength(j, of_stiffness)) > 0 .or. &
            any(abs(slopes(j, of_stiffness, :)) > 0)
      end do
      needed = allocated(modes%rest) .or. varies_more(self) .or. any(pull)
      if (present(whole)) needed = needed .or. whole
      if (.not. needed) return
      call set_pencil_slopes(self, modes, slopes)
      allocate (self%dense(self%beam, self%beam, 2), &
         self%dense_slope(self%beam, self%beam, 2, size(self%parameters)), source=0.0_wp)
      if (allocated(modes%rest)) then
         do j = 1, 2
            associate (operator => merge(inertia, bending, j == 1))
               self%dense(:, :, 1) = self%dense(:, :, 1) &
                  + self%strength(operator, of_damping)*modes%rest(:, :, j)
               do p = 1, size(self%parameters)
                  self%dense_slope(:, :, 1, p) = self%dense_slope(:, :, 1, p) &
                     + slopes(operator, of_damping, p)*modes%rest(:, :, j)
               end do
            end associate
         end do
      end if
      if (varies_more(self)) call add_varied_bending(self, modes, slopes)
      if (.not. any(pull)) return
      own = modes
      call own%tabulate_slopes()
      do k = 1, size(operators)
         associate (s => self%strength(k, of_stiffness), s_p => slopes(k, of_stiffness, :), &
            x => place_on_mesh(k, self%structure, modes%space%length))
            if (.not. pull(k)) cycle
            tension = own%tension(x, merge(0.0_wp, 1.0_wp, k == weight), &
               merge(1.0_wp, 0.0_wp, k == weight))
            self%dense(:, :, 2) = self%dense(:, :, 2) + s*tension
            turning = modes%at(x, 1)
            moves = moves_of(self, modes, k)
            do p = 1, size(self%parameters)
               self%dense_slope(:, :, 2, p) = self%dense_slope(:, :, 2, p) + s_p(p)*tension
               if (abs(s*moves(p)) > 0) self%dense_slope(:, :, 2, p) = &
                  self%dense_slope(:, :, 2, p) + s*moves(p)*spread(turning, 1, self%beam) &
                  *spread(turning, 2, self%beam)
            end do
         end associate
      end do
   end subroutine set_dense

   !> Whether parameters say how the bending varies along the beam, or a parameter is to be
   !> differentiated with respect to that would.
   pure logical function varies_more(self)
      type(assembly_t), intent(in) :: self

      varies_more = self%structure%varies_further() .or. any(is_coefficient(self%parameters))
   end function varies_more

   !> What E(x) and c_D(x) make of the bending, beyond E, c_D and what is known to vary.
   subroutine add_varied_bending(self, modes, slopes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      integer, parameter :: matrix(2) = [of_damping, of_stiffness]
      real(wp) :: factor(size(modes%bent), 2)
      real(wp) :: slope(2, size(self%parameters), size(modes%bent))
      real(wp) :: products(self%beam, self%beam, 2)
      integer :: j, k, p, q

      ! What `factors` has first is of the stiffness, here it is second.
      do q = 1, size(modes%bent)
         factor(q, :) = self%structure%factors(modes%bent(q)) - 1
         slope(:, :, q) = self%structure%factor_slopes(modes%bent(q), self%parameters)
      end do
      do j = 1, 2
         k = 3 - j
         if (.not. self%strength(bending, matrix(j)) > 0) cycle
         if (all(abs(factor(:, k)) <= 0)) then
            products(:, :, j) = 0
         else
            products(:, :, j) = modes%bending_products(modes%known(:, k)*factor(:, k))
         end if
         self%dense(:, :, j) = self%dense(:, :, j) &
            + self%strength(bending, matrix(j))*products(:, :, j)
      end do
      do p = 1, size(self%parameters)
         do j = 1, 2
            k = 3 - j
            associate (s => self%strength(bending, matrix(j)), s_p => slopes(bending, matrix(j), p))
               if (.not. s > 0) cycle
               if (abs(s_p) > 0) self%dense_slope(:, :, j, p) = self%dense_slope(:, :, j, p) &
                  + s_p*products(:, :, j)
               if (any(abs(slope(k, p, :)) > 0)) self%dense_slope(:, :, j, p) = &
                  self%dense_slope(:, :, j, p) + s*modes%bending_products(modes%known(:, k) &
                  *slope(k, p, :))
            end associate
         end do
      end do
   end subroutine add_varied_bending

   !> Whether something acts between all oscillators of the beam.
   pure logical function is_dense(self)
      class(assembly_t), intent(in) :: self

      is_dense = allocated(self%dense)
   end function is_dense

   !> F and its derivatives: what acts along the rows of V, and the rest. Of a base that moves -M r
   !> and, with 1/s, -C r, r the displacement of the whole by one. Of an operator that is connected
   !> to the ground the row of V is longer instead (`base_coupling`), which loads all of its terms.
   subroutine set_load(self, modes, slopes, applied)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: slopes(:, :, :)
      type(load_t), intent(in) :: applied
      real(wp), dimension(self%n) :: point, moving, spread_out
      real(wp) :: moves(size(self%parameters))
      integer :: form, k, p

      allocate (self%load(self%n, 2, 2), self%base_coupling(size(self%v, 1)), source=0.0_wp)
      allocate (self%push, source=row_load(self, self%strength, applied%base))
      allocate (self%push_slope(size(self%v, 1), 2, size(self%parameters)), &
         self%rest_slope(self%n, size(self%parameters)))
      spread_out = 0
      if (applied%base) spread_out(:self%beam) = -modes%total(:, 1)
      if (allocated(applied%shape)) spread_out(:self%beam) = applied%shape
      point = 0
      moving = 0
      moves = 0
      if (.not. (applied%base .or. stays_at_tip(self, operators(force_value)%place))) then
         point = at_point(self, modes, force_value, 0)
         moving = at_point(self, modes, force_value, 1)
         moves = moves_of(self, modes, force_value)
      end if
      self%rest = rest_load(self%strength)
      do p = 1, size(self%parameters)
         self%push_slope(:, :, p) = row_load(self, slopes(:, :, p), applied%base)
         self%rest_slope(:, p) = rest_load(slopes(:, :, p)) &
            + self%strength(force_value, of_load)*moves(p)*moving
      end do
      self%load_changes = [(applied%base .or. any(abs(self%push_slope(:, :, p)) > 0) .or. &
         any(abs(self%rest_slope(:, p)) > 0), p=1, size(self%parameters))]
      do form = 1, 2
         self%load(:, 1, form) = self%rest + matmul(self%push(:, form), self%v)
      end do
      if (.not. applied%base) return
      spread_out(:self%beam) = -modes%total(:, 2)
      self%load(:, 2, :) = spread(self%strength(inertia, of_damping)*spread_out, 2, 2)
      allocate (self%velocity_load_slope(self%n, size(self%parameters)))
      do p = 1, size(self%parameters)
         self%velocity_load_slope(:, p) = slopes(inertia, of_damping, p)*spread_out
      end do
      do k = 1, size(operators)
         if (self%row(k) > 0 .and. is_grounded(k)) self%base_coupling(self%row(k)) = 1
      end do
      self%feels_base = any(self%base_coupling > 0) .or. any(abs(self%load(:, 2, :)) > 0)

   contains

      !> What acts along no row, or a derivative of it.
      pure function rest_load(s) result(rest)
         real(wp), intent(in) :: s(:, :)   !< (operators, matrices), or a derivative
         real(wp) :: rest(self%n)

         if (applied%base) then
            rest = s(inertia, of_mass)*spread_out
         else
            rest = s(force_value, of_load)*point + s(load_shape, of_load)*spread_out
         end if
      end function rest_load

   end subroutine set_load

   !> What of F, or of a derivative, acts along the rows of V.
   !>
   !> s     (operators, matrices), or a derivative
   !> base  whether the base moves
   pure function row_load(self, s, base) result(push)
      type(assembly_t), intent(in) :: self
      real(wp), intent(in) :: s(:, :)
      logical, intent(in) :: base
      real(wp) :: push(size(self%v, 1), 2)
      integer :: k

      push = 0
      if (.not. base) then
         if (stays_at_tip(self, operators(force_value)%place)) &
            push(self%tip, :) = s(force_value, of_load)
         return
      end if
      do k = 1, size(operators)
         if (self%row(k) == 0 .or. .not. operators(k)%moves_with_base .or. is_grounded(k)) cycle
         push(self%row(k), :) = push(self%row(k), :) - s(k, of_mass)
      end do
      ! By y the hose's mass moves alone, by y - u(l) the tip moves it too.
      if (self%hose > 0) then
         push(self%hose, :) = push(self%hose, :) - s(hose, of_mass)
         push(self%tip, 2) = push(self%tip, 2) - s(hose, of_mass)
      else if (.not. self%structure%has_hose()) then
         push(self%tip, :) = push(self%tip, :) - s(hose, of_mass)
      end if
   end function row_load

   !> What each operator that changes makes of two motions, z'Op x: of a spring to the ground the
   !> product of what holds, A y w.
   !>
   !> form  of the pencil
   !> x, y  (n), (r) one motion; z, w the other
   !> q     (operators that change)
   pure subroutine products(self, form, x, y, z, w, q)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: x(:), y(:), z(:), w(:)
      complex(wp), intent(out) :: q(:)
      integer :: i

      associate (b => self%beam, tip => self%tip, A => self%compliance)
         do i = 1, size(self%changing)
            associate (k => self%changing(i), row => self%row(self%changing(i)))
               q(i) = 0
               if (row > 0) then
                  q(i) = A(row)*y(row)*w(row)
               else if (k == inertia) then
                  q(i) = sum(x(:b)*z(:b))
               else if (k == bending) then
                  q(i) = sum(self%mu*x(:b)*z(:b))
               else if (self%hose == 0) then
                  if (self%acts_at_tip(k)) q(i) = y(tip)*w(tip)
               else if (form == 1 .and. k == stretch) then
                  q(i) = (x(b + 1) - y(tip))*(z(b + 1) - w(tip))
               else if (form == 2 .and. k == hose) then
                  q(i) = (x(b + 1) + y(tip))*(z(b + 1) + w(tip))
               else if (k == hose .or. k == stretch) then
                  q(i) = x(b + 1)*z(b + 1)
               end if
            end associate
         end do
      end associate
   end subroutine products

   !> The same of the trace of Op Q**-1.
   !>
   !> diagonal, T  of Q**-1 (n), and A**-1 V'Q**-1 V (r, r)
   pure function traces(self, form, diagonal, T) result(q)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: diagonal(:), T(:, :)
      complex(wp) :: q(size(self%changing))
      integer :: i

      associate (b => self%beam, tip => self%tip, h => self%hose)
         do i = 1, size(self%changing)
            associate (k => self%changing(i), row => self%row(self%changing(i)))
               q(i) = 0
               if (row > 0) then
                  q(i) = T(row, row)
               else if (k == inertia) then
                  q(i) = sum(diagonal(:b))
               else if (k == bending) then
                  q(i) = sum(self%mu*diagonal(:b))
               else if (h == 0) then
                  if (self%acts_at_tip(k)) q(i) = T(tip, tip)
               else if (form == 1 .and. k == stretch) then
                  q(i) = diagonal(b + 1) + T(tip, tip) - T(tip, h) - T(h, tip)
               else if (form == 2 .and. k == hose) then
                  q(i) = diagonal(b + 1) + T(tip, tip) + T(tip, h) + T(h, tip)
               else if (k == hose .or. k == stretch) then
                  q(i) = diagonal(b + 1)
               end if
            end associate
         end do
      end associate
   end function traces

   !> Whether an operator of a hose that is no oscillator acts at the tip: one that nothing holds
   !> yet stays where it is, one without mass moves with the tip once it has any.
   pure logical function acts_at_tip(self, k)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: k

      acts_at_tip = merge(stretch, hose, self%structure%has_hose()) == k .and. &
         (self%structure%has_hose() .or. any(self%strength(stretch, :) > 0))
   end function acts_at_tip

   !> Sum of s**2 M_p + s C_p + K_p over the operators.
   !>
   !> q  (operators that change) `traces`
   !> p  place among the parameters
   pure complex(wp) function varied(self, q, s, p)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), s
      integer, intent(in) :: p
      integer :: i

      varied = 0
      do i = 1, size(q)
         if (.not. self%acts(i, p)) cycle
         varied = varied + ((self%change(1, i, p)*s + self%change(2, i, p))*s &
            + self%change(3, i, p))*q(i)
      end do
   end function varied

   !> Sum of 2 s M_p + C_p over the operators.
   pure complex(wp) function grown(self, q, s, p)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: q(:), s
      integer, intent(in) :: p
      integer :: i

      grown = 0
      do i = 1, size(q)
         if (.not. self%acts(i, p)) cycle
         grown = grown + (2*self%change(1, i, p)*s + self%change(2, i, p))*q(i)
      end do
   end function grown

   !> x'F_p at s, but for rows whose place moves.
   !>
   !> x, y  (n), (r) a motion
   pure complex(wp) function load_change(self, form, x, y, s, p) result(change)
      class(assembly_t), intent(in) :: self
      integer, intent(in) :: form, p
      complex(wp), intent(in) :: x(:), y(:), s

      change = 0
      if (.not. self%load_changes(p)) return
      change = sum(self%rest_slope(:, p)*x) + sum(self%push_slope(:, form, p)*y)
      if (allocated(self%velocity_load_slope)) change = change &
         + sum(self%velocity_load_slope(:, p)*x)/s
   end function load_change

   !> F at s.
   pure function load_at(self, s, form) result(load)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s
      integer, intent(in) :: form
      complex(wp) :: load(self%n)

      load = self%load(:, 1, form)
      if (any(abs(self%load(:, 2, form)) > 0)) load = load + self%load(:, 2, form)/s
   end function load_at

   !> What acts between the oscillators at once: H/s**2 for large s, and the rows that are held.
   pure function mass_couplings(self) result(h)
      class(assembly_t), intent(in) :: self
      real(wp) :: h(size(self%v, 1), size(self%v, 1))
      integer :: k

      h = self%pencil(1)%hm
      do k = 1, size(h, 1)
         if (self%held(k)) h(k, k) = self%strength(inertia, of_mass) &
            *self%structure%length
      end do
   end function mass_couplings

   !> How many roots there are: two for each oscillator, less two for each that is held.
   pure integer function roots(self)
      class(assembly_t), intent(in) :: self

      roots = 2*(self%n - count(self%held))
   end function roots

   !> D(s) and H(s) in one of the two forms, or a derivative of them.
   !>
   !> strength  (operators, matrices), or a derivative
   pure function new_pencil(self, modes, strength, form) result(p)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: strength(:, :)
      integer, intent(in) :: form
      type(pencil_t) :: p
      integer :: r

      r = size(self%v, 1)
      allocate (p%m(self%n), p%c(self%n), p%k(self%n), p%hm(r, r), p%hc(r, r), p%hk(r, r))
      call sum_terms(self, modes, strength(:, of_mass), form, p%m, p%hm)
      call sum_terms(self, modes, strength(:, of_damping), form, p%c, p%hc)
      call sum_terms(self, modes, strength(:, of_stiffness), form, p%k, p%hk)
   end function new_pencil

   !> The part of one matrix.
   !>
   !> s  (operators)
   !> d  (n) on the diagonal
   !> h  (r, r)
   pure subroutine sum_terms(self, modes, s, form, d, h)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      real(wp), intent(in) :: s(:)
      integer, intent(in) :: form
      real(wp), intent(out) :: d(:), h(:, :)
      integer :: k

      h = 0
      do k = 1, size(operators)
         if (self%row(k) == 0 .or. is_spring(k, self%structure)) cycle
         h(self%row(k), self%row(k)) = h(self%row(k), self%row(k)) + s(k)
      end do
      associate (b => self%beam, tip => self%tip)
         d(:b) = s(inertia) + s(bending)*modes%mu
         if (self%hose > 0) then
            d(b + 1) = s(hose) + s(stretch)
            ! By y a spring acts between hose and tip, by y - u(l) the mass moves by the sum.
            if (form == 1) call couple_hose(self, h, s(stretch), -1)
            if (form == 2) call couple_hose(self, h, s(hose), 1)
         else if (self%structure%has_hose()) then
            ! A hose that nothing holds yet stays where it is.
            h(tip, tip) = h(tip, tip) + s(stretch)
         else if (any(self%strength(stretch, :) > 0)) then
            ! A hose without mass moves with the tip once it has any, held by c_H and k_H.
            h(tip, tip) = h(tip, tip) + s(hose)
         end if
      end associate
   end subroutine sum_terms

   !> A spring between hose and tip (sign -1), or a mass that moves by the sum of both (+1).
   pure subroutine couple_hose(self, h, value, sign)
      type(assembly_t), intent(in) :: self
      real(wp), intent(inout) :: h(:, :)
      real(wp), intent(in) :: value
      integer, intent(in) :: sign

      h(self%tip, self%tip) = h(self%tip, self%tip) + value
      h(self%tip, self%hose) = h(self%tip, self%hose) + sign*value
      h(self%hose, self%tip) = h(self%hose, self%tip) + sign*value
   end subroutine couple_hose

   !> Both roots of a s**2 + b s + c, a > 0, b, c >= 0, without cancellation.
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

   !> Which form of the pencil loses no digits at s.
   pure integer function form_at(self, s) result(form)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s

      complex(wp) :: held, moved

      associate (st => self%structure)
         held = st%c_H*s + st%k_H
         moved = st%m_H*s**2
      end associate
      form = merge(1, 2, real(held)**2 + aimag(held)**2 <= real(moved)**2 + aimag(moved)**2)
   end function form_at

   !> Relative distance of s from -E/c_D, next to which the slow roots of overdamped modes lie: in a
   !> mode overdamped so far the slow root's residue is that small too.
   pure real(wp) function from_pile(self, s)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s

      associate (E => self%strength(bending, of_stiffness))
         from_pile = abs(self%strength(bending, of_damping)*s + E)/E
      end associate
   end function from_pile

   !> Whether nothing hangs on the beam.
   pure logical function is_bare(self)
      class(assembly_t), intent(in) :: self

      associate (p => self%pencil(1))
         is_bare = .not. any(abs(p%hm) + abs(p%hc) + abs(p%hk) > 0)
      end associate
   end function is_bare

   pure logical function is_undamped(self)
      class(assembly_t), intent(in) :: self

      is_undamped = .not. (any(abs(self%pencil(1)%c) > 0) .or. any(abs(self%pencil(1)%hc) > 0))
      if (self%is_dense()) is_undamped = is_undamped .and. .not. any(abs(self%dense(:, :, 1)) > 0)
   end function is_undamped

end module beamid_assembly
