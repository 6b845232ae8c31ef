!> The sensor's limit: found where the signal is cut off, not where a coarse converter makes flats.
program test_clipping
   use beamid_clipping, only: find_limit
   use beamid_kinds, only: wp
   use checks, only: check, finish, in_long_run
   use random_numbers, only: start_random, uniform
   implicit none

   real(wp), parameter :: pi = acos(-1.0_wp)

   call start_random(20240607, 16807)
   call test_cut_off()
   call test_flats_of_the_converter()
   call test_other_flats()
   call test_natural_signals()
   call test_clipped_signals()
   call finish('clipping')

contains

   !> The limit is the level at which the signal was cut.
   subroutine test_cut_off()
      real(wp), allocatable :: z(:)

      z = [0.11_wp, 0.52_wp, 0.9_wp, 0.9_wp, 0.9_wp, 0.6125_wp, -0.117_wp, 0.53_wp, 0.4011_wp, &
         -0.3_wp, 0.601_wp, 0.2_wp]
      call found('by hand, once', z, 0.9_wp)
      call none('two in a row', z([1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12]))
      ! Ten codes in all say nothing.
      call none('by hand, ten codes', [0, 2, 9, 9, 9, 3, -1]/10.0_wp)
      ! A signal that begins or ends at its extreme proves nothing by that.
      z = [9, 9, 9, 9, 3, -1, 4, 5, 1]/10.0_wp
      call none('at the beginning', z)
      call none('at the end', z(size(z):1:-1))
      z = min(swing(4000, 50.0_wp, 1000.0_wp, 0.0_wp), 0.7_wp)
      call found('decaying, unquantised', z, 0.7_wp)
      z = quantised(z, 1/2048.0_wp)
      call found('decaying, 12 bit', z, maxval(z))
      ! Almost a square wave, and one that is at its limit for most of the time.
      z = min(swing(4000, 50.0_wp, 1e9_wp, 0.0_wp), 0.01_wp)
      call found('half of the time', z, 0.01_wp)
      z = min(swing(4000, 50.0_wp, 1e9_wp, 0.0_wp), -0.5_wp)
      call found('two thirds of the time', z, -0.5_wp)
      z = max(swing(4000, 50.0_wp, 1000.0_wp, 0.0_wp), -0.7_wp)
      call none('from below', z)
      call found('from below, negated', -z, 0.7_wp)
      z = min(max(swing(4000, 50.0_wp, 1000.0_wp, 0.0_wp), -0.7_wp), 0.6_wp)
      call found('both', z, 0.6_wp)
      call found('both, negated', -z, 0.7_wp)
   end subroutine test_cut_off

   !> Flats of good samples at the extreme.
   subroutine test_flats_of_the_converter()
      real(wp), allocatable :: z(:)

      z = quantised(swing(4000, 50.0_wp, 1e9_wp, 0.3_wp), 0.3_wp)
      call flat_top('quiet: 7 codes', z)
      z = quantised(swing(4000, 50.0_wp, 1e9_wp, 0.3_wp), 0.11_wp)
      call flat_top('quiet: 19 codes', z)
      z = quantised(swing(4000, 50.0_wp, 1e9_wp, 0.3_wp), 0.6_wp)
      call flat_top('quiet: 3 codes', z)
      z = quantised(swing(9000, 2000.0_wp, 1e9_wp, 0.0_wp), 1/500.0_wp)
      call flat_top('slow: 1000 codes', z)
      z = quantised(swing(9000, 2000.0_wp, 3000.0_wp, -1.0_wp) + 1, 1/500.0_wp)
      call flat_top('slow and decaying', z)
      ! As in text of five significant digits: coarse above 1, finer below.
      z = 0.45_wp + 0.6_wp*swing(9000, 4000.0_wp, 1e9_wp, 0.0_wp)
      z = merge(quantised(z, 1e-3_wp), quantised(z, 1e-6_wp), z >= 1)
      call flat_top('five digits', z)
   end subroutine test_flats_of_the_converter

   subroutine test_other_flats()
      real(wp), allocatable :: z(:), one(:)
      integer :: k

      z = [(merge(1.0_wp, 0.0_wp, mod(k, 20) < 10), k=1, 400)]
      call flat_top('two levels', z)
      one = swing(400, 17.0_wp, 1e9_wp, 0.0_wp)
      z = [(one((k + 4)/5), k=1, 2000)]
      call flat_top('every value five times', z)
      z = [(0.0_wp, k=1, 500)]
      call none('constant', z)
      call none('empty', z(:0))
      call none('two', z(:2))
   end subroutine test_other_flats

   !> Sums of up to three decaying swings, quantised, with and without noise: none has a limit.
   subroutine test_natural_signals()
      integer :: trials
      real(wp), allocatable :: z(:)
      real(wp) :: limit
      integer :: trial, wrong, flats
      character(len=80) :: detail

      trials = merge(2000, 400, in_long_run())
      wrong = 0
      flats = 0
      do trial = 1, trials
         z = any_signal()
         call find_limit(z, limit)
         if (runs_at_top(z) > 0) flats = flats + 1
         if (limit < huge(limit)) wrong = wrong + 1
      end do
      write (detail, '(i0,a,i0,a)') wrong, ' of ', flats, ' that have flats at the top'
      ! A top with two humps may pass for a limit: what is lost then is a few samples.
      call check('natural signals: hardly any has a limit', wrong <= flats/100, trim(detail))
      call check('natural signals: many have flats', flats > trials/5)
   end subroutine test_natural_signals

   !> The same signals cut off by at least 5 steps, so that 3 samples or more are lost.
   subroutine test_clipped_signals()
      integer :: trials
      real(wp), allocatable :: z(:)
      real(wp) :: limit, level, step
      integer :: trial, missed, clipped
      character(len=80) :: detail

      trials = merge(2000, 400, in_long_run())
      missed = 0
      clipped = 0
      do trial = 1, trials
         z = any_signal(step)
         level = step*nint((minval(z) + (maxval(z) - minval(z))*(0.5_wp + 0.45_wp*uniform()))/step)
         if (maxval(z) < level + 5*step .or. level < minval(z) + 40*step) cycle
         z = min(z, level)
         if (inner_run(z) < 3) cycle
         clipped = clipped + 1
         call find_limit(z, limit)
         if (abs(limit - level) > 0) missed = missed + 1
      end do
      write (detail, '(i0,a,i0)') missed, ' missed of ', clipped
      ! Noise breaks some of the flats, slow swings stay near their limit: those are missed.
      call check('clipped signals: found', missed <= clipped/20, trim(detail))
      call check('clipped signals: many', clipped > trials/4)
   end subroutine test_clipped_signals

   !> Up to three decaying swings of any period and phase, noise of up to 2 steps in one of three.
   function any_signal(unit) result(z)
      real(wp), allocatable :: z(:)
      real(wp), intent(out), optional :: unit
      integer :: k, j
      real(wp) :: noise, step

      z = [(0.0_wp, k=1, 3000)]
      do j = 1, 1 + int(3*uniform())
         z = z + uniform()*swing(3000, 5*200.0_wp**uniform(), 500*1000.0_wp**uniform(), &
            6.3_wp*uniform())
      end do
      step = (maxval(z) - minval(z))/(2*2000.0_wp**uniform())
      noise = 0
      if (uniform() > 0.67_wp) noise = 2*uniform()*step
      do k = 1, size(z)
         z(k) = z(k) + noise*(2*uniform() - 1)
      end do
      z = quantised(z, step)
      if (present(unit)) unit = step
   end function any_signal

   !> exp(-k/decay) cos(2 pi k/period + phase)
   pure function swing(n, period, decay, phase) result(z)
      integer, intent(in) :: n
      real(wp), intent(in) :: period, decay, phase
      real(wp) :: z(n)
      integer :: k

      z = [(exp(-k/decay)*cos(2*pi*k/period + phase), k=1, n)]
   end function swing

   pure function quantised(z, step) result(codes)
      real(wp), intent(in) :: z(:), step
      real(wp) :: codes(size(z))

      codes = step*anint(z/step)
   end function quantised

   subroutine found(what, z, level)
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: z(:), level
      real(wp) :: limit

      call find_limit(z, limit)
      call check('limit: '//what, abs(limit - level) <= 0)
   end subroutine found

   subroutine none(what, z)
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: z(:)
      real(wp) :: limit

      call find_limit(z, limit)
      call check('no limit: '//what, limit >= huge(limit))
   end subroutine none

   !> No limit though the top is flat, on both sides.
   subroutine flat_top(what, z)
      character(len=*), intent(in) :: what
      real(wp), intent(in) :: z(:)

      call check('flat at the top: '//what, runs_at_top(z) > 0)
      call none(what, z)
      call none(what//', negated', -z)
   end subroutine flat_top

   !> How many times three samples in a row are at the maximum.
   pure integer function runs_at_top(z) result(n)
      real(wp), intent(in) :: z(:)
      integer :: k

      n = count([(minval(z(k:k + 2)) >= maxval(z), k=1, size(z) - 2)])
   end function runs_at_top

   !> The longest run at the maximum that neither begins nor ends the record.
   pure integer function inner_run(z) result(longest)
      real(wp), intent(in) :: z(:)
      real(wp) :: top
      integer :: k, length

      top = maxval(z)
      longest = 0
      length = -size(z)
      do k = 1, size(z)
         if (z(k) >= top) then
            length = length + 1
         else
            longest = max(longest, length)
            length = 0
         end if
      end do
   end function inner_run

end program test_clipping
