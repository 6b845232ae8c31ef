!> The structure as oscillators that touch at few points.
!>
!> In the modes of the bare beam, with the hose as one more oscillator and the turn of a soft root
!> (w = theta x) as another, M, C and K are diagonal up to what hangs on the beam:
!>
!>     s**2 M + s C + K = D(s) + V H(s) V',    D_i = m_i s**2 + c_i s + k_i.
!>
!> The columns of V say how much each oscillator moves the tip, the hose, the slope of the tip, the
!> sensor, and the two coordinates that a soft root couples; H holds what acts between them, a
!> matrix of order six at most.
!>
!> The hose has the same D(s) whether its coordinate is y, with c_H s + k_H between it and the tip,
!> or y - u(l), with m_H s**2 instead. The smaller of the two loses no digits: both forms are kept,
!> and `form_at` says which one serves at s.
module beamid_assembly
   use beamid_kinds, only: wp
   use beamid_modes, only: beam_modes_t
   use beamid_structure, only: of_length, of_x_S, structure_t
   use beamid_terms, only: bending, hose, inertia, load_shape, of_damping, of_load, of_mass, &
      of_stiffness, root_slope, sensor_value, strength_slopes, strengths, stretch, tip_slope, &
      tip_value
   implicit none
   private

   public :: assembly_t, new_assembly, pencil_t, quadratic

   !> Coefficients of D(s) and H(s), or of their derivatives with respect to one parameter.
   type :: pencil_t
      real(wp), allocatable :: m(:), c(:), k(:)              !< (n)
      real(wp), allocatable :: hm(:, :), hc(:, :), hk(:, :)  !< (r, r), symmetric
   end type pencil_t

   type :: assembly_t
      type(structure_t) :: structure
      real(wp), allocatable :: strength(:, :)  !< (operators, matrices) of `beamid_terms`
      integer :: n = 0                         !< oscillators
      integer :: beam = 0                      !< the first of them: modes of the bare beam
      type(pencil_t) :: pencil(2)              !< hose by y, by y - u(l)
      real(wp), allocatable :: v(:, :)         !< (r, n) column i is v_i
      real(wp), allocatable :: load(:)         !< (n) per unit force
      complex(wp), allocatable :: pole(:, :)   !< (n, 2) roots of D_i [1/time]
      integer, allocatable :: parameters(:)    !< places of those to differentiate with respect to
      type(pencil_t), allocatable :: slope(:, :)   !< (2, parameters) d pencil/d parameter
      real(wp), allocatable :: load_slope(:, :)    !< (n, parameters) d load/d parameter
      !> (r, n) how a row of v changes as its place moves along the beam of the mesh, and
      !> (r, parameters) how a parameter moves that place; such a row has no entry of H but that on
      !> the diagonal
      real(wp), allocatable :: v_slope(:, :), moves(:, :)
      !> Rows of v; 0: not there. The sensor's may be that of the tip.
      integer :: tip = 0, hose = 0, turn = 0, sensor = 0, arrow = 0, root = 0
   contains
      procedure :: layout
      procedure :: form_at
      procedure :: is_bare
      procedure :: is_undamped
   end type assembly_t

