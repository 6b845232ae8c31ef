!> The load F of the equations in modal coordinates: a force at a point, a distributed force, or the
!> motion of the base.
!>
!> A part of F acts along rows of V. If the motion is small there, its product with V'x is more
!> accurate than a sum over the oscillators. The rest is the remainder.
!>
!> A base that moves loads the structure by -M r and, divided by s, by -C r, where r is the rigid
!> displacement of the whole structure by one. An operator that is connected to the ground is
!> treated differently: its row measures motion relative to the ground (`base_coupling`), which
!> loads all of its terms.
module beamid_loads
   use beamid_coefficients, only: coefficients_t
   use beamid_kinds, only: wp
   use beamid_layout, only: layout_t, values_at
   use beamid_modes, only: beam_modes_t
   use beamid_terms, only: force_value, hose, inertia, load_shape, of_damping, of_load, of_mass, &
      operators
   implicit none
   private

   public :: load_t, modal_load_t

   !> The kind of load.
   type :: load_t
      !> (beam) <theta, phi> for the modes phi of the bare beam; not allocated: no distributed force
      real(wp), allocatable :: shape(:)
      logical :: base = .false.           !< the base moves; there is no force
   end type load_t

   !> F per unit force or acceleration of the base, and its slopes. Index 0 of the parameters is F
   !> itself.
   type :: modal_load_t
      real(wp), allocatable :: total(:)         !< (n) F if all hoses are described by y
      !> (n, 0:parameters) the remainder of F, and the part of the load that is divided by s, which
      !> is allocated only if the base moves
      real(wp), allocatable :: remainder(:, :), velocity(:, :)
      logical, allocatable :: changes(:)        !< (parameters) whether a slope of F is not 0
      !> (r) displacement of a row per unit displacement of the base: 1 if it measures motion
      !> relative to the ground, otherwise 0. Per unit acceleration of the base, the row moves by
      !> this over s**2.
      real(wp), allocatable :: base_coupling(:)
      !> whether velocity or displacement of the base load the structure, besides its acceleration
      logical :: feels_base = .false.
      !> (r, 0:parameters) the part of F that acts along the rows if all hoses are described by y
      real(wp), allocatable, private :: along(:, :)
      !> (hoses, 0:parameters) masses that load the points of the hoses, too, if these are described
      !> by y - u(x_H); 0 without a motion of the base
      real(wp), allocatable, private :: hose_mass(:, :)
      integer, allocatable, private :: hose_point(:)   !< (hoses) rows of these points
   contains
      procedure :: set, rows, at, power
   end type modal_load_t

