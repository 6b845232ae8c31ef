!> Finds free decays whose first samples do not fit: modes that the fit lacks have not died out
!> there, or something has knocked at the beam.
module beamid_early_residuals
   use beamid_experiments, only: experiment_t
   use beamid_gauss_newton, only: least_squares_step
   use beamid_kinds, only: wp
   use beamid_sorting, only: median
   use beamid_stage_fits, only: stage_fit_t
   use beamid_strings, only: fixed, rounded, to_text
   implicit none
   private

   public :: end_of_early_residuals, find_early_residuals, share_of_modes

contains

   !> Finds and describes the records whose residuals are much larger in the first samples than
   !> later, and are not explained by errors of the fitted modes. Nothing is found if these samples
   !> hold a small share of the sum of squares in each record, and hardly move any estimate.
   !>
   !> experiments  (records)
   !> fit          of these records
   !> s            (modes, records) roots of the fitted modes [1/time]
   !> change       (free) of the searched variables without the first samples of these records, to
   !>              first order; not allocated if there is no such record
   !> text         '' if there is no such record
   subroutine find_early_residuals(experiments, fit, s, change, text)
      type(experiment_t), intent(in) :: experiments(:)
      type(stage_fit_t), intent(in) :: fit
      complex(wp), intent(in) :: s(:, :)
      real(wp), allocatable, intent(out) :: change(:)
      character(len=:), allocatable, intent(out) :: text
      !> Least share of the sum of squares of a record, and least change of an estimate in half
      !> widths of its interval.
      real(wp), parameter :: least_share = 0.2_wp, least_change = 0.5_wp
      character(len=:), allocatable :: time, times
      real(wp) :: largest, ratio, sd(size(fit%free))
      integer :: first, k, modes, named, r
      logical :: matters, kept(size(fit%fit%residual))

      kept = .true.
      text = ''
      times = ''
      largest = 0
      named = 0
      first = 0
      matters = .false.
      do r = 1, size(experiments)
         associate (m => size(experiments(r)%measured), t => experiments(r)%samples, &
            residual => fit%residual)
            k = 0
            modes = min(experiments(r)%excitation%modes, size(s, 1))
            if (modes > 0 .and. size(t) == m) call end_of_unexplained(t, experiments(r)%measured, &
               residual(first + 1:first + m), s(:modes, r), k, ratio)
            if (k > 0) then
               kept(first + 1:first + k - 1) = .false.
               matters = matters .or. sum(residual(first + 1:first + k - 1)**2) >= &
                  least_share*sum(residual(first + 1:first + m)**2)
               call put_time(t, k, time)
               if (named > 0) times = times//', '
               times = times//'t = '//time//' in record '//to_text(r)
               named = named + 1
               largest = max(largest, ratio)
            end if
            first = first + m
         end associate
      end do
      if (named == 0) return
      allocate (change(size(fit%free)))
      call fit%step_of_rows(pack([(k, k=1, size(kept))], kept), change, sd)
      matters = matters .or. any(abs(change) > least_change*[(fit%half_width(k), &
         k=1, size(fit%free))])
      if (.not. matters) then
         deallocate (change)
      else if (named == 1) then
         text = 'until '//times//' the residuals are '//rounded(largest, 2)//' times as large '// &
            'as later: the record holds something there that the fit lacks, such as higher '// &
            'modes. Begin at this time (t_first='//time//'), and fit again'
      else
         text = 'until '//times//' the residuals are up to '//rounded(largest, 2)//' times as '// &
            'large as later: the records hold something there that the fit lacks, such as '// &
            'higher modes. Begin at these times (t_first), and fit again'
      end if
   end subroutine find_early_residuals

   !> Finds the end of residuals that are large at the beginning of a record, as
   !> `end_of_early_residuals` does, unless errors of the fitted modes explain them.
   !>
   !> s  (modes) roots of the fitted modes [1/time]
   subroutine end_of_unexplained(t, z, residual, s, first, ratio)
      real(wp), intent(in) :: t(:), z(:), residual(:)
      complex(wp), intent(in) :: s(:)
      integer, intent(out) :: first
      real(wp), intent(out) :: ratio
      !> Share of the first residuals that errors of the fitted modes may explain, and samples per
      !> column from which this share is computed: fewer samples would be explained by any columns.
      real(wp), parameter :: most = 0.9_wp
      integer, parameter :: per_column = 8
      real(wp) :: noise
      integer :: last

      call end_of_early_residuals(t, z, residual, -maxval(s%re), first, ratio)
      if (first == 0) return
      last = min(size(t), max(first - 1, 4*per_column*size(s)))
      noise = norm2(residual(:first - 1))/sqrt(real(first - 1, wp))/ratio
      if (share_of_modes(t(:last), residual(:last), s, noise) > most) first = 0
   end subroutine end_of_unexplained

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

   !> Returns the share of the sum of squares of residuals, beyond that of noise, that errors of the
   !> roots and amplitudes of modes explain: combinations of e^(s t) and t e^(s t). Samples behind
   !> the first residuals tell errors of a slow mode, which would go on, from a short motion.
   !>
   !> t         (m) [time]
   !> residual  (m)
   !> s         (modes) roots [1/time]
   !> noise     standard deviation of the noise
   function share_of_modes(t, residual, s, noise) result(share)
      real(wp), intent(in) :: t(:), residual(:), noise
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
      associate (all => sum(residual**2), rest => sum((residual + matmul(basis, factor))**2))
         share = (all - rest - rank*noise**2)/max(all - size(t)*noise**2, tiny(share))
      end associate
   end function share_of_modes

   !> Finds the first sample behind large residuals at the beginning of a free decay: with blocks of
   !> many samples (a 256th of the record, but at least 16), then with blocks of few.
   !>
   !> t         (m) [time]
   !> z         (m) measured [length/time**2]
   !> residual  (m) [length/time**2]
   !> rate      of decay of the slowest mode [1/time]
   !> first     the sample behind the conspicuous ones; 0: there are none
   !> ratio     of the residuals before it to those of the second half, as root mean squares
   subroutine end_of_early_residuals(t, z, residual, rate, first, ratio)
      real(wp), intent(in) :: t(:), z(:), residual(:), rate
      integer, intent(out) :: first
      real(wp), intent(out) :: ratio
      integer, parameter :: most_blocks = 256, many = 16, few = 4

      call end_of_early_blocks(t, z, residual, rate, max(many, size(z)/most_blocks), first, ratio)
      if (first == 0) call end_of_early_blocks(t, z, residual, rate, few, first, ratio)
   end subroutine end_of_early_residuals

   !> Finds this sample with blocks of one length. The first blocks are conspicuous if
   !> - the residuals of the first one are at least five times as large as the median of the second
   !>   half of the record, and those of the others at least three times as large, and at least a
   !>   tenth of those of the first one;
   !> - they are at most a quarter of the record;
   !> - behind them, the residuals drop by at least three times the factor by which the cube of the
   !>   slowest mode's amplitude decays in that time. (Residuals that follow a power of the motion
   !>   are errors of a model whose damping or stiffness is constant.) The motion must have begun:
   !>   if it is much larger later than in the first block, the window begins before the motion,
   !>   which is reported elsewhere.
   !> A record of fewer than 12 blocks is not examined. The mean squares of white noise in two
   !> blocks of four samples or more differ much less. The residuals behind the first blocks may
   !> still be large, because the fit tries to explain all of them; a second fit that begins there
   !> is judged again.
   !>
   !> length  of a block, in samples; the other arguments as of `end_of_early_residuals`
   subroutine end_of_early_blocks(t, z, residual, rate, length, first, ratio)
      real(wp), intent(in) :: t(:), z(:), residual(:), rate
      integer, intent(in) :: length
      integer, intent(out) :: first
      real(wp), intent(out) :: ratio
      integer, parameter :: least_blocks = 12
      !> Squares of the ratios above.
      real(wp), parameter :: large = 9, largest = 25, faster = 9, fallen = 0.01_wp
      real(wp), parameter :: quiet = 0.5_wp
      real(wp), allocatable :: of_residual(:), of_motion(:)
      real(wp) :: level, before, after, fall, mean
      integer :: k, n, next

      first = 0
      ratio = 1
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
      next = k + max(k, 4)
      before = sum(of_residual(:k))/k
      if (quiet*maxval(of_motion(:next)) > of_motion(1)) return
      fall = exp(-rate*(t(k*length + 1) - t(1)))
      after = sum(of_residual(k + 1:next))/(next - k)
      if (faster*after > before*fall**6) return
      first = k*length + 1
      ratio = sqrt(before/level)
   end subroutine end_of_early_blocks

end module beamid_early_residuals