contains

   !> structure   what hangs on the beam
   !> modes       of the bare beam
   !> parameters  places in the table to differentiate with respect to
   !> shape       (n) <theta, phi> of the beam's modes for a distributed load; left out: none
   !> shape_root  <theta, x>
   function new_assembly(structure, modes, parameters, shape, shape_root) result(self)
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameters(:)
      real(wp), intent(in), optional :: shape(:), shape_root
      type(assembly_t) :: self
      real(wp), allocatable :: slopes(:, :, :), distributed(:)
      integer :: form, p, i

      self%structure = structure
      self%parameters = parameters
      self%beam = size(modes%mu)
      self%strength = strengths(structure, modes%space%length)
      allocate (slopes(size(self%strength, 1), size(self%strength, 2), size(parameters)))
      do p = 1, size(parameters)
         slopes(:, :, p) = strength_slopes(structure, modes%space%length, parameters(p))
      end do
      call lay_out(self, modes, needed=[(any(abs(self%strength(i, :)) > 0) .or. &
         any(abs(slopes(i, :, :)) > 0), i=1, size(self%strength, 1))])
      allocate (distributed(self%n), source=0.0_wp)
      if (present(shape)) distributed(:self%beam) = shape
      if (present(shape_root) .and. self%root > 0) distributed(self%n) = shape_root
      self%load = load_of(self, self%strength(:, of_load), distributed)
      allocate (self%slope(2, size(parameters)), self%load_slope(self%n, size(parameters)))
      do form = 1, 2
         self%pencil(form) = new_pencil(self, modes, self%strength, form)
         do p = 1, size(parameters)
            self%slope(form, p) = new_pencil(self, modes, slopes(:, :, p), form)
         end do
      end do
      do p = 1, size(parameters)
         self%load_slope(:, p) = load_of(self, slopes(:, of_load, p), distributed)
      end do
      allocate (self%pole(self%n, 2))
      do i = 1, self%n
         self%pole(i, :) = quadratic(self%pencil(1)%m(i), self%pencil(1)%c(i), &
            self%pencil(1)%k(i))
      end do
   end function new_assembly

   !> Which oscillators and couplings there are, and V.
   !>
   !> needed  (operators) which of them count
   subroutine lay_out(self, modes, needed)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      logical, intent(in) :: needed(:)
      logical :: soft, has_hose
      real(wp) :: place
      integer :: r

      associate (s => self%structure, l => modes%space%length)
         soft = s%has_soft_root()
         has_hose = s%has_hose() .and. any(self%strength(stretch, :) > 0)
         r = 0
         self%n = self%beam
         call add(.true., self%tip)
         call add(has_hose, self%hose)
         call add(needed(tip_slope), self%turn)
         call add(s%x_S >= 0 .or. any(self%parameters == of_x_S), self%sensor)
         if (self%sensor == 0) self%sensor = self%tip
         call add(soft, self%arrow)
         call add(soft, self%root)
         if (has_hose) self%n = self%n + 1
         if (soft) self%n = self%n + 1
         allocate (self%v(r, self%n), self%v_slope(r, self%n), &
            self%moves(r, size(self%parameters)), source=0.0_wp)
         self%v(self%tip, :self%beam) = modes%tip
         if (self%turn > 0) self%v(self%turn, :self%beam) = modes%tip_slope
         if (has_hose) self%v(self%hose, self%beam + 1) = 1
         if (soft) then
            self%v(self%tip, self%n) = l
            if (self%turn > 0) self%v(self%turn, self%n) = 1
            self%v(self%arrow, :self%beam) = modes%moment
            self%v(self%root, self%n) = 1
         end if
         if (self%sensor == self%tip) return
         place = s%sensor_place()*(l/s%length)
         self%v(self%sensor, :self%beam) = modes%at(place, 0)
         if (soft) self%v(self%sensor, self%n) = place
         where (self%parameters == of_x_S) self%moves(self%sensor, :) = l/s%length
         if (s%x_S >= 0) then
            where (self%parameters == of_length) self%moves(self%sensor, :) = -place/s%length
         end if
         if (.not. any(abs(self%moves) > 0)) return
         self%v_slope(self%sensor, :self%beam) = modes%at(place, 1)
         if (soft) self%v_slope(self%sensor, self%n) = 1
      end associate

   contains

      subroutine add(is_there, row)
         logical, intent(in) :: is_there
         integer, intent(out) :: row

         if (is_there) r = r + 1
         row = merge(r, 0, is_there)
      end subroutine add

   end subroutine lay_out

   !> F, or its derivative, from its strengths.
   !>
   !> distributed  (n) <theta, .>
   pure function load_of(self, strength, distributed) result(load)
      type(assembly_t), intent(in) :: self
      real(wp), intent(in) :: strength(:), distributed(:)
      real(wp) :: load(self%n)

      load = strength(tip_value)*self%v(self%tip, :) + strength(load_shape)*distributed
   end function load_of

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

      h = 0
      associate (b => self%beam, n => self%n, tip => self%tip, sensor => self%sensor)
         d(:b) = s(inertia) + s(bending)*modes%mu
         h(tip, tip) = s(tip_value)
         if (self%turn > 0) h(self%turn, self%turn) = s(tip_slope)
         h(sensor, sensor) = h(sensor, sensor) + s(sensor_value)
         if (self%root > 0) then
            d(n) = s(inertia)*modes%turn + s(root_slope)
            h(self%arrow, self%root) = s(inertia)
            h(self%root, self%arrow) = s(inertia)
         end if
         if (self%hose > 0) then
            d(b + 1) = s(hose) + s(stretch)
            ! By y a spring acts between hose and tip, by y - u(l) the mass moves by the sum.
            if (form == 1) call couple_hose(self, h, s(stretch), -1)
            if (form == 2) call couple_hose(self, h, s(hose), 1)
         else if (self%structure%has_hose()) then
            ! A hose that nothing holds yet stays where it is.
            h(tip, tip) = h(tip, tip) + s(stretch)
         else if (any(self%strength(stretch, :) > 0)) then
            ! The first grain of a hose moves with the tip, held by c_H and k_H.
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

   !> The rows of v. A parameter to be differentiated with respect to may add one that the structure
   !> by itself does without: J_T = 0, a sensor at the tip by default.
   pure function layout(self) result(rows)
      class(assembly_t), intent(in) :: self
      integer :: rows(6)

      rows = [self%tip, self%hose, self%turn, self%sensor, self%arrow, self%root]
   end function layout

   !> Which form of the pencil loses no digits at s.
   pure integer function form_at(self, s) result(form)
      class(assembly_t), intent(in) :: self
      complex(wp), intent(in) :: s

      associate (st => self%structure)
         form = merge(1, 2, abs(st%c_H*s + st%k_H) <= abs(st%m_H*s**2))
      end associate
   end function form_at

   !> Whether nothing hangs on the beam.
   pure logical function is_bare(self)
      class(assembly_t), intent(in) :: self

      associate (p => self%pencil(1))
         is_bare = .not. any(abs(p%hm) + abs(p%hc) + abs(p%hk) > 0)
      end associate
   end function is_bare

   pure logical function is_undamped(self)
      class(assembly_t), intent(in) :: self

      is_undamped = .not. any(abs(self%pencil(1)%c) > 0)
   end function is_undamped

end module beamid_assembly