contains

   !> Sets F and its slopes.
   !>
   !> applied  kind of load
   subroutine set(self, applied, given, modes, layout)
      class(modal_load_t), intent(out) :: self
      type(load_t), intent(in) :: applied
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      type(layout_t), intent(in) :: layout
      integer :: k, p

      associate (last => size(given%parameters))
         allocate (self%along(layout%r, 0:last), self%hose_mass(size(layout%hose), 0:last), &
            self%remainder(layout%n, 0:last), self%base_coupling(layout%r), source=0.0_wp)
      end associate
      self%hose_point = layout%hose%point
      if (applied%base) then
         allocate (self%velocity, mold=self%remainder)
         self%velocity = 0
         do p = 0, size(given%parameters)
            call add_masses(layout, given%c(:, of_mass, p), self%along(:, p), self%hose_mass(:, p))
            self%remainder(:layout%beam, p) = -given%c(inertia, of_mass, p)*modes%total(:, 1)
            self%velocity(:layout%beam, p) = -given%c(inertia, of_damping, p)*modes%total(:, 2)
         end do
         do k = 1, size(layout%row)
            if (layout%row(k) > 0 .and. operators(k)%is_grounded) &
               self%base_coupling(layout%row(k)) = 1
         end do
         self%feels_base = any(self%base_coupling > 0) .or. any(abs(self%velocity) > 0)
      else
         call add_forces(self, applied, given, modes, layout)
      end if
      self%total = self%remainder(:, 0) + matmul(self%along(:, 0), layout%v)
      self%changes = [(applied%base .or. any(abs(self%along(:, p)) > 0) .or. &
         any(abs(self%remainder(:, p)) > 0), p=1, size(given%parameters))]
   end subroutine set

   !> Adds a force at a point and a distributed force to F and its slopes.
   subroutine add_forces(self, applied, given, modes, layout)
      type(modal_load_t), intent(inout) :: self
      type(load_t), intent(in) :: applied
      type(coefficients_t), intent(in) :: given
      type(beam_modes_t), intent(in) :: modes
      type(layout_t), intent(in) :: layout
      real(wp), dimension(layout%beam) :: point, slope
      real(wp) :: moves(0:size(given%parameters))
      integer :: p

      associate (b => layout%beam, force => given%c(force_value, of_load, :))
         if (given%stays_at_tip(force_value)) then
            self%along(layout%tip, :) = force
         else
            point = values_at(force_value, given, modes, 0)
            slope = values_at(force_value, given, modes, 1)
            moves = [0.0_wp, force(1)*given%place_slopes(force_value)]
            do p = 0, size(given%parameters)
               self%remainder(:b, p) = force(1 + p)*point + moves(p)*slope
            end do
         end if
         if (.not. allocated(applied%shape)) return
         do p = 0, size(given%parameters)
            self%remainder(:b, p) = self%remainder(:b, p) &
               + given%c(load_shape, of_load, p)*applied%shape
         end do
      end associate
   end subroutine add_forces

   !> Subtracts the masses that a base carries along from the part of F along the rows.
   !>
   !> mass       (operators) coefficients of M, or a slope of them
   !> along      (r) in and out: the part of F
   !> hose_mass  (hoses) masses of the hoses that are oscillators
   pure subroutine add_masses(layout, mass, along, hose_mass)
      type(layout_t), intent(in) :: layout
      real(wp), intent(in) :: mass(:)
      real(wp), intent(inout) :: along(:), hose_mass(:)
      integer :: h, k

      do k = 1, size(layout%row)
         if (layout%row(k) == 0 .or. .not. operators(k)%moves_with_base .or. &
            operators(k)%is_grounded) cycle
         along(layout%row(k)) = along(layout%row(k)) - mass(k)
      end do
      do h = 1, size(layout%hose)
         associate (of => layout%hose(h))
            if (of%row > 0) then
               along(of%row) = along(of%row) - mass(hose(h))
               hose_mass(h) = mass(hose(h))
            else if (of%at_point == hose(h)) then
               ! A hose that nothing holds stays where it is.
               along(of%point) = along(of%point) - mass(hose(h))
            end if
         end associate
      end do
   end subroutine add_masses

   !> Computes the part of F that acts along the rows of V in a form, or a slope of it.
   !>
   !> form  from `form_at`
   !> load  (r)
   !> p     index among the parameters of the slopes; 0: F itself
   pure subroutine rows(self, form, load, p)
      class(modal_load_t), intent(in) :: self
      integer, intent(in) :: form, p
      real(wp), intent(out) :: load(:)
      integer :: h

      load = self%along(:, p)
      do h = 1, size(self%hose_point)
         if (btest(form, h - 1)) load(self%hose_point(h)) = load(self%hose_point(h)) &
            - self%hose_mass(h, p)
      end do
   end subroutine rows

   !> Returns F at s, including the load by the velocity of the base.
   !>
   !> s     [1/time]
   !> form  from `form_at`
   !> v     (r, n) V
   !> load  (n)
   pure function at(self, s, form, v) result(load)
      class(modal_load_t), intent(in) :: self
      complex(wp), intent(in) :: s
      integer, intent(in) :: form
      real(wp), intent(in) :: v(:, :)
      complex(wp) :: load(size(v, 2))
      real(wp) :: along(size(v, 1))

      load = self%total
      if (form /= 0) then
         call self%rows(form, along, 0)
         load = self%remainder(:, 0) + matmul(along, v)
      end if
      if (.not. allocated(self%velocity)) return
      if (any(abs(self%velocity(:, 0)) > 0)) load = load + self%velocity(:, 0)/s
   end function at

   !> Returns x'F at s, or a slope of it, without the contribution of rows that move with the base
   !> and of rows whose points move.
   !>
   !> form  from `form_at`
   !> x, y  (n), (r) motion: oscillators and rows
   !> s     [1/time]
   !> p     index among the parameters of the slopes; 0: F itself
   pure complex(wp) function power(self, form, x, y, s, p)
      class(modal_load_t), intent(in) :: self
      integer, intent(in) :: form, p
      complex(wp), intent(in) :: x(:), y(:), s
      integer :: h, i

      power = 0
      do i = 1, size(y)
         power = power + self%along(i, p)*y(i)
      end do
      do h = 1, size(self%hose_point)
         if (btest(form, h - 1)) power = power - self%hose_mass(h, p)*y(self%hose_point(h))
      end do
      do i = 1, size(x)
         power = power + self%remainder(i, p)*x(i)
      end do
      if (.not. allocated(self%velocity)) return
      if (any(abs(self%velocity(:, p)) > 0)) power = power + sum(self%velocity(:, p)*x)/s
   end function power

end module beamid_loads
