!> The couplings between the rows of V: V H(s) A**-1 V' couples the oscillators with one another.
!>
!> H is a small matrix, the dynamic stiffness of the attachments. A is diagonal. Its entry is 1,
!> except in the row of a spring to the ground: there it is the compliance, and H contains
!> 1 + s c/k, so that the spring may be rigid (compliance 0).
!>
!> A hose can be described in two ways. With the coordinate y, c_H s + k_H couples the hose with its
!> point of the beam; with y - u(x_H), m_H s**2 couples them instead. D(s) is the same. The smaller
!> coupling loses fewer digits, so `form_at` chooses for each hose at a given s. The choices are the
!> bits of an integer, the form: bit h - 1 is set if hose h is described by y - u(x_H).
module beamid_couplings
   use beamid_coefficients, only: coefficients_t
   use beamid_kinds, only: wp
   use beamid_layout, only: hose_row_t, layout_t
   use beamid_oscillators, only: oscillators_t
   use beamid_terms, only: hose, inertia, is_spring, of_compliance, of_damping, of_mass, &
      of_stiffness, operators, stretch
   implicit none
   private

   public :: couplings_t

   !> A hose and its coefficients m_H, c_H and k_H.
   type, extends(hose_row_t) :: coupled_hose_t
      real(wp) :: strength(of_mass:of_stiffness) = 0
   end type coupled_hose_t

   !> H(s) and A of r rows.
   type :: couplings_t
      !> (of_mass:of_stiffness, r, r) coefficients of s**2, s and 1 in H, symmetric, without the
      !> couplings of the hoses
      real(wp), allocatable :: h(:, :, :)
      type(coupled_hose_t), allocatable :: hose(:)      !< (hoses) the hoses
      real(wp), allocatable :: compliance(:)            !< (r) diagonal of A
      real(wp), allocatable :: compliance_slope(:, :)   !< (r, parameters) its slopes
      !> (r) whether the spring of the row is so stiff that the pair of roots that it adds is far
      !> above all others and is left out
      logical, allocatable :: rigid(:)
      real(wp), private :: beam_mass = 0
   contains
      procedure :: set, form_at, evaluate, coefficient, masses, vanish
   end type couplings_t

   !> A pair of roots this many times above all poles of the oscillators has no influence on the
   !> observed motion.
   real(wp), parameter :: far_away = 1e5_wp

