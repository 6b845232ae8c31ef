!> The characteristic equation W(s) = det(s**2 M + s C + K) = 0 of an assembly, as the search for
!> its roots needs it: by the logarithmic derivative W'/W.
!>
!> With an oscillator j and the quantities of `beamid_vectors`, up to a constant factor,
!>
!>     W(s) = det(A + G H) (D_j + v_j'f) times the product of D_i over all i /= j.
module beamid_characteristic
   use beamid_assembly, only: assembly_t, root_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
   implicit none
   private

   public :: logarithmic_derivative

contains

   !> Returns W'/W at a point [time]. The result is 0 if it cannot be computed because the structure
   !> without oscillator j has a root at this very point, and `huge` at a root.
   pure complex(wp) function logarithmic_derivative(self, root) result(value)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), dimension(self%layout%n) :: D, dD, inverse
      complex(wp), dimension(self%layout%r, self%layout%r) :: G, dG, H, dH, a
      complex(wp) :: b(self%layout%r, self%layout%r + 1), y(self%layout%r), w, dw
      logical :: regular
      integer :: k, l, r

      r = self%layout%r
      call self%oscillators%denominators(root, D, dD, inverse)
      ! The sums over all oscillators but j: G, its derivative, and D_i'/D_i.
      call self%layout%project(inverse, G)
      call self%layout%project(-dD*inverse**2, dG)
      value = sum(dD*inverse)
      call self%couplings%evaluate(self%couplings%form_at(root%s), root%s, H, dH)
      ! a = A + G H; the columns of b are v_j and the derivative of G H.
      do l = 1, r
         do k = 1, r
            a(k, l) = sum(G(k, :)*H(:, l))
            b(k, l + 1) = sum(dG(k, :)*H(:, l) + G(k, :)*dH(:, l))
         end do
         a(l, l) = a(l, l) + self%couplings%compliance(l)
         b(l, 1) = self%layout%v(l, root%j)
      end do
      call eliminate(r, r + 1, a, b, regular)
      ! w = D_j + v_j'f and dw = w'; value also collects the trace of (A + G H)**-1 (G H)'.
      w = D(root%j)
      dw = dD(root%j)
      do k = 1, r
         y(k) = sum(H(k, :)*b(:, 1))
         w = w + self%layout%v(k, root%j)*y(k)
         y(k) = sum(b(k, 2:)*b(:, 1))
      end do
      do k = 1, r
         dw = dw + self%layout%v(k, root%j)*sum(dH(k, :)*b(:, 1) - H(k, :)*y)
         value = value + b(k, k + 1)
      end do
      if (.not. regular .or. count(abs(inverse) > 0) < size(D) - 1) then
         value = 0
      else if (.not. abs(w) > 0) then
         value = huge(1.0_wp)
      else
         value = value + dw/w
      end if
   end function logarithmic_derivative

end module beamid_characteristic
