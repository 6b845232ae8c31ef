!> What each mode contributes to a record whose force is known.
module beamid_driven_modes
   use beamid_excitation, only: excitation_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_poles, only: poles_t
   use beamid_spectra, only: noise_near
   use beamid_synthesis, only: synthesize
   implicit none
   private

   public :: weigh_driven_modes

contains

   !> Computes the weight of each mode in a record whose force is known.
   !>
   !> A mode with the root s moves like Re(c z) with z' = s z + f, where f is the force. The complex
   !> factors c of all modes, a constant and a multiple of f are fitted to the record. Spectral
   !> lines would not do: after each blow a mode begins anew, and its line splits.
   !>
   !> excitation  the force
   !> t, z        (m) sample times [time] and record [length/time**2]
   !> residual    (m) residuals of the structure's fit [length/time**2]
   !> s           (modes) roots with Im s > 0 [1/time]
   !> share       (modes) share of the record's variance
   !> gain        (modes) by how much the mode reduces the sum of squares, over the variance of the
   !>             noise around its frequency; 0 for records that are too short or constant
   subroutine weigh_driven_modes(excitation, t, z, residual, s, share, gain)
      type(excitation_t), intent(in) :: excitation
      real(wp), intent(in) :: t(:), z(:), residual(:)
      complex(wp), intent(in) :: s(:)
      real(wp), intent(out) :: share(:), gain(:)
      real(wp), parameter :: independent = 1e-10_wp   ! of a column that counts as independent
      real(wp), parameter :: two_pi = 2*acos(-1.0_wp)
      real(wp) :: a(size(t), 2*size(s) + 2), step(size(a, 2)), variance
      logical, dimension(size(a, 2)) :: is_used, others
      integer :: k

      share = 0
      gain = 0
      variance = sum((z - sum(z)/size(z))**2)
      if (size(a, 1) <= size(a, 2) .or. .not. variance > 0) return
      do k = 1, size(s)
         call add_state(s(k), (1.0_wp, 0.0_wp), a(:, 2*k - 1))
         call add_state(s(k), (0.0_wp, -1.0_wp), a(:, 2*k))
      end do
      a(:, 2*size(s) + 1) = 1
      a(:, 2*size(s) + 2) = excitation%force(t)
      is_used = norm2(a, dim=1) > 0
      step = fitted(is_used)
      do k = 1, size(s)
         associate (its => a(:, 2*k - 1:2*k))
            share(k) = min(1.0_wp, sum(matmul(its, step(2*k - 1:2*k))**2)/variance)
         end associate
         others = is_used
         others(2*k - 1:2*k) = .false.
         ! A record without noise has errors of computation.
         gain(k) = (sum((z - matmul(a, fitted(others)))**2) - sum((z - matmul(a, step))**2)) &
            /max(noise_near(t, residual, aimag(s(k))/two_pi, -real(s(k))), &
            epsilon(1.0_wp)*variance/size(z))
      end do

   contains

      !> Computes Re(factor z) at the sample times for the state z of a mode.
      subroutine add_state(root, factor, column)
         complex(wp), intent(in) :: root, factor
         real(wp), intent(out) :: column(:)
         type(poles_t) :: pole
         real(wp) :: motion(size(column), 0:0, 1)

         pole%s = [root]
         pole%residue = [factor]
         allocate (pole%cluster(0))
         call synthesize(pole, excitation, t, [1], motion)
         column = motion(:, 0, 1)
      end subroutine add_state

      !> Returns the factors of some columns of `a` that fit the record best; 0 for the others.
      function fitted(columns) result(factors)
         logical, intent(in) :: columns(:)
         real(wp) :: factors(size(columns))
         integer :: rank

         call least_squares_step(a, -z, 1/max(norm2(a, dim=1), tiny(1.0_wp)), columns, &
            independent, factors, rank)
      end function fitted

   end subroutine weigh_driven_modes

end module beamid_driven_modes
