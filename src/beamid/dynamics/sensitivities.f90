!> The derivatives of Q(s) with respect to the parameters, operator by operator.
!>
!> A parameter enters Q by the coefficients of a few operators. For each of these, `traces` computes
!> the trace of Op Q**-1 or z'Op x, which serve all parameters; `derivative` sums them up for one.
module beamid_sensitivities
   use beamid_coefficients, only: coefficients_t
   use beamid_couplings, only: couplings_t
   use beamid_kinds, only: wp
   use beamid_layout, only: layout_t
   use beamid_oscillators, only: changes, of_rate
   use beamid_structure, only: of_b
   use beamid_terms, only: bending, hose, inertia, is_spring, of_compliance, of_damping, of_loss, &
      of_mass, of_relaxation, of_stiffness, operators, stretch
   implicit none
   private

   public :: sensitivities_t

   !> The slopes of the coefficients in Q.
   type :: sensitivities_t
      !> operators of M, C, K, L and the relaxing stiffnesses that depend on a parameter
      integer, allocatable :: operator(:)
      !> (changes, operators that depend on one, parameters) slopes of their coefficients in M, C,
      !> K, L and in the relaxing stiffnesses, and coefficients of the stiffness whose rate changes
      real(wp), allocatable :: change(:, :, :)
      !> (the same operators, parameters) whether any of these slopes is not 0
      logical, allocatable, private :: acts(:, :)
      integer, private :: last = changes   !< index of the last row of `change` that is not 0
   contains
      procedure :: set, traces, derivative
   end type sensitivities_t

contains

   !> Selects the operators that depend on a parameter, and sets the slopes of their coefficients.
   subroutine set(self, given, layout, couplings)
      class(sensitivities_t), intent(inout) :: self
      type(coefficients_t), intent(in) :: given
      type(layout_t), intent(in) :: layout
      type(couplings_t), intent(in) :: couplings
      logical :: used(size(given%c, 1))
      integer :: i, k, l, row

      if (.not. allocated(self%operator)) then
         used = any(any(abs(given%c(:, :, 1:)) > 0, dim=3), dim=2)
         used(bending) = used(bending) .or. any([(any(given%parameters == of_b(l)), &
            l=1, size(of_b))])
         used = used .and. (operators(:size(used))%derivative < 0 .or. layout%row > 0)
         self%operator = pack([(k, k=1, size(used))], used)
         allocate (self%change(changes, size(self%operator), size(given%parameters)), &
            self%acts(size(self%operator), size(given%parameters)))
      end if
      do i = 1, size(self%operator)
         k = self%operator(i)
         self%change(:of_relaxation(2), i, :) = given%c(k, of_mass:of_relaxation(2), 1:)
         self%change(of_rate, i, :) = 0
         if (k == bending) then
            do l = 1, size(of_b)
               where (given%parameters == of_b(l)) self%change(of_rate(l), i, :) = &
                  given%c(k, of_relaxation(l), 0)
            end do
         else if (is_spring(k, given%structure)) then
            ! The row of a spring contains 1 + s c/k.
            row = layout%row(k)
            self%change(of_damping, i, :) = couplings%h(of_stiffness, row, row)* &
               (given%c(k, of_compliance, 1:)*given%c(k, of_damping, 0) &
               + given%c(k, of_compliance, 0)*given%c(k, of_damping, 1:))
            self%change(of_stiffness, i, :) = 0
         end if
      end do
      do l = 1, size(self%acts, 2)
         do i = 1, size(self%operator)
            self%acts(i, l) = any(abs(self%change(:, i, l)) > 0)
         end do
      end do
      self%last = changes
      if (.not. any(abs(self%change(of_loss + 1:, :, :)) > 0)) self%last = of_loss
   end subroutine set

   !> Computes the trace of Op Z for each operator that depends on a parameter, where Z is Q**-1, or
   !> x z' of two motions, so that the trace is z'Op x.
   !>
   !> form      from `form_at`
   !> diagonal  (n) diagonal of Z
   !> T         (r, r) A**-1 V'Z V
   !> q         (operators that depend on a parameter) the traces
   pure subroutine traces(self, layout, form, diagonal, T, q)
      class(sensitivities_t), intent(in) :: self
      type(layout_t), intent(in) :: layout
      integer, intent(in) :: form
      complex(wp), intent(in) :: diagonal(:), T(:, :)
      complex(wp), intent(out) :: q(:)
      integer :: h, i

      do i = 1, size(q)
         associate (k => self%operator(i), row => layout%row(self%operator(i)))
            q(i) = 0
            if (row > 0) then
               q(i) = T(row, row)
            else if (k == inertia) then
               q(i) = sum(diagonal(:layout%beam))
            else if (k == bending) then
               q(i) = sum(layout%mu*diagonal(:layout%beam))
            else
               do h = 1, size(layout%hose)
                  if (k == hose(h) .or. k == stretch(h)) q(i) = hose_trace(layout, h, k, form, &
                     diagonal, T)
               end do
            end if
         end associate
      end do
   end subroutine traces

   !> Returns the trace of an operator of a hose; arguments as of `traces`.
   !>
   !> h, k  number and operator of the hose
   pure complex(wp) function hose_trace(layout, h, k, form, diagonal, T) result(trace)
      type(layout_t), intent(in) :: layout
      integer, intent(in) :: h, k, form
      complex(wp), intent(in) :: diagonal(:), T(:, :)
      integer :: sign

      associate (u => layout%hose(h)%point, v => layout%hose(h)%row)
         trace = 0
         if (v == 0) then
            if (layout%hose(h)%at_point == k) trace = T(u, u)
            return
         end if
         trace = diagonal(layout%hose(h)%oscillator)
         ! With y, the spring couples hose and beam; with y - u(x_H), the mass moves by the sum.
         sign = merge(1, -1, btest(form, h - 1))
         if (k == merge(hose(h), stretch(h), sign > 0)) trace = trace + T(u, u) &
            + sign*(T(u, v) + T(v, u))
      end associate
   end function hose_trace

   !> Returns the derivative of Q with respect to a parameter, z'Q_p x or tr Q**-1 Q_p, without the
   !> terms that couple all oscillators; or its derivative with respect to s.
   !>
   !> f  (changes) from `factors` of the oscillators, or their derivatives with respect to s
   !> q  (operators that depend on a parameter) from `traces`
   !> p  index among the parameters of the slopes
   pure complex(wp) function derivative(self, f, q, p) result(value)
      class(sensitivities_t), intent(in) :: self
      complex(wp), intent(in) :: f(changes), q(:)
      integer, intent(in) :: p
      real(wp) :: re, im
      integer :: i, k

      value = 0
      do i = 1, size(q)
         if (.not. self%acts(i, p)) cycle
         re = 0
         im = 0
         do k = 1, self%last
            re = re + self%change(k, i, p)*real(f(k))
            im = im + self%change(k, i, p)*aimag(f(k))
         end do
         value = value + cmplx(re, im, wp)*q(i)
      end do
   end function derivative

end module beamid_sensitivities
