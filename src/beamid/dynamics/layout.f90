!> The layout of the equations in modal coordinates: which oscillators there are, and at which
!> points of the beam they are coupled.
!>
!> The oscillators are the modes of the bare beam, followed by each hose that has a mass and is
!> held. Each row of V is the motion of one point per unit of each oscillator: a displacement or
!> a slope of the beam, or the coordinate of a hose. The layout depends on the mesh, the
!> attachments and their positions, but not on the values of coefficients.
module beamid_layout
   use beamid_coefficients, only: coefficients_t
   use beamid_kinds, only: wp
   use beamid_modes, only: beam_modes_t
   use beamid_structure, only: of_g
   use beamid_terms, only: end_condition, force_value, hose, hose_value, is_end_condition, &
      is_spring, operators, sensor_slope, sensor_value, stretch, tip_slope, tip_value
   implicit none
   private

   public :: hose_row_t, layout_t, values_at

   !> A hose that is an oscillator, or that is held by its spring and dashpot alone.
   type :: hose_row_t
      integer :: point = 0           !< row of V of the displacement of the beam at the hose
      integer :: row = 0             !< row of V of the oscillator; 0: it is none
      integer :: oscillator = 0      !< number of the oscillator; 0: it is none
      !> coupling that acts at the point alone if the hose is no oscillator: `stretch` if the hose
      !> stays at rest because it lacks c_H and k_H, `hose` if it lacks a mass; 0: none
      integer :: at_point = 0
   end type hose_row_t

   !> Oscillators and rows of V.
   type :: layout_t
      integer :: n = 0                 !< number of oscillators
      integer :: r = 0                 !< number of rows of V
      integer :: beam = 0   !< number of modes of the bare beam; these oscillators come first
      !> (beam) eigenvalues of the bare beam's modes: bending integral per unit inertia integral
      !> [1/length**4]
      real(wp), allocatable :: mu(:)
      type(hose_row_t), allocatable :: hose(:)   !< (hoses) the hoses
      !> (operators) row of V of an operator; 0: none. A parameter of the slopes may add a row that
      !> the structure itself does not need (J_T = 0, or a sensor that is at the tip by default).
      integer, allocatable :: row(:)
      !> rows of tip and sensor, which may be the same
      integer :: tip = 0, sensor = 0
      !> row of the slope at the sensor; 0: the sensor does not read gravity
      integer :: tilt_row = 0
      real(wp), allocatable :: v(:, :)         !< (r, n) V; column i belongs to oscillator i
      !> (n, r) transpose of V, and (n, r (r + 1)/2) products of its rows k <= l, in the column with
      !> the number k + l (l - 1)/2
      real(wp), allocatable :: vt(:, :), vv(:, :)
      !> (r, n) derivative of a row of V with respect to the position of its point on the beam of
      !> the mesh, and (r, parameters) the derivative of this position. A row whose point moves has
      !> only a diagonal entry in H.
      real(wp), allocatable :: v_slope(:, :), moves(:, :)
   contains
      procedure :: set, project, select_oscillators
   end type layout_t

