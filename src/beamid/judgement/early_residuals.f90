!> Finds free decays whose first samples do not fit: modes that the fit lacks have not died out
!> there, or something has knocked at the beam.
module beamid_early_residuals
   use beamid_experiments, only: experiment_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   use beamid_strings, only: fixed, rounded, to_text
   implicit none
   private

   public :: describe_early_residuals, end_of_early_residuals, share_of_modes

contains

   !> Describes the records whose residuals are much larger in their first samples, unless they are
   !> errors of the modes that were fitted; '' if there is none.
   !>
   !> experiments  (records)
   !> residual     rows of the residuals of all records, one record after the other
   !> s            (modes, records) roots of the fitted modes [1/time]
   subroutine describe_early_residuals(experiments, residual, s, text)
      type(experiment_t), intent(in) :: experiments(:)
      real(wp), intent(in) :: residual(:)
      complex(wp), intent(in) :: s(:, :)
      character(len=:), allocatable, intent(out) :: text
      !> Share of the first residuals that errors of the fitted modes may explain. Of few samples
      !> they explain a good part of any oscillation.
      real(wp), parameter :: most = 0.9_wp
      character(len=:), allocatable :: time, times
      real(wp) :: largest, ratio
      integer :: first, k, modes, named, r

      text = ''
      times = ''
      largest = 0
      named = 0
      first = 0
      do r = 1, size(experiments)
         associate (m => size(experiments(r)%measured))
            k = 0
            modes = min(experiments(r)%excitation%modes, size(s, 1))
            if (modes > 0 .and. size(experiments(r)%samples) == m) then
               call end_of_early_residuals(experiments(r)%measured, residual(first + 1:first + m), &
                  k, ratio)
               if (k > 0) then
                  if (share_of_modes(experiments(r)%samples(:k - 1), residual(first + 1:first + &
                     k - 1), s(:modes, r)) > most) k = 0
               end if
            end if
            if (k > 0) then
               call put_time(experiments(r)%samples, k, time)
               if (named > 0) times = times//', '
               times = times//'t = '//time//' in record '//to_text(r)
               named = named + 1
               largest = max(largest, ratio)
            end if
            first = first + m
         end associate
      end do
      select case (named)
      case (0)
         return
      case (1)
         text = 'until '//times//' the residuals are '//rounded(largest, 2)//' times as large '// &
            'as later: the record holds something there that the fit lacks, such as higher '// &
            'modes. Begin at this time (t_first='//time//'), and fit again'
      case default
         text = 'until '//times//' the residuals are up to '//rounded(largest, 2)//' times as '// &
            'large as later: the records hold something there that the fit lacks, such as '// &
            'higher modes. Begin at these times (t_first), and fit again'
      end select
   end subroutine describe_early_residuals

   !> Sets a text to the time of sample k, with as many decimals as the step to it needs.
   subroutine put_time(t, k, text)
      real(wp), intent(in) :: t(:)
      integer, intent(in) :: k
      character(len=:), allocatable, intent(out) :: text
      integer, parameter :: most = 9

      text = trim(adjustl(fixed(t(k), 40, max(1, min(most, 1 - floor(log10(t(k) - t(k - 1))))))))
      if (index(text, '.') > 0) text = text(:verify(text, '0', back=.true.))
      if (text(len(text):) == '.') text = text(:len(text) - 1)
   end subroutine put_time

   !> Returns the share of the sum of squares of residuals that errors of the roots and amplitudes
   !> of modes explain: combinations of e^(s t) and t e^(s t).
   !>
   !> t         (m) [time]
   !> residual  (m)
   !> s         (modes) roots [1/time]
   function share_of_modes(t, residual, s) result(share)
      real(wp), intent(in) :: t(:), residual(:)
      complex(wp), intent(in) :: s(:)
      real(wp) :: share
      real(wp), parameter :: independent = 1e-8_wp   ! of a column that counts as independent
      real(wp), dimension(size(t), 4*size(s)) :: basis
      real(wp) :: factor(4*size(s))
      complex(wp) :: wave(size(t))
      integer :: k, rank

      do k = 1, size(s)
         wave = exp(s(k)*(t - t(1)))
         basis(:, 4*k - 3) = wave%re
         basis(:, 4*k - 2) = wave%im
         basis(:, 4*k - 1) = (t - t(1))*wave%re
         basis(:, 4*k) = (t - t(1))*wave%im
      end do
      call least_squares_step(basis, residual, 1/max(norm2(basis, dim=1), tiny(share)), &
         spread(.true., 1, size(factor)), independent, factor, rank)
      share = 1 - sum((residual + matmul(basis, factor))**2)/max(sum(residual**2), tiny(share))
   end function share_of_modes

   !> Finds the sample from which on the residuals of a free decay have their later size.
   !>
   !> The record is divided into short blocks. Its first blocks are conspicuous if
   !> - the residuals of the first one are at least five times as large as the median of the second
   !>   half of the record, and those of the others at least three times as large, and at least a
   !>   tenth of those of the first one;
   !> - they are at most a quarter of the record, and hold at least a fifth of the sum of squares;
   !> - the residuals fall behind them by at least three times the factor by which the cube of the
   !>   motion falls. (Residuals that follow a power of the motion are errors of a model whose
   !>   damping or stiffness is constant.) The motion must have begun before: if it is larger behind
   !>   the first blocks than in them, the window begins with a quiet time, another mistake.
   !> A block has at least 16 samples, and a record of fewer than 12 blocks is not examined. The
   !> mean squares of white noise in two such blocks differ much less. The residuals behind the
   !> first blocks may still be large, because the fit tries to explain all of them; a second fit
   !> that begins there is judged again.
   !>
   !> z         (m) measured [length/time**2]
   !> residual  (m) [length/time**2]
   !> first     the sample behind the conspicuous ones; 0: there are none
   !> ratio     of the residuals before it to those of the second half, as root mean squares
   subroutine end_of_early_residuals(z, residual, first, ratio)
      real(wp), intent(in) :: z(:), residual(:)
      integer, intent(out) :: first
      real(wp), intent(out) :: ratio
      integer, parameter :: most_blocks = 256, least_samples = 16, least_blocks = 12
      !> Squares of the ratios above.
      real(wp), parameter :: large = 9, largest = 25, faster = 9, fallen = 0.01_wp
      real(wp), parameter :: least_share = 0.2_wp, quiet = 0.5_wp
      real(wp), allocatable :: of_residual(:), of_motion(:)
      real(wp) :: level, before, after, fall, mean
      integer :: length, k, n, next

      first = 0
      ratio = 1
      length = max(least_samples, size(z)/most_blocks)
      n = size(z)/length
      if (n < least_blocks) return
      mean = sum(z)/size(z)
      allocate (of_residual(n), of_motion(n))
      do k = 1, n
         of_residual(k) = sum(residual((k - 1)*length + 1:k*length)**2)/length
         of_motion(k) = maxval(abs(z((k - 1)*length + 1:k*length) - mean))
      end do
      level = median(of_residual(n/2 + 1:))
      if (.not. of_residual(1) > largest*level) return
      k = findloc(of_residual > max(large*level, fallen*of_residual(1)), .false., dim=1) - 1
      if (k < 1 .or. 4*k > n) return
      if (sum(of_residual(:k)) < least_share*sum(of_residual)) return
      next = k + max(k, 4)
      before = sum(of_residual(:k))/k
      fall = maxval(of_motion(k + 1:next))/maxval(of_motion(:k))
      after = sum(of_residual(k + 1:next))/(next - k)
      if (fall > 1/quiet .or. faster*after > before*fall**6) return
      first = k*length + 1
      ratio = sqrt(before/level)
   end subroutine end_of_early_residuals

end module beamid_early_residuals