contains

   !> Sets H and A.
   subroutine set(self, given, layout, oscillators)
      class(couplings_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      type(layout_t), intent(in) :: layout
      type(oscillators_t), intent(in) :: oscillators
      integer :: k

      associate (r => layout%r)
         if (.not. allocated(self%h)) allocate (self%h(of_mass:of_stiffness, r, r), &
            self%hose(size(layout%hose)), self%compliance(r), self%rigid(r), &
            self%compliance_slope(r, size(given%parameters)))
      end associate
      do k = 1, size(self%hose)
         self%hose(k)%hose_row_t = layout%hose(k)
         self%hose(k)%strength = [given%c(hose(k), of_mass, 0), &
            given%c(stretch(k), of_damping, 0), given%c(stretch(k), of_stiffness, 0)]
      end do
      call sum_terms(given, layout, self%h)
      self%beam_mass = given%c(inertia, of_mass, 0)*given%structure%length
      self%compliance = 1
      self%compliance_slope = 0
      self%rigid = .false.
      do k = 1, size(layout%row)
         if (layout%row(k) > 0 .and. is_spring(k, given%structure)) &
            call set_spring(self, k, given, layout, oscillators)
      end do
   end subroutine set

   !> Sums the terms in H but those of springs to the ground.
   !>
   !> h  (of_mass:of_stiffness, r, r) coefficients of the rows
   pure subroutine sum_terms(given, layout, h)
      type(coefficients_t), intent(in) :: given
      type(layout_t), intent(in) :: layout
      real(wp), intent(out) :: h(:, :, :)
      integer :: i, k

      h = 0
      do k = 1, size(layout%row)
         associate (row => layout%row(k))
            if (row == 0 .or. is_spring(k, given%structure)) cycle
            h(:, row, row) = h(:, row, row) + given%c(k, of_mass:of_stiffness, 0)
         end associate
      end do
      do i = 1, size(layout%hose)
         associate (x => layout%hose(i)%point, at_point => layout%hose(i)%at_point)
            if (at_point > 0) h(:, x, x) = h(:, x, x) + given%c(at_point, of_mass:of_stiffness, 0)
         end associate
      end do
   end subroutine sum_terms

   !> Sets the row of a spring to the ground, rigid or not. The unknown of such a row is the force y
   !> of the spring: A y is the motion, and (1 + s c/k) y the force of spring and damper. The unit
   !> of y is E I mu l**(1 + 2 d), with mu of the highest mode, l of the mesh, and d = 0 for a
   !> deflection or 1 for a rotation. This gives the row the size of the others.
   !>
   !> k  operator of the spring
   pure subroutine set_spring(self, k, given, layout, oscillators)
      type(couplings_t), intent(inout) :: self
      integer, intent(in) :: k
      type(coefficients_t), intent(in) :: given
      type(layout_t), intent(in) :: layout
      type(oscillators_t), intent(in) :: oscillators
      real(wp) :: unit

      associate (row => layout%row(k), compliance => given%c(k, of_compliance, 0))
         unit = oscillators%E*layout%mu(layout%beam) &
            *given%mesh_length**(1 + 2*operators(k)%derivative)
         self%compliance(row) = unit*compliance
         self%compliance_slope(row, :) = unit*given%c(k, of_compliance, 1:)
         self%h(of_stiffness, row, row) = unit
         self%h(of_damping, row, row) = unit*compliance*given%c(k, of_damping, 0)
         ! The pair of roots of so stiff a spring is far away and is left out. A rigid spring is
         ! held even if the poles are beyond the range of numbers.
         self%rigid(row) = .not. sum(layout%v(row, :)**2/oscillators%m) < &
            compliance*(far_away*maxval(abs(oscillators%pole)))**2
      end associate
   end subroutine set_spring

   !> Returns the form that is more accurate at s [1/time]: bit h - 1 is set if hose h is described
   !> by y - u(x_H).
   pure integer function form_at(self, s) result(form)
      class(couplings_t), intent(in) :: self
      complex(wp), intent(in) :: s
      complex(wp) :: held, moved
      integer :: h

      form = 0
      do h = 1, size(self%hose)
         if (self%hose(h)%row == 0) cycle
         associate (of => self%hose(h)%strength)
            held = of(of_damping)*s + of(of_stiffness)
            moved = of(of_mass)*s**2
         end associate
         if (real(held)**2 + aimag(held)**2 > real(moved)**2 + aimag(moved)**2) &
            form = ibset(form, h - 1)
      end do
   end function form_at

   !> Computes H(s), H'(s) and H''(s)/2 in a form, each of shape (r, r).
   !>
   !> form             as of `form_at`
   !> H, dH, half_d2H  H(s), H'(s) and H''(s)/2, the coefficient of s**2
   pure subroutine evaluate(self, form, s, H, dH, half_d2H)
      class(couplings_t), intent(in) :: self
      integer, intent(in) :: form
      complex(wp), intent(in) :: s
      complex(wp), dimension(size(self%rigid), size(self%rigid)), intent(out) :: H, dH
      complex(wp), intent(out), optional :: half_d2H(size(self%rigid), size(self%rigid))
      complex(wp) :: square
      real(wp) :: c(of_mass:of_stiffness)
      integer :: i, k, l

      square = s*s
      do l = 1, size(self%rigid)
         do k = 1, size(self%rigid)
            c = self%h(:, k, l)
            H(k, l) = cmplx(c(of_mass)*real(square) + c(of_damping)*real(s) + c(of_stiffness), &
               c(of_mass)*aimag(square) + c(of_damping)*aimag(s), wp)
            dH(k, l) = cmplx(2*c(of_mass)*real(s) + c(of_damping), 2*c(of_mass)*aimag(s), wp)
            if (present(half_d2H)) half_d2H(k, l) = c(of_mass)
         end do
      end do
      do i = 1, size(self%hose)
         if (self%hose(i)%row == 0) cycle
         c = coupling(self%hose(i), btest(form, i - 1))
         call couple(self%hose(i), btest(form, i - 1), c(of_mass)*square + c(of_damping)*s &
            + c(of_stiffness), H)
         call couple(self%hose(i), btest(form, i - 1), 2*c(of_mass)*s + c(of_damping), dH)
         if (present(half_d2H)) &
            call couple(self%hose(i), btest(form, i - 1), cmplx(c(of_mass), 0, wp), half_d2H)
      end do
   end subroutine evaluate

   !> Computes the coefficient of s**2, s or 1 in H in a form.
   !>
   !> matrix  `of_mass`, `of_damping` or `of_stiffness`
   !> h       (r, r)
   pure subroutine coefficient(self, matrix, form, h)
      class(couplings_t), intent(in) :: self
      integer, intent(in) :: matrix, form
      real(wp), intent(out) :: h(:, :)
      complex(wp) :: in_form(size(h, 1), size(h, 2))
      real(wp) :: c(of_mass:of_stiffness)
      integer :: i

      in_form = self%h(matrix, :, :)
      do i = 1, size(self%hose)
         if (self%hose(i)%row == 0) cycle
         c = coupling(self%hose(i), btest(form, i - 1))
         call couple(self%hose(i), btest(form, i - 1), cmplx(c(matrix), 0, wp), in_form)
      end do
      h = real(in_form)
   end subroutine coefficient

   !> Returns the coefficients of s**2, s and 1 by which a hose couples with its point of the beam.
   !>
   !> stretched  whether the coordinate of the hose is y - u(x_H), not y
   pure function coupling(hose, stretched) result(c)
      type(coupled_hose_t), intent(in) :: hose
      logical, intent(in) :: stretched
      real(wp) :: c(of_mass:of_stiffness)

      c = hose%strength
      if (stretched) then
         c(of_damping:) = 0
      else
         c(of_mass) = 0
      end if
   end function coupling

   !> Adds the coupling of a hose to H.
   !>
   !> stretched  as in `coupling`
   !> value      the coupling at s, or a coefficient of it
   pure subroutine couple(hose, stretched, value, H)
      type(coupled_hose_t), intent(in) :: hose
      logical, intent(in) :: stretched
      complex(wp), intent(in) :: value
      complex(wp), intent(inout) :: H(:, :)

      associate (x => hose%point, y => hose%row)
         H(x, x) = H(x, x) + value
         H(x, y) = H(x, y) + merge(1, -1, stretched)*value
         H(y, x) = H(x, y)
      end associate
   end subroutine couple

   !> Returns H/s**2 for large s, (r, r), with a positive number on the diagonal of each row that is
   !> held.
   pure function masses(self) result(h)
      class(couplings_t), intent(in) :: self
      real(wp) :: h(size(self%rigid), size(self%rigid))
      integer :: k

      call self%coefficient(of_mass, 0, h)
      do k = 1, size(h, 1)
         if (self%rigid(k)) h(k, k) = self%beam_mass
      end do
   end function masses

   !> Returns whether H is 0.
   pure logical function vanish(self)
      class(couplings_t), intent(in) :: self

      vanish = .not. (any(abs(self%h) > 0) .or. any(self%hose%row > 0))
   end function vanish

end module beamid_couplings