contains

   !> Numbers the oscillators and the rows of V, and sets V.
   !> An operator needs a row if it has a coefficient that is not 0, or a slope.
   subroutine set(self, given, modes)
      class(layout_t), intent(out) :: self
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      logical :: is_point(size(given%c, 1)), reads_gravity
      integer :: k

      self%mu = modes%mu
      self%beam = size(modes%mu)
      self%n = self%beam
      allocate (self%row(size(is_point)), source=0)
      self%tip = 1
      self%row(tip_value) = 1
      self%r = 1
      is_point = [(any(abs(given%c(k, :, :)) > 0) .or. is_spring(k, given%structure), &
         k=1, size(is_point))]
      call number_hoses(self, given, is_point)
      reads_gravity = given%structure%g > 0 .or. any(given%parameters == of_g)
      associate (observer => given%structure%observer)
         is_point(sensor_value(observer)) = .true.
         is_point(sensor_slope(observer)) = is_point(sensor_slope(observer)) .or. reads_gravity
      end associate
      do k = 1, size(is_point)
         if (.not. is_point(k) .or. k == force_value .or. operators(k)%derivative < 0 .or. &
            self%row(k) > 0 .or. any(end_condition == k .and. modes%space%essential)) cycle
         if (is_end_condition(k) .or. operators(k)%is_grounded .or. &
            .not. given%stays_at_tip(k)) then
            self%r = self%r + 1
            self%row(k) = self%r
         else if (operators(k)%derivative == 0) then
            self%row(k) = self%tip
         else
            if (self%row(tip_slope) == 0) then
               self%r = self%r + 1
               self%row(tip_slope) = self%r
            end if
            self%row(k) = self%row(tip_slope)
         end if
      end do
      self%hose%point = self%row(hose_value(:size(self%hose)))
      self%sensor = self%row(sensor_value(given%structure%observer))
      if (reads_gravity) self%tilt_row = self%row(sensor_slope(given%structure%observer))
      call set_v(self, given, modes)
   end subroutine set

   !> Numbers the oscillators of the hoses and their rows.
   !>
   !> is_point  (operators) in and out: whether the operator needs a row
   subroutine number_hoses(self, given, is_point)
      type(layout_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      logical, intent(inout) :: is_point(:)
      logical, allocatable :: has_mass(:)
      logical :: is_held
      integer :: h

      has_mass = given%structure%has_hose()
      allocate (self%hose(size(has_mass)))
      do h = 1, size(has_mass)
         is_held = any(given%c(stretch(h), :, 0) > 0)
         is_point(hose_value(h)) = is_point(hose(h)) .or. is_point(stretch(h))
         if (has_mass(h) .and. is_held) then
            self%r = self%r + 1
            self%n = self%n + 1
            self%hose(h) = hose_row_t(row=self%r, oscillator=self%n)
         else if (has_mass(h)) then
            self%hose(h)%at_point = stretch(h)
         else if (is_held) then
            self%hose(h)%at_point = hose(h)
         end if
      end do
   end subroutine number_hoses

   !> Sets V, its products, and its derivatives with respect to the positions of the points.
   subroutine set_v(self, given, modes)
      type(layout_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      integer :: h, k, l

      associate (r => self%r, n => self%n, b => self%beam)
         allocate (self%v(r, n), self%v_slope(r, n), self%moves(r, size(given%parameters)), &
            source=0.0_wp)
         do h = 1, size(self%hose)
            if (self%hose(h)%row > 0) self%v(self%hose(h)%row, self%hose(h)%oscillator) = 1
         end do
         do k = 1, size(self%row)
            if (self%row(k) == 0) cycle
            associate (row => self%row(k))
               self%v(row, :b) = values_at(k, given, modes, 0)
               self%moves(row, :) = given%place_slopes(k)
               if (any(abs(self%moves(row, :)) > 0)) &
                  self%v_slope(row, :b) = values_at(k, given, modes, 1)
            end associate
         end do
         allocate (self%vt, source=transpose(self%v))
         allocate (self%vv(n, (r*(r + 1))/2))
         do l = 1, r
            do k = 1, l
               self%vv(:, k + (l*(l - 1))/2) = self%vt(:, k)*self%vt(:, l)
            end do
         end do
      end associate
   end subroutine set_v

   !> Computes V W V' with a diagonal matrix W.
   !>
   !> weights  (n) diagonal of W
   !> G        (r, r)
   pure subroutine project(self, weights, G)
      class(layout_t), intent(in) :: self
      complex(wp), intent(in) :: weights(self%n)
      complex(wp), intent(out) :: G(self%r, self%r)
      integer :: k, l

      do l = 1, self%r
         do k = 1, l
            G(k, l) = weighted_sum(self%n, self%vv(:, k + l*(l - 1)/2), weights)
            G(l, k) = G(k, l)
         end do
      end do
   end subroutine project

   !> Returns the sum of n complex numbers with real weights.
   pure complex(wp) function weighted_sum(n, weight, values)
      integer, intent(in) :: n
      real(wp), intent(in) :: weight(n)
      complex(wp), intent(in) :: values(n)
      real(wp) :: re, im
      integer :: i

      ! A product of a real and a complex number would be one of two complex numbers.
      re = 0
      im = 0
      do i = 1, n
         re = re + weight(i)*real(values(i))
         im = im + weight(i)*aimag(values(i))
      end do
      weighted_sum = cmplx(re, im, wp)
   end function weighted_sum

   !> Returns the layout with some of the beam's oscillators and all hoses. The products of rows and
   !> the derivatives are left out.
   !>
   !> kept  numbers of the oscillators that remain
   pure type(layout_t) function select_oscillators(self, kept) result(few)
      class(layout_t), intent(in) :: self
      integer, intent(in) :: kept(:)

      few%n = size(kept)
      few%r = self%r
      few%beam = count(kept <= self%beam)
      few%mu = self%mu(kept(:few%beam))
      few%hose = self%hose
      where (few%hose%row > 0) few%hose%oscillator = few%hose%oscillator - self%beam + few%beam
      few%v = self%v(:, kept)
      few%vt = self%vt(kept, :)
   end function select_oscillators

   !> Returns the values of the beam's modes at the point of an operator, or of their derivatives.
   !>
   !> k       operator
   !> more    additional derivatives with respect to x, beyond the operator's own
   !> values  (beam)
   function values_at(k, given, modes, more) result(values)
      integer, intent(in) :: k, more
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      real(wp) :: values(size(modes%mu))

      values = modes%at(given%place(k), operators(k)%derivative + more)
   end function values_at

end module beamid_layout
