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
   use beamid_structure, only: of_c_D, of_c_H, of_E, of_gamma, of_J_T, of_k_H, of_k_R, of_m_H, &
      of_m_S, of_m_T, of_rho, of_x_S, structure_t
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
      integer :: n = 0                         !< oscillators
      integer :: beam = 0                      !< the first of them: modes of the bare beam
      type(pencil_t) :: pencil(2)              !< hose by y, by y - u(l)
      real(wp), allocatable :: v(:, :)         !< (r, n) column i is v_i
      real(wp), allocatable :: load(:)         !< (n) per unit force
      complex(wp), allocatable :: pole(:, :)   !< (n, 2) roots of D_i [1/time]
      integer, allocatable :: parameters(:)    !< places of those to differentiate with respect to
      type(pencil_t), allocatable :: slope(:, :)   !< (2, parameters) d pencil/d parameter
      !> (n) how the sensor's row of v changes as the sensor moves along the beam
      real(wp), allocatable :: sensor_slope(:)
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
   !> parameters  places among `parameter_names` to differentiate with respect to
   !> load        (n) of the beam's modes per unit force; left out: a force at the tip
   !> load_root   work of the load on w = x; left out: a force at the tip
   function new_assembly(structure, modes, parameters, load, load_root) result(self)
      type(structure_t), intent(in) :: structure
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameters(:)
      real(wp), intent(in), optional :: load(:), load_root
      type(assembly_t) :: self
      integer :: form, p, i

      self%structure = structure
      self%parameters = parameters
      self%beam = size(modes%mu)
      call lay_out(self, modes)
      allocate (self%slope(2, size(parameters)))
      do form = 1, 2
         self%pencil(form) = new_pencil(self, modes, form)
         do p = 1, size(parameters)
            self%slope(form, p) = slope_of(self, modes, parameters(p), form)
         end do
      end do
      self%load = self%v(self%tip, :)
      if (present(load)) self%load(:self%beam) = load
      if (present(load_root) .and. self%root > 0) self%load(self%n) = load_root
      allocate (self%pole(self%n, 2))
      do i = 1, self%n
         self%pole(i, :) = quadratic(self%pencil(1)%m(i), self%pencil(1)%c(i), &
            self%pencil(1)%k(i))
      end do
   end function new_assembly

   !> Which oscillators and couplings there are, and V.
   subroutine lay_out(self, modes)
      type(assembly_t), intent(inout) :: self
      type(beam_modes_t), intent(in) :: modes
      logical :: soft, hose
      integer :: r

      associate (s => self%structure, wanted => self%parameters)
         soft = s%has_soft_root()
         hose = s%has_hose() .and. (s%k_H > 0 .or. s%c_H > 0)
         r = 0
         self%n = self%beam
         call add(.true., self%tip)
         call add(hose, self%hose)
         call add(s%J_T > 0 .or. any(wanted == of_J_T), self%turn)
         call add(s%x_S >= 0 .or. any(wanted == of_x_S), self%sensor)
         if (self%sensor == 0) self%sensor = self%tip
         call add(soft, self%arrow)
         call add(soft, self%root)
         if (hose) self%n = self%n + 1
         if (soft) self%n = self%n + 1
         allocate (self%v(r, self%n), source=0.0_wp)
         self%v(self%tip, :self%beam) = modes%tip
         if (self%turn > 0) self%v(self%turn, :self%beam) = modes%tip_slope
         if (self%sensor /= self%tip) self%v(self%sensor, :self%beam) = &
            modes%at(s%sensor_place(), 0)
         if (hose) self%v(self%hose, self%beam + 1) = 1
         if (soft) then
            self%v(self%tip, self%n) = s%length
            if (self%turn > 0) self%v(self%turn, self%n) = 1
            self%v(self%arrow, :self%beam) = modes%moment
            self%v(self%root, self%n) = 1
            if (self%sensor /= self%tip) self%v(self%sensor, self%n) = s%sensor_place()
         end if
         if (any(wanted == of_x_S)) then
            allocate (self%sensor_slope(self%n), source=0.0_wp)
            self%sensor_slope(:self%beam) = modes%at(s%sensor_place(), 1)
            if (soft) self%sensor_slope(self%n) = 1
         end if
      end associate

   contains

      subroutine add(is_there, row)
         logical, intent(in) :: is_there
         integer, intent(out) :: row

         if (is_there) r = r + 1
         row = merge(r, 0, is_there)
      end subroutine add

   end subroutine lay_out

   !> A pencil of zeros.
   pure function nothing(self) result(pencil)
      type(assembly_t), intent(in) :: self
      type(pencil_t) :: pencil
      integer :: r

      r = size(self%v, 1)
      allocate (pencil%m(self%n), pencil%c(self%n), pencil%k(self%n), source=0.0_wp)
      allocate (pencil%hm(r, r), pencil%hc(r, r), pencil%hk(r, r), source=0.0_wp)
   end function nothing

   !> D(s) and H(s) in one of the two forms.
   function new_pencil(self, modes, form) result(p)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: form
      type(pencil_t) :: p

      p = nothing(self)
      associate (s => self%structure, b => self%beam, n => self%n)
         p%m(:b) = s%rho
         p%c(:b) = s%gamma + s%c_D*s%I*modes%mu
         p%k(:b) = s%E*s%I*modes%mu
         p%hm(self%tip, self%tip) = s%m_T
         if (self%hose > 0) then
            p%m(b + 1) = s%m_H
            p%c(b + 1) = s%c_H
            p%k(b + 1) = s%k_H
            if (form == 1) call couple_hose(self, p%hc, s%c_H, -1)
            if (form == 1) call couple_hose(self, p%hk, s%k_H, -1)
            if (form == 2) call couple_hose(self, p%hm, s%m_H, 1)
         end if
         if (self%turn > 0) p%hm(self%turn, self%turn) = s%J_T
         p%hm(self%sensor, self%sensor) = p%hm(self%sensor, self%sensor) + s%m_S
         if (self%root > 0) then
            p%m(n) = s%rho*modes%turn
            p%c(n) = s%gamma*modes%turn
            p%k(n) = s%k_R
            call couple_root(self, p%hm, s%rho)
            call couple_root(self, p%hc, s%gamma)
         end if
      end associate
   end function new_pencil

   !> Derivative of D and H with respect to one parameter.
   function slope_of(self, modes, parameter, form) result(p)
      type(assembly_t), intent(in) :: self
      type(beam_modes_t), intent(in) :: modes
      integer, intent(in) :: parameter, form
      type(pencil_t) :: p

      p = nothing(self)
      associate (s => self%structure, b => self%beam, n => self%n, tip => self%tip)
         select case (parameter)
         case (of_m_T); p%hm(tip, tip) = 1
         case (of_J_T); p%hm(self%turn, self%turn) = 1
         case (of_m_S); p%hm(self%sensor, self%sensor) = 1
         case (of_E); p%k(:b) = s%I*modes%mu
         case (of_c_D); p%c(:b) = s%I*modes%mu
         case (of_k_R); if (self%root > 0) p%k(n) = 1
         case (of_rho)
            p%m(:b) = 1
            if (self%root > 0) p%m(n) = modes%turn
            if (self%root > 0) call couple_root(self, p%hm, 1.0_wp)
         case (of_gamma)
            p%c(:b) = 1
            if (self%root > 0) p%c(n) = modes%turn
            if (self%root > 0) call couple_root(self, p%hc, 1.0_wp)
         case (of_m_H)
            if (self%hose > 0) p%m(b + 1) = 1
            if (form == 2) call couple_hose(self, p%hm, 1.0_wp, 1)
            ! The first grain of a hose moves with the tip, held by c_H and k_H.
            if (.not. s%has_hose() .and. (s%k_H > 0 .or. s%c_H > 0)) p%hm(tip, tip) = 1
         case (of_c_H)
            if (self%hose > 0) p%c(b + 1) = 1
            if (form == 1) call couple_hose(self, p%hc, 1.0_wp, -1)
            ! A hose that nothing holds yet stays where it is.
            if (s%has_hose() .and. self%hose == 0) p%hc(tip, tip) = 1
         case (of_k_H)
            if (self%hose > 0) p%k(b + 1) = 1
            if (form == 1) call couple_hose(self, p%hk, 1.0_wp, -1)
            if (s%has_hose() .and. self%hose == 0) p%hk(tip, tip) = 1
         end select
      end associate
   end function slope_of

   !> A spring between hose and tip (sign -1), or a mass that moves by the sum of both (+1).
   pure subroutine couple_hose(self, h, value, sign)
      type(assembly_t), intent(in) :: self
      real(wp), intent(inout) :: h(:, :)
      real(wp), intent(in) :: value
      integer, intent(in) :: sign

      if (self%hose == 0) return
      h(self%tip, self%tip) = h(self%tip, self%tip) + value
      h(self%tip, self%hose) = h(self%tip, self%hose) + sign*value
      h(self%hose, self%tip) = h(self%hose, self%tip) + sign*value
   end subroutine couple_hose

   !> What the turn of the root and the bending of the beam do to each other.
   pure subroutine couple_root(self, h, value)
      type(assembly_t), intent(in) :: self
      real(wp), intent(inout) :: h(:, :)
      real(wp), intent(in) :: value

      h(self%arrow, self%root) = value
      h(self%root, self%arrow) = value
   end subroutine couple_root

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
