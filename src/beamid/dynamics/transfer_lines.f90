!> The transfer function h(s) = o'Q(s)**-1 F at many points, as frequency responses need it.
!>
!> With the quantities of `beamid_vectors` and D = diag(D_i),
!>
!>     (A + G H) u = V'D**-1 F,  q = D**-1 (F - V H u),  G = V'D**-1 V,
!>
!> and h = u at the row of the sensor. At a root of some D_i these formulas lose digits, and those
!> of `beamid_transfer`, which leave the oscillator i out, take their place.
module beamid_transfer_lines
   use beamid_assembly, only: assembly_t, root_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
   use beamid_transfer, only: differentiate_motion, transfer_at, transfer_t
   use beamid_vectors, only: nearest_pole
   implicit none
   private

   public :: transfer_along

contains

   !> Computes the transfer function and its derivatives at several points.
   !>
   !> s  (points) places in the complex plane [1/time]
   !> h  (points, 0:parameters of the assembly) column 0 is h, column p its derivative
   subroutine transfer_along(assembly, s, h)
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s(:)
      complex(wp), intent(out) :: h(:, 0:)
      type(transfer_t) :: value
      type(root_t) :: point
      complex(wp) :: row(0:ubound(h, 2))
      logical :: regular
      integer :: k

      do k = 1, size(s)
         regular = .false.
         if (.not. assembly%is_dense()) call transfer_apart(assembly%layout%n, assembly%layout%r, &
            assembly, s(k), row, regular)
         if (.not. regular) then
            point = root_t(s=s(k))
            call nearest_pole(assembly, point)
            call transfer_at(assembly, point, size(row) > 1, value)
            row(0) = value%h
            if (size(row) > 1) row(1:) = value%dh
         end if
         h(k, :) = row
      end do
   end subroutine transfer_along

   !> Computes the transfer function and its derivatives at a point that is not near a root of any
   !> D_i, for an assembly without dense matrices.
   !>
   !> n, r     numbers of oscillators and rows
   !> h        (0:parameters) h and its derivatives
   !> regular  .false.: the point is too near to a root of some D_i, and h is not set
   subroutine transfer_apart(n, r, assembly, s, h, regular)
      integer, intent(in) :: n, r
      type(assembly_t), intent(in) :: assembly
      complex(wp), intent(in) :: s
      complex(wp), intent(out) :: h(0:)
      logical, intent(out) :: regular
      !> Least |D_i|/|m_i s**2|; four digits of sixteen are lost there.
      real(wp), parameter :: apart = 1e-4_wp
      complex(wp), dimension(n) :: inverse, load, q, o
      complex(wp), dimension(r, r) :: couplings, slopes, coupled, G
      complex(wp) :: D, u(r, 2), f(r, 2), relaxed(assembly%oscillators%relaxation%n)
      real(wp) :: square, least
      integer :: form, i, k, l

      least = (apart*(real(s)**2 + aimag(s)**2))**2
      associate (of => assembly%oscillators%relaxation)
         relaxed = s/(s + of%rate(:of%n))
      end associate
      associate (p => assembly%oscillators, vt => assembly%layout%vt)
         do i = 1, n
            D = (p%m(i)*s + p%c(i))*s + cmplx(p%k(i), p%l(i), wp)
            if (size(relaxed) > 0) D = D + sum(p%relaxed(i, :)*relaxed)
            square = real(D)**2 + aimag(D)**2
            regular = square > least*p%m(i)**2
            if (.not. regular) return
            inverse(i) = conjg(D)/square
         end do
         form = assembly%couplings%form_at(s)
         call assembly%couplings%evaluate(form, s, couplings, slopes)
         load = assembly%load%at(s, form, assembly%layout%v)
         call assembly%layout%project(inverse, G)
         q = load*inverse
         do k = 1, r
            u(k, 1) = sum(vt(:, k)*q)
            u(k, 2) = G(k, assembly%layout%sensor)
            do l = 1, r
               coupled(l, k) = sum(G(l, :)*couplings(:, k))
            end do
            coupled(k, k) = coupled(k, k) + assembly%couplings%compliance(k)
         end do
         call eliminate(r, 2, coupled, u, regular)
         if (.not. regular) return
         h(0) = u(assembly%layout%sensor, 1)
         if (size(h) == 1) return
         f = matmul(couplings, u)
         o = vt(:, assembly%layout%sensor)
         do k = 1, r
            do i = 1, n
               load(i) = load(i) - vt(i, k)*f(k, 1)
               o(i) = o(i) - vt(i, k)*f(k, 2)
            end do
         end do
         q = load*inverse
         o = o*inverse
      end associate
      call differentiate_motion(assembly, root_t(s=s), form, couplings, q, u(:, 1), o, u(:, 2), &
         h(1:))
   end subroutine transfer_apart

end module beamid_transfer_lines
