!> What each mode contributes to a record whose force is known.
module beamid_driven_modes
   use beamid_condensation, only: condense_matrix, condensed_t
   use beamid_excitation, only: excitation_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: two_pi, wp
   use beamid_poles, only: poles_t
   use beamid_spectra, only: noise_near
   use beamid_synthesis, only: synthesize
   implicit none
   private

   public :: weigh_driven_modes

contains

   !> Computes the weight of each mode in a record whose force is known.
   !>
   !> A mode with the root s moves like Re(c x) with x' = s x + f, where f is the force. The complex
   !> factors c of all modes, a constant and a multiple of f are fitted to the record. Spectral
   !> lines would not do: each blow excites a mode anew, so that its line splits.
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
      real(wp), parameter :: independent = 1e-10_wp   ! smallest reciprocal condition number
      real(wp) :: a(size(t), 2*size(s) + 2), motion(size(t), 0:0, 2), variance, J, J_without
      real(wp), dimension(size(a, 2)) :: step, other_step
      logical, dimension(size(a, 2)) :: is_used, others
      type(condensed_t) :: condensed
      type(poles_t) :: pole
      integer :: k

      share = 0
      gain = 0
      variance = sum((z - sum(z)/size(z))**2)
      if (size(a, 1) <= size(a, 2) .or. .not. variance > 0) return
      ! Every Re(c x) is a combination of the displacement Re x and the velocity Re(s x).
      pole%residue = [(1.0_wp, 0.0_wp)]
      allocate (pole%cluster(0))
      do k = 1, size(s)
         pole%s = s(k:k)
         call synthesize(pole, excitation, t, [1, 2], motion)
         a(:, 2*k - 1:2*k) = motion(:, 0, :)
      end do
      a(:, 2*size(s) + 1) = 1
      a(:, 2*size(s) + 2) = excitation%force(t)
      is_used = norm2(a, dim=1) > 0
      call condense_matrix(a, z, condensed)
      call fit_columns(is_used, step, J)
      do k = 1, size(s)
         associate (its => [2*k - 1, 2*k])
            share(k) = min(1.0_wp, sum(matmul(condensed%factor(:, its), step(its))**2)/variance)
            others = is_used
            others(its) = .false.
         end associate
         call fit_columns(others, other_step, J_without)
         ! Without noise, the residuals may be 0: round-off is the least noise.
         gain(k) = (J_without - J)/max(noise_near(t, residual, aimag(s(k))/two_pi, -real(s(k))), &
            epsilon(1.0_wp)*variance/size(z))
      end do

   contains

      !> Fits some columns of `a` to the record.
      !>
      !> factors  of the columns; 0 for the others
      !> J        sum of squares, without the part that no column can explain
      subroutine fit_columns(columns, factors, J)
         logical, intent(in) :: columns(:)
         real(wp), intent(out) :: factors(:), J
         integer :: rank

         associate (R => condensed%factor, y => condensed%y)
            call least_squares_step(R, -y, 1/max(norm2(R, dim=1), tiny(1.0_wp)), columns, &
               independent, factors, rank)
            J = sum((y - matmul(R, factors))**2)
         end associate
      end subroutine fit_columns

   end subroutine weigh_driven_modes

end module beamid_driven_modes
