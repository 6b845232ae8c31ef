!> The characteristic equation W(s) = det(s**2 M + s C + K) = 0 of an assembly, as the search for
!> its roots needs it: by the logarithmic derivative W'/W.
!>
!> With an oscillator j and the quantities of `beamid_vectors`, up to a constant factor,
!>
!>     W(s) = det(A + G H) (D_j + v_j'f) times the product of D_i over all i /= j.
module beamid_characteristic
   use beamid_assembly, only: assembly_t
   use beamid_kinds, only: wp
   use beamid_matrices, only: eliminate
   use beamid_vectors, only: denominators, root_t
   implicit none
   private

   public :: logarithmic_derivative

contains

   !> Returns W'/W at a point [time]. The result is 0 if it cannot be computed because the structure
   !> without oscillator j has a root at this very point, and `huge` at a root.
   pure complex(wp) function logarithmic_derivative(self, root) result(value)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), dimension(size(self%v, 1), size(self%v, 1)) :: G, dG, H, dH, a
      complex(wp) :: b(size(self%v, 1), size(self%v, 1) + 1), y(size(self%v, 1)), D_j, dD_j, w, dw
      logical :: regular
      integer :: k, l, r

      r = size(self%v, 1)
      call sum_oscillators(self, root, G, dG, D_j, dD_j, value)
      call self%couplings(self%form_at(root%s), root%s, H, dH)
      ! a = A + G H; the columns of b are v_j and the derivative of G H.
      do l = 1, r
         do k = 1, r
            a(k, l) = sum(G(k, :)*H(:, l))
            b(k, l + 1) = sum(dG(k, :)*H(:, l) + G(k, :)*dH(:, l))
         end do
         a(l, l) = a(l, l) + self%compliance(l)
         b(l, 1) = self%v(l, root%j)
      end do
      call eliminate(r, r + 1, a, b, regular)
      ! w = D_j + v_j'f and dw = w'; value collects the trace of (A + G H)**-1 (G H)'.
      w = D_j
      dw = dD_j
      do k = 1, r
         y(k) = sum(H(k, :)*b(:, 1))
         w = w + self%v(k, root%j)*y(k)
         y(k) = sum(b(k, 2:)*b(:, 1))
      end do
      do k = 1, r
         dw = dw + self%v(k, root%j)*sum(dH(k, :)*b(:, 1) - H(k, :)*y)
         value = value + b(k, k + 1)
      end do
      if (.not. regular) then
         value = 0
      else if (.not. abs(w) > 0) then
         value = huge(1.0_wp)
      else
         value = value + dw/w
      end if
   end function logarithmic_derivative

   !> Computes the sums over all oscillators but j at a point s.
   !>
   !> G, dG      (r, r) G(s) and G'(s)
   !> D_j, dD_j  D_j(s) and D_j'(s)
   !> value      sum of D_i'/D_i over i /= j
   pure subroutine sum_oscillators(self, root, G, dG, D_j, dD_j, value)
      type(assembly_t), intent(in) :: self
      type(root_t), intent(in) :: root
      complex(wp), intent(out) :: G(:, :), dG(:, :), D_j, dD_j, value
      complex(wp) :: all_D(self%n), all_dD(self%n), D, dD
      integer :: i, k, l, r

      r = size(self%v, 1)
      call denominators(self, root, all_D, all_dD)
      G = 0
      dG = 0
      value = 0
      do i = 1, self%n
         D = all_D(i)
         dD = all_dD(i)
         if (i == root%j) then
            D_j = D
            dD_j = dD
            cycle
         end if
         D = 1/D
         dD = dD*D
         value = value + dD
         dD = -dD*D
         do l = 1, r
            do k = 1, l
               G(k, l) = G(k, l) + self%v(k, i)*self%v(l, i)*D
               dG(k, l) = dG(k, l) + self%v(k, i)*self%v(l, i)*dD
            end do
         end do
      end do
      do l = 1, r
         G(l, :l - 1) = G(:l - 1, l)
         dG(l, :l - 1) = dG(:l - 1, l)
      end do
   end subroutine sum_oscillators

end module beamid_characteristic
